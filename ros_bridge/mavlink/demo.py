"""One encounter flown by ArduPlane's own simulation, and a picture of it, within two minutes.

    python -m ros_bridge.mavlink.demo [--wind 4] [--out encounter.png] [--record FILE.mcap]
        [--display]

Starts the simulation that RLCAS_SITL names, flies a mission towards a crossing aircraft whose
reports go to the autopilot as a receiver's do, and lets the program fly round it. The simulation
stands still while the program computes. ``python -m ros_bridge.display FILE.mcap`` shows the
recording again.

Exit code: 0 if the separation was kept and the mission flown on, 1 if not, 2 for bad input.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from commands.command import InputError, Parser, require, run_cli
from ros_bridge.mavlink.flight import SEPARATION, Encounter, Intruder, fly
from ros_bridge.mavlink.flight_picture import draw
from ros_bridge.mavlink.messages import Mode
from ros_bridge.mavlink.options import check_folder, options_of
from ros_bridge.mavlink.sitl import LAST_INSTANCE

_UNTIL = 160.0  # s
_STRONGEST = 8.0  # m/s of wind


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the encounter and return the exit code."""
    options = _parser().parse_args(arguments)
    if not 0.0 <= options.wind <= _STRONGEST:
        raise InputError(f"--wind is {options.wind:g} m/s; expected 0 to {_STRONGEST:g} m/s")
    crossing = Intruder(-0.5 * math.pi, 25.0, 60.0, 0.0)
    encounter = Encounter(0, (crossing,), options.wind, 300.0)
    extra = () if options.display is None else ("--display", options.display)
    extra += () if options.record is None else ("--record", str(options.record))
    options_of(["--connect", "tcp:127.0.0.1:5760", *extra])  # refuses before anything flies
    _check_picture(options.out)
    flight = fly(encounter, "ours_horizontal", instance=options.instance, until=_UNTIL, more=extra)
    for text in flight.texts:
        if text.startswith("RLCAS"):
            print(text)
    succeeded = not flight.lost and flight.taken_over > 0 and flight.rows[-1].mode == Mode.AUTO
    print(
        f"smallest distance {flight.separation:.0f} m, to be kept {SEPARATION:g} m; "
        f"{flight.on_mission:.0f} of {flight.rows[-1].time:.0f} s in AUTO"
    )
    draw(encounter, flight, options.out)
    print(f"picture: {options.out}")
    if options.record is not None:
        print(f"recorded: {options.record} ({options.record.stat().st_size / 1e6:.1f} MB)")
    return 0 if succeeded else 1


def _check_picture(file: Path) -> None:
    """Raise :class:`InputError` where the picture could not be written after the flight."""
    require("--out", "matplotlib")
    from matplotlib.backend_bases import FigureCanvasBase

    check_folder("out", file)
    kinds = FigureCanvasBase.get_supported_filetypes()
    if file.suffix.lower().removeprefix(".") not in kinds:
        raise InputError(f"--out {file}: expected a name that ends in .{', .'.join(kinds)}")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m ros_bridge.mavlink.demo", description=__doc__)
    parser.add_argument(
        "--wind", type=float, default=0.0, help="wind from 300 deg, m/s (default 0)"
    )
    picture = Path("encounter.png")
    parser.add_argument("--out", type=Path, default=picture, help=f"picture (default {picture})")
    ports = f"10 times this, 0 to {LAST_INSTANCE}, is added to the simulation's ports (default 0)"
    parser.add_argument(
        "--display",
        nargs="?",
        const="127.0.0.1:8642",
        metavar="HOST:PORT",
        help="serve the traffic display meanwhile (default address 127.0.0.1:8642)",
    )
    parser.add_argument(
        "--record", type=Path, metavar="FILE.mcap", help="record it (default: no recording)"
    )
    parser.add_argument("--instance", type=int, default=0, help=ports)
    return parser


if __name__ == "__main__":
    run_cli("ros_bridge.mavlink.demo:main")
