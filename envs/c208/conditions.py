"""What may differ from one flight of the true aircraft to the next: its loading and the air."""

import math
from typing import Literal, NamedTuple

import numpy as np

from envs.frames import Ground
from envs.kinematics import VehicleState

TURBULENCE = {"none": (0, 0.0), "light": (3, 25.0), "moderate": (4, 50.0)}
"""Probability index and wind at 20 ft, ft/s, of MIL-F-8785C."""


class Loading(NamedTuple):
    """The aircraft itself."""

    weight: float | None = None  # lb, with fuel; None: the variant's greatest
    centre_of_gravity: float = 0.32  # share of the mean chord
    inertia_factor: float = 1.0  # on all moments of inertia
    drag_factor: float = 1.0  # on the zero-lift drag
    lift_slope_factor: float = 1.0  # on the lift curve's slope
    pod: bool = False  # cargo pod installed


NOMINAL = Loading()

_BOUNDS = {
    "weight": (5500.0, 8900.0),
    "centre_of_gravity": (0.15, 0.4033),
    "inertia_factor": (0.5, 2.0),
    "drag_factor": (0.7, 1.5),
    "lift_slope_factor": (0.8, 1.2),
}


def check_loading(loading: Loading) -> Loading:
    """Return the loading.

    Raises:
        ValueError: a number is outside what the model stands for.
    """
    for name, (low, high) in _BOUNDS.items():
        number = getattr(loading, name)
        if number is not None and not low <= number <= high:
            raise ValueError(f"loading.{name} is {number}; expected {low:g} to {high:g}")
    return loading


class Conditions(NamedTuple):
    """The aircraft and the air."""

    loading: Loading = NOMINAL
    wind_east: float = 0.0  # velocity of the air towards east, m/s
    wind_north: float = 0.0
    turbulence: Literal["none", "light", "moderate"] = "none"
    """Tustin's discretisation of the Dryden spectra of MIL-F-8785C."""
    seed: int = 0  # of the turbulence


CALM = Conditions()


def check_state(state: VehicleState[Ground]) -> None:
    """Raise a ValueError for a state that is not one finite number a field."""
    for name, number in zip(VehicleState._fields, state, strict=True):
        if np.ndim(number) != 0 or not math.isfinite(float(number)):
            raise ValueError(f"state.{name} is {number}; expected one finite number")


def check_start(state: VehicleState[Ground], conditions: Conditions, altitude: float) -> None:
    """Raise a ValueError for a state, conditions or an altitude (m) in which no flight begins."""
    check_state(state)
    if conditions.turbulence not in TURBULENCE:
        raise ValueError(
            f"turbulence is {conditions.turbulence!r}; expected one of {', '.join(TURBULENCE)}"
        )
    if not math.hypot(conditions.wind_east, conditions.wind_north) <= 30.0:
        raise ValueError(
            f"the wind is ({conditions.wind_east}, {conditions.wind_north}) m/s; expected at most "
            "30 m/s"
        )
    if not 0 <= conditions.seed < 2**31:
        raise ValueError(f"seed is {conditions.seed}; expected 0 to {2**31 - 1}")
    if not 300.0 <= altitude <= 7000.0:
        raise ValueError(f"altitude is {altitude} m; expected 300 to 7000 m")
