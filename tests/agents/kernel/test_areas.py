"""Plans keep the clearance from areas, or it is said from which, when and where: by dense sampling
and shapely.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from agents.kernel.areas import (
    NEARER,
    ActiveArea,
    area_clearance,
    relevant,
    required_distances,
    window,
)
from agents.kernel.clearance import Clearance, clearance
from agents.kernel.levels import Altitude, steady
from agents.kernel.trajectory import trajectory
from envs.area_geometry import gain
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, at, legs, repeat
from tests.agents.planner.test_validator import plans
from tests.envs.test_area_geometry import star, truth

STEP = 0.05
END = 200.0


def random_area(rng: np.random.Generator) -> Area:
    """Return an area somewhere round the plans, of any kind."""
    x, y = rng.uniform(-6_000.0, 6_000.0, 2)
    size = float(rng.uniform(500.0, 6_000.0))
    keep = Keep.IN if rng.random() < 0.3 else Keep.OUT
    size = 9_000.0 + size if keep is Keep.IN else size
    shape: Any = Circle(float(x), float(y), size)
    if rng.random() < 0.7:
        ring, hole = (
            np.add(star(rng, count, extent), (x, y))
            for count, extent in ((int(rng.integers(5, 20)), size), (4, 0.1 * size))
        )
        shape = Polygon(tuple(map(tuple, ring)), (tuple(map(tuple, hole)),))
    moves = rng.random() < 0.5
    return Area(
        shape,
        keep,
        velocity=tuple(rng.uniform(-20.0, 20.0, 2)) if moves else (0.0, 0.0),
        growth=float(rng.uniform(-1.0, 2.0)) if moves else 0.0,
        clearance=float(rng.choice([0.0, 50.0, 300.0])),
    )


def kept_by(
    plan_states: PlanStates, areas: Sequence[ActiveArea], margin: float = 0.0, level: float = 0.0
) -> Clearance:
    """Return what plans keep of areas, ``[N, K]``."""
    begin = plan_states.x[:, 0], plan_states.y[:, 0]
    return clearance(trajectory(plan_states), area_clearance(areas, *begin, margin), level)


def wrong(clearances: Clearance) -> np.ndarray:
    """Return which plans lose the clearance of some area, bool ``[N]``."""
    return np.isfinite(clearances.loss).any(axis=1)


def sample(plan_states: PlanStates, active_area: ActiveArea) -> tuple[np.ndarray, np.ndarray]:
    """Return times and the signed distances of plans then, ``[T, N]``, while the area counts."""
    curves, area = legs(plan_states), active_area.area
    times = np.arange(
        active_area.begin, min(active_area.end, float(plan_states.time[0, -1])) + 1e-9, STEP
    )
    away = []
    for time in np.array_split(times[:, None], math.ceil(times.size / 100)):
        rows = len(time)
        state = at(repeat(curves, rows), np.broadcast_to(time, (rows, len(plan_states.time))))
        x, y = (v - w * time for v, w in zip((state.x, state.y), area.velocity, strict=True))
        away.append(truth(area.shape, area.keep, x, y) + gain(area) * time)
    return times, np.concatenate(away)


@pytest.mark.parametrize("seed", range(4))
def test_a_plan_keeps_its_clearance_exactly_if_it_is_said_to(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plan_states = plans(12, seed)
    count_kept, lost = 0, 0
    for _ in range(6):
        begin, end = sorted(rng.uniform(0.0, END, 2)) if rng.random() < 0.4 else (0.0, END)
        active_area = ActiveArea(3, random_area(rng), float(begin), float(end))
        margin = float(rng.choice([0.0, 0.02]))
        clearances = kept_by(plan_states, [active_area], margin)
        fails, margins, loss, leg, x, y = (
            wrong(clearances),
            *(
                field[:, 0]
                for field in (
                    clearances.margin,
                    clearances.loss,
                    clearances.leg,
                    clearances.x,
                    clearances.y,
                )
            ),
        )
        times, away = sample(plan_states, active_area)
        need = required_distances(active_area, plan_states.x[:, 0], plan_states.y[:, 0], margin)
        least = away.min(axis=0) - need
        # Samples miss the nearest point by 1 m at 100 m/s at most, beside an edge by far less.
        assert np.all(fails[least < -0.002])
        assert not np.any(fails[least > 0.05])
        assert np.all(margins <= least + 0.0021)
        np.testing.assert_array_equal(fails, margins < 0.0)
        count_kept, lost = count_kept + np.count_nonzero(~fails), lost + np.count_nonzero(fails)
        for n in np.flatnonzero(fails):
            lost_at = times[np.argmax(away[:, n] < need[n] - 0.002)]
            # The part that is noted begins before the clearance is lost; an arc at most.
            assert lost_at - 2.1 <= loss[n] <= lost_at + STEP
            state = at(legs(PlanStates(*(field[n] for field in plan_states))), loss[n])
            assert math.hypot(state.x - x[n], state.y - y[n]) < 0.01
            assert plan_states.time[n, leg[n]] <= loss[n] + 1e-9
            assert loss[n] <= plan_states.time[n, leg[n] + 1]
    assert count_kept > 10
    assert lost > 10


def test_the_first_and_the_nearest_of_several_areas_are_named() -> None:
    straight = PlanStates(
        *(np.array([row]) for row in ([0.0, 2e3, 4e3], [0.0] * 3, [0.0] * 3, [100.0] * 3)),
        time=np.array([[0.0, 20.0, 40.0]]),
    )
    late, early, beside = Circle(3e3, 0.0, 200.0), Circle(1e3, 100.0, 150.0), Circle(2e3, 5e2, 3e2)
    areas = [
        ActiveArea(n, Area(disc), 0.0, 40.0) for n, disc in ((4, late), (7, early), (9, beside))
    ]
    clearances = kept_by(straight, areas)
    first = np.argmin(clearances.loss[0])
    assert (wrong(clearances)[0], areas[first].number, clearances.leg[0, first]) == (True, 7, 0)
    # The chord of the early disc begins at 1000 - sqrt(150^2 - 100^2).
    assert clearances.loss[0, first] == pytest.approx(8.88, abs=0.07)
    assert (clearances.x[0, first], clearances.y[0, first]) == pytest.approx((888.0, 0.0), abs=7.0)
    assert areas[np.argmin(clearances.margin[0])].number == 4
    assert clearances.margin.min() == pytest.approx(-200.0, abs=200.0)
    assert not wrong(kept_by(straight, areas[2:]))[0]
    assert clearances.margin[0, 2] == pytest.approx(200.0, abs=0.01)
    closely = kept_by(straight, areas[2:], level=math.inf)
    assert closely.margin[0, 0] == pytest.approx(200.0, abs=0.01)


def test_a_plan_that_begins_inside_the_clearance_must_not_come_nearer() -> None:
    def way(heading: float) -> PlanStates:
        distance = np.array([0.0, 2e3, 4e3])
        x, y = 600.0 + distance * math.cos(heading), distance * math.sin(heading)
        motion = np.full(3, heading), np.full(3, 100.0), np.array([0.0, 20.0, 40.0])
        return PlanStates(*(field[None] for field in (x, y, *motion)))

    active_area = ActiveArea(0, Area(Circle(0.0, 0.0, 500.0), clearance=300.0), 0.0, 40.0)
    for heading, lost in ((0.0, False), (math.pi / 2.0, False), (math.pi / 2.0 + 0.05, True)):
        plan_states = way(heading)
        assert wrong(kept_by(plan_states, [active_area]))[0] == lost, heading
    assert required_distances(active_area, 600.0, 0.0, 0.02) == pytest.approx(100.0 - NEARER)
    assert required_distances(active_area, 400.0, 0.0, 0.02) == 0.0
    assert required_distances(active_area._replace(begin=1.0), 400.0, 0.0, 0.02) == pytest.approx(
        300.02
    )


def test_a_plan_that_begins_inside_keeps_nothing() -> None:
    plan_states = plans(20, 3)
    for keep, size in ((Keep.OUT, 9e3), (Keep.IN, 10.0)):
        active_area = ActiveArea(0, Area(Circle(0.0, 0.0, size), keep), 0.0, END)
        clearances = kept_by(plan_states, [active_area])
        assert wrong(clearances).all()
        np.testing.assert_array_equal(clearances.loss, 0.0)


def test_without_areas_nothing_is_wrong() -> None:
    plan_states = plans(4, 1)
    clearances = kept_by(plan_states, [])
    assert clearances.margin.shape == (4, 0) and not wrong(clearances).any()


def test_a_plan_is_judged_as_if_it_were_alone() -> None:
    rng = np.random.default_rng(8)
    plan_states = plans(20, 5)
    areas = [ActiveArea(n, random_area(rng), 0.0, END) for n in range(5)]
    together = kept_by(plan_states, areas)
    for n in range(20):
        alone = PlanStates(*(field[n : n + 1] for field in plan_states))
        for whole, part in zip(together, kept_by(alone, areas), strict=True):
            np.testing.assert_array_equal(whole[n : n + 1], part)


@given(
    st.floats(0.0, 2e3),
    st.one_of(st.none(), st.floats(-10.0, 10.0)),
    st.floats(0.0, 100.0),
    st.one_of(st.none(), st.floats(0.0, 1e3)),
    st.one_of(st.none(), st.floats(1.1e3, 2e3)),
    st.floats(0.0, 400.0),
)
def test_an_area_counts_exactly_while_the_ownship_may_be_level(
    height: float,
    climb: float | None,
    error: float,
    floor: float | None,
    ceiling: float | None,
    time: float,
) -> None:
    levels = [None if value is None else Level(value, "msl") for value in (floor, ceiling)]
    area = Area(Circle(0.0, 0.0, 1.0), floor=levels[0], ceiling=levels[1], valid_from=-1.0)
    rates = (-5.0, 5.0) if climb is None else (climb, climb)
    low, high = height - error + rates[0] * time, height + error + rates[1] * time
    level = (floor is None or high >= floor) and (ceiling is None or low <= ceiling)
    begin, end = window(area, Altitude(height, "msl", climb, error), 5.0)
    if min(abs(high - (floor or 0.0)), abs(low - (ceiling or 0.0))) > 1e-6:
        assert (begin <= time <= end) == level
    assert window(area, Altitude(height, "wgs84", climb, error), 5.0) == (-1.0, math.inf)
    assert window(area, None, 5.0) == (-1.0, math.inf)


def test_an_area_to_be_kept_in_counts_at_all_heights() -> None:
    low = Area(Circle(0.0, 0.0, 1.0), Keep.IN, ceiling=Level(100.0, "msl"))
    assert window(low, Altitude(500.0, "msl", 0.0), 5.0) == (-math.inf, math.inf)


def test_what_cannot_be_reached_or_does_not_count_is_left_out() -> None:
    own, settings = VehicleState(0.0, 0.0, 0.0, 80.0), {"horizon": 400.0, "unknown_climb": 10.0}
    areas = [
        Area(Circle(42_000.0, 0.0, 1e3)),
        Area(Circle(42_000.0, 0.0, 1e3), clearance=1_001.0),
        Area(Circle(42_000.0, 0.0, 1e3), velocity=(-3.0, 0.0)),
        Area(Circle(42_000.0, 0.0, 1e3), growth=3.0),
        Area(Circle(0.0, 0.0, 1e3), Keep.IN, valid_from=401.0),
        Area(Circle(0.0, 0.0, 1e3), valid_until=-1.0),
        Area(Circle(0.0, 0.0, 1e3), ceiling=Level(100.0, "msl")),
        Area(Circle(0.0, 0.0, 1e3), valid_from=10.0, valid_until=20.0),
        Area(Circle(19_000.0, 0.0, 1e3), valid_until=170.0),
    ]
    level = Altitude(500.0, "msl", 0.0)
    active_areas = relevant(areas, own, steady(level), fastest=100.0, margin=0.0, **settings)
    assert [active_area.number for active_area in active_areas] == [1, 2, 3, 7]
    assert (active_areas[3].begin, active_areas[3].end) == (10.0, 20.0)
    assert (active_areas[0].begin, active_areas[0].end) == (0.0, 400.0)


def test_nothing_that_is_left_out_can_be_met() -> None:
    plan_states = plans(200, 9)
    rng = np.random.default_rng(10)
    met = 0
    for _ in range(40):
        area = random_area(rng)
        active_area = ActiveArea(0, area, 0.0, END)
        lost = wrong(kept_by(plan_states, [active_area], margin=600.0))
        for n in range(0, 200, 10):
            own = VehicleState(*(float(field[n, 0]) for field in plan_states[:4]))
            settings = {"fastest": 100.0, "horizon": END, "unknown_climb": 9.0}
            left_out = not relevant([area], own, (), margin=600.0, **settings)
            assert not (left_out and lost[n])
            met += lost[n]
    assert met > 20


@pytest.mark.parametrize(
    "shape", [Circle(0.0, 0.0, 900.0), Polygon(((-9e2, -9e2), (9e2, 0.0), (-9e2, 9e2)))]
)
def test_an_area_that_shrinks_is_not_flown_through(shape: Polygon | Circle) -> None:
    ends = ([-3e3, 3e3], [0.0, 0.0], [0.0, 0.0], [100.0, 100.0], [0.0, 60.0])
    plan_states = PlanStates(*(np.array([row]) for row in ends))
    for growth, lost in ((0.0, True), (-0.3, True), (-60.0, False)):
        area = Area(shape, growth=growth, clearance=1.0)
        clearances = kept_by(plan_states, [ActiveArea(0, area, 0.0, 60.0)])
        assert wrong(clearances)[0] == lost
        assert (clearances.margin[0, 0] < 0.0) == lost


def test_second_opinion_on_a_corner() -> None:
    corner = Polygon(((0.0, 0.0), (900.0, -400.0), (900.0, 400.0)))
    plan_states = PlanStates(
        *(np.array([row]) for row in ([-50.0] * 2, [-2e3, 2e3], [math.pi / 2.0] * 2, [100.0] * 2)),
        time=np.array([[0.0, 40.0]]),
    )
    clearances = kept_by(plan_states, [ActiveArea(0, Area(corner, clearance=49.9), 0.0, 40.0)])
    line = shapely.LineString([(-50.0, -2e3), (-50.0, 2e3)])
    least = shapely.distance(line, shapely.Polygon(corner.outer))
    assert clearances.margin[0, 0] == pytest.approx(least - 49.9, abs=0.003)
    assert not wrong(clearances)[0]


def test_a_curve_that_bulges_towards_a_rectangle_is_not_thought_farther_than_it_is() -> None:
    for seed in range(20):
        plan_states = plans(1, 40 + seed)
        every = repeat(take(legs(plan_states), 0), 4_001)
        north = at(every, np.linspace(0.0, END, 4_001)).y.max() + 10.0
        ring = ((-1e5, north), (1e5, north), (1e5, north + 1e4), (-1e5, north + 1e4))
        active_area = ActiveArea(0, Area(Polygon(ring)), 0.0, END)
        assert 9.9 <= kept_by(plan_states, [active_area], level=20.0).margin[0, 0] <= 10.001
        assert 0.0 < kept_by(plan_states, [active_area]).margin[0, 0] <= 10.001
