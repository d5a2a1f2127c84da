"""How soon the goal can be reached past an intruder: of some ways home, ahead of it or behind, the soonest safe one.

Whoever flies beside an intruder that is between him and his goal must outpace it or let it pass. Each way keeps to a
course and to full throttle, or brakes, for a while, and then turns home. The twelve manoeuvres of
:mod:`agents.policy.escape_features` tell what is safe; these tell what is late.
"""

import math
from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.observation import observe
from envs.outcome import RULES
from envs.relative import distance

__all__ = ["ROOM", "Ways", "arrival_of", "late", "soonest", "ways"]

_COURSES = (None, "own", 0.0, math.radians(30.0), math.radians(-30.0))
"""Courses that are kept to: to the goal, one's own, or the intruder's and so much to its left."""

_THROTTLES = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0))
"""Throttle on that course, and on the way home."""

_WHILES = (0.0, 4.0, 8.0, 14.0, 22.0, 32.0, 46.0, 66.0)
"""How long it is kept to, s; in between the shortest while that is safe is looked for."""

_BETWEEN = (0.25, 0.5, 0.75)
"""Shares of the way from a while that is not safe to the next longer one, which is, that are tried too."""

_KINDS = tuple(product(_COURSES, _THROTTLES))

_PIECE = 2.0
_SPANS = np.array([_PIECE] * 40 + [2.0 * _PIECE] * 38)
"""Durations of the pieces, s; ways that take longer lead nowhere."""

_SPARE = 15.0
"""Beyond the separation that a way is to keep, m; less where there is less already."""

ROOM = RULES.separation + _SPARE + 1.0
"""Range of the intruder from which on a way has the room to keep all of that, m."""

_SPARE_A_SECOND = 2.0
"""How much more a way is to keep of an intruder for each second until then, m. Who flies a way that is just safe, and
errs by a metre, may have to give it up for another one, and so again and again; what is far ahead may yet go wrong."""

_WITHIN = RULES.goal_radius - 20.0
"""Distance at which the goal is reached, m."""

_LATE, _VERY_LATE = 15.0, 25.0
"""By how much an arrival comes later than at the highest speed with nothing in between, s, where that begins to matter,
and where it matters altogether."""

_FOR_A_SECOND = 3.0
"""How much later a second more on a course may bring one home, s."""

_AS_SOON = 0.5
"""Ways that come so much later than the soonest are as good, s. It is less than the shortest while may cost: who flies
on for two seconds now does so again a second later, and so for ever."""


class Ways(NamedTuple):
    """What comes of each way, ``[W, ...]``."""

    arrival: jax.Array
    """s from now; infinite where a way is not safe, or leads nowhere."""
    throttle: jax.Array
    """Its acceleration in the first second, 1 at the limit."""
    turn: jax.Array
    """Its yaw rate in the first second, 1 at the limit."""


def ways(own: VehicleState, goal_x: jax.Array, goal_y: jax.Array, intruder: VehicleState) -> Ways:
    """Return what comes of each way home.

    Turns are chains of straight pieces; the intruder flies straight on. Of a kind of way that is safe after one while
    and not after the next shorter one, whiles between them are tried, where it comes home the soonest; and the one
    that is just safe comes from what the nearest keep. The coarser whiles are off by seconds, differently in each
    second as the intruder comes nearer: it would be chance which side comes first.

    Args:
        own: ownship, ``[...]``.
        goal_x, goal_y: m, ``[...]``.
        intruder: ``[...]``.
    """
    wide = (1,) * goal_x.ndim
    x, y = intruder.x - own.x, intruder.y - own.y
    goal = goal_x - own.x, goal_y - own.y
    least = jnp.clip(jnp.hypot(x, y) - 0.5, RULES.separation, RULES.separation + _SPARE)
    heading = jnp.cos(own.heading), jnp.sin(own.heading)
    course = jnp.cos(intruder.heading), jnp.sin(intruder.heading)

    def tried(until: jax.Array) -> _Tried:
        kept, arrival = _flown(heading, own.speed, goal, (x, y), course, intruder.speed, until)
        return _Tried(jnp.broadcast_to(until, kept.shape), kept - least, arrival)

    coarse = tried(jnp.asarray(_WHILES, goal_x.dtype).reshape(1, -1, *wide))
    becomes = (coarse.spare[:, :-1] < 0.0) & (coarse.spare[:, 1:] >= 0.0)
    at = jnp.argmin(jnp.where(becomes, coarse.arrival[:, 1:], jnp.inf), axis=1, keepdims=True)
    short, long = (_Tried(*(jnp.take_along_axis(part, at + i, axis=1) for part in coarse)) for i in range(2))
    share = jnp.asarray(_BETWEEN, goal_x.dtype).reshape(1, -1, *wide)
    fine = tried(jnp.ceil((short.until + share * (long.until - short.until)) * (1.0 / _PIECE)) * _PIECE)
    near = _Tried(*(jnp.concatenate(parts, axis=1) for parts in zip(short, fine, long, strict=True)))
    safe = (jnp.where(each.spare >= 0.0, each.arrival, jnp.inf) for each in (coarse, fine))
    arrivals = jnp.concatenate([*safe, _just_safe(near)], axis=1)  # [K, E, ...]
    homeward = np.arange(arrivals.shape[1]) < 1  # of whiles of 0 s
    courses, home = _courses(heading, course, (len(_KINDS), 1, *wide))
    to_goal = _unit(*goal)
    straight = home | jnp.asarray(homeward).reshape(1, -1, *wide)
    to_x, to_y = (jnp.where(straight, to_goal[i], courses[i]) for i in range(2))
    angle = jnp.arctan2(heading[0] * to_y - heading[1] * to_x, heading[0] * to_x + heading[1] * to_y)
    turn = jnp.clip(angle * (1.0 / SURROGATE.yaw_rate_max), -1.0, 1.0)
    throttle = jnp.asarray([[kind[1][int(back)] for back in homeward] for kind in _KINDS], jnp.float32)
    return Ways(
        *(
            jnp.broadcast_to(part, arrivals.shape).reshape(-1, *goal_x.shape)
            for part in (arrivals, throttle.reshape(*throttle.shape, *wide), turn)
        )
    )


class _Tried(NamedTuple):
    """What comes of ways, ``[K, T, ...]`` each."""

    until: jax.Array
    """How long they keep to their course, s; it does not fall."""
    spare: jax.Array
    """What they keep beyond what they are to, m."""
    arrival: jax.Array
    """s from now."""


def _just_safe(found: _Tried) -> jax.Array:
    """Return when a way between each and the next longer one arrives that is just safe, s, ``[K, T - 1, ...]``.

    It is infinite where there is none, or the longer one leads to another kind of flight.
    """
    spare, arrival = found.spare, found.arrival
    share = jnp.clip(spare[:, :-1] / jnp.minimum(spare[:, :-1] - spare[:, 1:], -1e-3), 0.0, 1.0)
    gained = jnp.where(jnp.isfinite(arrival[:, 1:]), arrival[:, 1:] - arrival[:, :-1], jnp.inf)
    alike = jnp.abs(gained) <= _FOR_A_SECOND * (found.until[:, 1:] - found.until[:, :-1])
    between = (spare[:, :-1] < 0.0) & (spare[:, 1:] >= 0.0) & alike
    return jnp.where(between, arrival[:, :-1] + share * jnp.where(alike, gained, 0.0), jnp.inf)


def late(arrival: jax.Array, goal_range: jax.Array) -> jax.Array:
    """Return how late an arrival is, in [0, 1]; where there is none, 1."""
    direct = jnp.maximum(goal_range - _WITHIN, 0.0) * (1.0 / SURROGATE.speed_max)
    return jnp.clip((arrival - direct - _LATE) * (1.0 / (_VERY_LATE - _LATE)), 0.0, 1.0)


def soonest(
    own: VehicleState, goal_x: jax.Array, goal_y: jax.Array, intruder: VehicleState, does: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Return when the soonest way is home, s, ``[N]``, and how one of those that are as soon begins, ``[N, 2]``.

    It is the one that begins most as the policy does.

    Args:
        own: ownship, ``[N]``.
        goal_x, goal_y: m, ``[N]``.
        intruder: ``[N]``.
        does: acceleration and yaw rate of the policy, 1 at the limit, ``[N, 2]``; so is what is returned.
    """
    found = ways(own, goal_x, goal_y, intruder)
    arrival = jnp.min(found.arrival, axis=0)
    begins = jnp.stack([found.throttle, found.turn], axis=-1)  # [W, N, 2]
    apart = jnp.sum(jnp.square(begins - does), axis=-1)
    chosen = jnp.argmin(jnp.where(found.arrival <= arrival + _AS_SOON, apart, jnp.inf), axis=0)
    return arrival, jnp.take_along_axis(begins, chosen[None, :, None], axis=0)[0]


def arrival_of(
    act: Callable[[jax.Array], jax.Array],
    own: VehicleState,
    goal_x: jax.Array,
    goal_y: jax.Array,
    intruder: VehicleState,
    seconds: int,
) -> jax.Array:
    """Return when a policy is home by itself, s, ``[N]``; infinite where it is not within so many seconds.

    The intruder flies straight on; whether it comes too close is not asked.

    Args:
        act: observations ``[N, 8]`` -> actions ``[N, 2]``.
        own, goal_x, goal_y, intruder: as for :func:`soonest`.
        seconds: how many are flown.
    """

    def forward(carry: tuple[VehicleState, VehicleState, jax.Array], second: jax.Array) -> tuple[Any, None]:
        here, other, arrival = carry
        action = act(observe(here, other, goal_x, goal_y, jnp))
        there = advance(here, *commands((action[:, 0], action[:, 1]), SURROGATE, jnp), 1.0, SURROGATE, jnp)
        left = distance(goal_x - there.x, goal_y - there.y, jnp)
        arrival = jnp.where(jnp.isinf(arrival) & (left < RULES.goal_radius), second + 1.0, arrival)
        return (there, advance(other, 0.0, 0.0, 1.0, SURROGATE, jnp), arrival), None

    begin = own, intruder, jnp.full(goal_x.shape, jnp.inf, goal_x.dtype)
    (_, _, arrival), _ = jax.lax.scan(forward, begin, jnp.arange(seconds, dtype=goal_x.dtype))
    return arrival


def _flown(
    heading: tuple[jax.Array, jax.Array],
    speed: jax.Array,
    goal: tuple[jax.Array, jax.Array],
    other: tuple[jax.Array, jax.Array],
    course: tuple[jax.Array, jax.Array],
    other_speed: jax.Array,
    until: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """Return what each way keeps of the separation until it is home, m, and when that is, s, ``[K, T, ...]`` each.

    What is kept later counts less, by :data:`_SPARE_A_SECOND`.

    Args:
        heading, course: of ownship and intruder, unit vectors, ``[...]``.
        speed, other_speed: m/s, ``[...]``.
        goal, other: relative to the ownship, m, ``[...]``.
        until: how long ways keep to their course, s, ``[K, T, ...]`` or what is broadcast to that.
    """
    wide = (1,) * speed.ndim
    begin, end = (jnp.asarray([kind[1][i] for kind in _KINDS]).reshape(-1, 1, *wide) for i in range(2))
    courses, home = _courses(heading, course, (len(_KINDS), 1, *wide))
    drift = other_speed * course[0], other_speed * course[1]

    def forward(carry: tuple[jax.Array, ...], piece: tuple[jax.Array, ...]) -> tuple[tuple[jax.Array, ...], None]:
        x, y, cosine, sine, speed, least, arrival = carry
        since, span, most = piece
        first = since < until
        to_goal = _unit(goal[0] - x, goal[1] - y)
        straight = home | ~first
        to = jnp.where(straight, to_goal[0], courses[0]), jnp.where(straight, to_goal[1], courses[1])
        new_cosine, new_sine = _turned((cosine, sine), to, most)
        gain = jnp.where(first, begin, end) * (SURROGATE.acceleration_max * span)
        new_speed = jnp.clip(speed + gain, SURROGATE.speed_min, SURROGATE.speed_max)
        way = 0.25 * span * (speed + new_speed)
        step_x, step_y = way * (cosine + new_cosine), way * (sine + new_sine)
        # The intruder seen from the ownship, at the beginning of the piece and along it.
        seen_x, seen_y = other[0] + drift[0] * since - x, other[1] + drift[1] * since - y
        move_x, move_y = drift[0] * span - step_x, drift[1] * span - step_y
        share = -(seen_x * move_x + seen_y * move_y) / (move_x * move_x + move_y * move_y + 0.01)
        share = jnp.clip(share, 0.0, 1.0)
        near_x, near_y = seen_x + share * move_x, seen_y + share * move_y
        flies = jnp.isinf(arrival)
        near = jnp.sqrt(near_x * near_x + near_y * near_y) - _SPARE_A_SECOND * (since + share * span)
        least = jnp.where(flies, jnp.minimum(least, near), least)
        x, y = x + step_x, y + step_y
        left = jnp.sqrt(jnp.square(goal[0] - x) + jnp.square(goal[1] - y))
        early = jnp.clip((_WITHIN - left) / new_speed, 0.0, span)
        arrival = jnp.where(flies & (left <= _WITHIN), since + span - early, arrival)
        return (x, y, new_cosine, new_sine, new_speed, least, arrival), None

    whole = (len(_KINDS), until.shape[1], *speed.shape)
    still, never = jnp.zeros(whole, speed.dtype), jnp.full(whole, jnp.inf, speed.dtype)
    start = still, still, *(jnp.broadcast_to(part, whole) for part in (*heading, speed)), never, never
    most = SURROGATE.yaw_rate_max * _SPANS
    pieces = np.cumsum(_SPANS) - _SPANS, _SPANS, np.stack([np.cos(most), np.sin(most)], axis=-1)
    (*_, least, arrival), _ = jax.lax.scan(forward, start, tuple(jnp.asarray(part, speed.dtype) for part in pieces))
    return least, arrival


def _unit(x: jax.Array, y: jax.Array) -> tuple[jax.Array, jax.Array]:
    inverse = jax.lax.rsqrt(x * x + y * y + 1e-6)
    return x * inverse, y * inverse


def _courses(
    own: tuple[jax.Array, jax.Array], intruder: tuple[jax.Array, jax.Array], column: tuple[int, ...]
) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
    """Return the unit vectors of the kinds' courses ``[K, 1, ...]``, and which lead home from the first.

    Args:
        own, intruder: unit vectors of their courses, ``[...]``.
        column: shape of one number of each kind.
    """
    courses = [kind[0] for kind in _KINDS]
    angles = [course if isinstance(course, float) else 0.0 for course in courses]
    cosine, sine = (jnp.asarray(part(angles), own[0].dtype).reshape(column) for part in (np.cos, np.sin))
    ones = jnp.asarray([course == "own" for course in courses]).reshape(column)
    x = jnp.where(ones, own[0], intruder[0] * cosine - intruder[1] * sine)
    y = jnp.where(ones, own[1], intruder[0] * sine + intruder[1] * cosine)
    return (x, y), jnp.asarray([course is None for course in courses]).reshape(column)


def _turned(
    own: tuple[jax.Array, jax.Array], to: tuple[jax.Array, jax.Array], most: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Return a unit vector turned towards another one by an angle at most, whose cosine and sine are given, ``[2]``."""
    ahead = own[0] * to[0] + own[1] * to[1]
    left = own[0] * to[1] - own[1] * to[0]
    cosine, sine = most[0], jnp.copysign(most[1], left)
    within = ahead >= cosine
    return (
        jnp.where(within, to[0], own[0] * cosine - own[1] * sine),
        jnp.where(within, to[1], own[0] * sine + own[1] * cosine),
    )
