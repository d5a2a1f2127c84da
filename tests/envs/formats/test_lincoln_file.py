"""Lincoln Laboratory's encounters: read in SI units, flown as published, replayed, and refused where malformed."""

import copy
import json
import math
from pathlib import Path

import numpy as np
import pytest

from envs.aircraft import PAPER
from envs.formats.lincoln_file import EVENTS, LincolnEncounter, read_lincoln, tracks_of
from envs.traffic.replay import replay
from envs.traffic.tracks import TrackError
from tests.support import recorded

FOOT = 0.3048
ONE = {
    "id": 7,
    "n_ft": [0.0, 10_000.0],
    "e_ft": [0.0, 500.0],
    "h_ft": [3_000.0, 3_000.0],
    "v_ftps": [200.0, 250.0],
    "heading_rad": [0.0, math.pi],
    "runTime_s": 60.0,
    EVENTS: [[[0.0, 0.0, 0.0, 0.0], [10.0, 0.0, 0.05, 0.0]], [[0.0, 20.0, 0.0, 1.0]]],
    "meta": {"hmd": 500.0, "vmd": 0.0, "tca": 101.0, "w": 2.5},
}


def written(tmp_path: Path, content) -> Path:
    path = tmp_path / "encounters.json"
    path.write_text(json.dumps(content))
    return path


def test_an_encounter_by_hand(tmp_path: Path) -> None:
    (one,) = read_lincoln(written(tmp_path, [ONE]))
    assert (one.number, one.weight, one.time) == (7, 2.5, pytest.approx(10.0))
    assert one.miss == pytest.approx(500.0 * FOOT)
    own, other = tracks_of(one)
    assert own.time[[0, -1]] == pytest.approx([0.0, 60.0])
    # Straight north for 10 s, then a right turn of radius v / w.
    assert (own.x[100], own.y[100]) == pytest.approx((0.0, 2_000.0 * FOOT))
    turned, radius = 0.05 * 20.0, 200.0 / 0.05 * FOOT
    assert own.x[300] == pytest.approx(radius * (1 - math.cos(turned)), rel=1e-5)
    assert own.y[300] == pytest.approx(2_000.0 * FOOT + radius * math.sin(turned), rel=1e-5)
    assert (own.vx[300], own.vy[300]) == pytest.approx((200 * FOOT * math.sin(turned), 200 * FOOT * math.cos(turned)))
    # South, climbing at 20 ft/s, 1 ft/s faster each second along the path.
    assert other.altitude[600] == pytest.approx((3_000.0 + 20.0 * 60.0) * FOOT)
    assert other.vy[600] == pytest.approx(-math.sqrt(310.0**2 - 20.0**2) * FOOT)
    assert other.y[600] == pytest.approx((10_000.0 - (250.0 * 60 + 0.5 * 60**2)) * FOOT, rel=0.02)


def miss(one: LincolnEncounter) -> float:
    """Return the horizontal distance of the flown tracks at the published time of closest approach, m."""
    own, other = tracks_of(one)
    row = min(round(10.0 * one.time), len(own.time) - 1)
    return math.hypot(other.x[row] - own.x[row], other.y[row] - own.y[row])


def test_flights_meet_the_published_miss_distances() -> None:
    found = read_lincoln(recorded("lincoln_lab/encounters.json"))
    assert len(found) == 50
    errors_ft = [abs(miss(one) - one.miss) / FOOT for one in found]
    # Some tracks exceed what the models' own vehicle could fly: the median is what can be judged.
    assert np.median(errors_ft) <= 30.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda one: one.pop("v_ftps"), "encounter 1, field v_ftps: expected a pair of numbers"),
        (lambda one: one["n_ft"].append(1.0), "encounter 1, field n_ft: expected a pair"),
        (lambda one: one["n_ft"].__setitem__(0, "far"), "encounter 1, field n_ft: 'far', expected a finite number"),
        (lambda one: one["v_ftps"].__setitem__(0, -1.0), "field v_ftps: -1, expected 0 to "),
        (
            lambda one: one.update(heading_rad=[90, 270]),
            "field heading_rad: 90, expected -6.28319 to 6.28319 (are these",
        ),
        (lambda one: one["h_ft"].__setitem__(1, 1e11), "field h_ft: 1e+11, expected -5000 to 100000"),
        (lambda one: one["e_ft"].__setitem__(1, 1e308), "field e_ft: 1e+308, expected a finite number"),
        (
            lambda one: one[EVENTS][0][1].__setitem__(2, 3.0),
            "row 2, turn rate: 3, expected -1 to 1 (are these",
        ),
        (lambda one: one[EVENTS][0][1].__setitem__(3, 100.0), "row 2: leads to the speed 5200, expected at most"),
        (lambda one: one[EVENTS][1][0].__setitem__(1, -900.0), "row 1: leads to the altitude -51000, expected at most"),
        (lambda one: one.update(runTime_s=0), "field runTime_s: 0, expected more than 0"),
        (lambda one: one.update(id=1.5), "field id: 1.5, expected a whole number"),
        (lambda one: one["v_ftps"].__setitem__(0, 10**400), "expected a finite number"),
        (lambda one: one.update(id=None), "field id: None, expected a finite number"),
        (lambda one: one.update({EVENTS: [[]]}), "expected a list of events for each of two aircraft"),
        (lambda one: one[EVENTS][0][1].pop(), "ownship's events, row 2: expected 4 numbers"),
        (
            lambda one: one[EVENTS][0][1].__setitem__(0, -1.0),
            "ownship's events, row 2, time: -1 s does not increase, expected more than 0 s",
        ),
        (lambda one: one[EVENTS][1][0].__setitem__(3, True), "intruder's events, row 1, acceleration: True"),
        (lambda one: one["meta"].update(hmd="near"), "field hmd: 'near'"),
        (lambda one: one["meta"].update(w=-1.0), "field w: -1, expected a positive weight"),
    ],
)
def test_a_malformed_encounter_is_refused_by_field(tmp_path: Path, change, sentence: str) -> None:
    one = copy.deepcopy(ONE)
    change(one)
    with pytest.raises(TrackError, match=r"encounters\.json") as refused:
        read_lincoln(written(tmp_path, [one]))
    assert sentence in str(refused.value)


def test_what_is_no_file_of_encounters(tmp_path: Path) -> None:
    path = written(tmp_path, [ONE])
    path.write_text(path.read_text()[:200])
    with pytest.raises(TrackError, match=r"encounters.json line 1: not JSON, or cut off"):
        read_lincoln(path)
    path.write_text(json.dumps([ONE]).replace("3000.0", "NaN"))
    with pytest.raises(TrackError, match="field h_ft: nan, expected a finite number"):
        read_lincoln(path)
    path.write_text("[" + "9" * 5_000 + "]")
    with pytest.raises(TrackError, match="not usable as JSON"):
        read_lincoln(path)
    for content in ({}, [], "text"):
        with pytest.raises(TrackError, match="expected a list of encounters"):
            read_lincoln(written(tmp_path, content))
    with pytest.raises(TrackError, match="encounter 2, field id: 7 stands twice"):
        read_lincoln(written(tmp_path, [ONE, ONE]))
    with pytest.raises(TrackError, match="expected an object"):
        read_lincoln(written(tmp_path, [3]))


def test_a_replay_is_the_track_and_straight_on_after_it(tmp_path: Path) -> None:
    (one,) = read_lincoln(written(tmp_path, [ONE]))
    own, other = tracks_of(one)
    made = replay([("seven", own, [other])], PAPER, 100.0)
    assert made.names == ("seven",)
    assert made.left_out == ()
    starts, recorded_states = made.starts, made.starts.intent
    assert starts.goal_y[0] == pytest.approx(100.0 * 200.0 * FOOT)
    assert starts.own.heading[0] == pytest.approx(math.pi / 2)
    seconds = np.arange(61)
    assert recorded_states.x[0, 0, :61] == pytest.approx(other.x[10 * seconds])
    assert recorded_states.y[0, 0, :61] == pytest.approx(other.y[10 * seconds])
    beyond = np.arange(1, 41)
    assert recorded_states.y[0, 0, 61:101] == pytest.approx(other.y[-1] + other.vy[-1] * beyond)
    assert recorded_states.speed[0, 0, 100] == pytest.approx(np.hypot(other.vx[-1], other.vy[-1]))


def test_what_cannot_be_flown_is_left_out_with_the_reason(tmp_path: Path) -> None:
    slow, fast = copy.deepcopy(ONE), copy.deepcopy(ONE)
    slow["v_ftps"][0] = 100.0
    fast["v_ftps"][1] = 600.0
    slow["id"], fast["id"] = 8, 9
    found = read_lincoln(written(tmp_path, [ONE, slow, fast]))
    encounters = [
        (name, *((own, [other]) for own, other in [tracks_of(one)])) for name, one in zip("abc", found, strict=True)
    ]
    made = replay([(name, *pair) for name, pair in encounters], PAPER, 220.0)
    assert made.names == ("a",)
    assert "b: the ownship begins with 30.5 m/s over the ground, expected 50 to 100 m/s" in made.left_out[0]
    assert "c: 'intruder' flies at" in made.left_out[1]
    with pytest.raises(TrackError, match="no encounter can be flown; the first: b"):
        replay([(name, *pair) for name, pair in encounters[1:]], PAPER, 220.0)
