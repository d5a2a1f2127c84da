"""The geometry of the scenarios that ship: aircraft that would meet in a common point."""

import math
from typing import NamedTuple

from envs.angles import sincos, wrap
from envs.arrays import Array, ArrayModule
from envs.encounters import (
    Encounter,
    Scenario,
    between,
    columns,
    meets_conditions,
    one_turn,
    sensor_of,
)
from envs.frames import Air
from envs.kinematics import VehicleState


class _Draws(NamedTuple):
    """Draws of :func:`conflict_point` for encounters ``[N]``."""

    radius: Array
    course: Array
    speed: Array
    shift_x: Array
    shift_y: Array
    count: Array  # of the intruders
    age: Array  # of the reports


class _DrawsOfEach(NamedTuple):
    """Draws of :func:`conflict_point` for their intruders ``[N, K]``."""

    course: Array
    speed: Array
    shift_x: Array
    shift_y: Array
    turn_rate: Array
    onset: Array
    heading_change: Array


def conflict_point(scenario: Scenario, draws: Array, xp: ArrayModule) -> tuple[Encounter, Array]:
    """Return encounters ``[N]`` around a common conflict point (the paper's "circle" and variants
    of it), from draws ``[N, 7 + 7 K]``, and which of them meet the conditions, ``[N]``.

    Ownship and intruders start so far from the centre that they would meet there at the same time;
    then every start is displaced.
    """
    fewest, most = scenario.intruders
    shared = _Draws(*(draws[:, i] for i in range(7)))
    of_intruders = _DrawsOfEach(*columns(draws, 7, most, 7))

    radius = between(scenario.radius, shared.radius)
    course = between((-math.pi, math.pi), shared.course)
    speed = between(scenario.own_speed, shared.speed)
    sine, cosine = sincos(course, xp)
    goal_x, goal_y = radius * cosine, radius * sine
    shift = (-scenario.displacement, scenario.displacement)
    own: VehicleState[Air] = VehicleState(
        between(shift, shared.shift_x) - goal_x,
        between(shift, shared.shift_y) - goal_y,
        course,
        speed,
    )

    intruder_course = wrap(
        course[:, None] - between(scenario.course_difference, of_intruders.course), xp
    )
    intruder_speed = between(scenario.intruder_speed, of_intruders.speed)
    sine, cosine = sincos(intruder_course, xp)
    back = (radius / speed)[:, None] * intruder_speed
    intruders: VehicleState[Air] = VehicleState(
        between(shift, of_intruders.shift_x) - back * cosine,
        between(shift, of_intruders.shift_y) - back * sine,
        intruder_course,
        intruder_speed,
    )
    count = fewest + xp.floor(shared.count * (most - fewest + 1))
    mask = xp.arange(most)[None, :] < count[:, None]

    to_turn = of_intruders.turn_rate, of_intruders.onset, of_intruders.heading_change
    intent = one_turn(scenario, own, intruders, to_turn, xp)
    sensor = sensor_of(scenario, shared.age, xp)
    accepted = meets_conditions(scenario, own, intruders, mask, xp)
    return Encounter(own, goal_x, goal_y, intruders, mask, intent, sensor), accepted
