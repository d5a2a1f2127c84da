"""Distances from areas are the true ones, by shapely and by dense sampling; bounds are below them
and close.
"""

import math
from typing import Any

import numpy as np
import pytest
import shapely

from envs import area_geometry
from envs.area_geometry import Parts, box_distance, chord_distances, signed_distance
from envs.areas import Area, Circle, Keep, Polygon


def star(rng: np.random.Generator, count: int, radius: float, x: float = 0.0) -> Any:
    """Return a ring of random points round a place."""
    turn = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    turn += rng.uniform(-0.4, 0.4, count) * 2.0 * math.pi / count
    away = rng.uniform(0.4, 1.0, count) * radius
    return tuple(
        zip((x + away * np.cos(turn)).tolist(), (away * np.sin(turn)).tolist(), strict=True)
    )


def shapes(seed: int, count: int) -> list[Any]:
    """Return polygons, with holes and without, and circles."""
    rng = np.random.default_rng(seed)
    drawn: list[Any] = [Circle(300.0, -200.0, 1_700.0)]
    for n in range(count):
        outer = star(rng, int(rng.integers(6, 40)), 5_000.0)
        holes = (star(rng, 5, 500.0), star(rng, 4, 200.0, 800.0)) if n % 2 else ()
        drawn.append(Polygon(outer, holes))
    return drawn


def truth(shape: Any, keep: Keep, x: Any, y: Any) -> Any:
    """Return signed distances of points by shapely, m."""
    if isinstance(shape, Circle):
        away = np.hypot(x - shape.x, y - shape.y) - shape.radius
    else:
        solid = shapely.Polygon(shape.outer, shape.holes)
        points = shapely.points(x, y)
        away = shapely.distance(solid.boundary, points)
        away = np.where(shapely.contains(solid, points), -away, away)
    return -away if keep is Keep.IN else away


def places(rng: np.random.Generator, count: int) -> Any:
    return rng.uniform(-6_000.0, 6_000.0, (2, count))


@pytest.mark.parametrize("keep", Keep)
def test_signed_distances_are_those_of_shapely(keep: Keep) -> None:
    rng = np.random.default_rng(1)
    for shape in shapes(2, 20):
        x, y = places(rng, 500)
        distances = signed_distance(Area(shape, keep), x, y)
        assert distances == pytest.approx(truth(shape, keep, x, y), abs=1e-7)
        assert (distances > 0.0).any() and (distances < 0.0).any()


def test_a_distance_does_not_depend_on_the_batch() -> None:
    rng = np.random.default_rng(3)
    area = Area(Polygon(star(rng, 60, 4_000.0)))
    x, y = places(rng, 5_000)
    alone = [signed_distance(area, a, b).item() for a, b in zip(x[:50], y[:50], strict=True)]
    np.testing.assert_array_equal(signed_distance(area, x, y)[:50], alone)
    assert signed_distance(area, x.reshape(50, 100), y.reshape(50, 100)).shape == (50, 100)


@pytest.mark.parametrize("keep", Keep)
def test_an_area_that_moves_is_looked_at_where_it_is(keep: Keep) -> None:
    rng = np.random.default_rng(4)
    for shape in shapes(5, 6):
        area = Area(shape, keep, velocity=(12.0, -5.0))
        x, y = places(rng, 200)
        time = rng.uniform(0.0, 400.0, 200)
        expected = truth(shape, keep, x - 12.0 * time, y + 5.0 * time)
        assert signed_distance(area, x, y, time) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("keep", Keep)
@pytest.mark.parametrize("growth", [2.0, -1.0])
def test_what_is_forbidden_of_a_growing_area_is_no_nearer(keep: Keep, growth: float) -> None:
    rng = np.random.default_rng(6)
    for shape in shapes(7, 4):
        area, time = Area(shape, keep, growth=growth), 100.0
        x, y = places(rng, 100)
        u, v = rng.uniform(-8_000.0, 8_000.0, (2, 40_000))
        # By definition a place is in the area where its distance from the shape is at most so much.
        within = truth(shape, Keep.OUT, u, v) <= growth * time
        forbidden = within if keep is Keep.OUT else ~within
        apart = np.hypot(x[:, None] - u[forbidden], y[:, None] - v[forbidden]).min(axis=1)
        distances = signed_distance(area, x, y, time)
        assert np.all(distances <= apart + 1e-6)
        outside = keep is Keep.OUT and growth > 0.0
        # 40 000 samples of 256 km^2 are up to some 250 m apart.
        assert not outside or np.all(distances[distances > 0.0] >= apart[distances > 0.0] - 350.0)


def chords(rng: np.random.Generator, count: int) -> Parts:
    x, y = places(rng, count)
    dx, dy = rng.normal(0.0, 10.0 ** rng.uniform(-3.0, 3.0, count), (2, count))
    return Parts(x, y, x + dx, y + dy)


@pytest.mark.parametrize("keep", [Keep.OUT, pytest.param(Keep.IN, marks=pytest.mark.slow)])
def test_chord_distances_are_the_true_ones_and_never_more(keep: Keep) -> None:
    rng = np.random.default_rng(8)
    for shape in shapes(9, 20):
        parts, area = chords(rng, 300), Area(shape, keep)
        distances = chord_distances(area, parts)
        share = np.linspace(0.0, 1.0, 201)[:, None]
        x, y = (a + share * (b - a) for a, b in ((parts.x0, parts.x1), (parts.y0, parts.y1)))
        every = truth(shape, keep, x.ravel(), y.ravel()).reshape(x.shape)
        assert np.all(distances.bound <= every.min(axis=0) + 1e-6)
        assert distances.begin == pytest.approx(every[0], abs=1e-6)
        assert distances.end == pytest.approx(every[-1], abs=1e-6)
        clear = every.min(axis=0) > 0.01 * parts.length
        assert clear.any()
        between = 0.5 * parts.length / 200.0
        assert np.all(distances.bound[clear] >= (every.min(axis=0) - between - 1e-6)[clear])
        # Where flight is not allowed the bound tells how deep it is, to the chord's length.
        assert np.all(distances.bound >= every.min(axis=0) - parts.length - 1e-6)


def test_what_is_enough_is_not_computed_but_stays_a_bound() -> None:
    rng = np.random.default_rng(10)
    area, parts = Area(shapes(11, 3)[2]), chords(rng, 2_000)
    exact, quick = chord_distances(area, parts), chord_distances(area, parts, 200.0)
    assert np.all(quick.bound <= exact.bound + 1e-9)
    np.testing.assert_array_equal(quick.bound < 200.0, exact.bound < 200.0)
    near = exact.bound < 200.0
    np.testing.assert_array_equal(quick.bound[near], exact.bound[near])
    assert np.any(quick.bound < exact.bound)


@pytest.mark.parametrize("keep", Keep)
def test_parts_that_follow_one_another_are_judged_as_each_alone(keep: Keep) -> None:
    rng = np.random.default_rng(12)
    for shape in shapes(13, 6):
        x, y = np.cumsum(rng.normal(0.0, 250.0, (2, 400)), axis=1)
        parts = Parts(x[:-1], y[:-1], x[1:], y[1:])
        mixed, area = rng.permutation(399), Area(shape, keep)
        row = chord_distances(area, parts)
        alone = chord_distances(area, Parts(*(field[mixed] for field in parts)))
        for field_in_row, field_alone in zip(row, alone, strict=True):
            np.testing.assert_array_equal(field_in_row[mixed], field_alone)


def test_places_on_an_edge_or_a_corner_are_no_distance_away() -> None:
    square = Polygon(((0.0, 0.0), (2e3, 0.0), (2e3, 2e3), (0.0, 2e3)))
    on = [(0.0, 0.0), (7e2, 0.0), (2e3, 3e2), (2e3, 2e3)]
    for x, y in on:
        for keep in Keep:
            parts = Parts(*np.array([[x], [y], [x + 30.0], [y - 40.0]]))
            distances = chord_distances(Area(square, keep), parts)
            assert abs(distances.begin[0]) == 0.0
            assert distances.bound[0] <= 0.0


def test_a_long_chord_through_a_thin_wall_is_seen() -> None:
    wall = Area(Polygon(((0.0, -9e3), (1e-3, -9e3), (1e-3, 9e3), (0.0, 9e3))))
    distances = chord_distances(wall, Parts(*np.array([[-50.0], [0.0], [50.0], [1.0]])))
    assert (distances.begin[0], distances.end[0]) == pytest.approx((50.0, 49.999))
    assert distances.bound[0] <= 0.0


def test_the_rectangle_is_never_farther_than_the_area() -> None:
    rng = np.random.default_rng(14)
    for shape in shapes(15, 10):
        parts = chords(rng, 500)
        exact, quick = chord_distances(Area(shape), parts), box_distance(Area(shape), parts)
        assert np.all(quick <= np.maximum(exact.bound, 0.0) + 1e-9)
        assert np.any(quick > 0.0) and np.any(quick == 0.0)


def test_pieces_of_the_batch_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(16)
    area, parts = Area(Polygon(star(rng, 50, 3_000.0))), chords(rng, 300)
    whole = chord_distances(area, parts)
    monkeypatch.setattr(area_geometry, "_CHUNK", 700)
    for field, field_in_pieces in zip(whole, chord_distances(area, parts), strict=True):
        np.testing.assert_array_equal(field, field_in_pieces)
