"""One function for all files of areas: the format is recognised by what the file holds."""

import os
import re
from collections.abc import Collection, Iterator
from datetime import UTC, datetime
from typing import Any, NamedTuple

from commands.text_file import json_of, text_of
from envs.areas import Area, AreaError
from envs.formats.areas import geojson
from envs.formats.areas.fences import areas_of_icarous, areas_of_plan
from envs.formats.areas.geodetic import Reading
from envs.formats.areas.placement import WITHIN, far_away, to_plane
from envs.formats.areas.uas_zones import areas_of_ed269, areas_of_ed318, is_ed269, is_ed318
from envs.formats.local_frame import LocalFrame

FORMATS = "GeoJSON, ED-269, ED-318, a .plan of QGroundControl, or fences of ICAROUS in YAML"
"""That are read."""

_WGS84 = re.compile(
    r"(urn:ogc:def:crs:)?OGC:[\d.]*:?CRS84|(urn:ogc:def:crs:)?EPSG:[\d.]*:?4326", re.I
)


class NearAreas(NamedTuple):
    """The areas of a file that lie near, and what is not all of them."""

    areas: tuple[Area, ...]
    remarks: tuple[str, ...]  # sentences: how many were left out, which were clipped or thinned


def read_areas(
    path: str | os.PathLike[str],
    frame: LocalFrame,
    *,
    time: datetime | None = None,
    within: float = WITHIN,
    permitted: Collection[str] = (),
    reference: str | None = None,
) -> list[Area]:
    """Return the areas of :func:`read_near_areas`, without what it remarks."""
    near = read_near_areas(
        path, frame, time=time, within=within, permitted=permitted, reference=reference
    )
    return list(near.areas)


def read_near_areas(
    path: str | os.PathLike[str],
    frame: LocalFrame,
    *,
    time: datetime | None = None,
    within: float = WITHIN,
    permitted: Collection[str] = (),
    reference: str | None = None,
) -> NearAreas:
    """Read areas of a file: GeoJSON, ED-269, ED-318, a plan of QGroundControl or ICAROUS' YAML.

    Args:
        path: the file.
        frame: the local frame in which the areas are returned.
        time: of the request, for files that state dates; None: such an area counts always.
        within: areas to be kept out of that lie farther from the frame's origin are left out, m.
        permitted: restrictions of UAS zones that are no obstacle to this flight, such as
            ``CONDITIONAL``.
        reference: what the heights of ICAROUS' fences are above, such as ``"msl"``; None: unknown,
            so that they count at all heights.

    Raises:
        AreaError: the file cannot be read, an area in it cannot be used, or all of them lie farther
            than ``within``; the message says which one, and what was expected.
    """
    if time is not None and time.tzinfo is None:
        time = time.replace(tzinfo=UTC)
    source = os.fspath(path)
    reading = geodetic_areas(source, permitted, reference)
    placed = to_plane(reading.areas, frame, time, within)
    remarks = list(placed.changes)
    if placed.far:
        remarks.insert(0, f"{source}: {far_away(placed.far, frame, within)}; left out")
        if not placed.areas:
            raise AreaError(
                f"{source}: nothing of it lies near: {far_away(placed.far, frame, within)}"
            )
    if reading.free:
        remarks.insert(0, f"{source}: {reading.free} UAS zones that are no obstacle are left out")
    return NearAreas(placed.areas, tuple(remarks))


def geodetic_areas(
    source: str, permitted: Collection[str] = (), reference: str | None = None
) -> Reading:
    """Return the areas of a file on the ellipsoid; arguments as :func:`read_near_areas` has
    them.
    """
    text = text_of(source, AreaError)
    if not text.strip():
        raise AreaError(f"{source}: is empty, expected areas")
    if text.lstrip()[:1] not in ("{", "["):
        return areas_of_icarous(_yaml_of(text, source), source, reference)
    content = json_of(source, AreaError)
    for where, crs in _reference_systems(content, source):
        if not _is_wgs84(crs):
            raise AreaError(
                f"{where}: is {crs!r:.120}, expected none or WGS-84 such as "
                "urn:ogc:def:crs:OGC:1.3:CRS84"
            )
    if is_ed269(content):
        return areas_of_ed269(content, source, permitted)
    if not isinstance(content, dict):
        raise AreaError(f"{source}: is a list, expected an object or a list of zones of ED-269")
    if content.get("fileType") == "Plan":
        return areas_of_plan(content, source)
    if is_ed318(content):
        return areas_of_ed318(content, source, permitted)
    return geojson.areas_of(content, source, permitted)


def _reference_systems(content: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yield each coordinate reference system of an object and those in it, and where it stands."""
    if isinstance(content, list):
        for n, item in enumerate(content):
            if isinstance(item, dict):
                yield from _reference_systems(item, f"{where}[{n}]")
    elif isinstance(content, dict):
        if "crs" in content:
            yield f"{where}, crs", content["crs"]
        for key in ("features", "geometry", "geometries", "horizontalProjection"):
            yield from _reference_systems(content.get(key), f"{where}, {key}")


def _is_wgs84(crs: Any) -> bool:
    """Return whether a reference system is the one of GeoJSON: longitude and latitude of WGS-84."""
    stated = crs.get("properties") if isinstance(crs, dict) else None
    name = stated.get("name") if isinstance(stated, dict) else None
    return isinstance(name, str) and _WGS84.fullmatch(name.strip()) is not None


def _yaml_of(text: str, source: str) -> Any:
    from commands import yaml  # the flight path has no PyYAML

    if text.lstrip().startswith("<"):
        raise AreaError(f"{source}: is XML such as KML, which is not read; expected {FORMATS}")
    try:
        content = yaml.parse(text, source)
    except yaml.YamlError as problem:
        raise AreaError(f"{problem}; expected {FORMATS}") from None
    if not isinstance(content, list):
        raise AreaError(f"{source}: is {content!r:.60}, expected a list of fences, or {FORMATS}")
    return content
