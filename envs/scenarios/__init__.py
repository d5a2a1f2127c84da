"""Scenarios: which encounters are drawn. A scenario is a geometry and modifiers of it, such as
``circle + standing + partly_seen``.
"""

from envs.scenarios.names import (
    SAMPLERS,
    canonical,
    expected,
    is_loaded,
    register,
    resolve,
    sampler_of,
    scenario,
)
from envs.scenarios.sampling import check_training, sample, ships
from envs.scenarios.table import MODIFIERS, SCENARIOS, SHIPPED

__all__ = [
    "MODIFIERS",
    "SAMPLERS",
    "SCENARIOS",
    "SHIPPED",
    "canonical",
    "check_training",
    "expected",
    "is_loaded",
    "register",
    "resolve",
    "sample",
    "sampler_of",
    "scenario",
    "ships",
]
