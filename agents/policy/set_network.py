"""The network for any number of intruders, in numpy: scenes to actions.

The layers are those of :class:`agents.learning.networks.Trunk`: each intruder through the encoder, the greatest of each
number, then the trunk. Every row is a vector product of its own, because BLAS rounds the rows of a matrix product by
the size of their batch: a scene gives the same bits in any company.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from agents.policy.scene import Scene
from agents.policy.set_features import EACH, OWN, set_inputs
from envs.trees import mapped

__all__ = ["SetNetwork", "layer_shapes"]

_PLACES = 128  # for intruders at a time, whose numbers stay in cache; changes no bit


def layer_shapes(encoder: list[int], hidden: list[int]) -> dict[str, tuple[int, int]]:
    """Return inputs and outputs of each layer by its name."""
    shapes, width = {}, EACH
    for number, outputs in enumerate(encoder):
        shapes[f"each_{number}"] = (width, outputs)
        width = outputs
    width += OWN
    for number, outputs in enumerate(hidden):
        shapes[f"hidden_{number}"] = (width, outputs)
        width = outputs
    return shapes | {"head": (width, 2)}


class SetNetwork:
    """The deterministic network of a policy file of schema 2."""

    def __init__(self, tensors: Mapping[str, np.ndarray], encoder: int, hidden: int, dtype: DTypeLike) -> None:
        """Take the tensors of a file.

        Args:
            tensors: by name, such as ``each_0/kernel`` ``[in, out]`` and ``head/bias`` ``[out]``.
            encoder, hidden: number of layers of each kind.
            dtype: float32 or float64, in which the scene is evaluated.
        """
        self._dtype = np.dtype(dtype)

        def layers(name: str, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
            names = [f"{name}_{number}" for number in range(count)]
            return [(tensors[f"{each}/kernel"].astype(dtype), tensors[f"{each}/bias"].astype(dtype)) for each in names]

        self._encoder, self._hidden = layers("each", encoder), layers("hidden", hidden)
        self._head = tensors["head/kernel"].astype(dtype), tensors["head/bias"].astype(dtype)

        self._widest = len(self._hidden[0][0])

    def __call__(self, seen: Scene) -> np.ndarray:
        """Return the actions ``[N, 2]`` for scenes ``[N]`` with K >= 1 places for intruders, not clipped."""
        seen = mapped(lambda field: field if np.asarray(field).dtype == bool else np.asarray(field, self._dtype), seen)
        count = len(seen.own_speed)
        block = max(1, _PLACES // seen.x.shape[-1])
        if count <= block:
            return self._actions(seen)
        return np.concatenate([self._actions(_rows(seen, first, block)) for first in range(0, count, block)])

    def one(self, own: list[float], each: list[list[float]], sign: float) -> tuple[float, float]:
        """Return the action of one scene, not clipped.

        Args:
            own, each: as :func:`agents.policy.set_features.set_inputs_of_one` gives them.
            sign: factor of the yaw rate.
        """
        inputs = np.empty(self._widest, self._dtype)
        inputs[:OWN] = own
        if each:
            flat = np.array(each, self._dtype)
            for kernel, bias in self._encoder:
                flat = np.tanh(flat @ kernel + bias)
            inputs[OWN:] = flat.max(axis=0)
        else:
            inputs[OWN:] = -1.0
        x = inputs
        for kernel, bias in self._hidden:
            x = x.dot(kernel)
            x += bias
            np.tanh(x, x)
        acceleration, yaw_rate = (x.dot(self._head[0]) + self._head[1]).tolist()
        return acceleration, yaw_rate * sign

    def _actions(self, seen: Scene) -> np.ndarray:
        own, each, present, sign = set_inputs(seen, np)
        flat = np.ascontiguousarray(each.reshape(-1, 1, each.shape[-1]))
        for kernel, bias in self._encoder:
            flat = np.tanh(flat @ kernel + bias)
        each = flat.reshape(*present.shape, -1)
        pooled = np.where(present[..., None], each, np.float32(-1.0)).max(axis=-2)
        x = np.concatenate([own, pooled], axis=-1)[:, None, :]
        for kernel, bias in self._hidden:
            x = np.tanh(x @ kernel + bias)
        action = (x @ self._head[0] + self._head[1])[:, 0, :]
        action[:, 1] *= sign
        return action


def _rows(seen: Scene, first: int, count: int) -> Scene:
    def part(field: Any) -> Any:
        return field[first : first + count] if np.ndim(field) else field

    return mapped(part, seen)
