"""Which encounters the report shows: the points in its plots, and those whose flights it replays."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eval.plots.style import spread
from eval.report.folder import Run

__all__ = ["NEAR", "NEAREST", "OTHERS", "POINTS", "Choice", "choose", "points"]

NEAR = 1.05  # a success that came nearer than this times the required separation is a near miss
NEAREST, OTHERS, POINTS = 200, 100, 20_000
"""At most so many near misses and other successes are replayed; at most so many encounters are points."""


class Choice(NamedTuple):
    """Encounters of one group that are replayed."""

    group: str
    numbers: np.ndarray  # of the encounters, in the order of their importance
    total: int  # encounters in the group


def choose(run: Run, most: int, wanted: Sequence[int] = ()) -> list[Choice]:
    """Return the groups of encounters to replay, at most so many in all: those wanted and the most important first."""
    kinds, separation = run.kinds, run.table["min_separation_m"]
    success = kinds == "success"
    near = success & (separation < NEAR * run.rules.separation)
    nearest = np.flatnonzero(near)
    nearest = nearest[np.argsort(separation[nearest], kind="stable")]
    # Failures that count, what no policy could have solved, and a look at how it usually goes.
    groups = (
        ("asked for", np.array(wanted, dtype=int), most),
        ("failures", np.flatnonzero((kinds == "violation") | (kinds == "time-out")), most),
        ("proven unresolvable", np.flatnonzero(kinds == "proven unresolvable"), most),
        ("near misses", nearest, NEAREST),
        ("other successes", np.flatnonzero(success & ~near), OTHERS),
    )
    left, taken, chosen = most, np.array([], dtype=int), []
    for name, found, bound in groups:
        fresh = found[~np.isin(found, taken)]
        count = min(left, bound, len(fresh))
        numbers = fresh[:count] if name == "near misses" else spread(fresh, count)
        taken, left = np.concatenate([taken, numbers]), left - count
        chosen.append(Choice(name, numbers, len(found)))
    return [choice for choice in chosen if choice.total]


def points(run: Run, replayed: np.ndarray) -> np.ndarray:
    """Return the numbers of the encounters that are points: all, or those replayed, failures and an even sample."""
    everything = np.arange(len(run.kinds))
    if len(everything) <= POINTS:
        return everything
    failures = np.setdiff1d(np.flatnonzero(run.kinds != "success"), replayed)
    kept = np.concatenate([replayed, spread(failures, POINTS // 2)])
    rest = np.setdiff1d(everything, kept)
    return np.sort(np.concatenate([kept, spread(rest, max(0, POINTS - len(kept)))]))
