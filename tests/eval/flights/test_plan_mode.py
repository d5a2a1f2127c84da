"""Plans are flown from their waypoints alone; the assured loop saves what the plan flown once
loses.
"""

import json
import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.assurance.asking import tries
from agents.planner.judge.validator import Findings
from agents.planner.planner import Plans, plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.request import Options
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.kinematics import C208_PUBLISHED
from envs.outcome import RULES
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from eval.flights.assured_mode import Assured, fly_assured
from eval.flights.plan_flight import PlanFlights
from eval.flights.plan_mode import fly_once, plan_at_start, promised_separation
from eval.flights.simulate import OUTCOMES, sensor_noise
from eval.monte_carlo import run as monte_carlo

REACHED, TIMEOUT = OUTCOMES.index("reached"), OUTCOMES.index("timeout")
OPTIONS = Options.for_aircraft(PAPER, C208_PUBLISHED)
OWN = "envs.own_separations:separations"
SMALL = ("--set", "resamples=200", "--set", "figures=false")


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    return encounters_of_seed(scenario("circle", PAPER), 11, 0, 16)


@pytest.fixture(scope="module")
def plans(encounters: Encounter) -> Plans:
    return plan_at_start(encounters, Policy.load(), PAPER, OPTIONS)


@pytest.fixture(scope="module")
def flown(encounters: Encounter, plans: Plans) -> PlanFlights:
    return fly_once(encounters, plans, PAPER, OPTIONS)


def table_of(out: Path) -> dict[str, np.ndarray]:
    table = pq.read_table(out / "encounters.parquet")
    return {name: table.column(name).to_numpy() for name in table.column_names}


@pytest.mark.slow
def test_safe_plans_are_flown_as_the_validator_says(plans: Plans, flown: PlanFlights) -> None:
    safe = plans.candidates.safe
    assert safe.mean() > 0.9
    assert np.all(flown.flights.outcome[safe] == REACHED)
    assert np.abs(flown.whole_separation - plans.candidates.min_separation)[safe].max() < 0.02
    # The path is counted to the goal's disc, which plans enter 50 m deeper than they must.
    assert np.abs(flown.flights.path_length - plans.candidates.path)[safe].max() < 120.0


@pytest.mark.slow
def test_flights_do_not_depend_on_their_company_and_need_a_trajectory(
    encounters: Encounter, plans: Plans, flown: PlanFlights
) -> None:
    three = take(plans, slice(10, 13))
    last = np.array([three.candidates.last[0], -1, three.candidates.last[2]])
    three = three._replace(candidates=three.candidates._replace(last=last))
    part = fly_once(take(encounters, slice(10, 13)), three, PAPER, OPTIONS)
    for a, b in zip((*part.flights, *part[1:]), (*flown.flights, *flown[1:]), strict=True):
        np.testing.assert_array_equal(a[[0, 2]], b[[10, 12]])
    assert part.flights.outcome[1] == TIMEOUT
    assert math.isnan(part.flights.min_separation[1])


@pytest.mark.slow
def test_refusing_is_no_success(encounters: Encounter, plans: Plans) -> None:
    unsafe = plans._replace(candidates=plans.candidates._replace(findings=Findings.empty(16)))
    rows = slice(0, 4)
    refused = fly_once(take(encounters, rows), take(unsafe, rows), PAPER, OPTIONS).flights
    assert not (refused.outcome == REACHED).any()
    assert np.all(refused.score[refused.outcome == TIMEOUT] == RULES.reward_timeout)
    assert np.all(refused.duration[refused.outcome == TIMEOUT] == RULES.t_max)


@pytest.fixture(scope="module")
def own_separations() -> Encounter:
    """Encounters from each of whose intruders 300 to 3000 m are to be kept: 30."""
    return encounters_of_seed(scenario(OWN, PAPER), 5, 0, 30, heeds=("separation",))


@pytest.mark.slow
def test_safe_plans_keep_the_separation_of_each_intruder(own_separations: Encounter) -> None:
    plans = plan_at_start(own_separations, Policy.load(), PAPER, OPTIONS)
    flown = fly_once(own_separations, plans, PAPER, OPTIONS).flights
    safe = plans.candidates.safe
    assert safe.mean() > 0.8
    assert np.all(flown.outcome[safe] == REACHED)
    assert flown.min_separation[safe].min() >= PAPER.separation
    # The nearest distance in metres is less than the usual separation in some, and many times it
    # is required in others.
    assert plans.candidates.min_separation[safe].min() < PAPER.separation
    assured = fly_assured(own_separations, plans, Policy.load(), PAPER, OPTIONS).flown.flights
    assert np.all(assured.outcome[safe] == REACHED)


@pytest.mark.slow
def test_the_usual_separation_of_each_changes_no_plan(
    encounters: Encounter, plans: Plans, flown: PlanFlights
) -> None:
    sample = take(encounters, slice(0, 3))
    usual = sample._replace(separation=np.full(sample.mask.shape, PAPER.separation))
    ours = plan_at_start(usual, Policy.load(), PAPER, OPTIONS)
    np.testing.assert_array_equal(
        ours.candidates.plan_states.x, take(plans, slice(0, 3)).candidates.plan_states.x
    )
    flights = fly_once(usual, ours, PAPER, OPTIONS).flights
    for field, expected in zip(flights, take(flown.flights, slice(0, 3)), strict=True):
        np.testing.assert_array_equal(field, expected)


def test_the_route_of_an_evaluation(encounters: Encounter) -> None:
    request = request_of(encounters, PAPER)
    assert request.route_x.shape == (16, 11)
    np.testing.assert_allclose(request.route_x[:, 0], encounters.own.x)
    np.testing.assert_allclose(request.route_y[:, 1], encounters.goal_y)
    spacing = np.hypot(
        np.diff(request.route_x[:, 1:], axis=1), np.diff(request.route_y[:, 1:], axis=1)
    )
    np.testing.assert_allclose(spacing, 5_000.0)


@pytest.mark.slow
def test_a_run_tells_of_plans(tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = [
        "--mode",
        "plan",
        "--encounters",
        "12",
        "--seed",
        "5",
        *SMALL,
        "--workers",
        "1",
        "--out",
        str(out),
    ]
    assert monte_carlo.main(arguments) == 0
    table, summary = table_of(out), json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert summary["mode"] == "plan"
    assert summary["safe_plans_violated"] == 0
    assert summary["safe_plans_broken"] == summary["safe_plans_not_promised"] == 0
    assert summary["plan_safe_rate"]["count"] == np.count_nonzero(table["plan_status"] == "safe")
    assert summary["policy_success_rate"]["count"] == np.count_nonzero(
        table["policy_outcome"] == "reached"
    )
    assert sum(summary["safe_plans_by_source"].values()) == summary["plan_safe_rate"]["count"]
    assert summary["follower_error_m_quantiles"]["1"] < 0.1

    again = tmp_path / "again"
    config = [
        f"--config={out / 'config.yaml'}",
        "--set",
        "chunk=5",
        "--workers",
        "2",
        f"--out={again}",
    ]
    assert monte_carlo.main(config) == 0
    assert (again / "encounters.parquet").read_bytes() == (out / "encounters.parquet").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["noisy", "multi", "maneuvering"])
def test_every_scenario_can_be_planned_for(tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    arguments = [
        "--mode",
        "plan",
        "--allow-outside-domain",
        "--scenario",
        name,
        "--encounters",
        "3",
        *SMALL,
        "--set",
        "planner.exhaustive=false",
    ]
    assert monte_carlo.main([*arguments, "--workers", "1", "--out", str(out)]) == 0
    table = table_of(out)
    assert set(table["plan_status"]) <= {"safe", "unresolved"}
    assert np.all(table["whole_min_separation_m"] > 0.0)


@pytest.mark.slow
def test_flights_of_plans_are_drawn(tmp_path: Path) -> None:
    out = tmp_path / "drawn"
    arguments = ["--mode", "plan", "--encounters", "12", "--set", "resamples=200", "--workers", "1"]
    assert monte_carlo.main([*arguments, "--out", str(out)]) == 0
    assert (out / "trajectories.png").stat().st_size > 20_000


@pytest.mark.slow
def test_a_broken_promise_is_no_excuse(encounters: Encounter, plans: Plans) -> None:
    """Among straight intruders what a plan loses is what it promised to keep."""
    tighter = PAPER._replace(separation=3.0 * PAPER.separation)
    flown = fly_once(encounters, plans, tighter, OPTIONS)
    lost = plans.candidates.safe & (flown.flights.outcome == OUTCOMES.index("violation"))
    assert lost.any()
    promised = promised_separation(encounters, plans, tighter, OPTIONS, lost)
    assert np.allclose(promised[lost], flown.flights.min_separation[lost], atol=1e-2)
    assert np.all(promised[lost] < tighter.separation)


# The assured loop saves what the plan flown once loses, and depends on nobody else.


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module")
def turning() -> Encounter:
    return encounters_of_seed(scenario("maneuvering", PAPER), 3, 0, 24)


@pytest.fixture(scope="module")
def begun(turning: Encounter, policy: Policy) -> Plans:
    return plan_at_start(turning, policy, PAPER, OPTIONS)


@pytest.fixture(scope="module")
def assured(turning: Encounter, begun: Plans, policy: Policy) -> Assured:
    return fly_assured(turning, begun, policy, PAPER, OPTIONS)


@pytest.mark.slow
def test_more_is_saved_than_by_the_plan_flown_once(
    turning: Encounter, begun: Plans, assured: Assured
) -> None:
    once = fly_once(turning, begun, PAPER, OPTIONS)
    outcome = assured.flown.flights.outcome
    assert (outcome == REACHED).mean() >= 0.95
    assert (outcome == REACHED).sum() > (once.flights.outcome == REACHED).sum()
    # What the plans lost they had not promised: the intruders turned after they were made.
    lost = begun.candidates.safe & (once.flights.outcome == OUTCOMES.index("violation"))
    assert lost.any()
    promised = promised_separation(turning, begun, PAPER, OPTIONS, lost)
    assert np.all(np.isnan(promised) == ~lost)
    assert np.all(promised[lost] >= PAPER.separation)
    # Every flight saved had a new plan.
    saved = (outcome == REACHED) & (once.flights.outcome != REACHED)
    assert np.all(assured.replans[saved] > 0)


@pytest.mark.slow
def test_a_goal_that_the_plan_passes_over_is_asked_for_again(policy: Policy) -> None:
    alone = encounters_of_seed(scenario("circle", PAPER), 11, 0, 1)
    alone = alone._replace(mask=alone.mask & False)
    request = request_of(alone, PAPER)
    onward = (
        request.route_x[:, 2:] + 4_000.0,
        request.route_y[:, 2:] + 4_000.0,
        request.points - 2,
    )
    plans = plan_many(
        request._replace(route_x=onward[0], route_y=onward[1], points=onward[2]), policy, OPTIONS
    )
    assert plans.candidates.safe.all()
    beyond = plans._replace(candidates=plans.candidates._replace(goal=plans.candidates.goal + 2))
    flown = fly_assured(alone, beyond, policy, PAPER, OPTIONS)
    assert np.all(flown.flown.flights.outcome == REACHED)
    np.testing.assert_array_equal(flown.replans, 1)


def test_plans_that_keep_more_than_required_are_tried_first() -> None:
    wide, in_time, along = tries(OPTIONS, 100.0)
    assert wide.requirement.margin > 300.0 + in_time.requirement.margin
    assert in_time.requirement == along.requirement == OPTIONS.requirement
    assert wide.rejoin_by < in_time.rejoin_by == 100.0 < along.rejoin_by == OPTIONS.rejoin_by


@pytest.mark.slow
def test_a_plan_leaves_room_for_turns_before_they_begin(policy: Policy) -> None:
    """With what the plan at the start had to spare, neither plan nor backup was left when two of
    four turned.
    """
    four = encounters_of_seed(scenario("maneuvering", PAPER, intruders=(2, 4)), 23, 118, 1)
    flown = fly_assured(four, plan_at_start(four, policy, PAPER, OPTIONS), policy, PAPER, OPTIONS)
    assert flown.flown.flights.outcome[0] == REACHED


@pytest.mark.slow
def test_noise_of_straight_traffic_asks_for_few_plans(policy: Policy) -> None:
    starts = encounters_of_seed(scenario("noisy", PAPER), 11, 0, 3)
    noise = sensor_noise(11, 0, *starts.mask.shape)
    plans = plan_at_start(starts, policy, PAPER, OPTIONS, noise(0))
    flown = fly_assured(starts, plans, policy, PAPER, OPTIONS, noise=noise)
    assert np.median(flown.replans) <= 3


@pytest.mark.slow
def test_assured_flights_do_not_depend_on_their_company(
    turning: Encounter, policy: Policy, assured: Assured
) -> None:
    part_of_all = take(turning, slice(12, 16))
    part = fly_assured(
        part_of_all, plan_at_start(part_of_all, policy, PAPER, OPTIONS), policy, PAPER, OPTIONS
    )
    for a, b in zip(part.flown.flights, assured.flown.flights, strict=True):
        np.testing.assert_array_equal(a, b[12:16])
    np.testing.assert_array_equal(part.replans, assured.replans[12:16])


@pytest.mark.slow
def test_a_run_tells_of_all_modes_side_by_side(tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = [
        "--mode",
        "assured",
        "--scenario",
        "maneuvering",
        "--encounters",
        "3",
        "--set",
        "resamples=200",
    ]
    assert monte_carlo.main([*arguments, "--workers", "1", "--out", str(out)]) == 0
    table, summary = (
        pq.read_table(out / "encounters.parquet"),
        json.loads((out / "summary.json").read_text("utf-8")),
    )
    for name in ("baseline", "policy", "plan"):
        assert f"{name}_outcome" in table.column_names
    for key in (
        "policy_success_rate",
        "plan_success_rate",
        "success_rate",
        "replans_mean",
        "backup_used_rate",
    ):
        assert key in summary
    assert (out / "trajectories.png").stat().st_size > 20_000


def test_every_safe_plan_keeps_the_separation_as_flown() -> None:
    encounters = encounters_of_seed(scenario("circle", PAPER), 7, 0, 30)
    options = Options.for_aircraft(PAPER)
    all_plans = plan_many(request_of(encounters, PAPER), Policy.load(), options)
    plans = all_plans.candidates
    # The narrowest ones, because a flight takes its time.
    closest = np.flatnonzero(plans.safe)[np.argsort(plans.min_separation[plans.safe])[:6]]
    flown = fly_once(take(encounters, closest), take(all_plans, closest), PAPER, options)
    assert flown.whole_separation.min() >= 1_000.0
    assert flown.error.max() < 0.1
    np.testing.assert_allclose(flown.whole_separation, plans.min_separation[closest], atol=0.02)
