"""Watches an autopilot's mission for traffic, plans round it, and advises or flies.

    python -m ros_bridge.mavlink --connect udp:0.0.0.0:14550 --separation 610 [--fly]

Reads state, mission, fence, parameters and ADS-B traffic from ArduPlane over MAVLink, with --adsb
traffic from another receiver too, and watches and plans as the ROS nodes do, by the same core. By
default it advises: STATUSTEXT to the ground station, and with --plan-file the plan as a map. With
--fly it changes from AUTO to GUIDED while a conflict lasts, flies the plan in place and time, and
gives AUTO back where the plan rejoins the mission. A mode, or a target in GUIDED, that anybody else
sets ends that at once; it takes over again only after AUTO has flown 10 s without a conflict. An
item of the mission that anybody else sets meanwhile is where AUTO goes on.

It stops commanding where the autopilot's state is older than 1.5 s. What the autopilot does where
this program or the link dies: docs/howto/mavlink.md.
"""

import argparse
import math
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Cause
from commands.command import InputError, run_cli
from commands.files import write_file
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.adsb_live import OWN_TRACES
from ros_bridge.core.assurance import to_fly
from ros_bridge.core.failures import Failures
from ros_bridge.core.fields import SECOND, FieldError, readable
from ros_bridge.core.planning import rehearse
from ros_bridge.core.situation import Situation
from ros_bridge.mavlink import messages, mission
from ros_bridge.mavlink.control import Control, Order, Phase, Seen, begin_anew, step
from ros_bridge.mavlink.course import Course, course
from ros_bridge.mavlink.intake import (
    UNREADABLE,
    Reading,
    Received,
    failsafe_acted,
    forget,
    leave_out,
    take,
    take_traffic,
)
from ros_bridge.mavlink.judging import SPACING, Judgement, Rules, supervise, to_follow, watch
from ros_bridge.mavlink.link import FENCE, RACING, Link
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.options import options_of, rules_of
from ros_bridge.mavlink.pilot import Pilot
from ros_bridge.mavlink.plan_file import geojson, kml
from ros_bridge.mavlink.refresh import Refresh
from ros_bridge.mavlink.steering import PERIOD
from ros_bridge.mavlink.texts import Texts
from ros_bridge.mavlink.vehicle import (
    Vehicle,
    check_flyable,
    failsafe_notes,
    failsafe_timeout,
    own_address,
    vehicle_of,
)
from ros_bridge.mavlink.view import View
from ros_bridge.transport.adsb_receiver import LiveReports

DEAF = 5.0
"""Without a message of the autopilot, s of our clock: after it no heartbeat is sent, so that the
autopilot's failsafe acts also where it hears us and we do not hear it.
"""

LATE = 1.5
"""Between two judgements, which are due every quarter of a second, s of the autopilot's clock: more
means that the program does not keep up, and for :data:`RECOVERED` no plan is called safe.
"""

RECOVERED = 5.0
"""For how long it must have kept up after it has been late, s."""

_REPORT = 60.0  # s between two lines about the processor, and about a receiver
_JUDGE = 0.25  # s between two judgements
_BEAT = 0.5  # s between our heartbeats
_SETTLES = 1.0  # s after AUTO was entered, within which the current item may yet change
_RATES_AGAIN = 5.0  # s after which the rates are asked for again where the own state is stale


def main(arguments: Sequence[str] | None = None) -> int:
    """Watch until Ctrl-C, or for --seconds, and return the exit code."""
    options = options_of(arguments)
    link = Link(
        options.connect, baud=options.baud, system=options.system, simulated=options.simulated
    )
    with ExitStack() as open_ones:
        open_ones.callback(link.close)
        program = Program(link, options)
        open_ones.callback(program.close)
        program.show()
        program.run()
    return 0


class Spent(NamedTuple):
    """Time that has passed, and what of it this process has computed, s."""

    wall: float
    computed: float


@dataclass
class _Last:
    """When something was done last, s, on the clock that is named."""

    beat: float = 0.0  # our heartbeat; ours
    rates: float = 0.0  # the autopilot was asked for its messages; ours
    judgement: float = 0.0  # the autopilot's, as below
    late: float = -math.inf  # it did not keep up
    failing: float = math.inf  # the judgement began to fail; infinite: it does not


class _Leg(NamedTuple):
    """The leg that is flown."""

    item: int  # that it leads to
    began: tuple[float, float]  # latitude and longitude, degrees


class _Autopilot(NamedTuple):
    """What an autopilot answers before anything is judged."""

    parameters: dict[str, float]
    vehicle: Vehicle
    corners: tuple[Item, ...]  # of its fence
    mission: tuple[Item, ...]


def _question(link: Link, options: argparse.Namespace) -> _Autopilot:
    """Return an autopilot's answers; InputError: it is not there, or cannot be flown beside."""
    link.find(options.wait)
    parameters = link.parameters()
    if options.fly:
        check_flyable(parameters)
    vehicle = vehicle_of(parameters, options.separation)
    return _Autopilot(parameters, vehicle, link.fence(), link.mission())


class Program:
    """The program between messages: what is known, judged and flown.

    Attributes:
        pilot: what the autopilot is told while it is flown.
        planned: what the last plans took from their request.
        viewers: called after each judgement, in the program's own thread: they must not wait.
    """

    def __init__(self, link: Link, options: argparse.Namespace) -> None:
        self._link, self._options, self._fly = link, options, bool(options.fly)
        self._texts = Texts(link, None if options.quiet else sys.stdout)
        self.planned: deque[Spent] = deque(maxlen=20_000)
        self.viewers: list[Callable[[View], object]] = []
        self._protecting = Failures(self._texts.log)
        self._showing = Failures(lambda text: self._texts.tell(text, text, self._now(), send=True))
        self._open = ExitStack()
        self._last = _Last()
        self._causes: set[Cause] = set()
        self._remarked: set[str] = set()
        self._placed_fence: tuple[GeodeticArea, ...] = ()
        self._told: set[str] = set()  # what is told once
        self._refresh = Refresh(link)
        self._leg: _Leg | None = None
        self._entered_auto = -math.inf  # when AUTO was entered last, s
        self._moved = False  # whether a new place has come
        self._begun = 0  # how often the autopilot's clock has begun
        self._live: LiveReports | None = None

        found = _question(link, options)
        fence = _areas(found.corners, options.margin)
        self._vehicle, self._corners, self._items = found.vehicle, found.corners, found.mission
        self._rules = rules_of(options, self._vehicle)
        self._fresh = self._rules.settings.freshness
        self.pilot = Pilot(link, self._texts, self._vehicle)
        above_sea = options.traffic_altitude == "msl"
        self._reading = Reading({0: "msl", 1: "msl"} if above_sea else {})
        self._received = Received(Situation(fixed_areas=fence), parameters=found.parameters)
        self._judgement = Judgement(self._rules.begin())
        self._control = Control()
        self._spent = _clocks()
        self._introduce(found, len(fence))
        rehearse(self._rules.policy, self._rules.settings.options)
        if options.adsb:
            self._live = self._listen(options.adsb, options.own or own_address(found.parameters))
        link.ask_rates()
        self._last.rates = time.monotonic()

    def _introduce(self, found: _Autopilot, areas: int) -> None:
        """Log what the autopilot has answered, and what follows from it."""
        link, log = self._link, self._texts.log
        log(f"autopilot {link.system}/{link.component}, mission of {len(self._items)} items")
        log(f"fence of {areas} areas")
        log(what_is_kept(self._rules))
        for note in found.vehicle.notes:
            log(note)
        if self._fly:
            for note in failsafe_notes(found.parameters, self._options.system):
                log(f"warning: {note}")

    def show(self) -> None:
        """Serve the display, and write the recording, that the options ask for, until the program
        is closed.
        """
        address, file = self._options.display, self._options.record
        if file is not None:
            from ros_bridge.mavlink.adapter import BackgroundRecorder, SceneAdapter

            recording = self._open.enter_context(BackgroundRecorder(file, self._texts.log))
            self.viewers.append(SceneAdapter(self._rules, recording.feed))
        if address is None:
            return
        from ros_bridge.mavlink.adapter import show

        name = f"MAVLink {self._options.connect}"
        showing, beside = show(address, name, self._rules, self._now, self._texts.log)
        self.viewers.append(showing)
        self._open.enter_context(beside)
        print(f"display: http://{address.rpartition(':')[0]}:{beside.port}/", flush=True)

    def close(self) -> None:
        """End the connection, the display and the recording."""
        self._open.close()
        self._link.close()

    def _listen(self, source: str, own: str) -> LiveReports:
        """Return a receiver beside the autopilot's own, to which is listened."""
        left_out = f"without {own}, the ownship" if own else "the ownship's address is unknown"
        self._texts.log(f"traffic of {source} too, {left_out}")
        live = LiveReports(source, own, self._now)
        live.start()
        self._open.callback(live.stop)
        return live

    @property
    def rules(self) -> Rules:
        """How it is watched and planned."""
        return self._rules

    @property
    def view(self) -> View:
        """What is known now."""
        left_out, doubted = Counter(self._received.left_out), Counter[str]()
        if self._live is not None:
            left_out += self._live.traffic.counts
            doubted += self._live.traffic.doubted
        known = (self._received, self._judgement, self._control, self._items)
        return View(self._now(), *known, left_out, doubted)

    def _now(self) -> int:
        """Return the autopilot's time, ns; called from threads of others too."""
        return self._link.clock.now(time.monotonic())

    # The loop.

    def run(self) -> None:
        """Receive, judge and steer, until the end."""
        began = reported = _clocks()
        while (
            self._options.seconds is None or time.monotonic() - began.wall < self._options.seconds
        ):
            self.turn()
            spent = _clocks()
            if spent.wall - reported.wall > _REPORT:
                self._texts.log(self._load(reported, spent))
                for line in self._count_left_out():
                    self._texts.log(line)
                reported = spent
        self._texts.log(self._load(began, _clocks()))

    def _load(self, before: Spent, after: Spent) -> str:
        share = (after.computed - before.computed) / max(after.wall - before.wall, 1e-9)
        return f"{100.0 * share:.1f} % of a core, {len(self._received.situation.traffic)} aircraft"

    def _count_left_out(self) -> Iterator[str]:
        """Yield what of the traffic was left out so far, and what was not although a field forbids
        it, a line each.
        """
        view = self.view
        for what, counts in (("left out", view.left_out), ("doubted", view.doubted)):
            if counts:
                reasons = (f"{count} {reason}" for reason, count in sorted(counts.items()))
                yield f"reports of traffic {what}: {', '.join(reasons)}"

    def turn(self, seconds: float = 0.02) -> None:
        """Receive for so long, and do what is due."""
        ours = time.monotonic()
        hears = ours - self._link.heard <= DEAF
        if hears and ours - self._last.beat >= (0.05 if self._options.simulated else _BEAT):
            self._last.beat = ours
            self._link.beat()
        for message, now in self._link.receive(ours + seconds):
            self._follow_clock(now)
            self._take(message, now)
        if self._live is not None:
            self._take_live(self._live)
        now = self._now()
        if ours - self._last.rates > _RATES_AGAIN:
            self._last.rates = ours
            if self._received.situation.own.age(now) > self._fresh.own:
                self._link.ask_rates()  # it was lost, or the autopilot has begun anew
        self._refresh.ask(now / SECOND)
        since = now / SECOND - self._last.judgement
        if now and not 0.0 <= since < _JUDGE:
            if self._last.judgement:
                self._keep_pace(since, now)
            self._last.judgement = now / SECOND
            self._judge(now)
        elif self._moved and not 0.0 <= now / SECOND - self.pilot.steered_at < 0.9 * PERIOD:
            self._control_step(now)
        self._moved = False

    def _follow_clock(self, now: int) -> None:
        """Forget what hangs on the autopilot's clock where that has begun anew: what was received
        and planned, and when it was.
        """
        times, self._begun = self._begun, self._link.clock.begun
        if times in (0, self._begun):
            return
        text = "the autopilot has begun anew: all that was received is forgotten"
        self._texts.tell("begun", text, now, send=True)
        before = self._received
        self._received = Received(
            Situation(fixed_areas=before.situation.fixed_areas),
            parameters=before.parameters,
            left_out=before.left_out,
        )
        self._judgement = self._without_plan()
        self._control = begin_anew(self._control, now / SECOND)
        self.pilot = Pilot(self._link, self._texts, self._vehicle)
        self._last.judgement, self._last.late, self._last.failing = 0.0, -math.inf, math.inf
        self._leg, self._moved, self._entered_auto = None, False, -math.inf
        self._refresh.hasten()
        self._link.ask_rates()

    def _without_plan(self) -> Judgement:
        """Return a judgement without a plan, whose next one gets another revision."""
        revision = self._judgement.revision
        return Judgement(replace(self._rules.begin(), revision=revision), revision=revision)

    def _take(self, message: Any, now: int) -> None:
        kind = message.get_type()
        before = self._received
        self._received = take(before, message, now, self._reading)
        if kind == "PARAM_VALUE" and message.param_id == "AVD_ENABLE" and message.param_value:
            self._refuse("AVD_ENABLE was set: the autopilot's own avoidance is on")
        if kind == "MISSION_CURRENT" and self._control.phase is Phase.GUIDING:
            self.pilot.note_current(before.current, self._received.current, now)
        if kind == "HEARTBEAT" and before.heartbeat != self._received.heartbeat:
            assert self._received.heartbeat is not None
            self._texts.log(f"mode {self._received.heartbeat.mode_name}", now)
            if self._received.heartbeat.mode == messages.Mode.AUTO != before.mode:
                self._entered_auto, self._leg = now / SECOND, None
            patience = failsafe_timeout(before.parameters, self._options.system) - _BEAT
            self._control_step(now, failsafe=failsafe_acted(before, self._received, patience))
        self._moved = self._moved or kind == "GLOBAL_POSITION_INT"
        if kind in ("MISSION_COUNT", "MISSION_ITEM_INT"):
            self._accept(message, now)
        if kind == "MISSION_ACK" and message.type:
            self._refresh.drop(message.mission_type)

    def _take_live(self, live: LiveReports) -> None:
        """Take in the traffic of a receiver beside the autopilot's own."""
        live.traffic.own = self._received.situation.own.last
        for found, now in live.take():
            seen = found.sighting
            if seen is None:
                self._received = leave_out(self._received, UNREADABLE)
                self._texts.tell("adsb message", f"{found}", now, send=True, again=_REPORT)
            else:
                name = seen.identifier
                self._received = take_traffic(self._received, name, found, now, self._reading)

    def _refuse(self, why: str) -> None:
        if self._fly:
            self._fly = False
            self._texts.log(f"{why}; nothing is taken over any more")
            self._texts.send("off, AVD_ENABLE is set")

    def _tell_speed(self, now: int) -> None:
        """Say, once, that a simulation runs too fast for what is promised."""
        speed, deadline = self._link.clock.speed, self._options.deadline
        if self._link.clock.races and "speed" not in self._told:
            self._told.add("speed")
            text = (
                f"warning: the simulation runs {speed:.1f} times as fast as real time, and so "
                f"{deadline:g} s of computing take {speed * deadline:.1f} s of its time; expected "
                f"{RACING:g} times at most"
            )
            self._texts.log(text, now)

    def _keep_pace(self, since: float, now: int) -> None:
        """Note, and say, where so many seconds have passed unseen; what is flown goes on, but is
        no longer promised.
        """
        before, self._spent = self._spent, _clocks()
        if since <= LATE:
            return
        self._last.late = now / SECOND
        text = f"late by {since:.1f} s, separation not assured"
        if self._link.clock.races:
            text += f" at {self._link.clock.speed:.1f} times real time"
        wall, computed = self._spent.wall - before.wall, self._spent.computed - before.computed
        more = f"{computed:.2f} s of processor time in {wall:.2f} s"
        self._texts.tell("late", text, now, send=True, more=more)

    # Judging.

    def _judge(self, now: int) -> None:
        """Judge what lies ahead, steer and show; an error of our own in one ends no other."""
        if self._protecting.attempt("judgement", partial(self._look_ahead, now)):
            self._last.failing = math.inf
        else:
            self._promise_nothing(now)
        done = self._now()
        self._keep_pace((done - now) / SECOND, done)
        self._control_step(done)
        for viewer in self.viewers:
            self._showing.attempt("display", partial(self._show_to, viewer))

    def _show_to(self, viewer: Callable[[View], object]) -> None:
        viewer(self.view)

    def _promise_nothing(self, now: int) -> None:
        """Say that the judgement failed, and call nothing safe; where that lasts nothing is flown
        any more (:meth:`_make_seen`).
        """
        [*_, text] = self._protecting.problems()
        self._last.late = now / SECOND
        self._last.failing = min(self._last.failing, now / SECOND)
        self._judgement = replace(self._judgement, plan=None, verdict=None, problem=text)
        self._texts.tell("failed", f"{text}, separation not assured", now, send=True)

    def _look_ahead(self, now: int) -> None:
        self._received = forget(self._received, now, self._fresh.silence)
        problem = "" if self._live is None else self._live.take_problem()
        if problem:
            self._texts.tell("adsb", problem, now, send=True, again=_REPORT)
        self._tell_left_out(now)
        self._tell_speed(now)
        phase = self._control.phase
        try:
            ahead = self._course()
        except FieldError as error:
            ahead = None
            self._texts.tell("mission", f"{error}", now, send=False)
            if not self._control.flies:  # what was judged before does not hold
                unjudged = replace(self._judgement, conflict=None, plan=None, problem=f"{error}")
                self._judgement = unjudged
        before, began = self._judgement, _clocks()
        situation = self._received.situation
        if ahead is not None and phase in (Phase.TAKING, Phase.GUIDING):
            self._judgement = supervise(before, situation, ahead.route, now, self._rules)
            self._explain(now)
            if self._judgement.revision != before.revision:
                self._write_plan()
        elif (
            ahead is not None and phase is not Phase.RETURNING and self._mode == messages.Mode.AUTO
        ):
            self._judgement = watch(
                before,
                situation,
                ahead.route,
                now,
                self._rules,
                ways=ahead.ways,
                unplanned=ahead.unplanned,
            )
            self._advise(now)
        if self._judgement.plan not in (None, before.plan):
            self._tell_time(began, now)
        self._remark(now)

    def _tell_left_out(self, now: int) -> None:
        """Say, once for each reason, that something is not taken as traffic, or is although a field
        forbids it; and that somebody else sends under the autopilot's numbers.
        """
        view = self.view
        told = [f"left out of traffic: {why}" for why in view.left_out if why not in OWN_TRACES]
        told += [f"traffic: {why}" for why in view.doubted]
        if self._link.foreign:
            told.append("another sender has the autopilot's numbers, and is not listened to")
        for text in told:
            if text not in self._told:
                self._told.add(text)
                self._texts.tell(text, text, now, send=True)

    # Missions and fences that change.

    def _accept(self, message: Any, now: int) -> None:
        """Take in an item; what cannot be read leaves what is there."""
        try:
            whole = self._refresh.take(message)
            if whole is not None and whole.kind == FENCE:
                self._change_fence(whole.items, now)
            elif whole is not None:
                self._change_mission(whole.items, now)
        except (FieldError, InputError) as problem:
            self._texts.tell("download", f"{problem}", now, send=True)

    def _change_mission(self, items: tuple[Item, ...], now: int) -> None:
        """Take over another mission; while a plan is flown, only note that there is one."""
        if items[1:] == self._items[1:]:  # the first is home
            return
        if not self._control.flies:
            self._items, self._leg = items, None
            self._texts.log(f"the mission has changed: {len(items)} items", now)
        elif not self.pilot.replaced:
            self.pilot.replaced = True
            self._texts.tell("mission", "mission changed by others: AUTO flies it", now, send=True)

    def _change_fence(self, corners: tuple[Item, ...], now: int) -> None:
        if corners != self._corners:
            fence = _areas(corners, self._options.margin)
            self._corners = corners
            situation = replace(self._received.situation, fixed_areas=fence)
            self._received = replace(self._received, situation=situation)
            self._texts.tell("fence", f"fence has changed: {len(fence)} areas", now, send=True)

    @property
    def _mode(self) -> int:
        return self._received.mode

    def _course(self) -> Course:
        """Return the mission from the current item on, its first leg from where it began; while a
        plan is flown, from the item that it has left.
        """
        left_at = self.pilot.left_at
        current = self._received.current if left_at is None else left_at
        own = self._received.situation.own.last
        if own is None:
            raise FieldError("mission", "is not watched: the own place has not been received")
        left = mission.remaining_items(self._items, current)
        if not self._control.flies and self._received.target is not None:
            left = mission.begin_at_target(left, self._items, *self._received.target)
        if self._leg is None or self._leg.item != current:
            self._leg = self._begin_leg(current, own.place, own.time / SECOND)
        return course(
            self._items,
            current,
            left,
            self._leg.began,
            own,
            spacing=SPACING * self._vehicle.aircraft.separation,
            radius=self._received.parameters.get("WP_LOITER_RAD", 0.0),
        )

    def _begin_leg(self, item: int, here: tuple[float, float], now: float) -> _Leg:
        """Return the leg to an item that has become the current one, by ArduPlane's rule
        (``Plane::set_next_WP``): it begins where the one before led to, by a jump too; where AUTO
        has just been entered it begins where the aircraft is.
        """
        before, entered = self._leg, self._entered_auto
        if 0.0 <= now - entered < _SETTLES:
            return _Leg(item, here)
        flown = (
            None
            if before is None
            else next(
                (one for one in self._items if one.number == before.item and one.has_place), None
            )
        )
        came_from = flown or mission.before(self._items, item)
        return _Leg(item, here if came_from is None else came_from.place)

    def _tell_time(self, began: Spent, now: int) -> None:
        """Log what it took from the request, at a time, to the plan."""
        done = _clocks()
        took = Spent(done.wall - began.wall, done.computed - began.computed)
        self.planned.append(took)
        self._texts.tell("time", f"planned within {1e3 * took.wall:.0f} ms", now, send=False)

    def _explain(self, now: int) -> None:
        """Log why the monitor is not content, where that changes."""
        verdict = self._judgement.verdict
        reasons = () if verdict is None else verdict.reasons
        causes = {why.cause for why in reasons}
        if causes != self._causes:
            self._causes = causes
            state = "" if verdict is None else verdict.state.name
            why = "; ".join(one.message for one in reasons) or "no remark"
            self._texts.log(f"{state}: {why}", now)
        problem = self._judgement.problem
        if problem:
            self._texts.tell(
                f"replan {'' if verdict is None else verdict.state.name}",
                f"no plan: {problem}",
                now,
                send=False,
            )

    def _remark(self, now: int) -> None:
        """Log what is assumed, such as an accuracy that nobody sends: each once."""
        for remark in self._judgement.remarks:
            if remark not in self._remarked:
                self._remarked.add(remark)
                self._texts.log(remark, now)
        self._remark_fence(now)

    def _remark_fence(self, now: int) -> None:
        """Tell what of another fence lies too far away to count, or was clipped or thinned."""
        situation = self._received.situation
        fence, own = situation.fixed_areas, situation.own.last
        if own is None or fence == self._placed_fence:
            return
        self._placed_fence = fence
        placed = readable(lambda: situation.fixed_in(LocalFrame(own.latitude, own.longitude), now))
        if placed is None:  # plans are refused, and say why
            return
        for change in placed.changes:
            self._texts.log(f"warning: {change}", now)
        if placed.far:
            text = "fence: areas far away do not count"
            self._texts.tell("fence far", text, now, send=True, more=placed.far)

    def _advise(self, now: int) -> None:
        problem = self._judgement.problem
        found, answer = self._judgement.conflict, self._judgement.plan
        if found is None or found.time > self._rules.engage:
            if problem:
                self._texts.tell("problem", problem, now, send=True)
            return
        safe = self._safe(now)
        kind = f"conflict {found.name} {safe}"
        text = f"{found.name} in {found.time:.0f} s: "
        if answer is None:
            self._texts.tell(kind, f"{text}no plan, {problem}", now, send=True)
            return
        if not safe:
            reasons = "; ".join(reason.message for reason in answer.reasons)
            more = reasons or "the program has been late"
            self._texts.tell(kind, f"{text}no plan is safe", now, send=True, more=more)
            return
        first = answer.waypoints[0]
        turn = f"{math.degrees(0.5 * math.pi - first.heading) % 360.0:.0f} deg"
        text += f"plan by {turn}, {first.speed:.0f} m/s"
        if self._texts.tell(kind, text, now, send=True, more=f"rejoins {answer.goal_index}"):
            self._write_plan()

    def _write_plan(self) -> None:
        """Write what is flown or advised; a full disk stops nothing."""
        file, held = self._options.plan_file, self._judgement.supervision.held
        if file is None or held is None:
            return
        try:
            write_file(file, (kml if file.suffix == ".kml" else geojson)(held))
        except OSError as error:
            self._texts.log(f"{file}: cannot be written: {error}")

    # Flying.

    def _control_step(self, now: int, *, failsafe: bool = False) -> None:
        seen = self._make_seen(now)._replace(failsafe=failsafe)
        before, was = self._control, self._control.phase
        done = step(self._control, seen, fly=self._fly)
        self._control = done.control
        if done.text:
            self._texts.log(done.text, now)
            self._texts.send(done.text)
        if was is not self._control.phase:
            self._texts.log(f"{was.value} -> {self._control.phase.value}", now)
            if not self._control.flies:
                self.pilot.release()
                self._refresh.hasten()
            if self._control.phase is Phase.WATCHING:
                self._received = replace(self._received, target=None)  # it was ours
                self._judgement = self._without_plan()
        for order in done.orders:
            self._obey(order, now, before)
        if self._control.phase is Phase.GUIDING and not seen.fresh:
            self._texts.tell("stale", "own state cannot be used, nothing commanded", now, send=True)

    def _make_seen(self, now: int) -> Seen:
        judged, received = self._judgement, self._received
        track = received.situation.own
        fresh = track.fault is None and track.age(now) <= self._fresh.own
        rejoin = judged.rejoin
        on_plan = to_fly(judged.supervision) is FlyMode.PLAN
        watching = self._control.phase is Phase.WATCHING
        guiding = self._control.phase is Phase.GUIDING
        judges = now / SECOND - self._last.failing <= LATE  # else nobody watches what is flown
        return Seen(
            time=now / SECOND,
            mode=self._mode,
            armed=received.heartbeat is not None and received.heartbeat.armed,
            fresh=fresh,
            conflict=_may_conflict(judged, self._rules.engage),
            flyable=self._safe(now) if watching else to_follow(judged) is not None and judges,
            rejoined=on_plan and rejoin is not None and now >= rejoin.time,
            diverted=guiding and self.pilot.is_diverted(received.target),
        )

    def _safe(self, now: int) -> bool:
        """Return whether there is a plan that may be called safe."""
        return self._judgement.safe and self.keeps_up(now)

    def keeps_up(self, now: int) -> bool:
        """Return whether it has not been late for :data:`RECOVERED` at a time, ns."""
        return not 0.0 <= now / SECOND - self._last.late <= RECOVERED

    def _obey(self, order: Order, now: int, before: Control) -> None:
        judged, received = self._judgement, self._received
        if order is Order.TAKE_OVER:
            self.pilot.take_over(judged.supervision.held, received.situation.own.last)
        elif order is Order.STEER:
            self.pilot.steer(judged, received, now)
        elif order is Order.GIVE_BACK:
            self.pilot.give_back(received.current, judged.rejoin, self._items)
        elif before.restore is not None:
            self._link.set_mode(before.restore)


def _may_conflict(judged: Judgement, engage: float) -> bool:
    """Return whether a conflict is near, or may be because nothing can be judged."""
    if judged.conflict is None:
        return judged.problem != ""
    return judged.conflict.time <= engage


def what_is_kept(rules: Rules) -> str:
    """Return a line on the distance that is kept from traffic that says nothing of its accuracy."""
    keep, sigma = rules.settings.options.requirement, rules.settings.unknown.position_std
    whole = keep.separation + keep.margin + keep.sigmas * sigma
    return (
        f"separation {keep.separation:g} m, margin {keep.margin:g} m: kept from traffic without an "
        f"accuracy are {whole:.0f} m and more, because {keep.sigmas:g} sigmas of {sigma:g} m are "
        "added (--unknown-position-std)"
    )


def _clocks() -> Spent:
    """Return what a clock and this process's processor time show now."""
    return Spent(time.monotonic(), time.process_time())


def _areas(corners: Sequence[Item], clearance: float) -> tuple[GeodeticArea, ...]:
    try:
        return mission.fence(corners, clearance)
    except FieldError as error:
        raise InputError(f"the autopilot's fence: {error}") from None


if __name__ == "__main__":
    run_cli("ros_bridge.mavlink.program:main")
