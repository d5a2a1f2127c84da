"""The plan's flight: legs are arcs of constant turn rate and acceleration, within the limits, from
waypoint to waypoint.
"""

from itertools import pairwise
from typing import NamedTuple

from .balls import BITS, EIGHT, Ball, J, ball, cis, real
from .certificate import ARCS, Certificate, PlanState, Wind
from .curve import curve_controls
from .limits import AirLimits, air_limits
from .motion import AirState, displacement, through_air
from .refusal import demand
from .tolerances import CONTROLS, FINE, JOINT, LEAST_SAGITTA, TURN

_SHORTEST = 1e-3  # least duration of a leg, s


class Arc(NamedTuple):
    """An arc of a leg, flown exactly."""

    begin: Ball  # s after the request
    length: Ball  # s
    start: Ball  # position at its beginning, x + iy, m
    end: Ball  # position at its end
    course: Ball  # at its beginning, cos + i sin
    speed: Ball  # at its beginning, m/s
    acceleration: Ball  # m/s^2
    turn_rate: Ball  # rad/s
    top_speed: Ball  # m/s
    own_acceleration: Ball  # a bound of the magnitude of the whole acceleration, m/s^2

    def position_after(self, t: Ball) -> Ball:
        """Return the position a time after the arc's beginning."""
        turn = cis(self.turn_rate * t)
        flown = displacement(self.course, turn, self.speed, self.acceleration, self.turn_rate, t)
        return self.start + flown

    def position_at_part(self, k: int, n: int) -> Ball:
        """Return the position after k of n equal parts."""
        if k == 0:
            return self.start
        return self.end if k == n else self.position_after(self.length * ball(k) / ball(n))


class Flight(NamedTuple):
    """The plan through the air."""

    arcs: list[Arc]
    until: Ball  # when it ends, s after the request
    longest: Ball  # duration of an arc, s
    sagitta: int  # by which an arc leaves its chord at most, units
    path: int  # length of its path at most, with the sagittas and what the joints miss by, units

    @classmethod
    def of(cls, arcs: list[Arc]) -> "Flight":
        """Return the flight of some arcs, one after the other."""
        sagittas = [bulge(arc.own_acceleration, arc.length) for arc in arcs]
        paths = [(arc.length * arc.top_speed + ball(JOINT)).hi for arc in arcs]
        longest = max((arc.length for arc in arcs), key=lambda length: length.hi)
        until = arcs[-1].begin + arcs[-1].length
        return cls(arcs, until, longest, max(sagittas), sum(paths) + sum(sagittas))


def bulge(acceleration: Ball, h: Ball) -> int:
    """Return by how much a motion leaves its chord in a time h at most, a h^2 / 8, units (theorem
    ``chord``).
    """
    return max((acceleration * h * h / EIGHT).hi, ball(LEAST_SAGITTA).hi)


def fly(certificate: Certificate) -> Flight:
    """Return the plan's flight through the air, which keeps the limits and joins the waypoints."""
    limits, wind = air_limits(certificate), certificate.wind
    arcs: list[Arc] = []
    # A plan that begins beyond a speed limit may stay there, but not go further, nor come back.
    slowest, fastest = 0, 1 << (BITS + 30)
    legs = zip(pairwise(certificate.plan_states), certificate.controls, strict=True)
    for number, ((start, goal), controls) in enumerate(legs):
        leg = f"the leg to waypoint {number}"
        demand(goal.time - start.time > _SHORTEST, f"{leg} takes no time")
        begin = through_air(start, ball(start.time), wind)
        end = through_air(goal, ball(goal.time), wind)
        check_curve(leg, ends_of_curve(start, goal, begin, end, wind), controls)
        length = (ball(goal.time) - ball(start.time)) / ball(ARCS)
        leg_arcs, reached = fly_leg(begin, start.time, length, controls)
        for arc in leg_arcs:
            slowest = max(slowest, arc.speed.hi)
            fastest = min(fastest, arc.speed.lo)
            check_limits(leg, arc, limits, slowest, fastest)
        check_joint(leg, reached, end)
        arcs += leg_arcs
    return Flight.of(arcs)


def ends_of_curve(
    start: PlanState, goal: PlanState, begin: AirState, end: AirState, wind: Wind
) -> tuple[PlanState, PlanState]:
    """Return between which plan states the curve of a leg lies: those in the air mass."""
    if wind.east == 0.0 == wind.north:
        return start, goal
    return begin.in_floats(start.time), end.in_floats(goal.time)


def check_curve(leg: str, ends: tuple[PlanState, PlanState], controls: list[float]) -> None:
    """Check that the stated controls are those of the leg's curve."""
    for stated, defined in zip(controls, curve_controls(*ends), strict=True):
        demand(abs(stated - defined) <= CONTROLS, f"{leg} is not flown along its curve")


def fly_leg(
    start: AirState, time: float, length: Ball, controls: list[float]
) -> tuple[list[Arc], AirState]:
    """Fly a leg's arcs from a state at a time, s, each for ``length`` seconds; return them and the
    state at their end.

    In an arc of turn rate w and acceleration a, t after its beginning, the course has turned by
    w t, the speed is v + a t, and the position is that of
    :func:`agents.check.motion.displacement`.
    """
    arcs = []
    position, course, speed = start
    for k in range(ARCS):
        turn_rate = ball(controls[k])
        acceleration = ball(controls[ARCS + k])
        turn = cis(turn_rate * length)
        end = position + displacement(course, turn, speed, acceleration, turn_rate, length)
        last_speed = speed + acceleration * length
        top_speed = real(max(speed.hi, last_speed.hi))
        arcs.append(
            Arc(
                begin=ball(time) + length * ball(k),
                length=length,
                start=position,
                end=end,
                course=course,
                speed=speed,
                acceleration=acceleration,
                turn_rate=turn_rate,
                top_speed=top_speed,
                # |a + i v w|: along the path and across it
                own_acceleration=(acceleration + J * top_speed * turn_rate).magnitude(),
            )
        )
        position, course, speed = end, course * turn, last_speed
    return arcs, AirState(position, course, speed)


def check_limits(leg: str, arc: Arc, limits: AirLimits, slowest: int, fastest: int) -> None:
    """Check that an arc keeps the limits; where the plan has been beyond a speed limit ever since
    its beginning, that it goes no further.

    Speed is linear in time, so that both ends decide.

    Args:
        slowest, fastest: the greatest and the least speed at the beginning of any arc so far,
            units.
    """
    fine = ball(FINE).lo
    last_speed = arc.speed + arc.acceleration * arc.length
    forwards = min(arc.speed.lo, last_speed.lo) > 0
    fast_enough = last_speed.lo >= min(limits.speed_min.hi, slowest) - fine
    slow_enough = last_speed.hi <= max(limits.speed_max.lo, fastest) + fine
    demand(forwards and fast_enough and slow_enough, f"{leg} leaves the speed limits")
    above = arc.acceleration.lo >= limits.acceleration_min.hi - fine
    below = arc.acceleration.hi <= limits.acceleration_max.lo + fine
    demand(above and below, f"{leg} leaves the acceleration limits")
    gentle = arc.turn_rate.magnitude().hi <= limits.yaw_rate_max.lo + ball(TURN).lo
    demand(gentle, f"{leg} turns too fast")


def check_joint(leg: str, reached: AirState, waypoint: AirState) -> None:
    """Check that a leg ends where its waypoint is, as fast and on its course."""
    fine = ball(FINE).lo
    at_waypoint = (reached.position - waypoint.position).magnitude().hi <= ball(JOINT).lo
    as_fast = (reached.speed - waypoint.speed).magnitude().hi <= fine
    on_course = (reached.course - waypoint.course).magnitude().hi <= fine
    demand(at_waypoint and as_fast and on_course, f"{leg} misses its waypoint")
