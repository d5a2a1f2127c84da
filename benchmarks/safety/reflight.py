"""SAFE plans as the follower flies them, on an integration of the kinematics of its own, checked
every 0.02 s.

What is shared with the planner: the contract of the legs (:mod:`envs.waypoints`) and the follower
itself.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.planner.options import default_margin
from agents.planner.request import Request
from agents.planner.traffic import Requirement, Traffic
from benchmarks.safety.resimulation import VehicleColumns, least_of, required_distances
from envs.aircraft import PAPER
from envs.follower import PERIOD, steer
from envs.kinematics import Limits, VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, at, legs

__all__ = ["Reflight", "refly"]

_MARGIN = default_margin(PAPER)
_ALLOWED = _MARGIN + 1e-2  # distance from the plan, m
_LOOK = 40.0  # m beyond what must be kept below which the parts of a period are looked at
_PARTS = np.linspace(0.0, PERIOD, 6)
_COMPRESS = 100  # periods between two looks at which have arrived


class Reflight(NamedTuple):
    """How plans were flown; fields ``[N]``."""

    separation: Any
    """Smallest distance to any intruder, m; inf without any."""
    error: Any
    """Largest distance from where the plan was at the time, m."""
    too_close: Any
    """Closer to an intruder than its separation, bool. Where less than that and the follower's
    default margin was asked for, or was there at the request, the margin less than that."""
    astray: Any
    """Farther from the plan than the follower's margin and 1 cm, bool."""


def refly(
    plan_states: PlanStates, request: Request, requirement: Requirement, limits: Limits
) -> Reflight:
    """Fly plans ``[N]`` from the request to their last waypoint; the intruders fly as predicted.

    Args:
        plan_states: of the plans, finite, ``[N, 21]``.
        request: what was asked, ``[N]``.
        requirement: what distance was asked for.
        limits: of the vehicle; a speed beyond them at the request may stay.
    """
    count = len(plan_states.time)
    separation, spare, error = np.full(count, np.inf), np.full(count, np.inf), np.zeros(count)
    traffic = request.traffic
    need = required_distances(request.own.x + 1j * request.own.y, traffic, requirement)
    floor = np.minimum(least_of(traffic, requirement), need - _MARGIN)  # of each intruder
    others = VehicleColumns(*(field[..., None] for field in (*traffic.state, *traffic[2:7])))
    rows, curves, mask = np.arange(count), legs(plan_states), traffic.mask
    ends = plan_states.time[:, -1]
    own = VehicleState(*(np.array(field, dtype=float) for field in request.own))
    now, period = at(curves, 0.0), 0
    while rows.size:
        time = period * PERIOD
        after = at(curves, time + PERIOD)
        acceleration, yaw_rate = steer(now, after, own)
        gain, rate = _command(own, acceleration, yaw_rate, limits)
        flight = _displacements(own, gain, rate, _PARTS)
        apart = np.abs(
            others.place(np.full((1, 1, 1), time)) - (own.x + 1j * own.y)[:, None, None]
        )[..., 0]
        # Beyond its last waypoint a plan promises nothing.
        flying = ends >= time + PERIOD
        counts = in_window(traffic, rows, time)
        apart = np.where(mask & flying[:, None] & counts, apart, np.inf)
        separation[rows] = np.minimum(separation[rows], np.min(apart, axis=1, initial=np.inf))
        least = np.min(apart - floor[rows], axis=1, initial=np.inf)
        spare[rows] = np.minimum(spare[rows], least)
        n, k = np.nonzero(apart < np.maximum(floor[rows], requirement.separation) + _LOOK)
        if n.size:
            place = flight[n] + (own.x + 1j * own.y)[n, None]
            away = VehicleColumns(*(field[n, k] for field in others)).place(time + _PARTS) - place
            closest = _closest(away)
            np.minimum.at(separation, rows[n], closest)
            np.minimum.at(spare, rows[n], closest - floor[rows[n], k])
        end = flight[:, -1]
        own = VehicleState(
            own.x + end.real,
            own.y + end.imag,
            own.heading + rate * PERIOD,
            own.speed + gain * PERIOD,
        )
        error[rows] = np.maximum(
            error[rows], np.where(flying, np.hypot(own.x - after.x, own.y - after.y), 0.0)
        )
        now, period = after, period + 1
        if period % _COMPRESS == 0:
            on = ends > period * PERIOD
            rows, curves, mask, ends, own, now, others = take(
                (rows, curves, mask, ends, own, now, others), on
            )
    return Reflight(separation, error, spare < -1e-3, error > _ALLOWED)


def in_window(traffic: Traffic, rows: Any, time: float) -> Any:
    """Return which intruders of some plans count at a time, s, bool ``[n, K]``."""
    if traffic.window is None:
        return True
    begin, end = (field[rows] for field in traffic.window)
    return (begin <= time) & (time <= end)


def _command(
    own: VehicleState, acceleration: Any, yaw_rate: Any, limits: Limits
) -> tuple[Any, Any]:
    """Return what the vehicle does of its commands, m/s^2 and rad/s, ``[n]``; it never leaves its
    speeds.
    """
    gain = np.clip(acceleration, limits.acceleration_min, limits.acceleration_max)
    slowest, fastest = (
        np.minimum(limits.speed_min, own.speed),
        np.maximum(limits.speed_max, own.speed),
    )
    gain = np.clip(gain, (slowest - own.speed) / PERIOD, (fastest - own.speed) / PERIOD)
    return gain, np.clip(yaw_rate, -limits.yaw_rate_max, limits.yaw_rate_max)


def _displacements(own: VehicleState, gain: Any, rate: Any, time: Any) -> Any:
    """Return complex displacements, m, ``[n, T]``: Simpson's rule on the velocity."""
    heading, speed, gain, rate = (field[:, None] for field in (own.heading, own.speed, gain, rate))
    first = speed * np.exp(1j * heading)
    middle = (speed + 0.5 * gain * time) * np.exp(1j * (heading + 0.5 * rate * time))
    last = (speed + gain * time) * np.exp(1j * (heading + rate * time))
    return time / 6.0 * (first + 4.0 * middle + last)


def _closest(away: Any) -> Any:
    """Return the smallest distance of the origin from chains of points ``[m, T]``, m."""
    chord = np.diff(away, axis=1)
    length = np.maximum(np.abs(chord) ** 2, 1e-12)
    share = np.clip(-(away[:, :-1] * np.conj(chord)).real / length, 0.0, 1.0)
    return np.abs(away[:, :-1] + share * chord).min(axis=1)
