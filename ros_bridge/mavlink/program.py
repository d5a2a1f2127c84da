"""Watches an autopilot's mission for traffic, plans round it, and advises or flies.

    python -m ros_bridge.mavlink --connect udp:0.0.0.0:14550 --separation 610 [--fly]

Reads state, mission, fence, parameters and traffic (ADS-B, Remote ID) from ArduPlane over MAVLink,
with --adsb traffic from other receivers too, and watches and plans as the ROS nodes do, by the same
core. By default it advises: STATUSTEXT to the ground station, and with --plan-file the plan as a
map. With --fly it changes from AUTO to GUIDED while a conflict lasts, flies the plan in place and
time, and gives AUTO back where the plan rejoins the mission. A mode, or a target in GUIDED, that
anybody else sets ends that at once; it takes over again only after AUTO has flown 10 s without a
conflict. An item of the mission that anybody else sets meanwhile is where AUTO goes on. Plans keep
the height; with --maneuvers vertical or both they climb and descend as well.

It stops commanding where the autopilot's state is older than 1.5 s. What the autopilot does where
this program or the link dies: docs/howto/mavlink.md.
"""

import argparse
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TextIO

from commands.command import InputError, run_cli
from commands.files import write_file
from envs.formats.areas.geodetic import GeodeticArea
from ros_bridge.core.conversions import Published
from ros_bridge.core.failures import Failures
from ros_bridge.core.fields import SECOND
from ros_bridge.core.planning import prepare, rehearse
from ros_bridge.core.situation import Situation
from ros_bridge.mavlink.advance import BEAT, advance
from ros_bridge.mavlink.changes import areas_of
from ros_bridge.mavlink.clocks import Moment, Spent
from ros_bridge.mavlink.effects import (
    AskItem,
    AskRates,
    Beat,
    Effect,
    Judge,
    Log,
    NotePlanned,
    Reposition,
    Say,
    Sent,
    SetCurrent,
    SetMode,
    Show,
    Steer,
    Thank,
    WritePlan,
)
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
from ros_bridge.mavlink.intake import Reading, Received
from ros_bridge.mavlink.judging import Judgement, Question, Rules, answer
from ros_bridge.mavlink.link import Link
from ros_bridge.mavlink.mission import Item, home_altitude
from ros_bridge.mavlink.options import options_of, rules_of, vertical_separation_of
from ros_bridge.mavlink.plan_file import geojson, kml
from ros_bridge.mavlink.remote_id import names_of
from ros_bridge.mavlink.state import Pace, Setup, State
from ros_bridge.mavlink.steering import Steered
from ros_bridge.mavlink.vehicle import (
    Vehicle,
    check_flyable,
    failsafe_notes,
    fence_levels,
    own_address,
    vehicle_of,
)
from ros_bridge.mavlink.view import View
from ros_bridge.transport.receivers import LiveReports

_SIMULATED_BEAT = 0.05  # s between our heartbeats beside a simulation, whose time may run faster
_REPORT = 60.0  # s between two lines about the processor, and about a receiver


def main(arguments: Sequence[str] | None = None) -> int:
    """Watch until Ctrl-C, or for --seconds, and return the exit code."""
    options = options_of(arguments)
    computes = prepare(options.policy)  # before there is an autopilot that waits
    link = Link(
        options.connect, baud=options.baud, system=options.system, simulated=options.simulated
    )
    with ExitStack() as open_ones:
        open_ones.callback(link.close)
        program = Program(link, options)
        open_ones.callback(program.close)
        program.tell(computes)
        program.show()
        program.run()
    return 0


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
    vehicle = vehicle_of(parameters, options.separation, vertical_separation_of(options))
    return _Autopilot(parameters, vehicle, link.fence(), link.mission())


def _setup(options: argparse.Namespace, autopilot: _Autopilot) -> Setup:
    """Return what stays the same throughout a flight; InputError: the policy is for no such
    aircraft, or plans may not climb as they are to.
    """
    above_sea, vehicle = options.traffic_altitude == "msl", autopilot.vehicle
    fence = None, None
    if vehicle.aircraft.vertical is not None:
        fence = fence_levels(autopilot.parameters, home_altitude(autopilot.mission))
    return Setup(
        rules=rules_of(options, vehicle, fence),
        vehicle=vehicle,
        reading=Reading(
            {0: "msl", 1: "msl"} if above_sea else {},
            own_drone=names_of(options.own_remote_id),
        ),
        system=options.system,
        beat=_SIMULATED_BEAT if options.simulated else BEAT,
        margin=options.margin,
        deadline=options.deadline,
    )


class _Output:
    """Lines on the output; ``out`` None: nowhere. It is called from threads of others too."""

    def __init__(self, out: TextIO | None) -> None:
        self._out = out

    def log(self, text: str, time: int | None = None) -> None:
        """Write a line that begins with a time of the autopilot's, ns; where it cannot be written,
        as on a full disk, nothing stops for it.
        """
        if self._out is None:
            return
        moment = "" if time is None else f"{time / SECOND:8.2f} "
        try:
            print(f"{moment}{text}", file=self._out, flush=True)
        except OSError:
            self._out = None


class Program:
    """Brings events to :func:`ros_bridge.mavlink.advance.advance`, and carries its effects out.

    Attributes:
        setup: what stays the same.
        state: what is known, judged and flown.
        steered: the last periods of the follower.
        planned: what the last plans took from their request.
        viewers: called after each judgement, in the program's own thread: they must not wait.
    """

    def __init__(self, link: Link, options: argparse.Namespace) -> None:
        self._link, self._options = link, options
        self._output = _Output(None if options.quiet else sys.stdout)
        self.steered: deque[Steered] = deque(maxlen=20_000)
        self.planned: deque[Spent] = deque(maxlen=20_000)
        self.viewers: list[Callable[[View], object]] = []
        self._protecting = Failures(self._output.log)
        self._showing = Failures(lambda text: self._take(ShowingFailed(text, self._clock_time())))
        self._open = ExitStack()
        self._begun = 0  # how often the autopilot's clock has begun
        self._live: LiveReports | None = None

        autopilot = _question(link, options)
        fence = areas_of(autopilot.corners, options.margin)
        self.setup = _setup(options, autopilot)
        self.state = self._begin(autopilot, fence)
        self._introduce(autopilot, len(fence))
        rehearse(self.setup.rules.policy, self.setup.rules.settings.options)
        if options.adsb:
            own = options.own or own_address(autopilot.parameters)
            self._live = self._listen(options.adsb, own)
        link.ask_rates()
        self.state = replace(self.state, rates_at=time.monotonic())

    def tell(self, text: str) -> None:
        """Write a line for whoever started the program."""
        self._output.log(text)

    def _begin(self, autopilot: _Autopilot, fence: tuple[GeodeticArea, ...]) -> State:
        """Return the first state."""
        situation = Situation(fixed_areas=fence)
        return State(
            Judgement(self.setup.rules.begin()),
            items=autopilot.mission,
            corners=autopilot.corners,
            fly=bool(self._options.fly),
            received=Received(situation, parameters=autopilot.parameters),
            pace=Pace(spent=_clocks()),
        )

    def _introduce(self, autopilot: _Autopilot, areas: int) -> None:
        """Log what the autopilot has answered, and what follows from it."""
        link, log = self._link, self._output.log
        log(f"autopilot {link.system}/{link.component}, mission of {len(autopilot.mission)} items")
        log(f"fence of {areas} areas")
        for line in separation_lines(self.setup.rules):
            log(line)
        for note in autopilot.vehicle.notes:
            log(note)
        if self.state.fly:
            for note in failsafe_notes(autopilot.parameters, self._options.system):
                log(f"warning: {note}")

    def show(self) -> None:
        """Serve the display, and write the recording, that the options ask for, until the program
        is closed.
        """
        address, file = self._options.display, self._options.record
        if file is not None:
            from ros_bridge.mavlink.adapter import BackgroundRecorder, SceneAdapter

            recording = self._open.enter_context(BackgroundRecorder(file, self._output.log))
            self.viewers.append(SceneAdapter(self.setup.rules, recording.feed))
        if address is None:
            return
        from ros_bridge.mavlink.adapter import show

        name = f"MAVLink {self._options.connect}"
        adapter, server = show(address, name, self.setup.rules, self._clock_time, self._output.log)
        self.viewers.append(adapter)
        self._open.enter_context(server)
        print(f"display: http://{address.rpartition(':')[0]}:{server.port}/", flush=True)

    def close(self) -> None:
        """End the connection, the display and the recording."""
        self._open.close()
        self._link.close()

    def _listen(self, sources: Sequence[str], own: str) -> LiveReports:
        """Return the receivers beside the autopilot's own, to which is listened; InputError: a
        port has been taken meanwhile.
        """
        left_out = f"without {own}, the ownship" if own else "the ownship's address is unknown"
        self._output.log(f"traffic of {', '.join(sources)} too, {left_out}")
        try:
            live = LiveReports(sources, own, self._clock_time)
        except ValueError as problem:
            raise InputError(f"--{problem}") from None
        live.start()
        self._open.callback(live.stop)
        return live

    @property
    def view(self) -> View:
        """What is known now."""
        return self.state.view(self._clock_time())

    def _clock_time(self) -> int:
        """Return the autopilot's time, ns; called from threads of others too."""
        return self._link.clock.now(time.monotonic())

    def _moment(self) -> Moment:
        """Return what the clocks show now."""
        clock = self._link.clock
        return Moment(self._clock_time(), _clocks(), clock.speed, clock.races)

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
                self._output.log(self._load(reported, spent))
                for line in _count_left_out(self.view):
                    self._output.log(line)
                reported = spent
        self._output.log(self._load(began, _clocks()))

    def _load(self, before: Spent, after: Spent) -> str:
        share = (after.computed - before.computed) / max(after.wall - before.wall, 1e-9)
        aircraft = len(self.state.received.situation.traffic)
        return f"{100.0 * share:.1f} % of a core, {aircraft} aircraft"

    def turn(self, seconds: float = 0.02) -> None:
        """Receive for so long, and do what is due."""
        ours = time.monotonic()
        self._take(Listening(ours, ours - self._link.heard))
        for message, arrived in self._link.receive(ours + seconds):
            self._follow_clock(arrived)
            self._take(Message(message, arrived))
        if self._live is not None:
            self._live.note_own(self.state.received.situation.own.last)
            for report, arrived in self._live.take():
                self._take(LiveReport(report, arrived))
        self._take(Tick(self._moment()))

    def _follow_clock(self, arrived: int) -> None:
        """Note where the autopilot's clock has begun anew before a message."""
        times, self._begun = self._begun, self._link.clock.begun
        if times not in (0, self._begun):
            self._take(Restart(arrived))

    def _take(self, event: Event) -> None:
        """Take in an event, and do what follows from it."""
        self.state, effects = advance(self.state, event, self.setup)
        for effect in effects:
            self._carry_out(effect)

    def _carry_out(self, effect: Effect) -> None:
        match effect:
            case Log(text, moment):
                self._output.log(text, moment)
            case WritePlan(plan):
                self._write_plan(plan)
            case NotePlanned(took):
                self.planned.append(took)
            case Show(view):
                for viewer in self.viewers:
                    self._showing.attempt("display", partial(viewer, view))
            case Judge(moment):
                self._judge(moment)
            case Question():
                self._answer(effect)
            case _:
                self._send(effect)

    def _send(self, effect: Sent) -> None:
        link = self._link
        match effect:
            case Beat():
                link.beat()
            case AskRates():
                link.ask_rates()
            case AskItem(kind, number):
                link.ask_item(kind, number)
            case Thank(kind):
                link.thank(kind)
            case Reposition(target):
                link.reposition(target)
            case Steer(steered, boot_ms, speed):
                self.steered.append(steered)
                link.steer(steered.command, boot_ms, speed=speed)
            case SetMode(mode):
                link.set_mode(mode)
            case SetCurrent(number):
                link.set_current(number)
            case Say(text):
                link.say(text)

    def _judge(self, moment: Moment) -> None:
        """Judge what lies ahead; an error of our own ends neither the program nor what is flown."""
        well = self._protecting.attempt("judgement", partial(self._look, moment))
        failure = "" if well else self._protecting.problems()[-1]
        self._take(Judged(moment.time, self._moment(), failure))

    def _look(self, moment: Moment) -> None:
        foreign = self._link.foreign > 0
        if self._live is None:
            self._take(Look(moment, foreign=foreign))
            return
        counts = self._live.left_out, self._live.doubted
        self._take(Look(moment, self._live.take_problem(), foreign, *counts))

    def _answer(self, question: Question) -> None:
        begin = _clocks()
        judgement = answer(question, self.setup.rules)
        end = _clocks()
        took = Spent(end.wall - begin.wall, end.computed - begin.computed)
        self._take(Answer(question, judgement, took))

    def _write_plan(self, plan: Published) -> None:
        """Write what is flown or advised; a full disk stops nothing."""
        file = self._options.plan_file
        if file is None:
            return
        try:
            write_file(file, (kml if file.suffix == ".kml" else geojson)(plan))
        except OSError as error:
            self._output.log(f"{file}: cannot be written: {error}")


def _count_left_out(view: View) -> Iterator[str]:
    """Yield what of the traffic was left out so far, and what was not although a field forbids it,
    a line each.
    """
    for fate, counts in (("left out", view.left_out), ("doubted", view.doubted)):
        if counts:
            reasons = (f"{count} {reason}" for reason, count in sorted(counts.items()))
            yield f"reports of traffic {fate}: {', '.join(reasons)}"


def separation_lines(rules: Rules) -> Iterator[str]:
    """Yield a line on the distance that is kept from traffic that says nothing of its accuracy, and
    where plans may climb one on what is kept above and below.
    """
    options, sigma = rules.settings.options, rules.settings.unknown.position_std
    keep = options.requirement
    required = keep.separation + keep.margin + keep.sigmas * sigma
    yield (
        f"separation {keep.separation:g} m, margin {keep.margin:g} m: kept from traffic without an "
        f"accuracy are {required:.0f} m and more, because {keep.sigmas:g} sigmas of {sigma:g} m "
        "are added (--unknown-position-std)"
    )
    if not options.climbs:
        return
    floor, ceiling = (
        f"{name} {level.value:g} m" if level is not None else f"no {name}"
        for name, level in (("floor", options.floor), ("ceiling", options.ceiling))
    )
    yield (
        f"or vertical separation {options.vertical_separation:g} m, margin "
        f"{options.vertical_margin:g} m; {floor}, {ceiling} above mean sea level"
    )


def _clocks() -> Spent:
    """Return what a clock and this process's processor time show now."""
    return Spent(time.monotonic(), time.process_time())


if __name__ == "__main__":
    run_cli("ros_bridge.mavlink.program:main")
