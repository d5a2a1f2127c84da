"""Encounters of an evaluation flown again by their numbers, with their trajectories."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.planner.planner import Plans
from envs.areas import Area
from envs.encounters import Encounter
from envs.frames import Ground
from envs.trees import take
from envs.waypoints import PlanStates, on_ground
from envs.wind import NO_WIND, Wind
from eval.flights.among_areas import judge, with_breaches
from eval.flights.assured_mode import fly_assured
from eval.flights.chunks import (
    Conditioned,
    Evaluation,
    ReadyEvaluation,
    conditions_of,
    fly_resolver,
    noise_of,
    pick,
)
from eval.flights.in_wind import to_ground
from eval.flights.plan_mode import fly_once, plan_at_start
from eval.flights.simulate import Flights
from eval.flights.trajectories import Trajectories, TrajectoryRecorder


class Track(NamedTuple):
    """One flight to its end, T steps."""

    own: np.ndarray  # east and north, m, [2, T + 1]
    intruders: np.ndarray  # the same for each intruder, [K, 2, T + 1]
    separation: np.ndarray  # smallest distance to any intruder during each step, m, [T]
    goal: tuple[float, float]  # m
    areas: tuple[Area, ...] = ()  # as they are at the start
    # what must be kept from each intruder, m, [K]; None: the rules' separation from all
    required: np.ndarray | None = None
    altitudes: "TrackAltitudes | None" = None  # None: all are at one level


class TrackAltitudes(NamedTuple):
    """Altitudes of one flight, m."""

    own: np.ndarray  # [T + 1]
    intruders: np.ndarray  # [K, T + 1]


class Recorded(NamedTuple):
    """Flights of M encounters."""

    starts: Encounter  # ``[M]``
    plans: Plans | None  # made at the start, ``[M]``; None in mode policy
    plan_states: PlanStates[Ground] | None  # of the plans, ``[M, W]``
    flights: Flights
    trajectories: Trajectories[Ground]
    areas: np.ndarray | None = None  # of each, object ``[M]``

    def track(self, row: int) -> Track:
        """Return one of the flights."""
        own, others, _, separation, altitudes = self.trajectories
        end, members = int(np.count_nonzero(np.isfinite(own.x[:, row]))), self.starts.mask[row]
        every = self.starts.separation
        return Track(
            own=np.stack([own.x[:end, row], own.y[:end, row]]),
            intruders=np.stack(
                [others.x[:end, row, members].T, others.y[:end, row, members].T], axis=1
            ),
            separation=separation[: end - 1, row],
            goal=(float(self.starts.goal_x[row]), float(self.starts.goal_y[row])),
            areas=() if self.areas is None else self.areas[row],
            required=None if every is None else every[row, members],
            altitudes=None
            if altitudes is None
            else TrackAltitudes(
                altitudes.own[:end, row], altitudes.intruders[:end, row, members].T
            ),
        )


def fly_recorded(ready: ReadyEvaluation, numbers: Sequence[int]) -> Recorded:
    """Fly the encounters of some numbers, at least one, in the evaluation's mode."""
    evaluation, aircraft = ready.evaluation, ready.evaluation.aircraft
    starts = pick(evaluation, numbers)
    noise = _noise(evaluation, starts, numbers)
    conditions = conditions_of(evaluation, starts, np.asarray(numbers), noise)
    starts, _, wind, areas = conditions
    recorder = TrajectoryRecorder(starts)
    plans, flights = fly_in_mode(ready, conditions, recorder)
    flown = recorder.stack()
    if areas is not None:
        among = judge(flown, areas, wind, aircraft.dt)
        flights = with_breaches(flights, among, aircraft.rules())
    plan_states = None
    if plans is not None:
        wind_of_each = NO_WIND if wind is None else Wind(wind.east[:, None], wind.north[:, None])
        plan_states = on_ground(plans.candidates.plan_states, wind_of_each)
    over_ground = to_ground(flown, wind, aircraft.dt)
    return Recorded(starts, plans, plan_states, flights, over_ground, areas)


def _noise(
    evaluation: Evaluation, starts: Encounter, numbers: Sequence[int]
) -> Callable[[int], np.ndarray] | None:
    """Return the sensors' noise of encounters ``[M]`` by their numbers, as it is where each is
    flown in its chunk.
    """
    noises = [
        noise_of(evaluation, take(starts, [row]), number) for row, number in enumerate(numbers)
    ]
    existing = [noise for noise in noises if noise is not None]  # all of them or none
    if not existing:
        return None
    return lambda step: np.concatenate([noise(step) for noise in existing], axis=1)


def fly_in_mode(
    ready: ReadyEvaluation,
    conditions: Conditioned,
    recorder: TrajectoryRecorder | None,
    *,
    endless: bool = False,
) -> tuple[Plans | None, Flights]:
    """Plan where the evaluation's mode does, and fly encounters ``[M]``; a recorder takes the
    trajectories.

    Endless flights lose nothing. Where the mode plans, a wind carries all of it. Flights are not
    judged against areas.
    """
    evaluation, policy = ready.evaluation, ready.policy
    if evaluation.mode == "policy":
        return None, fly_resolver(ready, conditions, recorder, endless=endless)
    aircraft, options = evaluation.aircraft, evaluation.options
    starts, noise, wind, areas = conditions
    first = None if noise is None else noise(0)
    plans = plan_at_start(starts, policy, aircraft, options, first, wind=wind, areas=areas)
    how: dict[str, Any] = {"recorder": recorder, "endless": endless, "wind": wind}
    if evaluation.mode == "plan":
        return plans, fly_once(starts, plans, aircraft, options, **how).flights
    how |= {"noise": noise, "areas": areas}
    flown = fly_assured(starts, plans, policy, aircraft, options, **how).flown
    return plans, flown.flights
