"""One encounter in plain floats: the world's step, where arrays of one element would cost ten times as much.

Every operation is the one that numpy does in double precision, so a flight equals numpy's to the last bit and the
surrogate's in double precision to 1e-6 m. (In single precision the surrogate's own rounding at 10 km is 1 mm in every
step.)
"""

from typing import Any

import numpy as np

from envs import world
from envs.aircraft import Aircraft
from envs.backend import EXACT_FLOATS
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.observation import SetObservation
from envs.perception import Sensor
from envs.relative import distance
from envs.world import State, StepResult, World


def begin(encounter: Encounter, dt: float) -> State:
    """Return the start of one encounter without absent intruders.

    Args:
        encounter: own fields are scalars, intruder fields ``[K]``.
        dt: time step, s.
    """
    present = np.flatnonzero(encounter.mask)

    def each(kind: type, fields: Any) -> Any:
        return tuple(kind(*(float(field[k]) for field in fields)) for k in present)

    plain = Encounter(
        own=VehicleState(*(float(field) for field in encounter.own)),
        goal_x=float(encounter.goal_x),
        goal_y=float(encounter.goal_y),
        intruders=each(VehicleState, encounter.intruders),
        mask=(True,) * len(present),
        intent=each(Intent, encounter.intent),
        sensor=Sensor(*(float(field[0]) for field in encounter.sensor)),
    )
    return world.begin(plain, EXACT_FLOATS, history_dt=dt)


def observe(state: State, aircraft: Aircraft, noise: np.ndarray | None = None) -> np.ndarray:
    """Return the observation of the most critical intruder, float32 ``[8]``.

    Args:
        noise: standard normal draws ``[4, K]`` of the reports; None for perfect knowledge.
    """
    seen = _perceived(state, aircraft, noise)
    return np.array(world.observe(state, seen, aircraft, EXACT_FLOATS), dtype=np.float32)


def observe_set(state: State, count: int, aircraft: Aircraft, noise: np.ndarray | None = None) -> SetObservation:
    """Return the observation of the ``count`` most critical intruders, the most critical first, numpy.

    Arguments as of :func:`observe`.
    """
    seen = VehicleState(*np.array(_perceived(state, aircraft, noise)).T)
    arrays = state._replace(own=VehicleState(*map(np.float64, state.own)), mask=np.array(state.mask))
    return world.observe_set(arrays, seen, count, aircraft, np)


def _perceived(state: State, aircraft: Aircraft, noise: np.ndarray | None) -> tuple[VehicleState, ...]:
    return world.perceived(state, None if noise is None else noise.T.tolist(), aircraft.dt, EXACT_FLOATS)


def separations(state: State) -> tuple[float, ...]:
    """Return the present distance to each intruder, m, ``[K]``."""
    own = state.own
    vehicles = (one.vehicle for one in state.intruders)
    return tuple(distance(vehicle.x - own.x, vehicle.y - own.y, EXACT_FLOATS) for vehicle in vehicles)


def step(state: State, action: tuple[float, float], parameters: World) -> tuple[State, StepResult]:
    """Advance the encounter by one time step; arguments as of :func:`envs.world.step`."""
    return world.step(state, action, parameters, EXACT_FLOATS)
