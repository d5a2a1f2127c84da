"""Messages of ``rlcas_msgs`` as domain values: every field checked, altitudes with their reference,
times in ns.

Messages are read by their fields (:mod:`ros_bridge.core.fields`), so nothing here imports ROS.
"""

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from agents.planner.request.request import Altitude
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.categories import LAST
from ros_bridge.core.fields import (
    FieldError,
    Sighting,
    callsign,
    flags,
    identifier,
    integer,
    number,
    place,
    readable,
    stamp,
)
from ros_bridge.core.reports import FASTEST, Report

if TYPE_CHECKING:
    from rlcas_msgs.msg import AircraftState, GeoReference, TrafficAlert, Trajectory, Waypoint

POSITION, ALTITUDE, VELOCITY, VERTICAL_SPEED = (1 << n for n in range(4))
TRUE_AIRSPEED, WIND, POSITION_STD, VELOCITY_STD, TIME_STD = (1 << n for n in range(4, 9))
"""Bits of AircraftState.valid."""

POINT_ALTITUDE, POINT_TRACK, POINT_SPEED, POINT_TIME, POINT_CLIMB = (1 << n for n in range(5))
"""Bits of Waypoint.valid."""

ALTITUDE_CODES = {1: "wgs84", 2: "msl", 3: "pressure"}
"""Of altitude references; 0 is unknown."""

ALTITUDE_NUMBERS = {name: code for code, name in ALTITUDE_CODES.items()}

STATUS_SAFE, STATUS_UNRESOLVED, STATUS_WITHDRAWN, STATUS_ROUTE, STATUS_BACKUP = range(1, 6)
ROUTE_POINT, PLAN_POINT = 0, 1
_LAST_INDEX = 2**31 - 1
_LONGEST_ROUTE = 1_000  # points: in 100 km, one every 100 m; of more, reading holds up the node
_BITS = (1 << 9) - 1  # of AircraftState.valid, all that are known
_ROUTE_BITS = (1 << 4) - 1  # of Waypoint.valid, where it is a point of a route
_PLAN_BITS = (1 << 5) - 1  # the same of a plan
_CLIMB = (-100.0, 100.0, "m/s")
_WIND = 100.0  # m/s
_AIRSPEED_AGREES = 10.0  # m/s


class Origin(NamedTuple):
    """A geo-reference."""

    frame: LocalFrame
    undulation: float | None  # height of the geoid above the ellipsoid, m; None: unknown


class Alert(NamedTuple):
    """A traffic alert."""

    time: int  # ns
    level: int
    identifiers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Station:
    """A point of the route on the ellipsoid."""

    index: int
    latitude: float
    longitude: float
    altitude: Altitude | None


Route = tuple[Station, ...]
"""A filed route."""


@dataclass(frozen=True, slots=True)
class PlanPoint:
    """A waypoint of a plan on the ellipsoid."""

    index: int
    of_route: bool
    latitude: float
    longitude: float
    # its vertical speed is the climb of the leg that begins here; None: the plan is in the plane
    altitude: Altitude | None
    track_deg: float  # clockwise from true north, [0, 360)
    speed: float  # over the ground, m/s
    time: int  # of arrival, ns


class Published(NamedTuple):
    """A plan as it was published."""

    unique: bytes
    revision: int
    began: int  # ns
    start: PlanPoint
    points: tuple[PlanPoint, ...]
    identifiers: tuple[str, ...]  # of the intruders that it takes account of
    wind: tuple[float, float] = (0.0, 0.0)  # that it is flown in, east and north at its start, m/s
    wind_std: float = 0.0  # one sigma of both, m/s

    @property
    def climbs(self) -> bool:
        """Whether its altitudes are planned: it climbs, descends or keeps one."""
        return _climbs(self.start)


def report(
    identity: str,
    time: Callable[[], int],
    place: Callable[[], tuple[float, float]],
    velocity: Callable[[], tuple[float, float]],
    altitude: Callable[[], Altitude | None],
    **readers: Callable[[], Any],
) -> Report:
    """Return the report of a message, whatever its kind, from functions that read its parts.

    Args:
        time: ns.
        place: latitude and longitude, degrees.
        velocity: true east and north, m/s.
        **readers: other fields of :class:`ros_bridge.core.reports.Report`.

    Raises:
        FieldError: a part cannot be used; with a sighting of the parts that can.
    """
    try:
        fields = ((name, read()) for name, read in readers.items())  # read after the others
        return Report(identity, time(), *place(), *velocity(), altitude(), **dict(fields))
    except FieldError as error:
        error.sighting = Sighting(identity, readable(time), readable(place), readable(altitude))
        raise


def velocity(name: str, east: Any, north: Any) -> tuple[float, float]:
    """Return a velocity over the ground, true east and north, m/s, or raise :class:`FieldError`."""
    axes = (("x", east), ("y", north))
    east, north = (
        number(f"{name}.velocity.{axis}", component, -FASTEST, FASTEST, "m/s")
        for axis, component in axes
    )
    speed = math.hypot(east, north)
    if speed > FASTEST:
        raise FieldError(f"{name}.velocity", f"is {speed:g} m/s, expected {FASTEST:g} m/s at most")
    return east, north


def altitude(name: str, value: Any, reference: str, climb: float | None) -> Altitude:
    """Return an altitude of a known reference, or raise :class:`FieldError`; the climb, m/s, is
    None where it is unknown.
    """
    return Altitude(number(name, value, -1_000.0, 30_000.0, "m"), reference, climb)


def _altitude(
    name: str, message: "AircraftState | Waypoint", climb: float | None = None
) -> Altitude:
    reference = ALTITUDE_CODES.get(
        integer(f"{name}.altitude_reference", message.altitude_reference, 0, 255)
    )
    if reference is None:
        problem = (
            f"is {message.altitude_reference}, expected one of {sorted(ALTITUDE_CODES)} beside "
            "an altitude"
        )
        raise FieldError(f"{name}.altitude_reference", problem)
    return altitude(f"{name}.altitude", message.altitude, reference, climb)


def aircraft(message: "AircraftState", name: str) -> Report:
    """Return the report that an AircraftState holds, or raise :class:`FieldError` with a
    sighting.
    """
    parts = _AircraftParts(message, name)
    return report(
        identifier(f"{name}.id", message.id),
        lambda: stamp(f"{name}.header.stamp", message.header.stamp),
        parts.place,
        parts.velocity,
        parts.altitude,
        position_std=lambda: parts.std(POSITION_STD, "position_std", 1e4, "m"),
        velocity_std=lambda: parts.std(VELOCITY_STD, "velocity_std", 100.0, "m/s"),
        time_std=lambda: parts.std(TIME_STD, "time_std", 60.0, "s") or 0.0,
        wind=parts.wind,
        true_airspeed=parts.true_airspeed,
        category=lambda: integer(f"{name}.category", message.category, 0, LAST),
        # Recordings made before it was a field have none.
        callsign=lambda: callsign(getattr(message, "callsign", "")),
    )


class _AircraftParts(NamedTuple):
    """Reads the parts of an AircraftState; each raises :class:`FieldError` where it is wrong."""

    message: "AircraftState"
    name: str

    def has(self, bit: int) -> bool:
        """Return whether the message marks a part as valid."""
        return bool(flags(f"{self.name}.valid", self.message.valid, _BITS) & bit)

    def demand_bit(self, bit: int, part: str) -> None:
        """Refuse a message without a part that it must have."""
        if not self.has(bit):
            raise FieldError(
                f"{self.name}.valid",
                f"is {self.message.valid:#x}, expected the bit of the {part}",
            )

    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""
        self.demand_bit(POSITION, "position")
        return place(self.name, self.message.latitude, self.message.longitude)

    def velocity(self) -> tuple[float, float]:
        """Return the velocity over the ground, true east and north, m/s."""
        self.demand_bit(VELOCITY, "velocity")
        return velocity(self.name, self.message.velocity.x, self.message.velocity.y)

    def altitude(self) -> Altitude | None:
        """Return the altitude with its rate; None: unknown."""
        climb = None
        if self.has(VERTICAL_SPEED):
            climb = number(f"{self.name}.velocity.z", self.message.velocity.z, *_CLIMB)
        return _altitude(self.name, self.message, climb) if self.has(ALTITUDE) else None

    def wind(self) -> tuple[float, float] | None:
        """Return the wind, true east and north, m/s; None: unknown."""
        if not self.has(WIND):
            return None
        name, wind = self.name, self.message.wind
        return (
            number(f"{name}.wind.x", wind.x, -_WIND, _WIND, "m/s"),
            number(f"{name}.wind.y", wind.y, -_WIND, _WIND, "m/s"),
        )

    def true_airspeed(self) -> float | None:
        """Return the true airspeed, m/s, which must agree with velocity and wind; None: unknown."""
        if not self.has(TRUE_AIRSPEED):
            return None
        field = f"{self.name}.true_airspeed"
        speed = number(field, self.message.true_airspeed, 0.0, FASTEST, "m/s")
        (east, north), air = self.velocity(), self.wind()
        through_air = speed if air is None else math.hypot(east - air[0], north - air[1])
        if abs(through_air - speed) > _AIRSPEED_AGREES:
            problem = (
                f"is {speed:g} m/s, expected it within {_AIRSPEED_AGREES:g} m/s of what "
                "velocity and wind make"
            )
            raise FieldError(field, f"{problem}, {through_air:g} m/s")
        return speed

    def std(self, bit: int, field: str, most: float, unit: str) -> float | None:
        """Return a standard deviation, at most so much; None: unknown."""
        if not self.has(bit):
            return None
        return number(f"{self.name}.{field}", getattr(self.message, field), 0.0, most, unit)


def geo_reference(message: "GeoReference") -> Origin:
    """Return the origin that a GeoReference holds, or raise :class:`FieldError`."""
    frame = LocalFrame(*place("geo_reference", message.latitude, message.longitude))
    undulation = None
    if message.geoid_undulation_valid:
        undulation = number(
            "geo_reference.geoid_undulation", message.geoid_undulation, -120.0, 100.0, "m"
        )
    return Origin(frame, undulation)


def alert(message: "TrafficAlert") -> Alert:
    """Return the alert that a TrafficAlert holds, or raise :class:`FieldError`."""
    time = stamp("alert.header.stamp", message.header.stamp)
    level = integer("alert.level", message.level, 0, 3)
    ids = tuple(
        identifier(f"alert.intruder_ids[{n}]", identity)
        for n, identity in enumerate(message.intruder_ids)
    )
    _check_unique(ids, "alert.intruder_ids[{}]")
    if (level == 0) != (not ids):
        raise FieldError(
            "alert.intruder_ids",
            f"has {len(ids)} names at level {level}, expected names above level 0 only",
        )
    return Alert(time, level, ids)


def route(waypoints: Collection["Waypoint"], name: str = "route") -> Route:
    """Return the route that waypoints of origin ROUTE make, 2 to 1000, or raise
    :class:`FieldError`.
    """
    if not 2 <= len(waypoints) <= _LONGEST_ROUTE:
        raise FieldError(
            f"{name}.waypoints", f"has {len(waypoints)} points, expected 2 to {_LONGEST_ROUTE}"
        )
    points = []
    for number_, point in enumerate(waypoints):
        at = f"{name}.waypoints[{number_}]"
        if integer(f"{at}.origin", point.origin, 0, 255) != ROUTE_POINT:
            raise FieldError(f"{at}.origin", f"is {point.origin}, expected {ROUTE_POINT} (ROUTE)")
        index = integer(f"{at}.index", point.index, 0, _LAST_INDEX)
        points.append(
            Station(
                index, *place(at, point.latitude, point.longitude), _height(at, point, _ROUTE_BITS)
            )
        )
    _check_unique([point.index for point in points], f"{name}.waypoints[{{}}].index")
    return tuple(points)


def published_route(message: "Trajectory") -> Route:
    """Return the route that a Trajectory of status ROUTE holds, or raise :class:`FieldError`."""
    if message.status != STATUS_ROUTE:
        raise FieldError("route.status", f"is {message.status}, expected {STATUS_ROUTE} (ROUTE)")
    return route(message.waypoints)


def plan_point(message: "Waypoint", name: str) -> PlanPoint:
    """Return a waypoint of a plan, all of whose fields must be valid, or raise
    :class:`FieldError`.
    """
    valid = flags(f"{name}.valid", message.valid, _PLAN_BITS)
    required = POINT_TRACK | POINT_SPEED | POINT_TIME
    if valid & required != required:
        raise FieldError(
            f"{name}.valid", f"is {valid:#x}, expected track, ground speed and time of arrival"
        )
    return PlanPoint(
        integer(f"{name}.index", message.index, 0, _LAST_INDEX),
        integer(f"{name}.origin", message.origin, ROUTE_POINT, PLAN_POINT) == ROUTE_POINT,
        *place(name, message.latitude, message.longitude),
        _height(name, message, _PLAN_BITS, _climb(name, message)),
        number(f"{name}.track_deg", message.track_deg, 0.0, 360.0, "degrees"),
        number(f"{name}.ground_speed", message.ground_speed, 0.0, FASTEST, "m/s"),
        stamp(f"{name}.time_of_arrival", message.time_of_arrival),
    )


def trajectory(message: "Trajectory", name: str = "trajectory") -> Published:
    """Return a plan or a backup, whose times increase and whose indices differ, and of whose points
    all climb or none, or raise :class:`FieldError`.
    """
    began = stamp(f"{name}.header.stamp", message.header.stamp)
    start = plan_point(message.start, f"{name}.start")
    points = tuple(
        plan_point(point, f"{name}.waypoints[{n}]") for n, point in enumerate(message.waypoints)
    )
    _check_unique([point.index for point in points], f"{name}.waypoints[{{}}].index")
    for number_, (before, after) in enumerate(
        itertools.pairwise([began, *(point.time for point in points)])
    ):
        if after <= before:
            at = f"{name}.waypoints[{number_}].time_of_arrival"
            raise FieldError(at, "is not after the one before, expected later")
    _check_climbs(start, points, name)
    east, north = (
        number(f"{name}.wind.{axis}", getattr(message.wind, axis), -_WIND, _WIND, "m/s")
        for axis in "xy"
    )
    return Published(
        bytes(message.id.uuid),
        message.revision,
        began,
        start,
        points,
        tuple(message.intruder_ids),
        wind=(east, north),
        wind_std=number(f"{name}.wind_std", message.wind_std, 0.0, _WIND, "m/s"),
    )


def _check_unique(values: Sequence[object], field: str) -> None:
    """Refuse a value that stands twice; ``field`` has a place for its number."""
    earlier = set()
    for number_, value in enumerate(values):
        if value in earlier:
            raise FieldError(field.format(number_), f"is {value!r} again, expected it once")
        earlier.add(value)


def _height(
    name: str, point: "Waypoint", known_bits: int, climb: float | None = None
) -> Altitude | None:
    """Return the altitude of a waypoint of which some bits are known; None: it has none."""
    valid = flags(f"{name}.valid", point.valid, known_bits)
    return _altitude(name, point, climb) if valid & POINT_ALTITUDE else None


def _climb(name: str, point: "Waypoint") -> float | None:
    """Return the climb of the leg that begins at a waypoint, m/s; None: the plan is in the
    plane.
    """
    if not point.valid & POINT_CLIMB:
        return None
    if not point.valid & POINT_ALTITUDE:
        problem = f"is {point.valid:#x}, expected the altitude beside the climb"
        raise FieldError(f"{name}.valid", problem)
    return number(f"{name}.climb", point.climb, *_CLIMB)


def _climbs(point: PlanPoint) -> bool:
    return point.altitude is not None and point.altitude.vertical_speed is not None


def _check_climbs(start: PlanPoint, points: Sequence[PlanPoint], name: str) -> None:
    """Refuse a plan of whose points some climb and others not, or in several references."""
    for number_, point in enumerate(points):
        field = f"{name}.waypoints[{number_}]"
        if _climbs(point) is not _climbs(start):
            has, expected = ("no", "one") if _climbs(start) else ("a", "none")
            raise FieldError(f"{field}.valid", f"has {has} climb, expected {expected} as the start")
        if not _climbs(start):
            continue
        assert start.altitude is not None and point.altitude is not None
        reference = start.altitude.reference
        if point.altitude.reference != reference:
            problem = f"is that of {point.altitude.reference}, expected the start's, {reference}"
            raise FieldError(f"{field}.altitude_reference", problem)
