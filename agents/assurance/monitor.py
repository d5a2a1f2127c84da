"""The run-time monitor: a pure state machine that watches plans being flown, one or many at once.

At every time step :func:`step` takes the time, the own states and the intruders', with their ages.
It judges what is left of the active plan, asks for a new one where it must, and falls back to a
backup, always ready, where there is no plan. It never plans itself, draws no random numbers, reads
no clock: the caller plans where a decision says so and hands the answers to :func:`answer`. States,
thresholds and guarantees: docs/explanation/assurance.md.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.assurance.areas import judge_remaining_plans
from agents.assurance.backup import Around, Backup, in_plane, refresh, surroundings
from agents.assurance.backup_heights import in_space
from agents.assurance.climbs import Met
from agents.assurance.conformance import floor, has, measure, required_separations
from agents.assurance.inputs import Inputs, advance, update
from agents.assurance.state import Decision, FlyMode, Monitor, State
from agents.assurance.thresholds import BLIND, LOST, UNSAFE, WANTING, Cause, Thresholds
from agents.kernel.clearance import clearance
from agents.kernel.separation import Separation
from agents.kernel.traffic import Traffic, whole
from agents.kernel.trajectory import Trajectory, trajectory
from agents.planner.judge.validator import validate
from agents.planner.request.options import Narrowed
from envs.arrays import Array, Bool, Float, Int
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import map_leaves, scatter, take
from envs.waypoints import PlanStates, at


def activate(
    monitor: Monitor,
    rows: Int[Array, " M"],
    plan_states: PlanStates[Air],
    safe: Bool[Array, " M"],
    time: Float[Array, " #M"],
    traffic: Traffic,
    thresholds: Thresholds[Narrowed],
) -> Monitor:
    """Begin to watch plans ``[M]`` in the rows numbered ``[M]`` of monitors ``[N]``, requested at a
    time, s, ``[M]``.

    Only a safe plan is flown; a row with another plan has none and flies its backup from the next
    step on.

    Args:
        plan_states: state at the request and the waypoints, ``[M, W + 1]``; nan where there is no
            plan.
        traffic: the intruders that the plans were made with, ``[M, K]``.
    """
    usable, plan = _usable(plan_states, safe, thresholds)
    when = np.broadcast_to(np.asarray(time, dtype=float), np.shape(rows))
    result = _install(monitor, rows[usable], plan, *take((when, whole(traffic)), usable))
    refused = np.delete(rows, usable)
    return _with(
        result, refused, state=int(State.DENIED), on_backup=True, causes=int(Cause.REFUSED)
    )


def step(
    monitor: Monitor, inputs: Inputs, thresholds: Thresholds[Narrowed]
) -> tuple[Monitor, Decision]:
    """Judge one time step of monitors ``[N]`` by what they are given, ``[N]`` and of intruders
    ``[N, K]``.
    """
    memory, own, traffic, causes, of_each = update(monitor.memory, inputs, thresholds)
    time, idle, blind = memory.time, monitor.state == State.IDLE, has(causes, BLIND)
    sums, causes, measured = measure(
        monitor, memory, own, traffic, causes, of_each, thresholds, inputs.on_profile
    )

    sighted = np.flatnonzero(~(idle | blind))
    around = in_plane(surroundings(traffic, memory.areas))
    if inputs.backups is not None:
        around = in_space(traffic, inputs.backups)
    backup = _refresh_backups(monitor.backup, sighted, own, around, time, thresholds)
    causes |= np.where(~idle & ~backup.safe, int(Cause.BACKUP_UNSAFE), 0)
    causes |= np.where(~idle & (backup.depth > 0.0), int(Cause.BACKUP_IN_AREA), 0)

    requests = _requests(monitor, causes, time, thresholds)
    causes |= np.where(requests.refused, int(Cause.REFUSED), 0)
    causes |= np.where(requests.silent, int(Cause.NO_ANSWER), 0)
    causes = np.where(idle, causes & int(BLIND | LOST), causes).astype(np.int32)

    urgent = measured.loss <= thresholds.urgent
    at_once = has(causes, UNSAFE) & (requests.hopeless | (requests.held_up & urgent))
    # Of a plan that has ended nothing is left to fly.
    ended = time - monitor.started >= monitor.plan.end
    on_backup = (monitor.on_backup | ((at_once | ended) & ~blind)) & ~idle
    state = _state(idle, on_backup, causes, unanswered=requests.refused | requests.silent)
    replan = requests.may_ask & (has(causes, WANTING) | on_backup)
    asking = np.flatnonzero(replan)
    monitor = _with(
        monitor, asking, request_traffic=take(traffic, asking), requested_at=time[asking]
    )
    monitor = monitor._replace(
        state=state,
        backup=backup,
        on_backup=on_backup,
        causes=causes,
        memory=memory,
        sums=sums,
        requested=monitor.requested + replan,
    )
    fly = np.where(on_backup, FlyMode.BACKUP, FlyMode.PLAN)
    return monitor, Decision(
        state=state,
        fly=np.where(idle, FlyMode.NOTHING, fly).astype(np.int8),
        replan=replan,
        number=monitor.requested,
        causes=causes,
        own=own,
        traffic=traffic,
        **measured._asdict(),
        backup_area=backup.area,
        areas=memory.areas,
    )


class _Requests(NamedTuple):
    """How monitors stand with the planner; fields ``[N]``, bool."""

    silent: Array  # the last request is not answered in time
    refused: Array  # the last answer could not be flown, and a plan is wanted still
    may_ask: Array  # a request may go out now
    held_up: Array  # none may, or the last one is not answered in time
    hopeless: Array  # it is of no use to wait for a plan


def _requests(
    monitor: Monitor, causes: Array, time: Array, thresholds: Thresholds[Narrowed]
) -> _Requests:
    """Return how monitors ``[N]`` stand with the planner, by the causes of this second."""
    idle, blind, lost = monitor.state == State.IDLE, has(causes, BLIND), has(causes, LOST)
    pending = monitor.requested > monitor.answered
    silent = pending & (time - monitor.requested_at > thresholds.answer_time)
    unmet = has(causes, WANTING) | monitor.on_backup | blind
    refused = has(monitor.causes, Cause.REFUSED) & unmet
    rested = time - monitor.requested_at >= thresholds.replan_interval - 1e-9
    may_ask = rested & (~pending | silent) & ~blind & ~lost & ~idle
    held_up = (pending & ~may_ask) | ~rested | silent
    return _Requests(silent, refused, may_ask, held_up, hopeless=refused | lost | silent)


def _refresh_backups(
    backup: Backup,
    rows: Array,
    own: VehicleState[Air],
    around: Around,
    time: Array,
    thresholds: Thresholds[Narrowed],
) -> Backup:
    """Return backups ``[N]`` of which those in some rows are as of now."""
    if rows.size == 0:
        return backup
    previous, states, when = take((backup, own, time), rows)
    fresh = refresh(previous, states, around.of(rows), when, thresholds)
    result = map_leaves(np.array, backup)
    scatter(result, rows, fresh)
    return result


def _state(idle: Array, on_backup: Array, causes: Array, unanswered: Array) -> Array:
    """Return the state that follows from the causes, int8 ``[N]``; ``unanswered`` says where a plan
    that is wanted was refused, or is not coming.
    """
    wants = has(causes, WANTING)
    denied = has(causes, LOST) | (wants & unanswered)
    return np.select(
        [idle, has(causes, BLIND), on_backup, denied, wants],
        [State.IDLE, State.DENIED, State.BACKUP, State.DENIED, State.REPLAN_REQUESTED],
        State.MONITORING,
    ).astype(np.int8)


def answer(
    monitor: Monitor,
    rows: Int[Array, " M"],
    number: Int[Array, " M"],
    plan_states: PlanStates[Air],
    safe: Bool[Array, " M"],
    thresholds: Thresholds[Narrowed],
    met: Met | None = None,
) -> tuple[Monitor, Array]:
    """Hand in what the planner answered to requests, ``[M]``, to rows of monitors ``[N]``, each row
    once.

    A plan is taken up only if it is SAFE, answers the last request (so that it is not older than
    the active one), and is still safe against the intruders and the areas as they are now. An
    answer to another request changes nothing; one that cannot be flown leads to BACKUP if the rest
    of the active plan is not safe, else to DENIED. Plans that climb say what they meet, ``[M]``.

    Returns:
        The monitors, and which of the plans are flown now, ``[M]``.
    """
    rows = np.asarray(rows)
    current = (number == monitor.requested[rows]) & (monitor.answered[rows] < number)
    blind = has(monitor.causes[rows], BLIND)
    usable, plan = _usable(plan_states, np.asarray(safe) & current & ~blind, thresholds)
    memory, when, expected = take(
        (monitor.memory, monitor.requested_at, monitor.request_traffic), rows[usable]
    )
    _own, traffic = advance(memory, expected.mask, thresholds)
    since, areas = memory.time - when, memory.areas
    if met is not None:
        met = take(met, usable)
        later = map_leaves(lambda time: time + since[:, None], met.all_times)
        expected, areas = expected._replace(window=later), met.areas
    least = (
        floor(required_separations(plan, expected, thresholds), expected, thresholds)
        - thresholds.resolution
    )
    if met is not None:
        traffic, least = met.columns(traffic), met.repeat(least)
    keeping = Separation(traffic, least, None, thresholds.requirement.sigmas)
    clearances = clearance(plan.since(since), keeping)
    from_areas = judge_remaining_plans(plan, since, areas, np.zeros(when.size), thresholds)
    good = (clearances.margin >= 0.0).all(axis=-1) & ~from_areas.lost
    usable = usable[good]

    result = _install(monitor, rows[usable], *take((plan, when, expected), good))
    result = _with(result, rows[current], answered=number[current])
    accepted = np.isin(np.arange(rows.size), usable)
    refused = rows[current & ~accepted]
    result = _with(result, refused, causes=result.causes[refused] | int(Cause.REFUSED))
    seeing = rows[current & ~accepted & ~blind]
    on_backup = result.on_backup[seeing] | has(result.causes[seeing], UNSAFE)
    state = np.where(on_backup, State.BACKUP, State.DENIED)
    return _with(result, seeing, on_backup=on_backup, state=state), accepted


def references(
    monitor: Monitor, time: Float[Array, " N"], dt: float, count: int
) -> VehicleState[Air]:
    """Return the states to be flown through at a time, s, and every ``dt`` after it, ``[count + 1,
    N]``; IDLE: any.
    """
    when = np.broadcast_to(np.asarray(time, dtype=float), monitor.state.shape)
    result: VehicleState[Air] = VehicleState(*(np.zeros((count + 1, when.size)) for _ in range(4)))
    later = np.arange(count + 1)[:, None] * dt
    for rows, curves, starts in (
        (np.flatnonzero(~monitor.on_backup), monitor.plan.legs, monitor.started),
        (np.flatnonzero(monitor.on_backup), monitor.backup.legs, monitor.backup.started),
    ):
        if rows.size == 0:
            continue
        own = curves if rows.size == when.size else take(curves, rows)
        began = np.where(np.isfinite(starts[rows]), starts[rows], when[rows])
        scatter(result, (slice(None), rows), at(own, when[rows] + later - began))
    return result


def _usable(
    plan_states: PlanStates[Air], requested: Array, thresholds: Thresholds[Narrowed]
) -> tuple[Array, Trajectory[Air]]:
    """Return the numbers of the plans ``[M]`` that are asked for and can be flown, and these as
    courses.
    """
    rows = np.flatnonzero(requested)
    nobody = Traffic.straight(VehicleState(*np.zeros((4, rows.size, 0))))
    rows = rows[
        validate(take(plan_states, rows), nobody, thresholds.requirement, thresholds.limits).safe
    ]
    plan = take(plan_states, rows)
    return rows, trajectory(plan)


def _install(
    monitor: Monitor, rows: Array, plan: Trajectory[Air], started: Array, expected: Traffic
) -> Monitor:
    fields = {"plan": plan, "started": started, "expected": expected, "sums": 0.0}
    causes = monitor.causes[rows] & int(Cause.BACKUP_UNSAFE | Cause.BACKUP_IN_AREA)
    return _with(
        monitor, rows, **fields, state=int(State.MONITORING), on_backup=False, causes=causes
    )


def _with(monitor: Monitor, rows: Array, **values: Any) -> Monitor:
    """Return monitors with some fields of some rows changed."""
    if rows.size == 0:
        return monitor
    copies = {name: map_leaves(np.array, getattr(monitor, name)) for name in values}
    scatter(tuple(copies.values()), rows, tuple(values.values()))
    return monitor._replace(**copies)
