"""The training task: what is learned from, near-limit starts, what is reported and what policies
are judged by.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import load
from envs import surrogate
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.outcome import RULES, Outcome
from envs.scenarios import sample, scenario
from rlcas_jax.config import TrainConfig
from rlcas_jax.task import CompiledTask, TrainState, build, fly

SMALL = [
    "network={hidden: [8], feature_set: mirror}",
    "environments=32",
    "rollout=96",
    "ppo.minibatch=768",
    "ppo.epochs=2",
    "learning_rate=2e-3",
    "learning_rate_final=1e-3",
    "pool_rows=4",
    "steps=15360",
]
SHAPED = ["rewards.goal_distance=200.0"]
UPDATES = 5


def task_of(*changes: str) -> CompiledTask:
    return build(load(TrainConfig, None, [*SMALL, *changes]))


def run(task: CompiledTask, updates: int) -> tuple[TrainState, list[dict[str, float]]]:
    state, log = task.initial(), []
    for _ in range(updates):
        state, figures = task.update(state)
        log.append({name: float(value) for name, value in figures.items()})
    return state, log


@pytest.fixture(scope="module")
def plain() -> CompiledTask:
    return task_of()


@pytest.fixture(scope="module")
def trained(plain: CompiledTask) -> tuple[TrainState, list[dict[str, float]]]:
    return run(plain, UPDATES)


def assert_equal(a: Any, b: Any) -> None:
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(x, y)


def test_steps_are_counted_in_whole_updates(plain: CompiledTask) -> None:
    assert (plain.steps_per_update, plain.updates) == (32 * 96, UPDATES)
    assert task_of("steps=15359").updates == UPDATES - 1
    assert task_of("steps=1").updates == 1


def test_a_run_repeats_bit_for_bit(plain: CompiledTask, trained) -> None:
    state, log = run(plain, UPDATES)
    assert_equal(state, trained[0])
    assert log == trained[1]


def test_another_seed_is_another_run(plain: CompiledTask) -> None:
    one, other = plain.initial(), task_of("seed=1").initial()
    assert np.intersect1d(one.environment.own.x, other.environment.own.x).size == 0
    kernels = [state.learner.actor["params"]["trunk"]["head"]["kernel"] for state in (one, other)]
    assert np.all(np.asarray(kernels[0]) != np.asarray(kernels[1]))


def test_the_learning_rate_falls_linearly_with_the_updates(trained) -> None:
    rates = [figures["learning_rate"] for figures in trained[1]]
    np.testing.assert_allclose(rates, 2e-3 - 1e-3 * np.arange(UPDATES) / UPDATES, rtol=1e-5)
    assert int(trained[0].update) == UPDATES


def test_every_update_learns_and_draws_anew(plain: CompiledTask) -> None:
    first = jax.tree.map(np.asarray, plain.initial())
    second = jax.tree.map(np.asarray, plain.update(plain.initial())[0])
    assert np.any(first.key != second.key)
    for network in ("actor", "critic"):
        moved = [
            np.any(a != b)
            for a, b in zip(
                *(jax.tree.leaves(getattr(s.learner, network)) for s in (first, second)),
                strict=True,
            )
        ]
        assert all(moved)


def test_the_reported_rates_and_score_are_those_of_the_episodes_that_ended(trained) -> None:
    """The score is the paper's sparse one, unscaled: +100, -100 and -10 by rate."""
    for figures in trained[1]:
        if figures["episodes"] == 0.0:
            continue
        rates = [figures[name] for name in ("success", "violation", "timeout")]
        assert sum(rates) == pytest.approx(1.0)
        assert figures["score"] == pytest.approx(np.dot(rates, [100.0, -100.0, -10.0]), abs=1e-3)
        assert figures["episode_length"] == pytest.approx(32 * 96 / figures["episodes"])
    assert sum(figures["episodes"] for figures in trained[1]) > 32
    assert all(figures["finite"] == 1.0 for figures in trained[1])


@pytest.mark.slow
def test_shaping_changes_what_is_learned_but_not_what_is_reported(trained) -> None:
    """The first rollout flies the same policy through the same encounters, with and without
    shaping.
    """
    _, shaped_log = run(task_of(*SHAPED), 1)
    first, shaped = trained[1][0], shaped_log[0]
    for name in ("episodes", "score", "success", "violation", "timeout"):
        assert shaped[name] == first[name]
    assert shaped["value_loss"] != first["value_loss"]


def test_the_state_holds_what_the_mixture_needs() -> None:
    """Room for the most intruders of any scenario, and a history only where reports are late."""
    shapes = jax.eval_shape(task_of().initial)
    assert shapes.environment.mask.shape == (32, 1)
    assert shapes.environment.previous is None
    mixed = jax.eval_shape(
        task_of("scenarios=[{name: circle}, {name: multi}, {name: noisy}]").initial
    )
    assert mixed.environment.mask.shape == (32, 8)
    assert mixed.environment.previous is not None


def test_policies_are_judged_by_the_aircrafts_separation() -> None:
    task = task_of(
        "world.separation_spread=0.2",
        "rewards.timeout=-20.0",
        "aircraft.separation_m=1200",
        "network.feature_set=set",
    )
    assert task.rules == RULES._replace(
        separation=1200.0, reward_timeout=-20.0, goal_radius=600.0, dt=1.2, t_max=360.0
    )


def test_required_separations_are_spread_over_the_range() -> None:
    world = load(TrainConfig, None, ["world.separation_spread=0.08"]).world
    required = world.required_separation(1024, 1_000.0)
    assert required.min() == 1_000.0
    assert required.max() < 1_080.0
    # Any 64 neighbours are as good as all of them.
    for first in range(0, 1024, 64):
        np.testing.assert_allclose(
            np.sort(required[first : first + 64]), np.linspace(1_000.0, 1_080.0, 64), atol=3.0
        )


def test_each_encounter_is_lost_by_its_required_separation() -> None:
    drawn = drawn_starts(64)
    required = load(TrainConfig, None, ["world.separation_spread=4"]).world.required_separation(
        64, 1_000.0
    )
    world = surrogate.World(RULES, PAPER)
    begun = surrogate.reset(drawn, required_separation=jnp.asarray(required))
    still = jnp.zeros(64), jnp.zeros(64)
    state, result = jax.jit(lambda now: surrogate.step(now, still, world))(begun)
    assert result.outcome.violation.sum() not in (0, 64)
    np.testing.assert_array_equal(result.outcome.violation, result.separation < required)
    np.testing.assert_array_equal(state.ended, result.outcome.ended(jnp))


@pytest.mark.slow
def test_a_spread_changes_the_training_and_not_the_judgement(plain: CompiledTask) -> None:
    spread = task_of("world.separation_spread=2.0")
    assert spread.rules == plain.rules
    # So early all that end are violations, and the more is asked for the more there are.
    assert run(spread, 1)[1][0]["episodes"] > run(plain, 1)[1][0]["episodes"]


# Flying to the end.
def drawn_starts(count: int = 32) -> Encounter:
    circle = scenario("circle", PAPER)
    draws = np.random.default_rng(0).random((circle.attempts, count, circle.dimensions))
    drawn, _ = sample(circle, draws, np)
    return jax.tree.map(lambda a: jnp.asarray(a, bool if a.dtype == bool else jnp.float32), drawn)


def straight_on(observation: jax.Array) -> jax.Array:
    return jnp.zeros((*observation.shape[:-1], 2))


def to_the_goal(observation: jax.Array) -> jax.Array:
    return jnp.stack(
        [jnp.ones_like(observation[:, 0]), jnp.clip(20.0 * observation[:, 6], -1.0, 1.0)], axis=-1
    )


def fly_out(encounter: Encounter, policy: Any, **rules: Any) -> Outcome:
    world = surrogate.World(RULES._replace(**rules), PAPER)

    def decide(state: surrogate.State) -> jax.Array:
        return policy(surrogate.observe(state, PAPER))

    return jax.tree.map(np.asarray, jax.jit(lambda start: fly(decide, start, world))(encounter))


@pytest.fixture(scope="module")
def alone() -> Encounter:
    """Encounters whose intruder is absent."""
    drawn = drawn_starts()
    return drawn._replace(mask=jnp.zeros_like(drawn.mask))


def test_every_encounter_ends_in_exactly_one_way_and_it_is_the_first() -> None:
    """Against single steps: what happens after the end is not counted."""
    encounter = drawn_starts()
    found = fly_out(encounter, to_the_goal)
    state, first = jax.jit(surrogate.reset)(encounter), np.full(32, -1)
    world = surrogate.World(RULES, PAPER)

    @jax.jit
    def one(now: surrogate.State) -> tuple[surrogate.State, Outcome]:
        action = to_the_goal(surrogate.observe(now, PAPER))
        after, result = surrogate.step(now, (action[:, 0], action[:, 1]), world)
        return after, result.outcome

    for _ in range(300):
        state, outcome = one(state)
        happened = np.where(
            np.any(np.stack(outcome), axis=0), np.argmax(np.stack(outcome), axis=0), -1
        )
        first = np.where(first < 0, happened, first)
    np.testing.assert_array_equal(np.sum(np.stack(found), axis=0), 1)
    np.testing.assert_array_equal(np.argmax(np.stack(found), axis=0), first)
    assert found.violation.any()
    assert found.reached.any()


def test_flying_to_the_goal_alone_reaches_it(alone: Encounter) -> None:
    assert fly_out(alone, to_the_goal).reached.all()


def test_circling_times_out(alone: Encounter) -> None:
    def circling(observation: jax.Array) -> jax.Array:
        return jnp.tile(jnp.float32([0.0, 1.0]), (observation.shape[0], 1))

    assert fly_out(alone, circling).timeout.all()


def test_the_rules_given_are_the_rules_flown_by() -> None:
    """Side by side at 1100 m: fine for a separation of 1000 m, lost for one of 1200 m."""
    drawn = drawn_starts()
    beside = drawn.intruders._replace(
        x=(drawn.own.x - 1_100.0 * jnp.sin(drawn.own.heading))[:, None],
        y=(drawn.own.y + 1_100.0 * jnp.cos(drawn.own.heading))[:, None],
        heading=drawn.own.heading[:, None],
        speed=drawn.own.speed[:, None],
    )
    encounter = drawn._replace(intruders=beside)
    assert not fly_out(encounter, straight_on).violation.any()
    assert fly_out(encounter, straight_on, separation=1_200.0).violation.all()


def test_evaluation_flies_the_actors_mean(plain: CompiledTask) -> None:
    """A network whose head is a constant turn to the left flies circles until the time is up."""
    variables = jax.tree.map(jnp.zeros_like, plain.initial().learner.actor)
    variables["params"]["trunk"]["head"]["bias"] = jnp.float32([0.0, 5.0])
    drawn = drawn_starts()
    found = plain.evaluate(variables, drawn._replace(mask=jnp.zeros_like(drawn.mask)))
    assert np.all(found.timeout)
