"""Domain values as the fields of messages of ``rlcas_msgs``; the other direction is
:mod:`ros_bridge.core.conversions`.

A recording without ROS writes them; :mod:`ros_bridge.transport.messages` fills them into messages
of the graph.

Fields that are left out are 0 or empty.
"""

import math
from typing import Any

from agents.planner.request.request import Altitude
from envs.areas import Keep, Level
from envs.formats.areas.geodetic import GeodeticArea
from ros_bridge.core import conversions as codes
from ros_bridge.core.areas import CEILING, FLOOR, FROM, REFERENCES, UNTIL
from ros_bridge.core.conversions import PlanPoint, Published, Route
from ros_bridge.core.fields import SECOND, Sighting
from ros_bridge.core.reports import Report

Fields = dict[str, Any]

_LEVELS = {name: code for code, name in REFERENCES.items()}


def time_fields(time: int) -> Fields:
    """Return nanoseconds as a time of ROS."""
    return {"sec": time // SECOND, "nanosec": time % SECOND}


def header(time: int, frame: str = "") -> Fields:
    """Return a header with its key; ``time`` in ns."""
    return {"header": {"stamp": time_fields(time), "frame_id": frame}}


def aircraft(report: Report | Sighting) -> Fields:
    """Return an AircraftState of a report, or of what is left of one that could not be used."""
    sighting = report if isinstance(report, Sighting) else report.sighting
    fields: Fields = {**header(sighting.time or 0), "id": sighting.identifier, "valid": 0}
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
    fields = {**header(0), "latitude": origin.frame.latitude, "longitude": origin.frame.longitude}
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
        id={"uuid": list(published.unique)},
        intruder_ids=list(published.identifiers),
        start=plan_point(published.start),
        waypoints=[plan_point(point) for point in published.points],
        wind={"x": published.wind[0], "y": published.wind[1]},
        wind_std=published.wind_std,
    )


def withdrawal(revision: int, moment: int, unique: bytes = bytes(16)) -> Fields:
    """Return the Trajectory that withdraws a plan, at a time, ns."""
    return _trajectory(codes.STATUS_WITHDRAWN, moment, revision, id={"uuid": list(unique)})


def plan_point(point: PlanPoint) -> Fields:
    """Return a Waypoint of a plan."""
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


def areas(geodetic_areas: tuple[GeodeticArea, ...], moment: int) -> Fields:
    """Return an Areas of areas as they are now, ns."""
    return {**header(moment), "areas": [_area(area, moment) for area in geodetic_areas]}


def _add(fields: Fields, bit: int, **more: Any) -> None:
    fields |= {"valid": fields["valid"] | bit, **more}


def _altitude(altitude: Altitude) -> Fields:
    return {
        "altitude": altitude.value,
        "altitude_reference": codes.ALTITUDE_NUMBERS[altitude.reference],
    }


def _trajectory(status: int, time: int, revision: int, **more: Any) -> Fields:
    none = {"min_separation": -1.0, "time_of_min_separation": -1.0, "rejoin_index": -1}
    return {**header(time), "status": status, "revision": revision, **none, **more}


def _point(
    index: int, origin: int, place: tuple[float, float], altitude: Altitude | None
) -> Fields:
    fields: Fields = {"index": index, "origin": origin, "valid": 0}
    fields |= {"latitude": place[0], "longitude": place[1]}
    if altitude is not None:
        _add(fields, codes.POINT_ALTITUDE, **_altitude(altitude))
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
