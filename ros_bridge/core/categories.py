"""Separations by emitter category, as ADS-B has it: a heavy, a balloon and a drone need different
ones.

A category goes by its letter and digit in parameters and by one number in messages: 8 times the
place of its letter, and its digit, which are also the codes of MAVLink's ADSB_EMITTER_TYPE.
"""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from ros_bridge.core.fields import FieldError

LAST = 23
"""The greatest number of a category."""

_NAME = re.compile(r"([A-C])([0-7])")
_LEAST, _MOST = 1.0, 1e6  # m of a separation


class Categories(NamedTuple):
    """What is kept from aircraft of a category, m, by its number; of others what is kept from
    all.
    """

    separations: Mapping[int, float] = MappingProxyType({})
    vertical: Mapping[int, float] = MappingProxyType({})

    def greatest(self, separation: float, vertical: float) -> tuple[float, float]:
        """Return the greatest separations, horizontal and vertical, beside the usual ones, m."""
        return (
            max(separation, *self.separations.values(), 0.0),
            max(vertical, *self.vertical.values(), 0.0),
        )


BY_CATEGORY = "separations by category, m"
"""What the nodes' diagnostics call them."""

NO_CATEGORIES = Categories()
"""The same from all."""


def number_of(name: object) -> int:
    """Return the number of a category such as A5; 0, unknown, for what is none, and for A0, B0 and
    C0, which say nothing.
    """
    match = _NAME.fullmatch(name.strip().upper()) if isinstance(name, str) else None
    if match is None or match[2] == "0":
        return 0
    return 8 * "ABC".index(match[1]) + int(match[2])


def text_of(separations: Mapping[int, float]) -> str:
    """Return separations by category, m, as a text that :func:`separations_of` reads."""
    return ",".join(
        f"{'ABC'[number // 8]}{number % 8}:{metres:g}" for number, metres in separations.items()
    )


def separations_of(parameter: str, text: str) -> dict[int, float]:
    """Return separations by category, m, from a text such as ``A5:2000, B6:300``.

    Raises:
        FieldError: it is none; the message begins with the parameter's name.
    """
    by_category: dict[int, float] = {}
    for part in text.split(",") if text.strip() else ():
        name, _, value = part.partition(":")
        category = number_of(name)
        try:
            metres = float(value)
        except ValueError:
            metres = math.nan
        if not category or not _LEAST <= metres <= _MOST:
            raise FieldError(
                parameter,
                f"holds {part.strip()!r:.60}, expected a category (A1 to C7), a colon and "
                f"{_LEAST:g} to {_MOST:g} m, such as A5:2000",
            )
        if category in by_category:
            raise FieldError(
                parameter, f"names {name.strip().upper()} twice, expected each category once"
            )
        by_category[category] = metres
    return by_category
