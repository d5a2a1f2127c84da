"""Encounters by number: encounter 1234 of a seed is the same wherever and with however many others
it is drawn.
"""

import math
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from envs import draws
from envs.aircraft import Aircraft
from envs.altitudes import Altitudes
from envs.areas import Area
from envs.arrays import Array
from envs.encounters import MOST_INTRUDERS, Encounter, EncounterError, Scenario
from envs.reaction import GIVES_WAY, TURNS_INTO
from envs.scenarios.sampling import check_modifiers, draw_numbered, ships
from envs.trees import map_leaves

_STRONGEST = 100.0  # m/s of a wind

_OPTIONAL = {
    "separation": "intruders with separations of their own; expected a training, "
    "eval.monte_carlo or eval.hifi",
    "coverage": "intruders that are not always reported; expected a training, eval.monte_carlo "
    "or eval.compare",
    "reaction": "intruders that answer the ownship; expected a training, or eval.monte_carlo in "
    "mode policy",
    "wind": "a wind of its own; expected eval.monte_carlo in mode plan or assured",
    "areas": "areas of its own; expected eval.monte_carlo",
    "altitudes": "altitudes; expected eval.monte_carlo or eval.compare",
}
"""What an encounter has by its optional fields, and who heeds them."""

EVERY_FIELD = tuple(_OPTIONAL)
"""The optional fields of an encounter."""

OF_INTRUDERS = "separation", "coverage", "reaction"
"""Those that say more of its intruders."""


def encounters_of_seed(
    scenario: Scenario, seed: int, first: int, count: int, *, heeds: Collection[str] = ()
) -> Encounter:
    """Return the encounters ``first .. first + count - 1`` of a seed, float64 fields ``[count]``
    and ``[count, K]``.

    Args:
        heeds: the optional fields of an encounter that the caller heeds, of :data:`EVERY_FIELD`.

    Raises:
        EncounterError: seed or number are out of range, the scenario's conditions are never met, or
            it has optional fields that the caller would not heed.
    """
    check_number(seed, first)
    encounter, accepted = draw_numbered(scenario, seed, first, count)
    if not accepted.all():
        number = first + int(np.argmin(accepted))
        unmet = (
            f"does not meet the conditions of scenario {scenario.name!r} in "
            f"{scenario.attempts * scenario.rounds} attempts"
        )
        raise EncounterError(
            f"encounter {number} of seed {seed} {unmet}; allow more, or other conditions"
        )
    check_sampled(scenario, encounter)
    check_heeded(encounter, f"scenario {scenario.name!r}", heeds)
    return encounter


def check_heeded(encounter: Encounter, subject: str, heeds: Collection[str] = ()) -> None:
    """Refuse encounters with other optional fields than those that are heeded; ``subject`` names
    them.

    Raises:
        EncounterError: intruders have separations of their own, are reported in part, or answer
            the ownship.
    """
    for name, text in _OPTIONAL.items():
        if name not in heeds and getattr(encounter, name) is not None:
            raise EncounterError(f"{subject} has {text}")


def check_sampled(scenario: Scenario, encounter: Encounter) -> None:
    """Refuse encounters ``[N]`` of a sampler of the user's own that nobody could fly.

    Raises:
        EncounterError: a field is not finite or out of range, or a modifier has no effect; the
            message names it.
    """
    if ships(scenario):
        return
    check_modifiers(scenario, encounter)
    try:
        check_encounter(encounter, scenario.aircraft, encounter.goal_x.shape)
    except EncounterError as problem:
        raise EncounterError(f"scenario {scenario.name!r}: {problem}") from None


def check_number(seed: int, first: int) -> None:
    """Raise an EncounterError for a seed or a number of an encounter that is out of range."""
    if not 0 <= seed < 2**64:
        raise EncounterError(f"seed is {seed}; expected 0 <= seed < 2**64")
    if first < 0:
        raise EncounterError(f"encounter number is {first}; expected 0 or more")


def report_noise(seed: int, number: int, step: int, intruders: int) -> np.ndarray:
    """Return the noise of one encounter's reports at a step (0, 1, ...): standard normal, x, y, vx,
    vy, ``[4, K]``.
    """
    # Stream 0 makes the starts.
    return draws.normals(seed, number, 1, (4, intruders), stream=step + 1)[0]


def join(first: Encounter, second: Encounter) -> Encounter:
    """Return both batches of encounters as one."""
    return map_leaves(lambda *fields: np.concatenate(fields), first, second)


def cast(encounters: Encounter, dtype: DTypeLike) -> Encounter:
    """Return the encounters with numbers of another type; the mask stays."""
    return map_leaves(
        lambda field: field if field.dtype in (bool, object) else field.astype(dtype), encounters
    )


def check_encounter(
    encounter: Encounter, aircraft: Aircraft, batch: tuple[int, ...] = ()
) -> Encounter:
    """Return a user's own encounter as float64 arrays of the shapes that it must have.

    Args:
        encounter: own fields ``batch``, intruder fields ``[*batch, K]`` or what broadcasts to them.
        batch: leading shape; ``()`` for one encounter, which may also come as a batch of one.

    Raises:
        EncounterError: a field has a wrong shape, is not finite or is out of range; the message
            names it.
    """
    if not isinstance(encounter, Encounter):
        raise EncounterError(
            f"encounter is a {type(encounter).__name__}; expected an envs.encounters.Encounter"
        )
    mask = np.atleast_1d(np.asarray(encounter.mask, dtype=bool))
    if not 1 <= mask.shape[-1] <= MOST_INTRUDERS:
        raise EncounterError(
            f"mask has {mask.shape[-1]} intruder columns; expected 1 to {MOST_INTRUDERS}"
        )
    wide, narrow = (*batch, mask.shape[-1]), (*batch, 1)
    mask = _shape("mask", mask, wide)
    if not mask.any(axis=-1).all():
        raise EncounterError(
            "mask leaves an encounter without intruders; expected at least one each"
        )
    ranges = _ranges(aircraft)

    def part(name: str, shape: tuple[int, ...]) -> Any:
        return _part(name, getattr(encounter, name), shape, ranges)

    def optional(name: str) -> Any:
        return None if getattr(encounter, name) is None else part(name, wide)

    return Encounter(
        own=part("own", batch),
        goal_x=part("goal_x", batch),
        goal_y=part("goal_y", batch),
        intruders=part("intruders", wide),
        mask=mask,
        intent=part("intent", wide),
        sensor=part("sensor", narrow),
        coverage=optional("coverage"),
        separation=optional("separation"),
        reaction=optional("reaction"),
        wind=None if encounter.wind is None else part("wind", batch),
        areas=None if encounter.areas is None else _areas(encounter.areas, batch),
        altitudes=None
        if encounter.altitudes is None
        else _altitudes(encounter.altitudes, batch, wide),
    )


def _altitudes(altitudes: Altitudes, batch: tuple[int, ...], wide: tuple[int, ...]) -> Altitudes:
    """Return altitudes, of intruders in two rows or more."""
    rows = np.shape(altitudes.intruders)[-1:]
    if not rows or rows[0] < 2:
        raise EncounterError(
            f"altitudes.intruders has shape {np.shape(altitudes.intruders)}; expected "
            f"{(*wide, 'T + 1')} with T of 1 or more"
        )
    too_high, error = altitudes.too_high, altitudes.stated_error
    name, positive = "altitudes.stated_error", (0.0, math.inf)
    return Altitudes(
        _part("altitudes.own", altitudes.own, batch, {}),
        _part("altitudes.intruders", altitudes.intruders, (*wide, *rows), {}),
        None if too_high is None else _part("altitudes.too_high", too_high, wide, {}),
        None if error is None else _part(name, error, wide, {name: positive}),
    )


def _areas(values: Array, shape: tuple[int, ...]) -> np.ndarray:
    """Return the areas of encounters, each a tuple of them."""
    areas = np.asarray(values, dtype=object)
    tuples = list(areas.ravel()) if areas.shape == shape else [None]
    if not all(isinstance(row, tuple) and all(isinstance(a, Area) for a in row) for row in tuples):
        raise EncounterError(
            f"areas: expected an object array {shape} of tuples of envs.areas.Area"
        )
    return areas


def _part(
    name: str, field: Any, shape: tuple[int, ...], ranges: dict[str, tuple[float, float]]
) -> Any:
    """Return a field, or a named tuple of fields, as finite float64 of a shape, in their ranges."""
    if hasattr(field, "_fields"):
        return type(field)(
            *(
                _part(f"{name}.{key}", value, shape, ranges)
                for key, value in field._asdict().items()
            )
        )
    low, high = ranges.get(name, (-math.inf, math.inf))
    return _numbers(name, field, shape, low, high)


def _ranges(aircraft: Aircraft) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest values of the fields of an encounter that are bounded."""
    turn, positive = (-math.pi, math.pi), (0.0, math.inf)
    rate = (0.0, 1.0 / aircraft.dt)
    return {
        "own.speed": (aircraft.limits.speed_min, aircraft.limits.speed_max),
        "own.heading": turn,
        "intruders.speed": (0.0, aircraft.traffic_speed_max),
        "intruders.heading": turn,
        "intent.heading_change": turn,
        "intent.turn_rate": rate,
        "sensor.position_std": positive,
        "sensor.velocity_std": positive,
        "sensor.latency": (0.0, 2.0 * aircraft.dt),
        "coverage.reach": positive,
        "coverage.half_angle": (0.0, math.pi),
        "coverage.silence": positive,
        "reaction.manner": (TURNS_INTO, GIVES_WAY),
        "reaction.ahead": positive,
        "reaction.within": positive,
        "reaction.heading_change": (0.0, math.pi),
        "reaction.turn_rate": rate,
        "wind.east": (-_STRONGEST, _STRONGEST),
        "wind.north": (-_STRONGEST, _STRONGEST),
        "wind.std": positive,
        "separation": (0.01 * aircraft.separation, 100.0 * aircraft.separation),
    }


def _numbers(
    name: str, value: Array, shape: tuple[int, ...], low: float, high: float
) -> np.ndarray:
    """Return a field as finite float64 of a shape, within its range."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise EncounterError(f"{name} is not numeric: {error}") from None
    numbers = _shape(name, array, shape)
    out_of_range = ~(np.isfinite(numbers) & (numbers >= low) & (numbers <= high))
    if out_of_range.any():
        within = "a finite number" if low == -math.inf else f"within {low:g}..{high:g}"
        raise EncounterError(f"{name} is {numbers[out_of_range].flat[0]:g}; expected {within}")
    return numbers


def _shape(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if len(values.shape) > len(shape) and values.shape[0] == 1:
        values = values[0]  # a batch of one for a single encounter
    try:
        return np.broadcast_to(values, shape).copy()
    except ValueError:
        raise EncounterError(f"{name} has shape {values.shape}; expected {shape}") from None
