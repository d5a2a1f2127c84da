"""Plans as they are flown: the follower on the true limits' kinematics, from the published
waypoints, ten times a step.

Nothing of the rollout that made a plan is used. The intruders fly their true motion, manoeuvres
included.
"""

from typing import NamedTuple

import numpy as np

from agents.planner.request.request import drift_points
from envs import intruder
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.follower import PERIOD, gains, offset, steer
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance
from envs.relative import distance, leg_separation, leg_separation_in_space
from envs.trees import column, take
from envs.world import State, above_own, distance_scales, flatness_of, move_intruders
from eval.flights.simulate import OUTCOMES, Flights, last_turn, reversal_rate

SUBSTEPS = round(1.0 / PERIOD)  # periods of the follower in a time step


class PlanFlights(NamedTuple):
    """How plans were flown; fields ``[N]``."""

    flights: Flights
    error: np.ndarray  # largest distance from where the plan was at the time, m; 0 without a plan
    # smallest distance to any intruder until the plan's end, m; nan without a plan
    whole_separation: np.ndarray


class Active(NamedTuple):
    """Flights in progress; fields ``[M]``."""

    state: State
    side: np.ndarray  # of the last turn: -1, 0 or 1
    ends: np.ndarray  # what comes later than this is not judged, s after the start
    # velocity of the goal through the air, m/s, [M] each; None: it stands still
    drift: tuple[np.ndarray, np.ndarray] | None = None


class Step(NamedTuple):
    """What one time step of flight along legs brought; fields ``[M]``."""

    # smallest distance to any intruder, m, inf without one; to one with a separation of its own in
    # shares of it, times the aircraft's; in space the cylindrical one
    separation: np.ndarray
    nearest: np.ndarray  # smallest distance to the goal, m
    # time since the beginning of the step at which the goal's radius was entered, s; nan if it was
    # not
    reached: np.ndarray
    path: np.ndarray  # length flown, m
    error: np.ndarray  # largest distance from where the plan was at the time, m
    reversals: np.ndarray  # how often the turn changed side, int32

    @classmethod
    def blank(cls, count: int) -> "Step":
        """Return the step of so many flights before its first period."""
        zeros, far = np.zeros(count), np.full(count, np.inf)
        return cls(far, far, np.full(count, np.nan), zeros, zeros, np.zeros(count, np.int32))


def fly_step(
    air: Active,
    references: VehicleState[Air],
    aircraft: Aircraft,
    limits: Limits,
    altitudes: np.ndarray | None = None,
) -> tuple[Active, Step]:
    """Fly one time step through ``references`` at its beginning and after every period, ``[SUBSTEPS
    + 1, M]``.

    The limits are those of the vehicle that follows, not those of the ownship's decisions. The own
    altitudes at the same times, m, are those of encounters in space; None: as at the start.
    """
    state, dt = air.state, aircraft.dt
    own, other, following = state.own, state.intruders.vehicle, move_intruders(state, dt, np)
    # Over a step the intruder's controller holds its yaw rate.
    turn_rate = wrap(following.vehicle.heading - other.heading, np) / dt
    distance_scale, flatness = distance_scales(state, aircraft, np), flatness_of(state, aircraft)
    side, step = air.side, Step.blank(own.x.size)
    for number in range(SUBSTEPS):
        before, after = (take(references, number + i) for i in (0, 1))
        acceleration, yaw_rate = _command(before, after, own, dt, limits)
        moved = advance(own, acceleration, yaw_rate, PERIOD * dt, limits, np)
        coasting = other.speed * 0.0
        other_moved = advance(other, coasting, turn_rate, PERIOD * dt, intruder.COASTING, np)
        clock = (state.steps + (number + 1) * PERIOD) * dt
        judged = state.mask & (clock <= air.ends + 1e-6)[:, None]
        if flatness is None:
            apart = leg_separation(column(own), column(moved), other, other_moved, PERIOD * dt, np)
        else:
            above = (
                above_own(state, n * PERIOD, None if altitudes is None else altitudes[n])
                for n in (number, number + 1)
            )
            states = (column(own), column(moved)), (other, other_moved)
            apart = leg_separation_in_space(*states, tuple(above), flatness, PERIOD * dt)
        apart = apart if distance_scale is None else apart * distance_scale
        least = np.min(np.where(judged, apart, np.inf), axis=-1, initial=np.inf)
        goal_x, goal_y = drift_points((state.goal_x, state.goal_y), air.drift, clock)
        to_goal = distance(goal_x - moved.x, goal_y - moved.y, np)
        entered = np.isnan(step.reached) & (to_goal <= aircraft.goal_radius)
        side, changed = last_turn(yaw_rate, side, reversal_rate(aircraft.limits))
        step = Step(
            separation=np.minimum(step.separation, least),
            nearest=np.minimum(step.nearest, to_goal),
            reached=np.where(entered, (number + 1) * PERIOD * dt, step.reached),
            path=step.path + 0.5 * (PERIOD * dt) * (own.speed + moved.speed),
            error=np.maximum(step.error, np.hypot(*offset(moved, after))),
            reversals=step.reversals + changed,
        )
        own, other = moved, other_moved
    previous = None if state.previous is None else (state.intruders.vehicle, state.previous[0])
    state = state._replace(own=own, intruders=following, steps=state.steps + 1.0, previous=previous)
    return Active(state, side, air.ends, air.drift), step


def _command(
    before: VehicleState[Air],
    after: VehicleState[Air],
    own: VehicleState[Air],
    dt: float,
    limits: Limits,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the follower's acceleration, m/s^2, and yaw rate, rad/s, ``[M]``, within the vehicle's
    limits, from references now and after a period of a time step dt, s.
    """
    acceleration, yaw_rate = steer(before, after, own, PERIOD * dt, gains(dt))
    acceleration = np.clip(acceleration, limits.acceleration_min, limits.acceleration_max)
    return acceleration, np.clip(yaw_rate, -limits.yaw_rate_max, limits.yaw_rate_max)


class Tally:
    """What flights have brought so far, arrays ``[N]``, until the time limit ``steps`` away."""

    def __init__(self, count: int, aircraft: Aircraft, *, endless: bool = False) -> None:
        self._rules = aircraft.rules()
        self._required = 0.0 if endless else aircraft.separation
        self.steps = round(aircraft.t_max / aircraft.dt)
        self._reached, self._lost = np.full(count, np.nan), np.full(count, np.nan)  # when, s
        self._separation, self._whole = np.full(count, np.inf), np.full(count, np.inf)
        self._closest_at, self._path = np.zeros(count), np.zeros(count)
        self._goal, self._error = np.full(count, np.inf), np.zeros(count)
        self._reversals = np.zeros(count, np.int32)

    def add(self, rows: np.ndarray, step: Step, count: int) -> None:
        """Add the step number ``count``, the first being 1, of some flights by their numbers,
        ``[M]``.
        """
        self._whole[rows] = np.minimum(self._whole[rows], step.separation)
        self._error[rows] = np.maximum(self._error[rows], step.error)
        if count > self.steps:
            return
        dt = self._rules.dt
        closer = step.separation < self._separation[rows]
        self._closest_at[rows[closer]] = count * dt
        self._separation[rows] = np.minimum(self._separation[rows], step.separation)
        lost = (step.separation < self._required) & np.isnan(self._lost[rows])
        self._lost[rows[lost]] = count * dt
        # Path, goal and reversals count until the goal is reached.
        part = np.isnan(self._reached[rows])
        under_way = rows[part]
        self._path[under_way] += step.path[part]
        self._goal[under_way] = np.minimum(self._goal[under_way], step.nearest[part])
        self._reversals[under_way] += step.reversals[part]
        entered = ~np.isnan(step.reached) & part
        self._reached[rows[entered]] = (count - 1) * dt + step.reached[entered]

    def judge(self, counts: np.ndarray | bool = True) -> PlanFlights:
        """Judge the flights; only those that count, bool ``[N]``, can have reached their goal."""
        rules = self._rules
        outcome = np.full(self._reached.size, OUTCOMES.index("timeout"), np.int8)
        outcome[~np.isnan(self._reached) & counts] = OUTCOMES.index("reached")
        outcome[~np.isnan(self._lost)] = OUTCOMES.index("violation")
        scores = np.array([rules.reward_violation, rules.reward_goal, rules.reward_timeout])
        ends = (self._lost, self._reached, np.full(outcome.size, rules.t_max))
        flights = Flights(
            outcome=outcome,
            score=scores[outcome],
            duration=np.choose(outcome, ends),
            min_separation=self._separation,
            time_of_min_separation=self._closest_at,
            path_length=self._path,
            goal_distance=self._goal,
            reversals=self._reversals,
        )
        return PlanFlights(flights, self._error, self._whole)
