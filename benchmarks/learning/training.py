"""One training of the comparison, in a process of its own: ``python -m
benchmarks.learning.training`` (``--help``).

:mod:`benchmarks.learning` starts it. It appends a line to its file for every window and says in the
last how it ended; a file without that line is of a run that was stopped, which begins anew.
"""

import json
import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from agents.config.load import ConfigError, Parser, load
from benchmarks.learning.curves import WINDOW, Point, Windows
from benchmarks.learning.sides import (
    LEARNERS,
    PACKAGES,
    DivergedError,
    Side,
    available,
    side,
    updates,
)
from commands.command import real, run_cli
from commands.installation import versions
from commands.json_text import parse_json
from rlcas_jax.config import TrainConfig

__all__ = ["Log", "main", "read", "train"]

_PRINTED_EVERY_S = 20.0


@dataclass(frozen=True)
class Log:
    """What a run's file says."""

    header: dict[str, Any]
    curve: tuple[Point, ...]
    startup_s: float
    """Time to build, compile and warm up, s."""
    ended: str | None
    """Why it ended: ``steps``, ``time``, ``score`` or ``diverged``; None where it was stopped or is
    still going on.
    """


def read(path: Path) -> Log | None:
    """Return what a run's file says; None where there is none or its first line is not whole.

    Raises:
        ConfigError: the file is no run's.
    """
    if not path.exists():
        return None
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        rows = [parse_json(line) for line in lines if line.endswith("\n")]
        if not rows:
            return None
        curve = [_point(row) for row in _rows_with(rows, "steps")]
    except (ValueError, TypeError, KeyError, AttributeError):
        raise ConfigError(
            f"{path}: it is no file of a run; remove it, or choose another --out"
        ) from None
    startup = [row["startup_s"] for row in _rows_with(rows, "startup_s")]
    ends = [row["ended"] for row in _rows_with(rows, "ended")]
    return Log(
        rows[0], tuple(curve), startup[0] if startup else math.nan, ends[0] if ends else None
    )


def train(
    learner: str,
    config: TrainConfig,
    seconds: float,
    path: Path,
    name: str,
    until: float | None = None,
) -> None:
    """Train until the steps are done, the time is up, a score is reached or the learner diverges,
    and write it down.

    Args:
        learner: one of :data:`benchmarks.learning.sides.LEARNERS`.
        config: of the training, sizes of rollout and batch and the seed included.
        seconds: most time of the training, s; starting is not counted.
        path: of the file; what is there is replaced.
        name: what lines on the terminal begin with.
        until: score of a window that ends the training; None: none does.
    """
    with path.open("w", encoding="utf-8") as file:
        log = _Writer(file, name)
        header = {"learner": learner, "seconds": seconds, "until": until, "window": WINDOW}
        log.write(header | {"versions": versions(*PACKAGES[learner])})
        began = time.perf_counter()
        training = side(learner, config)
        training.start()
        log.write({"startup_s": time.perf_counter() - began})
        ended = _go_on(training, log, updates(config), seconds, until)
        if ended is not None:
            log.write({"ended": ended})


def _go_on(
    training: Side, log: "_Writer", total: int, seconds: float, until: float | None
) -> str | None:
    """Make updates, so many at most, and return why they ended; None: the process that reads the
    file is gone.
    """
    parent = os.getppid()
    windows, spent = Windows(), 0.0
    for number in range(1, total + 1):
        began = time.perf_counter()
        try:
            episodes = training.update()
        except DivergedError:
            return "diverged"
        took = time.perf_counter() - began
        spent += took
        point = windows.add(episodes, took)
        ended = _end(number == total, spent >= seconds, point, until)
        if point is None and ended is not None and not log.points:
            point = windows.finish()  # a curve has one point at least
        if point is not None:
            log.add(point, spent, last=ended is not None)
        if os.getppid() != parent:
            return None
        if ended is not None:
            return ended
    return "steps"


def _end(steps_done: bool, time_up: bool, point: Point | None, until: float | None) -> str | None:
    """Return why a training ends after an update; None: it does not."""
    if until is not None and point is not None and point.score >= until:
        return "score"
    if steps_done:
        return "steps"
    return "time" if time_up else None


class _Writer:
    """Writes the file of a run, and now and then a line on the terminal."""

    def __init__(self, file: TextIO, name: str) -> None:
        self._file, self._name = file, name
        self._shown = 0.0
        """Time of the training when a line was last printed, s."""
        self.points = 0
        """That were written."""

    def write(self, row: dict[str, Any]) -> None:
        """Append a line."""
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()

    def add(self, point: Point, spent: float, *, last: bool) -> None:
        """Append a point of the curve after so much time of the training, s."""
        has_score = not math.isnan(point.score)
        self.points += 1
        self.write(point._asdict() | {"score": point.score if has_score else None})
        if last or spent - self._shown >= _PRINTED_EVERY_S:
            score = f"score {point.score:+.1f}" if has_score else "no episode ended"
            steps = f"{point.steps / 1e6:.2f} M steps"
            print(f"  {self._name}: {steps}, {spent:.0f} s, {score}", flush=True)
            self._shown = spent


def main(argv: Sequence[str] | None = None) -> None:
    """Train once."""
    parser = Parser(prog="python -m benchmarks.learning.training", description=__doc__)
    add = parser.add_argument
    add("--learner", choices=LEARNERS, required=True, help="the learner")
    add("--config", type=Path, required=True, help="YAML file of the training")
    add(
        "--seconds",
        type=real(0.1, 1e6, "s"),
        default=600.0,
        help="most time of the training, s; starting is not counted",
    )
    add(
        "--until",
        type=real(-100.0, 100.0),
        metavar="SCORE",
        help="end where a window has this training score (default: none does)",
    )
    add("--out", type=Path, required=True, help="file of the run; what is there is replaced")
    options = parser.parse_args(argv)
    if not available(options.learner):
        raise ConfigError(
            f"--learner {options.learner}: {LEARNERS[options.learner]} is not installed"
        )
    if not options.out.parent.is_dir():
        raise ConfigError(f"--out {options.out}: there is no directory {options.out.parent}")
    config = load(TrainConfig, options.config)
    train(options.learner, config, options.seconds, options.out, options.out.stem, options.until)


def _point(row: dict[str, Any]) -> Point:
    return Point(
        row["steps"],
        row["wall_s"],
        math.nan if row["score"] is None else row["score"],
        row["episodes"],
    )


def _rows_with(rows: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    return [row for row in rows if key in row]


if __name__ == "__main__":
    run_cli(main)
