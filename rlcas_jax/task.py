"""The training task: the surrogate with its mixture of encounters, and one compiled update of
everything.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
from jax.sharding import PartitionSpec

from agents.config.load import ConfigError
from agents.learning import ppo
from agents.learning.networks import Actor, Critic, NetworkInput, derived
from agents.policy.scene import scene
from agents.policy.set_features import InputTable, set_inputs
from envs import surrogate
from envs.aircraft import Aircraft
from envs.encounters import Encounter, Scenario
from envs.outcome import Outcome, Rules
from envs.rewards import TERMS, Transition, learning_reward
from envs.world import perceived
from rlcas_jax.collect import Environment, Step, collect
from rlcas_jax.config import TrainConfig
from rlcas_jax.devices import AXIS, Devices
from rlcas_jax.fleet import fleet
from rlcas_jax.starts import draw, noisy


class TrainState(NamedTuple):
    """Everything that a resumed run needs to go on exactly as an uninterrupted one."""

    learner: ppo.LearnerState
    environment: surrogate.State
    key: jax.Array  # raw key data, so that it is an array like any other
    update: jax.Array  # number of updates done


class Task(NamedTuple):
    """The compiled functions of a configuration."""

    initial: Callable[[], TrainState]
    update: Callable[[TrainState], tuple[TrainState, dict[str, jax.Array]]]  # donates its argument
    evaluate: Callable[
        [Any, Encounter], Outcome
    ]  # (actor, starts [N]) -> how they end by its means
    updates: int
    steps_per_update: int
    rules: Rules  # of the task itself, by which policies are evaluated
    placed: Any = None  # where the state's arrays belong; None on one device

    def shapes(self) -> Any:
        """Return shapes and dtypes of the state as a :class:`TrainState`."""
        return jax.eval_shape(self.initial)


def build(config: TrainConfig, devices: Devices | None = None, phase: int = 0) -> Task:
    """Assemble the task of a configuration; its functions are compiled when they are first called.

    The encounters are split over the devices, one by default, or a ConfigError says that they
    cannot be. The same are flown with the same draws whatever the devices' number; each device
    shuffles its own. A phase has draws of its own.
    """
    devices = Devices(None) if devices is None else devices
    _check_split(config, devices.count)
    settings = ppo_settings(config)
    network = config.network
    hidden, encoder = tuple(network.hidden), tuple(network.encoder)
    feature_set, inputs = network.feature_set, network.input_table()
    actor = Actor(hidden, feature_set, encoder=encoder)
    parts = ppo.learner(actor, Critic(hidden, feature_set, encoder), settings)._replace(
        axis=devices.axis
    )
    world = surrogate.World(config.rules(), config.aircraft.aircraft())
    scenarios, flown_by = config.drawn(), fleet(config)
    count, steps, axis = config.ppo.environments, config.ppo.rollout, devices.axis
    updates = max(1, config.steps // (count * steps))

    def initial() -> TrainState:
        seeded = jax.random.key(config.seed)
        seeded = jax.random.fold_in(seeded, phase) if phase else seeded
        learner_key, start_key, key = jax.random.split(seeded, 3)
        environment = jax.tree.map(lambda a: a[0], draw(start_key, config, scenarios, 1))
        first = jax.tree.map(lambda a: a[:1], environment)
        learner = ppo.initial_state(
            parts, learner_key, seen(first, world.aircraft, feature_set, inputs)
        )
        return TrainState(learner, environment, jax.random.key_data(key), jnp.zeros((), jnp.int32))

    def iterate(state: Any, drawn: _Drawn, rate: jax.Array) -> tuple[Any, dict[str, jax.Array]]:
        """Roll out and learn; on several devices with the encounters of one of them."""
        learner, flying = state
        flying_in = world._replace(
            rules=world.rules._replace(t_max=config.world.time_share * world.rules.t_max)
        )
        if flown_by.other.any():
            flying_in = flying_in._replace(
                aircraft=world.aircraft._replace(limits=drawn.fleet.limits)
            )
        environment = _training_environment(config, flying_in, drawn.pool, scenarios)
        key = (
            drawn.observe_key
            if axis is None
            else jax.random.fold_in(drawn.observe_key, jax.lax.axis_index(axis))
        )
        flown, samples, statistics, figures = collect(
            learner,
            flying,
            drawn.noise,
            key,
            environment,
            parts,
            config.ppo.discount,
            config.ppo.gae_lambda,
        )
        learner, learned = ppo.update(learner, samples, drawn.shuffle_key, rate, parts, settings)
        learned |= _episodes(statistics, count * steps, axis)
        learned |= _rewards(statistics, config, count * steps, axis)
        return (learner, flown), figures | learned

    if devices.mesh is not None:
        whole, split, second = PartitionSpec(), PartitionSpec(AXIS), PartitionSpec(None, AXIS)
        drawn_specs = _Drawn(second, second, whole, whole, split)
        # Without the check of what varies: it would add up the gradients before they can be
        # averaged by name.
        iterate = jax.shard_map(
            iterate,
            mesh=devices.mesh,
            in_specs=((whole, split), drawn_specs, whole),
            out_specs=((whole, split), whole),
            check_vma=False,
        )

    def update(state: TrainState) -> tuple[TrainState, dict[str, jax.Array]]:
        pool_key, rollout_key, shuffle_key, key = jax.random.split(
            jax.random.wrap_key_data(state.key), 4
        )
        noise_key, observe_key = jax.random.split(rollout_key)
        pool = draw(pool_key, config, scenarios, config.pool_rows)
        noise = jax.random.normal(noise_key, (steps, count, 2))
        done = state.update.astype(jnp.float32) / updates
        rate = (
            config.ppo.learning_rate
            + (config.ppo.learning_rate_final - config.ppo.learning_rate) * done
        )
        drawn = _Drawn(pool, noise, observe_key, shuffle_key, jax.tree.map(jnp.asarray, flown_by))
        (learner, flown), figures = iterate((state.learner, state.environment), drawn, rate)
        finite = jax.tree.reduce(
            jnp.logical_and, jax.tree.map(lambda p: jnp.all(jnp.isfinite(p)), learner)
        )
        std = jnp.exp(learner.actor["params"]["log_std"])
        figures |= {
            "learning_rate": rate,
            "std_acceleration": std[0],
            "std_yaw_rate": std[1],
            "finite": jnp.logical_and(finite, jnp.isfinite(figures["loss"])),
        }
        return TrainState(learner, flown, jax.random.key_data(key), state.update + 1), figures

    def evaluate(actor_variables: Any, encounter: Encounter) -> Outcome:
        def policy(state: surrogate.State) -> jax.Array:
            observation = seen(state, world.aircraft, feature_set, inputs)
            return actor.apply(actor_variables, observation)[0]

        return fly(policy, encounter, world)

    placed: Any = None
    if devices.mesh is not None:
        whole_tree: Any = devices.whole()
        placed = TrainState(whole_tree, cast(Any, devices.split()), whole_tree, whole_tree)
    return Task(
        jax.jit(initial, out_shardings=placed),
        jax.jit(
            update,
            donate_argnums=0,
            out_shardings=None if placed is None else (placed, devices.whole()),
        ),
        jax.jit(evaluate),
        updates,
        count * steps,
        world.rules,
        placed,
    )


class _Drawn(NamedTuple):
    """What is drawn for an update."""

    pool: Any  # starts, [rows, N]
    noise: Any  # of the actions, [T, N, 2]
    observe_key: Any
    shuffle_key: Any
    fleet: Any  # the ownships


def ppo_settings(config: TrainConfig) -> ppo.PpoSettings:
    """Return the settings of the algorithm under a configuration."""
    of = config.ppo
    return ppo.PpoSettings(
        epochs=of.epochs,
        minibatches=of.minibatches,
        segment=of.segment,
        clip=of.clip,
        entropy=of.entropy,
        bound=of.bound,
    )


def _check_split(config: TrainConfig, devices: int) -> None:
    of = config.ppo
    for name, value, unit in (
        ("environments", of.environments, 1),
        ("minibatch", of.minibatch, of.segment),
    ):
        if value % (devices * unit):
            what = (
                f"{devices} devices"
                if unit == 1
                else f"{devices} devices times segment, {devices * unit}"
            )
            raise ConfigError(f"ppo.{name} is {value}; expected a multiple of {what}")


def seen(
    state: surrogate.State,
    aircraft: Aircraft,
    feature_set: str,
    inputs: InputTable,
    noise: jax.Array | None = None,
) -> NetworkInput:
    """Return what networks with a feature set take of encounters ``[N]``.

    The aircraft's limits are floats or ``[N]``; noise is of the reports, standard normal ``[4, N,
    K]``, or None.
    """
    if feature_set != "set":
        return derived(surrogate.observe(state, aircraft, noise), feature_set)
    intruders = perceived(state, noise, aircraft.dt, jnp)
    where = (state.goal_x, state.goal_y, aircraft.limits, aircraft.separation)
    return set_inputs(scene(state.own, intruders, state.mask, *where, jnp), jnp, inputs)


def fly(
    policy: Callable[[surrogate.State], jax.Array], encounter: Encounter, world: surrogate.World
) -> Outcome:
    """Fly encounters ``[N]`` to their end with a deterministic policy, states -> actions ``[N,
    2]``.

    The time limit must be a whole number of steps, known when this is compiled.
    """
    none = jnp.zeros(encounter.goal_x.shape, bool)

    def forward(carry: tuple[surrogate.State, jax.Array, Outcome], _: None) -> tuple[Any, None]:
        state, ended, outcome = carry
        action = policy(state)
        state, result = surrogate.step(state, (action[:, 0], action[:, 1]), world)
        outcome = Outcome(
            *(seen | (now & ~ended) for seen, now in zip(outcome, result.outcome, strict=True))
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
    network, inputs = config.network, config.network.input_table()
    rewards, discount, scale = config.rewards.table(), config.ppo.discount, config.ppo.reward_scale

    def observe(state: surrogate.State, key: jax.Array) -> NetworkInput:
        noise = jax.random.normal(key, (4, *state.mask.shape)) if noisy(scenarios) else None
        return seen(state, world.aircraft, network.feature_set, inputs, noise)

    def step(state: surrogate.State, action: jax.Array) -> tuple[surrogate.State, Step]:
        command = action[:, 0], action[:, 1]
        following, result = surrogate.step(state, command, world)
        moved = Transition(state, following, command, result, world.aircraft)
        reward, parts = learning_reward(rewards, moved, discount, jnp, scale)
        # Of the user's own terms alone: more results of a step change how the compiler rounds it,
        # and with it every training of the toolkit's own table.
        own = {name: values for name, values in parts.items() if name not in TERMS}
        statistics = _Statistics(result.reward, result.outcome, own)
        return following, Step(reward, following.ended, statistics)

    def restart(state: surrogate.State, index: jax.Array) -> surrogate.State:
        return surrogate.restart(
            state, jax.tree.map(lambda rows: rows[index % config.pool_rows], pool)
        )

    return Environment(observe, step, restart)


class _Statistics(NamedTuple):
    """Of the steps of a rollout, ``[T, N]``."""

    sparse: jax.Array  # reward of the task, points
    outcome: Outcome
    own: dict[str, jax.Array]  # what each term of the user's own adds to the scaled reward


def _rewards(
    of: _Statistics, config: TrainConfig, steps: int, axis: str | None
) -> dict[str, jax.Array]:
    """Return what rows of the table of rewards gave a time step of the rollout, points: those of
    the task, and of the user's own.
    """
    ends = {"violation": of.outcome.violation, "goal": of.outcome.reached}
    ends |= {"timeout": of.outcome.timeout}
    rows = config.rewards.table().rows
    weights = {row.name: row.weight for row in rows if row.name in ends}
    sums = {name: weight * _sum(ends[name], axis) for name, weight in weights.items()}
    sums |= {name: _sum(values, axis) / config.ppo.reward_scale for name, values in of.own.items()}
    return {f"reward_{name}": total / steps for name, total in sums.items()}


def _sum(values: jax.Array, axis: str | None) -> jax.Array:
    return jnp.sum(values) if axis is None else jax.lax.psum(jnp.sum(values), axis)


def _episodes(of: _Statistics, steps: int, axis: str | None) -> dict[str, jax.Array]:
    """Return the sums over the episodes that ended in the rollout; not-a-number where none did."""
    reward, outcome = of.sparse, of.outcome

    def total(values: jax.Array) -> jax.Array:
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
