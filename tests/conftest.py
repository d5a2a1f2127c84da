"""Settings of all tests: Hypothesis repeats its examples from run to run unless a search for new ones is asked for.

What JAX compiles is kept in the user's cache folder, for the other processes of a run (pytest's workers and the
programs that tests start) and for later runs; versions and the processor are part of the folder's name.
"""

import hashlib
import os
import platform
import shutil
from importlib import metadata
from pathlib import Path

from hypothesis import HealthCheck, settings

from agents.planner import budget

_LARGE = 2 << 30
"""A cache of more bytes begins anew."""

_COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("repeatable", derandomize=True, max_examples=30, **_COMMON)
settings.register_profile("search", derandomize=False, max_examples=1000, print_blob=True, **_COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))


# The first plan of a process, or one beside other work, takes more than its deadline: tests have a minute more, and
# those of the deadline itself take FINISH.
FINISH, budget._FINISH = budget._FINISH, -60.0


def _processor() -> str:
    """Return what compiled code depends on: the processor's model and its instructions."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))


def _cache() -> Path:
    """Return the folder of what is compiled with these versions on this processor."""
    made_with = [platform.python_version(), *(f"{name} {metadata.version(name)}" for name in ("jax", "jaxlib"))]
    key = hashlib.sha256("\n".join([*made_with, _processor()]).encode()).hexdigest()[:16]
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = root / "rlcas-toolkit" / f"compiled-{key}"
    if sum(entry.stat().st_size for entry in folder.glob("*")) > _LARGE:
        shutil.rmtree(folder, ignore_errors=True)
    return folder


if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # pytest's workers inherit it from the process that starts them
    os.environ |= {
        "JAX_COMPILATION_CACHE_DIR": str(_cache()),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.3",
    }
