"""Requests of the attack as a user of ``agents.planner.plan`` writes them, and what its answer must
keep.

The reports of the intruders are some seconds old, turning ones turned then already, some straight
ones have just ended a turn, some have altitudes, and the indices of the route are drawn so that
careless new ones would meet them. Most fly in a wind and among areas
(:mod:`benchmarks.safety.sky`). What the planner is given is the report over the ground; what it is
judged by is where that leads in the air mass, by this package's own arithmetic.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.traffic import Traffic, Window
from agents.planner.answer import WAYPOINTS, Apart, Plan
from agents.planner.planner import plan
from agents.planner.request.reports import with_state
from agents.planner.request.request import Altitude, Intruder, Options, Request
from agents.policy.inference import Policy
from benchmarks.safety import heights
from benchmarks.safety.resimulation import CLOSE, displacement
from benchmarks.safety.sky import Sky, draw_sky
from envs.arrays import Array
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.trees import map_leaves, take
from envs.waypoints import PlanStates, RoutePoint, Waypoint

__all__ = ["STILL", "AsArrays", "Question", "as_arrays", "faults", "in_space", "question"]

STILL = Sky(None, ())
"""Still air without areas."""

_WINDOWS = WAYPOINTS + 2
"""Most times in which an intruder may count beside a plan that climbs: one for each of its lines,
and one to spare.
"""


class Question(NamedTuple):
    """One request."""

    own: VehicleState[Ground]
    intruders: list[Intruder[Ground]]
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


class AsArrays(NamedTuple):
    """A plan as it is judged, in the air mass."""

    plan_states: PlanStates[Air]
    """``[21]``."""
    last: Array
    """Number of its last point of the route, ``[]``."""
    request: Request
    """As it was planned for, without leading axis; intruders that were left out as above or below
    are masked. The route is where it lies in the air mass when the plan ends."""


def question(seed: int, number: int, request: Request, unit: float) -> Question:
    """Return a request ``[]`` of the attack, which is one in the air mass, as ``plan`` takes it;
    ``unit``: the separation, m.
    """
    rng = np.random.default_rng([seed, number])
    traffic = request.traffic
    members = np.flatnonzero(traffic.mask)
    order = np.concatenate([members, np.flatnonzero(~traffic.mask)])
    intruders = [_draw_report(rng, take(traffic, int(k))) for k in members]
    ages = np.array(traffic.age)
    ages[members] = [abs(intruder.age) for intruder in intruders]
    intruders, own_separations = _draw_separations(seed, number, intruders, len(order), unit)
    traffic = traffic._replace(age=ages, separation=own_separations[np.argsort(order)])
    route = _draw_route(rng, request)
    own_air: VehicleState[Air] = VehicleState(*(float(value) for value in request.own))
    altitude = Altitude(2_000.0, "msl", float(rng.normal(0.0, 3.0))) if rng.random() < 0.7 else None
    truth = request._replace(traffic=take(traffic, order))
    sky = draw_sky(seed, number, request, unit, altitude)
    reports = [
        with_state(
            intruder,
            _over_ground(intruder.state, sky.air_velocity, -intruder.age),
            intruder.velocity_std,
        )
        for intruder in intruders
    ]
    own = _over_ground(own_air, sky.air_velocity, 0.0)
    return Question(own, reports, route, altitude, _in_wind(truth, intruders, sky), sky)


def in_space(
    question: Question, options: Options, seed: int, number: int
) -> tuple[Question, Options]:
    """Return a request of the attack with altitudes near each other, and the options of its plan,
    which may climb and descend.
    """
    rng = np.random.default_rng([seed, number, 56])
    own = heights.draw_own(options, rng)
    options = heights.draw_options(options, own, rng)
    areas = heights.draw_levels(question.sky.areas, own, options, rng)
    changed = question._replace(
        intruders=heights.draw_reports(question.intruders, question.own, own, options, rng),
        route=heights.draw_route(question.route, own, options, rng),
        altitude=own,
        sky=question.sky._replace(areas=areas),
    )
    return changed, options


def _draw_report(rng: np.random.Generator, intruder: Traffic) -> Intruder[Air]:
    """Return a report of an intruder ``[]``, half of them some seconds old, a third with
    altitude.
    """
    age = float(rng.uniform(-0.5, 5.0)) if rng.random() < 0.5 else 0.0
    if intruder.turn_rate != 0.0 and intruder.turn_time > 0.0:
        # A turn that ends before a report from the future would not be in it.
        age = age if float(intruder.turn_time) + age > 0.0 else 0.0
    state, turn_rate, turn_time = _report_before(rng, intruder, age)
    altitude = None
    if rng.random() < 0.3:
        reference = "msl" if rng.random() < 0.8 else "wgs84"
        height, climb = float(rng.uniform(-1_000.0, 5_000.0)), float(rng.normal(0.0, 3.0))
        altitude = Altitude(height, reference, climb)
    return Intruder(
        state,
        age=age,
        turn_rate=turn_rate,
        turn_time=turn_time,
        position_std=float(intruder.position_std),
        velocity_std=float(intruder.velocity_std),
        altitude=altitude,
    )


def _draw_route(rng: np.random.Generator, request: Request) -> list[RoutePoint]:
    """Return the route with indices at random, half of those there could be."""
    count = int(request.points)
    indices = rng.permutation(2 * count)[:count].tolist()
    x, y = request.route_x[:count].tolist(), request.route_y[:count].tolist()
    return [RoutePoint(*point) for point in zip(indices, x, y, strict=True)]


def _over_ground(state: VehicleState[Air], wind: complex, time: float) -> VehicleState[Ground]:
    """Return a state, some seconds after the request, as the ground sees it; not by
    :mod:`envs.wind`, whose errors are to be found here.
    """
    if wind == 0.0:
        return VehicleState(*state)
    velocity = state.speed * np.exp(1j * state.heading) + wind
    place = state.x + 1j * state.y + wind * time
    return VehicleState(
        float(place.real), float(place.imag), float(np.angle(velocity)), float(abs(velocity))
    )


def _in_wind(truth: Request, intruders: list[Intruder[Air]], sky: Sky) -> Request:
    """Return a request in a wind that is not known exactly, in which turns through the air make
    velocities over the ground less certain.
    """
    if sky.wind is None:
        return truth
    drift = np.array(truth.traffic.velocity_std)
    for place, intruder in enumerate(intruders):
        drift[place] += sky.wind.std * min(abs(intruder.turn_rate) * intruder.turn_time, 2.0)
    return truth._replace(traffic=truth.traffic._replace(velocity_std=drift))


def _draw_separations(
    seed: int, number: int, intruders: list[Intruder[Air]], places: int, unit: float
) -> tuple[list[Intruder[Air]], Array]:
    """Return the intruders, a third of them with separations of their own, and those of so many
    places, m, ``[K]``; nan: the requirement's.
    """
    rng = np.random.default_rng([seed, number, 53])
    changed, own = [], np.full(places, np.nan)
    for place, intruder in enumerate(intruders):
        share, vertical = rng.choice([0.3, 0.7, 1.5, 2.5]), float(rng.choice([150.0, 900.0]))
        changes: dict[str, Any] = {}
        if rng.random() < 1.0 / 3.0:
            own[place] = share * unit
            changes["separation"] = float(own[place])
        if rng.random() < 1.0 / 3.0:
            changes["vertical_separation"] = vertical
        if intruder.altitude is not None and rng.random() < 0.5:
            error = float(rng.uniform(0.0, 200.0))
            changes["altitude"] = replace(intruder.altitude, error=error, climb_error=0.3)
        changed.append(replace(intruder, **changes))
    return changed, own


def _report_before(
    rng: np.random.Generator, intruder: Traffic, age: float
) -> tuple[VehicleState[Air], float, float]:
    """Return the state, turn rate and duration of a turn in a report of some age that leads to an
    intruder ``[]``.
    """
    x, y, heading, speed = (float(value) for value in intruder.state)
    rate, lasts = float(intruder.turn_rate), float(intruder.turn_time) + age
    if rate == 0.0 or lasts <= max(age, 0.0):
        ended = age > 0.0 and rng.random() < 0.5
        rate, lasts = 0.0, 0.0
        if ended:
            rate, lasts = float(rng.uniform(-0.08, 0.08)), float(rng.uniform(0.0, age))
    before = heading - rate * min(age, lasts)
    place = x + 1j * y - complex(displacement(before, speed, rate, lasts, age))
    course = math.remainder(before, 2.0 * math.pi)
    return VehicleState(place.real, place.imag, course, speed), rate, lasts


def faults(question: Question, answer: Plan, options: Options) -> list[str]:
    """Return what an answer breaks of what is promised beside limits and separation."""
    wrong: list[str] = []
    if answer.safe == bool(answer.reasons):
        wrong.append("reasons")
    if not answer.safe:
        return wrong
    if len(answer.waypoints) != WAYPOINTS:
        return [*wrong, "count"]
    wrong += _index_faults(question, answer, options)
    if any((point.altitude is None) is options.climbs for point in answer.waypoints):
        return [*wrong, "altitudes"]
    times = np.arange(0.0, answer.waypoints[-1].time, CLOSE)
    above_or_below = [
        exclusion.number for exclusion in answer.excluded if exclusion.apart is Apart.VERTICALLY
    ]
    if any(
        _may_be_level(question, answer.waypoints, number, times, options).any()
        for number in above_or_below
    ):
        wrong.append("vertical")
    return wrong


def _index_faults(question: Question, answer: Plan, options: Options) -> list[str]:
    """Return what is wrong with the indices of a plan's waypoints."""
    route_indices = {point.index for point in question.route}
    indices = [point.index for point in answer.waypoints]
    ends_on_route = indices[-1] in route_indices
    fresh = indices[:-1] if ends_on_route or not options.extend_route else indices
    wrong: list[str] = []
    if (
        len(set(indices)) != WAYPOINTS
        or route_indices & set(fresh)
        or answer.goal_index not in route_indices
    ):
        wrong.append("indices")
    if not ends_on_route and not options.extend_route:
        wrong.append("last index")
    return wrong


def _may_be_level(
    question: Question,
    waypoints: Sequence[Waypoint],
    number: int,
    times: Array,
    options: Options,
) -> Array:
    """Return at which times, s, an intruder may be nearer above or below than its vertical
    separation, bool.
    """
    own, report = question.altitude, question.intruders[number]
    other = report.altitude
    low_high = heights.own_band(own, waypoints, times, options)
    if own is None or low_high is None or other is None or own.reference != other.reference:
        return np.ones(len(times), dtype=bool)
    low, high = low_high
    low_other, high_other = heights.band(other, times + report.age, options)
    away = np.maximum(low_other - high, low - high_other)
    own_least = report.vertical_separation
    return away <= (options.vertical_separation if own_least is None else own_least)


def as_arrays(question: Question, answer: Plan, options: Options) -> AsArrays:
    """Return a plan with its 20 waypoints as it is judged."""
    indices = [point.index for point in question.route]
    last = answer.waypoints[-1].index
    number = indices.index(last) if last in indices else len(indices)
    moved = question.sky.air_velocity * answer.waypoints[-1].time
    truth = question.truth._replace(
        traffic=_counted(question, answer, options),
        route_x=question.truth.route_x - moved.real,
        route_y=question.truth.route_y - moved.imag,
    )
    return AsArrays(_plan_states(question, answer), np.array(number), truth)


def _counted(question: Question, answer: Plan, options: Options) -> Traffic:
    """Return the intruders ``[K]`` with when each counts, without those left out as above or below;
    of a plan that climbs each stands there as often as it may count, ``[K W]``.
    """
    traffic = question.truth.traffic
    windows = _WINDOWS if options.climbs else 1
    places = np.size(traffic.mask)
    left_out = {
        exclusion.number for exclusion in answer.excluded if exclusion.apart is Apart.VERTICALLY
    }
    times = np.arange(0.0, answer.waypoints[-1].time + CLOSE, CLOSE)
    begin, end = np.full((places, windows), np.inf), np.full((places, windows), -np.inf)
    for k in range(len(question.intruders)):
        if k in left_out and not options.climbs:
            continue
        level = _may_be_level(question, answer.waypoints, k, times, options)
        edges = np.diff(np.concatenate([[False], level, [False]]).astype(np.int8))
        first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        if not options.climbs:  # beside a steady climb it counts in one time
            first, last = first[:1], last[-1:]
        # What counts at the request has counted before.
        begin[k, : first.size] = np.where(first == 0, -np.inf, times[first])
        end[k, : last.size] = times[last]
    repeated: Traffic = map_leaves(lambda field: np.repeat(field, windows, axis=-1), traffic)
    window = Window(begin.ravel(), end.ravel())
    return repeated._replace(mask=window.begin <= window.end, window=window)


def _plan_states(question: Question, answer: Plan) -> PlanStates[Air]:
    """Return a published plan ``[W + 1]`` as the air mass sees it."""
    rows = [(*question.own, 0.0)]
    rows += [
        (waypoint.x, waypoint.y, waypoint.heading, waypoint.speed, waypoint.time)
        for waypoint in answer.waypoints
    ]
    x, y, heading, speed, time = np.array(rows, dtype=float).T
    wind = question.sky.air_velocity
    if wind == 0.0:
        return PlanStates(x, y, heading, speed, time)
    place = x + 1j * y - wind * time
    velocity = speed * np.exp(1j * heading) - wind
    return PlanStates(place.real, place.imag, np.angle(velocity), np.abs(velocity), time)
