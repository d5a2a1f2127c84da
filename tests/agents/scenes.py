"""Scenes of the tests of planner, monitor and resolvability: options of plans, a plan east with
reports, and encounters near the limits.
"""

import math
from typing import Any

import numpy as np

from agents import assurance
from agents.assurance.monitor import Cause, Decision, Monitor, State, Thresholds
from agents.kernel.traffic import Traffic
from agents.planner.request.options import Options
from agents.resolvability.classify import Replay
from agents.resolvability.proof import STEP, STRIDE
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.intruder import Intent
from envs.kinematics import SURROGATE, Limits, VehicleState
from envs.outcome import RULES
from envs.perception import Sensor
from envs.scenarios import scenario
from envs.waypoints import PlanStates
from tests.support import mirror_state

PATIENT = Options.for_aircraft(PAPER, deadline_s=math.inf)
"""Options of plans that no clock ends: a slow machine, or the first plan of a process, finds the
same.
"""

SPEED = 75.0
FAR = (0.0, 50_000.0)
THRESHOLDS = Thresholds.for_plans(PATIENT)
NAN = math.nan


def straight(time: float = 0.0, count: int = 1, y: float = 0.0) -> PlanStates:
    """Return a plan that was asked for at ``time`` on the way east, ``[count, 21]``."""
    seconds = np.broadcast_to(np.arange(21) * 20.0, (count, 21)).copy()
    zero = np.zeros_like(seconds)
    return PlanStates(SPEED * (seconds + time), zero + y, zero, zero + SPEED, seconds)


def on_plan(time: float, count: int = 1, left: float = 0.0, ahead: float = 0.0) -> VehicleState:
    zero = np.zeros(count)
    return VehicleState(zero + SPEED * time + ahead, zero + left, zero, zero + SPEED)


def intruder_at(
    x: float, y: float, heading: float = 0.0, speed: float = SPEED, count: int = 1
) -> VehicleState:
    """Return one intruder a row, ``[count, 1]``."""
    return VehicleState(*(np.full((count, 1), value) for value in (x, y, heading, speed)))


def flying(intruder: VehicleState | None = None, count: int = 1) -> Monitor:
    """Return monitors whose straight plan was made at 0 s with an intruder on a parallel course far
    away.
    """
    traffic_state = intruder_at(*FAR, count=count) if intruder is None else intruder
    monitor = assurance.start(count, 1, THRESHOLDS)
    return assurance.activate(
        monitor,
        np.arange(count),
        straight(count=count),
        np.ones(count, bool),
        0.0,
        Traffic.straight(traffic_state),
        THRESHOLDS,
    )


def far(time: float, count: int = 1) -> VehicleState:
    return intruder_at(FAR[0] + SPEED * time, FAR[1], count=count)


def tell(
    monitor: Monitor,
    time: float,
    own: VehicleState | None = None,
    intruders: VehicleState | None = None,
    **more: Any,
) -> tuple[Monitor, Decision]:
    """Step with a report of the ownship on its plan and of the far intruder, unless others are
    given.
    """
    count = monitor.state.size
    own = on_plan(time, count) if own is None else own
    intruders = far(time, count) if intruders is None else intruders
    return assurance.step(monitor, assurance.inputs(time, own, intruders, **more), THRESHOLDS)


def reply(
    monitor: Monitor, decision: Decision, *, safe: bool, plan_states: PlanStates | None = None
) -> tuple[Monitor, Any]:
    rows = np.flatnonzero(decision.replan)
    answer = (
        straight(float(monitor.memory.time[0]), rows.size) if plan_states is None else plan_states
    )
    return assurance.answer(
        monitor, rows, decision.number[rows], answer, np.full(rows.size, safe), THRESHOLDS
    )


def state_of(monitor: Monitor) -> State:
    return State(int(monitor.state[0]))


def causes_of(monitor: Monitor) -> Cause:
    return Cause(int(monitor.causes[0]))


# Encounters near the limits of what can be resolved, and an integration of witnesses that shares
# nothing with them.

CLOSE = scenario("circle", PAPER, radius=(1_000.0, 4_000.0), min_initial_separation=0.0)
"""Half of these starts are in trouble, a quarter beyond help."""
CROWDED = scenario(
    "multi", PAPER, intruders=(2, 4), radius=(1_500.0, 4_000.0), min_initial_separation=1_000.0
)
"""A fifth of these starts are beyond help, most of them because the ways past one intruder lead
into another.
"""
INTERVAL = STRIDE * STEP
"""Between test times, s."""


def duel(
    ahead: Any, course: Any = math.pi, speed: float = 75.0, intruder_speed: float = 75.0
) -> Encounter:
    """Return encounters ``[N]`` with an intruder some way straight ahead on a course; the goal lies
    at 15 km.
    """
    ahead, course = np.broadcast_arrays(np.atleast_1d(ahead).astype(float), course)
    zero, column = np.zeros(ahead.size), np.zeros((ahead.size, 1))
    return Encounter(
        VehicleState(zero, zero, zero, zero + speed),
        zero + 15_000.0,
        zero,
        VehicleState(ahead[:, None], column, course[:, None] + column, column + intruder_speed),
        column == 0.0,
        Intent(column, column, column + math.radians(3.0)),
        Sensor(column, column, column),
    )


def reflect(encounter: Encounter) -> Encounter:
    """Return the encounters reflected at the east axis."""
    return encounter._replace(
        own=mirror_state(encounter.own),
        goal_y=-encounter.goal_y,
        intruders=mirror_state(encounter.intruders),
        intent=encounter.intent._replace(heading_change=-encounter.intent.heading_change),
    )


def fine_positions(
    states: VehicleState, parts: int, limits: Limits | None
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate a flight anew from its first state alone, by the midpoint rule at 1 / ``parts`` s,
    ``[T parts, ...]``.

    The turn rate is read off the recorded headings; the acceleration off the speeds, held until a
    speed limit stops it."""
    x, y, heading, speed = (np.array(field[0], np.float64) for field in states)
    dt = 1.0 / parts
    xs, ys = [x], [y]
    for index in range(states.x.shape[0] - 1):
        rate = np.angle(np.exp(1j * (states.heading[index + 1] - states.heading[index])))
        gain = states.speed[index + 1] - states.speed[index]
        if limits is not None:
            at_limit = np.isin(states.speed[index + 1], (limits.speed_min, limits.speed_max)) & (
                np.abs(gain) > 1e-9
            )
            gain = np.where(at_limit, np.sign(gain) * limits.acceleration_max, gain)
        for _ in range(parts):
            middle = heading + 0.5 * dt * rate
            faster = speed + dt * gain
            faster = (
                faster if limits is None else np.clip(faster, limits.speed_min, limits.speed_max)
            )
            x = x + dt * 0.5 * (speed + faster) * np.cos(middle)
            y = y + dt * 0.5 * (speed + faster) * np.sin(middle)
            heading, speed = heading + dt * rate, faster
            xs.append(x)
            ys.append(y)
    return np.array(xs), np.array(ys)


def check_witness(encounter: Encounter, flown: Replay) -> None:
    """Assert that a replay is a success by an integration of its own, at 0.05 s, within the
    limits.
    """
    parts = 20
    x, y = fine_positions(flown.own, parts, SURROGATE)
    others_x, others_y = fine_positions(flown.intruders, parts, None)
    # The replay's own positions are those of its commands.
    np.testing.assert_allclose(x[::parts], flown.own.x, atol=0.05)
    np.testing.assert_allclose(y[::parts], flown.own.y, atol=0.05)
    np.testing.assert_allclose(others_x[::parts], flown.intruders.x, atol=0.05)

    required = RULES.separation if encounter.separation is None else encounter.separation
    spare = np.hypot(others_x - x[:, None], others_y - y[:, None]) - required
    assert spare[:, encounter.mask].min() >= -0.1
    assert math.hypot(x[-1] - encounter.goal_x, y[-1] - encounter.goal_y) <= RULES.goal_radius + 0.1
    assert flown.time[-1] <= RULES.t_max
    turns = np.angle(np.exp(1j * np.diff(flown.own.heading)))
    assert np.abs(turns).max() <= SURROGATE.yaw_rate_max * (1.0 + 1e-9)
    assert np.abs(np.diff(flown.own.speed)).max() <= SURROGATE.acceleration_max * (1.0 + 1e-9)
    assert flown.own.speed.min() >= SURROGATE.speed_min - 1e-9
    assert flown.own.speed.max() <= SURROGATE.speed_max + 1e-9
