"""Wind and areas of the attack's requests, and what a SAFE plan must keep of them.

Everything is sampled over the ground, :data:`~benchmarks.safety.resimulation.CLOSE` s apart: the
distance from an area by shapely, the limits in other winds by the definition of velocity and
acceleration there. Nothing of :mod:`envs.area_geometry` or :mod:`envs.wind` is used.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import shapely

from agents.planner.request.options import Options
from agents.planner.request.request import Altitude, Request
from benchmarks.safety.heights import Band, own_band
from benchmarks.safety.resimulation import Flown
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.arrays import Array
from envs.kinematics import Limits
from envs.waypoints import Waypoint
from envs.wind import Wind

__all__ = ["Sky", "draw_sky", "faults", "move"]

_TOLERANCE = 1e-3  # of the judgement: m
_PART = 1e-3 + 3e-6  # m of a clearance that may be missing
_NEARER = 0.01  # m that a plan may come nearer which begins inside a clearance
_EDGE = 3e-6  # m by which it may be beyond the edge itself
_EXACT = 1e-5  # of speeds, accelerations and turn rates in other winds
_DIRECTIONS = np.exp(2j * math.pi * np.arange(16) / 16)
_PIECE = 25  # samples that are looked at together first
_WIDEST = 25_000.0  # m of a radius
_FARTHEST = 5e5  # m from the frame's origin


class Sky(NamedTuple):
    """What stands around a request."""

    wind: Wind | None
    areas: tuple[Area, ...]

    @property
    def air_velocity(self) -> complex:
        """Velocity of the air towards east + i north, m/s."""
        return complex(0.0) if self.wind is None else complex(self.wind.east, self.wind.north)


def draw_sky(
    seed: int, number: int, request: Request, unit: float, altitude: Altitude | None
) -> Sky:
    """Return wind for two of three requests ``[]``, and one to three areas for as many.

    Areas stand between the ownship and one of the next points of the route, or somewhat beside.

    Args:
        seed: of the attack.
        number: of the request.
        request: in the air mass.
        unit: the separation, m.
        altitude: of the ownship.
    """
    rng = np.random.default_rng([seed, number, 54])
    speed = float(request.own.speed)
    wind = None
    if rng.random() < 2.0 / 3.0:
        velocity = speed * float(rng.uniform(0.0, 0.7)) * np.exp(2j * math.pi * rng.uniform())
        std = 0.02 * speed * float(rng.uniform()) if rng.random() < 0.5 else 0.0
        wind = Wind(float(velocity.real), float(velocity.imag), std)
    place = max(abs(float(request.own.x)), abs(float(request.own.y)))
    local = place + 12.0 * unit < _FARTHEST  # areas stand in the local frame
    count = int(rng.integers(1, 4)) if rng.random() < 2.0 / 3.0 and local else 0
    areas = tuple(_area(rng, request, unit, altitude) for _ in range(count))
    return Sky(wind, areas)


def _area(
    rng: np.random.Generator, request: Request, unit: float, altitude: Altitude | None
) -> Area:
    own = complex(request.own.x, request.own.y)
    speed = float(request.own.speed)
    point = int(rng.integers(min(int(request.points), 4)))
    to_point = complex(request.route_x[point], request.route_y[point]) - own
    keep_in = rng.random() < 0.15
    size = unit * float(0.2 * 20.0 ** rng.uniform())
    place = own + to_point * float(rng.uniform(0.0, 1.2))
    place += float(rng.normal()) * size * np.exp(2j * math.pi * rng.uniform())
    if keep_in:
        size = min(unit * float(rng.uniform(10.0, 40.0)), _WIDEST)
        place = own + 0.5 * size * float(rng.uniform()) * to_point / max(abs(to_point), 1.0)
    size = min(size, _WIDEST)
    pace, grows = 0.0, 0.0
    if rng.random() < 0.4:
        pace, grows = 0.3 * speed * float(rng.uniform()), 0.01 * speed * float(rng.normal())
    course = 2.0 * math.pi * float(rng.uniform())
    begin, end = -math.inf, math.inf
    if rng.random() < 0.3:
        begin = float(rng.uniform(-50.0, 200.0))
        end = begin + float(rng.uniform(10.0, 200.0))
    floor, ceiling = None, None
    if altitude is not None and rng.random() < 0.3:
        middle = altitude.value + float(rng.normal(0.0, 500.0))
        floor = Level(middle - 200.0, "msl" if rng.random() < 0.9 else "wgs84")
        ceiling = Level(middle + 200.0, "msl")
    round_one = rng.random() < 0.3
    shape = Circle(place.real, place.imag, size) if round_one else _polygon(rng, place, size)
    return Area(
        shape,
        keep=Keep.IN if keep_in else Keep.OUT,
        velocity=(pace * math.cos(course), pace * math.sin(course)),
        growth=grows,
        floor=floor,
        ceiling=ceiling,
        valid_from=begin,
        valid_until=end,
        clearance=float(rng.choice([0.0, 0.05, 0.3])) * unit,
    )


def _polygon(rng: np.random.Generator, place: complex, size: float) -> Polygon:
    """Return a star of 3 to 12 corners, a third of them with a smaller one as a hole."""
    corners = int(rng.integers(3, 13))
    around = np.exp(2j * math.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners)
    star = size * rng.uniform(0.3, 1.0, corners) * around
    holes = (_ring(place + float(rng.uniform(0.2, 0.7)) * star),) if rng.random() < 0.3 else ()
    return Polygon(_ring(place + star), holes)


def _ring(points: Array) -> tuple[tuple[float, float], ...]:
    return tuple((float(point.real), float(point.imag)) for point in points)


def move(sky: Sky, rng: np.random.Generator) -> Sky:
    """Return what stands around a request with one thing moved: an area's clearance, velocity or
    growth, or how well the wind is known.
    """
    size = float(10.0 ** rng.uniform(0.0, 4.0))  # m
    if not sky.areas or (sky.wind is not None and rng.random() < 0.3):
        wind = sky.wind
        return sky if wind is None else sky._replace(wind=wind._replace(std=wind.std + 1e-3 * size))
    areas = list(sky.areas)
    number = int(rng.integers(len(areas)))
    area = areas[number]
    kind = int(rng.integers(3))
    if kind == 0:
        areas[number] = replace(area, clearance=area.clearance + size)
    elif kind == 1:
        east, north = area.velocity
        areas[number] = replace(area, velocity=(east + 2e-3 * size, north - 2e-3 * size))
    else:
        more = 2e-3 * size
        areas[number] = replace(
            area, growth=area.growth + (-more if area.keep is Keep.IN else more)
        )
    return sky._replace(areas=tuple(areas))


def faults(
    sky: Sky,
    flown: Flown,
    options: Options,
    altitude: Altitude | None,
    waypoints: Sequence[Waypoint] = (),
) -> list[str]:
    """Return what a plan breaks: ``area``, ``speed``, ``acceleration`` or ``turn rate in another
    wind``.

    Args:
        sky: what stands around the request.
        flown: the plan in the air mass, sampled, fields ``[S]``.
        options: how it was made, with the limits of the vehicle.
        altitude: of the ownship at the request.
        waypoints: of the plan; not needed of one in the plane.
    """
    over_ground = flown.place + sky.air_velocity * flown.time
    own = own_band(altitude, waypoints, flown.time, options)
    reference = "" if altitude is None else altitude.reference
    keeps = [
        _keeps(area, flown.time, over_ground, options, _counts(area, flown.time, own, reference))
        for area in sky.areas
    ]
    wrong = [] if all(keeps) else ["area"]
    if sky.wind is not None and sky.wind.std > 0.0:
        seldom = Flown(*(field[::_PIECE] for field in flown))
        wrong += _in_other_winds(seldom, options.requirement.sigmas * sky.wind.std, options.limits)
    return wrong


def _in_other_winds(flown: Flown, error: float, limits: Limits) -> list[str]:
    """Return which limits a plan leaves in winds that are off by an error, m/s.

    What begins beyond the speeds that the error leaves may stay there, and is not judged by its
    turns then.
    """
    unit = np.exp(1j * flown.heading)
    velocity = flown.speed * unit - error * _DIRECTIONS[:, None]
    speed = np.abs(velocity)
    # Acceleration along the velocity, and across it as the imaginary part.
    change = (flown.acceleration + 1j * flown.speed * flown.turn_rate) * unit
    change = change * np.conj(velocity) / speed
    lowest = min(limits.speed_min, float(flown.speed[0]) - error)
    highest = max(limits.speed_max, float(flown.speed[0]) + error)
    turning = np.where(flown.speed >= limits.speed_min + error, np.abs(change.imag) / speed, 0.0)
    checks = {
        "speed": (speed < lowest - _EXACT) | (speed > highest + _EXACT),
        "acceleration": (change.real > limits.acceleration_max + _EXACT)
        | (change.real < limits.acceleration_min - _EXACT),
        "turn rate": turning > limits.yaw_rate_max + _EXACT,
    }
    return [f"{name} in another wind" for name, bad in checks.items() if bad.any()]


def _keeps(area: Area, time: Array, place: Array, options: Options, counts: Array) -> bool:
    """Return whether places over the ground keep what they must of an area while it counts."""
    if not counts.any():
        return True
    inner = place - complex(*area.velocity) * time  # in the area's frame
    gain = area.growth if area.keep is Keep.IN else -area.growth
    required = area.clearance + options.requirement.margin
    if counts[0]:
        begun = float(_distances(area, inner[:1])[0])
        required = min(required, max(begun - _NEARER, 0.0))
    least = max(required - _PART, -_EDGE) - _TOLERANCE
    fast = np.abs(np.diff(inner)) + abs(gain) * np.diff(time)
    starts = np.arange(0, len(time) - 1, _PIECE)
    # Nothing gets nearer than it flies from one look to the next.
    near = _distances(area, inner[starts]) + gain * time[starts] - np.add.reduceat(fast, starts)
    for first in starts[~(near > least)].tolist():
        piece = slice(first, min(first + _PIECE, len(time) - 1) + 1)  # its ends included
        if not counts[piece].any():
            continue
        if _nearest(area, inner[piece], gain * time[piece], counts[piece]) < least:
            return False
    return True


def _nearest(area: Area, places: Array, grown: Array, counts: Array) -> float:
    """Return the smallest signed distance of a flight from an area while it counts, m.

    Args:
        area: in whose frame the places are.
        places: of the flight, complex m, ``[m]``.
        grown: what growth adds to the distance there, m, ``[m]``.
        counts: when the area counts, bool ``[m]``.
    """
    at = (_distances(area, places) + grown)[counts]
    counting = counts[:-1] & counts[1:]
    ends = np.stack([places[:-1], places[1:]], axis=-1)[counting]
    between = _chords(area, ends) + grown[:-1][counting] if counting.any() else np.array([])
    return min(float(at.min(initial=np.inf)), float(between.min(initial=np.inf)))


def _counts(area: Area, time: Array, own: Band | None, reference: str) -> Array:
    """Return when an area is valid and the ownship, whose altitudes have a reference, may be level
    with it, bool.
    """
    counts = (time >= area.valid_from) & (time <= area.valid_until)
    if own is None or area.keep is Keep.IN:
        return counts
    if area.floor is not None and area.floor.reference == reference:
        counts &= own.high >= area.floor.value
    if area.ceiling is not None and area.ceiling.reference == reference:
        counts &= own.low <= area.ceiling.value
    return counts


def _distances(area: Area, places: Array) -> Array:
    """Return the signed distances of places ``[m]`` in the area's frame, without growth, m."""
    sign = -1.0 if area.keep is Keep.IN else 1.0
    if isinstance(area.shape, Circle):
        return sign * (np.abs(places - complex(area.shape.x, area.shape.y)) - area.shape.radius)
    shape = shapely.Polygon(area.shape.outer, area.shape.holes)
    away = shapely.distance(shape.boundary, shapely.points(places.real, places.imag))
    within = shapely.contains_xy(shape, places.real, places.imag)
    return sign * np.where(within, -away, away)


def _chords(area: Area, ends: Array) -> Array:
    """Return lower bounds of the signed distance between two places each, ``[m, 2]``, m: 0 on an
    edge.
    """
    at = np.minimum(_distances(area, ends[:, 0]), _distances(area, ends[:, 1]))
    if isinstance(area.shape, Circle):
        if area.keep is Keep.IN:
            return at
        away, chord = ends[:, 0] - complex(area.shape.x, area.shape.y), ends[:, 1] - ends[:, 0]
        length = np.maximum(np.abs(chord) ** 2, 1e-12)
        share = np.clip(-(away * np.conj(chord)).real / length, 0.0, 1.0)
        return np.abs(away + share * chord) - area.shape.radius
    shape = shapely.Polygon(area.shape.outer, area.shape.holes)
    chords = shapely.linestrings(np.stack([ends.real, ends.imag], axis=-1))
    return np.where(at > 0.0, shapely.distance(shape.boundary, chords), at)
