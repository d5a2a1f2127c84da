"""What flies: the true aircraft, its point-mass counterpart, or the surrogate, all over the ground
and in the wind.
"""

import math
from typing import Any, Protocol

import numpy as np

from agents.planner.request.options import speed_range
from envs import draws
from envs.c208.air_mass import air_commands
from envs.c208.facts import FOOT, POUND, VARIANTS, value
from envs.c208.flightgear import FlightGear
from envs.c208.guidance import LOOKAHEAD, Lookahead
from envs.c208.point_mass import PointMassVehicle
from envs.c208.propulsion import DENSITY_0, density_at
from envs.c208.vehicle import C208Vehicle
from envs.follower import KinematicVehicle, Vehicle
from envs.frames import Ground
from envs.kinematics import Limits, VehicleState
from envs.profile import Height
from envs.wind import Wind, over_ground, through_air
from eval.hifi.config import Drawn

VARIANT_OF = {
    "c208_ex": "ex",
    "c208": "675",
    "point_mass": "ex",
    "surrogate": "ex",
}  # Cessna behind each vehicle
PROMPT = Lookahead(turn=0.0, speed=0.0, climb=0.0)  # guidance of a vehicle without lags

_KNOT = 0.514444  # m/s
_STREAM = (1 << 40) + 2  # of the navigation's errors
_CORRELATION = 60.0  # of the navigation's errors, s
_LONGEST = 1_200  # s for which they are drawn


class Airborne(Vehicle[Ground], Protocol):
    """A vehicle in flight over the ground, its state in plain floats."""

    @property
    def height(self) -> Height:
        """Altitude above the sea, and climb."""
        ...

    def hold(self, height: Height) -> None:
        """Hold an altitude from now on, and fly a climb beside what leads back to it."""
        ...


class _Kinematic:
    """The surrogate's kinematics in the air mass, seen from the ground."""

    def __init__(
        self, own: VehicleState[Ground], limits: Limits, wind: Wind, altitude: float
    ) -> None:
        self._vehicle = KinematicVehicle(through_air(own, wind, 0.0), limits)
        self._wind, self._time, self.height = wind, 0.0, Height(altitude, 0.0)

    @property
    def state(self) -> VehicleState[Ground]:
        air = self._vehicle.state
        return over_ground(VehicleState(*(float(field) for field in air)), self._wind, self._time)

    def hold(self, height: Height) -> None:
        self.height = height

    def step(self, acceleration: Any, yaw_rate: Any, dt: float) -> None:
        altitude, climb = self.height
        self.height = Height(altitude + climb * dt, climb)
        self._vehicle.step(
            *air_commands(self.state, float(acceleration), float(yaw_rate), self._wind), dt
        )
        self._time += dt


class Navigation:
    """Where the aircraft believes itself to be: a slowly changing error of the position
    (first-order Gauss-Markov).

    ``std`` is one sigma per axis, m, 0 for the truth; the error follows from the seed and the
    number of the flight.
    """

    def __init__(self, std: float, seed: int, number: int) -> None:
        self._errors: list[tuple[float, float]] | None = None
        if std > 0.0:
            noise = std * draws.normals(seed, number, 1, (_LONGEST, 2), stream=_STREAM)[0]
            keep = math.exp(-1.0 / _CORRELATION)
            fresh, error, errors = math.sqrt(1.0 - keep * keep), noise[0], [noise[0]]
            for shock in noise[1:]:
                error = keep * error + fresh * shock
                errors.append(error)
            self._errors = np.array(errors).tolist()

    def believe(self, state: VehicleState[Ground], time: float) -> VehicleState[Ground]:
        """Return the state as it is believed to be."""
        if self._errors is None:
            return state
        second = min(int(time), _LONGEST - 2)
        share = min(time - second, 1.0)
        (x0, y0), (x1, y1) = self._errors[second], self._errors[second + 1]
        return state._replace(
            x=state.x + x0 + share * (x1 - x0), y=state.y + y0 + share * (y1 - y0)
        )


def begin(
    kind: str,
    own: VehicleState[Ground],
    drawn: Drawn,
    limits: Limits,
    viewer: FlightGear | None = None,
) -> Airborne:
    """Return a kind of vehicle at its start; a viewer shows the Cessna; ``FlightError``: it is lost
    or cannot fly.
    """
    wind = Wind(drawn.air.wind_east, drawn.air.wind_north)
    if kind == "surrogate":
        return _Kinematic(own, limits, wind, drawn.altitude)
    if kind == "point_mass":
        return PointMassVehicle(own, VARIANT_OF[kind], wind, drawn.altitude)
    return C208Vehicle(own, VARIANT_OF[kind], drawn.air, drawn.altitude, viewer)


def reach_of(kind: str, limits: Limits, drawn: Drawn) -> tuple[float, float]:
    """Return the slowest and the fastest true airspeed of a kind of vehicle under some conditions,
    m/s.

    Of the Cessna the stall in level flight and the greatest operating speed, of the surrogate what
    a request may have.
    """
    if kind == "surrogate":
        return speed_range(limits)
    density = density_at(drawn.altitude)
    weight = (drawn.air.loading.weight or takeoff_weight(kind)) * POUND
    area = value("wing_area") * FOOT**2
    stall = math.sqrt(2.0 * weight / (density * area * value("lift_max")))
    return stall, value("speed_max_operating") * _KNOT * math.sqrt(DENSITY_0 / density)


def lookahead_of(kind: str) -> Lookahead:
    """Return how far ahead the guidance looks for a kind of vehicle."""
    return PROMPT if kind == "surrogate" else LOOKAHEAD


def takeoff_weight(kind: str) -> float:
    """Return the greatest weight of a kind of vehicle, lb."""
    return VARIANTS[VARIANT_OF[kind]].takeoff_weight
