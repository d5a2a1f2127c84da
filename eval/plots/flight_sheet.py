"""A sheet of flights seen from above: failures beside successes."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patches import Polygon as Patch
from matplotlib.ticker import MaxNLocator

from commands.figures import draw_altitudes
from envs.areas import Area
from envs.outcome import Rules
from eval.flights.among_areas import outlines
from eval.flights.recorded import Recorded, Track
from eval.plots.style import (
    BLUE,
    BREACH,
    GREEN,
    GREY,
    LOSS,
    PURPLE,
    SKY,
    VERMILION,
    kinds_of,
    legend,
    sample,
    spread,
)

PANELS = 12  # flights on the sheet
_FAILURES_SHOWN = 8
_LOST_SHOWN = 2  # of the failures, those that are proven unresolvable
_KM = 1e-3
_LEGEND_WIDTH = 2.8  # inches of its longest entry
_OWN: dict[str, Any] = {
    "color": BLUE,
    "linewidth": 1.5,
    "linestyle": "-",
    "marker": "o",
    "markersize": 5.0,
}
_INTRUDER: dict[str, Any] = {
    "color": VERMILION,
    "linewidth": 1.2,
    "linestyle": "--",
    "marker": "s",
    "markersize": 4.5,
}
_WITNESS: dict[str, Any] = {"color": SKY, "linewidth": 1.2, "linestyle": "-."}


class Panel(NamedTuple):
    """One flight."""

    title: str
    track: Track
    colour: str = "black"  # of the title
    witness: np.ndarray | None = None  # a flight that succeeds, m, [2, W]


def sheet(
    panels: Sequence[Panel], rules: Rules, columns: int, size: tuple[float, float], fontsize: float
) -> Figure:
    """Return a sheet of flights, at least one, in so many columns of panels, whose size is in
    inches; of flights in space with the altitudes below the map.
    """
    lines = -(-len(panels) // columns)
    in_space = any(panel.track.altitudes is not None for panel in panels)
    parts = (3.0, 1.0) if in_space else (1.0,)
    height = size[1] * sum(parts) / parts[0]
    figure = Figure(figsize=(size[0] * columns, height * lines + 0.6), layout="constrained")
    grid = figure.add_gridspec(lines * len(parts), columns, height_ratios=parts * lines)
    for i, panel in enumerate(panels):
        line, column = divmod(i, columns)
        axes = figure.add_subplot(grid[line * len(parts), column])
        draw(axes, panel.track, rules, panel.witness)
        axes.set_title(panel.title, fontsize=fontsize, color=panel.colour)
        below = axes
        if in_space:
            below = figure.add_subplot(grid[line * len(parts) + 1, column])
            _draw_altitudes(below, panel.track, rules)
            below.set(xlabel="", ylabel="")
        if column == 0:
            axes.set_ylabel("north, km", fontsize=8)
            if in_space:
                below.set_ylabel("altitude, m", fontsize=8)
        if in_space or i + columns >= len(panels):
            axes.set_xlabel("east, km", fontsize=8)
        if in_space and i + columns >= len(panels):
            below.set_xlabel("time, s", fontsize=8)
    among_areas = any(panel.track.areas for panel in panels)
    explain(
        figure,
        rules,
        *([area_sample()] if among_areas else []),
        witnessed=any(panel.witness is not None for panel in panels),
        own_separations=any(panel.track.required is not None for panel in panels),
    )
    return figure


def trajectory_sheet(
    table: Mapping[str, np.ndarray], numbers: Sequence[int], flights: Recorded, rules: Rules
) -> Figure:
    """Return the sheet of some flights of a run, by the numbers of their encounters in its
    table.
    """
    kinds = kinds_of(table)
    panels = []
    for row, number in enumerate(numbers):
        closest, duration = table["min_separation_m"][number], table["duration_s"][number]
        title = f"{number}: {kinds[number]}, {closest:.0f} m, {duration:.0f} s"
        panels.append(
            Panel(title, flights.track(row), "black" if kinds[number] == "success" else "#A63C00")
        )
    # One panel alone leaves room for the title and the legend, too.
    columns = min(len(panels), 4)
    figure = sheet(panels, rules, columns, (max(3.25, 6.5 / columns), 3.55), 8.5)
    figure.suptitle("encounter: outcome, smallest separation, duration", fontsize=10)
    return figure


def choose_encounters(table: Mapping[str, np.ndarray]) -> list[int]:
    """Return the numbers of the encounters for the sheet: failures first, then successes, each
    spread evenly.

    The failures that count come before those that are proven unresolvable, of which one or two are
    shown: they end after seconds, and one looks like the other.
    """
    kinds = kinds_of(table)
    counting, lost, successes = (
        np.concatenate([np.flatnonzero(kinds == name) for name in names])
        for names in ((LOSS, BREACH, "time-out"), ("proven unresolvable",), ("success",))
    )
    room = min(PANELS, len(kinds))
    most = max(_FAILURES_SHOWN, room - len(successes))  # failures
    few = min(_LOST_SHOWN, len(lost))
    failures = spread(counting, most - few).tolist()
    failures += spread(lost, max(few, room - len(successes) - len(failures))).tolist()
    return [*failures, *spread(successes, room - len(failures)).tolist()]


def draw(axes: Axes, track: Track, rules: Rules, witness: np.ndarray | None = None) -> None:
    """Draw a flight in km: tracks, goal, and the closest approach with the required separation."""
    own, intruders = _KM * track.own, _KM * track.intruders
    goal = _KM * track.goal[0], _KM * track.goal[1]
    for area in track.areas:
        _draw_area(axes, area, 0.0)
        if area.velocity != (0.0, 0.0) or area.growth:
            _draw_area(axes, area, float(track.separation.size) * rules.dt)
    axes.plot([own[0, 0], goal[0]], [own[1, 0], goal[1]], color=GREY, linewidth=0.8, linestyle=":")
    axes.add_patch(Circle(goal, _KM * rules.goal_radius, color=GREEN, alpha=0.35, linewidth=0))
    if witness is not None:
        axes.plot(*(_KM * witness), zorder=1.5, **_WITNESS)
    minute = max(1, round(60.0 / rules.dt))
    _draw_path(axes, own, _OWN, minute)
    for path in intruders:
        _draw_path(axes, path, _INTRUDER, minute)
    if track.separation.size:
        _draw_closest(axes, track, rules)
    # Room for the discs, and the same scale both ways: a turn must look like one.
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.06)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.tick_params(labelsize=7)
    axes.grid(color="#EBEBEB", linewidth=0.5)
    axes.set_axisbelow(True)


def _draw_altitudes(axes: Axes, track: Track, rules: Rules) -> None:
    """Draw the altitudes of a flight over time, m, with a line at the closest approach."""
    if track.altitudes is None:
        return
    own, intruders = track.altitudes
    draw_altitudes(axes, rules.dt * np.arange(own.size), own, intruders)
    if track.separation.size:
        closest = rules.dt * (int(np.argmin(track.separation)) + 1)
        axes.axvline(closest, color="black", linewidth=0.6, linestyle=":")
    axes.tick_params(labelsize=7)


def _draw_path(axes: Axes, path: np.ndarray, style: Mapping[str, Any], minute: int) -> None:
    """Draw a path, km, ``[2, T + 1]``, with a mark at its start and a dot every minute, which is so
    many steps.
    """
    colour = style["color"]
    axes.plot(*path, color=colour, linewidth=style["linewidth"], linestyle=style["linestyle"])
    axes.plot(*path[:, ::minute], ".", color=colour, markersize=4)
    axes.plot(*path[:, 0], style["marker"], color=colour, markersize=style["markersize"])


def _draw_closest(axes: Axes, track: Track, rules: Rules) -> None:
    """Draw where the ownship is at the closest approach, and the required separation around the
    intruder that it is nearest to in it.
    """
    closest = int(np.argmin(track.separation)) + 1
    own, intruders = _KM * track.own[:, closest], _KM * track.intruders[:, :, closest]
    apart = np.hypot(*np.moveaxis(intruders - own, -1, 0))
    required = np.full(len(apart), rules.separation) if track.required is None else track.required
    nearest = int(np.argmin(apart / required))
    radius = _KM * required[nearest]
    axes.add_patch(
        Circle(intruders[nearest], radius, fill=False, edgecolor=VERMILION, linewidth=0.9)
    )
    axes.plot(*own, "D", color="black", markersize=4, markerfacecolor="white", zorder=5)


def area_sample() -> Line2D:
    """Return what a legend says of areas."""
    return sample("area, dashed: at the end", color=PURPLE, alpha=0.5, linewidth=4.0)


def _draw_area(axes: Axes, area: Area, time: float) -> None:
    """Draw the edges of an area as it is some seconds after the start, km; filled at the start."""
    style: dict[str, Any] = {"facecolor": PURPLE if time == 0.0 else "none", "edgecolor": PURPLE}
    style |= {"alpha": 0.35, "linewidth": 0.8, "linestyle": "-" if time == 0.0 else "--"}
    for ring in outlines(area, time):
        axes.add_patch(Patch(_KM * ring, zorder=0.5, **style))


def explain(
    figure: Figure,
    rules: Rules,
    *more: Line2D,
    witnessed: bool = False,
    own_separations: bool = False,
) -> None:
    """Draw the legend of what :func:`draw` draws, and of more, below all panels."""
    mark: dict[str, Any] = {"linestyle": ""}
    ring = {"marker": "o", "markersize": 10, "markerfacecolor": "none"}
    required = "required separation" if own_separations else f"{rules.separation:.0f} m"
    handles = [
        sample("ownship, from its start", **_OWN),
        sample("intruder, from its start", **_INTRUDER),
        *([sample("a flight that succeeds", **_WITNESS)] if witnessed else []),
        sample("every minute", color="#555555", marker=".", **mark),
        sample("goal", color=GREEN, alpha=0.45, marker="o", markersize=9, **mark),
        sample("closest approach", color="black", marker="D", markerfacecolor="white", **mark),
        sample(f"{required} around the intruder then", color=VERMILION, **ring, **mark),
        *more,
    ]
    columns = int(figure.get_figwidth() // _LEGEND_WIDTH)
    legend(figure, handles, max(1, min(len(handles), columns)))
