"""Missions and fences as they are downloaded from an autopilot: routes and areas.

Which commands are navigation is ArduPilot's own rule (``AP_Mission::is_nav_cmd`` in
libraries/AP_Mission/AP_Mission.cpp, ArduPlane 4.7.0-dev): the numbers up to MAV_CMD_NAV_LAST, and
NAV_SET_YAW_SPEED, NAV_SCRIPT_TIME and NAV_ATTITUDE_TIME. A waypoint whose latitude and longitude
are both 0 is where the aircraft is when it becomes the current one (``Location::sanitize``).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agents.planner.request.request import Altitude
from envs.areas import Keep
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import LocalFrame, distance, wgs84
from ros_bridge.core.conversions import Station
from ros_bridge.core.fields import FieldError, place

if TYPE_CHECKING:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

WAYPOINT, LAND, TAKEOFF = 16, 21, 22
JUMP, JUMP_TAG, JUMP_TO_TAG = 177, 600, 601
_LAST_NAVIGATION = 95  # MAV_CMD_NAV_LAST: greater numbers are conditions and actions,
_MORE_NAVIGATION = frozenset({213, 42_702, 42_703})  # but for these
_CIRCLES = frozenset({17, 18, 19, 31})  # without end, for turns, for a time, to an altitude
_WITH_PLACE = _CIRCLES | {16, 21, 22, 82, 85, 94}
_INCLUSION, _EXCLUSION, _CIRCLE_IN, _CIRCLE_OUT = 5001, 5002, 5003, 5004
_RETURN = 5000
_ABOVE_SEA, _ABOVE_HOME = frozenset({0, 5}), frozenset({3, 6})  # MAV_FRAME
_SAME = 1.0  # m between places that are the same
_LEAST_LEG = 1.5  # m between points of a route, more than the planner requires
_LONGEST = 200  # points of the legs after the last plain waypoint
BEYOND = 12
"""Points of a route straight on behind its last place, as many as a plan may rejoin at."""

SUB = 1_000
"""Points of a leg: the index of a route's point is that of the item that the leg leads to, times
this, and its number on the leg, of which the last is the item's own place.
"""


class Item(NamedTuple):
    """An item of a mission or a fence."""

    number: int
    command: int
    latitude: float  # degrees
    longitude: float
    altitude: float  # m, above what the frame says
    parameter: float = 0.0  # the first
    second: float = 0.0  # parameter
    third: float = 0.0
    frame: int = 3  # MAV_FRAME: above home

    @property
    def flies(self) -> bool:
        """Whether it is flown, rather than done."""
        return self.command <= _LAST_NAVIGATION or self.command in _MORE_NAVIGATION

    @property
    def jumps(self) -> bool:
        """Whether the mission goes on at another item after it."""
        return self.command in (JUMP, JUMP_TO_TAG)

    @property
    def circles(self) -> bool:
        """Whether it is circled."""
        return self.command in _CIRCLES

    @property
    def has_place(self) -> bool:
        """Whether it is flown to a place of its own."""
        return self.command in _WITH_PLACE and self.place != (0.0, 0.0)

    @property
    def plain(self) -> bool:
        """Whether it is a waypoint that is flown through at cruise, which a route may rejoin."""
        return self.command == WAYPOINT and self.parameter == 0.0

    @property
    def place(self) -> tuple[float, float]:
        """Latitude and longitude, degrees."""
        return self.latitude, self.longitude


def item(message: "dialect.MAVLink_mission_item_int_message") -> Item:
    """Return the item of a MISSION_ITEM_INT, or raise :class:`FieldError`."""
    name = f"item {message.seq}"
    latitude, longitude = place(name, 1e-7 * message.x, 1e-7 * message.y)
    return Item(
        int(message.seq),
        int(message.command),
        latitude,
        longitude,
        float(message.z),
        float(message.param1),
        float(message.param2),
        float(message.param3),
        int(message.frame),
    )


def home_altitude(items: Sequence[Item]) -> float | None:
    """Return the altitude of home, item 0, m above mean sea level; None: it is unknown."""
    homes = (item.altitude for item in items if item.number == 0 and item.place != (0.0, 0.0))
    return next(homes, None)


def altitude_of(item: Item, items: Sequence[Item], offset: float = 0.0) -> Altitude | None:
    """Return at which altitude an item of a mission is flown; None: it is above the terrain, or
    above a home that is unknown, or no number.

    Args:
        item: of the mission.
        items: all of the mission.
        offset: that the autopilot adds, ALT_OFFSET, m.
    """
    above = 0.0 if item.frame in _ABOVE_SEA else home_altitude(items)
    if item.frame not in _ABOVE_SEA | _ABOVE_HOME or above is None:
        return None
    value = above + item.altitude + offset
    return Altitude(value, "msl", 0.0) if math.isfinite(value) else None


def remaining_items(items: Sequence[Item], current: int) -> tuple[Item, ...]:
    """Return the waypoints that are still to be flown through, from the current item on, up to
    where something else is to be flown (loiter, land, a jump): what that is,
    :mod:`ros_bridge.mavlink.course` assumes.
    """
    remaining: list[Item] = []
    for item in items:
        if item.number < current or item.number == 0:
            continue
        if item.plain and item.has_place:
            remaining.append(item)
        elif (item.flies and not item.plain) or item.jumps:
            break
    return tuple(remaining)


def begin_at_target(
    remaining: tuple[Item, ...], items: Sequence[Item], latitude: int, longitude: int
) -> tuple[Item, ...]:
    """Return the waypoints that are left, the first of them where the autopilot flies to, 1e-7
    degrees, if no item is there: where a mission is replaced in AUTO, it still flies to the place
    that the item had.
    """
    place = 1e-7 * latitude, 1e-7 * longitude
    if not remaining or any(distance(*item.place, *place) < _SAME for item in items):
        return remaining
    return (remaining[0]._replace(latitude=place[0], longitude=place[1]), *remaining[1:])


def item_before(items: Sequence[Item], current: int) -> Item | None:
    """Return the last item with a place before the current one; None where there is none."""
    places = [item for item in items if 0 < item.number < current and item.has_place]
    return places[-1] if places else None


def route(
    start: tuple[float, float],
    waypoints: Sequence[Item],
    spacing: float,
    onward: "Onward | None" = None,
    altitudes: Mapping[int, Altitude | None] = MappingProxyType({}),
) -> tuple[Station, ...]:
    """Return a mission's waypoints as a route with points on the legs, so that it can be rejoined
    between waypoints that lie far apart, and with what is flown after them.

    Legs are straight in degrees, as ArduPlane flies them, over the antimeridian too. Behind the
    last place the route goes straight on. A point of a leg has the altitude of the item that the
    leg leads to, which AUTO makes for; what is flown after the waypoints has none that is known.

    Args:
        start: where the first leg begins, degrees.
        waypoints: that are left.
        spacing: of the points on a leg at most, m.
        onward: what is flown after the waypoints; None: straight on.
        altitudes: of items, by their numbers.
    """
    if not waypoints and onward is None:
        raise FieldError("mission", "has no waypoint left, expected one or more")
    stations: list[Station] = []
    previous = came_from = start  # where the leg before began, and this one
    for item in waypoints:
        stations += [
            Station(item.number * SUB + part, *point, altitudes.get(item.number))
            for part, point in enumerate(_points(came_from, item.place, spacing), 1)
        ]
        # The last point of a leg is the item's own place, whatever its number on the leg.
        stations[-1] = replace(stations[-1], index=item.number * SUB + SUB - 1)
        if distance(*came_from, *item.place) >= _SAME:
            previous, came_from = came_from, item.place
    if onward is None:
        onward = Onward(waypoints[-1].number + 1, ())
    places = _points_onward(previous, came_from, onward.places, spacing)
    stations += [
        Station(onward.number * SUB + part, *point, None) for part, point in enumerate(places)
    ]
    return _apart(stations)


class Onward(NamedTuple):
    """What is flown after a mission's plain waypoints.

    A route's points there have the index of the item ``number`` times :data:`SUB`, and more.
    """

    number: int  # of the item after the waypoints, or the one that is flown
    places: tuple[tuple[float, float], ...]  # that are flown to, degrees; then straight on


def _points(
    a: tuple[float, float], b: tuple[float, float], spacing: float
) -> list[tuple[float, float]]:
    """Return points of a leg, degrees, of which the last is its end."""
    parts = min(max(round(distance(*a, *b) / spacing), 1), SUB - 2)
    return [*(_between(a, b, part / parts) for part in range(1, parts)), b]


def _points_onward(
    previous: tuple[float, float],
    last: tuple[float, float],
    places: Sequence[tuple[float, float]],
    spacing: float,
) -> list[tuple[float, float]]:
    """Return points from the last waypoint on, degrees: of the legs to some places, as far as
    plans reach, and straight on. ``previous`` is the place before the last waypoint.
    """
    points: list[tuple[float, float]] = []
    for corner in places:
        if len(points) > _LONGEST:
            break
        if distance(*last, *corner) >= _SAME:
            points += _points(last, corner, spacing)[:_LONGEST]
            previous, last = last, corner
    frame = LocalFrame(*last)
    came = frame.place(*previous)
    length = max(math.hypot(float(came.x), float(came.y)), _SAME)
    x, y = (-float(part) / length * spacing for part in (came.x, came.y))
    ahead = frame.geodetic(*(part * np.arange(1, BEYOND + 1) for part in (x, y)))
    return points + list(zip(ahead.latitude.tolist(), ahead.longitude.tolist(), strict=True))


def _apart(stations: Sequence[Station]) -> tuple[Station, ...]:
    """Return stations without those at the place of the one before."""
    latitude = [station.latitude for station in stations]
    longitude = [station.longitude for station in stations]
    gaps = wgs84().inv(longitude[:-1], latitude[:-1], longitude[1:], latitude[1:])[2]
    if min(gaps, default=math.inf) > _LEAST_LEG:
        return tuple(stations)
    apart = list(stations[:1])
    for station in stations[1:]:
        last = apart[-1]
        if (
            distance(last.latitude, last.longitude, station.latitude, station.longitude)
            > _LEAST_LEG
        ):
            apart.append(station)
    return tuple(apart)


def item_after_rejoin(index: int, items: Sequence[Item]) -> int:
    """Return from which item the mission goes on after a point of the route has been rejoined: the
    one that its leg leads to, and after an item's own place the next.

    Beyond the last plain waypoint that is a loiter or a jump, which may begin anywhere; before a
    landing, or anything else that must begin at that waypoint, it is the waypoint. Beyond the
    mission's end it is the number after the last item.
    """
    number, part = divmod(index, SUB)
    by_number = {item.number: item for item in items}
    if part == SUB - 1:
        return number + 1 if number + 1 in by_number else number
    if number not in by_number or by_number[number].plain:
        return number
    items_after = (item for item in items if item.number >= number and (item.flies or item.jumps))
    following = next(items_after, None)
    begins_anywhere = following is not None and (following.jumps or following.circles)
    return number if begins_anywhere else number - 1


def fence(items: Sequence[Item], clearance: float) -> tuple[GeodeticArea, ...]:
    """Return the areas of a fence's items, or raise :class:`FieldError`.

    Args:
        items: of the mission type fence; a polygon is as many items in a row as their first
            parameter says.
        clearance: to be kept from every edge, m.
    """
    areas: list[GeodeticArea] = []
    number = 0
    while number < len(items):
        item = items[number]
        name = f"fence item {item.number}"
        if item.command in (_INCLUSION, _EXCLUSION):
            if not item.parameter.is_integer():  # nor is what is not finite
                raise FieldError(
                    name, f"begins {item.parameter:g} corners, expected a whole number"
                )
            count = int(item.parameter)
            corners = items[number : number + count]
            if count < 3 or len(corners) < count or {c.command for c in corners} != {item.command}:
                raise FieldError(name, f"begins {count} corners, expected 3 or more of one kind")
            keep = Keep.IN if item.command == _INCLUSION else Keep.OUT
            rings = (tuple(corner.place for corner in corners),)
            areas.append(_area(name, keep, clearance)._replace(rings=rings))
            number += count
            continue
        if item.command in (_CIRCLE_IN, _CIRCLE_OUT):
            keep = Keep.IN if item.command == _CIRCLE_IN else Keep.OUT
            if not item.parameter > 0.0:
                raise FieldError(name, f"has the radius {item.parameter:g} m, expected more than 0")
            circle = _area(name, keep, clearance)
            areas.append(circle._replace(centre=item.place, radius=item.parameter))
        elif item.command != _RETURN:
            raise FieldError(name, f"is the command {item.command}, expected 5000 to 5004")
        number += 1
    return tuple(areas)


def _area(name: str, keep: Keep, clearance: float) -> GeodeticArea:
    """Return an area without a shape yet; the clearance is kept from its edges, m."""
    return GeodeticArea(name, keep=keep, name=name, more={"clearance": clearance})


def _between(a: tuple[float, float], b: tuple[float, float], share: float) -> tuple[float, float]:
    """Return a point of the line from a to b, straight in degrees by the shorter way round."""
    east = math.remainder(b[1] - a[1], 360.0)
    return a[0] + share * (b[0] - a[0]), math.remainder(a[1] + share * east, 360.0)
