"""Novelty: the network's own inputs against a box, two numbers for each input.

The inputs are mirrored and without dimension (:mod:`agents.policy.set_features`), so that a scene,
its mirror image and the same scene of a larger aircraft are equally new. The box of the policy that
ships is what its training saw; other policies have the bounds of the table of inputs.
"""

from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np

from agents.policy.domain import Departure
from agents.policy.inputs import Number
from agents.policy.scene import scene
from agents.policy.set_features import InputTable, SetInputs, set_inputs
from commands.json_text import parse_json
from envs.aircraft import Aircraft
from envs.frames import Air
from envs.kinematics import VehicleState

_MARGIN = 0.02
# of an input's range in training; flights that training did not draw leave it by less


class Box(NamedTuple):
    """Least and greatest value of each input, ``[2, F]`` of the ownship and ``[2, E]`` of
    intruders.
    """

    own: np.ndarray
    traffic: np.ndarray
    source: str = "training saw"


@cache
def shipped_box(sha256: str) -> Box | None:
    """Return the box of the policy with this digest; None unless it is the one that ships."""
    text = resources.files("agents").joinpath("data/inputs.json").read_text(encoding="utf-8")
    recorded = parse_json(text)
    if recorded["policy"] != sha256:
        return None
    return Box(np.array(recorded["own"]), np.array(recorded["each"]))


def box_of(sha256: str, inputs: InputTable) -> Box:
    """Return the box of a policy: of the one that ships what training saw, of others the bounds of
    their inputs.
    """
    return shipped_box(sha256) or Box(
        _bounds(inputs.own_numbers), _bounds(inputs.intruder_numbers), "its bounds are"
    )


def _bounds(numbers: Sequence[Number]) -> np.ndarray:
    return np.array([(number.low, number.high) for number in numbers]).T


def inputs_of(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    mask: np.ndarray,
    goal: tuple[np.ndarray, np.ndarray],
    aircraft: Aircraft,
    distance_scale: np.ndarray | None = None,
) -> SetInputs:
    """Return the network's inputs for states ``[N]`` and ``[N, K]`` with K >= 1, present ones bool
    ``[N, K]``; distance scales of the intruders, ``[N, K]``.
    """
    scenes = scene(own, intruders, mask, *goal, aircraft.limits, aircraft.separation, np)
    return set_inputs(scenes._replace(distance_scale=distance_scale), np)


def excess(box: Box, inputs: SetInputs) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much each input is outside the box, ``[..., F]`` and ``[..., K, E]``; nan is
    infinitely far.
    """
    excesses = []
    for (low, high), values in ((box.own, inputs.own), (box.traffic, inputs.traffic)):
        beyond = np.maximum(low - values, values - high)
        beyond = np.where(np.isnan(values), np.inf, beyond)
        excesses.append(np.where(beyond > _MARGIN * (high - low), beyond, 0.0))
    return excesses[0], np.where(inputs.mask[..., None], excesses[1], 0.0)


def departures(
    box: Box, inputs: InputTable, own: Sequence[float], traffic: Sequence[Sequence[float]]
) -> list[Departure]:
    """Return the newest of one scene's inputs, ``[F]`` and ``[K, E]``; none if all are known."""
    if not traffic:
        return []
    row = SetInputs(np.array(own), np.array(traffic), np.ones(len(traffic), bool), 1.0)
    beyond = np.concatenate([part.ravel() for part in excess(box, row)])
    if not beyond.any():
        return []
    values = np.concatenate([row.own, row.traffic.ravel()])
    ranges = np.concatenate([box.own, np.tile(box.traffic, len(traffic))], axis=1)
    worst = int(np.argmax(beyond / (ranges[1] - ranges[0])))
    if worst < inputs.own_size:
        sentence = inputs.own_numbers[worst].name
    else:
        number, index = divmod(worst - inputs.own_size, inputs.intruder_size)
        sentence = f"{inputs.intruder_numbers[index].name} (intruder {number})"
    low, high = ranges[:, worst]
    text = f"is {values[worst]:.3g}; {box.source} {low:.3g} to {high:.3g}"
    return [Departure(f"novelty: {sentence}", text)]
