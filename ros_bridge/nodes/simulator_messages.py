"""What the simulator publishes: the filed route, and what receivers make of states."""

import math

import numpy as np
from rlcas_msgs.msg import AircraftState, Trajectory, Waypoint

from agents.planner.request.request import Altitude
from envs.formats.local_frame import LocalFrame
from envs.profile import Height
from envs.wind import over_ground
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import Report
from ros_bridge.sim.receivers import Quality, Received
from ros_bridge.sim.world import ALTITUDE, OWN, EncounterFlight
from ros_bridge.transport.messages import aircraft_message

_SPACING, _BEYOND = (
    5.0,
    45.0,
)  # of the route's points, and how far it goes on beyond the goal, separations


def route_of(flight: EncounterFlight, frame: LocalFrame, separation: float) -> Trajectory:
    """Return the filed route: the goal, and points every 5 separations (m) on the same line to 45
    beyond it.
    """
    own = flight.own
    dx, dy = flight.goal[0] - own.x, flight.goal[1] - own.y
    length = max(math.hypot(dx, dy), 1.0)
    reach = _SPACING * separation * np.arange(round(_BEYOND / _SPACING) + 1)
    at = frame.geodetic(flight.goal[0] + dx / length * reach, flight.goal[1] + dy / length * reach)
    places = enumerate(zip(at.latitude.tolist(), at.longitude.tolist(), strict=True), 1)
    points = [
        Waypoint(index=index, latitude=place[0], longitude=place[1]) for index, place in places
    ]
    return Trajectory(status=Trajectory.STATUS_ROUTE, waypoints=points)


def state_message(
    received: Received, quality: Quality, frame: LocalFrame, zero: int, flight: EncounterFlight
) -> AircraftState:
    """Return what a receiver publishes of a state in the air mass of a flight; ``zero`` is the
    start of the encounter, ns.
    """
    wind, of_own = flight.wind, received.identifier == OWN
    height = flight.height_at(received.time) if of_own else Height(ALTITUDE, 0.0)
    state = over_ground(received.state, wind, received.time)
    at = frame.geodetic(state.x, state.y)
    true = state.heading - float(at.convergence)
    blows = math.atan2(wind.north, wind.east) - float(at.convergence)
    east, north = wind.speed * math.cos(blows), wind.speed * math.sin(blows)
    report = Report(
        received.identifier,
        zero + round(received.time * SECOND),
        float(at.latitude),
        float(at.longitude),
        state.speed * math.cos(true),
        state.speed * math.sin(true),
        altitude=Altitude(height.altitude, "wgs84", height.climb),
        position_std=quality.position_std,
        velocity_std=quality.velocity_std,
        true_airspeed=received.state.speed if of_own else None,
        wind=(float(east), float(north)) if of_own else None,
    )
    return aircraft_message(report)
