"""A plan as a file that map programs and ground stations draw."""

import json

from ros_bridge.core.conversions import Published

__all__ = ["geojson", "kml"]

_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
<name>{name}</name>
<Style><LineStyle><color>ff00a0ff</color><width>4</width></LineStyle></Style>
<LineString><coordinates>{places}</coordinates></LineString>
</Placemark></Document></kml>
"""


def geojson(plan: Published) -> str:
    """Return a line with the times of arrival, ns, of its points after the first."""
    return json.dumps(
        {
            "type": "Feature",
            "geometry": {"type": "LineString", "coordinates": _places(plan)},
            "properties": {
                "name": f"plan {plan.revision}",
                "times_ns": [one.time for one in plan.points],
            },
        }
    )


def kml(plan: Published) -> str:
    """Return a line, whose heights are left to the ground."""
    places = " ".join(f"{longitude:.7f},{latitude:.7f}" for longitude, latitude in _places(plan))
    return _KML.format(name=f"plan {plan.revision}", places=places)


def _places(plan: Published) -> list[list[float]]:
    return [[one.longitude, one.latitude] for one in (plan.start, *plan.points)]
