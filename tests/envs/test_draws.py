"""Draws by position: any split gives the same numbers, random or quasi-random, of the scenario's distribution."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from envs import surrogate
from envs.aircraft import PAPER
from envs.draws import normals, uniforms
from envs.encounters import SCENARIOS, Encounter, EncounterError, Scenario, sample, scenario
from envs.relative import straight_cpa
from envs.sobol import REPLICATES, QuasiScenario, quasi, quasi_numbered, sobol
from envs.starts import numbered
from envs.trees import column, mapped
from tests.support import angle_between

both = pytest.mark.parametrize("draw", [uniforms, normals])
shapes = st.lists(st.integers(1, 5), min_size=0, max_size=3).map(tuple)


@both
@given(
    seed=st.integers(0, 2**63), first=st.integers(0, 10**9), shape=shapes, cuts=st.lists(st.integers(0, 40), max_size=4)
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
    for other in (draw(8, 100, 50, (3,), stream=2), draw(7, 100, 50, (3,), stream=3), draw(7, 150, 50, (3,), stream=2)):
        assert np.intersect1d(base, other).size == 0
    assert np.unique(base).size == base.size


def test_streams_and_encounters_are_uncorrelated() -> None:
    rows = np.stack([uniforms(0, 0, 20_000, (), stream) for stream in range(4)] + [uniforms(1, 0, 20_000, ())])
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


# Quasi-random draws: by number, evenly spread, of the scenario's distribution, and worth their name.
CIRCLE = scenario("circle", PAPER)


def of_replicate(draws: np.ndarray, replicate: int) -> np.ndarray:
    """Return one randomisation's draws of encounters that begin with number 0."""
    return draws[replicate::REPLICATES]


@settings(max_examples=25, deadline=None)
@given(first=st.integers(0, 5_000), count=st.integers(1, 70), cut=st.integers(0, 70), seed=st.integers(0, 2**64 - 1))
def test_draws_depend_on_the_number_alone(first: int, count: int, cut: int, seed: int) -> None:
    cut = min(cut, count)
    whole = sobol(seed, first, count, 3)
    assert whole.shape == (count, 3)
    assert np.all((whole >= 0.0) & (whole < 1.0))
    parts = np.concatenate([sobol(seed, first, cut, 3), sobol(seed, first + cut, count - cut, 3)])
    np.testing.assert_array_equal(parts, whole)


def test_every_dimension_of_every_randomisation_is_stratified() -> None:
    points = 64
    draws = sobol(5, 0, points * REPLICATES, CIRCLE.dimensions)
    for replicate in range(REPLICATES):
        cells = np.sort(np.floor(of_replicate(draws, replicate) * points).astype(int), axis=0)
        # One point in each of the 64 equal parts of every axis.
        np.testing.assert_array_equal(cells, np.repeat(np.arange(points)[:, None], CIRCLE.dimensions, axis=1))


def test_later_blocks_are_stratified_too() -> None:
    points = 32
    draws = sobol(5, 3 * points * REPLICATES, points * REPLICATES, 4)
    cells = np.sort(np.floor(of_replicate(draws, 7) * points).astype(int), axis=0)
    np.testing.assert_array_equal(cells, np.repeat(np.arange(points)[:, None], 4, axis=1))


def test_randomisations_and_seeds_differ_and_are_uniform_at_every_point() -> None:
    draws = np.concatenate([sobol(seed, 0, 4 * REPLICATES, 2) for seed in range(60)]).reshape(60, 4, REPLICATES, 2)
    assert np.unique(draws).size == draws.size
    # A randomised point is uniform whatever its number: 960 independent copies of each.
    for point in range(4):
        for axis in range(2):
            assert stats.kstest(draws[:, point, :, axis].ravel(), "uniform").pvalue > 1e-4


def test_pairs_of_randomisations_are_uncorrelated() -> None:
    firsts = np.stack([sobol(seed, 0, REPLICATES, 1)[:, 0] for seed in range(100)])
    correlation = np.corrcoef(firsts.T) - np.eye(REPLICATES)
    assert np.max(np.abs(correlation)) < 5.0 / np.sqrt(100)


@pytest.mark.parametrize("name", ["circle", "multi", "head_on"])
def test_encounters_by_number_meet_the_conditions(name: str) -> None:
    family = scenario(name, PAPER)
    whole = quasi_numbered(family, 3, 10, 90)
    parts = [quasi_numbered(family, 3, 10 + row, 1) for row in (0, 1, 17, 89)]
    for row, one in zip((0, 1, 17, 89), parts, strict=True):
        mapped(lambda a, b, row=row: np.testing.assert_array_equal(a[row : row + 1], b), whole, one)
    apart = np.hypot(whole.intruders.x - whole.own.x[:, None], whole.intruders.y - whole.own.y[:, None])
    assert np.all(apart[whole.mask] >= family.min_initial_separation)
    cpa = straight_cpa(column(whole.own), whole.intruders, np)
    assert np.all(cpa.distance[whole.mask] < family.conflicts_closer_than)


def test_a_rejected_point_gives_the_pseudo_random_encounter_of_its_number() -> None:
    family = scenario("same_course", PAPER)
    _, accepted = sample(family, sobol(0, 0, 64, family.dimensions)[None], np)
    assert 0 < np.count_nonzero(accepted) < 64
    made, usual = quasi_numbered(family, 0, 0, 64), numbered(family, 0, 0, 64)
    same = np.isclose(made.own.speed, usual.own.speed)
    np.testing.assert_array_equal(same, ~accepted)


def test_a_mean_is_unbiased_and_varies_less_than_that_of_independent_draws() -> None:
    # Share of circle encounters whose straight courses come nearer than 400 m: an indicator, as success is.
    points, seeds = 256, 12

    def shares(draws: np.ndarray) -> np.ndarray:
        encounter, _ = sample(CIRCLE, draws.reshape(1, -1, CIRCLE.dimensions), np)
        near = straight_cpa(column(encounter.own), encounter.intruders, np).distance[:, 0] < 400.0
        return near.reshape(-1, points).mean(axis=1)

    even = np.concatenate(
        [
            np.stack([of_replicate(draws, replicate) for replicate in range(REPLICATES)])
            for draws in (sobol(seed, 0, points * REPLICATES, CIRCLE.dimensions) for seed in range(seeds))
        ]
    )
    plain = uniforms(0, 0, seeds * REPLICATES * points, (CIRCLE.dimensions,))
    quasi_shares, plain_shares = shares(even), shares(plain)
    expected = shares(uniforms(1, 0, 400_000 // points * points, (CIRCLE.dimensions,))).mean()
    # 192 randomisations: five standard errors of both estimates.
    error = np.sqrt(quasi_shares.var() / quasi_shares.size + plain_shares.var() * points / 400_000)
    assert abs(quasi_shares.mean() - expected) < 5.0 * error
    assert stats.f.sf(plain_shares.var(ddof=1) / quasi_shares.var(ddof=1), 191, 191) < 1e-3


def test_a_quasi_scenario_is_the_scenario() -> None:
    for name in SCENARIOS:
        family = scenario(name, PAPER)
        made = quasi(family)
        assert isinstance(made, QuasiScenario)
        assert {key: getattr(made, key) for key in vars(family)} == vars(family)


@pytest.mark.parametrize(
    ("family", "seed", "first", "said"),
    [
        (CIRCLE, -1, 0, "seed is -1"),
        (CIRCLE, 2**64, 0, "seed is"),
        (CIRCLE, 0, -1, "encounter number is -1"),
        (CIRCLE, 0, 2**34, "out of range"),
        (scenario("circle", PAPER, conflicts_closer_than=0.0, attempts=2), 0, 0, "does not meet the conditions"),
    ],
)
def test_what_cannot_be_drawn_is_refused(family: Scenario, seed: int, first: int, said: str) -> None:
    with pytest.raises(EncounterError, match=said):
        quasi_numbered(family, seed, first, 3)


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
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(pool) if leaf.dtype != bool)


def test_a_pool_keeps_the_conditions_of_its_scenarios(pool: Encounter) -> None:
    gap = np.hypot(pool.intruders.x - pool.own.x[..., None], pool.intruders.y - pool.own.y[..., None])
    assert np.min(np.where(pool.mask, gap, np.inf)) >= 1_000.0 - 0.01


def test_a_pool_mixes_its_scenarios_by_weight(pool: Encounter) -> None:
    several = np.asarray(pool.mask).sum(axis=-1) > 1
    difference = np.asarray(pool.own.heading[..., None] - pool.intruders.heading)[..., 0]
    aligned = ~several & (angle_between(difference, 0.0) < math.radians(20.0))
    assert several.mean() == pytest.approx(0.2, abs=0.035)
    # 0.3 of the second scenario and the ninth part of the first.
    assert aligned.mean() == pytest.approx(0.3 + 0.5 / 9.0, abs=0.04)


def test_pools_of_different_keys_differ_and_of_the_same_repeat(pool: Encounter) -> None:
    again, other = drawn_pool(0), drawn_pool(1)
    for leaf, repeated in zip(jax.tree.leaves(pool), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(leaf, repeated)
    assert np.intersect1d(pool.own.x, other.own.x).size < 5
    # A rejected start is replaced by a neighbour: only a few may repeat.
    assert np.unique(pool.own.x).size > 0.8 * pool.own.x.size
