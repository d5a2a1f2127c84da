"""Encounters between forms of files: what comes back is what went out, and what cannot be held is
refused.
"""

import json
import math
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from agents.config.keys import keys
from agents.config.load import ConfigError
from agents.config.pages import with_tables
from envs.aircraft import PAPER
from envs.encounters import EncounterError
from envs.formats import encounter_file
from envs.formats.lincoln_file import read_lincoln, tracks_of
from envs.formats.track_files import read_daidalus
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from eval import convert
from eval.config import MonteCarloConfig
from eval.hifi.config import HifiConfig
from eval.reference import main, tables
from tests.envs.formats.test_encounter_file import build
from tests.support import recorded_path


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "own.csv"
    encounter_file.write(path, encounters_of_seed(scenario("circle", PAPER), 5, 0, 3))
    return path


def test_there_and_back_by_lincoln_s_form(own: Path, tmp_path: Path) -> None:
    lincoln, back = tmp_path / "there.json", tmp_path / "back.csv"
    assert convert.main([str(own), str(lincoln), "--altitude-ft", "5000", "--lossy"]) == 0
    assert convert.main([str(lincoln), str(back), "--lossy"]) == 0
    (before, _), (after, names) = encounter_file.read(own), encounter_file.read(back)
    assert names == ["0", "1", "2"]
    for track, track_back in zip(
        (*before.own, *before.intruders), (*after.own, *after.intruders), strict=True
    ):
        np.testing.assert_allclose(track_back, track, atol=1e-6)


@pytest.mark.parametrize("end", [".daa", ".xyz"])
def test_there_and_back_by_daidalus_form(own: Path, tmp_path: Path, end: str) -> None:
    daidalus, back = tmp_path / f"there{end}", tmp_path / "back.csv"
    arguments = ["--encounter", "1", "--altitude-ft", "5000", "--lossy"]
    assert convert.main([str(own), str(daidalus), *arguments]) == 0
    assert convert.main([str(daidalus), str(back), "--lossy"]) == 0
    (before, _), (after, _) = encounter_file.read(own), encounter_file.read(back)
    for first, second in zip(
        (*before.own, *before.intruders), (*after.own, *after.intruders), strict=True
    ):
        np.testing.assert_allclose(second[0], first[1], atol=1e-6)


def test_a_turn_becomes_events_and_rows(tmp_path: Path) -> None:
    turning = take(encounters_of_seed(scenario("maneuvering", PAPER), 5, 0, 40), slice(0, 40))
    path = tmp_path / "turning.csv"
    encounter_file.write(path, turning)
    assert (
        convert.main(
            [str(path), str(tmp_path / "turning.json"), "--altitude-ft", "5000", "--lossy"]
        )
        == 0
    )
    encounters = read_lincoln(tmp_path / "turning.json")
    for i, encounter in enumerate(encounters):
        turned = np.abs(encounter.events[1][:, 2]).max()
        change = turning.intent.heading_change[i, 0]
        begins = turning.intent.onset[i, 0] < 295.0
        assert (turned > 0.0) == (abs(change) > 0.0 and begins)
    # And cannot come back: the form does not say where a turn of ours begins.
    with pytest.raises(EncounterError, match=r"off its track .* expected at most 1 m"):
        convert.main([str(tmp_path / "turning.json"), str(tmp_path / "back.csv"), "--lossy"])


def test_recorded_encounters_keep_their_tracks(tmp_path: Path) -> None:
    source = recorded_path("lincoln_lab/encounters.json")
    assert convert.main([str(source), str(tmp_path / "again.json")]) == 0
    encounter, again = read_lincoln(source)[1], read_lincoln(tmp_path / "again.json")[1]
    assert (again.number, again.weight) == (encounter.number, encounter.weight)
    for first, second in zip(tracks_of(encounter), tracks_of(again), strict=True):
        assert np.hypot(first.x - second.x, first.y - second.y).max() < 1.0
    name = str(encounter.number)
    assert (
        convert.main([str(source), str(tmp_path / "one.xyz"), "--encounter", name, "--lossy"]) == 0
    )
    own, intruder = read_daidalus(tmp_path / "one.xyz").tracks
    recorded = tracks_of(encounter)[1]
    np.testing.assert_allclose(intruder.x, recorded.x[::10], atol=1e-9)
    np.testing.assert_allclose(intruder.altitude, recorded.altitude[::10], atol=1e-9)
    assert own.name == "ownship"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["own.txt", "a.csv"], "own.txt ends in '.txt'; expected .csv, .json, .daa or .xyz"),
        (["own.csv", "own.csv"], "own.csv is there already, expected a new file"),
        (
            ["own.csv", "a.json"],
            "a.json cannot hold the goal of 3 of 3 encounters, the first '0'; expected --lossy",
        ),
        (["own.csv", "a.json", "--lossy"], "encounter '0' has no altitude, expected one"),
        (
            ["own.csv", "a.xyz", "--lossy", "--altitude-ft", "1"],
            "holds 3 encounters and .xyz files one, expected",
        ),
        (["own.csv", "a.xyz", "--encounter", "nine"], "--encounter: 'nine' is not in "),
        (
            ["own.csv", "a.xyz", "--altitude-ft", "1e9"],
            "--altitude-ft: 1e+09 ft; expected -2000 to 60000 ft",
        ),
        (
            ["own.csv", "a.xyz", "--seconds", "0"],
            "--seconds: '0'; expected a whole number, 1 to 3600",
        ),
        (["none.csv", "a.xyz"], "none.csv: there is no such file"),
        (["none.daa", "a.csv"], "none.daa: there is no such file"),
    ],
)
def test_bad_input_is_one_sentence(
    own: Path, tmp_path: Path, arguments: list[str], sentence: str
) -> None:
    assert own.exists()
    files = [str(tmp_path / name) for name in arguments[:2]]
    with pytest.raises((ConfigError, ValueError)) as raised:
        convert.main([*files, *arguments[2:]])
    assert sentence in str(raised.value)
    assert not (tmp_path / "a.json").exists()


def test_tracks_whose_velocities_contradict_them_are_refused_with_the_reason(
    tmp_path: Path,
) -> None:
    # As DAIDALUS has it: a minute of arc is a nautical mile in every direction.
    rows = ["NAME lat lon alt trk gs vs time", "[none] [deg] [deg] [ft] [deg] [knot] [fpm] [s]"]
    for second in range(61):
        degrees = 120.0 * second / 3600.0 / 60.0
        rows.append(f"Ownship, {40.0 + degrees}, -74.0, 5000, 0, 120, 0, {second}")
        east = -73.9 + degrees / math.cos(math.radians(40.0))
        rows.append(f"Intruder, 40.0, {east}, 5000, 90, 120, 0, {second}")
    source = tmp_path / "sphere.daa"
    source.write_text("\n".join(rows) + "\n")
    # WGS-84 has 111.0 km in a degree of latitude at 40 degrees, and 85.4 km in one of longitude.
    says = r"'Intruder': 1\d\.\d m .* positions lead 371[3-6] m away and its velocities 3704 m, .*sphere"
    with pytest.raises(EncounterError, match=says):
        convert.main([str(source), str(tmp_path / "own.csv"), "--lossy"])
    assert not (tmp_path / "own.csv").exists()


def test_several_intruders_do_not_fit_into_a_pair(tmp_path: Path) -> None:
    encounter_file.write(
        tmp_path / "multi.csv",
        encounters_of_seed(scenario("multi", PAPER, intruders=(2, 3)), 1, 0, 2),
    )
    with pytest.raises(EncounterError, match=r"intruders, expected one, because a \.json file"):
        convert.main(
            [str(tmp_path / "multi.csv"), str(tmp_path / "a.json"), "--lossy", "--altitude-ft", "1"]
        )
    arguments = ["--encounter", "0", "--lossy", "--altitude-ft", "1"]
    assert convert.main([str(tmp_path / "multi.csv"), str(tmp_path / "a.xyz"), *arguments]) == 0
    assert len(read_daidalus(tmp_path / "a.xyz").tracks) >= 3


def test_lossy_says_what_it_leaves_out(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    convert.main([str(own), str(tmp_path / "a.json"), "--lossy", "--altitude-ft", "0"])
    printed = capsys.readouterr()
    assert "left out: the goal of 3 of 3 encounters, the first '0'" in printed.err
    assert printed.out.endswith("a.json: 3 encounters\n")
    assert len(json.loads((tmp_path / "a.json").read_text())) == 3


speed_of_intruder = st.one_of(st.just(0.0), st.floats(0.0, 150.0))
turn = st.one_of(
    st.just((0.0, 0.0, 0.05)),
    st.tuples(st.floats(0, 60), st.floats(-3.1, 3.1), st.floats(0.0, 0.5)),
)
place = st.floats(-50_000, 50_000)
course = st.floats(-math.pi, math.pi, exclude_max=True)
flights = st.tuples(
    st.tuples(place, place, course, st.floats(50, 100)),
    st.tuples(place, place, course, speed_of_intruder),
    turn,
)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(flights, st.sampled_from([".json", ".daa", ".xyz", ".csv"]))
@example(((0.0, 0.0, 0.0, 50.0), (0.0, 0.0, 1.0, 0.0), (0.0, 3.0, 0.5)), ".json")
def test_what_is_written_can_be_read(tmp_path: Path, flown, form: str) -> None:
    """From our form by any other to Lincoln Laboratory's and to DAIDALUS', the tracks stay the
    same.
    """
    own, intruder, turns = flown
    for old in tmp_path.iterdir():
        old.unlink()
    paths = [
        tmp_path / "0.csv",
        tmp_path / f"one{form}",
        tmp_path / "two.json",
        tmp_path / "three.xyz",
    ]
    encounter_file.write(
        paths[0], build([((*own, 0.0, 0.0), (0.0, 0.0, 0.0), [(*intruder, *turns)])]), ["0"]
    )
    places = []
    for source, target in pairwise(paths):
        assert (
            convert.main(
                [str(source), str(target), "--altitude-ft", "5000", "--seconds", "40", "--lossy"]
            )
            == 0
        )
        if target.suffix == ".json":
            # A row each tenth of a second.
            places.append(
                [(track.x[::10], track.y[::10]) for track in tracks_of(read_lincoln(target)[0])]
            )
        elif target.suffix != ".csv":
            places.append([(track.x, track.y) for track in read_daidalus(target).tracks])
    for again in places[1:]:
        np.testing.assert_allclose(again, places[0], atol=3.0)


def test_an_intruder_at_rest_is_written_and_read(tmp_path: Path) -> None:
    encounter_file.write(
        tmp_path / "own.csv",
        build(
            [
                (
                    (0.0, 0.0, 0.0, 75.0, 9e3, 0.0),
                    (0.0, 0.0, 0.0),
                    [(4e3, 0.0, 1.0, 0.0, 0.0, 0.0, 0.05)],
                )
            ]
        ),
    )
    assert (
        convert.main(
            [str(tmp_path / "own.csv"), str(tmp_path / "a.json"), "--altitude-ft", "0", "--lossy"]
        )
        == 0
    )
    assert read_lincoln(tmp_path / "a.json")[0].speed[1] == 0.0


def test_what_the_reader_would_refuse_is_not_written(tmp_path: Path) -> None:
    fast = [450.0, 60.0]
    encounter = {
        "id": 1,
        "n_ft": [0.0, 900.0],
        "e_ft": [0.0, 9_000.0],
        "h_ft": [0.0, 0.0],
        "heading_rad": [0.0, 1.0],
        "v_ftps": [speed / 0.3048 for speed in fast],
        "runTime_s": 20.0,
        "events_time_s_vrate_fps_turn_radps_accel_ftpss": [[], []],
    }
    (tmp_path / "fast.json").write_text(json.dumps([encounter]))
    with pytest.raises(
        EncounterError, match=r"a\.csv, as it would be: .*column own_speed_m_s: '450"
    ):
        convert.main([str(tmp_path / "fast.json"), str(tmp_path / "a.csv"), "--lossy"])
    assert [path.name for path in tmp_path.iterdir()] == ["fast.json"]


def test_shorter_tracks_and_other_columns_are_lost_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [
        "NAME, sx, sy, sz, vx, vy, vz, time, heading",
        "[none], [m], [m], [m], [m/s], [m/s], [m/s], [s], [deg]",
    ]
    for second in range(121):
        lines.append(f"own, {60 * second}, 0, 0, 60, 0, 0, {second}, 90")
        if second <= 10:
            lines.append(f"other, {7200 - 60 * second}, 0, 0, -60, 0, 0, {second}, 270")
    (tmp_path / "a.xyz").write_text("\n".join(lines))
    with pytest.raises(ConfigError, match="110 rows at times that not all tracks cover of 1 of 1"):
        convert.main([str(tmp_path / "a.xyz"), str(tmp_path / "b.xyz")])
    assert not (tmp_path / "b.xyz").exists()
    assert convert.main([str(tmp_path / "a.xyz"), str(tmp_path / "b.xyz"), "--lossy"]) == 0
    assert "left out: 132 values of column heading of 1 of 1" in capsys.readouterr().err
    assert [len(track.time) for track in read_daidalus(tmp_path / "b.xyz").tracks] == [11, 11]


DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"


def test_the_page_is_current() -> None:
    for name, new in tables().items():
        page = (DOCS / name).read_text(encoding="utf-8")
        assert with_tables(page, new) == page, "run `python -m eval.reference docs/reference`"


def test_every_key_has_its_row() -> None:
    # Those of an aircraft stand on the page of training, once.
    text = "".join(*tables().values()) + (DOCS / "configuration.md").read_text(encoding="utf-8")
    names = [
        key.name.replace("planner.vehicle.", "aircraft.")
        for model in (MonteCarloConfig, HifiConfig)
        for key in keys(model)
    ]
    assert not [name for name in names if f"\n| `{name}` | " not in text]


def test_the_command_writes_the_tables_and_leaves_the_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (name,) = tables()
    written = (DOCS / name).read_text(encoding="utf-8")
    (tmp_path / name).write_text(
        written.replace("| `encounters` |", "| `meetings` |"), encoding="utf-8"
    )
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path)])
    main()
    assert (tmp_path / name).read_text(encoding="utf-8") == written
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path / "none")])
    with pytest.raises(ConfigError, match="there is no such page"):
        main()
