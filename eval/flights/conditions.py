"""Initial conditions of encounters, as figures and tables show them."""

from typing import NamedTuple

import numpy as np

from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import Encounter
from envs.observation import most_critical
from envs.relative import bearing, distance, straight_cpa

__all__ = ["Conditions", "conditions"]


class Conditions(NamedTuple):
    """Initial conditions, seen from the ownship towards the most critical intruder; fields ``[N]``."""

    intruders: np.ndarray
    """How many there are, int32."""
    own_speed: np.ndarray
    """m/s."""
    intruder_speed: np.ndarray
    """m/s."""
    distance: np.ndarray
    """m."""
    bearing: np.ndarray
    """Of the intruder from the own heading, rad in [-pi, pi), left positive."""
    relative_heading: np.ndarray
    """Intruder's heading less own heading, rad in [-pi, pi), counter-clockwise."""
    t_cpa: np.ndarray
    """Time to the closest point of approach on straight courses, s."""
    d_cpa: np.ndarray
    """Distance there, m."""
    route_length: np.ndarray
    """Distance from the start to the goal, m."""


def conditions(encounters: Encounter, aircraft: Aircraft) -> Conditions:
    """Return the initial conditions of encounters ``[N]`` of an aircraft."""
    own = encounters.own
    other = most_critical(own, encounters.intruders, encounters.mask, aircraft, np)
    cpa = straight_cpa(own, other, np)
    return Conditions(
        intruders=np.count_nonzero(encounters.mask, axis=-1).astype(np.int32),
        own_speed=own.speed,
        intruder_speed=other.speed,
        distance=distance(other.x - own.x, other.y - own.y, np),
        bearing=bearing(own, other.x, other.y, np),
        relative_heading=wrap(other.heading - own.heading, np),
        t_cpa=cpa.time,
        d_cpa=cpa.distance,
        route_length=distance(encounters.goal_x - own.x, encounters.goal_y - own.y, np),
    )
