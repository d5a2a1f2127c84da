"""An outer bound of where the ownship can be, from relaxed limits: the ground of every proof of
unresolvability.

A set of control histories is a *funnel*: bounds on heading and speed over time. In a direction n
the position can have come no farther by time t than its support

    h(n, t) = integral from 0 to t of max{ s cos(a - n) : heading a and speed s inside the funnel }
    d tau

(heading and speed chosen anew at each instant, regardless of each other: a relaxation), and so it
lies in the polygon that the supports in all directions of a fan bound. Every rounding here is
outwards: see :func:`support` and :func:`farthest`. The frame is the ownship's at the start, x ahead
and y to the left.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.angles import wrap
from envs.arrays import Array
from envs.kinematics import Limits
from envs.outcome import Rules
from envs.trees import map_leaves

EPSILON = 1e-4
"""A proof grants the ownship limits wider by this fraction."""

DIRECTIONS = 2.0 * math.pi / 32 * np.arange(32)
"""The fan of directions relative to the initial heading, rad."""


def delta(rules: Rules, limits: Limits) -> float:
    """Return by how much a proof needs the separation to be missed, m; a goal is enlarged by it.

    Twice what the judged separation of a step may err by, which grows with the turn in a step.
    """
    return 1e-4 * rules.separation * max(1.0, (limits.yaw_rate_max * rules.dt / 0.1) ** 2)


class Funnel(NamedTuple):
    """Bounds on control histories at times 0, step, 2 step, ...; fields ``[..., T]``."""

    turn_low: Array  # heading less the initial heading, not wrapped, rad
    turn_high: Array
    speed_low: Array  # m/s
    speed_high: Array


def relax(limits: Limits) -> Limits:
    """Return the limits that proofs grant, wider by :data:`EPSILON`."""
    wider = 1.0 + EPSILON
    return Limits(limits.speed_min / wider, *(limit * wider for limit in limits[1:]))


def root(speed: Array, times: Array, limits: Limits) -> Funnel:
    """Return the funnel of all control histories at times ``[T]``, s, within limits as proofs grant
    them.

    The initial speed ``[N]``, m/s, may lie outside the limits and stay there.
    """
    speed = np.asarray(speed)[:, None]
    turn = limits.yaw_rate_max * times + 0.0 * speed
    return Funnel(-turn, turn, *speeds(speed, speed, times, limits))


def speeds(low: Array, high: Array, seconds: Array, limits: Limits) -> tuple[Array, Array]:
    """Return the least and the greatest speeds some time later, m/s, ``[...]``; one outside the
    limits may stay.
    """
    slowest = np.minimum(low, np.maximum(limits.speed_min, low + limits.acceleration_min * seconds))
    fastest = np.maximum(
        high, np.minimum(limits.speed_max, high + limits.acceleration_max * seconds)
    )
    return slowest, fastest


def towards(funnel: Funnel, directions: Array) -> Array:
    """Return the largest speed in directions, rad from the initial heading, that a funnel allows,
    m/s, ``[...]``.
    """
    middle = 0.5 * (funnel.turn_low + funnel.turn_high)
    half_width = 0.5 * (funnel.turn_high - funnel.turn_low)
    cosine = np.cos(np.maximum(np.abs(wrap(directions - middle, np)) - half_width, 0.0))
    return np.where(cosine >= 0.0, funnel.speed_high, funnel.speed_low) * cosine


def narrow(
    funnel: Funnel, times: Array, at: Array, turn: Array, speed: Array, limits: Limits
) -> tuple[Funnel, Funnel]:
    """Cut funnels ``[N, T]`` in two: the histories at most, and those at least, at a turn or speed
    at a time ``[N]``.

    A history that is at most at a turn at a time was, and will be, no farther from it than the
    limits allow. Of the heading change (rad) and the speed (m/s) the one that does not divide is
    nan.
    """
    later = times - at[:, None]
    turned = limits.yaw_rate_max * np.abs(later)
    gained = np.where(later > 0.0, limits.acceleration_max * later, limits.acceleration_min * later)
    lost = np.where(later > 0.0, limits.acceleration_min * later, limits.acceleration_max * later)
    # fmin and fmax pass over nan: that bound stays.
    below = funnel._replace(
        turn_high=np.fmin(funnel.turn_high, turn[:, None] + turned),
        speed_high=np.fmin(funnel.speed_high, speed[:, None] + gained),
    )
    above = funnel._replace(
        turn_low=np.fmax(funnel.turn_low, turn[:, None] - turned),
        speed_low=np.fmax(funnel.speed_low, speed[:, None] + lost),
    )
    return below, above


def support(
    funnel: Funnel,
    directions: Array,
    step: float,
    limits: Limits,
    *,
    growing: bool = False,
    stride: int = 1,
) -> Array:
    """Return upper bounds of the support functions at every ``stride``-th time but 0, m, ``[..., D,
    T']``.

    The integrand changes at no more than L = speed_max yaw_rate_max + acceleration_max per second,
    so that its integral over a cell exceeds the trapezium by at most L step^2 / 4 - (change)^2 / (4
    L), which is added: below 0.0036 m a cell at 0.05 s, or 1.8 m over 25 s. If it only grows (true
    of :func:`root`), it exceeds it by at most
    |change| step / 2. The funnel ``[..., T]`` has times ``step`` seconds apart; directions
    are rad, ``[..., D]``.
    """
    rate = towards(map_leaves(lambda bound: bound[..., None, :], funnel), directions[..., None])
    change = rate[..., 1:] - rate[..., :-1]
    top_speed = np.maximum(limits.speed_max, funnel.speed_high.max(axis=-1))[..., None, None]
    steepest = top_speed * limits.yaw_rate_max + max(
        limits.acceleration_max, -limits.acceleration_min
    )
    excess = np.maximum(0.25 * (steepest * step * step - change * change / steepest), 0.0)
    if growing:
        excess = np.minimum(excess, 0.5 * step * np.abs(change))
    cells = 0.5 * step * (rate[..., 1:] + rate[..., :-1]) + excess
    return np.cumsum(cells, axis=-1)[..., stride - 1 :: stride]


def farthest(supports: Array, x: Array, y: Array) -> Array:
    """Bound the distance of any point of the polygons from points (x, y), m, ``[..., K, T]``.

    A point seen from (x, y) between two neighbours of the fan obeys both their supports ``[..., D,
    T]``, so that it is no farther than their vertex, or, where that lies outside the sector between
    them, than the end of the shorter side.
    """
    along = (
        np.cos(DIRECTIONS)[:, None] * x[..., None, :]
        + np.sin(DIRECTIONS)[:, None] * y[..., None, :]
    )
    reach = supports[..., None, :, :] - along
    next_reach = np.roll(reach, -1, axis=-2)
    cosine, sine = math.cos(DIRECTIONS[1]), math.sin(DIRECTIONS[1])
    low, high = np.minimum(reach, next_reach), np.maximum(reach, next_reach)
    square = low * low + high * high - 2.0 * low * high * cosine
    sector = np.where(
        high * cosine > low, np.maximum(low, 0.0) / cosine, np.sqrt(np.maximum(square, 0.0)) / sine
    )
    return np.max(sector, axis=-2)
