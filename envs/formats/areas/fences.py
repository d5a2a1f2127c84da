"""Fences of ground stations: the ``.plan`` files of QGroundControl, and the YAML of ICAROUS."""

from typing import Any

from envs.areas import AreaError, Keep, Level
from envs.formats.areas.geodetic import (
    GeodeticArea,
    Reading,
    level,
    number,
    place,
    record,
    ring,
    rows,
)

_VERSION = 2  # of QGroundControl's fences
_SIDES = {"KEEPIN": Keep.IN, "KEEPOUT": Keep.OUT}


def areas_of_plan(content: dict[str, Any], source: str) -> Reading:
    """Return the fences of a plan of QGroundControl, which have no heights."""
    fence = record(content.get("geoFence"), f"{source}, geoFence")
    if fence.get("version") != _VERSION:
        raise AreaError(
            f"{source}, geoFence.version: is {fence.get('version')!r:.60}, expected {_VERSION}"
        )
    areas = []
    for n, entry in enumerate(rows(fence.get("polygons"), f"{source}, geoFence.polygons")):
        where = f"{source}, geoFence.polygons[{n}]"
        polygon = record(entry, where)
        outer = ring(polygon.get("polygon"), f"{where}.polygon", longitude_first=False)
        areas.append(GeodeticArea(where, (outer,), keep=_side(polygon, where)))
    for n, entry in enumerate(rows(fence.get("circles"), f"{source}, geoFence.circles")):
        where = f"{source}, geoFence.circles[{n}]"
        circle = record(entry, where)
        disc = record(circle.get("circle"), f"{where}.circle")
        centre = place(disc.get("center"), f"{where}.circle.center", longitude_first=False)
        radius = number(disc.get("radius"), f"{where}.circle.radius", 0.0, 1e7, "m")
        areas.append(GeodeticArea(where, centre=centre, radius=radius, keep=_side(circle, where)))
    return Reading(tuple(areas))


def _side(fence: dict[str, Any], where: str) -> Keep:
    """Return on which side of a fence flight is allowed."""
    inclusion = fence.get("inclusion")
    if not isinstance(inclusion, bool):
        raise AreaError(f"{where}.inclusion: is {inclusion!r:.60}, expected true or false")
    return Keep.IN if inclusion else Keep.OUT


def areas_of_icarous(content: object, source: str, reference: str | None) -> Reading:
    """Return the fences of ICAROUS; its heights are m above a reference that the file does not
    state.
    """
    areas = []
    names: set[int | str] = set()
    for n, entry in enumerate(rows(content, source)):
        where = f"{source}, fence {n}"
        fence = record(entry, where)
        name = fence.get("id")
        if isinstance(name, bool) or not isinstance(name, (int, str)) or name in names:
            raise AreaError(f"{where}, id: is {name!r:.60}, expected a name of its own")
        names.add(name)
        side = fence.get("type")
        if not isinstance(side, str) or side not in _SIDES:
            raise AreaError(f"{where}, type: is {side!r:.60}, expected one of {sorted(_SIDES)}")
        outer = ring(fence.get("vertices"), f"{where}, vertices", longitude_first=False)
        floor, ceiling = (
            _height(fence.get(key), f"{where}, {key}", reference) for key in ("floor", "roof")
        )
        areas.append(
            GeodeticArea(
                where,
                (outer,),
                keep=_SIDES[side],
                floor=floor,
                ceiling=ceiling,
                name=f"fence {name}",
            )
        )
    return Reading(tuple(areas))


def _height(value: object, where: str, reference: str | None) -> Level | None:
    height = level(value, reference or "unknown", 1.0, where)
    return None if reference is None else height
