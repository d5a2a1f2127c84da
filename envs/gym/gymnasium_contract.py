"""What the single and the vectorised Gymnasium environment have in common: spaces, names and checks
of input.
"""

import math
import os
import sys
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

import numpy as np
from gymnasium import error, spaces
from numpy.typing import ArrayLike

from envs.aircraft import Aircraft
from envs.encounters import MOST_INTRUDERS, Encounter, EncounterError, Scenario
from envs.observation import ROW, SIZE
from envs.outcome import Outcome, Rules
from envs.rewards import with_scores
from envs.scenarios import resolve, scenario
from envs.world import World

OUTCOMES = ("flying", *Outcome._fields)
"""Names of the outcomes in ``info``."""

_OPTIONS = ("scenario", "encounter")


def has_display() -> bool:
    """Return whether this process may open a window: on Linux, whether it is given a display."""
    return not sys.platform.startswith("linux") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )


def observation_space(intruders: int) -> spaces.Space[Any]:
    """Return the space of an observation: float32 ``[8]`` for one intruder, a ``Dict`` for more.

    Raises:
        EncounterError: it is no number of intruders, 1 to :data:`envs.encounters.MOST_INTRUDERS`.
    """
    is_whole = isinstance(intruders, int) and not isinstance(intruders, bool)
    if not (is_whole and 1 <= intruders <= MOST_INTRUDERS):
        raise EncounterError(
            f"intruders is {intruders!r}; expected a whole number from 1 to {MOST_INTRUDERS}"
        )
    if intruders == 1:
        return spaces.Box(-1.0, 1.0, (SIZE,), np.float32)
    return spaces.Dict(
        {
            "own": spaces.Box(-1.0, 1.0, (ROW,), np.float32),
            "traffic": spaces.Box(-1.0, 1.0, (intruders, ROW), np.float32),
            "mask": spaces.MultiBinary(intruders),
        }
    )


def as_dict(packed: np.ndarray, intruders: int) -> dict[str, np.ndarray]:
    """Return observations as the ``Dict`` space has them.

    Packed they hold own, traffic and mask one after the other, ``[..., 4 + 5 K]`` for K intruders.
    """
    own, traffic, mask = np.split(packed, [ROW, ROW + ROW * intruders], axis=-1)
    rows = traffic.reshape(*packed.shape[:-1], intruders, ROW)
    return {
        "own": own.astype(np.float32),
        "traffic": rows.astype(np.float32),
        "mask": mask.astype(np.int8),
    }


def action_space() -> spaces.Box:
    """Return the space of one action, float32 ``[2]``."""
    return spaces.Box(-1.0, 1.0, (2,), np.float32)


def scenario_of(choice: str | Scenario, aircraft: Aircraft) -> Scenario:
    """Return the scenario meant; where it is named ``module:name`` its code is loaded.

    Raises:
        EncounterError: there is none of that name, or it is another aircraft's.
    """
    if isinstance(choice, str):
        resolve(choice)
        return scenario(choice, aircraft)
    if not isinstance(choice, Scenario):
        raise EncounterError(
            f"scenario is {choice!r}; expected a name or an envs.encounters.Scenario"
        )
    if choice.aircraft != aircraft:
        raise EncounterError(
            f"scenario {choice.name!r} is another aircraft's; expected one of the aircraft that "
            "flies"
        )
    return choice


def world_of(aircraft: Aircraft, rules: Rules | None, rewards: Mapping[str, float] | None) -> World:
    """Return the world of an aircraft, by its own rules or others, with the scores of a table of
    rewards.

    Raises:
        EncounterError: the rules have another time step than the aircraft, or a number that is not
            finite.
        RewardError: a reward is not a finite number.
    """
    chosen = aircraft.rules() if rules is None else rules
    if chosen.dt != aircraft.dt:
        raise EncounterError(
            f"rules.dt is {chosen.dt:g} s; expected {aircraft.dt:g} s, the aircraft's time step"
        )
    for name, value in chosen._asdict().items():
        if not math.isfinite(value):
            raise EncounterError(f"rules.{name} is {value!r}; expected a finite number")
    return World(with_scores(Rules(*map(float, chosen)), rewards or {}), aircraft)


def check_options(options: dict[str, Any] | None) -> dict[str, Any]:
    """Return the options of a reset.

    Raises:
        EncounterError: one is unknown or of a wrong type.
    """
    chosen = dict(options or {})
    for key in chosen:
        if key not in _OPTIONS:
            near = get_close_matches(str(key), _OPTIONS, n=1)
            hint = f"expected some of {', '.join(_OPTIONS)}"
            if near:
                hint = f"did you mean {near[0]!r}?"
            raise EncounterError(f"reset option {key!r} is unknown; {hint}")
    encounter = chosen.get("encounter")
    if isinstance(encounter, (int, np.integer)) and not isinstance(encounter, bool):
        chosen["encounter"] = int(encounter)
    elif "encounter" in chosen and not isinstance(encounter, Encounter):
        raise EncounterError(
            f"reset option 'encounter' is {encounter!r}; expected a number or an Encounter"
        )
    return chosen


def check_actions(action: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """Return actions as float32 of a shape.

    Raises:
        gymnasium.error.InvalidAction: they have another shape, or one is no finite number.
    """
    try:
        numbers = np.asarray(action, dtype=np.float32)
    except (TypeError, ValueError):
        raise error.InvalidAction(
            f"action {action!r} is not numeric; expected floats of shape {shape}"
        ) from None
    if numbers.shape != shape:
        raise error.InvalidAction(f"action has shape {numbers.shape}; expected {shape}")
    if not np.isfinite(numbers).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(numbers))[0])
        raise error.InvalidAction(
            f"action{list(where)} is {numbers[where]}; expected a finite number in [-1, 1]"
        )
    return numbers
