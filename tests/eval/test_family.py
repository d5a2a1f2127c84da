"""A family of aircraft: drawn by number, judged as an evaluation is, flying alike where ratios are."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.config.load import load
from agents.config.world import AircraftConfig
from agents.policy.inference import OutsideDomainError, Policy
from commands.command import InputError
from envs.aircraft import PAPER, Aircraft, Ratios, new_aircraft, ratios
from envs.kinematics import Limits
from envs.scenarios import scenario
from eval.family import run as family
from eval.family.aircraft import FAMILY, draw_aircraft
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.monte_carlo import run as monte_carlo
from eval.runner.command import UnfinishedError


@pytest.mark.parametrize("seed", [0, 7])
def test_aircraft_follow_from_their_numbers_and_fill_the_family(seed: int) -> None:
    aircraft = [draw_aircraft(seed, number) for number in range(200)]
    assert aircraft[11] == draw_aircraft(seed, 11)
    assert aircraft[:20] != [draw_aircraft(seed + 1, number) for number in range(20)]
    unlike = np.array([ratios(drawn.limits(), drawn.separation_m) for drawn in aircraft])
    for values, name in zip(np.abs(unlike.T), Ratios._fields, strict=True):
        low, high = FAMILY[name]
        assert values.min() >= 0.999 * low
        assert values.max() <= 1.001 * high
        assert values.max() - values.min() > 0.9 * (high - low)


def scale_aircraft(aircraft: Aircraft, length: float, speed: float) -> Aircraft:
    """Return an aircraft of the same ratios whose lengths and speeds are so many times as large."""
    limits, time = aircraft.limits, length / speed
    unit = speed / time
    return new_aircraft(
        Limits(
            limits.speed_min * speed,
            limits.speed_max * speed,
            limits.acceleration_min * unit,
            limits.acceleration_max * unit,
            limits.yaw_rate_max / time,
        ),
        aircraft.separation * length,
        dt=aircraft.dt * time,
        t_max=aircraft.t_max * time,
    )


@pytest.mark.parametrize(
    ("name", "length", "speed", "tolerance"),
    [
        pytest.param("circle", 9.26, 2.3, 1e-3, marks=pytest.mark.slow),
        pytest.param("noisy", 0.5, 0.25, 1e-6, marks=pytest.mark.slow),
        pytest.param("multi", 0.5, 0.25, 1e-6, marks=pytest.mark.slow),
        # A turning intruder steers to a point 10 000 km away, whatever the aircraft.
        ("maneuvering", 0.5, 0.25, 1e-2),
    ],
)
def test_aircraft_of_the_same_ratios_fly_the_same_flights(
    name: str, length: float, speed: float, tolerance: float
) -> None:
    policy, tables = Policy.load(), []
    for aircraft in (PAPER, scale_aircraft(PAPER, length, speed)):
        source = (
            replace(scenario(name, aircraft), intruders=(2, 3))
            if name == "multi"
            else scenario(name, aircraft)
        )
        tables.append(
            columns(ReadyEvaluation(Evaluation(None, source, None, 3, aircraft), policy), 0, 16)
        )
    ours, theirs = tables
    for column in ("outcome", "baseline_outcome", "verdict", "heading_reversals", "intruders"):
        np.testing.assert_array_equal(ours[column], theirs[column], err_msg=column)
    units = {"min_separation_m": length, "path_length_m": length, "duration_s": length / speed}
    for column, unit in units.items():
        np.testing.assert_allclose(
            ours[column] * unit, theirs[column], rtol=tolerance, err_msg=column
        )


@pytest.mark.slow
def test_a_family_is_judged_and_its_aircraft_can_be_flown_again(tmp_path: Path) -> None:
    out = tmp_path / "family"
    arguments = [
        "--count",
        "2",
        "--encounters",
        "12",
        "--aircraft-seed",
        "4",
        "--seed",
        "2",
        "--workers",
        "1",
    ]
    assert family.main([*arguments, "--allow-outside-domain", "--out", str(out)]) == 0
    results = json.loads((out / "family.json").read_text(encoding="utf-8"))
    rates = [row["success_rate"] for row in results["rows"]]
    assert results["success_rate"]["count"] == sum(rate["count"] for rate in rates)
    assert results["success_rate"]["mean"] == pytest.approx(
        np.mean([rate["value"] for rate in rates])
    )
    assert results["success_rate"]["worst"]["value"] == min(rate["value"] for rate in rates)
    path = out / "aircraft_01.yaml"
    assert load(AircraftConfig, path) == draw_aircraft(4, 1)
    fast = draw_aircraft(4, 1).speed_max_mps
    again = [
        "--aircraft",
        str(path),
        "--allow-outside-domain",
        "--encounters",
        "12",
        "--seed",
        "2",
        "--workers",
        "1",
    ]
    traffic = f"changes={{intruder_speed: [{0.4 * fast}, {1.3 * fast}], attempts: 200}}"
    run = tmp_path / "again"
    more = ["--set", traffic, "--set", "resamples=100", "--set", "figures=false", "--out", str(run)]
    assert monte_carlo.main([*again, *more]) == 0
    reached = pq.read_table(run / "encounters.parquet")["outcome"].to_pylist().count("reached")
    assert reached == rates[1]["count"]


def read_family(folder: Path) -> dict[str, Any]:
    results = json.loads((folder / "family.json").read_text(encoding="utf-8"))
    del results["out"]
    return results


@pytest.mark.slow
def test_the_configuration_of_a_family_repeats_it_and_an_interrupted_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, again = tmp_path / "family", tmp_path / "again"
    arguments = ["--count", "2", "--encounters", "8", "--intruders", "1", "2", "--workers", "1"]
    arguments += ["--confidence", "0.9", "--turning", "--allow-outside-domain"]
    evaluate = family.evaluate

    def fly_the_first(keys: Any, folder: Path, **more: Any) -> Any:
        if folder.name == "aircraft_01":
            raise UnfinishedError("interrupted; finished chunks are kept. ", 130)
        return evaluate(keys, folder, **more)

    monkeypatch.setattr(family, "evaluate", fly_the_first)
    assert family.main([*arguments, "--out", str(out)]) == 130
    assert f"Go on with: python -m eval.family --resume --out {out}" in capsys.readouterr().err
    monkeypatch.undo()
    stamp = (out / "aircraft_00" / "encounters.parquet").stat().st_mtime_ns
    with pytest.raises(InputError, match="--resume: count is 3, expected 2"):
        family.main(["--resume", "--count", "3", "--out", str(out)])
    assert family.main(["--resume", "--out", str(out)]) == 0
    assert (out / "aircraft_00" / "encounters.parquet").stat().st_mtime_ns == stamp
    assert family.main(["--config", str(out / "config.yaml"), "--out", str(again)]) == 0
    assert read_family(out) == read_family(again)
    assert read_family(out)["intruders"] == [1, 2]
    assert (out / "config.yaml").read_bytes() == (again / "config.yaml").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--intruders", "4", "2"], "--intruders: expected the fewest first"),
        (["--mode", "hope"], "--mode: invalid choice"),
        (["--scenario", "file:a.csv"], "--scenario: 'file:a.csv' is a file; expected a sampled"),
        (["--noisy", "--scenario", "multi"], "noisy is a scenario of its own"),
        (["--policy-sha256", "0" * 64], "expected 000"),
        (["--resume"], "holds no run"),
        (["--policy", "none.safetensors"], "no such policy file"),
        (["--intruders", "2", "64"], "outside_domain: there are 64 intruders"),
    ],
)
def test_bad_input_flies_nothing(tmp_path: Path, arguments: list[str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        family.main([*arguments, "--out", str(tmp_path / "none")])
    assert not (tmp_path / "none").exists()


def test_a_family_outside_the_policy_flies_nothing(tmp_path: Path, policy_path: Path) -> None:
    with pytest.raises(
        OutsideDomainError
    ):  # a policy of one intruder serves its own aircraft alone
        family.main(["--policy", str(policy_path), "--out", str(tmp_path / "none")])
    assert not (tmp_path / "none").exists()
