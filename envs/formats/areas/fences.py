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
    found = []
    for n, each in enumerate(rows(fence.get("polygons"), f"{source}, geoFence.polygons")):
        where = f"{source}, geoFence.polygons[{n}]"
        one = record(each, where)
        outer = ring(one.get("polygon"), f"{where}.polygon", longitude_first=False)
        found.append(GeodeticArea(where, (outer,), keep=_side(one, where)))
    for n, each in enumerate(rows(fence.get("circles"), f"{source}, geoFence.circles")):
        where = f"{source}, geoFence.circles[{n}]"
        one = record(each, where)
        disc = record(one.get("circle"), f"{where}.circle")
        centre = place(disc.get("center"), f"{where}.circle.center", longitude_first=False)
        radius = number(disc.get("radius"), f"{where}.circle.radius", 0.0, 1e7, "m")
        found.append(GeodeticArea(where, centre=centre, radius=radius, keep=_side(one, where)))
    return Reading(tuple(found))


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
    found = []
    seen: set[int | str] = set()
    for n, each in enumerate(rows(content, source)):
        where = f"{source}, fence {n}"
        fence = record(each, where)
        name = fence.get("id")
        if isinstance(name, bool) or not isinstance(name, (int, str)) or name in seen:
            raise AreaError(f"{where}, id: is {name!r:.60}, expected a name of its own")
        seen.add(name)
        side = fence.get("type")
        if not isinstance(side, str) or side not in _SIDES:
            raise AreaError(f"{where}, type: is {side!r:.60}, expected one of {sorted(_SIDES)}")
        outer = ring(fence.get("vertices"), f"{where}, vertices", longitude_first=False)
        floor, ceiling = (
            _height(fence.get(key), f"{where}, {key}", reference) for key in ("floor", "roof")
        )
        found.append(
            GeodeticArea(
                where,
                (outer,),
                keep=_SIDES[side],
                floor=floor,
                ceiling=ceiling,
                name=f"fence {name}",
            )
        )
    return Reading(tuple(found))


def _height(value: object, where: str, reference: str | None) -> Level | None:
    found = level(value, reference or "unknown", 1.0, where)
    return None if reference is None else found
