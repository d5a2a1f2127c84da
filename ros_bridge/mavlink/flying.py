"""Who flies at a moment, and what the autopilot is told: the step of
:mod:`ros_bridge.mavlink.control` on what is known, and its orders.
"""

from dataclasses import replace

from agents.assurance.state import FlyMode
from ros_bridge.core.assurance import fly_mode
from ros_bridge.core.fields import SECOND
from ros_bridge.mavlink import pilot
from ros_bridge.mavlink.control import Control, Observation, Order, Phase, step
from ros_bridge.mavlink.effects import Log, SetMode
from ros_bridge.mavlink.judging import Judgement, local_plan
from ros_bridge.mavlink.pilot import Piloted
from ros_bridge.mavlink.refresh import hasten
from ros_bridge.mavlink.state import LATE, Advance, Setup, State
from ros_bridge.mavlink.texts import log_and_say, tell


def decide(state: State, time: int, setup: Setup, *, failsafe: bool) -> Advance:
    """Return what follows from a moment of the autopilot's, ns; ``failsafe``: whether its failsafe
    has just set AUTO.
    """
    before = state.control
    if before.phase is Phase.GUIDING:
        noted = pilot.note_target(state.pilot, state.received.target)
        state = replace(state, pilot=noted)
    observation = _observe(state, time, setup)._replace(failsafe=failsafe)
    stepped = step(before, observation, fly=state.fly)
    after = Advance(replace(state, control=stepped.control))
    if stepped.text:
        after = after.then(log_and_say, stepped.text, time)
    if stepped.control.phase is not before.phase:
        after = after.then(_change_phase, before.phase, time, setup)
    for order in stepped.orders:
        after = after.then(_obey, order, time, before, setup)
    if stepped.control.phase is Phase.GUIDING and not observation.fresh:
        text = "own state cannot be used, nothing commanded"
        after = after.then(tell, "stale", text, time, send=True)
    return after


def _observe(state: State, time: int, setup: Setup) -> Observation:
    """Return what the step is to know."""
    judgement, received, phase = state.judgement, state.received, state.control.phase
    track, rejoin, seconds = received.situation.own, judgement.rejoin, time / SECOND
    judges = seconds - state.pace.failing <= LATE  # else nobody watches what is flown
    watching = phase is Phase.WATCHING
    on_plan = fly_mode(judgement.supervision) is FlyMode.PLAN
    return Observation(
        time=seconds,
        mode=received.mode,
        armed=received.heartbeat is not None and received.heartbeat.armed,
        fresh=track.fault is None and track.age(time) <= setup.fresh.own,
        conflict=_may_conflict(judgement, setup.rules.engage),
        flyable=state.is_safe(time) if watching else local_plan(judgement) is not None and judges,
        rejoined=on_plan and rejoin is not None and time >= rejoin.time,
        diverted=phase is Phase.GUIDING and _is_diverted(state, seconds),
    )


def _is_diverted(state: State, seconds: float) -> bool:
    """Return whether somebody else has set another target in GUIDED."""
    received = state.received
    return pilot.is_diverted(state.pilot, received.target, received.target_altitude, seconds)


def _may_conflict(judgement: Judgement, engage: float) -> bool:
    """Return whether a conflict is near, or may be because nothing can be judged."""
    if judgement.conflict is None:
        return judgement.problem != ""
    return judgement.conflict.time <= engage


def _change_phase(state: State, previous: Phase, time: int, setup: Setup) -> Advance:
    """Log that another phase has begun, and forget what belongs to the one before."""
    control = state.control
    line = Log(f"{previous.value} -> {control.phase.value}", time)
    if not control.flies:
        released = pilot.release(state.pilot)
        state = replace(state, pilot=released, refresh=hasten(state.refresh))
    if control.phase is Phase.WATCHING:
        state = replace(
            state, received=replace(state.received, target=None, target_altitude=None)
        )  # it was ours
        state = state.without_plan(setup.rules)
    return Advance(state, (line,))


def _obey(state: State, order: Order, time: int, before: Control, setup: Setup) -> Advance:
    """Return what is sent for an order; ``before`` is the control that it follows from."""
    if order is Order.RESTORE:
        assert before.restore is not None  # it is what is ordered
        return Advance(state, (SetMode(before.restore),))
    after = _piloted(state, order, time, setup)
    return Advance(replace(state, pilot=after.pilot), after.effects)


def _piloted(state: State, order: Order, time: int, setup: Setup) -> Piloted:
    current, judgement, received = state.pilot, state.judgement, state.received
    if order is Order.TAKE_OVER:
        own = received.situation.own.last
        return pilot.take_over(
            current, judgement.supervision.published_plan, own, received.altitude_offset
        )
    if order is Order.STEER:
        return pilot.steer(current, judgement, received, setup.vehicle, time)
    return pilot.give_back(current, received.current, judgement.rejoin, state.items)
