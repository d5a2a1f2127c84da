"""The network's derived inputs: invariant under rotation, mirrored with the scene, bounded; manoeuvres as flown."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agents.policy.escape_features import COUNT, HORIZON, advice, pressed, separations
from agents.policy.features import FEATURE_SETS, MIRRORED, features, mirror_sign, size
from envs.aircraft import PAPER
from envs.backend import FLOATS
from envs.kinematics import SURROGATE, VehicleState, advance
from envs.observation import Decoded, observe
from envs.relative import straight_cpa

# Components of "cpa" that are positive to the left and so change sign in the mirror.
SIGNED = [3, 5, 9, 15, 16, 19, 20]
COMPONENT = st.floats(-1.0, 1.0) | st.sampled_from([-1.0, 1.0, 0.0])
OBSERVATION = st.lists(COMPONENT, min_size=8, max_size=8)


def inputs(observation, feature_set="cpa"):
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
    with pytest.raises(
        ValueError, match="'magic' is unknown; expected one of none, cpa, mirror, foresight, advised, pressed"
    ):
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


def test_mirrored_scene_flips_the_signed_parts_only():
    observation = random_observations()
    mirrored = observation.copy()
    mirrored[:, [1, 3, 4, 6]] *= -1.0
    signs = np.ones(size("cpa"))
    signs[SIGNED] = -1.0
    np.testing.assert_allclose(inputs(mirrored), inputs(observation) * signs, atol=1e-8)
    # The test means something only if the signed parts are not all 0 and the others not all odd.
    assert (np.abs(inputs(observation)).max(0) > 0.5).all()


@pytest.mark.parametrize("feature_set", MIRRORED)
def test_a_mirrored_scene_looks_the_same_to_the_mirrored_sets(feature_set):
    observation = random_observations()
    mirrored = observation.copy()
    mirrored[:, [1, 3, 4, 6]] *= -1.0
    np.testing.assert_allclose(inputs(mirrored, feature_set), inputs(observation, feature_set), atol=1e-8)
    hands = [mirror_sign(list(seen.T), feature_set, np) for seen in (observation, mirrored)]
    np.testing.assert_array_equal(hands[0], -hands[1])
    assert set(hands[0]) == {-1.0, 1.0}
    # An intruder to the left of the line to the goal is seen as it is.
    left = np.sin(np.pi * (observation[:, 4] - observation[:, 6])) >= 0.0
    np.testing.assert_array_equal(hands[0] > 0.0, left)
    np.testing.assert_array_equal(inputs(observation[left], feature_set)[:, :22], inputs(observation[left]))


def test_the_side_does_not_depend_on_the_sign_of_zero():
    for bearing, goal in ((0.0, 0.0), (-0.0, 0.0), (0.0, -0.0), (-0.0, -0.0), (0.3, 0.3)):
        values = [0.1] * 4 + [bearing, 0.1, goal, 0.1]
        assert mirror_sign(values, "mirror", FLOATS) == 1.0
        assert float(mirror_sign([np.float32(v) for v in values], "mirror", np)) == 1.0
        assert float(mirror_sign([jnp.float32(v) for v in values], "mirror", jnp)) == 1.0


@given(OBSERVATION)
@example([-1.0] * 8)
@example([1.0] * 8)
@example([0.0, 0.3, 0.0, 0.3, 0.0, -1.0, 0.0, -1.0])  # on top of intruder and goal, at equal velocity
@example([0.0, 1.0, 0.0, -1.0, 1.0, 1.0, -1.0, 1.0])  # equal headings at the seam, 20 km astern
def test_finite_and_bounded_everywhere(observation):
    for feature_set in FEATURE_SETS[1:]:
        for dtype in (np.float32, np.float64):
            values = inputs(np.array(observation, dtype), feature_set)
            assert values.dtype == dtype
            assert np.isfinite(values).all()
            assert np.abs(values).max() <= 3.0
        assert max(map(abs, features(observation, feature_set, FLOATS))) <= 3.0


@pytest.mark.parametrize("feature_set", FEATURE_SETS[1:])
@given(observation=OBSERVATION)
def test_plain_floats_agree_with_arrays(feature_set, observation):
    np.testing.assert_allclose(features(observation, feature_set, FLOATS), inputs(observation, feature_set), atol=1e-6)


@pytest.mark.parametrize("feature_set", FEATURE_SETS[1:])
def test_jax_agrees_with_numpy(feature_set):
    observation = random_observations(seed=3).astype(np.float32)
    components = [jnp.asarray(observation[:, i]) for i in range(8)]
    values = np.stack(features(components, feature_set, jnp), axis=-1)
    np.testing.assert_allclose(values, inputs(observation, feature_set), atol=2e-5)


def test_a_turning_circle_around_the_goal_is_seen():
    """The last two inputs are the goal's distances outside the turning circles to the left and right."""
    own, far = VehicleState(0.0, 0.0, 0.0, 60.0), VehicleState(0.0, 9000.0, 0.0, 50.0)
    radius = 60.0 / np.radians(3.0)
    values = inputs(observe(own, far, radius, radius + 300.0, PAPER, np), "foresight")
    outside = [np.hypot(radius, 300.0) - radius, np.hypot(radius, 2.0 * radius + 300.0) - radius]
    np.testing.assert_allclose(values[-2:] / (1.0 - np.abs(values[-2:])) * 500.0, outside, rtol=1e-3)


def test_closest_approach_is_that_of_the_world():
    """The block's time and distance, read back from their squashed form, against ``envs.relative``.

    The relative speed is 150 m/s here, where the softening of 25 (m/s)^2 makes 0.1 %.
    """
    own = VehicleState(0.0, 0.0, 0.3, 80.0)
    other = VehicleState(5000.0, 4000.0, -2.0, 70.0)
    cpa = straight_cpa(own, other, np)
    values = inputs(observe(own, other, 9000.0, 3000.0, PAPER, np))
    time, miss = (values[i] / (1.0 - abs(values[i])) * scale for i, scale in ((14, 60.0), (15, 1000.0)))
    assert time == pytest.approx(cpa.time, rel=2e-3)
    assert abs(miss) == pytest.approx(cpa.distance, rel=2e-3)
    assert values[17] == pytest.approx(np.clip(1.5 - cpa.distance / 1000.0, -1.0, 1.5), abs=1e-3)


# What the manoeuvres of the derived inputs keep is what the surrogate flies, in every array library.

SWAPPED = [3, 4, 5, 0, 1, 2, 6, 7, 8, 9, 10, 11]  # the manoeuvres of a mirrored scene
DIRECTIONS, SPEEDS = ("left", "right", "straight", "goal"), ("braking", "steady", "accelerating")


def scenes(count: int = 400, seed: int = 0) -> tuple[Decoded, np.ndarray]:
    """Return geometries ``[count]`` with an intruder within 4 km, and bearings of the goal, rad."""
    random = np.random.default_rng(seed)
    course, speed = random.uniform(-math.pi, math.pi, count), random.uniform(0.0, 150.0, count)
    bearing, far = random.uniform(-math.pi, math.pi, count), random.uniform(500.0, 20_000.0, count)
    return Decoded(
        random.uniform(50.0, 100.0, count),
        random.uniform(-4_000.0, 4_000.0, count),
        random.uniform(-4_000.0, 4_000.0, count),
        speed * np.cos(course),
        speed * np.sin(course),
        far * np.cos(bearing),
        far * np.sin(bearing),
    ), bearing


def flown(geometry: Decoded, bearing: np.ndarray, direction: str, speed: str, step: float = 0.05) -> np.ndarray:
    """Return the least separation of a manoeuvre flown by the surrogate's own motion, ``[N]`` m."""
    zero = np.zeros_like(bearing)
    wanted = {"left": zero + 0.5 * math.pi, "right": zero - 0.5 * math.pi, "straight": zero, "goal": bearing}[direction]
    limits = (SURROGATE.acceleration_min, 0.0, SURROGATE.acceleration_max)
    acceleration = zero + limits[SPEEDS.index(speed)]
    own, turned, least = VehicleState(zero, zero, zero, geometry.own_speed), zero, zero + math.inf
    for number in range(1, round(HORIZON / step) + 1):
        rate = np.clip((wanted - turned) / step, -SURROGATE.yaw_rate_max, SURROGATE.yaw_rate_max)
        own, turned = advance(own, acceleration, rate, step, SURROGATE, np), turned + rate * step
        x = geometry.intruder_x + geometry.intruder_vx * number * step
        y = geometry.intruder_y + geometry.intruder_vy * number * step
        least = np.minimum(least, np.hypot(x - own.x, y - own.y))
    return least


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_it_is_what_the_surrogate_flies(direction: str, speed: str) -> None:
    geometry, bearing = scenes()
    said = separations(geometry, bearing, np)[3 * DIRECTIONS.index(direction) + SPEEDS.index(speed)]
    exact = flown(geometry, bearing, direction, speed)
    # The reference looks every 0.05 s, in which two aircraft fly 12 m: at most 6 m beside the closest point. A turn
    # that ends within a piece of T s has a mean course up to w T / 8 beside that of the piece's middle.
    near = exact < 1_500.0
    assert near.sum() > 50
    error = (said - exact)[near]
    assert np.abs(error).max() < 6.0 + 100.0 * 10.0 * SURROGATE.yaw_rate_max * 10.0 / 8.0
    assert np.quantile(np.abs(error), 0.95) < 12.0
    assert abs(np.median(error)) < 1.0


def test_a_mirrored_scene_swaps_left_and_right() -> None:
    geometry, bearing = scenes()
    mirrored = geometry._replace(
        intruder_y=-geometry.intruder_y, intruder_vy=-geometry.intruder_vy, goal_y=-geometry.goal_y
    )
    here, there = separations(geometry, bearing, np), separations(mirrored, -bearing, np)
    np.testing.assert_allclose(here, [there[i] for i in SWAPPED], rtol=1e-12)


def test_all_array_libraries_agree() -> None:
    geometry, bearing = scenes(seed=1)
    arrays = np.array(separations(geometry, bearing, np))
    assert arrays.shape == (COUNT, len(bearing))
    floats = [
        separations(Decoded(*(float(field[i]) for field in geometry)), float(bearing[i]), FLOATS)
        for i in range(len(bearing))
    ]
    # Two sines of a bearing agree to 5e-14 and an end of a way is 10 km away.
    np.testing.assert_allclose(np.array(floats).T, arrays, atol=1e-6)
    single = [jnp.asarray(field, jnp.float32) for field in (*geometry, bearing)]
    compiled = np.array(separations(Decoded(*single[:-1]), single[-1], jnp))
    assert compiled.dtype == np.float32
    np.testing.assert_allclose(compiled, arrays, atol=0.02)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_row_has_the_same_bits_in_any_company(dtype: type) -> None:
    geometry, bearing = scenes(300)
    fields = [field.astype(dtype) for field in (*geometry, bearing)]

    def kept(rows: slice) -> np.ndarray:
        *parts, towards = (field[rows] for field in fields)
        return np.array(separations(Decoded(*parts), towards, np))

    together = kept(slice(None))  # one piece after the other
    assert together.dtype == dtype
    for rows in (slice(0, 1), slice(3, 20), slice(0, 256), slice(17, 50)):  # all at once, in one block and in several
        np.testing.assert_array_equal(kept(rows), together[:, rows])


def test_an_intruder_at_the_same_velocity_stays_where_it_is() -> None:
    beside = Decoded(80.0, 0.0, 1_200.0, 80.0, 0.0, 9_000.0, 0.0)
    kept = separations(beside, 0.0, FLOATS)
    assert kept[7] == pytest.approx(1_200.0)  # straight on, at a steady speed
    assert kept[10] == pytest.approx(1_200.0)  # the goal is ahead
    assert kept[1] < 1_000.0 < kept[4]  # to the left is the intruder


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_it_advises_what_keeps_clearly_most(direction: str, speed: str) -> None:
    kept = [-0.9] * COUNT
    others = 2.0 * (COUNT - 1) / (1.0 + (1.3 / 0.05) ** 2)  # what the shares of the rest can change
    kept[3 * DIRECTIONS.index(direction) + SPEEDS.index(speed)] = 0.4
    for bearing, homeward in ((0.02, 0.02 / SURROGATE.yaw_rate_max), (-2.0, -1.0)):
        most, acceleration, yaw_rate = advice(kept, bearing, FLOATS)
        assert most == 0.4
        assert acceleration == pytest.approx(SPEEDS.index(speed) - 1, abs=others)
        turn = {"left": 1.0, "right": -1.0, "straight": 0.0, "goal": homeward}[direction]
        assert yaw_rate == pytest.approx(turn, abs=others)


def test_between_two_sides_that_keep_the_same_it_advises_neither() -> None:
    ahead = Decoded(80.0, 3_000.0, 0.0, -80.0, 0.0, 9_000.0, 0.0)
    kept = [(separation - 1_000.0) / 30.0 for separation in separations(ahead, 0.0, FLOATS)]
    squashed = [value / (1.0 + abs(value)) for value in kept]
    assert advice(squashed, 0.0, FLOATS)[2] == pytest.approx(0.0, abs=1e-9)
    assert max(kept) == max(kept[:6])


@pytest.mark.parametrize(
    ("derived", "most", "seed"),
    [(advice, 1.0, 3), (pressed, 0.3, 4)],
    ids=["advice", "pressed"],
)
def test_a_mirrored_scene_gives_the_other_turn(derived: Any, most: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    kept = list(random.uniform(-1.0, most, (COUNT, 200)))
    bearing = random.uniform(-math.pi, math.pi, 200)
    here = derived(kept, bearing, np)
    there = derived([kept[i] for i in SWAPPED], -bearing, np)
    np.testing.assert_allclose(np.array(here) * [[1.0], [1.0], [-1.0]], there, atol=1e-12)
    assert np.abs(here).max() <= 1.0


@pytest.mark.parametrize(("most", "near"), [(-0.5, 1.0), (0.1, 1.0), (0.175, 0.5), (0.25, 0.0), (0.9, 0.0)])
def test_near_the_limit_the_input_is_the_one_best_manoeuvre(most: float, near: float) -> None:
    # Braking to the left keeps a metre more than accelerating to the right, which the mean of both hardly shows.
    kept = [most - 0.3] * COUNT
    kept[0], kept[5] = most, most - 0.033
    blunt, sharp = advice(kept, 0.0, FLOATS), pressed(kept, 0.0, FLOATS)
    assert abs(blunt[1]) < 0.3
    assert sharp[0] == pytest.approx(near)
    assert sharp[1] == pytest.approx(-near, abs=0.2)
    assert sharp[2] == pytest.approx(near, abs=0.2)
