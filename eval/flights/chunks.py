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

from agents.baselines.baselines import BASELINES, StepResolver
from agents.planner.planner import Plans
from agents.planner.request.options import Options
from agents.policy.inference import Policy
from agents.resolvability.classify import Method, Verdict
from envs.aircraft import Aircraft
from envs.areas import Area
from envs.encounters import Encounter, EncounterError, Scenario
from envs.kinematics import Limits
from envs.starts import OF_INTRUDERS, join
from envs.traffic.model_traffic import ModelTraffic
from envs.wind import Wind
from envs.world import flatness_of
from eval.flights.among_areas import areas_of, judge, together, with_breaches
from eval.flights.areas_seen import what_stands_in_each
from eval.flights.assured_mode import fly_assured
from eval.flights.compiled import Compiled
from eval.flights.conditions import Flown, conditions, verdict_within
from eval.flights.in_space import (
    at_one_level,
    check_levels,
    columns_in_space,
    conditions_in_space,
)
from eval.flights.in_wind import carry, stand, winds
from eval.flights.plan_mode import SOURCES, STATUSES, fly_once, plan_at_start, promised_separation
from eval.flights.simulate import (
    ENDS,
    OUTCOMES,
    ByPolicy,
    Flights,
    Unmitigated,
    fly,
    path_excess,
    sensor_noise,
)
from eval.flights.sources import Source, draw
from eval.flights.trajectories import TrajectoryRecorder


class Evaluation(NamedTuple):
    """All that the result of an evaluation follows from; can be sent to another process."""

    policy: Path | None  # file of the policy; None for the shipped one
    source: Source
    names: tuple[str, ...] | None  # names of the encounters of a file
    seed: int
    aircraft: Aircraft
    mode: str = "policy"  # what decides, as of eval.config.MonteCarloConfig
    # of plans in the other modes; None: as usual for the aircraft
    plan_options: Options | None = None
    baseline: str = "none"  # what decides in the policy's place, likewise
    backend: str = "numpy"  # what computes the policy's decisions, likewise
    wind_mps: tuple[float, float] = (0.0, 0.0)  # span of the wind's speed in the other modes
    areas: int = 0  # of an encounter at most
    file_areas: tuple[Area, ...] = ()  # of a file: those of every encounter

    def wind(self, starts: Encounter, numbers: np.ndarray) -> Wind | None:
        """Return the winds of encounters with these numbers, ``[M]``; None: still air.

        Raises:
            EncounterError: they have winds of their own, and others are asked for.
        """
        if starts.wind is None:
            return winds(self.wind_mps, self.seed, numbers)
        if self.wind_mps != (0.0, 0.0):
            low, high = self.wind_mps
            raise EncounterError(
                f"wind_mps is [{low:g}, {high:g}]; expected [0, 0] for encounters that have a wind "
                "of their own"
            )
        return starts.wind

    def areas_of(self, starts: Encounter, numbers: np.ndarray) -> np.ndarray | None:
        """Return the areas of encounters with these numbers, over the ground, object ``[M]``; their
        goals are over the ground. None: there are none.
        """
        drawn = areas_of(self.areas, self.seed, starts, numbers, self.aircraft)
        return together(starts.areas, drawn, self.file_areas, len(numbers))

    @property
    def heeds(self) -> tuple[str, ...]:
        """The optional fields of encounters that the mode heeds: a plan knows of no intruders that
        answer it, the policy of no wind.
        """
        if self.mode == "policy":
            return *OF_INTRUDERS, "areas", "altitudes"
        return "separation", "coverage", "wind", "areas", "altitudes"

    def in_space(self, starts: Encounter, numbers: np.ndarray) -> Encounter:
        """Return encounters with these numbers as they are flown: with everybody at one level where
        they have no altitudes and plans may climb and descend.

        Raises:
            EncounterError: they have altitudes and areas, the aircraft states no vertical
                separation, or an ownship begins beyond the floor or the ceiling.
        """
        climbs = self.mode != "policy" and self.options.climbs
        flown = at_one_level(starts) if climbs else starts
        if flown.altitudes is None:
            return flown
        flatness_of(flown, self.aircraft)
        if self.areas or self.file_areas or flown.areas is not None:
            raise EncounterError(
                "encounters with altitudes, or plans that may climb, have areas; expected none: "
                "flights are judged against areas in the plane alone"
            )
        if climbs:
            check_levels(flown, numbers, self.options)
        return flown

    @property
    def limits(self) -> Limits:
        """Within which the mode flies, and within which its encounters are judged: those of the
        decisions in mode policy, those of the vehicle where plans are followed.
        """
        return self.aircraft.limits if self.mode == "policy" else self.options.limits

    @property
    def options(self) -> Options:
        """How plans are made and flown."""
        if self.plan_options is None:
            return Options.for_aircraft(self.aircraft)
        return self.plan_options


class ReadyEvaluation:
    """An evaluation with its policy, for the evaluation's aircraft."""

    def __init__(self, evaluation: Evaluation, policy: Policy) -> None:
        self.evaluation = evaluation
        self.policy = policy.for_aircraft(evaluation.aircraft, outside="allow")

    @classmethod
    def load(cls, evaluation: Evaluation) -> "ReadyEvaluation":
        """Return the evaluation with its policy; ``PolicyFileError``: the policy file cannot be
        used.
        """
        return cls(evaluation, Policy.load(evaluation.policy))

    @cached_property
    def resolver(self) -> StepResolver:
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
    source, seed, heeds = evaluation.source, evaluation.seed, evaluation.heeds
    numbers = list(numbers)
    drawn = reduce(join, (draw(source, seed, int(n), 1, heeds=heeds)[0] for n in numbers))
    return evaluation.in_space(drawn, np.asarray(numbers))


def columns(ready: ReadyEvaluation, first: int, count: int) -> dict[str, np.ndarray]:
    """Return the table of a chunk: a row an encounter; columns:
    docs/reference/evaluation-files.md.
    """
    evaluation = ready.evaluation
    aircraft, plans = evaluation.aircraft, evaluation.mode != "policy"
    number = np.arange(first, first + count)
    starts, weights = draw(evaluation.source, evaluation.seed, first, count, heeds=evaluation.heeds)
    starts = evaluation.in_space(starts, number)
    noise = noise_of(evaluation, starts, first)
    beside = {"baseline": fly(starts, Unmitigated(aircraft), aircraft)}
    if plans:
        beside["policy"] = fly(starts, ready.resolver, aircraft, noise=noise)
        flights, more = _plan(ready, conditions_of(evaluation, starts, number, noise))
    else:
        flights, more = _decide(ready, conditions_of(evaluation, starts, number, noise))
    other = _differs_in_wind(evaluation, starts, number)
    own = Flown(evaluation.limits, _reached(flights))
    # Those that are flown beside it fly in still air.
    still = [Flown(aircraft.limits, _reached(flights_beside)) for flights_beside in beside.values()]
    flown = [own, *(flights_beside.but(other) for flights_beside in still)]
    judged = verdict_within(starts, aircraft, evaluation.limits, flown, other)
    if plans:
        of_policy = verdict_within(starts, aircraft, aircraft.limits, [own.but(other), *still])
        more["policy_verdict"] = _names(Verdict)[of_policy.verdict]
    begun = conditions(starts, aircraft)
    if starts.altitudes is not None:
        begun |= conditions_in_space(starts, aircraft)
    names = evaluation.names or ()
    return {
        "encounter": number,
        "name": np.array([names[i] if names else None for i in number], dtype=object),
        "weight": weights,
        **_flight_columns(flights, begun["route_length_m"], aircraft),
        "verdict": _names(Verdict)[judged.verdict],
        "verdict_method": _names(Method)[judged.method],
        **_beside(beside),
        **more,
        **begun,
    }


def _differs_in_wind(evaluation: Evaluation, starts: Encounter, numbers: np.ndarray) -> np.ndarray:
    """Return which encounters are another conflict in their wind than in still air, bool ``[N]``:
    those with a wind of their own, whose goals are over the ground, and those with traffic that
    stands on the ground.
    """
    if evaluation.wind(starts, numbers) is None:
        return np.zeros(len(numbers), dtype=bool)
    stands = (starts.mask & (starts.intruders.speed == 0.0)).any(axis=-1)
    return stands | (starts.wind is not None)


def _reached(flights: Flights) -> np.ndarray:
    """Return which flights reached their goal, bool ``[N]``."""
    return flights.outcome == OUTCOMES.index("reached")


def _flight_columns(
    flights: Flights, route_length: np.ndarray, aircraft: Aircraft
) -> dict[str, np.ndarray]:
    """Return the columns of the flights that are judged, of routes of such lengths, m, ``[N]``."""
    # What is left of the straight line to the goal at the end counts as flown straight.
    excess = path_excess(flights, route_length, aircraft)
    return {
        "outcome": np.array(ENDS, dtype=object)[flights.outcome],
        "score": flights.score,
        "duration_s": flights.duration,
        "min_separation_m": flights.min_separation,
        "time_of_min_separation_s": flights.time_of_min_separation,
        "path_length_m": flights.path_length,
        "path_excess": np.where(_reached(flights), excess, np.nan),
        "goal_distance_m": flights.goal_distance,
        "heading_reversals": flights.reversals,
    }


class Conditioned(NamedTuple):
    """Encounters ``[N]`` in the wind and among the areas in which they are flown."""

    starts: Encounter  # in the air mass, the goals over the ground
    # of the sensors by step, [4, N, K]; None: perfect knowledge
    noise: Callable[[int], np.ndarray] | None
    wind: Wind | None = None
    areas: np.ndarray | None = None  # over the ground, object [N]

    def recorder(self) -> TrajectoryRecorder | None:
        """Return what records flights that must be judged against areas, or are in space."""
        plain = self.areas is None and self.starts.altitudes is None
        return None if plain else TrajectoryRecorder(self.starts)


def conditions_of(
    evaluation: Evaluation,
    starts: Encounter,
    numbers: np.ndarray,
    noise: Callable[[int], np.ndarray] | None,
) -> Conditioned:
    """Return encounters ``[N]`` by their numbers in the evaluation's wind, among its areas."""
    wind = evaluation.wind(starts, numbers)
    # One that has a wind of its own states its goal over the ground.
    carried = stand(starts if starts.wind is not None else carry(starts, wind), wind)
    return Conditioned(carried, noise, wind, evaluation.areas_of(carried, numbers))


def fly_resolver(
    ready: ReadyEvaluation,
    conditions: Conditioned,
    recorder: TrajectoryRecorder | None,
    *,
    endless: bool = False,
) -> Flights:
    """Return the flights ``[N]`` of what decides once a time step, not judged against the areas.

    A recorder takes the trajectories; endless flights lose nothing.
    """
    aircraft, areas = ready.evaluation.aircraft, conditions.areas
    return fly(
        conditions.starts,
        ready.resolver,
        aircraft,
        noise=conditions.noise,
        recorder=recorder,
        endless=endless,
        standing=None if areas is None else what_stands_in_each(areas, aircraft),
    )


def _decide(
    ready: ReadyEvaluation, conditions: Conditioned
) -> tuple[Flights, dict[str, np.ndarray]]:
    """Return the flights of mode policy, and the columns of areas or of altitudes."""
    recorder = conditions.recorder()
    flights = fly_resolver(ready, conditions, recorder)
    return _judge_recorded(flights, recorder, conditions, ready.evaluation.aircraft)


def _plan(ready: ReadyEvaluation, conditions: Conditioned) -> tuple[Flights, dict[str, np.ndarray]]:
    """Return the flights of a mode that plans, and the columns that only it has."""
    evaluation, (starts, noise, wind, areas) = ready.evaluation, conditions
    options, aircraft = evaluation.options, evaluation.aircraft
    first = None if noise is None else noise(0)
    plans = plan_at_start(starts, ready.policy, aircraft, options, first, wind=wind, areas=areas)
    recorder = conditions.recorder()
    flown = fly_once(starts, plans, aircraft, options, recorder, wind=wind)
    flights, among = _judge_recorded(flown.flights, recorder, conditions, aircraft)
    more = _plan_columns(plans)
    more |= _broken_promises(starts, plans, flights, evaluation, first)
    more |= {
        "whole_min_separation_m": flown.whole_separation,
        "follower_error_m": flown.error,
    }
    if wind is not None:
        more |= {"wind_east_m_s": wind.east, "wind_north_m_s": wind.north}
    if evaluation.mode == "plan":
        return flights, more | among
    beside = _beside({"plan": flights})
    del beside["plan_min_separation_m"]  # the validated one stands there
    recorder = conditions.recorder()
    assured = fly_assured(
        starts,
        plans,
        ready.policy,
        aircraft,
        options,
        noise=noise,
        recorder=recorder,
        wind=wind,
        areas=areas,
    )
    more |= beside | {"replans": assured.replans, "backup_s": assured.backup}
    flights, among = _judge_recorded(assured.flown.flights, recorder, conditions, aircraft)
    return flights, more | among


def _plan_columns(plans: Plans) -> dict[str, np.ndarray]:
    """Return the columns of plans as they were made."""
    candidates = plans.candidates
    return {
        "plan_status": np.array(STATUSES, dtype=object)[candidates.safe.astype(int)],
        "plan_source": np.array(SOURCES, dtype=object)[plans.source],
        "plan_min_separation_m": candidates.min_separation,
        "plan_rejoin_s": candidates.rejoin_time,
        "plan_path_m": candidates.path,
        "plan_cost_m": np.where(np.isfinite(candidates.cost), candidates.cost, np.nan),
        "plan_goal": candidates.goal.astype(np.int32),
    }


def _broken_promises(
    starts: Encounter,
    plans: Plans,
    flights: Flights,
    evaluation: Evaluation,
    first: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Return the columns that tell whether SAFE plans that lost the separation had promised it;
    ``first``: draws of the first reports, ``[4, N, K]``.
    """
    aircraft = evaluation.aircraft
    lost = plans.candidates.safe & (flights.outcome == OUTCOMES.index("violation"))
    promised = promised_separation(starts, plans, aircraft, evaluation.options, lost, first)
    loss = np.full(lost.size, None, dtype=object)
    loss[lost] = np.where(promised[lost] >= aircraft.separation, "not_promised", "broken")
    return {"plan_loss": loss, "promised_min_separation_m": promised}


def _judge_recorded(
    flights: Flights,
    recorder: TrajectoryRecorder | None,
    conditions: Conditioned,
    aircraft: Aircraft,
) -> tuple[Flights, dict[str, np.ndarray]]:
    """Return flights with their breaches of areas, and the columns that tell of areas or of
    altitudes.
    """
    if recorder is None:
        return flights, {}
    if conditions.areas is None:
        return flights, columns_in_space(conditions.starts, recorder.stack(), aircraft)
    among = judge(recorder.stack(), conditions.areas, conditions.wind, aircraft.dt)
    return with_breaches(flights, among, aircraft.rules()), {
        "areas": np.array([len(areas) for areas in conditions.areas], dtype=np.int32),
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
    elif isinstance(source, ModelTraffic):
        flawed = source.flawed
    else:
        flawed = isinstance(source, Encounter) and any(np.any(field) for field in source.sensor)
    return sensor_noise(evaluation.seed, first, *starts.mask.shape) if flawed else None
