"""Encounters and their samplers: from unit-uniform draws to two or more aircraft in conflict.

A sampler is a pure function of draws, so that jax keys, a counter-based numpy generator and a Sobol sequence
feed the same code. Courses differ clockwise as seen from above, as aviation counts them: an intruder of course
difference +90 degrees comes from the left.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from envs.angles import sincos, wrap
from envs.edge.command import InputError
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.relative import distance, straight_cpa

__all__ = ["SCENARIOS", "Encounter", "EncounterError", "Scenario", "choose", "padded", "sample", "scenario"]


class EncounterError(InputError):
    """An encounter or scenario that cannot be had; the message says which and why."""


class Encounter(NamedTuple):
    """One or many starts; own fields ``[...]``, intruder fields ``[..., K]``."""

    own: VehicleState
    goal_x: Any
    goal_y: Any
    intruders: VehicleState
    mask: Any
    """Which of the K intruders exist, bool ``[..., K]``."""
    intent: Intent
    sensor: Sensor
    """Quality of the intruders' reports, ``[..., 1]`` each."""


@dataclass(frozen=True)
class Scenario:
    """A family of encounters around a common conflict point (the paper's "circle" and DESIGN's variants).

    Own ship and intruders start so far from the centre that they would meet there at the same time; then every
    start is displaced. Pairs (low, high) are ranges of a uniform draw.
    """

    name: str
    radius: tuple[float, float] = (3_000.0, 10_000.0)
    """Distance of the ownship from the centre, m; the goal lies as far on the other side."""
    own_speed: tuple[float, float] = (50.0, 100.0)
    intruder_speed: tuple[float, float] = (50.0, 100.0)
    course_difference: tuple[float, float] = (-math.pi, math.pi)
    """Intruder's course less own course, rad clockwise."""
    displacement: float = 500.0
    """Each start is moved by up to this in x and in y, m; headings and goal stay."""
    min_initial_separation: float = 1_000.0
    """Starts closer than this, m, are redrawn; 0 keeps them all."""
    conflicts_closer_than: float = math.inf
    """Only starts whose straight courses pass closer than this, m, are kept."""
    intruders: tuple[int, int] = (1, 1)
    """Fewest and most intruders."""
    turn_rate: float = 0.0
    """Largest rate of the intruder's one turn, rad/s; 0: it flies straight."""
    heading_change: float = 0.0
    """Largest heading change of that turn, rad."""
    position_std: float = 0.0
    """Noise of reported positions, one sigma per axis, m."""
    velocity_std: float = 0.0
    """Noise of reported velocities, one sigma per axis, m/s."""
    latency: tuple[float, float] = (0.0, 0.0)
    """Age of the reports, s."""
    attempts: int = 8
    """How many draws an encounter has to meet the conditions."""

    @property
    def dimensions(self) -> int:
        """Unit-uniform draws that one attempt takes."""
        return 7 + 7 * self.intruders[1]


_CONFLICT = 1_000.0
_CIRCLE = Scenario("circle")


def _conflicts(name: str, middle_deg: float, half_width_deg: float) -> Scenario:
    low, high = math.radians(middle_deg - half_width_deg), math.radians(middle_deg + half_width_deg)
    return replace(_CIRCLE, name=name, course_difference=(low, high), conflicts_closer_than=_CONFLICT, attempts=48)


SCENARIOS: dict[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        _CIRCLE,
        _conflicts("crossing_left", 90.0, 45.0),
        _conflicts("crossing_right", -90.0, 45.0),
        _conflicts("head_on", 180.0, 20.0),
        _conflicts("same_course", 0.0, 20.0),
        replace(_CIRCLE, name="maneuvering", turn_rate=math.radians(3.0), heading_change=math.radians(120.0)),
        replace(_CIRCLE, name="noisy", position_std=30.0, velocity_std=3.0, latency=(1.0, 2.0)),
        replace(_CIRCLE, name="multi", intruders=(2, 8), attempts=24),
    )
}
"""The scenarios by name."""


def scenario(name: str, **changes: Any) -> Scenario:
    """Return a scenario by its name, with some of its fields changed.

    Raises:
        EncounterError: the name is unknown.
    """
    if name not in SCENARIOS:
        raise EncounterError(f"scenario {name!r} is unknown; expected one of {', '.join(SCENARIOS)}")
    return replace(SCENARIOS[name], **changes)


def sample(scenario: Scenario, draws: Any, xp: Any) -> tuple[Encounter, Any]:
    """Turn unit-uniform draws into encounters.

    Args:
        scenario: the family.
        draws: ``[A, N, D]`` in [0, 1) with D = ``scenario.dimensions``: A attempts of which each encounter takes
            the first that meets the scenario's conditions.
        xp: array namespace.

    Returns:
        The encounters ``[N]`` and whether each meets the conditions (where not, its last attempt stands).
    """
    encounter, accepted = _attempt(scenario, draws[0], xp)
    for attempt in range(1, draws.shape[0]):
        if xp.__name__ == "numpy" and accepted.all():
            break
        other, other_accepted = _attempt(scenario, draws[attempt], xp)
        encounter = choose(accepted, encounter, other, xp)
        accepted = xp.logical_or(accepted, other_accepted)
    return encounter, accepted


def choose(condition: Any, yes: Encounter, no: Encounter, xp: Any) -> Encounter:
    """Return, for each of the encounters ``[N]``, ``yes`` where the condition ``[N]`` holds and else ``no``."""
    own = VehicleState(*(xp.where(condition, a, b) for a, b in zip(yes.own, no.own, strict=True)))
    column = condition[..., None]

    def columns(a: Any, b: Any) -> list[Any]:
        return [xp.where(column, x, y) for x, y in zip(a, b, strict=True)]

    return Encounter(
        own,
        xp.where(condition, yes.goal_x, no.goal_x),
        xp.where(condition, yes.goal_y, no.goal_y),
        VehicleState(*columns(yes.intruders, no.intruders)),
        xp.where(column, yes.mask, no.mask),
        Intent(*columns(yes.intent, no.intent)),
        Sensor(*columns(yes.sensor, no.sensor)),
    )


def padded(encounter: Encounter, count: int, xp: Any) -> Encounter:
    """Return the encounters ``[N]`` with absent intruders added until there are ``count`` of them."""
    missing = count - encounter.mask.shape[-1]
    if missing <= 0:
        return encounter

    def more(fields: Any) -> list[Any]:
        return [xp.concatenate([field] + [field[..., :1]] * missing, axis=-1) for field in fields]

    absent = xp.zeros_like(encounter.mask[..., :1])
    return encounter._replace(
        intruders=VehicleState(*more(encounter.intruders)),
        mask=xp.concatenate([encounter.mask] + [absent] * missing, axis=-1),
        intent=Intent(*more(encounter.intent)),
    )


def _attempt(scenario: Scenario, draws: Any, xp: Any) -> tuple[Encounter, Any]:
    """Return the encounters of one attempt, draws ``[N, D]``, and which of them meet the conditions, ``[N]``."""
    most = scenario.intruders[1]
    shared = [draws[:, i] for i in range(7)]
    each = [draws[:, 7 + i * most : 7 + (i + 1) * most] for i in range(7)]

    radius = _between(scenario.radius, shared[0])
    course = _between((-math.pi, math.pi), shared[1])
    speed = _between(scenario.own_speed, shared[2])
    sine, cosine = sincos(course, xp)
    goal_x, goal_y = radius * cosine, radius * sine
    shift = (-scenario.displacement, scenario.displacement)
    own = VehicleState(_between(shift, shared[3]) - goal_x, _between(shift, shared[4]) - goal_y, course, speed)

    intruder_course = wrap(course[:, None] - _between(scenario.course_difference, each[0]), xp)
    intruder_speed = _between(scenario.intruder_speed, each[1])
    sine, cosine = sincos(intruder_course, xp)
    back = (radius / speed)[:, None] * intruder_speed
    intruders = VehicleState(
        _between(shift, each[2]) - back * cosine,
        _between(shift, each[3]) - back * sine,
        intruder_course,
        intruder_speed,
    )
    fewest = scenario.intruders[0]
    count = fewest + xp.floor(shared[5] * (most - fewest + 1))
    mask = xp.arange(most)[None, :] < count[:, None]

    seen_by = VehicleState(*(field[:, None] for field in own))
    cpa = straight_cpa(seen_by, intruders, xp)
    turn_rate = _between((-scenario.turn_rate, scenario.turn_rate), each[4])
    intent = Intent(
        onset=1.2 * cpa.time * each[5],
        heading_change=xp.copysign(scenario.heading_change * each[6], turn_rate),
        turn_rate=xp.abs(turn_rate) if scenario.turn_rate else xp.full_like(turn_rate, math.radians(3.0)),
    )
    ones = xp.ones_like(radius)[:, None]
    sensor = Sensor(
        scenario.position_std * ones,
        scenario.velocity_std * ones,
        _between(scenario.latency, shared[6])[:, None],
    )
    apart = distance(intruders.x - seen_by.x, intruders.y - seen_by.y, xp)
    meets = xp.logical_and(apart >= scenario.min_initial_separation, cpa.distance < scenario.conflicts_closer_than)
    accepted = xp.all(xp.logical_or(meets, xp.logical_not(mask)), axis=-1)
    return Encounter(own, goal_x, goal_y, intruders, mask, intent, sensor), accepted


def _between(bounds: tuple[float, float], draw: Any) -> Any:
    """Map a unit-uniform draw to a range."""
    low, high = bounds
    return low + (high - low) * draw
