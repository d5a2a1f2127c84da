"""The hyper-parameter search: a strict space, repeatable trials, and nothing lost by a kill.

Most tests put a stand-in for the training, which is tested by itself; the slow ones train.
"""

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pyarrow import parquet

from agents.config.load import ConfigError, dump, load
from rlcas_jax import finish, loop, metrics
from rlcas_jax.config import TrainConfig
from rlcas_jax.sweep import run as sweep
from rlcas_jax.sweep.cli import parse
from rlcas_jax.sweep.figures import sweep_figures
from rlcas_jax.sweep.study import JOURNAL

ROOT = Path(__file__).resolve().parents[2]
TINY = """\
name: tiny
steps: 5120
network: {hidden: [4]}
ppo: {environments: 16, rollout: 16, minibatch: 64, segment: 8, epochs: 1}
pool_rows: 2
scenarios: [{name: circle}, {name: head_on}]
evaluation: {every_steps: 1280, encounters: 4, final_encounters: 8}
checkpoint: {every_seconds: 0.0}
"""
SPACE = """\
ppo.learning_rate: {low: 1e-5, high: 1e-1, log: true}
ppo.minibatch: {choices: [32, 64]}
ppo.epochs: {low: 1, high: 4}
shaping.goal: {low: 0, high: 1, step: 0.25}
network.hidden: {choices: [[4], [4, 4]]}
scenarios.1.weight: {low: 0.1, high: 2.0}
"""


def quality(config: TrainConfig) -> float:
    """Return the stand-in's success: 1 at a learning rate of 1e-3, falling to both sides."""
    return math.exp(-abs(math.log10(config.ppo.learning_rate) + 3.0)) - 0.01 * (config.seed - 5)


def stand_in(config: TrainConfig, directory: Path, reporter: Any, *, resume: bool = False) -> Any:
    """Report four evaluations, as a training does."""
    reporter.start(total_steps=config.steps)
    for number in range(1, 5):
        found = quality(config) * number / 4
        row = {"step": number * config.evaluation.every_steps, "steps_per_s": 1.0, "score": math.nan}
        reporter.update(row | {"eval_success": found, "eval_score": 100.0 * found})
    reporter.stop()
    return SimpleNamespace(config=config, directory=directory, finished=True)


def judged(run: Any) -> dict[str, Any]:
    found = quality(run.config)
    summary = {"finished": True, "evaluation": {"success_given_resolvable": found, "score_mean": 100.0 * found}}
    (run.directory / "summary.json").write_text(json.dumps(summary))
    return summary


@pytest.fixture
def drawing(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Put the stand-in in the place of the training, and the signal handlers back afterwards."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    monkeypatch.setattr(loop, "run", stand_in)
    monkeypatch.setattr(finish, "finish", judged)
    monkeypatch.setattr(
        sweep, "gc", SimpleNamespace(collect=int)
    )  # there is nothing to collect, and looking takes time
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def quick(drawing: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Besides, draw no figures."""
    monkeypatch.setattr("rlcas_jax.sweep.figures.sweep_figures", lambda *_: [])


def arguments(folder: Path, out: str = "out", space: str = SPACE, trials: int = 6, more: str = "") -> list[str]:
    for name, text in (("tiny.yaml", TINY), ("space.yaml", space)):
        (folder / name).write_text(text)
    given = f"--config {folder / 'tiny.yaml'} --space {folder / 'space.yaml'} --out {folder / out}"
    given += "" if "--trials" in more else f" --trials {trials}"
    return [*given.split(), "--quiet", "--startup", "3", *more.split()]


def trials(out: Path) -> list[dict[str, Any]]:
    """Return the table's rows without what depends on the clock."""
    rows = parquet.read_table(out / "trials.parquet").to_pylist()
    return [{name: value for name, value in row.items() if name != "wall_s"} for row in rows]


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("ppo.learning_rat: {low: 1, high: 2}", "ppo.learning_rat is unknown; did you mean ppo.learning_rate?"),
        ("learning_rate: {low: 1e-4, high: 1e-3}", "did you mean ppo.learning_rate?"),
        ("ppo.learning_rate: {low: 1e-4, high: 1e-3, lg: true}", "lg is unknown; did you mean log?"),
        ("ppo.learning_rate: {low: 1e-4, high: 2}", "space.yaml: ppo.learning_rate is 2.0; expected a number above 0"),
        ("ppo.learning_rate: {low: 1e-3, high: 1e-4}", "expected less than high, 0.0001"),
        ("ppo.learning_rate: {low: 1e-3}", "ppo.learning_rate.high is null; expected a number"),
        ("ppo.learning_rate: {low: 1e-3, high: .inf}", "high is inf; expected a number"),
        ("ppo.learning_rate: {low: 1e-3, high: 1e-2, log: 1}", "log is 1; expected true or false"),
        ("ppo.entropy: {low: 0, high: 1e-2, log: true}", "expected low above 0 and no step"),
        ("ppo.epochs: {low: 1.5, high: 3}", "ppo.epochs.low is 1.5; expected a whole number"),
        ("shaping.goal: {low: 0, high: 1, step: 0.3}", "expected a whole part of high less low"),
        ("ppo.minibatch: {choices: [64, 96]}", "ppo.minibatch is 96; expected a divisor of environments times rollout"),
        ("ppo.minibatch: {choices: [64]}", "expected a list of at least 2 values"),
        ("ppo.minibatch: {choices: [64, 64]}", "expected every value once"),
        ("ppo.minibatch: [64, 128]", r"is \[64, 128\]; expected {low, high} or {choices}"),
        ("network.feature_set: {low: 1, high: 2}", "network.feature_set is no number"),
        ("network.feature_set: {choices: [cpa, nome]}", "did you mean none?"),
        ("scenarios.0.name: {choices: [circle, cirkle]}", "did you mean circle?"),
        ("scenarios.5.weight: {low: 1, high: 2}", "'5' is no item of a list of 2"),
        ("seed: {low: 1, high: 2}", "seed cannot be searched"),
        ("evaluation.separation: {low: 900, high: 1000}", "cannot be searched"),
        ("ppo: {choices: [1, 2]}", "ppo is 1; expected"),
        ("", "it names no key"),
        ("a: {low: 1, low: 2}", "key low stands twice"),
    ],
)
def test_a_space_that_is_not_usable_is_refused_in_a_sentence(entry: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        parse(arguments(tmp_path, space=entry))
    assert not (tmp_path / "out").exists()


def test_rewards_can_be_searched_only_where_they_are_not_the_objective(tmp_path: Path) -> None:
    space = "world.reward_timeout: {low: -50, high: -10}"
    parse(arguments(tmp_path, space=space))
    with pytest.raises(ConfigError, match="on equal terms"):
        parse(arguments(tmp_path, space=space, more="--objective score"))


def test_a_value_that_is_valid_only_with_some_others_is_taken(tmp_path: Path) -> None:
    space = "ppo.minibatch: {choices: [64, 512]}\nppo.environments: {choices: [16, 32]}"
    assert len(parse(arguments(tmp_path, space=space)).space) == 2


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("--trials 0", "--trials is 0; expected at least 1"),
        ("--seeds 0", "--seeds is 0; expected at least 1"),
        ("--timeout 0", "--timeout is 0.0; expected a number of seconds above 0"),
        ("--objective speed", "invalid choice: 'speed'"),
        ("--set ppo.clap=1", "did you mean ppo.clip?"),
        ("--resume", "there is no such directory"),
    ],
)
def test_a_bad_option_is_refused(more: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        parse(arguments(tmp_path, more=more))


def test_the_example_is_a_space_of_the_quick_configuration() -> None:
    given = "--config configs/quick.yaml --space configs/sweep_quick.yaml --trials 1 --out runs/none-such"
    options = parse([str(ROOT / word) if word.startswith("configs/") else word for word in given.split()])
    assert "ppo.learning_rate" in [parameter.key for parameter in options.space]


@pytest.mark.usefixtures("quick")
def test_the_same_seed_makes_the_same_trials_and_another_one_others(tmp_path: Path) -> None:
    for out, seed in (("a", 0), ("b", 0), ("c", 1)):
        assert sweep.main(arguments(tmp_path, out, more=f"--sampler-seed {seed}")) == 0
    assert trials(tmp_path / "a") == trials(tmp_path / "b")
    assert trials(tmp_path / "a") != trials(tmp_path / "c")


@pytest.mark.usefixtures("drawing")
def test_a_sweep_leaves_what_is_promised(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert sweep.main(arguments(tmp_path, trials=12, more="--no-pruning")) == 0
    shown = capsys.readouterr().out
    rows = trials(out)
    best = max(rows, key=lambda row: row["value"])
    report = json.loads((out / "sweep.json").read_text())
    assert report["finished"] and report["states"] == {"complete": 12}
    assert report["best"]["trial"] == best["trial"]
    assert sum(report["importance"].values()) == pytest.approx(1.0)
    # The best configuration is that of its trial, and both are read by the strict configuration.
    found = load(TrainConfig, out / "best.yaml")
    assert found == load(TrainConfig, sweep.trial_directory(out, best["trial"]) / "config.yaml")
    assert found.ppo.learning_rate == best["ppo.learning_rate"]
    assert dump(load(TrainConfig, out / "config.yaml")) == dump(load(TrainConfig, tmp_path / "tiny.yaml"))
    for name in ("history", "slices"):
        assert (out / "figures" / f"{name}.png").stat().st_size > 5_000
        assert (out / "figures" / f"{name}.svg").exists()
    assert shown.splitlines()[1].split()[0] == str(best["trial"])  # best first
    assert f"best: trial {best['trial']}" in shown and "best.yaml" in shown


@pytest.mark.usefixtures("quick")
def test_the_search_finds_a_better_place_than_its_first_draws(tmp_path: Path) -> None:
    space = "ppo.learning_rate: {low: 1e-7, high: 1e-1, log: true}"
    sweep.main(arguments(tmp_path, space=space, trials=20, more="--no-pruning"))
    values = [row["value"] for row in trials(tmp_path / "out")]
    assert max(values) > max(values[:3])


@pytest.mark.usefixtures("quick")
def test_what_stays_below_the_median_is_stopped_early(tmp_path: Path) -> None:
    sweep.main(arguments(tmp_path, trials=12))
    rows = trials(tmp_path / "out")
    stopped = [row for row in rows if row["state"] == "pruned"]
    assert stopped and all(row["value"] is None and len(row["evaluations"]) < 4 for row in stopped)
    assert all(row["state"] == "complete" for row in rows[:3])
    assert not (sweep.trial_directory(tmp_path / "out", stopped[0]["trial"]) / "summary.json").exists()


@pytest.mark.usefixtures("quick")
def test_several_seeds_count_by_their_mean(tmp_path: Path) -> None:
    sweep.main(arguments(tmp_path, trials=2, more="--seeds 3 --objective score"))
    for row in trials(tmp_path / "out"):
        assert len(row["values"]) == 3
        assert row["value"] == pytest.approx(sum(row["values"]) / 3)
        folder = sweep.trial_directory(tmp_path / "out", row["trial"])
        assert [load(TrainConfig, folder / f"seed-{i}" / "config.yaml").seed for i in range(3)] == [0, 1, 2]


@pytest.mark.usefixtures("quick")
def test_a_small_space_is_used_up_without_repeating_a_trial(tmp_path: Path) -> None:
    assert sweep.main(arguments(tmp_path, space="ppo.minibatch: {choices: [32, 64]}", trials=5)) == 0
    assert len(trials(tmp_path / "out")) == 2
    assert json.loads((tmp_path / "out" / "sweep.json").read_text())["finished"]


def test_trials_that_go_wrong_do_not_end_the_sweep(
    quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(config: TrainConfig, directory: Path, reporter: Any, *, resume: bool = False) -> Any:
        if directory.name == "trial_0000":
            raise loop.TrainingError("a loss is not finite")
        if directory.name == "trial_0001":
            raise ConfigError("scenarios.0: too few draws")
        return stand_in(config, directory, reporter)

    monkeypatch.setattr(loop, "run", wrong)
    assert sweep.main(arguments(tmp_path, trials=3)) == 0
    assert [row["state"] for row in trials(tmp_path / "out")] == ["diverged", "failed", "complete"]
    assert trials(tmp_path / "out")[1]["reason"] == "failed: scenarios.0: too few draws"


def test_an_interrupted_sweep_says_how_to_go_on_and_equals_an_uninterrupted_one(
    quick: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep.main(arguments(tmp_path, "whole", trials=8))

    def interrupted(config: TrainConfig, directory: Path, reporter: Any, *, resume: bool = False) -> Any:
        if directory.name == "trial_0004":
            stand_in(config, directory, SimpleNamespace(start=reporter.start, stop=reporter.stop, update=once))
        return stand_in(config, directory, reporter)

    def once(row: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "run", interrupted)
    assert sweep.main(arguments(tmp_path, "cut", trials=8)) == 130
    assert f"--resume --out {tmp_path / 'cut'}" in capsys.readouterr().out
    assert trials(tmp_path / "cut")[4]["state"] == "unfinished"
    monkeypatch.setattr(loop, "run", stand_in)
    assert sweep.main(["--resume", "--out", str(tmp_path / "cut"), "--quiet"]) == 0
    assert trials(tmp_path / "cut") == trials(tmp_path / "whole")
    # More trials may be asked for, and the options may be given again if they say the same.
    assert sweep.main(arguments(tmp_path, "cut", trials=9, more="--resume")) == 0
    assert trials(tmp_path / "cut")[:8] == trials(tmp_path / "whole")
    with pytest.raises(ConfigError, match="--seeds differs"):
        parse(arguments(tmp_path, "cut", more="--resume --seeds 2"))
    with pytest.raises(ConfigError, match="another configuration"):
        parse(arguments(tmp_path, "cut", more="--resume --steps 9999"))
    with pytest.raises(ConfigError, match="add --resume"):
        parse(arguments(tmp_path, "cut"))


@pytest.mark.usefixtures("quick")
def test_a_sweep_out_of_time_goes_on_later(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sweep.main(arguments(tmp_path, more="--timeout 1e-6")) == 0
    assert "time is up: go on with" in capsys.readouterr().out
    assert not json.loads((tmp_path / "out" / "sweep.json").read_text())["finished"]
    assert sweep.main(["--resume", "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert len(trials(tmp_path / "out")) == 6


PROGRAM = """\
import sys, time
sys.path[:0] = [{tests!r}, {root!r}]
import test_sweep
from rlcas_jax import finish, loop
from rlcas_jax.sweep import run as sweep

def run(config, directory, reporter, *, resume=False):
    if directory.name == "trial_0002":
        reporter.start(total_steps=config.steps)
        reporter.update({{"step": 1280, "eval_success": test_sweep.quality(config) / 4}})
        print("in the middle", flush=True)
        time.sleep(60)
    return test_sweep.stand_in(config, directory, reporter)

loop.run, finish.finish = run, test_sweep.judged
sweep.main(sys.argv[1:])
"""


@pytest.mark.usefixtures("quick")
def test_nothing_is_lost_by_a_kill(tmp_path: Path) -> None:
    sweep.main(arguments(tmp_path, "whole", trials=8))
    program = PROGRAM.format(tests=str(Path(__file__).parent), root=str(ROOT))
    command = [sys.executable, "-c", program, *arguments(tmp_path, "killed", trials=8)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "in the middle\n"
            with pytest.raises(ConfigError, match="another process is at work"):
                sweep.main(["--resume", "--out", str(tmp_path / "killed"), "--quiet"])
        finally:
            process.kill()
    with (tmp_path / "killed" / JOURNAL).open("a") as file:
        file.write('{"op_code":7,"worker')  # as a kill within a write leaves it
    assert sweep.main(["--resume", "--out", str(tmp_path / "killed"), "--quiet"]) == 0
    assert trials(tmp_path / "killed") == trials(tmp_path / "whole")


def test_without_a_complete_trial_there_is_no_figure(tmp_path: Path) -> None:
    assert sweep_figures([], (), "success", None, tmp_path / "figures") == []


@pytest.mark.slow
def test_a_killed_search_with_real_trainings_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "rlcas_jax.sweep"]

    def search(*given: str) -> str:
        done = subprocess.run([*program, *given], cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    search(*arguments(tmp_path, "whole", trials=3, more="--steps 25600"))
    killed = tmp_path / "killed"
    process = subprocess.Popen([*program, *arguments(tmp_path, "killed", trials=3, more="--steps 25600")], cwd=ROOT)
    log = sweep.trial_directory(killed, 1) / metrics.FILE
    deadline = time.monotonic() + 240
    while process.poll() is None and time.monotonic() < deadline:
        if len(metrics.read(log).get("update", ())) >= 10:
            break
        time.sleep(0.005)
    process.kill()
    process.wait()
    assert len(metrics.read(log)["update"]) < 100, "the trial ended before the kill: nothing was tested"
    search("--resume", "--out", str(killed), "--quiet")
    assert trials(killed) == trials(tmp_path / "whole")
    for number in range(3):
        one, other = (sweep.trial_directory(tmp_path / name, number) for name in ("killed", "whole"))
        assert (one / "policy.safetensors").read_bytes() == (other / "policy.safetensors").read_bytes()
