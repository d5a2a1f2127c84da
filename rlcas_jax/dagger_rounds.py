"""The rounds of dataset aggregation, each saved so that a run goes on after the last whole step."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import jax
import numpy as np

from agents.config.load import ConfigError
from agents.learning.export import to_policy_file
from agents.learning.networks import Actor
from agents.policy import file as policy_file
from envs import surrogate
from envs.encounters import Encounter
from envs.outcome import Outcome
from envs.starts import cast
from rlcas_jax.beginning import actor_with, policy_at
from rlcas_jax.dagger_config import DaggerRun
from rlcas_jax.dagger_fit import fit
from rlcas_jax.dagger_flights import Gather, Samples, gatherer, joined
from rlcas_jax.finish import POLICY, judged
from rlcas_jax.loop import made_with
from rlcas_jax.task import fly

__all__ = ["Reporter", "refine"]

METRICS = "metrics.jsonl"


class Reporter(Protocol):
    """Whom a run tells how it goes."""

    def note(self, text: str, *, always: bool = False) -> None:
        """Say something."""

    def progress(self, what: str, done: int, of: int) -> None:
        """Say how much of something is done."""


@dataclass(frozen=True)
class _Files:
    """Where a run's rounds are."""

    directory: Path

    def policy(self, number: int) -> Path:
        return self.directory / f"policy-{number}.safetensors"

    def told(self, number: int) -> Path:
        return self.directory / f"told-{number}.npz"

    def judged(self, number: int) -> Path:
        return self.directory / f"judged-{number}.json"


def refine(config: DaggerRun, directory: Path, said: Reporter) -> dict[str, Any]:
    """Fly, tell and learn in rounds; write the last policy and a summary, and return that.

    Args:
        config: of all.
        directory: of the run; exists. What it has of a round is not done again.
        said: told how it goes.

    Raises:
        ConfigError: the policies or the encounters that the configuration names cannot be used.
    """
    began = time.monotonic()
    files = _Files(directory / "rounds")
    files.directory.mkdir(exist_ok=True)
    actor = Actor(tuple(config.network.hidden), config.network.feature_set)
    begun = _first(config)
    (directory / "versions.json").write_text(json.dumps(made_with(), indent=2) + "\n", encoding="utf-8")
    flies = _flight(config, actor)
    gather: Gather | None = None
    current = begun
    rows = [_judged(config, flies, current, files.judged(0), lambda: {"told": 0}, said)]
    for number in range(1, config.dagger.rounds + 1):
        if not files.policy(number).is_file():
            gather = gatherer(config, actor) if gather is None else gather
            told = _told(config, gather, current, number, files, said)
            current = _learned(config, actor, current, told, number, directory, said)
            policy_file.write(files.policy(number), current)
        current = policy_file.read(files.policy(number))
        rows.append(_judged(config, flies, current, files.judged(number), partial(_counted, files.told(number)), said))
    policy_file.write(directory / POLICY, current)
    summary = {
        "name": config.name,
        "seed": config.seed,
        "policy": POLICY,
        "policy_sha256": current.sha256,
        "started_from_sha256": begun.sha256,
        "rounds": rows,
        "wall_s": time.monotonic() - began,
    }
    (directory / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return summary


def _first(config: DaggerRun) -> policy_file.PolicyFile:
    """Return the policy that is refined."""
    of = config.start_from
    assert of is not None  # the configuration sees to it
    of = of / POLICY if of.is_dir() else of
    found, hidden = policy_at(of, "start_from"), tuple(config.network.hidden)
    if found.hidden != hidden:
        raise ConfigError(f"start_from: {of} has network.hidden {found.hidden}; expected {hidden} as configured")
    if found.limits != config.world.limits():
        raise ConfigError(f"start_from: {of} is of a vehicle with other limits than world.vehicle")
    return found


def _variables(config: DaggerRun, policy: policy_file.PolicyFile) -> Any:
    return actor_with(policy, config.network.feature_set, f"start_from: {config.start_from}")


def _told(
    config: DaggerRun,
    gather: Gather,
    policy: policy_file.PolicyFile,
    number: int,
    files: _Files,
    said: Reporter,
) -> Samples:
    """Return what the policy of this round and those before it were told; this round's is saved."""
    if not files.told(number).is_file():
        what, of = f"round {number}, rollouts flown", config.dagger.rollouts
        samples, resolved = gather(_variables(config, policy), number, lambda done: said.progress(what, done, of))
        unfinished = files.told(number).with_suffix(".tmp.npz")
        np.savez(unfinished, allow_pickle=False, resolved=resolved, **samples._asdict())
        unfinished.replace(files.told(number))
    parts = []
    for each in range(1, number + 1):
        with np.load(files.told(each)) as saved:
            parts.append(Samples(*(saved[name] for name in Samples._fields)))
    return joined(parts)


def _learned(
    config: DaggerRun,
    actor: Actor,
    policy: policy_file.PolicyFile,
    told: Samples,
    number: int,
    directory: Path,
    said: Reporter,
) -> policy_file.PolicyFile:
    """Return the policy after it learned what was told; how the loss fell is written down."""
    log = directory / METRICS
    _forget(log, number)

    def report(done: int, of: int, loss: float) -> None:
        said.progress(f"round {number}, gradient steps", done, of)
        with log.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps({"round": number, "gradient_step": done, "loss": loss}) + "\n")

    seed = (config.seed, number)
    variables = fit(actor, _variables(config, policy), told, config.dagger, seed, report)
    flown = config.dagger.rollouts * config.ppo.environments * config.ppo.rollout
    return to_policy_file(
        jax.device_get(variables),
        tuple(config.network.hidden),
        config.network.feature_set,
        config.world.limits(),
        config.model_dump(mode="json"),
        steps=policy.metadata["training"]["steps"] + flown,
        notes=f"refined by dataset aggregation, round {number}, from {policy.sha256[:8]}",
    )


def _forget(log: Path, number: int) -> None:
    """Drop what a log has of a round that was stopped while it learned."""
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True) if log.is_file() else []
    kept = [line for line in lines if line.endswith("\n") and json.loads(line)["round"] != number]
    log.write_text("".join(kept), encoding="utf-8")


def _counted(told: Path) -> dict[str, Any]:
    """Return how much a round was told, and what share of its training flights was resolved."""
    with np.load(told) as saved:
        return {"told": len(saved["weight"]), "flights_resolved": float(saved["resolved"])}


def _flight(config: DaggerRun, actor: Actor) -> Callable[[Any, Encounter], Outcome]:
    """Return (parameters, encounters ``[N]``) -> how the policy ends them; compiled once."""
    world = surrogate.World(config.evaluation.rules(config.world), config.world.limits())
    return jax.jit(lambda variables, encounters: fly(lambda seen: actor.apply(variables, seen)[0], encounters, world))


def _judged(
    config: DaggerRun,
    flies: Callable[[Any, Encounter], Outcome],
    policy: policy_file.PolicyFile,
    file: Path,
    known: Callable[[], dict[str, Any]],
    said: Reporter,
) -> dict[str, Any]:
    """Return how the policy of a round ends the final encounters, and what else is known of it; it is saved."""
    if not file.is_file():
        variables = _variables(config, policy)

        def ended(encounters: Encounter) -> Outcome:
            return Outcome(*jax.device_get(flies(variables, cast(encounters, np.float32))))

        row = known() | {"policy_sha256": policy.sha256} | judged(config, config.evaluation.rules(config.world), ended)
        unfinished = file.with_suffix(".tmp")
        unfinished.write_text(json.dumps(row, indent=2) + "\n", encoding="utf-8")
        unfinished.replace(file)
    row = json.loads(file.read_text(encoding="utf-8"))
    said.note(
        f"policy {row['policy_sha256'][:8]}: {row['success_given_resolvable']:.2%} of the resolvable resolved, "
        f"{row['violation_rate']:.2%} violations, {row['timeout_rate']:.2%} time-outs"
    )
    return row
