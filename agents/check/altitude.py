"""Altitudes: intruders that stay above or below, and whose altitudes are stated in one way."""

from .balls import ball
from .certificate import Certificate, Heights, Levels
from .refusal import demand


def check_altitudes(certificate: Certificate) -> None:
    """Check that intruders stay above or below while they are said to, and that all that is said of
    their altitudes and of the ownship's is the same.
    """
    for heights in certificate.excluded:
        side = side_of(heights, 0.0, certificate.end)
        demand(side != 0, "an excluded intruder does not stay above or below")
        check_own_altitude("excluded", heights, side, certificate.levels)
    sides: dict[tuple[int, int], Heights] = {}
    for number, begin, end, heights in certificate.apart:
        name = f"intruder {number}"
        side = side_of(heights, begin, end)
        demand(side != 0, f"{name} does not stay above or below from {begin:.2f} s on")
        check_own_altitude("apart", heights, side, certificate.levels)
        as_reported = heights.age == certificate.reports[number].age
        demand(as_reported, f"the age of {name} in apart is not that in intruders")
        same = sides.setdefault((number, side), heights) == heights
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
    own_climb, other_climb = ball(heights.own_climb), ball(heights.other_climb)
    at_request = ball(heights.other) + other_climb * ball(heights.age) - ball(heights.own)
    first = at_request + (other_climb - own_climb) * ball(begin)
    last = at_request + (other_climb - own_climb) * ball(end)
    vertical = ball(heights.vertical).hi
    if min(first.lo, last.lo) >= vertical:
        return 1
    return -1 if max(first.hi, last.hi) <= -vertical else 0


def check_own_altitude(name: str, heights: Heights, side: int, levels: Levels | None) -> None:
    """Check that the ownship is as near to an intruder on a side as its levels allow."""
    nearest = None if levels is None else levels[2:] if side > 0 else levels[:2]
    same = nearest == (heights.own, heights.own_climb)
    demand(same, f"{name} has another altitude of the ownship than levels")
