"""Encounters and their samplers: from unit-uniform draws to two or more aircraft in conflict.

A sampler is a pure function of draws, so that jax keys and a counter-based numpy generator feed the
same code. Courses differ clockwise as seen from above, as aviation counts them: an intruder of
course difference +90 degrees comes from the left.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from commands.command import InputError
from commands.extension import failure, is_extension
from commands.registry import Registry
from envs.aircraft import Aircraft
from envs.angles import sincos, wrap
from envs.arrays import Array, ArrayModule
from envs.frames import Air
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Coverage, Sensor
from envs.reaction import Reaction
from envs.relative import distance, straight_cpa
from envs.trees import choose, map_leaves
from envs.wind import Wind


class EncounterError(InputError):
    """An impossible encounter or scenario; the message says which and why."""


class Encounter(NamedTuple):
    """One or many starts, SI units; own fields ``[...]``, intruder fields ``[..., K]``."""

    own: VehicleState[Air]
    goal_x: Array  # m
    goal_y: Array
    intruders: VehicleState[Air]
    mask: Array  # which of the K intruders exist, bool [..., K]
    intent: Intent
    sensor: Sensor  # quality of the intruders' reports, [..., 1] each
    coverage: Coverage | None = None  # [..., K]; None: reports of all intruders at any time
    separation: Array | None = None
    """To be kept from each intruder, m, ``[..., K]``; None: the aircraft's, from all."""
    reaction: Reaction | None = None  # [..., K]; None: no intruder takes notice of the ownship
    wind: Wind | None = None
    """In which they are flown, ``[...]``, of evaluations alone. Places and goal are over the
    ground, headings and speeds through the air; only an intruder of speed 0 stands on the ground.
    None: still air, or the evaluation's wind."""
    areas: Array | None = None
    """Tuples of :class:`envs.areas.Area` over the ground, object ``[...]``, of evaluations alone;
    None: none of their own."""


MOST_INTRUDERS = 64
"""Most intruders of an encounter: far more than one ownship meets, and cheap to hold."""


def _no_changes(aircraft: Aircraft) -> Mapping[str, Any]:
    """Return the numbers in which a scenario differs from ``circle``: none."""
    return {}


class Sampler(NamedTuple):
    """How the encounters of a scenario are drawn: a row of the table of scenarios.

    A sampler of the user's own has the same form as those of :data:`SHIPPED`; it comes in by
    :mod:`envs.scenarios`. Functions of a module can be sent to other processes, lambdas cannot.
    """

    encounters: Callable[["Scenario", Array, ArrayModule], tuple[Encounter, Array]]
    """(scenario, draws ``[N, D]`` in [0, 1), numpy or jax.numpy) -> encounters ``[N]``, and which
    of them meet the scenario's conditions, bool ``[N]``. Each row follows from its own draws."""
    shared: int  # draws that an encounter takes
    each: int  # draws that each of its intruders takes besides
    numbers: Callable[[Aircraft], Mapping[str, Any]] = _no_changes
    """(ownship) -> the fields of :class:`Scenario` in which it differs from ``circle``."""


@dataclass(frozen=True)
class Scenario:
    """A sampler and its numbers, which say what it draws.

    Pairs (low, high) are ranges of a uniform draw; SI units. What the numbers mean is said as
    :func:`conflict_point` uses them, the geometry of the scenarios that ship; in a training for
    several aircraft, ranges of speeds are arrays, ``[N]`` of the ownship and ``[N, 1]`` of the
    intruders. :func:`scenario` makes them.
    """

    name: str
    sampler: Sampler
    aircraft: Aircraft  # the ownship; what a scenario does not state otherwise is scaled by it
    radius: tuple[float, float]
    """Distance of the ownship from the centre, m; the goal lies as far on the other side."""
    own_speed: tuple[float, float]  # m/s
    intruder_speed: tuple[float, float]  # m/s
    displacement: float
    """Each start is moved by up to this in x and in y, m; headings and goal stay."""
    min_initial_separation: float  # starts closer than this, m, are redrawn; 0 keeps them all
    course_difference: tuple[float, float] = (-math.pi, math.pi)
    """Intruder's course less own course, rad clockwise."""
    conflicts_closer_than: float = math.inf
    """Only starts whose straight courses pass closer than this, m, are kept."""
    intruders: tuple[int, int] = (1, 1)  # fewest and most intruders
    turn_rate: float = 0.0  # largest rate of each intruder's one turn, rad/s; 0: it flies straight
    heading_change: float = math.radians(120.0)  # largest heading change of that turn, rad
    position_std: float = 0.0  # noise of reported positions, one sigma per axis, m
    velocity_std: float = 0.0  # noise of reported velocities, one sigma per axis, m/s
    latency: tuple[float, float] = (0.0, 0.0)  # age of the reports, s
    attempts: int = 8  # how many draws an encounter has to meet the conditions

    @property
    def dimensions(self) -> int:
        """Unit-uniform draws that one attempt takes."""
        return self.sampler.shared + self.sampler.each * self.intruders[1]

    @property
    def ships(self) -> bool:
        """Whether the sampler is the toolkit's, not one of the user's own."""
        return self.sampler.encounters is conflict_point


def scenario(name: str, aircraft: Aircraft, **changes: Any) -> Scenario:
    """Return a scenario by its name, scaled by the aircraft, with some of its fields changed.

    Lengths are in separations, speeds in ``speed_max``, latencies in time steps; for the paper's
    aircraft the numbers are the paper's.

    Raises:
        EncounterError: the name is unknown, or a field contradicts the aircraft; the message begins
            with the field.
    """
    sampler = sampler_of(name)
    separation, limits = aircraft.separation, aircraft.limits
    # An aircraft that can stand still would never arrive at the conflict point.
    speeds = (max(limits.speed_min, 0.2 * limits.speed_max), limits.speed_max)
    circle = Scenario(
        name,
        sampler,
        aircraft,
        radius=(3.0 * separation, 10.0 * separation),
        own_speed=speeds,
        intruder_speed=speeds,
        displacement=0.5 * separation,
        min_initial_separation=separation,
    )
    chosen = replace(circle, **{**sampler.numbers(aircraft), **changes})
    _check(chosen)
    return chosen


def sampler_of(name: str) -> Sampler:
    """Return the sampler of a scenario that ships or has been registered; nothing is imported.

    Raises:
        EncounterError: there is none of that name.
    """
    if name not in SAMPLERS and is_extension(name):
        raise EncounterError(
            f"scenario {name!r} is not part of the toolkit and has not been loaded; expected "
            f"--extension {name}, the key extensions: [{name}], or envs.scenarios.resolve({name!r})"
        )
    return SAMPLERS.find(name)


def _check(chosen: Scenario) -> None:
    """Refuse a scenario with a field that contradicts its aircraft."""
    aircraft, limits = chosen.aircraft, chosen.aircraft.limits
    whole = 2.0 * math.pi
    speeds = "the speeds of the aircraft"
    for name, low, high, why in (
        ("radius", 0.1 * aircraft.separation, 1e3 * aircraft.separation, "0.1 to 1000 separations"),
        ("own_speed", limits.speed_min, limits.speed_max, speeds),
        ("intruder_speed", 0.0, aircraft.traffic_speed_max, "the speeds of its traffic"),
        ("course_difference", -whole, whole, "radians"),
        ("intruders", 1, MOST_INTRUDERS, "that an encounter can have"),
        ("latency", 0.0, 2.0 * aircraft.dt, "two time steps of the aircraft"),
    ):
        first, last = getattr(chosen, name)
        if not low <= first <= last <= high:
            raise EncounterError(
                f"{name} is [{first:g}, {last:g}]; expected [low, high] within {low:g} to "
                f"{high:g}, {why}"
            )
    if not chosen.own_speed[0] > 0.0:
        raise EncounterError(
            f"own_speed begins at {chosen.own_speed[0]:g} m/s; expected a number above 0"
        )
    for name, high in (
        ("displacement", math.inf),
        ("min_initial_separation", math.inf),
        ("conflicts_closer_than", math.inf),
        ("turn_rate", 1.0 / aircraft.dt),
        ("heading_change", math.pi),
        ("position_std", math.inf),
        ("velocity_std", math.inf),
    ):
        value = getattr(chosen, name)
        if not 0.0 <= value <= high:
            expected = f"0 to {high:g}" if math.isfinite(high) else "a number at least 0"
            raise EncounterError(f"{name} is {value:g}; expected {expected}")


def sample(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` from draws ``[A, N, D]`` in [0, 1), D = ``scenario.dimensions``,
    and which of them meet the scenario's conditions, ``[N]``.

    Each takes the first of A attempts that meets them, else its last.
    """
    encounter, accepted = attempt(scenario, draws[0], xp)
    for number in range(1, draws.shape[0]):
        if xp.__name__ == "numpy" and accepted.all():
            break
        other, other_accepted = attempt(scenario, draws[number], xp)
        encounter = choose(accepted, encounter, other, xp)
        accepted = xp.logical_or(accepted, other_accepted)
    return encounter, accepted


def pad(encounter: Encounter, count: int, xp: ArrayModule) -> Encounter:
    """Return encounters ``[N]`` with intruders that do not exist added up to ``count`` of them."""
    places = encounter.mask.shape[-1]
    if count <= places:
        return encounter

    def more(field: Array) -> Array:
        return xp.concatenate([field] + [field[..., :1]] * (count - places), axis=-1)

    intruders, intent, mask = map_leaves(
        more, (encounter.intruders, encounter.intent, encounter.mask)
    )
    return encounter._replace(
        intruders=intruders,
        intent=intent,
        mask=mask & (xp.arange(count) < places),
        coverage=map_leaves(more, encounter.coverage),
        separation=map_leaves(more, encounter.separation),
        reaction=map_leaves(more, encounter.reaction),
    )


def attempt(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return the encounters of one attempt, draws ``[N, D]``, and which of them meet the
    conditions, ``[N]``.

    Raises:
        EncounterError: a sampler of the user's own fails, or returns something else.
    """
    if scenario.ships:
        return scenario.sampler.encounters(scenario, draws, xp)
    try:
        made = scenario.sampler.encounters(scenario, draws, xp)
    except EncounterError:
        raise
    except Exception as problem:
        raise EncounterError(
            f"scenario {scenario.name!r}: its sampler {failure(problem)}"
        ) from problem
    _check_shapes(scenario, made, draws.shape[0])
    if xp.__name__ != "numpy" and not (made[0].wind is None and made[0].areas is None):
        raise EncounterError(
            f"scenario {scenario.name!r} has a wind or areas of its own; expected an evaluation "
            "that heeds them (eval.monte_carlo)"
        )
    return made


def _check_shapes(scenario: Scenario, made: object, count: int) -> None:
    """Refuse what a sampler returned unless it is encounters ``[count]`` and a mask of them."""
    where = f"scenario {scenario.name!r}: its sampler returns"
    if not (isinstance(made, tuple) and len(made) == 2 and isinstance(made[0], Encounter)):
        raise EncounterError(
            f"{where} {type(made).__name__}; expected an envs.encounters.Encounter and which of "
            "its rows are accepted"
        )
    encounter, accepted = made
    wide = (count, scenario.intruders[1])
    for name in ("own", "goal_x", "goal_y"):
        _check_shape(f"{where} {name}", getattr(encounter, name), (count,))
    _check_shape(f"{where} accepted", accepted, (count,))
    for name in ("intruders", "mask", "intent"):
        _check_shape(f"{where} {name}", getattr(encounter, name), wide)
    _check_shape(f"{where} sensor", encounter.sensor, (count, 1))
    for name in ("coverage", "separation", "reaction"):
        if getattr(encounter, name) is not None:
            _check_shape(f"{where} {name}", getattr(encounter, name), wide)
    for name in ("wind", "areas"):
        if getattr(encounter, name) is not None:
            _check_shape(f"{where} {name}", getattr(encounter, name), (count,))


def _check_shape(where: str, tree: Any, expected: tuple[int, ...]) -> None:
    """Refuse an array, or a named tuple of arrays, of another shape."""
    if hasattr(tree, "_fields"):
        for name, field in tree._asdict().items():
            _check_shape(f"{where}.{name}", field, expected)
        return
    shape = getattr(tree, "shape", type(tree).__name__)
    if shape != expected:
        raise EncounterError(f"{where} of shape {shape}; expected {expected}")


class _Draws(NamedTuple):
    """Draws of :func:`conflict_point` for encounters ``[N]``."""

    radius: Array
    course: Array
    speed: Array
    shift_x: Array
    shift_y: Array
    count: Array  # of the intruders
    age: Array  # of the reports


class _DrawsOfEach(NamedTuple):
    """Draws of :func:`conflict_point` for their intruders ``[N, K]``."""

    course: Array
    speed: Array
    shift_x: Array
    shift_y: Array
    turn_rate: Array
    onset: Array
    heading_change: Array


def columns(draws: Array, first: int, most: int, count: int) -> list[Array]:
    """Return so many draws of each intruder, ``[N, K]`` each for K = ``most``, from draws
    ``[N, D]``, in which they stand from the column ``first`` on.
    """
    return [draws[:, first + i * most : first + (i + 1) * most] for i in range(count)]


def conflict_point(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` around a common conflict point (the paper's "circle" and variants
    of it), from draws ``[N, 7 + 7 K]``, and which of them meet the conditions, ``[N]``.

    Ownship and intruders start so far from the centre that they would meet there at the same time;
    then every start is displaced.
    """
    fewest, most = scenario.intruders
    shared = _Draws(*(draws[:, i] for i in range(7)))
    each = _DrawsOfEach(*columns(draws, 7, most, 7))

    radius = between(scenario.radius, shared.radius)
    course = between((-math.pi, math.pi), shared.course)
    speed = between(scenario.own_speed, shared.speed)
    sine, cosine = sincos(course, xp)
    goal_x, goal_y = radius * cosine, radius * sine
    shift = (-scenario.displacement, scenario.displacement)
    own: VehicleState[Air] = VehicleState(
        between(shift, shared.shift_x) - goal_x,
        between(shift, shared.shift_y) - goal_y,
        course,
        speed,
    )

    intruder_course = wrap(course[:, None] - between(scenario.course_difference, each.course), xp)
    intruder_speed = between(scenario.intruder_speed, each.speed)
    sine, cosine = sincos(intruder_course, xp)
    back = (radius / speed)[:, None] * intruder_speed
    intruders: VehicleState[Air] = VehicleState(
        between(shift, each.shift_x) - back * cosine,
        between(shift, each.shift_y) - back * sine,
        intruder_course,
        intruder_speed,
    )
    count = fewest + xp.floor(shared.count * (most - fewest + 1))
    mask = xp.arange(most)[None, :] < count[:, None]

    to_turn = each.turn_rate, each.onset, each.heading_change
    intent = one_turn(scenario, own, intruders, to_turn, xp)
    sensor = sensor_of(scenario, shared.age, xp)
    accepted = meets_conditions(scenario, own, intruders, mask, xp)
    return Encounter(own, goal_x, goal_y, intruders, mask, intent, sensor), accepted


def one_turn(
    scenario: Scenario,
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    draws: Sequence[Array],
    xp: ArrayModule,
) -> Intent:
    """Return the one turn of each intruder ``[N, K]``, which begins at the latest a little after
    its closest approach to the ownship ``[N]``.

    Rate and change of heading are at most the scenario's; where its rate is 0 they fly straight.
    The draws, ``[N, K]`` each, are of the rate, the onset and the change.
    """
    to_rate, to_onset, to_change = draws
    seen_by: VehicleState[Air] = VehicleState(*(field[:, None] for field in own))
    cpa = straight_cpa(seen_by, intruders, xp)
    signed_rate = between((-scenario.turn_rate, scenario.turn_rate), to_rate)
    turn_rate = xp.abs(signed_rate)
    greatest_change = scenario.heading_change
    if not scenario.turn_rate:
        turn_rate = xp.full_like(signed_rate, scenario.aircraft.limits.yaw_rate_max)
        greatest_change = 0.0
    return Intent(
        onset=1.2 * cpa.time * to_onset,
        heading_change=xp.copysign(greatest_change * to_change, signed_rate),
        turn_rate=turn_rate,
    )


def no_turn(scenario: Scenario, intruders: VehicleState[Air], xp: ArrayModule) -> Intent:
    """Return the intent of intruders ``[N, K]`` that fly straight on."""
    never = xp.zeros_like(intruders.speed)
    return Intent(never, never, never + scenario.aircraft.limits.yaw_rate_max)


def sensor_of(scenario: Scenario, draw: Array, xp: ArrayModule) -> Sensor:
    """Return the scenario's quality of reports, ``[N, 1]``; the draw ``[N]`` is of their age."""
    ones = xp.ones_like(draw)[:, None]
    return Sensor(
        scenario.position_std * ones,
        scenario.velocity_std * ones,
        between(scenario.latency, draw)[:, None],
    )


def meets_conditions(
    scenario: Scenario,
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    mask: Array,
    xp: ArrayModule,
) -> Array:
    """Return which starts ``[N]`` are far enough apart and, on straight courses, close enough
    later, for every intruder ``[N, K]`` that exists.
    """
    seen_by: VehicleState[Air] = VehicleState(*(field[:, None] for field in own))
    cpa = straight_cpa(seen_by, intruders, xp)
    apart = distance(intruders.x - seen_by.x, intruders.y - seen_by.y, xp)
    meets = xp.logical_and(
        apart >= scenario.min_initial_separation, cpa.distance < scenario.conflicts_closer_than
    )
    return xp.all(xp.logical_or(meets, xp.logical_not(mask)), axis=-1)


def between(bounds: tuple[float, float], draw: Array) -> Array:
    """Return what unit-uniform draws ``[...]`` are in a range."""
    low, high = bounds
    return low + (high - low) * draw


class _Conflicts(NamedTuple):
    """Starts whose straight courses lose the separation, with courses that differ by about an
    angle.
    """

    middle_deg: float
    half_width_deg: float

    def __call__(self, aircraft: Aircraft) -> Mapping[str, Any]:
        low, high = self.middle_deg - self.half_width_deg, self.middle_deg + self.half_width_deg
        return {
            "course_difference": (math.radians(low), math.radians(high)),
            "conflicts_closer_than": aircraft.separation,
            "attempts": 48,
        }


def _turning(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"turn_rate": aircraft.limits.yaw_rate_max}


def _noise_and_latency(aircraft: Aircraft) -> Mapping[str, Any]:
    return {
        "position_std": 0.03 * aircraft.separation,
        "velocity_std": 0.03 * aircraft.limits.speed_max,
        "latency": (aircraft.dt, 2.0 * aircraft.dt),
    }


def _several(aircraft: Aircraft) -> Mapping[str, Any]:
    return {"intruders": (2, 8), "attempts": 24}


def _around(numbers: Callable[[Aircraft], Mapping[str, Any]] = _no_changes) -> Sampler:
    return Sampler(conflict_point, 7, 7, numbers)


SHIPPED: dict[str, Sampler] = {
    "circle": _around(),
    "crossing_left": _around(_Conflicts(90.0, 45.0)),
    "crossing_right": _around(_Conflicts(-90.0, 45.0)),
    "head_on": _around(_Conflicts(180.0, 20.0)),
    "same_course": _around(_Conflicts(0.0, 20.0)),
    "maneuvering": _around(_turning),
    "noisy": _around(_noise_and_latency),
    "multi": _around(_several),
}
"""The scenarios that ship, by name."""

SCENARIOS = tuple(SHIPPED)
"""Their names."""


def _check_sampler(name: str, sampler: Sampler) -> None:
    for key in ("shared", "each"):
        count: object = getattr(sampler, key)
        if not isinstance(count, int) or count < 0:
            raise EncounterError(
                f"scenario {name!r}: {key} is {count!r}; expected how many draws it takes"
            )


SAMPLERS: Registry[Sampler] = Registry(
    "scenario",
    "a scenario (envs.encounters.Sampler)",
    Sampler,
    EncounterError,
    SHIPPED,
    _check_sampler,
)
"""The samplers of all scenarios that this process knows, by name; the user's own come in by
:mod:`envs.scenarios`."""
