"""The devices that a training runs on: one, all that are visible, or those of several processes.

Encounters are split over the devices; what is learned is the same on all. The first process alone
writes.
"""

import os
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Thread
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from agents.config.load import ConfigError
from commands.compiled import local_devices
from rlcas_jax.cli import Processes

AXIS = "encounters"  # name of the mesh's one axis
_PATIENCE_S = 5.0  # between two notes that other processes are waited for


@dataclass(frozen=True)
class Devices:
    """Where the arrays of a training are."""

    mesh: Mesh | None  # None on one device, where nothing is split

    @property
    def count(self) -> int:
        """Number of devices."""
        return 1 if self.mesh is None else self.mesh.size

    @property
    def axis(self) -> str | None:
        """Name of the axis that is split, if any."""
        return None if self.mesh is None else AXIS

    def split(self) -> NamedSharding | None:
        """Return the sharding of arrays whose first axis is that of the encounters."""
        return None if self.mesh is None else NamedSharding(self.mesh, PartitionSpec(AXIS))

    def replicated(self) -> NamedSharding | None:
        """Return the sharding of what every device has."""
        return None if self.mesh is None else NamedSharding(self.mesh, PartitionSpec())


_GPU_OPTIONS: Mapping[str, bool | int] = {
    "xla_gpu_autotune_level": 0,
    "xla_gpu_enable_triton_gemm": False,
}
"""Trying out kernels takes minutes for an update, and gains nothing for products as small as these
networks'."""


def compiler_options() -> dict[str, bool | int] | None:
    """Return the options with which an update is compiled: on a GPU those that shorten compiling,
    but for what the environment variable ``XLA_FLAGS`` sets.
    """
    if jax.default_backend() != "gpu":
        return None
    flags = os.environ.get("XLA_FLAGS", "")
    return {name: value for name, value in _GPU_OPTIONS.items() if name not in flags}


def connect(devices: int | None = None, processes: Processes | None = None) -> Devices:
    """Prepare JAX, before anything else asks it for a device, and return the devices to train on.

    Args:
        devices: how many each process uses; a CPU is divided into so many. None: all that are
            visible.
        processes: the processes that train together; None: this one alone.

    Raises:
        ConfigError: JAX computes in double precision, there are fewer devices, or none of the
            platform that is asked for, or the other processes cannot be reached.
    """
    if jax.config.read("jax_enable_x64"):
        raise ConfigError(
            "JAX_ENABLE_X64 (jax_enable_x64) is on; expected it off, a training is in single "
            "precision"
        )
    if devices is not None:
        jax.config.update("jax_num_cpu_devices", devices)
    if processes is not None:
        _join(processes)
    local = local_devices(jax)
    count = len(local) if devices is None else devices
    if count > len(local):
        raise ConfigError(
            f"--devices is {count}; expected at most {len(local)}, the visible {local[0].platform} "
            "devices"
        )
    of_each = [
        [device for device in jax.devices() if device.process_index == i]
        for i in range(jax.process_count())
    ]
    chosen = [device for theirs in of_each for device in theirs[:count]]
    return Devices(None if len(chosen) == 1 else Mesh(np.array(chosen), (AXIS,)))


def _join(processes: Processes) -> None:
    """Wait until all processes that train together have begun, and say so."""
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    address = None if processes.coordinator == "auto" else processes.coordinator
    others = "the others" if processes.count is None else f"{processes.count - 1} others"
    where = f"--coordinator {processes.coordinator}: waiting for {others}"
    # Both wait for the others: the greeting, and the first look at all devices.
    with _says_that_it_waits(where):
        try:
            jax.distributed.initialize(address, processes.count, processes.number)
            jax.devices()
        except (RuntimeError, ValueError) as problem:
            reason = str(problem).strip().splitlines()[0]
            raise ConfigError(
                f"--coordinator {processes.coordinator}: the processes did not find each other "
                f"({reason})"
            ) from None


@contextmanager
def _says_that_it_waits(task: str) -> Generator[None, None, None]:
    """Say every :data:`_PATIENCE_S` on the standard error that what is inside still waits."""
    finished = Event()

    def say() -> None:
        began = time.monotonic()
        while not finished.wait(_PATIENCE_S):
            print(f"note: {task}, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)

    teller = Thread(target=say, daemon=True)
    teller.start()
    try:
        yield
    finally:
        finished.set()
        teller.join()


def is_writer() -> bool:
    """Return whether this process is the one that writes."""
    return jax.process_index() == 0


def agree(flags: Sequence[bool]) -> list[bool]:
    """Return which flags any of the processes has raised; all of them must ask at the same
    point.
    """
    if jax.process_count() == 1:
        return list(flags)
    raised = np.asarray(multihost_utils.process_allgather(np.array(flags, np.int32)))
    return [bool(count) for count in raised.reshape(jax.process_count(), -1).sum(axis=0).tolist()]


def everywhere(tree: Any) -> Any:
    """Return a tree with whole arrays in every process; all of them must ask at the same point."""
    if jax.process_count() == 1:
        return tree
    return jax.tree.map(
        lambda leaf: (
            leaf
            if leaf.is_fully_replicated
            else multihost_utils.process_allgather(leaf, tiled=True)
        ),
        tree,
    )


def place(tree: Any, shardings: Any) -> Any:
    """Put whole arrays, which every process has, where a tree of shardings, or its beginning, says;
    None: nowhere.
    """
    if shardings is None:
        return tree

    def put(sharding: NamedSharding, part: Any) -> Any:
        whole = jax.tree.map(np.asarray, part)
        return jax.tree.map(
            lambda a: jax.make_array_from_callback(a.shape, sharding, a.__getitem__), whole
        )

    return jax.tree.map(put, shardings, tree, is_leaf=lambda node: isinstance(node, NamedSharding))
