"""The clearance from an area."""

from typing import NamedTuple

from .altitude import Line, lines_between
from .balls import ZERO, Ball, ball
from .certificate import Area, Certificate
from .chord import chord_bound, edge_bound, farthest_from_edge
from .leg import Arc, Flight, bulge
from .parts import Part, check_parts
from .refusal import Work
from .tolerances import JOINT, LEAST_SAGITTA, MARGIN, NEARER, ROUNDING

_EDGE_WORK = 4  # of an edge of a polygon that a part is near, in parts of arcs


class AirArea(NamedTuple):
    """An area in the air mass."""

    area: Area
    edges: list[tuple[Ball, Ball]]  # of a polygon, x + iy, m
    velocity: Ball  # m/s

    def position_in_area(self, position: Ball, t: Ball) -> Ball:
        """Return a position at a time where the area stands still."""
        return position - self.velocity * t

    def allows(self, position: Ball) -> bool:
        """Return whether a polygon allows flight at a position; a ray from what is inside crosses
        the edges an odd number of times.

        It holds for all of the ball where no edge meets the ball.
        """
        odd = False
        for a, b in self.edges:
            if (a.y > position.y) != (b.y > position.y):
                turn = (b.x - a.x) * (position.y - a.y) - (b.y - a.y) * (position.x - a.x)
                odd ^= (turn > 0) == (b.y > a.y)
        return odd == (self.area.keep == "in")

    def signed_distance(self, position: Ball) -> int:
        """Return a lower bound of the signed distance of a position, units: from the edges where
        flight is allowed, less than 0 elsewhere.
        """
        if self.area.circle:
            x, y, radius = self.area.circle
            distance = (position - ball(x, y)).magnitude() - ball(radius)
            return distance.lo if self.area.keep == "out" else -distance.hi
        tiny = ball(LEAST_SAGITTA).hi
        nearest = min(chord_bound(a - position, b - position, tiny) for a, b in self.edges)
        if nearest > 0 and self.allows(position):
            return nearest
        return -min(farthest_from_edge(position, a, b) for a, b in self.edges)

    def on_part(self, first: Ball, last: Ball, sagitta: int) -> int:
        """Return a lower bound of the signed distance on a part of a curve, units (theorems
        ``chord_keeps_sound`` and ``part_keeps``).
        """
        if self.area.circle:
            x, y, radius = self.area.circle
            begin, end = first - ball(x, y), last - ball(x, y)
            if self.area.keep == "out":
                return chord_bound(begin, end, sagitta) - ball(radius).hi
            farthest = max(begin.magnitude().hi, end.magnitude().hi)
            return ball(radius).lo - farthest - sagitta
        nearest = min(edge_bound(first, last, a, b) for a, b in self.edges)
        if nearest > 0 and self.allows(first):
            return nearest - sagitta
        ends = self.signed_distance(first) + self.signed_distance(last)
        return (ends - (last - first).magnitude().hi) // 2 - sagitta


def in_air(area: Area, certificate: Certificate) -> AirArea:
    """Return an area in the air mass of a certificate's wind."""
    corners = [[ball(*place) for place in ring] for ring in area.rings]
    edges = [(ring[n - 1], ring[n]) for ring in corners for n in range(len(ring))]
    wind = ball(certificate.wind.east, certificate.wind.north)
    return AirArea(area, edges, ball(*area.velocity) - wind)


def may_count(area: Area, lines: list[Line], begin: Ball, end: Ball) -> bool:
    """Return whether an area may count at some time between two, s after the request, where the
    ownship's altitude has some lines.
    """
    start, last = area.valid
    if start is not None and end.hi < ball(start).lo:
        return False
    if last is not None and begin.lo > ball(last).hi:
        return False
    floor, ceiling = area.heights
    if not lines or area.keep == "in" or floor is ceiling is None:
        return True
    times = [(line, t) for line, ends in lines_between(lines, begin, end) for t in ends]
    highest = max(line.nearest(1, t).hi for line, t in times)
    lowest = min(line.nearest(-1, t).lo for line, t in times)
    below = floor is not None and highest < ball(floor).lo
    above = ceiling is not None and lowest > ball(ceiling).hi
    return not (below or above)


class Clearance(NamedTuple):
    """What a plan has to keep from an area."""

    area: AirArea
    lines: list[Line]  # of the ownship's altitude
    at_request: int  # distance required with the area as it is at the request, units
    later: int  # the same where it begins to count after the request
    off: Ball | None  # the first beginning of a line at which it does not count, s; None: at none
    growth: Ball  # of what is required, m/s

    def required(self, part: Part) -> int:
        """Return the distance that a plan keeps in a part, units."""
        growth = max((self.growth * part.begin).hi, (self.growth * part.end).hi)
        # What begins to count after the request is kept clear of as if the plan began elsewhere.
        # On a line the ownship's levels change evenly: who comes to an area begins the line off it.
        counts_again = self.off is not None and self.off.hi < part.end.lo
        return (self.later if counts_again else self.at_request) + growth


def clearance_of(
    area: AirArea, certificate: Certificate, lines: list[Line], distance: int
) -> Clearance:
    """Return what a plan has to keep from an area at a signed distance at the request, units.

    A plan that begins inside the clearance must not come nearer, but for some millimetres.
    """
    stated = area.area
    clearance = (ball(stated.clearance) + ball(certificate.requirement.margin)).hi
    at_request = min(clearance, max(distance - ball(NEARER).lo, 0))
    begins = ZERO, *(line.begin for line in lines[1:])
    return Clearance(
        area=area,
        lines=lines,
        at_request=max(at_request - ball(MARGIN).lo, -ball(ROUNDING).lo),
        later=max(clearance - ball(MARGIN).lo, -ball(ROUNDING).lo),
        off=next((t for t in begins if not may_count(stated, lines, t, t)), None),
        growth=ball(stated.growth) if stated.keep == "out" else ball(-stated.growth),
    )


def check_area(
    number: int, flight: Flight, certificate: Certificate, lines: list[Line], work: Work
) -> None:
    """Check that the plan keeps the clearance from area ``number`` while it counts."""
    area = certificate.areas[number]
    air_area = in_air(area, certificate)
    work.spend(_EDGE_WORK * len(air_area.edges))
    # The signed distance at the beginning of an arc is this at least.
    least = air_area.signed_distance(flight.arcs[0].start)
    clearance = clearance_of(air_area, certificate, lines, least)
    speed = air_area.velocity.magnitude()
    problem = f"area {number} may not be kept clear of"
    for arc in flight.arcs:
        least -= (arc.length * (arc.top_speed + speed)).hi  # theorem keeps_near
        least = check_arc(clearance, arc, least, certificate.parts, problem, work)
        least -= ball(JOINT).hi


def check_arc(
    clearance: Clearance, arc: Arc, least: int, parts: int, problem: str, work: Work
) -> int:
    """Check that an arc keeps a clearance; return a lower bound of the signed distance at its end,
    units: ``least``, which holds in all of the arc, or a better one.
    """
    air_area = clearance.area
    at_end = least

    def is_clear(part: Part) -> bool:
        nonlocal at_end
        if not may_count(air_area.area, clearance.lines, part.begin, part.end):
            return True
        required = clearance.required(part)
        if part.whole and least >= required:
            return True
        work.spend(_EDGE_WORK * len(air_area.edges))
        sagitta = bulge(arc.own_acceleration, arc.length / ball(part.total))
        first = arc.position_at_part(part.number, part.total)
        last = arc.position_at_part(part.number + 1, part.total)
        first = air_area.position_in_area(first, part.begin)
        last = air_area.position_in_area(last, part.end)
        if part.whole:
            at_end = air_area.signed_distance(last)
        return air_area.on_part(first, last, sagitta) >= required

    check_parts(arc, is_clear, parts, problem, work)
    return at_end
