"""Requests of the attack as a user of ``agents.planner.plan`` writes them, and what its answer must
keep.

The reports of the intruders are some seconds old, turning ones turned then already, some straight
ones have just ended a turn, some have altitudes, and the indices of the route are drawn so that
careless new ones would meet them. Most fly in a wind and among areas
(:mod:`benchmarks.safety.sky`). What the planner is given is the report over the ground; what it is
judged by is where that leads in the air mass, by this package's own arithmetic.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.planner.answer import WAYPOINTS, Apart, Plan
from agents.planner.planner import plan
from agents.planner.request import Altitude, Intruder, Options, Request
from agents.planner.traffic import Traffic, Window
from agents.policy.inference import Policy
from benchmarks.safety.resimulation import CLOSE, displacement
from benchmarks.safety.sky import Sky, draw_sky
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import PlanStates, RoutePoint

__all__ = ["STILL", "Question", "as_arrays", "faults", "question"]

STILL = Sky(None, ())
"""Still air without areas."""


class Question(NamedTuple):
    """One request."""

    own: VehicleState
    intruders: list[Intruder]
    route: list[RoutePoint]
    altitude: Altitude | None
    truth: Request
    """The same as arrays without leading axis, intruders ``[K]``: those reported, at the request,
    in the air mass."""
    sky: Sky = STILL

    def ask(self, policy: Policy, options: Options) -> Plan:
        """Return the planner's answer."""
        return plan(
            self.own,
            self.intruders,
            self.route,
            policy,
            options,
            own_altitude=self.altitude,
            wind=self.sky.wind,
            areas=self.sky.areas,
        )


def question(seed: int, number: int, request: Request, unit: float) -> Question:
    """Return a request ``[]`` of the attack, which is one in the air mass, as ``plan`` takes it;
    ``unit``: the separation, m.
    """
    rng = np.random.default_rng([seed, number])
    traffic = request.traffic
    ages = np.array(traffic.age)
    intruders: list[Intruder] = []
    members = np.flatnonzero(traffic.mask)
    order = np.concatenate([members, np.flatnonzero(~traffic.mask)])
    for k in members:
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
    sky = draw_sky(seed, number, request, unit, altitude)
    intruders = [
        replace(one, state=_over_ground(one.state, sky.blows, -one.age)) for one in intruders
    ]
    route = [RoutePoint(*point) for point in points]
    own = _over_ground(own, sky.blows, 0.0)
    return Question(own, intruders, route, altitude, _in_wind(truth, intruders, sky), sky)


def _over_ground(state: VehicleState, blows: complex, time: float) -> VehicleState:
    """Return a state in the air mass, some seconds after the request, as the ground sees it."""
    if blows == 0.0:
        return state
    velocity = state.speed * np.exp(1j * state.heading) + blows
    place = state.x + 1j * state.y + blows * time
    return VehicleState(
        float(place.real), float(place.imag), float(np.angle(velocity)), float(abs(velocity))
    )


def _in_wind(truth: Request, intruders: list[Intruder], sky: Sky) -> Request:
    """Return a request in a wind that is not known exactly: what turns through the air gets over
    the ground where the wind takes it.
    """
    if sky.wind is None:
        return truth
    drift = np.array(truth.traffic.velocity_std)
    for place, one in enumerate(intruders):
        drift[place] += sky.wind.std * min(abs(one.turn_rate) * one.turn_time, 2.0)
    return truth._replace(traffic=truth.traffic._replace(velocity_std=drift))


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
    above_or_below = [one.number for one in answer.excluded if one.apart is Apart.VERTICALLY]
    if any(_level(question, number, times, options).any() for number in above_or_below):
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

    Both are in the air mass, the route as it lies there when the plan ends. The request has no
    leading axis; intruders that were left out as above or below are masked.
    """
    indices = [point.index for point in question.route]
    last = answer.waypoints[-1].index
    number = indices.index(last) if last in indices else len(indices)
    mask = np.zeros(np.shape(question.truth.traffic.mask), dtype=bool)
    mask[: len(question.intruders)] = True
    mask[[one.number for one in answer.excluded if one.apart is Apart.VERTICALLY]] = False
    times = np.arange(0.0, answer.waypoints[-1].time + CLOSE, CLOSE)
    begin, end = np.full((2, mask.size), np.inf)
    for k in np.flatnonzero(mask):
        level = times[_level(question, int(k), times, options)]
        begin[k], end[k] = (level[0], level[-1]) if level.size else (np.inf, -np.inf)
        begin[k] = begin[k] if begin[k] > 0.0 else -np.inf
    traffic = question.truth.traffic._replace(mask=mask, window=Window(begin, end))
    moved = question.sky.blows * answer.waypoints[-1].time
    truth = question.truth._replace(
        traffic=traffic,
        route_x=question.truth.route_x - moved.real,
        route_y=question.truth.route_y - moved.imag,
    )
    return _plan_states(question, answer), np.array(number), truth


def _plan_states(question: Question, answer: Plan) -> PlanStates:
    """Return a published plan ``[W + 1]`` as the air mass sees it."""
    rows = [(*question.own, 0.0)]
    rows += [(one.x, one.y, one.heading, one.speed, one.time) for one in answer.waypoints]
    x, y, heading, speed, time = np.array(rows, dtype=float).T
    blows = question.sky.blows
    if blows == 0.0:
        return PlanStates(x, y, heading, speed, time)
    place = x + 1j * y - blows * time
    velocity = speed * np.exp(1j * heading) - blows
    return PlanStates(place.real, place.imag, np.angle(velocity), np.abs(velocity), time)
