"""Check a plan's certificate: ``python -m agents.check FILE`` (exit 0 accepted, 1 refused, 2
unreadable or bad usage).

It imports nothing else of the project. What decides is computed in balls (complex numbers with a
bound of their error, 256 bits) and follows the theorem ``safe`` of proofs/Safe.v: legs are flown
exactly; in each part of an arc the relative motion leaves its chord by at most a h^2 / 8; an arc is
left out where both can fly less than they are too far apart (``left_out_soundly``). At every real
time of an accepted plan every intruder is the required distance less 1.002 mm away, and the
separation itself less 3 micrometres (docs/explanation/safe-theorem.md).
"""

import argparse
import cmath
import io
import json
import math
import os
import re
import sys
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

FORMAT = "RLCAS plan certificate 3"
BITS = 256  # of the fractions of a ball
ARCS = 10  # of a leg

# Tolerances, in m, m/s, m/s^2 and rad/s; the theorem allows for them.
_JOINT = 1e-3 + 1e-6  # by which the end of a leg may miss its waypoint, m
_MARGIN = 1e-3 + 2e-6  # by which a distance may fall short of the margin, m
_ROUNDING = 3e-6  # by which a distance may fall short of the separation itself, m
_FINE = 2e-6  # of speeds (m/s), accelerations (m/s^2) and headings (rad)
_TURN = 2e-9  # of turn rates, rad/s
_CONTROLS = 1e-8  # by which stated controls may differ from those of the curve
_TINY = 1e-12  # least sagitta, m
_NEARER = 0.01  # by which a plan that begins inside a clearance may come nearer to the area, m
_SHORTEST = 1e-3  # least duration of a leg, s
_LARGEST = 1e8  # numbers of a certificate are below this
_MOST_WORK = 300_000  # parts of arcs that are looked at, or what takes as long: some 20 s
_LEG_WORK = 50  # of a leg
_WALK_WORK = 20  # of an intruder that is not out of reach of the whole flight
_EDGE_WORK = 4  # of an edge of a polygon that a part is near
_MOST_BYTES = 1 << 26  # of a file


class RefusedError(ValueError):
    """The certificate does not prove its plan; the message says why."""


class Ball:
    """All complex numbers at most ``r`` from x + iy, in units of 2^-256.

    Of a ball of real numbers, whose y is 0, ``lo`` and ``hi`` are bounds.
    """

    def __init__(self, x: int, y: int, r: int) -> None:
        self.x = x
        self.y = y
        self.r = r

    @property
    def lo(self) -> int:
        """The least real part."""
        return self.x - self.r

    @property
    def hi(self) -> int:
        """The greatest real part."""
        return self.x + self.r

    def __add__(self, other: "Ball") -> "Ball":
        return Ball(self.x + other.x, self.y + other.y, self.r + other.r)

    def __sub__(self, other: "Ball") -> "Ball":
        return Ball(self.x - other.x, self.y - other.y, self.r + other.r)

    def __mul__(self, other: "Ball") -> "Ball":
        a, b, c, d = self.x, self.y, other.x, other.y
        error = (abs(a) + abs(b) + self.r) * other.r + (abs(c) + abs(d)) * self.r
        # Each of the three shifts rounds by less than a unit.
        return Ball((a * c - b * d) >> BITS, (a * d + b * c) >> BITS, (error >> BITS) + 3)

    def __truediv__(self, other: "Ball") -> "Ball":
        """Divide by a real number."""
        demand(other.lo > 0 or other.hi < 0, "the proof needs a division by zero")
        x = (self.x << BITS) // other.x
        y = (self.y << BITS) // other.x
        error = (self.r << BITS) + (abs(x) + abs(y) + 2) * other.r
        return Ball(x, y, error // (abs(other.x) - other.r) + 3)

    def conjugate(self) -> "Ball":
        """Return x - iy."""
        return Ball(self.x, -self.y, self.r)

    def size(self) -> "Ball":
        """Return the magnitude."""
        return Ball(math.isqrt(self.x * self.x + self.y * self.y), 0, self.r + 1)


class Work:
    """What is left of the work that a certificate may ask for, in parts of arcs."""

    def __init__(self, most: int = _MOST_WORK) -> None:
        self.most = most
        self.left = most

    def spend(self, parts: int) -> None:
        """Take off some work; refuse the certificate where nothing is left."""
        self.left -= parts
        demand(self.left >= 0, f"its proof takes more than {self.most} parts of arcs")


def demand(holds: bool, sentence: str) -> None:
    """Refuse the certificate unless something holds."""
    if not holds:
        raise RefusedError(sentence)


def ball(x: float, y: float = 0.0) -> Ball:
    """Return a number, or a place, as it is."""
    a, b = float(x).as_integer_ratio()
    c, d = float(y).as_integer_ratio()
    exact = max(b, d) <= 1 << BITS
    return Ball((a << BITS) // b, (c << BITS) // d, 0 if exact else 2)


def real(units: int) -> Ball:
    """Return a real number of so many units of 2^-256, without an error."""
    return Ball(units, 0, 0)


ZERO = ball(0.0)
ONE = ball(1.0)
TWO = ball(2.0)
J = ball(0.0, 1.0)


def spin(angle: Ball) -> Ball:
    """Return cosine + i sine of a real angle: the series of a small part of it, squared again."""
    halvings = (abs(angle.x) >> (BITS - 4)).bit_length()
    small = angle.x >> halvings
    sums = [0, 0, 0, 0]  # of the terms without i, with i, with -1, with -i
    term = 1 << BITS
    n = 0
    while term not in (0, -1):  # a term is 2^-4 of the one before at most, and off by 3 at most
        sums[n % 4] += term
        n += 1
        term = (term * small >> BITS) // n
    total = Ball(sums[0] - sums[2], sums[1] - sums[3], 4 * n + 8)
    for _ in range(halvings):
        total *= total
    return Ball(total.x, total.y, total.r + angle.r)


def travel(course: Ball, turn: Ball, v: Ball, a: Ball, w: Ball, t: Ball) -> Ball:
    """Return how far one gets in a time t with speed v + a t, on a course that turns by w t.

    Course and turn are given as cos + i sin. This is the integral of
    (v + a s) exp(i (course + w s)) over s from 0 to t.
    """
    if w.x == w.r == 0:
        return course * t * (v + a * t / TWO)
    through_speed = ((v + a * t) * turn - v) * (ZERO - J)
    through_acceleration = a * (turn - ONE) / w
    return course * (through_speed + through_acceleration) / w


# What a certificate states.


class Limits(NamedTuple):
    """Of every arc, m/s, m/s^2, rad/s."""

    speed_min: float
    speed_max: float
    acceleration_min: float
    acceleration_max: float
    yaw_rate_max: float


class Requirement(NamedTuple):
    """What is to be kept from the intruders."""

    separation: float  # from those without one of their own, m
    margin: float  # m
    sigmas: float  # of the uncertainty that adds to it


class Wind(NamedTuple):
    """Velocity of the air over the ground."""

    east: float  # m/s
    north: float
    std: float  # one sigma of both


class PlanState(NamedTuple):
    """The ownship at the request, or a waypoint."""

    x: float  # m
    y: float
    heading: float  # rad
    speed: float  # m/s
    time: float  # s after the request


class Report(NamedTuple):
    """An intruder as it was reported."""

    x: float  # m
    y: float
    heading: float  # rad
    speed: float  # m/s
    age: float  # of the report at the request, s
    turn_rate: float  # rad/s
    turn_time: float  # for which it turns after the report, s
    position_std: float  # m
    velocity_std: float  # m/s
    separation: float  # that is to be kept from it, m


class Heights(NamedTuple):
    """Of the ownship and of an intruder, as near to each other as they may be."""

    own: float  # m
    own_climb: float  # m/s
    other: float  # m
    other_climb: float  # m/s
    age: float  # of the other's report at the request, s
    vertical: float  # separation that is to be kept, m


class Apart(NamedTuple):
    """A time in which an intruder stays above or below."""

    number: int  # of the intruder
    begin: float  # s after the request
    end: float
    heights: Heights


class Area(NamedTuple):
    """What must not be entered, or not be left, as it is at the request over the ground."""

    keep: str  # "out" or "in"
    circle: list[float]  # x, y, radius, m; empty: a polygon
    rings: list[list[list[float]]]  # of x and y, m; the outer one first
    velocity: list[float]  # towards the east and the north, m/s
    growth: float  # to all sides, m/s
    clearance: float  # m
    valid: list[float | None]  # from and until when, s; null: always
    heights: list[float | None]  # floor and ceiling, m; null: none, or not comparable


class Levels(NamedTuple):
    """Between which the ownship is, by a time t after the request."""

    low: float  # m
    low_climb: float  # m/s
    high: float
    high_climb: float


class Origin(NamedTuple):
    """Which flight the certificate belongs to, as far as its request said so."""

    policy: str | None  # SHA-256
    time_ns: int | None  # of the request, ns since 1970
    latitude: float | None  # of the frame's origin, degrees
    longitude: float | None


class Certificate(NamedTuple):
    """Everything that a certificate states, in its order."""

    request: Origin
    plan_states: list[PlanState]
    controls: list[list[float]]  # of each leg: ten turn rates, then ten accelerations
    reports: list[Report]
    excluded: list[Heights]
    apart: list[Apart]
    requirement: Requirement
    limits: Limits  # of the flight through the air
    wind: Wind
    areas: list[Area]
    levels: Levels | None  # of the ownship; None: unknown
    parts: int  # into which an arc is cut at most
    bounds: list[float]  # of the distance from each intruder, m


_FIELDS = {
    "format",
    "request",
    "own",
    "waypoints",
    "controls",
    "intruders",
    "excluded",
    "apart",
    "requirement",
    "limits",
    "wind",
    "areas",
    "levels",
    "parts",
    "bounds",
}


def read(data: Any) -> Certificate:
    """Return what a certificate states; raise RefusedError where it is none."""
    right = isinstance(data, dict) and set(data) == _FIELDS and data["format"] == FORMAT
    demand(right, f"it is not a {FORMAT}")
    own = table("own", [data["own"]], 4)[0]
    waypoints = table("waypoints", data["waypoints"], len(PlanState._fields))
    controls = table("controls", data["controls"], 2 * ARCS)
    intruders = table("intruders", data["intruders"], len(Report._fields))
    excluded = table("excluded", data["excluded"], len(Heights._fields))
    apart = table("apart", data["apart"], 3 + len(Heights._fields))
    for row in apart:
        demand(row[0] in range(len(intruders)), "a row of apart is of no intruder")
    found = Certificate(
        request=origin(data["request"]),
        plan_states=[PlanState(*own, time=0.0), *(PlanState(*row) for row in waypoints)],
        controls=controls,
        reports=[Report(*row) for row in intruders],
        excluded=[Heights(*row) for row in excluded],
        apart=[Apart(int(row[0]), row[1], row[2], Heights(*row[3:])) for row in apart],
        requirement=Requirement(*numbers("requirement", data["requirement"], Requirement._fields)),
        limits=Limits(*numbers("limits", data["limits"], Limits._fields)),
        wind=Wind(*numbers("wind", data["wind"], Wind._fields)),
        areas=[
            read_area(f"areas[{n}]", one) for n, one in enumerate(as_list("areas", data["areas"]))
        ],
        levels=None
        if data["levels"] is None
        else Levels(*table("levels", [data["levels"]], len(Levels._fields))[0]),
        parts=data["parts"],
        bounds=table("bounds", [data["bounds"]], len(intruders))[0],
    )
    check_sizes(found)
    check_ranges(found)
    return found


def check_sizes(found: Certificate) -> None:
    """Refuse a certificate whose lists do not belong together, or whose sizes are negative."""
    power = type(found.parts) is int and found.parts in [1 << n for n in range(11)]
    demand(power, "parts is no power of 2 to 1024")
    # The first plan state is the ownship's, the others are the waypoints.
    paired = len(found.controls) == len(found.plan_states) - 1 > 0
    demand(paired, "there are not as many controls as waypoints, one or more")
    sizes = [*found.requirement, *found.bounds, found.wind.std]
    for one in found.reports:
        sizes += [one.speed, one.turn_time, one.position_std, one.velocity_std]
    demand(min(sizes) >= 0.0, "a size is negative")
    separations = [found.requirement.separation, *(one.separation for one in found.reports)]
    demand(min(separations) > 0.0, "a separation is not positive")
    levels = [one.vertical for one in (*found.excluded, *(time.heights for time in found.apart))]
    demand(min(levels, default=0.0) >= 0.0, "a vertical separation is negative")


def check_ranges(found: Certificate) -> None:
    """Refuse a certificate of which a range ends before it begins, so that nothing lies in it."""
    limits = found.limits
    demand(limits.speed_min <= limits.speed_max, "limits.speed_min is above limits.speed_max")
    if found.levels is not None:
        low, low_climb, high, high_climb = found.levels
        demand(low <= high and low_climb <= high_climb, "levels has a low level above the high one")
    for time in found.apart:
        demand(time.begin <= time.end, "a time of apart ends before it begins")
    for number, area in enumerate(found.areas):
        for name, (first, last) in (("valid", area.valid), ("heights", area.heights)):
            ordered = first is None or last is None or first < last
            demand(ordered, f"areas[{number}].{name} ends before it begins")
    origin = found.request
    whole = (origin.latitude is None) == (origin.longitude is None)
    demand(whole, "request has half of an origin")


def as_list(name: str, given: Any) -> list[Any]:
    """Return a list."""
    demand(isinstance(given, list), f"{name} is no list")
    return list(given)


def read_area(name: str, given: Any) -> Area:
    """Return an area; refuse one that is none."""
    right = isinstance(given, dict) and set(given) == set(Area._fields)
    demand(right, f"{name} has other fields than expected")
    demand(given["keep"] in ("out", "in"), f"{name}.keep is neither out nor in")
    for field in ("valid", "heights"):
        pair = given[field]
        demand(isinstance(pair, list) and len(pair) == 2, f"{name}.{field} is no pair")
        table(f"{name}.{field}", [[value] for value in pair if value is not None], 1)
    rings = [table(f"{name}.rings", ring, 2) for ring in as_list(f"{name}.rings", given["rings"])]
    circle = given["circle"]
    if circle == []:
        demand(bool(rings) and min(map(len, rings)) >= 3, f"{name} has no rings of 3 points")
    else:
        demand(not rings, f"{name} is both a circle and a polygon")
        circle = table(f"{name}.circle", [circle], 3)[0]
        demand(circle[2] > 0.0, f"{name} has no radius")
    growth, clearance = table(name, [[given["growth"], given["clearance"]]], 2)[0]
    velocity = table(name, [given["velocity"]], 2)[0]
    demand(clearance >= 0.0, f"{name} has a negative clearance")
    return Area(
        keep=given["keep"],
        circle=circle,
        rings=rings,
        velocity=velocity,
        growth=growth,
        clearance=clearance,
        valid=given["valid"],
        heights=given["heights"],
    )


def origin(given: Any) -> Origin:
    """Return which flight a certificate says that it belongs to."""
    right = isinstance(given, dict) and set(given) == set(Origin._fields)
    demand(right, "request has other fields than expected")
    found = Origin(**given)
    digest = found.policy is None or (
        type(found.policy) is str and re.fullmatch("[0-9a-f]{64}", found.policy) is not None
    )
    demand(digest, "request.policy is no SHA-256")
    dated = found.time_ns is None or (type(found.time_ns) is int and abs(found.time_ns) < 1 << 63)
    demand(dated, "request.time_ns is no whole number of 64 bits")
    for name, value, most in (
        ("latitude", found.latitude, 90),
        ("longitude", found.longitude, 360),
    ):
        inside = value is None or (type(value) in (int, float) and abs(value) <= most)
        demand(inside, f"request.{name} is no angle to {most} degrees")
    return found


def numbers(name: str, group: Any, fields: tuple[str, ...]) -> list[float]:
    """Return the numbers of a group by the order of its fields."""
    right = isinstance(group, dict) and set(group) == set(fields)
    demand(right, f"{name} has other fields than expected")
    return table(name, [[group[field] for field in fields]], len(fields))[0]


def table(name: str, rows: Any, width: int) -> list[list[float]]:
    """Return rows of numbers of moderate size."""
    sentence = f"{name} are not rows of {width} numbers below 1e8"
    demand(isinstance(rows, list), sentence)
    for row in rows:
        demand(isinstance(row, list) and len(row) == width, sentence)
        for value in row:
            # Not-a-number and infinity are not below it either.
            demand(type(value) in (int, float) and abs(value) < _LARGEST, sentence)
    return [[float(value) for value in row] for row in rows]


# The flight: legs are arcs of constant turn rate and acceleration.


class Arc(NamedTuple):
    """A part of a leg, flown exactly."""

    begin: Ball  # s after the request
    length: Ball  # s
    place: Ball  # at its beginning, x + iy, m
    end: Ball  # the place at its end
    course: Ball  # at its beginning, cos + i sin
    speed: Ball  # at its beginning, m/s
    acceleration: Ball  # m/s^2
    turn_rate: Ball  # rad/s
    quickest: Ball  # the greatest speed, m/s
    own_acceleration: Ball  # a bound of the magnitude of the whole acceleration, m/s^2

    def part(self, i: int, n: int) -> tuple[Ball, Ball]:
        """Return when the i-th of n equal parts begins and ends, s after the request."""
        if n == 1:
            return self.begin, self.begin + self.length
        step = self.length / ball(n)
        return self.begin + step * ball(i), self.begin + step * ball(i + 1)

    def place_after(self, t: Ball) -> Ball:
        """Return the place a time after the arc's beginning."""
        turn = spin(self.turn_rate * t)
        way = travel(self.course, turn, self.speed, self.acceleration, self.turn_rate, t)
        return self.place + way


class State(NamedTuple):
    """A plan state in the air mass, which lies over the ground at the request."""

    place: Ball  # x + iy, m
    course: Ball  # cos + i sin
    speed: Ball  # m/s

    def in_floats(self, time: float) -> PlanState:
        """Return it in floats."""
        x, y, cosine, sine = (
            part / (1 << BITS)
            for part in (self.place.x, self.place.y, self.course.x, self.course.y)
        )
        return PlanState(x, y, math.atan2(sine, cosine), self.speed.x / (1 << BITS), time)


def through_air(plan_state: PlanState | Report, time: Ball, wind: Wind) -> State:
    """Return a state over the ground, a time after the request, as the air mass sees it."""
    place, course, speed = (
        ball(plan_state.x, plan_state.y),
        spin(ball(plan_state.heading)),
        ball(plan_state.speed),
    )
    if wind.east == 0.0 == wind.north:
        return State(place, course, speed)
    blows = ball(wind.east, wind.north)
    velocity = course * speed - blows
    speed = velocity.size()
    if speed.hi <= ball(_FINE).hi:  # it goes with the air, on any course
        return State(place - blows * time, ONE, Ball(0, 0, speed.hi))
    demand(speed.lo > ball(_FINE).hi, "an aircraft hardly moves through the air")
    return State(place - blows * time, velocity / speed, speed)


class AirLimits(NamedTuple):
    """Limits of the flight through the air, m/s, m/s^2, rad/s."""

    speed_min: Ball
    speed_max: Ball
    acceleration_min: Ball
    acceleration_max: Ball
    yaw_rate_max: Ball


def air_limits(certificate: Certificate) -> AirLimits:
    """Return the limits in the air mass of the stated wind that hold the stated ones in every wind
    within its uncertainty.

    With an error e the airspeed differs by e at most, the acceleration along the path by e times
    the turn rate, and the turn rate is (v r + a e / v) / (v - e) at most. Turns take half of the
    weaker acceleration at most.
    """
    stated = AirLimits(*map(ball, certificate.limits))
    if certificate.wind.std == 0.0 or certificate.requirement.sigmas == 0.0:
        return stated
    error = ball(certificate.requirement.sigmas) * ball(certificate.wind.std)
    twice = TWO * error
    weakest, strongest = stated.acceleration_min, stated.acceleration_max
    gain = real(max(strongest.hi, -weakest.lo))
    # What could be slower is kept from that.
    slow = max(stated.speed_min, twice, gain / stated.yaw_rate_max, key=lambda one: one.hi)
    least = slow + error
    demand(least.lo > 0, "the lowest airspeed is not positive")
    # r = r_max v / (v + e) - a e / (v + e)^2
    turn = stated.yaw_rate_max * slow / least - gain * error / (least * least)
    half = real(min(strongest.lo, -weakest.hi)) / twice
    turn = half if half.hi < turn.hi else turn
    demand(turn.lo > 0, "the wind is too uncertain for the aircraft to turn")
    lost = turn * error
    return AirLimits(
        speed_min=least,
        speed_max=stated.speed_max - error,
        acceleration_min=weakest + lost,
        acceleration_max=strongest - lost,
        yaw_rate_max=turn,
    )


class Flight(NamedTuple):
    """The plan through the air."""

    arcs: list[Arc]
    until: Ball  # when it ends, s after the request
    longest: Ball  # of its arcs, s
    sagitta: int  # by which an arc leaves its chord at most, units
    way: int  # that it flies at most, with the sagittas and what the joints miss by, units

    @classmethod
    def of(cls, arcs: list[Arc]) -> "Flight":
        """Return the flight of some arcs, one after the other."""
        sagittas = [
            max((arc.own_acceleration * arc.length * arc.length / ball(8)).hi, ball(_TINY).hi)
            for arc in arcs
        ]
        ways = [(arc.length * arc.quickest + ball(_JOINT)).hi for arc in arcs]
        longest = max((arc.length for arc in arcs), key=lambda length: length.hi)
        until = arcs[-1].begin + arcs[-1].length
        return cls(arcs, until, longest, max(sagittas), sum(ways) + sum(sagittas))


def flight(certificate: Certificate) -> Flight:
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
        ends = start, goal
        if wind.east or wind.north:
            ends = begin.in_floats(start.time), end.in_floats(goal.time)
        for stated, defined in zip(controls, curve_controls(*ends), strict=True):
            demand(abs(stated - defined) <= _CONTROLS, f"{leg} is not flown along its curve")
        length = (ball(goal.time) - ball(start.time)) / ball(ARCS)
        each, reached = fly_leg(begin, start.time, length, controls)
        for arc in each:
            slowest = max(slowest, arc.speed.hi)
            fastest = min(fastest, arc.speed.lo)
            check_limits(leg, arc, limits, slowest, fastest)
        check_joint(leg, reached, end)
        arcs += each
    return Flight.of(arcs)


def fly_leg(
    start: State, time: float, length: Ball, controls: list[float]
) -> tuple[list[Arc], State]:
    """Fly a leg's arcs from a state at a time, s, each for ``length`` seconds; return them and the
    state at their end.

    In an arc of turn rate w and acceleration a, t after its beginning, the course has turned by
    w t, the speed is v + a t, and the place is that of :func:`travel`.
    """
    arcs = []
    place, course, speed = start
    for k in range(ARCS):
        turn_rate = ball(controls[k])
        acceleration = ball(controls[ARCS + k])
        turn = spin(turn_rate * length)
        end = place + travel(course, turn, speed, acceleration, turn_rate, length)
        after = speed + acceleration * length
        quickest = real(max(speed.hi, after.hi))
        arcs.append(
            Arc(
                begin=ball(time) + length * ball(k),
                length=length,
                place=place,
                end=end,
                course=course,
                speed=speed,
                acceleration=acceleration,
                turn_rate=turn_rate,
                quickest=quickest,
                # |a + i v w|: along the path and across it
                own_acceleration=(acceleration + J * quickest * turn_rate).size(),
            )
        )
        place, course, speed = end, course * turn, after
    return arcs, State(place, course, speed)


def check_limits(leg: str, arc: Arc, limits: AirLimits, slowest: int, fastest: int) -> None:
    """Check that an arc keeps the limits; where the plan has been beyond a speed limit ever since
    its beginning, that it goes no further.

    Speed is linear in time, so that both ends decide.

    Args:
        slowest, fastest: the greatest and the least speed at the beginning of any arc so far,
            units.
    """
    fine = ball(_FINE)
    after = arc.speed + arc.acceleration * arc.length
    forwards = min(arc.speed.lo, after.lo) > 0
    enough = after.lo >= min(limits.speed_min.hi, slowest) - fine.lo
    not_more = after.hi <= max(limits.speed_max.lo, fastest) + fine.lo
    demand(forwards and enough and not_more, f"{leg} leaves the speed limits")
    above = arc.acceleration.lo >= limits.acceleration_min.hi - fine.lo
    below = arc.acceleration.hi <= limits.acceleration_max.lo + fine.lo
    demand(above and below, f"{leg} leaves the acceleration limits")
    gentle = arc.turn_rate.size().hi <= limits.yaw_rate_max.lo + ball(_TURN).lo
    demand(gentle, f"{leg} turns too fast")


def check_joint(leg: str, reached: State, waypoint: State) -> None:
    """Check that a leg ends where its waypoint is, as fast and on its course."""
    fine = ball(_FINE).lo
    there = (reached.place - waypoint.place).size().hi <= ball(_JOINT).lo
    as_fast = (reached.speed - waypoint.speed).size().hi <= fine
    on_course = (reached.course - waypoint.course).size().hi <= fine
    demand(there and as_fast and on_course, f"{leg} misses its waypoint")


# The curve of a leg, in floats, as envs/waypoints.py defines it.


def gauss_legendre() -> list[tuple[float, float]]:
    """Return nodes and weights of the rule of four points over [0, 1].

    Over [-1, 1] the nodes are +-sqrt((3 +- 2 sqrt(6/5)) / 7), their weights
    (18 -+ sqrt(30)) / 36.
    """
    roots = [
        (s, q, math.sqrt((3.0 + q * math.sqrt(4.8)) / 7.0)) for q in (-1, 1) for s in (-0.5, 0.5)
    ]
    return [(0.5 + s * root, (18.0 - q * math.sqrt(30.0)) / 72.0) for s, q, root in roots]


_RULE = gauss_legendre()


def curve_controls(a: PlanState, b: PlanState) -> list[float]:
    """Return a leg's ten turn rates and ten accelerations: the curve of ten arcs with the least
    change of its controls from their means that ends where b stands, found by Newton steps.
    """
    h = (b.time - a.time) / ARCS
    turn = b.heading - a.heading
    turn -= math.tau * math.floor((turn + math.pi) * (1.0 / math.tau))
    if turn >= math.pi:
        turn -= math.tau  # half a circle is one to the right
    mean = [turn / (ARCS * h)] * ARCS + [(b.speed - a.speed) / (ARCS * h)] * ARCS
    found = mean
    for step in range(13):
        ways = arc_ways(a, found, h)
        miss = complex(b.x - a.x, b.y - a.y) - sum(ways)
        if abs(miss) <= 5e-4 or step == 12:
            break
        found = newton_step(mean, found, control_effects(ways, h), miss)
    return found


def arc_ways(a: PlanState, controls: list[float], h: float) -> list[complex]:
    """Return the way of each arc of h seconds from a, x + iy, m: the integral of
    (v + p t) exp(i (heading + w t)) over t from 0 to h, by the rule.
    """
    heading, speed, ways = a.heading, a.speed, []
    for w, p in zip(controls[:ARCS], controls[ARCS:], strict=True):
        way = sum(
            g * h * (speed + p * u * h) * cmath.rect(1.0, heading + w * u * h) for u, g in _RULE
        )
        ways.append(way)
        heading, speed = heading + w * h, speed + p * h
    return ways


def control_effects(ways: list[complex], h: float) -> list[tuple[float, complex]]:
    """Return of each control its weight and what a unit more of it adds to the leg's end, x + iy.

    More turn in an arc turns half of its own way and all after it to the left; more acceleration
    lengthens them along their directions. The means are taken off, so that the sums of the turn
    rates and of the accelerations stay as they are.
    """
    units = [h * h * way / max(abs(way), 1e-9) for way in ways]
    turns = [sum(ways[k:]) - 0.5 * ways[k] for k in range(ARCS)]
    gains = [sum(units[k:]) - 0.5 * units[k] for k in range(ARCS)]
    effects = [(4e-4, 1j * h * (one - sum(turns) / ARCS)) for one in turns]
    effects += [(4e-2, one - sum(gains) / ARCS) for one in gains]
    return effects


def newton_step(
    mean: list[float], found: list[float], effects: list[tuple[float, complex]], miss: complex
) -> list[float]:
    """Return the controls nearest their means whose end, to first order, lies ``miss`` from that
    of those found.

    With weights g and effects e they are mean + g Re(e conj(m)), where m solves the normal
    equations S m + D conj(m) = 2 miss: S is the sum of g |e|^2, D that of g e^2.
    """
    # From where the means end, to first order; what the means themselves add sums to nothing.
    miss += sum(e * u for (_, e), u in zip(effects, found, strict=True))
    s = sum(g * abs(e) ** 2 for g, e in effects)
    d = sum(g * e * e for g, e in effects)
    m = 2.0 * (s * miss - d * miss.conjugate()) / max(s * s - abs(d) ** 2, 4e-12)
    return [
        middle + g * (e * m.conjugate()).real for middle, (g, e) in zip(mean, effects, strict=True)
    ]


# The separation from an intruder.


class Track(NamedTuple):
    """An intruder that turns for a while after its report, then flies straight on."""

    place: Ball  # at the report, x + iy, m
    course: Ball  # at the report, cos + i sin
    speed: Ball  # m/s
    age: Ball  # of the report at the request, s
    turn_rate: Ball  # rad/s
    turn_time: Ball  # s
    position_std: Ball  # m
    velocity_std: Ball  # m/s
    separation: Ball  # m

    def place_at(self, t: Ball) -> Ball:
        """Return the place a time after the request."""
        time = t + self.age
        if self.turn_rate.x == self.turn_rate.r == 0:
            return self.place + self.course * self.speed * time
        turning = Ball(min(time.x, self.turn_time.x), 0, time.r + self.turn_time.r)
        turn = spin(self.turn_rate * turning)
        curve = travel(self.course, turn, self.speed, ZERO, self.turn_rate, turning)
        straight = self.course * turn * self.speed * (time - turning)
        return self.place + curve + straight

    def acceleration(self) -> Ball:
        """Return a bound of its acceleration after the request."""
        if self.turn_time.hi > self.age.lo:
            return (self.speed * self.turn_rate).size()
        return ZERO

    def report_distance(self) -> Ball:
        """Return how far its report and the request are apart, whichever came first, s."""
        return Ball(abs(self.age.x), 0, self.age.r)

    def uncertainty(self, t: Ball) -> Ball:
        """Return a standard deviation of its place per axis, a time t after the report, m: one
        error of the velocity lasts.

        This is |p + i v t|, with the deviations p of the place and v of the velocity.
        """
        return (self.position_std + J * self.velocity_std * t).size()


def track(report: Report, wind: Wind) -> Track:
    """Return an intruder's report in balls, in the air mass.

    What a turn through the air makes of the ground velocity depends on the wind: the velocity's
    error grows by that of the wind times the turn, or twice it.
    """
    turns = report.turn_time > 0.0  # a turn that lasts for no time is none
    seen = through_air(report, ball(-report.age), wind)
    turn = (ball(report.turn_rate) * ball(report.turn_time)).size()
    share = real(min(turn.hi, TWO.hi))
    return Track(
        place=seen.place,
        course=seen.course,
        speed=seen.speed,
        age=ball(report.age),
        turn_rate=ball(report.turn_rate) if turns else ZERO,
        turn_time=ball(report.turn_time),
        position_std=ball(report.position_std),
        velocity_std=ball(report.velocity_std) + share * ball(wind.std),
        separation=ball(report.separation),
    )


def chord_bound(first: Ball, last: Ball, sagitta: int) -> int:
    """Return a lower bound of the distance in a part of an arc, in units.

    Args:
        first: relative position at the part's beginning; with ``last`` at its end.
        sagitta: by which the relative motion leaves its chord at most, units (theorem
            ``chord_error``).
    """
    chord = last - first
    length = chord.size()
    best = 0
    if length.lo > 0:  # from the line through both ends
        cross = first.conjugate() * chord
        from_line = real(max(abs(cross.y) - cross.r, 0)) / length
        best = max(best, from_line.lo - sagitta)
    for end, way in ((first, chord), (last, ZERO - chord)):
        far = end.size()
        best = max(best, far.lo - length.hi - sagitta)
        grows = end.conjugate() * way
        if far.lo > 0 and grows.lo >= 0:  # from an end at which the range opens
            opening = (real(grows.lo) / far).lo
            rest = real(max(4 * sagitta - opening, 0))
            best = max(best, far.lo - (rest * rest / real(16 * sagitta)).hi)
    return best


def check_separation(
    number: int,
    certificate: Certificate,
    flown: Flight,
    apart: list[tuple[float, float]],
    work: Work,
) -> None:
    """Check that intruder ``number`` stays as far as it has to, and as the certificate claims.

    Arcs that are not clear are cut in two, into ``parts`` of the certificate at most. While the
    intruder is stated to be above or below, in some times (s), nothing is asked of it.
    """
    other = track(certificate.reports[number], certificate.wind)
    times = [(ball(begin), ball(until)) for begin, until in apart]
    away = (other.place_at(ZERO) - flown.arcs[0].place).size()
    keep = required_at_request(other, certificate.requirement, away, times)
    near = away.lo  # the distance at the beginning of an arc is this at least
    most = required_until(other, certificate.requirement, keep, flown.until)
    most = max(most, ball(certificate.bounds[number]).hi)
    bend = (other.acceleration() * flown.longest * flown.longest / ball(8)).hi
    if near - flown.way - (flown.until * other.speed).hi - bend >= most:
        return  # theorem left_out_soundly, of every arc
    work.spend(_WALK_WORK)
    for arc in flown.arcs:
        relative = arc.own_acceleration + other.acceleration()
        near -= (arc.length * (arc.quickest + other.speed)).hi  # theorem left_out_soundly
        if near - flown.sagitta - bend >= most:
            near -= ball(_JOINT).hi
            continue
        todo = [(0, 1)]  # the i-th of n equal parts
        while todo:
            i, n = todo.pop()
            work.spend(1)
            begin, later = arc.part(i, n)
            if above_or_below(times, begin, later):
                continue
            required = max(
                required_until(other, certificate.requirement, keep, later),
                ball(certificate.bounds[number]).hi,
            )
            # a h^2 / 8 of a part of the length h / n
            sagitta = max((relative * arc.length * arc.length / ball(8 * n * n)).hi, ball(_TINY).hi)
            first = relative_place(other, arc, i, n)
            last = relative_place(other, arc, i + 1, n)
            if n == 1:
                near = last.size().lo
            if chord_bound(first, last, sagitta) < required:
                when = later.hi / (1 << BITS)
                sentence = f"intruder {number} may come too close before {when:.2f} s"
                demand(n < certificate.parts, sentence)
                todo += [(2 * i, 2 * n), (2 * i + 1, 2 * n)]
        near -= ball(_JOINT).hi


def covered(times: list[tuple[float, float]], end: float) -> bool:
    """Return whether some times cover all from the request until an end, s."""
    until = 0.0
    for first, last in sorted(times):
        until = max(until, last) if first <= until else until
    return until >= end


def required_at_request(
    other: Track, requirement: Requirement, away: Ball, times: list[tuple[Ball, Ball]]
) -> int:
    """Return the distance that is to be kept from an intruder with what is known at the request,
    units: separation + margin + sigmas times the deviation of its place.

    A plan that begins nearer keeps its own distance ``away``, but never less than the separation.
    Where the intruder does not count at the request, within ``times``, that distance says nothing.
    """
    separation = other.separation
    deviation = other.uncertainty(other.report_distance())
    wanted = (separation + ball(requirement.margin) + ball(requirement.sigmas) * deviation).hi
    counts_later = any(begin.hi <= 0 < end.lo for begin, end in times)
    return wanted if counts_later else max(separation.hi, min(wanted, away.hi))


def required_until(other: Track, requirement: Requirement, keep: int, later: Ball) -> int:
    """Return the distance that is required until a time after the request, units: what is to be
    kept, and sigmas times the growth of the deviation; always the separation itself.
    """
    age = other.report_distance()
    deviation = other.uncertainty(age + later) - other.uncertainty(age)
    growth = (ball(requirement.sigmas) * deviation).hi
    return max(keep + growth - ball(_MARGIN).lo, other.separation.hi - ball(_ROUNDING).lo)


def above_or_below(times: list[tuple[Ball, Ball]], begin: Ball, end: Ball) -> bool:
    """Return whether a part of an arc lies within one of some times."""
    # No part begins before the request, though rounding may leave that open.
    now = max(begin.lo, 0)
    return any(first.hi <= now and end.hi <= last.lo for first, last in times)


def relative_place(other: Track, arc: Arc, k: int, n: int) -> Ball:
    """Return the intruder's place less the ownship's after k of n equal parts of an arc."""
    t = arc.length * ball(k) / ball(n)
    if k == 0:
        own = arc.place
    elif k == n:
        own = arc.end
    else:
        own = arc.place_after(t)
    return other.place_at(arc.begin + t) - own


# The clearance from an area.


class Ground(NamedTuple):
    """An area in the air mass."""

    area: Area
    edges: list[tuple[Ball, Ball]]  # of a polygon, x + iy, m
    velocity: Ball  # m/s

    def place_in_area(self, place: Ball, t: Ball) -> Ball:
        """Return a place at a time where the area stands still."""
        return place - self.velocity * t

    def allows(self, place: Ball) -> bool:
        """Return whether a polygon allows flight at a place; a ray from what is inside crosses the
        edges an odd number of times.

        It holds for all of the ball where no edge meets the ball.
        """
        odd = False
        for a, b in self.edges:
            if (a.y > place.y) != (b.y > place.y):
                turn = (b.x - a.x) * (place.y - a.y) - (b.y - a.y) * (place.x - a.x)
                odd ^= (turn > 0) == (b.y > a.y)
        return odd == (self.area.keep == "in")

    def signed_distance(self, place: Ball) -> int:
        """Return a lower bound of the signed distance of a place, units: from the edges where
        flight is allowed, less than 0 elsewhere.
        """
        if self.area.circle:
            x, y, radius = self.area.circle
            off = (place - ball(x, y)).size() - ball(radius)
            return off.lo if self.area.keep == "out" else -off.hi
        tiny = ball(_TINY).hi
        nearest = min(chord_bound(a - place, b - place, tiny) for a, b in self.edges)
        if nearest > 0 and self.allows(place):
            return nearest
        return -min(farthest_from_edge(place, a, b) for a, b in self.edges)

    def on_part(self, first: Ball, last: Ball, sagitta: int) -> int:
        """Return a lower bound of the signed distance on a part of a curve, units (theorems
        ``chord_keeps_sound`` and ``part_keeps``).
        """
        if self.area.circle:
            x, y, radius = self.area.circle
            begin, end = first - ball(x, y), last - ball(x, y)
            if self.area.keep == "out":
                return chord_bound(begin, end, sagitta) - ball(radius).hi
            return ball(radius).lo - max(begin.size().hi, end.size().hi) - sagitta
        nearest = min(edge_bound(first, last, a, b) for a, b in self.edges)
        if nearest > 0 and self.allows(first):
            return nearest - sagitta
        ends = self.signed_distance(first) + self.signed_distance(last)
        return (ends - (last - first).size().hi) // 2 - sagitta


def farthest_from_edge(place: Ball, a: Ball, b: Ball) -> int:
    """Return an upper bound of the distance of a place from an edge, units."""
    way = b - a
    share = (((place - a) * way.conjugate()).x << BITS) // max((way * way.conjugate()).x, 1)
    nearest = a + way * real(min(max(share, 0), ONE.x))
    return (nearest - place).size().hi


def edge_bound(p: Ball, q: Ball, a: Ball, b: Ball) -> int:
    """Return a lower bound of the distance between a chord and an edge, units (theorem
    ``edge_distance_sound``); far below 0 where they may cross.
    """
    tiny = ball(_TINY).hi
    ends = chord_bound(a - p, b - p, tiny), chord_bound(a - q, b - q, tiny)
    apart = on_one_side(a, b, p, q) or on_one_side(p, q, a, b)
    if not apart:
        beyond = ends[0] - (q - p).size().hi
        return beyond if beyond > 0 else -1 << (BITS + 30)
    return min(*ends, chord_bound(p - a, q - a, tiny), chord_bound(p - b, q - b, tiny))


def on_one_side(a: Ball, b: Ball, p: Ball, q: Ball) -> bool:
    """Return whether p and q are certainly on one side of the line through a and b."""
    sides = [(b - a).conjugate() * (end - a) for end in (p, q)]
    signs = {(side.y > side.r) - (side.y < -side.r) for side in sides}
    return signs in ({1}, {-1})


def counts(area: Area, levels: Levels | None, begin: Ball, end: Ball) -> bool:
    """Return whether an area may count at some time between two, s after the request."""
    start, last = area.valid
    if (start is not None and end.hi < ball(start).lo) or (
        last is not None and begin.lo > ball(last).hi
    ):
        return False
    if levels is None or area.keep == "in":
        return True
    floor, ceiling = area.heights
    low, low_climb, high, high_climb = map(ball, levels)
    highest = max((high + high_climb * t).hi for t in (begin, end))
    lowest = min((low + low_climb * t).lo for t in (begin, end))
    return not (
        (floor is not None and highest < ball(floor).lo)
        or (ceiling is not None and lowest > ball(ceiling).hi)
    )


def check_area(
    number: int, area: Area, flown: Flight, certificate: Certificate, work: Work
) -> None:
    """Check that the plan keeps the clearance from area ``number`` while it counts."""
    corners = [[ball(*place) for place in ring] for ring in area.rings]
    edges = [(ring[n - 1], ring[n]) for ring in corners for n in range(len(ring))]
    wind, levels = certificate.wind, certificate.levels
    velocity = ball(*area.velocity) - ball(wind.east, wind.north)
    ground = Ground(area, edges, velocity)
    growth = ball(area.growth) if area.keep == "out" else ball(-area.growth)
    wanted = (ball(area.clearance) + ball(certificate.requirement.margin)).hi
    work.spend(_EDGE_WORK * len(edges))
    near = ground.signed_distance(flown.arcs[0].place)  # at an arc's beginning this at least
    if counts(area, levels, ZERO, ZERO):
        # A plan that begins inside the clearance must not come nearer, but for some millimetres.
        wanted = min(wanted, max(near - ball(_NEARER).lo, 0))
    need = max(wanted - ball(_MARGIN).lo, -ball(_ROUNDING).lo)
    quickest = velocity.size()
    for arc in flown.arcs:
        near -= (arc.length * (arc.quickest + quickest)).hi  # theorem keeps_near
        todo = [(0, 1)]
        while todo:
            i, n = todo.pop()
            work.spend(1)
            begin, later = arc.part(i, n)
            if not counts(area, levels, begin, later):
                continue
            required = need + max((growth * begin).hi, (growth * later).hi)
            if n == 1 and near >= required:
                continue
            work.spend(_EDGE_WORK * len(edges))
            length = arc.length / ball(n)
            sagitta = max((arc.own_acceleration * length * length / ball(8)).hi, ball(_TINY).hi)
            first = ground.place_in_area(own_place(arc, i, n), begin)
            last = ground.place_in_area(own_place(arc, i + 1, n), later)
            if n == 1:
                near = ground.signed_distance(last)
            if ground.on_part(first, last, sagitta) < required:
                sentence = f"area {number} may not be kept clear of before"
                demand(n < certificate.parts, f"{sentence} {later.hi / (1 << BITS):.2f} s")
                todo += [(2 * i, 2 * n), (2 * i + 1, 2 * n)]
        near -= ball(_JOINT).hi


def own_place(arc: Arc, k: int, n: int) -> Ball:
    """Return the ownship's place after k of n equal parts of an arc."""
    if k == 0:
        return arc.place
    return arc.end if k == n else arc.place_after(arc.length * ball(k) / ball(n))


def check_altitudes(certificate: Certificate) -> None:
    """Check that intruders stay above or below while they are said to, and that all that is said of
    their altitudes and of the ownship's is the same.
    """
    end = certificate.plan_states[-1].time
    for heights in certificate.excluded:
        side = side_of(heights, 0.0, end)
        demand(side != 0, "an excluded intruder does not stay above or below")
        check_own_altitude("excluded", heights, side, certificate.levels)
    sides: dict[tuple[int, int], Heights] = {}
    for number, begin, until, heights in certificate.apart:
        name = f"intruder {number}"
        side = side_of(heights, begin, until)
        demand(side != 0, f"{name} does not stay above or below from {begin:.2f} s on")
        check_own_altitude("apart", heights, side, certificate.levels)
        as_reported = heights.age == certificate.reports[number].age
        demand(as_reported, f"the age of {name} in apart is not that in intruders")
        same = sides.setdefault((number, side), heights) == heights
        demand(same, f"{name} has more than one altitude in apart")
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
    now = at_request + (other_climb - own_climb) * ball(begin)
    then = at_request + (other_climb - own_climb) * ball(end)
    apart = ball(heights.vertical).hi
    if min(now.lo, then.lo) >= apart:
        return 1
    return -1 if max(now.hi, then.hi) <= -apart else 0


def check_own_altitude(name: str, heights: Heights, side: int, levels: Levels | None) -> None:
    """Check that the ownship is as near to an intruder on a side as its levels allow."""
    nearest = None if levels is None else levels[2:] if side > 0 else levels[:2]
    same = nearest == (heights.own, heights.own_climb)
    demand(same, f"{name} has another altitude of the ownship than levels")


def accept(data: Any, work: Work | None = None) -> Certificate:
    """Return what a certificate proves, with some work at most; raise RefusedError where it proves
    nothing.
    """
    certificate = read(data)
    work = work or Work()
    work.spend(_LEG_WORK * len(certificate.controls))
    work.spend(len(certificate.reports) + len(certificate.excluded) + len(certificate.apart))
    flown = flight(certificate)
    check_altitudes(certificate)
    apart: dict[int, list[tuple[float, float]]] = {}
    for time in certificate.apart:
        apart.setdefault(time.number, []).append((time.begin, time.end))
    end = certificate.plan_states[-1].time
    for number, bound in enumerate(certificate.bounds):
        times = apart.get(number, [])
        never = bound > 0.0 or covered(times, end)
        demand(never, f"intruder {number} counts, but its bound of 0 says that it never does")
        check_separation(number, certificate, flown, times, work)
    for number, area in enumerate(certificate.areas):
        check_area(number, area, flown, certificate, work)
    return certificate


# The command.


def summary(certificate: Certificate) -> list[str]:
    """Return what is proven, in sentences."""
    limits, wanted, wind = certificate.limits, certificate.requirement, certificate.wind
    lines = [
        separation_sentence(certificate),
        excluded_sentence(certificate.excluded),
        f"required: {wanted.separation:g} m and a margin of {wanted.margin:g} m, "
        f"{wanted.sigmas:g} sigmas of uncertainty",
    ]
    own = [
        f"{number}: {one.separation:g} m"
        for number, one in enumerate(certificate.reports)
        if one.separation != wanted.separation
    ]
    if own:
        lines.append(f"separations of their own: intruders {', '.join(own)}")
    lines.append(
        f"limits: {limits.speed_min:g} to {limits.speed_max:g} m/s, "
        f"{limits.acceleration_min:g} to {limits.acceleration_max:g} m/s^2, "
        f"{math.degrees(limits.yaw_rate_max):g} deg/s"
    )
    if certificate.areas:
        lines.append(f"areas: {len(certificate.areas)}; their clearances are kept while they count")
    if wind != Wind(0.0, 0.0, 0.0):
        lines.append(
            f"wind: {wind.east:g} m/s towards the east, {wind.north:g} m/s towards the north, "
            f"{wind.std:g} m/s one sigma of both"
        )
    lines.append(origin_sentence(certificate.request))
    return lines


def separation_sentence(certificate: Certificate) -> str:
    """Say how near the intruders come."""
    end = certificate.plan_states[-1].time
    if not certificate.reports:
        return f"intruders: none; the flight is proven until {end:.1f} s after the request"
    # Of an intruder that never counts nothing is claimed.
    least = min((bound for bound in certificate.bounds if bound > 0.0), default=0.0)
    sentence = (
        f"intruders: {len(certificate.reports)}; none comes closer than {least:.3f} m until "
        f"{end:.1f} s after the request"
    )
    timed = sorted({time.number for time in certificate.apart})
    if timed:
        vertical = min(time.heights.vertical for time in certificate.apart)
        numbers = ", ".join(map(str, timed))
        sentence += f", but while {vertical:g} m or more above or below: {numbers}"
    return sentence


def excluded_sentence(excluded: list[Heights]) -> str:
    """Say how many intruders are left out, and how far they are above or below."""
    sentence = f"left out: {len(excluded)}"
    if excluded:
        least = min(one.vertical for one in excluded)
        sentence += f", {least:g} m or more above or below"
    return sentence


def origin_sentence(about: Origin) -> str:
    """Say which flight the certificate belongs to."""
    place = "unknown"
    if about.latitude is not None and about.longitude is not None:
        place = f"{about.latitude:.6f}, {about.longitude:.6f}"
    time = "unknown" if about.time_ns is None else f"{about.time_ns} ns"
    return f"policy: {about.policy or 'unknown'}; time: {time}; origin: {place}"


class Standard(NamedTuple):
    """What a certificate is held to beside the aircraft's file, which says nothing of it."""

    vertical: float = 600.0  # separation, m
    sigmas: float = 2.0  # of the uncertainty


STANDARD = Standard()


def check_aircraft(
    certificate: Certificate, aircraft: Mapping[str, float], standard: Standard = STANDARD
) -> None:
    """Refuse limits beyond those of an aircraft file, separations below its own, and what is below
    a standard.
    """
    vehicle = {name: aircraft.get(f"vehicle.{name}", value) for name, value in aircraft.items()}
    limits, wanted = certificate.limits, certificate.requirement
    turn = math.radians(vehicle["yaw_rate_max_deg_s"])
    inside = (
        ("speed_min", limits.speed_min >= vehicle["speed_min_mps"]),
        ("speed_max", limits.speed_max <= vehicle["speed_max_mps"]),
        ("acceleration_min", limits.acceleration_min >= vehicle["acceleration_min_mps2"]),
        ("acceleration_max", limits.acceleration_max <= vehicle["acceleration_max_mps2"]),
        ("yaw_rate_max", limits.yaw_rate_max <= turn * (1.0 + 1e-9)),
    )
    for name, holds in inside:
        demand(holds, f"its {name} is {getattr(limits, name):g}, beyond the aircraft's")
    check_own_speed(certificate, aircraft, vehicle)
    check_standard(certificate, standard)
    enough = wanted.separation >= aircraft["separation_m"]
    demand(enough, f"its separation is {wanted.separation:g} m, below the aircraft's")
    for number, one in enumerate(certificate.reports):
        demand(
            one.separation >= aircraft["separation_m"],
            f"the separation from intruder {number} is {one.separation:g} m, below the aircraft's",
        )


def check_standard(certificate: Certificate, standard: Standard) -> None:
    """Refuse a vertical separation, or a number of sigmas, below a standard."""
    heights = [*certificate.excluded, *(time.heights for time in certificate.apart)]
    least = min((one.vertical for one in heights), default=math.inf)
    expected = f"below {standard.vertical:g} m (--vertical-separation)"
    demand(least >= standard.vertical, f"a vertical separation is {least:g} m, {expected}")
    sigmas = certificate.requirement.sigmas
    expected = f"below {standard.sigmas:g} (--sigmas)"
    demand(sigmas >= standard.sigmas, f"its uncertainty counts {sigmas:g} sigmas, {expected}")


def check_own_speed(
    certificate: Certificate, aircraft: Mapping[str, float], vehicle: Mapping[str, float]
) -> None:
    """Refuse an airspeed at the request that is beyond the aircraft's, by more than a hundredth of
    the greatest that the planner allows; a plan that begins beyond its limits may stay there.
    """
    speed = through_air(certificate.plan_states[0], ZERO, certificate.wind).speed.x / (1 << BITS)
    least = min(one["speed_min_mps"] for one in (aircraft, vehicle))
    most = max(one["speed_max_mps"] for one in (aircraft, vehicle))
    inside = least - 0.011 * most <= speed <= 1.011 * most
    demand(inside, f"its speed at the request is {speed:g} m/s, beyond the aircraft's")


def read_aircraft(text: str) -> dict[str, float]:
    """Return the numbers of an aircraft file: lines ``key: number``, those of a group ``vehicle:``
    indented.

    Raises ValueError for anything else that YAML could hold, and for a key that stands twice.
    """
    found: dict[str, float] = {}
    group = ""
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].rstrip()
        if not content:
            continue
        key, colon, value = content.strip().partition(":")
        if not content[0].isspace():
            group = ""
        if content == "vehicle:":
            group = "vehicle."
            continue
        name = group + key
        if not colon or name in found:
            raise ValueError(f"line {number}: {content.strip()!r}; expected key: number, once each")
        try:
            found[name] = float(value)
        except ValueError:
            raise ValueError(f"line {number}: {value.strip()!r} is no number") from None
    needed = ("speed_min_mps", "speed_max_mps", "acceleration_min_mps2", "acceleration_max_mps2")
    limits = (*needed, "yaw_rate_max_deg_s")
    of_vehicle = [f"vehicle.{name}" for name in limits]
    stated = any(name.startswith("vehicle.") for name in found)
    for name in (*limits, "separation_m", *(of_vehicle if stated else ())):
        if name not in found:
            raise ValueError(f"{name} is missing")
    return found


def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; one with a key that stands twice means two things, and is none."""
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"the key {key!r} stands twice")
        found[key] = value
    return found


def shipped(path: Path) -> Path:
    """Return the file of an aircraft that ships where a path is its name alone and no file."""
    folder = Path(__file__).with_name("configs") / "aircraft"
    file = folder / f"{path}.yaml"
    return file if not path.exists() and path.name == str(path) and file.is_file() else path


def load(path: Path, what: str) -> bytes:
    """Return the content of a regular file, or raise ValueError."""
    if not path.exists():
        raise ValueError(f"there is no such file; expected {what}")
    if not path.is_file():
        raise ValueError(f"it is not a regular file; expected {what}")
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"it is larger than {_MOST_BYTES >> 20} MiB; expected {what}")
    return path.read_bytes()


def main(arguments: list[str] | None = None) -> int:
    """Check a file; return the exit status, 130 after Ctrl-C."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # what its encoding lacks stands there as a code
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = check(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except OSError as problem:
        print(f"the output cannot be written: {problem.strerror}", file=sys.stderr)
        # What is still buffered must not complain again at the exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 2
    return status


def size(text: str) -> float:
    """Return a number of the command line that is 0 or more."""
    value = float(text)
    if not 0.0 <= value < _LARGEST:
        raise argparse.ArgumentTypeError(f"{text!r} is no number from 0 on")
    return value


def check(arguments: list[str] | None) -> int:
    """Check a file and print what was found; return the exit status."""
    called = Path(sys.argv[0]).name
    parser = argparse.ArgumentParser(
        prog=called if called.startswith("rlcas-") else "python -m agents.check",
        description="Check the certificate of a plan: exit status 0 accepted, 1 refused, "
        "2 unreadable or bad usage.",
    )
    parser.add_argument("--version", action="version", version=FORMAT)
    parser.add_argument("file", type=Path, help="the certificate")
    parser.add_argument(
        "--aircraft",
        type=Path,
        metavar="FILE",
        help="aircraft file whose limits the plan must keep, and whose separation, or the name of "
        "one that ships, such as paper (default: those that the certificate states)",
    )
    parser.add_argument(
        "--vertical-separation",
        type=size,
        metavar="METRES",
        help=f"with --aircraft: the least vertical separation, m (default {STANDARD.vertical:g})",
    )
    parser.add_argument(
        "--sigmas",
        type=size,
        metavar="COUNT",
        help="with --aircraft: the least number of sigmas of what is uncertain "
        f"(default {STANDARD.sigmas:g})",
    )
    options = parser.parse_args(arguments)
    given = {"vertical": options.vertical_separation, "sigmas": options.sigmas}
    given = {name: value for name, value in given.items() if value is not None}
    if given and options.aircraft is None:
        parser.error("--vertical-separation and --sigmas need --aircraft")
    standard = STANDARD._replace(**given)
    path = reading = options.file
    name = str(path).encode(errors="replace").decode()  # it may hold bytes that are no text
    aircraft = None
    try:
        data = json.loads(load(path, "a certificate"), object_pairs_hook=once)
        if options.aircraft is not None:
            reading = shipped(options.aircraft)
            aircraft = read_aircraft(load(reading, "an aircraft file").decode())
    except (OSError, ValueError, RecursionError) as problem:
        print(f"{reading}: cannot be read: {problem}", file=sys.stderr)
        return 2
    try:
        certificate = accept(data)
        if aircraft is not None:
            check_aircraft(certificate, aircraft, standard)
    except (ValueError, ArithmeticError) as problem:
        print(f"{name}: refused: {problem}", file=sys.stderr)
        return 1
    print(f"{name}: accepted")
    for sentence in summary(certificate):
        print(f"  {sentence}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
