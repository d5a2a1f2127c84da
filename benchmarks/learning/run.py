"""Learning curves beside the peers': ``python -m benchmarks.learning [--quick] [--out DIR]``.

Our PPO, Stable-Baselines3's and SBX's learn the same task on the same machine: the same encounters,
inputs, shaping, networks and schedule of the learning rate. First each tries the same settings for
the same wall time and keeps the one with the best score, or with ``--trial-target`` the one that
comes to a score soonest; then each trains all seeds for the same number of steps, in turns, each in
a process of its own and one at a time. Read off: the time to a training score, scores after equal
steps and after equal wall time, with intervals over the seeds. The same command goes on where it
was stopped.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError, Parser, dump, load
from benchmarks.learning import figure as learning_figure
from benchmarks.learning import sb3 as sb3_task
from benchmarks.learning import training as learning_run
from benchmarks.learning.curves import Axis, Point, Times, ratio, score_at, t_mean, time_to_score
from benchmarks.learning.sides import LEARNERS, PACKAGES, available, check
from benchmarks.learning.training import Log
from benchmarks.learning.trials import Trial, best, describe, settings, with_setting
from benchmarks.measure import config_options, machine, report
from commands.command import real, whole
from commands.files import write_file
from eval.stats.intervals import Interval
from rlcas_jax.config import SEED_END, TrainConfig

__all__ = ["SCORES", "TARGETS", "Extent", "RunError", "main", "summary"]

SCORES = (75.0, 85.0)
"""Training scores whose time is taken; the paper's training ends at the first."""
TARGETS = {"sb3": 5.0, "sbx": 2.0}
"""How many times sooner than each peer we want to be there."""

_TRIAL_SEED = 1_000_003
"""Added to the seed for the trials, so that no setting is chosen by the seeds that are compared."""
FAILED = 1


class RunError(RuntimeError):
    """A training that did not come to its end; the message says which."""


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    steps: int = 5_000_000
    """Environment steps of a training."""
    seeds: int = 3
    budget_s: float = 600.0
    """Most time of a training, s; starting is not counted."""
    trials: int = 4
    """Settings that every learner tries; with 0 all learn as the configuration says."""
    trial_s: float = 40.0
    """Most time of a trial, s."""
    trial_seeds: int = 1
    """Trainings of a trial."""
    trial_target: float | None = None
    """Training score that trials are to reach soon, and end at; None: they are judged by the score
    at their end.
    """


QUICK = Extent(steps=400_000, seeds=2, budget_s=30.0, trials=2, trial_s=6.0)


@dataclass(frozen=True)
class _Runs:
    """What was trained."""

    trials: dict[str, list[Trial]]
    """Of each learner."""
    settings: dict[str, dict[str, float]]
    """With which each learner trains the seeds."""
    seeds: dict[str, list[Log]]
    """Of each learner."""


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, draw and print; return 0, or 1 where a training failed."""
    options, extent, config = _parse(argv)
    learners = _find_learners(options.learner)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise ConfigError(
            f"--out {options.out}: {problem.strerror}; expected a directory to write to"
        ) from None
    try:
        runs = _train(config, extent, learners, options.out)
    except RunError as problem:
        print(f"error: {problem}", file=sys.stderr)
        return FAILED
    figures = summary(runs.seeds) | {
        "configuration": config.name,
        "hidden": list(config.network.hidden),
        **{
            name: value for name, value in asdict(extent).items() if name not in ("seeds", "trials")
        },
        "settings": runs.settings,
        "trials": {
            name: [describe(trial, extent.trial_target) for trial in tried]
            for name, tried in runs.trials.items()
        },
    }
    curves = {name: [log.curve for log in logs] for name, logs in runs.seeds.items()}
    files = learning_figure.draw(curves, SCORES, options.out / "learning")
    _write_curves(runs, options.out / "curves.parquet")
    write_file(
        options.out / "summary.json", json.dumps(figures | {"machine": machine()}, indent=2) + "\n"
    )
    print(_table(figures))
    print(
        f"written: {', '.join(map(str, files))}, {options.out / 'curves.parquet'}, "
        f"{options.out / 'summary.json'}"
    )
    report(
        figures, tuple(dict.fromkeys(package for name in learners for package in PACKAGES[name]))
    )
    return 0


def summary(seeds: Mapping[str, Sequence[Log]]) -> dict[str, Any]:
    """Return what the trainings of all seeds say, for JSON: null where nothing can be said.

    Args:
        seeds: runs of each learner.
    """
    ends: dict[Axis, float] = {axis: _common_end(seeds, axis) for axis in ("steps", "wall_s")}
    times = {
        name: {score: _times([log.curve for log in logs], score) for score in SCORES}
        for name, logs in seeds.items()
    }
    content: dict[str, Any] = {
        "equal_steps": ends["steps"],
        "equal_wall_s": ends["wall_s"],
        "learners": {
            name: _learner_figures(logs, times[name], ends) for name, logs in seeds.items()
        },
    }
    content["ratios"] = {
        name: {
            f"time_to_{score:.0f}": _ratio(of[score], times["ours"][score], TARGETS[name])
            for score in SCORES
        }
        for name, of in times.items()
        if name != "ours" and "ours" in times
    }
    return content


def _lasting(logs: Sequence[Log]) -> list[tuple[Point, ...]]:
    """Return the curves of the seeds that did not diverge: one that did has no score at the end,
    and how many did is said beside the scores.
    """
    return [log.curve for log in logs if log.ended != "diverged"]


def _common_end(seeds: Mapping[str, Sequence[Log]], axis: Axis) -> float:
    """Return how far every curve goes along an axis."""
    return min(
        (getattr(curve[-1], axis) for logs in seeds.values() for curve in _lasting(logs) if curve),
        default=0.0,
    )


def _learner_figures(
    logs: Sequence[Log], times: Mapping[float, Times], ends: Mapping[Axis, float]
) -> dict[str, Any]:
    """Return the figures of one learner.

    Args:
        logs: of its seeds.
        times: when they came to each score.
        ends: places at which scores are compared.
    """
    whole = [log.curve for log in logs if log.curve]
    figures: dict[str, Any] = {
        "seeds": len(logs),
        "ended": [log.ended for log in logs],
        "startup_s": _as_json(t_mean([log.startup_s for log in logs])),
        "steps_per_s": _as_json(t_mean([curve[-1].steps / curve[-1].wall_s for curve in whole])),
    }
    for axis, place in ends.items():
        scores = [score_at(curve, place, axis) for curve in _lasting(logs)]
        finite = [score for score in scores if math.isfinite(score)]
        figures[f"score_after_equal_{axis}"] = _as_json(t_mean(finite)) | {"seeds": len(finite)}
    for score in SCORES:
        figures[f"time_to_{score:.0f}_s"] = _time_figures(times[score])
    return figures


def _times(runs: Sequence[Sequence[Point]], score: float) -> Times:
    whole = [curve for curve in runs if curve]
    return Times(
        tuple(time_to_score(curve, score, "wall_s") for curve in whole),
        tuple(curve[-1].wall_s for curve in whole),
    )


def _time_figures(times: Times) -> dict[str, Any]:
    reached = sum(time is not None for time in times.seeds)
    longer = {} if times.complete or not times.seeds else {"at_least": times.at_least()}
    return _as_json(times.mean()) | longer | {"reached": reached, "seeds": list(times.seeds)}


def _ratio(theirs: Times, ours: Times, target: float) -> dict[str, Any]:
    interval = ratio(theirs, ours)
    figures = _as_json(interval) | {"target": target}
    if math.isfinite(interval.low):
        # As with every target here: what is sure of it, not what is likely.
        return figures | {"met": interval.low >= target}
    bound = (
        theirs.at_least() / ours.mean().value
        if ours.complete and theirs.seeds and not theirs.complete
        else None
    )
    return figures | ({} if bound is None else {"at_least": bound}) | {"met": None}


def _as_json(interval: Interval) -> dict[str, float | None]:
    """Return an interval for JSON, null for what is not known."""
    return {
        key: value if math.isfinite(value) else None for key, value in interval._asdict().items()
    }


def _parser() -> Parser:
    parser = Parser(prog="python -m benchmarks.learning", description=__doc__)
    add, seconds = parser.add_argument, real(0.1, 1e6, "s")
    config_options(parser, "configs/sprint.yaml")
    add(
        "--learner",
        action="append",
        choices=LEARNERS,
        help="a learner; may be given several times (default: all)",
    )
    add(
        "--steps",
        type=whole(1),
        help="environment steps of a training (default 5000000; 400000 with --quick)",
    )
    add("--seeds", type=whole(1), help="trainings of each learner (default 3; 2 with --quick)")
    add(
        "--budget",
        dest="budget_s",
        type=seconds,
        metavar="SECONDS",
        help="most time of a training, s (default 600; 30 with --quick)",
    )
    add(
        "--trials",
        type=whole(0),
        help="settings that every learner tries first; 0: none (default 4; 2 with --quick)",
    )
    add(
        "--trial-seconds",
        dest="trial_s",
        type=seconds,
        help="most time of each of them, s (default 40; 6 with --quick)",
    )
    add("--trial-seeds", type=whole(1), help="trainings of each of them (default 1)")
    add(
        "--trial-target",
        type=real(-100.0, 100.0),
        metavar="SCORE",
        help="choose the setting that comes to this training score soonest (default: the best "
        "score at the end)",
    )
    add(
        "--quick",
        action="store_true",
        help="short trainings: shows that it works, and no learner at its end",
    )
    add(
        "--out",
        type=Path,
        default=Path("runs/learning"),
        help="directory of the results (default runs/learning)",
    )
    return parser


def _extent(options: argparse.Namespace) -> Extent:
    """Return the extent that the options ask for."""
    named = {name: getattr(options, name) for name in asdict(QUICK)}
    return replace(
        QUICK if options.quick else Extent(), **{k: v for k, v in named.items() if v is not None}
    )


def _parse(argv: Sequence[str] | None) -> tuple[argparse.Namespace, Extent, TrainConfig]:
    options = _parser().parse_args(argv)
    extent = _extent(options)
    config = load(TrainConfig, options.config, [*options.set, f"steps={extent.steps}"])
    check(config)
    return options, extent, config


def _find_learners(names: Sequence[str] | None) -> list[str]:
    """Return the learners that are installed, and print what is not.

    Raises:
        ConfigError: one that was asked for is not installed.
    """
    learners = []
    for name in dict.fromkeys(names or LEARNERS):
        if available(name):
            learners.append(name)
        elif names:
            raise ConfigError(
                f"--learner {name}: {LEARNERS[name]} is not installed; to have it: "
                f"{sb3_task.INSTALL}"
            )
        else:
            print(
                f"{LEARNERS[name]} is not installed and is left out; to have it: {sb3_task.INSTALL}"
            )
    return learners


def _train(config: TrainConfig, extent: Extent, learners: Sequence[str], folder: Path) -> _Runs:
    """Make the trials and trainings that are missing."""
    trials = _make_trials(config, extent, learners, folder / "trials")
    own = settings(config, 1)[0]
    best_settings = {
        name: best(tried, extent.trial_target) if tried else own for name, tried in trials.items()
    }
    for name, setting in best_settings.items():
        print(f"{name} learns with {_words(setting)}", flush=True)
    seeds: dict[str, list[Log]] = {name: [] for name in learners}
    for number in range(extent.seeds):
        for name in learners:
            seed = (config.seed + number) % SEED_END
            seeded = with_setting(config, best_settings[name], seed)
            path = folder / "runs" / f"{name}-seed{number}"
            seeds[name].append(_run(name, seeded, extent.budget_s, path))
    return _Runs(trials, best_settings, seeds)


def _make_trials(
    config: TrainConfig, extent: Extent, learners: Sequence[str], folder: Path
) -> dict[str, list[Trial]]:
    """Make the trials of each learner that are missing, in turns, so that a slow moment of the
    machine meets every learner alike.
    """
    trials: dict[str, list[Trial]] = {name: [] for name in learners}
    for number, setting in enumerate(settings(config, extent.trials)):
        for name in learners:
            logs = []
            for more in range(extent.trial_seeds):
                seed = (config.seed + _TRIAL_SEED + more) % SEED_END
                run = f"{name}-{number}-seed{more}" if more else f"{name}-{number}"
                seeded = with_setting(config, setting, seed)
                logs.append(_run(name, seeded, extent.trial_s, folder / run, extent.trial_target))
            trials[name].append(Trial(setting, tuple(logs)))
    return trials


def _run(
    learner: str, config: TrainConfig, seconds: float, path: Path, until: float | None = None
) -> Log:
    """Train in a process of its own, no longer than until a score, unless it is done.

    Raises:
        ConfigError: there is a run of that name that was made otherwise.
        RunError: the process failed.
    """
    text, file, log_file = dump(config), path.with_suffix(".yaml"), path.with_suffix(".jsonl")
    stored = learning_run.read(log_file)
    if stored is not None and stored.ended is not None:
        same_end = (stored.header.get("seconds"), stored.header.get("until")) == (seconds, until)
        if not file.exists() or file.read_text(encoding="utf-8") != text or not same_end:
            raise ConfigError(
                f"{log_file}: it was made with other options; expected the same ones, or another "
                "--out"
            )
        print(f"{path.name}: done before", flush=True)
        return stored
    path.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    print(f"{path.name}: {LEARNERS[learner]}, {_words(settings(config, 1)[0])}", flush=True)
    _process(learner, file, seconds, log_file, until)
    log = learning_run.read(log_file)
    if log is None or log.ended is None:
        raise RunError(f"{log_file}: the training stopped before its end; the same command goes on")
    return log


def _process(learner: str, config: Path, seconds: float, folder: Path, until: float | None) -> None:
    """Run :mod:`benchmarks.learning.training` in a process of its own, on the CPU as every learner
    here.
    """
    options = [
        "--learner",
        learner,
        "--config",
        str(config),
        "--seconds",
        repr(seconds),
        "--out",
        str(folder),
    ]
    if until is not None:
        options += ["--until", repr(until)]
    command = [sys.executable, "-m", "benchmarks.learning.training", *options]
    status = subprocess.run(
        command, env=os.environ | {"JAX_PLATFORMS": "cpu"}, check=False
    ).returncode
    if status == 130:
        raise KeyboardInterrupt
    if status:
        raise RunError(
            f"{folder}: the training ended with status {status}; the same command goes on"
        )


def _write_curves(runs: _Runs, path: Path) -> None:
    """Write every point of every curve as one table."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    named = [
        ("trial", name, [log for trial in tried for log in trial.logs])
        for name, tried in runs.trials.items()
    ]
    named += [("seed", name, logs) for name, logs in runs.seeds.items()]
    table = [
        {"phase": phase, "learner": name, "number": number} | point._asdict()
        for phase, name, logs in named
        for number, log in enumerate(logs)
        for point in log.curve
    ]
    kinds = {
        "phase": pa.string(),
        "learner": pa.string(),
        "number": pa.int64(),
        "steps": pa.int64(),
    }
    kinds |= {"wall_s": pa.float64(), "score": pa.float64(), "episodes": pa.int64()}
    pq.write_table(pa.Table.from_pylist(table, schema=pa.schema(list(kinds.items()))), path)


def _table(figures: Mapping[str, Any]) -> str:
    """Return the figures as lines for a terminal."""
    lines = [
        f"{'':6} {'steps/s':>9} " + "".join(f"{f'time to +{score:.0f}, s':>28}" for score in SCORES)
    ]
    for name, own in figures["learners"].items():
        rate = own["steps_per_s"]["value"]
        cells = "".join(f"{_cell(own[f'time_to_{score:.0f}_s']):>28}" for score in SCORES)
        lines.append(f"{name:6} {'-' if rate is None else format(rate, ',.0f'):>9} {cells}")
    for name, own in figures["ratios"].items():
        cells = "".join(f"{_cell(own[f'time_to_{score:.0f}']):>28}" for score in SCORES)
        lines.append(f"{f'{name} / ours':16} {cells}   (wanted: {TARGETS[name]:g})")
    for axis, where in (
        ("steps", f"{figures['equal_steps']:,} steps"),
        ("wall_s", f"{figures['equal_wall_s']:.0f} s"),
    ):
        scores = ", ".join(
            f"{name} {_cell(own[f'score_after_equal_{axis}'])}"
            for name, own in figures["learners"].items()
        )
        lines.append(f"score after {where}: {scores}")
    for name, own in figures["learners"].items():
        lost = own["ended"].count("diverged")
        if lost:
            lines.append(f"{name}: {lost} of {own['seeds']} seeds diverged")
    return "\n".join(lines)


def _cell(figure: Mapping[str, Any]) -> str:
    if figure["value"] is None:
        return f"more than {figure['at_least']:.2f}" if figure.get("at_least") is not None else "-"
    if figure["low"] is None:
        return f"{figure['value']:.2f}"
    return f"{figure['value']:.2f} [{figure['low']:.2f}, {figure['high']:.2f}]"


def _words(setting: Mapping[str, float]) -> str:
    return ", ".join(f"{key} {value:g}" for key, value in setting.items())
