"""Encounters in a wind: the same conflict through the air, with the goal over the ground."""

from typing import Any

import numpy as np
import pytest

from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.relative import distance
from envs.scenarios import scenario
from eval.config import MonteCarloConfig
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns, pick
from eval.flights.recorded import fly_recorded
from eval.flights.simulate import OUTCOMES

COUNT = 12
SOURCE = scenario("circle", PAPER)


def pilot(mode: str, wind: tuple[float, float]) -> ReadyEvaluation:
    evaluation = Evaluation(None, SOURCE, None, 3, PAPER, mode, wind_mps=wind)
    return ReadyEvaluation(evaluation, Policy.load())


@pytest.mark.slow
def test_plans_are_safe_and_arrive() -> None:
    windy = columns(pilot("plan", (5.0, 20.0)), 0, COUNT)
    assert np.count_nonzero(windy["plan_status"] == "safe") >= COUNT - 1
    reached = windy["outcome"] == "reached"
    assert np.count_nonzero(reached) >= COUNT - 1
    assert windy["min_separation_m"][reached].min() >= PAPER.separation
    # What flies beside them flies in still air.
    assert np.count_nonzero(windy["baseline_outcome"] == "reached") < COUNT
    speed = distance(windy["wind_east_m_s"], windy["wind_north_m_s"], np)
    assert speed.min() >= 5.0 and speed.max() <= 20.0


def test_winds_follow_from_the_number_alone() -> None:
    evaluation = pilot("plan", (5.0, 20.0)).evaluation
    encounter = pick(evaluation, [0])
    every, part = (
        evaluation.wind(encounter, numbers) for numbers in (np.arange(10), np.array([7, 3]))
    )
    assert every is not None and part is not None
    np.testing.assert_array_equal(part.east, every.east[[7, 3]])
    assert pilot("plan", (0.0, 0.0)).evaluation.wind(encounter, np.arange(10)) is None


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["plan", "assured"])
def test_the_goal_is_entered_over_the_ground(mode: str) -> None:
    flown = fly_recorded(pilot(mode, (15.0, 15.0)), range(4))
    reached = np.flatnonzero(flown.flights.outcome == OUTCOMES.index("reached"))
    assert reached.size >= 3
    for row in reached:
        track = flown.track(int(row))
        x, y = track.own[0] - track.goal[0], track.own[1] - track.goal[1]
        # A step's end may lie beyond the disc that was entered within it.
        assert np.hypot(x, y).min() <= PAPER.goal_radius + 2.0
        speeds = np.hypot(*np.diff(track.own, axis=1)) / PAPER.dt
        assert speeds.max() - speeds.min() > 1e-3 or speeds.max() > PAPER.limits.speed_max


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"mode": "policy", "wind_mps": (0.0, 5.0)}, r"expected \[0, 0\] in mode policy"),
        ({"mode": "plan", "wind_mps": (5.0, 1.0)}, r"wind_mps is \[5, 1\]; expected a range"),
        ({"mode": "plan", "wind_mps": (0.0, 31.0)}, "expected a range within 0 to 30"),
    ],
)
def test_a_wind_that_cannot_be_flown_is_refused(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        MonteCarloConfig(**keys)
