"""The network for any number of intruders: scenes to actions
(:class:`agents.learning.networks.Trunk`).

In numpy every row is a vector product of its own, because BLAS rounds the rows of a matrix product
by the size of their batch: the result of a row does not depend on the batch.
"""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import DTypeLike

from agents.policy.candidate_manoeuvres import ScalarMinSeparation
from agents.policy.decision import INPUTS_OF, Decider, Layers, decider
from agents.policy.file import PolicyFile
from agents.policy.scene import Scene, scalar_mirror, scalar_scene, scene, unpack_rows
from agents.policy.set_features import InputTable, SetInputs, scalar_set_inputs, set_inputs
from envs.aircraft import Aircraft, ratios
from envs.angles import atan2
from envs.arrays import Array, ArrayModule
from envs.backend import FLOATS
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.observation import decode
from envs.relative import distance
from envs.trees import map_leaves

_SCENES = 256  # at a time, whose numbers stay in cache; changes no bit


class SetNetwork:
    """The deterministic network of a policy file of schema 2 or 3."""

    def __init__(self, content: PolicyFile, dtype: DTypeLike, inputs: InputTable) -> None:
        """Take the tensors of a file; float32 or float64 is the precision in which the scene is
        evaluated.
        """
        self._dtype, self._aircraft, self._inputs = np.dtype(dtype), content.aircraft, inputs
        self._own_size = inputs.own_size
        self._encoder = content.layers("each", dtype)
        self._trunk = content.layers("hidden", dtype) + content.layers("head", dtype)
        self._min_separation = _min_separation(self._aircraft)
        self.decider = self._decider_in_flight()

    def _decider_in_flight(self) -> Decider | None:
        """Return this network as compiled code takes it in flight; None: it has inputs of the
        user's own, or is in float64.
        """
        flies = not self._inputs.extra and self._dtype == np.float32
        return self.new_decider() if flies else None

    def new_decider(self) -> Decider:
        """Return this network as compiled code takes it, but for inputs of the user's own."""
        limits, separation = self._aircraft.limits, self._aircraft.separation
        return decider(limits, separation, self._min_separation, self._encoder, self._trunk)

    def for_aircraft(self, aircraft: Aircraft) -> "SetNetwork":
        """Return the network for states of another aircraft."""
        network = copy(self)
        network._aircraft, network._min_separation = aircraft, _min_separation(aircraft)
        network.decider = network._decider_in_flight()
        return network

    def of_parity(self, rows: np.ndarray) -> np.ndarray:
        """Return the actions ``[P, 2]`` for a file's parity vectors
        (:func:`agents.policy.scene.unpack_rows`).
        """
        return self._of_scenes(unpack_rows(rows))

    def of_observations(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions ``[N, 2]`` for observations ``[N, 8]`` of one intruder."""
        decoded = decode(list(observation.T.astype(float)), self._aircraft, np)
        zeros = np.zeros(len(observation))
        own: VehicleState[Air] = VehicleState(zeros, zeros, zeros, decoded.own_speed)
        vx, vy = decoded.intruder_vx, decoded.intruder_vy
        fields = decoded.intruder_x, decoded.intruder_y, atan2(vy, vx, np), distance(vx, vy, np)
        intruders: VehicleState[Air] = VehicleState(*(field[:, None] for field in fields))
        return self.of_states(
            own, intruders, np.ones((len(observation), 1), bool), decoded.goal_x, decoded.goal_y
        )

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
        if mask.shape[-1] == 0:
            intruders = VehicleState(*(np.zeros((len(mask), 1)) for _ in intruders))
            mask, distance_scale = np.zeros((len(mask), 1), bool), None
        limits, separation = self._aircraft.limits, self._aircraft.separation
        scenes = scene(own, intruders, mask, goal_x, goal_y, limits, separation, np)
        return self._of_scenes(scenes._replace(distance_scale=distance_scale))

    def scalar_action(
        self,
        own: VehicleState[Air],
        intruders: Sequence[VehicleState[Air]],
        goal_x: float,
        goal_y: float,
        distance_scale: Sequence[float] | None = None,
    ) -> tuple[float, float]:
        """Return the action of one aircraft in plain floats."""
        mine, traffic, sign = self.scalar_inputs(own, intruders, goal_x, goal_y, distance_scale)
        x = np.empty(len(self._trunk[0][0]), self._dtype)
        x[: self._own_size] = mine
        if traffic:
            flat = np.array(traffic, self._dtype)
            for kernel, bias in self._encoder:
                flat = flat.dot(kernel)
                flat += bias
                np.tanh(flat, flat)
            x[self._own_size :] = np.maximum.reduce(flat)
        else:
            x[self._own_size :] = -1.0
        acceleration, yaw_rate = one_through(x, self._trunk)
        return acceleration, yaw_rate * sign

    def scalar_inputs(
        self,
        own: VehicleState[Air],
        intruders: Sequence[VehicleState[Air]],
        goal_x: float,
        goal_y: float,
        distance_scale: Sequence[float] | None = None,
    ) -> tuple[list[float], list[list[float]], float]:
        """Return the inputs of one aircraft, those of each intruder, and how the scene is mirrored,
        1 or -1.
        """
        if self.decider is not None and INPUTS_OF.ready:
            scene = _in_arrays(own, intruders, goal_x, goal_y, distance_scale)
            mine, traffic, sign = INPUTS_OF(*scene, self.decider)
            return mine.tolist(), traffic.tolist(), sign
        limits, separation = self._aircraft.limits, self._aircraft.separation
        distance_scales = [1.0] * len(intruders) if distance_scale is None else distance_scale
        fields: VehicleState[Air] = VehicleState(*_transposed(intruders))
        unmirrored = scalar_scene(own, fields, goal_x, goal_y, limits, separation, FLOATS)
        mirrored, sign = scalar_mirror(
            unmirrored._replace(distance_scale=distance_scale), distance_scales, FLOATS
        )
        separations = self._min_separation(mirrored)
        return *scalar_set_inputs(mirrored, distance_scales, separations, self._inputs), sign

    def _of_scenes(self, scenes: Scene) -> np.ndarray:
        """Return the actions ``[N, 2]`` for scenes ``[N]`` with K >= 1 places for intruders."""
        scenes = map_leaves(
            lambda field: (
                field if np.asarray(field).dtype == bool else np.asarray(field, self._dtype)
            ),
            scenes,
        )
        if len(scenes.own_speed) <= _SCENES:
            return actions(set_inputs(scenes, np, self._inputs), self._encoder, self._trunk, np)
        blocks = [
            slice(first, first + _SCENES) for first in range(0, len(scenes.own_speed), _SCENES)
        ]
        parts = (
            map_leaves(lambda field, at=at: field[at] if np.ndim(field) else field, scenes)
            for at in blocks
        )
        return np.concatenate([self._of_scenes(part) for part in parts])


def _in_arrays(
    own: VehicleState[Air],
    intruders: Sequence[VehicleState[Air]],
    goal_x: float,
    goal_y: float,
    distance_scale: Sequence[float] | None,
) -> tuple[VehicleState[Air], VehicleState[Air], np.ndarray, float, float]:
    """Return a scene as compiled code takes it."""
    states = np.array(intruders, dtype=float).reshape(-1, len(VehicleState._fields))
    fields: VehicleState[Air] = VehicleState(*np.ascontiguousarray(states.T))
    distance_scales = (
        np.ones(len(intruders)) if distance_scale is None else np.array(distance_scale, dtype=float)
    )
    return VehicleState(*map(float, own)), fields, distance_scales, float(goal_x), float(goal_y)


def _transposed(states: Sequence[VehicleState[Air]]) -> Sequence[Sequence[float]]:
    """Return the fields of states, a sequence each."""
    return list(zip(*states, strict=True)) or [()] * len(VehicleState._fields)


def _min_separation(aircraft: Aircraft) -> ScalarMinSeparation:
    return ScalarMinSeparation(ratios(aircraft.limits, aircraft.separation))


def actions(inputs: SetInputs, encoder: Layers, trunk: Layers, xp: ArrayModule) -> Array:
    """Return the actions ``[N, 2]`` of the network's layers for inputs ``[N]``."""
    own, traffic, mask, sign = inputs
    traffic = xp.tanh(rows_through(traffic.reshape(-1, traffic.shape[-1]), encoder, xp)).reshape(
        *mask.shape, -1
    )
    pooled = xp.where(mask[..., None], traffic, -1.0).max(axis=-2)
    action = rows_through(xp.concatenate([own, pooled], axis=-1), trunk, xp)
    return action * xp.stack([xp.ones_like(sign), sign], axis=-1)


def rows_through(rows: Array, layers: Layers, xp: ArrayModule) -> Array:
    """Return the outputs ``[N, out]`` of layers with tanh between them, for rows ``[N, in]``."""
    x = rows[:, None, :]
    *before, (kernel, bias) = layers
    for layer_kernel, layer_bias in before:
        x = x @ layer_kernel
        x += layer_bias
        x = xp.tanh(x)
    return (x @ kernel + bias)[:, 0, :]


def one_through(x: np.ndarray, layers: Layers) -> list[float]:
    """Return the same for one vector ``[in]``."""
    *before, (kernel, bias) = layers
    for layer_kernel, layer_bias in before:
        x = x.dot(layer_kernel)  # the method: a tenth faster than the function for so little work
        x += layer_bias
        np.tanh(x, x)
    return (x.dot(kernel) + bias).tolist()
