"""The grid's value must be right where the answer is known, and both answers must never contradict
each other.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.config.load import ConfigError, load
from agents.resolvability.classify import Verdict
from commands.command import run_cli
from envs.aircraft import PAPER
from envs.kinematics import Limits
from eval.boundary import run as boundary
from eval.boundary.config import BoundaryConfig
from eval.boundary.grid import Solution, edge_value, make_grid, solve, value_at
from eval.boundary.slices import (
    Answers,
    Slice,
    best_separation,
    compare,
    encounters_at,
    judge,
    values_at,
)

SEPARATION, SURROGATE = PAPER.separation, PAPER.limits
TURNS_ONLY = Limits(50.0, 50.0, -0.5, 0.5, math.radians(3.0))
RADIUS = 50.0 / math.radians(3.0)
HEAD_ON = Slice("head-on", 75.0, 75.0, math.pi)


def solve_grid(limits: Limits, intruder_speed: float, dt: float, cell: float) -> Solution:
    return solve(
        make_grid(limits, intruder_speed, SEPARATION, dt, cell), limits, intruder_speed, SEPARATION
    )


@pytest.fixture(scope="module")
def coarse() -> Solution:
    return solve_grid(SURROGATE, 75.0, 5.0, 120.0)


@pytest.fixture(scope="module")
def fine() -> Solution:
    return solve_grid(SURROGATE, 75.0, 5.0, 60.0)


def states(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places of the ownship around the intruder, its x axis along the intruder's course."""
    return tuple(np.random.default_rng(0).uniform(-3_000.0, 4_000.0, (2, count)))


def test_a_point_at_rest_is_missed_by_the_turning_circle():
    # An aircraft that heads for a point d ahead and turns at once comes no nearer than sqrt(d^2 +
    # r^2) - r.
    ahead = np.array([1_300.0, 1_500.0, 1_700.0, 1_900.0])
    exact = np.hypot(ahead, RADIUS) - RADIUS
    errors = []
    for dt, cell in ((5.0, 60.0), (2.5, 30.0)):
        solution = solve_grid(TURNS_ONLY, 0.0, dt, cell)
        errors.append(np.max(np.abs(value_at(solution, -ahead, 0.0 * ahead, 0.0, 50.0) - exact)))
    assert errors[0] < 1.0
    assert errors[1] < 0.6 * errors[0]
    flown = best_separation(50.0, 0.0, 0.0, ahead, 0.0 * ahead, TURNS_ONLY, 60.0)
    np.testing.assert_allclose(flown, exact, atol=0.1)


@pytest.mark.slow
def test_nobody_keeps_more_than_there_is(fine: Solution):
    distance = np.hypot(fine.grid.x[:, None], fine.grid.y)
    assert (fine.value <= distance * (1.0 + 1e-6)).all()
    assert fine.value.min() >= 0.0
    assert fine.change < 0.1
    # An aircraft that has the intruder behind and flies away keeps what there is.
    away = value_at(fine, np.array([-1_200.0]), np.array([0.0]), -math.pi, 75.0)
    assert away == pytest.approx([1_200.0])


@pytest.mark.slow
def test_no_lost_state_touches_the_edge(coarse: Solution):
    assert edge_value(coarse) > 1.1 * SEPARATION
    assert edge_value(solve_grid(SURROGATE, 150.0, 5.0, 120.0)) > 1.1 * SEPARATION


@pytest.mark.parametrize("heading", [0.3, 1.0, math.pi / 2.0, 3.1])
def test_the_mirror_image_has_the_same_value(fine: Solution, heading: float):
    x, y = states(500)
    left, right = value_at(fine, x, y, heading, 72.0), value_at(fine, x, -y, -heading, 72.0)
    np.testing.assert_allclose(left, right, atol=1e-3)


def test_wider_limits_keep_more(coarse: Solution):
    # Wider limits, the same nodes of speed and heading.
    braking = solve_grid(SURROGATE._replace(acceleration_min=-0.1), 75.0, 5.0, 120.0)
    assert (coarse.value >= braking.value - 2.0).all()  # speeds between nodes are rounded
    assert (coarse.value > braking.value + 20.0).any()


def test_a_similar_aircraft_keeps_the_same_share(coarse: Solution):
    # Twice the lengths and times, the same speeds.
    limits = SURROGATE._replace(
        acceleration_min=-0.25, acceleration_max=0.25, yaw_rate_max=math.radians(1.5)
    )
    grid = make_grid(limits, 75.0, 2.0 * SEPARATION, 10.0, 240.0)
    np.testing.assert_allclose(
        solve(grid, limits, 75.0, 2.0 * SEPARATION).value, 2.0 * coarse.value, rtol=1e-4
    )


def test_the_value_grows_as_the_range_opens(fine: Solution):
    ahead = np.arange(200.0, 4_000.0, 50.0)
    value = values_at(fine, HEAD_ON, ahead, 0.0 * ahead)
    assert (np.diff(value) >= -1e-3).all()
    assert value[0] < 200.0
    assert value[-1] > SEPARATION


@pytest.mark.parametrize("course_deg", [180.0, 90.0, -90.0, 30.0, 0.0])
@pytest.mark.parametrize("own_speed", [50.0, 75.0, 100.0])
def test_the_value_is_that_of_the_best_flight(fine: Solution, own_speed: float, course_deg: float):
    cut = Slice("any", own_speed, 75.0, math.radians(course_deg))
    x, y = states(4_000)
    value = values_at(fine, cut, x, y)
    near = np.flatnonzero((np.abs(value - SEPARATION) < 100.0) & (np.hypot(x, y) > SEPARATION))[:24]
    assert near.size > 10
    flown = best_separation(own_speed, cut.heading, 75.0, x[near], y[near], SURROGATE, 50.0)
    assert (value[near] - flown).min() > -3.0
    assert (value[near] - flown).max() < 9.0


def test_slices_mirror_each_other(fine: Solution):
    x, y = states(200)
    left, right = (
        values_at(fine, Slice("", 75.0, 75.0, sign * math.pi / 2), x, sign * y)
        for sign in (1.0, -1.0)
    )
    np.testing.assert_allclose(left, right, atol=1e-3)
    # A positive course difference: from the left.
    assert encounters_at(Slice("", 75.0, 75.0, math.pi / 2), x, y, PAPER).intruders.heading[
        0, 0
    ] == pytest.approx(-math.pi / 2)


@pytest.fixture(scope="module")
def answers(fine: Solution, coarse: Solution) -> Answers:
    return judge(HEAD_ON, fine, coarse, 500.0, PAPER)


def test_both_answers_agree(answers: Answers):
    figures = compare(answers, SEPARATION, 500.0)
    assert sum(figures["disagreements"].values()) == 0
    assert figures["grid_error_m"] < 5.0
    assert figures["resolvable"] > 30
    assert figures["unresolvable"] > 30
    assert (
        figures["points"] == figures["resolvable"] + figures["unresolvable"] + figures["undecided"]
    )
    assert figures["greatest_unresolvable_excess_m"] < figures["grid_error_m"]
    assert figures["least_resolvable_excess_m"] > -figures["grid_error_m"]
    assert figures["unavoidable_area_km2"] == pytest.approx(
        figures["unresolvable_area_km2"], rel=0.25
    )


def test_a_contradiction_would_be_counted(answers: Answers):
    wrong = answers._replace(
        verdict=np.where(
            answers.verdict == Verdict.RESOLVABLE, Verdict.UNRESOLVABLE, Verdict.RESOLVABLE
        )
    )
    assert min(compare(wrong, SEPARATION, 500.0)["disagreements"].values()) > 30


@pytest.mark.slow
def test_the_program_writes_figures_and_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "new" / "boundary"
    arguments = ["--slice", "100", "0", "45", "--spacing", "500", "--grid", "coarse"]
    assert boundary.main([*arguments, "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {
        "boundary.json",
        "boundary.png",
        "boundary.svg",
        "config.yaml",
    }
    written = json.loads((out / "boundary.json").read_text(encoding="utf-8"))
    assert [part["course_difference_deg"] for part in written["slices"]] == pytest.approx([45.0])
    assert written["disagreements"] == 0
    assert "0 disagreements" in capsys.readouterr().out
    config = load(BoundaryConfig, out / "config.yaml")
    assert config == BoundaryConfig(slices=((100.0, 0.0, 45.0),), spacing=500.0, grid="coarse")


@pytest.mark.slow
def test_an_interrupted_check_goes_on_from_its_slices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    whole, out = tmp_path / "whole", tmp_path / "out"
    arguments = ["--slice", "100", "0", "45", "--slice", "60", "0", "0", "--spacing", "500"]
    arguments += ["--grid", "coarse"]
    assert boundary.main([*arguments, "--out", str(whole)]) == 0
    judged: list[float] = []

    def stop_at_the_second(cut: Slice, *rest_of_arguments: Any) -> Answers:
        if len(judged) == 1:
            raise KeyboardInterrupt
        judged.append(cut.own_speed)
        return judge(cut, *rest_of_arguments)

    monkeypatch.setattr(boundary, "judge", stop_at_the_second)
    with pytest.raises(KeyboardInterrupt):
        boundary.main([*arguments, "--out", str(out)])
    assert f"Go on with: python -m eval.boundary --resume --out {out}" in capsys.readouterr().err
    judged.append(0.0)  # nothing stops it now
    assert boundary.main(["--resume", "--out", str(out)]) == 0
    assert judged == [100.0, 0.0, 60.0]
    for name in ("boundary.svg", "boundary.png", "config.yaml"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()
    written = [json.loads((item / "boundary.json").read_text("utf-8")) for item in (out, whole)]
    for item in written:
        del item["wall_s"]
    assert written[0] == written[1]
    assert {path.name for path in out.iterdir()} == {path.name for path in whole.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--resume"], "holds no run (no config.yaml)"),
        (["--slice", "40", "75", "180"], "own speed of slice 1 is 40 m/s; expected 50 to 100 m/s"),
        (
            ["--slice", "75", "200", "180"],
            "intruder's speed of slice 1 is 200 m/s; expected 0 to 150 m/s",
        ),
        (["--slice", "75", "75", "270"], "course difference of slice 1 is 270 degrees"),
        (["--slice", "75", "nan", "0"], "--slice: nan; expected -10000 to 10000"),
        (["--slice", "75", "75"], "expected 3 arguments"),
        (["--spacing", "1"], "--spacing: 1 m; expected 20 to 500 m"),
        (["--grid", "huge"], "invalid choice: 'huge'"),
        (["--aircraft", "nowhere.yaml"], "nowhere.yaml"),
        (["--out", __file__], "holds something already"),
    ],
)
def test_bad_input_ends_with_one_sentence(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = [] if "--out" in arguments else ["--out", str(tmp_path / "out")]
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: boundary.main([*out, *arguments]))
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_step_must_divide_a_half_turn():
    with pytest.raises(ValueError, match="dt is 7 s; expected a whole part of a half turn of 60 s"):
        make_grid(SURROGATE, 75.0, SEPARATION, 7.0, 100.0)


def test_where_to_write_must_be_said():
    with pytest.raises(ConfigError, match="--out"):
        boundary.main([])
