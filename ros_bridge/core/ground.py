"""Whether a report that claims to be of the ground is believed."""

from agents.planner.request.request import Altitude
from envs.traffic.ground import flies
from ros_bridge.core.reports import Report

_BELOW = 30.0  # m below the ownship, and no more: as high as it
_FLYING = 10.0  # m/s, from which on the ownship is taken to fly


def on_ground(
    speed: float | None,
    climb: float | None,
    altitude: float | None,
    comparable: Altitude | None = None,
    own: Report | None = None,
) -> bool:
    """Return whether what is said to be on the ground may be: it neither moves as in flight nor is
    as high as the ownship that flies.

    Args:
        speed: over the ground, m/s; None, as of the others: unknown.
        climb: m/s.
        altitude: m above anything.
        comparable: the same with what it is above; None: unknown.
        own: the ownship; None: unknown.
    """
    if flies(speed, climb, altitude):
        return False
    level = None if own is None else own.altitude
    if own is None or level is None or comparable is None or own.speed < _FLYING:
        return True
    same_reference = level.reference == comparable.reference
    return not (same_reference and comparable.value >= level.value - _BELOW)
