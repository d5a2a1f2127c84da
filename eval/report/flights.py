"""The flights of a report, flown once more and compared with their rows: a run's files hold only
how each ended.
"""

from collections.abc import Collection, Iterator, Sequence
from typing import Any, NamedTuple

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
from eval.flights.chunks import Evaluation, Pilot
from eval.flights.optimal import ROUNDS
from eval.flights.plan_mode import STATUSES
from eval.flights.recorded import Track, fly_recorded
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
    same: bool  # whether the flight ended as the table says
    plan: np.ndarray | None  # first plan: east, north, m, and time, s, [3, W]; None without one
    plan_status: str | None
    witness: Witness | None
    bands: FlightBands | None = None  # at T + 1 times; None where none were asked for


def evaluation_of(run: Run, policy_path: Any = None) -> Evaluation:
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
        pilot = Pilot.load(evaluation)
        for begin in range(0, len(numbers), _BATCH):
            yield from _batch(run, pilot, numbers[begin : begin + _BATCH], witnesses, banded)


def _batch(
    run: Run, pilot: Pilot, numbers: Sequence[int], wanted: set[int], banded: Collection[int]
) -> Iterator[Replayed]:
    aircraft, batch = pilot.evaluation.aircraft, fly_recorded(pilot, numbers)
    starts, plans, flights, flown, _ = batch
    # A witness is one of still air, and knows no areas.
    still = pilot.evaluation.wind_mps == (0.0, 0.0) and not pilot.evaluation.areas
    witnessed = [i for i, number in enumerate(numbers) if still and number in wanted]
    found = _witnesses(aircraft, starts, witnessed)
    for i, number in enumerate(numbers):
        track = batch.track(i)
        if not track.separation.size:
            continue  # the planner had no trajectory
        said, closest = run.table["outcome"][number], run.table["min_separation_m"][number]
        same = (
            ENDS[flights.outcome[i]] == said and abs(flights.min_separation[i] - closest) <= _SAME
        )
        plan, status = None, None
        if plans is None:
            acceleration, yaw_rate = commands(
                flown.action[: track.separation.size, i].T, aircraft.limits, np
            )
        else:
            dt, made = aircraft.dt, plans.proposals
            own = take(flown.own, (slice(0, track.separation.size + 1), i))
            acceleration, yaw_rate = np.diff(own.speed) / dt, wrap(np.diff(own.heading), np) / dt
            status = STATUSES[int(made.safe[i])]
            plan_states = np.stack(
                [made.plan_states.x[i], made.plan_states.y[i], made.plan_states.time[i]]
            )
            plan = plan_states if np.isfinite(plan_states).all() else None
        bands = None
        if number in banded:
            whole, count = batch.trajectories, track.separation.size + 1
            members = starts.mask[i]
            intruders = take(states(whole.intruders, count, i), (slice(None), members))
            bands = flight_bands(
                states(whole.own, count, i), intruders, pilot.evaluation.options, track.areas
            )
        yield Replayed(
            number, track, acceleration, yaw_rate, bool(same), plan, status, found.get(i), bands
        )


def _witnesses(aircraft: Aircraft, starts: Encounter, rows: list[int]) -> dict[int, Witness]:
    """Return flights that resolve some of the encounters, by row; none where none is known."""
    if not rows:
        return {}
    rules, limits = aircraft.rules(), aircraft.limits
    chosen = take(starts, np.array(rows))
    best = least_cost(chosen, rules, limits, rounds=ROUNDS)
    found = {}
    for place in np.flatnonzero(np.isfinite(best.arrival)):
        flight = replay(take(chosen, int(place)), take(best.manoeuvre, int(place)), rules, limits)
        on = flight.time <= best.arrival[place] + 1e-9
        path = np.stack([flight.own.x[on], flight.own.y[on]])
        found[rows[int(place)]] = Witness(
            path, float(best.arrival[place]), float(best.separation[place])
        )
    return found
