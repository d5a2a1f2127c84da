"""Motion through the air: where an aircraft is that turns and accelerates evenly."""

import math
from typing import NamedTuple

from .balls import ONE, TWO, ZERO, Ball, J, ball, cis, to_float
from .certificate import PlanState, Report, Wind
from .refusal import demand
from .tolerances import FINE


class AirState(NamedTuple):
    """An aircraft in the air mass, which lies over the ground at the request."""

    position: Ball  # x + iy, m
    course: Ball  # cos + i sin
    speed: Ball  # m/s

    def in_floats(self, time: float) -> PlanState:
        """Return it as a plan state at a time, s."""
        return PlanState(
            x=to_float(self.position.x),
            y=to_float(self.position.y),
            heading=math.atan2(to_float(self.course.y), to_float(self.course.x)),
            speed=to_float(self.speed.x),
            time=time,
        )


def through_air(ground: PlanState | Report, time: Ball, wind: Wind) -> AirState:
    """Return a state over the ground, a time after the request, as the air mass sees it."""
    position = ball(ground.x, ground.y)
    course = cis(ball(ground.heading))
    speed = ball(ground.speed)
    if wind.east == 0.0 == wind.north:
        return AirState(position, course, speed)
    air = ball(wind.east, wind.north)
    velocity = course * speed - air
    speed = velocity.magnitude()
    if speed.hi <= ball(FINE).hi:  # it goes with the air, on any course
        return AirState(position - air * time, ONE, Ball(0, 0, speed.hi))
    demand(speed.lo > ball(FINE).hi, "an aircraft hardly moves through the air")
    return AirState(position - air * time, velocity / speed, speed)


def displacement(course: Ball, turn: Ball, v: Ball, a: Ball, w: Ball, t: Ball) -> Ball:
    """Return how far one gets in a time t with speed v + a t, on a course that turns by w t.

    Course and turn are given as cos + i sin. This is the integral of
    (v + a s) exp(i (course + w s)) over s from 0 to t.
    """
    if w.x == w.r == 0:
        return course * t * (v + a * t / TWO)
    through_speed = ((v + a * t) * turn - v) * (ZERO - J)
    through_acceleration = a * (turn - ONE) / w
    return course * (through_speed + through_acceleration) / w
