"""Whether a policy can turn to one side somewhere in a box of the intruder's state: proof,
counterexample or neither.

A sample of exact scenes that the policy answers finds counterexamples; bounds of the network over
the derived inputs (:mod:`eval.policy_map.enclosure`) prove that there are none. A box without
either is cut in two, up to a depth.
"""

from typing import NamedTuple

import numpy as np

from agents.policy.inference import Policy
from agents.policy.set_features import TABLE
from envs.aircraft import ratios
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from eval.policy_map.enclosure import Curve, Form, derived_inputs, line_along

VERIFIED, COUNTEREXAMPLE, OPEN = 0, 1, 2

_OWN = TABLE.own_size  # numbers that describe the ownship

# of an action: the policy flies in single precision, the bounds are of exact numbers
_ROUNDING = 1e-3
_SAMPLES = 64  # exact scenes of a box, half of them corners
_TIE = 1e-6  # more than what counts as on the line to the goal (agents.policy.scene)
_TOGETHER = 16  # boxes whose matrices stay in cache


class Scenes(NamedTuple):
    """Scenes of one intruder in the ownship's frame, x ahead and y left, in separations D and
    greatest speeds V.
    """

    pace: Array  # own speed, [N]
    goal: Array  # x and y, [N, 2]
    state: Array  # x, y, vx, vy of the intruder, velocity over the ground, [N, 4]


def answers(policy: Policy, scenes: Scenes) -> np.ndarray:
    """Return the turns that a policy commands, 1 at its greatest yaw rate, left positive,
    ``[N]``.
    """
    unit, fast = policy.aircraft.separation, policy.limits.speed_max
    x, y, vx, vy = (scenes.state[:, None, i] for i in range(4))
    zero = 0.0 * scenes.pace
    own: VehicleState[Air] = VehicleState(zero, zero, zero, fast * scenes.pace)
    intruder: VehicleState[Air] = VehicleState(
        unit * x, unit * y, np.arctan2(vy, vx), fast * np.hypot(vx, vy)
    )
    goal_x, goal_y = unit * scenes.goal.T
    return policy.command(own, intruder, np.ones((len(zero), 1), bool), goal_x, goal_y)[:, 1]


def decide(
    policy: Policy,
    scenes: Scenes,
    half: Array,
    side: Array,
    *,
    allowed: float,
    depth: int,
    seed: int,
) -> np.ndarray:
    """Return of each scene whether the policy can turn to a side within an error of the intruder's
    state, ``[N]``.

    The error ``half`` is of x, y, vx, vy, ``[4]``; a side is 1, left, or -1, right, ``[N]``. A turn
    up to ``allowed`` of the greatest yaw rate counts as none; a box is cut in two up to ``depth``
    times; the seed is of the sample.
    """
    sampled = _greatest_sampled_turn(policy, scenes, half, side, seed)
    decided = np.where(sampled > allowed, COUNTEREXAMPLE, VERIFIED)
    network = layers(policy)
    queue = _Boxes.about(scenes, np.flatnonzero(decided == VERIFIED), half)
    while len(queue.index):
        # The deepest first: a box that stays open ends the work on its scene.
        order = np.argsort(-queue.cuts, kind="stable")
        queue, boxes = queue.of(order[_TOGETHER:]), queue.of(order[:_TOGETHER])
        boxes = boxes.of(boxes.mirrored_so(scenes.goal[boxes.index]))
        middles = Scenes(scenes.pace[boxes.index], scenes.goal[boxes.index], boxes.middle)
        turn, weight = turns_of(network, _inputs(policy, middles, boxes.size, boxes.sign))
        turn = turn.line(boxes.sign * side[boxes.index], 0.0)
        doubtful = ~(turn.ends[1] <= allowed - _ROUNDING)  # inverted for nan
        boxes, weight = boxes.of(doubtful), weight[doubtful]
        decided[boxes.index[boxes.cuts >= depth]] = OPEN
        queue = queue.join(*boxes.halves(weight))
        queue = queue.of(decided[queue.index] == VERIFIED)
    return decided


class _Boxes(NamedTuple):
    """Parts of the boxes of scenes, of which nothing is proven yet; fields ``[B]``."""

    index: Array  # of the scene
    middle: Array  # of the intruder's x, y, vx, vy, [B, 4]
    size: Array  # half widths, [B, 4]
    sign: Array  # how the scene is mirrored, 1 or -1: both are asked where the box holds both
    cuts: Array  # how often it was cut in two

    @classmethod
    def about(cls, scenes: Scenes, index: Array, half: Array) -> "_Boxes":
        """Return the whole boxes of some scenes, each mirrored either way."""
        scene = np.tile(index, 2)
        size, sign = np.tile(half, (len(scene), 1)), np.repeat([1.0, -1.0], len(index))
        return cls(scene, scenes.state[scene], size, sign, 0 * scene)

    def of(self, chosen: Array) -> "_Boxes":
        """Return some of the boxes."""
        return _Boxes(*(field[chosen] for field in self))

    def mirrored_so(self, goal: Array) -> Array:
        """Return which boxes hold scenes that are mirrored so, by their goals ``[B, 2]``, bool
        ``[B]``.
        """
        cross = self.sign * (goal[:, 0] * self.middle[:, 1] - goal[:, 1] * self.middle[:, 0])
        spread = np.abs(goal[:, 0]) * self.size[:, 1] + np.abs(goal[:, 1]) * self.size[:, 0]
        return cross + spread >= -_TIE

    def halves(self, weight: Array) -> tuple["_Boxes", "_Boxes"]:
        """Return the boxes cut in two across the number that weighs most, ``[B, 4]``."""
        shift = 0.5 * self.size * np.eye(4)[weight.argmax(axis=-1)]
        smaller = self._replace(size=self.size - shift, cuts=self.cuts + 1)
        return (
            smaller._replace(middle=smaller.middle - shift),
            smaller._replace(middle=smaller.middle + shift),
        )

    def join(self, *others: "_Boxes") -> "_Boxes":
        """Return these boxes and others."""
        return _Boxes(*(np.concatenate(fields) for fields in zip(self, *others, strict=True)))


def box_of(policy: Policy, scenes: Scenes, half: Array) -> tuple[Form, np.ndarray]:
    """Return the derived inputs of scenes with an error ``[4]``, and how each is mirrored, 1 or -1,
    at its middle.
    """
    x, y = scenes.state[:, 0], scenes.state[:, 1]
    sign = np.where(scenes.goal[:, 0] * y - scenes.goal[:, 1] * x < 0.0, -1.0, 1.0)
    return _inputs(policy, scenes, np.tile(half, (len(x), 1)), sign), sign


def _inputs(policy: Policy, scenes: Scenes, size: Array, sign: Array) -> Form:
    flip, limits = np.stack([np.ones_like(sign), sign], axis=-1), policy.limits
    middle = scenes.state * np.tile(flip, 2)
    return derived_inputs(
        scenes.pace, scenes.goal * flip, middle, size, ratios(limits, policy.aircraft.separation)
    )


def turns_of(network: list[tuple[np.ndarray, np.ndarray]], inputs: Form) -> tuple[Form, np.ndarray]:
    """Return the network's yaw rate over its inputs, ``[N]``, and how much each of the four hangs
    in it, ``[N, 4]``.

    Every layer is bounded by lines back to the inputs (CROWN with parallel lines: a chord of tanh
    and its distances).
    """
    curves: list[tuple[Array, Array, Array]] = []
    form, size = inputs, np.zeros(0)
    for number, (kernel, bias) in enumerate(network):
        # From this layer back to the inputs: what it is of them, in the end.
        weights = np.broadcast_to(kernel.T, (len(inputs.middle), *kernel.T.shape))
        offset, remainder = bias, 0.0
        for (slope, middle, far), (below, shift) in zip(
            curves[::-1], network[:number][::-1], strict=True
        ):
            remainder, offset = (
                remainder + _times(np.abs(weights), far),
                offset + _times(weights, middle),
            )
            weights = weights * slope[:, None]
            offset, weights = offset + weights @ shift, weights @ below.T
        size = np.abs(weights)
        form = Form(
            _times(weights, inputs.middle) + offset,
            weights @ inputs.slopes,
            _times(size, inputs.remainder) + remainder,
        )
        if number < len(network) - 1:
            curves.append(line_along(*form.ends, _TANH))
            if number == 0:  # what describes the ownship passes the first layer as it is
                for field, value in zip(curves[0], (1.0, 0.0, 0.0), strict=True):
                    field[:, :_OWN] = value
    turn = Form(form.middle[:, 0], form.slopes[:, 0], form.remainder[:, 0])
    return turn, (size @ np.abs(inputs.slopes))[:, 0]


def layers(policy: Policy) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return kernels and biases for one intruder, up to the yaw rate; the first layer passes the
    ownship's numbers.
    """
    tensors = {name: tensor.astype(float) for name, tensor in policy.tensors.items()}
    encoder, bias = tensors["each_0/kernel"], tensors["each_0/bias"]
    first = np.zeros((_OWN + len(encoder), _OWN + len(bias)))
    first[:_OWN, :_OWN], first[_OWN:, _OWN:] = np.eye(_OWN), encoder
    hidden = range(len(policy.metadata["architecture"]["hidden"]))
    within = [
        (tensors[f"hidden_{number}/kernel"], tensors[f"hidden_{number}/bias"]) for number in hidden
    ]
    last = tensors["head/kernel"][:, 1:], tensors["head/bias"][1:]
    return [(first, np.append(np.zeros(_OWN), bias)), *within, last]


def _greatest_sampled_turn(
    policy: Policy, scenes: Scenes, half: Array, side: Array, seed: int
) -> Array:
    """Return the greatest turn to the side of the samples, ``[N]``."""
    shifts = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(side), _SAMPLES, 4))
    shifts[:, :16] = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 4), axis=-1).reshape(16, 4)
    shifts[:, 16] = 0.0
    pace, goal = (np.repeat(field, _SAMPLES, axis=0) for field in (scenes.pace, scenes.goal))
    states = (scenes.state[:, None] + shifts * half).reshape(-1, 4)
    turns = answers(policy, Scenes(pace, goal, states))
    return (turns.reshape(-1, _SAMPLES) * side[:, None]).max(axis=-1)


def _steepest(slope: Array) -> list[Array]:
    """Return where tanh has a slope."""
    x = np.arctanh(np.sqrt(np.clip(1.0 - slope, 0.0, 1.0 - 1e-15)))
    return [x, -x]


_TANH = Curve(np.tanh, _steepest)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
