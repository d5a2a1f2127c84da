"""The aircraft that an autopilot's parameters describe, and what in them forbids to fly it.

Its total energy (TECS) climbs with TECS_CLMB_MAX at full throttle, and sinks with TECS_SINK_MIN
without power: what goes up or down so fast has nothing left for its speed.
"""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from commands.command import InputError
from envs.aircraft import Aircraft, AircraftError, Vertical, new_aircraft
from envs.areas import Level
from envs.kinematics import Limits

GRAVITY = 9.80665  # m/s^2

_MOST_BANK = math.radians(40.0)  # of plans, whatever the autopilot may bank
_STALL = 1.2  # least speed of plans, in the autopilot's own
_RESERVE = 0.93  # greatest speed of plans, in the autopilot's own
_SLOWEST = 0.41  # least speed of the policy's family, in the greatest
_WIDEST = 0.74  # the greatest that the least speed is in the family
_ACCELERATION = 0.7  # of what the autopilot's total energy allows in level flight
_MOST_ACCELERATION = (
    0.6  # m/s^2, whatever the energy allows: TECS takes seconds to change the speed
)
_CLIMB = 0.7  # of the greatest climb and of the least sink: turns take power, too
_CLIMB_CHANGE = 0.14  # of TECS_VERT_ACC: TECS takes seconds to change the climb
_MOST_CLIMB_CHANGE = 1.0  # m/s^2
_HEIGHT_DELAY = 0.5  # s, measured, by which TECS is later than its filter of the altitude
_LIMIT = 0.38  # of the accelerations of the policy's family, V^2 / D
_LEAST_RADIUS = 0.31  # of the turns of the policy's family, D
_IN_EVERY_MODE = (1.0, 2.0)  # FS_GCS_ENABL: heartbeats are watched; 3: only in AUTO
_TO_AUTO = 4.0  # FS_LONG_ACTN
_FENCE_MAX, _FENCE_MIN = 1, 8  # of FENCE_TYPE: FENCE_ALT_MAX, FENCE_ALT_MIN
_USUAL_TIMEOUT = 5.0  # s, ArduPlane's default of FS_LONG_TIMEOUT
_OLD_NAMES = {
    "AIRSPEED_MIN": "ARSPD_FBW_MIN",
    "AIRSPEED_MAX": "ARSPD_FBW_MAX",
    "ROLL_LIMIT_DEG": "LIM_ROLL_CD",
}


class HeightLag(NamedTuple):
    """How an autopilot follows the altitude that it is told: late, and through a filter of first
    order; s.
    """

    delay: float = _HEIGHT_DELAY
    filter: float = 3.0  # ArduPlane's default of TECS_HDEM_TCONST


class Vehicle(NamedTuple):
    """An aircraft with what was assumed of it, and the airspeeds that its autopilot takes, m/s."""

    aircraft: Aircraft
    airspeed_min: float
    airspeed_max: float
    notes: tuple[str, ...]
    height_lag: HeightLag = HeightLag()


class ParameterError(InputError):
    """A parameter of the autopilot that is missing, impossible or against being flown."""


def value_of(parameters: Mapping[str, float], name: str) -> float | None:
    """Return a parameter under its name of ArduPlane 4.5 or later, or the one before; None where
    there is neither.
    """
    value = parameters.get(name)
    if value is None and name in _OLD_NAMES:
        value = parameters.get(_OLD_NAMES[name])
        if value is not None and name == "ROLL_LIMIT_DEG":
            value *= 0.01
    return value


def vehicle_of(
    parameters: Mapping[str, float], separation: float, vertical_separation: float | None = None
) -> Vehicle:
    """Return the aircraft of an autopilot's parameters for separations to be kept, m; without a
    vertical one it plans in the plane.

    Raises:
        ParameterError: a speed is missing or impossible, or no aircraft follows.
    """
    stated = _read(parameters)
    able = _vehicle_limits(stated)
    decided = _decision_limits(able, separation)
    notes = [*_notes(stated, able, decided)]
    vertical = None
    if vertical_separation is not None:
        vertical, vertical_notes = _vertical_limits(
            parameters, stated, decided, vertical_separation
        )
        notes += vertical_notes
    try:
        aircraft = new_aircraft(decided, separation, vehicle=able, vertical=vertical)
    except AircraftError as problem:
        raise ParameterError(f"the autopilot's parameters make no aircraft: {problem}") from None
    filtered = value_of(parameters, "TECS_HDEM_TCONST")
    lag = HeightLag() if filtered is None else HeightLag(filter=max(filtered, 0.0))
    return Vehicle(aircraft, stated.airspeed_min, stated.airspeed_max, tuple(notes), lag)


class _Stated(NamedTuple):
    """What the parameters say of the aircraft, and what is taken where they say nothing."""

    airspeed_min: float  # m/s
    airspeed_max: float
    bank: float  # greatest of plans, rad
    climb: float  # greatest rate, m/s
    sink: float  # least rate without power, m/s
    assumed: tuple[str, ...]  # a sentence for each that is unknown


def _read(parameters: Mapping[str, float]) -> _Stated:
    slow, fast = (_require(parameters, name) for name in ("AIRSPEED_MIN", "AIRSPEED_MAX"))
    if not 0.0 < slow < fast:
        raise ParameterError(
            f"AIRSPEED_MIN, AIRSPEED_MAX are {slow:g}, {fast:g} m/s; expected 0 < min < max"
        )
    assumed: list[str] = []
    roll = value_of(parameters, "ROLL_LIMIT_DEG")
    if roll is None:
        roll = 45.0
        assumed.append("ROLL_LIMIT_DEG is unknown and taken as 45 degrees")
    climb = _value_or(parameters, "TECS_CLMB_MAX", 3.0, assumed)
    sink = _value_or(parameters, "TECS_SINK_MIN", 1.0, assumed)
    bank = min(math.radians(roll), _MOST_BANK)
    return _Stated(slow, fast, bank, climb, sink, tuple(assumed))


def _vehicle_limits(stated: _Stated) -> Limits:
    """Return what the aircraft can do, less the reserves of plans."""
    top = _RESERVE * stated.airspeed_max
    # TECS trades the specific power of its greatest climb and least sink rate against speed.
    gain, loss = (_ACCELERATION * rate * GRAVITY / top for rate in (stated.climb, stated.sink))
    return Limits(
        speed_min=max(_STALL * stated.airspeed_min, _SLOWEST * top),
        speed_max=top,
        acceleration_min=-min(loss, _MOST_ACCELERATION),
        acceleration_max=min(gain, _MOST_ACCELERATION),
        yaw_rate_max=0.8 * GRAVITY * math.tan(stated.bank) / top,
    )


def _decision_limits(able: Limits, separation: float) -> Limits:
    """Return what plans decide with: a share of what the aircraft can do, within what the policy's
    family has for the separation, m.
    """
    top = able.speed_max
    unit = top * top / separation
    return Limits(
        able.speed_min,
        top,
        max(-_LIMIT * unit, 0.75 * able.acceleration_min),
        min(_LIMIT * unit, 0.75 * able.acceleration_max),
        min(0.75 * able.yaw_rate_max, top / (_LEAST_RADIUS * separation)),
    )


def _vertical_limits(
    parameters: Mapping[str, float], stated: _Stated, decided: Limits, separation: float
) -> tuple[Vertical, list[str]]:
    """Return what plans do up and down, with a vertical separation, m, and what follows, a sentence
    each.

    A climb leaves the power for the greatest acceleration that plans decide with. A descent leaves
    nothing for a deceleration: TECS_SINK_MIN is that of the slowest glide, and an aircraft that is
    to slow down is faster and sinks faster.
    """
    notes: list[str] = []
    fastest_sink = _value_or(parameters, "TECS_SINK_MAX", 5.0, notes)
    acceleration = _value_or(parameters, "TECS_VERT_ACC", 7.0, notes, "m/s^2")
    reserve = decided.acceleration_max * decided.speed_max / GRAVITY
    vertical = Vertical(
        climb_max=min(_CLIMB * stated.climb, stated.climb - reserve),
        descent_max=min(_CLIMB * stated.sink, fastest_sink),
        acceleration=min(_CLIMB_CHANGE * acceleration, _MOST_CLIMB_CHANGE),
        separation=separation,
    )
    notes.append(
        f"climbs of {vertical.climb_max:.1f} m/s at most of TECS_CLMB_MAX {stated.climb:g} m/s, "
        f"descents of {vertical.descent_max:.1f} m/s of TECS_SINK_MIN {stated.sink:g} and "
        f"TECS_SINK_MAX {fastest_sink:g} m/s"
    )
    return vertical, notes


def fence_levels(
    parameters: Mapping[str, float], home: float | None
) -> tuple[Level | None, Level | None]:
    """Return the fence's floor and ceiling above mean sea level; None: it has none.

    They count where FENCE_TYPE has their bit, whether FENCE_ENABLE is on or off, as the fence's
    polygons do.

    Args:
        parameters: of the autopilot.
        home: altitude of home, m above mean sea level, above which they are; None: unknown.

    Raises:
        ParameterError: there is one, and home's altitude is unknown.
    """
    kinds = int(parameters.get("FENCE_TYPE", 0.0))
    levels = []
    for name, bit in (("FENCE_ALT_MIN", _FENCE_MIN), ("FENCE_ALT_MAX", _FENCE_MAX)):
        above = parameters.get(name) if kinds & bit else None
        if above is not None and home is None:
            problem = (
                f"{name} is {above:g} m above home, whose altitude no item 0 of the mission says"
            )
            raise ParameterError(f"{problem}; expected one where plans may climb")
        levels.append(None if above is None or home is None else Level(home + above, "msl"))
    floor, ceiling = levels
    return floor, ceiling


def _notes(stated: _Stated, able: Limits, decided: Limits) -> Iterator[str]:
    """Yield what follows from the parameters, a sentence each."""
    low, top = able.speed_min, able.speed_max
    speeds = f"{stated.airspeed_min:g}, {stated.airspeed_max:g}"
    yield f"plans fly {low:.1f} to {top:.1f} m/s of AIRSPEED_MIN, MAX {speeds}"
    if low > _WIDEST * top:
        yield f"the speeds are closer together than the policy's family has them ({top:g})"
    yield from stated.assumed
    bank, turn, decision = map(math.degrees, (stated.bank, able.yaw_rate_max, decided.yaw_rate_max))
    yield (
        f"turns of {turn:.1f} deg/s at most (bank {bank:.0f} degrees at {top:.1f} m/s), plans "
        f"decide with {decision:.1f}"
    )
    yield (
        f"accelerations {able.acceleration_min:.2f} to {able.acceleration_max:.2f} m/s^2 of "
        f"TECS_SINK_MIN {stated.sink:g} and TECS_CLMB_MAX {stated.climb:g} m/s"
    )


def check_flyable(parameters: Mapping[str, float]) -> None:
    """Raise :class:`ParameterError` where the autopilot's own avoidance is on: both must not fly
    at once.
    """
    enabled = parameters.get("AVD_ENABLE", 0.0)
    if enabled != 0.0:
        raise ParameterError(
            f"AVD_ENABLE is {enabled:g}; expected 0 with --fly: the autopilot's own avoidance "
            "ignores guided commands, and both must not fly at once"
        )


def failsafe_notes(parameters: Mapping[str, float], system: int) -> tuple[str, ...]:
    """Return what of the autopilot's settings keeps it from going on with its mission where this
    program dies.
    """
    if not _watches(parameters, system):
        return (
            f"FS_GCS_ENABL, MAV_GCS_SYSID do not watch this program (system {system}): where it "
            "dies while it flies, the autopilot stays in GUIDED at the end of the plan until "
            "somebody changes the mode",
        )
    if parameters.get("FS_LONG_ACTN", 0.0) == 0.0:
        return ("FS_LONG_ACTN is 0: where this program dies the autopilot stays in GUIDED",)
    if parameters.get("MIS_RESTART") != 0.0:
        return (
            "MIS_RESTART is not 0, or unknown: where this program dies the mission begins anew",
        )
    return ()


def failsafe_timeout(parameters: Mapping[str, float], system: int) -> float:
    """Return after which silence of this program the autopilot's failsafe sets AUTO, s; inf: it
    never does.
    """
    to_auto = parameters.get("FS_LONG_ACTN") == _TO_AUTO
    if not (to_auto and _watches(parameters, system)):
        return math.inf
    return parameters.get("FS_LONG_TIMEOUT", _USUAL_TIMEOUT)


def _watches(parameters: Mapping[str, float], system: int) -> bool:
    """Return whether the autopilot's failsafe watches this program in GUIDED."""
    ours = parameters.get("MAV_GCS_SYSID", parameters.get("SYSID_MYGCS"))
    return parameters.get("FS_GCS_ENABL") in _IN_EVERY_MODE and ours == system


def own_address(parameters: Mapping[str, float]) -> str:
    """Return the address that the autopilot's transponder sends, hexadecimal; "": unknown."""
    number = int(parameters.get("ADSB_ICAO_ID", 0.0))
    return f"{number:06x}" if number > 0 else ""


def _require(parameters: Mapping[str, float], name: str) -> float:
    value = value_of(parameters, name)
    if value is None:
        raise ParameterError(f"{name} is not among the autopilot's parameters; expected m/s")
    return value


def _value_or(
    parameters: Mapping[str, float], name: str, usual: float, assumed: list[str], unit: str = "m/s"
) -> float:
    """Return a rate, or the usual one with a note of that."""
    value = value_of(parameters, name)
    if value is None or value <= 0.0:
        assumed.append(f"{name} is unknown and taken as {usual:g} {unit}")
        return usual
    return value
