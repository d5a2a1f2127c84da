"""Novelty: the network's own inputs against the box of what training saw, two numbers for each
input.

The inputs are mirrored and without dimension (:mod:`agents.policy.set_features`), so that a scene,
its mirror image and the same scene of a larger aircraft are equally new. The box of the policy that
ships lies beside it.
"""

import json
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np

from agents.policy.domain import Departure
from agents.policy.scene import scene
from agents.policy.set_features import SetInputs, set_inputs
from envs.aircraft import Aircraft
from envs.kinematics import VehicleState

_PASSING = (
    "time to closest approach",
    "miss distance",
    "miss distance from afar",
    "depth of the conflict",
)
OWN = (
    *(
        "own speed in its range",
        "own speed",
        "goal ahead",
        "goal to the side",
        "goal distance",
        "goal nearness",
    ),
    *("goal outside the left turning circle", "goal outside the right turning circle"),
    *("least speed", "deceleration", "acceleration", "turn radius"),
    *("separation that the best manoeuvre keeps", "its acceleration", "its turn"),
    *(f"separation that manoeuvre {number} keeps" for number in range(22)),
)
"""Names of the inputs of the ownship."""
EACH = (
    *("intruder ahead", "intruder to the side", "intruder distance", "intruder nearness"),
    *(
        "intruder velocity ahead",
        "intruder velocity to the side",
        "relative velocity ahead",
        "range rate",
    ),
    *_PASSING,
    *(f"{name} on the course to the goal" for name in _PASSING),
)
"""Names of the inputs of an intruder."""

_MARGIN = (
    0.02  # of an input's range in training; flights that training did not draw leave it by less
)


class Box(NamedTuple):
    """Least and greatest value of each input in training, ``[2, 37]`` and ``[2, 16]``."""

    own: np.ndarray
    each: np.ndarray


@cache
def shipped(sha256: str) -> Box | None:
    """Return the box of the policy with this digest; None unless it is the one that ships."""
    kept = json.loads(
        resources.files("agents").joinpath("data/inputs.json").read_text(encoding="utf-8")
    )
    return Box(np.array(kept["own"]), np.array(kept["each"])) if kept["policy"] == sha256 else None


def inputs_of(
    own: VehicleState,
    intruders: VehicleState,
    present: np.ndarray,
    goal: tuple[np.ndarray, np.ndarray],
    one: Aircraft,
) -> SetInputs:
    """Return the network's inputs for states ``[N]`` and ``[N, K]`` with K >= 1, present ones bool
    ``[N, K]``.
    """
    return set_inputs(scene(own, intruders, present, *goal, one.limits, one.separation, np), np)


def excess(box: Box, inputs: SetInputs) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much each input is outside the box, ``[..., 37]`` and ``[..., K, 16]``; nan is
    infinitely far.
    """
    found = []
    for (low, high), values in ((box.own, inputs.own), (box.each, inputs.each)):
        beyond = np.maximum(low - values, values - high)
        beyond = np.where(np.isnan(values), np.inf, beyond)
        found.append(np.where(beyond > _MARGIN * (high - low), beyond, 0.0))
    return found[0], np.where(inputs.present[..., None], found[1], 0.0)


def departures(box: Box, own: Sequence[float], each: Sequence[Sequence[float]]) -> list[Departure]:
    """Return the newest of one scene's inputs, ``[37]`` and ``[K, 16]``; none if training saw
    such.
    """
    if not each:
        return []
    inputs = SetInputs(np.array(own), np.array(each), np.ones(len(each), bool), 1.0)
    values = np.concatenate([inputs.own, inputs.each.ravel()])
    ranges = np.concatenate([box.own, np.tile(box.each, len(each))], axis=1)
    beyond = np.concatenate([part.ravel() for part in excess(box, inputs)]) / (
        ranges[1] - ranges[0]
    )
    worst = int(np.argmax(beyond))
    if not beyond[worst] > 0.0:
        return []
    number, name = divmod(worst - len(OWN), len(EACH))
    what = OWN[worst] if worst < len(OWN) else f"{EACH[name]} (intruder {number})"
    low, high = ranges[:, worst]
    text = f"is {values[worst]:.3g}; training saw {low:.3g} to {high:.3g}"
    return [Departure(f"novelty: {what}", text)]
