"""ADS-B reports: units of the form, gaps reported and repaired on request, real pairs as close as published."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from envs.formats.adsb_file import read_adsb
from envs.traffic.replay import replay
from envs.traffic.track_units import KNOT
from envs.traffic.tracks import Repairs, TrackError, at_times
from tests.support import recorded


def report(name: str, seconds: float, latitude: float, **changes):
    usual = {"longitude": 2.0, "altitude": 1_000.0, "groundspeed": 120.0, "track": 0.0, "vertical_rate": 600.0}
    return {"icao24": name, "timestamp": int(1_000 * seconds), "latitude": latitude, **usual, **changes}


REPORTS = [
    report("aaa", 100, 48.0),
    report("bbb", 100, 48.1, track=180.0),
    report("ccc", 100, 48.1, altitude=None),
    report("aaa", 101, 48.000555),
    report("bbb", 101, 48.099445, track=180.0),
    report("aaa", 900, 48.5),
]


def written(tmp_path: Path, content, packed: bool = False) -> Path:
    path = tmp_path / ("reports.json.gz" if packed else "reports.json")
    data = json.dumps(content).encode()
    path.write_bytes(gzip.compress(data) if packed else data)
    return path


@pytest.mark.parametrize("packed", [False, True])
def test_reports_by_hand(tmp_path: Path, packed: bool) -> None:
    found = read_adsb(written(tmp_path, REPORTS, packed), ("aaa", "bbb"), (90.0, 110.0))
    own, other = found.tracks
    assert found.repairs == Repairs()
    assert own.time.tolist() == [100.0, 101.0]
    assert (own.x[0], own.y[0]) == (0.0, 0.0)
    # 0.000555 degrees of latitude in a second are 120 knots.
    assert own.y[1] == pytest.approx(own.vy[0], rel=0.01)
    assert other.vy == pytest.approx([-120.0 * KNOT] * 2)
    assert own.altitude[0] == pytest.approx(304.8)
    assert own.vertical_rate[0] == pytest.approx(3.048)


def test_holes_are_refused_or_repaired(tmp_path: Path) -> None:
    path = written(tmp_path, REPORTS)
    with pytest.raises(TrackError, match="report 6, field timestamp: a gap of 799 s in the track of 'aaa'"):
        read_adsb(path, ("aaa",), (0.0, 1_000.0))
    with pytest.raises(TrackError, match="report 3, field altitude: nan, expected a finite number"):
        read_adsb(path, ("ccc",), (0.0, 1_000.0))
    with pytest.raises(TrackError, match="no row of 'ccc' is left"):
        read_adsb(path, ("ccc",), (0.0, 1_000.0), repair=True)
    found = read_adsb(path, ("aaa",), (0.0, 1_000.0), repair=True, max_gap=100.0)
    assert found.repairs == Repairs(filled=7)
    assert np.diff(found.tracks[0].time)[1:] == pytest.approx(799.0 / 8)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({}, "expected a list of reports"),
        ([3], "report 1: expected an object"),
        ([{"icao24": "aaa"}], "report 1, field timestamp: missing"),
        ([report("aaa", 100, 48.0, altitude=10**400)], "report 1, field altitude: 1000"),
        ([report("aaa", 100, 148.0)], "report 1, field latitude: 148, expected -90 to 90"),
        ([report("aaa", 100, 48.0, track="north")], "report 1, field track: 'north', expected a number or null"),
        ([report("bbb", 100, 48.0)], "no airborne report of 'aaa' from 0 to 1000 s"),
    ],
)
def test_bad_reports_are_refused(tmp_path: Path, content, sentence: str) -> None:
    with pytest.raises(TrackError) as refused:
        read_adsb(written(tmp_path, content), ("aaa",), (0.0, 1_000.0))
    assert sentence in str(refused.value)


def test_cut_and_absent_files(tmp_path: Path) -> None:
    path = written(tmp_path, REPORTS, packed=True)
    for share in (2, 20, 60, len(path.read_bytes()) - 1):
        cut = tmp_path / "cut.json.gz"
        cut.write_bytes(path.read_bytes()[:share])
        with pytest.raises(TrackError, match="cut off"):
            read_adsb(cut, ("aaa",), (0.0, 1_000.0))
    with pytest.raises(TrackError, match="there is no such file"):
        read_adsb(tmp_path / "absent.json", ("aaa",), (0.0, 1.0))
    with pytest.raises(TrackError, match="a window that ends after it begins"):
        read_adsb(path, ("aaa",), (1.0, 1.0))


def test_a_recorded_pair_comes_as_close_as_published() -> None:
    # Published: 2375 m. The pair's list was made of the same second-by-second reports, repeated ones included.
    path = recorded("adsb/quickstart.json.gz")
    pairs = recorded("adsb/real_pairs.csv").read_text().splitlines()
    line = next(each for each in pairs if ",4d02be,a560f3," in each).split(",")
    when = float(line[3])
    own, other = read_adsb(path, (line[2], line[1]), (when - 60.0, when + 60.0), repair=True).tracks
    times = np.arange(max(own.time[0], other.time[0]), min(own.time[-1], other.time[-1]))
    first, second = at_times(own, times), at_times(other, times)
    assert np.hypot(first.x - second.x, first.y - second.y).min() == pytest.approx(float(line[4]), abs=5.0)
    made = replay([("pair", own, [other])], steps=100)
    assert np.isfinite(made.starts.intent.x).all()
