"""The low-fidelity counterpart of the true aircraft: a point mass in three dimensions with first-order lags.

Bank, longitudinal acceleration and climb follow their commands with one lag each; the accelerations are bounded by
the stored drag and by the thrust at idle and full power at the altitude held. It shows which errors of the true
aircraft come from lags and limits alone. No sideslip, no angle of attack, no turbulence.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from envs.c208.curve import Curve
from envs.c208.facts import VARIANTS
from envs.c208.propulsion import DENSITY_0, idle_thrust, maximum_thrust
from envs.c208.trim import stored
from envs.kinematics import VehicleState

__all__ = ["LAGS", "Lags", "PointMassVehicle"]

_GRAVITY, _POUND = 9.80665, 4.4482216
_LONGEST = 0.05  # of an integration step, s
_BANK_MAX = math.radians(45.0)
_CLIMB_MAX = 5.0  # m/s


class Lags(NamedTuple):
    """Time constants, s."""

    bank: float = 0.65
    acceleration: float = 0.5
    climb: float = 1.5


LAGS = Lags()


class PointMassVehicle:
    """A point mass with the aircraft's drag and thrust; satisfies :class:`envs.follower.Vehicle`.

    Args:
        state: over the ground, at the beginning.
        variant: name in :data:`envs.c208.facts.VARIANTS`; its greatest weight.
        wind: velocity of the air towards east and north, m/s.
        altitude: to hold, m.
        start_altitude: at the beginning, m; None: the one to hold.
        lags: of the responses.

    Raises:
        ValueError: the state is not finite, or the variant unknown.
    """

    def __init__(
        self,
        state: VehicleState,
        variant: str = "ex",
        wind: tuple[float, float] = (0.0, 0.0),
        altitude: float = 2500.0,
        start_altitude: float | None = None,
        lags: Lags = LAGS,
    ) -> None:
        if variant not in VARIANTS:
            raise ValueError(f"variant is {variant!r}; expected one of {', '.join(VARIANTS)}")
        for name, number in zip(VehicleState._fields, state, strict=True):
            if np.ndim(number) != 0 or not math.isfinite(float(number)):
                raise ValueError(f"state.{name} is {number}; expected one finite number")
        self._variant, self._wind, self._lags = VARIANTS[variant], wind, lags
        self._held = altitude
        self.altitude = altitude if start_altitude is None else start_altitude
        self.climb = self.bank = self._along = 0.0
        self._x, self._y = float(state.x), float(state.y)
        speed, heading = float(state.speed), float(state.heading)
        east, north = speed * math.cos(heading) - wind[0], speed * math.sin(heading) - wind[1]
        self.airspeed, self._course = math.hypot(east, north), math.atan2(north, east)
        self._weight = self._variant.takeoff_weight * _POUND
        table, speeds = stored(), np.linspace(25.0, 130.0, 211)
        self._density = DENSITY_0 * (1.0 - 0.0065 * altitude / 288.15) ** 4.25588
        thrusts = (np.asarray(curve(self._variant, speeds, self._density)) for curve in (idle_thrust, maximum_thrust))
        self._idle, self._top = (Curve(speeds, thrust, 25.0, 130.0) for thrust in thrusts)
        self._drag = Curve(table.speed, table.thrust, float(table.speed[0]), float(table.speed[-1]))

    @property
    def state(self) -> VehicleState:
        """Position, heading and speed over the ground now."""
        level = math.sqrt(max(self.airspeed**2 - self.climb**2, 1.0))
        east = level * math.cos(self._course) + self._wind[0]
        north = level * math.sin(self._course) + self._wind[1]
        return VehicleState(self._x, self._y, math.atan2(north, east), math.hypot(east, north))

    def step(self, acceleration: Any, yaw_rate: Any, dt: float) -> None:
        """Fly on under an acceleration (m/s^2) and a turn rate of the track (rad/s, positive to the left) for dt, s.

        Raises:
            ValueError: a command is not finite or ``dt`` is not positive.
        """
        acceleration, yaw_rate = float(acceleration), float(yaw_rate)
        if not (math.isfinite(acceleration) and math.isfinite(yaw_rate) and dt > 0.0):
            raise ValueError(f"the command is ({acceleration}, {yaw_rate}) for {dt} s; expected finite numbers, dt > 0")
        low, high = self.reach()
        steps = math.ceil(dt / _LONGEST - 1e-9)
        for _ in range(steps):
            self._advance(acceleration, yaw_rate, dt / steps, low, high)

    def reach(self) -> tuple[float, float]:
        """Return the accelerations along the path that idle and full power give now, m/s^2."""
        reference = DENSITY_0 * (1.0 - 0.0065 * 2500.0 / 288.15) ** 4.25588
        share = self._weight / (8807.0 * _POUND) / math.cos(self.bank)
        drag = share * self._drag(self.airspeed * math.sqrt(self._density / reference / share))
        forces = self._idle(self.airspeed), self._top(self.airspeed)
        mass = self._weight / _GRAVITY
        slope = _GRAVITY * self.climb / self.airspeed
        low, high = ((force - drag) / mass - slope for force in forces)
        return low, high

    def _advance(self, acceleration: float, yaw_rate: float, dt: float, low: float, high: float) -> None:
        state = self.state
        crab = math.remainder(state.heading - self._course, 2.0 * math.pi)
        across = state.speed * yaw_rate
        wanted = min(max(acceleration * math.cos(crab) - across * math.sin(crab), low), high)
        left = (across + wanted * math.sin(crab)) / max(math.cos(crab), 0.5)
        bank = min(max(math.atan(left / _GRAVITY), -_BANK_MAX), _BANK_MAX)
        climb = min(max(0.35 * (self._held - self.altitude), -_CLIMB_MAX), _CLIMB_MAX)
        # Exact over the step for a constant command.
        before = self.bank, self._along, self.climb
        targets = bank, wanted, climb
        after = [
            target + (here - target) * math.exp(-dt / lag)
            for here, target, lag in zip(before, targets, self._lags, strict=True)
        ]
        turn = 0.5 * (math.tan(before[0]) + math.tan(after[0])) * _GRAVITY / self.airspeed
        gain = 0.5 * (before[1] + after[1])
        self.altitude += 0.5 * (before[2] + after[2]) * dt
        self._course = math.remainder(self._course + turn * dt, 2.0 * math.pi)
        self.airspeed = max(self.airspeed + gain * dt, 30.0)
        self.bank, self._along, self.climb = after
        end = self.state
        # Trapezoid on the velocity: a centimetre in a minute of turning at this step.
        self._x += 0.5 * dt * (state.speed * math.cos(state.heading) + end.speed * math.cos(end.heading))
        self._y += 0.5 * dt * (state.speed * math.sin(state.heading) + end.speed * math.sin(end.heading))
