"""From the options of a comparison to who takes part in it and on which encounters."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents.baselines import BASELINES
from agents.configuration import ConfigError
from agents.configuration_keys import nearest
from agents.inference import Policy
from envs import encounter_file
from envs.encounters import scenario
from envs.kinematics import SURROGATE, Limits
from envs.lincoln_file import read_lincoln, tracks_of
from envs.outcome import RULES, Rules
from envs.replay import Replay, replay
from envs.track_files import read_daidalus
from eval.chunks import Evaluation
from eval.contest import REFERENCE, Contest, Entry, baseline_entry, policy_entries

__all__ = ["policy_names", "prepare", "size"]

_TRACKS, _FILE = "tracks:", "file:"
_DEFAULT_ENCOUNTERS = 1_000


def prepare(options: argparse.Namespace) -> tuple[Contest, np.ndarray | None, Sequence[str]]:
    """Return the contest, the weights of its encounters, and sentences on what was left out.

    Raises:
        ConfigError: an option is out of its range; ``PolicyFileError``, ``NnetError``, ``EncounterError`` and
            ``TrackError``: a file cannot be used.
    """
    _check(options)
    limits = _limits(options.policy)
    entries = _entries(options, limits, RULES)
    replayed, weights, left_out = None, None, ()
    names: tuple[str, ...] | None = None
    if options.scenario.startswith(_TRACKS):
        replayed, weights = _recorded(options, limits, RULES)
        source, names, left_out = replayed.starts, replayed.names, replayed.left_out
    elif options.scenario.startswith(_FILE):
        source, found = encounter_file.read(options.scenario.removeprefix(_FILE), limits)
        names = tuple(found)
    else:
        source = scenario(options.scenario)
    evaluation = Evaluation(None, source, names, options.seed, RULES, limits)
    return Contest(entries, evaluation, replayed), weights, left_out


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
    """Return who takes part: the policies, the baselines, and always the flight without a resolver."""
    entries: list[Entry] = []
    names = policy_names(options.policy)
    for path, name in zip(options.policy or [None], names or ["policy"], strict=True):
        entries += policy_entries(path, name, limits, rules)
    wanted = list(dict.fromkeys(options.baseline or BASELINES))
    for name in wanted:
        if name not in BASELINES:
            close = nearest(name, tuple(BASELINES))
            hint = f"; did you mean {close}?" if close else ""
            raise ConfigError(f"--baseline: {name!r}; expected one of {', '.join(BASELINES)}{hint}")
    if REFERENCE not in wanted:
        wanted.append(REFERENCE)
    return (*entries, *(baseline_entry(name, limits, rules) for name in wanted))


def policy_names(paths: Sequence[Path]) -> list[str]:
    """Return a short name for each policy file, all of them different."""
    # A stem may be that of another file or the name of a baseline: then the whole path names the policy.
    stems = [path.stem for path in paths]
    names = [str(path) if stems.count(path.stem) > 1 or path.stem in BASELINES else path.stem for path in paths]
    if len(set(names)) < len(names):
        raise ConfigError("--policy: a file stands twice; expected different ones")
    return names


def _recorded(options: argparse.Namespace, limits: Limits, rules: Rules) -> tuple[Replay, np.ndarray | None]:
    """Return the replayed encounters of a file of tracks and their weights."""
    path = Path(options.scenario.removeprefix(_TRACKS))
    weights: dict[str, float] = {}
    if path.suffix == ".json":
        found = read_lincoln(path)
        weights = {str(each.number): each.weight for each in found}
        flown = ((str(each.number), tracks_of(each)) for each in found)
        encounters = [(name, own, [other]) for name, (own, other) in flown]
    elif path.suffix in (".daa", ".xyz"):
        own, *others = read_daidalus(path).tracks
        encounters = [(path.stem, own, others)]
    else:
        raise ConfigError(f"--scenario: {path} ends in {path.suffix!r}; expected .json, .daa or .xyz")
    steps = round(rules.t_max / rules.dt)
    replayed = replay(encounters, steps=steps, dt=rules.dt, ahead=options.ahead, limits=limits)
    chosen = np.array([weights[name] for name in replayed.names]) if weights else None
    return replayed, chosen


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
