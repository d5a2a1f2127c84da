"""Rows of nested tuples of arrays, such as encounters and states."""

from typing import Any, TypeVar

__all__ = ["rows"]

T = TypeVar("T")


def rows(tree: T, chosen: Any) -> T:
    """Return the chosen rows (a mask, indices or a slice of the first axis) of every array in nested tuples."""
    if isinstance(tree, tuple):
        parts = [rows(part, chosen) for part in tree]
        return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)
    return tree[chosen]  # type: ignore[index]
