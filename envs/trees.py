"""Nested tuples of arrays, such as encounters, states and manoeuvres, handled as one."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from envs.arrays import ArrayModule

T = TypeVar("T")


class Shared(Generic[T]):
    """Something without rows in a tree: every row has the same, and it stays as it is."""

    __slots__ = ("value",)

    def __init__(self, value: T) -> None:
        self.value = value


def map_leaves(function: Callable[..., Any], *trees: Any) -> Any:
    """Apply a function to the arrays at the same place of nested tuples of one structure; None
    and what is shared stay.
    """
    first = trees[0]
    if first is None or isinstance(first, Shared):
        return first
    if isinstance(first, tuple):
        parts = [map_leaves(function, *same) for same in zip(*trees, strict=True)]
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    return function(*trees)


def take(tree: T, index: Any) -> T:
    """Return some rows of every array: one by its number, or several by a slice, indices or
    a mask.
    """
    taken: Any = tree
    if isinstance(tree, tuple):  # not by mapped: a plan takes rows thirty times
        parts = [take(field, index) for field in tree]
        taken = type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    elif tree is not None and not isinstance(tree, Shared):
        taken = np.asarray(tree)[index]
    return taken


def column(tree: T) -> T:
    """Return every array ``[N]`` as a column ``[N, 1]``, to be set against intruders ``[N, K]``."""
    return map_leaves(lambda field: field[:, None], tree)


def choose(condition: Any, yes: T, no: T, xp: ArrayModule) -> T:
    """Return arrays ``[N, ...]`` that hold ``yes`` where the condition ``[N]`` holds and else
    ``no``.
    """

    def either(a: Any, b: Any) -> Any:
        return xp.where(condition.reshape(condition.shape + (1,) * (a.ndim - condition.ndim)), a, b)

    return map_leaves(either, yes, no)


def first_of_each(owners: Any, *keys: Any) -> tuple[Any, Any]:
    """Return, ascending, the owners ``[M]`` of rows ``[N]``, and the number of each one's first
    row by the keys ``[N]``, the last key before the others; rows alike in all stay in order.
    """
    order = np.lexsort((*keys, owners))
    owner = owners[order]
    begins = np.ones(owner.size, dtype=bool)  # not np.unique: it sorts once more
    np.not_equal(owner[1:], owner[:-1], out=begins[1:])
    return owner[begins], order[begins]


def scatter(into: Any, rows: Any, values: Any) -> None:
    """Write values into some rows of every array, in place."""

    def write(old: Any, new: Any) -> None:
        old[rows] = new

    map_leaves(write, into, values)
