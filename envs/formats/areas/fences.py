"""Fences of ground stations: the ``.plan`` files of QGroundControl, and the YAML of ICAROUS."""

from typing import Any

from envs.areas import AreaError, Keep, Level
from envs.formats.areas.geodetic import (
    GeodeticArea,
    level,
    number,
    place,
    record,
    ring,
    rows,
)

_VERSION = 2  # of QGroundControl's fences
_SIDES = {"KEEPIN": Keep.IN, "KEEPOUT": Keep.OUT}


def areas_of_plan(content: dict[str, Any], source: str) -> list[GeodeticArea]:
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
    return found


def _side(fence: dict[str, Any], where: str) -> Keep:
    inclusion = fence.get("inclusion")
    if not isinstance(inclusion, bool):
        raise AreaError(f"{where}.inclusion: is {inclusion!r:.60}, expected true or false")
    return Keep.IN if inclusion else Keep.OUT


def areas_of_icarous(content: Any, source: str, reference: str | None) -> list[GeodeticArea]:
    """Return the fences of ICAROUS; its heights are m above a reference that the file does not
    state.
    """
    found = []
    seen: set[Any] = set()
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
    return found


def _height(value: Any, where: str, reference: str | None) -> Level | None:
    found = level(value, reference or "unknown", 1.0, where)
    return None if reference is None else found


def yaml_of(text: str, source: str) -> Any:
    """Return the content of a YAML text; keys that stand twice and aliases are refused."""
    import yaml

    class Loader(yaml.SafeLoader):
        def compose_node(self, parent: Any, index: int) -> Any:
            if self.check_event(yaml.AliasEvent):
                line = self.peek_event().start_mark.line + 1
                raise AreaError(f"{source} line {line}: is an alias, expected the value itself")
            return super().compose_node(parent, index)

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            keys = [key.value for key, _ in node.value]
            # One value may be written in two ways, such as 1 and 0x1.
            values = [
                key.value
                if key.tag == "tag:yaml.org,2002:merge"
                else self.construct_object(key, deep=True)
                for key, _ in node.value
            ]
            for n, key in enumerate(keys):
                if key in keys[:n] or values[n] in values[:n]:
                    line = node.value[n][0].start_mark.line + 1
                    raise AreaError(f"{source} line {line}: key {key!r:.40} stands twice")
            return super().construct_mapping(node, deep)

    try:
        return yaml.load(text, Loader)  # a SafeLoader
    except AreaError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as problem:
        mark = getattr(problem, "problem_mark", None)
        line = f" line {mark.line + 1}" if mark is not None else ""
        what = getattr(problem, "problem", None) or problem
        raise AreaError(f"{source}{line}: not valid YAML ({what})") from None
