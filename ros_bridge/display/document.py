"""The document of a picture: JSON as the page gets it, with the advice of the picture.

``docs/reference/display.md`` documents the fields.
"""

from typing import Any

from ros_bridge.display.advice import Advice, Change, Do, NextChange, advise
from ros_bridge.display.picture import (
    Disc,
    DrawnAlert,
    DrawnArea,
    DrawnBands,
    DrawnIntruder,
    DrawnMonitor,
    DrawnOwnship,
    DrawnPlan,
    DrawnPoint,
    Outline,
    Picture,
    Point,
    Tape,
)

VERSION = 2
"""Of the document; it changes where a field changes its meaning or goes."""

Document = dict[str, Any]


def to_json(picture: Picture) -> Document:
    """Return the document of a picture, which :func:`json.dumps` takes."""
    return {
        "type": "picture",
        "version": VERSION,
        "time": picture.time,
        "origin": _listed(picture.origin),
        "own": None if picture.own is None else _own(picture.own),
        "traffic": [_intruder(intruder) for intruder in picture.traffic],
        "separation": picture.separation,
        "wind": _listed(picture.wind),
        "frame": "ground" if picture.wind is None else "air",
        "plan": _plan(picture.plan),
        "backup": _plan(picture.backup),
        "unresolved": _plan(picture.unresolved),
        "route": picture.route,
        "goal": _listed(picture.goal),
        "areas": [_area(area) for area in picture.areas],
        "bands": None if picture.bands is None else _bands(picture.bands),
        "monitor": None if picture.monitor is None else _monitor(picture.monitor),
        "alerts": [_alert(alert) for alert in picture.alerts],
        "advice": _advice(advise(picture)),
        "health": [line._asdict() for line in picture.health],
    }


def _listed(values: Point | None) -> list[float] | None:
    return None if values is None else list(values)


def _own(own: DrawnOwnship) -> Document:
    return {**own.plane._asdict(), "air": own.air._asdict()}


def _intruder(intruder: DrawnIntruder) -> Document:
    return {
        **intruder.plane._asdict(),
        **intruder.threat._asdict(),
        "relative_altitude": intruder.relative_altitude,
        "separation": intruder.separation,
        "proximate": intruder.proximate,
    }


def _plan(plan: DrawnPlan | None) -> Document | None:
    if plan is None:
        return None
    return {
        "revision": plan.revision,
        "began": plan.began,
        "line": plan.line,
        "points": [_waypoint(point) for point in plan.points],
        "profile": plan.profile,
    }


def _waypoint(point: DrawnPoint) -> Document:
    return {
        "index": point.number,
        "x": point.x,
        "y": point.y,
        "in": point.remaining,
        "track_deg": point.track_deg,
        "speed": point.speed,
        "air": None if point.air is None else point.air._asdict(),
        "of_route": point.of_route,
        "altitude": point.altitude,
    }


def _area(area: DrawnArea) -> Document:
    return {
        "name": area.name,
        "keep": area.keep.value,
        "valid": area.valid,
        "clearance": area.clearance,
        "growth": area.growth,
        "grown": area.grown,
        **_shape(area.shape),
        "floor": _limit(area.floor),
        "ceiling": _limit(area.ceiling),
    }


def _shape(shape: Disc | Outline) -> Document:
    return {"circle": list(shape)} if isinstance(shape, Disc) else {"rings": shape.rings}


def _limit(limit: tuple[float, str] | None) -> list[Any] | None:
    """Return a height, m, and what it is above."""
    return None if limit is None else list(limit)


def _bands(bands: DrawnBands) -> Document:
    return {
        "age": bands.age,
        "look_ahead": bands.look_ahead,
        "track_deg": bands.tracks.target,
        **_tape(bands.tracks, "track"),
        "speed": bands.speeds.target,
        **_tape(bands.speeds, "speed"),
        **_up_and_down(bands.climbs, "vertical_speed"),
        **_up_and_down(bands.altitudes, "altitude"),
        "areas": bands.areas,
        "recovery": None if bands.recovery is None else bands.recovery._asdict(),
    }


def _up_and_down(tape: Tape | None, kind: str) -> Document:
    """Return bands up and down; no field where there are none."""
    return {} if tape is None else {kind: tape.target, **_tape(tape, kind)}


def _tape(tape: Tape, kind: str) -> Document:
    areas = {} if tape.area is None else {f"{kind}_area": tape.area}
    return {f"{kind}_region": tape.region, **areas}


def _monitor(monitor: DrawnMonitor) -> Document:
    state = "silent" if monitor.state is None else monitor.state.name.lower().replace("_", " ")
    codes = {"state": state, "fly": monitor.fly.name.lower()}
    return monitor._asdict() | codes


def _alert(alert: DrawnAlert) -> Document:
    return {"id": alert.id, "of": alert.of, **alert.threat._asdict()}


def _advice(advice: Advice) -> Document:
    change = {} if advice.change is None else _change(advice.change)
    way_out = {} if advice.way_out is None else advice.way_out._asdict()
    document = {"do": advice.do.value, **change, **way_out}
    if advice.do in (Do.PLAN, Do.BACKUP, Do.ADVISED):
        document["then"] = None if advice.then is None else _next_change(advice.then)
    return document


def _change(change: Change) -> Document:
    rise = {} if change.rise is None else change.rise._asdict()
    return {"turn": change.turn.value, **change.velocity._asdict(), **rise}


def _next_change(next_change: NextChange) -> Document:
    return {**_change(next_change.change), "in": next_change.remaining}
