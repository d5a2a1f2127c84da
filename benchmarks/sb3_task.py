"""Stable-Baselines3's PPO on our task: the thin layer that feeds it from our vector environment.

What it gets is the cheapest form of the same work. The first layer's derived inputs are computed once a step by one
compiled call outside its networks, where ours are computed anew in every epoch; the time limit ends an episode for
good, as in our training, so it never evaluates a final observation; infos are shared empty dictionaries. Reward
shaping is left out. Needs the extra ``peers``.
"""

import importlib
import importlib.util
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces

from agents import features
from envs.gymnasium_vector import DeconflictionVectorEnv
from envs.observation import SIZE
from rlcas_jax.config import TrainConfig

__all__ = ["DEFAULTS", "INSTALL", "Cell", "algorithm", "available", "environment"]

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
    return all(importlib.util.find_spec(name) is not None for name in ("stable_baselines3", "torch"))


@partial(jax.jit, static_argnames="feature_set")
def _inputs(observation: jax.Array, feature_set: str) -> jax.Array:
    return jnp.stack(features.features([observation[:, i] for i in range(SIZE)], feature_set, jnp), axis=-1)


def _mirrored_back(actions: np.ndarray, observation: np.ndarray, feature_set: str) -> np.ndarray:
    """Return the actions ``[N, 2]`` in the scene as it is, not as the network saw it."""
    actions = np.array(actions, np.float32)
    actions[:, 1] *= features.side(list(observation.T), feature_set, np)
    return actions


def environment(config: TrainConfig, count: int) -> Any:
    """Return our vector environment as a ``stable_baselines3.common.vec_env.VecEnv``.

    Its observations are the inputs of our networks' first layer, its rewards are scaled as in our training. It flies
    the first scenario of the configuration.

    Args:
        config: of the training.
        count: number of environments.
    """
    base: Any = importlib.import_module("stable_baselines3.common.vec_env").VecEnv
    feature_set, scale = config.network.feature_set, config.ppo.reward_scale
    flying = DeconflictionVectorEnv(
        count, config.scenarios[0].scenario(), rules=config.world.rules(), limits=config.world.limits()
    )
    nothing: list[dict[str, Any]] = [{}] * count

    class Task(base):
        """The vector environment in the peer's form."""

        def __init__(self) -> None:
            width = features.size(feature_set)
            seen = spaces.Box(-np.inf, np.inf, (width,), np.float32)
            super().__init__(count, seen, flying.single_action_space)
            self._actions = np.zeros((count, 2), np.float32)
            self._seen = np.zeros((count, SIZE), np.float32)

        def reset(self) -> np.ndarray:
            self._seen = np.asarray(flying.reset(seed=config.seed)[0])
            return np.array(_inputs(self._seen, feature_set))

        def step_async(self, actions: np.ndarray) -> None:
            self._actions = _mirrored_back(actions, self._seen, feature_set)

        def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
            seen, reward, terminated, truncated, _ = flying.step(self._actions)
            self._seen = np.asarray(seen)
            return np.array(_inputs(self._seen, feature_set)), scale * reward, terminated | truncated, nothing

        def close(self) -> None:
            flying.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(flying, attr_name)] * count

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise TypeError("the benchmark does not reach into single environments")

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
            raise TypeError("the benchmark does not reach into single environments")

        def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
            return [False] * count

    return Task()


def algorithm(config: TrainConfig, cell: Cell) -> Any:
    """Return ``stable_baselines3.PPO`` with the configuration's networks and numbers, on the CPU.

    Each ``learn(cell.samples, log_interval=None, reset_num_timesteps=False)`` is one rollout and one update.
    """
    torch: Any = importlib.import_module("torch")
    peer: Any = importlib.import_module("stable_baselines3")
    hidden = list(config.network.hidden)
    return peer.PPO(
        "MlpPolicy",
        environment(config, cell.environments),
        learning_rate=config.ppo.learning_rate,
        n_steps=cell.steps,
        batch_size=cell.batch,
        n_epochs=cell.epochs,
        gamma=config.ppo.discount,
        gae_lambda=config.ppo.gae_lambda,
        clip_range=config.ppo.clip,
        ent_coef=config.ppo.entropy,
        vf_coef=config.ppo.value,
        max_grad_norm=config.ppo.max_grad_norm,
        normalize_advantage=config.ppo.normalize_advantage,
        policy_kwargs={
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": torch.nn.Tanh,
            "log_std_init": config.network.log_std_initial,
            "optimizer_kwargs": {"eps": config.ppo.adam_epsilon},
        },
        seed=config.seed,
        device="cpu",
    )
