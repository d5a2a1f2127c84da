"""One encounter in plain floats: the world's step, where arrays of one element would cost ten times as much.

Every operation is the one that numpy does in double precision, so a flight equals numpy's to the last bit and the
surrogate's in double precision to 1e-6 m. (In single precision the surrogate's own rounding at 10 km is 1 mm in every
step.)
"""

from typing import Any

import numpy as np

from envs import world
from envs.backend import EXACT_FLOATS
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.relative import distance
from envs.world import State, StepResult, World

__all__ = ["begin", "observe", "separations", "step"]


def begin(encounter: Encounter) -> State:
    """Return the start of one encounter (own fields are scalars, intruder fields ``[K]``) without absent intruders."""
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
    return world.begin(plain, EXACT_FLOATS, late_reports=True)


def observe(state: State, noise: np.ndarray | None = None) -> np.ndarray:
    """Return the observation of the most critical intruder, float32 ``[8]``.

    Args:
        state: of the encounter.
        noise: standard normal draws ``[4, K]`` of the reports; None for perfect knowledge.
    """
    seen = world.perceived(state, None if noise is None else noise.T.tolist(), EXACT_FLOATS)
    return np.array(world.observe(state, seen, EXACT_FLOATS), dtype=np.float32)


def separations(state: State) -> tuple[float, ...]:
    """Return the present distance to each intruder, m, ``[K]``."""
    own = state.own
    vehicles = (one.vehicle for one in state.intruders)
    return tuple(distance(vehicle.x - own.x, vehicle.y - own.y, EXACT_FLOATS) for vehicle in vehicles)


def step(state: State, action: tuple[float, float], parameters: World) -> tuple[State, StepResult]:
    """Advance the encounter by one time step; arguments as of :func:`envs.world.step`."""
    return world.step(state, action, parameters, EXACT_FLOATS)
