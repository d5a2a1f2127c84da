"""Areas of ``rlcas_msgs`` as areas of the local frame, as they are at a request, and back."""

import math
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, NamedTuple

from envs.areas import Area, AreaError, Circle, Keep, Level, after
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.areas.placement import far_away, to_plane
from envs.formats.areas.reading import geodetic_areas
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.conversions import ALTITUDE_CODES
from ros_bridge.core.fields import SECOND, FieldError, flags, integer, number, place, stamp

if TYPE_CHECKING:
    from rlcas_msgs.msg import Area as AreaMessage
    from rlcas_msgs.msg import Areas, Ring

FLOOR, CEILING, FROM, UNTIL = (1 << n for n in range(4))
"""Bits of Area.valid."""

REFERENCES = ALTITUDE_CODES | {4: "ground"}
"""Of the heights of areas."""

_LONGEST_ID = 64  # bytes
_MOST = 1_000  # areas of a message
_SIDES = (Keep.OUT, Keep.IN)


class AreaReport(NamedTuple):
    """Areas, as they are at a time."""

    time: int  # ns
    areas: tuple[GeodeticArea, ...]


class Placed(NamedTuple):
    """Areas in a local frame, as they are at the time of their report, ns."""

    time: int
    areas: tuple[Area, ...]
    far: str = ""  # a sentence on those that are left out; empty: none are
    changes: tuple[str, ...] = ()  # sentences: which were clipped or thinned

    def at(self, moment: int) -> tuple[Area, ...]:
        """Return them as they are at a moment, ns."""
        return tuple(after(area, (moment - self.time) / SECOND) for area in self.areas)


def above_ellipsoid(level: Level | None, undulation: float | None) -> Level | None:
    """Return a height above the sea as one above the ellipsoid, by the height of the geoid above
    it, m; None, of either: it stays.
    """
    if level is None or undulation is None or level.reference != "msl":
        return level
    return Level(level.value + undulation, "wgs84")


def comparable_areas(placed: Placed, undulation: float | None) -> Placed:
    """Return areas with heights above the ellipsoid where they were above the sea, as
    :func:`ros_bridge.core.reach.level` has altitudes.
    """
    changed = tuple(
        replace(
            area,
            floor=above_ellipsoid(area.floor, undulation),
            ceiling=above_ellipsoid(area.ceiling, undulation),
        )
        if "msl" in {level.reference for level in (area.floor, area.ceiling) if level}
        else area
        for area in placed.areas
    )
    return placed._replace(areas=changed)


def areas(message: "Areas", name: str = "areas") -> AreaReport:
    """Return what an Areas message holds, or raise :class:`FieldError`."""
    time = stamp(f"{name}.header.stamp", message.header.stamp)
    if len(message.areas) > _MOST:
        raise FieldError(
            f"{name}.areas", f"has {len(message.areas)} areas, expected {_MOST} at most"
        )
    reports = (_area(f"{name}.areas[{n}]", area, time) for n, area in enumerate(message.areas))
    return AreaReport(time, tuple(reports))


def to_local(report: AreaReport, frame: LocalFrame, moment: int, within: float) -> tuple[Area, ...]:
    """Return the areas in a local frame at the time of a request, or raise :class:`FieldError`.

    Args:
        report: what was reported last.
        frame: the local frame.
        moment: time of the request, ns.
        within: areas to be kept out of that lie farther from the frame's origin are left out, m.
    """
    return place_areas(report, frame, within).at(moment)


def place_areas(report: AreaReport, frame: LocalFrame, within: float) -> Placed:
    """Return the areas of a report in a local frame; see :func:`to_local`."""
    areas, far, changes = list[Area](), list[GeodeticArea](), list[str]()
    date = datetime.fromtimestamp(report.time / SECOND, UTC)
    for area in report.areas:
        try:
            placed = to_plane([area._replace(where="is no area")], frame, date, within)
        except AreaError as problem:
            raise FieldError(area.where, str(problem)) from None
        areas += placed.areas
        far += placed.far
        changes += (change.replace("is no area", area.where, 1) for change in placed.changes)
    left_out = far_away(far, frame, within) if far else ""
    return Placed(report.time, tuple(areas), left_out, tuple(changes))


def to_geodetic(area: Area, frame: LocalFrame) -> GeodeticArea:
    """Return an area of a local frame on the ellipsoid."""
    names = ("velocity", "growth", "clearance", "valid_from", "valid_until")
    placed = GeodeticArea(
        "",
        keep=area.keep,
        floor=area.floor,
        ceiling=area.ceiling,
        name=area.name,
        more={name: getattr(area, name) for name in names},
    )
    if isinstance(area.shape, Circle):
        centre = frame.geodetic(area.shape.x, area.shape.y)
        place = float(centre.latitude), float(centre.longitude)
        return placed._replace(centre=place, radius=area.shape.radius)
    rings = (frame.geodetic(*zip(*ring, strict=True)) for ring in area.shape.rings)
    return placed._replace(
        rings=tuple(
            tuple(zip(ring.latitude.tolist(), ring.longitude.tolist(), strict=True))
            for ring in rings
        )
    )


def areas_of_file(path: str) -> tuple[GeodeticArea, ...]:
    """Return the areas of a file, which stand; of "" none. Their dates count by the clock.

    Raises:
        AreaError: the file cannot be read or holds none, or an area in it moves or cannot be used.
    """
    if not path:
        return ()
    areas = geodetic_areas(path).areas
    if not areas:
        raise AreaError(f"{path}: holds no area that is an obstacle, expected one or more")
    for area in areas:
        for name in ("velocity", "growth", "valid_from", "valid_until"):
            if name in area.more and area.more[name] not in (0.0, (0.0, 0.0)):
                raise AreaError(
                    f"{area.where}: has {name}, expected an area that stands, valid between dates: "
                    "of what moves, or counts from a request on, messages tell"
                )
        # What cannot be used is refused now, in a frame about it.
        latitude, longitude = area.centre or area.rings[0][0]
        to_plane([area], LocalFrame(min(max(latitude, -80.0), 80.0), longitude), None, math.inf)
    return areas


def _area(name: str, message: "AreaMessage", time: int) -> GeodeticArea:
    """Return an area of a message of a time, ns; its times are s after that."""
    valid = flags(f"{name}.valid", message.valid, FLOOR | CEILING | FROM | UNTIL)
    if len(message.id.encode()) > _LONGEST_ID or not message.id.isprintable():
        problem = f"is {message.id!r:.60}, expected a printable name of {_LONGEST_ID} bytes at most"
        raise FieldError(f"{name}.id", problem)
    floor = ceiling = None
    if valid & FLOOR:
        floor = _level(f"{name}.floor", message.floor, message.floor_reference)
    if valid & CEILING:
        ceiling = _level(f"{name}.ceiling", message.ceiling, message.ceiling_reference)
    begin, end = -math.inf, math.inf
    if valid & FROM:
        begin = (stamp(f"{name}.valid_from", message.valid_from) - time) / SECOND
    if valid & UNTIL:
        end = (stamp(f"{name}.valid_until", message.valid_until) - time) / SECOND
    area = GeodeticArea(
        name,
        keep=_SIDES[integer(f"{name}.keep", message.keep, 0, 1)],
        floor=floor,
        ceiling=ceiling,
        name=message.id,
        more={
            "velocity": (
                number(f"{name}.velocity.x", message.velocity.x, -100.0, 100.0, "m/s"),
                number(f"{name}.velocity.y", message.velocity.y, -100.0, 100.0, "m/s"),
            ),
            "growth": number(f"{name}.growth", message.growth, -100.0, 100.0, "m/s"),
            "clearance": number(f"{name}.clearance", message.clearance, 0.0, 6e4, "m"),
            "valid_from": begin,
            "valid_until": end,
        },
    )
    if message.rings:
        rings = (_ring(f"{name}.rings[{n}]", ring) for n, ring in enumerate(message.rings))
        return area._replace(rings=tuple(rings))
    centre = place(name, message.latitude, message.longitude)
    radius = number(f"{name}.radius", message.radius, 0.0, 3e4, "m")
    return area._replace(centre=centre, radius=radius)


def _ring(name: str, message: "Ring") -> tuple[tuple[float, float], ...]:
    """Return places of three corners or more, degrees."""
    latitudes, longitudes = message.latitude, message.longitude
    if len(latitudes) != len(longitudes):
        raise FieldError(
            f"{name}.longitude",
            f"has {len(longitudes)} numbers, expected {len(latitudes)} as latitude has",
        )
    if len(latitudes) < 3:
        raise FieldError(f"{name}.latitude", f"has {len(latitudes)} points, expected 3 or more")
    return tuple(
        place(f"{name}[{n}]", *pair)
        for n, pair in enumerate(zip(latitudes, longitudes, strict=True))
    )


def _level(name: str, value: float, reference: int) -> Level:
    above = REFERENCES.get(integer(f"{name}_reference", reference, 0, 255))
    if above is None:
        raise FieldError(
            f"{name}_reference", f"is {reference}, expected one of {sorted(REFERENCES)}"
        )
    return Level(number(name, value, -1e4, 1e5, "m"), above)
