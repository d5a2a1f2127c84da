"""Recorded tracks: units are honoured, nothing is repaired in silence, and a bad file is refused by
line and field.
"""

import copy
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from envs.aircraft import PAPER
from envs.formats.lincoln_file import EVENTS, LincolnEncounter, read_lincoln, tracks_of
from envs.formats.local_frame import local
from envs.formats.track_files import read_daidalus
from envs.traffic.replay import replay
from envs.traffic.track_units import FAMILIES, KNOT, si
from envs.traffic.tracks import Repairs, TrackError, at_times
from envs.traffic.velocities import UNITS
from tests.support import WGS84, flight, recorded_path

LOCAL = """\
# made by hand
NAME, sx, sy, sz, trk, gs, vs, time
[none], [nmi], [km], [ft], [deg], [knot], [fpm], [ms]
own, 0, 0, 1000, 90, 100, 600, 1000
other, 1, 2, 2000, 180, 200, -600, 1000   # a remark
own, 0.0277778, 0, 1010, 90, 100, 600, 2000
other, 1, 1.897, 1990, 180, 200, -600, 2000
"""
GEOGRAPHIC = """\
NAME lat lon alt vx vy vz time
unitless [deg] [deg] [m] [m/s] [m/s] [m/s] [s]
own 40.0 -74.0 1000 50 0 0 0
other 40.01 -74.0 1000 0 -50 0 0
own 40.0 -73.9994144 1000 50 0 0 1
other 40.00955 -74.0 1000 0 -50 0 1
"""


def write_file(tmp_path: Path, text: str, name: str = "tracks.daa") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_local_tracks_by_hand(tmp_path: Path) -> None:
    (own, intruder), repairs = read_daidalus(write_file(tmp_path, LOCAL))
    assert repairs == Repairs()
    assert (own.name, intruder.name) == ("own", "other")
    assert own.time.tolist() == [1.0, 2.0]
    assert intruder.x == pytest.approx([1852.0, 1852.0])
    assert intruder.y == pytest.approx([2000.0, 1897.0])
    assert own.altitude == pytest.approx([304.8, 307.848])
    assert own.vx == pytest.approx([100 * KNOT] * 2)
    assert own.vy == pytest.approx([0.0, 0.0], abs=1e-9)
    assert intruder.vy == pytest.approx([-200 * KNOT] * 2)
    assert intruder.vertical_rate == pytest.approx([-3.048] * 2)


def test_geographic_tracks_are_local_to_the_ownship(tmp_path: Path) -> None:
    own, intruder = read_daidalus(write_file(tmp_path, GEOGRAPHIC)).tracks
    assert (own.x[0], own.y[0]) == (0.0, 0.0)
    # A degree of latitude is 111 035 m here, one of longitude 85 394 m (Clarke's series for WGS
    # 84).
    assert intruder.y[0] == pytest.approx(1_110.35, abs=0.05)
    assert own.x[1] == pytest.approx(50.0, abs=0.02)


def test_units_scale_and_nothing_else(tmp_path: Path) -> None:
    feet = LOCAL.replace("[km]", "[ft]").replace("[ms]", "[s]").replace(", 2000\n", ", 1001\n")
    own, intruder = read_daidalus(write_file(tmp_path, feet)).tracks
    assert intruder.y == pytest.approx(np.array([2.0, 1.897]) * 0.3048)
    assert own.time.tolist() == [1000.0, 1001.0]
    assert si("KNOT", "speed") == si("kts", "speed") == KNOT
    assert si("knot", "length") is None
    assert all(scale > 0.0 for family in FAMILIES.values() for scale in family.values())


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[nmi], ", "", r"line 3: 7 units, expected 8, one in brackets a name"),
        (
            "[nmi]",
            "[furlong]",
            r"line 3, field sx: unit '\[furlong\]', expected one in brackets of m, km, ft",
        ),
        (
            "[nmi]",
            "[knot]",
            r"line 3, field sx: unit '\[knot\]', expected one in brackets of m, km",
        ),
        ("[nmi]", "nmi", r"line 3, field sx: unit 'nmi', expected one in brackets"),
        ("[nmi]", "[none]", r"line 3, field sx: unit '\[none\]'"),
        (
            "[none], [nmi], [km], [ft], [deg], [knot], [fpm], [ms]\n",
            "",
            r"line 3, field name: unit 'own'",
        ),
        ("trk", "course", r"line 2: column 'course' is unknown"),
        ("NAME, sx", "sx, sx", r"line 3, field sx: unit '\[none\]'"),
        ("sx, sy", "sx, vx", r"line 3, field vx: unit '\[km\]'"),
        ("other, 1, 2,", "other, 1,", r"line 5: 7 fields, expected 8"),
        ("other, 1, 2,", "other, one, 2,", r"line 5, field sx: 'one', expected a number"),
        ("other, 1, 2,", ", 1, 2,", r"line 5, field name: empty"),
        ("other, 1, 2,", "other, nan, 2,", r"line 5, field sx: nan, expected a finite number"),
        ("other, 1, 2,", "other, inf, 2,", r"line 5, field sx: inf, expected a finite number"),
        (
            "600, 2000\n",
            "600, 1000\n",
            r"line 6, field time: 1 s of 'own', expected more than 1 s as in line 4",
        ),
        (
            "600, 2000\n",
            "600, 500\n",
            r"line 6, field time: 0.5 s of 'own', expected more than 1 s",
        ),
        (
            "600, 2000\n",
            "600, 9000\n",
            r"line 6, field time: a gap of 8 s in the track of 'own', expected at most 5 s",
        ),
    ],
)
def test_a_bad_file_is_refused_by_line_and_field(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    assert old in LOCAL
    with pytest.raises(TrackError, match="tracks.daa " + sentence):
        read_daidalus(write_file(tmp_path, LOCAL.replace(old, new, 1)))


@pytest.mark.parametrize("row", [2, 3, 4, 5])
@pytest.mark.parametrize(
    ("column", "value", "names"),
    [
        ("lat", "100", "lat"),
        ("lat", "-1e308", "lat"),
        ("lon", "361", "lon"),
        ("alt", "1e308", "alt"),
        ("alt", "-6000", "alt"),
        ("vx", "1e9", "vx"),
        ("vz", "-300", "vs"),
        ("time", "1e300", "time"),
    ],
)
def test_every_row_of_every_aircraft_keeps_to_the_ranges(
    tmp_path: Path, row: int, column: str, value: str, names: str
) -> None:
    lines = GEOGRAPHIC.splitlines()
    cells = lines[row].split()
    cells[lines[0].split().index(column)] = value
    lines[row] = " ".join(cells)
    with pytest.raises(TrackError, match=f"line {row + 1}, field {names}: .*, expected -"):
        read_daidalus(write_file(tmp_path, "\n".join(lines)))


def test_negative_speeds_and_degrees_for_radians_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match="line 5, field gs: -200, expected 0 to 2000"):
        read_daidalus(write_file(tmp_path, LOCAL.replace("180, 200", "180, -200", 1)))
    with pytest.raises(
        TrackError, match=r"line 4, field trk: 90, expected .* \(are these degrees\?\)"
    ):
        read_daidalus(write_file(tmp_path, LOCAL.replace("[deg]", "[rad]")))


def test_names_that_differ_in_case_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        TrackError, match=r"field name: .* expected no two that differ only in case"
    ):
        read_daidalus(write_file(tmp_path, LOCAL.replace("other, 1, 2", "OWN, 1, 2")))


@pytest.mark.parametrize("latitude", [0.0, 47.0, 80.0])
def test_velocities_are_turned_into_the_local_frame(tmp_path: Path, latitude: float) -> None:
    """Of an intruder 40 km east of the ownship, in both forms of a velocity."""
    x, y, _ = WGS84.fwd(8.0, latitude, 90.0, 40_000.0)
    reports = [
        *flight("own", latitude, 8.0, 90.0, seconds=60),
        *flight("other", y, x, 20.0, seconds=60),
    ]
    polar = ["NAME lat lon alt trk gs vs time", "unitless [deg] [deg] [ft] [deg] [kt] [fpm] [s]"]
    parts = ["NAME lat lon alt vx vy vs time", "unitless [deg] [deg] [ft] [kt] [kt] [fpm] [s]"]
    for report in reports:
        track, speed = math.radians(report["track"]), report["groundspeed"]
        start = f"{report['icao24']} {report['latitude']:.12f} {report['longitude']:.12f} 3000"
        end = f"0 {report['timestamp'] / 1e3:.3f}"
        polar.append(f"{start} {report['track']:.12f} {speed:.12f} {end}")
        parts.append(f"{start} {speed * math.sin(track):.12f} {speed * math.cos(track):.12f} {end}")
    for lines in (polar, parts):
        for track in read_daidalus(write_file(tmp_path, "\n".join(lines))).tracks:
            flown = np.arctan2(np.diff(track.y), np.diff(track.x))
            assert abs(flown - np.arctan2(track.vy, track.vx)[1:]).max() < math.radians(0.01)


@pytest.mark.parametrize(
    ("missing", "sentence"),
    [
        ("sz", "column alt is missing"),
        ("vs", "column vs is missing"),
        ("time", "column time is missing"),
        ("gs", "expected the columns trk and gs or vx and vy"),
        ("sy", "expected the columns lat and lon or sx and sy"),
    ],
)
def test_a_missing_column_is_named(tmp_path: Path, missing: str, sentence: str) -> None:
    head = LOCAL.splitlines()[1].split(", ")
    at = head.index(missing)
    lines = [LOCAL.splitlines()[0]]
    for line in LOCAL.splitlines()[1:]:
        cells = line.split("#")[0].split(",")
        lines.append(",".join(cells[:at] + cells[at + 1 :]))
    with pytest.raises(TrackError, match=sentence):
        read_daidalus(write_file(tmp_path, "\n".join(lines)))


def test_repairs_are_made_on_request_and_counted(tmp_path: Path) -> None:
    row = "own, {x}, {y}, 0, {trk}, 100, 0, {time}\n"
    north = 16e-3 * 100 * KNOT  # km in 16 s
    text = "\n".join(LOCAL.splitlines()[:3]) + "\n"
    text += row.format(x=0, y=0, trk=350, time=0) + row.format(x="nan", y=0, trk=350, time=1000)
    text += row.format(x=0, y=0, trk=350, time=0) + row.format(x=0, y=north, trk=10, time=16_000)
    with pytest.raises(TrackError, match="line 5, field sx"):
        read_daidalus(write_file(tmp_path, text))
    (own,), repairs = read_daidalus(write_file(tmp_path, text), repair=True, max_gap=5.0)
    assert repairs == Repairs(not_finite=1, out_of_order=1, filled=3)
    assert own.time.tolist() == [0.0, 16.0]
    # From 350 to 10 degrees through north, the short way.
    middle = at_times(own, np.array([8.0]))
    assert middle.y == pytest.approx(500.0 * north)
    assert middle.vx == pytest.approx(0.0, abs=1e-9)
    assert middle.vy == pytest.approx(100 * KNOT, rel=0.01)
    with pytest.raises(TrackError, match="no row of 'own' is left"):
        read_daidalus(write_file(tmp_path, text.replace("100, 0", "nan, 0")), repair=True)
    reading = read_daidalus(
        write_file(tmp_path, text.replace("nan", "0")), repair=True, max_gap=100.0
    )
    assert reading.repairs == Repairs(out_of_order=1)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(
    st.integers(0, len(LOCAL)),
    st.sampled_from(["", "x", ",", "\n", "-", "9", "[", "\x00", "é"]),
    st.booleans(),
)
def test_a_damaged_file_is_read_or_refused_with_a_sentence(
    tmp_path: Path, at: int, inserted: str, cut: bool
) -> None:
    text = LOCAL[:at] + inserted + ("" if cut else LOCAL[at + 1 :])
    try:
        tracks, _ = read_daidalus(write_file(tmp_path, text))
    except TrackError as problem:
        assert "tracks.daa" in str(problem)
        assert "\n" not in str(problem)
    else:
        for track in tracks:
            assert all(np.isfinite(field).all() for field in track[1:8])
            assert (np.diff(track.time) > 0.0).all()


def test_what_is_no_file_of_tracks(tmp_path: Path) -> None:
    with pytest.raises(TrackError, match="there is no such file"):
        read_daidalus(tmp_path / "absent.daa")
    with pytest.raises(TrackError, match="0 lines, expected"):
        read_daidalus(write_file(tmp_path, ""))
    (tmp_path / "binary.daa").write_bytes(b"\xff\xff")
    with pytest.raises(TrackError, match="not a text in UTF-8"):
        read_daidalus(tmp_path / "binary.daa")
    with pytest.raises(TrackError, match="line 3, field lat: 140"):
        read_daidalus(write_file(tmp_path, GEOGRAPHIC.replace("own 40.0", "own 140.0", 1)))
    with pytest.raises(TrackError, match="max_gap is nan"):
        read_daidalus(write_file(tmp_path, LOCAL), max_gap=math.nan)


def test_tracks_at_other_times(tmp_path: Path) -> None:
    own = read_daidalus(write_file(tmp_path, LOCAL)).tracks[0]
    middle = at_times(own, np.array([1.25, 1.5]))
    assert middle.x == pytest.approx(own.x[1] * np.array([0.25, 0.5]), rel=1e-3)
    with pytest.raises(TrackError, match="covers 1 to 2 s"):
        at_times(own, np.array([1.5, 2.5]))


@pytest.mark.parametrize(
    ("unit", "factor"), [("m/s", "1.94"), ("km/h", "0.54"), ("ft/s", "0.59"), ("nmi/h", "")]
)
def test_a_file_of_velocities_in_a_wrong_unit_is_refused_or_repaired(
    tmp_path: Path, unit: str, factor: str
) -> None:
    file = recorded_path("daidalus_scenarios/scenario_5.daa")
    right = read_daidalus(file).tracks
    path = write_file(tmp_path, file.read_text().replace("[knot]", f"[{unit}]", 1))
    if not factor:  # it is the right one
        assert read_daidalus(path).repairs == Repairs()
        return
    sentence = rf"line 3, field gs: velocities of 'ownship' make {factor} times .*are they in kt"
    with pytest.raises(TrackError, match=sentence):
        read_daidalus(path)
    tracks, repairs = read_daidalus(path, repair=True)
    assert repairs == Repairs(velocity=sum(len(track.time) for track in right))
    for repaired, true in zip(tracks, right, strict=True):
        off = np.hypot(repaired.vx - true.vx, repaired.vy - true.vy)
        assert np.median(off) < 0.3
        assert off.max() < 10.0  # where a turn begins and ends


@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_the_local_frame_is_a_sphere_s_but_for_the_flattening(lat, lon, north, east) -> None:
    reference = math.radians(lat), math.radians(lon)
    x, y, _ = local(
        reference[0] + math.radians(north), reference[1] + math.radians(east), reference
    )
    radius = 6_371_000.0
    down = math.radians(north) * radius
    # Chords instead of arcs, convergence of the meridians, and 0.7 % for the ellipsoid.
    across = math.radians(east) * radius * math.cos(reference[0] + math.radians(north))
    bent = across * math.radians(east) * math.sin(reference[0]) / 2.0
    size = math.hypot(down, across) + 1.0
    assert abs(float(y) - down - bent) < 0.008 * size
    assert abs(float(x) - across) < 0.008 * size


@pytest.mark.parametrize(
    "name", ["C1_0_120.daa", "H0_0_120.daa", "H0_0_120.xyz", "H1.daa", "scenario_5.daa"]
)
def test_recorded_velocities_are_the_change_of_positions(name: str) -> None:
    for track in read_daidalus(recorded_path(f"daidalus_scenarios/{name}")).tracks:
        dt = np.diff(track.time)
        vx, vy = 0.5 * (track.vx[1:] + track.vx[:-1]), 0.5 * (track.vy[1:] + track.vy[:-1])
        off = np.hypot(np.diff(track.x) / dt - vx, np.diff(track.y) / dt - vy)
        # The files' own projection of speeds to positions is a sphere's.
        assert np.median(off) < 0.006 * np.hypot(vx, vy).max()


def test_every_recorded_scenario_is_read() -> None:
    folder = recorded_path("daidalus_scenarios")
    paths = sorted(path for path in folder.iterdir() if re.fullmatch(r"\.(daa|xyz)", path.suffix))
    assert len(paths) == 12
    for path in paths:
        tracks, repairs = read_daidalus(path)
        assert repairs == Repairs()
        assert len(tracks) == (4 if path.stem == "MultiAircraft" else 2)
        assert all((np.diff(track.time) == pytest.approx(1.0)) for track in tracks)
    # Same encounter in both forms, but for the projection.
    flat, round_ = (read_daidalus(folder / f"H0_0_120.{kind}").tracks for kind in ("xyz", "daa"))
    for a, b in zip(flat, round_, strict=True):
        off = np.hypot(a.x - flat[0].x[0] - b.x, a.y - flat[0].y[0] - b.y)
        assert off.max() < 60.0


# Lincoln Laboratory's encounters: read in SI units, flown as published, replayed, and refused where
# malformed.


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


def write_lincoln(tmp_path: Path, content) -> Path:
    path = tmp_path / "encounters.json"
    path.write_text(json.dumps(content))
    return path


def test_an_encounter_by_hand(tmp_path: Path) -> None:
    (encounter,) = read_lincoln(write_lincoln(tmp_path, [ONE]))
    assert (encounter.number, encounter.weight, encounter.time) == (7, 2.5, pytest.approx(10.0))
    assert encounter.miss == pytest.approx(500.0 * FOOT)
    own, intruder = tracks_of(encounter)
    assert own.time[[0, -1]] == pytest.approx([0.0, 60.0])
    # Straight north for 10 s, then a right turn of radius v / w.
    assert (own.x[100], own.y[100]) == pytest.approx((0.0, 2_000.0 * FOOT))
    turned, radius = 0.05 * 20.0, 200.0 / 0.05 * FOOT
    assert own.x[300] == pytest.approx(radius * (1 - math.cos(turned)), rel=1e-5)
    assert own.y[300] == pytest.approx(2_000.0 * FOOT + radius * math.sin(turned), rel=1e-5)
    assert (own.vx[300], own.vy[300]) == pytest.approx(
        (200 * FOOT * math.sin(turned), 200 * FOOT * math.cos(turned))
    )
    # South, climbing at 20 ft/s, 1 ft/s faster each second along the path.
    assert intruder.altitude[600] == pytest.approx((3_000.0 + 20.0 * 60.0) * FOOT)
    assert intruder.vy[600] == pytest.approx(-math.sqrt(310.0**2 - 20.0**2) * FOOT)
    assert intruder.y[600] == pytest.approx(
        (10_000.0 - (250.0 * 60 + 0.5 * 60**2)) * FOOT, rel=0.02
    )


def miss(encounter: LincolnEncounter) -> float:
    """Return the horizontal distance of the flown tracks at the published time of closest approach,
    m.
    """
    own, intruder = tracks_of(encounter)
    row = min(round(10.0 * encounter.time), len(own.time) - 1)
    return math.hypot(intruder.x[row] - own.x[row], intruder.y[row] - own.y[row])


def test_flights_meet_the_published_miss_distances() -> None:
    encounters = read_lincoln(recorded_path("lincoln_lab/encounters.json"))
    assert len(encounters) == 50
    errors_ft = [abs(miss(encounter) - encounter.miss) / FOOT for encounter in encounters]
    # Some tracks exceed what the models' own vehicle could fly: the median is what can be judged.
    assert np.median(errors_ft) <= 30.0


@pytest.mark.parametrize(
    ("unit", "question"), [("kt", "are they in kt"), ("m/s", "are they in m/s"), (None, "300 m$")]
)
def test_speeds_that_miss_the_published_distances_are_refused(
    tmp_path: Path, unit: str | None, question: str
) -> None:
    content = json.loads(recorded_path("lincoln_lab/encounters.json").read_text())
    factor = 2.7 if unit is None else FOOT / UNITS[unit]
    for encounter in content:
        encounter["v_ftps"] = [factor * speed for speed in encounter["v_ftps"]]
    with pytest.raises(TrackError, match=rf"field v_ftps: .* of 50 encounters .*{question}"):
        read_lincoln(write_lincoln(tmp_path, content))
    assert len(read_lincoln(write_lincoln(tmp_path, content[:4]))) == 4


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda one: one.pop("v_ftps"), "encounter 1, field v_ftps: expected a pair of numbers"),
        (lambda one: one["n_ft"].append(1.0), "encounter 1, field n_ft: expected a pair"),
        (
            lambda one: one["n_ft"].__setitem__(0, "far"),
            "encounter 1, field n_ft: 'far', expected a finite number",
        ),
        (lambda one: one["v_ftps"].__setitem__(0, -1.0), "field v_ftps: -1, expected 0 to "),
        (
            lambda one: one.update(heading_rad=[90, 270]),
            "field heading_rad: 90, expected -6.28319 to 6.28319 (are these",
        ),
        (
            lambda one: one["h_ft"].__setitem__(1, 1e11),
            "field h_ft: 1e+11, expected -5000 to 100000",
        ),
        (
            lambda one: one["e_ft"].__setitem__(1, 1e308),
            "field e_ft: 1e+308, expected a finite number",
        ),
        (
            lambda one: one[EVENTS][0][1].__setitem__(2, 3.0),
            "row 2, turn rate: 3, expected -1 to 1 (are these",
        ),
        (
            lambda one: one[EVENTS][0][1].__setitem__(3, 100.0),
            "row 2: leads to the speed 5200, expected 0 to",
        ),
        (
            lambda one: one[EVENTS][1][0].__setitem__(1, -900.0),
            "row 1: leads to the altitude -51000, expected -5000",
        ),
        (lambda one: one.update(runTime_s=0), "field runTime_s: 0, expected more than 0"),
        (lambda one: one.update(id=1.5), "field id: 1.5, expected a whole number"),
        (lambda one: one["v_ftps"].__setitem__(0, 10**400), "expected a finite number"),
        (lambda one: one.update(id=None), "field id: None, expected a finite number"),
        (
            lambda one: one.update({EVENTS: [[]]}),
            "expected a list of events for each of two aircraft",
        ),
        (lambda one: one[EVENTS][0][1].pop(), "ownship's events, row 2: expected 4 numbers"),
        (
            lambda one: one[EVENTS][0][1].__setitem__(0, -1.0),
            "ownship's events, row 2, time: -1 s, expected more than 0 s",
        ),
        (
            lambda one: one[EVENTS][1][0].__setitem__(3, True),
            "intruder's events, row 1, acceleration: True",
        ),
        (lambda one: one["meta"].update(hmd="near"), "field hmd: 'near'"),
        (lambda one: one["meta"].update(w=-1.0), "field w: -1, expected a positive weight"),
    ],
)
def test_a_malformed_encounter_is_refused_by_field(tmp_path: Path, change, sentence: str) -> None:
    encounter = copy.deepcopy(ONE)
    change(encounter)
    with pytest.raises(TrackError, match=r"encounters\.json") as refused:
        read_lincoln(write_lincoln(tmp_path, [encounter]))
    assert sentence in str(refused.value)


def test_what_is_no_file_of_encounters(tmp_path: Path) -> None:
    path = write_lincoln(tmp_path, [ONE])
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
            read_lincoln(write_lincoln(tmp_path, content))
    with pytest.raises(TrackError, match="encounter 2, field id: 7 stands twice"):
        read_lincoln(write_lincoln(tmp_path, [ONE, ONE]))
    with pytest.raises(TrackError, match="expected an object"):
        read_lincoln(write_lincoln(tmp_path, [3]))


def test_a_replay_is_the_track_and_straight_on_after_it(tmp_path: Path) -> None:
    (encounter,) = read_lincoln(write_lincoln(tmp_path, [ONE]))
    own, intruder = tracks_of(encounter)
    replayed = replay([("seven", own, [intruder])], PAPER, 100.0)
    assert replayed.names == ("seven",)
    assert replayed.left_out == ()
    starts, recorded_states = replayed.starts, replayed.starts.intent
    assert starts.goal_y[0] == pytest.approx(100.0 * 200.0 * FOOT)
    assert starts.own.heading[0] == pytest.approx(math.pi / 2)
    seconds = np.arange(61)
    assert recorded_states.x[0, 0, :61] == pytest.approx(intruder.x[10 * seconds])
    assert recorded_states.y[0, 0, :61] == pytest.approx(intruder.y[10 * seconds])
    beyond = np.arange(1, 41)
    assert recorded_states.y[0, 0, 61:101] == pytest.approx(
        intruder.y[-1] + intruder.vy[-1] * beyond
    )
    assert recorded_states.speed[0, 0, 100] == pytest.approx(
        np.hypot(intruder.vx[-1], intruder.vy[-1])
    )


def test_what_cannot_be_flown_is_left_out_with_the_reason(tmp_path: Path) -> None:
    slow, fast = copy.deepcopy(ONE), copy.deepcopy(ONE)
    slow["v_ftps"][0] = 100.0
    fast["v_ftps"][1] = 600.0
    slow["id"], fast["id"] = 8, 9
    read_encounters = read_lincoln(write_lincoln(tmp_path, [ONE, slow, fast]))
    encounters = [
        (name, *((own, [intruder]) for own, intruder in [tracks_of(encounter)]))
        for name, encounter in zip("abc", read_encounters, strict=True)
    ]
    replayed = replay([(name, *pair) for name, pair in encounters], PAPER, 220.0)
    assert replayed.names == ("a",)
    assert (
        "b: the ownship begins with 30.5 m/s over the ground, expected 50 to 100 m/s"
        in replayed.left_out[0]
    )
    assert "c: 'intruder' flies at" in replayed.left_out[1]
    with pytest.raises(TrackError, match="no encounter can be flown; the first: b"):
        replay([(name, *pair) for name, pair in encounters[1:]], PAPER, 220.0)
