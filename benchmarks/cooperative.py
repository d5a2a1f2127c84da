"""Many aircraft that all fly the policy: ``python -m benchmarks.cooperative [--policy FILE]``.

A *ring*: aircraft at even bearings on a circle, each with its goal on the other side. A *square*:
starts and goals at random in it. Each decides once a second by its own view of all others in
flight; who arrives leaves the sky. What counts is the pairs that lose the separation.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.baselines.baselines import Observation, StepResolver
from agents.policy.inference import Policy
from benchmarks.measure import report, request_options, show
from commands.command import Parser, run_cli
from envs.aircraft import Aircraft
from envs.frames import Air
from envs.kinematics import VehicleState, advance, commands
from envs.relative import distance, leg_separation
from envs.trees import map_leaves
from eval.flights.compiled import Compiled

_SPEEDS = 0.7, 1.0  # at the start, in the greatest
_JITTER = 0.5  # of the starts on a ring, D to either side
_APART = 2.0  # least distance of two starts in a square, D
_FAR = 8.0  # least distance from a start to its goal there, D
_PATIENCE = 6.0  # of the direct way's duration at the greatest speed, after which a draw ends


class Sky(NamedTuple):
    """Starts and goals of M aircraft in each of N draws; fields ``[N, M]``, SI."""

    start: VehicleState[Air]
    goal_x: np.ndarray
    goal_y: np.ndarray


class Outcome(NamedTuple):
    """What became of N draws."""

    pairs: np.ndarray  # that lost the separation, [N]
    late: np.ndarray  # aircraft that have not arrived, [N]
    path_excess: float  # mean of those that have, as a share of the direct way


def ring(rng: np.random.Generator, count: int, aircraft: int, radius: float, unit: Aircraft) -> Sky:
    """Return draws of aircraft on a circle of a radius, D."""
    bearing = 2.0 * math.pi * np.arange(aircraft) / aircraft + rng.uniform(0.0, 7.0, (count, 1))
    far = radius * unit.separation
    x, y = far * np.cos(bearing), far * np.sin(bearing)
    moved_x, moved_y = _JITTER * unit.separation * rng.uniform(-1.0, 1.0, (2, count, aircraft))
    return _towards(rng, (x + moved_x, y + moved_y), (-x, -y), unit)


def square(rng: np.random.Generator, count: int, aircraft: int, side: float, unit: Aircraft) -> Sky:
    """Return draws of starts and goals that are random in a square with a side, D."""
    starts, goals = np.zeros((2, 2, count, aircraft))
    for n in range(count):
        for m in range(aircraft):
            while True:
                start, goal = rng.uniform(0.0, side, (2, 2))
                near = np.hypot(*(starts[:, n, :m] - start[:, None])) < _APART
                if np.hypot(*(goal - start)) >= _FAR and not near.any():
                    break
            starts[:, n, m], goals[:, n, m] = start, goal
    return _towards(rng, unit.separation * starts, unit.separation * goals, unit)


def _towards(rng: np.random.Generator, start: Any, goal: Any, unit: Aircraft) -> Sky:
    """Return aircraft that head for their goals at random speeds."""
    (x, y), (goal_x, goal_y) = start, goal
    speed = unit.limits.speed_max * rng.uniform(*_SPEEDS, x.shape)
    return Sky(VehicleState(x, y, np.arctan2(goal_y - y, goal_x - x), speed), goal_x, goal_y)


def fly(sky: Sky, resolver: StepResolver, unit: Aircraft) -> Outcome:
    """Fly draws until all have arrived, or none should be under way any more; each aircraft decides
    by the resolver.
    """
    count, aircraft = sky.goal_x.shape
    beside = np.array([np.delete(np.arange(aircraft), number) for number in range(aircraft)])
    own, flies = sky.start, np.ones((count, aircraft), dtype=bool)
    lost = np.zeros((count, aircraft, aircraft), dtype=bool)
    direct = distance(sky.goal_x - own.x, sky.goal_y - own.y, np)
    length, to_goal = np.zeros_like(direct), direct
    steps = math.ceil(_PATIENCE * direct.max() / unit.limits.speed_max / unit.dt)
    for _ in range(steps):
        n, m = np.nonzero(flies)
        if n.size == 0:
            break
        others: VehicleState[Air] = VehicleState(*(field[n[:, None], beside[m]] for field in own))
        observation = Observation(
            VehicleState(*(field[n, m] for field in own)),
            others,
            flies[n[:, None], beside[m]],
            sky.goal_x[n, m],
            sky.goal_y[n, m],
            math.inf,
        )
        action = np.zeros((2, count, aircraft))
        action[:, n, m] = resolver.decide(observation, np.zeros(n.size))[0].T
        moved = advance(own, *commands(tuple(action), unit.limits, np), unit.dt, unit.limits, np)
        lost |= _lost(own, moved, flies, unit)
        length += np.where(flies, 0.5 * unit.dt * (own.speed + moved.speed), 0.0)
        own = moved
        to_goal = np.where(flies, distance(sky.goal_x - own.x, sky.goal_y - own.y, np), to_goal)
        flies &= to_goal > unit.goal_radius
    excess = ((length + to_goal) / direct - 1.0)[~flies]
    return Outcome(lost.sum(axis=(1, 2)) // 2, flies.sum(axis=1), float(excess.mean()))


def _lost(
    before: VehicleState[Air], after: VehicleState[Air], flies: np.ndarray, unit: Aircraft
) -> Any:
    """Return which pairs lose the separation in a step, bool ``[N, M, M]``."""
    ends = before, after
    first, first_next = map_leaves(lambda field: field[:, :, None], ends)
    second, second_next = map_leaves(lambda field: field[:, None, :], ends)
    apart = leg_separation(first, first_next, second, second_next, unit.dt, np)
    pairs = flies[:, :, None] & flies[:, None, :] & ~np.eye(flies.shape[1], dtype=bool)
    return pairs & (apart < unit.separation)


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    request_options(parser, 100)
    options = parser.parse_args()
    policy = Policy.load(options.policy)
    unit = policy.aircraft
    policy = policy.for_aircraft(unit, outside="allow")
    for name, draw in (
        ("ring of 12 D, 16 aircraft", partial(ring, aircraft=16, radius=12.0)),
        ("square of 32 D, 32 aircraft", partial(square, aircraft=32, side=32.0)),
    ):
        rng = np.random.default_rng(options.seed)
        outcome = fly(draw(rng, options.requests, unit=unit), Compiled(policy), unit)
        figures = {
            "benchmark": "cooperative",
            "sky": name,
            "draws": options.requests,
            "pairs_lost_a_draw": float(outcome.pairs.mean()),
            "draws_with_a_loss": int(np.count_nonzero(outcome.pairs)),
            "late": int(outcome.late.sum()),
            "path_excess": outcome.path_excess,
        }
        show(figures)
        report(figures, ("numpy", "jax"))


if __name__ == "__main__":
    run_cli(main)
