"""Encounters, and what a scenario draws them with: a sampler and modifiers, from unit-uniform draws
to two or more aircraft in conflict.

Samplers and modifiers are pure functions of draws, so that jax keys and a counter-based numpy
generator feed the same code. Courses differ clockwise as seen from above, as aviation counts them:
an intruder of course difference +90 degrees comes from the left. Those that ship, and their names,
are in :mod:`envs.scenarios`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from commands.command import InputError
from envs.aircraft import Aircraft
from envs.altitudes import Altitudes
from envs.arrays import Array, ArrayModule
from envs.frames import Air
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Coverage, Sensor
from envs.reaction import Reaction
from envs.relative import distance, straight_cpa
from envs.trees import map_leaves
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
    altitudes: Altitudes | None = None
    """Of ownship and intruders, of evaluations alone; None: all are at one level."""


MOST_INTRUDERS = 64
"""Most intruders of an encounter: far more than one ownship meets, and cheap to hold."""


def _no_changes(aircraft: Aircraft) -> Mapping[str, Any]:
    """Return the numbers in which a scenario differs from ``circle``: none."""
    return {}


class Sampler(NamedTuple):
    """How the encounters of a scenario are drawn: a row of the table of scenarios.

    A sampler of the user's own has the same form as those of :data:`envs.scenarios.SHIPPED`; it
    comes in by :func:`envs.scenarios.register` or by its name. Functions of a module can be sent to
    other processes, lambdas cannot.
    """

    encounters: Callable[["Scenario", Array, ArrayModule], tuple[Encounter, Array]]
    """(scenario, draws ``[N, D]`` in [0, 1), numpy or jax.numpy) -> encounters ``[N]``, and which
    of them meet the scenario's conditions, bool ``[N]``. Each row follows from its own draws."""
    shared: int  # draws that an encounter takes
    per_intruder: int  # draws that each of its intruders takes besides
    numbers: Callable[[Aircraft], Mapping[str, Any]] = _no_changes
    """(ownship) -> the fields of :class:`Scenario` in which it differs from ``circle``."""
    modifiers: tuple[str, ...] = ()
    """Names of the modifiers that its encounters always have."""
    together: bool = False
    """Whether they draw from the stream of the starts, as scenarios did that are older than
    modifiers."""


def _unchanged(
    scenario: "Scenario", encounter: Encounter, draws: Array, xp: ArrayModule
) -> tuple[Encounter, Array]:
    """Return the encounters ``[N]`` as they are; all of them meet the conditions."""
    return encounter, xp.ones(encounter.goal_x.shape, dtype=bool)


class Modifier(NamedTuple):
    """A change of the encounters that any sampler draws: a row of the table of modifiers.

    It has draws of its own, and what is drawn of the other parts of a scenario does not depend on
    it. Either it changes encounters, or its numbers are heeded by the sampler.
    """

    name: str
    decides: tuple[str, ...] = ()
    """In words, such as ``how intruders turn``: only one modifier of a scenario may."""
    change: Callable[["Scenario", Encounter, Array, ArrayModule], tuple[Encounter, Array]] = (
        _unchanged
    )
    """(scenario, encounters ``[N]``, draws ``[N, D]``, numpy or jax.numpy) -> the encounters
    changed, and which of them meet the modifier's conditions, bool ``[N]``."""
    shared: int = 0  # draws that an encounter takes
    per_intruder: int = 0  # draws that each of its intruders takes besides
    numbers: Callable[[Aircraft], Mapping[str, Any]] = _no_changes
    """(ownship) -> fields of :class:`Scenario` that it sets."""
    heeded: Callable[[Encounter], Array] | None = None
    """(encounters) -> what is not 0 everywhere if the sampler heeds these numbers."""
    moves: bool = False
    """Whether it moves intruders and sees to the scenario's conditions itself."""
    rounds: int = 1
    """How often the scenario's attempts are made, each time with other draws, because its
    conditions are seldom met."""


@dataclass(frozen=True)
class Scenario:
    """A sampler, the modifiers of its encounters, and its numbers, which say what it draws.

    Pairs (low, high) are ranges of a uniform draw; SI units. What the numbers mean is said as the
    geometry of the scenarios that ship uses them (:mod:`envs.scenarios.geometry`); in a training
    for several aircraft, ranges of speeds are arrays, ``[N]`` of the ownship and ``[N, 1]`` of the
    intruders. :func:`envs.scenarios.scenario` makes them.
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
    vertical_miss: float = 0.0
    """Greatest vertical distance at the closest approach, m, of modifier ``layered``."""
    vertical_rate: tuple[float, float] = (0.0, 0.0)
    """Of its intruders that climb or descend, m/s."""
    attempts: int = 8  # how many draws an encounter has to meet the conditions
    modifiers: tuple[Modifier, ...] = ()
    """In the order of :data:`envs.scenarios.MODIFIERS`; their draws follow the sampler's."""
    together: bool = False  # whether sampler and modifiers draw from one stream

    @property
    def dimensions(self) -> int:
        """Unit-uniform draws that one attempt takes."""
        return sum(map(self.width, (self.sampler, *self.modifiers)))

    @property
    def rounds(self) -> int:
        """How often the attempts are made, each time with other draws."""
        return 1 if self.together else max((part.rounds for part in self.modifiers), default=1)

    def width(self, part: Sampler | Modifier) -> int:
        """Return the draws that the sampler or a modifier takes in one attempt."""
        return part.shared + part.per_intruder * self.intruders[1]


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


def columns(draws: Array, first: int, most: int, count: int) -> list[Array]:
    """Return so many draws of each intruder, ``[N, K]`` each for K = ``most``, from draws
    ``[N, D]``, in which they stand from the column ``first`` on.
    """
    return [draws[:, first + i * most : first + (i + 1) * most] for i in range(count)]


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
    zeros = xp.zeros_like(intruders.speed)
    return Intent(zeros, zeros, zeros + scenario.aircraft.limits.yaw_rate_max)


def sensor_of(scenario: Scenario, draw: Array, xp: ArrayModule) -> Sensor:
    """Return the scenario's quality of reports, ``[N, 1]``; the draw ``[N]`` is of their age."""
    column = xp.ones_like(draw)[:, None]
    return Sensor(
        scenario.position_std * column,
        scenario.velocity_std * column,
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
