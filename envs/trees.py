"""Nested tuples of arrays, such as encounters, states and manoeuvres, handled as one."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from envs.arrays import Array, ArrayModule

T = TypeVar("T")


class Shared(Generic[T]):
    """Something without rows in a tree: every row has the same, and it stays as it is."""

    __slots__ = ("value",)

    def __init__(self, value: T) -> None:
        self.value = value


def map_leaves(function: Callable[..., Any], tree: T, *others: T) -> T:
    """Apply a function to the arrays at the same place of nested tuples of one structure, and
    return what it gives in that structure; None and what is shared stay.
    """
    if tree is None or isinstance(tree, Shared):
        return tree
    if isinstance(tree, tuple):
        untyped: Any = others
        parts = [map_leaves(function, *leaves) for leaves in zip(tree, *untyped, strict=True)]
        result: Any = type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
        return result
    return function(tree, *others)


def take(tree: T, index: Any) -> T:
    """Return some rows of every array ``[N, ...]``: one by its number, or several by a slice,
    indices or a mask.
    """
    result: Any = tree
    # Not by map_leaves, which is slower: a plan takes rows thirty times.
    if isinstance(tree, tuple):
        parts = [take(field, index) for field in tree]
        result = type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    elif tree is not None and not isinstance(tree, Shared):
        result = np.asarray(tree)[index]
    return result


def contiguous(tree: T) -> T:
    """Return every array as compiled code takes it: contiguous and writeable, of booleans or of
    floats.
    """
    result: Any = tree
    if isinstance(tree, np.ndarray):
        if not (tree.flags.carray and tree.dtype.char in "d?"):
            result = np.array(tree, dtype=bool if tree.dtype == bool else float, order="C")
    elif isinstance(tree, tuple):  # not by map_leaves, which is slower
        parts = [contiguous(field) for field in tree]
        result = type(tree)(*parts) if hasattr(tree, "_fields") else tuple(parts)
    return result


def column(tree: T) -> T:
    """Return every array ``[N]`` as a column ``[N, 1]``, to be set against intruders ``[N, K]``."""
    return map_leaves(lambda field: field[:, None], tree)


def choose(condition: Array, yes: T, no: T, xp: ArrayModule) -> T:
    """Return arrays ``[N, ...]`` that hold ``yes`` where the condition ``[N]`` holds and else
    ``no``.
    """

    def either(a: Array, b: Array) -> Array:
        return xp.where(condition.reshape(condition.shape + (1,) * (a.ndim - condition.ndim)), a, b)

    return map_leaves(either, yes, no)


def first_rows(owners: np.ndarray, *keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the owners of rows, ascending and each once, and the number of each one's first row,
    ``[M]`` each.

    Which row is the first is decided by the last of the keys, ``[N]`` each, and where rows are
    alike in it by the key before; rows alike in all keys stay in order. The rows' owners are
    ``[N]``.
    """
    order = np.lexsort((*keys, owners))
    owner = owners[order]
    begins = np.ones(owner.size, dtype=bool)  # not np.unique: it sorts once more
    np.not_equal(owner[1:], owner[:-1], out=begins[1:])
    return owner[begins], order[begins]


def scatter(into: Any, rows: Any, values: Any) -> None:
    """Write a tree of values into some rows of every array of a tree, in place."""

    def write(old: np.ndarray, new: Array) -> None:
        old[rows] = new

    map_leaves(write, into, values)
