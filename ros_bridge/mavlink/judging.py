"""What is watched and planned: the runner's and the monitor's core on what MAVLink brings.

Pure: a :class:`Judgement` follows from the one before, the situation and the time.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting
from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Requirement
from agents.planner.answer import Advisory, AdvisoryCode, Field, Plan, RequestError
from agents.planner.request.options import Maneuvers, Options, check
from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.areas import Level
from envs.formats.local_frame import LocalFrame
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import Profile, profile_of
from envs.waypoints import RoutePoint, Waypoint, at, legs, plan_states, repeat
from envs.wind import NO_WIND, Wind
from ros_bridge.core.assurance import (
    Supervision,
    accept_answer,
    activate,
    backup,
    backup_began,
    backup_climb,
    fly_mode,
    initial,
    step_monitor,
)
from ros_bridge.core.categories import NO_CATEGORIES, Categories
from ros_bridge.core.conversions import Published, Route
from ros_bridge.core.fields import SECOND, Refusal
from ros_bridge.core.freshness import Freshness
from ros_bridge.core.motion import Turns
from ros_bridge.core.planning import plan_task
from ros_bridge.core.replies import published, to_frame, wind_of
from ros_bridge.core.reports import Unknown
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import PlanTask, Settings, in_terms_of_messages, refusal_of, task
from ros_bridge.mavlink.conflict import Conflict, conflict, earliest
from ros_bridge.mavlink.course import Course
from ros_bridge.mavlink.mission import SUB

SPACING = 1.0
"""Between the points of a mission's legs that a route may be rejoined at, separations."""

_SIGMAS = 2.0
_BEHIND = 2.0  # separations beyond the loss before which no leg is rejoined
_GOALS = 12  # of the mission's points, the nearest first, at which a plan may rejoin
_ALTITUDE_WEIGHT = 0.5  # a metre up or down leaves the mission's ground track less than one aside
_SAME_ALTITUDE = 1e-3  # m between altitudes that are the same
_UNKNOWN_ALTITUDE = (
    "has no known altitude at the next item (above terrain, or no waypoint): plans keep the height"
)
_ROUNDED = 1.0  # m by which a plan may be farther from a point when it has rejoined there


class Climbs(NamedTuple):
    """What plans may do up and down."""

    maneuvers: Maneuvers = Maneuvers.HORIZONTAL
    floor: Level | None = None
    ceiling: Level | None = None
    margin: float = 0.0  # for what the follower leaves of a plan's altitude, m

    def options(self) -> dict[str, Any]:
        """Return them as options of the planner; none where plans keep the height."""
        if self.maneuvers is Maneuvers.HORIZONTAL:
            return {}
        return {
            "maneuvers": self.maneuvers,
            "floor": self.floor,
            "ceiling": self.ceiling,
            "vertical_margin": self.margin,
            "altitude_weight": _ALTITUDE_WEIGHT,
        }


IN_THE_PLANE = Climbs()
"""Plans keep the height."""


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
    # the same where it is back on the ground track, which it may be before it has the altitude
    on_track: int | None


@dataclass(frozen=True)
class Judgement:
    """What holds: the conflict, the plan round it, and the monitor of that plan."""

    supervision: Supervision
    conflict: Conflict | None = None
    plan: Plan | None = None  # the last answer, safe or not
    rejoin: Rejoin | None = None  # where the plan comes back to the mission
    problem: str = ""  # why nothing can be planned; "": it can
    remarks: tuple[str, ...] = ()  # what was assumed, and what else the answer remarks on

    @property
    def safe(self) -> bool:
        """Whether the last answer was a SAFE plan."""
        return self.plan is not None and self.plan.safe


@dataclass(frozen=True)
class Question:
    """Check the plan that is flown, or look along the mission and plan round a conflict there, and
    answer with :class:`ros_bridge.mavlink.events.Answer`.
    """

    judgement: Judgement  # that holds
    situation: Situation
    course: Course
    time: int  # ns, on the autopilot's clock
    flown: bool  # whether a plan is flown


def rules(
    aircraft: Aircraft,
    policy: Policy,
    *,
    margin: float,
    vertical: float,
    unknown: Unknown,
    deadline: float,
    categories: Categories = NO_CATEGORIES,
    climbs: Climbs = IN_THE_PLANE,
) -> Rules:
    """Return the rules of an aircraft; lengths in m, the margin for what the follower leaves of a
    plan, ``categories`` what is kept from some emitter categories.

    Raises:
        RequestError: ``climbs`` contradict each other, or what the aircraft can do.
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
        **climbs.options(),
    )
    check(options)
    limits = Thresholds.for_plans(
        options,
        own_age=fresh.own,
        intruder_age=fresh.intruder,
    )
    settings = Settings(
        options,
        Turns.of(limits),
        freshness=fresh,
        unknown=unknown,
        categories=categories,
    )
    times = Alerting.for_aircraft(aircraft)
    return Rules(policy, settings, limits, times.reached.corrective, times.look_ahead)


def answer(question: Question, rules: Rules) -> Judgement:
    """Return the judgement that follows; it computes for as long as the rules let a plan take."""
    return _supervise(question, rules) if question.flown else _watch(question, rules)


def _watch(question: Question, rules: Rules) -> Judgement:
    """Look along the mission for a conflict, and plan round it where it is near.

    A conflict that is there is told, whether it can be planned round or not.
    """
    judgement, situation, ahead = question.judgement, question.situation, question.course
    first = None
    try:
        request = task(situation, question.time, rules.settings, ahead.route)
        tasks = (replace(request, points=_points(request, way)) for way in ahead.ways)
        conflicts = (conflict(_ahead(on_way, 0.0), rules.look_ahead) for on_way in tasks)
        first = earliest(conflicts)
        judgement = replace(judgement, remarks=_remarks(request))
        if first is None or first.time > rules.engage:
            return replace(judgement, conflict=first, plan=None, problem="")
        if ahead.unplanned:
            return replace(judgement, conflict=first, plan=None, problem=ahead.unplanned)
        reach = request.own.speed * first.time
        request = _with_rejoin_altitude(_ahead(request, reach + _BEHIND * first.required))
        return _take_up(replace(judgement, conflict=first), situation, request, rules)
    except Refusal as refusal:
        return replace(judgement, conflict=first, plan=None, problem=str(refusal))


def _supervise(question: Question, rules: Rules) -> Judgement:
    """Check the plan that is flown, and plan anew where the monitor asks for it."""
    judgement, situation, time = question.judgement, question.situation, question.time
    supervision = step_monitor(judgement.supervision, situation, time)
    judgement, assessment = replace(judgement, supervision=supervision), supervision.assessment
    if assessment is None or assessment.ask is None:
        return judgement
    number = assessment.ask.number
    try:
        request = task(situation, time, rules.settings, question.course.route)
        request = _with_rejoin_altitude(_not_before(request, judgement.rejoin))
        answer = _plan(request, rules)
    except Refusal as refusal:
        answered, _ = accept_answer(supervision, number, None)
        return replace(judgement, supervision=answered, problem=str(refusal))
    judgement = replace(judgement, remarks=_remarks(request, answer))
    plan = _number(answer, request, supervision) if answer.safe else None
    answered, taken_up = accept_answer(supervision, number, plan)
    judgement = replace(judgement, supervision=answered, problem="")
    if not taken_up:
        reasons = "; ".join(reason.message for reason in answer.reasons)
        return replace(judgement, problem=reasons or "the plan came too late")
    return replace(judgement, plan=answer, rejoin=_rejoin(answer, request))


def _points(request: PlanTask, route: Route) -> tuple[RoutePoint, ...]:
    """Return a route's points in a task's frame."""
    local = request.frame.place(
        [station.latitude for station in route], [station.longitude for station in route]
    )
    places = zip(route, local.x.tolist(), local.y.tolist(), strict=True)
    return tuple(
        RoutePoint(station.index, x, y, station.altitude and station.altitude.value)
        for station, x, y in places
    )


def _with_rejoin_altitude(request: PlanTask) -> PlanTask:
    """Return a task whose plan comes back to the altitude of the last point that it may rejoin at:
    the planner regains that of the last point that has one. Where the next point has none it plans
    in the plane.
    """
    if not request.options.climbs:
        return request
    points = request.points
    if points[0].altitude is None:
        options = replace(request.options, maneuvers=Maneuvers.HORIZONTAL, floor=None, ceiling=None)
        notes = *request.notes, Advisory(AdvisoryCode.ASSUMED, "mission", _UNKNOWN_ALTITUDE)
        return replace(request, options=options, notes=notes)
    behind = (replace(point, altitude=None) for point in points[_GOALS:])
    return replace(request, points=(*points[:_GOALS], *behind))


class LocalPlan(NamedTuple):
    """A plan or backup in a local frame."""

    key: tuple[str, int]  # changes with every other plan or backup
    frame: LocalFrame
    began: int  # ns
    own: VehicleState[Ground]
    waypoints: tuple[Waypoint, ...]
    wind: Wind | None  # that its legs are flown in
    # altitude, m above mean sea level, times from ``began``; None: that of the beginning is kept
    profile: Profile | None = None


def local_plan(judgement: Judgement) -> LocalPlan | None:
    """Return what is to be flown now; None: nothing."""
    supervision = judgement.supervision
    frame, plan, kind = supervision.frame, supervision.published_plan, fly_mode(supervision)
    if frame is None or plan is None:
        return None
    wind = wind_of(frame, plan)
    if kind is FlyMode.PLAN:
        key = ("plan", plan.revision)
        own, waypoints = to_frame(frame, plan)
        profile = _profile(plan, waypoints, supervision.thresholds.options)
        return LocalPlan(key, frame, plan.began, own, waypoints, wind, profile)
    began = backup_began(supervision) if kind is FlyMode.BACKUP else None
    if began is None:
        return None
    backup_plan, climb = backup(supervision, None), backup_climb(supervision)
    assert backup_plan is not None  # it has begun
    own, waypoints = to_frame(frame, backup_plan)
    profile = None if climb is None else climb.profile
    return LocalPlan(("backup", began), frame, began, own, waypoints, wind, profile)


def _profile(plan: Published, waypoints: tuple[Waypoint, ...], options: Options) -> Profile | None:
    """Return the altitude of a plan, times from its request; None: it is one in the plane."""
    start = plan.start.altitude
    if not plan.climbs or start is None:
        return None
    return profile_of(start.value, start.climb(0.0)[0], waypoints, options.vertical.acceleration)


def _plan(request: PlanTask, rules: Rules) -> Plan:
    try:
        return plan_task(request, rules.policy, exhaustive=False)
    except RequestError as error:
        raise refusal_of(error, request) from error


def _number(answer: Plan, request: PlanTask, supervision: Supervision) -> Published:
    """Return a plan as the next that a monitor takes."""
    revision = supervision.revision + 1
    return published(answer, request, revision, revision.to_bytes(16, "big"))


def _take_up(
    judgement: Judgement, situation: Situation, request: PlanTask, rules: Rules
) -> Judgement:
    answer = _plan(request, rules)
    judgement = replace(judgement, remarks=_remarks(request, answer))
    if not answer.safe:
        return replace(judgement, plan=answer, problem="")
    plan = _number(answer, request, judgement.supervision)
    supervision = activate(judgement.supervision, situation, plan)
    return replace(
        judgement,
        supervision=supervision,
        plan=answer,
        rejoin=_rejoin(answer, request),
        problem="",
    )


def _remarks(request: PlanTask, answer: Plan | None = None) -> tuple[str, ...]:
    """Return what is remarked of a task and its answer, a sentence each."""
    advisories = request.notes if answer is None else (*answer.advisories, *request.notes)
    return tuple(text for text in (_remark(advisory, request) for advisory in advisories) if text)


def _remark(advisory: Advisory, request: PlanTask) -> str:
    """Return an advisory as a sentence; none of a point that is skipped between two waypoints."""
    point = advisory.field
    if advisory.code is AdvisoryCode.SKIPPED and isinstance(point, Field):
        item, part = divmod(request.points[point.number or 0].index, SUB)
        return f"waypoint {item} skipped" if part == SUB - 1 else ""
    return f"{in_terms_of_messages(point, request.identifiers)} {advisory.text}"


def _rejoin(answer: Plan, request: PlanTask) -> Rejoin:
    """Return at which point of the route, and when, a plan is back on it and at its altitude."""
    on_track, time = _back_on_track(answer, request, answer.rejoin_time)
    point, regained = on_track, _regained(answer.waypoints)
    if regained > time:
        point, time = _back_on_track(answer, request, regained)
    return Rejoin(point, request.time + round(time * SECOND), on_track)


def _back_on_track(answer: Plan, request: PlanTask, earliest: float) -> tuple[int | None, float]:
    """Return at which point of the route, and when, s after its request, a plan is on its ground
    track from a time on: what the plan rejoins may be a point round an area.
    """
    wind = answer.wind or NO_WIND
    later = (waypoint.time for waypoint in answer.waypoints if waypoint.time > earliest)
    times = np.array([earliest, *later])
    curve = legs(plan_states(request.own, answer.waypoints, wind=wind))
    state = at(repeat(curve, times.size), times, wind)
    x = np.array([point.x for point in request.points])
    y = np.array([point.y for point in request.points])
    distances = np.hypot(state.x[:, None] - x, state.y[:, None] - y)
    back = distances.min(axis=1) <= request.options.aircraft.goal_radius + _ROUNDED
    first = int(np.argmax(back)) if back.any() else times.size - 1
    index = request.points[int(np.argmin(distances[first]))].index if back.any() else None
    return index, float(times[first])


def _regained(waypoints: Sequence[Waypoint]) -> float:
    """Return when a plan has its last altitude and keeps it, s after its request; one in the plane
    has it always.
    """
    regained, end = 0.0, waypoints[-1].altitude
    for before, point in itertools.pairwise(waypoints):
        if end is not None and abs((before.altitude or 0.0) - end) > _SAME_ALTITUDE:
            regained = point.time
    return regained


def _not_before(request: PlanTask, rejoin: Rejoin | None) -> PlanTask:
    """Return the task without the points of the first leg before the one that was to be rejoined;
    a waypoint of the mission always stays.
    """
    ahead = _ahead(request, _BEHIND * request.options.aircraft.separation)
    if rejoin is None or rejoin.on_track is None:
        return ahead
    first, leg = rejoin.on_track, rejoin.on_track // SUB
    points = tuple(
        point for point in ahead.points if point.index // SUB != leg or point.index >= first
    )
    return replace(ahead, points=points)


def _ahead(request: PlanTask, reach: float) -> PlanTask:
    """Return the task without the points of the first leg that are not farther ahead than
    ``reach``, m; a waypoint of the mission always stays.
    """
    points = request.points
    leg = points[0].index // SUB
    last = next((n for n, point in enumerate(points) if point.index // SUB != leg), len(points)) - 1
    end = points[last]
    x, y = end.x - request.own.x, end.y - request.own.y
    length = max(math.hypot(x, y), 1e-6)
    own = request.own
    ahead = tuple(
        point
        for n, point in enumerate(points)
        if n >= last or ((point.x - own.x) * x + (point.y - own.y) * y) / length > reach
    )
    return replace(request, points=ahead)
