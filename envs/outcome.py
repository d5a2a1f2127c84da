"""The rules of an encounter: when it ends, how, and what reward the paper gives (its tables 2 and
3).
"""

from typing import NamedTuple

from envs.arrays import Array, ArrayModule


class Rules(NamedTuple):
    """Numbers of the task, SI units; floats, so that they can be data of a compiled function."""

    dt: Array = 1.0  # time step, s
    t_max: Array = 300.0  # duration after which the route counts as missed, s
    separation: Array = 1000.0  # required horizontal separation, m
    goal_radius: Array = 500.0
    """Distance from the goal at which the ownship has rejoined its route, m; the paper leaves it
    open."""
    reward_violation: Array = -100.0
    reward_goal: Array = 100.0
    reward_timeout: Array = -10.0


RULES = Rules()


class Outcome(NamedTuple):
    """How encounters stand after a step, bool ``[...]``; at most one field of each is true."""

    violation: Array
    reached: Array
    timeout: Array

    def ended(self, xp: ArrayModule) -> Array:
        """Return whether the encounter is over, ``[...]``."""
        return xp.logical_or(self.violation, xp.logical_or(self.reached, self.timeout))


def judge(
    separation: Array, goal_distance: Array, time: Array, rules: Rules, xp: ArrayModule
) -> Outcome:
    """Judge a step by its smallest separation (m) and by goal distance (m) and time (s) at its end,
    ``[...]``.

    A loss of separation outweighs everything else in the same step; the goal the time limit.
    """
    violation = separation < rules.separation
    reached = xp.logical_and(goal_distance <= rules.goal_radius, xp.logical_not(violation))
    going_on = xp.logical_not(xp.logical_or(violation, reached))
    # Half a step of tolerance keeps the count of steps exact however time is rounded.
    timeout = xp.logical_and(time > rules.t_max - 0.5 * rules.dt, going_on)
    return Outcome(violation, reached, timeout)


def reward(outcome: Outcome, rules: Rules, xp: ArrayModule) -> Array:
    """Return the sparse reward of the step, ``[...]`` (paper, table "Surrogate environment reward
    function").
    """
    missed = xp.where(outcome.timeout, rules.reward_timeout, 0.0)
    return xp.where(
        outcome.violation,
        rules.reward_violation,
        xp.where(outcome.reached, rules.reward_goal, missed),
    )
