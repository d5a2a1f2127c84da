"""What is practised are the run's failures and detours, and moments of flights that resolve them."""

from pathlib import Path

import numpy as np
import pytest

from agents.config.load import ConfigError
from agents.resolvability.classify import Verdict, classify
from envs.encounters import SCENARIOS
from envs.formats import encounter_file
from envs.kinematics import SURROGATE, advance, commands
from envs.observation import observe
from envs.outcome import RULES
from envs.starts import numbered
from envs.trees import take
from eval.failures.groups import failures
from eval.flights.simulate import OUTCOMES, direct, fly
from eval.monte_carlo import run as monte_carlo
from eval.practice import _write_examples, main
from eval.practice_flights import along, examples, moments, resolving
from eval.report.folder import read_run
from tests.eval.report_runs import report_run

__all__ = ["report_run"]


def test_failures_and_detours_of_a_run_are_written_each_with_its_moments(
    report_run: Path, policy_path: Path, tmp_path: Path
) -> None:
    out = tmp_path / "practice.csv"
    asked = ["--run", str(report_run), "--policy", str(policy_path), "--longer", "20", "--moments", "2"]
    shown = tmp_path / "examples.npz"
    assert main([*asked, "--out", str(out), "--examples", str(shown), "--most-examples", "100"]) == 0
    with np.load(shown) as stored:
        assert stored["observation"].shape == (100, 8)
        assert stored["action"].shape == (100, 2)
    run = read_run(report_run)
    wanted = failures(run.table) | (run.table["path_excess"] >= 0.2)
    assert failures(run.table).any()
    starts, names = encounter_file.read(out)
    labels = run.table["name"][wanted].tolist()
    assert [name for name in names if name in labels] == labels
    later = [name.rsplit(" at ", 1) for name in names if name not in labels]
    assert {name for name, _ in later} <= set(labels)
    assert all(time.removesuffix(" s").isdecimal() for _, time in later)
    assert 0 < len(later) <= 2 * len(labels)
    apart = np.hypot(starts.intruders.x - starts.own.x[:, None], starts.intruders.y - starts.own.y[:, None])
    assert np.all(apart[starts.mask] > RULES.separation)


@pytest.mark.parametrize("name", [pytest.param("circle", marks=pytest.mark.slow), "maneuvering"])
def test_moments_can_be_resolved_from_where_they_begin(name: str) -> None:
    """They lie on a flight that does it, and the intruders fly on from there as they would have."""
    starts = numbered(SCENARIOS[name], 5, 0, 24)
    later, of, times = moments(resolving(starts, RULES, SURROGATE, 40.0), RULES, 3)
    assert len(of) == len(times) == len(later.goal_x) > 24
    verdicts = classify(later, RULES, SURROGATE).verdict
    assert np.all(verdicts == Verdict.RESOLVABLE)
    for row in np.unique(of):
        assert np.all(np.diff(times[of == row]) > 0.0)
    before = take(starts, of)
    np.testing.assert_array_equal(later.goal_x, before.goal_x)
    waiting = (times[:, None] <= before.intent.onset) & (before.intent.heading_change != 0.0)
    assert waiting.any() == (name == "maneuvering")
    np.testing.assert_allclose(
        (later.intent.onset + times[:, None])[waiting], before.intent.onset[waiting], rtol=0, atol=1e-9
    )
    straight = before.intent.heading_change[:, 0] == 0.0
    travelled = before.intruders.speed * times[:, None]
    np.testing.assert_allclose(
        np.hypot(later.intruders.x - before.intruders.x, later.intruders.y - before.intruders.y)[straight],
        travelled[straight],
        rtol=1e-6,
    )


def test_moments_along_a_flight_go_on_as_it_did() -> None:
    starts, policy = numbered(SCENARIOS["maneuvering"], 5, 0, 40), direct(SURROGATE)
    whole, _ = fly(starts, policy, RULES, SURROGATE)
    later, of, times = along(starts, policy, RULES, SURROGATE, 3)
    assert len(of) > 40
    rest, _ = fly(later, policy, RULES, SURROGATE)
    in_time = whole.outcome[of] != OUTCOMES.index("timeout")
    np.testing.assert_array_equal(rest.outcome[in_time], whole.outcome[of][in_time])
    np.testing.assert_allclose(rest.duration[in_time], whole.duration[of][in_time] - times[in_time], atol=1.0)
    np.testing.assert_allclose(rest.goal_distance[in_time], whole.goal_distance[of][in_time], atol=1.0)


def test_moments_along_flights_of_a_run_are_written(report_run: Path, policy_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "along.csv"
    asked = ["--run", str(report_run), "--policy", str(policy_path), "--along", "2", "--most", "5", "--out", str(out)]
    assert main(asked) == 0
    _, names = encounter_file.read(out)
    assert any(" along " in name for name in names)


@pytest.mark.parametrize(
    ("flown", "message"),
    [
        (["--mode", "plan"], "flew in mode plan, expected policy"),
        (["--mode", "policy", "--scenario", "noisy"], "noisy or late reports, expected perfect ones"),
    ],
)
def test_moments_along_flights_want_a_policy_with_perfect_reports(
    flown: list[str], message: str, policy_path: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    asked = ["--encounters", "30", "--policy", str(policy_path), "--set", "figures=false", "--workers", "1"]
    assert monte_carlo.main([*flown, *asked, "--out", str(run)]) == 0
    out = tmp_path / "along.csv"
    with pytest.raises(ConfigError, match=message):
        main(["--run", str(run), "--longer", "0.001", "--along", "2", "--out", str(out)])
    assert not out.exists()


def test_examples_do_what_resolves_the_encounters() -> None:
    """Whoever does the same in the same places flies the same: each step follows from the one before."""
    starts = numbered(SCENARIOS["circle"], 5, 0, 12)
    flights = resolving(starts, RULES, SURROGATE, 40.0)
    observation, action = examples(flights, RULES, SURROGATE)
    seconds = np.isfinite(flights.film.own.x[1:]).sum(0)
    assert len(observation) == len(action) == seconds.sum()
    column = np.flatnonzero(flights.of == 3)[0]
    times = np.arange(seconds[column])
    rows = np.nonzero(np.isfinite(flights.film.own.x[1:]))[1] == column
    own, other = take(starts.own, [3]), take(starts.intruders, [3])
    for time, seen, done in zip(times, observation[rows], action[rows].astype(float), strict=True):
        ahead = other._replace(
            x=other.x + time * other.speed * np.cos(other.heading),
            y=other.y + time * other.speed * np.sin(other.heading),
        )
        expected = observe(own, take(ahead, (slice(None), 0)), starts.goal_x[[3]], starts.goal_y[[3]], np)
        np.testing.assert_allclose(seen, expected[0], atol=1e-4)
        own = advance(own, *commands((done[:1], done[1:]), SURROGATE, np), 1.0, SURROGATE, np)
    assert np.hypot(starts.goal_x[3] - own.x, starts.goal_y[3] - own.y)[0] <= RULES.goal_radius + 1.0


def test_who_foresees_a_turn_is_no_example() -> None:
    starts = numbered(SCENARIOS["maneuvering"], 5, 0, 12)
    flights = resolving(starts, RULES, SURROGATE, 0.0)
    straight = np.all(flights.encounters.intent.heading_change == 0.0, axis=-1)
    assert 0 <= straight.sum() < straight.size
    observation, _ = examples(flights, RULES, SURROGATE)
    assert len(observation) == np.isfinite(flights.film.own.x[1:, straight]).sum()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--longer", "0"], "expected a number above 0, percent"),
        (["--moments", "-1"], "expected a whole number"),
        (["--spare", "-1"], "expected a number from 0 to 100000, m"),
        (["--examples", "hard.csv"], "expected the name of a file that ends in .npz"),
    ],
)
def test_bad_input_is_a_sentence(arguments: list[str], said: str, report_run: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said):
        main(["--run", str(report_run), "--out", str(tmp_path / "x.csv"), *arguments])


@pytest.mark.parametrize("name", ["out", "examples"])
def test_a_folder_that_is_not_there_is_said_before_the_search(name: str, report_run: Path, tmp_path: Path) -> None:
    files = {"out": tmp_path / "hard.csv", "examples": tmp_path / "hard.npz"}
    files[name] = tmp_path / "nowhere" / files[name].name
    with pytest.raises(ConfigError, match=rf"--{name} .*: there is no folder .*nowhere"):
        main(["--run", str(report_run), "--out", str(files["out"]), "--examples", str(files["examples"])])
    assert not list(tmp_path.rglob("hard.*"))


def test_no_example_is_a_sentence_and_no_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "hard.npz"
    with pytest.raises(ConfigError, match=r"--examples .*: there is none"):
        _write_examples(path, [(np.zeros((0, 8), np.float32), np.zeros((0, 2), np.float32))], 100)
    assert not path.exists()


def test_what_is_there_already_stays(report_run: Path, tmp_path: Path) -> None:
    there = tmp_path / "mine.csv"
    there.write_text("mine")
    with pytest.raises(ConfigError, match="exists, expected the name of a new file"):
        main(["--run", str(report_run), "--out", str(there)])
    assert there.read_text() == "mine"
