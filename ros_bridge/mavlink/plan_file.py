"""A plan as a file that map programs and ground stations draw.

A line over the antimeridian is cut there, as RFC 7946 (section 3.1.9) asks for: between 179.9 and
-179.9 degrees they would draw it round the earth.
"""

import json
import math
from itertools import pairwise

from ros_bridge.core.conversions import Published

__all__ = ["geojson", "kml"]

_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
<name>{name}</name>
<Style><LineStyle><color>ff00a0ff</color><width>4</width></LineStyle></Style>
<MultiGeometry>{lines}</MultiGeometry>
</Placemark></Document></kml>
"""


def geojson(plan: Published) -> str:
    """Return a line, or lines, with the times of arrival, ns, of the plan's points after the
    first.
    """
    lines = _lines(plan)
    whole = {"type": "LineString", "coordinates": lines[0]}
    cut = {"type": "MultiLineString", "coordinates": lines}
    return json.dumps(
        {
            "type": "Feature",
            "geometry": whole if len(lines) == 1 else cut,
            "properties": {
                "name": f"plan {plan.revision}",
                "times_ns": [one.time for one in plan.points],
            },
        }
    )


def kml(plan: Published) -> str:
    """Return a line, or lines, whose heights are left to the ground."""
    texts = (
        " ".join(f"{longitude:.7f},{latitude:.7f}" for longitude, latitude in line)
        for line in _lines(plan)
    )
    lines = "".join(f"<LineString><coordinates>{one}</coordinates></LineString>" for one in texts)
    return _KML.format(name=f"plan {plan.revision}", lines=lines)


def _lines(plan: Published) -> list[list[list[float]]]:
    """Return the lines through a plan's points, longitude and latitude, degrees."""
    places = [[one.longitude, one.latitude] for one in (plan.start, *plan.points)]
    lines = [places[:1]]
    for (west, south), (east, north) in pairwise(places):
        if abs(east - west) > 180.0:
            edge = math.copysign(180.0, west)
            share = (edge - west) / math.remainder(east - west, 360.0)
            latitude = south + share * (north - south)
            lines[-1].append([edge, latitude])
            lines.append([[-edge, latitude]])
        lines[-1].append([east, north])
    return lines
