"""The benchmark of wrong fields reports what it says, and holds plans against the true flight."""

import math

import numpy as np
import pytest

from agents.assurance.thresholds import Thresholds
from agents.planner.request.options import Options
from agents.planner.request.request import in_wind
from agents.policy.inference import Policy
from benchmarks.wrong_fields import ERRORS, KINDS, Scenes, covers, draw, follow, plan, reports
from envs.wind import NO_WIND

SECONDS = 40


@pytest.fixture(scope="module", name="policy")
def _policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module", name="scenes")
def _scenes(policy: Policy) -> Scenes:
    return draw(60, 3, policy)


def errors(scenes: Scenes, kind: str) -> tuple[float, float]:
    """Return the root mean squares of reported positions and velocities, per axis, m and m/s."""
    far, fast = [], []
    for second, state in enumerate(reports(scenes, kind, 1)):
        true = scenes.true(float(second))
        far.append(np.hypot(state.x[:, 0] - true.x, state.y[:, 0] - true.y))
        turned = state.speed[:, 0] * np.exp(1j * state.heading[:, 0])
        fast.append(np.abs(turned - true.speed * np.exp(1j * true.heading)))
    return tuple(math.sqrt(0.5 * float(np.mean(np.square(off)))) for off in (far, fast))


def test_right_reports_have_their_errors_alone(scenes: Scenes) -> None:
    assert errors(scenes, "right") == pytest.approx(ERRORS, rel=0.05)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "right"])
def test_one_field_is_wrong(scenes: Scenes, kind: str) -> None:
    far, fast = errors(scenes, kind)
    late = kind in ("late", "held", "two clocks")
    assert (far > 3.0 * ERRORS[0]) == late
    assert (fast > 1.5 * ERRORS[1]) == (not late)


def test_plans_are_held_against_the_true_flight(scenes: Scenes, policy: Policy) -> None:
    usual = Options.for_aircraft(policy.aircraft)
    thresholds = Thresholds.for_plans(usual).in_wind(NO_WIND)
    violated = {}
    for kind in ("right", "knots for m/s"):
        received = reports(scenes, kind, 1)[:2]
        *_, moment = follow(scenes, received, True, thresholds)
        made = plan(scenes, moment, 1.0, policy, in_wind(usual, None))
        assert made.safe.mean() > 0.9
        violated[kind] = np.mean(made.below > 0.0)
        assert covers(scenes, moment, 1.0).mean() == pytest.approx(
            1.0 if kind == "right" else 0.0, abs=0.1
        )
    # Nothing of two reports shows that their speeds are wrong.
    assert violated["right"] < 0.05 and violated["knots for m/s"] > 0.5
