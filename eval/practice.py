"""What a policy should practise: ``python -m eval.practice --run runs/hunt --out practice.csv``."""

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from agents.config.load import ConfigError, Parser, run_cli
from eval.runner.command import refusing, whole

if TYPE_CHECKING:
    import numpy as np

    from envs.encounters import Encounter
    from eval.flights.chunks import Evaluation
    from eval.flights.simulate import Decider
    from eval.report.folder import Run

__all__ = ["main", "npz", "policy_of", "refuse_imperfect"]

_BLOCK = 50
"""Encounters searched at a time."""

_SILENCE_S = 5.0
"""Least time between two lines of progress."""

_DESCRIPTION = """\
Take the encounters of runs of eval.monte_carlo in which the policy failed although they are not proven unresolvable, or
came to its goal by a long detour, and write them as a file of encounters that a training practises
(practice.encounters).

With --moments each is followed by so many moments of the least-cost flight that resolves it, most of them early: a
policy that begins there learns what lies behind the way that it never tries. --examples writes what such flights see
and do, for the policy to be drawn to (practice.examples). Both take a search of 0.15 s an encounter.

With --along each is followed by so many moments of the policy's own flight: what it hardly ever comes to, and does
badly, it meets often."""

_EPILOG = """\
example:
  python -m eval.monte_carlo --encounters 100000 --seed 1001 --mode policy --out runs/hunt
  python -m eval.practice --run runs/hunt --longer 25 --moments 5 --out runs/hard.csv --examples runs/hard.npz
  python -m rlcas_jax.train --config configs/quick.yaml --set practice.encounters=runs/hard.csv \\
    --set practice.examples=runs/hard.npz"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what the command line asks for, and return the exit status.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``EncounterError``.
    """
    options = _parser().parse_args(arguments)
    for name, path in (("out", options.out), ("examples", options.examples)):
        if path is not None and path.exists():
            raise ConfigError(f"--{name} {path} exists, expected the name of a new file")
        if path is not None and not path.parent.is_dir():
            raise ConfigError(f"--{name} {path}: there is no folder {path.parent}, expected one that exists")
    from envs.formats import encounter_file
    from envs.starts import joined
    from eval.report.folder import read_run

    hard = [_hard(read_run(folder), options) for folder in options.run]
    found, names = [part for one in hard for part in one.encounters], [name for one in hard for name in one.names]
    if not found:
        raise ConfigError("nothing to practise in these runs: no failure, and no detour as long as --longer")
    encounter_file.write(options.out, reduce(joined, found), names)
    print(f"{len(names)} encounters in {options.out}")
    if options.examples:
        _write_examples(options.examples, [part for one in hard for part in one.examples], options.most_examples)
    return 0


class _Hard(NamedTuple):
    """What there is to be practised of a run."""

    encounters: "list[Encounter]"
    """In parts."""
    names: list[str]
    """Of all of them."""
    examples: "list[tuple[np.ndarray, np.ndarray]]"
    """Observations and actions, in parts."""


def _hard(run: "Run", options: argparse.Namespace) -> _Hard:
    from envs.intruder import Intent
    from eval.flights.chunks import picked
    from eval.practice_flights import along, examples, moments, resolving
    from eval.report.flights import evaluation_of

    evaluation = evaluation_of(run, options.policy)
    rules, limits = evaluation.rules, evaluation.limits
    policy = policy_of(run, evaluation) if options.along else None
    numbers = _chosen(run, options.longer)[: options.most]
    print(f"{run.folder}: {len(numbers)} of {len(run.table['encounter'])} encounters", flush=True)
    result, said = _Hard([], [], []), time.monotonic()
    for done in range(0, len(numbers), _BLOCK):
        block = numbers[done : done + _BLOCK]
        starts, labels = picked(evaluation, block), _labels(run, block)
        if not isinstance(starts.intent, Intent):
            raise ConfigError(f"--run {run.folder} flew recorded tracks, which a file of encounters cannot hold")
        result.encounters.append(starts)
        result.names.extend(labels)
        if policy is not None:
            refuse_imperfect(run, starts)
            later, of, times = along(starts, policy, rules, limits, options.along)
            result.encounters.append(later)
            result.names.extend(f"{labels[row]} along {at:g} s" for row, at in zip(of, times, strict=True))
        if options.moments or options.examples:
            flights = resolving(starts, rules, limits, options.spare)
            later, of, times = moments(flights, rules, options.moments)
            result.encounters.append(later)
            result.names.extend(f"{labels[row]} at {at:g} s" for row, at in zip(of, times, strict=True))
            result.examples.append(examples(flights, rules, limits))
        if time.monotonic() - said > _SILENCE_S:
            said = time.monotonic()
            print(f"{done + len(block)} of {len(numbers)} searched", file=sys.stderr, flush=True)
    return result


def policy_of(run: "Run", evaluation: "Evaluation") -> "Decider":
    """Return the policy that flew a run.

    Raises:
        ConfigError: none did, but a planner, say.
    """
    from agents.policy.inference import Policy

    if run.config.mode != "policy":
        raise ConfigError(f"--run {run.folder} flew in mode {run.config.mode}, expected policy")
    return Policy.load(evaluation.policy).rowwise


def refuse_imperfect(run: "Run", starts: "Encounter") -> None:
    """Refuse encounters of a run whose reports are noisy or come late: what is flown here sees the truth.

    Raises:
        ConfigError: there are such.
    """
    if any((quality > 0.0).any() for quality in starts.sensor):
        raise ConfigError(f"--run {run.folder} flew with noisy or late reports, expected perfect ones")


def _write_examples(path: Path, parts: "list[tuple[np.ndarray, np.ndarray]]", most: int) -> None:
    """Write at most so many of the examples, evenly over all."""
    import numpy as np

    observation, action = (np.concatenate(each) for each in zip(*parts, strict=True))
    if not len(action):
        raise ConfigError(
            f"--examples {path}: there is none, because no flight that resolves these encounters is known, or an "
            "intruder turns in each; the encounters are written"
        )
    kept = np.linspace(0, len(action), min(most, len(action)), endpoint=False).astype(int)
    np.savez_compressed(path, observation=observation[kept], action=action[kept])
    print(f"{len(kept)} of {len(action)} examples in {path}")


def _chosen(run: "Run", longer: float) -> "np.ndarray":
    """Return the numbers of the encounters to be practised, ascending, int ``[M]``."""
    from eval.failures.groups import failures

    table = run.table
    detour = (table["outcome"] == "reached") & (100.0 * table["path_excess"] >= longer)
    return table["encounter"][failures(table) | detour]


def _labels(run: "Run", numbers: "np.ndarray") -> list[str]:
    """Return the names of a run's encounters: the file's own, or scenario, seed and number."""
    stem = f"{run.config.scenario} {run.config.seed}-"
    return [f"{stem}{n}" if name is None else name for n, name in zip(numbers, run.table["name"][numbers], strict=True)]


def npz(text: str) -> Path:
    """Return the name of a file of examples, from the command line."""
    if not text.endswith(".npz"):
        raise argparse.ArgumentTypeError(f"{text!r}; expected the name of a file that ends in .npz")
    return Path(text)


def _number(least: float, most: float, wanted: str) -> Callable[[str], float]:
    """Return a type of an option: a number within ``least`` and ``most``."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text!r}; expected {wanted}")
        return value

    return number


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.practice", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--run", type=Path, metavar="DIR", action="append", required=True, help="finished run; may be given many times")
    add("--out", type=Path, metavar="FILE", required=True, help="new CSV file")
    add(
        "--longer",
        type=_number(sys.float_info.min, sys.float_info.max, "a number above 0, percent"),
        metavar="PERCENT",
        default=float("inf"),
        help="take successes whose path is longer than the route by this and more, too (default: failures alone)",
    )
    add(
        "--moments",
        type=whole(0),
        metavar="N",
        default=0,
        help="moments of a flight that resolves it to add to each encounter (default: 0)",
    )
    add(
        "--along",
        type=whole(0),
        metavar="N",
        default=0,
        help="moments of the policy's own flight to add to each encounter (default: 0)",
    )
    add("--examples", type=npz, metavar="FILE", help="new .npz file of examples to write besides")
    add(
        "--most-examples",
        type=whole(1),
        metavar="N",
        default=40_000,
        help="keep so many of them, evenly over all (default: 40000)",
    )
    add(
        "--spare",
        type=_number(0.0, 1e5, "a number from 0 to 100000, m"),
        metavar="M",
        default=100.0,
        help="what these flights keep beyond the separation where they can, m (default: 100)",
    )
    add("--most", type=whole(1), metavar="N", help="take the first N of each run (default: all)")
    add("--policy", type=Path, metavar="FILE", help="the runs' policy, where its file lies elsewhere now")
    return parser


if __name__ == "__main__":
    run_cli(refusing(main))
