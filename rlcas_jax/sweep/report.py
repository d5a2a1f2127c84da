"""What a hyper-parameter search leaves behind: table, ``trials.parquet``, ``sweep.json``, ``best.yaml`` and figures."""

import json
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from agents.config.load import dump, load
from agents.policy.versions import versions
from envs.edge.files import write_file, written
from rlcas_jax.config import TrainConfig
from rlcas_jax.sweep.cli import CONFIG, Options
from rlcas_jax.sweep.space import Choices, Parameter, overrides

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import FrozenTrial

__all__ = ["Row", "best_of", "importance", "rows", "shown_value", "write"]

_LEAST = 8
"""Complete trials from which on importances are reckoned."""


class Row(NamedTuple):
    """A trial."""

    trial: int
    state: str
    """complete, pruned, diverged, failed or unfinished."""
    value: float | None
    """Mean over the seeds; None unless complete."""
    values: tuple[float, ...]
    """Of each seed."""
    parameters: Mapping[str, Any]
    evaluations: tuple[float, ...]
    """Of the first seed's training, in their order."""
    wall_s: float | None
    """From the trial's first start to its end, s, interruptions included; None while unfinished."""
    reason: str


def rows(trials: Sequence["FrozenTrial"]) -> list[Row]:
    """Return the trials by number."""
    found = []
    for trial in trials:
        reason = str(trial.user_attrs.get("reason", ""))
        name = "failed" if trial.state.name == "FAIL" else trial.state.name.lower()
        state = reason.partition(":")[0] if reason else name if trial.state.is_finished() else "unfinished"
        seen = trial.intermediate_values
        found.append(
            Row(
                trial.number,
                state,
                trial.value if state == "complete" else None,
                tuple(trial.user_attrs.get("values", ())),
                trial.params,
                tuple(seen[number] for number in sorted(seen)),
                None if trial.duration is None else trial.duration.total_seconds(),
                reason,
            )
        )
    return found


def best_of(found: Sequence[Row]) -> Row | None:
    """Return the best complete trial, the first of equal ones."""
    complete = [row for row in found if row.value is not None]
    return max(complete, key=lambda row: (row.value or 0.0, -row.trial)) if complete else None


def shown_value(value: float | None, objective: str) -> str:
    """Return a value for a person: per cent of the resolvable encounters, or the mean score."""
    if value is None:
        return "-"
    return f"{value:.2%}" if objective == "success" else f"{value:+.2f}"


def importance(study: "Study", found: Sequence[Row]) -> dict[str, float] | None:
    """Return each key's share of what separates the best trials from the others (PED-ANOVA, Watanabe et al. 2023).

    None where fewer than eight trials are complete.
    """
    import optuna

    if sum(row.state == "complete" for row in found) < _LEAST:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        evaluator = optuna.importance.PedAnovaImportanceEvaluator(target_quantile=0.25)
    return {
        key: float(share) for key, share in optuna.importance.get_param_importances(study, evaluator=evaluator).items()
    }


def write(options: Options, found: Sequence[Row], study: "Study", *, finished: bool) -> str:
    """Write everything and return what a person wants to know, as text."""
    from rlcas_jax.sweep.figures import sweep_figures

    directory, settings = options.directory, options.settings
    best = best_of(found)
    shares = importance(study, found)
    _columns(found, options.space, directory / "trials.parquet")
    if best is not None:
        chosen = overrides(options.space, best.parameters)
        config = load(TrainConfig, directory / CONFIG, chosen)
        head = (
            f"# Trial {best.trial} of {len(found)}: {settings.objective} {shown_value(best.value, settings.objective)}"
        )
        write_file(directory / "best.yaml", f"{head}, {', '.join(chosen)}\n{dump(config)}")
    files = sweep_figures(found, options.space, settings.objective, shares, directory / "figures")
    counts = {state: sum(row.state == state for row in found) for state in dict.fromkeys(row.state for row in found)}
    report = {
        "name": options.base.name,
        "finished": finished,
        "objective": settings.objective,
        "direction": "maximize",
        "seeds": settings.seeds,
        "sampler_seed": settings.sampler_seed,
        "trials": settings.trials,
        "states": counts,
        "best": best and {"trial": best.trial, "value": best.value, "parameters": dict(best.parameters)},
        "importance": shares,
        "space": settings.space,
        "figures": [str(file.relative_to(directory)) for file in files],
        "versions": versions("optuna", "jax", "jaxlib"),
    }
    write_file(directory / "sweep.json", json.dumps(report, indent=2) + "\n")
    text = _table(found, options.space, settings.objective)
    if best is not None:
        text += f"\nbest: trial {best.trial}, {shown_value(best.value, settings.objective)}: {directory / 'best.yaml'}"
    return f"{text}\ntrials, sweep.json and figures: {directory}"


def _columns(found: Sequence[Row], space: Sequence[Parameter], path: Path) -> None:
    """Write a row a trial; a key's column holds numbers for a range and texts for choices."""
    import pyarrow as pa
    from pyarrow import parquet

    columns: dict[str, pa.Array[Any]] = {
        "trial": pa.array([row.trial for row in found], pa.int64()),
        "state": pa.array([row.state for row in found], pa.string()),
        "value": pa.array([row.value for row in found], pa.float64()),
        "values": pa.array([list(row.values) for row in found], pa.list_(pa.float64())),
        "evaluations": pa.array([list(row.evaluations) for row in found], pa.list_(pa.float64())),
        "wall_s": pa.array([row.wall_s for row in found], pa.float64()),
        "reason": pa.array([row.reason for row in found], pa.string()),
    }
    for parameter in space:
        kind = pa.string() if isinstance(parameter, Choices) else pa.int64() if parameter.whole else pa.float64()
        columns[parameter.key] = pa.array([row.parameters.get(parameter.key) for row in found], kind)
    with written(path) as new:
        parquet.write_table(pa.table(columns), new)


def _table(found: Sequence[Row], space: Sequence[Parameter], objective: str) -> str:
    """Return the trials, best first: drawn by rich on a terminal, plain columns elsewhere."""
    head = ["trial", "state", objective, *(parameter.key for parameter in space)]
    ranked = sorted(found, key=lambda row: (row.value is None, -(row.value or 0.0), row.trial))
    cells = [
        [str(row.trial), row.state, shown_value(row.value, objective)]
        + [parameter.text(row.parameters[parameter.key]) for parameter in space]
        for row in ranked
    ]
    if sys.stdout.isatty():
        from rich.console import Console
        from rich.table import Table

        table = Table(*head)
        for line in cells:
            table.add_row(*line)
        console = Console()
        with console.capture() as captured:
            console.print(table)
        return captured.get().rstrip("\n")
    widths = [max(map(len, column)) for column in zip(head, *cells, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in [head, *cells]]
    return "\n".join(line.rstrip() for line in lines)
