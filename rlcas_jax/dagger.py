"""Refine a policy by what it is told on its flights: ``python -m rlcas_jax.dagger --config configs/best_told.yaml``."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from agents.config.keys import help_text
from agents.config.load import ConfigError, Parser, dump, load, run_cli
from agents.policy.file import PolicyFileError
from rlcas_jax.cli import new_directory
from rlcas_jax.dagger_config import DaggerRun

__all__ = ["Options", "main", "parse"]

_DESCRIPTION = """\
Refine a policy: it is flown, told what is better where lessons speak (practice.pressed, prompt, unwind), learns all
that it was told so far by regression, and is flown again (DAgger, Ross et al. 2011).

  python -m rlcas_jax.dagger --config configs/best_told.yaml
  python -m rlcas_jax.dagger --config FILE --set dagger.rounds=5 --out runs/refined
  python -m rlcas_jax.dagger --resume runs/refined                what of a round is done is not done again
"""

FAILED = 1
_SILENCE_S = 10.0


@dataclass(frozen=True)
class Options:
    """What the command line asks for."""

    config: DaggerRun
    directory: Path
    quiet: bool


def parse(argv: Sequence[str] | None = None, *, now: datetime | None = None) -> Options:
    """Read the command line; nothing is written.

    Args:
        argv: arguments without the program's name; those of the process by default.
        now: moment in the default name of the directory.

    Raises:
        ConfigError: the arguments, the configuration or the directory are not usable.
    """
    given = _parser().parse_args(argv)
    if given.resume is not None:
        for name in ("config", "set", "out"):
            if getattr(given, name):
                raise ConfigError(f"--{name} cannot change a run that is resumed; leave it out, or start a new run")
        file = given.resume / "config.yaml"
        if not file.is_file():
            raise ConfigError(f"--resume {given.resume}: it holds no config.yaml, so it is no run")
        return Options(load(DaggerRun, file), given.resume, given.quiet)
    config = load(DaggerRun, given.config, given.set)
    return Options(config, new_directory(config, given.out, now), given.quiet)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status: 0 done, 1 it failed.

    Raises:
        ConfigError: bad input; so is ``PolicyFileError``.
        KeyboardInterrupt: somebody stopped it; what is done is saved.
    """
    options = parse(argv)
    from rlcas_jax.dagger_rounds import refine  # with JAX: not for --help

    said = _Said(options.quiet)
    try:
        options.directory.mkdir(parents=True, exist_ok=True)
        (options.directory / "config.yaml").write_text(dump(options.config), encoding="utf-8")
        said.note(f"refining {options.config.start_from}, seed {options.config.seed}, in {options.directory}")
        summary = refine(options.config, options.directory, said)
    except KeyboardInterrupt:
        said.note(f"interrupted: go on with  python -m rlcas_jax.dagger --resume {options.directory}", always=True)
        raise
    except OSError as problem:
        print(f"error: {problem}; what is done goes on with --resume {options.directory}", file=sys.stderr)
        return FAILED
    print(_table(options.directory, summary))
    return 0


class _Said:
    """Says how far it is, every ten seconds."""

    def __init__(self, quiet: bool) -> None:
        self._quiet, self._last, self._began, self._what = quiet, time.monotonic(), time.monotonic(), ""

    def note(self, text: str, *, always: bool = False) -> None:
        """Say something."""
        if always or not self._quiet:
            print(text, file=sys.stderr, flush=True)

    def progress(self, what: str, done: int, of: int) -> None:
        """Say how much of something is done, unless that was said just now."""
        from rlcas_jax.progress import duration

        now = time.monotonic()
        if what != self._what:
            self._what, self._began = what, now
        if done == of or now - self._last >= _SILENCE_S:
            self._last = now
            left = "" if done == of else f", {duration((now - self._began) / max(done, 1) * (of - done))} left"
            self.note(f"{what}: {done} of {of}{left}")


def _table(directory: Path, summary: dict[str, Any]) -> str:
    """Return what a person wants to know at the end, as text."""
    lines = ["round       told   resolved  violations  time-outs  (deterministic, of the final encounters)"]
    lines += [
        f"{number:>5} {row['told']:>10,} {row['success_given_resolvable']:>10.2%} "
        f"{row['violation_rate']:>11.2%} {row['timeout_rate']:>10.2%}"
        for number, row in enumerate(summary["rounds"])
    ]
    return "\n".join([*lines, f"policy, summary and metrics: {directory}"])


def _parser() -> Parser:
    parser = Parser(prog="python -m rlcas_jax.dagger", description=_DESCRIPTION, epilog=help_text(DaggerRun))
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="YAML file with what differs from the defaults")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key, e.g. dagger.rounds=5; may be given many times",
    )
    add("--out", type=Path, metavar="DIR", help="new directory of the run (default: runs/NAME-TIME-SEED)")
    add("--resume", type=Path, metavar="DIR", help="go on with the run of this directory, as it was configured")
    add("--quiet", action="store_true", help="show no progress")
    return parser


if __name__ == "__main__":
    run_cli(main, PolicyFileError)
