"""The reward that a learner gets: a table of terms, each with a weight, added up in every step.

Weights are in points: the paper's sparse reward is the rows ``violation``, ``goal`` and
``timeout``, of which alone scores are made. A term of the user's own has the same form as those of
:data:`TERMS`. It comes in by a call (:func:`register`) or by a name of the form ``module:name``
that the user writes in a configuration or a call (:func:`table`). A policy file names the terms
that it was trained with; reading it imports nothing.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from commands.command import InputError
from commands.extension import failure
from commands.registry import Registry
from envs.aircraft import Aircraft
from envs.arrays import Array, ArrayModule
from envs.encounters import Encounter
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.relative import distance
from envs.world import State, StepResult, World, begin
from envs.world import step as advance_step

DETOUR = 4.0
"""Metres of way round for each metre that the goal lies inside the turning circle; from its centre,
a radius inside, the shortest way is 4.5 radii.
"""


class RewardError(InputError):
    """An impossible reward; the message says which term and why."""


class Transition(NamedTuple):
    """A step of encounters ``[...]`` as a term sees it."""

    before: State
    after: State
    action: tuple[Array, Array]  # acceleration and yaw rate as commanded; 1 is the limit
    result: StepResult  # outcome, smallest separations during the step, distance to the goal
    aircraft: Aircraft  # the ownship; its limits are numbers or [...]


class Term(NamedTuple):
    """A term of the reward, to be weighted."""

    compute: Callable[..., Any]
    """(:class:`Transition`, numpy or jax.numpy) -> ``[...]``; of a potential (State, Aircraft,
    numpy or jax.numpy) -> ``[...]``."""
    meaning: str  # of a value of 1, in a sentence
    potential: bool = False
    """Whether the reward is the discounted gain in what is computed, which leaves the optimal
    policy as it is (Ng, Harada, Russell 1999)."""


class Row(NamedTuple):
    """A term of a table with its weight, points."""

    name: str
    term: Term
    weight: float


class Rewards(NamedTuple):
    """A table of rewards; hashable, so that a step can be compiled for it."""

    rows: tuple[Row, ...] = ()

    @property
    def shaping(self) -> tuple[Row, ...]:
        """The rows beside those of the task."""
        return tuple(row for row in self.rows if row.name not in TASK)


def goal_distance(state: State, aircraft: Aircraft, xp: ArrayModule) -> Array:
    """Return the potential of the way to the goal, ``[...]``, in ten separations.

    It counts the distance, and the way round where the goal lies inside the turning circle. Without
    the way round, circling the goal for ever would be no worse than leaving it to come back.
    """
    own, x, y = state.own, state.goal_x - state.own.x, state.goal_y - state.own.y
    radius = own.speed / aircraft.limits.yaw_rate_max
    sine, cosine = xp.sin(own.heading), xp.cos(own.heading)
    # The centre of the turning circle on the goal's side lies abeam.
    from_centre = distance(x * cosine + y * sine, xp.abs(y * cosine - x * sine) - radius, xp)
    inside = xp.maximum(radius - aircraft.goal_radius - from_centre, 0.0)
    return -(distance(x, y, xp) + DETOUR * inside) * (0.1 / aircraft.separation)


def turn_rate(step: Transition, xp: ArrayModule) -> Array:
    """Return the squared turn rate as flown, ``[...]``, from commands of which 1 is the limit."""
    return xp.square(xp.clip(step.action[1], -1.0, 1.0))


def heading_change(step: Transition, xp: ArrayModule) -> Array:
    """Return the change of heading, in quarter turns, ``[...]``."""
    limit, dt = step.aircraft.limits.yaw_rate_max, step.aircraft.dt
    turned = xp.abs(xp.clip(step.action[1], -1.0, 1.0)) * (limit * dt)
    return turned / (0.5 * xp.pi)


def path_excess(step: Transition, xp: ArrayModule) -> Array:
    """Return the path of a step less what it brought the goal nearer, in ten separations,
    ``[...]``.

    The discount alone favours short times, and so a fast detour over a slow straight path.
    """
    before, after = step.before.own, step.after.own
    goal_x, goal_y = step.before.goal_x, step.before.goal_y

    def distance_to_goal(own: VehicleState[Air]) -> Array:
        return distance(goal_x - own.x, goal_y - own.y, xp)

    path = distance(after.x - before.x, after.y - before.y, xp)
    return (0.1 / step.aircraft.separation) * (
        path - (distance_to_goal(before) - distance_to_goal(after))
    )


def _violation(step: Transition, xp: ArrayModule) -> Array:
    return xp.where(step.result.outcome.violation, 1.0, 0.0)


def _goal(step: Transition, xp: ArrayModule) -> Array:
    return xp.where(step.result.outcome.reached, 1.0, 0.0)


def _timeout(step: Transition, xp: ArrayModule) -> Array:
    return xp.where(step.result.outcome.timeout, 1.0, 0.0)


TERMS: dict[str, Term] = {
    "violation": Term(_violation, "A lost separation, which ends the encounter."),
    "goal": Term(_goal, "A goal reached, which ends the encounter."),
    "timeout": Term(_timeout, "A goal missed at the time limit, which ends the encounter."),
    "goal_distance": Term(
        goal_distance, "Ten separations nearer to the goal, a potential.", potential=True
    ),
    "turn_rate": Term(
        turn_rate, "A time step at the full turn rate; half of it counts as a quarter."
    ),
    "heading_change": Term(heading_change, "90 degrees of turning, to either side, at any rate."),
    "path_excess": Term(path_excess, "Ten separations flown that bring the goal no nearer."),
}
"""The terms of the toolkit, by name."""

TASK: dict[str, str] = {
    "violation": "reward_violation",
    "goal": "reward_goal",
    "timeout": "reward_timeout",
}
"""The rows that are the task's own, by the field of :class:`envs.outcome.Rules` that holds their
weight: scores are made of them alone."""

REWARD_TERMS: Registry[Term] = Registry(
    "reward", "a reward term (envs.rewards.Term)", Term, RewardError, TERMS
)
"""All terms that this process knows, by name."""


def register(name: str, term: Term) -> Term:
    """Make a term of the user's own known in this process under a name, and return it.

    One of the same name is replaced, as when a notebook's cell is run again.

    Raises:
        RewardError: it is no term, or the toolkit has one of that name.
    """
    return REWARD_TERMS.register(name, term)


def resolve(name: str) -> Term:
    """Return the term that the user names; ``module:name`` is loaded and registered.

    Call this only with what the user has written by hand, never with what a policy file says.

    Raises:
        RewardError: there is no such term, or it is none.
    """
    return REWARD_TERMS.resolve(name)


def table(weights: Mapping[str, float]) -> Rewards:
    """Return the table of weights in points by the names of terms, without those of no weight.

    Raises:
        RewardError: a weight is not a finite number; as :func:`resolve`, which this does for every
            name.
    """
    _check_weights(weights)
    rows = (Row(name, resolve(name), float(weight)) for name, weight in weights.items() if weight)
    return Rewards(tuple(rows))


def with_scores(rules: Rules, weights: Mapping[str, float]) -> Rules:
    """Return the rules with the scores that a table of weights gives to the task's own rows; raises
    a RewardError where a weight is not a finite number.
    """
    _check_weights(weights)
    return rules._replace(
        **{field: weights[name] for name, field in TASK.items() if name in weights}
    )


def _check_weights(weights: Mapping[str, float]) -> None:
    for name, weight in weights.items():
        number = isinstance(weight, (int, float, np.number)) and not isinstance(weight, bool)
        if not (number and math.isfinite(weight)):
            raise RewardError(f"reward {name!r} weighs {weight!r}; expected a finite number")


def learning_reward(
    rewards: Rewards, step: Transition, discount: float, xp: ArrayModule, scale: float = 1.0
) -> tuple[Array, dict[str, Array]]:
    """Return the reward of a step of encounters that may have ended, ``[...]``, points times a
    scale, and what each shaping term adds to it.

    The task's rows are those of the rules by which the step was judged.
    """
    total = scale * step.result.reward
    parts = {row.name: part(row, step, discount, xp, scale) for row in rewards.shaping}
    for row in rewards.shaping:
        total = total + parts[row.name]
    return total, parts


def part(row: Row, step: Transition, discount: float, xp: ArrayModule, scale: float = 1.0) -> Array:
    """Return what a term adds to the reward of a step, ``[...]``, points times a scale.

    Raises:
        RewardError: a term of the user's own fails, or computes something of another shape.
    """
    weight, aircraft = scale * row.weight, step.aircraft
    try:
        if row.term.potential:
            states = step.before, step.after
            before, after = (weight * row.term.compute(state, aircraft, xp) for state in states)
            values = shaping_reward(before, after, step.after.ended, discount, xp)
        else:
            values = weight * row.term.compute(step, xp)
    except Exception as problem:
        raise RewardError(f"reward {row.name!r}: {failure(problem)}") from problem
    expected = getattr(step.before.goal_x, "shape", ())
    if getattr(values, "shape", ()) != expected:
        raise RewardError(
            f"reward {row.name!r}: computes shape {getattr(values, 'shape', ())} for encounters "
            f"{expected}; expected one number each"
        )
    return values


def shaping_of_first_step(
    rewards: Rewards, starts: Encounter, world: World, xp: ArrayModule
) -> dict[str, Array]:
    """Return what the shaping terms add to the reward of the first step of encounters ``[N]``.

    A training calls it before it begins, so that what cannot be used fails then.
    """
    before, zeros = begin(starts, xp), xp.zeros_like(starts.goal_x)
    action = zeros, zeros
    after, result = advance_step(before, action, world, xp)
    return learning_reward(
        rewards, Transition(before, after, action, result, world.aircraft), 1.0, xp
    )[1]


def shaping_reward(
    before: Array, after: Array, terminated: Array, discount: float, xp: ArrayModule
) -> Array:
    """Return the shaping reward of a step: the discounted gain in potential, which is 0 once
    terminated.
    """
    return discount * xp.where(terminated, 0.0, after) - before
