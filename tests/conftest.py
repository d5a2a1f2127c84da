"""Settings of all tests: Hypothesis repeats its examples from run to run unless a search for new ones is asked for.

What JAX compiles is kept as the programs keep it, for the other processes of a run and for later runs.
"""

import os

from hypothesis import HealthCheck, settings

from agents.planner import budget
from envs.edge.compiled import keep_compiled

_COMMON = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("repeatable", derandomize=True, max_examples=30, **_COMMON)
settings.register_profile("search", derandomize=False, max_examples=1000, print_blob=True, **_COMMON)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))


# The first plan of a process, or one beside other work, takes more than its deadline: tests have a minute more, and
# those of the deadline itself take FINISH.
FINISH, budget._FINISH = budget._FINISH, -60.0


keep_compiled()  # pytest's workers and the programs that tests start inherit it
