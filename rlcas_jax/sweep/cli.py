"""The command line of a hyper-parameter search, and everything that can be wrong before the first
trial.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from agents.config.load import ConfigError, Parser, Strict, file_of, load, validate
from commands.command import whole
from commands.folder_lock import is_unused
from commands.yaml import YamlError, read
from rlcas_jax.cli import add_configuration, is_named, overrides_of
from rlcas_jax.config import SEED_END, TrainConfig
from rlcas_jax.sweep.space import Space, check
from rlcas_jax.sweep.space import parse as parse_space

CONFIG, SETTINGS = "config.yaml", "settings.yaml"
_CONFIGS, _SPACE = "paper, quick, sprint", "sweep_quick"  # what ships for a search: of one phase

_DESCRIPTION = """\
Search for hyper-parameters of the training with Optuna: every trial is a training run with other
values of some keys.

  python -m rlcas_jax.sweep --config quick --space sweep_quick --trials 30 --out runs/sweep
  python -m rlcas_jax.sweep --resume --out runs/sweep --trials 60        go on, here with 30 more
  python -m rlcas_jax.train --config runs/sweep/best.yaml                train with what was found
"""
_EPILOG = """\
space file (YAML): keys of the training configuration (python -m rlcas_jax.train --help), each
with a range or choices
  learning_rate: {low: 1e-4, high: 3e-3, log: true}          a number; log: its logarithm evenly
  ppo.epochs: {low: 2, high: 8}                              a whole number
  rewards.goal_distance: {low: 0.0, high: 100.0, step: 25.0} a grid
  network.hidden: {choices: [[64, 64], [256, 256]]}          anything else
  scenarios.1.weight: {low: 0.1, high: 1.0}                  an item of a list, by its index
"""


class SweepConfig(Strict):
    """A sweep as it stands in ``settings.yaml`` of its directory."""

    trials: int = Field(ge=1, le=1_000_000)
    """Trials in all, those that were stopped early among them."""
    seeds: int = Field(default=1, ge=1, le=1000)
    """Training runs of a trial; the objective is their mean."""
    space: dict[str, Any]
    """The space file."""


@dataclass(frozen=True)
class Options:
    """What the command line asks for."""

    directory: Path
    base: TrainConfig
    settings: SweepConfig
    space: Space
    resumed: bool
    quiet: bool


def parse(argv: Sequence[str] | None = None) -> Options:
    """Read the command line, that of the process by default; raises a ConfigError, and writes
    nothing.
    """
    arguments = _parser().parse_args(argv)
    _check_complete(arguments)
    directory: Path = arguments.out
    if arguments.resume:
        for name in ("config", "space", "set", "steps", "seeds"):
            if getattr(arguments, name):
                raise ConfigError(f"--{name} cannot change a sweep that is resumed; leave it out")
        file, source, overrides = directory / CONFIG, directory / SETTINGS, []
        settings = load(
            SweepConfig, source, [f"trials={arguments.trials}"] if arguments.trials else []
        )
    else:
        if not is_unused(directory):
            raise ConfigError(
                f"--out {directory} exists and is not empty; name another, or add --resume to go on"
            )
        file, source, overrides = arguments.config, arguments.space, overrides_of(arguments)
        settings = _new_settings(arguments)
    base = load(TrainConfig, file, overrides)
    if base.phases:
        raise ConfigError(
            "phases: expected a training of one phase, as trials are compared step by step"
        )
    space = parse_space(settings.space, source)
    check(space, source, lambda texts: load(TrainConfig, file, [*overrides, *texts]))
    if settings.seeds > SEED_END - base.seed:
        raise ConfigError(f"--seeds is {settings.seeds}; expected 1 to {SEED_END - base.seed}")
    return Options(directory, base, settings, space, arguments.resume, arguments.quiet)


def _new_settings(arguments: Namespace) -> SweepConfig:
    """Return the settings of a search that begins."""
    try:
        values = {"trials": arguments.trials, "space": read(file_of(arguments.space))}
    except YamlError as problem:
        raise ConfigError(str(problem)) from None
    seeds = {} if arguments.seeds is None else {"seeds": arguments.seeds}
    return validate(SweepConfig, values | seeds)


def _check_complete(arguments: Namespace) -> None:
    """Refuse a command line without what a search needs; all that is missing in one sentence."""
    needed = {"--out DIR": arguments.out is not None}
    if not arguments.resume:
        needed = {
            f"--config FILE (or {_CONFIGS})": is_named(arguments),
            f"--space FILE (or {_SPACE})": arguments.space is not None,
            "--trials N": arguments.trials is not None,
            **needed,
        }
    missing = [name for name, is_given in needed.items() if not is_given]
    if missing:
        raise ConfigError(f"expected also {', '.join(missing)}")


def _parser() -> Parser:
    parser = Parser(prog="python -m rlcas_jax.sweep", description=_DESCRIPTION, epilog=_EPILOG)
    add_configuration(parser)
    add = parser.add_argument
    add(
        "--space",
        type=Path,
        metavar="FILE",
        help=f"what varies: YAML file (see below), or a name: {_SPACE}",
    )
    help_text = "trials in all, also those of earlier calls"
    add("--trials", type=whole(1), metavar="N", help=help_text)
    add("--out", type=Path, metavar="DIR", help="directory of the sweep")
    add(
        "--resume",
        action="store_true",
        help="go on with the sweep of --out; only --trials may change",
    )
    add(
        "--seeds",
        type=whole(1),
        metavar="N",
        help="training runs of a trial, whose mean counts (default: 1)",
    )
    return parser
