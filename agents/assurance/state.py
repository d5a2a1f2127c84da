"""What a run-time monitor remembers and decides; see ``agents.assurance``."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from agents.assurance.backup import Backup, resting, straight_east
from agents.assurance.inputs import Memory, blank
from agents.assurance.thresholds import Thresholds
from agents.kernel.traffic import Traffic, whole
from agents.kernel.trajectory import Trajectory, trajectory
from agents.planner.request.options import L
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import map_leaves


class State(IntEnum):
    """Of a monitor."""

    IDLE = 0  # there is no plan to watch
    MONITORING = 1  # the plan is flown, and nothing is wrong
    REPLAN_REQUESTED = 2  # the plan is flown, and a new one is wanted
    DENIED = 3  # inputs are missing, or no plan was found while the present one is still safe
    BACKUP = 4  # the backup is flown until there is a safe plan


class FlyMode(IntEnum):
    """What the aircraft flies."""

    NOTHING = 0
    PLAN = 1
    BACKUP = 2


class Monitor(NamedTuple):
    """The state of monitors; fields ``[N, ...]``, so that :func:`envs.trees.take` picks rows."""

    state: Array  # code of State, int8
    on_backup: Array  # whether the backup is flown, bool; kept while nothing can be seen
    causes: Array  # bits of Cause, int32
    memory: Memory
    plan: Trajectory[Air]  # the active plan; a placeholder where there is none
    started: Array  # when the active plan was requested, s
    expected: Traffic  # the intruders that the active plan was made with, [N, K]
    sums: Array  # leaky sums of cross-track (m s), along-track (m s) and time error (s s), [N, 3]
    requested: Array  # number of the last request
    requested_at: Array  # when it went out, s; -inf before the first
    answered: Array  # number of the last request that was answered
    request_traffic: Traffic  # the intruders of the last request, [N, K]
    backup: Backup


class Decision(NamedTuple):
    """What the monitor wants and why; fields ``[N]``."""

    state: Array  # code of State, int8
    fly: Array  # code of FlyMode, int8
    # whether a plan is requested now, bool: from own, against traffic, with the number below
    replan: Array
    number: Array
    causes: Array  # bits of Cause, int32
    own: VehicleState[Air]  # present states, dead-reckoned
    # the intruders now, dead-reckoned, with the turns that their reports show, [N, K]
    traffic: Traffic
    cross_track: Array  # error against the plan, m, positive to its left
    along_track: Array  # m, positive ahead
    time_error: Array  # s, positive when late
    # m, positive above; nan where the plan is one in the plane, or the altitude is unknown
    altitude_error: Array
    intruder_position: Array  # largest deviation of an intruder from its prediction, m
    intruder_velocity: Array  # m/s
    # predicted separation of the rest of the plan, less the own distance from it, m; a lower bound
    separation: Array
    # when that rest falls below what is required, of areas too, s from now; inf where it does not
    loss: Array
    # by how much the rest comes nearer to an area than it may, m; 0: it does not
    area_deficit: Array
    area: Array  # what messages call that area; "" where there is none, object
    # what messages call the area that the backup enters first; "" where it does not
    backup_area: Array
    intruder_causes: Array  # bits of those that lie in each intruder, int32 [N, K]
    areas: Array  # that each may meet, as they are now: tuples of kernel.areas.ActiveArea, object


def start(count: int, intruders: int, thresholds: Thresholds[L]) -> Monitor:
    """Return monitors that watch nothing, ``[count]`` with room for so many intruders each."""
    no, zero = np.zeros(count, dtype=bool), np.zeros(count)
    absent = np.zeros((count, intruders), dtype=bool)
    no_traffic = whole(Traffic.straight(VehicleState(*np.zeros((4, count, intruders))), absent))
    options = thresholds.options
    # Keeps arrays whole where there is no plan.
    straight = straight_east(
        count, np.arange(options.waypoints + 1) * options.interval, options.aircraft.limits
    )
    return Monitor(
        state=np.zeros(count, dtype=np.int8),
        on_backup=no.copy(),
        causes=np.zeros(count, dtype=np.int32),
        memory=blank(count, intruders, straight.speed[:, 0]),
        plan=trajectory(straight),
        started=zero.copy(),
        expected=no_traffic,
        sums=np.zeros((count, 3)),
        requested=np.zeros(count, dtype=np.int64),
        requested_at=zero - np.inf,
        answered=np.zeros(count, dtype=np.int64),
        request_traffic=no_traffic,
        backup=resting(count, thresholds),
    )


_BY_PLACE = (
    "intruders",
    "reported",
    "turn_rate",
    "turn_std",
    "position_std",
    "velocity_std",
    "separation",
    "window",
)
"""Fields of a memory that are of intruders, ``[N, K]``."""


def rearrange(monitor: Monitor, places: Sequence[int], thresholds: Thresholds[L]) -> Monitor:
    """Return monitors ``[N]`` with other places of intruders: of each where it was before; -1: it
    is new, and nothing is remembered of it.
    """
    fresh = start(len(monitor.state), len(places), thresholds)
    present = [place for place, before in enumerate(places) if before >= 0]
    before = [places[place] for place in present]

    def move(field: Array, old: Array) -> Array:
        result = np.array(field)
        result[:, present] = old[:, before]
        return result

    memory = monitor.memory._replace(
        **{
            name: map_leaves(move, getattr(fresh.memory, name), getattr(monitor.memory, name))
            for name in _BY_PLACE
        }
    )
    return monitor._replace(
        memory=memory,
        expected=map_leaves(move, fresh.expected, monitor.expected),
        request_traffic=map_leaves(move, fresh.request_traffic, monitor.request_traffic),
    )
