"""Intruders that are left out of a request: they cannot come near before any plan of it ends.

An intruder is out of the way vertically, or because both aircraft together cannot fly as far as
they are apart. What is unknown counts as the worst that is plausible.
"""

import math
from collections.abc import Sequence

from agents.kernel.levels import Altitude, vertical_gap
from agents.planner.answer import Apart, Excluded, Kind, Reason
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.reports import Intruder
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.waypoints import Waypoint

SPEED_TOLERANCE = 1e-3
"""m/s; far more than a leg may pass its limit by."""

_EARTH = 6.3e6  # m; less than every radius of curvature of the earth


def find_excluded(
    own: VehicleState[Air],
    reports: Sequence[Intruder[Air]],
    own_altitude: Altitude | None,
    end: float,
    options: Options[Narrowed],
) -> tuple[Excluded, ...]:
    """Return the intruders that cannot come near until a time, and why.

    Args:
        own: state of the ownship at the request, in floats.
        reports: of the intruders, checked.
        own_altitude: of the ownship; None: unknown, nobody is vertically out of the way.
        end: that no plan outlasts, s after the request.
        options: of the flight.
    """
    excluded = list[Excluded]()
    for number, report in enumerate(reports):
        above = _why_vertically_apart(own_altitude, report, end, options)
        if above is not None:
            excluded.append(Excluded(number, above, end))
            continue
        far = _why_out_of_reach(own, report, end, options)
        if far is not None:
            excluded.append(Excluded(number, far, end, Apart.FAR))
    return tuple(excluded)


def unproven_exclusions(excluded: Sequence[Excluded], end: Waypoint) -> list[Reason]:
    """Return the intruders that are known to stay out of the way for less long than a plan lasts,
    which ends at a waypoint.
    """
    reasons = []
    for intruder in excluded:
        if not end.time <= intruder.until:
            text = (
                f"was left out until {intruder.until:.0f} s, expected until the plan's end at "
                f"{end.time:.0f} s"
            )
            place = end.time, end.x, end.y
            reasons.append(
                Reason.of(Kind.SEPARATION, f"intruders[{intruder.number}]", text, *place)
            )
    return reasons


def _why_vertically_apart(
    own: Altitude | None, report: Intruder[Air], end: float, options: Options[Narrowed]
) -> str | None:
    """Return why an intruder is above or below until a time, s; None where it may not be."""
    if own is None or report.altitude is None:
        return None
    least = abs(vertical_gap(own, report.altitude, report.age, end, options.unknown_climb))
    if least <= report.vertical(options):
        return None
    return f"stays {least:.0f} m above or below ({own.reference}) for {end:.0f} s"


def _why_out_of_reach(
    own: VehicleState[Air], report: Intruder[Air], end: float, options: Options[Narrowed]
) -> str | None:
    """Return why an intruder cannot come near until a time, s; None where it may.

    However both turn, neither flies farther than its speed times the time. The intruder may be as
    fast as traffic is, whatever its report says, and its uncertainty grows until the end.
    """
    away = least_distance(own, report.state)
    time = abs(report.age) + end
    speed = max(report.state.speed, options.aircraft.traffic_speed_max)
    fastest = max(own.speed, options.limits.speed_max) + SPEED_TOLERANCE
    spread = math.hypot(report.position_std, report.velocity_std * time)
    requirement = options.requirement
    separation = requirement.separation if report.separation is None else report.separation
    required = separation + requirement.margin + requirement.sigmas * spread
    if away - speed * time - fastest * end <= required:
        return None
    return f"is {away / 1e3:.0f} km away, out of reach within {end:.0f} s"


def least_distance(own: VehicleState[Air], other: VehicleState[Air]) -> float:
    """Return a distance on the earth that two places in a local frame are at least apart, m.

    The frame is true from its origin outwards and stretches what lies across: by d^2 / (6 R^2) at a
    distance d (azimuthal equidistant projection; 0.04 % at 300 km).
    """
    farthest = max(math.hypot(own.x, own.y), math.hypot(other.x, other.y))
    stretch = 1.0 + (farthest / _EARTH) ** 2 / 5.0
    return math.hypot(other.x - own.x, other.y - own.y) / stretch
