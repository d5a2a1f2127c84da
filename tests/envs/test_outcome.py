"""The rules: every clause of the end of an encounter, which outweighs which, and the paper's rewards."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from envs.backend import FLOATS
from envs.outcome import RULES, judge, reward

FAR, CLOSE = 5_000.0, 999.9
AWAY, HOME = 3_000.0, 499.9
EARLY, LATE = 10.0, 300.0


def ends(separation: float, goal_distance: float, time: float) -> tuple[bool, bool, bool]:
    return tuple(judge(separation, goal_distance, time, RULES, FLOATS))


def test_the_rules_are_the_papers() -> None:
    assert RULES._asdict() == {
        "dt": 1.0,
        "t_max": 300.0,
        "separation": 1_000.0,
        "goal_radius": 500.0,
        "reward_violation": -100.0,
        "reward_goal": 100.0,
        "reward_timeout": -10.0,
    }


@pytest.mark.parametrize(
    ("separation", "goal_distance", "time", "expected", "points"),
    [
        (FAR, AWAY, EARLY, (False, False, False), 0.0),
        (CLOSE, AWAY, EARLY, (True, False, False), -100.0),
        (FAR, HOME, EARLY, (False, True, False), 100.0),
        (FAR, AWAY, LATE, (False, False, True), -10.0),
        (CLOSE, HOME, EARLY, (True, False, False), -100.0),
        (CLOSE, AWAY, LATE, (True, False, False), -100.0),
        (FAR, HOME, LATE, (False, True, False), 100.0),
        (CLOSE, HOME, LATE, (True, False, False), -100.0),
    ],
)
def test_every_clause_and_its_precedence(separation, goal_distance, time, expected, points) -> None:
    """A violation outweighs everything; the goal outweighs the clock; each gives the reward of the paper's table."""
    outcome = judge(separation, goal_distance, time, RULES, FLOATS)
    assert tuple(outcome) == expected
    assert outcome.ended(FLOATS) == any(expected)
    assert reward(outcome, RULES, FLOATS) == points


def test_the_thresholds_themselves() -> None:
    """Exactly 1000 m is separated; exactly 500 m is at the goal."""
    assert ends(1_000.0, AWAY, EARLY) == (False, False, False)
    assert ends(np.nextafter(1_000.0, 0.0), AWAY, EARLY) == (True, False, False)
    assert ends(FAR, 500.0, EARLY) == (False, True, False)
    assert ends(FAR, np.nextafter(500.0, 1e3), EARLY) == (False, False, False)


@pytest.mark.parametrize("dt", [1.0, 0.5, 0.1, 0.3])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_clock_stops_exactly_at_the_last_step(dt: float, dtype: type) -> None:
    """Time is a sum of steps: t_max falls on step 300 at 1 s, not on 299 or 301, whatever the rounding."""
    rules = RULES._replace(dt=dt)
    time, step, timeouts = dtype(0.0), 0, []
    while step < 300.0 / dt + 2:
        time, step = dtype(time + dtype(dt)), step + 1
        timeouts += [step] * bool(judge(dtype(FAR), dtype(AWAY), time, rules, np).timeout)
    assert timeouts[0] == round(300.0 / dt)


def test_at_most_one_of_the_three_holds_in_every_backend() -> None:
    """Each combination of the three causes, in numpy and jax as in plain floats."""
    cases = np.array(list(itertools.product([FAR, CLOSE], [AWAY, HOME], [EARLY, LATE])), np.float32)
    plain = [judge(*map(float, case), RULES, FLOATS) for case in cases]
    for xp in (np, jnp):
        outcome = judge(*(xp.asarray(column) for column in cases.T), RULES, xp)
        assert np.array_equal(np.stack(outcome, axis=-1), np.array(plain))
        assert np.max(np.sum(np.stack(outcome), axis=0)) == 1
        assert np.array_equal(outcome.ended(xp), np.any(np.array(plain), axis=-1))
        np.testing.assert_array_equal(reward(outcome, RULES, xp), [reward(o, RULES, FLOATS) for o in plain])
