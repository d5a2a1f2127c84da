"""An area is what it says, or is refused in one sentence that names the field."""

import math
import time
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from envs.area_geometry import signed_distance
from envs.areas import (
    LARGEST_RADIUS,
    MOST_POINTS,
    Area,
    AreaError,
    Circle,
    Keep,
    Level,
    Polygon,
    after,
    signed_size,
)

SQUARE = ((0.0, 0.0), (2e3, 0.0), (2e3, 2e3), (0.0, 2e3))
HOLE = ((5e2, 5e2), (8e2, 5e2), (8e2, 8e2))
BOW_TIE = ((0.0, 0.0), (2e3, 2e3), (2e3, 0.0), (0.0, 2e3))


def circle_of(count: int, radius: float = 5e3) -> list[tuple[float, float]]:
    turn = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    return list(
        zip((radius * np.cos(turn)).tolist(), (radius * np.sin(turn)).tolist(), strict=True)
    )


def move_ring(ring: Any, dx: float) -> Any:
    return tuple((x + dx, y) for x, y in ring)


def test_rings_are_kept_with_the_inside_on_the_left() -> None:
    polygon = Polygon(SQUARE[::-1] + SQUARE[-1:], (HOLE,))
    assert signed_size(polygon.outer) == pytest.approx(4e6)
    assert signed_size(polygon.holes[0]) == pytest.approx(-4.5e4)
    assert set(polygon.outer) == set(SQUARE)


def test_repeated_points_are_one() -> None:
    twice = tuple(point for point in SQUARE for _ in range(2))
    assert Polygon((*twice, SQUARE[0])) == Polygon(SQUARE)


@pytest.mark.parametrize(
    ("rings", "problem"),
    [
        ((SQUARE[:2],), r"outer has 2 different points, expected 3 or more"),
        ((SQUARE[:1] * 5,), r"outer has 1 different points"),
        ((BOW_TIE,), r"outer crosses or touches itself: its edge from point 0 and its edge from"),
        (((*SQUARE, (1e3, 0.0), (1e3, 1e3), (-1e3, 1e3)),), r"outer crosses or touches itself"),
        ((((0.0, 0.0), (2e3, 0.0), (1e3, 0.0), (1e3, 1e3)),), r"outer crosses or touches itself"),
        ((((0.0, 0.0), (1e3, 1e3), (2e3, 2e3)),), r"outer has its points on one line"),
        ((move_ring(SQUARE, 1e7),), r"outer\[0\].x is 1e\+07 m, expected -1e\+06 to 1e\+06 m"),
        (((*SQUARE, (0.0, math.nan)),), r"outer\[4\].y is nan m, expected"),
        ((((0, 0), (math.inf, 0), (0, 1)),), r"outer\[1\].x is inf m"),
        ((((0, 0), ("a", 0), (0, 1)),), r"outer\[1\].x is 'a', expected a number"),
        ((((0, 0), (1, 0, 0), (0, 1)),), r"outer\[1\] is \(1, 0, 0\), expected x and y"),
        (("square",), r"outer is str, expected a sequence of points"),
        ((((0, 0), (311e3, 0), (0, 1e3)),), r"outer is 311 km wide in x, expected 300 km at most"),
        (
            (SQUARE, (move_ring(HOLE, 5e3),)),
            r"holes\[0\] lies outside of outer, expected it inside",
        ),
        ((SQUARE, (move_ring(HOLE, 1.5e3),)), r"holes\[0\] crosses or touches outer"),
        ((SQUARE, (HOLE, move_ring(HOLE, 1e2))), r"holes\[0\] crosses or touches holes\[1\]"),
        (
            (SQUARE, (((1e2, 1e2), (15e2, 1e2), (15e2, 15e2), (1e2, 15e2)), HOLE)),
            r"holes\[0\] and holes\[1\] lie one in the other",
        ),
        ((SQUARE, (BOW_TIE,)), r"holes\[0\] crosses or touches itself"),
    ],
)
def test_a_polygon_that_is_none_is_refused(rings: Any, problem: str) -> None:
    outer, *holes = rings
    with pytest.raises(AreaError, match=problem) as refusal:
        Polygon(outer, *(tuple(hole) for hole in holes))
    assert "\n" not in str(refusal.value)


def test_many_points_are_taken_in_time_and_too_many_refused() -> None:
    began = time.process_time()
    assert len(Polygon(tuple(circle_of(MOST_POINTS))).outer) == MOST_POINTS
    assert time.process_time() - began < 5.0
    with pytest.raises(AreaError, match=rf"outer has {MOST_POINTS + 2} points, expected"):
        Polygon(tuple(circle_of(MOST_POINTS + 2)))
    ring = tuple(circle_of(MOST_POINTS - 1))
    with pytest.raises(AreaError, match=r"outer and holes have 1026 points"):
        Polygon(ring, (((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)),))


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=9))
def test_exactly_the_simple_rings_are_taken(points: list[tuple[int, int]]) -> None:
    ring = [point for n, point in enumerate(points) if n == 0 or point != points[n - 1]]
    ring = ring[:-1] if len(ring) > 1 and ring[0] == ring[-1] else ring
    simple = len(ring) >= 3 and shapely.LinearRing(ring).is_simple
    # What shapely calls simple has an inside, but a line there and back it may call a ring.
    simple = simple and shapely.Polygon(ring).is_valid and shapely.Polygon(ring).area > 0.0
    try:
        polygon = Polygon(tuple(ring))
    except AreaError:
        assert not simple
    else:
        assert simple
        assert signed_size(polygon.outer) == pytest.approx(shapely.Polygon(ring).area)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ((0.0, 0.0, 0.0), r"radius is 0 m, expected more than 0 m"),
        ((0.0, 0.0, -1.0), r"radius is -1 m"),
        ((0.0, 0.0, 2.0 * LARGEST_RADIUS), r"radius is 60000 m, expected 0 to 30000 m"),
        ((math.nan, 0.0, 1.0), r"x is nan m"),
        ((0.0, None, 1.0), r"y is None, expected a number"),
    ],
)
def test_a_circle_that_is_none_is_refused(fields: Any, problem: str) -> None:
    with pytest.raises(AreaError, match=problem):
        Circle(*fields)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"keep": "out"}, r"keep is 'out', expected Keep.OUT or Keep.IN"),
        ({"velocity": (1.0,)}, r"velocity is \(1.0,\), expected east and north"),
        ({"velocity": (1.0, math.nan)}, r"velocity\[1\] is nan m/s, expected -100 to 100 m/s"),
        ({"growth": 1e3}, r"growth is 1000 m/s"),
        ({"clearance": -1.0}, r"clearance is -1 m"),
        ({"clearance": math.nan}, r"clearance is nan m"),
        ({"floor": 100.0}, r"floor is 100.0, expected a Level or None"),
        ({"floor": Level(math.inf, "msl")}, r"floor.value is inf m"),
        ({"ceiling": Level(1.0, "")}, r"ceiling.reference is '', expected a name"),
        (
            {"floor": Level(300.0, "msl"), "ceiling": Level(300.0, "msl")},
            r"ceiling is 300 m, expected more than the floor of 300 m",
        ),
        ({"valid_from": 9.0, "valid_until": 9.0}, r"valid_until is 9 s, expected more than"),
        ({"valid_from": 9.0, "valid_until": 1.0}, r"valid_until is 1 s, expected more than"),
        ({"valid_until": math.nan}, r"valid_until is nan s"),
        ({"name": 7}, r"name is 7, expected a text"),
    ],
)
def test_an_area_that_is_none_is_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(AreaError, match=problem):
        Area(Circle(0.0, 0.0, 1.0), **fields)
    with pytest.raises(AreaError, match=r"shape is tuple, expected a Polygon or a Circle"):
        Area((0.0, 0.0, 1.0))  # pyright: ignore[reportArgumentType]


def test_levels_of_different_references_are_not_compared() -> None:
    area = Area(Circle(0, 0, 1), floor=Level(300.0, "ground"), ceiling=Level(300.0, "msl"))
    assert area.floor is not None
    assert area.ceiling is not None
    assert area.floor.value == area.ceiling.value


@pytest.mark.parametrize("keep", Keep)
@pytest.mark.parametrize("growth", [0.0, 0.4, -0.4])
@pytest.mark.parametrize("shape", [Circle(10.0, 20.0, 900.0), Polygon(SQUARE, (HOLE,))])
def test_an_area_some_seconds_later_asks_for_no_less(keep: Keep, growth: float, shape: Any) -> None:
    area = Area(shape, keep, (7.0, -3.0), growth, valid_from=50.0, clearance=20.0)
    later = after(area, 30.0)
    assert (later.valid_from, later.valid_until) == (20.0, math.inf)
    x, y = np.random.default_rng(1).uniform(-3e3, 3e3, (2, 500))
    for seconds in (0.0, 100.0):
        spare = signed_distance(area, x, y, seconds + 30.0) - area.clearance
        spare_later = signed_distance(later, x, y, seconds) - later.clearance
        assert spare_later == pytest.approx(spare, abs=1e-7)
    shrunk = after(Area(Circle(0.0, 0.0, 9e2), growth=-1.0, clearance=20.0), 30.0)
    assert shrunk.clearance == 0.0
