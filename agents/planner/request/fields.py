"""Values of a request, checked one by one: each refusal names the field, the value and what was
expected.
"""

import itertools
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from agents.planner.answer import Field, RequestError
from envs.kinematics import VehicleState

_LONGEST_TEXT = 60  # of a value in a message


def sequence(name: Field | str, value: Any) -> Sequence[Any]:
    """Return a sequence that is neither a text nor a single state; raise RequestError if it is
    none.
    """
    if isinstance(value, (str, bytes, VehicleState)) or not isinstance(value, Sequence):
        raise RequestError(name, f"is {type(value).__name__}, expected a sequence")
    return value


def quote(value: Any) -> str:
    """Return a value for a message, however long or odd it is."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**18:
        return "an integer of more than 18 digits"
    text = repr(value)
    return text if len(text) <= _LONGEST_TEXT else text[:_LONGEST_TEXT] + "..."


def listed(names: Collection[str], most: int = 5) -> str:
    """Return names with commas, the first of them where there are many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(itertools.islice(names, most)) + more


def part_value(of: Field, name: str, value: Any, low: float, high: float, unit: str) -> float:
    """Return what :func:`real` does for a part of a field, which is named only if it is refused."""
    if type(value) is float and low <= value <= high:
        return value
    return real(of.part(name), value, low, high, unit)


def real(name: Field | str, value: Any, low: float, high: float, unit: str) -> float:
    """Return a number in [low, high] as a plain float; raise RequestError, which names it, if it is
    none.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise RequestError(name, f"is {quote(value)}, expected a number")
    try:
        result = float(value)
    except OverflowError:
        raise RequestError(
            name, f"is {quote(value)}, expected {low:g} to {high:g} {unit}"
        ) from None
    # NaN fails every comparison.
    if not low <= result <= high:
        raise RequestError(name, f"is {result:g}, expected {low:g} to {high:g} {unit}")
    return result
