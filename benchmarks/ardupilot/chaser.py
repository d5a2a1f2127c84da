"""Aircraft that are sent towards ours, one after another, and away again."""

import math
from dataclasses import dataclass

import numpy as np

from ros_bridge.mavlink.flight import Row
from ros_bridge.mavlink.sitl import Sitl

_SPEED = 25.0  # m/s
_TURN = math.radians(10.0)  # a second
_ABOVE = 620.0  # m above mean sea level
_FIRST = 0xB00001
_PERIOD = 1.0  # s between two reports


@dataclass
class _Other:
    number: int
    x: float
    y: float
    course: float  # rad
    leaves: bool = False

    def fly(self, seconds: float, own: Row) -> None:
        if self.leaves:
            away = math.atan2(self.y - own.y, self.x - own.x)
            turn = math.remainder(away - self.course, 2.0 * math.pi)
            self.course += max(-_TURN * seconds, min(turn, _TURN * seconds))
        self.x += _SPEED * seconds * math.cos(self.course)
        self.y += _SPEED * seconds * math.sin(self.course)


class Chaser:
    """Sends aircraft, each with an address of its own, and reports all of them once a second.

    None is ever left out: one that is not reported could be anywhere near, and would stop all
    planning for a minute.
    """

    def __init__(self, seed: int) -> None:
        self._draw = np.random.default_rng(seed)
        self._next = _FIRST
        self._others: list[_Other] = []
        self._time = -math.inf

    def add_crossing(self, own: Row, course: float, seconds: float) -> None:
        """Let one more cross our path in so many seconds; our course in rad."""
        across = course + float(self._draw.choice((-1.0, 1.0))) * 0.5 * math.pi
        ahead, back = own.speed * seconds, _SPEED * seconds
        x = own.x + ahead * math.cos(course) - back * math.cos(across)
        y = own.y + ahead * math.sin(course) - back * math.sin(across)
        self._others.append(_Other(self._next, x, y, across))
        self._next += 1

    def pass_aside(self, own: Row, away: float) -> None:
        """Let one more fly away from us, so many m from us, in any direction."""
        there = float(self._draw.uniform(-math.pi, math.pi))
        x, y = own.x + away * math.cos(there), own.y + away * math.sin(there)
        self._others.append(_Other(self._next, x, y, there, leaves=True))
        self._next += 1

    def leave(self) -> None:
        """Let all turn away from us from now on."""
        for intruder in self._others:
            intruder.leaves = True

    def distance(self, own: Row) -> float:
        """Return the distance of the nearest of them from our row, by their last report, m."""
        away = (math.hypot(intruder.x - own.x, intruder.y - own.y) for intruder in self._others)
        return min(away, default=math.inf)

    def report(self, sitl: Sitl, own: Row) -> None:
        """Let them fly to the time of our row, and send where they are, where a second has
        passed.
        """
        passed = own.time - self._time
        if 0.0 <= passed < _PERIOD:
            return
        self._time = own.time
        for intruder in self._others:
            intruder.fly(passed if math.isfinite(passed) else 0.0, own)
            track = 90.0 - math.degrees(intruder.course)
            sitl.traffic(intruder.number, intruder.x, intruder.y, track, _SPEED, _ABOVE)
