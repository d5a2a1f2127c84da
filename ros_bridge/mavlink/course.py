"""The way that the autopilot flies on its mission: what is watched, and where plans may rejoin it.

What comes after the plain waypoints is assumed by its kind, by ArduPlane's own rules (4.7.0-dev:
libraries/AP_Mission/AP_Mission.cpp, ArduPlane/commands_logic.cpp and navigation.cpp):

- DO_JUMP goes on at the item of its number, DO_JUMP_TAG at the first JUMP_TAG with its tag, as
  often as the second parameter says, always where that is -1 (``get_next_cmd``). How often it has
  been done nobody sends; so both ways are watched where the number is finite.
- a loiter circles about its place, or on the spot without one, with the radius of its third
  parameter (LOITER_TO_ALT: the second), or WP_LOITER_RAD; a negative one is counterclockwise
  (``update_loiter``).
- a landing is flown to its place.
- at the mission's end, and at RETURN_TO_LAUNCH, the mode is RTL (``exit_mission_callback``): the
  way home, item 0, is watched beside the one straight on.

Behind all of that, and where the kind tells no place, straight on is assumed.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from envs.formats.local_frame import LocalFrame, distance, fly_straight
from ros_bridge.core.conversions import Route
from ros_bridge.core.fields import FieldError
from ros_bridge.core.reports import Report
from ros_bridge.mavlink import mission
from ros_bridge.mavlink.mission import BEYOND, JUMP, JUMP_TAG, TAKEOFF, WAYPOINT, Item, Onward

Place = tuple[float, float]
"""Latitude and longitude, degrees."""

NEAR = 40_000.0
"""How far from the ownship a route's points count, m: frames move after 50 km."""

_TO_ALTITUDE, _RETURN, _TAKEOFF_UPRIGHT = 31, 20, 84
_TAKE_OFF = frozenset({TAKEOFF, _TAKEOFF_UPRIGHT})
_FOREVER = -1.0
_DEFAULT_RADIUS = 60.0  # m, LOITER_RADIUS_DEFAULT
_LEAST_RADIUS = 0.1  # of what is watched, in the spacing
_CORNER = 0.1  # between the corners of a circle that is watched, in the spacing
_MOST_WAYS = 8
_AHEAD = 60.0  # s of straight flight, which give the direction where no place does


class Course(NamedTuple):
    """A mission from the current item on."""

    route: Route  # that plans may rejoin
    ways: tuple[Route, ...]  # that may be flown, and are watched
    unplanned: str = ""  # why nothing may be planned round a conflict; "": it may


class _Way(NamedTuple):
    """What may be flown after the plain waypoints, degrees; then straight on."""

    places: tuple[Place, ...]  # that are flown to
    circle: tuple[Place, ...] = ()  # instead of the last place


def course(
    items: Sequence[Item],
    current: int,
    remaining: Sequence[Item],
    began: Place,
    own: Report,
    *,
    spacing: float,
    radius: float,
    offset: float = 0.0,
) -> Course:
    """Return the course from the current item on, or raise :class:`FieldError` where none is flown.

    Args:
        items: of the mission.
        current: number of the item that is flown.
        remaining: the plain waypoints that are flown first.
        began: where the first leg begins, degrees.
        own: the ownship.
        spacing: of the points that may be rejoined at, m.
        radius: WP_LOITER_RAD, m.
        offset: ALT_OFFSET, m.
    """
    altitudes = {item.number: mission.altitude_of(item, items, offset) for item in remaining}
    walk = _Walk({item.number: item for item in items if item.number}, items, radius, spacing)
    item = walk.items.get(current)
    if not remaining and (item is None or item.command in _TAKE_OFF):
        raise FieldError("mission", f"is at item {current}, where no waypoint is flown to")
    number = remaining[-1].number + 1 if remaining else current
    begins_at = remaining[-1].place if remaining else own.place
    ways = list(islice(walk.ways(number, begins_at, (), frozenset()), _MOST_WAYS))
    if not remaining:
        straight_on = fly_straight(*own.place, own.east, own.north, _AHEAD)
        ways = [way if way.places else _Way((straight_on,)) for way in ways]

    def through(places: Sequence[Place]) -> Route:
        onward = Onward(number, tuple(places))
        return near(mission.route(began, remaining, spacing, onward, altitudes), own.place)

    watched = tuple(
        through((*way.places[:-1], *way.circle) if way.circle else way.places) for way in ways
    )
    leaves = bool(remaining) or (item is not None and (item.circles or item.command == WAYPOINT))
    return Course(
        through(ways[0].places), watched, "" if leaves else f"item {current} cannot be left"
    )


def near(route: Route, own: Place) -> Route:
    """Return the points of a route that are near the ownship, in a row; all where none is."""
    places = LocalFrame(*own).place(
        [station.latitude for station in route], [station.longitude for station in route]
    )
    counts = np.hypot(places.x, places.y) <= NEAR
    if not counts.any():
        return route
    first = int(np.argmax(counts))
    far = np.flatnonzero(~counts[first:])
    return route[first : first + int(far[0])] if far.size else route[first:]


class _Walk(NamedTuple):
    """Along a mission, from item to item."""

    items: Mapping[int, Item]  # by their numbers, without home
    all_items: Sequence[Item]
    radius: float  # WP_LOITER_RAD, m
    spacing: float  # of points, m

    def ways(
        self, number: int, last: Place, places: tuple[Place, ...], taken_jumps: frozenset[int]
    ) -> Iterator[_Way]:
        """Yield the ways from an item on, after the place ``last`` and those that are flown to
        already; a jump that is taken is not taken again, and what lies farther than plans reach is
        left out.
        """
        distance_flown = 0.0
        while (
            item := self.items.get(number)
        ) is not None and distance_flown < BEYOND * self.spacing:
            if item.command == WAYPOINT and item.has_place:
                distance_flown += distance(*last, *item.place)
                last, places = item.place, (*places, item.place)
            elif item.jumps and item.second != 0.0:
                target = self._target(item)
                if target is None:  # the mission ends
                    yield from self._end(None, last, places)
                    return
                if number not in taken_jumps:
                    yield from self.ways(target, last, places, taken_jumps | {number})
                elif item.second == _FOREVER:
                    yield _Way(places)
                if item.second == _FOREVER:
                    return
            elif item.flies and item.command != WAYPOINT:
                break
            number += 1
        if distance_flown < BEYOND * self.spacing:
            yield from self._end(item, last, places)
        else:
            yield _Way(places)

    def _target(self, jump: Item) -> int | None:
        """Return the number of the item at which a jump goes on; None: there is none."""
        if jump.command == JUMP:
            return int(jump.parameter) if jump.parameter in self.items else None
        tags = (
            item.number
            for item in self.items.values()
            if item.command == JUMP_TAG and item.parameter == jump.parameter
        )
        return min(tags, default=None)

    def _end(self, item: Item | None, last: Place, places: tuple[Place, ...]) -> Iterator[_Way]:
        """Yield the ways with an item that is no waypoint, or with the mission's end."""
        if item is not None and item.circles:
            centre = item.place if item.has_place else last
            yield _Way((*places, centre), self._circle(item, centre, last))
            return
        if item is not None and item.has_place and item.command not in _TAKE_OFF:
            yield _Way((*places, item.place))
            return
        yield _Way(places)
        homes = (mission_item.place for mission_item in self.all_items if mission_item.number == 0)
        home = next(homes, (0.0, 0.0))
        if (item is None or item.command == _RETURN) and home != (0.0, 0.0):
            yield _Way((*places, home))

    def _circle(self, item: Item, centre: Place, came_from: Place) -> tuple[Place, ...]:
        """Return corners of a circle, from where it is reached on, as often as plans reach."""
        own_radius = item.second if item.command == _TO_ALTITUDE else item.third
        radii = (radius_set for radius_set in (own_radius, self.radius) if abs(radius_set) > 1.0)
        radius = next(radii, _DEFAULT_RADIUS)
        size = max(abs(radius), _LEAST_RADIUS * self.spacing)
        frame = LocalFrame(*centre)
        entry = frame.place(*came_from)
        step = math.copysign(_CORNER * self.spacing / size, -radius)
        count = math.ceil(BEYOND / _CORNER) + 1
        angle = math.atan2(float(entry.y), float(entry.x)) + step * np.arange(count)
        corners = frame.geodetic(size * np.cos(angle), size * np.sin(angle))
        return tuple(zip(corners.latitude.tolist(), corners.longitude.tolist(), strict=True))
