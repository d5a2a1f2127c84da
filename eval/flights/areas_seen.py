"""Areas among what a resolver sees: as intruders that stand still or drift
(:mod:`eval.flights.static_obstacles`).
"""

from collections.abc import Sequence

import numpy as np

from agents.baselines.baselines import Observation
from agents.kernel.areas import ActiveArea
from envs.aircraft import Aircraft
from envs.areas import Area
from envs.kinematics import VehicleState
from eval.flights.static_obstacles import Standing, as_intruders, standing


def at_all_heights(areas: Sequence[Area]) -> list[ActiveArea]:
    """Return areas as they count where heights are not looked at: while they are valid."""
    return [ActiveArea(n, area, area.valid_from, area.valid_until) for n, area in enumerate(areas)]


def what_stands(areas: Sequence[Area], aircraft: Aircraft) -> Standing:
    """Return what areas, as they are at the start, are to a resolver, ``[S]``; they count at all
    heights.
    """
    return standing(at_all_heights(areas), aircraft.separation, 0.0)


def what_stands_in_each(areas: np.ndarray, aircraft: Aircraft) -> Standing:
    """Return what the areas of encounters, object ``[N]``, are to a resolver, ``[N, S]``."""
    obstacles = [what_stands(areas_of_encounter, aircraft) for areas_of_encounter in areas]
    shape = len(obstacles), max((obstacle.x.size for obstacle in obstacles), default=0)
    result = Standing(*(np.zeros(shape) for _ in Standing._fields))
    result.begin[:] = np.inf  # never
    for n, obstacle in enumerate(obstacles):
        for into, values in zip(result, obstacle, strict=True):
            into[n, : values.size] = values
    return result


def add_to_observation(
    observation: Observation, standing: Standing, time: float, aircraft: Aircraft
) -> Observation:
    """Return what a resolver sees of encounters ``[M]``, and after the intruders what stands in
    their ways, ``[M, S]``, some seconds after the start.
    """
    intruders = as_intruders(standing, time, aircraft.separation)
    distance_scale = (
        np.ones(observation.mask.shape)
        if observation.distance_scale is None
        else observation.distance_scale
    )
    pairs = zip(observation.intruders, intruders.state, strict=True)
    return observation._replace(
        intruders=VehicleState(*(np.concatenate(fields, axis=-1) for fields in pairs)),
        mask=np.concatenate([observation.mask, intruders.mask], axis=-1),
        distance_scale=np.concatenate([distance_scale, intruders.distance_scale], axis=-1),
    )
