"""The training run: updates, metrics, evaluations and checkpoints, phase after phase, until it is
done or stopped.
"""

import json
import math
import platform
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from agents.config.load import ConfigError, dump
from agents.policy.inputs import evaluate_input, resolve, trial_scenes
from commands.files import write_file
from commands.installation import versions
from envs.draws import uniforms
from envs.encounters import Encounter
from envs.outcome import Outcome, Rules, reward
from envs.rewards import TERMS, RewardError, shaping_of_first_step
from envs.scenarios import check_training, sample, scenario, ships
from envs.starts import check_sampled, encounters_of_seed
from envs.trees import take
from envs.world import World
from rlcas_jax import checkpoint, metrics, progress
from rlcas_jax.check_algorithm import check_algorithm
from rlcas_jax.config import TrainConfig, configuration_of_run
from rlcas_jax.devices import Devices, agree, everywhere, is_writer, place
from rlcas_jax.interrupt import Interrupt
from rlcas_jax.memory import check_memory
from rlcas_jax.task import CompiledTask, Figures, TrainState, build
from rlcas_jax.warm_start import warm_learner

_LEAST_ACCEPTED = 0.05  # smallest share of a scenario's draws that must meet its conditions


Callback = Callable[[Mapping[str, float]], None]
"""Takes the metrics of an update by name."""


class TrainingError(RuntimeError):
    """Training that cannot go on; the message says why and what is left."""


@dataclass(frozen=True)
class Training:
    """A training that can begin: everything in it has been checked, and nothing has been
    written.
    """

    config: TrainConfig
    directory: Path
    tasks: tuple[CompiledTask, ...]  # of each phase
    learner: dict[str, Any]
    """Parts of the algorithm's state by their field, of a warm start; the others are made
    afresh."""
    resumed: tuple[int, TrainState] | None
    """Phase and state of the newest checkpoint; None: the training begins."""


@dataclass(frozen=True)
class Run:
    """A training run's end."""

    directory: Path
    state: TrainState
    task: CompiledTask  # of the phase in which it ended
    config: TrainConfig
    steps: int  # environment steps in all
    finished: bool  # False when it was stopped early
    score: float  # mean sparse return of the stochastic policy over the last twentieth of the steps
    wall_s: float  # time spent, compilation and the calls before a resumption included


def prepare(
    config: TrainConfig, directory: Path, devices: Devices | None = None, *, resume: bool = False
) -> Training:
    """Check everything that a training on some devices needs (one by default), and write nothing.

    Args:
        directory: of the run; need not exist unless it is resumed from its newest checkpoint.

    Raises:
        ConfigError: the configuration is impossible, or the checkpoint is of another one.
        CheckpointError: there is nothing to resume from, or nothing to start from, or it has other
            networks.
    """
    check_memory(config)
    phases = config.phase_configs()
    check_own_code(config)
    tasks = tuple(build(phase, devices, number) for number, phase in enumerate(phases))
    check_algorithm(config, tasks)
    if resume:
        path = checkpoint.latest(directory / "checkpoints")
        meta = checkpoint.meta(path)
        if dump(configuration_of_run(meta["config"])) != dump(config):
            raise ConfigError(
                f"{directory}: its checkpoint was made with another configuration than its "
                "config.yaml"
            )
        number = int(meta["phase"])
        return Training(
            config,
            directory,
            tasks,
            {},
            (number, checkpoint.restore(path, tasks[number].shapes())),
        )
    learner = {} if config.warm_start is None else warm_learner(config, tasks[0].shapes().learner)
    return Training(config, directory, tasks, learner, None)


def run(
    training: Training,
    reporter: progress.Reporter,
    interrupt: Interrupt | None = None,
    callback: Callback | None = None,
) -> Run:
    """Train as :func:`prepare` has checked, in a directory that exists, until the end or an
    interrupt.

    Args:
        callback: called after each update with its metrics by name, as they are logged.

    Raises:
        TrainingError: a loss or a parameter is no longer finite.
        OSError: a file cannot be written.
    """
    return _Runner(training, reporter, interrupt or Interrupt(), callback).run()


class _Update(NamedTuple):
    """An update that has been started."""

    number: int  # counted over all phases
    step: int  # environment steps at its end
    figures: Figures  # on the device, perhaps still being computed


class _Runner:
    """One run of a training; of several processes the first one alone writes."""

    def __init__(
        self,
        training: Training,
        reporter: progress.Reporter,
        interrupt: Interrupt,
        callback: Callback | None,
    ) -> None:
        self._training, self._reporter, self._interrupt = training, reporter, interrupt
        self._callback = callback
        # When the run began, when it was saved last, and when the last update was reported.
        self._began = self._last_saved = self._tick = time.monotonic()
        # The tasks whose update and whose evaluation have been compiled last.
        self._compiled: CompiledTask | None = None
        self._evaluates: CompiledTask | None = None
        self._writes = is_writer()
        # Updates and environment steps before each phase, and of all.
        self._updates = [0, *accumulate(task.updates for task in training.tasks)]
        self._steps = [
            0,
            *accumulate(task.updates * task.steps_per_update for task in training.tasks),
        ]
        aircraft, settings = training.config.aircraft.aircraft(), training.config.evaluation
        self._evaluated = encounters_of_seed(
            scenario("circle", aircraft), settings.seed, 0, settings.encounters
        )
        self._log: metrics.Writer | None = None

    def run(self) -> Run:
        """Train from the beginning, or from the newest checkpoint, and return the end."""
        training = self._training
        self._interrupt.waits_for(None)
        taken_steps, resumed_update = 0, None
        if training.resumed is not None:
            number, state = training.resumed
            taken_steps = self._steps_taken(number, state)
            resumed_update = self._updates[number] + int(state.update)
        elif self._writes:
            _write_versions(training.directory)
        self._reporter.start(self._steps[-1], taken_steps, "compiling")
        with ExitStack() as stack:
            stack.callback(self._reporter.stop)
            if self._writes:
                log = metrics.Writer(training.directory, resume_update=resumed_update)
                self._log = stack.enter_context(log)
                self._began -= log.wall_s  # what was spent before
            number, state = self._phases()
        return self._end(number, state)

    def _phases(self) -> tuple[int, TrainState]:
        """Train phase after phase, until the last or until a stop is asked for; return the number
        of the phase in which it ended, and its state.
        """
        tasks, resumed = self._training.tasks, self._training.resumed
        if resumed is None:
            number, state = 0, self._begin(0, self._training.learner)
        else:
            number, state = resumed[0], place(resumed[1], tasks[resumed[0]].placed)
        while True:
            state, stopped = self._phase(number, state)
            self._save(number, state)
            if stopped or number + 1 == len(tasks):
                return number, state
            number += 1
            state = self._begin(number, everywhere(state.learner)._asdict())

    def _begin(self, number: int, learner: dict[str, Any]) -> TrainState:
        """Return the state at the start of a phase, with parts of an algorithm's state from before,
        by their fields; it is saved.
        """
        task = self._training.tasks[number]
        state = task.initial()
        if learner:
            state = place(state._replace(learner=state.learner._replace(**learner)), task.placed)
        self._save(number, state)
        return state

    def _end(self, number: int, state: TrainState) -> Run:
        """Return the end of the run, in a phase with a state."""
        training, taken_steps = self._training, self._steps_taken(number, state)
        log = metrics.read(training.directory / "metrics.jsonl") if self._writes else {}
        return Run(
            training.directory,
            state,
            training.tasks[number],
            training.config,
            taken_steps,
            finished=taken_steps == self._steps[-1],
            score=_final_score(log),
            wall_s=time.monotonic() - self._began,
        )

    def _steps_taken(self, number: int, state: TrainState) -> int:
        """Return the environment steps at a state of a phase."""
        return (
            self._steps[number] + int(state.update) * self._training.tasks[number].steps_per_update
        )

    def _phase(self, number: int, state: TrainState) -> tuple[TrainState, bool]:
        """Train until the phase ends or a stop is asked for; return the last state and whether it
        was.

        The figures of an update are read while the next one runs, unless its state is looked at:
        by an evaluation, in a checkpoint or at the end.
        """
        task, last = self._training.tasks[number], self._updates[number + 1]
        self._tick = time.monotonic()
        unread: _Update | None = None
        for update in range(self._updates[number] + int(state.update) + 1, last + 1):
            state, figures = task.update(state)
            step = self._steps[number] + (update - self._updates[number]) * task.steps_per_update
            stop = due = False
            if unread is not None:
                stop, due = self._report(task, unread)
            unread = _Update(update, step, figures)
            evaluates = self._evaluates_after(step, task.steps_per_update)
            if stop or due or evaluates or update == last or task is not self._compiled:
                stopped, long_ago = self._report(task, unread, state if evaluates else None)
                stop, due, unread = stop or stopped, due or long_ago, None
            if stop:
                return state, True
            if due:
                self._save(number, state)
        return state, False

    def _evaluates_after(self, step: int, per_update: int) -> bool:
        """Return whether the policy is evaluated after the update that ends with a step."""
        every_steps = self._training.config.evaluation.every_steps
        return (step - per_update) // every_steps != step // every_steps

    def _report(
        self, task: CompiledTask, update: _Update, state: TrainState | None = None
    ) -> tuple[bool, bool]:
        """Wait for the figures of an update, log and show them; return whether a stop is asked for,
        and whether a checkpoint is due.

        Args:
            state: after the update, of which the policy is evaluated; None: no evaluation.
        """
        row = {name: float(value) for name, value in jax.device_get(update.figures).items()}
        if not row.pop("finite"):
            raise TrainingError(
                f"a loss or a parameter is not finite after update {update.number} "
                f"(step {update.step}); the last good checkpoint is "
                f"{checkpoint.latest(self._training.directory / 'checkpoints')}"
            )
        self._interrupt.waits_for("the end of this update")
        moment = time.monotonic()
        row = {"step": update.step, "update": update.number} | row
        row |= {
            "wall_s": moment - self._began,
            "steps_per_s": task.steps_per_update / (moment - self._tick),
        }
        if self._log is not None:
            if state is not None:
                row |= self._evaluate(task, state)
            self._log.write(row)
        if task is not self._compiled:
            self._compiled = task
            self._reporter.leave_out(task.steps_per_update / row["steps_per_s"])
        self._reporter.update(row)
        if self._callback is not None:
            self._callback(row)
        self._tick = time.monotonic()
        due = self._tick - self._last_saved >= self._training.config.checkpoint.every_seconds
        stop, due = agree([self._interrupt.requested, self._writes and due])
        return stop, due

    def _evaluate(self, task: CompiledTask, state: TrainState) -> dict[str, float]:
        """Return the deterministic policy's rates; the first evaluation of a phase compiles."""
        tick = time.monotonic()
        measured = rates(outcomes(task, state, self._evaluated), task.rules)
        if task is not self._evaluates:
            self._evaluates = task
            self._reporter.leave_out(time.monotonic() - tick)
        return measured

    def _save(self, number: int, state: TrainState) -> None:
        whole = everywhere(state)
        if self._writes:
            updates = self._updates[number] + int(state.update)
            meta = {"config": dump(self._training.config), "phase": number}
            # A phase begins with the number of updates with which the one before ended: the later
            # file counts.
            checkpoint.save(self._training.directory / "checkpoints", updates, whole, meta)
        self._last_saved = self._tick = time.monotonic()


def _write_versions(directory: Path) -> None:
    """Write the platform and the versions that decide a run's numbers."""
    versions_used = {"platform": platform.platform(), "machine": platform.machine()}
    versions_used |= versions("numpy", "jax", "jaxlib", "flax", "optax", "safetensors")
    write_file(directory / "versions.json", json.dumps(versions_used, indent=2) + "\n")


def outcomes(task: CompiledTask, state: TrainState, starts: Encounter) -> Outcome:
    """Return how the deterministic policy ends encounters ``[N]``; one process may ask alone."""
    single = jax.tree.map(
        lambda field: field.astype(np.float32) if field.dtype == np.float64 else field, starts
    )
    return Outcome(*jax.device_get(task.evaluate(jax.device_get(state.learner.actor), single)))


def rates(outcome: Outcome, rules: Rules) -> dict[str, float]:
    """Return the shares of the outcomes ``[N]`` and the mean sparse score."""
    return {
        "eval_success": float(np.mean(outcome.reached)),
        "eval_violation": float(np.mean(outcome.violation)),
        "eval_timeout": float(np.mean(outcome.timeout)),
        "eval_score": float(np.mean(reward(outcome, rules, np))),
    }


def _final_score(log: dict[str, np.ndarray]) -> float:
    """Return the episodes' mean return over the last twentieth of the updates, each episode
    weighing the same.
    """
    if not log:
        return math.nan
    tail = max(1, len(log["step"]) // 20)
    score, episodes = log["score"][-tail:], log["episodes"][-tail:]
    ended = episodes > 0
    return float(np.average(score[ended], weights=episodes[ended])) if ended.any() else math.nan


def check_own_code(config: TrainConfig) -> None:
    """Refuse a scenario, a reward term or an input that fails when it is tried, or a scenario whose
    conditions are met too rarely.
    """
    for phase in config.phase_configs():
        _check_scenarios(phase)
        _check_rewards(phase)
    _check_inputs(config)


def _check_scenarios(config: TrainConfig) -> None:
    """Refuse a scenario whose conditions are met too rarely to fill a pool of starts with different
    ones.
    """
    count = 4096
    for number, drawn in enumerate(config.training_scenarios()):
        draws = uniforms(0, 0, count, (1, drawn.dimensions)).swapaxes(0, 1)
        encounters, accepted = sample(drawn, draws, np)
        check_training(drawn, encounters)
        if not ships(drawn):
            check_sampled(drawn, take(encounters, accepted))
            jax.eval_shape(lambda values, of=drawn: sample(of, values, jnp), draws)
        if accepted.mean() < _LEAST_ACCEPTED:
            raise ConfigError(
                f"scenarios.{number}: {int(accepted.sum())} of {count} draws meet the conditions "
                f"of {drawn.name}; "
                f"expected at least {_LEAST_ACCEPTED:.0%} (see min_initial_separation and "
                "conflicts_closer_than)"
            )


def _check_inputs(config: TrainConfig) -> None:
    """Refuse an input of the user's own that fails in jax; in numpy it was tried when it was
    loaded.
    """
    for entry in resolve(config.network.inputs):
        jax.eval_shape(lambda scenes, of=entry: evaluate_input(of, scenes, jnp), trial_scenes())


def _check_rewards(config: TrainConfig) -> None:
    """Refuse a reward term of the user's own that fails, in numpy or in jax, or is not finite."""
    rewards = config.rewards.table()
    if all(row.name in TERMS for row in rewards.rows):
        return
    drawn, world = config.training_scenarios()[0], World(config.rules(), config.aircraft.aircraft())
    draws = uniforms(0, 0, 64, (1, drawn.dimensions)).swapaxes(0, 1)
    starts, _ = sample(drawn, draws, np)
    for name, values in shaping_of_first_step(rewards, starts, world, np).items():
        if not np.isfinite(values).all():
            raise RewardError(f"reward {name!r}: is not finite at the start of an encounter")
    jax.eval_shape(
        lambda encounters: shaping_of_first_step(rewards, encounters, world, jnp), starts
    )
