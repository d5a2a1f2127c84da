"""What a policy commands wherever the intruder is; how even-handed and how calm it is in flights.

The map has the ownship at its origin, heading up: x to the right, y ahead, in metres. Relative headings and the bearing
of the goal count counter-clockwise as seen from above, left positive, in radians, as everywhere in the toolkit.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from agents.policy.inference import Policy
from envs.aircraft import Aircraft
from envs.encounters import scenario
from envs.kinematics import VehicleState, commands
from envs.starts import numbered
from envs.trees import column, take
from eval.flights.simulate import OUTCOMES, ByPolicy, fly, reversal_rate
from eval.flights.trajectories import TrajectoryRecorder

__all__ = ["Advisory", "Recorded", "Scene", "Scenes", "advise", "chatter", "lines_of", "mirror_error", "mirrored"]
__all__ += ["name_of", "record", "relative_velocity"]

_UP = math.pi / 2.0


class Scene(NamedTuple):
    """What a map holds fixed."""

    own_speed: float  # m/s
    intruder_speed: float  # m/s
    relative_heading: float  # intruder's heading less the own one, rad counter-clockwise: +pi/2 comes from the right
    goal_bearing: float  # from the own heading, rad counter-clockwise
    goal_distance: float  # m


class Advisory(NamedTuple):
    """A map; the intruder is in the middle of each of C by C cells."""

    scene: Scene
    place: np.ndarray  # of the middles, the same to the right and ahead, m, [C]
    yaw_rate: np.ndarray  # commanded, rad/s, left positive, [C (ahead), C (right)]
    acceleration: np.ndarray  # commanded, m/s^2, [C (ahead), C (right)]


def advise(policy: Policy, scene: Scene, extent: float, cells: int, aircraft: Aircraft) -> Advisory:
    """Ask a policy what it commands on a map of C by C cells that reaches so far, m, ahead, back and to either side."""
    place = extent * ((2.0 * np.arange(cells) + 1.0) / cells - 1.0)
    y, x = (side.ravel() for side in np.meshgrid(place, place, indexing="ij"))
    zero = np.zeros_like(x)
    own = VehicleState(zero, zero, zero + _UP, zero + scene.own_speed)
    heading = math.remainder(_UP + scene.relative_heading, 2.0 * math.pi)
    intruder = VehicleState(x, y, zero + heading, zero + scene.intruder_speed)
    goal_x = zero - scene.goal_distance * math.sin(scene.goal_bearing)
    goal_y = zero + scene.goal_distance * math.cos(scene.goal_bearing)
    action = policy.command(own, column(intruder), np.ones((x.size, 1), bool), goal_x, goal_y)
    acceleration, yaw_rate = commands((action[:, 0], action[:, 1]), aircraft.limits, np)
    return Advisory(scene, place, yaw_rate.reshape(cells, cells), acceleration.reshape(cells, cells))


def relative_velocity(scene: Scene) -> tuple[float, float]:
    """Return the intruder's velocity less the own one, to the right and ahead, m/s."""
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


def lines_of(error: dict[str, Any], calm: dict[str, Any]) -> list[str]:
    """Return a mirror error and a chatter in words."""
    form = "mean {mean:.3f}, 95 % {p95:.3f}, max {max:.2f}"
    reversals = "mean {mean:.2f}, 95 % {p95:.0f}, max {max:.0f}".format(**calm["reversals_per_flight"])
    return [
        f"mirror error, {error['observations']} observations: yaw rate {form.format(**error['yaw_rate_deg_s'])} deg/s; "
        f"acceleration {form.format(**error['acceleration_m_s2'])} m/s^2; "
        f"both to one side {100.0 * error['same_side_share']:.2f} %",
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
