"""What a deadline costs: ``python -m benchmarks.deadline --out runs/deadline [--requests 300]``.

Each request is planned with every deadline: circle encounters, 2 to 8 intruders, eight of them
close by, noisy reports, and starts so close that many cannot be resolved. Resolvable is what the
planner solves without a deadline; times are of the thread's processor, on one core. A block of 100
requests is a file in ``--out``, and the same command goes on where it stopped. What comes late is
asked again. In ``--out`` lie ``deadline.json`` and the figure too; the last line is the same JSON
object.
"""

import gc
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.planner import Intruder, Options, plan
from agents.planner.request.encounters import request_of
from agents.policy.inference import Policy
from benchmarks.measure import policy_in_flight, report
from benchmarks.planner import question
from benchmarks.questions import Question, time_plan
from commands.command import InputError, Parser, require, run_cli, whole
from commands.figures import save_figure
from commands.files import write_file
from commands.json_text import parse_json
from envs.aircraft import PAPER
from envs.scenarios import scenario
from envs.starts import encounters_of_seed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEADLINES_MS = (5.0, 10.0, 20.0, 50.0, 100.0, math.inf)
KINDS: dict[str, dict[str, Any]] = {
    "1 intruder": {"name": "circle"},
    "2 to 8": {"name": "multi"},
    "8 close by": {"name": "multi", "intruders": (8, 8), "radius": (2500.0, 4500.0)},
    "noisy": {"name": "noisy"},
    "hardly resolvable": {
        "name": "circle",
        "radius": (1200.0, 2500.0),
        "conflicts_closer_than": 500.0,
        "attempts": 48,
    },
}
PER_KIND = 20  # requests of a kind in a block
LATE_MS = 5.0
"""By how much an answer may be late, ms."""


class Answered(NamedTuple):
    """One request with one deadline."""

    safe: bool
    ms: float
    """Of the thread's processor."""


def questions(kind: str, first: int, count: int) -> Iterator[Question]:
    """Yield what ``plan`` is asked by the requests of a kind from a number on."""
    encounters = encounters_of_seed(scenario(aircraft=PAPER, **KINDS[kind]), 0, first, count)
    request, sensor = request_of(encounters, PAPER), encounters.sensor
    position_std, velocity_std, age = (
        float(np.max(f)) for f in (sensor.position_std, sensor.velocity_std, sensor.latency)
    )
    for number in range(count):
        drawn = question(encounters, request, number)
        reports = [
            Intruder(state, age=age, position_std=position_std, velocity_std=velocity_std)
            for state in drawn.states
        ]
        yield drawn._replace(intruders=reports)


def answer(request: Question, limit: float, policy: Policy) -> Answered:
    """Plan with a deadline, ms."""
    options = replace(Options.for_aircraft(policy.aircraft), deadline_s=limit * 1e-3)
    timed = time_plan(request, policy, options)
    return Answered(timed.answer.safe, 1e3 * timed.seconds)


def answers(block: int, policy: Policy) -> dict[str, Any]:
    """Return of the requests of a block, by kind and deadline, whether they are SAFE (``safe``)
    and the time of the answer (``ms``).
    """
    safe: dict[str, list[list[bool]]] = {}
    spent: dict[str, list[list[float]]] = {}
    for kind in KINDS:
        rows = [
            [answer(request, limit, policy) for limit in DEADLINES_MS]
            for request in questions(kind, block * PER_KIND, PER_KIND)
        ]
        safe[kind] = [[answered.safe for answered in row] for row in rows]
        spent[kind] = [[answered.ms for answered in row] for row in rows]
    return {"safe": safe, "ms": spent}


def ask_late_again(blocks: Sequence[dict[str, Any]], policy: Policy) -> dict[str, int]:
    """Ask again what was answered late, and return how many answers were late each time: a shared
    host may hold up a thread once.
    """
    late = [
        (kind, block * PER_KIND + number, limit)
        for block, rows in enumerate(blocks)
        for kind in KINDS
        for number, row in enumerate(rows["ms"][kind])
        for limit, ms in zip(DEADLINES_MS, row, strict=True)
        if ms - limit > LATE_MS
    ]
    again = [
        answer(next(questions(kind, number, 1)), limit, policy).ms - limit
        for kind, number, limit in late
    ]
    return {
        f"more_than_{LATE_MS:g}_ms_late": len(late),
        "late_when_asked_again": sum(ms > LATE_MS for ms in again),
    }


def figures(blocks: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the shares and times of all blocks, lists by deadline."""
    summary: dict[str, Any] = {"benchmark": "deadline", "deadlines_ms": [*DEADLINES_MS[:-1], None]}
    late = 0.0
    for kind in KINDS:
        safe, ms = (
            np.array([row for block in blocks for row in block[measure][kind]])
            for measure in ("safe", "ms")
        )
        solved = safe[safe[:, -1]]
        late = max(late, float((ms[:, :-1] - DEADLINES_MS[:-1]).max()))
        summary[kind] = {
            "requests": len(safe),
            "resolvable": len(solved),
            "safe_of_resolvable": solved.mean(axis=0).tolist() if len(solved) else None,
            "median_ms": np.median(ms, axis=0).tolist(),
            "slowest_ms": ms.max(axis=0).tolist(),
        }
    answered = sum(summary[kind]["requests"] for kind in KINDS) * (len(DEADLINES_MS) - 1)
    return summary | {"answers_with_a_deadline": answered, "latest_after_its_deadline_ms": late}


def draw(summary: dict[str, Any]) -> "Figure":
    """Return the figure: SAFE of the resolvable, and the slowest answer, against the deadline."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    limits = DEADLINES_MS[:-1]
    for kind in KINDS:
        if summary[kind]["safe_of_resolvable"]:
            left.semilogx(limits, summary[kind]["safe_of_resolvable"][:-1], marker="o", label=kind)
        right.loglog(limits, summary[kind]["slowest_ms"][:-1], marker="o", label=kind)
    right.loglog(
        limits, [limit + LATE_MS for limit in limits], "k--", label=f"deadline + {LATE_MS:g} ms"
    )
    for axes, label in ((left, "SAFE of the resolvable"), (right, "slowest answer, ms")):
        axes.set(
            xlabel="deadline, ms",
            ylabel=label,
            xticks=limits,
            xticklabels=[f"{limit:g}" for limit in limits],
        )
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    right.legend(frameon=False)
    return figure


def main() -> None:
    """Measure what is missing, and print."""
    options = _parser().parse_args()
    require("--out", "matplotlib")
    policy = policy_in_flight(options.policy)
    policy = policy.for_aircraft(policy.aircraft, outside="allow")  # up to eight intruders
    options.out.mkdir(parents=True, exist_ok=True)
    count = -(-options.requests // (PER_KIND * len(KINDS)))
    paths = [options.out / f"block-{block:05d}.json" for block in range(count)]
    with threadpool_limits(1):
        # The first plan of a process makes tables.
        first = encounters_of_seed(scenario("multi", PAPER), 1, 0, 1)
        plan(*question(first, request_of(first, PAPER), 0), policy)
        # As the ROS nodes do: a search for garbage in all that was imported takes 10 ms and more.
        gc.freeze()
        for block, path in enumerate(paths):
            _answer_block(block, path, policy)
        # Held only now, for the same reason: a search through 200 blocks takes 5 ms.
        blocks = [parse_json(path.read_text()) for path in paths]
        gc.freeze()
        summary = figures(blocks) | ask_late_again(blocks, policy)
    write_file(options.out / "deadline.json", json.dumps(summary, indent=2) + "\n")
    save_figure(draw(summary), options.out / "deadline")
    report(summary, ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    help_text = "folder of the blocks, the result and the figure"
    add("--out", type=Path, required=True, help=help_text)
    add(
        "--requests",
        type=whole(1),
        default=300,
        help="requests, in whole blocks of 100 (default 300)",
    )
    add("--policy", type=Path, help="policy file (default: the one that ships)")
    return parser


def _answer_block(block: int, path: Path, policy: Policy) -> None:
    """Write the answers of a block, unless they are there.

    Raises:
        InputError: the file is of another policy.
    """
    if not path.exists():
        write_file(path, json.dumps({"policy": policy.sha256} | answers(block, policy)))
    elif parse_json(path.read_text())["policy"] != policy.sha256:
        raise InputError(
            f"--out {path.parent} holds answers of another policy; expected a new folder"
        )


if __name__ == "__main__":
    run_cli(main)
