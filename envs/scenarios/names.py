"""The names of scenarios: a geometry, and modifiers of it after ``+``.

``circle + standing + partly_seen`` is the geometry ``circle`` with two modifiers, whose order does
not matter. A geometry is a row of the table of scenarios (:data:`SHIPPED`) or a sampler of the
user's own, which comes in by a call (:func:`register`) or by a name of the form ``module:name``
that the user writes in a configuration, an option or a call (:func:`resolve`). A policy file names
the scenarios that it was trained with; reading it imports nothing.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

from commands.extension import is_extension
from commands.names import one_of
from commands.registry import Registry
from envs.aircraft import Aircraft
from envs.encounters import MOST_INTRUDERS, EncounterError, Modifier, Sampler, Scenario
from envs.scenarios.table import MODIFIERS, SCENARIOS, SHIPPED

_OWN = "module:name of your own"


class _Parts(NamedTuple):
    """What a name consists of."""

    geometry: str
    modifiers: tuple[str, ...]  # in the order of the table

    @property
    def name(self) -> str:
        """The name with its modifiers in their order."""
        return " + ".join((self.geometry, *self.modifiers))


def _parse(name: str, more: str = _OWN) -> _Parts:
    """Return the parts of a scenario's name; nothing is imported.

    Raises:
        EncounterError: a part is unknown, or two do not go together; ``more`` ends the list of
            geometries.
    """
    geometry, *words = (word.strip() for word in name.split("+"))
    if geometry in MODIFIERS:
        raise EncounterError(
            f"scenario {name!r} begins with a modifier; expected a geometry before it, such as "
            f"circle + {geometry}"
        )
    if geometry not in SAMPLERS and not is_extension(geometry):
        raise EncounterError(f"scenario {geometry!r} is unknown; {_expected(geometry, more)}")
    for word in words:
        if word in SAMPLERS or is_extension(word):
            raise EncounterError(
                f"scenario {name!r} names two geometries, {geometry} and {word}; expected one of "
                f"them, and modifiers: {', '.join(MODIFIERS)}"
            )
        if word not in MODIFIERS:
            raise EncounterError(f"modifier {word!r} is unknown; {one_of(word, MODIFIERS)}")
    always = SAMPLERS.find(geometry).modifiers if geometry in SAMPLERS else ()
    _check_together(name, [MODIFIERS[word] for word in (*always, *words)])
    return _Parts(geometry, tuple(word for word in MODIFIERS if word in words))


def _expected(word: str, more: str) -> str:
    """Return the end of a refusal of a geometry."""
    return one_of(word, (*SCENARIOS, *SAMPLERS.own), more)


def _check_together(name: str, modifiers: Iterable[Modifier]) -> None:
    """Refuse a modifier that a scenario has twice, and two that decide the same."""
    decided = dict[str, str]()
    for modifier in modifiers:
        if modifier.name in decided.values():
            raise EncounterError(
                f"scenario {name!r} has modifier {modifier.name} twice; expected it once"
            )
        for part in modifier.decides or (modifier.name,):
            if part in decided:
                raise EncounterError(
                    f"scenario {name!r} has modifiers {decided[part]} and {modifier.name}, which "
                    f"both say {part}; expected one of them"
                )
            decided[part] = modifier.name


def canonical(name: str, more: str = _OWN) -> str:
    """Return a scenario's name with its modifiers in their order; nothing is imported.

    Raises:
        EncounterError: there is none of that name; ``more`` says what else is expected.
    """
    return _parse(name, more).name


def expected(more: str = _OWN) -> str:
    """Return in words which names there are; ``more`` ends the list of geometries."""
    return f"one of {', '.join(SCENARIOS)}, {more}; with + and modifiers: {', '.join(MODIFIERS)}"


def is_loaded(name: str) -> bool:
    """Return whether the geometry that a name begins with ships or has been registered."""
    return _parse(name).geometry in SAMPLERS


def register(name: str, sampler: Sampler) -> Sampler:
    """Make a sampler of the user's own known in this process under a name, and return it.

    One of the same name is replaced, as when a notebook's cell is run again.

    Raises:
        EncounterError: it is no sampler, or a scenario of that name ships.
    """
    return SAMPLERS.register(name, sampler)


def resolve(name: str) -> Sampler:
    """Return the sampler of the geometry that the user names; ``module:name`` is loaded and
    registered.

    Call this only with what the user has written by hand, never with what a policy file says.

    Raises:
        EncounterError: there is no such sampler, or it cannot be used.
    """
    return SAMPLERS.resolve(_parse(name).geometry)


def scenario(name: str, aircraft: Aircraft, **changes: Any) -> Scenario:
    """Return a scenario by its name, such as ``circle + noise``, scaled by the aircraft, with some
    of its fields changed.

    Lengths are in separations, speeds in ``speed_max``, latencies in time steps; for the paper's
    aircraft the numbers are the paper's.

    Raises:
        EncounterError: the name is unknown, or a field contradicts the aircraft; the message begins
            with the field.
    """
    sampler, parts = sampler_of(name), _parse(name)
    words = *sampler.modifiers, *parts.modifiers
    modifiers = tuple(modifier for word, modifier in MODIFIERS.items() if word in words)
    separation, limits = aircraft.separation, aircraft.limits
    # An aircraft that can stand still would never arrive at the conflict point.
    speeds = (max(limits.speed_min, 0.2 * limits.speed_max), limits.speed_max)
    circle = Scenario(
        parts.name,
        sampler,
        aircraft,
        radius=(3.0 * separation, 10.0 * separation),
        own_speed=speeds,
        intruder_speed=speeds,
        displacement=0.5 * separation,
        min_initial_separation=separation,
        modifiers=modifiers,
        together=sampler.together and not parts.modifiers,
    )
    numbers = dict(sampler.numbers(aircraft))
    for modifier in modifiers:
        numbers |= modifier.numbers(aircraft)
    chosen = replace(circle, **{**numbers, **changes})
    _check(chosen)
    return chosen


def sampler_of(name: str) -> Sampler:
    """Return the sampler of a scenario's geometry, which ships or has been registered; nothing is
    imported.

    Raises:
        EncounterError: there is none of that name.
    """
    geometry = _parse(name).geometry
    if geometry not in SAMPLERS:
        raise EncounterError(
            f"scenario {geometry!r} is not part of the toolkit and has not been loaded; expected "
            f"--extension {geometry}, the key extensions: [{geometry}], or "
            f"envs.scenarios.resolve({geometry!r})"
        )
    return SAMPLERS.find(geometry)


def _check(chosen: Scenario) -> None:
    """Refuse a scenario with a field that contradicts its aircraft."""
    aircraft, limits = chosen.aircraft, chosen.aircraft.limits
    full_turn = 2.0 * math.pi
    speeds = "the speeds of the aircraft"
    for name, low, high, why in (
        ("radius", 0.1 * aircraft.separation, 1e3 * aircraft.separation, "0.1 to 1000 separations"),
        ("own_speed", limits.speed_min, limits.speed_max, speeds),
        ("intruder_speed", 0.0, aircraft.traffic_speed_max, "the speeds of its traffic"),
        ("course_difference", -full_turn, full_turn, "radians"),
        ("intruders", 1, MOST_INTRUDERS, "that an encounter can have"),
        ("latency", 0.0, 2.0 * aircraft.dt, "two time steps of the aircraft"),
        ("vertical_rate", 0.0, 100.0, "vertical speeds of aircraft"),
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
        ("vertical_miss", 20_000.0),
    ):
        value = getattr(chosen, name)
        if not 0.0 <= value <= high:
            expected = f"0 to {high:g}" if math.isfinite(high) else "a number at least 0"
            raise EncounterError(f"{name} is {value:g}; expected {expected}")


def _check_sampler(name: str, sampler: Sampler) -> None:
    """Refuse a sampler of the user's own that cannot be used, and a name that cannot be written."""
    if "+" in name:
        raise EncounterError(f"scenario {name!r}: expected a name without +, which adds modifiers")
    if name in MODIFIERS:
        raise EncounterError(f"scenario {name!r} is a modifier; expected another name")
    for key in ("shared", "per_intruder"):
        count: object = getattr(sampler, key)
        if not isinstance(count, int) or count < 0:
            raise EncounterError(
                f"scenario {name!r}: {key} is {count!r}; expected how many draws it takes"
            )
    for word in sampler.modifiers:
        if word not in MODIFIERS:
            raise EncounterError(
                f"scenario {name!r}: modifier {word!r} is unknown; {one_of(word, MODIFIERS)}"
            )
    _check_together(name, [MODIFIERS[word] for word in sampler.modifiers])


SAMPLERS: Registry[Sampler] = Registry(
    "scenario",
    "a scenario (envs.encounters.Sampler)",
    Sampler,
    EncounterError,
    SHIPPED,
    _check_sampler,
)
"""The samplers of all scenarios that this process knows, by name."""
