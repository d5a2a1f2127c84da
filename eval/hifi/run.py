"""Flights of the true aircraft: ``python -m eval.hifi --scenario head_on --flights 50 --out runs/hifi``."""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.load import ConfigError, Parser
from eval.runner.command import cluster_of, concluded, flown_on, run_in, whole_table
from eval.runner.options import first_options, last_options, loaded, named_policy, named_source, whole

if TYPE_CHECKING:
    from envs.aircraft import Aircraft
    from envs.c208.flightgear import FlightGear
    from eval.hifi.config import HifiConfig
    from eval.hifi.flights import Campaign
    from eval.hifi.rows import HifiFolder


_DECISIVE = ("jsbsim",)
"""More packages with versions that flights depend on."""

_DESCRIPTION = """\
Fly what the planner, the policy or the assured loop decide on the true aircraft, a Cessna 208B in JSBSim, and say how
often that succeeds, how far the aircraft is from its plans, and which margin covers that.

modes        plan (planned once, then followed), closed (the network once a second), assured (under the monitor)
vehicles     c208_ex, c208 (675 shp), point_mass (its lags and limits alone), surrogate
conditions   calm, loaded (weight, balance, inertia, drag, lift), wind (0-15 m/s), light and moderate (wind and
             turbulence), mixed (all of these), noisy (and sensors)

Written to --out: summary.json, flights.parquet (a row a flight), config.yaml as resolved, and figures as PNG and SVG.
The same config.yaml gives the same table again, however many workers fly it."""

_EPILOG = """\
examples:
  python -m eval.hifi --scenario crossing_left --flights 4 --out runs/crossing
  python -m eval.hifi --mode assured --condition mixed --flights 500 --out runs/mixed
  python -m eval.hifi --set planner.margin=60 --set planner.vehicle=c208 --out runs/c208
  python -m eval.hifi --resume --out runs/mixed        go on with a run that was interrupted

Every key of the configuration, with its unit and default: python -m eval.hifi --help-keys"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for and return the exit status; bad input raises ``InputError``."""
    options = _parser().parse_args(arguments)
    if options.help_keys:
        from agents.config.keys import help_text
        from eval.hifi.config import HifiConfig

        print(help_text(HifiConfig))
        return 0
    return concluded(_run, options)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.hifi", description=_DESCRIPTION, epilog=_EPILOG)
    first_options(parser)
    add = parser.add_argument
    add("--mode", metavar="MODE", help="what decides: plan, closed or assured (default: plan)")
    add("--vehicle", metavar="NAME", help="what flies (default: c208_ex)")
    add("--condition", metavar="NAME", help="what it meets (default: calm)")
    add("--scenario", metavar="NAME", help="a scenario's name or file:PATH (default: circle)")
    add("--flights", type=whole(1), metavar="N", help="how many (default: 200, or all of a file's)")
    add("--seed", type=whole(0), metavar="N", help="of encounters, conditions and noise (default: 0)")
    add("--flightgear", metavar="HOST:PORT", help="show the flights, one after the other in real time, in FlightGear")
    last_options(parser, "hifi")
    return parser


def _run(options: argparse.Namespace) -> int:
    begun = time.perf_counter()
    config = _config(options)
    viewer = None if options.flightgear is None else _viewer(options, config)
    from eval.hifi.flights import prepared
    from eval.hifi.rows import HifiFolder, columns
    from eval.runner.workers import DECISIVE, Task, cores

    with cluster_of(options, _DECISIVE) as cluster:
        workers = config.workers or cores() if cluster is None else cluster.size()
        workers = workers if viewer is None else 1
        campaign, config = campaign_of(config, workers)
        folder = HifiFolder(options.out or Path("runs") / time.strftime("hifi_%Y%m%d_%H%M%S"), config)
        task = Task(prepared, columns, (*DECISIVE, *_DECISIVE))
        fly = flown_on(cluster, workers, task, campaign._replace(viewer=viewer), str(config.policy_sha256))
        with run_in(folder, config, resume=options.resume):
            table, flown = whole_table(folder, config, fly, "flights", "python -m eval.hifi")
            summary = _summary(table, config, campaign.aircraft, time.perf_counter() - begun, flown)
            paths = [folder.write_summary(summary)]
            if config.figures:
                from eval.hifi.figures import draw_all

                paths += draw_all(folder, table, campaign)
    _show(summary, folder, paths)
    return 0


def _config(options: argparse.Namespace) -> "HifiConfig":
    from eval.hifi.config import HifiConfig

    keys = {"mode": "mode", "vehicle": "vehicle", "condition": "condition.name", "flights": "encounters"}
    return loaded(HifiConfig, options, keys | {"seed": "seed", "workers": "workers"}, "")


def _viewer(options: argparse.Namespace, config: "HifiConfig") -> "FlightGear":
    from envs.c208.flightgear import flightgear_at

    if config.vehicle not in ("c208_ex", "c208"):
        raise ConfigError(f"--flightgear: vehicle is {config.vehicle}; expected c208_ex or c208, which JSBSim flies")
    if options.scheduler is not None or options.workers not in (None, 1):
        raise ConfigError("--flightgear shows one flight at a time; expected no --scheduler, and no --workers but 1")
    return flightgear_at(options.flightgear, paced=True)


def campaign_of(config: "HifiConfig", workers: int = 1) -> "tuple[Campaign, HifiConfig]":
    """Return what a configuration names to be flown, and the configuration as resolved for so many workers."""
    from eval.flights.sources import most_intruders
    from eval.hifi.flights import Campaign

    policy = named_policy(config)
    aircraft = config.flown_aircraft(policy)
    source, _, resolved = named_source(config, aircraft, "flights")
    if not config.allow_outside_domain:
        policy.check_intruders(most_intruders(source))
    resolved |= {"policy_sha256": policy.sha256}
    resolved["chunk"] = config.chunk_for(resolved["encounters"], workers)
    campaign = Campaign(
        *(config.policy, source, config.seed, aircraft, config.mode, config.planner.options(aircraft)),
        *(config.vehicle, config.condition),
    )
    return campaign, config.model_copy(update=resolved)


def _summary(table: Any, config: "HifiConfig", aircraft: "Aircraft", wall_s: float, flown: int) -> dict[str, Any]:
    from envs.edge.installation import versions
    from eval.flights.aircraft import described
    from eval.hifi.summary import SCHEMA_VERSION, summarise

    return {
        "schema_version": SCHEMA_VERSION,
        "flights": config.wanted,
        "seed": config.seed,
        "scenario": config.scenario,
        "changes": config.changes,
        "mode": config.mode,
        "vehicle": config.vehicle,
        "condition": config.condition.model_dump(),
        "margin_m": config.planner.options(aircraft).requirement.margin,
        "policy_sha256": config.policy_sha256,
        **described(aircraft, named_policy(config)),
        "confidence": config.confidence,
        **summarise(table, config.confidence),
        "wall_s": wall_s,
        "flights_flown_now": flown,
        "flights_per_s": flown / wall_s if flown else None,
        "versions": versions("numpy", "safetensors", "pyarrow", "scipy", "jsbsim"),
    }


def _show(summary: dict[str, Any], folder: "HifiFolder", paths: list[Path]) -> None:
    from eval.flights.aircraft import lines_about

    print(
        f"{summary['flights']} flights of {summary['vehicle']}, mode {summary['mode']}, scenario "
        f"{summary['scenario']}, condition {summary['condition']['name']}, seed {summary['seed']}"
    )
    for key, found in summary.items():
        if isinstance(found, dict) and "total" in found and found["value"] is not None:
            ends = f"{100.0 * found['low']:6.2f} .. {100.0 * found['high']:.2f} %"
            print(f"{key:22} {100.0 * found['value']:7.2f} %  {ends:20} {found['count']} of {found['total']}")
    print("\n".join(lines_about(summary)))
    print(f"smallest separation    {_number(summary['min_separation_m_quantiles']['0'])} m")
    for name, found in summary["errors"].items():
        if found["1"] is not None:
            middle, high, most = (_number(found[key]) for key in ("0.5", "0.95", "1"))
            print(f"{name:26} median {middle}, 95 % {high}, largest {most}")
    margin = summary["margin"]
    if margin["margin_m"] is not None:
        print(f"margin for 99 % of flights  {margin['bound_m']:.1f} m; --set planner.margin={margin['margin_m']:g}")
    for reason, count in summary["reasons"].items():
        print(f"{count:6}  {reason}")
    names = {path.name for path in paths} | {"flights.parquet", "config.yaml"}
    print(f"files: {folder.path}: " + ", ".join(sorted(names)))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
