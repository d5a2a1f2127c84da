"""The simulated world: the truth that it keeps, how plans are flown in it, what its receivers and
its log say.
"""

import importlib.util
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.planner.planner import plan
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.areas import Area, Circle
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.relative import straight_cpa
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.waypoints import RoutePoint, Waypoint, at, legs, plan_states
from envs.wind import Wind, over_ground
from ros_bridge.sim.flight_log import FlightLog, keep_promises, table
from ros_bridge.sim.guidance import Flying
from ros_bridge.sim.plan_flight import PlanFlight, Promise, plans_table
from ros_bridge.sim.receivers import Quality, Receiver
from ros_bridge.sim.world import VEHICLES, EncounterFlight, SimulationError, vehicle
from tests.ros_bridge.scenes import OPTIONS

NEEDS_JSBSIM = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed"
)


def encounter_at(name: str = "crossing_left", number: int = 0):
    return encounters_of_seed(scenario(name, PAPER), 0, number, 1)


def test_straight_flights_come_as_close_as_their_cpa():
    encounter = encounter_at()
    flight = EncounterFlight(encounter, PAPER, C208_PUBLISHED)
    expected = straight_cpa(flight.own, encounter.intruders, np)
    while not flight.over():
        flight.step()
    assert flight.truth.separation == pytest.approx(float(expected.distance[0, 0]), abs=0.1)
    assert flight.truth.when == pytest.approx(float(expected.time[0, 0]), abs=0.2)
    assert flight.reached is not None and flight.time < 300.0


def test_an_ownship_that_nobody_commands_any_more_holds_course_and_speed():
    flight = EncounterFlight(encounter_at(), PAPER, C208_PUBLISHED)
    own = flight.own
    waypoint = Waypoint(0, own.x, own.y + 15_000.0, 0.5 * math.pi, own.speed, 200.0)
    flight.fly(legs(plan_states(flight.own, [waypoint])), 0.0, plan=False)
    for _ in range(100):
        flight.step()
    before, began = flight.own, flight.time
    assert abs(before.heading - encounter_at().own.heading[0]) > 0.05  # it was turning
    flight.hold()
    for _ in range(200):
        flight.step()
    reach = before.speed * (flight.time - began)
    place = before.x + reach * math.cos(before.heading), before.y + reach * math.sin(before.heading)
    assert (flight.own.x, flight.own.y) == pytest.approx(place, abs=1.0)
    assert flight.own[2:] == pytest.approx(before[2:], abs=1e-3)


@pytest.mark.slow
def test_a_wind_carries_all_and_changes_nothing_between_them():
    wind = Wind(12.0, -8.0)
    calm = EncounterFlight(encounter_at(), PAPER, C208_PUBLISHED)
    windy = EncounterFlight(encounter_at(), PAPER, C208_PUBLISHED, wind=wind)
    away = math.hypot(calm.goal[0] - calm.own.x, calm.goal[1] - calm.own.y)
    seconds = away / calm.own.speed
    moved = [new - old for old, new in zip(calm.goal, windy.goal, strict=True)]
    assert moved == pytest.approx([12.0 * seconds, -8.0 * seconds])
    while not (calm.over() and windy.over()):
        calm.step()
        windy.step()
    assert windy.reached == pytest.approx(calm.reached, abs=2.0)
    assert windy.truth.separation == calm.truth.separation


@pytest.mark.slow
def test_what_flies_through_an_area_in_a_wind_is_seen_to():
    wind = Wind(12.0, -8.0)
    start = EncounterFlight(encounter_at(), PAPER, C208_PUBLISHED).own
    far = 40.0 * start.speed
    x, y = start.x + far * math.cos(start.heading), start.y + far * math.sin(start.heading)
    carried = Area(Circle(x, y, 300.0), velocity=(wind.east, wind.north))
    standing = Area(Circle(x + 40.0 * wind.east, y + 40.0 * wind.north, 300.0))
    for area in (carried, standing):
        flight = EncounterFlight(encounter_at(), PAPER, C208_PUBLISHED, wind=wind, areas=[area])
        while not flight.over():
            flight.step()
        assert flight.truth.clear == pytest.approx(-300.0, abs=10.0)
    assert not make_log(clear=-0.1).keeps_promise
    text = table([make_log(clear=-0.1)])
    assert "SAFE plans in an area: x 0" in text
    assert "below 1000 m: none" in text


def test_a_plan_of_a_wind_is_flown_over_the_ground_that_it_names():
    wind, began = Wind(12.0, -8.0), 20.0
    start = VehicleState(1_000.0, 500.0, 0.3, 75.0)
    points = [Waypoint(n, *start_at(start, 10.0 * n), 10.0 * n) for n in (1, 2)]
    line = Flying(legs(plan_states(start, points, wind=wind)), 0, wind)
    in_air = at(line.legs_after(began), np.float64(7.0))
    on_ground = over_ground(VehicleState(*map(float, in_air)), wind, began + 7.0)
    assert tuple(on_ground) == pytest.approx(tuple(start_at(start, 7.0)), abs=1e-3)


def start_at(start: VehicleState, time: float) -> VehicleState:
    """Return a straight flight over the ground after some seconds."""
    reach = start.speed * time
    x, y = reach * math.cos(start.heading), reach * math.sin(start.heading)
    return start._replace(x=start.x + x, y=start.y + y)


@pytest.mark.parametrize(
    ("kind", "bound"),
    [
        ("kinematic", 0.1),
        pytest.param("point_mass", 20.0, marks=[NEEDS_JSBSIM, pytest.mark.slow]),
        pytest.param("c208", 20.0, marks=[NEEDS_JSBSIM, pytest.mark.slow]),
    ],
)
def test_flown_plan_keeps_its_separation(kind: str, bound: float):
    encounter = encounter_at("head_on")
    flight = EncounterFlight(encounter, PAPER, C208_PUBLISHED, kind)
    own = flight.own
    east, north = (flight.goal[0] - own.x) / 10.0, (flight.goal[1] - own.y) / 10.0
    route = [RoutePoint(n, own.x + east * n, own.y + north * n) for n in range(10, 90, 10)]
    answer = plan(own, list(flight.traffic.values()), route, Policy.load(), OPTIONS)
    assert answer.safe
    flight.fly(legs(plan_states(own, answer.waypoints)), 0.0, plan=True)
    while not flight.over() and flight.time < 300.0:
        flight.step()
    assert flight.truth.error < bound
    assert flight.truth.separation == pytest.approx(answer.min_separation, abs=2.0 * bound)


def test_only_intruders_that_exist_fly():
    encounter = encounters_of_seed(scenario("multi", PAPER), 0, 0, 1)
    flight = EncounterFlight(encounter, PAPER, C208_PUBLISHED)
    assert len(flight.traffic) == int(encounter.mask.sum()) < encounter.mask.size
    flight.step()
    moved = {name: state.x for name, state in flight.traffic.items()}
    assert list(moved) == list(flight.names)


def test_unknown_vehicle_is_refused():
    with pytest.raises(
        SimulationError, match=r"vehicle is 'glider', expected one of kinematic, point_mass, c208"
    ):
        vehicle("glider", VehicleState(0.0, 0.0, 0.0, 70.0), C208_PUBLISHED)


@NEEDS_JSBSIM
def test_a_vehicle_that_cannot_fly_so_is_refused():
    with pytest.raises(SimulationError, match="c208"):
        vehicle("c208", VehicleState(0.0, 0.0, 0.0, 300.0), C208_PUBLISHED)
    with pytest.raises(SimulationError, match="expected no aircraft of 31 to 120 m/s"):
        vehicle(
            "point_mass",
            VehicleState(0.0, 0.0, 0.0, 70.0),
            C208_PUBLISHED._replace(speed_max=120.0),
        )


def test_jsbsim_is_loaded_for_vehicles_that_need_it():
    code = (
        "import sys; from envs.kinematics import C208_PUBLISHED, VehicleState; "
        "from ros_bridge.sim.world import vehicle; "
        "vehicle('kinematic', VehicleState(0.0, 0.0, 0.0, 70.0), C208_PUBLISHED); "
        "print('jsbsim' in sys.modules, 'rclpy' in sys.modules)"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert process.stdout.split() == ["False", "False"]
    assert VEHICLES[0] == "kinematic"


# Receivers: what arrives is what was true, at its rate, no sooner than its latency, and with the
# noise asked for.

STEP = 0.1


def heard(quality: Quality, seconds: float, seed: int = 0, names: tuple[str, ...] = ("a",)):
    """Return (time of arrival, report) of aircraft that fly east at 70 m/s."""
    receiver, result = Receiver(quality, seed), []
    for number in range(round(seconds / STEP)):
        time = round(number * STEP, 6)
        truth = {name: VehicleState(70.0 * time, 0.0, 0.0, 70.0) for name in names}
        result += [(time, report) for report in receiver.receive(time, truth)]
    return result


@given(
    rate=st.sampled_from([0.5, 1.0, 2.0, 5.0, 10.0]),
    latency=st.floats(0.0, 3.0),
    seed=st.integers(0, 1000),
)
def test_reports_come_once_in_order_at_rate_and_latency(rate, latency, seed):
    reports = heard(Quality(rate, latency), 20.0, seed)
    times = [report.time for _, report in reports]
    assert times == sorted(set(times))
    # The period is met on average, each report within the step of the world.
    assert len(times) == pytest.approx((20.0 - latency) * rate, abs=2.0)
    for arrival, report in reports:
        assert latency - 1e-6 <= arrival - report.time < latency + STEP
        assert report.state == VehicleState(70.0 * report.time, 0.0, 0.0, 70.0)


def test_aircraft_report_at_the_start_and_then_at_moments_of_their_own():
    names = tuple(f"n{number}" for number in range(20))
    reports = heard(Quality(rate=1.0), 3.0, names=names)
    assert {report.identifier for time, report in reports if time == 0.0} == set(names)
    assert len({time for time, _ in reports if time > 0.0}) > 8


def test_losses_and_noise_are_as_configured():
    quality = Quality(10.0, dropout=0.3, position_std=20.0, velocity_std=2.0)
    reports = heard(quality, 400.0)
    assert len(reports) == pytest.approx(2800, abs=5.0 * math.sqrt(4000 * 0.3 * 0.7))
    x = np.array([report.state.x - 70.0 * report.time for _, report in reports])
    north = np.array([report.state.speed * math.sin(report.state.heading) for _, report in reports])
    east = np.array(
        [report.state.speed * math.cos(report.state.heading) - 70.0 for _, report in reports]
    )
    for values, spread in ((x, 20.0), (north, 2.0), (east, 2.0)):
        assert float(values.std()) == pytest.approx(spread, rel=0.08)
        assert abs(float(values.mean())) < 5.0 * spread / math.sqrt(len(values))


def test_losses_can_be_total_and_a_seed_repeats_itself():
    assert heard(Quality(dropout=1.0), 5.0) == []
    noisy = Quality(1.0, 0.2, 0.2, 30.0, 3.0)
    assert heard(noisy, 20.0, seed=3) == heard(noisy, 20.0, seed=3) != heard(noisy, 20.0, seed=4)


# What is said of flights: a plan called SAFE that did not keep the separation is never passed over.


def make_log(**more) -> FlightLog:
    return FlightLog(
        **(
            {
                "name": "x 0",
                "required": 1_000.0,
                "first": "SAFE",
                "safe_at": 1.2,
                "separation": 1_100.0,
                "duration": 90.0,
            }
            | more
        )
    )


def test_safe_plans_must_keep_the_separation():
    assert keep_promises([make_log(), make_log(separation=1_000.0)])
    assert not keep_promises([make_log(), make_log(separation=999.9)])
    # Where nothing SAFE was flown nothing was kept.
    assert not keep_promises([])
    assert not keep_promises([make_log(safe_at=None)])
    assert keep_promises([make_log(), make_log(safe_at=None)])
    assert not keep_promises([make_log(separation=math.nan)])
    assert not keep_promises([make_log(failure="the attitude is lost")])
    # What was not called SAFE promises nothing.
    lost = make_log(first="UNRESOLVED", safe_at=None, separation=300.0)
    assert keep_promises([make_log(), lost])


def test_the_table_names_what_went_wrong():
    text = table(
        [make_log(), make_log(name="y 3", separation=900.04, latency=[0.01, 0.02], wall=9.0)]
    )
    assert (
        "2 of 2 encounters had a plan called SAFE; the closest of them: 900.0 m (y 3); below 1000 "
        "m: y 3" in text
    )
    assert "900.0 !" in text and "1100.0 " in text
    assert "20.0 times real time" in text
    assert (
        "answers, end to end, ms: median 15.0, 90 % 19.0, 99 % 19.9, max 20.0 (2 requests)" in text
    )
    # Refusing is no success where the encounter could have been resolved.
    judged = [
        make_log(maybe_resolvable=True),
        make_log(maybe_resolvable=True, safe_at=None),
        make_log(maybe_resolvable=False, safe_at=None),
        make_log(),
    ]
    assert (
        "of those not proven unresolvable at the separation planned with: 1 of 2 (50.0 %)"
        in table(judged)
    )
    none = table([make_log(safe_at=None, failure="runner and monitor have not answered")])
    assert (
        "none of 1 encounters had a plan called SAFE" in none and "x 0: runner and monitor" in none
    )


# What is said of each plan: whether the flight was as SAFE assumes, and whether the promise held.


def take_up(late: float) -> PlanFlight:
    """Fly a plan that is taken up so many seconds after it was made, and return its record."""
    flight = EncounterFlight(encounter_at(), PAPER, C208_PUBLISHED)
    own = flight.own
    east, north = (flight.goal[0] - own.x) / 10.0, (flight.goal[1] - own.y) / 10.0
    route = [RoutePoint(n, own.x + east * n, own.y + north * n) for n in range(10, 90, 10)]
    answer = plan(own, list(flight.traffic.values()), route, Policy.load(), OPTIONS)
    assert answer.safe
    while flight.time < late - 1e-6:
        flight.step()
    flight.fly(legs(plan_states(own, answer.waypoints)), 0.0, plan=True)
    while flight.time < late + 60.0:
        flight.step()
    (record,) = flight.plans
    return record


@pytest.mark.slow
def test_a_plan_taken_up_late_is_left_by_more_than_the_flight_was_off_then():
    prompt, late = take_up(0.0), take_up(4.0)
    assert prompt.error < 0.1 and prompt.promise(1_000.0, 25.0) is Promise.KEPT
    assert late.late == pytest.approx(4.0)
    # The flight was turned away from the plan, so that it goes on leaving it for a while.
    assert 10.0 < late.off < 0.75 * late.error
    assert late.promise(1_000.0, 25.0) is Promise.MARGIN
    says = late.explanation(1_000.0, 25.0)
    assert f"up to {late.error:.1f} m from the plan, margin 25 m" in says
    assert "because it was taken up 4.0 s after its start" in says
    assert "the separation of 1000 m was kept" in says


def test_a_promise_is_broken_only_where_all_that_it_assumes_was_kept():
    flown = PlanFlight(10.0, 10.1, 0.1, 0.0, error=3.0, error_at=40.0, separation=999.0)
    assert flown.promise(1_000.0, 25.0) is Promise.BROKEN
    assert "the promise of SAFE is broken" in flown.explanation(1_000.0, 25.0)
    turned = replace(flown, strayed=180.0)
    assert turned.promise(1_000.0, 25.0) is Promise.NOT_PROMISED
    assert "an intruder left its straight course by 180 m" in turned.explanation(1_000.0, 25.0)
    off = replace(flown, error=30.0)
    assert off.promise(1_000.0, 25.0) is Promise.NOT_PROMISED
    assert "because the vehicle did not follow it more closely" in off.explanation(1_000.0, 25.0)
    kept_all = replace(flown, separation=1_000.0)
    assert kept_all.promise(1_000.0, 25.0) is Promise.KEPT and not kept_all.explanation(
        1_000.0, 25.0
    )
    # A distance that is no number is never called kept.
    assert replace(flown, separation=math.nan).promise(1_000.0, 25.0) is Promise.BROKEN


@pytest.mark.slow
def test_an_intruder_that_turns_is_seen_to_leave_its_course():
    flight = EncounterFlight(encounter_at("maneuvering"), PAPER, C208_PUBLISHED)
    straight = EncounterFlight(encounter_at("head_on"), PAPER, C208_PUBLISHED)
    for simulated in (flight, straight):
        ahead = VehicleState(
            simulated.own.x, simulated.own.y, simulated.own.heading, simulated.own.speed
        )
        reach = 300.0 * ahead.speed
        x, y = ahead.x + reach * math.cos(ahead.heading), ahead.y + reach * math.sin(ahead.heading)
        line = legs(plan_states(ahead, [Waypoint(0, x, y, ahead.heading, ahead.speed, 300.0)]))
        simulated.fly(line, 0.0, plan=True)
        while simulated.time < 120.0:
            simulated.step()
    assert flight.plans[0].strayed > 100.0
    assert straight.plans[0].strayed < 1.0


def test_the_table_has_a_line_a_plan_and_a_sentence_for_each_that_was_off():
    good = PlanFlight(10.0, 10.1, 0.1, 0.0, error=3.0, error_at=40.0, separation=1_100.0)
    text = plans_table([("a 0", [good, replace(good, error=26.0)])], 1_000.0, 25.0)
    head, first, second, says = text.splitlines()
    assert head.startswith("encounter") and first.endswith("kept")
    assert second.endswith("margin exceeded") and says.startswith("a 0, plan 2: ")
    assert plans_table([("a 0", [])], 1_000.0, 25.0) == "no plan called SAFE was flown"
