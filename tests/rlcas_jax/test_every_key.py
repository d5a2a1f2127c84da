"""Every configuration key changes something: the compiled update, the start, or what a run leaves behind."""

from collections.abc import Iterator
from typing import Any

import jax
import pytest
from pydantic import BaseModel

from agents.config.load import load
from rlcas_jax.config import TrainConfig
from rlcas_jax.task import build

BASE = [
    "network.hidden=[4]",
    "ppo.environments=8",
    "ppo.rollout=8",
    "ppo.minibatch=32",
    "ppo.segment=4",
    "ppo.epochs=1",
    "pool_rows=2",
    "steps=640",
    "scenarios=[{name: circle, weight: 1.0}, {name: maneuvering, weight: 1.0}]",
]

CHANGED: dict[str, str] = {
    "steps": "1280",
    "network.hidden": "[5]",
    "network.feature_set": "none",
    "network.log_std_initial": "-1.0",
    "ppo.environments": "16",
    "ppo.rollout": "16",
    "ppo.epochs": "2",
    "ppo.minibatch": "16",
    "ppo.segment": "2",
    "ppo.learning_rate": "1e-3",
    "ppo.learning_rate_final": "1e-5",
    "ppo.discount": "0.9",
    "ppo.gae_lambda": "0.9",
    "ppo.clip": "0.1",
    "ppo.entropy": "0.1",
    "ppo.max_grad_norm": "1.0",
    "ppo.reward_scale": "0.1",
    "ppo.smoothness": "[0.1, 0.0]",
    "ppo.critic_warmup_steps": "64",
    "world.vehicle.speed_min_mps": "40.0",
    "world.vehicle.speed_max_mps": "120.0",
    "world.vehicle.acceleration_min_mps2": "-1.0",
    "world.vehicle.acceleration_max_mps2": "1.0",
    "world.vehicle.yaw_rate_max_deg_s": "5.0",
    "world.t_max": "200.0",
    "world.separation": "900.0",
    "world.separation_spread": "100.0",
    "world.separation_headroom": "100.0",
    "world.goal_radius": "400.0",
    "world.reward_violation": "-50.0",
    "world.reward_goal": "50.0",
    "world.reward_timeout": "-5.0",
    "scenarios.0.name": "noisy",
    "scenarios.0.weight": "3.0",
    "scenarios.0.radius": "[2000, 3000]",
    "scenarios.0.own_speed": "[60, 70]",
    "scenarios.0.intruder_speed": "[60, 70]",
    "scenarios.0.course_difference_deg": "[-10, 10]",
    "scenarios.0.displacement": "100.0",
    "scenarios.0.min_initial_separation": "500.0",
    "scenarios.0.conflicts_closer_than": "900.0",
    "scenarios.0.intruders": "[2, 3]",
    "scenarios.0.turn_rate_deg_s": "1.0",
    "scenarios.0.heading_change_deg": "30.0",
    "scenarios.0.position_std": "10.0",
    "scenarios.0.velocity_std": "1.0",
    "scenarios.0.latency": "[0.5, 1.0]",
    "pool_rows": "4",
    "shaping.goal": "0.5",
    "shaping.escape_margin": "0.5",
    "shaping.lateness": "0.5",
    "shaping.turn_rate_cost": "0.1",
    "shaping.heading_change_cost": "0.1",
    "shaping.rejoin_turn_cost": "0.1",
    "shaping.path_excess_cost": "0.1",
}

ELSEWHERE = {
    "phases": "the configuration of each phase (test_phases)",
    "near_limit.share": "the starts (test_starts)",
    "near_limit.margin": "the starts (test_starts)",
    "name": "the default name of the run's directory (test_cli)",
    "warm_start": "the networks that training begins with (test_warm_start)",
    "seed": "the draws (test_loop: another seed is another run)",
    "evaluation.every_steps": "the metrics (test_loop)",
    "evaluation.encounters": "the metrics (test_loop)",
    "evaluation.final_encounters": "the summary (test_loop)",
    "evaluation.seed": "the encounters that are judged (below)",
    "evaluation.separation": "the rules that are judged by (below)",
    "checkpoint.every_seconds": "the checkpoints (test_loop)",
    "scenarios.0.attempts": "evaluation only: training fills a pool without attempts",
}


def keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Yield the dotted name of every leaf of a configuration model."""
    for name, field in model.model_fields.items():
        kind: Any = field.annotation
        if prefix == "" and name == "scenarios":
            kind = kind.__args__[0]
            name = "scenarios.0"  # noqa: PLW2901
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from keys(kind, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def program(*overrides: str) -> str:
    """Return the text of the update and of the start that a configuration compiles to."""
    task = build(load(TrainConfig, None, [*BASE, *overrides]))
    state = jax.eval_shape(task.initial)
    return jax.jit(task.initial).lower().as_text() + jax.jit(task.update).lower(state).as_text()


@pytest.fixture(scope="module")
def base() -> str:
    return program()


def test_no_key_is_forgotten_here() -> None:
    assert set(keys(TrainConfig)) == set(CHANGED) | set(ELSEWHERE)


def test_the_program_does_not_change_by_itself(base: str) -> None:
    assert program() == base


@pytest.mark.slow
@pytest.mark.parametrize("key", CHANGED)
def test_a_key_changes_the_program(key: str, base: str) -> None:
    more = {"scenarios.0.intruders": "ppo.minibatch=16", "world.separation_headroom": "world.separation_spread=80"}.get(
        key
    )
    if more is None:
        assert program(f"{key}={CHANGED[key]}") != base
    else:
        assert program(f"{key}={CHANGED[key]}", more) != program(more)


def test_the_evaluation_has_its_own_separation() -> None:
    given = [*BASE, "evaluation.separation=950.0", "world.separation=1100.0", "world.t_max=40.0"]
    rules = build(load(TrainConfig, None, given)).rules
    assert (rules.separation, rules.t_max) == (950.0, 40.0)
