"""The folder of an evaluation as its report reads it: complete, of one run, and of the schema that is known."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from agents.config.load import ConfigError, load
from envs.aircraft import AircraftError
from envs.outcome import Rules
from eval.config import MonteCarloConfig
from eval.flights.aircraft import aircraft_of
from eval.flights.simulate import OUTCOMES
from eval.metrics.summary import SCHEMA_VERSION
from eval.plots.style import kinds_of
from eval.runner.outputs import read_table

__all__ = ["FIGURES", "POINT_COLUMNS", "Run", "read_run"]

FIGURES = ("initial_conditions", "min_separation", "trajectories")  # names of the pictures that a run draws
POINT_COLUMNS = ("distance_m", "bearing_deg", "relative_heading_deg")
"""Columns that place an encounter in the plots; finite in every row."""

_SUMMARY, _TABLE, _CONFIG = "summary.json", "encounters.parquet", "config.yaml"
_SCHEMA = b"monte_carlo 1"
_RATES = (
    *("success_rate", "violation_rate", "timeout_rate", "resolvable_rate", "success_given_resolvable"),
    *("undecided_rate", "unresolvable_rate", "baseline_violation_rate"),
)
_NUMBERS = ("score_mean", "risk_ratio", "path_excess_mean")
_OBJECTS = ("counts", "versions", "min_separation_m_quantiles", "path_excess_quantiles")
_TEXTS = ("outcome", "verdict", "verdict_method", "baseline_outcome", "name")
_COLUMNS = (
    *POINT_COLUMNS,
    *("encounter", "outcome", "verdict", "verdict_method", "duration_s", "min_separation_m"),
    *("baseline_outcome", "baseline_min_separation_m", "name"),
)
_VERDICTS = ("resolvable", "unresolvable", "undecided")
_PNG = b"\x89PNG\r\n\x1a\n"


class Run(NamedTuple):
    """What an evaluation left behind."""

    folder: Path
    summary: Mapping[str, Any]
    rules: Rules  # of the aircraft that was flown
    config: MonteCarloConfig
    config_text: str  # the file as it stands
    table: Mapping[str, np.ndarray]  # columns [N]
    kinds: np.ndarray  # how each encounter is marked, [N], keys of eval.plots.style.MARKERS
    figures: Mapping[str, bytes]  # PNG files by name; none where the run drew none


def read_run(folder: Path) -> Run:
    """Read what ``eval.monte_carlo`` wrote.

    Raises:
        ConfigError: the folder is missing, incomplete, of another schema, or mixed from several runs.
    """
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise ConfigError(f"{folder} {what}, expected a folder that eval.monte_carlo wrote")
    for name in (_CONFIG, _TABLE, _SUMMARY):
        if not (folder / name).is_file():
            hint = f"; finish the run with python -m eval.monte_carlo --resume --out {folder}"
            begun = (folder / "parts").is_dir()
            raise ConfigError(
                f"{folder} holds no {name}, expected a folder that eval.monte_carlo wrote to its end"
                + (hint if begun else "")
            )
    summary, table = _summary(folder / _SUMMARY), _table(folder / _TABLE)
    config = load(MonteCarloConfig, folder / _CONFIG)
    _agree(folder, summary, table, config)
    text = (folder / _CONFIG).read_text(encoding="utf-8")
    figures = {name: _picture(folder / f"{name}.png") for name in FIGURES} if config.figures else {}
    return Run(folder, summary, _rules(folder, summary), config, text, table, kinds_of(table), figures)


def _rules(folder: Path, summary: Mapping[str, Any]) -> Rules:
    try:
        return aircraft_of(summary).rules()
    except (ConfigError, AircraftError, TypeError) as problem:
        raise ConfigError(f"{folder / _SUMMARY}: {problem}") from None


def _summary(path: Path) -> dict[str, Any]:
    def refuse(constant: str) -> NoReturn:
        raise ConfigError(f"{path}: holds {constant}, expected finite numbers or null")

    try:
        found = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as problem:
        raise ConfigError(
            f"{path}: cannot be read as JSON ({problem}), expected a summary of eval.monte_carlo"
        ) from None
    if not isinstance(found, dict):
        raise ConfigError(f"{path}: holds a {type(found).__name__}, expected an object")
    version = found.get("schema_version")
    if version != SCHEMA_VERSION or isinstance(version, bool):
        raise ConfigError(f"{path}: schema_version is {version!r}, expected {SCHEMA_VERSION}")
    checks = [
        *((key, _is_rate, "an object with value, low, high, count and total") for key in _RATES),
        *((key, _is_number_or_none, "a number or null") for key in _NUMBERS),
        *((f"{key}_interval", _has_ends, "an object with low and high") for key in _NUMBERS),
        ("confidence", lambda value: _is_number(value) and 0.0 < value < 1.0, "a number between 0 and 1"),
        *((key, lambda value: isinstance(value, dict), "an object") for key in _OBJECTS),
    ]
    for key, good, what in checks:
        if not good(found.get(key, "")):
            raise ConfigError(f"{path}: {key} is {found.get(key)!r}, expected {what}")
    return found


def _is_rate(value: Any) -> bool:
    parts = ("low", "high", "count", "total")
    return (
        isinstance(value, dict)
        and all(_is_number(value.get(part)) for part in parts)
        and _is_number_or_none(value.get("value", ""))
    )


def _has_ends(value: Any) -> bool:
    return isinstance(value, dict) and all(_is_number_or_none(value.get(end, "")) for end in ("low", "high"))


def _is_number_or_none(value: Any) -> bool:
    return value is None or _is_number(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _table(path: Path) -> dict[str, np.ndarray]:
    read = read_table(path, "a table of encounters", _SCHEMA)
    for name in _COLUMNS:
        if name not in read.column_names:
            raise ConfigError(f"{path}: has no column {name}, expected one")
    table = {name: read.column(name).to_numpy() for name in read.column_names}
    for name, values in table.items():
        if (values.dtype == object) != (name in _TEXTS or name.endswith(("_outcome", "_status", "_source"))):
            raise ConfigError(f"{path}: column {name} holds {read.schema.field(name).type}, expected another type")
    if not np.array_equal(table["encounter"], np.arange(read.num_rows)):
        last = read.num_rows - 1
        raise ConfigError(f"{path}: the column encounter does not hold 0, 1, ... {last}, expected every number once")
    for name, known in (("outcome", OUTCOMES), ("baseline_outcome", OUTCOMES), ("verdict", _VERDICTS)):
        strange = set(table[name]) - set(known)
        if strange:
            raise ConfigError(f"{path}: column {name} holds {strange.pop()!r}, expected one of {', '.join(known)}")
    for name in POINT_COLUMNS:
        if not np.isfinite(table[name]).all():
            raise ConfigError(f"{path}: column {name} is not finite everywhere, expected numbers")
    return table


def _agree(folder: Path, summary: Mapping[str, Any], table: Mapping[str, np.ndarray], config: MonteCarloConfig) -> None:
    """Raise if the files are not of the same run."""
    rows = len(table["encounter"])
    claims = {
        "encounters": (summary.get("encounters"), config.wanted),
        "seed": (summary.get("seed"), config.seed),
        "mode": (summary.get("mode"), config.mode),
        "policy_sha256": (summary.get("policy_sha256"), config.policy_sha256),
    }
    for key, (said, configured) in claims.items():
        if said != configured:
            raise ConfigError(
                f"{folder}: {key} is {said!r} in {_SUMMARY} and {configured!r} in {_CONFIG}, "
                "expected files of the same run"
            )
    if rows != config.wanted:
        raise ConfigError(f"{folder / _TABLE}: has {rows} rows, expected {config.wanted} as in {_SUMMARY}")
    for key, outcome in (("success_rate", "reached"), ("violation_rate", "violation"), ("timeout_rate", "timeout")):
        counted, found = summary[key]["count"], int(np.count_nonzero(table["outcome"] == outcome))
        if counted != found:
            raise ConfigError(
                f"{folder}: {_SUMMARY} counts {counted} encounters as {outcome!r} and {_TABLE} {found}, "
                "expected files of the same run"
            )


def _picture(path: Path) -> bytes:
    try:
        found = path.read_bytes()
    except OSError as problem:
        raise ConfigError(f"{path}: cannot be read ({problem.strerror}), expected the picture of the run") from None
    if not found.startswith(_PNG):
        raise ConfigError(f"{path}: is no PNG file, expected the picture of the run")
    return found
