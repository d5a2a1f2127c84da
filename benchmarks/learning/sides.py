"""The learners that are compared: our PPO, Stable-Baselines3's and SBX's, one update at a time.

All have the same networks (widths, tanh, orthogonal initialisation), inputs, rewards, discount,
clipping, Adam and learning rate; each shuffles, clips gradients and steps as its own code does. SBX
has an optimiser for each network and clips their gradients apart. Peers need the extra ``peers``.

The peers fly our training task: the same encounters, rewards, shaping and restarts, a compiled call
a step, put together from the functions that our own training is made of; a test holds both to the
same rewards and inputs. What a peer gets is the cheapest form: the first layer's inputs are derived
once a step in that call, where our networks derive them anew in every epoch.
"""

import contextlib
import copy
import importlib
import importlib.util
import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from agents.config.load import ConfigError
from agents.learning.networks import derive
from agents.policy import features
from benchmarks.learning import sb3 as sb3_task
from benchmarks.learning.curves import Episodes
from benchmarks.learning.sb3 import Cell
from envs import surrogate
from envs.rewards import Transition, learning_reward
from rlcas_jax import task
from rlcas_jax.config import TrainConfig
from rlcas_jax.starts import draw, noisy

__all__ = [
    "LEARNERS",
    "PACKAGES",
    "DivergedError",
    "Side",
    "TrainingFlight",
    "available",
    "check",
    "side",
    "updates",
]

LEARNERS = {"ours": "this toolkit", "sb3": "Stable-Baselines3", "sbx": "SBX"}
"""What is compared, by the name on the command line."""

PACKAGES = {
    "ours": ("jax", "jaxlib", "flax", "optax"),
    "sb3": ("stable-baselines3", "torch"),
    "sbx": (
        "sbx-rl",
        "stable-baselines3",
        "torch",
        "jax",
        "jaxlib",
        "flax",
        "optax",
        "tfp-nightly",
    ),
}
"""Distributions whose versions decide a learner's figures."""

_MODULES = {
    "ours": (),
    "sb3": ("stable_baselines3", "torch"),
    "sbx": ("sbx", "stable_baselines3", "torch"),
}


class DivergedError(RuntimeError):
    """A loss or a parameter is no longer finite."""


class Side(Protocol):
    """A learner at work."""

    def start(self) -> None:
        """Compile, warm up and return to the beginning of the training."""
        ...

    def update(self) -> Episodes:
        """Fly a rollout and learn from it.

        Raises:
            DivergedError: a loss or a parameter is no longer finite.
        """
        ...


def available(learner: str) -> bool:
    """Return whether what a learner needs is installed."""
    return all(importlib.util.find_spec(name) is not None for name in _MODULES[learner])


def side(learner: str, config: TrainConfig) -> Side:
    """Return one of :data:`LEARNERS` for a configuration."""
    return _Ours(config) if learner == "ours" else _Peer(config, learner)


def updates(config: TrainConfig) -> int:
    """Return the number of updates of a training, at least one."""
    return max(1, config.steps // config.samples)


class _Ours:
    """Our training without checkpoints, evaluations and log."""

    def __init__(self, config: TrainConfig) -> None:
        self._task = task.build(config)
        self._state: Any = None

    def start(self) -> None:
        jax.block_until_ready(self._task.update(self._task.initial()))
        self._state = jax.block_until_ready(self._task.initial())

    def update(self) -> Episodes:
        self._state, compiled = self._task.update(self._state)
        jax.block_until_ready(self._state)
        figures = jax.device_get(compiled)
        if not figures["finite"]:
            raise DivergedError
        episodes = int(figures["episodes"])
        return Episodes(
            self._task.steps_per_update,
            float(figures["score"]) * episodes if episodes else 0.0,
            episodes,
        )


class _Peer:
    """A peer's PPO in our task; its learning rate follows our schedule."""

    def __init__(self, config: TrainConfig, learner: str) -> None:
        self._config, self._updates_made, self._updates = config, 0, updates(config)
        self._flight = TrainingFlight(config)
        environments, width = config.environments, features.size(config.network.feature_set)
        self._cell = Cell(environments, config.rollout, config.ppo.minibatch, config.ppo.epochs)
        flying = sb3_task.in_peers_form(self._flight, environments, width)
        if learner == "sb3":
            self._model = sb3_task.algorithm(config, self._cell, flying, self._rate)
            self._weights: _Weights = _TorchWeights(self._model)
        else:
            self._model = _sbx(config, self._cell, flying, self._rate)
            self._weights = _JaxWeights(self._model)

    def start(self) -> None:
        begin = self._weights.get()
        # Only what compiles counts here: a learner that diverges does so again in its training.
        with contextlib.suppress(DivergedError):
            self._learn()
        self._weights.set(begin)
        self._updates_made = 0

    def update(self) -> Episodes:
        self._learn()
        self._updates_made += 1
        return Episodes(self._cell.samples, *self._flight.take_episodes())

    def _learn(self) -> None:
        """Make one update.

        Raises:
            DivergedError: the weights are not finite.
        """
        try:
            self._model.learn(
                self._cell.samples, log_interval=None, reset_num_timesteps=self._updates_made == 0
            )
        except ValueError:
            # What torch and the task say of a distribution or an action that is not finite;
            # anything else is a defect.
            if self._weights.finite():
                raise
            raise DivergedError from None
        if not self._weights.finite():
            raise DivergedError

    def _rate(self, _: float) -> float:
        first, last = self._config.learning_rate, self._config.learning_rate_final
        return first + (last - first) * self._updates_made / self._updates


class _Weights(Protocol):
    """The parameters and the optimiser's state of a peer."""

    def get(self) -> Any: ...

    def set(self, state: Any) -> None: ...

    def finite(self) -> bool: ...


class _TorchWeights:
    def __init__(self, model: Any) -> None:
        self._policy = model.policy

    def get(self) -> Any:
        return copy.deepcopy((self._policy.state_dict(), self._policy.optimizer.state_dict()))

    def set(self, state: Any) -> None:
        weights, optimizer = state
        self._policy.load_state_dict(weights)
        self._policy.optimizer.load_state_dict(optimizer)

    def finite(self) -> bool:
        return all(bool(weight.isfinite().all()) for weight in self._policy.parameters())


class _JaxWeights:
    def __init__(self, model: Any) -> None:
        self._policy = model.policy

    def get(self) -> Any:
        return self._policy.actor_state, self._policy.vf_state

    def set(self, state: Any) -> None:
        self._policy.actor_state, self._policy.vf_state = state

    def finite(self) -> bool:
        weights = jax.device_get((self._policy.actor_state.params, self._policy.vf_state.params))
        return all(np.isfinite(weight).all() for weight in jax.tree.leaves(weights))


def _sbx(config: TrainConfig, cell: Cell, flying: Any, rate: Callable[[float], float]) -> Any:
    """Return ``sbx.PPO`` with the configuration's networks, their initialisation and numbers."""
    peer: Any = importlib.import_module("sbx")
    model = peer.PPO(
        "MlpPolicy",
        flying,
        learning_rate=rate,
        **sb3_task.numbers(config, cell, jnp.tanh),
    )
    sb3_task.keep_no_log(model)
    # It would begin with smaller weights: it has an option for the actor's head alone.
    actor_key, critic_key = jax.random.split(jax.random.key(config.seed))
    policy = model.policy
    policy.actor_state = policy.actor_state.replace(
        params=_orthogonal(policy.actor_state.params, actor_key, 0.01)
    )
    policy.vf_state = policy.vf_state.replace(
        params=_orthogonal(policy.vf_state.params, critic_key, 1.0)
    )
    return model


def _orthogonal(variables: Any, key: jax.Array, head_gain: float) -> Any:
    """Return flax variables ``Dense_0, Dense_1, ...`` with orthogonal kernels, as our networks
    begin.
    """
    layers = dict(variables["params"])
    names = sorted(
        (name for name in layers if name.startswith("Dense_")),
        key=lambda name: int(name.split("_")[1]),
    )
    for name, own in zip(names, jax.random.split(key, len(names)), strict=True):
        gain = head_gain if name == names[-1] else math.sqrt(2.0)
        kernel = jax.nn.initializers.orthogonal(gain)(own, layers[name]["kernel"].shape)
        layers[name] = {"kernel": kernel, "bias": jnp.zeros_like(layers[name]["bias"])}
    return variables | {"params": layers}


def check(config: TrainConfig) -> None:
    """Raise :class:`ConfigError` where the task has noisy or late reports, or the network takes no
    single vector.
    """
    if config.network.feature_set == "set":
        raise ConfigError(
            "network.feature_set is set; expected none or mirror, as peers take one vector"
        )
    for number, entry in enumerate(config.training_scenarios()):
        if noisy([entry]):
            raise ConfigError(
                f"scenarios.{number}: {entry.name} has noisy or late reports; "
                "expected scenarios with perfect ones, as the comparison with peers flies no others"
            )


class TrainingFlight:
    """The environments of a training configuration, :class:`benchmarks.learning.sb3.Flying`.

    Starts come from a pool that is drawn anew for every rollout, as in our training. Scores are
    counted meanwhile.

    Args:
        config: of the training; without noisy or late reports.
    """

    render_mode = None

    def __init__(self, config: TrainConfig) -> None:
        check(config)
        self._config = config
        self.returns = 0.0
        """Sum of the sparse, unscaled rewards since the last :meth:`take_episodes`."""
        self.episodes = 0
        """Episodes that have ended since then."""
        self._world = _compile(config)

    def reset(self) -> np.ndarray:
        """Begin anew from the configuration's seed and return the inputs of the first layer, ``[N,
        F]``.
        """
        self._key, self._row = jax.random.key(self._config.seed), 0
        self.returns, self.episodes = 0.0, 0
        self._redraw()
        self._state, self._mirror_sign, inputs = self._world.begin(self._pool)
        return np.array(inputs)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fly on by actions ``[N, 2]``; return inputs, rewards for learning (scaled, shaped) and
        ends.

        Raises:
            ValueError: an action is not finite.
        """
        if not np.isfinite(actions).all():
            raise ValueError("an action is not finite")
        self._row += 1
        if self._row == self._config.rollout:
            self._redraw()
            self._row = 0
        row = self._row % self._config.pool_rows
        observed, results = self._world.step(
            self._state, self._mirror_sign, actions, self._pool, row
        )
        self._state, self._mirror_sign, inputs = observed
        reward, sparse, ended = np.asarray(results).T
        terminated = ended > 0.0
        self.returns += float(sparse.sum(dtype=np.float64))
        self.episodes += int(np.count_nonzero(terminated))
        return np.array(inputs), reward.copy(), terminated

    def take_episodes(self) -> tuple[float, int]:
        """Return the sum of the sparse rewards and the number of episodes ended since the last
        call.
        """
        counted = self.returns, self.episodes
        self.returns, self.episodes = 0.0, 0
        return counted

    def _redraw(self) -> None:
        self._key, key = jax.random.split(self._key)
        self._pool = self._world.draw(key)


class _World(NamedTuple):
    """The compiled functions of the training's world."""

    draw: Callable[[PRNGKeyArray], surrogate.State]
    """Draws a pool of starts, ``[rows, N]``."""
    begin: Callable[[surrogate.State], "_Observed"]
    """Begins with the first row of a pool."""
    step: Callable[..., tuple["_Observed", Float[Array, "N 3"]]]
    """(state, mirror signs, actions, pool, row) -> what follows; rewards for learning, sparse
    rewards, and which encounters ended.
    """


class _Observed(NamedTuple):
    """Encounters, and what is seen of them."""

    state: surrogate.State
    mirror_sign: Float[Array, " N"]
    """Sign of the turn rates by which each is flown: -1 where the network sees it mirrored."""
    inputs: Float[Array, "N F"]
    """Of the first layer."""


def _compile(config: TrainConfig) -> _World:
    """Compile the world of a configuration."""
    world = surrogate.World(config.rules(), config.aircraft.aircraft())
    draw_pool = partial(
        draw, config=config, scenarios=config.training_scenarios(), rows=config.pool_rows
    )
    return _World(
        jax.jit(draw_pool),
        jax.jit(partial(_begin, config, world)),
        jax.jit(partial(_step, config, world), donate_argnums=0),
    )


def _see(config: TrainConfig, world: surrogate.World, state: surrogate.State) -> _Observed:
    inputs = derive(surrogate.observe(state, world.aircraft), config.network.feature_set)
    return _Observed(state, inputs.mirror_sign, inputs.own)


def _begin(config: TrainConfig, world: surrogate.World, pool: surrogate.State) -> _Observed:
    return _see(config, world, jax.tree.map(lambda rows: rows[0], pool))


def _step(
    config: TrainConfig,
    world: surrogate.World,
    state: surrogate.State,
    mirror_sign: Float[Array, " N"],
    action: Float[Array, "N 2"],
    pool: surrogate.State,
    row: int,
) -> tuple[_Observed, Float[Array, "N 3"]]:
    command = action[:, 0], action[:, 1] * mirror_sign
    moved, result = surrogate.step(state, command, world)
    transition = Transition(state, moved, command, result, world.aircraft)
    reward, _ = learning_reward(
        config.rewards.table(), transition, config.discount, jnp, config.reward_scale
    )
    # The barrier keeps the compiler from flying the step again for every field that the restart
    # chooses.
    moved, reward = jax.lax.optimization_barrier((moved, reward))
    following = surrogate.restart(moved, jax.tree.map(lambda rows: rows[row], pool))
    results = jnp.stack([reward, result.reward, moved.ended], axis=-1)
    return _see(config, world, following), results
