"""A sheet of flights seen from above: the failures, and how the successes look beside them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from envs.outcome import Rules
from eval.flights.recorded import Recorded
from eval.plots.style import BLUE, GREEN, GREY, VERMILION, kinds_of

__all__ = ["PANELS", "chosen", "draw_tracks", "marks", "trajectory_sheet"]

PANELS = 12  # flights on the sheet
_FAILURES_SHOWN = 8
_ONE_KM = 1_000.0
_OWN: dict[str, Any] = {"color": BLUE, "linewidth": 1.5, "linestyle": "-", "marker": "o", "markersize": 5.0}
_INTRUDER: dict[str, Any] = {
    "color": VERMILION,
    "linewidth": 1.2,
    "linestyle": "--",
    "marker": "s",
    "markersize": 4.5,
}


def chosen(table: Mapping[str, np.ndarray]) -> list[int]:
    """Return the numbers of the encounters for the sheet: failures first, then successes, each spread evenly.

    The failures that count, those not proven unresolvable, come before the others.
    """
    kinds = kinds_of(table)
    order = [np.flatnonzero(kinds == name) for name in ("violation", "time-out", "proven unresolvable")]
    successes = np.flatnonzero(kinds == "success")
    room = min(PANELS, len(kinds))
    failures = min(sum(map(len, order)), max(_FAILURES_SHOWN, room - len(successes)))
    picked: list[int] = []
    for place, found in enumerate(order):
        # half of what is left for this kind, so that the rarer kinds are seen too.
        others = sum(map(len, order[place + 1 :]))
        left = failures - len(picked)
        picked += _spread(found, max(left - others, (left + 1) // 2))
    left = room - len(picked)
    special = [_spread(found, left // 3) for found in _special(table, successes)]
    picked += list(dict.fromkeys(number for found in special for number in found))
    return picked + _spread(np.setdiff1d(successes, picked), room - len(picked))


def _special(table: Mapping[str, np.ndarray], successes: np.ndarray) -> list[np.ndarray]:
    """Return the successes that had a new plan, and those by the fallback, where the table knows of plans."""
    found = []
    if "replans" in table:
        found.append(successes[table["replans"][successes] > 0])
    if "plan_source" in table:
        found.append(successes[table["plan_source"][successes] == "fallback"])
    return found


def _planned_by(table: Mapping[str, np.ndarray], number: int) -> str:
    """Return the source of the plan and the number of new ones, for a title."""
    if "plan_source" not in table:
        return ""
    refused = "" if table["plan_status"][number] == "safe" else ", unresolved"
    again = int(table["replans"][number]) if "replans" in table else 0
    return f"\n{table['plan_source'][number]}{refused}" + (f", {again} new plans" if again else "")


def trajectory_sheet(
    table: Mapping[str, np.ndarray],
    numbers: Sequence[int],
    flights: Recorded,
    rules: Rules,
) -> Figure:
    """Return a sheet of flights, seen from above.

    Args:
        table: of the encounters.
        numbers: of the encounters shown.
        flights: of them, in the same order.
        rules: of the task.
    """
    columns = 4
    lines = -(-len(numbers) // columns)
    figure = Figure(figsize=(13.0, 3.55 * lines + 0.6), layout="constrained")
    kinds = kinds_of(table)
    for i, number in enumerate(numbers):
        axes = figure.add_subplot(lines, columns, i + 1)
        own, others, separation = _tracks(flights, i)
        goal = float(flights.starts.goal_x[i]), float(flights.starts.goal_y[i])
        draw_tracks(axes, (own, others), separation, goal, rules)
        closest = table["min_separation_m"][number]
        text = f"{number}: {kinds[number]}, {closest:.0f} m, {table['duration_s'][number]:.0f} s"
        text += _planned_by(table, number)
        axes.set_title(text, fontsize=8.5, color="black" if kinds[number] == "success" else "#A63C00")
        if i % columns == 0:
            axes.set_ylabel("north, km", fontsize=8)
        if i + columns >= len(numbers):
            axes.set_xlabel("east, km", fontsize=8)
    planned = "; source of the plan" if "plan_source" in table else ""
    figure.suptitle(f"encounter: outcome, smallest separation, duration{planned}", fontsize=10)
    figure.legend(handles=_legend(rules), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return figure


def _tracks(flights: Recorded, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the tracks of ownship and intruders of flight ``i``, and its separations, as :func:`draw_tracks`."""
    flown, present = flights.trajectories, flights.starts.mask[i]
    own = np.stack([flown.own.x[:, i], flown.own.y[:, i]])
    others = np.stack([flown.intruders.x[:, i, present].T, flown.intruders.y[:, i, present].T], axis=1)
    return own, others, flown.separation[:, i]


def _spread(found: np.ndarray, count: int) -> list[int]:
    """Return up to ``count`` of the found, evenly spaced."""
    count = min(count, len(found))
    return [int(found[i * len(found) // count]) for i in range(count)]


def draw_tracks(
    axes: Axes,
    tracks: tuple[np.ndarray, np.ndarray],
    separation: np.ndarray,
    goal: tuple[float, float],
    rules: Rules,
) -> None:
    """Draw a flight seen from above, in km: tracks, goal, and the closest approach with the required separation.

    Args:
        axes: to draw on.
        tracks: of the ownship, ``[2, T + 1]``, and of the intruders, ``[K, 2, T + 1]``, m; NaN after the end.
        separation: smallest distance to any intruder during each step, m, ``[T]``.
        goal: m.
        rules: of the task.
    """
    own, intruders = (track / _ONE_KM for track in tracks)
    minute = slice(None, None, max(1, round(60.0 / rules.dt)))
    goal = goal[0] / _ONE_KM, goal[1] / _ONE_KM
    axes.plot([own[0, 0], goal[0]], [own[1, 0], goal[1]], color=GREY, linewidth=0.8, linestyle=":")
    axes.add_patch(Circle(goal, rules.goal_radius / _ONE_KM, color=GREEN, alpha=0.35, linewidth=0))
    for track, style in ((own, _OWN), *((each, _INTRUDER) for each in intruders)):
        axes.plot(*track, color=style["color"], linewidth=style["linewidth"], linestyle=style["linestyle"])
        axes.plot(*track[:, minute], ".", color=style["color"], markersize=4)
        axes.plot(*track[:, 0], style["marker"], color=style["color"], markersize=style["markersize"])
    closest = int(np.nanargmin(separation)) + 1
    apart = np.hypot(*np.moveaxis(intruders[:, :, closest] - own[:, closest], -1, 0))
    at = intruders[int(np.argmin(apart)), :, closest]
    ring = Circle((at[0], at[1]), rules.separation / _ONE_KM, fill=False, edgecolor=VERMILION, linewidth=0.9)
    axes.add_patch(ring)
    axes.plot(*own[:, closest], "D", color="black", markersize=4, markerfacecolor="white", zorder=5)
    # room for the discs, and the same scale both ways: a turn must look like one.
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.tick_params(labelsize=7)
    axes.grid(color="#EBEBEB", linewidth=0.5)
    axes.set_axisbelow(True)


def _legend(rules: Rules) -> list[Line2D]:
    return [
        Line2D([], [], label="ownship, from its start", **_OWN),
        Line2D([], [], label="intruder, from its start", **_INTRUDER),
        Line2D([], [], color="#555555", linestyle="", marker=".", label="every minute"),
        *marks(rules),
    ]


def marks(rules: Rules) -> list[Line2D]:
    """Return what a legend says of goal and closest approach on sheets of flights."""
    line = Line2D
    return [
        line([], [], color=GREEN, alpha=0.45, linestyle="", marker="o", markersize=9, label="goal"),
        line([], [], color="black", linestyle="", marker="D", markerfacecolor="white", label="closest approach"),
        line(
            [],
            [],
            color=VERMILION,
            linestyle="",
            marker="o",
            markersize=10,
            markerfacecolor="none",
            label=f"{rules.separation:.0f} m around the intruder then",
        ),
    ]
