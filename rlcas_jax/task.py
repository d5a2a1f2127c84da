"""The training task: the surrogate with its mixture of encounters, and one compiled update of
everything.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
from jax.sharding import PartitionSpec
from jaxtyping import Array, Bool, Float, Int, Int32, PRNGKeyArray, Shaped, UInt32

from agents.config.load import ConfigError
from agents.learning.algorithm import Algorithm
from agents.learning.networks import NetworkInput, Variables, derive
from agents.policy.scene import scene
from agents.policy.set_features import set_inputs
from envs import surrogate
from envs.aircraft import Aircraft
from envs.encounters import Encounter, Scenario
from envs.outcome import Outcome, Rules
from envs.rewards import TERMS, Transition, learning_reward
from envs.world import distance_scales, known_intruders, perceive_intruders
from rlcas_jax.algorithm import actor_of, algorithm_of
from rlcas_jax.collect import Environment, RolloutStep, collect
from rlcas_jax.config import PPO, NetworkConfig, TrainConfig
from rlcas_jax.devices import AXIS, Devices, compiler_options
from rlcas_jax.metrics import OF_REWARDS, logged_name
from rlcas_jax.ownships import Ownships, ownships
from rlcas_jax.starts import draw, noisy

Figures = dict[str, Float[Array, ""]]
"""What an update logs, by name."""


class TrainState(NamedTuple):
    """Everything that a resumed run needs to go on exactly as an uninterrupted one."""

    learner: Any  # the algorithm's own, with a field actor
    environment: surrogate.State
    key: UInt32[Array, " W"]  # raw key data, so that it is an array like any other
    update: Int32[Array, ""]  # number of updates done


class CompiledTask(NamedTuple):
    """The compiled functions of a configuration."""

    initial: Callable[[], TrainState]
    update: Callable[[TrainState], tuple[TrainState, Figures]]  # donates its argument
    # (variables of the actor, starts [N]) -> how they end by its means
    evaluate: Callable[[Variables, Encounter], Outcome]
    updates: int
    steps_per_update: int
    rules: Rules  # of the task itself, by which policies are evaluated
    placed: TrainState | None = None  # where the state's arrays belong; None on one device

    def shapes(self) -> TrainState:
        """Return shapes and dtypes of the state."""
        return jax.eval_shape(self.initial)


@dataclass(frozen=True)
class TrainingContext:
    """What the functions of a task are made of."""

    config: TrainConfig
    phase: int
    algorithm: Algorithm
    world: surrogate.World
    scenarios: list[Scenario]
    ownships: Ownships
    axis: str | None  # name of the devices' axis; None on one device

    @property
    def updates(self) -> int:
        """Updates of the phase."""
        return max(1, self.config.steps // self.config.samples)


class Draws(NamedTuple):
    """What is drawn for an update, and the ownships, which are split over the devices alike."""

    pool: surrogate.State  # starts, [rows, N]
    noise: Float[Array, "T N 2"]  # of the actions
    observe_key: PRNGKeyArray
    shuffle_key: PRNGKeyArray
    ownships: Ownships


_Flying = tuple[Any, surrogate.State]
"""The algorithm's state, and that of the encounters."""

_Iteration = Callable[[_Flying, Draws, Float[Array, ""]], tuple[_Flying, Figures]]
"""One rollout and what is learned from it, with a learning rate."""


def build(config: TrainConfig, devices: Devices | None = None, phase: int = 0) -> CompiledTask:
    """Assemble the task of a configuration; its functions are compiled when they are first called.

    The encounters are split over the devices, one by default, or a ConfigError says that they
    cannot be. The same are flown with the same draws whatever the devices' number; each device
    shuffles its own. A phase has draws of its own.
    """
    devices = Devices(None) if devices is None else devices
    _check_split(config, devices.count)
    context = context_of(config, devices.axis, phase)
    iterate = _split_over(devices, partial(_iterate, context))
    placed = _placement(devices)
    return CompiledTask(
        initial=jax.jit(partial(_initial, context), out_shardings=placed),
        update=jax.jit(
            partial(_update, context, iterate),
            donate_argnums=0,
            out_shardings=None if placed is None else (placed, devices.replicated()),
            compiler_options=compiler_options(),
        ),
        evaluate=jax.jit(partial(_evaluate, context), compiler_options=compiler_options()),
        updates=context.updates,
        steps_per_update=config.samples,
        rules=context.world.rules,
        placed=placed,
    )


def context_of(config: TrainConfig, axis: str | None = None, phase: int = 0) -> TrainingContext:
    """Return what the task of a configuration is made of, on the devices of an axis."""
    return TrainingContext(
        config=config,
        phase=phase,
        algorithm=algorithm_of(config, axis),
        world=surrogate.World(config.rules(), config.aircraft.aircraft()),
        scenarios=config.training_scenarios(),
        ownships=ownships(config),
        axis=axis,
    )


def _initial(context: TrainingContext) -> TrainState:
    """Return the state at the start of a phase."""
    config = context.config
    key = jax.random.key(config.seed)
    if context.phase > 0:
        key = jax.random.fold_in(key, context.phase)
    learner_key, start_key, key = jax.random.split(key, 3)
    environment = jax.tree.map(lambda a: a[0], draw(start_key, config, context.scenarios, 1))
    first = jax.tree.map(lambda a: a[:1], environment)
    blank = network_input(first, context.world.aircraft, config.network)
    learner = context.algorithm.init(learner_key, blank)
    return TrainState(learner, environment, jax.random.key_data(key), jnp.zeros((), jnp.int32))


def _update(
    context: TrainingContext, iterate: _Iteration, state: TrainState
) -> tuple[TrainState, Figures]:
    """Draw, fly and learn once."""
    draws, key = draw_update(context, state.key)
    rate = _learning_rate(context, state.update)
    (learner, flying), figures = iterate((state.learner, state.environment), draws, rate)
    figures |= {"learning_rate": rate, "finite": _finite(learner, figures)}
    return TrainState(learner, flying, jax.random.key_data(key), state.update + 1), figures


def draw_update(
    context: TrainingContext, key_data: UInt32[Array, " W"]
) -> tuple[Draws, PRNGKeyArray]:
    """Draw what an update needs; return it and the key of the next one."""
    config = context.config
    pool_key, rollout_key, shuffle_key, key = jax.random.split(
        jax.random.wrap_key_data(key_data), 4
    )
    noise_key, observe_key = jax.random.split(rollout_key)
    pool = draw(pool_key, config, context.scenarios, config.pool_rows)
    noise = jax.random.normal(noise_key, (config.rollout, config.environments, 2))
    flying = jax.tree.map(jnp.asarray, context.ownships)
    return Draws(pool, noise, observe_key, shuffle_key, flying), key


def _learning_rate(context: TrainingContext, update: Int32[Array, ""]) -> Float[Array, ""]:
    """Return the learning rate of an update: it changes linearly over the phase."""
    first, final = context.config.learning_rate, context.config.learning_rate_final
    progress = update.astype(jnp.float32) / context.updates
    return first + (final - first) * progress


def _finite(learner: Any, figures: Figures) -> Bool[Array, ""]:
    """Return whether all that was learned, and the loss if there is one, is finite."""
    leaves = jax.tree.map(lambda leaf: jnp.all(jnp.isfinite(leaf)), learner)
    finite = jax.tree.reduce(jnp.logical_and, leaves)
    return jnp.logical_and(finite, jnp.isfinite(figures.get("loss", 0.0)))


def _iterate(
    context: TrainingContext, state: _Flying, draws: Draws, rate: Float[Array, ""]
) -> tuple[_Flying, Figures]:
    """Roll out and learn; on several devices with the encounters of one of them."""
    learner, flying = state
    environment = environment_of(context, draws)
    key = draws.observe_key
    if context.axis is not None:
        key = jax.random.fold_in(key, jax.lax.axis_index(context.axis))
    flying, rollout, statistics = collect(
        context.algorithm, learner, environment, flying, draws.noise, key
    )
    learner, learned = context.algorithm.update(learner, rollout, draws.shuffle_key, rate)
    samples = context.config.samples
    figures = {logged_name(name): value for name, value in learned.items()}
    figures |= _episodes(statistics, samples, context.axis)
    figures |= _rewards(statistics, context.config, samples, context.axis)
    return (learner, flying), figures


def environment_of(context: TrainingContext, draws: Draws) -> Environment:
    """Return the environment in which an update flies."""
    world = _training_world(context, draws.ownships)
    return _training_environment(context.config, world, draws.pool, context.scenarios)


def _training_world(context: TrainingContext, flying: Ownships) -> surrogate.World:
    """Return the world in which training flies: with less time, and the ownships of the
    environments.
    """
    rules, aircraft = context.world.rules, context.world.aircraft
    rules = rules._replace(t_max=context.config.world.time_share * rules.t_max)
    if context.ownships.of_family.any():
        aircraft = aircraft._replace(limits=flying.limits)
    return context.world._replace(rules=rules, aircraft=aircraft)


def _evaluate(context: TrainingContext, actor_variables: Variables, starts: Encounter) -> Outcome:
    """Return how encounters ``[N]`` end by the actor's mean action."""
    network, aircraft = context.config.network, context.world.aircraft
    actor = actor_of(network)

    def policy(state: surrogate.State) -> Float[Array, "N 2"]:
        applied: Any = actor.apply(actor_variables, network_input(state, aircraft, network))
        return applied[0]

    return fly(policy, starts, context.world)


def _split_over(devices: Devices, iterate: _Iteration) -> _Iteration:
    """Return the iteration with the encounters split over the devices; what is learned is the same
    on all.
    """
    if devices.mesh is None:
        return iterate
    whole, split, second = PartitionSpec(), PartitionSpec(AXIS), PartitionSpec(None, AXIS)
    draws = Draws(
        pool=cast(Any, second),
        noise=cast(Any, second),
        observe_key=cast(Any, whole),
        shuffle_key=cast(Any, whole),
        ownships=cast(Any, split),
    )
    # Without the check of what varies: it would add up the gradients before they can be averaged
    # by name.
    return jax.shard_map(
        iterate,
        mesh=devices.mesh,
        in_specs=((whole, split), draws, whole),
        out_specs=((whole, split), whole),
        check_vma=False,
    )


def _placement(devices: Devices) -> TrainState | None:
    """Return where the arrays of a state belong; None on one device."""
    if devices.mesh is None:
        return None
    whole: Any = devices.replicated()
    return TrainState(whole, cast(Any, devices.split()), whole, whole)


def _check_split(config: TrainConfig, devices: int) -> None:
    if config.environments % devices:
        raise ConfigError(
            f"environments is {config.environments}; expected a multiple of {devices} devices"
        )
    minibatch, segment = config.ppo.minibatch, config.ppo.segment
    if config.algorithm == PPO and minibatch % (devices * segment):
        raise ConfigError(
            f"ppo.minibatch is {minibatch}; expected a multiple of {devices} devices times "
            f"segment, {devices * segment}"
        )


def network_input(
    state: surrogate.State,
    aircraft: Aircraft,
    network: NetworkConfig,
    noise: Float[Array, "4 N K"] | None = None,
) -> NetworkInput:
    """Return what the networks take of encounters ``[N]`` with K intruders.

    The aircraft's limits are floats or ``[N]``; the noise of the reports is standard normal, or
    None.
    """
    if network.feature_set != "set":
        return derive(surrogate.observe(state, aircraft, noise), network.feature_set)
    intruders = perceive_intruders(state, noise, aircraft.dt, jnp)
    where = (state.goal_x, state.goal_y, aircraft.limits, aircraft.separation)
    inputs = network.input_table()
    mask = known_intruders(state, aircraft, jnp)
    scenes = scene(state.own, intruders, mask, *where, jnp)
    return set_inputs(
        scenes._replace(distance_scale=distance_scales(state, aircraft, jnp)), jnp, inputs
    )


def fly(
    policy: Callable[[surrogate.State], Float[Array, "N 2"]],
    encounter: Encounter,
    world: surrogate.World,
) -> Outcome:
    """Fly encounters ``[N]`` to their end with a deterministic policy, states -> actions.

    The time limit must be a whole number of steps, known when this is compiled.
    """
    none = jnp.zeros(encounter.goal_x.shape, bool)

    def forward(carry: tuple[surrogate.State, jax.Array, Outcome], _: None) -> tuple[Any, None]:
        state, ended, outcome = carry
        action = policy(state)
        state, result = surrogate.step(state, (action[:, 0], action[:, 1]), world)
        outcome = Outcome(
            *(before | (new & ~ended) for before, new in zip(outcome, result.outcome, strict=True))
        )
        return (state, ended | result.outcome.ended(jnp), outcome), None

    begin = (surrogate.reset(encounter), none, Outcome(none, none, none))
    steps = round(world.rules.t_max / world.rules.dt)
    (_, _, outcome), _ = jax.lax.scan(forward, begin, None, length=steps)
    return outcome


def _training_environment(
    config: TrainConfig, world: surrogate.World, pool: surrogate.State, scenarios: list[Scenario]
) -> Environment:
    """Return the surrogate with the scaled table of rewards; an encounter that ends restarts from
    the pool's row.
    """
    rewards, discount, scale = config.rewards.table(), config.discount, config.reward_scale

    def observe(state: surrogate.State, key: PRNGKeyArray) -> NetworkInput:
        noise = jax.random.normal(key, (4, *state.mask.shape)) if noisy(scenarios) else None
        return network_input(state, world.aircraft, config.network, noise)

    def step(
        state: surrogate.State, action: Float[Array, "N 2"]
    ) -> tuple[surrogate.State, RolloutStep]:
        command = action[:, 0], action[:, 1]
        following, result = surrogate.step(state, command, world)
        moved = Transition(state, following, command, result, world.aircraft)
        reward, context = learning_reward(rewards, moved, discount, jnp, scale)
        # Of the user's own terms alone: more results of a step change how the compiler rounds it,
        # and with it every training of the toolkit's own table.
        own = {name: values for name, values in context.items() if name not in TERMS}
        statistics = _Statistics(result.reward, result.outcome, own)
        return following, RolloutStep(reward, following.ended, statistics)

    def restart(state: surrogate.State, index: Int[Array, ""]) -> surrogate.State:
        return surrogate.restart(
            state, jax.tree.map(lambda rows: rows[index % config.pool_rows], pool)
        )

    return Environment(observe, step, restart)


class _Statistics(NamedTuple):
    """Of the steps of a rollout."""

    sparse: Float[Array, "T N"]  # reward of the task, points
    outcome: Outcome  # [T, N]
    own: dict[str, Float[Array, "T N"]]  # what each term of the user's own adds, scaled


def _rewards(of: _Statistics, config: TrainConfig, steps: int, axis: str | None) -> Figures:
    """Return what rows of the table of rewards gave a time step of the rollout, points: those of
    the task, and of the user's own.
    """
    ends = {
        "violation": of.outcome.violation,
        "goal": of.outcome.reached,
        "timeout": of.outcome.timeout,
    }
    rows = [row for row in config.rewards.table().rows if row.name in ends]
    sums = {row.name: row.weight * _sum(ends[row.name], axis) for row in rows}
    scale = config.reward_scale
    sums |= {name: _sum(values, axis) / scale for name, values in of.own.items()}
    return {f"{OF_REWARDS}{name}": total / steps for name, total in sums.items()}


def _sum(values: Shaped[Array, "T N"], axis: str | None) -> Shaped[Array, ""]:
    return jnp.sum(values) if axis is None else jax.lax.psum(jnp.sum(values), axis)


def _episodes(of: _Statistics, steps: int, axis: str | None) -> Figures:
    """Return the sums over the episodes that ended in the rollout; not-a-number where none did."""
    reward, outcome = of.sparse, of.outcome

    def total(values: Shaped[Array, "T N"]) -> Shaped[Array, ""]:
        return _sum(values, axis)

    episodes = total(outcome.ended(jnp))
    return {
        "episodes": episodes,
        # The sparse reward comes with an episode's last step, so its sum is the sum of the returns.
        "score": total(reward) / episodes,
        "success": total(outcome.reached) / episodes,
        "violation": total(outcome.violation) / episodes,
        "timeout": total(outcome.timeout) / episodes,
        "episode_length": steps / episodes,
    }
