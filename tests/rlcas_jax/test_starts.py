"""Encounters of one's own that a training practises beside those of its scenarios."""

from pathlib import Path

import jax
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from agents.resolvability.classify import Verdict, classify, replay
from envs.encounters import SCENARIOS, Encounter
from envs.formats import encounter_file
from envs.kinematics import SURROGATE
from envs.outcome import RULES
from envs.starts import cast, numbered
from envs.trees import take
from rlcas_jax.config import TrainConfig
from rlcas_jax.escape_margin import best
from rlcas_jax.starts import Own, displaced, draw, edges, intricate, practised
from rlcas_jax.train import main

CALM = numbered(SCENARIOS["maneuvering"], 3, 0, 7)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "hard.csv"
    encounter_file.write(path, CALM)
    return path


def configured(file: Path, *overrides: str) -> TrainConfig:
    return load(TrainConfig, None, [f"practice.encounters={file}", "ppo.environments=64", *overrides])


@pytest.mark.slow
def test_a_share_of_the_starts_is_taken_evenly_from_the_file(file: Path) -> None:
    config = configured(file, "practice.share=0.25", "practice.displacement=0", "scenarios=[{name: multi}]")
    own = practised(config)
    assert own is not None
    drawn = draw(jax.random.key(1), config, [entry.scenario() for entry in config.scenarios], 100, Own(own, None))
    times = [np.sum(np.asarray(drawn.own.heading) == heading) for heading in own.own.heading]
    np.testing.assert_allclose(times, 6400 * 0.25 / 7, rtol=0.25)
    assert sum(times) == pytest.approx(1600, rel=0.08)
    chosen = np.isin(np.asarray(drawn.own.heading), own.own.heading)
    # All of an encounter comes along, and intruders that it does not have are absent.
    np.testing.assert_array_equal(np.asarray(drawn.mask)[chosen].sum(-1), 1)
    assert np.all(np.isin(np.asarray(drawn.goal_x)[chosen], own.goal_x))
    assert np.all(np.isin(np.asarray(drawn.intent.onset)[chosen][:, 0], own.intent.onset))


def test_starts_are_moved_a_little_and_never_too_close() -> None:
    starts: Encounter = jax.tree.map(lambda field: np.repeat(field, 500, axis=0), CALM)
    moved = displaced(jax.random.key(0), starts, 2_000.0, 4_000.0)
    for before, after in ((starts.own, moved.own), (starts.intruders, moved.intruders)):
        assert np.max(np.abs(after.x - before.x)) <= 2_000.5
        assert np.max(np.abs(after.y - before.y)) <= 2_000.5
        np.testing.assert_allclose(after.heading, before.heading, rtol=1e-6)
        np.testing.assert_allclose(after.speed, before.speed, rtol=1e-6)
    np.testing.assert_allclose(moved.goal_x, starts.goal_x, rtol=1e-6)
    stayed = np.asarray(moved.own.x) == np.asarray(starts.own.x, np.float32)
    apart = np.hypot(moved.intruders.x - moved.own.x[:, None], moved.intruders.y - moved.own.y[:, None])[:, 0]
    assert np.all(stayed | (apart >= 4_000.0 - 1.0))
    assert 0.0 < stayed.mean() < 1.0


def spare(starts: Encounter) -> np.ndarray:
    """Return what the best manoeuvre keeps beyond 1000 m."""
    return best(starts.own, starts.goal_x, starts.goal_y, starts.intruders, starts.mask, np) - 1_000.0


@pytest.mark.slow
def test_edges_leave_little_to_lose_and_are_a_share_of_the_starts() -> None:
    config = load(
        TrainConfig, None, ["practice.edges=300", "practice.edge=30", "practice.edge_share=0.4", "ppo.environments=64"]
    )
    found = edges(config)
    assert found is not None
    assert found.goal_x.shape == (300,)
    left = spare(found)
    assert np.all((left > -0.05) & (left <= 30.05))  # rounded to float32
    assert np.quantile(left, 0.75) - np.quantile(left, 0.25) > 5.0
    again = edges(config)
    assert again is not None
    np.testing.assert_array_equal(found.own.x, again.own.x)
    drawn = draw(jax.random.key(1), config, [entry.scenario() for entry in config.scenarios], 50, Own(None, found))
    assert np.isin(np.asarray(drawn.own.heading), found.own.heading).mean() == pytest.approx(0.4, abs=0.05)
    assert edges(load(TrainConfig, None, [])) is None


@pytest.mark.slow
def test_what_is_intricate_no_simple_manoeuvre_resolves_but_another_flight_does() -> None:
    config = load(TrainConfig, None, ["practice.intricate=5", "practice.intricate_share=0.3", "ppo.environments=64"])
    found = intricate(config)
    assert found is not None
    assert found.goal_x.shape == (5,)
    short = spare(found)
    assert np.all((short > -20.05) & (short <= 0.05))
    # Shown by the flight itself, of the true limits and rules.
    starts = cast(found, np.float64)
    judged = classify(starts, RULES, SURROGATE)
    for i in np.flatnonzero(judged.verdict == Verdict.RESOLVABLE):
        flight = replay(take(starts, i), take(judged.witness, i), RULES, SURROGATE)
        assert flight.separation.min() >= 1_000.0
    assert (judged.verdict == Verdict.RESOLVABLE).sum() >= 4  # the last float32 digit may cost one
    given = {"practice": {**config.practice.model_dump(), "anywhere": 5, "anywhere_share": 0.3}}
    config = TrainConfig.model_validate({**config.model_dump(), **given})
    for own in (Own(intricate=found), Own(anywhere=found)):
        drawn = draw(jax.random.key(1), config, [entry.scenario() for entry in config.scenarios], 50, own)
        assert np.isin(np.asarray(drawn.own.heading), found.own.heading).mean() == pytest.approx(0.3, abs=0.05)
    assert intricate(load(TrainConfig, None, [])) is None


def test_edges_that_hardly_exist_are_a_sentence() -> None:
    config = load(TrainConfig, None, ["practice.edges=1000", "practice.edge=1e-4"])
    with pytest.raises(
        ConfigError, match=r"practice.edge is 0.0001 m with world.separation 1000 m: \d+ of \d+ encount"
    ):
        edges(config)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"own_x_m": "0"}, "encounter 'a' of .* begins closer than 1000 m"),
        ({"latency_s": "1.5"}, "encounter 'a' of .* has reports that come late"),
        ({"position_std_m": "30"}, "encounter 'a' of .* has noisy reports"),
        ({"velocity_std_m_s": "3"}, "encounter 'a' of .* has noisy reports"),
        ({"own_speed_m_s": "400"}, "line 2, column own_speed_m_s: '400', expected a number from 50 to 100"),
    ],
)
def test_what_cannot_be_practised_is_refused(changes: dict[str, str], said: str, tmp_path: Path) -> None:
    row = {
        "encounter": "a",
        "own_x_m": "-5000",
        "own_y_m": "0",
        "own_heading_deg": "0",
        "own_speed_m_s": "70",
        "goal_x_m": "5000",
        "goal_y_m": "0",
        "intruder_x_m": "500",
        "intruder_y_m": "0",
        "intruder_heading_deg": "180",
        "intruder_speed_m_s": "70",
        "latency_s": "0",
    } | changes
    path = tmp_path / "own.csv"
    path.write_text(f"{','.join(row)}\n{','.join(row.values())}\n")
    with pytest.raises(ConfigError, match=f"practice.encounters: .*{said}"):
        practised(configured(path))


def test_a_file_that_is_not_there_is_a_sentence_before_anything_is_trained(tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere.csv"
    with pytest.raises(ConfigError, match=f"practice.encounters: {nowhere}: there is no such file"):
        main(["--set", f"practice.encounters={nowhere}", "--out", str(tmp_path / "run"), "--quiet"])
