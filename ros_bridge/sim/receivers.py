"""What receivers make of the truth: states that come at a rate, late, with noise, and sometimes not
at all.

The noise is white, as the nodes assume it to be. Real errors of satellite navigation last for
minutes; both aircraft then see the same part of them, so that their distance is known better than
their places.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from envs.frames import Air
from envs.kinematics import VehicleState

_TOLERANCE = 1e-6  # s


class Quality(NamedTuple):
    """Of the reports of one receiver."""

    rate: float = 10.0  # Hz
    latency: float = 0.0  # from the time of a state to the arrival of its report, s
    dropout: float = 0.0  # share of the reports that never arrive
    position_std: float = 0.0  # one sigma per axis, m
    velocity_std: float = 0.0  # one sigma per axis, m/s


class Received(NamedTuple):
    """A report as it arrives."""

    identifier: str
    time: float  # of the state, s
    state: VehicleState[Air]  # with its noise


class Receiver:
    """Turns true states into reports, one aircraft after the other; the seed is of noise, losses
    and moments.
    """

    def __init__(self, quality: Quality, seed: int) -> None:
        self.quality = quality
        self._random = np.random.default_rng(seed)
        self._due: dict[str, float] = {}
        self._waiting: list[tuple[float, Received]] = []

    def receive(self, time: float, truth: Mapping[str, VehicleState[Air]]) -> list[Received]:
        """Return what arrives at a time, s; to be called as often as the aircraft move."""
        period = 1.0 / self.quality.rate
        for name, state in truth.items():
            if name not in self._due:
                # All are received at the beginning; after that each aircraft has its own moment.
                self._due[name] = time - period * self._random.random()
            elif time < self._due[name] - _TOLERANCE:
                continue
            self._due[name] += period
            if self._random.random() >= self.quality.dropout:
                self._waiting.append(
                    (time + self.quality.latency, Received(name, time, self._noisy(state)))
                )
        arrived = [received for arrival, received in self._waiting if arrival <= time + _TOLERANCE]
        self._waiting = [
            (arrival, received)
            for arrival, received in self._waiting
            if arrival > time + _TOLERANCE
        ]
        return arrived

    def _noisy(self, state: VehicleState[Air]) -> VehicleState[Air]:
        position, velocity = self.quality.position_std, self.quality.velocity_std
        if position == 0.0 and velocity == 0.0:
            return state
        x, y, east, north = self._random.standard_normal(4)
        east = state.speed * math.cos(state.heading) + velocity * east
        north = state.speed * math.sin(state.heading) + velocity * north
        return VehicleState(
            float(state.x + position * x),
            float(state.y + position * y),
            math.atan2(north, east),
            math.hypot(east, north),
        )
