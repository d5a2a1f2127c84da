"""Peers side by side: the same flights as the evaluation's, one table, and clear words on bad
input.
"""

import json
import math
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.baselines.acas_nnet import NnetError
from agents.baselines.baselines import BASELINES
from agents.config.load import ConfigError
from agents.manoeuvres.escape_manoeuvre import steps, tracks
from agents.manoeuvres.escape_search import Escapes
from agents.planner.judge.validator import Findings
from agents.planner.request.options import Options
from agents.policy import file as policy_file
from agents.policy.inference import OutsideDomainError
from agents.resolvability.classify import Verdict, replay
from agents.resolvability.witness import least_cost
from commands.command import InputError
from envs.aircraft import PAPER
from envs.encounters import Encounter, EncounterError
from envs.formats import encounter_file
from envs.intruder import KnownFlight
from envs.kinematics import SURROGATE
from envs.scenarios import scenario
from envs.starts import encounters_of_seed, join
from envs.traffic.tracks import TrackError
from envs.trees import take
from eval.compare import resolvers as comparison
from eval.compare import run as compare
from eval.compare.resolvers import (
    REFERENCE,
    WITNESS,
    Comparison,
    Entry,
    Modes,
    baseline_entry,
    policy_entries,
)
from eval.flights import chunks, simulate
from eval.flights import recorded as recorded_flights
from eval.flights.chunks import Evaluation, ReadyEvaluation
from eval.flights.conditions import Flown, verdict_within
from eval.flights.optimal import Witness, WitnessSearch, fly_witnesses
from eval.flights.simulate import OUTCOMES
from eval.metrics.weighted import rates_of
from eval.runner import outputs
from eval.stats.paired import mcnemar_exact, pairs, tango
from tests.eval.resolvers import fly_recorded
from tests.support import recorded_path


def make(
    policy_path: Path | None, name: str, baselines: tuple[str, ...] = ("none", "mvp")
) -> Comparison:
    entries = policy_entries(policy_path, "ours", PAPER)
    entries += tuple(baseline_entry(baseline, PAPER) for baseline in baselines)
    return Comparison(entries, Evaluation(policy_path, scenario(name, PAPER), None, 4, PAPER))


def modes(*names: str) -> Modes:
    """Return modes of policies with the usual plans."""
    return Modes(names, {"": Options.for_aircraft(PAPER)})


SMALL = ("--set", "resamples=100", "--workers", "1")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["circle", "noisy"])
def test_a_policy_flies_here_as_in_the_evaluation(policy_path: Path, name: str) -> None:
    compared = make(policy_path, name, ("none",))
    ours = comparison.columns(compared, 10, 60)
    theirs = chunks.columns(ReadyEvaluation.load(compared.evaluation), 10, 60)
    np.testing.assert_array_equal(ours["ours.outcome"], theirs["outcome"])
    reached = theirs["outcome"] == "reached"
    assert 0 < reached.sum() < 60
    np.testing.assert_array_equal(ours["ours.path_excess"][reached], theirs["path_excess"][reached])
    np.testing.assert_array_equal(
        ours["ours.min_separation_m"][reached], theirs["min_separation_m"][reached]
    )
    np.testing.assert_array_equal(
        ours["ours.heading_reversals"][reached], theirs["heading_reversals"][reached]
    )
    np.testing.assert_array_equal(
        ours["none.outcome"] == "violation", theirs["baseline_outcome"] == "violation"
    )
    # Flights go on after a loss, so that smaller volumes can be judged.
    lost = theirs["outcome"] == "violation"
    assert (ours["ours.min_separation_m"][lost] <= theirs["min_separation_m"][lost]).all()


@pytest.mark.slow
def test_a_row_does_not_depend_on_its_company() -> None:
    compared = make(None, "multi", tuple(BASELINES))
    source = scenario("multi", PAPER, intruders=(2, 3), radius=(3_000.0, 4_000.0))
    compared = compared._replace(evaluation=compared.evaluation._replace(source=source))
    together, apart = comparison.columns(compared, 0, 6), comparison.columns(compared, 3, 2)
    for name, values in apart.items():
        np.testing.assert_array_equal(values, together[name][3:5], err_msg=name)


def test_the_resolver_none_is_the_evaluation_s_direct_flight() -> None:
    starts = encounters_of_seed(scenario("circle", PAPER), 9, 0, 80)
    ours = simulate.fly(starts, BASELINES["none"](PAPER), PAPER)
    theirs = simulate.fly(starts, simulate.Unmitigated(PAPER), PAPER)
    np.testing.assert_array_equal(ours.outcome, theirs.outcome)
    np.testing.assert_allclose(ours.min_separation, theirs.min_separation, atol=2.0)


@pytest.mark.parametrize("name", ["rules", "mvp", "mvp_speed"])
def test_resolvers_resolve(name: str) -> None:
    starts = encounters_of_seed(scenario("circle", PAPER), 9, 0, 150)
    flown = simulate.fly(starts, BASELINES[name](PAPER), PAPER)
    share = np.bincount(flown.outcome, minlength=3) / 150
    # Without a resolver nearly all are lost; published resolvers save nine of ten such conflicts.
    assert share[0] < 0.2
    assert share[1] > 0.7


def test_replayed_intruders_fly_their_recording() -> None:
    starts = encounters_of_seed(scenario("maneuvering", PAPER), 2, 0, 6)
    plain, paths = fly_recorded(starts, simulate.Unmitigated(PAPER), PAPER)
    # What was flown, flown again as a recording, up to where an encounter ended.
    fields = [np.where(np.isnan(field), 0.0, field) for field in paths.intruders]
    recording = KnownFlight(*(np.moveaxis(field, 0, -1) for field in fields))
    replayed: Any = recording
    again = simulate.fly(starts._replace(intent=replayed), simulate.Unmitigated(PAPER), PAPER)
    for field in simulate.Flights._fields:
        np.testing.assert_array_equal(getattr(again, field), getattr(plain, field), err_msg=field)


@pytest.mark.slow
def test_the_command_and_its_files(
    policy_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    arguments = [
        "--policy",
        str(policy_path),
        "--baseline",
        "mvp",
        "--encounters",
        "40",
        "--set",
        "resamples=200",
    ]
    assert compare.main([*arguments, "--out", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        ".lock",
        "compare.png",
        "compare.svg",
        "config.yaml",
        "encounters.parquet",
        "summary.json",
    ]
    summary = json.loads((out / "summary.json").read_text())
    names = [row["name"] for row in summary["entries"]]
    # The flight without a resolver comes along: ratios need it.
    assert names == ["policy", "mvp", "none"]
    table = pq.read_table(out / "encounters.parquet").to_pydict()
    reached = {name: np.array(table[f"{name}.outcome"]) == "reached" for name in names}
    possible = 40 - sum(table["policy.unresolvable"])
    for row in summary["entries"]:
        count = int(reached[row["name"]].sum())
        assert row["success_rate"]["count"] == count
        assert row["success_given_resolvable"]["total"] == possible
        rates = [row[f"{kind}_rate"]["count"] for kind in ("success", "violation", "timeout")]
        assert sum(rates) == 40
        parts = row["risk_ratio"]
        assert parts["value"] == pytest.approx(parts["unresolved"] + parts["induced"])
        if row["name"] != "policy":
            counted = pairs(reached["policy"], reached[row["name"]])
            assert row["difference"]["value"] == tango(counted).value
            assert row["difference"]["mcnemar_exact_p"] == mcnemar_exact(counted)
    assert summary["entries"][0]["difference"] is None
    assert summary["entries"][2]["risk_ratio"]["value"] == 1.0
    assert "risk ratio" in capsys.readouterr().out
    again = tmp_path / "again"
    compare.main(["--config", str(out / "config.yaml"), "--out", str(again)])
    for name in ("encounters.parquet", "compare.svg", "config.yaml"):
        assert (again / name).read_bytes() == (out / name).read_bytes()


@pytest.mark.slow
def test_an_interrupted_comparison_goes_on_from_its_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--baseline", "mvp", "--encounters", "30", "--workers", "1"]
    arguments += ["--set", "resamples=100", "--set", "chunk=10"]
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert compare.main([*arguments, "--out", str(whole)]) == 0
    flown: list[int] = []

    def stop_in_the_second(compared: Comparison, first: int, count: int) -> dict[str, np.ndarray]:
        if first == 10:
            signal.raise_signal(signal.SIGINT)
        flown.append(first)
        return comparison.columns(compared, first, count)

    command = compare._COMMAND._replace(columns=stop_in_the_second)
    monkeypatch.setattr(compare, "_COMMAND", command)
    assert compare.main([*arguments, "--out", str(out)]) == 130
    assert f"Go on with: python -m eval.compare --resume --out {out}" in capfd.readouterr().err
    with pytest.raises(ConfigError, match="--resume: seed is 1, expected 0"):
        compare.main(["--resume", "--seed", "1", "--out", str(out)])
    monkeypatch.setattr(compare, "versions", lambda *_: {"rlcas-toolkit": "0"})
    monkeypatch.setattr(outputs, "versions", lambda *_: {"rlcas-toolkit": "0", "numpy": "1"})
    with pytest.raises(ConfigError, match="was made with other versions"):
        compare.main(["--resume", "--out", str(out)])
    monkeypatch.undo()
    monkeypatch.setattr(compare, "_COMMAND", command)
    assert compare.main(["--resume", "--out", str(out)]) == 0
    assert flown == [0, 10, 20]
    for name in ("encounters.parquet", "compare.svg", "config.yaml"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()
    assert {path.name for path in out.iterdir()} == {path.name for path in whole.iterdir()}


@pytest.mark.slow
def test_a_comparison_does_not_depend_on_its_workers(tmp_path: Path) -> None:
    arguments = ["--mode", "plan", "--baseline", "rules", "--encounters", "12"]
    arguments += ["--set", "resamples=100", "--set", "chunk=5"]
    for workers in ("1", "2"):
        out = str(tmp_path / workers)
        assert compare.main([*arguments, "--workers", workers, "--out", out]) == 0
    for name in ("encounters.parquet", "compare.svg"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_a_file_of_encounters_and_a_single_one(tmp_path: Path) -> None:
    encounter_file.write(
        tmp_path / "own.csv",
        encounters_of_seed(scenario("multi", PAPER, intruders=(2, 4)), 1, 0, 3),
    )
    out = tmp_path / "run"
    assert (
        compare.main(
            [
                "--scenario",
                f"file:{tmp_path / 'own.csv'}",
                "--baseline",
                "rules",
                *SMALL,
                "--out",
                str(out),
            ]
        )
        == 0
    )
    summary = json.loads((out / "summary.json").read_text())
    assert summary["encounters"] == 3
    assert math.isfinite(summary["entries"][0]["heading_reversals_mean"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["circle", "noisy"])
def test_plans_and_the_assured_loop_fly_as_in_the_evaluation(name: str) -> None:
    entries = policy_entries(None, "ours", PAPER, modes("plan", "assured"))
    evaluation = Evaluation(None, scenario(name, PAPER), None, 4, PAPER, "assured")
    ours = comparison.columns(
        Comparison((*entries, baseline_entry("none", PAPER)), evaluation), 20, 25
    )
    theirs = chunks.columns(ReadyEvaluation.load(evaluation), 20, 25)
    for mode, columns in (("assured", ""), ("plan", "plan_")):
        np.testing.assert_array_equal(ours[f"ours, {mode}.outcome"], theirs[f"{columns}outcome"])
    reached = theirs["outcome"] == "reached"
    assert reached.sum() > 15
    np.testing.assert_array_equal(
        ours["ours, assured.path_excess"][reached], theirs["path_excess"][reached]
    )
    np.testing.assert_array_equal(
        ours["ours, assured.min_separation_m"][reached], theirs["min_separation_m"][reached]
    )
    as_validated = chunks.columns(ReadyEvaluation.load(evaluation._replace(mode="plan")), 20, 25)[
        "plan_min_separation_m"
    ]
    np.testing.assert_array_equal(theirs["plan_min_separation_m"], as_validated)


@pytest.mark.slow
def test_what_only_wider_limits_solve_is_resolvable_for_them_alone() -> None:
    # Proven lost at 3 deg/s; at the vehicle's 5 deg/s the search knows a flight.
    near = scenario("circle", PAPER, min_initial_separation=1300.0, radius=(3000.0, 3300.0))
    only_wider = take(encounters_of_seed(near, 0, 87, 1), slice(0, 1))
    solved = [Flown(PAPER.vehicle_limits, np.ones(1, bool))]
    for flown in ([], solved):
        narrow, wide = (
            verdict_within(only_wider, PAPER, limits, flown).verdict.tolist()
            for limits in (PAPER.limits, PAPER.vehicle_limits)
        )
        assert (narrow, wide) == ([Verdict.UNRESOLVABLE], [Verdict.RESOLVABLE])

    evaluation = Evaluation(None, only_wider, None, 0, PAPER)
    entries = (*policy_entries(None, "ours", PAPER, modes("plan")), baseline_entry("none", PAPER))
    table = comparison.columns(Comparison(entries, evaluation), 0, 1)
    lost = {name: bool(table[f"{name}.unresolvable"][0]) for name in ("ours", "ours, plan", "none")}
    assert lost == {"ours": True, "ours, plan": False, "none": True}
    planned = chunks.columns(ReadyEvaluation.load(evaluation._replace(mode="plan")), 0, 1)
    assert planned["verdict"].tolist() == ["resolvable"]
    assert planned["policy_verdict"].tolist() == ["unresolvable"]
    assert rates_of(planned)["policy_success_given_resolvable"][1].sum() == 0


def test_a_request_without_any_trajectory_is_a_time_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def hopeless(*arguments: Any, **more: Any) -> Any:
        plans = plan_really(*arguments, **more)
        candidates = plans.candidates._replace(
            last=np.full_like(plans.candidates.last, -1), findings=Findings.empty(len(plans.source))
        )
        return plans._replace(candidates=candidates)

    plan_really = recorded_flights.plan_at_start
    monkeypatch.setattr(recorded_flights, "plan_at_start", hopeless)
    entries = policy_entries(None, "ours", PAPER, modes("plan"))
    evaluation = Evaluation(None, scenario("circle", PAPER), None, 4, PAPER)
    table = comparison.columns(
        Comparison((*entries, baseline_entry("none", PAPER)), evaluation), 0, 3
    )
    assert set(table["ours, plan.outcome"]) == {"timeout"}
    assert np.isnan(table["ours, plan.min_separation_m"]).all()
    assert not table["ours, plan.lost_do365_terminal"].any()


def test_numbers_of_a_scenario_can_be_changed(tmp_path: Path) -> None:
    changes = "changes={own_speed: [60, 61], radius: [9000, 9100]}"
    arguments = [
        "--baseline",
        "none",
        "--encounters",
        "30",
        *SMALL,
        "--set",
        changes,
    ]
    compare.main([*arguments, "--out", str(tmp_path / "run")])
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["changes"] == {"own_speed": [60, 61], "radius": [9000, 9100]}
    assert (
        summary["entries"][0]["resolvable_rate"]["value"] == 1.0
    )  # nine kilometres leave room for all


def test_recorded_encounters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = recorded_path("lincoln_lab/encounters.json")
    out = tmp_path / "run"
    arguments = ["--scenario", f"tracks:{path}", *SMALL]
    compare.main([*arguments, "--baseline", "mvp_speed", "--out", str(out)])
    summary = json.loads((out / "summary.json").read_text())
    assert summary["encounters"] + len(summary["left_out"]) == 50
    assert summary["entries"][0]["resolvable_rate"]["total"] == summary["encounters"]
    assert not any(summary["repairs"].values())
    rates = {row["name"]: row["success_rate"]["value"] for row in summary["entries"]}
    assert rates["none"] < 0.5
    assert rates["mvp_speed"] > 0.8
    assert "left out: 7: the ownship begins with" in capsys.readouterr().err
    three_run = tmp_path / "few"
    compare.main([*arguments, "--baseline", "none", "--encounters", "3", "--out", str(three_run)])
    assert json.loads((three_run / "summary.json").read_text())["encounters"] == 3


@pytest.mark.parametrize(
    ("arguments", "kind", "sentence"),
    [
        (
            ["--baseline", "mpv"],
            ConfigError,
            "--baseline: 'mpv'; expected one of none, rules, mvp, mvp_speed",
        ),
        (["--encounters", "0"], ConfigError, "--encounters: '0'; expected"),
        (["--encounters", "many"], ConfigError, "--encounters: 'many'; expected"),
        (["--mode", "policy"], ConfigError, "--mode: invalid choice: 'policy'"),
        (
            ["--scenario", "multi", "--set", "changes.intruders=[2,64]"],
            OutsideDomainError,
            "there are 64 intruders",
        ),
        (["--set", "changes.own_sped=[50,70]"], ConfigError, "changes.own_sped is unknown"),
        (
            ["--set", "changes.radius=1", "--scenario", "file:a.csv"],
            ConfigError,
            "radius cannot be changed",
        ),
        (["--set", "mode=plan"], ConfigError, "mode is unknown (its value is 'plan')"),
        (["--set", "confidence=nan"], ConfigError, "confidence is 'nan'; expected"),
        (["--scenario", "circel"], ConfigError, "--scenario: 'circel' is unknown"),
        (["--scenario", "file:absent.csv"], EncounterError, "absent.csv: there is no such file"),
        (["--scenario", "tracks:absent.daa"], TrackError, "absent.daa: there is no such file"),
        (
            ["--scenario", "tracks:absent.txt"],
            TrackError,
            "absent.txt ends in '.txt'; expected .json",
        ),
        (["--repair"], ConfigError, "tracks.repair is True for the scenario 'circle'; expected it"),
        (["--set", "tracks.ahead=60"], ConfigError, "tracks.ahead is 60.0 for the scenario"),
        (["--scenario", "lincoln:absent.txt"], EncounterError, "absent.txt: there is no such file"),
        (["--policy", "absent.nnet"], NnetError, "absent.nnet: there is no such file"),
        (["--policy", "mvp.nnet"], NnetError, "mvp.nnet: there is no such file"),
        (["--policy", "a.nnet", "--policy", "a.nnet"], ConfigError, "a file stands twice"),
        (["--policy-sha256", "0" * 64], ConfigError, "expected 000"),
        (
            ["--policy-sha256", "0" * 64] * 2,
            ConfigError,
            "given 2 times; expected once for each of 1 policies",
        ),
        (["--policy", "a.nnet", "--policy-sha256", "0" * 64], ConfigError, "each of 0 policies"),
    ],
)
def test_bad_input_is_one_sentence(
    tmp_path: Path, arguments: list[str], kind: type, sentence: str
) -> None:
    with pytest.raises(kind) as raised:
        compare.main([*arguments, "--out", str(tmp_path / "run")])
    assert sentence in str(raised.value)
    assert isinstance(raised.value, InputError), "ends the program with 2"
    assert not (tmp_path / "run").exists()


def test_baselines_of_two_modules_have_different_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    code = "from agents.baselines.baselines import BASELINES\nmine = BASELINES['mvp']\n"
    for module in ("of_one_user", "of_another_user"):
        (tmp_path / f"{module}.py").write_text(code)
    names = "of_one_user:mine", "of_another_user:mine"
    entries = comparison.entries_of([], comparison.Modes(), names[:1], PAPER)
    assert [entry.name for entry in entries] == ["policy", "mine", REFERENCE]
    with pytest.raises(ConfigError, match="'of_another_user:mine' is called mine, as another"):
        comparison.entries_of([], comparison.Modes(), names, PAPER)


def test_policies_have_names_unlike_each_other_and_baselines() -> None:
    names = (
        "mvp.safetensors",
        "witness.safetensors",
        "one/policy.safetensors",
        "two/policy.safetensors",
        "c.nnet",
    )
    assert comparison.policy_names([Path(name) for name in names]) == [*names[:4], "c"]


def test_the_aircraft_is_the_policies_and_one(tmp_path: Path, policy_path: Path) -> None:
    slower = policy_file.read(policy_path)
    limits = {**slower.metadata["limits"], "speed_max": 90.0}
    slower_policy = tmp_path / "other.safetensors"
    policy_file.write(
        slower_policy, replace(slower, metadata={**slower.metadata, "limits": limits})
    )
    with pytest.raises(ConfigError, match=r"--policy: .*other\.safetensors"):
        compare.main(
            [
                "--policy",
                str(policy_path),
                "--policy",
                str(slower_policy),
                "--out",
                str(tmp_path / "run"),
            ]
        )


# The witness takes part in a comparison as a flight that is really flown, with the intruders as
# they truly fly.


SHORT = {"radius": (3_000.0, 3_600.0)}
QUICK = PAPER._replace(t_max=150.0)
FEW = WitnessSearch(rounds=1)
"""Enough for the properties, not for the best cost."""


@pytest.fixture(scope="module")
def starts() -> Encounter:
    """Straight and turning intruders, and two starts that nothing can save, 0.9 km apart: 10."""
    plain, turning = (
        encounters_of_seed(scenario(name, PAPER, **SHORT), 3, 0, 4)
        for name in ("circle", "maneuvering")
    )
    lost = take(plain, [1, 2])
    beside = lost.own.x[:, None] + 900.0
    lost = lost._replace(intruders=lost.intruders._replace(x=beside, y=lost.own.y[:, None]))
    return join(take(join(lost, plain), [2, 0, 3, 4, 5, 1]), turning)


@pytest.fixture(scope="module")
def best(starts: Encounter) -> Escapes:
    return least_cost(starts, QUICK.rules(), SURROGATE, rounds=FEW.rounds)


@pytest.fixture(scope="module")
def flown(starts: Encounter) -> Any:
    return fly_witnesses(starts, FEW, QUICK)


def comparison_of(source: Any, *names: str, search: WitnessSearch = FEW) -> Comparison:
    entries = tuple(baseline_entry(name, QUICK) for name in names)
    return Comparison(
        (*entries, Entry(WITNESS, WITNESS, search)), Evaluation(None, source, None, 4, QUICK)
    )


@pytest.mark.slow
def test_what_is_flown_is_the_witness(starts: Encounter, best: Escapes, flown: Any) -> None:
    flights, paths = flown
    resolved = np.flatnonzero(np.isfinite(best.arrival))
    assert resolved.size >= 7
    for row in resolved:
        alone = replay(take(starts, row), take(best.manoeuvre, row), QUICK.rules(), SURROGATE)
        end = len(alone.time)
        for field, field_alone in zip(paths.own, alone.own, strict=True):
            np.testing.assert_array_equal(field[:end, row], field_alone)
            assert np.isnan(field[end:, row]).all()
        np.testing.assert_array_equal(paths.separation[: end - 1, row], alone.separation)
    assert (flights.outcome[resolved] == OUTCOMES.index("reached")).all()
    np.testing.assert_array_equal(flights.duration[resolved], best.arrival[resolved])
    np.testing.assert_array_equal(flights.min_separation[resolved], best.separation[resolved])
    assert flights.min_separation[resolved].min() >= QUICK.separation
    # The whole last step counts for a flight, for a witness what lies before the goal's circle.
    beyond = flights.path_length[resolved] - best.path[resolved]
    assert (beyond >= -1e-6).all()
    assert (beyond <= SURROGATE.speed_max).all()


def test_without_a_witness_the_flight_is_that_of_none(
    starts: Encounter, best: Escapes, flown: Any
) -> None:
    lost = np.flatnonzero(np.isnan(best.arrival))
    assert {1, 5} <= set(lost)
    none = baseline_entry(REFERENCE, QUICK).resolver
    straight, straight_paths = fly_recorded(take(starts, lost), none, QUICK, endless=True)
    flights, paths = flown
    for field, ours, theirs in zip(flights._fields, flights, straight, strict=True):
        np.testing.assert_array_equal(ours[lost], theirs, err_msg=field)
    np.testing.assert_array_equal(
        paths.intruders.x[: len(straight_paths.intruders.x), lost], straight_paths.intruders.x
    )
    assert np.isnan(paths.own.x[len(straight_paths.own.x) :, lost]).all()


@pytest.mark.slow
def test_a_batch_without_any_witness_flies_too(starts: Encounter, flown: Any) -> None:
    flights, paths = fly_witnesses(take(starts, [1]), FEW, QUICK)
    assert flights.min_separation[0] == flown[0].min_separation[1]
    np.testing.assert_array_equal(paths.own.x[:, 0], flown[1].own.x[: len(paths.own.x), 1])


@pytest.mark.slow
def test_a_witness_row_does_not_depend_on_its_company() -> None:
    compared = comparison_of(
        scenario("multi", PAPER, intruders=(2, 3), radius=(3_000.0, 4_000.0)), REFERENCE
    )
    together, apart = comparison.columns(compared, 0, 6), comparison.columns(compared, 4, 1)
    for name, values in apart.items():
        np.testing.assert_array_equal(values, together[name][4:5], err_msg=name)


@pytest.mark.slow
def test_the_witness_hears_no_noise() -> None:
    loud = scenario("noisy", PAPER, **SHORT)
    noiseless = scenario("noisy", PAPER, **SHORT, position_std=0.0, velocity_std=0.0)
    table, quiet = (
        comparison.columns(comparison_of(source, "mvp", REFERENCE), 0, 5)
        for source in (loud, noiseless)
    )
    assert (table["mvp.path_excess"] != quiet["mvp.path_excess"]).any()
    for name in (name for name in table if name.startswith("witness.")):
        np.testing.assert_array_equal(table[name], quiet[name], err_msg=name)


def test_a_recorded_intruder_is_known_to_its_end(starts: Encounter, flown: Any) -> None:
    turning = take(starts, slice(6, 10))
    states = tracks(turning, steps(QUICK.rules()), QUICK.rules())
    recording: Any = KnownFlight(*(np.moveaxis(field, 0, -1) for field in states))
    again, paths = fly_witnesses(turning._replace(intent=recording), FEW, QUICK)
    for ours, theirs in zip(flown[0], again, strict=True):
        np.testing.assert_array_equal(ours[6:], theirs)
    np.testing.assert_array_equal(
        flown[1].separation[: len(paths.separation), 6:], paths.separation
    )


def test_a_manoeuvre_is_not_stopped_by_a_loss(starts: Encounter, best: Escapes) -> None:
    # An escape of one encounter, flown in another, where it saves nothing.
    wrong = take(best.manoeuvre, np.full(2, np.flatnonzero(np.isfinite(best.arrival))[0]))
    lost = take(starts, [1, 5])
    flights = simulate.fly(lost, Witness(lost, wrong, np.ones(2, bool), QUICK), QUICK, endless=True)
    assert (flights.min_separation < QUICK.separation).all()
    assert (flights.duration > flights.time_of_min_separation).all()
    assert flights.duration.min() > 30.0


@pytest.mark.slow
def test_the_command_says_how_much_longer_than_the_witness(
    tmp_path: Path, policy_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--policy", str(policy_path), "--encounters", "8", "--set", "resamples=100"]
    compare.main(
        [
            *arguments,
            "--baseline",
            "mvp_speed",
            "--baseline",
            "witness",
            "--out",
            str(tmp_path / "run"),
        ]
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    rows = {row["name"]: row for row in summary["entries"]}
    # Those asked for, and the flight without a resolver.
    assert list(rows) == ["policy", "mvp_speed", "witness", "none"]
    assert rows["witness"]["kind"] == "witness"
    assert rows["witness"]["path_excess_over_witness_mean"] is None
    columns = pq.read_table(tmp_path / "run" / "encounters.parquet").to_pydict()
    table = {name: np.array(values) for name, values in columns.items()}
    reached_by_both = (table["mvp_speed.outcome"] == "reached") & (
        table["witness.outcome"] == "reached"
    )
    assert reached_by_both.sum() > 5
    longer = (
        table["mvp_speed.path_excess"][reached_by_both]
        - table["witness.path_excess"][reached_by_both]
    )
    recounted = rows["mvp_speed"]["path_excess_over_witness_mean"]
    assert recounted["value"] == pytest.approx(longer.mean())
    assert recounted["low"] <= recounted["value"] <= recounted["high"]
    # What the witness has solved is resolvable, whatever the search would say.
    assert not table["witness.unresolvable"][table["witness.outcome"] == "reached"].any()
    assert "over witness" in capsys.readouterr().out

    compare.main([*arguments, "--baseline", "none", "--out", str(tmp_path / "plain")])
    plain = json.loads((tmp_path / "plain" / "summary.json").read_text())
    assert all("path_excess_over_witness_mean" not in row for row in plain["entries"])
    assert "witness" not in capsys.readouterr().out


def test_a_misspelt_witness_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"--baseline: 'witnes'; expected one of .*witness, or module:name of your own; did you mean witness\?",
    ):
        compare.main(["--baseline", "witnes", "--out", str(tmp_path / "run")])


@pytest.mark.slow
def test_recorded_tracks(tmp_path: Path) -> None:
    path = recorded_path("lincoln_lab/encounters.json")
    compare.main(
        ["--scenario", f"tracks:{path}", "--baseline", "witness", "--out", str(tmp_path / "run")]
    )
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    rates = {row["name"]: row["success_rate"]["value"] for row in summary["entries"]}
    assert rates["witness"] == summary["entries"][0]["resolvable_rate"]["value"]
    assert rates["witness"] >= rates["policy"] > rates["none"]
