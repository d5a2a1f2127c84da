"""The witness takes part in a comparison as a flight that is really flown, with the intruders as they truly fly."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.baselines.baselines import BASELINES
from agents.config.load import ConfigError
from agents.manoeuvres.escape_manoeuvre import steps, tracks
from agents.resolvability.classify import Witnesses, least_cost, replay
from envs.aircraft import PAPER
from envs.encounters import Encounter, scenario
from envs.intruder import Recording
from envs.kinematics import SURROGATE
from envs.starts import joined, numbered
from envs.trees import take
from eval.compare import deciders as comparison
from eval.compare import run as compare
from eval.compare.deciders import REFERENCE, WITNESS, Comparison, Entry, baseline_entry
from eval.flights.chunks import Evaluation
from eval.flights.optimal import WitnessSearch, ended, fly_witnesses, followed
from eval.flights.simulate import OUTCOMES
from tests.support import fly_recorded, recorded

SHORT = {"radius": (3_000.0, 3_600.0)}
QUICK = PAPER._replace(t_max=150.0)
FEW = WitnessSearch(rounds=1)
"""Enough for the properties, not for the best cost."""


@pytest.fixture(scope="module")
def starts() -> Encounter:
    """Straight and turning intruders, and two starts that nothing can save, 0.9 km apart: 10."""
    plain, turning = (numbered(scenario(name, PAPER, **SHORT), 3, 0, 4) for name in ("circle", "maneuvering"))
    lost = take(plain, [1, 2])
    beside = lost.own.x[:, None] + 900.0
    lost = lost._replace(intruders=lost.intruders._replace(x=beside, y=lost.own.y[:, None]))
    return joined(take(joined(lost, plain), [2, 0, 3, 4, 5, 1]), turning)


@pytest.fixture(scope="module")
def best(starts: Encounter) -> Witnesses:
    return least_cost(starts, QUICK.rules(), SURROGATE, rounds=FEW.rounds)


@pytest.fixture(scope="module")
def flown(starts: Encounter) -> Any:
    return fly_witnesses(starts, FEW, QUICK)


def comparison_of(source: Any, *names: str, search: WitnessSearch = FEW) -> Comparison:
    entries = tuple(baseline_entry(name, QUICK) for name in names)
    return Comparison((*entries, Entry(WITNESS, WITNESS, search)), Evaluation(None, source, None, 4, QUICK))


def test_what_is_flown_is_the_witness(starts: Encounter, best: Witnesses, flown: Any) -> None:
    flights, paths = flown
    known = np.flatnonzero(np.isfinite(best.arrival))
    assert known.size >= 7
    for row in known:
        alone = replay(take(starts, row), take(best.manoeuvre, row), QUICK.rules(), SURROGATE)
        end = len(alone.time)
        for here, there in zip(paths.own, alone.own, strict=True):
            np.testing.assert_array_equal(here[:end, row], there)
            assert np.isnan(here[end:, row]).all()
        np.testing.assert_array_equal(paths.separation[: end - 1, row], alone.separation)
    assert (flights.outcome[known] == OUTCOMES.index("reached")).all()
    np.testing.assert_array_equal(flights.duration[known], best.arrival[known])
    np.testing.assert_array_equal(flights.min_separation[known], best.separation[known])
    assert flights.min_separation[known].min() >= QUICK.separation
    # The whole last step counts for a flight, for a witness what lies before the goal's circle.
    beyond = flights.path_length[known] - best.path[known]
    assert (beyond >= -1e-6).all()
    assert (beyond <= SURROGATE.speed_max).all()


def test_without_a_witness_the_flight_is_that_of_none(starts: Encounter, best: Witnesses, flown: Any) -> None:
    lost = np.flatnonzero(np.isnan(best.arrival))
    assert {1, 5} <= set(lost)
    none = baseline_entry(REFERENCE, QUICK).decider
    straight, seen = fly_recorded(take(starts, lost), none, QUICK, endless=True)
    flights, paths = flown
    for field, ours, theirs in zip(flights._fields, flights, straight, strict=True):
        np.testing.assert_array_equal(ours[lost], theirs, err_msg=field)
    np.testing.assert_array_equal(paths.intruders.x[: len(seen.intruders.x), lost], seen.intruders.x)
    assert np.isnan(paths.own.x[len(seen.own.x) :, lost]).all()


def test_a_batch_without_any_witness_flies_too(starts: Encounter, flown: Any) -> None:
    flights, paths = fly_witnesses(take(starts, [1]), FEW, QUICK)
    assert flights.min_separation[0] == flown[0].min_separation[1]
    np.testing.assert_array_equal(paths.own.x[:, 0], flown[1].own.x[: len(paths.own.x), 1])


@pytest.mark.parametrize("name", ["circle", "multi"])
def test_ended_counts_as_the_simulation_does(name: str) -> None:
    starts = numbered(scenario(name, PAPER, **SHORT), 5, 0, 40)
    aircraft = PAPER._replace(t_max=100.0)
    decider = BASELINES["mvp_speed"](PAPER)
    counted, paths = fly_recorded(starts, decider, aircraft, endless=True)
    recounted = ended(starts, paths, aircraft)
    assert 0 < (recounted.outcome == OUTCOMES.index("reached")).sum() < 40
    assert recounted.reversals.max() > 0
    for field, ours, theirs in zip(recounted._fields, recounted, counted, strict=True):
        np.testing.assert_array_equal(ours, theirs, err_msg=field)
        assert ours.dtype == theirs.dtype


def test_a_row_does_not_depend_on_its_company() -> None:
    made = comparison_of(scenario("multi", PAPER, intruders=(2, 3), radius=(3_000.0, 4_000.0)), REFERENCE)
    together, apart = comparison.columns(made, 0, 6), comparison.columns(made, 4, 1)
    for name, values in apart.items():
        np.testing.assert_array_equal(values, together[name][4:5], err_msg=name)


def test_the_witness_hears_no_noise() -> None:
    loud = scenario("noisy", PAPER, **SHORT)
    still = scenario("noisy", PAPER, **SHORT, position_std=0.0, velocity_std=0.0)
    table, quiet = (comparison.columns(comparison_of(source, "mvp", REFERENCE), 0, 5) for source in (loud, still))
    assert (table["mvp.path_excess"] != quiet["mvp.path_excess"]).any()
    for name in (name for name in table if name.startswith("witness.")):
        np.testing.assert_array_equal(table[name], quiet[name], err_msg=name)


def test_a_recorded_intruder_is_known_to_its_end(starts: Encounter, flown: Any) -> None:
    turning = take(starts, slice(6, 10))
    states = tracks(turning, steps(QUICK.rules()), QUICK.rules())
    recording: Any = Recording(*(np.moveaxis(field, 0, -1) for field in states))
    again, paths = fly_witnesses(turning._replace(intent=recording), FEW, QUICK)
    for ours, theirs in zip(flown[0], again, strict=True):
        np.testing.assert_array_equal(ours[6:], theirs)
    np.testing.assert_array_equal(flown[1].separation[: len(paths.separation), 6:], paths.separation)


def test_a_manoeuvre_is_not_stopped_by_a_loss(starts: Encounter, best: Witnesses) -> None:
    # An escape of one encounter, flown in another, where it saves nothing.
    wrong = take(best.manoeuvre, np.full(2, np.flatnonzero(np.isfinite(best.arrival))[0]))
    paths = followed(take(starts, [1, 5]), wrong, QUICK)
    flights = ended(take(starts, [1, 5]), paths, QUICK)
    assert (flights.min_separation < QUICK.separation).all()
    assert (flights.duration > flights.time_of_min_separation).all()
    assert len(paths.own.x) > 30


def test_the_command_says_how_much_longer_than_the_witness(
    tmp_path: Path, policy_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--policy", str(policy_path), "--encounters", "8", "--set", "resamples=100"]
    compare.main([*arguments, "--baseline", "mvp_speed", "--baseline", "witness", "--out", str(tmp_path / "run")])
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    rows = {row["name"]: row for row in summary["entries"]}
    # Those asked for, and the flight without a resolver.
    assert list(rows) == ["policy", "mvp_speed", "witness", "none"]
    assert rows["witness"]["kind"] == "witness"
    assert rows["witness"]["path_excess_over_witness_mean"] is None
    columns = pq.read_table(tmp_path / "run" / "encounters.parquet").to_pydict()
    table = {name: np.array(values) for name, values in columns.items()}
    both = (table["mvp_speed.outcome"] == "reached") & (table["witness.outcome"] == "reached")
    assert both.sum() > 5
    longer = table["mvp_speed.path_excess"][both] - table["witness.path_excess"][both]
    recounted = rows["mvp_speed"]["path_excess_over_witness_mean"]
    assert recounted["value"] == pytest.approx(longer.mean())
    assert recounted["low"] <= recounted["value"] <= recounted["high"]
    # What the witness has solved is resolvable, whatever the search would say.
    assert not table["unresolvable"][table["witness.outcome"] == "reached"].any()
    assert "over witness" in capsys.readouterr().out

    compare.main([*arguments, "--baseline", "none", "--out", str(tmp_path / "plain")])
    plain = json.loads((tmp_path / "plain" / "summary.json").read_text())
    assert all("path_excess_over_witness_mean" not in row for row in plain["entries"])
    assert "witness" not in capsys.readouterr().out


def test_a_misspelt_witness_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--baseline: 'witnes'; expected one of .*witness; did you mean witness\?"):
        compare.main(["--baseline", "witnes", "--out", str(tmp_path / "run")])


@pytest.mark.slow
def test_recorded_tracks(tmp_path: Path) -> None:
    path = recorded("lincoln_lab/encounters.json")
    compare.main(["--scenario", f"tracks:{path}", "--baseline", "witness", "--out", str(tmp_path / "run")])
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    rates = {row["name"]: row["success_rate"]["value"] for row in summary["entries"]}
    assert rates["witness"] == summary["resolvable_rate"]["value"]
    assert rates["witness"] >= rates["policy"] > rates["none"]
