"""The command line of training: what it accepts, and everything that can be wrong before training begins."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.config.folder_lock import is_unused
from agents.config.keys import help_text
from agents.config.load import ConfigError, Parser, dump, load
from envs.edge.files import write_file
from rlcas_jax.config import SEED_END, TrainConfig

__all__ = ["Job", "Options", "Processes", "new_directory", "parse", "write_configurations"]

_DESCRIPTION = """\
Train a conflict resolution policy in the surrogate.

  python -m rlcas_jax.train --config configs/quick.yaml
  python -m rlcas_jax.train --config configs/quick.yaml --set ppo.learning_rate=3e-4 --seeds 3
  python -m rlcas_jax.train --resume runs/quick-20260131T120000-0
  python -m rlcas_jax.train --config FILE --out runs/wide --coordinator host0:9876 --processes 2 --process 0
"""


@dataclass(frozen=True)
class Job:
    """One training run."""

    config: TrainConfig
    directory: Path
    resume: bool
    """Go on from the directory's newest checkpoint."""


@dataclass(frozen=True)
class Processes:
    """Several processes that train together."""

    coordinator: str
    """``HOST:PORT`` of the first one, or ``auto`` on a cluster that JAX knows (Slurm, Open MPI, Kubernetes)."""
    count: int | None
    number: int | None


@dataclass(frozen=True)
class Options:
    """What the command line asks for."""

    directory: Path
    jobs: tuple[Job, ...]
    """One for each seed; the job of a single seed has :attr:`directory` for its own."""
    quiet: bool
    resumed: bool = False
    """The directory is that of an earlier run."""
    devices: int | None = None
    """How many devices each process uses; None: all that are visible."""
    processes: Processes | None = None
    """The processes that train together; None: this one alone."""


def parse(argv: Sequence[str] | None = None, *, now: datetime | None = None) -> Options:
    """Read the command line; nothing is written.

    Args:
        argv: arguments without the program's name; those of the process by default.
        now: moment in the default name of the directory.

    Raises:
        ConfigError: the arguments, the configuration or the directory are not usable.
    """
    given = _parser().parse_args(argv)
    if given.devices is not None and given.devices < 1:
        raise ConfigError(f"--devices is {given.devices}; expected 1 or more")
    processes = _processes(given.coordinator, given.processes, given.process)
    if given.resume is not None:
        for name in ("config", "set", "steps", "seeds", "out"):
            if getattr(given, name):
                raise ConfigError(
                    f"--{name} cannot change a run that is resumed; leave it out, or start a new run without --resume"
                )
        return Options(given.resume, _resumed(given.resume), given.quiet, True, given.devices, processes)
    overrides = given.set + ([f"steps={given.steps}"] if given.steps else [])
    config = load(TrainConfig, given.config, overrides)
    _check_effective(config, overrides)
    seeds = 1 if given.seeds is None else given.seeds
    if not 1 <= seeds <= SEED_END - config.seed:
        raise ConfigError(f"--seeds is {seeds}; expected 1 to {SEED_END - config.seed} (seeds are below {SEED_END})")
    if processes is not None and given.out is None:
        raise ConfigError("--coordinator needs --out, the same directory for all processes")
    # Another process may have begun to fill it.
    alone = processes is None or processes.number == 0
    directory = new_directory(config, given.out, now, empty=alone)
    return Options(directory, _fresh(config, directory, seeds), given.quiet, False, given.devices, processes)


def new_directory(config: TrainConfig, out: Path | None, now: datetime | None, *, empty: bool = True) -> Path:
    """Return the directory of a new run, which need not exist.

    Args:
        config: of the run.
        out: as the command line names it; by default it is named after the run, the moment and the seed.
        now: the moment; the present one by default.
        empty: whether one that is not empty is refused.

    Raises:
        ConfigError: it is not empty.
    """
    moment = datetime.now(UTC) if now is None else now
    directory = out or Path("runs") / f"{config.name}-{moment:%Y%m%dT%H%M%S}-{config.seed}"
    if empty and not is_unused(directory):
        raise ConfigError(f"--out {directory} exists and is not empty; name another, or go on with it by --resume")
    return directory


def write_configurations(options: Options) -> None:
    """Write each run's configuration where there is none, so that a run of several seeds can be resumed.

    Raises:
        ConfigError: that is not possible.
    """
    for job in options.jobs:
        file = job.directory / "config.yaml"
        try:
            if not file.exists():
                write_file(file, dump(job.config))
        except OSError as problem:
            raise ConfigError(f"--out {job.directory} cannot be written ({problem.strerror})") from None


def _check_effective(config: TrainConfig, overrides: Sequence[str]) -> None:
    """Refuse to change a key that the phases set themselves, which would have no effect on them."""
    for text in overrides:
        path = text.partition("=")[0].split(".")
        for number, phase in enumerate(config.phases):
            at: Any = phase
            for step in path:
                at = at.get(step) if isinstance(at, dict) else None
            if at is not None:
                key = ".".join(path)
                raise ConfigError(f"{key} is set by phase {number} itself; expected phases.{number}.{key} (--set)")


def _processes(coordinator: str | None, count: int | None, number: int | None) -> Processes | None:
    """Check what is said of other processes."""
    if coordinator is None:
        for name, value in (("processes", count), ("process", number)):
            if value is not None:
                raise ConfigError(f"--{name} needs --coordinator, the address of the first process")
        return None
    if coordinator == "auto":
        return Processes(coordinator, count, number)
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ConfigError(f"--coordinator is {coordinator!r}; expected HOST:PORT of the first process, or auto")
    if count is None or number is None:
        raise ConfigError("--coordinator HOST:PORT needs --processes and --process")
    if count < 1 or not 0 <= number < count:
        raise ConfigError(f"--process is {number} of --processes {count}; expected 0 to one less than their number")
    return Processes(coordinator, count, number)


def _fresh(config: TrainConfig, directory: Path, seeds: int) -> tuple[Job, ...]:
    if seeds == 1:
        return (Job(config, directory, resume=False),)
    seeds_of_jobs = range(config.seed, config.seed + seeds)
    return tuple(
        Job(config.model_copy(update={"seed": seed}), directory / f"seed-{i}", resume=False)
        for i, seed in enumerate(seeds_of_jobs)
    )


def _resumed(directory: Path) -> tuple[Job, ...]:
    single = directory / "config.yaml"
    numbered = {path.parent.name.removeprefix("seed-"): path for path in directory.glob("seed-*/config.yaml")}
    many = [numbered[number] for number in sorted((n for n in numbered if n.isdecimal()), key=int)]
    files = [single] if single.is_file() else many
    if not files:
        what = "there is no such directory" if not directory.is_dir() else "it holds no config.yaml, so it is no run"
        raise ConfigError(f"--resume {directory}: {what}")
    return tuple(Job(load(TrainConfig, file), file.parent, _has_checkpoint(file.parent)) for file in files)


def _has_checkpoint(directory: Path) -> bool:
    return any((directory / "checkpoints").glob("checkpoint-*.safetensors"))


def _parser() -> Parser:
    parser = Parser(prog="python -m rlcas_jax.train", description=_DESCRIPTION, epilog=help_text(TrainConfig))
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="YAML file with what differs from the defaults")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key, e.g. ppo.learning_rate=3e-4 or scenarios.0.weight=2; may be given many times",
    )
    add("--steps", metavar="N", help="length of the training, environment steps; short for --set steps=N")
    add("--seeds", type=int, metavar="N", help="train N seeds one after another (seed, seed + 1, ...; default: 1)")
    add("--out", type=Path, metavar="DIR", help="new directory of the run (default: runs/NAME-TIME-SEED)")
    add("--resume", type=Path, metavar="DIR", help="go on with the run of this directory, as it was configured")
    add(
        "--devices",
        type=int,
        metavar="N",
        help="devices of each process to split the encounters over (default: all that JAX sees); a CPU becomes N",
    )
    add(
        "--coordinator",
        metavar="HOST:PORT",
        help="train in several processes, on one host or many: address of the first one, or auto on a cluster that "
        "JAX knows; every process gets the same command but for --process",
    )
    add("--processes", type=int, metavar="N", help="how many processes train together")
    add("--process", type=int, metavar="I", help="number of this process, 0 to N - 1; the first one writes the files")
    add("--quiet", action="store_true", help="show no progress")
    return parser
