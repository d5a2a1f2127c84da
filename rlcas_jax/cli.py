"""The command line of training: what it accepts, and everything that can be wrong before training
begins.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.config.keys import help_text
from agents.config.load import ConfigError, Parser, check_once, dump, load
from commands.command import whole
from commands.files import write_file
from commands.folder_lock import is_unused
from rlcas_jax.config import SEED_END, TrainConfig, configuration_of_run

NAMES = "best, paper, quick, sprint"
"""Configurations of a training that ship."""

_DESCRIPTION = """\
Train a conflict resolution policy in the surrogate.

  python -m rlcas_jax.train --config quick
  python -m rlcas_jax.train --config quick --set aircraft=uas --set learning_rate=3e-4 --seeds 3
  python -m rlcas_jax.train --resume runs/quick-20260131T120000-0
  python -m rlcas_jax.train --config FILE --out runs/wide \\
    --coordinator host0:9876 --processes 2 --process 0
"""


@dataclass(frozen=True)
class Job:
    """One training run."""

    config: TrainConfig
    directory: Path
    resume: bool  # go on from the directory's newest checkpoint


@dataclass(frozen=True)
class Processes:
    """Several processes that train together."""

    # HOST:PORT of the first one, or auto on a cluster that JAX knows (Slurm, Open MPI, Kubernetes)
    coordinator: str
    count: int | None
    number: int | None


@dataclass(frozen=True)
class Options:
    """What the command line asks for."""

    directory: Path
    jobs: tuple[Job, ...]  # one for each seed; the job of a single seed has directory for its own
    quiet: bool
    resumed: bool = False  # the directory is that of an earlier run
    devices: int | None = None  # how many devices each process uses; None: all that are visible
    processes: Processes | None = None  # the processes that train together; None: this one alone


def parse(argv: Sequence[str] | None = None, *, moment: datetime | None = None) -> Options:
    """Read the command line, that of the process by default; raises a ConfigError, and writes
    nothing.

    The ``moment`` stands in the default name of the directory.
    """
    arguments = _parser().parse_args(argv)
    processes = _processes(arguments.coordinator, arguments.processes, arguments.process)
    if arguments.resume is not None:
        for name in ("config", "set", "steps", "seeds", "out"):
            if getattr(arguments, name):
                hint = "leave it out, or start a new run without --resume"
                raise ConfigError(f"--{name} cannot change a run that is resumed; {hint}")
        directory, jobs = arguments.resume, resumed_jobs(arguments.resume)
    else:
        check_named(arguments)
        overrides = overrides_of(arguments)
        config = load(TrainConfig, arguments.config, overrides)
        _check_effective(config, overrides)
        seeds = _seeds(config, arguments.seeds)
        directory = _new_directory(config, arguments.out, processes, moment)
        jobs = _new_jobs(config, directory, seeds)
    resumed = arguments.resume is not None
    return Options(directory, jobs, arguments.quiet, resumed, arguments.devices, processes)


def _seeds(config: TrainConfig, count: int | None) -> int:
    """Return how many seeds are trained."""
    seeds = 1 if count is None else count
    if seeds > SEED_END - config.seed:
        raise ConfigError(
            f"--seeds is {seeds}; expected 1 to {SEED_END - config.seed} (seeds are below "
            f"{SEED_END})"
        )
    return seeds


def _new_directory(
    config: TrainConfig,
    named: Path | None,
    processes: Processes | None,
    began: datetime | None,
) -> Path:
    """Return the directory of a new run."""
    if processes is not None and named is None:
        raise ConfigError("--coordinator needs --out, the same directory for all processes")
    moment = datetime.now(UTC) if began is None else began
    directory = named or Path("runs") / f"{config.name}-{moment:%Y%m%dT%H%M%S}-{config.seed}"
    # Another process may have begun to fill it.
    if (processes is None or processes.number == 0) and not is_unused(directory):
        raise ConfigError(
            f"--out {directory} exists and is not empty; name another, or go on with it by --resume"
        )
    return directory


def _new_jobs(config: TrainConfig, directory: Path, seeds: int) -> tuple[Job, ...]:
    """Return the jobs of a new run, one for each seed."""
    if seeds == 1:
        return (Job(config, directory, resume=False),)
    configs = [config.model_copy(update={"seed": config.seed + i}) for i in range(seeds)]
    return tuple(
        Job(of_seed, directory / f"seed-{i}", resume=False) for i, of_seed in enumerate(configs)
    )


def write_configurations(options: Options) -> None:
    """Write each run's configuration where there is none, so that a run of several seeds can be
    resumed.
    """
    for job in options.jobs:
        file = job.directory / "config.yaml"
        try:
            if not file.exists():
                write_file(file, dump(job.config))
        except OSError as problem:
            raise ConfigError(
                f"--out {job.directory} cannot be written ({problem.strerror})"
            ) from None


def _check_effective(config: TrainConfig, overrides: Sequence[str]) -> None:
    """Refuse to change a key that the phases set themselves, which would have no effect on them."""
    for text in overrides:
        key = text.partition("=")[0]
        for number, phase in enumerate(config.phases):
            at: Any = phase
            for step in key.split("."):
                at = at.get(step) if isinstance(at, dict) else None
            if at is not None:
                raise ConfigError(
                    f"{key} is set by phase {number} itself; expected phases.{number}.{key} (--set)"
                )


def _processes(coordinator: str | None, count: int | None, number: int | None) -> Processes | None:
    """Check what is said of other processes."""
    if coordinator is None:
        if (count, number) != (None, None):
            raise ConfigError(
                "--processes and --process need --coordinator, the address of the first process"
            )
        return None
    if coordinator != "auto":
        host, _, port = coordinator.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise ConfigError(
                f"--coordinator is {coordinator!r}; expected HOST:PORT of the first process, or "
                "auto"
            )
        if count is None or number is None or not 0 <= number < count:
            numbers = f"--process is {number} of --processes {count}"
            raise ConfigError(
                f"{numbers}; expected both with --coordinator HOST:PORT, 0 to one less than their "
                "number"
            )
    return Processes(coordinator, count, number)


def resumed_jobs(directory: Path) -> tuple[Job, ...]:
    """Return the jobs of a run's directory, one for each seed, as they were configured; raises a
    ConfigError where it is no run.
    """
    single = directory / "config.yaml"
    of_seeds = [
        file for file in directory.glob("seed-*/config.yaml") if file.parent.name[5:].isdecimal()
    ]
    files = (
        [single]
        if single.is_file()
        else sorted(of_seeds, key=lambda file: int(file.parent.name[5:]))
    )
    if not files:
        problem = (
            "there is no such directory"
            if not directory.is_dir()
            else "it holds no config.yaml, so it is no run"
        )
        raise ConfigError(f"--resume {directory}: {problem}")
    begun = [any((file.parent / "checkpoints").glob("checkpoint-*.safetensors")) for file in files]
    return tuple(
        Job(configuration_of_run(file), file.parent, resume)
        for file, resume in zip(files, begun, strict=True)
    )


def add_configuration(parser: Parser) -> None:
    """Add the options that say what a training is."""
    add = parser.add_argument
    add(
        "--config",
        type=Path,
        metavar="FILE",
        help=f"YAML file with what differs from the defaults, or a name: {NAMES}",
    )
    text = (
        "change one key, e.g. learning_rate=3e-4 or scenarios.0.weight=2; may be given many times"
    )
    add("--set", action="append", default=[], metavar="KEY=VALUE", help=text)
    add(
        "--steps",
        metavar="N",
        help="length of a training, environment steps; short for --set steps=N",
    )
    add("--quiet", action="store_true", help="show no progress")


def is_named(arguments: Namespace) -> bool:
    """Return whether a command line says what is trained."""
    return arguments.config is not None or bool(arguments.set) or arguments.steps is not None


def check_named(arguments: Namespace) -> None:
    """Refuse a command line that does not say what is trained."""
    if not is_named(arguments):
        raise ConfigError(f"--config is missing; expected a YAML file, or one that ships: {NAMES}")


def overrides_of(arguments: Namespace) -> list[str]:
    """Return what ``--set`` and ``--steps`` change."""
    overrides = arguments.set + ([] if arguments.steps is None else [f"steps={arguments.steps}"])
    check_once(overrides)
    return overrides


def _parser() -> Parser:
    parser = Parser(
        prog="python -m rlcas_jax.train", description=_DESCRIPTION, epilog=help_text(TrainConfig)
    )
    add_configuration(parser)
    add = parser.add_argument
    add(
        "--seeds",
        type=whole(1),
        metavar="N",
        help="train N seeds one after another (seed, seed + 1, ...; default: 1)",
    )
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="new directory of the run (default: runs/NAME-TIME-SEED)",
    )
    add(
        "--resume",
        type=Path,
        metavar="DIR",
        help="go on with the run of this directory, as it was configured",
    )
    text = (
        "devices of each process to split the encounters over (default: all that JAX sees); a "
        "CPU is divided by N"
    )
    add("--devices", type=whole(1), metavar="N", help=text)
    text = (
        "train in several processes, on one host or many: address of the first one, or auto on a "
        "cluster that JAX "
        "knows; every process gets the same command but for --process"
    )
    add("--coordinator", metavar="HOST:PORT", help=text)
    add("--processes", type=whole(1), metavar="N", help="how many processes train together")
    add(
        "--process",
        type=whole(0),
        metavar="I",
        help="number of this process, 0 to N - 1; the first one writes the files",
    )
    return parser
