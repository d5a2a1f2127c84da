"""Train a policy: ``python -m rlcas_jax.train --config configs/quick.yaml`` (``--help`` lists
everything).
"""

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from envs.edge.command import run_cli
from envs.edge.compiled import keep_compiled
from rlcas_jax.interrupt import INTERRUPTED, Interrupt

if TYPE_CHECKING:
    from rlcas_jax.cli import Job, Options
    from rlcas_jax.devices import Devices

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
    from agents.config.folder_lock import is_unused, locked
    from agents.config.load import ConfigError
    from agents.policy.file import PolicyFileError
    from rlcas_jax.cli import write_configurations
    from rlcas_jax.devices import connect, first
    from rlcas_jax.figures import training_figures
    from rlcas_jax.finish import table
    from rlcas_jax.loop import TrainingError, prepared

    devices = connect(options.devices, options.processes)
    summaries: list[dict[str, Any]] = []
    with ExitStack() as stack:
        folders = dict.fromkeys([options.directory, *(job.directory for job in options.jobs)])
        if not options.resumed:
            # Nothing is written before the configuration has been checked.
            prepared(options.jobs[0].config, options.jobs[0].directory, devices)
        if first():
            for folder in folders:
                stack.enter_context(locked(folder, "--resume" if options.resumed else "--out"))
                if not options.resumed and folder == options.directory and not is_unused(folder):
                    raise ConfigError(f"--out {folder}: another run has begun in it; name another")
            write_configurations(options)
        for job in options.jobs:
            try:
                summaries.append(_job(job, options, devices, interrupt))
            except TrainingError as problem:
                print(f"error: {problem}", file=sys.stderr)
                return FAILED
            except (OSError, PolicyFileError) as problem:
                return unwritten(options.directory, problem, f"train --resume {options.directory}")
            if not summaries[-1]["finished"]:
                break
        finished = summaries[-1]["finished"]
        if first():
            if len(options.jobs) > 1:
                done = [job.directory for job in options.jobs[: len(summaries)]]
                training_figures(done, options.directory / "figures")
            print(table(options.directory, summaries))
            if not finished:
                print(
                    "interrupted: go on with  python -m rlcas_jax.train --resume "
                    f"{options.directory}"
                )
    return 0 if finished else INTERRUPTED


def _job(
    job: "Job", options: "Options", devices: "Devices", interrupt: Interrupt
) -> dict[str, Any]:
    """Train one seed and write its files; return the summary, in other processes than the first its
    end.
    """
    from rlcas_jax.devices import first
    from rlcas_jax.finish import finish
    from rlcas_jax.loop import prepared, run
    from rlcas_jax.memory import needed_bytes
    from rlcas_jax.progress import Reporter

    reporter = Reporter(quiet=options.quiet or not first())
    memory = f"needs about {needed_bytes(job.config) / 2**30:.2g} GiB of memory"
    reporter.note(
        f"training {job.config.name}, seed {job.config.seed}, in {job.directory}: {memory}"
    )
    done = run(prepared(job.config, job.directory, devices, resume=job.resume), reporter, interrupt)
    interrupt.waits_for("the evaluation of the policy")
    reporter.note("evaluating the policy")
    return finish(done) if first() else {"finished": done.finished}


def unwritten(directory: Path, problem: Exception, again: str) -> int:
    """Say that a run's files cannot be written (a full disk, a folder that has gone), and return
    the exit status.
    """
    what = (
        f"{problem.filename or directory}: {problem.strerror}"
        if isinstance(problem, OSError)
        else str(problem)
    )
    if not directory.is_dir():
        what = f"{directory} has been moved or deleted"
    print(
        f"error: {what}; once it can be written again, go on with  python -m rlcas_jax.{again}",
        file=sys.stderr,
    )
    return FAILED


if __name__ == "__main__":
    run_cli("rlcas_jax.train:main")
