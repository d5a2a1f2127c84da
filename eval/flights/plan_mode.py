"""The plan flown once, as in the paper: planned at the start, followed to its end."""

from typing import Any

import numpy as np

from agents.planner.options import Options
from agents.planner.planner import Plans, plan_many
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.kinematics import VehicleState
from envs.perception import carried_back, perceive
from envs.trees import take
from eval.flights.plan_flight import Flown, Tally, fly_plans, request_of, verdicts
from eval.flights.trajectories import TrajectoryRecorder

SOURCES = ("none", "policy", "fallback")
"""Names of a plan's sources by their codes."""

STATUSES = ("unresolved", "safe")
"""Names of a plan's statuses by whether it is safe."""


def perceived_at_start(encounters: Encounter, dt: float, noise: Any = None) -> VehicleState:
    """Return the intruders as the ownship knows them at the start, ``[N, K]``.

    The noise of the sensors is ``[4, N, K]``, None for perfect knowledge; ``dt`` is the time step, s.
    """
    seen = encounters.intruders
    if noise is None:
        return seen
    earlier = carried_back(seen, dt, np), carried_back(seen, 2.0 * dt, np)
    return perceive(seen, *earlier, encounters.sensor, noise, dt, np)


def plan_at_start(
    encounters: Encounter, policy: Policy, aircraft: Aircraft, options: Options, noise: Any = None
) -> Plans:
    """Plan at the start of encounters ``[N]``; noise as of :func:`perceived_at_start`."""
    seen = perceived_at_start(encounters, aircraft.dt, noise)
    return plan_many(request_of(encounters, aircraft, seen), policy, options)


def fly_once(
    encounters: Encounter,
    plans: Plans,
    aircraft: Aircraft,
    options: Options,
    recorder: TrajectoryRecorder | None = None,
    *,
    endless: bool = False,
) -> Flown:
    """Fly the plans of encounters ``[N]`` once; a recorder takes their trajectories.

    An unresolved plan is flown as an advisory trajectory, but is no success even if it arrives. Without a trajectory
    there is no flight, and the separation is not a number.
    """
    count = len(encounters.goal_x)
    rows = np.flatnonzero(plans.proposals.last >= 0)
    begun, knots = take((encounters, plans.proposals.knots), rows)
    flown = fly_plans(begun, knots, aircraft, options.limits, recorder, rows, endless=endless)
    whole = Tally(count, aircraft).flown()
    whole.flights.min_separation[:] = np.nan
    whole.whole_separation[:] = np.nan
    for old, new in zip((*whole.flights, *whole[1:]), (*flown.flights, *flown[1:]), strict=True):
        old[rows] = new
    return verdicts(whole, ~plans.proposals.safe, aircraft.rules())
