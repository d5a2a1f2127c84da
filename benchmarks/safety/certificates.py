"""The attack on certificates: ``python -m benchmarks.safety.certificates [--plans 1000] [--out
runs/certificates]``.

Blocks of requests (:mod:`benchmarks.safety.adversary`), each for an aircraft drawn at random and
scaled to it, are planned side by side. The independent checker must accept the certificate of every
SAFE plan. Then one thing of each is moved a little (:mod:`benchmarks.safety.mutation`); where
:mod:`benchmarks.safety.judgement` finds that wrong, the checker must refuse it. Two certificates of
a block go through the command line too. With ``--out`` a run that was stopped goes on after its
last whole block. The last line is one JSON object; exit status 1 means that a certificate was
refused, or a wrong one accepted.
"""

import argparse
import json
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents import check
from agents.kernel.traffic import whole
from agents.planner.answer import Excluded, RequestError
from agents.planner.planner import plan_many
from agents.planner.publish.certificate import Evidence
from agents.planner.request.options import Options
from agents.planner.request.options import check as check_options
from agents.planner.request.request import Request, check_request, in_wind
from benchmarks.measure import report
from benchmarks.safety import adversary, published
from benchmarks.safety.judgement import wrong
from benchmarks.safety.mutation import mutate
from commands.command import InputError, Parser, run_cli
from commands.command import whole as whole_number
from commands.json_text import parse_json
from envs.aircraft import Aircraft
from envs.arrays import Array
from envs.trees import map_leaves, take
from envs.waypoints import Waypoint
from eval.runner.workers import cores

__all__ = ["BLOCK", "certify", "main"]

BLOCK = 400
"""Requests of a block, all for one aircraft."""


class _Plannable(NamedTuple):
    """A request that can be planned for."""

    number: int
    question: published.Question
    request: Request
    """``[1]``."""
    excluded: tuple[Excluded, ...]


class Certified(NamedTuple):
    """A request with a SAFE plan."""

    number: int
    file: bytes
    """The plan's certificate."""


def certify(seed: int, block: int) -> list[Certified]:
    """Plan the requests of a block and return those that have a SAFE plan."""
    rng = np.random.default_rng([seed, block, 0])
    aircraft = adversary.random_aircraft(rng)
    options = adversary.random_options(aircraft, rng)
    policy = adversary.policy_for(aircraft)
    plannable = _ask(seed, block, aircraft, options)
    requests = _side_by_side([item.request for item in plannable])
    plans = plan_many(requests, policy, in_wind(options, None)).candidates
    certified = []
    for row in np.flatnonzero(plans.safe).tolist():
        rows = np.stack([field[row] for field in plans.plan_states], axis=1)[1:].tolist()
        points = [Waypoint(number, *plan_state) for number, plan_state in enumerate(rows)]
        item = plannable[row]
        if any(points[-1].time > exclusion.until for exclusion in item.excluded):
            continue  # ``plan`` does not publish it
        question = item.question
        evidence = Evidence(
            question.own, question.intruders, points, item.excluded, question.altitude, options
        )
        certified.append(Certified(item.number, evidence.certificate()))
    return certified


def _ask(seed: int, block: int, aircraft: Aircraft, options: Options) -> list[_Plannable]:
    """Return the requests of a block that can be planned for."""
    first = block * BLOCK
    requests = adversary.scale(adversary.draw_requests(seed, first, BLOCK).request, aircraft)
    plannable = []
    for row in range(BLOCK):
        drawn = take(requests, row)
        question = published.question(seed, first + row, drawn, aircraft.separation)
        try:
            check_options(options)
            request, excluded, _ = check_request(
                question.own,
                question.intruders,
                question.route,
                in_wind(options, None),
                question.altitude,
            )
        except RequestError:
            continue
        request = request._replace(traffic=whole(request.traffic))
        plannable.append(_Plannable(first + row, question, request, excluded))
    return plannable


def _side_by_side(requests: list[Request]) -> Request:
    """Return requests ``[1]`` as one, ``[N]``, with absent intruders and points to fill it up."""
    every: Request = map_leaves(_join, *requests)
    traffic = every.traffic
    assert traffic.separation is not None  # of whole traffic
    own = np.where(traffic.mask, traffic.separation, np.nan)
    return every._replace(traffic=traffic._replace(separation=own))


def _join(*fields: Array) -> Array:
    """Return fields ``[1]`` or ``[1, K]`` below each other, those of the second kind filled up with
    zeros.
    """
    most = max(field.shape[-1] for field in fields)
    wide = [
        np.pad(field, ((0, 0), (0, most - field.shape[1]))) if field.ndim == 2 else field
        for field in fields
    ]
    return np.concatenate(wide)


def _refusal(data: dict[str, Any]) -> str:
    """Return why the checker refuses a certificate; empty: it accepts it."""
    try:
        check.accept(data)
    except (ValueError, ArithmeticError) as problem:
        return str(problem) or repr(problem)
    return ""


class _Case(NamedTuple):
    """A SAFE plan's certificate, and the same with something moved."""

    number: int
    right: dict[str, Any]
    refusal: str
    """Of the right one; empty: it is accepted."""
    moved: dict[str, Any]
    kind: str
    """What was moved."""
    seconds: float
    """Of the processor, to read and check the right one."""
    size: int
    """Bytes of the right one."""


def attack(seed: int, block: int) -> dict[str, Any]:
    """Certify the SAFE plans of a block, and move something of each; return what is found
    as JSON.
    """
    begun = time.process_time()
    with threadpool_limits(1):
        cases = [_case(seed, certified) for certified in certify(seed, block)]
        counts, failures = _judge(cases)
    return {
        "seed": seed,
        "block": block,
        "counts": dict(counts),
        "failures": failures,
        "slowest_check_s": max((case.seconds for case in cases), default=0.0),
        "largest_certificate_bytes": max((case.size for case in cases), default=0),
        "seconds": time.process_time() - begun,
    }


def _case(seed: int, certified: Certified) -> _Case:
    began = time.process_time()
    right = parse_json(certified.file)
    refusal = _refusal(right)
    seconds = time.process_time() - began
    moved, kind = mutate(right, np.random.default_rng([seed, certified.number, 1]))
    return _Case(certified.number, right, refusal, moved, kind, seconds, len(certified.file))


def _judge(cases: Sequence[_Case]) -> tuple[Counter[str], list[str]]:
    """Return how many certificates were decided how, and what was decided wrongly."""
    counts = Counter({"certificates": len(cases)})
    failures = [f"request {case.number}: refused: {case.refusal}" for case in cases if case.refusal]
    before, after = wrong([case.right for case in cases]), wrong([case.moved for case in cases])
    for case, bad_before, bad in zip(cases, before, after, strict=True):
        refused = bool(_refusal(case.moved))
        decision = f"{'wrong' if bad else 'right'}, {'refused' if refused else 'accepted'}"
        counts[f"moved {case.kind}: {decision}"] += 1
        name = f"request {case.number}"
        if bad_before:
            failures.append(f"{name}: {bad_before} is wrong though the plan is SAFE")
        if bad and not refused:
            failures.append(f"{name}: {case.kind} moved, {bad} is wrong and accepted")
    for case in cases[:1]:
        for data in (case.right, case.moved):
            counts["through the command line"] += 1
            if _status(data) != bool(_refusal(data)):
                failures.append(f"request {case.number}: the command line decides otherwise")
    return counts, failures


def _status(data: dict[str, Any]) -> int:
    """Return the exit status of ``python -m agents.check``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "plan.json")
        path.write_text(json.dumps(data), encoding="utf-8")
        command = [sys.executable, "-m", "agents.check", str(path)]
        root = Path(check.__file__).parents[2]
        return subprocess.run(command, cwd=root, capture_output=True, check=False).returncode


def _results(seed: int, blocks: Iterator[int], workers: int) -> Iterator[dict[str, Any]]:
    if workers == 1:
        yield from (attack(seed, block) for block in blocks)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as executor:
        while True:
            yield from executor.map(
                attack, [seed] * workers, [next(blocks) for _ in range(workers)]
            )


def _before(path: Path, seed: int) -> list[dict[str, Any]]:
    """Return the blocks that a run wrote before it was stopped; a torn last line is cut off."""
    lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
    whole = [line for line in lines if line.endswith(b"\n")]
    blocks = [parse_json(line) for line in whole]
    if any(block["seed"] != seed for block in blocks):
        raise InputError(
            f"{path} is of seed {blocks[0]['seed']}; expected --seed {blocks[0]['seed']} or "
            "another --out"
        )
    if len(whole) < len(lines):
        path.write_bytes(b"".join(whole))
    return blocks


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    path = None if options.out is None else options.out / "blocks.jsonl"
    blocks: list[dict[str, Any]] = []
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        blocks = _before(path, options.seed)
    try:
        _check_blocks(options, path, blocks)
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was done", file=sys.stderr)
    counts = _counts(blocks)
    failures = [problem for block in blocks for problem in block["failures"]]
    figures = {
        "benchmark": "certificates",
        "seed": options.seed,
        "first": options.first,
        "complete": counts["certificates"] >= options.plans,
        "blocks": len(blocks),
        "failures": failures,
        "counts": dict(sorted(counts.items())),
    }
    for name in ("slowest_check_s", "largest_certificate_bytes"):
        figures[name] = max((block[name] for block in blocks), default=0)
    report(figures | {"seconds": sum(block["seconds"] for block in blocks)}, ("numpy",))
    return 1 if failures else 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    assert __doc__ is not None
    parser = Parser(
        prog="python -m benchmarks.safety.certificates", description=__doc__.split("\n\n")[0]
    )
    add = parser.add_argument
    add("--plans", type=whole_number(1), default=1_000, help="SAFE plans at least (default 1000)")
    add("--seed", type=whole_number(0), default=0, help="seed of the requests (default 0)")
    add("--first", type=whole_number(0), default=0, help="number of the first block (default 0)")
    help_text = "processes (default: one for every core)"
    add("--workers", type=whole_number(1), default=cores(), help=help_text)
    help_text = "directory for the figures of each block; a stopped run goes on there"
    add("--out", type=Path, help=help_text)
    return parser.parse_args(arguments)


def _check_blocks(
    options: argparse.Namespace, path: Path | None, stored: list[dict[str, Any]]
) -> None:
    """Check blocks that are not done until there are as many SAFE plans as wanted; each is appended
    to what is done, and to the file.
    """
    numbers = {block["block"] for block in stored}
    blocks = (block for block in count(options.first) if block not in numbers)
    certificates = _counts(stored)["certificates"]
    if certificates >= options.plans:
        return
    for block in _results(options.seed, blocks, options.workers):
        stored.append(block)
        certificates += block["counts"]["certificates"]
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(block) + "\n")
        bad = sum(len(checked["failures"]) for checked in stored)
        line = f"{certificates} certificates, {bad} failures"
        print(line, *block["failures"], sep="\n", file=sys.stderr)
        if certificates >= options.plans:
            return


def _counts(blocks: list[dict[str, Any]]) -> Counter[str]:
    """Return the sums of the counts of blocks."""
    counts: Counter[str] = Counter()
    for block in blocks:
        counts.update(block["counts"])
    return counts


if __name__ == "__main__":
    run_cli(main)
