"""Areas as GeoJSON (RFC 7946): polygons, and points with a radius, with properties of our own.

Properties of a feature, all optional: ``name``; ``keep`` (``"out"`` or ``"in"``), or another key of
:mod:`envs.formats.areas.sides` that says on which side flight is allowed; ``floor_m`` and
``ceiling_m`` with ``floor_reference`` and ``ceiling_reference`` (``"wgs84"``, ``"msl"``,
``"pressure"``, ``"ground"``); ``valid_from`` and ``valid_until`` (dates of RFC 3339), or
``valid_from_s`` and ``valid_until_s`` (s after the request); ``clearance_m``;
``velocity_east_m_s``, ``velocity_north_m_s`` and ``growth_m_s``; for a point ``radius_m``;
``restriction`` as in ED-269. Others are not read; of those above that change where flight is
allowed, names without their unit are refused.
"""

import json
import os
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from commands.files import write_file
from envs.areas import Area, AreaError, Circle, Keep, Level, Ring
from envs.formats.areas.geodetic import (
    OFF,
    GeodeticArea,
    Reading,
    level,
    number,
    period,
    place,
    polygon,
    record,
    rows,
    text,
)
from envs.formats.areas.sides import side_of
from envs.formats.areas.uas_zones import is_free
from envs.formats.local_frame import LocalFrame

_NUMBERS = {
    "clearance": "clearance_m",
    "growth": "growth_m_s",
    "valid_from": "valid_from_s",
    "valid_until": "valid_until_s",
}
_VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_UNITLESS = {
    "clearance": "clearance_m",
    "growth": "growth_m_s",
    **{name.removesuffix("_m_s"): name for name in _VELOCITY},
}
_UNITLESS_INSIDE = {"floor": "floor_m", "ceiling": "ceiling_m"}
"""Of areas to be kept in; without them one to be kept out of counts at all heights."""


def areas_of(content: dict[str, Any], source: str, permitted: Collection[str] = ()) -> Reading:
    """Return the areas of a feature or a collection of features."""
    kind = content.get("type")
    features = {source: content}
    if kind == "FeatureCollection":
        members = rows(content.get("features"), f"{source}, features")
        features = {f"{source}, features[{n}]": feature for n, feature in enumerate(members)}
    elif kind != "Feature":
        raise AreaError(f"{source}, type: is {kind!r:.60}, expected Feature or FeatureCollection")
    areas, free = list[GeodeticArea](), 0
    for where, feature in features.items():
        stated = record(feature, where).get("properties")
        properties = record({} if stated is None else stated, f"{where}, properties")
        restriction = properties.get("restriction")
        if restriction is not None and is_free(restriction, f"{where}, restriction", permitted):
            free += 1
            continue
        areas += _of_feature(feature, properties, where)
    return Reading(tuple(areas), free)


def _of_feature(
    feature: dict[str, Any], properties: dict[str, Any], where: str
) -> list[GeodeticArea]:
    """Return the areas of a feature, one of each polygon."""
    shape = record(feature.get("geometry"), f"{where}, geometry")
    common = _common(properties, where)
    kind, at = shape.get("type"), f"{where}, geometry.coordinates"
    coordinates = shape.get("coordinates")
    if kind == "Polygon":
        return [common._replace(rings=polygon(coordinates, at))]
    if kind == "MultiPolygon":
        parts = rows(coordinates, at, 1)
        if common.keep is Keep.IN and len(parts) != 1:
            raise AreaError(
                f"{at}: has {len(parts)} polygons to be kept in, expected one: there is no way "
                "from one to another"
            )
        return [
            common._replace(rings=polygon(part, f"{at}[{n}]"), where=f"{where}, polygon {n}")
            for n, part in enumerate(parts)
        ]
    if kind == "Point":
        radius = number(properties.get("radius_m"), f"{where}, radius_m", 0.0, 1e7, "m")
        return [common._replace(centre=place(coordinates, at, longitude_first=True), radius=radius)]
    raise AreaError(
        f"{where}, geometry.type: is {kind!r:.60}, expected Polygon, MultiPolygon or Point"
    )


def _common(properties: dict[str, Any], where: str) -> GeodeticArea:
    """Return what the properties of a feature say of its area."""
    more: dict[str, Any] = {
        field: number(properties[key], f"{where}, {key}")
        for field, key in _NUMBERS.items()
        if properties.get(key) is not None
    }
    if any(key in properties for key in _VELOCITY):
        more["velocity"] = tuple(
            number(properties.get(key, 0.0), f"{where}, {key}") for key in _VELOCITY
        )
    side = side_of(properties, where)
    for key, name in (_UNITLESS | (_UNITLESS_INSIDE if side is Keep.IN else {})).items():
        if key in properties and name not in properties:
            raise AreaError(f"{where}, {key}: is a name without its unit, expected {name}")
    begin, end = properties.get("valid_from"), properties.get("valid_until")
    valid = period(begin, end, f"{where}, ", ("valid_from", "valid_until"))
    for date_of, field in zip(valid, ("valid_from", "valid_until"), strict=True):
        if date_of is not None and field in more:
            raise AreaError(f"{where}, {field}: is given twice, also as {_NUMBERS[field]}")
    return GeodeticArea(
        where,
        keep=side,
        floor=_limit(properties, "floor", where),
        ceiling=_limit(properties, "ceiling", where),
        period=valid,
        name=text(properties.get("name") or "", f"{where}, name"),
        more=more,
    )


def _limit(properties: dict[str, Any], limit: str, where: str) -> Level | None:
    """Return a height that the properties of a feature state; None where they do not."""
    value = properties.get(f"{limit}_m")
    if value is None:
        return None
    reference = properties.get(f"{limit}_reference")
    if reference is None:
        raise AreaError(f"{where}, {limit}_reference: is missing, expected what it is above")
    name = text(reference, f"{where}, {limit}_reference")
    return level(value, name, 1.0, f"{where}, {limit}_m")


def write_areas(path: str | os.PathLike[str], areas: Sequence[Area], frame: LocalFrame) -> None:
    """Write areas of a local frame as a file of GeoJSON that :func:`read_areas` gives back; times
    are s after the request.
    """
    content = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "geometry": _geometry(area, frame), "properties": _properties(area)}
            for area in areas
        ],
    }
    write_file(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _geometry(area: Area, frame: LocalFrame) -> dict[str, Any]:
    shape = area.shape
    if isinstance(shape, Circle):
        point = frame.geodetic(shape.x, shape.y)
        return {"type": "Point", "coordinates": [float(point.longitude), float(point.latitude)]}
    return {"type": "Polygon", "coordinates": [_close_ring(ring, frame) for ring in shape.rings]}


def _close_ring(ring: Ring, frame: LocalFrame) -> list[list[float]]:
    """Return a closed ring of places, with more points where an edge is not straight in degrees;
    over the antimeridian its longitudes go on, beyond 180 degrees, beside the frame's origin.
    """
    x, y = np.array([*ring, ring[0]]).T
    ends = frame.geodetic(x, y)
    longitude, latitude = np.unwrap(ends.longitude, period=360.0), ends.latitude
    middle = frame.place(*(0.5 * (field[1:] + field[:-1]) for field in (latitude, longitude)))
    off = np.hypot(middle.x - 0.5 * (x[1:] + x[:-1]), middle.y - 0.5 * (y[1:] + y[:-1]))
    parts = np.maximum(np.ceil(np.sqrt(off / (0.9 * OFF))), 1.0).astype(int)
    shares = np.concatenate([n + np.arange(count) / count for n, count in enumerate(parts)])
    along = np.append(shares, len(ring))
    points = frame.geodetic(*(np.interp(along, np.arange(len(x)), field) for field in (x, y)))
    east = np.unwrap(points.longitude, period=360.0)
    east += 360.0 * np.round((frame.longitude - east.mean()) / 360.0)
    places = np.stack([east, points.latitude], axis=1).tolist()
    return [*places[:-1], places[0]]


def _properties(area: Area) -> dict[str, Any]:
    properties: dict[str, Any] = {"keep": area.keep.value}
    if area.name:
        properties["name"] = area.name
    if isinstance(area.shape, Circle):
        properties["radius_m"] = area.shape.radius
    for limit, height in (("floor", area.floor), ("ceiling", area.ceiling)):
        if height is not None:
            properties[f"{limit}_m"], properties[f"{limit}_reference"] = height
    standard = Area(area.shape)
    for field, key in _NUMBERS.items():
        if getattr(area, field) != getattr(standard, field):
            properties[key] = getattr(area, field)
    if area.velocity != standard.velocity:
        properties |= dict(zip(_VELOCITY, area.velocity, strict=True))
    return properties
