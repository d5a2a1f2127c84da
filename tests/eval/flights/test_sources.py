"""Recorded tracks and an encounter model's traffic in the evaluation: repeatable, weighted,
repaired only if asked.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.config.load import ConfigError
from agents.resolvability.classify import Method, Verdict
from envs.aircraft import PAPER
from envs.encounters import EncounterError
from envs.intruder import KnownFlight
from envs.kinematics import VehicleState
from envs.traffic.replay import encounters_of
from envs.traffic.tracks import Repairs, TrackError
from eval.compare import run as compare
from eval.flights import conditions
from eval.metrics.weighted import summarise_weighted
from eval.monte_carlo import run as monte_carlo
from eval.report import run as report
from tests.envs.formats.test_track_files import ONE
from tests.envs.traffic.test_encounter_model import SMALL
from tests.support import recorded_path

QUICK = ("--set", "resamples=200", "--set", "figures=false", "--workers", "1")
DAA = """\
NAME, sx, sy, sz, vx, vy, vz, time
[none], [m], [m], [m], [m/s], [m/s], [m/s], [s]
own, 0, 0, 0, 75, 0, 0, 0
other, 9000, 100, 0, -75, 0, 0, 0
own, 75, 0, 0, 75, 0, 0, 1
other, 8925, 100, 0, -75, 0, 0, 1
own, 150, 0, 0, 75, 0, 0, 2
other, 8850, 100, 0, -75, 0, 0, 2
"""


def fly(out: Path, *arguments: str) -> dict:
    assert monte_carlo.main([*arguments, *QUICK, "--out", str(out)]) == 0
    return json.loads((out / "summary.json").read_text())


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.txt"
    path.write_text(SMALL)
    return path


@pytest.mark.slow
def test_a_model_s_traffic_is_weighted_and_repeatable(model: Path, tmp_path: Path) -> None:
    common = ("--scenario", f"lincoln:{model}")
    summary = fly(tmp_path / "one", *common, "--encounters", "10")
    table = pq.read_table(tmp_path / "one" / "encounters.parquet").to_pydict()
    weight, reached = np.array(table["weight"]), np.array(table["outcome"]) == "reached"
    assert (weight > 0.0).all()
    weighted = summary["weighted"]
    assert weighted["success_rate"]["value"] == pytest.approx(weight @ reached / weight.sum())
    assert weighted["effective_sample_size"] == pytest.approx(weight.sum() ** 2 / (weight**2).sum())
    assert summary["success_rate"]["count"] == reached.sum()
    # Everyone conflicts: that is what was drawn.
    assert set(table["baseline_outcome"]) == {"violation"}
    fly(tmp_path / "two", *common, "--encounters", "10", "--set", "chunk=7")
    assert (tmp_path / "two/encounters.parquet").read_bytes() == (
        tmp_path / "one/encounters.parquet"
    ).read_bytes()
    fly(tmp_path / "three", "--config", str(tmp_path / "one/config.yaml"))
    assert (tmp_path / "three/encounters.parquet").read_bytes() == (
        tmp_path / "one/encounters.parquet"
    ).read_bytes()
    assert report.main([str(tmp_path / "one"), "--tracks", "3"]) == 0
    model.write_text(SMALL + "\n")
    with pytest.raises(ConfigError, match="has SHA-256"):
        fly(tmp_path / "four", "--config", str(tmp_path / "one/config.yaml"))


@pytest.mark.slow
def test_changes_of_a_model_s_traffic(model: Path, tmp_path: Path) -> None:
    common = ("--scenario", f"lincoln:{model}", "--encounters", "6")
    fly(
        tmp_path / "far",
        *common,
        "--set",
        "changes.miss=8000",
        "--set",
        "changes.own_speed=[60, 61]",
    )
    table = pq.read_table(tmp_path / "far/encounters.parquet").to_pydict()
    assert max(table["own_speed_m_s"]) <= 61.0
    assert "reached" in table["baseline_outcome"]
    uas = ("--set", "aircraft=uas", "--set", "allow_outside_domain=true")
    fly(tmp_path / "uas", *common, *uas)
    table = pq.read_table(tmp_path / "uas/encounters.parquet").to_pydict()
    assert min(table["own_speed_m_s"]) >= 18.0 and max(table["own_speed_m_s"]) <= 36.0
    assert set(table["baseline_outcome"]) == {"violation"} and min(table["distance_m"]) >= 610.0


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["policy", "plan", "assured"])
def test_recorded_tracks_in_every_mode(tmp_path: Path, mode: str) -> None:
    (tmp_path / "straight.daa").write_text(DAA)
    (tmp_path / "turning.json").write_text(json.dumps([ONE]))
    for name in ("straight.daa", "turning.json")[: 1 if mode == "assured" else 2]:
        where = tmp_path / f"run_{name}"
        summary = fly(where, "--scenario", f"tracks:{tmp_path / name}", "--mode", mode)
        assert summary["encounters"] == 1
        assert summary["left_out"] == []
        assert sum(summary["repairs"].values()) == 0
        table = pq.read_table(where / "encounters.parquet").to_pydict()
        assert table["name"] == ["straight" if name.endswith("daa") else "7"]
        assert table["weight"] == [1.0 if name.endswith("daa") else 2.5]
        assert report.main([str(where), "--tracks", "5"]) == 0
    # Head-on, 100 m to the side: without a resolver a loss, and there is room for an escape.
    assert pq.read_table(tmp_path / "run_straight.daa/encounters.parquet").to_pydict()[
        "baseline_outcome"
    ] == ["violation"]


@pytest.mark.slow
def test_the_public_encounters_fly(tmp_path: Path) -> None:
    source = recorded_path("lincoln_lab/encounters.json")
    summary = fly(tmp_path / "run", "--scenario", f"tracks:{source}")
    assert summary["encounters"] + len(summary["left_out"]) == 50
    assert summary["weighted"]["effective_sample_size"] < 15.0
    assert summary["undecided_rate"]["count"] == 0


@pytest.mark.slow
def test_repairs_are_made_only_if_asked_for_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.daa"
    path.write_text(
        DAA.replace("own, 75,", "own, nan,") + DAA.splitlines()[-1].replace(", 2", ", 1") + "\n"
    )
    common = ("--scenario", f"tracks:{path}")
    with pytest.raises(
        TrackError, match=r"bad.daa line 5, field sx: nan, expected a finite number"
    ):
        fly(tmp_path / "refused", *common)
    assert not (tmp_path / "refused").exists()
    summary = fly(tmp_path / "repaired", *common, "--repair")
    assert summary["repairs"] == Repairs(not_finite=1, out_of_order=1)._asdict()
    assert (
        "repaired: 1 rows without a valid value dropped, 1 rows out of order dropped"
        in capsys.readouterr().err
    )
    assert (
        compare.main(
            [
                "--scenario",
                f"tracks:{path}",
                "--baseline",
                "none",
                "--repair",
                "--out",
                str(tmp_path / "c"),
            ]
        )
        == 0
    )
    assert json.loads((tmp_path / "c/summary.json").read_text())["repairs"]["not_finite"] == 1


@pytest.mark.slow
def test_a_comparison_with_a_model_s_traffic(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = [
        "--scenario",
        f"lincoln:{model}",
        "--baseline",
        "mvp",
        "--encounters",
        "8",
        "--set",
        "resamples=100",
    ]
    assert compare.main([*arguments, "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["weighted"] is True
    assert summary["entries"][-1]["risk_ratio"]["value"] == 1.0


def reports(positions: list[tuple[str, int, float, float]], **more: object) -> list[dict]:
    """Return reports of aircraft that fly east at 142 kt: name, second, latitude, longitude."""
    usual = {"altitude": 5_000, "groundspeed": 142.24, "track": 90, "vertical_rate": 0}
    return [
        {
            "icao24": name,
            "timestamp": 1_000_000_000 + 1_000 * second,
            "latitude": y,
            "longitude": x,
            **usual,
            **more,
        }
        for name, second, y, x in positions
    ]


@pytest.mark.slow
def test_pairs_of_adsb_reports_become_encounters(tmp_path: Path) -> None:
    # 0.001 degrees are 73.17 m here, 142.24 kt; they pass 1.1 km beside each other after 70 s.
    east = [("aaa", t, 49.0, 2.0 + 0.001 * t) for t in range(160)]
    west = [("bbb", t, 49.01, 2.14 - 0.001 * t) for t in range(160)]
    far = [("ccc", t, 50.5, 2.14 - 0.001 * t) for t in range(160)]
    rows = reports(east) + reports(west, track=270) + reports(far, track=270)
    path = tmp_path / "adsb.json"
    path.write_text(json.dumps(rows))
    summary = fly(tmp_path / "run", "--scenario", f"tracks:{path}")
    table = pq.read_table(tmp_path / "run/encounters.parquet").to_pydict()
    assert summary["encounters"] == 1
    assert table["name"] == ["aaa-bbb-1000070"]
    # 0.01 degrees of latitude: both leave their parallel, due east and due west, by the same until
    # they meet.
    assert table["d_cpa_m"][0] == pytest.approx(1_112.0, abs=2.0)
    assert table["t_cpa_s"][0] == pytest.approx(70.0, abs=1.0)
    assert table["own_speed_m_s"][0] == pytest.approx(73.17, abs=0.05)

    rows[80]["latitude"], rows[81]["longitude"] = rows[79]["latitude"], rows[79]["longitude"]
    rows[80]["longitude"], rows[81]["latitude"] = rows[79]["longitude"], rows[79]["latitude"]
    rows[100]["altitude"] = None
    path.write_text(json.dumps(rows))
    with pytest.raises(
        TrackError,
        match="report 81, field latitude: the position of 1000080 s is that of 1000079 s",
    ):
        fly(tmp_path / "refused", "--scenario", f"tracks:{path}")
    again = fly(tmp_path / "again", "--scenario", f"tracks:{path}", "--repair")
    assert again["repairs"] == Repairs(not_finite=1, stale=2)._asdict()
    assert again["encounters"] == 1


def test_a_loose_recording_is_not_proven_unresolvable() -> None:
    """An intruder that starts almost upon the ownship, whose rows are off arcs, and one that keeps
    to them.
    """
    times = np.arange(120.0)
    own = VehicleState(*np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [75.0, 75.0]]))
    straight = np.stack(
        [1_100.0 - 75.0 * times, 0.0 * times, np.pi + 0.0 * times, 75.0 + 0.0 * times]
    )
    loose = straight.copy()
    loose[1, 60] = 5.0
    recording = KnownFlight(*np.stack([straight, loose], axis=1)[:, :, None])
    starts = encounters_of(own, recording, np.ones((2, 1), bool), 220.0)
    judged = conditions.verdict_within(starts, PAPER, PAPER.limits, ())
    assert judged.verdict.tolist() == [Verdict.UNRESOLVABLE, Verdict.UNDECIDED]
    assert judged.method[0] in (Method.CONTAINMENT, Method.SPLITTING)
    assert judged.method[1] == Method.NONE


def test_weighted_rates_by_hand() -> None:
    table = {
        "weight": np.array([3.0, 1.0, 4.0]),
        "outcome": np.array(["reached", "violation", "timeout"], object),
        "baseline_outcome": np.array(["violation", "violation", "reached"], object),
        "verdict": np.array(["resolvable", "unresolvable", "undecided"], object),
    }
    rates = summarise_weighted(table, 0.95, 200, 0)
    assert rates is not None
    assert rates["success_rate"]["value"] == pytest.approx(3 / 8)
    assert rates["success_given_resolvable"]["value"] == pytest.approx(3 / 7)
    assert rates["resolvable_rate"]["value"] == pytest.approx(7 / 8)
    assert rates["risk_ratio"] == pytest.approx(1 / 4)
    assert rates["effective_sample_size"] == pytest.approx(64 / 26)
    assert rates["largest_share"] == pytest.approx(0.5)
    for name in ("success_rate", "violation_rate", "success_given_resolvable"):
        assert 0.0 <= rates[name]["low"] <= rates[name]["value"] <= rates[name]["high"] <= 1.0
    assert summarise_weighted(table | {"weight": np.ones(3)}, 0.95, 200, 0) is None


@pytest.mark.slow
def test_weighted_intervals_cover() -> None:
    """Of repeated samples the 95 % interval holds the truth about as often as it says."""
    rng, covered = np.random.default_rng(0), 0
    for seed in range(120):
        weight = rng.exponential(1.0, 150)
        # What is heavy fails more often: the weighted rate is not the plain one.
        failed = rng.random(150) < np.clip(0.1 + 0.1 * weight, 0.0, 1.0)
        outcome = np.where(failed, "violation", "reached").astype(object)
        table = {
            "weight": weight,
            "outcome": outcome,
            "baseline_outcome": outcome,
            "verdict": np.full(150, "undecided"),
        }
        rates = summarise_weighted(table, 0.95, 200, seed)
        assert rates is not None
        covered += rates["violation_rate"]["low"] <= 0.2997 <= rates["violation_rate"]["high"]
    assert covered >= 104


@pytest.mark.parametrize(
    ("arguments", "kind", "sentence"),
    [
        (
            ["--scenario", "lincoln:"],
            ConfigError,
            "'lincoln:' names no file; expected lincoln:PATH",
        ),
        (
            ["--scenario", "lincoln:none.txt + standing"],
            ConfigError,
            "none.txt + standing' has a modifier; expected lincoln:PATH alone",
        ),
        (["--scenario", "lincoln:none.txt"], EncounterError, "none.txt: there is no such file"),
        (["--scenario", "tracks:none.daa"], TrackError, "none.daa: there is no such file"),
        (
            ["--scenario", "tracks:none.txt"],
            TrackError,
            "ends in '.txt'; expected .json, .json.gz, .daa or .xyz",
        ),
        (
            ["--scenario", "lincoln:MODEL", "--set", "changes.mis=3"],
            ConfigError,
            "changes.mis is unknown",
        ),
        (
            ["--scenario", "lincoln:MODEL", "--set", "changes.miss=-3"],
            ConfigError,
            "changes.miss is -3",
        ),
        (
            ["--scenario", "lincoln:MODEL", "--set", "changes.cpa_time=[9, 2]"],
            ConfigError,
            "cpa_time is [9, 2]; expected",
        ),
        (
            ["--scenario", "lincoln:MODEL", "--set", "changes.cpa_time=[9, 300]"],
            ConfigError,
            "expected at most ahead",
        ),
        (
            ["--scenario", "lincoln:MODEL", "--set", "changes.strata=[[9, 9, 0.1]]"],
            ConfigError,
            "strata without miss and vertical_miss; expected both",
        ),
        (
            [
                "--scenario",
                "lincoln:MODEL",
                "--set",
                "changes={miss: 8, vertical_miss: 9, strata: [[9, 9, 0.1]]}",
            ],
            ConfigError,
            "strata: [8, 9] m after [9, 9] m; expected each within the next",
        ),
        (
            [
                "--scenario",
                "lincoln:MODEL",
                "--set",
                "changes={miss: 10, vertical_miss: 10, strata: [[8, 8, 0.5], [9, 9, 0.5]]}",
            ],
            ConfigError,
            "strata: a share of 0; expected shares above 0 with a sum below 1",
        ),
        (
            ["--scenario", "lincoln:MODEL", "--set", "changes.own_speed=[20, 60]"],
            EncounterError,
            "the ownship's limits",
        ),
        (
            ["--scenario", "tracks:DAA", "--set", "changes.miss=3"],
            ConfigError,
            "changes: miss cannot be changed",
        ),
        (
            ["--scenario", "tracks:DAA", "--encounters", "2"],
            ConfigError,
            "encounters is 2; expected at most 1",
        ),
        (
            ["--scenario", "tracks:DAA", "--set", "tracks.max_gap=0.5"],
            TrackError,
            "a gap of 1 s in the track of 'own'",
        ),
    ],
)
def test_bad_input_is_one_sentence(
    model: Path, tmp_path: Path, arguments: list[str], kind: type, sentence: str
) -> None:
    (tmp_path / "one.daa").write_text(DAA)
    filled_in = [
        argument.replace("MODEL", str(model)).replace("DAA", str(tmp_path / "one.daa"))
        for argument in arguments
    ]
    with pytest.raises(kind) as problem:
        fly(tmp_path / "run", *filled_in)
    assert sentence in str(problem.value)
    assert not (tmp_path / "run").exists()


def test_exit_code_2_and_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "cut.txt").write_text(SMALL[:300])
    command = [
        sys.executable,
        "-m",
        "eval.monte_carlo",
        "--scenario",
        f"lincoln:{tmp_path / 'cut.txt'}",
    ]
    process = subprocess.run(
        [*command, "--out", str(tmp_path / "run")], capture_output=True, text=True, check=False
    )
    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr.startswith("error: ")
    assert process.stderr.count("\n") == 1


def test_the_true_aircraft_flies_no_recorded_tracks(tmp_path: Path) -> None:
    from eval.hifi import run as hifi

    with pytest.raises(
        ConfigError, match="cannot be flown here; expected a sampled scenario or file:PATH"
    ):
        hifi.main(["--scenario", "tracks:one.daa", "--out", str(tmp_path / "run")])
