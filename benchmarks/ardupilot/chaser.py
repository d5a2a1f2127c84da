"""An aircraft that is sent towards ours, and away again."""

import math

import numpy as np

from ros_bridge.mavlink.flight import Row
from ros_bridge.mavlink.sitl import Sitl

_SPEED = 25.0  # m/s
_TURN = math.radians(10.0)  # a second
_ABOVE = 620.0  # m above mean sea level
_FIRST = 0xB00000


class Chaser:
    """One aircraft after another, each with an address of its own, reported once a second."""

    def __init__(self, seed: int) -> None:
        self._draw = np.random.default_rng(seed)
        self._number = _FIRST
        self._x = self._y = self._course = 0.0
        self._leaves = True
        self._time: float | None = None

    def come(self, own: Row, course: float, seconds: float) -> None:
        """Let another one cross our way in so many seconds; our course in rad."""
        self._number += 1
        side = float(self._draw.choice((-1.0, 1.0)))
        self._course = course + side * 0.5 * math.pi
        way = own.speed * seconds
        back = _SPEED * seconds
        self._x = own.x + way * math.cos(course) - back * math.cos(self._course)
        self._y = own.y + way * math.sin(course) - back * math.sin(self._course)
        self._time, self._leaves = None, False

    def leave(self) -> None:
        """Let it turn away from us from now on."""
        self._leaves = True

    def report(self, sitl: Sitl, own: Row) -> None:
        """Fly on to a time, and send where it is, where a second has passed."""
        if self._number == _FIRST:
            return
        passed = 1.0 if self._time is None else own.time - self._time
        if 0.0 <= passed < 1.0:
            return
        if self._time is not None:
            self._fly(passed, own)
        self._time = own.time
        track = 90.0 - math.degrees(self._course)
        sitl.traffic(self._number, self._x, self._y, track, _SPEED, _ABOVE)

    def _fly(self, seconds: float, own: Row) -> None:
        if self._leaves:
            away = math.atan2(self._y - own.y, self._x - own.x)
            turn = math.remainder(away - self._course, 2.0 * math.pi)
            self._course += max(-_TURN * seconds, min(turn, _TURN * seconds))
        self._x += _SPEED * seconds * math.cos(self._course)
        self._y += _SPEED * seconds * math.sin(self._course)
