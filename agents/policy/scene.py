"""What a policy sees: the traffic and the goal in the ownship's frame, in the units in which all
aircraft are alike.

Lengths are in required separations D, speeds in the ownship's greatest speed, times in their
quotient (:mod:`envs.aircraft`); x points ahead and y to the left. Beyond 20 D only the direction
counts.

From an intruder with a separation of its own the distance counts in that: its *distance scale* is D
over its own separation. Places and velocities stay as they are; the inputs take the scale.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from envs.aircraft import Ratios, ratios
from envs.angles import sincos
from envs.arrays import Array, ArrayModule
from envs.compiled import scalar
from envs.frames import Air
from envs.kinematics import Limits, VehicleState
from envs.relative import distance

FARTHEST = 20.0
"""Greatest distance that is seen, D; what is farther is seen there, in its direction."""

NOWHERE = 1e3
"""Place of absent intruders, D, so that they are never the nearest."""


class Scene(NamedTuple):
    """The scene without dimension; fields ``[...]``, those of intruders ``[..., K]``."""

    own_speed: Array
    goal_x: Array
    goal_y: Array
    x: Array
    y: Array
    vx: Array  # velocity over the ground, not relative to the ownship
    vy: Array
    mask: Array  # bool
    ratios: Ratios  # of the ownship; floats or [...]
    # D over the separation of each intruder, [..., K]; None: 1 of all
    distance_scale: Array | None = None


def scene(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    mask: Array,
    goal_x: Array,
    goal_y: Array,
    limits: Limits,
    separation: Array,
    xp: ArrayModule,
) -> Scene:
    """Return the scene of states ``[...]`` and ``[..., K]`` in SI units; of absent intruders
    anything finite.

    Limits and required separation are floats or ``[...]``.
    """
    return as_seen(surroundings(own, intruders, mask, goal_x, goal_y, limits, separation, xp), xp)


def surroundings(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    mask: Array,
    goal_x: Array,
    goal_y: Array,
    limits: Limits,
    separation: Array,
    xp: ArrayModule,
) -> Scene:
    """Return a scene with everything where it is; arguments as of :func:`scene`."""
    length, speed = 1.0 / separation, 1.0 / limits.speed_max
    sine, cosine = sincos(own.heading, xp)
    ahead, left = _rotate((goal_x - own.x) * length, (goal_y - own.y) * length, cosine, sine)
    sine, cosine, length, speed = (
        xp.asarray(value)[..., None] for value in (sine, cosine, length, speed)
    )
    x, y = _rotate(
        (intruders.x - own.x[..., None]) * length,
        (intruders.y - own.y[..., None]) * length,
        cosine,
        sine,
    )
    course_sine, course_cosine = sincos(intruders.heading, xp)
    pace = intruders.speed * speed
    vx, vy = _rotate(pace * course_cosine, pace * course_sine, cosine, sine)
    return Scene(
        own_speed=own.speed * speed[..., 0],
        goal_x=ahead,
        goal_y=left,
        x=x,
        y=y,
        vx=vx,
        vy=vy,
        mask=mask,
        ratios=ratios(limits, separation),
    )


def as_seen(around: Scene, xp: ArrayModule) -> Scene:
    """Return surroundings as a policy sees them: what is farther than :data:`FARTHEST` is there, in
    its direction, and absent intruders are :data:`NOWHERE`.
    """
    goal_x, goal_y = _within_sight(around.goal_x, around.goal_y, xp)
    x, y = _within_sight(around.x, around.y, xp)
    return around._replace(
        goal_x=goal_x,
        goal_y=goal_y,
        x=xp.where(around.mask, x, NOWHERE),
        y=xp.where(around.mask, y, 0.0),
        vx=xp.where(around.mask, around.vx, 0.0),
        vy=xp.where(around.mask, around.vy, 0.0),
    )


@scalar
def _within_sight(x: Array, y: Array, xp: ArrayModule) -> tuple[Array, Array]:
    nearer = xp.minimum(1.0, FARTHEST / xp.maximum(distance(x, y, xp), 1e-6))
    return x * nearer, y * nearer


@scalar
def scalar_scene(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    goal_x: float,
    goal_y: float,
    limits: Limits,
    separation: float,
    xp: ArrayModule,
) -> Scene:
    """Return the scene of plain floats in SI units, of intruders fields ``[K]`` of those that
    exist, lists or arrays.
    """
    length, speed = 1.0 / separation, 1.0 / limits.speed_max
    sine, cosine = sincos(own.heading, xp)
    count = len(intruders.x)
    x, y, vx, vy = xp.row(count), xp.row(count), xp.row(count), xp.row(count)
    for k in range(count):
        x[k], y[k] = _place_in_scene(own, intruders.x[k], intruders.y[k], sine, cosine, length, xp)
        course_sine, course_cosine = sincos(intruders.heading[k], xp)
        pace = intruders.speed[k] * speed
        vx[k], vy[k] = _rotate(pace * course_cosine, pace * course_sine, cosine, sine)
    ahead, left = _place_in_scene(own, goal_x, goal_y, sine, cosine, length, xp)
    return Scene(
        own.speed * speed, ahead, left, x, y, vx, vy, True, ratios(limits, separation), None
    )


@scalar
def _place_in_scene(
    own: VehicleState[Air],
    x: float,
    y: float,
    sine: float,
    cosine: float,
    length: float,
    xp: ArrayModule,
) -> tuple[float, float]:
    """Return a place, m, as it is seen."""
    ahead, left = _rotate((x - own.x) * length, (y - own.y) * length, cosine, sine)
    return _within_sight(ahead, left, xp)


OWN_NUMBERS = 7
"""Own speed, the goal's x and y, and the four ratios."""


def width(most: int) -> int:
    """Return the length of a parity vector with so many places for intruders."""
    return OWN_NUMBERS + 5 * most


def unpack(own: Array, traffic: Array) -> Scene:
    """Return the scenes of rows ``[..., 7]`` and ``[..., K, 5]``, as a policy file's parity vectors
    hold them.

    The latter hold of each place for an intruder x, y, vx, vy and whether there is one, 1 or 0.
    """
    return Scene(
        own_speed=own[..., 0],
        goal_x=own[..., 1],
        goal_y=own[..., 2],
        x=traffic[..., 0],
        y=traffic[..., 1],
        vx=traffic[..., 2],
        vy=traffic[..., 3],
        mask=traffic[..., 4] > 0.5,
        ratios=Ratios(*(own[..., i] for i in range(3, OWN_NUMBERS))),
    )


def parts(rows: Array) -> tuple[Array, Array]:
    """Return what :func:`unpack` takes of parity vectors ``[..., 7 + 5 K]``."""
    return rows[..., :OWN_NUMBERS], rows[..., OWN_NUMBERS:].reshape(*rows.shape[:-1], -1, 5)


def unpack_rows(rows: Array) -> Scene:
    """Return the scenes of parity vectors ``[..., 7 + 5 K]``."""
    return unpack(*parts(rows))


def random_scenes(most: int, family: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Return random scenes as parity vectors, float32 ``[128, 7 + 5 most]``
    (:func:`unpack_rows`).

    They are random over the family, with none to all of the intruders, whose velocities differ from
    the ownship's.
    """
    random = np.random.default_rng(20)
    count = 128
    of_family = [random.uniform(*family[name], count) for name in Ratios._fields]
    speed = of_family[0] + (1.0 - of_family[0]) * random.random(count)
    goal, course = random.uniform(0.3, 18.0, count), random.uniform(-np.pi, np.pi, count)
    away = random.uniform(0.5, 12.0, (count, most))
    bearing, heading = random.uniform(-np.pi, np.pi, (2, count, most))
    pace = random.uniform(0.3, 1.4, (count, most))
    mask = random.random((count, most)) < random.random((count, 1))
    motions = [
        away * np.cos(bearing),
        away * np.sin(bearing),
        pace * np.cos(heading),
        pace * np.sin(heading),
    ]
    traffic = np.where(mask, motions, [[[NOWHERE]], [[0.0]], [[0.0]], [[0.0]]])
    rows = np.concatenate([traffic, mask[None]]).transpose(1, 2, 0).reshape(count, -1)
    own = np.stack([speed, goal * np.cos(course), goal * np.sin(course), *of_family], axis=-1)
    return np.concatenate([own, rows], axis=-1).astype(np.float32)


def mirror(scene: Scene, xp: ArrayModule) -> tuple[Scene, Array]:
    """Return the scene with most of the traffic left of the line to the goal, and the sign of its y
    axis, ``[...]``.

    A policy that decides on this scene, and turns by that sign, is exactly symmetric. Each intruder
    counts by how soon and how close it passes on straight courses; the line to the goal moves with
    positions alone, so that no turn changes the sign at once. Without traffic the goal is seen to
    the left.
    """
    towards = _towards(
        scene.x,
        scene.y,
        scene.vx,
        scene.vy,
        1.0 if scene.distance_scale is None else scene.distance_scale,
        scene.own_speed[..., None],
        (scene.goal_x[..., None], scene.goal_y[..., None]),
        xp,
    )
    total = xp.sum(xp.where(scene.mask, towards, 0.0), axis=-1)
    sign = xp.copysign(xp.ones_like(total), total + 1e-20 * scene.goal_y)
    signs = sign[..., None]
    return scene._replace(goal_y=scene.goal_y * sign, y=scene.y * signs, vy=scene.vy * signs), sign


@scalar
def scalar_mirror(scene: Scene, distance_scale: Array, xp: ArrayModule) -> tuple[Scene, float]:
    """Return :func:`mirror` of a scene of plain floats, whose lists or arrays it overwrites;
    distance scales ``[K]``.
    """
    goal, total = (scene.goal_x, scene.goal_y), 0.0
    for k in range(len(scene.x)):
        total += _towards(
            scene.x[k],
            scene.y[k],
            scene.vx[k],
            scene.vy[k],
            distance_scale[k],
            scene.own_speed,
            goal,
            xp,
        )
    sign = xp.copysign(1.0, total + 1e-20 * scene.goal_y)
    for k in range(len(scene.x)):
        scene.y[k] *= sign
        scene.vy[k] *= sign
    mirrored = Scene(
        scene.own_speed,
        scene.goal_x,
        scene.goal_y * sign,
        scene.x,
        scene.y,
        scene.vx,
        scene.vy,
        scene.mask,
        scene.ratios,
        scene.distance_scale,
    )
    return mirrored, sign


# What is on the line to the goal, to rounding, counts as left: two aircraft that are exact images
# of each other then turn to the same hand and pass.
_TIE = 1e-9


@scalar
def _towards(
    x: Array,
    y: Array,
    vx: Array,
    vy: Array,
    distance_scale: Array,
    pace: Array,
    goal: tuple[Array, Array],
    xp: ArrayModule,
) -> Array:
    """Return how much an intruder counts, positive to the left of the line to the goal, ``[...,
    K]``.
    """
    away = xp.maximum(distance(x, y, xp), 1e-3)
    relative_x, relative_y = vx - pace, vy
    square = relative_x * relative_x + relative_y * relative_y + 0.0025
    time = xp.clip(-(x * relative_x + y * relative_y) / square, 0.0, 30.0)
    closest_x, closest_y = (
        distance_scale * (x + relative_x * time),
        distance_scale * (y + relative_y * time),
    )
    weight = 1.0 / (
        (1.0 + 0.1 * time * time) * (1.0 + closest_x * closest_x + closest_y * closest_y)
    )
    goal_x, goal_y = goal
    return weight * ((goal_x * y - goal_y * x) / away + _TIE)


@scalar
def _rotate(x: Array, y: Array, cosine: Array, sine: Array) -> tuple[Array, Array]:
    """Return a vector in a frame turned to the left by an angle."""
    return x * cosine + y * sine, y * cosine - x * sine
