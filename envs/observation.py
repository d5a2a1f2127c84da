"""The observation contract: eight numbers in [-1, 1] for one intruder, a set of rows for several,
and back again.

Everything is scaled by the aircraft, so that alike encounters of alike aircraft are seen alike.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias, TypeVar

from envs.aircraft import Aircraft
from envs.angles import sincos
from envs.arrays import Array, ArrayModule
from envs.backend import FloatNamespace
from envs.compiled import scalar
from envs.frames import F
from envs.kinematics import VehicleState
from envs.relative import RelativeMotion, bearing, cpa_of_motion, distance, relative_motion
from envs.trees import map_leaves

T = TypeVar("T")

Vehicles: TypeAlias = Any
"""States of intruders: a `VehicleState` of arrays ``[..., K]``, or a tuple of K of floats."""

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

ROW = 4
"""Numbers of the own and goal part, and of each intruder."""


def observe(
    own: VehicleState[F],
    intruder: VehicleState[F],
    goal_x: Array,
    goal_y: Array,
    aircraft: Aircraft,
    xp: ArrayModule,
) -> Array:
    """Return the observation of one intruder and the goal, ``[..., 8]`` in [-1, 1].

    Own speed is scaled from the aircraft's lowest to its highest, the intruder's from 0 to the
    traffic's highest, distances from 0 to 20 separations. Angles are divided by pi; bearings are
    relative to the own heading. What lies outside is clipped. All arguments are ``[...]``, the goal
    in m, the aircraft ``[...]`` or floats.
    """
    mine = _own_parts(own, goal_x, goal_y, aircraft, xp)
    theirs = _traffic_parts(own, intruder, aircraft, xp)
    return _stack([*mine[:2], *theirs, *mine[2:]], xp)


class SetObservation(NamedTuple):
    """An observation of several intruders, numbers in [-1, 1]."""

    own: Array  # own speed, own heading, bearing and distance to the goal, [..., 4]
    traffic: Array
    """Speed, heading, bearing and distance of each intruder, ``[..., K, 4]``; 0 where there is
    none."""
    mask: Array  # which of the K exist, bool [..., K]


def observe_set(
    own: VehicleState[F],
    intruders: VehicleState[F],
    mask: Array,
    goal_x: Array,
    goal_y: Array,
    aircraft: Aircraft,
    xp: ArrayModule,
) -> SetObservation:
    """Return the observation of several intruders and the goal, scaled as by :func:`observe`;
    arrays only.

    The intruders are ``[..., K]``, their mask says which of them exist; the rest is ``[...]``.

    Raises:
        ValueError: the mask has another shape than the intruders.
    """
    if mask.shape != intruders.x.shape:
        raise ValueError(
            f"mask has shape {mask.shape}; expected {intruders.x.shape}, that of the intruders"
        )
    mine = _stack(_own_parts(own, goal_x, goal_y, aircraft, xp), xp)
    traffic = _stack(_traffic_parts(beside(own), intruders, beside(aircraft), xp), xp)
    return SetObservation(mine, xp.where(mask[..., None], traffic, 0.0), mask)


def beside(tree: T) -> T:
    """Return nested tuples of arrays ``[...]`` as ``[..., 1]``, to be set against intruders
    ``[..., K]``; floats stay.
    """
    return map_leaves(lambda field: field[..., None] if getattr(field, "ndim", 0) else field, tree)


def _own_parts(
    own: VehicleState[F], goal_x: Array, goal_y: Array, aircraft: Aircraft, xp: ArrayModule
) -> list[Array]:
    """Return own speed, own heading, bearing and distance to the goal, ``[...]`` each, scaled."""
    middle, half = _speeds(aircraft)
    return [
        (own.speed - middle) * (1.0 / half),
        own.heading * (1.0 / math.pi),
        bearing(own, goal_x, goal_y, xp) * (1.0 / math.pi),
        distance(goal_x - own.x, goal_y - own.y, xp) * (1.0 / _far(aircraft)) - 1.0,
    ]


def _traffic_parts(
    own: VehicleState[F], intruder: VehicleState[F], aircraft: Aircraft, xp: ArrayModule
) -> list[Array]:
    """Return an intruder's speed, heading, bearing and distance, ``[...]`` each, scaled."""
    return [
        intruder.speed * (1.0 / (0.5 * aircraft.traffic_speed_max)) - 1.0,
        intruder.heading * (1.0 / math.pi),
        bearing(own, intruder.x, intruder.y, xp) * (1.0 / math.pi),
        distance(intruder.x - own.x, intruder.y - own.y, xp) * (1.0 / _far(aircraft)) - 1.0,
    ]


def _stack(parts: list[Array], xp: ArrayModule) -> Array:
    """Return C parts ``[...]`` in one array ``[..., C]``, clipped to [-1, 1]."""
    return xp.stack([xp.clip(part, -1.0, 1.0) for part in parts], axis=-1)


def _speeds(aircraft: Aircraft) -> tuple[Array, Array]:
    """Return the own speed that is 0 in the observation, and how much faster 1 is, m/s."""
    low, high = aircraft.limits.speed_min, aircraft.limits.speed_max
    return 0.5 * (high + low), 0.5 * (high - low)


def _far(aircraft: Aircraft) -> Array:
    """Return the distance that is 0 in the observation, and how much farther 1 is, m."""
    return 10.0 * aircraft.separation


class Decoded(NamedTuple):
    """The geometry behind an observation in the ownship's frame, x ahead and y to the left; fields
    ``[...]``.
    """

    own_speed: Array  # m/s
    intruder_x: Array  # m
    intruder_y: Array
    intruder_vx: Array  # velocity over the ground, not relative to the ownship, m/s
    intruder_vy: Array
    goal_x: Array  # m
    goal_y: Array


def decode(observation: Sequence[Array], aircraft: Aircraft, xp: ArrayModule) -> Decoded:
    """Recover the geometry from an observation given as eight components ``[...]`` each.

    Exact but for what :func:`observe` clipped. Absolute headings enter only through their
    difference, so what is built on this does not change when the whole scene is rotated.
    """
    middle, half = _speeds(aircraft)
    far = _far(aircraft)
    own_speed = observation[0] * half + middle
    intruder_speed = (observation[2] + 1.0) * (0.5 * aircraft.traffic_speed_max)
    course = (observation[3] - observation[1]) * math.pi
    course = xp.where(course > math.pi, course - 2.0 * math.pi, course)
    course = xp.where(course < -math.pi, course + 2.0 * math.pi, course)
    sine, cosine = sincos(course, xp)
    intruder_sine, intruder_cosine = sincos(observation[4] * math.pi, xp)
    intruder_distance = (observation[5] + 1.0) * far
    goal_sine, goal_cosine = sincos(observation[6] * math.pi, xp)
    goal_distance = (observation[7] + 1.0) * far
    return Decoded(
        own_speed,
        intruder_distance * intruder_cosine,
        intruder_distance * intruder_sine,
        intruder_speed * cosine,
        intruder_speed * sine,
        goal_distance * goal_cosine,
        goal_distance * goal_sine,
    )


def criticality(
    own: VehicleState[F], intruders: VehicleState[F], aircraft: Aircraft, xp: ArrayModule
) -> Array:
    """Rank intruders by urgency, smallest first, ``[..., K]``.

    Both aircraft are taken to fly straight on. There are three cases:

    - the range will fall below 1.5 separations: the time until then, in tenths of the aircraft's
      time unit (s for the paper's);
    - it never will: 10^4 plus the distance at the closest approach, in thousandths of a separation;
    - it is below already: the distance at the closest approach less the 1.5 separations, in
      thousandths of a separation, which is negative.

    Ownship and aircraft are ``[..., 1]``, the intruders ``[..., K]``.
    """
    return criticality_of(own, intruders, aircraft.separation, aircraft.time_unit, xp)


@scalar
def criticality_of(
    own: VehicleState[F],
    intruders: VehicleState[F],
    separation: Array,
    time_unit: Array,
    xp: ArrayModule,
) -> Array:
    """Return :func:`criticality` for an aircraft's separation, m, and time unit, s."""
    return rank_motion(relative_motion(own, intruders, xp), separation, time_unit, xp)


@scalar
def rank_motion(
    motion: RelativeMotion, separation: Array, time_unit: Array, xp: ArrayModule
) -> Array:
    """Return :func:`criticality` of relative motions ``[..., K]``."""
    radius = 1.5 * separation
    length = 1_000.0 / separation
    cpa = cpa_of_motion(motion, xp)
    apart = distance(motion.x, motion.y, xp)
    # Along a straight relative course the squared range is d^2 + w^2 (t - t_cpa)^2 with w the
    # relative speed.
    travelled = xp.sqrt(xp.maximum(apart * apart - cpa.distance * cpa.distance, 1e-9))
    inside = xp.sqrt(xp.maximum(radius * radius - cpa.distance * cpa.distance, 0.0))
    time = xp.maximum(cpa.time * (1.0 - inside / travelled), 0.0) * (10.0 / time_unit)
    # Of several inside, the one that will come closest: with equal ranks their order would decide.
    conflict = xp.where(apart < radius, (cpa.distance - radius) * length, time)
    return xp.where(cpa.distance < radius, conflict, 10_000.0 + cpa.distance * length)


def most_critical(
    own: VehicleState[F], intruders: Vehicles, mask: Array, aircraft: Aircraft, xp: ArrayModule
) -> VehicleState[F]:
    """Return the most urgent of the intruders ``[..., K]`` that exist by the mask, ``[...]``.

    One that does not exist is chosen only where none does. Of plain floats all exist.
    """
    if isinstance(xp, FloatNamespace):
        if len(intruders) == 1:
            return intruders[0]
        return min(intruders, key=lambda intruder: criticality(own, intruder, aircraft, xp))
    if intruders.x.shape[-1] == 1:
        return VehicleState(*(field[..., 0] for field in intruders))
    rank = xp.where(mask, criticality(beside(own), intruders, beside(aircraft), xp), xp.inf)
    chosen = xp.argmin(rank, axis=-1)[..., None]
    return VehicleState(
        *(xp.take_along_axis(field, chosen, axis=-1)[..., 0] for field in intruders)
    )


def urgent(
    own: VehicleState[F],
    intruders: VehicleState[F],
    mask: Array,
    count: int,
    aircraft: Aircraft,
    xp: ArrayModule,
) -> Array:
    """Return the numbers of the ``count`` most urgent of the intruders ``[..., K]``, the most
    urgent first, ``[..., min(count, K)]``; those that do not exist come last.
    """
    rank = xp.where(mask, criticality(beside(own), intruders, beside(aircraft), xp), xp.inf)
    return xp.argsort(rank, axis=-1)[..., :count]


def rank_urgent(
    own: VehicleState[F],
    intruders: VehicleState[F],
    mask: Array,
    count: int,
    aircraft: Aircraft,
    xp: ArrayModule,
) -> tuple[VehicleState[F], Array]:
    """Return the ``count`` most urgent of the intruders ``[..., K]``, the most urgent first, and
    which of them exist, ``[..., count]`` each.

    Where K is smaller than ``count``, some that do not exist are added.
    """
    order = urgent(own, intruders, mask, count, aircraft, xp)
    missing = count - order.shape[-1]
    chosen_mask = xp.take_along_axis(mask, order, axis=-1)
    if missing > 0:
        order = xp.concatenate([order] + [order[..., :1]] * missing, axis=-1)
        chosen_mask = xp.concatenate(
            [chosen_mask] + [xp.zeros_like(chosen_mask[..., :1])] * missing, axis=-1
        )
    chosen: VehicleState[F] = VehicleState(
        *(xp.take_along_axis(field, order, axis=-1) for field in intruders)
    )
    return chosen, chosen_mask
