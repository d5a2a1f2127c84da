"""When an intruder counts: while it may be nearer above or below than its vertical separation.

Altitudes change evenly, each known within an error that grows evenly, so that the times at which
two may be level are one window (theorem ``apart_vertically`` of proofs/Level.v). On a profile that
is so on each of its lines. What is unknown is as bad as it may be.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from envs.arrays import Array
from envs.profile import Profile

_ROUNDING = 1e-6
"""m by which the separation at the ends of a window is more than required, for rounding's sake."""

_JOINED = 1e-6  # s between times that are one

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


class Line(NamedTuple):
    """A part of a flight in which the altitude changes evenly."""

    begin: float  # s after the request
    end: float
    altitude: Altitude  # of the ownship, as of the request: the line goes on to both sides


class Heights(NamedTuple):
    """Two altitudes that are as near as they may be: the true ones are farther apart, or as far."""

    own: float  # m
    own_climb: float  # m/s
    other: float  # at its report, m
    other_climb: float  # m/s
    age: float  # of the report at the request, s


class Gap(NamedTuple):
    """How another aircraft is above the ownship, or below it where negative; floats, or arrays of
    one shape.
    """

    above: Array  # at the request, m
    climb: Array  # m/s
    near: Array  # so far above or below it must be at the request not to count, m; inf: it counts
    widens: Array  # by how much that grows, m/s


class Apart(NamedTuple):
    """A time in which an intruder stays above or below."""

    begin: float  # s after the request
    end: float
    heights: Heights


def steady(own: Altitude | None) -> tuple[Line, ...]:
    """Return a flight whose altitude goes on changing as at the request; none: it is unknown."""
    return () if own is None else (Line(*ALWAYS, own),)


def lines(profile: Profile, own: Altitude, margin: float) -> tuple[Line, ...]:
    """Return the lines of a profile that begins at an altitude and is flown within a margin, m."""
    ends = *profile.time[1:-1].tolist(), math.inf
    begins = -math.inf, *ends[:-1]
    altitude = replace(own, error=own.error + margin, climb_error=0.0)
    at_request = profile.altitude[:-1] - profile.climbs * profile.time[:-1]
    return tuple(
        Line(begin, end, replace(altitude, value=value, vertical_speed=climb))
        for begin, end, value, climb in zip(
            begins, ends, at_request.tolist(), profile.climbs.tolist(), strict=True
        )
    )


def level_times(
    flight: Sequence[Line],
    other: Altitude | None,
    age: float,
    vertical: float,
    unknown_climb: float,
) -> list[tuple[float, float]]:
    """Return the times after the request in which another aircraft counts, s, in order: those in
    which it may be nearer above or below than a separation.

    Args:
        flight: the ownship's; none: its altitude is unknown, which counts as level.
        other: these and the others as of :func:`window`.
    """
    if not flight:
        return [ALWAYS]
    return union(
        (max(begin, line.begin), min(end, line.end))
        for line in flight
        for begin, end in (window(line.altitude, other, age, vertical, unknown_climb),)
    )


def union(times: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return times after the request, from and until, s, that begin in ascending order, joined
    where they meet; what ends before it begins, or before the request, is left out.
    """
    joined = list[tuple[float, float]]()
    for begin, end in times:
        if begin > end or end < 0.0 or begin == math.inf:
            continue
        if joined and begin <= joined[-1][1] + _JOINED:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((begin, end))
    return joined


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
    gap = gap_between(own, other, age, vertical, unknown_climb)
    above, level = gap.above, gap.near
    rate, widens = gap.climb - climb, gap.widens + own_spread
    begin, end = ALWAYS
    # It counts while |above + rate t| <= level + widens t.
    for side in (1.0, -1.0):
        room, opening = side * above - level, side * rate - widens
        if room <= 0.0:
            end = min(end, -room / opening if opening > 0.0 else math.inf)
        else:
            begin = max(begin, -room / opening if opening < 0.0 else math.inf)
    return begin, end


def gap_between(
    own: Altitude, other: Altitude, age: float, vertical: float, unknown_climb: float
) -> Gap:
    """Return how another aircraft is above or below; arguments are as of :func:`window`, of one
    reference. What is unknown of the own climb is not in it.
    """
    climb, spread = other.climb(unknown_climb)
    return Gap(
        other.value + climb * age - own.value,
        climb,
        vertical + _ROUNDING + own.error + other.error + spread * abs(age),
        spread,
    )


def apart(
    flight: Sequence[Line],
    other: Altitude,
    age: float,
    vertical: float,
    unknown_climb: float,
    until: float,
) -> Iterator[Apart]:
    """Yield the times from the request until some time, s, in which another aircraft stays above or
    below, each on one line of the ownship's; arguments are as of :func:`level_times`.
    """
    rise = other.climb(unknown_climb)[0]
    for line_begin, line_end, own in flight:
        begin, end = window(own, other, age, vertical, unknown_climb)
        climb, start, stop = own.climb(unknown_climb)[0], max(line_begin, 0.0), min(line_end, until)
        for first, last in ((start, min(begin, stop)), (max(end, start), stop)):
            if first < last:
                above = other.value + rise * (age + first) - (own.value + climb * first)
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
