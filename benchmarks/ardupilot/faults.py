"""What fails around the program, each fault tried once in ArduPlane's simulation.

    python -m benchmarks.ardupilot.faults [--only NAME,NAME]

One crossing encounter is flown by the program with --fly for each fault (``--help`` names them),
and told in a line of JSON: the smallest distance, when which mode began, and what was said.
"""

import json
import math
import random
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from benchmarks.ardupilot.relay import Keep, Relay
from benchmarks.measure import parse_names, report
from commands.command import InputError, Parser
from ros_bridge.mavlink.flight import Encounter, Intruder, Result, Row, fly
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.sitl import Sitl, SitlError, folder

_UNTIL = 120.0  # s
_SPELL = 30.0, 45.0  # s in which it fails, while the plan is flown
_CROSSING = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
_POSITION = 33  # GLOBAL_POSITION_INT
_JUMP = 0.003  # degrees of latitude
_BLIND = 8.0  # s without it
_STALL, _SLUGGISH = 2_000, 900  # ms that the program sleeps each time
_INSTANCE = 11

_SET_MODE = 176  # MAV_CMD_DO_SET_MODE

Watch = Callable[[Sitl, float, Row], None]
"""Called with the simulation, the time of the flight, s, and where the aircraft is."""


class Fault(NamedTuple):
    """What fails, and how."""

    help: str
    watch: Watch | None = None
    keep: Keep | None = None  # of a link that loses messages
    parameters: Mapping[str, float] = {}


class _Times:
    """Does things once, each at its time."""

    def __init__(self, *steps: tuple[float, Callable[[Sitl], object]]) -> None:
        self._steps = list(steps)

    def __call__(self, sitl: Sitl, seconds: float, row: Row) -> None:
        """Do what is due."""
        while self._steps and seconds >= self._steps[0][0]:
            self._steps.pop(0)[1](sitl)


class _Blind:
    """Loses the positions for a while."""

    def __init__(self) -> None:
        self._lost = False

    def watch(self, sitl: Sitl, seconds: float, row: Row) -> None:
        """Lose them while it is time."""
        self._lost = _SPELL[0] <= seconds < _SPELL[0] + _BLIND

    def keep(self, number: int) -> bool:
        """Return whether a message passes."""
        return not (self._lost and number == _POSITION)


def _parameter(name: bytes, value: float) -> Callable[[Sitl], None]:
    return lambda sitl: sitl.station.mav.param_set_send(1, 1, name, value, 9)


def _mode(mode: int) -> Callable[[Sitl], None]:
    return lambda sitl: sitl.command(_SET_MODE, 1.0, float(mode))


def _step_the_date(sitl: Sitl) -> None:
    sitl.station.mav.system_time_send(int((time.time() + 3_600.0) * 1e6), 0)


def _beat_as_another(sitl: Sitl, seconds: float, row: Row) -> None:
    """Speak as a second ground station, of another number, on the same link."""
    mav = sitl.station.mav
    mav.srcSystem = 254
    mav.heartbeat_send(6, 8, 0, 0, 0)
    mav.srcSystem = 255


def _twin(sitl: Sitl, seconds: float, row: Row) -> None:
    """Report another aircraft under the first one's address, 3 km to the south of it."""
    if seconds % 1.0 < 0.15:
        east = 1_100.0 + 22.0 * _CROSSING.cpa
        north = 25.0 * (_CROSSING.cpa - seconds) - 3_000.0
        sitl.traffic(0xA00001, east, north, 180.0, 25.0, 620.0)


def _beat_in_version_1(sitl: Sitl, seconds: float, row: Row) -> None:
    """Speak MAVLink 1 from the ground station too."""
    mav = sitl.station.mav
    mav.send(mav.heartbeat_encode(6, 8, 0, 0, 0), force_mavlink1=True)


def _stall(sitl: Sitl, seconds: float, row: Row, sleep: int = _STALL) -> None:
    """Let the simulation go on without the program for so many ms."""
    if not _SPELL[0] <= seconds < _SPELL[1]:
        return
    with sitl.awake():
        began = sitl.wait("GLOBAL_POSITION_INT").time_boot_ms
        while sitl.wait("GLOBAL_POSITION_INT").time_boot_ms < began + sleep:
            pass


def faults() -> dict[str, Fault]:
    """Return every fault, fresh."""
    blind, draw = _Blind(), random.Random(0)
    two_modes = _Times((_SPELL[0], _mode(Mode.LOITER)), (_SPELL[0] + 2.0, _mode(Mode.AUTO)))
    gps = _Times(
        (_SPELL[0], _parameter(b"SIM_GPS1_ENABLE", 0.0)),
        (_SPELL[1], _parameter(b"SIM_GPS1_ENABLE", 1.0)),
    )
    jump = _Times(
        (_SPELL[0], _parameter(b"SIM_GPS1_GLTCH_X", _JUMP)),
        (_SPELL[1], _parameter(b"SIM_GPS1_GLTCH_X", 0.0)),
    )
    return {
        "none": Fault("nothing"),
        "stale": Fault("no GLOBAL_POSITION_INT for 8 s", blind.watch, blind.keep),
        "gps": Fault("SIM_GPS1_ENABLE is 0 for 15 s", gps),
        "jump": Fault("the satellites' position is 330 m off for 15 s", jump),
        "slow": Fault("the program runs only every two seconds, for 15 s", _stall),
        "sluggish": Fault(
            "the program runs only every 0.9 s, for 15 s", partial(_stall, sleep=_SLUGGISH)
        ),
        "lossy": Fault("a tenth of the messages is lost", keep=lambda _: draw.random() >= 0.1),
        "twins": Fault("two aircraft report under one address", _twin),
        "stations": Fault("a second ground station speaks", _beat_as_another),
        "version1": Fault("the ground station speaks version 1 too", _beat_in_version_1),
        "disagree": Fault("LOITER is set, and two seconds later AUTO", two_modes),
        "avoidance": Fault(
            "AVD_ENABLE is set", _Times((_SPELL[0], _parameter(b"AVD_ENABLE", 1.0)))
        ),
        "date": Fault("the date steps by an hour", _Times((_SPELL[0], _step_the_date))),
        "rtl": Fault("RTL is set", _Times((_SPELL[0], _mode(Mode.RTL)))),
        "mavlink1": Fault(
            "the autopilot's port speaks version 1", parameters={"SERIAL1_PROTOCOL": 1.0}
        ),
    }


def row_of(name: str, flight: Result) -> dict[str, Any]:
    """Return the line of a flight."""
    modes: list[tuple[float, int]] = []
    for row in flight.rows:
        if not modes or modes[-1][1] != row.mode:
            modes.append((round(row.time, 1), row.mode))
    return {
        "fault": name,
        "separation_m": round(flight.separation, 1),
        "modes": modes,
        "texts": [text for text in flight.texts if "EKF" not in text],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Try each, and print."""
    all_faults = faults()
    parser = Parser(prog="python -m benchmarks.ardupilot.faults", description=__doc__)
    names = "; ".join(f"{name}: {fault.help}" for name, fault in all_faults.items())
    parser.add_argument("--only", default=",".join(all_faults), help=f"names with commas ({names})")
    options = parser.parse_args(arguments)
    folder()
    rows: list[dict[str, Any]] = []
    for name in parse_names(options.only, all_faults):
        rows.append(_try(name, all_faults[name]))
        print(json.dumps(rows[-1]), flush=True)
    report({"benchmark": "ardupilot.faults", "rows": rows}, ("pymavlink",))
    return 0


def _try(name: str, fault: Fault) -> dict[str, Any]:
    """Fly the encounter with a fault, and return its line."""
    relay = None if fault.keep is None else Relay(5_762 + 10 * _INSTANCE, fault.keep)
    try:
        flight = fly(
            Encounter(0, (_CROSSING,), 0.0, 300.0),
            "ours_horizontal",
            instance=_INSTANCE,
            # What a relay does not pass on in time looks like a link that is lost.
            speedup=40.0 if relay is None else 5.0,
            until=_UNTIL,
            more=() if relay is None else ("--connect", relay.address),
            watch=fault.watch,
            parameters=fault.parameters,
        )
        return row_of(name, flight)
    except (InputError, SitlError, RuntimeError) as problem:
        return {"fault": name, "refused": str(problem)}
    finally:
        if relay is not None:
            relay.cut()


if __name__ == "__main__":
    from commands.command import run_cli

    run_cli("benchmarks.ardupilot.faults:main")
