"""Predictions are held against the reports that came, and manoeuvres are told apart."""

import math

import numpy as np
import pytest

from benchmarks.prediction import believe, figures, grid, predictions
from envs.traffic.tracks import Track


def track(rate: float, seconds: int = 120) -> Track:
    """Return a flight at 80 m/s that turns after a minute."""
    time = np.arange(float(seconds))
    course = rate * np.maximum(time - 60.0, 0.0)
    vx, vy = 80.0 * np.cos(course), 80.0 * np.sin(course)
    zero = 0.0 * time
    return Track("one", time, np.cumsum(vx), np.cumsum(vy), zero, vx, vy, zero, {})


def found(*tracks: Track, ahead: float = 30.0) -> dict[str, float]:
    reports = grid(list(tracks))
    return figures(predictions(reports, believe(reports), ahead))


def test_straight_flight_is_where_it_was_predicted() -> None:
    # One flight is shorter than the other: what it lacks is no prediction.
    flown = found(track(0.0), track(0.0, seconds=70))
    assert flown["predictions"] == 90 + 40
    assert (flown["coverage"], flown["manoeuvred"]) == (1.0, 0.0)
    assert flown["sigma_median_m"] == pytest.approx(math.hypot(378.0, 30 * 1.23), rel=0.01)


def test_what_turns_later_is_told_apart() -> None:
    flown = found(track(math.radians(3.0)), ahead=60.0)
    assert 0.9 < flown["manoeuvred"] < 1.0
    assert flown["coverage_flown_on"] == 1.0
    assert flown["coverage"] < 0.8
    assert flown["misses_of_manoeuvres"] == 1.0
