"""A user's encounters survive the way to a CSV file and back; files that cannot be read are refused
by every reader.
"""

import gzip
import math
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from commands.text_file import json_of, lines_of, text_of
from envs.aircraft import PAPER
from envs.draws import uniforms
from envs.encounters import Encounter, EncounterError
from envs.formats import encounter_file
from envs.formats.encounter_file import COLUMNS, MOST_INTRUDERS, read, write
from envs.formats.lincoln_file import read_lincoln
from envs.formats.track_files import read_daidalus
from envs.intruder import Intent
from envs.kinematics import VehicleState
from envs.perception import Sensor
from envs.scenarios import SCENARIOS, sample, scenario
from envs.traffic.encounter_model import read_model
from envs.traffic.tracks import TrackError
from tests.envs.formats.test_adsb_file import pairs_of

HEADER = (
    "encounter,own_x_m,own_y_m,own_heading_deg,own_speed_m_s,goal_x_m,goal_y_m,"
    "intruder_x_m,intruder_y_m,intruder_heading_deg,intruder_speed_m_s"
)
ROW = "a,-5000,0,0,75,5000,0,0,5000,-90,75"
position = st.floats(-1e6, 1e6)
heading = st.floats(-math.pi, math.pi, exclude_max=True)
intruder_values = st.tuples(
    position, position, heading, st.floats(0, 150), st.floats(0, 300), heading, st.floats(0.01, 0.5)
)
encounter_values = st.tuples(
    st.tuples(position, position, heading, st.floats(50, 100), position, position),
    st.tuples(st.floats(0, 100), st.floats(0, 10), st.floats(0, 2)),
    st.lists(intruder_values, min_size=1, max_size=4),
)


def build(values) -> Encounter:
    """Return the encounters of the drawn values, absent intruders marked by not-a-number."""
    most = max(len(v[2]) for v in values)
    own = np.array([v[0] for v in values]).T
    sensor = np.array([v[1] for v in values]).T[:, :, None]
    absent = (math.nan,) * 7
    intruders = np.moveaxis(np.array([v[2] + [absent] * (most - len(v[2])) for v in values]), -1, 0)
    return Encounter(
        VehicleState(*own[:4]),
        own[4],
        own[5],
        VehicleState(*intruders[:4]),
        ~np.isnan(intruders[0]),
        Intent(*intruders[4:]),
        Sensor(*sensor),
    )


@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(values=st.lists(encounter_values, min_size=1, max_size=5))
def test_round_trip(values, tmp_path: Path) -> None:
    before = build(values)
    names = [f"no. {i}, {'ü' * (i + 1)}" for i in range(len(values))]
    write(tmp_path / "encounters.csv", before, names)
    after, names_after = read(tmp_path / "encounters.csv")
    assert names_after == names
    np.testing.assert_array_equal(after.mask, before.mask)
    members = before.mask

    def assert_same(a: np.ndarray, b: np.ndarray, *, angle: bool = False) -> None:
        difference = np.abs(a - b)
        if angle:
            difference = np.minimum(difference, 2 * math.pi - difference)
        assert np.all(difference <= 1e-14 * np.maximum(np.abs(a), 1.0))

    assert_same(before.goal_x, after.goal_x)
    assert_same(before.goal_y, after.goal_y)
    for field in VehicleState._fields:
        assert_same(getattr(before.own, field), getattr(after.own, field), angle=field == "heading")
        pair = (getattr(e.intruders, field)[members] for e in (before, after))
        assert_same(*pair, angle=field == "heading")
    for field in Intent._fields:
        pair = (getattr(e.intent, field)[members] for e in (before, after))
        assert_same(*pair, angle=field == "heading_change")
    for field in Sensor._fields:
        assert_same(getattr(before.sensor, field), getattr(after.sensor, field))
    assert all(np.isfinite(field).all() for field in (*after.intruders, *after.intent))


@pytest.mark.parametrize("name", SCENARIOS)
def test_sampled_encounters_round_trip(name: str, tmp_path: Path) -> None:
    family = scenario(name, PAPER)
    draws = uniforms(3, 0, 20, (family.attempts, family.dimensions)).swapaxes(0, 1)
    before, _ = sample(family, draws, np)
    write(tmp_path / "e.csv", before)
    after, _ = read(tmp_path / "e.csv")
    most = after.mask.shape[1]
    np.testing.assert_array_equal(after.mask, before.mask[:, :most])
    np.testing.assert_allclose(after.own.heading, before.own.heading, rtol=1e-14)
    np.testing.assert_array_equal(after.own.x, before.own.x)
    np.testing.assert_array_equal(after.goal_y, before.goal_y)
    shape = before.sensor.latency.shape
    np.testing.assert_array_equal(
        np.broadcast_to(after.sensor.latency, shape), before.sensor.latency
    )


def test_rows_need_not_stand_together_and_comments_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "e.csv"
    path.write_text(
        f"# mine\n{HEADER}\n{ROW}\n\nb,-6000,0,0,60,5000,0,0,5000,-90,75\n{ROW}\n", encoding="utf-8"
    )
    encounters, names = read(path)
    assert names == ["a", "b"]
    assert encounters.mask.tolist() == [[True, True], [True, False]]
    assert encounters.own.speed.tolist() == [75.0, 60.0]
    assert encounters.intruders.heading[0].tolist() == [-math.pi / 2] * 2
    assert encounters.intent.turn_rate[0, 0] == math.radians(3.0)


def test_columns_in_any_order_and_a_byte_order_mark(tmp_path: Path) -> None:
    names, cells = HEADER.split(","), ROW.split(",")
    path = tmp_path / "e.csv"
    path.write_text(
        ",".join(names[::-1]) + "\r\n" + ",".join(cells[::-1]) + "\r\n", encoding="utf-8-sig"
    )
    encounters, _ = read(path)
    assert encounters.own.x[0] == -5000.0


def test_own_speed_range_follows_the_vehicle(tmp_path: Path) -> None:
    path = tmp_path / "e.csv"
    path.write_text(f"{HEADER}\n{ROW.replace(',75,5000', ',40,5000')}\n", encoding="utf-8")
    with pytest.raises(
        EncounterError, match="own_speed_m_s: '40', expected a number from 50 to 100"
    ):
        read(path, PAPER)
    slower = PAPER._replace(limits=PAPER.limits._replace(speed_min=31.0))
    for encounters, _ in (read(path, slower), read(path)):
        assert encounters.own.speed[0] == 40.0


def replace_cell(column: str, text: str) -> str:
    cells = dict(zip(HEADER.split(","), ROW.split(","), strict=True)) | {column: text}
    return f"{HEADER}\n{','.join(cells.values())}\n"


MISTAKES = {
    "nan": (
        replace_cell("own_x_m", "nan"),
        "line 2, column own_x_m: 'nan', expected a number from -1e",
    ),
    "inf": (replace_cell("goal_y_m", "inf"), "line 2, column goal_y_m: 'inf', expected"),
    "text": (
        replace_cell("intruder_speed_m_s", "fast"),
        "column intruder_speed_m_s: 'fast', expected a number from 0 to 400",
    ),
    "underscore": (replace_cell("own_y_m", "1_0"), "column own_y_m: '1_0'"),
    "range": (
        replace_cell("own_heading_deg", "361"),
        "column own_heading_deg: '361', expected a number from -360 to 360",
    ),
    "empty cell": (
        replace_cell("own_x_m", " "),
        "line 2, column own_x_m: empty, expected a number",
    ),
    "empty name": (replace_cell("encounter", " "), "line 2, column encounter: empty"),
    "unknown column": (
        f"{HEADER},latency\n{ROW},1\n",
        "line 1: column 'latency' is unknown; did you mean latency_s?",
    ),
    "odd column": (
        f"{HEADER},zzz\n{ROW},1\n",
        "column 'zzz' is unknown; expected some of encounter, own_x_m",
    ),
    "double column": (f"{HEADER},own_x_m\n{ROW},1\n", "line 1: column own_x_m stands twice"),
    "missing column": (
        f"{HEADER.replace(',goal_x_m', '')}\n{ROW}\n",
        "line 1: column goal_x_m is missing",
    ),
    "short row": (f"{HEADER}\n{ROW[:-3]}\n", "line 2: 10 cells, expected 11"),
    "long row": (f"{HEADER}\n{ROW},7\n", "line 2: 12 cells, expected 11"),
    "empty": ("", "the file is empty, expected a header line with encounter"),
    "no rows": (f"{HEADER}\n", "no encounter, expected at least one line"),
    "disagreement": (
        f"{HEADER}\n{ROW}\n{ROW.replace('-5000', '-5001')}\n",
        "line 3, column own_x_m: -5001.0, expected -5000.0 as in line 2, the first of encounter "
        "'a'",
    ),
    "quotes": (f'{HEADER}\n"a"b,{ROW[2:]}\n', "not a CSV file"),
    "too many": (
        f"{HEADER}\n" + f"{ROW}\n" * (MOST_INTRUDERS + 1),
        "encounter 'a' has more than 64 intruders",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(mistake: str, tmp_path: Path) -> None:
    text, message = MISTAKES[mistake]
    path = tmp_path / "mine.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(EncounterError) as caught:
        read(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(EncounterError, match=r"none\.csv: there is no such file"):
        read(tmp_path / "none.csv")
    with pytest.raises(EncounterError, match="cannot be read"):
        read(tmp_path)
    (tmp_path / "latin.csv").write_bytes(b"encounter\n\xfc\n")
    with pytest.raises(EncounterError, match=r"not a text in UTF-8 \(byte 10\)"):
        read(tmp_path / "latin.csv")


def test_writing_refuses_what_would_not_come_back(tmp_path: Path) -> None:
    draws = uniforms(3, 0, 2, (8, scenario("circle", PAPER).dimensions)).swapaxes(0, 1)
    encounters, _ = sample(scenario("circle", PAPER), draws, np)
    target = tmp_path / "e.csv"
    for names in (["a"], ["a", "a"], ["a", ""], ["a", " b"], ["a", "#b"]):
        with pytest.raises(EncounterError, match=r"e\.csv"):
            write(target, encounters, names)
    with pytest.raises(EncounterError, match="has no intruder"):
        write(target, encounters._replace(mask=encounters.mask & False))
    with pytest.raises(EncounterError, match="cannot be written"):
        write(tmp_path / "no" / "e.csv", encounters)
    assert list(tmp_path.iterdir()) == []


def test_the_columns_are_documented() -> None:
    text = (Path(__file__).resolve().parents[3] / "docs/howto/own-encounters.md").read_text(
        encoding="utf-8"
    )
    assert all(f"`{column.name}`" in text for column in COLUMNS)


# Files that cannot be read are refused at once, in one sentence that names them, by every reader.

READERS: dict[str, tuple[Callable[[Any], Any], type[Exception]]] = {
    "csv": (encounter_file.read, EncounterError),
    "lincoln": (read_lincoln, TrackError),
    "daidalus": (read_daidalus, TrackError),
    "adsb": (pairs_of, TrackError),
    "model": (read_model, EncounterError),
}
MIB = 2**20


@pytest.fixture(scope="module")
def bomb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a gzip file of some 100 kilobytes that unpacks to 129 MiB of blanks."""
    path = tmp_path_factory.mktemp("bomb") / "bomb.json.gz"
    packer = zlib.compressobj(1, zlib.DEFLATED, 31)
    with path.open("wb") as file:
        for _ in range(129):
            file.write(packer.compress(b" " * MIB))
        file.write(packer.flush())
    return path


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_regular_file_is_refused_at_once(reader: str, tmp_path: Path) -> None:
    read, kind = READERS[reader]
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero"), tmp_path / "none"):
        with pytest.raises(
            kind, match=f"{path}: (cannot be read: not a regular file|there is no such file)"
        ):
            read(path)


@pytest.mark.parametrize("reader", READERS)
def test_unpacking_ends_at_a_bound(reader: str, bomb: Path) -> None:
    read, kind = READERS[reader]
    assert bomb.stat().st_size < MIB
    with pytest.raises(
        kind, match=r"bomb\.json\.gz: more than 128 MiB unpacked, expected at most so much"
    ):
        read(bomb)


def test_a_plain_file_has_the_same_bound(tmp_path: Path) -> None:
    path = tmp_path / "large.txt"
    with path.open("wb") as file:
        file.truncate(129 * MIB)
    with pytest.raises(TrackError, match="more than 128 MiB, expected"):
        text_of(str(path), TrackError)


@pytest.mark.parametrize("cut", [2, 12, 40, -1])
def test_a_gzip_file_that_is_cut_off_is_refused(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "cut.json.gz"
    path.write_bytes(gzip.compress(b"[1, 2, 3]" + os.urandom(100).hex().encode())[:cut])
    with pytest.raises(TrackError, match="not a gzip file, or cut off"):
        json_of(str(path), TrackError)


def test_lines_lists_and_depth_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "many"
    path.write_bytes(b"\n" * 2_000_001)
    with pytest.raises(TrackError, match="more than 2000000 lines"):
        lines_of(str(path), TrackError)
    path.write_bytes(b"[" + b"[]," * 10_000_000 + b"1]")
    with pytest.raises(TrackError, match="more than 10000000 lists"):
        json_of(str(path), TrackError)
    path.write_text('[{"latitude": 1, "latitude": 2}]')
    with pytest.raises(
        TrackError, match="not usable as JSON: 'latitude' stands twice in one object"
    ):
        json_of(str(path), TrackError)
    path.write_bytes(b"[" * 100_000)
    with pytest.raises(TrackError, match="not usable as JSON"):
        json_of(str(path), TrackError)


def test_text_is_utf_8_with_or_without_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "text"
    for data in ("\ufeffé".encode(), "é".encode(), gzip.compress("é".encode())):
        path.write_bytes(data)
        assert text_of(str(path), TrackError) == "é"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(TrackError, match=r"not a text in UTF-8 \(byte 0\)"):
        text_of(str(path), TrackError)
