"""The policy in flight: a forward pass in numpy that needs nothing of the training framework.

A batch goes through matrix products in one precision; a single observation takes a path of its own, because
array overhead would cost ten times its arithmetic (the planner rolls hundreds of steps, one after the other).
"""

import os
from collections.abc import Mapping, Sequence
from copy import copy
from importlib import resources
from math import isfinite
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from agents.policy.domain import OutsideDomainError, check_domain, domain
from agents.policy.eight_network import NOT_FINITE, EightNetwork, each_row, observed, observed_by_one, scaled
from agents.policy.escapes import KeptByOne
from agents.policy.file import PolicyFile, PolicyFileError, parse, read
from agents.policy.scene import Scene, mirrored_one, scene, scene_of_one, unpacked_rows
from agents.policy.set_features import set_inputs_of_one
from agents.policy.set_network import SetNetwork
from envs.aircraft import PAPER, Aircraft, ratios
from envs.angles import atan2
from envs.backend import FLOATS
from envs.kinematics import Limits, VehicleState
from envs.observation import NAMES, SIZE, decode
from envs.relative import distance

__all__ = ["PARITY_TOLERANCE", "TOLERANCE", "OutsideDomainError", "Policy"]

PARITY_TOLERANCE = 2e-5
"""Largest difference of an action from the training framework's, both evaluated in double precision."""

_ROUNDING_TOLERANCE = 1e-3  # for the precision and paths that fly: a trained network amplifies float32's rounding

TOLERANCE = 1e-5
"""By how much a component may leave [-1, 1]; it is clipped. More is an error of the caller."""

_SHIPPED = "data/policy.safetensors"
_BOUND = 1.0 + TOLERANCE
_BLOCK = 256  # rows at a time, whose activations stay in cache; changes no bit


class Policy:
    """A deterministic policy: observations ``[..., 8]`` to actions ``[..., 2]``, both in [-1, 1].

    Calls share no state, so that one policy serves many threads. How many threads a matrix product takes is the
    BLAS library's affair (``OPENBLAS_NUM_THREADS``, ``threadpoolctl``); one is fastest for these sizes.

    Attributes:
        sha256: digest of the policy file.
        metadata: of the policy file (docs/reference/policy-file.md).
        aircraft: that the policy was trained for, and
        limits: of it.
        tensors: of the network by their names in the file.
        dtype: in which the network is evaluated.
    """

    sha256: str
    metadata: Mapping[str, Any]
    aircraft: Aircraft
    limits: Limits
    tensors: Mapping[str, np.ndarray]
    dtype: np.dtype[Any]

    def __init__(self, content: PolicyFile, dtype: DTypeLike = np.float32, *, source: str = "policy") -> None:
        """Build the network and compare it with the file's parity vectors.

        Args:
            content: of a policy file.
            dtype: float32 or float64.
            source: name of the file for messages.

        Raises:
            PolicyFileError: the network does not give the actions that the training framework gave.
            ValueError: the dtype is another.
        """
        self.dtype = np.dtype(dtype)
        if self.dtype.name not in ("float32", "float64"):
            raise ValueError(f"dtype is {self.dtype}, expected float32 or float64")
        self.sha256 = content.sha256
        self.metadata = content.metadata
        self.limits, self.aircraft, self.tensors = content.limits, content.aircraft, content.actor
        self._scales = PAPER  # of the observations of a network for one intruder
        self._content, self._source = content, source
        self.most = content.metadata["architecture"]["intruders"] if content.of_set else 1
        self._set: SetNetwork | None = None
        if content.of_set:
            self._take_set(content, source)
            return
        self._one_intruder = EightNetwork(content, self.dtype)
        # In float64 so that a difference is one of meaning, never of rounding.
        exact = EightNetwork(content, np.float64).many(content.parity_observation.astype(np.float64))
        _check_parity(exact, content, PARITY_TOLERANCE, "in float64", source)
        _check_parity(self(content.parity_observation), content, _ROUNDING_TOLERANCE, f"in {self.dtype}", source)
        single = np.array([self.decide(row) for row in content.parity_observation.tolist()])
        _check_parity(single, content, _ROUNDING_TOLERANCE, f"in {self.dtype}, one by one", source)

    def _take_set(self, content: PolicyFile, source: str) -> None:
        """Build a network for any number of intruders and compare it with the file's parity vectors."""
        architecture = content.metadata["architecture"]
        sizes = len(architecture["encoder"]), len(architecture["hidden"])
        seen = unpacked_rows(content.parity_observation)
        exact = SetNetwork(content.actor, *sizes, np.float64)(seen)
        _check_parity(np.clip(exact, -1.0, 1.0), content, PARITY_TOLERANCE, "in float64", source)
        self._set = SetNetwork(content.actor, *sizes, self.dtype)
        self._kept = KeptByOne(ratios(self.limits, self.aircraft.separation))
        flown = np.clip(self._set(seen), -1.0, 1.0)
        _check_parity(flown, content, _ROUNDING_TOLERANCE, f"in {self.dtype}", source)

    def for_aircraft(self, aircraft: Aircraft, *, outside: str = "refuse") -> "Policy":
        """Return this policy for another aircraft, whose states it then takes and whose limits its actions mean.

        Args:
            aircraft: of the family that the policy was trained for.
            outside: ``allow`` takes an aircraft outside that family, too.

        Raises:
            OutsideDomainError: the aircraft is outside the family.
        """
        if outside not in ("refuse", "allow"):
            raise ValueError(f"outside is {outside!r}, expected 'refuse' or 'allow'")
        if outside == "refuse":
            check_domain(self._content, aircraft)
        other = copy(self)
        other.aircraft, other.limits = aircraft, aircraft.limits
        other._kept = KeptByOne(ratios(aircraft.limits, aircraft.separation))
        trained = self._content.aircraft
        other._scales = scaled(
            PAPER,
            aircraft.separation / trained.separation,
            aircraft.limits.speed_max / trained.limits.speed_max,
        )
        return other

    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        """Ranges of the traffic that the policy was trained for and is claimed, SI, for its aircraft."""
        return domain(self._content, self.aircraft)

    @classmethod
    def load(cls, path: str | os.PathLike[str] | None = None, dtype: DTypeLike = np.float32) -> "Policy":
        """Load a policy file, by default the one that ships with the package.

        Raises:
            PolicyFileError: the file is missing or refused; the message says what is wrong and where.
        """
        if path is not None:
            return cls(read(path), dtype, source=os.fspath(path))
        source = f"agents/{_SHIPPED}"
        try:
            data = resources.files("agents").joinpath(_SHIPPED).read_bytes()
        except OSError as error:
            raise PolicyFileError(f"{source}: this installation ships no policy; give the path of one") from error
        return cls(parse(data, source), dtype, source=source)

    def __call__(self, observation: ArrayLike) -> np.ndarray:
        """Return the actions ``[..., 2]`` for observations ``[..., 8]``, in the policy's dtype.

        A row may differ by rounding (about 1e-6) between batches of different size: see :meth:`rowwise`.

        Raises:
            ValueError: the last axis is not 8, or a component is not a number, not finite or outside [-1, 1] by
                more than :data:`TOLERANCE`. The check takes one pass for the minimum and one for the maximum.
        """
        array = np.asarray(observation)
        if array.shape == (SIZE,) and array.dtype.kind == "f":
            return np.array(self.decide(array.tolist()), self.dtype)
        array = self._checked(array)
        if array.size == 0:
            return np.empty((*array.shape[:-1], 2), self.dtype)
        if self._set is not None:
            return self._of_observations(array.reshape(-1, SIZE)).reshape(*array.shape[:-1], 2)
        actions = self._one_intruder.many(array.reshape(-1, SIZE))
        return actions.reshape(*array.shape[:-1], 2)

    def command(
        self, own: VehicleState, intruders: VehicleState, present: ArrayLike, goal_x: Any, goal_y: Any
    ) -> np.ndarray:
        """Return the actions ``[..., 2]``, float64; every row has the same bits in any company.

        Args:
            own: SI, fields ``[...]``.
            intruders: fields ``[..., K]``; of absent ones anything finite.
            present: which of them exist, bool ``[..., K]``.
            goal_x, goal_y: m, ``[...]``.

        Raises:
            ValueError: a shape is wrong, or a number is not finite.
        """
        own = VehicleState(*(np.asarray(field, float) for field in own))
        goal_x, goal_y = np.asarray(goal_x, float), np.asarray(goal_y, float)
        shape = own.x.shape
        present = np.asarray(present, bool)
        if present.shape[:-1] != shape or present.ndim != len(shape) + 1:
            raise ValueError(f"present has shape {present.shape}, expected [*{shape}, K]")
        seen = VehicleState(*(np.broadcast_to(np.asarray(field, float), present.shape) for field in intruders))
        if self._set is not None:
            one = VehicleState(*(field.reshape(-1) for field in own))
            wide = own.x.size, present.shape[-1]
            each, places = VehicleState(*(field.reshape(wide) for field in seen)), present.reshape(wide)
            return self._of_states(one, each, places, goal_x.reshape(-1), goal_y.reshape(-1)).reshape(*shape, 2)
        observation = observed(own, seen, present, goal_x, goal_y, self._scales)
        actions = self.rowwise(observation.reshape(-1, SIZE).astype(np.float32)).astype(float)
        return actions.reshape(*shape, 2)

    def command_one(
        self, own: VehicleState, intruders: Sequence[VehicleState], goal_x: float, goal_y: float
    ) -> tuple[float, float]:
        """Return the action of one aircraft in plain floats: the fast path of a step-by-step rollout.

        Args:
            own: SI, floats.
            intruders: those that exist, none or more.
            goal_x, goal_y: m.

        Raises:
            ValueError: a number is not finite.
        """
        if self._set is not None:
            return self._one_of_set(own, intruders, goal_x, goal_y)
        return self.decide(observed_by_one(own, intruders, goal_x, goal_y, self._scales))

    def _one_of_set(
        self, own: VehicleState, intruders: Sequence[VehicleState], goal_x: float, goal_y: float
    ) -> tuple[float, float]:
        assert self._set is not None
        limits, separation = self.aircraft.limits, self.aircraft.separation
        seen, sign = mirrored_one(scene_of_one(own, intruders, goal_x, goal_y, limits, separation))
        throttle, steering = self._set.one(*set_inputs_of_one(seen, self._kept(seen)), sign)
        if not (isfinite(throttle) and isfinite(steering)):
            raise ValueError(NOT_FINITE)
        return FLOATS.clip(throttle, -1.0, 1.0), FLOATS.clip(steering, -1.0, 1.0)

    def _of_states(
        self, own: VehicleState, seen: VehicleState, present: np.ndarray, goal_x: np.ndarray, goal_y: np.ndarray
    ) -> np.ndarray:
        """Return the actions ``[N, 2]`` of a network for sets, float64, for states ``[N]`` and ``[N, K]``."""
        if present.shape[-1] == 0:
            seen = VehicleState(*(np.zeros((len(present), 1)) for _ in seen))
            present = np.zeros((len(present), 1), bool)
        return self._of_scenes(
            scene(own, seen, present, goal_x, goal_y, self.aircraft.limits, self.aircraft.separation, np)
        ).astype(float)

    def _of_scenes(self, seen: Scene) -> np.ndarray:
        assert self._set is not None
        actions = self._set(seen)
        if not np.isfinite(actions).all():
            raise ValueError(NOT_FINITE)
        return np.clip(actions, -1.0, 1.0)

    def _of_observations(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions ``[N, 2]`` of a network for sets for checked observations ``[N, 8]`` of one intruder."""
        found = decode(list(observation.T.astype(float)), self.aircraft, np)
        zeros = np.zeros(len(observation))
        own = VehicleState(zeros, zeros, zeros, found.own_speed)
        vx, vy = found.intruder_vx, found.intruder_vy
        fields = found.intruder_x, found.intruder_y, atan2(vy, vx, np), distance(vx, vy, np)
        seen = VehicleState(*(field[:, None] for field in fields))
        present = np.ones((len(observation), 1), bool)
        return self._of_states(own, seen, present, found.goal_x, found.goal_y).astype(self.dtype)

    def decide(self, observation: list[float]) -> tuple[float, float]:
        """Return the action for one observation as plain floats: the fast path of a step-by-step rollout.

        Args:
            observation: eight plain floats.

        Raises:
            ValueError: as for a call.
        """
        try:
            for value in observation:
                # A comparison with NaN is false, too.
                if not -1.0 <= value <= 1.0:
                    break
            else:
                if len(observation) == SIZE:
                    return self._single(observation)
        except TypeError:
            pass  # refused below, by the check that knows the components' names
        array = self._checked(observation)
        if array.ndim != 1:
            raise ValueError(f"observation has shape {array.shape}, expected ({SIZE},)")
        return self._single(array.tolist())

    def rowwise(self, observation: ArrayLike) -> np.ndarray:
        """Return the actions ``[N, 2]`` for observations ``[N, 8]``, each row independent of all others.

        BLAS rounds a row by the size of its batch and, with some of its kernels, by its place in it. Here every
        row is a product of its own, a vector with the kernel, so that it gives the same bits whatever N and wherever
        it stands, at half the speed of a call on many. This holds for one machine, one version of numpy and one number
        of BLAS threads; keep that number fixed (1 is best).

        Raises:
            ValueError: as for a call, or the observations are not ``[N, 8]``.
        """
        array = self._checked(observation)
        if array.ndim != 2:
            raise ValueError(f"observations have shape {array.shape}, expected [N, {SIZE}]")
        if self._set is not None:
            return self._of_observations(array)
        actions = np.empty((len(array), 2), self.dtype)
        for first in range(0, len(array), _BLOCK):
            block = slice(first, first + _BLOCK)
            actions[block] = self._one_intruder.many(array[block], each_row)
        return actions

    def _checked(self, observation: Any) -> np.ndarray:
        """Return the observations as an array in [-1, 1] of the policy's dtype, or raise ``ValueError``."""
        array = np.asarray(observation)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"observation has dtype {array.dtype}, expected real numbers")
        if array.ndim == 0 or array.shape[-1] != SIZE:
            raise ValueError(f"observation has shape {array.shape}, expected a last axis of {SIZE}")
        if array.size == 0:
            return array.astype(self.dtype)
        low, high = array.min(), array.max()
        # NaN passes through both and fails here.
        if not (low >= -_BOUND and high <= _BOUND):
            _refuse(array)
        if low < -1.0 or high > 1.0:
            array = array.clip(-1.0, 1.0)
        return array.astype(self.dtype, copy=False)

    def _single(self, values: list[float]) -> tuple[float, float]:
        """Evaluate eight floats in [-1, 1]: features in double precision, then products with a vector."""
        if self._set is not None:
            throttle, steering = self._of_observations(np.array([values], self.dtype))[0].tolist()
            return throttle, steering
        return self._one_intruder.single(values)


def _refuse(array: np.ndarray) -> NoReturn:
    """Raise ``ValueError`` for the first component that is not finite or outside [-1, 1]."""
    bad = ~((array >= -_BOUND) & (array <= _BOUND))
    *row, component = np.argwhere(bad)[0].tolist()
    where = f" of row {row}" if row else ""
    value = array[(*row, component)]
    raise ValueError(f"observation component {NAMES[component]!r}{where} is {value}, expected a value in [-1, 1]")


def _check_parity(actions: np.ndarray, content: PolicyFile, tolerance: float, how: str, source: str) -> None:
    """Raise unless the actions ``[P, 2]`` are the file's, within the tolerance."""
    difference = np.abs(actions - content.parity_action).max(axis=-1)
    # Inverted, so that NaN is refused.
    if not difference.max() <= tolerance:
        worst = int(difference.argmax())
        raise PolicyFileError(
            f"{source}: the network {how} gives action {actions[worst].tolist()} for parity vector {worst}, expected "
            f"{content.parity_action[worst].tolist()} within {tolerance}"
        )
