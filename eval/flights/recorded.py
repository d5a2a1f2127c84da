"""Encounters of an evaluation flown again by their numbers, with their trajectories.

An encounter follows from seed and number alone and a flight from its encounter, so that the same flights come out.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from agents.planner.planner import Plans
from envs.encounters import Encounter
from envs.starts import joined
from eval.flights.assured_mode import fly_assured
from eval.flights.chunks import Pilot, encounters, noise_of
from eval.flights.plan_mode import fly_once, plan_at_start
from eval.flights.simulate import Flights, fly
from eval.flights.trajectories import Trajectories, TrajectoryRecorder


class Recorded(NamedTuple):
    """Flights of M encounters."""

    starts: Encounter
    """``[M]``."""
    plans: Plans | None
    """Made at the start, ``[M]``; None in mode policy."""
    flights: Flights
    trajectories: Trajectories


def fly_recorded(pilot: Pilot, numbers: Sequence[int]) -> Recorded:
    """Fly the encounters of some numbers, at least one, in the evaluation's mode."""
    evaluation = pilot.evaluation
    singles = [encounters(evaluation, number, 1) for number in numbers]
    starts = reduce(joined, singles)
    noises = [noise_of(evaluation, one, number) for one, number in zip(singles, numbers, strict=True)]
    noise = _together([each for each in noises if each is not None])  # all of them or none
    recorder = TrajectoryRecorder(starts)
    plans, flights = fly_in_mode(pilot, starts, noise, recorder)
    return Recorded(starts, plans, flights, recorder.stack())


def fly_in_mode(
    pilot: Pilot,
    starts: Encounter,
    noise: Callable[[int], np.ndarray] | None,
    recorder: TrajectoryRecorder | None,
    *,
    endless: bool = False,
) -> tuple[Plans | None, Flights]:
    """Plan where the evaluation's mode does, and fly encounters ``[M]``; a recorder takes the trajectories.

    The noise of the sensors is by step, ``[4, M, K]``, None for perfect knowledge; endless flights lose nothing.
    """
    evaluation, policy = pilot.evaluation, pilot.policy
    aircraft, setting = evaluation.aircraft, evaluation.setting
    if evaluation.mode == "policy":
        return None, fly(starts, pilot.decider, aircraft, noise=noise, recorder=recorder, endless=endless)
    plans = plan_at_start(starts, policy, aircraft, setting, None if noise is None else noise(0))
    if evaluation.mode == "plan":
        return plans, fly_once(starts, plans, aircraft, setting, recorder, endless=endless).flights
    how: Any = {"noise": noise, "recorder": recorder, "endless": endless}
    return plans, fly_assured(starts, plans, policy, aircraft, setting, **how).flown.flights


def _together(noises: Sequence[Callable[[int], np.ndarray]]) -> Callable[[int], np.ndarray] | None:
    """Return the noise of several encounters as one, ``[4, M, K]`` by step; None of none."""
    return (lambda step: np.concatenate([noise(step) for noise in noises], axis=1)) if noises else None
