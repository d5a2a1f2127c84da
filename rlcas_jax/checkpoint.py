"""Checkpoints: any pytree of arrays in one safetensors file, written whole or not at all.

A kill or a power cut at any moment leaves those before it as they were; a digest shows a damaged
file.
"""

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as save_tensors

from commands.command import InputError
from commands.files import check_regular, write_file
from commands.json_text import parse_json

SCHEMA = "rlcas-checkpoint-1"
_KEPT = 3  # newest checkpoints that stay
_HEADER = "rlcas-checkpoint"
_NAME = "checkpoint-{:010d}.safetensors"
_log = logging.getLogger(__name__)


class CheckpointError(InputError):
    """A checkpoint that cannot be used; the message says which and why."""


def save(directory: Path, number: int, tree: Any, meta: Mapping[str, Any]) -> Path:
    """Write a checkpoint, remove all but the newest three, and return its path.

    The directory is made if it is not there, its parent is not: that of a run may have gone. The
    number, >= 0, orders the checkpoints; leaves of the tree are arrays of dtypes that numpy knows;
    meta is anything that JSON can hold.
    """
    tensors = {name: np.array(leaf, order="C") for name, leaf in _leaves(tree).items()}
    directory.mkdir(exist_ok=True)
    written = json.dumps(dict(meta))
    header = {"schema": SCHEMA, "meta": written, "sha256": _digest(tensors, written)}
    path = directory / _NAME.format(number)
    for partial in directory.glob(".checkpoint-*.tmp"):  # by a process that was killed
        partial.unlink()
    # All under one key: safetensors writes several in an order that changes from run to run.
    write_file(path, save_tensors(tensors, {_HEADER: json.dumps(header)}))
    for old in _checkpoints_of(directory)[_KEPT:]:
        old.unlink()
    return path


def latest(directory: Path) -> Path:
    """Return the newest whole checkpoint, passing over others with a warning; without any raises a
    CheckpointError.
    """
    stored = _checkpoints_of(directory)
    for path in stored:
        try:
            _read(path)
        except CheckpointError as problem:
            _log.warning("%s; taking the one before it", problem)
        else:
            return path
    text = f"none of its {len(stored)} checkpoints is whole" if stored else "there is no checkpoint"
    raise CheckpointError(f"{directory}: {text}")


def meta(path: Path) -> dict[str, Any]:
    """Return the meta data of a checkpoint; raises a CheckpointError where it is not there or not
    whole.
    """
    return _read(path)[1]


def restore(path: Path, like: Any, part: str = "") -> Any:
    """Return the tree of a checkpoint, bit for bit as saved.

    Args:
        like: has the structure, shapes and dtypes that are expected, for instance of
            ``jax.eval_shape``.
        part: take this field alone of the named tuple that the checkpoint holds, whatever the
            others are.

    Raises:
        CheckpointError: the file is not there, not whole, or not of this structure.
    """
    begins = f".{part}" if part else ""
    tensors = {
        name.removeprefix(begins): array
        for name, array in _read(path)[0].items()
        if name.startswith(begins)
    }
    expected = _leaves(like)
    for name in [
        *(n for n in expected if n not in tensors),
        *(n for n in tensors if n not in expected),
    ]:
        has, lacks = (path, "this run") if name in tensors else ("this run", path)
        raise CheckpointError(
            f"{path}: made by another structure ({name} is in {has} and not in {lacks})"
        )
    for name, leaf in expected.items():
        stored, dtype = tensors[name], np.dtype(leaf.dtype)
        if (stored.shape, stored.dtype) != (leaf.shape, dtype):
            stored_as = f"{stored.dtype}{list(stored.shape)}; expected {dtype}{list(leaf.shape)}"
            raise CheckpointError(f"{path}: {name} is {stored_as}")
    return jax.tree.unflatten(
        jax.tree.structure(like), [jnp.asarray(tensors[name]) for name in expected]
    )


def _leaves(tree: Any) -> dict[str, Any]:
    return {
        jax.tree_util.keystr(path) or "root": leaf
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def _digest(tensors: Mapping[str, np.ndarray], meta: str) -> str:
    digest = hashlib.sha256(json.dumps([SCHEMA, meta]).encode())
    for name in sorted(tensors):
        array = tensors[name]
        digest.update(json.dumps([name, str(array.dtype), array.shape]).encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return a checkpoint's arrays and meta data after checking that it is whole."""
    try:
        check_regular(path)
        with safe_open(path, "np") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
            header = parse_json((file.metadata() or {}).get(_HEADER, "{}"))
    except FileNotFoundError:
        raise CheckpointError(f"{path}: there is no such checkpoint") from None
    except (OSError, SafetensorError, ValueError) as problem:
        raise CheckpointError(f"{path}: not a whole checkpoint ({problem})") from None
    if header.get("schema") != SCHEMA:
        raise CheckpointError(
            f"{path}: its schema is {header.get('schema')!r}; expected {SCHEMA!r}"
        )
    if _digest(tensors, header["meta"]) != header["sha256"]:
        raise CheckpointError(
            f"{path}: not a whole checkpoint (its digest does not match its content)"
        )
    return tensors, parse_json(header["meta"])


def _checkpoints_of(directory: Path) -> list[Path]:
    """Return the checkpoints of a directory, newest first."""
    return sorted(directory.glob("checkpoint-[0-9]*.safetensors"), reverse=True)
