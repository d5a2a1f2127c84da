"""Encounters and their samplers: from unit-uniform draws to two or more aircraft in conflict.

A sampler is a pure function of draws, so that jax keys and a counter-based numpy generator feed the
same code. Courses differ clockwise as seen from above, as aviation counts them: an intruder of
course difference +90 degrees comes from the left.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from envs.aircraft import Aircraft
from envs.angles import sincos, wrap
from envs.edge.command import InputError
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.relative import distance, straight_cpa
from envs.trees import choose, mapped


class EncounterError(InputError):
    """An impossible encounter or scenario; the message says which and why."""


class Encounter(NamedTuple):
    """One or many starts, SI units; own fields ``[...]``, intruder fields ``[..., K]``."""

    own: VehicleState
    goal_x: Any
    goal_y: Any
    intruders: VehicleState
    mask: Any  # which of the K intruders exist, bool [..., K]
    intent: Intent
    sensor: Sensor  # quality of the intruders' reports, [..., 1] each


MOST_INTRUDERS = 64
"""Most intruders of an encounter: far more than one ownship meets, and cheap to hold."""

SCENARIOS = (
    "circle",
    "crossing_left",
    "crossing_right",
    "head_on",
    "same_course",
    "maneuvering",
    "noisy",
    "multi",
)
"""The scenarios by name."""


@dataclass(frozen=True)
class Scenario:
    """A family of encounters around a common conflict point (the paper's "circle" and variants of
    it).

    Ownship and intruders start so far from the centre that they would meet there at the same time;
    then every start is displaced. Pairs (low, high) are ranges of a uniform draw; SI units.
    :func:`scenario` makes them.
    """

    name: str
    aircraft: Aircraft  # the ownship; what a scenario does not state otherwise is scaled by it
    radius: tuple[
        float, float
    ]  # distance of the ownship from the centre, m; the goal lies as far on the other side
    own_speed: tuple[float, float]  # m/s
    intruder_speed: tuple[float, float]  # m/s
    displacement: (
        float  # each start is moved by up to this in x and in y, m; headings and goal stay
    )
    min_initial_separation: float  # starts closer than this, m, are redrawn; 0 keeps them all
    course_difference: tuple[float, float] = (
        -math.pi,
        math.pi,
    )  # intruder's course less own course, rad clockwise
    conflicts_closer_than: float = (
        math.inf
    )  # only starts whose straight courses pass closer than this, m, are kept
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
        return 7 + 7 * self.intruders[1]


def scenario(name: str, aircraft: Aircraft, **changes: Any) -> Scenario:
    """Return a scenario by its name, scaled by the aircraft, with some of its fields changed.

    Lengths are in separations, speeds in ``speed_max``, latencies in time steps; for the paper's
    aircraft the numbers are the paper's.

    Raises:
        EncounterError: the name is unknown, or a field contradicts the aircraft; the message begins
            with the field.
    """
    if name not in SCENARIOS:
        raise EncounterError(
            f"scenario {name!r} is unknown; expected one of {', '.join(SCENARIOS)}"
        )
    separation, limits = aircraft.separation, aircraft.limits
    # An aircraft that can stand still would never arrive at the conflict point.
    speeds = (max(limits.speed_min, 0.2 * limits.speed_max), limits.speed_max)
    circle = Scenario(
        name,
        aircraft,
        (3.0 * separation, 10.0 * separation),
        speeds,
        speeds,
        0.5 * separation,
        separation,
    )
    conflict = {"conflicts_closer_than": separation, "attempts": 48}
    own: dict[str, dict[str, Any]] = {
        "crossing_left": {"course_difference": _courses(90.0, 45.0), **conflict},
        "crossing_right": {"course_difference": _courses(-90.0, 45.0), **conflict},
        "head_on": {"course_difference": _courses(180.0, 20.0), **conflict},
        "same_course": {"course_difference": _courses(0.0, 20.0), **conflict},
        "maneuvering": {"turn_rate": limits.yaw_rate_max},
        "noisy": {
            "position_std": 0.03 * separation,
            "velocity_std": 0.03 * limits.speed_max,
            "latency": (aircraft.dt, 2.0 * aircraft.dt),
        },
        "multi": {"intruders": (2, 8), "attempts": 24},
    }
    chosen = replace(circle, **(own.get(name, {}) | changes))
    _check(chosen)
    return chosen


def _courses(middle_deg: float, half_width_deg: float) -> tuple[float, float]:
    return math.radians(middle_deg - half_width_deg), math.radians(middle_deg + half_width_deg)


def _check(chosen: Scenario) -> None:
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


def sample(scenario: Scenario, draws: Any, xp: Any) -> tuple[Encounter, Any]:
    """Turn draws ``[A, N, D]`` in [0, 1), D = ``scenario.dimensions``, into encounters ``[N]``.

    Each takes the first of A attempts that meets the scenario's conditions, else its last. Also
    returned is whether it meets them.
    """
    encounter, accepted = _attempt(scenario, draws[0], xp)
    for attempt in range(1, draws.shape[0]):
        if xp.__name__ == "numpy" and accepted.all():
            break
        other, other_accepted = _attempt(scenario, draws[attempt], xp)
        encounter = choose(accepted, encounter, other, xp)
        accepted = xp.logical_or(accepted, other_accepted)
    return encounter, accepted


def padded(encounter: Encounter, count: int, xp: Any) -> Encounter:
    """Return the encounters ``[N]`` with absent intruders added until there are ``count``
    of them.
    """
    present = encounter.mask.shape[-1]
    if count <= present:
        return encounter

    def more(field: Any) -> Any:
        return xp.concatenate([field] + [field[..., :1]] * (count - present), axis=-1)

    intruders, intent, mask = mapped(more, (encounter.intruders, encounter.intent, encounter.mask))
    return encounter._replace(
        intruders=intruders, intent=intent, mask=mask & (xp.arange(count) < present)
    )


def _attempt(scenario: Scenario, draws: Any, xp: Any) -> tuple[Encounter, Any]:
    """Return the encounters of one attempt, draws ``[N, D]``, and which of them meet the
    conditions, ``[N]``.
    """
    most = scenario.intruders[1]
    shared = [draws[:, i] for i in range(7)]
    each = [draws[:, 7 + i * most : 7 + (i + 1) * most] for i in range(7)]

    radius = between(scenario.radius, shared[0])
    course = between((-math.pi, math.pi), shared[1])
    speed = between(scenario.own_speed, shared[2])
    sine, cosine = sincos(course, xp)
    goal_x, goal_y = radius * cosine, radius * sine
    shift = (-scenario.displacement, scenario.displacement)
    own = VehicleState(
        between(shift, shared[3]) - goal_x, between(shift, shared[4]) - goal_y, course, speed
    )

    intruder_course = wrap(course[:, None] - between(scenario.course_difference, each[0]), xp)
    intruder_speed = between(scenario.intruder_speed, each[1])
    sine, cosine = sincos(intruder_course, xp)
    back = (radius / speed)[:, None] * intruder_speed
    intruders = VehicleState(
        between(shift, each[2]) - back * cosine,
        between(shift, each[3]) - back * sine,
        intruder_course,
        intruder_speed,
    )
    fewest = scenario.intruders[0]
    count = fewest + xp.floor(shared[5] * (most - fewest + 1))
    mask = xp.arange(most)[None, :] < count[:, None]

    seen_by = VehicleState(*(field[:, None] for field in own))
    cpa = straight_cpa(seen_by, intruders, xp)
    turn_rate = between((-scenario.turn_rate, scenario.turn_rate), each[4])
    intent = Intent(
        onset=1.2 * cpa.time * each[5],
        heading_change=xp.copysign(
            (scenario.heading_change if scenario.turn_rate else 0.0) * each[6], turn_rate
        ),
        turn_rate=xp.abs(turn_rate)
        if scenario.turn_rate
        else xp.full_like(turn_rate, scenario.aircraft.limits.yaw_rate_max),
    )
    ones = xp.ones_like(radius)[:, None]
    sensor = Sensor(
        scenario.position_std * ones,
        scenario.velocity_std * ones,
        between(scenario.latency, shared[6])[:, None],
    )
    apart = distance(intruders.x - seen_by.x, intruders.y - seen_by.y, xp)
    meets = xp.logical_and(
        apart >= scenario.min_initial_separation, cpa.distance < scenario.conflicts_closer_than
    )
    accepted = xp.all(xp.logical_or(meets, xp.logical_not(mask)), axis=-1)
    return Encounter(own, goal_x, goal_y, intruders, mask, intent, sensor), accepted


def between(bounds: tuple[float, float], draw: Any) -> Any:
    """Return what unit-uniform draws are in a range."""
    low, high = bounds
    return low + (high - low) * draw
