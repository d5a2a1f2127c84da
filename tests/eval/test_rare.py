"""Importance splitting against probabilities that are known: exactly, or by plain sampling of
something cheap.
"""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import genpareto

from agents.config.load import ConfigError
from agents.planner.request.options import Options
from commands.command import run_cli
from envs.aircraft import PAPER
from envs.draws import uniforms
from envs.encounters import EncounterError
from envs.formats import encounter_file
from envs.outcome import RULES
from envs.relative import straight_cpa
from envs.scenarios import sample, scenario
from envs.trees import column
from eval.flights.chunks import Evaluation, ReadyEvaluation
from eval.flights.plan_mode import fly_once, plan_at_start
from eval.flights.simulate import ByPolicy, Unmitigated, fly
from eval.rare import run as rare
from eval.rare.problem import FlightProblem
from eval.rare.splitting import Plan, SplittingError, pilot, repetition
from eval.rare.tail import fits

CIRCLE = scenario("circle", PAPER)
SMALL = ["--particles", "60", "--repetitions", "3", "--moves", "1"]


class Tail:
    """The sum of normal numbers, whose tail is known exactly, where the first of them is
    positive.
    """

    dimensions = 7

    def value(self, draws: np.ndarray) -> np.ndarray:
        return np.where(draws[:, 0] > -1.0, -draws[:, 1:].sum(axis=1) / np.sqrt(6.0), np.nan)


class Miss:
    """The closest approach of straight courses in circle encounters: cheap, so that plain sampling
    knows it too.
    """

    dimensions = CIRCLE.dimensions

    def value(self, draws: np.ndarray) -> np.ndarray:
        return self.miss(ndtr(draws))

    def miss(self, uniform: np.ndarray) -> np.ndarray:
        encounter, supported = sample(CIRCLE, uniform[None], np)
        distance = straight_cpa(column(encounter.own), encounter.intruders, np).distance[:, 0]
        return np.where(supported, distance, np.nan)


class Flat:
    """Two values and nothing between: no level lies below the first."""

    dimensions = 2

    def value(self, draws: np.ndarray) -> np.ndarray:
        return np.full(len(draws), 5.0)


def estimates(
    problem, threshold: float, repetitions: int, particles: int = 400, moves: int = 4, seed: int = 0
):
    rngs = [
        np.random.default_rng(sequence)
        for sequence in np.random.SeedSequence(seed).spawn(repetitions + 1)
    ]
    plan = pilot(problem, threshold, particles, moves, 0.2, rngs[0])
    return plan, [repetition(problem, plan, particles, moves, rng) for rng in rngs[1:]]


def test_an_exact_tail_is_met_without_bias_and_at_a_fraction_of_the_cost() -> None:
    exact = float(ndtr(-4.5))  # 3.4e-6
    plan, repeated = estimates(Tail(), -4.5, 30)
    assert plan.levels[-1] == -4.5
    assert list(plan.levels) == sorted(plan.levels, reverse=True)
    values = np.array([estimate.probability[-1] for estimate in repeated])
    error = values.std(ddof=1) / np.sqrt(values.size)
    assert abs(values.mean() - exact) < 3.5 * error
    assert error < 0.15 * exact
    # Plain sampling of as many evaluations would have this error.
    evaluations = sum(estimate.evaluations for estimate in repeated)
    assert error < 0.1 * np.sqrt(exact / evaluations)


def test_an_extreme_value_fit_meets_a_known_tail() -> None:
    values = genpareto.rvs(-0.3, scale=500.0, size=20_000, random_state=np.random.default_rng(1))
    fitted = fits(-values, float(-genpareto.ppf(0.9995, -0.3, scale=500.0)))
    assert len(fitted) == 7
    for fit in fitted:
        # A shape's standard error is (1 + shape) / sqrt(n) (Smith, Biometrika 72 (1985) 67).
        assert fit["shape"] == pytest.approx(-0.3, abs=4.0 * 0.7 / np.sqrt(fit["below"]))
        assert 2e-4 < fit["rate"] < 1.2e-3  # the truth: 5e-4
        assert np.allclose(fit["quantiles_m"], fit["fitted_quantiles_m"], rtol=0.3, atol=5.0)
    assert not fits(np.arange(50.0), 1.0)  # too few below every threshold


def test_straight_courses_agree_with_a_million_plain_samples() -> None:
    threshold = 0.05  # m
    plain = np.concatenate(
        [
            Miss().miss(uniforms(11, first, 50_000, (CIRCLE.dimensions,)))
            for first in range(0, 1_000_000, 50_000)
        ]
    )
    plain = plain[np.isfinite(plain)]
    _, repeated = estimates(Miss(), threshold, 12, particles=600)
    for level in (50.0, threshold):
        if level == threshold:
            values = np.array([estimate.probability[-1] for estimate in repeated])
        else:
            values = np.array([np.mean(estimate.first < level) for estimate in repeated])
        share = np.mean(plain < level)
        error = np.hypot(values.std(ddof=1) / np.sqrt(values.size), np.sqrt(share / plain.size))
        assert abs(values.mean() - share) < 3.5 * error
    assert 1e-5 < np.mean(plain < threshold) < 3e-4
    assert error < 0.3 * share


def test_an_estimate_says_where_plain_sampling_is_cheaper() -> None:
    rate = {"repetitions": [0.4, 0.5], "relative_error": 0.1}
    estimate = {"rate": rate, "ancestors": [99, 99], "levels": [], "flights": 3000}
    cheap = rare._warnings(estimate | {"plain_flights_for_the_same_error": 880.0})
    assert cheap == [
        "plain sampling needs only 8.8e+02 flights for this error, instead of 3000: this loss is "
        "not rare, use eval.monte_carlo"
    ]
    assert rare._warnings(estimate | {"plain_flights_for_the_same_error": 1e6}) == []


def test_levels_that_nobody_passes_give_zero_and_not_an_error() -> None:
    estimate = repetition(Tail(), Plan((-50.0,), (), 0), 20, 1, np.random.default_rng(0))
    assert estimate.probability.tolist() == [0.0]
    assert estimate.ancestors == 0
    assert len(estimate.last) == 0
    deep = repetition(
        Tail(), Plan((0.0, -50.0, -60.0), (0.5, 0.5), 0), 20, 1, np.random.default_rng(0)
    )
    assert deep.probability[0] > 0.0
    assert deep.probability[1:].tolist() == [0.0, 0.0]


def test_a_threshold_that_is_common_needs_no_levels() -> None:
    plan, repeated = estimates(Tail(), 0.0, 3)
    assert plan.levels == (0.0,)
    assert np.mean([estimate.probability[-1] for estimate in repeated]) == pytest.approx(
        0.5, abs=0.08
    )


def test_a_plateau_is_said_and_not_climbed_for_ever() -> None:
    with pytest.raises(SplittingError, match="stops at level"):
        pilot(Flat(), 1.0, 50, 1, 0.2, np.random.default_rng(0))


def problem_of(policy, mode: str, name: str = "circle", **settings) -> FlightProblem:
    evaluation = Evaluation(None, scenario(name, PAPER), None, 0, PAPER)
    return FlightProblem(ReadyEvaluation(evaluation, policy), mode, **settings)


@pytest.mark.parametrize("mode", ["policy", pytest.param("plan", marks=pytest.mark.slow), "none"])
def test_the_value_is_the_separation_of_the_flight(policy, mode: str) -> None:
    problem = problem_of(policy, mode)
    draws = np.random.default_rng(1).standard_normal(
        (4 if mode == "plan" else 60, CIRCLE.dimensions)
    )
    starts, inside = problem.sample_encounters(draws)
    values = problem.value(draws)
    np.testing.assert_array_equal(np.isnan(values), ~inside)
    if mode == "policy":
        expected = fly(starts, ByPolicy(policy), PAPER).min_separation
    elif mode == "none":
        expected = fly(starts, Unmitigated(PAPER), PAPER).min_separation
    else:
        options = Options.for_aircraft(PAPER)
        plans = plan_at_start(starts, policy, PAPER, options)
        expected = fly_once(starts, plans, PAPER, options).flights.min_separation
    np.testing.assert_array_equal(values[inside], expected[inside])
    assert (values < RULES.separation).any() or mode == "plan"


@pytest.mark.parametrize("modifier", ["own_separations", "partly_seen", "reacting"])
def test_what_the_file_of_lost_encounters_cannot_hold_is_refused(policy, modifier: str) -> None:
    with pytest.raises(EncounterError, match=rf"scenario 'circle \+ {modifier}' has intruders"):
        problem_of(policy, "policy", f"circle + {modifier}")


def test_noise_is_part_of_the_draws(policy) -> None:
    problem = problem_of(policy, "policy", "noisy")
    noisy = scenario("noisy", PAPER).dimensions
    assert problem.dimensions == noisy + 300 * 4
    draws = np.random.default_rng(2).standard_normal((6, problem.dimensions))
    again = draws.copy()
    again[3, noisy:] += 2.0
    before, after = problem.value(draws), problem.value(again)
    assert np.isfinite(before[3])
    np.testing.assert_array_equal(
        before != after, [np.isnan(value) or row == 3 for row, value in enumerate(before)]
    )
    assert problem_of(policy, "plan", "noisy").dimensions == noisy + 4


def test_proven_unresolvable_encounters_can_be_left_out(policy) -> None:
    every = problem_of(policy, "none")
    rng = np.random.default_rng(3)
    draws = rng.standard_normal((1_500, CIRCLE.dimensions))
    near, inside = every.sample_encounters(draws)
    close = (
        np.hypot(near.intruders.x[:, 0] - near.own.x, near.intruders.y[:, 0] - near.own.y) < 1_150.0
    )
    draws = draws[inside & close]
    values, values_of_resolvable = (
        every.value(draws),
        problem_of(policy, "none", resolvable_only=True).value(draws),
    )
    excluded = np.isinf(values_of_resolvable)
    assert 0 < np.count_nonzero(excluded) < len(values_of_resolvable)
    np.testing.assert_array_equal(values_of_resolvable[~excluded], values[~excluded])
    assert np.all(values[excluded] < RULES.separation)


@pytest.mark.slow
def test_files_of_an_estimate(tmp_path: Path, policy_path: Path) -> None:
    out = tmp_path / "rare"
    arguments = ["--policy", str(policy_path), "--mode", "none", "--closer-than", "30", *SMALL]
    assert rare.main([*arguments, "--encounters-per-hour", "0.5", "--out", str(out)]) == 0
    written = json.loads((out / "rare.json").read_text(encoding="utf-8"))
    assert {path.name for path in out.iterdir()} >= {
        "rare.json",
        "rare.png",
        "rare.svg",
        "config.yaml",
        "worst.csv",
    }
    assert (out / "tail.png").stat().st_size > 10_000
    assert written["losses_per_hour"]["high"] == 0.5 * written["rate"]["high"]
    assert written["tail"][0]["threshold_m"] > 30.0
    assert 0.01 < written["tail"][0]["rate"] < 0.2
    levels = [level["level_m"] for level in written["levels"]]
    assert levels == sorted(levels, reverse=True)
    assert levels[-1] == 30.0
    assert 0.02 < written["rate"]["value"] < 0.15
    assert written["rate"]["low"] <= written["rate"]["value"] <= written["rate"]["high"]
    with (out / "worst.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    assert len(rows) > 2
    # Straight flights of these encounters do lose 30 m.
    starts, _ = encounter_file.read(out / "worst.csv", PAPER)
    flown = fly(starts, Unmitigated(PAPER), PAPER, endless=True)
    assert flown.min_separation.max() < 30.0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_estimate(tmp_path: Path, policy_path: Path) -> None:
    rates = []
    for number, seed in enumerate(("4", "4", "5")):
        out = tmp_path / str(number)
        arguments = ["--policy", str(policy_path), "--mode", "none", "--closer-than", "400"]
        rare.main(
            [
                *arguments,
                "--particles",
                "12",
                "--repetitions",
                "3",
                "--seed",
                seed,
                "--out",
                str(out),
            ]
        )
        rates.append(
            json.loads((out / "rare.json").read_text(encoding="utf-8"))["rate"]["repetitions"]
        )
    assert rates[0] == rates[1] != rates[2]


@pytest.mark.slow
def test_the_configuration_of_an_estimate_repeats_it(tmp_path: Path, policy_path: Path) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    arguments = ["--policy", str(policy_path), "--mode", "none", "--closer-than", "400"]
    arguments += ["--particles", "12", "--moves", "2", "--repetitions", "4", "--seed", "4"]
    arguments += ["--confidence", "0.9", "--encounters-per-hour", "0.5", "--resolvable-only"]
    assert rare.main([*arguments, "--out", str(first)]) == 0
    assert rare.main(["--config", str(first / "config.yaml"), "--out", str(again)]) == 0
    written = [
        json.loads((out / "rare.json").read_text(encoding="utf-8")) for out in (first, again)
    ]
    for estimate in written:
        del estimate["wall_s"]
    assert written[0] == written[1]
    for name in ("config.yaml", "worst.csv"):
        assert (first / name).read_bytes() == (again / name).read_bytes()


@pytest.mark.slow
def test_an_interrupted_estimate_goes_on_from_its_repetitions(
    tmp_path: Path, policy_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    arguments = ["--policy", str(policy_path), "--mode", "none", "--closer-than", "400"]
    arguments += ["--particles", "12", "--moves", "2", "--repetitions", "3", "--seed", "4"]
    assert rare.main([*arguments, "--out", str(whole)]) == 0
    calls_made: list[int] = []

    def stop_at_the_second(problem, plan, *rest_of_arguments):
        if len(calls_made) == 1:
            raise KeyboardInterrupt
        calls_made.append(1)
        return repetition(problem, plan, *rest_of_arguments)

    monkeypatch.setattr(rare, "repetition", stop_at_the_second)
    with pytest.raises(KeyboardInterrupt):
        rare.main([*arguments, "--out", str(out)])
    assert f"Go on with: python -m eval.rare --resume --out {out}" in capsys.readouterr().err
    calls_made.append(0)  # nothing stops it now
    monkeypatch.setattr(rare, "pilot", lambda *_: pytest.fail("the pilot is stored"))
    # The level of the intervals decides no flight.
    assert rare.main(["--resume", "--confidence", "0.95", "--out", str(out)]) == 0
    assert calls_made == [1, 0, 1, 1]
    written = [
        json.loads((item / "rare.json").read_text(encoding="utf-8")) for item in (out, whole)
    ]
    for item in written:
        del item["wall_s"]
    assert written[0] == written[1]
    assert {path.name for path in out.iterdir()} == {path.name for path in whole.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--confidence", "1"], "--confidence: 1"),
        (["--scenario", "file:nothing.csv"], "cannot be flown here; expected a sampled scenario"),
        (["--set", "particles=3"], "particles is 3"),
        (["--mode", "assured"], "--mode"),
        (["--set", "mode=assured"], "mode is 'assured'"),
        (["--set", "changes.radius=[5, 1]"], "changes"),
    ],
)
def test_bad_input_is_one_sentence(
    tmp_path: Path, capsys, arguments: list[str], problem: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: rare.main([*arguments, "--out", str(tmp_path / "x")]))
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert problem in line
    assert not (tmp_path / "x").exists()


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigError, match="holds something already"):
        rare.main([*SMALL, "--mode", "none", "--out", str(tmp_path)])
