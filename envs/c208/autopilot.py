"""The autopilot of the true aircraft: roll, yaw, pitch and speed, 20 times a second.

Every loop is a model followed by feedback: what the aircraft must do for the demand is computed
from the facts and the stored equilibria, and gains act on what is left. An equilibrium depends on
the lift coefficient alone, so that one table serves every weight W, load factor n and density rho:
at speed V it is read at V sqrt(rho / rho_0 W_0 / (n W)), and its thrust is scaled by n W / W_0.

Demands are those of an observer that moves with the air: an acceleration along the flight path and
one across it.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.c208.conditions import Loading
from envs.c208.facts import FOOT, GRAVITY, Variant, value
from envs.c208.model import stall_angle
from envs.c208.propulsion import DENSITIES, DENSITY_0, SPEEDS, Curve, density_at, tables
from envs.c208.trim import REFERENCE_ALTITUDE, REFERENCE_WEIGHT, Trim, level_curve

TICK = 0.05  # period, s
BANK_MAX, CLIMB_MAX = math.radians(45.0), 5.0  # rad, and m/s back to the altitude
_SLUG_FT2 = 1.35581795  # kg m^2

# Roll: the bank follows its demand as an oscillator of this frequency (rad/s) and damping does.
_ROLL_FREQUENCY, _ROLL_DAMPING = 3.0, 0.9
_ROLL_SHARE = 0.75  # of the roll rate that full aileron sustains
_ROLL_ACCELERATION = 1.2  # rad/s^2
ROLL_DELAY = 2.0 * _ROLL_DAMPING / _ROLL_FREQUENCY + 0.10
"""How much later than demanded a bank is flown, s: the oscillator's delay, the servos' and half a
period.
"""

_ALPHA_MARGIN = math.radians(3.0)  # below the stall's angle of attack
# Times the stall's speed at the present load: held by thrust, then by giving up altitude. Gusts add
# to both.
_SLOWEST, _FLOOR = 1.08, 1.04
_GUST_SHARE, _GUST_LAG = 1.5, 20.0  # times their mean size, which is taken over so many seconds


class Measured(NamedTuple):
    """What the autopilot sees; body axes x forward, y right, z down."""

    bank: float  # rad
    pitch: float
    roll_rate: float  # rad/s
    pitch_rate: float
    yaw_rate: float
    alpha: float  # angle of attack, rad
    beta: float  # sideslip, rad
    airspeed: float  # true, gusts included, m/s
    steady_airspeed: float  # that of the flight path against the slowly varying wind, m/s
    altitude: float  # m
    climb: float  # m/s
    density: float  # kg/m^3
    weight: float  # N
    spool: float  # share of its range between idle and full


class Controls(NamedTuple):
    """Surface deflections, rad, and throttle, 0 to 1."""

    elevator: float
    aileron: float
    rudder: float
    throttle: float


class Autopilot:
    """Holds an altitude (m) in air of a density (kg/m^3) and flies demanded accelerations.

    It remembers integrals, filters and servos and takes over in the equilibrium ``begin``.
    """

    def __init__(
        self, variant: Variant, loading: Loading, altitude: float, density: float, begin: Trim
    ) -> None:
        self.altitude = altitude
        """Held, m; it may move."""
        self.climb = 0.0
        """Flown beside what leads back to the altitude, m/s."""
        self._alpha, self._elevator, self._thrust = map(
            level_curve, ("alpha", "elevator", "thrust")
        )
        self._density_0 = density_at(REFERENCE_ALTITUDE)
        # Both tables of thrust at the present density, over the speed.
        thrusts_here = [
            np.array([np.interp(density, DENSITIES, row) for row in thrusts])
            for thrusts in tables(variant)
        ]
        self._idle, self._top = (Curve(SPEEDS, thrust, 20.0) for thrust in thrusts_here)

        self._area, self._span = value("wing_area") * FOOT**2, value("wing_span") * FOOT
        self._chord = value("mean_chord") * 0.0254
        weight = loading.weight or variant.takeoff_weight
        self._inertia = value("inertia_roll") * _SLUG_FT2 * weight / value("inertia_weight")
        self._stall_angle = stall_angle()
        self._top_lift = value("lift_max") - 0.06
        self._speed_max = value("speed_max_operating") * 0.514444

        self.bank_reference = self._roll_reference = 0.0
        self._aileron_integral = self._rudder_integral = self._elevator_integral = 0.0
        self._climb_integral = self._thrust_integral = 0.0
        self.speed_reference = begin.speed
        self.reach = (-1.0, 1.0)
        """Accelerations along the path that idle and full power gave in the last period, m/s^2."""
        self._gust, self._load_wanted = 0.0, 1.0
        self._servos = [begin.elevator, 0.0, 0.0]
        aileron, rudder = math.radians(value("aileron")), math.radians(value("rudder"))
        self._low = (-math.radians(value("elevator_up")), -aileron, -rudder)
        self._high = (math.radians(value("elevator_down")), aileron, rudder)
        self._servo_share = 1.0 - math.exp(-value("servo_bandwidth") * TICK)
        self._servo_step = math.radians(value("servo_rate")) * TICK

    def stall_speed(self, measured: Measured) -> float:
        """Return the true airspeed of the stall in level flight, m/s."""
        return math.sqrt(2.0 * measured.weight / (measured.density * self._area * self._top_lift))

    def fly(self, measured: Measured, along_demand: float, left_demand: float) -> Controls:
        """Return the controls for the coming period.

        Demanded are accelerations along the path through the air and to its left, m/s^2.
        """
        m = measured
        speed = max(m.airspeed, 30.0)
        pressure = 0.5 * m.density * speed * speed
        self._gust += (abs(m.airspeed - m.steady_airspeed) - self._gust) * TICK / _GUST_LAG
        stall = self.stall_speed(m) + _GUST_SHARE * self._gust
        aileron, rudder = self._lateral(m, left_demand, speed, pressure, stall)
        load = 1.0 / max(math.cos(self.bank_reference), 0.5)
        equivalent = speed * math.sqrt(
            m.density / self._density_0 * REFERENCE_WEIGHT / (load * m.weight)
        )
        elevator = self._vertical(m, load, speed, equivalent, stall)
        throttle = self._speed(m, along_demand, load, equivalent, stall)
        for index, demand in enumerate((elevator, aileron, rudder)):
            step = _clamp((demand - self._servos[index]) * self._servo_share, self._servo_step)
            self._servos[index] = max(
                self._low[index], min(self._high[index], self._servos[index] + step)
            )
        elevator, aileron, rudder = self._servos
        return Controls(elevator, aileron, rudder, throttle)

    def _bank_demand(self, left_demand: float, speed: float, stall: float) -> float:
        """Return the bank that gives an acceleration across the path, as far as the wing bears it,
        rad.
        """
        # The load that the wing can carry with the margin to the stall bounds the bank.
        load_max = max(1.02, (speed / (_FLOOR * stall)) ** 2)
        bank_max = min(BANK_MAX, math.acos(1.0 / load_max))
        wanted_bank = _clamp(-math.atan(left_demand / GRAVITY), BANK_MAX)
        # What the turn needs to be flown is the speed's business too.
        self._load_wanted = 1.0 / math.cos(wanted_bank)
        return _clamp(wanted_bank, bank_max)

    def _move_bank_reference(self, demand: float, half_turn: float) -> float:
        """Move the bank's reference towards a demand for a period; return the roll acceleration
        that it takes, rad/s^2.
        """
        rate_max = (
            _ROLL_SHARE * value("roll_aileron") * self._high[1] / (-value("roll_rate") * half_turn)
        )
        acceleration = _ROLL_FREQUENCY**2 * (demand - self.bank_reference)
        acceleration -= 2.0 * _ROLL_DAMPING * _ROLL_FREQUENCY * self._roll_reference
        acceleration = _clamp(acceleration, _ROLL_ACCELERATION)
        rate = _clamp(self._roll_reference + acceleration * TICK, rate_max)
        acceleration = (rate - self._roll_reference) / TICK
        self.bank_reference += 0.5 * (rate + self._roll_reference) * TICK
        self._roll_reference = rate
        return acceleration

    def _lateral(
        self, m: Measured, left_demand: float, speed: float, pressure: float, stall: float
    ) -> tuple[float, float]:
        """Return the demanded aileron and rudder, rad."""
        half_turn = 0.5 * self._span / speed  # s: times a rate it makes the model's coefficients
        demand = self._bank_demand(left_demand, speed, stall)
        acceleration = self._move_bank_reference(demand, half_turn)
        rate = self._roll_reference

        turn = GRAVITY / speed * math.tan(self.bank_reference)
        error = self.bank_reference - m.bank
        roll_rate_demand = rate + 2.0 * error - turn * math.sin(m.pitch)
        moment = pressure * self._area * self._span
        lift = m.weight / (pressure * self._area * max(math.cos(m.bank), 0.5))
        yaw_rate_demand = turn * math.cos(self.bank_reference)
        self._aileron_integral = _clamp(self._aileron_integral + 0.25 * error * TICK, 0.1)
        balance = (
            acceleration * self._inertia / moment
            - value("roll_rate") * roll_rate_demand * half_turn
        )
        balance -= value("roll_yaw_rate") * lift * yaw_rate_demand * half_turn
        damping = 3.0 * (roll_rate_demand - m.roll_rate) * self._inertia / moment
        aileron = (balance + damping) / value("roll_aileron") + self._aileron_integral

        self._rudder_integral = _clamp(self._rudder_integral - 0.25 * m.beta * TICK, 0.15)
        yawing = (
            value("yaw_rate") * yaw_rate_demand + value("yaw_roll_rate") * lift * roll_rate_demand
        ) * half_turn
        yawing += value("yaw_aileron") * lift * aileron
        rudder = -yawing / value("yaw_rudder") - 1.0 * (yaw_rate_demand - m.yaw_rate)
        return aileron, rudder - 0.4 * m.beta + self._rudder_integral

    def _vertical(
        self, m: Measured, load: float, speed: float, equivalent: float, stall: float
    ) -> float:
        """Return the demanded elevator, rad, that holds the altitude."""
        height = self.altitude - m.altitude
        climb = self.climb + _clamp(0.35 * height, CLIMB_MAX)
        floor = _FLOOR * stall * math.sqrt(load)
        if m.steady_airspeed < floor:
            climb = min(climb, -1.5 * (floor - m.steady_airspeed))
        else:
            self._climb_integral = _clamp(self._climb_integral + 0.03 * height * TICK, 1.0)
        alpha = self._alpha(equivalent)
        pitch_demand = (
            climb + self._climb_integral + 0.5 * (climb - m.climb)
        ) / speed + alpha * math.cos(m.bank)
        # Never more than what brings the angle of attack to its limit.
        limit = self._stall_angle - _ALPHA_MARGIN
        pitch_demand = min(pitch_demand, m.pitch + limit - m.alpha)
        cosine = max(math.cos(m.bank), 0.5)
        turning = GRAVITY / speed * math.tan(m.bank) * math.sin(m.bank)
        rate = 1.5 * (pitch_demand - m.pitch) / cosine + turning
        rate = min(rate, 3.0 * (limit - m.alpha) + turning)
        error = rate - m.pitch_rate
        self._elevator_integral = _clamp(self._elevator_integral - 0.4 * error * TICK, 0.2)
        steady = self._elevator(equivalent)
        steady -= value("pitch_rate") * rate * 0.5 * self._chord / speed / value("pitch_elevator")
        gain = 0.5 * (70.0 / speed) ** 2
        return steady - gain * error + self._elevator_integral

    def _speed(
        self, m: Measured, along: float, load: float, equivalent: float, stall: float
    ) -> float:
        """Return the demanded throttle, 0 to 1, that gives an acceleration along the path."""
        slow = _SLOWEST * stall * math.sqrt(max(load, self._load_wanted))
        fast = self._speed_max * math.sqrt(DENSITY_0 / m.density)
        reference = self.speed_reference + along * TICK
        # The reference may not run away from an aircraft that is at the end of its power.
        reference = max(m.steady_airspeed - 1.5, min(m.steady_airspeed + 1.5, reference))
        reference = max(slow, min(fast, reference))
        self.speed_reference = reference
        error = reference - m.steady_airspeed
        mass = m.weight / GRAVITY
        acceleration = min(along + 1.0 * error, 0.5 * (fast - m.steady_airspeed))
        if m.steady_airspeed < slow:
            acceleration = max(acceleration, 0.5 * (slow - m.steady_airspeed))
        drag = self._thrust(equivalent) * load * m.weight / REFERENCE_WEIGHT
        bias = GRAVITY * m.climb / max(m.airspeed, 30.0) + self._thrust_integral
        thrust = mass * (acceleration + bias) + drag
        idle, top = self._idle(m.airspeed), self._top(m.airspeed)
        self.reach = (idle - drag) / mass - bias, (top - drag) / mass - bias
        share = (thrust - idle) / (top - idle)
        if 0.0 < share < 1.0:
            self._thrust_integral = _clamp(self._thrust_integral + 0.10 * error * TICK, 0.3)
        root = math.sqrt(max(0.0, min(1.0, share)))
        # The spool follows with a lag of a second; half of it is anticipated.
        return max(0.0, min(1.0, root + 1.0 * (root - m.spool)))


def _clamp(number: float, most: float) -> float:
    return max(-most, min(most, number))
