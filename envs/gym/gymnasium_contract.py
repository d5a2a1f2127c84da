"""What the single and the vectorised Gymnasium environment have in common: spaces, names and checks of input."""

import os
import sys
from difflib import get_close_matches
from typing import Any

import numpy as np
from gymnasium import error, spaces

from envs.encounters import Encounter, EncounterError, Scenario, scenario
from envs.observation import SIZE
from envs.outcome import Rules

__all__ = [
    "OUTCOMES",
    "action_space",
    "checked_actions",
    "checked_latency",
    "checked_options",
    "family",
    "has_display",
    "observation_space",
]

OUTCOMES = ("flying", "violation", "reached", "timeout")
"""Names of the outcomes in ``info``."""

_OPTIONS = ("scenario", "encounter")


def has_display() -> bool:
    """Return whether this process may open a window: on Linux, whether it is given a display."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def observation_space() -> spaces.Box:
    """Return the space of one observation, float32 ``[8]``."""
    return spaces.Box(-1.0, 1.0, (SIZE,), np.float32)


def action_space() -> spaces.Box:
    """Return the space of one action, float32 ``[2]``."""
    return spaces.Box(-1.0, 1.0, (2,), np.float32)


def family(wanted: str | Scenario, rules: Rules) -> Scenario:
    """Return the scenario meant by a name or given as such.

    Raises:
        EncounterError: there is none of that name, or its reports are late where the time step is not 1 s.
    """
    if isinstance(wanted, str):
        wanted = scenario(wanted)
    elif not isinstance(wanted, Scenario):
        raise EncounterError(f"scenario is {wanted!r}; expected a name or an envs.encounters.Scenario")
    checked_latency(wanted.latency[1], rules)
    return wanted


def checked_latency(latency: float, rules: Rules) -> None:
    """Raise an EncounterError if reports are late and the time step is not the 1 s that their history needs."""
    if latency > 0.0 and rules.dt != 1.0:
        raise EncounterError(f"reports are {latency:g} s late and rules.dt is {rules.dt:g} s; expected a dt of 1 s")


def checked_options(options: dict[str, Any] | None) -> dict[str, Any]:
    """Return the options of a reset with an encounter's number as int.

    Raises:
        EncounterError: an option is unknown or of a wrong type.
    """
    chosen = dict(options or {})
    for key in chosen:
        if key not in _OPTIONS:
            near = get_close_matches(str(key), _OPTIONS, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"expected some of {', '.join(_OPTIONS)}"
            raise EncounterError(f"reset option {key!r} is unknown; {hint}")
    wanted = chosen.get("encounter")
    if isinstance(wanted, (int, np.integer)) and not isinstance(wanted, bool):
        chosen["encounter"] = int(wanted)
    elif "encounter" in chosen and not isinstance(wanted, Encounter):
        raise EncounterError(f"reset option 'encounter' is {wanted!r}; expected a number or an Encounter")
    return chosen


def checked_actions(action: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return actions as float32 of a shape.

    Raises:
        gymnasium.error.InvalidAction: the shape is another one, or a value is not a finite number.
    """
    try:
        numbers = np.asarray(action, dtype=np.float32)
    except (TypeError, ValueError):
        raise error.InvalidAction(f"action {action!r} is not numeric; expected floats of shape {shape}") from None
    if numbers.shape != shape:
        raise error.InvalidAction(f"action has shape {numbers.shape}; expected {shape}")
    if not np.isfinite(numbers).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(numbers))[0])
        raise error.InvalidAction(f"action{list(where)} is {numbers[where]}; expected a finite number in [-1, 1]")
    return numbers
