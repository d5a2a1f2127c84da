"""The monitor gives up a plan that does not keep clear of areas, and its backup stays out of them
where any does: by dense sampling.
"""

import math

import numpy as np
import pytest

from agents.assurance import single
from agents.assurance.areas import judge_remaining_plans
from agents.assurance.backup import backup_states, search, surroundings
from agents.assurance.inputs import no_areas
from agents.assurance.single import Assessment, Watch
from agents.assurance.state import State
from agents.assurance.thresholds import Cause, Thresholds
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Requirement
from agents.kernel.trajectory import trajectory
from agents.planner.recheck import reconstruct
from agents.planner.request.options import Options
from agents.planner.request.request import Altitude
from envs.aircraft import PAPER
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, Waypoint, at, legs, repeat
from envs.wind import NO_WIND, Wind, over_ground
from tests.agents.assurance.test_backup import turning, winding
from tests.agents.kernel.test_areas import random_area
from tests.support import random_states

MARGIN = 40.0
THRESHOLDS = Thresholds.for_plans(
    Options.for_aircraft(PAPER, requirement=Requirement(1_000.0, margin=MARGIN))
)
SPEED = 75.0
STEP = 0.2  # s between samples
END = 400.0


def distances(plan_states: PlanStates, areas: tuple[ActiveArea, ...], first: float = 0.0) -> list:
    """Return the signed distances of one plan from its beginning or a time on, by area."""
    curves = legs(plan_states)
    times = np.arange(first, float(plan_states.time[0, -1]), STEP)
    state = at(repeat(take(curves, 0), times.size), times)
    return [signed_distance(active.area, state.x, state.y, times - first) for active in areas]


def of_rows(*areas: tuple[ActiveArea, ...]) -> np.ndarray:
    rows = no_areas(len(areas))
    rows[:] = areas
    return rows


def random_areas(rng: np.random.Generator, most: int = 2) -> tuple[ActiveArea, ...]:
    count = int(rng.integers(1, most + 1))
    return tuple(ActiveArea(n, random_area(rng), 0.0, END) for n in range(count))


def test_the_rest_of_a_plan_is_lost_exactly_where_it_comes_too_near() -> None:
    rng = np.random.default_rng(2)
    count = 24
    plan_states = winding(rng, count)
    plan = trajectory(plan_states)
    since = rng.uniform(0.0, 150.0, count)
    areas = no_areas(count)
    for n in range(count):
        areas[n] = random_areas(rng)
    off = rng.choice([0.0, 30.0], count)
    keeps = judge_remaining_plans(plan, since, areas, off, THRESHOLDS)
    lost = 0
    for n in range(count):
        required = np.maximum(0.5 * MARGIN, off[n])
        gap, loss = math.inf, math.inf
        away = distances(take(plan_states, slice(n, n + 1)), areas[n], since[n])
        for active, far in zip(areas[n], away, strict=True):
            # Inside the clearance it must not come nearer than it is.
            need = min(max(float(far[0]), 0.0), active.area.clearance + required)
            gap = min(gap, float(far.min()) - need)
            if (far < need - 0.5).any():
                loss = min(loss, STEP * int(np.argmax(far < need - 0.5)))
        # Of what has been flown of an arc, some metres may count.
        assert not keeps.lost[n] or gap < 0.0
        assert keeps.lost[n] or gap > -8.0
        if keeps.lost[n] and gap < -8.0:
            assert keeps.deficit[n] >= -gap - 8.0
            assert keeps.loss[n] == pytest.approx(loss, abs=2.5)
        lost += int(keeps.lost[n])
    assert 4 < lost < 22


def test_a_backup_enters_an_area_only_where_all_do() -> None:
    rng = np.random.default_rng(7)
    count = 24
    own = random_states(rng, count, extent=3_000.0)
    traffic = turning(rng, count)
    areas = no_areas(count)
    for n in range(count):
        areas[n] = random_areas(rng)
    backups = search(own, surroundings(traffic, areas), np.zeros(count), THRESHOLDS)
    assert 0 < np.count_nonzero(backups.depth > 0.0) < count
    assert 0 < np.count_nonzero(backups.safe) < count
    turns = np.radians(np.arange(-150.0, 151.0, 30.0))
    for n in range(count):
        away = distances(take(backups.plan_states, slice(n, n + 1)), areas[n])
        nearest = min(float(far.min()) for far in away)
        assert (nearest >= -0.3) == (backups.depth[n] == 0.0)
        if backups.safe[n]:
            starts = [
                min(float(far[0]), active.area.clearance + MARGIN)
                for active, far in zip(areas[n], away, strict=True)
            ]
            assert all(far.min() >= start - 0.5 for far, start in zip(away, starts, strict=True))
        if backups.depth[n] > 0.0:
            state = take(own, np.full(turns.size, n))
            speed = np.clip(state.speed, 50.0, 100.0)
            every = backup_states(state, state.heading + turns, speed, THRESHOLDS)
            for row in range(turns.size):
                away = distances(take(every, slice(row, row + 1)), areas[n])
                assert min(float(far.min()) for far in away) < 0.0


def test_areas_of_one_row_do_not_touch_another() -> None:
    rng = np.random.default_rng(3)
    own, traffic = random_states(rng, 6, extent=3_000.0), turning(rng, 6)
    alone = search(own, surroundings(traffic), np.zeros(6), THRESHOLDS)
    areas = no_areas(6)
    areas[2] = random_areas(rng)
    beside = search(own, surroundings(traffic, areas), np.zeros(6), THRESHOLDS)
    others = np.array([0, 1, 3, 4, 5])
    np.testing.assert_array_equal(alone.course[others], beside.course[others])
    np.testing.assert_array_equal(alone.clearance[others], beside.clearance[others])


class Flight:
    """A straight flight east along its plan, seen by the monitor of one aircraft."""

    def __init__(self, wind: Wind = NO_WIND) -> None:
        self.wind = wind
        points = []
        for n in range(1, 21):
            state = VehicleState(SPEED * 20.0 * n, 0.0, 0.0, SPEED)
            points.append(Waypoint(n, *over_ground(state, wind, 20.0 * n), 20.0 * n))
        self.plan = reconstruct(tuple(points), wind)
        began = single.begin(THRESHOLDS)
        self.watch: Watch = single.activate(began, self.plan, self.own(0.0), {}, 0.0)

    def own(self, time: float) -> VehicleState:
        return over_ground(VehicleState(SPEED * time, 0.0, 0.0, SPEED), self.wind, time)

    def step(self, time: float, *areas: Area, altitude: Altitude | None = None) -> Assessment:
        self.watch, verdict = single.step(
            self.watch, time, self.own(time), {}, own_altitude=altitude, areas=areas
        )
        return verdict


AHEAD = Area(Circle(9_000.0, 300.0, 1_000.0), clearance=200.0)


def test_an_area_that_appears_asks_for_a_plan_and_one_that_goes_does_not() -> None:
    flight = Flight()
    beside = Area(Circle(9_000.0, 1_300.0, 1_000.0), clearance=200.0)
    assert flight.step(0.0, beside).state is State.MONITORING
    verdict = flight.step(1.0, AHEAD)
    assert verdict.state is State.REPLAN_REQUESTED and verdict.ask is not None
    (why,) = verdict.reasons
    assert why.cause is Cause.AREA and why.field == "areas"
    # Half of the margin must be left beyond the clearance.
    reached = 9_000.0 - math.sqrt((1_200.0 + 0.5 * MARGIN) ** 2 - 300.0**2)
    assert verdict.measured.loss[0] == pytest.approx(reached / SPEED - 1.0, abs=0.5)
    # An answer that flies on as before is refused, and with it the plan is not safe.
    onward = tuple(
        Waypoint(n, SPEED * (20.0 * n + 1.0), 0.0, 0.0, SPEED, 20.0 * n) for n in range(1, 21)
    )
    _, taken = single.answer(flight.watch, verdict.ask.number, reconstruct(onward))
    assert not taken
    assert flight.step(2.0).state is State.MONITORING


def test_without_an_answer_the_backup_stays_out_and_goes_on_doing_so() -> None:
    flight = Flight()
    near = Area(Circle(2_500.0, 100.0, 1_000.0), clearance=100.0)
    states = [flight.step(float(n), near).state for n in range(6)]
    assert states[0] is State.REPLAN_REQUESTED
    assert states[-1] is State.BACKUP
    backup = flight.watch.monitor.backup
    assert backup.safe[0] and backup.depth[0] == 0.0
    away = distances(backup.plan_states, (ActiveArea(0, near, 0.0, END),))[0]
    assert away.min() >= near.clearance


def test_where_no_backup_stays_out_it_is_said() -> None:
    flight = Flight()
    verdict = flight.step(0.0, Area(Circle(0.0, 0.0, 3_000.0), name="over us"))
    causes = Cause(int(verdict.measured.causes[0]))
    assert causes & Cause.BACKUP_IN_AREA and causes & Cause.BACKUP_UNSAFE and causes & Cause.AREA
    said = {why.cause: why.message for why in verdict.reasons}
    assert "enters areas[0] (over us), since none stays out" in said[Cause.BACKUP_IN_AREA]
    assert "nearer to areas[0] (over us) than it may" in said[Cause.AREA]
    # A fence that holds the ownship and is wide enough asks for nothing.
    fence = Area(Circle(15_000.0, 0.0, 29_000.0), Keep.IN)
    assert not Cause(int(Flight().step(0.0, fence).measured.causes[0]))


def test_areas_count_while_they_are_level_and_valid() -> None:
    high = AHEAD.__class__(AHEAD.shape, floor=Level(3_000.0, "msl"), clearance=200.0)
    level_flight = Altitude(1_000.0, "msl", 0.0)
    assert Flight().step(0.0, high, altitude=level_flight).state is State.MONITORING
    assert Flight().step(0.0, high).state is State.REPLAN_REQUESTED
    over = Area(AHEAD.shape, clearance=200.0, valid_until=60.0)
    assert Flight().step(0.0, over).state is State.MONITORING


def test_a_moving_area_is_met_where_it_will_be() -> None:
    crossing = Area(Circle(9_000.0, -6_000.0, 500.0), velocity=(0.0, 50.0))
    assert Flight().step(0.0, crossing).state is State.REPLAN_REQUESTED
    behind = Area(Circle(9_000.0, -6_000.0, 500.0), velocity=(0.0, 20.0))
    assert Flight().step(0.0, behind).state is State.MONITORING


@pytest.mark.parametrize("wind", [Wind(15.0, -8.0), Wind(-20.0, 5.0)])
def test_a_wind_changes_nothing_that_the_air_mass_sees(wind: Wind) -> None:
    ring = ((8e3, -500.0), (1e4, -400.0), (9.5e3, 1_500.0))
    for velocity in ((0.0, 0.0), (-10.0, 4.0)):
        still, blown = Flight(), Flight(wind)
        for time in (0.0, 1.0, 2.0):
            x, y = (speed * time for speed in velocity)
            here = tuple((a + x, b + y) for a, b in ring)
            area = Area(Polygon(here), velocity=velocity, clearance=120.0)
            there = tuple((a + wind.east * time, b + wind.north * time) for a, b in here)
            carried = Area(
                Polygon(there),
                velocity=(velocity[0] + float(wind.east), velocity[1] + float(wind.north)),
                clearance=120.0,
            )
            calm, windy = still.step(time, area), blown.step(time, carried)
            assert calm.state is windy.state is State.REPLAN_REQUESTED
            for name in ("loss", "area_deficit"):
                mine, same = getattr(calm.measured, name), getattr(windy.measured, name)
                np.testing.assert_allclose(mine, same, atol=1e-5)


def test_to_leave_a_clearance_is_no_reason_for_a_plan() -> None:
    flight = Flight()
    behind = Area(Circle(-600.0, 0.0, 500.0), clearance=1_000.0)
    for time in np.arange(0.0, 30.0, 1.3):
        assert flight.step(float(time), behind).state is State.MONITORING
    towards = Area(Circle(2_500.0 + 1_000.0, 0.0, 500.0), clearance=1_500.0)
    assert flight.step(30.5, towards).state is not State.MONITORING


def test_the_own_distance_from_the_plan_must_be_left_beyond_a_clearance() -> None:
    beside = Area(Circle(9_000.0, 1_500.0 + 0.5 * MARGIN + 2.0, 1_000.0), clearance=500.0)
    for left, there in ((0.0, False), (-18.0, False), (-24.0, True)):
        flight = Flight()
        own = flight.own(0.0)._replace(y=left)
        _, verdict = single.step(flight.watch, 0.0, own, {}, areas=(beside,))
        assert bool(Cause(int(verdict.measured.causes[0])) & Cause.AREA) is there
