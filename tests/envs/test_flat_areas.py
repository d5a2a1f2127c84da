"""Distances of chords from areas in plain floats are those of the arrays."""

import math

import numpy as np
import pytest

from envs.area_geometry import Parts, chord_distances
from envs.areas import Area, Circle, Keep, Polygon
from envs.flat_areas import (
    SIDE,
    chord_bound,
    flat,
    scalar_box_distance,
    scalar_chord_distances,
)

SQUARE = ((-900.0, -900.0), (900.0, -900.0), (900.0, 900.0), (-900.0, 900.0))
STAR = ((2_000.0, 0.0), (400.0, 500.0), (-300.0, 1_900.0), (-900.0, -100.0), (200.0, -1_500.0))
SHAPES = (
    Circle(300.0, -200.0, 1_700.0),
    Polygon(SQUARE),
    Polygon(STAR),
    Polygon(SQUARE, (((-300.0, -300.0), (400.0, -200.0), (100.0, 500.0)),)),
)


@pytest.mark.parametrize("keep", list(Keep))
@pytest.mark.parametrize(
    "enough",
    [
        *(pytest.param(near, marks=pytest.mark.slow) for near in (-math.inf, 50.0, 1_000.0)),
        math.inf,
    ],
)
def test_chords_are_as_far_as_by_arrays(keep: Keep, enough: float) -> None:
    rng, areas = np.random.default_rng(7), [Area(shape, keep) for shape in SHAPES]
    count, nothing = 400, [0.0] * len(areas)
    flat_areas, lines = (
        table.view(np.recarray) for table in flat(areas, nothing, nothing, nothing)
    )
    x0, y0 = rng.uniform(-4_000.0, 4_000.0, (2, count))
    length, course = rng.choice([0.0, 40.0, 500.0, 5_000.0], count), rng.uniform(-3.0, 3.0, count)
    # A third of them begin where the one before ends.
    x1, y1 = x0 + length * np.cos(course), y0 + length * np.sin(course)
    x0[1::3], y0[1::3] = x1[:-1:3], y1[:-1:3]
    parts = Parts(x0, y0, x1, y1)
    for a, area in enumerate(areas):
        expected = chord_distances(area, parts, np.full(count, enough))
        bounds = [
            chord_bound(flat_areas[a], lines, *chord, enough) for chord in zip(*parts, strict=True)
        ]
        np.testing.assert_allclose(bounds, expected.bound, atol=1e-9, rtol=0.0)
        side = np.full(1, np.nan, SIDE).view(np.recarray)[0]
        distances = [
            scalar_chord_distances(flat_areas[a], lines, *chord, enough, side)
            for chord in zip(*parts, strict=True)
        ]
        np.testing.assert_allclose(np.transpose(distances), expected, atol=1e-9, rtol=0.0)
        if keep is Keep.OUT:
            box = [scalar_box_distance(flat_areas[a], *place) for place in zip(x0, y0, strict=True)]
            assert np.all(np.array(box) <= np.maximum(expected.begin, 0.0) + 1e-9)
