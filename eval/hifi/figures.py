"""Figures of a run of flights: a sheet of some, how near the aircraft came, and how far it was from its plans."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from envs.outcome import Rules
from eval.hifi.flights import Campaign, LoadedCampaign, flown
from eval.hifi.rows import WAYPOINTS
from eval.hifi.sheet import sheet
from eval.plots.style import BLUE, GREEN, ORANGE, SKY, VERMILION
from eval.runner.outputs import RunFolder

__all__ = ["chosen", "distributions", "draw_all", "separations"]

_SHOWN = 4


def draw_all(folder: RunFolder, table: Mapping[str, np.ndarray], campaign: Campaign) -> list[Path]:
    """Draw every figure of a run into its folder and return the paths."""
    numbers = chosen(table)
    flights = []
    with threadpool_limits(1):
        loaded = LoadedCampaign(campaign)
        for number in numbers:
            closest = table["min_separation_m"][number]
            apart = "" if np.isnan(closest) else f", {closest:.0f} m"
            wind = f", wind {table['wind_m_s'][number]:.0f} m/s" if table["wind_m_s"][number] else ""
            flights.append((f"{number}: {table['outcome'][number]}{apart}{wind}", flown(loaded, number)))
    figures = {"flights": sheet(flights, campaign.aircraft.rules())}
    if np.isfinite(table["min_separation_m"]).any():
        figures["min_separation"] = separations(table, campaign.aircraft.rules())
    if np.isfinite(table["position_error_max_m"]).any():
        figures["errors"] = distributions(table)
    return [path for name, figure in figures.items() for path in folder.save_figure(name, figure)]


def chosen(table: Mapping[str, np.ndarray]) -> list[int]:
    """Return the numbers of the flights for the sheet: those that did not reach their goal first."""
    order = np.argsort(table["outcome"] == "reached", kind="stable")
    # A refused flight has no track to show.
    order = order[np.argsort(table["outcome"][order] == "refused", kind="stable")]
    return [int(number) for number in order[:_SHOWN]]


def separations(table: Mapping[str, np.ndarray], rules: Rules) -> Figure:
    """Return the histogram of the smallest separation of every flight."""
    figure = Figure(figsize=(8.0, 4.4), layout="constrained")
    axes = figure.add_subplot()
    apart = table["min_separation_m"]
    apart = apart[np.isfinite(apart)]
    low, high = min(float(apart.min()), rules.separation), max(float(apart.max()), 2.0 * rules.separation)
    width = 50.0
    first, last = np.floor((low - rules.separation) / width), np.ceil((high - rules.separation) / width)
    axes.hist(apart, rules.separation + width * np.arange(first, last + 1.0), color=SKY)
    axes.axvline(rules.separation, color=VERMILION, linestyle="--", label=f"required: {rules.separation:.0f} m")
    axes.set_xlabel("smallest separation until the time limit, m")
    axes.set_ylabel(f"flights per {width:.0f} m")
    axes.legend(frameon=False)
    return figure


def distributions(table: Mapping[str, np.ndarray]) -> Figure:
    """Return how far the aircraft was from its plans: shares of flights, and waypoint by waypoint."""
    figure = Figure(figsize=(13.0, 4.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    safe = table["plan_status"] == "safe"
    for name, label, color in (
        ("path_definition_max_m", "path definition", GREEN),
        ("position_error_max_m", "flight-technical", BLUE),
        ("total_error_max_m", "total, policy's part", ORANGE),
        ("separation_loss_m", "separation lost", VERMILION),
    ):
        _exceeded(left, table[name][safe], label, color)
    left.set_xscale("symlog", linthresh=1.0)
    left.set_yscale("log")
    left.set_xlabel("largest distance in a flight, m")
    left.set_ylabel("share of flights beyond it")
    left.legend(frameon=False, fontsize=8)
    for axes, kind, label in ((middle, "position_m", "distance from the plan, m"), (right, "late_s", "|late|, s")):
        each = [np.abs(table[f"{kind}_{n:02d}"][safe]) for n in range(1, WAYPOINTS + 1)]
        for share, style in ((1.0, ":"), (0.95, "--"), (0.5, "-")):
            found = [np.quantile(values[np.isfinite(values)], share) for values in each]
            axes.plot(range(1, WAYPOINTS + 1), found, style, color=BLUE, label=f"{100.0 * share:g} %")
        axes.set_xlabel("waypoint")
        axes.set_ylabel(label)
        axes.legend(frameon=False, fontsize=8)
    for axes in (left, middle, right):
        axes.grid(color="#EBEBEB", linewidth=0.5)
    return figure


def _exceeded(axes: Any, values: np.ndarray, label: str, color: str) -> None:
    known = np.sort(values[np.isfinite(values)])
    if known.size:
        axes.step(known, 1.0 - np.arange(known.size) / known.size, color=color, label=label, where="post")
