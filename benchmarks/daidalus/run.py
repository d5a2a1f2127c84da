"""Bands and alerts beside DAIDALUS's: ``python -m benchmarks.daidalus --scenarios DIR --out DIR``.

Every scenario of the folder (``.daa``, ``.xyz``, as in https://github.com/nasa/daidalus) is given
to the program and to us on one plane, with the same turn rate, acceleration, look-ahead and plain
cylinder; of every second the edges of the bands of headings and speeds, the times to loss and the
alert levels are compared, with ``--vertical`` those of vertical speeds and altitudes. Both predict
straight courses.
"""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting, no_alerts, update
from agents.assurance.bands import heading_bands, losses_on_course, speed_bands
from agents.kernel.traffic import Requirement
from benchmarks.daidalus.edges import NAMES, Kind, Match, match_edges
from benchmarks.daidalus.figure import drawing
from benchmarks.daidalus.program import (
    HIGH,
    VARIABLE,
    Second,
    Setting,
    answers,
    locate,
    scenario_text,
)
from benchmarks.daidalus.sides import Flight, Ours, Sides, flight_of
from benchmarks.daidalus.vertical import CHANGES, FOOT, FOOT_A_MINUTE, compare_vertical, fine
from benchmarks.measure import report
from commands.command import InputError, Parser, require
from envs.aircraft import PAPER
from envs.arrays import Array
from envs.formats.track_files import read_daidalus
from envs.kinematics import Limits
from eval.plots.save import create, write

SETTING = Setting(
    separation=1_222.32,  # 0.66 nmi
    look_ahead=120.0,
    turn_rate=float(np.radians(3.0)),
    acceleration=2.0,
    speed_min=5.0,
    speed_max=360.0,
    step_deg=0.5,
    step_speed=0.5,
    height=HIGH,
    vertical_acceleration=2.451_662_5,  # 0.25 G
    climb=30.48,  # 6000 ft/min
    vertical_rate=2.54,  # 500 ft/min
    step_climb=15.24,
    step_altitude=10_000.0,
)
"""Turn rate, accelerations, vertical speeds and distance as in DAIDALUS's DO_365B_no_SUM.conf."""

HEADINGS = Kind(True, 2.0, SETTING.step_deg, SETTING.look_ahead)
SPEEDS = Kind(False, 1.0, SETTING.step_speed, SETTING.look_ahead)


_WELL_CLEAR = {
    f"Plain_det_{n}_{key}": value
    for n in (1, 2, 3)
    for key, value in (
        ("WCV_DTHR", f"{SETTING.separation} [m]"),
        ("WCV_ZTHR", "1000000.0 [m]"),
        ("WCV_TTHR", "35.0 [s]"),
        ("WCV_TCOA", "0.0 [s]"),
    )
} | {f"Plain_load_core_detection_det_{n}": "gov.nasa.larcfm.ACCoRD.WCV_TAUMOD" for n in (1, 2, 3)}

VARIANTS: dict[str, dict[str, str]] = {
    "well-clear volume (35 s of modified tau)": _WELL_CLEAR,
    "vertical logic (a cylinder of 450 ft)": {f"Plain_det_{n}_H": "450.0 [ft]" for n in (1, 2, 3)},
    "bank model (20 deg for every speed)": {
        "turn_rate": "0.0 [deg/s]",
        "bank_angle": "20.0 [deg]",
    },
    "bands filtered by 2 of 4": {
        "alerting_m": "2",
        "alerting_n": "4",
        "hysteresis_time": "5.0 [s]",
        "persistence_time": "4.0 [s]",
    },
}
"""What DAIDALUS has and we have not, each switched on alone."""


class Scenario(NamedTuple):
    """The comparison of one scenario."""

    name: str
    seconds: int
    headings: list[Match]  # edges of both sides
    speeds: list[Match]
    loss_error: Array  # s, where one of both finds a loss
    levels_same: Array  # bool, per second and intruder
    raised: list[float]  # s between the first time of a level on both sides
    program_s: float  # wall time of the program
    ours_s: float


def main() -> None:
    """Run the command."""
    options = _parser().parse_args()
    if options.out:
        require("--out", "matplotlib")
    program, paths = locate(options.program), _paths(options.scenarios, options.only)
    picture, folder = options.picture or paths[0].stem, Path(options.out) if options.out else None
    names = [path.stem for path in paths]
    if picture not in names:
        raise InputError(f"--picture {picture}: no scenario, expected one of {', '.join(names)}")
    if folder is not None:
        create(folder)
    scenarios, sides = [], {}
    _print_head(HEAD)
    for path in paths:
        sides[path.stem] = fly_both(path, program, {})
        scenarios.append(compare(path.name, sides[path.stem]))
        print(line(scenarios[-1]), flush=True)
    summary = figures(scenarios)
    if options.variants:
        summary |= _compare_variants(paths, program)
    if options.vertical:
        summary |= _compare_vertical(paths, program)
    if folder is not None:
        write(folder, "daidalus", summary, drawing(sides[picture], picture), dpi=150)
    report(summary, ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--program", help=f"DaidalusBatch, as built (default: ${VARIABLE})")
    add("--scenarios", required=True, help="folder of .daa and .xyz files")
    add("--only", help="name of one scenario, without its ending")
    add("--variants", action="store_true", help="also with each of DAIDALUS's own models")
    add("--vertical", action="store_true", help="also bands of vertical speed and of altitude")
    add("--out", help="folder for the picture and the figures (default: none is written)")
    add("--picture", help="scenario that is drawn (default: the first)")
    return parser


def _print_head(head: Sequence[str]) -> None:
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|", flush=True)


def _compare_variants(paths: Sequence[Path], program: Path) -> dict[str, Any]:
    """Compare with each of DAIDALUS's own models, and print the table."""
    by_variant = {}
    print()
    _print_head(VARIANT_HEAD)
    for name, changes in VARIANTS.items():
        scenarios = [compare(path.name, fly_both(path, program, changes)) for path in paths]
        summary = figures(scenarios)
        shares = summary["edges_headings_within_2_deg"], summary["edges_speeds_within_1_m_s"]
        by_variant[f"variant: {name}"] = shares
        print(f"| {name} | {100.0 * shares[0]:.1f} | {100.0 * shares[1]:.1f} |", flush=True)
    return by_variant


def _compare_vertical(paths: Sequence[Path], program: Path) -> dict[str, Any]:
    """Compare the bands of vertical speed and of altitude, and print the table."""
    by_change = {}
    print()
    _print_head(VERTICAL_HEAD)
    for name, change in CHANGES.items():
        scenarios = []
        for path in paths:
            ownship, *others = read_daidalus(path, repair=True).tracks
            scenarios.append(compare_vertical(program, change((ownship, others)), fine(SETTING)))
        cells = [name]
        for kind, unit, edges in (
            (
                "vertical_speeds",
                FOOT_A_MINUTE,
                [match for scenario in scenarios for match in scenario.climbs],
            ),
            ("altitudes", FOOT, [match for scenario in scenarios for match in scenario.altitudes]),
        ):
            by_change[f"vertical: {name}: {kind}"] = len(edges), share(edges), counts(edges)
            cells += _cells(edges, unit)
        print(f"| {' | '.join(cells)} |", flush=True)
    return by_change


def _paths(folder: str, only: str | None) -> list[Path]:
    paths = sorted(path for path in Path(folder).glob("*") if path.suffix in (".daa", ".xyz"))
    if only is not None:
        paths = [path for path in paths if path.stem == only]
    if not paths:
        expected = f"{only}.daa or {only}.xyz" if only else ".daa or .xyz files"
        raise InputError(f"{folder}: no scenario, expected {expected} of nasa/daidalus")
    return paths


def ours(flight: Flight, setting: Setting, alerting: Alerting) -> Ours:
    """Return our bands and alerts of a scenario."""
    limits = Limits(
        setting.speed_min,
        setting.speed_max,
        -setting.acceleration,
        setting.acceleration,
        setting.turn_rate,
    )
    encounter = flight.own, flight.traffic, Requirement(setting.separation)
    step = np.radians(setting.step_deg)
    headings = np.arange(round(2.0 * np.pi / step)) * step - np.pi
    speeds = np.arange(setting.speed_min, setting.speed_max + 0.1, setting.step_speed)
    loss = losses_on_course(*encounter, setting.look_ahead)
    alerts, level = no_alerts(1, loss.shape[1], alerting), []
    for row, moment in enumerate(flight.time):
        part = slice(row, row + 1)
        alerts = update(alerts, flight.time[part], loss[part], flight.traffic.mask[part], alerting)
        level.append(alerts.level[0])
        assert alerts.time[0] == moment
    return Ours(
        heading_bands(*encounter, limits, setting.look_ahead, headings),
        speed_bands(*encounter, limits, setting.look_ahead, speeds),
        loss,
        np.array(level),
    )


def fly_both(path: Path, program: Path, changes: dict[str, str]) -> Sides:
    """Run both sides on one scenario, the program with other values of some keys."""
    alerting = Alerting.for_aircraft(PAPER)
    ownship, *others = read_daidalus(path, repair=True).tracks
    flight = flight_of(ownship, others)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scenario.xyz").write_text(scenario_text(ownship, others))
        began = time.perf_counter()
        theirs = answers(program, Path(folder), SETTING, alerting, changes)
        program_s = time.perf_counter() - began
    began = time.perf_counter()
    mine = ours(flight, SETTING, alerting)
    by_time = {round(second.time, 3): second for second in theirs}
    seconds = [by_time.get(round(float(moment), 3)) for moment in flight.time]
    return Sides(flight, mine, seconds, program_s, time.perf_counter() - began)


def compare(name: str, sides: Sides) -> Scenario:
    """Compare both sides of one scenario."""
    headings, speeds, compared = [], [], 0
    for row, second in enumerate(sides.seconds):
        if second is not None:
            compared += 1
            headings += match_edges(second.headings, sides.ours.headings, row, HEADINGS)
            speeds += match_edges(second.speeds, sides.ours.speeds, row, SPEEDS)
    errors, same, raised = _compare_alerts(sides.flight, sides.ours, sides.seconds)
    return Scenario(
        name=name,
        seconds=compared,
        headings=headings,
        speeds=speeds,
        loss_error=errors,
        levels_same=same,
        raised=raised,
        program_s=sides.program_s,
        ours_s=sides.ours_s,
    )


def _compare_alerts(
    flight: Flight, mine: Ours, seconds: list[Second | None]
) -> tuple[Array, Array, list[float]]:
    """Return errors of the times to loss, whether levels are the same, and by how much their first
    times differ.
    """
    errors, same, raised = [], [], []
    for k, name in enumerate(flight.names):
        first: dict[int, list[float]] = {}  # by level: when each side reached it
        for row, second in enumerate(seconds):
            if second is None or not flight.traffic.mask[row, k]:
                continue
            theirs = second.loss.get(name, np.inf)
            if np.isfinite(theirs) or np.isfinite(mine.loss[row, k]):
                errors.append(abs(theirs - mine.loss[row, k]))
            level = second.level.get(name, 0), int(mine.level[row, k])
            same.append(level[0] == level[1])
            for side, value in enumerate(level):
                for reached in range(1, value + 1):
                    times = first.setdefault(reached, [np.inf, np.inf])
                    times[side] = min(times[side], second.time)
        raised += [mine_at - theirs_at for theirs_at, mine_at in first.values()]
    return np.array(errors), np.array(same), raised


def share(edges: list[Match]) -> float:
    """Return the share of edges that agree; 1 without any."""
    return float(np.mean([not match.name for match in edges])) if edges else 1.0


def counts(edges: list[Match]) -> dict[str, int]:
    """Return how many edges do not agree, by the name of the reason."""
    names = [match.name for match in edges]
    return {name: names.count(name) for name in NAMES if name in names}


VERTICAL_HEAD = (
    "all scenarios",
    "edges of vertical speeds",
    "within 100 ft/min, %",
    "median, ft/min",
    "others",
    "edges of altitudes",
    "within 100 ft, %",
    "median, ft",
    "others",
)
VARIANT_HEAD = "DAIDALUS's own", "headings within 2 deg, %", "speeds within 1 m/s, %"
HEAD = (
    "scenario",
    "seconds",
    "edges of headings",
    "within 2 deg, %",
    "median, deg",
    "others",
    "edges of speeds",
    "within 1 m/s, %",
    "median, m/s",
    "others",
    "time to loss, greatest error, s",
    "same level, %",
    "level reached apart, s",
)


def line(scenario: Scenario) -> str:
    """Return one scenario as a line of a table."""
    cells = [scenario.name, str(scenario.seconds)]
    for edges in (scenario.headings, scenario.speeds):
        cells += _cells(edges, 1.0)
    finite = scenario.loss_error[np.isfinite(scenario.loss_error)]
    cells.append(f"{finite.max():.3f}" if finite.size else "")
    cells.append(f"{100.0 * scenario.levels_same.mean():.1f}" if scenario.levels_same.size else "")
    later = [abs(value) for value in scenario.raised]
    cells.append(f"{max(later):.0f}" if later else "")
    return f"| {' | '.join(cells)} |"


def _cells(edges: list[Match], unit: float) -> list[str]:
    """Return what a table says of edges, with distances in a unit, deg, m/s or m."""
    apart = [match.away / unit for match in edges if not match.name]
    middle = f"{np.median(apart):.2f}" if apart else ""
    why = ", ".join(f"{number} {name}" for name, number in counts(edges).items())
    return [str(len(edges)), f"{100.0 * share(edges):.2f}" if edges else "", middle, why]


def figures(scenarios: list[Scenario]) -> dict[str, Any]:
    """Return the figures of all scenarios together."""
    headings = [match for scenario in scenarios for match in scenario.headings]
    speeds = [match for scenario in scenarios for match in scenario.speeds]
    errors = np.concatenate([scenario.loss_error for scenario in scenarios])
    finite = errors[np.isfinite(errors)]
    seconds = sum(scenario.seconds for scenario in scenarios)
    return {
        "scenarios": len(scenarios),
        "seconds": seconds,
        "edges_headings": len(headings),
        "edges_headings_within_2_deg": share(headings),
        "differences_headings": counts(headings),
        "edges_speeds": len(speeds),
        "edges_speeds_within_1_m_s": share(speeds),
        "differences_speeds": counts(speeds),
        "losses": int(errors.size),
        "losses_of_one_side": int(errors.size - finite.size),
        "loss_error_max_s": float(finite.max(initial=0.0)),
        "levels_same": float(
            np.concatenate([scenario.levels_same for scenario in scenarios]).mean()
        ),
        "level_reached_apart_max_s": max(
            (abs(t) for scenario in scenarios for t in scenario.raised), default=0.0
        ),
        "program_ms_per_second": 1e3 * sum(scenario.program_s for scenario in scenarios) / seconds,
        "ours_ms_per_second": 1e3 * sum(scenario.ours_s for scenario in scenarios) / seconds,
    }
