"""Missions beside ICAROUS: ``python -m benchmarks.icarous --icarous DIR [--missions 200]``.

Each mission of a small UAS (:mod:`benchmarks.icarous.missions`) has fences, intruders and wind. It
is flown by NASA's ICAROUS in its own fast-time simulation and by our monitor and planner in ours,
with the same limits, separation and aircraft; one judge looks at where all were. Every flight is a
line of ``flights.jsonl`` in --out; the same command goes on after the last one. The last line of
the output is one JSON object.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from benchmarks.icarous import ours, peer
from benchmarks.icarous.figure import drawing
from benchmarks.icarous.flights import Flight
from benchmarks.icarous.judge import MissionOutcome, judge
from benchmarks.icarous.missions import Mission, aircraft, mission
from benchmarks.measure import Kind, parse_names, policy_in_flight, read_done, report
from commands.command import Parser, require, whole
from commands.figures import save_figure
from commands.progress import Progress
from envs.aircraft import Aircraft

SIDES = "icarous", "ours"
_FILE = "flights.jsonl"

Row = dict[str, Any]


KINDS = (
    Kind("all", lambda row: True),
    Kind("solved by any", lambda row: row["any_solved"]),
    Kind("no fence", lambda row: row["fences"] == 0),
    Kind("fences", lambda row: row["fences"] > 0),
    Kind("no intruder", lambda row: row["intruders"] == 0),
    Kind("1 or 2 intruders", lambda row: 1 <= row["intruders"] <= 2),
    Kind("3 or 4 intruders", lambda row: row["intruders"] >= 3),
    Kind("wind 5 m/s and more", lambda row: row["wind"] >= 5.0),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly what is missing, and print the table."""
    options = _parser().parse_args(arguments)
    require("--out", "matplotlib")
    sides = parse_names(options.only, SIDES) if options.only else list(SIDES)
    home = peer.locate(options.icarous) if "icarous" in sides else None
    options.out.mkdir(parents=True, exist_ok=True)
    vehicle = aircraft()
    settings = {"seed": options.seed, "separation_m": vehicle.separation}
    rows = read_done(options.out / _FILE, settings)
    flown = {(row["number"], row["side"]) for row in rows}
    missing = [
        (number, side)
        for number in range(options.missions)
        for side in sides
        if (number, side) not in flown
    ]
    fly = _flyers(home, vehicle)
    try:
        with threadpool_limits(1):
            rows += _fly_missing(missing, fly, options, vehicle)
            if options.picture is not None:
                _draw(options, sides, fly, vehicle)
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was flown", file=sys.stderr)
        rows = read_done(options.out / _FILE, settings)
    counted = complete([row for row in rows if row["number"] < options.missions], sides)
    summary = figures(counted, sides)
    print(table(summary))
    report(
        {
            "benchmark": "icarous",
            **settings,
            "missions": len(counted) // len(sides),
            "rows": summary,
        },
        ("numpy",),
    )
    return 0


Flyer = Callable[[Mission], Flight]
"""Flies a mission by one of :data:`SIDES`."""


def _flyers(home: Path | None, vehicle: Aircraft) -> dict[str, Flyer]:
    rules = ours.rules(vehicle, policy_in_flight())
    flyers: dict[str, Flyer] = {"ours": lambda mission: ours.fly(mission, rules)}
    if home is not None:
        flyers["icarous"] = lambda mission: peer.fly(mission, vehicle, home)
    return flyers


def _fly_missing(
    missing: Sequence[tuple[int, str]],
    fly: dict[str, Flyer],
    options: argparse.Namespace,
    vehicle: Aircraft,
) -> list[Row]:
    """Fly missions, given by their numbers, by sides, write each line down and return the lines."""
    rows, progress = list[Row](), Progress("flights")
    with progress.start(len(missing)), (options.out / _FILE).open("a", encoding="utf-8") as file:
        for count, (number, side) in enumerate(missing, 1):
            drawn = mission(options.seed, number, vehicle.separation)
            began = time.perf_counter()
            flight = fly[side](drawn)
            outcome = judge(drawn, flight.track, vehicle.separation, vehicle.goal_radius)
            rows.append(
                row_of(drawn, side, flight, outcome) | {"wall": time.perf_counter() - began}
            )
            print(json.dumps(rows[-1]), file=file, flush=True)
            progress.show(count, f"mission {number} by {side}")
    return rows


def row_of(mission: Mission, side: str, flight: Flight, outcome: MissionOutcome) -> Row:
    """Return the line of a flight; lengths in m, times in s, None for what there is not."""
    first = min(
        (when for when in (outcome.lost_at, outcome.breached_at) if math.isfinite(when)),
        default=math.nan,
    )
    at = flight.track.time <= first
    promised = bool(flight.promised[at][-1]) if at.any() else False
    numbers = {name: getattr(outcome, name) for name in MissionOutcome._fields}
    return {
        "number": mission.number,
        "side": side,
        "intruders": len(mission.intruders),
        "fences": len(mission.fences),
        "wind": float(mission.wind.speed),
        **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
        "solved": outcome.solved,
        "promised": promised,  # whether what was violated was violated on a plan called SAFE
        "slowest": flight.slowest if math.isfinite(flight.slowest) else None,
        "ended": flight.ended,
    }


def complete(rows: Sequence[Row], sides: Sequence[str]) -> list[Row]:
    """Return the flights of those missions that every side has flown, each with whether any side
    solved its mission.
    """
    completed: list[Row] = []
    for number in sorted({row["number"] for row in rows}):
        same = [row for row in rows if row["number"] == number and row["side"] in sides]
        if len(same) == len(sides):
            solved = any(row["solved"] for row in same)
            completed += [row | {"any_solved": solved} for row in same]
    return completed


def figures(rows: Sequence[Row], sides: Sequence[str]) -> list[Row]:
    """Return what each side did in each kind of missions."""
    summary: list[Row] = []
    for kind in KINDS:
        for side in sides:
            flights = [row for row in rows if row["side"] == side and kind.holds(row)]
            if flights:
                summary.append({"kind": kind.name, "side": side} | _figures(flights))
    return summary


def _figures(flights: Sequence[Row]) -> Row:
    arrived = [row for row in flights if row["arrived"] is not None]
    solved = [row["excess"] for row in flights if row["solved"]]
    return {
        "missions": len(flights),
        "losses": sum(row["lost"] > 0 for row in flights),
        "breaches": sum(row["breached"] > 0 for row in flights),
        "arrivals": len(arrived),
        "solved": len(solved),
        "promised": sum(row["promised"] for row in flights),
        "excess": sum(solved) / len(solved) if solved else None,
        "slowest_s": max((row["slowest"] for row in flights if row["slowest"]), default=None),
        "unanswered": sum(bool(row["ended"]) for row in flights),
    }


HEAD = (
    "missions",
    "by",
    "flights",
    "with a loss",
    "with a geofence violated",
    "arrived",
    "solved",
    "extra track distance, %",
    "slowest answer, s of the processor",
    "violated while called SAFE",
)


def table(rows: Sequence[Row]) -> str:
    """Return the figures as a table."""
    lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for row in rows:
        excess = "" if row["excess"] is None else f"{100.0 * row['excess']:.1f}"
        slowest = "" if row["slowest_s"] is None else f"{row['slowest_s']:.2f}"
        promised = str(row["promised"]) if row["side"] == "ours" else ""
        counts = [row[name] for name in ("missions", "losses", "breaches", "arrivals", "solved")]
        cells = [row["kind"], row["side"], *map(str, counts), excess, slowest, promised]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _draw(
    options: argparse.Namespace, sides: Sequence[str], fly: dict[str, Flyer], vehicle: Aircraft
) -> None:
    """Fly one mission by the sides and draw it."""
    drawn = mission(options.seed, options.picture, vehicle.separation)
    flights = {side: fly[side](drawn).track for side in sides}
    save_figure(
        drawing(drawn, flights, vehicle), options.out / f"mission_{options.picture}", dpi=130
    )


def _parser() -> Parser:
    parser = Parser(prog="python -m benchmarks.icarous", description=__doc__)
    add = parser.add_argument
    add("--icarous", metavar="DIR", help=f"ICAROUS, as built (default: ${peer.VARIABLE})")
    add("--missions", type=whole(0), default=200, help="missions to fly (default 200)")
    add("--seed", type=whole(0), default=0, help="seed of the missions (default 0)")
    add("--only", help=f"sides that fly, with commas (default {','.join(SIDES)})")
    folder = Path("runs/icarous")
    add("--out", type=Path, default=folder, help=f"folder of the flights (default {folder})")
    add("--picture", type=whole(0), metavar="N", help="number of a mission to fly and draw too")
    return parser
