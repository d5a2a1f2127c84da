"""The program as a pure function: what has happened changes a state, and asks for effects.

A turn of the program is these events, and the arrows are effects that one of them asks for:

    Listening                    our heartbeat
    Message, Restart, ...        what has come is taken in
    Tick ---Judge, where due---> Look ---Question---> Answer
                                   |                    |
                                   +-----> Judged <-----+   what is known is shown

Who flies is decided in one place, at the end of :func:`advance`: after a judgement, at a heartbeat
that says something else, and between two judgements wherever a new place has come. An error of our
own in Look, Question or Answer ends neither the program nor the decision: Judged tells of it.

:mod:`ros_bridge.mavlink.program` brings the events and carries the effects out.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ros_bridge.core.fields import SECOND
from ros_bridge.core.situation import Situation
from ros_bridge.mavlink import refresh
from ros_bridge.mavlink.changes import take_item
from ros_bridge.mavlink.clocks import Moment
from ros_bridge.mavlink.control import Phase, begin_anew
from ros_bridge.mavlink.effects import AskRates, Beat, Judge, Log, Show
from ros_bridge.mavlink.events import (
    Answer,
    Event,
    Judged,
    Listening,
    LiveReport,
    Look,
    Message,
    Restart,
    ShowingFailed,
    Tick,
)
from ros_bridge.mavlink.flying import decide
from ros_bridge.mavlink.intake import (
    UNREADABLE,
    Received,
    failsafe_acted,
    leave_out,
    take,
    take_traffic,
)
from ros_bridge.mavlink.looking import look, take_answer
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.pilot import Pilot
from ros_bridge.mavlink.state import LATE, Advance, Pace, Setup, State
from ros_bridge.mavlink.steering import PERIOD
from ros_bridge.mavlink.texts import say, tell
from ros_bridge.mavlink.vehicle import failsafe_timeout

BEAT = 0.5
"""Between two heartbeats of ours, s of our clock, beside an autopilot whose time is ours."""

DEAF = 5.0
"""Without a message of the autopilot, s of our clock: after it no heartbeat is sent, so that the
autopilot's failsafe acts also where it hears us and we do not hear it.
"""

_JUDGE = 0.25  # s between two judgements
_RATES_AGAIN = 5.0  # s after which the rates are asked for again where the own state is stale
_REPORTS_AGAIN = 60.0  # s between two texts about reports that cannot be read


def advance(state: State, event: Event, setup: Setup) -> Advance:
    """Return the state after an event, and what is to be done."""
    after = _EVENTS[type(event)](state, event, setup)
    time = _decides_at(state, after.state, event)
    if time is not None:
        patience = failsafe_timeout(state.received.parameters, setup.system) - BEAT
        failsafe = failsafe_acted(state.received, after.state.received, patience)
        after = after.then(decide, time, setup, failsafe=failsafe)
    return after.then(_show, event.moment.time) if isinstance(event, Judged) else after


def _decides_at(before: State, after: State, event: Event) -> int | None:
    """Return when who flies is to be decided anew, ns; None: it is not."""
    match event:
        case Judged(moment=moment):
            return moment.time
        case Message(time=time) if after.received.heartbeat != before.received.heartbeat:
            return time
        case Tick(moment=moment) if before.moved and not _is_due(before, moment.time):
            steered = moment.time / SECOND - before.pilot.steered_at
            return None if 0.0 <= steered < 0.9 * PERIOD else moment.time
        case _:
            return None


def _show(state: State, time: int) -> Advance:
    return Advance(state, (Show(state.view(time)),))


# What comes.


def _listen(state: State, event: Listening, setup: Setup) -> Advance:
    if event.silent > DEAF or event.ours - state.beat_at < setup.beat:
        return Advance(state)
    return Advance(replace(state, beat_at=event.ours), (Beat(),))


def _hear(state: State, event: Message, setup: Setup) -> Advance:
    message, time, before = event.message, event.time, state.received
    after = Advance(replace(state, received=take(before, message, time, setup.reading)))
    match message.get_type():
        case "HEARTBEAT":
            return after.then(_note_mode, before, time)
        case "GLOBAL_POSITION_INT":
            return after._replace(state=replace(after.state, moved=True))
        case "MISSION_CURRENT":
            return after.then(_note_current, before, time)
        case "PARAM_VALUE":
            return after.then(_note_parameter, message)
        case "MISSION_COUNT" | "MISSION_ITEM_INT":
            return after.then(take_item, message, time, setup.margin)
        case "MISSION_ACK":
            return after.then(_note_refusal, message)
        case _:
            return after


def _note_mode(state: State, before: Received, time: int) -> Advance:
    """Log a heartbeat that says something else, and note when AUTO was entered."""
    heartbeat = state.received.heartbeat
    if heartbeat is None or heartbeat == before.heartbeat:
        return Advance(state)
    if heartbeat.mode == Mode.AUTO != before.mode:
        state = replace(state, entered_auto=time / SECOND, leg=None)
    return Advance(state, (Log(f"mode {heartbeat.mode_name}", time),))


def _note_current(state: State, before: Received, time: int) -> Advance:
    """Note, in GUIDED, at which item it has left the mission, and say which one somebody else sets
    meanwhile: the autopilot itself sets none.
    """
    current, left_at = state.received.current, state.pilot.left_at
    if state.control.phase is not Phase.GUIDING:
        return Advance(state)
    if left_at is None:
        return Advance(replace(state, pilot=replace(state.pilot, left_at=current)))
    if current in (before.current, left_at):
        return Advance(state)
    event = f"item {current} set by others"
    return tell(state, event, f"{event}: AUTO goes on there", time, send=True)


def _note_parameter(state: State, message: Any) -> Advance:
    """End flying where the autopilot's own avoidance is switched on."""
    if not (message.param_id == "AVD_ENABLE" and message.param_value and state.fly):
        return Advance(state)
    text = "AVD_ENABLE was set: the autopilot's own avoidance is on"
    line = Log(f"{text}; nothing is taken over any more")
    return Advance(replace(state, fly=False), (line, say("off, AVD_ENABLE is set")))


def _note_refusal(state: State, message: Any) -> Advance:
    """Give up a download whose items are not there any more."""
    if not message.type:
        return Advance(state)
    return Advance(replace(state, refresh=refresh.drop(state.refresh, message.mission_type)))


def _take_report(state: State, event: LiveReport, setup: Setup) -> Advance:
    """Take in the traffic of a receiver beside the autopilot's own."""
    report, time, received = event.report, event.time, state.received
    if report.sighting is None:
        left_out = replace(state, received=leave_out(received, UNREADABLE))
        text = f"{report}"
        return tell(left_out, "adsb message", text, time, send=True, again=_REPORTS_AGAIN)
    name = report.sighting.identifier
    received = take_traffic(received, name, report, time, setup.reading)
    return Advance(replace(state, received=received))


def _begin_anew(state: State, event: Restart, setup: Setup) -> Advance:
    """Forget what hangs on the autopilot's clock: what was received and planned, and when it
    was.
    """
    text = "the autopilot has begun anew: all that was received is forgotten"
    announced = tell(state, "begun", text, event.time, send=True)
    state, before = announced.state.without_plan(setup.rules), state.received
    state = replace(
        state,
        received=Received(
            Situation(fixed_areas=before.situation.fixed_areas),
            parameters=before.parameters,
            left_out=before.left_out,
        ),
        control=begin_anew(state.control, event.time / SECOND),
        pilot=Pilot(),
        pace=Pace(spent=state.pace.spent),
        leg=None,
        moved=False,
        entered_auto=-math.inf,
        refresh=refresh.hasten(state.refresh),
    )
    return Advance(state, (*announced.effects, AskRates()))


def _tell_failure(state: State, event: ShowingFailed, _: Setup) -> Advance:
    return tell(state, event.text, event.text, event.time, send=True)


# The time.


def _go_on(state: State, event: Tick, setup: Setup) -> Advance:
    """Ask for what is due: messages, mission and fence, a judgement."""
    moment = event.moment
    after = _ask_rates(state, moment, setup)
    questions = refresh.ask(after.state.refresh, moment.time / SECOND)
    state = replace(after.state, refresh=questions.refresh, moved=False)
    after = Advance(state, (*after.effects, *questions.effects))
    return after.then(_begin_judgement, moment) if _is_due(state, moment.time) else after


def _ask_rates(state: State, moment: Moment, setup: Setup) -> Advance:
    if moment.spent.wall - state.rates_at <= _RATES_AGAIN:
        return Advance(state)
    stale = state.received.situation.own.age(moment.time) > setup.fresh.own
    # It was lost, or the autopilot has begun anew.
    return Advance(replace(state, rates_at=moment.spent.wall), (AskRates(),) if stale else ())


def _is_due(state: State, time: int) -> bool:
    """Return whether a judgement is due at a time, ns."""
    return time != 0 and not 0.0 <= time / SECOND - state.pace.judged < _JUDGE


def _begin_judgement(state: State, moment: Moment) -> Advance:
    seconds, last_judged = moment.time / SECOND, state.pace.judged
    after = _keep_pace(state, seconds - last_judged, moment) if last_judged else Advance(state)
    pace = replace(after.state.pace, judged=seconds)
    return Advance(replace(after.state, pace=pace), (*after.effects, Judge(moment)))


def _end_judgement(state: State, event: Judged, _: Setup) -> Advance:
    if event.failure:
        after = _promise_nothing(state, event)
    else:
        after = Advance(replace(state, pace=replace(state.pace, failing=math.inf)))
    return after.then(_keep_pace, (event.moment.time - event.began) / SECOND, event.moment)


def _promise_nothing(state: State, event: Judged) -> Advance:
    """Say that the judgement failed, and call nothing safe; where that lasts nothing is flown any
    more (:func:`ros_bridge.mavlink.flying.decide`).
    """
    text, seconds, judgement = event.failure, event.began / SECOND, state.judgement
    failing = min(state.pace.failing, seconds)
    state = replace(
        state,
        pace=replace(state.pace, late=seconds, failing=failing),
        judgement=replace(
            judgement,
            supervision=replace(judgement.supervision, assessment=None),
            plan=None,
            problem=text,
        ),
    )
    return tell(state, "failed", f"{text}, separation not assured", event.began, send=True)


def _keep_pace(state: State, since: float, moment: Moment) -> Advance:
    """Note, and say, where so many seconds have passed unseen; what is flown goes on, but is no
    longer promised.
    """
    before, spent = state.pace.spent, moment.spent
    pace = replace(state.pace, spent=spent)
    if since <= LATE:
        return Advance(replace(state, pace=pace))
    pace = replace(pace, late=moment.time / SECOND)
    text = f"late by {since:.1f} s, separation not assured"
    if moment.races:
        text += f" at {moment.speed:.1f} times real time"
    wall, computed = spent.wall - before.wall, spent.computed - before.computed
    more = f"{computed:.2f} s of processor time in {wall:.2f} s"
    return tell(replace(state, pace=pace), "late", text, moment.time, send=True, more=more)


_EVENTS: dict[type[Event], Callable[[State, Any, Setup], Advance]] = {
    Listening: _listen,
    Message: _hear,
    Restart: _begin_anew,
    LiveReport: _take_report,
    Tick: _go_on,
    Look: look,
    Answer: take_answer,
    Judged: _end_judgement,
    ShowingFailed: _tell_failure,
}
"""Where each kind of event goes."""
