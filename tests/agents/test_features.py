"""The network's derived inputs: invariant under rotation, mirrored with the scene, bounded;
manoeuvres as flown.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agents.policy.features import FEATURE_SETS, features, mirror_sign, size
from envs.aircraft import PAPER
from envs.backend import FLOATS
from envs.kinematics import VehicleState
from envs.observation import observe
from envs.relative import straight_cpa

COMPONENT = st.floats(-1.0, 1.0) | st.sampled_from([-1.0, 1.0, 0.0])
OBSERVATION = st.lists(COMPONENT, min_size=8, max_size=8)


def inputs(observation, feature_set="mirror"):
    """Return the inputs ``[..., F]`` of observations ``[..., 8]``."""
    observation = np.asarray(observation)
    return np.stack(features([observation[..., i] for i in range(8)], feature_set, np), axis=-1)


def random_observations(count=2000, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 8))


@pytest.mark.parametrize("feature_set", FEATURE_SETS)
def test_size_agrees(feature_set):
    assert size(feature_set) == inputs(random_observations(3), feature_set).shape[-1]
    assert size(feature_set) == len(features([0.1] * 8, feature_set, FLOATS))


def test_unknown_set_is_named():
    with pytest.raises(ValueError, match="'magic' is unknown; expected one of none, mirror"):
        features([0.0] * 8, "magic", FLOATS)


def test_none_is_the_bare_observation():
    observation = random_observations(5)
    np.testing.assert_array_equal(inputs(observation, "none"), observation)


def test_rotation_of_the_scene_changes_nothing():
    observation = random_observations()
    turned = observation.copy()
    turn = np.random.default_rng(1).uniform(-1.0, 1.0, len(observation))
    for heading in (1, 3):
        turned[:, heading] = np.mod(observation[:, heading] + turn + 1.0, 2.0) - 1.0
    np.testing.assert_allclose(inputs(turned), inputs(observation), atol=1e-8)


def test_a_mirrored_scene_looks_the_same():
    observation = random_observations()
    mirrored = observation.copy()
    mirrored[:, [1, 3, 4, 6]] *= -1.0
    np.testing.assert_allclose(inputs(mirrored), inputs(observation), atol=1e-8)
    # That means something only if no input is always 0.
    assert (np.abs(inputs(observation)).max(0) > 0.5).all()
    hands = [mirror_sign(list(observed.T), "mirror", np) for observed in (observation, mirrored)]
    np.testing.assert_array_equal(hands[0], -hands[1])
    # A scene is seen as it is where the intruder is left of the line to the goal.
    bearing, goal = np.pi * observation[:, 4], np.pi * observation[:, 6]
    np.testing.assert_array_equal(hands[0], np.where(np.sin(bearing - goal) >= 0.0, 1.0, -1.0))
    np.testing.assert_allclose(inputs(observation)[:, 9], hands[0] * np.sin(goal), atol=1e-3)


def test_the_side_does_not_depend_on_the_sign_of_zero():
    for bearing, goal in ((0.0, 0.0), (-0.0, 0.0), (0.0, -0.0), (-0.0, -0.0), (0.3, 0.3)):
        values = [0.1] * 4 + [bearing, 0.1, goal, 0.1]
        assert mirror_sign(values, "mirror", FLOATS) == 1.0
        assert float(mirror_sign([np.float32(v) for v in values], "mirror", np)) == 1.0
        assert float(mirror_sign([jnp.float32(v) for v in values], "mirror", jnp)) == 1.0


@given(OBSERVATION)
@example([-1.0] * 8)
@example([1.0] * 8)
@example(
    [0.0, 0.3, 0.0, 0.3, 0.0, -1.0, 0.0, -1.0]
)  # on top of intruder and goal, at equal velocity
@example([0.0, 1.0, 0.0, -1.0, 1.0, 1.0, -1.0, 1.0])  # equal headings at the seam, 20 km astern
def test_finite_and_bounded_everywhere(observation):
    for dtype in (np.float32, np.float64):
        values = inputs(np.array(observation, dtype))
        assert values.dtype == dtype
        assert np.isfinite(values).all()
        assert np.abs(values).max() <= 3.0
    assert max(map(abs, features(observation, "mirror", FLOATS))) <= 3.0


@given(observation=OBSERVATION)
def test_plain_floats_agree_with_arrays(observation):
    np.testing.assert_allclose(
        features(observation, "mirror", FLOATS), inputs(observation), atol=1e-6
    )


def test_jax_agrees_with_numpy():
    observation = random_observations(seed=3).astype(np.float32)
    components = [jnp.asarray(observation[:, i]) for i in range(8)]
    values = np.stack(features(components, "mirror", jnp), axis=-1)
    np.testing.assert_allclose(values, inputs(observation), atol=2e-5)


def test_closest_approach_is_that_of_the_world():
    """The block's time and distance, read back from their squashed form, against ``envs.relative``.

    The relative speed is 150 m/s here, where the softening of 25 (m/s)^2 makes 0.1 %.
    """
    own = VehicleState(0.0, 0.0, 0.3, 80.0)
    intruder = VehicleState(5000.0, 4000.0, -2.0, 70.0)
    cpa = straight_cpa(own, intruder, np)
    values = inputs(observe(own, intruder, 9000.0, 3000.0, PAPER, np))
    time, miss = (
        values[i] / (1.0 - abs(values[i])) * scale for i, scale in ((14, 60.0), (15, 1000.0))
    )
    assert time == pytest.approx(cpa.time, rel=2e-3)
    assert abs(miss) == pytest.approx(cpa.distance, rel=2e-3)
    assert values[17] == pytest.approx(np.clip(1.5 - cpa.distance / 1000.0, -1.0, 1.5), abs=1e-3)
