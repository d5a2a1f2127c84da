"""Flights, what is reported of them, and what the tracker makes of that."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from envs.kinematics import SURROGATE, VehicleState, advance, velocity
from envs.tracking.tracker import Belief, Reports, Tracks, begin, belief, extend, restart
from envs.trees import map_leaves

States = list[VehicleState]

AGILE = SURROGATE._replace(yaw_rate_max=1.0)


def fly(rates: Sequence[float], rows: int = 1, dt: float = 1.0, seed: int = 1) -> States:
    """Return flights ``[rows]`` from random states, with turn rates, rad/s, for ``dt`` s each."""
    rng = np.random.default_rng(seed)
    start = VehicleState(
        rng.uniform(-1e4, 1e4, rows),
        rng.uniform(-1e4, 1e4, rows),
        rng.uniform(-math.pi, math.pi, rows),
        rng.uniform(50.0, 100.0, rows),
    )
    states = [start]
    for rate in rates:
        states.append(
            advance(states[-1], np.zeros(rows), np.full(rows, rate), np.float64(dt), AGILE, np)
        )
    return states


def reported(
    state: VehicleState, rng: np.random.Generator, position_std: float, velocity_std: float
) -> VehicleState:
    """Return states with random errors, one sigma per axis, m and m/s."""
    rows = np.shape(state.x)
    vx, vy = velocity(state, np)
    vx, vy = (part + velocity_std * rng.normal(size=rows) for part in (vx, vy))
    x, y = (part + position_std * rng.normal(size=rows) for part in (state.x, state.y))
    return state_of(x, y, vx, vy)


def state_of(x: np.ndarray, y: np.ndarray, vx: np.ndarray, vy: np.ndarray) -> VehicleState:
    return VehicleState(x, y, np.arctan2(vy, vx), np.hypot(vx, vy))


def take_in(tracks: Tracks, reports: Reports, dt: float) -> Tracks:
    """Return tracks with one more report; what does not follow from its past begins anew."""
    extended, jumps = extend(tracks, reports, np.float64(dt))
    return map_leaves(
        lambda anew, continued: np.where(jumps, anew, continued), restart(extended), extended
    )


def track(
    states: States,
    errors: tuple[float, float],
    declared: tuple[float, float],
    *,
    known: bool = True,
    dt: float = 1.0,
    change: Callable[[VehicleState], VehicleState] = lambda state: state,
    seed: int = 7,
) -> list[Belief]:
    """Return what is believed after each report of flights.

    Args:
        states: of the flights, ``dt`` s apart.
        errors: one sigma per axis of the reports, m and m/s.
        declared: what they say of it.
        known: whether they say so.
        dt: between two reports, s.
        change: what is done to a report besides.
        seed: of the errors.
    """
    rng, tracks, beliefs = np.random.default_rng(seed), None, []
    for state in states:
        reports = Reports(change(reported(state, rng, *errors)), *map(np.float64, declared), known)
        tracks = begin(reports) if tracks is None else take_in(tracks, reports, dt)
        beliefs.append(belief(tracks))
    return beliefs


class Errors(NamedTuple):
    """Lengths of errors of what is believed, and those of three sigmas; ``[...]``."""

    position: np.ndarray  # m
    velocity: np.ndarray  # m/s
    position_covered: np.ndarray  # bool: within 3.03 sigmas, which 99 % of true ones are
    velocity_covered: np.ndarray


def errors_of(believed: Belief, true: VehicleState) -> Errors:
    """Return the errors of what is believed of flights ``[...]``."""
    (vx, vy), (wx, wy) = velocity(believed.state, np), velocity(true, np)
    position = np.hypot(believed.state.x - true.x, believed.state.y - true.y)
    speed = np.hypot(vx - wx, vy - wy)
    most = math.sqrt(-2.0 * math.log(0.01))
    return Errors(
        position,
        speed,
        position <= most * believed.position_std + 1e-6,
        speed <= most * believed.velocity_std + 1e-6,
    )
