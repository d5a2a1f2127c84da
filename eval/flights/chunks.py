"""One chunk of an evaluation: draw the encounters, fly them with and without the resolver, judge,
tabulate.

What a chunk yields depends on the evaluation and on the encounters' numbers only, not on the size
of the chunk, on the process that works on it or on what it has worked on before.
"""

from collections.abc import Callable, Iterable
from enum import IntEnum
from functools import cached_property, reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.baselines.baselines import BASELINES, Baseline
from agents.planner.options import Options
from agents.policy.inference import Policy
from agents.resolvability.classify import Method, Verdict
from envs.aircraft import Aircraft
from envs.encounters import Encounter, Scenario
from envs.starts import EVERY_FIELD, join
from envs.wind import Wind
from eval.flights.among_areas import areas_of, judge, with_breaches
from eval.flights.assured_mode import fly_assured
from eval.flights.compiled import Compiled
from eval.flights.conditions import conditions, verdicts
from eval.flights.in_wind import carry, to_ground, winds
from eval.flights.plan_mode import SOURCES, STATUSES, fly_once, plan_at_start, promised_separation
from eval.flights.simulate import ENDS, OUTCOMES, ByPolicy, Direct, Flights, fly, sensor_noise
from eval.flights.sources import Source, draw
from eval.flights.trajectories import TrajectoryRecorder


class Evaluation(NamedTuple):
    """All that the result of an evaluation follows from; can be sent to another process."""

    policy: Path | None  # file of the policy; None for the shipped one
    source: Source
    names: tuple[str, ...] | None  # names of the encounters of a file
    seed: int
    aircraft: Aircraft
    mode: str = "policy"  # what decides, as of eval.config.MonteCarloConfig, and so the last two
    given: Options | None = (
        None  # how plans are made and flown in the other modes; None: as usual for the aircraft
    )
    baseline: str = "none"
    backend: str = "numpy"
    wind_mps: tuple[float, float] = (0.0, 0.0)  # span of the wind's speed in the other modes
    areas: int = 0  # of an encounter at most, in the other modes

    def wind(self, numbers: np.ndarray) -> Wind | None:
        """Return the winds of encounters with these numbers, ``[M]``; None: still air."""
        return winds(self.wind_mps, self.seed, numbers)

    def areas_of(self, starts: Encounter, numbers: np.ndarray) -> np.ndarray | None:
        """Return the areas of encounters with these numbers, over the ground, object ``[M]``; their
        goals are over the ground. None: there are none.
        """
        return areas_of(self.areas, self.seed, starts, numbers, self.aircraft)

    @property
    def heeds(self) -> tuple[str, ...]:
        """The optional fields of encounters that the mode heeds: a plan knows neither of reports
        that are missing nor of intruders that answer it.
        """
        return EVERY_FIELD if self.mode == "policy" else ("separation",)

    @property
    def options(self) -> Options:
        """How plans are made and flown."""
        return Options.for_aircraft(self.aircraft) if self.given is None else self.given


class Pilot:
    """An evaluation with its policy, for the evaluation's aircraft."""

    def __init__(self, evaluation: Evaluation, policy: Policy) -> None:
        self.evaluation, self.policy = (
            evaluation,
            policy.for_aircraft(evaluation.aircraft, outside="allow"),
        )

    @classmethod
    def load(cls, evaluation: Evaluation) -> "Pilot":
        """Return the evaluation with its policy; ``PolicyFileError``: the policy file cannot be
        used.
        """
        return cls(evaluation, Policy.load(evaluation.policy))

    @cached_property
    def resolver(self) -> Baseline:
        """What decides once a time step in mode policy."""
        if self.evaluation.backend == "jax":
            return Compiled(self.policy)
        if self.evaluation.baseline == "none":
            return ByPolicy(self.policy)
        return BASELINES[self.evaluation.baseline](self.evaluation.aircraft)


def pick(evaluation: Evaluation, numbers: Iterable[int]) -> Encounter:
    """Return the encounters with these numbers, at least one, ``[M]``; raises as
    :func:`eval.flights.sources.draw`.
    """
    each = (
        draw(evaluation.source, evaluation.seed, int(number), 1, heeds=evaluation.heeds)[0]
        for number in numbers
    )
    return reduce(join, each)


def columns(pilot: Pilot, first: int, count: int) -> dict[str, np.ndarray]:
    """Return the table of a chunk: a row an encounter; columns:
    docs/reference/evaluation-files.md.
    """
    evaluation = pilot.evaluation
    aircraft = evaluation.aircraft
    starts, weights = draw(evaluation.source, evaluation.seed, first, count, heeds=evaluation.heeds)
    begun = conditions(starts, aircraft)
    noise = noise_of(evaluation, starts, first)
    alone = fly(starts, pilot.resolver, aircraft, noise=noise)
    bare = fly(starts, Direct(aircraft), aircraft)
    beside = (
        {"baseline": bare} if evaluation.mode == "policy" else {"baseline": bare, "policy": alone}
    )
    number = np.arange(first, first + count)
    wind = evaluation.wind(number)
    flown, more = alone, {}
    if evaluation.mode != "policy":
        carried = carry(starts, wind)
        flown, more = _plan(pilot, carried, noise, wind, evaluation.areas_of(carried, number))
    reached = flown.outcome == OUTCOMES.index("reached")
    solved = reduce(
        np.logical_or,
        (other.outcome == OUTCOMES.index("reached") for other in beside.values()),
        reached,
    )
    judged = verdicts(starts, aircraft, solved=solved)

    # The route is the straight line to the goal: what is left of it at the end counts as flown
    # straight.
    route = np.maximum(begun["route_length_m"], 1.0)  # a start on the goal has none
    excess = np.maximum((flown.path_length + flown.goal_distance) / route - 1.0, 0.0)
    names = evaluation.names or ()
    return {
        "encounter": number,
        "name": np.array([names[i] if names else None for i in number], dtype=object),
        "weight": weights,
        "outcome": np.array(ENDS, dtype=object)[flown.outcome],
        "score": flown.score,
        "duration_s": flown.duration,
        "min_separation_m": flown.min_separation,
        "time_of_min_separation_s": flown.time_of_min_separation,
        "path_length_m": flown.path_length,
        "path_excess": np.where(reached, excess, np.nan),
        "goal_distance_m": flown.goal_distance,
        "heading_reversals": flown.reversals,
        "verdict": _names(Verdict)[judged.verdict],
        "verdict_method": _names(Method)[judged.method],
        **_beside(beside),
        **more,
        **begun,
    }


def _plan(
    pilot: Pilot,
    starts: Encounter,
    noise: Callable[[int], np.ndarray] | None,
    wind: Wind | None,
    areas: np.ndarray | None,
) -> tuple[Flights, dict[str, np.ndarray]]:
    """Return the flights of a mode that plans, and the columns that only it has."""
    evaluation = pilot.evaluation
    options, aircraft = evaluation.options, evaluation.aircraft
    first = None if noise is None else noise(0)
    plans = plan_at_start(starts, pilot.policy, aircraft, options, first, wind=wind, areas=areas)
    recorder = None if areas is None else TrajectoryRecorder(starts)
    flown = fly_once(starts, plans, aircraft, options, recorder, wind=wind)
    flights, among = _judge_areas(flown.flights, recorder, areas, wind, aircraft)
    made = plans.proposals
    lost = made.safe & (flights.outcome == OUTCOMES.index("violation"))
    promised = promised_separation(starts, plans, aircraft, options, lost, first)
    loss = np.full(lost.size, None, dtype=object)
    loss[lost] = np.where(promised[lost] >= aircraft.separation, "not_promised", "broken")
    more = {
        "plan_status": np.array(STATUSES, dtype=object)[made.safe.astype(int)],
        "plan_source": np.array(SOURCES, dtype=object)[plans.source],
        "plan_min_separation_m": made.min_separation,
        "plan_rejoin_s": made.rejoin_time,
        "plan_path_m": made.path,
        "plan_cost_m": np.where(np.isfinite(made.cost), made.cost, np.nan),
        "plan_goal": made.goal.astype(np.int32),
        "plan_loss": loss,
        "promised_min_separation_m": promised,
        "whole_min_separation_m": flown.whole_separation,
        "follower_error_m": flown.error,
    }
    if wind is not None:
        more |= {"wind_east_m_s": wind.east, "wind_north_m_s": wind.north}
    if evaluation.mode == "plan":
        return flights, more | among
    recorder = None if areas is None else TrajectoryRecorder(starts)
    assured = fly_assured(
        starts,
        plans,
        pilot.policy,
        aircraft,
        options,
        noise=noise,
        recorder=recorder,
        wind=wind,
        areas=areas,
    )
    more |= _beside({"plan": flights}) | {"plan_min_separation_m": made.min_separation}
    more |= {"replans": assured.replans, "backup_s": assured.backup}
    flights, among = _judge_areas(assured.flown.flights, recorder, areas, wind, aircraft)
    return flights, more | among


def _judge_areas(
    flights: Flights,
    recorder: TrajectoryRecorder | None,
    areas: np.ndarray | None,
    wind: Wind | None,
    aircraft: Aircraft,
) -> tuple[Flights, dict[str, np.ndarray]]:
    """Return flights with their breaches of areas, and the columns that tell of areas."""
    if recorder is None or areas is None:
        return flights, {}
    among = judge(to_ground(recorder.stack(), wind, aircraft.dt), areas, aircraft.dt)
    return with_breaches(flights, among, aircraft.rules()), {
        "areas": np.array([len(some) for some in areas], dtype=np.int32),
        "min_area_clearance_m": np.where(np.isfinite(among.distance), among.distance, np.nan),
        "area_breach_s": among.breach,
    }


def _beside(flights: dict[str, Flights]) -> dict[str, np.ndarray]:
    columns = {}
    for name, flown in flights.items():
        columns[f"{name}_outcome"] = np.array(ENDS, dtype=object)[flown.outcome]
        columns[f"{name}_duration_s"] = flown.duration
        columns[f"{name}_min_separation_m"] = flown.min_separation
    return columns


def _names(kinds: type[IntEnum]) -> np.ndarray:
    return np.array([kinds(code).name.lower() for code in range(len(kinds))], dtype=object)


def noise_of(
    evaluation: Evaluation, starts: Encounter, first: int
) -> Callable[[int], np.ndarray] | None:
    """Return the sensors' noise, None if no sensor has noise or latency.

    The whole source decides, not the chunk: even a perfect report is rounded, so it must be used
    everywhere or nowhere.
    """
    source = evaluation.source
    if isinstance(source, Scenario):
        flawed = source.position_std > 0.0 or source.velocity_std > 0.0 or source.latency[1] > 0.0
    else:
        flawed = isinstance(source, Encounter) and any(np.any(field) for field in source.sensor)
    return sensor_noise(evaluation.seed, first, *starts.mask.shape) if flawed else None
