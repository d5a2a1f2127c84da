"""Train a policy: ``python -m rlcas_jax.train --config configs/quick.yaml`` (``--help`` lists
everything).
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from commands.command import run_cli
from commands.compiled import keep_compiled
from rlcas_jax.interrupt import INTERRUPTED, Interrupt

if TYPE_CHECKING:
    from rlcas_jax.cli import Options

FAILED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status: 0 done, 1 training failed, 130
    interrupted.
    """
    with Interrupt() as interrupt:
        from rlcas_jax.cli import parse

        return _train(parse(argv), interrupt)


def _train(options: "Options", interrupt: Interrupt) -> int:
    keep_compiled()
    # Imported here: --help and bad input must not wait for JAX.
    from agents.policy.file import PolicyFileError
    from rlcas_jax.devices import is_writer
    from rlcas_jax.finish import table
    from rlcas_jax.loop import TrainingError
    from rlcas_jax.training import train_all

    again = f"train --resume {options.directory}"
    try:
        summaries = train_all(options, interrupt=interrupt)
    except TrainingError as problem:
        print(f"error: {problem}", file=sys.stderr)
        return FAILED
    except (OSError, PolicyFileError) as problem:
        return report_unwritten(options.directory, problem, again)
    finished = summaries[-1]["finished"]
    if is_writer():
        print(table(options.directory, summaries))
        if not finished:
            print(f"interrupted: go on with  python -m rlcas_jax.{again}")
    return 0 if finished else INTERRUPTED


def report_unwritten(directory: Path, problem: Exception, again: str) -> int:
    """Say that a run's files cannot be written (a full disk, a folder that has gone), and return
    the exit status.
    """
    reason = (
        f"{problem.filename or directory}: {problem.strerror}"
        if isinstance(problem, OSError)
        else str(problem)
    )
    if not directory.is_dir():
        reason = f"{directory} has been moved or deleted"
    print(
        f"error: {reason}; once it can be written again, go on with  python -m rlcas_jax.{again}",
        file=sys.stderr,
    )
    return FAILED


if __name__ == "__main__":
    run_cli("rlcas_jax.train:main")
