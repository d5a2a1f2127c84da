"""Areas of every format come into the local frame where they are; what cannot be used is refused in
one sentence that names file and place.
"""

import copy
import itertools
import json
import math
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from envs.areas import Area, AreaError, Circle, Keep, Level, Polygon
from envs.formats.areas import read_areas, read_near_areas, write_areas
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.areas.reading import geodetic_areas
from envs.formats.local_frame import LocalFrame

HERE = LocalFrame(47.0, 8.0)
RING = [[8.0, 47.0], [8.02, 47.0], [8.02, 47.01], [8.0, 47.01], [8.0, 47.0]]
HOLE = [[8.005, 47.002], [8.005, 47.004], [8.01, 47.004], [8.005, 47.002]]
NOON = datetime(2026, 11, 27, 12, tzinfo=UTC)

GEOJSON = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "geometry": {"type": "Polygon", "coordinates": [RING, HOLE]},
            "properties": {
                "name": "ring",
                "floor_m": 0.0,
                "floor_reference": "msl",
                "ceiling_m": 500.0,
                "ceiling_reference": "wgs84",
                "valid_from": "2026-11-27T12:10:00Z",
                "valid_until": "2026-11-27T14:00:00+01:00",
                "clearance_m": 50.0,
                "velocity_east_m_s": 5.0,
                "growth_m_s": -0.5,
            },
        },
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [8.0, 47.0]},
            "properties": {"keep": "in", "radius_m": 9_000.0},
        },
    ],
}
ED269 = {
    "title": "zones",
    "features": [
        {
            "identifier": "TST001",
            "country": "CHE",
            "name": "Zone",
            "type": "COMMON",
            "restriction": "PROHIBITED",
            "reason": ["SENSITIVE"],
            "applicability": [
                {
                    "permanent": "NO",
                    "startDateTime": "2026-11-27T12:00:30.000Z",
                    "endDateTime": "2026-11-27T13:00:00Z",
                    "schedule": [{"day": ["MON"], "startTime": "08:00Z", "endTime": "18:00Z"}],
                }
            ],
            "zoneAuthority": [],
            "geometry": [
                {
                    "uomDimensions": "FT",
                    "lowerLimit": 0,
                    "lowerVerticalReference": "AGL",
                    "upperLimit": 1000,
                    "upperVerticalReference": "AMSL",
                    "horizontalProjection": {"type": "Polygon", "coordinates": [RING]},
                },
                {
                    "uomDimensions": "FT",
                    "lowerLimit": 100,
                    "lowerVerticalReference": "AGL",
                    "horizontalProjection": {
                        "type": "Circle",
                        "center": [8.0, 47.0],
                        "radius": 1000,
                    },
                },
            ],
        }
    ],
}
ED318 = {
    "type": "FeatureCollection",
    "name": "zones",
    "features": [
        {
            "type": "Feature",
            "id": "TST002",
            "geometry": {
                "type": "GeometryCollection",
                "geometries": [
                    {
                        "type": "Polygon",
                        "coordinates": [RING],
                        "layer": {
                            "upper": 120,
                            "upperReference": "AMSL",
                            "lower": 50,
                            "lowerReference": "WGS84",
                            "uom": "m",
                        },
                    },
                    {
                        "type": "Point",
                        "coordinates": [8.0, 47.0],
                        "extent": {"subType": "Circle", "radius": 1000},
                        "layer": {"upper": 400, "upperReference": "AMSL", "uom": "ft"},
                    },
                ],
            },
            "properties": {
                "identifier": "TST002",
                "country": "CHE",
                "name": [{"text": "Zone", "lang": "en-GB"}],
                "type": "REQ_AUTHORIZATION",
                "variant": "COMMON",
                "limitedApplicability": [{"endDateTime": "2026-11-27T13:00:00Z"}],
                "zoneAuthority": [],
            },
        }
    ],
}
PLAN = {
    "fileType": "Plan",
    "geoFence": {
        "circles": [
            {
                "circle": {"center": [47.0, 8.0], "radius": 1000.0},
                "inclusion": False,
                "version": 1,
            }
        ],
        "polygons": [
            {"inclusion": True, "polygon": [pair[::-1] for pair in RING[:4]], "version": 1}
        ],
        "version": 2,
    },
    "groundStation": "QGroundControl",
    "mission": {},
    "rallyPoints": {"points": [], "version": 2},
    "version": 1,
}
ICAROUS = """# fences
- id: 0
  type: KEEPIN
  floor: -10
  roof: 100
  vertices:
  - [47.0, 8.0]
  - [47.0, 8.02]
  - [47.01, 8.02]
  - [47.01, 8.0]
- id: 1
  type: KEEPOUT
  floor: -10
  roof: 100
  vertices: [[47.002, 8.005], [47.004, 8.005], [47.004, 8.01]]
"""


@pytest.fixture
def stored(tmp_path: Path) -> Callable[[Any], Path]:
    def store(content: Any) -> Path:
        path = tmp_path / "areas"
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return path

    return store


def corners(ring: Any = RING[:4]) -> np.ndarray:
    places = HERE.place(*np.array(ring)[:, ::-1].T)
    return np.stack([places.x, places.y], axis=1)


def same_ring(ring: Any, expected: np.ndarray) -> bool:
    """Whether two rings have the same corners, wherever they begin and whichever way round."""
    points = sorted(map(tuple, np.round(ring, 4).tolist()))
    return points == sorted(map(tuple, np.round(expected, 4).tolist()))


def test_geojson(stored: Callable[[Any], Path]) -> None:
    ring, disc = read_areas(stored(GEOJSON), HERE, time=NOON)
    assert isinstance(ring.shape, Polygon)
    assert same_ring(ring.shape.outer, corners())
    assert same_ring(ring.shape.holes[0], corners(HOLE[:3]))
    # 0.02 degrees of longitude at 47 degrees are 1521 m, 0.01 of latitude 1112 m.
    assert np.ptp(ring.shape.outer, axis=0) == pytest.approx([1_521.0, 1_112.0], abs=1.0)
    assert (ring.floor, ring.ceiling) == (Level(0.0, "msl"), Level(500.0, "wgs84"))
    assert (ring.valid_from, ring.valid_until) == (600.0, 3_600.0)
    assert (ring.clearance, ring.velocity, ring.growth) == (50.0, (5.0, 0.0), -0.5)
    assert (ring.name, ring.keep, disc.keep) == ("ring", Keep.OUT, Keep.IN)
    assert disc == Area(Circle(0.0, 0.0, 9_000.0), Keep.IN)
    without, _ = read_areas(stored(GEOJSON), HERE)
    assert (without.valid_from, without.valid_until) == (-math.inf, math.inf)


def test_several_polygons_are_several_areas_but_only_one_can_be_kept_in(
    stored: Callable[[Any], Path],
) -> None:
    shape = {
        "type": "MultiPolygon",
        "coordinates": [[RING], [[[9.0, 47.0], [9.1, 47.0], [9, 47.1]]]],
    }
    feature = {"type": "Feature", "geometry": shape, "properties": {}}
    assert len(read_areas(stored(feature), HERE)) == 2
    with pytest.raises(AreaError, match=r"has 2 polygons to be kept in, expected one"):
        read_areas(stored(feature | {"properties": {"keep": "in"}}), HERE)


def test_ed269(stored: Callable[[Any], Path]) -> None:
    for content in (ED269, ED269["features"]):
        zone, disc = read_areas(stored(content), HERE, time=NOON)
        assert isinstance(zone.shape, Polygon)
        assert same_ring(zone.shape.outer, corners())
        assert (zone.floor, zone.ceiling) == (None, Level(pytest.approx(304.8), "msl"))
        assert (zone.valid_from, zone.valid_until) == (30.0, 3_600.0)
        assert (zone.name, zone.keep) == ("Zone", Keep.OUT)
        assert isinstance(disc.shape, Circle)
        assert (disc.shape.x, disc.shape.radius) == (0.0, pytest.approx(304.8))
        assert (disc.floor, disc.ceiling) == (Level(pytest.approx(30.48), "ground"), None)


def test_ed318(stored: Callable[[Any], Path]) -> None:
    zone, disc = read_areas(stored(ED318), HERE, time=NOON)
    assert isinstance(zone.shape, Polygon)
    assert same_ring(zone.shape.outer, corners())
    assert (zone.floor, zone.ceiling) == (Level(50.0, "wgs84"), Level(120.0, "msl"))
    assert (zone.valid_from, zone.valid_until, zone.name) == (-math.inf, 3_600.0, "Zone")
    assert disc.shape == Circle(0.0, 0.0, 1_000.0)
    assert disc.ceiling == Level(pytest.approx(121.92), "msl")


@pytest.mark.parametrize("restriction", ["NO_RESTRICTION", "CONDITIONAL"])
def test_zones_that_are_no_obstacle_are_left_out(
    stored: Callable[[Any], Path], restriction: str
) -> None:
    old, new = copy.deepcopy(ED269), copy.deepcopy(ED318)
    old["features"][0]["restriction"] = restriction  # type: ignore[index]
    new["features"][0]["properties"]["type"] = restriction  # type: ignore[index]
    for content in (old, new):
        assert read_areas(stored(content), HERE, permitted=["CONDITIONAL"]) == []
        assert len(read_areas(stored(content), HERE)) == (2 if restriction == "CONDITIONAL" else 0)


def test_qgroundcontrol(stored: Callable[[Any], Path]) -> None:
    fence, disc = read_areas(stored(PLAN), HERE)
    assert isinstance(fence.shape, Polygon)
    assert same_ring(fence.shape.outer, corners())
    assert (fence.keep, disc.keep) == (Keep.IN, Keep.OUT)
    assert disc == Area(Circle(0.0, 0.0, 1_000.0))


def test_icarous(stored: Callable[[Any], Path]) -> None:
    fence, obstacle = read_areas(stored(ICAROUS), HERE, reference="msl")
    assert isinstance(fence.shape, Polygon)
    assert same_ring(fence.shape.outer, corners())
    assert (fence.keep, obstacle.keep, obstacle.name) == (Keep.IN, Keep.OUT, "fence 1")
    assert (obstacle.floor, obstacle.ceiling) == (Level(-10.0, "msl"), Level(100.0, "msl"))
    _, unknown = read_areas(stored(ICAROUS), HERE)
    assert (unknown.floor, unknown.ceiling) == (None, None)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    turn = np.sort(rng.uniform(0.0, 2.0 * math.pi, 12))
    outer = tuple(zip((2e3 * np.cos(turn)).tolist(), (1.5e3 * np.sin(turn)).tolist(), strict=True))
    areas = [
        Area(
            Polygon(outer, (((0.0, 0.0), (50.0, 0.0), (0.0, 50.0)),)),
            velocity=(3.0, -4.0),
            growth=0.5,
            floor=Level(100.0, "msl"),
            ceiling=Level(2_000.0, "pressure"),
            valid_from=60.0,
            valid_until=300.0,
            clearance=75.0,
            name="cell",
        ),
        Area(Circle(2_500.0, -700.0, 321.5), Keep.IN),
    ]
    write_areas(tmp_path / "a.geojson", areas, HERE)
    read_again = read_areas(tmp_path / "a.geojson", HERE)
    for area, area_again in zip(areas, read_again, strict=True):
        if isinstance(area.shape, Circle) and isinstance(area_again.shape, Circle):
            assert (area_again.shape.x, area_again.shape.y) == pytest.approx(
                (2_500.0, -700.0), abs=1e-6
            )
            assert area_again.shape.radius == 321.5
        elif isinstance(area.shape, Polygon) and isinstance(area_again.shape, Polygon):
            for ring, again in zip(area.shape.rings, area_again.shape.rings, strict=True):
                assert same_ring(ring, np.array(again))
        for name in ("keep", "velocity", "growth", "floor", "ceiling", "clearance", "name"):
            assert getattr(area, name) == getattr(area_again, name)
        assert (area.valid_from, area.valid_until) == (
            area_again.valid_from,
            area_again.valid_until,
        )


def test_what_is_written_over_the_antimeridian_is_in_one_piece(tmp_path: Path) -> None:
    """Map programs draw an edge from 179.9 to -179.9 degrees round the earth."""
    outer = (-2e3, -2e3), (2e3, -2e3), (2e3, 2e3), (-2e3, 2e3)
    hole = (500.0, 0.0), (600.0, 0.0), (500.0, 100.0)
    for frame in (LocalFrame(-45.0, 179.999), LocalFrame(-45.0, -179.999)):
        write_areas(tmp_path / "a.geojson", [Area(Polygon(outer, (hole,)))], frame)
        written = json.loads((tmp_path / "a.geojson").read_text())
        rings = written["features"][0]["geometry"]["coordinates"]
        east = np.concatenate([np.array(ring)[:, 0] for ring in rings])
        assert np.ptp(east) < 0.1
        (area,) = read_areas(tmp_path / "a.geojson", frame)
        assert isinstance(area.shape, Polygon)
        assert same_ring(outer, np.array(area.shape.outer))


def test_long_edges_stay_where_they_are(tmp_path: Path) -> None:
    ring = ((-25e3, -9e3), (25e3, -9e3), (20e3, 30e3), (-20e3, 25e3))
    write_areas(tmp_path / "a.geojson", [Area(Polygon(ring))], HERE)
    (area,) = read_areas(tmp_path / "a.geojson", HERE)
    assert isinstance(area.shape, Polygon)
    written, read_ring = shapely.LinearRing(ring), shapely.LinearRing(area.shape.outer)
    assert shapely.hausdorff_distance(written, read_ring) < 1e-3
    write_areas(tmp_path / "b.geojson", [area], HERE)
    (again,) = read_areas(tmp_path / "b.geojson", HERE)
    assert isinstance(again.shape, Polygon)
    assert len(again.shape.outer) == len(area.shape.outer) > 8


def test_an_edge_that_is_straight_in_degrees_is_followed(stored: Callable[[Any], Path]) -> None:
    north = LocalFrame(65.0, 8.0)
    ring = [[7.5, 65.0], [8.5, 65.0], [8.0, 65.05]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    (area,) = read_areas(stored({"type": "Feature", "geometry": shape, "properties": None}), north)
    assert isinstance(area.shape, Polygon)
    points = np.array(area.shape.outer)
    parallel = north.place(np.full(500, 65.0), np.linspace(7.5, 8.5, 500))
    line = shapely.LinearRing(points)
    off = shapely.distance(line, shapely.points(parallel.x, parallel.y))
    assert off.max() < 0.55
    # The straight line between its ends would leave it by 93 m.
    assert abs(parallel.y[0] - parallel.y[250]) > 90.0


def test_a_ring_across_the_date_line_is_one(stored: Callable[[Any], Path]) -> None:
    ring = [[179.99, 10.0], [-179.99, 10.0], [-179.99, 10.01], [179.99, 10.01]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "geometry": shape, "properties": {}}
    (area,) = read_areas(stored(feature), LocalFrame(10.0, 180.0))
    assert isinstance(area.shape, Polygon)
    assert np.ptp(area.shape.outer, axis=0) == pytest.approx([2_193.0, 1_106.0], abs=2.0)


def test_a_ring_that_crosses_itself_is_refused_in_the_numbers_of_the_file(
    stored: Callable[[Any], Path],
) -> None:
    ring = [[7.8, 47.0], [8.2, 47.0], [8.2, 47.0], [8.0, 47.2], [8.2, 47.2], [8.0, 46.9]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "geometry": shape, "properties": {}}
    # In the local frame the edges have more points; one point of the file is there twice.
    says = r"outer crosses or touches itself: its edge from point 0 and its edge from point 4,"
    with pytest.raises(AreaError, match=says):
        read_areas(stored(feature), HERE)


def test_far_areas_are_left_out_but_not_those_to_be_kept_in(
    stored: Callable[[Any], Path],
) -> None:
    far = LocalFrame(47.0, 10.0)
    assert len(read_areas(stored(GEOJSON), far, time=NOON)) == 1
    assert len(read_areas(stored(GEOJSON), far, time=NOON, within=160e3)) == 2


def named(crs: str) -> dict[str, Any]:
    return {"type": "name", "properties": {"name": crs}}


def change(content: Any, path: str, value: Any) -> Any:
    changed = copy.deepcopy(content)
    *keys, last = (int(key) if key.isdigit() else key for key in path.split("/"))
    inner = changed
    for key in keys:
        inner = inner[key]
    inner[last] = value
    return changed


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("{", r"not JSON"),
        ('{"type": "Feature", "type": "Feature"}', r"'type' stands twice"),
        ("[1, 2]", r"is a list, expected an object"),
        ('{"type": "Topology"}', r"type: is 'Topology', expected Feature or FeatureCollection"),
        (GEOJSON | {"crs": {}}, r"areas, crs: is \{\}, expected none or WGS-84"),
        (
            change(GEOJSON, "features/0/geometry/crs", named("urn:ogc:def:crs:EPSG::2056")),
            r"features\[0\], geometry, crs: is .*2056.*, expected none or WGS-84",
        ),
        (change(GEOJSON, "features/0/crs", None), r"features\[0\], crs: is None, expected none"),
        (
            change(ED318, "features/0/geometry/geometries/0/crs", named("EPSG:3857")),
            r"geometries\[0\], crs: is .*3857",
        ),
        (GEOJSON | {"features": 1}, r"features: is 1, expected a list"),
        (
            change(GEOJSON, "features/0/geometry", None),
            r"features\[0\], geometry: is None, expected an object",
        ),
        (
            change(GEOJSON, "features/0/geometry/type", "LineString"),
            r"geometry.type: is 'LineString', expected Polygon",
        ),
        (
            change(GEOJSON, "features/0/geometry/coordinates/0/1", [8.0, 95.0]),
            r"coordinates\[0\]\[1\], latitude: is 95.0, expected -90 to 90 degrees",
        ),
        (
            change(GEOJSON, "features/0/geometry/coordinates/0/1", [8.0, math.nan]),
            r"coordinates\[0\]\[1\], latitude: is nan",
        ),
        (
            change(GEOJSON, "features/0/geometry/coordinates/0", RING[:2]),
            r"coordinates\[0\]: has 2 different points, expected 3 or more",
        ),
        (
            change(GEOJSON, "features/0/geometry/coordinates", []),
            r"coordinates: has 0 entries, expected 1 or more",
        ),
        (
            change(GEOJSON, "features/0/geometry/coordinates/0", [RING[n] for n in (0, 2, 1, 3)]),
            r"features\[0\]: outer crosses or touches itself",
        ),
        (
            change(GEOJSON, "features/0/geometry/coordinates", [[[n, 85] for n in (0, 120, 240)]]),
            r"features\[0\]: goes round a pole",
        ),
        (change(ED269, "features/0/geometry", []), r"geometry: has 0 entries"),
        (change(ED318, "features/0/geometry/geometries", []), r"geometries: has 0 entries"),
        (change(GEOJSON, "features/0/properties/keep", "away"), r"keep: is 'away'"),
        (change(GEOJSON, "features/0/properties/keep", []), r"keep: is \[\]"),
        (
            change(GEOJSON, "features/0/properties/floor_reference", None),
            r"floor_reference: is missing",
        ),
        (
            change(GEOJSON, "features/0/properties/valid_until", "2026-11-27T12:00:00Z"),
            r"features\[0\], valid_until: is '2026-11-27T12:00:00Z', expected a date after",
        ),
        (
            change(GEOJSON, "features/0/properties/valid_from", "noon"),
            r"valid_from: is 'noon', expected a date",
        ),
        (change(GEOJSON, "features/0/properties/valid_from_s", 3), r"valid_from: is given twice"),
        (
            change(GEOJSON, "features/1/properties/radius_m", None),
            r"features\[1\], radius_m: is None",
        ),
        (change(GEOJSON, "features/1/properties/radius_m", 0.0), r"radius is 0 m"),
        (
            change(ED269, "features/0/restriction", "FORBIDDEN"),
            r"restriction: 'FORBIDDEN' is unknown, expected one of",
        ),
        (
            change(ED269, "features/0/geometry/0/uomDimensions", "NM"),
            r"geometry\[0\].uomDimensions: is 'NM', expected M or FT",
        ),
        (
            change(ED269, "features/0/geometry/0/upperVerticalReference", "FL"),
            r"geometry\[0\].upper, reference: is 'FL', expected one of",
        ),
        (
            change(ED269, "features/0/geometry/0/upperLimit", "high"),
            r"geometry\[0\].upper: is 'high'",
        ),
        (
            change(ED269, "features/0/geometry/1/horizontalProjection/type", "Ellipse"),
            r"type: is 'Ellipse', expected Polygon or Circle",
        ),
        (
            change(ED269, "features/0/applicability/0/endDateTime", "2026-11-27T11:00:00Z"),
            r"applicability\[0\].endDateTime: is '2026-11-27T11:00:00Z', expected a date after",
        ),
        (
            change(ED318, "features/0/geometry/geometries/1/extent", {"subType": "Arc"}),
            r"extent.subType: is 'Arc', expected Circle",
        ),
        (
            change(ED318, "features/0/geometry/geometries/0/layer/uom", None),
            r"layer.uom: is None, expected a text",
        ),
        (change(ED318, "features/0/properties/type", 1), r"type: is 1, expected a text"),
        (change(PLAN, "geoFence/version", 1), r"geoFence.version: is 1, expected 2"),
        (
            change(PLAN, "geoFence/polygons/0/inclusion", "yes"),
            r"polygons\[0\].inclusion: is 'yes', expected true or false",
        ),
        (
            change(PLAN, "geoFence/circles/0/circle/radius", -1.0),
            r"circles\[0\].circle.radius: is -1.0, expected 0 to 1e\+07 m",
        ),
        *(
            (
                change(GEOJSON, "features/0/properties", {name: 5.0}),
                rf"features\[0\], {name}: is a name without its unit, expected {name}_m",
            )
            for name in ("clearance", "growth", "velocity_east", "velocity_north")
        ),
        (
            change(GEOJSON, "features/0/properties", {"keep": "in", "ceiling": 120}),
            r"features\[0\], ceiling: is a name without its unit, expected ceiling_m",
        ),
        (ICAROUS.replace("id: 1", "id: 0"), r"fence 1, id: is 0, expected a name of its own"),
        (ICAROUS.replace("KEEPOUT", "OUT"), r"fence 1, type: is 'OUT', expected one of"),
        (ICAROUS.replace("roof: 100", "floor: 1", 1), r"line 5: key floor stands twice"),
        (ICAROUS.replace("47.002", "x"), r"fence 1, vertices\[0\], latitude: is 'x'"),
        ("- id: &a 1\n- id: *a\n", r"line 2: \*a is an alias"),
        ("- [", r"not valid YAML"),
        ("\x00\x01", r"not valid YAML \(unacceptable character"),
        ("id: 1", r"expected a list"),
    ],
)
def test_what_cannot_be_used_is_refused(
    stored: Callable[[Any], Path], content: Any, problem: str
) -> None:
    path = stored(content)
    with pytest.raises(AreaError, match=problem) as refusal:
        read_areas(path, HERE, time=NOON)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(AreaError, match=r"there is no such file"):
        read_areas(tmp_path / "none.geojson", HERE)


def test_an_end_before_the_beginning_is_refused_without_a_time_too(
    stored: Callable[[Any], Path],
) -> None:
    content = change(GEOJSON, "features/0/properties/valid_until", "2026-11-27T12:00:00Z")
    with pytest.raises(AreaError, match=r"valid_until: is .*, expected a date after valid_from"):
        read_areas(stored(content), HERE)


def test_a_date_without_its_zone_may_be_of_any(stored: Callable[[Any], Path]) -> None:
    begin, end = (f"features/0/applicability/0/{name}" for name in ("startDateTime", "endDateTime"))
    content = change(change(ED269, begin, "2026-11-27T12:00:30"), end, "2026-11-27T13:00:00")
    area = read_areas(stored(content), HERE, time=NOON)[0]
    assert (area.valid_from, area.valid_until) == (30.0 - 14 * 3600.0, 3600.0 + 12 * 3600.0)


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "areas.geojson"
    path.write_text(" \n")
    with pytest.raises(AreaError, match=r"areas\.geojson: is empty, expected areas"):
        read_areas(path, LocalFrame(47.0, 8.0))


# What a file leaves open: one area of each form with all that its limits need.


def _geojson(left_out: frozenset[str]) -> Any:
    properties = {
        "floor_m": 100.0,
        "floor_reference": "msl",
        "ceiling_m": 500.0,
        "ceiling_reference": "msl",
        "valid_from": "2026-11-27T12:10:00Z",
        "valid_until": "2026-11-27T13:00:00Z",
    }
    stated = {key: value for key, value in properties.items() if key not in left_out}
    shape = {"type": "Polygon", "coordinates": [RING]}
    return {"type": "Feature", "geometry": shape, "properties": stated}


def _ed269(left_out: frozenset[str]) -> Any:
    zone: Any = copy.deepcopy(ED269["features"][0])
    volume = zone["geometry"][0] | {"lowerLimit": 300}
    zone["geometry"] = [{key: value for key, value in volume.items() if key not in left_out}]
    [period] = zone["applicability"]
    zone["applicability"] = [{key: value for key, value in period.items() if key not in left_out}]
    return [{key: value for key, value in zone.items() if key not in left_out}]


def _ed318(left_out: frozenset[str]) -> Any:
    zone: Any = copy.deepcopy(ED318["features"][0])
    shape = zone["geometry"]["geometries"][0]
    shape["layer"] = {key: value for key, value in shape["layer"].items() if key not in left_out}
    zone["geometry"] = {key: value for key, value in shape.items() if key not in left_out}
    stated = {key: value for key, value in zone["properties"].items() if key not in left_out}
    [period] = zone["properties"]["limitedApplicability"]
    period["startDateTime"] = "2026-11-27T12:10:00Z"
    if "limitedApplicability" in stated:
        stated["limitedApplicability"] = [
            {key: value for key, value in period.items() if key not in left_out}
        ]
    return {"type": "FeatureCollection", "features": [zone | {"properties": stated}]}


def _icarous(left_out: frozenset[str]) -> Any:
    lines = ICAROUS.split("- id: 1")[1].splitlines()
    lines_kept = [line for line in lines if line.strip().partition(":")[0] not in left_out]
    return "\n".join(["- id: 1", *lines_kept])


LEFT_OUT: dict[Callable[[frozenset[str]], Any], tuple[str, ...]] = {
    _geojson: (
        *("floor_m", "floor_reference", "ceiling_m", "ceiling_reference"),
        *("valid_from", "valid_until"),
    ),
    _ed269: (
        *("lowerLimit", "lowerVerticalReference", "upperLimit", "upperVerticalReference"),
        *("uomDimensions", "startDateTime", "endDateTime", "applicability"),
    ),
    _ed318: (
        *("lower", "lowerReference", "upper", "upperReference", "layer"),
        *("startDateTime", "endDateTime", "limitedApplicability"),
    ),
    _icarous: ("floor", "roof"),
}


def counts_within(inner: GeodeticArea, outer: GeodeticArea) -> bool:
    """Return whether an area counts only where and when another does."""
    limits = (
        (inner.floor, inner.ceiling, *inner.period),
        (outer.floor, outer.ceiling, *outer.period),
    )
    return all(wide is None or wide == narrow for narrow, wide in zip(*limits, strict=True))


@pytest.mark.parametrize("form", LEFT_OUT, ids=lambda form: form.__name__)
def test_an_area_counts_always_and_everywhere_in_what_its_file_leaves_open(
    stored: Callable[[Any], Path], form: Callable[[frozenset[str]], Any]
) -> None:
    def read(*left_out: str) -> GeodeticArea:
        reading = geodetic_areas(str(stored(form(frozenset(left_out)))), reference="msl")
        [incomplete] = reading.areas
        return incomplete

    complete, names = read(), LEFT_OUT[form]
    assert complete.floor is not None and complete.ceiling is not None
    count_read = 0
    for count in range(len(names) + 1):
        for left_out in itertools.combinations(names, count):
            try:
                incomplete = read(*left_out)
            except AreaError:  # a height above nothing, or in no unit
                assert re.search("[Rr]eference|uom", " ".join(left_out))
                continue
            count_read += 1
            assert (incomplete.rings, incomplete.keep) == (complete.rings, complete.keep)
            assert counts_within(complete, incomplete)
    assert count_read >= 2 ** (len(names) // 2)
    nothing = read(*(name for name in names if name != "uomDimensions"))
    assert (nothing.floor, nothing.ceiling, *nothing.period) == (None, None, None, None)


# Areas never vanish in silence, and never change their side.

SQUARE = {"type": "Polygon", "coordinates": [RING]}


def feature_of(**properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": SQUARE, "properties": properties}


def test_a_file_of_which_nothing_lies_near_is_refused_with_the_distance(
    stored: Callable[[Any], Path],
) -> None:
    far = LocalFrame(47.0, 12.0)
    says = r"nothing of it lies near: 1 area lies more than 100 km from the origin .*, the nearest "
    with pytest.raises(AreaError, match=rf"{says}303 km$"):  # 3.98 degrees of 76.06 km
        read_areas(stored(feature_of()), far)
    exchanged = {"type": "Polygon", "coordinates": [[place[::-1] for place in RING]]}
    feature = {"type": "Feature", "geometry": exchanged, "properties": {}}
    hint = r"with latitude and longitude exchanged it would be 0 km$"
    with pytest.raises(AreaError, match=rf"{says}\d+ km; {hint}"):
        read_areas(stored(feature), HERE)
    circle = {"type": "Point", "coordinates": [47.0, 8.0]}
    feature = {"type": "Feature", "geometry": circle, "properties": {"radius_m": 500.0}}
    with pytest.raises(AreaError, match=hint):
        read_areas(stored(feature), HERE)


def test_what_is_left_out_is_counted(stored: Callable[[Any], Path]) -> None:
    away = {"type": "Point", "coordinates": [10.0, 47.0]}
    features = [
        feature_of(name="near"),
        {"type": "Feature", "geometry": away, "properties": {"radius_m": 500.0}},
        feature_of(restriction="NO_RESTRICTION"),
        feature_of(restriction="CONDITIONAL"),
    ]
    path = stored({"type": "FeatureCollection", "features": features})
    reading = read_near_areas(path, HERE, permitted=["CONDITIONAL"])
    assert [area.name for area in reading.areas] == ["near"]
    free, far = reading.remarks
    assert "2 UAS zones that are no obstacle are left out" in free
    assert re.search(r"1 area lies more than 100 km .*, the nearest 152 km; left out", far)
    assert len(read_areas(path, HERE)) == 2


@pytest.mark.parametrize(
    ("properties", "keep"),
    [
        ({"Type": "Inclusive"}, Keep.IN),
        ({"type": "KEEP_IN"}, Keep.IN),
        ({"fence_type": "keep-out"}, Keep.OUT),
        ({"inclusion": True}, Keep.IN),
        ({"isInclusion": "false"}, Keep.OUT),
        ({"exclusion": 1}, Keep.OUT),
        ({"exclusion": False}, Keep.IN),
        ({"Keep": "in", "Type": "inclusive"}, Keep.IN),
        ({"side": "in"}, Keep.IN),
        ({"unit": "in"}, Keep.OUT),
        ({"name": "Inclusive"}, Keep.OUT),
        ({"Type": "Restricted"}, Keep.OUT),
        ({"type": None, "note": ["inclusion"]}, Keep.OUT),
    ],
)
def test_the_side_is_the_one_stated_in_any_words(
    stored: Callable[[Any], Path], properties: dict[str, Any], keep: Keep
) -> None:
    (area,) = read_areas(stored(feature_of(**properties)), HERE)
    assert area.keep is keep


@pytest.mark.parametrize(
    ("properties", "says"),
    [
        ({"keep": "out", "Type": "Inclusive"}, r"states keep 'out' and Type 'Inclusive'"),
        ({"inclusion": True, "exclusion": True}, r"expected one side"),
        ({"inclusion": "perhaps"}, r"inclusion: is 'perhaps', expected true or false"),
        ({"Type": "Inclusion zone"}, r"Type: is 'Inclusion zone', expected \"keep\": \"in\" or"),
        ({"inclusive_fence": 3}, r"inclusive_fence: is 3, expected \"keep\""),
    ],
)
def test_an_ambiguous_side_is_refused(
    stored: Callable[[Any], Path], properties: dict[str, Any], says: str
) -> None:
    with pytest.raises(AreaError, match=says):
        read_areas(stored(feature_of(**properties)), HERE)


@pytest.mark.parametrize(
    "crs",
    [
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "urn:ogc:def:crs:OGC::CRS84",
        "OGC:CRS84",
        "EPSG:4326",
        "urn:ogc:def:crs:EPSG::4326",
    ],
)
def test_the_reference_system_of_geojson_may_be_named(
    stored: Callable[[Any], Path], crs: str
) -> None:
    inner = {**feature_of(), "geometry": {**SQUARE, "crs": named(crs)}}
    for content in (feature_of() | {"crs": named(crs)}, inner):
        assert len(read_areas(stored(content), HERE)) == 1


def test_one_zone_alone_is_read_as_what_it_is(stored: Callable[[Any], Path]) -> None:
    for zone in (ED269["features"][0], ED318["features"][0]):
        areas = read_areas(stored(zone), HERE, time=NOON)
        assert [area.name for area in areas] == ["Zone", "Zone"]
        assert areas[1].ceiling is None or areas[1].ceiling.reference == "msl"
    mixed = {"type": "FeatureCollection", "features": [feature_of(), *ED318["features"]]}
    with pytest.raises(AreaError, match=r"features\[0\], type: is None, expected a text"):
        read_areas(stored(mixed), HERE)


@pytest.mark.parametrize(
    "content",
    [
        '<?xml version="1.0"?><kml><Placemark/></kml>',
        "#saved by Mission Planner 1.3\n47.0 8.02\n47.0 8.04\n47.02 8.04\n",
        "AC R\nAN TEST\nAH 2000FT AGL\nAL SFC\nDP 47:00:00 N 008:01:00 E\n",
        "* OpenAir\nAC R\nAN TEST\n",
    ],
)
def test_of_another_format_it_is_said_which_are_read(
    stored: Callable[[Any], Path], content: str
) -> None:
    with pytest.raises(AreaError, match=r"GeoJSON, ED-269, ED-318, a \.plan of QGroundControl"):
        read_areas(stored(content), HERE)
