"""ADS-B reports and pairs of aircraft in them: units, gaps and repairs, never a pair made by a
fault.
"""

import gzip
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from envs.aircraft import PAPER
from envs.formats.adsb_file import order_flights
from envs.formats.adsb_pairs import Nearby, adsb_pairs
from envs.formats.track_rows import place_of, track_of
from envs.traffic.replay import replay
from envs.traffic.track_units import FOOT, KNOT
from envs.traffic.tracks import Repairs, Track, TrackError, at_times, sum_of_repairs
from tests.support import WGS84, case, flight, recorded_path, reports_file


def report(name: str, seconds: float, latitude: float, **changes):
    usual = {
        "longitude": 2.0,
        "altitude": 1_000.0,
        "groundspeed": 120.0,
        "track": 0.0,
        "vertical_rate": 600.0,
    }
    return {
        "icao24": name,
        "timestamp": int(1_000 * seconds),
        "latitude": latitude,
        **usual,
        **changes,
    }


REPORTS = [
    report("aaa", 100, 48.0),
    report("bbb", 100, 48.1, track=180.0),
    report("ccc", 100, 48.1, altitude=None),
    report("aaa", 101, 48.000555),
    report("bbb", 101, 48.099445, track=180.0),
    report("aaa", 900, 48.5),
]


def write_reports(tmp_path: Path, content, packed: bool = False) -> Path:
    path = tmp_path / ("reports.json.gz" if packed else "reports.json")
    data = json.dumps(content).encode()
    path.write_bytes(gzip.compress(data) if packed else data)
    return path


def tracks(path: Path, **options) -> tuple[list[Track], Repairs]:
    """Read the longest flight of each aircraft, local to where the first one's begins."""
    read = list(order_flights(path, math.inf, **options))
    rows = {name: max(flights, key=len) for name, flights, _ in read}
    reference = place_of(next(iter(rows.values()))[0])
    return [
        track_of(name, aircraft_rows, reference) for name, aircraft_rows in rows.items()
    ], sum_of_repairs([repairs for *_, repairs in read])


@pytest.mark.parametrize("packed", [False, True])
def test_reports_by_hand(tmp_path: Path, packed: bool) -> None:
    (own, intruder), repairs = tracks(
        write_reports(tmp_path, [*REPORTS[:2], *REPORTS[3:5]], packed)
    )
    assert repairs == Repairs()
    assert own.time.tolist() == [100.0, 101.0]
    assert (own.x[0], own.y[0]) == (0.0, 0.0)
    # 0.000555 degrees of latitude in a second are 120 knots.
    assert own.y[1] == pytest.approx(own.vy[0], rel=0.01)
    assert intruder.vy == pytest.approx([-120.0 * KNOT] * 2)
    assert own.altitude[0] == pytest.approx(304.8)
    assert own.vertical_rate[0] == pytest.approx(3.048)


def test_holes_are_refused_or_repaired(tmp_path: Path) -> None:
    path = write_reports(tmp_path, REPORTS)
    with pytest.raises(
        TrackError, match="report 6, field timestamp: a gap of 799 s in the track of 'aaa'"
    ):
        tracks(path)
    with pytest.raises(TrackError, match="report 1, field altitude: nan, expected a finite number"):
        tracks(write_reports(tmp_path, REPORTS[2:3]))
    (own, _), repairs = tracks(
        write_reports(tmp_path, [*REPORTS[:2], *REPORTS[3:]]), repair=True, max_gap=100.0
    )
    assert repairs == Repairs(filled=7)
    assert own.time.tolist() == [100.0, 101.0, 900.0]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({}, "expected a list of reports"),
        ([3], "report 1: expected an object"),
        ([{"icao24": "aaa"}], "report 1, field timestamp: missing"),
        ([report("aaa", 100, 48.0, altitude=10**400)], "report 1, field altitude: 1000"),
        ([report("aaa", 100, 148.0)], "report 1, field latitude: 148, expected -90 to 90"),
        (
            [report("aaa", 100, 48.0, track="north")],
            "report 1, field track: 'north', expected a number or null",
        ),
    ],
)
def test_bad_reports_are_refused(tmp_path: Path, content, sentence: str) -> None:
    with pytest.raises(TrackError) as refused:
        tracks(write_reports(tmp_path, content))
    assert sentence in str(refused.value)


def test_cut_and_absent_files(tmp_path: Path) -> None:
    path = write_reports(tmp_path, REPORTS, packed=True)
    for share in (2, 20, 60, len(path.read_bytes()) - 1):
        cut = tmp_path / "cut.json.gz"
        cut.write_bytes(path.read_bytes()[:share])
        with pytest.raises(TrackError, match="cut off"):
            tracks(cut)
    with pytest.raises(TrackError, match="there is no such file"):
        tracks(tmp_path / "absent.json")


def test_a_recorded_pair_comes_as_close_as_published(tmp_path: Path) -> None:
    # Published: 2375 m. The pair's list was made of the same second-by-second reports, repeated
    # ones included.
    reports = json.loads(gzip.decompress(recorded_path("adsb/quickstart.json.gz").read_bytes()))
    pairs = recorded_path("adsb/real_pairs.csv").read_text().splitlines()
    line = next(entry for entry in pairs if ",4d02be,a560f3," in entry).split(",")
    meeting_time = float(line[3])
    path = write_reports(
        tmp_path, [item for item in reports if abs(item["timestamp"] / 1e3 - meeting_time) <= 60.0]
    )
    met = {item.name: item for item in tracks(path, repair=True)[0] if item.name in line[1:3]}
    own, intruder = met[line[2]], met[line[1]]
    times = np.arange(max(own.time[0], intruder.time[0]), min(own.time[-1], intruder.time[-1]))
    first, second = at_times(own, times), at_times(intruder, times)
    assert np.hypot(first.x - second.x, first.y - second.y).min() == pytest.approx(
        float(line[4]), abs=5.0
    )
    replayed = replay([("pair", own, [intruder])], PAPER, 220.0)
    assert np.isfinite(replayed.starts.intent.x).all()


# Pairs of aircraft in ADS-B reports: found wherever on the Earth, and never made by faults of the
# reports.


def meeting(latitude: float, longitude: float, track: float = 90.0, after: float = 60.0):
    """Return reports of two aircraft that fly towards each other at 80 m/s, and meet after some
    seconds.
    """
    x, y, back = WGS84.fwd(longitude, latitude, track, 160.0 * after)
    return flight("aaa001", latitude, longitude, track), flight("bbb002", y, x, back)


def pairs_of(path: Path, **options):
    return adsb_pairs(path, Nearby(5_000.0, 300.0, 120.0), PAPER, **options)


def find_pairs(path: Path, **options) -> list[tuple[str, Track, Track]]:
    return [(name, own, intruders[0]) for name, own, intruders in pairs_of(path, **options)[0]]


@pytest.mark.parametrize(
    ("latitude", "longitude", "track"),
    [
        (0.0, 0.0, 90.0),
        (47.0, 8.0, 30.0),
        (-17.0, 179.99, 90.0),
        (-17.0, -179.99, 270.0),
        (89.97, 40.0, 0.0),
    ],
)
def test_a_head_on_pair_is_the_same_anywhere_on_earth(
    tmp_path: Path, latitude: float, longitude: float, track: float
) -> None:
    ((name, own, intruder),) = find_pairs(
        reports_file(tmp_path, *meeting(latitude, longitude, track))
    )
    assert name == "aaa001-bbb002-1600000060"
    assert (own.x[0], own.y[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.hypot(intruder.x[0], intruder.y[0]) == pytest.approx(9_600.0, abs=0.1)
    # Head-on: both fly along the line between them.
    ahead = np.radians(track)
    assert (own.vx[0], own.vy[0]) == pytest.approx(
        (80 * np.sin(ahead), 80 * np.cos(ahead)), abs=1e-3
    )
    assert (intruder.vx[0], intruder.vy[0]) == pytest.approx(
        (-80 * np.sin(ahead), -80 * np.cos(ahead)), abs=0.05
    )
    assert np.hypot(own.x[60] - intruder.x[60], own.y[60] - intruder.y[60]) < 0.5


def test_times_between_whole_seconds_cross_the_antimeridian(tmp_path: Path) -> None:
    first, second = meeting(-17.0, 179.9996)
    for report in (*first, *second):
        report["timestamp"] += 500.0
    ((_, own, intruder),) = find_pairs(reports_file(tmp_path, first, second))
    assert (own.x[0], own.y[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.hypot(intruder.x[0], intruder.y[0]) == pytest.approx(9_520.0, abs=0.1)


def test_aircraft_far_apart_are_no_pair_in_either_order(tmp_path: Path) -> None:
    antipodes = flight("aaa001", 0.0, -78.5, 90.0), flight("bbb002", 0.0, 101.5, 90.0)
    x, y, _ = WGS84.fwd(24.9, 60.2, 50.0, 5_500.0)
    abreast = flight("ccc003", 60.2, 24.9, 0.0), flight("ddd004", y, x, 0.0)
    far = flight("eee005", 40.4, -3.7, 90.0)
    for order in ([*antipodes, *abreast, far], [far, *abreast, *antipodes]):
        assert find_pairs(reports_file(tmp_path, *order)) == []


def test_the_closest_approach_at_one_level_counts(tmp_path: Path) -> None:
    """An intruder 12 000 ft above at 100 m descends while it drifts away, and is level at some 450
    m.
    """

    def altitude(second: float) -> float:
        return 3_000.0 + 12_000.0 * float(np.clip((180.0 - second) / 100.0, 0.0, 1.0))

    own = flight("aaa001", 47.0, 8.0, 90.0)
    above, descending = [], []
    for second, report in enumerate(own):
        x, y, _ = WGS84.fwd(
            report["longitude"], report["latitude"], report["track"] + 90.0, 100.0 + 2.0 * second
        )
        displaced = {**report, "icao24": "bbb002", "latitude": y, "longitude": x}
        rate = 60.0 * (altitude(second + 0.5) - altitude(second - 0.5))
        above.append({**displaced, "altitude": altitude(0.0)})
        descending.append({**displaced, "altitude": altitude(second), "vertical_rate": rate})
    assert find_pairs(reports_file(tmp_path, own, above)) == []
    ((_, mine, intruder),) = find_pairs(reports_file(tmp_path, own, descending))
    apart, higher = (
        np.hypot(mine.x - intruder.x, mine.y - intruder.y),
        intruder.altitude - mine.altitude,
    )
    level = np.flatnonzero(abs(higher) <= 300.0)
    assert apart[level].min() == pytest.approx(
        100.0 + 2.0 * (180.0 - 300.0 / (120.0 * FOOT)), abs=3.0
    )


def test_an_early_approach_does_not_hide_a_later_one(tmp_path: Path) -> None:
    """Two aircraft begin beside each other, part, and meet again."""
    first = flight("aaa001", 47.0, 8.0, 90.0, seconds=400)
    second_flight = []
    for second, report in enumerate(first):
        off = 7_000.0 * np.sin(np.pi * second / 350.0) + 200.0
        x, y, _ = WGS84.fwd(report["longitude"], report["latitude"], report["track"] + 90.0, off)
        second_flight.append({**report, "icao24": "bbb002", "latitude": y, "longitude": x})
    for report, (before, after) in zip(
        second_flight[1:-1], zip(second_flight[:-2], second_flight[2:], strict=True), strict=True
    ):
        azimuth, _, length = WGS84.inv(
            *(place[key] for place in (before, after) for key in ("longitude", "latitude"))
        )
        report |= {"track": azimuth % 360.0, "groundspeed": 0.5 * length / (1_852.0 / 3_600.0)}
    ((name, *_),) = find_pairs(reports_file(tmp_path, first, second_flight[1:-1]))
    assert 1_600_000_340 <= int(name.split("-")[-1]) <= 1_600_000_400


OUTLIERS = {
    "a place 40 km away": {"latitude": 47.36},
    "an altitude": {"altitude": 90_000.0},
    "a speed": {"groundspeed": 1_900.0},
    "the Earth's other side": {"longitude": -172.0},
}


@pytest.mark.parametrize("kind", OUTLIERS)
@pytest.mark.parametrize("row", [0, 1, 60, 240])
def test_one_impossible_report_is_refused_or_dropped(tmp_path: Path, kind: str, row: int) -> None:
    first, second = meeting(47.0, 8.0, after=100.0)
    usual = find_pairs(reports_file(tmp_path, first, second))
    second[row] |= OUTLIERS[kind]
    path = reports_file(tmp_path, first, second)
    with pytest.raises(TrackError, match=rf"report 24[2-4]|report {242 + row}"):
        pairs_of(path)
    pairs, repairs = pairs_of(path, repair=True)
    assert repairs == Repairs(impossible=1)
    assert [pair[0] for pair in pairs] == [pair[0] for pair in usual]
    assert tracks(path, repair=True)[1] == Repairs(impossible=1)


def test_two_aircraft_under_one_address_are_kept_apart(tmp_path: Path) -> None:
    first, other_flight = meeting(47.0, 8.0)
    twin = [
        {**report, "icao24": "BBB002", "latitude": report["latitude"] + 0.5}
        for report in other_flight
    ]
    mixed = [report for pair in zip(other_flight, twin, strict=True) for report in pair]
    for reports in (
        mixed,
        [pair[second % 2] for second, pair in enumerate(zip(other_flight, twin, strict=True))],
    ):
        path = reports_file(tmp_path, first, reports)
        with pytest.raises(TrackError, match="report 243"):
            pairs_of(path)
        pairs, repairs = pairs_of(path, repair=True)
        assert [pair[0] for pair in pairs] == ["aaa001-bbb002-1600000060"]
        assert repairs == Repairs(split=1)


@pytest.mark.parametrize("back", [20.0, 90.0])
def test_a_clock_that_goes_back_is_refused_or_counted(tmp_path: Path, back: float) -> None:
    first, second = meeting(47.0, 8.0)
    for report in second[100:]:
        report["timestamp"] -= 1_000.0 * back
    path = reports_file(tmp_path, first, second)
    with pytest.raises(TrackError, match="report 342, field timestamp"):
        pairs_of(path)
    assert pairs_of(path, repair=True)[1] == Repairs(split=1)


def test_a_frozen_position_with_jitter_is_refused(tmp_path: Path) -> None:
    first, other_flight = meeting(47.0, 8.0)
    for second in range(100, 126):
        other_flight[second] |= {
            "latitude": other_flight[100]["latitude"] + 1e-6 * second,
            "longitude": other_flight[100]["longitude"],
        }
    with pytest.raises(TrackError, match=r"report 3\d\d, field latitude"):
        pairs_of(reports_file(tmp_path, first, other_flight))
    assert pairs_of(reports_file(tmp_path, first, other_flight), repair=True)[1] != Repairs()


def test_flights_in_any_order_of_a_file_are_no_fault(tmp_path: Path) -> None:
    early, late = (
        flight("aaa001", 47.0, 8.0, 90.0),
        flight("aaa001", 48.0, 9.0, 0.0, begin=1_600_010_000.0),
    )
    ((_, flights, repairs),) = order_flights(reports_file(tmp_path, late, early), 60.0)
    assert [len(rows) for rows in flights] == [241, 241]
    assert repairs == Repairs()


def test_an_address_in_upper_and_lower_case_is_one(tmp_path: Path) -> None:
    reports = flight("4b0001", 47.0, 8.0, 90.0)
    twice = [{**report, "icao24": " 4B0001"} for report in reports]
    with pytest.raises(TrackError, match="of '4b0001'"):
        pairs_of(reports_file(tmp_path, reports, twice))
    pairs, repairs = pairs_of(reports_file(tmp_path, reports, twice), repair=True)
    assert (pairs, repairs) == ([], Repairs(out_of_order=241))
    path = reports_file(tmp_path, reports[::2], twice[1::2])
    assert [track.name for track in tracks(path, repair=True)[0]] == ["4b0001"]


@pytest.mark.parametrize("value", [True, 1, 1.0, "true", "True"])
def test_aircraft_on_the_ground_do_not_fly(tmp_path: Path, value: object) -> None:
    first, second = meeting(47.0, 8.0)
    path = reports_file(tmp_path, first, [{**report, "onground": value} for report in second])
    assert find_pairs(path) == []
    assert [track.name for track in tracks(path)[0]] == ["aaa001"]


@pytest.mark.parametrize(
    "changes", [{"groundspeed": 250.0}, {"vertical_rate": -640.0}, {"altitude": 17_000.0}]
)
def test_a_flag_that_speed_climb_or_height_contradicts_removes_no_report(
    tmp_path: Path, changes: dict[str, float]
) -> None:
    first, second = meeting(47.0, 8.0)
    rolling = [{**report, "onground": 1} for report in second]
    rolling[7] |= changes
    grounded: Counter[str] = Counter()
    path = reports_file(tmp_path, first, rolling)
    rows = {name: flights for name, flights, _ in order_flights(path, 60.0, grounded=grounded)}
    assert (len(rows["bbb002"][0]), grounded) == (1, {"bbb002": 240})


@pytest.mark.parametrize("name", ["on_ground", "onGround"])
def test_other_spellings_of_onground_are_read(tmp_path: Path, name: str) -> None:
    first, second = meeting(47.0, 8.0)
    assert (
        find_pairs(reports_file(tmp_path, first, [{**report, name: 1} for report in second])) == []
    )


@pytest.mark.parametrize("value", [False, 0, 0.0, "false", None])
def test_aircraft_not_on_the_ground_fly(tmp_path: Path, value: object) -> None:
    first, second = meeting(47.0, 8.0)
    assert (
        len(
            find_pairs(
                reports_file(tmp_path, first, [{**report, "onground": value} for report in second])
            )
        )
        == 1
    )


@pytest.mark.parametrize("value", [2, -1, 0.5, "yes", "1", "", [], {}, float("nan")])
def test_what_is_neither_true_nor_false_is_refused(tmp_path: Path, value: object) -> None:
    first, second = meeting(47.0, 8.0)
    second[7]["onground"] = value
    with pytest.raises(TrackError, match="report 249, field onground"):
        pairs_of(reports_file(tmp_path, first, second))


@pytest.mark.parametrize("latitude", [0.0, 47.0, -80.0])
def test_velocities_away_from_the_reference_follow_the_positions(
    tmp_path: Path, latitude: float
) -> None:
    x, y, _ = WGS84.fwd(8.0, latitude, 90.0, 40_000.0)
    path = reports_file(
        tmp_path, flight("aaa001", latitude, 8.0, 90.0), flight("bbb002", y, x, 20.0)
    )
    for track in tracks(path)[0]:
        course = np.arctan2(np.diff(track.y), np.diff(track.x))
        reported = np.arctan2(track.vy, track.vx)
        assert abs(course - 0.5 * (reported[1:] + reported[:-1])).max() < np.radians(0.01)


@pytest.mark.parametrize("latitude", [47.0, -89.9])
@pytest.mark.parametrize("step", [1.0, 12.0])
@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"groundspeed": 80.0}, "groundspeed: velocities of 'bbb002' make 0.51 .* they in m/s"),
        ({"groundspeed": 288.0}, "groundspeed: velocities of 'bbb002' make 1.85 .* they in km/h"),
        ({"groundspeed": 100.0}, "groundspeed: velocities of 'bbb002' make 0.64 .*expected 1"),
        ({"groundspeed": 0.0}, "groundspeed: velocities of 'bbb002' make 0.00 times"),
        ({"track": -25.0}, "track: velocities of 'bbb002' point 25 deg to the left of .* heading"),
    ],
)
def test_wrong_velocities_of_a_whole_flight_are_refused_or_taken_from_positions(
    tmp_path: Path, changes: dict[str, float], sentence: str, step: float, latitude: float
) -> None:
    right = flight("bbb002", latitude, 8.0, 40.0, step=step)
    wrong = [dict(report) for report in right]
    for report in wrong:
        report["groundspeed"] = changes.get("groundspeed", report["groundspeed"])
        report["track"] = (report["track"] + changes.get("track", 0.0)) % 360.0
    path = reports_file(tmp_path, wrong)
    with pytest.raises(TrackError, match=sentence):
        tracks(path, max_gap=20.0)
    (repaired,), repairs = tracks(path, max_gap=20.0, repair=True)
    assert repairs == Repairs(velocity=len(right))
    ((true,), _) = tracks(reports_file(tmp_path, right), max_gap=20.0)
    assert np.hypot(repaired.vx - true.vx, repaired.vy - true.vy).max() < 3.0


def test_wrong_velocities_of_a_few_seconds_are_no_wrong_unit(tmp_path: Path) -> None:
    first, second = meeting(47.0, 8.0)
    for report in second[30:75]:
        report["groundspeed"] /= 1.5
    assert tracks(reports_file(tmp_path, first, second))[1] == Repairs()


HEAD_ON = ("aaa001-bbb002-1600000060",)
CASES = {
    "ok": (HEAD_ON, HEAD_ON),
    "altspike1": (None, HEAD_ON),
    "antimeridian_0.5": (("aaa001-bbb002-1600000141",), ("aaa001-bbb002-1600000141",)),
    "antimeridian_min": (("aaa001-bbb002-60",), ("aaa001-bbb002-60",)),
    "antipode": ((), ()),
    "case": (None, ()),
    "clockback": (None, HEAD_ON),
    "foreshortened": ((), ()),
    "onground_int": ((), ()),
    "outlier": (None, ()),
    "overflight": (("aaa001-bbb002-1600000300",), ("aaa001-bbb002-1600000300",)),
    "shared_address": (None, ("aaa001-dup000-1600000239",)),
}
"""Pairs found as the file is (None: refused), and with repairs."""


@pytest.mark.parametrize("name", CASES)
def test_cases_of_public_reports(name: str) -> None:
    path, (plain, repaired) = case(f"adsb_{name}.json.gz"), CASES[name]
    if plain is None:
        with pytest.raises(TrackError, match=r"report \d+, field (latitude|altitude|timestamp)"):
            pairs_of(path)
    else:
        assert tuple(pair[0] for pair in find_pairs(path)) == plain
    pairs, repairs = pairs_of(path, repair=True)
    assert tuple(pair[0] for pair in pairs) == repaired
    assert any(repairs) == (plain is None)
