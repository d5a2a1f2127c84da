"""Encounters between forms of files: what comes back is what went out, and what cannot be held is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from agents.config.load import ConfigError
from envs.encounters import EncounterError, scenario
from envs.formats import encounter_file
from envs.formats.lincoln_file import read_lincoln, tracks_of
from envs.formats.track_files import read_daidalus
from envs.starts import numbered
from envs.trees import take
from eval import convert
from tests.recorded import recorded


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "own.csv"
    encounter_file.write(path, numbered(scenario("circle"), 5, 0, 3))
    return path


def test_there_and_back_by_lincoln_s_form(own: Path, tmp_path: Path) -> None:
    there, back = tmp_path / "there.json", tmp_path / "back.csv"
    assert convert.main([str(own), str(there), "--altitude-ft", "5000", "--lossy"]) == 0
    assert convert.main([str(there), str(back), "--lossy"]) == 0
    (before, _), (after, names) = encounter_file.read(own), encounter_file.read(back)
    assert names == ["0", "1", "2"]
    for one, other in zip((*before.own, *before.intruders), (*after.own, *after.intruders), strict=True):
        np.testing.assert_allclose(other, one, atol=1e-6)


@pytest.mark.parametrize("end", [".daa", ".xyz"])
def test_there_and_back_by_daidalus_form(own: Path, tmp_path: Path, end: str) -> None:
    there, back = tmp_path / f"there{end}", tmp_path / "back.csv"
    one = ["--encounter", "1", "--altitude-ft", "5000", "--lossy"]
    assert convert.main([str(own), str(there), *one]) == 0
    assert convert.main([str(there), str(back), "--lossy"]) == 0
    (before, _), (after, _) = encounter_file.read(own), encounter_file.read(back)
    for first, second in zip((*before.own, *before.intruders), (*after.own, *after.intruders), strict=True):
        np.testing.assert_allclose(second[0], first[1], atol=1e-6)


def test_a_turn_becomes_events_and_rows(tmp_path: Path) -> None:
    turning = take(numbered(scenario("maneuvering"), 5, 0, 40), slice(0, 40))
    path = tmp_path / "turning.csv"
    encounter_file.write(path, turning)
    assert convert.main([str(path), str(tmp_path / "turning.json"), "--altitude-ft", "5000", "--lossy"]) == 0
    found = read_lincoln(tmp_path / "turning.json")
    for i, each in enumerate(found):
        turned = np.abs(each.events[1][:, 2]).max()
        change = turning.intent.heading_change[i, 0]
        begins = turning.intent.onset[i, 0] < 295.0
        assert (turned > 0.0) == (abs(change) > 0.0 and begins)
    # And cannot come back: the form does not say where a turn of ours begins.
    with pytest.raises(EncounterError, match="off a straight flight, expected at most 1 m"):
        convert.main([str(tmp_path / "turning.json"), str(tmp_path / "back.csv"), "--lossy"])


def test_recorded_encounters_keep_their_tracks(tmp_path: Path) -> None:
    source = recorded("lincoln_lab/encounters.json")
    assert convert.main([str(source), str(tmp_path / "again.json")]) == 0
    one, again = read_lincoln(source)[1], read_lincoln(tmp_path / "again.json")[1]
    assert (again.number, again.weight) == (one.number, one.weight)
    for first, second in zip(tracks_of(one), tracks_of(again), strict=True):
        assert np.hypot(first.x - second.x, first.y - second.y).max() < 1.0
    name = str(one.number)
    assert convert.main([str(source), str(tmp_path / "one.xyz"), "--encounter", name, "--lossy"]) == 0
    own, other = read_daidalus(tmp_path / "one.xyz").tracks
    known = tracks_of(one)[1]
    np.testing.assert_allclose(other.x, known.x[::10], atol=1e-9)
    np.testing.assert_allclose(other.altitude, known.altitude[::10], atol=1e-9)
    assert own.name == "ownship"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["own.txt", "a.csv"], "own.txt ends in '.txt'; expected .csv, .json, .daa or .xyz"),
        (["own.csv", "own.csv"], "own.csv is there already, expected a new file"),
        (["own.csv", "a.json"], "a.json cannot hold the goal of 3 of 3 encounters, the first '0'; expected --lossy"),
        (["own.csv", "a.json", "--lossy"], "encounter '0' has no altitude, expected one"),
        (["own.csv", "a.xyz", "--lossy", "--altitude-ft", "1"], "holds 3 encounters and .xyz files one, expected"),
        (["own.csv", "a.xyz", "--encounter", "nine"], "--encounter: 'nine' is not in "),
        (["own.csv", "a.xyz", "--altitude-ft", "1e9"], "--altitude-ft: 1e+09; expected -2000 to 60000"),
        (["own.csv", "a.xyz", "--seconds", "0"], "--seconds: 1 to 3600"),
        (["none.csv", "a.xyz"], "none.csv: there is no such file"),
        (["none.daa", "a.csv"], "none.daa: there is no such file"),
    ],
)
def test_bad_input_is_one_sentence(own: Path, tmp_path: Path, arguments: list[str], sentence: str) -> None:
    assert own.exists()
    files = [str(tmp_path / name) for name in arguments[:2]]
    with pytest.raises((ConfigError, ValueError)) as told:
        convert.main([*files, *arguments[2:]])
    assert sentence in str(told.value)
    assert not (tmp_path / "a.json").exists()


def test_several_intruders_do_not_fit_into_a_pair(tmp_path: Path) -> None:
    encounter_file.write(tmp_path / "multi.csv", numbered(scenario("multi", intruders=(2, 3)), 1, 0, 2))
    with pytest.raises(EncounterError, match=r"intruders, expected one, because a \.json file"):
        convert.main([str(tmp_path / "multi.csv"), str(tmp_path / "a.json"), "--lossy", "--altitude-ft", "1"])
    one = ["--encounter", "0", "--lossy", "--altitude-ft", "1"]
    assert convert.main([str(tmp_path / "multi.csv"), str(tmp_path / "a.xyz"), *one]) == 0
    assert len(read_daidalus(tmp_path / "a.xyz").tracks) >= 3


def test_lossy_says_what_it_leaves_out(own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    convert.main([str(own), str(tmp_path / "a.json"), "--lossy", "--altitude-ft", "0"])
    told = capsys.readouterr()
    assert "left out: the goal of 3 of 3 encounters, the first '0'" in told.err
    assert told.out.endswith("a.json: 3 encounters\n")
    assert len(json.loads((tmp_path / "a.json").read_text())) == 3
