"""Scenes of the monitor's tests: a straight plan east at 75 m/s, and reports about it."""

import math
from typing import Any

import numpy as np

from agents.assurance import monitor as assurance
from agents.assurance.monitor import Cause, Decision, Monitor, State, Thresholds
from agents.planner.options import Options
from agents.planner.traffic import Traffic
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from envs.waypoints import Knots

SPEED = 75.0
FAR = (0.0, 50_000.0)
THRESHOLDS = Thresholds.for_plans(Options.for_aircraft(PAPER))
NAN = math.nan


def straight(time: float = 0.0, count: int = 1, y: float = 0.0) -> Knots:
    """Return a plan that was asked for at ``time`` on the way east, ``[count, 21]``."""
    seconds = np.broadcast_to(np.arange(21) * 20.0, (count, 21)).copy()
    zero = np.zeros_like(seconds)
    return Knots(SPEED * (seconds + time), zero + y, zero, zero + SPEED, seconds)


def on_plan(time: float, count: int = 1, left: float = 0.0, ahead: float = 0.0) -> VehicleState:
    zero = np.zeros(count)
    return VehicleState(zero + SPEED * time + ahead, zero + left, zero, zero + SPEED)


def other(x: float, y: float, heading: float = 0.0, speed: float = SPEED, count: int = 1) -> VehicleState:
    """Return one intruder a row, ``[count, 1]``."""
    return VehicleState(*(np.full((count, 1), value) for value in (x, y, heading, speed)))


def flying(intruder: VehicleState | None = None, count: int = 1) -> Monitor:
    """Return monitors whose straight plan was made at 0 s with an intruder on a parallel course far away."""
    seen = other(*FAR, count=count) if intruder is None else intruder
    monitor = assurance.start(count, 1, THRESHOLDS)
    return assurance.activate(
        monitor, np.arange(count), straight(count=count), np.ones(count, bool), 0.0, Traffic.straight(seen), THRESHOLDS
    )


def far(time: float, count: int = 1) -> VehicleState:
    return other(FAR[0] + SPEED * time, FAR[1], count=count)


def tell(
    monitor: Monitor, time: float, own: VehicleState | None = None, seen: VehicleState | None = None, **more: Any
) -> tuple[Monitor, Decision]:
    """Step with a report of the ownship on its plan and of the far intruder, unless others are given."""
    count = monitor.state.size
    own = on_plan(time, count) if own is None else own
    seen = far(time, count) if seen is None else seen
    return assurance.step(monitor, assurance.inputs(time, own, seen, **more), THRESHOLDS)


def reply(monitor: Monitor, decision: Decision, *, safe: bool, knots: Knots | None = None) -> tuple[Monitor, Any]:
    rows = np.flatnonzero(decision.replan)
    given = straight(float(monitor.memory.time[0]), rows.size) if knots is None else knots
    return assurance.answer(monitor, rows, decision.number[rows], given, np.full(rows.size, safe), THRESHOLDS)


def state_of(monitor: Monitor) -> State:
    return State(int(monitor.state[0]))


def causes_of(monitor: Monitor) -> Cause:
    return Cause(int(monitor.causes[0]))
