"""The fallback's manoeuvres of one request in plain floats and loops: what is compiled.

:mod:`agents.planner.search.fallback_flight` does the same by numpy, for many requests and without
numba. Here a manoeuvre is set against all intruders of a crowd, not the nearest alone.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.areas import required_distances
from agents.kernel.traffic import WINDOW_EDGE, predict_one, requirement_of
from agents.manoeuvres.direct_to_goal import DirectRoute, DirectTask, direct, keeps_clear
from agents.manoeuvres.escape_manoeuvre import Flight, Manoeuvre
from agents.manoeuvres.simulator import Effort, fly_one_away
from agents.planner.request.options import Narrowed, Options, task_of
from agents.planner.request.request import Request
from agents.planner.search.areas_ahead import (
    AreaRecords,
    area_records,
    scalar_clearance,
    scalar_way_clear,
)
from agents.planner.search.continuation import (
    CROWD,
    IntruderBeyond,
    RouteLegs,
    ScalarContinuation,
    continuation_lines,
    growth_beyond,
    lines_clear,
    route_continuation,
    scalar_continuation,
)
from agents.planner.search.rollout import Rollout
from envs.angles import wrap
from envs.arrays import Array, Float, Int, Shaped
from envs.backend import FLOATS
from envs.compiled import Entry, records, scalar
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, velocity
from envs.relative import RelativeMotion, step_separation, straight_cpa
from envs.trees import map_leaves, take
from envs.wind import aim_point

LATER = 18
"""Strides from turning back until uncertainty has grown to what the way back keeps."""

TURNS = 0.1
"""Of the greatest turn rate, from which on a stride counts as a turn."""

# A call looks at so many pairs of a manoeuvre's stride and an intruder, of some 10 ns each. What
# else counts as so many: the rest of a stride, an intruder and an edge of an area on the way back.
_PAIRS, _OWN_PAIRS, _WAY_PAIRS, _EDGE_PAIRS = 40_000, 50, 10, 5
_ALOFT, _GIVEN_UP, _RETURNED = 0.0, 1.0, 2.0  # status of a manoeuvre


@dataclass
class Track:
    """An intruder about a stride; a record, or columns ``[K]``."""

    x0: Array  # where it is at the beginning, m
    y0: Array
    vx0: Array  # m/s
    vy0: Array
    x: Array  # where it is at the end, m
    y: Array
    vx: Array  # m/s
    vy: Array
    heading: Array  # there, rad
    speed: Array
    required: Array  # separation in the stride, m
    later: Array  # what the way back from its end keeps without slack, m


@dataclass
class Intruder:
    """An intruder at the request; a record, or columns ``[K]``."""

    x: Array  # m
    y: Array
    heading: Array  # rad
    speed: Array  # m/s
    turn_rate: Array  # rad/s
    turn_time: Array  # s
    required: Array  # separation, m


class ScalarSurroundings(NamedTuple):
    """What the manoeuvres of one request are tested against."""

    intruders: Array  # records of Intruder that exist, nearest first, [K]
    tracks: Array  # records of Track of the latest stride, written in place, [K]
    continuation: ScalarContinuation  # with uncertainty and windows of the intruders
    areas: AreaRecords
    goal: tuple[float, float]  # at the request, m
    drift: tuple[float, float]  # m/s
    task: DirectTask
    stride: float  # s
    last: int  # number of the last stride at whose beginning a manoeuvre may turn back
    most: float  # clearance beyond which more is not told, m


class ScalarEffort(NamedTuple):
    """When manoeuvres are given up, as of :class:`agents.manoeuvres.simulator.Effort`."""

    least: float
    good: float
    enough: int


@dataclass
class ManoeuvreFlight:
    """A manoeuvre under way; a record that is written in place, or columns ``[M]``."""

    turn: Array  # these as of :class:`agents.manoeuvres.escape_manoeuvre.Manoeuvre`
    throttle: Array
    switch: Array
    turn_after: Array
    throttle_after: Array
    resume: Array
    slack: Array
    x: Array  # m
    y: Array
    course: Array  # not wrapped, rad
    speed: Array  # m/s
    to_turn: Array  # what is left of the turn, rad
    clearance: Array  # so far, m
    path: Array  # length flown, m
    side: Array  # of the last turn: 1 left, -1 right, 0 none
    reversals: Array  # how often the turn changed side
    status: Array  # in the air, given up or returned
    end: Array  # number of the stride that begins where it is
    # the intruder that blocked the latest way back; beyond the goal: K more; an area: 2 K
    blocker: Array


class Progress(NamedTuple):
    """How far a family has come."""

    stride: int  # to whose beginning manoeuvres are flown
    number: int  # of the manoeuvre that comes next
    returned_well: int


def _fly_on(
    progress: Progress,
    flights: Array,
    plan_states: Array,
    spacing: int,
    around: ScalarSurroundings,
    effort: ScalarEffort,
) -> Progress:
    """Fly manoeuvres stride by stride until enough is computed for a call; return how far they
    came: the stride is beyond the last one where none is left in the air.

    Args:
        progress: how far they came before.
        flights: records of ManoeuvreFlight, ``[M]``.
        plan_states: x, y, heading and speed every so many strides, ``[M, P, 4]``.
        spacing: strides from one of these to the next.
        around: what the flights are tested against.
        effort: when manoeuvres are given up.
    """
    stride, number, well = progress
    pairs, work = len(around.intruders) + len(around.areas.lines) + _OWN_PAIRS, 0
    while stride <= around.last:
        if work > _PAIRS:
            return Progress(stride, number, well)
        if number == 0:
            _move(stride, around)
        aloft = 0
        for m in range(number, len(flights)):
            flight = flights[m]
            if flight.status != _ALOFT:
                continue
            if work > _PAIRS:
                return Progress(stride, m, well)
            aloft += 1
            work += pairs
            if stride > 0:
                _fly_stride(flight, stride - 1, around)
            flight.end = stride
            if stride % spacing == 0:
                _note(plan_states, m, stride // spacing, flight)
            if not flight.clearance >= effort.least:
                flight.status = _GIVEN_UP
            elif stride * around.stride >= flight.resume:
                clear, looked = _way_back(flight, stride * around.stride, around)
                work += looked
                if clear:
                    flight.status = _RETURNED
                    well += 1 if flight.clearance >= effort.good else 0
        # What is under way for longer than so many others costs more than they.
        if well >= effort.enough or (number == 0 and aloft == 0):
            return Progress(around.last + 1, 0, well)
        stride, number = stride + 1, 0
    return Progress(stride, 0, well)


@scalar
def _move(stride: int, around: ScalarSurroundings) -> None:
    """Write the intruders about the stride that ends where the given one begins."""
    tracks, intruders, continuation = around.tracks, around.intruders, around.continuation
    end = stride * around.stride
    latest = (min(stride + LATER, around.last) + 1) * around.stride
    for k in range(len(intruders)):
        intruder, track, spread = intruders[k], tracks[k], continuation.intruders[k]
        x, y, heading, speed = intruder.x, intruder.y, intruder.heading, intruder.speed
        state: VehicleState[Air] = VehicleState(x, y, heading, speed)
        moved = predict_one(state, intruder.turn_rate, intruder.turn_time, end)
        track.x0, track.y0, track.vx0, track.vy0 = track.x, track.y, track.vx, track.vy
        track.x, track.y, track.heading, track.speed = moved.x, moved.y, moved.heading, moved.speed
        track.vx, track.vy = velocity(moved, FLOATS)
        track.later = intruder.required + growth_beyond(spread, latest, continuation.sigmas)
        track.required = intruder.required + growth_beyond(spread, end, continuation.sigmas)
        counts = end >= spread.begin - WINDOW_EDGE
        if not (counts and end - around.stride <= spread.end + WINDOW_EDGE):
            track.required = -math.inf


@scalar
def _state_of(flight: ManoeuvreFlight) -> VehicleState[Air]:
    """Return where a manoeuvre is."""
    return VehicleState(flight.x, flight.y, wrap(flight.course, FLOATS), flight.speed)


@scalar
def _note(plan_states: Array, row: int, column: int, flight: ManoeuvreFlight) -> None:
    """Write the state of a manoeuvre among its plan states."""
    state = _state_of(flight)
    plan_states[row, column, 0] = state.x
    plan_states[row, column, 1] = state.y
    plan_states[row, column, 2] = state.heading
    plan_states[row, column, 3] = state.speed


@scalar
def _fly_stride(flight: ManoeuvreFlight, number: int, around: ScalarSurroundings) -> None:
    """Fly a stride of a manoeuvre, and note how far it stays from intruders and areas."""
    dt, limits = around.stride, around.task.limits
    manoeuvre = Manoeuvre(
        flight.turn,
        flight.throttle,
        flight.switch,
        flight.turn_after,
        flight.throttle_after,
        flight.resume,
        flight.slack,
        0.0,
    )
    before = _state_of(flight)
    unwrapped: VehicleState[Air] = VehicleState(flight.x, flight.y, flight.course, flight.speed)
    switched = number > 0 and (number - 1) * dt >= flight.switch
    away = Flight(unwrapped, flight.to_turn, switched, False)
    flown = fly_one_away(away, manoeuvre, number, dt, limits)
    flight.to_turn = flown.to_turn
    flight.x, flight.y = flown.own.x, flown.own.y
    flight.course, flight.speed = flown.own.heading, flown.own.speed
    after = _state_of(flight)
    flight.path += 0.5 * dt * (before.speed + after.speed)
    turned = wrap(after.heading - before.heading, FLOATS)
    if abs(turned) > TURNS * limits.yaw_rate_max * dt:
        side = 1.0 if turned > 0.0 else -1.0
        flight.reversals += 1.0 if side * flight.side < 0.0 else 0.0
        flight.side = side
    clearance = min(flight.clearance, around.most)
    clearance = _clearance(before, after, clearance, around.tracks, dt)
    begin, end = number * dt, (number + 1) * dt
    flight.clearance = scalar_clearance(
        around.areas, (before.x, before.y, begin), (after.x, after.y, end), clearance
    )


@scalar
def _clearance(
    own: VehicleState[Air], after: VehicleState[Air], least: float, tracks: Array, dt: float
) -> float:
    """Return the least distance less the required one from any intruder in a stride between two
    states, or ``least`` where it is more, m.
    """
    vx0, vy0 = velocity(own, FLOATS)
    vx, vy = velocity(after, FLOATS)
    fastest = max(own.speed, after.speed)
    for k in range(len(tracks)):
        track = tracks[k]
        x0, y0 = track.x0 - own.x, track.y0 - own.y
        # The parabola of a stride is no longer than five quarters of both flights.
        near = track.required + least + 1.25 * dt * (fastest + track.speed)
        if x0 * x0 + y0 * y0 < near * abs(near):
            first = RelativeMotion(x0, y0, track.vx0 - vx0, track.vy0 - vy0)
            last = RelativeMotion(
                track.x - after.x, track.y - after.y, track.vx - vx, track.vy - vy
            )
            apart = step_separation(first, last, dt, FLOATS).distance
            least = min(least, apart - track.required)
    return least


@scalar
def _way_back(flight: ManoeuvreFlight, time: float, around: ScalarSurroundings) -> tuple[bool, int]:
    """Return whether the way back is clear at a time, s, and how much was looked at; note what
    blocks it.

    What blocked the way a stride before is looked at first.
    """
    task, drift, count = around.task, around.drift, len(around.tracks)
    own, slack, before = _state_of(flight), flight.slack, int(flight.blocker)
    place = around.goal[0] + drift[0] * time, around.goal[1] + drift[1] * time
    aim = aim_point(own, place, drift, task.until, FLOATS)
    way = direct(own, aim, time, task, FLOATS)
    if 0 <= before < count and not _clear_of(before, own, way, time, slack, around):
        return False, _WAY_PAIRS
    if count <= before < 2 * count:
        lines = continuation_lines(own, aim, time, around.continuation, task)
        if not _continuation_clear_of(before - count, lines, slack, around):
            return False, _WAY_PAIRS
    of_areas = _EDGE_PAIRS * len(around.areas.lines)
    if before == 2 * count and not scalar_way_clear(around.areas, own, aim, way, time, task):
        return False, of_areas
    for k in range(count):
        if not _clear_of(k, own, way, time, slack, around):
            flight.blocker = k
            return False, (k + 1) * _WAY_PAIRS
    lines = continuation_lines(own, aim, time, around.continuation, task)
    looked = count * (_WAY_PAIRS + len(lines)) + of_areas
    for k in range(count):
        if not _continuation_clear_of(k, lines, slack, around):
            flight.blocker = count + k
            return False, looked
    flight.blocker = 2 * count
    return scalar_way_clear(around.areas, own, aim, way, time, task), looked


@scalar
def _clear_of(
    k: int,
    own: VehicleState[Air],
    way: DirectRoute,
    time: float,
    slack: float,
    around: ScalarSurroundings,
) -> bool:
    """Return whether a direct route keeps clear of an intruder."""
    track, spread = around.tracks[k], around.continuation.intruders[k]
    intruder: VehicleState[Air] = VehicleState(track.x, track.y, track.heading, track.speed)
    window = spread.begin, spread.end
    required = track.later + slack
    return keeps_clear(own, way, intruder, required, time, around.task, FLOATS, window)


@scalar
def _continuation_clear_of(k: int, lines: Array, slack: float, around: ScalarSurroundings) -> bool:
    """Return whether the route beyond the goal keeps clear of an intruder."""
    required = around.intruders[k].required + slack
    return lines_clear(
        lines, around.continuation.intruders[k], required, around.continuation.sigmas
    )


def _examples() -> list[tuple[Any, ...]]:
    """Return arguments of the types that are flown with."""
    zero = np.zeros(1)
    legs, intruders = RouteLegs(*[zero] * 5), IntruderBeyond(*[zero] * 9)
    continuation = ScalarContinuation(
        records(legs._asdict()), 0.0, 0.0, zero, records(intruders._asdict()), 0.0, 0.0
    )
    around = ScalarSurroundings(
        intruders=records(vars(Intruder(*[zero] * 7))),
        tracks=records(vars(Track(*[zero] * 12))),
        continuation=continuation,
        areas=area_records((), ()),
        goal=(0.0, 0.0),
        drift=(0.0, 0.0),
        task=DirectTask(Limits(*[0.0] * 5), 0.0, 0.0, 0.0),
        stride=0.0,
        last=0,
        most=0.0,
    )
    own: VehicleState[Air] = VehicleState(*[zero] * 4)
    flights, limit = takeoff(own, Manoeuvre(*[zero] * 8)), ScalarEffort(0.0, 0.0, 1)
    return [(Progress(0, 0, 0), flights, np.zeros((1, 1, 4)), 1, around, limit)]


FLY_ON = Entry(_fly_on, _examples)
"""Fly manoeuvres on for at most a millisecond."""


def scalar_surroundings(
    request: Request, goal: Int[Array, "1"], options: Options[Narrowed], stride: float, last: int
) -> ScalarSurroundings:
    """Return what manoeuvres of one request are tested against, in strides of some seconds up to
    the one numbered ``last``.
    """
    traffic, own = request.traffic, request.own
    required = requirement_of(traffic, own, options.requirement)[0]
    to = float(request.route_x[0, goal[0]]), float(request.route_y[0, goal[0]])
    numbers = np.flatnonzero(traffic.mask[0])
    # By how near they come if all fly straight on.
    miss = straight_cpa(take(own, (slice(None), None)), traffic.state, np).distance[0] - required
    order = numbers[np.argsort(miss[numbers], kind="stable")]
    intruders = take(take(traffic, 0), order)
    nearest_first = request._replace(traffic=map_leaves(lambda field: field[None], intruders))
    continuation = route_continuation(nearest_first, goal, options, ordered=False)
    active = () if request.areas is None else request.areas.value
    margin = options.requirement.margin
    away = [required_distances(area, own.x, own.y, margin) for area in active]
    east, north = request.drift or (np.zeros(1), np.zeros(1))
    separations = required[order]
    none = np.zeros(order.size)
    state = intruders.state
    return ScalarSurroundings(
        intruders=records(
            vars(Intruder(*state, intruders.turn_rate, intruders.turn_time, separations))
        ),
        tracks=records(vars(Track(*[none] * 12))),
        continuation=scalar_continuation(continuation, 0),
        areas=area_records(active, away),
        goal=to,
        drift=(float(east[0]), float(north[0])),
        task=map_leaves(float, task_of(options)),
        stride=float(stride),
        last=last,
        most=float(options.aircraft.separation) if traffic.mask.shape[-1] > CROWD else math.inf,
    )


def takeoff(own: VehicleState[Air], manoeuvre: Manoeuvre) -> Shaped[Array, " M"]:
    """Return manoeuvres ``[M]`` of a request ``[1]`` at their beginning, records of
    :class:`ManoeuvreFlight`.
    """
    zero = np.zeros(manoeuvre.turn.size)
    flights = ManoeuvreFlight(
        *manoeuvre[:-1],
        *(zero + field for field in own),
        to_turn=manoeuvre.turn,
        clearance=zero + np.inf,
        path=zero,
        side=zero,
        reversals=zero,
        status=zero + _ALOFT,
        end=zero,
        blocker=zero - 1.0,
    )
    return records(vars(flights))


def fly_one_out(
    request: Request,
    goal: Int[Array, "1"],
    manoeuvre: Manoeuvre,
    options: Options[Narrowed],
    effort: Effort,
    stride: float,
    last: int,
    spacing: int,
) -> tuple[Rollout, Float[Array, " M"]]:
    """Fly manoeuvres ``[M]`` of one request until the direct route to the goal is clear.

    Args:
        request: ``[1]``.
        goal: number of the point to rejoin at.
        manoeuvre: parameters, ``[M]``.
        options: of the plans.
        effort: when manoeuvres are given up.
        stride: time step, s.
        last: number of the last stride at whose beginning a manoeuvre may turn back.
        spacing: strides between the states of plans.

    Returns:
        The manoeuvres, and their clearance until then, m, ``[M]``.
    """
    around = scalar_surroundings(request, goal, options, stride, last)
    flights = takeoff(request.own, manoeuvre)
    plan_states = np.full((flights.size, last // spacing + 1, 4), np.nan)
    limit = ScalarEffort(float(effort.least), float(effort.good), int(effort.enough))
    progress = Progress(0, 0, 0)
    while progress.stride <= last and not effort.ends():
        progress = FLY_ON(progress, flights, plan_states, spacing, around, limit)
    return _rollout(flights, plan_states, stride), flights["clearance"].copy()


def _rollout(flights: Array, plan_states: Array, stride: float) -> Rollout:
    """Return manoeuvres; all of them are direct."""
    returned = flights["status"] == _RETURNED

    def where_returned(values: Array) -> Array:
        return np.where(returned, values, np.nan)

    heading = wrap(flights["course"], np)
    end: VehicleState[Air] = VehicleState(flights["x"], flights["y"], heading, flights["speed"])
    return Rollout(
        VehicleState(*np.ascontiguousarray(np.moveaxis(plan_states, -1, 0))),
        end=map_leaves(where_returned, end),
        time=where_returned(flights["end"] * stride),
        direct=returned,
        path=where_returned(flights["path"]),
        turn_sign=where_returned(flights["side"]),
        reversals=where_returned(flights["reversals"]),
    )
