"""What a certificate is held to: an aircraft's file, and a standard."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from .balls import ZERO, to_float
from .certificate import Certificate
from .motion import through_air
from .reading import least_vertical
from .refusal import demand

_SPEEDS = ("speed_min_mps", "speed_max_mps")
_LIMITS = (*_SPEEDS, "acceleration_min_mps2", "acceleration_max_mps2", "yaw_rate_max_deg_s")
_CLIMBS = ("climb_max_mps", "descent_max_mps", "vertical_acceleration_mps2")
_VERTICAL = "vertical_separation_m"
IN_PLANE = 600.0
"""The least vertical separation of plans in the plane unless a standard states another, m."""


class Standard(NamedTuple):
    """What a certificate is held to beside the aircraft's file, which says nothing of it."""

    vertical: float | None = None  # separation, m; None: as of :func:`least_separation`
    sigmas: float = 2.0  # of the uncertainty


STANDARD = Standard()


def check_aircraft(
    certificate: Certificate, aircraft: Mapping[str, float], standard: Standard = STANDARD
) -> None:
    """Refuse limits beyond those of an aircraft file, separations below its own, and what is below
    a standard.
    """
    vehicle = {name: aircraft.get(f"vehicle.{name}", value) for name, value in aircraft.items()}
    check_vehicle_limits(certificate, vehicle)
    check_own_speed(certificate, aircraft, vehicle)
    check_climbs(certificate, aircraft)
    check_standard(certificate, aircraft, standard)
    check_separations(certificate, aircraft["separation_m"])


def check_vehicle_limits(certificate: Certificate, vehicle: Mapping[str, float]) -> None:
    """Refuse limits beyond those of a vehicle."""
    limits = certificate.limits
    turn = math.radians(vehicle["yaw_rate_max_deg_s"])
    inside = (
        ("speed_min", limits.speed_min >= vehicle["speed_min_mps"]),
        ("speed_max", limits.speed_max <= vehicle["speed_max_mps"]),
        ("acceleration_min", limits.acceleration_min >= vehicle["acceleration_min_mps2"]),
        ("acceleration_max", limits.acceleration_max <= vehicle["acceleration_max_mps2"]),
        ("yaw_rate_max", limits.yaw_rate_max <= turn * (1.0 + 1e-9)),
    )
    for name, holds in inside:
        demand(holds, f"its {name} is {getattr(limits, name):g}, beyond the aircraft's")


def check_own_speed(
    certificate: Certificate, aircraft: Mapping[str, float], vehicle: Mapping[str, float]
) -> None:
    """Refuse an airspeed at the request that is beyond the aircraft's, by more than a hundredth of
    the greatest that the planner allows; a plan that begins beyond its limits may stay there.
    """
    own = through_air(certificate.plan_states[0], ZERO, certificate.wind)
    speed = to_float(own.speed.x)
    least = min(limits["speed_min_mps"] for limits in (aircraft, vehicle))
    most = max(limits["speed_max_mps"] for limits in (aircraft, vehicle))
    inside = least - 0.011 * most <= speed <= 1.011 * most
    demand(inside, f"its speed at the request is {speed:g} m/s, beyond the aircraft's")


def check_climbs(certificate: Certificate, aircraft: Mapping[str, float]) -> None:
    """Refuse a plan that climbs of an aircraft whose file does not say how, and limits of climbs
    beyond those of the file.
    """
    profile = certificate.profile
    if profile is None:
        return
    for name in (*_CLIMBS, _VERTICAL):
        demand(name in aircraft, f"its plan climbs, but the aircraft's file has no {name}")
    stated = profile.climb_max, profile.descent_max, profile.acceleration
    for name, value in zip(_CLIMBS, stated, strict=True):
        most = aircraft[name]
        demand(value <= most, f"its {name} is {value:g}, beyond the aircraft's, {most:g}")


def least_separation(
    certificate: Certificate, aircraft: Mapping[str, float], standard: Standard
) -> tuple[float, str]:
    """Return the least vertical separation that a certificate may state, m, and who asks for it: a
    standard, or the aircraft's file of a plan that climbs.
    """
    own = 0.0 if certificate.profile is None else aircraft[_VERTICAL]
    usual = IN_PLANE if certificate.profile is None else 0.0
    least = usual if standard.vertical is None else standard.vertical
    return (own, "the aircraft's") if own > least else (least, "--vertical-separation")


def check_standard(
    certificate: Certificate, aircraft: Mapping[str, float], standard: Standard
) -> None:
    """Refuse a vertical separation, or a number of sigmas, below a standard."""
    stated = least_vertical(certificate)
    if stated is not None:
        least, source = least_separation(certificate, aircraft, standard)
        expected = f"below {least:g} m ({source})"
        demand(stated >= least, f"a vertical separation is {stated:g} m, {expected}")
    sigmas = certificate.requirement.sigmas
    expected = f"below {standard.sigmas:g} (--sigmas)"
    demand(sigmas >= standard.sigmas, f"its uncertainty counts {sigmas:g} sigmas, {expected}")


def check_separations(certificate: Certificate, least: float) -> None:
    """Refuse separations below the aircraft's, m."""
    separation = certificate.requirement.separation
    demand(separation >= least, f"its separation is {separation:g} m, below the aircraft's")
    for number, report in enumerate(certificate.reports):
        demand(
            report.separation >= least,
            f"the separation from intruder {number} is {report.separation:g} m, below the "
            "aircraft's",
        )


def read_aircraft(text: str) -> dict[str, float]:
    """Return the numbers of an aircraft file: lines ``key: number``, those of a group ``vehicle:``
    indented, under ``vehicle.key``.

    Raises ValueError for anything else that YAML could hold, and for a key that stands twice.
    """
    aircraft: dict[str, float] = {}
    group = ""
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].rstrip()
        if not content:
            continue
        key, colon, value = content.strip().partition(":")
        if not content[0].isspace():
            group = ""
        if content == "vehicle:":
            group = "vehicle."
            continue
        name = group + key
        if not colon or name in aircraft:
            raise ValueError(f"line {number}: {content.strip()!r}; expected key: number, once each")
        try:
            aircraft[name] = float(value)
        except ValueError:
            raise ValueError(f"line {number}: {value.strip()!r} is no number") from None
    check_complete(aircraft)
    return aircraft


def check_complete(aircraft: Mapping[str, float]) -> None:
    """Raise ValueError where an aircraft's file lacks a number."""
    of_vehicle = [f"vehicle.{name}" for name in _LIMITS]
    stated = any(name.startswith("vehicle.") for name in aircraft)
    for name in (*_LIMITS, "separation_m", *(of_vehicle if stated else ())):
        if name not in aircraft:
            raise ValueError(f"{name} is missing")


def aircraft_file(path: Path) -> Path:
    """Return the file of an aircraft that ships where a path is its name alone and no file."""
    folder = Path(__file__).parents[1] / "configs" / "aircraft"
    file = folder / f"{path}.yaml"
    return file if not path.exists() and path.name == str(path) and file.is_file() else path
