"""SAFE plans as the follower flies them, on an integration of the kinematics of its own, checked
every 0.02 s.

What is shared with the planner: the contract of the legs (:mod:`envs.waypoints`) and the follower
itself.
"""

from typing import NamedTuple

import numpy as np

from agents.kernel.traffic import Requirement, Window
from agents.planner.request.options import default_margin
from agents.planner.request.request import Request
from benchmarks.safety.resimulation import Intruders, required_distances, separations
from envs.aircraft import PAPER
from envs.arrays import Array
from envs.follower import PERIOD, steer
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.trees import take
from envs.waypoints import Legs, PlanStates, at, legs

__all__ = ["Reflight", "refly"]

_MARGIN = default_margin(PAPER)
_ALLOWED = _MARGIN + 1e-2  # distance from the plan, m
_LOOK = 40.0  # m beyond what must be kept below which the parts of a period are looked at
_PARTS = np.linspace(0.0, PERIOD, 6)
_COMPRESS = 100  # periods between two looks at which have arrived


class Reflight(NamedTuple):
    """How plans were flown; fields ``[N]``."""

    separation: Array
    """Smallest distance to any intruder, m; inf without any."""
    error: Array
    """Largest distance from where the plan was at the time, m."""
    too_close: Array
    """Closer to an intruder than its separation, bool. Where less than that and the follower's
    default margin was asked for, or was there at the request, the margin less than that."""
    astray: Array
    """Farther from the plan than the follower's margin and 1 cm, bool."""


class _Extremes(NamedTuple):
    """What came nearest so far, and the largest error; fields ``[N]``."""

    separation: Array
    """Smallest distance to any intruder, m."""
    clearance: Array
    """Smallest distance less what must be kept, m."""
    error: Array
    """Largest distance from where the plan was at the time, m."""


class _Flying(NamedTuple):
    """Plans that have not arrived; fields ``[n]``, of intruders ``[n, K]``."""

    row: Array
    """Their places among all plans."""
    end: Array
    """When they arrive, s."""
    curves: Legs[Air]
    own: VehicleState[Air]
    planned: VehicleState[Air]
    """Where the plan is now."""
    others: Intruders
    """``[n, K, 1]``."""
    mask: Array
    """Which intruders there are."""
    window: Window | None
    """When each of them counts."""
    floor: Array
    """What must be kept from each, m."""
    look: Array
    """Below which the parts of a period are looked at, m."""


def refly(
    plan_states: PlanStates[Air], request: Request, requirement: Requirement, limits: Limits
) -> Reflight:
    """Fly plans ``[N]`` from the request to their last waypoint; the intruders fly as predicted.

    Args:
        plan_states: of the plans, finite, ``[N, 21]``.
        request: what was asked, ``[N]``.
        requirement: what distance was asked for.
        limits: of the vehicle; a speed beyond them at the request may stay.
    """
    count = len(plan_states.time)
    extremes = _Extremes(np.full(count, np.inf), np.full(count, np.inf), np.zeros(count))
    flying, period = _begin(plan_states, request, requirement), 0
    while flying.row.size:
        time = period * PERIOD
        after = at(flying.curves, time + PERIOD)
        gain, rate = _controls(flying, after, limits)
        moves = _displacements(flying.own, gain, rate, _PARTS)
        # Beyond its last waypoint a plan promises nothing.
        lasts = flying.end >= time + PERIOD
        _note_distances(extremes, flying, moves, time, lasts)
        own = VehicleState(
            flying.own.x + moves[:, -1].real,
            flying.own.y + moves[:, -1].imag,
            flying.own.heading + rate * PERIOD,
            flying.own.speed + gain * PERIOD,
        )
        off = np.where(lasts, np.hypot(own.x - after.x, own.y - after.y), 0.0)
        extremes.error[flying.row] = np.maximum(extremes.error[flying.row], off)
        flying, period = flying._replace(own=own, planned=after), period + 1
        if period % _COMPRESS == 0:
            flying = take(flying, flying.end > period * PERIOD)
    return Reflight(
        extremes.separation, extremes.error, extremes.clearance < -1e-3, extremes.error > _ALLOWED
    )


def _begin(plan_states: PlanStates[Air], request: Request, requirement: Requirement) -> _Flying:
    """Return plans ``[N]`` at the request."""
    traffic, curves = request.traffic, legs(plan_states)
    required = required_distances(request.own.x + 1j * request.own.y, traffic, requirement)
    floor = np.minimum(separations(traffic, requirement), required - _MARGIN)
    return _Flying(
        row=np.arange(len(plan_states.time)),
        end=plan_states.time[:, -1],
        curves=curves,
        own=VehicleState(*(np.array(field, dtype=float) for field in request.own)),
        planned=at(curves, 0.0),
        others=Intruders(*(field[..., None] for field in Intruders.of(traffic))),
        mask=traffic.mask,
        window=traffic.window,
        floor=floor,
        look=np.maximum(floor, requirement.separation) + _LOOK,
    )


def _controls(flying: _Flying, after: VehicleState[Air], limits: Limits) -> tuple[Array, Array]:
    """Return what the vehicles do of the follower's commands, m/s^2 and rad/s, ``[n]``; they never
    leave their speeds. ``after``: where the plans are at the end of the period.
    """
    speed = flying.own.speed
    acceleration, yaw_rate = steer(flying.planned, after, flying.own)
    gain = np.clip(acceleration, limits.acceleration_min, limits.acceleration_max)
    slowest, fastest = np.minimum(limits.speed_min, speed), np.maximum(limits.speed_max, speed)
    gain = np.clip(gain, (slowest - speed) / PERIOD, (fastest - speed) / PERIOD)
    return gain, np.clip(yaw_rate, -limits.yaw_rate_max, limits.yaw_rate_max)


def _displacements(own: VehicleState[Air], gain: Array, rate: Array, time: Array) -> Array:
    """Return complex displacements after times ``[T]``, m, ``[n, T]``: Simpson's rule on the
    velocity.
    """
    heading, speed, gain, rate = (field[:, None] for field in (own.heading, own.speed, gain, rate))
    first = speed * np.exp(1j * heading)
    middle = (speed + 0.5 * gain * time) * np.exp(1j * (heading + 0.5 * rate * time))
    last = (speed + gain * time) * np.exp(1j * (heading + rate * time))
    return time / 6.0 * (first + 4.0 * middle + last)


def _note_distances(
    extremes: _Extremes, flying: _Flying, moves: Array, time: float, lasts: Array
) -> None:
    """Note how near the intruders come in a period.

    Args:
        extremes: so far.
        flying: plans at the beginning of the period.
        moves: their displacements in its parts, complex m, ``[n, T]``.
        time: of its beginning, s.
        lasts: which plans last until its end, ``[n]``.
    """
    row, place = flying.row, flying.own.x + 1j * flying.own.y
    others = flying.others.place(np.full((1, 1, 1), time))[..., 0]
    counts = flying.mask & lasts[:, None] & _in_window(flying.window, time)
    apart = np.where(counts, np.abs(others - place[:, None]), np.inf)
    extremes.separation[row] = np.minimum(
        extremes.separation[row], np.min(apart, axis=1, initial=np.inf)
    )
    clearance = np.min(apart - flying.floor, axis=1, initial=np.inf)
    extremes.clearance[row] = np.minimum(extremes.clearance[row], clearance)
    n, k = np.nonzero(apart < flying.look)
    if n.size == 0:
        return
    near = Intruders(*(field[n, k] for field in flying.others))
    closest = _closest(near.place(time + _PARTS) - (moves[n] + place[n, None]))
    np.minimum.at(extremes.separation, row[n], closest)
    np.minimum.at(extremes.clearance, row[n], closest - flying.floor[n, k])


def _in_window(window: Window | None, time: float) -> Array:
    """Return which intruders count at a time, s, bool ``[n, K]``."""
    if window is None:
        return np.array(True)
    return (window.begin <= time) & (time <= window.end)


def _closest(away: Array) -> Array:
    """Return the smallest distance of the origin from chains of points ``[m, T]``, m."""
    chord = np.diff(away, axis=1)
    square = np.maximum(np.abs(chord) ** 2, 1e-12)
    share = np.clip(-(away[:, :-1] * np.conj(chord)).real / square, 0.0, 1.0)
    return np.abs(away[:, :-1] + share * chord).min(axis=1)
