"""Inputs of the network for any number of intruders: one vector for the ownship, one for each
intruder.

They are derived from the scene inside the network's own forward pass, for jax and numpy alike, and
do not change with the order of the intruders, nor with absent ones.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.policy import escapes
from agents.policy.scene import Scene, mirrored
from envs.backend import FLOATS
from envs.relative import distance

OWN, EACH = 15 + escapes.COUNT, 16
"""Numbers that describe the ownship, its goal and what simple manoeuvres keep; and an intruder."""

KEPT_UNIT = 0.03
"""Resolution of what manoeuvres keep beyond the separation, D."""

ALIKE = 0.05
"""Between what manoeuvres keep, squashed: 1.5 thousandths of D near the separation."""

_UNITS = (
    0.0025,
    30.0,
    1.0 / 6.0,
    1.0,
    0.2,
    0.0,
)  # of :func:`passing`, for lengths in D and speeds in the greatest


class SetInputs(NamedTuple):
    """Inputs of the network's first layers."""

    own: Any  # [..., 37]
    each: Any  # [..., K, 16]; of absent intruders anything finite
    present: Any  # bool [..., K]
    mirror_sign: Any  # factor of the network's yaw rate, -1 where the scene is seen mirrored, [...]


def set_inputs(seen: Scene, xp: Any) -> SetInputs:
    """Return the inputs for scenes ``[...]``, not mirrored, with K >= 1 intruders' places; all
    within about [-3, 3].
    """
    seen, sign = mirrored(seen, xp)
    # Manoeuvres along the last axis: there numpy adds up a row in the same order whatever the
    # number of rows.
    kept = xp.stack(list(escapes.kept(seen, xp)), axis=-1)
    spare = soft((kept - 1.0) * (1.0 / KEPT_UNIT), xp)  # [..., 22]
    own = own_part(seen, xp.zeros_like(seen.own_speed), xp)
    advice = _advice(spare, escapes.steering(seen, xp), xp)
    to_goal = distance(seen.goal_x, seen.goal_y, xp) + 1e-6
    cosine, sine = seen.goal_x / to_goal, seen.goal_y / to_goal
    each = each_part(
        seen.x,
        seen.y,
        seen.vx,
        seen.vy,
        seen.own_speed[..., None],
        cosine[..., None],
        sine[..., None],
        xp,
    )
    return SetInputs(
        xp.concatenate([xp.stack([*own, *advice], axis=-1), spare], axis=-1),
        xp.stack(each, axis=-1),
        seen.present,
        sign,
    )


def set_inputs_of_one(seen: Scene, kept: np.ndarray) -> tuple[list[float], list[list[float]]]:
    """Return the inputs for one mirrored scene of plain floats: for the ownship, and a list for
    each intruder present.

    ``kept`` is what :func:`agents.policy.escapes.kept` gives of it, ``[22]``.
    """
    spare = soft((kept - 1.0) * (1.0 / KEPT_UNIT), np)
    advice = _advice(spare, escapes.steering_of_one(seen), np)
    own = [*own_part(seen, 0.0, FLOATS), *map(float, advice), *spare.tolist()]
    to_goal = distance(seen.goal_x, seen.goal_y, FLOATS) + 1e-6
    cosine, sine = seen.goal_x / to_goal, seen.goal_y / to_goal
    intruders = zip(seen.x, seen.y, seen.vx, seen.vy, strict=True)
    return own, [each_part(*one, seen.own_speed, cosine, sine, FLOATS) for one in intruders]


def own_part(seen: Scene, zero: Any, xp: Any) -> list[Any]:
    """Return what describes the ownship, its goal and its limits, 12 times ``[...]``; ``zero`` has
    that shape.
    """
    to_goal = distance(seen.goal_x, seen.goal_y, xp) + 1e-6
    speed, ratios = seen.own_speed, seen.ratios
    radius = speed * ratios.turn_radius
    # Of the turning circles.
    outside = [
        distance(seen.goal_x, seen.goal_y - side * radius, xp) - radius for side in (1.0, -1.0)
    ]
    return [
        (2.0 * speed - 1.0 - ratios.speed_min) / (1.0 - ratios.speed_min),
        speed,
        seen.goal_x / to_goal,
        seen.goal_y / to_goal,
        to_goal * 0.1 - 1.0,
        soft(to_goal, xp),
        *(soft(2.0 * each, xp) for each in outside),
        zero + 4.0 * (ratios.speed_min - 0.5),
        zero + soft(10.0 * ratios.acceleration_min, xp),
        zero + soft(10.0 * ratios.acceleration_max, xp),
        zero + soft(ratios.turn_radius, xp),
    ]


def each_part(
    x: Any, y: Any, vx: Any, vy: Any, pace: Any, goal_cosine: Any, goal_sine: Any, xp: Any
) -> list[Any]:
    """Return what describes an intruder, 16 times ``[..., K]``, beside own speed and the goal's
    direction.
    """
    away = distance(x, y, xp) + 1e-6
    relative = vx - pace
    return [
        x / away,
        y / away,
        xp.minimum(away * 0.1 - 1.0, 1.0),
        soft(away - 1.0, xp),
        vx,
        vy,
        relative,
        (x * relative + y * vy) / away,
        *passing(x, y, relative, vy, _UNITS, xp),
        # The same for the course that leads straight to the goal: is it time to turn back?
        *passing(x, y, vx - pace * goal_cosine, vy - pace * goal_sine, _UNITS, xp),
    ]


def _advice(spare: Any, steering: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Return what the best manoeuvre keeps, and how it accelerates and turns, 1 at the limit;
    ``[...]`` each.

    Of manoeuvres that keep nearly as much it is the mean of what they do, so that nothing hangs on
    rounding.
    """
    most = spare.max(axis=-1)
    behind = (most[..., None] - spare) * (1.0 / ALIKE)
    share = 1.0 / (1.0 + behind * behind)
    whole = share.sum(axis=-1)
    throttles = xp.asarray(escapes.THROTTLES.astype(most.dtype, copy=False))
    return most, (share * throttles).sum(axis=-1) / whole, (share * steering).sum(axis=-1) / whole


def passing(
    x: Any, y: Any, vx: Any, vy: Any, units: tuple[float, ...], xp: Any
) -> tuple[Any, Any, Any, Any]:
    """Describe how an aircraft at (x, y) with relative velocity (vx, vy) passes on a straight
    course.

    Returns the time to the closest approach, the signed miss distance at two scales (left positive)
    and how deep the separation is entered ahead. Slow relative speeds are softened: there the
    quotients would amplify the rounding of float32.

    Args:
        units: square of the speed that softens, how far ahead is looked, and what a time, a length,
            a length far away and the square of a range are scaled by or softened with.
    """
    slow, horizon, per_time, per_length, per_far, floor = units
    square = vx * vx + vy * vy + slow
    time = -(x * vx + y * vy) / square
    miss = (x * vy - y * vx) / xp.sqrt(square)
    ahead = xp.clip(time, 0.0, horizon)
    closest_x, closest_y = x + vx * ahead, y + vy * ahead
    closest = xp.sqrt(closest_x * closest_x + closest_y * closest_y + floor)
    return (
        soft(time * per_time, xp),
        soft(miss * per_length, xp),
        xp.clip(miss * per_far, -1.0, 1.0),
        xp.clip(1.5 - closest * per_length, -1.0, 1.5),
    )


def soft(value: Any, xp: Any) -> Any:
    """Return a value squashed to (-1, 1)."""
    return value / (1.0 + xp.abs(value))
