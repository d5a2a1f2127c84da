"""One encounter in plain floats: the surrogate's step, where arrays of one element would cost ten times as much.

The same functions of the core as in :mod:`envs.surrogate`, over plain floats: every operation is the one that numpy
does in double precision, so a flight equals numpy's to the last bit and the surrogate's in double precision to
1e-6 m. (In single precision the surrogate's own rounding at 10 km is 1 mm in every step.)
"""

from typing import Any, NamedTuple

import numpy as np

from envs import intruder, outcome
from envs.backend import FloatNamespace
from envs.encounters import Encounter
from envs.intruder import Intent, IntruderState
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.observation import CRITICAL_RADIUS, criticality
from envs.observation import observe as observe_one
from envs.outcome import Outcome, Rules
from envs.perception import Sensor, carried_back, perceive
from envs.relative import distance, leg_separation

__all__ = ["Flight", "Result", "begin", "observe", "separations", "step"]

# Not the shared one: for that :mod:`envs.angles` takes math's functions, off by up to 4e-8 rad, 1 mm in 300 s.
_XP: Any = FloatNamespace()


class Flight(NamedTuple):
    """An encounter in progress; absent intruders are left out."""

    own: VehicleState
    goal_x: float
    goal_y: float
    intruders: tuple[IntruderState, ...]
    """K of them."""
    intents: tuple[Intent, ...]
    sensor: Sensor
    previous: tuple[tuple[VehicleState, ...], tuple[VehicleState, ...]]
    """The intruders one and two steps ago."""
    steps: int
    """Steps flown."""


class Result(NamedTuple):
    """What a step yields."""

    outcome: Outcome
    reward: float
    separations: tuple[float, ...]
    """Smallest distance to each intruder during the step, m, ``[K]``."""
    goal_distance: float
    """At the end of the step, m."""


def begin(encounter: Encounter) -> Flight:
    """Return the start of one encounter (own fields are scalars, intruder fields ``[K]``)."""
    present = np.flatnonzero(encounter.mask)
    vehicles = tuple(VehicleState(*(float(field[k]) for field in encounter.intruders)) for k in present)
    # Reports are late only where the time step is 1 s; see perception.perceive.
    previous = (
        tuple(carried_back(vehicle, 1.0, _XP) for vehicle in vehicles),
        tuple(carried_back(vehicle, 2.0, _XP) for vehicle in vehicles),
    )
    return Flight(
        VehicleState(*(float(field) for field in encounter.own)),
        float(encounter.goal_x),
        float(encounter.goal_y),
        tuple(intruder.start(vehicle, _XP) for vehicle in vehicles),
        tuple(Intent(*(float(field[k]) for field in encounter.intent)) for k in present),
        Sensor(*(float(field[0]) for field in encounter.sensor)),
        previous,
        0,
    )


def observe(flight: Flight, noise: np.ndarray | None = None) -> np.ndarray:
    """Return the observation of the most critical intruder, float32 ``[8]``.

    Args:
        flight: the encounter.
        noise: standard normal draws ``[4, K]`` of the reports; None for perfect knowledge.
    """
    seen = [state.vehicle for state in flight.intruders]
    if noise is not None:
        columns = zip(seen, *flight.previous, noise.T.tolist(), strict=True)
        seen = [perceive(a, b, c, flight.sensor, draws, 1.0, _XP) for a, b, c, draws in columns]
    chosen = seen[0]
    if len(seen) > 1:
        chosen = min(seen, key=lambda vehicle: criticality(flight.own, vehicle, CRITICAL_RADIUS, _XP))
    return np.array(observe_one(flight.own, chosen, flight.goal_x, flight.goal_y, _XP), dtype=np.float32)


def separations(flight: Flight) -> tuple[float, ...]:
    """Return the present distance to each intruder, m, ``[K]``."""
    own = flight.own
    vehicles = (state.vehicle for state in flight.intruders)
    return tuple(distance(vehicle.x - own.x, vehicle.y - own.y, _XP) for vehicle in vehicles)


def step(flight: Flight, action: tuple[float, float], rules: Rules, limits: Limits) -> tuple[Flight, Result]:
    """Advance the encounter by one time step.

    Args:
        flight: the encounter.
        action: acceleration and yaw rate as fractions of the limits, clipped to [-1, 1].
        rules: of the task.
        limits: of the ownship.
    """
    dt = rules.dt
    time = flight.steps * dt
    traffic = tuple(
        intruder.step(state, intent, time, dt, _XP)
        for state, intent in zip(flight.intruders, flight.intents, strict=True)
    )
    acceleration, yaw_rate = commands(action, limits, _XP)
    own = advance(flight.own, acceleration, yaw_rate, dt, limits, _XP)
    before = tuple(state.vehicle for state in flight.intruders)
    apart = tuple(
        leg_separation(flight.own, own, old, new.vehicle, dt, _XP) for old, new in zip(before, traffic, strict=True)
    )
    goal_distance = distance(flight.goal_x - own.x, flight.goal_y - own.y, _XP)
    judged = outcome.judge(min(apart), goal_distance, (flight.steps + 1) * dt, rules, _XP)
    moved = flight._replace(own=own, intruders=traffic, previous=(before, flight.previous[0]), steps=flight.steps + 1)
    return moved, Result(judged, outcome.reward(judged, rules, _XP), apart, goal_distance)
