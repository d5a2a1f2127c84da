"""Plans as they are flown: the follower on the true limits' kinematics, from the published waypoints, every 0.1 s.

Nothing of the rollout that made a plan is used. The intruders fly their true motion, manoeuvres included.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.planner.request import Request
from agents.planner.traffic import Traffic
from envs import intruder
from envs.angles import wrap
from envs.encounters import Encounter
from envs.follower import PERIOD, steer
from envs.intruder import Intent, IntruderState
from envs.kinematics import Limits, VehicleState, advance
from envs.outcome import Rules
from envs.relative import distance, leg_separation
from envs.tracking import offset
from envs.trees import column, take
from envs.waypoints import Knots, at, legs
from eval.flights.simulate import OUTCOMES, Flights, turned_to
from eval.flights.trajectories import TrajectoryRecorder

__all__ = [
    "ROUTE_SPACING",
    "SUBSTEPS",
    "Air",
    "Flown",
    "Second",
    "Tally",
    "fly_plans",
    "fly_second",
    "request_of",
    "takeoff",
    "verdicts",
]

ROUTE_SPACING = 5_000.0
"""Between the points of an evaluation's route beyond the goal, m; it ends 45 km beyond it."""

SUBSTEPS = round(1.0 / PERIOD)
"""Periods of the follower in a second."""


class Flown(NamedTuple):
    """How plans were flown; fields ``[N]``."""

    flights: Flights
    error: np.ndarray
    """Largest distance from where the plan was at the time, m; 0 without a plan."""
    whole_separation: np.ndarray
    """Smallest distance to any intruder from the request to the plan's end, m; nan without a plan."""


class Air(NamedTuple):
    """Flights in progress; fields ``[M]``, of intruders ``[M, K]``."""

    own: VehicleState
    traffic: IntruderState
    intent: Intent
    mask: Any
    goal_x: Any
    goal_y: Any
    side: Any
    """Of the last turn: -1, 0 or 1."""
    ends: Any
    """What comes later than this is not judged, s after the start."""


class Second(NamedTuple):
    """What one second of flight along legs brought; fields ``[M]``."""

    own: VehicleState
    separation: Any
    """Smallest distance to any intruder, m."""
    nearest: Any
    """Smallest distance to the goal, m."""
    reached: Any
    """Time since the beginning of the second at which the goal's radius was entered, s; nan if it was not."""
    path: Any
    """Length flown, m."""
    error: Any
    """Largest distance from where the plan was at the time, m."""
    side: Any
    """Side of the last turn: -1, 0 or 1."""
    reversals: Any
    """How often the turn changed side."""


def request_of(encounters: Encounter, intruders: VehicleState | None = None) -> Request:
    """Return what a planner is asked at the start of encounters ``[N]``.

    The route runs from the start to the goal, then over a point every 5 km on the same line to 45 km beyond it.

    Args:
        encounters: ``[N]``.
        intruders: as the ownship believes them to be, ``[N, K]``; None: as they are.
    """
    own = encounters.own
    dx, dy = encounters.goal_x - own.x, encounters.goal_y - own.y
    length = np.maximum(np.hypot(dx, dy), 1e-9)
    beyond = np.arange(0.0, 45_000.1, ROUTE_SPACING)
    x = np.concatenate([own.x[:, None], encounters.goal_x[:, None] + (dx / length)[:, None] * beyond], axis=1)
    y = np.concatenate([own.y[:, None], encounters.goal_y[:, None] + (dy / length)[:, None] * beyond], axis=1)
    traffic = Traffic.straight(encounters.intruders if intruders is None else intruders, encounters.mask)
    return Request(own, traffic, x, y, np.full(len(x), x.shape[1]))


def fly_second(
    air: Air, following: IntruderState, references: VehicleState, clock: float, radius: float, limits: Limits
) -> Second:
    """Fly one second through states to be flown through, ``[M]``.

    Args:
        air: at the beginning of the second.
        following: the intruders at its end, ``[M, K]``.
        references: what to fly through at the beginning and after every period, ``[1 / PERIOD + 1, M]``.
        clock: time since the start at the beginning of the second, s.
        radius: of the goal, m.
        limits: of the vehicle.
    """
    own, side, mask, other = air.own, air.side, air.mask, air.traffic.vehicle
    turn = wrap(following.vehicle.heading - other.heading, np)
    separation, nearest = np.full(own.x.shape, np.inf), np.full(own.x.shape, np.inf)
    reached, error, path = np.full(own.x.shape, np.nan), np.zeros(own.x.shape), np.zeros(own.x.shape)
    reversals = np.zeros(own.x.shape, np.int32)
    for step in range(SUBSTEPS):
        now, after = (VehicleState(*(field[step + i] for field in references)) for i in (0, 1))
        acceleration, yaw_rate = steer(now, after, own)
        acceleration = np.clip(acceleration, limits.acceleration_min, limits.acceleration_max)
        yaw_rate = np.clip(yaw_rate, -limits.yaw_rate_max, limits.yaw_rate_max)
        moved = advance(own, acceleration, yaw_rate, PERIOD, limits, np)
        # Over a second the intruder's controller holds its yaw rate.
        other_next = advance(other, other.speed * 0.0, turn, PERIOD, intruder.INTRUDER_LIMITS, np)
        apart = leg_separation(column(own), column(moved), other, other_next, PERIOD, np)
        flown = (clock + (step + 1) * PERIOD <= air.ends + 1e-6)[:, None]
        separation = np.minimum(separation, np.min(np.where(mask & flown, apart, np.inf), axis=-1, initial=np.inf))
        to_goal = distance(air.goal_x - moved.x, air.goal_y - moved.y, np)
        entered = np.isnan(reached) & (to_goal <= radius)
        reached = np.where(entered, (step + 1) * PERIOD, reached)
        nearest = np.minimum(nearest, to_goal)
        path += 0.5 * PERIOD * (own.speed + moved.speed)
        error = np.maximum(error, np.hypot(*offset(moved, after)))
        side, reversed_ = turned_to(yaw_rate, side)
        reversals += reversed_
        own, other = moved, other_next
    return Second(own, separation, nearest, reached, path, error, side, reversals)


def takeoff(encounters: Encounter, ends: Any) -> Air:
    """Return the flights at the start of encounters ``[N]``, to be judged until ``ends``, s, ``[N]``."""
    return Air(
        encounters.own,
        intruder.start(encounters.intruders, np),
        encounters.intent,
        encounters.mask,
        encounters.goal_x,
        encounters.goal_y,
        np.zeros(len(encounters.goal_x)),
        ends,
    )


def fly_plans(
    encounters: Encounter,
    knots: Knots,
    rules: Rules,
    limits: Limits,
    recorder: TrajectoryRecorder | None = None,
    numbers: np.ndarray | None = None,
) -> Flown:
    """Fly plans once, to their ends.

    An encounter counts as reached if the goal was by ``rules.t_max`` and the separation kept until then.

    Args:
        encounters: ``[N]``, float64.
        knots: of the plans, ``[N, W]``, all finite.
        rules: of the task, with a time step of 1 s.
        limits: of the vehicle that follows.
        recorder: takes the flights second by second until ``rules.t_max``.
        numbers: their rows in it, ``[N]``; None: 0 to N - 1.
    """
    tally, rows = Tally(len(encounters.goal_x)), np.arange(len(encounters.goal_x))
    air, curves = takeoff(encounters, knots.time[:, -1]), legs(knots)
    clock = 0
    while rows.size:
        following = intruder.step(air.traffic, air.intent, clock * 1.0, 1.0, np)
        states = (at(curves, clock + step * PERIOD) for step in range(SUBSTEPS + 1))
        references = VehicleState(*(np.stack(field) for field in zip(*states, strict=True)))
        second = fly_second(air, following, references, float(clock), rules.goal_radius, limits)
        clock += 1
        tally.add(rows, second, clock, rules)
        if recorder is not None and clock <= rules.t_max:
            number = rows if numbers is None else numbers[rows]
            recorder.append(number, second.own, following.vehicle, second.separation)
        air = air._replace(own=second.own, traffic=following, side=second.side)
        on = air.ends > clock
        if not on.all():
            rows, air, curves = take((rows, air, curves), on)
    return tally.flown(rules)


class Tally:
    """What flights have brought so far; arrays ``[N]``."""

    def __init__(self, count: int) -> None:
        self._reached = np.full(count, np.nan)
        self._lost = np.full(count, np.nan)
        self._separation, self._whole = np.full(count, np.inf), np.full(count, np.inf)
        self._closest_at, self._path, self._goal = np.zeros(count), np.zeros(count), np.full(count, np.inf)
        self._reversals = np.zeros(count, np.int32)
        self._error = np.zeros(count)

    def add(self, rows: Any, second: Second, clock: int, rules: Rules) -> None:
        """Add a second that ends at time ``clock``, s, of some flights."""
        self._whole[rows] = np.minimum(self._whole[rows], second.separation)
        self._error[rows] = np.maximum(self._error[rows], second.error)
        if clock > rules.t_max:
            return
        closer = second.separation < self._separation[rows]
        self._closest_at[rows[closer]] = clock
        self._separation[rows] = np.minimum(self._separation[rows], second.separation)
        lost = (second.separation < rules.separation) & np.isnan(self._lost[rows])
        self._lost[rows[lost]] = clock
        # Path, goal and reversals count until the goal is reached.
        under_way = rows[np.isnan(self._reached[rows])]
        part = np.isnan(self._reached[rows])
        self._path[under_way] += second.path[part]
        self._goal[under_way] = np.minimum(self._goal[under_way], second.nearest[part])
        self._reversals[under_way] += second.reversals[part]
        entered = ~np.isnan(second.reached) & part
        self._reached[rows[entered]] = clock - 1 + second.reached[entered]

    def flown(self, rules: Rules) -> Flown:
        """Judge the flights."""
        outcome = np.full(self._reached.size, OUTCOMES.index("timeout"), np.int8)
        outcome[~np.isnan(self._reached)] = OUTCOMES.index("reached")
        outcome[~np.isnan(self._lost)] = OUTCOMES.index("violation")
        scores = np.array([rules.reward_violation, rules.reward_goal, rules.reward_timeout])
        ends = (self._lost, self._reached, np.full(outcome.size, rules.t_max))
        flights = Flights(
            outcome,
            scores[outcome],
            np.choose(outcome, ends),
            self._separation,
            self._closest_at,
            self._path,
            self._goal,
            self._reversals,
        )
        return Flown(flights, self._error, self._whole)


def verdicts(flown: Flown, refused: np.ndarray, rules: Rules) -> Flown:
    """Count refused requests as time-outs even where their advisory trajectory arrives: refusing is no success."""
    arrived = refused & (flown.flights.outcome == OUTCOMES.index("reached"))
    flights = flown.flights._replace(
        outcome=np.where(arrived, OUTCOMES.index("timeout"), flown.flights.outcome).astype(np.int8),
        score=np.where(arrived, rules.reward_timeout, flown.flights.score),
        duration=np.where(arrived, rules.t_max, flown.flights.duration),
    )
    return flown._replace(flights=flights)
