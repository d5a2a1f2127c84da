"""How even-handed and how calm a policy is: its error under reflection, and the chatter of its commands."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from envs.encounters import SCENARIOS
from envs.kinematics import Limits, VehicleState, commands
from envs.observation import SIZE, decode
from envs.outcome import RULES
from envs.relative import straight_cpa
from envs.starts import numbered
from eval.flights.simulate import OUTCOMES, REVERSAL_RATE, Decider, fly
from eval.flights.trajectories import TrajectoryRecorder

__all__ = ["Recorded", "around_conflicts", "chatter", "lines_of", "mirror_error", "mirrored", "record"]

CONFLICT_RADIUS = 2_000.0
"""Straight courses that pass closer than this, m, count as around a conflict: twice the required separation."""

NEAREST, FARTHEST = 1_000.0, 10_000.0  # distances to the intruder of the uniform sample, m
HORIZON = 300.0  # latest closest approach of the uniform sample, s

# Left and right change places: headings and bearings change their sign.
_REFLECTION = np.array([1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0], np.float32)
_PERCENTILE = 95.0


class Recorded(NamedTuple):
    """Decisions of flights; NaN after a flight's end."""

    observation: np.ndarray  # [T, N, 8], float32
    action: np.ndarray  # [T, N, 2], fractions of the limits
    reversals: np.ndarray  # changes of the side of the turn in each flight, [N]
    outcome: np.ndarray  # codes into eval.flights.simulate.OUTCOMES, [N]

    @property
    def seen(self) -> np.ndarray:
        """All observations in the air, ``[M, 8]``."""
        return self.observation[np.isfinite(self.observation[..., 0])]


def mirrored(observation: np.ndarray) -> np.ndarray:
    """Return the observations ``[..., 8]`` of the scenes in which left and right have changed places."""
    return observation * _REFLECTION


def mirror_error(decider: Decider, observation: np.ndarray, limits: Limits) -> dict[str, Any]:
    """Return by how much a decision changes with the side: |a(mirror(o)) - mirror(a(o))|.

    A policy that treats both sides alike has zero. Where a scene is its own mirror image it must then fly straight,
    so that a policy that breaks the tie of a head-on encounter has a large error there, rightly.

    Args:
        decider: the policy.
        observation: ``[M, 8]``, float32, M > 0.
        limits: full deflection of either command.

    Returns:
        ``observations``; ``mean``, ``p95`` and ``max`` of ``yaw_rate_deg_s`` and ``acceleration_m_s2``; and
        ``same_side_share``: how often both turns go to one side, each by :data:`eval.flights.simulate.REVERSAL_RATE` or
            more.
    """
    actions, images = decider(observation), decider(mirrored(observation))
    acceleration, yaw_rate = commands((actions[:, 0], actions[:, 1]), limits, np)
    acceleration_there, yaw_rate_there = commands((images[:, 0], images[:, 1]), limits, np)
    turning = np.minimum(np.abs(yaw_rate), np.abs(yaw_rate_there)) >= REVERSAL_RATE
    return {
        "observations": len(observation),
        "yaw_rate_deg_s": _spread(np.degrees(np.abs(yaw_rate + yaw_rate_there))),
        "acceleration_m_s2": _spread(np.abs(acceleration - acceleration_there)),
        "same_side_share": float(np.mean(turning & (yaw_rate * yaw_rate_there > 0.0))),
    }


def around_conflicts(count: int, seed: int) -> np.ndarray:
    """Return observations ``[count, 8]``, float32, uniform in the eight components, of those around a conflict.

    These have the intruder 1 to 10 km away and, if both fly on straight, nearer than :data:`CONFLICT_RADIUS` within
    :data:`HORIZON`. All other components take their whole range, whether flights come there or not.
    """
    draws = np.random.default_rng(seed)
    kept: list[np.ndarray] = []
    found = 0
    while found < count:
        observation = draws.uniform(-1.0, 1.0, (4 * count, SIZE))
        observation[:, 5] = draws.uniform(NEAREST / 10_000.0 - 1.0, FARTHEST / 10_000.0 - 1.0, 4 * count)
        observation = observation.astype(np.float32)
        scene = decode(list(observation.T), np)
        zero = np.zeros_like(scene.own_speed)
        heading = np.arctan2(scene.intruder_vy, scene.intruder_vx)
        speed = np.hypot(scene.intruder_vx, scene.intruder_vy)
        own = VehicleState(zero, zero, zero, scene.own_speed)
        cpa = straight_cpa(own, VehicleState(scene.intruder_x, scene.intruder_y, heading, speed), np)
        kept.append(observation[(cpa.distance < CONFLICT_RADIUS) & (cpa.time > 0.0) & (cpa.time < HORIZON)])
        found += len(kept[-1])
    return np.concatenate(kept)[:count]


def record(decider: Decider, encounters: int, seed: int, limits: Limits) -> Recorded:
    """Fly a policy through ``circle`` encounters 0, 1, ... of a seed and return its decisions."""
    starts = numbered(SCENARIOS["circle"], seed, 0, encounters)
    recorder = TrajectoryRecorder(starts)
    flights = fly(starts, decider, RULES, limits, recorder=recorder)
    flown = recorder.stack()
    return Recorded(flown.observation, flown.action, flights.reversals, flights.outcome)


def chatter(recorded: Recorded, limits: Limits) -> dict[str, Any]:
    """Return how much the commands move from one second to the next, over all seconds of all flights.

    Args:
        recorded: of at least one flight.
        limits: full deflection of either command.
    """
    acceleration, yaw_rate = commands((recorded.action[..., 0], recorded.action[..., 1]), limits, np)
    flights = {name: int(np.sum(recorded.outcome == code)) for code, name in enumerate(OUTCOMES)}
    return {
        "flights": len(recorded.outcome),
        **flights,
        "yaw_rate_change_deg_s_per_s": math.degrees(_change(yaw_rate)),
        "acceleration_change_m_s2_per_s": _change(acceleration),
        "mean_yaw_rate_deg_s": math.degrees(float(np.nanmean(np.abs(yaw_rate)))),
        "reversals_per_flight": _spread(recorded.reversals),
    }


def lines_of(errors: Mapping[str, Mapping[str, Any]], calm: Mapping[str, Any]) -> list[str]:
    """Return mirror errors by the name of their observations, and the chatter, in words."""
    lines = []
    for name, error in errors.items():
        turn, throttle = error["yaw_rate_deg_s"], error["acceleration_m_s2"]
        lines.append(
            f"mirror error, {name} ({error['observations']} observations): "
            f"yaw rate mean {turn['mean']:.3f}, 95 % {turn['p95']:.3f}, max {turn['max']:.2f} deg/s; "
            f"acceleration mean {throttle['mean']:.3f}, 95 % {throttle['p95']:.3f}, max {throttle['max']:.2f} m/s^2; "
            f"both to one side {100.0 * error['same_side_share']:.2f} %"
        )
    reversals = calm["reversals_per_flight"]
    lines.append(
        f"chatter, {calm['flights']} circle flights: yaw rate {calm['yaw_rate_change_deg_s_per_s']:.3f} deg/s and "
        f"acceleration {calm['acceleration_change_m_s2_per_s']:.3f} m/s^2 per second; heading reversals per flight "
        f"mean {reversals['mean']:.2f}, 95 % {reversals['p95']:.0f}, max {reversals['max']:.0f}"
    )
    return lines


def _change(command: np.ndarray) -> float:
    """Return the mean absolute change of a command ``[T, N]`` per second; 0 if no flight has two decisions."""
    change = np.abs(np.diff(command, axis=0)) / RULES.dt
    change = change[np.isfinite(change)]
    return float(change.mean()) if change.size else 0.0


def _spread(values: np.ndarray) -> dict[str, float]:
    return {
        "mean": float(np.mean(values)),
        "p95": float(np.percentile(values, _PERCENTILE)),
        "max": float(np.max(values)),
    }
