"""Points of the route at which a plan may rejoin it."""

from typing import Any

import numpy as np

from agents.planner.options import Options
from agents.planner.request import Request

__all__ = ["eligible"]


def eligible(request: Request, options: Options) -> Any:
    """Return the numbers of the route's points that may be rejoined at, the next one first, ``[N, goals]``; -1: none.

    A point counts as passed when the ownship is within the goal radius of it, or beyond it in the direction in which
    the route goes on there. Points that cannot be reached in time at the greatest speed are left out.
    """
    x, y, points = request.route_x, request.route_y, request.points
    number = np.arange(x.shape[1])
    exists = number < points[:, None]
    onward = np.minimum(number + 1, points[:, None] - 1)
    from_number = np.where(onward > number, number, np.maximum(number - 1, 0))
    dx = np.take_along_axis(x, onward, 1) - np.take_along_axis(x, from_number, 1)
    dy = np.take_along_axis(y, onward, 1) - np.take_along_axis(y, from_number, 1)
    off_x, off_y = request.own.x[:, None] - x, request.own.y[:, None] - y
    far = np.hypot(off_x, off_y) - options.goal_radius
    passed = ((off_x * dx + off_y * dy > 0.0) | (far <= 0.0)) & exists
    first = np.argmin(np.concatenate([passed, np.zeros((points.size, 1), dtype=bool)], axis=1), axis=1)
    fastest = np.maximum(options.manoeuvre.speed_max, request.own.speed)[:, None]
    near = far <= fastest * options.rejoin_by
    chosen = first[:, None] + np.arange(options.goals)
    inside = chosen < points[:, None]
    chosen = np.where(inside, chosen, 0)
    return np.where(inside & np.take_along_axis(near & exists, chosen, 1), chosen, -1)
