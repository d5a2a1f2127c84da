"""What a policy commands for each place of the intruder, and how smooth its flights are.

The map has the ownship at its origin, heading up: x to the right, y ahead, in metres. Relative
headings and the bearing of the goal count counter-clockwise as seen from above, left positive, in
radians, as everywhere in the toolkit.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.frames import Air
from envs.kinematics import VehicleState, commands
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import column
from eval.flights.simulate import OUTCOMES, ByPolicy, Flights, fly
from eval.flights.trajectories import TrajectoryRecorder

_UP = math.pi / 2.0


class FixedStates(NamedTuple):
    """What a map holds fixed."""

    own_speed: float  # m/s
    intruder_speed: float  # m/s
    # intruder's heading minus the own one, rad counter-clockwise: +pi/2 comes from the right
    relative_heading: float
    goal_bearing: float  # from the own heading, rad counter-clockwise
    goal_distance: float  # m


class Advisory(NamedTuple):
    """A map; the intruder is in the middle of each of C by C cells."""

    scene: FixedStates
    extent: float  # how far the map reaches to each side, m
    place: np.ndarray  # of the middles, the same to the right and ahead, m, [C]
    yaw_rate: np.ndarray  # commanded, rad/s, left positive, [C (ahead), C (right)]
    acceleration: np.ndarray  # commanded, m/s^2, [C (ahead), C (right)]


def advise(
    policy: Policy, scene: FixedStates, extent: float, cells: int, aircraft: Aircraft
) -> Advisory:
    """Ask a policy what it commands on a map of C by C cells that reaches so far, m, ahead, back
    and to either side.
    """
    place = extent * ((2.0 * np.arange(cells) + 1.0) / cells - 1.0)
    y, x = (side.ravel() for side in np.meshgrid(place, place, indexing="ij"))
    zero = np.zeros_like(x)
    own: VehicleState[Air] = VehicleState(zero, zero, zero + _UP, zero + scene.own_speed)
    heading = math.remainder(_UP + scene.relative_heading, 2.0 * math.pi)
    intruder: VehicleState[Air] = VehicleState(x, y, zero + heading, zero + scene.intruder_speed)
    goal_x = zero - scene.goal_distance * math.sin(scene.goal_bearing)
    goal_y = zero + scene.goal_distance * math.cos(scene.goal_bearing)
    action = policy.command(own, column(intruder), np.ones((x.size, 1), bool), goal_x, goal_y)
    acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), aircraft.limits, np)
    return Advisory(
        scene, extent, place, yaw_rate.reshape(cells, cells), acceleration.reshape(cells, cells)
    )


def relative_velocity(scene: FixedStates) -> tuple[float, float]:
    """Return the intruder's velocity minus the own one, to the right and ahead, m/s."""
    ahead = scene.intruder_speed * math.cos(scene.relative_heading) - scene.own_speed
    return -scene.intruder_speed * math.sin(scene.relative_heading), ahead


def name_of(relative_heading: float) -> str:
    """Return the geometry in words; the limits between them are those of the paper's scenarios."""
    degrees = math.degrees(relative_heading)
    size, side = abs(degrees), "right" if degrees > 0.0 else "left"
    if size <= 20.0:
        return "same course"
    if size >= 160.0:
        return "head-on"
    kind = "converging" if size < 45.0 else "crossing" if size <= 135.0 else "oncoming"
    return f"{kind} from the {side}"


def chatter(policy: Policy, encounters: int, seed: int, aircraft: Aircraft) -> dict[str, Any]:
    """Fly ``circle`` encounters 0, 1, ... of a seed and return how much commands change from step
    to step.
    """
    starts = encounters_of_seed(scenario("circle", aircraft), seed, 0, encounters)
    recorder = TrajectoryRecorder(starts)
    flights = fly(starts, ByPolicy(policy), aircraft, recorder=recorder)
    return scores(recorder.stack().action, flights, aircraft)


def scores(action: np.ndarray, flights: Flights, aircraft: Aircraft) -> dict[str, Any]:
    """Return the chatter of flights ``[N]`` by their actions ``[T, N, 2]``, nan after their
    ends.
    """
    acceleration, yaw_rate = commands((action[..., 0], action[..., 1]), aircraft.limits, np)
    turns = flights.reversals
    return {
        "flights": len(flights.outcome),
        **{name: int(np.sum(flights.outcome == code)) for code, name in enumerate(OUTCOMES)},
        "yaw_rate_change_deg_s_per_s": math.degrees(_change(yaw_rate, aircraft.dt)),
        "acceleration_change_m_s2_per_s": _change(acceleration, aircraft.dt),
        "mean_yaw_rate_deg_s": math.degrees(float(np.nanmean(np.abs(yaw_rate)))),
        "reversals_per_flight": {
            "mean": float(np.mean(turns)),
            "p95": float(np.percentile(turns, 95.0)),
            "max": float(np.max(turns)),
        },
    }


def _change(command: np.ndarray, dt: float) -> float:
    """Return the mean absolute change of a command ``[T, N]`` per second; 0 if no flight has two
    decisions.
    """
    change = np.abs(np.diff(command, axis=0)) / dt
    change = change[np.isfinite(change)]
    return float(change.mean()) if change.size else 0.0
