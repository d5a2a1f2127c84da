"""Ways round areas, from point to point of a route: the shortest over rings about the areas.

Nothing here decides whether a plan keeps clear; :mod:`agents.kernel.areas` does. Everything moves
on straight lines in the air mass: the points of the route with their drift, the rings with their
areas. A way is a row of straight flights at the present airspeed, each to where its end will be.
"""

import heapq
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea, required_distances
from envs.area_geometry import Parts, box_distance, chord_distances, gain, own_frame
from envs.areas import Circle, Keep, Polygon
from envs.arrays import Array, Bool, Float, Shaped
from envs.backend import FLOATS
from envs.compiled import Arguments, Entry, scalar
from envs.flat_areas import FlatArea, box_distance_of_chord, chord_bound, flat
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import take
from envs.wind import aim_point

RING = 12
"""Points about an area."""

_MOST_TRIED = 40  # places that are looked at from, a way
_BEGIN = -1  # number of the place where a way begins


class Place(NamedTuple):
    """Where a way has got to, in the air mass."""

    x: float  # m
    y: float
    time: float  # s after the request


class Rings(NamedTuple):
    """Points about areas, in the air mass at the request; fields ``[P]``."""

    x: Array  # m
    y: Array
    east: Array  # velocity, m/s
    north: Array


class Airspace(NamedTuple):
    """What a way must keep clear of."""

    areas: tuple[ActiveArea, ...]
    need: tuple[float, ...]  # signed distance to be kept from each, m
    rings: Rings
    speed: float  # of the flight, m/s
    latest: float  # s; ways that last longer are not looked for
    flat: tuple[Array, Array]  # the areas as compiled code takes them, and their edges

    def way(self, begin: Place, x: float, y: float, drift: tuple[float, float]) -> list[Place]:
        """Return the places over which to fly to a point given at the request, itself the last; an
        empty list where no way is found.
        """
        straight = self.straight(begin, x, y, drift)
        reached = (np.array([value]) for value in straight)
        if straight.time < self.latest and self.clear(begin, *reached).all():
            return [straight]
        rings = self.rings
        to = np.append(rings.x, x), np.append(rings.y, y)
        velocity = np.append(rings.east, drift[0]), np.append(rings.north, drift[1])
        # A* over the points of the rings and, as the last of them, the goal: by when each is
        # reached, and how long the straight flight from there would take.
        goal = to[0].size - 1
        places, came, finished = {_BEGIN: begin}, dict[int, int](), set[int]()
        queue = [(begin.time, _BEGIN)]
        while queue and len(finished) < _MOST_TRIED:
            _, at = heapq.heappop(queue)
            if at in finished:
                continue
            finished.add(at)
            if at == goal:
                return _back(at, came, places)
            place = places[at]
            there_x, there_y, arrival = self._reach(place, to, velocity)
            earlier = [
                n not in finished and arrival[n] < (places[n].time if n in places else self.latest)
                for n in range(goal + 1)
            ]
            free = np.flatnonzero(np.array(earlier))
            free = free[self.clear(place, there_x[free], there_y[free], arrival[free])]
            for n in free.tolist():
                reached = Place(float(there_x[n]), float(there_y[n]), float(arrival[n]))
                places[n], came[n] = reached, at
                off_x = x + drift[0] * reached.time - reached.x
                off_y = y + drift[1] * reached.time - reached.y
                remaining = math.hypot(off_x, off_y) / self.speed
                heapq.heappush(queue, (reached.time + remaining, n))
        return []

    def straight(self, place: Place, x: float, y: float, drift: tuple[float, float]) -> Place:
        """Return where a point given at the request is met on the straight way, whatever is in
        it.
        """
        own: VehicleState[Air] = VehicleState(place.x, place.y, 0.0, self.speed)
        current = x + drift[0] * place.time, y + drift[1] * place.time
        there_x, there_y = aim_point(own, current, drift, self.latest - place.time, FLOATS)
        lasts = math.hypot(there_x - place.x, there_y - place.y) / self.speed
        return Place(there_x, there_y, place.time + lasts)

    def _reach(
        self, place: Place, to: tuple[Array, Array], velocity: tuple[Array, Array]
    ) -> tuple[Array, Array, Array]:
        """Return where moving points are met from a place, m, and when, s, ``[M]`` each."""
        ones = np.ones_like(to[0])
        own: VehicleState[Air] = VehicleState(
            place.x * ones, place.y * ones, 0.0 * ones, self.speed * ones
        )
        current = to[0] + velocity[0] * place.time, to[1] + velocity[1] * place.time
        x, y = aim_point(own, current, velocity, self.latest - place.time, np)
        return x, y, place.time + np.hypot(x - place.x, y - place.y) / self.speed

    def clear(
        self,
        place: Place,
        x: Float[Array, " M"],
        y: Float[Array, " M"],
        arrival: Float[Array, " M"],
    ) -> Bool[Array, " M"]:
        """Return whether straight flights from a place keep clear of all areas."""
        keeps_clear = np.ones(x.shape, dtype=bool)
        if KEEP_CLEAR.ready:
            KEEP_CLEAR(place, x, y, arrival, *self.flat, keeps_clear)
            return keeps_clear
        for active, need in zip(self.areas, self.need, strict=True):
            rows = np.flatnonzero(
                keeps_clear & (arrival >= active.begin) & (place.time <= active.end)
            )
            if rows.size == 0:
                continue
            start = own_frame(active.area, place.x, place.y, place.time)
            end_x, end_y = own_frame(active.area, x[rows], y[rows], arrival[rows])
            begin_x, begin_y = (np.full(rows.size, value) for value in start)
            parts = Parts(begin_x, begin_y, end_x, end_y)
            grown = np.minimum(gain(active.area) * place.time, gain(active.area) * arrival[rows])
            clear = np.zeros(rows.size, dtype=bool)
            if active.area.keep is Keep.OUT:
                # The rectangle around an area is far away more cheaply.
                away = box_distance(active.area, parts)
                clear = (away > 0.0) & (away + grown >= need)
            near = np.flatnonzero(~clear)
            if near.size:
                near_parts, gained = take((parts, grown), near)
                bound = chord_distances(active.area, near_parts, need - gained).bound
                clear[near] = bound + gained >= need
            keeps_clear[rows] = clear
        return keeps_clear


def airspace(
    areas: Sequence[ActiveArea], own: VehicleState[Air], margin: float, pad: float, latest: float
) -> Airspace:
    """Return what ways of an ownship keep clear of.

    Args:
        areas: that may be met, in the air mass.
        own: state at the request.
        margin: what is kept beyond the clearance from each, m.
        pad: by how much farther the rings are, m.
        latest: time of the last waypoint at most, s.
    """
    need = [float(required_distances(active, own.x, own.y, margin)) for active in areas]
    rings = [_points(active, own, active.area.clearance + margin + pad) for active in areas]
    x, y = (np.concatenate([part[axis] for part in rings]) for axis in (0, 1))
    east, north = (
        np.concatenate(
            [
                np.full(part[0].size, active.area.velocity[axis])
                for part, active in zip(rings, areas, strict=True)
            ]
        )
        for axis in (0, 1)
    )
    need = [least + 0.5 * pad if least > margin else least for least in need]
    begin, end = (
        np.array([getattr(active, name) for active in areas]) for name in ("begin", "end")
    )
    return Airspace(
        areas=tuple(areas),
        need=tuple(need),
        rings=Rings(x, y, east, north),
        speed=max(own.speed, 1.0),
        latest=latest,
        flat=flat([active.area for active in areas], begin, end, np.array(need)),
    )


@scalar
def keep_clear(
    place: Place,
    x: Float[Array, " M"],
    y: Float[Array, " M"],
    arrival: Float[Array, " M"],
    areas: Shaped[Array, " A"],
    lines: Shaped[Array, " E"],
    clear: Bool[Array, " M"],
) -> None:
    """Write whether straight flights from a place keep clear of all areas, ``[M]``: the loops of
    :meth:`Airspace.clear`; areas and edges as of :func:`envs.flat_areas.flat`.
    """
    for m in range(len(x)):
        for a in range(len(areas)):
            if not _keeps_clear(place, x[m], y[m], arrival[m], areas[a], lines):
                clear[m] = False
                break


@scalar
def _keeps_clear(
    place: Place, x: float, y: float, arrival: float, area: FlatArea, lines: Array
) -> bool:
    """Return whether a straight flight keeps clear of an area while that counts."""
    if arrival < area.begin or place.time > area.end:
        return True
    x0, y0 = place.x - area.vx * place.time, place.y - area.vy * place.time
    x1, y1 = x - area.vx * arrival, y - area.vy * arrival
    grown = min(area.gain * place.time, area.gain * arrival)
    if area.sign > 0.0:
        away = box_distance_of_chord(area, x0, y0, x1, y1)
        if away > 0.0 and away + grown >= area.required:
            return True
    need = area.required - grown
    return chord_bound(area, lines, x0, y0, x1, y1, need) + grown >= area.required


def _examples() -> list[Arguments]:
    zero, none = np.zeros(1), np.zeros(0)
    areas, lines = flat((), none, none, none)
    return [(Place(0.0, 0.0, 0.0), zero, zero, zero, areas, lines, np.zeros(1, bool))]


KEEP_CLEAR = Entry(keep_clear, _examples)
"""Compiled :func:`keep_clear`."""


def _back(at: int, came: dict[int, int], places: dict[int, Place]) -> list[Place]:
    """Return the places of a way, the first one after its beginning."""
    way = []
    while at >= 0:
        way.append(places[at])
        at = came[at]
    return way[::-1]


def _points(active: ActiveArea, own: VehicleState[Air], away: float) -> tuple[Array, Array]:
    """Return points about an area from which its edges can be gone round, m."""
    shape = active.area.shape
    if isinstance(shape, Circle):
        ring = np.array([[shape.x, shape.y]])
        away += shape.radius
    else:
        ring = np.array(shape.outer)
    # As large as it will be when it can be reached.
    centre = ring.mean(axis=0)
    soon = math.hypot(centre[0] - own.x, centre[1] - own.y) / max(own.speed, 1.0)
    away += max(abs(gain(active.area)) * min(max(soon, active.begin), active.end), 0.0)
    if active.area.keep is Keep.OUT:
        return _around(ring, away)
    if isinstance(shape, Circle):  # within a disc the straight way stays within
        return np.empty(0), np.empty(0)
    rings = [_corners(shape, away), *(_around(np.array(hole), away) for hole in shape.holes)]
    return np.concatenate([x for x, _ in rings]), np.concatenate([y for _, y in rings])


def _around(points: Array, away: float) -> tuple[Array, Array]:
    """Return the corners of a polygon of :data:`RING` equal angles about points ``[P, 2]`` that is
    so far away, m.
    """
    angle = np.arange(RING) * (2.0 * math.pi / RING)
    far = (points @ np.stack([np.cos(angle), np.sin(angle)])).max(axis=0) + away
    next_far, step = np.roll(far, -1), 2.0 * math.pi / RING
    # Where two neighbouring sides meet, in the frame of the first.
    across = (next_far - far * math.cos(step)) / math.sin(step)
    return (
        far * np.cos(angle) - across * np.sin(angle),
        far * np.sin(angle) + across * np.cos(angle),
    )


def _corners(shape: Polygon, away: float) -> tuple[Array, Array]:
    """Return points inside a polygon beside the corners of its outer ring that point inwards."""
    ring = np.array(shape.outer)
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    length = [np.maximum(np.hypot(*side.T), 1e-9)[:, None] for side in (before, after)]
    ahead = before / length[0] - after / length[1]  # from the corner into the inside
    off = ahead / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    inwards = np.flatnonzero(turn < 0.0)[:RING]
    corner = ring[inwards] + away * off[inwards]
    return corner[:, 0], corner[:, 1]
