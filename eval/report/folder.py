"""The folder of an evaluation as its report reads it: complete, of one run, and of the schema that
is known.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.config.load import ConfigError, load
from commands.json_text import parse_json
from envs.outcome import Rules
from eval.config import MonteCarloConfig
from eval.flights.aircraft import aircraft_of
from eval.plots.style import kinds_of
from eval.runner.outputs import SCHEMA_VERSION, RunFolder, read_table

# names of the pictures that a run draws
_FIGURES = ("initial_conditions", "min_separation", "trajectories")
_SUMMARY, _TABLE, _CONFIG = "summary.json", RunFolder.table, "config.yaml"
_COLUMNS = (
    "encounter",
    "outcome",
    "verdict",
    "duration_s",
    "min_separation_m",
    "name",
    "distance_m",
    "bearing_deg",
    "relative_heading_deg",
)


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
    """Read what ``eval.monte_carlo`` wrote; what is incomplete or mixed from several runs raises
    ``ConfigError``.
    """
    _check_complete(folder)
    summary, config = _summary(folder / _SUMMARY), load(MonteCarloConfig, folder / _CONFIG)
    for key in ("seed", "mode", "policy_sha256"):
        if summary.get(key) != getattr(config, key):
            contradiction = (
                f"{summary.get(key)!r} in {_SUMMARY} and {getattr(config, key)!r} in {_CONFIG}"
            )
            raise ConfigError(f"{folder}: {key} is {contradiction}, expected files of the same run")
    table = read_table(folder / _TABLE, "a table of encounters", RunFolder.schema)
    for name in _COLUMNS:
        if name not in table:
            raise ConfigError(f"{folder / _TABLE}: has no column {name}, expected one")
    rows = len(table["encounter"])
    if rows != config.default_count:
        raise ConfigError(
            f"{folder / _TABLE}: has {rows} rows, expected {config.default_count} as in {_CONFIG}"
        )
    return Run(
        folder=folder,
        summary=summary,
        rules=aircraft_of(summary).rules(),
        config=config,
        config_text=(folder / _CONFIG).read_text(encoding="utf-8"),
        table=table,
        kinds=kinds_of(table),
        figures=_figures(folder) if config.figures else {},
    )


def _check_complete(folder: Path) -> None:
    """Refuse what is no folder of a finished run."""
    if not folder.is_dir():
        problem = "is a file" if folder.exists() else "does not exist"
        raise ConfigError(f"{folder} {problem}, expected a folder that eval.monte_carlo wrote")
    for name in (_CONFIG, _TABLE, _SUMMARY):
        if not (folder / name).is_file():
            finish = f"; finish the run with python -m eval.monte_carlo --resume --out {folder}"
            hint = finish if (folder / RunFolder.parts).is_dir() else ""
            raise ConfigError(
                f"{folder} holds no {name}, expected a finished run of eval.monte_carlo{hint}"
            )


def _figures(folder: Path) -> dict[str, bytes]:
    """Return the pictures of a run, PNG, by name."""
    try:
        return {name: (folder / f"{name}.png").read_bytes() for name in _FIGURES}
    except OSError as problem:
        raise ConfigError(
            f"{problem.filename}: cannot be read ({problem.strerror}), expected a picture"
        ) from None


def _summary(path: Path) -> dict[str, Any]:
    try:
        summary = parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as problem:
        raise ConfigError(
            f"{path}: cannot be read as JSON ({problem}), expected a run's summary"
        ) from None
    version = summary.get("schema_version") if isinstance(summary, dict) else None
    if version != SCHEMA_VERSION:
        raise ConfigError(f"{path}: schema_version is {version!r}, expected {SCHEMA_VERSION}")
    return summary
