"""Encounters by number: encounter 1234 of a seed is the same wherever and with however many others it is drawn."""

import math
from typing import Any

import numpy as np

from envs import draws
from envs.aircraft import Aircraft
from envs.encounters import MOST_INTRUDERS, Encounter, EncounterError, Scenario, sample
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.trees import mapped


def numbered(scenario: Scenario, seed: int, first: int, count: int) -> Encounter:
    """Return the encounters ``first .. first + count - 1`` of a seed, float64 fields ``[count]`` and ``[count, K]``.

    Raises:
        EncounterError: seed or number are out of range, or the scenario's conditions are never met.
    """
    if not 0 <= seed < 2**64:
        raise EncounterError(f"seed is {seed}; expected 0 <= seed < 2**64")
    if first < 0:
        raise EncounterError(f"encounter number is {first}; expected 0 or more")
    uniform = draws.uniforms(seed, first, count, (scenario.attempts, scenario.dimensions))
    # Attempts lead in a sampler's draws, encounters in draws by position.
    encounter, accepted = sample(scenario, np.swapaxes(uniform, 0, 1), np)
    if not accepted.all():
        number = first + int(np.argmin(accepted))
        raise EncounterError(
            f"encounter {number} of seed {seed} does not meet the conditions of scenario {scenario.name!r} "
            f"in {scenario.attempts} attempts; allow more attempts or other conditions"
        )
    return encounter


def report_noise(seed: int, number: int, step: int, intruders: int) -> np.ndarray:
    """Return the noise of the reports that one encounter's ownship has at the beginning of a step (0, 1, ...).

    Returns:
        Standard normal draws of x, y, vx, vy, ``[4, K]``.
    """
    # Stream 0 makes the starts.
    return draws.normals(seed, number, 1, (4, intruders), stream=step + 1)[0]


def joined(first: Encounter, second: Encounter) -> Encounter:
    """Return both batches of encounters as one."""
    return mapped(lambda *fields: np.concatenate(fields), first, second)


def cast(encounters: Encounter, dtype: Any) -> Encounter:
    """Return the encounters with numbers of another type; the mask stays."""
    return mapped(lambda field: field if field.dtype == bool else field.astype(dtype), encounters)


def checked(encounter: Encounter, aircraft: Aircraft, batch: tuple[int, ...] = ()) -> Encounter:
    """Return a user's own encounter as float64 arrays of the shapes that it must have.

    Args:
        encounter: own fields ``batch``, intruder fields ``[*batch, K]`` or what broadcasts to them.
        batch: leading shape; ``()`` for one encounter, which may also come as a batch of one.

    Raises:
        EncounterError: a field has a wrong shape, is not finite or is out of range; the message names it.
    """
    if not isinstance(encounter, Encounter):
        raise EncounterError(f"encounter is a {type(encounter).__name__}; expected an envs.encounters.Encounter")
    mask = np.atleast_1d(np.asarray(encounter.mask, dtype=bool))
    if not 1 <= mask.shape[-1] <= MOST_INTRUDERS:
        raise EncounterError(f"mask has {mask.shape[-1]} intruder columns; expected 1 to {MOST_INTRUDERS}")
    wide, limits = (*batch, mask.shape[-1]), aircraft.limits

    own = [_numbers(f"own.{name}", value, batch) for name, value in encounter.own._asdict().items()]
    _numbers("own.speed", own[3], batch, limits.speed_min, limits.speed_max)
    _numbers("own.heading", own[2], batch, -math.pi, math.pi)
    intruders = [_numbers(f"intruders.{name}", value, wide) for name, value in encounter.intruders._asdict().items()]
    _numbers("intruders.speed", intruders[3], wide, 0.0, aircraft.traffic_speed_max)
    _numbers("intruders.heading", intruders[2], wide, -math.pi, math.pi)
    intent = [
        _numbers("intent.onset", encounter.intent.onset, wide),
        _numbers("intent.heading_change", encounter.intent.heading_change, wide, -math.pi, math.pi),
        _numbers("intent.turn_rate", encounter.intent.turn_rate, wide, 0.0, 1.0 / aircraft.dt),
    ]
    narrow = (*batch, 1)
    sensor = [
        _numbers("sensor.position_std", encounter.sensor.position_std, narrow, 0.0),
        _numbers("sensor.velocity_std", encounter.sensor.velocity_std, narrow, 0.0),
        _numbers("sensor.latency", encounter.sensor.latency, narrow, 0.0, 2.0 * aircraft.dt),
    ]
    present = _shaped("mask", mask, wide)
    if not present.any(axis=-1).all():
        raise EncounterError("mask leaves an encounter without intruders; expected at least one each")
    return Encounter(
        VehicleState(*own),
        _numbers("goal_x", encounter.goal_x, batch),
        _numbers("goal_y", encounter.goal_y, batch),
        VehicleState(*intruders),
        present,
        Intent(*intent),
        Sensor(*sensor),
    )


def _numbers(
    name: str, value: Any, shape: tuple[int, ...], low: float = -math.inf, high: float = math.inf
) -> np.ndarray:
    """Return a field as finite float64 within its range."""
    try:
        numbers = _shaped(name, np.asarray(value, dtype=np.float64), shape)
    except (TypeError, ValueError) as error:
        raise (
            error if isinstance(error, EncounterError) else EncounterError(f"{name} is not numeric: {error}")
        ) from None
    wrong = ~(np.isfinite(numbers) & (numbers >= low) & (numbers <= high))
    if wrong.any():
        within = "a finite number" if low == -math.inf else f"within {low:g}..{high:g}"
        raise EncounterError(f"{name} is {numbers[wrong].flat[0]:g}; expected {within}")
    return numbers


def _shaped(name: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    if len(values.shape) > len(shape) and values.shape[0] == 1:
        values = values[0]  # a batch of one for a single encounter
    try:
        return np.broadcast_to(values, shape).copy()
    except ValueError:
        raise EncounterError(f"{name} has shape {values.shape}; expected {shape}") from None
