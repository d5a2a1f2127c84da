"""Train a policy: ``python -m rlcas_jax.train --config configs/quick.yaml`` (``--help`` lists everything)."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from envs.edge.command import run_cli

if TYPE_CHECKING:
    from rlcas_jax.cli import Options

__all__ = ["main"]

INTERRUPTED = 130
FAILED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status: 0 done, 1 training failed, 130 interrupted."""
    from rlcas_jax.cli import parse

    return _train(parse(argv))


def _train(options: "Options") -> int:
    from rlcas_jax.cli import prepare

    if options.processes is None or options.processes.number == 0:
        prepare(options)
    # Imported here: --help and bad input must not wait for JAX.
    from agents.policy.file import PolicyFileError
    from rlcas_jax.devices import connect, first
    from rlcas_jax.figures import training_figures
    from rlcas_jax.finish import finish, table
    from rlcas_jax.loop import TrainingError, run
    from rlcas_jax.progress import Reporter

    devices = connect(options.devices, options.processes)
    writes = first()
    if writes:
        prepare(options)  # again, for where only the cluster knows which process is the first
    summaries = []
    interrupted = False
    for job in options.jobs:
        reporter = Reporter(quiet=options.quiet or not writes)
        reporter.note(f"training {job.config.name}, seed {job.config.seed}, in {job.directory}")
        try:
            done = run(job.config, job.directory, reporter, devices, resume=job.resume)
        except TrainingError as problem:
            print(f"error: {problem}", file=sys.stderr)
            return FAILED
        except OSError as problem:
            return _unwritten(job.directory, problem)
        reporter.note("judging the policy")
        if writes:
            try:
                summaries.append(finish(done))
            except (OSError, PolicyFileError) as problem:
                return _unwritten(job.directory, problem)
        if not done.finished:
            interrupted = True
            break
    if not writes:
        return INTERRUPTED if interrupted else 0
    if len(options.jobs) > 1:
        training_figures([job.directory for job in options.jobs[: len(summaries)]], options.directory / "figures")
    print(table(options.directory, summaries))
    if interrupted:
        print(f"interrupted: go on with  python -m rlcas_jax.train --resume {options.directory}")
    return INTERRUPTED if interrupted else 0


def _unwritten(directory: Path, problem: Exception) -> int:
    """Say that a run's files cannot be written (a full disk, a folder that has gone), and return the exit status."""
    print(
        f"error: {problem}; once there is room again, what was saved goes on with  "
        f"python -m rlcas_jax.train --resume {directory}",
        file=sys.stderr,
    )
    return FAILED


if __name__ == "__main__":
    run_cli("rlcas_jax.train:main")
