"""A mission flown by us: the monitor of :mod:`agents.assurance.single`, asked every time step, and
the planner that answers it.

The route is that of the bridge: points along the mission's legs, at which it can be rejoined, and a
holding circle after the last waypoint, since a plan lasts longer than the mission.
"""

import math
import time
from typing import NamedTuple

import numpy as np
import shapely

from agents.assurance import single
from agents.assurance.monitor import references
from agents.assurance.single import Watch
from agents.assurance.state import State
from agents.assurance.thresholds import Thresholds
from agents.planner.answer import Plan, RequestError
from agents.planner.planner import plan
from agents.planner.recheck import reconstruct
from agents.planner.request.options import Options
from agents.planner.request.request import Intruder
from agents.policy.inference import Policy
from benchmarks.icarous.flights import Flight
from benchmarks.icarous.judge import Track
from benchmarks.icarous.missions import Mission, outline
from envs.aircraft import Aircraft
from envs.areas import Keep, Place
from envs.follower import PERIOD, KinematicVehicle, gains, steer
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

SPACING = 2.0
"""Between the points of a leg, separations at most."""

DEADLINE = 0.25
"""Of the planner, s: a seventh of this aircraft's time step."""

_ON_PLAN = State.MONITORING, State.REPLAN_REQUESTED, State.DENIED
_SUBSTEPS = round(1.0 / PERIOD)
_HOLD = 1.0  # radius of the holding circle, separations
_CORNERS, _ROUNDS = 6, 4


class Rules(NamedTuple):
    """How missions are flown."""

    aircraft: Aircraft
    policy: Policy
    options: Options
    thresholds: Thresholds


def rules(aircraft: Aircraft, policy: Policy) -> Rules:
    """Return the rules of an aircraft."""
    options = Options.for_aircraft(
        aircraft, spacing=5, goals=4, extend_route=True, deadline_s=DEADLINE
    )
    return Rules(
        aircraft,
        policy.for_aircraft(aircraft, outside="allow"),
        options,
        Thresholds.for_plans(options),
    )


def fly(mission: Mission, setting: Rules) -> Flight:
    """Fly a mission until it arrives or its time is over."""
    resolver = _Resolver(mission, setting)
    dt, own = setting.aircraft.dt, mission.start
    rows, slowest = [_row(0.0, own, promised=False)], 0.0
    goal = mission.waypoints[-1]
    for number in range(math.ceil(mission.limit / dt)):
        began = time.thread_time()
        resolver.decide(number * dt, own)
        slowest = max(slowest, time.thread_time() - began)
        more, own = resolver.follow(number * dt, own)
        rows += more
        if math.hypot(own.x - goal[0], own.y - goal[1]) < 0.5 * setting.aircraft.goal_radius:
            break
    table = np.array(rows)
    when, x, y, promised = table.T
    track = Track(when, x, y, *_intruders(mission, when))
    return Flight(track, slowest, promised.astype(bool))


class _Row(NamedTuple):
    """Where the ownship is at a time."""

    time: float  # s
    x: float  # m
    y: float
    promised: float  # 1: a plan called SAFE is flown; 0: none


class _Resolver:
    """Decides once a time step and follows what the monitor says."""

    def __init__(self, mission: Mission, setting: Rules) -> None:
        self._mission, self._setting = mission, setting
        self._watch: Watch = single.begin(setting.thresholds)
        radius = setting.aircraft.separation
        self._route = route(mission, SPACING * radius, _HOLD * radius)
        self._last = len(self._route) - 1 - _CORNERS * _ROUNDS  # the last waypoint
        self._next = 0
        self._promised = False

    def decide(self, moment: float, own: VehicleState[Ground]) -> None:
        """Judge what is flown, and plan where the monitor asks for it."""
        self._pass(own)
        others = self._others(moment)
        self._watch, assessment = single.step(
            self._watch, moment, own, others, areas=self._mission.fences
        )
        if moment == 0.0:
            planned = self._plan(own, tuple(others.values()))
            self._watch = single.activate(self._watch, planned, own, others, moment)
            self._take_up(planned, flown=planned.safe)
        elif assessment.ask is not None:
            planned = self._plan(assessment.ask.own, assessment.ask.intruders)
            self._watch, flown = single.answer(self._watch, assessment.ask.number, planned)
            self._take_up(planned, flown=flown)
        monitor = self._watch.monitor
        ends = float(monitor.started[0] + monitor.plan.end[0])
        on_plan = int(monitor.state[0]) in _ON_PLAN and not bool(monitor.on_backup[0])
        self._promised = on_plan and moment + self._setting.aircraft.dt <= ends

    def follow(
        self, moment: float, own: VehicleState[Ground]
    ) -> tuple[list[_Row], VehicleState[Ground]]:
        """Return rows of one time step of flight after a moment, s, and the state at its end."""
        aircraft, frame = self._setting.aircraft, self._watch.air
        period = PERIOD * aircraft.dt
        through = references(self._watch.monitor, moment, period, _SUBSTEPS)
        air = frame.to_air(own, moment)
        vehicle = KinematicVehicle(
            VehicleState(*(np.array([value]) for value in air)), aircraft.vehicle_limits
        )
        rows = []
        for step in range(_SUBSTEPS):
            before, after = (VehicleState(*(f[step + i] for f in through)) for i in (0, 1))
            command = steer(before, after, vehicle.state, period, gains(aircraft.dt))
            vehicle.step(*command, period)
            at = moment + (step + 1) * period
            own = frame.to_ground(VehicleState(*(float(f[0]) for f in vehicle.state)), at)
            rows.append(_row(at, own, promised=self._promised))
        return rows, own

    def _pass(self, own: VehicleState[Ground]) -> None:
        """Go on to the first point of the route that is not reached."""
        radius = self._setting.aircraft.goal_radius
        while self._next < self._last:
            point = self._route[self._next]
            if math.hypot(point.x - own.x, point.y - own.y) > radius:
                break
            self._next += 1

    def _take_up(self, planned: Plan, *, flown: bool) -> None:
        if flown and planned.goal_index is not None:
            self._next = max(self._next, min(planned.goal_index, self._last))

    def _plan(self, own: VehicleState[Ground], others: tuple[Intruder[Ground], ...]) -> Plan:
        mission, setting = self._mission, self._setting
        wind = mission.wind if mission.wind.speed > 0.0 else None
        try:
            return plan(
                own,
                others,
                self._route[self._next :],
                setting.policy,
                setting.options,
                wind=wind,
                areas=mission.fences,
            )
        except RequestError:
            return reconstruct(())

    def _others(self, moment: float) -> dict[str, Intruder[Ground]]:
        x, y = _intruders(self._mission, np.array([moment]))
        return {
            f"intruder {n}": Intruder(state._replace(x=float(x[0, n]), y=float(y[0, n])))
            for n, state in enumerate(self._mission.intruders)
        }


def route(mission: Mission, spacing: float, hold: float) -> list[RoutePoint]:
    """Return the points of a mission's legs, the last waypoint and a holding circle through it, on
    the side that has more room; m.
    """
    places = list[Place]()
    for (x, y), (to_x, to_y) in zip(mission.waypoints[:-1], mission.waypoints[1:], strict=True):
        parts = max(round(math.hypot(to_x - x, to_y - y) / spacing), 1)
        shares = [(part + 1) / parts for part in range(parts)]
        places += [(x + share * (to_x - x), y + share * (to_y - y)) for share in shares]
    circles = [_circle(mission, hold, side) for side in (-1.0, 1.0)]
    room = [min((_room(mission, place) for place in circle), default=0.0) for circle in circles]
    places += circles[int(np.argmax(room))] * _ROUNDS
    return [RoutePoint(n, float(x), float(y)) for n, (x, y) in enumerate(places)]


def _circle(mission: Mission, radius: float, side: float) -> list[Place]:
    """Return the corners of a circle through the last waypoint, that one last; left: 1."""
    (from_x, from_y), (x, y) = mission.waypoints[-2:]
    course = math.atan2(y - from_y, x - from_x)
    middle = x - side * radius * math.sin(course), y + side * radius * math.cos(course)
    angles = (
        course - side * math.pi / 2 + side * 2 * math.pi * np.arange(1, _CORNERS + 1) / _CORNERS
    )
    return [
        (middle[0] + radius * math.cos(angle), middle[1] + radius * math.sin(angle))
        for angle in angles.tolist()
    ]


def _room(mission: Mission, place: Place) -> float:
    """Return how far a place is from what it must be kept from, m; negative: beyond it."""
    point, room = shapely.Point(place), math.inf
    for fence in mission.fences:
        inner = outline(fence)
        inside = -inner.boundary.distance(point) if inner.contains(point) else inner.distance(point)
        room = min(room, inside if fence.keep is Keep.OUT else -inside)
    return room


def _intruders(mission: Mission, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y of the intruders at some times, ``[T, K]``."""
    x, y, course, speed = np.array(mission.intruders, dtype=float).reshape(-1, 4).T
    after = time[:, None]
    return x + speed * np.cos(course) * after, y + speed * np.sin(course) * after


def _row(time: float, own: VehicleState[Ground], *, promised: bool) -> _Row:
    return _Row(time, own.x, own.y, float(promised))
