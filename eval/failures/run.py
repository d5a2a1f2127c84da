"""Where a run fails, by groups and case by case: ``python -m eval.failures runs/circle --out
runs/failed``.
"""

import argparse
import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from agents.config.load import ConfigError, Parser
from commands.command import whole
from commands.files import write_whole
from envs.formats import encounter_file
from envs.intruder import Intent
from envs.outcome import Rules
from eval.failures.config import FailuresConfig
from eval.flights.chunks import Evaluation, pick
from eval.plots import save as picture_folder
from eval.plots.style import spread
from eval.report.flights import Replayed, evaluation_of, fly_again
from eval.report.folder import read_run
from eval.runner.options import (
    config_option,
    extension_option,
    load_extensions,
    load_with_options,
    new_folder_option,
    run_argument,
)

_DESCRIPTION = """\
Group the encounters in which a run of eval.monte_carlo failed and that are not proven
unresolvable, by how they failed (narrow loss: at least 95 % of the separation was kept; deep loss;
time-out), by the angle between the courses and by the distance at the start; and draw some of
each group beside a flight that would have succeeded.

Written to --out, a new or empty folder: failures.json (the groups), config.yaml, failures.csv (a
row a failure, all columns of the run), encounters.csv (their starts, for eval.monte_carlo
--scenario file:F) and failures.png, .svg (of each group)."""

_EPILOG = """\
examples:
  python -m eval.monte_carlo --encounters 100000 --mode policy --out runs/circle
  python -m eval.failures runs/circle --cases 24 --out runs/failed
  python -m eval.failures --config runs/failed/config.yaml --out runs/again          repeat one"""


FAILURES = ("narrow loss", "deep loss", "time-out")
_DEEP = 0.95  # a loss of separation that keeps this share of the separation is a narrow loss
# Ranges of the angle between the courses at the start, degrees; the upper end of the last belongs
# to it.
_COURSES = ((0.0, 30.0), (30.0, 60.0), (60.0, 135.0), (135.0, 180.0))
# Ranges of the distance to the nearest intruder at the start, in required separations.
_DISTANCES = ((0.0, 1.5), (1.5, 3.0), (3.0, np.inf))


class Group(NamedTuple):
    """Failures of a kind."""

    failure: str  # one of FAILURES
    course: tuple[float, float]  # deg
    distance: tuple[float, float]  # m
    members: np.ndarray  # numbers of its encounters
    # encounters of the run with such courses and distances that are not proven unresolvable
    comparable: int


def failures(table: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return which encounters of a run failed and are not proven unresolvable, bool ``[N]``."""
    return (table["outcome"] != "reached") & (table["verdict"] != "unresolvable")


def group_failures(table: Mapping[str, np.ndarray], separation: float) -> list[Group]:
    """Return the groups that hold failures, the largest first, of a run's table with the required
    separation, m.
    """
    angle, distance = np.abs(table["relative_heading_deg"]), table["distance_m"]
    possible, failed = table["verdict"] != "unresolvable", failures(table)
    violated = table["outcome"] == "violation"
    near = table["min_separation_m"] >= _DEEP * separation
    kinds = (violated & near, violated & ~near, ~violated)
    groups = []
    for course in _COURSES:
        within = (angle >= course[0]) & ((angle < course[1]) | (course == _COURSES[-1]))
        for reach in ((low * separation, high * separation) for low, high in _DISTANCES):
            in_bin = within & (distance >= reach[0]) & (distance < reach[1])
            comparable = int(np.count_nonzero(in_bin & possible))
            for how, kind in zip(FAILURES, kinds, strict=True):
                members = np.flatnonzero(in_bin & failed & kind)
                if members.size:
                    groups.append(Group(how, course, reach, members, comparable))
    return sorted(groups, key=lambda group: -group.members.size)


def representatives(groups: list[Group], count: int) -> list[int]:
    """Return up to ``count`` encounters to look at, as many of each group as is its share, at least
    one of the largest.

    Within a group they are spread evenly over the numbers, so that no choice is made by hand.
    """
    total = sum(group.members.size for group in groups)
    chosen: list[int] = []
    for group in groups:
        share = min(
            max(1, round(count * group.members.size / max(total, 1))),
            group.members.size,
            count - len(chosen),
        )
        chosen += spread(group.members, share).tolist()
    return chosen


def describe(group: Group, table: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return a group in JSON types."""
    rows, (low, high) = group.members, group.distance
    return {
        "how": group.failure,
        "course_difference_deg": list(group.course),
        "distance_m": [low, None if np.isinf(high) else high],
        "failures": int(rows.size),
        "such_encounters": group.comparable,
        "min_separation_m_median": float(np.median(table["min_separation_m"][rows])),
        "t_cpa_s_median": float(np.nanmedian(table["t_cpa_s"][rows])),
        "goal_distance_m_median": float(np.median(table["goal_distance_m"][rows])),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Group and draw the failures of a run and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    config = _load(options)
    load_extensions(config.extensions)
    run = read_run(config.run)
    evaluation = evaluation_of(run, config.policy)
    folder: Path = options.out
    picture_folder.create(folder, config)
    table = run.table
    groups = group_failures(table, run.rules.separation)
    chosen = representatives(groups, config.cases)
    content = {
        "run": str(config.run),
        "policy_sha256": run.config.policy_sha256,
        "encounters": len(table["encounter"]),
        "failures": sum(group.members.size for group in groups),
        "groups": [describe(group, table) for group in groups],
        "cases": chosen,
    }
    _write_table(folder / "failures.csv", table)
    _write_starts(folder / "encounters.csv", table, evaluation)
    of = {number: group for group in groups for number in group.members.tolist()}
    flights = list(fly_again(run, evaluation, chosen, set(chosen))) if chosen else []
    titles = [_title(flight.number, of[flight.number], table) for flight in flights]
    picture_folder.write(folder, "failures", content, _sheet(flights, titles, run.rules), 110)
    _show(content)
    print(f"files: {folder}")
    return 0


def _load(options: argparse.Namespace) -> FailuresConfig:
    """Return the configuration of a file under what the command line says."""
    if options.run is None and options.config is None:
        raise ConfigError("DIR: expected the folder of a finished run, or --config")
    settings = {"run": options.run, "policy": options.policy, "cases": options.cases}
    settings["extensions"] = options.extension or None
    return load_with_options(FailuresConfig, options.config, settings)


def _write_table(path: Path, table: Mapping[str, np.ndarray]) -> None:
    """Write the failures' rows of a run's table, all columns, as CSV."""
    failed = failures(table)
    columns = {name: values[failed].tolist() for name, values in table.items()}
    with write_whole(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def _write_starts(path: Path, table: Mapping[str, np.ndarray], evaluation: Evaluation) -> None:
    """Write the starts of the failures, to be flown again; no file where there is none, or where
    intruders were recorded, which is no row of such a file.
    """
    numbers = [int(number) for number in table["encounter"][failures(table)]]
    if not numbers:
        return
    starts = pick(evaluation, numbers)
    if isinstance(starts.intent, Intent):
        encounter_file.write(path, starts, [str(number) for number in numbers])


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.failures", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    config_option(parser, "an earlier look")
    run_argument(parser, "folder of a finished run of eval.monte_carlo")
    add(
        "--cases",
        type=whole(0, 120),
        metavar="N",
        help="flights to draw, 0 to 120 (default: 24)",
    )
    add(
        "--policy",
        type=Path,
        metavar="FILE",
        help="the run's policy, where its file lies elsewhere now",
    )
    extension_option(parser)
    new_folder_option(parser)
    return parser


def _title(number: int, group: Group, table: Mapping[str, np.ndarray]) -> str:
    closest, angle = table["min_separation_m"][number], abs(table["relative_heading_deg"][number])
    digits = 2 if group.failure == "narrow loss" else 0  # of centimetres, where they decide
    return (
        f"{number}: {group.failure}, {closest:.{digits}f} m\nfrom "
        f"{table['distance_m'][number]:.0f} m, courses {angle:.0f}°"
    )


def _sheet(flights: Sequence[Replayed], titles: Sequence[str], rules: Rules) -> Figure | None:
    """Return the figure of flights, each beside one that would have succeeded; None of no
    flight.
    """
    from eval.plots.flight_sheet import Panel, sheet

    panels = []
    for flight, title in zip(flights, titles, strict=True):
        way = None if flight.witness is None else flight.witness.path
        panels.append(Panel(title, flight.track, witness=way))
    columns = min(max(len(panels), 3), 6)  # with fewer the legend has no room
    return sheet(panels, rules, columns, (16.0 / 6, 3.1), 8) if panels else None


def _show(content: Mapping[str, Any]) -> None:
    total, of = content["failures"], content["encounters"]
    print(f"{total} of {of} encounters failed and are not proven unresolvable ({total / of:.3%})")
    print("how          courses         start  failures   share  of such    closest  CPA in")
    for group in content["groups"]:
        (low, high), (near, far) = group["course_difference_deg"], group["distance_m"]
        start = (
            f"{near / 1e3:g} to {far / 1e3:g} km" if far is not None else f"over {near / 1e3:g} km"
        )
        print(
            f"{group['how']:<10} {f'{low:g}-{high:g}°':>9} {start:>13} {group['failures']:>9} "
            f"{group['failures'] / total:>7.1%} "
            f"{group['failures'] / group['such_encounters']:>8.2%} "
            f"{group['min_separation_m_median']:>8.1f} m {group['t_cpa_s_median']:>5.0f} s"
        )
