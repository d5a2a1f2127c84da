"""The learners that are compared: our PPO, Stable-Baselines3's and SBX's, one update at a time.

All have the same networks (widths, tanh, orthogonal initialisation), inputs, rewards, discount, clipping, Adam and
learning rate; each shuffles, clips gradients and steps as its own code does. SBX has an optimiser for each network and
clips their gradients apart. Peers need the extra ``peers``.
"""

import copy
import importlib
import importlib.util
import math
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from agents.policy import features
from benchmarks.learning import sb3 as sb3_task
from benchmarks.learning.curves import Flown
from benchmarks.learning.sb3 import Cell
from benchmarks.learning.task import TrainingFlight
from rlcas_jax import task
from rlcas_jax.config import TrainConfig

__all__ = ["LEARNERS", "PACKAGES", "DivergedError", "Side", "available", "side", "updates"]

LEARNERS = {"ours": "this toolkit", "sb3": "Stable-Baselines3", "sbx": "SBX"}
"""What is compared, by the name on the command line."""

PACKAGES = {
    "ours": ("jax", "jaxlib", "flax", "optax"),
    "sb3": ("stable-baselines3", "torch"),
    "sbx": ("sbx-rl", "stable-baselines3", "torch", "jax", "jaxlib", "flax", "optax", "tfp-nightly"),
}
"""Distributions whose versions decide a learner's figures."""

_MODULES = {"ours": (), "sb3": ("stable_baselines3", "torch"), "sbx": ("sbx", "stable_baselines3", "torch")}


class DivergedError(RuntimeError):
    """A loss or a parameter is no longer finite."""


class Side(Protocol):
    """A learner at work."""

    def start(self) -> None:
        """Compile, warm up and return to the beginning of the training."""
        ...

    def update(self) -> Flown:
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
    return max(1, config.steps // config.ppo.samples)


class _Ours:
    """Our training without checkpoints, evaluations and log."""

    def __init__(self, config: TrainConfig) -> None:
        self._task = task.build(config)
        self._state: Any = None

    def start(self) -> None:
        jax.block_until_ready(self._task.update(self._task.initial()))
        self._state = jax.block_until_ready(self._task.initial())

    def update(self) -> Flown:
        self._state, compiled = self._task.update(self._state)
        jax.block_until_ready(self._state)
        figures = jax.device_get(compiled)
        if not figures["finite"]:
            raise DivergedError
        episodes = int(figures["episodes"])
        return Flown(self._task.steps_per_update, float(figures["score"]) * episodes if episodes else 0.0, episodes)


class _Peer:
    """A peer's PPO in our task; its learning rate follows our schedule."""

    def __init__(self, config: TrainConfig, learner: str) -> None:
        self._config, self._done, self._updates = config, 0, updates(config)
        self._flight = TrainingFlight(config)
        environments, width = config.ppo.environments, features.size(config.network.feature_set)
        self._cell = Cell(environments, config.ppo.rollout, config.ppo.minibatch, config.ppo.epochs)
        flown = sb3_task.in_peers_form(self._flight, environments, width)
        if learner == "sb3":
            self._model = sb3_task.algorithm(config, self._cell, flown, self._rate)
            self._weights: _Weights = _TorchWeights(self._model)
        else:
            self._model = _sbx(config, self._cell, flown, self._rate)
            self._weights = _JaxWeights(self._model)

    def start(self) -> None:
        begin = self._weights.get()
        self._learn()
        self._weights.set(begin)
        self._done = 0

    def update(self) -> Flown:
        try:
            self._learn()
        except ValueError:
            # What torch and the task say of a distribution or an action that is not finite; anything else is a defect.
            if self._weights.finite():
                raise
            raise DivergedError from None
        if not self._weights.finite():
            raise DivergedError
        self._done += 1
        return Flown(self._cell.samples, *self._flight.flown())

    def _learn(self) -> None:
        self._model.learn(self._cell.samples, log_interval=None, reset_num_timesteps=self._done == 0)

    def _rate(self, _: float) -> float:
        first, last = self._config.ppo.learning_rate, self._config.ppo.learning_rate_final
        return first + (last - first) * self._done / self._updates


class _Weights(Protocol):
    """The parameters and the optimiser's state of a peer."""

    def get(self) -> Any: ...

    def set(self, kept: Any) -> None: ...

    def finite(self) -> bool: ...


class _TorchWeights:
    def __init__(self, model: Any) -> None:
        self._policy = model.policy

    def get(self) -> Any:
        return copy.deepcopy((self._policy.state_dict(), self._policy.optimizer.state_dict()))

    def set(self, kept: Any) -> None:
        weights, optimizer = kept
        self._policy.load_state_dict(weights)
        self._policy.optimizer.load_state_dict(optimizer)

    def finite(self) -> bool:
        return all(bool(weight.isfinite().all()) for weight in self._policy.parameters())


class _JaxWeights:
    def __init__(self, model: Any) -> None:
        self._policy = model.policy

    def get(self) -> Any:
        return self._policy.actor_state, self._policy.vf_state

    def set(self, kept: Any) -> None:
        self._policy.actor_state, self._policy.vf_state = kept

    def finite(self) -> bool:
        weights = jax.device_get((self._policy.actor_state.params, self._policy.vf_state.params))
        return all(np.isfinite(weight).all() for weight in jax.tree.leaves(weights))


def _sbx(config: TrainConfig, cell: Cell, flown: Any, rate: Any) -> Any:
    """Return ``sbx.PPO`` with the configuration's networks, their initialisation and numbers."""
    peer: Any = importlib.import_module("sbx")
    model = peer.PPO(
        "MlpPolicy",
        flown,
        learning_rate=rate,
        **sb3_task.numbers(config, cell, jnp.tanh),
    )
    # It would begin with smaller weights: it has an option for the actor's head alone.
    actor_key, critic_key = jax.random.split(jax.random.key(config.seed))
    policy = model.policy
    policy.actor_state = policy.actor_state.replace(params=_orthogonal(policy.actor_state.params, actor_key, 0.01))
    policy.vf_state = policy.vf_state.replace(params=_orthogonal(policy.vf_state.params, critic_key, 1.0))
    return model


def _orthogonal(variables: Any, key: jax.Array, head_gain: float) -> Any:
    """Return flax variables ``Dense_0, Dense_1, ...`` with orthogonal kernels, as our networks begin."""
    layers = dict(variables["params"])
    names = sorted((name for name in layers if name.startswith("Dense_")), key=lambda name: int(name.split("_")[1]))
    for name, own in zip(names, jax.random.split(key, len(names)), strict=True):
        gain = head_gain if name == names[-1] else math.sqrt(2.0)
        kernel = jax.nn.initializers.orthogonal(gain)(own, layers[name]["kernel"].shape)
        layers[name] = {"kernel": kernel, "bias": jnp.zeros_like(layers[name]["bias"])}
    return variables | {"params": layers}
