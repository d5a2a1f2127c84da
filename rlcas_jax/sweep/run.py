"""Search for hyper-parameters: ``python -m rlcas_jax.sweep --space FILE --trials N --out DIR`` (see ``--help``)."""

import gc
import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.load import ConfigError, dump, load
from agents.config.progress import duration
from envs.edge.files import write_file
from rlcas_jax.config import TrainConfig
from rlcas_jax.sweep.cli import CONFIG, Options, parse, prepare
from rlcas_jax.sweep.space import overrides
from rlcas_jax.sweep.watch import Watch

if TYPE_CHECKING:
    from optuna.trial import Trial

    from rlcas_jax.sweep.study import Memory

__all__ = ["main", "trial_directory"]

INTERRUPTED = 130
FAILED = 1

_INTERMEDIATE = {"success": "eval_success", "score": "eval_score"}
_FINAL = {"success": "success_given_resolvable", "score": "score_mean"}


class _Pruned(Exception):  # noqa: N818
    """A training that is not worth its end."""


class _Stopped(Exception):  # noqa: N818
    """Somebody asked to stop; what is there goes on with ``--resume``."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0 when done or out of time, 1 when no trial succeeded, 130 when interrupted."""
    options = parse(argv)
    prepare(options)
    # Imported here: --help and bad input must not wait for JAX and Optuna.
    from rlcas_jax.sweep import report as sweep_report
    from rlcas_jax.sweep.study import open_memory

    settings = options.settings
    deadline = None if options.timeout_s is None else time.monotonic() + options.timeout_s
    watch = Watch(quiet=options.quiet, deadline=deadline)
    with open_memory(options.directory, settings.sampler_seed, settings.startup, pruning=settings.pruning) as memory:
        try:
            _search(options, memory, watch)
            stopped = ""
        except (KeyboardInterrupt, _Stopped):
            stopped = "time is up" if watch.late() else "interrupted"
        rows = sweep_report.rows(memory.trials())
        print(sweep_report.write(options, rows, memory.study, finished=not stopped))
    if stopped:
        print(f"{stopped}: go on with  python -m rlcas_jax.sweep --resume --out {options.directory}")
    if stopped == "interrupted":
        return INTERRUPTED
    return 0 if stopped or any(row.state == "complete" for row in rows) else FAILED


def trial_directory(directory: Path, number: int) -> Path:
    """Return where a trial's training lives."""
    return directory / f"trial_{number:04d}"


def _search(options: Options, memory: "Memory", watch: Watch) -> None:
    """Make the trials that are missing."""
    from rlcas_jax.sweep.report import best_of, rows, shown_value

    def configured(values: Mapping[str, Any]) -> TrainConfig:
        return load(TrainConfig, options.directory / CONFIG, overrides(options.space, values))

    def usable(values: Mapping[str, Any]) -> bool:
        try:
            configured(values)
        except ConfigError:
            return False
        return True

    while memory.finished() < options.settings.trials:
        if watch.stopping or watch.late():
            raise _Stopped
        trial = memory.next(options.space, usable)
        if trial is None:
            watch.note("no further combination of values is valid and new: the space is used up")
            break
        values = ", ".join(overrides(options.space, trial.params))
        watch.note(f"trial {trial.number} ({memory.finished() + 1} of {options.settings.trials}): {values}")
        began = time.monotonic()
        _judge(options, memory, trial, configured(trial.params), watch)
        spent = time.monotonic() - began
        done = memory.trials()[trial.number]
        objective = options.settings.objective
        came = done.user_attrs.get("reason") or shown_value(done.value, objective)
        best = best_of(rows(memory.trials()))
        so_far = "" if best is None else f" (best: trial {best.trial}, {shown_value(best.value, objective)})"
        watch.note(f"trial {trial.number}: {came}{so_far}, {duration(spent)}")


def _judge(options: Options, memory: "Memory", trial: "Trial", config: TrainConfig, watch: Watch) -> None:
    """Train a trial's seeds and tell the study what came of it."""
    import jax
    from optuna.trial import TrialState

    from rlcas_jax.loop import TrainingError

    settings = options.settings
    directory = trial_directory(options.directory, trial.number)
    state, value, reason = TrialState.COMPLETE, None, ""
    try:
        values = []
        for index in range(settings.seeds):
            watch.evaluated = _pruner(trial, config, settings.objective, watch) if index == 0 else None
            own = directory if settings.seeds == 1 else directory / f"seed-{index}"
            summary = _trained(config.model_copy(update={"seed": config.seed + index}), own, watch)
            values.append(float(summary["evaluation"][_FINAL[settings.objective]]))
        trial.set_user_attr("values", values)
        value = sum(values) / len(values)
    except _Pruned:
        state, reason = TrialState.PRUNED, "pruned"
    except TrainingError as problem:
        # The model learns from a pruned trial that its region is bad, and nothing from a failed one.
        state, reason = TrialState.PRUNED, f"diverged: {problem}"
    except (ConfigError, jax.errors.JaxRuntimeError) as problem:
        state, reason = TrialState.FAIL, f"failed: {' '.join(str(problem).split()):.200}"
    finally:
        watch.evaluated = None
        jax.clear_caches()  # every trial compiles its own programs; they would pile up
        gc.collect()
    if reason:
        trial.set_user_attr("reason", reason)
    memory.study.tell(trial, value, state=state)


def _pruner(trial: "Trial", config: TrainConfig, objective: str, watch: Watch) -> Callable[[Mapping[str, float]], None]:
    """Return what hears of the evaluations of a trial's first training and stops it when it is not worth its end."""
    per_update = config.ppo.environments * config.ppo.rollout
    total = max(1, config.steps // per_update) * per_update
    known = set(_reported(trial))

    def evaluated(row: Mapping[str, float]) -> None:
        # Counted, because trials of different batch sizes are evaluated at different steps.
        number = int(row["step"]) // config.evaluation.every_steps
        if number not in known:
            trial.report(row[_INTERMEDIATE[objective]], number)
            known.add(number)
        # A resumed training repeats evaluations that are judged already; the last one comes too late to save anything.
        if number == max(known) and row["step"] < total and trial.should_prune():
            watch.note(f"trial {trial.number} is below the median of those before it: stopped")
            raise _Pruned

    return evaluated


def _reported(trial: "Trial") -> list[int]:
    """Return the numbers of the evaluations that the journal knows of a trial."""
    return list(trial.study.trials[trial.number].intermediate_values)


def _trained(config: TrainConfig, directory: Path, watch: Watch) -> dict[str, Any]:
    """Train and judge in a run's own directory, or go on with what is there; return the summary."""
    from rlcas_jax.checkpoint import CheckpointError
    from rlcas_jax.finish import finish
    from rlcas_jax.loop import run

    summary = _summary(directory)
    if summary is not None:
        return summary
    directory.mkdir(parents=True, exist_ok=True)
    resume = any((directory / "checkpoints").glob("checkpoint-*.safetensors"))
    if not resume:
        write_file(directory / "config.yaml", dump(config))
    try:
        done = run(config, directory, watch, resume=resume)
    except CheckpointError as problem:
        watch.note(f"{problem}: the training begins anew")
        shutil.rmtree(directory / "checkpoints")
        done = run(config, directory, watch)
    if watch.stopping or not done.finished:
        raise _Stopped
    watch.note("judging the policy")
    return finish(done)


def _summary(directory: Path) -> dict[str, Any] | None:
    """Return the summary of a training that is done, None for any other."""
    try:
        summary = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return summary if summary["finished"] else None
