"""The figure of the boundary: where the intruder may start, by the grid and by the verdicts."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from agents.resolvability.classify import Verdict
from envs.aircraft import Aircraft
from eval.boundary.slices import Answers, Slice
from eval.plots.style import BLUE, GREY, ORANGE, VERMILION, arrow, legend, sample

_KM = 1e-3
_LEVELS = (0.4, 0.6, 0.8, 1.0, 1.2)  # separations
_SHADES = ("#C9C9C9", "#D6D6D6", "#E2E2E2", "#EDEDED", "#F6F6F6", "#FFFFFF")
_DOTS: dict[str, Any] = {
    "linestyle": "",
    "markersize": 2.6,
    "markeredgecolor": "black",
    "markeredgewidth": 0.0,
}
_STYLES: dict[Verdict, tuple[str, dict[str, Any]]] = {
    Verdict.RESOLVABLE: ("resolvable: a witness flies it", _DOTS | {"marker": "o", "color": BLUE}),
    Verdict.UNRESOLVABLE: ("proven unresolvable", _DOTS | {"marker": "s", "color": VERMILION}),
    Verdict.UNDECIDED: (
        "undecided",
        _DOTS | {"marker": "D", "color": ORANGE, "markersize": 4.1, "markeredgewidth": 0.6},
    ),
}


def boundary_figure(
    slices: Sequence[tuple[Answers, Mapping[str, Any]]], aircraft: Aircraft
) -> Figure:
    """Return the figure of slices: answers, and their figures by
    :func:`eval.boundary.slices.compare`.
    """
    separation = aircraft.separation
    columns = min(len(slices), 3)
    rows = math.ceil(len(slices) / columns)
    # One map alone leaves room for the legend and its title, too.
    ncols = min(columns + 1, 3)
    lines = math.ceil((3 + len(_STYLES)) / ncols)
    tall = max(np.ptp(answers.map_x) / np.ptp(answers.map_y) for answers, _ in slices)
    size = (max(4.9 * columns, 7.4), (4.2 * tall + 1.0) * rows + 0.4 + 0.25 * lines)
    figure = Figure(figsize=size, layout="constrained")
    for number, (answers, figures) in enumerate(slices, 1):
        _draw_slice(figure.add_subplot(rows, columns, number), answers, figures, aircraft)
    handles = [
        sample(
            f"the grid's boundary: {separation:.0f} m can just be kept",
            color="black",
            linewidth=1.6,
        ),
        sample("that of other separations", color=GREY, linewidth=0.6),
        sample(
            f"{separation:.0f} m around the ownship", color="black", linewidth=1.0, linestyle="--"
        ),
    ]
    handles += [sample(name, **style | {"markersize": 7.0}) for name, style in _STYLES.values()]
    legend(figure, handles, ncols, 10)
    return figure


def _draw_slice(
    axes: Axes, answers: Answers, figures: Mapping[str, Any], aircraft: Aircraft
) -> None:
    """Draw where the intruder starts, the ownship's heading up: ahead is up and left is left."""
    _draw_grid(axes, answers, aircraft.separation)
    for verdict, (_, style) in _STYLES.items():
        # The finer points would hide the boundary; only what is undecided is worth it.
        shown = (answers.verdict == verdict) & (answers.on_raster | (verdict == Verdict.UNDECIDED))
        across, up = -_KM * answers.y[shown], _KM * answers.x[shown]
        axes.plot(across, up, rasterized=True, zorder=3.0, **style)
    cut = answers.slice
    _draw_aircraft(axes, (0.0, 0.0), 0.0, cut.own_speed, "own", aircraft)
    start = _last_avoided(answers, aircraft.separation)
    _draw_aircraft(axes, start, cut.heading, cut.intruder_speed, "intruder", aircraft)
    axes.set(xlabel="to the right of the ownship, km", ylabel="ahead of the ownship, km")
    axes.set_title(_title(cut, figures), fontsize=10)


def _draw_grid(axes: Axes, answers: Answers, separation: float) -> None:
    """Draw the value by the grid: shades and lines of what separation can be kept, m."""
    across, up = -_KM * answers.map_y[::-1], _KM * answers.map_x
    value, levels = answers.map_value[:, ::-1], [part * separation for part in _LEVELS]
    axes.contourf(across, up, value, levels=[0.0, *levels, 1e9], colors=_SHADES)
    others = [level for level in levels if level != separation]
    thin = axes.contour(across, up, value, levels=others, colors=GREY, linewidths=0.6)
    axes.clabel(thin, fmt="%.0f m", fontsize=7)
    axes.contour(across, up, value, levels=[separation], colors="black", linewidths=1.6, zorder=4.0)
    axes.add_patch(
        Circle((0.0, 0.0), _KM * separation, fill=False, linestyle="--", linewidth=1.0, zorder=4.0)
    )
    axes.set(aspect="equal", xlim=across[[0, -1]], ylim=up[[0, -1]])


def _last_avoided(answers: Answers, separation: float) -> tuple[float, float]:
    """Return the place on the axes of the intruder that is avoided last: the lost start farthest
    away, km.
    """
    away = np.hypot(answers.map_x[:, None], answers.map_y)
    lost = np.where(answers.map_value < separation, away, -1.0)
    i, k = np.unravel_index(np.argmax(lost), lost.shape)
    return -_KM * float(answers.map_y[k]), _KM * float(answers.map_x[i])


def _draw_aircraft(
    axes: Axes,
    place: tuple[float, float],
    heading: float,
    speed: float,
    name: str,
    aircraft: Aircraft,
) -> None:
    """Draw an aircraft at a place of the axes, km, by its heading, rad, and speed, m/s; its name
    stands behind it.
    """
    direction = heading + math.pi / 2.0
    behind = (-15.0 * math.cos(direction), -13.0 * math.sin(direction))
    aside: dict[str, Any] = {
        "xytext": behind,
        "ha": "right" if behind[0] < -5.0 else "center",
        "va": "center",
    }
    arrow(axes, place, direction, 0.6 * _KM * aircraft.time_unit * speed, name, **aside)


def _title(cut: Slice, figures: Mapping[str, Any]) -> str:
    disagreements = sum(figures["disagreements"].values())
    return (
        f"{cut.name}: own {cut.own_speed:g}, intruder {cut.intruder_speed:g} m/s, "
        f"{figures['course_difference_deg']:+.0f}°\n{figures['points']} points, "
        f"{disagreements} disagreements, {figures['undecided']} undecided"
    )
