"""Rows of recorded tracks, ordered in time and held against each other.

From one row to the next, and over each :data:`WINDOW` seconds, the change of position must be what
the reported velocities make of it (by the trapezoidal rule), within

    ``POSITION + VELOCITY t + ACCELERATION / 4 sum(dt^2)`` horizontally and ``HEIGHT + CLIMB t``
    vertically,

t seconds in all and dt from row to row; the last term is what an acceleration between two rows can
do. A row that no aircraft could have reached so is an outlier, of another aircraft with the same
address, or of another clock.

Nothing is repaired unless asked for, and what was repaired is counted.
"""

import math
import operator
from bisect import bisect_right
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from envs.angles import wrap
from envs.formats.local_frame import local, wgs84
from envs.traffic.tracks import DISTANT, Repairs, Track, TrackError, TrackFile, sum_of_repairs

POSITION, VELOCITY, ACCELERATION = 300.0, 50.0, 5.0
"""m, m/s and m/s^2, horizontally. Of 210 000 steps of real reports a second apart 7 are beyond."""

HEIGHT, CLIMB = 100.0, 50.0  # m and m/s, vertically
WINDOW = 20.0  # s

# rows that agree with each other for so long, s, but not with the rest, are a flight of their own
_LASTING = 30.0
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
    """Return the tracks of aircraft, local to the first position of the first one where positions
    are geographic.

    The rows are by the aircraft's names. Of those that contradict each other the longest flight is
    taken.

    Raises:
        TrackError: something is wrong and must not be repaired, nothing is left, or tracks are too
            far apart.
    """
    kept, done = {}, []
    for name, each in rows.items():
        flights, repairs = flights_of(name, each, how)
        kept[name] = max(flights, key=len)
        if not kept[name]:
            raise TrackError(
                f"{how.source}: no row of {name!r} is left, expected at least one that is finite"
            )
        others = sum(map(len, flights)) - len(kept[name])
        done.append(repairs._replace(impossible=repairs.impossible + others, split=0))
    reference = place_of(next(iter(kept.values()))[0])
    tracks = tuple(track_of(name, each, reference) for name, each in kept.items())
    for track in tracks:
        far = float(np.hypot(track.x, track.y).max())
        if far > DISTANT:
            away = (
                f"{far / 1e3:.0f} km from where {tracks[0].name!r} begins, expected at most "
                f"{DISTANT / 1e3:.0f} km"
            )
            raise TrackError(f"{how.source}: {track.name!r} is {away}")
    return TrackFile(tracks, sum_of_repairs(done))


def place_of(row: tuple[int, dict[str, float]]) -> tuple[float, float] | None:
    """Return the latitude and longitude of a row, rad; None where its position is a local one."""
    return (row[1]["lat"], row[1]["lon"]) if "lat" in row[1] else None


def track_of(name: str, rows: Rows, reference: tuple[float, float] | None) -> Track:
    """Return the track of an aircraft's ordered rows, local to a latitude and longitude if they
    have such.
    """
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
    """Return the flights of an aircraft, each in order and without gaps, at least one, and what it
    took.

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
                raise TrackError(
                    f"{how.field(number, bad)}: {values[bad]}, expected a finite number"
                )
            counts["not_finite"] += 1
            continue
        fault, refusal, filled = "", "", 0
        for flight in reversed(recent):
            found, sentence, filled = flight.add(number, values, how)
            if found in ("", "out_of_order", "stale"):
                fault, refusal = found, sentence
                recent.remove(flight)
                recent.append(flight)
                break
            if fault in ("", "apart"):
                fault, refusal = found, sentence
        else:
            if fault in ("", "apart") or how.repair:
                recent = [*recent[1 - _MOST_OPEN :], _Flight(name, number, values)]
                if fault in ("", "apart"):
                    groups.append([])
                groups[-1].append(recent[-1])
                continue
        if fault and not how.repair:
            raise TrackError(refusal)
        counts["filled"] += filled
        if counts["filled"] > _MOST_FILLED:
            raise TrackError(
                f"{how.source}: the gaps of {name!r} take more than {_MOST_FILLED} rows to fill"
            )
        if fault:
            counts[fault] += 1
    kept: list[Rows] = []
    for group in groups:
        longest = max(group, key=lambda flight: len(flight.rows))
        lasting = [flight for flight in group if flight is longest or flight.lasts() >= _LASTING]
        kept += [flight.rows for flight in lasting]
        counts["split"] += len(lasting) - 1
        counts["impossible"] += sum(len(flight.rows) for flight in group) - sum(
            len(flight.rows) for flight in lasting
        )
    return kept or [[]], Repairs(**counts)


class _Flight:
    """Rows that follow from each other, and what their positions miss of their velocities since the
    first.
    """

    def __init__(self, name: str, number: int, values: dict[str, float]) -> None:
        self.name = name
        self.rows: Rows = [(number, values)]
        self.times = [values["time"]]
        self.missed: list[tuple[float, ...]] = [(0.0, 0.0, 0.0, 0.0)]
        """East, north and up, and what an acceleration can do, m."""

    def lasts(self) -> float:
        return self.times[-1] - self.times[0]

    def add(self, number: int, values: dict[str, float], how: Reading) -> tuple[str, str, int]:
        """Add a row; return the fault that keeps it out or "", a sentence on it, and how many rows
        were filled in.
        """
        (line, last), time = self.rows[-1], values["time"]
        step, of = time - last["time"], f"of {self.name!r}"
        if step <= 0.0:
            expected = f"expected more than {last['time']:.15g} s as in {how.noun} {line}"
            sentence = f"{how.field(number, 'time')}: {time:.15g} s {of}, {expected}"
            before = bisect_right(self.times, time) - 1
            if before < 0:
                return ("apart" if self.times[0] - time > how.apart else "impossible"), sentence, 0
            again = _Flight(self.name, *self.rows[before])
            return (
                ("impossible" if again.strays(number, values, how) else "out_of_order"),
                sentence,
                0,
            )
        if step > how.apart:
            return "apart", "", 0
        place = ("lat", "lon") if "lat" in last else ("sx", "sy")
        if (
            all(last[key] == values[key] for key in place)
            and values.get("gs", 0.0) * step > how.standing
        ):
            same = (
                f"the position of {time:.15g} s is that of {last['time']:.15g} s at "
                f"{values['gs']:.0f} m/s"
            )
            return "stale", f"{how.field(number, place[0])}: {same}, expected another", 0
        parts = math.ceil(min(step / how.max_gap, _MOST_FILLED + 1))
        if parts > 1 and (not how.repair or parts > _MOST_FILLED):
            gap = f"a gap of {step:g} s in the track {of}, expected at most {how.max_gap:g} s"
            return "impossible", f"{how.field(number, 'time')}: {gap}", 0
        size = len(self.rows)
        for part in range(1, parts + 1):
            share = part / parts
            each = (
                values
                if part == parts
                else {key: _mix(key, last[key], values[key], share) for key in last}
            )
            strays = (
                "no time passes"
                if each["time"] <= self.times[-1]
                else self.strays(number, each, how)
            )
            if strays:
                del self.rows[size:], self.times[size:], self.missed[size:]
                return "impossible", strays, 0
            self.rows.append((number, each))
            self.times.append(each["time"])
        return "", "", parts - 1

    def strays(self, number: int, values: dict[str, float], how: Reading) -> str:
        """Return why no aircraft can come from the last rows to another; "" if one can: what it
        misses is noted.
        """
        step = values["time"] - self.times[-1]
        off = (*_misses(self.rows[-1][1], values), 0.25 * ACCELERATION * step * step)
        total = tuple(map(operator.add, self.missed[-1], off))
        begin = max(bisect_right(self.times, values["time"] - WINDOW) - 1, 0)
        for row, missed in (
            (-1, off),
            (begin, tuple(map(operator.sub, total, self.missed[begin]))),
        ):
            east, north, up, bend = missed
            seconds = values["time"] - self.times[row]
            for key, far, most in (
                ("alt", abs(up), HEIGHT + CLIMB * seconds),
                (
                    "lat" if "lat" in values else "sx",
                    math.hypot(east, north),
                    POSITION + VELOCITY * seconds + bend,
                ),
            ):
                if not far <= most:
                    lead = (
                        f"{how.noun} {self.rows[row][0]} of {self.name!r} and the velocities "
                        "since lead"
                    )
                    where = (
                        f"{far:.0f} m off where {lead} in {seconds:g} s, expected at most "
                        f"{most:.0f} m"
                    )
                    return f"{how.field(number, key)}: {where}"
        self.missed.append(total)
        return ""


def _misses(before: dict[str, float], after: dict[str, float]) -> tuple[float, float, float]:
    """Return how far a row is, east, north and up, m, from where the velocities of both rows lead
    from the first.
    """
    step, turn = after["time"] - before["time"], 0.0
    if "lat" in before:
        out, back, length = wgs84().inv(
            before["lon"], before["lat"], after["lon"], after["lat"], radians=True
        )
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


def _mix(key: str, first: float, second: float, share: float) -> float:
    """Return the value at a share of the way; angles the short way round."""
    step = second - first
    if key in ("trk", "heading", "lon"):
        step = float(wrap(step, np))
    return first + share * step
