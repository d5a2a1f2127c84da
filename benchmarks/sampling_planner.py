"""A sampling planner of OMPL on the requests of :mod:`benchmarks.areas`.

It is the peer that says what could be solved there at all: RRT over place, heading, speed and time,
with controls that every vehicle within the limits can fly (a course relative to that to the next
point of the route, turned to as fast as allowed, and a speed). It has to bring the ownship into the
goal's disc of any point of the route, as early as a plan must rejoin, and nothing is asked of the
flight after that; a plan of ours has to stay clear until its end. Needs OMPL, of the extra
``peers``.
"""

import importlib
import importlib.util
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely

from agents.kernel.traffic import Requirement
from agents.planner import Options
from benchmarks.safety import sky
from benchmarks.safety.resimulation import CLOSE, Flown
from commands.command import InputError
from envs.areas import Area, Circle
from envs.frames import Ground
from envs.kinematics import Limits, VehicleState
from envs.waypoints import RoutePoint

INSTALL = "pip install -c constraints/peers.txt ompl"
"""How to get OMPL."""

_LEGS = 5, 60  # time steps of a leg, at least and at most
_WIDE = 15.0  # separations beyond route and ownship in which places are drawn
_EXACT = 1e-6  # of speeds, accelerations and turn rates
_TOLERANCE = 1e-3  # m of a required distance


class Task(NamedTuple):
    """What is to be solved; intruders fly straight on."""

    own: VehicleState[Ground]
    intruders: Sequence[VehicleState[Ground]]
    route: Sequence[RoutePoint]
    areas: Sequence[Area]
    options: Options


class Step(NamedTuple):
    """The ownship after a time step of a flight."""

    heading: float  # rad
    speed: float  # m/s
    time: float  # s after the request


def require() -> None:
    """Raise an InputError where OMPL is not installed."""
    if importlib.util.find_spec("ompl") is None:
        raise InputError(f"--ompl: OMPL is not installed; to have it: {INSTALL}")


def solve(task: Task, seconds: float, seed: int) -> list[Step] | None:
    """Return a flight that OMPL finds within some seconds of computation, or None."""
    base, control, util = (
        importlib.import_module(f"ompl.{n}") for n in ("base", "control", "util")
    )
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)
    space = _states(base, task)
    controls = control.RealVectorControlSpace(space, 2)
    controls.setBounds(_bounds(base, [(-1.0, 1.0), (-1.0, 1.0)]))
    information = control.SpaceInformation(space, controls)
    information.setStatePropagator(_Propagator(task).propagate)
    information.setStateValidityChecker(_checker(task))
    information.setPropagationStepSize(task.options.aircraft.dt)
    information.setMinMaxControlDuration(*_LEGS)
    setup = control.SimpleSetup(information)
    start = space.allocState()
    _write(start, *task.own, 0.0)
    setup.setStartState(start)
    setup.setGoal(_goal(base, information, task))
    planner = control.RRT(information)
    planner.setIntermediateStates(True)  # so that a leg may end where it meets the goal
    setup.setPlanner(planner)
    end = time.thread_time() + seconds
    setup.solve(base.PlannerTerminationCondition(lambda: time.thread_time() > end))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    path.interpolate()
    return [Step(*(float(state[1][n]) for n in range(3))) for state in path.getStates()]


def _bounds(base: Any, ranges: Sequence[tuple[float, float]]) -> Any:
    bounds = base.RealVectorBounds(len(ranges))
    for number, (low, high) in enumerate(ranges):
        bounds.setLow(number, low)
        bounds.setHigh(number, high)
    return bounds


def _states(base: Any, task: Task) -> Any:
    """Return the space of states: a place, and heading, speed and time, which are no distance."""
    wide, limits = _WIDE * task.options.aircraft.separation, task.options.limits
    ends = [[getattr(point, axis) for point in (task.own, *task.route)] for axis in ("x", "y")]
    place, motion = base.RealVectorStateSpace(2), base.RealVectorStateSpace(3)
    space = base.CompoundStateSpace()
    place.setBounds(_bounds(base, [(min(values) - wide, max(values) + wide) for values in ends]))
    speeds, times = (limits.speed_min, limits.speed_max), (0.0, task.options.rejoin_by)
    motion.setBounds(_bounds(base, [(-math.pi, math.pi), speeds, times]))
    space.addSubspace(place, 1.0)
    space.addSubspace(motion, 0.0)
    return space


def _write(state: Any, x: float, y: float, heading: float, speed: float, time: float) -> None:
    place, motion = state[0], state[1]
    place[0], place[1] = x, y
    motion[0], motion[1], motion[2] = heading, speed, time


def _goal(base: Any, information: Any, task: Task) -> Any:
    points = [(point.x, point.y) for point in task.route]

    class Goal(base.GoalSampleableRegion):
        """The discs of the route's points."""

        def distanceGoal(self, state: Any) -> float:  # noqa: N802 - OMPL's
            return min(math.hypot(state[0][0] - x, state[0][1] - y) for x, y in points)

        def sampleGoal(self, state: Any) -> None:  # noqa: N802 - OMPL's
            _write(state, *points[0], 0.0, task.own.speed, 0.0)

        def maxSampleCount(self) -> int:  # noqa: N802 - OMPL's
            return 1

    goal = Goal(information)
    goal.setThreshold(task.options.aircraft.goal_radius)
    return goal


class _Propagator:
    """Flies a time step by a control: a course relative to that to the goal, and a speed, both in
    -1 to 1.
    """

    def __init__(self, task: Task) -> None:
        self._limits, self._goal = task.options.limits, task.route[0]

    def propagate(self, state: Any, control: Any, duration: float, after: Any) -> None:
        """Write into a state of OMPL what follows from another after a duration, s."""
        x, y = state[0][0], state[0][1]
        heading, speed, moment = (state[1][n] for n in range(3))
        rate = self._turn_rate(x, y, heading, control[0], duration)
        acceleration = self._acceleration(speed, control[1], duration)
        along = (speed + 0.5 * acceleration * duration) * duration
        halfway = heading + 0.5 * rate * duration
        x, y = x + along * math.cos(halfway), y + along * math.sin(halfway)
        heading = math.remainder(heading + rate * duration, math.tau)
        _write(after, x, y, heading, speed + acceleration * duration, moment + duration)

    def _turn_rate(
        self, x: float, y: float, heading: float, control: float, duration: float
    ) -> float:
        """Return the turn rate, rad/s, that comes nearest to a course by the end."""
        # The cube makes flights straight to the goal as likely as they are useful.
        course = math.atan2(self._goal.y - y, self._goal.x - x) + math.pi * control**3
        rate = math.remainder(course - heading, math.tau) / duration
        return max(-self._limits.yaw_rate_max, min(self._limits.yaw_rate_max, rate))

    def _acceleration(self, speed: float, control: float, duration: float) -> float:
        """Return the acceleration, m/s^2, that comes nearest to a speed by the end."""
        limits = self._limits
        middle = 0.5 * (limits.speed_max + limits.speed_min)
        half = 0.5 * (limits.speed_max - limits.speed_min)
        acceleration = (middle + half * control - speed) / duration
        return max(limits.acceleration_min, min(limits.acceleration_max, acceleration))


def _checker(task: Task) -> Callable[[Any], bool]:
    """Return what says whether a state keeps away from everything: by so much more than it has to
    that what lies between two states does too.
    """
    options = task.options
    required = options.requirement.separation + options.requirement.margin
    fastest = options.limits.speed_max + max(
        (intruder.speed for intruder in task.intruders), default=0.0
    )
    required = math.hypot(required, 0.5 * fastest * options.aircraft.dt)
    others = [
        (
            intruder.x,
            intruder.y,
            intruder.speed * math.cos(intruder.heading),
            intruder.speed * math.sin(intruder.heading),
        )
        for intruder in task.intruders
    ]
    shapes = [(_grown(area, options), area.velocity) for area in task.areas]

    def is_valid(state: Any) -> bool:
        x, y, moment = state[0][0], state[0][1], state[1][2]
        if moment > options.rejoin_by:
            return False
        if any(
            math.hypot(x - a - u * moment, y - b - v * moment) < required for a, b, u, v in others
        ):
            return False
        return not any(
            shapely.contains_xy(shape, x - u * moment, y - v * moment) for shape, (u, v) in shapes
        )

    return is_valid


def _grown(area: Area, options: Options) -> shapely.Polygon:
    """Return an area to be kept out of with its clearance, as a polygon in its own frame."""
    step = (options.limits.speed_max + math.hypot(*area.velocity)) * options.aircraft.dt
    more = math.hypot(area.clearance + options.requirement.margin, 0.5 * step)
    shape = area.shape
    if isinstance(shape, Circle):
        grown = shapely.Point(shape.x, shape.y).buffer(shape.radius + more, quad_segs=64)
    else:
        grown = shapely.Polygon(shape.outer, shape.holes).buffer(more, quad_segs=64)
    shapely.prepare(grown)
    return grown


def is_right(task: Task, steps: Sequence[Step]) -> bool:
    """Return whether a flight keeps the limits and keeps away from everything, and ends in time in
    the disc of a point of the route; by the judge of the attack on SAFE where it has one.
    """
    flight, options = fly(task.own, steps), task.options
    areas = sky.Sky(None, tuple(task.areas))
    return (
        _keeps_limits(flight, options.limits)
        and all(_keeps_away(flight, intruder, options.requirement) for intruder in task.intruders)
        and _arrives(flight, task)
        and not sky.faults(areas, flight, options, None)
    )


def _keeps_limits(flight: Flown, limits: Limits) -> bool:
    return bool(
        flight.speed.min() >= limits.speed_min - _EXACT
        and flight.speed.max() <= limits.speed_max + _EXACT
        and flight.acceleration.min() >= limits.acceleration_min - _EXACT
        and flight.acceleration.max() <= limits.acceleration_max + _EXACT
        and np.abs(flight.turn_rate).max() <= limits.yaw_rate_max + _EXACT
    )


def _keeps_away(flight: Flown, intruder: VehicleState[Ground], required: Requirement) -> bool:
    velocity = intruder.speed * np.exp(1j * intruder.heading)
    away = np.abs(flight.place - complex(intruder.x, intruder.y) - velocity * flight.time)
    return bool(away.min() >= required.separation + required.margin - _TOLERANCE)


def _arrives(flight: Flown, task: Task) -> bool:
    """Return whether a flight ends in time in the disc of a point of the route."""
    end, options = flight.place[-1], task.options
    off = min(abs(end - complex(point.x, point.y)) for point in task.route)
    return bool(off <= options.aircraft.goal_radius and flight.time[-1] <= options.rejoin_by)


def fly(own: VehicleState[Ground], steps: Sequence[Step]) -> Flown:
    """Return a flight that begins at the ownship, of constant turn rate and acceleration from step
    to step, sampled every :data:`~benchmarks.safety.resimulation.CLOSE` s at most.
    """
    heading, speed, at = (np.array(field) for field in zip(*steps, strict=True))
    lasts = np.diff(at)
    count = np.ceil(lasts / CLOSE - 1e-9).astype(int)
    part = np.repeat(lasts / count, count)  # s between two samples
    rate = np.repeat(np.diff(np.unwrap(heading)) / lasts, count)
    acceleration = np.repeat(np.diff(speed) / lasts, count)
    course = own.heading + _running_sums(rate * part)
    pace = own.speed + _running_sums(acceleration * part)
    moves = 0.5 * (pace[1:] + pace[:-1]) * part * np.exp(0.5j * (course[1:] + course[:-1]))
    return Flown(
        time=_running_sums(part),
        place=complex(own.x, own.y) + _running_sums(moves),
        heading=course,
        speed=pace,
        acceleration=np.append(acceleration, acceleration[-1]),
        turn_rate=np.append(rate, rate[-1]),
    )


def _running_sums(parts: np.ndarray) -> np.ndarray:
    """Return the sums of none, one, two, ... of the parts, ``[n + 1]`` of ``[n]``."""
    return np.concatenate([[0.0], np.cumsum(parts)])
