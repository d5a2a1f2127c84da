"""The training run: updates, metrics, evaluations and checkpoints until the steps are done or somebody stops it."""

import json
import math
import platform
import signal
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from agents.config.load import ConfigError, dump
from agents.policy.versions import versions
from envs.draws import uniforms
from envs.edge.files import write_file
from envs.encounters import SCENARIOS, Encounter, sample
from envs.outcome import Outcome, Rules, reward
from envs.starts import numbered
from rlcas_jax import checkpoint, metrics, progress
from rlcas_jax.config import TrainConfig
from rlcas_jax.devices import Devices, agreed, everywhere, first, local, place
from rlcas_jax.task import Task, TrainState, build
from rlcas_jax.warm_start import begun

__all__ = ["Run", "TrainingError", "made_with", "outcomes", "rates", "run"]

LEAST_ACCEPTED = 0.05
"""Smallest share of a scenario's draws that must meet its conditions."""


class TrainingError(RuntimeError):
    """Training that cannot go on; the message says why and what is left."""


@dataclass(frozen=True)
class Run:
    """A training run's end."""

    directory: Path
    state: TrainState
    task: Task
    config: TrainConfig
    finished: bool
    """False when it was interrupted."""
    score: float
    """Mean sparse return of the stochastic policy over the last twentieth of the steps."""
    wall_s: float
    """Time spent in this process, compilation included."""


def run(
    config: TrainConfig,
    directory: Path,
    reporter: progress.Reporter,
    devices: Devices | None = None,
    *,
    resume: bool = False,
) -> Run:
    """Train.

    Args:
        config: what to train.
        directory: of the run; exists, for all processes if there are several.
        reporter: shows how it goes.
        devices: to train on; one by default. Of several processes the first one alone writes.
        resume: go on from the directory's newest checkpoint instead of starting.

    Raises:
        TrainingError: a loss or a parameter is no longer finite.
        CheckpointError: there is nothing to resume from, or nothing to start from, or it has other networks.
    """
    began = time.monotonic()
    saved = directory / "checkpoints"
    _check_scenarios(config)
    task = build(config, devices)
    state, writes = task.initial(), first()
    if resume:
        whole, meta = checkpoint.restore(checkpoint.latest(saved), like=state)
        state = place(whole, task.placed)
        _check_same(config, meta, directory)
    elif config.start_from is not None:
        state = place(state._replace(learner=begun(config, state.learner)), task.placed)
    if writes and not resume:
        write_file(directory / "versions.json", json.dumps(made_with(), indent=2) + "\n")

    update = int(state.update)
    per_update = task.steps_per_update
    judged = numbered(SCENARIOS["circle"], config.evaluation.seed, 0, config.evaluation.encounters)
    log = metrics.Writer(directory, resume_update=update if resume else None) if writes else None
    reporter.start(total_steps=task.updates * per_update, step=update * per_update)

    def save() -> None:
        whole = everywhere(state)
        if writes:
            checkpoint.save(saved, int(state.update), whole, {"config": dump(config)}, keep=config.checkpoint.keep)

    last_saved = time.monotonic()
    with _interruptible() as interrupted, ExitStack() as stack:
        if log is not None:
            stack.enter_context(log)
        stack.callback(reporter.stop)
        if not resume:
            save()
        stop = False
        while update < task.updates and not stop:
            tick = time.monotonic()
            following, figures = task.update(state)
            row = {name: float(value) for name, value in jax.device_get(figures).items()}
            if not row.pop("finite"):
                raise TrainingError(
                    f"a loss or a parameter is not finite after update {update + 1} "
                    f"(step {(update + 1) * per_update}); the last good checkpoint is {checkpoint.latest(saved)}"
                )
            state = following
            before, update = update, update + 1
            row = {"step": update * per_update, "update": update} | row
            row |= {"wall_s": time.monotonic() - began, "steps_per_s": per_update / (time.monotonic() - tick)}
            if log is not None:
                if _crosses(before, update, per_update, config.evaluation.every_steps):
                    row |= rates(outcomes(task, state, judged), task.rules)
                log.write(row)
            reporter.update(row)
            due = time.monotonic() - last_saved >= config.checkpoint.every_seconds
            stop, due = agreed([interrupted(), writes and due])
            if due:
                save()
                last_saved = time.monotonic()
        save()
    return Run(
        directory,
        state,
        task,
        config,
        update >= task.updates,
        _final_score(metrics.read(directory / "metrics.jsonl")) if writes else math.nan,
        time.monotonic() - began,
    )


def outcomes(task: Task, state: TrainState, judged: Encounter) -> Outcome:
    """Return how the deterministic policy ends encounters ``[N]``; one process may ask alone."""
    single = jax.tree.map(lambda field: field.astype(np.float32) if field.dtype == np.float64 else field, judged)
    return Outcome(*jax.device_get(task.evaluate(local(state.learner.actor), single)))


def rates(outcome: Outcome, rules: Rules) -> dict[str, float]:
    """Return the shares of the outcomes ``[N]`` and the mean sparse score."""
    return {
        "eval_success": float(np.mean(outcome.reached)),
        "eval_violation": float(np.mean(outcome.violation)),
        "eval_timeout": float(np.mean(outcome.timeout)),
        "eval_score": float(np.mean(reward(outcome, rules, np))),
    }


def _crosses(before: int, after: int, per_update: int, every_steps: int) -> bool:
    return before * per_update // every_steps != after * per_update // every_steps


def _final_score(log: dict[str, np.ndarray]) -> float:
    """Return the episodes' mean return over the last twentieth of the updates, each episode weighing the same."""
    if not log:
        return math.nan
    tail = max(1, len(log["step"]) // 20)
    score, episodes = log["score"][-tail:], log["episodes"][-tail:]
    known = episodes > 0
    return float(np.average(score[known], weights=episodes[known])) if known.any() else math.nan


def made_with() -> dict[str, str]:
    """Return the platform and the versions that decide a run's numbers."""
    here = {"platform": platform.platform(), "machine": platform.machine()}
    return here | versions("numpy", "jax", "jaxlib", "flax", "optax", "safetensors")


def _check_scenarios(config: TrainConfig) -> None:
    """Refuse a scenario whose conditions are met too rarely to fill a pool of starts with different ones."""
    tried = 4096
    for number, entry in enumerate(config.scenarios):
        family = entry.scenario()
        _, accepted = sample(family, uniforms(0, 0, tried, (1, family.dimensions)).swapaxes(0, 1), np)
        if accepted.mean() < LEAST_ACCEPTED:
            raise ConfigError(
                f"scenarios.{number}: {int(accepted.sum())} of {tried} draws meet the conditions of {entry.name}; "
                f"expected at least {LEAST_ACCEPTED:.0%} (see min_initial_separation and conflicts_closer_than)"
            )


def _check_same(config: TrainConfig, meta: dict[str, Any], directory: Path) -> None:
    if meta["config"] != dump(config):
        raise ConfigError(f"{directory}: its checkpoint was made with another configuration than its config.yaml")


@contextmanager
def _interruptible() -> Generator[Callable[[], bool]]:
    """Turn the first Ctrl-C (or SIGTERM) into a question that the loop asks between updates; the second one kills."""
    asked = False

    def ask(number: int, _frame: Any) -> None:
        nonlocal asked
        asked = True
        signal.signal(number, signal.SIG_DFL if number == signal.SIGTERM else signal.default_int_handler)

    previous = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
