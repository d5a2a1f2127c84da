"""The aircraft: what it can do, which separation it must keep, and the units in which all aircraft
are alike.

Lengths in required separations D, speeds in ``speed_max`` and times in D / ``speed_max``: two
aircraft with the same four :class:`Ratios` fly the same encounters, scaled. Everything that a rule,
a scenario or an observation needs as a number follows from here.
"""

import math
from typing import NamedTuple

from commands.command import InputError
from envs.arrays import Array
from envs.compiled import scalar
from envs.kinematics import FASTEST, Limits
from envs.outcome import Rules

_STEPS = 300
"""Time steps until a route counts as missed (paper: 300 s of 1 s)."""

_TRAFFIC = 1.5
"""Greatest speed of the traffic, in greatest speeds of the ownship (paper: 150 of 100 m/s)."""


class AircraftError(InputError):
    """An impossible aircraft; the message names the number and what was expected."""


class Vertical(NamedTuple):
    """What an aircraft can do up and down, and the separation above and below that then suffices;
    floats.
    """

    climb_max: float  # m/s, held at every speed and in every turn of the aircraft's limits
    descent_max: float  # m/s, positive, held likewise
    acceleration: float  # with which a climb changes, m/s^2
    separation: float  # required vertical separation, m


LEAST_VERTICAL, GREATEST_VERTICAL = Vertical(0.1, 0.1, 0.05, 1.0), Vertical(100.0, 100.0, 50.0, 1e4)
"""Between which any aircraft's are."""


class Aircraft(NamedTuple):
    """An aircraft and its task; floats, so that they can be data of a compiled function."""

    limits: Limits
    separation: Array  # required horizontal separation D, m
    goal_radius: Array  # distance from the goal at which the ownship has rejoined its route, m
    traffic_speed_max: Array  # greatest speed of the traffic, m/s
    dt: Array  # time step of decisions, s
    t_max: Array  # duration after which the route counts as missed, s; a whole number of steps
    vehicle: Limits | None = None
    """What the vehicle itself can do, where decisions are more conservative; None: the limits."""
    vertical: Vertical | None = None
    """What it can do up and down; None: it plans in the plane."""

    @property
    def time_unit(self) -> Array:
        """D / ``speed_max``, s."""
        return self.separation / self.limits.speed_max

    def rules(self) -> Rules:
        """Return the rules of an encounter, with the paper's rewards."""
        return Rules(self.dt, self.t_max, self.separation, self.goal_radius)

    @property
    def vehicle_limits(self) -> Limits:
        """What the vehicle itself can do: legs of plans obey it."""
        return self.limits if self.vehicle is None else self.vehicle


class Ratios(NamedTuple):
    """The limits in units of the separation D and of ``speed_max``; floats or ``[...]``."""

    speed_min: Array  # in speed_max
    acceleration_min: Array  # in speed_max^2 / D, negative
    acceleration_max: Array  # in the same
    turn_radius: Array  # of the circle at speed_max and the greatest yaw rate, in D


@scalar
def ratios(limits: Limits, separation: Array) -> Ratios:
    """Return the limits in units of the separation (m) and of the greatest speed; floats or
    ``[...]``.
    """
    unit = separation / (limits.speed_max * limits.speed_max)
    return Ratios(
        limits.speed_min / limits.speed_max,
        limits.acceleration_min * unit,
        limits.acceleration_max * unit,
        limits.speed_max / (limits.yaw_rate_max * separation),
    )


def new_aircraft(
    limits: Limits,
    separation: float,
    *,
    goal_radius: float | None = None,
    traffic_speed_max: float | None = None,
    dt: float | None = None,
    t_max: float | None = None,
    vehicle: Limits | None = None,
    vertical: Vertical | None = None,
) -> Aircraft:
    """Return an aircraft; what is not given follows from its limits and its separation.

    Args:
        limits: floats, SI.
        separation: m.
        goal_radius: m; half the separation.
        traffic_speed_max: m/s; 1.5 ``speed_max``.
        dt: s; a tenth of the time unit, of two digits.
        t_max: s; 300 time steps.
        vehicle: what the vehicle itself can do, where decisions are more conservative; the limits.
        vertical: what it can do up and down; None: it plans in the plane.

    Raises:
        AircraftError: a number is not finite or out of range, or two contradict each other.
    """
    limits = _check_limits("", limits)
    if vehicle is not None:
        vehicle = _check_vehicle(vehicle, limits)
    if not 1.0 <= separation <= 1e6:
        raise AircraftError(f"separation is {separation:g}; expected 1 to 1e+06")
    if goal_radius is None:
        goal_radius = 0.5 * separation
    if traffic_speed_max is None:
        traffic_speed_max = _TRAFFIC * float(limits.speed_max)
    if dt is None:
        dt = float(f"{0.1 * separation / limits.speed_max:.1e}")
    if t_max is None:
        t_max = _STEPS * dt
    aircraft = Aircraft(
        limits,
        separation=float(separation),
        goal_radius=float(goal_radius),
        traffic_speed_max=float(traffic_speed_max),
        dt=float(dt),
        t_max=float(t_max),
        vehicle=vehicle,
        vertical=None if vertical is None else _check_vertical(vertical),
    )
    _check_task(aircraft)
    return aircraft


def _check_task(aircraft: Aircraft) -> None:
    """Refuse numbers of a task that are not finite and positive, or that contradict each other."""
    for name, value in aircraft._asdict().items():
        if name not in ("limits", "vehicle", "vertical") and not (
            math.isfinite(value) and value > 0.0
        ):
            raise AircraftError(f"{name} is {value:g}; expected a finite number above 0")
    separation, dt, t_max = aircraft.separation, aircraft.dt, aircraft.t_max
    if aircraft.goal_radius > separation:
        raise AircraftError(
            f"goal_radius is {aircraft.goal_radius:g} m; expected at most the separation, "
            f"{separation:g} m"
        )
    turn = aircraft.limits.yaw_rate_max * dt
    if turn > 1.0:
        raise AircraftError(
            f"yaw_rate_max turns {turn:g} rad in a time step of {dt:g} s; expected at most 1 rad"
        )
    if abs(t_max / dt - round(t_max / dt)) > 1e-6:
        raise AircraftError(
            f"t_max is {t_max:g} s; expected a whole number of time steps of {dt:g} s"
        )


def _check_vertical(vertical: Vertical) -> Vertical:
    """Return vertical limits as floats; refuse impossible ones."""
    vertical = Vertical(*map(float, vertical))
    names = ("climb_max", "descent_max", "vertical_acceleration", "vertical_separation")
    bounds = zip(names, LEAST_VERTICAL, vertical, GREATEST_VERTICAL, strict=True)
    for name, low, value, high in bounds:
        if not low <= value <= high:
            raise AircraftError(f"{name} is {value:g}; expected {low:g} to {high:g}")
    return vertical


def _check_vehicle(vehicle: Limits, limits: Limits) -> Limits:
    """Return a vehicle's limits as floats; refuse speeds that have none in common with others."""
    vehicle = _check_limits("vehicle: ", vehicle)
    if max(limits.speed_min, vehicle.speed_min) >= min(limits.speed_max, vehicle.speed_max):
        raise AircraftError(
            f"vehicle: flies {vehicle.speed_min:g} to {vehicle.speed_max:g} m/s; expected "
            f"speeds in common with {limits.speed_min:g} to {limits.speed_max:g} m/s"
        )
    return vehicle


def _check_limits(where: str, limits: Limits) -> Limits:
    """Return limits as floats; refuse impossible ones, with the place before the name."""
    limits = Limits(*map(float, limits))
    slow, fast, most = limits.speed_min, limits.speed_max, FASTEST.speed_max
    if not 0.0 <= slow < fast <= most:
        raise AircraftError(
            f"{where}speed_min, speed_max are {slow:g}, {fast:g} m/s; expected "
            f"0 <= min < max <= {most:g}"
        )
    for name, low, value, high in (
        ("acceleration_min", FASTEST.acceleration_min, limits.acceleration_min, -1e-4),
        ("acceleration_max", 1e-4, limits.acceleration_max, FASTEST.acceleration_max),
        ("yaw_rate_max", 1e-4, limits.yaw_rate_max, FASTEST.yaw_rate_max),
    ):
        if not low <= value <= high:
            raise AircraftError(f"{where}{name} is {value:g}; expected {low:g} to {high:g}")
    return limits


PAPER = new_aircraft(
    Limits(50.0, 100.0, -0.5, 0.5, math.radians(3.0)),
    1_000.0,
    vehicle=Limits(31.0, 100.0, -0.8, 0.5, math.radians(5.0)),
)
"""The paper's aircraft and task (its tables of limits, simulation parameters and reward); the
vehicle is the true one, to which the conservative limits leave a reserve.
"""
