"""Reads the roles of our docstrings (``:func:`size```) as links, and double backticks as code."""

import re
from typing import Any

import griffe

_ROLE = re.compile(r":(?:attr|class|data|exc|func|meth|mod):`~?([\w.]+)`")


class Roles(griffe.Extension):
    """Rewrites docstrings before they are parsed."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Rewrite every docstring of a package, when all its names are known."""
        _rewrite(pkg)


def _rewrite(item: griffe.Object) -> None:
    if item.docstring is not None:
        scope = item
        item.docstring.value = _ROLE.sub(lambda role: _reference(role[1], scope), item.docstring.value)
    for member in item.members.values():
        if not member.is_alias:
            _rewrite(member)  # pyright: ignore[reportArgumentType]


def _reference(name: str, scope: griffe.Object) -> str:
    """Return a link to a public name where there is one, else the name as code."""
    try:
        first, _, rest = name.partition(".")
        path = scope.resolve(first) + (f".{rest}" if rest else "")
    except griffe.NameResolutionError:
        path = name
    try:
        found = scope.modules_collection[path]
    except KeyError:
        return f"`{name}`"
    return f"[`{name}`][{path}]" if found.is_public else f"`{name}`"
