"""Success as a function of what a run varies: its table cut into bins of one quantity, or of two."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.config.load import ConfigError
from agents.config.yaml import YamlError, read
from eval.metrics.table import read_table
from eval.stats.plain import share

__all__ = ["QUANTITIES", "Quantity", "Run", "binned", "mapped", "rates", "read_run", "successes"]


class Quantity(NamedTuple):
    """What a run varies and its table records."""

    name: str
    label: str
    unit: str
    column: str
    edges: tuple[float, ...] = ()
    """Of the bins; a further bin takes what lies below the first, another what lies above the last."""
    words: tuple[str, ...] = ()  # instead of edges where the column holds words: each is a bin


def _steps(first: float, last: float, width: float) -> tuple[float, ...]:
    return tuple(float(edge) for edge in np.arange(first, last + 0.5 * width, width))


QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        "relative_heading", "intruder's heading less own heading", "deg", "relative_heading_deg", _steps(-180, 180, 30)
    ),
    Quantity("bearing", "bearing of the intruder from the own heading", "deg", "bearing_deg", _steps(-180, 180, 30)),
    Quantity(
        "distance",
        "distance to the intruder at the start",
        "m",
        "distance_m",
        (1e3, 1.5e3, 2e3, 3e3, 4e3, 6e3, 8e3, 10e3, 12e3, 15e3, 20e3),
    ),
    Quantity("time_to_conflict", "time to the closest point of approach", "s", "t_cpa_s", _steps(0, 200, 20)),
    Quantity(
        "miss_distance",
        "distance at the closest point of approach",
        "m",
        "d_cpa_m",
        (0.0, 125.0, 250.0, 375.0, 500.0, 625.0, 750.0, 1_000.0, 2_000.0, 5_000.0),
    ),
    Quantity("own_speed", "own speed at the start", "m/s", "own_speed_m_s", _steps(50, 100, 5)),
    Quantity(
        "intruder_speed",
        "speed of the intruder",
        "m/s",
        "intruder_speed_m_s",
        (0.0, 25.0, *_steps(50, 100, 5), 125.0, 150.0),
    ),
    Quantity("intruders", "number of intruders", "", "intruders", _steps(0.5, 8.5, 1)),
    Quantity("wind", "speed of the wind", "m/s", "wind_m_s", _steps(0, 15, 2.5)),
    Quantity("wind_error", "error of the wind that plans were made for", "m/s", "wind_error_m_s", _steps(0, 5, 0.5)),
    Quantity("turbulence", "turbulence of MIL-F-8785C", "", "turbulence", words=("none", "light", "moderate")),
    Quantity("latency", "age of the reports", "s", "latency_s", _steps(0, 2, 0.25)),
)
"""In the order in which they are shown; angles count counter-clockwise, left positive, as in the tables of runs."""

_TABLES = ("encounters.parquet", "flights.parquet")
_NEEDED = ("outcome", "verdict")
_BESIDE = ("policy", "plan")


class Run(NamedTuple):
    """A finished run of ``eval.monte_carlo`` or ``eval.hifi``."""

    path: Path
    settings: Mapping[str, Any]  # as its config.yaml has them
    table: Mapping[str, np.ndarray]  # columns [N]

    @property
    def mode(self) -> str:
        """Of the run: what decided."""
        return str(self.settings["mode"])


def read_run(path: Path) -> Run:
    """Read the folder of a finished run.

    Raises:
        ConfigError: it is none, or its table lacks a column.
    """
    file = next((path / name for name in _TABLES if (path / name).is_file()), None)
    if file is None:
        raise ConfigError(f"{path} holds no {' or '.join(_TABLES)}; expected the folder of a finished run")
    try:
        settings = read(path / "config.yaml")
    except (YamlError, OSError) as problem:
        raise ConfigError(
            f"{path / 'config.yaml'} cannot be read: {problem}; expected that of a finished run"
        ) from None
    read_in = read_table(file, "the table of a run")
    missing = [name for name in _NEEDED if name not in read_in.column_names]
    if missing:
        raise ConfigError(f"{file} has no column {missing[0]}; expected the table of a run")
    wanted = [*_NEEDED, "weight", "baseline_outcome", *(f"{name}_outcome" for name in _BESIDE)]
    columns = [name for name in [*wanted, *(each.column for each in QUANTITIES)] if name in read_in.column_names]
    if not isinstance(settings, dict) or not isinstance(settings.get("mode"), str):
        raise ConfigError(f"{path / 'config.yaml'} names no mode; expected the configuration of a run")
    if not read_in.num_rows:
        raise ConfigError(f"{file} has no rows; expected one for each encounter")
    return Run(path, settings, {name: read_in[name].to_numpy(zero_copy_only=False) for name in columns})


def successes(run: Run) -> dict[str, np.ndarray]:
    """Return which flights reached the goal without loss of separation, bool ``[N]`` by mode: the run's and others."""
    found = {run.mode: run.table["outcome"] == "reached"}
    for name in _BESIDE:
        if f"{name}_outcome" in run.table:
            found[name] = run.table[f"{name}_outcome"] == "reached"
    return found


def rates(run: Run, chosen: np.ndarray, confidence: float) -> dict[str, Any]:
    """Return what is said of some encounters of a run, mask ``[N]``, in JSON types; rates with exact intervals."""
    possible = chosen & (run.table["verdict"] != "unresolvable")
    found: dict[str, Any] = {
        "encounters": int(np.count_nonzero(chosen)),
        "unresolvable_rate": _share(chosen & ~possible, chosen, confidence),
        "violation_rate": _share(chosen & (run.table["outcome"] == "violation"), chosen, confidence),
        "success": {
            mode: {
                "success_rate": _share(chosen & reached, chosen, confidence),
                "success_given_resolvable": _share(possible & reached, possible, confidence),
            }
            for mode, reached in successes(run).items()
        },
    }
    if "baseline_outcome" in run.table:
        bare = chosen & (run.table["baseline_outcome"] == "violation")
        found["baseline_violation_rate"] = _share(bare, chosen, confidence)
    return found


def binned(run: Run, quantity: Quantity, confidence: float) -> dict[str, Any] | None:
    """Return the bins of a quantity in JSON types; None where the run does not vary it or does not record it.

    Bins without encounters are left out. Values that are not numbers are counted apart.
    """
    if quantity.column not in run.table:
        return None
    values = run.table[quantity.column]
    cells = _cells(values, quantity)
    bins = [span | rates(run, chosen, confidence) for span, chosen in cells if np.any(chosen)]
    if len(bins) < 2:
        return None
    counted = sum(one["encounters"] for one in bins)
    what = {"name": quantity.name, "label": quantity.label, "unit": quantity.unit, "column": quantity.column}
    return what | {"without_value": len(values) - counted, "bins": bins}


def mapped(run: Run, across: Quantity, up: Quantity, confidence: float) -> list[dict[str, Any]]:
    """Return the cells of two quantities that hold encounters, in JSON types; empty where one is not recorded."""
    if across.column not in run.table or up.column not in run.table:
        return []
    columns, rows = (_cells(run.table[one.column], one) for one in (across, up))
    return [
        {across.name: span, up.name: other} | rates(run, chosen & too, confidence)
        for span, chosen in columns
        for other, too in rows
        if np.any(chosen & too)
    ]


def _cells(values: np.ndarray, quantity: Quantity) -> list[tuple[dict[str, Any], np.ndarray]]:
    """Return the ends or the word of each bin, and which encounters lie in it."""
    if quantity.words:
        return [({"word": word}, values == word) for word in quantity.words]
    edges: Sequence[float] = quantity.edges
    values = values.astype(float)
    finite = values[np.isfinite(values)]
    if finite.size and finite.min() < edges[0]:
        edges = (float(finite.min()), *edges)
    if finite.size and finite.max() > edges[-1]:
        edges = (*edges, float(finite.max()))
    last = edges[-1]
    return [
        ({"low": low, "high": high}, (values >= low) & ((values < high) | ((high == last) & (values == last))))
        for low, high in pairwise(edges)
    ]


def _share(mask: np.ndarray, of: np.ndarray, confidence: float) -> dict[str, Any]:
    return share(np.count_nonzero(mask), np.count_nonzero(of), confidence)
