"""The benchmark of the tracker flies what it says, and its peers are filters."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest

from benchmarks import stone_soup, tracking
from benchmarks.tracking import Flights, Track
from commands.command import InputError
from envs import compiled

ERRORS = 30.0, 3.0
needs_stone_soup = pytest.mark.skipif(
    not stone_soup.installed(),
    reason=f"Stone Soup is not installed; to have it: {stone_soup.INSTALL}",
)


@pytest.fixture(scope="module", name="flights")
def _flights() -> Flights:
    return tracking.draw(12, 100, ERRORS, 3)


def test_flights_go_straight_turn_once_and_go_straight(flights: Flights) -> None:
    turning = flights.rates != 0.0
    assert (np.diff(turning.astype(int), axis=0) == 1).sum(axis=0).tolist() == [1] * 12
    assert not turning[:20].any()
    course = np.unwrap(flights.states.heading, axis=0)
    np.testing.assert_allclose(np.diff(course, axis=0), flights.rates[1:], atol=1e-7)
    off = tracking.vectors(flights.reports) - tracking.vectors(flights.states)
    assert np.std(off[..., ::2]) == pytest.approx(ERRORS[0], rel=0.1)
    assert np.std(off[..., 1::2]) == pytest.approx(ERRORS[1], rel=0.1)


def test_ours_is_better_than_the_reports(flights: Flights) -> None:
    figures = tracking.figures("ours", tracking.ours(flights), flights)
    reported = tracking.reported_errors(flights)
    assert figures["ours_straight_position_m"] < 0.4 * reported["reports_position_m"]
    assert figures["ours_straight_velocity_m_s"] < 0.4 * reported["reports_velocity_m_s"]
    assert figures["ours_turn_velocity_m_s"] < reported["reports_velocity_m_s"]
    assert figures["ours_sees_share"] > 0.9
    in_use = compiled.in_use()
    assert set(tracking.our_times(flights)) == {
        "ours_arrays_report_us",
        "ours_arrays_100_aircraft_ms",
        "ours_floats_report_us",
        *(["ours_compiled_report_us"] if compiled.may_compile() else []),
    }
    assert compiled.in_use() is in_use


def test_figures_are_those_of_the_errors(flights: Flights) -> None:
    true = tracking.vectors(flights.states)
    covariance = np.broadcast_to(np.diag([9.0, 1.0, 9.0, 1.0]), (*true.shape, 4))
    turning = flights.rates != 0.0
    late = np.roll(turning, 3, axis=0) & turning
    off = np.array([3.0, 0.0, 4.0, 1.0])
    figures = tracking.figures("x", Track(true + off, covariance, late), flights)
    assert figures["x_turn_position_m"] == pytest.approx(5.0)
    assert figures["x_straight_velocity_m_s"] == pytest.approx(1.0)
    assert figures["x_turn_nees"] == pytest.approx(25.0 / 9.0 + 1.0)
    assert figures["x_sees_median_s"] == 4.0
    assert figures["x_sees_share"] == 1.0 and figures["x_imagines_share"] == 0.0


def test_its_last_line_is_one_object() -> None:
    command = [sys.executable, "-m", "benchmarks.tracking", "--flights", "4", "--seconds", "60"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    found = json.loads(run.stdout.splitlines()[-1])
    assert found["benchmark"] == "tracking" and found["flights"] == 4
    assert found["ours_floats_report_us"] > 0.0


@pytest.mark.skipif(stone_soup.installed(), reason="Stone Soup is installed")
def test_a_missing_peer_is_named() -> None:
    with pytest.raises(InputError, match="--peer: Stone Soup is not installed; to have it: pip"):
        stone_soup.require()


@pytest.mark.slow
@needs_stone_soup
@pytest.mark.parametrize("name", tracking.PEERS)
def test_a_peer_is_as_exact_as_ours(name: str, flights: Flights) -> None:
    track, seconds = tracking.theirs(tracking.PEERS[name](*ERRORS), flights, name)
    figures = tracking.figures("x", track, flights)
    ours = tracking.figures("x", tracking.ours(flights), flights)
    for quantity in ("straight_position_m", "straight_velocity_m_s", "turn_position_m"):
        assert figures[f"x_{quantity}"] == pytest.approx(ours[f"x_{quantity}"], rel=0.25)
    assert figures["x_sees_share"] > 0.9
    assert 0.0 < seconds < 1.0


@needs_stone_soup
def test_models_follow_each_other_by_chances() -> None:
    for make in tracking.PEERS.values():
        filter_ = make(*ERRORS)
        known = stone_soup.begin(filter_, np.array([0.0, 80.0, 0.0, 0.0]), 0.0)
        assert known.shares.sum() == pytest.approx(1.0)
        for second in range(1, 4):
            report = np.array([80.0 * second, 80.0, 0.0, 0.0])
            known = stone_soup.extend(filter_, known, report, float(second))
        assert known.shares.sum() == pytest.approx(1.0)
        answer = stone_soup.answer(filter_, known)
        assert math.hypot(answer.mean[0] - 240.0, answer.mean[2]) < 1.0
        assert answer.turns < 0.3
