"""Reading and writing of a policy: one safetensors file with tensors, JSON metadata and a digest
over both.

The format stands in docs/reference/policy-file.md. All of a file is checked before any of it is
used.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load, save

from agents.policy.digest import canonical, digest
from agents.policy.schema import (
    PARITY_ACTION,
    PARITY_OBSERVATION,
    SET_SCHEMAS,
    PolicyFileError,
    check_metadata,
    check_values,
    tensor_shapes,
)
from commands.files import check_regular, write_file
from commands.json_text import parse_json
from envs.aircraft import PAPER, Aircraft
from envs.kinematics import Limits

MAX_BYTES = 64 * 1024 * 1024
"""Larger files are refused unread; the default architecture takes 0.3 MB."""

_KEY = "rlcas_policy"
_ENTRY = {"dtype", "shape", "data_offsets"}


@dataclass(frozen=True)
class PolicyFile:
    """Content of a policy file."""

    actor: Mapping[str, np.ndarray]
    """Float32 tensors by name without ``actor/``: ``hidden_0/kernel`` [in, out], ``hidden_0/bias``
    [out], ..., ``head/kernel``, ``head/bias``, and ``log_std`` [2], which flying ignores."""
    parity_observation: np.ndarray
    """Observations, float32 ``[P, 8]``, or rows of :func:`agents.policy.scene.unpack_rows`."""
    parity_action: np.ndarray
    """The actions ``[P, 2]`` that the training framework computes for these observations."""
    metadata: Mapping[str, Any]
    """As :func:`agents.policy.schema.new_metadata` makes it, without the digest."""

    @property
    def tensors(self) -> dict[str, np.ndarray]:
        """All tensors by their names in the file."""
        named = {f"actor/{name}": tensor for name, tensor in self.actor.items()}
        return named | {
            PARITY_OBSERVATION: self.parity_observation,
            PARITY_ACTION: self.parity_action,
        }

    @cached_property
    def sha256(self) -> str:
        """The digest over tensors and metadata, hex."""
        return digest(self.tensors, self.metadata)

    @property
    def hidden(self) -> tuple[int, ...]:
        """Widths of the hidden layers."""
        return tuple(self.metadata["architecture"]["hidden"])

    @property
    def encoder(self) -> tuple[int, ...]:
        """Widths of the layers that each intruder of a set passes; none for schema 1."""
        return tuple(self.metadata["architecture"].get("encoder", ()))

    def layers(self, kind: str, dtype: DTypeLike) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return kernel ``[in, out]`` and bias ``[out]`` of the layers of a kind: ``each``,
        ``hidden`` or ``head``.
        """
        count = {"each": len(self.encoder), "hidden": len(self.hidden)}
        names = [f"{kind}_{i}" for i in range(count[kind])] if kind in count else [kind]
        return [
            (self.actor[f"{name}/kernel"].astype(dtype), self.actor[f"{name}/bias"].astype(dtype))
            for name in names
        ]

    @property
    def of_set(self) -> bool:
        """Whether the network takes any number of intruders (schemas 2 and 3)."""
        return self.metadata["schema"] in SET_SCHEMAS

    @property
    def extensions(self) -> tuple[Mapping[str, Any], ...]:
        """The contracts of the inputs of the user's own that the network needs."""
        return tuple(self.metadata.get("inputs", ()))

    @property
    def feature_set(self) -> str:
        """The inputs that the network derives: ``set``, or one of
        :data:`agents.policy.features.FEATURE_SETS`.
        """
        return "set" if self.of_set else self.metadata["architecture"]["feature_set"]

    @property
    def aircraft(self) -> Aircraft:
        """The aircraft that the policy was trained for; of schema 1 with the paper's separation and
        traffic.
        """
        # A file states no vehicle, but that of the paper's aircraft is known.
        paper = PAPER._replace(vehicle=None)
        if self.of_set:
            stated = Aircraft(self.limits, **self.metadata["task"])
        else:
            stated = paper._replace(limits=self.limits)
        return PAPER if stated == paper else stated

    @property
    def limits(self) -> Limits:
        """Of the vehicle that the policy was trained for."""
        return Limits(**self.metadata["limits"])


IN_FOLDER = "policy.safetensors"
"""Name of the policy file in the folder of a training."""


def locate(path: str | os.PathLike[str]) -> Path:
    """Return the path of a policy file, given itself or the folder of a training."""
    source = Path(path)
    return source / IN_FOLDER if source.is_dir() else source


def read(path: str | os.PathLike[str]) -> PolicyFile:
    """Return a policy file, or that of a training's folder; raises a PolicyFileError where it is
    missing, unreadable, too large or not right.
    """
    source = locate(path)
    try:
        check_regular(source)
        size = source.stat().st_size
        if size > MAX_BYTES:
            raise PolicyFileError(f"{source}: {size} bytes, expected at most {MAX_BYTES}")
        data = source.read_bytes()
    except FileNotFoundError as error:
        raise PolicyFileError(f"{source}: no such policy file") from error
    except OSError as error:
        message = (
            f"{source}: cannot be read: {error.strerror}, expected a policy file (.safetensors)"
        )
        raise PolicyFileError(message) from error
    return parse(data, str(source))


def claims(path: str | os.PathLike[str]) -> bool:
    """Return whether a file says of itself that it is a policy, damaged or not; False where it
    cannot be read.
    """
    try:
        check_regular(path)
        with safe_open(path, "np") as tensors:
            return _KEY in (tensors.metadata() or {})
    except (OSError, SafetensorError):
        return False


def parse(data: bytes, source: str) -> PolicyFile:
    """Check the bytes of a policy file, whose name is for messages, and return its content; arrays
    are read-only.

    The parity vectors are returned, not evaluated: that takes the network
    (:class:`agents.inference.Policy`).

    Raises:
        PolicyFileError: the bytes are no policy file of this schema, or are damaged, inconsistent
            or not finite.
    """
    tensors, entry = _load(data, source)
    metadata = _metadata(entry, source)
    claimed = metadata.pop("sha256", None)
    check_metadata(metadata, source)
    _check_tensors(tensors, tensor_shapes(metadata), source)
    actual = digest(tensors, metadata)
    if claimed != actual:
        raise PolicyFileError(
            f"{source}: the content has SHA-256 {actual}, expected {claimed!r}: edited or damaged"
        )
    check_values(tensors, source)
    for tensor in tensors.values():
        tensor.flags.writeable = False
    observation, action = tensors.pop(PARITY_OBSERVATION), tensors.pop(PARITY_ACTION)
    actor = {name.removeprefix("actor/"): tensor for name, tensor in tensors.items()}
    return PolicyFile(actor, observation, action, metadata)


def serialise(policy: PolicyFile) -> bytes:
    """Return the bytes of a policy file, equal ones for equal content; raises a PolicyFileError as
    :func:`parse`.
    """
    tensors = {name: np.ascontiguousarray(tensor) for name, tensor in policy.tensors.items()}
    try:
        document = canonical({**policy.metadata, "sha256": digest(tensors, policy.metadata)})
        data = save(tensors, metadata={_KEY: document})
    except (SafetensorError, TypeError, ValueError) as error:
        raise PolicyFileError(f"new policy: cannot be written: {error}") from error
    if len(data) > MAX_BYTES:
        raise PolicyFileError(f"new policy: {len(data)} bytes, expected at most {MAX_BYTES}")
    parse(data, "new policy")
    return data


def write(path: str | os.PathLike[str], policy: PolicyFile) -> None:
    """Write a policy file, whole or not at all, even in a power cut; raise a PolicyFileError where
    it cannot be.
    """
    data = serialise(policy)
    try:
        write_file(path, data)
    except OSError as error:
        raise PolicyFileError(f"{os.fspath(path)}: cannot be written: {error.strerror}") from error


def _load(data: bytes, source: str) -> tuple[dict[str, np.ndarray], Any]:
    """Return the tensors of a safetensors file and its ``__metadata__``."""
    try:
        tensors = load(data)
        text = data[8 : 8 + int.from_bytes(data[:8], "little")].decode()
        header = parse_json(text)
        plain = json.dumps(header, separators=(",", ":"), ensure_ascii=False)
        blanks = -len(plain.encode()) % 8  # they fill it to a multiple of eight bytes
    except (SafetensorError, LookupError, ValueError, RecursionError) as error:
        raise PolicyFileError(f"{source}: not a valid safetensors file: {error}") from error
    entry = header.pop("__metadata__", None)
    # The digest covers what the header means. Holding its text to one spelling makes every byte
    # count.
    if text != plain + " " * blanks or any(tensor.keys() != _ENTRY for tensor in header.values()):
        raise PolicyFileError(f"{source}: the header is not in canonical form: edited or damaged")
    return tensors, entry


def _metadata(entry: Any, source: str) -> dict[str, Any]:
    if not isinstance(entry, dict) or list(entry) != [_KEY] or not isinstance(entry[_KEY], str):
        raise PolicyFileError(
            f"{source}: no policy metadata, expected the one key {_KEY!r} in the header"
        )
    try:
        document = parse_json(entry[_KEY])
        same = canonical(document) == entry[_KEY]
    except (ValueError, RecursionError) as error:
        raise PolicyFileError(f"{source}: metadata is not canonical JSON: {error}") from error
    if not isinstance(document, dict) or not same:
        raise PolicyFileError(
            f"{source}: metadata is not one object of canonical JSON: edited or damaged"
        )
    return document


def _check_tensors(
    tensors: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int | None, ...]], source: str
) -> None:
    """Raise unless these are exactly the tensors of the architecture, in float32 and of its
    shapes.
    """
    for name in sorted(shapes.keys() ^ tensors.keys(), key=lambda name: (name in tensors, name)):
        problem = "is unexpected" if name in tensors else "is missing"
        raise PolicyFileError(f"{source}: tensor {name!r} {problem}; expected {', '.join(shapes)}")
    for name, expected in shapes.items():
        _check_tensor(name, tensors[name], expected, source)
    counts = {len(tensors[PARITY_OBSERVATION]), len(tensors[PARITY_ACTION])}
    if len(counts) != 1 or counts == {0}:
        raise PolicyFileError(
            f"{source}: parity tensors hold {sorted(counts)} vectors, expected one number above 0"
        )


def _check_tensor(
    name: str, tensor: np.ndarray, expected: tuple[int | None, ...], source: str
) -> None:
    """Raise unless a tensor is of float32 and of the expected shape, in which None is the number of
    parity vectors.
    """
    if tensor.dtype != np.float32:
        raise PolicyFileError(f"{source}: tensor {name} has dtype {tensor.dtype}, expected float32")
    shape = tensor.shape
    alike = len(shape) == len(expected) and all(
        length is None or have == length for have, length in zip(shape, expected, strict=True)
    )
    if not alike:
        sizes = ["P" if length is None else length for length in expected]
        raise PolicyFileError(f"{source}: tensor {name} has shape {list(shape)}, expected {sizes}")
