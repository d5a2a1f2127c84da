"""The flights of a report, flown once more and compared with their rows: a run's files hold only
how each ended.
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from agents.config.load import ConfigError
from agents.resolvability.classify import replay
from agents.resolvability.witness import least_cost
from envs.aircraft import Aircraft
from envs.angles import wrap
from envs.encounters import Encounter
from envs.kinematics import commands
from envs.trees import take
from envs.wind import NO_WIND, Wind, through_air
from eval.flights.among_areas import in_air_mass
from eval.flights.chunks import Evaluation, ReadyEvaluation
from eval.flights.optimal import ROUNDS
from eval.flights.plan_mode import STATUSES
from eval.flights.recorded import Recorded, Track, fly_recorded
from eval.flights.simulate import ENDS
from eval.report.bands import FlightBands, flight_bands, states
from eval.report.folder import Run
from eval.runner.options import named_evaluation

_BATCH = 50
_SAME = 0.01  # smallest separations that differ by more, m, are not the same flight


class Witness(NamedTuple):
    """A flight that would have resolved the encounter."""

    path: np.ndarray  # east and north, m, every step, [2, W]
    arrival: float  # s
    separation: float  # smallest distance to any intruder, m


class Replayed(NamedTuple):
    """One flight, T steps."""

    number: int
    track: Track
    acceleration: np.ndarray  # commanded in mode policy, else the mean as flown, m/s², [T]
    yaw_rate: np.ndarray  # the same, rad/s, [T]
    matches_table: bool  # whether the flight ended as the table says
    plan: np.ndarray | None  # first plan: east, north, m, and time, s, [3, W]; None without one
    plan_status: str | None
    witness: Witness | None
    bands: FlightBands | None = None  # at T + 1 times; None where none were asked for
    wind: Wind | None = None  # whose air mass the bands are in; None: still air


def evaluation_of(run: Run, policy_path: Path | None = None) -> Evaluation:
    """Return what a run flew, its policy (perhaps moved since) and its file of encounters checked
    by their digests.
    """
    config = (
        run.config if policy_path is None else run.config.model_copy(update={"policy": policy_path})
    )
    try:
        return named_evaluation(config)[0]
    except ConfigError as problem:
        raise ConfigError(
            f"{problem}, as in the run (--policy names its policy; --tracks 0 flies nothing)"
        ) from None


def fly_again(
    run: Run,
    evaluation: Evaluation,
    numbers: Sequence[int],
    witnesses: set[int],
    banded: Collection[int] = (),
) -> Iterator[Replayed]:
    """Yield the flights of some encounters in their order, some of them with a witness: a flight
    that resolves them, and some with bands.
    """
    # One thread, as when they were flown for the table: BLAS rounds differently with several.
    with threadpool_limits(1):
        ready = ReadyEvaluation.load(evaluation)
        for begin in range(0, len(numbers), _BATCH):
            yield from _batch(run, ready, numbers[begin : begin + _BATCH], witnesses, banded)


def _batch(
    run: Run,
    ready: ReadyEvaluation,
    numbers: Sequence[int],
    requested: set[int],
    banded: Collection[int],
) -> Iterator[Replayed]:
    evaluation, batch = ready.evaluation, fly_recorded(ready, numbers)
    # A witness is one of still air, and knows no areas.
    winds = evaluation.wind(batch.starts, np.asarray(numbers))
    # Bands are those of the plane, in which who is above or below is in the way.
    if batch.starts.altitudes is not None:
        banded = ()
    still = winds is None and batch.areas is None
    witnessed = [row for row, number in enumerate(numbers) if still and number in requested]
    witnesses = _witnesses(evaluation.aircraft, batch.starts, witnessed)
    for row, number in enumerate(numbers):
        track = batch.track(row)
        if not track.separation.size:
            continue  # the planner had no trajectory
        acceleration, yaw_rate = _motion(batch, row, track, evaluation.aircraft)
        plan, status = _first_plan(batch, row)
        blows = None if winds is None else Wind(*(float(part) for part in take(winds, row)))
        yield Replayed(
            number=number,
            track=track,
            acceleration=acceleration,
            yaw_rate=yaw_rate,
            matches_table=_is_same(run, number, batch, row),
            plan=plan,
            plan_status=status,
            witness=witnesses.get(row),
            bands=bands_of(batch, row, track, evaluation, blows) if number in banded else None,
            wind=blows,
        )


def _is_same(run: Run, number: int, batch: Recorded, row: int) -> bool:
    """Return whether a flight of a batch ended as the run's table says."""
    outcome = ENDS[batch.flights.outcome[row]]
    apart = batch.flights.min_separation[row] - run.table["min_separation_m"][number]
    return outcome == run.table["outcome"][number] and bool(abs(apart) <= _SAME)


def _motion(
    batch: Recorded, row: int, track: Track, aircraft: Aircraft
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations, m/s^2, and yaw rates, rad/s, of a flight, ``[T]``: as commanded once a
    step, or the mean of what was flown along a plan.
    """
    steps = track.separation.size
    if batch.plans is None:
        return commands(batch.trajectories.action[:steps, row].T, aircraft.limits, np)
    own = states(batch.trajectories.own, steps + 1, row)
    return np.diff(own.speed) / aircraft.dt, wrap(np.diff(own.heading), np) / aircraft.dt


def _first_plan(batch: Recorded, row: int) -> tuple[np.ndarray | None, str | None]:
    """Return the plan made at the start, east, north, m, and time, s, ``[3, W]``, and its status;
    None: without a trajectory, or in mode policy.
    """
    if batch.plans is None or batch.plan_states is None:
        return None, None
    flown = take(batch.plan_states, row)
    plan = np.stack([flown.x, flown.y, flown.time])
    status = STATUSES[int(batch.plans.candidates.safe[row])]
    return plan if np.isfinite(plan).all() else None, status


def bands_of(
    batch: Recorded, row: int, track: Track, evaluation: Evaluation, wind: Wind | None
) -> FlightBands:
    """Return the bands of a flight, in the air mass."""
    count, members = track.separation.size + 1, batch.starts.mask[row]
    own = states(batch.trajectories.own, count, row)
    intruders = states(batch.trajectories.intruders, count, row)
    intruders, areas = take(intruders, (slice(None), members)), track.areas
    time, blows = np.arange(count) * evaluation.aircraft.dt, wind or NO_WIND
    own_in_air, intruders_in_air = (
        through_air(own, blows, time),
        through_air(intruders, blows, time[:, None]),
    )
    if wind is not None:
        areas = in_air_mass(areas, wind, 0.0)
    return flight_bands(own_in_air, intruders_in_air, evaluation.options, areas, track.required)


def _witnesses(aircraft: Aircraft, starts: Encounter, rows: list[int]) -> dict[int, Witness]:
    """Return flights that resolve some of the encounters, by row; none where none is known."""
    if not rows:
        return {}
    rules, limits = aircraft.rules(), aircraft.limits
    chosen = take(starts, np.array(rows))
    best = least_cost(chosen, rules, limits, rounds=ROUNDS)
    witnesses = {}
    for place in np.flatnonzero(np.isfinite(best.arrival)):
        flight = replay(take(chosen, int(place)), take(best.manoeuvre, int(place)), rules, limits)
        on = flight.time <= best.arrival[place] + 1e-9
        path = np.stack([flight.own.x[on], flight.own.y[on]])
        witnesses[rows[int(place)]] = Witness(
            path, float(best.arrival[place]), float(best.separation[place])
        )
    return witnesses
