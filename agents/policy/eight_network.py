"""The network of schema 1 in numpy: eight numbers of the most critical intruder and the goal to an action.

A batch goes through matrix products in one precision; a single observation takes a path of its own, because array
overhead would cost ten times its arithmetic.
"""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from agents.policy.features import features, mirror_sign
from agents.policy.file import PolicyFile
from envs.aircraft import Aircraft
from envs.angles import sincos, wrap
from envs.backend import FLOATS
from envs.kinematics import VehicleState
from envs.observation import criticality, most_critical, observe

__all__ = ["NOT_FINITE", "EightNetwork", "each_row", "observed", "observed_by_one", "scaled"]

NOT_FINITE = "the policy gives an action that is not finite; expected bounded weights"

_BEHIND = 20.0  # separations


class EightNetwork:
    """The deterministic network of a policy file of schema 1.

    Attributes:
        layers: kernel ``[in, out]`` and bias ``[out]`` of the hidden layers and the head.
    """

    def __init__(self, content: PolicyFile, dtype: DTypeLike) -> None:
        """Take the tensors of a file; float32 or float64 is the precision of the products."""
        self._dtype, self._feature_set = np.dtype(dtype), content.feature_set
        names = [*(f"hidden_{number}" for number in range(len(content.hidden))), "head"]
        self.layers = [
            (content.actor[f"{name}/kernel"].astype(dtype), content.actor[f"{name}/bias"].astype(dtype))
            for name in names
        ]

    def many(
        self, observation: np.ndarray, product: Callable[[np.ndarray, np.ndarray], np.ndarray] = np.matmul
    ) -> np.ndarray:
        """Return the actions ``[N, 2]`` for observations ``[N, 8]``, in the precision of the layers.

        Raises:
            ValueError: an action is not finite.
        """
        # Components become contiguous rows: elementwise work on strided columns is twice as slow.
        components = list(np.ascontiguousarray(observation.T))
        x = np.stack(features(components, self._feature_set, np)).T
        *hidden, (kernel, bias) = self.layers
        for hidden_kernel, hidden_bias in hidden:
            x = product(x, hidden_kernel)
            x += hidden_bias
            np.tanh(x, out=x)
        x = product(x, kernel) + bias
        x[:, 1] *= mirror_sign(components, self._feature_set, np)
        if not np.isfinite(x).all():
            raise ValueError(NOT_FINITE)
        return np.clip(x, -1.0, 1.0)

    def single(self, values: list[float]) -> tuple[float, float]:
        """Return the action for eight floats in [-1, 1]: features in double precision, then products with a vector.

        Raises:
            ValueError: it is not finite.
        """
        x = np.array(features(values, self._feature_set, FLOATS), self._dtype)
        *hidden, (kernel, bias) = self.layers
        for hidden_kernel, hidden_bias in hidden:
            x = x.dot(hidden_kernel)  # the method: a tenth faster than the function for so little work
            x += hidden_bias
            np.tanh(x, x)
        throttle, steering = (x.dot(kernel) + bias).tolist()
        steering *= mirror_sign(values, self._feature_set, FLOATS)
        if not (isfinite(throttle) and isfinite(steering)):
            raise ValueError(NOT_FINITE)
        return FLOATS.clip(throttle, -1.0, 1.0), FLOATS.clip(steering, -1.0, 1.0)


def each_row(x: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Return ``x @ kernel`` ``[N, out]`` of N vector products: numpy hands each to BLAS alone."""
    return np.matmul(np.ascontiguousarray(x)[:, np.newaxis, :], kernel)[:, 0, :]


def observed(
    own: VehicleState, seen: VehicleState, present: np.ndarray, goal_x: Any, goal_y: Any, scales: Aircraft
) -> np.ndarray:
    """Return the observations ``[..., 8]`` of states in SI units; arguments as of ``Policy.command``."""
    if not present.any(axis=-1).all():
        seen, present = _never_alone(own, seen, present, scales)
    return observe(own, most_critical(own, seen, present, scales, np), goal_x, goal_y, scales, np)


def observed_by_one(
    own: VehicleState, intruders: Sequence[VehicleState], goal_x: float, goal_y: float, scales: Aircraft
) -> list[float]:
    """Return the observation of one aircraft in plain floats; arguments as of ``Policy.command_one``."""
    if len(intruders) == 1:
        other = intruders[0]
    elif intruders:
        other = min(intruders, key=lambda one: criticality(own, one, scales, FLOATS))
    else:
        other = _absent(own, scales, FLOATS)
    return observe(own, other, goal_x, goal_y, scales, FLOATS)


def _absent(own: VehicleState, scales: Aircraft, xp: Any) -> VehicleState:
    """Return an intruder without effect: as far behind as an observation can say, flying away."""
    sine, cosine = sincos(own.heading, xp)
    away = wrap(own.heading + np.pi, xp)
    behind, speed = _BEHIND * scales.separation, scales.limits.speed_min
    return VehicleState(own.x - behind * cosine, own.y - behind * sine, away, own.speed * 0.0 + speed)


def _never_alone(
    own: VehicleState, seen: VehicleState, present: np.ndarray, scales: Aircraft
) -> tuple[VehicleState, np.ndarray]:
    """Return intruders ``[..., K]`` and which exist, with one without effect where there was none."""
    behind = _absent(own, scales, np)
    if present.shape[-1] == 0:
        return VehicleState(*(field[..., None] for field in behind)), np.ones((*own.x.shape, 1), bool)
    alone = ~present.any(axis=-1, keepdims=True)
    fields = (np.where(alone, other[..., None], field) for field, other in zip(seen, behind, strict=True))
    return VehicleState(*fields), present | alone


def scaled(aircraft: Aircraft, length: float, speed: float) -> Aircraft:
    """Return an aircraft whose lengths and speeds are so many times as large."""
    limits = aircraft.limits._replace(
        speed_min=speed * aircraft.limits.speed_min, speed_max=speed * aircraft.limits.speed_max
    )
    return aircraft._replace(
        limits=limits,
        separation=length * aircraft.separation,
        traffic_speed_max=speed * aircraft.traffic_speed_max,
    )
