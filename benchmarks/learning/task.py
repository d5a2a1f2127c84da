"""Our training task as a peer sees it: the same encounters, rewards, shaping and restarts, a compiled call a step.

It is put together from the functions that our own training is made of, and a test holds both to the same rewards and
inputs. What a peer gets is the cheapest form: the first layer's inputs are derived once a step in that call, where
our networks derive them anew in every epoch.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from agents.config.load import ConfigError
from agents.learning.networks import derived
from envs import surrogate
from rlcas_jax.config import TrainConfig
from rlcas_jax.shaping import learning_reward
from rlcas_jax.starts import draw, near_limit, noisy

__all__ = ["TrainingFlight", "check"]


def check(config: TrainConfig) -> None:
    """Raise :class:`ConfigError` where the task has noisy or late reports."""
    for number, entry in enumerate(config.scenarios):
        if noisy([entry.scenario()]):
            raise ConfigError(
                f"scenarios.{number}: {entry.name} has noisy or late reports; "
                "expected scenarios with perfect ones, as the comparison with peers flies no others"
            )


class TrainingFlight:
    """The environments of a training configuration, :class:`benchmarks.learning.sb3.Flying`.

    Starts come from a pool that is drawn anew for every rollout, as in our training. Scores are counted on the way.

    Args:
        config: of the training; without noisy or late reports.
    """

    render_mode = None

    def __init__(self, config: TrainConfig) -> None:
        check(config)
        self._config = config
        self.returns = 0.0
        """Sum of the sparse, unscaled rewards since the last :meth:`flown`."""
        self.episodes = 0
        """Episodes that have ended since then."""
        self._draw, self._begin, self._step = _compiled(config)

    def reset(self) -> np.ndarray:
        """Begin anew from the configuration's seed and return the inputs of the first layer, ``[N, F]``."""
        self._key, self._row = jax.random.key(self._config.seed), 0
        self.returns, self.episodes = 0.0, 0
        self._redraw()
        self._state, self._hand, seen = self._begin(self._pool)
        return np.array(seen)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fly on by actions ``[N, 2]``; return inputs, rewards for learning (scaled, shaped) and ends.

        Raises:
            ValueError: an action is not finite.
        """
        if not np.isfinite(actions).all():
            raise ValueError("an action is not finite")
        self._row += 1
        if self._row == self._config.ppo.rollout:
            self._redraw()
            self._row = 0
        row = self._row % self._config.pool_rows
        self._state, self._hand, seen, packed = self._step(self._state, self._hand, actions, self._pool, row)
        reward, sparse, ended = np.asarray(packed).T
        done = ended > 0.0
        self.returns += float(sparse.sum(dtype=np.float64))
        self.episodes += int(np.count_nonzero(done))
        return np.array(seen), reward.copy(), done

    def flown(self) -> tuple[float, int]:
        """Return the sum of the sparse rewards and the number of episodes ended since the last call."""
        counted = self.returns, self.episodes
        self.returns, self.episodes = 0.0, 0
        return counted

    def _redraw(self) -> None:
        self._key, now = jax.random.split(self._key)
        self._pool = self._draw(now)


def _compiled(config: TrainConfig) -> tuple[Any, Any, Any]:
    """Return the functions that draw a pool, begin from its first row, and fly a step."""
    feature_set = config.network.feature_set
    world = surrogate.World(config.world.rules(), config.world.limits())
    scenarios = [entry.scenario() for entry in config.scenarios]
    hard = near_limit(config)

    def seen(state: surrogate.State) -> tuple[jax.Array, jax.Array]:
        inputs, hand = derived(surrogate.observe(state), feature_set)
        return hand, inputs

    def drawn(key: jax.Array) -> surrogate.State:
        return draw(key, config, scenarios, config.pool_rows, hard)

    def begin(pool: surrogate.State) -> tuple[surrogate.State, jax.Array, jax.Array]:
        state = jax.tree.map(lambda rows: rows[0], pool)
        return state, *seen(state)

    def step(
        state: surrogate.State, hand: jax.Array, action: jax.Array, pool: surrogate.State, row: int
    ) -> tuple[surrogate.State, jax.Array, jax.Array, jax.Array]:
        moved, result = surrogate.step(state, (action[:, 0], action[:, 1] * hand), world)
        reward = learning_reward(result.reward, state, moved, action[:, 1], config)
        # The barrier keeps the compiler from flying the step again for every field that the restart chooses.
        moved, reward = jax.lax.optimization_barrier((moved, reward))
        following = surrogate.restart(moved, jax.tree.map(lambda rows: rows[row], pool))
        return following, *seen(following), jnp.stack([reward, result.reward, moved.ended], axis=-1)

    return jax.jit(drawn), jax.jit(begin), jax.jit(step, donate_argnums=0)
