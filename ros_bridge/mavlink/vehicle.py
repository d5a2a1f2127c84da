"""The aircraft that an autopilot's parameters describe, and what in them forbids to fly it."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from commands.command import InputError
from envs.aircraft import Aircraft, AircraftError, new_aircraft
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
_LIMIT = 0.38  # of the accelerations of the policy's family, V^2 / D
_LEAST_RADIUS = 0.31  # of the turns of the policy's family, D
_IN_EVERY_MODE = (1.0, 2.0)  # FS_GCS_ENABL: heartbeats are watched; 3: only in AUTO
_TO_AUTO = 4.0  # FS_LONG_ACTN
_USUAL_TIMEOUT = 5.0  # s, ArduPlane's default of FS_LONG_TIMEOUT
_OLD_NAMES = {
    "AIRSPEED_MIN": "ARSPD_FBW_MIN",
    "AIRSPEED_MAX": "ARSPD_FBW_MAX",
    "ROLL_LIMIT_DEG": "LIM_ROLL_CD",
}


class Vehicle(NamedTuple):
    """An aircraft with what was assumed of it, and the airspeeds that its autopilot takes, m/s."""

    aircraft: Aircraft
    airspeed_min: float
    airspeed_max: float
    notes: tuple[str, ...]


class ParameterError(InputError):
    """A parameter of the autopilot that is missing, impossible or against being flown."""


def value_of(parameters: Mapping[str, float], name: str) -> float | None:
    """Return a parameter under its name of ArduPlane 4.5 or later, or the one before; None where
    there is neither.
    """
    found = parameters.get(name)
    if found is None and name in _OLD_NAMES:
        found = parameters.get(_OLD_NAMES[name])
        if found is not None and name == "ROLL_LIMIT_DEG":
            found *= 0.01
    return found


def vehicle_of(parameters: Mapping[str, float], separation: float) -> Vehicle:
    """Return the aircraft of an autopilot's parameters for a separation to be kept, m.

    Raises:
        ParameterError: a speed is missing or impossible, or no aircraft follows.
    """
    stated = _read(parameters)
    able = _vehicle_limits(stated)
    decided = _decision_limits(able, separation)
    try:
        aircraft = new_aircraft(decided, separation, vehicle=able)
    except AircraftError as problem:
        raise ParameterError(f"the autopilot's parameters make no aircraft: {problem}") from None
    notes = tuple(_notes(stated, able, decided))
    return Vehicle(aircraft, stated.airspeed_min, stated.airspeed_max, notes)


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


def _notes(stated: _Stated, able: Limits, decided: Limits) -> Iterator[str]:
    """Yield what follows from the parameters, a sentence each."""
    low, top = able.speed_min, able.speed_max
    given = f"{stated.airspeed_min:g}, {stated.airspeed_max:g}"
    yield f"plans fly {low:.1f} to {top:.1f} m/s of AIRSPEED_MIN, MAX {given}"
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
            "dies while it flies, the autopilot stays in GUIDED at the rejoin waypoint until "
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
    found = value_of(parameters, name)
    if found is None:
        raise ParameterError(f"{name} is not among the autopilot's parameters; expected m/s")
    return found


def _value_or(
    parameters: Mapping[str, float], name: str, usual: float, assumed: list[str]
) -> float:
    """Return a rate, m/s, or the usual one with a note of that."""
    found = value_of(parameters, name)
    if found is None or found <= 0.0:
        assumed.append(f"{name} is unknown and taken as {usual:g} m/s")
        return usual
    return found
