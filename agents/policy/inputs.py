"""An input of the network: its numbers, their unit and bounds, and the function that computes them.

The toolkit's own inputs are :data:`agents.policy.set_features.BUILT_IN`; a user's own have the same
form. An input is one row of a table from which sizes of layers, tensors of the policy file, its
contract, the bounds of novelty, the ONNX model and the parity vectors follow.

Functions take the scene as it is mirrored (:func:`agents.policy.scene.mirror`): most of the
traffic is left of the line to the goal. So every policy is exactly symmetric, whatever its inputs
compute.

Code of the user's own comes in by a call (:func:`register`) or by a name of the form
``module:name`` that the user writes in a configuration or an option (:func:`resolve`). A policy
file names what it needs; reading it imports nothing.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.policy.scene import Scene, mirror, random_scenes, unpack_rows
from commands.command import InputError
from commands.extension import failure
from commands.registry import Registry
from envs.aircraft import Ratios
from envs.arrays import Array, ArrayModule

__all__ = ["INTRUDER", "OWNSHIP", "Input", "Number", "register", "resolve"]

OWNSHIP, INTRUDER = "ownship", "intruder"
"""What an input describes: the ownship with its goal, or each of the intruders."""


class Number(NamedTuple):
    """One number of an input."""

    name: str
    unit: str  # such as D, V, rad; "1" for a number without dimension
    low: float  # its bounds; keep them within about -3 to 3
    high: float


class Input(NamedTuple):
    """An input of the network."""

    name: str
    of: str  # OWNSHIP or INTRUDER
    numbers: Sequence[Number]
    compute: Callable[[Scene, ArrayModule], Array]
    """(scenes ``[...]`` with K >= 1 places for intruders, numpy or jax.numpy) -> ``[..., n]`` of
    the ownship, ``[..., K, n]`` of each intruder, n numbers. Of absent intruders
    (``scene.mask``) anything finite."""
    code: str = ""  # module:name by which it was loaded

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return len(self.numbers)

    def contract(self) -> dict[str, Any]:
        """Return what a policy file says of the input, of JSON types."""
        return {
            "name": self.name,
            "of": self.of,
            "code": self.code or f"{self.compute.__module__}:{self.name}",
            "numbers": [
                {
                    "name": number.name,
                    "unit": number.unit,
                    "low": float(number.low),
                    "high": float(number.high),
                }
                for number in self.numbers
            ],
        }


INPUTS: Registry[Input] = Registry(
    "input", "an input of the network (agents.policy.inputs.Input)", Input, InputError
)
"""The inputs of the user's own that this process knows, by name."""


def register(entry: Input) -> Input:
    """Make an input of the user's own known in this process, and return it.

    One of the same name is replaced, as when a notebook's cell is run again.

    Raises:
        InputError: it is no input, or fails when it is tried on random scenes.
    """
    check_input(entry)
    return INPUTS.register(entry.name, entry)


def resolve(names: Iterable[str]) -> tuple[Input, ...]:
    """Return the inputs that the user names: registered ones, or ``module:name``, which is loaded
    and registered.

    Call this only with what the user has written by hand, never with what a policy file says.

    Raises:
        InputError: there is no such input, or it cannot be used.
    """
    return tuple(_find(name) for name in names)


def _find(name: str) -> Input:
    entry = INPUTS.load(name)
    return entry if name in INPUTS else register(entry._replace(code=name))


def extension_for(contract: Mapping[str, Any], inputs: Iterable[Input]) -> Input:
    """Return the input that a policy file needs, of those that are given.

    Raises:
        InputError: it is not among them, or has other numbers than in training.
    """
    name, code = contract["name"], contract["code"]
    for entry in inputs:
        if entry.name == name:
            ours = entry.contract()
            if any(ours[key] != contract[key] for key in ("of", "numbers")):
                raise InputError(
                    f"input {name!r} describes {_describe(ours)} here; the policy was trained "
                    f"with {_describe(contract)}"
                )
            return entry
    raise InputError(
        f"the policy needs the input {name!r} ({code}), which is not part of the toolkit; expected "
        f"--extension {code}, the key extensions: [{code}], or Policy.load(path, inputs=[...])"
    )


def _describe(contract: Mapping[str, Any]) -> str:
    numbers = ", ".join(
        f"{number['name']} ({number['unit']}, {number['low']:g} to {number['high']:g})"
        for number in contract["numbers"]
    )
    return f"the {contract['of']} by {numbers}"


_TRIAL_INTRUDERS = 3
_TRIAL_FAMILY = Ratios((0.4, 0.75), (-0.4, -0.03), (0.03, 0.4), (0.3, 2.5))._asdict()


def check_input(entry: Any) -> None:
    """Raise an InputError unless an input has names, unit and bounds, and its function keeps what
    they say on random scenes.
    """
    if not isinstance(entry, Input):
        raise InputError(f"{entry!r} is no input; expected an agents.policy.inputs.Input")
    source = f"input {entry.name!r}"
    if entry.of not in (OWNSHIP, INTRUDER):
        raise InputError(f"{source}: of is {entry.of!r}; expected {OWNSHIP!r} or {INTRUDER!r}")
    if not entry.numbers:
        raise InputError(f"{source}: has no numbers; expected one at least")
    for number in entry.numbers:
        if not number.low < number.high:
            raise InputError(
                f"{source}: {number.name} has bounds {number.low:g} to {number.high:g}; expected "
                "the lower one first"
            )
    scenes = trial_scenes()
    values = evaluate_input(entry, scenes, np)
    present = values if entry.of == OWNSHIP else values[scenes.mask]
    for index, number in enumerate(entry.numbers):
        column = present[..., index]
        outside = column[~((column >= number.low) & (column <= number.high))]  # and nan
        if outside.size:
            raise InputError(
                f"{source}: {number.name} is {outside[0]:.4g} in a random scene; expected "
                f"{number.low:g} to {number.high:g}, its bounds"
            )


def trial_scenes() -> Scene:
    """Return mirrored random scenes on which inputs are tried."""
    rows = random_scenes(_TRIAL_INTRUDERS, _TRIAL_FAMILY).astype(float)
    return mirror(unpack_rows(rows), np)[0]


def evaluate_input(entry: Input, scenes: Scene, xp: ArrayModule) -> Array:
    """Return the values of an input for mirrored scenes, in the scenes' dtype; raises an InputError
    where it fails or they have another shape.
    """
    try:
        values = entry.compute(scenes, xp)
    except Exception as problem:
        raise InputError(f"input {entry.name!r}: {failure(problem)}") from problem
    place = scenes.own_speed if entry.of == OWNSHIP else scenes.x
    expected = (*place.shape, entry.size)
    if getattr(values, "shape", None) != expected:
        raise InputError(
            f"input {entry.name!r}: computes {getattr(values, 'shape', type(values).__name__)} for "
            f"scenes {scenes.x.shape}; expected {expected}, one {entry.of} with {entry.size} "
            "numbers each"
        )
    return values if values.dtype == place.dtype else values.astype(place.dtype)
