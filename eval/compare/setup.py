"""From the options of a comparison to its entries and encounters."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from agents.baselines.baselines import BASELINES
from agents.config.keys import nearest
from agents.config.load import ConfigError, Strict, load
from agents.config.world import ScenarioConfig, check_own_speed
from agents.policy.inference import Policy
from envs.encounters import scenario
from envs.formats import encounter_file
from envs.kinematics import SURROGATE, Limits
from envs.outcome import RULES, Rules
from eval.compare.deciders import REFERENCE, WITNESS, Comparison, Entry, baseline_entry, policy_entries
from eval.config import FILE, MODEL, TRACKS, TracksConfig, TrafficConfig
from eval.flights.chunks import Evaluation
from eval.flights.sources import read_model_traffic, read_tracks

__all__ = ["policy_names", "prepare", "size"]

_Model = TypeVar("_Model", bound=Strict)

_DEFAULT_ENCOUNTERS = 1_000
_MODES = ("plan", "assured")
_NAMES = (*BASELINES, WITNESS)
_LATEST_CPA, _LONGEST_ROUTE = TrafficConfig().cpa_time[1], 400.0


def prepare(options: argparse.Namespace) -> Comparison:
    """Return the comparison.

    Raises:
        ConfigError: an option is out of its range; ``PolicyFileError``, ``NnetError``, ``EncounterError`` and
            ``TrackError``: a file cannot be used.
    """
    _check(options)
    limits = _limits(options.policy)
    entries = _entries(options, limits, RULES)
    names: tuple[str, ...] | None = None
    if options.change and options.scenario.startswith((TRACKS, FILE)):
        raise ConfigError(f"--change: {options.change[0]}; expected none, the encounters stand in a file")
    if options.scenario.startswith(TRACKS):
        path, how = (
            Path(options.scenario.removeprefix(TRACKS)),
            TracksConfig(ahead=options.ahead, repair=options.repair),
        )
        source = read_tracks(path, limits, how)
        names = source.names
    elif options.scenario.startswith(FILE):
        source, found = encounter_file.read(options.scenario.removeprefix(FILE), limits)
        names = tuple(found)
    elif options.scenario.startswith(MODEL):
        path = Path(options.scenario.removeprefix(MODEL))
        source = read_model_traffic(path, _traffic(options), limits)
    else:
        source = scenario(options.scenario)
        if options.change:
            source = _changed(ScenarioConfig, f"name={options.scenario}", *options.change).scenario()
        check_own_speed(source, limits, "--change own_speed")
    evaluation = Evaluation(None, source, names, options.seed, RULES, limits)
    return Comparison(entries, evaluation)


def _check(options: argparse.Namespace) -> None:
    """Raise ``ConfigError`` for the first value that is out of its range."""
    ranges: list[tuple[str, float, float, float]] = [
        ("--encounters", 1 if options.encounters is None else options.encounters, 1, 1_000_000),
        ("--seed", options.seed, 0, 2**63),
        ("--ahead", options.ahead, 10.0, 3_600.0),
        ("--confidence", options.confidence, 0.5, 0.9999),
        ("--resamples", options.resamples, 100, 100_000),
    ]
    for name, value, low, high in ranges:
        # Inverted, so that NaN is refused.
        if not low <= value <= high:
            raise ConfigError(f"{name}: {value:g}; expected {low:g} to {high:g}")


def _traffic(options: argparse.Namespace) -> TrafficConfig:
    """Return how encounters with a model's traffic are drawn."""
    ahead = options.ahead
    if not _LATEST_CPA <= ahead <= _LONGEST_ROUTE:
        raise ConfigError(f"--ahead: {ahead:g}; expected {_LATEST_CPA:g} to {_LONGEST_ROUTE:g} with {MODEL}PATH")
    return _changed(TrafficConfig, f"ahead={ahead}", *options.change)


def _changed(model: type[_Model], *values: str) -> _Model:
    """Return numbers of a scenario with changes ``KEY=VALUE``."""
    for value in values[1:]:
        if value.partition("=")[0] in ("name", "weight", "ahead"):
            raise ConfigError(f"--change: {value}; expected a number of the scenario")
    try:
        return load(model, None, values)
    except ConfigError as problem:
        raise ConfigError(f"--change: {str(problem).removeprefix('--set: ')}") from None


def _limits(policies: Sequence[Path]) -> Limits:
    """Return the limits of the ownship: those that the policies were trained for, which must agree."""
    files = [path for path in policies if path.suffix != ".nnet"]
    if policies and not files:
        return SURROGATE
    found = {path: Policy.load(path).limits for path in files or [None]}
    first, *others = found
    for path in others:
        if found[path] != found[first]:
            raise ConfigError(
                f"--policy: {path} was trained for {found[path]}, {first} for {found[first]}; "
                "expected policies of the same vehicle"
            )
    return found[first]


def _entries(options: argparse.Namespace, limits: Limits, rules: Rules) -> tuple[Entry, ...]:
    """Return the entries: the policies, the baselines, and always the flight without a resolver."""
    entries: list[Entry] = []
    names = policy_names(options.policy)
    modes = list(dict.fromkeys(options.mode))
    for mode in modes:
        if mode not in _MODES:
            raise ConfigError(f"--mode: {mode!r}; expected {' or '.join(_MODES)}")
    for path, name in zip(options.policy or [None], names or ["policy"], strict=True):
        entries += policy_entries(path, name, limits, rules, modes)
    wanted = list(dict.fromkeys(options.baseline or BASELINES))
    for name in wanted:
        if name not in _NAMES:
            close = nearest(name, _NAMES)
            hint = f"; did you mean {close}?" if close else ""
            raise ConfigError(f"--baseline: {name!r}; expected one of {', '.join(_NAMES)}{hint}")
    if REFERENCE not in wanted:
        wanted.append(REFERENCE)
    return (*entries, *(baseline_entry(name, limits, rules) for name in wanted))


def policy_names(paths: Sequence[Path]) -> list[str]:
    """Return a short name for each policy file, all of them different."""
    # A stem may be that of another file or the name of a baseline: then the whole path names the policy.
    stems = [path.stem for path in paths]
    names = [str(path) if stems.count(path.stem) > 1 or path.stem in _NAMES else path.stem for path in paths]
    if len(set(names)) < len(names):
        raise ConfigError("--policy: a file stands twice; expected different ones")
    return names


def size(options: argparse.Namespace, evaluation: Evaluation) -> int:
    """Return the number of encounters.

    Raises:
        ConfigError: more are asked for than a file holds.
    """
    if evaluation.names is None:
        return _DEFAULT_ENCOUNTERS if options.encounters is None else options.encounters
    most = len(evaluation.names)
    if options.encounters is not None and options.encounters > most:
        raise ConfigError(f"--encounters: {options.encounters}; expected at most {most}, as many as the file holds")
    return most if options.encounters is None else options.encounters
