"""The command line of a hyper-parameter search, and everything that can be wrong before the first trial."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import Field

from agents.config.load import ConfigError, Parser, Strict, dump, load
from agents.config.yaml import YamlError, read
from envs.edge.files import write_file
from rlcas_jax.config import SEED_END, TrainConfig
from rlcas_jax.sweep.space import Objective, Parameter, check
from rlcas_jax.sweep.space import parse as parse_space

__all__ = ["CONFIG", "SETTINGS", "Options", "SweepConfig", "parse", "prepare"]

CONFIG, SETTINGS = "config.yaml", "settings.yaml"

_DESCRIPTION = """\
Search for hyper-parameters of the training: every trial is a training run with other values of some keys.

  python -m rlcas_jax.sweep --config configs/quick.yaml --space configs/sweep_quick.yaml --trials 30 --out runs/sweep
  python -m rlcas_jax.sweep --resume --out runs/sweep --trials 60        go on, here with 30 more
  python -m rlcas_jax.train --config runs/sweep/best.yaml                train with what was found
"""
_EPILOG = """\
space file (YAML): keys of the training configuration (python -m rlcas_jax.train --help), each with a range or choices
  ppo.learning_rate: {low: 1e-4, high: 3e-3, log: true}      a number; log draws its logarithm evenly
  ppo.epochs: {low: 2, high: 8}                              a whole number
  shaping.goal: {low: 0.0, high: 1.0, step: 0.25}            a grid
  network.hidden: {choices: [[64, 64], [256, 256]]}          anything else
  scenarios.1.weight: {low: 0.1, high: 1.0}                  an item of a list, by its index
"""


class SweepConfig(Strict):
    """A sweep as it stands in ``settings.yaml`` of its directory."""

    trials: int = Field(default=20, ge=1)
    """Trials in all, those that were stopped early among them."""
    seeds: int = Field(default=1, ge=1)
    """Training runs of a trial; the objective is their mean."""
    objective: Objective = "success"
    """What is maximised, of the deterministic policy after training: success (share of the resolvable encounters
    that it resolves) or score (mean sparse return)."""
    sampler_seed: int = Field(default=0, ge=0, lt=SEED_END)
    """Seed of the search; the same seed makes the same trials."""
    startup: int = Field(default=10, ge=0)
    """Trials that are drawn evenly from the space and never stopped early, before the model is asked."""
    pruning: bool = True
    """Stop a trial whose evaluations during training stay below the median of the trials before it."""
    space: dict[str, Any]
    """The space file."""


@dataclass(frozen=True)
class Options:
    """What the command line asks for."""

    directory: Path
    base: TrainConfig
    settings: SweepConfig
    space: tuple[Parameter, ...]
    timeout_s: float | None
    """Time after which the sweep stops as it does by Ctrl-C, s."""
    quiet: bool


def parse(argv: Sequence[str] | None = None) -> Options:
    """Read the command line; nothing is written.

    Args:
        argv: arguments without the program's name; those of the process by default.

    Raises:
        ConfigError: the arguments, the configuration, the space or the directory are not usable.
    """
    given = _parser().parse_args(argv)
    if find_spec("optuna") is None:
        raise ConfigError("the search needs Optuna: pip install 'rlcas-toolkit[sweep]'")
    if given.timeout is not None and not 0.0 < given.timeout < float("inf"):
        raise ConfigError(f"--timeout is {given.timeout}; expected a number of seconds above 0")
    directory: Path = given.out
    if given.resume:
        base, settings, source = _resumed(given, directory)
        file = directory / CONFIG
        overrides: list[str] = []
    else:
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise ConfigError(f"--out {directory} exists and is not empty; name another, or add --resume to go on")
        if given.space is None or given.trials is None:
            raise ConfigError(f"--{'space' if given.space is None else 'trials'} is missing (see --help)")
        base, settings, source, file = _base(given), _settings(given), given.space, given.config
        overrides = _overrides(given)
    space = parse_space(settings.space, source, settings.objective)
    check(space, source, lambda texts: load(TrainConfig, file, [*overrides, *texts]))
    if settings.seeds > SEED_END - base.seed:
        raise ConfigError(f"--seeds is {settings.seeds}; expected 1 to {SEED_END - base.seed}")
    return Options(directory, base, settings, space, given.timeout, given.quiet)


def prepare(options: Options) -> None:
    """Make the directory and write what ``--resume`` goes by.

    Raises:
        ConfigError: that is not possible.
    """
    try:
        options.directory.mkdir(parents=True, exist_ok=True)
        for name, text in ((CONFIG, dump(options.base)), (SETTINGS, dump(options.settings))):
            write_file(options.directory / name, text)
    except OSError as problem:
        raise ConfigError(f"--out {options.directory} cannot be written ({problem.strerror})") from None


def _base(given: Any) -> TrainConfig:
    return load(TrainConfig, given.config, _overrides(given))


def _overrides(given: Any) -> list[str]:
    return given.set + ([f"steps={given.steps}"] if given.steps else [])


def _settings(given: Any, stored: SweepConfig | None = None) -> SweepConfig:
    values: dict[str, Any] = {} if stored is None else stored.model_dump()
    for name in ("trials", "seeds", "objective", "sampler_seed", "startup"):
        value = getattr(given, name)
        if value is not None:
            low = 0 if name in ("sampler_seed", "startup") else 1
            if isinstance(value, int) and not low <= value < SEED_END:
                raise ConfigError(f"--{name.replace('_', '-')} is {value}; expected at least {low}")
            values[name] = value
    if given.no_pruning:
        values["pruning"] = False
    if given.space is not None:
        try:
            values["space"] = read(given.space)
        except YamlError as problem:
            raise ConfigError(str(problem)) from None
    return SweepConfig.model_validate(values)


def _resumed(given: Any, directory: Path) -> tuple[TrainConfig, SweepConfig, Path]:
    """Return what a sweep was begun with; options that are given again must say the same, but for --trials."""
    for name in (CONFIG, SETTINGS):
        if not (directory / name).is_file():
            what = f"it holds no {name}, so it is no sweep" if directory.is_dir() else "there is no such directory"
            raise ConfigError(f"--out {directory}: {what}")
    base, stored = load(TrainConfig, directory / CONFIG), load(SweepConfig, directory / SETTINGS)
    settings = _settings(given, stored)
    if any((given.config, given.set, given.steps)) and dump(_base(given)) != dump(base):
        raise ConfigError(
            "--config, --set and --steps give another configuration than the sweep was begun with; leave them out, or"
            " begin a new sweep without --resume"
        )
    for name in SweepConfig.model_fields:
        was, now = getattr(stored, name), getattr(settings, name)
        if name != "trials" and was != now:
            raise ConfigError(
                f"--{name.replace('_', '-')} differs from what the sweep was begun with; leave it out, or begin a new"
                " sweep without --resume"
            )
    return base, settings, directory / SETTINGS


def _parser() -> Parser:
    parser = Parser(prog="python -m rlcas_jax.sweep", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="training configuration that all trials begin from (YAML)")
    add("--space", type=Path, metavar="FILE", help="what varies (YAML, see below)")
    add("--trials", type=int, metavar="N", help="trials in all, also those of earlier calls")
    add("--out", type=Path, required=True, metavar="DIR", help="directory of the sweep")
    add("--resume", action="store_true", help="go on with the sweep of --out; only --trials may change")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of all trials, e.g. network.hidden=[64,64]; may be given many times",
    )
    add("--steps", metavar="N", help="length of each training, environment steps; short for --set steps=N")
    add("--seeds", type=int, metavar="N", help="training runs of a trial, whose mean counts (default: 1)")
    add(
        "--objective",
        choices=("success", "score"),
        help="what to maximise, of the deterministic policy after training: success, the share resolved of the"
        " resolvable encounters (default), or score, the mean sparse return (-100 to 100)",
    )
    add("--sampler-seed", type=int, metavar="N", help="seed of the search (default: 0)")
    add("--startup", type=int, metavar="N", help="trials drawn evenly and never stopped early, at first (default: 10)")
    add("--no-pruning", action="store_true", help="train every trial to its end")
    add("--timeout", type=float, metavar="S", help="stop after this time, s, so that --resume goes on (default: never)")
    add("--quiet", action="store_true", help="show no progress")
    return parser
