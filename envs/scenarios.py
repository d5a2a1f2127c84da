"""Scenarios of the user's own: a sampler that a module defines, beside those that ship.

A sampler is a row of the table of scenarios, in the form of :data:`envs.encounters.SHIPPED`. It
comes in by a call (:func:`register`) or by a name of the form ``module:name`` that the user writes
in a configuration, an option or a call (:func:`resolve`). A policy file names the scenarios that it
was trained with; reading it imports nothing.
"""

from envs.edge.command import InputError
from envs.edge.extension import is_extension, load_extension
from envs.encounters import SHIPPED, EncounterError, Sampler, is_known, registered, sampler_of

__all__ = ["register", "resolve"]

_WHAT = "a scenario (envs.encounters.Sampler)"


def register(name: str, sampler: Sampler) -> Sampler:
    """Make a sampler of the user's own known in this process under a name, and return it.

    One of the same name is replaced, as when a notebook's cell is run again.

    Raises:
        EncounterError: it is no sampler, or a scenario of that name ships.
    """
    if name in SHIPPED:
        raise EncounterError(f"scenario {name!r} ships; expected another name")
    if not isinstance(sampler, Sampler):
        raise EncounterError(
            f"scenario {name!r} is of type {type(sampler).__name__}; expected an "
            "envs.encounters.Sampler"
        )
    for key, least in (("shared", 0), ("each", 0)):
        count: object = getattr(sampler, key)
        if not isinstance(count, int) or count < least:
            raise EncounterError(
                f"scenario {name!r}: {key} is {count!r}; expected how many draws it takes"
            )
    registered[name] = sampler
    return sampler


def resolve(name: str) -> Sampler:
    """Return the sampler that the user names; ``module:name`` is loaded and registered.

    Call this only with what the user has written by hand, never with what a policy file says.

    Raises:
        EncounterError: there is no such sampler, or it cannot be used.
    """
    if is_known(name) or not is_extension(name):
        return sampler_of(name)
    try:
        loaded = load_extension(name, _WHAT)
    except InputError as problem:
        raise EncounterError(str(problem)) from problem.__cause__
    return register(name, loaded)
