"""The attack on the word SAFE: ``python -m benchmarks.safety [--requests 1000000] [--single 10000]
[--workers N]``.

Numbered requests (:mod:`benchmarks.safety.adversary`) are planned by the batch core, the first of
them through ``agents.planner.plan`` too, and every plan called SAFE is judged by
:mod:`benchmarks.safety.resimulation`; 1 in 20 is flown by the follower as well. ``--first N
--requests 1`` repeats request N: the batch that it is planned in follows from its number. With
``--out`` what is done is written down batch by batch, and the same command goes on after it. The
last line is one JSON object; exit status 1 means that a violation was found.
"""

import json
import multiprocessing
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from agents.policy.inference import Policy
from benchmarks.measure import report
from benchmarks.safety.adversary import FAMILIES
from benchmarks.safety.attack import HUNDRED, Batch, Tally, attack, tasks
from envs.edge.command import ConfigError, Parser
from envs.edge.json_text import parse_json
from envs.edge.progress import Progress
from eval.runner.workers import cores

__all__ = ["BLOCK", "main"]

BLOCK = 6_400
"""Consecutive requests of which those with the same options are planned side by side."""

_SAME = (
    "requests",
    "single",
    "seed",
    "first",
    "family",
    "any_aircraft",
    "block",
)  # in an attack that is gone on with
_FILE = "batches.jsonl"

_POLICY: list[Policy] = []  # of a worker


def _prepare(path: Path | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _POLICY[:] = [Policy.load(path)]


def _done(path: Path, asked: dict[str, Any]) -> dict[Batch, Tally]:
    """Return the batches that a folder's file holds of the same attack; a line cut off by an
    interruption is dropped.

    Raises:
        ConfigError: the file is another attack's.
    """
    if not path.exists():
        path.write_text(json.dumps(asked) + "\n", encoding="utf-8")
        return {}
    first, *lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    if parse_json(first) != asked:
        raise ConfigError(
            f"--out: {path} holds another attack, {first}; expected this one, or another folder"
        )
    path.write_text("\n".join([first, *lines, ""]), encoding="utf-8")
    pairs = map(parse_json, lines)
    return {Batch(batch[0], tuple(batch[1]), *batch[2:]): Tally.of(tally) for batch, tally in pairs}


def _work(batch: Batch) -> tuple[Batch, Tally]:
    return batch, attack(batch, _POLICY[0])


def _results(
    batches: list[Batch], workers: int, path: Path | None
) -> Iterator[tuple[Batch, Tally]]:
    """Yield each batch with its tally, in any order; interrupts reach only this process."""
    if workers == 1:
        policy = Policy.load(path)
        yield from ((batch, attack(batch, policy)) for batch in batches)
        return
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, context, _prepare, (path,))
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        futures = [executor.submit(_work, batch) for batch in batches]
        signal.signal(signal.SIGINT, before)
        yield from (future.result() for future in as_completed(futures))
    finally:
        signal.signal(signal.SIGINT, before)
        executor.shutdown(cancel_futures=True)


def main(arguments: list[str] | None = None) -> int:
    """Attack and print."""
    parser = Parser(description=__doc__)
    parser.add_argument(
        "--requests",
        type=int,
        default=1_000_000,
        help="requests to the batch core (default 1000000)",
    )
    parser.add_argument(
        "--single",
        type=int,
        default=10_000,
        help="how many of them go through plan too (default 10000)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the requests (default 0)")
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first request (default 0)"
    )
    parser.add_argument(
        "--family", default="", help="plan only the requests of this family (default: of all)"
    )
    parser.add_argument(
        "--any-aircraft",
        action="store_true",
        help="another aircraft, drawn at random, for each batch",
    )
    parser.add_argument(
        "--workers", type=int, default=cores(), help="processes (default: one for every core)"
    )
    parser.add_argument(
        "--block", type=int, default=BLOCK, help=f"requests planned side by side (default {BLOCK})"
    )
    parser.add_argument("--policy", type=Path, help="policy file (default: the one that ships)")
    parser.add_argument(
        "--out", type=Path, help="folder of what is done and of the violations, as JSON lines"
    )
    options = parser.parse_args(arguments)
    for name, least in (
        ("requests", 1),
        ("single", 0),
        ("seed", 0),
        ("first", 0),
        ("workers", 1),
        ("block", HUNDRED),
    ):
        if getattr(options, name) < least:
            parser.error(f"--{name} is {getattr(options, name)}, expected {least} or more")
    if options.block % HUNDRED:
        parser.error(f"--block is {options.block}, expected a multiple of {HUNDRED}")
    if options.family not in ("", *(one.name for one in FAMILIES)):
        parser.error(
            f"--family is {options.family!r}, expected one of "
            f"{', '.join(one.name for one in FAMILIES)}"
        )
    single = min(options.single, options.requests)
    asked = options.seed, options.first, options.requests, single, options.block, options.family
    batches = list(tasks(*asked, any_aircraft=options.any_aircraft))
    tally, begun, done, file = Tally(), time.perf_counter(), {}, None
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        same = {name: getattr(options, name) for name in _SAME} | {
            "policy": Policy.load(options.policy).sha256
        }
        done = _done(options.out / _FILE, same)
        file = (options.out / _FILE).open("a", encoding="utf-8")
        batches = [batch for batch in batches if batch not in done]
    for one in done.values():
        tally.add(one)
    already = tally.requests.total() + tally.single.total()
    progress = Progress("requests").start(options.requests + single)
    complete = False
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for batch, one in _results(batches, options.workers, options.policy):
            tally.add(one)
            if file is not None:
                print(json.dumps([batch, vars(one)]), file=file, flush=True)
            count = tally.requests.total() + tally.single.total()
            progress.show(count, _figures(tally), (count - already) / (time.perf_counter() - begun))
        complete = True
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was done", file=sys.stderr)
    finally:
        progress.stop()
        if file is not None:
            file.close()
        signal.signal(signal.SIGTERM, before)
    figures = {
        "benchmark": "safety",
        "seed": options.seed,
        "first": options.first,
        "complete": complete,
    }
    figures["any_aircraft"] = options.any_aircraft
    figures |= {"block": options.block} | tally.figures()
    for name, (asked, safe) in figures["families"].items():
        print(f"{name:20} {asked:9} requests {safe:9} SAFE")
    report(figures, ("numpy",))
    return 1 if tally.violations else 0


def _figures(tally: Tally) -> str:
    safe = 100.0 * tally.safe.total() / max(tally.requests.total(), 1)
    return f"SAFE {safe:.1f} %, {len(tally.violations)} violations"
