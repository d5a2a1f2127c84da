"""A family of aircraft in one training, and the network for any number of intruders that learns to fly them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from envs.aircraft import Ratios, ratios
from envs.kinematics import Limits
from rlcas_jax.config import TrainConfig
from rlcas_jax.finish import set_of
from rlcas_jax.fleet import fleet
from rlcas_jax.starts import draw
from rlcas_jax.task import build

TINY = [
    "network={hidden: [8], feature_set: set, encoder: [6]}",
    "ppo={environments: 32, rollout: 8, minibatch: 64, segment: 4, epochs: 1}",
    "pool_rows=4",
    "steps=512",
    "scenarios=[{name: circle}, {name: circle, intruders: [2, 3]}]",
]
FAMILY = "family={share: 0.5, speed_min: [0.4, 0.5], acceleration: [0.1, 0.2], turn_radius: [0.5, 1.0]}"


def tiny(*changes: str) -> TrainConfig:
    return load(TrainConfig, None, [*TINY, *changes])


def test_aircraft_lie_in_the_family_and_the_share_is_kept() -> None:
    config = tiny(FAMILY, "ppo.environments=2048", "ppo.minibatch=1024")
    flown = fleet(config)
    found = ratios(Limits(*(np.asarray(field, float) for field in flown.limits)), config.aircraft.separation_m)
    bounds = Ratios((0.4, 0.5), (-0.2, -0.1), (0.1, 0.2), (0.5, 1.0))
    for values, (low, high) in zip(found, bounds, strict=True):
        other = values[flown.other]
        assert low - 1e-6 <= other.min() < low + 0.1 * (high - low)
        assert high + 1e-6 >= other.max() > high - 0.1 * (high - low)
    assert 0.45 < flown.other.mean() < 0.55
    own = ratios(config.aircraft.limits(), config.aircraft.separation_m)
    np.testing.assert_allclose([np.unique(values[~flown.other])[0] for values in found], own, rtol=1e-6)
    assert not fleet(tiny()).other.any()


def test_every_ownship_begins_at_a_speed_that_it_flies() -> None:
    config = tiny(FAMILY)
    limits = fleet(config).limits
    starts = draw(jax.random.key(0), config, config.drawn(), 6)
    assert np.all(starts.own.speed >= limits.speed_min - 1e-3)
    assert np.all(starts.own.speed <= limits.speed_max + 1e-3)
    assert starts.mask.shape == (6, 32, 3)


@pytest.mark.parametrize("changes", [(), (FAMILY,)])
def test_an_update_learns_from_sets(changes: tuple[str, ...]) -> None:
    task = build(tiny(*changes))
    state = task.initial()
    before = jax.device_get(state.learner.actor)
    after, figures = task.update(state)
    assert bool(figures["finite"])
    moved = jax.tree.map(lambda a, b: float(jnp.abs(a - b).max()), before, jax.device_get(after.learner.actor))
    assert moved["params"]["trunk"]["each_0"]["kernel"] > 0.0


def test_a_policy_file_says_which_aircraft_were_trained() -> None:
    assert set_of(tiny(FAMILY)).family["turn_radius"] == (0.5, pytest.approx(1.9098593))
    assert set_of(tiny(FAMILY)).intruders == 3
    assert set_of(tiny()).family["speed_min"] == (0.5, 0.5)


@pytest.mark.parametrize("wrong", ["speed_min: [0.9, 0.1]", "turn_radius: [0.0, 1.0]", "traffic_speed: [0.5, 9.0]"])
def test_a_family_that_cannot_be_is_refused(wrong: str) -> None:
    with pytest.raises(ConfigError, match=wrong.split(":", maxsplit=1)[0]):
        tiny(f"family={{share: 0.5, {wrong}}}")
