"""Areas close bands exactly where the planner would refuse the manoeuvre: by dense sampling."""

import math
from typing import Any

import numpy as np
import pytest

from agents.assurance.alerts import Alerting, Region, regions
from agents.assurance.bands import Bands, area_losses, heading_bands, recovery, speed_bands
from agents.assurance.inputs import no_areas
from agents.kernel.areas import ActiveArea, required_distances
from agents.kernel.traffic import Requirement, Traffic
from agents.kernel.trajectory import HOLDS
from agents.planner import Options, plan
from agents.planner.recheck import reconstruct
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.area_geometry import gain
from envs.areas import Area, Circle, Keep, Polygon
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.random_areas import random_areas
from envs.trees import take
from envs.waypoints import ARCS, RoutePoint, at, legs, plan_states
from tests.agents.assurance.test_bands import GOOD, path_of
from tests.agents.kernel.test_areas import random_area
from tests.envs.test_area_geometry import truth
from tests.support import random_states, vehicle

MARGIN = 20.0
REQUIREMENT = Requirement(1_000.0, margin=MARGIN)
LIMITS = C208_PUBLISHED
LOOK_AHEAD = 120.0
STEP = 0.25  # s between samples
TIMES = np.arange(0.0, LOOK_AHEAD + STEP, STEP)


def nobody(count: int) -> Traffic:
    return Traffic.straight(VehicleState(*np.zeros((4, count, 0))))


def of_rows(*areas: tuple[ActiveArea, ...]) -> Any:
    rows = no_areas(len(areas))
    rows[:] = areas
    return rows


def counted(*areas: Area, end: float = 900.0) -> tuple[ActiveArea, ...]:
    return tuple(ActiveArea(n, area, 0.0, end) for n, area in enumerate(areas))


def sample(
    own: VehicleState, bands: Bands, number: int, active: ActiveArea, kind: str
) -> np.ndarray:
    """Return the clearances of one band's manoeuvre over the times, m, nan where the area does not
    count.
    """
    if kind == "heading":
        every = take(own, np.zeros(TIMES.size, dtype=int))
        x, y = path_of(every, bands, number, TIMES, LIMITS)[:2]
    else:
        gain_by = bands.target[0, number] - own.speed[0]
        rate = LIMITS.acceleration_max if gain_by > 0.0 else LIMITS.acceleration_min
        changing = np.minimum(TIMES, gain_by / rate) if gain_by else 0.0 * TIMES
        far = own.speed[0] * changing + 0.5 * rate * changing**2
        far = far + (own.speed[0] + rate * changing) * (TIMES - changing)
        x = own.x[0] + far * np.cos(own.heading[0])
        y = own.y[0] + far * np.sin(own.heading[0])
    area = active.area
    x, y = (v - w * TIMES for v, w in zip((x, y), area.velocity, strict=True))
    away = truth(area.shape, area.keep, x, y) + gain(area) * TIMES
    need = required_distances(active, own.x, own.y, MARGIN)
    return np.where((active.begin <= TIMES) & (active.end >= TIMES), away - need, np.nan)


@pytest.mark.parametrize("kind", ["heading", "speed"])
def test_a_band_is_closed_where_its_manoeuvre_comes_too_near_to_an_area(kind: str) -> None:
    rng = np.random.default_rng(5)
    both = []
    for _ in range(25):
        own = random_states(rng, 1, extent=3_000.0)
        begin, end = sorted(rng.uniform(0.0, 150.0, 2)) if rng.random() < 0.3 else (0.0, 900.0)
        area = ActiveArea(7, random_area(rng), float(begin), float(end))
        compute = heading_bands if kind == "heading" else speed_bands
        bands = compute(own, nobody(1), REQUIREMENT, LIMITS, LOOK_AHEAD, areas=of_rows((area,)))
        for number in range(0, bands.target.shape[1], 6):
            if kind == "speed" and bands.reached[0, number] >= LOOK_AHEAD:
                continue
            clearance = sample(own, bands, number, area, kind)
            if np.isnan(clearance).all():
                assert not bands.closed[0, number]
                continue
            least, closed = float(np.nanmin(clearance)), bool(bands.closed[0, number])
            # Between samples it comes 10 m nearer at an edge at most, beside one by far less.
            assert closed or least > -0.1
            assert not closed or least < 12.0
            assert bands.clearance[0, number] <= least + 0.1
            both.append(closed)
            if not closed or least > -15.0:
                continue
            lost = np.flatnonzero(clearance < 0.0)
            assert bands.area[0, number] == 7 and bands.intruder[0, number] == -1
            assert bands.loss[0, number] == pytest.approx(TIMES[lost[0]], abs=1.0)
            opens = bands.opens[0, number]
            if TIMES[lost[-1]] < min(LOOK_AHEAD, area.end) - 5.0:
                assert TIMES[lost[-1]] - 1.0 <= opens <= TIMES[lost[-1]] + 7.0
    assert 0.1 < np.mean(both) < 0.9


def test_traffic_and_areas_are_told_apart_by_what_is_lost_first() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    traffic = Traffic.straight(
        VehicleState(*(np.array([[value]]) for value in (9_000.0, 0.0, math.pi, 70.0)))
    )
    north = Area(Circle(1_500.0, 5_000.0, 1_000.0))
    for away, first in ((2_000.0, "area"), (9_000.0, "intruder")):
        ahead = Area(Circle(away, 0.0, 300.0), clearance=50.0)
        bands = heading_bands(
            own,
            traffic,
            REQUIREMENT,
            LIMITS,
            LOOK_AHEAD,
            np.radians([-90.0, 0.0, 90.0]),
            of_rows(counted(north, ahead)),
        )
        assert bands.closed.tolist() == [[False, True, True]]
        assert bands.area.tolist() == [[-1, 1 if first == "area" else -1, 0]]
        assert bands.intruder.tolist() == [[-1, 0 if first == "intruder" else -1, -1]]
    near = counted(Area(Circle(2_000.0, 0.0, 300.0), clearance=50.0))
    loss = area_losses(own, near, MARGIN, LOOK_AHEAD)
    assert loss == pytest.approx([(2_000.0 - 350.0 - MARGIN) / 80.0], abs=0.5)


def test_out_of_an_area_the_shortest_way_is_the_way_out() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    # The edge to the north is the nearest; a turn to it takes 30 s.
    area = Area(Polygon(((-9e3, -9e3), (9e3, -9e3), (9e3, 2_500.0), (-9e3, 2_500.0))))
    bands = heading_bands(
        own, nobody(1), REQUIREMENT, LIMITS, LOOK_AHEAD, areas=of_rows(counted(area))
    )
    assert bands.closed.all() and (bands.loss == 0.0).all()
    way_out = recovery(bands, 1_000.0)
    assert math.sin(bands.target[0, way_out.index[0]]) > 0.9
    assert 30.0 < way_out.opens[0] < 60.0 and way_out.clearance[0] < 0.0
    shown = regions(bands, Alerting.for_aircraft(PAPER), 1_000.0)
    assert shown[0, way_out.index[0]] == Region.RECOVERY
    assert (np.delete(shown[0], way_out.index[0]) == Region.WARNING).all()


def test_an_area_that_does_not_count_or_cannot_be_reached_closes_nothing() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    ahead = Area(Circle(3_000.0, 0.0, 500.0))
    for area in (
        ActiveArea(0, ahead, 0.0, 10.0),
        ActiveArea(0, ahead, 130.0, 900.0),
        ActiveArea(0, Area(Circle(40_000.0, 0.0, 500.0)), 0.0, 900.0),
        ActiveArea(0, Area(Circle(0.0, 0.0, 25_000.0), Keep.IN), 0.0, 900.0),
    ):
        bands = heading_bands(
            own, nobody(1), REQUIREMENT, LIMITS, LOOK_AHEAD, areas=of_rows((area,))
        )
        assert not bands.closed.any() and (bands.area == -1).all()


def test_areas_of_one_row_do_not_touch_another() -> None:
    rng = np.random.default_rng(3)
    own = random_states(rng, 5, extent=2_000.0)
    others = Traffic.straight(random_states(rng, 5, 2, extent=6_000.0))
    areas = no_areas(5)
    areas[2] = counted(Area(Circle(0.0, 0.0, 3_000.0)))
    alone = heading_bands(own, others, REQUIREMENT, LIMITS, LOOK_AHEAD)
    beside = heading_bands(own, others, REQUIREMENT, LIMITS, LOOK_AHEAD, areas=areas)
    rows = np.array([0, 1, 3, 4])
    for had, has in zip(alone, beside, strict=True):
        np.testing.assert_array_equal(had[rows], has[rows])
    assert beside.closed[2].sum() > alone.closed[2].sum()


@pytest.mark.slow
def test_a_safe_plan_never_holds_a_band_that_an_area_closes() -> None:
    """Until a band's loss a SAFE plan must have left its manoeuvre by what is missing then."""
    policy = Policy.load()
    options = Options.for_aircraft(PAPER, deadline_s=math.inf)
    rng = np.random.default_rng(8)
    telling = 0
    for number in range(12):
        own = VehicleState(0.0, 0.0, float(rng.uniform(-0.5, 0.5)), 80.0)
        goal = 14_000.0, float(rng.uniform(-4_000.0, 4_000.0))
        areas = random_areas(4, number, 3, own, goal, PAPER)
        route = [RoutePoint(n, goal[0] + 5_000.0 * n, goal[1]) for n in range(8)]
        answer = plan(own, [], route, policy, options, areas=areas)
        if not answer.safe:
            continue
        planned_flight = reconstruct(answer.waypoints)
        curves = take(legs(plan_states(own, planned_flight.waypoints)), None)
        start = vehicle(*own)
        for look_ahead in (20.0, 40.0, 80.0, 120.0):
            towards = float(at(curves, np.full(1, 0.7 * look_ahead)).heading[0])
            targets = wrap(towards + np.radians([0.0, 3.0, -3.0, 30.0, -30.0]), np)
            bands = heading_bands(
                start,
                nobody(1),
                options.requirement,
                options.manoeuvre,
                look_ahead,
                targets,
                of_rows(counted(*areas)),
            )
            for band in range(targets.size):
                apart = 0.0
                for time in np.linspace(0.0, look_ahead, 25)[1:]:
                    planned = at(curves, np.full(1, time))
                    held = path_of(start, bands, band, float(time), options.manoeuvre)
                    off = math.hypot(planned.x[0] - held.x[0], planned.y[0] - held.y[0])
                    apart = max(apart, off)
                # Where it is lost, the bound is too small by half the way of an arc at most.
                coarse = 0.5 * own.speed * look_ahead / (HOLDS * ARCS)
                assert bands.clearance[0, band] >= -(1.05 * apart + 1.0) - GOOD - coarse
                telling += int(bands.clearance[0, band] < 200.0 - apart)
    assert telling >= 5
