"""Profiles: straight between corners, and flown by an aircraft that changes its climb gently."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.profile import (
    Height,
    Profile,
    climbing,
    corner_error,
    first_change,
    first_corner,
    height_flown,
    levelling,
    profile_of,
)
from envs.waypoints import Waypoint

STEP = 0.01  # s


def add_up(profile: Profile, acceleration: float, until: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the times, s, and the altitudes, m, of an aircraft on a profile: its climb, added up
    from small steps, changes evenly about each corner.
    """
    times = np.arange(0.0, until, STEP)
    climb = np.full(times.size, profile.climbs[0])
    for corner in profile.corners():
        half = 0.5 * abs(corner.change) / acceleration
        begun = np.clip(times + 0.5 * STEP - (corner.time - half), 0.0, 2.0 * half)
        climb += np.sign(corner.change) * acceleration * begun
    moved = np.concatenate([[0.0], np.cumsum(climb * STEP)[:-1]])
    return times, profile.altitude[0] + moved


@given(st.floats(-10.0, 10.0), st.floats(-300.0, 300.0), st.floats(5.0, 60.0), st.floats(0.3, 4.0))
def test_the_first_change_of_climb_leads_to_the_first_altitude(
    climb: float, rise: float, time: float, acceleration: float
) -> None:
    change = first_change(rise, climb, time, acceleration)
    if math.isnan(change):
        # Even an acceleration all the time does not suffice.
        assert abs(rise - climb * time) > 0.5 * acceleration * time * time * (1.0 - 1e-12)
        return
    corner = first_corner(change, acceleration)
    assert 0.0 <= corner <= 0.5 * time + 1e-9
    risen = climb * corner + (climb + change) * (time - corner)
    assert risen == pytest.approx(rise, abs=1e-6)
    # With the climb changing evenly for twice as long it is the same.
    half = 0.5 * math.copysign(acceleration, change) * (2.0 * corner) ** 2
    evenly = climb * time + half + change * (time - 2.0 * corner)
    assert evenly == pytest.approx(rise, abs=1e-6)


@given(st.lists(st.floats(-80.0, 80.0), min_size=2, max_size=6), st.floats(-4.0, 4.0))
def test_an_aircraft_leaves_a_profile_by_what_its_corners_say(
    rises: list[float], climb: float
) -> None:
    acceleration = 1.0
    times = [20.0 * (leg + 1) for leg in range(len(rises))]
    altitudes = (1_000.0 + np.cumsum(rises)).tolist()
    profile = climbing(1_000.0, climb, times, altitudes, acceleration=acceleration)
    assert profile.at(np.array(times)) == pytest.approx(altitudes, abs=1e-6)
    seconds, height = add_up(profile, acceleration, times[-1])
    changes = [abs(corner.change) for corner in profile.corners()]
    most = max((corner_error(change, acceleration) for change in changes), default=0.0)
    off = np.abs(height - profile.at(seconds))
    assert off.max() <= most + 0.02
    halves = [0.5 * change / acceleration for change in changes]
    near = np.zeros(seconds.size, dtype=bool)
    for corner, half in zip(profile.corners(), halves, strict=True):
        near |= np.abs(seconds - corner.time) <= half + STEP
    assert off[~near].max(initial=0.0) <= 0.02


def test_a_profile_is_flown_as_small_steps_of_its_climb_add_up() -> None:
    profile = climbing(
        1_000.0, 1.5, [20.0, 40.0, 60.0], [1_080.0, 1_080.0, 1_000.0], acceleration=1.0
    )
    times, altitudes = add_up(profile, 1.0, 60.0)
    height = height_flown(profile, 1.0, times)
    assert height.altitude == pytest.approx(altitudes, abs=0.05)
    assert height.climb[:-1] == pytest.approx(np.diff(altitudes) / STEP, abs=0.02)
    # One time alone, as several.
    assert height_flown(profile, 1.0, times[700]) == (height.altitude[700], height.climb[700])


@pytest.mark.parametrize("climb", [-4.0, 0.0, 2.5])
def test_an_aircraft_levels_off_at_once_and_evenly(climb: float) -> None:
    times = np.array([0.0, 0.5 * abs(climb), abs(climb), 60.0])
    height = height_flown(levelling(Height(1_000.0, climb), 1.0), 1.0, times)
    assert height.climb == pytest.approx([climb, 0.5 * climb, 0.0, 0.0], abs=1e-9)
    assert height.altitude[0] == pytest.approx(1_000.0, abs=1e-9)
    assert height.altitude[2:] == pytest.approx(1_000.0 + 0.5 * climb * abs(climb), abs=1e-9)


def test_a_profile_is_the_same_seen_from_its_waypoints_and_later() -> None:
    profile = climbing(500.0, 1.0, [20.0, 60.0, 100.0], [560.0, 560.0, 400.0], acceleration=1.0)
    times = np.arange(20.0, 101.0, 20.0)
    points = [
        Waypoint(n, 0.0, 0.0, 0.0, 50.0, time, altitude, 0.0)
        for n, (time, altitude) in enumerate(
            zip(times.tolist(), profile.at(times).tolist(), strict=True)
        )
    ]
    again = profile_of(500.0, 1.0, points, 1.0)
    assert again is not None
    moments = np.linspace(0.0, 120.0, 241)
    np.testing.assert_allclose(again.at(moments), profile.at(moments), atol=1e-9)
    later = profile.since(30.0)
    np.testing.assert_allclose(later.at(moments - 30.0), profile.at(moments), atol=1e-9)


def test_waypoints_without_altitudes_have_no_profile_and_half_of_them_are_refused() -> None:
    plain = [Waypoint(n, 0.0, 0.0, 0.0, 50.0, 20.0 * n) for n in (1, 2)]
    assert profile_of(500.0, 0.0, plain, 1.0) is None
    half = [plain[0], Waypoint(2, 0.0, 0.0, 0.0, 50.0, 40.0, 500.0, 0.0)]
    with pytest.raises(ValueError, match="1 of 2 waypoints have altitudes"):
        profile_of(500.0, 0.0, half, 1.0)
    with pytest.raises(ValueError, match="cannot be reached in 2 s"):
        climbing(500.0, 0.0, [2.0, 20.0], [600.0, 600.0], acceleration=1.0)


@given(st.floats(1e-12, 1e-2), st.floats(-5.0, 5.0))
def test_a_small_first_change_has_a_corner_that_can_be_flown(change: float, climb: float) -> None:
    first = 500.0 + (climb + change) * 20.0
    profile = climbing(500.0, climb, [20.0, 40.0], [first, first], acceleration=0.5)
    corners = list(profile.corners())
    halves = [first_corner(corner.change, 0.5) for corner in corners]
    changed = 0.0
    for corner, half in zip(corners, halves, strict=True):
        assert corner.time - half >= changed - 1e-6
        changed = corner.time + half
