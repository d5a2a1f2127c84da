"""Rows of recorded tracks, ordered in time and held against each other.

From one row to the next, and over each :data:`WINDOW` seconds, the change of position must be what
the reported velocities make of it by the trapezoidal rule. With t seconds in all and dt from row to
row, it may be off by

    ``POSITION + VELOCITY t + ACCELERATION / 4 sum(dt^2)`` horizontally,
    ``HEIGHT + CLIMB t`` vertically;

the last term of the first is what an acceleration between two rows can do. A row that is further
off is an outlier, of another aircraft with the same address, or of another clock.

Nothing is repaired unless asked for, and what was repaired is counted.
"""

import math
import operator
from bisect import bisect_right
from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from envs.angles import wrap
from envs.formats.local_frame import local, wgs84
from envs.traffic.tracks import DISTANT, Repairs, Track, TrackError, TrackFile, sum_of_repairs
from envs.traffic.velocities import describe, mismatch, of_positions

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
    repair: bool  # whether to drop rows and accept gaps instead of refusing
    max_gap: float  # longest time between two rows, s
    noun: str = "line"  # what the file counts
    apart: float = math.inf  # rows further apart in time are of different flights, s
    standing: float = math.inf
    """A position that stays the same although the aircraft moved further than this, m, is stale."""
    names: Mapping[str, str] = {}  # what the file calls our fields, where that differs
    speed_unit: float = 1.0  # that the file has speeds over the ground in, m/s

    def field(self, number: int, key: str) -> str:
        """Return where a value stands, for messages."""
        return f"{self.source} {self.noun} {number}, field {self.names.get(key, key)}"


def track_file(rows: Mapping[str, Rows], reading: Reading) -> TrackFile:
    """Return the tracks of aircraft, local to the first position of the first one where positions
    are geographic.

    The rows are by the aircraft's names. Of those that contradict each other the longest flight is
    taken.

    Raises:
        TrackError: something is wrong and must not be repaired, nothing is left, or tracks are too
            far apart.
    """
    longest, repairs = {}, []
    for name, reports in rows.items():
        flights, repaired = flights_of(name, reports, reading)
        longest[name] = max(flights, key=len)
        if not longest[name]:
            raise TrackError(
                f"{reading.source}: no row of {name!r} is left, expected at least one that is "
                "finite"
            )
        left_out = sum(map(len, flights)) - len(longest[name])
        repairs.append(repaired._replace(impossible=repaired.impossible + left_out, split=0))
    reference = place_of(next(iter(longest.values()))[0])
    tracks = tuple(track_of(name, flight, reference) for name, flight in longest.items())
    for track in tracks:
        farthest = float(np.hypot(track.x, track.y).max())
        if farthest > DISTANT:
            raise TrackError(
                f"{reading.source}: {track.name!r} is {farthest / 1e3:.0f} km from where "
                f"{tracks[0].name!r} begins, expected at most {DISTANT / 1e3:.0f} km"
            )
    return TrackFile(tracks, sum_of_repairs(repairs))


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


def flights_of(name: str, rows: Rows, reading: Reading) -> tuple[list[Rows], Repairs]:
    """Return the flights of an aircraft, each in order, at least one, and what was
    repaired for it.

    Raises:
        TrackError: something is wrong and must not be repaired.
    """
    counts = dict.fromkeys(Repairs._fields, 0)
    sorter = _Sorter(name)
    # In a wrong unit no row may follow from another.
    ordered = _in_order(rows)
    replaced = dict(
        _velocities_of_positions(name, ordered, reading, steady=True) if ordered else []
    )
    counts["velocity"] += len(replaced)
    for number, reported in rows:
        values = replaced.get(number, reported)
        not_finite = next((key for key, value in values.items() if not math.isfinite(value)), None)
        if not_finite is not None:
            if not reading.repair:
                raise TrackError(
                    f"{reading.field(number, not_finite)}: {values[not_finite]}, expected a "
                    "finite number"
                )
            counts["not_finite"] += 1
            continue
        fit = sorter.add(number, values, reading)
        if fit.fault and not reading.repair:
            raise TrackError(fit.sentence)
        counts["filled"] += fit.filled
        if counts["filled"] > _MOST_FILLED:
            raise TrackError(
                f"{reading.source}: the gaps of {name!r} take more than {_MOST_FILLED} rows to fill"
            )
        if fit.fault:
            counts[fit.fault] += 1
    flights: list[Rows] = []
    for group in sorter.groups:
        lasting = _lasting(group)
        for flight in lasting:
            replaced_rows = _velocities_of_positions(name, flight.reported, reading)
            counts["velocity"] += len(replaced_rows)
            flights.append(replaced_rows or flight.reported)
        counts["split"] += len(lasting) - 1
        counts["impossible"] += _count_rows(group) - _count_rows(lasting)
    return flights or [[]], Repairs(**counts)


def _in_order(rows: Rows) -> Rows:
    """Return the rows that are finite and after those before."""
    ordered: Rows = []
    for number, values in rows:
        finite = all(map(math.isfinite, values.values()))
        if finite and (not ordered or values["time"] > ordered[-1][1]["time"]):
            ordered.append((number, values))
    return ordered


def _velocities_of_positions(
    name: str, rows: Rows, reading: Reading, *, steady: bool = False
) -> Rows:
    """Return the rows of a flight with the velocities that its positions show, where those reported
    make another way, or one that is off steadily; else none.

    Raises:
        TrackError: they do, and it must not be repaired.
    """
    columns = {key: np.array([values[key] for _, values in rows]) for key in rows[0][1]}
    time, ways, velocities = columns["time"], _ways(columns), _velocities(columns)
    off = mismatch(time, ways, velocities)
    if off is None or (steady and not off.steady):
        return []
    polar = "gs" in columns
    if not reading.repair:
        key = ("trk" if off.turned else "gs") if polar else "vx"
        raise TrackError(
            f"{reading.field(rows[0][0], key)}: {describe(off, name, reading.speed_unit)}"
        )
    velocities_shown = of_positions(time, ways)
    if polar:
        fields = {"gs": np.abs(velocities_shown), "trk": 0.5 * math.pi - np.angle(velocities_shown)}
    else:
        fields = {"vx": np.real(velocities_shown), "vy": np.imag(velocities_shown)}
    return [
        (number, values | {key: float(column[i]) for key, column in fields.items()})
        for i, (number, values) in enumerate(rows)
    ]


def _ways(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the ways from each row to the next, east and north, m, complex ``[T - 1]``."""
    if "sx" in columns:
        return np.diff(columns["sx"]) + 1j * np.diff(columns["sy"])
    lat, lon = columns["lat"], columns["lon"]
    azimuth, back_azimuth, length = wgs84().inv(lon[:-1], lat[:-1], lon[1:], lat[1:], radians=True)
    middle = azimuth + 0.5 * wrap(back_azimuth + math.pi - azimuth, np)
    return length * np.exp(1j * (0.5 * math.pi - middle))


def _velocities(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return velocities over the ground, east and north, m/s, complex ``[T]``."""
    if "gs" in columns:
        return columns["gs"] * np.exp(1j * (0.5 * math.pi - columns["trk"]))
    return columns["vx"] + 1j * columns["vy"]


class _Fit(NamedTuple):
    """What came of holding a row against a flight."""

    fault: Literal["", "apart", "impossible", "out_of_order", "stale"] = ""
    """What keeps it out, by the field of :class:`Repairs` that counts it; ``apart``: it is of
    another flight; empty: it has been added."""
    sentence: str = ""  # on the fault
    filled: int = 0  # rows that were filled in before it


class _Sorter:
    """Sorts the rows of an aircraft into flights."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.groups: list[list[_Flight]] = []
        """Flights that are apart in time; those of one group contradict each other."""
        self._recent: list[_Flight] = []  # that with the latest row last

    def add(self, number: int, values: dict[str, float], reading: Reading) -> _Fit:
        """Add a row to the flight that it belongs to, or begin one with it."""
        misfit = _Fit("apart")
        for flight in reversed(self._recent):
            fit = flight.add(number, values, reading)
            if fit.fault in ("", "out_of_order", "stale"):
                self._recent.remove(flight)
                self._recent.append(flight)
                return fit
            if misfit.fault == "apart":
                misfit = fit
        if misfit.fault != "apart" and not reading.repair:
            return misfit
        flight_begun = _Flight(self._name, number, values)
        self._recent = [*self._recent[1 - _MOST_OPEN :], flight_begun]
        if misfit.fault == "apart":
            self.groups.append([])
        self.groups[-1].append(flight_begun)
        return _Fit()


class _Miss(NamedTuple):
    """How far positions are from where the velocities lead, m."""

    east: float
    north: float
    up: float
    bend: float  # what an acceleration between the rows can do, horizontally


class _Flight:
    """Rows that follow from each other."""

    def __init__(self, name: str, number: int, values: dict[str, float]) -> None:
        self.name = name
        self.reported: Rows = [(number, values)]
        self.rows: Rows = [(number, values)]
        """Those reported and, for the checks, what is filled into gaps on the straight line."""
        self.times = [values["time"]]
        self.missed = [_Miss(0.0, 0.0, 0.0, 0.0)]
        """In all since the first row, at each row."""

    def lasts(self) -> float:
        """Return the time from the first row to the last, s."""
        return self.times[-1] - self.times[0]

    def add(self, number: int, values: dict[str, float], reading: Reading) -> _Fit:
        """Add a row that follows, across a gap too, or return what keeps it out."""
        step = values["time"] - self.times[-1]
        if step <= 0.0:
            return self._look_back(number, values, reading)
        if step > reading.apart:
            return _Fit("apart")
        stale = self._find_stale(number, values, reading)
        if stale:
            return _Fit("stale", stale)
        parts = math.ceil(min(step / reading.max_gap, _MOST_FILLED + 1))
        if parts > 1 and (not reading.repair or parts > _MOST_FILLED):
            gap = f"a gap of {step:g} s in the track of {self.name!r}"
            sentence = (
                f"{reading.field(number, 'time')}: {gap}, expected at most {reading.max_gap:g} s"
            )
            return _Fit("impossible", sentence)
        return self._fill(number, values, parts, reading)

    def _look_back(self, number: int, values: dict[str, float], reading: Reading) -> _Fit:
        """Return why a row that is not after the last one is kept out: it is of this flight, but
        out of order, where it follows from the row before its time.
        """
        time, (line, last) = values["time"], self.rows[-1]
        sentence = (
            f"{reading.field(number, 'time')}: {time:.15g} s of {self.name!r}, expected more than "
            f"{last['time']:.15g} s as in {reading.noun} {line}"
        )
        before = bisect_right(self.times, time) - 1
        if before < 0:
            return _Fit("apart" if self.times[0] - time > reading.apart else "impossible", sentence)
        flight_before = _Flight(self.name, *self.rows[before])
        return _Fit(
            "impossible" if flight_before.strays(number, values, reading) else "out_of_order",
            sentence,
        )

    def _find_stale(self, number: int, values: dict[str, float], reading: Reading) -> str:
        """Return what is wrong with a position that stays although the aircraft moves, or ""."""
        last, time, speed = self.rows[-1][1], values["time"], values.get("gs", 0.0)
        place = ("lat", "lon") if "lat" in last else ("sx", "sy")
        stays = all(last[key] == values[key] for key in place)
        if not (stays and speed * (time - last["time"]) > reading.standing):
            return ""
        return (
            f"{reading.field(number, place[0])}: the position of {time:.15g} s is that of "
            f"{last['time']:.15g} s at {speed:.0f} m/s, expected another"
        )

    def _fill(self, number: int, values: dict[str, float], parts: int, reading: Reading) -> _Fit:
        """Add a row at the end of so many equal steps, and for the checks one at the end of each
        step before; or none of them where one strays.
        """
        size, last = len(self.rows), self.rows[-1][1]
        for part in range(1, parts + 1):
            row = values
            if part < parts:
                row = {key: _mix(key, last[key], values[key], part / parts) for key in last}
            strays = "no time passes"
            if row["time"] > self.times[-1]:
                strays = self.strays(number, row, reading)
            if strays:
                del self.rows[size:], self.times[size:], self.missed[size:]
                return _Fit("impossible", strays)
            self.rows.append((number, row))
            self.times.append(row["time"])
        self.reported.append((number, values))
        return _Fit(filled=parts - 1)

    def strays(self, number: int, values: dict[str, float], reading: Reading) -> str:
        """Return why no aircraft can come from the last rows to another; "" if one can: what it
        misses is noted.
        """
        step = values["time"] - self.times[-1]
        missed = _Miss(*_misses(self.rows[-1][1], values), 0.25 * ACCELERATION * step * step)
        total = _Miss(*map(operator.add, self.missed[-1], missed))
        begin = max(bisect_right(self.times, values["time"] - WINDOW) - 1, 0)
        of_window = _Miss(*map(operator.sub, total, self.missed[begin]))
        problem = self._too_far(-1, missed, number, values, reading)
        problem = problem or self._too_far(begin, of_window, number, values, reading)
        if not problem:
            self.missed.append(total)
        return problem

    def _too_far(
        self, row: int, missed: _Miss, number: int, values: dict[str, float], reading: Reading
    ) -> str:
        """Return which bound is missed since one of the rows, or ""."""
        seconds = values["time"] - self.times[row]
        position = POSITION + VELOCITY * seconds + missed.bend
        for key, off, limit in (
            ("alt", abs(missed.up), HEIGHT + CLIMB * seconds),
            ("lat" if "lat" in values else "sx", math.hypot(missed.east, missed.north), position),
        ):
            if not off <= limit:
                return (
                    f"{reading.field(number, key)}: {off:.0f} m off where {reading.noun} "
                    f"{self.rows[row][0]} of {self.name!r} and the velocities since lead in "
                    f"{seconds:g} s, expected at most {limit:.0f} m"
                )
        return ""


def _lasting(group: list[_Flight]) -> list[_Flight]:
    """Return the longest of flights that contradict each other, and those long enough to be real,
    in their order.
    """
    longest = max(group, key=lambda flight: len(flight.rows))
    return [flight for flight in group if flight is longest or flight.lasts() >= _LASTING]


def _count_rows(flights: list[_Flight]) -> int:
    return sum(len(flight.reported) for flight in flights)


def _misses(before: dict[str, float], after: dict[str, float]) -> tuple[float, float, float]:
    """Return how far a row is, east, north and up, m, from where the velocities of both rows lead
    from the first.
    """
    step, turn = after["time"] - before["time"], 0.0
    if "lat" in before:
        azimuth, back_azimuth, length = wgs84().inv(
            before["lon"], before["lat"], after["lon"], after["lat"], radians=True
        )
        east, north = length * math.sin(azimuth), length * math.cos(azimuth)
        turn = back_azimuth + math.pi - azimuth if length > 1e-6 else 0.0
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
