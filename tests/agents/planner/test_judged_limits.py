"""Which legs are right, by compiled code and by numpy."""

import numpy as np
import pytest

from agents.planner.judge.limits import FILL_RIGHT_LEGS, right_legs
from envs import compiled
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits
from envs.waypoints import legs
from tests.agents.planner.test_validator import plans

pytestmark = pytest.mark.usefixtures("compiled_code")


@pytest.mark.parametrize("limits", [SURROGATE, C208_PUBLISHED, Limits(70.0, 75.0, -0.1, 0.2, 0.02)])
@pytest.mark.parametrize("off", [0.0, 10.0, 1_000.0])
def test_compiled_code_and_numpy_agree_on_each_leg(
    monkeypatch: pytest.MonkeyPatch, limits: Limits, off: float
) -> None:
    plan_states, rng = plans(60, 5), np.random.default_rng(6)
    x = plan_states.x + rng.normal(0.0, off, plan_states.x.shape)
    curves = legs(plan_states._replace(x=x))
    for field, place in (
        (curves.speed, (0, 3, 4)),
        (curves.yaw_rate, (1, 2, 0)),
        (curves.acceleration, (3, 0, 9)),
        (curves.miss, (2, 1)),
    ):
        field[place] = np.nan
    assert FILL_RIGHT_LEGS.ready
    by_loops = right_legs(curves, limits)
    monkeypatch.setattr(compiled.Entry, "ready", False)
    by_numpy = right_legs(curves, limits)
    for compiled_field, numpy_field in zip(by_loops, by_numpy, strict=True):
        np.testing.assert_array_equal(compiled_field, numpy_field)
        assert numpy_field.any() and not numpy_field.all()
