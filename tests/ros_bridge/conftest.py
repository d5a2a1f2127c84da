"""Nodes compile before they are ready: here once for all, lest each test waits for it."""

import pytest

from envs import compiled
from tests.conftest import compile_planner


@pytest.fixture(scope="session", autouse=True)
def _compiled_beforehand() -> None:
    """Compile what the nodes compile; they load it then."""
    before = compiled.in_use()
    compile_planner()
    compiled.use(before)
