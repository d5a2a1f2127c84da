"""Altitudes: intruders that stay above or below, and whose altitudes are stated in one way."""

from bisect import bisect_left
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

from .balls import BITS, ZERO, Ball, ball, real
from .certificate import Certificate, Heights
from .profile import pieces_of, spread_of
from .refusal import Work, demand
from .tolerances import LEVEL

_LONG_AFTER = real(1 << (BITS + 30))  # s
_LONG_BEFORE = ZERO - _LONG_AFTER


class Line(NamedTuple):
    """A part of the flight in which the ownship's altitude changes evenly, between two levels."""

    begin: Ball  # s after the request
    end: Ball
    low: Ball  # m, as of the request: the line goes on to both sides
    low_climb: Ball  # m/s
    high: Ball
    high_climb: Ball

    def nearest(self, side: int, t: Ball) -> Ball:
        """Return the highest level (side 1) or the lowest (-1) at a time, m."""
        return self.high + self.high_climb * t if side > 0 else self.low + self.low_climb * t


def own_lines(certificate: Certificate) -> list[Line]:
    """Return between which levels the ownship is: always, line after line; empty: unknown."""
    levels, profile = certificate.levels, certificate.profile
    if levels is None:
        return []
    if profile is None:
        return [Line(_LONG_BEFORE, _LONG_AFTER, *map(ball, levels))]
    spread, lines = spread_of(profile, levels), list[Line]()
    for begin, end, altitude, climb in pieces_of(certificate, profile, levels):
        level = altitude - climb * begin
        lines.append(Line(begin, end, level - spread, climb, level + spread, climb))
    lines[0] = lines[0]._replace(begin=_LONG_BEFORE)
    lines[-1] = lines[-1]._replace(end=_LONG_AFTER)
    return lines


def lines_between(
    lines: list[Line], begin: Ball, end: Ball
) -> Iterator[tuple[Line, tuple[Ball, Ball]]]:
    """Yield the lines that some time has a part of, each with the two ends of that part, s."""
    start = bisect_left(lines, begin.lo, key=lambda line: line.end.hi)
    for line in islice(lines, start, None):
        if line.begin.lo > end.hi:
            return
        yield line, (real(max(begin.lo, line.begin.lo)), real(min(end.hi, line.end.hi)))


def check_altitudes(certificate: Certificate, lines: list[Line], work: Work) -> None:
    """Check that intruders stay above or below while they are said to, and that all that is said of
    their altitudes and of the ownship's is the same.

    Args:
        lines: of the ownship's altitude.
    """
    for heights in certificate.excluded:
        why = "an excluded intruder does not stay above or below"
        check_heights("excluded", heights, (0.0, certificate.end), lines, why, work)
    sides: dict[tuple[int, int], Heights] = {}
    for number, begin, end, heights in certificate.apart:
        name = f"intruder {number}"
        why = f"{name} does not stay above or below from {begin:.2f} s on"
        side = check_heights("apart", heights, (begin, end), lines, why, work)
        as_reported = heights.age == certificate.reports[number].age
        demand(as_reported, f"the age of {name} in apart is not that in intruders")
        # What is said of the ownship differs from line to line.
        reported = heights._replace(own=0.0, own_climb=0.0)
        same = sides.setdefault((number, side), reported) == reported
        demand(same, f"{name} has more than one altitude in apart")
    check_both_sides(sides)


def check_both_sides(sides: dict[tuple[int, int], Heights]) -> None:
    """Check that intruders that are above at a time and below at another have one altitude.

    Args:
        sides: heights by an intruder's number and its side, as of :func:`side_of`.
    """
    for (number, side), above in sides.items():
        below = sides.get((number, -side), above)
        # As near as it may be it is at its lowest where it is above, at its highest where below.
        ordered = above.other <= below.other and above.other_climb <= below.other_climb
        same = above.vertical == below.vertical
        demand(
            (side < 0 or ordered) and same, f"intruder {number} has more than one altitude in apart"
        )


def side_of(heights: Heights, begin: float, end: float) -> int:
    """Return on which side of the ownship an intruder stays from a time to another, s: 1 above, -1
    below, 0 where it may not stay apart.

    Altitudes change evenly, so that both ends decide (theorem ``apart_vertically``).
    """
    first = other_at(heights, ball(begin)) - stated_at(heights, ball(begin))
    last = other_at(heights, ball(end)) - stated_at(heights, ball(end))
    vertical = ball(heights.vertical).hi
    if min(first.lo, last.lo) >= vertical:
        return 1
    return -1 if max(first.hi, last.hi) <= -vertical else 0


def stated_at(heights: Heights, t: Ball) -> Ball:
    """Return the altitude at a time that is stated of the ownship, m."""
    return ball(heights.own) + ball(heights.own_climb) * t


def other_at(heights: Heights, t: Ball) -> Ball:
    """Return the altitude of an intruder at a time, m."""
    return ball(heights.other) + ball(heights.other_climb) * (ball(heights.age) + t)


def check_heights(
    name: str,
    heights: Heights,
    time: tuple[float, float],
    lines: list[Line],
    why: str,
    work: Work,
) -> int:
    """Check that an intruder stays on a side of the ownship from a time to another, s, and that the
    ownship is stated as near to it as its levels and profile allow; return the side.

    The intruder is apart from what they allow, whatever is stated (theorem ``piece_apart``).

    Args:
        name: of the field with the heights.
        lines: of the ownship's altitude.
        why: the certificate is refused where the intruder is not apart.
    """
    side = side_of(heights, *time)
    demand(side != 0, why)
    demand(bool(lines), f"{name} has another altitude of the ownship than levels")
    vertical, begin, end = ball(heights.vertical).hi, *map(ball, time)
    for line, ends in lines_between(lines, begin, end):
        work.spend(1)
        for t in ends:
            own = line.nearest(side, t)
            same = (stated_at(heights, t) - own).magnitude().hi <= ball(LEVEL).lo
            demand(same, f"{name} has another altitude of the ownship than levels")
            gap = other_at(heights, t) - own
            demand((gap.lo if side > 0 else -gap.hi) >= vertical, why)
    return side
