"""Batches of adversarial requests, planned, and what their SAFE plans break when they are judged
anew.

The batch that a request is planned in follows from its number and the size of the blocks, so that
its plan does too: in another batch the policy's network rounds differently.
"""

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.check import accept
from agents.planner.answer import Plan, RequestError
from agents.planner.planner import plan_many
from agents.planner.publish.certificate import Evidence
from agents.planner.request.request import Options, in_wind
from agents.policy.inference import Policy
from benchmarks.safety import heights, published, sky
from benchmarks.safety.adversary import (
    FAMILIES,
    VARIANTS,
    Drawn,
    draw_requests,
    random_aircraft,
    scale,
    variants,
)
from benchmarks.safety.reflight import refly
from benchmarks.safety.resimulation import CHECKS, Flown, Route, fly, resimulate
from commands.json_text import parse_json
from envs import draws
from envs.aircraft import PAPER, Aircraft
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits
from envs.trees import map_leaves, take
from envs.waypoints import ARCS, PlanStates, Waypoint, legs

__all__ = ["HUNDRED", "REFLOWN", "Batch", "Tally", "attack", "judge", "tasks"]

HUNDRED = 100
"""Consecutive requests that are planned with the same options."""

REFLOWN = 0.05
"""Share of SAFE plans that the follower flies."""

_SHOWN = 10  # numbers of each check in the last line
_SKY = (
    "wind",
    "uncertain wind",
    "areas",
    "windows",
    "own separations",
    "all of these",
    "climbs and descents",
    "floor or ceiling",
)
_CERTIFICATES = ("right", "moved and right", "moved and wrong", "without a profile")


class Batch(NamedTuple):
    """Requests of one variant that are planned together, and which of them count."""

    seed: int
    hundreds: tuple[int, ...]
    """First numbers of the hundreds."""
    first: int
    """Those from this number on count."""
    end: int
    """Those from this number on do not."""
    single: bool
    """Whether they go through ``plan`` one by one."""
    family: str = ""
    """Name of the only family that is planned; empty: all are."""
    any_aircraft: bool = False
    """Whether the requests are scaled to an aircraft drawn by the batch's first number; else the
    paper's.
    """
    in_space: bool = False
    """Whether plans may climb and descend, with vertical limits drawn by the batch's first number.
    """

    @property
    def aircraft(self) -> Aircraft:
        """Whose requests they are."""
        drawn = PAPER
        if self.any_aircraft:
            drawn = random_aircraft(np.random.default_rng([self.seed, self.hundreds[0]]))
        if not self.in_space:
            return drawn
        rng = np.random.default_rng([self.seed, self.hundreds[0], 57])
        return drawn._replace(vertical=heights.random_vertical(drawn, rng))


@dataclass
class Tally:
    """What was found so far."""

    requests: Counter[str] = field(default_factory=Counter)
    """By family."""
    safe: Counter[str] = field(default_factory=Counter)
    single: Counter[str] = field(default_factory=Counter)
    """Answers of ``plan``: safe, unresolved, refused."""
    counts: Counter[str] = field(default_factory=Counter)
    """SAFE plans re-flown, and those of them that came closer than 1000 m because they began so
    close, or were asked for less than the follower's error beyond it. Requests of ``plan`` that
    have a wind, areas and so on, and how many of them are SAFE."""
    violations: list[dict[str, Any]] = field(default_factory=list)
    clearance: float = np.inf
    """Smallest distance of a SAFE plan from an intruder less the separation, m."""
    flown: float = np.inf
    """Smallest distance from an intruder as flown by the follower, m."""
    error: float = 0.0
    """Largest distance of the follower from its plan, m."""
    use: dict[str, float] = field(default_factory=dict)
    """Largest share of each limit that a SAFE plan uses."""

    def add(self, other: "Tally") -> None:
        """Add what was found elsewhere."""
        for name in ("requests", "safe", "single", "counts"):
            getattr(self, name).update(getattr(other, name))
        self.violations += other.violations
        self.clearance = min(self.clearance, other.clearance)
        self.flown, self.error = min(self.flown, other.flown), max(self.error, other.error)
        for name, value in other.use.items():
            self.use[name] = max(self.use.get(name, 0.0), value)

    @classmethod
    def of(cls, written: dict[str, Any]) -> "Tally":
        """Return the tally that these numbers, its ``vars``, were written of."""
        counters: dict[str, Any] = {
            name: Counter(written[name]) for name in ("requests", "safe", "single", "counts")
        }
        return cls(**(written | counters))

    def blame(self, check: str, number: int, **more: Any) -> None:
        """Note a violation."""
        self.violations.append({"check": check, "number": int(number)} | more)

    def figures(self) -> dict[str, Any]:
        """Return everything as it is printed."""
        checks: dict[str, list[int]] = {}
        for violation in self.violations:
            checks.setdefault(violation["check"], []).append(violation["number"])
        reflown = self.counts["reflown"]
        return {
            "requests": self.requests.total(),
            "safe": self.safe.total(),
            "families": {
                family.name: [self.requests[family.name], self.safe[family.name]]
                for family in FAMILIES
            },
            "through_plan": dict(sorted(self.single.items())),
            "through_plan_with": {
                name: [self.counts[name], self.counts[f"{name}, safe"]] for name in _SKY
            },
            "violations": len(self.violations),
            "violations_by_check": {
                name: {"count": len(numbers), "first": sorted(numbers)[:_SHOWN]}
                for name, numbers in checks.items()
            },
            "smallest_clearance_m": self.clearance if np.isfinite(self.clearance) else None,
            "largest_limit_use": self.use,
            "certificates": {name: self.counts[f"certificate {name}"] for name in _CERTIFICATES},
            "reflown_share": reflown / max(self.safe.total() + self.single["safe"], 1),
            "reflown": reflown,
            "reflown_below_1000_m": self.counts["below 1000 m"],
            "reflown_min_separation_m": self.flown if np.isfinite(self.flown) else None,
            "reflown_max_error_m": self.error if reflown else None,
        }


def tasks(
    seed: int,
    first: int,
    count: int,
    single: int,
    block: int,
    family: str = "",
    *,
    any_aircraft: bool = False,
    in_space: bool = False,
) -> Iterator[Batch]:
    """Return the batches of requests ``first .. first + count - 1``, the first ``single`` of them
    one by one too; those in space all one by one, and only so.
    """
    single = count if in_space else single
    side_by_side = Batch(seed, (), first, first + count, False, family, any_aircraft)
    one_by_one = side_by_side._replace(end=first + single, single=True, in_space=in_space)
    for hundred in range(first // HUNDRED * HUNDRED, first + single if single else 0, HUNDRED):
        yield one_by_one._replace(hundreds=(hundred,))
    if in_space:
        return
    for begin in range(first // block * block, first + count, block):
        alike: dict[int, list[int]] = {}
        for hundred in range(begin, begin + block, HUNDRED):
            alike.setdefault(_variant(hundred), []).append(hundred)
        for hundreds in alike.values():
            if any(first < hundred + HUNDRED and hundred < first + count for hundred in hundreds):
                yield side_by_side._replace(hundreds=tuple(hundreds))


def attack(batch: Batch, policy: Policy) -> Tally:
    """Plan a batch and judge what is called SAFE."""
    tally = Tally()
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        requests = _draw_batch(batch)
        if requests.number.size == 0:
            return tally
        aircraft = batch.aircraft
        policy = policy.for_aircraft(aircraft, outside="allow")
        options = list(variants(aircraft).values())[requests.variant[0]]
        counts = (requests.number >= batch.first) & (requests.number < batch.end)
        if batch.in_space:
            options = heights.climbing(
                options, np.random.default_rng([batch.seed, batch.hundreds[0], 58])
            )
        if batch.single:
            _one_by_one(tally, batch.seed, take(requests, counts), policy, options)
        else:
            _side_by_side(tally, batch.seed, requests, counts, policy, options)
    return tally


def _draw_batch(batch: Batch) -> Drawn:
    """Return the requests of a batch, those of its family alone, for its aircraft."""
    parts = [draw_requests(batch.seed, hundred, HUNDRED) for hundred in batch.hundreds]
    requests: Drawn = map_leaves(lambda *fields: np.concatenate(fields), *parts)
    if batch.family:
        same = [FAMILIES[family].name == batch.family for family in requests.family]
        requests = take(requests, np.array(same))
    if batch.any_aircraft:
        requests = requests._replace(request=scale(requests.request, batch.aircraft))
    return requests


def _side_by_side(
    tally: Tally, seed: int, requests: Drawn, counts: Array, policy: Policy, options: Options
) -> None:
    """Plan requests ``[N]`` together, and judge the SAFE plans of those that count, bool ``[N]``:
    the others are there for the company that rounding depends on.
    """
    tally.requests.update(_families(requests, counts))
    try:
        best = plan_many(requests.request, policy, in_wind(options, None)).candidates
    except Exception as problem:
        tally.blame("exception", requests.number[counts][0], what=repr(problem))
        return
    safe = counts & best.safe
    tally.safe.update(_families(requests, safe))
    plans = take(best, safe)
    judge(tally, seed, take(requests, safe), plans.plan_states, plans.last, options)


def judge(
    tally: Tally,
    seed: int,
    requests: Drawn,
    plan_states: PlanStates[Air],
    last: Array,
    options: Options,
) -> None:
    """Judge SAFE plans ``[N]``: re-simulate all, re-fly some."""
    if len(last) == 0:
        return
    # A flight that begins beyond a speed limit may stay there.
    ceilings = np.maximum(options.limits.speed_max, requests.request.own.speed)
    for ceiling in np.unique(ceilings):
        rows = np.flatnonzero(ceilings == ceiling)
        limits = options.limits._replace(speed_max=float(ceiling))
        _judge_within(
            tally, take(requests, rows), take(plan_states, rows), last[rows], options, limits
        )
    if options.aircraft == PAPER:  # the follower of this attack is tuned to time steps of 1 s
        drawn = [draws.uniforms(seed, int(number), 1, (1,), 1)[0, 0] for number in requests.number]
        finite = np.isfinite(np.stack(plan_states)).all(axis=(0, 2))
        rows = np.flatnonzero((np.array(drawn) < REFLOWN) & finite)
        if rows.size:
            _refly(tally, take(requests, rows), take(plan_states, rows), options)


def _judge_within(
    tally: Tally,
    requests: Drawn,
    plan_states: PlanStates[Air],
    last: Array,
    options: Options,
    limits: Limits,
) -> None:
    """Re-simulate SAFE plans ``[N]`` within limits, which may leave the ownship faster than those
    of the options.
    """
    request = requests.request
    route = Route(request.route_x, request.route_y, request.points, last)
    result = resimulate(plan_states, request.own, request.traffic, route, options, limits)
    for check, row in np.argwhere(result.wrong).tolist():
        separation = float(result.min_separation[row])
        _blame(tally, CHECKS[check], requests, row, separation=separation)
    tally.clearance = min(tally.clearance, float(result.clearance.min()))
    for name, value in _use(plan_states, limits).items():
        tally.use[name] = max(tally.use.get(name, 0.0), value)
    # No vehicle of ours gets back to a speed beyond the limit that it has left
    # (envs.kinematics.advance).
    for row in np.flatnonzero(_exceeds_speed(plan_states, options.limits)).tolist():
        _blame(tally, "speed beyond the limit regained", requests, row)


def _refly(tally: Tally, requests: Drawn, plan_states: PlanStates[Air], options: Options) -> None:
    """Fly SAFE plans ``[N]`` by the follower, one at least."""
    flight = refly(plan_states, requests.request, options.requirement, options.limits)
    near = int(np.sum(flight.separation < 1000.0))
    tally.counts.update({"reflown": len(flight.separation), "below 1000 m": near})
    tally.flown = min(tally.flown, float(flight.separation.min()))
    tally.error = max(tally.error, float(flight.error.max()))
    for name, wrong in (("flown separation", flight.too_close), ("flown error", flight.astray)):
        for row in np.flatnonzero(wrong).tolist():
            separation, error = float(flight.separation[row]), float(flight.error[row])
            _blame(tally, name, requests, row, separation=separation, error=error)


def _one_by_one(tally: Tally, seed: int, requests: Drawn, policy: Policy, options: Options) -> None:
    """Ask ``plan`` for each of some requests ``[N]`` and judge its SAFE answers."""
    judged: list[published.AsArrays] = []
    places = []
    for row in range(len(requests.number)):
        arrays = _ask(tally, seed, requests, row, policy, options)
        if arrays is not None:
            judged.append(arrays)
            places.append(row)
    if options.climbs:  # they are planned in no other way
        tally.requests.update(_families(requests, np.arange(len(requests.number))))
        tally.safe.update(_families(requests, np.array(places, dtype=int)))
    if judged:
        plans: published.AsArrays = map_leaves(lambda *fields: np.stack(fields), *judged)
        answered = take(requests, np.array(places))._replace(request=plans.request)
        judge(tally, seed, answered, plans.plan_states, plans.last, options)


def _ask(
    tally: Tally, seed: int, requests: Drawn, row: int, policy: Policy, options: Options
) -> published.AsArrays | None:
    """Ask ``plan`` for one of some requests, and judge what a SAFE answer promises beside limits
    and separation; return such an answer, if it has its waypoints.
    """
    number, unit = int(requests.number[row]), options.aircraft.separation
    question = published.question(seed, number, take(requests.request, row), unit)
    if options.climbs:
        question, options = published.in_space(question, options, seed, number)
    try:
        answer = question.ask(policy, options)
    except RequestError:
        tally.single["refused"] += 1
        return None
    except Exception as problem:
        _blame(tally, "exception", requests, row, what=repr(problem))
        return None
    tally.single[answer.status.value] += 1
    faults = published.faults(question, answer, options)
    names = _what_stands_around(question, answer, options)
    tally.counts.update(names)
    arrays = None
    if answer.safe and not {"count", "altitudes"} & set(faults):
        tally.counts.update(f"{name}, safe" for name in names)
        arrays = published.as_arrays(question, answer, options)
        flown = fly(arrays.plan_states)
        faults += _faults_around(question, question.sky, answer.waypoints, flown, options)
        rng = np.random.default_rng([seed, number, 55])
        moved = sky.move(question.sky, rng)
        faults += _certificates(tally, question, answer, flown, moved, options)
        if options.climbs:
            faults += _moved_altitude(tally, question, answer, flown, rng, options)
    for fault in faults:
        _blame(tally, fault, requests, row)
    return arrays


def _faults_around(
    question: published.Question,
    around: sky.Sky,
    waypoints: Sequence[Waypoint],
    flown: Flown,
    options: Options,
) -> list[str]:
    """Return what a plan with these waypoints breaks of what stands around it, and of what an
    aircraft can do up and down.
    """
    altitude = question.altitude
    faults = sky.faults(around, flown, options, altitude, waypoints)
    if options.climbs:
        assert altitude is not None
        faults += heights.faults(altitude, waypoints, flown, around.areas, options)
    return faults


def _certificates(
    tally: Tally,
    question: published.Question,
    answer: Plan,
    flown: Flown,
    moved: sky.Sky,
    options: Options,
) -> list[str]:
    """Return what the independent checker decides wrongly of a plan's certificate, and of the same
    with wind and areas as they are ``moved``.
    """
    assert answer.certificate is not None
    data = parse_json(answer.certificate)
    wrong = [] if _is_accepted(data) else ["certificate refused"]
    tally.counts["certificate right"] += 1
    for row, area in zip(data["areas"], moved.areas, strict=True):
        row |= {
            "clearance": area.clearance,
            "velocity": list(area.velocity),
            "growth": area.growth,
        }
    if moved.wind is not None:
        data["wind"]["std"] = moved.wind.std
    bad = bool(_faults_around(question, moved, answer.waypoints, flown, options))
    return wrong + _decide(tally, data, bad=bad)


def _moved_altitude(
    tally: Tally,
    question: published.Question,
    answer: Plan,
    flown: Flown,
    rng: np.random.Generator,
    options: Options,
) -> list[str]:
    """Return what the independent checker decides wrongly of the certificate of a plan with the
    altitude of one waypoint moved.
    """
    assert isinstance(answer.evidence, Evidence)
    moved = replace(answer, waypoints=heights.move(answer.waypoints, rng))
    evidence = replace(answer.evidence, published=moved.waypoints)
    bad = bool(_faults_around(question, question.sky, moved.waypoints, flown, options))
    if not bad:
        plan: published.AsArrays = take(published.as_arrays(question, moved, options), None)
        route = Route(plan.request.route_x, plan.request.route_y, plan.request.points, plan.last)
        result = resimulate(
            plan.plan_states, plan.request.own, plan.request.traffic, route, options, options.limits
        )
        bad = any(result.wrong[CHECKS.index(check), 0] for check in ("required", "separation"))
    try:
        data = parse_json(evidence.certificate())
    except ValueError:  # such as an altitude that cannot be reached
        tally.counts["certificate without a profile"] += 1
        return [] if bad else ["profile of a right plan refused"]
    return _decide(tally, data, bad=bad)


def _decide(tally: Tally, data: dict[str, Any], *, bad: bool) -> list[str]:
    """Count a certificate of something moved, and return what the checker decides wrongly of it."""
    tally.counts[f"certificate moved and {'wrong' if bad else 'right'}"] += 1
    return ["wrong certificate accepted"] if bad and _is_accepted(data) else []


def _is_accepted(data: dict[str, Any]) -> bool:
    try:
        accept(data)
    except (ValueError, ArithmeticError):
        return False
    return True


def _what_stands_around(question: published.Question, answer: Plan, options: Options) -> list[str]:
    """Return which of :data:`_SKY` a request has, and whether its plan changes its altitude."""
    wind, areas = question.sky
    holds = {
        "wind": wind is not None,
        "uncertain wind": wind is not None and wind.std > 0.0,
        "areas": bool(areas),
        "windows": _has_windows(question),
        "own separations": any(intruder.separation is not None for intruder in question.intruders),
    }
    holds["all of these"] = all(holds.values())
    altitudes = {
        round(point.altitude, 3) for point in answer.waypoints if point.altitude is not None
    }
    holds["climbs and descents"] = options.climbs and len(altitudes) > 1
    holds["floor or ceiling"] = options.floor is not None or options.ceiling is not None
    return [name for name in _SKY if holds[name]]


def _has_windows(question: published.Question) -> bool:
    """Return whether an intruder's altitude can be held against the ownship's."""
    own = question.altitude
    others = [intruder.altitude for intruder in question.intruders]
    return own is not None and any(
        altitude is not None and altitude.reference == own.reference for altitude in others
    )


def _families(requests: Drawn, rows: Array) -> Counter[str]:
    return Counter(FAMILIES[family].name for family in requests.family[rows].tolist())


def _variant(number: int) -> int:
    return int(draw_requests(0, number, 1).variant[0])


def _blame(tally: Tally, check: str, requests: Drawn, row: int, **more: Any) -> None:
    family, variant = FAMILIES[requests.family[row]].name, list(VARIANTS)[requests.variant[row]]
    tally.blame(check, requests.number[row], family=family, options=variant, **more)


def _exceeds_speed(plan_states: PlanStates[Air], limits: Limits) -> Array:
    """Return where a plan accelerates to a speed beyond the limit, ``[N]``."""
    curves = legs(plan_states)
    after = curves.speed + curves.acceleration * (curves.duration[..., None] / ARCS)
    return ((after > limits.speed_max + 1e-3) & (curves.acceleration > 1e-6)).any(axis=(1, 2))


def _use(plan_states: PlanStates[Air], limits: Limits) -> dict[str, float]:
    """Return the largest share of each limit that plans use."""
    curves = legs(plan_states)
    values = {
        "turn_rate": np.abs(curves.yaw_rate) / limits.yaw_rate_max,
        "acceleration": curves.acceleration / limits.acceleration_max,
        "deceleration": curves.acceleration / limits.acceleration_min,
        "speed_max": plan_states.speed / limits.speed_max,
        "speed_min": limits.speed_min / np.maximum(plan_states.speed, 1e-9),
    }
    return {name: float(np.max(value, initial=0.0)) for name, value in values.items()}
