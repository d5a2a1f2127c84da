"""Encounters flown by the mission alone, by ArduPilot's own avoidance, and by us.

    python -m benchmarks.ardupilot [--encounters 200] [--climbing] [--only NAME,NAME]
        [--workers N] [--out DIR] [--anew]

Each encounter (:mod:`benchmarks.ardupilot.encounters`) is flown by ArduPlane in its simulation,
which RLCAS_SITL names (docs/howto/mavlink.md): ``mission`` passes over the traffic, ``climb``,
``sideways`` and ``perpendicular`` are ArduPilot's own avoidance by height, horizontally and both at
once. ``ours`` is the program with --fly and --maneuvers both, told the accuracies that a good
receiver gives (:data:`ros_bridge.mavlink.flight.KNOWN`), ``ours_horizontal`` the same at the
mission's height; ``ours_altitude`` is told only that the traffic's altitudes are above mean sea
level, and ``ours_unknown`` is the program at its defaults: they take what is unknown as the worst.
With --climbing the intruders climb or descend through the mission's height. A loss is an aircraft
nearer than 200 m while within 50 m of the height. The simulation stands still while the program
computes. Every flight is a line of ``flights.jsonl``; the same command goes on after the last one.
Flights that ``flights.jsonl``, with --climbing ``climbing.jsonl``, beside this module holds are not
flown again. The last line is one JSON object.
"""

import argparse
import json
import math
import multiprocessing
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.ardupilot.encounters import encounter
from benchmarks.measure import Kind, parse_names, read_done, report
from commands.command import Parser, real, whole
from commands.json_text import parse_json
from eval.runner.workers import processes
from ros_bridge.mavlink.flight import AVOIDANCES, BEGIN, OURS, SEPARATION, Encounter, Result, fly
from ros_bridge.mavlink.sitl import LAST_INSTANCE, SitlError, folder

if TYPE_CHECKING:
    from multiprocessing.queues import SimpleQueue

METHODS = "mission", *AVOIDANCES, *OURS
_FILE = "flights.jsonl"
_STORED = "climbing.jsonl", "flights.jsonl"  # beside this module
_LATE = 120.0  # s after the mission alone, within which it must have arrived
_TRIES = 6
_STALL = 3.0  # s of its time that the simulation may go on unseen

Row = dict[str, Any]


KINDS = (
    Kind("all", lambda row: True),
    Kind("one aircraft", lambda row: row["aircraft"] == 1),
    Kind("two aircraft", lambda row: row["aircraft"] == 2),
    Kind("three aircraft", lambda row: row["aircraft"] == 3),
    Kind("some turn", lambda row: row["turning"] > 0),
    Kind("none turns", lambda row: row["turning"] == 0),
    Kind("wind 4 m/s and more", lambda row: row["wind"] >= 4.0),
    Kind("a fence", lambda row: row["fence"]),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly what is missing, and print the table."""
    options = _parser().parse_args(arguments)
    folder()
    options.out.mkdir(parents=True, exist_ok=True)
    methods = parse_names(options.only, METHODS)
    settings: Row = {"seed": options.seed, "separation_m": SEPARATION}
    if options.climbing:
        settings["climbing"] = True
    rows = read_done(options.out / _FILE, settings)
    if not options.anew:
        rows += stored_flights(settings, rows)
    flown = {(row["number"], row["method"]) for row in rows}
    missing = [
        (number, method)
        for number in range(options.encounters)
        for method in methods
        if (number, method) not in flown
    ]
    try:
        with (options.out / _FILE).open("a", encoding="utf-8") as file:
            for row in _flights(missing, options):
                rows.append(row)
                print(json.dumps(row), file=file, flush=True)
                print(json.dumps(row), flush=True)
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was flown", file=sys.stderr)
    chosen = [
        row for row in rows if row["number"] < options.encounters and row["method"] in methods
    ]
    complete = _complete(chosen, len(methods))
    print(table(complete))
    report(
        {"benchmark": "ardupilot", **settings, "encounters": len(complete) // len(methods)}
        | {"rows": figures(complete)},
        ("pymavlink",),
    )
    return 0


def _flights(missing: Sequence[tuple[int, str]], options: argparse.Namespace) -> Iterator[Row]:
    """Fly encounters, given by their numbers, by methods, and yield the line of each when it is
    flown; an interrupt ends those under way.
    """
    if options.workers == 1:
        yield from (_line(*flight_key, options) for flight_key in missing)
        return
    instances = multiprocessing.get_context("spawn").SimpleQueue()
    for number in range(options.workers):
        instances.put(options.instance + number)
    with processes(options.workers, _begin, instances, options) as pool:
        flights = [pool.submit(_work, *flight_key) for flight_key in missing]
        yield from (flight.result() for flight in as_completed(flights))


_OPTIONS: list[argparse.Namespace] = []  # of a worker, with an instance of its own


def _begin(instances: "SimpleQueue[int]", options: argparse.Namespace) -> None:
    signal.signal(signal.SIGTERM, _end)
    options.instance = instances.get()
    _OPTIONS.append(options)


def _end(*_: object) -> None:
    """End the flight under way together with its simulation, and begin no other."""
    _OPTIONS.clear()
    raise KeyboardInterrupt


def _work(number: int, method: str) -> Row:
    return _line(number, method, _OPTIONS[0])


def _line(number: int, method: str, options: argparse.Namespace) -> Row:
    drawn = encounter(options.seed, number, climbing=options.climbing)
    flight = fly_encounter(drawn, method, instance=options.instance, speedup=options.speedup)
    return row_of(drawn, method, flight)


def fly_encounter(encounter: Encounter, method: str, *, instance: int, speedup: float) -> Result:
    """Fly an encounter by a method to the mission's goal."""
    until = (encounter.goal - BEGIN) / encounter.cruise + _LATE
    return fly_seen(encounter, method, instance=instance, speedup=speedup, until=until)


def fly_seen(encounter: Encounter, method: str, **more: Any) -> Result:
    """Fly as :func:`ros_bridge.mavlink.flight.fly` does; on a busy machine a simulation may start
    too late, or go on unseen, and is tried again.
    """
    tries_left = _TRIES
    while True:
        tries_left -= 1
        try:
            return fly(encounter, method, stall=_STALL, **more)
        except (SitlError, RuntimeError) as problem:
            if not tries_left:
                raise
            print(f"encounter {encounter.number} {method}: {problem}; again", file=sys.stderr)


def row_of(encounter: Encounter, method: str, flight: Result) -> Row:
    """Return the line of a flight; lengths in m, times in s."""
    across = [abs(period.cross_track) for period in flight.steered]
    along = [abs(period.along_track) for period in flight.steered]
    above = [abs(period.above) for period in flight.steered if not math.isnan(period.above)]
    return {
        "number": encounter.number,
        "method": method,
        "aircraft": len(encounter.intruders),
        "turning": sum(intruder.turn != 0.0 for intruder in encounter.intruders),
        "wind": round(encounter.wind, 2),
        "fence": bool(encounter.fence),
        "separation": round(flight.separation, 1),
        "lost": flight.lost,
        "breached": flight.breached,
        "arrived": None if flight.arrived is None else round(flight.arrived, 1),
        "flown": round(flight.rows[-1].time, 1),
        "on_mission": round(flight.on_mission, 1),
        "on_track": round(flight.on_track, 1),
        "at_height": round(flight.at_height, 1),
        "path": round(flight.path),
        "taken_over": flight.taken_over,
        "across": round(max(across), 2) if across else None,
        "along": round(max(along), 2) if along else None,
        "above": round(max(above), 2) if above else None,
        "texts": [text for text in flight.texts if text.startswith("RLCAS")],
    }


def stored_flights(settings: Row, rows: Sequence[Row]) -> list[Row]:
    """Return the flights that are stored beside this module, without those that rows hold; none
    where they were asked for something else.
    """
    stored: list[Row] = []
    for name in _STORED:
        first, *lines = Path(__file__).with_name(name).read_text(encoding="utf-8").splitlines()
        stored += [parse_json(line) for line in lines if parse_json(first) == settings]
    flown = {(row["number"], row["method"]) for row in rows}
    return [row for row in stored if (row["number"], row["method"]) not in flown]


def _complete(rows: Sequence[Row], methods: int) -> list[Row]:
    """Return the flights of those encounters that each of so many methods has flown."""
    numbers = [row["number"] for row in rows]
    return [row for row in rows if numbers.count(row["number"]) == methods]


def figures(rows: Sequence[Row]) -> list[Row]:
    """Return what each method did in each kind of encounters."""
    lines: list[Row] = []
    for kind in KINDS:
        for method in METHODS:
            flights = [row for row in rows if row["method"] == method and kind.holds(row)]
            if not flights:
                continue
            lines.append({"kind": kind.name, "method": method} | _figures(flights))
    return lines


def _figures(flights: Sequence[Row]) -> Row:
    arrived = [row for row in flights if row["arrived"] is not None]
    return {
        "flights": len(flights),
        "losses": sum(row["lost"] for row in flights),
        "breaches": sum(row["breached"] for row in flights),
        "arrivals": len(arrived),
        "least_separation_m": min(row["separation"] for row in flights),
        "path_m": _mean([row["path"] for row in arrived]),
        "on_mission": _mean([row["on_mission"] / row["flown"] for row in flights]),
        "on_track": _mean([row["on_track"] / row["flown"] for row in flights if "on_track" in row]),
        "at_height": _mean(
            [row["at_height"] / row["flown"] for row in flights if "at_height" in row]
        ),
        "across_m": max((row["across"] or 0.0 for row in flights), default=0.0),
        "along_m": max((row["along"] or 0.0 for row in flights), default=0.0),
        "above_m": max((row.get("above") or 0.0 for row in flights), default=0.0),
    }


def table(rows: Sequence[Row]) -> str:
    """Return the figures as a table."""
    lines = [
        f"{'':20} {'':15} flights losses geofence violations arrivals  least, m  path, m  "
        "in AUTO, %  on its track, %"
    ]
    for line in figures(rows):
        path = "-" if line["path_m"] is None else f"{line['path_m']:.0f}"
        track = "-" if line["on_track"] is None else f"{100.0 * line['on_track']:.0f}"
        lines.append(
            f"{line['kind']:20} {line['method']:15} {line['flights']:7} {line['losses']:6} "
            f"{line['breaches']:19} {line['arrivals']:8} {line['least_separation_m']:10.0f} "
            f"{path:>8} {100.0 * line['on_mission']:11.0f} {track:>16}"
        )
    return "\n".join(lines)


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _parser() -> Parser:
    parser = Parser(prog="python -m benchmarks.ardupilot", description=__doc__)
    add = parser.add_argument
    add("--encounters", type=whole(1), default=200, help="encounters to fly (default 200)")
    add("--seed", type=whole(0), default=0, help="seed of the encounters (default 0)")
    add("--climbing", action="store_true", help="the intruders climb or descend")
    names = ",".join(METHODS)
    add("--only", default=names, help=f"methods with commas (default {names})")
    folder = Path("runs/ardupilot")
    add("--out", type=Path, default=folder, help=f"folder of the flights (default {folder})")
    add("--anew", action="store_true", help="fly those again that have been flown")
    add(
        "--speedup",
        type=real(1.0, 1_000.0),
        default=40.0,
        help="simulated over real time, at most (default 40)",
    )
    add(
        "--instance",
        type=whole(0, LAST_INSTANCE),
        default=5,
        help="number of the simulation, or of the first worker's, which sets its ports (default 5)",
    )
    add("--workers", type=whole(1), default=1, help="simulations side by side (default 1)")
    return parser
