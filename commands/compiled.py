"""What is compiled, kept in the user's cache folder for the next program that compiles the same.

Machine code fits only the processor that it was made for: versions, the processor and its
instructions are part of the folder's name. A folder that cannot be used costs time only. JAX has
variables of its own to say otherwise: ``JAX_ENABLE_COMPILATION_CACHE=false`` keeps nothing,
``JAX_COMPILATION_CACHE_DIR`` names another folder.
"""

import hashlib
import os
import platform
import shutil
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from commands.command import ConfigError

_LARGE = 1 << 30
"""Size of all folders, bytes, from which on they are emptied."""


def keep_compiled() -> None:
    """Have JAX keep what it compiles, in this process if it is not imported yet and in those that
    this one starts.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    try:
        versions = metadata.version("jax"), metadata.version("jaxlib")
    except metadata.PackageNotFoundError:
        return
    folder = cache_folder(*versions)
    if folder is None:
        return
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")


def cache_folder(*made_with: str) -> Path | None:
    """Return the folder of what is compiled from and with some versions, with this Python on this
    processor; None where there is no room or no home.
    """
    parts = [platform.python_version(), *made_with, _processor()]
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    try:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = root / "rlcas-toolkit" / "compiled" / digest
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            return None
        files = (file for file in folder.parent.rglob("*") if file.is_file())
        if sum(file.stat().st_size for file in files) > _LARGE:
            for old in folder.parent.iterdir():
                shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):
        return None
    return folder


def local_devices(jax: ModuleType) -> list[Any]:
    """Return this process's devices of JAX, whose module is given.

    Raises:
        ConfigError: ``JAX_PLATFORMS`` names a platform that has none.
    """
    try:
        return jax.local_devices()
    except (AssertionError, RuntimeError):
        platforms = jax.config.jax_platforms
        if not platforms:
            raise
        jax.config.update("jax_platforms", None)
        available = sorted({"cpu", *(device.platform for device in jax.local_devices())})
    raise ConfigError(
        f"JAX_PLATFORMS is {platforms}, of which JAX finds no device; expected one that there is: "
        f"{', '.join(available)}"
    )


def _processor() -> str:
    """Return the processor's model and its instructions; where the system does not say them, the
    machine's name.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return f"{platform.machine()} {platform.node()}"
    return "\n".join(
        sorted({line for line in lines if line.startswith(("model", "flags", "Features", "CPU "))})
    )
