"""The clearance from areas by compiled code is that by numpy."""

import numpy as np
import pytest

from agents.kernel import areas as kernel_areas
from agents.kernel.areas import ActiveArea, AreaClearance, area_clearance
from agents.kernel.clearance import clearance
from agents.kernel.scalar_areas import FILL_AREA_CLEARANCE
from agents.kernel.trajectory import Trajectory
from envs.areas import Area, Circle, Keep, Polygon
from tests.agents.kernel.test_areas import random_area
from tests.agents.kernel.test_scalar_separation import KINDS, assert_same, both, random_flight
from tests.envs.test_area_geometry import star

pytestmark = pytest.mark.usefixtures("compiled_code")


def question(
    rng: np.random.Generator, kind: str, count: int
) -> tuple[Trajectory, AreaClearance, float]:
    """Return what is flown, what is kept from so many areas, and the level of interest, m."""
    flown = random_flight(rng, kind)
    rows = len(flown.states.time)
    areas = [
        ActiveArea(number, random_area(rng), begin, begin + float(rng.choice([25.0, 200.0])))
        for number, begin in enumerate(rng.choice([0.0, 0.0, 20.0, 70.0], count).tolist())
    ]
    own = flown.states.x[:, 0], flown.states.y[:, 0]
    keeping = area_clearance(areas, *own, float(rng.choice([0.0, 0.02, 50.0])))
    if rng.random() < 0.3:
        keeping = keeping._replace(required=np.zeros((rows, count)))
    return flown, keeping, float(rng.choice([0.0, 500.0, np.inf, -200.0]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [0, 1, 3, 8])
def test_compiled_code_keeps_what_numpy_keeps(
    monkeypatch: pytest.MonkeyPatch, kind: str, count: int
) -> None:
    assert FILL_AREA_CLEARANCE.ready
    rng, lost, count_kept = np.random.default_rng([9, count, len(kind)]), 0, 0
    for _ in range(25):
        by_loops, by_numpy = both(monkeypatch, *question(rng, kind, count))
        assert_same(by_loops, by_numpy)
        lost += np.count_nonzero(by_numpy.margin < 0.0)
        count_kept += np.count_nonzero(by_numpy.margin >= 0.0)
    assert count == 0 or (lost > 0 and count_kept > 0)


def test_edges_that_are_touched_are_lost_or_kept_by_both(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flights along an edge, through corners, and from an edge."""
    flown = KINDS["straight"](0, 1)
    x, y = flown.states.x[0, [0, 2]], flown.states.y[0, [0, 2]]
    ahead, left = (x[1] - x[0], y[1] - y[0]), (-0.1 * (y[1] - y[0]), 0.1 * (x[1] - x[0]))
    shares = {
        "along": ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
        "corner": ((0.5, 0.0), (0.9, 1.0), (0.1, 1.0)),
        "across": ((0.5, -1.0), (0.9, 0.0), (0.5, 1.0), (0.1, 0.0)),
        "behind": ((-1.0, -1.0), (0.0, -1.0), (0.0, 1.0), (-1.0, 1.0)),
    }
    shapes = [
        Polygon(
            tuple(
                (
                    float(x[0] + along * ahead[0] + aside * left[0]),
                    float(y[0] + along * ahead[1] + aside * left[1]),
                )
                for along, aside in ring
            )
        )
        for ring in shares.values()
    ]
    circle = Circle(float(x[0] + left[0]), float(y[0] + left[1]), float(np.hypot(*left)))
    for keep in Keep:
        areas = [
            ActiveArea(n, Area(shape, keep), 0.0, 100.0)
            for n, shape in enumerate([*shapes, circle])
        ]
        keeping = area_clearance(areas, x[:1], y[:1], 0.0)
        by_loops, by_numpy = both(monkeypatch, flown, keeping)
        # Of equal distances rounding tells which is the least.
        assert_same(by_loops._replace(distance_time=by_numpy.distance_time), by_numpy)


def test_many_trajectories_and_edges_are_split_and_all_are_filled_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng, flown = np.random.default_rng(3), KINDS["plan"](4, 7)
    areas = [ActiveArea(n, random_area(rng), 0.0, 200.0) for n in range(3)]
    large = Polygon(star(rng, 400, 5_000.0))
    areas.append(ActiveArea(3, Area(large, clearance=100.0), 10.0, 90.0))
    keeping = area_clearance(areas, flown.states.x[:, 0], flown.states.y[:, 0], 5.0)
    split, by_numpy = both(monkeypatch, flown, keeping)
    monkeypatch.setattr(kernel_areas, "_EDGES", 10**9)
    whole, _ = both(monkeypatch, flown, keeping)
    assert_same(whole, by_numpy)
    for field, split_field in zip(whole, split, strict=True):
        np.testing.assert_array_equal(field, split_field)


def test_the_closest_is_found_without_compiled_code(monkeypatch: pytest.MonkeyPatch) -> None:
    flown, keeping, _ = question(np.random.default_rng(4), "plan", 3)
    for compiled_field, numpy_field in zip(
        *both(monkeypatch, flown, keeping, closest=True), strict=True
    ):
        np.testing.assert_array_equal(compiled_field, numpy_field)


def test_arrays_of_another_shape_are_refused() -> None:
    flown, keeping, _ = question(np.random.default_rng(6), "straight", 4)
    with pytest.raises(ValueError, match="same shape"):
        clearance(flown, keeping._replace(required=keeping.required[:, :3]))
    with pytest.raises(ValueError, match="same shape"):
        clearance(flown._replace(bend=flown.bend[:, 1:]), keeping)
