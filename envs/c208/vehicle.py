"""The true aircraft as a vehicle: the Cessna 208B in JSBSim under its autopilot, in the local
frame.

Physics at 60 Hz, autopilot at 20 Hz. The local frame is that of :mod:`envs.kinematics`: x east and
y north in metres, from longitudes and latitudes at the equator, scaled at the flight's altitude; at
40 km from its origin it is true to a metre. Every period the flight is checked; one that fails
raises :class:`FlightError` with its reason.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.arrays import Array
from envs.c208.air_mass import air_demands
from envs.c208.autopilot import TICK, Autopilot, Measured
from envs.c208.conditions import CALM, TURBULENCE, Conditions, check_start
from envs.c208.facts import FOOT, POUND, SLUG_PER_FT3, value
from envs.c208.fdm import STEP, Fdm
from envs.c208.flightgear import FlightGear
from envs.c208.trim import REFERENCE_ALTITUDE, TrimError, solve, surfaces
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import Height
from envs.wind import Wind

_EQUATOR = 6_378_137.0  # radius of curvature along the equator, m (WGS 84)
_MERIDIAN = 6_335_439.3  # radius of curvature along a meridian at the equator, m (WGS 84)
_SUBSTEPS = round(TICK / STEP)
_WIND_LAG = 10.0  # of the autopilot's estimate of the wind, s
_LEAD_IN = 20.0  # flown before the start, so that no transient of the initial state is left, s


class _Row(NamedTuple):
    """The flight after a period of the autopilot; SI units and radians."""

    time: float
    x: float
    y: float
    altitude: float
    heading: float
    speed: float
    airspeed: float
    bank: float
    alpha: float
    beta: float
    throttle: float


LOG_COLUMNS = _Row._fields
"""Of :meth:`C208Vehicle.log`; SI units and radians."""


class _Readings(NamedTuple):
    """What is read of the flight dynamics model after each period, in the units of its names."""

    bank: float
    pitch: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    alpha: float
    beta: float
    airspeed: float
    altitude: float
    climb: float
    density: float
    weight: float
    spool: float
    east: float
    north: float
    longitude: float
    latitude: float
    wind_east: float
    wind_north: float


_PROPERTIES = {
    "bank": "attitude/phi-rad",
    "pitch": "attitude/theta-rad",
    "roll_rate": "velocities/p-rad_sec",
    "pitch_rate": "velocities/q-rad_sec",
    "yaw_rate": "velocities/r-rad_sec",
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "airspeed": "velocities/vt-fps",
    "altitude": "position/h-sl-ft",
    "climb": "velocities/h-dot-fps",
    "density": "atmosphere/rho-slugs_ft3",
    "weight": "inertia/weight-lbs",
    "spool": "propulsion/engine/n2",
    "east": "velocities/v-east-fps",
    "north": "velocities/v-north-fps",
    "longitude": "position/long-gc-rad",
    "latitude": "position/lat-geod-rad",
    "wind_east": "atmosphere/total-wind-east-fps",
    "wind_north": "atmosphere/total-wind-north-fps",
}
"""Where JSBSim's tree of properties holds the readings."""


class FlightError(RuntimeError):
    """The flight cannot go on; the message says why and when."""


class StartError(FlightError):
    """The flight cannot begin: the aircraft would be too slow or too fast through the air."""


class C208Vehicle:
    """One flight of the true aircraft; satisfies :class:`envs.follower.Vehicle`.

    Commands over the ground are reached with the lags of engine and roll, for which
    :mod:`envs.c208.guidance` looks ahead. ``state`` is that over the ground now, ``measured`` what
    the autopilot sees. Before the given state 20 s are flown, which are not part of the flight.
    ``altitude`` is held, m above the sea, until :meth:`hold` says another; a viewer shows the
    flight from its start on.

    Raises:
        StartError: the aircraft cannot fly so slowly or so fast at the start.
        FlightError: it does not survive the time before the start.
        FdmError: the variant is unknown, or a JSBSim file is missing.
        ValueError: a condition is none.
    """

    def __init__(
        self,
        state: VehicleState[Ground],
        variant: str = "ex",
        conditions: Conditions = CALM,
        altitude: float = REFERENCE_ALTITUDE,
        viewer: FlightGear | None = None,
    ) -> None:
        self._variant, self._viewer = variant, viewer
        self.reset(state, conditions, altitude)

    def reset(
        self,
        state: VehicleState[Ground],
        conditions: Conditions = CALM,
        altitude: float = REFERENCE_ALTITUDE,
    ) -> None:
        """Begin another flight; as the constructor does, to the last bit.

        JSBSim keeps the past of its gusts and the rounding of its angles over a reset of its own:
        every flight has an executive to itself, which takes a millisecond to load.
        """
        check_start(state, conditions, altitude)
        self.fdm = Fdm(self._variant, conditions.loading)
        self._run = self.fdm.exec.run
        if self._viewer is not None:
            self._viewer.attach(self.fdm.exec)
        self._nodes()
        self.conditions, self._altitude = conditions, altitude
        self.state, self.time = state, 0.0
        self._rows: list[_Row] = []
        self._offset = (0.0, 0.0)
        self._wind = Wind(conditions.wind_east, conditions.wind_north)
        self._take_off(state)
        for _ in range(round(_LEAD_IN / TICK)):
            current = self.state
            turn = math.remainder(float(state.heading) - current.heading, 2.0 * math.pi)
            self._tick(float(state.speed) - current.speed, 0.5 * turn)
        # Where the aircraft is now is where it was to begin: the frame moves.
        current = self.state
        self._offset = (float(state.x) - current.x, float(state.y) - current.y)
        self.time = 0.0
        self._rows.clear()
        if self._viewer is not None:
            self._run = self._viewer.begin(self.fdm.exec)
        self._see()

    def _nodes(self) -> None:
        """Look up what is read and written in every period."""
        node = self.fdm.node
        self._read = [node(_PROPERTIES[name]).get_double_value for name in _Readings._fields]
        controls = ("elevator-cmd-norm", "aileron-cmd-norm", "rudder-cmd-norm", "throttle-cmd-norm")
        self._write = [node(f"fcs/{name}").set_double_value for name in controls]
        surfaces = ("elevator_up", "elevator_down", "aileron", "rudder")
        self._travel = [1.0 / math.radians(value(name)) for name in surfaces]

    def _take_off(self, state: VehicleState[Ground]) -> None:
        """Begin in the air, in the equilibrium of the state's speed through it."""
        conditions, fdm = self.conditions, self.fdm
        heading, speed = float(state.heading), float(state.speed)
        east, north = speed * math.cos(heading), speed * math.sin(heading)
        air_east, air_north = east - conditions.wind_east, north - conditions.wind_north
        airspeed = math.hypot(air_east, air_north)
        try:
            trim = solve(fdm, airspeed, self._altitude)
        except TrimError as problem:
            raise StartError(f"the flight cannot begin: {problem}") from problem
        nose = math.atan2(air_north, air_east)
        drift = math.remainder(heading - nose, 2.0 * math.pi)
        # Without wind yet the drift is a sideslip to the other side; the wind, set below, takes it
        # away.
        initial = {
            "lat-geod-deg": 0.0,
            "long-gc-deg": 0.0,
            "h-sl-ft": self._altitude / FOOT,
            "vt-fps": speed / FOOT,
            "alpha-deg": math.degrees(trim.alpha),
            "gamma-deg": 0.0,
            "beta-deg": -math.degrees(drift),
            "phi-deg": 0.0,
            "theta-deg": math.degrees(trim.alpha),
            "psi-true-deg": math.degrees(math.pi / 2.0 - nose) % 360.0,
            "p-rad_sec": 0.0,
            "q-rad_sec": 0.0,
            "r-rad_sec": 0.0,
        }
        fdm.initialise(initial, surfaces(trim.elevator, trim.throttle))
        for shaft in ("n1", "n2"):
            fdm.set(f"propulsion/engine/{shaft}", 60.0 + 40.0 * trim.throttle)
        self._stir_the_air()
        density = fdm.get("atmosphere/rho-slugs_ft3") * SLUG_PER_FT3
        self.autopilot = Autopilot(fdm.variant, fdm.loading, self._altitude, density, trim)
        self._scale = (_EQUATOR + self._altitude, _MERIDIAN + self._altitude)
        self._throttle = trim.throttle
        self._see()

    def _stir_the_air(self) -> None:
        """Let the wind and the turbulence of the conditions blow."""
        conditions, fdm = self.conditions, self.fdm
        # JSBSim overwrites the wind with that of the initial conditions: it is set afterwards.
        fdm.set("atmosphere/wind-east-fps", conditions.wind_east / FOOT)
        fdm.set("atmosphere/wind-north-fps", conditions.wind_north / FOOT)
        severity, wind = TURBULENCE[conditions.turbulence]
        fdm.set("atmosphere/turb-type", 4.0 if severity else 0.0)
        fdm.set("atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps", wind)
        fdm.set("atmosphere/turbulence/milspec/severity", float(severity))
        fdm.set("atmosphere/randomseed", float(conditions.seed))

    def step(self, acceleration: Array, yaw_rate: Array, dt: float) -> None:
        """Fly on under an acceleration along the track (m/s^2) and its turn rate (rad/s, positive
        to the left).

        Raises:
            FlightError: the flight has failed.
            ValueError: a command is not finite, or ``dt`` (s) no multiple of
                :data:`envs.c208.autopilot.TICK`.
        """
        ticks = round(dt / TICK)
        if ticks < 1 or abs(ticks * TICK - dt) > 1e-9:
            raise ValueError(f"dt is {dt} s; expected a multiple of {TICK} s")
        acceleration, yaw_rate = float(acceleration), float(yaw_rate)
        if not (math.isfinite(acceleration) and math.isfinite(yaw_rate)):
            raise ValueError(
                f"the command is ({acceleration}, {yaw_rate}); expected two finite numbers"
            )
        for _ in range(ticks):
            self._tick(acceleration, yaw_rate)

    def hold(self, height: Height) -> None:
        """Hold an altitude from now on, and fly a climb beside what leads back to it."""
        self.autopilot.altitude, self.autopilot.climb = height

    @property
    def height(self) -> Height:
        """Altitude above the sea, and climb."""
        return Height(self.measured.altitude, self.measured.climb)

    def log(self) -> np.ndarray:
        """Return the flight so far, a row a period of the autopilot, columns :data:`LOG_COLUMNS`,
        ``[T, 11]``.
        """
        return np.array(self._rows).reshape(-1, len(LOG_COLUMNS))

    def show(self, intruders: VehicleState[Ground], altitudes: np.ndarray | None = None) -> None:
        """Show intruders ``[K]`` to the viewer, if there is one, at altitudes, m, or at that of the
        start.
        """
        if self._viewer is not None:
            longitude = (intruders.x - self._offset[0]) / self._scale[0]
            latitude = (intruders.y - self._offset[1]) / self._scale[1]
            heights = self._altitude if altitudes is None else altitudes
            self._viewer.send(latitude, longitude, heights, intruders)

    def _tick(self, acceleration: float, yaw_rate: float) -> None:
        """Fly a period of the autopilot under a command over the ground."""
        demands = air_demands(self.state, acceleration, yaw_rate, self._wind, self.autopilot.reach)
        controls = self.autopilot.fly(self.measured, *demands)
        up, down, aileron, rudder = self._travel
        elevator = controls.elevator * (down if controls.elevator > 0.0 else up)
        commands = (
            elevator,
            controls.aileron * aileron,
            controls.rudder * rudder,
            controls.throttle,
        )
        for write, command in zip(self._write, commands, strict=True):
            write(command)
        self._throttle = controls.throttle
        for _ in range(_SUBSTEPS):
            self._run()
        self.time += TICK
        self._see()

    def _see(self) -> None:
        """Read the state, log it, and raise a FlightError where the flight has failed."""
        readings = _Readings(*[read() for read in self._read])
        east, north = readings.east * FOOT, readings.north * FOOT
        share = TICK / _WIND_LAG
        wind_east, wind_north, _ = self._wind
        wind_east += share * (readings.wind_east * FOOT - wind_east)
        wind_north += share * (readings.wind_north * FOOT - wind_north)
        self._wind = Wind(wind_east, wind_north)
        x = readings.longitude * self._scale[0] + self._offset[0]
        y = readings.latitude * self._scale[1] + self._offset[1]
        self.state: VehicleState[Ground] = VehicleState(
            x, y, math.atan2(north, east), math.hypot(east, north)
        )
        self.measured = Measured(
            bank=readings.bank,
            pitch=readings.pitch,
            roll_rate=readings.roll_rate,
            pitch_rate=readings.pitch_rate,
            yaw_rate=readings.yaw_rate,
            alpha=readings.alpha,
            beta=readings.beta,
            airspeed=readings.airspeed * FOOT,
            steady_airspeed=math.hypot(east - wind_east, north - wind_north),
            altitude=readings.altitude * FOOT,
            climb=readings.climb * FOOT,
            density=readings.density * SLUG_PER_FT3,
            weight=readings.weight * POUND,
            spool=(readings.spool - 60.0) / 40.0,
        )
        problem = _problem(self.state, self.measured)
        if problem:
            raise FlightError(f"{problem} at {self.time:.2f} s")
        self._rows.append(_row(self.time, self.state, self.measured, self._throttle))


def _row(time: float, state: VehicleState[Ground], m: Measured, throttle: float) -> _Row:
    return _Row(
        time=time,
        x=state.x,
        y=state.y,
        altitude=m.altitude,
        heading=state.heading,
        speed=state.speed,
        airspeed=m.airspeed,
        bank=m.bank,
        alpha=m.alpha,
        beta=m.beta,
        throttle=throttle,
    )


def _problem(state: VehicleState[Ground], m: Measured) -> str | None:
    """Return why a flight has failed, the beginning of a sentence; None where it has not."""
    if not math.isfinite(sum(m) + state.x + state.y + state.speed + state.heading):
        return "the state is not finite"
    if m.altitude < 150.0:
        return f"the aircraft is {m.altitude:.0f} m above the sea, below 150 m,"
    if abs(m.bank) > math.radians(75.0) or abs(m.pitch) > math.radians(45.0):
        return (
            f"the attitude is lost (bank {math.degrees(m.bank):.0f} deg, pitch "
            f"{math.degrees(m.pitch):.0f} deg)"
        )
    if abs(m.alpha) > math.radians(30.0) or abs(m.beta) > math.radians(40.0):
        return (
            f"the flow is lost (alpha {math.degrees(m.alpha):.0f} deg, beta "
            f"{math.degrees(m.beta):.0f} deg)"
        )
    if not 20.0 < m.airspeed < 150.0:
        return f"the airspeed is {m.airspeed:.0f} m/s, outside 20 to 150 m/s,"
    return None
