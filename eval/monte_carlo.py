"""Monte Carlo evaluation of a policy: ``python -m eval.monte_carlo --encounters 10000 --out runs/first``."""

import argparse
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
    from agents.inference import Policy
    from eval.chunks import Evaluation
    from eval.config import MonteCarloConfig
    from eval.outputs import RunFolder

__all__ = ["main"]

_DESCRIPTION = """\
Fly a policy through many encounters and say how often it succeeds, with intervals.

Sampled scenarios: circle (the paper's), crossing_left, crossing_right, head_on, same_course, maneuvering, noisy,
multi; or file:PATH for a CSV file of your own (columns in docs/evaluation.md).

Written to --out: summary.json, encounters.parquet (a row an encounter), config.yaml as resolved, and figures as PNG
and SVG. The same config.yaml gives the same table again, bit for bit, on the same kind of machine and versions,
however many workers fly it."""

_EPILOG = """\
examples:
  python -m eval.monte_carlo --policy runs/quick/policy.safetensors --out runs/circle
  python -m eval.monte_carlo --scenario multi --encounters 2000 --out runs/multi
  python -m eval.monte_carlo --set changes.min_initial_separation=0 --out runs/unfiltered
  python -m eval.monte_carlo --resume --out runs/circle        go on with a run that was interrupted

Every key of the configuration, with its unit and default: python -m eval.monte_carlo --help-keys"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the evaluation that the command line asks for and return the exit status.

    Raises:
        ConfigError: bad input; so are ``PolicyFileError`` and ``EncounterError``.
    """
    options = _parser().parse_args(arguments)
    if options.help_keys:
        from agents.configuration_keys import help_text
        from eval.config import MonteCarloConfig

        print(help_text(MonteCarloConfig))
        return 0
    return _evaluate(options)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m eval.monte_carlo", description=_DESCRIPTION, epilog=_EPILOG)
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="YAML file with what differs from the defaults")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="change one key of the configuration")
    add("--help-keys", action="store_true", help="list every key of the configuration, and exit")
    add("--policy", type=Path, metavar="FILE", help="policy file (default: the one that ships)")
    add(
        "--mode",
        metavar="MODE",
        help="who decides: policy (the network once a second), plan (planned once, then followed) or assured (planned, "
        "monitored and planned again); default: policy",
    )
    add("--scenario", metavar="NAME", help="a scenario's name or file:PATH (default: circle)")
    add("--encounters", type=_whole(1), metavar="N", help="how many (default: 10000, or all of a file's)")
    add("--seed", type=_whole(0), metavar="N", help="of encounters, sensor noise and bootstrap (default: 0)")
    add("--baseline", metavar="NAME", help="flown beside: none, straight along the route (default: none)")
    add("--workers", type=_whole(0), metavar="N", help="processes; 0: one for every core (default: 0)")
    add("--resume", action="store_true", help="go on with the run in --out instead of beginning one")
    add("--out", type=Path, metavar="DIR", help="folder of the run (default: runs/monte_carlo_DATE_TIME)")
    return parser


def _whole(least: int) -> Any:
    def number(text: str) -> int:
        if not text.isascii() or not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!r}; expected a whole number of at least {least}")
        return int(text)

    return number


def _evaluate(options: argparse.Namespace) -> int:
    begun = time.perf_counter()
    if options.resume and options.out is None:
        raise ConfigError("--resume: expected --out with the folder of the run")
    config = _config(options)
    from eval.outputs import RunFolder

    evaluation, policy, config = _prepare(config)
    folder = RunFolder(options.out or Path("runs") / time.strftime("monte_carlo_%Y%m%d_%H%M%S"), config)
    if options.resume:
        folder.resume()
    else:
        folder.create()

    from eval.workers import WorkerError

    try:
        finished, flown = _fly(folder, evaluation, config)
    except WorkerError as problem:
        print(f"error: {problem}\n{_how_to_resume(folder)}", file=sys.stderr)
        return 1
    if not finished:
        print(f"interrupted; finished chunks are kept. {_how_to_resume(folder)}", file=sys.stderr)
        return 130
    table = folder.finish()
    wall_s = time.perf_counter() - begun
    summary = _summary(table, config, policy, wall_s, flown)
    paths = [folder.write_summary(summary)]
    if config.figures:
        from eval.figures import draw_all

        paths += draw_all(folder, table, evaluation)
    from eval.table import show

    show(summary, folder.path, paths)
    return 0


def _config(options: argparse.Namespace) -> "MonteCarloConfig":
    """Return the configuration: a file's or a begun run's values under those of the command line."""
    from eval.config import MonteCarloConfig

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
    named = {key: getattr(options, key) for key in ("mode", "encounters", "seed", "baseline", "workers")}
    overrides += [f"{key}={value}" for key, value in named.items() if value is not None]
    try:
        return load(MonteCarloConfig, path, [*overrides, *options.set])
    except ConfigError as problem:
        raise ConfigError(str(problem) if options.set else str(problem).replace("--set: ", "--", 1)) from None


def _prepare(config: "MonteCarloConfig") -> "tuple[Evaluation, Policy, MonteCarloConfig]":
    """Load what the configuration names and return it with the configuration as resolved."""
    from agents.inference import Policy
    from eval.chunks import Evaluation

    policy = Policy.load(config.policy)
    if config.policy_sha256 not in (None, policy.sha256):
        raise ConfigError(
            f"policy {config.policy or 'that ships'} has SHA-256 {policy.sha256}, "
            f"expected {config.policy_sha256} (key policy_sha256)"
        )
    limits = policy.limits if config.vehicle is None else config.vehicle.limits()
    resolved: dict[str, Any] = {"policy_sha256": policy.sha256, "encounters": config.wanted}
    names = None
    if config.file is None:
        source: Any = config.sampled()
    else:
        import hashlib

        from envs import encounter_file

        source, found = encounter_file.read(config.file, limits)
        digest = hashlib.sha256(config.file.read_bytes()).hexdigest()
        if config.scenario_sha256 not in (None, digest):
            raise ConfigError(
                f"{config.file} has SHA-256 {digest}, expected {config.scenario_sha256} (key scenario_sha256)"
            )
        names = tuple(found)
        count = len(names) if config.encounters is None else config.encounters
        if count > len(names):
            raise ConfigError(f"encounters is {count}; expected at most {len(names)}, as many as {config.file} holds")
        resolved |= {"scenario_sha256": digest, "encounters": count}
    from eval.workers import cores

    resolved["chunk"] = config.chunk_for(resolved["encounters"], config.workers or cores())
    rules, setting = config.rules.rules(), config.planner.setting()
    evaluation = Evaluation(config.policy, source, names, config.seed, rules, limits, config.mode, setting)
    return evaluation, policy, config.model_copy(update=resolved)


def _fly(folder: "RunFolder", evaluation: "Evaluation", config: "MonteCarloConfig") -> tuple[bool, int]:
    """Fly every chunk that is not stored yet; return whether all are, and how many encounters were flown now."""
    from eval.progress import Progress
    from eval.workers import Chunk, cores, fly_chunks

    assert config.chunk is not None  # it is resolved
    total, size = config.wanted, config.chunk
    stored = folder.done()
    chunks = [Chunk(first, min(size, total - first)) for first in range(0, total, size)]
    missing = [chunk for chunk in chunks if chunk.first not in stored]
    before = total - sum(chunk.size for chunk in missing)
    flown = 0
    with _stop_on_interrupt() as stopped, Progress(total, before) as progress:
        for chunk, columns in fly_chunks(evaluation, missing, config.workers or cores(), lambda: bool(stopped)):
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
        # Not print(): the signal may have interrupted one.
        os.write(sys.stderr.fileno(), b"\nfinishing the chunks in the air (Ctrl-C again stops at once)\n")

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


def _how_to_resume(folder: "RunFolder") -> str:
    return f"Go on with: python -m eval.monte_carlo --resume --out {folder.path}"


def _summary(table: Any, config: "MonteCarloConfig", policy: "Policy", wall_s: float, flown: int) -> dict[str, Any]:
    """Return the content of summary.json."""
    from agents.versions import versions
    from eval.summary import SCHEMA_VERSION, summarise

    return {
        "schema_version": SCHEMA_VERSION,
        "encounters": config.wanted,
        "seed": config.seed,
        "scenario": config.scenario,
        "changes": config.changes,
        "mode": config.mode,
        "baseline": config.baseline,
        "policy_sha256": policy.sha256,
        "confidence": config.confidence,
        **summarise(table, config.confidence, config.resamples, config.seed),
        "wall_s": wall_s,
        "encounters_flown_now": flown,
        "encounters_per_s": flown / wall_s if flown else None,
        "versions": versions("numpy", "safetensors", "pyarrow", "scipy"),
    }


def _cli() -> int:
    from agents.policy_file import PolicyFileError
    from envs.encounters import EncounterError

    try:
        return main()
    except (PolicyFileError, EncounterError) as problem:
        raise ConfigError(str(problem)) from None


if __name__ == "__main__":
    run_cli(_cli)
