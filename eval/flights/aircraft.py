"""The aircraft that an evaluation flies, in words, and what to beware of where it is not the
policy's.
"""

import math
from collections.abc import Mapping
from typing import Any

from agents.policy.inference import OutsideDomainError, Policy
from commands.command import ConfigError
from envs.aircraft import Aircraft, Vertical, new_aircraft
from envs.kinematics import Limits

_TASK = ("separation", "goal_radius", "traffic_speed_max", "dt", "t_max")


def describe(flown: Aircraft, policy: Policy | None) -> dict[str, Any]:
    """Return what a summary says of the aircraft as flown, and of the policy's (None: policies of
    this very one).
    """
    warning = None
    if policy is not None:
        try:
            policy.for_aircraft(flown)
        except OutsideDomainError as problem:
            warning = str(problem)
    trained = flown if policy is None else policy.aircraft
    return {
        "aircraft": _plain(flown),
        "policy_aircraft": _plain(trained),
        "aircraft_warning": warning,
    }


def aircraft_of(summary: Mapping[str, Any]) -> Aircraft:
    """Return the aircraft that a summary describes; ``ConfigError``: it describes none."""
    fields = summary.get("aircraft")
    names = {*Limits._fields, *_TASK, "vehicle"}
    # Of earlier versions, which said nothing of climbs.
    if not isinstance(fields, dict) or fields.keys() - {"vertical"} != names:
        raise ConfigError(
            f"aircraft is {fields!r}; expected an object with {', '.join(sorted(names))}"
        )
    limits, vehicle = _limits(fields), _limits(fields["vehicle"])
    task = {name: fields[name] for name in _TASK}
    climb = fields.get("vertical")
    vertical = None if climb is None else Vertical(**climb)
    vehicle = None if vehicle == limits else vehicle
    return new_aircraft(limits, **task, vehicle=vehicle, vertical=vertical)


def _limits(fields: Mapping[str, float]) -> Limits:
    return Limits(*(fields[name] for name in Limits._fields))


def lines_about(summary: Mapping[str, Any]) -> list[str]:
    """Return what a table or a page says of :func:`describe`."""
    warning, line = summary["aircraft_warning"], f"aircraft: {_line(aircraft_of(summary))}"
    return [line, *([f"warning: {warning}"] if warning else [])]


def _plain(aircraft: Aircraft) -> dict[str, Any]:
    others = {name: getattr(aircraft, name) for name in _TASK}
    vertical = None if aircraft.vertical is None else aircraft.vertical._asdict()
    vehicle = aircraft.vehicle_limits._asdict()
    return aircraft.limits._asdict() | others | {"vehicle": vehicle, "vertical": vertical}


def _line(aircraft: Aircraft) -> str:
    line = f"{format_limits(aircraft.limits)}, separation {aircraft.separation:g} m"
    if aircraft.vertical is None:
        return line
    up, down, _, separation = aircraft.vertical
    return f"{line}; up {up:g} m/s, down {down:g} m/s, vertical separation {separation:g} m"


def format_limits(limits: Limits) -> str:
    """Return limits in words."""
    return (
        f"{limits.speed_min:g} to {limits.speed_max:g} m/s, {limits.acceleration_min:g} to "
        f"{limits.acceleration_max:g} m/s², {math.degrees(limits.yaw_rate_max):.4g} deg/s"
    )
