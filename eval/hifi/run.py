"""Flights of the true aircraft: ``python -m eval.hifi --scenario head_on --flights 50 --out
runs/hifi``.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError, Parser
from agents.planner.answer import RequestError
from commands.command import require, whole
from commands.progress import group_digits
from envs.c208.flightgear import flightgear_at
from envs.wind import Wind
from eval.config import FILE
from eval.hifi.config import HifiConfig, LevelRanges
from eval.hifi.flights import Campaign, prepare
from eval.hifi.rows import HifiFolder, columns
from eval.hifi.summary import error_rows, rate_rows, summarise
from eval.hifi.wind import options_in
from eval.metrics.summary import print_table
from eval.runner.command import Command, FlownNow, Resolved, run, summary_of_policy
from eval.runner.options import first_options, last_options, named_evaluation, scenario_option

_DESCRIPTION = """\
Fly what the planner, the policy or the assured loop decide on the true aircraft, a Cessna 208B in
JSBSim, and say how often that succeeds, how far the aircraft is from its plans, and which margin
covers that.

modes        plan (planned once, then followed), closed (the network once a second), assured (under
             the monitor)
vehicles     c208_ex, c208 (675 shp), point_mass (its lags and limits alone), surrogate
conditions   calm, loaded (weight, balance, inertia, drag, lift), wind (0-15 m/s), light and
             moderate (wind and turbulence), mixed (all of these), noisy (and sensors)

Written to --out: summary.json, flights.parquet (a row a flight), config.yaml as resolved, and
figures as PNG and SVG. The same config.yaml gives the same table again, however many workers fly
it."""

_EPILOG = """\
examples:
  python -m eval.hifi --scenario crossing_left --flights 4 --out runs/crossing
  python -m eval.hifi --mode assured --condition mixed --flights 500 --out runs/mixed
  python -m eval.hifi --set planner.margin=60 --set planner.vehicle=c208 --out runs/c208
  python -m eval.hifi --resume --out runs/mixed        go on with a run that was interrupted

Every key of the configuration, with its unit and default: python -m eval.hifi --help-keys"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for and return the exit status; bad input raises
    ``InputError``.
    """
    return run(_COMMAND, _parser().parse_args(arguments))


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.hifi", description=_DESCRIPTION, epilog=_EPILOG)
    first_options(parser)
    add = parser.add_argument
    add("--mode", metavar="MODE", help="what decides: plan, closed or assured (default: plan)")
    add("--vehicle", metavar="NAME", help="what flies (default: c208_ex)")
    add("--condition", metavar="NAME", help="wind, turbulence, loading and sensors (default: calm)")
    scenario_option(parser, FILE)
    add("--flights", type=whole(1), metavar="N", help="how many (default: 200, or all of a file's)")
    add(
        "--seed",
        type=whole(0),
        metavar="N",
        help="seed of encounters, conditions and noise (default: 0)",
    )
    add(
        "--flightgear",
        metavar="HOST:PORT",
        help="show the flights, one after the other in real time, in FlightGear",
    )
    last_options(parser, "hifi")
    return parser


def campaign_of(config: HifiConfig) -> tuple[Campaign, HifiConfig]:
    """Return what a configuration names to be flown, and the configuration as resolved."""
    evaluation, _, resolved = named_evaluation(config)
    unsure = config.condition.wind_error_mps
    try:
        options_in(Wind(std=unsure), evaluation.options)
    except RequestError as problem:
        raise ConfigError(f"condition.wind_error_mps is {unsure:g}: {problem}") from None
    del resolved["backend"]  # nothing here is decided in batches
    campaign = Campaign(
        policy=config.policy,
        source=evaluation.source,
        seed=config.seed,
        aircraft=evaluation.aircraft,
        mode=config.mode,
        options=evaluation.options,
        vehicle=config.vehicle,
        condition=config.condition,
        areas=config.areas,
        levels=LevelRanges(config.above_m, config.climb_mps),
    )
    return campaign, config.model_copy(update=resolved)


def _resolve(config: HifiConfig, options: argparse.Namespace) -> Resolved:
    if config.vehicle in ("c208_ex", "c208"):
        require(f"vehicle {config.vehicle}", "jsbsim")
    viewer = None
    if options.flightgear is not None:
        if config.vehicle not in ("c208_ex", "c208"):
            raise ConfigError(
                f"--flightgear: vehicle is {config.vehicle}; expected c208_ex or c208, as JSBSim "
                "flies"
            )
        if options.scheduler is not None or options.workers not in (None, 1):
            raise ConfigError(
                "--flightgear shows single flights; expected no --scheduler, and no --workers but 1"
            )
        viewer = flightgear_at(options.flightgear, paced=True)
        config = config.model_copy(update={"workers": 1})
    campaign, config = campaign_of(config)
    return Resolved(campaign._replace(viewer=viewer), config, ("jsbsim",))


def _summary(table: Mapping[str, Any], resolved: Resolved, flown: FlownNow) -> dict[str, Any]:
    config: HifiConfig = resolved.config
    campaign: Campaign = resolved.work
    flights = {
        "vehicle": config.vehicle,
        "condition": config.condition.model_dump(),
        "margin_m": campaign.options.requirement.margin,
        **summarise(table, config.confidence),
    }
    return summary_of_policy("flights", flights, resolved, flown)


def _draw(
    folder: Path, table: Mapping[str, Any], resolved: Resolved, _: Mapping[str, Any]
) -> Sequence[Path]:
    if not resolved.config.figures:
        return ()
    from eval.hifi.figures import draw_all  # matplotlib takes a second

    return draw_all(folder, table, resolved.work)


def _show(summary: Mapping[str, Any]) -> None:
    title = (
        f"{group_digits(summary['flights'])} flights of {summary['vehicle']}, "
        f"mode {summary['mode']}, scenario {summary['scenario']}, "
        f"condition {summary['condition']['name']}, seed {summary['seed']}"
    )
    interval = f"{100.0 * summary['confidence']:g} % interval"
    notes = [f"Not resolved, {count}: {why}" for why, count in summary["reasons"].items()]
    print_table(title, ("", "value", interval, "count"), rate_rows(summary), notes)
    errors = error_rows(summary)
    if errors:
        names = ("", "median", "95 % of flights", "largest")
        title = "Largest error of a flight, SAFE plans"
        print_table(title, names, errors, _about_margin(summary))


def _about_margin(summary: Mapping[str, Any]) -> list[str]:
    return [
        f"{distance} for 99 % of flights: {summary[name]['bound_m']:.1f} m; plan with it: "
        f"--set planner.{key}={summary[name]['margin_m']:g}"
        for name, key, distance in _MARGINS
        if name in summary and summary[name]["margin_m"] is not None
    ]


_MARGINS = (
    ("margin", "margin", "Margin"),
    ("vertical_margin", "vertical_margin_m", "Vertical margin"),
)
"""What stands in a summary, the key of a configuration that takes it, and its name."""

_KEYS = {
    "mode": "mode",
    "vehicle": "vehicle",
    "condition": "condition.name",
    "flights": "encounters",
    "seed": "seed",
    "workers": "workers",
}
_COMMAND = Command(
    name="hifi",
    unit="flights",
    folder=HifiFolder,
    keys=_KEYS,
    prefix="",
    resolve=_resolve,
    prepare=prepare,
    columns=columns,
    summarise=_summary,
    draw=_draw,
    show=_show,
)
