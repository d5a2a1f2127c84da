"""Failures of a run in groups: how they fail, at which angle between the courses, from which distance."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from eval.plots.style import spread

__all__ = ["HOW", "Group", "described", "failures", "grouped", "representatives"]

HOW = ("near miss", "deep loss", "time-out")
_DEEP = 0.95  # a violation that keeps this share of the separation is a near miss
# Ranges of the angle between the courses at the start, degrees; the upper end of the last belongs to it.
_COURSES = ((0.0, 30.0), (30.0, 60.0), (60.0, 135.0), (135.0, 180.0))
# Ranges of the distance to the nearest intruder at the start, in required separations.
_DISTANCES = ((0.0, 1.5), (1.5, 3.0), (3.0, np.inf))


class Group(NamedTuple):
    """Failures of a kind."""

    how: str  # one of HOW
    course: tuple[float, float]  # deg
    distance: tuple[float, float]  # m
    members: np.ndarray  # numbers of its encounters
    such: int  # encounters of the run with such courses and distances that are not proven unresolvable


def failures(table: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return which encounters of a run failed and are not proven unresolvable, bool ``[N]``."""
    return (table["outcome"] != "reached") & (table["verdict"] != "unresolvable")


def grouped(table: Mapping[str, np.ndarray], separation: float) -> list[Group]:
    """Return the groups that hold failures, the largest first, of a run's table with the required separation, m."""
    angle, distance = np.abs(table["relative_heading_deg"]), table["distance_m"]
    possible, failed = table["verdict"] != "unresolvable", failures(table)
    violated = table["outcome"] == "violation"
    near = table["min_separation_m"] >= _DEEP * separation
    kinds = (violated & near, violated & ~near, ~violated)
    found = []
    for course in _COURSES:
        within = (angle >= course[0]) & ((angle < course[1]) | (course == _COURSES[-1]))
        for reach in ((low * separation, high * separation) for low, high in _DISTANCES):
            there = within & (distance >= reach[0]) & (distance < reach[1])
            such = int(np.count_nonzero(there & possible))
            for how, kind in zip(HOW, kinds, strict=True):
                members = np.flatnonzero(there & failed & kind)
                if members.size:
                    found.append(Group(how, course, reach, members, such))
    return sorted(found, key=lambda group: -group.members.size)


def representatives(groups: list[Group], count: int) -> list[int]:
    """Return up to ``count`` encounters to look at, as many of each group as is its share, at least one of the largest.

    Within a group they are spread evenly over the numbers, so that no choice is made by hand.
    """
    total = sum(group.members.size for group in groups)
    chosen: list[int] = []
    for group in groups:
        share = min(max(1, round(count * group.members.size / max(total, 1))), group.members.size, count - len(chosen))
        chosen += spread(group.members, share).tolist()
    return chosen


def described(group: Group, table: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return a group in JSON types."""
    rows, (low, high) = group.members, group.distance
    return {
        "how": group.how,
        "course_difference_deg": list(group.course),
        "distance_m": [low, None if np.isinf(high) else high],
        "failures": int(rows.size),
        "such_encounters": group.such,
        "min_separation_m_median": float(np.median(table["min_separation_m"][rows])),
        "t_cpa_s_median": float(np.nanmedian(table["t_cpa_s"][rows])),
        "goal_distance_m_median": float(np.median(table["goal_distance_m"][rows])),
    }
