"""Plans from the middle of flights, for the loops that fly: what is tried, one after the other, and
when again.

A plan that is SAFE now may leave no room for a turn of an intruder, pass over the goal or reach it
too late. So the best is tried first, and again every few seconds while something less is flown.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from agents.assurance.climbs import Met
from agents.assurance.monitor import Decision, Monitor, Thresholds, activate, answer
from agents.planner.request.options import Narrowed, Options
from agents.planner.search.candidates import Candidates, empty
from envs.arrays import Array, Bool
from envs.trees import scatter, take

WIDE, IN_TIME, ALONG = range(3)
"""Kinds of plans: to the goal with distance and time to spare; to the goal in time; along the
route.
"""

Planner = Callable[[Array, Options[Narrowed], int], Candidates]
"""Makes plans for some rows, numbers ``[m]``, with options, of a kind."""

Meets = Callable[[Array, Candidates], Met]
"""What plans of some rows, numbers ``[m]``, that climb or descend meet from now on."""

_SPARE = 0.5  # separations that a wide plan keeps beyond what is required
_LEFT = 0.25  # of these, what must be left
_SOON = (
    0.8  # share of the time left by which a wide plan is at the goal: later plans may need the rest
)
_AGAIN = 5  # time steps from one attempt at a better kind to the next


def tries(
    options: Options[Narrowed], time_left: float
) -> tuple[Options[Narrowed], Options[Narrowed], Options[Narrowed]]:
    """Return how to plan for each kind, with ``time_left`` seconds until the goal is missed."""
    # The refinement takes longer than a monitor can wait.
    along = replace(options, exhaustive=False)
    in_time = replace(along, goals=1, rejoin_by=min(time_left, options.rejoin_by))
    required = options.requirement
    wide = required._replace(margin=required.margin + _SPARE * options.aircraft.separation)
    return (
        replace(in_time, requirement=wide, rejoin_by=min(_SOON * time_left, options.rejoin_by)),
        in_time,
        along,
    )


def renew(
    monitor: Monitor,
    decision: Decision,
    short: Bool[Array, " N"],
    reached: Bool[Array, " N"],
    time_left: float,
    make: Planner,
    thresholds: Thresholds[Narrowed],
    meets: Meets | None = None,
) -> tuple[Monitor, Array, Array, Array | None]:
    """Plan where the monitor asks for it, and where a better kind of plan may be had than the one
    that is flown.

    Args:
        short: whether the plan that is flown passes over the goal, or gets there too late.
        reached: whether the goal was reached; ``time_left``: seconds until it is missed.
        meets: of plans that may climb and descend; None: they are in the plane.

    Returns:
        The monitors, ``short`` of what they fly now, which have asked for a plan, ``[N]``, and the
        profiles of the plans that were taken up now, object ``[N]``, None where none was. None:
        they are in the plane.
    """
    taken_up = None if meets is None else np.full(short.size, None, dtype=object)
    options, unit = tries(thresholds.options, time_left), thresholds.options.aircraft
    short, requested = np.array(short), np.array(decision.replan)
    rows = np.flatnonzero(requested)
    if rows.size:
        first = np.where(reached[rows], ALONG, WIDE)
        candidates, kind = _plan(make, options, rows, first, np.full(rows.size, ALONG))
        monitor, accepted = answer(
            monitor,
            rows,
            decision.number[rows],
            candidates.plan_states,
            candidates.safe,
            thresholds,
            None if meets is None else meets(rows, candidates),
        )
        short[rows[accepted]] = kind[accepted] == ALONG
        if taken_up is not None and candidates.profile is not None:
            taken_up[rows[accepted]] = candidates.profile[accepted]

    narrow = decision.separation < (1.0 + _LEFT) * unit.separation
    due = np.rint(monitor.memory.time / unit.dt) % _AGAIN == 0.0
    rows = np.flatnonzero(due & (short | narrow) & ~reached & ~monitor.on_backup & ~requested)
    if rows.size:
        candidates, _ = _plan(
            make, options, rows, np.full(rows.size, WIDE), np.where(short[rows], IN_TIME, WIDE)
        )
        rows, plans = rows[candidates.safe], take(candidates, candidates.safe)
        traffic, when = take((decision.traffic, monitor.memory.time), rows)
        if meets is not None:
            traffic = traffic._replace(window=meets(rows, plans).all_times)
        monitor = activate(monitor, rows, plans.plan_states, plans.safe, when, traffic, thresholds)
        short[rows], requested[rows] = False, True
        if taken_up is not None and plans.profile is not None:
            taken_up[rows] = plans.profile
    return monitor, short, requested, taken_up


def _plan(
    make: Planner, options: tuple[Options[Narrowed], ...], rows: Array, first: Array, last: Array
) -> tuple[Candidates, Array]:
    """Try one kind of plan after the other, of each row from its first to its last, until one is
    SAFE, ``[m]``.
    """
    best = empty(rows.size, options[0].waypoints, in_space=options[0].climbs)
    kind = np.array(last)
    for number, kind_options in enumerate(options):
        open_rows = np.flatnonzero(~best.safe & (first <= number) & (number <= last))
        if open_rows.size:
            scatter(best, open_rows, make(rows[open_rows], kind_options, number))
            kind[open_rows] = number
    return best, kind
