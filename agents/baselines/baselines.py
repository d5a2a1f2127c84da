"""Resolvers to compare with: what an aircraft does without a resolver, by the rules of the air, or
by geometry.

All see what a policy does, all intruders at once, and return actions of the same contract. They
steer to the goal while nothing is in the way. ``speed`` of the two that resolve says whether they
may change it: most resolvers hold it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from agents.manoeuvres.direct_to_goal import DirectTask, clear
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.frames import Air
from envs.kinematics import VehicleState, velocity
from envs.relative import at_distance_scale
from envs.trees import column

_GAIN = 0.5  # of the error of the heading that is turned in a time step
_EVER, _PAST = 1e5, 1.05
# separations that the resolvers aim at: they decide at every time step, for straight flight
_MARGIN = 1.1
_LOOKAHEAD, _PATIENCE = 120.0, 60.0  # time steps


class Observation(NamedTuple):
    """What a resolver sees of encounters in progress; own fields ``[M]``, those of intruders ``[M,
    K]``.
    """

    own: VehicleState[Air]
    intruders: VehicleState[Air]  # as reported, not as they are
    mask: np.ndarray  # which of the K intruders exist, bool
    goal_x: np.ndarray
    goal_y: np.ndarray
    time_left: float  # time that is left to reach the goal, s
    # aircraft's separation over that of each intruder, [M, K]; None: 1 of all
    distance_scale: Any = None
    # altitudes, m, and vertical speeds, m/s, of the intruders above the ownship, which flies level,
    # [M, K]; None: all are at one level
    above: Any = None
    climb: Any = None
    number: Any = None  # of each encounter among those that are flown together, [M]


class StepResolver(Protocol):
    """A resolver that decides from states, step by step; it may remember a whole number of each
    encounter, 0 at the start.
    """

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` in [-1, 1] and what to remember, int8 ``[M]``.

        Raises:
            ValueError: something of the observation is not finite; the message names it.
        """
        ...


def check_observation(observation: Observation) -> Observation:
    """Return an observation with each intruder at its distance in its own separation, on the same
    bearing.

    Raises:
        ValueError: a number is not finite, absent intruders aside; the message names it.
    """
    fields: dict[str, Any] = {
        f"own.{name}": values for name, values in observation.own._asdict().items()
    }
    states = observation.intruders._asdict()
    fields |= {
        f"intruders.{name}": np.where(observation.mask, values, 0.0)
        for name, values in states.items()
    }
    fields |= {
        "goal_x": observation.goal_x,
        "goal_y": observation.goal_y,
        "time_left": observation.time_left,
    }
    for name, values in fields.items():
        for where in np.argwhere(~np.isfinite(values)):
            value, place = np.asarray(values)[tuple(where)], where.tolist() or ""
            raise ValueError(f"{name}{place} is {value}, expected a finite number")
    if observation.distance_scale is None:
        return observation
    return observation._replace(
        intruders=at_distance_scale(
            column(observation.own), observation.intruders, observation.distance_scale
        )
    )


def course_to_goal(observation: Observation, aircraft: Aircraft) -> np.ndarray:
    """Return the course to be steered to the goal, rad in [-pi, pi), ``[M]``.

    A goal inside the turning circle can never be met by turning to it: the ownship flies straight
    on until it is outside, and turns then.
    """
    own = observation.own
    dx, dy = observation.goal_x - own.x, observation.goal_y - own.y
    bearing = wrap(np.arctan2(dy, dx) - own.heading, np)
    radius = own.speed / aircraft.limits.yaw_rate_max
    side = np.where(bearing >= 0.0, 1.0, -1.0)
    # Distance of the goal from the centre of the circle to its side.
    apart = np.hypot(
        dx + side * radius * np.sin(own.heading), dy - side * radius * np.cos(own.heading)
    )
    unreachable = apart < radius - 0.9 * aircraft.goal_radius
    return wrap(own.heading + np.where(unreachable, 0.0, bearing), np)


def may_return(observation: Observation, aircraft: Aircraft, required: float) -> np.ndarray:
    """Return whether the ownship may go back to its route, ``required`` metres from intruders, bool
    ``[M]``.

    It may where one turn onto the goal and straight flight to it keep clear of all intruders, and,
    as is usual among published resolvers, where all of them are past their closest point of
    approach and far enough.
    """
    own, goal = column((observation.own, (observation.goal_x, observation.goal_y)))
    # Late or not: whether there is time is no question of being clear.
    limits = aircraft.limits
    task = DirectTask(limits, aircraft.goal_radius, _EVER, 0.95 * limits.yaw_rate_max)
    free = np.all(
        clear(own, goal, observation.intruders, required, 0.0, task, np) | ~observation.mask,
        axis=-1,
    )
    past = _conflicts(observation, observation.own.heading, required, math.inf)
    opening = (past.time == 0.0) & (past.distance > _PAST * required)
    return free | np.all(opening | ~observation.mask, axis=-1)


def steer(own: VehicleState[Air], course: Any, aircraft: Aircraft) -> np.ndarray:
    """Return the steering, a share of the largest turn rate in [-1, 1], that brings the heading to
    a course.
    """
    gain = _GAIN / aircraft.dt
    return np.clip(gain * wrap(course - own.heading, np) / aircraft.limits.yaw_rate_max, -1.0, 1.0)


@dataclass(frozen=True)
class NoResolution:
    """Resolve nothing: along the route to the goal at constant speed."""

    aircraft: Aircraft

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used."""
        observation = check_observation(observation)
        course = course_to_goal(observation, self.aircraft)
        return _actions(steer(observation.own, course, self.aircraft)), memory


class _Conflict(NamedTuple):
    """On straight courses, ``[M, K]``: is the zone lost soon; place (m), time (s) of the CPA;
    distance now, then, m.
    """

    exists: np.ndarray
    x: np.ndarray
    y: np.ndarray
    time: np.ndarray
    distance: np.ndarray
    miss: np.ndarray


def _conflicts(
    observation: Observation, course: np.ndarray, protected: float, lookahead: float
) -> _Conflict:
    """Predict the conflicts of flying on at the present speed on a course, ``[M]``."""
    own = column(observation.own._replace(heading=course))
    x, y = observation.intruders.x - own.x, observation.intruders.y - own.y
    (own_vx, own_vy), (vx, vy) = velocity(own, np), velocity(observation.intruders, np)
    vx, vy = vx - own_vx, vy - own_vy
    square = np.maximum(vx * vx + vy * vy, 1e-6)
    time = np.maximum(-(x * vx + y * vy) / square, 0.0)
    cpa_x, cpa_y = x + vx * time, y + vy * time
    distance, miss = np.hypot(x, y), np.hypot(cpa_x, cpa_y)
    # The protected distance is lost half a chord before the closest point.
    entry = time - np.sqrt(np.maximum(protected * protected - miss * miss, 0.0) / square)
    closing = x * vx + y * vy < 0.0
    exists = observation.mask & closing & (miss < protected) & (entry <= lookahead)
    return _Conflict(exists, cpa_x, cpa_y, time, distance, miss)


@dataclass(frozen=True)
class RightHand:
    """The rules of the air: give way to the right, keep the right of way, else straight, then turn.

    An intruder that approaches head-on, from the right, or is being overtaken is given way to by a
    turn to the right as sharp as the limits allow (ICAO Annex 2, 3.2.2; 14 CFR 91.113). To one that
    must give way the ownship stands on; since this one does not, it turns right too where the loss
    is ``patience`` seconds away. When neither the present course nor the one to the goal is in
    conflict, it goes there.
    """

    aircraft: Aircraft
    patience: float = _PATIENCE
    """Time steps."""

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used."""
        observation = check_observation(observation)
        own, protected = observation.own, _MARGIN * self.aircraft.separation
        lookahead = _LOOKAHEAD * self.aircraft.dt
        straight = _conflicts(observation, own.heading, protected, lookahead)
        bearing = _bearing(observation)
        # Head-on, from the right or overtaken is ours to avoid; 110 degrees from ahead is where
        # overtaking begins.
        from_left = (bearing > math.radians(15.0)) & (bearing < math.radians(110.0))
        last = _conflicts(observation, own.heading, protected, self.patience * self.aircraft.dt)
        ours = np.any(straight.exists & ~from_left | last.exists & from_left, axis=-1)
        home = course_to_goal(observation, self.aircraft)
        free = may_return(observation, self.aircraft, protected)
        steering = np.where(free, steer(own, home, self.aircraft), np.where(ours, -1.0, 0.0))
        return _actions(steering), memory


@dataclass(frozen=True)
class PotentialField:
    """The modified voltage potential (MVP): the least change of velocity that clears the closest
    point of approach.

    Each intruder in conflict pushes the predicted position at the closest point of approach out of
    its protected zone along the shortest way, within the time left until then, so that the new
    course touches the zone; several pushes add up. Source: J. M. Hoekstra, R. N. H. W. van Gent, R.
    C. J. Ruigrok, "Designing for safety: the 'free flight' air traffic management concept",
    Reliability Engineering and System Safety 75 (2002) 215; the tangent's correction as in M.
    Ribeiro, J. Ellerbroek, J. Hoekstra, Aerospace 7 (2020) 79. Exactly head-on both sides are as
    good, and it goes right. When the course to the goal is free of conflicts, it goes there.
    """

    aircraft: Aircraft
    speed: bool = False
    """Whether the speed is changed too; otherwise only the course of the new velocity is taken."""

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used."""
        observation = check_observation(observation)
        own, protected = observation.own, _MARGIN * self.aircraft.separation
        lookahead = _LOOKAHEAD * self.aircraft.dt
        conflict = _conflicts(observation, own.heading, protected, lookahead)
        push_x, push_y = self._push(observation, conflict, protected)
        own_vx, own_vy = velocity(own, np)
        wanted_x, wanted_y = own_vx - push_x, own_vy - push_y
        resolving = conflict.exists.any(axis=-1)

        free = may_return(observation, self.aircraft, protected)
        course = np.where(resolving, np.arctan2(wanted_y, wanted_x), own.heading)
        course = np.where(free, course_to_goal(observation, self.aircraft), course)
        throttle = np.zeros(len(course))
        if self.speed:
            needed = np.hypot(observation.goal_x - own.x, observation.goal_y - own.y) / max(
                observation.time_left, self.aircraft.dt
            )
            hurry = np.maximum(1.05 * needed - own.speed, 0.0)
            change = np.where(resolving & ~free, np.hypot(wanted_x, wanted_y) - own.speed, hurry)
            limits = self.aircraft.limits
            most = (
                np.where(change >= 0.0, limits.acceleration_max, -limits.acceleration_min)
                * self.aircraft.dt
            )
            throttle = np.clip(change / most, -1.0, 1.0)
        return np.stack([throttle, steer(own, course, self.aircraft)], axis=-1), memory

    def _push(
        self, observation: Observation, conflict: _Conflict, protected: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the sum over all intruders of the push towards them, to be taken off the velocity,
        m/s, ``[M]``.
        """
        miss = np.maximum(conflict.miss, 1e-9)
        # Near a hit the shortest way out is noise: to the right of the line of sight, the zone to
        # the left.
        x, y = (
            observation.intruders.x - observation.own.x[:, None],
            observation.intruders.y - observation.own.y[:, None],
        )
        apart = np.maximum(conflict.distance, 1e-9)
        hit = conflict.miss < 0.01 * self.aircraft.separation
        unit_x, unit_y = (
            np.where(hit, -y / apart, conflict.x / miss),
            np.where(hit, x / apart, conflict.y / miss),
        )
        # Pushed straight out of the circle the course would still cut it: the tangent lies a little
        # farther out.
        outside = conflict.distance > protected
        ratio = np.clip(protected / apart, 0.0, 1.0), np.clip(conflict.miss / apart, 0.0, 1.0)
        tangent = np.where(outside, np.cos(np.arcsin(ratio[0]) - np.arcsin(ratio[1])), 1.0)
        size = (protected / np.maximum(tangent, 0.1) - conflict.miss) / np.maximum(
            conflict.time, self.aircraft.dt
        )
        size = np.where(conflict.exists, size, 0.0)
        return np.sum(size * unit_x, axis=-1), np.sum(size * unit_y, axis=-1)


BASELINES: dict[str, Callable[[Aircraft], StepResolver]] = {
    "none": NoResolution,
    "rules": RightHand,
    "mvp": PotentialField,
    "mvp_speed": lambda aircraft: PotentialField(aircraft, speed=True),
}
"""The baselines by name, for an aircraft."""


def _bearing(observation: Observation) -> np.ndarray:
    """Return the intruders' bearings from the own heading, rad, left positive, ``[M, K]``."""
    own = column(observation.own)
    return wrap(
        np.arctan2(observation.intruders.y - own.y, observation.intruders.x - own.x) - own.heading,
        np,
    )


def _actions(steering: np.ndarray) -> np.ndarray:
    """Return actions that hold the speed, ``[M, 2]``."""
    return np.stack([np.zeros_like(steering), steering], axis=-1)
