"""Figures of a sensitivity study: success against one quantity, under the bound of what can be resolved at all."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eval.plots.style import BLUE, GREEN, GREY, ORANGE, VERMILION, tidy

__all__ = ["map_figure", "overview", "quantity_figure", "sweep_figure"]

_COLOURS = {"policy": BLUE, "plan": ORANGE, "assured": GREEN, "closed": BLUE}
_MARKS = {"policy": "o", "plan": "s", "assured": "D", "closed": "o"}
_FEW = 10  # encounters below which a cell of the map is left grey
_LEAST_SPAN = 4.0  # points of success that an axis shows at least
_SCALE_FROM = 50  # encounters from which on a bin has a say in how far down an axis reaches


def quantity_figure(found: Mapping[str, Any], title: str) -> Figure:
    """Return success in the bins of one quantity, and below it how many encounters each bin holds."""
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1.0))
    _success(above, found["bins"], _spans(found), full=True)
    _counts(below, found["bins"], _spans(found))
    _ticks(below, found)
    below.set_xlabel(_axis(found))
    _legend(figure, found["bins"], counts=True)
    figure.suptitle(title, fontsize=11)
    return figure


def sweep_figure(found: Mapping[str, Any], title: str) -> Figure:
    """Return success at the values of a sweep, and below it the paired difference from the first value."""
    figure = Figure(figsize=(8.4, 6.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    points, spans = found["values"], _between_values(found)
    _success(above, points, spans, full=True)
    for mode, place in _places(points, spans, 1):
        differences = [point["difference"][mode] for point in points[1:]]
        value = 100.0 * np.array([one["value"] for one in differences])
        ends = 100.0 * np.array([[one["low"], one["high"]] for one in differences])
        bars = np.maximum([value - ends[:, 0], ends[:, 1] - value], 0.0)
        style = {"color": _colour(mode), "marker": _MARKS.get(mode, "o"), "markersize": 4.5}
        below.errorbar(place[1:], value, bars, linewidth=1.1, capsize=2.0, linestyle="-", **style)
    below.axhline(0.0, color="#333333", linewidth=0.8)
    below.set_ylabel(f"less that at {points[0]['value']:g} {found['unit']},\npoints (paired)")
    tidy(below)
    _ticks(below, found)
    below.set_xlabel(_axis(found))
    _legend(figure, points, counts=False)
    figure.suptitle(title, fontsize=11)
    return figure


def overview(quantities: Sequence[Mapping[str, Any]], sweeps: Sequence[Mapping[str, Any]], title: str) -> Figure:
    """Return all quantities and sweeps side by side, on one scale of success each."""
    panels = [*((one, one["bins"], _spans(one)) for one in quantities)]
    panels += [(one, one["values"], _between_values(one)) for one in sweeps]
    columns = min(len(panels), 3)
    rows = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(5.0 * columns, 3.4 * rows + 0.8), layout="constrained")
    for number, (found, points, spans) in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        _success(axes, points, spans, full=False)
        _ticks(axes, found)
        axes.set_xlabel(_axis(found), fontsize=9)
    _legend(figure, panels[0][1], counts=False)
    figure.suptitle(title, fontsize=12)
    return figure


def map_figure(cells: Sequence[Mapping[str, Any]], across: Any, up: Any, mode: str, title: str) -> Figure:
    """Return the initial conditions of a run as a map of two quantities.

    Left the success of what is not proven unresolvable, right the share that is proven so.

    Args:
        cells: as :func:`eval.sensitivity.bins.mapped` makes them.
        across, up: the quantities.
        mode: whose success is shown.
        title: of the figure.
    """
    figure = Figure(figsize=(12.4, 5.4), layout="constrained")
    wide = sorted({cell[across.name][end] for cell in cells for end in ("low", "high")})
    tall = sorted({cell[up.name][end] for cell in cells for end in ("low", "high")})
    resolved, lost = np.full((2, len(tall) - 1, len(wide) - 1), np.nan)
    for cell in cells:
        if cell["encounters"] < _FEW:
            continue
        place = tall.index(cell[up.name]["low"]), wide.index(cell[across.name]["low"])
        share = cell["success"][mode]["success_given_resolvable"]["value"]
        resolved[place] = np.nan if share is None else 100.0 * share
        lost[place] = 100.0 * cell["unresolvable_rate"]["value"]
    least = np.nanmin(resolved, initial=100.0)
    for axes, values, name, colours, ends in (
        (
            figure.add_subplot(1, 2, 1),
            resolved,
            f"success of the resolvable, mode {mode}, %",
            "cividis",
            (least, 100.0),
        ),
        (
            figure.add_subplot(1, 2, 2),
            lost,
            "proven unresolvable, % of all",
            "magma_r",
            (0.0, max(np.nanmax(lost, initial=0.0), 1.0)),
        ),
    ):
        axes.set_facecolor("#DDDDDD")
        # Rows of equal height: near starts matter most, and their bins are the narrowest.
        shades = axes.pcolormesh(wide, range(len(tall)), values, cmap=colours, vmin=ends[0], vmax=ends[1])
        shades.set_edgecolor("face")
        figure.colorbar(shades, ax=axes, shrink=0.9)
        axes.set_yticks(range(len(tall)), [f"{edge:g}" for edge in tall])
        axes.set_xticks([edge for edge in wide if edge % 60.0 == 0.0])
        axes.set_xlabel(f"{across.label}, {_unit(across.unit)}")
        axes.set_ylabel(f"{up.label}, {_unit(up.unit)}")
        axes.set_title(name, fontsize=11)
    figure.legend(
        handles=[Patch(facecolor="#DDDDDD", label=f"fewer than {_FEW} encounters")],
        loc="outside lower center",
        frameon=False,
    )
    figure.suptitle(title, fontsize=11)
    return figure


def _success(axes: Any, points: Sequence[Mapping[str, Any]], spans: np.ndarray, *, full: bool) -> None:
    """Draw the success of every mode and the bound, in percent, spans ``[B, 2]`` on the axis."""
    bound = np.array([100.0 * (1.0 - point["unresolvable_rate"]["value"]) for point in points])
    least = 100.0
    # A bin with a handful of encounters must not flatten all others.
    counts = np.array([point["encounters"] for point in points])
    weighty = counts >= min(_SCALE_FROM, counts.max())
    for mode, places in _places(points, spans, 2):
        colour, mark = _colour(mode), _MARKS.get(mode, "o")
        for number, kind in enumerate(("success_given_resolvable", "success_rate")):
            shares = [point["success"][mode][kind] for point in points]
            known = np.array([share["value"] is not None for share in shares])
            value = np.array([100.0 * (share["value"] or 0.0) for share in shares])[known]
            low, high = (np.array([100.0 * share[end] for share in shares])[known] for end in ("low", "high"))
            least = min(least, float(low[weighty[known]].min(initial=100.0)))
            filled: dict[str, Any] = (
                {} if kind == "success_given_resolvable" else {"markerfacecolor": "white", "alpha": 0.8}
            )
            axes.errorbar(
                places[known] + number * _apart(spans)[known],
                value,
                np.maximum([value - low, high - value], 0.0),
                linestyle="",
                marker=mark,
                markersize=5.0 if full else 3.5,
                color=colour,
                linewidth=1.1,
                capsize=2.0 if full else 0.0,
                zorder=3.0,
                **filled,
            )
    floor = math.floor(min(least, float(bound[weighty].min()), 100.0 - _LEAST_SPAN) / 2.0) * 2.0
    top = 100.0 + 0.04 * (100.0 - floor)
    for (low, high), share in zip(spans, bound, strict=True):
        axes.fill_between([low, high], share, top, color="#E3E3E3", linewidth=0.0, zorder=1.0)
        axes.plot([low, high], [share, share], color="#555555", linewidth=1.3, zorder=2.0)
    axes.set_ylim(floor, top)
    axes.set_xlim(spans.min(), spans.max())
    axes.set_ylabel("share of encounters, %" if full else "success, %")
    tidy(axes)


def _counts(axes: Any, points: Sequence[Mapping[str, Any]], spans: np.ndarray) -> None:
    left, width = spans[:, 0], spans[:, 1] - spans[:, 0]
    count = np.array([point["encounters"] for point in points])
    axes.bar(left, count, 0.94 * width, align="edge", color="#D5D5D5")
    if "baseline_violation_rate" in points[0]:
        bare = [point["baseline_violation_rate"]["count"] for point in points]
        axes.bar(left, bare, 0.94 * width, align="edge", color=GREY)
    axes.set_ylabel("encounters")
    tidy(axes)


def _legend(figure: Figure, points: Sequence[Mapping[str, Any]], *, counts: bool) -> None:
    handles: list[Any] = []
    for mode in points[0]["success"]:
        style: dict[str, Any] = {"color": _colour(mode), "marker": _MARKS.get(mode, "o"), "linestyle": ""}
        handles.append(Line2D([], [], label=f"{mode}: of the resolvable", **style))
        handles.append(Line2D([], [], label=f"{mode}: of all", markerfacecolor="white", **style))
    handles.append(Patch(facecolor="#E3E3E3", edgecolor="#555555", label="proven unresolvable (the bound)"))
    if counts:
        handles.append(Patch(facecolor="#D5D5D5", label="encounters"))
        if "baseline_violation_rate" in points[0]:
            handles.append(Patch(facecolor=GREY, label="of which lost without a resolver"))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4), frameon=False, fontsize=9)


def _places(points: Sequence[Mapping[str, Any]], spans: np.ndarray, each: int) -> list[tuple[str, np.ndarray]]:
    """Return where the marks of each mode stand: side by side in the middle of a bin."""
    modes = list(points[0]["success"])
    middle, apart = spans.mean(axis=1), _apart(spans)
    total = each * len(modes)
    return [(mode, middle + (each * number - 0.5 * (total - 1)) * apart) for number, mode in enumerate(modes)]


def _apart(spans: np.ndarray) -> np.ndarray:
    return 0.11 * (spans[:, 1] - spans[:, 0])


def _spans(found: Mapping[str, Any]) -> np.ndarray:
    """Return where bins lie on the axis: at their place where they are alike, else side by side."""
    if not _alike(found):
        first = np.arange(len(found["bins"]), dtype=float)
        return np.stack([first, first + 1.0], axis=1)
    return np.array([[one["low"], one["high"]] for one in found["bins"]])


def _between_values(found: Mapping[str, Any]) -> np.ndarray:
    first = np.arange(len(found["values"]), dtype=float)
    return np.stack([first, first + 1.0], axis=1)


def _alike(found: Mapping[str, Any]) -> bool:
    if "word" in found["bins"][0]:
        return False
    widths = [one["high"] - one["low"] for one in found["bins"]]
    return max(widths) < 1.01 * min(widths)


def _ticks(axes: Any, found: Mapping[str, Any]) -> None:
    """Name the bins or the values below the axis."""
    if "values" in found:
        axes.set_xticks(np.arange(len(found["values"])) + 0.5, [f"{one['value']:g}" for one in found["values"]])
        return
    bins = found["bins"]
    if "word" in bins[0]:
        axes.set_xticks(np.arange(len(bins)) + 0.5, [one["word"] for one in bins])
    elif not _alike(found):
        edges = [bins[0]["low"], *(one["high"] for one in bins)]
        axes.set_xticks(range(len(edges)), [_plain(edge) for edge in edges], fontsize=8)
    elif found["unit"] == "deg":
        axes.set_xticks([edge for edge in range(-180, 181, 60) if bins[0]["low"] <= edge <= bins[-1]["high"]])


def _plain(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.3g}"


def _axis(found: Mapping[str, Any]) -> str:
    return f"{found['label']}, {_unit(found['unit'])}" if found["unit"] else str(found["label"])


def _unit(unit: str) -> str:
    return "degrees" if unit == "deg" else unit


def _colour(mode: str) -> str:
    return _COLOURS.get(mode, VERMILION)
