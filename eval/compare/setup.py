"""From the options of a comparison to its entries and encounters."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from agents.baselines.baselines import BASELINES
from agents.config.keys import one_of
from agents.config.load import ConfigError, load
from agents.policy.inference import Policy
from envs.aircraft import PAPER, Aircraft
from eval.compare.deciders import REFERENCE, WITNESS, Comparison, Entry, baseline_entry, policy_entries
from eval.config import FILE, MODEL, TRACKS, MonteCarloConfig
from eval.flights.chunks import Evaluation
from eval.runner.options import check_digest, named_source

__all__ = ["policy_names", "prepare"]

_DEFAULT_ENCOUNTERS = 1_000
_NAMES = (*BASELINES, WITNESS)


def prepare(options: argparse.Namespace) -> tuple[Comparison, int]:
    """Return the comparison and the number of its encounters.

    Raises:
        ConfigError: an option is out of its range; ``PolicyFileError``, ``NnetError``, ``EncounterError`` and
            ``TrackError``: a file cannot be used.
    """
    config = _config(options)
    aircraft = _aircraft(options.policy, options.policy_sha256)
    entries = _entries(options, aircraft)
    try:
        source, names, resolved = named_source(config, aircraft, "--encounters")
    except ConfigError as problem:  # a change that suits no flight of this aircraft
        raise _by_option(problem) from None
    evaluation = Evaluation(None, source, names, config.seed, aircraft)
    return Comparison(entries, evaluation), resolved["encounters"]


def _config(options: argparse.Namespace) -> MonteCarloConfig:
    """Return the encounters' part of an evaluation's configuration, checked by its rules."""
    name, count = options.scenario, options.encounters
    if count is None and not name.startswith((FILE, TRACKS)):
        count = _DEFAULT_ENCOUNTERS
    given = {key: getattr(options, key) for key in ("scenario", "seed", "confidence", "resamples")}
    given |= {"encounters": count, "tracks.ahead": options.ahead, "tracks.repair": str(options.repair).lower()}
    if name.startswith(MODEL):
        given["changes.ahead"] = options.ahead
    sets = [f"{key}={value}" for key, value in given.items() if value is not None]
    try:
        return load(MonteCarloConfig, None, [*sets, *(f"changes.{change}" for change in options.change)])
    except ConfigError as problem:
        sentence = str(problem).removeprefix("--set: ").replace("tracks.", "")
        raise _by_option(ConfigError(sentence if sentence.startswith("changes") else f"--{sentence}")) from None


def _by_option(problem: ConfigError) -> ConfigError:
    """Return an error about a scenario's changes with the option that says them; another one as it is."""
    sentence = str(problem)
    return ConfigError(f"--change{sentence.removeprefix('changes')}") if sentence.startswith("changes") else problem


def _aircraft(policies: Sequence[Path], digests: Sequence[str]) -> Aircraft:
    """Return the aircraft that the policies were trained for, on which they must agree.

    The digests, SHA-256, are those of each policy but the ``.nnet`` files, or none.
    """
    files = [path for path in policies if path.suffix != ".nnet"] or ([] if policies else [None])
    if digests and len(digests) != len(files):
        raise ConfigError(
            f"--policy-sha256: given {len(digests)} times; expected once for each of {len(files)} policies"
        )
    loaded = {path: Policy.load(path) for path in files}
    for path, digest in zip(files, digests, strict=False):
        check_digest(path, loaded[path].sha256, digest, "--policy-sha256")
    if not loaded:
        return PAPER
    found = {path: policy.aircraft for path, policy in loaded.items()}
    first, *others = found
    for path in others:
        if found[path] != found[first]:
            raise ConfigError(
                f"--policy: {path} was trained for {found[path]}, {first} for {found[first]}; "
                "expected policies of the same aircraft"
            )
    return found[first]


def _entries(options: argparse.Namespace, aircraft: Aircraft) -> tuple[Entry, ...]:
    """Return the entries: the policies, the baselines, and always the flight without a resolver."""
    entries: list[Entry] = []
    names = policy_names(options.policy)
    modes = list(dict.fromkeys(options.mode))
    for path, name in zip(options.policy or [None], names or ["policy"], strict=True):
        entries += policy_entries(path, name, aircraft, modes)
    wanted = list(dict.fromkeys(options.baseline or BASELINES))
    for name in wanted:
        if name not in _NAMES:
            raise ConfigError(f"--baseline: {name!r}; {one_of(name, _NAMES)}")
    if REFERENCE not in wanted:
        wanted.append(REFERENCE)
    return (*entries, *(baseline_entry(name, aircraft) for name in wanted))


def policy_names(paths: Sequence[Path]) -> list[str]:
    """Return a short name for each policy file, all of them different."""
    # A stem may be that of another file or the name of a baseline: then the whole path names the policy.
    stems = [path.stem for path in paths]
    names = [str(path) if stems.count(path.stem) > 1 or path.stem in _NAMES else path.stem for path in paths]
    if len(set(names)) < len(names):
        raise ConfigError("--policy: a file stands twice; expected different ones")
    return names
