"""Probability of rare losses of separation: ``python -m eval.rare --mode plan --out runs/rare``."""

import argparse
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from agents.config.load import Parser
from commands.command import real, whole
from commands.figures import save_figure
from commands.installation import versions
from envs.formats import encounter_file
from eval.flights.aircraft import describe, lines_about
from eval.flights.chunks import ReadyEvaluation
from eval.plots import save as picture_folder
from eval.rare.config import RareConfig
from eval.rare.figure import levels_figure
from eval.rare.problem import FlightProblem
from eval.rare.splitting import Plan, Repetition, pilot, repetition
from eval.rare.tail import fits, tail_figure
from eval.runner.options import (
    confidence_option,
    config_option,
    extension_option,
    load_config,
    named_evaluation,
    new_folder_option,
    policy_options,
    resume_option,
    scenario_option,
)
from eval.runner.outputs import RunFolder
from eval.runner.parts import PartsFolder
from eval.stats.intervals import share

_OPTIONS = {
    "mode": "mode",
    "seed": "seed",
    "resolvable_only": "resolvable_only",
    "closer_than": "closer_than",
    "particles": "particles",
    "moves": "moves",
    "repetitions": "repetitions",
    "confidence": "confidence",
    "encounters_per_hour": "encounters_per_hour",
}
"""Keys of the configuration by their options."""
_FREE = (*RunFolder.free, "encounters_per_hour")
"""Keys on which no flight depends."""
_SHARE = 0.2  # of the particles that passes a level
_WORST = 100
_STREAM = 0x7261_7265  # keeps the draws apart from those of other commands with the same seed
_DESCRIPTION = """\
Estimate how often the separation is lost where plain sampling would see it too rarely, by
importance splitting: the draws of the encounters whose flights come closest are copied and moved,
level by level of the smallest separation, until the required separation is lost. With
--resolvable-only encounters that are proven unresolvable never count, so that the search stays
among those that a resolver can save.

Written to --out: rare.json, rare.png and .svg (the levels), tail.png and .svg (an extreme-value
fit), config.yaml, and worst.csv: encounters that were lost, for eval.monte_carlo --scenario
file:worst.csv (docs/howto/analyse.md). Ctrl-C keeps the repetitions that are finished; --resume
goes on."""

_EPILOG = """\
examples:
  python -m eval.rare --resolvable-only --out runs/rare
  python -m eval.rare --mode plan --scenario noisy --resolvable-only --particles 200 \\
    --out runs/rare_plan
  python -m eval.rare --mode none --closer-than 5 --out runs/check   straight flight, below 5 m
  python -m eval.rare --resume --out runs/rare          go on with one that was interrupted

Keys of --set and --config are those of eval.monte_carlo (its --help-keys), and those that say how
the estimate is made: as the options, with _ for -."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Estimate what the command line asks for and return the exit status; bad input raises
    ``InputError``.
    """
    options = _parser().parse_args(arguments)
    config = load_config(RareConfig, options, _OPTIONS, "--")
    evaluation, policy, resolved = named_evaluation(config)
    del resolved["encounters"]  # as many as the particles ask for
    config = config.model_copy(update=resolved)
    problem = FlightProblem(
        ReadyEvaluation(evaluation, policy),
        config.mode,
        resolvable_only=config.resolvable_only,
        closer_than=config.closer_than,
    )
    picture_folder.check_room(options.out)
    folder = PartsFolder(options.out, config, "rare", free=_FREE)
    folder.begin(resume=options.resume)
    begun = time.perf_counter()
    with folder:
        with threadpool_limits(1):
            plan, repetitions = _split(problem, config, folder)
            blamed = [_blame(problem, repeat.last, config) for repeat in repetitions]
        estimate = {
            "schema_version": 1,
            "mode": config.mode,
            "scenario": config.scenario,
            "changes": config.changes,
            "seed": config.seed,
            **_estimate_in_json(config, plan, repetitions, blamed),
            "policy_sha256": policy.sha256,
            **describe(evaluation.aircraft, policy),
            "wall_s": time.perf_counter() - begun,
        }
        _write_worst(options.out / "worst.csv", problem, repetitions, blamed)
        picture_folder.write(options.out, "rare", estimate, levels_figure(estimate))
        if estimate["tail"]:
            save_figure(tail_figure(estimate), options.out / "tail", 130)
    _show(estimate, options.out)
    return 0


def _split(
    problem: FlightProblem, config: RareConfig, folder: PartsFolder
) -> tuple[Plan, list[Repetition]]:
    """Return the levels that a pilot run places, and the repetitions that use them; what is stored
    is not flown again.
    """
    sizes = config.particles, config.moves
    seeds = np.random.SeedSequence((config.seed, _STREAM)).spawn(config.repetitions + 1)
    first, *others = map(np.random.default_rng, seeds)
    placed = folder.part(
        "pilot", lambda: pilot(problem, problem.level, *sizes, _SHARE, first)._asdict()
    )
    plan = Plan.of_arrays(placed)
    print(f"levels: {', '.join(f'{level:.0f}' for level in plan.levels)} m", file=sys.stderr)
    repetitions: list[Repetition] = []
    for number, rng in enumerate(others, 1):
        part = folder.part(
            f"repetition_{number}",
            lambda rng=rng: repetition(problem, plan, *sizes, rng)._asdict(),
        )
        repetitions.append(Repetition.of_arrays(part))
        rate = repetitions[-1].probability[-1]
        print(f"repetition {number} of {len(others)}: {rate:.3g}", file=sys.stderr)
    return plan, repetitions


def _blame(problem: FlightProblem, draws: np.ndarray, config: RareConfig) -> np.ndarray:
    """Return for which lost encounters, by their draws ``[M, dimensions]``, a resolver can be
    blamed, bool ``[M]``: those not proven unresolvable.
    """
    if config.resolvable_only:  # all that are left are judged already
        return np.ones(len(draws), bool)
    return ~problem.unresolvable(problem.sample_encounters(draws)[0])


def _write_worst(
    path: Path,
    problem: FlightProblem,
    repetitions: Sequence[Repetition],
    blamed: Sequence[np.ndarray],
) -> None:
    """Write lost encounters, equally many of each repetition, to be flown again; no file where none
    is lost.
    """
    most = max(1, _WORST // len(repetitions))
    rows = [repeat.last[chosen][:most] for repeat, chosen in zip(repetitions, blamed, strict=True)]
    if any(map(len, rows)):
        encounter_file.write(path, problem.sample_encounters(np.concatenate(rows))[0])


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.rare", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add(
        "--mode",
        choices=("policy", "plan", "none"),
        help="what decides: policy, plan, or none, straight to the goal (default: policy)",
    )
    config_option(parser, "an estimate")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of the configuration",
    )
    policy_options(parser)
    extension_option(parser)
    scenario_option(parser)
    add("--seed", type=whole(0), metavar="N", help="seed of all draws (default: 0)")
    add(
        "--resolvable-only",
        action="store_const",
        const="true",
        help="proven unresolvable encounters do not count",
    )
    distance = real(1e-3, 1e6, "m")
    add(
        "--closer-than",
        type=distance,
        metavar="M",
        help="separations below this are losses, m (default: the required one)",
    )
    add(
        "--particles",
        type=whole(10),
        metavar="N",
        help="encounters at each level (default: 1000)",
    )
    add(
        "--moves",
        type=whole(1),
        metavar="N",
        help="changes of each at each level (default: 5)",
    )
    add(
        "--repetitions",
        type=whole(3),
        metavar="N",
        help="independent estimates (default: 10)",
    )
    confidence_option(parser)
    add(
        "--encounters-per-hour",
        type=real(1e-6, 1e4),
        metavar="R",
        help="encounters in an hour of flight: print losses an hour, too",
    )
    resume_option(parser)
    new_folder_option(parser)
    return parser


def _estimate_in_json(
    config: RareConfig, plan: Plan, repetitions: Sequence[Repetition], blamed: Sequence[np.ndarray]
) -> dict[str, Any]:
    """Return what rare.json says of the estimate."""
    first = np.concatenate([repeat.first for repeat in repetitions])
    levels = _levels_in_json(plan, repetitions, first, config.confidence)
    shares = np.array([np.mean(lost) if lost.size else 0.0 for lost in blamed])
    last = np.array([repeat.probability[-1] for repeat in repetitions])
    rate, hourly = levels[-1]["rate"], config.encounters_per_hour
    names = ("resolvable_only", "particles", "moves", "repetitions")
    estimate = {
        "separation_m": plan.levels[-1],
        **{name: getattr(config, name) for name in names},
        "confidence": config.confidence,
        "rate": rate,
        "rate_not_unresolvable": _estimate(last * shares, config.confidence),
        "levels": levels,
        "ancestors": [repeat.ancestors for repeat in repetitions],
        "flights": sum(repeat.evaluations for repeat in repetitions),
        "flights_of_the_pilot": plan.evaluations,
        "tail": fits(first, plan.levels[-1]),
        "losses_per_hour": None if hourly is None else _times(rate, hourly),
        "plain_flights_for_the_same_error": _plain_flights(rate),
        "versions": versions("numpy", "scipy", "safetensors"),
    }
    return estimate | {"warnings": _warnings(estimate)}


def _levels_in_json(
    plan: Plan, repetitions: Sequence[Repetition], first: np.ndarray, confidence: float
) -> list[dict[str, Any]]:
    """Return what rare.json says of each level; ``first``: separations of the first encounters of
    all repetitions, m, ``[N]``.
    """
    by_level = np.stack([repeat.probability for repeat in repetitions])
    levels = []
    for stage, (level, step) in enumerate(zip(plan.levels, (*plan.steps, None), strict=True)):
        accepted = [repeat.acceptance[stage] for repeat in repetitions if step]
        measured = [part for part in accepted if np.isfinite(part)]
        levels.append(
            {
                "level_m": level,
                "rate": _estimate(by_level[:, stage], confidence),
                "step": step,
                "acceptance": float(np.mean(measured)) if measured else None,
                "plain": share(np.count_nonzero(first < level), first.size, confidence),
            }
        )
    return levels


def _times(rate: dict[str, Any], factor: float) -> dict[str, float]:
    """Return a rate and its interval times a factor."""
    return {end: factor * rate[end] for end in ("value", "low", "high")}


def _plain_flights(rate: dict[str, Any]) -> float | None:
    """Return how many flights plain sampling would take for the same error; None: not known."""
    error = rate["relative_error"]
    return (1.0 - rate["value"]) / rate["value"] / error**2 if error else None


def _estimate(values: np.ndarray, confidence: float) -> dict[str, Any]:
    """Return the mean of independent estimates, its t interval, not below 0, and the estimates, in
    JSON types.
    """
    value, error = float(np.mean(values)), float(np.std(values, ddof=1)) / math.sqrt(values.size)
    half = float(stdtrit(values.size - 1, 0.5 + 0.5 * confidence)) * error
    return {
        "value": value,
        "low": max(value - half, 0.0),
        "high": value + half,
        "relative_error": error / value if value > 0.0 else None,
        "repetitions": values.tolist(),
    }


def _warnings(estimate: dict[str, Any]) -> list[str]:
    warnings = []
    values = estimate["rate"]["repetitions"]
    if not any(values):
        warnings.append(
            "no repetition lost the separation: the rate is below what so many particles can find"
        )
    elif estimate["rate"]["relative_error"] * math.sqrt(len(values)) > 0.5:
        warnings.append(
            "repetitions differ by more than half of their mean: take more particles or moves"
        )
    if min(estimate["ancestors"]) < 5 and any(values):
        warnings.append(
            "a repetition's lost encounters descend from fewer than five first ones: take more "
            "particles"
        )
    plain = estimate["plain_flights_for_the_same_error"]
    if plain is not None and plain < estimate["flights"]:
        warnings.append(
            f"plain sampling needs only {plain:.2g} flights for this error, instead of "
            f"{estimate['flights']}: this loss is not rare, use eval.monte_carlo"
        )
    low = [
        level["level_m"]
        for level in estimate["levels"]
        if level["acceptance"] is not None and level["acceptance"] < 0.05
    ]
    if low:
        warnings.append(
            f"fewer than 5 % of the steps are taken below {low[0]:.0f} m: take more moves"
        )
    return warnings


def _show(estimate: dict[str, Any], folder: Path) -> None:
    print(
        f"scenario {estimate['scenario']}, mode {estimate['mode']}, below "
        f"{estimate['separation_m']:g} m"
    )
    names = {
        "rate": "losses of separation",
        "rate_not_unresolvable": "of them not proven unresolvable",
    }
    for key, name in (
        {"rate": "losses not proven unresolvable"} if estimate["resolvable_only"] else names
    ).items():
        ends = f"{estimate[key]['low']:.3g} .. {estimate[key]['high']:.3g}"
        print(
            f"{name:34} {estimate[key]['value']:.3g}   {100.0 * estimate['confidence']:g} % "
            f"interval {ends}"
        )
    for fit in estimate["tail"]:
        print(
            f"extreme-value fit below {fit['threshold_m']:.0f} m: {fit['rate']:.3g} (shape "
            f"{fit['shape']:+.2f})"
        )
    if estimate["losses_per_hour"] is not None:
        value, low, high = (estimate["losses_per_hour"][end] for end in ("value", "low", "high"))
        print(f"losses an hour of flight: {value:.3g} ({low:.3g} .. {high:.3g})")
    plain = estimate["plain_flights_for_the_same_error"]
    plain_flights = "an unknown number" if plain is None else f"{plain:.2g} for the same error"
    print(f"flights {estimate['flights']}; plain sampling would take {plain_flights}")
    for line in [
        *lines_about(estimate),
        *(f"warning: {sentence}" for sentence in estimate["warnings"]),
    ]:
        print(line)
    print(f"written to {folder}")
