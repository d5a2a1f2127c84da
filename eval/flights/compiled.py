"""A policy's decisions compiled by XLA, where JAX is installed: several times as fast as in numpy.

XLA rounds a row by the size of its batch, so that rows are decided in tiles of one size. Within a
tile a row has the same bits in any place and company, which every process checks before it decides.
"""

from typing import Any, NamedTuple

import numpy as np

from agents.baselines.baselines import Observation
from agents.policy.inference import Policy
from agents.policy.scene import OWN_NUMBERS, scene, unpack_rows, width
from agents.policy.set_features import set_inputs
from agents.policy.set_network import actions
from commands.command import InputError
from commands.compiled import keep_compiled, local_devices
from envs.aircraft import Ratios, ratios
from envs.arrays import Array
from envs.trees import map_leaves, take
from eval.flights.believed import steer_alone

_TILE = 256


class _Rows(NamedTuple):
    """Scenes as the compiled function takes them, float32."""

    packed: np.ndarray  # of agents.policy.scene, [M, width]
    distance_scale: np.ndarray | None  # of each intruder, as of the scene, [M, K]


class Compiled:
    """A policy for any number of intruders as a resolver; its numbers are float32, as in numpy."""

    def __init__(self, policy: Policy) -> None:
        """Take the policy's network; raises ``InputError`` if it takes one intruder only."""
        if not policy.metadata["architecture"].get("encoder"):
            raise InputError(
                "backend is 'jax' and the policy takes one intruder only; expected numpy"
            )
        keep_compiled()
        import jax

        local_devices(jax)

        def decide_rows(weights: Any, rows: Array, distance_scale: Array | None) -> Array:
            encoder, trunk, numbers = weights
            # What hangs on the aircraft alone is computed once for all rows of a tile.
            scenes = unpack_rows(rows)._replace(
                ratios=Ratios(*numbers), distance_scale=distance_scale
            )
            inputs = set_inputs(scenes, jax.numpy, policy.inputs)
            return jax.numpy.clip(actions(inputs, encoder, trunk, jax.numpy), -1.0, 1.0)

        encoder_layers, hidden, head = (
            policy.layers(kind, np.float32) for kind in ("each", "hidden", "head")
        )
        self._policy = policy
        self._limits, self._separation = policy.aircraft.limits, policy.aircraft.separation
        numbers = np.array(ratios(self._limits, self._separation), np.float32)
        self._weights = jax.device_put((encoder_layers, hidden + head, numbers))
        self._decided = jax.jit(decide_rows)
        self._checked: set[int] = set()

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used."""
        rows, places = self._rows(observation)
        count = len(observation.mask)
        whole = -(-count // _TILE) * _TILE  # rows of full tiles
        distance_scale = None if rows.distance_scale is None else _pad(rows.distance_scale, whole)
        padded = _Rows(_pad(rows.packed, whole), distance_scale)
        tiles = [take(padded, slice(first, first + _TILE)) for first in range(0, whole, _TILE)]
        if places not in self._checked:
            self._check(tiles[0])
            self._checked.add(places)
        decided = [self._decided(self._weights, *tile) for tile in tiles]
        actions = np.concatenate([np.asarray(tile) for tile in decided])[:count]
        if not np.isfinite(actions).all():
            raise ValueError(
                "the policy gives an action that is not finite; expected finite states"
            )
        return steer_alone(actions.astype(float), observation, self._policy.aircraft), memory

    def _rows(self, observation: Observation) -> tuple[_Rows, int]:
        """Return what resolvers see as rows ``[M]``, and the number of intruders in each."""
        others, mask, distance_scale = (
            observation.intruders,
            observation.mask,
            observation.distance_scale,
        )
        if mask.shape[-1] > self._policy.most:
            critical = self._policy.most_critical(observation.own, others, mask, distance_scale)
            others, mask, distance_scale = map_leaves(
                lambda field: np.take_along_axis(field, critical, axis=-1),
                (others, mask, distance_scale),
            )
        scenes = scene(
            observation.own,
            others,
            mask,
            observation.goal_x,
            observation.goal_y,
            self._limits,
            self._separation,
            np,
        )
        count, places = mask.shape
        packed = np.zeros((count, width(places)), np.float32)
        packed[:, :3] = np.stack((scenes.own_speed, scenes.goal_x, scenes.goal_y), axis=-1)
        for i, field in enumerate((scenes.x, scenes.y, scenes.vx, scenes.vy, scenes.mask)):
            packed[:, OWN_NUMBERS + i :: 5] = field
        return _Rows(
            packed, None if distance_scale is None else distance_scale.astype(np.float32)
        ), places

    def _check(self, tile: _Rows) -> None:
        """Refuse a processor on which the bits of a row depend on its place in the tile."""
        reverse = slice(None, None, -1)
        forwards = self._decided(self._weights, *tile)
        backwards = self._decided(self._weights, *take(tile, reverse))
        if not np.array_equal(forwards, backwards[reverse]):
            raise InputError(
                "backend is 'jax', which rounds a row by its place on this processor; expected "
                "numpy"
            )


def _pad(rows: np.ndarray, count: int) -> np.ndarray:
    """Return so many rows: those given, again and again."""
    return np.resize(rows, (count, rows.shape[-1]))
