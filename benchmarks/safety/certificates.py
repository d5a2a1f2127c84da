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

import json
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents import check
from agents.planner.answer import Excluded, RequestError
from agents.planner.certificate import certificate
from agents.planner.options import check as check_options
from agents.planner.planner import plan_many
from agents.planner.request import Request, check_request
from agents.planner.traffic import whole
from benchmarks.measure import report
from benchmarks.safety import adversary, published
from benchmarks.safety.judgement import wrong
from benchmarks.safety.mutation import mutate
from envs.edge.command import InputError, Parser, run_cli
from envs.edge.json_text import parse_json
from envs.trees import map_leaves, take
from envs.waypoints import Waypoint
from eval.runner.workers import cores

__all__ = ["BLOCK", "certify", "main"]

BLOCK = 400
"""Requests of a block, all for one aircraft."""

_FIGURES = ("counts", "failures", "slowest_check_s", "largest_certificate_bytes")


class _Asked(NamedTuple):
    """A request that can be planned for."""

    number: int
    question: published.Question
    request: Request
    """``[1]``."""
    excluded: tuple[Excluded, ...]


def certify(seed: int, block: int) -> list[tuple[int, bytes]]:
    """Return the numbers of those requests of a block that have a SAFE plan, and the plans'
    certificates.
    """
    rng = np.random.default_rng([seed, block, 0])
    one = adversary.random_aircraft(rng)
    options = adversary.random_options(one, rng)
    policy = adversary.policy_for(one)
    first = block * BLOCK
    requests = adversary.scale(adversary.draw_requests(seed, first, BLOCK).request, one)
    asked = []
    for row in range(BLOCK):
        question = published.question(seed, first + row, take(requests, row), one.separation)
        try:
            check_options(options)
            request, excluded, _ = check_request(
                question.own, question.intruders, question.route, options, question.altitude
            )
        except RequestError:
            continue
        request = request._replace(traffic=whole(request.traffic))
        asked.append(_Asked(first + row, question, request, excluded))
    plans = plan_many(_side_by_side([each.request for each in asked]), policy, options).proposals
    found = []
    for row in np.flatnonzero(plans.safe).tolist():
        plan_states = np.stack([field[row] for field in plans.plan_states], axis=1)
        points = [
            Waypoint(number, *plan_state)
            for number, plan_state in enumerate(plan_states[1:].tolist())
        ]
        each = asked[row]
        if any(points[-1].time > one.until for one in each.excluded):
            continue  # ``plan`` does not publish it
        given = (
            each.question.own,
            each.question.intruders,
            points,
            each.excluded,
            each.question.altitude,
        )
        found.append((each.number, certificate(*given, options)))
    return found


def _side_by_side(requests: list[Request]) -> Request:
    """Return requests ``[1]`` as one, ``[N]``, with absent intruders and points to fill it up."""

    def join(*fields: Any) -> Any:
        most = max(field.shape[-1] for field in fields)
        wide = [
            np.pad(field, ((0, 0), (0, most - field.shape[1]))) if field.ndim == 2 else field
            for field in fields
        ]
        return np.concatenate(wide)

    every: Request = map_leaves(join, *requests)
    traffic = every.traffic
    own = np.where(traffic.mask, traffic.separation, np.nan)
    return every._replace(traffic=traffic._replace(separation=own))


def _refuse(data: dict[str, Any]) -> str:
    try:
        check.accept(data)
    except (ValueError, ArithmeticError) as problem:
        return str(problem) or repr(problem)
    return ""


def attack(seed: int, block: int) -> dict[str, Any]:
    """Certify the SAFE plans of a block, and move something of each; return what is found
    as JSON.
    """
    counts: Counter[str] = Counter()
    failures: list[str] = []
    begun, slowest, largest = time.process_time(), 0.0, 0
    with threadpool_limits(1):
        files = certify(seed, block)
        right, changed = [], []
        for number, file in files:
            started = time.process_time()
            right.append(parse_json(file))
            why = _refuse(right[-1])
            slowest, largest = max(slowest, time.process_time() - started), max(largest, len(file))
            if why:
                failures.append(f"request {number}: refused: {why}")
            changed.append(mutate(right[-1], np.random.default_rng([seed, number, 1])))
        counts["certificates"] = len(files)
        faults, judged = wrong([data for data, _ in changed]), wrong(right)
        for (number, _), (data, kind), bad, before in zip(
            files, changed, faults, judged, strict=True
        ):
            why = _refuse(data)
            counts[
                f"moved {kind}: {'wrong' if bad else 'right'}, {'refused' if why else 'accepted'}"
            ] += 1
            if before:
                failures.append(f"request {number}: {before} is wrong though the plan is SAFE")
            if bad and not why:
                failures.append(f"request {number}: {kind} moved, {bad} is wrong and accepted")
        for data in [*right[:1], *(data for data, _ in changed[:1])]:
            counts["through the command line"] += 1
            if _status(data) != bool(_refuse(data)):
                failures.append(f"request {files[0][0]}: the command line decides otherwise")
    figures = dict(zip(_FIGURES, (dict(counts), failures, slowest, largest), strict=True))
    return {"seed": seed, "block": block, **figures, "seconds": time.process_time() - begun}


def _status(data: dict[str, Any]) -> int:
    """Return the exit status of ``python -m agents.check``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "plan.json")
        path.write_text(json.dumps(data), encoding="utf-8")
        command = [sys.executable, "-I", str(check.__file__), str(path)]
        return subprocess.run(command, capture_output=True, check=False).returncode


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
    done = [parse_json(line) for line in whole]
    if any(one["seed"] != seed for one in done):
        raise InputError(
            f"{path} is of seed {done[0]['seed']}; expected --seed {done[0]['seed']} or another "
            "--out"
        )
    if len(whole) < len(lines):
        path.write_bytes(b"".join(whole))
    return done


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    assert __doc__ is not None
    parser = Parser(
        prog="python -m benchmarks.safety.certificates", description=__doc__.split("\n\n")[0]
    )
    parser.add_argument(
        "--plans", type=int, default=1_000, help="SAFE plans at least (default 1000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the requests (default 0)")
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first block (default 0)"
    )
    parser.add_argument(
        "--workers", type=int, default=cores(), help="processes (default: one for every core)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="directory for the figures of each block; a stopped run goes on there",
    )
    options = parser.parse_args(arguments)
    for name, least in (("plans", 1), ("seed", 0), ("first", 0), ("workers", 1)):
        if getattr(options, name) < least:
            parser.error(f"--{name} is {getattr(options, name)}, expected {least} or more")
    path = None if options.out is None else options.out / "blocks.jsonl"
    done: list[dict[str, Any]] = []
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        done = _before(path, options.seed)
    try:
        _check_blocks(options, path, done)
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was done", file=sys.stderr)
    failures = [problem for one in done for problem in one["failures"]]
    counts = _counts(done)
    figures = {
        "benchmark": "certificates",
        "seed": options.seed,
        "first": options.first,
        "complete": counts["certificates"] >= options.plans,
        "blocks": len(done),
        "failures": failures,
        "counts": dict(sorted(counts.items())),
    }
    for name in _FIGURES[2:]:
        figures[name] = max((one[name] for one in done), default=0)
    report(figures | {"seconds": sum(one["seconds"] for one in done)}, ("numpy",))
    return 1 if failures else 0


def _check_blocks(options: Any, path: Path | None, done: list[dict[str, Any]]) -> None:
    """Check blocks that are not done until there are as many SAFE plans as wanted; each is appended
    to what is done, and to the file.
    """
    known = {one["block"] for one in done}
    blocks = (block for block in count(options.first) if block not in known)
    certificates = _counts(done)["certificates"]
    if certificates >= options.plans:
        return
    for one in _results(options.seed, blocks, options.workers):
        done.append(one)
        certificates += one["counts"]["certificates"]
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(one) + "\n")
        bad = sum(len(each["failures"]) for each in done)
        said = f"{certificates} certificates, {bad} failures"
        print(said, *one["failures"], sep="\n", file=sys.stderr)
        if certificates >= options.plans:
            return


def _counts(done: list[dict[str, Any]]) -> Counter[str]:
    """Return the sums of the counts of blocks."""
    counts: Counter[str] = Counter()
    for one in done:
        counts.update(one["counts"])
    return counts


if __name__ == "__main__":
    run_cli(main)
