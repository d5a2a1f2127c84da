"""The MAVLink program as a pure function: whatever comes, in whatever order.

A made-up autopilot obeys, or does not; somebody else sets modes, items, targets and parameters; the
clock jumps and begins anew; judgements and the display fail.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from pymavlink.dialects.v20 import ardupilotmega as dialect

from envs.formats.local_frame import LocalFrame
from ros_bridge.core.aircraft import load_policy
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import Unknown
from ros_bridge.core.situation import Situation
from ros_bridge.mavlink.advance import _EVENTS, DEAF, advance
from ros_bridge.mavlink.clocks import Moment, Spent
from ros_bridge.mavlink.control import Phase
from ros_bridge.mavlink.course import Course
from ros_bridge.mavlink.effects import (
    Beat,
    Effect,
    Judge,
    Reposition,
    Say,
    SetCurrent,
    SetMode,
    Show,
    Steer,
)
from ros_bridge.mavlink.events import (
    Answer,
    Event,
    Judged,
    Listening,
    Look,
    Message,
    Restart,
    ShowingFailed,
    Tick,
)
from ros_bridge.mavlink.intake import Reading, Received, take
from ros_bridge.mavlink.judging import Judgement, Question, answer, rules
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.mission import Item, altitude_of, remaining_items, route
from ros_bridge.mavlink.refresh import Refresh, ask
from ros_bridge.mavlink.state import LATE, Advance, Setup, State
from ros_bridge.mavlink.vehicle import vehicle_of
from tests.ros_bridge.test_mavlink import PARAMETERS

HOME = LocalFrame(47.4, 8.5)
BEGAN, SPEED = 100.0, 22.0  # s and m/s: where the ownship is at home, and how fast it flies east
PLACES = ((0, -500.0), (1, 0.0), (2, 5_000.0), (3, 9_000.0))  # numbers of items, and m east
ITEMS = tuple(
    Item(number, 16, float(at.latitude), float(at.longitude), 100.0)
    for number, at in ((number, HOME.geodetic(x, 0.0)) for number, x in PLACES)
)
ORDERS = (Reposition, Steer, SetMode, SetCurrent)
FAILURE = "judgement failed: ValueError: of the test"


def position(seconds: float) -> Any:
    at = HOME.geodetic(SPEED * (seconds - BEGAN), 0.0)
    place = round(1e7 * float(at.latitude)), round(1e7 * float(at.longitude))
    boot = round(1e3 * seconds)
    return dialect.MAVLink_global_position_int_message(
        boot, *place, 600_000, 100_000, 0, round(100 * SPEED), 0, 9_000
    )


def heartbeat(mode: int) -> Any:
    return dialect.MAVLink_heartbeat_message(1, 3, 0x80, mode, 4, 3)


def crossing() -> Any:
    """Return the report of an aircraft that crosses the mission after 30 s."""
    at = HOME.geodetic(SPEED * 30.0, -20.0 * 30.0)
    place = round(1e7 * float(at.latitude)), round(1e7 * float(at.longitude))
    return dialect.MAVLink_adsb_vehicle_message(
        0xABC123, *place, 1, 600_000, 0, 2_000, 0, b"ABC", 1, 0, 0x8F, 0
    )


class World(NamedTuple):
    """What stays the same, and a judgement with a conflict and a safe plan."""

    setup: Setup
    danger: Judgement

    def begin(self, *, fly: bool) -> State:
        received = Received(Situation(), parameters=PARAMETERS)
        clear = Judgement(self.setup.rules.begin())
        return State(clear, items=ITEMS, fly=fly, received=received)


@pytest.fixture(scope="module")
def world() -> World:
    vehicle = vehicle_of(PARAMETERS, 200.0)
    followed = rules(
        vehicle.aircraft,
        load_policy("").for_aircraft(vehicle.aircraft),
        margin=25.0,
        vertical=600.0,
        unknown=Unknown(5.0, 0.2, 1.0, 0.2),
        deadline=20.0,
    )
    setup = Setup(followed, vehicle, Reading({1: "msl"}), 245, 0.5, 25.0, 20.0)
    received, time = Received(), round(BEGAN * SECOND)
    for message in (heartbeat(Mode.AUTO), position(BEGAN), crossing()):
        received = take(received, message, time, setup.reading)
    ahead = route(ITEMS[1].place, remaining_items(ITEMS, 2), 800.0)
    fresh, course = Judgement(followed.begin()), Course(ahead, (ahead,))
    danger = answer(Question(fresh, received.situation, course, time, flown=False), followed)
    assert danger.safe and danger.conflict is not None
    return World(setup, danger)


class Turn(NamedTuple):
    """A turn of the program: what happens, and what somebody else does."""

    passed: float = 0.1  # s since the turn before
    heard: bool = True  # whether the autopilot's position and heartbeat come
    obeys: bool = True  # whether the autopilot does what it is told
    mode: int | None = None  # that somebody else sets
    other: Any = None  # another message
    danger: bool = True  # whether a conflict is judged
    fails: bool = False  # whether the judgement fails
    restarts: bool = False  # whether the autopilot begins anew
    blind: bool = False  # whether the display fails


USUAL = Turn()
CLEAR = Turn(danger=False)
LAST_ITEM = dialect.MAVLink_mission_current_message(3)
ELSEWHERE = dialect.MAVLink_position_target_global_int_message(
    0, 5, 0, 474_900_000, 85_900_000, 600.0, 0, 0, 0, 0, 0, 0, 0, 0
)
AVOIDANCE = dialect.MAVLink_param_value_message(b"AVD_ENABLE", 1.0, 9, 1, 0)
AVOIDANCE.param_id = "AVD_ENABLE"  # as it is when it has been received


@st.composite
def odd_turns(draw: st.DrawFn) -> Turn:
    """Draw a turn in which something happens."""
    return Turn(
        passed=draw(st.sampled_from((0.1, 0.3, 2.0, 70.0))),
        heard=draw(st.booleans()),
        obeys=draw(st.booleans()),
        mode=draw(st.sampled_from((None, Mode.AUTO, Mode.AUTO, Mode.GUIDED, Mode.LOITER))),
        other=draw(st.sampled_from((None, None, LAST_ITEM, ELSEWHERE, AVOIDANCE))),
        danger=draw(st.booleans()),
        fails=draw(st.booleans()),
        restarts=draw(st.sampled_from((False, False, False, True))),
        blind=draw(st.booleans()),
    )


@st.composite
def flights(draw: st.DrawFn) -> list[Turn]:
    """Draw some turns, most of them usual, so that a plan is taken up and flown now and then."""
    turns: list[Turn] = []
    for _ in range(draw(st.integers(1, 5))):
        turns += [USUAL] * draw(st.integers(0, 6))
        turns.append(draw(odd_turns()))
    return turns + [USUAL] * draw(st.integers(0, 6))


class Step(NamedTuple):
    """An event, with the state before it and what followed."""

    state: State
    event: Event
    after: Advance


@dataclass
class Flight:
    """Drives :func:`advance` as the program does, with answers that are given."""

    world: World
    state: State
    steps: list[Step] = field(default_factory=list)
    clock: float = BEGAN
    mode: int = Mode.AUTO
    obeys: bool = True

    def take(self, event: Event, turn: Turn = USUAL) -> None:
        after = advance(self.state, event, self.world.setup)
        self.steps.append(Step(self.state, event, after))
        self.state = after.state
        for effect in after.effects:
            self.carry_out(effect, turn)

    def carry_out(self, effect: Effect, turn: Turn) -> None:
        match effect:
            case Judge(moment):
                self.take(Look(moment), turn)
                self.take(Judged(moment.time, moment, FAILURE if turn.fails else ""), turn)
            case Question(judgement=before) if not turn.fails:
                danger, number = self.world.danger, before.supervision.revision + 1
                supervision = replace(danger.supervision, revision=number)
                clear = Judgement(self.world.setup.rules.begin())
                answer = replace(danger, supervision=supervision) if turn.danger else clear
                self.take(Answer(effect, answer, Spent(0.1, 0.1)), turn)
            case Show() if turn.blind:
                self.take(ShowingFailed("display failed", round(self.clock * SECOND)))
            case Reposition() if turn.obeys:
                self.mode = Mode.GUIDED
            case SetMode(mode) if turn.obeys:
                self.mode = mode
            case _:
                pass

    def turn(self, turn: Turn) -> None:
        self.clock = 5.0 if turn.restarts else self.clock + turn.passed
        self.mode = self.mode if turn.mode is None else turn.mode
        time = round(self.clock * SECOND)
        self.take(Listening(self.clock, 0.0 if turn.heard else DEAF + 1.0), turn)
        if turn.restarts:
            self.take(Restart(time), turn)
        messages = [turn.other] if turn.other is not None else []
        if turn.heard:
            messages += [position(self.clock), heartbeat(self.mode)]
        for message in messages:
            self.take(Message(message, time), turn)
        self.take(Tick(Moment(time, Spent(self.clock, self.clock))), turn)

    def orders(self) -> list[Effect]:
        """Return what the autopilot was told to do."""
        return [effect for step in self.steps for effect in _orders(step)]


def _orders(step: Step) -> Iterator[Effect]:
    yield from (effect for effect in step.after.effects if isinstance(effect, ORDERS))


def fly(world: World, turns: Sequence[Turn], *, allowed: bool = True) -> Flight:
    flight = Flight(world, world.begin(fly=allowed))
    for turn in turns:
        flight.turn(turn)
    return flight


def test_every_event_is_taken_in() -> None:
    assert set(_EVENTS) == set(get_args(Event))


def test_a_conflict_is_flown_and_the_mission_given_back(world: World) -> None:
    """The way of the made-up autopilot itself: without it the properties would say nothing."""
    flight = fly(world, [USUAL] * 20 + [USUAL._replace(passed=80.0)] + [CLEAR] * 20)
    kinds = [type(effect) for effect in flight.orders()]
    assert kinds[0] is Reposition
    assert kinds.count(Steer) > 10
    assert kinds[-2:] == [SetCurrent, SetMode]
    assert flight.state.control.phase is Phase.WATCHING
    assert any(isinstance(effect, Show) for step in flight.steps for effect in step.after.effects)


@settings(deadline=None, max_examples=15)
@given(turns=flights())
def test_the_same_events_have_the_same_effects(world: World, turns: list[Turn]) -> None:
    """Also where other events have been taken in meanwhile: no state is changed in place."""
    for step in fly(world, turns).steps:
        again = advance(step.state, step.event, world.setup)
        assert _brief(again) == _brief(step.after)
        assert again.state.control == step.after.state.control


def _brief(after: Advance) -> list[str]:
    """Return the effects as texts, those that hold all that is known by their names alone."""
    return [
        type(effect).__name__ if isinstance(effect, Question | Show) else repr(effect)
        for effect in after.effects
    ]


@settings(deadline=None, max_examples=60)
@given(turns=flights())
def test_nothing_is_ordered_but_in_the_modes_that_are_ours(world: World, turns: list[Turn]) -> None:
    for step in fly(world, turns).steps:
        before, after = step.state.control, step.after.state
        phase, mode = after.control.phase, after.received.mode
        for order in _orders(step):
            match order:
                case Reposition():
                    assert (phase, mode) == (Phase.TAKING, Mode.AUTO)
                    assert after.fly and after.pace.keeps_up(_time(step.event))
                case Steer():
                    assert (phase, mode) == (Phase.GUIDING, Mode.GUIDED)
                    assert after.fly
                case SetCurrent() | SetMode(Mode.AUTO) if phase is Phase.RETURNING:
                    assert mode == Mode.GUIDED
                case SetMode(restored):  # the operator's, that a request of ours has crossed
                    assert phase is Phase.YIELDED and restored == before.restore
                case _:
                    pytest.fail(f"{order} in {phase}")


@settings(deadline=None, max_examples=15)
@given(turns=flights())
def test_without_leave_to_fly_nothing_is_ordered(world: World, turns: list[Turn]) -> None:
    assert fly(world, turns, allowed=False).orders() == []


@settings(deadline=None, max_examples=15)
@given(turns=flights())
def test_a_display_that_fails_changes_nothing_that_is_flown(
    world: World, turns: list[Turn]
) -> None:
    blind = fly(world, [turn._replace(blind=True) for turn in turns])
    clear = fly(world, [turn._replace(blind=False) for turn in turns])
    assert repr(blind.orders()) == repr(clear.orders())
    assert blind.state.control == clear.state.control


@pytest.mark.parametrize("failing", [1, 4, 25])
def test_where_judgements_fail_it_steers_for_a_moment_and_then_gives_back(
    world: World, failing: int
) -> None:
    flight = fly(world, [USUAL] * 10)
    assert flight.state.control.phase is Phase.GUIDING
    for _ in range(failing):
        flight.turn(USUAL._replace(fails=True))
    lasted = flight.clock - flight.state.pace.failing
    assert (flight.state.control.phase is not Phase.GUIDING) == (lasted > LATE)
    expected = f"RLCAS: {FAILURE}, separation not assured"
    texts = [e.text for step in flight.steps for e in step.after.effects if isinstance(e, Say)]
    assert (expected in texts) == (lasted >= 0.0)
    assert lasted < 0.0 or not flight.state.pace.keeps_up(round(flight.clock * SECOND))


@pytest.mark.parametrize("heard", [True, False])
def test_no_heartbeat_is_sent_to_an_autopilot_that_is_not_heard(world: World, heard: bool) -> None:
    steps = fly(world, [USUAL._replace(heard=heard)] * 10).steps
    beats = [step for step in steps if Beat() in step.after.effects]
    assert bool(beats) == heard


def _time(event: Event) -> int:
    """Return when who flies is decided after an event, ns."""
    if isinstance(event, Tick | Judged):
        return event.moment.time
    assert isinstance(event, Message)
    return event.time


def test_where_home_moves_altitudes_are_above_the_new_one(world: World) -> None:
    before, moved = ITEMS[0], ITEMS[0]._replace(altitude=112.0)
    for fly in (False, True):
        state = replace(world.begin(fly=fly), refresh=ask(Refresh(), 10.0).refresh)
        for message in (
            dialect.MAVLink_mission_count_message(245, 191, len(ITEMS), 0),
            *(
                dialect.MAVLink_mission_item_int_message(
                    *(245, 191, item.number, item.frame, item.command, 0, 1),
                    *(item.parameter, item.second, item.third, 0.0),
                    *(round(1e7 * item.latitude), round(1e7 * item.longitude), item.altitude, 0),
                )
                for item in (moved, *ITEMS[1:])
            ),
        ):
            state = advance(state, Message(message, 10 * SECOND), world.setup).state
        assert before.altitude != state.items[0].altitude == 112.0
        last = altitude_of(state.items[-1], state.items)
        assert last is not None and last.value == 212.0
