"""The separation from an intruder."""

from typing import NamedTuple

from .balls import EIGHT, TWO, ZERO, Ball, J, ball, cis, real
from .certificate import Certificate, Report, Requirement, Wind
from .chord import chord_bound
from .leg import Arc, Flight
from .motion import displacement, through_air
from .parts import Part, check_parts
from .refusal import Work
from .tolerances import JOINT, LEAST_SAGITTA, MARGIN, ROUNDING

_WORK = 20  # of an intruder that is not out of reach of the whole flight, in parts of arcs


class Track(NamedTuple):
    """An intruder that turns for a while after its report, then flies straight on."""

    position: Ball  # at the report, x + iy, m
    course: Ball  # at the report, cos + i sin
    speed: Ball  # m/s
    age: Ball  # of the report at the request, s
    turn_rate: Ball  # rad/s
    turn_time: Ball  # s
    position_std: Ball  # m
    velocity_std: Ball  # m/s
    separation: Ball  # m

    def position_at(self, t: Ball) -> Ball:
        """Return the position a time after the request."""
        time = t + self.age
        if self.turn_rate.x == self.turn_rate.r == 0:
            return self.position + self.course * self.speed * time
        turning = Ball(min(time.x, self.turn_time.x), 0, time.r + self.turn_time.r)
        turn = cis(self.turn_rate * turning)
        curve = displacement(self.course, turn, self.speed, ZERO, self.turn_rate, turning)
        straight = self.course * turn * self.speed * (time - turning)
        return self.position + curve + straight

    def acceleration(self) -> Ball:
        """Return a bound of its acceleration after the request."""
        if self.turn_time.hi > self.age.lo:
            return (self.speed * self.turn_rate).magnitude()
        return ZERO

    def report_distance(self) -> Ball:
        """Return how far its report and the request are apart, whichever came first, s."""
        return Ball(abs(self.age.x), 0, self.age.r)

    def uncertainty(self, t: Ball) -> Ball:
        """Return a standard deviation of its position per axis, a time t after the report, m: one
        error of the velocity lasts.

        This is |p + i v t|, with the deviations p of the position and v of the velocity.
        """
        return (self.position_std + J * self.velocity_std * t).magnitude()


def track_of(report: Report, wind: Wind) -> Track:
    """Return an intruder's report in balls, in the air mass.

    What a turn through the air makes of the ground velocity depends on the wind: the velocity's
    error grows by that of the wind times the turn, or twice it.
    """
    turns = report.turn_time > 0.0  # a turn that lasts for no time is none
    state = through_air(report, ball(-report.age), wind)
    turn = (ball(report.turn_rate) * ball(report.turn_time)).magnitude()
    wind_errors = real(min(turn.hi, TWO.hi))
    return Track(
        position=state.position,
        course=state.course,
        speed=state.speed,
        age=ball(report.age),
        turn_rate=ball(report.turn_rate) if turns else ZERO,
        turn_time=ball(report.turn_time),
        position_std=ball(report.position_std),
        velocity_std=ball(report.velocity_std) + wind_errors * ball(wind.std),
        separation=ball(report.separation),
    )


def required_at_request(intruder: Track, requirement: Requirement) -> int:
    """Return the distance that is to be kept from an intruder with what is known at the request,
    units: separation + margin + sigmas times the deviation of its position.
    """
    deviation = intruder.uncertainty(intruder.report_distance())
    margins = ball(requirement.margin) + ball(requirement.sigmas) * deviation
    return (intruder.separation + margins).hi


def required_until(intruder: Track, requirement: Requirement, at_request: int, end: Ball) -> int:
    """Return the distance that is required until a time after the request, units: what is required
    at the request, and sigmas times the growth of the deviation; always the separation itself.
    """
    age = intruder.report_distance()
    deviation = intruder.uncertainty(age + end) - intruder.uncertainty(age)
    growth = (ball(requirement.sigmas) * deviation).hi
    return max(at_request + growth - ball(MARGIN).lo, intruder.separation.hi - ball(ROUNDING).lo)


def above_or_below(times: list[tuple[Ball, Ball]], begin: Ball, end: Ball) -> bool:
    """Return whether a part of an arc lies within one of some times."""
    # No part begins before the request, though rounding may leave that open.
    begin_lo = max(begin.lo, 0)
    return any(first.hi <= begin_lo and end.hi <= last.lo for first, last in times)


def relative_position(intruder: Track, arc: Arc, k: int, n: int) -> Ball:
    """Return the intruder's position less the ownship's after k of n equal parts of an arc."""
    t = arc.length * ball(k) / ball(n)
    return intruder.position_at(arc.begin + t) - arc.position_at_part(k, n)


class Separation(NamedTuple):
    """What a plan has to keep from an intruder."""

    intruder: Track
    requirement: Requirement
    at_request: int  # distance required with what is known at the request, units
    distance: int  # at the request, at most, units
    claimed: int  # distance that the certificate claims, units
    times: list[tuple[Ball, Ball]]  # in which the intruder is above or below, s

    def required(self, end: Ball) -> int:
        """Return the distance that a plan keeps until a time after the request, units.

        A plan that begins nearer keeps its own distance, but never less than the separation. Where
        the intruder has been above or below before, that distance says nothing.
        """
        at_request = self.at_request
        if not any(last.lo < end.hi for _, last in self.times):
            at_request = max(self.intruder.separation.hi, min(at_request, self.distance))
        required = required_until(self.intruder, self.requirement, at_request, end)
        return max(required, self.claimed)


def check_separation(
    number: int,
    certificate: Certificate,
    flight: Flight,
    apart: list[tuple[float, float]],
    work: Work,
) -> None:
    """Check that intruder ``number`` stays as far as it has to, and as the certificate claims.

    Arcs that are not clear are cut in two, into ``parts`` of the certificate at most. While the
    intruder is stated to be above or below, in some times (s) that do not meet, nothing is asked of
    it.
    """
    intruder = track_of(certificate.reports[number], certificate.wind)
    times = [(ball(begin), ball(end)) for begin, end in apart]
    distance = (intruder.position_at(ZERO) - flight.arcs[0].start).magnitude()
    separation = Separation(
        intruder=intruder,
        requirement=certificate.requirement,
        at_request=required_at_request(intruder, certificate.requirement),
        distance=distance.hi,
        claimed=ball(certificate.bounds[number]).hi,
        times=times,
    )
    most = separation.required(flight.until)
    sagitta = (intruder.acceleration() * flight.longest * flight.longest / EIGHT).hi
    least = distance.lo  # the distance at the beginning of an arc is this at least
    if least - flight.path - (flight.until * intruder.speed).hi - sagitta >= most:
        return  # theorem left_out_soundly, of every arc
    work.spend(_WORK)
    problem = f"intruder {number} may come too close"
    for arc in flight.arcs:
        least -= (arc.length * (arc.top_speed + intruder.speed)).hi  # theorem left_out_soundly
        if least - flight.sagitta - sagitta < most:
            at_end = check_arc(separation, arc, certificate.parts, problem, work)
            least = least if at_end is None else at_end
        least -= ball(JOINT).hi


def check_arc(separation: Separation, arc: Arc, parts: int, problem: str, work: Work) -> int | None:
    """Check that an arc keeps a separation; return a lower bound of the distance at its end, units;
    None where the intruder is above or below all the time.
    """
    intruder = separation.intruder
    acceleration = arc.own_acceleration + intruder.acceleration()
    at_end = None

    def is_clear(part: Part) -> bool:
        nonlocal at_end
        if above_or_below(separation.times, part.begin, part.end):
            return True
        first = relative_position(intruder, arc, part.number, part.total)
        last = relative_position(intruder, arc, part.number + 1, part.total)
        if part.whole:
            at_end = last.magnitude().lo
        # a h^2 / 8 of a part of the length h / n
        pieces = ball(8 * part.total * part.total)
        sagitta = (acceleration * arc.length * arc.length / pieces).hi
        sagitta = max(sagitta, ball(LEAST_SAGITTA).hi)
        return chord_bound(first, last, sagitta) >= separation.required(part.end)

    check_parts(arc, is_clear, parts, problem, work)
    return at_end


def joined(times: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return times, from and until, s, in order, joined where they meet; moments are left out."""
    union: list[tuple[float, float]] = []
    for first, last in sorted(times):
        if union and first <= union[-1][1]:
            union[-1] = union[-1][0], max(last, union[-1][1])
        elif first < last:
            union.append((first, last))
    return union


def covered(times: list[tuple[float, float]], end: float) -> bool:
    """Return whether some times that do not meet cover all from the request until an end, s."""
    return any(first <= 0.0 and end <= last for first, last in times)
