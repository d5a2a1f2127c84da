"""One function for all files of areas: the format is recognised by what the file holds."""

import os
from collections.abc import Collection
from datetime import UTC, datetime
from typing import Any

from envs.areas import Area, AreaError
from envs.edge.text_file import json_of, text_of
from envs.formats.areas import geojson
from envs.formats.areas.fences import areas_of_icarous, areas_of_plan
from envs.formats.areas.geodetic import GeodeticArea, on_plane
from envs.formats.areas.uas_zones import areas_of_ed269, areas_of_ed318, is_ed269, is_ed318
from envs.formats.local_frame import LocalFrame

WITHIN = 100_000.0
"""Distance from the frame's origin beyond which areas to be kept out of are left out, m."""


def read_areas(
    path: str | os.PathLike[str],
    frame: LocalFrame,
    *,
    time: datetime | None = None,
    within: float = WITHIN,
    permitted: Collection[str] = (),
    reference: str | None = None,
) -> list[Area]:
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
        AreaError: the file cannot be read, or an area in it cannot be used; the message says which
            one, and what was expected.
    """
    if time is not None and time.tzinfo is None:
        time = time.replace(tzinfo=UTC)
    source = os.fspath(path)
    found = (
        on_plane(one, frame, time, within) for one in geodetic_areas(source, permitted, reference)
    )
    return [area for area in found if area is not None]


def geodetic_areas(
    source: str, permitted: Collection[str] = (), reference: str | None = None
) -> list[GeodeticArea]:
    """Return the areas of a file on the ellipsoid; arguments as :func:`read_areas` has them."""
    text = text_of(source, AreaError)
    if not text.strip():
        raise AreaError(f"{source}: is empty, expected areas")
    if text.lstrip()[:1] not in ("{", "["):
        return areas_of_icarous(_yaml_of(text, source), source, reference)
    content = json_of(source, AreaError)
    if is_ed269(content):
        return areas_of_ed269(content, source, permitted)
    if not isinstance(content, dict):
        raise AreaError(f"{source}: is a list, expected an object or a list of zones of ED-269")
    if content.get("fileType") == "Plan":
        return areas_of_plan(content, source)
    if is_ed318(content):
        return areas_of_ed318(content, source, permitted)
    return geojson.areas_of(content, source)


def _yaml_of(text: str, source: str) -> Any:
    from envs.edge import yaml  # the flight path has no PyYAML

    try:
        return yaml.parse(text, source)
    except yaml.YamlError as problem:
        raise AreaError(str(problem)) from None
