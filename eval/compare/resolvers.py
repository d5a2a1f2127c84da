"""Several resolvers on the same encounters, and the table of their flights."""

from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.baselines.acas_nnet import load_logic
from agents.baselines.baselines import BASELINES, StepResolver
from agents.config.load import ConfigError
from agents.planner.request.options import Options
from agents.policy.inference import Policy
from agents.resolvability.classify import Verdict
from commands.extension import is_extension, load_extension
from commands.names import one_of
from envs.aircraft import PAPER, Aircraft
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import Limits
from eval.flights.chunks import Conditioned, Evaluation, ReadyEvaluation, noise_of
from eval.flights.conditions import Flown, verdict_within
from eval.flights.in_space import altitude_deviation
from eval.flights.optimal import WitnessSearch, fly_witnesses
from eval.flights.recorded import fly_in_mode
from eval.flights.reported import report_flights
from eval.flights.simulate import OUTCOMES, ByPolicy, Flights, fly
from eval.flights.sources import draw
from eval.flights.trajectories import Trajectories, TrajectoryRecorder, until
from eval.metrics.alerting import first_alert
from eval.metrics.volumes import VOLUMES, costs, first_loss, losses, relative, severity
from eval.runner.options import check_digest

REFERENCE = "none"  # the flight without a resolver, which is always flown: risk ratios need it
# name and kind of the entry that flies the least-cost witness: a mark, not a resolver
WITNESS = "witness"
BASELINE = "baseline"  # kind of the others that are no policies
_NAMES = (*BASELINES, WITNESS)


class Plans(NamedTuple):
    """A policy that decides by plans: once at the start, or in the assured loop."""

    policy: Policy
    mode: str  # plan or assured
    options: Options  # of its plans


Resolver = StepResolver | Plans | WitnessSearch


class Entry(NamedTuple):
    """A participant of the comparison."""

    name: str
    kind: str  # policy, baseline, nnet or witness
    resolver: Resolver
    sha256: str | None = None  # of a policy file


class Comparison(NamedTuple):
    """All that the result of a comparison follows from."""

    entries: tuple[Entry, ...]
    evaluation: Evaluation  # source, seed and aircraft; nothing else of it counts
    well_clear: str | None = None  # name of the volume of alerts; None: no alerts are judged

    def starts(self, first: int, count: int) -> tuple[Encounter, np.ndarray]:
        """Return encounters from the first on, so many, and their weights.

        Raises:
            EncounterError: they cannot be drawn, or not be flown.
        """
        evaluation = self.evaluation
        source, seed = evaluation.source, evaluation.seed
        starts, weights = draw(source, seed, first, count, heeds=("altitudes", "coverage"))
        numbers = np.arange(first, first + count)
        starts = evaluation.in_space(starts, numbers)
        for entry in self.entries:
            if isinstance(entry.resolver, Plans):
                planned = evaluation._replace(mode="plan", plan_options=entry.resolver.options)
                starts = planned.in_space(starts, numbers)
        return starts, weights


class Modes(NamedTuple):
    """In which modes policies are flown too, each with every kind of plans."""

    names: tuple[str, ...] = ()
    options: Mapping[str, Options] = {}  # of plans, by what an entry's name says of them

    def resolvers(self, name: str, policy: Policy) -> dict[str, Plans]:
        """Return those of a policy, by name."""
        return {
            ", ".join(filter(None, (name, mode, kind))): Plans(policy, mode, options)
            for mode in self.names
            for kind, options in self.options.items()
        }


def policy_entries(
    path: Path | None, name: str, aircraft: Aircraft, modes: Modes | None = None
) -> tuple[Entry, ...]:
    """Return the entries of a policy file (None: the one that ships): as it is, and in the modes.

    A ``.nnet`` file is a logic of which no plans are made.
    """
    if path is not None and path.suffix == ".nnet":
        return (Entry(name, "nnet", load_logic(path, aircraft)),)
    policy = Policy.load(path).for_aircraft(aircraft)
    resolvers = {name: ByPolicy(policy), **(modes or Modes()).resolvers(name, policy)}
    return tuple(
        Entry(title, "policy", resolver, policy.sha256) for title, resolver in resolvers.items()
    )


def baseline_entry(name: str, aircraft: Aircraft) -> Entry:
    """Return the entry of a baseline, one of :data:`agents.baselines.BASELINES`, of the witness, or
    of the user's own, ``module:name``, which is imported.

    Raises:
        InputError: there is none of that name, or it cannot be used.
    """
    if name == WITNESS:
        return Entry(name, WITNESS, WitnessSearch())
    if is_extension(name):
        make = load_extension(name, "a function of an aircraft that returns a baseline")
        short = name.partition(":")[2]
        if short in _NAMES:
            raise ConfigError(f"--baseline: {name!r} is called {short}; expected another name")
        return Entry(short, BASELINE, make(aircraft))
    return Entry(name, BASELINE, BASELINES[name](aircraft))


def entries_of(
    policies: Sequence[Path], modes: Modes, baselines: Sequence[str], aircraft: Aircraft
) -> tuple[Entry, ...]:
    """Return the entries: the policies, the baselines, and always the flight without a resolver."""
    entries: list[Entry] = []
    for path, name in zip(policies or [None], policy_names(policies) or ["policy"], strict=True):
        entries += policy_entries(path, name, aircraft, modes)
    for name in baselines_of(baselines):
        if name not in _NAMES and not is_extension(name):
            known = one_of(name, _NAMES, "module:name of your own")
            raise ConfigError(f"--baseline: {name!r}; {known}")
        entry = baseline_entry(name, aircraft)
        if entry.name in {other.name for other in entries}:
            raise ConfigError(
                f"--baseline: {name!r} is called {entry.name}, as another resolver is; expected "
                "another name"
            )
        entries.append(entry)
    return tuple(entries)


def baselines_of(chosen: Sequence[str]) -> tuple[str, ...]:
    """Return the baselines that are flown of those chosen (none: all), the flight without a
    resolver always among them.
    """
    return tuple(dict.fromkeys([*(chosen or BASELINES), REFERENCE]))


def policy_names(paths: Sequence[Path]) -> list[str]:
    """Return a short name for each policy file, all of them different."""
    # A stem may be that of another file or the name of a baseline: then the whole path names the
    # policy.
    stems = [path.stem for path in paths]
    here = Path.cwd()
    names = [
        str(path.relative_to(here) if path.is_relative_to(here) else path)
        if stems.count(path.stem) > 1 or path.stem in _NAMES
        else path.stem
        for path in paths
    ]
    if len(set(names)) < len(names):
        raise ConfigError("--policy: a file stands twice; expected different ones")
    return names


def aircraft_of_all(
    policies: Sequence[Path], digests: Sequence[str], aircraft: Aircraft | None = None
) -> Aircraft:
    """Return the aircraft that is given, None: the one that the policies were trained for, on which
    they must agree.

    The digests, SHA-256, are those of each policy but the ``.nnet`` files, or none.
    """
    files = [path for path in policies or [None] if path is None or path.suffix != ".nnet"]
    if digests and len(digests) != len(files):
        count = len(files)
        raise ConfigError(
            f"--policy-sha256: given {len(digests)} times; expected once for each of {count} "
            "policies"
        )
    first = None
    for path, digest in zip_longest(files, digests):
        policy = Policy.load(path)
        check_digest(path, policy.sha256, digest, "--policy-sha256")
        first = first or policy.aircraft
        if aircraft is None and policy.aircraft != first:
            trained = f"{path} was trained for {policy.aircraft}, {files[0]} for {first}"
            raise ConfigError(f"--policy: {trained}; expected policies of the same aircraft")
    return aircraft or first or PAPER


def columns(comparison: Comparison, first: int, count: int) -> dict[str, np.ndarray]:
    """Return the table of the encounters ``first .. first + count - 1``: columns of each entry,
    ``NAME.COLUMN``.

    Flights go on after a loss of separation, because smaller volumes are judged too; any loss is a
    violation.
    """
    evaluation = comparison.evaluation
    aircraft = evaluation.aircraft
    starts, weights = comparison.starts(first, count)
    noise = noise_of(evaluation, starts, first)
    table: dict[str, np.ndarray] = {"encounter": np.arange(first, first + count), "weight": weights}
    flown_within = []
    for entry in comparison.entries:
        flights, flown = _fly_on(
            entry.resolver, starts, evaluation, None if entry.name == REFERENCE else noise
        )
        outcome = np.where(
            flights.min_separation < aircraft.separation,
            OUTCOMES.index("violation"),
            flights.outcome,
        )
        limits = limits_of(entry.resolver, aircraft)
        flown_within.append(Flown(limits, outcome == OUTCOMES.index("reached")))
        columns = _columns(outcome, flights, flown, starts.mask, aircraft.dt)
        columns |= costs(starts, flights, flown, aircraft)
        if comparison.well_clear is not None:
            volume = VOLUMES[comparison.well_clear]
            reported = report_flights(starts, flown, noise, aircraft.dt)
            columns |= {
                "alert_s": first_alert(volume, reported, aircraft.dt),
                "well_clear_loss_s": first_loss(volume, flown, starts.mask, aircraft.dt),
                "altitude_deviation_m": np.zeros(count)
                if flown.altitudes is None
                else altitude_deviation(flown.altitudes),
            }
        table |= {f"{entry.name}.{name}": values for name, values in columns.items()}
    lost = {
        limits: verdict_within(starts, aircraft, limits, flown_within).verdict
        == Verdict.UNRESOLVABLE
        for limits in dict.fromkeys(ability.limits for ability in flown_within)
    }
    for entry, ability in zip(comparison.entries, flown_within, strict=True):
        table[f"{entry.name}.unresolvable"] = lost[ability.limits]
    return table


def limits_of(resolver: Resolver, aircraft: Aircraft) -> Limits:
    """Return the limits within which something flies, and within which its encounters are judged:
    plans are followed within those of the vehicle.
    """
    if isinstance(resolver, Plans):
        return resolver.options.limits
    return aircraft.limits


def _fly_on(
    resolver: Resolver,
    starts: Encounter,
    evaluation: Evaluation,
    noise: Callable[[int], np.ndarray] | None,
) -> tuple[Flights, Trajectories[Air]]:
    """Fly encounters on after losses of separation; the trajectories end where each flight does."""
    if isinstance(resolver, WitnessSearch):
        return fly_witnesses(starts, resolver, evaluation.aircraft)
    recorder = TrajectoryRecorder(starts)
    if not isinstance(resolver, Plans):
        flights = fly(
            starts, resolver, evaluation.aircraft, noise=noise, recorder=recorder, endless=True
        )
        return flights, recorder.stack()
    flown = evaluation._replace(mode=resolver.mode, plan_options=resolver.options)
    ready = ReadyEvaluation(flown, resolver.policy)
    _, flights = fly_in_mode(ready, Conditioned(starts, noise), recorder, endless=True)
    return flights, until(recorder.stack(), flights.duration, evaluation.aircraft.dt)


def _columns(
    outcome: np.ndarray, flights: Flights, flown: Trajectories[Air], mask: np.ndarray, dt: float
) -> dict[str, np.ndarray]:
    """Return the columns of one entry, with time steps of dt, s, but for the costs."""
    motion = relative(flown)
    # After the end of a flight everything is nan; no number there, no loss.
    with np.errstate(invalid="ignore"):
        penetration = np.where(
            np.isfinite(motion.x) & mask, severity(VOLUMES["do365_en_route"], motion), 0.0
        )
    return {
        "outcome": np.array(OUTCOMES, dtype=object)[outcome],
        "min_separation_m": flights.min_separation,
        "duration_s": flights.duration,
        "heading_reversals": flights.reversals,
        "severity": penetration.max(axis=(0, 2)),
        **{f"lost_{name}": losses(volume, flown, mask, dt) for name, volume in VOLUMES.items()},
    }
