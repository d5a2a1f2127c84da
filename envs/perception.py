"""What the ownship knows of an intruder: a report that is late and noisy, dead-reckoned to now.

Reports carry their time of validity (as ADS-B's do), so a resolver extrapolates them straight ahead
over their age. What remains is the noise, grown by the velocity error times the age, and the
intruder's manoeuvres since.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.angles import atan2, wrap
from envs.arrays import Array, ArrayModule
from envs.frames import F
from envs.kinematics import VehicleState, velocity
from envs.relative import distance
from envs.trees import map_leaves, take


class Sensor(NamedTuple):
    """Quality of the intruder's reports, SI units; floats or ``[..., 1]``."""

    position_std: Array = 0.0  # one sigma per axis, m
    velocity_std: Array = 0.0  # one sigma per axis, m/s
    latency: Array = 0.0  # age of a report when it is used, s, at most two time steps


def declared_errors(sensor: Sensor | None) -> tuple[Array, Array]:
    """Return one sigma per axis of reported positions and velocities, m and m/s; None: exact."""
    return (0.0, 0.0) if sensor is None else (sensor.position_std, sensor.velocity_std)


class Coverage(NamedTuple):
    """Of which intruders there are reports at all; fields ``[..., K]``."""

    reach: Array  # farthest intruder that is reported, m
    half_angle: Array  # greatest bearing to either side, rad; pi: all round
    onset: Array  # of the time without reports, s after the start
    silence: Array  # how long it lasts, s


EVERYTHING = Coverage(math.inf, math.pi, 0.0, 0.0)
"""Reports of all intruders at any time."""


def report(
    own: VehicleState[F],
    intruders: VehicleState[F],
    coverage: Coverage,
    time: Array,
    xp: ArrayModule,
) -> Array:
    """Return of which intruders ``[..., K]`` there is a report, bool.

    Args:
        own: ``[..., 1]``.
        intruders: as they truly are.
        time: s after the start, ``[..., 1]``.
    """
    x, y = intruders.x - own.x, intruders.y - own.y
    bearing = wrap(atan2(y, x, xp) - own.heading, xp)
    within = (distance(x, y, xp) <= coverage.reach) & (xp.abs(bearing) <= coverage.half_angle)
    silent = (time >= coverage.onset) & (time < coverage.onset + coverage.silence)
    return within & xp.logical_not(silent)


def carry_back(state: VehicleState[F], seconds: float, xp: ArrayModule) -> VehicleState[F]:
    """Return where the vehicle was some seconds ago if it flew straight until now, ``[...]``."""
    vx, vy = velocity(state, xp)
    return state._replace(x=state.x - vx * seconds, y=state.y - vy * seconds)


def perceive(
    current: VehicleState[F],
    before: VehicleState[F],
    before_that: VehicleState[F],
    sensor: Sensor,
    noise: Array,
    dt: float,
    xp: ArrayModule,
) -> VehicleState[F]:
    """Return the intruder as the ownship believes it to be, ``[...]``.

    Args:
        current, before, before_that: true states at this step and one and two steps ago, ``[...]``;
            where the flight has not lasted so long, the current state carried back along its course
            (:func:`carry_back`).
        sensor: its latency must not exceed ``2 dt``.
        noise: standard normal draws, four components ``[...]`` each (x, y, vx, vy).
    """
    steps = sensor.latency * (1.0 / dt)
    recent = xp.clip(steps, 0.0, 1.0)
    older = xp.clip(steps - 1.0, 0.0, 1.0)

    def at_report(a: Array, b: Array, c: Array) -> Array:
        return a + (b - a) * recent + (c - b) * older

    velocities = [velocity(state, xp) for state in (current, before, before_that)]
    vx = at_report(*(v[0] for v in velocities)) + sensor.velocity_std * noise[2]
    vy = at_report(*(v[1] for v in velocities)) + sensor.velocity_std * noise[3]
    x = (
        at_report(current.x, before.x, before_that.x)
        + sensor.position_std * noise[0]
        + vx * sensor.latency
    )
    y = (
        at_report(current.y, before.y, before_that.y)
        + sensor.position_std * noise[1]
        + vy * sensor.latency
    )
    return VehicleState(x, y, atan2(vy, vx, xp), distance(vx, vy, xp))


def perceive_flights(
    states: VehicleState[F],
    sensor: Sensor,
    noise: Callable[[int], np.ndarray],
    dt: float,
) -> VehicleState[F]:
    """Return the intruders of flights as the ownship believes them to be, ``[T, N, K]``, time steps
    of dt, s, apart; numpy. The noise of a step is that of :func:`perceive`, ``[4, N, K]``.
    """
    first = take(states, 0)
    before = carry_back(first, dt, np), carry_back(first, 2.0 * dt, np)
    reports = []
    for number in range(len(states.x)):
        current = take(states, number)
        reports.append(perceive(current, *before, sensor, noise(number), dt, np))
        before = current, before[0]
    return map_leaves(lambda *fields: np.stack(fields), *reports)
