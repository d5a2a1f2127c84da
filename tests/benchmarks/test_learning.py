"""The comparison of learning curves counts alike for every learner, and goes on where it was
stopped.
"""

import json
import math
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from agents.config.load import ConfigError, dump, load
from benchmarks.learning import run as learning
from benchmarks.learning import training as learning_run
from benchmarks.learning.curves import (
    WINDOW,
    Episodes,
    Point,
    Times,
    Windows,
    ratio,
    score_at,
    t_mean,
    time_to_score,
)
from benchmarks.learning.training import Log
from benchmarks.learning.trials import PEERS_BEST, Trial, best, describe, settings, with_setting
from rlcas_jax import task
from rlcas_jax.config import TrainConfig
from tests.benchmarks.test_benchmarks import SHAPED

SETS = [argument for key in SHAPED for argument in ("--set", key)]


def curve(*scores: float, step: int = 100, wall_s: float = 2.0) -> list[Point]:
    return [Point(step * (i + 1), wall_s * (i + 1), score, 10) for i, score in enumerate(scores)]


@given(
    st.lists(st.tuples(st.integers(1, 50), st.integers(0, 4)), min_size=1, max_size=40),
    st.integers(1, 200),
)
def test_windows_lose_no_step_no_second_and_no_episode(made: list[tuple[int, int]], least: int):
    windows, points = Windows(least), []
    for steps, episodes in made:
        point = windows.add(Episodes(steps, -100.0 * episodes, episodes), 0.5)
        points += [] if point is None else [point]
    points.append(windows.finish())
    assert points[-1].steps == sum(steps for steps, _ in made)
    assert points[-1].wall_s == 0.5 * len(made)
    assert sum(point.episodes for point in points) == sum(episodes for _, episodes in made)
    assert all(
        point.score == -100.0 if point.episodes else math.isnan(point.score) for point in points
    )
    ends = [0, *(point.steps for point in points[:-1])]
    assert all(later - sooner >= least for sooner, later in pairwise(ends))


def test_the_score_of_a_window_does_not_depend_on_how_its_episodes_fall_into_updates():
    whole, parts = Windows(100), Windows(100)
    one = whole.add(Episodes(100, 100.0 * 6 - 10.0 - 100.0, 8), 4.0)
    for _ in range(3):
        assert parts.add(Episodes(25, 200.0, 2), 1.0) is None
    assert parts.add(Episodes(25, -110.0, 2), 1.0) == one


# What is read off curves


def test_time_to_a_score_lies_between_the_windows_by_a_straight_line():
    run = curve(-100.0, math.nan, 60.0, 80.0, 70.0, 90.0)
    assert time_to_score(run, 75.0, "wall_s") == pytest.approx(6.0 + 2.0 * 15.0 / 20.0)
    assert time_to_score(run, 75.0, "steps") == pytest.approx(375.0)
    assert time_to_score(run, 80.0, "wall_s") == 8.0
    assert time_to_score(run, 85.0, "wall_s") == pytest.approx(10.0 + 2.0 * 15.0 / 20.0)
    assert time_to_score(run, -20.0, "wall_s") == pytest.approx(2.0 + 4.0 * 80.0 / 160.0)
    assert time_to_score(run, -150.0, "wall_s") == 2.0
    assert time_to_score(run, 90.5, "wall_s") is None
    assert time_to_score([], 75.0, "wall_s") is None


@given(
    st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=12),
    st.floats(-100.0, 100.0),
    st.floats(0.0, 50.0),
)
def test_a_higher_score_is_never_reached_sooner(scores: list[float], score: float, more: float):
    run = curve(*scores)
    low, high = time_to_score(run, score, "wall_s"), time_to_score(run, score + more, "wall_s")
    assert (low is None) == (max(scores) < score)
    if high is not None:
        assert low is not None
        assert low <= high + 1e-9


def test_score_at_a_place_is_that_of_the_episodes_of_its_last_share():
    run = [Point(100 * i, float(i), float(i), i) for i in range(1, 101)]
    assert score_at(run, 10_000, "steps") == pytest.approx(
        np.average(range(96, 101), weights=range(96, 101))
    )
    assert score_at(run, 50.5, "wall_s", tail=0.001) == 50.0
    assert math.isnan(score_at(run, 0.5, "wall_s"))


def test_intervals_are_students_and_welchs():
    values = [1.0, 2.5, 3.0, 7.0]
    expected = stats.t.interval(0.95, 3, np.mean(values), stats.sem(values))
    assert t_mean(values) == pytest.approx((np.mean(values), *expected))
    assert math.isnan(t_mean([1.0]).low)
    theirs, ours = (
        Times((310.0, 280.0, 350.0), (400.0,) * 3),
        Times((60.0, 75.0, 58.0, 66.0), (100.0,) * 4),
    )
    test = stats.ttest_ind(
        np.log(theirs.seeds), np.log(ours.seeds), equal_var=False
    ).confidence_interval()
    found = ratio(theirs, ours)
    assert (found.low, found.high) == pytest.approx((math.exp(test.low), math.exp(test.high)))
    assert found.value == pytest.approx(stats.gmean(theirs.seeds) / stats.gmean(ours.seeds))
    back = ratio(ours, theirs)
    assert (1.0 / back.high, 1.0 / back.low) == pytest.approx((found.low, found.high))


def test_a_seed_that_does_not_come_to_a_score_leaves_a_bound_and_no_mean():
    logs = {
        "ours": [learning_run.Log({}, tuple(curve(0.0, 80.0, 90.0)), 1.0, "steps")] * 2,
        "sb3": [
            learning_run.Log({}, tuple(curve(0.0, 50.0, 80.0, wall_s=8.0)), 1.0, "steps"),
            learning_run.Log({}, tuple(curve(0.0, 50.0, 60.0, wall_s=8.0)), 1.0, "steps"),
        ],
        "sbx": [learning_run.Log({}, tuple(curve(-100.0, wall_s=8.0)), 1.0, "diverged")] * 2,
    }
    found = learning.summary(logs)
    theirs = found["learners"]["sb3"]["time_to_75_s"]
    first = time_to_score(curve(0.0, 50.0, 80.0, wall_s=8.0), 75.0, "wall_s")
    assert first is not None
    assert theirs["reached"] == 1
    assert theirs["value"] is None
    assert theirs["at_least"] == pytest.approx(math.sqrt(first * 24.0))
    ours = found["learners"]["ours"]["time_to_75_s"]
    assert ours["value"] == ours["low"] == pytest.approx(2.0 + 2.0 * 75.0 / 80.0)
    figure = found["ratios"]["sb3"]["time_to_75"]
    assert figure["met"] is None
    assert figure["at_least"] == pytest.approx(theirs["at_least"] / ours["value"])
    # What diverged does not shorten the comparison, and its place is empty.
    assert found["equal_steps"] == 300
    assert found["learners"]["sbx"]["score_after_equal_steps"]["seeds"] == 0
    json.dumps(found, allow_nan=False)


# Settings


def test_every_learner_tries_the_same_valid_settings_whatever_their_number():
    config = load(TrainConfig, Path("configs/sprint.yaml"))
    many = settings(config, 12)
    assert settings(config, 5) == many[:5]
    keys = config.model_dump()
    assert many[0] == {key: (keys | keys["ppo"])[key] for key in many[0]}
    assert many[1] == many[0] | PEERS_BEST
    assert len({json.dumps(setting) for setting in many}) == 12
    for setting in many:
        assert with_setting(config, setting, 3).samples <= 131_072
        assert with_setting(config, setting, 3).seed == 3
    assert settings(config, 0) == []


# Stopping and going on


def run_in_this_process(
    learner: str, config: Path, seconds: float, out: Path, until: float | None
) -> None:
    learning_run.train(learner, load(TrainConfig, config), seconds, out, out.stem, until)


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "_process", run_in_this_process)


SMALLEST = [
    "--steps",
    "640",
    "--trials",
    "0",
    "--set",
    "network.hidden=[8]",
    "--set",
    "ppo.epochs=1",
]


def arguments(out: Path, *more: str) -> list[str]:
    return [*SETS, "--config", "configs/sprint.yaml", "--learner", "ours", "--out", str(out), *more]


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_ours_goes_on_after_a_kill_with_the_same_curve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    built: dict[str, Any] = {}
    build = task.build

    def build_once(config: TrainConfig) -> Any:
        text = dump(config)
        if text not in built:
            built[text] = build(config)
        return built[text]

    monkeypatch.setattr(task, "build", build_once)  # compiled once
    options = arguments(tmp_path, "--seeds", "1", *SMALLEST)
    assert learning.main(options) == 0
    whole = json.loads(capsys.readouterr().out.splitlines()[-1])
    path = tmp_path / "runs" / "ours-seed0.jsonl"
    before = learning_run.read(path)
    # A kill leaves a run without its end and in the middle of a line.
    path.write_bytes(path.read_bytes()[:-25])
    half = learning_run.read(path)
    assert half is not None
    assert half.ended is None
    assert learning.main(options) == 0
    again = json.loads(capsys.readouterr().out.splitlines()[-1])
    after = learning_run.read(path)
    assert before is not None
    assert after is not None
    assert after.ended == "steps"
    assert [point._replace(wall_s=0.0) for point in after.curve] == [
        point._replace(wall_s=0.0) for point in before.curve
    ]
    assert (
        again["learners"]["ours"]["score_after_equal_steps"]
        == whole["learners"]["ours"]["score_after_equal_steps"]
    )
    assert again["ratios"] == {}
    table = pq.read_table(tmp_path / "curves.parquet").to_pydict()
    assert table["steps"] == [640]
    assert table["episodes"][0] > 0
    assert {"learning.png", "learning.svg", "summary.json"} <= {
        file.name for file in tmp_path.iterdir()
    }


def fake_process(made: list[str], stop_after: int | None = None):
    """Return a stand-in for a process that writes a run of two windows, the better the larger the
    learning rate.
    """

    def process(learner: str, config: Path, seconds: float, out: Path, until: float | None) -> None:
        score = 1e4 * load(TrainConfig, config).learning_rate
        lines = [{"learner": learner, "seconds": seconds, "until": until}, {"startup_s": 1.0}]
        lines += [point._asdict() for point in curve(0.0, score, 90.0)]
        if stop_after is not None and len(made) == stop_after:
            out.write_text("".join(json.dumps(line) + "\n" for line in lines))
            raise KeyboardInterrupt
        made.append(out.stem)
        out.write_text("".join(json.dumps(line) + "\n" for line in [*lines, {"ended": "steps"}]))

    return process


def test_trials_choose_the_setting_and_none_is_made_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    options = [
        "--config",
        "configs/sprint.yaml",
        "--trials",
        "4",
        "--seeds",
        "2",
        "--learner",
        "ours",
    ]
    made: list[str] = []
    monkeypatch.setattr(learning, "_process", fake_process(made, stop_after=3))
    with pytest.raises(KeyboardInterrupt):
        learning.main([*options, "--out", str(tmp_path)])
    monkeypatch.setattr(learning, "_process", fake_process(made))
    learning.main([*options, "--out", str(tmp_path)])
    assert made == ["ours-0", "ours-1", "ours-2", "ours-3", "ours-seed0", "ours-seed1"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    config = load(TrainConfig, tmp_path / "runs" / "ours-seed1.yaml")
    # The last window alone, which is the same for all, is within the last fifth: the first of the
    # best is taken.
    assert (
        summary["settings"]["ours"]
        == settings(load(TrainConfig, Path("configs/sprint.yaml")), 1)[0]
    )
    assert (config.seed, config.steps) == (1, 5_000_000)
    learning.main([*options, "--out", str(tmp_path)])
    assert len(made) == 6
    with pytest.raises(ConfigError, match="made with other options"):
        learning.main([*options, "--out", str(tmp_path), "--trial-seconds", "3"])


def trial(setting: float, *curves: list[Point], ended: str = "score") -> Trial:
    """Return a trial of 20 s with a run for each curve."""
    return Trial(
        {"epochs": setting},
        tuple(Log({"seconds": 20.0}, tuple(points), 1.0, ended) for points in curves),
    )


def test_the_best_trial_is_the_soonest_of_those_whose_seeds_all_come_to_the_score():
    slow = trial(1, curve(0.0, 80.0), curve(0.0, 80.0))
    soon = trial(2, curve(60.0, 90.0), curve(60.0, 90.0))
    once = trial(3, curve(79.0, 79.0), curve(0.0, 70.0), ended="time")
    assert best([slow, soon, once], 75.0) == soon.setting
    assert best([slow, once], 75.0) == slow.setting
    assert best([once, slow, slow], None) == slow.setting
    lost = trial(4, curve(0.0, 99.0), ended="diverged")
    assert best([lost, once], None) == once.setting
    said = describe(once, 75.0)
    assert said["time_to_75_s"][1] is None
    assert said["ended"] == ["time", "time"]


def test_trials_may_be_judged_by_the_time_to_a_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    made: list[str] = []
    monkeypatch.setattr(learning, "_process", fake_process(made))
    options = [
        "--config",
        "configs/sprint.yaml",
        "--learner",
        "ours",
        "--seeds",
        "1",
        "--out",
        str(tmp_path),
    ]
    options += ["--trials", "3", "--trial-seeds", "2"]
    learning.main([*options, "--trial-target", "8"])
    assert made == [f"ours-{number}{seed}" for number in range(3) for seed in ("", "-seed1")] + [
        "ours-seed0"
    ]
    summary = json.loads((tmp_path / "summary.json").read_text())
    times = [tried["time_to_8_s"] for tried in summary["trials"]["ours"]]
    soonest = min(range(3), key=lambda number: times[number][0])
    chosen = settings(load(TrainConfig, Path("configs/sprint.yaml")), 3)[soonest]
    assert summary["settings"]["ours"] == chosen
    assert chosen["learning_rate"] == max(
        tried["learning_rate"] for tried in summary["trials"]["ours"]
    )
    with pytest.raises(ConfigError, match="made with other options"):
        learning.main([*options, "--trial-target", "9"])


class Rising:
    """A learner that flies a window an update, 10 points better each time."""

    def __init__(self) -> None:
        self.score = 0.0

    def start(self) -> None:
        self.score = 0.0

    def update(self) -> Episodes:
        self.score += 10.0
        return Episodes(WINDOW, 100 * self.score, 100)


@pytest.mark.parametrize(
    ("until", "ended", "windows"), [(None, "steps", 5), (25.0, "score", 3), (99.0, "steps", 5)]
)
def test_a_training_ends_at_its_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, until: float | None, ended: str, windows: int
):
    monkeypatch.setattr(learning_run, "side", lambda *_: Rising())
    monkeypatch.setattr(learning_run, "updates", lambda _: 5)
    path = tmp_path / "run.jsonl"
    learning_run.train("ours", load(TrainConfig, None), 600.0, path, "run", until)
    log = learning_run.read(path)
    assert log is not None
    assert (log.ended, len(log.curve)) == (ended, windows)


def test_a_process_that_fails_ends_with_status_1_and_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(
        learning.subprocess, "run", lambda *a, **k: subprocess.CompletedProcess([], 3)
    )
    assert learning.main(arguments(tmp_path, "--trials", "0")) == 1
    assert "ended with status 3; the same command goes on" in capsys.readouterr().err


@pytest.mark.slow
def test_ours_killed_for_good_goes_on(tmp_path: Path):
    command = [
        sys.executable,
        "-m",
        "benchmarks.learning",
        *arguments(tmp_path, *SMALLEST),
    ]
    command += ["--seeds", "2"]
    second = tmp_path / "runs" / "ours-seed1.jsonl"
    with subprocess.Popen(command, start_new_session=True) as process:
        until = time.monotonic() + 240.0
        while not second.exists() and time.monotonic() < until:
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGKILL)
    first = (tmp_path / "runs" / "ours-seed0.jsonl").read_bytes()
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "ours-seed0: done before" in done.stdout
    assert (tmp_path / "runs" / "ours-seed0.jsonl").read_bytes() == first
    assert json.loads(done.stdout.splitlines()[-1])["learners"]["ours"]["ended"] == [
        "steps",
        "steps",
    ]


def test_a_file_that_is_no_run_is_refused(tmp_path: Path):
    (tmp_path / "a.jsonl").write_text("steps, wall_s\n")
    with pytest.raises(ConfigError, match="no file of a run"):
        learning_run.read(tmp_path / "a.jsonl")
    (tmp_path / "a.jsonl").write_text('{"steps": 3}\n')
    with pytest.raises(ConfigError, match="no file of a run"):
        learning_run.read(tmp_path / "a.jsonl")
    assert learning_run.read(tmp_path / "b.jsonl") is None


def test_places_that_cannot_be_written_to_are_refused(tmp_path: Path):
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(ConfigError, match="expected a directory to write to"):
        learning.main(["--out", str(file)])
    with pytest.raises(ConfigError, match="there is no directory"):
        learning_run.main(
            [
                "--learner",
                "ours",
                "--config",
                "configs/sprint.yaml",
                "--out",
                str(tmp_path / "no" / "run"),
            ]
        )
