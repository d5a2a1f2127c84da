"""Bounds of distances between a point, or an edge, and the chord of a part of a curve."""

from .balls import BITS, ONE, ZERO, Ball, ball, real
from .tolerances import LEAST_SAGITTA


def chord_bound(first: Ball, last: Ball, sagitta: int) -> int:
    """Return a lower bound of the distance in a part of an arc, in units.

    Args:
        first: relative position at the part's beginning; with ``last`` at its end.
        sagitta: by which the relative motion leaves its chord at most, units (theorem
            ``chord_error``).
    """
    chord = last - first
    length = chord.magnitude()
    best = 0
    if length.lo > 0:  # from the line through both ends
        cross = first.conjugate() * chord
        from_line = real(max(abs(cross.y) - cross.r, 0)) / length
        best = max(best, from_line.lo - sagitta)
    for end, onwards in ((first, chord), (last, ZERO - chord)):
        far = end.magnitude()
        best = max(best, far.lo - length.hi - sagitta)
        grows = end.conjugate() * onwards
        if far.lo > 0 and grows.lo >= 0:  # from an end at which the range opens
            opening = (real(grows.lo) / far).lo
            lost = real(max(4 * sagitta - opening, 0))
            best = max(best, far.lo - (lost * lost / real(16 * sagitta)).hi)
    return best


def farthest_from_edge(position: Ball, a: Ball, b: Ball) -> int:
    """Return an upper bound of the distance of a position from an edge, units."""
    edge = b - a
    along = (((position - a) * edge.conjugate()).x << BITS) // max((edge * edge.conjugate()).x, 1)
    nearest = a + edge * real(min(max(along, 0), ONE.x))
    return (nearest - position).magnitude().hi


def edge_bound(p: Ball, q: Ball, a: Ball, b: Ball) -> int:
    """Return a lower bound of the distance between a chord from p to q and an edge from a to b,
    units (theorem ``edge_distance_sound``); far below 0 where they may cross.
    """
    tiny = ball(LEAST_SAGITTA).hi
    from_ends = chord_bound(a - p, b - p, tiny), chord_bound(a - q, b - q, tiny)
    apart = on_one_side(a, b, p, q) or on_one_side(p, q, a, b)
    if not apart:
        beyond = from_ends[0] - (q - p).magnitude().hi
        return beyond if beyond > 0 else -1 << (BITS + 30)
    return min(*from_ends, chord_bound(p - a, q - a, tiny), chord_bound(p - b, q - b, tiny))


def on_one_side(a: Ball, b: Ball, p: Ball, q: Ball) -> bool:
    """Return whether p and q are certainly on one side of the line through a and b."""
    sides = [(b - a).conjugate() * (end - a) for end in (p, q)]
    signs = {(side.y > side.r) - (side.y < -side.r) for side in sides}
    return signs in ({1}, {-1})
