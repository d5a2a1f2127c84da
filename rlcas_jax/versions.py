"""What a run was made with."""

import platform
import sys
from importlib import metadata

__all__ = ["versions"]

_PACKAGES = ("rlcas-toolkit", "numpy", "jax", "jaxlib", "flax", "optax", "safetensors")


def versions() -> dict[str, str]:
    """Return the versions of Python, the platform and the packages that decide a run's numbers."""
    found = {"python": sys.version.split()[0], "platform": platform.platform(), "machine": platform.machine()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
