"""Whether the altitude of a plan can be flown, and stays between floor and ceiling."""

import math
from collections.abc import Sequence

import numpy as np

from agents.kernel.levels import Altitude
from agents.planner.answer import Kind, Reason
from agents.planner.request.options import L, Options
from envs.arrays import Array, Float, Shaped
from envs.frames import Air
from envs.kinematics import Limits
from envs.profile import Profile, corner_error, first_corner, profile_of
from envs.waypoints import Legs, Waypoint

_ROUNDING = 1e-6
"""By how much limits may be passed for rounding's sake, m, m/s and s."""


def flyable_profile(waypoints: Sequence[Waypoint], own: Altitude, options: Options[L]) -> Profile:
    """Return the profile that waypoints are flown on from an altitude, whose vertical speed is
    known.

    Raises:
        ValueError: they have no altitudes, or these cannot be flown.
    """
    acceleration = options.vertical.acceleration
    profile = profile_of(own.value, own.climb(0.0)[0], waypoints, acceleration)
    if profile is None:
        raise ValueError("the waypoints have no altitudes")
    faults = profile_faults(profile, own, options)
    if faults:
        raise ValueError(": ".join(fault.message for fault in faults))
    return profile


def profile_faults(profile: Profile, own: Altitude, options: Options[L]) -> list[Reason]:
    """Return what is wrong with a profile.

    A change of climb by r at an acceleration a takes r / (2 a) before its corner and after it, and
    leaves the profile by r^2 / (8 a): so far corners lie apart and from the request, and so much
    the vertical margin holds at least. The climb at the request is what it is, such as in a gust;
    it is kept for no longer than its change takes.

    Args:
        profile: it begins at the request.
        own: altitude at the request, with its error.
        options: of the flight.
    """
    vertical, faults = options.vertical, list[Reason]()
    first = int(_changes_at_once(profile, vertical.acceleration))
    times, climbs = profile.time.tolist()[first:-1], profile.climbs.tolist()[first:]
    for time, climb in zip(times, climbs, strict=True):
        if not -vertical.descent_max - _ROUNDING <= climb <= vertical.climb_max + _ROUNDING:
            text = (
                f"climbs with {climb:.2f} m/s from {time:.1f} s on, expected "
                f"{-vertical.descent_max:g} to {vertical.climb_max:g} m/s"
            )
            faults.append(Reason.of(Kind.CLIMB, "altitudes", text))
    changed = 0.0
    for corner in profile.corners():
        half = 0.5 * abs(corner.change) / vertical.acceleration
        if not corner.time - half >= changed - _ROUNDING:
            text = (
                f"change their climb at {corner.time:.1f} s, expected {changed + half:.1f} s or "
                "later"
            )
            faults.append(Reason.of(Kind.CLIMB, "altitudes", text))
        error = corner_error(corner.change, vertical.acceleration)
        if not error <= options.vertical_margin + _ROUNDING:
            text = (
                f"are left by {error:.1f} m where the climb changes at {corner.time:.1f} s, "
                f"expected the vertical margin, {options.vertical_margin:g} m, at most"
            )
            faults.append(Reason.of(Kind.CLIMB, "altitudes", text))
        changed = corner.time + half
    return faults + _beyond_levels(profile, own, options)


def _changes_at_once(profile: Profile, acceleration: float) -> bool:
    """Return whether the change of the climb at the request begins then, at an acceleration,
    m/s^2.
    """
    if profile.climbs.size < 2:
        return False
    lead = first_corner(float(profile.climbs[1] - profile.climbs[0]), acceleration)
    return bool(profile.time[1] - profile.time[0] <= lead + _ROUNDING)


def speed_faults(profile: Profile, curves: Legs[Air], limits: Limits) -> list[Reason]:
    """Return where an aircraft is too fast on a profile first; arguments as
    :func:`exceeds_speed`.
    """
    beyond = np.flatnonzero(exceeds_speed(profile, curves, limits))
    if beyond.size == 0:
        return []
    leg = int(beyond[0])
    climb, over_horizon, fastest = _speeds(profile, curves, limits)
    text = (
        f"climbs with {climb[leg]:.1f} m/s at {over_horizon[leg]:.1f} m/s over the horizon, "
        f"expected {fastest:.1f} m/s together at most"
    )
    return [Reason(Kind.SPEED, f"waypoints[{leg}]", f"the leg to waypoints[{leg}] {text}")]


def exceeds_speed(profile: Profile, curves: Legs[Air], limits: Limits) -> Shaped[Array, " L"]:
    """Return on which legs an aircraft is too fast on a profile, bool: with the speed along it, not
    that over the horizon.

    Args:
        profile: it begins at the request.
        curves: legs of one plan through the air, ``[L]``.
        limits: of the flight; a plan that begins faster may stay so.
    """
    climb, over_horizon, fastest = _speeds(profile, curves, limits)
    return ~(np.hypot(over_horizon, climb) <= fastest + _ROUNDING)


def _speeds(
    profile: Profile, curves: Legs[Air], limits: Limits
) -> tuple[Float[Array, " L"], Float[Array, " L"], float]:
    """Return the steepest climb and the greatest speed over the horizon on legs, and how much both
    may be together, m/s.
    """
    begin, end = curves.time, curves.time + curves.duration
    climbs = profile.climbs
    # Of each leg against each line of the profile that it has a part of.
    last = np.append(profile.time[1:-1], np.inf)
    first = np.append(-np.inf, profile.time[1:-1])
    shared = (begin[:, None] < last) & (end[:, None] > first)
    climb = np.where(shared, np.abs(climbs), 0.0).max(axis=1)
    step = curves.duration[:, None] / curves.speed.shape[-1]
    over_horizon = np.maximum(curves.speed, curves.speed + curves.acceleration * step).max(axis=1)
    fastest = max(limits.speed_max, math.hypot(curves.speed[0, 0], climbs[0]))
    return climb, over_horizon, fastest


def _beyond_levels(profile: Profile, own: Altitude, options: Options[L]) -> list[Reason]:
    """Return where a profile, flown within the margin, may leave the floor or the ceiling."""
    faults, spread = list[Reason](), own.error + options.vertical_margin
    for name, level, side in (("floor", options.floor, -1.0), ("ceiling", options.ceiling, 1.0)):
        if level is None:
            continue
        # At the request the ownship is where it is; from there on it does not go farther.
        begins = side * (profile.altitude[0] - level.value)
        over = side * (profile.altitude - level.value)
        allowed = np.maximum(-spread, begins)
        beyond = np.flatnonzero(~(over <= allowed + _ROUNDING))
        if beyond.size:
            first = int(beyond[0])
            text = (
                f"are {profile.altitude[first]:.1f} m at {profile.time[first]:.1f} s, expected to "
                f"keep {spread:.1f} m from the {name}, {level.value:g} m"
            )
            faults.append(Reason.of(Kind.CLIMB, "altitudes", text))
    return faults
