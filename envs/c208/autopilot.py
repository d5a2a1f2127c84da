"""The autopilot of the true aircraft: roll, yaw, pitch and speed, 20 times a second.

Every loop is a model followed by feedback: what the aircraft must do for the demand is computed from the facts and the
stored equilibria, and gains act on what is left. An equilibrium depends on the lift coefficient alone, so that one
table serves every weight W, load factor n and density rho: at speed V it is read at V sqrt(rho / rho_0 W_0 / (n W)),
and its thrust is scaled by n W / W_0.

Demands are those of an observer that moves with the air: an acceleration along the flight path and one across it.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.c208.aerodynamics import stall_angle
from envs.c208.conditions import Loading
from envs.c208.curve import Curve
from envs.c208.facts import Variant, value
from envs.c208.propulsion import DENSITIES, SPEEDS, tables
from envs.c208.trim import REFERENCE_ALTITUDE, stored

__all__ = ["GRAVITY", "ROLL_DELAY", "TICK", "Autopilot", "Controls", "Measured"]

TICK = 0.05
"""Period, s."""

GRAVITY = 9.80665

_POUND, _FOOT = 4.4482216, 0.3048
_SLUG_FT2 = 1.35581795  # kg m^2

# Roll: the bank follows its demand as an oscillator of this frequency (rad/s) and damping does.
_ROLL_FREQUENCY, _ROLL_DAMPING = 3.0, 0.9
_ROLL_SHARE = 0.75  # of the roll rate that full aileron sustains
_ROLL_ACCELERATION = 1.2  # rad/s^2
ROLL_DELAY = 2.0 * _ROLL_DAMPING / _ROLL_FREQUENCY + 0.10
"""How much later than demanded a bank is flown, s: the oscillator's delay, the servos' and half a period."""

_BANK_MAX = math.radians(45.0)
_CLIMB_MAX = 5.0  # m/s
_ALPHA_MARGIN = math.radians(3.0)  # below the stall's angle of attack
# Times the stall's speed at the present load: held by thrust, then by giving up altitude. Gusts add to both.
_SLOWEST, _FLOOR = 1.08, 1.04
_GUST_SHARE, _GUST_LAG = 1.5, 20.0  # times their mean size, which is taken over so many seconds


class Measured(NamedTuple):
    """What the autopilot sees; SI units and radians, body axes x forward, y right, z down."""

    bank: float
    pitch: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    alpha: float
    beta: float
    airspeed: float
    """True airspeed, gusts included, m/s."""
    steady_airspeed: float
    """Of the flight path against the slowly varying wind, m/s."""
    altitude: float
    climb: float
    """m/s."""
    density: float
    weight: float
    """N."""
    spool: float
    """Share of the range between idle and full, 0 to 1."""


class Controls(NamedTuple):
    """Surface deflections, rad, and throttle, 0 to 1."""

    elevator: float
    aileron: float
    rudder: float
    throttle: float


class Autopilot:
    """Holds an altitude and flies demanded accelerations; remembers integrals, filters and servos.

    Args:
        variant: of the aircraft.
        loading: as believed by the autopilot; weight is measured, the rest nominal.
        altitude: to hold, m.
        density: of the air there, kg/m^3.
    """

    def __init__(self, variant: Variant, loading: Loading, altitude: float, density: float) -> None:
        self._altitude = altitude
        table = stored()
        reach = float(table.speed[0]), float(table.speed[-1])
        self._alpha = Curve(table.speed, table.alpha, *reach)
        self._elevator = Curve(table.speed, table.elevator, *reach)
        self._thrust = Curve(table.speed, table.thrust, *reach)
        self._table_low = reach[0]
        self._weight_0 = 8807.0 * _POUND
        self._density_0 = 1.225 * (1.0 - 0.0065 * REFERENCE_ALTITUDE / 288.15) ** 4.25588
        idle, top = tables(variant)
        at = [np.array([np.interp(density, DENSITIES, row) for row in table_]) for table_ in (idle, top)]
        self._idle = Curve(SPEEDS, at[0], 20.0, 130.0)
        self._top = Curve(SPEEDS, at[1], 20.0, 130.0)

        self._area, self._span = value("wing_area") * _FOOT**2, value("wing_span") * _FOOT
        self._chord = value("mean_chord") * 0.0254
        weight = loading.weight or variant.takeoff_weight
        self._inertia = value("inertia_roll") * _SLUG_FT2 * weight / value("inertia_weight")
        self._stall_angle = stall_angle()
        self._top_lift = value("lift_max") - 0.06
        self._speed_max = value("speed_max_operating") * 0.514444

        self.bank_reference = 0.0
        self._roll_reference = 0.0
        self._aileron_integral = self._rudder_integral = self._elevator_integral = 0.0
        self._climb_integral = self._thrust_integral = 0.0
        self.speed_reference: float | None = None
        self.reach = (-1.0, 1.0)
        """Accelerations along the path that idle and full power gave in the last period, m/s^2."""
        self._gust, self._load_wanted = 0.0, 1.0
        self._servos = [0.0, 0.0, 0.0]
        aileron, rudder = math.radians(value("aileron")), math.radians(value("rudder"))
        self._low = (-math.radians(value("elevator_up")), -aileron, -rudder)
        self._high = (math.radians(value("elevator_down")), aileron, rudder)
        self._servo_share = 1.0 - math.exp(-value("servo_bandwidth") * TICK)
        self._servo_step = math.radians(value("servo_rate")) * TICK

    def begin(self, bank: float, elevator: float, speed: float) -> None:
        """Take over in an equilibrium."""
        self.bank_reference, self._roll_reference = bank, 0.0
        self.speed_reference = speed
        self._servos = [elevator, 0.0, 0.0]

    def stall_speed(self, measured: Measured, load: float = 1.0) -> float:
        """Return the true airspeed of the stall at a load factor, m/s."""
        return math.sqrt(2.0 * load * measured.weight / (measured.density * self._area * self._top_lift))

    def fly(self, measured: Measured, along: float, left: float) -> Controls:
        """Return the controls for the coming period.

        Args:
            measured: the aircraft now.
            along: acceleration demanded along the flight path through the air, m/s^2.
            left: acceleration demanded across it, horizontal, m/s^2.
        """
        m = measured
        speed = max(m.airspeed, 30.0)
        pressure = 0.5 * m.density * speed * speed
        self._gust += (abs(m.airspeed - m.steady_airspeed) - self._gust) * TICK / _GUST_LAG
        stall = self.stall_speed(m) + _GUST_SHARE * self._gust
        aileron, rudder = self._lateral(m, left, speed, pressure, stall)
        load = 1.0 / max(math.cos(self.bank_reference), 0.5)
        equivalent = speed * math.sqrt(m.density / self._density_0 * self._weight_0 / (load * m.weight))
        elevator = self._vertical(m, load, speed, equivalent, stall)
        throttle = self._speed(m, along, load, equivalent, stall)
        demands = (elevator, aileron, rudder)
        for index, demand in enumerate(demands):
            step = (demand - self._servos[index]) * self._servo_share
            step = max(-self._servo_step, min(self._servo_step, step))
            self._servos[index] = max(self._low[index], min(self._high[index], self._servos[index] + step))
        return Controls(self._servos[0], self._servos[1], self._servos[2], throttle)

    def _lateral(self, m: Measured, left: float, speed: float, pressure: float, stall: float) -> tuple[float, float]:
        # The load that the wing can carry with the margin to the stall bounds the bank.
        load_max = max(1.02, (speed / (_FLOOR * stall)) ** 2)
        bank_max = min(_BANK_MAX, math.acos(1.0 / load_max))
        wanted_bank = max(-_BANK_MAX, min(_BANK_MAX, -math.atan(left / GRAVITY)))
        # What the turn needs to be flown is the speed's business too.
        self._load_wanted = 1.0 / math.cos(wanted_bank)
        demand = max(-bank_max, min(bank_max, wanted_bank))

        half_turn = 0.5 * self._span / speed
        rate_max = _ROLL_SHARE * value("roll_aileron") * self._high[1] / (-value("roll_rate") * half_turn)
        acceleration = _ROLL_FREQUENCY**2 * (demand - self.bank_reference)
        acceleration -= 2.0 * _ROLL_DAMPING * _ROLL_FREQUENCY * self._roll_reference
        acceleration = max(-_ROLL_ACCELERATION, min(_ROLL_ACCELERATION, acceleration))
        rate = max(-rate_max, min(rate_max, self._roll_reference + acceleration * TICK))
        acceleration = (rate - self._roll_reference) / TICK
        self.bank_reference += 0.5 * (rate + self._roll_reference) * TICK
        self._roll_reference = rate

        turn = GRAVITY / speed * math.tan(self.bank_reference)
        error = self.bank_reference - m.bank
        wanted = rate + 2.0 * error - turn * math.sin(m.pitch)
        moment = pressure * self._area * self._span
        lift = m.weight / (pressure * self._area * max(math.cos(m.bank), 0.5))
        wanted_yaw = turn * math.cos(self.bank_reference)
        self._aileron_integral = max(-0.1, min(0.1, self._aileron_integral + 0.25 * error * TICK))
        balance = acceleration * self._inertia / moment - value("roll_rate") * wanted * half_turn
        balance -= value("roll_yaw_rate") * lift * wanted_yaw * half_turn
        damping = 3.0 * (wanted - m.roll_rate) * self._inertia / moment
        aileron = (balance + damping) / value("roll_aileron") + self._aileron_integral

        self._rudder_integral = max(-0.15, min(0.15, self._rudder_integral - 0.25 * m.beta * TICK))
        yawing = (value("yaw_rate") * wanted_yaw + value("yaw_roll_rate") * lift * wanted) * half_turn
        yawing += value("yaw_aileron") * lift * aileron
        rudder = -yawing / value("yaw_rudder") - 1.0 * (wanted_yaw - m.yaw_rate)
        return aileron, rudder - 0.4 * m.beta + self._rudder_integral

    def _vertical(self, m: Measured, load: float, speed: float, equivalent: float, stall: float) -> float:
        height = self._altitude - m.altitude
        climb = max(-_CLIMB_MAX, min(_CLIMB_MAX, 0.35 * height))
        floor = _FLOOR * stall * math.sqrt(load)
        if m.steady_airspeed < floor:
            climb = min(climb, -1.5 * (floor - m.steady_airspeed))
        else:
            self._climb_integral = max(-1.0, min(1.0, self._climb_integral + 0.03 * height * TICK))
        alpha = self._alpha(equivalent)
        wanted = (climb + self._climb_integral + 0.5 * (climb - m.climb)) / speed + alpha * math.cos(m.bank)
        # Never more than what brings the angle of attack to its limit.
        limit = self._stall_angle - _ALPHA_MARGIN
        wanted = min(wanted, m.pitch + limit - m.alpha)
        cosine = max(math.cos(m.bank), 0.5)
        turning = GRAVITY / speed * math.tan(m.bank) * math.sin(m.bank)
        rate = 1.5 * (wanted - m.pitch) / cosine + turning
        rate = min(rate, 3.0 * (limit - m.alpha) + turning)
        error = rate - m.pitch_rate
        self._elevator_integral = max(-0.2, min(0.2, self._elevator_integral - 0.4 * error * TICK))
        steady = self._elevator(equivalent)
        steady -= value("pitch_rate") * rate * 0.5 * self._chord / speed / value("pitch_elevator")
        gain = 0.5 * (70.0 / speed) ** 2
        return steady - gain * error + self._elevator_integral

    def _speed(self, m: Measured, along: float, load: float, equivalent: float, stall: float) -> float:
        slow = _SLOWEST * stall * math.sqrt(max(load, self._load_wanted))
        fast = self._speed_max * math.sqrt(1.225 / m.density)
        reference = m.steady_airspeed if self.speed_reference is None else self.speed_reference
        reference += along * TICK
        # The reference may not run away from an aircraft that is at the end of its power.
        reference = max(m.steady_airspeed - 1.5, min(m.steady_airspeed + 1.5, reference))
        reference = max(slow, min(fast, reference))
        self.speed_reference = reference
        error = reference - m.steady_airspeed
        mass = m.weight / GRAVITY
        acceleration = min(along + 1.0 * error, 0.5 * (fast - m.steady_airspeed))
        if m.steady_airspeed < slow:
            acceleration = max(acceleration, 0.5 * (slow - m.steady_airspeed))
        drag = self._thrust(equivalent) * load * m.weight / self._weight_0
        bias = GRAVITY * m.climb / max(m.airspeed, 30.0) + self._thrust_integral
        thrust = mass * (acceleration + bias) + drag
        idle, top = self._idle(m.airspeed), self._top(m.airspeed)
        self.reach = (idle - drag) / mass - bias, (top - drag) / mass - bias
        share = (thrust - idle) / (top - idle)
        if 0.0 < share < 1.0:
            self._thrust_integral = max(-0.3, min(0.3, self._thrust_integral + 0.10 * error * TICK))
        root = math.sqrt(max(0.0, min(1.0, share)))
        # The spool follows with a lag of a second; half of it is anticipated.
        return max(0.0, min(1.0, root + 1.0 * (root - m.spool)))
