"""The goals of a request: points of the route at which a plan may rejoin it."""

import math

import numpy as np

from agents.planner.request.options import Narrowed, Options
from agents.planner.request.request import BEYOND, Request, drift_points
from envs.arrays import Array, Bool, Int

_STRAIGHT = 1e-3  # of a leg's length, by which the way along it may be longer
_AHEAD = math.cos(math.radians(45.0))  # of the angle between the way to a leg and the leg


def next_goals(request: Request, options: Options[Narrowed]) -> Int[Array, "N goals"]:
    """Return the numbers of the route's points that may be rejoined at, the next one first;
    -1: none.

    Points that are passed are left out, and those that cannot be reached in time at the greatest
    speed. Of points round areas only the next one is rejoined at.
    """
    rows, number = np.arange(request.points.size)[:, None], np.arange(request.route_x.shape[1])
    exists = number < request.points[:, None]
    # From the points to the ownship, m, [N, R].
    off_x = request.own.x[:, None] - request.route_x
    off_y = request.own.y[:, None] - request.route_y
    away = np.hypot(off_x, off_y) - options.aircraft.goal_radius
    possible = _in_time(request, away, options) & exists
    if request.of_route is None:
        passed = _passes(request, rows, number, (off_x, off_y)) | (away <= 0.0)
        goals = _first_ahead(passed & exists)[:, None] + np.arange(options.goals)
    else:  # of one request
        of_route = request.of_route[0]
        ahead = np.flatnonzero(((of_route >= 0) & (of_route < BEYOND)) | (number == 0))
        none = np.full(options.goals, number.size)
        goals = np.append(ahead, none)[None, : options.goals]
    inside = goals < request.points[:, None]
    goals = np.where(inside, goals, 0)
    return np.where(inside & possible[rows, goals], goals, -1)


def on_same_leg(
    request: Request, first: Int[Array, " N"], later: Int[Array, " N"]
) -> Bool[Array, " N"]:
    """Return whether points numbered ``later`` are on the leg that leads to those numbered
    ``first``, as seen by the ownship, bool ``[N]``: the route is straight from one to the other,
    and it turns by less than 45 degrees at the first. Where there is no first, -1, none is.
    """
    rows, x, y = np.arange(first.size), request.route_x, request.route_y
    along = np.cumsum(np.hypot(np.diff(x, prepend=x[:, :1]), np.diff(y, prepend=y[:, :1])), axis=-1)
    on_x, on_y = x[rows, later] - x[rows, first], y[rows, later] - y[rows, first]
    direct = np.hypot(on_x, on_y)
    straight = along[rows, later] - along[rows, first] - direct <= _STRAIGHT * direct
    to_x, to_y = x[rows, first] - request.own.x, y[rows, first] - request.own.y
    straight &= first >= 0
    return straight & (to_x * on_x + to_y * on_y >= _AHEAD * np.hypot(to_x, to_y) * direct)


def _passes(request: Request, rows: Array, number: Array, off: tuple[Array, Array]) -> Array:
    """Return whether the ownship, off the points by so much, m, is beyond them in the direction in
    which the route goes on there, bool ``[N, R]``.

    ``rows`` are the numbers of the requests, ``[N, 1]``, ``number`` those of the points, ``[R]``.
    """
    leg = np.minimum(number, request.points[:, None] - 2)
    dx, dy = (
        field[rows, leg + 1] - field[rows, leg] for field in (request.route_x, request.route_y)
    )
    off_x, off_y = off
    return off_x * dx + off_y * dy > 0.0


def _first_ahead(passed: Array) -> Array:
    """Return the number of the first point that is not passed, ``[N]``; R where all are."""
    never = np.zeros((len(passed), 1), dtype=bool)
    return np.argmin(np.concatenate([passed, never], axis=1), axis=1)


def _in_time(request: Request, away: Array, options: Options[Narrowed]) -> Array:
    """Return which points, so far away now, m, can be reached in time, bool ``[N, R]``."""
    own = request.own
    fastest = np.maximum(options.manoeuvre.speed_max, own.speed)[:, None]
    if request.drift is not None:  # who can meet what drifts more slowly once, can later too
        points = request.route_x, request.route_y
        later_x, later_y = drift_points(points, request.drift, options.rejoin_by)
        away = np.hypot(own.x[:, None] - later_x, own.y[:, None] - later_y)
        away = away - options.aircraft.goal_radius
    return away <= fastest * options.rejoin_by
