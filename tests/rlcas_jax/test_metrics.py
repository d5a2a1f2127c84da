"""What a run records, its figures, and phases that go on from one another."""

import json
import math
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, dump, load
from rlcas_jax import checkpoint, metrics
from rlcas_jax.config import TrainConfig
from rlcas_jax.figures import FIGURES, main, stretches, training_figures
from rlcas_jax.loop import Run, prepare, run
from rlcas_jax.metrics import FILE, METRICS, WALL_CLOCK, Writer, read
from rlcas_jax.progress import Reporter


def row(update: int, **more: float) -> dict[str, float]:
    return {
        "step": 128.0 * update,
        "update": update,
        "score": -1.0 / update,
        "wall_s": 0.1 * update,
        **more,
    }


def test_what_is_written_is_read_as_columns(tmp_path: Path):
    with Writer(tmp_path) as writer:
        writer.write(row(1, score=math.nan))
        writer.write(
            row(
                2,
                eval_success=0.5,
                loss=np.float32(0.1),
                entropy=jnp.float32(1.5),
                episodes=np.int64(3),
            )
        )
    log = read(tmp_path)
    np.testing.assert_array_equal(log["update"], [1.0, 2.0])
    np.testing.assert_array_equal(log["score"], [math.nan, -0.5])
    np.testing.assert_array_equal(log["eval_success"], [math.nan, 0.5])
    np.testing.assert_array_equal(log["loss"], [math.nan, 0.1])
    assert all(values.dtype == np.float64 for values in log.values())
    first, second = (tmp_path / FILE).read_text().splitlines()
    assert first == '{"step": 128, "update": 1, "score": null, "wall_s": 0.1}'
    assert json.loads(second)["episodes"] == 3


@pytest.mark.parametrize("value", [0.1, 1e300, 1e-300, -2.5e-8, 123456.789])
def test_numbers_keep_their_precision(tmp_path: Path, value: float):
    with Writer(tmp_path) as writer:
        writer.write(row(1, loss=value))
        writer.write(row(2, loss=float(np.float32(value)) if value < 1e30 else value))
    doubled, single = read(tmp_path)["loss"]
    assert doubled == value
    assert np.float32(single) == np.float32(value) if value < 1e30 else single == value


def test_lines_are_there_at_once(tmp_path: Path):
    with Writer(tmp_path) as writer:
        writer.write(row(1))
        assert len(read(tmp_path)["step"]) == 1


def test_a_half_written_line_is_left_out(tmp_path: Path):
    path = tmp_path / FILE
    path.write_text('{"step": 1, "update": 1}\n{"step": 2, "upd')
    assert read(path)["step"].tolist() == [1.0]


def test_nothing_logged_reads_as_nothing(tmp_path: Path):
    assert read(tmp_path) == {}


@pytest.mark.parametrize("torn", ["", '{"step": 640, "upd'])
def test_a_resumed_run_leaves_the_file_of_an_uninterrupted_one(tmp_path: Path, torn: str):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    with Writer(whole) as writer:
        for update in range(1, 7):
            writer.write(row(update))
    with Writer(parts) as writer:
        for update in range(1, 5):
            writer.write(row(update))
    with (parts / FILE).open("a") as file:
        file.write(torn)
    with Writer(parts, resume_update=3) as writer:
        for update in range(4, 7):
            writer.write(row(update))
    assert (parts / FILE).read_bytes() == (whole / FILE).read_bytes()


def test_a_new_run_begins_a_new_file(tmp_path: Path):
    for _ in range(2):
        with Writer(tmp_path) as writer:
            writer.write(row(1))
    assert len(read(tmp_path)["step"]) == 1


def test_a_metric_without_a_description_is_refused(tmp_path: Path):
    with Writer(tmp_path) as writer, pytest.raises(KeyError, match="metric 'magic' has no desc"):
        writer.write(row(1, magic=1.0))


def test_metrics_of_wall_clock_are_metrics():
    assert set(WALL_CLOCK) <= set(METRICS)


def test_tensorboard_gets_the_same_figures(tmp_path: Path):
    pytest.importorskip("tensorboardX")
    with Writer(tmp_path) as writer:
        writer.write(row(1, loss=0.5))
    with Writer(tmp_path, resume_update=1) as writer:
        writer.write(row(2, loss=math.nan))
    files = sorted((tmp_path / "tensorboard").iterdir())
    assert b"score" in b"".join(file.read_bytes() for file in files)
    assert len(read(tmp_path)["step"]) == 2


def test_without_tensorboard_nothing_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("rlcas_jax.metrics.find_spec", lambda name: None)
    with Writer(tmp_path) as writer:
        writer.write(row(1))
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


ROOT = Path(__file__).resolve().parents[2]
NAMES = {f"{name}.{kind}" for name in [*FIGURES, "training"] for kind in ("png", "svg")}


def log(directory: Path, seed: int = 0, updates: int = 20) -> Path:
    directory.mkdir()
    random = np.random.default_rng(seed)
    with Writer(directory) as writer:
        for update in range(1, updates + 1):
            learned = 1.0 - np.exp(-update / 5.0)
            row = {
                "step": 131_072 * update,
                "update": update,
                "episodes": 0 if update == 1 else 300 + update,
                # No episode has ended yet in the first update.
                "score": np.nan if update == 1 else -60.0 + 140.0 * learned + random.normal(),
                "success": np.nan if update == 1 else 0.2 + 0.7 * learned,
                "loss": 0.1 - 0.09 * learned,
                "entropy": 1.8 - 0.1 * update,
                "neg_log_prob": 1.8 - 0.1 * update,
            }
            writer.write(row | ({"eval_success": 0.95 * learned} if update % 8 == 0 else {}))
    return directory


@pytest.mark.slow
def test_every_figure_is_drawn_and_the_same_metrics_give_the_same_picture(tmp_path: Path):
    run = log(tmp_path / "run")
    one, other = (training_figures([run], tmp_path / name) for name in ("one", "other"))
    assert {file.name for file in one} == NAMES
    assert {file.name for file in (tmp_path / "one").iterdir()} == NAMES
    for file in one:
        assert file.read_bytes().startswith(b"\x89PNG" if file.suffix == ".png" else b"<?xml")
    assert [file.read_bytes() for file in one] == [file.read_bytes() for file in other]


@pytest.mark.slow
def test_seeds_of_different_length_go_into_one_figure(tmp_path: Path):
    runs = [log(tmp_path / str(seed), seed, updates) for seed, updates in enumerate((20, 12, 1))]
    assert len(training_figures([*runs, tmp_path / "not-begun"], tmp_path / "figures")) == len(
        NAMES
    )


@pytest.mark.slow
def test_a_short_run_can_be_drawn(tmp_path: Path):
    training_figures([log(tmp_path / "run", updates=1)], tmp_path / "figures")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "drawn"),
    [
        ("name: a", True),
        ("world: {separation_spread: 0.08}", True),
        ("aircraft: uas", False),
        ("rewards: {timeout: -100}", False),
        ("family: {share: 0.5}", False),
        (None, False),
    ],
)
def test_the_papers_score_stands_beside_runs_of_the_papers_task_alone(
    text: str | None, drawn: bool, tmp_path: Path
):
    run = log(tmp_path / "run")
    if text is not None:
        (run / "config.yaml").write_text(text, encoding="utf-8")
    training_figures([run], tmp_path / "figures")
    picture = (tmp_path / "figures/episode_reward.svg").read_text(encoding="utf-8")
    assert ("paper: +75" in picture) is drawn


def test_a_single_evaluation_says_its_value(tmp_path: Path):
    with Writer(tmp_path) as writer:
        for update in (1, 2, 3):
            more = {"eval_success": 0.987} if update == 3 else {}
            writer.write(row(update, success=0.5, episodes=4, **more))
    training_figures([tmp_path], tmp_path / "figures")
    assert "98.7 %" in (tmp_path / "figures/training.svg").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_command_draws_finished_runs_again(tmp_path: Path):
    main([str(log(tmp_path / "run")), "--out", str(tmp_path / "figures")])
    assert {file.name for file in (tmp_path / "figures").iterdir()} == NAMES
    with pytest.raises(ConfigError, match="absent: there is no such folder"):
        main([str(tmp_path / "absent"), "--out", str(tmp_path / "figures")])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="no metrics to draw"):
        main([str(tmp_path / "empty"), "--out", str(tmp_path / "figures")])


@pytest.mark.parametrize("count", [1, 399, 400, 401, 12_207])
def test_a_long_curve_is_drawn_by_means_that_keep_its_own(count: int):
    random = np.random.default_rng(count)
    steps, values, weights = (
        np.arange(1.0, count + 1),
        random.normal(size=count),
        random.integers(1, 90, count),
    )
    ends, means = stretches(steps, values, weights)
    assert len(ends) == len(means) <= 400
    assert ends[-1] == count
    shares = np.diff(np.concatenate([[0.0], np.cumsum(weights)[ends.astype(int) - 1]]))
    assert np.average(means, weights=shares) == pytest.approx(np.average(values, weights=weights))
    if count <= 400:
        np.testing.assert_array_equal(means, values)


def test_without_metrics_there_is_nothing_to_draw(tmp_path: Path):
    with pytest.raises(ConfigError, match="no metrics to draw in"):
        training_figures([tmp_path], tmp_path / "figures")


def test_what_is_drawn_is_logged():
    assert {metric for metric, _, _ in FIGURES.values()} <= set(METRICS)


def test_matplotlib_is_loaded_only_to_draw():
    program = "import sys, rlcas_jax.figures; assert 'matplotlib' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0


# Phases: parts of one training that differ in some keys, each going on with the networks of the one
# before.

TINY = """\
name: tiny
network: {hidden: [8, 8]}
environments: 16
rollout: 16
ppo: {minibatch: 64, segment: 8, epochs: 1}
pool_rows: 2
evaluation: {every_steps: 1000000, encounters: 8, final_encounters: 16}
checkpoint: {every_seconds: 0.0}
phases:
  - steps: 5120
  - steps: 10240
    environments: 32
    discount: 0.9
    scenarios: [{name: multi}]
    world: {separation_spread: 0.05}
"""
UPDATES = 20 + 20


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "phases.yaml"
    path.write_text(TINY)
    return path


def train_in(config: TrainConfig, directory: Path) -> Run:
    directory.mkdir()
    return run(prepare(config, directory), Reporter(quiet=True))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, file: Path, share_programs: None) -> Run:
    return train_in(load(TrainConfig, file), tmp_path_factory.mktemp("runs") / "whole")


def rows(directory: Path) -> list[dict[str, float]]:
    """Return the logged rows without what depends on the clock."""
    logged = [json.loads(line) for line in (directory / metrics.FILE).read_text().splitlines()]
    return [
        {name: value for name, value in row.items() if name not in metrics.WALL_CLOCK}
        for row in logged
    ]


def test_each_phase_has_its_own_keys_and_the_common_ones(file: Path, tmp_path: Path) -> None:
    config = load(TrainConfig, file)
    first, second = config.phase_configs()
    assert (first.steps, first.environments, first.discount) == (5120, 16, 0.995)
    assert (second.steps, second.environments, second.discount) == (10240, 32, 0.9)
    assert second.rollout == first.rollout == 16
    assert [entry.name for entry in second.scenarios] == ["multi"]
    assert TrainConfig().phase_configs() == (TrainConfig(),)
    (tmp_path / "dump.yaml").write_text(dump(config))
    assert load(TrainConfig, tmp_path / "dump.yaml") == config


@pytest.mark.parametrize(
    ("phase", "said"),
    [
        ("{seed: 3}", r"phases\.0\.seed: expected one of steps, environments"),
        ("{ppo: {clipp: 3}}", r"phases\.0: ppo\.clipp is unknown .* did you mean ppo\.clip"),
        ("{ppo: {minibatch: 5}}", r"phases\.0: ppo\.minibatch is 5; expected a divisor"),
        ("{world: {vehicle: {speed_max_mps: 90}}}", r"phases\.0: world\.vehicle"),
        ("{ppo: 3}", r"phases\.0: ppo is 3; expected a group of keys"),
        ("3", r"phases\.0 is 3"),
    ],
)
def test_a_bad_phase_is_refused(phase: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load(TrainConfig, None, [f"phases=[{phase}]"])


@pytest.mark.slow
def test_steps_and_updates_are_counted_over_all_phases(whole: Run) -> None:
    log = metrics.read(whole.directory)
    np.testing.assert_array_equal(log["update"], np.arange(1, UPDATES + 1))
    np.testing.assert_array_equal(log["step"][[0, 19, 20, 39]], [256, 5120, 5120 + 512, 15360])
    assert whole.finished and whole.steps == 15360
    # The learning rate falls over each phase.
    assert log["learning_rate"][0] == log["learning_rate"][20] > log["learning_rate"][19]


@pytest.mark.slow
def test_a_phase_goes_on_with_the_networks_of_the_one_before(
    whole: Run, file: Path, tmp_path: Path
) -> None:
    """Its first update is that of a training of this phase alone that begins with them."""
    config = load(TrainConfig, file, ["phases.1.steps=512"])
    both = train_in(config, tmp_path / "both")
    first = load(TrainConfig, file).phase_configs()[0]
    alone = train_in(first, tmp_path / "first")
    assert rows(alone.directory) == rows(both.directory)[:20] == rows(whole.directory)[:20]
    second = prepare(config, tmp_path / "none").tasks[1]
    state = second.initial()
    state, _ = second.update(state._replace(learner=alone.state.learner))
    for mine, theirs in zip(jax.tree.leaves(state), jax.tree.leaves(both.state), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
@pytest.mark.parametrize("least", [5, 25])
def test_a_kill_in_either_phase_loses_nothing(
    whole: Run, file: Path, tmp_path: Path, least: int
) -> None:
    killed = tmp_path / "killed"
    command = [sys.executable, "-m", "rlcas_jax.train", "--quiet"]
    process = subprocess.Popen([*command, "--config", str(file), "--out", str(killed)], cwd=ROOT)
    deadline = time.monotonic() + 1_200
    while time.monotonic() < deadline and process.poll() is None:
        if len(metrics.read(killed / metrics.FILE).get("update", ())) >= least:
            break
        time.sleep(0.002)
    process.kill()
    process.wait()
    done = len(metrics.read(killed / metrics.FILE)["update"])
    assert least <= done < UPDATES, "the run ended before it was killed: nothing was tested"
    again = run(prepare(load(TrainConfig, file), killed, resume=True), Reporter(quiet=True))
    assert rows(killed) == rows(whole.directory)
    for mine, theirs in zip(
        jax.tree.leaves(again.state), jax.tree.leaves(whole.state), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
    newest = [
        checkpoint.latest(directory / "checkpoints") for directory in (killed, whole.directory)
    ]
    assert newest[0].read_bytes() == newest[1].read_bytes()


def test_the_best_configuration_trains_one_policy_phase_configs() -> None:
    phases = load(TrainConfig, ROOT / "configs" / "best.yaml").phase_configs()
    assert len(phases) > 1
    assert {(phase.network, phase.family) for phase in phases} == {
        (phases[0].network, phases[0].family)
    }
