"""Figures of a sensitivity study: success against one quantity, under the bound of what can be
resolved at all.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from eval.plots.style import BLUE, GREEN, GREY, ORANGE, VERMILION, legend, sample, tidy

_STYLES = {
    "policy": {"color": BLUE, "marker": "o"},
    "plan": {"color": ORANGE, "marker": "s"},
    "assured": {"color": GREEN, "marker": "D"},
    "closed": {"color": BLUE, "marker": "o"},
}
_KINDS = ("success_given_resolvable", "success_rate")
_BELOW = {"color": "#555555", "marker": "v", "linestyle": ""}
_OTHER_MODE = {"color": VERMILION, "marker": "o"}
_LEAST_SPAN = 4.0  # points of success that an axis shows at least
_SCALE_FROM = 50  # encounters from which on a bin's interval lies inside the axis
_SHOWN_FROM = 10  # encounters from which on a bin's mark lies inside the axis
_CROWDED = 40  # characters of labels from which on they are turned
_ACROSS = 2  # panels of the overview in a row: a page shows them at some 400 pixels each
_APART = 0.11  # of a bin's width, between the marks in it


def points_of(part: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Return the bins of a quantity, or the values of a sweep."""
    return part["bins"] if "bins" in part else part["values"]


def draw_details(part: Mapping[str, Any], title: str) -> Figure:
    """Return success against a quantity, above the encounters of each bin, or a sweep, above the
    paired differences.
    """
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    points, binned = points_of(part), "bins" in part
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2 if binned else 2.2, 1.0))
    _draw_success(above, points, full=True)
    more: Sequence[Any] = ()
    if binned:
        more = _draw_counts(below, points)
    else:
        _draw_differences(below, points, part["unit"])
    tidy(below)
    _name_axis(below, part)
    _draw_legend(figure, points, more)
    figure.suptitle(title, fontsize=11)
    return figure


def overview(parts: Sequence[Mapping[str, Any]], title: str) -> Figure:
    """Return all quantities and sweeps side by side, on one scale of success each."""
    columns = min(len(parts), _ACROSS)
    rows = math.ceil(len(parts) / columns)
    # One panel alone leaves room for the title and the legend, too.
    width = max(4.6 * columns, 7.0)
    figure = Figure(figsize=(width, 3.4 * rows + 1.0), layout="constrained")
    for number, part in enumerate(parts):
        axes = figure.add_subplot(rows, columns, number + 1)
        _draw_success(axes, points_of(part), full=False)
        _name_axis(axes, part, fontsize=9)
    _draw_legend(figure, points_of(parts[0]), columns=2)
    figure.suptitle(title, fontsize=11)
    return figure


def _draw_counts(axes: Axes, points: Sequence[Mapping[str, Any]]) -> list[BarContainer]:
    """Draw how many encounters the bins hold, and of those without a resolver; return their
    legend.
    """
    counts = [("encounters", "#D5D5D5", [point["encounters"] for point in points])]
    if "baseline_violation_rate" in points[0]:
        bare = [point["baseline_violation_rate"]["count"] for point in points]
        counts.append(("of which lost without a resolver", GREY, bare))
    axes.set_ylabel("encounters")
    places = range(len(points))
    return [
        axes.bar(places, high, 0.94, align="edge", color=colour, label=name)
        for name, colour, high in counts
    ]


def _draw_differences(axes: Axes, points: Sequence[Mapping[str, Any]], unit: str) -> None:
    """Draw success minus that at the first value, paired, in points."""
    for mode, place in _places(points, 1):
        style = {"markersize": 4.5, "linewidth": 1.1, "capsize": 2.0, "linestyle": "-"}
        _draw_bars(
            axes,
            place[1:],
            [point["difference"][mode] for point in points[1:]],
            **style,
            **_style(mode),
        )
    axes.axhline(0.0, color="#333333", linewidth=0.8)
    axes.set_ylabel(f"less that at {points[0]['value']:g} {unit},\npoints (paired)")


def _draw_success(axes: Axes, points: Sequence[Mapping[str, Any]], *, full: bool) -> None:
    """Draw the success of every mode and the bound, in percent; a bin is one wide on the axis."""
    hollow = {"markerfacecolor": "white", "alpha": 0.8}
    style = {
        "linestyle": "",
        "markersize": 5.0 if full else 3.5,
        "linewidth": 1.1,
        "capsize": 2.0 if full else 0.0,
    }
    for mode, places in _places(points, 2):
        for number, kind in enumerate(_KINDS):
            shares = [point["success"][mode][kind] for point in points]
            look = style | _style(mode) | (hollow if number else {})
            _draw_bars(axes, places + number * _APART, shares, zorder=3.0, **look)
    bound = np.array([100.0 * (1.0 - point["unresolvable_rate"]["value"]) for point in points])
    floor = math.floor(_least(points, bound) / 2.0) * 2.0
    top = 100.0 + 0.04 * (100.0 - floor)
    for mode, places in _places(points, 2):
        for number, kind in enumerate(_KINDS):
            rates = [point["success"][mode][kind]["value"] for point in points]
            look = _style(mode) | (hollow if number else {})
            written = ("right", "left")[number] if full else None
            _draw_below(axes, places + number * _APART, rates, floor, look, written)
    first = np.arange(len(points))
    axes.bar(first, top - bound, 1.0, bottom=bound, align="edge", color="#E3E3E3", zorder=1.0)
    axes.hlines(bound, first, first + 1, color="#555555", linewidth=1.3, zorder=2.0)
    label = "share of encounters, %" if full else "success, %"
    axes.set(ylim=(floor, top), xlim=(0, len(points)), ylabel=label)
    tidy(axes)


def _draw_below(
    axes: Axes,
    places: np.ndarray,
    rates: Sequence[float | None],
    floor: float,
    look: Mapping[str, Any],
    written: Literal["left", "right"] | None,
) -> None:
    """Draw a triangle at the floor of the axis, percent, for each share below it, and its value, to
    which side of it ``written`` says; None: no value.
    """
    for place, rate in zip(places, rates, strict=True):
        if rate is not None and 100.0 * rate < floor:
            style = {**look, "marker": "v", "linestyle": "", "clip_on": False, "zorder": 4.0}
            axes.plot([place], [floor], markersize=5.0, **style)
            if written is None:
                continue
            axes.annotate(
                f"{100.0 * rate:.0f}",
                (place, floor),
                xytext=(0.0, 4.0),
                textcoords="offset points",
                ha=written,
                fontsize=7,
                zorder=4.0,
            )


def _least(points: Sequence[Mapping[str, Any]], bound: np.ndarray) -> float:
    """Return the least that the axis of success must show, percent, under the bound, percent,
    ``[P]``: intervals of bins with many encounters, and marks of those with some. A bin with a
    handful of encounters must not flatten all others.
    """
    counts = np.array([point["encounters"] for point in points])
    enough = counts >= min(_SCALE_FROM, counts.max())
    shown = counts >= min(_SHOWN_FROM, counts.max())
    least = min(float(bound[enough].min()), 100.0 - _LEAST_SPAN)
    for place, point in enumerate(points):
        rates = (success[kind] for success in point["success"].values() for kind in _KINDS)
        for rate in (share for share in rates if share["value"] is not None):
            least = min(least, 100.0 * rate["low"]) if enough[place] else least
            least = min(least, 100.0 * rate["value"]) if shown[place] else least
    return least


def _draw_bars(
    axes: Axes, places: np.ndarray, shares: Sequence[Mapping[str, Any]], **style: Any
) -> None:
    """Draw shares that are known with their intervals, in percent."""
    rows = [[share[key] for key in ("value", "low", "high")] for share in shares]
    finite = np.array(rows, float)  # nan: not known
    value, low, high = 100.0 * finite.T
    axes.errorbar(places, value, np.maximum([value - low, high - value], 0.0), **style)


def _draw_legend(
    figure: Figure,
    points: Sequence[Mapping[str, Any]],
    more: Sequence[Any] = (),
    columns: int = 3,
) -> None:
    handles: list[Any] = []
    for mode in points[0]["success"]:
        style = {"linestyle": "", **_style(mode)}
        handles.append(sample(f"{mode}: of the resolvable", **style))
        handles.append(sample(f"{mode}: of all", markerfacecolor="white", **style))
    handles += [
        Patch(facecolor="#E3E3E3", edgecolor="#555555", label="proven unresolvable (the bound)"),
        *([sample("below the axis", **_BELOW)] if _any_below(figure) else []),
        *more,
    ]
    legend(figure, handles, min(len(handles), columns))


def _any_below(figure: Figure) -> bool:
    return any(line.get_marker() == "v" for axes in figure.axes for line in axes.lines)


def _style(mode: str) -> dict[str, Any]:
    return _STYLES.get(mode, _OTHER_MODE)


def _places(points: Sequence[Mapping[str, Any]], marks: int) -> list[tuple[str, np.ndarray]]:
    """Return where the marks of each mode stand: side by side in the middle of a bin."""
    modes = list(points[0]["success"])
    first = np.arange(len(points)) + 0.5 - 0.5 * (marks * len(modes) - 1) * _APART
    return [(mode, first + marks * number * _APART) for number, mode in enumerate(modes)]


def _name_axis(axes: Axes, part: Mapping[str, Any], **style: Any) -> None:
    label, unit, points = part["label"], part["unit"], points_of(part)
    axes.set_xlabel(f"{label}, {'degrees' if unit == 'deg' else unit}" if unit else label, **style)
    if "low" in points[0]:
        ends = [(_short(point["low"]), _short(point["high"])) for point in points]
        # Where bins without encounters are left out, both ends of the gap are named.
        inner = [
            high if high == low else f"{high} | {low}" for (_, high), (low, _) in pairwise(ends)
        ]
        names = [ends[0][0], *inner, ends[-1][1]]
        crowded = sum(map(len, names)) > _CROWDED or any("|" in name for name in names)
        axes.set_xticks(range(len(names)), names, fontsize=8, rotation=45 if crowded else 0)
    else:
        names = [point["word"] if "word" in point else f"{point['value']:g}" for point in points]
        axes.set_xticks(np.arange(len(points)) + 0.5, names)


def _short(edge: float) -> str:
    return f"{edge:.0f}" if abs(edge) >= 10.0 else f"{edge:.3g}"
