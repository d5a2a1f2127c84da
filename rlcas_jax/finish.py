"""The end of a training: the final evaluation, the policy file, the figures and a summary."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from agents.learning.export import to_policy_file
from agents.policy import file as policy_file
from agents.policy.schema import SetOf, new_metadata
from agents.resolvability.classify import Verdict, classify
from commands.files import write_file
from envs.aircraft import Ratios, ratios
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from rlcas_jax.config import FamilyConfig, TrainConfig
from rlcas_jax.figures import training_figures
from rlcas_jax.loop import Run, outcomes, rates

POLICY = "policy.safetensors"


def finish(run: Run) -> dict[str, Any]:
    """Evaluate the trained policy, write it, its summary and the training figures; return the
    summary.
    """
    export(run, None)  # whatever happens to the evaluation, the policy is there
    evaluation = evaluate(run)
    path = export(run, evaluation["score_mean"])
    figures = training_figures([run.directory], run.directory / "figures")
    summary = {
        "name": run.config.name,
        "seed": run.config.seed,
        "finished": run.finished,
        "steps": run.steps,
        "training_score": run.score
        if math.isfinite(run.score)
        else None,  # no episode has ended yet
        "evaluation": evaluation,
        "wall_s": run.wall_s,
        "policy": path.name,
        "policy_sha256": policy_file.read(path).sha256,
        "figures": sorted(str(figure.relative_to(run.directory)) for figure in figures),
    }
    write_file(run.directory / "summary.json", json.dumps(summary, indent=2) + "\n")
    return summary


def evaluate(run: Run) -> dict[str, Any]:
    """Fly the deterministic policy through the final encounters and count its successes, of all and
    of the resolvable.

    What is not proven unresolvable counts as resolvable, so that a weak search cannot flatter the
    rate.
    """
    began = time.monotonic()
    settings = run.config.evaluation
    aircraft = run.config.aircraft.aircraft()
    encounters = encounters_of_seed(
        scenario("circle", aircraft), settings.seed, 0, settings.final_encounters
    )
    outcome = outcomes(run.task, run.state, encounters)
    solved, rules = np.asarray(outcome.reached), run.task.rules
    verdict = classify(encounters, rules, aircraft.limits, solved=solved).verdict
    possible = int(np.sum(verdict != Verdict.UNRESOLVABLE))
    measured = rates(outcome, rules)
    return {
        "encounters": settings.final_encounters,
        "seed": settings.seed,
        "score_mean": measured["eval_score"],
        "success_rate": measured["eval_success"],
        "violation_rate": measured["eval_violation"],
        "timeout_rate": measured["eval_timeout"],
        "unresolvable_proven": int(np.sum(verdict == Verdict.UNRESOLVABLE)),
        "undecided": int(np.sum(verdict == Verdict.UNDECIDED)),
        "success_given_resolvable": float(np.sum(solved)) / max(possible, 1),
        "wall_s": time.monotonic() - began,
    }


def export(run: Run, score: float | None) -> Path:
    """Write the policy file of a run and return its path."""
    config, path = run.config, run.directory / POLICY
    metadata = new_metadata(
        hidden=tuple(config.network.hidden),
        feature_set=config.network.feature_set,
        limits=config.aircraft.limits(),
        of_set=set_of(config) if config.network.feature_set == "set" else None,
        config=config.model_dump(mode="json"),
        steps=run.steps,
        score=score,
    )
    policy_file.write(path, to_policy_file(jax.device_get(run.state.learner.actor), metadata))
    return path


def set_of(config: TrainConfig) -> SetOf:
    """Return what the policy file says of a policy for any number of intruders, of all phases
    together.
    """
    aircraft, encoder = config.aircraft.aircraft(), tuple(config.network.encoder)
    most = max(
        drawn.intruders[1]
        for phase in config.phase_configs()
        for drawn in phase.training_scenarios()
    )
    own = ratios(aircraft.limits, aircraft.separation)._asdict()
    ends = {name: (value, value) for name, value in own.items()}
    if config.family.share:
        for name, (low, high) in _ratios_of(config.family)._asdict().items():
            ends[name] = (min(low, own[name]), max(high, own[name]))
    return SetOf(encoder, most, aircraft, ends, config.network.input_table().extra)


def _ratios_of(family: FamilyConfig) -> Ratios:
    """Return the ranges (low, high) of a family's ratios."""
    least, most = family.acceleration
    return Ratios(
        speed_min=family.speed_min,
        acceleration_min=(-most, -least),
        acceleration_max=(least, most),
        turn_radius=family.turn_radius,
    )


def table(directory: Path, summaries: Sequence[dict[str, Any]]) -> str:
    """Return the summaries as a text for a terminal."""
    lines = []
    for summary in summaries:
        lines += _lines_of_seed(summary)
    if len(summaries) > 1:
        lines.append(_line_of_seeds(summaries))
    lines.append(f"policy, summary, metrics and figures: {directory}")
    return "\n".join(lines)


def _lines_of_seed(summary: Mapping[str, Any]) -> list[str]:
    evaluation, score = summary["evaluation"], summary["training_score"]
    state = "" if summary["finished"] else ", interrupted"
    first = (
        f"seed {summary['seed']}: {summary['steps']:,} steps in {summary['wall_s']:.0f} s{state}"
    )
    rows = {
        "training score (stochastic policy, last 5 % of the episodes)": (
            "none yet" if score is None else f"{score:+.1f}"
        ),
        f"deterministic policy, {evaluation['encounters']} encounters: mean score": (
            f"{evaluation['score_mean']:+.1f}"
        ),
        "resolved, of all": f"{evaluation['success_rate']:.2%}",
        "resolved, of the resolvable": f"{evaluation['success_given_resolvable']:.2%}",
        "losses of separation": f"{evaluation['violation_rate']:.2%}",
        "out of time": f"{evaluation['timeout_rate']:.2%}",
        "proven unresolvable": f"{evaluation['unresolvable_proven']}",
        "undecided (counted as resolvable)": f"{evaluation['undecided']}",
    }
    return [first, *(f"  {name:<64}{value:>9}" for name, value in rows.items())]


def _line_of_seeds(summaries: Sequence[Mapping[str, Any]]) -> str:
    """Return in words between which figures the seeds of a configuration lie."""
    scores = [
        summary["training_score"] for summary in summaries if summary["training_score"] is not None
    ]
    success_rates = [summary["evaluation"]["success_given_resolvable"] for summary in summaries]
    reached = f"training score {min(scores):+.1f} to {max(scores):+.1f}, " if scores else ""
    resolved = f"resolved of the resolvable {min(success_rates):.2%} to {max(success_rates):.2%}"
    return f"{len(summaries)} seeds: {reached}{resolved}"
