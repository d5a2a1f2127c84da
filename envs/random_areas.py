"""Areas drawn at random along the way of a flight, by number as encounters are.

Discs and polygons to be kept out of, some of them moving, lie beside or across the straight way
from a start to a goal. None holds either, nor comes near: an area that does shrinks until it keeps
off.
"""

import math

import numpy as np

from envs import draws
from envs.aircraft import Aircraft
from envs.areas import Area, Circle, Place, Polygon
from envs.arrays import Array
from envs.kinematics import VehicleState

MOST = 8
"""Areas of an encounter at most."""

_STREAM = 0x6172_6561  # keeps the draws apart from those of encounters with the same seed
_ALONG = 0.15, 0.85  # of the centres, shares of the way
_ACROSS = 2.0  # of the centres, separations from the way at most
_SIZE = 0.5, 2.0  # from the centre to the edge, separations
_CLEARANCE = 0.1  # separations
_OFF = 0.5  # from the edges to start and goal at least, beside the clearance, separations
_SMALLEST = 0.2  # separations: what would have to be smaller is left out
_CORNERS = 5, 9  # of polygons
_MOVING = 1.0 / 3.0  # share of areas
_FASTEST = 0.1  # of these, in the greatest speed of the aircraft
_DRAWS = 8 + _CORNERS[1]  # of an area


def random_areas(
    seed: int, number: int, count: int, own: VehicleState, goal: Place, aircraft: Aircraft
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
    drawn = (_draw(row, n, (own.x, own.y), goal, aircraft) for n, row in enumerate(table[:count]))
    return tuple(area for area in drawn if area is not None)


def _draw(u: Array, number: int, start: Place, goal: Place, aircraft: Aircraft) -> Area | None:
    unit = aircraft.separation
    way = np.subtract(goal, start)
    length = max(float(np.hypot(*way)), 1e-9)
    ahead = way / length
    left = np.array([-ahead[1], ahead[0]])
    centre = start + _within(_ALONG, u[0]) * way + _within((-_ACROSS, _ACROSS), u[1]) * unit * left
    # What moves may come as near as it gets on the way there.
    speed = 0.0 if u[2] >= _MOVING else u[3] * _FASTEST * aircraft.limits.speed_max
    course = 2.0 * math.pi * u[4]
    near = min(float(np.hypot(*(centre - place))) for place in (start, goal))
    size = min(_within(_SIZE, u[5]) * unit, near - (_CLEARANCE + _OFF) * unit)
    if size < _SMALLEST * unit:
        return None
    shape: Circle | Polygon
    if u[6] < 0.5:
        shape = Circle(float(centre[0]), float(centre[1]), float(size))
    else:
        corners = int(_within(_CORNERS, u[7]))
        angle = 2.0 * math.pi * np.arange(corners) / corners
        far = size * _within((0.4, 1.0), u[8 : 8 + corners])
        x, y = centre[0] + far * np.cos(angle), centre[1] + far * np.sin(angle)
        shape = Polygon(tuple(zip(x.tolist(), y.tolist(), strict=True)))
    velocity = float(speed * math.cos(course)), float(speed * math.sin(course))
    return Area(shape, velocity=velocity, clearance=_CLEARANCE * unit, name=f"area {number}")


def _within(span: tuple[float, float], share: Array) -> Array:
    return span[0] + (span[1] - span[0]) * share
