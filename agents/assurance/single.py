"""The run-time monitor of one aircraft: ``agents.assurance`` with N = 1, by names and sentences.

Intruders go by name and have the same place as long as they exist. One that is not reported any
more is missing, which is a reason; it is forgotten only where the caller says that it is gone.

States, plans and backups are over the ground. Inside, the monitor works in the air mass of the wind
that its plan is flown in, with limits that hold in every wind within its uncertainty.

It is a module of its own, below that of the messages (:mod:`ros_bridge.core.assurance`), because a
program that has no messages, only metres and seconds, has its plan watched by it too.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from agents.assurance import monitor as monitors
from agents.assurance.backup import Sense, resting
from agents.assurance.backup_heights import backup_flight
from agents.assurance.climbs import Climb, Met, climb_of, times_met
from agents.assurance.frames import STILL, Frame, carry, frame_of
from agents.assurance.inputs import Inputs, Memory, clock_runs, good_reports, no_areas
from agents.assurance.space import Space, climb_of_backup, hold
from agents.assurance.state import Decision, FlyMode, Monitor, State, rearrange, start
from agents.assurance.thresholds import OUTSIDE, SAYS, Cause, Thresholds
from agents.kernel.levels import Altitude, Line, steady
from agents.kernel.traffic import advance_reports
from agents.planner.answer import Plan
from agents.planner.request.fields import listed
from agents.planner.request.options import L, Narrowed, Options
from agents.planner.request.reports import (
    Intruder,
    arrays_of_reports,
    is_usable,
    usable_altitude,
    windows,
    with_state,
)
from envs.areas import Area
from envs.backend import FLOATS
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.tracking.tracker import lasting, plausible_turn
from envs.trees import take
from envs.waypoints import PlanStates, plan_states
from envs.wind import NO_WIND

_SAME = 1e-6  # s by which the times of one report may differ
_ONE = np.array([0])
_MISSING: VehicleState[Ground] = VehicleState(math.nan, math.nan, math.nan, math.nan)
_NOWHERE: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Why:
    """One reason."""

    cause: Cause
    field: str
    message: str


@dataclass(frozen=True, slots=True)
class Ask:
    """A request for a plan, to be given to :func:`agents.planner.plan` and back to
    :func:`answer`.
    """

    number: int
    own: VehicleState[Ground]
    intruders: tuple[Intruder[Ground], ...]
    own_altitude: Altitude | None = None


@dataclass(frozen=True, slots=True)
class Assessment:
    """The monitor's decision for one second."""

    state: State
    fly: FlyMode
    ask: Ask | None
    """The plan that is wanted now; None: none."""
    reasons: tuple[Why, ...]
    measured: Decision
    """The numbers, ``[1]``."""
    in_height: "InHeight | None" = None
    """What counts by its altitude; None: plans stay in the plane, or the clock stands still."""

    @property
    def outside(self) -> list[str]:
        """What is outside the operating domain, a sentence each."""
        return [why.message for why in self.reasons if why.cause & OUTSIDE]


@dataclass(frozen=True, slots=True)
class InHeight:
    """What an ownship that may climb and descend meets from one second on."""

    own: Altitude | None
    flight: tuple[Line, ...]
    """The altitude that is flown; none: it is unknown."""
    space: Space


@dataclass(frozen=True)
class Watch:
    """A monitor of one aircraft, never changed in place."""

    monitor: Monitor
    names: tuple[str, ...]  # of the intruders, by place
    thresholds: Thresholds
    ask: Ask | None = None  # the last request
    air: Frame = STILL  # that the monitor works in
    # The last reports of each with an altitude: when they held, s, and what they said of it.
    levels: Mapping[str, tuple[float, Intruder[Ground]]] = field(default_factory=dict)
    climb: Climb | None = None  # of the active plan; None: it is one in the plane
    backup_climb: Climb | None = None  # of the current backup; None: in the plane, or unknown
    last_areas: Sequence[Area] = ()  # as they were at the last step

    @property
    def thresholds_in_air(self) -> Thresholds[Narrowed]:
        """The thresholds in the monitor's air mass."""
        return self.thresholds.in_wind(self.air.wind)

    @property
    def flown_climb(self) -> Climb | None:
        """The altitude of plan or backup that is flown; None: it has no profile."""
        return self.backup_climb if self.monitor.on_backup[0] else self.climb


_Watch = TypeVar("_Watch", bound=Watch)  # a watch, or one with more fields


def begin(thresholds: Thresholds) -> Watch:
    """Return a monitor that watches nothing."""
    return Watch(start(1, 0, thresholds), (), thresholds)


def activate(
    watch: _Watch,
    plan: Plan,
    own: VehicleState[Ground],
    intruders: Mapping[str, Intruder[Ground]],
    time: float,
    *,
    own_altitude: Altitude | None = None,
) -> _Watch:
    """Begin to watch a plan, with states, altitude and time, s, of its request; of one that is not
    SAFE the backup is flown. One that climbs must be flyable from the altitude of its request.

    Raises:
        RequestError: the plan's wind is too uncertain for the aircraft.
    """
    own_altitude = usable_altitude(own_altitude)
    intruders = {name: report for name, report in intruders.items() if is_usable(report)}
    watch = _allocate(
        watch, (*watch.names, *(name for name in intruders if name not in watch.names))
    )
    watch = _in_air_of(watch, plan, time)
    air = watch.air
    reports = [intruders.get(name, Intruder(_NOWHERE)) for name in watch.names]
    arrays, age = arrays_of_reports([air.report(report, time) for report in reports])
    traffic = advance_reports(
        arrays._replace(mask=np.array([[name in intruders for name in watch.names]], dtype=bool)),
        age,
    )
    thresholds = watch.thresholds_in_air
    options = thresholds.options
    climb, safe = _climb(plan, own_altitude, time, options)
    if climb is None:
        window = windows(reports, own_altitude, options)
    else:
        times = times_met(reports, climb.flight(own_altitude, time, options), options)
        window = Met(times, no_areas(1)).all_times
    traffic = traffic._replace(window=window)
    plan_states = _plan_states(own, plan, air, thresholds)
    monitor = monitors.activate(
        watch.monitor, _ONE, plan_states, np.array([safe]), time, traffic, thresholds
    )
    flown = not bool(monitor.on_backup[0])
    return replace(watch, monitor=monitor, climb=climb if flown else watch.climb)


def _climb(
    plan: Plan, own_altitude: Altitude | None, time: float, options: Options[L]
) -> tuple[Climb | None, bool]:
    """Return the altitude of a plan requested at a time, s, None where it is one in the plane, and
    whether the plan may be flown as far as it is known.
    """
    try:
        return climb_of(plan.waypoints, own_altitude, time, options), plan.safe
    except ValueError:
        return None, False


def step(
    watch: _Watch,
    time: float,
    own: VehicleState[Ground] | None,
    intruders: Mapping[str, Intruder[Ground]],
    *,
    own_age: float = 0.0,
    own_altitude: Altitude | None = None,
    gone: Sequence[str] = (),
    areas: Sequence[Area] = (),
) -> tuple[_Watch, Assessment]:
    """Judge one second, s, by the last reports; ``own`` is None where it is missing, ``gone`` do
    not count any more. The own altitude is as of now, and so are the areas, all that there are.
    """
    own_altitude = usable_altitude(own_altitude)
    intruders = {
        name: report if is_usable(report) else Intruder(_MISSING)
        for name, report in intruders.items()
    }
    # Among hundreds of aircraft a name is sought for in sets alone.
    watched, leaving = set(watch.names), set(gone) - set(intruders)
    names = (
        *(name for name in watch.names if name not in leaving),
        *(name for name in intruders if name not in watched),
    )
    watch = _allocate(watch, names)
    air, reports = watch.air, [intruders.get(name, Intruder(_MISSING)) for name in names]
    in_air = [
        with_state(report, air.to_air(report.state, time - report.age), report.velocity_std)
        for report in reports
    ]
    (traffic, age), thresholds = arrays_of_reports(in_air), watch.thresholds_in_air
    own_state = air.to_air(own or _MISSING, time - own_age)
    times, late = np.array([time], dtype=float), np.array([own_age], dtype=float)
    inputs = Inputs(
        time=times,
        own=VehicleState(*(np.array([value], dtype=float) for value in own_state)),
        own_age=late,
        intruders=traffic.state,
        age=age,
        mask=traffic.mask,
        position_std=traffic.position_std,
        velocity_std=traffic.velocity_std,
        turn_rate=np.where(traffic.turn_time > 0.0, traffic.turn_rate, 0.0),
        turn_std=np.array([[report.turn_std for report in reports]], dtype=float),
        separation=traffic.separation,
        window=windows(reports, own_altitude, thresholds.options),
    )
    watch = replace(watch, last_areas=areas)
    space = _space(watch, own_state, reports, time)
    inputs = inputs._replace(areas=space.areas_met(steady(own_altitude)))
    in_space = thresholds.options.climbs and clock_runs(watch.monitor.memory, inputs)[0]
    if in_space:
        space = replace(space, reports=_known_levels(watch, inputs, reports))
        inputs = space.complete(inputs, watch.climb, own_altitude)
    monitor, decision = monitors.step(watch.monitor, inputs, thresholds)
    counted = set(names)
    levels = {name: at for name, at in watch.levels.items() if name in counted} | {
        name: (time - report.age, report)
        for name, report in intruders.items()
        if report.altitude is not None
    }
    watch = replace(watch, levels=levels)
    ask = _ask(watch, monitor, decision, own_altitude) if decision.replan[0] else None
    watch = replace(watch, monitor=monitor, ask=ask or watch.ask)
    fly, state = FlyMode(int(decision.fly[0])), State(int(decision.state[0]))
    in_height = None
    if in_space:
        causes, options = Cause(int(decision.causes[0])), thresholds.options
        sense, begin = Sense(int(monitor.backup.sense[0])), space.begin_backup(own_altitude)
        from_begin = space.options_from(begin)
        watch = replace(watch, backup_climb=climb_of_backup(sense, begin, time, from_begin))
        if fly is FlyMode.BACKUP:
            flight = backup_flight(sense, begin, from_begin)
        elif fly is FlyMode.PLAN and watch.climb is not None and not causes & Cause.ALTITUDE_ERROR:
            flight = watch.climb.flight(own_altitude, time, options)
        else:
            flight = hold(own_altitude, options)
        in_height = InHeight(own_altitude, flight, space)
    whys = reasons(decision, thresholds, names)
    return watch, Assessment(state, fly, ask, whys, decision, in_height)


def _space(
    watch: Watch, own: VehicleState[Air], reports: Sequence[Intruder[Ground]], time: float
) -> Space:
    """Return what stands about an ownship at a time, s, by some reports and the last areas."""
    areas = [watch.air.area(area, time) for area in watch.last_areas]
    ends = float(watch.monitor.plan.end[0] + watch.monitor.started[0] - time)
    climb = watch.flown_climb
    flown = None if climb is None else climb.since(time)
    return Space(own, reports, areas, ends, watch.thresholds, flown)


def _known_levels(
    watch: Watch, inputs: Inputs, reports: Sequence[Intruder[Ground]]
) -> list[Intruder[Ground]]:
    """Return good reports, and the last good ones of intruders without."""
    good = good_reports(watch.monitor.memory, inputs)[0]
    last = _last_levels(watch, float(inputs.time[0]))
    return [
        report if is_good else before
        for report, is_good, before in zip(reports, good, last, strict=True)
    ]


def _last_levels(watch: Watch, time: float) -> list[Intruder[Ground]]:
    """Return the last good reports of the intruders, as old as they are at a time, s, of which only
    the altitudes count.
    """
    times = watch.monitor.memory.reported[0].tolist()
    return [
        _at_its_level(Intruder(_NOWHERE, age=time - when), when, watch.levels.get(name))
        for name, when in zip(watch.names, times, strict=True)
    ]


def answer(watch: _Watch, number: int, plan: Plan) -> tuple[_Watch, bool]:
    """Hand in what the planner answered to a request; return also whether the plan is flown now.

    Raises:
        RequestError: the plan's wind is too uncertain for the aircraft.
    """
    if watch.ask is None or number != watch.ask.number:
        return watch, False
    requested_at = float(watch.monitor.requested_at[0])
    moved = _in_air_of(watch, plan, requested_at)
    thresholds = moved.thresholds_in_air
    plan_states = _plan_states(watch.ask.own, plan, moved.air, thresholds)
    climb, safe = _climb(plan, watch.ask.own_altitude, requested_at, thresholds.options)
    met = None if climb is None else _what_answer_meets(moved, climb, watch.ask, thresholds)
    numbers, safe = np.array([number]), np.array([safe])
    monitor, taken_up = monitors.answer(
        moved.monitor, _ONE, numbers, plan_states, safe, thresholds, met
    )
    if taken_up[0]:
        return replace(moved, monitor=monitor, climb=climb), True
    if moved.air == watch.air:
        return replace(moved, monitor=monitor), False
    # The active plan goes on, in its own air mass.
    refused, thresholds = np.array([False]), watch.thresholds_in_air
    monitor, _ = monitors.answer(watch.monitor, _ONE, numbers, plan_states, refused, thresholds)
    return replace(watch, monitor=monitor), False


def _what_answer_meets(
    watch: Watch, climb: Climb, ask: Ask, thresholds: Thresholds[Narrowed]
) -> Met:
    """Return what a plan that answers a request meets from the last step on, on its profile."""
    memory, options = watch.monitor.memory, thresholds.options
    time = float(memory.time[0])
    own: VehicleState[Air] = VehicleState(*(float(field[0]) for field in memory.own))
    assert ask.own_altitude is not None, "a plan climbs from an altitude"
    altitude = replace(ask.own_altitude, value=float(climb.profile.at(np.array(time))))
    flight = climb.flight(altitude, time, options)
    return _space(watch, own, _last_levels(watch, time), time).find_met(flight)


def _in_air_of(watch: _Watch, plan: Plan, time: float) -> _Watch:
    """Return the monitor in the air mass that lies over the ground at a time, s, and in which a
    plan that begins then is flown; the old one where there is none.
    """
    frame = frame_of(plan.wind or NO_WIND, time)
    if not plan.waypoints or frame == watch.air:
        return watch
    monitor = carry(watch.monitor, watch.air, frame)
    monitor = monitor._replace(backup=resting(1, watch.thresholds))
    return replace(watch, monitor=monitor, air=frame)


def _allocate(watch: _Watch, names: tuple[str, ...]) -> _Watch:
    """Return the monitor with places for these intruders; one that had a place keeps its memory."""
    if names == watch.names:
        return watch
    place_of = {name: place for place, name in enumerate(watch.names)}
    before = [place_of.get(name, -1) for name in names]
    return replace(watch, monitor=rearrange(watch.monitor, before, watch.thresholds), names=names)


def _ask(watch: Watch, monitor: Monitor, decision: Decision, own_altitude: Altitude | None) -> Ask:
    """Return the request of one second: the last good reports with their ages, as the planner takes
    them.
    """
    memory, air = monitor.memory, watch.air
    own_state: VehicleState[Air] = VehicleState(*(float(field[0]) for field in decision.own))
    own = air.to_ground(own_state, float(memory.time[0]))
    when = np.where(np.isfinite(memory.reported), memory.reported, 0.0)
    intruders = air.to_ground(memory.intruders, when)
    reports = tuple(
        _at_its_level(
            _last_report(memory, intruders, place, watch.thresholds_in_air),
            float(memory.reported[0, place]),
            watch.levels.get(name),
        )
        for place, name in enumerate(watch.names)
        if decision.traffic.mask[0, place]
    )
    return Ask(int(decision.number[0]), own, reports, own_altitude)


def _last_report(
    memory: Memory, intruders: VehicleState[Ground], place: int, thresholds: Thresholds[Narrowed]
) -> Intruder[Ground]:
    """Return the last good report of the intruder at a place, of these states, with its age."""
    limits = thresholds.turn_rate_min, thresholds.turn_rate_max
    turn_rate = plausible_turn(float(memory.turn_rate[0, place]), *limits, FLOATS)
    turn_std, separation = float(memory.turn_std[0, place]), float(memory.separation[0, place])
    return Intruder(
        state=VehicleState(*(float(field[0, place]) for field in intruders)),
        age=float(memory.time[0] - memory.reported[0, place]),
        turn_rate=turn_rate,
        turn_time=lasting(turn_rate, turn_std, thresholds.turn_time, FLOATS),
        turn_std=turn_std,
        position_std=float(memory.position_std[0, place]),
        velocity_std=float(memory.velocity_std[0, place]),
        separation=None if math.isnan(separation) else separation,
    )


def _at_its_level(
    last: Intruder[Ground], time: float, reported: tuple[float, Intruder[Ground]] | None
) -> Intruder[Ground]:
    """Return a report with the altitude of the same time, s; without one it counts as level."""
    if reported is None or abs(reported[0] - time) > _SAME:
        return last
    _, report = reported
    return replace(last, altitude=report.altitude, vertical_separation=report.vertical_separation)


def reasons(
    decision: Decision, thresholds: Thresholds[L], names: Sequence[str] = ()
) -> tuple[Why, ...]:
    """Return the causes of one second in words, with the names of the intruders they lie in."""
    decided, whys = take(decision, 0), list[Why]()
    for cause, (of, says) in SAYS.items():
        if not int(decision.causes[0]) & int(cause):
            continue
        lies = np.flatnonzero(decided.intruder_causes & int(cause)).tolist()
        affected = listed([names[place] for place in lies]) if names else ""
        text = f"{of} {says.format(now=decided, **vars(thresholds))}"
        whys.append(Why(cause, of, f"{text} ({affected})" if affected else text))
    return tuple(whys)


def _plan_states(
    own: VehicleState[Ground], plan: Plan, frame: Frame, thresholds: Thresholds[Narrowed]
) -> PlanStates[Air]:
    """Return a plan's states in its air mass, ``[1, W + 1]``; nan where it has no trajectory, or
    not as many waypoints as expected.
    """
    count = thresholds.options.waypoints
    if len(plan.waypoints) != count:
        return PlanStates(*(np.full((1, count + 1), np.nan) for _ in range(5)))
    wind = frame.wind if frame.moves else None
    return take(plan_states(own, plan.waypoints, wind=wind), None)


def backup_states(watch: Watch) -> PlanStates[Ground]:
    """Return the plan states of the current backup over the ground, ``[B]``, their times from when
    it was refreshed; before the first own state they mean nothing.
    """
    in_air, began = take(watch.monitor.backup.plan_states, 0), watch.monitor.backup.started[0]
    state = watch.air.to_ground(VehicleState(*in_air[:4]), in_air.time + float(began))
    return PlanStates(*state, in_air.time)
