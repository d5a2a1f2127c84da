"""The report of an evaluation as one page: ``python -m eval.report runs/first`` writes
``runs/first/report.html``.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import ConfigError, Parser
from commands.command import whole
from commands.files import write_file, write_whole
from commands.installation import versions
from commands.progress import Progress
from eval.flights.among_areas import outlines
from eval.flights.chunks import Evaluation
from eval.report.bands import encounter_data, wind_data
from eval.report.data import Choice, choose, flight_data, page_data, points
from eval.report.flights import Replayed, evaluation_of, fly_again
from eval.report.folder import Run, read_run
from eval.report.page import page
from eval.runner.options import extension_option, load_extensions, run_argument

_DESCRIPTION = """\
Write report.html into a folder that eval.monte_carlo wrote: the numbers with their intervals, the
figures, and the encounters, to be filtered and replayed. It is one file that needs no network.

Failures, close successes and a sample of the other encounters are flown again for the replay."""

_EPILOG = """\
examples:
  python -m eval.report runs/circle
  python -m eval.report runs/circle --show 4711,4712      with tracks of these encounters too
  python -m eval.report runs/circle --save 4711      and encounters/4711.json for rlcas-display
  python -m eval.report runs/circle --tracks 0       nothing is flown: no policy is needed"""

_MOST_WITNESSES = 100
_BANDS = 200  # encounters with bands, unless it is said


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    if options.run is None:
        raise ConfigError("DIR: expected the folder of a finished run")
    load_extensions(options.extension)
    run = read_run(options.run)
    for option, numbers in {"--show": options.show, "--save": options.save}.items():
        if numbers and max(numbers) >= len(run.kinds):
            raise ConfigError(
                f"{option}: {max(numbers)}; expected numbers of encounters, 0 to "
                f"{len(run.kinds) - 1}"
            )
    try:
        with write_whole(options.run / "report.html") as temporary:
            text = _make_report(run, options)
            temporary.write_bytes(text.encode())
    except OSError as problem:
        raise ConfigError(f"{problem.filename}: cannot be written: {problem.strerror}") from None
    print(f"{options.run / 'report.html'}: {len(text.encode()) / 1e6:.1f} MB")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.report", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    run_argument(parser, "folder of the run; report.html in it is replaced")
    most = "most encounters to replay (default: 1000)"
    add("--tracks", type=whole(0, 100_000), default=1_000, metavar="N", help=most)
    add(
        "--show",
        type=_numbers,
        default=[],
        metavar="N,...",
        help="numbers of encounters to replay in any case",
    )
    add(
        "--bands",
        type=whole(0, 100_000),
        default=_BANDS,
        metavar="N",
        help=f"most encounters with guidance bands in their replay (default: {_BANDS})",
    )
    add(
        "--save",
        type=_numbers,
        default=[],
        metavar="N,...",
        help="write these encounters into DIR/encounters, for rlcas-display",
    )
    add(
        "--policy",
        type=Path,
        metavar="FILE",
        help="policy file, if it has moved (default: as in config.yaml)",
    )
    extension_option(parser)
    return parser


def _numbers(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdecimal() and len(part) <= 9 for part in parts):
        raise argparse.ArgumentTypeError(
            f"{text!r}; expected numbers of encounters with commas between them"
        )
    return list(dict.fromkeys(int(part) for part in parts))


def _make_report(run: Run, options: argparse.Namespace) -> str:
    requested = list(dict.fromkeys([*options.show, *options.save]))
    if len(requested) > options.tracks:
        raise ConfigError(
            f"--show, --save: {len(requested)} encounters; expected at most --tracks "
            f"{options.tracks}"
        )
    chosen = choose(run, options.tracks, requested)
    evaluation = evaluation_of(run, options.policy) if options.tracks else None
    flights = {} if evaluation is None else _flights(run, evaluation, chosen, options)
    shown = points(run, np.array(sorted(flights), dtype=int))
    version_of = versions("numpy")
    by = ", ".join(f"{name} {version_of[name]}" for name in ("rlcas-toolkit", "numpy"))
    return page(run, chosen, page_data(run, shown, flights), by)


def _flights(
    run: Run, evaluation: Evaluation, chosen: Sequence[Choice], options: argparse.Namespace
) -> dict[int, dict[str, Any]]:
    """Fly the chosen encounters and return what the page shows of each, by number; those to be
    saved are.
    """
    numbers = [int(number) for choice in chosen for number in choice.numbers]
    possible = run.table["verdict"] != "unresolvable"
    failed = [number for number in numbers if run.kinds[number] != "success" and possible[number]]
    saved = set(options.save)
    banded = saved | set(numbers[: options.bands])
    flights: dict[int, dict[str, Any]] = {}
    flying = fly_again(run, evaluation, numbers, set(failed[:_MOST_WITNESSES]), banded)
    with Progress("encounters").start(len(numbers)) as progress:
        for flight in flying:
            flights[flight.number] = flight_data(flight)
            if flight.number in saved:
                _save(run, evaluation, flight)
            progress.show(len(flights), "flown again")
    for number in sorted(saved - set(flights)):
        print(f"warning: --save: encounter {number} has no flight, not saved", file=sys.stderr)
    differing = sum("differs" in flight for flight in flights.values())
    if differing:
        why = "another machine or other versions; they are marked on the page"
        print(
            f"warning: {differing} of {len(flights)} flights end otherwise than in the table "
            f"({why})",
            file=sys.stderr,
        )
    return flights


def _save(run: Run, evaluation: Evaluation, flight: Replayed) -> None:
    """Write a flight as an encounter for the traffic display (docs/reference/display.md)."""
    track, rules = flight.track, run.rules
    places = np.concatenate([track.own[None], track.intruders]).round(2)
    own, *intruders = ({"x": x.tolist(), "y": y.tolist()} for x, y in places)
    if track.required is not None:
        for intruder, required in zip(intruders, track.required, strict=True):
            intruder["separation"] = round(float(required), 2)
    plan = None
    if flight.plan is not None:
        plan = dict(zip(("x", "y", "time"), flight.plan.round(2).tolist(), strict=True))
    assert flight.bands is not None
    document = {
        "format": "rlcas-encounter",
        "version": 1,
        "name": f"{run.summary['scenario']} {flight.number}",
        "dt": rules.dt,
        "separation": rules.separation,
        "goal": list(track.goal),
        "goal_radius": rules.goal_radius,
        "own": own,
        "intruders": intruders,
        "plan": plan,
        "areas": [
            {
                "name": area.name,
                "clearance": area.clearance,
                "velocity": list(area.velocity),
                "rings": [ring.round(2).tolist() for ring in outlines(area, 0.0)],
            }
            for area in track.areas
        ],
        "wind": None if flight.wind is None else wind_data(flight.wind),
        "bands": encounter_data(flight.bands, evaluation.options),
    }
    folder = run.folder / "encounters"
    folder.mkdir(exist_ok=True)
    write_file(folder / f"{flight.number}.json", json.dumps(document, allow_nan=False))
