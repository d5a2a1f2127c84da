"""When an intruder counts: while it may be nearer above or below than its vertical separation.

Altitudes change evenly, each known within an error that grows evenly, so that the times at which
two may be level are one window (theorem ``apart_vertically`` of proofs/Level.v). What is unknown is
as bad as it may be.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

_ROUNDING = 1e-6
"""m by which the separation at the ends of a window is more than required, for rounding's sake."""

ALWAYS = -math.inf, math.inf


@dataclass(frozen=True, slots=True)
class Altitude:
    """A height, comparable only with others of the same reference."""

    value: float
    """m."""
    reference: str
    """Such as ``"wgs84"``, ``"msl"``, ``"pressure"``."""
    vertical_speed: float | None = None
    """m/s, positive upwards; None: unknown, which counts as ``Options.unknown_climb`` either way.
    """
    error: float = 0.0
    """By how much the value may be off either way, m."""
    climb_error: float = 0.0
    """By how much the vertical speed may be off either way where it is known, m/s."""

    def climb(self, unknown_climb: float) -> tuple[float, float]:
        """Return the vertical speed and its error, m/s."""
        if self.vertical_speed is None:
            return 0.0, unknown_climb
        return self.vertical_speed, self.climb_error


class Heights(NamedTuple):
    """Two altitudes that are as near as they may be: the true ones are farther apart, or as far."""

    own: float  # m
    own_climb: float  # m/s
    other: float  # at its report, m
    other_climb: float  # m/s
    age: float  # of the report at the request, s


class Apart(NamedTuple):
    """A time in which an intruder stays above or below."""

    begin: float  # s after the request
    end: float
    heights: Heights


def window(
    own: Altitude | None, other: Altitude | None, age: float, vertical: float, unknown_climb: float
) -> tuple[float, float]:
    """Return from when and until when another aircraft counts, s after the request, or
    :data:`ALWAYS`; the first is greater, or infinite, where it never does after the request.

    Args:
        own: as of now; None: unknown, which counts as level.
        other: as of ``age`` seconds ago.
        vertical: separation beyond which it does not count, m.
        unknown_climb: vertical speed either way of an aircraft whose own is unknown, m/s.
    """
    if own is None or other is None or own.reference != other.reference:
        return ALWAYS
    climb, own_spread = own.climb(unknown_climb)
    rise, spread = other.climb(unknown_climb)
    above = other.value + rise * age - own.value
    rate, widens = rise - climb, own_spread + spread
    level = vertical + _ROUNDING + own.error + other.error + spread * abs(age)
    begin, end = ALWAYS
    # It counts while |above + rate t| <= level + widens t.
    for side in (1.0, -1.0):
        gap, opening = side * above - level, side * rate - widens
        if gap <= 0.0:
            end = min(end, -gap / opening if opening > 0.0 else math.inf)
        else:
            begin = max(begin, -gap / opening if opening < 0.0 else math.inf)
    return begin, end


def apart(
    own: Altitude, other: Altitude, age: float, vertical: float, unknown_climb: float, until: float
) -> Iterator[Apart]:
    """Yield the times from the request until some time, s, in which another aircraft stays above or
    below; arguments are as of :func:`window`.
    """
    begin, end = window(own, other, age, vertical, unknown_climb)
    climb, rise = own.climb(unknown_climb)[0], other.climb(unknown_climb)[0]
    for first, last, at in ((0.0, min(begin, until), 0.0), (max(end, 0.0), until, max(end, 0.0))):
        if first < last:
            above = other.value + rise * (age + at) - (own.value + climb * at)
            yield Apart(first, last, worst(own, other, age, above > 0.0, unknown_climb))


def worst(own: Altitude, other: Altitude, age: float, above: bool, unknown_climb: float) -> Heights:
    """Return two altitudes as near as they may be where the other one is above, or else below."""
    up = 1.0 if above else -1.0
    climb, own_spread = own.climb(unknown_climb)
    rise, spread = other.climb(unknown_climb)
    return Heights(
        own.value + up * own.error,
        climb + up * own_spread,
        # As of its report, so that its error has grown for the report's age at the request.
        other.value - up * (other.error + spread * (abs(age) - age)),
        rise - up * spread,
        age,
    )


def vertical_gap(
    own: Altitude, other: Altitude, age: float, horizon: float, unknown_climb: float
) -> float:
    """Return by how much another aircraft stays above the ownship for a time, s, or below it where
    negative, m; 0 where they may pass each other or cannot be compared.

    Arguments are as of :func:`window`, ``horizon`` is in s.
    """
    if own.reference != other.reference:
        return 0.0
    rise, spread = other.climb(unknown_climb)
    above = other.value + rise * age - own.value
    if abs(above) <= own.error + other.error + spread * abs(age):
        return 0.0
    heights = worst(own, other, age, above > 0.0, unknown_climb)
    gap = heights.other + heights.other_climb * age - heights.own
    later = gap + (heights.other_climb - heights.own_climb) * horizon
    return min(gap, later, key=abs) if gap * later > 0.0 else 0.0
