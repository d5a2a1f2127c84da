"""Areas drawn at random along the way of a flight, by number as encounters are.

Discs and polygons to be kept out of, some of them moving, lie beside or across the straight way
from a start to a goal. None holds either or lies close to it: an area that would is made smaller.
"""

import math
from typing import NamedTuple

import numpy as np

from envs import draws
from envs.aircraft import Aircraft
from envs.areas import Area, Circle, Place, Polygon
from envs.encounters import between
from envs.frames import F
from envs.kinematics import VehicleState

MOST = 8
"""Areas of an encounter at most."""

_STREAM = 0x6172_6561  # keeps the draws apart from those of encounters with the same seed
_ALONG = 0.15, 0.85  # where the centres lie along the way, shares of it
_ACROSS = 2.0  # how far beside it at most, separations
_SIZE = 0.5, 2.0  # from the centre to the edge, separations
_CLEARANCE = 0.1  # separations
_OFF = 0.5  # least distance of the edges from start and goal, beside the clearance, separations
_SMALLEST = 0.2  # separations: what would have to be smaller is left out
_CORNERS = 5, 9  # of polygons
_MOVING = 1.0 / 3.0  # share of areas
_FASTEST = 0.1  # speed of these at most, in the greatest speed of the aircraft
_DRAWS = 8 + _CORNERS[1]  # numbers of an area


def random_areas(
    seed: int, number: int, count: int, own: VehicleState[F], goal: Place, aircraft: Aircraft
) -> tuple[Area, ...]:
    """Return up to ``count`` areas of an encounter, by its number.

    Args:
        seed: of the draws, 0 or more.
        number: of the encounter.
        count: how many are drawn; fewer are left where start or goal are in the way of one.
        own: state of the ownship at the start, its fields numbers.
        goal: of the flight, m.
        aircraft: whose separation and speed are the units.

    Raises:
        ValueError: ``count`` is below 0 or above :data:`MOST`.
    """
    if not 0 <= count <= MOST:
        raise ValueError(f"count is {count}, expected 0 to {MOST}")
    table = draws.uniforms(seed, number, 1, (MOST, _DRAWS), stream=_STREAM)[0]
    areas = (
        _draw(n, _Draws(*row[:8], far=row[8:]), (own.x, own.y), goal, aircraft)
        for n, row in enumerate(table[:count])
    )
    return tuple(area for area in areas if area is not None)


class _Draws(NamedTuple):
    """Numbers in [0, 1) that an area is made of."""

    along: float
    across: float
    moves: float
    speed: float
    course: float
    size: float
    kind: float  # below 0.5: a disc
    corners: float
    far: np.ndarray  # how far each corner is from the centre, [most corners]


def _draw(number: int, draws: _Draws, start: Place, goal: Place, aircraft: Aircraft) -> Area | None:
    """Return an area by its draws; None where it would have to be too small."""
    unit = aircraft.separation
    way = np.subtract(goal, start)
    length = max(float(np.hypot(*way)), 1e-9)
    ahead = way / length
    leftward = np.array([-ahead[1], ahead[0]])
    aside = between((-_ACROSS, _ACROSS), draws.across) * unit * leftward
    centre = start + between(_ALONG, draws.along) * way + aside
    nearest = min(float(np.hypot(*(centre - place))) for place in (start, goal))
    size = min(between(_SIZE, draws.size) * unit, nearest - (_CLEARANCE + _OFF) * unit)
    if size < _SMALLEST * unit:
        return None
    # What moves may come as near to start and goal as it gets.
    speed = 0.0
    if draws.moves < _MOVING:
        speed = draws.speed * _FASTEST * aircraft.limits.speed_max
    course = 2.0 * math.pi * draws.course
    return Area(
        _shape(draws, centre, size),
        velocity=(float(speed * math.cos(course)), float(speed * math.sin(course))),
        clearance=_CLEARANCE * unit,
        name=f"area {number}",
    )


def _shape(draws: _Draws, centre: np.ndarray, size: float) -> Circle | Polygon:
    """Return a disc or a polygon around a centre, no point of it farther than its size, m."""
    if draws.kind < 0.5:
        return Circle(float(centre[0]), float(centre[1]), float(size))
    corners = int(between(_CORNERS, draws.corners))
    angle = 2.0 * math.pi * np.arange(corners) / corners
    far = size * between((0.4, 1.0), draws.far[:corners])
    x, y = centre[0] + far * np.cos(angle), centre[1] + far * np.sin(angle)
    return Polygon(tuple(zip(x.tolist(), y.tolist(), strict=True)))
