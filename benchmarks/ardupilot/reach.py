"""Who has the aircraft, counted: a foreign mode ends what we command, and where we fall silent the
autopilot flies on.

    python -m benchmarks.ardupilot.reach [--modes 50] [--ends 20]

*Modes*: while the program flies an avoidance, at a random moment, somebody else sets LOITER, RTL,
CIRCLE or AUTO; the time from that message until the program commands no more, on the autopilot's
clock, whether it says so, and whether the mode is still the same three seconds later. The
simulation stands still while the program computes.

*Ends*: in real time the program is a process of its own; while it flies it is killed, its link is
cut, or cut in one direction, so that it hears the autopilot no more (deaf), its log is on a full
disk (``/dev/full``), or other processes take the processors. Killed, cut and deaf: the autopilot
must be in AUTO within 10 s (FS_LONG_TIMEOUT is 3 s). Full disk: the program must
fly on for 5 s. Busy: for 40 s four processes a core compute beside it; it must keep the separation,
or say that it is late. The last line is one JSON object; exit status 1: a try failed.
"""

import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.ardupilot.chaser import Chaser
from benchmarks.ardupilot.relay import Relay
from benchmarks.measure import parse_names, report
from commands.command import Parser, whole
from envs.formats.local_frame import LocalFrame
from ros_bridge.mavlink.control import Phase
from ros_bridge.mavlink.flight import KNOWN, SEPARATION, Row, advance, program_beside
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.program import Program
from ros_bridge.mavlink.sitl import HOME, Leg, Sitl

_SET_MODE = 176  # MAV_CMD_DO_SET_MODE
FAILSAFE = {"FS_GCS_ENABL": 1, "MAV_GCS_SYSID": 245, "FS_LONG_ACTN": 4, "FS_LONG_TIMEOUT": 3}
MODES = Mode.LOITER, Mode.RTL, 1, Mode.AUTO
WAYS = "kill", "cut", "deaf", "disk", "busy"
_CROSSES = 36.0  # s until the other crosses our way
_ALONG = 0.2  # rad from the mission's course, within which it is flown again
_STILL = 30.0  # s of real time without a message from the simulation
_PATIENCE = 90.0  # s for anything, on the autopilot's clock
_MISSES = 50  # times that the program did not take over, of all tries
_AFTER = 3.0  # s, after which a mode must still be there
_WITHIN, _FLIES = 10.0, 5.0  # s until AUTO; for which it must fly on
_BUSY, _BUSY_ONES = 40.0, 4  # s, and processes a core
_MISSION = 60_000.0  # m
# Where this process waits for a processor, the simulation goes on unseen: slower while it counts.
_SPEEDUP, _COUNTED = 10.0, 2.0

LEGS = (Leg(100.0, 0.0, 60.0, 22, 15.0), Leg(400.0, 0.0), Leg(_MISSION, 0.0))


class Try(NamedTuple):
    """What came of one try."""

    case: str
    seconds: float  # until control was back; inf: never
    good: bool


class Ground:
    """What a ground station knows: the aircraft, its mode and the texts."""

    def __init__(self, sitl: Sitl) -> None:
        self.sitl = sitl
        self.row = Row(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1)
        self.course = 0.0
        """Over the ground, rad."""
        self.mode = -1
        self.texts: list[str] = []
        self._frame = LocalFrame(HOME[0], HOME[1])

    def hear(self, message: Any) -> None:
        """Take in a message."""
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.get_srcComponent() == 1:
            self.mode = message.custom_mode
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "GLOBAL_POSITION_INT":
            at = self._frame.place(1e-7 * message.lat, 1e-7 * message.lon)
            fast = 0.01 * math.hypot(message.vx, message.vy)
            self.course = math.atan2(message.vx, message.vy)
            x, y = float(at.x), float(at.y)
            seconds = 1e-3 * message.time_boot_ms
            self.row = Row(seconds, x, y, 1e-3 * message.alt, fast, fast, self.mode)

    def set_mode(self, mode: int) -> None:
        """Ask the autopilot for a mode."""
        self.sitl.command(_SET_MODE, 1.0, float(mode))

    def listen(self, seconds: float = 0.05) -> None:
        """Take in what comes within so much real time."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.sitl.beat()
            message = self.sitl.station.recv_match(blocking=True, timeout=0.02)
            if message is not None:
                self.hear(message)


def modes(count: int, *, seed: int = 0, instance: int = 8) -> list[Try]:
    """Return what came of so many foreign modes."""
    misses = 0
    draw = np.random.default_rng(seed)
    tries: list[Try] = []
    with flight(instance, _SPEEDUP) as sitl:
        program = program_beside(sitl)
        ground, chaser = Ground(sitl), Chaser(seed)
        try:
            _pass(program, ground, chaser, 1.0)
            while len(tries) < count:
                if not _until_guided(program, ground, chaser):
                    misses += 1
                    if misses > _MISSES:
                        raise RuntimeError(f"the program does not take over: {ground.texts[-3:]}")
                    continue
                _set_speedup(sitl, _COUNTED)
                _pass(program, ground, chaser, float(draw.uniform(0.0, 6.0)))
                tries.append(_take_over(program, ground, chaser, int(draw.choice(MODES))))
                _set_speedup(sitl, _SPEEDUP)
                print(f"{len(tries)}/{count} {tries[-1]}", flush=True)
        finally:
            program.close()
    return tries


def _set_speedup(sitl: Sitl, speedup: float) -> None:
    sitl.station.mav.param_set_send(1, 1, b"SIM_SPEEDUP", speedup, 9)


def _until_guided(program: Program, ground: Ground, chaser: Chaser) -> bool:
    """Let another aircraft come until the program flies; return whether it does."""
    chaser.leave()
    began = ground.row.time
    while _phase(program) is not Phase.WATCHING or ground.mode != Mode.AUTO:
        ground.set_mode(Mode.AUTO)
        _pass(program, ground, chaser, 1.0)
        if ground.row.time - began > _PATIENCE:
            raise RuntimeError(f"the program does not watch again: {ground.texts[-3:]}")
    while abs(ground.course) > _ALONG:
        _pass(program, ground, chaser, 1.0)
    chaser.add_crossing(ground.row, ground.course, _CROSSES)
    began = ground.row.time
    while _phase(program) is not Phase.GUIDING:
        _pass(program, ground, chaser, 0.0)
        if ground.row.time - began > _CROSSES:
            return False
    return True


def _phase(program: Program) -> Phase:
    return program.view.control.phase


def _take_over(program: Program, ground: Ground, chaser: Chaser, mode: int) -> Try:
    """Set a mode as a ground station does, and return how long the program commanded on."""
    ground.texts.clear()
    began = ground.row.time
    ground.set_mode(mode)
    took = math.inf
    while ground.row.time - began < _AFTER:
        _pass(program, ground, chaser, 0.0)
        if took == math.inf and not program.view.control.flies:
            took = ground.row.time - began
    commanded = program.steered[-1].time - began if program.steered else 0.0
    announced = any("commanding ends" in text for text in ground.texts)
    good = took <= 1.0 and commanded <= took and announced and ground.mode == mode
    return Try(f"mode {mode}", round(took, 2), good)


def _pass(program: Program, ground: Ground, chaser: Chaser, seconds: float) -> None:
    """Let so many seconds pass, one step at least."""
    until = ground.row.time + seconds
    heard = time.monotonic()
    while True:
        ground.sitl.beat()
        program.turn(0.0)
        for message in advance(ground.sitl, 1 if program.view.control.flies else 5):
            ground.hear(message)
            heard = time.monotonic()
        if time.monotonic() - heard > _STILL:
            raise RuntimeError(f"the simulation says nothing since {ground.row.time:.1f} s")
        chaser.report(ground.sitl, ground.row)
        if ground.row.time >= until:
            return


def ends(ways: Sequence[str], *, seed: int = 0, instance: int = 9) -> list[Try]:
    """Return what came of ends of the program."""
    tries: list[Try] = []
    with flight(instance, 1.0) as sitl:
        ground, chaser = Ground(sitl), Chaser(seed)
        while len(tries) < len(ways):
            end = _end(ways[len(tries)], ground, chaser)
            if end is not None:
                tries.append(end)
                print(f"{len(tries)}/{len(ways)} {end}", flush=True)
    return tries


def _end(way: str, ground: Ground, chaser: Chaser) -> Try | None:
    """End the program in one of :data:`WAYS` while it flies; None: it did not take over."""
    relay = Relay(ground.sitl.port + 2)
    with program_process(relay.address, full=way == "disk") as process:
        wait(ground, chaser, 12.0)
        chaser.add_crossing(ground.row, ground.course, _CROSSES)
        if not wait(ground, chaser, _CROSSES, lambda: ground.mode == Mode.GUIDED):
            return None
        wait(ground, chaser, 1.0)
        began = ground.row.time
        good = _flies_on(way, ground, chaser) and process.poll() is None
        if way == "cut":
            relay.cut()
        elif way == "deaf":
            relay.lose(to_program=True, to_autopilot=False)
        else:
            process.kill()
        handed_back = wait(ground, chaser, _WITHIN, lambda: ground.mode == Mode.AUTO)
        if way in ("kill", "cut", "deaf"):
            good = handed_back
        if way in ("cut", "deaf"):
            good = good and process.poll() is None
        took = ground.row.time - began
    relay.cut()
    chaser.leave()
    return Try(way, round(took, 1), good)


def _flies_on(way: str, ground: Ground, chaser: Chaser) -> bool:
    """Return whether the program flies on as it must before it is ended."""
    if way == "busy":
        return _keep_while_busy(ground, chaser)
    if way == "disk":
        return not wait(ground, chaser, _FLIES, lambda: ground.mode != Mode.GUIDED)
    return True


def _keep_while_busy(ground: Ground, chaser: Chaser) -> bool:
    """Let other processes take the processors for a while; return whether the separation was kept,
    or a loss was announced.
    """
    ground.texts.clear()
    least, until = math.inf, ground.row.time + _BUSY
    count = _BUSY_ONES * (os.cpu_count() or 1)
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        while ground.row.time < until:
            wait(ground, chaser, 0.2)
            least = min(least, chaser.distance(ground.row))
    finally:
        for process in others:
            process.kill()
            process.wait()
    texts = [text for text in ground.texts if text.startswith("RLCAS")]
    print(f"nearest {least:.0f} m; {texts}", flush=True)
    return least >= SEPARATION or any("late by" in text for text in texts)


def wait(
    ground: Ground, chaser: Chaser, seconds: float, reached: Callable[[], bool] = lambda: False
) -> bool:
    """Wait for so many seconds of the autopilot's time, or until something is reached; return
    whether it was.
    """
    until = ground.row.time + seconds
    while ground.row.time < until:
        ground.listen()
        chaser.report(ground.sitl, ground.row)
        if reached():
            return True
    return False


@contextmanager
def program_process(address: str, *, full: bool = False) -> "Generator[subprocess.Popen[bytes]]":
    """Give a running program; ``full``: whose log is on a full disk."""
    command = [sys.executable, "-m", "ros_bridge.mavlink", "--connect", address, "--simulated"]
    command += ["--separation", "200", "--fly", *KNOWN]
    log = Path("/dev/full" if full else "/dev/null")
    with log.open("w", encoding="utf-8") as log_file:
        process = subprocess.Popen(command, stdout=log_file, stderr=subprocess.DEVNULL)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


@contextmanager
def flight(instance: int, speedup: float) -> Generator[Sitl]:
    """Give an aircraft on a long mission."""
    with Sitl(instance, max(speedup, 10.0), FAILSAFE) as sitl:
        sitl.upload(LEGS)
        sitl.take_off()
        for kind, interval in ((33, 1e5), (0, 2e5)):
            sitl.rate(kind, interval)
        while sitl.wait("GLOBAL_POSITION_INT").relative_alt < 95_000:
            pass
        sitl.set("SIM_SPEEDUP", speedup)
        yield sitl


def main(arguments: Sequence[str] | None = None) -> int:
    """Try, and print."""
    parser = Parser(prog="python -m benchmarks.ardupilot.reach", description=__doc__)
    parser.add_argument("--modes", type=whole(0), default=50, help="foreign modes (default 50)")
    parser.add_argument(
        "--ends", type=whole(0), default=20, help="ends of the program (default 20)"
    )
    parser.add_argument("--seed", type=whole(0), default=0, help="seed of the moments (default 0)")
    names = ",".join(WAYS)
    parser.add_argument("--only", default=names, help=f"names with commas (default {names})")
    options = parser.parse_args(arguments)
    ways = parse_names(options.only, WAYS)
    by_mode = modes(options.modes, seed=options.seed) if options.modes else []
    by_end = ends([ways[n % len(ways)] for n in range(options.ends)]) if options.ends else []
    figures = {
        "benchmark": "ardupilot.reach",
        "modes": len(by_mode),
        "modes_good": sum(attempt.good for attempt in by_mode),
        "handed_back_s_max": max((attempt.seconds for attempt in by_mode), default=None),
    }
    for way in WAYS:
        tries = [attempt for attempt in by_end if attempt.case == way]
        figures |= {way: len(tries), f"{way}_good": sum(attempt.good for attempt in tries)}
    report(figures, ("pymavlink",))
    return 0 if all(attempt.good for attempt in (*by_mode, *by_end)) else 1


if __name__ == "__main__":
    from commands.command import run_cli

    run_cli("benchmarks.ardupilot.reach:main")
