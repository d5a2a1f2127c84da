"""Files of areas: GeoJSON, ED-269, ED-318, QGroundControl plans and ICAROUS fences, as areas of a
local frame.

They need pyproj (the extra ``report``), fences of ICAROUS PyYAML too.
"""

from envs.formats.areas.geojson import write_areas
from envs.formats.areas.reading import NearAreas, read_areas, read_near_areas

__all__ = ["NearAreas", "read_areas", "read_near_areas", "write_areas"]
