"""Aircraft that all decide: pairs that lose the separation are counted once, and who arrives is
gone.
"""

import math

import numpy as np

from benchmarks.cooperative import Sky, fly, ring, square
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from eval.flights.simulate import Unmitigated

UNIT = PAPER.separation


def sky(rows: list[tuple[float, float, float, float]]) -> Sky:
    """Return one draw of aircraft at 80 m/s from places to goals, D."""
    x, y, goal_x, goal_y = UNIT * np.array(rows).T[:, None]
    heading = np.arctan2(goal_y - y, goal_x - x)
    return Sky(VehicleState(x, y, heading, np.full_like(x, 80.0)), goal_x, goal_y)


def test_a_pair_is_lost_once_and_others_are_not():
    head_on = [(0.0, 0.0, 10.0, 0.0), (10.0, 0.0, 0.0, 0.0)]
    beside = [(0.0, 3.0, 10.0, 3.0)]
    found = fly(sky([*head_on, *beside]), Unmitigated(PAPER), PAPER)
    assert found.pairs.tolist() == [1]
    assert found.late.tolist() == [0]
    assert abs(found.path_excess) < 1e-6


def test_who_has_arrived_is_gone():
    """The second passes the goal of the first when that has long arrived, or just then."""
    first = (0.0, 0.0, 4.0, 0.0)
    for start, lost in ((-12.0, 0), (-4.0, 1)):
        crossing = (4.0, start, 4.0, 12.0)
        assert fly(sky([first, crossing]), Unmitigated(PAPER), PAPER).pairs.tolist() == [lost]


def test_draws_are_as_described():
    rng = np.random.default_rng(3)
    drawn = ring(rng, 5, 16, 12.0, PAPER)
    away = np.hypot(drawn.start.x, drawn.start.y) / UNIT
    assert np.abs(away - 12.0).max() < math.sqrt(0.5) + 1e-6
    np.testing.assert_allclose(np.hypot(drawn.goal_x, drawn.goal_y), 12.0 * UNIT)
    drawn = square(rng, 3, 32, 32.0, PAPER)
    x, y = drawn.start.x / UNIT, drawn.start.y / UNIT
    apart = np.hypot(x[:, :, None] - x[:, None], y[:, :, None] - y[:, None])
    assert apart[:, ~np.eye(32, dtype=bool)].min() >= 2.0
    assert np.hypot(drawn.goal_x / UNIT - x, drawn.goal_y / UNIT - y).min() >= 8.0
