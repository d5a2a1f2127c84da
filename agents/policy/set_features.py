"""Inputs of the network for any number of intruders: one vector for the ownship, one for each
intruder.

They are derived from the scene inside the network's own forward pass, for jax and numpy alike, and
do not change with the order of the intruders, nor with absent ones. :data:`BUILT_IN` is the table
of the toolkit's own; :func:`table` adds the user's (:mod:`agents.policy.inputs`).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from agents.policy import candidate_manoeuvres
from agents.policy.inputs import INTRUDER, OWNSHIP, Input, Number, check_input, evaluate_input
from agents.policy.scene import NOWHERE, Scene, mirror
from commands.command import InputError
from envs.arrays import Array, ArrayModule
from envs.backend import FLOATS
from envs.compiled import scalar
from envs.relative import distance

SEPARATION_UNIT = 0.03
"""Resolution of the separation of candidate manoeuvres beyond the required one, D."""

ALIKE = 0.05
"""Between separations of candidate manoeuvres, squashed: 1.5 thousandths of D near the required
one.
"""


class PassingUnits(NamedTuple):
    """What :func:`passing` scales and softens by."""

    slow: float  # square of the speed that softens
    horizon: float  # how far ahead is looked
    per_time: float  # a time is scaled by
    per_length: Array  # a length
    per_far: Array  # a length far away
    floor: float  # square of the range that softens


# for lengths in D and speeds in the greatest
_UNITS = PassingUnits(
    slow=0.0025, horizon=30.0, per_time=1.0 / 6.0, per_length=1.0, per_far=0.2, floor=0.0
)


class SetInputs(NamedTuple):
    """Inputs of the network's first layers."""

    own: Array  # [..., F]
    traffic: Array  # [..., K, E]; of absent intruders anything finite
    mask: Array  # bool [..., K]
    # factor of the network's yaw rate, -1 where the scene is seen mirrored, [...]
    mirror_sign: Array


class InputTable(NamedTuple):
    """All inputs of a network, in the order of its first layers."""

    ownship: tuple[Input, ...]
    intruder: tuple[Input, ...]

    @property
    def own_size(self) -> int:
        """How many numbers describe the ownship."""
        return len(self.own_numbers)

    @property
    def intruder_size(self) -> int:
        """How many numbers describe an intruder."""
        return len(self.intruder_numbers)

    @property
    def own_numbers(self) -> tuple[Number, ...]:
        """The numbers that describe the ownship."""
        return tuple(number for entry in self.ownship for number in entry.numbers)

    @property
    def intruder_numbers(self) -> tuple[Number, ...]:
        """The numbers that describe an intruder."""
        return tuple(number for entry in self.intruder for number in entry.numbers)

    @property
    def extra(self) -> tuple[Input, ...]:
        """The inputs that are the user's own."""
        own = {entry.name for entry in BUILT_IN}
        return tuple(entry for entry in (*self.ownship, *self.intruder) if entry.name not in own)


def table(extra: Iterable[Input] = ()) -> InputTable:
    """Return the table of the toolkit's inputs and, after them, the user's own.

    Raises:
        InputError: two have one name, or one cannot be used.
    """
    extra = tuple(extra)
    for entry in extra:
        check_input(entry)
    rows = (*BUILT_IN, *extra)
    names = [entry.name for entry in rows]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"input {name!r} stands twice; expected different names")
    return InputTable(
        tuple(entry for entry in rows if entry.of == OWNSHIP),
        tuple(entry for entry in rows if entry.of == INTRUDER),
    )


def set_inputs(scene: Scene, xp: ArrayModule, inputs: InputTable | None = None) -> SetInputs:
    """Return the inputs for scenes ``[...]``, not mirrored, with K >= 1 intruders' places; without
    a table the toolkit's own, all within about [-3, 3].
    """
    inputs = TABLE if inputs is None else inputs
    if scene.distance_scale is not None:  # of absent intruders it must not count
        scene = scene._replace(distance_scale=xp.where(scene.mask, scene.distance_scale, 1.0))
    scene, sign = mirror(scene, xp)
    return SetInputs(
        _side_by_side(inputs.ownship, scene, xp),
        _side_by_side(inputs.intruder, scene, xp),
        scene.mask,
        sign,
    )


def _side_by_side(rows: tuple[Input, ...], scene: Scene, xp: ArrayModule) -> Array:
    """Return the values of inputs one after the other, along the last axis."""
    parts = [evaluate_input(entry, scene, xp) for entry in rows]
    return parts[0] if len(parts) == 1 else xp.concatenate(parts, axis=-1)


def _ownship(scene: Scene, xp: ArrayModule) -> Array:
    """Return the toolkit's inputs of the ownship for mirrored scenes, ``[..., 37]``."""
    # Manoeuvres along the last axis: there numpy adds up a row in the same order whatever the
    # number of rows.
    separation = xp.stack(list(candidate_manoeuvres.min_separation(scene, xp)), axis=-1)
    margin = margin_of(separation, xp)  # [..., 22]
    own = own_part(scene, xp.zeros_like(scene.own_speed), xp)
    best = _best(margin, candidate_manoeuvres.steering(scene, xp), xp)
    return xp.concatenate([xp.stack([*own, *best], axis=-1), margin], axis=-1)


def _intruder(scene: Scene, xp: ArrayModule) -> Array:
    """Return the toolkit's inputs of intruders for mirrored scenes, ``[..., K, 16]``."""
    cosine, sine = course_to_goal(scene, xp)
    numbers = intruder_part(
        scene.x,
        scene.y,
        scene.vx,
        scene.vy,
        scene.distance_scale,
        scene.own_speed[..., None],
        (cosine[..., None], sine[..., None]),
        xp,
    )
    return xp.stack(numbers, axis=-1)


def _passing_numbers(course: str) -> tuple[Number, ...]:
    """Return the numbers of :func:`passing` for a course."""
    return (
        Number(f"time to closest approach{course}", "1", -1.0, 1.0),
        Number(f"miss distance{course}", "1", -1.0, 1.0),
        Number(f"miss distance from afar{course}", "5 D", -1.0, 1.0),
        Number(f"depth of the conflict{course}", "D", -1.0, 1.5),
    )


_FLIGHT_NUMBERS = (
    Number("own speed in its range", "1", -1.0, 1.0),
    Number("own speed", "V", 0.0, 1.0),
    Number("goal ahead", "1", -1.0, 1.0),
    Number("goal to the side", "1", -1.0, 1.0),
    Number("goal distance", "10 D", -1.0, 1.0),
    Number("goal nearness", "1", 0.0, 1.0),
    Number("goal outside the left turning circle", "1", -1.0, 1.0),
    Number("goal outside the right turning circle", "1", -1.0, 1.0),
    Number("least speed", "V/4", -2.0, 2.0),
    Number("deceleration", "1", -1.0, 0.0),
    Number("acceleration", "1", 0.0, 1.0),
    Number("turn radius", "1", 0.0, 1.0),
)
_MANOEUVRE_NUMBERS = (
    Number("separation that the best manoeuvre keeps", "1", -1.0, 1.0),
    Number("its acceleration", "1", -1.0, 1.0),
    Number("its turn", "1", -1.0, 1.0),
    *(
        Number(f"separation that manoeuvre {number} keeps", "1", -1.0, 1.0)
        for number in range(candidate_manoeuvres.COUNT)
    ),
)
_INTRUDER_NUMBERS = (
    Number("intruder ahead", "1", -1.0, 1.0),
    Number("intruder to the side", "1", -1.0, 1.0),
    Number("intruder distance", "10 D", -1.0, 1.0),
    Number("intruder nearness", "1", -1.0, 1.0),
    Number("intruder velocity ahead", "V", -2.0, 2.0),
    Number("intruder velocity to the side", "V", -2.0, 2.0),
    Number("relative velocity ahead", "V", -3.0, 3.0),
    Number("range rate", "V", -3.0, 3.0),
    *_passing_numbers(""),
    *_passing_numbers(" on the course to the goal"),
)

BUILT_IN = (
    # One row: the separations of the candidate manoeuvres are computed once for all that uses them.
    Input("ownship", OWNSHIP, (*_FLIGHT_NUMBERS, *_MANOEUVRE_NUMBERS), _ownship),
    Input("intruder", INTRUDER, _INTRUDER_NUMBERS, _intruder),
)
"""The toolkit's own inputs; unit "1" also marks what is squashed to (-1, 1) (:func:`soft`)."""


def scalar_set_inputs(
    scene: Scene, distance_scale: Sequence[float], separation: np.ndarray, inputs: InputTable
) -> tuple[list[float], list[list[float]]]:
    """Return the inputs for one mirrored scene of plain floats: for the ownship, and a list for
    each intruder present, whose distance scales are ``[K]``.

    ``separation`` is what :func:`agents.policy.candidate_manoeuvres.min_separation` gives of the
    scene, ``[22]``. The user's own inputs are computed on arrays of one scene.
    """
    margin = margin_of(separation, np)
    best = _best(margin, candidate_manoeuvres.scalar_turns(scene), np)
    own = [*own_part(scene, 0.0, FLOATS), *map(float, best), *margin.tolist()]
    course = course_to_goal(scene, FLOATS)
    intruders = zip(scene.x, scene.y, scene.vx, scene.vy, distance_scale, strict=True)
    traffic = [list(intruder_part(*state, scene.own_speed, course, FLOATS)) for state in intruders]
    if inputs is not TABLE:
        batch = scene_arrays(scene)
        for row in inputs.extra:
            values = evaluate_input(row, batch, np)[0]
            if row.of == OWNSHIP:
                own += values.tolist()
            else:
                traffic = [
                    [*numbers, *more]
                    for numbers, more in zip(traffic, values.tolist(), strict=False)
                ]
    return own, traffic


def scene_arrays(scene: Scene) -> Scene:
    """Return a scene of plain floats as one of arrays ``[1]`` and ``[1, K]``, with one absent
    intruder where there is none.
    """
    scene = scene._replace(mask=[True] * len(scene.x))
    if not scene.x:
        scene = scene._replace(
            x=[NOWHERE], y=[0.0], vx=[0.0], vy=[0.0], mask=[False], distance_scale=None
        )
    return Scene(
        own_speed=np.array([scene.own_speed]),
        goal_x=np.array([scene.goal_x]),
        goal_y=np.array([scene.goal_y]),
        x=np.array([scene.x]),
        y=np.array([scene.y]),
        vx=np.array([scene.vx]),
        vy=np.array([scene.vy]),
        mask=np.array([scene.mask]),
        ratios=scene.ratios,
        distance_scale=None if scene.distance_scale is None else np.array([scene.distance_scale]),
    )


@scalar
def own_part(scene: Scene, zero: Array, xp: ArrayModule) -> tuple[Array, ...]:
    """Return what describes the ownship, its goal and its limits, 12 times ``[...]``; ``zero`` has
    that shape.
    """
    to_goal = distance(scene.goal_x, scene.goal_y, xp) + 1e-6
    speed, ratios = scene.own_speed, scene.ratios
    radius = speed * ratios.turn_radius
    # Of the turning circles.
    outside_left = distance(scene.goal_x, scene.goal_y - radius, xp) - radius
    outside_right = distance(scene.goal_x, scene.goal_y + radius, xp) - radius
    return (
        (2.0 * speed - 1.0 - ratios.speed_min) / (1.0 - ratios.speed_min),
        speed,
        scene.goal_x / to_goal,
        scene.goal_y / to_goal,
        to_goal * 0.1 - 1.0,
        soft(to_goal, xp),
        soft(2.0 * outside_left, xp),
        soft(2.0 * outside_right, xp),
        zero + 4.0 * (ratios.speed_min - 0.5),
        zero + soft(10.0 * ratios.acceleration_min, xp),
        zero + soft(10.0 * ratios.acceleration_max, xp),
        zero + soft(ratios.turn_radius, xp),
    )


@scalar
def course_to_goal(scene: Scene, xp: ArrayModule) -> tuple[Array, Array]:
    """Return the cosine and sine of the goal's direction, ``[...]`` each."""
    to_goal = distance(scene.goal_x, scene.goal_y, xp) + 1e-6
    return scene.goal_x / to_goal, scene.goal_y / to_goal


@scalar
def intruder_part(
    x: Array,
    y: Array,
    vx: Array,
    vy: Array,
    distance_scale: Array,
    pace: Array,
    course: tuple[Array, Array],
    xp: ArrayModule,
) -> tuple[Array, ...]:
    """Return what describes an intruder, 16 times ``[..., K]``, beside own speed and the cosine and
    sine of the goal's direction.

    Distances to it and miss distances are in its own separation, times and velocities as they are.
    """
    away = distance(x, y, xp) + 1e-6
    relative, (cosine, sine) = vx - pace, course
    counted, units = (
        (away, _UNITS)
        if distance_scale is None
        else (away * distance_scale, _scaled_units(distance_scale))
    )
    flown = (
        x / away,
        y / away,
        xp.minimum(counted * 0.1 - 1.0, 1.0),
        soft(counted - 1.0, xp),
        vx,
        vy,
        relative,
        (x * relative + y * vy) / away,
    )
    # The same for the course that leads straight to the goal: is it time to turn back?
    home_x, home_y = vx - pace * cosine, vy - pace * sine
    return flown + passing(x, y, relative, vy, units, xp) + passing(x, y, home_x, home_y, units, xp)


@scalar
def _scaled_units(distance_scale: Array) -> PassingUnits:
    """Return the units of :func:`passing` for an intruder with a separation of its own."""
    # Not by _replace, which takes three times as long: it is asked at every step of a flight.
    slow, horizon, per_time, per_length, per_far, floor = _UNITS
    return PassingUnits(
        slow, horizon, per_time, per_length * distance_scale, per_far * distance_scale, floor
    )


@scalar
def margin_of(separation: Array, xp: ArrayModule) -> Array:
    """Return how far manoeuvres stay beyond the required separation, squashed."""
    return soft((separation - 1.0) * (1.0 / SEPARATION_UNIT), xp)


def _best(margin: Array, steering: Array, xp: ArrayModule) -> tuple[Array, Array, Array]:
    """Return the margin of the best manoeuvre, and how it accelerates and turns, 1 at the limit;
    ``[...]`` each.

    Of manoeuvres that keep nearly as much it is the mean of what they do, so that nothing hangs on
    rounding.
    """
    most = margin.max(axis=-1)
    behind = (most[..., None] - margin) * (1.0 / ALIKE)
    weight = 1.0 / (1.0 + behind * behind)
    whole = weight.sum(axis=-1)
    throttles = xp.asarray(candidate_manoeuvres.THROTTLES.astype(most.dtype, copy=False))
    return (
        most,
        (weight * throttles).sum(axis=-1) / whole,
        (weight * steering).sum(axis=-1) / whole,
    )


@scalar
def passing(
    x: Array, y: Array, vx: Array, vy: Array, units: PassingUnits, xp: ArrayModule
) -> tuple[Array, Array, Array, Array]:
    """Describe how an aircraft at (x, y) with relative velocity (vx, vy) passes on a straight
    course.

    Returns the time to the closest approach, the signed miss distance at two scales (left positive)
    and how deep the separation is entered ahead. Slow relative speeds are softened: there the
    quotients would amplify the rounding of float32.

    All ``[...]``; lengths and times in units that ``units`` are for.
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


@scalar
def soft(value: Array, xp: ArrayModule) -> Array:
    """Return a value squashed to (-1, 1)."""
    return value / (1.0 + xp.abs(value))


TABLE = table()
"""The table without inputs of the user's own."""
