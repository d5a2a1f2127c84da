"""A traffic display in the browser: moving map, alerts, bands, plan and backup, from ROS, live
ADS-B or a recording.

    python -m ros_bridge.display                         the ROS graph of this domain
    python -m ros_bridge.display flight.mcap             a recording of the demo
    python -m ros_bridge.display --adsb tcp://HOST:30003 --centre 47.46,8.55

    python -m ros_bridge.display --ros-args -r __ns:=/n123 -p use_sim_time:=true

It prints the address to open. The page is read only: nothing that a browser sends reaches an
aircraft, a node or a file.
"""

import argparse
import asyncio
import math
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path

from commands.command import InputError, Parser, visible
from ros_bridge.display.recording import read
from ros_bridge.display.server import DisplayServer, LiveSource, Recording, bind_socket
from ros_bridge.transport.children import FLAG, end_with_parent
from ros_bridge.transport.receivers import EXAMPLES, check_sources

__all__ = ["main"]

_LOCAL = "127.0.0.1"


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve what the command line asks for until Ctrl-C, and return the exit status."""
    own_arguments, ros = _split(sys.argv[1:] if arguments is None else list(arguments))
    options = _parser().parse_args(own_arguments)
    if ros and (options.recording or options.adsb):
        raise InputError("--ros-args goes with the ROS graph only, not with --adsb or a recording")
    if options.recording and options.adsb:
        raise InputError("a recording and --adsb are both given, expected one of them")
    if options.own and not options.adsb:
        raise InputError("--own goes with --adsb; the ROS graph says which aircraft is the ownship")
    if options.end_with_parent:
        end_with_parent()
    source, name, feeding = _source(options, ros)
    try:
        listener = bind_socket(options.host, options.port)
    except OSError as problem:
        raise InputError(
            f"--host {options.host} --port {options.port} cannot be used: {problem.strerror}"
        ) from None
    with listener, feeding, suppress(KeyboardInterrupt, asyncio.CancelledError):
        asyncio.run(_serve(source, name, listener))
    return 0


def _split(words: list[str]) -> tuple[list[str], list[str]]:
    place = words.index("--ros-args") if "--ros-args" in words else len(words)
    return words[:place], words[place:]


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m ros_bridge.display", description=__doc__)
    add = parser.add_argument
    add(
        "recording",
        nargs="?",
        type=Path,
        metavar="FILE",
        help="recording (.mcap) or encounter of eval.report --save (.json)",
    )
    add(
        "--adsb",
        type=_adsb,
        metavar="URL,...",
        help=f"live receivers with commas between them: {EXAMPLES}",
    )
    own = "address of the ownship among the receivers' aircraft (default: as they say)"
    add("--own", default="", metavar="HEX", help=own)
    add("--centre", type=_place, metavar="LAT,LON", help="centre of a map without ownship, deg")
    add(
        "--separation",
        type=_distance,
        metavar="M",
        help="drawn around the ownship, m (default: as the nodes say)",
    )
    add("--host", default=_LOCAL, help=f"address to listen at (default {_LOCAL})")
    add("--port", type=_port, default=8642, help="port, 0 for a free one (default 8642)")
    add(FLAG, action="store_true", help="end when standard input is closed")
    return parser


def _adsb(text: str) -> tuple[str, ...]:
    try:
        return check_sources(text)
    except ValueError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def _place(text: str) -> tuple[float, float]:
    try:
        latitude, longitude = map(float, text.split(","))
    except ValueError:
        latitude, longitude = math.nan, math.nan
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise argparse.ArgumentTypeError(
            f"{text!r}; expected latitude and longitude, degrees, such as 47.46,8.55"
        )
    return latitude, longitude


def _distance(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= 1e5:
        raise argparse.ArgumentTypeError(f"{text!r}; expected metres, more than 0 to 100000")
    return value


def _port(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and int(text) <= 65_535):
        raise argparse.ArgumentTypeError(f"{text!r}; expected a port, 0 to 65535")
    return int(text)


def _source(
    options: argparse.Namespace, ros: list[str]
) -> tuple[LiveSource | Recording, str, AbstractContextManager[object]]:
    """Return what is shown, its name, and what feeds it while it is entered."""
    if options.recording is not None:
        recording = read(options.recording, options.separation)
        if recording.cut:
            _say(f"{recording.cut}; what is whole before that is shown")
        return recording, recording.name, nullcontext()
    if options.adsb:
        from ros_bridge.display.adsb import Receiving

        live = LiveSource(centre=options.centre, separation=options.separation)
        try:
            receiving = Receiving(live, options.adsb, options.own)
        except ValueError as problem:
            raise InputError(f"--{problem}") from None
        return live, f"ADS-B of {', '.join(options.adsb)}", receiving
    from ros_bridge.display.graph import Listening

    listening = Listening(ros, options.centre, options.separation)
    return listening.live, "ROS", listening


async def _serve(source: LiveSource | Recording, name: str, listener: socket.socket) -> None:
    """Serve until a signal ends it."""
    display = DisplayServer(source, visible(name), _say)
    task = asyncio.current_task()
    assert task is not None
    for ending in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(ending, task.cancel)
    address, port, *_ = listener.getsockname()
    host = f"[{address}]" if ":" in address else address
    await display.serve(listener, lambda: print(f"http://{host}:{port}/", flush=True))


def _say(sentence: str) -> None:
    print(visible(sentence), file=sys.stderr, flush=True)
