"""The hyper-parameter search: a strict space, Optuna's study, and nothing lost by a kill.

Most tests put a stand-in for the training, which is tested by itself; one trains.
"""

import json
import math
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import optuna
import pytest
from optuna.distributions import CategoricalDistribution

from agents.config.load import ConfigError, dump, load
from commands.yaml import read
from rlcas_jax import finish, loop
from rlcas_jax.config import TrainConfig
from rlcas_jax.sweep import run as sweep
from rlcas_jax.sweep.cli import parse
from rlcas_jax.sweep.figures import draw
from rlcas_jax.sweep.space import overrides
from rlcas_jax.sweep.space import parse as parse_space

ROOT = Path(__file__).resolve().parents[2]
TINY = """\
name: tiny
steps: 5120
network: {hidden: [4]}
environments: 16
rollout: 16
ppo: {minibatch: 64, segment: 8, epochs: 1}
pool_rows: 2
scenarios: [{name: circle}, {name: head_on}]
evaluation: {every_steps: 1280, encounters: 4, final_encounters: 8}
checkpoint: {every_seconds: 0.0}
"""
SPACE = """\
learning_rate: {low: 1e-5, high: 1e-1, log: true}
ppo.minibatch: {choices: [32, 64]}
ppo.epochs: {low: 1, high: 4}
rewards.goal_distance: {low: 0, high: 100, step: 25}
network.hidden: {choices: [[4], [4, 4]]}
scenarios.1.weight: {low: 0.1, high: 2.0}
"""


def quality(config: TrainConfig) -> float:
    """Return the stand-in's success: 1 at a learning rate of 1e-3, falling to both sides."""
    return math.exp(-abs(math.log10(config.learning_rate) + 3.0)) - 0.01 * (config.seed - 5)


def stand_in(training: Any, reporter: Any, interrupt: Any = None) -> Any:
    """Report four evaluations, as a training does."""
    config = training.config
    reporter.start(total=config.steps)
    for number in range(1, 5):
        found = quality(config) * number / 4
        row = {
            "step": number * config.evaluation.every_steps,
            "steps_per_s": 1.0,
            "score": math.nan,
        }
        reporter.update(row | {"eval_success": found, "eval_score": 100.0 * found})
    reporter.stop()
    return SimpleNamespace(config=config, directory=training.directory, finished=True)


def evaluate(run: Any) -> dict[str, Any]:
    found = quality(run.config)
    return {
        "finished": True,
        "evaluation": {"success_given_resolvable": found, "score_mean": 100.0 * found},
    }


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the stand-in in the place of the training, and draw no figures."""
    monkeypatch.setattr(
        loop,
        "prepare",
        lambda config, directory: SimpleNamespace(config=config, directory=directory),
    )
    monkeypatch.setattr(loop, "run", stand_in)
    monkeypatch.setattr(finish, "finish", evaluate)
    monkeypatch.setattr(sweep, "STARTUP", 3)
    monkeypatch.setattr(
        sweep, "gc", SimpleNamespace(collect=int)
    )  # nothing to collect, and looking takes time
    monkeypatch.setattr(sweep, "draw", lambda *_: None)


def arguments(
    folder: Path, out: str = "out", space: str = SPACE, trials: int = 6, more: str = ""
) -> list[str]:
    for name, text in (("tiny.yaml", TINY), ("space.yaml", space)):
        (folder / name).write_text(text)
    given = f"--config {folder / 'tiny.yaml'} --space {folder / 'space.yaml'} --out {folder / out}"
    given += "" if "--trials" in more else f" --trials {trials}"
    return [*given.split(), "--quiet", *more.split()]


def trials(out: Path) -> list[optuna.trial.FrozenTrial]:
    return optuna.load_study(study_name=None, storage=f"sqlite:///{out / sweep.STUDY}").trials


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        (
            "learning_rat: {low: 1, high: 2}",
            "learning_rat is unknown; did you mean learning_rate?",
        ),
        ("learningrate: {low: 1e-4, high: 1e-3}", "did you mean learning_rate?"),
        (
            "ppo.learning_rate: {low: 1e-4, high: 1e-3}",
            "space.yaml: ppo.learning_rate has moved; expected learning_rate",
        ),
        (
            "learning_rate: {low: 1e-4, high: 1e-3, lg: true}",
            "expected {low, high}, with log or step, or {choices}",
        ),
        (
            "learning_rate: {low: 1e-4, high: 2}",
            "space.yaml: learning_rate is 2.0; expected a number above 0",
        ),
        ("learning_rate: {low: 1e-3, high: 1e-4}", "low <= high"),
        ("learning_rate: {low: 1e-3}", "'high'"),
        ("learning_rate: {low: 1e-3, high: .inf}", "numbers of a key that is one"),
        ("ppo.entropy: {low: 0, high: 1e-2, log: true}", "must hold for `log=True`"),
        (
            "ppo.minibatch: {choices: [64, 96]}",
            "ppo.minibatch is 96; expected a divisor of environments times rollout",
        ),
        ("ppo.minibatch: {choices: []}", "must contain one or more elements"),
        ("ppo.minibatch: [64, 128]", r"is \[64, 128\]; expected {low, high}"),
        ("network.feature_set: {low: 1, high: 2}", "expected {choices: "),
        ("network.feature_set: {choices: [mirror, nome]}", "did you mean none?"),
        ("scenarios.0.name: {choices: [circle, cirkle]}", "did you mean circle?"),
        ("scenarios.5.weight: {low: 1, high: 2}", "'5' is no item of a list of 2"),
        ("seed: {low: 1, high: 2}", "seed cannot be searched"),
        ("aircraft.separation_m: {low: 900, high: 1000}", "cannot be searched"),
        ("ppo: {choices: [1, 2]}", "ppo is 1; expected"),
        ("", "it names no key"),
        ("a: {low: 1, low: 2}", "key low stands twice"),
    ],
)
def test_a_space_that_is_not_usable_is_refused_in_a_sentence(
    entry: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=says):
        parse(arguments(tmp_path, space=entry))
    assert not (tmp_path / "out").exists()


def test_a_value_that_is_valid_only_with_some_others_is_taken(tmp_path: Path) -> None:
    space = "ppo.minibatch: {choices: [64, 512]}\nenvironments: {choices: [16, 32]}"
    assert len(parse(arguments(tmp_path, space=space)).space) == 2


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("--seeds 0", "--seeds: '0'; expected a whole number of at least 1"),
        ("--resume --trials 0", "--trials: '0'; expected a whole number of at least 1"),
        ("--set ppo.clap=1", "did you mean ppo.clip?"),
        ("--resume", "cannot change a sweep"),
    ],
)
def test_a_bad_option_is_refused(more: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        parse(arguments(tmp_path, more=more))


def test_all_that_is_missing_is_named_in_one_sentence() -> None:
    configurations = "--config FILE (or paper, quick, sprint), --space FILE (or sweep_quick)"
    for line, says in (
        ([], f"expected also {configurations}, --trials N, --out DIR"),
        (["--out", "none"], f"expected also {configurations}, --trials N"),
        (["--resume"], "expected also --out DIR"),
    ):
        with pytest.raises(ConfigError) as refusal:
            parse(line)
        assert str(refusal.value) == says


def test_the_example_is_a_space_of_the_quick_configuration() -> None:
    given = (
        "--config configs/quick.yaml --space configs/sweep_quick.yaml --trials 1 --out "
        "runs/none-such"
    )
    options = parse(
        [str(ROOT / word) if word.startswith("configs/") else word for word in given.split()]
    )
    assert "learning_rate" in options.space


@pytest.mark.slow
def test_no_combination_of_the_example_is_refused() -> None:
    space: dict[str, Any] = dict(
        parse_space(read(ROOT / "configs/sweep_quick.yaml"), "sweep_quick.yaml")
    )
    rng = random.Random(3)
    choices = {
        key: one.choices if isinstance(one, CategoricalDistribution) else (one.low, one.high)
        for key, one in space.items()
    }
    for _ in range(300):
        values = {key: rng.choice(some) for key, some in choices.items()}
        load(TrainConfig, ROOT / "configs/quick.yaml", overrides(values))


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_every_trial_is_shown_with_its_state_and_why_it_was_pruned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    space = "ppo.minibatch: {choices: [64, 512]}\nenvironments: {choices: [16, 32]}\n"
    space += "learning_rate: {low: 1e-5, high: 1e-1, log: true}"
    asked = [one for one in arguments(tmp_path, space=space, trials=16) if one != "--quiet"]
    assert sweep.main(asked) == 0
    printed = capsys.readouterr()
    lines = re.findall(r"^trial (\d+): (success|pruned, \S+)", printed.out, re.MULTILINE)
    assert [int(number) for number, _ in lines] == list(range(16))
    # Both kinds of a reason: refused by the configuration, and stopped by Optuna's pruner.
    assert {end for _, end in lines} == {"success", "pruned, ppo.minibatch", "pruned, below"}
    told = json.loads((tmp_path / "out/sweep.json").read_text())["trials"]
    assert [one["state"] for one in told] == [
        one.state.name.lower() for one in trials(tmp_path / "out")
    ]
    assert all(bool(one["reason"]) == (one["state"] == "pruned") for one in told)
    assert ", trial 2, 1 steps/s" in printed.err


@pytest.mark.slow
def test_a_sheet_of_many_keys_fits_a_page(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    study = optuna.create_study(direction="maximize")
    space = parse_space(read(ROOT / "configs/sweep_quick.yaml"), "sweep_quick.yaml")
    for number in range(9):
        trial = study.ask(dict(space))
        study.tell(trial, 0.1 * number)
    draw(study, tmp_path)
    for name in ("history", "slices", "importance"):
        with image.open(tmp_path / f"{name}.png") as picture:
            width, height = picture.size
        assert width <= 1_500 and height <= 1_800, name


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_sweep_leaves_its_study_and_the_best_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.undo()
    for name, stand in (
        ("run", stand_in),
        ("prepare", lambda c, d: SimpleNamespace(config=c, directory=d)),
    ):
        monkeypatch.setattr(loop, name, stand)
    monkeypatch.setattr(finish, "finish", evaluate)
    out = tmp_path / "out"
    assert sweep.main(arguments(tmp_path, trials=9)) == 0
    found = trials(out)
    best = max(found, key=lambda trial: trial.value or 0.0)
    report = json.loads((out / "sweep.json").read_text())
    assert report["finished"] and report["states"] == {"complete": 9}
    assert report["best"]["trial"] == best.number
    # The best configuration is that of its trial, and both are read by the strict configuration.
    config = load(TrainConfig, out / "best.yaml")
    assert config == load(TrainConfig, sweep.trial_directory(out, best.number) / "config.yaml")
    assert config.learning_rate == best.params["learning_rate"]
    assert dump(load(TrainConfig, out / "config.yaml")) == dump(
        load(TrainConfig, tmp_path / "tiny.yaml")
    )
    for name in ("history", "slices", "importance"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5_000
        assert (out / "figures" / f"{name}.svg").exists()
    assert f"best: trial {best.number}" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_trials_below_the_median_are_stopped_early(tmp_path: Path) -> None:
    sweep.main(arguments(tmp_path, trials=12))
    found = trials(tmp_path / "out")
    stopped = [trial for trial in found if trial.state == optuna.trial.TrialState.PRUNED]
    assert stopped and all(len(trial.intermediate_values) < 4 for trial in stopped)
    assert all(trial.state == optuna.trial.TrialState.COMPLETE for trial in found[:3])


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_several_seeds_count_by_their_mean(tmp_path: Path) -> None:
    sweep.main(arguments(tmp_path, trials=1, more="--seeds 3"))
    (trial,) = trials(tmp_path / "out")
    folder = sweep.trial_directory(tmp_path / "out", 0)
    configs = [load(TrainConfig, folder / f"seed-{i}" / "config.yaml") for i in range(3)]
    assert [config.seed for config in configs] == [0, 1, 2]
    assert trial.value == pytest.approx(sum(map(quality, configs)) / 3)


def test_a_trial_that_diverges_does_not_end_the_sweep(
    quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(training: Any, reporter: Any, interrupt: Any) -> Any:
        if training.directory.name == "trial_0000":
            raise loop.TrainingError("a loss is not finite")
        return stand_in(training, reporter)

    monkeypatch.setattr(loop, "run", wrong)
    assert sweep.main(arguments(tmp_path, trials=2)) == 0
    assert trials(tmp_path / "out")[0].user_attrs["reason"] == "a loss is not finite"


@pytest.mark.parametrize("moved", [True, False])
def test_a_sweep_whose_folder_goes_says_so(
    quick: None,
    moved: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"

    def remove_folder(training: Any, reporter: Any, interrupt: Any) -> Any:
        out.rename(tmp_path / "elsewhere") if moved else shutil.rmtree(out)
        return stand_in(training, reporter)

    monkeypatch.setattr(loop, "run", remove_folder)
    assert sweep.main(arguments(tmp_path, trials=2)) == 1
    said = capsys.readouterr().err
    assert f"error: {out} has been moved or deleted" in said
    assert f"--resume --out {out}" in said
    assert not out.exists()
    if moved:
        (tmp_path / "elsewhere").rename(out)
        monkeypatch.setattr(loop, "run", stand_in)
        assert sweep.main(["--resume", "--out", str(out), "--quiet"]) == 0


def test_an_interrupted_trial_is_repeated_on_resume(
    quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt_third(training: Any, reporter: Any, interrupt: Any) -> Any:
        if training.directory.name == "trial_0002":
            interrupt.waits_for("something")
            signal.raise_signal(signal.SIGINT)
            while not interrupt.requested:
                time.sleep(0.01)
            return SimpleNamespace(finished=False)
        return stand_in(training, reporter)

    monkeypatch.setattr(loop, "run", interrupt_third)
    out = tmp_path / "out"
    assert sweep.main(arguments(tmp_path, trials=4)) == 130
    printed = capsys.readouterr().out
    assert f"--resume --out {out}" in printed
    assert "2 of 4 trials: " in printed and ", 1 interrupted" in printed
    monkeypatch.setattr(loop, "run", stand_in)
    assert sweep.main(["--resume", "--out", str(out), "--quiet"]) == 0
    # The trial that was cut counts no more.
    printed = capsys.readouterr().out
    assert "4 of 4 trials: " in printed and "fail" not in printed
    assert len(json.loads((out / "sweep.json").read_text())["trials"]) == 4
    found = trials(out)
    assert found[3].params == found[2].params
    assert sum(trial.state.name in ("COMPLETE", "PRUNED") for trial in found) == 4
    # More trials may be asked for, and nothing else.
    assert sweep.main(["--resume", "--out", str(out), "--quiet", "--trials", "5"]) == 0
    assert len(trials(out)) == 6
    with pytest.raises(ConfigError, match="--seeds cannot change"):
        parse(["--resume", "--out", str(out), "--seeds", "2"])
    with pytest.raises(ConfigError, match="add --resume"):
        parse(arguments(tmp_path))


def test_a_sweep_that_is_cut_at_once_says_what_is_missing(
    quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(training: Any, reporter: Any, interrupt: Any) -> Any:
        interrupt.waits_for("something")
        signal.raise_signal(signal.SIGINT)
        while not interrupt.requested:
            time.sleep(0.01)
        return SimpleNamespace(finished=False)

    monkeypatch.setattr(loop, "run", interrupted)
    assert sweep.main(arguments(tmp_path, trials=4)) == 130
    printed = capsys.readouterr().out
    assert "0 of 4 trials: 1 interrupted" in printed
    assert "no trial is complete: best.yaml comes with the first" in printed


PROGRAM = """\
import sys, time
sys.path[:0] = [{tests!r}, {root!r}]
import test_sweep
from types import SimpleNamespace
from rlcas_jax import finish, loop
from rlcas_jax.sweep import run as sweep

def run(training, reporter, interrupt):
    if training.directory.name == "trial_0002":
        print("in the middle", flush=True)
        time.sleep(60)
    return test_sweep.stand_in(training, reporter)

loop.prepare = lambda config, directory: SimpleNamespace(config=config, directory=directory)
loop.run, finish.finish = run, test_sweep.evaluate
sweep.main(sys.argv[1:])
"""


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_killed_sweep_goes_on_with_the_killed_trial(tmp_path: Path) -> None:
    program = PROGRAM.format(tests=str(Path(__file__).parent), root=str(ROOT))
    command = [sys.executable, "-c", program, *arguments(tmp_path, "killed", trials=4)]
    resume = ["--resume", "--out", str(tmp_path / "killed"), "--quiet"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "in the middle\n"
            with pytest.raises(ConfigError, match="is in use by process"):
                sweep.main(resume)
        finally:
            process.kill()
    assert sweep.main(resume) == 0
    found = trials(tmp_path / "killed")
    assert found[2].state.name == "FAIL"
    assert found[3].params == found[2].params
    assert len(found) == 5


@pytest.mark.slow
@pytest.mark.long
def test_a_search_with_real_trainings(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "rlcas_jax.sweep", *arguments(tmp_path, trials=2)]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (sweep.trial_directory(tmp_path / "out", 0) / "policy.safetensors").exists()
