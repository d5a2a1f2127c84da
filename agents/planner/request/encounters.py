"""What a planner is asked at the start of encounters."""

import numpy as np

from agents.kernel.traffic import Traffic
from agents.planner.request.request import Request
from envs.aircraft import Aircraft
from envs.arrays import Float, Int
from envs.encounters import Encounter
from envs.frames import Air, F
from envs.kinematics import VehicleState

_LEG, _POINTS = 5.0, 10  # separations between points of the route from the goal on, and how many


def request_of(
    encounters: Encounter, aircraft: Aircraft, intruders: VehicleState[Air] | None = None
) -> Request:
    """Return what a planner is asked at the start of encounters ``[N]``, with intruders as
    believed, or as they are, and their separations of their own.

    The route runs from the start to the goal, then over a point every 5 separations on the same
    line to 45 beyond it.
    """
    traffic = Traffic.straight(
        encounters.intruders if intruders is None else intruders, encounters.mask
    )._replace(separation=encounters.separation)
    own = encounters.own
    return Request(own, traffic, *route_of(own, encounters.goal_x, encounters.goal_y, aircraft))


def route_of(
    own: VehicleState[F],
    goal_x: Float[np.ndarray, " N"],
    goal_y: Float[np.ndarray, " N"],
    aircraft: Aircraft,
) -> tuple[Float[np.ndarray, "N R"], Float[np.ndarray, "N R"], Int[np.ndarray, " N"]]:
    """Return the route from a place to the goal and on, ``[N, R]`` each of x and y, m, and its
    number of points, ``[N]``.
    """
    dx, dy = goal_x - own.x, goal_y - own.y
    length = np.maximum(np.hypot(dx, dy), 1e-9)
    beyond = _LEG * aircraft.separation * np.arange(_POINTS)
    x = np.concatenate([own.x[:, None], goal_x[:, None] + (dx / length)[:, None] * beyond], axis=1)
    y = np.concatenate([own.y[:, None], goal_y[:, None] + (dy / length)[:, None] * beyond], axis=1)
    return x, y, np.full(len(x), x.shape[1])
