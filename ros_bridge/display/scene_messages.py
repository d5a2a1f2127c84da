"""A scene's values as messages of ``rlcas_msgs``: the inverse of
:func:`ros_bridge.display.scene.take`.

A message is a mapping of its fields, which a recording without ROS writes; fields that are left out
are 0 or empty. :mod:`ros_bridge.transport.messages` makes the same messages for the graph.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.planner.request.request import Altitude
from envs.areas import Keep, Level
from envs.formats.areas.geodetic import GeodeticArea
from ros_bridge.core import conversions as codes
from ros_bridge.core.areas import CEILING, FLOOR, FROM, REFERENCES, UNTIL
from ros_bridge.core.categories import BY_CATEGORY, text_of
from ros_bridge.core.conversions import PlanPoint, Published, Route
from ros_bridge.core.fields import SECOND, Sighting
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.guidance import Guidance
from ros_bridge.core.reports import Report
from ros_bridge.display.scene import Health, MonitorStatus

Fields = dict[str, Any]

_LEVELS = {name: code for code, name in REFERENCES.items()}
_FOLDER = Path(__file__).parents[1] / "rlcas_msgs" / "msg"
_OTHERS = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "unique_identifier_msgs/UUID": "uint8[16] uuid",
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\nDiagnosticStatus[] status",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value",
}
"""The fields of ROS's own messages that stand in ours."""


def definition(kind: str) -> str:
    """Return the definition of a message (``rlcas_msgs/msg/Areas``) and its parts."""
    first = kind.replace("/msg/", "/")
    texts: dict[str, str] = {}
    waiting = [first]
    while waiting:
        definition_name = waiting.pop(0)
        if definition_name in texts:
            continue
        package, _, name = definition_name.partition("/")
        file = _FOLDER / f"{name}.msg"
        texts[definition_name] = (
            file.read_text("utf-8") if package == "rlcas_msgs" else _OTHERS[definition_name]
        )
        waiting += _parts(package, texts[definition_name])
    parts = [
        f"MSG: {definition_name}\n{text}"
        for definition_name, text in texts.items()
        if definition_name != first
    ]
    return f"\n{'=' * 80}\n".join([texts[first], *parts])


def _parts(package: str, text: str) -> list[str]:
    """Return the messages that a definition's fields are of."""
    lines = (line.partition("#")[0].split() for line in text.splitlines())
    kinds = {words[0].partition("[")[0] for words in lines if words}
    names = {kind if "/" in kind else f"{package}/{kind}" for kind in kinds}
    return sorted(full_name for full_name in names if full_name in _OTHERS or _is_ours(full_name))


def _is_ours(kind: str) -> bool:
    package, _, name = kind.partition("/")
    return package == "rlcas_msgs" and (_FOLDER / f"{name}.msg").is_file()


def time_fields(time: int) -> Fields:
    """Return nanoseconds as a time of ROS."""
    return {"sec": time // SECOND, "nanosec": time % SECOND}


def clock(moment: int) -> Fields:
    """Return a Clock."""
    return {"clock": time_fields(moment)}


def aircraft(report: Report | Sighting) -> Fields:
    """Return an AircraftState of a report, or of what is left of one that could not be used."""
    sighting = report if isinstance(report, Sighting) else report.sighting
    fields: Fields = {**_header(sighting.time or 0), "id": sighting.identifier, "valid": 0}
    if sighting.place is not None:
        latitude, longitude = sighting.place
        _add(fields, codes.POSITION, latitude=latitude, longitude=longitude)
    climb = None if sighting.altitude is None else sighting.altitude.vertical_speed
    if sighting.altitude is not None:
        _add(fields, codes.ALTITUDE, **_altitude(sighting.altitude))
    if climb is not None:
        _add(fields, codes.VERTICAL_SPEED)
    velocity = {"z": climb or 0.0}
    if isinstance(report, Report):
        _add(fields, codes.VELOCITY)
        velocity |= {"x": report.east, "y": report.north}
        _add_accuracy(fields, report)
    return fields | {"velocity": velocity}


def _add_accuracy(fields: Fields, report: Report) -> None:
    if report.position_std is not None:
        _add(fields, codes.POSITION_STD, position_std=report.position_std)
    if report.velocity_std is not None:
        _add(fields, codes.VELOCITY_STD, velocity_std=report.velocity_std)
    if report.time_std > 0.0:
        _add(fields, codes.TIME_STD, time_std=report.time_std)
    if report.true_airspeed is not None:
        _add(fields, codes.TRUE_AIRSPEED, true_airspeed=report.true_airspeed)
    if report.wind is not None:
        _add(fields, codes.WIND, wind={"x": report.wind[0], "y": report.wind[1]})
    fields |= {"category": report.category, "callsign": report.callsign}


def geo_reference(origin: codes.Origin) -> Fields:
    """Return a GeoReference, of any time."""
    fields = {**_header(0), "latitude": origin.frame.latitude, "longitude": origin.frame.longitude}
    if origin.undulation is None:
        return fields
    return fields | {"geoid_undulation_valid": True, "geoid_undulation": origin.undulation}


def route(stations: Route, moment: int) -> Fields:
    """Return a Trajectory of status ROUTE."""
    points = [
        _point(
            station.index,
            codes.ROUTE_POINT,
            (station.latitude, station.longitude),
            station.altitude,
        )
        for station in stations
    ]
    return _trajectory(codes.STATUS_ROUTE, moment, 0, waypoints=points)


def plan(published: Published, status: int = codes.STATUS_SAFE) -> Fields:
    """Return a Trajectory of a plan or, by its status, a backup."""
    return _trajectory(
        status,
        published.began,
        published.revision,
        id={"uuid": published.unique or bytes(16)},
        intruder_ids=list(published.identifiers),
        start=_plan_point(published.start),
        waypoints=[_plan_point(point) for point in published.points],
        wind={"x": published.wind[0], "y": published.wind[1]},
        wind_std=published.wind_std,
    )


def withdrawal(revision: int, moment: int) -> Fields:
    """Return the Trajectory that withdraws a plan."""
    return _trajectory(3, moment, revision)


def status(monitor: MonitorStatus, revision: int) -> Fields:
    """Return an AssuranceStatus of the plan of a revision."""
    return {
        **_header(monitor.time),
        **monitor.status.fields(),
        "trajectory_revision": revision,
        "runner_silence": -1.0,
    }


def guidance(bands: Guidance) -> Fields:
    """Return a GuidanceBands."""
    return {**_header(bands.time), **bands.fields()}


def areas(geodetic_areas: tuple[GeodeticArea, ...], moment: int) -> Fields:
    """Return an Areas of areas as they are now, ns."""
    return {**_header(moment), "areas": [_area(area, moment) for area in geodetic_areas]}


def diagnostics(
    nodes: Mapping[str, Health],
    separation: float | None,
    by_category: Mapping[int, float],
    fresh: Freshness,
    moment: int,
) -> Fields:
    """Return a DiagnosticArray; the separation, m, those by category, and for how long things count
    stand beside each state of health.
    """
    texts = {BY_CATEGORY: text_of(by_category), **fresh.texts()}
    values = [{"key": key, "value": text} for key, text in texts.items()]
    if separation is not None:
        values.append({"key": "separation, m", "value": f"{separation:g}"})
    statuses = [
        {"level": health.level, "name": name, "message": health.text, "values": values}
        for name, health in nodes.items()
    ]
    return {**_header(moment), "status": statuses}


def _header(time: int) -> Fields:
    return {"header": {"stamp": time_fields(time), "frame_id": ""}}


def _add(fields: Fields, bit: int, **more: Any) -> None:
    fields |= {"valid": fields["valid"] | bit, **more}


def _altitude(altitude: Altitude) -> Fields:
    return {
        "altitude": altitude.value,
        "altitude_reference": codes.ALTITUDE_NUMBERS[altitude.reference],
    }


def _trajectory(status: int, time: int, revision: int, **more: Any) -> Fields:
    none = {"min_separation": -1.0, "time_of_min_separation": -1.0, "rejoin_index": -1}
    return {**_header(time), "status": status, "revision": revision, **none, **more}


def _point(
    index: int, origin: int, place: tuple[float, float], altitude: Altitude | None
) -> Fields:
    fields: Fields = {"index": index, "origin": origin, "valid": 0}
    fields |= {"latitude": place[0], "longitude": place[1]}
    if altitude is not None:
        _add(fields, codes.POINT_ALTITUDE, **_altitude(altitude))
    return fields


def _plan_point(point: PlanPoint) -> Fields:
    origin = codes.ROUTE_POINT if point.of_route else codes.PLAN_POINT
    fields = _point(point.index, origin, (point.latitude, point.longitude), point.altitude)
    _add(
        fields,
        codes.POINT_TRACK | codes.POINT_SPEED | codes.POINT_TIME,
        track_deg=point.track_deg,
        ground_speed=point.speed,
        time_of_arrival=time_fields(point.time),
    )
    if point.altitude is not None and point.altitude.vertical_speed is not None:
        _add(fields, codes.POINT_CLIMB, climb=point.altitude.vertical_speed)
    return fields


def _area(area: GeodeticArea, moment: int) -> Fields:
    extra = area.more
    east, north = extra.get("velocity", (0.0, 0.0))
    fields: Fields = {"id": area.name, "keep": int(area.keep is Keep.IN), "valid": 0}
    fields |= {"velocity": {"x": east, "y": north}}
    fields |= {name: extra.get(name, 0.0) for name in ("growth", "clearance")}
    fields["rings"] = [
        {"latitude": [place[0] for place in ring], "longitude": [place[1] for place in ring]}
        for ring in area.rings
    ]
    if area.centre is not None:
        latitude, longitude = area.centre
        fields |= {"latitude": latitude, "longitude": longitude, "radius": area.radius}
    for side, level, bit in (("floor", area.floor, FLOOR), ("ceiling", area.ceiling, CEILING)):
        if level is not None:
            _add(fields, bit, **_level(side, level))
    for side, bit in (("valid_from", FROM), ("valid_until", UNTIL)):
        if math.isfinite(extra.get(side, math.inf)):
            _add(fields, bit, **{side: time_fields(moment + round(extra[side] * SECOND))})
    return fields


def _level(side: str, level: Level) -> Fields:
    return {side: level.value, f"{side}_reference": _LEVELS[level.reference]}
