"""Encounters among random areas: which lie along each way, how the air mass sees them, and whether
a flight entered one: the whole of it, not samples (:mod:`agents.kernel.clearance`).

The areas of an encounter follow from its number (:mod:`envs.random_areas`), as it does itself.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.kernel.areas import ActiveArea, AreaClearance
from agents.kernel.clearance import CLOSE, clearance
from agents.kernel.trajectory import Trajectory, trajectory
from envs.aircraft import Aircraft
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle, after, in_air
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.random_areas import random_areas
from envs.waypoints import ARCS, PlanStates
from envs.wind import NO_WIND, Wind
from eval.flights.areas_seen import at_all_heights
from eval.flights.simulate import ENDS, OUTCOMES, Flights
from eval.flights.trajectories import Trajectories

_CORNERS = 72  # of a circle that is drawn


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
    areas = np.empty(len(numbers), dtype=object)
    for n, number in enumerate(numbers):
        own: VehicleState[Air] = VehicleState(*(float(field[n]) for field in starts.own))
        goal = float(starts.goal_x[n]), float(starts.goal_y[n])
        areas[n] = random_areas(seed, int(number), most, own, goal, aircraft)
    return areas


def together(
    own: np.ndarray | None, drawn: np.ndarray | None, fixed: tuple[Area, ...], count: int
) -> np.ndarray | None:
    """Return all areas of encounters, object ``[count]``: their own, drawn ones, both None where
    there are none, and those that every encounter has. None: there are none.
    """
    arrays = [array for array in (own, drawn) if array is not None]
    if not arrays and not fixed:
        return None
    result = np.empty(count, dtype=object)
    for n in range(count):
        result[n] = sum((array[n] for array in arrays), fixed)
    return result


def in_air_at(areas: np.ndarray, wind: Wind | None, time: float) -> np.ndarray:
    """Return areas of flights, object ``[N]``, as their air masses see them some seconds after the
    start, as they are then.
    """
    result = np.empty(len(areas), dtype=object)
    for n, areas_of_flight in enumerate(areas):
        blows = NO_WIND if wind is None else Wind(float(wind.east[n]), float(wind.north[n]))
        result[n] = in_air_mass(areas_of_flight, blows, time)
    return result


def in_air_mass(areas: tuple[Area, ...], wind: Wind, time: float) -> tuple[Area, ...]:
    """Return the areas of one flight, over the ground at the start, as its air mass sees them some
    seconds later.
    """
    return tuple(in_air(after(area, time), wind, time) for area in areas)


def as_row(areas: object) -> np.ndarray:
    """Return what belongs to one flight as an array of it alone, object ``[1]``."""
    row = np.empty(1, dtype=object)
    row[0] = areas
    return row


def judge(flown: Trajectories[Air], areas: np.ndarray, wind: Wind | None, dt: float) -> AmongAreas:
    """Return how near flights ``[N]`` in the air mass came to their areas, object ``[N]``, which
    are over the ground at the start; steps of dt, s.
    """
    count = len(areas)
    among = AmongAreas(np.full(count, np.inf), np.full(count, np.nan))
    for n, drifting in enumerate(in_air_at(areas, wind, 0.0)):
        own = VehicleState(*(field[np.isfinite(field[:, n]), n] for field in flown.own))
        if drifting and own.x.size > 1:
            steps = PlanStates(*(field[None] for field in (*own, dt * np.arange(own.x.size))))
            among.distance[n], among.breach[n] = nearest(drifting, trajectory(steps))
    return among


def nearest(areas: Sequence[Area], flown: Trajectory[Any]) -> tuple[float, float]:
    """Return the smallest distance of a flight ``[1, L]`` from areas less their clearance, m, inf
    where none counts, and when it is first below 0, s, nan: never.

    The distance is good to some mm, and where an area begins or ceases to count, to what is flown
    in a part of an arc. Where the clearance is lost, it is that at the ends of arcs.
    """
    active = at_all_heights(areas)
    constraint = AreaClearance(active, np.array([[area.clearance for area in areas]]))
    distance = _least_at_arcs(active, flown)
    if 0.0 <= distance < np.inf:
        # The smallest is not greater: only pieces that come as near must be looked at closely.
        nearer = constraint._replace(required=constraint.required + distance)
        distance += float(clearance(flown, nearer).margin.min())
        if distance > CLOSE:
            return distance, math.nan
    clearances = clearance(flown, constraint)
    loss = float(clearances.loss.min(initial=np.inf))
    if distance == np.inf:  # no area counts at the end of an arc
        distance = float(clearances.margin.min(initial=np.inf))
    return distance, loss if math.isfinite(loss) else math.nan


def _least_at_arcs(active: Sequence[ActiveArea], flown: Trajectory[Any]) -> float:
    """Return the smallest distance of a flight ``[1, L]`` from areas less their clearance, m, at
    the ends of arcs; inf where none counts there.
    """
    arcs, ends = flown.legs, flown.states
    begins = arcs.time[..., None] + arcs.duration[..., None] * (np.arange(ARCS) / ARCS)
    x, y, time = (
        np.append(field, end[:, -1])
        for field, end in ((arcs.x, ends.x), (arcs.y, ends.y), (begins, ends.time))
    )
    least = np.inf
    for _, area, begin, end in active:
        away = signed_distance(area, x, y, time) - area.clearance
        counts = (time >= begin) & (time <= end)
        least = min(least, float(away.min(where=counts, initial=np.inf)))
    return least


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
