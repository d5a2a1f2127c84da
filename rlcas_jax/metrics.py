"""The figures of a training run: one JSON object a line, and TensorBoard where it is installed."""

import json
import math
import os
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, Self

import numpy as np

from commands.json_text import parse_json

FILE = "metrics.jsonl"

METRICS = {
    "step": "Environment steps since the start of the training.",
    "update": "Updates since the start of the training.",
    "wall_s": "Time spent on the run, s; when it is resumed the time before counts, too.",
    "steps_per_s": "Environment steps a second over the whole update (flying and learning).",
    "score": (
        "Mean return of the episodes that ended during the update: the task's sparse reward, "
        "undiscounted, without any shaping. The policy is the stochastic one that learns; the "
        "paper's training figure is this."
    ),
    "success": "Share of those episodes that reached the goal.",
    "violation": "Share of those episodes that lost the separation.",
    "timeout": "Share of those episodes that ran out of time.",
    "episodes": "How many episodes ended during the update.",
    "episode_length": "Environment steps of the update per episode that ended in it.",
    "reward_NAME": (
        "What the row NAME of `rewards` gave, mean over the time steps of the update, points: its "
        "weight times its term, before reward_scale. Of violation, goal, timeout and of terms "
        "of your own."
    ),
    "loss": (
        "What the optimiser minimises; of ppo policy_loss + ppo.value * value_loss - ppo.entropy * "
        "entropy + ppo.action_bound_coef * beyond_limits, mean over the last epoch of the update."
    ),
    "policy_loss": "PPO's clipped surrogate objective, negated.",
    "value_loss": "Half the critic's mean squared error, in units of the scaled reward squared.",
    "entropy": (
        "Entropy of the action distribution, nats; it falls as the policy becomes deterministic."
    ),
    "beyond_limits": (
        "Mean square of what the mean action is beyond its limits, where it is clipped."
    ),
    "neg_log_prob": "Mean negative logarithm of the density of the actions taken, nats.",
    "approx_kl": (
        "Estimate of the divergence between the policy before and after the update, nats; above "
        "about 0.05 the updates are too large."
    ),
    "clip_fraction": "Share of the samples whose probability ratio left 1 +- ppo.clip.",
    "explained_variance": (
        "Share of the returns' variance that the critic predicts: 1 at best, at or below 0 it "
        "is of no use."
    ),
    "learning_rate": "Step size of the optimiser in this update.",
    "grad_norm": "Global norm of the gradient before it is limited, mean over the last epoch.",
    "std_acceleration": "Standard deviation of the acceleration action; full deflection is 1.",
    "std_yaw_rate": "Standard deviation of the yaw rate action; full deflection is 1.",
    "eval_success": (
        "Share of the evaluation's encounters in which the deterministic policy reaches the goal."
    ),
    "eval_violation": "Share of them in which it loses the separation.",
    "eval_timeout": "Share of them in which it runs out of time.",
    "eval_score": (
        "Mean sparse return of the deterministic policy over them; not comparable with score."
    ),
}
"""What is logged, by name, with its meaning and unit."""

OF_REWARDS = "reward_"
"""Begins the names of what the rows of `rewards` gave."""

OF_ALGORITHM = "algorithm/"
"""Begins the names of the figures that an algorithm of the user's own logs beside these."""

WALL_CLOCK = (
    "wall_s",
    "steps_per_s",
)  # the only metrics in which two runs of one configuration differ
# time between two flushes of the file for TensorBoard, each of which waits for the disk, s
_FLUSH_S = 10.0


def logged_name(name: str) -> str:
    """Return the name under which an algorithm's figure is logged: its own where it is one of
    :data:`METRICS`, as ``loss``, else ``algorithm/NAME``.
    """
    return name if name in METRICS else OF_ALGORITHM + name


class Writer:
    """Appends a run's metrics to ``metrics.jsonl`` in its directory, flushed line by line; a
    context.

    Where tensorboardX is installed, the same figures go to ``tensorboard/`` beside it.
    """

    def __init__(self, directory: Path, *, resume_update: int | None = None) -> None:
        """Open the file of a run's directory, which exists.

        Args:
            resume_update: number of updates that the run goes on after; lines of later ones are
                removed, so that a resumed run leaves the file of an uninterrupted one. None begins
                a new file.
        """
        path = directory / FILE
        last = -1 if resume_update is None else resume_update
        lines = [line for line in _lines(path) if parse_json(line)["update"] <= last]
        with path.open("ab") as file:
            file.truncate(sum(map(len, lines)))
        self._file: IO[str] = path.open("a", encoding="utf-8")
        self.wall_s = float(parse_json(lines[-1])["wall_s"]) if lines else 0.0
        """Time spent until the last line that is kept, s."""
        self._board: _Board | None = None
        if find_spec("tensorboardX") is not None:
            self._board = _Board(
                directory / "tensorboard", parse_json(lines[-1])["step"] + 1 if lines else 0
            )

    def write(self, row: Mapping[str, Any]) -> None:
        """Write the figures of an update by name, as in :data:`METRICS` or of the algorithm; what
        is not finite becomes null.
        """
        for name in row:
            if name not in METRICS and not name.startswith((OF_REWARDS, OF_ALGORITHM)):
                raise KeyError(f"metric {name!r} has no description in rlcas_jax.metrics.METRICS")
        figures = {name: _number(name, value) for name, value in row.items()}
        self._file.write(json.dumps(figures) + "\n")
        self._file.flush()
        if self._board is not None:
            self._board.write(figures)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        if self._board is not None:
            self._board.close()


class _Board:
    """Writes figures for TensorBoard in this thread, so that a full disk raises here; SummaryWriter
    has its own.
    """

    def __init__(self, directory: Path, first_step: int) -> None:
        # TensorBoard forgets what earlier files have from this step on.
        from tensorboardX.event_file_writer import EventsWriter
        from tensorboardX.proto import event_pb2
        from tensorboardX.summary import scalar

        directory.mkdir(exist_ok=True)
        messages: Any = event_pb2
        self._writer, self._event, self._scalar = (
            EventsWriter(str(directory / "events")),
            messages.Event,
            scalar,
        )
        self._flushed = time.monotonic()
        self._write(
            step=first_step, session_log=messages.SessionLog(status=messages.SessionLog.START)
        )

    def write(self, figures: Mapping[str, int | float | None]) -> None:
        for name, value in figures.items():
            if value is not None and name not in ("step", "update"):
                self._write(step=figures["step"], summary=self._scalar(name, value))
        if time.monotonic() - self._flushed > _FLUSH_S:
            self._writer.flush()
            self._flushed = time.monotonic()

    def close(self) -> None:
        self._writer.close()

    def _write(self, **content: Any) -> None:
        self._writer.write_event(self._event(wall_time=time.time(), **content))


def read(path: Path) -> dict[str, np.ndarray]:
    """Return a run's metrics by name, float64 ``[updates]``, not-a-number where a line lacks one.

    The path is that of the JSONL file or of the run's directory. A last line that is only half
    written is left out.
    """
    rows = [parse_json(line) for line in _lines(path / FILE if path.is_dir() else path)]
    names = dict.fromkeys(name for row in rows for name in row)
    return {
        name: np.array(
            [math.nan if row.get(name) is None else row[name] for row in rows], np.float64
        )
        for name in names
    }


def _lines(path: Path) -> list[bytes]:
    lines = path.read_bytes().splitlines(keepends=True) if path.is_file() else []
    return lines[:-1] if lines and not lines[-1].endswith(b"\n") else lines


def _number(name: str, value: Any) -> int | float | None:
    if name in ("step", "update", "episodes"):
        return int(value)
    number = float(value)
    if not math.isfinite(number):
        return None
    # A float32 goes by the shortest text that names it: 0.1, not 0.10000000149011612.
    with np.errstate(over="ignore"):
        single = np.float32(number)
    return float(str(single)) if float(single) == number else number
