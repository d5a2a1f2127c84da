"""Traffic that is not always reported: carried on while it can be, and gone then."""

import math

import numpy as np
import pytest

from agents.baselines.baselines import Observation
from agents.inference import Policy
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.encounters import Encounter
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.scenarios import scenario
from envs.starts import OF_INTRUDERS, encounters_of_seed
from envs.tracking.tracker import belief, lasting
from eval.flights.believed import CARRIED, carry_on, steer_alone
from eval.flights.simulate import OUTCOMES, ByPolicy, Flights, fly


@pytest.fixture(scope="module")
def resolver() -> ByPolicy:
    return ByPolicy(Policy.load().for_aircraft(PAPER, outside="allow"))


def sight_of(intruder: VehicleState, present: bool) -> Observation:
    own = VehicleState(*np.array([[0.0], [0.0], [0.3], [80.0]]))
    intruders = VehicleState(*(np.array([[field]]) for field in intruder))
    return Observation(
        own, intruders, np.array([[present]]), np.array([9e3]), np.array([0.0]), 200.0
    )


@pytest.mark.parametrize("rate", [0.0, math.radians(2.0)])
def test_an_intruder_is_carried_on_along_its_course_or_turn_and_is_gone_then(rate: float) -> None:
    course, sightings, exists = 0.5, None, np.array([[True]])
    place = 0.0 + 0.0j
    hidden = VehicleState(1e5, 1e5, 0.0, 0.0)  # what is not reported must not matter
    for second in range(80):
        present = second < 10
        now = VehicleState(place.real, place.imag, course, 70.0)
        sight = sight_of(now if present else hidden, present)
        carried, sightings = carry_on(sight, exists, sightings, None, float(second), PAPER)
        if present:
            assert carried is sight
        elif second - 9.0 <= CARRIED:
            far = abs(carried.intruders.x[0, 0] + 1j * carried.intruders.y[0, 0] - place)
            # A turn is expected to end after 15 s.
            assert carried.mask.all()
            assert far < 1e-6 or (rate and second > 9 + 15)
        else:
            assert not carried.mask.any()
        middle = course + 0.5 * rate
        place += 70.0 * np.sinc(0.5 * rate / math.pi) * np.exp(1j * middle)
        course += rate


def test_a_turn_is_carried_on_as_long_as_its_course_is_known() -> None:
    exists, rate = np.array([[True]]), math.radians(3.0)
    for sensor, whole in ((Sensor(30.0, 3.0), False), (Sensor(1.0, 0.1), True)):
        sightings, random, place = None, np.random.default_rng(1), 0.0j
        for second in range(40):
            velocity = 70.0 * np.exp(1j * rate * second)
            true_place, flown = (
                true + std * complex(*random.normal(size=2))
                for true, std in (
                    (place, sensor.position_std),
                    (velocity, sensor.velocity_std),
                )
            )
            state = VehicleState(true_place.real, true_place.imag, np.angle(flown), abs(flown))
            _, sightings = carry_on(
                sight_of(state, True), exists, sightings, sensor, float(second), PAPER
            )
            place += velocity * np.exp(0.5j * rate)
        assert sightings is not None
        believed = belief(sightings.tracks)
        assert believed.turn_rate[0, 0] > 0.5 * rate
        carried, _ = carry_on(sight_of(state, False), exists, sightings, sensor, 54.0, PAPER)
        turned = wrap(carried.intruders.heading - believed.state.heading, np)[0, 0]
        lasts = float(lasting(believed.turn_rate, believed.turn_std, 15.0)[0, 0])
        assert lasts == 15.0 if whole else 0.0 < lasts < 15.0
        assert turned == pytest.approx(lasts * believed.turn_rate[0, 0], abs=1e-9)


def test_who_was_never_reported_is_nobody() -> None:
    sight = sight_of(VehicleState(1e3, 0.0, 0.0, 50.0), False)
    carried, _ = carry_on(sight, np.array([[True]]), None, None, 0.0, PAPER)
    assert not carried.mask.any()


def test_a_policy_steers_to_the_goal_where_nobody_is(resolver: ByPolicy) -> None:
    alone, with_intruder = (
        sight_of(VehicleState(3e3, 0.0, 0.0, 50.0), present) for present in (False, True)
    )
    action = np.array([[0.25, 0.125]])
    assert steer_alone(action, with_intruder, PAPER) is action
    steered = steer_alone(action, alone, PAPER)
    assert steered[0, 0] == 0.25
    assert steered[0, 1] == -1.0  # the goal is to the right
    assert resolver.decide(alone, np.zeros(1, np.int8))[0][0, 1] == -1.0


def drawn(count: int, *, dropouts: bool = True) -> Encounter:
    starts = encounters_of_seed(
        scenario("circle + partly_seen", PAPER), 5, 0, count, heeds=OF_INTRUDERS
    )
    coverage = starts.coverage
    everywhere = coverage._replace(
        reach=np.inf * coverage.reach, half_angle=0.0 * coverage.reach + math.pi
    )
    if not dropouts:
        everywhere = everywhere._replace(silence=0.0 * coverage.silence)
    return starts._replace(coverage=everywhere)


def reached(flights: Flights) -> int:
    return int(np.count_nonzero(flights.outcome == OUTCOMES.index("reached")))


def test_reports_of_all_at_all_times_change_nothing(resolver: ByPolicy) -> None:
    starts = drawn(60, dropouts=False)
    for field, reported_field in zip(
        fly(starts, resolver, PAPER),
        fly(starts._replace(coverage=None), resolver, PAPER),
        strict=True,
    ):
        np.testing.assert_array_equal(field, reported_field)


@pytest.mark.slow
def test_drop_outs_alone_lose_hardly_an_encounter(resolver: ByPolicy) -> None:
    starts = drawn(150)
    flights = fly(starts, resolver, PAPER)
    assert reached(flights) >= 148
    assert flights.reversals.mean() < 2.0
    part = fly(drawn(20), resolver, PAPER)
    for field in Flights._fields:  # a flight does not depend on its company
        np.testing.assert_array_equal(getattr(part, field), getattr(flights, field)[:20])
