"""Success as a function of what a run varies: its table cut into bins of one quantity."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.config.load import ConfigError
from commands.json_text import parse_json
from envs.aircraft import Aircraft
from eval.flights.aircraft import aircraft_of
from eval.runner.outputs import read_table
from eval.stats.intervals import share

_TABLES = ("encounters.parquet", "flights.parquet")
_BESIDE = ("policy", "plan")


class Quantity(NamedTuple):
    """What a run varies and its table records."""

    name: str
    label: str
    unit: str
    column: str
    # of the bins; further bins take what lies below the first and above the last
    edges: tuple[float, ...] = ()
    words: tuple[str, ...] = ()  # instead of edges where the column holds words: each is a bin


_SEPARATIONS = (1, 1.5, 2, 3, 4, 6, 8, 10, 12, 15, 20)
"""Edges of distances, in separations."""
_MISSES = (0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 1, 2, 5)
"""Edges of miss distances, in separations."""


def quantities(aircraft: Aircraft) -> dict[str, Quantity]:
    """Return what is shown, by name and in this order; angles count counter-clockwise, as in the
    tables of runs.
    """
    every = (*_geometry(aircraft), *_speeds(aircraft), *_CONDITIONS)
    return {quantity.name: quantity for quantity in every}


def _geometry(aircraft: Aircraft) -> tuple[Quantity, ...]:
    angles, unit = _steps(-180, 180, 30), aircraft.separation
    heading = "intruder's heading minus own heading"
    bearing = "bearing of the intruder from the own heading"
    times = tuple(2.0 * aircraft.time_unit * step for step in range(11))
    return (
        Quantity("relative_heading", heading, "deg", "relative_heading_deg", angles),
        Quantity("bearing", bearing, "deg", "bearing_deg", angles),
        Quantity(
            name="distance",
            label="distance to the intruder at the start",
            unit="m",
            column="distance_m",
            edges=tuple(unit * part for part in _SEPARATIONS),
        ),
        Quantity(
            name="time_to_conflict",
            label="time to the closest point of approach",
            unit="s",
            column="t_cpa_s",
            edges=times,
        ),
        Quantity(
            name="miss_distance",
            label="distance at the closest point of approach",
            unit="m",
            column="d_cpa_m",
            edges=tuple(unit * part for part in _MISSES),
        ),
    )


def _speeds(aircraft: Aircraft) -> tuple[Quantity, ...]:
    slowest, fastest = aircraft.limits.speed_min, aircraft.limits.speed_max
    most = aircraft.traffic_speed_max
    own = tuple(np.linspace(slowest, fastest, 11).tolist())
    traffic = (0.0, 0.5 * slowest, *own, 0.5 * (fastest + most), most)
    return (
        Quantity("own_speed", "own speed at the start", "m/s", "own_speed_m_s", own),
        Quantity("intruder_speed", "speed of the intruder", "m/s", "intruder_speed_m_s", traffic),
    )


def _steps(first: float, last: float, width: float) -> tuple[float, ...]:
    return tuple(float(edge) for edge in np.arange(first, last + 0.5 * width, width))


_CONDITIONS = (
    Quantity("intruders", "number of intruders", "", "intruders", _steps(0.5, 8.5, 1)),
    Quantity("wind", "speed of the wind", "m/s", "wind_m_s", _steps(0, 15, 2.5)),
    Quantity(
        name="wind_error",
        label="error of the wind as the planner has it",
        unit="m/s",
        column="wind_error_m_s",
        edges=_steps(0, 5, 0.5),
    ),
    Quantity(
        name="turbulence",
        label="turbulence of MIL-F-8785C",
        unit="",
        column="turbulence",
        words=("none", "light", "moderate"),
    ),
    Quantity("latency", "age of the reports", "s", "latency_s", _steps(0, 2, 0.25)),
)


class Run(NamedTuple):
    """A finished run of ``eval.monte_carlo`` or ``eval.hifi``."""

    path: Path
    mode: str  # what decided
    table: Mapping[str, np.ndarray]  # columns [N]
    aircraft: Aircraft  # that was flown
    settings: Mapping[str, Any] = {}  # others that its summary names


def read_run(path: Path) -> Run:
    """Read the folder of a finished run; what is none raises ``ConfigError``."""
    file = next((path / name for name in _TABLES if (path / name).is_file()), None)
    if file is None:
        raise ConfigError(
            f"{path} holds no {' or '.join(_TABLES)}; expected the folder of a finished run"
        )
    try:
        summary = parse_json((path / "summary.json").read_text(encoding="utf-8"))
        aircraft, mode = aircraft_of(summary), str(summary["mode"])
    except (OSError, ValueError, TypeError, KeyError) as problem:
        raise ConfigError(
            f"{path}: summary.json cannot be read: {problem}; expected that of a finished run"
        ) from None
    table = read_table(file, "the table of a run")
    missing = [name for name in ("outcome", "verdict") if name not in table]
    if missing:
        raise ConfigError(f"{file} has no column {missing[0]}; expected the table of a run")
    settings = {
        key: summary[key]
        for key in ("scenario", "seed", "mode", "policy_sha256", "vehicle")
        if key in summary
    }
    return Run(path, mode, table, aircraft, settings)


def successes(run: Run) -> dict[str, np.ndarray]:
    """Return which flights reached the goal without loss of separation, bool ``[N]`` by mode: the
    run's and others.
    """
    columns = {run.mode: "outcome"} | {
        name: f"{name}_outcome" for name in _BESIDE if f"{name}_outcome" in run.table
    }
    return {mode: run.table[column] == "reached" for mode, column in columns.items()}


def rates(run: Run, chosen: np.ndarray, confidence: float) -> dict[str, Any]:
    """Return what is said of some encounters of a run, mask ``[N]``, in JSON types; rates with
    exact intervals.
    """
    possible = chosen & (run.table["verdict"] != "unresolvable")

    def rate(mask: np.ndarray, of: np.ndarray = chosen) -> dict[str, Any]:
        return share(np.count_nonzero(of & mask), np.count_nonzero(of), confidence)

    summary: dict[str, Any] = {
        "encounters": int(np.count_nonzero(chosen)),
        "unresolvable_rate": rate(~possible),
        "violation_rate": rate(run.table["outcome"] == "violation"),
        "success": {
            mode: {
                "success_rate": rate(reached),
                "success_given_resolvable": rate(reached, possible),
            }
            for mode, reached in successes(run).items()
        },
    }
    if "baseline_outcome" in run.table:
        summary["baseline_violation_rate"] = rate(run.table["baseline_outcome"] == "violation")
    return summary


def bins_of(run: Run, quantity: Quantity, confidence: float) -> dict[str, Any] | None:
    """Return the bins of a quantity that hold encounters, in JSON types; None: the run does not
    vary or record it.
    """
    if quantity.column not in run.table:
        return None
    cells = _cells(run.table[quantity.column], quantity)
    bins = [span | rates(run, chosen, confidence) for span, chosen in cells if np.any(chosen)]
    if len(bins) < 2:
        return None
    return {"name": quantity.name, "label": quantity.label, "unit": quantity.unit, "bins": bins}


def _cells(values: np.ndarray, quantity: Quantity) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Return the ends or the word of each bin, and which encounters lie in it."""
    if quantity.words:
        return [({"word": word}, values == word) for word in quantity.words]
    values = values.astype(float)
    finite, (first, *_, last) = np.isfinite(values), quantity.edges
    ends = float(values[finite].min(initial=first)), float(values[finite].max(initial=last))
    edges = sorted({*quantity.edges, *ends})
    # The last bin holds its upper end.
    place = np.where(finite, np.minimum(np.searchsorted(edges, values, "right"), len(edges) - 1), 0)
    return [
        ({"low": low, "high": high}, place == i) for i, (low, high) in enumerate(pairwise(edges), 1)
    ]
