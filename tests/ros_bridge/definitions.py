"""Messages of other packages as classes made from the text of their definitions (``interfaces/README.md``)."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).resolve().parent / "interfaces"
_NUMBERS = {
    **{f"{sign}int{bits}": int for sign in ("", "u") for bits in (8, 16, 32, 64)},
    "float32": lambda value: float(np.float32(value)),
    "float64": float,
    "bool": bool,
    "string": str,
}


def message(package: str, name: str, **fields: Any) -> Any:
    """Return a message of ``package/name``; fields that it does not have are refused."""
    return _kind(package, name)(**fields)


@cache
def fields_of(package: str, name: str) -> dict[str, str]:
    """Return the types of a message's fields by their names, packages written out."""
    result = {}
    for line in _lines(package, name):
        if "=" not in line:
            kind, field, *_ = line.split()
            result[field] = kind if kind in _NUMBERS or "/" in kind else f"{package}/{kind}"
    return result


def _lines(package: str, name: str) -> list[str]:
    text = (FOLDER / package / "msg" / f"{name}.msg").read_text(encoding="utf-8")
    return [line for line in (raw.partition("#")[0].strip() for raw in text.splitlines()) if line]


@cache
def _kind(package: str, name: str) -> type:
    types = fields_of(package, name)
    constants = {}
    for line in _lines(package, name):
        left, equals, value = line.partition("=")
        if equals:
            kind, constant = left.split()
            constants[constant] = _NUMBERS[kind](value.strip())

    class Message:
        __slots__ = tuple(types)

        def __init__(self, **given: Any) -> None:
            for field, kind in types.items():
                empty = _NUMBERS[kind](0) if kind in _NUMBERS else message(*kind.split("/"))
                setattr(self, field, "" if kind == "string" else empty)
            for field, value in given.items():
                setattr(self, field, value)

        def __setattr__(self, field: str, value: Any) -> None:
            kind = types.get(field, "")
            object.__setattr__(self, field, _NUMBERS[kind](value) if kind in _NUMBERS else value)

    return type(name, (Message,), {"__slots__": (), **constants})
