"""Phantom types: parameters of a type that say what it is, such as its frame (:mod:`envs.frames`),
and that exist for the type checker alone.

A parameter has a default, so that what says nothing is of a type of its own, which fits no other.
Python 3.11 has no such parameters; at run time the default is left out.
"""

import typing
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import TypeVar
else:

    def _without_default(name: str, *, default: type) -> typing.TypeVar:
        """Return a parameter of a type by its name alone."""
        return typing.TypeVar(name)

    TypeVar = _without_default


__all__ = ["TypeVar"]
