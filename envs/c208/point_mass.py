"""The low-fidelity counterpart of the true aircraft: a point mass in three dimensions with
first-order lags.

Bank, longitudinal acceleration and climb follow their commands with one lag each; the accelerations
are bounded by the stored drag and by the thrust at idle and full power at the altitude held. It
shows which errors of the true aircraft come from lags and limits alone. No sideslip, no angle of
attack, no turbulence.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.arrays import Array
from envs.c208.air_mass import air_demands
from envs.c208.autopilot import BANK_MAX, CLIMB_MAX
from envs.c208.conditions import check_state
from envs.c208.facts import GRAVITY, POUND, VARIANTS
from envs.c208.propulsion import Curve, density_at, idle_thrust, maximum_thrust
from envs.c208.trim import REFERENCE_ALTITUDE, REFERENCE_WEIGHT, level_curve
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import Height
from envs.wind import NO_WIND, Wind


class _Lagged(NamedTuple):
    """What follows its command with a lag."""

    bank: float  # rad
    along: float  # acceleration along the path, m/s^2
    climb: float  # m/s


_LAGS = _Lagged(bank=0.65, along=0.5, climb=1.5)  # s
_LONGEST = 0.05  # of an integration step, s


class PointMassVehicle:
    """A point mass with the aircraft's drag, thrust and greatest weight; satisfies
    :class:`envs.follower.Vehicle`.

    It begins in a state, at ``start_altitude`` (None: the one to hold), and holds
    ``altitude``, m, until :meth:`hold` says another.

    Raises:
        ValueError: the state is not finite, or the variant unknown.
    """

    def __init__(
        self,
        state: VehicleState[Ground],
        variant: str = "ex",
        wind: Wind = NO_WIND,
        altitude: float = REFERENCE_ALTITUDE,
        start_altitude: float | None = None,
    ) -> None:
        if variant not in VARIANTS:
            raise ValueError(f"variant is {variant!r}; expected one of {', '.join(VARIANTS)}")
        check_state(state)
        self._wind, self._held = wind, Height(altitude, 0.0)
        self.altitude = altitude if start_altitude is None else start_altitude
        self.climb = self.bank = self._along = 0.0
        self._x, self._y = float(state.x), float(state.y)
        speed, heading = float(state.speed), float(state.heading)
        east, north = speed * math.cos(heading) - wind.east, speed * math.sin(heading) - wind.north
        self.airspeed, self._course = math.hypot(east, north), math.atan2(north, east)
        self._weight = VARIANTS[variant].takeoff_weight * POUND
        speeds, self._density = np.linspace(25.0, 130.0, 211), density_at(altitude)
        thrusts = (
            thrust_of(VARIANTS[variant], speeds, self._density)
            for thrust_of in (idle_thrust, maximum_thrust)
        )
        self._idle, self._top = (Curve(speeds, np.asarray(thrust)) for thrust in thrusts)
        self._drag = level_curve("thrust")

    @property
    def state(self) -> VehicleState[Ground]:
        """Position, heading and speed now."""
        level = math.sqrt(max(self.airspeed**2 - self.climb**2, 1.0))
        east = level * math.cos(self._course) + self._wind.east
        north = level * math.sin(self._course) + self._wind.north
        return VehicleState(self._x, self._y, math.atan2(north, east), math.hypot(east, north))

    def hold(self, height: Height) -> None:
        """Hold an altitude from now on, and fly a climb beside what leads back to it."""
        self._held = height

    @property
    def height(self) -> Height:
        """Altitude above the sea, and climb."""
        return Height(self.altitude, self.climb)

    def step(self, acceleration: Array, yaw_rate: Array, dt: float) -> None:
        """Fly on under an acceleration along the track (m/s^2) and its turn rate (rad/s, positive
        to the left).

        Raises:
            ValueError: a command is not finite or ``dt`` is not positive.
        """
        acceleration, yaw_rate = float(acceleration), float(yaw_rate)
        if not (math.isfinite(acceleration) and math.isfinite(yaw_rate) and dt > 0.0):
            raise ValueError(
                f"the command is ({acceleration}, {yaw_rate}) for {dt} s; expected finite "
                "numbers, dt > 0"
            )
        low, high = self.reach()
        steps = math.ceil(dt / _LONGEST - 1e-9)
        for _ in range(steps):
            self._advance(acceleration, yaw_rate, dt / steps, low, high)

    def reach(self) -> tuple[float, float]:
        """Return the accelerations along the path that idle and full power give now, m/s^2."""
        share = self._weight / REFERENCE_WEIGHT / math.cos(self.bank)
        drag = share * self._drag(
            self.airspeed * math.sqrt(self._density / density_at(REFERENCE_ALTITUDE) / share)
        )
        forces = self._idle(self.airspeed), self._top(self.airspeed)
        mass = self._weight / GRAVITY
        slope = GRAVITY * self.climb / self.airspeed
        low, high = ((force - drag) / mass - slope for force in forces)
        return low, high

    def _advance(
        self, acceleration: float, yaw_rate: float, dt: float, low: float, high: float
    ) -> None:
        state = self.state
        along, left = air_demands(state, acceleration, yaw_rate, self._wind, (low, high))
        bank = min(max(math.atan(left / GRAVITY), -BANK_MAX), BANK_MAX)
        correction = 0.35 * (self._held.altitude - self.altitude)
        climb = self._held.climb + min(max(correction, -CLIMB_MAX), CLIMB_MAX)
        before = _Lagged(self.bank, self._along, self.climb)
        demanded = _Lagged(bank, min(max(along, low), high), climb)
        # Exact over the step for a constant command.
        after = _Lagged(
            *(
                target + (value - target) * math.exp(-dt / lag)
                for value, target, lag in zip(before, demanded, _LAGS, strict=True)
            )
        )
        turn = 0.5 * (math.tan(before.bank) + math.tan(after.bank)) * GRAVITY / self.airspeed
        gain = 0.5 * (before.along + after.along)
        self.altitude += 0.5 * (before.climb + after.climb) * dt
        self._course = math.remainder(self._course + turn * dt, 2.0 * math.pi)
        self.airspeed = max(self.airspeed + gain * dt, 30.0)
        self.bank, self._along, self.climb = after
        end = self.state
        # Trapezoid on the velocity: a centimetre in a minute of turning at this step.
        self._x += (
            0.5 * dt * (state.speed * math.cos(state.heading) + end.speed * math.cos(end.heading))
        )
        self._y += (
            0.5 * dt * (state.speed * math.sin(state.heading) + end.speed * math.sin(end.heading))
        )
