"""Monte Carlo evaluation of a policy: ``python -m eval.monte_carlo --encounters 10000 --out
runs/first``.
"""

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.config.load import Parser, load
from agents.policy.domain import excess
from commands.command import real, whole
from commands.progress import group_digits
from envs.kinematics import Limits
from eval.config import PREFIXES, MonteCarloConfig
from eval.flights.aircraft import format_limits
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns, conditions_of, pick
from eval.flights.sources import describe_tracks, say
from eval.metrics.summary import headline, print_table, summarise
from eval.runner.command import (
    Command,
    Finished,
    FlownNow,
    Resolved,
    fly,
    run,
    summary_of_policy,
)
from eval.runner.options import (
    first_options,
    last_options,
    load_code,
    named_evaluation,
    named_policy,
    override,
    scenario_option,
)
from eval.runner.outputs import RunFolder

_DESCRIPTION = """\
Fly a policy through many encounters and say how often it succeeds, with intervals.

Sampled scenarios: circle (the paper's), crossing_left, crossing_right, head_on, same_course,
maneuvering, noisy, multi; or file:PATH for a CSV file (columns in docs/howto/own-encounters.md),
tracks:PATH for recorded tracks (a .json file of Lincoln Laboratory's encounters or of ADS-B
reports, a .daa or .xyz file of DAIDALUS), lincoln:PATH for traffic drawn from a file of one of
Lincoln Laboratory's encounter models.

Written to --out: summary.json, encounters.parquet (a row an encounter), config.yaml as resolved,
and figures as PNG and SVG. The same config.yaml gives the same table again, bit for bit, on the
same kind of machine and versions, however many workers fly it."""

_EPILOG = """\
examples:
  python -m eval.monte_carlo --policy runs/quick/policy.safetensors --out runs/circle
  python -m eval.monte_carlo --scenario multi --encounters 2000 --out runs/multi
  python -m eval.monte_carlo --scenario "multi + standing + partly_seen" --out runs/standing
  python -m eval.monte_carlo --set changes.min_initial_separation=0 --out runs/unfiltered
  python -m eval.monte_carlo --policy mine.safetensors --aircraft uas --out runs/uas
  python -m eval.monte_carlo --aircraft c208 --scenario "circle + layered" --mode plan \
    --set planner.maneuvers=both --out runs/space
  python -m eval.monte_carlo --areas zones.json --latitude 47 --longitude 8 --out runs/valley
  python -m eval.monte_carlo --resume --out runs/circle        go on with a run that was interrupted
  python -m eval.monte_carlo --scheduler tcp://node7:8786 --encounters 1000000 --out runs/many

Every key of the configuration, with its unit and default: python -m eval.monte_carlo --help-keys"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the evaluation of the command line and return the exit status; bad input raises
    ``InputError``.
    """
    return run(_COMMAND, _parser().parse_args(arguments))


def evaluate(
    keys: Mapping[str, Any], folder: Path, *, sets: Iterable[str] = (), resume: bool = False
) -> Finished:
    """Fly one of several evaluations, without figures and without its table for a person.

    Args:
        keys: of the configuration, with their values; None: the default.
        folder: of the run.
        sets: more keys, as ``KEY=VALUE``.
        resume: a run that was begun goes on.

    Raises:
        InputError: a key, its value or the folder is refused.
        UnfinishedError: it was interrupted, or a worker or the disk failed.
    """
    begun = folder / "config.yaml"
    resume = resume and begun.is_file()
    overrides = [override(key, value) for key, value in keys.items() if value is not None]
    config = load(MonteCarloConfig, begun if resume else None, [*overrides, *sets, "figures=false"])
    load_code(config)
    return fly(_COMMAND, resolve_config(config), folder, resume=resume)


def resolve_config(config: MonteCarloConfig) -> Resolved:
    """Return what a configuration names to be flown, whose first encounter has been drawn: what
    cannot be flown is refused before anything is written.
    """
    evaluation, _, resolved = named_evaluation(config)
    conditions_of(evaluation, pick(evaluation, [0]), np.arange(1), None)
    say(evaluation.source)
    packages = ("jax", "jaxlib") if evaluation.backend == "jax" else ()
    return Resolved(evaluation, config.model_copy(update=resolved), packages)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.monte_carlo", description=_DESCRIPTION, epilog=_EPILOG)
    first_options(parser)
    add = parser.add_argument
    modes = (
        "policy (once a second), plan (once, then followed), assured (monitored, planned "
        "again); default: policy"
    )
    add("--mode", metavar="MODE", help=f"what decides: {modes}")
    scenario_option(parser, *PREFIXES)
    repair = (
        "drop what is wrong in recorded tracks and accept gaps, and say what was done (default: "
        "refuse such files)"
    )
    add("--repair", action="store_const", const="true", help=repair)
    add(
        "--encounters",
        type=whole(1),
        metavar="N",
        help="how many (default: 10000, or all of a file's)",
    )
    add(
        "--seed",
        type=whole(0),
        metavar="N",
        help="seed of encounters, sensor noise and bootstrap (default: 0)",
    )
    add(
        "--baseline",
        metavar="NAME",
        help="decides in the policy's place: rules, mvp or mvp_speed (default: none)",
    )
    add(
        "--areas",
        type=_file,
        metavar="FILE",
        help="areas that every encounter has: GeoJSON, ED-269, ED-318, .plan or ICAROUS YAML",
    )
    for name, most in (("latitude", 90.0), ("longitude", 180.0)):
        of_origin = f"{name} of the encounters' origin, degrees, for --areas"
        add(f"--{name}", type=real(-most, most), metavar="DEG", help=of_origin)
    last_options(parser, "monte_carlo")
    return parser


def _file(text: str) -> str:
    """Return a path as a value of YAML, from the root."""
    return json.dumps(str(Path(text).absolute()))


def _resolve(config: MonteCarloConfig, _: argparse.Namespace) -> Resolved:
    return resolve_config(config)


def _summary(table: Mapping[str, Any], resolved: Resolved, flown: FlownNow) -> dict[str, Any]:
    config: MonteCarloConfig = resolved.config
    evaluation: Evaluation = resolved.work
    policy = named_policy(config).for_aircraft(evaluation.aircraft, outside="allow")
    columns = {
        "own_speed": "own_speed_m_s",
        "intruder_speed": "intruder_speed_m_s",
        "distance": "distance_m",
    }
    columns["intruders"] = "intruders"
    # How many encounters begin outside the operating domain, by quantity; none is left out.
    outside = {
        name: int((excess(policy.domain[name], table[key]) > 0.0).sum())
        for name, key in columns.items()
    }
    flights = {
        "baseline": config.baseline,
        "backend": config.backend,
        "limits": evaluation.limits._asdict(),
        **summarise(table, config.confidence, config.resamples, config.seed),
        "outside_domain": outside,
        **describe_tracks(evaluation.source),
    }
    return summary_of_policy("encounters", flights, resolved, flown)


def _draw(
    folder: Path, table: Mapping[str, Any], resolved: Resolved, _: Mapping[str, Any]
) -> Sequence[Path]:
    if not resolved.config.figures:
        return ()
    from eval.plots.encounters import draw_all  # matplotlib takes a second

    return draw_all(folder, table, resolved.work)


def _show(summary: Mapping[str, Any]) -> None:
    resolver = (
        summary["mode"] if summary["baseline"] == "none" else f"baseline {summary['baseline']}"
    )
    count = group_digits(summary["encounters"])
    title = f"{count} encounters, {resolver}, scenario {summary['scenario']}"
    names = ("", "value", f"{100.0 * summary['confidence']:g} % interval", "count")
    notes = [f"resolvable within the limits flown: {format_limits(Limits(**summary['limits']))}"]
    if summary["mode"] == "policy" and summary["baseline"] == "none":
        notes.append(f"decisions computed by {summary['backend']}")
    if summary["mode"] != "policy":
        notes[0] += "; for the policy alone within those of its decisions"
    if "climbs_mean" in summary:
        notes.append(
            "in space: a separation is the greater of the horizontal distance and the vertical one "
            "times horizontal by vertical separation; no encounter is proven unresolvable"
        )
    ratio, ends = summary["risk_ratio"], summary["risk_ratio_interval"]
    if ratio is not None and ends["high"] - ends["low"] > ratio:
        notes.append(
            "the interval of the risk ratio is wide (half of it exceeds half the ratio): fly more "
            "encounters"
        )
    print_table(
        f"{title}, seed {summary['seed']}",
        names,
        [line[1:] for line in headline(summary, {})],
        notes,
    )


_KEYS = {
    "mode": "mode",
    "encounters": "encounters",
    "seed": "seed",
    "baseline": "baseline",
    "workers": "workers",
    "repair": "tracks.repair",
    "areas": "areas_file",
    "latitude": "latitude",
    "longitude": "longitude",
}
_COMMAND = Command(
    name="monte_carlo",
    unit="encounters",
    folder=RunFolder,
    keys=_KEYS,
    prefix="--",
    resolve=_resolve,
    prepare=ReadyEvaluation,
    columns=columns,
    summarise=_summary,
    draw=_draw,
    show=_show,
)
