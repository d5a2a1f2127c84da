"""Resolvers see areas as intruders that stand, and fly round most of them."""

import numpy as np
import pytest

from agents.baselines.baselines import Observation
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.areas import Area, Circle
from envs.encounters import Encounter
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.trees import map_leaves
from eval.config import MonteCarloConfig
from eval.flights import chunks
from eval.flights.areas_seen import add_to_observation, what_stands_in_each
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns, pick
from eval.flights.recorded import fly_recorded
from eval.flights.simulate import ByPolicy, fly
from eval.metrics.summary import summarise

COUNT = 6
SOURCE = scenario("circle", PAPER)


@pytest.fixture(scope="module")
def flying() -> ReadyEvaluation:
    evaluation = Evaluation(None, SOURCE, None, 3, PAPER, "policy", areas=2)
    return ReadyEvaluation(evaluation, Policy.load())


def areas_of(*area_tuples: tuple[Area, ...]) -> np.ndarray:
    areas = np.empty(len(area_tuples), dtype=object)
    areas[:] = area_tuples
    return areas


def still(count: int) -> Encounter:
    return pick(Evaluation(None, SOURCE, None, 3, PAPER), range(count))


def mirrored(observation: Observation) -> Observation:
    """Return an observation at the line y = 0."""

    def turn(state: VehicleState) -> VehicleState:
        return state._replace(y=-state.y, heading=-state.heading)

    return observation._replace(
        own=turn(observation.own), intruders=turn(observation.intruders), goal_y=-observation.goal_y
    )


def assert_flown_again(flying: ReadyEvaluation, table: dict[str, np.ndarray]) -> None:
    """Check that encounters that are flown again by their numbers go as in a table."""
    again = fly_recorded(flying, table["encounter"].tolist()).flights
    assert again.path_length.tolist() == table["path_length_m"].tolist()


@pytest.mark.slow
def test_the_policy_flies_round_areas_that_it_would_enter_unseen(
    flying: ReadyEvaluation, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = columns(flying, 0, COUNT)
    assert np.count_nonzero(table["outcome"] == "reached") >= COUNT - 1
    assert table["areas"].sum() >= COUNT
    summary = summarise(table, 0.95, 100, 0)
    assert summary["breach_rate"]["count"] == np.count_nonzero(table["outcome"] == "breach")
    assert summary["areas_mean"] == table["areas"].mean() and "safe_plans_in_areas" not in summary
    assert_flown_again(flying, table)
    monkeypatch.setattr(chunks, "what_stands_in_each", lambda *_: None)
    unseen = columns(flying, 0, COUNT)
    assert_flown_again(flying, unseen)
    assert np.count_nonzero(unseen["outcome"] == "breach") > COUNT // 2


def test_a_flight_among_areas_does_not_depend_on_those_of_others() -> None:
    resolver, starts = ByPolicy(Policy.load()), still(2)
    disc = Area(Circle(float(starts.goal_x[0]) * 0.5, float(starts.goal_y[0]) * 0.5, 900.0))
    far = [Area(Circle(90_000.0, 90_000.0 + n, 900.0)) for n in range(4)]
    near_flights, all_flights = (
        fly(
            starts,
            resolver,
            PAPER,
            standing=what_stands_in_each(areas_of((disc,), other_areas), PAPER),
        )
        for other_areas in ((), tuple(far))
    )
    assert near_flights.path_length[0] == all_flights.path_length[0]
    assert near_flights.min_separation[0] == all_flights.min_separation[0]


def test_a_disc_gives_the_actions_of_an_intruder_that_stands_there_with_its_separation() -> None:
    policy, starts = Policy.load(), still(3)
    own, traffic, nan = starts.own, starts.intruders, np.nan
    alone = Observation(own, traffic, starts.mask, starts.goal_x, starts.goal_y, 300.0)
    places = [(float(x) + 5_000.0, float(y)) for x, y in zip(own.x, own.y, strict=True)]
    areas = areas_of(*((Area(Circle(*place, 1_300.0), clearance=200.0),) for place in places))
    with_areas = add_to_observation(alone, what_stands_in_each(areas, PAPER), 10.0, PAPER)
    column = np.array(places)
    zero = np.zeros((3, 1))
    stands = VehicleState(column[:, :1], column[:, 1:], zero, zero)
    intruders = map_leaves(lambda *two: np.concatenate(two, axis=1), traffic, stands)
    share = np.concatenate([np.ones(starts.mask.shape), zero + PAPER.separation / 1_500.0], axis=1)
    mask = np.concatenate([starts.mask, zero == 0.0], axis=1)
    commanded = policy.command(own, intruders, mask, alone.goal_x, alone.goal_y, share)
    resolver = ByPolicy(policy)
    assert (resolver.decide(with_areas, np.full(3, nan))[0] == commanded).all()
    assert (resolver.decide(alone, np.full(3, nan))[0] != commanded).any()


def test_the_policy_among_areas_is_as_symmetric_as_without() -> None:
    resolver, starts = ByPolicy(Policy.load()), still(4)
    observation = Observation(
        starts.own, starts.intruders, starts.mask, starts.goal_x, starts.goal_y, 300.0
    )
    x, y = 0.5 * (starts.own.x + starts.goal_x), 0.5 * (starts.own.y + starts.goal_y)
    places = list(zip(x.tolist(), y.tolist(), strict=True))
    areas = [(Area(Circle(*place, 1_500.0), velocity=(2.0, 3.0)),) for place in places]
    turned = [(Area(Circle(x, -y, 1_500.0), velocity=(2.0, -3.0)),) for x, y in places]
    with_areas = add_to_observation(
        observation, what_stands_in_each(areas_of(*areas), PAPER), 5.0, PAPER
    )
    turned_obstacles = what_stands_in_each(areas_of(*turned), PAPER)
    seen_turned = add_to_observation(mirrored(observation), turned_obstacles, 5.0, PAPER)
    nothing = np.zeros(4)
    action, back = (resolver.decide(observed, nothing)[0] for observed in (with_areas, seen_turned))
    np.testing.assert_allclose(back, action * [1.0, -1.0], atol=1e-4)


def test_areas_are_taken_in_mode_policy() -> None:
    assert MonteCarloConfig(mode="policy", areas=2).areas == 2
