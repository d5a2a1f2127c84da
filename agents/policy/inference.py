"""The policy in flight: a forward pass in numpy that needs nothing of the training framework."""

import os
from collections.abc import Sequence
from copy import copy
from importlib import resources
from math import degrees, isfinite

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from agents.policy import novelty
from agents.policy.decision import Decider
from agents.policy.domain import Departure, OutsideDomainError, domain, unlike
from agents.policy.eight_network import EightNetwork
from agents.policy.file import PolicyFile, PolicyFileError, parse, read
from agents.policy.inputs import INPUTS, Input, extension_for
from agents.policy.set_features import TABLE, InputTable, table
from agents.policy.set_network import SetNetwork
from commands.command import InputError
from envs.aircraft import Aircraft
from envs.arrays import Array
from envs.backend import FLOATS
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.observation import NAMES, SIZE, beside, urgent
from envs.relative import at_distance_scale
from envs.trees import map_leaves

PARITY_TOLERANCE = 2e-5
"""Largest difference of an action from the training framework's, both evaluated in double
precision.
"""

# for the precision and paths that fly: a trained network amplifies float32's rounding
_ROUNDING_TOLERANCE = 1e-3

TOLERANCE = 1e-5
"""By how much a component may leave [-1, 1]; it is clipped. More is an error of the caller."""

_SHIPPED = "data/policy.safetensors"
_BOUND = 1.0 + TOLERANCE
NOT_FINITE = (
    "the policy gives an action that is not finite; expected finite states and bounded weights"
)


class Policy:
    """A deterministic policy: observations ``[..., 8]`` to actions ``[..., 2]``, both in [-1, 1].

    Calls share no state, so that one policy serves many threads. The result of a row does not
    depend on the batch, on one machine, with one version of numpy and one number of BLAS threads;
    one is fastest for these sizes.

    Attributes:
        sha256: digest of the policy file.
        metadata: of the policy file (docs/reference/policy-file.md).
        aircraft: that the policy was trained for, and
        limits: of it.
        most: intruders that it was trained with at once, 1 of schema 1.
        tensors, layers: of the network, by their names in the file and by their kind.
        dtype: in which the network is evaluated.
        inputs: table of what the network takes of a scene; of schema 1 of no use.
    """

    def __init__(
        self,
        content: PolicyFile,
        dtype: DTypeLike = np.float32,
        *,
        source: str = "policy",
        inputs: Sequence[Input] = (),
    ) -> None:
        """Build the network, in float32 or float64, and compare it with the file's parity vectors.

        Args:
            inputs: of the user's own, beside those that are registered
                (:mod:`agents.policy.inputs`).

        Raises:
            PolicyFileError: the network needs an input of the user's own that is not there, or does
                not give the actions that the training framework gave.
            ValueError: the dtype is another.
        """
        self.dtype = np.dtype(dtype)
        if self.dtype.name not in ("float32", "float64"):
            raise ValueError(f"dtype is {self.dtype}, expected float32 or float64")
        self.sha256, self.metadata = content.sha256, content.metadata
        self.limits, self.aircraft, self.tensors = content.limits, content.aircraft, content.actor
        self.layers, self._content, self._outside = content.layers, content, "refuse"
        self._unlike: list[Departure] = []
        self.most = int(self.domain["intruders"][1])
        self.inputs = input_table(content, inputs, source)
        # In float64 so that a difference is one of meaning, never of rounding.
        exact = _network(content, np.float64, self.inputs)
        _check_parity(exact, content, PARITY_TOLERANCE, "in float64", source)
        self._resolver = _network(content, self.dtype, self.inputs)
        _check_parity(self._resolver, content, _ROUNDING_TOLERANCE, f"in {self.dtype}", source)

    def for_aircraft(self, aircraft: Aircraft, *, outside: str = "refuse") -> "Policy":
        """Return this policy for another aircraft: it takes that one's states, and its actions mean
        that one's limits.

        Args:
            aircraft: of the family that the policy was trained for.
            outside: ``allow`` takes an aircraft outside that family, and more intruders than it was
                trained with, too.

        Raises:
            OutsideDomainError: the aircraft is outside the family.
        """
        if outside not in ("refuse", "allow"):
            raise ValueError(f"outside is {outside!r}, expected 'refuse' or 'allow'")
        policy = copy(self)
        departure = unlike(self._content, aircraft)
        if departure is not None and outside == "refuse":
            raise OutsideDomainError(str(departure))
        policy._outside, policy._unlike = outside, [] if departure is None else [departure]
        policy.aircraft, policy.limits = aircraft, aircraft.limits
        policy._resolver = self._resolver.for_aircraft(aircraft)
        return policy

    def __repr__(self) -> str:
        """Return in a line which policy this is, and for what."""
        limits, aircraft = self.limits, self.aircraft
        inputs = "".join(f", input {extra.name}" for extra in self.inputs.extra)
        return (
            f"<Policy {self.sha256[:8]}: up to {self.most} intruders; aircraft of "
            f"{limits.speed_min:g} to {limits.speed_max:g} m/s, "
            f"{degrees(limits.yaw_rate_max):g} deg/s, separation {aircraft.separation:g} m"
            f"{inputs}>"
        )

    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        """Ranges of the traffic that the policy was trained for and is claimed, SI, for its
        aircraft.
        """
        return domain(self._content, self.aircraft)

    @property
    def decider(self) -> Decider | None:
        """This policy as compiled code takes it; None: it decides interpreted, because it has
        inputs of the user's own, is in float64, or is of schema 1.
        """
        return self._resolver.decider if isinstance(self._resolver, SetNetwork) else None

    def check_intruders(self, count: int) -> None:
        """Raise an OutsideDomainError for more intruders than in training, unless
        :meth:`for_aircraft` allowed them; then the most critical of them are looked at.
        """
        if self._outside == "refuse" and count > self.most:
            raise OutsideDomainError(
                f"outside_domain: there are {count} intruders; expected {self.most} at most, what "
                "the policy was "
                "trained with (--allow-outside-domain flies all the same)"
            )

    def most_critical(
        self,
        own: VehicleState[Air],
        intruders: VehicleState[Air],
        mask: ArrayLike,
        distance_scale: ArrayLike | None = None,
    ) -> np.ndarray:
        """Return the numbers of the intruders that the policy looks at, ``[..., min(most, K)]``: as
        many as in training, the most urgent first (:func:`envs.observation.urgent`).

        ``own`` has fields ``[...]``, the intruders ``[..., K]``; ``mask`` says which exist,
        the distance scales are as :meth:`command` takes them.
        """
        if distance_scale is not None:
            intruders = at_distance_scale(beside(own), intruders, distance_scale)
        return urgent(own, intruders, np.asarray(mask, bool), self.most, self.aircraft, np)

    def departures(
        self,
        own: VehicleState[Air],
        intruders: Sequence[VehicleState[Air]],
        goal_x: float,
        goal_y: float,
        distance_scale: Sequence[float] | None = None,
    ) -> list[Departure]:
        """Return how aircraft and scene are unlike all that the policy was trained with; of more
        intruders than it looks at, by those.
        """
        if not isinstance(self._resolver, SetNetwork):
            return [*self._unlike]
        intruders, distance_scale = self._most_critical(own, intruders, distance_scale)
        box = novelty.box_of(self.sha256, self.inputs)
        mine, traffic, _ = self._resolver.scalar_inputs(
            own, intruders, goal_x, goal_y, distance_scale
        )
        return [*self._unlike, *novelty.departures(box, self.inputs, mine, traffic)]

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str] | None = None,
        dtype: DTypeLike = np.float32,
        *,
        inputs: Sequence[Input] = (),
    ) -> "Policy":
        """Load a policy file, by default the one that ships; raises a PolicyFileError where it
        cannot be used.

        Loading imports nothing that the file names: ``inputs`` are those of the user's own that it
        needs, beside the registered ones (:func:`agents.policy.inputs.register`).
        """
        if path is not None:
            return cls(read(path), dtype, source=os.fspath(path), inputs=inputs)
        source = f"agents/{_SHIPPED}"
        try:
            data = resources.files("agents").joinpath(_SHIPPED).read_bytes()
        except OSError as error:
            raise PolicyFileError(
                f"{source}: this installation ships no policy; give the path of one"
            ) from error
        return cls(parse(data, source), dtype, source=source)

    def __call__(self, observation: ArrayLike) -> np.ndarray:
        """Return the actions ``[..., 2]`` for observations ``[..., 8]``, in the policy's dtype.

        Raises:
            ValueError: the last axis is not 8, or a component is not a number, not finite or
                outside [-1, 1] by more than :data:`TOLERANCE`.
        """
        array = self._check(np.asarray(observation))
        if array.size == 0:
            return np.empty((*array.shape[:-1], 2), self.dtype)
        actions = self._resolver.of_observations(array.reshape(-1, SIZE))
        return _clip(actions).reshape(*array.shape[:-1], 2)

    def command(
        self,
        own: VehicleState[Air],
        intruders: VehicleState[Air],
        mask: ArrayLike,
        goal_x: Array,
        goal_y: Array,
        distance_scale: ArrayLike | None = None,
    ) -> np.ndarray:
        """Return the actions ``[..., 2]``, float64; the bits of a row do not depend on the
        batch.

        Args:
            own: SI, fields ``[...]``.
            intruders: fields ``[..., K]``; of absent ones anything finite.
            mask: which of them exist, bool ``[..., K]``.
            goal_x, goal_y: m, ``[...]``.
            distance_scale: the aircraft's separation over that of each intruder, ``[..., K]``;
                None: they have the aircraft's.

        Raises:
            ValueError: a shape is wrong, or a number is not finite; ``OutsideDomainError``: there
                are too many.
        """
        shape, exist = np.shape(own.x), np.asarray(mask, bool)
        if exist.shape[:-1] != shape or exist.ndim != len(shape) + 1:
            raise ValueError(
                f"mask has shape {exist.shape}, expected {shape} and an axis of the intruders"
            )
        own = _states("own", own, shape)
        goal_x, goal_y = _shape("goal_x", goal_x, shape), _shape("goal_y", goal_y, shape)
        others = _states("intruders", intruders, exist.shape)
        distance_scales = (
            None
            if distance_scale is None
            else _shape("distance_scale", distance_scale, exist.shape)
        )
        if exist.shape[-1] > self.most:
            self.check_intruders(int(np.max(np.count_nonzero(exist, axis=-1), initial=0)))
            order = self.most_critical(own, others, exist, distance_scales)
            others, exist, distance_scales = map_leaves(
                lambda field: np.take_along_axis(field, order, axis=-1),
                (others, exist, distance_scales),
            )
        wide = own.x.size, exist.shape[-1]
        flat_own, to_x, to_y = map_leaves(lambda field: field.reshape(-1), (own, goal_x, goal_y))
        flat_others, exist, distance_scales = map_leaves(
            lambda field: field.reshape(wide), (others, exist, distance_scales)
        )
        actions = self._resolver.of_states(
            flat_own, flat_others, exist, to_x, to_y, distance_scales
        )
        return _clip(actions).astype(float).reshape(*shape, 2)

    def command_one(
        self,
        own: VehicleState[Air],
        intruders: Sequence[VehicleState[Air]],
        goal_x: float,
        goal_y: float,
        distance_scale: Sequence[float] | None = None,
    ) -> tuple[float, float]:
        """Return the action of one aircraft in plain floats, SI: the fast path of a step-by-step
        rollout.

        Raises:
            ValueError: a number is not finite; ``OutsideDomainError``: there are too many
                intruders.
        """
        if len(intruders) > self.most:
            self.check_intruders(len(intruders))
            intruders, distance_scale = self._most_critical(own, intruders, distance_scale)
        throttle, steering = self._resolver.scalar_action(
            own, intruders, goal_x, goal_y, distance_scale
        )
        if not (isfinite(throttle) and isfinite(steering)):
            raise ValueError(NOT_FINITE)
        return FLOATS.clip(throttle, -1.0, 1.0), FLOATS.clip(steering, -1.0, 1.0)

    def _most_critical(
        self,
        own: VehicleState[Air],
        intruders: Sequence[VehicleState[Air]],
        distance_scale: Sequence[float] | None = None,
    ) -> tuple[Sequence[VehicleState[Air]], Sequence[float] | None]:
        """Return the most critical of intruders in plain floats, and their distance
        scales.
        """
        if len(intruders) <= self.most:
            return intruders, distance_scale
        every: VehicleState[Air] = VehicleState(
            *(np.array(field) for field in zip(*intruders, strict=True))
        )
        state: VehicleState[Air] = VehicleState(*map(np.asarray, own))
        exist = np.ones(len(intruders), bool)
        order = list[int](self.most_critical(state, every, exist, distance_scale))
        chosen = None if distance_scale is None else [distance_scale[number] for number in order]
        return [intruders[number] for number in order], chosen

    def _check(self, array: np.ndarray) -> np.ndarray:
        """Return the observations in [-1, 1] and the policy's dtype, or raise ``ValueError``."""
        if array.dtype.kind not in "fiu":
            raise ValueError(f"observation has dtype {array.dtype}, expected real numbers")
        if array.ndim == 0 or array.shape[-1] != SIZE:
            raise ValueError(f"observation has shape {array.shape}, expected a last axis of {SIZE}")
        bad = ~((array >= -_BOUND) & (array <= _BOUND))  # inverted, so that NaN is refused
        if bad.any():
            *row, component = np.argwhere(bad)[0].tolist()
            where, value = f" of row {row}" if row else "", array[(*row, component)]
            raise ValueError(
                f"observation component {NAMES[component]!r}{where} is {value}, expected one in "
                "[-1, 1]"
            )
        return array.clip(-1.0, 1.0).astype(self.dtype, copy=False)


def check_one_layer(policy: Policy) -> None:
    """Raise an InputError for a policy but one of schema 2 with one layer for each intruder, and no
    inputs of the user's own.
    """
    if policy.inputs.extra:
        names = ", ".join(extra.name for extra in policy.inputs.extra)
        raise InputError(f"the policy has inputs of your own ({names}); expected one without")
    if len(policy.metadata["architecture"].get("encoder", ())) != 1:
        raise InputError(
            "the policy has not one layer for each intruder; expected one of schema 2 that has"
        )


def input_table(
    content: PolicyFile, inputs: Sequence[Input] = (), source: str = "policy"
) -> InputTable:
    """Return the table of the inputs that a policy file needs, of the toolkit's, those given and
    the registered ones; raises a PolicyFileError where one is not there.
    """
    if not content.extensions:
        return TABLE
    # One that is given counts before a registered one of its name.
    available = (*inputs, *INPUTS.own.values())
    try:
        return table(extension_for(contract, available) for contract in content.extensions)
    except InputError as problem:
        raise PolicyFileError(f"{source}: {problem}") from None


def _network(
    content: PolicyFile, dtype: DTypeLike, inputs: InputTable
) -> EightNetwork | SetNetwork:
    return SetNetwork(content, dtype, inputs) if content.of_set else EightNetwork(content, dtype)


def _states(name: str, states: VehicleState[Air], shape: tuple[int, ...]) -> VehicleState[Air]:
    """Return states as arrays of a shape; raises a ValueError that names the field of another."""
    fields = states._asdict().items()
    return VehicleState(*(_shape(f"{name}.{field}", values, shape) for field, values in fields))


def _shape(name: str, values: Array, shape: tuple[int, ...]) -> np.ndarray:
    """Return numbers as an array of a shape; raises a ValueError where they have another."""
    try:
        return np.broadcast_to(np.asarray(values, float), shape)
    except ValueError:
        raise ValueError(f"{name} has shape {np.shape(values)}, expected {shape}") from None


def _clip(actions: np.ndarray) -> np.ndarray:
    if not np.isfinite(actions).all():
        raise ValueError(NOT_FINITE)
    return np.clip(actions, -1.0, 1.0)


def _check_parity(
    network: EightNetwork | SetNetwork, content: PolicyFile, tolerance: float, how: str, source: str
) -> None:
    """Raise unless a network's actions for the file's parity vectors are the file's, within the
    tolerance.
    """
    actions = np.clip(network.of_parity(content.parity_observation), -1.0, 1.0)
    difference = np.abs(actions - content.parity_action).max(axis=-1)
    # Inverted, so that NaN is refused.
    if not difference.max() <= tolerance:
        worst = int(difference.argmax())
        raise PolicyFileError(
            f"{source}: the network {how} gives action {actions[worst].tolist()} for parity "
            f"vector {worst}, expected "
            f"{content.parity_action[worst].tolist()} within {tolerance}"
        )
