"""What lies ahead: from what is known to a question, and what its answer changes.

The question is answered beside :func:`ros_bridge.mavlink.advance.advance`, by
:func:`ros_bridge.mavlink.judging.answer`, because a plan takes time.
"""

from dataclasses import replace

from ros_bridge.core.fields import SECOND, FieldError, attempt
from ros_bridge.mavlink import mission, telling
from ros_bridge.mavlink.control import Phase
from ros_bridge.mavlink.course import Course, course
from ros_bridge.mavlink.effects import NotePlanned
from ros_bridge.mavlink.events import Answer, Look
from ros_bridge.mavlink.intake import forget
from ros_bridge.mavlink.judging import SPACING, Question
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.state import Advance, Leg, Setup, State
from ros_bridge.mavlink.texts import tell

_SETTLES = 1.0  # s after AUTO was entered, within which the current item may yet change
_RECEIVER_AGAIN = 60.0  # s between two texts about a receiver


def look(state: State, event: Look, setup: Setup) -> Advance:
    """Forget what is silent, say what is to be said of the traffic, and ask what is to be done."""
    time = event.moment.time
    received = forget(state.received, time, setup.fresh.silence)
    state = replace(state, received=received, left_out=event.left_out, doubted=event.doubted)
    after = Advance(state)
    if event.problem:
        after = after.then(tell, "adsb", event.problem, time, send=True, again=_RECEIVER_AGAIN)
    after = after.then(telling.tell_left_out, time, foreign=event.foreign)
    return after.then(telling.tell_speed, event.moment, setup.deadline).then(_ask, time, setup)


def take_answer(state: State, event: Answer, setup: Setup) -> Advance:
    """Take over a judgement, and say what follows from it."""
    question, judgement = event.question, event.judgement
    before, time = question.judgement, question.time
    after = Advance(replace(state, judgement=judgement))
    if question.flown:
        after = after.then(telling.explain, time)
        if judgement.supervision.published_plan != before.supervision.published_plan:
            after = after.then(telling.write_plan)
    else:
        after = after.then(telling.advise, time, setup.rules.engage)
    if judgement.plan not in (None, before.plan):
        after = after.then(_note_planned, event)
    return after.then(telling.remark, time)


def _note_planned(state: State, event: Answer) -> Advance:
    """Keep, and log, what a plan took from its request."""
    text = f"planned within {1e3 * event.took.wall:.0f} ms"
    noted = Advance(state, (NotePlanned(event.took),))
    return noted.then(tell, "time", text, event.question.time, send=False)


def _ask(state: State, time: int, setup: Setup) -> Advance:
    """Ask whether what is flown, or the mission ahead, is clear; in other modes nothing."""
    state, ahead = _course(state, setup)
    if isinstance(ahead, FieldError):
        return _tell_unwatched(state, ahead, time).then(telling.remark, time)
    phase = state.control.phase
    flies_plan = phase in (Phase.TAKING, Phase.GUIDING)
    on_mission = phase is not Phase.RETURNING and state.received.mode == Mode.AUTO
    if not (flies_plan or on_mission):
        return telling.remark(state, time)
    question = Question(state.judgement, state.received.situation, ahead, time, flies_plan)
    return Advance(state, (question,))


def _tell_unwatched(state: State, problem: FieldError, time: int) -> Advance:
    """Say why the mission is not watched; what was judged before does not hold, unless a plan is
    flown.
    """
    after = tell(state, "mission", str(problem), time, send=False)
    if state.control.flies:
        return after
    unjudged = replace(state.judgement, conflict=None, plan=None, problem=str(problem))
    return after._replace(state=replace(after.state, judgement=unjudged))


def _course(state: State, setup: Setup) -> tuple[State, Course | FieldError]:
    """Return the mission from the current item on, its first leg from where it began, which is
    kept; while a plan is flown, from the item that it has left.
    """
    received, left_at = state.received, state.pilot.left_at
    current = received.current if left_at is None else left_at
    own = received.situation.own.last
    if own is None:
        problem = "is not watched: the own place has not been received"
        return state, FieldError("mission", problem)
    remaining = attempt(lambda: _items_left(state, current))
    if isinstance(remaining, FieldError):
        return state, remaining
    leg = state.leg
    if leg is None or leg.item != current:
        leg = _begin_leg(state, current, own.place, own.time / SECOND)
    ahead = attempt(
        lambda: course(
            state.items,
            current,
            remaining,
            leg.began,
            own,
            spacing=SPACING * setup.vehicle.aircraft.separation,
            radius=received.parameters.get("WP_LOITER_RAD", 0.0),
            offset=received.altitude_offset,
        )
    )
    return replace(state, leg=leg), ahead


def _items_left(state: State, current: int) -> tuple[Item, ...]:
    """Return the plain waypoints that are flown first, or raise :class:`FieldError`."""
    remaining, target = mission.remaining_items(state.items, current), state.received.target
    if state.control.flies or target is None:
        return remaining
    return mission.begin_at_target(remaining, state.items, *target)


def _begin_leg(state: State, item: int, own_place: tuple[float, float], time: float) -> Leg:
    """Return the leg to an item that has become the current one, by ArduPlane's rule
    (``Plane::set_next_WP``): it begins where the one before led to, by a jump too; where AUTO
    has just been entered it begins where the aircraft is.
    """
    if 0.0 <= time - state.entered_auto < _SETTLES:
        return Leg(item, own_place)
    came_from = _flown_to(state) or mission.item_before(state.items, item)
    return Leg(item, own_place if came_from is None else came_from.place)


def _flown_to(state: State) -> Item | None:
    """Return the item with a place that the leg before led to; None: there was none."""
    if state.leg is None:
        return None
    number = state.leg.item
    return next((item for item in state.items if item.number == number and item.has_place), None)
