"""The training task: the surrogate with its mixture of encounters, and one compiled update of everything."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from agents import ppo
from agents.networks import Actor, Critic
from envs import observation, surrogate
from envs.encounters import Encounter, Scenario
from envs.outcome import Outcome, Rules
from rlcas_jax.collect import Environment, Step, collect
from rlcas_jax.config import TrainConfig
from rlcas_jax.shaping import potential, shaped

__all__ = ["Task", "TrainState", "build", "fly"]


class TrainState(NamedTuple):
    """Everything that a resumed run needs to go on exactly as an uninterrupted one."""

    learner: ppo.LearnerState
    environment: surrogate.State
    key: jax.Array
    """Raw key data, so that it is an array like any other."""
    update: jax.Array
    """Number of updates done."""


class Task(NamedTuple):
    """The compiled functions of a configuration."""

    initial: Callable[[], TrainState]
    update: Callable[[TrainState], tuple[TrainState, dict[str, jax.Array]]]
    """Donates its argument."""
    evaluate: Callable[[Any, Encounter], Outcome]
    """(actor's variables, starts ``[N]``) -> how the deterministic policy ends them."""
    updates: int
    steps_per_update: int
    rules: Rules
    """Of the task itself, by which policies are judged."""


def build(config: TrainConfig) -> Task:
    """Assemble and compile the task of a configuration."""
    settings = ppo.PpoSettings(
        epochs=config.ppo.epochs,
        minibatches=config.ppo.minibatches,
        segment=config.ppo.segment,
        clip=config.ppo.clip,
        entropy=config.ppo.entropy,
        value=config.ppo.value,
        max_grad_norm=config.ppo.max_grad_norm,
        adam_epsilon=config.ppo.adam_epsilon,
        normalize_advantage=config.ppo.normalize_advantage,
    )
    hidden, feature_set = tuple(config.network.hidden), config.network.feature_set
    actor = Actor(hidden, feature_set, config.network.log_std_initial)
    parts = ppo.learner(actor, Critic(hidden, feature_set), settings)
    world = surrogate.World(config.world.rules(), config.world.limits())
    training_world = world
    if config.world.separation_spread > 0.0:
        demanded = jnp.asarray(config.world.demanded(config.ppo.environments))
        training_world = world._replace(rules=world.rules._replace(separation=demanded))
    scenarios = [entry.scenario() for entry in config.scenarios]
    total_weight = sum(entry.weight for entry in config.scenarios)
    weights = [entry.weight / total_weight for entry in config.scenarios]
    steps_per_update = config.ppo.environments * config.ppo.rollout
    updates = max(1, config.steps // steps_per_update)

    def starts(key: jax.Array, rows: int) -> surrogate.State:
        pool = surrogate.redraw_pool(key, scenarios, weights, rows, config.ppo.environments)
        return jax.vmap(lambda row: surrogate.reset(row, late_reports=_late(scenarios)))(pool)

    def initial() -> TrainState:
        learner_key, start_key, key = jax.random.split(jax.random.key(config.seed), 3)
        learner = ppo.initial_state(parts, learner_key, observation.SIZE)
        environment = jax.tree.map(lambda a: a[0], starts(start_key, 1))
        return TrainState(learner, environment, jax.random.key_data(key), jnp.zeros((), jnp.int32))

    def update(state: TrainState) -> tuple[TrainState, dict[str, jax.Array]]:
        pool_key, rollout_key, shuffle_key, key = jax.random.split(jax.random.wrap_key_data(state.key), 4)
        environment = _training_environment(config, training_world, starts(pool_key, config.pool_rows), scenarios)
        flown, samples, statistics, figures = collect(
            state.learner,
            state.environment,
            rollout_key,
            environment,
            parts,
            config.ppo.rollout,
            config.ppo.discount,
            config.ppo.gae_lambda,
        )
        done = state.update.astype(jnp.float32) / updates
        rate = config.ppo.learning_rate + (config.ppo.learning_rate_final - config.ppo.learning_rate) * done
        learner, learned = ppo.update(state.learner, samples, shuffle_key, rate, parts, settings)
        finite = jax.tree.reduce(jnp.logical_and, jax.tree.map(lambda p: jnp.all(jnp.isfinite(p)), learner))
        std = jnp.exp(learner.actor["params"]["log_std"])
        figures |= learned | _episodes(statistics, config.ppo.environments * config.ppo.rollout)
        figures |= {
            "learning_rate": rate,
            "std_acceleration": std[0],
            "std_yaw_rate": std[1],
            "finite": jnp.logical_and(finite, jnp.isfinite(learned["loss"])),
        }
        return TrainState(learner, flown, jax.random.key_data(key), state.update + 1), figures

    # What is judged is the task itself, whatever the training does to be on the safe side of it.
    task_world = world._replace(rules=config.evaluation.rules(config.world))

    def evaluate(actor_variables: Any, encounter: Encounter) -> Outcome:
        return fly(lambda seen: actor.apply(actor_variables, seen)[0], encounter, task_world)

    return Task(
        jax.jit(initial),
        jax.jit(update, donate_argnums=0),
        jax.jit(evaluate),
        updates,
        steps_per_update,
        task_world.rules,
    )


def fly(policy: Callable[[jax.Array], jax.Array], encounter: Encounter, world: surrogate.World) -> Outcome:
    """Fly encounters ``[N]`` to their end with a deterministic policy that sees them perfectly.

    Args:
        policy: observations ``[N, 8]`` -> actions ``[N, 2]``.
        encounter: the starts.
        world: parameters; the time limit must be a whole number of steps, known when this is compiled.
    """
    nobody = jnp.zeros(encounter.goal_x.shape, bool)

    def forward(carry: tuple[surrogate.State, jax.Array, Outcome], _: None) -> tuple[Any, None]:
        state, ended, outcome = carry
        action = policy(surrogate.observe(state))
        state, result = surrogate.step(state, (action[:, 0], action[:, 1]), world)
        outcome = Outcome(*(seen | (now & ~ended) for seen, now in zip(outcome, result.outcome, strict=True)))
        return (state, ended | result.outcome.ended(jnp), outcome), None

    begin = (surrogate.reset(encounter), nobody, Outcome(nobody, nobody, nobody))
    steps = round(world.rules.t_max / world.rules.dt)
    (_, _, outcome), _ = jax.lax.scan(forward, begin, None, length=steps)
    return outcome


def _late(scenarios: list[Scenario]) -> bool:
    return any(scenario.latency[1] > 0.0 for scenario in scenarios)


def _noisy(scenarios: list[Scenario]) -> bool:
    return _late(scenarios) or any(s.position_std > 0.0 or s.velocity_std > 0.0 for s in scenarios)


def _training_environment(
    config: TrainConfig, world: surrogate.World, pool: surrogate.State, scenarios: list[Scenario]
) -> Environment:
    """Return the surrogate with scaled reward and shaping; an encounter that ends restarts from the pool's row."""
    shaping = config.shaping

    def worth(state: surrogate.State) -> jax.Array:
        return potential(state, shaping.goal, shaping.conflict, config.world.separation)

    def observe(state: surrogate.State, key: jax.Array) -> jax.Array:
        noise = jax.random.normal(key, (4, *state.mask.shape)) if _noisy(scenarios) else None
        return surrogate.observe(state, noise)

    def step(state: surrogate.State, action: jax.Array) -> tuple[surrogate.State, Step]:
        following, result = surrogate.step(state, (action[:, 0], action[:, 1]), world)
        reward = config.ppo.reward_scale * result.reward + shaped(
            worth(state), worth(following), following.ended, config.ppo.discount
        )
        return following, Step(reward, following.ended, (result.reward, result.outcome))

    def restart(state: surrogate.State, index: jax.Array) -> surrogate.State:
        return surrogate.restart(state, jax.tree.map(lambda rows: rows[index % config.pool_rows], pool))

    return Environment(observe, step, restart)


def _episodes(statistics: tuple[jax.Array, Outcome], steps: int) -> dict[str, jax.Array]:
    """Return what the episodes that ended in the rollout amount to; not-a-number where none did."""
    reward, outcome = statistics
    episodes = jnp.sum(outcome.ended(jnp))
    return {
        "episodes": episodes,
        # The sparse reward comes with an episode's last step, so its sum is the sum of the returns.
        "score": jnp.sum(reward) / episodes,
        "success": jnp.sum(outcome.reached) / episodes,
        "violation": jnp.sum(outcome.violation) / episodes,
        "timeout": jnp.sum(outcome.timeout) / episodes,
        "episode_length": steps / episodes,
    }
