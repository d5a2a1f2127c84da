"""Of areas that are too wide, or have too many points, nothing is lost that lies near: judged by
shapely, in the degrees of the file.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from envs.area_geometry import signed_distance
from envs.areas import MOST_POINTS, Area, AreaError, Circle, Keep, Polygon
from envs.formats.areas import read_near_areas
from envs.formats.areas.reduction import clip, hull, thin
from envs.formats.local_frame import LocalFrame, distance

HERE = LocalFrame(47.0, 8.0)


def star(rng: np.random.Generator, count: int, size: float, jag: float = 0.5) -> np.ndarray:
    """A ring round the origin, counter-clockwise, as jagged as said."""
    turn = np.sort(rng.uniform(0.0, 2.0 * math.pi, count))
    radius = size * (1.0 - jag * rng.random(count))
    return np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)


def read(folder: Path, coordinates: Any, frame: LocalFrame, **properties: Any) -> Any:
    shape = {"type": "Polygon", "coordinates": [np.asarray(ring).tolist() for ring in coordinates]}
    path = folder / "areas.geojson"
    path.write_text(json.dumps({"type": "Feature", "geometry": shape, "properties": properties}))
    return read_near_areas(path, frame)


def test_what_is_clipped_is_the_intersection() -> None:
    rng, pieces = np.random.default_rng(1), 0
    for _ in range(200):
        outer = star(rng, int(rng.integers(3, 60)), 10.0, 0.9)
        hole = star(rng, 7, 1.0) * 0.5 + rng.uniform(-3.0, 3.0, 2)
        polygon = shapely.Polygon(outer, [hole])
        polygon = polygon if polygon.is_valid else shapely.Polygon(outer)
        turned = shapely.orient_polygons(polygon)
        rings = [
            np.array(rings_of.coords)[:-1] for rings_of in (turned.exterior, *turned.interiors)
        ]
        low, size = rng.uniform(-8.0, 2.0, 2), rng.uniform(0.5, 6.0, 2)
        box = [(a, a + b) for a, b in zip(low.tolist(), size.tolist(), strict=True)]
        (west, east), (south, north) = box
        clipped = clip(rings, (box[0], box[1]))
        union = shapely.union_all(
            [shapely.Polygon(rings_of[0], rings_of[1:]) for rings_of in clipped]
        )
        expected = shapely.intersection(polygon, shapely.box(west, south, east, north))
        assert shapely.symmetric_difference(union, expected).area < 1e-6
        pieces = max(pieces, len(clipped))
    assert pieces > 2  # among them are some that fall apart


def test_points_on_the_line_are_cut_too() -> None:
    square = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 1.0), (0.0, 2.0)])
    [[ring]] = clip([square], ((0.0, 2.0), (0.0, 1.0)))
    assert shapely.Polygon(ring).area == pytest.approx(2.0)


@pytest.mark.parametrize("jag", [0.0, 0.02, 0.6])
def test_a_thinned_ring_stays_as_near_as_it_says(jag: float) -> None:
    rng = np.random.default_rng(2)
    ring = star(rng, 3_000, 5_000.0, jag)
    [thinned], off = thin([ring], 200, 0.5)
    assert len(thinned) <= 200
    before, after = shapely.Polygon(ring), shapely.LinearRing(thinned)
    assert shapely.distance(shapely.points(ring), after).max() <= off
    places = shapely.points(rng.uniform(-6e3, 6e3, (500, 2)))
    clear = shapely.distance(places, after) > off
    if after.is_simple:
        inside = shapely.contains(shapely.Polygon(thinned), places)
        assert (inside == shapely.contains(before, places))[clear].all()
    around = shapely.Polygon(hull(ring))
    assert shapely.symmetric_difference(around, before.convex_hull).area < 1e-3


@pytest.mark.parametrize("keep", [Keep.OUT, pytest.param(Keep.IN, marks=pytest.mark.slow)])
@pytest.mark.parametrize("jag", [pytest.param(0.0, marks=pytest.mark.slow), 0.3])
def test_a_ring_of_many_points_is_thinned_on_the_safe_side(
    tmp_path: Path, keep: Keep, jag: float
) -> None:
    rng = np.random.default_rng(3)
    ring = star(rng, 3_000, 0.1, jag) * (1.4, 1.0) + (8.0, 47.0)
    (area,), remarks = read(tmp_path, [ring], HERE, keep=keep.value, clearance_m=100.0)
    assert len(area.shape.outer) <= MOST_POINTS
    assert area.clearance > 100.0
    assert "has 3000 points" in remarks[0]
    x, y = rng.uniform(-15e3, 15e3, (2, 300))
    allowed = signed_distance(area, x, y) >= area.clearance
    # In the frame the file's edges, 100 m long, are straight to a millimetre.
    at = HERE.place(ring[:, 1], ring[:, 0])
    truth = shapely.Polygon(np.stack([at.x, at.y], axis=1))
    shapely.prepare(truth)
    places = shapely.points(x[allowed], y[allowed])
    assert (shapely.contains(truth, places) == (keep is Keep.IN)).all()
    assert shapely.distance(places, truth.exterior).min() > 99.9
    assert 0 < allowed.sum() < allowed.size


WORLD = [[-180, -85], [180, -85], [180, 85], [-180, 85], [-180, -85]]


@pytest.mark.parametrize(
    ("rings", "frame"),
    [
        ([WORLD, [[7.6, 46.5], [11, 44], [9, 49]]], HERE),
        ([WORLD, [[7.6, 46.5], [11, 44], [9, 49]]], LocalFrame(-60.0, 179.9)),
        ([[[7.4, 46.8], [8.6, 46.8], [8.6, 47.2], [7.4, 47.2]]], HERE),
        ([[[7.4, 46.8], [9.9, 46.8], [7.6, 47.0], [9.9, 47.3], [7.0, 47.2]]], HERE),
        ([[[179, -17], [-178, -18], [-179, -16]]], LocalFrame(-17.0, -179.5)),
        ([[[179, -17], [-178, -18], [-179, -16]]], LocalFrame(-17.0, 179.5)),
        (
            [[[179, -17], [-178, -18], [-179, -16]], [[-179.5, -17], [-179, -17], [-179, -16.9]]],
            LocalFrame(-17.0, -179.5),
        ),
        ([[[0, 60], [40, 62], [60, 75], [0, 70]]], LocalFrame(70.0, 20.0)),
    ],
)
@pytest.mark.parametrize("keep", [Keep.OUT, Keep.IN])
def test_of_a_wide_area_all_counts_that_lies_near(
    tmp_path: Path, rings: Any, frame: LocalFrame, keep: Keep
) -> None:
    if keep is Keep.IN and rings[0] is WORLD and frame is not HERE:
        with pytest.raises(AreaError, match=r"km wide and has 2 parts within 100 km"):
            read(tmp_path, rings, frame, keep="in")
        return
    areas, _ = read(tmp_path, rings, frame, keep=keep.value)
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-70e3, 70e3, (2, 500))
    at = frame.geodetic(x, y)
    outer = np.array(rings[0], dtype=float)
    if rings[0] is not WORLD:
        outer[:, 0] = np.unwrap(outer[:, 0], period=360.0)
    beyond = outer[:, 0].max() > 180.0
    holes = [[(x + 360.0 * (beyond and x < 0.0), y) for x, y in hole] for hole in rings[1:]]
    polygon = shapely.Polygon(outer, holes)
    longitude = at.longitude + 360.0 * ((at.longitude < 0.0) & (outer[:, 0].max() > 180.0))
    places = shapely.points(longitude, at.latitude)
    inside = shapely.contains(polygon, places)
    clear = shapely.distance(shapely.boundary(polygon), places) > 2e-5  # 0.5 m from straight edges
    # Among the parts of the world, the line at 180 degrees is an edge of both.
    within = [np.asarray(signed_distance(area, x, y)) < 0.0 for area in areas]
    forbidden = np.any(within, axis=0) if within else np.zeros(len(x), bool)
    assert (forbidden == (inside == (keep is Keep.OUT)))[clear].all()


@pytest.mark.parametrize("keep", [Keep.OUT, Keep.IN])
def test_a_large_circle_is_a_polygon_on_the_safe_side(tmp_path: Path, keep: Keep) -> None:
    centre, radius = (47.5, 9.0), 80_000.0
    shape = {"type": "Point", "coordinates": centre[::-1]}
    feature = {"type": "Feature", "geometry": shape}
    path = tmp_path / "areas.geojson"
    path.write_text(json.dumps(feature | {"properties": {"keep": keep.value, "radius_m": radius}}))
    (area,), _ = read_near_areas(path, HERE)
    assert isinstance(area.shape, Polygon)
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    places = HERE.place(*centre)
    x, y = (float(places.x) + radius * np.cos(turn), float(places.y) + radius * np.sin(turn))
    at = HERE.geodetic(x, y)
    apart = [
        distance(*centre, *pair) - radius for pair in zip(at.latitude, at.longitude, strict=True)
    ]
    away = signed_distance(area, x, y) * (1.0 if keep is Keep.OUT else -1.0)
    near = np.hypot(x, y) < 90e3
    off = (away - np.array(apart))[near] * (1.0 if keep is Keep.OUT else -1.0)
    assert (off < 0.0).all() and (off > -10.0).all()


def test_one_that_is_wide_and_moves_stays_whole(tmp_path: Path) -> None:
    ring = [[7.5, 46.8], [9.0, 46.8], [9.0, 47.2]]
    (area,), _ = read(tmp_path, [ring], HERE, velocity_east_m_s=5.0)
    assert isinstance(area, Area) and not isinstance(area.shape, Circle)
    with pytest.raises(AreaError, match=r"km wide in x, expected 300 km at most"):
        read(tmp_path, [[[4.0, 46.8], [9.0, 46.8], [9.0, 47.2]]], HERE, velocity_east_m_s=5.0)
