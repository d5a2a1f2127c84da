"""Recorded tracks at times between their rows: positions and velocities agree with each other."""

import math

import numpy as np
import pytest

from envs.traffic.tracks import Track, at_times


def track(time: np.ndarray, place: np.ndarray, velocity: np.ndarray) -> Track:
    """Return a level track of complex positions and velocities."""
    zero = 0.0 * time
    return Track(
        "one",
        time,
        np.real(place),
        np.imag(place),
        zero,
        np.real(velocity),
        np.imag(velocity),
        zero,
        {},
    )


def turn(every: float, rate: float = math.radians(3.0), speed: float = 80.0) -> Track:
    """Return a turn to the left with a row every so many seconds."""
    time = np.arange(0.0, 121.0, every)
    course = np.exp(1j * rate * time)
    return track(time, -1j * speed / rate * course, speed * course)


def test_a_turn_between_rows_far_apart_is_flown_as_a_turn() -> None:
    times = np.arange(0.0, 119.0, 0.5)
    flown = at_times(turn(20.0), times)
    assert np.hypot(flown.x, flown.y) == pytest.approx(80.0 / math.radians(3.0), rel=0.01)
    assert np.hypot(flown.vx, flown.vy) == pytest.approx(80.0, rel=0.05)
    lack = np.diff(flown.x) / 0.5 - 0.5 * (flown.vx[1:] + flown.vx[:-1])
    assert abs(lack).max() < 0.2


def test_rows_stay_as_they_are() -> None:
    flown = turn(20.0)
    interpolated = at_times(flown, flown.time)
    for name in ("x", "y", "vx", "vy"):
        assert (getattr(interpolated, name) == getattr(flown, name)).all()
    only = track(np.array([5.0]), np.array([3.0 + 4.0j]), np.array([1.0 + 0.0j]))
    assert at_times(only, np.array([5.0, 5.0])).x.tolist() == [3.0, 3.0]


def test_a_track_that_begins_between_rows_flies_the_same_curve() -> None:
    flown, times = turn(20.0), np.arange(33.0, 60.0)
    later = at_times(flown, np.concatenate([[33.0], flown.time[flown.time > 33.0]]))
    for field, later_field in zip(
        at_times(flown, times)[2:8], at_times(later, times)[2:8], strict=True
    ):
        assert field == pytest.approx(later_field, abs=1e-6)


def test_what_nothing_could_fly_changes_along_straight_lines() -> None:
    # 30 m too far within a second, as receivers' clocks make it.
    jumps = track(
        np.array([0.0, 1.0]), np.array([0.0, 110.0 + 0.0j]), np.array([80.0, 80.0 + 0.0j])
    )
    middle = at_times(jumps, np.array([0.25, 0.5]))
    assert middle.x.tolist() == [27.5, 55.0]
    assert middle.vx.tolist() == [80.0, 80.0]
