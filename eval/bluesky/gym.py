"""A pilot of BlueSky-Gym's ``HorizontalCREnv-v0``: its observations to its actions, by the shipped
policy.

The environment commands a heading every 50 s and no speed, which is slower than the policy decides.
So headings are flown ahead for that time and then on, once straight and once by the policy, the
traffic on straight courses, until the course to the waypoint is clear of all; taken is the heading
with the least drift off the waypoint among those that keep the separation best.
"""

import math
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from agents.inference import Policy
from envs.aircraft import new_aircraft
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, advance, commands
from envs.relative import bearing, leg_separation
from envs.trees import column, take

__all__ = ["ENVIRONMENT", "Pilot", "observe"]

ENVIRONMENT = "HorizontalCREnv-v0"

_FASTEST = 89.0  # m/s; the aircraft begin faster, and BlueSky slows them at sea level
_NM, _KM, _STEP_OF_BLUESKY = 1852, 1000, 5.0  # m, m, s

MARGIN = 1.02
"""Separation that is kept where it can be, in that of the environment."""

_TURNS = np.radians(np.arange(-45.0, 46.0, 7.5))
_STEP = 25.0  # s, of the flight ahead
_STEPS = 60


class _Units(NamedTuple):
    """Constants of the environment, SI."""

    length: float
    """Unit of distances in observations."""
    speed: float
    """Unit of speeds in observations."""
    heading: float
    """Full deflection of the action, rad."""
    separation: float
    reached: float
    """Distance from the waypoint where an episode ends."""
    period: float
    """Time between two actions."""


@cache
def _units() -> _Units:
    environment: Any = import_module("bluesky_gym.envs.horizontal_cr_env")
    return _Units(
        _KM * environment.WAYPOINT_DISTANCE_MAX,
        environment.AC_SPD,
        math.radians(environment.D_HEADING),
        _NM * environment.INTRUSION_DISTANCE,
        _KM * environment.DISTANCE_MARGIN,
        _STEP_OF_BLUESKY * environment.ACTION_FREQUENCY,
    )


class Pilot:
    """Flies the environment: called with an observation, it returns the action."""

    def __init__(self, policy: Policy | None = None) -> None:
        """Take a policy, by default the shipped one."""
        self._policy = policy or Policy.load()

    def __call__(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the action ``[1]`` in [-1, 1] for an observation of the environment."""
        speed, traffic, goal = observe(observation)
        first = np.append(
            np.clip(math.atan2(goal[1], goal[0]), -_units().heading, _units().heading), _TURNS
        )
        nearest, drift = self._ahead(first, speed, traffic, goal)
        lack = np.maximum(MARGIN - nearest / _units().separation, 0.0)
        best = np.lexsort((drift, lack))[0] % len(first)
        return np.array([-first[best] / _units().heading])

    def _ahead(
        self,
        heading: np.ndarray,
        speed: float,
        traffic: list[VehicleState[Air]],
        goal: tuple[float, float],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return least distance from the traffic, m, and drift, rad s, of flights that begin with
        headings ``[N]``.

        ``[2 N]`` each: of those that go on straight, then of those that the policy flies on.
        """
        limits, period = _limits(speed), _units().period
        separation = MARGIN * _units().separation
        policy = self._policy.for_aircraft(new_aircraft(limits, separation))
        by_policy = np.repeat([False, True], len(heading))
        flights = _FlightsAhead.begin(np.tile(heading, 2), speed, traffic, goal)
        for step in range(_STEPS):
            time = step * _STEP
            off, to_goal = flights.to_waypoint()
            clear = _is_clear(flights.own, flights.intruders, off, to_goal / speed, limits)
            # The environment ends between two actions only.
            arrived = (to_goal < _units().reached) & (time % period == 0.0)
            ends = arrived | (clear & (np.abs(off) < 0.1))
            flights = flights.end(ends, separation)
            if not flights.flies.any():
                break
            turn = np.zeros(len(by_policy))
            if time >= period:
                most = limits.yaw_rate_max
                turn = np.where(clear, np.clip(off / _STEP, -most, most), 0.0)
                commanded = flights.flies & by_policy & ~clear
                if commanded.any():
                    turn[commanded] = _turn_rates(policy, take(flights, commanded), limits)
            flights = flights.advance(turn, limits)
        return flights.nearest, flights.drift


class _FlightsAhead(NamedTuple):
    """Flights ``[M]`` on from an observation, and what they came to so far."""

    own: VehicleState[Air]
    intruders: VehicleState[Air]  # the traffic of each, [M, K]
    goal_x: np.ndarray  # the waypoint, m
    goal_y: np.ndarray
    nearest: np.ndarray  # least distance from the traffic, m
    drift: np.ndarray  # rad s
    flies: np.ndarray  # which go on, bool

    @classmethod
    def begin(
        cls,
        heading: np.ndarray,
        speed: float,
        traffic: list[VehicleState[Air]],
        goal: tuple[float, float],
    ) -> "_FlightsAhead":
        """Return flights with first headings, rad, at a speed, m/s, to a waypoint, m."""
        zeros, shape = np.zeros(len(heading)), (len(heading), len(traffic))
        intruders: VehicleState[Air] = VehicleState(
            *(np.broadcast_to(field, shape) for field in np.transpose(traffic))
        )
        return cls(
            own=VehicleState(zeros, zeros, heading, zeros + speed),
            intruders=intruders,
            goal_x=zeros + goal[0],
            goal_y=zeros + goal[1],
            nearest=zeros + np.inf,
            drift=zeros,
            flies=zeros == 0.0,
        )

    def to_waypoint(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the bearing of the waypoint from the heading, rad, and its distance, m."""
        distance = np.hypot(self.goal_x - self.own.x, self.goal_y - self.own.y)
        return bearing(self.own, self.goal_x, self.goal_y, np), distance

    def end(self, ends: np.ndarray, separation: float) -> "_FlightsAhead":
        """Return the flights without those that end, and without those that are beaten: that drift
        more than one that has ended with the separation, m.
        """
        flies = self.flies & ~ends
        well = ~flies & (self.nearest >= separation)
        least = self.drift.min(initial=np.inf, where=well)
        return self._replace(flies=flies & (self.drift < least))

    def advance(self, turn: np.ndarray, limits: Limits) -> "_FlightsAhead":
        """Return the flights a step later, with yaw rates, rad/s."""
        own = advance(self.own, np.zeros(len(turn)), turn, _STEP, limits, np)
        intruders = advance(
            self.intruders, np.zeros(self.intruders.x.shape), 0.0, _STEP, limits, np
        )
        apart = np.hypot(intruders.x - own.x[:, None], intruders.y - own.y[:, None]).min(axis=1)
        off = np.abs(bearing(own, self.goal_x, self.goal_y, np))
        return self._replace(
            own=own,
            intruders=intruders,
            nearest=np.where(self.flies, np.minimum(apart, self.nearest), self.nearest),
            drift=self.drift + np.where(self.flies, off * _STEP, 0.0),
        )


def _limits(speed: float) -> Limits:
    """Return the limits of a narrow and agile aircraft of the policy's family: no speed is
    commanded, and BlueSky turns more tightly than the paper's aircraft.
    """
    separation = MARGIN * _units().separation
    change = 0.1 * speed * speed / separation
    return Limits(0.7 * speed, speed, -change, change, speed / (0.3 * separation))


def _is_clear(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    off: np.ndarray,
    until: np.ndarray,
    limits: Limits,
) -> np.ndarray:
    """Return whether the straight way to the waypoint keeps the separation, ``[M]``, which lies off
    the heading by so much, rad, and takes so long, s.
    """
    direct = column(own._replace(heading=own.heading + off))
    time = until[:, None]
    own_end, intruder_ends = (
        advance(aircraft, 0.0, 0.0, time, limits, np) for aircraft in (direct, intruders)
    )
    apart = leg_separation(direct, own_end, intruders, intruder_ends, time, np)
    return (apart >= MARGIN * _units().separation).all(axis=1)


def _turn_rates(policy: Policy, flights: _FlightsAhead, limits: Limits) -> np.ndarray:
    """Return the yaw rates that the policy commands, rad/s, ``[M]``."""
    exists = np.ones_like(flights.intruders.x, bool)
    action = policy.command(flights.own, flights.intruders, exists, flights.goal_x, flights.goal_y)
    return commands(action.T, limits, np)[1]


def observe(
    observation: Mapping[str, np.ndarray],
) -> tuple[float, list[VehicleState[Air]], tuple[float, float]]:
    """Return the speed of all aircraft, m/s, the traffic and the waypoint, m, in the ownship's
    frame (x ahead, y left).

    The environment's two differences of speed are ``-v cos a`` and ``v - v sin a`` of the
    intruder's relative course a and the common speed v, which follows from both.
    """
    forward_difference, across = (
        _units().speed * np.asarray(observation[f"{axis}_difference_speed"], float) for axis in "xy"
    )
    fastest_across = int(np.argmax(across))
    speed = float(
        (forward_difference[fastest_across] ** 2 + across[fastest_across] ** 2)
        / (2.0 * across[fastest_across])
    )
    course = np.arctan2(speed - across, -forward_difference)
    speed = min(speed, _FASTEST)
    distance = _units().length * np.asarray(observation["intruder_distance"], float)
    states = (
        distance * observation["cos_difference_pos"],
        distance * observation["sin_difference_pos"],
        course,
    )
    traffic: list[VehicleState[Air]] = [
        VehicleState(x, y, heading, speed) for x, y, heading in np.transpose(states).tolist()
    ]
    to_goal = _units().length * float(observation["waypoint_distance"][0])
    forward = to_goal * float(observation["cos_drift"][0])
    leftward = to_goal * float(observation["sin_drift"][0])
    return speed, traffic, (forward, leftward)
