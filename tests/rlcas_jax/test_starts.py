"""Near-limit starts: hard examples that replace a share of the scenarios' starts."""

import jax
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from envs.encounters import Encounter
from rlcas_jax import starts
from rlcas_jax.config import TrainConfig
from rlcas_jax.escape_margin import best
from rlcas_jax.starts import draw, near_limit


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for 100 near-limit starts only."""
    monkeypatch.setattr(starts, "NEAR_LIMIT", 100)
    starts._near_limit.cache_clear()


def spare(found: Encounter) -> np.ndarray:
    """Return what the best manoeuvre keeps beyond 1000 m."""
    return best(found.own, found.goal_x, found.goal_y, found.intruders, found.mask, np) - 1_000.0


def test_near_limit_starts_have_the_margin_and_the_share() -> None:
    config = load(
        TrainConfig,
        None,
        [
            "near_limit.margin=30",
            "near_limit.share=0.4",
            "ppo.environments=64",
            "scenarios=[{name: multi}]",
        ],
    )
    found = near_limit(config)
    assert found is not None
    assert found.goal_x.shape == (100,)
    left = spare(found)
    assert np.all((left > -0.05) & (left <= 30.05))  # rounded to float32
    assert np.quantile(left, 0.75) - np.quantile(left, 0.25) > 5.0
    starts._near_limit.cache_clear()
    again = near_limit(config)
    assert again is not None
    np.testing.assert_array_equal(found.own.x, again.own.x)
    drawn = draw(jax.random.key(1), config, [entry.scenario() for entry in config.scenarios], 50, found)
    chosen = np.isin(np.asarray(drawn.own.heading), found.own.heading)
    assert chosen.mean() == pytest.approx(0.4, abs=0.05)
    # The whole encounter is taken, and intruders that it does not have are absent.
    np.testing.assert_array_equal(np.asarray(drawn.mask)[chosen].sum(-1), 1)
    assert np.all(np.isin(np.asarray(drawn.goal_x)[chosen], found.goal_x))


def test_no_near_limit_starts_by_default() -> None:
    assert near_limit(TrainConfig()) is None


def test_near_limit_starts_that_hardly_exist_are_refused() -> None:
    config = load(TrainConfig, None, ["near_limit.share=0.1", "near_limit.margin=1e-4"])
    with pytest.raises(ConfigError, match=r"near_limit\.margin"):
        near_limit(config)
