"""The legs by compiled code are those by numpy."""

import numpy as np
import pytest

from envs import compiled, waypoints
from envs.scalar_legs import SOLVE_LEGS
from envs.waypoints import CLOSED, Legs, PlanStates
from tests.envs.test_waypoints import ends, history

pytestmark = pytest.mark.usefixtures("compiled_code")


def both(monkeypatch: pytest.MonkeyPatch, plan_states: PlanStates) -> tuple[Legs, Legs]:
    """Return the legs by compiled code, and by numpy."""
    assert SOLVE_LEGS.ready
    by_loops = waypoints.legs(plan_states)
    with monkeypatch.context() as patch:
        patch.setattr(compiled.Entry, "ready", False)
        return by_loops, waypoints.legs(plan_states)


@pytest.mark.parametrize("off", [0.0, 1.0, 100.0, 3_000.0])
@pytest.mark.parametrize("turned", [0.0, 1.0])
def test_compiled_legs_are_those_by_numpy(
    monkeypatch: pytest.MonkeyPatch, off: float, turned: float
) -> None:
    rng, plan_states = np.random.default_rng([int(off), int(turned)]), ends(history(200, 4, 5))
    shape = plan_states.x.shape
    plan_states = plan_states._replace(
        x=plan_states.x + rng.normal(0.0, off, shape),
        heading=plan_states.heading + rng.normal(0.0, turned, shape),
    )
    by_loops, by_numpy = both(monkeypatch, plan_states)
    closed = by_numpy.miss <= CLOSED
    np.testing.assert_array_equal(by_loops.miss <= CLOSED, closed)
    for compiled_field, numpy_field in zip(by_loops, by_numpy, strict=True):
        assert compiled_field.shape == numpy_field.shape
        np.testing.assert_allclose(compiled_field[closed], numpy_field[closed], rtol=0.0, atol=1e-8)
    assert closed.any()


@pytest.mark.parametrize("shape", [(2,), (1,), (3, 1), (0, 4), (2, 3, 5)])
def test_plan_states_of_any_shape_are_taken(
    monkeypatch: pytest.MonkeyPatch, shape: tuple[int, ...]
) -> None:
    time = np.broadcast_to(20.0 * np.arange(shape[-1]), shape)
    by_loops, by_numpy = both(
        monkeypatch, PlanStates(70.0 * time, 0.0 * time, 0.1 + 0.0 * time, 70.0 + 0.0 * time, time)
    )
    for compiled_field, numpy_field in zip(by_loops, by_numpy, strict=True):
        assert compiled_field.shape == numpy_field.shape
        np.testing.assert_allclose(compiled_field, numpy_field, rtol=0.0, atol=1e-8)


def test_what_is_not_a_number_shows_in_the_miss() -> None:
    time = np.array([0.0, 20.0, 20.0, 40.0])
    x = np.array([0.0, 1_500.0, 1_500.0, np.nan])
    curves = waypoints.legs(PlanStates(x, 0.0 * time, 0.0 * time, 75.0 + 0.0 * time, time))
    assert curves.miss[0] <= CLOSED
    assert np.isnan(curves.miss[1:]).all()
