"""The observation contract: eight numbers in [-1, 1], and back to the geometry they stand for."""

import math
from typing import Any, NamedTuple

from envs.angles import sincos
from envs.backend import FloatNamespace
from envs.kinematics import VehicleState
from envs.relative import bearing, distance, straight_cpa

__all__ = [
    "CRITICAL_RADIUS",
    "DISTANCE_HALF",
    "NAMES",
    "SIZE",
    "SPEED_HALF",
    "SPEED_MIDDLE",
    "Decoded",
    "criticality",
    "decode",
    "most_critical",
    "observe",
]

NAMES = (
    "own_speed",
    "own_heading",
    "intruder_speed",
    "intruder_heading",
    "bearing_to_intruder",
    "distance_to_intruder",
    "bearing_to_goal",
    "distance_to_goal",
)
"""Order of the components (paper, section "RL Training")."""

SIZE = len(NAMES)

CRITICAL_RADIUS = 1_500.0
"""Distance that counts as a conflict when the most critical of several intruders is chosen, m."""

SPEED_MIDDLE, SPEED_HALF = 75.0, 25.0
"""Own speed that is 0 in the observation, and how much faster 1 is, m/s."""

DISTANCE_HALF = 10_000.0
"""Distance that is 0 in the observation, and how much farther 1 is, m."""

_INTRUDER_SPEED_HALF = 75.0


def observe(own: VehicleState, intruder: VehicleState, goal_x: Any, goal_y: Any, xp: Any) -> Any:
    """Return the observation of one intruder and the goal, ``[..., 8]`` in [-1, 1].

    Own speed is scaled from 50..100 m/s, the intruder's from 0..150 m/s, angles are divided by pi (bearings
    relative to the own heading), distances are scaled from 0..20 km; what lies outside is clipped.

    Args:
        own: ownship, ``[...]``.
        intruder: the intruder to be seen, ``[...]``.
        goal_x, goal_y: goal position, m, ``[...]``.
        xp: array namespace.
    """
    to_intruder = distance(intruder.x - own.x, intruder.y - own.y, xp)
    to_goal = distance(goal_x - own.x, goal_y - own.y, xp)
    parts = [
        (own.speed - SPEED_MIDDLE) * (1.0 / SPEED_HALF),
        own.heading * (1.0 / math.pi),
        intruder.speed * (1.0 / _INTRUDER_SPEED_HALF) - 1.0,
        intruder.heading * (1.0 / math.pi),
        bearing(own, intruder.x, intruder.y, xp) * (1.0 / math.pi),
        to_intruder * (1.0 / DISTANCE_HALF) - 1.0,
        bearing(own, goal_x, goal_y, xp) * (1.0 / math.pi),
        to_goal * (1.0 / DISTANCE_HALF) - 1.0,
    ]
    return xp.stack([xp.clip(part, -1.0, 1.0) for part in parts], axis=-1)


class Decoded(NamedTuple):
    """The geometry behind an observation in the ownship's frame (x ahead, y left); fields ``[...]``, SI units."""

    own_speed: Any
    intruder_x: Any
    intruder_y: Any
    intruder_vx: Any
    """Velocity over the ground, not relative to the ownship, m/s."""
    intruder_vy: Any
    goal_x: Any
    goal_y: Any


def decode(observation: Any, xp: Any) -> Decoded:
    """Recover the geometry from an observation given as eight components ``[...]`` each.

    Exact but for what :func:`observe` clipped. Absolute headings enter only through their difference, so what is
    built on this does not change when the whole scene is rotated.
    """
    own_speed = observation[0] * SPEED_HALF + SPEED_MIDDLE
    intruder_speed = (observation[2] + 1.0) * _INTRUDER_SPEED_HALF
    course = (observation[3] - observation[1]) * math.pi
    course = xp.where(course > math.pi, course - 2.0 * math.pi, course)
    course = xp.where(course < -math.pi, course + 2.0 * math.pi, course)
    sine, cosine = sincos(course, xp)
    intruder_sine, intruder_cosine = sincos(observation[4] * math.pi, xp)
    intruder_distance = (observation[5] + 1.0) * DISTANCE_HALF
    goal_sine, goal_cosine = sincos(observation[6] * math.pi, xp)
    goal_distance = (observation[7] + 1.0) * DISTANCE_HALF
    return Decoded(
        own_speed,
        intruder_distance * intruder_cosine,
        intruder_distance * intruder_sine,
        intruder_speed * cosine,
        intruder_speed * sine,
        goal_distance * goal_cosine,
        goal_distance * goal_sine,
    )


def criticality(own: VehicleState, intruders: VehicleState, radius: float, xp: Any) -> Any:
    """Rank intruders by urgency, smallest first, ``[..., K]``.

    The rank is the time in seconds until the range falls below ``radius`` on straight courses; where it does
    not, 10^4 plus the predicted distance at the closest approach in metres; where it is below already, that
    distance less the radius, which is negative.

    Args:
        own: ownship with fields ``[..., 1]``.
        intruders: fields ``[..., K]``.
        radius: distance that counts as a conflict, m.
        xp: array namespace.
    """
    cpa = straight_cpa(own, intruders, xp)
    now = distance(intruders.x - own.x, intruders.y - own.y, xp)
    # Along a straight relative course the squared range is d^2 + w^2 (t - t_cpa)^2 with w the relative speed.
    travelled = xp.sqrt(xp.maximum(now * now - cpa.distance * cpa.distance, 1e-9))
    inside = xp.sqrt(xp.maximum(radius * radius - cpa.distance * cpa.distance, 0.0))
    time = xp.maximum(cpa.time * (1.0 - inside / travelled), 0.0)
    # Of several inside, the one that will come closest: with equal ranks their order would decide.
    conflict = xp.where(now < radius, cpa.distance - radius, time)
    return xp.where(cpa.distance < radius, conflict, 10_000.0 + cpa.distance)


def most_critical(own: VehicleState, intruders: Any, mask: Any, radius: float, xp: Any) -> VehicleState:
    """Choose, of the intruders ``[..., K]`` present by ``mask``, the most urgent one, ``[...]``.

    An absent intruder is never chosen unless all are absent. Plain floats come as a tuple of the intruders present.
    """
    if isinstance(xp, FloatNamespace):
        if len(intruders) == 1:
            return intruders[0]
        return min(intruders, key=lambda one: criticality(own, one, radius, xp))
    if intruders.x.shape[-1] == 1:
        return VehicleState(*(field[..., 0] for field in intruders))
    seen_by = VehicleState(*(field[..., None] for field in own))
    rank = xp.where(mask, criticality(seen_by, intruders, radius, xp), xp.inf)
    chosen = xp.argmin(rank, axis=-1)[..., None]
    return VehicleState(*(xp.take_along_axis(field, chosen, axis=-1)[..., 0] for field in intruders))
