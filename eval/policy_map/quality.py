"""How even-handed and how calm a policy is: its error under reflection, and the chatter of its commands."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.encounters import scenario
from envs.kinematics import VehicleState, commands
from envs.relative import straight_cpa
from envs.starts import numbered
from envs.trees import column, mapped, take
from eval.flights.simulate import OUTCOMES, ByPolicy, fly, reversal_rate
from eval.flights.trajectories import TrajectoryRecorder

__all__ = ["Recorded", "Scenes", "around_conflicts", "chatter", "lines_of", "mirror_error", "mirrored", "record"]

NEAREST, FARTHEST = 1.0, 10.0  # distances to the intruder of the uniform sample, separations
CONFLICT, HORIZON = 2.0, 30.0
"""Straight courses that pass closer than so many separations, sooner than so many times the time that the ownship takes
for one at its greatest speed, count as around a conflict."""


class Scenes(NamedTuple):
    """What a policy is asked, with one intruder; fields ``[M]``."""

    own: VehicleState
    intruder: VehicleState
    goal_x: np.ndarray  # m
    goal_y: np.ndarray

    def actions(self, policy: Policy) -> np.ndarray:
        """Return what the policy commands, ``[M, 2]``."""
        one = np.ones((self.goal_x.size, 1), bool)
        return policy.command(self.own, column(self.intruder), one, self.goal_x, self.goal_y)


class Recorded(NamedTuple):
    """Decisions of flights; NaN after a flight's end."""

    scenes: Scenes  # all of them in the air, [M]
    action: np.ndarray  # [T, N, 2], fractions of the limits
    reversals: np.ndarray  # changes of the side of the turn in each flight, [N]
    outcome: np.ndarray  # codes into eval.flights.simulate.OUTCOMES, [N]


def mirrored(scenes: Scenes) -> Scenes:
    """Return the scenes in which left and right have changed places."""

    def reflected(state: VehicleState) -> VehicleState:
        return state._replace(y=-state.y, heading=-state.heading)

    return Scenes(reflected(scenes.own), reflected(scenes.intruder), scenes.goal_x, -scenes.goal_y)


def mirror_error(policy: Policy, scenes: Scenes, aircraft: Aircraft) -> dict[str, Any]:
    """Return by how much a decision changes with the side: |a(mirror(s)) - mirror(a(s))|.

    A policy that treats both sides alike has zero. Where a scene is its own mirror image it must then fly straight,
    so that a policy that breaks the tie of a head-on encounter has a large error there, rightly.

    ``same_side_share`` is how often both turns go to one side, each by :func:`eval.flights.simulate.reversal_rate` or
    more.
    """
    limits = aircraft.limits
    acceleration, yaw_rate = commands(scenes.actions(policy).T, limits, np)
    acceleration_there, yaw_rate_there = commands(mirrored(scenes).actions(policy).T, limits, np)
    turning = np.minimum(np.abs(yaw_rate), np.abs(yaw_rate_there)) >= reversal_rate(limits)
    return {
        "observations": scenes.goal_x.size,
        "yaw_rate_deg_s": _spread(np.degrees(np.abs(yaw_rate + yaw_rate_there))),
        "acceleration_m_s2": _spread(np.abs(acceleration - acceleration_there)),
        "same_side_share": float(np.mean(turning & (yaw_rate * yaw_rate_there > 0.0))),
    }


def around_conflicts(count: int, seed: int, aircraft: Aircraft) -> Scenes:
    """Return scenes ``[count]``, uniform in the eight numbers of an observation, of those around a conflict.

    These have the intruder 1 to 10 separations away and, if both fly on straight, nearer than :data:`CONFLICT` within
    :data:`HORIZON`. All other numbers take their whole range, whether flights come there or not.
    """
    draws, limits = np.random.default_rng(seed), aircraft.limits
    middle, half = 0.5 * (limits.speed_max + limits.speed_min), 0.5 * (limits.speed_max - limits.speed_min)
    kept: list[Scenes] = []
    found = 0
    while found < count:
        u = draws.uniform(-1.0, 1.0, (8, 4 * count))
        away = aircraft.separation * draws.uniform(NEAREST, FARTHEST, 4 * count)
        to_goal = 10.0 * aircraft.separation * (u[7] + 1.0)
        own = VehicleState(0.0 * u[0], 0.0 * u[0], math.pi * u[1], middle + half * u[0])
        there, goal = own.heading + math.pi * u[4], own.heading + math.pi * u[6]
        speed = 0.5 * aircraft.traffic_speed_max * (u[2] + 1.0)
        intruder = VehicleState(away * np.cos(there), away * np.sin(there), math.pi * u[3], speed)
        scenes = Scenes(own, intruder, to_goal * np.cos(goal), to_goal * np.sin(goal))
        cpa = straight_cpa(own, intruder, np)
        near = (cpa.distance < CONFLICT * aircraft.separation) & (cpa.time > 0.0)
        kept.append(take(scenes, near & (cpa.time < HORIZON * aircraft.time_unit)))
        found += kept[-1].goal_x.size
    return take(mapped(lambda *fields: np.concatenate(fields), *kept), slice(count))


def record(policy: Policy, encounters: int, seed: int, aircraft: Aircraft) -> Recorded:
    """Fly a policy through ``circle`` encounters 0, 1, ... of a seed and return its decisions."""
    starts = numbered(scenario("circle", aircraft), seed, 0, encounters)
    recorder = TrajectoryRecorder(starts)
    flights = fly(starts, ByPolicy(policy), aircraft, recorder=recorder)
    flown = recorder.stack()
    flying = np.isfinite(flown.action[..., 0])
    goal_x, goal_y = (np.broadcast_to(field, flying.shape)[flying] for field in (starts.goal_x, starts.goal_y))
    own, intruder = (
        VehicleState(*(field[:-1][flying] for field in one)) for one in (flown.own, take(flown.intruders, (..., 0)))
    )
    return Recorded(Scenes(own, intruder, goal_x, goal_y), flown.action, flights.reversals, flights.outcome)


def chatter(recorded: Recorded, aircraft: Aircraft) -> dict[str, Any]:
    """Return how much the commands change from one time step to the next, over all steps of all flights."""
    acceleration, yaw_rate = commands((recorded.action[..., 0], recorded.action[..., 1]), aircraft.limits, np)
    return {
        "flights": len(recorded.outcome),
        **{name: int(np.sum(recorded.outcome == code)) for code, name in enumerate(OUTCOMES)},
        "yaw_rate_change_deg_s_per_s": math.degrees(_change(yaw_rate, aircraft.dt)),
        "acceleration_change_m_s2_per_s": _change(acceleration, aircraft.dt),
        "mean_yaw_rate_deg_s": math.degrees(float(np.nanmean(np.abs(yaw_rate)))),
        "reversals_per_flight": _spread(recorded.reversals),
    }


def lines_of(errors: Mapping[str, Mapping[str, Any]], calm: Mapping[str, Any]) -> list[str]:
    """Return mirror errors by the name of their observations, and the chatter, in words."""
    form = "mean {mean:.3f}, 95 % {p95:.3f}, max {max:.2f}"
    lines = [
        f"mirror error, {name} ({error['observations']} observations): "
        f"yaw rate {form.format(**error['yaw_rate_deg_s'])} deg/s; "
        f"acceleration {form.format(**error['acceleration_m_s2'])} m/s^2; "
        f"both to one side {100.0 * error['same_side_share']:.2f} %"
        for name, error in errors.items()
    ]
    reversals = "mean {mean:.2f}, 95 % {p95:.0f}, max {max:.0f}".format(**calm["reversals_per_flight"])
    return [
        *lines,
        f"chatter, {calm['flights']} circle flights: yaw rate {calm['yaw_rate_change_deg_s_per_s']:.3f} deg/s and "
        f"acceleration {calm['acceleration_change_m_s2_per_s']:.3f} m/s^2 per second; heading reversals per flight "
        f"{reversals}",
    ]


def _change(command: np.ndarray, dt: float) -> float:
    """Return the mean absolute change of a command ``[T, N]`` per second; 0 if no flight has two decisions."""
    change = np.abs(np.diff(command, axis=0)) / dt
    change = change[np.isfinite(change)]
    return float(change.mean()) if change.size else 0.0


def _spread(values: np.ndarray) -> dict[str, float]:
    return {"mean": float(np.mean(values)), "p95": float(np.percentile(values, 95.0)), "max": float(np.max(values))}
