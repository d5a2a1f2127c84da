"""The attack on certificates: ``python -m benchmarks.safety.certificates [--plans 1000] [--first 0] [--workers N]``.

SAFE plans of the attack's requests (:mod:`benchmarks.safety.adversary`) are certified; the independent checker must
accept every certificate. Then a number of each is moved a little: of a waypoint, with the legs as they were or
solved anew, of an intruder, a time, a control, a limit or a claimed distance; or an intruder is shifted to pass close
to the separation. Where the moved plan is wrong as :mod:`benchmarks.safety.resimulation` flies it by small steps, the
checker must refuse it. The last line is one JSON object; exit status 1 means that a certificate was refused or a wrong
one accepted.
"""

import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from agents.check import RefusedError, accept
from agents.planner.answer import RequestError
from agents.planner.traffic import Requirement, Traffic, advanced
from agents.policy.inference import Policy
from benchmarks.measure import report
from benchmarks.safety import published
from benchmarks.safety.adversary import VARIANTS, drawn
from benchmarks.safety.resimulation import CHECKS, Route, resimulate, travelled
from envs import waypoints
from envs.edge.command import Parser, run_cli
from envs.kinematics import Limits, VehicleState
from envs.trees import mapped, take
from eval.runner.workers import cores

__all__ = ["main", "moved", "wrong"]

_BLOCK = 50  # requests at a time
_STRIDE = 101  # between their numbers: all families and options come in turn
_JUDGED = [CHECKS.index(name) for name in ("leg", "speed", "acceleration", "turn rate", "required", "separation")]
_SAME = 1e-6  # rad/s and m/s^2 by which controls may differ from the legs'
_SLACK = 1e-3  # m, of the resimulation


def moved(data: dict[str, Any], rng: np.random.Generator) -> tuple[dict[str, Any], str]:
    """Return a certificate with something moved by less than would show in a picture, and what was moved.

    An ``approach`` shifts an intruder by more, so that it comes as close as the separation but for 1 mm to 30 m.
    """
    data = json.loads(json.dumps(data))
    size = float(10.0 ** rng.uniform(-3.0, 1.5) * rng.choice([-1.0, 1.0]))  # m
    leg, part = int(rng.integers(len(data["waypoints"]))), int(rng.integers(5))
    unit = (1.0, 1.0, 1e-3, 0.02, 0.01)[part]
    kinds = ["waypoint", "waypoint and legs", "waypoint and legs", "control", "limit"]
    kinds += ["intruder", "approach", "approach", "approach", "bound", "requirement"] if data["intruders"] else []
    kind = kinds[int(rng.integers(len(kinds)))]
    if kind.startswith("waypoint"):
        data["waypoints"][leg][part] += size * unit
        if kind != "waypoint" and data["waypoints"][leg][4] > ([0.0] + [row[4] for row in data["waypoints"]])[leg]:
            data["controls"] = _controls(data)
    elif kind == "control":
        data["controls"][leg][int(rng.integers(20))] += size * 1e-3
    elif kind == "limit":
        name = list(data["limits"])[part]
        data["limits"][name] -= abs(size) * (0.02 if part < 2 else 1e-3) * (1.0 if part in (1, 3, 4) else -1.0)
    elif kind == "intruder":
        row = data["intruders"][int(rng.integers(len(data["intruders"])))]
        field = int(rng.choice([0, 1, 2, 3, 4, 5, 7, 8]))
        row[field] += abs(size) if field > 5 else size * (1.0, 1.0, 1e-3, 0.02, 0.01, 1e-4)[field]
    elif kind == "approach":
        _approach(data, int(rng.integers(len(data["intruders"]))), data["requirement"]["separation"] + size)
    elif kind == "bound":
        data["bounds"][int(rng.integers(len(data["bounds"])))] += abs(size)
    else:
        data["requirement"][("margin", "sigmas")[part % 2]] += abs(size) * (1.0, 0.01)[part % 2]
    return data, kind


def _approach(data: dict[str, Any], number: int, distance: float) -> None:
    """Shift an intruder to come as close as that, and ask for nothing but the separation."""
    data["requirement"] |= {"margin": 0.0, "sigmas": 0.0}
    data["bounds"] = [1.0] * len(data["bounds"])
    row = data["intruders"][number]
    x, y, heading, speed, age, rate, lasts = row[:7]
    curves = waypoints.legs(_knots(data))
    times, apart = np.arange(0.0, data["waypoints"][-1][4], 0.5), np.zeros(1, dtype=complex)
    for _ in range(2):
        many = mapped(lambda field: np.repeat(field[None], len(times), axis=0), curves)  # noqa: B023
        own = waypoints.at(many, times)
        apart = (
            x
            + 1j * y
            + travelled(heading, speed, rate if lasts > 0.0 else 0.0, lasts, times + age)
            - own.x
            - 1j * own.y
        )
        middle = times[np.argmin(np.abs(apart))]
        times = np.clip(middle + np.linspace(-0.5, 0.5, 1001), 0.0, data["waypoints"][-1][4])
    nearest = apart[np.argmin(np.abs(apart))]
    shift = nearest / np.abs(nearest) * (distance - np.abs(nearest))
    row[0], row[1] = float(x + shift.real), float(y + shift.imag)


def _knots(data: dict[str, Any]) -> waypoints.Knots:
    points = np.array([[*data["own"], 0.0], *data["waypoints"]])
    return waypoints.Knots(points[:, 0], points[:, 1], points[:, 2], points[:, 3], points[:, 4])


def wrong(data: dict[str, Any]) -> str:
    """Return what small steps find wrong with the plan of a certificate, or nothing."""
    own, knots = data["own"], _knots(data)
    if not (np.diff(knots.time) > 0.0).all():
        return "times"
    if np.max(np.abs(np.array(data["controls"]) - np.array(_controls(data)))) > _SAME:
        return "controls"
    limits = Limits(**data["limits"])
    limits = limits._replace(speed_max=max(limits.speed_max, own[3]), speed_min=min(limits.speed_min, own[3]))
    rows = np.array(data["intruders"] or [[1e7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]).T[:, :, None]
    if rows[3].min() < 0.0 or rows[6:].min() < 0.0:
        return "negative"
    count = rows.shape[1]
    state = VehicleState(rows[0], rows[1], rows[2], rows[3])
    seen = Traffic(state, np.ones((count, 1), dtype=bool), rows[5], rows[6], rows[7], rows[8])
    wanted = Requirement(*(data["requirement"][name] for name in ("separation", "margin", "sigmas")))
    plan = mapped(lambda field: np.repeat(field[None], count, axis=0), knots)
    route = Route(plan.x[:, -2:], plan.y[:, -2:], np.full(count, 2), np.full(count, 1))
    begin = VehicleState(plan.x[:, 0], plan.y[:, 0], plan.heading[:, 0], plan.speed[:, 0])
    verdict = resimulate(plan, begin, advanced(seen, rows[4]), route, wanted, limits)
    found = [CHECKS[check] for check in _JUDGED if verdict.wrong[check].any()]
    if data["intruders"] and (np.array(data["bounds"]) > verdict.min_separation + _SLACK).any():
        found.append("bound")
    return ", ".join(found)


def _controls(data: dict[str, Any]) -> list[list[float]]:
    curves = waypoints.legs(_knots(data))
    return np.concatenate([curves.yaw_rate, curves.acceleration], axis=-1).tolist()


def _refused(data: dict[str, Any]) -> str:
    try:
        accept(data)
    except RefusedError as problem:
        return str(problem)
    except (ValueError, ArithmeticError) as problem:
        return repr(problem)
    return ""


def _attack(seed: int, first: int, count: int) -> tuple[Counter[str], list[str], float, int]:
    """Certify the SAFE plans among some requests; return counts, failures, the slowest check (s) and largest size."""
    counts: Counter[str] = Counter()
    failures: list[str] = []
    slowest, largest = 0.0, 0
    policy = Policy.load()
    with threadpool_limits(1):
        for number in range(first, first + _STRIDE * count, _STRIDE):
            request = drawn(seed, number, 1)
            question = published.question(seed, number, take(request.request, 0))
            options = list(VARIANTS.values())[request.variant[0]]
            try:
                answer = question.asked(policy, options)
            except RequestError:
                continue
            file = answer.certificate
            if file is None:
                continue
            begun = time.process_time()
            data = json.loads(file)
            why = _refused(data)
            slowest, largest = max(slowest, time.process_time() - begun), max(largest, len(file))
            counts["certificates"] += 1
            if why:
                failures.append(f"request {number}: refused: {why}")
            changed, kind = moved(data, np.random.default_rng([seed, number, 1]))
            bad, why = wrong(changed), _refused(changed)
            counts[f"moved {kind}: {'wrong' if bad else 'right'}, {'refused' if why else 'accepted'}"] += 1
            if bad and not why:
                failures.append(f"request {number}: {kind} moved, {bad} is wrong and accepted")
    return counts, failures, slowest, largest


def _results(plans: int, seed: int, first: int, workers: int) -> Iterator[Any]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as executor:
        done, begin = 0, first
        while done < plans:
            begins = [begin + _STRIDE * _BLOCK * number for number in range(workers)]
            begin += _STRIDE * _BLOCK * workers
            for result in executor.map(_attack, [seed] * workers, begins, [_BLOCK] * workers):
                done += result[0]["certificates"]
                yield result


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    assert __doc__ is not None
    parser = Parser(prog="python -m benchmarks.safety.certificates", description=__doc__.split("\n\n")[0])
    parser.add_argument("--plans", type=int, default=1_000, help="SAFE plans at least (default 1000)")
    parser.add_argument("--seed", type=int, default=0, help="of the requests (default 0)")
    parser.add_argument("--first", type=int, default=0, help="number of the first request (default 0)")
    parser.add_argument("--workers", type=int, default=cores(), help="processes (default: one for every core)")
    options = parser.parse_args(arguments)
    for name, least in (("plans", 1), ("seed", 0), ("first", 0), ("workers", 1)):
        if getattr(options, name) < least:
            parser.error(f"--{name} is {getattr(options, name)}, expected {least} or more")
    counts: Counter[str] = Counter()
    failures: list[str] = []
    slowest, largest = 0.0, 0
    complete = False
    try:
        for more, bad, seconds, size in _results(options.plans, options.seed, options.first, options.workers):
            counts.update(more)
            failures += bad
            slowest, largest = max(slowest, seconds), max(largest, size)
            print(f"{counts['certificates']} certificates, {len(failures)} failures", *bad, sep="\n", file=sys.stderr)
        complete = True
    except KeyboardInterrupt:
        print("interrupted; these are the figures of what was done", file=sys.stderr)
    figures = {
        "benchmark": "certificates",
        "seed": options.seed,
        "first": options.first,
        "complete": complete,
        "failures": failures,
    }
    figures |= {
        "counts": dict(sorted(counts.items())),
        "slowest_check_s": slowest,
        "largest_certificate_bytes": largest,
    }
    report(figures, ("numpy",))
    return 1 if failures else 0


if __name__ == "__main__":
    run_cli(main)
