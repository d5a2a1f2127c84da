"""What Hypothesis draws requests from that are valid and extreme: routes, intruders, areas and
altitudes.
"""

import math
from typing import Any

from hypothesis import strategies as st

from agents.kernel.levels import Altitude
from agents.planner import Intruder
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

ANGLES = st.sampled_from([0.0, math.pi, -math.pi, 0.5 * math.pi, 1e-9, 3.0]) | st.floats(
    -math.pi, math.pi
)
LENGTHS = st.sampled_from([1.0, 100.0, 600.0, 3e3, 12e3, 60e3, 400e3, 960e3])
"""Between points, m."""


@st.composite
def routes(draw: Any) -> list[RoutePoint]:
    """Draw a route that goes on in any direction, over short and over long legs."""
    x, y, course = 0.0, 0.0, draw(ANGLES)
    points = list[RoutePoint]()
    for index in range(draw(st.integers(2, 7))):
        length = draw(LENGTHS)
        x, y = x + length * math.cos(course), y + length * math.sin(course)
        if max(abs(x), abs(y)) > 1e6:
            break
        points.append(RoutePoint(index, x, y))
        course += draw(st.sampled_from([0.0, 0.0, 0.5, -2.0, math.pi]))
    last = points[-1] if points else RoutePoint(0, 0.0, 0.0)
    while len(points) < 2:
        points.append(RoutePoint(len(points) + 90, last.x, last.y - 5_000.0 * (len(points) + 1)))
    return points


@st.composite
def altitudes(draw: Any) -> Altitude | None:
    """Draw an altitude, or that none is known."""
    climb = draw(st.sampled_from([None, 0.0, -100.0, 100.0, 1.0]))
    return draw(st.none() | st.just(Altitude(draw(st.floats(-400, 2e4)), "msl", climb, 5.0)))


@st.composite
def intruders(draw: Any) -> Intruder:
    """Draw an intruder, near or far, known well or hardly."""
    away, bearing = draw(LENGTHS), draw(ANGLES)
    return Intruder(
        VehicleState(
            away * math.cos(bearing),
            away * math.sin(bearing),
            draw(ANGLES),
            draw(st.sampled_from([0.0, 1e-9, 80.0, 150.0, 400.0])),
        ),
        age=draw(st.sampled_from([0.0, 5.0])),
        turn_rate=draw(st.sampled_from([0.0, 1e-12, 0.05, -0.2])),
        turn_time=draw(st.sampled_from([0.0, 15.0, 300.0])),
        position_std=draw(st.sampled_from([0.0, 0.0, 30.0, 5e3])),
        velocity_std=draw(st.sampled_from([0.0, 1.0, 50.0])),
        altitude=draw(altitudes()),
        separation=draw(st.sampled_from([None, None, None, 1.0, 3e4])),
    )


@st.composite
def areas(draw: Any) -> Area:
    """Draw an area: small or large, near or far, standing or not, to be kept out of or in."""
    away, bearing = draw(LENGTHS), draw(ANGLES)
    x, y = away * math.cos(bearing), away * math.sin(bearing)
    size = draw(st.sampled_from([1.0, 500.0, 2e3, 2.9e4]))
    corners = tuple(
        (x + size * math.cos(angle), y + size * math.sin(angle)) for angle in (0.1, 1.5, 3.0, 5.0)
    )
    begin = draw(st.sampled_from([-math.inf, 0.0, 100.0, 1e5]))
    return Area(
        draw(st.sampled_from([Circle(x, y, size), Polygon(corners)])),
        draw(st.sampled_from([Keep.OUT, Keep.OUT, Keep.IN])),
        velocity=draw(st.sampled_from([(0.0, 0.0), (20.0, -40.0)])),
        growth=draw(st.sampled_from([0.0, 10.0, -10.0])),
        floor=draw(st.none() | st.just(Level(300.0, "msl"))),
        valid_from=begin,
        valid_until=begin + 200.0 if math.isfinite(begin) else math.inf,
        clearance=draw(st.sampled_from([0.0, 0.0, 50.0, 2e4])),
    )
