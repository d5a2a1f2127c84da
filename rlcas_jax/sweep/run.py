"""Search for hyper-parameters: ``python -m rlcas_jax.sweep --space FILE --trials N --out DIR`` (see
``--help``).

The search is an Optuna study in ``study.db`` (SQLite) of the sweep's directory, which Optuna's own
tools read, too.
"""

import errno
import gc
import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import optuna
from optuna.exceptions import StorageInternalError
from optuna.study import Study
from optuna.trial import FrozenTrial, Trial, TrialState

from agents.config.load import ConfigError, dump, load
from commands.compiled import keep_compiled
from commands.files import write_file
from commands.folder_lock import lock
from rlcas_jax.config import TrainConfig
from rlcas_jax.interrupt import INTERRUPTED, Interrupt
from rlcas_jax.progress import Reporter
from rlcas_jax.sweep.cli import CONFIG, SETTINGS, Options, parse
from rlcas_jax.sweep.figures import draw
from rlcas_jax.sweep.space import overrides
from rlcas_jax.train import FAILED, report_unwritten

STUDY = "study.db"
REASON = "reason"
"""Attribute of a pruned trial: why it was."""

_DONE = TrialState.COMPLETE, TrialState.PRUNED
_CUT = TrialState.RUNNING, TrialState.WAITING  # was interrupted, and will be tried again

STARTUP = 10
"""Trials that are drawn evenly from the space and never stopped early, before the sampler's model
is asked.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0 when done, 1 when no trial succeeded, 130 when interrupted."""
    options = parse(argv)
    keep_compiled()
    from rlcas_jax.devices import connect

    connect()  # a platform without devices is refused before anything is written
    if not options.resumed:
        from rlcas_jax.loop import check_own_code

        check_own_code(options.base)
    again = f"sweep --resume --out {options.directory}"
    try:
        with Interrupt() as interrupt, lock(options.directory):
            write_file(options.directory / SETTINGS, dump(options.settings))
            if not options.resumed:
                write_file(options.directory / CONFIG, dump(options.base))
            study = _open(options)
            while _count_trials(study) < options.settings.trials and not interrupt.requested:
                _try(study, options, interrupt)
            best = _write_results(options, study)
    except OSError as problem:
        return report_unwritten(options.directory, problem, again)
    except StorageInternalError as problem:  # by SQLite, whose words are those of the cause
        why = OSError(
            errno.EIO,
            str(getattr(problem.__cause__, "orig", problem)),
            str(options.directory / STUDY),
        )
        return report_unwritten(options.directory, why, again)
    if interrupt.requested:
        print(f"interrupted: go on with  python -m rlcas_jax.{again}")
        return INTERRUPTED
    return 0 if best else FAILED


def trial_directory(directory: Path, number: int) -> Path:
    """Return the folder of a trial's training."""
    return directory / f"trial_{number:04d}"


def _open(options: Options) -> Study:
    """Open the study, with a trial that a kill left unfinished queued again."""
    optuna.logging.set_verbosity(optuna.logging.WARNING if options.quiet else optuna.logging.INFO)
    storage = optuna.storages.RDBStorage(f"sqlite:///{(options.directory / STUDY).absolute()}")
    study = optuna.create_study(
        storage=storage, study_name=options.base.name, direction="maximize", load_if_exists=True
    )
    # One that was cut counts no more: its values are tried again under another number.
    for trial in study.get_trials(states=(TrialState.RUNNING,)):
        study.tell(trial.number, state=TrialState.FAIL)
        study.enqueue_trial(trial.params)
    # Optuna does not store the sampler's state: with the same seed a resumed study would repeat its
    # first draws.
    seed = options.base.seed + len(study.trials)
    study.sampler = optuna.samplers.TPESampler(seed=seed, n_startup_trials=STARTUP)
    study.pruner = optuna.pruners.MedianPruner(STARTUP)
    return study


def _count_trials(study: Study) -> int:
    return len(study.get_trials(deepcopy=False, states=_DONE))


def _try(study: Study, options: Options, interrupt: Interrupt) -> None:
    """Try other values; where a stop is asked for, the trial stays unfinished and is queued again
    on resume.
    """
    trial = study.ask(dict(options.space))
    try:
        value = _objective(trial, options, interrupt)
    except optuna.TrialPruned as pruned:
        trial.set_user_attr(REASON, str(pruned))
        ended = study.tell(trial, state=TrialState.PRUNED)
    else:
        if interrupt.requested:
            return
        ended = study.tell(trial, value)
    if not options.quiet:
        print(_line(ended), flush=True)


def _line(trial: FrozenTrial) -> str:
    """Return a trial in words: its number, how it ended, and its values."""
    if trial.state == TrialState.COMPLETE:
        end = f"success {trial.value:.6g}"
    elif trial.state == TrialState.PRUNED:
        end = f"pruned, {trial.user_attrs.get(REASON, 'the reason was not stored')}"
    else:
        end = "interrupted"
    return f"trial {trial.number}: {end}: {', '.join(overrides(trial.params))}"


def _objective(trial: Trial, options: Options, interrupt: Interrupt) -> float:
    """Train a trial's seeds and return the mean share resolved of the resolvable."""
    import jax

    from rlcas_jax.loop import TrainingError

    seeds, values = options.settings.seeds, trial.params
    for complete in trial.study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
        if complete.params == values:
            return float(complete.value or 0.0)
    directory = trial_directory(options.directory, trial.number)
    resolved = []
    try:
        config = load(TrainConfig, options.directory / CONFIG, overrides(values))
        for index in range(seeds):
            own = directory if seeds == 1 else directory / f"seed-{index}"
            watch = _Watch(options, trial, index, config)
            summary = _train(
                config.model_copy(update={"seed": config.seed + index}), own, watch, interrupt
            )
            if interrupt.requested:
                return math.nan
            resolved.append(float(summary["evaluation"]["success_given_resolvable"]))
    except (ConfigError, TrainingError, jax.errors.JaxRuntimeError) as problem:
        # Of a pruned trial Optuna learns that its region is bad, of a failed one nothing.
        reason = re.sub("^--set:? ", "", " ".join(str(problem).split()))
        raise optuna.TrialPruned(reason[:200]) from None
    finally:
        jax.clear_caches()  # every trial compiles its own programs; they would pile up
        gc.collect()
    return sum(resolved) / len(resolved)


class _Watch(Reporter):
    """Shows a training's progress and reports the evaluations of the first seed to Optuna's
    pruner.
    """

    def __init__(self, options: Options, trial: Trial, seed: int, config: TrainConfig) -> None:
        settings = options.settings
        name = f"trial {trial.number}"
        if settings.seeds > 1:
            name += f", seed {seed + 1} of {settings.seeds}"
        super().__init__(name=name, quiet=options.quiet)
        self._trial = trial if seed == 0 else None
        self._every = config.evaluation.every_steps
        self._last = max(1, config.steps // config.samples) * config.samples

    def update(self, row: Mapping[str, float]) -> None:
        """Take the figures of an update; raises ``optuna.TrialPruned``."""
        super().update(row)
        if self._trial is None or "eval_success" not in row:
            return
        # Counted, because trials of different batch sizes are evaluated at different steps.
        number = int(row["step"]) // self._every
        self._trial.report(row["eval_success"], number)
        if row["step"] < self._last and self._trial.should_prune():
            raise optuna.TrialPruned(
                f"below the median of the trials before it at evaluation {number} "
                f"({100.0 * row['eval_success']:.1f} %)"
            )


def _train(
    config: TrainConfig, directory: Path, watch: Reporter, interrupt: Interrupt
) -> dict[str, Any]:
    """Train and evaluate in a run's own directory and return the summary."""
    from rlcas_jax.finish import finish
    from rlcas_jax.loop import prepare, run

    training = prepare(config, directory)
    directory.mkdir(parents=True, exist_ok=True)
    write_file(directory / "config.yaml", dump(config))
    result = run(training, watch, interrupt)
    interrupt.waits_for("the evaluation of the policy")
    return finish(result) if result.finished else {}


def _write_results(options: Options, study: Study) -> bool:
    """Write ``best.yaml``, ``sweep.json`` and the figures, print how the trials ended and the best
    one, and return whether there is one.
    """
    trials = study.get_trials(deepcopy=False, states=_DONE)
    cut = len(study.get_trials(deepcopy=False, states=_CUT))
    complete = [trial for trial in trials if trial.state == TrialState.COMPLETE]
    best = study.best_trial if complete else None
    states = Counter(trial.state.name.lower() for trial in trials)
    report = {
        "name": options.base.name,
        "finished": _count_trials(study) >= options.settings.trials,
        "states": states,
        "best": best and {"trial": best.number, "value": best.value, "parameters": best.params},
        "interrupted": cut,
        "trials": [_report_of(trial) for trial in trials],
    }
    write_file(options.directory / "sweep.json", json.dumps(report, indent=2) + "\n")
    counted = [f"{count} {state}" for state, count in states.items()]
    counted += [f"{cut} interrupted"] if cut else []
    print(f"{len(trials)} of {options.settings.trials} trials: {', '.join(counted) or 'none yet'}")
    if best is not None:
        chosen = overrides(best.params)
        config = load(TrainConfig, options.directory / CONFIG, chosen)
        head = f"# Trial {best.number} of {len(trials)}: success {best.value:.6g}"
        write_file(options.directory / "best.yaml", f"{head}, {', '.join(chosen)}\n{dump(config)}")
        draw(study, options.directory / "figures")
        print(f"best: {_line(best)}")
        print(f"study, best configuration and figures: {options.directory}")
    else:
        print(f"no trial is complete: best.yaml comes with the first, in {options.directory}")
    return best is not None


def _report_of(trial: FrozenTrial) -> dict[str, Any]:
    return {
        "trial": trial.number,
        "state": trial.state.name.lower(),
        "value": trial.value if trial.state == TrialState.COMPLETE else None,
        "reason": trial.user_attrs.get(REASON),
        "parameters": trial.params,
    }
