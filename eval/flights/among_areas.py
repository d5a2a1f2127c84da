"""Encounters among random areas: which lie along each way, how the air mass sees them, and whether
a flight entered one.

The areas of an encounter follow from its number (:mod:`envs.random_areas`), as it does itself.
"""

from typing import NamedTuple

import numpy as np

from envs.aircraft import Aircraft
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle, after, in_air
from envs.encounters import Encounter
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.random_areas import random_areas
from envs.wind import NO_WIND, Wind
from eval.flights.simulate import ENDS, OUTCOMES, Flights
from eval.flights.trajectories import Trajectories

_CORNERS = 72  # of a circle that is drawn
_PARTS = 10  # of a time step, at whose ends a flight is looked at


class AmongAreas(NamedTuple):
    """How near flights came to areas; fields ``[N]``."""

    distance: np.ndarray  # smallest distance from an area less its clearance, m; inf without areas
    breach: np.ndarray  # when less than the clearance was left first, s; nan where it was kept


def areas_of(
    most: int, seed: int, starts: Encounter, numbers: np.ndarray, aircraft: Aircraft
) -> np.ndarray | None:
    """Return the areas of encounters ``[N]`` by their numbers, over the ground, object ``[N]``;
    None where there are none at most.

    Args:
        most: areas of an encounter at most.
        seed: of the draws.
        starts: of the encounters, their goals over the ground.
        numbers: of the encounters.
        aircraft: whose separation and speed are the units.
    """
    if most == 0:
        return None
    found = np.empty(len(numbers), dtype=object)
    for n, number in enumerate(numbers):
        own: VehicleState[Air] = VehicleState(*(float(field[n]) for field in starts.own))
        goal = float(starts.goal_x[n]), float(starts.goal_y[n])
        found[n] = random_areas(seed, int(number), most, own, goal, aircraft)
    return found


def together(
    own: np.ndarray | None, drawn: np.ndarray | None, given: tuple[Area, ...], count: int
) -> np.ndarray | None:
    """Return all areas of encounters, object ``[count]``: their own, drawn ones, both None where
    there are none, and those that every encounter has. None: there are none.
    """
    some = [each for each in (own, drawn) if each is not None]
    if not some and not given:
        return None
    found = np.empty(count, dtype=object)
    for n in range(count):
        found[n] = sum((each[n] for each in some), given)
    return found


def in_air_at(areas: np.ndarray, wind: Wind | None, time: float) -> np.ndarray:
    """Return areas of flights, object ``[N]``, as their air masses see them some seconds after the
    start, as they are then.
    """
    found = np.empty(len(areas), dtype=object)
    for n, some in enumerate(areas):
        blows = NO_WIND if wind is None else Wind(float(wind.east[n]), float(wind.north[n]))
        found[n] = in_air_mass(some, blows, time)
    return found


def in_air_mass(areas: tuple[Area, ...], wind: Wind, time: float) -> tuple[Area, ...]:
    """Return the areas of one flight, over the ground at the start, as its air mass sees them some
    seconds later.
    """
    return tuple(in_air(after(one, time), wind, time) for one in areas)


def as_row(areas: object) -> np.ndarray:
    """Return what belongs to one flight as an array of it alone, object ``[1]``."""
    found = np.empty(1, dtype=object)
    found[0] = areas
    return found


def judge(flown: Trajectories[Ground], areas: np.ndarray, dt: float) -> AmongAreas:
    """Return how near flights ``[N]`` came to their areas, object ``[N]``, both over the ground; dt
    in s.
    """
    count = len(areas)
    found = AmongAreas(np.full(count, np.inf), np.full(count, np.nan))
    for n, some in enumerate(areas):
        places = _places(VehicleState(*(field[:, n] for field in flown.own)), dt)
        found.distance[n], found.breach[n] = nearest(some, *places)
    return found


def nearest(
    areas: tuple[Area, ...], x: np.ndarray, y: np.ndarray, time: np.ndarray
) -> tuple[float, float]:
    """Return the smallest distance from areas less their clearance, m, inf without any, and when it
    is first below 0, s, nan: never; at places, m, and times since the start, s, ``[T]``.
    """
    if not (areas and np.size(time)):
        return np.inf, np.nan
    away = [signed_distance(one, x, y, time) - one.clearance for one in areas]
    least = np.min(away, axis=0)
    breach = float(time[np.argmax(least < 0.0)]) if least.min() < 0.0 else np.nan
    return float(least.min()), breach


def with_breaches(flights: Flights, among: AmongAreas, rules: Rules) -> Flights:
    """Return flights of which those that entered the clearance of an area, before they lost the
    separation, have that as their outcome; it scores like a violation.
    """
    lost = flights.outcome == OUTCOMES.index("violation")
    enters = np.isfinite(among.breach) & ~(lost & (flights.duration <= among.breach))
    return flights._replace(
        outcome=np.where(enters, ENDS.index("breach"), flights.outcome).astype(np.int8),
        score=np.where(enters, rules.reward_violation, flights.score),
        duration=np.where(enters, among.breach, flights.duration),
    )


def outlines(area: Area, time: float) -> list[np.ndarray]:
    """Return the rings around an area some seconds after the start, m, ``[E, 2]`` each, a circle's
    as a polygon.
    """
    moved = np.multiply(area.velocity, time)
    if isinstance(area.shape, Circle):
        angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
        radius = max(area.shape.radius + area.growth * time, 0.0)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return [np.add((area.shape.x, area.shape.y), moved) + radius * ring]
    return [np.array(ring) + moved for ring in area.shape.rings]


def _places(own: VehicleState[Ground], dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places of a flight ``[T + 1]``, m, and their times, s: those recorded, and between two
    of them on the cubic curve that has both velocities.
    """
    own = VehicleState(*(field[np.isfinite(field)] for field in own))
    if own.x.size < 2:
        return own.x, own.y, np.zeros(own.x.size)
    x = _curve(own.x, dt * (own.speed * np.cos(own.heading)))
    y = _curve(own.y, dt * (own.speed * np.sin(own.heading)))
    return x, y, np.arange(x.size) * (dt / _PARTS)


def _curve(place: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return a coordinate at the ends of all parts of time steps, m, by Hermite's cubic through
    places, m, at which a step's way at the velocity is so long, m, ``[T + 1]`` both.
    """
    s = np.arange(_PARTS)[None] / _PARTS
    weights = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2,
        s * (1.0 - s) ** 2,
        s * s * (3.0 - 2.0 * s),
        s * s * (s - 1.0),
    )
    ends = (place[:-1], way[:-1], place[1:], way[1:])
    curve = sum(weight * end[:, None] for weight, end in zip(weights, ends, strict=True))
    return np.append(np.ravel(curve), place[-1])
