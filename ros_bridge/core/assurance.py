"""The run-time monitor between messages: which plan is monitored, in which frame, and which reports
it gets.

Pure: a watch of :mod:`agents.assurance.single` with the situation of :mod:`ros_bridge.core.updates`
as its input and published plans as its plans. The local frame is the monitor's own, about the start
of the plan that it began with.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agents.assurance import single
from agents.assurance.backup import Sense
from agents.assurance.climbs import Climb
from agents.assurance.single import Assessment, Watch
from agents.assurance.state import FlyMode, State
from agents.assurance.thresholds import Thresholds
from agents.planner.answer import RequestError
from agents.planner.recheck import reconstruct
from agents.planner.request.request import Altitude, Intruder
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import on_profile
from envs.waypoints import Waypoint
from envs.wind import NO_WIND, Wind
from ros_bridge.core.areas import AreaReport, Placed
from ros_bridge.core.categories import NO_CATEGORIES, Categories
from ros_bridge.core.conversions import STATUS_SAFE, Published, trajectory
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.intruders import Assumptions, intruder_of
from ros_bridge.core.motion import Turns, to_local
from ros_bridge.core.reach import (
    Reach,
    comparable,
    level,
    out_of_reach,
    vertically_apart,
)
from ros_bridge.core.replies import geodetic_points, to_frame, true_wind, wind_of
from ros_bridge.core.reports import USUAL, Report, Unknown
from ros_bridge.core.situation import ACCURATE, Held, Situation
from ros_bridge.core.tracks import Track

if TYPE_CHECKING:
    from rlcas_msgs.msg import Trajectory

_GRID = 2.0**20
"""Parts of a second that times are rounded to: at any age a report has one time, exactly."""

_HORIZON = 1.25
"""How far ahead other aircraft matter at least, in the duration of a plan: for the next plan."""

_UNKNOWN: VehicleState[Ground] = VehicleState(math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Supervision(Watch):
    """A watch whose metres have a place on the Earth, and whose seconds a time; never changed in
    place.
    """

    unknown: Unknown = USUAL
    categories: Categories = NO_CATEGORIES
    frame: LocalFrame | None = None
    zero: int = 0  # of the monitor's clock, ns
    # The plan that is monitored; None: none, or it was withdrawn.
    published_plan: Published | None = None
    revision: int = 0  # the greatest that was received
    request_time: int = 0  # when the last request went out, ns
    reported: "Mapping[str, Reported]" = field(default_factory=lambda: MappingProxyType({}))
    """What the monitor got last, by aircraft."""
    areas: "FrameAreas | None" = None  # None: none have been placed yet
    assessment: Assessment | None = None  # the last one; None: before any


class Reported(NamedTuple):
    """A report, and its state in the monitor's frame."""

    report: Report
    state: VehicleState[Ground]


class AreaSource(NamedTuple):
    """What areas in a frame follow from."""

    reported: Held[AreaReport]
    fixed: tuple[GeodeticArea, ...]
    frame: LocalFrame
    undulation: float | None  # of the geoid above the ellipsoid, m; None: unknown


class FrameAreas(NamedTuple):
    """The areas of a situation in the monitor's frame, and what they follow from."""

    source: AreaSource
    placed: tuple[Placed, ...]


def read_plan(message: "Trajectory", thresholds: Thresholds) -> Published:
    """Return a plan called SAFE that a monitor with some thresholds can judge, or raise
    :class:`FieldError`.
    """
    count = thresholds.options.waypoints
    if message.status != STATUS_SAFE:
        raise FieldError("trajectory.status", f"is {message.status}, expected {STATUS_SAFE} (SAFE)")
    if len(message.waypoints) != count:
        raise FieldError(
            "trajectory.waypoints", f"has {len(message.waypoints)} points, expected {count}"
        )
    plan = trajectory(message)
    try:
        thresholds.in_wind(Wind(*plan.wind, plan.wind_std))
    except RequestError as error:
        raise FieldError(f"trajectory.{error.field}", error.problem) from error
    return plan


def initial(
    thresholds: Thresholds, unknown: Unknown = USUAL, categories: Categories = NO_CATEGORIES
) -> Supervision:
    """Return a monitor without a plan; ``unknown`` is taken for what reports lack."""
    watch = single.begin(thresholds)
    return Supervision(
        watch.monitor, watch.names, thresholds, unknown=unknown, categories=categories
    )


def activate(supervision: Supervision, situation: Situation, published: Published) -> Supervision:
    """Begin to monitor a plan; one that is not newer than those before is passed over."""
    if published.revision <= supervision.revision:
        return supervision
    frame, zero = supervision.frame, supervision.zero
    start = published.start
    at_start = start.latitude, start.longitude
    if frame is None or supervision.published_plan is None or not serves(frame, at_start):
        # Nothing that is remembered outlives a change of the frame.
        frame, zero = LocalFrame(*at_start), published.began
        fresh = initial(supervision.thresholds, supervision.unknown, supervision.categories)
        supervision = replace(
            fresh,
            frame=frame,
            zero=zero,
            areas=supervision.areas,
            assessment=supervision.assessment,
        )
    supervision = _comparing(supervision, situation)
    own, waypoints = to_frame(frame, published)
    wind = wind_of(frame, published)
    altitude = start.altitude
    if not published.climbs:
        altitude = _own_altitude(supervision, situation, published.began)
    tracks = ((name, situation.traffic.get(name)) for name in published.identifiers)
    intruders = {
        name: _intruder(
            supervision,
            situation,
            _placed(frame, track.estimate, None),
            wind or NO_WIND,
            published.began,
        )
        for name, track in tracks
        if track is not None and track.estimate is not None
    }
    watch = single.activate(
        supervision,
        reconstruct(waypoints, wind),
        own,
        intruders,
        _clock(zero, published.began),
        own_altitude=altitude,
    )
    return replace(watch, published_plan=published, revision=published.revision)


def withdraw(supervision: Supervision, revision: int) -> Supervision:
    """Withdraw the plan: the backup is flown until there is another."""
    if revision <= supervision.revision:
        return supervision
    supervision = replace(supervision, revision=revision, published_plan=None)
    if supervision.frame is None or _state(supervision) is State.IDLE:
        return supervision
    return single.activate(supervision, reconstruct(()), _UNKNOWN, {}, 0.0)


def step_monitor(supervision: Supervision, situation: Situation, moment: int) -> Supervision:
    """Return the monitor after the present moment, ns, with its assessment; it has none before the
    first plan.
    """
    frame, zero = supervision.frame, supervision.zero
    if frame is None:
        return supervision
    supervision = _comparing(supervision, situation)
    own, own_age = None, 0.0
    track = situation.own
    if track.last is not None and track.fault is None:
        own, own_age = to_local(frame, track.last), _age(zero, track.last.time, moment)
    traffic = _traffic(supervision, situation, moment)
    areas = _place_areas(supervision.areas, situation, frame, moment)
    watch, assessment = single.step(
        supervision,
        _clock(zero, moment),
        own,
        traffic.intruders,
        own_age=own_age,
        own_altitude=_own_altitude(supervision, situation, moment),
        gone=traffic.forgotten,
        areas=[area for placed_areas in areas.placed for area in placed_areas.at(moment)],
    )
    return replace(
        watch,
        reported=MappingProxyType(traffic.reported),
        request_time=moment if assessment.ask is not None else supervision.request_time,
        areas=areas,
        assessment=assessment,
    )


class _Traffic(NamedTuple):
    """What the monitor is given of the traffic at a moment."""

    intruders: dict[str, Intruder[Ground]]  # of an unknown state where there is no good report
    reported: dict[str, Reported]  # that they were made of
    forgotten: list[str]  # that it is to forget


def _traffic(supervision: Supervision, situation: Situation, moment: int) -> _Traffic:
    """Return what the monitor is given; who cannot come near is left out."""
    limits, watched = supervision.thresholds, supervision.names
    own, frame = situation.own.last, supervision.frame
    assert frame is not None, "reports are placed in a frame"
    reach = None if own is None else _reach(own, moment, supervision, situation)
    left_out = frozenset() if reach is None else _unusable_aircraft(situation, reach, limits)
    intruders: dict[str, Intruder[Ground]] = {}
    reported: dict[str, Reported] = {}
    for name, track in situation.traffic.items():
        if name in left_out:
            continue
        usable = track.fault is None and track.age(moment) <= limits.intruder_age
        if usable and reach is not None and _vertically_apart(track, reach, supervision):
            continue  # by its last report, which says nothing of an aircraft that is silent
        before = supervision.reported.get(name)
        report = track.estimate if track.fault is None else None
        if report is not None:
            reported[name] = _placed(frame, report, before)
            intruders[name] = _intruder(
                supervision, situation, reported[name], supervision.air.wind, moment
            )
        elif name not in watched:
            # An aircraft without any good report must be missed all the same.
            intruders[name] = Intruder(_UNKNOWN)
    silent = {
        name
        for name, track in situation.traffic.items()
        if track.fault is not None and name not in left_out
    }
    forgotten = [name for name in watched if name not in intruders and name not in silent]
    return _Traffic(intruders, reported, forgotten)


def _place_areas(
    previous: FrameAreas | None, situation: Situation, frame: LocalFrame, moment: int
) -> FrameAreas:
    """Return the areas in the monitor's frame, placed anew only where they are others: that takes
    longer than a step. Where one cannot be placed, for which the runner refuses to plan, those
    before stay.
    """
    fixed, undulation = situation.fixed_areas, _undulation(situation)
    source = AreaSource(situation.areas, fixed, frame, undulation)
    if previous is not None and previous.source == source:
        return previous
    try:
        return FrameAreas(source, situation.areas_in(frame, moment))
    except FieldError:
        if previous is None or previous.source.frame != frame:
            return FrameAreas(source, ())
        return FrameAreas(source, previous.placed)


def accept_answer(
    supervision: Supervision, number: int, published: Published | None
) -> tuple[Supervision, bool]:
    """Hand in what became of a request; None: there is no plan that may be flown. Return also
    whether it is flown.
    """
    frame = supervision.frame
    if frame is None or supervision.ask is None:
        return supervision, False
    if published is None:
        return single.answer(supervision, number, reconstruct(()))[0], False
    _, waypoints = to_frame(frame, published)
    # The runner began when the request arrived; the monitor counts from when it asked.
    late = (published.began - supervision.request_time) / SECOND
    shifted = tuple(replace(point, time=point.time + late) for point in waypoints)
    plan = reconstruct(shifted, wind_of(frame, published))
    watch, taken_up = single.answer(supervision, number, plan)
    revision = max(supervision.revision, published.revision)
    flown_plan = published if taken_up else supervision.published_plan
    return replace(watch, published_plan=flown_plan, revision=revision), taken_up


def fly_mode(supervision: Supervision) -> FlyMode:
    """Return what is to be flown now."""
    if supervision.frame is None or _state(supervision) is State.IDLE:
        return FlyMode.NOTHING
    return FlyMode.BACKUP if bool(supervision.monitor.on_backup[0]) else FlyMode.PLAN


def backup_began(supervision: Supervision) -> int | None:
    """Return when the current backup began, ns; None before the first own state."""
    started = float(supervision.monitor.backup.started[0])
    if supervision.frame is None or not math.isfinite(started):
        return None
    return supervision.zero + round(started * SECOND)


def backup_climb(supervision: Supervision) -> Climb | None:
    """Return the altitude of the current backup, its times from when it began; None: it is in the
    plane, or its altitude is unknown.
    """
    climb, started = supervision.backup_climb, float(supervision.monitor.backup.started[0])
    return None if climb is None else climb.since(started)


def backup(supervision: Supervision, altitude: Altitude | None) -> Published | None:
    """Return the current backup as a plan without a number; None before the first own state.

    ``altitude`` is the ownship's, which all points have of one in the plane. Otherwise they have
    that in which it levels off; those of a backup that climbs or descends have each their own.
    """
    began, frame = backup_began(supervision), supervision.frame
    if frame is None or began is None:
        return None
    rows = np.stack(single.backup_states(supervision), axis=-1).tolist()
    waypoints = [Waypoint(number, *row) for number, row in enumerate(rows)]
    climb = backup_climb(supervision)
    if climb is not None:
        begin = climb.at(0.0, supervision.thresholds.options)
        altitude = Altitude(begin.altitude, climb.reference, begin.climb)
        if supervision.monitor.backup.sense[0] == Sense.LEVEL_OFF:
            altitude = Altitude(float(climb.profile.altitude[-1]), climb.reference)
        else:
            start = replace(waypoints[0], altitude=begin.altitude, climb=begin.climb)
            waypoints = [start, *on_profile(waypoints[1:], climb.profile)]
    start, *points = geodetic_points(frame, waypoints, began, altitude)
    air = supervision.air.wind
    wind = true_wind(frame, air, start.latitude, start.longitude)
    return Published(bytes(16), 0, began, start, tuple(points), (), wind, float(air.std))


def serves(frame: LocalFrame, place: tuple[float, float]) -> bool:
    """Return whether a place, degrees, is near enough to a frame's origin to be monitored in it."""
    at = frame.place(*place)
    return math.hypot(float(at.x), float(at.y)) <= 0.5 * ACCURATE


def _reach(own: Report, moment: int, supervision: Supervision, situation: Situation) -> Reach:
    """Return what matters to the ownship while the plan that is held lasts."""
    published_plan, unknown = supervision.published_plan, supervision.unknown
    options = supervision.thresholds.options
    remaining = (
        0.0 if published_plan is None else (published_plan.points[-1].time - moment) / SECOND
    )
    horizon = max(remaining, _HORIZON * options.waypoints * options.interval)
    # The reported wind, or the plan's.
    winds = (own.wind or (0.0, 0.0), (0.0, 0.0) if published_plan is None else published_plan.wind)
    unsure = (
        unknown.wind_std if own.wind is None else unknown.reported_wind_std,
        0.0 if published_plan is None else published_plan.wind_std,
    )
    blows = max(math.hypot(*wind) for wind in winds) + options.requirement.sigmas * max(unsure)
    undulation, categories = _undulation(situation), supervision.categories
    return Reach.of_plans(options, own, moment, horizon, blows, categories, undulation)


def _comparing(supervision: Supervision, situation: Situation) -> Supervision:
    """Return the monitor with a floor and a ceiling that can be compared with altitudes."""
    thresholds = supervision.thresholds
    options = comparable(thresholds.options, _undulation(situation))
    if options == thresholds.options:
        return supervision
    return replace(supervision, thresholds=replace(thresholds, options=options))


def _undulation(situation: Situation) -> float | None:
    origin = situation.origin.value
    return None if origin is None else origin.undulation


def _own_altitude(supervision: Supervision, situation: Situation, moment: int) -> Altitude | None:
    """Return the ownship's altitude at a time, ns, by its last good report."""
    last = situation.own.last
    if last is None:
        return None
    climb = supervision.thresholds.options.unknown_climb
    return level(last.altitude, moment - last.time, _undulation(situation), climb)


def _vertically_apart(track: Track, reach: Reach, supervision: Supervision) -> bool:
    """Return whether an aircraft stays above or below the ownship by its last good report."""
    last = track.estimate
    if last is None:
        return False
    altitude = last.height(reach.unknown_climb)
    usual = supervision.thresholds.options.vertical_separation
    required = supervision.categories.vertical.get(last.category, usual)
    return abs(vertically_apart(reach.own, altitude, last.time, reach)) > required


def _unusable_aircraft(situation: Situation, reach: Reach, limits: Thresholds) -> frozenset[str]:
    """Return the aircraft whose reports cannot be used, and that cannot come near by their last
    places.
    """
    return frozenset(
        name
        for name, track in situation.traffic.items()
        if (track.fault is not None or track.age(reach.moment) > limits.intruder_age)
        and out_of_reach(track, reach) is not None
    )


def _state(supervision: Supervision) -> State:
    return State(int(supervision.monitor.state[0]))


def _clock(zero: int, time: int) -> float:
    return round((time - zero) / SECOND * _GRID) / _GRID


def _age(zero: int, time: int, moment: int) -> float:
    return _clock(zero, moment) - _clock(zero, time)


def _placed(frame: LocalFrame, report: Report, previous: Reported | None) -> Reported:
    """Return a report with its state in a frame; ``previous`` is what the aircraft had in it: to
    place every report of many aircraft anew takes longer than a step.
    """
    if previous is not None and previous.report is report:
        return previous
    return Reported(report, to_local(frame, report))


def _intruder(
    supervision: Supervision, situation: Situation, reported: Reported, wind: Wind, moment: int
) -> Intruder[Ground]:
    """Return a report in the monitor's frame, with its separations, its altitude and its turn
    through the air of a wind.
    """
    limits, report = supervision.thresholds, reported.report
    assumed = Assumptions(
        supervision.unknown,
        Turns.of(limits),
        supervision.categories,
        limits.options.unknown_climb,
        _undulation(situation),
    )
    age = _age(supervision.zero, report.time, moment)
    return intruder_of(report, reported.state, age, wind, assumed)
