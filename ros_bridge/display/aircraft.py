"""Ownship and traffic as they are drawn: where their last reports carry them to now."""

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from envs.arrays import Array, Float
from envs.backend import FLOATS
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.tracking.tracker import TURN_STEPS, lasting
from envs.wind import NO_WIND
from ros_bridge.core.courses import Course
from ros_bridge.core.fields import SECOND
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.motion import carry_on
from ros_bridge.core.reach import level
from ros_bridge.core.reports import EXACT, Report
from ros_bridge.core.tracks import Track
from ros_bridge.display.picture import (
    NO_THREAT,
    DrawnIntruder,
    DrawnOwnship,
    DrawnPlane,
    Threat,
    Velocity,
)
from ros_bridge.display.scene import DisplayScene

_COASTING = 0.5  # share of the age that counts, from which on an aircraft is marked as carried on
_PROXIMATE = 6.0 * 1852.0, 1200.0 * 0.3048
"""m: traffic without an alert that is nearer than both horizontally and vertically is *proximate*
(RTCA DO-185B: 6 NM and 1200 ft)."""
_PROXIMATE_SEPARATIONS = 10.0  # the same horizontally for small separations


def draw_aircraft(
    scene: DisplayScene, frame: LocalFrame, threats: Mapping[str, Threat], moment: int
) -> tuple[DrawnOwnship | None, list[DrawnIntruder]]:
    """Return the ownship, None where it is unknown, and the traffic, sorted by name."""
    own, fresh = scene.situation.own, scene.fresh
    traffic = [
        (name, track)
        for name, track in sorted(scene.situation.traffic.items())
        if track.last is not None
    ]
    tracks = [track for _, track in traffic]
    planes = _planes(tracks if own.last is None else [*tracks, own], frame, moment, fresh)
    drawn_own = None
    if own.last is not None:
        plane = planes.pop()._replace(state=_state(own, moment, math.inf, fresh.own))
        air = velocity_through_air(own.last.east, own.last.north, own.last.wind)
        drawn_own = DrawnOwnship(plane, air)
    return drawn_own, [
        _intruder(track, plane, threats.get(name, NO_THREAT), scene, drawn_own, moment)
        for (name, track), plane in zip(traffic, planes, strict=True)
    ]


def velocity_through_air(east: float, north: float, wind: tuple[float, float] | None) -> Velocity:
    """Return the velocity through the air of one over the ground, m/s true east and north;
    over the ground where the wind is unknown.
    """
    x, y = (east, north) if wind is None else (east - wind[0], north - wind[1])
    track = math.degrees(math.atan2(x, y)) % 360.0
    return Velocity(round(track, 1), round(math.hypot(x, y), 1))


def _intruder(
    track: Track,
    plane: DrawnPlane,
    threat: Threat,
    scene: DisplayScene,
    own: DrawnOwnship | None,
    moment: int,
) -> DrawnIntruder:
    origin, report = scene.situation.origin.value, _last(track)
    undulation = None if origin is None else origin.undulation
    above = _relative(scene.situation.own.last, report, moment, undulation)
    is_near = own is not None and _is_near(plane, own.plane, above, scene.separation)
    return DrawnIntruder(
        plane=plane,
        threat=threat,
        relative_altitude=above,
        separation=scene.by_category.get(report.category),
        proximate=threat.level == 0 and is_near,
    )


def _is_near(
    plane: DrawnPlane, own: DrawnPlane, above: float | None, separation: float | None
) -> bool:
    """Return whether traffic is near the ownship; a height that is not known is the same."""
    most, high = _PROXIMATE
    if separation is not None:
        most = min(most, _PROXIMATE_SEPARATIONS * separation)
    near = math.hypot(plane.x - own.x, plane.y - own.y) < most
    return near and (above is None or abs(above) < high)


def _relative(
    own: Report | None, intruder: Report, moment: int, undulation: float | None
) -> float | None:
    """Return by how much an aircraft is above the ownship, m; None: not comparable."""
    if own is None:
        return None
    # Only the values are shown, which an unknown climb does not change, not how unsure they are.
    mine, theirs = (
        level(report.altitude, moment - report.time, undulation, 0.0) for report in (own, intruder)
    )
    if mine is None or theirs is None or mine.reference != theirs.reference:
        return None
    return round(theirs.value - mine.value, 1)


class _Motion(NamedTuple):
    """Aircraft on the map now."""

    x: Float[Array, " K"]  # m
    y: Float[Array, " K"]
    vx: Float[Array, " K"]  # m/s
    vy: Float[Array, " K"]
    track_deg: Float[Array, " K"]  # true
    age: Float[Array, " K"]  # of the reports, s
    turns_on: Float[Array, " K"]  # for how long they are expected to turn on, s


def _planes(
    tracks: Sequence[Track], frame: LocalFrame, moment: int, fresh: Freshness
) -> list[DrawnPlane]:
    """Return the aircraft at a time, ns; each has a report."""
    if not tracks:
        return []
    motion = _carry_on(tracks, frame, moment)
    return [_plane(track, motion, number, moment, fresh) for number, track in enumerate(tracks)]


def _carry_on(tracks: Sequence[Track], frame: LocalFrame, moment: int) -> _Motion:
    """Return where aircraft are at a time, ns: on a turn over the ground from the report on, for
    some seconds, and straight on after it.
    """
    reports = [_last(track) for track in tracks]
    places = frame.place(
        [report.latitude for report in reports], [report.longitude for report in reports]
    )
    east = np.array([report.east for report in reports])
    north = np.array([report.north for report in reports])
    age = np.array([(moment - report.time) / SECOND for report in reports])
    heading = np.arctan2(north, east) + places.convergence
    start: VehicleState[Ground] = VehicleState(places.x, places.y, heading, np.hypot(east, north))
    rates = np.array([track.turn_rate for track in tracks])
    lasts = np.array([_turn_time(track) for track in tracks])
    state = carry_on(start, rates, lasts, age, NO_WIND)
    vx, vy = state.speed * np.cos(state.heading), state.speed * np.sin(state.heading)
    return _Motion(
        x=state.x,
        y=state.y,
        vx=vx,
        vy=vy,
        track_deg=np.degrees(np.arctan2(vx, vy) + places.convergence) % 360.0,
        age=age,
        turns_on=np.maximum(lasts - age, 0.0),
    )


def _turn_time(track: Track) -> float:
    """Return for how long after its report an aircraft is expected to go on with its turn, s."""
    return lasting(track.turn_rate, _last(track).turn_std, TURN_STEPS, FLOATS)


def _plane(track: Track, motion: _Motion, number: int, moment: int, fresh: Freshness) -> DrawnPlane:
    """Return an aircraft whose motion has a number."""
    report, age = _last(track), float(motion.age[number])
    height = report.altitude
    climb = None if height is None else height.vertical_speed
    turns_on = float(motion.turns_on[number])
    return DrawnPlane(
        id=report.identifier,
        callsign=report.callsign,
        x=round(float(motion.x[number]), 1),
        y=round(float(motion.y[number]), 1),
        vx=round(float(motion.vx[number]), 2),
        vy=round(float(motion.vy[number]), 2),
        track_deg=round(float(motion.track_deg[number]), 1),
        speed=round(report.speed, 1),
        turn_deg=round(math.degrees(track.turn_rate), 2) if turns_on > 0.0 else 0.0,
        turn_s=round(turns_on, 1),
        altitude=None if height is None else round(height.value + (climb or 0.0) * age, 1),
        reference=None if height is None else height.reference,
        climb=None if climb is None else round(climb, 1),
        age=round(age, 3),
        state=_state(track, moment, _COASTING * fresh.intruder, fresh.intruder),
        fault="" if track.fault is None else track.fault.message,
        accuracy=_accuracy(report, age),
        correction="" if track.course is None else _correction(track.course),
    )


def _accuracy(report: Report, age: float) -> float | None:
    """Return two sigmas of a position some seconds after its report, m; None: unknown."""
    if report.position_std is None or report.velocity_std is None:
        return None
    position, velocity = report.spread(EXACT)
    return round(2.0 * math.hypot(position, velocity * age), 1)


def _correction(course: Course) -> str:
    """Return what is not believed as it is reported."""
    return "; ".join(f"{field} {text}" for field, text in course.corrections)


def _last(track: Track) -> Report:
    report = track.last if track.estimate is None else track.estimate
    assert report is not None
    return report


def _state(
    track: Track, moment: int, coasting: float, stale: float
) -> Literal["fresh", "coasting", "stale", "faulty"]:
    age = track.age(moment)
    if track.fault is not None:
        return "faulty"
    if age > stale:
        return "stale"
    return "coasting" if age > coasting else "fresh"
