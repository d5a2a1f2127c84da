"""What a policy should have done instead: ``python -m eval.branches --run runs/hunt --out branches.npz``."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from agents.config.load import ConfigError, Parser, run_cli
from eval.practice import npz, policy_of, refuse_imperfect
from eval.runner.command import refusing, whole

if TYPE_CHECKING:
    import numpy as np

    from eval.report.folder import Run

__all__ = ["main"]

_BLOCK = 200
"""Flights branched at a time."""

_DESCRIPTION = """\
Take the flights of runs of eval.monte_carlo in which the policy came late or not at all, without a violation; fly each
on from seven moments of it with one of eight commands kept to for 15 s, and with the policy after that; and write what
was seen and done in those 15 s where it saved most, for a policy to be drawn to (practice.examples).

A late flight takes some 0.3 s. None is branched before an intruder turns; reports must be perfect."""

_EPILOG = """\
example:
  python -m eval.monte_carlo --scenario same_course --encounters 40000 --seed 1001 --mode policy --out runs/hunt
  python -m eval.branches --run runs/hunt --out runs/branches.npz
  python -m rlcas_jax.train --config configs/quick.yaml --set practice.examples=runs/branches.npz"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what the command line asks for, and return the exit status.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``EncounterError``.
    """
    options = _parser().parse_args(arguments)
    if options.out.exists():
        raise ConfigError(f"--out {options.out} exists, expected the name of a new file")
    if not options.out.parent.is_dir():
        raise ConfigError(f"--out {options.out}: there is no folder {options.out.parent}, expected one that exists")
    import numpy as np

    from eval.report.folder import read_run

    parts = [part for folder in options.run for part in _of(read_run(folder), options)]
    if not parts:
        raise ConfigError("nothing to learn here: no flight so late has a branch that saves as much as --saves")
    observation, action = (np.concatenate(each) for each in zip(*parts, strict=True))
    np.savez_compressed(options.out, observation=observation, action=action)
    print(f"{len(action)} examples in {options.out}")
    return 0


def _of(run: "Run", options: argparse.Namespace) -> "list[tuple[np.ndarray, np.ndarray]]":
    """Return observations and actions of a run's best branches, in parts."""
    import numpy as np

    from eval.branching import branched
    from eval.flights.chunks import picked
    from eval.flights.simulate import fly
    from eval.report.flights import evaluation_of

    evaluation = evaluation_of(run, options.policy)
    rules, limits = evaluation.rules, evaluation.limits
    policy = policy_of(run, evaluation)
    table = run.table
    direct = (table["route_length_m"] - rules.goal_radius) / limits.speed_max
    late = (table["duration_s"] - direct >= options.later) & (table["outcome"] != "violation")
    numbers = table["encounter"][late][: options.most]
    print(f"{run.folder}: {len(numbers)} late ones of {len(late)} flights", flush=True)
    parts, saved, flown = [], [], 0
    for done in range(0, len(numbers), _BLOCK):
        starts = picked(evaluation, numbers[done : done + _BLOCK])
        refuse_imperfect(run, starts)
        flights, film = fly(starts, policy, rules, limits, record=True)
        assert film is not None
        best = branched(starts, flights, film, policy, rules, limits, least=options.saves)
        flown += len(starts.goal_x)
        if len(best.of):
            parts.append((best.observation, best.action))
            saved.append(best.saved)
        all_saved = np.concatenate([*saved, np.zeros(0)])
        told = f", which save {all_saved.mean():.0f} s on average" if len(all_saved) else ""
        print(f"{flown} of {len(numbers)} flights: {len(all_saved)} branches{told}", file=sys.stderr, flush=True)
    return parts


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value <= 3600.0:
        raise argparse.ArgumentTypeError(f"{text!r}; expected a number above 0 and at most 3600, s")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.branches", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--run", type=Path, metavar="DIR", action="append", required=True, help="finished run; may be given many times")
    add("--out", type=npz, metavar="FILE", required=True, help="new .npz file of examples")
    add(
        "--later",
        type=_seconds,
        metavar="S",
        default=85.0,
        help="how much later than straight ahead at full speed a flight arrives that is branched, s (default: 85)",
    )
    add(
        "--saves",
        type=_seconds,
        metavar="S",
        default=25.0,
        help="how much sooner than the flight a branch arrives that is kept, s (default: 25)",
    )
    add("--most", type=whole(1), metavar="N", help="take the first N such flights of each run (default: all)")
    add("--policy", type=Path, metavar="FILE", help="the runs' policy, where its file lies elsewhere now")
    return parser


if __name__ == "__main__":
    run_cli(refusing(main))
