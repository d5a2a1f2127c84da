"""Encounter samplers: the geometry of every scenario, the conditions on starts, and parity of numpy
and jax.
"""

import itertools
import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from envs import surrogate
from envs.aircraft import PAPER
from envs.draws import normals, uniforms
from envs.encounters import Encounter, EncounterError, Scenario, pad
from envs.scenarios import SCENARIOS, sample, scenario
from envs.trees import choose, take
from tests.support import angle_between

CONFLICTS = ("crossing_left", "crossing_right", "head_on", "same_course")
each_scenario = pytest.mark.parametrize("name", SCENARIOS)


def draw_accepted(scenario: Scenario, count: int, seed: int = 0) -> Encounter:
    """Return accepted encounters of a scenario."""
    attempts = min(scenario.attempts, 4)
    draws = np.random.default_rng(seed).random((attempts, count, scenario.dimensions))
    encounter, accepted = sample(scenario, draws, np)
    return only(encounter, accepted)


def only(encounter: Encounter, rows: np.ndarray) -> Encounter:
    return take(encounter, rows)


def leaves(encounter: Encounter) -> list[np.ndarray]:
    return jax.tree.leaves(encounter)


def gaps(encounter: Encounter) -> np.ndarray:
    """Return each present intruder's distance at the start, inf for absent ones, ``[N, K]``."""
    gap = np.hypot(
        encounter.intruders.x - encounter.own.x[:, None],
        encounter.intruders.y - encounter.own.y[:, None],
    )
    return np.where(encounter.mask, gap, np.inf)


def passing_distance(encounter: Encounter) -> np.ndarray:
    """Return the closest approach on straight courses by an independent formula, ``[N, K]``."""
    gap = (encounter.intruders.x - encounter.own.x[:, None]) + 1j * (
        encounter.intruders.y - encounter.own.y[:, None]
    )
    own_velocity = encounter.own.speed * np.exp(1j * encounter.own.heading)
    velocity = (
        encounter.intruders.speed * np.exp(1j * encounter.intruders.heading) - own_velocity[:, None]
    )
    time = np.maximum(-(gap * velocity.conj()).real / np.abs(velocity) ** 2, 0.0)
    return np.abs(gap + velocity * time)


def clockwise_difference(encounter: Encounter) -> np.ndarray:
    """Return intruder's course less own course, degrees clockwise in [-180, 180), ``[N, K]``."""
    difference = np.degrees(encounter.own.heading[:, None] - encounter.intruders.heading)
    return np.remainder(difference + 180.0, 360.0) - 180.0


def test_the_scenarios_are_those_of_the_design() -> None:
    assert set(SCENARIOS) == {"circle", "crossing_left", "crossing_right", "head_on", "same_course", "maneuvering",
                              "noisy", "multi"}  # fmt: skip
    assert all(scenario(name, PAPER).name == name for name in SCENARIOS)


@each_scenario
def test_ranges(name: str) -> None:
    chosen = scenario(name, PAPER)
    encounter = draw_accepted(chosen, 10_000)
    goal = np.hypot(encounter.goal_x, encounter.goal_y)
    slack = 1e-6
    assert 3_000.0 - slack <= goal.min() < 3_100.0
    assert 9_900.0 < goal.max() <= 10_000.0 + slack
    for speed in (encounter.own.speed, encounter.intruders.speed):
        assert 50.0 <= speed.min() < 51.0
        assert 99.0 < speed.max() <= 100.0
    for heading in (encounter.own.heading, encounter.intruders.heading):
        assert np.all((heading >= -math.pi) & (heading < math.pi))
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves(encounter) if leaf.dtype != bool)
    # Own course, speed and goal distance are uniform: the means of 10^4 draws lie within 5 sigma.
    if name in ("circle", "maneuvering", "noisy"):
        uniform = (
            (encounter.own.heading, -math.pi, math.pi),
            (goal, 3e3, 1e4),
            (encounter.own.speed, 50, 100),
        )
        for values, low, high in uniform:
            assert values.mean() == pytest.approx(
                0.5 * (low + high), abs=5.0 * (high - low) / math.sqrt(12e4)
            )


@each_scenario
def test_without_displacement_everybody_meets_in_the_centre_at_once(name: str) -> None:
    chosen = replace(scenario(name, PAPER), displacement=0.0, min_initial_separation=0.0)
    encounter = draw_accepted(chosen, 2_000)
    own, intruders = encounter.own, encounter.intruders
    arrival = np.hypot(own.x, own.y) / own.speed
    intruder_arrival = np.hypot(intruders.x, intruders.y) / intruders.speed
    np.testing.assert_allclose(intruder_arrival - arrival[:, None], 0.0, atol=1e-9)
    np.testing.assert_allclose(own.x + arrival * own.speed * np.cos(own.heading), 0.0, atol=1e-2)
    np.testing.assert_allclose(own.y + arrival * own.speed * np.sin(own.heading), 0.0, atol=1e-2)
    flown = arrival[:, None] * intruders.speed
    np.testing.assert_allclose(intruders.x + flown * np.cos(intruders.heading), 0.0, atol=1e-2)
    np.testing.assert_allclose(intruders.y + flown * np.sin(intruders.heading), 0.0, atol=1e-2)
    # The goal lies diametrically opposite.
    np.testing.assert_allclose([encounter.goal_x, encounter.goal_y], [-own.x, -own.y], atol=1e-9)


@each_scenario
def test_displacement_moves_starts_and_nothing_else(name: str) -> None:
    chosen = scenario(name, PAPER)
    draws = np.random.default_rng(1).random((1, 5_000, chosen.dimensions))
    displaced, _ = sample(chosen, draws, np)
    middle, _ = sample(replace(chosen, displacement=0.0), draws, np)
    for moved, unmoved in ((displaced.own, middle.own), (displaced.intruders, middle.intruders)):
        np.testing.assert_array_equal(moved.heading, unmoved.heading)
        np.testing.assert_array_equal(moved.speed, unmoved.speed)
        for shift in (moved.x - unmoved.x, moved.y - unmoved.y):
            assert np.max(np.abs(shift)) <= 500.0 + 1e-9
            assert shift.std() == pytest.approx(1_000.0 / math.sqrt(12.0), rel=0.05)
            assert abs(shift.mean()) < 5.0 * 289.0 / math.sqrt(5_000)
    np.testing.assert_array_equal(displaced.goal_x, middle.goal_x)
    np.testing.assert_array_equal(displaced.goal_y, middle.goal_y)
    # The four shifts of a pair are independent of one another.
    pairs = (displaced.own, middle.own), (displaced.intruders, middle.intruders)
    shifts = np.stack(
        [
            (at - of).reshape(5_000, -1)[:, 0]
            for a, b in pairs
            for at, of in ((a.x, b.x), (a.y, b.y))
        ]
    )
    assert np.max(np.abs(np.corrcoef(shifts) - np.eye(4))) < 5.0 / math.sqrt(5_000)


@pytest.mark.parametrize(
    ("name", "middle", "half_width"),
    [
        ("crossing_left", 90, 45),
        ("crossing_right", -90, 45),
        ("head_on", 180, 20),
        ("same_course", 0, 20),
    ],
)
def test_course_differences_of_the_four_conflicts(
    name: str, middle: float, half_width: float
) -> None:
    difference = clockwise_difference(draw_accepted(scenario(name, PAPER), 5_000))
    away = np.remainder(difference - middle + 180.0, 360.0) - 180.0
    assert np.max(np.abs(away)) <= half_width + 1e-6
    assert away.min() < -0.9 * half_width
    assert away.max() > 0.9 * half_width


@pytest.mark.parametrize(("name", "side"), [("crossing_left", 1.0), ("crossing_right", -1.0)])
def test_a_crossing_intruder_comes_from_the_side_of_its_name(name: str, side: float) -> None:
    """It starts on that side of the own course and its velocity leads to the other."""
    encounter = draw_accepted(replace(scenario(name, PAPER), displacement=0.0), 5_000)
    own = encounter.own
    x, y = encounter.intruders.x[:, 0] - own.x, encounter.intruders.y[:, 0] - own.y
    to_the_left = y * np.cos(own.heading) - x * np.sin(own.heading)
    assert np.all(side * to_the_left > 0.0)
    leftwards = np.sin(encounter.intruders.heading[:, 0] - own.heading)
    assert np.all(side * leftwards < 0.0)


def test_courses_of_the_circle_are_uniform() -> None:
    counts, _ = np.histogram(
        clockwise_difference(
            draw_accepted(scenario("circle", PAPER, min_initial_separation=0.0), 36_000)
        ),
        36,
    )
    # Chi-square with 35 degrees of freedom: 80 is exceeded with probability 2e-5.
    assert np.sum((counts - 1_000.0) ** 2 / 1_000.0) < 80.0


@pytest.mark.parametrize("least", [1_000.0, 2_500.0])
def test_accepted_starts_honour_the_initial_separation(least: float) -> None:
    for name in ("circle", "multi", "same_course"):
        encounter = draw_accepted(
            replace(scenario(name, PAPER), min_initial_separation=least), 3_000
        )
        assert encounter.goal_x.size > 100
        assert gaps(encounter).min() >= least


@pytest.mark.parametrize("name", CONFLICTS)
def test_only_conflicts_are_accepted(name: str) -> None:
    encounter = draw_accepted(scenario(name, PAPER), 10_000)
    assert passing_distance(encounter).max() < 1_000.0


def test_unfiltered_circle_starts_in_violation_as_often_as_geometry_says() -> None:
    """About 2.1 %: the expectation comes from an independent sampler on the complex plane."""
    generator, count = np.random.default_rng(2), 400_000
    radius, own, speed = (
        generator.uniform(*ends, count) for ends in ((3e3, 1e4), (50, 100), (50, 100))
    )
    gap = radius * speed / own * np.exp(1j * generator.uniform(-np.pi, np.pi, count)) - radius
    for shift in (1, -1, 1j, -1j):
        gap += shift * generator.uniform(-500.0, 500.0, count)
    expected = np.mean(np.abs(gap) < 1_000.0)
    assert expected == pytest.approx(0.0208, abs=0.0012)

    unfiltered = scenario("circle", PAPER, min_initial_separation=0.0)
    encounter, accepted = sample(
        unfiltered, np.random.default_rng(3).random((1, count, unfiltered.dimensions)), np
    )
    assert accepted.all()
    share = np.mean(gaps(encounter) < 1_000.0)
    assert share == pytest.approx(expected, abs=5.0 * math.sqrt(2.0 * expected / count))


@each_scenario
def test_the_attempts_are_never_exhausted(name: str) -> None:
    """Of 10^5 encounters every one is accepted within its attempts; only the still rejected are
    drawn again.
    """
    chosen, generator, rejected = scenario(name, PAPER), np.random.default_rng(4), 100_000
    for _ in range(chosen.attempts):
        _, accepted = sample(chosen, generator.random((1, rejected, chosen.dimensions)), np)
        rejected -= int(accepted.sum())
        if not rejected:
            break
    assert rejected == 0


def test_the_first_attempt_that_meets_the_conditions_is_taken() -> None:
    chosen = scenario("circle", PAPER, min_initial_separation=6_000.0)
    draws = np.random.default_rng(5).random((3, 500, chosen.dimensions))
    encounter, accepted = sample(chosen, draws, np)
    attempts = [sample(chosen, draws[attempt : attempt + 1], np) for attempt in range(3)]
    for row in range(500):
        good = [attempt for attempt in range(3) if attempts[attempt][1][row]]
        expected = attempts[good[0] if good else 2][0]
        assert accepted[row] == bool(good)
        assert encounter.own.x[row] == expected.own.x[row]
        assert encounter.intruders.heading[row, 0] == expected.intruders.heading[row, 0]
        assert encounter.intent.onset[row, 0] == expected.intent.onset[row, 0]
        assert encounter.sensor.latency[row, 0] == expected.sensor.latency[row, 0]


def test_circle_is_passive_and_perfectly_seen() -> None:
    encounter = draw_accepted(scenario("circle", PAPER), 1_000)
    assert encounter.mask.shape == (encounter.goal_x.size, 1)
    assert encounter.mask.all()
    assert not encounter.intent.heading_change.any()
    assert not np.any(np.stack(encounter.sensor))


def test_maneuvering_turns_once_within_the_designs_ranges() -> None:
    encounter = draw_accepted(scenario("maneuvering", PAPER), 20_000)
    rate, change = (
        np.degrees(encounter.intent.turn_rate),
        np.degrees(encounter.intent.heading_change),
    )
    assert rate.min() >= 0.0
    assert 2.95 < rate.max() <= 3.0 + 1e-9
    assert rate.mean() == pytest.approx(1.5, abs=0.05)
    assert 118.0 < np.max(np.abs(change)) <= 120.0 + 1e-9
    assert change.mean() == pytest.approx(0.0, abs=3.0)
    assert change.std() == pytest.approx(120.0 / math.sqrt(3.0), rel=0.03)
    gap = (
        encounter.intruders.x
        - encounter.own.x[:, None]
        + 1j * (encounter.intruders.y - encounter.own.y[:, None])
    )
    own_velocity = (encounter.own.speed * np.exp(1j * encounter.own.heading))[:, None]
    velocity = encounter.intruders.speed * np.exp(1j * encounter.intruders.heading) - own_velocity
    cpa = np.maximum(-(gap * velocity.conj()).real / np.abs(velocity) ** 2, 0.0)
    share = (encounter.intent.onset / np.maximum(1.2 * cpa, 1e-9))[cpa > 10.0]
    assert np.all((share >= -1e-4) & (share <= 1.0 + 1e-4))
    assert share.mean() == pytest.approx(0.5, abs=0.02)


def test_noisy_reports_are_as_the_design_says() -> None:
    sensor = draw_accepted(scenario("noisy", PAPER), 5_000).sensor
    assert np.all(sensor.position_std == 30.0)
    assert np.all(sensor.velocity_std == 3.0)
    assert 1.0 <= sensor.latency.min() < 1.01
    assert 1.99 < sensor.latency.max() <= 2.0


def test_multi_has_two_to_eight_intruders_equally_often() -> None:
    unfiltered = scenario("multi", PAPER, min_initial_separation=0.0)
    encounter = draw_accepted(unfiltered, 14_000)
    counts = np.bincount(encounter.mask.sum(axis=-1), minlength=9)
    assert not counts[:2].any()
    np.testing.assert_allclose(counts[2:], 2_000.0, atol=5.0 * math.sqrt(2_000.0))
    # Present intruders come first, and each is drawn for itself.
    assert np.all(np.diff(encounter.mask.astype(int), axis=-1) <= 0)
    correlation = np.corrcoef(encounter.intruders.speed.T)
    assert np.max(np.abs(correlation - np.eye(8))) < 0.05


@each_scenario
def test_numpy_and_jax_give_the_same_encounters_of_the_same_draws(name: str) -> None:
    """From draws that float32 holds: starts within 0.1 m (float32's unit is 2 mm at 20 km), angles
    within 1e-6.
    """
    chosen = scenario(name, PAPER)
    draws = np.random.default_rng(6).random((1, 2_000, chosen.dimensions), np.float32)
    plain, plain_accepted = sample(chosen, draws.astype(np.float64), np)
    jitted, jitted_accepted = jax.jit(lambda drawn: sample(chosen, drawn, jnp))(draws)
    assert all(leaf.dtype in (np.float32, bool) for leaf in map(np.asarray, leaves(jitted)))
    for states, expected in ((jitted.own, plain.own), (jitted.intruders, plain.intruders)):
        np.testing.assert_allclose(states.x, expected.x, atol=0.1)
        np.testing.assert_allclose(states.y, expected.y, atol=0.1)
        assert np.max(angle_between(states.heading, expected.heading)) < 1e-6
        np.testing.assert_allclose(states.speed, expected.speed, atol=1e-4)
    np.testing.assert_allclose(jitted.goal_x, plain.goal_x, atol=0.1)
    np.testing.assert_array_equal(jitted.mask, plain.mask)
    np.testing.assert_allclose(jitted.intent.heading_change, plain.intent.heading_change, atol=1e-5)
    # Almost equal velocities make the time to the closest approach ill-conditioned.
    relative = np.abs(plain.intruders.speed * np.exp(1j * plain.intruders.heading)
                      - (plain.own.speed * np.exp(1j * plain.own.heading))[:, None])  # fmt: skip
    calm = relative > 5.0
    np.testing.assert_allclose(
        np.asarray(jitted.intent.onset)[calm], plain.intent.onset[calm], rtol=1e-3, atol=1e-2
    )
    # The conditions may differ only where a start lies on one of their limits.
    apart, passing = gaps(plain), np.where(plain.mask, passing_distance(plain), 0.0)
    on_the_edge = (np.abs(apart - 1_000.0).min(-1) < 0.5) | (
        np.abs(passing - 1_000.0).min(-1) < 0.5
    )
    np.testing.assert_array_equal(
        np.asarray(jitted_accepted)[~on_the_edge], plain_accepted[~on_the_edge]
    )


@pytest.mark.parametrize("xp", [np, jnp], ids=["numpy", "jax"])
def test_padding_adds_absent_intruders_only(xp) -> None:
    chosen = scenario("maneuvering", PAPER)
    plain, _ = sample(chosen, np.random.default_rng(7).random((1, 50, chosen.dimensions)), np)
    encounter = jax.tree.map(xp.asarray, plain)
    wide = pad(encounter, 4, xp)
    np.testing.assert_array_equal(wide.mask, np.tile([True, False, False, False], (50, 1)))
    for narrow, padded_fields in (
        (encounter.intruders, wide.intruders),
        (encounter.intent, wide.intent),
    ):
        for field, more in zip(narrow, padded_fields, strict=True):
            assert more.shape == (50, 4)
            np.testing.assert_array_equal(more[:, :1], field)
            assert np.all(np.isfinite(more))
    np.testing.assert_array_equal(np.stack(wide.own), np.stack(encounter.own))
    assert pad(encounter, 1, xp) is encounter


@given(st.lists(st.booleans(), min_size=1, max_size=20), st.sampled_from(["multi", "noisy"]))
def test_choose_takes_every_field_of_the_chosen_row(condition: list[bool], name: str) -> None:
    chosen, count = scenario(name, PAPER), len(condition)
    draws = np.random.default_rng(8).random((2, 1, count, chosen.dimensions))
    (yes, _), (no, _) = (sample(chosen, part, np) for part in draws)
    mixed = choose(np.array(condition), yes, no, np)
    for mixed_field, a, b in zip(leaves(mixed), leaves(yes), leaves(no), strict=True):
        for row, first in enumerate(condition):
            np.testing.assert_array_equal(mixed_field[row], (a if first else b)[row])


def test_scenario_changes_fields_and_refuses_unknown_names() -> None:
    assert scenario("circle", PAPER, radius=(200.0, 300.0)) == replace(
        scenario("circle", PAPER), radius=(200.0, 300.0)
    )
    with pytest.raises(
        EncounterError, match=r"'cirle' is unknown; expected one of circle, crossing_left"
    ):
        scenario("cirle", PAPER)


# Draws by position: any split gives the same numbers, of the scenario's distribution.


both = pytest.mark.parametrize("draw", [uniforms, normals])
shapes = st.lists(st.integers(1, 5), min_size=0, max_size=3).map(tuple)


@both
@given(
    seed=st.integers(0, 2**63),
    first=st.integers(0, 10**9),
    shape=shapes,
    cuts=st.lists(st.integers(0, 40), max_size=4),
)
def test_any_split_of_a_range_gives_the_same_numbers(draw, seed, first, shape, cuts) -> None:
    whole = draw(seed, first, 40, shape)
    edges = [0, *sorted(cuts), 40]
    parts = [draw(seed, first + a, b - a, shape) for a, b in itertools.pairwise(edges)]
    assert whole.shape == (40, *shape)
    assert whole.dtype == np.float64
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@both
def test_one_seed_repeats_and_everything_else_differs(draw) -> None:
    base = draw(7, 100, 50, (3,), stream=2)
    np.testing.assert_array_equal(base, draw(7, 100, 50, (3,), stream=2))
    for drawn in (
        draw(8, 100, 50, (3,), stream=2),
        draw(7, 100, 50, (3,), stream=3),
        draw(7, 150, 50, (3,), stream=2),
    ):
        assert np.intersect1d(base, drawn).size == 0
    assert np.unique(base).size == base.size


def test_streams_and_encounters_are_uncorrelated() -> None:
    rows = np.stack(
        [uniforms(0, 0, 20_000, (), stream) for stream in range(4)] + [uniforms(1, 0, 20_000, ())]
    )
    rows = np.concatenate([rows, np.roll(rows[:1], 1, axis=1)])
    assert np.max(np.abs(np.corrcoef(rows) - np.eye(len(rows)))) < 5.0 / math.sqrt(20_000)


@pytest.mark.parametrize("shape", [(), (5,), (3, 7)])
def test_uniforms_are_uniform(shape: tuple[int, ...]) -> None:
    count = 100_000 // max(1, math.prod(shape))
    draws = uniforms(3, 0, count, shape).ravel()
    assert draws.min() >= 0.0
    assert draws.max() < 1.0
    counts, _ = np.histogram(draws, 50, (0.0, 1.0))
    assert stats.chisquare(counts).pvalue > 1e-4


def test_normals_are_normal() -> None:
    draws = normals(4, 0, 25_000, (2, 2)).ravel()
    n = draws.size
    assert abs(draws.mean()) < 5.0 / math.sqrt(n)
    assert draws.var() == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / n))
    assert stats.skew(draws) == pytest.approx(0.0, abs=5.0 * math.sqrt(6.0 / n))
    assert stats.kurtosis(draws) == pytest.approx(0.0, abs=5.0 * math.sqrt(24.0 / n))
    assert stats.kstest(draws, "norm").pvalue > 1e-4


# The pool of starts.
@jax.jit
def drawn_pool(seed: int) -> Encounter:
    mixture = [
        scenario("circle", PAPER),
        scenario("same_course", PAPER, conflicts_closer_than=500.0),
        scenario("multi", PAPER),
    ]
    return surrogate.redraw_pool(jax.random.key(seed), mixture, [0.5, 0.3, 0.2], 40, 100)


@pytest.fixture(scope="module")
def pool() -> Encounter:
    return drawn_pool(0)


def test_a_pool_holds_rows_of_padded_starts(pool: Encounter) -> None:
    assert pool.mask.shape == (40, 100, 8)
    assert {leaf.shape[:2] for leaf in jax.tree.leaves(pool)} == {(40, 100)}
    assert all(
        bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(pool) if leaf.dtype != bool
    )


def test_a_pool_keeps_the_conditions_of_its_scenarios(pool: Encounter) -> None:
    gap = np.hypot(
        pool.intruders.x - pool.own.x[..., None], pool.intruders.y - pool.own.y[..., None]
    )
    assert np.min(np.where(pool.mask, gap, np.inf)) >= 1_000.0 - 0.01


def test_a_pool_mixes_its_scenarios_by_weight(pool: Encounter) -> None:
    several = np.asarray(pool.mask).sum(axis=-1) > 1
    difference = np.asarray(pool.own.heading[..., None] - pool.intruders.heading)[..., 0]
    aligned = ~several & (angle_between(difference, 0.0) < math.radians(20.0))
    assert several.mean() == pytest.approx(0.2, abs=0.035)
    # 0.3 of the second scenario and the ninth part of the first.
    assert aligned.mean() == pytest.approx(0.3 + 0.5 / 9.0, abs=0.04)


def test_pools_of_different_keys_differ_and_of_the_same_repeat(pool: Encounter) -> None:
    again, of_other_key = drawn_pool(0), drawn_pool(1)
    for leaf, repeated in zip(jax.tree.leaves(pool), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(leaf, repeated)
    assert np.intersect1d(pool.own.x, of_other_key.own.x).size < 5
    # A rejected start is replaced by a neighbour: only a few may repeat.
    assert np.unique(pool.own.x).size > 0.8 * pool.own.x.size
