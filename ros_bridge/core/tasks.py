"""The task: what is asked of the planner at one moment, as it follows from the situation, or why
nothing is.

All of it is values and pure functions; the node only feeds it. Every refusal carries one of the
codes of GenerateTrajectory, the field that is meant and a sentence.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from agents.planner.answer import Advisory, AdvisoryCode, Field, RequestError, Subject
from agents.planner.request.options import Narrowed
from agents.planner.request.request import Altitude, Intruder, Options, in_wind
from envs.areas import Area
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint
from envs.wind import NO_WIND, Wind, through_air, turn_through_air
from ros_bridge.core.categories import NO_CATEGORIES, Categories
from ros_bridge.core.conversions import Route
from ros_bridge.core.fields import SECOND, Code, FieldError, Refusal
from ros_bridge.core.freshness import USUAL_FRESHNESS, Freshness
from ros_bridge.core.intruders import Assumptions, intruder_of
from ros_bridge.core.motion import Turns, all_to_local, carry_on, ownship_wind, to_local, turn_of
from ros_bridge.core.reach import (
    Reach,
    comparable,
    level,
    out_of_reach,
)
from ros_bridge.core.reports import USUAL, Report, Unknown
from ros_bridge.core.situation import ACCURATE, Held, Situation
from ros_bridge.core.tracks import ReportCheck, Track, sharing

__all__ = [
    "REQUEST_AGE",
    "AgeCodes",
    "LeftOut",
    "PlanTask",
    "Settings",
    "check_age",
    "in_terms_of_messages",
    "refusal_of",
    "task",
]

_T = TypeVar("_T")

_INVALID = {
    Subject.OWN: Code.INVALID_OWNSHIP,
    Subject.OWN_ALTITUDE: Code.INVALID_OWNSHIP,
    Subject.INTRUDERS: Code.INVALID_INTRUDER,
    Subject.ROUTE: Code.INVALID_ROUTE,
    Subject.WIND: Code.INVALID_OWNSHIP,
}
"""Status codes by what the planner refuses; others are INVALID_TASK."""

# What delays make of the ownship's echo.
_COPY_DISTANCE = 250.0  # m
_COPY_SPEED = 10.0  # m/s
_COPY_TURN = 0.2  # rad

_NUMBERED = re.compile(r"\bintruders\[(\d+)\]")  # an intruder as the planner's texts call it


class AgeCodes(NamedTuple):
    """Status codes of a stamp that cannot be used."""

    stale: Code
    future: Code


REQUEST_AGE = AgeCodes(Code.STALE_REQUEST, Code.FUTURE_REQUEST)


class _InputCodes(NamedTuple):
    """An input that there must be, and the status codes of what may be wrong with it."""

    name: str  # in fields of refusals
    missing: Code
    invalid: Code


_ORIGIN = _InputCodes("geo_reference", Code.NO_GEO_REFERENCE, Code.INVALID_GEO_REFERENCE)
_ROUTE = _InputCodes("route", Code.NO_ROUTE, Code.INVALID_ROUTE)


class _AircraftCodes(NamedTuple):
    """An aircraft whose reports are planned with, and the status codes of what may be wrong."""

    name: str  # in fields of refusals
    missing: Code
    invalid: Code
    age: AgeCodes


_OWNSHIP = _AircraftCodes(
    "ownship",
    Code.NO_OWNSHIP,
    Code.INVALID_OWNSHIP,
    AgeCodes(Code.STALE_OWNSHIP, Code.FUTURE_OWNSHIP),
)


def _intruder_codes(name: str) -> _AircraftCodes:
    """Return what refusals say of an aircraft of the traffic."""
    age = AgeCodes(Code.STALE_INTRUDER, Code.FUTURE_INTRUDER)
    return _AircraftCodes(f"intruder {name}", Code.NO_INTRUDER, Code.INVALID_INTRUDER, age)


@dataclass(frozen=True)
class Settings:
    """How old inputs may be, and how plans are made."""

    options: Options
    turns: Turns
    freshness: Freshness = USUAL_FRESHNESS
    unknown: Unknown = USUAL  # what is taken for standard deviations that reports lack
    categories: Categories = NO_CATEGORIES  # separations by emitter category


class LeftOut(NamedTuple):
    """An aircraft that a plan takes no account of."""

    name: str
    reason: str


class _Traffic(NamedTuple):
    """The traffic of a task."""

    names: list[str]  # of the intruders, in their order
    intruders: list[Intruder[Ground]]
    excluded: list[LeftOut]


@dataclass(frozen=True)
class PlanTask:
    """What is handed to the planner."""

    frame: LocalFrame
    time: int  # of the request, ns
    own: VehicleState[Ground]
    own_altitude: Altitude | None
    identifiers: tuple[str, ...]  # of the intruders, in their order
    intruders: tuple[Intruder[Ground], ...]
    excluded: tuple[LeftOut, ...]  # aircraft that the plan takes no account of
    route: Route
    points: tuple[RoutePoint, ...]
    options: Options
    notes: tuple[Advisory, ...]  # what was assumed
    wind: Wind = NO_WIND  # in the frame
    areas: tuple[Area, ...] = ()  # as of the request


def task(
    situation: Situation, moment: int, settings: Settings, requested_route: Route | None = None
) -> PlanTask:
    """Return the task at a moment, ns, for the route of a request or else the published one.

    Raises :class:`Refusal` where something is missing, stale, from the future, invalid or
    inconsistent.
    """
    if moment <= 0:
        raise Refusal(
            Code.NO_CLOCK,
            "clock",
            "stands at zero, expected a running clock (is /clock published?)",
        )
    frame, undulation = _newest_usable(situation.origin, _ORIGIN, "has not been received")
    fresh = settings.freshness
    report = _usable_report(situation.own, _OWNSHIP, moment, fresh.own, fresh.future)
    wind, notes = _wind(frame, report, settings)
    own = _own_state(frame, situation.own, report, wind, moment, settings)
    from_origin = math.hypot(own.x, own.y)
    if from_origin > ACCURATE:
        raise Refusal(Code.INVALID_OWNSHIP, "ownship.position", _too_far(from_origin))
    alerted = _aircraft_of_alert(situation, moment, settings)
    unknown_climb = settings.options.unknown_climb
    own_altitude = level(report.altitude, moment - report.time, undulation, unknown_climb)
    route, places = _route(situation, frame, requested_route)
    points, of_altitude = _with_altitudes(places, route, own_altitude, undulation, settings)
    reach = _reach(report, undulation, own, points, wind, moment, settings)
    traffic = _traffic(situation, _Frame(frame, wind), moment, settings, alerted, reach)
    return PlanTask(
        frame=frame,
        time=moment,
        own=own,
        own_altitude=own_altitude,
        identifiers=tuple(traffic.names),
        intruders=tuple(traffic.intruders),
        excluded=tuple(traffic.excluded),
        route=route,
        points=points,
        options=comparable(settings.options, undulation),
        notes=notes + of_altitude + tuple(_advisories(own, traffic, situation, settings.unknown)),
        wind=wind,
        areas=_areas(situation, frame, moment),
    )


def _own_state(
    frame: LocalFrame, track: Track, report: Report, wind: Wind, moment: int, settings: Settings
) -> VehicleState[Ground]:
    """Return the ownship's state at a moment, ns, on the turn that its reports show."""
    state = to_local(frame, report)
    last = track.estimate or report
    turn = turn_through_air(state, turn_of(last, settings.turns), wind)
    carried = carry_on(state, turn, math.inf, (moment - report.time) / SECOND, wind)
    return VehicleState(*(float(value) for value in carried))


def _reach(
    report: Report,
    undulation: float | None,
    own: VehicleState[Ground],
    points: Sequence[RoutePoint],
    wind: Wind,
    moment: int,
    settings: Settings,
) -> Reach:
    """Return who may matter to a plan along a route, at a moment, ns: the ownship's report, and its
    state over the ground then.
    """
    options = settings.options
    x = np.array([point.x for point in points])
    y = np.array([point.y for point in points])
    blows = float(wind.speed) + options.requirement.sigmas * float(wind.std)
    airspeed = through_air(own, wind, 0.0).speed
    end = _options_in_wind(options, wind).latest_end(airspeed, x, y, wind=float(wind.speed))
    return Reach.of_plans(
        options, report, moment, float(end), blows, settings.categories, undulation
    )


def _areas(situation: Situation, frame: LocalFrame, moment: int) -> tuple[Area, ...]:
    """Return the areas that there are, as of a moment, ns."""
    fault = situation.areas.fault
    if fault is not None:
        raise Refusal(Code.INVALID_TASK, fault.field, fault.problem)
    try:
        return tuple(
            area for placed in situation.areas_in(frame, moment) for area in placed.at(moment)
        )
    except FieldError as error:
        raise Refusal(Code.INVALID_TASK, error.field, error.problem) from error


def refusal_of(error: RequestError, task: PlanTask) -> Refusal:
    """Return the planner's refusal of a task in terms of the messages that it came from."""
    about = error.about
    if about is None or (about.subject is Subject.INTRUDERS and about.number is None):
        code = Code.INVALID_TASK
    else:
        code = _INVALID.get(about.subject, Code.INVALID_TASK)
    return Refusal(
        code, in_terms_of_messages(about or error.field, task.identifiers), error.problem
    )


def in_terms_of_messages(field_: Field | str, identifiers: Sequence[str]) -> str:
    """Return a field of the planner's request, or a sentence about it, in terms of messages:
    intruders by their names.
    """
    if not isinstance(field_, Field):
        return _NUMBERED.sub(lambda match: f"intruder {identifiers[int(match[1])]}", field_)
    if field_.number is None:
        return str(field_)
    if field_.subject is not Subject.INTRUDERS:
        return str(field_)
    return field_.within(f"intruder {identifiers[field_.number]}")


def _advisories(
    own: VehicleState[Ground], traffic: _Traffic, situation: Situation, unknown: Unknown
) -> Iterator[Advisory]:
    """Yield what is assumed of each intruder, and whether it may be a copy of the ownship."""
    pairs = zip(traffic.names, traffic.intruders, strict=True)
    for number, (name, intruder) in enumerate(pairs):
        yield from _assumptions(number, situation.traffic[name], unknown)
        if _is_like(own, intruder.state):
            copy = Field(Subject.INTRUDERS, number=number)
            text = "is at the ownship's place and velocity; a copy of it (TIS-B) is not recognised"
            yield Advisory(AdvisoryCode.POSSIBLE_COPY, copy, text)


def _assumptions(number: int, track: Track, unknown: Unknown) -> Iterator[Advisory]:
    """Yield what an intruder's report lacks, and what is taken for it."""
    report = track.estimate
    assert report is not None, "there is one beside every usable report"
    assumed = (
        ("position_std", unknown.position_std, "m"),
        ("velocity_std", unknown.velocity_std, "m/s"),
    )
    for name, value, unit in assumed:
        if getattr(report, name) is None:
            field_ = Field(Subject.INTRUDERS, name, number)
            text = f"is unknown and taken as {value:g} {unit}"
            yield Advisory(AdvisoryCode.ASSUMED, field_, text)
    if report.time_std > 0.0:
        field_ = Field(Subject.INTRUDERS, "header.stamp", number)
        text = f"is known within {report.time_std:.2g} s (one sigma)"
        yield Advisory(AdvisoryCode.TIME_UNCERTAIN, field_, text)
    for name, text in () if track.course is None else track.course.corrections:
        yield Advisory(AdvisoryCode.ASSUMED, Field(Subject.INTRUDERS, name, number), text)
    if track.divided:
        text = "is a name of several aircraft, which are told apart by their places"
        yield Advisory(AdvisoryCode.ASSUMED, Field(Subject.INTRUDERS, "id", number), text)


def check_age(codes: AgeCodes, name: str, age: float, oldest: float, future: float) -> None:
    """Refuse a stamp, called ``name``, that is too old or ahead; s."""
    if age > oldest:
        problem = f"is {age:.2f} s old, expected {oldest:g} s at most"
        raise Refusal(codes.stale, name, problem)
    if -age > future:
        problem = f"is {-age:.2f} s ahead of the clock, expected {future:g} s at most"
        raise Refusal(codes.future, name, problem)


def _newest_usable(message: Held[_T], codes: _InputCodes, missing: str) -> _T:
    """Return an input that there must be, whose newest message can be used."""
    if message.fault is not None:
        raise Refusal(codes.invalid, message.fault.field, message.fault.problem)
    if message.value is None:
        raise Refusal(codes.missing, codes.name, missing)
    return message.value


def _usable_report(
    track: Track, codes: _AircraftCodes, moment: int, oldest: float, future: float
) -> Report:
    """Return the last good report of an aircraft if nothing newer spoils it and it is fresh."""
    if track.fault is not None:
        ahead = track.fault.check is ReportCheck.FUTURE
        code = codes.age.future if ahead else codes.invalid
        raise Refusal(code, track.fault.field, track.fault.problem)
    if track.last is None:
        raise Refusal(codes.missing, codes.name, "has not been received")
    stamp = f"{codes.name}.header.stamp"
    check_age(codes.age, stamp, track.age(moment), oldest, future)
    return track.last


def _aircraft_of_alert(situation: Situation, moment: int, settings: Settings) -> frozenset[str]:
    """Return the aircraft that an alert that holds is about."""
    alert, fault = situation.alert
    # What cannot be read counts for as long as what can.
    if fault is not None and (moment - fault.arrived) / SECOND <= settings.freshness.alert:
        raise Refusal(Code.INVALID_ALERT, fault.field, fault.problem)
    if alert is None or (moment - alert.time) / SECOND > settings.freshness.alert:
        return frozenset()
    followed = {name: sharing(situation.traffic, name) for name in alert.identifiers}
    unknown = [name for name, aircraft in followed.items() if not aircraft]
    if unknown:
        problem = (
            f"is the subject of an alert of level {alert.level}, and no state of it has been "
            "received"
        )
        raise Refusal(Code.NO_INTRUDER, f"intruder {unknown[0]}", problem)
    return frozenset(name for aircraft in followed.values() for name in aircraft)


def _is_like(own: VehicleState[Ground], intruder: VehicleState[Ground]) -> bool:
    """Return whether an aircraft is reported where the ownship is, and as it flies."""
    turn = math.remainder(own.heading - intruder.heading, 2.0 * math.pi)
    near = math.hypot(own.x - intruder.x, own.y - intruder.y) < _COPY_DISTANCE
    return near and abs(own.speed - intruder.speed) < _COPY_SPEED and abs(turn) < _COPY_TURN


class _Frame(NamedTuple):
    """A local frame and the wind in it."""

    local: LocalFrame
    wind: Wind


def _traffic(
    situation: Situation,
    frame: _Frame,
    moment: int,
    settings: Settings,
    alerted: frozenset[str],
    reach: Reach,
) -> _Traffic:
    """Return the intruders at a moment, ns, and who is left out.

    Raises :class:`Refusal` for an aircraft that cannot be planned with, unless it is out of reach
    and no alert is about it.
    """
    names, reports, excluded = list[str](), list[Report](), list[LeftOut]()
    fresh = settings.freshness
    for name, track in sorted(situation.traffic.items()):
        codes = _intruder_codes(name)
        try:
            _usable_report(track, codes, moment, fresh.intruder, fresh.future)
        except Refusal:
            reason = None if name in alerted else out_of_reach(track, reach)
            if reason is None:
                raise
            excluded.append(LeftOut(name, reason))
            continue
        assert track.estimate is not None, "there is one beside every usable report"
        names.append(name)
        reports.append(track.estimate)
    assumed = Assumptions(
        settings.unknown,
        settings.turns,
        settings.categories,
        reach.unknown_climb,
        reach.undulation,
    )
    intruders = [
        intruder_of(report, state, (moment - report.time) / SECOND, frame.wind, assumed)
        for report, state in zip(reports, all_to_local(frame.local, reports), strict=True)
    ]
    return _Traffic(names, intruders, excluded)


def _route(
    situation: Situation, frame: LocalFrame, requested: Route | None
) -> tuple[Route, tuple[RoutePoint, ...]]:
    missing = "has not been received, and the request holds none"
    route = requested or _newest_usable(situation.route, _ROUTE, missing)
    local = frame.place([point.latitude for point in route], [point.longitude for point in route])
    for number, from_origin in enumerate(np.hypot(local.x, local.y).tolist()):
        if from_origin > ACCURATE:
            raise Refusal(Code.INVALID_ROUTE, f"route.waypoints[{number}]", _too_far(from_origin))
    places = zip(route, local.x.tolist(), local.y.tolist(), strict=True)
    return route, tuple(RoutePoint(point.index, x, y) for point, x, y in places)


def _with_altitudes(
    points: tuple[RoutePoint, ...],
    route: Route,
    own: Altitude | None,
    undulation: float | None,
    settings: Settings,
) -> tuple[tuple[RoutePoint, ...], tuple[Advisory, ...]]:
    """Return a route's points with the altitudes that plans which may climb keep, and what is said
    of those that cannot be compared with the ownship's.
    """
    if not settings.options.climbs or own is None:
        return points, ()
    levels = [level(station.altitude, 0, undulation, 0.0) for station in route]
    incomparable = [
        altitude
        for altitude in levels
        if altitude is not None and altitude.reference != own.reference
    ]
    heights = [
        altitude.value if altitude is not None and altitude.reference == own.reference else None
        for altitude in levels
    ]
    points_at_altitude = tuple(
        replace(point, altitude=height) for point, height in zip(points, heights, strict=True)
    )
    if not incomparable:
        return points_at_altitude, ()
    text = (
        f"is that of {incomparable[0].reference}, not comparable with the ownship's, "
        f"{own.reference}, and not kept"
    )
    return points_at_altitude, (Advisory(AdvisoryCode.ASSUMED, "route.altitude", text),)


def _too_far(far: float) -> str:
    return f"is {far / 1e3:.0f} km from the geo-reference, expected {ACCURATE / 1e3:.0f} km at most"


def _wind(
    frame: LocalFrame, report: Report, settings: Settings
) -> tuple[Wind, tuple[Advisory, ...]]:
    """Return the wind at the ownship, in a frame, with what is said of one that it does not
    report.
    """
    wind = ownship_wind(frame, report, settings.unknown)
    if report.wind is None:
        calm = f"is unknown and taken as calm within {wind.std:.2g} m/s (one sigma)"
        return wind, (Advisory(AdvisoryCode.WIND_UNKNOWN, "ownship.wind", calm),)
    return wind, ()


def _options_in_wind(options: Options, wind: Wind) -> Options[Narrowed]:
    """Return the options that plans in a wind are made with; refused is one that the aircraft
    cannot fly against.
    """
    try:
        return in_wind(options, wind)
    except RequestError as error:
        raise Refusal(Code.INVALID_OWNSHIP, f"ownship.{error.field}", error.problem) from error
