"""How much the rows of a recorded track may contradict each other.

From one row to the next, and over each :data:`WINDOW` seconds, the change of position must be what the reported
velocities make of it (by the trapezoidal rule), within

    ``POSITION + VELOCITY t + ACCELERATION / 4 sum(dt^2)`` horizontally and ``HEIGHT + CLIMB t`` vertically,

t seconds in all and dt from row to row; the last term is what an acceleration between two rows can do. A row that
no aircraft could have reached so is an outlier, of another aircraft with the same address, or of another clock.
"""

import math
from collections.abc import Sequence

from envs.formats.local_frame import WGS84

POSITION, VELOCITY, ACCELERATION = 300.0, 50.0, 5.0
"""m, m/s and m/s^2, horizontally. Of 210 000 steps of real reports a second apart 7 are beyond."""

HEIGHT, CLIMB = 100.0, 50.0  # m and m/s, vertically
WINDOW = 20.0  # s


def within(off: Sequence[float], seconds: float) -> bool:
    """Return whether rows agree: how far they are off, east, north and up, and what an acceleration can do, m."""
    east, north, up, bend = off
    level = math.hypot(east, north) <= POSITION + VELOCITY * seconds + bend
    return level and abs(up) <= HEIGHT + CLIMB * seconds


def missed(before: dict[str, float], after: dict[str, float]) -> tuple[float, float, float]:
    """Return how far a row is, east, north and up, m, from where the velocities of both rows lead from the first."""
    step, turn = after["time"] - before["time"], 0.0
    if "lat" in before:
        out, back, length = WGS84.inv(before["lon"], before["lat"], after["lon"], after["lat"], radians=True)
        east, north = length * math.sin(out), length * math.cos(out)
        turn = back + math.pi - out if length > 1e-6 else 0.0
    else:
        east, north = after["sx"] - before["sx"], after["sy"] - before["sy"]
    (vx, vy), (wx, wy) = _velocity(before), _velocity(after)
    # North where the geodesic ends is turned against north where it begins.
    cosine, sine = math.cos(turn), math.sin(turn)
    wx, wy = wx * cosine - wy * sine, wx * sine + wy * cosine
    up = after["alt"] - before["alt"] - 0.5 * (before["vs"] + after["vs"]) * step
    return east - 0.5 * (vx + wx) * step, north - 0.5 * (vy + wy) * step, up


def _velocity(values: dict[str, float]) -> tuple[float, float]:
    if "gs" in values:
        return values["gs"] * math.sin(values["trk"]), values["gs"] * math.cos(values["trk"])
    return values["vx"], values["vy"]
