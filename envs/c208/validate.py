"""The model against what is published: ``python -m envs.c208.validate``; exits with 1 if a
tolerance is missed.

Cruise is the level speed at which the drag equals the thrust of the stated shaft power, climb the
steady one at full power, the stall the slowest steady glide at idle, all equilibria of the JSBSim
aircraft. The modes are those of its linearisation, judged by level 1 of MIL-F-8785C (class I,
cruise), because no measured ones are published. What the aircraft does at idle, and how it climbs
over speeds and altitudes, is reported only: nothing reliable is published.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from commands.command import Parser, run_cli
from envs.c208.autopilot import TICK
from envs.c208.conditions import NOMINAL, Loading
from envs.c208.facts import FOOT, GRAVITY, POINTS, POUND, SLUG_PER_FT3, VARIANTS, Point
from envs.c208.fdm import STEP, Fdm
from envs.c208.guidance import LOOKAHEAD, Lookahead, height_to_hold
from envs.c208.point_mass import PointMassVehicle
from envs.c208.propulsion import DENSITY_0, HORSEPOWER, idle_thrust, maximum_thrust, thrust
from envs.c208.trim import REFERENCE_ALTITUDE, TrimError, solve
from envs.c208.vehicle import C208Vehicle
from envs.kinematics import VehicleState
from envs.profile import Profile, height_flown

KNOT = 0.514444  # m/s

_SPEEDS = (55.0, 75.0, 90.0)  # true, at which climbs are measured, m/s
_ALTITUDES = (500.0, REFERENCE_ALTITUDE, 4_000.0)  # m
_TURN = math.radians(5.0)  # rate of the sharpest turn that plans fly, rad/s
_RISE = 7.0  # m; moved so far, the altitude held has the autopilot demand 2.5 m/s
# Of plans (configs/aircraft/c208.yaml): m/s, m/s and m/s^2.
_CLIMB, _DESCENT, _CHANGE = 2.5, 3.0, 0.5


class Comparison(NamedTuple):
    """A figure of the model beside what it should be."""

    name: str
    model: float
    unit: str
    published: str = "-"
    tolerance: str = "-"
    use: str = "report"  # fit, check, or report for what is not judged
    met: bool = True  # whether the model is within the tolerance


class _Air:
    """An aircraft in the atmosphere that a point was measured in."""

    def __init__(self, point: Point) -> None:
        self.fdm = Fdm(point.variant, Loading(weight=point.weight, pod=point.pod))
        # A warmer column is higher in proportion: the pressure altitude is the point's.
        mean = 288.15 - 0.5 * 0.0065 * point.altitude * FOOT
        self.altitude = max(point.altitude * FOOT * (1.0 + point.temperature / mean), 200.0)
        self.fdm.set("atmosphere/delta-T", point.temperature * 1.8)
        solve(self.fdm, 70.0, self.altitude, throttle=1.0)
        self.density = _density(self.fdm)

    def true(self, calibrated: float) -> float:
        """Return the true airspeed of a calibrated one (compressibility is below 0.5 % here)."""
        return calibrated * math.sqrt(DENSITY_0 / self.density)


def _density(fdm: Fdm) -> float:
    return fdm.get("atmosphere/rho-slugs_ft3") * SLUG_PER_FT3


def measure(point: Point) -> float:
    """Return the model's figure for a published point, in the point's unit."""
    air = _Air(point)
    if point.quantity == "cruise":
        return _cruise(air, point.setting * HORSEPOWER) / KNOT
    if point.quantity == "climb":
        speed = air.true(point.setting * KNOT)
        climb = solve(air.fdm, speed, air.altitude, throttle=1.0)
        return speed * math.sin(climb.gamma) / (FOOT / 60.0)
    if point.quantity == "stall":
        return _stall(air, point.setting) * math.sqrt(air.density / DENSITY_0) / KNOT
    return _glide(air, point.setting)


def _bisect(low: float, high: float, is_beyond: Callable[[float], bool]) -> tuple[float, float]:
    """Return speeds 0.01 m/s apart between which a condition begins to hold."""
    while high - low > 0.01:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if is_beyond(middle) else (middle, high)
    return low, high


def _cruise(air: _Air, power: float) -> float:
    """Return the level true airspeed at which the drag takes a shaft power, m/s."""

    def wants_more(speed: float) -> bool:
        try:
            return solve(air.fdm, speed, air.altitude).thrust > thrust(power, speed, air.density)
        except TrimError:
            return True  # faster than full power allows

    return _bisect(60.0, 120.0, wants_more)[0]


def _stall(air: _Air, flaps: float) -> float:
    """Return the slowest true airspeed of a steady glide at idle, m/s."""

    def glides(speed: float) -> bool:
        try:
            solve(air.fdm, speed, air.altitude, throttle=0.0, flaps=flaps)
        except TrimError:
            return False
        return True

    return _bisect(20.0, 55.0, glides)[1]


def _glide(air: _Air, calibrated: float) -> float:
    """Return the glide ratio at a calibrated airspeed (kt), propeller feathered, as a share of the
    best one.
    """

    def ratio(knots: float) -> float:
        speed = air.true(knots * KNOT)
        idle, top = (
            thrust_of(air.fdm.variant, speed, air.density)
            for thrust_of in (idle_thrust, maximum_thrust)
        )
        # Feathered blades neither pull nor brake: the throttle at which the thrust is nothing.
        throttle = math.sqrt(max(float(idle / (idle - top)), 0.0))
        return -1.0 / math.tan(solve(air.fdm, speed, air.altitude, throttle=throttle).gamma)

    return ratio(calibrated) / max(ratio(float(knots)) for knots in range(85, 136, 3))


def _performance() -> Iterator[Comparison]:
    units = {"cruise": "KTAS", "climb": "ft/min", "stall": "KCAS", "glide": "of best"}
    for point in POINTS:
        figure = measure(point)
        off = figure - point.value
        if point.quantity == "glide":
            within = off >= 0.0
            tolerance = "at least"
        elif point.quantity == "stall":
            within = abs(off) <= point.tolerance
            tolerance = f"{point.tolerance:g} kt"
        else:
            within = abs(off) <= point.tolerance * point.value
            tolerance = f"{100.0 * point.tolerance:g} %"
        name = f"{point.quantity}: {point.name}, {point.altitude:.0f} ft"
        yield Comparison(
            name, figure, units[point.quantity], f"{point.value:g}", tolerance, point.use, within
        )


def modes(speed: float) -> dict[str, tuple[float, float]]:
    """Return the EX's modes of level flight at a true airspeed (m/s), reference altitude, by their
    names.

    Each is the undamped frequency, rad/s (of a real eigenvalue its size), and the damping ratio (1
    or -1).
    """
    # A throw-away executive: JSBSim's linearisation leaves the engine changed.
    fdm = Fdm()
    solve(fdm, speed)
    import jsbsim

    linear = jsbsim.FGLinearization(fdm.exec)
    names, matrix = list(linear.x_names), np.array(linear.system_matrix)

    def roots(*states: str) -> np.ndarray:
        index = [names.index(name) for name in states]
        return np.linalg.eigvals(matrix[np.ix_(index, index)])

    pitching = sorted(
        (root for root in roots("Vt", "Alpha", "Theta", "Q") if root.imag >= 0.0), key=abs
    )
    rolling = sorted(roots("Phi", "P", "Beta", "R"), key=abs)
    turning = [root for root in rolling if root.imag > 1e-6]
    single = [root for root in rolling if abs(root.imag) <= 1e-6]
    if len(turning) != 1 or len(single) != 2 or len(pitching) < 2:
        raise TrimError(f"the modes at {speed:g} m/s are not the five usual ones")
    by_name = {"phugoid": pitching[0], "short period": pitching[-1], "Dutch roll": turning[0]}
    by_name |= {"roll": single[-1], "spiral": single[0]}
    return {name: (abs(root), -root.real / abs(root)) for name, root in by_name.items()}


def _handling() -> Iterator[Comparison]:
    for speed in (55.0, 70.0, 90.0):

        def judge(
            name: str, figure: float, unit: str, limit: str, within: bool, level: str = "level 1"
        ) -> Comparison:
            at_speed = f"{name}, at {speed:.0f} m/s"  # noqa: B023
            return Comparison(at_speed, figure, unit, limit, level, "check", within)

        mode = modes(speed)
        (frequency, short), (dutch_frequency, dutch) = mode["short period"], mode["Dutch roll"]
        (roll_frequency, roll), (spiral_frequency, spiral) = mode["roll"], mode["spiral"]
        phugoid, lag = mode["phugoid"][1], 1.0 / roll_frequency
        doubling = math.log(2.0) / spiral_frequency if spiral < 0.0 else math.inf
        # Slower than 1.3 times the stall is no cruise: there the spiral is held to level 2.
        least, level = (8.0, "level 2") if speed < 60.0 else (20.0, "level 1")
        yield judge("short period: damping", short, "", "0.30 to 2.0", 0.30 <= short <= 2.0)
        yield judge("phugoid: damping", phugoid, "", "0.04", phugoid >= 0.04)
        yield judge("Dutch roll: damping", dutch, "", "0.08", dutch >= 0.08)
        yield judge(
            "Dutch roll: frequency", dutch_frequency, "rad/s", "0.4", dutch_frequency >= 0.4
        )
        yield judge("roll: time constant", lag, "s", "1.4", roll > 0.0 and lag <= 1.4)
        yield judge("spiral: time to double", doubling, "s", f"{least:g}", doubling >= least, level)
        yield Comparison(f"short period: frequency, at {speed:.0f} m/s", frequency, "rad/s")


def envelope(
    variant: str = "ex", loading: Loading = NOMINAL, altitude: float = REFERENCE_ALTITUDE
) -> list[tuple[float, float, float]]:
    """Return true airspeed (m/s) and the accelerations (m/s^2) that idle and full power give in
    level flight.

    Speeds without a level equilibrium at the altitude (m) are left out.
    """
    fdm = Fdm(variant, loading)
    mass = (loading.weight or fdm.variant.takeoff_weight) * POUND / GRAVITY
    rows = []
    for speed in range(44, 107, 2):
        try:
            needed = solve(fdm, float(speed), altitude)
        except TrimError:
            continue
        forces = (
            float(thrust_of(fdm.variant, speed, _density(fdm)))
            for thrust_of in (idle_thrust, maximum_thrust)
        )
        low, high = ((force - needed.thrust) * math.cos(needed.alpha) / mass for force in forces)
        rows.append((float(speed), low, high))
    return rows


def _idle() -> Iterator[Comparison]:
    for variant in VARIANTS:
        for speed, low, high in envelope(variant):
            if speed % 10.0 == 0.0:
                where = f"{variant}, {speed:.0f} m/s, {REFERENCE_ALTITUDE:.0f} m"
                yield Comparison(f"deceleration at idle: {where}", low, "m/s2")
                yield Comparison(f"acceleration, full power: {where}", high, "m/s2")


def climb_range(
    speed: float, altitude: float = REFERENCE_ALTITUDE, *, yaw_rate: float = 0.0
) -> tuple[float, float]:
    """Return the steady climbs of the EX, m/s, at idle (negative) and at full power.

    Straight they are equilibria of the JSBSim aircraft; in a turn (rad/s) they follow from its
    stored drag and its thrust.

    Args:
        speed: true airspeed, m/s.
        altitude: m.
        yaw_rate: rad/s.
    """
    if yaw_rate == 0.0:
        fdm = Fdm()
        slopes = (solve(fdm, speed, altitude, throttle=share).gamma for share in (0.0, 1.0))
        low, high = (speed * math.sin(slope) for slope in slopes)
    else:
        vehicle = PointMassVehicle(VehicleState(0.0, 0.0, 0.0, speed), altitude=altitude)
        vehicle.bank = math.atan(speed * yaw_rate / GRAVITY)
        low, high = (speed * along / GRAVITY for along in vehicle.reach())
    return low, high


def climb_acceleration(speed: float, rise: float, yaw_rate: float = 0.0) -> float:
    """Return the greatest mean vertical acceleration of a second, m/s^2, towards an altitude that
    the autopilot is to hold and that moves at once.

    Args:
        speed: true airspeed, m/s.
        rise: of the altitude, m.
        yaw_rate: of the turn that is flown, rad/s.
    """
    vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, speed))
    vehicle.step(0.0, yaw_rate, 10.0)
    vehicle.autopilot.altitude += rise
    climbs = []
    for _ in range(round(5.0 / TICK)):
        vehicle.step(0.0, yaw_rate, TICK)
        climbs.append(vehicle.measured.climb)
    second = round(1.0 / TICK)
    return float(np.max(np.sign(rise) * np.subtract(climbs[second:], climbs[:-second])))


def profile_error(speed: float, yaw_rate: float = 0.0, gains: Lookahead = LOOKAHEAD) -> float:
    """Return how far the aircraft leaves a profile at most, m, that climbs and descends as plans
    may, and turns from the one to the other.

    Args:
        speed: true airspeed, m/s.
        yaw_rate: of the turn that is flown, rad/s.
        gains: how far ahead the climb is looked up.
    """
    vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, speed))
    vehicle.step(0.0, yaw_rate, 10.0)
    top = REFERENCE_ALTITUDE + 40.0 * _CLIMB
    altitudes = REFERENCE_ALTITUDE, REFERENCE_ALTITUDE, top, top - 40.0 * _DESCENT
    profile = Profile(np.array([0.0, 10.0, 50.0, 90.0]), np.array(altitudes))
    errors = []
    for period in range(round(90.0 / TICK)):
        time = period * TICK
        vehicle.hold(height_to_hold(profile, _CHANGE, time, gains))
        vehicle.step(0.0, yaw_rate, TICK)
        errors.append(
            vehicle.height.altitude - height_flown(profile, _CHANGE, time + TICK).altitude
        )
    return float(np.max(np.abs(errors)))


def _climbs() -> Iterator[Comparison]:
    flights = [(speed, altitude, 0.0) for altitude in _ALTITUDES for speed in _SPEEDS]
    flights += [(speed, REFERENCE_ALTITUDE, _TURN) for speed in _SPEEDS]
    for speed, altitude, yaw_rate in flights:
        low, high = climb_range(speed, altitude, yaw_rate=yaw_rate)
        where = f"{speed:.0f} m/s, {altitude:.0f} m{', in a turn' if yaw_rate else ''}"
        yield Comparison(f"climb at full power: {where}", high, "m/s")
        yield Comparison(f"climb at idle: {where}", low, "m/s")
    for speed in _SPEEDS:
        for rise, way in ((_RISE, "up"), (-_RISE, "down")):
            figure = climb_acceleration(speed, rise, _TURN)
            yield Comparison(f"acceleration {way}: {speed:.0f} m/s, in a turn", figure, "m/s2")
    for speed in _SPEEDS:
        for yaw_rate, where in ((0.0, ""), (_TURN, ", in a turn")):
            figure = profile_error(speed, yaw_rate)
            yield Comparison(f"off a profile: {speed:.0f} m/s{where}", figure, "m")


def _spool() -> Iterator[Comparison]:
    for variant in VARIANTS:
        fdm = Fdm(variant)
        solve(fdm, 60.0, throttle=0.0)
        # In the first step after its initial conditions JSBSim's turbine takes the throttle's place
        # at once.
        fdm.exec.run()
        fdm.set("fcs/throttle-cmd-norm", 1.0)
        steps = 0
        # Thrust grows with the square of the spool's share of its range.
        while ((fdm.get("propulsion/engine/n2") - 60.0) / 40.0) ** 2 < 0.95 and steps * STEP < 20.0:
            fdm.exec.run()
            steps += 1
        figure, name = steps * STEP, f"engine: idle to 95 % of power, {variant}"
        yield Comparison(name, figure, "s", "5", "14 CFR 33", "check", figure <= 5.0)


def main() -> int:
    """Print the comparison; return the exit code."""
    Parser(prog="python -m envs.c208.validate", description=__doc__).parse_args()
    print(f"{'':58}{'model':>9} {'published':>11} {'unit':8}{'tolerance':>10} {'use':7}")
    missed = 0
    for row in (*_performance(), *_spool(), *_handling(), *_idle(), *_climbs()):
        mark = "" if row.met else "  MISSED"
        print(
            f"{row.name:58}{row.model:9.3f} {row.published:>11} {row.unit:8}{row.tolerance:>10} "
            f"{row.use:7}{mark}"
        )
        missed += not row.met
    checks = sum(point.use == "check" for point in POINTS)
    print(
        f"{missed} tolerances missed; {checks} of the {len(POINTS)} published points were not "
        "used in the fit"
    )
    return 1 if missed else 0


if __name__ == "__main__":
    run_cli(main)
