"""Plans that climb and descend: ``python -m benchmarks.climbs [--aircraft c208] [--requests 200]``.

``latency``: one to four intruders that cross the straight flight within two vertical separations of
it, level, climbing or descending, every other request with the errors of ADS-B; planned with turns
alone and with turns and climbs, the same vertical separation for both. ``deadline``: 20 aircraft at
random levels and rates within 30 km, SAFE of those that five seconds solve. ``unresolvable``:
encounters of ``circle`` without an initial separation that are proven unresolvable in the plane, at
the same level and at others, planned without a deadline, and beside that a search apart from the
planner (:mod:`benchmarks.space_search`); the same close by, and with --model there with speeds and
vertical rates of an encounter model. Times are the processor's for the thread.
"""

import gc
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.config.world import AircraftConfig
from agents.planner import Intruder, Options, plan
from agents.planner.answer import Source
from agents.planner.request.encounters import request_of
from agents.planner.request.options import Maneuvers
from agents.planner.request.request import Altitude
from agents.policy.inference import Policy
from agents.resolvability.classify import Verdict, classify
from benchmarks import levels, traffic
from benchmarks.levels import OWN_ALTITUDE
from benchmarks.measure import (
    deadline_option,
    parse_names,
    percentiles_ms,
    policy_in_flight,
    report,
    request_options,
    show,
)
from benchmarks.planner import question
from benchmarks.questions import Question, Timed, time_plan
from benchmarks.space_search import Motion, escapes
from commands.command import ConfigError, Parser, run_cli, whole
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from envs.frames import Ground
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.traffic.encounter_model import EncounterModel, read_model
from envs.traffic.encounter_model_sampler import dimensions, sample_model

PARTS = "latency", "deadline", "unresolvable"
CLOSE = 1.2, 2.5
"""Radius of the circle of encounters close by, separations."""

LEVELS = 8
"""Other levels of the intruder of each encounter."""

_PATIENT = 5.0  # s of computation
_CROWD, _RADIUS = 20, 30_000.0  # aircraft, m
_APART, _CLIMB = 1_000.0, 10.0  # m and m/s, of the crowd at most
_WITHIN = 2.0  # vertical separations from the ownship at the crossing
_RATE = 5.0  # m/s of intruders of circles at most
_SOURCES = Source.POLICY, Source.FALLBACK, Source.VERTICAL


class TimedRequest(NamedTuple):
    """A request, planned with the usual deadline."""

    timed: Timed
    errors: bool  # whether the reports have those of ADS-B


class Compared(NamedTuple):
    """What solves an encounter that is proven unresolvable in the plane and begins with one of both
    separations.
    """

    level: bool  # whether both begin at the same level
    searched: bool  # the search in space does
    climbs: bool  # it needs a change of climb for that
    with_margin: bool  # it does with the planner's vertical margin too
    planned: bool  # the planner does


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser().parse_args(arguments)
    parts = parse_names(options.only, PARTS)
    policy, usual = _of_aircraft(options.aircraft, options.policy)
    if options.deadline is not None:
        usual = replace(usual, deadline_s=1e-3 * options.deadline)
    model = None if options.model is None else read_model(options.model)
    measure: dict[str, Callable[[], dict[str, Any]]] = {
        "latency": lambda: latency(options.seed, options.requests, policy, usual),
        "deadline": lambda: deadline(options.seed, options.requests, policy, usual),
        "unresolvable": lambda: unresolvable(
            options.seed, options.encounters, policy, usual, model
        ),
    }
    results: dict[str, Any] = {
        "benchmark": "climbs",
        "aircraft": str(options.aircraft),
        "deadline_ms": 1e3 * usual.deadline_s,
    }
    with threadpool_limits(1):
        # The first plan of a process makes tables.
        time_plan(levels.question(0, policy.aircraft), policy, usual, own_altitude=OWN_ALTITUDE)
        # As the ROS nodes do: a search for garbage in all that was imported takes 10 ms and more.
        gc.freeze()
        for part in parts:
            results[part] = measure[part]()
            print(part)
            show(results[part])
    report(results, ("numpy",))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    request_options(parser, 200)
    deadline_option(parser)
    add = parser.add_argument
    help_text = "file of the aircraft, or the name of one that ships (default c208)"
    add("--aircraft", type=Path, default=Path("c208"), metavar="FILE", help=help_text)
    help_text = "encounters of each circle (default 2000)"
    add("--encounters", type=whole(1), default=2_000, help=help_text)
    add("--model", type=Path, metavar="FILE", help="file of an encounter model (default: none)")
    help_text = f"some of {', '.join(PARTS)}, with commas (default: all)"
    add("--only", default=",".join(PARTS), metavar="NAMES", help=help_text)
    return parser


def _of_aircraft(file: Path, policy_file: Path | None) -> tuple[Policy, Options]:
    """Return the policy for an aircraft, and the options with which its plans climb.

    Raises:
        ConfigError: the aircraft states no vertical limits.
    """
    aircraft = AircraftConfig.of_file(file).aircraft()
    if aircraft.vertical is None:
        raise ConfigError(f"--aircraft: {file} states no climb_max_mps; expected one that climbs")
    policy = policy_in_flight(policy_file).for_aircraft(aircraft, outside="allow")
    return policy, Options.for_aircraft(aircraft, maneuvers=Maneuvers.BOTH)


def latency(seed: int, count: int, policy: Policy, usual: Options) -> dict[str, Any]:
    """Return what plans with turns and climbs, and with turns alone, take and solve."""
    vertical = usual.vertical.separation
    plane = replace(usual, maneuvers=Maneuvers.HORIZONTAL, vertical_filter=vertical)
    turns_and_climbs, turns = list[TimedRequest](), list[TimedRequest]()
    for number in range(seed, seed + count):
        request = levels.question(number, policy.aircraft, _WITHIN * vertical)
        errors = number % 2 == 1
        request = _as_known(request, errors)
        for options, every in ((plane, turns), (usual, turns_and_climbs)):
            timed = time_plan(request, policy, options, own_altitude=OWN_ALTITUDE)
            every.append(TimedRequest(timed, errors))
    return {"requests": count, "both": _figures(turns_and_climbs), "horizontal": _figures(turns)}


def _as_known(request: Question, errors: bool) -> Question:
    """Return a request with exact reports, or with those of ADS-B: a second old, NACp 8, NACv 2."""
    reports = list[Intruder[Ground]]()
    for intruder in request.intruders:
        assert isinstance(intruder, Intruder)
        assert intruder.altitude is not None
        level = replace(intruder.altitude, error=0.0)
        report = replace(intruder, altitude=level)
        if errors:
            level = replace(intruder.altitude, error=30.0, climb_error=0.3)
            report = replace(intruder, age=1.0, position_std=46.0, velocity_std=1.5, altitude=level)
        reports.append(report)
    return request._replace(intruders=reports)


def _figures(every: Sequence[TimedRequest]) -> dict[str, Any]:
    """Return the times and the sources of plans of one kind."""
    figures: dict[str, Any] = _shares([row.timed for row in every])
    for name, errors in (("exact", False), ("with_errors", True)):
        figures[name] = _shares([row.timed for row in every if row.errors == errors])
    return figures


def _shares(every: Sequence[Timed]) -> dict[str, Any]:
    """Return the share of SAFE, what made them, and the times of answers."""
    if not every:
        return {"requests": 0}
    safe = [row.answer for row in every if row.answer.safe]
    made_by = Counter(answer.source for answer in safe)
    return {
        "requests": len(every),
        "safe": len(safe) / len(every),
        **{f"by_{source.value}": made_by[source] for source in _SOURCES},
        **percentiles_ms("cpu", [row.seconds for row in every], ("median", "p99", "max")),
    }


def deadline(seed: int, count: int, policy: Policy, usual: Options) -> dict[str, Any]:
    """Return what the usual deadline solves in a crowd of that which can be solved."""
    timed, solved = list[Timed](), 0
    patient = replace(usual, deadline_s=_PATIENT)
    for number in range(seed, seed + count):
        request = crowd(number, policy.aircraft)
        timed.append(time_plan(request, policy, usual, own_altitude=OWN_ALTITUDE))
        solved += (
            timed[-1].answer.safe
            or time_plan(request, policy, patient, own_altitude=OWN_ALTITUDE).answer.safe
        )
    safe = sum(row.answer.safe for row in timed)
    return {
        "solved": solved,
        "safe_of_solved": safe / solved if solved else None,
        **_shares(timed),
    }


def crowd(seed: int, aircraft: Aircraft) -> Question:
    """Return a request of some number among many aircraft at random levels, half of which climb or
    descend.
    """
    rng = np.random.default_rng([seed, 70])
    drawn = traffic.question(seed, _CROWD, _RADIUS, aircraft)
    reports = [
        Intruder(
            state,
            altitude=Altitude(
                OWN_ALTITUDE.value + rng.uniform(-_APART, _APART),
                OWN_ALTITUDE.reference,
                float(rng.choice([0.0, 1.0]) * rng.uniform(-_CLIMB, _CLIMB)),
            ),
        )
        for state in drawn.states
    ]
    return drawn._replace(intruders=reports)


def unresolvable(
    seed: int, count: int, policy: Policy, usual: Options, model: EncounterModel | None
) -> dict[str, Any]:
    """Return how many of the encounters that are proven unresolvable in the plane are solved in
    space.
    """
    aircraft, unit = policy.aircraft, float(policy.aircraft.separation)
    circle = scenario("circle", aircraft, min_initial_separation=0.0)
    close = replace(circle, radius=(CLOSE[0] * unit, CLOSE[1] * unit))
    few = -(-count // 4)  # a quarter of those close by is unresolvable
    kinds = {
        "circle": encounters_of_seed(circle, seed, 0, count),
        "close": encounters_of_seed(close, seed, 0, few),
    }
    rng = np.random.default_rng([seed, 71])
    rates = {
        name: rng.choice([0.0, 1.0], (of.goal_x.size, LEVELS))
        * rng.uniform(-_RATE, _RATE, (of.goal_x.size, LEVELS))
        for name, of in kinds.items()
    }
    if model is not None:
        drawn = sample_model(model, rng.random((few, dimensions(model, 1))), 1)
        kinds["close_model"] = _at_speeds(kinds["close"], drawn.speed, aircraft)
        rates["close_model"] = np.repeat(drawn.climb, LEVELS, axis=1)
    patient = replace(usual, deadline_s=math.inf)
    return {
        name: compare(encounters, rates[name], policy, patient, rng)
        for name, encounters in kinds.items()
    }


def _at_speeds(encounters: Encounter, speed: np.ndarray, aircraft: Aircraft) -> Encounter:
    """Return encounters ``[N]`` of a circle with intruders of other speeds, m/s, ``[N]``, which
    pass the centre at the same time.
    """
    speed = np.minimum(speed, aircraft.traffic_speed_max)[:, None]
    own, others = encounters.own, encounters.intruders
    until = np.hypot(encounters.goal_x, encounters.goal_y) / own.speed
    back = (others.speed - speed) * until[:, None]
    moved = others._replace(
        x=others.x + back * np.cos(others.heading),
        y=others.y + back * np.sin(others.heading),
        speed=speed,
    )
    return encounters._replace(intruders=moved)


def compare(
    encounters: Encounter,
    rates: np.ndarray,
    policy: Policy,
    options: Options,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Return what the planner and the search in space solve of encounters ``[N]`` that are proven
    unresolvable in the plane; each at the same level, and at others.

    Args:
        encounters: with one intruder each.
        rates: vertical speeds of the intruders at other levels, m/s, ``[N, LEVELS]``.
        policy: for the aircraft.
        options: of the planner, without a deadline.
        rng: of the levels.
    """
    aircraft, vertical = policy.aircraft, options.vertical.separation
    verdict = classify(encounters, aircraft.rules(), aircraft.limits).verdict
    proven, lost, compared = np.flatnonzero(verdict == Verdict.UNRESOLVABLE), 0, list[Compared]()
    request = request_of(encounters, aircraft)
    above = _WITHIN * vertical * rng.uniform(-1.0, 1.0, rates.shape)
    for number in proven.tolist():
        posed = question(encounters, request, number)
        intruder = posed.states[0]
        away = math.hypot(intruder.x - posed.own.x, intruder.y - posed.own.y)
        others = zip(above[number].tolist(), rates[number].tolist(), strict=True)
        for height, rate in ((0.0, 0.0), *others):
            if away < aircraft.separation and abs(height) < vertical:
                lost += 1
            else:
                compared.append(_compare(posed, height, rate, policy, options))
    figures: dict[str, Any] = {
        "encounters": len(encounters.mask),
        "proven_unresolvable_in_the_plane": len(proven),
        "begin_without_both": lost,
    }
    for name, rows in (
        ("same_level", [row for row in compared if row.level]),
        ("other_levels", [row for row in compared if not row.level]),
        ("climbs_needed", [row for row in compared if row.climbs]),
        ("climbs_needed_with_margin", [row for row in compared if row.climbs and row.with_margin]),
    ):
        searched = [row for row in rows if row.searched]
        planned = sum(row.planned for row in searched)
        figures[name] = {
            "compared": len(rows),
            "searched": len(searched),
            "planned": sum(row.planned for row in rows),
            "planned_of_searched": planned / len(searched) if searched else None,
        }
    return figures


def _compare(
    request: Question, above: float, rate: float, policy: Policy, options: Options
) -> Compared:
    """Return what solves a request with one intruder, which is so far above, m, and climbs at a
    rate, m/s.
    """
    own, (intruder,), aircraft = request.own, request.states, policy.aircraft
    height, vertical = OWN_ALTITUDE.value, options.vertical
    motions = (
        Motion(own.x, own.y, height, own.heading, own.speed, 0.0),
        Motion(intruder.x, intruder.y, height + above, intruder.heading, intruder.speed, rate),
    )
    solutions = escapes(*motions, aircraft)
    wider = vertical._replace(separation=vertical.separation + options.vertical_margin)
    altitude = Altitude(height + above, OWN_ALTITUDE.reference, rate)
    reports = [Intruder(intruder, altitude=altitude)]
    answer = plan(own, reports, request.route, policy, options, own_altitude=OWN_ALTITUDE)
    return Compared(
        level=above == 0.0,
        searched=bool(solutions),
        climbs=bool(solutions) and all(flight.climb != 0.0 for flight in solutions),
        with_margin=bool(escapes(*motions, aircraft._replace(vertical=wider))),
        planned=answer.safe,
    )


if __name__ == "__main__":
    run_cli(main)
