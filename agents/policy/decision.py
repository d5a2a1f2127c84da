"""A decision of the policy for one aircraft, in plain floats and loops: what is compiled
(:mod:`envs.compiled`) for the planner's flights, in which one decision follows from the other.

Without numba :meth:`agents.policy.set_network.SetNetwork.scalar_action` gives the same, by numpy.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from agents.policy.candidate_manoeuvres import (
    COUNT,
    THROTTLES,
    ScalarMinSeparation,
    scalar_min_separations,
    scalar_turns,
)
from agents.policy.scene import scalar_mirror, scalar_scene
from agents.policy.set_features import ALIKE, course_to_goal, intruder_part, margin_of, own_part
from envs.aircraft import ratios
from envs.arrays import Array
from envs.backend import FLOATS
from envs.compiled import Entry, scalar
from envs.frames import Air
from envs.kinematics import Limits, VehicleState

Layers = list[tuple[np.ndarray, np.ndarray]]
"""Kernel ``[in, out]`` and bias ``[out]`` of each."""


class FlatLayers(NamedTuple):
    """Layers of a network, one after the other in one array, so that all networks are of one type
    for the compiler.
    """

    sizes: np.ndarray  # numbers that go into the first layer, and come out of each, [L + 1]
    values: np.ndarray  # of each layer the kernel, row by row, and the bias


class Decider(NamedTuple):
    """A policy for an aircraft, as compiled code takes it."""

    limits: Limits  # of the aircraft
    separation: float  # m
    fixed: np.ndarray  # as of :func:`agents.policy.candidate_manoeuvres.scalar_min_separations`
    acceleration: np.ndarray
    encoder: FlatLayers  # of each intruder
    trunk: FlatLayers


def _flat(layers: Layers) -> FlatLayers:
    sizes = [len(layers[0][0]), *(len(bias) for _, bias in layers)]
    values = [part.ravel() for layer in layers for part in layer]
    return FlatLayers(np.array(sizes), np.concatenate(values))


def decider(
    limits: Limits,
    separation: float,
    min_separation: ScalarMinSeparation,
    encoder: Layers,
    trunk: Layers,
) -> Decider:
    """Return a policy for an aircraft of some limits and separation, m."""
    return Decider(
        Limits(*map(float, limits)),
        float(separation),
        min_separation.fixed,
        min_separation.acceleration,
        _flat(encoder),
        _flat(trunk),
    )


def example(dtype: DTypeLike = np.float32) -> Decider:
    """Return a policy of the types that compiled code takes: a network in float32."""
    layers: Layers = [(np.zeros((1, 1), dtype), np.zeros(1, dtype))]
    limits = Limits(1.0, 2.0, -1.0, 1.0, 1.0)
    return decider(limits, 1.0, ScalarMinSeparation(ratios(limits, 1.0)), layers, layers)


@scalar
def decide(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    distance_scale: np.ndarray,
    goal_x: float,
    goal_y: float,
    decider: Decider,
) -> tuple[float, float]:
    """Return throttle and steering, not clipped.

    Args:
        own: state, floats in SI units.
        intruders: states of those that are looked at, arrays ``[K]``.
        distance_scale: of each, ``[K]``; 1: it has the aircraft's separation.
        goal_x: m.
        goal_y: m.
        decider: the policy.
    """
    mine, traffic, sign = inputs_of(own, intruders, distance_scale, goal_x, goal_y, decider)
    encoder, trunk = decider.encoder, decider.trunk
    inputs = np.empty(trunk.sizes[0], trunk.values.dtype)
    inputs[: mine.size] = mine
    inputs[mine.size :] = -1.0
    for k in range(len(traffic)):
        code = through(traffic[k].astype(encoder.values.dtype), encoder, True)
        for i in range(code.size):
            inputs[mine.size + i] = max(inputs[mine.size + i], code[i])
    action = through(inputs, trunk, False)
    return float(action[0]), float(action[1]) * sign


@scalar
def inputs_of(
    own: VehicleState[Air],
    intruders: VehicleState[Air],
    distance_scale: np.ndarray,
    goal_x: float,
    goal_y: float,
    decider: Decider,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the inputs of the aircraft, those of each intruder, and how the scene is mirrored, 1
    or -1; arguments as of :func:`decide`.
    """
    unmirrored = scalar_scene(
        own, intruders, goal_x, goal_y, decider.limits, decider.separation, FLOATS
    )
    scene, sign = scalar_mirror(unmirrored, distance_scale, FLOATS)
    separation = scalar_min_separations(scene, distance_scale, decider.fixed, decider.acceleration)
    margin, best = _margins(separation, scalar_turns(scene))
    flight = own_part(scene, 0.0, FLOATS)
    mine = np.empty(len(flight) + len(best) + COUNT)
    _write(mine, flight + best)
    mine[len(flight) + len(best) :] = margin
    course = course_to_goal(scene, FLOATS)
    traffic = np.empty((len(scene.x), decider.encoder.sizes[0]))
    for k in range(len(scene.x)):
        numbers = intruder_part(
            scene.x[k],
            scene.y[k],
            scene.vx[k],
            scene.vy[k],
            distance_scale[k],
            scene.own_speed,
            course,
            FLOATS,
        )
        _write(traffic[k], numbers)
    return mine, traffic, sign


@scalar
def _write(into: np.ndarray, numbers: tuple[float, ...]) -> None:
    """Write numbers into the first places of an array."""
    for i in range(len(numbers)):
        into[i] = numbers[i]


@scalar
def _margins(
    separation: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, tuple[float, float, float]]:
    """Return how far manoeuvres stay beyond the required separation, squashed, ``[22]``, and the
    margin, throttle and turn of the best, as :mod:`agents.policy.set_features` defines it.
    """
    margin = np.empty(COUNT)
    for m in range(COUNT):
        margin[m] = margin_of(separation[m], FLOATS)
    most, whole, throttle, turn = margin.max(), 0.0, 0.0, 0.0
    for m in range(COUNT):
        behind = (most - margin[m]) * (1.0 / ALIKE)
        share = 1.0 / (1.0 + behind * behind)
        whole += share
        throttle += share * THROTTLES[m]
        turn += share * turns[m]
    return margin, (most, throttle / whole, turn / whole)


@scalar
def through(numbers: np.ndarray, layers: FlatLayers, last_too: bool) -> Array:
    """Return the output of layers with tanh between them, and after the last if asked."""
    at, count = 0, len(layers.sizes) - 1
    for number in range(count):
        # Slices from 0 on and loops over columns: vector instructions without a change of order.
        width = layers.sizes[number + 1]
        after = np.zeros(width, numbers.dtype)
        for i in range(layers.sizes[number]):
            row, factor = layers.values[at : at + width], numbers[i]
            for j in range(width):
                after[j] += factor * row[j]
            at += width
        bias = layers.values[at : at + width]
        at += width
        for j in range(width):
            after[j] += bias[j]
        if last_too or number < count - 1:
            for j in range(width):
                after[j] = math.tanh(after[j])
        numbers = after
    return numbers


def examples(dtype: DTypeLike = np.float32) -> list[tuple[object, ...]]:
    """Return arguments of :func:`decide` and :func:`inputs_of`."""
    zero = np.zeros(1)
    own: VehicleState[Air] = VehicleState(0.0, 0.0, 0.0, 1.0)
    intruders: VehicleState[Air] = VehicleState(zero, zero, zero, zero)
    return [(own, intruders, zero, 0.0, 0.0, example(dtype))]


INPUTS_OF = Entry(inputs_of, examples)
"""Compiled :func:`inputs_of`."""
