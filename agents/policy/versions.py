"""What a policy, a training or an evaluation was made with."""

import platform
from importlib import metadata


def versions(*packages: str) -> dict[str, str]:
    """Return the version of Python and of each package; ``not installed`` where there is none."""
    found = {"python": platform.python_version()}
    for package in ("rlcas-toolkit", *packages):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
