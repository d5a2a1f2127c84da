"""A monitor in a wind judges a flight as one in still air judges the same flight through the air."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.assurance import single
from agents.assurance.backup import backup_states, search, surroundings
from agents.assurance.frames import Frame, carry
from agents.assurance.inputs import no_areas
from agents.assurance.monitor import Thresholds
from agents.assurance.single import Assessment, Watch
from agents.assurance.state import Monitor, State, rearrange
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Traffic
from agents.planner.answer import Plan, RequestError
from agents.planner.recheck import reconstruct
from agents.planner.request.options import Options
from agents.planner.request.reports import report_in_air
from agents.planner.request.request import Intruder, in_wind
from envs.aircraft import PAPER
from envs.areas import Area, Circle
from envs.kinematics import VehicleState
from envs.trees import map_leaves
from envs.waypoints import Legs, Waypoint, legs
from envs.wind import NO_WIND, Wind, narrow, over_ground
from tests.support import random_states

OPTIONS = Options.for_aircraft(PAPER)
THRESHOLDS = Thresholds.for_plans(OPTIONS)
SPEED, RATE = 75.0, math.radians(3.0)
WINDS = [Wind(15.0, -8.0), Wind(-20.0, 5.0)]


def own_at(time: float) -> VehicleState:
    """Return where the ownship is in the air mass: a little left of the plan from 6 s on."""
    return VehicleState(SPEED * time, 8.0 * max(time - 6.0, 0.0), 0.0, SPEED)


def other_at(time: float) -> VehicleState:
    """Return an intruder in the air mass, which begins to turn towards the ownship after 4 s."""
    turned = RATE * max(time - 4.0, 0.0)
    straight, radius = min(time, 4.0), 70.0 / RATE
    x = 4_000.0 + 70.0 * straight + radius * math.sin(turned)
    y = 3_000.0 - radius * (1.0 - math.cos(turned))
    return VehicleState(x, y, -turned, 70.0)


def plan_in(wind: Wind) -> Plan:
    """Return a straight plan through the air mass that lies over the ground at 0 s."""
    points = []
    for n in range(1, 21):
        state = VehicleState(SPEED * 20.0 * n, 0.0, 0.0, SPEED)
        points.append(Waypoint(n, *over_ground(state, wind, 20.0 * n), 20.0 * n))
    return reconstruct(tuple(points), wind)


def reports(wind: Wind, time: float) -> dict[str, Intruder]:
    """Return a report as old as a quarter of a second, with the turn of that time."""
    state = over_ground(other_at(time - 0.25), wind, time - 0.25)
    rate = -RATE if time - 0.25 > 4.0 else 0.0
    return {"a": Intruder(state, 0.25, turn_rate=rate, turn_time=THRESHOLDS.turn_time)}


def seconds_of_flight(wind: Wind) -> Iterator[tuple[Watch, Assessment]]:
    """Yield the monitor after each of 15 s of the flight in a wind, and its verdict."""
    own = over_ground(own_at(0.0), wind, 0.0)
    watch = single.activate(single.begin(THRESHOLDS), plan_in(wind), own, reports(wind, 0.0), 0.0)
    for second in range(15):
        time = float(second)
        own = over_ground(own_at(time), wind, time)
        watch, verdict = single.step(watch, time, own, reports(wind, time))
        yield watch, verdict


def watch_flight(wind: Wind) -> tuple[Watch, list[Assessment]]:
    """Return the monitor at the end of the flight in a wind, and its verdicts."""
    watches, told = zip(*seconds_of_flight(wind), strict=True)
    return watches[-1], list(told)


@pytest.fixture(scope="module")
def calm() -> list[tuple[Watch, Assessment]]:
    return [*seconds_of_flight(NO_WIND)]


@pytest.mark.parametrize("wind", WINDS)
def test_verdicts_are_those_of_still_air(wind: Wind, calm: list[tuple[Watch, Assessment]]) -> None:
    watch, told = watch_flight(wind)
    assert watch.air == Frame(wind, 0.0)
    assert {State.MONITORING, State.REPLAN_REQUESTED} <= {verdict.state for verdict in told}
    for (_, still), blown in zip(calm, told, strict=True):
        assert (still.state, still.fly) == (blown.state, blown.fly)
        for name in ("cross_track", "along_track", "intruder_position", "separation"):
            mine, other = getattr(still.measured, name), getattr(blown.measured, name)
            np.testing.assert_allclose(mine, other, atol=1e-5)


@pytest.mark.parametrize("wind", WINDS)
def test_what_is_asked_and_backed_up_is_over_the_ground(
    wind: Wind, calm: list[tuple[Watch, Assessment]]
) -> None:
    asked = 0
    for second, ((watch, still), (blown_watch, blown)) in enumerate(
        zip(calm, seconds_of_flight(wind), strict=True)
    ):
        time, backup = float(second), single.backup_states(watch)
        pairs: list[tuple[Any, Any, Any]] = [
            (backup, single.backup_states(blown_watch), time + backup.time)
        ]
        if still.ask is not None and blown.ask is not None:
            asked += 1
            pairs.append((still.ask.own, blown.ask.own, time))
            intruder, same = still.ask.intruders[0], blown.ask.intruders[0]
            assert same.turn_rate == pytest.approx(intruder.turn_rate)
            pairs.append((intruder.state, same.state, time - intruder.age))
        for mine, other, when in pairs:
            state = VehicleState(mine.x, mine.y, mine.heading, mine.speed)
            there = over_ground(state, wind, when)
            assert other.x == pytest.approx(there.x, abs=1e-5)
            assert other.y == pytest.approx(there.y, abs=1e-5)
            assert other.speed == pytest.approx(there.speed)
    assert asked > 0


def test_memory_goes_into_another_air_mass_and_back() -> None:
    watch, _ = watch_flight(WINDS[0])
    amid = no_areas(1)
    amid[0] = (ActiveArea(0, Area(Circle(4e3, 5e2, 3e2), velocity=(-5.0, 2.0)), 0.0, 1e3),)
    memory = watch.monitor.memory._replace(areas=amid)
    watch = replace(watch, monitor=watch.monitor._replace(memory=memory))
    other = Frame(Wind(-3.0, 11.0, 1.5), 7.0)
    there = carry(watch.monitor, watch.air, other)
    assert not np.allclose(there.memory.intruders.speed, watch.monitor.memory.intruders.speed)
    back = carry(there, other, watch.air)

    def same(a: Any, b: Any) -> None:
        if a.dtype != object:
            np.testing.assert_allclose(a, b, atol=1e-6)

    moved, same_area = (monitor.memory.areas[0][0].area for monitor in (there, back))
    assert moved.velocity != pytest.approx((-5.0, 2.0))
    assert same_area.velocity == pytest.approx((-5.0, 2.0))
    shape = same_area.shape
    assert isinstance(shape, Circle)
    assert (shape.x, shape.y) == pytest.approx((4e3, 5e2), abs=1e-6)
    map_leaves(same, back.memory, watch.monitor.memory)
    map_leaves(same, back.expected, watch.monitor.expected)
    # The intruder of the last request turns, so another wind makes another velocity of it.
    mine, moved_on, again = (
        monitor.request_traffic.velocity_std.item() for monitor in (watch.monitor, there, back)
    )
    assert moved_on > mine + 0.1
    assert again == pytest.approx(mine, abs=1e-9)


def test_what_is_remembered_stays_where_it_is_over_the_ground() -> None:
    watch, _ = watch_flight(WINDS[0])
    new = Frame(Wind(-3.0, 11.0), 7.0)
    there = carry(watch.monitor, watch.air, new)

    def places(monitor: Monitor, air: Frame) -> list[Any]:
        """Return states over the ground."""
        memory = monitor.memory
        return [
            air.to_ground(memory.own, memory.own_time),
            air.to_ground(memory.intruders, memory.reported),
            air.to_ground(monitor.expected.state, monitor.started[:, None]),
            air.to_ground(monitor.request_traffic.state, monitor.requested_at[:, None]),
        ]

    map_leaves(
        lambda mine, other: np.testing.assert_allclose(mine, other, atol=1e-6),
        tuple(places(watch.monitor, watch.air)),
        tuple(places(there, new)),
    )


def test_a_plan_expects_in_another_air_mass_what_it_had_expected_there_at_first() -> None:
    """Of a turn through an uncertain wind, too, whose report is old."""
    turn = Intruder(other_at(0.0), 2.0, turn_rate=0.02, turn_time=12.0, velocity_std=0.3)
    first, second = (Wind(5.0, 1.0, std) for std in (0.5, 2.0))
    own = over_ground(own_at(0.0), first, 0.0)
    had, fresh = (
        single.activate(single.begin(THRESHOLDS), plan_in(wind), own, {"a": turn}, 0.0)
        for wind in (first, second)
    )
    there = carry(had.monitor, had.air, fresh.air).expected
    assert there.velocity_std.item() > had.monitor.expected.velocity_std.item()
    assert there.velocity_std.item() == pytest.approx(
        fresh.monitor.expected.velocity_std.item(), abs=1e-9
    )


def test_intruders_keep_what_is_known_of_them_in_whatever_place() -> None:
    watch, _ = watch_flight(NO_WIND)
    before = watch.monitor
    moved = rearrange(before, [-1, 0, -1], THRESHOLDS)
    assert np.isfinite(moved.memory.reported).tolist() == [[False, True, False]]
    assert moved.expected.mask.tolist() == [[False, True, False]]
    back = rearrange(moved, [1], THRESHOLDS)
    map_leaves(np.testing.assert_array_equal, back, before)
    # Two that change places are still themselves.
    two = rearrange(rearrange(before, [0, -1], THRESHOLDS), [1, 0], THRESHOLDS)
    map_leaves(np.testing.assert_array_equal, rearrange(two, [1], THRESHOLDS), before)


def test_a_plan_in_another_wind_is_taken_up_in_its_air_mass() -> None:
    first, second = WINDS[0], Wind(14.0, -7.0)
    watch, told = watch_flight(first)
    asked = max(n for n, verdict in enumerate(told) if verdict.ask is not None)
    ask = watch.ask
    assert ask is not None
    vx = ask.own.speed * math.cos(ask.own.heading)
    vy = ask.own.speed * math.sin(ask.own.heading)
    points = []
    for n in range(1, 21):
        place = ask.own.x + 20.0 * n * vx, ask.own.y + 20.0 * n * vy
        points.append(Waypoint(n, *place, ask.own.heading, ask.own.speed, 20.0 * n))
    moved, taken = single.answer(watch, ask.number, reconstruct(tuple(points), second))
    assert taken
    assert moved.air == Frame(second, float(asked))
    seconds = 15.0 - asked
    here = ask.own._replace(x=ask.own.x + vx * seconds, y=ask.own.y + vy * seconds)
    _, verdict = single.step(moved, 15.0, here, reports(first, 15.0))
    assert verdict.measured.along_track.item() == pytest.approx(0.0, abs=1e-6)
    assert verdict.measured.cross_track.item() == pytest.approx(0.0, abs=1e-6)
    # An answer that cannot be flown leaves the active plan where it is.
    after_refusal, refused = single.answer(watch, ask.number, reconstruct((), second))
    assert not refused and after_refusal.air == watch.air


@pytest.mark.parametrize("wind", WINDS)
def test_what_is_missing_in_a_wind_stays_missing(wind: Wind) -> None:
    nothing = VehicleState(math.nan, math.nan, math.nan, math.nan)
    assert all(math.isnan(value) for value in Frame(wind, 1.0).to_air(nothing, 3.0))
    watch, _ = watch_flight(wind)
    watch, verdict = single.step(watch, 15.0, None, {}, own_age=3.0)
    assert verdict.state is not State.MONITORING


UNSURE = [Wind(15.0, -8.0, 1.5), Wind(0.0, 0.0, 3.0)]


def test_limits_are_those_of_the_planner() -> None:
    assert THRESHOLDS.in_wind(NO_WIND) is THRESHOLDS
    assert THRESHOLDS.in_wind(WINDS[0]) is THRESHOLDS
    for wind in UNSURE:
        narrowed = THRESHOLDS.in_wind(wind)
        assert narrowed.limits == in_wind(OPTIONS, wind).limits
        assert narrowed.manoeuvre.yaw_rate_max == narrowed.limits.yaw_rate_max
        assert narrowed.limits.speed_min <= narrowed.manoeuvre.speed_min
        assert narrowed.manoeuvre.speed_max <= narrowed.limits.speed_max
        assert narrowed.requirement == THRESHOLDS.requirement


def goes_beyond(curves: Legs, wind: Wind) -> bool:
    """Return whether legs go beyond what is left of the limits in an uncertain wind."""
    left = narrow(THRESHOLDS.limits, OPTIONS.requirement.sigmas * float(wind.std))
    after = curves.speed + curves.acceleration * curves.duration[..., None] / curves.x.shape[-1]
    within = (
        (np.minimum(curves.speed, after) >= left.speed_min - 1e-6)
        & (np.maximum(curves.speed, after) <= left.speed_max + 1e-6)
        & (curves.acceleration >= left.acceleration_min - 1e-5)
        & (curves.acceleration <= left.acceleration_max + 1e-5)
        & (np.abs(curves.yaw_rate) <= left.yaw_rate_max + 1e-7)
    )
    return not within.all()


@pytest.mark.parametrize("wind", UNSURE)
def test_backups_keep_the_limits_in_every_wind(wind: Wind) -> None:
    generator = np.random.default_rng(8)
    own = random_states(generator, 100)
    own = own._replace(speed=np.clip(own.speed, 60.0, 90.0))
    course, speed = own.heading + generator.uniform(-2.6, 2.6, 100), np.full(100, 100.0)
    unsure = THRESHOLDS.in_wind(wind)
    speed_left = np.full(100, unsure.manoeuvre.speed_max)
    assert goes_beyond(legs(backup_states(own, course, speed, THRESHOLDS)), wind)
    assert not goes_beyond(legs(backup_states(own, course, speed_left, unsure)), wind)
    traffic = Traffic.straight(random_states(generator, 100, 2, extent=6_000.0))
    backups = search(own, surroundings(traffic), np.zeros(100), unsure)
    assert not goes_beyond(backups.legs, wind)
    assert 0 < backups.safe.sum() < 100


@pytest.mark.parametrize("wind", UNSURE)
def test_the_uncertainty_of_the_plan_s_wind_reaches_the_monitor(wind: Wind) -> None:
    watch, told = watch_flight(wind)
    assert watch.air.wind == wind
    assert not goes_beyond(watch.monitor.backup.legs, wind)
    turning = 0
    for verdict in told:
        traffic, ask = verdict.measured.traffic, verdict.ask
        rate = float(traffic.turn_rate[0, 0])
        turn = Intruder(other_at(0.0), turn_rate=rate, turn_time=THRESHOLDS.turn_time)
        expected = report_in_air(turn, wind).velocity_std
        assert traffic.velocity_std[0, 0] == expected
        turning += expected > 0.0
        # The planner makes its own of what is asked.
        assert ask is None or ask.intruders[0].velocity_std == 0.0
    assert turning > 0


def test_a_plan_that_expects_a_turn_expects_it_as_the_planner_does() -> None:
    turn = Intruder(other_at(0.0), 0.25, turn_rate=0.02, turn_time=60.0, velocity_std=0.3)
    for wind in (NO_WIND, *WINDS, *UNSURE):
        own = over_ground(own_at(0.0), wind, 0.0)
        watch = single.activate(single.begin(THRESHOLDS), plan_in(wind), own, {"a": turn}, 0.0)
        velocity_std = watch.monitor.expected.velocity_std[0, 0]
        assert velocity_std == report_in_air(turn, wind).velocity_std


@pytest.mark.parametrize("wind", [NO_WIND, *WINDS, *UNSURE])
def test_a_report_is_seen_in_the_air_as_the_planner_sees_it(wind: Wind) -> None:
    turn = Intruder(other_at(0.0), 0.25, turn_rate=0.02, turn_time=60.0, velocity_std=0.3)
    assert Frame(wind).report(turn, 0.0) == report_in_air(turn, wind)
    missing = Intruder(VehicleState(*[math.nan] * 4), 0.25)
    assert np.isnan(Frame(wind, 2.0).report(missing, 5.0).state).all()


def test_a_wind_that_leaves_nothing_of_the_limits_is_refused() -> None:
    wind = Wind(5.0, 0.0, 20.0)
    own = over_ground(own_at(0.0), wind, 0.0)
    with pytest.raises(RequestError, match="leave nothing"):
        single.activate(single.begin(THRESHOLDS), plan_in(wind), own, {}, 0.0)
