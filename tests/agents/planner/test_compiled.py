"""What is compiled of the planner decides and flies as its interpreted counterpart does."""

from functools import partial
from importlib import resources

import numpy as np
import pytest

from agents.planner import Intruder, Options, Plan, plan
from agents.policy import decision
from agents.policy.file import parse
from agents.policy.inference import Policy
from agents.policy.set_features import TABLE
from agents.policy.set_network import SetNetwork
from envs import compiled
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.random_areas import random_areas
from envs.waypoints import RoutePoint
from envs.wind import Wind

pytestmark = pytest.mark.usefixtures("compiled_code")


# In float64, as it never flies.
_DECIDE = compiled.Entry(decision.decide, partial(decision.examples, np.float64))


@pytest.mark.parametrize("count", [0, 1, 2, 10])
def test_decisions_are_the_same(count: int) -> None:
    content = parse(resources.files("agents").joinpath("data/policy.safetensors").read_bytes(), "")
    network, rng = SetNetwork(content, np.float64, TABLE), np.random.default_rng(count)
    decider = network.new_decider()
    for _ in range(200):
        own: VehicleState[Air] = VehicleState(
            *rng.uniform([-1e3, -1e3, -3.1, 50.0], [1e3, 1e3, 3.1, 100.0])
        )
        states = rng.uniform([-2e4, -2e4, -3.1, 20.0], [2e4, 2e4, 3.1, 150.0], (count, 4))
        distance_scale = rng.uniform(0.3, 3.0, count)
        goal_x, goal_y = rng.uniform(-3e4, 3e4, 2)
        fields: VehicleState[Air] = VehicleState(*np.ascontiguousarray(states.T))
        intruders: list[VehicleState[Air]] = [VehicleState(*row) for row in states]
        interpreted = network.scalar_action(own, intruders, goal_x, goal_y, distance_scale.tolist())
        compiled_action = _DECIDE(own, fields, distance_scale, goal_x, goal_y, decider)
        np.testing.assert_allclose(compiled_action, interpreted, rtol=0.0, atol=1e-12)


def _ask(number: int, count: int, *, unsure: bool, windy: bool, areas: int) -> Plan:
    """Return the plan of a random request, without a deadline."""
    policy, rng = Policy.load(), np.random.default_rng([number, count])
    own: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, float(rng.uniform(55.0, 95.0)))
    route = [RoutePoint(i, 6e3 * (i + 1), float(rng.normal(0.0, 300.0))) for i in range(9)]
    intruders = []
    for _ in range(count):
        away, bearing = rng.uniform(2e3, 12e3 if count < 9 else 3e4), rng.uniform(-3.1, 3.1)
        state: VehicleState[Ground] = VehicleState(
            float(away * np.cos(bearing)),
            float(away * np.sin(bearing)),
            float(rng.uniform(-3.1, 3.1)),
            float(rng.uniform(40.0, 100.0)),
        )
        turns = rng.random() < 0.3
        intruders.append(
            Intruder(
                state,
                position_std=30.0 * unsure,
                velocity_std=float(rng.random() < 0.7) * unsure,
                turn_rate=0.03 * turns,
                turn_time=float(rng.uniform(0.0, 30.0)) * turns,
                separation=float(rng.uniform(400.0, 1500.0)) if rng.random() < 0.3 else None,
            )
        )
    options = Options.for_aircraft(policy.aircraft, deadline_s=float("inf"))
    wind = Wind(6.0, -5.0, 0.0) if windy else None
    around = random_areas(3, number, areas, own, (route[0].x, route[0].y), policy.aircraft)
    return plan(own, intruders, route, policy, options, wind=wind, areas=around)


@pytest.mark.parametrize(
    ("count", "unsure", "windy", "areas"),
    [(0, False, False, 0), (2, False, False, 0), (4, True, True, 1), (25, True, False, 0)],
)
def test_plans_are_the_same(count: int, unsure: bool, windy: bool, areas: int) -> None:
    compiled_plans = [
        _ask(number, count, unsure=unsure, windy=windy, areas=areas) for number in range(6)
    ]
    compiled.use(False)
    for number, compiled_plan in enumerate(compiled_plans):
        interpreted = _ask(number, count, unsure=unsure, windy=windy, areas=areas)
        assert (compiled_plan.status, compiled_plan.source) == (
            interpreted.status,
            interpreted.source,
        )
        for waypoint, interpreted_waypoint in zip(
            compiled_plan.waypoints, interpreted.waypoints, strict=True
        ):
            assert (waypoint.x, waypoint.y) == pytest.approx(
                (interpreted_waypoint.x, interpreted_waypoint.y), abs=1e-3
            )


def test_a_policy_with_inputs_of_its_own_is_interpreted() -> None:
    assert Policy.load().decider is not None
    assert Policy.load(dtype=np.float64).decider is None
