"""Closed-loop flights of many encounters at once, in plain numpy: the surrogate's step order without jax.

Motion is float64; what the decider sees is float32, as in training. Encounters that end are dropped from the
arrays, so that the work shrinks with the number still in the air. Every operation acts on each row alone: a
flight comes out bit for bit the same whatever others are flown with it.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from agents.baselines.baselines import Baseline, Sight
from envs import intruder
from envs.draws import normals
from envs.encounters import Encounter
from envs.intruder import GAINS, Intent, IntruderState
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.observation import CRITICAL_RADIUS, most_critical, observe
from envs.outcome import Rules, judge, reward
from envs.perception import Sensor, carried_back, perceive
from envs.relative import distance, leg_separation
from envs.trees import take
from eval.flights.trajectories import Film, Trajectories

__all__ = ["OUTCOMES", "REVERSAL_RATE", "Decider", "Flights", "OnStates", "direct", "fly", "sensor_noise", "turned_to"]

Decider: TypeAlias = Callable[[np.ndarray], np.ndarray]
"""Observations ``[M, 8]`` (float32, the contract's) to actions ``[M, 2]`` in [-1, 1]."""


class OnStates(NamedTuple):
    """A decider that sees the states of all aircraft instead of an observation."""

    baseline: Baseline


OUTCOMES = ("violation", "reached", "timeout")
"""Names of the outcome codes 0, 1, 2."""

REVERSAL_RATE = math.radians(0.5)
"""Yaw-rate commands smaller than this, rad/s, count as straight flight when heading reversals are counted."""


class Flights(NamedTuple):
    """How encounters ended; fields ``[N]``."""

    outcome: np.ndarray
    """Code, an index into :data:`OUTCOMES`, int8."""
    score: np.ndarray
    """Sum of the sparse reward."""
    duration: np.ndarray
    """s until the end."""
    min_separation: np.ndarray
    """Smallest distance to any intruder, m, between the steps too."""
    time_of_min_separation: np.ndarray
    """End of the step in which that happened, s after the start."""
    path_length: np.ndarray
    """Length flown, m (mean speed of each step; at most 0.1 m off where a speed limit is met inside a step)."""
    goal_distance: np.ndarray
    """At the end, m."""
    reversals: np.ndarray
    """How often the commanded turn changed side, int32; commands below :data:`REVERSAL_RATE` do not count."""


class _Air(NamedTuple):
    """Encounters in progress; fields ``[M]``, those of intruders ``[M, K]``."""

    number: np.ndarray
    own: VehicleState
    goal_x: np.ndarray
    goal_y: np.ndarray
    intruders: IntruderState
    mask: np.ndarray
    intent: Intent
    sensor: Sensor
    previous: tuple[VehicleState, VehicleState]
    min_separation: np.ndarray
    time_of_min_separation: np.ndarray
    path_length: np.ndarray
    side: np.ndarray
    reversals: np.ndarray
    memory: np.ndarray


def direct(limits: Limits) -> Decider:
    """Return the decider that resolves nothing: at constant speed along the route to the goal.

    The intruder's waypoint controller steers it, because a displaced start does not point at its goal exactly.
    """

    def decide(observation: np.ndarray) -> np.ndarray:
        steering = GAINS.proportional * math.pi * observation[:, 6] / limits.yaw_rate_max
        return np.stack([np.zeros_like(steering), np.clip(steering, -1.0, 1.0)], axis=-1)

    return decide


def turned_to(yaw_rate: np.ndarray, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the side of the last turn after a command, and whether it changed; ``[...]``.

    Args:
        yaw_rate: as commanded, rad/s; straight below :data:`REVERSAL_RATE`.
        side: of the last turn before: -1, 0 (none yet) or 1.
    """
    now = np.where(np.abs(yaw_rate) >= REVERSAL_RATE, np.sign(yaw_rate), side)
    return now, now * side < 0.0


def sensor_noise(seed: int, first: int, count: int, intruders: int) -> Callable[[int], np.ndarray]:
    """Return the sensors' noise by number of the step: standard normal draws ``[4, count, intruders]``."""

    def of(step: int) -> np.ndarray:
        # As envs.starts.report_noise: stream 0 makes the starts.
        return np.moveaxis(normals(seed, first, count, (4, intruders), stream=step + 1), 1, 0)

    return of


def fly(
    encounters: Encounter,
    decider: Decider | OnStates,
    rules: Rules,
    limits: Limits,
    *,
    noise: Callable[[int], np.ndarray] | None = None,
    record: bool = False,
) -> tuple[Flights, Trajectories | None]:
    """Fly encounters to their end; the decider acts once per time step.

    Args:
        encounters: the starts, ``[N]``, float64.
        decider: sees the most critical intruder of each encounter and the goal, or, on states, all intruders.
        rules: of the task.
        limits: of the ownship.
        noise: the sensors' noise by step, ``[4, N, K]``; None for perfect knowledge of the intruders.
        record: keep the trajectories too (about 150 bytes an encounter and second).

    Returns:
        The flights, and the trajectories if they were recorded.
    """
    count = len(encounters.goal_x)
    kinds = {"outcome": np.int8, "reversals": np.int32}
    result = Flights(**{name: np.zeros(count, kinds.get(name, np.float64)) for name in Flights._fields})
    air = _takeoff(encounters)
    film = Film(encounters) if record else None
    dt, step = rules.dt, 0
    while len(air.number):
        seen = air.intruders.vehicle
        if noise is not None:
            seen = perceive(seen, *air.previous, air.sensor, noise(step)[:, air.number], dt, np)
        chosen = most_critical(air.own, seen, air.mask, CRITICAL_RADIUS, np)
        observation = observe(air.own, chosen, air.goal_x, air.goal_y, np).astype(np.float32)
        memory = air.memory
        if isinstance(decider, OnStates):
            sight = Sight(air.own, seen, air.mask, air.goal_x, air.goal_y, rules.t_max - step * dt)
            action, memory = decider.baseline.decide(sight, memory)
        else:
            action = decider(observation).astype(np.float64)
        acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), limits, np)

        traffic = intruder.step(air.intruders, air.intent, step * dt, dt, np)
        own = advance(air.own, acceleration, yaw_rate, dt, limits, np)
        step += 1
        separation = _separation(air, own, traffic.vehicle, dt)
        goal_distance = distance(air.goal_x - own.x, air.goal_y - own.y, np)
        outcome = judge(separation, goal_distance, step * dt, rules, np)

        side, reversed_ = turned_to(yaw_rate, air.side)
        previous = air.previous if noise is None else (air.intruders.vehicle, air.previous[0])
        closer = separation < air.min_separation
        air = air._replace(
            path_length=air.path_length + (0.5 * dt) * (air.own.speed + own.speed),
            own=own,
            intruders=traffic,
            previous=previous,
            min_separation=np.minimum(separation, air.min_separation),
            time_of_min_separation=np.where(closer, step * dt, air.time_of_min_separation),
            reversals=air.reversals + reversed_,
            side=side,
            memory=memory,
        )
        if film is not None:
            film.expose(air.number, own, traffic.vehicle, (observation, action, separation))
        ended = outcome.ended(np)
        if ended.any():
            _land(result, take(air, ended), outcome, ended, reward(outcome, rules, np), goal_distance, step * dt)
            air = take(air, ~ended)
    return result, None if film is None else film.developed()


def _takeoff(encounters: Encounter) -> _Air:
    own, seen = encounters.own, encounters.intruders
    count = len(encounters.goal_x)
    by_step = np.zeros(count)
    # The rules' time step is 1 s wherever reports are late; see perception.perceive.
    previous = (carried_back(seen, 1.0, np), carried_back(seen, 2.0, np))
    apart = distance(seen.x - own.x[:, None], seen.y - own.y[:, None], np)
    return _Air(
        np.arange(count),
        own,
        encounters.goal_x,
        encounters.goal_y,
        intruder.start(seen, np),
        encounters.mask,
        encounters.intent,
        encounters.sensor,
        previous,
        np.min(np.where(encounters.mask, apart, np.inf), axis=-1),
        by_step,
        by_step,
        by_step,
        np.zeros(count, np.int32),
        np.zeros(count, np.int8),
    )


def _separation(air: _Air, own: VehicleState, traffic: VehicleState, dt: float) -> np.ndarray:
    """Return the smallest distance to any intruder during a step, m, ``[M]``."""
    before = VehicleState(*(field[:, None] for field in air.own))
    after = VehicleState(*(field[:, None] for field in own))
    separations = leg_separation(before, after, air.intruders.vehicle, traffic, dt, np)
    return np.min(np.where(air.mask, separations, np.inf), axis=-1)


def _land(
    result: Flights, landed: _Air, outcome: Any, ended: np.ndarray, score: np.ndarray, goal: np.ndarray, time: float
) -> None:
    """Write the encounters that have just ended into the result."""
    number = landed.number
    result.outcome[number] = np.argmax(np.stack(outcome)[:, ended], axis=0)
    result.score[number] = score[ended]
    result.duration[number] = time
    result.min_separation[number] = landed.min_separation
    result.time_of_min_separation[number] = landed.time_of_min_separation
    result.path_length[number] = landed.path_length
    result.goal_distance[number] = goal[ended]
    result.reversals[number] = landed.reversals
