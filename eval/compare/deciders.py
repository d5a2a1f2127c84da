"""Several deciders on the same encounters, and the table of their flights."""

from collections.abc import Callable, Sequence
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.baselines.acas_nnet import load_logic
from agents.baselines.baselines import BASELINES, Baseline, Sight
from agents.policy.inference import Policy
from agents.resolvability.classify import Verdict
from envs.aircraft import Aircraft
from envs.encounters import Encounter
from eval.config import Setting, usual_setting
from eval.flights.chunks import Evaluation, Pilot, noise_of
from eval.flights.conditions import verdicts
from eval.flights.optimal import WitnessSearch, fly_witnesses
from eval.flights.recorded import fly_in_mode
from eval.flights.simulate import OUTCOMES, ByPolicy, Flights, fly
from eval.flights.sources import drawn
from eval.flights.trajectories import Trajectories, TrajectoryRecorder, until
from eval.metrics.volumes import VOLUMES, costs, losses, relative, severity

__all__ = ["REFERENCE", "WITNESS", "Comparison", "Entry", "Plans", "baseline_entry", "columns", "policy_entries"]

REFERENCE = "none"  # the flight without a resolver, which is always flown: risk ratios need it
WITNESS = "witness"  # name and kind of the entry that flies the least-cost witness: a mark, not a resolver
_SEVERE = "do365_en_route"


class Plans(NamedTuple):
    """A policy that decides by plans: once at the start, or in the assured loop."""

    policy: Policy
    setting: Setting
    mode: str  # plan or assured


class Entry(NamedTuple):
    """One that takes part."""

    name: str
    kind: str  # policy, baseline, nnet or witness
    decider: Baseline | Plans | WitnessSearch
    sha256: str | None = None  # of a policy file


class Comparison(NamedTuple):
    """All that the result of a comparison follows from."""

    entries: tuple[Entry, ...]
    evaluation: Evaluation  # source, seed and aircraft; nothing else of it counts


def policy_entries(path: Path | None, name: str, aircraft: Aircraft, modes: Sequence[str] = ()) -> tuple[Entry, ...]:
    """Return the entries of a policy file: as it is, and with the speed held, as most published resolvers hold it.

    It is flown besides in the modes plan and assured, where they are named. A ``.nnet`` file is a logic that holds the
    speed anyway, and of which no plans are made. Without a path it is the policy that ships.

    Raises:
        PolicyFileError, NnetError: the file cannot be used.
    """
    if path is not None and path.suffix == ".nnet":
        logic = load_logic(path, aircraft)
        return (Entry(name, "nnet", logic),)
    policy = Policy.load(path)
    setting = usual_setting(aircraft)
    return (
        Entry(name, "policy", ByPolicy(policy), policy.sha256),
        Entry(f"{name}, speed held", "policy", _SpeedHeld(policy), policy.sha256),
        *(Entry(f"{name}, {mode}", "policy", Plans(policy, setting, mode), policy.sha256) for mode in modes),
    )


def baseline_entry(name: str, aircraft: Aircraft) -> Entry:
    """Return the entry of a baseline, one of :data:`agents.baselines.BASELINES`, or of the witness."""
    if name == WITNESS:
        return Entry(name, WITNESS, WitnessSearch())
    made = BASELINES[name](aircraft)
    return Entry(name, "baseline", made)


def columns(comparison: Comparison, first: int, count: int) -> dict[str, np.ndarray]:
    """Return the table of the encounters ``first .. first + count - 1``: columns of each entry, ``NAME.COLUMN``.

    Flights go on after a loss of separation, to the goal or the time limit, because smaller volumes are judged too.
    What counts as a violation is the same as in :mod:`eval.flights.simulate`: any loss before the end.
    """
    evaluation = comparison.evaluation
    aircraft, rules = evaluation.aircraft, evaluation.rules
    starts, weights = drawn(evaluation.source, evaluation.seed, first, count)
    noise = noise_of(evaluation, starts, first)
    table: dict[str, np.ndarray] = {"encounter": np.arange(first, first + count), "weight": weights}
    solved = []
    for entry in comparison.entries:
        own_noise = None if entry.name == REFERENCE else noise
        flights, flown = _flown(entry.decider, starts, evaluation, own_noise)
        outcome = np.where(flights.min_separation < rules.separation, OUTCOMES.index("violation"), flights.outcome)
        solved.append(outcome == OUTCOMES.index("reached"))
        made = _columns(outcome, flights, flown, starts.mask) | costs(starts, flights, flown)
        table |= {f"{entry.name}.{name}": values for name, values in made.items()}
    route = np.hypot(starts.goal_x - starts.own.x, starts.goal_y - starts.own.y)
    table["late_at_first_speed"] = route - rules.goal_radius > starts.own.speed * rules.t_max
    judged = verdicts(starts, aircraft, solved=reduce(np.logical_or, solved))
    table["unresolvable"] = judged.verdict == Verdict.UNRESOLVABLE
    return table


def _flown(
    decider: Baseline | Plans | WitnessSearch,
    starts: Encounter,
    evaluation: Evaluation,
    noise: Callable[[int], np.ndarray] | None,
) -> tuple[Flights, Trajectories]:
    """Fly encounters on after losses of separation; the trajectories end where each flight does."""
    if isinstance(decider, WitnessSearch):
        return fly_witnesses(starts, decider, evaluation.aircraft)
    recorder = TrajectoryRecorder(starts)
    if not isinstance(decider, Plans):
        flights = fly(starts, decider, evaluation.aircraft, noise=noise, recorder=recorder, endless=True)
        return flights, recorder.stack()
    policy, setting, mode = decider
    pilot = Pilot(evaluation._replace(given=setting, mode=mode), policy)
    _, flights = fly_in_mode(pilot, starts, noise, recorder, endless=True)
    return flights, until(recorder.stack(), flights.duration, evaluation.aircraft.dt)


class _SpeedHeld(ByPolicy):
    """A policy of which only the turns are flown."""

    def decide(self, sight: Sight, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        actions, memory = super().decide(sight, memory)
        return actions * np.array([0.0, 1.0]), memory


def _columns(outcome: np.ndarray, flights: Flights, flown: Trajectories, mask: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of one entry but for the costs."""
    seen = relative(flown)
    # After the end of a flight everything is nan; no number there, no loss.
    with np.errstate(invalid="ignore"):
        penetration = np.where(np.isfinite(seen.x) & mask, severity(VOLUMES[_SEVERE], seen), 0.0)
    return {
        "outcome": np.array(OUTCOMES, dtype=object)[outcome],
        "min_separation_m": flights.min_separation,
        "duration_s": flights.duration,
        "heading_reversals": flights.reversals,
        "severity": penetration.max(axis=(0, 2)),
        **{f"lost_{name}": losses(each, flown, mask) for name, each in VOLUMES.items()},
    }
