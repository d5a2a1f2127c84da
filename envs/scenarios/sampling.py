"""From a scenario and draws to encounters."""

import hashlib
from typing import Any

import numpy as np

from commands.extension import failure
from envs.arrays import Array, ArrayModule
from envs.draws import uniforms
from envs.encounters import Encounter, EncounterError, Modifier, Sampler, Scenario
from envs.scenarios.geometry import conflict_point
from envs.trees import choose


def ships(scenario: Scenario) -> bool:
    """Return whether the geometry is the toolkit's, not of a sampler of the user's own."""
    return scenario.sampler.encounters is conflict_point


def draw_numbered(
    scenario: Scenario, seed: int, first: int, count: int
) -> tuple[Encounter, np.ndarray]:
    """Return the encounters ``first .. first + count - 1`` of a seed, ``[count]``, and which of
    them meet the scenario's conditions, ``[count]``.

    Sampler and modifiers draw from streams of their own, so that what one of them draws depends on
    no other.
    """
    encounter, accepted = sample(scenario, _draws(scenario, seed, first, count, 0), np)
    for redraw in range(1, scenario.rounds):
        if accepted.all():
            break
        redrawn, redrawn_accepted = sample(
            scenario, _draws(scenario, seed, first, count, redraw), np
        )
        encounter = choose(accepted, encounter, redrawn, np)
        accepted = accepted | redrawn_accepted
    return encounter, accepted


def _draws(scenario: Scenario, seed: int, first: int, count: int, again: int) -> np.ndarray:
    """Return the draws of a round of attempts, ``[A, N, D]``."""
    parts = [(scenario.width(part), part) for part in (scenario.sampler, *scenario.modifiers)]
    if scenario.together:
        parts = [(scenario.dimensions, scenario.sampler)]
    blocks = [
        uniforms(seed, first, count, (scenario.attempts, width), _stream(part, again))
        for width, part in parts
        if width
    ]
    # Attempts lead in a sampler's draws, encounters in draws by position.
    return np.swapaxes(np.concatenate(blocks, axis=-1), 0, 1)


def _stream(part: Sampler | Modifier, again: int) -> int:
    """Return the number of the stream of a sampler or a modifier in a round; 0 is that of the
    starts.
    """
    name = part.name if isinstance(part, Modifier) else ""
    if not (name or again):
        return 0
    # Far from the small numbers of the streams of the reports' noise.
    text = f"{name} {again}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "big")


def sample(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` from draws ``[A, N, D]`` in [0, 1), D = ``scenario.dimensions``,
    and which of them meet the scenario's conditions, ``[N]``.

    Each takes the first of A attempts that meets them, else its last.

    Raises:
        EncounterError: a sampler of the user's own fails, or returns something else.
    """
    encounter, accepted = _attempt(scenario, draws[0], xp)
    for number in range(1, draws.shape[0]):
        if xp.__name__ == "numpy" and accepted.all():
            break
        redrawn, redrawn_accepted = _attempt(scenario, draws[number], xp)
        encounter = choose(accepted, encounter, redrawn, xp)
        accepted = xp.logical_or(accepted, redrawn_accepted)
    return encounter, accepted


def _attempt(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return the encounters of one attempt, draws ``[N, D]``, and which of them meet the
    conditions, ``[N]``.
    """
    ours, first = ships(scenario), scenario.width(scenario.sampler)
    start = scenario.sampler.encounters if ours else _own_encounters
    encounter, accepted = start(scenario, draws[:, :first], xp)
    for modifier in scenario.modifiers:
        last = first + scenario.width(modifier)
        changed, fits = modifier.change(scenario, encounter, draws[:, first:last], xp)
        _check_apart(scenario, modifier, encounter, changed)
        # The conditions of the toolkit's geometry say nothing of intruders that are elsewhere now.
        accepted = fits if ours and modifier.moves else xp.logical_and(accepted, fits)
        encounter, first = changed, last
    if xp.__name__ != "numpy":
        check_training(scenario, encounter)
    return encounter, accepted


def _check_apart(
    scenario: Scenario, modifier: Modifier, before: Encounter, after: Encounter
) -> None:
    """Refuse a modifier that sets what the sampler has set already."""
    for name in ("coverage", "separation", "reaction", "altitudes"):
        value = getattr(before, name)
        if value is not None and getattr(after, name) is not value:
            raise EncounterError(
                f"scenario {scenario.name!r}: both its sampler and modifier {modifier.name} set "
                f"{name}; expected one of them"
            )


def check_modifiers(scenario: Scenario, encounter: Encounter) -> None:
    """Refuse encounters ``[N]``, numpy, of a sampler of the user's own that does not heed the
    numbers of a modifier.
    """
    if not encounter.goal_x.size:
        return
    for modifier in scenario.modifiers:
        if modifier.heeded is not None and not np.any(modifier.heeded(encounter)):
            numbers = ", ".join(modifier.numbers(scenario.aircraft))
            raise EncounterError(
                f"scenario {scenario.name!r}: its sampler does not heed modifier {modifier.name}; "
                f"expected one that uses {numbers} (envs.encounters.one_turn, sensor_of)"
            )


def _own_encounters(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return what a sampler of the user's own draws, as :func:`_attempt`."""
    try:
        drawn = scenario.sampler.encounters(scenario, draws, xp)
    except EncounterError:
        raise
    except Exception as problem:
        raise EncounterError(
            f"scenario {scenario.name!r}: its sampler {failure(problem)}"
        ) from problem
    _check_shapes(scenario, drawn, draws.shape[0])
    return drawn


def check_training(scenario: Scenario, encounter: Encounter) -> None:
    """Refuse encounters with what only evaluations know."""
    if any(getattr(encounter, name) is not None for name in ("wind", "areas", "altitudes")):
        raise EncounterError(
            f"scenario {scenario.name!r} has a wind, areas or altitudes of its own; expected an "
            "evaluation that heeds them (eval.monte_carlo)"
        )


def _check_shapes(scenario: Scenario, drawn: object, count: int) -> None:
    """Refuse what a sampler returned unless it is encounters ``[count]`` and a mask of them."""
    where = f"scenario {scenario.name!r}: its sampler returns"
    if not (isinstance(drawn, tuple) and len(drawn) == 2 and isinstance(drawn[0], Encounter)):
        raise EncounterError(
            f"{where} {type(drawn).__name__}; expected an envs.encounters.Encounter and which of "
            "its rows are accepted"
        )
    encounter, accepted = drawn
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
    if encounter.altitudes is not None:
        altitudes = encounter.altitudes
        _check_shape(f"{where} altitudes.own", altitudes.own, (count,))
        rows = max(2, *getattr(altitudes.intruders, "shape", ())[-1:])
        _check_shape(f"{where} altitudes.intruders", altitudes.intruders, (*wide, rows))
        for name in ("too_high", "stated_error"):
            if getattr(altitudes, name) is not None:
                _check_shape(f"{where} altitudes.{name}", getattr(altitudes, name), wide)


def _check_shape(where: str, tree: Any, expected: tuple[int, ...]) -> None:
    """Refuse an array, or a named tuple of arrays, of another shape."""
    if hasattr(tree, "_fields"):
        for name, field in tree._asdict().items():
            _check_shape(f"{where}.{name}", field, expected)
        return
    shape = getattr(tree, "shape", type(tree).__name__)
    if shape != expected:
        raise EncounterError(f"{where} of shape {shape}; expected {expected}")
