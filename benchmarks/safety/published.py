"""Requests of the attack as a user of ``agents.planner.plan`` writes them, and what its answer must
keep.

The reports of the intruders are some seconds old, turning ones turned then already, some straight
ones have just ended a turn, some have altitudes, and the indices of the route are drawn so that
careless new ones would meet them. What the planner is given is the report; what it is judged by is
where that leads, by this package's own arithmetic.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.planner.answer import WAYPOINTS, Plan
from agents.planner.planner import plan
from agents.planner.request import Altitude, Intruder, Options, Request
from agents.planner.traffic import Traffic, Window
from agents.policy.inference import Policy
from benchmarks.safety.resimulation import CLOSE, displacement
from envs import waypoints
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, RoutePoint

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

    def ask(self, policy: Policy, options: Options) -> Plan:
        """Return the planner's answer."""
        return plan(
            self.own, self.intruders, self.route, policy, options, own_altitude=self.altitude
        )


def question(seed: int, number: int, request: Request, unit: float) -> Question:
    """Return a request ``[]`` of the attack as ``plan`` takes it; ``unit``: the separation, m."""
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
        state, rate, lasts = _report_before(rng, one, age)
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
    intruders, own_separations = _draw_separations(seed, number, intruders, len(order), unit)
    traffic = traffic._replace(separation=own_separations[np.argsort(order)])
    count = int(request.points)
    indices = rng.permutation(2 * count)[:count].tolist()
    points = zip(
        indices, request.route_x[:count].tolist(), request.route_y[:count].tolist(), strict=True
    )
    own = VehicleState(*(float(value) for value in request.own))
    altitude = Altitude(2_000.0, "msl", float(rng.normal(0.0, 3.0))) if rng.random() < 0.7 else None
    truth = request._replace(traffic=take(traffic._replace(age=ages), order))
    return Question(own, intruders, [RoutePoint(*point) for point in points], altitude, truth)


def _draw_separations(
    seed: int, number: int, intruders: list[Intruder], places: int, unit: float
) -> tuple[list[Intruder], Any]:
    """Return the intruders, a third of them with separations of their own, and those of all places,
    m, ``[K]``; nan: the requirement's.
    """
    rng, found, own = np.random.default_rng([seed, number, 53]), [], np.full(places, np.nan)
    for place, one in enumerate(intruders):
        share, vertical = rng.choice([0.3, 0.7, 1.5, 2.5]), float(rng.choice([150.0, 900.0]))
        changes: dict[str, Any] = {}
        if rng.random() < 1.0 / 3.0:
            own[place] = share * unit
            changes["separation"] = float(own[place])
        if rng.random() < 1.0 / 3.0:
            changes["vertical_separation"] = vertical
        if one.altitude is not None and rng.random() < 0.5:
            error = float(rng.uniform(0.0, 200.0))
            changes["altitude"] = replace(one.altitude, error=error, climb_error=0.3)
        found.append(replace(one, **changes))
    return found, own


def _report_before(
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
    place = x + 1j * y - complex(displacement(before, speed, rate, lasts, age))
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
    times = np.arange(0.0, end, CLOSE)
    if any(_level(question, one.number, times, options).any() for one in answer.excluded):
        wrong.append("vertical")
    return wrong


def _level(question: Question, number: int, times: Any, options: Options) -> Any:
    """Return at which times, s, an intruder may be nearer above or below than its vertical
    separation, bool.
    """
    own, report = question.altitude, question.intruders[number]
    other = report.altitude
    if own is None or other is None or own.reference != other.reference:
        return np.ones(len(times), dtype=bool)
    heights = []
    for one, since in ((own, times), (other, times + report.age)):
        climb, off = one.vertical_speed, one.climb_error
        if climb is None:
            climb, off = 0.0, options.unknown_climb
        middle, width = one.value + climb * since, one.error + off * np.abs(since)
        heights.append((middle - width, middle + width))
    (low, high), (low_other, high_other) = heights
    away = np.maximum(low_other - high, low - high_other)
    own_least = report.vertical_separation
    return away <= (options.vertical_filter if own_least is None else own_least)


def as_arrays(
    question: Question, answer: Plan, options: Options
) -> tuple[PlanStates, Any, Request]:
    """Return a plan's states ``[21]``, the number of its last point of the route, and the request
    as it was planned for.

    The request has no leading axis; intruders that were left out are masked.
    """
    indices = [point.index for point in question.route]
    last = answer.waypoints[-1].index
    number = indices.index(last) if last in indices else len(indices)
    mask = np.zeros(np.shape(question.truth.traffic.mask), dtype=bool)
    mask[: len(question.intruders)] = True
    mask[[one.number for one in answer.excluded]] = False
    times = np.arange(0.0, answer.waypoints[-1].time + CLOSE, CLOSE)
    begin, end = np.full((2, mask.size), np.inf)
    for k in np.flatnonzero(mask):
        level = times[_level(question, int(k), times, options)]
        begin[k], end[k] = (level[0], level[-1]) if level.size else (np.inf, -np.inf)
        begin[k] = begin[k] if begin[k] > 0.0 else -np.inf
    traffic = question.truth.traffic._replace(mask=mask, window=Window(begin, end))
    plan_states = waypoints.plan_states(question.own, answer.waypoints)
    return plan_states, np.array(number), question.truth._replace(traffic=traffic)
