"""Flights of the true aircraft: ``python -m eval.hifi --scenario head_on --flights 50 --out runs/hifi``."""

import argparse
import hashlib
import json
import os
import signal
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.configuration import ConfigError, Parser, load, run_cli

if TYPE_CHECKING:
    from eval.hifi_config import HifiConfig
    from eval.hifi_flights import Campaign
    from eval.hifi_folder import HifiFolder

__all__ = ["campaign_of", "main"]

_DESCRIPTION = """\
Fly what the planner, the policy or the assured loop decide on the true aircraft, a Cessna 208B in JSBSim, and say how
often that succeeds and how far the aircraft is from its plans.

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
  python -m eval.hifi --set planner.margin=60 --set planner.vehicle=configs/vehicle_c208.yaml --out runs/c208
  python -m eval.hifi --resume --out runs/mixed        go on with a run that was interrupted
  python -m eval.hifi_gap runs/mixed                   the aircraft's distance from its plans, and a margin for it

Every key of the configuration, with its unit and default: python -m eval.hifi --help-keys"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for and return the exit status.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``EncounterError``.
    """
    options = _parser().parse_args(arguments)
    if options.help_keys:
        from agents.configuration_keys import help_text
        from eval.hifi_config import HifiConfig

        print(help_text(HifiConfig))
        return 0
    return _run(options)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.hifi", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="YAML file with what differs from the defaults")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="change one key of the configuration")
    add("--help-keys", action="store_true", help="list every key of the configuration, and exit")
    add("--policy", type=Path, metavar="FILE", help="policy file (default: the one that ships)")
    add("--mode", metavar="MODE", help="who decides: plan, closed or assured (default: plan)")
    add("--vehicle", metavar="NAME", help="what flies (default: c208_ex)")
    add("--condition", metavar="NAME", help="what it meets (default: calm)")
    add("--scenario", metavar="NAME", help="a scenario's name or file:PATH (default: circle)")
    add("--flights", type=_whole(1), metavar="N", help="how many (default: 200, or all of a file's)")
    add("--seed", type=_whole(0), metavar="N", help="of encounters, conditions and noise (default: 0)")
    add("--workers", type=_whole(0), metavar="N", help="processes; 0: one for every core (default: 0)")
    add("--resume", action="store_true", help="go on with the run in --out instead of beginning one")
    add("--out", type=Path, metavar="DIR", help="folder of the run (default: runs/hifi_DATE_TIME)")
    return parser


def _whole(least: int) -> Any:
    def number(text: str) -> int:
        if not text.isascii() or not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r}; expected a whole number of at least {least}")
        return int(text)

    return number


def _run(options: argparse.Namespace) -> int:
    begun = time.perf_counter()
    if options.resume and options.out is None:
        raise ConfigError("--resume: expected --out with the folder of the run")
    config = _config(options)
    from eval.hifi_folder import HifiFolder
    from eval.workers import WorkerError

    campaign, config = campaign_of(config)
    folder = HifiFolder(options.out or Path("runs") / time.strftime("hifi_%Y%m%d_%H%M%S"), config)
    if options.resume:
        folder.resume()
    else:
        folder.create()
    try:
        finished, flown = _fly(folder, campaign, config)
    except WorkerError as problem:
        print(f"error: {problem}\n{_how_to_resume(folder)}", file=sys.stderr)
        return 1
    if not finished:
        print(f"interrupted; finished chunks are kept. {_how_to_resume(folder)}", file=sys.stderr)
        return 130
    table = folder.finish()
    summary = _summary(table, config, time.perf_counter() - begun, flown)
    paths = [folder.write_summary(summary)]
    if config.figures:
        from eval.hifi_figures import draw_all

        paths += draw_all(folder, table, campaign)
    _show(summary, folder, paths)
    return 0


def _config(options: argparse.Namespace) -> "HifiConfig":
    """Return the configuration: a file's or a begun run's values under those of the command line."""
    from eval.hifi_config import HifiConfig

    path = options.config
    if path is None and options.resume:
        path = options.out / "config.yaml"
        if not path.is_file():
            raise ConfigError(f"--resume: {options.out} holds no run (no config.yaml), expected one that was begun")
    overrides = []
    if options.policy is not None:
        # Absolute, because a path of the command line is meant from the working directory.
        overrides += [f"policy={json.dumps(str(options.policy.absolute()))}"]
        overrides += [] if options.resume else ["policy_sha256=null"]
    if options.scenario is not None:
        name = options.scenario
        name = f"file:{Path(name[5:]).absolute()}" if name.startswith("file:") and name[5:] else name
        overrides += [f"scenario={name}", *([] if options.resume else ["scenario_sha256=null"])]
    keys = {"mode": "mode", "vehicle": "aircraft", "condition": "condition.name", "flights": "encounters"}
    keys |= {"seed": "seed", "workers": "workers"}
    named = {key: getattr(options, name) for name, key in keys.items()}
    overrides += [f"{key}={value}" for key, value in named.items() if value is not None]
    try:
        return load(HifiConfig, path, [*overrides, *options.set])
    except ConfigError as problem:
        raise ConfigError(str(problem) if options.set else str(problem).replace("--set: ", "", 1)) from None


def campaign_of(config: "HifiConfig") -> "tuple[Campaign, HifiConfig]":
    """Load what a configuration names and return what is to be flown, with the configuration as resolved.

    Raises:
        ConfigError: policy or file of encounters are not those expected, or the limits leave no room.
    """
    from agents.inference import Policy
    from eval.hifi_flights import Campaign
    from eval.workers import cores

    policy = Policy.load(config.policy)
    if config.policy_sha256 not in (None, policy.sha256):
        raise ConfigError(
            f"policy {config.policy or 'that ships'} has SHA-256 {policy.sha256}, "
            f"expected {config.policy_sha256} (key policy_sha256)"
        )
    limits = policy.limits if config.vehicle is None else config.vehicle.limits()
    resolved: dict[str, Any] = {"policy_sha256": policy.sha256, "encounters": config.wanted}
    if config.file is None:
        source: Any = config.sampled()
    else:
        from envs import encounter_file

        source, found = encounter_file.read(config.file, limits)
        digest = hashlib.sha256(config.file.read_bytes()).hexdigest()
        if config.scenario_sha256 not in (None, digest):
            raise ConfigError(
                f"{config.file} has SHA-256 {digest}, expected {config.scenario_sha256} (key scenario_sha256)"
            )
        count = len(found) if config.encounters is None else config.encounters
        if count > len(found):
            raise ConfigError(f"flights is {count}; expected at most {len(found)}, as many as {config.file} holds")
        resolved |= {"scenario_sha256": digest, "encounters": count}
    resolved["chunk"] = config.chunk_for(resolved["encounters"], config.workers or cores())
    campaign = Campaign(
        *(config.policy, source, config.seed, config.rules.rules(), limits, config.mode, config.setting()),
        *(config.aircraft, config.condition.family(), config.wind_plan),
    )
    return campaign, config.model_copy(update=resolved)


def _fly(folder: "HifiFolder", campaign: "Campaign", config: "HifiConfig") -> tuple[bool, int]:
    """Fly every chunk that is not stored yet; return whether all are, and how many flights were flown now."""
    from eval.hifi_workers import fly_flights
    from eval.progress import Progress
    from eval.workers import Chunk, cores

    assert config.chunk is not None  # it is resolved
    total, size = config.wanted, config.chunk
    stored = folder.done()
    chunks = [Chunk(first, min(size, total - first)) for first in range(0, total, size)]
    missing = [chunk for chunk in chunks if chunk.first not in stored]
    before = total - sum(chunk.size for chunk in missing)
    flown = 0
    with _stop_on_interrupt() as stopped, Progress(total, before) as progress:
        for chunk, columns in fly_flights(campaign, missing, config.workers or cores(), lambda: bool(stopped)):
            folder.store(chunk.first, columns)
            flown += chunk.size
            progress.advance(chunk.size, int((columns["outcome"] == "reached").sum()))
    return before + flown == total, flown


@contextmanager
def _stop_on_interrupt() -> Generator[list[int], None, None]:
    """Give a list that a first Ctrl-C (or SIGTERM) makes non-empty; a second one interrupts at once."""
    received: list[int] = []

    def note(number: int, _: Any) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)
        os.write(sys.stderr.fileno(), b"\nfinishing the flights in the air (Ctrl-C again stops at once)\n")

    try:
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread, where Ctrl-C arrives
        yield received
        return
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _how_to_resume(folder: "HifiFolder") -> str:
    return f"Go on with: python -m eval.hifi --resume --out {folder.path}"


def _summary(table: Any, config: "HifiConfig", wall_s: float, flown: int) -> dict[str, Any]:
    """Return the content of summary.json."""
    from agents.versions import versions
    from eval.hifi_summary import SCHEMA_VERSION, summarise

    return {
        "schema_version": SCHEMA_VERSION,
        "flights": config.wanted,
        "seed": config.seed,
        "scenario": config.scenario,
        "changes": config.changes,
        "mode": config.mode,
        "aircraft": config.aircraft,
        "condition": config.condition.model_dump(),
        "wind_plan": config.wind_plan,
        "margin_m": config.planner.margin,
        "policy_sha256": config.policy_sha256,
        "confidence": config.confidence,
        **summarise(table, config.confidence),
        "wall_s": wall_s,
        "flights_flown_now": flown,
        "flights_per_s": flown / wall_s if flown else None,
        "versions": versions("numpy", "safetensors", "pyarrow", "scipy", "jsbsim"),
    }


def _show(summary: dict[str, Any], folder: "HifiFolder", paths: list[Path]) -> None:
    """Print the result for a person."""
    print(
        f"{summary['flights']} flights of {summary['aircraft']}, mode {summary['mode']}, scenario "
        f"{summary['scenario']}, condition {summary['condition']['name']}, seed {summary['seed']}"
    )
    for key, found in summary.items():
        if isinstance(found, dict) and "total" in found and found["value"] is not None:
            ends = f"{100.0 * found['low']:6.2f} .. {100.0 * found['high']:.2f} %"
            print(f"{key:22} {100.0 * found['value']:7.2f} %  {ends:20} {found['count']} of {found['total']}")
    print(f"smallest separation    {_number(summary['min_separation_m_quantiles']['0'])} m")
    for name, found in summary["errors"].items():
        if found["1"] is not None:
            middle, high, most = (_number(found[key]) for key in ("0.5", "0.95", "1"))
            print(f"{name:26} median {middle}, 95 % {high}, largest {most}")
    for reason, count in summary["reasons"].items():
        print(f"{count:6}  {reason}")
    names = {path.name for path in paths} | {"flights.parquet", "config.yaml"}
    print(f"files: {folder.path}: " + ", ".join(sorted(names)))


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _cli() -> int:
    from agents.policy_file import PolicyFileError
    from envs.encounters import EncounterError

    try:
        return main()
    except (PolicyFileError, EncounterError) as problem:
        raise ConfigError(str(problem)) from None


if __name__ == "__main__":
    run_cli(_cli)
