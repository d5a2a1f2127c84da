"""Missions and fences as they are downloaded from an autopilot: routes and areas."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from envs.areas import Keep
from envs.formats.areas.geodetic import GeodeticArea
from envs.formats.local_frame import distance
from ros_bridge.core.conversions import Station
from ros_bridge.core.fields import FieldError, place

if TYPE_CHECKING:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

WAYPOINT, LAND, TAKEOFF = 16, 21, 22
_LAST_NAVIGATION = 95  # MAV_CMD_NAV_LAST: greater numbers are conditions and actions
_JUMP = 177
_WITH_PLACE = frozenset({16, 17, 18, 19, 21, 22, 31, 82})
_INCLUSION, _EXCLUSION, _CIRCLE_IN, _CIRCLE_OUT = 5001, 5002, 5003, 5004
_RETURN = 5000
_SAME = 1.0  # m between places that are the same
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

    @property
    def flies(self) -> bool:
        """Whether it is flown to, rather than done."""
        return self.command <= _LAST_NAVIGATION

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
    )


def remaining_items(items: Sequence[Item], current: int) -> tuple[Item, ...]:
    """Return the waypoints that are still to be flown through, from the current item on; the
    mission ends here where something else is to be flown (loiter, land, a jump).
    """
    found: list[Item] = []
    for one in items:
        if one.number < current or one.number == 0:
            continue
        if one.plain and (one.latitude, one.longitude) != (0.0, 0.0):
            found.append(one)
        elif one.flies or one.command == _JUMP:
            break
    return tuple(found)


def begin_at_target(
    left: tuple[Item, ...], items: Sequence[Item], latitude: int, longitude: int
) -> tuple[Item, ...]:
    """Return the waypoints that are left, the first of them where the autopilot flies to, 1e-7
    degrees, if no item is there: where a mission is replaced in AUTO, it still flies to the place
    that the item had.
    """
    place = 1e-7 * latitude, 1e-7 * longitude
    if any(distance(*one.place, *place) < _SAME for one in items):
        return left
    return (left[0]._replace(latitude=place[0], longitude=place[1]), *left[1:])


def before(items: Sequence[Item], current: int) -> Item | None:
    """Return the last item with a place before the current one; None where there is none."""
    found = [
        one
        for one in items
        if 0 < one.number < current and one.command in _WITH_PLACE and one.latitude != 0.0
    ]
    return found[-1] if found else None


def route(
    start: tuple[float, float], waypoints: Sequence[Item], spacing: float
) -> tuple[Station, ...]:
    """Return a mission's waypoints as a route with points on the legs, so that it can be rejoined
    between waypoints that lie far apart.

    Where one waypoint is left alone the route goes on in the last leg's direction.

    Args:
        start: where the first leg begins, degrees.
        waypoints: that are left, one at least.
        spacing: of the points on a leg at most, m.
    """
    if not waypoints:
        raise FieldError("mission", "has no waypoint left, expected one or more")
    stations: list[Station] = []
    came_from = start
    for one in waypoints:
        length = distance(*came_from, *one.place)
        parts = min(max(round(length / spacing), 1), SUB - 2)
        stations.extend(
            Station(one.number * SUB + part, *_between(came_from, one.place, part / parts), None)
            for part in range(1, parts)
        )
        stations.append(Station(one.number * SUB + SUB - 1, *one.place, None))
        came_from = one.place
    if len(waypoints) == 1 and len(stations) == 1:
        last = waypoints[0]
        beyond = _between(start, last.place, 2.0)
        stations.append(Station((last.number + 1) * SUB, *beyond, None))
    return tuple(stations)


def item_after_rejoin(index: int, items: Sequence[Item]) -> int:
    """Return from which item the mission goes on after a point of the route has been rejoined: the
    one that its leg leads to, and after an item's own place the next.
    """
    number, part = divmod(index, SUB)
    if part == SUB - 1 and any(one.number == number + 1 for one in items):
        return number + 1
    return number


def fence(items: Sequence[Item], clearance: float) -> tuple[GeodeticArea, ...]:
    """Return the areas of a fence's items, or raise :class:`FieldError`.

    Args:
        items: of the mission type fence; a polygon is as many items in a row as their first
            parameter says.
        clearance: to be kept from every edge, m.
    """
    found: list[GeodeticArea] = []
    number = 0
    while number < len(items):
        one = items[number]
        name = f"fence item {one.number}"
        if one.command in (_INCLUSION, _EXCLUSION):
            if not one.parameter.is_integer():  # nor is what is not finite
                raise FieldError(name, f"begins {one.parameter:g} corners, expected a whole number")
            count = int(one.parameter)
            corners = items[number : number + count]
            if count < 3 or len(corners) < count or {c.command for c in corners} != {one.command}:
                raise FieldError(name, f"begins {count} corners, expected 3 or more of one kind")
            keep = Keep.IN if one.command == _INCLUSION else Keep.OUT
            rings = (tuple(corner.place for corner in corners),)
            found.append(_area(name, keep, clearance)._replace(rings=rings))
            number += count
            continue
        if one.command in (_CIRCLE_IN, _CIRCLE_OUT):
            keep = Keep.IN if one.command == _CIRCLE_IN else Keep.OUT
            if not one.parameter > 0.0:
                raise FieldError(name, f"has the radius {one.parameter:g} m, expected more than 0")
            circle = _area(name, keep, clearance)
            found.append(circle._replace(centre=one.place, radius=one.parameter))
        elif one.command != _RETURN:
            raise FieldError(name, f"is the command {one.command}, expected 5000 to 5004")
        number += 1
    return tuple(found)


def _area(name: str, keep: Keep, clearance: float) -> GeodeticArea:
    """Return an area without a shape yet; the clearance is kept from its edges, m."""
    return GeodeticArea(name, keep=keep, name=name, more={"clearance": clearance})


def _between(a: tuple[float, float], b: tuple[float, float], share: float) -> tuple[float, float]:
    """Return a point of the line from a to b, degrees; legs of missions are short enough for
    straight lines in degrees.
    """
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
