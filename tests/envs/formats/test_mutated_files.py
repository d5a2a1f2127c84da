"""Files with mutated rows are refused in one sentence, or give tracks that do not contradict
themselves.
"""

import copy
import json
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs import draws
from envs.encounters import EncounterError
from envs.formats import encounter_file
from envs.formats.encounter_exchange import scenes_of
from envs.formats.lincoln_file import read_lincoln, tracks_of
from envs.formats.track_files import read_daidalus
from envs.formats.track_rows import ACCELERATION, CLIMB, HEIGHT, POSITION, VELOCITY, WINDOW
from envs.traffic.encounter_model import read_model
from envs.traffic.encounter_model_sampler import dimensions, fly_tracks, sample_model
from envs.traffic.track_units import FOOT, KNOT
from envs.traffic.tracks import DISTANT, Track, TrackError
from tests.envs.formats.test_adsb_file import pairs_of
from tests.envs.formats.test_encounter_file import HEADER, ROW
from tests.envs.formats.test_track_files import EVENTS, ONE
from tests.envs.traffic.test_encounter_model import SMALL
from tests.support import WGS84, flight

Row = dict[str, Any]
MANY = int(os.environ.get("FUZZ_ROWS", "3000"))  # mutated rows of each reader in the slow test
FACTORS = (
    0.3048,
    1 / 0.3048,
    KNOT,
    1 / KNOT,
    1e3,
    1e-3,
    math.radians(1),
    math.degrees(1),
    60.0,
    1 / 60.0,
    -1.0,
)
VALUES = (
    math.nan,
    math.inf,
    -math.inf,
    0.0,
    1e308,
    -1e308,
    1e12,
    1e-300,
    1e5,
    180.0,
    -90.0,
    10**400,
)
ODD = (None, True, "", "north", [], "1_0")


def mutate(rows: list[Row], rng: np.random.Generator, time: str, name: str) -> Iterator[str]:
    """Mutate rows in place, one each time it is asked, and yield the kind."""
    while True:
        at = int(rng.integers(len(rows)))
        row = rows[at]
        keys = [key for key in row if key != name]
        key = keys[rng.integers(len(keys))]
        number = (
            row[key]
            if isinstance(row[key], (int, float)) and not isinstance(row[key], bool)
            else 1.0
        )
        kind = ("value", "nudge", "odd", "unit", "order", "duplicate", "gap", "clock", "id")[
            rng.integers(9)
        ]
        if kind == "value":
            row[key] = VALUES[rng.integers(len(VALUES))]
        elif kind == "nudge" and abs(number) < 1e9:
            row[key] = number + float(rng.normal()) * 10.0 ** int(rng.integers(-3, 3))
        elif kind == "odd":
            row[key] = ODD[rng.integers(len(ODD))]
        elif kind == "unit" and abs(number) < 1e100:
            row[key] = number * FACTORS[rng.integers(len(FACTORS))]
        elif kind == "order":
            swapped = int(rng.integers(len(rows)))
            rows[at], rows[swapped] = rows[swapped], rows[at]
        elif kind == "duplicate":
            rows.insert(int(rng.integers(len(rows) + 1)), copy.deepcopy(row))
        elif kind == "gap" and len(rows) > 8:
            del rows[at : at + int(rng.integers(1, 7))]
        elif kind == "clock" and time in row:
            shift = float(rng.choice([-90.0, -5.0, -0.5, 0.5, 5.0, 90.0])) * (
                1e3 if time == "timestamp" else 1.0
            )
            for later_row in rows[at:]:
                if isinstance(later_row[time], (int, float)) and abs(later_row[time]) < 1e15:
                    later_row[time] += shift
        elif kind == "id" and name in row:
            row[name] = str(rows[rng.integers(len(rows))].get(name)).upper()
        else:
            continue
        yield kind


def check_track(track: Track) -> None:
    """Hold a track against the tolerance that envs.formats.track_rows states, with 1 % for the
    map's distortion.
    """
    fields = np.stack(track[1:8])
    assert np.isfinite(fields).all()
    step = np.diff(track.time)
    assert (step > 0.0).all()
    assert abs(fields[1:3]).max() <= DISTANT
    assert abs(track.altitude).max() <= 100_001.0 * FOOT
    speed = np.hypot(track.vx, track.vy)
    assert speed.max() <= 2_001.0 * KNOT

    def since_start(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return how far positions are off the integral of the velocity."""
        return position - np.concatenate(
            [[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * step)]
        )

    x, y, up = (since_start(*pair) for pair in ((track.x, track.vx), (track.y, track.vy),
                                               (track.altitude, track.vertical_rate)))  # fmt: skip
    bends = np.concatenate([[0.0], np.cumsum(0.25 * ACCELERATION * step**2)])
    now = np.arange(1, len(track.time))
    earlier = np.maximum(np.searchsorted(track.time, track.time[1:] - WINDOW, side="right") - 1, 0)
    for before in (now - 1, earlier):
        seconds = track.time[now] - track.time[before]
        off = np.hypot(x[now] - x[before], y[now] - y[before])
        most = (
            POSITION
            + VELOCITY * seconds
            + bends[now]
            - bends[before]
            + 0.01 * speed.max() * seconds
        )
        assert (off <= most + 1.0).all()
        assert (abs(up[now] - up[before]) <= HEIGHT + CLIMB * seconds + 1.0).all()


def meeting(seconds: int, step: float = 1.0) -> list[Row]:
    x, y, _ = WGS84.fwd(179.99, 47.0, 90.0, 6_000.0)
    first = flight("aaa001", 47.0, 179.99, 90.0, seconds=seconds, step=step, climb=3.0)
    second = flight("bbb002", y, x, 270.0, seconds=seconds, step=step)
    return [row for pair in zip(first, second, strict=True) for row in pair]


class Reports:
    """ADS-B, read by pairs."""

    time, name, suffix = "timestamp", "icao24", "json"

    def __init__(self) -> None:
        self.rows = meeting(80)

    def text(self, rows: list[Row]) -> str:
        return json.dumps(rows)

    def read(self, path: Path, repair: bool) -> list[Track]:
        pairs, _ = pairs_of(path, repair=repair)
        return [track for _, own, intruders in pairs for track in (own, *intruders)]


class Daidalus:
    """Geographic rows with track and ground speed, or local ones with a velocity."""

    time, name, suffix = "time", "NAME", "daa"

    def __init__(self, local: bool) -> None:
        self.rows = []
        for report in meeting(20):
            track, speed, time = (
                math.radians(report["track"]),
                report["groundspeed"] * KNOT,
                report["timestamp"] / 1e3 - 1.6e9,
            )
            vx, vy = speed * math.sin(track), speed * math.cos(track)
            row = {
                "NAME": report["icao24"],
                "alt": report["altitude"],
                "vs": report["vertical_rate"],
                "time": time,
            }
            where = {
                "lat": report["latitude"],
                "lon": report["longitude"],
                "trk": report["track"],
                "gs": report["groundspeed"],
            }
            position = {
                "sx": vx * time + (0.0 if vx > 0 else 6e3),
                "sy": vy * time,
                "vx": vx,
                "vy": vy,
            }
            self.rows.append({**row, **(position if local else where)})
        units = {
            "lat": "deg",
            "lon": "deg",
            "trk": "deg",
            "gs": "kt",
            "alt": "ft",
            "vs": "fpm",
            "time": "s",
        }
        units |= {"sx": "m", "sy": "m", "vx": "m/s", "vy": "m/s", "NAME": "none"}
        self.head = [", ".join(self.rows[0]), ", ".join(f"[{units[key]}]" for key in self.rows[0])]

    def text(self, rows: list[Row]) -> str:
        return "\n".join(
            [*self.head, *(", ".join(str(value)[:60] for value in row.values()) for row in rows)]
        )

    def read(self, path: Path, repair: bool) -> list[Track]:
        return list(read_daidalus(path, repair=repair).tracks)


class Lincoln:
    """Events and initial states of two aircraft."""

    time, name, suffix = "time", "", "json"
    fields = ("time", "rate", "turn", "acceleration")

    def __init__(self) -> None:
        start = [
            {key: ONE[key][i] for key in ("n_ft", "e_ft", "h_ft", "v_ftps", "heading_rad")}
            for i in range(2)
        ]
        events = [
            dict(zip(self.fields, (t, 5.0, 0.02 * (-1) ** t, 0.5), strict=True))
            for t in range(0, 60, 4)
        ]
        self.rows = [*start, *copy.deepcopy(events), *copy.deepcopy(events)]
        self.rows = [{**row, "time": row.get("time", 0.0)} for row in self.rows]

    def text(self, rows: list[Row]) -> str:
        starts = [row for row in rows if "n_ft" in row][:2]
        events = [[row.get(key) for key in self.fields] for row in rows if "rate" in row]
        half = len(events) // 2
        fields = {
            key: [row[key] for row in starts]
            for key in ("n_ft", "e_ft", "h_ft", "v_ftps", "heading_rad")
        }
        return json.dumps([ONE | fields | {EVENTS: [events[:half], events[half:]]}])

    def read(self, path: Path, repair: bool) -> list[Track]:
        return [
            track
            for encounter in read_lincoln(path, repair=repair)
            for track in tracks_of(encounter)
        ]


class Own:
    """Our encounters, whose intruders are flown."""

    time, name, suffix = "turn_onset_s", "encounter", "csv"

    def __init__(self) -> None:
        names = HEADER.split(",")
        row: Row = {
            "encounter": "a",
            **{key: float(cell) for key, cell in zip(names[1:], ROW.split(",")[1:], strict=True)},
        }
        more = {"turn_onset_s": 5.0, "turn_change_deg": 40.0, "turn_rate_deg_s": 3.0}
        self.rows = [{**row, **more, "encounter": f"e{i}", "own_y_m": 10.0 * i} for i in range(8)]

    def text(self, rows: list[Row]) -> str:
        return "\n".join(
            [
                ",".join(self.rows[0]),
                *(",".join(str(value)[:60] for value in row.values()) for row in rows),
            ]
        )

    def read(self, path: Path, repair: bool) -> list[Track]:
        del repair
        encounters, names = encounter_file.read(path)
        for field in (
            *encounters.own,
            *encounters.intruders,
            *encounters.intent,
            *encounters.sensor,
        ):
            assert np.isfinite(field).all()
        return [track for scene in scenes_of(encounters, names, 6) for track in scene.tracks]


class Model:
    """An encounter model, from which tracks are drawn."""

    time, name, suffix = "", "", "txt"

    def __init__(self) -> None:
        self.rows = [
            {f"{i:03}": self.number(word) for i, word in enumerate(line.split())}
            for line in SMALL.splitlines()
        ]

    @staticmethod
    def number(word: str) -> Any:
        try:
            return float(word)
        except ValueError:
            return word

    def text(self, rows: list[Row]) -> str:
        lines = (
            [f"{v:.17g}" if isinstance(v, float) else str(v)[:60] for v in row.values()]
            for row in rows
        )
        return "\n".join(" ".join(words) for words in lines)

    def read(self, path: Path, repair: bool) -> list[Track]:
        del repair
        model = read_model(path)
        if dimensions(model, 20) > 2_000:
            return []
        state = fly_tracks(
            model, sample_model(model, draws.uniforms(1, 0, 3, (dimensions(model, 20),)), 20), 150.0
        )
        times, zero = np.arange(21.0), np.zeros(21)
        rows = range(len(state.x))
        return [
            Track("", times, state.x[i], state.y[i], zero, state.speed[i] * np.cos(state.heading[i]),
                  state.speed[i] * np.sin(state.heading[i]), zero, {}) for i in rows
        ]  # fmt: skip


READERS: dict[str, Callable[[], Any]] = {
    "adsb_pairs": Reports,
    "read_daidalus, geographic": lambda: Daidalus(local=False),
    "read_daidalus, local": lambda: Daidalus(local=True),
    "read_lincoln": Lincoln,
    "encounter_file.read": Own,
    "read_model": Model,
}


def run(reader: Any, path: Path, count: int) -> dict[str, int]:
    """Read files with mutated rows, until there were as many rows, and return what became of the
    files.
    """
    rng, counts = (
        np.random.default_rng(count),
        {"rows": 0, "accepted": 0, "refused": 0, "tracks": 0},
    )
    while counts["rows"] < count:
        rows = copy.deepcopy(reader.rows)
        mutating = mutate(rows, rng, reader.time, reader.name)
        for _ in range(int(rng.choice([1, 1, 2, 5, 20]))):
            next(mutating)
            counts["rows"] += 1
        path.write_text(reader.text(rows))
        for repair in (False, True):
            try:
                tracks = reader.read(path, repair)
            except (TrackError, EncounterError) as problem:
                assert str(path) in str(problem)
                assert "\n" not in str(problem)
                counts["refused"] += 1
                continue
            counts["accepted"] += 1
            counts["tracks"] += len(tracks)
            for track in tracks:
                check_track(track)
    return counts


@pytest.mark.parametrize("reader", READERS)
def test_a_mutated_file_is_refused_or_consistent(reader: str, tmp_path: Path) -> None:
    tested_reader = READERS[reader]()
    path = tmp_path / f"file.{tested_reader.suffix}"
    path.write_text(tested_reader.text(tested_reader.rows))
    for track in tested_reader.read(path, False):
        check_track(track)
    counts = run(tested_reader, path, 300)
    assert min(counts.values()) > 0


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
def test_many_mutated_rows_are_refused_or_consistent(reader: str, tmp_path: Path) -> None:
    tested_reader = READERS[reader]()
    counts = run(tested_reader, tmp_path / f"file.{tested_reader.suffix}", MANY)
    print(f"{reader}: {counts}")
    assert counts["tracks"] > MANY / 100


def test_the_check_finds_a_contradiction(tmp_path: Path) -> None:
    path, reader = tmp_path / "file.daa", Daidalus(local=True)
    path.write_text(reader.text(reader.rows))
    track = reader.read(path, False)[0]
    late = track.time > 10.0
    for change in (
        {"vx": -track.vx},
        {"x": track.x + 400.0 * late},
        {"altitude": track.altitude + 200.0 * late},
    ):
        with pytest.raises(AssertionError):
            check_track(track._replace(**change))
