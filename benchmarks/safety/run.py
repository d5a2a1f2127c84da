"""The attack on the word SAFE: ``python -m benchmarks.safety [--requests 1000000] [--single 10000]
[--workers N]``.

Numbered requests (:mod:`benchmarks.safety.adversary`) are planned by the batch core, the first of
them through ``agents.planner.plan`` too, and every plan called SAFE is judged by
:mod:`benchmarks.safety.resimulation`; 1 in 20 is flown by the follower as well. With ``--space``
plans may climb and descend (:mod:`benchmarks.safety.heights`). ``--first N --requests 1`` repeats
request N: the batch that it is planned in follows from its number. With ``--out`` what is done is
written down batch by batch, and the same command goes on after it. The last line is one JSON
object; exit status 1 means that a violation was found.
"""

import argparse
import json
import signal
import sys
from collections.abc import Generator, Iterator
from concurrent.futures import as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from agents.policy.inference import Policy
from benchmarks.measure import policy_in_flight, read_done, report, request_options
from benchmarks.safety.adversary import FAMILIES
from benchmarks.safety.attack import HUNDRED, Batch, Tally, attack, tasks
from commands.command import Parser, whole
from commands.progress import Progress
from eval.runner.workers import cores, processes

__all__ = ["BLOCK", "main"]

BLOCK = 6_400
"""Consecutive requests of which those with the same options are planned side by side."""

# Options that an attack which is gone on with has in common with its beginning.
_SAME = "requests", "single", "seed", "first", "family", "any_aircraft", "space", "block"
_FILE = "batches.jsonl"

_POLICY: list[Policy] = []  # of a worker


def _prepare(path: Path | None) -> None:
    _POLICY[:] = [policy_in_flight(path)]


def _read_batches(path: Path, settings: dict[str, Any]) -> dict[Batch, Tally]:
    """Return the batches that a folder's file holds of the same attack."""
    pairs = read_done(path, settings, "attack")
    return {Batch(batch[0], tuple(batch[1]), *batch[2:]): Tally.of(tally) for batch, tally in pairs}


def _work(batch: Batch) -> tuple[Batch, Tally]:
    return batch, attack(batch, _POLICY[0])


def _results(
    batches: list[Batch], workers: int, path: Path | None
) -> Iterator[tuple[Batch, Tally]]:
    """Yield each batch with its tally, in any order; an interrupt ends those under way, which take
    minutes.
    """
    if workers == 1:
        policy = policy_in_flight(path)
        yield from ((batch, attack(batch, policy)) for batch in batches)
        return
    with processes(workers, _prepare, path) as pool:
        futures = [pool.submit(_work, batch) for batch in batches]
        yield from (future.result() for future in as_completed(futures))


def main(arguments: list[str] | None = None) -> int:
    """Attack and print."""
    options = _parse(arguments)
    tally = Tally()
    batches = tasks(
        seed=options.seed,
        first=options.first,
        count=options.requests,
        single=options.single,
        block=options.block,
        family=options.family,
        any_aircraft=options.any_aircraft,
        in_space=options.space,
    )
    with _open_record(options) as record:
        for batch_tally in record.tallies.values():
            tally.add(batch_tally)
        batches = [batch for batch in batches if batch not in record.tallies]
        complete = _attack(options, batches, tally, record)
    figures = {
        "benchmark": "safety",
        "seed": options.seed,
        "first": options.first,
        "complete": complete,
        "any_aircraft": options.any_aircraft,
        "space": options.space,
        "block": options.block,
    } | tally.figures()
    for name, (requests, safe) in figures["families"].items():
        print(f"{name:20} {requests:9} requests {safe:9} SAFE")
    report(figures, ("numpy",))
    return 1 if tally.violations else 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    request_options(parser, 1_000_000)
    add(
        "--single",
        type=whole(0),
        default=10_000,
        help="requests that go through plan too (default 10000)",
    )
    add("--first", type=whole(0), default=0, help="number of the first request (default 0)")
    add("--family", default="", help="plan only the requests of this family (default: of all)")
    add(
        "--any-aircraft",
        action="store_true",
        help="another aircraft, drawn at random, for each batch",
    )
    help_text = "plans may climb and descend; all go through plan, and only through plan"
    add("--space", action="store_true", help=help_text)
    add("--workers", type=whole(1), default=cores(), help="processes (default: one for every core)")
    block = f"requests planned side by side, a multiple of {HUNDRED} (default {BLOCK})"
    add("--block", type=whole(HUNDRED), default=BLOCK, help=block)
    add("--out", type=Path, help="folder of what is done and of the violations, as JSON lines")
    options = parser.parse_args(arguments)
    _check(parser, options)
    options.single = options.requests if options.space else min(options.single, options.requests)
    return options


def _check(parser: Parser, options: argparse.Namespace) -> None:
    if options.block % HUNDRED:
        parser.error(f"--block is {options.block}, expected a multiple of {HUNDRED}")
    families = [family.name for family in FAMILIES]
    if options.family and options.family not in families:
        parser.error(f"--family is {options.family!r}, expected one of {', '.join(families)}")


class _Record(NamedTuple):
    """What is done of an attack, and the file, if any, that goes on with it."""

    tallies: dict[Batch, Tally]
    file: TextIO | None

    def add(self, batch: Batch, tally: Tally) -> None:
        """Write one more batch down."""
        if self.file is not None:
            print(json.dumps([batch, vars(tally)]), file=self.file, flush=True)


@contextmanager
def _open_record(options: argparse.Namespace) -> Generator[_Record]:
    """Give the record in the folder that the options name; without a folder an empty one."""
    if options.out is None:
        yield _Record({}, None)
        return
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / _FILE
    same = {name: getattr(options, name) for name in _SAME}
    tallies = _read_batches(path, same | {"policy": Policy.load(options.policy).sha256})
    with path.open("a", encoding="utf-8") as file:
        yield _Record(tallies, file)


def _attack(
    options: argparse.Namespace, batches: list[Batch], tally: Tally, record: _Record
) -> bool:
    """Attack by batches, add what is found to the tally, and return whether all were done."""
    progress = Progress("requests").start(options.requests + options.single, _count(tally))
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for batch, batch_tally in _results(batches, options.workers, options.policy):
            tally.add(batch_tally)
            record.add(batch, batch_tally)
            count = _count(tally)
            progress.show(count, _describe(tally))
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was done", file=sys.stderr)
        return False
    finally:
        progress.stop()
        signal.signal(signal.SIGTERM, before)
    return True


def _count(tally: Tally) -> int:
    """Return how many requests were planned, those through ``plan`` once more."""
    return tally.requests.total() + tally.single.total()


def _describe(tally: Tally) -> str:
    safe = tally.safe.total() + tally.single["safe"]
    share = 100.0 * safe / max(_count(tally), 1)
    return f"SAFE {share:.1f} %, {len(tally.violations)} violations"
