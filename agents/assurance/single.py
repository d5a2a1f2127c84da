"""The run-time monitor of one aircraft: ``agents.assurance`` with N = 1, by names and sentences.

Intruders go by name and have the same place as long as they exist. One that is not reported any
more is missing, which is a reason; it is forgotten only where the caller says that it is gone.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from agents.assurance import monitor as monitors
from agents.assurance.inputs import Inputs
from agents.assurance.state import Decision, Flown, Monitor, State, start
from agents.assurance.thresholds import OUTSIDE, SAYS, Cause, Thresholds
from agents.planner.answer import Plan
from agents.planner.request import Intruder, reported
from agents.planner.traffic import advanced
from envs.kinematics import VehicleState
from envs.trees import mapped, take
from envs.waypoints import Knots, Waypoint, knots

_ONE = np.array([0])
_MISSING, _NOWHERE = VehicleState(*[float("nan")] * 4), VehicleState(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Why:
    """One reason."""

    cause: Cause
    field: str
    message: str


@dataclass(frozen=True, slots=True)
class Ask:
    """A request for a plan, to be given to :func:`agents.planner.plan` and back to
    :func:`answer`.
    """

    number: int
    own: VehicleState
    intruders: tuple[Intruder, ...]


@dataclass(frozen=True, slots=True)
class Verdict:
    """The monitor's decision for one second."""

    state: State
    fly: Flown
    ask: Ask | None
    """The plan that is wanted now; None: none."""
    reasons: tuple[Why, ...]
    backup: tuple[Waypoint, ...]
    """The backup at hand, its times from when it was refreshed; none before the first own state."""
    measured: Decision
    """The numbers, ``[1]``."""

    @property
    def outside(self) -> list[str]:
        """What is outside the operating domain, a sentence each."""
        return [why.message for why in self.reasons if why.cause & OUTSIDE]


@dataclass(frozen=True)
class Watch:
    """A monitor of one aircraft, never changed in place."""

    monitor: Monitor
    names: tuple[str, ...]  # of the intruders, by place
    thresholds: Thresholds
    ask: Ask | None = None  # the last request


def begin(thresholds: Thresholds) -> Watch:
    """Return a monitor that watches nothing."""
    return Watch(start(1, 0, thresholds), (), thresholds)


def activate(
    watch: Watch, plan: Plan, own: VehicleState, intruders: Mapping[str, Intruder], time: float
) -> Watch:
    """Begin to watch a plan, with states and time, s, of its request; of one that is not SAFE the
    backup is flown.
    """
    watch = _placed(watch, (*watch.names, *(name for name in intruders if name not in watch.names)))
    given, age = reported([intruders.get(name, Intruder(_NOWHERE)) for name in watch.names])
    traffic = advanced(
        given._replace(mask=np.array([[name in intruders for name in watch.names]], dtype=bool)),
        age,
    )
    knots, thresholds = _knots(own, plan, watch.thresholds), watch.thresholds
    safe = np.array([plan.safe])
    return replace(
        watch,
        monitor=monitors.activate(watch.monitor, _ONE, knots, safe, time, traffic, thresholds),
    )


def step(
    watch: Watch,
    time: float,
    own: VehicleState | None,
    intruders: Mapping[str, Intruder],
    *,
    own_age: float = 0.0,
    gone: Sequence[str] = (),
) -> tuple[Watch, Verdict]:
    """Judge one second, s, by the last reports; ``own`` is None where it is missing, ``gone`` do
    not count any more.
    """
    names = (
        *(name for name in watch.names if name not in gone),
        *(n for n in intruders if n not in watch.names),
    )
    watch = _placed(watch, names)
    seen, age = reported([intruders.get(name, Intruder(_MISSING)) for name in names])
    here = VehicleState(*(np.array([value], dtype=float) for value in (own or _MISSING)))
    now, late = np.array([time], dtype=float), np.array([own_age], dtype=float)
    given = Inputs(
        now,
        here,
        late,
        seen.state,
        age,
        seen.mask,
        seen.position_std,
        seen.velocity_std,
        seen.separation,
    )
    monitor, decision = monitors.step(watch.monitor, given, watch.thresholds)
    asked = _ask(monitor, decision, watch.thresholds) if decision.replan[0] else None
    backup = _waypoints(monitor) if np.isfinite(monitor.backup.started[0]) else ()
    watch = replace(watch, monitor=monitor, ask=asked or watch.ask)
    fly, state = Flown(int(decision.fly[0])), State(int(decision.state[0]))
    return watch, Verdict(state, fly, asked, reasons(decision, watch.thresholds), backup, decision)


def answer(watch: Watch, number: int, plan: Plan) -> tuple[Watch, bool]:
    """Hand in what the planner answered to a request; return also whether the plan is flown now."""
    if watch.ask is None or number != watch.ask.number:
        return watch, False
    given = _knots(watch.ask.own, plan, watch.thresholds)
    safe = np.array([plan.safe])
    monitor, taken_up = monitors.answer(
        watch.monitor, _ONE, np.array([number]), given, safe, watch.thresholds
    )
    return replace(watch, monitor=monitor), bool(taken_up[0])


def _placed(watch: Watch, names: tuple[str, ...]) -> Watch:
    """Return the monitor with places for these intruders; one that had a place keeps its memory."""
    if names == watch.names:
        return watch
    old, new = watch.monitor, start(1, len(names), watch.thresholds)
    into = [place for place, name in enumerate(names) if name in watch.names]
    of = [watch.names.index(names[place]) for place in into]

    def moved(fresh: np.ndarray, had: np.ndarray) -> np.ndarray:
        result = np.array(fresh)
        result[:, into] = had[:, of]
        return result

    given = {
        name: mapped(moved, getattr(new.memory, name), getattr(old.memory, name))
        for name in (
            "intruders",
            "seen",
            "turn_rate",
            "position_std",
            "velocity_std",
            "separation",
            "drift",
        )
    }
    rest = {
        name: mapped(moved, getattr(new, name), getattr(old, name))
        for name in ("expected", "request_traffic")
    }
    return replace(
        watch, monitor=old._replace(memory=old.memory._replace(**given), **rest), names=names
    )


def _ask(monitor: Monitor, decision: Decision, thresholds: Thresholds) -> Ask:
    """Return the request of one second: the last good reports with their ages, as the planner takes
    them.
    """
    memory, own = monitor.memory, VehicleState(*(float(field[0]) for field in decision.own))
    turns = memory.turn_rate, np.where(memory.turn_rate == 0.0, 0.0, thresholds.turn_time)
    fields = (
        *memory.intruders,
        memory.time - memory.seen,
        *turns,
        memory.position_std,
        memory.velocity_std,
        memory.separation,
    )
    rows = np.stack(fields, axis=-1)[decision.traffic.mask].tolist()
    known = tuple(
        Intruder(
            VehicleState(*state), *rest, separation=None if math.isnan(separation) else separation
        )
        for *both, separation in rows
        for state, rest in [(both[:4], both[4:])]
    )
    return Ask(int(decision.number[0]), own, known)


def reasons(decision: Decision, thresholds: Thresholds) -> tuple[Why, ...]:
    """Return the causes of one second in words."""
    now = take(decision, 0)
    return tuple(
        Why(cause, field, f"{field} {says.format(now=now, **vars(thresholds))}")
        for cause, (field, says) in SAYS.items()
        if int(decision.causes[0]) & int(cause)
    )


def _knots(own: VehicleState, plan: Plan, thresholds: Thresholds) -> Knots:
    """Return a plan's knots, ``[1, W + 1]``; nan where it has no trajectory, or not as many
    waypoints as expected.
    """
    count = thresholds.options.waypoints
    if len(plan.waypoints) != count:
        return Knots(*(np.full((1, count + 1), np.nan) for _ in range(5)))
    return Knots(*(field[None] for field in knots(own, plan.waypoints)))


def _waypoints(monitor: Monitor) -> tuple[Waypoint, ...]:
    rows = np.stack([field[0] for field in monitor.backup.knots], axis=-1)[1:].tolist()
    return tuple(Waypoint(index, *row) for index, row in enumerate(rows))
