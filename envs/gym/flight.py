"""One encounter in plain floats: the world's step, where arrays of one element would cost ten times
as much.

Every operation is the one that numpy does in double precision, so a flight equals numpy's to the
last bit and the surrogate's in double precision to 1e-6 m. (In single precision the surrogate's own
rounding at 10 km is 1 mm in every step.)
"""

from functools import partial
from typing import Any

import numpy as np

from envs import observation, world
from envs.aircraft import Aircraft
from envs.backend import EXACT_FLOATS
from envs.encounters import Encounter
from envs.kinematics import VehicleState
from envs.observation import SetObservation
from envs.relative import distance
from envs.rewards import Transition
from envs.starts import check_heeded
from envs.trees import map_leaves
from envs.world import State, StepResult


def begin(encounter: Encounter, dt: float) -> State:
    """Return the start of one encounter, intruders ``[K]``, for a time step of ``dt`` s; those that
    do not exist are left out.
    """
    check_heeded(encounter, "the encounter")
    members = np.flatnonzero(encounter.mask)
    plain = Encounter(
        own=map_leaves(float, encounter.own),
        goal_x=float(encounter.goal_x),
        goal_y=float(encounter.goal_y),
        intruders=_one_by_one(encounter.intruders, members),
        mask=(True,) * len(members),
        intent=_one_by_one(encounter.intent, members),
        sensor=map_leaves(lambda field: float(field[0]), encounter.sensor),
    )
    return world.begin(plain, EXACT_FLOATS, history_dt=dt)


def _one_by_one(tree: Any, members: np.ndarray) -> Any:
    """Return some members of a structure of arrays ``[K]`` as a tuple of structures of floats."""
    return tuple(map_leaves(lambda field, k=k: float(field[k]), tree) for k in members)


step = partial(world.step, xp=EXACT_FLOATS)


def observe(state: State, aircraft: Aircraft, noise: np.ndarray | None = None) -> np.ndarray:
    """Return the observation of the most critical intruder, float32 ``[8]``.

    The noise of the reports is ``[4, K]``, or None.
    """
    return np.array(world.observe(state, aircraft, _list(noise), xp=EXACT_FLOATS), dtype=np.float32)


def observe_set(
    state: State, count: int, aircraft: Aircraft, noise: np.ndarray | None = None
) -> SetObservation:
    """Return the observation of the ``count`` most critical intruders, the most critical first,
    in numpy.
    """
    perceived = world.perceive_intruders(state, _list(noise), aircraft.dt, EXACT_FLOATS)
    own = VehicleState(*map(np.float64, state.own))
    intruders = VehicleState(*np.array(perceived).T)
    intruders, mask = observation.rank_urgent(
        own, intruders, np.array(state.mask), count, aircraft, np
    )
    return observation.observe_set(own, intruders, mask, state.goal_x, state.goal_y, aircraft, np)


def _list(noise: np.ndarray | None) -> list[list[float]] | None:
    """Return noise ``[4, K]`` as K times four numbers."""
    return None if noise is None else noise.T.tolist()


def separations(state: State) -> tuple[float, ...]:
    """Return the present distance to each intruder, m, ``[K]``."""
    own = state.own
    vehicles = (intruder.vehicle for intruder in state.intruders)
    return tuple(
        distance(vehicle.x - own.x, vehicle.y - own.y, EXACT_FLOATS) for vehicle in vehicles
    )


def transition(
    before: State, after: State, action: tuple[float, float], result: StepResult, aircraft: Aircraft
) -> Transition:
    """Return a step as terms of a reward see it, in numpy: fields ``[]``, those of intruders
    ``[K]``.
    """
    stacked = result._replace(separations=np.array(result.separations))
    return Transition(
        before=_arrays(before),
        after=_arrays(after),
        action=action,
        result=map_leaves(np.asarray, stacked),
        aircraft=aircraft,
    )


def _arrays(state: State) -> State:
    """Return a state of plain numbers as one of arrays."""
    previous = None
    if state.previous is not None:
        previous = _together(state.previous[0]), _together(state.previous[1])
    sensor = map_leaves(lambda field: np.array([field]), state.sensor)
    plain = state._replace(intruders=None, intent=None, sensor=None, previous=None, mask=None)
    return map_leaves(np.asarray, plain)._replace(
        intruders=_together(state.intruders),
        intent=_together(state.intent),
        sensor=sensor,
        previous=previous,
        mask=np.array(state.mask),
    )


def _together(parts: Any) -> Any:
    """Return a tuple of K equal structures of plain numbers as one of arrays ``[K]``."""
    return map_leaves(lambda *fields: np.array(fields), *parts)
