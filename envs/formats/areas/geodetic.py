"""Areas on the ellipsoid, as files state them, and what their readers share."""

import math
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple

from envs.areas import AreaError, Keep, Level, Place

FOOT = 0.3048
"""m."""

OFF = 0.5
"""By how much an edge may leave the line that the file means, m."""

_MOST = 100_000  # areas or points of a file
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


class Reading(NamedTuple):
    """What a file holds."""

    areas: tuple[GeodeticArea, ...]
    free: int = 0  # UAS zones that are left out, because their restriction is no obstacle


def record(value: object, where: str) -> dict[str, Any]:
    """Return an object of a file."""
    if not isinstance(value, dict):
        raise AreaError(f"{where}: is {value!r:.60}, expected an object")
    return value


def rows(value: object, where: str, least: int = 0) -> list[Any]:
    """Return a list of a file, of ``least`` entries or more."""
    if not isinstance(value, list):
        raise AreaError(f"{where}: is {value!r:.60}, expected a list")
    if len(value) > _MOST:
        raise AreaError(f"{where}: has {len(value)} entries, expected {_MOST} at most")
    if len(value) < least:
        raise AreaError(f"{where}: has {len(value)} entries, expected {least} or more")
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
        place(point, f"{where}[{n}]", longitude_first=longitude_first)
        for n, point in enumerate(rows(value, where))
    )
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    if len(set(points)) < 3:
        raise AreaError(f"{where}: has {len(set(points))} different points, expected 3 or more")
    return points


def polygon(value: object, where: str) -> tuple[tuple[Place, ...], ...]:
    """Return the rings of a polygon of GeoJSON."""
    rings = rows(value, where, 1)
    return tuple(
        ring(points, f"{where}[{n}]", longitude_first=True) for n, points in enumerate(rings)
    )


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
        date = datetime.fromisoformat(text(value, where))
    except ValueError:
        raise AreaError(
            f"{where}: is {value!r:.60}, expected a date such as 2026-11-27T16:00:00Z"
        ) from None
    return date if date.tzinfo is not None else date.replace(tzinfo=zone)


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
