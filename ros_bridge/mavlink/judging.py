"""What is watched and planned: the runner's and the monitor's core on what MAVLink brings.

Pure: a :class:`Judgement` follows from the one before, the situation and the time.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting
from agents.assurance.single import Verdict
from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Thresholds
from agents.kernel.areas import area_clearance, relevant
from agents.kernel.clearance import clearance
from agents.kernel.separation import separation
from agents.kernel.traffic import Requirement, growth
from agents.kernel.trajectory import straight
from agents.planner.answer import Advisory, AdvisoryCode, Field, Plan, RequestError
from agents.planner.request.options import Options
from agents.planner.request.request import check_request, in_wind
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.area_geometry import signed_distance
from envs.arrays import Array
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.trees import take
from envs.waypoints import RoutePoint, Waypoint, at, legs, plan_states, repeat
from envs.wind import NO_WIND, Wind
from ros_bridge.core.assurance import (
    Supervision,
    accept_answer,
    activate,
    backup,
    initial,
    step_monitor,
    to_fly,
)
from ros_bridge.core.categories import NO_CATEGORIES, Categories
from ros_bridge.core.conversions import Published, Route
from ros_bridge.core.fields import SECOND, Refusal
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.planning import plan_task
from ros_bridge.core.replies import plan_points, start_point, to_frame, true_wind, wind_of
from ros_bridge.core.reports import Unknown
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import PlanTask, Settings, in_terms_of_messages, refusal_of, task
from ros_bridge.mavlink.mission import SUB

SPACING = 1.0
"""Between the points of a mission's legs that a route may be rejoined at, separations."""

_SIGMAS = 2.0
_BEHIND = 2.0  # separations beyond the loss before which no leg is rejoined
_GOALS = 12  # of the mission's points, the nearest first, at which a plan may rejoin
_ROUNDED = 1.0  # m by which a plan may be farther from a point when it has rejoined there
_SHORT = 1e-6  # m, or m/s: of two places that are one


class Conflict(NamedTuple):
    """The first loss of the distance from an intruder or an area that a plan would have to keep,
    where the mission is flown on.
    """

    name: str  # of the intruder or the area
    time: float  # until then, s
    required: float  # distance, m


class Rules(NamedTuple):
    """How it is watched and planned; the same throughout a flight."""

    policy: Policy
    settings: Settings
    thresholds: Thresholds
    engage: float  # a loss that is nearer than this, s, is planned round
    look_ahead: float  # s

    def begin(self) -> Supervision:
        """Return a monitor without a plan."""
        return initial(self.thresholds, self.settings.unknown, self.settings.categories)


class Rejoin(NamedTuple):
    """Where a plan comes back to the route."""

    point: int | None  # index of the route's point; None: at its end, beyond the route
    time: int  # ns


@dataclass(frozen=True)
class Judgement:
    """What holds: the plan, its monitor and the conflict."""

    supervision: Supervision
    conflict: Conflict | None = None
    plan: Plan | None = None  # the last answer, safe or not
    rejoin: Rejoin | None = None  # where the plan comes back to the mission
    revision: int = 0
    problem: str = ""  # why nothing can be planned; "": it can
    remarks: tuple[str, ...] = ()  # what was assumed, and what else the answer remarks on
    verdict: Verdict | None = None

    @property
    def safe(self) -> bool:
        """Whether the last answer was a SAFE plan."""
        return self.plan is not None and self.plan.safe


def rules(
    aircraft: Aircraft,
    policy: Policy,
    *,
    margin: float,
    vertical: float,
    unknown: Unknown,
    deadline: float,
    categories: Categories = NO_CATEGORIES,
) -> Rules:
    """Return the rules of an aircraft; lengths in m, the margin for what the follower leaves of a
    plan, ``categories`` what is kept from some emitter categories.
    """
    fresh = Freshness.for_aircraft(aircraft)
    options = Options.for_aircraft(
        aircraft,
        requirement=Requirement(aircraft.separation, margin, _SIGMAS),
        extend_route=True,
        goals=_GOALS,
        rejoin_on_leg=True,
        deadline_s=deadline,
        vertical_filter=vertical,
        max_age=fresh.intruder,
    )
    limits = Thresholds.for_plans(
        options,
        cross_track=max(margin, 0.025 * aircraft.separation),
        along_track=max(margin, 0.05 * aircraft.separation),
        time_error=max(margin / aircraft.limits.speed_min, aircraft.dt),
        own_age=fresh.own,
        intruder_age=fresh.intruder,
    )
    settings = Settings(
        options,
        limits.turn_time,
        (limits.turn_rate_min, limits.turn_rate_max),
        freshness=fresh,
        unknown=unknown,
        categories=categories,
    )
    times = Alerting.for_aircraft(aircraft)
    return Rules(policy, settings, limits, times.reached.corrective, times.look_ahead)


def watch(
    judgement: Judgement,
    situation: Situation,
    route: Route,
    now: int,
    rules: Rules,
    *,
    ways: Sequence[Route] = (),
    unplanned: str = "",
) -> Judgement:
    """Look along the mission for a conflict, and plan round it where it is near.

    A conflict that is there is told, whether it can be planned round or not.

    Args:
        judgement: that holds.
        situation: what is known.
        route: that a plan may rejoin.
        now: ns.
        rules: how it is watched and planned.
        ways: that may be flown and are watched; empty: the route.
        unplanned: why nothing is to be planned; "": it is.
    """
    first = None
    try:
        request = task(situation, now, rules.settings, route)
        tasks = [replace(request, points=_points(request, way)) for way in ways] or [request]
        conflicts = (conflict(_ahead(one, 0.0), rules.look_ahead) for one in tasks)
        first = _earliest(conflicts)
        judgement = replace(judgement, remarks=_remarks(request))
        if first is None or first.time > rules.engage:
            return replace(judgement, conflict=first, plan=None, problem="")
        if unplanned:
            return replace(judgement, conflict=first, plan=None, problem=unplanned)
        reach = request.own.speed * first.time
        request = _ahead(request, reach + _BEHIND * first.required)
        return _take_up(replace(judgement, conflict=first), situation, request, rules)
    except Refusal as refusal:
        return replace(judgement, conflict=first, plan=None, problem=str(refusal))


def supervise(
    judgement: Judgement,
    situation: Situation,
    route: Route,
    now: int,
    rules: Rules,
) -> Judgement:
    """Check the plan that is flown, and plan anew where the monitor asks for it."""
    supervision, verdict = step_monitor(judgement.supervision, situation, now)
    judgement = replace(judgement, supervision=supervision, verdict=verdict)
    if verdict is None or verdict.ask is None:
        return judgement
    number = verdict.ask.number
    try:
        wanted = task(situation, now, rules.settings, route)
        wanted = _not_before(wanted, judgement.rejoin)
        answer = _answer(wanted, rules)
    except Refusal as refusal:
        after, _ = accept_answer(supervision, number, None)
        return replace(judgement, supervision=after, problem=str(refusal))
    judgement = replace(judgement, remarks=_remarks(wanted, answer))
    revision = judgement.revision + 1
    sent = publish(answer, wanted, revision) if answer.safe else None
    after, taken_up = accept_answer(supervision, number, sent)
    judgement = replace(judgement, supervision=after, revision=revision, problem="")
    if not taken_up:
        why = "; ".join(reason.message for reason in answer.reasons)
        return replace(judgement, problem=why or "the plan came too late")
    return replace(judgement, plan=answer, rejoin=_rejoin(answer, wanted))


def conflict(wanted: PlanTask, look_ahead: float) -> Conflict | None:
    """Return the first loss of what a plan would have to keep from an intruder or an area, within
    some seconds where the ownship flies its route at its speed over the ground; None: none.
    """
    course = _along_route(wanted, look_ahead)
    return _earliest((_first_intruder(wanted, course), _first_area(wanted, course)))


def _earliest(conflicts: Iterable[Conflict | None]) -> Conflict | None:
    """Return the first of some conflicts; None: none."""
    some = (one for one in conflicts if one is not None)
    return min(some, key=lambda one: one.time, default=None)


def _points(wanted: PlanTask, route: Route) -> tuple[RoutePoint, ...]:
    """Return a route's points in a task's frame."""
    at = wanted.frame.place([one.latitude for one in route], [one.longitude for one in route])
    places = zip(route, at.x.tolist(), at.y.tolist(), strict=True)
    return tuple(RoutePoint(one.index, x, y) for one, x, y in places)


class _Course(NamedTuple):
    """Where the ownship is to be on its route, over the ground; fields ``[1, W]``, in between it
    moves uniformly.
    """

    x: Array  # m
    y: Array
    time: Array  # s


def _along_route(wanted: PlanTask, look_ahead: float) -> _Course:
    """Return the course along the route at the present speed, straight on behind its end."""
    own, points = wanted.own, wanted.points
    x = np.array([own.x, *(point.x for point in points)])
    y = np.array([own.y, *(point.y for point in points)])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    flown = float(own.speed) * look_ahead
    length = max(way[-1] - way[-2], _SHORT)
    on = 1.0 + max(flown - way[-1], 0.0) / length
    end_x, end_y = (field[-2] + on * (field[-1] - field[-2]) for field in (x, y))
    x, y = np.append(x[:-1], end_x), np.append(y[:-1], end_y)
    way = np.append(way[:-1], way[-2] + on * length)
    # The corners that are reached, each once, and where the ownship is at the end.
    corners = np.flatnonzero(np.diff(way, prepend=-np.inf) > _SHORT)
    ways = np.append(way[corners][way[corners] < flown - _SHORT], flown)
    time = ways / max(float(own.speed), _SHORT)
    return _Course(
        *(field[None] for field in (np.interp(ways, way, x), np.interp(ways, way, y), time))
    )


def _first_intruder(wanted: PlanTask, course: _Course) -> Conflict | None:
    """Return the first loss of what a plan would have to keep from an intruder, in the air mass."""
    try:
        in_air = in_wind(wanted.options, wanted.wind)
        request, _, counted = check_request(
            wanted.own, wanted.intruders, wanted.points, in_air, wanted.own_altitude, wanted.wind
        )
    except RequestError as error:
        raise refusal_of(error, wanted) from error
    if not counted:
        return None
    (x, y, time), wind, keep = course, wanted.wind, wanted.options.requirement
    flown = straight(x - wind.east * time, y - wind.north * time, time)
    keeping = separation(request.traffic, request.own, keep)
    kept = clearance(flown, keeping)
    first = int(np.argmin(kept.loss[0]))
    loss = float(kept.loss[0, first])
    if not math.isfinite(loss):
        return None
    grown = growth(take(request.traffic, (0, slice(first, first + 1))), np.array(loss), keep.sigmas)
    need = keeping.required[0, first] + np.max(grown)
    return Conflict(wanted.identifiers[counted[first]], loss, float(need))


def _first_area(wanted: PlanTask, course: _Course) -> Conflict | None:
    """Return the first loss of what a plan would have to keep from an area; one that the ownship is
    in already is none, since no plan is SAFE there.
    """
    margin, (x, y, time) = wanted.options.requirement.margin, course
    areas = relevant(
        wanted.areas,
        wanted.own,
        wanted.own_altitude,
        fastest=float(wanted.own.speed),
        horizon=float(time[0, -1]),
        unknown_climb=wanted.options.unknown_climb,
        margin=margin,
    )
    outside = [
        area
        for area in areas
        if area.begin > 0.0 or signed_distance(area.area, wanted.own.x, wanted.own.y) >= 0.0
    ]
    if not outside:
        return None
    kept = clearance(straight(x, y, time), area_clearance(outside, x[:, 0], y[:, 0], margin))
    first = int(np.argmin(kept.loss[0]))
    loss = float(kept.loss[0, first])
    if not math.isfinite(loss):
        return None
    area = outside[first]
    name = area.area.name or f"areas[{area.number}]"
    return Conflict(name, loss, area.area.clearance + margin)


def publish(answer: Plan, wanted: PlanTask, revision: int) -> Published:
    """Return a plan as the monitor takes it."""
    left_out = {one.number for one in answer.excluded}
    names = (name for n, name in enumerate(wanted.identifiers) if n not in left_out)
    start = start_point(wanted.frame, wanted.own, wanted.time, wanted.own_altitude)
    wind = answer.wind or NO_WIND
    return Published(
        revision.to_bytes(16, "big"),
        revision,
        wanted.time,
        start,
        plan_points(answer, wanted),
        tuple(names),
        true_wind(wanted.frame, wind, start.latitude, start.longitude),
        float(wind.std),
    )


class ToFly(NamedTuple):
    """A plan or backup in a local frame."""

    key: tuple[str, int]  # changes with every other plan or backup
    frame: LocalFrame
    began: int  # ns
    own: VehicleState[Ground]
    waypoints: tuple[Waypoint, ...]
    wind: Wind | None  # that its legs are flown in


def to_follow(judgement: Judgement) -> ToFly | None:
    """Return what is to be flown now; None: nothing."""
    supervision = judgement.supervision
    frame, held, kind = supervision.frame, supervision.held, to_fly(supervision)
    if frame is None or held is None:
        return None
    wind = wind_of(frame, held)
    if kind is FlyMode.PLAN:
        key = ("plan", held.revision)
        return ToFly(key, frame, held.began, *to_frame(frame, held), wind)
    if kind is FlyMode.BACKUP and math.isfinite(supervision.watch.monitor.backup.started[0]):
        made = backup(supervision, None)
        as_plan = Published(bytes(16), 0, made.began, made.start, made.points, ())
        key = ("backup", made.began)
        return ToFly(key, frame, made.began, *to_frame(frame, as_plan), wind)
    return None


def _answer(wanted: PlanTask, rules: Rules) -> Plan:
    try:
        return plan_task(wanted, rules.policy, exhaustive=False)
    except RequestError as error:
        raise refusal_of(error, wanted) from error


def _take_up(
    judgement: Judgement, situation: Situation, wanted: PlanTask, rules: Rules
) -> Judgement:
    answer = _answer(wanted, rules)
    judgement = replace(judgement, remarks=_remarks(wanted, answer))
    if not answer.safe:
        return replace(judgement, plan=answer, problem="")
    revision = judgement.revision + 1
    supervision = activate(judgement.supervision, situation, publish(answer, wanted, revision))
    return replace(
        judgement,
        supervision=supervision,
        plan=answer,
        rejoin=_rejoin(answer, wanted),
        revision=revision,
        problem="",
    )


def _remarks(wanted: PlanTask, answer: Plan | None = None) -> tuple[str, ...]:
    """Return what is remarked of a task and its answer, a sentence each."""
    said = wanted.notes if answer is None else (*answer.advisories, *wanted.notes)
    return tuple(text for text in (_remark(one, wanted) for one in said) if text)


def _remark(advisory: Advisory, wanted: PlanTask) -> str:
    """Return an advisory as a sentence; none of a point that is skipped between two waypoints."""
    point = advisory.field
    if advisory.code is AdvisoryCode.SKIPPED and isinstance(point, Field):
        item, part = divmod(wanted.points[point.number or 0].index, SUB)
        return f"waypoint {item} skipped" if part == SUB - 1 else ""
    return f"{in_terms_of_messages(point, wanted.identifiers)} {advisory.text}"


def _rejoin(answer: Plan, wanted: PlanTask) -> Rejoin:
    """Return at which point of the route, and when, a plan is back on it: what the plan rejoins may
    be a point round an area.
    """
    wind = answer.wind or NO_WIND
    later = (one.time for one in answer.waypoints if one.time > answer.rejoin_time)
    times = np.array([answer.rejoin_time, *later])
    curve = legs(plan_states(wanted.own, answer.waypoints, wind=wind))
    state = at(repeat(curve, times.size), times, wind)
    x = np.array([point.x for point in wanted.points])
    y = np.array([point.y for point in wanted.points])
    away = np.hypot(state.x[:, None] - x, state.y[:, None] - y)
    back = away.min(axis=1) <= wanted.options.aircraft.goal_radius + _ROUNDED
    first = int(np.argmax(back)) if back.any() else times.size - 1
    index = wanted.points[int(np.argmin(away[first]))].index if back.any() else None
    return Rejoin(index, wanted.time + round(float(times[first]) * SECOND))


def _not_before(wanted: PlanTask, rejoin: Rejoin | None) -> PlanTask:
    """Return the task without the points of the first leg before the one that was to be rejoined;
    a waypoint of the mission always stays.
    """
    found = _ahead(wanted, _BEHIND * wanted.options.aircraft.separation)
    if rejoin is None or rejoin.point is None:
        return found
    first, leg = rejoin.point, rejoin.point // SUB
    points = tuple(one for one in found.points if one.index // SUB != leg or one.index >= first)
    return replace(found, points=points)


def _ahead(wanted: PlanTask, beyond: float) -> PlanTask:
    """Return the task without the points of the first leg that are not farther ahead than
    ``beyond``, m; a waypoint of the mission always stays.
    """
    points = wanted.points
    leg = points[0].index // SUB
    last = next((n for n, one in enumerate(points) if one.index // SUB != leg), len(points)) - 1
    end = points[last]
    x, y = end.x - wanted.own.x, end.y - wanted.own.y
    length = max(math.hypot(x, y), 1e-6)
    own = wanted.own
    ahead = tuple(
        one
        for n, one in enumerate(points)
        if n >= last or ((one.x - own.x) * x + (one.y - own.y) * y) / length > beyond
    )
    return replace(wanted, points=ahead)
