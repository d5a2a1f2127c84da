"""Requests of the attack as a user of ``agents.planner.plan`` writes them, and what its answer must
keep.

The reports of the intruders are some seconds old, turning ones turned then already, some straight
ones have just ended a turn, some have altitudes, and the indices of the route are drawn so that
careless new ones would meet them. What the planner is given is the report; what it is judged by is
where that leads, by this package's own arithmetic.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.planner.answer import WAYPOINTS, Plan
from agents.planner.planner import plan
from agents.planner.request import Altitude, Intruder, Options, Request
from agents.planner.traffic import Traffic
from agents.policy.inference import Policy
from benchmarks.safety.resimulation import travelled
from envs import waypoints
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import Knots, RoutePoint

__all__ = ["Question", "as_arrays", "faults", "question"]


class Question(NamedTuple):
    """One request."""

    own: VehicleState
    intruders: list[Intruder]
    route: list[RoutePoint]
    altitude: Altitude | None
    truth: Request
    """The same as arrays without leading axis, intruders ``[K]``: those reported, at the request.
    """

    def asked(self, policy: Policy, options: Options) -> Plan:
        """Return the planner's answer."""
        return plan(
            self.own, self.intruders, self.route, policy, options, own_altitude=self.altitude
        )


def question(seed: int, number: int, request: Request) -> Question:
    """Return a request ``[]`` of the attack as ``plan`` takes it."""
    rng = np.random.default_rng([seed, number])
    traffic = request.traffic
    ages = np.array(traffic.age)
    intruders: list[Intruder] = []
    present = np.flatnonzero(traffic.mask)
    order = np.concatenate([present, np.flatnonzero(~traffic.mask)])
    for k in present:
        one = take(traffic, int(k))
        age = float(rng.uniform(-0.5, 5.0)) if rng.random() < 0.5 else 0.0
        if one.turn_rate != 0.0 and one.turn_time > 0.0:
            # A turn that ends before a report from the future would not be in it.
            age = age if float(one.turn_time) + age > 0.0 else 0.0
        ages[k] = abs(age)
        state, rate, lasts = _reported(rng, one, age)
        height = None
        if rng.random() < 0.3:
            reference = "msl" if rng.random() < 0.8 else "wgs84"
            height = Altitude(
                float(rng.uniform(-1_000.0, 5_000.0)), reference, float(rng.normal(0.0, 3.0))
            )
        intruders.append(
            Intruder(
                state, age, rate, lasts, float(one.position_std), float(one.velocity_std), height
            )
        )
    count = int(request.points)
    indices = rng.permutation(2 * count)[:count].tolist()
    points = zip(
        indices, request.route_x[:count].tolist(), request.route_y[:count].tolist(), strict=True
    )
    own = VehicleState(*(float(value) for value in request.own))
    altitude = Altitude(2_000.0, "msl", float(rng.normal(0.0, 3.0))) if rng.random() < 0.7 else None
    truth = request._replace(traffic=take(traffic._replace(age=ages), order))
    return Question(own, intruders, [RoutePoint(*point) for point in points], altitude, truth)


def _reported(
    rng: np.random.Generator, one: Traffic, age: float
) -> tuple[VehicleState, float, float]:
    """Return the state, turn rate and duration of a turn in a report of some age that leads to an
    intruder ``[]``.
    """
    x, y, heading, speed = (float(value) for value in one.state)
    rate, lasts = float(one.turn_rate), float(one.turn_time) + age
    if rate == 0.0 or lasts <= max(age, 0.0):
        ended = age > 0.0 and rng.random() < 0.5
        rate, lasts = (
            (float(rng.uniform(-0.08, 0.08)), float(rng.uniform(0.0, age))) if ended else (0.0, 0.0)
        )
    before = heading - rate * min(age, lasts)
    place = x + 1j * y - complex(travelled(before, speed, rate, lasts, age))
    return (
        VehicleState(place.real, place.imag, math.remainder(before, 2.0 * math.pi), speed),
        rate,
        lasts,
    )


def faults(question: Question, answer: Plan, options: Options) -> list[str]:
    """Return what an answer breaks of what is promised beside limits and separation."""
    wrong: list[str] = []
    if answer.safe == bool(answer.reasons):
        wrong.append("reasons")
    if not answer.safe:
        return wrong
    if len(answer.waypoints) != WAYPOINTS:
        return [*wrong, "count"]
    taken = {point.index for point in question.route}
    indices = [point.index for point in answer.waypoints]
    fresh = indices if options.extend_route and indices[-1] not in taken else indices[:-1]
    if len(set(indices)) != WAYPOINTS or taken & set(fresh) or not taken & {answer.goal_index}:
        wrong.append("indices")
    if fresh is not indices and indices[-1] not in taken:
        wrong.append("last index")
    end = answer.waypoints[-1].time
    if any(not _apart(question, one.number, end, options) for one in answer.excluded):
        wrong.append("vertical")
    return wrong


def _apart(question: Question, number: int, end: float, options: Options) -> bool:
    """Return whether an intruder that was left out stays vertically apart until the plan's end."""
    own, report = question.altitude, question.intruders[number]
    other = report.altitude
    if own is None or other is None or own.reference != other.reference:
        return False
    # Every question is drawn with known vertical speeds.
    assert own.vertical_speed is not None and other.vertical_speed is not None
    now = other.value + other.vertical_speed * report.age - own.value
    later = now + (other.vertical_speed - own.vertical_speed) * end
    return now * later > 0.0 and min(abs(now), abs(later)) > options.vertical_filter


def as_arrays(question: Question, answer: Plan) -> tuple[Knots, Any, Request]:
    """Return a plan's knots ``[21]``, the number of its last point of the route, and the request as
    it was planned for.

    The request has no leading axis; intruders that were left out are masked.
    """
    indices = [point.index for point in question.route]
    last = answer.waypoints[-1].index
    number = indices.index(last) if last in indices else len(indices)
    mask = np.zeros(np.shape(question.truth.traffic.mask), dtype=bool)
    mask[: len(question.intruders)] = True
    mask[[one.number for one in answer.excluded]] = False
    traffic = question.truth.traffic._replace(mask=mask)
    knots = waypoints.knots(question.own, answer.waypoints)
    return knots, np.array(number), question.truth._replace(traffic=traffic)
