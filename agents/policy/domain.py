"""The operating domain: the aircraft and the traffic that a policy was trained for, and for which
results are claimed; others are refused, or named.

Evaluation, planner and bridge take the ranges from here. Lengths are in required separations,
speeds in the ownship's greatest; traffic is that of the trainings (configs/best.yaml), noise and
latency those of the scenario ``noisy``.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agents.policy.file import PolicyFile
from commands.command import InputError
from envs.aircraft import Aircraft, ratios
from envs.arrays import Array
from envs.scenarios.own_separations import GREATEST, LEAST

TRAFFIC_SPEED = (0.4, 1.3)
"""Intruders' speeds, in the ownship's greatest."""

# of an intruder at the start, separations: two displaced starts on a circle of ten
_DISTANCE = 21.5
_NOISE = 0.03  # one sigma of a report, separations and greatest speeds
_LATENCY = 2.0  # time steps
_UNITS = {
    "intruders": "",
    "intruder_separation": " m",
    "position_std": " m",
    "distance": " m",
    "latency": " s",
    "intruder_turn_rate": " rad/s",
}
_RATIO_UNITS = {
    "speed_min": "V",
    "acceleration_min": "V^2/D",
    "acceleration_max": "V^2/D",
    "turn_radius": "D",
}
_TOLERANCE = 0.01  # of a ratio; an aircraft is never known better


class Departure(NamedTuple):
    """One quantity that is outside what the policy was trained for."""

    quantity: str
    text: str  # a sentence without its subject, the quantity

    def __str__(self) -> str:
        """Return the whole sentence."""
        return f"outside_domain: {self.quantity} {self.text}"


class OutsideDomainError(InputError):
    """An aircraft that the policy was not trained for; the message names the number and its
    range.
    """


def unlike(content: PolicyFile, aircraft: Aircraft) -> Departure | None:
    """Return the first of an aircraft's ratios that is out of the range of a policy file's family,
    or None.

    A file of schema 1 knows the ratios of its own aircraft alone.
    """
    trained = ratios(content.aircraft.limits, content.aircraft.separation)
    for name, value in ratios(aircraft.limits, aircraft.separation)._asdict().items():
        ratio = getattr(trained, name)
        low, high = content.metadata["family"][name] if content.of_set else (ratio, ratio)
        if not low - _TOLERANCE * abs(low) <= value <= high + _TOLERANCE * abs(high):
            text = (
                f"is {value:.3g} {_RATIO_UNITS[name]}; expected {low:.3g} to {high:.3g}, "
                f"what the policy was trained for (D: separation {aircraft.separation:g} m; V: "
                f"{aircraft.limits.speed_max:g} m/s)"
            )
            return Departure(name, text)
    return None


def check_domain(content: PolicyFile, aircraft: Aircraft) -> None:
    """Raise an OutsideDomainError where an aircraft is out of the range of a policy file's
    family.
    """
    departure = unlike(content, aircraft)
    if departure is not None:
        raise OutsideDomainError(str(departure))


def domain(content: PolicyFile, aircraft: Aircraft) -> dict[str, tuple[float, float]]:
    """Return the range of each quantity of the traffic, SI, for an aircraft of the policy's
    family.
    """
    return {
        "intruders": (0, content.metadata["architecture"]["intruders"] if content.of_set else 1),
        "own_speed": (aircraft.limits.speed_min, aircraft.limits.speed_max),
        **traffic(aircraft),
    }


def traffic(aircraft: Aircraft) -> dict[str, tuple[float, float]]:
    """Return the range of each quantity of an intruder, SI, for an ownship."""
    limits, unit = aircraft.limits, aircraft.separation
    fast = limits.speed_max
    return {
        "intruder_speed": (TRAFFIC_SPEED[0] * fast, TRAFFIC_SPEED[1] * fast),
        "intruder_turn_rate": (0.0, limits.yaw_rate_max),
        "intruder_separation": (LEAST * unit, GREATEST * unit),
        "distance": (0.0, _DISTANCE * unit),
        "position_std": (0.0, _NOISE * unit),
        "velocity_std": (0.0, _NOISE * fast),
        "latency": (0.0, _LATENCY * aircraft.dt),
    }


def excess(allowed: tuple[float, float], values: Array) -> np.ndarray:
    """Return by how much values ``[N]`` are outside a range; what is less than 1 % of its upper end
    is 0.
    """
    beyond = np.maximum(allowed[0] - values, values - allowed[1])
    return np.where(beyond > _TOLERANCE * allowed[1], beyond, 0.0)


def departures(
    allowed: Mapping[str, tuple[float, float]], values: Mapping[str, Sequence[float]]
) -> list[Departure]:
    """Return each quantity of :func:`domain` that has values outside its range, with the
    furthest.
    """
    outside = []
    for name, sample in values.items():
        if len(sample) == 0:
            continue
        (low, high), numbers = allowed[name], np.asarray(sample, float)
        beyond = excess((low, high), numbers)
        if beyond.any():
            worst, unit = numbers[np.argmax(beyond)], _UNITS.get(name, " m/s")
            text = f"is {worst:.4g}{unit}; expected {low:.4g} to {high:.4g}{unit}"
            outside.append(Departure(name, text))
    return outside
