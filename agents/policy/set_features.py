"""Inputs of the network for any number of intruders: one vector for the ownship, one for each intruder.

They are derived from the scene inside the network's own forward pass, for jax and numpy alike, and do not change with
the order of the intruders, nor with absent ones.
"""

from typing import Any, NamedTuple

from agents.policy import escapes
from agents.policy.scene import Scene, mirrored
from envs.relative import distance

__all__ = ["EACH", "OWN", "SetInputs", "set_inputs"]

OWN = 15 + escapes.COUNT
"""Numbers that describe the ownship, its goal and what simple manoeuvres keep."""

EACH = 16
"""Numbers that describe an intruder."""

_KEPT_UNIT = 0.03  # D; resolution of what manoeuvres keep beyond the separation
_ALIKE = 0.05  # between what manoeuvres keep, squashed: 1.5 thousandths of D near the separation


class SetInputs(NamedTuple):
    """Inputs of the network's first layers."""

    own: Any
    """``[..., 37]``."""
    each: Any
    """``[..., K, 16]``; of absent intruders anything finite."""
    present: Any
    """bool ``[..., K]``."""
    sign: Any
    """Factor of the network's yaw rate, -1 where the scene is seen mirrored, ``[...]``."""


def set_inputs(seen: Scene, xp: Any) -> SetInputs:
    """Return the inputs for scenes ``[...]`` with K >= 1 places for intruders; all within about [-3, 3].

    Args:
        seen: not mirrored.
        xp: array namespace, numpy or jax.numpy.
    """
    seen, sign = mirrored(seen, xp)
    to_goal = distance(seen.goal_x, seen.goal_y, xp) + 1e-6
    goal_cosine, goal_sine = seen.goal_x / to_goal, seen.goal_y / to_goal
    speed, ratios = seen.own_speed, seen.ratios
    blank = xp.zeros_like(speed)
    radius = speed * ratios.turn_radius
    outside = [
        distance(seen.goal_x, seen.goal_y - side * radius, xp) - radius for side in (1.0, -1.0)
    ]  # of the turning circles
    # Manoeuvres along the last axis: there numpy adds up a row in the same order whatever the number of rows.
    kept = xp.stack(list(escapes.kept(seen, xp)), axis=-1)
    spare = _soft((kept - 1.0) * (1.0 / _KEPT_UNIT), xp)  # [..., 22]
    own = [
        (2.0 * speed - 1.0 - ratios.speed_min) / (1.0 - ratios.speed_min),
        speed,
        goal_cosine,
        goal_sine,
        to_goal * 0.1 - 1.0,
        _soft(to_goal, xp),
        *(_soft(2.0 * each, xp) for each in outside),
        blank + 4.0 * (ratios.speed_min - 0.5),
        blank + _soft(10.0 * ratios.acceleration_min, xp),
        blank + _soft(10.0 * ratios.acceleration_max, xp),
        blank + _soft(ratios.turn_radius, xp),
        *_advice(spare, escapes.steering(seen, xp), xp),
    ]
    goal_cosine, goal_sine, pace = goal_cosine[..., None], goal_sine[..., None], speed[..., None]
    away = distance(seen.x, seen.y, xp) + 1e-6
    vx = seen.vx - pace
    each = [
        seen.x / away,
        seen.y / away,
        xp.minimum(away * 0.1 - 1.0, 1.0),
        _soft(away - 1.0, xp),
        seen.vx,
        seen.vy,
        vx,
        (seen.x * vx + seen.y * seen.vy) / away,
        *_passing(seen.x, seen.y, vx, seen.vy, xp),
        # The same for the course that leads straight to the goal: is it time to turn back?
        *_passing(seen.x, seen.y, seen.vx - pace * goal_cosine, seen.vy - pace * goal_sine, xp),
    ]
    return SetInputs(
        xp.concatenate([xp.stack(own, axis=-1), spare], axis=-1),
        xp.stack(each, axis=-1),
        seen.present,
        sign,
    )


def _advice(spare: Any, steering: Any, xp: Any) -> tuple[Any, Any, Any]:
    """Return what the best manoeuvre keeps, and how it accelerates and turns, 1 at the limit; ``[...]`` each.

    Of manoeuvres that keep nearly as much it is the mean of what they do, so that nothing hangs on rounding.
    """
    most = xp.max(spare, axis=-1)
    behind = (most[..., None] - spare) * (1.0 / _ALIKE)
    share = 1.0 / (1.0 + behind * behind)
    whole = xp.sum(share, axis=-1)
    throttles = xp.asarray(escapes.THROTTLES.astype(most.dtype))
    return most, xp.sum(share * throttles, axis=-1) / whole, xp.sum(share * steering, axis=-1) / whole


def _passing(x: Any, y: Any, vx: Any, vy: Any, xp: Any) -> tuple[Any, Any, Any, Any]:
    """Describe how an aircraft at (x, y) with relative velocity (vx, vy) passes on a straight course.

    Returns the time to the closest approach, the signed miss distance at two scales (left positive) and how deep the
    separation is entered ahead. Relative speeds below a twentieth are softened: there the quotients would amplify the
    rounding of float32.
    """
    square = vx * vx + vy * vy + 0.0025
    time = -(x * vx + y * vy) / square
    miss = (x * vy - y * vx) / xp.sqrt(square)
    ahead = xp.clip(time, 0.0, 30.0)
    closest = distance(x + vx * ahead, y + vy * ahead, xp)
    return (
        _soft(time * (1.0 / 6.0), xp),
        _soft(miss, xp),
        xp.clip(miss * 0.2, -1.0, 1.0),
        xp.clip(1.5 - closest, -1.0, 1.5),
    )


def _soft(value: Any, xp: Any) -> Any:
    """Squash to (-1, 1) with most resolution around 0."""
    return value / (1.0 + xp.abs(value))
