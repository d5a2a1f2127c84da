"""What a policy file must say: its metadata, its tensors, and the checks on both
(docs/reference/policy-file.md).

Observation and action contracts stand in every file: a policy of other meanings is refused instead
of flown.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from agents.policy.digest import canonical, sha256
from agents.policy.features import FEATURE_SETS, size
from agents.policy.inputs import INTRUDER, OWNSHIP, Input
from agents.policy.scene import width as parity_width
from agents.policy.set_features import TABLE
from commands.command import InputError
from commands.json_text import parse_json
from envs.aircraft import Aircraft, AircraftError, Ratios, new_aircraft
from envs.kinematics import FASTEST, Limits
from envs.observation import NAMES, SIZE


class PolicyFileError(InputError):
    """A policy file that cannot be used; the message says which file, what is wrong, where, what
    was expected.
    """


SCHEMA = {"name": "rlcas-policy", "version": 1}
"""Of policies that see one intruder, the paper's aircraft and its eight numbers."""

SET_SCHEMA = {"name": "rlcas-policy", "version": 2}
"""Of policies that see any number of intruders, for a family of aircraft."""

EXTENDED_SCHEMA = {"name": "rlcas-policy", "version": 3}
"""Of those whose network has inputs of the user's own too (:mod:`agents.policy.inputs`)."""

SET_SCHEMAS = (SET_SCHEMA, EXTENDED_SCHEMA)
"""Of policies that see any number of intruders."""

SCENE = {
    "units": (
        "lengths in required separations D, speeds in the ownship's greatest speed V, "
        "accelerations in V^2/D"
    ),
    "frame": "origin at the ownship, x ahead, y left; velocities over the ground",
    "own": ["speed", "goal_x", "goal_y", *Ratios._fields],
    "intruder": ["x", "y", "vx", "vy", "present"],
}
"""What a policy of schema 2 sees (:mod:`agents.policy.scene`)."""

OBSERVATION = {
    "names": list(NAMES),
    # component = clip((quantity - middle) / half_range, -1, 1)
    "middle": [75.0, 0.0, 75.0, 0.0, 0.0, 10_000.0, 0.0, 10_000.0],
    "half_range": [25.0, math.pi, 75.0, math.pi, math.pi, 10_000.0, math.pi, 10_000.0],
    "unit": ["m/s", "rad", "m/s", "rad", "rad", "m", "rad", "m"],
    "convention": (
        "headings counter-clockwise from east; bearings from own heading, left "
        "positive; clipped to [-1, 1]"
    ),
}
ACTION = {
    "names": ["acceleration", "yaw_rate"],
    "convention": (
        "fractions of the vehicle limits in [-1, 1]; positive yaw rate is counter-clockwise"
    ),
}

PARITY_OBSERVATION, PARITY_ACTION = "parity/observation", "parity/action"

_LEAST_YAW_RATE = 1e-4  # rad/s; less leaves the arithmetic of doubles
_MAX_LAYERS, _MAX_WIDTH = 8, 4096
_MAX_WEIGHT = 1e4  # sums of so large weights stay finite whatever the widths
_MAX_INTRUDERS = 64
_MAX_INPUTS, _MAX_NUMBERS = 64, 256  # of the user's own; and numbers of one of them
_OF_AIRCRAFT = ("separation", "goal_radius", "traffic_speed_max", "dt", "t_max")
# Every field of the metadata and its type; a nested dict is an object with exactly these fields.
_COMMON: dict[str, Any] = {
    "schema": {"name": str, "version": int},
    "action": dict,
    "limits": dict.fromkeys(Limits._fields, float),
    "training": {"config": dict, "config_sha256": str, "steps": int, "score": (float, type(None))},
    "versions": dict,
    "notes": str,
}
_FIELDS: dict[str, Any] = _COMMON | {
    "observation": dict,
    "architecture": {"hidden": list, "activation": str, "feature_set": str, "output": str},
}
_SET_FIELDS: dict[str, Any] = _COMMON | {
    "scene": dict,
    "task": dict.fromkeys(_OF_AIRCRAFT, float),
    "family": dict.fromkeys(Ratios._fields, list),
    "architecture": {
        "hidden": list,
        "encoder": list,
        "intruders": int,
        "activation": str,
        "output": str,
    },
}


_EXTENDED_FIELDS: dict[str, Any] = _SET_FIELDS | {"inputs": list}
_INPUT_FIELDS: dict[str, Any] = {"name": str, "of": str, "code": str, "numbers": list}
_NUMBER_FIELDS: dict[str, Any] = {"name": str, "unit": str, "low": float, "high": float}


class SetOf(NamedTuple):
    """The fields of a policy for any number of intruders."""

    encoder: tuple[int, ...]  # widths of the layers that each intruder passes
    intruders: int  # most of them in training
    aircraft: Aircraft
    family: Mapping[str, tuple[float, float]]  # bounds of each of envs.aircraft.Ratios in training
    inputs: tuple[Input, ...] = ()  # of the user's own


def new_metadata(  # noqa: PLR0913 - it describes a file
    hidden: tuple[int, ...],
    feature_set: str,
    limits: Limits,
    config: Mapping[str, Any],
    *,
    steps: int,
    score: float | None = None,
    versions: Mapping[str, str] = {},
    notes: str = "",
    of_set: SetOf | None = None,
) -> dict[str, Any]:
    """Return the metadata of a policy under the present contracts.

    Args:
        feature_set: ``set``, or one of :data:`agents.policy.features.FEATURE_SETS`.
        limits: of the vehicle that the policy was trained for; floats, SI.
        config: the resolved training configuration, of JSON types.
        score: mean sparse reward per encounter, None if it was not evaluated.

    Raises:
        PolicyFileError: something of it is of a type, or a value, that a policy file cannot hold.
    """
    architecture: dict[str, Any] = {
        "hidden": [int(width) for width in hidden],
        "activation": "tanh",
        "output": "clip",
    }
    if of_set is None:
        own = {"schema": dict(SCHEMA), "observation": OBSERVATION}
        architecture["feature_set"] = feature_set
    else:
        own = _set_contract(of_set)
        architecture |= {
            "encoder": [int(width) for width in of_set.encoder],
            "intruders": int(of_set.intruders),
        }
    try:
        training = {
            "config": config,
            "config_sha256": sha256(canonical(config)),
            "steps": int(steps),
        }
        document = own | {
            "action": ACTION,
            "limits": {name: float(value) for name, value in limits._asdict().items()},
            "architecture": architecture,
            "training": training | {"score": None if score is None else float(score)},
            "versions": dict(versions),
            "notes": notes,
        }
        document = parse_json(canonical(document))
    except (TypeError, ValueError) as error:
        raise PolicyFileError(f"new policy: metadata cannot be written as JSON: {error}") from error
    check_metadata(document, "new policy")
    return document


def _set_contract(of_set: SetOf) -> dict[str, Any]:
    """Return what a policy for any number of intruders promises beyond others."""
    contract: dict[str, Any] = {
        "schema": dict(EXTENDED_SCHEMA if of_set.inputs else SET_SCHEMA),
        "scene": SCENE,
        "task": {name: float(getattr(of_set.aircraft, name)) for name in _OF_AIRCRAFT},
        "family": {
            name: [float(bound) for bound in of_set.family[name]] for name in Ratios._fields
        },
    }
    if of_set.inputs:
        contract["inputs"] = [entry.contract() for entry in of_set.inputs]
    return contract


def check_metadata(document: Any, source: str) -> None:
    """Raise :class:`PolicyFileError` unless the metadata has the schema's fields, types and
    values.
    """
    schema = document.get("schema") if isinstance(document, dict) else None
    fields = {1: _FIELDS, 2: _SET_FIELDS, 3: _EXTENDED_FIELDS}
    schemas = (SCHEMA, *SET_SCHEMAS)
    demand = _Demand(source)
    demand(schema in schemas, "schema", schema, " or ".join(map(str, schemas)))
    of_set = schema in SET_SCHEMAS
    _check_fields(document, fields[document["schema"]["version"]], "metadata", source)
    if schema == EXTENDED_SCHEMA:
        _check_inputs(document["inputs"], source)
    _check_contracts(document, of_set, demand)
    architecture = document["architecture"]
    for name in ("hidden", "encoder") if of_set else ("hidden",):
        widths = architecture[name]
        good = 1 <= len(widths) <= _MAX_LAYERS and all(
            _is(w, int) and 1 <= w <= _MAX_WIDTH for w in widths
        )
        expected = f"1 to {_MAX_LAYERS} widths of 1 to {_MAX_WIDTH}"
        demand(good, f"architecture.{name}", widths, expected)
    if of_set:
        _check_family(document, demand)
    else:
        feature_set, choices = architecture["feature_set"], f"one of {', '.join(FEATURE_SETS)}"
        demand(feature_set in FEATURE_SETS, "architecture.feature_set", feature_set, choices)
    _check_limits(document, demand)
    steps = document["training"]["steps"]
    demand(steps >= 0, "training.steps", steps, "0 or more")
    for name, version in document["versions"].items():
        demand(isinstance(version, str), f"versions.{name}", version, "a string")


class _Demand(NamedTuple):
    """What the metadata of a source must hold."""

    source: str

    def __call__(self, holds: bool, name: str, value: Any, expected: str) -> None:
        """Raise a PolicyFileError about a value unless something holds."""
        if not holds:
            problem = f"is {_brief(value)}, expected {expected}"
            raise PolicyFileError(f"{self.source}: metadata.{name} {problem}")


def _check_contracts(document: Mapping[str, Any], of_set: bool, demand: _Demand) -> None:
    """Demand what is the same in all policies: what they see, what they do, and how."""
    architecture, training = document["architecture"], document["training"]
    digest = sha256(canonical(training["config"]))
    fixed = {
        "architecture.activation": (architecture["activation"], "tanh"),
        "architecture.output": (architecture["output"], "clip"),
        "training.config_sha256": (training["config_sha256"], digest),
    }
    observed = ("scene", SCENE) if of_set else ("observation", OBSERVATION)
    for name, contract in (observed, ("action", ACTION)):
        keys = sorted(contract.keys() | document[name].keys())
        fixed |= {f"{name}.{key}": (document[name].get(key), contract.get(key)) for key in keys}
    for name, (value, expected) in fixed.items():
        demand(value == expected, name, value, _brief(expected))


def _check_family(document: Mapping[str, Any], demand: _Demand) -> None:
    """Demand what a policy for any number of intruders and a family of aircraft says of them."""
    count = document["architecture"]["intruders"]
    most = f"1 to {_MAX_INTRUDERS}"
    demand(1 <= count <= _MAX_INTRUDERS, "architecture.intruders", count, most)
    try:
        new_aircraft(Limits(**document["limits"]), **document["task"])
    except AircraftError as error:
        raise PolicyFileError(f"{demand.source}: metadata.task: {error}") from None
    for name, bounds in document["family"].items():
        numbers = len(bounds) == 2 and all(_is(b, float) for b in bounds)
        good = numbers and bounds[0] <= bounds[1]
        demand(good, f"family.{name}", bounds, "[lowest, highest]")


def _check_limits(document: Mapping[str, Any], demand: _Demand) -> None:
    """Demand limits that a vehicle can have."""
    limits = Limits(**document["limits"])
    possible = (
        0.0 <= limits.speed_min < limits.speed_max <= FASTEST.speed_max
        and FASTEST.acceleration_min <= limits.acceleration_min < 0.0 < limits.acceleration_max
        and limits.acceleration_max <= FASTEST.acceleration_max
        and _LEAST_YAW_RATE <= limits.yaw_rate_max <= FASTEST.yaw_rate_max
    )
    expected = (
        f"those of a vehicle: speed_min below speed_max, a yaw rate of at least {_LEAST_YAW_RATE}, "
        f"and none beyond {tuple(FASTEST)}"
    )
    demand(possible, "limits", document["limits"], expected)


def tensor_shapes(document: Mapping[str, Any]) -> dict[str, tuple[int | None, ...]]:
    """Return the shape of every tensor that belongs to (checked) metadata; None is the number of
    parity vectors.
    """
    architecture = document["architecture"]
    shapes: dict[str, tuple[int | None, ...]] = {}
    outputs = len(ACTION["names"])
    of_set = document["schema"] in SET_SCHEMAS
    width, rows = size(architecture["feature_set"]) if not of_set else 0, SIZE
    layers = [(f"hidden_{i}", units) for i, units in enumerate(architecture["hidden"])] + [
        ("head", outputs)
    ]
    if of_set:
        encoder = TABLE.intruder_size + _numbers_of(document, INTRUDER)
        for i, units in enumerate(architecture["encoder"]):
            shapes |= {f"actor/each_{i}/kernel": (encoder, units), f"actor/each_{i}/bias": (units,)}
            encoder = units
        width = TABLE.own_size + _numbers_of(document, OWNSHIP) + encoder
        rows = parity_width(architecture["intruders"])
    for name, units in layers:
        shapes |= {f"actor/{name}/kernel": (width, units), f"actor/{name}/bias": (units,)}
        width = units
    return shapes | {
        "actor/log_std": (outputs,),
        PARITY_OBSERVATION: (None, rows),
        PARITY_ACTION: (None, outputs),
    }


def _numbers_of(document: Mapping[str, Any], of: str) -> int:
    """Return how many numbers the inputs of the user's own have of the ownship, or of an
    intruder.
    """
    return sum(
        len(contract["numbers"]) for contract in document.get("inputs", ()) if contract["of"] == of
    )


def check_values(tensors: Mapping[str, np.ndarray], source: str) -> None:
    """Raise :class:`PolicyFileError` unless all tensors are finite and bounded, the parity vectors
    by 1.
    """
    of_set = any(name.startswith("actor/each_") for name in tensors)
    # Parity vectors of schema 2 hold lengths in separations, within twenty of them.
    for name, tensor in tensors.items():
        if not np.isfinite(tensor).all():
            index = np.argwhere(~np.isfinite(tensor))[0].tolist()
            raise PolicyFileError(f"{source}: tensor {name} is not finite at {index}")
        most = (
            1.0
            if name == PARITY_ACTION or (name == PARITY_OBSERVATION and not of_set)
            else _MAX_WEIGHT
        )
        if np.abs(tensor).max() > most:
            raise PolicyFileError(f"{source}: tensor {name} leaves [{-most:g}, {most:g}]")


def _check_fields(
    value: Mapping[str, Any], fields: Mapping[str, Any], path: str, source: str
) -> None:
    """Raise unless an object has exactly these fields, of these types."""
    missing, unexpected = sorted(fields.keys() - value.keys()), sorted(value.keys() - fields.keys())
    if missing or unexpected:
        problem = (
            f"lacks {', '.join(missing)}"
            if missing
            else f"has unexpected {_brief(', '.join(unexpected))}"
        )
        raise PolicyFileError(
            f"{source}: {path} {problem}; expected the fields {', '.join(fields)}"
        )
    for name, expected in fields.items():
        kind = dict if isinstance(expected, dict) else expected
        if not _is(value[name], kind):
            raise PolicyFileError(
                f"{source}: {path}.{name} is {_brief(value[name])}, expected {_words(kind)}"
            )
        if isinstance(expected, dict):
            _check_fields(value[name], expected, f"{path}.{name}", source)


def _check_inputs(inputs: list[Any], source: str) -> None:
    """Raise unless the contract of the user's own inputs has its fields, types and values."""
    if not inputs or len(inputs) > _MAX_INPUTS:
        raise PolicyFileError(
            f"{source}: metadata.inputs has {len(inputs)} inputs, expected 1 to {_MAX_INPUTS}"
        )
    for number, contract in enumerate(inputs):
        path = f"metadata.inputs.{number}"
        if not isinstance(contract, dict):
            raise PolicyFileError(f"{source}: {path} is {_brief(contract)}, expected an object")
        _check_fields(contract, _INPUT_FIELDS, path, source)
        if contract["of"] not in (OWNSHIP, INTRUDER):
            raise PolicyFileError(
                f"{source}: {path}.of is {_brief(contract['of'])}, expected {OWNSHIP} or {INTRUDER}"
            )
        numbers = contract["numbers"]
        if not 1 <= len(numbers) <= _MAX_NUMBERS or not all(isinstance(n, dict) for n in numbers):
            raise PolicyFileError(
                f"{source}: {path}.numbers is {_brief(numbers)}, expected 1 to {_MAX_NUMBERS} "
                "objects"
            )
        for index, entry in enumerate(numbers):
            _check_fields(entry, _NUMBER_FIELDS, f"{path}.numbers.{index}", source)


def _is(value: Any, kind: Any) -> bool:
    """Return whether a JSON value is of a kind; true and false are not numbers here."""
    return isinstance(value, kind) and not isinstance(value, bool)


def _words(kind: Any) -> str:
    names = {
        dict: "an object",
        list: "a list",
        str: "a string",
        int: "an integer",
        float: "a number with a point",
    }
    return "a number with a point, or null" if isinstance(kind, tuple) else names[kind]


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 160 else text[:160] + "..."
