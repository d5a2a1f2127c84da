"""What sensors report of recorded flights: the noise, age and coverage of their reports."""

from collections.abc import Callable

import numpy as np

from envs.encounters import Encounter
from envs.frames import F
from envs.kinematics import VehicleState
from envs.perception import perceive_flights, report
from envs.trees import map_leaves
from eval.flights.trajectories import Trajectories


def report_flights(
    starts: Encounter,
    flown: Trajectories[F],
    noise: Callable[[int], np.ndarray] | None,
    dt: float,
) -> Trajectories[F]:
    """Return flights of encounters ``[N]`` with their intruders as reported, not a number where
    there is no report; noise as of :func:`~envs.perception.perceive_flights`, None: exact.
    """
    others = flown.intruders
    reported = others if noise is None else perceive_flights(others, starts.sensor, noise, dt)
    covered = starts.mask
    if starts.coverage is not None:
        own: VehicleState[F] = VehicleState(*(field[..., None] for field in flown.own))
        time = np.arange(len(flown.own.x))[:, None, None] * dt
        with np.errstate(invalid="ignore"):
            covered = covered & report(own, others, starts.coverage, time, np)
    altitudes = flown.altitudes
    if altitudes is not None and starts.altitudes is not None:
        too_high = starts.altitudes.too_high
        read = altitudes.intruders if too_high is None else altitudes.intruders + too_high
        altitudes = altitudes._replace(intruders=read)
    return flown._replace(
        altitudes=altitudes,
        intruders=map_leaves(lambda field: np.where(covered, field, np.nan), reported),
    )
