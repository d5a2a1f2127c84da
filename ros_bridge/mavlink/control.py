"""Who flies: a state machine of pure functions.

    WATCHING --conflict and a safe plan--> TAKING --GUIDED seen--> GUIDING --rejoined--> RETURNING
        ^                                                                                    |
        +---------------------------------- AUTO seen ---------------------------------------+

A mode that somebody else has set, or a target in GUIDED, ends all of it at once (YIELDED): nothing
is commanded any more, not even the way back to AUTO. It watches again where AUTO flies and no
conflict has been there for a while, so that it never takes over again from an operator who decided
otherwise.

AUTO that the autopilot's failsafe has set, because the link was cut, nobody has decided: it is the
mission again, and watched at once. Nor has anybody decided where the autopilot has not answered a
request, which the link may have lost: it watches again after a while.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

from ros_bridge.mavlink.messages import Mode, mode_name

ANSWER = 3.0
"""Within which the autopilot must have changed its mode, s."""

AGAIN = 0.5
"""Between two requests to change the mode, s."""

CLEAR = 10.0
"""For how long there must be no conflict before it may take over again after it has yielded, s."""

CROSSING = 5.0
"""For how long after it has yielded a request of ours may still arrive, whose mode is undone, s."""


class Phase(Enum):
    """Of taking over and giving back."""

    WATCHING = "watching"
    TAKING = "taking over"
    GUIDING = "guiding"
    RETURNING = "handing back"
    YIELDED = "yielded"


class Order(Enum):
    """What is to be sent."""

    TAKE_OVER = "take over"  # GUIDED with the end of the plan as its target
    STEER = "steer"  # roll and airspeed of the plan
    GIVE_BACK = "give back"  # AUTO at the item after the rejoin waypoint
    RESTORE = "restore"  # the operator's mode that a request of ours crossed


class Observation(NamedTuple):
    """What is known at a moment."""

    time: float  # s
    mode: int  # of the autopilot, by its last heartbeat
    armed: bool
    fresh: bool  # whether link and own state are
    conflict: bool  # whether the mission loses the separation
    flyable: bool  # whether there is something safe to fly, or a backup
    rejoined: bool  # whether the plan has reached its rejoin waypoint
    diverted: bool = False  # whether somebody else has set another target in GUIDED
    failsafe: bool = False  # whether the mode is AUTO because the failsafe has just set it


@dataclass(frozen=True)
class Control:
    """The state; never changed in place."""

    phase: Phase = Phase.WATCHING
    since: float = 0.0  # when the phase began, s
    request_time: float = 0.0  # when the last request to change the mode went out, s
    conflict_at: float = 0.0  # when there was a conflict last, s
    restore: int | None = None  # the operator's mode that a request of ours may yet overwrite
    unanswered: bool = False  # whether it has yielded only because a request had no answer

    @property
    def flies(self) -> bool:
        """Whether the autopilot does, or is about to do, what is sent."""
        return self.phase in (Phase.TAKING, Phase.GUIDING, Phase.RETURNING)


class Step(NamedTuple):
    """The state after a moment, what is to be sent, and what is to be said; "": nothing."""

    control: Control
    orders: tuple[Order, ...] = ()
    text: str = ""


def begin_anew(control: Control, time: float) -> Control:
    """Return the state where the autopilot, and with it the clock, has begun anew at a time, s:
    nothing is flown, and who has yielded to somebody still has.
    """
    if control.phase is not Phase.YIELDED or control.unanswered:
        return Control()
    return Control(Phase.YIELDED, since=time, conflict_at=time)


def step(control: Control, observation: Observation, *, fly: bool) -> Step:
    """Return what follows from a moment; with ``fly`` false nothing is taken over or steered, and
    what is flown is handed back.
    """
    if observation.conflict:
        control = replace(control, conflict_at=observation.time)
    if not fly:
        return _end(control, observation)
    if observation.failsafe and control.phase is not Phase.WATCHING:
        text = "AUTO set by the failsafe, watching again"
        return Step(_enter(control, Phase.WATCHING, observation), (), text)
    return _STEPS[control.phase](control, observation)


def _end(control: Control, observation: Observation) -> Step:
    if control.phase is Phase.WATCHING:
        return Step(control)
    if control.phase is Phase.TAKING and observation.mode == Mode.AUTO:
        return _yield(control, observation, "off", crossed=True)
    if control.phase in (Phase.TAKING, Phase.GUIDING) and observation.mode == Mode.GUIDED:
        back = _enter(control, Phase.RETURNING, observation, asks=True)
        return Step(back, (Order.GIVE_BACK,), "off: back to AUTO")
    return _STEPS[control.phase](control, observation)


def _watch(control: Control, observation: Observation) -> Step:
    engages = observation.conflict and observation.flyable and observation.fresh
    if not (engages and observation.armed and observation.mode == Mode.AUTO):
        return Step(control)
    return Step(_enter(control, Phase.TAKING, observation, asks=True), (Order.TAKE_OVER,))


def _take(control: Control, observation: Observation) -> Step:
    if observation.mode == Mode.GUIDED:
        return Step(_enter(control, Phase.GUIDING, observation), (), "guiding round the conflict")
    if observation.mode != Mode.AUTO:
        return _yield(control, observation, crossed=True)
    if observation.time - control.since > ANSWER:
        reason = "the autopilot has not changed to GUIDED"
        yielded = _yield(control, observation, reason, crossed=True)
        return yielded._replace(control=replace(yielded.control, unanswered=True))
    return _ask_again(control, observation, Order.TAKE_OVER)


def _guide(control: Control, observation: Observation) -> Step:
    if observation.mode != Mode.GUIDED:
        return _yield(control, observation)
    if observation.diverted:
        return _yield(control, observation, "target set by others, commanding ends")
    if observation.rejoined or not observation.flyable:
        back = _enter(control, Phase.RETURNING, observation, asks=True)
        reason = "clear" if observation.rejoined else "there is no plan to fly"
        return Step(back, (Order.GIVE_BACK,), f"{reason}: back to AUTO")
    return Step(control, (Order.STEER,) if observation.fresh else ())


def _return(control: Control, observation: Observation) -> Step:
    if observation.mode == Mode.AUTO:
        return Step(_enter(control, Phase.WATCHING, observation))
    if observation.mode != Mode.GUIDED:
        return _yield(control, observation, crossed=True)
    return _ask_again(control, observation, Order.GIVE_BACK)


def _stay_yielded(control: Control, observation: Observation) -> Step:
    if control.restore is not None and observation.mode != control.restore:
        crossing = observation.time - control.since <= CROSSING
        ours = observation.mode in (Mode.GUIDED, Mode.AUTO)
        if crossing and ours:
            return Step(replace(control, restore=None), (Order.RESTORE,))
        control = replace(control, restore=None)
    waited = control.unanswered and observation.time - control.since > CROSSING
    if observation.mode == Mode.AUTO and (waited or observation.time - control.conflict_at > CLEAR):
        return Step(_enter(control, Phase.WATCHING, observation), (), "watching again")
    return Step(control)


def _yield(
    control: Control, observation: Observation, reason: str = "", *, crossed: bool = False
) -> Step:
    text = reason or f"{mode_name(observation.mode)} set by others, commanding ends"
    restore = observation.mode if crossed else None
    return Step(replace(_enter(control, Phase.YIELDED, observation), restore=restore), (), text)


def _ask_again(control: Control, observation: Observation, order: Order) -> Step:
    if observation.time - control.request_time < AGAIN:
        return Step(control)
    return Step(replace(control, request_time=observation.time), (order,))


def _enter(
    control: Control, phase: Phase, observation: Observation, *, asks: bool = False
) -> Control:
    request_time = observation.time if asks else control.request_time
    return Control(phase, observation.time, request_time, control.conflict_at)


_STEPS = {
    Phase.WATCHING: _watch,
    Phase.TAKING: _take,
    Phase.GUIDING: _guide,
    Phase.RETURNING: _return,
    Phase.YIELDED: _stay_yielded,
}
