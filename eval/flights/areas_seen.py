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
    each = [what_stands(some, aircraft) for some in areas]
    shape = len(each), max((one.x.size for one in each), default=0)
    found = Standing(*(np.zeros(shape) for _ in Standing._fields))
    found.begin[:] = np.inf  # never
    for n, one in enumerate(each):
        for into, values in zip(found, one, strict=True):
            into[n, : values.size] = values
    return found


def add_to_observation(
    observation: Observation, what: Standing, time: float, aircraft: Aircraft
) -> Observation:
    """Return what a resolver sees of encounters ``[M]``, and after the intruders what stands in
    their ways, ``[M, S]``, some seconds after the start.
    """
    seen = as_intruders(what, time, aircraft.separation)
    distance_scale = (
        np.ones(observation.mask.shape)
        if observation.distance_scale is None
        else observation.distance_scale
    )
    both = zip(observation.intruders, seen.state, strict=True)
    return observation._replace(
        intruders=VehicleState(*(np.concatenate(fields, axis=-1) for fields in both)),
        mask=np.concatenate([observation.mask, seen.there], axis=-1),
        distance_scale=np.concatenate([distance_scale, seen.distance_scale], axis=-1),
    )
