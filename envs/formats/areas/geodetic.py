"""Areas on the ellipsoid, as files state them, and on the plane of a local frame."""

import math
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple

import numpy as np

from envs.areas import Area, AreaError, Circle, Keep, Level, Place, Polygon, RingError, check_simple
from envs.formats.local_frame import LocalFrame

FOOT = 0.3048
"""m."""

OFF = 0.5
"""By how much an edge may leave the line that the file means, m."""

_MOST = 100_000  # areas or points of a file
_DEGREE = 111_000.0  # m, about, of latitude
_UTMOST_ZONES = timezone(timedelta(hours=14)), timezone(timedelta(hours=-12))


class Period(NamedTuple):
    """When an area is valid; None: without limit, and where it is not known."""

    begin: datetime | None = None
    end: datetime | None = None


class GeodeticArea(NamedTuple):
    """An area of a file; places are latitude and longitude, degrees."""

    where: str  # which one it is in the file
    rings: tuple[tuple[Place, ...], ...] = ()  # the outer one first
    centre: Place | None = None  # of a circle
    radius: float = 0.0  # m
    keep: Keep = Keep.OUT
    floor: Level | None = None
    ceiling: Level | None = None
    period: Period = Period()
    name: str = ""
    more: dict[str, Any] = {}  # noqa: RUF012 - never changed
    """Fields of :class:`envs.areas.Area` that only files of our own state."""


def on_plane(
    one: GeodeticArea, frame: LocalFrame, time: datetime | None, within: float
) -> Area | None:
    """Return an area in a local frame at the time of the request; None where it is to be kept out
    of and lies farther than ``within`` (m) from the origin.
    """
    with error_place(one.where):
        places = one.rings if one.centre is None else ((one.centre,),)
        rings = [np.array(_places(ring, frame)) for ring in places]
        # From the origin to the rectangle around the outer ring.
        nearest = np.hypot(*np.maximum(np.maximum(rings[0].min(axis=0), -rings[0].max(axis=0)), 0))
        if one.keep is Keep.OUT and nearest - one.radius > within:
            return None
        shape: Polygon | Circle
        if one.centre is not None:
            x, y = rings[0][0].tolist()
            shape = Circle(x, y, one.radius)
        else:
            outer, *holes = (tuple(map(tuple, ring.tolist())) for ring in rings)
            try:
                shape = Polygon(outer, tuple(holes))
            except RingError:
                _check_as_stated(one)
                raise
        fields = dict(one.more)
        if time is not None and one.period.begin is not None:
            fields["valid_from"] = (one.period.begin - time).total_seconds()
        if time is not None and one.period.end is not None:
            fields["valid_until"] = (one.period.end - time).total_seconds()
        return Area(shape, one.keep, floor=one.floor, ceiling=one.ceiling, name=one.name, **fields)


@contextmanager
def error_place(where: str) -> Generator[None]:
    """Say in an error of an area where it stands."""
    try:
        yield
    except AreaError as problem:
        raise AreaError(f"{where}: {problem}") from None


def _check_as_stated(one: GeodeticArea) -> None:
    """Refuse rings that cross themselves as the file states them, by the numbers of its points: in
    the local frame there are more.
    """
    for n, ring in enumerate(one.rings):
        numbers = [k for k, point in enumerate(ring) if point != ring[k - 1]]
        latitude, longitude = np.array([ring[k] for k in numbers], dtype=float).T
        # About metres; what is straight in degrees is straight in them.
        x = np.unwrap(longitude, period=360.0) * math.cos(math.radians(latitude[0])) * _DEGREE
        points = tuple(zip(x.tolist(), (latitude * _DEGREE).tolist(), strict=True))
        check_simple("outer" if n == 0 else f"holes[{n - 1}]", points, numbers)


def _places(ring: Sequence[Place], frame: LocalFrame) -> list[Place]:
    """Return a ring in a local frame, m.

    Its edges are straight in degrees; points are added where they are not straight in the frame.
    """
    latitude, longitude = np.array(ring, dtype=float).T
    longitude = np.unwrap(longitude, period=360.0)
    here = frame.place(latitude, longitude)
    if len(ring) == 1:
        return [(float(here.x[0]), float(here.y[0]))]
    lat1, lon1 = np.roll(latitude, -1), np.roll(longitude, -1)
    middle = frame.place(0.5 * (latitude + lat1), 0.5 * (longitude + lon1))
    off = np.hypot(
        middle.x - 0.5 * (here.x + np.roll(here.x, -1)),
        middle.y - 0.5 * (here.y + np.roll(here.y, -1)),
    )
    # Of n parts of an edge each leaves the line by an n-th of an n-th.
    parts = np.maximum(np.ceil(np.sqrt(off / OFF)), 1.0).astype(int)
    if parts.sum() > _MOST:
        raise AreaError(f"needs {parts.sum()} points in the local frame, expected {_MOST} at most")
    shares = [np.arange(count) / count for count in parts]
    whole_lat, whole_lon = (
        np.concatenate([a + share * (b - a) for a, b, share in zip(*ends, shares, strict=True)])
        for ends in ((latitude, lat1), (longitude, lon1))
    )
    fine = frame.place(whole_lat, whole_lon)
    return list(zip(fine.x.tolist(), fine.y.tolist(), strict=True))


def record(value: object, where: str) -> dict[str, Any]:
    """Return an object of a file."""
    if not isinstance(value, dict):
        raise AreaError(f"{where}: is {value!r:.60}, expected an object")
    return value


def rows(value: object, where: str) -> list[Any]:
    """Return a list of a file."""
    if not isinstance(value, list):
        raise AreaError(f"{where}: is {value!r:.60}, expected a list")
    if len(value) > _MOST:
        raise AreaError(f"{where}: has {len(value)} entries, expected {_MOST} at most")
    return value


def number(
    value: object, where: str, low: float = -1e9, high: float = 1e9, unit: str = ""
) -> float:
    """Return a number of a file in a range."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high:
        return float(value)
    raise AreaError(f"{where}: is {value!r:.60}, expected {low:g} to {high:g} {unit}".rstrip())


def text(value: object, where: str) -> str:
    """Return a text of a file."""
    if not isinstance(value, str):
        raise AreaError(f"{where}: is {value!r:.60}, expected a text")
    return value


def place(value: object, where: str, *, longitude_first: bool) -> Place:
    """Return latitude and longitude of a pair of a file, degrees; a third number, the height, is
    not read.
    """
    pair = rows(value, where)
    if not 2 <= len(pair) <= 3:
        raise AreaError(f"{where}: has {len(pair)} numbers, expected a place of two")
    longitude, latitude = pair[:2] if longitude_first else pair[1::-1]
    return (
        number(latitude, f"{where}, latitude", -90.0, 90.0, "degrees"),
        number(longitude, f"{where}, longitude", -360.0, 360.0, "degrees"),
    )


def ring(value: object, where: str, *, longitude_first: bool) -> tuple[Place, ...]:
    """Return a ring of places of a file; a first point that is repeated at the end is left out."""
    points = tuple(
        place(each, f"{where}[{n}]", longitude_first=longitude_first)
        for n, each in enumerate(rows(value, where))
    )
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    if len(set(points)) < 3:
        raise AreaError(f"{where}: has {len(set(points))} different points, expected 3 or more")
    return points


def polygon(value: object, where: str) -> tuple[tuple[Place, ...], ...]:
    """Return the rings of a polygon of GeoJSON."""
    rings = rows(value, where)
    if not rings:
        raise AreaError(f"{where}: is empty, expected a ring")
    return tuple(ring(each, f"{where}[{n}]", longitude_first=True) for n, each in enumerate(rings))


def period(begin: object, end: object, where: str, names: tuple[str, str]) -> Period:
    """Return when an area is valid, from the dates of a file, None or empty where it states none.

    A date without a zone may be of any on earth: a beginning is taken in the first zone that
    reaches it, an end in the last. ``names`` are those of the fields, for messages.
    """
    began, ended = (
        _date(value, f"{where}{name}", zone)
        for value, name, zone in zip((begin, end), names, _UTMOST_ZONES, strict=True)
    )
    if began is not None and ended is not None and began >= ended:
        first, last = names
        raise AreaError(
            f"{where}{last}: is {end!r:.60}, expected a date after {first}, {begin!r:.60}"
        )
    return Period(began, ended)


def _date(value: object, where: str, zone: timezone) -> datetime | None:
    """Return a date of a file, in a zone where it names none."""
    if value is None or value == "":
        return None
    try:
        found = datetime.fromisoformat(text(value, where))
    except ValueError:
        raise AreaError(
            f"{where}: is {value!r:.60}, expected a date such as 2026-11-27T16:00:00Z"
        ) from None
    return found if found.tzinfo is not None else found.replace(tzinfo=zone)


def hull(periods: Sequence[Period]) -> Period:
    """Return the time from the first beginning to the last end of periods; without any, always."""
    if not periods:
        return Period()
    begins, ends = zip(*periods, strict=True)
    return Period(
        None if None in begins else min(begins),
        None if None in ends else max(ends),
    )


def level(value: object, reference: str, factor: float, where: str) -> Level | None:
    """Return a height in m; None where the file has none."""
    if value is None:
        return None
    metres = factor * number(value, where, -1e6, 1e6)
    return Level(metres, reference) if math.isfinite(metres) else None
