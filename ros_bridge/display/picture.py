"""The picture: what the page draws, as one JSON document, from what is known and the time.

``docs/reference/display.md`` documents the fields. Places are metres east and north of ``origin``
on its map (:mod:`envs.formats.local_frame`); aircraft are carried on from their last report, with
the turn that their reports show. Every picture is whole: one that is lost changes nothing.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Cause
from envs.areas import Area, AreaError, Circle, Keep, Level
from envs.arrays import Array
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import Legs, Waypoint, at, legs, plan_states
from ros_bridge.core.areas import to_local
from ros_bridge.core.conversions import PlanPoint, Published, Route
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.reach import level
from ros_bridge.core.replies import wind_of
from ros_bridge.core.reports import Report
from ros_bridge.core.status import Status
from ros_bridge.core.tracks import Track
from ros_bridge.display.scene import Guidance, Health, HeldAreas, Monitor, Scene

VERSION = 2
"""Of the document; it changes where a field changes its meaning or goes."""

_TURN = 15.0  # s that an aircraft is expected to turn on after its report
_STEP = 4.0  # s between the points of a drawn plan
_POINTS = 400  # of a drawn plan at most
_NEAR = 100_000.0  # m from the ownship that areas are drawn
_COASTING = 0.5  # share of the age that counts, from which on an aircraft is marked as carried on
_BANDS = 5.0  # s that bands hold
_LATE = {"guidance": _BANDS, "diagnostics": 3.0}  # s without a message
_HELD_COURSE = 2.0  # degrees; turns smaller than this are none
_HELD_SPEED = 1.5  # m/s; changes smaller than this are none
_PROXIMATE = 6.0 * 1852.0, 1200.0 * 0.3048
"""m: traffic without an alert that is nearer than both horizontally and vertically is *proximate*
(RTCA DO-185B: 6 NM and 1200 ft)."""
_PROXIMATE_SEPARATIONS = 10.0  # the same horizontally for small separations
_NO_CLIMB = 10.0  # m/s either way where it is unknown, as the nodes' parameter unknown_climb
_REMARKS = Cause.OUTSIDE_RANGE  # causes that ask for nothing
_NAMES = {
    "ownship": "ownship",
    "traffic": "traffic",
    "alerts": "alerts",
    "route": "route",
    "geo_reference": "geo-reference",
    "areas": "areas",
    "trajectory": "plan",
    "advisory": "advisory",
    "status": "monitor",
    "backup": "backup",
    "guidance": "bands",
    "diagnostics": "diagnostics",
    "receiver": "receiver",
}

_OK = Health(0, 0, "")
_SILENT = Health(0, 3, "silent")

Document = dict[str, Any]


def picture(scene: Scene, now: int, centre: tuple[float, float] | None = None) -> Document:
    """Return the picture of a scene at a time, ns.

    Args:
        scene: what is known.
        now: the time of the source's clock.
        centre: latitude and longitude, degrees, that the map is drawn about where the ownship is
            unknown; None: the first aircraft.
    """
    scene = scene.at(now)
    frame = _frame(scene, centre)
    if frame is None:
        return empty(scene, now)
    levels = _levels(scene, now)
    own, traffic = _aircraft(scene, frame, levels, now)
    report = scene.situation.own.last
    wind = None if report is None else report.wind
    document = empty(scene, now) | {
        "origin": [frame.latitude, frame.longitude],
        "own": own,
        "traffic": traffic,
        "wind": None if wind is None else _round(wind),
        "frame": "ground" if wind is None else "air",
        "plan": _trajectory(scene.plan, frame, wind, now),
        "backup": _trajectory(_backup_to_fly(scene, now), frame, wind, now),
        "unresolved": _trajectory(scene.unresolved, frame, wind, now),
        "route": _route(scene.situation.route.value, frame),
        "areas": _areas(scene.areas, frame, now),
        "bands": _bands(scene.guidance, now),
        "alerts": _alerts(levels, _area_levels(scene, now)),
    }
    document["advice"] = advice(document)
    return document


def empty(scene: Scene, now: int) -> Document:
    """Return a picture without a map."""
    return {
        "type": "picture",
        "version": VERSION,
        "time": round(now / SECOND, 3),
        "origin": None,
        "own": None,
        "traffic": [],
        "separation": scene.separation,
        "wind": None,
        "frame": "ground",
        "plan": None,
        "backup": None,
        "unresolved": None,
        "route": [],
        "goal": None,
        "areas": [],
        "bands": None,
        "monitor": _monitor(scene.monitor, now, scene.fresh.monitor),
        "alerts": [],
        "advice": {"do": "nothing"},
        "health": list(_health(scene, now)),
    }


def _frame(scene: Scene, centre: tuple[float, float] | None) -> LocalFrame | None:
    """Return the map: about the ownship's place, in steps, so that the origin seldom moves."""
    own = scene.situation.own.last
    if own is not None:
        # A grid of a fifth of a degree: everything that matters is within 60 km of its point.
        step = 0.2
        stretched = step / max(math.cos(math.radians(own.latitude)), 0.1)
        return LocalFrame(
            max(min(round(own.latitude / step) * step, 90.0), -90.0),
            math.remainder(round(own.longitude / stretched) * stretched, 360.0),
        )
    if centre is not None:
        return LocalFrame(*centre)
    for track in scene.situation.traffic.values():
        if track.last is not None:
            return LocalFrame(round(track.last.latitude), round(track.last.longitude))
    return None


def _last(track: Track) -> Report:
    report = track.last if track.estimate is None else track.estimate
    assert report is not None
    return report


class _Alert(NamedTuple):
    """Of an intruder or an area."""

    level: int
    loss: float | None  # until the separation is lost, s; None: it is not


_NO_ALERT = _Alert(0, None)


def _aircraft(
    scene: Scene, frame: LocalFrame, levels: Mapping[str, _Alert], now: int
) -> tuple[Document | None, list[Document]]:
    """Return the ownship, None where it is unknown, and the traffic, sorted by name."""
    own, origin = scene.situation.own, scene.situation.origin.value
    traffic = {
        name: track
        for name, track in sorted(scene.situation.traffic.items())
        if track.last is not None
    }
    tracks = list(traffic.values())
    planes = _planes(tracks if own.last is None else [*tracks, own], frame, now, scene.fresh)
    own_plane = None
    if own.last is not None:
        own_plane = planes.pop()
        own_plane["state"] = _state(own, now, math.inf, scene.fresh.own)
        own_plane["air"] = _through_air(own.last.east, own.last.north, own.last.wind)
    undulation = None if origin is None else origin.undulation
    for (name, track), plane in zip(traffic.items(), planes, strict=True):
        plane["level"], plane["loss"] = levels.get(name, _NO_ALERT)
        plane["relative_altitude"] = _relative(own.last, _last(track), now, undulation)
        plane["separation"] = scene.by_category.get(_last(track).category)
        plane["proximate"] = own_plane is not None and _is_proximate(
            plane, own_plane, scene.separation
        )
    return own_plane, planes


def _is_proximate(plane: Document, own: Document, separation: float | None) -> bool:
    """Return whether traffic without an alert is near; a height that is not known is the same."""
    most, high = _PROXIMATE
    if separation is not None:
        most = min(most, _PROXIMATE_SEPARATIONS * separation)
    above = plane["relative_altitude"]
    near = math.hypot(plane["x"] - own["x"], plane["y"] - own["y"]) < most
    return plane["level"] == 0 and near and (above is None or abs(above) < high)


class _Motion(NamedTuple):
    """Aircraft on the map now; fields ``[K]``."""

    x: Array  # m
    y: Array
    vx: Array  # m/s
    vy: Array
    track_deg: Array  # true
    age: Array  # of the reports, s


def _planes(
    tracks: Sequence[Track], frame: LocalFrame, now: int, fresh: Freshness
) -> list[Document]:
    """Return the aircraft at a time, ns; each has a report."""
    if not tracks:
        return []
    motion = _carry_on(tracks, frame, now)
    return [_plane(track, motion, number, now, fresh) for number, track in enumerate(tracks)]


def _carry_on(tracks: Sequence[Track], frame: LocalFrame, now: int) -> _Motion:
    """Return where aircraft are at a time, ns: on a turn from the report on, for some seconds, and
    straight on after it.
    """
    reports = [_last(track) for track in tracks]
    here = frame.place([one.latitude for one in reports], [one.longitude for one in reports])
    east = np.array([one.east for one in reports])
    north = np.array([one.north for one in reports])
    along, across = here.velocity(east, north)
    age = np.array([(now - one.time) / SECOND for one in reports])
    turning = np.clip(age, 0.0, _TURN)
    angle = np.array([track.turn_rate for track in tracks]) * turning
    # The chord of an arc points half-way through its turn; numpy's sinc(x) is sin(pi x) / (pi x).
    chord = np.sinc(0.5 * angle / np.pi) * turning
    cx, cy = _rotate(along, across, 0.5 * angle)
    vx, vy = _rotate(along, across, angle)
    straight = age - turning
    return _Motion(
        x=here.x + chord * cx + straight * vx,
        y=here.y + chord * cy + straight * vy,
        vx=vx,
        vy=vy,
        track_deg=np.degrees(np.arctan2(vx, vy) + here.convergence) % 360.0,
        age=age,
    )


def _plane(track: Track, motion: _Motion, number: int, now: int, fresh: Freshness) -> Document:
    """Return an aircraft whose motion has a number."""
    report, age = _last(track), float(motion.age[number])
    height = report.altitude
    return {
        "id": report.identifier,
        "callsign": report.callsign,
        "x": round(float(motion.x[number]), 1),
        "y": round(float(motion.y[number]), 1),
        "vx": round(float(motion.vx[number]), 2),
        "vy": round(float(motion.vy[number]), 2),
        "track_deg": round(float(motion.track_deg[number]), 1),
        "speed": round(report.speed, 1),
        "turn_deg": round(math.degrees(track.turn_rate), 2) if age < _TURN else 0.0,
        "altitude": None if height is None else round(height.value, 1),
        "reference": None if height is None else height.reference,
        "climb": _tenths(None if height is None else height.vertical_speed),
        "age": round(age, 3),
        "state": _state(track, now, _COASTING * fresh.intruder, fresh.intruder),
        "fault": "" if track.fault is None else track.fault.message,
    }


def _through_air(east: float, north: float, wind: tuple[float, float] | None) -> Document:
    """Return direction, degrees, and speed, m/s, through the air of a velocity over the ground, m/s
    true east and north; over the ground where the wind is unknown.
    """
    x, y = (east, north) if wind is None else (east - wind[0], north - wind[1])
    track = math.degrees(math.atan2(x, y)) % 360.0
    return {"track_deg": round(track, 1), "speed": round(math.hypot(x, y), 1)}


def _rotate(x: np.ndarray, y: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    cosine, sine = np.cos(angle), np.sin(angle)
    return x * cosine - y * sine, x * sine + y * cosine


def _state(track: Track, now: int, coasting: float, stale: float) -> str:
    age = track.age(now)
    if track.fault is not None:
        return "faulty"
    if age > stale:
        return "stale"
    return "coasting" if age > coasting else "fresh"


def _relative(
    own: Report | None, other: Report, now: int, undulation: float | None
) -> float | None:
    """Return by how much an aircraft is above the ownship, m; None: not comparable."""
    if own is None:
        return None
    mine, theirs = (
        level(one.altitude, now - one.time, undulation, _NO_CLIMB) for one in (own, other)
    )
    if mine is None or theirs is None or mine.reference != theirs.reference:
        return None
    return round(theirs.value - mine.value, 1)


def _levels(scene: Scene, now: int) -> dict[str, _Alert]:
    """Return the alerts of intruders: of the monitor's bands and of other functions."""
    held = scene.guidance
    found = {} if held is None else _left(held.levels, held, now)
    alert = scene.situation.alert.value
    if alert is not None and (now - alert.time) / SECOND <= scene.fresh.alert:
        for name in alert.identifiers:
            before = found.get(name, _NO_ALERT)
            found[name] = before._replace(level=max(before.level, alert.level))
    return found


def _area_levels(scene: Scene, now: int) -> dict[str, _Alert]:
    """Return the alerts of areas, of the monitor's bands."""
    return {} if scene.guidance is None else _left(scene.guidance.areas, scene.guidance, now)


def _left(
    levels: Mapping[str, tuple[int, float]], guidance: Guidance, now: int
) -> dict[str, _Alert]:
    """Return alerts with the times to loss that are left. Old ones count no more."""
    since = (now - guidance.time) / SECOND
    if since > _BANDS:
        return {}
    return {
        name: _Alert(value, None if loss < 0.0 else round(max(loss - since, 0.0), 1))
        for name, (value, loss) in levels.items()
    }


def _alerts(intruders: Mapping[str, _Alert], areas: Mapping[str, _Alert]) -> list[Document]:
    """Return alerts, the highest level first, and of a level intruders first."""
    found = [
        {"id": name, "of": kind, "level": alert.level, "loss": alert.loss}
        for kind, alerts in (("intruder", intruders), ("area", areas))
        for name, alert in alerts.items()
        if alert.level > 0
    ]
    return sorted(found, key=lambda one: -one["level"])


def _bands(guidance: Guidance | None, now: int) -> Document | None:
    if guidance is None or (now - guidance.time) / SECOND > _BANDS:
        return None
    way_out = None
    if guidance.recovery >= 0:
        since = (now - guidance.time) / SECOND
        opens = guidance.recovery_time
        way_out = {
            "track_deg": guidance.tracks.target[guidance.recovery],
            "after": None if opens < 0.0 else round(max(opens - since, 0.0), 1),
            "shortfall": round(guidance.recovery_shortfall, 1),
        }
    return {
        "age": round((now - guidance.time) / SECOND, 2),
        "look_ahead": guidance.look_ahead,
        "track_deg": guidance.tracks.target,
        "track_region": guidance.tracks.region,
        "track_area": guidance.tracks.area,
        "speed": _round(guidance.speeds.target),
        "speed_region": guidance.speeds.region,
        "speed_area": guidance.speeds.area,
        "areas": list(guidance.areas),
        "recovery": way_out,
    }


def _backup_to_fly(scene: Scene, now: int) -> Published | None:
    """Return the backup while it is what is to be flown."""
    monitor = scene.monitor
    if monitor is None or _is_silent(monitor, now, scene.fresh.monitor):
        return None
    return scene.backup if monitor.status.fly is FlyMode.BACKUP else None


def _trajectory(
    one: Published | None, frame: LocalFrame, wind: tuple[float, float] | None, now: int
) -> Document | None:
    if one is None:
        return None
    line, points = _draw(one, frame)
    return {
        "revision": one.revision,
        "began": round(one.began / SECOND, 3),
        "line": line,
        "points": [
            {
                "index": point.index,
                "x": place[0],
                "y": place[1],
                "in": round((point.time - now) / SECOND, 1),
                "track_deg": round(point.track_deg, 1),
                "speed": round(point.speed, 1),
                "air": _through_air(*_velocity(point), wind),
                "of_route": point.of_route,
            }
            for point, place in zip(one.points, points, strict=True)
        ],
    }


def _velocity(point: PlanPoint) -> tuple[float, float]:
    """Return the velocity over the ground at a waypoint, true east and north, m/s."""
    track = math.radians(point.track_deg)
    return point.speed * math.sin(track), point.speed * math.cos(track)


@lru_cache(maxsize=8)
def _draw(one: Published, frame: LocalFrame) -> tuple[list[list[float]], list[list[float]]]:
    """Return the curve of a plan, x, y in m and the time in s of the source's clock, and its
    waypoints.
    """
    every = (one.start, *one.points)
    here = frame.place([point.latitude for point in every], [point.longitude for point in every])
    states = [
        _on_map(point, float(here.x[n]), float(here.y[n]), float(here.convergence[n]), one.began)
        for n, point in enumerate(every)
    ]
    first = states[0]
    wind = wind_of(frame, one)
    start: VehicleState[Ground] = VehicleState(first.x, first.y, first.heading, first.speed)
    end, began = states[-1].time, one.began / SECOND
    times = np.linspace(0.0, end, 1 + min(math.ceil(end / _STEP), _POINTS))
    with np.errstate(all="ignore"):
        curve = legs(plan_states(start, states[1:], wind=wind))
        each = Legs(*(np.broadcast_to(part, (times.size, *np.shape(part))) for part in curve))
        state = at(each, times, wind)
    if not (np.isfinite(state.x).all() and np.isfinite(state.y).all()):
        # No aircraft flies it; what was said is drawn all the same.
        straight = [[round(s.x, 1), round(s.y, 1), round(began + s.time, 2)] for s in states]
        return straight, [place[:2] for place in straight[1:]]
    line = [
        [round(float(x), 1), round(float(y), 1), round(began + float(time), 2)]
        for x, y, time in zip(state.x, state.y, times, strict=True)
    ]
    return line, [[round(point.x, 1), round(point.y, 1)] for point in states[1:]]


def _on_map(point: PlanPoint, x: float, y: float, convergence: float, began: int) -> Waypoint:
    heading = 0.5 * math.pi - math.radians(point.track_deg) + convergence
    return Waypoint(point.index, x, y, heading, point.speed, (point.time - began) / SECOND)


@lru_cache(maxsize=4)
def _route(route: Route | None, frame: LocalFrame) -> list[list[float]]:
    if not route:
        return []
    here = frame.place([one.latitude for one in route], [one.longitude for one in route])
    return [_round(one) for one in zip(here.x.tolist(), here.y.tolist(), strict=True)]


def _areas(held: HeldAreas | None, frame: LocalFrame, now: int) -> list[Document]:
    if held is None:
        return []
    later = (now - held.report.time) / SECOND
    return [_area(area, later) for area in _place(held, frame)]


def _area(area: Area, later: float) -> Document:
    """Return an area some seconds later. Only its place and size change here: checking its shape
    anew at every picture would take too long.
    """
    x, y = (later * speed for speed in area.velocity)
    shape: Document
    if isinstance(area.shape, Circle):
        circle = area.shape
        radius = max(circle.radius + later * area.growth, 0.0)
        shape = {"circle": _round((circle.x + x, circle.y + y, radius))}
        grown = 0.0
    else:
        rings, grown = area.shape.rings, later * area.growth
        shape = {"rings": [[_round((px + x, py + y)) for px, py in ring] for ring in rings]}
    return {
        "name": area.name,
        "keep": "in" if area.keep is Keep.IN else "out",
        "valid": area.valid_from <= later <= area.valid_until,
        "clearance": round(area.clearance, 1),
        "growth": round(area.growth, 1),
        "grown": round(grown, 1),
        **shape,
        "floor": _limit(area.floor),
        "ceiling": _limit(area.ceiling),
    }


def _limit(level: Level | None) -> list[Any] | None:
    """Return a height, m, and what it is above."""
    return None if level is None else [round(level.value, 1), level.reference]


@lru_cache(maxsize=2)
def _place(held: HeldAreas, frame: LocalFrame) -> tuple[Area, ...]:
    """Return areas on a map as they are at their own time; none where the map cannot hold them."""
    try:
        return to_local(held.report, frame, held.report.time, _NEAR)
    except (FieldError, AreaError):
        return ()


def _is_silent(monitor: Monitor, now: int, oldest: float) -> bool:
    """Return whether what a monitor said holds no longer, s."""
    return (now - monitor.time) / SECOND > oldest


def _monitor(monitor: Monitor | None, now: int, oldest: float) -> Document | None:
    if monitor is None:
        return None
    said, state = monitor.status, monitor.status.state.name.lower().replace("_", " ")
    if _is_silent(monitor, now, oldest):
        said, state = Status(reasons=("the monitor is silent",)), _SILENT.text
    return {
        "age": round((now - monitor.time) / SECOND, 2),
        "state": state,
        "fly": said.fly.name.lower(),
        **_reasons(said),
        "measured": said.measured,
        "cross_track": round(said.cross_track, 1),
        "along_track": round(said.along_track, 1),
        "time_error": round(said.time_error, 2),
        "separation": round(said.separation, 1) if said.separation >= 0.0 else None,
        "time_to_loss": round(said.time_to_loss, 1) if said.time_to_loss >= 0.0 else None,
    }


def _reasons(said: Status) -> Document:
    """Return why the monitor is in its state, and what else it remarks, which asks for nothing."""
    causes = [cause for cause in Cause if said.causes & cause]
    if len(causes) != len(said.reasons):
        return {"reasons": list(said.reasons), "remarks": []}
    each = list(zip(causes, said.reasons, strict=True))
    return {
        "reasons": [why for cause, why in each if cause not in _REMARKS],
        "remarks": [why for cause, why in each if cause in _REMARKS],
    }


def advice(document: Document) -> Document:
    """Return what to do by the rest of a picture, as a code and numbers that the page puts into
    words; directions and speeds are in the frame of the picture.
    """
    own, monitor = document["own"], document["monitor"]
    if own is None:
        return {"do": "nothing"}
    if monitor is not None:
        flown, plan = monitor["fly"], document["plan"]
        if flown != "nothing" and document[flown] is not None:
            return {"do": flown, **_manoeuvres(document[flown], own)}
        if monitor["state"] == "monitoring" and plan is not None:
            return {"do": "advised", **_manoeuvres(plan, own)}
    bands = document["bands"]
    highest = max((one["level"] for one in document["alerts"]), default=0)
    if bands is not None and highest > 0:
        return _way_out(bands, own)
    if monitor is None or monitor["state"] == _SILENT.text:
        return {"do": "nothing"}
    return {"do": "own route"}


def _manoeuvres(trajectory: Document, own: Document) -> Document:
    """Return what a trajectory asks for until its next waypoint, and the first change after it."""
    present = own["air"]
    coming = [point for point in trajectory["points"] if point["in"] > 0.0]
    if not coming:
        return {**present, "turn": "hold", "then": None}
    first = coming[0]["air"]
    then = None
    for before, after in itertools.pairwise(coming):
        was, will = before["air"], after["air"]
        turn = _turn(was["track_deg"], will["track_deg"])
        if turn != "hold" or abs(will["speed"] - was["speed"]) > _HELD_SPEED:
            then = {"turn": turn, **will, "in": before["in"]}
            break
    return {"turn": _turn(present["track_deg"], first["track_deg"]), **first, "then": then}


def _way_out(bands: Document, own: Document) -> Document:
    """Return the free direction that is nearest to the present one, or the way out; bands are
    through the air.
    """
    now, speed = own["air"]["track_deg"], own["air"]["speed"]
    if bands["recovery"] is not None:
        out = bands["recovery"]
        turn = _turn(now, out["track_deg"])
        return {"do": "recovery", "turn": turn, "speed": speed, **out}
    free = [
        target
        for target, region in zip(bands["track_deg"], bands["track_region"], strict=True)
        if region == 0
    ]
    if not free:
        return {"do": "nothing"}
    nearest = min(free, key=lambda target: abs(_apart(now, target)))
    turn = _turn(now, nearest)
    return {"do": "free", "track_deg": nearest, "turn": turn, "speed": speed}


def _apart(track: float, other: float) -> float:
    """Return the turn from one track to another, degrees, positive to the right."""
    return (other - track + 180.0) % 360.0 - 180.0


def _turn(track: float, other: float) -> str:
    apart = _apart(track, other)
    if abs(apart) <= _HELD_COURSE:
        return "hold"
    return "right" if apart > 0.0 else "left"


def _health(scene: Scene, now: int) -> Iterator[Document]:
    """Yield the inputs that were ever heard, or must be, and the nodes."""
    fresh = scene.fresh
    latest = {**_LATE, "status": fresh.monitor}
    for short, called in _NAMES.items():
        heard, problem = scene.arrived.get(short), scene.problems.get(short)
        if problem is not None:
            yield _health_line(called, problem, problem.time, now)
        elif short == "ownship":
            yield _health_line(called, _own_health(scene.situation.own, now, fresh.own), heard, now)
        elif heard is not None:
            late = (now - heard) / SECOND > latest.get(short, math.inf)
            yield _health_line(called, _SILENT if late else _OK, heard, now)
    for name, problem in sorted(scene.problems.items()):
        if name not in _NAMES:
            yield _health_line(name, problem, problem.time, now)
    for name, state in sorted(scene.nodes.items()):
        late = (now - state.time) / SECOND > _LATE["diagnostics"]
        yield _health_line(name, _SILENT if late else state, state.time, now)


def _own_health(own: Track, now: int, oldest: float) -> Health:
    if own.last is None:
        return Health(now, 2, "not heard yet")
    if own.fault is not None:
        return Health(now, 2, own.fault.message)
    return Health(now, 2, "silent") if own.age(now) > oldest else _OK


def _health_line(name: str, health: Health, heard: int | None, now: int) -> Document:
    """Return a line about what was heard at a time, ns; None: never."""
    age = None if heard is None else round((now - heard) / SECOND, 1)
    return {"name": name, "level": health.level, "text": health.text, "age": age}


def _tenths(value: float | None) -> float | None:
    return None if value is None else round(value, 1)


def _round(values: Sequence[float]) -> list[float]:
    return [round(float(one), 1) for one in values]
