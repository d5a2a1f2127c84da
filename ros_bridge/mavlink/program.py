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
import re
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Cause
from agents.policy.domain import OutsideDomainError
from agents.policy.inference import Policy
from envs.backend import FLOATS
from envs.edge.command import InputError, Parser, run_cli
from envs.edge.files import write_file
from envs.formats.areas.geodetic import GeodeticArea
from envs.perception import carry_back
from ros_bridge.core.aircraft import load_policy
from ros_bridge.core.assurance import to_fly
from ros_bridge.core.categories import Categories, separations_of
from ros_bridge.core.conversions import Route
from ros_bridge.core.fields import SECOND, FieldError
from ros_bridge.core.planning import rehearse
from ros_bridge.core.reports import UNKNOWN_WIND_STD, USUAL, WIND_STD, Unknown
from ros_bridge.core.situation import Situation, to_local
from ros_bridge.mavlink import messages, mission
from ros_bridge.mavlink.control import Control, Order, Phase, Seen, step
from ros_bridge.mavlink.download import Download, accept, due, note_question
from ros_bridge.mavlink.intake import Reading, Received, forget, take, take_traffic
from ros_bridge.mavlink.judging import (
    SPACING,
    Judgement,
    Rules,
    ToFly,
    rules,
    supervise,
    to_follow,
    watch,
)
from ros_bridge.mavlink.link import FENCE, MISSION, Link
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.plan_file import geojson, kml
from ros_bridge.mavlink.steering import (
    PERIOD,
    Air,
    Command,
    Follower,
    command,
    errors,
    guide,
    sense,
)
from ros_bridge.mavlink.vehicle import (
    Vehicle,
    check_flyable,
    failsafe_notes,
    own_address,
    vehicle_of,
)
from ros_bridge.transport.adsb_receiver import LiveReports, check_source

MARGIN = 25.0
"""Added to the separation for what the autopilot leaves of its plan, m (docs/howto/mavlink.md)."""

STALE = 1.5
"""Age of the own state beyond which nothing is commanded, s."""

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

DOWNLOAD_AGAIN = 5.0
"""After which mission and fence are downloaded again, in case that they have changed, s."""

_REPORT = 60.0  # s between two lines about the processor, and about a receiver
_JUDGE = 0.25  # s between two judgements
_BEAT = 0.5  # s between our heartbeats
_SPEED = 0.5  # s between two airspeeds
_RATES_AGAIN = 5.0  # s after which the rates are asked for again where the own state is stale
_AGAIN = 5.0  # s between two texts of the same kind
_BANK_MAX = math.radians(50.0)
_RANGES = {
    "separation": (10.0, 10_000.0, "m"),
    "margin": (0.0, 1_000.0, "m"),
    "vertical_filter": (0.0, 10_000.0, "m"),
    "unknown_position_std": (0.0, 1_000.0, "m"),
    "unknown_velocity_std": (0.0, 50.0, "m/s"),
    "unknown_wind_std": (0.0, 50.0, "m/s"),
    "wind_std": (0.0, 50.0, "m/s"),
    "deadline": (0.01, 10.0, "s"),
    "wait": (1.0, 3_600.0, "s"),
}


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


def options_of(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options of a command line, or raise :class:`InputError`."""
    options = _parser().parse_args(arguments)
    for name, (low, high, unit) in _RANGES.items():
        value = getattr(options, name)
        if value is not None and not low <= value <= high:
            called = name.replace("_", "-")
            raise InputError(f"--{called} is {value:g} {unit}; expected {low:g} to {high:g} {unit}")
    if not 1 <= options.system <= 255:
        raise InputError(f"--system is {options.system}; expected 1 to 255")
    if options.own and not options.adsb:
        raise InputError("--own goes with --adsb; the autopilot leaves itself out of its traffic")
    if not re.fullmatch("(?:[0-9a-fA-F]{6})?", options.own):
        raise InputError(f"--own is {options.own!r}; expected six hexadecimal digits")
    try:
        options.adsb = options.adsb and check_source(options.adsb)
    except ValueError as problem:
        raise InputError(f"--{problem}") from None
    options.categories = _categories(
        options.category_separations, options.category_vertical_separations
    )
    if options.seconds is not None and not options.seconds > 0.0:
        raise InputError(f"--seconds is {options.seconds:g} s; expected more than 0 s")
    options.policy = _policy(options.policy)
    _check_outputs(options)
    return options


def _policy(file: str) -> Policy:
    """Return the policy of a file, for "" the one that ships; InputError: it is none."""
    try:
        return load_policy(file)
    except ValueError as problem:
        raise InputError(str(problem).replace("policy_file:", "--policy")) from None


def check_folder(option: str, file: Path) -> None:
    """Raise :class:`InputError` where a file of an option would be in a folder that is not there,
    or is a folder itself.
    """
    folder = file.absolute().parent
    if not folder.is_dir():
        raise InputError(f"--{option} {file}: there is no folder {folder}")
    if file.is_dir():
        raise InputError(f"--{option} {file} is a folder; expected a file")


def _check_outputs(options: argparse.Namespace) -> None:
    """Raise :class:`InputError` where the display or a file could not be had in flight."""
    for name, file in (("record", options.record), ("plan-file", options.plan_file)):
        if file is not None:
            check_folder(name, file)
    if options.record is not None and options.record.exists():
        raise InputError(f"--record {options.record} exists already")
    if options.display is not None:
        from ros_bridge.mavlink.showing import host_and_port

        host_and_port(options.display)


class Steered(NamedTuple):
    """A period of the follower."""

    time: float  # s
    cross_track: float  # m
    along_track: float
    late: float  # s
    speed: float  # over the ground, m/s
    airspeed: float
    told: Command


class Spent(NamedTuple):
    """Time that has passed, and what of it this process has computed, s."""

    wall: float
    computed: float


class View(NamedTuple):
    """What the program knows at a moment, for a display or a log beside it."""

    time: int  # ns, on the autopilot's clock
    received: Received
    judgement: Judgement
    control: Control
    mission: tuple[Item, ...]


@dataclass
class _Last:
    """When something was done last, s, on the clock that is named."""

    beat: float = 0.0  # our heartbeat; ours
    rates: float = 0.0  # the autopilot was asked for its messages; ours
    download: float = 0.0  # mission and fence; the autopilot's, as all below
    judgement: float = 0.0
    steering: float = 0.0
    airspeed: float = 0.0
    late: float = -math.inf  # it did not keep up


class _Leg(NamedTuple):
    """The leg that is flown."""

    item: int  # that it leads to
    began: tuple[float, float]  # latitude and longitude, degrees


class _Followed(NamedTuple):
    """A plan or backup that is flown."""

    what: ToFly
    follower: Follower


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
        steered: the last periods of the follower.
        planned: what the last plans took from their request.
        viewers: called after each judgement, in the program's own thread: they must not wait.
    """

    def __init__(self, link: Link, options: argparse.Namespace) -> None:
        self._link, self._options, self._fly = link, options, bool(options.fly)
        self._out: TextIO | None = None if options.quiet else sys.stdout
        self.steered: deque[Steered] = deque(maxlen=20_000)
        self.planned: deque[Spent] = deque(maxlen=20_000)
        self.viewers: list[Callable[[View], object]] = []
        self._open = ExitStack()
        self._last = _Last()
        self._told: dict[str, float] = {}
        self._causes: set[Cause] = set()
        self._remarked: set[str] = set()
        self._downloads: dict[int, Download] = {}
        self._leg: _Leg | None = None
        self._followed: _Followed | None = None
        self._air = Air()
        self._moved = False  # whether a new place has come
        self._targets: set[tuple[int, int]] = set()  # that it has been sent to, 1e-7 degrees
        self._reached_ours = False  # whether one of them has been its target in GUIDED
        self._left_at: int | None = None  # item at which GUIDED has left the mission
        self._asked_for: int | None = None  # item at which we have asked AUTO to go on
        self._replaced = False  # whether there is another mission since then
        self._live: LiveReports | None = None

        found = _question(link, options)
        fence = _fence(found.corners, options.margin)
        self._vehicle, self._corners, self._items = found.vehicle, found.corners, found.mission
        self._rules = _rules(self._vehicle, options)
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
        link = self._link
        self.log(f"autopilot {link.system}/{link.component}, mission of {len(self._items)} items")
        self.log(f"fence of {areas} areas")
        for note in found.vehicle.notes:
            self.log(note)
        if self._fly:
            for note in failsafe_notes(found.parameters, self._options.system):
                self.log(f"warning: {note}")

    def show(self) -> None:
        """Serve the display, and write the recording, that the options ask for, until the program
        is closed.
        """
        address, file = self._options.display, self._options.record
        if file is not None:
            from ros_bridge.mavlink.showing import Recording, Showing

            recording = self._open.enter_context(Recording(file, self.log))
            self.viewers.append(Showing(self._rules, recording.feed))
        if address is None:
            return
        from ros_bridge.mavlink.showing import show

        name = f"MAVLink {self._options.connect}"
        showing, beside = show(address, name, self._rules, lambda: self.view.time, self.log)
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
        self.log(f"traffic of {source} too, {left_out}")
        live = LiveReports(source, own, lambda: self._link.clock.now(time.monotonic()))
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
        now = self._link.clock.now(time.monotonic())
        return View(now, self._received, self._judgement, self._control, self._items)

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
                self.log(self._load(reported, spent))
                reported = spent
        self.log(self._load(began, _clocks()))

    def _load(self, before: Spent, after: Spent) -> str:
        share = (after.computed - before.computed) / max(after.wall - before.wall, 1e-9)
        return f"{100.0 * share:.1f} % of a core, {len(self._received.situation.traffic)} aircraft"

    def turn(self, seconds: float = 0.02) -> None:
        """Receive for so long, and do what is due."""
        ours = time.monotonic()
        hears = ours - self._link.heard <= DEAF
        if hears and ours - self._last.beat >= (0.05 if self._options.simulated else _BEAT):
            self._last.beat = ours
            self._link.beat()
        for message, now in self._link.receive(ours + seconds):
            self._take(message, now)
        if self._live is not None:
            self._take_live(self._live)
        now = self._link.clock.now(time.monotonic())
        if ours - self._last.rates > _RATES_AGAIN:
            self._last.rates = ours
            if self._received.situation.own.age(now) > STALE:
                self._link.ask_rates()  # it was lost, or the autopilot has begun anew
        self._ask(now / SECOND)
        since = now / SECOND - self._last.judgement
        if now and not 0.0 <= since < _JUDGE:
            if self._last.judgement:
                self._keep_pace(since, now)
            self._last.judgement = now / SECOND
            self._judge(now)
        elif self._moved and not 0.0 <= now / SECOND - self._last.steering < 0.9 * PERIOD:
            self._control_step(now)
        self._moved = False

    def _take(self, message: Any, now: int) -> None:
        kind = message.get_type()
        before = self._received
        self._received = take(before, message, now, self._reading)
        if kind == "PARAM_VALUE" and message.param_id == "AVD_ENABLE" and message.param_value:
            self._refuse("AVD_ENABLE was set: the autopilot's own avoidance is on")
        if kind == "MISSION_CURRENT":
            self._note_current(before.current, now)
        if kind == "HEARTBEAT" and before.heartbeat != self._received.heartbeat:
            assert self._received.heartbeat is not None
            self.log(f"mode {self._received.heartbeat.mode_name}", now)
            self._control_step(now)
        self._moved = self._moved or kind == "GLOBAL_POSITION_INT"
        if kind in ("MISSION_COUNT", "MISSION_ITEM_INT"):
            self._accept(message, now)
        if kind == "MISSION_ACK" and message.type:
            # What was asked for is not there any more: it is downloaded anew when that is due.
            self._downloads.pop(message.mission_type, None)

    def _note_current(self, before: int, now: int) -> None:
        """Note at which item GUIDED has left the mission, and say which one somebody else sets
        meanwhile: the autopilot itself sets none.
        """
        if self._control.phase is not Phase.GUIDING:
            return
        current = self._received.current
        if self._left_at is None:
            self._left_at = current
        elif current not in (before, self._left_at):
            what = f"item {current} set by others"
            self._tell(what, f"{what}: AUTO goes on there", now, send=True)

    def _take_live(self, live: LiveReports) -> None:
        """Take in the traffic of a receiver beside the autopilot's own."""
        live.traffic.own = self._received.situation.own.last
        for found, now in live.take():
            seen = found.sighting
            if seen is None:
                self._tell("adsb message", f"{found}", now, send=False)
            else:
                name = seen.identifier
                self._received = take_traffic(self._received, name, found, now, self._reading)

    def _refuse(self, why: str) -> None:
        if self._fly:
            self._fly = False
            self.log(f"{why}; nothing is taken over any more")
            self._link.say("RLCAS: off, AVD_ENABLE is set")

    def _keep_pace(self, since: float, now: int) -> None:
        """Note, and say, where so many seconds have passed unseen; what is flown goes on, but is
        no longer promised.
        """
        before, self._spent = self._spent, _clocks()
        if since <= LATE:
            return
        self._last.late = now / SECOND
        text = f"late by {since:.1f} s, separation not assured"
        wall, computed = self._spent.wall - before.wall, self._spent.computed - before.computed
        more = f"{computed:.2f} s of processor time in {wall:.2f} s"
        self._tell("late", text, now, send=True, more=more)

    # Judging.

    def _judge(self, now: int) -> None:
        self._received = forget(self._received, now)
        problem = "" if self._live is None else self._live.take_problem()
        if problem:
            self._tell("adsb", problem, now, send=True, again=_REPORT)
        phase = self._control.phase
        try:
            route = self._route()
        except FieldError as error:
            route = None
            self._tell("mission", f"{error}", now, send=False)
        before, began = self._judgement, _clocks()
        situation = self._received.situation
        if route is not None and phase in (Phase.TAKING, Phase.GUIDING):
            self._judgement = supervise(before, situation, route, now, self._rules)
            self._explain(now)
            if self._judgement.revision != before.revision:
                self._write_plan()
        elif (
            route is not None and phase is not Phase.RETURNING and self._mode == messages.Mode.AUTO
        ):
            self._judgement = watch(before, situation, route, now, self._rules)
            self._advise(now)
        if self._judgement.plan not in (None, before.plan):
            self._tell_time(began, now)
        self._remark(now)
        done = self._link.clock.now(time.monotonic())
        self._keep_pace((done - now) / SECOND, done)
        self._control_step(done)
        for show in self.viewers:
            show(self.view)

    # Missions and fences that change.

    def _ask(self, now: float) -> None:
        """Ask for what is missing of a download, and for mission and fence every now and then."""
        if not 0.0 <= now - self._last.download < DOWNLOAD_AGAIN and now:
            self._last.download = now
            for kind in (MISSION, FENCE):
                self._downloads.setdefault(kind, Download(kind))
        for kind, download in self._downloads.items():
            if due(download, now):
                number = None if download.count is None else len(download.items)
                self._link.ask_item(kind, number)
                self._downloads[kind] = note_question(download, now)

    def _accept(self, message: Any, now: int) -> None:
        """Take in an item; what cannot be read leaves what is there."""
        kind = getattr(message, "mission_type", MISSION)
        if kind not in self._downloads:
            return
        try:
            download = self._downloads[kind] = accept(self._downloads[kind], message)
            if not download.done:
                return
            if kind == FENCE:
                self._change_fence(download.items, now)
            else:
                self._change_mission(download.items, now)
        except (FieldError, InputError) as problem:
            self._tell(f"download {kind}", f"{problem}", now, send=True)
        del self._downloads[kind]
        self._link.thank(kind)

    def _change_mission(self, items: tuple[Item, ...], now: int) -> None:
        """Take over another mission; while a plan is flown, only note that there is one."""
        if items[1:] == self._items[1:]:  # the first is home
            return
        if not self._control.flies:
            self._items, self._leg = items, None
            self.log(f"the mission has changed: {len(items)} items", now)
        elif not self._replaced:
            self._replaced = True
            self._tell("mission", "mission changed by others: AUTO flies it", now, send=True)

    def _change_fence(self, corners: tuple[Item, ...], now: int) -> None:
        if corners != self._corners:
            fence = _fence(corners, self._options.margin)
            self._corners = corners
            situation = replace(self._received.situation, fixed_areas=fence)
            self._received = replace(self._received, situation=situation)
            self._tell("fence", f"fence has changed: {len(fence)} areas", now, send=True)

    @property
    def _mode(self) -> int:
        return -1 if self._received.heartbeat is None else self._received.heartbeat.mode

    def _route(self) -> Route:
        """Return the mission from the current item on, its first leg from where it began; while a
        plan is flown, from the item that it has left.
        """
        current = self._received.current if self._left_at is None else self._left_at
        own = self._received.situation.own.last
        left = mission.remaining_items(self._items, current)
        if not left or own is None:
            raise FieldError("mission", f"is at item {current}, where no waypoint is flown to")
        if not self._control.flies and self._received.target is not None:
            left = mission.begin_at_target(left, self._items, *self._received.target)
        if self._leg is None or self._leg.item != current:
            came_from = mission.before(self._items, current)
            self._leg = _Leg(current, own.place if came_from is None else came_from.place)
        spacing = SPACING * self._vehicle.aircraft.separation
        return mission.route(self._leg.began, left, spacing)

    def _tell_time(self, began: Spent, now: int) -> None:
        """Log what it took from the request, at a time, to the plan."""
        done = _clocks()
        took = Spent(done.wall - began.wall, done.computed - began.computed)
        self.planned.append(took)
        self._tell("time", f"planned within {1e3 * took.wall:.0f} ms", now, send=False)

    def _explain(self, now: int) -> None:
        """Log why the monitor is not content, where that changes."""
        verdict = self._judgement.verdict
        reasons = () if verdict is None else verdict.reasons
        causes = {why.cause for why in reasons}
        if causes != self._causes:
            self._causes = causes
            state = "" if verdict is None else verdict.state.name
            self.log(f"{state}: {'; '.join(why.message for why in reasons) or 'no remark'}", now)
        problem = self._judgement.problem
        if problem:
            self._tell(
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
                self.log(remark, now)

    def _advise(self, now: int) -> None:
        found, answer = self._judgement.conflict, self._judgement.plan
        if self._judgement.problem:
            self._tell("problem", self._judgement.problem, now, send=True)
        if found is None or answer is None:
            return
        safe = self._safe(now)
        kind = f"conflict {found.name} {safe}"
        text = f"{found.name} in {found.time:.0f} s: "
        if not safe:
            reasons = "; ".join(reason.message for reason in answer.reasons)
            more = reasons or "the program has been late"
            self._tell(kind, f"{text}no plan is safe", now, send=True, more=more)
            return
        first = answer.waypoints[0]
        turn = f"{math.degrees(0.5 * math.pi - first.heading) % 360.0:.0f} deg"
        text += f"plan by {turn}, {first.speed:.0f} m/s"
        if self._tell(kind, text, now, send=True, more=f"rejoins {answer.goal_index}"):
            self._write_plan()

    def _write_plan(self) -> None:
        """Write what is flown or advised; a full disk stops nothing."""
        file, held = self._options.plan_file, self._judgement.supervision.held
        if file is None or held is None:
            return
        try:
            write_file(file, (kml if file.suffix == ".kml" else geojson)(held))
        except OSError as error:
            self.log(f"{file}: cannot be written: {error}")

    # Flying.

    def _control_step(self, now: int) -> None:
        seen = self._make_seen(now)
        before, was = self._control, self._control.phase
        done = step(self._control, seen, fly=self._fly)
        self._control = done.control
        if done.text:
            self.log(done.text, now)
            self._link.say(f"RLCAS: {done.text}")
        if was is not self._control.phase:
            self.log(f"{was.value} -> {self._control.phase.value}", now)
            if not self._control.flies:
                self._left_at = self._asked_for = None
                self._replaced, self._last.download = False, -math.inf
            if self._control.phase is Phase.WATCHING:
                self._targets.clear()
                self._received = replace(self._received, target=None)  # it was ours
                revision = self._judgement.revision
                supervision = replace(self._rules.begin(), revision=revision)
                self._judgement = Judgement(supervision, revision=revision)
        for order in done.orders:
            self._obey(order, now, before)
        if self._control.phase is Phase.GUIDING and not seen.fresh:
            self._tell("stale", "own state cannot be used, nothing commanded", now, send=True)

    def _make_seen(self, now: int) -> Seen:
        judged, received = self._judgement, self._received
        track = received.situation.own
        fresh = track.fault is None and track.age(now) <= STALE
        rejoin = judged.rejoin
        on_plan = to_fly(judged.supervision) is FlyMode.PLAN
        watching = self._control.phase is Phase.WATCHING
        return Seen(
            time=now / SECOND,
            mode=self._mode,
            armed=received.heartbeat is not None and received.heartbeat.armed,
            fresh=fresh,
            conflict=judged.conflict is not None and judged.conflict.time <= self._rules.engage,
            flyable=self._safe(now) if watching else to_follow(judged) is not None,
            rejoined=on_plan and rejoin is not None and now >= rejoin.time,
            diverted=self._is_diverted(),
        )

    def _safe(self, now: int) -> bool:
        """Return whether there is a plan that may be called safe."""
        return self._judgement.safe and now / SECOND - self._last.late > RECOVERED

    def _obey(self, order: Order, now: int, before: Control) -> None:
        if order is Order.TAKE_OVER:
            self._take_over()
        elif order is Order.STEER:
            self._steer(now)
        elif order is Order.GIVE_BACK:
            self._give_back()
        elif before.restore is not None:
            self._link.set_mode(before.restore)

    def _take_over(self) -> None:
        held = self._judgement.supervision.held
        own = self._received.situation.own.last
        if held is None or own is None or own.altitude is None:
            return
        point = held.points[-1]
        target = messages.target(point.latitude, point.longitude, own.altitude)
        self._targets.add((target.latitude, target.longitude))
        self._link.reposition(target)

    def _give_back(self) -> None:
        """Ask for AUTO, at the item after the rejoin point unless somebody else has set one."""
        current, rejoin = self._received.current, self._judgement.rejoin
        ours = self._left_at is None or current in (self._left_at, self._asked_for)
        if ours and not self._replaced and rejoin is not None and rejoin.point is not None:
            self._asked_for = mission.item_after_rejoin(rejoin.point, self._items)
            self._link.set_current(self._asked_for)
        self._link.set_mode(messages.Mode.AUTO)

    def _is_diverted(self) -> bool:
        """Return whether the autopilot has had our target in GUIDED, and now has another one."""
        if self._control.phase is not Phase.GUIDING:
            self._reached_ours = False
            return False
        ours = self._received.target in self._targets
        self._reached_ours = self._reached_ours or ours
        return self._reached_ours and not ours

    def _steer(self, now: int) -> None:
        """Command roll and airspeed of what is to be flown."""
        wanted, report = to_follow(self._judgement), self._received.situation.own.last
        if wanted is None or report is None:
            return
        follower = self._follow(wanted, now)
        age = (now - report.time) / SECOND
        state = carry_back(to_local(wanted.frame, report), -age, FLOATS)
        clock = (now - wanted.began) / SECOND
        speeds = self._vehicle.airspeed_min, self._vehicle.airspeed_max
        airspeed = self._received.airspeed
        self._air = sense(self._air, state, report.wind, airspeed)
        told = command(follower, state, clock, self._air, speeds, _BANK_MAX)
        self._last.steering = seconds = now / SECOND
        off = errors(follower, state, clock)
        self.steered.append(Steered(seconds, *off, state.speed, airspeed or math.nan, told))
        with_speed = not 0.0 <= seconds - self._last.airspeed < _SPEED
        if with_speed:
            self._last.airspeed = seconds
        self._link.steer(told, now // 1_000_000, speed=with_speed)

    def _follow(self, wanted: ToFly, now: int) -> Follower:
        """Return the follower of what is to be flown, a new one where that is another."""
        if self._followed is None or self._followed.what.key != wanted.key:
            follower = guide(wanted.own, wanted.waypoints, wanted.wind)
            self._followed = _Followed(wanted, follower)
            self.log(f"flying {wanted.key[0]} {wanted.key[1]}", now)
        return self._followed.follower

    # Texts.

    def _tell(
        self, kind: str, text: str, now: int, *, send: bool, more: str = "", again: float = _AGAIN
    ) -> bool:
        """Log a text, and send it, unless one of its kind has just been; return whether it has."""
        seconds = now / SECOND
        if 0.0 <= seconds - self._told.get(kind, -math.inf) < again:
            return False
        self._told[kind] = seconds
        self.log(f"{text} ({more})" if more else text, now)
        if send:
            self._link.say(f"RLCAS: {text}")
        return True

    def log(self, text: str, now: int | None = None) -> None:
        """Write a line; where it cannot be written, as on a full disk, nothing stops for it."""
        if self._out is None:
            return
        moment = "" if now is None else f"{now / SECOND:8.2f} "
        try:
            print(f"{moment}{text}", file=self._out, flush=True)
        except OSError:
            self._out = None


def _clocks() -> Spent:
    """Return what a clock and this process's processor time show now."""
    return Spent(time.monotonic(), time.process_time())


def _fence(corners: Sequence[Item], clearance: float) -> tuple[GeodeticArea, ...]:
    try:
        return mission.fence(corners, clearance)
    except FieldError as error:
        raise InputError(f"the autopilot's fence: {error}") from None


def _rules(vehicle: Vehicle, options: argparse.Namespace) -> Rules:
    try:
        policy = options.policy.for_aircraft(vehicle.aircraft)
    except OutsideDomainError as problem:
        raise InputError(
            f"--separation {options.separation:g} m with the autopilot's parameters: {problem}"
        ) from None
    fastest, wind = vehicle.aircraft.limits.speed_max, options.unknown_wind_std
    unknown = Unknown(
        options.unknown_position_std,
        options.unknown_velocity_std,
        UNKNOWN_WIND_STD * fastest if wind is None else wind,
    )
    return rules(
        vehicle.aircraft,
        policy,
        margin=options.margin,
        vertical=options.vertical_filter,
        unknown=unknown,
        wind_std=WIND_STD * fastest if options.wind_std is None else options.wind_std,
        deadline=options.deadline,
        categories=options.categories,
    )


def _categories(separations: str, vertical: str) -> Categories:
    try:
        return Categories(
            separations_of("--category-separations", separations),
            separations_of("--category-vertical-separations", vertical),
        )
    except ValueError as problem:
        raise InputError(str(problem)) from None


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m ros_bridge.mavlink", description=__doc__)
    add = parser.add_argument
    add(
        "--connect",
        required=True,
        metavar="ADDRESS",
        help="udp:HOST:PORT (listens), udpout:HOST:PORT, tcp:HOST:PORT or a serial port",
    )
    add("--baud", type=int, default=57_600, help="speed of a serial port, baud (default 57600)")
    add("--system", type=int, default=245, help="our number, 1 to 255 (default 245)")
    add("--fly", action="store_true", help="take over in GUIDED while a conflict lasts")
    numbers = (
        ("separation", 610.0, "kept from traffic, m"),
        ("margin", MARGIN, "added for the distance of flights from their plans, m"),
        ("vertical-filter", 600.0, "traffic farther above or below does not count, m"),
        ("unknown-position-std", USUAL.position_std, "one sigma of positions without one, m"),
        ("unknown-velocity-std", USUAL.velocity_std, "one sigma of velocities without one, m/s"),
        ("deadline", 0.2, "computation in which a plan must be found, s"),
        ("wait", 30.0, "time to wait for the first heartbeat, s"),
    )
    for name, default, what in numbers:
        add(f"--{name}", type=float, default=default, help=f"{what} (default {default:g})")
    for name, what in (
        ("category-separations", "separations from aircraft of emitter categories, m"),
        ("category-vertical-separations", "vertical filters likewise"),
    ):
        text = f"{what}, such as A5:2000,B6:300 (default: the same from all)"
        add(f"--{name}", default="", metavar="LIST", help=text)
    for name, share, what in (
        ("wind-std", WIND_STD, "the wind that the autopilot sends"),
        ("unknown-wind-std", UNKNOWN_WIND_STD, "a wind that it does not send, about calm"),
    ):
        usual = f"default {share:g} of the highest speed"
        add(f"--{name}", type=float, help=f"one sigma of {what}, m/s ({usual})")
    add(
        "--traffic-altitude",
        choices=("unknown", "msl"),
        default="unknown",
        help="what altitudes of ADS-B are above (default unknown: every aircraft counts)",
    )
    add("--adsb", default="", metavar="URL", help="live receiver, tcp://HOST:30003 or http://...")
    own = "address of the ownship among its aircraft (default: the autopilot's ADSB_ICAO_ID)"
    add("--own", default="", metavar="HEX", help=own)
    add("--policy", default="", metavar="FILE", help="policy file (default: the one that ships)")
    plan_file = "write the plan that is advised or flown: KML where it ends in .kml, or GeoJSON"
    add("--plan-file", type=Path, metavar="FILE", help=plan_file)
    add(
        "--display",
        nargs="?",
        const="127.0.0.1:8642",
        metavar="HOST:PORT",
        help="serve a traffic display for the browser (default address 127.0.0.1:8642)",
    )
    add(
        "--record",
        type=Path,
        metavar="FILE.mcap",
        help="record what the display shows (default: no recording)",
    )
    add("--seconds", type=float, help="end after this time, s (default: never)")
    add("--quiet", action="store_true", help="print nothing")
    simulated = "the autopilot is a simulation, whose time may run faster than real time"
    add("--simulated", action="store_true", help=simulated)
    return parser


if __name__ == "__main__":
    run_cli("ros_bridge.mavlink.program:main")
