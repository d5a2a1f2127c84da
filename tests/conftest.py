"""Settings of all tests: Hypothesis repeats its examples from run to run unless a search for new ones is asked for.

What JAX compiles is kept for the other processes of the same run (pytest's workers and the programs that tests start),
which mostly compile the same things; the next run compiles anew.
"""

import atexit
import os
import shutil
import tempfile

from hypothesis import HealthCheck, settings

_COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("repeatable", derandomize=True, max_examples=30, **_COMMON)
settings.register_profile("search", derandomize=False, max_examples=1000, print_blob=True, **_COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # pytest's workers inherit it from the process that starts them
    _compiled = tempfile.mkdtemp(prefix="rlcas-compiled-")
    atexit.register(shutil.rmtree, _compiled, ignore_errors=True)
    os.environ |= {"JAX_COMPILATION_CACHE_DIR": _compiled, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.3"}
