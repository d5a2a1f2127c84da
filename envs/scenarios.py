"""Scenarios of the user's own: a sampler that a module defines, beside those that ship.

A sampler is a row of the table of scenarios, in the form of :data:`envs.encounters.SHIPPED`. It
comes in by a call (:func:`register`) or by a name of the form ``module:name`` that the user writes
in a configuration, an option or a call (:func:`resolve`). A policy file names the scenarios that it
was trained with; reading it imports nothing.
"""

from envs.encounters import SAMPLERS, Sampler

__all__ = ["register", "resolve"]


def register(name: str, sampler: Sampler) -> Sampler:
    """Make a sampler of the user's own known in this process under a name, and return it.

    One of the same name is replaced, as when a notebook's cell is run again.

    Raises:
        EncounterError: it is no sampler, or a scenario of that name ships.
    """
    return SAMPLERS.register(name, sampler)


def resolve(name: str) -> Sampler:
    """Return the sampler that the user names; ``module:name`` is loaded and registered.

    Call this only with what the user has written by hand, never with what a policy file says.

    Raises:
        EncounterError: there is no such sampler, or it cannot be used.
    """
    return SAMPLERS.resolve(name)
