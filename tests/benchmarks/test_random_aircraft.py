"""Plans of random aircraft keep within the limits that are given."""

import os

import numpy as np
import pytest

from agents.planner.planner import plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.request import Options
from agents.policy.inference import Policy
from benchmarks.safety.adversary import random_aircraft
from envs.aircraft import Aircraft
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from envs.waypoints import ARCS, legs

RANDOM_PLANS = int(os.environ.get("FUZZ_PLANS", "144"))  # of random aircraft, twelve of each


@pytest.mark.slow
@pytest.mark.parametrize("plans", [RANDOM_PLANS, pytest.param(10_080, marks=pytest.mark.long)])
def test_no_safe_plan_exceeds_the_limits_that_are_given(plans: int) -> None:
    rng, policy = np.random.default_rng(51), Policy.load()
    count = max(1, plans // 12)
    safe = sum(_safe_within_limits(random_aircraft(rng), policy, number) for number in range(count))
    assert safe > 8 * count


def _safe_within_limits(aircraft: Aircraft, policy: Policy, number: int) -> int:
    """Plan twelve encounters of an aircraft; return how many plans are SAFE, within its limits."""
    flown_by = policy.for_aircraft(aircraft, outside="allow")
    request = request_of(encounters_of_seed(scenario("circle", aircraft), number, 0, 12), aircraft)
    options = Options.for_aircraft(aircraft, exhaustive=False)
    plans = plan_many(request, flown_by, options).candidates
    curves = legs(take(plans.plan_states, plans.safe))
    after = curves.speed + curves.acceleration * (curves.duration[..., None] / ARCS)
    limits, swing = aircraft.limits, 1e-5
    assert np.all(curves.speed >= limits.speed_min - swing)
    assert np.all(after >= limits.speed_min - swing)
    assert np.all(after <= limits.speed_max + swing)
    assert np.all(curves.acceleration >= limits.acceleration_min - swing)
    assert np.all(curves.acceleration <= limits.acceleration_max + swing)
    assert np.all(np.abs(curves.yaw_rate) <= limits.yaw_rate_max + 1e-6)
    return int(plans.safe.sum())
