"""The backup: a manoeuvre that is ready when no plan is.

A backup is a course and a speed: the aircraft turns onto the course at the surrogate's rate, accelerates or
decelerates to the speed, and holds both. It is published as knots like any plan, every leg of constant controls, and
judged by :mod:`agents.planner.validator` over :data:`HORIZON`. The one of the second before stays if it
passes from the present state; only otherwise is the family searched.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.planner.traffic import Requirement, Traffic, predicted, required, uncertainty
from agents.planner.validator import Findings, validate
from envs.angles import wrap
from envs.kinematics import Limits, VehicleState, advance
from envs.relative import distance
from envs.trees import column, mapped, scatter, take
from envs.waypoints import Knots, Legs, legs

__all__ = ["HORIZON", "KNOTS", "Backup", "flown", "refreshed", "search"]

_DURATIONS = (5.0, 5.0, 5.0, 5.0, 10.0, 10.0, 10.0, 10.0, 20.0, 20.0, 20.0)

HORIZON = sum(_DURATIONS)
"""Over which a backup is judged, s."""

KNOTS = len(_DURATIONS) + 1
"""Of a backup."""

_TURNS = np.radians(
    [0.0, 15.0, -15.0, 30.0, -30.0, 45.0, -45.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0]
)
_FAMILY_TURN = np.repeat(_TURNS, 3)
_FAMILY_SPEED = np.tile([0.0, -1.0, 1.0], _TURNS.size)  # hold, decelerate, accelerate
_STEP = 2.5  # s between samples when the family is ranked; 4 m of uncertainty at most
_ENOUGH = 300.0  # m of clearance beyond which more is worth nothing
_TURN_COST = 30.0  # m of clearance that a radian of turn must yield
_TRIED = 3  # of the family that are validated
_SLACK = 0.006  # m by which the validator's lower bound may lie below the truth
_BLOCK = 256  # aircraft searched for at once


class Backup(NamedTuple):
    """Backups; fields ``[N]``."""

    course: Any
    """To turn onto, rad in [-pi, pi)."""
    speed: Any
    """To reach, m/s."""
    knots: Knots
    """``[N, KNOTS]``, their times from when the backup was refreshed."""
    started: Any
    """When that was, on the monitor's clock, s; nan where there has never been one."""
    clearance: Any
    """Smallest distance less the required one over the horizon, m."""
    safe: Any
    """Whether the validator found nothing wrong but its own resolution (6 mm), bool."""
    searched: Any
    """Whether it is the result of a search in this second, bool."""


def flown(own: VehicleState, course: Any, speed: Any, limits: Limits) -> Knots:
    """Return backups from the present states as knots, ``[M, KNOTS]``; every leg has constant controls."""
    state, time = own, 0.0
    states = [own]
    to_turn = wrap(course - own.heading, np)
    for duration in _DURATIONS:
        turn, gain = _controls(to_turn, speed - state.speed, duration, limits)
        state = advance(state, gain / duration, turn / duration, duration, _unbound(limits), np)
        to_turn = to_turn - turn
        states.append(state)
        time += duration
    times = np.broadcast_to(np.cumsum((0.0, *_DURATIONS)), (own.x.size, KNOTS))
    x, y, heading, velocity = (np.stack(field, axis=-1) for field in zip(*states, strict=True))
    return Knots(x, y, wrap(heading, np), velocity, times.copy())


def refreshed(
    previous: Backup,
    own: VehicleState,
    traffic: Traffic,
    time: Any,
    requirement: Requirement,
    limits: tuple[Limits, Limits],
    gain: float,
) -> tuple[Backup, Legs]:
    """Return the backups for the present second and their legs, ``[N]``.

    Args:
        previous: those of the second before.
        own: present states, ``[N]``.
        traffic: the intruders now, ``[N, K]``.
        time: on the monitor's clock, s, ``[N]``.
        requirement: on the separation.
        limits: what legs must obey, and what backups are made with.
        gain: by how much more clearance, m, an unsafe backup is exchanged for another.
    """
    vehicle, manoeuvre = limits
    had = np.isfinite(previous.started)
    knots = flown(own, np.where(had, previous.course, own.heading), np.where(had, previous.speed, own.speed), manoeuvre)
    curves = legs(knots)
    found = validate(knots, traffic, requirement, vehicle, curves)
    safe = _safe(found) & had
    result = Backup(previous.course, previous.speed, knots, time, found.clearance, safe, np.zeros(had.size, dtype=bool))
    result = mapped(np.array, result)
    rows = np.flatnonzero(~safe)
    for first in range(0, rows.size, _BLOCK):
        part = rows[first : first + _BLOCK]
        other = search(take(own, part), take(traffic, part), time[part], requirement, limits)
        better = ~had[part] | other.safe | (other.clearance > result.clearance[part] + gain)
        scatter(result, part[better], take(other, better))
    changed = np.flatnonzero(result.searched)
    if changed.size:
        scatter(curves, changed, legs(take(result.knots, changed)))
    return result, curves


def search(
    own: VehicleState, traffic: Traffic, time: Any, requirement: Requirement, limits: tuple[Limits, Limits]
) -> Backup:
    """Return the best backup of the family, ``[N]``: a safe one, or that of greatest clearance.

    Args:
        own: present states, ``[N]``.
        traffic: the intruders now, ``[N, K]``.
        time: on the monitor's clock, s, ``[N]``.
        requirement: on the separation.
        limits: what legs must obey, and what backups are made with.
    """
    vehicle, manoeuvre = limits
    count, each = own.x.size, _FAMILY_TURN.size
    which = np.repeat(np.arange(count), each)
    turn = np.tile(_FAMILY_TURN, count)
    course = wrap(own.heading[which] + turn, np)
    extreme = np.where(np.tile(_FAMILY_SPEED, count) > 0.0, manoeuvre.speed_max, manoeuvre.speed_min)
    held = np.clip(own.speed, manoeuvre.speed_min, manoeuvre.speed_max)[which]
    speed = np.where(np.tile(_FAMILY_SPEED, count) == 0.0, held, extreme)
    away = distance(traffic.state.x - own.x[:, None], traffic.state.y - own.y[:, None], np)
    base = required(traffic, away, requirement)
    clearance = _estimate(take(own, which), course, speed, manoeuvre, traffic, base, requirement.sigmas)
    merit = (np.minimum(clearance, _ENOUGH) - _TURN_COST * np.abs(turn)).reshape(count, each)
    pick = np.argsort(-merit, axis=-1, kind="stable")[:, :_TRIED] + np.arange(count)[:, None] * each
    pick = pick.ravel()
    owners = which[pick]
    knots = flown(take(own, owners), course[pick], speed[pick], manoeuvre)
    found = validate(knots, take(traffic, owners), requirement, vehicle)
    safe, spare = _safe(found), np.where(np.isnan(found.clearance), -np.inf, found.clearance)
    order = np.lexsort((np.arange(pick.size), np.where(safe, 0.0, -spare), ~safe, owners))
    best = order[::_TRIED] if _TRIED > 1 else order
    knots = take(knots, best)
    return Backup(
        course[pick][best],
        speed[pick][best],
        knots,
        np.array(time),
        spare[best],
        safe[best],
        np.ones(count, dtype=bool),
    )


def _safe(found: Findings) -> Any:
    """Return whether nothing is wrong; a start inside the margin must keep its present distance, to the last digit."""
    return found.legal & (found.clearance >= -_SLACK)


def _estimate(
    own: VehicleState, course: Any, speed: Any, limits: Limits, traffic: Traffic, base: Any, sigmas: float
) -> Any:
    """Return the smallest distance less the required one of backups of a family, m, ``[N * F]``; an estimate."""
    count = base.shape[0]
    steps = round(HORIZON / _STEP)
    tracks = predicted(column(traffic), (np.arange(steps + 1) * _STEP)[:, None])
    least_required = np.where(traffic.mask, base, -np.inf)[:, None]
    if sigmas and traffic.velocity_std.any():
        spread = uncertainty(column(traffic), (np.arange(1, steps + 1) * _STEP)[:, None])
        least_required = least_required + sigmas * (spread - traffic.position_std[:, None])
    least = np.full(own.x.size, np.inf)
    state, to_turn, step = own, wrap(course - own.heading, np), 0

    def relative(state: VehicleState, step: int) -> tuple[Any, Any]:
        x, y = state.x.reshape(count, -1, 1), state.y.reshape(count, -1, 1)
        return tracks.x[:, step, None] - x, tracks.y[:, step, None] - y

    x0, y0 = relative(state, 0)
    for duration in _DURATIONS:
        turn, gain = _controls(to_turn, speed - state.speed, duration, limits)
        for _ in range(round(duration / _STEP)):
            state = advance(state, gain / duration, turn / duration, _STEP, _unbound(limits), np)
            step += 1
            x1, y1 = relative(state, step)
            dx, dy = x1 - x0, y1 - y0
            s = np.clip(-(x0 * dx + y0 * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
            apart = distance(x0 + s * dx, y0 + s * dy, np)
            spare = apart - least_required[:, min(step - 1, least_required.shape[1] - 1), None]
            least = np.minimum(least, np.min(spare, axis=-1, initial=np.inf).ravel())
            x0, y0 = x1, y1
        to_turn = to_turn - turn
    return least


def _controls(to_turn: Any, to_gain: Any, duration: float, limits: Limits) -> tuple[Any, Any]:
    """Return the turn (rad) and the change of speed (m/s) of one leg."""
    most = limits.yaw_rate_max * duration
    gain = np.clip(to_gain, limits.acceleration_min * duration, limits.acceleration_max * duration)
    return np.clip(to_turn, -most, most), gain


def _unbound(limits: Limits) -> Limits:
    """Return limits without a stop of the speed, which the legs' controls already respect."""
    return limits._replace(speed_min=-math.inf, speed_max=math.inf)
