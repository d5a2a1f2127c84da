"""The numpy network decides as the flax one did, in any batch, and refuses what is no
observation.
"""

import os
import subprocess
import sys
import threading
from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from agents.learning.export import to_policy_file
from agents.learning.networks import Actor
from agents.policy import eight_network
from agents.policy.features import mirror_sign
from agents.policy.file import PolicyFileError, write
from agents.policy.inference import PARITY_TOLERANCE, Policy
from agents.policy.schema import new_metadata
from envs import surrogate
from envs.aircraft import PAPER
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.observation import NAMES
from envs.outcome import RULES
from envs.scenarios import scenario
from tests.agents.policies import random_weights

HIDDEN = (64, 64)
ACTOR = Actor(HIDDEN, "mirror")


@cache
def variables():
    """Return parameters of an actor."""
    return random_weights(ACTOR, jnp.zeros((1, 8)))


@cache
def content():
    metadata = new_metadata(HIDDEN, "mirror", SURROGATE, {"seed": 0}, steps=0)
    return to_policy_file(variables(), metadata)


@cache
def policy(dtype="float32"):
    return Policy(content(), dtype)


@cache
def random_observations():
    return np.random.default_rng(0).uniform(-1.0, 1.0, (5000, 8)).astype(np.float32)


@cache
def flown_observations():
    """Return what the actor sees while it flies 64 encounters of the surrogate for 80 s, ``[80 *
    64, 8]``.
    """
    world = surrogate.World(RULES, PAPER)

    def step(state, _):
        observation = surrogate.observe(state, PAPER)
        mean, _ = ACTOR.apply(variables(), observation)
        state, _ = surrogate.step(state, (mean[:, 0], mean[:, 1]), world)
        return state, observation

    @jax.jit
    def fly(key):
        pool = surrogate.redraw_pool(key, [scenario("circle", PAPER)], [1.0], 1, 64)
        start = surrogate.reset(jax.tree.map(lambda field: field[0], pool))
        return jax.lax.scan(step, start, length=80)[1]

    return np.asarray(fly(jax.random.key(1))).reshape(-1, 8)


OBSERVATIONS = [random_observations, flown_observations]


def flax_actions(observation):
    mean, _ = jax.jit(ACTOR.apply)(variables(), observation)
    return np.clip(np.asarray(mean), -1.0, 1.0)


@pytest.mark.parametrize("observations", OBSERVATIONS)
def test_float32_parity_with_flax(observations):
    expected = flax_actions(jnp.asarray(observations()))
    assert expected.std() > 0.1
    difference = np.abs(policy()(observations()) - expected).max(-1)
    assert difference.max() < PARITY_TOLERANCE


@pytest.mark.parametrize("observations", OBSERVATIONS)
def test_float64_parity_with_flax(observations):
    with jax.enable_x64(True):
        wide = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), variables())
        mean, _ = jax.jit(ACTOR.apply)(wide, jnp.asarray(observations(), jnp.float64))
        expected = np.clip(np.asarray(mean), -1.0, 1.0)
    actions = policy("float64")(observations())
    assert actions.dtype == expected.dtype == np.float64
    np.testing.assert_allclose(actions, expected, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("observations", OBSERVATIONS)
def test_single_observations_agree_with_the_batch(dtype, observations):
    rows = observations()[::10]
    batch = policy(dtype)(rows)
    single = np.array([policy(dtype)(row) for row in rows])
    assert single.dtype == batch.dtype == dtype
    difference = np.abs(single - batch).max(-1)
    assert difference.max() < (PARITY_TOLERANCE if dtype == "float32" else 1e-8)


@pytest.mark.parametrize(
    "shape", [(8,), (1, 8), (3, 8), (2, 3, 8), (0, 8), (4, 0, 8), (1, 1, 1, 8)]
)
def test_shapes(shape):
    observation = np.random.default_rng(2).uniform(-1.0, 1.0, shape)
    action = policy()(observation)
    assert action.shape == (*shape[:-1], 2)
    assert action.dtype == np.float32
    flat = [policy()(row) for row in observation.reshape(-1, 8)]
    np.testing.assert_allclose(
        action.reshape(-1, 2), np.array(flat).reshape(-1, 2), atol=PARITY_TOLERANCE
    )


def test_lists_integers_and_strided_views_are_observations():
    corner = [1, 0, -1, 0, 0, 1, 0, 1]
    np.testing.assert_allclose(
        policy()(corner), policy()(np.array(corner, float)), atol=PARITY_TOLERANCE
    )
    assert policy()([[0.5] * 8, [0] * 8]).shape == (2, 2)
    wide = random_observations()[:20]
    np.testing.assert_array_equal(policy()(np.asfortranarray(wide)), policy()(wide))
    np.testing.assert_array_equal(policy()(np.repeat(wide, 2, axis=1)[:, ::2]), policy()(wide))


def test_observation_is_not_written_to_and_calls_repeat():
    observation = random_observations()[:100].copy()
    observation[0, 0] = 1.0 + 5e-6
    before = observation.copy()
    first = policy()(observation)
    np.testing.assert_array_equal(policy()(observation), first)
    np.testing.assert_array_equal(observation, before)


def test_an_action_that_is_not_finite_is_refused():
    spoilt = Policy(content())
    kernel, bias = spoilt._resolver.layers[-1]
    spoilt._resolver.layers[-1] = kernel, bias + np.float32(np.nan)
    own = VehicleState(0.0, 0.0, 0.0, 75.0)
    for call in (
        lambda: spoilt(random_observations()[:3]),
        lambda: spoilt.command_one(own, [], 1e4, 0.0),
    ):
        with pytest.raises(ValueError, match="not finite"):
            call()


def test_actions_are_clipped():
    head = np.full(2, 50.0, np.float32) * [1, -1]
    loud = {**content().actor, "head/bias": head.astype(np.float32)}
    parity = content().parity_observation
    hand = mirror_sign(list(parity.T), "mirror", np)
    expected = np.stack([np.ones_like(hand), -hand], axis=-1)
    extreme = Policy(replace(content(), actor=loud, parity_action=expected))
    np.testing.assert_array_equal(extreme(parity), expected)
    own, intruder = VehicleState(0.0, 0.0, 0.0, 75.0), VehicleState(5e3, 3e3, 0.0, 75.0)
    assert extreme.command_one(own, [intruder], 1e4, 0.0) == (1.0, -1.0)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 16, 63, 255, 256, 257, 511, 700])
def test_rows_have_the_same_bits_in_any_company(count):
    with threadpool_limits(1, user_api="blas"):
        everything = policy()(random_observations()[:1000])
        order = np.random.default_rng(count).permutation(1000)[:count]
        np.testing.assert_array_equal(policy()(random_observations()[order]), everything[order])
        np.testing.assert_array_equal(policy()(random_observations()[:count]), everything[:count])


def test_one_row_calls_have_the_same_bits():
    with threadpool_limits(1, user_api="blas"):
        for dtype in ("float32", "float64"):
            everything = policy(dtype)(random_observations()[:300])
            for i in range(0, 300, 7):
                np.testing.assert_array_equal(
                    policy(dtype)(random_observations()[i : i + 1])[0], everything[i]
                )


ROWS_ALONE_AND_TOGETHER = """
import numpy as np
from agents.inference import Policy
from threadpoolctl import threadpool_limits
policy, rng = Policy.load(), np.random.default_rng(0)
observation = rng.uniform(-1.0, 1.0, (600, 8)).astype(np.float32)
with threadpool_limits(1, user_api="blas"):
    together = policy(observation)
    alone = np.concatenate([policy(observation[i : i + 1]) for i in range(600)])
    backwards = policy(observation[::-1])[::-1]
assert (alone == together).all() and (backwards == together).all()
"""


@pytest.mark.parametrize("core", ["Prescott", "Haswell"])
def test_rows_hold_for_the_kernels_of_other_processors(core):
    # Any x86 processor of today runs both; OpenBLAS ignores them on others.
    environment = {**os.environ, "OPENBLAS_CORETYPE": core}
    subprocess.run([sys.executable, "-c", ROWS_ALONE_AND_TOGETHER], check=True, env=environment)


@given(
    st.integers(0, 7),
    st.sampled_from([np.nan, np.inf, -np.inf, 1.001, -1.00002, 1e300]),
    st.sampled_from([(), (3,)]),
)
def test_bad_components_are_named(component, value, batch):
    observation = np.zeros((*batch, 8))
    observation[(*(0 for _ in batch), component)] = value
    expected = (
        f"'{NAMES[component]}'" + (r" of row \[0\]" if batch else "") + " is .*expected one in"
    )
    with pytest.raises(ValueError, match=expected):
        policy()(observation)


@pytest.mark.parametrize(
    ("observation", "message"),
    [
        (0.5, r"shape \(\), expected a last axis of 8"),
        (np.zeros(7), r"shape \(7,\)"),
        (np.zeros((8, 2)), r"shape \(8, 2\)"),
        (np.zeros((0, 9)), r"shape \(0, 9\)"),
        (np.zeros(8, complex), "dtype complex128, expected real numbers"),
        (np.zeros((2, 8), bool), "dtype bool"),
        (["0"] * 8, "dtype <U1"),
        ([None] * 8, "dtype object"),
        ([[0.0] * 8, [0.0] * 7], "inhomogeneous"),
    ],
)
def test_what_is_no_observation(observation, message):
    with pytest.raises(ValueError, match=message):
        policy()(observation)


def test_slightly_outside_is_clipped():
    """A distance of a hair below -1 would otherwise pass through 0 inside the features."""
    for excess in (1e-7, 1e-6, 9e-6):
        for sign in (-1.0, 1.0):
            outside = np.full(8, sign * (1.0 + excess))
            np.testing.assert_array_equal(
                policy("float64")(outside), policy("float64")(np.full(8, sign))
            )
            np.testing.assert_array_equal(policy()(outside[None]), policy()(np.full((1, 8), sign)))


def test_one_policy_serves_many_threads():
    rows = random_observations()[:200, None]
    expected = [policy()(row).tolist() for row in rows]
    results = [[] for _ in range(4)]
    threads = [
        threading.Thread(target=lambda r=r: r.extend(policy()(row).tolist() for row in rows))
        for r in results
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [expected] * 4


def test_load(tmp_path):
    path = tmp_path / "p.safetensors"
    write(path, content())
    loaded = Policy.load(path)
    assert loaded.sha256 == content().sha256
    assert loaded.limits == SURROGATE
    assert loaded.metadata["training"]["config"] == {"seed": 0}
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(
        loaded(random_observations()[:9]), policy()(random_observations()[:9])
    )
    assert Policy.load(str(path), np.float64).dtype == np.float64
    with pytest.raises(ValueError, match="dtype is float16, expected float32 or float64"):
        Policy.load(path, np.float16)


def test_parity_vectors_are_checked(tmp_path):
    """A file in perfect order whose network decides otherwise than the training framework did."""
    path = tmp_path / "p.safetensors"
    write(path, replace(content(), parity_action=np.clip(content().parity_action * 0.999, -1, 1)))
    with pytest.raises(
        PolicyFileError, match=r"p\.safetensors: the network in float64 gives action .* expected"
    ):
        Policy.load(path)
    changed = replace(
        content(),
        actor={**content().actor, "head/bias": content().actor["head/bias"] + np.float32(1e-4)},
    )
    with pytest.raises(PolicyFileError, match="for parity vector"):
        Policy(changed)


def test_other_features_are_noticed(monkeypatch):
    """A later release that computes a derived input differently must not fly an older policy."""
    monkeypatch.setattr(eight_network, "features", lambda *a: [1.01 * f for f in original(*a)])
    with pytest.raises(PolicyFileError, match="the network in float64"):
        Policy(content())


original = eight_network.features


def scenes(count=40, most=3):
    """Return own states, intruders, their mask and goals."""
    rng = np.random.default_rng(5)
    shape = (count, most)
    own = VehicleState(
        *rng.uniform(-1e3, 1e3, (2, count)), rng.uniform(-3, 3, count), rng.uniform(50, 100, count)
    )
    intruders = VehicleState(
        *rng.uniform(-8e3, 8e3, (2, *shape)), rng.uniform(-3, 3, shape), rng.uniform(50, 100, shape)
    )
    return own, intruders, rng.random(shape) < 0.7, *rng.uniform(-9e3, 9e3, (2, count))


def test_command_of_one_is_that_of_many():
    own, intruders, mask, goal_x, goal_y = scenes()
    decided = policy().for_aircraft(
        PAPER, outside="allow"
    )  # of several intruders it takes the most critical one
    together = decided.command(own, intruders, mask, goal_x, goal_y)
    for row in range(len(goal_x)):
        alone = decided.command(
            *(VehicleState(*(f[row : row + 1] for f in s)) for s in (own, intruders)),
            mask[row : row + 1],
            goal_x[row : row + 1],
            goal_y[row : row + 1],
        )
        np.testing.assert_array_equal(alone[0], together[row])
        present = [
            VehicleState(*(float(f[row, k]) for f in intruders)) for k in np.flatnonzero(mask[row])
        ]
        action = decided.command_one(
            VehicleState(*(float(f[row]) for f in own)), present, goal_x[row], goal_y[row]
        )
        np.testing.assert_allclose(action, together[row], atol=1e-3)


def test_command_names_what_has_another_shape():
    own, intruders, mask, goal_x, goal_y = scenes()
    two = VehicleState(*(field[:, :2] for field in intruders))
    for name, scene in (
        ("mask", (own, intruders, mask[:, 0], goal_x, goal_y)),
        ("intruders.x", (own, intruders, mask[:, :2], goal_x, goal_y)),
        ("intruders.x", (own, two, mask, goal_x, goal_y)),
        ("own.heading", (own._replace(heading=own.heading[:3]), intruders, mask, goal_x, goal_y)),
        ("goal_y", (own, intruders, mask, goal_x, goal_y[:3])),
    ):
        with pytest.raises(ValueError, match=f"{name} has shape"):
            policy().command(*scene)


def test_two_exact_images_of_each_other_pass():
    # Head-on with all numbers equal, the line to the goal is the line to the other: the sign of the
    # mirror is a tie, which rounding would break for either of them by itself.
    decided, limits, x, y = Policy.load(), PAPER.limits, 7000.0 * np.cos(1.0), 7000.0 * np.sin(1.0)
    first, second = VehicleState(-x, -y, 1.0, 75.0), VehicleState(x, y, 1.0 + np.pi, 75.0)
    closest = np.inf
    for _ in range(150):
        actions = (
            decided.command_one(first, [second], x, y),
            decided.command_one(second, [first], -x, -y),
        )
        first, second = (
            VehicleState(
                *map(
                    float, advance(state, *commands(np.array(action), limits, np), 1.0, limits, np)
                )
            )
            for state, action in zip((first, second), actions, strict=True)
        )
        closest = min(closest, np.hypot(first.x - second.x, first.y - second.y))
    assert closest > PAPER.separation


def test_a_policy_says_what_it_is():
    policy = Policy.load()
    text = repr(policy)
    assert text.startswith(f"<Policy {policy.sha256[:8]}: up to {policy.most} intruders; ")
    assert "50 to 100 m/s, 3 deg/s, separation 1000 m>" in text
