"""The network of schema 1 in numpy: eight numbers of the most critical intruder and the goal to an
action.
"""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import DTypeLike

from agents.policy.features import features, mirror_sign
from agents.policy.file import PolicyFile
from agents.policy.set_network import one_through, rows_through
from envs.aircraft import PAPER, Aircraft
from envs.angles import sincos, wrap
from envs.arrays import ArrayModule
from envs.backend import FLOATS
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.observation import criticality, most_critical, observe
from envs.relative import at_distance_scale
from envs.trees import column

_BEHIND = 20.0  # separations
_BLOCK = 256  # rows at a time, whose activations stay in cache; changes no bit


class EightNetwork:
    """The deterministic network of a policy file of schema 1; ``layers``: kernel ``[in, out]``,
    bias ``[out]``.
    """

    def __init__(self, content: PolicyFile, dtype: DTypeLike) -> None:
        """Take the tensors of a file; float32 or float64 is the precision of the products."""
        self._dtype, self._feature_set = np.dtype(dtype), content.feature_set
        self._trained, self._scales = content.aircraft, PAPER
        self.layers = content.layers("hidden", dtype) + content.layers("head", dtype)

    def for_aircraft(self, aircraft: Aircraft) -> "EightNetwork":
        """Return the network with observations scaled by another aircraft, alike to the one it was
        trained for.
        """
        scaled, trained, limits = copy(self), self._trained, PAPER.limits
        length, speed = (
            aircraft.separation / trained.separation,
            aircraft.limits.speed_max / trained.limits.speed_max,
        )
        scaled._scales = PAPER._replace(
            limits=limits._replace(
                speed_min=speed * limits.speed_min, speed_max=speed * limits.speed_max
            ),
            separation=length * PAPER.separation,
            traffic_speed_max=speed * PAPER.traffic_speed_max,
        )
        return scaled

    def of_observations(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions ``[N, 2]`` for observations ``[N, 8]``, in the precision of the
        layers.
        """
        observation = observation.astype(self._dtype, copy=False)
        blocks = [
            self._block(observation[i : i + _BLOCK]) for i in range(0, len(observation), _BLOCK)
        ]
        return np.concatenate(blocks) if blocks else np.empty((0, 2), self._dtype)

    of_parity = of_observations

    def of_states(
        self,
        own: VehicleState[Air],
        intruders: VehicleState[Air],
        mask: np.ndarray,
        goal_x: np.ndarray,
        goal_y: np.ndarray,
        distance_scale: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the actions ``[N, 2]`` for states ``[N]`` and ``[N, K]``, distance scales
        ``[N, K]``.
        """
        if distance_scale is not None:
            intruders = at_distance_scale(column(own), intruders, distance_scale)
        if not mask.any(axis=-1).all():
            intruders, mask = _never_alone(own, intruders, mask, self._scales)
        critical = most_critical(own, intruders, mask, self._scales, np)
        return self.of_observations(
            observe(own, critical, goal_x, goal_y, self._scales, np).astype(np.float32)
        )

    def scalar_action(
        self,
        own: VehicleState[Air],
        intruders: Sequence[VehicleState[Air]],
        goal_x: float,
        goal_y: float,
        distance_scale: Sequence[float] | None = None,
    ) -> tuple[float, float]:
        """Return the action of one aircraft: features in double precision, then products with a
        vector.
        """
        if distance_scale is not None:
            intruders = [
                at_distance_scale(own, *pair)
                for pair in zip(intruders, distance_scale, strict=True)
            ]
        if len(intruders) == 1:
            intruder = intruders[0]
        elif intruders:
            intruder = min(
                intruders, key=lambda intruder: criticality(own, intruder, self._scales, FLOATS)
            )
        else:
            intruder = _absent(own, self._scales, FLOATS)
        values = observe(own, intruder, goal_x, goal_y, self._scales, FLOATS)
        x = np.array(features(values, self._feature_set, FLOATS), self._dtype)
        throttle, steering = one_through(x, self.layers)
        return throttle, steering * mirror_sign(values, self._feature_set, FLOATS)

    def _block(self, observation: np.ndarray) -> np.ndarray:
        # Components become contiguous rows: elementwise work on strided columns is twice as slow.
        components = list(np.ascontiguousarray(observation.T))
        x = rows_through(
            np.stack(features(components, self._feature_set, np), axis=-1), self.layers, np
        )
        x[:, 1] *= mirror_sign(components, self._feature_set, np)
        return x


def _absent(own: VehicleState[Air], scales: Aircraft, xp: ArrayModule) -> VehicleState[Air]:
    """Return an intruder without effect: as far behind as an observation can say, flying away."""
    sine, cosine = sincos(own.heading, xp)
    away = wrap(own.heading + np.pi, xp)
    behind, speed = _BEHIND * scales.separation, scales.limits.speed_min
    return VehicleState(
        own.x - behind * cosine, own.y - behind * sine, away, own.speed * 0.0 + speed
    )


def _never_alone(
    own: VehicleState[Air], intruders: VehicleState[Air], mask: np.ndarray, scales: Aircraft
) -> tuple[VehicleState[Air], np.ndarray]:
    """Return intruders and which exist with one more, without effect, that exists where there is no
    other.
    """
    behind = _absent(own, scales, np)
    fields = (
        np.concatenate([field, absent[..., None]], axis=-1)
        for field, absent in zip(intruders, behind, strict=True)
    )
    return VehicleState(*fields), np.concatenate([mask, ~mask.any(axis=-1, keepdims=True)], axis=-1)
