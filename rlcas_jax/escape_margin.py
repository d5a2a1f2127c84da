"""The escape margin: how much of the separation the best of twelve simple manoeuvres keeps.

The manoeuvres are those of :mod:`agents.policy.escape_features`, here from the true state and with all intruders, which
fly straight on.
"""

from functools import reduce
from typing import Any

from agents.policy.escape_features import separations
from envs.angles import sincos
from envs.kinematics import VehicleState, velocity
from envs.observation import Decoded
from envs.relative import bearing

__all__ = ["best"]


def best(own: VehicleState, goal_x: Any, goal_y: Any, intruders: VehicleState, mask: Any, xp: Any) -> Any:
    """Return the least separation from all intruders under the manoeuvre that keeps most, m, ``[...]``.

    Args:
        own: ownship, ``[...]``.
        goal_x, goal_y: m, ``[...]``.
        intruders: fields ``[..., K]``.
        mask: which of them are there, ``[..., K]``; where none is, the answer is infinite.
        xp: array namespace, numpy or jax.numpy.
    """
    seen_by = VehicleState(*(field[..., None] for field in own))
    sine, cosine = sincos(seen_by.heading, xp)
    x, y = intruders.x - seen_by.x, intruders.y - seen_by.y
    vx, vy = velocity(intruders, xp)
    speed = xp.broadcast_to(seen_by.speed, x.shape)
    geometry = Decoded(
        speed,
        x * cosine + y * sine,
        y * cosine - x * sine,
        vx * cosine + vy * sine,
        vy * cosine - vx * sine,
        speed,  # the manoeuvres turn by the goal's bearing, wherever it is
        speed,
    )
    goal_bearing = xp.broadcast_to(bearing(seen_by, goal_x[..., None], goal_y[..., None], xp), x.shape)
    kept = (xp.min(xp.where(mask, each, xp.inf), axis=-1) for each in separations(geometry, goal_bearing, xp))
    return reduce(xp.maximum, kept)
