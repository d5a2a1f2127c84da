"""Certificates made by hand: a straight flight, or one of given controls, with what stands around
it.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

from agents.check import FORMAT, RefusedError, Work, accept

SPEED = 80.0
LIMITS = {
    "speed_min": 31.0,
    "speed_max": 100.0,
    "acceleration_min": -0.8,
    "acceleration_max": 0.5,
    "yaw_rate_max": 0.08,
}


def flight(
    *legs: tuple[float, float],
    speed: float = SPEED,
    seconds: float = 20.0,
    **changes: Any,
) -> dict[str, Any]:
    """Return the certificate of a flight from the origin towards the east, a leg for each turn
    rate (rad/s) and acceleration (m/s^2); one of both is 0.
    """
    x = y = heading = 0.0
    own, waypoints, controls = [x, y, heading, speed], [], []
    for number, (rate, gain) in enumerate(legs, 1):
        if rate:
            radius = speed / rate
            x += radius * (math.sin(heading + rate * seconds) - math.sin(heading))
            y -= radius * (math.cos(heading + rate * seconds) - math.cos(heading))
            heading += rate * seconds
        else:
            way = speed * seconds + 0.5 * gain * seconds**2
            x, y = x + way * math.cos(heading), y + way * math.sin(heading)
            speed += gain * seconds
        waypoints.append([x, y, heading, speed, number * seconds])
        controls.append([rate] * 10 + [gain] * 10)
    certificate = {
        "format": FORMAT,
        "request": {"policy": None, "time_ns": None, "latitude": None, "longitude": None},
        "own": own,
        "waypoints": waypoints,
        "controls": controls,
        "intruders": [],
        "excluded": [],
        "apart": [],
        "requirement": {"separation": 1_000.0, "margin": 20.0, "sigmas": 0.0},
        "limits": dict(LIMITS),
        "wind": {"east": 0.0, "north": 0.0, "std": 0.0},
        "areas": [],
        "levels": None,
        "profile": None,
        "parts": 32,
        "bounds": [1.0] * len(changes.get("intruders", ())),
    }
    return certificate | changes


def straight(**changes: Any) -> dict[str, Any]:
    """Return the certificate of 40 s at 80 m/s to x = 3200 m."""
    return flight((0.0, 0.0), (0.0, 0.0), **changes)


def climbing(
    *altitudes: float,
    profile: dict[str, Any] | None = None,
    **changes: Any,
) -> dict[str, Any]:
    """Return the certificate of a straight flight with a leg of 20 s to each altitude, m, from
    level flight at 1000 +- 10 m.
    """
    usual = {
        "altitudes": list(altitudes),
        "climb": 0.0,
        "climb_max": 6.0,
        "descent_max": 6.0,
        "acceleration": 1.0,
        "margin": 5.0,
        "floor": None,
        "ceiling": None,
    }
    stated = usual | (profile or {})
    climb = stated["climb"]
    levels = [990.0, climb, 1_010.0, climb]
    legs = [(0.0, 0.0)] * len(altitudes)
    return flight(*legs, **{"levels": levels, "profile": stated} | changes)


def in_wind(data: dict[str, Any], east: float, north: float) -> dict[str, Any]:
    """Return the certificate of a flight through the air, over the ground in a wind, m/s."""

    def over_ground(row: Sequence[float], time: float) -> list[float]:
        x, y, heading, speed = row[:4]
        across, along = speed * math.sin(heading) + north, speed * math.cos(heading) + east
        place = [x + east * time, y + north * time]
        return [*place, math.atan2(across, along), math.hypot(across, along), *row[4:]]

    return data | {
        "own": over_ground(data["own"], 0.0),
        "waypoints": [over_ground(row, row[4]) for row in data["waypoints"]],
        "wind": {"east": east, "north": north, "std": 0.0},
    }


def intruder(  # noqa: PLR0917 - the fields of a report
    x: float,
    y: float,
    heading: float = 0.0,
    speed: float = 0.0,
    age: float = 0.0,
    turn_rate: float = 0.0,
    turn_time: float = 0.0,
    position_std: float = 0.0,
    velocity_std: float = 0.0,
    separation: float = 1_000.0,
) -> list[float]:
    """Return the row of an intruder."""
    return [
        *(x, y, heading, speed, age, turn_rate, turn_time),
        *(position_std, velocity_std, separation),
    ]


def area(**fields: Any) -> dict[str, Any]:
    """Return an area to keep out of, with a clearance of 100 m."""
    usual = {
        "keep": "out",
        "circle": [],
        "rings": [],
        "velocity": [0.0, 0.0],
        "growth": 0.0,
        "clearance": 100.0,
        "valid": [None, None],
        "heights": [None, None],
    }
    return usual | fields


def box(left: float, bottom: float, right: float, top: float) -> list[list[float]]:
    """Return the ring of a rectangle."""
    return [[left, bottom], [right, bottom], [right, top], [left, top]]


def accepted(data: Any) -> bool:
    """Return whether the checker accepts a certificate."""
    try:
        accept(data)
    except RefusedError:
        return False
    return True


def refusal(data: Any) -> str:
    """Return why the checker refuses a certificate; empty: it accepts it."""
    try:
        accept(data)
    except RefusedError as problem:
        return str(problem)
    return ""


def work_of(data: Any) -> int:
    """Return the work that a proof takes, of a certificate that is accepted."""
    work = Work()
    accept(data, work)
    return work.most - work.remaining


def threshold(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Return from which number on something holds, which does at ``high`` and not at ``low``."""
    assert holds(high) and not holds(low)
    while high - low > 1e-7 * max(abs(high), 1.0):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def edited(data: dict[str, Any], path: Sequence[Any], value: Any) -> dict[str, Any]:
    """Return a certificate with another value at a path of keys."""
    key, *below = path
    copy: Any = dict(data) if isinstance(data, dict) else list(data)
    copy[key] = edited(copy[key], below, value) if below else value
    return copy
