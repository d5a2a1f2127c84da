"""JSON as every reader of ours takes it: a key that stands twice in one object is refused.

JSON leaves open which of the two counts, so that two readers may see two plans in one file.
:mod:`agents.check`, which shares no code with what it checks, refuses them by itself.
"""

import json
from typing import Any


class RepeatedKeyError(ValueError):
    """A key stands twice in one object; the message names it."""


def parse_json(text: str | bytes) -> Any:
    """Return the value of a JSON text, NaN and Infinity allowed; raise ValueError where it is none.

    A ValueError is a ``json.JSONDecodeError`` or a :class:`RepeatedKeyError`.
    """
    return json.loads(text, object_pairs_hook=_distinct)


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise RepeatedKeyError(f"{twice[:40]!r} stands twice in one object")
    return mapping
