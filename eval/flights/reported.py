"""What sensors report of recorded flights: the noise, age and coverage of their reports."""

from collections.abc import Callable

import numpy as np

from envs.encounters import Encounter
from envs.frames import F
from envs.kinematics import VehicleState
from envs.perception import Sensor, carry_back, perceive, report
from envs.trees import map_leaves, take
from eval.flights.trajectories import Trajectories


def report_states(
    states: VehicleState[F],
    sensor: Sensor,
    noise: Callable[[int], np.ndarray],
    dt: float,
) -> VehicleState[F]:
    """Return the reports of intruders ``[T, N, K]``, time steps of dt, s, apart; the sensors' noise
    is by step, ``[4, N, K]``.
    """
    first = take(states, 0)
    before = carry_back(first, dt, np), carry_back(first, 2.0 * dt, np)
    reports = []
    for number in range(len(states.x)):
        current = take(states, number)
        reports.append(perceive(current, *before, sensor, noise(number), dt, np))
        before = current, before[0]
    return map_leaves(lambda *fields: np.stack(fields), *reports)


def report_flights(
    starts: Encounter,
    flown: Trajectories[F],
    noise: Callable[[int], np.ndarray] | None,
    dt: float,
) -> Trajectories[F]:
    """Return flights of encounters ``[N]`` with their intruders as reported, not a number where
    there is no report; noise as of :func:`report_states`, None: exact. Altitudes stay as they are.
    """
    others = flown.intruders
    reported = others if noise is None else report_states(others, starts.sensor, noise, dt)
    covered = starts.mask
    if starts.coverage is not None:
        own: VehicleState[F] = VehicleState(*(field[..., None] for field in flown.own))
        time = np.arange(len(flown.own.x))[:, None, None] * dt
        with np.errstate(invalid="ignore"):
            covered = covered & report(own, others, starts.coverage, time, np)
    return flown._replace(
        intruders=map_leaves(lambda field: np.where(covered, field, np.nan), reported)
    )
