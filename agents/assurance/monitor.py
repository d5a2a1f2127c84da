"""The run-time monitor: a pure state machine that watches plans being flown, one or many at once.

At every time step :func:`step` takes the time, the own states and the intruders', with their ages. It judges what is
left of the active plan, asks for a new one where it must, and falls back to a backup, always ready, where there is no
plan. It never plans itself, draws no random numbers, reads no clock: the caller plans where a decision says so and
hands the answers to :func:`answer`. States, thresholds and guarantees: docs/explanation/assurance.md.
"""

from typing import Any

import numpy as np

from agents.assurance.backup import Backup, refreshed
from agents.assurance.conformance import floor, has, judged
from agents.assurance.inputs import Inputs, inputs, present, updated
from agents.assurance.lookahead import Course, course, outlook
from agents.assurance.state import Decision, Flown, Monitor, State, placeholder, start
from agents.assurance.thresholds import BLIND, DOUBTFUL, LOST, WANTING, Cause, Thresholds
from agents.planner.traffic import Traffic, required
from agents.planner.validator import validate
from envs.kinematics import VehicleState
from envs.relative import distance
from envs.trees import mapped, scatter, take
from envs.waypoints import Knots, Legs, at, legs

__all__ = [
    "Cause",
    "Decision",
    "Flown",
    "Inputs",
    "Monitor",
    "State",
    "Thresholds",
    "activate",
    "answer",
    "deactivate",
    "inputs",
    "references",
    "start",
    "step",
]


def activate(
    monitor: Monitor, rows: Any, knots: Knots, safe: Any, time: Any, traffic: Traffic, thresholds: Thresholds
) -> Monitor:
    """Begin to watch plans.

    Only a safe plan is flown; a row with another plan has none and flies its backup from the next step on.

    Args:
        monitor: ``[N]``.
        rows: which of them, numbers ``[M]``.
        knots: state at the request and the waypoints, ``[M, W + 1]``; nan where there is no plan.
        safe: whether the planner called them safe, ``[M]``.
        time: of the request on the monitor's clock, s, ``[M]`` or a scalar.
        traffic: the intruders that the plans were made with, ``[M, K]``.
        thresholds: of the monitor.
    """
    usable, plan = _usable(knots, np.asarray(safe, dtype=bool), thresholds)
    when = np.broadcast_to(np.asarray(time, dtype=float), usable.shape)
    away = distance(traffic.state.x - plan.x[:, :1], traffic.state.y - plan.y[:, :1], np)
    required_separation = required(traffic, away, thresholds.requirement)
    result = _installed(monitor, rows[usable], take((plan, when, traffic, required_separation), usable), 0)
    state, on_backup, causes, revision = (
        np.array(field) for field in (result.state, result.on_backup, result.causes, result.revision)
    )
    rest = rows[~usable]
    state[rest], on_backup[rest], causes[rest], revision[rest] = int(State.DENIED), True, int(Cause.REFUSED), -1
    return result._replace(state=state, on_backup=on_backup, causes=causes, revision=revision)


def deactivate(monitor: Monitor, rows: Any) -> Monitor:
    """Stop watching: the rows become IDLE; what they remember of reports stays."""
    state, on_backup, causes, revision = (
        np.array(field) for field in (monitor.state, monitor.on_backup, monitor.causes, monitor.revision)
    )
    state[rows], on_backup[rows], causes[rows], revision[rows] = int(State.IDLE), False, 0, -1
    # No answer that is still on its way may start a plan again.
    answered = np.array(monitor.answered)
    answered[rows] = monitor.requested[rows]
    return monitor._replace(state=state, on_backup=on_backup, causes=causes, revision=revision, answered=answered)


def step(monitor: Monitor, given: Inputs, thresholds: Thresholds) -> tuple[Monitor, Decision]:
    """Judge one time step.

    Args:
        monitor: ``[N]``.
        given: ``[N]``, intruders ``[N, K]``.
        thresholds: of the monitor.
    """
    memory, own, traffic, causes = updated(monitor.memory, given, thresholds)
    idle = monitor.state == State.IDLE
    blind = has(causes, BLIND)
    now = memory.time
    sums, causes, measured = judged(monitor, memory, own, traffic, causes, thresholds)
    loss = measured.loss

    backup, curves = _backup(monitor, own, traffic, now, idle | blind, thresholds)
    causes |= np.where(~idle & ~backup.safe, int(Cause.BACKUP_UNSAFE), 0)

    pending = monitor.requested > monitor.answered
    silent = pending & (now - monitor.requested_at > thresholds.answer_time)
    lost, unsafe, wants = has(causes, LOST), has(causes, Cause.SEPARATION), has(causes, WANTING)
    refused = has(monitor.causes, Cause.REFUSED) & (wants | monitor.on_backup | blind)
    causes |= np.where(refused, int(Cause.REFUSED), 0) | np.where(silent, int(Cause.NO_ANSWER), 0)
    causes = np.where(idle, causes & int(BLIND | LOST | DOUBTFUL), causes).astype(np.int32)

    rested = now - monitor.requested_at >= thresholds.replan_interval - 1e-9
    may_ask = rested & (~pending | silent) & ~blind & ~lost & ~idle
    held_up = (pending & ~may_ask) | ~rested | silent
    at_once = unsafe & (refused | lost | silent | (held_up & (loss <= thresholds.urgent)))
    on_backup = (monitor.on_backup | (at_once & ~blind)) & ~idle
    state = np.select(
        [idle, blind, on_backup, lost | has(causes, DOUBTFUL) | (wants & (refused | silent)), wants],
        [State.IDLE, State.DENIED, State.BACKUP, State.DENIED, State.REPLAN_REQUESTED],
        State.MONITORING,
    ).astype(np.int8)
    replan = may_ask & (wants | on_backup)
    request_traffic, request_separation = _request(monitor, replan, own, traffic, thresholds)
    monitor = monitor._replace(
        state=state,
        on_backup=on_backup,
        causes=causes,
        memory=memory,
        sums=sums,
        requested=monitor.requested + replan,
        requested_at=np.where(replan, now, monitor.requested_at),
        request_traffic=request_traffic,
        request_separation=request_separation,
        backup=backup,
        backup_legs=curves,
    )
    fly = np.where(idle, Flown.NOTHING, np.where(on_backup, Flown.BACKUP, Flown.PLAN)).astype(np.int8)
    return monitor, Decision(state, fly, replan, monitor.requested, causes, own, traffic, *measured)


def answer(
    monitor: Monitor, rows: Any, number: Any, knots: Knots, safe: Any, thresholds: Thresholds
) -> tuple[Monitor, Any]:
    """Hand in what the planner answered.

    A plan is taken up only if it is SAFE, answers the last request (so that it is not older than the active one),
    and is still safe against the intruders as they are now. An answer to another request changes nothing; one that
    cannot be flown leads to BACKUP if the rest of the active plan is not safe, else to DENIED.

    Args:
        monitor: ``[N]``.
        rows: which of them, numbers ``[M]``, each once.
        number: of the requests that are answered (:class:`Decision`), ``[M]``.
        knots: state at the request and the waypoints, ``[M, W + 1]``; nan where there is no plan.
        safe: whether the planner called them safe, ``[M]``.
        thresholds: of the monitor.

    Returns:
        The monitors, and which of the plans are flown now, ``[M]``.
    """
    rows = np.asarray(rows)
    current = (
        (number == monitor.requested[rows]) & (monitor.answered[rows] < number) & (monitor.state[rows] != State.IDLE)
    )
    blind = has(monitor.causes[rows], BLIND)
    usable, plan = _usable(knots, np.asarray(safe, dtype=bool) & current & ~blind, thresholds)
    memory = take(monitor.memory, rows)
    when, known = monitor.requested_at[rows], take(monitor.request_traffic, rows)
    required_separation = monitor.request_separation[rows]
    _own, traffic = present(memory, known.mask, thresholds)
    least = floor(required_separation, thresholds) - thresholds.resolution
    since = np.where(usable, memory.time - when, 0.0)
    near = outlook(plan, since, traffic, least, thresholds.requirement.sigmas).separation
    usable &= (near >= least).all(axis=-1)

    result = _installed(monitor, rows[usable], take((plan, when, known, required_separation), usable), number[usable])
    answered, state, on_backup, causes = (
        np.array(field) for field in (result.answered, result.state, result.on_backup, result.causes)
    )
    answered[rows[current]] = number[current]
    refused = rows[current & ~usable]
    causes[refused] |= int(Cause.REFUSED)
    seeing = refused[~blind[current & ~usable]]
    on_backup[seeing] |= has(causes[seeing], Cause.SEPARATION)
    state[seeing] = np.where(on_backup[seeing], State.BACKUP, State.DENIED)
    return result._replace(answered=answered, state=state, on_backup=on_backup, causes=causes), usable


def references(monitor: Monitor, time: Any, dt: float, count: int) -> VehicleState:
    """Return the states to be flown through at ``time``, ``time + dt``, ..., ``[count + 1, N]``.

    Args:
        monitor: ``[N]``; what IDLE rows get is of no use.
        time: on the monitor's clock, s, ``[N]`` or a scalar.
        dt: between the states, s.
        count: how many of them after the first.
    """
    when = np.broadcast_to(np.asarray(time, dtype=float), monitor.state.shape)
    result = VehicleState(*(np.zeros((count + 1, when.size)) for _ in range(4)))
    for rows, curves, starts in (
        (np.flatnonzero(~monitor.on_backup), monitor.plan.legs, monitor.started),
        (np.flatnonzero(monitor.on_backup), monitor.backup_legs, monitor.backup.started),
    ):
        if rows.size == 0:
            continue
        own = curves if rows.size == when.size else take(curves, rows)
        began = np.where(np.isfinite(starts[rows]), starts[rows], when[rows])
        for index in range(count + 1):
            state = at(own, when[rows] + index * dt - began)
            for into, value in zip(result, state, strict=True):
                into[index, rows] = value
    return result


def _backup(
    monitor: Monitor, own: VehicleState, traffic: Traffic, now: Any, skip: Any, thresholds: Thresholds
) -> tuple[Backup, Legs]:
    """Return the backups refreshed, but for the rows to skip, which stay as they are."""
    rows = np.flatnonzero(~skip)
    if rows.size == 0:
        return monitor.backup, monitor.backup_legs
    fresh = refreshed(*take((monitor.backup, own, traffic, now), rows), thresholds)
    if rows.size == skip.size:
        return fresh
    return _written((monitor.backup, monitor.backup_legs), rows, fresh)


def _request(
    monitor: Monitor, replan: Any, own: VehicleState, traffic: Traffic, thresholds: Thresholds
) -> tuple[Traffic, Any]:
    """Return the intruders of the last request, and the separations that its answer must keep."""
    rows = np.flatnonzero(replan)
    if rows.size == 0:
        return monitor.request_traffic, monitor.request_separation
    part = take(traffic, rows)
    away = distance(part.state.x - own.x[rows, None], part.state.y - own.y[rows, None], np)
    required_separation = required(part, away, thresholds.requirement)
    return _written((monitor.request_traffic, monitor.request_separation), rows, (part, required_separation))


def _usable(knots: Knots, wanted: Any, thresholds: Thresholds) -> tuple[Any, Course]:
    """Return which plans are wanted and can be flown, ``[M]``, and all as courses, placeholders where they cannot."""
    fields = np.stack([np.asarray(field, dtype=float) for field in knots])
    whole = np.isfinite(fields).all(axis=(0, 2)) & wanted
    filler = placeholder(whole.size, thresholds)
    whole &= (np.diff(np.where(whole[:, None], fields[4], filler.time), axis=-1) > 0.0).all(axis=-1)
    points = Knots(*(np.where(whole[:, None], a, b) for a, b in zip(fields, filler, strict=True)))
    curves = legs(points)
    no_traffic = Traffic.straight(VehicleState(*(np.zeros((whole.size, 0)) for _ in range(4))))
    legal = validate(points, no_traffic, thresholds.requirement, thresholds.limits, curves).safe
    return whole & legal, course(points, curves)


def _installed(monitor: Monitor, rows: Any, what: tuple[Course, Any, Traffic, Any], revision: Any) -> Monitor:
    if rows.size == 0:
        return monitor
    fields = ("plan", "started", "expected", "required_separation", "sums", "state", "on_backup", "causes", "revision")
    advisory = monitor.causes[rows] & int(Cause.BACKUP_UNSAFE)
    values = (*what, 0.0, int(State.MONITORING), False, advisory, revision)
    return monitor._replace(
        **{name: _written(getattr(monitor, name), rows, value) for name, value in zip(fields, values, strict=True)}
    )


def _written(old: Any, rows: Any, new: Any) -> Any:
    copy = mapped(np.array, old)
    scatter((copy,), rows, (new,))
    return copy
