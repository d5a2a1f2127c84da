"""PPO's parts against plain loops and numbers computed by hand: advantages, losses, clipping,
shuffling.
"""

import itertools
import math
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from agents.learning import ppo
from agents.learning.networks import Actor, Critic, greatest_products
from agents.learning.ppo import Batch, LearnerState, Networks, PpoSettings
from tests.probes import Probe, train_on_probe

compiled_advantages = jax.jit(ppo.advantages)
initial_state = jax.jit(ppo.initial_state, static_argnums=0)


def advantages_by_loop(reward, value, value_next, terminated, discount, gae_lambda) -> np.ndarray:
    """Return generalised advantages of one episode stream ``[T]``, as the definition reads: a sum
    over the future.
    """
    steps = len(reward)
    estimate = np.zeros(steps)
    for t in range(steps):
        weight = 1.0
        for k in range(t, steps):
            bootstrap = 0.0 if terminated[k] else discount * value_next[k]
            estimate[t] += weight * (reward[k] + bootstrap - value[k])
            if terminated[k]:
                break
            weight *= discount * gae_lambda
    return estimate


def compare_advantages(reward, value, value_next, terminated, discount, gae_lambda) -> None:
    columns = [np.asarray(column, np.float32) for column in (reward, value, value_next, terminated)]
    advantages = compiled_advantages(*columns, discount, gae_lambda)
    expected = [
        advantages_by_loop(*(c[:, n] for c in columns), discount, gae_lambda)
        for n in range(columns[0].shape[1])
    ]
    np.testing.assert_allclose(advantages, np.stack(expected, axis=1), rtol=1e-4, atol=1e-4)


def test_advantages_with_every_combination_of_ends() -> None:
    """All 2^6 histories of six steps, each of which ends the episode, or not."""
    ends = np.array(list(itertools.product((0.0, 1.0), repeat=6))).T
    reward, value, value_next = np.random.default_rng(0).normal(size=(3, *ends.shape))
    compare_advantages(reward, value, value_next, ends, 0.9, 0.8)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_advantages_against_a_plain_loop(seed, discount, gae_lambda, termination) -> None:
    generator = np.random.default_rng(seed)
    reward, value, value_next = generator.normal(size=(3, 12, 5))
    ends = generator.random((12, 5)) < termination
    compare_advantages(reward, value, value_next, ends, discount, gae_lambda)


def test_advantages_by_hand() -> None:
    """Rewards 1, 2; values 3, 4, then 5; discount 0.5, lambda 0.5: deltas 0 and 0.5; the first
    looks 0.25 ahead.
    """
    column = np.float32([[1.0], [2.0]]), np.float32([[3.0], [4.0]]), np.float32([[4.0], [5.0]])
    none = np.zeros((2, 1), np.float32)
    np.testing.assert_allclose(
        compiled_advantages(*column, none, 0.5, 0.5)[:, 0], [0.0 + 0.25 * 0.5, 0.5]
    )
    last = np.float32([[0.0], [1.0]])
    np.testing.assert_allclose(
        compiled_advantages(*column, last, 0.5, 0.5)[:, 0], [0.25 * -2.0, -2.0]
    )


def test_gaussian_log_prob_and_entropy_are_scipys() -> None:
    generator = np.random.default_rng(1)
    action, mean = generator.normal(size=(2, 50, 2)).astype(np.float32)
    log_std = np.float32([-1.2, 0.4])
    normal = stats.norm(mean, np.exp(log_std))
    np.testing.assert_allclose(
        ppo.gaussian_log_prob(action, mean, log_std), normal.logpdf(action).sum(-1), rtol=1e-4
    )
    expected = stats.norm(0.0, np.exp(log_std)).entropy().sum()
    np.testing.assert_allclose(ppo.gaussian_entropy(jnp.asarray(log_std)), expected, rtol=1e-6)


class MeanOfObservation:
    """An actor whose mean is the observation times a parameter, so that ratios can be computed by
    hand.
    """

    def apply(self, variables: Any, observation: jax.Array) -> tuple[jax.Array, jax.Array]:
        return observation * variables["gain"], variables["log_std"]


class SumOfObservation:
    """A critic whose value is the observation's sum times a parameter."""

    def apply(self, variables: Any, observation: jax.Array) -> jax.Array:
        return observation.sum(axis=-1) * variables["gain"]


BY_HAND: Any = Networks(MeanOfObservation(), SumOfObservation(), optax.identity())
UNIT = ({"gain": jnp.float32(1.0), "log_std": jnp.zeros(2)}, {"gain": jnp.float32(2.0)})


def tiny_batch(old_ratio: list[float], advantage: list[float]) -> Batch:
    """Return three samples drawn at their mean, whose probability ratios are the ones given."""
    observation = np.float32([[0.5, 0.0], [0.0, -0.5], [1.0, 1.0]])
    log_prob = -math.log(2.0 * math.pi) - np.log(np.float32(old_ratio))
    return Batch(
        observation, observation, log_prob, np.float32(advantage), np.float32([0.0, 0.0, 3.0])
    )


def losses(batch: Batch, **settings: Any) -> dict[str, float]:
    loss, parts = ppo.losses(UNIT, batch, BY_HAND, PpoSettings(**settings))
    assert loss == parts["loss"]
    return {name: float(value) for name, value in parts.items()}


@pytest.mark.parametrize(
    ("ratios", "advantage", "expected", "clipped"),
    [
        # Inside the clip range nothing is clipped: -(1.1 - 2 * 0.9 + 3) / 3.
        ([1.1, 0.9, 1.0], [1.0, -2.0, 3.0], -(1.1 - 1.8 + 3.0) / 3.0, 0.0),
        # A ratio beyond the range that gains no more: 1.5 counts as 1.2; 0.5 with a negative
        # advantage as 0.8.
        ([1.5, 0.5, 1.0], [1.0, -2.0, 3.0], -(1.2 - 1.6 + 3.0) / 3.0, 2.0 / 3.0),
        # The pessimistic side is never clipped: 1.5 with a negative and 0.5 with a positive
        # advantage.
        ([1.5, 0.5, 1.0], [-1.0, 2.0, 3.0], -(-1.5 + 1.0 + 3.0) / 3.0, 2.0 / 3.0),
    ],
)
def test_policy_loss_by_hand(ratios, advantage, expected, clipped) -> None:
    metrics = losses(tiny_batch(ratios, advantage), clip=0.2)
    assert metrics["policy_loss"] == pytest.approx(expected, rel=1e-5)
    assert metrics["clip_fraction"] == pytest.approx(clipped)
    assert metrics["approx_kl"] == pytest.approx(
        np.mean([r - 1.0 - math.log(r) for r in ratios]), abs=1e-5
    )
    # Drawn at the mean, with a standard deviation of 1 in two dimensions.
    assert metrics["neg_log_prob"] == pytest.approx(math.log(2.0 * math.pi), rel=1e-5)


def test_value_loss_entropy_and_total_by_hand() -> None:
    """Values are 1, -1 and 4, targets 0, 0 and 3; two unit Gaussians have an entropy of log(2 pi
    e).
    """
    metrics = losses(tiny_batch([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]), value=0.7, entropy=0.3)
    assert metrics["value_loss"] == pytest.approx(0.5 * (1.0 + 1.0 + 1.0) / 3.0)
    assert metrics["entropy"] == pytest.approx(math.log(2.0 * math.pi * math.e), rel=1e-6)
    assert metrics["loss"] == pytest.approx(
        -2.0 + 0.7 * 0.5 - 0.3 * math.log(2.0 * math.pi * math.e), rel=1e-5
    )


def test_a_mean_action_beyond_its_limits_costs_its_square_by_hand() -> None:
    """Means of 3 times (0.5, 0), (0, -0.5) and (1, 1) are 0.5, 0.5, and twice 2 beyond the
    limits.
    """
    batch = tiny_batch([1.0, 1.0, 1.0], [1.0, 2.0, 3.0])
    beyond = (0.25 + 0.25 + 8.0) / 3.0
    critic, steep = UNIT[1], {"gain": jnp.float32(3.0), "log_std": jnp.zeros(2)}

    def loss(bound: float) -> tuple[float, dict]:
        return ppo.losses((steep, critic), batch, BY_HAND, PpoSettings(action_bound_coef=bound))

    assert float(loss(0.0)[1]["beyond_limits"]) == pytest.approx(beyond)
    assert float(loss(0.5)[0] - loss(0.0)[0]) == pytest.approx(0.5 * beyond, rel=1e-5)
    assert losses(batch)["beyond_limits"] == 0.0, "at the limit nothing is beyond"


def test_advantages_are_normalised_within_each_minibatch() -> None:
    """By hand: 1, 2, 6 have mean 3 and standard deviation sqrt(14/3); so have they shifted and
    scaled.
    """
    normalized = ppo.normalize(jnp.array([[1.0, 2.0, 6.0], [107.0, 112.0, 132.0]]))
    by_hand = np.array([-2.0, -1.0, 3.0]) / math.sqrt(14.0 / 3.0)
    np.testing.assert_allclose(normalized, [by_hand, by_hand], rtol=1e-4)


@pytest.mark.slow
def test_an_update_learns_from_normalised_advantages_if_it_shall(small) -> None:
    parts, state, rollout = small
    changed = rollout._replace(advantage=40.0 * rollout.advantage + 7.0)

    def learn(samples: Batch, *, normalize: bool) -> float:
        settings = replace(SETTINGS, normalize_advantage=normalize)
        return float(
            update(state, samples, jax.random.key(1), 1e-3, parts, settings)[1]["policy_loss"]
        )

    assert learn(changed, normalize=True) == pytest.approx(learn(rollout, normalize=True), abs=1e-4)
    assert abs(learn(changed, normalize=False) - learn(rollout, normalize=False)) > 1.0


def test_the_gradient_of_a_clipped_sample_is_zero() -> None:
    def policy_gradient(ratio: float) -> float:
        batch = tiny_batch([ratio] * 3, [1.0, 1.0, 1.0])
        batch = batch._replace(action=batch.action + np.float32(0.1))
        shift = ppo.gaussian_log_prob(batch.action, batch.observation, jnp.zeros(2)) + math.log(
            2.0 * math.pi
        )
        batch = batch._replace(log_prob=batch.log_prob + shift)
        settings = PpoSettings(value=0.0)
        gradient, _ = jax.grad(ppo.losses, has_aux=True)(UNIT, batch, BY_HAND, settings)
        return float(gradient[0]["gain"])

    assert policy_gradient(1.5) == 0.0
    assert policy_gradient(1.1) != 0.0


# The update.

SETTINGS = PpoSettings(epochs=3, minibatches=4, segment=2, max_grad_norm=0.01)
ENCOUNTERS, STEPS = 6, 8


@pytest.fixture(scope="module")
def small() -> tuple[Networks, LearnerState, Batch]:
    parts = ppo.make_networks(Actor((8,), "none"), Critic((8,), "none"), SETTINGS)
    state = initial_state(parts, jax.random.key(0), jnp.zeros((1, 3)))
    generator = np.random.default_rng(2)
    shape = (ENCOUNTERS, STEPS)
    observation, action = generator.normal(size=(*shape, 3)), generator.normal(size=(*shape, 2))
    mean, log_std = parts.policy(state.actor, observation.astype(np.float32))
    log_prob = ppo.gaussian_log_prob(action, mean, log_std)
    rollout = Batch(
        observation,
        action,
        log_prob,
        generator.normal(size=shape),
        10.0 * generator.normal(size=shape),
    )
    return parts, state, jax.tree.map(lambda a: np.asarray(a, np.float32), rollout)


update = jax.jit(ppo.update, static_argnums=(4, 5))


def test_a_learning_rate_of_zero_changes_no_parameter(small) -> None:
    parts, state, rollout = small
    after, logged = update(state, rollout, jax.random.key(1), 0.0, parts, SETTINGS)
    for a, b in zip(
        *(jax.tree.leaves((learner.actor, learner.critic)) for learner in (after, state)),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
    # So the policy is still the one that drew the actions.
    assert abs(float(logged["approx_kl"])) < 1e-6
    assert float(logged["clip_fraction"]) == 0.0


def test_learning_reduces_the_loss_and_depends_on_the_key(small) -> None:
    parts, state, rollout = small
    first, before = update(state, rollout, jax.random.key(1), 3e-2, parts, SETTINGS)
    _, after = update(first, rollout, jax.random.key(2), 3e-2, parts, SETTINGS)
    assert float(after["value_loss"]) < float(before["value_loss"])
    again, _ = update(state, rollout, jax.random.key(1), 3e-2, parts, SETTINGS)
    other_key, _ = update(state, rollout, jax.random.key(3), 3e-2, parts, SETTINGS)
    weights = [
        np.asarray(s.critic["params"]["trunk"]["head"]["kernel"]) for s in (first, again, other_key)
    ]
    np.testing.assert_array_equal(weights[0], weights[1])
    assert np.any(weights[0] != weights[2])


def adams_first_moment(state: LearnerState) -> Any:
    return next(part.mu for part in state.optimizer if hasattr(part, "mu"))


@pytest.mark.slow
def test_each_networks_gradient_is_clipped_to_its_own_norm(small) -> None:
    """Adam's first moment after one minibatch is a tenth of the gradient that it was given."""
    parts, state, rollout = small
    once = PpoSettings(
        epochs=1, minibatches=1, segment=2, max_grad_norm=0.5 * SETTINGS.max_grad_norm
    )
    parts = ppo.make_networks(parts.actor, parts.critic, once)
    after, logged = update(state, rollout, jax.random.key(1), 0.0, parts, once)
    samples = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), rollout)
    samples = samples._replace(advantage=ppo.normalize(samples.advantage[None])[0])
    gradient, _ = jax.grad(ppo.losses, has_aux=True)(
        (state.actor, state.critic), samples, parts, once
    )
    norms = [float(optax.tree.norm(network)) for network in gradient]
    assert norms[1] > 100.0 * once.max_grad_norm, "of the critic, which errs widely"
    assert float(logged["grad_norm"]) == pytest.approx(float(np.hypot(*norms)), rel=1e-3), (
        "logged before it is clipped"
    )
    # All parameters of a network are scaled by one factor, which keeps its gradient's direction.
    for network, norm, moment in zip(gradient, norms, adams_first_moment(after), strict=True):
        scale = 0.1 * min(1.0, once.max_grad_norm / norm)
        for g, m in zip(jax.tree.leaves(network), jax.tree.leaves(moment), strict=True):
            np.testing.assert_allclose(m, scale * np.asarray(g), rtol=1e-3, atol=1e-8)


def test_a_gradient_within_the_norm_is_left_alone(small) -> None:
    _, state, rollout = small
    wide = PpoSettings(epochs=1, minibatches=1, segment=2, max_grad_norm=1e6)
    parts = ppo.make_networks(Actor((8,), "none"), Critic((8,), "none"), wide)
    after, logged = update(state, rollout, jax.random.key(1), 0.0, parts, wide)
    assert float(optax.tree.norm(adams_first_moment(after))) / 0.1 == pytest.approx(
        float(logged["grad_norm"]), rel=1e-3
    )


class Fixed:
    """An actor that ignores its observation."""

    def apply(self, variables: Any, observation: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jnp.zeros((*observation.shape[:-1], 2)) + variables["mean"], jnp.zeros(2)


class Table:
    """A critic with a parameter for each sample: its gradient shows which samples a minibatch
    holds.
    """

    def apply(self, variables: Any, observation: jax.Array) -> jax.Array:
        return variables["table"][observation[..., 0].astype(jnp.int32)]


def recorder(total: int, size: int) -> optax.GradientTransformation:
    """Return an optimiser that only counts how often each sample was used and checks how many come
    at once.
    """

    def record(gradient: Any, state: Any, params: Any = None) -> tuple[Any, Any]:
        used = gradient[1]["table"] != 0.0
        return gradient, (state[0] + used, state[1] + (used.sum() == size))

    return optax.GradientTransformation(
        lambda _: (jnp.zeros(total, int), jnp.zeros((), int)), record
    )


@pytest.mark.parametrize("segment", [1, 2, 4, 8])
def test_every_epoch_uses_every_sample_once(segment: int) -> None:
    total = ENCOUNTERS * STEPS
    settings = PpoSettings(epochs=5, minibatches=6, segment=segment, normalize_advantage=False)
    parts: Any = Networks(Fixed(), Table(), recorder(total, total // 6))
    variables = {"mean": jnp.zeros(2)}, {"table": jnp.zeros(total)}
    state = LearnerState(*variables, parts.optimizer.init(variables))
    index = np.arange(total, dtype=np.float32).reshape(ENCOUNTERS, STEPS)
    zeros = np.zeros((ENCOUNTERS, STEPS), np.float32)
    action = np.zeros((ENCOUNTERS, STEPS, 2), np.float32)
    rollout = Batch(
        index[..., None], action, zeros - np.float32(math.log(2.0 * math.pi)), zeros, zeros + 1.0
    )
    after, _ = update(state, rollout, jax.random.key(0), 0.0, parts, settings)
    used, full_minibatches = after.optimizer
    np.testing.assert_array_equal(used, settings.epochs)
    assert int(full_minibatches) == settings.epochs * settings.minibatches


def test_initial_networks_are_those_of_the_recipe() -> None:
    """Orthogonal hidden layers of gain sqrt(2), a head of 0.01 for the policy and 1 for the value,
    zero biases.
    """
    parts = ppo.make_networks(
        Actor((16, 16), "none", -0.7), Critic((16, 16), "none"), PpoSettings()
    )
    state = initial_state(parts, jax.random.key(4), jnp.zeros((1, 8)))
    actor, critic = state.actor["params"], state.critic["params"]
    np.testing.assert_allclose(actor["log_std"], -0.7)
    for network, gain in ((actor["trunk"], 0.01), (critic["trunk"], 1.0)):
        square = network["hidden_1"]["kernel"]
        np.testing.assert_allclose(square.T @ square, 2.0 * np.eye(16), atol=1e-5)
        head = network["head"]["kernel"]
        np.testing.assert_allclose(head.T @ head, gain**2 * np.eye(head.shape[1]), atol=1e-5)
        assert not any(np.any(layer["bias"]) for layer in network.values())
    assert np.any(actor["trunk"]["hidden_0"]["kernel"] != critic["trunk"]["hidden_0"]["kernel"])


def test_explained_variance() -> None:
    target = np.float32([1.0, 2.0, 3.0, 4.0])
    assert float(ppo.explained_variance(target, target)) == pytest.approx(1.0)
    assert float(ppo.explained_variance(target + 5.0, target)) == pytest.approx(1.0)
    assert float(ppo.explained_variance(0.0 * target, target)) == pytest.approx(0.0, abs=1e-6)
    assert float(ppo.explained_variance(-target, target)) == pytest.approx(-3.0)


# The probe environments.

PROBE_SETTINGS = PpoSettings(epochs=4, minibatches=4, segment=4)
PARTS = ppo.make_networks(Actor((16,), "none"), Critic((16,), "none"), PROBE_SETTINGS)


def with_discount(discount: Any) -> ppo.Ppo:
    return ppo.Ppo(PARTS, replace(PROBE_SETTINGS, discount=discount))


def solve_probe(probe: Probe) -> tuple[LearnerState, np.ndarray]:
    """Train on a probe and return the learner and its action's standard deviation."""
    state = train_on_probe(with_discount, 150, 2e-2, probe)
    return state, np.exp(state.actor["params"]["log_std"])


def value(state: LearnerState, *observation: float) -> float:
    return float(PARTS.value(state.critic, np.float32(observation)))


def action(state: LearnerState, *observation: float) -> float:
    return float(PARTS.policy(state.actor, np.float32(observation))[0][0])


def test_value_only() -> None:
    """Every one-step episode pays 1: a failure points to the value loss or the optimiser."""
    state, _ = solve_probe(Probe(pays=1.0))
    assert value(state, 0.0, 0.0) == pytest.approx(1.0, abs=0.02)


def test_value_that_depends_on_the_observation() -> None:
    """What is paid is what was shown: a failure points to how observations reach the critic."""
    state, _ = solve_probe(Probe(shows_sign=1.0, pays_sign=1.0))
    assert value(state, 1.0, 0.0) == pytest.approx(1.0, abs=0.05)
    assert value(state, -1.0, 0.0) == pytest.approx(-1.0, abs=0.05)


def test_discounting() -> None:
    """The second of two steps pays 1: a failure points to the bootstrap, the discount or the ends
    of episodes.
    """
    state, _ = solve_probe(Probe(shows_clock=1.0, length=2.0, pays=1.0, discount=0.7))
    assert value(state, 0.0, 1.0) == pytest.approx(1.0, abs=0.05)
    assert value(state, 0.0, 0.0) == pytest.approx(0.7, abs=0.05)


def test_policy() -> None:
    """The action 0.5 pays best: a failure points to the policy loss or to the advantages' sign."""
    state, std = solve_probe(Probe(target=0.5))
    assert action(state, 0.0, 0.0) == pytest.approx(0.5, abs=0.05)
    # Exploring costs its variance, which therefore shrinks from its initial exp(-0.5) squared =
    # 0.37.
    assert std[0] < 0.3


def test_policy_and_value_together() -> None:
    """The best action and the pay both follow what is shown: a failure points to samples that got
    out of step.
    """
    state, std = solve_probe(Probe(shows_sign=1.0, pays_sign=1.0, target=0.0, target_by_sign=0.5))
    assert action(state, 1.0, 0.0) == pytest.approx(0.5, abs=0.1)
    assert action(state, -1.0, 0.0) == pytest.approx(-0.5, abs=0.1)
    assert value(state, 1.0, 0.0) == pytest.approx(1.0 - std[0] ** 2, abs=0.1)
    assert value(state, -1.0, 0.0) == pytest.approx(-1.0 - std[0] ** 2, abs=0.1)


def test_a_gradient_in_tiles_is_that_of_the_whole_minibatch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = PpoSettings(action_bound_coef=0.3, entropy=0.01)
    parts = ppo.make_networks(Actor((8,), "none"), Critic((8,), "none"), settings)
    state = initial_state(parts, jax.random.key(0), jnp.zeros((1, 8)))
    draws = np.random.default_rng(3).normal(size=(13, 24)).astype(np.float32)
    batch = Batch(
        jnp.asarray(draws[:8].T), jnp.asarray(draws[8:10].T), *map(jnp.asarray, draws[10:])
    )

    def gradient() -> Any:
        """Compile anew, since the tiles' size counts then."""
        compiled = jax.jit(lambda *arguments: ppo.gradient_of(*arguments, parts, settings))
        return compiled((state.actor, state.critic), batch)

    whole = gradient()
    monkeypatch.setattr(ppo, "TILE", 8)
    tiled = gradient()
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=2e-5, atol=1e-6), whole, tiled)
    monkeypatch.setattr(ppo, "TILE", 7)  # does not divide 24: nothing is cut up
    again = gradient()
    jax.tree.map(np.testing.assert_array_equal, whole, again)


def test_greatest_products_have_the_gradient_of_their_definition() -> None:
    draws = np.random.default_rng(4)
    rows, kernel = draws.normal(size=(5, 6, 3)), draws.normal(size=(3, 4))
    mask = draws.random((5, 6)) < 0.5
    mask[:, 0], mask[2] = True, False  # nobody in one row

    def by_definition(rows: jax.Array, kernel: jax.Array) -> jax.Array:
        return jnp.max(jnp.where(mask[..., None], rows @ kernel, -jnp.inf), axis=-2)

    def loss(function: Any) -> Any:
        return jax.value_and_grad(lambda *of: jnp.sum(jnp.tanh(function(*of))), argnums=(0, 1))

    gradients = loss(lambda *of: greatest_products(*of, jnp.asarray(mask)))(rows, kernel)
    expected = loss(by_definition)(rows, kernel)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), gradients, expected)
