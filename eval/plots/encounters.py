"""Figures of an evaluation: where failures begin, smallest separations, and flights seen from
above.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from threadpoolctl import threadpool_limits

from commands.figures import save_figure
from commands.progress import group_digits
from eval.flights.chunks import Evaluation, ReadyEvaluation
from eval.flights.recorded import fly_recorded
from eval.plots.flight_sheet import choose_encounters, trajectory_sheet
from eval.plots.style import MARKERS, SKY, VERMILION, kinds_of, legend, tidy

_ONE_KM = 1_000.0
_BARE = "straight on, without a resolver"
_NEAREST_KM = 0.05  # starts nearer than this are drawn here: a logarithmic scale has no zero


def draw_all(folder: Path, table: Mapping[str, np.ndarray], evaluation: Evaluation) -> list[Path]:
    """Draw every figure of a run into its folder and return the paths."""
    numbers = choose_encounters(table)
    # One thread, as when they were flown for the table, so that they fly the same again.
    with threadpool_limits(1):
        ready = ReadyEvaluation.load(evaluation)
        flown = fly_recorded(ready, numbers)
    figures = {
        "initial_conditions": initial_conditions(table),
        "min_separation": separation_histogram(table, evaluation.aircraft.separation),
        "trajectories": trajectory_sheet(table, numbers, flown, evaluation.aircraft.rules()),
    }
    return [path for name, figure in figures.items() for path in save_figure(figure, folder / name)]


def initial_conditions(table: Mapping[str, np.ndarray]) -> Figure:
    """Return the paper's figure of initial conditions: angle to the intruder against distance,
    failures marked.

    The left panel looks down on the ownship, which flies towards the top of the page; the right one
    shows the difference of the headings, which says whether the intruder comes from ahead, from the
    side or from behind.
    """
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    polar = figure.add_subplot(1, 2, 1, projection="polar")
    assert isinstance(polar, PolarAxes)
    plane = figure.add_subplot(1, 2, 2)
    kinds = kinds_of(table)
    km = np.maximum(table["distance_m"] / _ONE_KM, _NEAREST_KM)
    handles = []
    # Of the losses of separation in the table, what is proven unresolvable is marked as such.
    some_lost = (kinds == "proven unresolvable").any()
    other = " that could be resolved" if some_lost else ""
    counted = dict.fromkeys(MARKERS, other) | {"success": "", "proven unresolvable": ""}
    for name, style in MARKERS.items():
        mask = kinds == name
        if not mask.any():
            continue
        # Thousands of marks as vectors make a file that no viewer likes.
        bearing = np.radians(table["bearing_deg"][mask])
        points = polar.scatter(bearing, km[mask], rasterized=True, **style)
        plane.scatter(table["relative_heading_deg"][mask], km[mask], rasterized=True, **style)
        points.set_label(f"{name}{counted[name]} ({group_digits(int(mask.sum()))})")
        handles.append(points)
    # Failures begin near by: a logarithmic scale gives them room, marked at 1, 2, 5, 10, ...
    ends = low, high = 0.8 * float(km.min()), 1.1 * float(km.max())
    marks = [digit * 10.0**power for power in range(-2, 4) for digit in (1, 2, 5)]
    rings = [mark for mark in marks if low <= mark <= high]
    _set_polar_axes(polar, ends, rings)
    _set_plane_axes(plane, ends, rings)
    columns = len(handles) if len(handles) <= 3 else math.ceil(len(handles) / 2)
    legend(figure, handles[::-1], columns, 10, markerscale=1.8)
    return figure


def _set_plane_axes(axes: Axes, ends: tuple[float, float], rings: list[float]) -> None:
    """Set relative heading against distance, km, with marks at some distances."""
    axes.set_xlim(-180.0, 180.0)
    axes.set_xticks(range(-180, 181, 60))
    axes.set_yscale("log")
    axes.set_ylim(*ends)
    axes.set_yticks(rings, [f"{ring:g}" for ring in rings])
    axes.minorticks_off()
    axes.set_xlabel("intruder's heading minus own heading, degrees counter-clockwise")
    axes.set_ylabel("distance to the intruder, km (logarithmic)")
    axes.set_title("relative heading and distance at the start", fontsize=11)
    axes.grid(color="#E5E5E5", linewidth=0.6)
    axes.set_axisbelow(True)


def separation_histogram(table: Mapping[str, np.ndarray], required: float) -> Figure:
    """Return the histogram of the smallest separation of every flight, beside the required one, m.

    Without a resolver too, where the table knows of such flights.
    """
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    names = [name for name in ("min_separation_m", "baseline_min_separation_m") if name in table]
    separations = [table[name][np.isfinite(table[name])] / _ONE_KM for name in names]
    required_km = required / _ONE_KM
    first = min(required_km, *(float(values.min(initial=np.inf)) for values in separations))
    last = max(1.5 * required_km, *(float(values.max(initial=-np.inf)) for values in separations))
    width = 0.05 * math.ceil((last - first) / 7.5)
    # Edges at the requirement, so that no bar mixes flights on both sides of it.
    # One bar of room to the left of it, so that its line stands clear of the frame.
    lowest = min(math.floor((first - required_km) / width), -1)
    steps = range(lowest, math.ceil((last - required_km) / width) + 1)
    edges = [required_km + width * step for step in steps]
    axes.hist(separations[0], edges, color=SKY, label="with the resolver")
    for bare in separations[1:]:
        axes.hist(bare, edges, histtype="step", color="#333333", linewidth=1.0, label=_BARE)
    axes.axvline(
        required_km,
        color=VERMILION,
        linewidth=1.6,
        linestyle="--",
        label=f"required: {required:.0f} m",
    )
    axes.set_yscale("log")
    axes.set_ylim(0.7, None)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: group_digits(round(value))))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel("smallest separation of a flight, km")
    axes.set_ylabel(f"flights per {1000.0 * width:.0f} m")
    tidy(axes)
    axes.legend(frameon=False, loc="upper right")
    return figure


def _set_polar_axes(axes: PolarAxes, ends: tuple[float, float], rings: list[float]) -> None:
    """Set bearing and distance, km, seen from above, with rings at some distances."""
    axes.set_theta_zero_location("N")
    axes.set_thetagrids(
        range(0, 360, 30), [_side(angle) for angle in range(0, 360, 30)], fontsize=8
    )
    axes.tick_params(axis="x", pad=13.0)  # clear of the circle on both sides
    axes.set_rscale("log")
    axes.set_ylim(*ends)
    axes.set_rlabel_position(165.0)  # behind the ownship, where few encounters begin
    axes.set_rgrids(rings, [f"{ring:g} km" for ring in rings], fontsize=8, color="#333333")
    axes.yaxis.minorticks_off()
    axes.grid(color="#D5D5D5", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_title(
        "bearing and distance of the intruder at the start\n(own heading is up)", fontsize=11
    )


def _side(angle: int) -> str:
    if angle in (0, 180):
        return f"{angle}°"
    return f"{angle}° left" if angle < 180 else f"{360 - angle}° right"
