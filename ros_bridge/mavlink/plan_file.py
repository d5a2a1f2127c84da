"""A plan as a file that map programs and ground stations draw.

A line over the antimeridian is cut there, as RFC 7946 (section 3.1.9) asks for: between 179.9 and
-179.9 degrees they would draw it round the earth.
"""

import json
import math
from itertools import pairwise

from ros_bridge.core.conversions import PlanPoint, Published

__all__ = ["geojson", "kml"]

_ABSOLUTE = "<altitudeMode>absolute</altitudeMode>"  # above mean sea level
_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
<name>{name}</name>
<Style><LineStyle><color>ff00a0ff</color><width>4</width></LineStyle></Style>
<MultiGeometry>{lines}</MultiGeometry>
</Placemark></Document></kml>
"""


def geojson(plan: Published) -> str:
    """Return a line, or lines, with the times of arrival, ns, of the plan's points after the first,
    and, where it climbs, their altitudes.

    The altitudes are no third coordinate: that is above the ellipsoid (RFC 7946, section 3.1.1).
    """
    lines = [[place[:2] for place in line] for line in _lines(plan)]
    unbroken = {"type": "LineString", "coordinates": lines[0]}
    broken = {"type": "MultiLineString", "coordinates": lines}
    heights = [
        point.altitude for point in plan.points if point.altitude is not None and plan.climbs
    ]
    altitudes = {
        "altitudes_m": [round(height.value, 1) for height in heights],
        "altitude_reference": heights[0].reference if heights else None,
    }
    return json.dumps(
        {
            "type": "Feature",
            "geometry": unbroken if len(lines) == 1 else broken,
            "properties": {
                "name": f"plan {plan.revision}",
                "times_ns": [point.time for point in plan.points],
                **(altitudes if heights else {}),
            },
        }
    )


def kml(plan: Published) -> str:
    """Return a line, or lines, at the plan's altitudes; where it does not climb, their heights are
    left to the ground.
    """
    texts = (" ".join(_coordinates(place) for place in line) for line in _lines(plan))
    mode = _ABSOLUTE if plan.climbs else ""
    lines = "".join(
        f"<LineString>{mode}<coordinates>{coordinates}</coordinates></LineString>"
        for coordinates in texts
    )
    return _KML.format(name=f"plan {plan.revision}", lines=lines)


def _coordinates(place: list[float]) -> str:
    """Return a place of a line as KML has it."""
    longitude, latitude, *height = place
    return ",".join([f"{longitude:.7f}", f"{latitude:.7f}", *(f"{value:.1f}" for value in height)])


def _lines(plan: Published) -> list[list[list[float]]]:
    """Return the lines through a plan's points: longitude and latitude, degrees, and where it
    climbs the altitude, m.
    """
    places = [_place(plan, point) for point in (plan.start, *plan.points)]
    lines = [places[:1]]
    for start, end in pairwise(places):
        west, east = start[0], end[0]
        if abs(east - west) > 180.0:
            edge = math.copysign(180.0, west)
            share = (edge - west) / math.remainder(east - west, 360.0)
            pairs = zip(start[1:], end[1:], strict=True)
            on_edge = [first + share * (second - first) for first, second in pairs]
            lines[-1].append([edge, *on_edge])
            lines.append([[-edge, *on_edge]])
        lines[-1].append(end)
    return lines


def _place(plan: Published, point: PlanPoint) -> list[float]:
    place = [point.longitude, point.latitude]
    if plan.climbs and point.altitude is not None:
        place.append(point.altitude.value)
    return place
