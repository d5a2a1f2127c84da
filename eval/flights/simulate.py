"""Closed-loop flights of many encounters at once, in plain numpy.

Encounters that end are dropped from the arrays, so that the work shrinks with the number still in
the air. Every operation acts on each row alone: a flight comes out bit for bit the same whatever
others are flown with it.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agents.baselines.baselines import Observation, StepResolver
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.altitudes import as_reported, climb_at
from envs.draws import normals
from envs.encounters import Encounter
from envs.frames import Air
from envs.intruder import GAINS
from envs.kinematics import Limits, commands
from envs.outcome import Outcome
from envs.relative import bearing, distance
from envs.tracking.tracker import Sightings
from envs.trees import scatter, take
from envs.world import (
    State,
    StepResult,
    World,
    above_own,
    begin,
    distance_scales,
    flatness_of,
    known_intruders,
    perceive_intruders,
    smallest,
)
from envs.world import step as advance
from eval.flights.areas_seen import add_to_observation
from eval.flights.believed import carry_on, steer_alone
from eval.flights.static_obstacles import Standing
from eval.flights.trajectories import TrajectoryRecorder

OUTCOMES = Outcome._fields  # names of the outcome codes 0, 1, 2

ENDS = (*OUTCOMES, "breach")
"""Names of the outcome codes among areas."""


class ByPolicy(NamedTuple):
    """A policy as a resolver."""

    policy: Policy

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used."""
        action = self.policy.command(
            observation.own,
            observation.intruders,
            observation.mask,
            observation.goal_x,
            observation.goal_y,
            observation.distance_scale,
        )
        return steer_alone(action, observation, self.policy.aircraft), memory


class Unmitigated(NamedTuple):
    """An encounter without any resolver: at constant speed along the route to the goal.

    The intruder's waypoint controller steers it, because a displaced start does not point at its
    goal exactly.
    """

    aircraft: Aircraft

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used."""
        off = bearing(observation.own, observation.goal_x, observation.goal_y, np) * (1.0 / math.pi)
        observed = off.astype(np.float32)  # as an observation has it: of its precision
        full = self.aircraft.limits.yaw_rate_max * self.aircraft.dt
        steering = GAINS.proportional * math.pi * observed / full
        action = np.stack([np.zeros_like(steering), np.clip(steering, -1.0, 1.0)], axis=-1)
        return action.astype(float), memory


class Flights(NamedTuple):
    """How encounters ended; fields ``[N]``."""

    outcome: np.ndarray  # code, an index into OUTCOMES, int8
    score: np.ndarray  # sum of the sparse reward
    duration: np.ndarray  # s until the end
    # smallest distance to any intruder, m, between the steps too; in space the cylindrical one
    min_separation: np.ndarray
    time_of_min_separation: np.ndarray  # end of the step in which that happened, s after the start
    path_length: np.ndarray
    """Length flown, m (mean speed of each step; at most 0.1 m off where a speed limit is met inside
    a step).
    """
    goal_distance: np.ndarray  # at the end, m
    # how often the commanded turn changed side, int32; commands below reversal_rate do not count
    reversals: np.ndarray


class _Air(NamedTuple):
    """Encounters in progress; fields ``[M]``."""

    state: State
    number: np.ndarray  # row of each among the encounters flown
    min_separation: np.ndarray
    time_of_min_separation: np.ndarray
    path_length: np.ndarray
    side: np.ndarray  # of the last turn, int8: see last_turn
    reversals: np.ndarray
    memory: np.ndarray  # of a baseline
    sightings: Sightings[Air] | None = None  # of the intruders, where not all are reported


def path_excess(flights: Flights, route: np.ndarray, aircraft: Aircraft) -> np.ndarray:
    """Return (length flown + distance left to the goal) / straight distance, m, - 1, at least 0,
    ``[N]``.

    It is nan where the encounter begins within the goal's radius: there is no route to compare
    with, and one such row would make the mean.
    """
    away = np.where(route > aircraft.goal_radius, route, np.nan)
    return np.maximum((flights.path_length + flights.goal_distance) / away - 1.0, 0.0)


def reversal_rate(limits: Limits) -> float:
    """Return the yaw rate, rad/s, below which a command counts as straight flight: a sixth of the
    greatest.
    """
    return limits.yaw_rate_max / 6.0


def last_turn(
    yaw_rate: np.ndarray, side: np.ndarray, straight: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the side of the last turn after a command, and whether it changed; ``[...]``.

    The yaw rate is as commanded, rad/s; the side before is -1, 0 (none yet) or 1; straight:
    :func:`reversal_rate`.
    """
    current = np.where(np.abs(yaw_rate) >= straight, np.sign(yaw_rate), side)
    return current, current * side < 0.0


def sensor_noise(seed: int, first: int, count: int, intruders: int) -> Callable[[int], np.ndarray]:
    """Return the sensors' noise by number of the step: standard normal draws ``[4, count,
    intruders]``.
    """

    def draws(step: int) -> np.ndarray:
        # As envs.starts.report_noise: stream 0 makes the starts.
        return np.moveaxis(normals(seed, first, count, (4, intruders), stream=step + 1), 1, 0)

    return draws


def fly(
    encounters: Encounter,
    resolver: StepResolver,
    aircraft: Aircraft,
    *,
    noise: Callable[[int], np.ndarray] | None = None,
    recorder: TrajectoryRecorder | None = None,
    endless: bool = False,
    standing: Standing | None = None,
) -> Flights:
    """Fly encounters ``[N]``, float64, to their end; the resolver acts once per time step.

    The sensors' noise is by step, ``[4, N, K]``, None for perfect knowledge of the intruders; those
    that are not reported at times are carried on (:mod:`eval.flights.believed`). A recorder takes
    the trajectories (about 150 bytes an encounter and step); endless flights go on after a loss of
    separation. What stands in the ways, ``[N, S]``, is seen beside the intruders; flights are not
    judged against it.
    """
    rules = aircraft.rules()
    rules = rules._replace(separation=0.0) if endless else rules
    dt, world = rules.dt, World(rules, aircraft)
    result = _blank(len(encounters.goal_x))
    air = _takeoff(encounters, aircraft, history_dt=None if noise is None else dt)
    step = 0
    while len(air.number):
        draws = None if noise is None else noise(step)[:, air.number]
        observation, sightings = _look(air, draws, step * dt, aircraft)
        if standing is not None:
            observation = add_to_observation(
                observation, take(standing, air.number), step * dt, aircraft
            )
        action, memory = resolver.decide(observation, air.memory)
        controls = action[:, 0], action[:, 1]
        after, flown = advance(air.state, controls, world, np)
        step += 1
        yaw_rate = commands(controls, aircraft.limits, np)[1]
        air = _tally(air, after, flown, yaw_rate, step * dt, aircraft)
        air = air._replace(memory=memory, sightings=sightings)
        if recorder is not None:
            recorder.append(
                air.number, after.own, after.intruders.vehicle, flown.separation, action
            )
        if after.ended.any():
            ends = _ends(air, flown, step * dt)
            scatter(result, air.number[after.ended], take(ends, after.ended))
            air = take(air, ~after.ended)
    return result


def _blank(count: int) -> Flights:
    """Return so many flights to be filled in."""
    kinds = {"outcome": np.int8, "reversals": np.int32}
    fields = {name: np.zeros(count, kinds.get(name, np.float64)) for name in Flights._fields}
    return Flights(**fields)


def _look(
    air: _Air, draws: np.ndarray | None, time: float, aircraft: Aircraft
) -> tuple[Observation, Sightings[Air] | None]:
    """Return what resolvers see of flights ``[M]`` at a time, s, by the draws of the sensors'
    noise, ``[4, M, K]``, and what the tracker knows.
    """
    state, time_left = air.state, aircraft.t_max - time
    intruders = perceive_intruders(state, draws, aircraft.dt, np)
    exists = known_intruders(state, aircraft, np)
    scale = distance_scales(state, aircraft, np)
    observation = Observation(
        state.own, intruders, exists, state.goal_x, state.goal_y, time_left, scale
    )
    observation = observation._replace(number=air.number)
    if state.altitudes is not None:
        altitudes = as_reported(state.altitudes)
        observation = observation._replace(
            above=above_own(state._replace(altitudes=altitudes), 0.0),
            climb=climb_at(altitudes.intruders, state.steps[:, None], aircraft.dt),
        )
    if state.coverage is None:
        return observation, None
    sensor = None if draws is None else state.sensor
    return carry_on(observation, state.mask, air.sightings, sensor, time, aircraft)


def _tally(
    air: _Air,
    after: State,
    flown: StepResult,
    yaw_rate: np.ndarray,
    time: float,
    aircraft: Aircraft,
) -> _Air:
    """Return the flights after a step that ended at a time, s, with a commanded yaw rate, rad/s,
    ``[M]``.
    """
    side, changed = last_turn(yaw_rate, air.side, reversal_rate(aircraft.limits))
    closer = flown.separation < air.min_separation
    speeds = air.state.own.speed + after.own.speed
    return air._replace(
        state=after,
        path_length=air.path_length + (0.5 * aircraft.dt) * speeds,
        min_separation=np.minimum(flown.separation, air.min_separation),
        time_of_min_separation=np.where(closer, time, air.time_of_min_separation),
        reversals=air.reversals + changed,
        side=side,
    )


def _ends(air: _Air, flown: StepResult, time: float) -> Flights:
    """Return encounters ``[M]`` as they would stand in the result if they ended now, at a time,
    s.
    """
    return Flights(
        outcome=np.argmax(np.stack(flown.outcome), axis=0),
        score=flown.reward,
        duration=np.full(len(air.number), time),
        min_separation=air.min_separation,
        time_of_min_separation=air.time_of_min_separation,
        path_length=air.path_length,
        goal_distance=flown.goal_distance,
        reversals=air.reversals,
    )


def _takeoff(encounters: Encounter, aircraft: Aircraft, *, history_dt: float | None) -> _Air:
    state, count = begin(encounters, np, history_dt=history_dt), len(encounters.goal_x)
    own, vehicles, distance_scale = (
        encounters.own,
        encounters.intruders,
        distance_scales(state, aircraft, np),
    )
    apart = distance(vehicles.x - own.x[:, None], vehicles.y - own.y[:, None], np)
    flatness = flatness_of(state, aircraft)
    if flatness is not None:
        apart = np.maximum(apart, flatness * np.abs(above_own(state, 0.0)))
    apart = apart if distance_scale is None else apart * distance_scale
    return _Air(
        state=state,
        number=np.arange(count),
        min_separation=smallest(apart, encounters.mask, np),
        time_of_min_separation=np.zeros(count),
        path_length=np.zeros(count),
        side=np.zeros(count, np.int8),
        reversals=np.zeros(count, np.int32),
        memory=np.zeros(count, np.int8),
    )
