"""Stable-Baselines3's PPO on our task: the thin layer that feeds it from our vector environment.

What it gets is the cheapest form of the same work. The first layer's derived inputs are computed
once a step by one compiled call outside its networks, where ours are computed anew in every epoch;
the time limit ends an episode for good, as in our training, so it never evaluates a final
observation; infos are shared empty dictionaries. Reward shaping is left out of :func:`environment`;
:mod:`benchmarks.learning.sides` has it. Needs the extra ``peers``.
"""

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces

from agents.learning.networks import Actor
from agents.policy import features
from envs.gym.gymnasium_contract import action_space
from envs.gym.gymnasium_vector import DeconflictionVectorEnv
from envs.observation import SIZE
from rlcas_jax.config import TrainConfig

__all__ = [
    "DEFAULTS",
    "INSTALL",
    "Cell",
    "Flying",
    "algorithm",
    "available",
    "environment",
    "in_peers_form",
    "keep_no_log",
    "numbers",
]

INSTALL = "pip install -c constraints/peers.txt '.[peers]'"
"""How to get Stable-Baselines3."""


@dataclass(frozen=True)
class Cell:
    """One setting in which Stable-Baselines3 is measured."""

    environments: int
    steps: int
    """Time steps of a rollout (``n_steps``)."""
    batch: int
    epochs: int

    @property
    def samples(self) -> int:
        """Samples of a rollout."""
        return self.environments * self.steps

    def __str__(self) -> str:
        """Return a short name for tables."""
        return f"batch {self.batch}, {self.environments} env x {self.steps}, {self.epochs} epochs"


DEFAULTS = Cell(environments=1, steps=2048, batch=64, epochs=10)
"""Stable-Baselines3's own defaults for PPO."""


def available() -> bool:
    """Return whether the extra ``peers`` is installed."""
    return all(
        importlib.util.find_spec(name) is not None for name in ("stable_baselines3", "torch")
    )


@partial(jax.jit, static_argnames="feature_set")
def _inputs(observation: jax.Array, feature_set: str) -> jax.Array:
    return jnp.stack(
        features.features([observation[:, i] for i in range(SIZE)], feature_set, jnp), axis=-1
    )


def _mirror_back(actions: np.ndarray, observation: np.ndarray, feature_set: str) -> np.ndarray:
    """Return the actions ``[N, 2]`` in the scene as it is, not as the network saw it."""
    actions = np.array(actions, np.float32)
    actions[:, 1] *= features.mirror_sign(list(observation.T), feature_set, np)
    return actions


class Flying(Protocol):
    """Many encounters as a peer sees them; an encounter that ends begins anew in the same step."""

    render_mode: None

    def reset(self) -> np.ndarray:
        """Begin all encounters anew and return the inputs of the first layer, ``[N, F]``."""
        ...

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fly on by actions ``[N, 2]``; return inputs ``[N, F]``, rewards ``[N]`` and which
        episodes ended ``[N]``.
        """
        ...


class _FirstScenario:
    """Our vector environment in the first scenario of a configuration."""

    render_mode = None

    def __init__(self, config: TrainConfig, count: int) -> None:
        self._config, self._feature_set = config, config.network.feature_set
        self._world = DeconflictionVectorEnv(
            count,
            config.training_scenarios()[0],
            aircraft=config.aircraft.aircraft(),
            rules=config.rules(),
        )
        self._observations = np.zeros((count, SIZE), np.float32)

    def reset(self) -> np.ndarray:
        self._observations = np.asarray(self._world.reset(seed=self._config.seed)[0])
        return np.array(_inputs(self._observations, self._feature_set))

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        commands = _mirror_back(actions, self._observations, self._feature_set)
        observations, reward, terminated, truncated, _ = self._world.step(commands)
        self._observations = np.asarray(observations)
        scaled = self._config.reward_scale * reward
        return (
            np.array(_inputs(self._observations, self._feature_set)),
            scaled,
            terminated | truncated,
        )


def environment(config: TrainConfig, count: int) -> Any:
    """Return our vector environment as a ``stable_baselines3.common.vec_env.VecEnv``.

    Its observations are the inputs of our networks' first layer, its rewards are scaled as in our
    training. It flies the first scenario of the configuration.

    Args:
        config: of the training.
        count: number of environments.
    """
    return in_peers_form(
        _FirstScenario(config, count), count, features.size(config.network.feature_set)
    )


def in_peers_form(flying: Flying, count: int, width: int) -> Any:
    """Return encounters as a ``stable_baselines3.common.vec_env.VecEnv``.

    Args:
        flying: the encounters.
        count: how many, N.
        width: inputs of the first layer, F.
    """
    base: Any = importlib.import_module("stable_baselines3.common.vec_env").VecEnv
    nothing: list[dict[str, Any]] = [{}] * count

    class Task(base):
        """The encounters in the peer's form."""

        def __init__(self) -> None:
            super().__init__(
                count, spaces.Box(-np.inf, np.inf, (width,), np.float32), action_space()
            )
            self._actions = np.zeros((count, 2), np.float32)

        def reset(self) -> np.ndarray:
            return flying.reset()

        def step_async(self, actions: np.ndarray) -> None:
            self._actions = actions

        def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
            return *flying.step(self._actions), nothing

        def close(self) -> None:
            pass

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(flying, attr_name)] * count

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise TypeError("the benchmark does not reach into single environments")

        def env_method(
            self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
        ) -> list[Any]:
            raise TypeError("the benchmark does not reach into single environments")

        def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
            return [False] * count

    return Task()


def numbers(config: TrainConfig, cell: Cell, activation: Any) -> dict[str, Any]:
    """Return a configuration's numbers under the names that Stable-Baselines3's and SBX's PPO
    share.

    Args:
        config: of the training.
        cell: sizes of rollout and batch, epochs.
        activation: of the hidden layers, as the peer takes it.
    """
    hidden = list(config.network.hidden)
    return {
        "n_steps": cell.steps,
        "batch_size": cell.batch,
        "n_epochs": cell.epochs,
        "gamma": config.discount,
        "gae_lambda": config.ppo.gae_lambda,
        "clip_range": config.ppo.clip,
        "ent_coef": config.ppo.entropy,
        "vf_coef": 0.5 * config.ppo.value,  # of the squared error, which our loss halves first
        "max_grad_norm": config.ppo.max_grad_norm,
        "normalize_advantage": config.ppo.normalize_advantage,
        "policy_kwargs": {
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": activation,
            "log_std_init": Actor.log_std_initial,
            "optimizer_kwargs": {"eps": config.ppo.adam_epsilon},
        },
        "seed": config.seed,
        "device": "cpu",
    }


def algorithm(
    config: TrainConfig,
    cell: Cell,
    flying: Any = None,
    rate: Callable[[float], float] | None = None,
) -> Any:
    """Return ``stable_baselines3.PPO`` with the configuration's networks and numbers, on the CPU.

    Each ``learn(cell.samples, log_interval=None, reset_num_timesteps=False)`` is one rollout and
    one update.

    Args:
        config: of the training.
        cell: sizes of rollout and batch, epochs.
        flying: its environment; that of :func:`environment` by default.
        rate: its learning rate, a function of what is left of a call of ``learn``; the
            configuration's by default.
    """
    torch: Any = importlib.import_module("torch")
    peer: Any = importlib.import_module("stable_baselines3")
    model = peer.PPO(
        "MlpPolicy",
        environment(config, cell.environments) if flying is None else flying,
        learning_rate=config.learning_rate if rate is None else rate,
        **numbers(config, cell, torch.nn.Tanh),
    )
    keep_no_log(model)
    return model


def keep_no_log(model: Any) -> None:
    """Let a learner of Stable-Baselines3 or SBX write no log: by default every call of ``learn``
    leaves a folder among the temporary files.
    """
    logger: Any = importlib.import_module("stable_baselines3.common.logger")
    model.set_logger(logger.Logger(None, []))
