"""Rows of recorded tracks, ordered in time and held against each other.

From one row to the next, and over each :data:`WINDOW` seconds, the change of position must be what the reported
velocities make of it (by the trapezoidal rule), within

    ``POSITION + VELOCITY t + ACCELERATION / 4 sum(dt^2)`` horizontally and ``HEIGHT + CLIMB t`` vertically,

t seconds in all and dt from row to row; the last term is what an acceleration between two rows can do. A row that
no aircraft could have reached so is an outlier, of another aircraft with the same address, or of another clock.

Nothing is repaired unless asked for, and what was repaired is counted.
"""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from envs.angles import wrap
from envs.formats.local_frame import local, wgs84
from envs.traffic.tracks import DISTANT, Repairs, Track, TrackError, TrackFile, summed

POSITION, VELOCITY, ACCELERATION = 300.0, 50.0, 5.0
"""m, m/s and m/s^2, horizontally. Of 210 000 steps of real reports a second apart 7 are beyond."""

HEIGHT, CLIMB = 100.0, 50.0  # m and m/s, vertically
WINDOW = 20.0  # s

_LASTING = 30.0  # rows that agree with each other for so long, s, but not with the rest, are a flight of their own
_MOST_FILLED = 100_000  # rows across the gaps of an aircraft
_MOST_OPEN = 8  # flights of one aircraft that a row is held against: the latest

Rows: TypeAlias = list[tuple[int, dict[str, float]]]
"""Rows of one aircraft: number in the file, and values by our names, ``time`` among them."""


class Reading(NamedTuple):
    """How the rows of a file are read."""

    source: str  # name of the file for messages
    repair: bool  # whether to drop and fill instead of refusing
    max_gap: float  # longest time between two rows, s
    noun: str = "line"  # what the file counts
    apart: float = math.inf  # rows further apart in time are of different flights, s
    standing: float = math.inf
    """A position that stays the same although the aircraft moved further than this, m, is stale."""
    names: Mapping[str, str] = {}  # what the file calls our fields, where that differs

    def field(self, number: int, key: str) -> str:
        """Return where a value stands, for messages."""
        return f"{self.source} {self.noun} {number}, field {self.names.get(key, key)}"


def track_file(rows: Mapping[str, Rows], how: Reading) -> TrackFile:
    """Return the tracks of aircraft, local to the first position of the first one where positions are geographic.

    The rows are by the aircraft's names. Of those that contradict each other the longest flight is taken.

    Raises:
        TrackError: something is wrong and must not be repaired, nothing is left, or tracks are too far apart.
    """
    kept, done = {}, []
    for name, each in rows.items():
        flights, repairs = flights_of(name, each, how)
        kept[name] = max(flights, key=len)
        if not kept[name]:
            raise TrackError(f"{how.source}: no row of {name!r} is left, expected at least one that is finite")
        others = sum(map(len, flights)) - len(kept[name])
        done.append(repairs._replace(impossible=repairs.impossible + others, split=0))
    reference = place_of(next(iter(kept.values()))[0])
    tracks = tuple(track_of(name, each, reference) for name, each in kept.items())
    for track in tracks:
        far = float(np.hypot(track.x, track.y).max())
        if far > DISTANT:
            raise TrackError(
                f"{how.source}: {track.name!r} is {far / 1e3:.0f} km from the first position of {tracks[0].name!r}, "
                f"expected at most {DISTANT / 1e3:.0f} km"
            )
    return TrackFile(tracks, summed(done))


def place_of(row: tuple[int, dict[str, float]]) -> tuple[float, float] | None:
    """Return the latitude and longitude of a row, rad; None where its position is a local one."""
    return (row[1]["lat"], row[1]["lon"]) if "lat" in row[1] else None


def track_of(name: str, rows: Rows, reference: tuple[float, float] | None) -> Track:
    """Return the track of an aircraft's ordered rows, local to a latitude and longitude if they have such."""
    columns = {key: np.array([values[key] for _, values in rows]) for key in rows[0][1]}
    if "gs" in columns:
        course, speed = columns.pop("trk"), columns.pop("gs")
        vx, vy = speed * np.sin(course), speed * np.cos(course)
    else:
        vx, vy = columns.pop("vx"), columns.pop("vy")
    if reference is None:
        x, y = columns.pop("sx"), columns.pop("sy")
    else:
        place = local(columns.pop("lat"), columns.pop("lon"), reference)
        x, y = place.x, place.y
        vx, vy = place.velocity(vx, vy)
    time, altitude, rate = (columns.pop(key) for key in ("time", "alt", "vs"))
    return Track(name, time, x, y, altitude, vx, vy, rate, columns)


def flights_of(name: str, rows: Rows, how: Reading) -> tuple[list[Rows], Repairs]:
    """Return the flights of an aircraft, each in order and without gaps, at least one, and what it took.

    Raises:
        TrackError: something is wrong and must not be repaired.
    """
    counts = dict.fromkeys(Repairs._fields, 0)
    groups: list[list[_Flight]] = []
    recent: list[_Flight] = []  # that with the latest row last
    for number, values in rows:
        bad = next((key for key, value in values.items() if not math.isfinite(value)), None)
        if bad is not None:
            if not how.repair:
                raise TrackError(f"{how.field(number, bad)}: {values[bad]}, expected a finite number")
            counts["not_finite"] += 1
            continue
        fault = ""
        for flight in reversed(recent):
            found, filled = flight.add(number, values, how)
            if found in ("", "out_of_order", "stale"):
                fault = found
                recent.remove(flight)
                recent.append(flight)
                break
            fault = fault if found == "apart" and fault else found
        else:
            if fault in ("", "apart") or how.repair:
                recent = [*recent[1 - _MOST_OPEN :], _Flight(number, values)]
                if fault in ("", "apart"):
                    groups.append([])
                groups[-1].append(recent[-1])
                continue
            filled = 0
        if fault and not how.repair:
            raise TrackError(_sentence(name, number, values, recent[-1], how))
        counts["filled"] += filled
        if counts["filled"] > _MOST_FILLED:
            raise TrackError(f"{how.source}: the gaps of {name!r} take more than {_MOST_FILLED} rows to fill")
        if fault:
            counts[fault] += 1
    kept: list[Rows] = []
    for group in groups:
        longest = max(group, key=lambda flight: len(flight.rows))
        lasting = [flight for flight in group if flight is longest or flight.lasts() >= _LASTING]
        kept += [flight.rows for flight in lasting]
        counts["split"] += len(lasting) - 1
        counts["impossible"] += sum(len(flight.rows) for flight in group) - sum(len(flight.rows) for flight in lasting)
    return kept or [[]], Repairs(**counts)


class _Flight:
    """Rows that follow from each other, and what their positions miss of their velocities since the first."""

    def __init__(self, number: int, values: dict[str, float]) -> None:
        self.rows: Rows = [(number, values)]
        self.times = [values["time"]]
        self.missed: list[tuple[float, float, float, float]] = [(0.0, 0.0, 0.0, 0.0)]
        """East, north and up, and what an acceleration can do, m."""

    def lasts(self) -> float:
        return self.times[-1] - self.times[0]

    def add(self, number: int, values: dict[str, float], how: Reading) -> tuple[str, int]:
        """Add a row and return "", or why not; and how many rows were filled in before it."""
        time = values["time"]
        step = time - self.times[-1]
        if step <= 0.0:
            before = bisect_right(self.times, time) - 1
            if before < 0:
                return ("apart" if self.times[0] - time > how.apart else "impossible"), 0
            again = _Flight(*self.rows[before])
            return ("out_of_order" if again.follows(values) else "impossible"), 0
        if step > how.apart:
            return "apart", 0
        last = self.rows[-1][1]
        if _same_place(last, values) and values.get("gs", 0.0) * step > how.standing:
            return "stale", 0
        parts = math.ceil(min(step / how.max_gap, _MOST_FILLED + 1))
        if parts > 1 and (not how.repair or parts > _MOST_FILLED):
            return "impossible", 0
        size = len(self.rows)
        for part in range(1, parts + 1):
            share = part / parts
            each = values if part == parts else {key: _mixed(key, last[key], values[key], share) for key in last}
            if each["time"] <= self.times[-1] or not self.follows(each):
                del self.rows[size:], self.times[size:], self.missed[size:]
                return "impossible", 0
            self.rows.append((number, each))
            self.times.append(each["time"])
        return "", parts - 1

    def follows(self, values: dict[str, float]) -> bool:
        """Return whether an aircraft can come from the last row to another; if so what it misses is noted."""
        step = values["time"] - self.times[-1]
        east, north, up = _missed(self.rows[-1][1], values)
        bend = 0.25 * ACCELERATION * step * step
        if not _within((east, north, up, bend), step):
            return False
        last = self.missed[-1]
        total = (last[0] + east, last[1] + north, last[2] + up, last[3] + bend)
        begin = max(bisect_right(self.times, values["time"] - WINDOW) - 1, 0)
        first = self.missed[begin]
        since = (total[0] - first[0], total[1] - first[1], total[2] - first[2], total[3] - first[3])
        if not _within(since, values["time"] - self.times[begin]):
            return False
        self.missed.append(total)
        return True


def _within(off: Sequence[float], seconds: float) -> bool:
    """Return whether rows agree: how far they are off, east, north and up, and what an acceleration can do, m."""
    east, north, up, bend = off
    level = math.hypot(east, north) <= POSITION + VELOCITY * seconds + bend
    return level and abs(up) <= HEIGHT + CLIMB * seconds


def _missed(before: dict[str, float], after: dict[str, float]) -> tuple[float, float, float]:
    """Return how far a row is, east, north and up, m, from where the velocities of both rows lead from the first."""
    step, turn = after["time"] - before["time"], 0.0
    if "lat" in before:
        out, back, length = wgs84().inv(before["lon"], before["lat"], after["lon"], after["lat"], radians=True)
        east, north = length * math.sin(out), length * math.cos(out)
        turn = back + math.pi - out if length > 1e-6 else 0.0
    else:
        east, north = after["sx"] - before["sx"], after["sy"] - before["sy"]
    (vx, vy), (wx, wy) = _velocity(before), _velocity(after)
    # North where the geodesic ends is turned against north where it begins.
    cosine, sine = math.cos(turn), math.sin(turn)
    wx, wy = wx * cosine - wy * sine, wx * sine + wy * cosine
    up = after["alt"] - before["alt"] - 0.5 * (before["vs"] + after["vs"]) * step
    return east - 0.5 * (vx + wx) * step, north - 0.5 * (vy + wy) * step, up


def _velocity(values: dict[str, float]) -> tuple[float, float]:
    if "gs" in values:
        return values["gs"] * math.sin(values["trk"]), values["gs"] * math.cos(values["trk"])
    return values["vx"], values["vy"]


def _same_place(before: dict[str, float], after: dict[str, float]) -> bool:
    keys = ("lat", "lon") if "lat" in before else ("sx", "sy")
    return all(before[key] == after[key] for key in keys)


def _sentence(name: str, number: int, values: dict[str, float], flight: _Flight, how: Reading) -> str:
    """Return why a row does not follow the last one."""
    line, before = flight.rows[-1]
    step = values["time"] - before["time"]
    time, place = how.field(number, "time"), how.field(number, "lat" if "lat" in values else "sx")
    if step <= 0.0:
        return (
            f"{time}: {values['time']:.15g} s of {name!r}, expected more than {before['time']:.15g} s as in "
            f"{how.noun} {line}"
        )
    if step > how.max_gap:
        return f"{time}: a gap of {step:g} s in the track of {name!r}, expected at most {how.max_gap:g} s"
    if _same_place(before, values) and values.get("gs", 0.0) * step > how.standing:
        return (
            f"{place}: the position of {values['time']:.15g} s is that of {before['time']:.15g} s at "
            f"{values['gs']:.0f} m/s, expected another"
        )
    east, north, up = _missed(before, values)
    if abs(up) > HEIGHT + CLIMB * step:
        return (
            f"{how.field(number, 'alt')}: {abs(up):.0f} m off the altitude to which {how.noun} {line} of {name!r} and "
            f"its vertical rate lead in {step:g} s, expected at most {HEIGHT + CLIMB * step:.0f} m"
        )
    off, most = math.hypot(east, north), POSITION + VELOCITY * step + 0.25 * ACCELERATION * step * step
    if off > most:
        return (
            f"{place}: {off:.0f} m off the place to which {how.noun} {line} of {name!r} and its velocity lead "
            f"in {step:g} s, expected at most {most:.0f} m"
        )
    return (
        f"{place}: the positions of {name!r} in the {WINDOW:g} s before do not agree with its velocities, "
        f"expected agreement within {POSITION:g} m and {VELOCITY:g} m/s, and in altitude {HEIGHT:g} m and {CLIMB:g} m/s"
    )


def _mixed(key: str, first: float, second: float, share: float) -> float:
    """Return the value at a share of the way; angles the short way round."""
    step = second - first
    if key in ("trk", "heading", "lon"):
        step = float(wrap(step, np))
    return first + share * step
