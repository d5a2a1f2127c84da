"""Figures of a sensitivity study: success against one quantity, under the bound of what can be resolved at all."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from eval.plots.style import BLUE, GREEN, GREY, ORANGE, VERMILION, legend, sample, tidy

__all__ = ["overview", "quantity_figure", "sweep_figure"]

_STYLES = {
    "policy": {"color": BLUE, "marker": "o"},
    "plan": {"color": ORANGE, "marker": "s"},
    "assured": {"color": GREEN, "marker": "D"},
    "closed": {"color": BLUE, "marker": "o"},
}
_OTHER = {"color": VERMILION, "marker": "o"}
_LEAST_SPAN = 4.0  # points of success that an axis shows at least
_SCALE_FROM = 50  # encounters from which on a bin has a say in how far down an axis reaches

Points = Sequence[Mapping[str, Any]]
"""Bins of a quantity or values of a sweep."""


def quantity_figure(found: Mapping[str, Any], title: str) -> Figure:
    """Return success in the bins of one quantity, and below it how many encounters each bin holds."""
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1.0))
    points, spans = found["bins"], _spans(found)
    _success(above, points, spans, full=True)
    left, width = spans[:, 0], 0.94 * (spans[:, 1] - spans[:, 0])
    below.bar(left, [point["encounters"] for point in points], width, align="edge", color="#D5D5D5")
    more = [Patch(facecolor="#D5D5D5", label="encounters")]
    if "baseline_violation_rate" in points[0]:
        bare = [point["baseline_violation_rate"]["count"] for point in points]
        below.bar(left, bare, width, align="edge", color=GREY)
        more.append(Patch(facecolor=GREY, label="of which lost without a resolver"))
    below.set_ylabel("encounters")
    tidy(below)
    _name_axis(below, found)
    _legend(figure, points, more)
    figure.suptitle(title, fontsize=11)
    return figure


def sweep_figure(found: Mapping[str, Any], title: str) -> Figure:
    """Return success at the values of a sweep, and below it the paired difference from the first value."""
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    points, spans = found["values"], _spans(found)
    _success(above, points, spans, full=True)
    for mode, place in _places(points, spans, 1):
        differences = [point["difference"][mode] for point in points[1:]]
        style = {"markersize": 4.5, "linewidth": 1.1, "capsize": 2.0, "linestyle": "-"}
        _bars(below, place[1:], differences, **style, **_STYLES.get(mode, _OTHER))
    below.axhline(0.0, color="#333333", linewidth=0.8)
    below.set_ylabel(f"less that at {points[0]['value']:g} {found['unit']},\npoints (paired)")
    tidy(below)
    _name_axis(below, found)
    _legend(figure, points)
    figure.suptitle(title, fontsize=11)
    return figure


def overview(found: Sequence[Mapping[str, Any]], title: str) -> Figure:
    """Return all quantities and sweeps side by side, on one scale of success each."""
    columns = min(len(found), 3)
    rows = math.ceil(len(found) / columns)
    figure = Figure(figsize=(5.0 * columns, 3.4 * rows + 0.8), layout="constrained")
    for number, one in enumerate(found):
        axes = figure.add_subplot(rows, columns, number + 1)
        _success(axes, _points(one), _spans(one), full=False)
        _name_axis(axes, one, fontsize=9)
    _legend(figure, _points(found[0]))
    figure.suptitle(title, fontsize=12)
    return figure


def _success(axes: Any, points: Points, spans: np.ndarray, *, full: bool) -> None:
    """Draw the success of every mode and the bound, in percent, spans ``[B, 2]`` on the axis."""
    bound = np.array([100.0 * (1.0 - point["unresolvable_rate"]["value"]) for point in points])
    # A bin with a handful of encounters must not flatten all others.
    counts = np.array([point["encounters"] for point in points])
    weighty = counts >= min(_SCALE_FROM, counts.max())
    least = min(float(bound[weighty].min()), 100.0 - _LEAST_SPAN)
    hollow = {"markerfacecolor": "white", "alpha": 0.8}
    style = {"linestyle": "", "markersize": 5.0 if full else 3.5, "linewidth": 1.1, "capsize": 2.0 if full else 0.0}
    for mode, places in _places(points, spans, 2):
        for number, kind in enumerate(("success_given_resolvable", "success_rate")):
            shares = [point["success"][mode][kind] for point in points]
            at = places + number * _apart(spans)
            _bars(axes, at, shares, zorder=3.0, **style, **_STYLES.get(mode, _OTHER), **(hollow if number else {}))
            lows = [
                one["low"] for one, heavy in zip(shares, weighty, strict=True) if heavy and one["value"] is not None
            ]
            least = min([least, *(100.0 * low for low in lows)])
    floor = math.floor(least / 2.0) * 2.0
    top = 100.0 + 0.04 * (100.0 - floor)
    for (low, high), share in zip(spans, bound, strict=True):
        axes.fill_between([low, high], share, top, color="#E3E3E3", linewidth=0.0, zorder=1.0)
        axes.plot([low, high], [share, share], color="#555555", linewidth=1.3, zorder=2.0)
    axes.set_ylim(floor, top)
    axes.set_xlim(spans.min(), spans.max())
    axes.set_ylabel("share of encounters, %" if full else "success, %")
    tidy(axes)


def _bars(axes: Any, places: np.ndarray, shares: Points, **style: Any) -> None:
    """Draw shares that are known with their intervals, in percent."""
    known = [
        (at, *(100.0 * one[key] for key in ("value", "low", "high")))
        for at, one in zip(places, shares, strict=True)
        if one["value"] is not None
    ]
    at, value, low, high = np.array(known).reshape(-1, 4).T
    axes.errorbar(at, value, np.maximum([value - low, high - value], 0.0), **style)


def _legend(figure: Figure, points: Points, more: Sequence[Any] = ()) -> None:
    handles: list[Any] = []
    for mode in points[0]["success"]:
        style = {"linestyle": "", **_STYLES.get(mode, _OTHER)}
        handles += [
            sample(f"{mode}: of the resolvable", **style),
            sample(f"{mode}: of all", markerfacecolor="white", **style),
        ]
    handles += [Patch(facecolor="#E3E3E3", edgecolor="#555555", label="proven unresolvable (the bound)"), *more]
    legend(figure, handles, min(len(handles), 4))


def _places(points: Points, spans: np.ndarray, each: int) -> list[tuple[str, np.ndarray]]:
    """Return where the marks of each mode stand: side by side in the middle of a bin."""
    modes = list(points[0]["success"])
    middle, apart = spans.mean(axis=1), _apart(spans)
    total = each * len(modes)
    return [(mode, middle + (each * number - 0.5 * (total - 1)) * apart) for number, mode in enumerate(modes)]


def _apart(spans: np.ndarray) -> np.ndarray:
    return 0.11 * (spans[:, 1] - spans[:, 0])


def _points(found: Mapping[str, Any]) -> Points:
    return found["bins"] if "bins" in found else found["values"]


def _spans(found: Mapping[str, Any]) -> np.ndarray:
    """Return where bins or values lie on the axis, ``[B, 2]``: side by side."""
    first = np.arange(len(_points(found)), dtype=float)
    return np.stack([first, first + 1.0], axis=1)


def _name_axis(axes: Any, found: Mapping[str, Any], **style: Any) -> None:
    axes.set_xlabel(_with_unit(found["label"], found["unit"]), **style)
    points = _points(found)
    if "low" in points[0]:
        ends = [(_short(one["low"]), _short(one["high"])) for one in points]
        # Where bins without encounters are left out, both ends of the gap are named.
        inner = [high if high == low else f"{high} | {low}" for (_, high), (low, _) in pairwise(ends)]
        axes.set_xticks(range(len(points) + 1), [ends[0][0], *inner, ends[-1][1]], fontsize=8)
    else:
        names = [one["word"] if "word" in one else f"{one['value']:g}" for one in points]
        axes.set_xticks(np.arange(len(points)) + 0.5, names)


def _short(edge: float) -> str:
    return f"{edge:.0f}" if abs(edge) >= 10.0 else f"{edge:.3g}"


def _with_unit(label: str, unit: str) -> str:
    return f"{label}, {'degrees' if unit == 'deg' else unit}" if unit else label
