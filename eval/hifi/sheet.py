"""A sheet of flights of the true aircraft: the track against its waypoints, and every error over time below it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from envs.c208.air_mass import over_ground
from envs.follower import PERIOD
from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.trees import take
from eval.flights.plan_flight import SUBSTEPS
from eval.hifi.flights import Flown
from eval.plots.style import BLUE, GREEN, GREY, ORANGE, VERMILION

__all__ = ["sheet"]

_KM = 1_000.0
_AFTER = 60.0  # the rejoining that the track is shown for, s


def sheet(flights: Sequence[tuple[str, Flown]], rules: Rules) -> Figure:
    """Return a sheet with a column a flight, that has a title; the errors only where there are any.

    Args:
        flights: titles and flights, at least one.
        rules: of the task.
    """
    rows = (_separation, _cross, _along, _late, _accumulated)
    rows = rows if any(one.errors is not None for _, one in flights) else rows[:1]
    count = len(flights)
    figure = Figure(figsize=(4.2 * count, 4.0 + 1.75 * len(rows)), layout="constrained")
    grid = figure.add_gridspec(1 + len(rows), count, height_ratios=[2.6, *([1.0] * len(rows))])
    for i, (title, one) in enumerate(flights):
        axes = figure.add_subplot(grid[0, i])
        axes.set_title(title, fontsize=9)
        _track(axes, one, rules)
        axes.set_xlabel("east, km", fontsize=8)
        axes.set_ylabel("north, km" if i == 0 else "", fontsize=8)
        for row, draw in enumerate(rows):
            below = figure.add_subplot(grid[1 + row, i])
            label = draw(below, one, rules)
            below.set_ylabel(label if i == 0 else "", fontsize=8)
            below.tick_params(labelsize=7)
            below.grid(color="#EBEBEB", linewidth=0.5)
            if row == len(rows) - 1:
                below.set_xlabel("time, s", fontsize=8)
    return figure


def _track(axes: Any, one: Flown, rules: Rules) -> None:
    route = one.scene.route
    axes.plot(route.x[:2] / _KM, route.y[:2] / _KM, color=GREY, linewidth=0.8, linestyle=":")
    goal = float(route.x[1]) / _KM, float(route.y[1]) / _KM
    axes.add_patch(Circle(goal, rules.goal_radius / _KM, color=GREEN, alpha=0.35, linewidth=0))
    rejoin = rules.t_max if one.made is None else float(one.made.plans.proposals.rejoin_time[0])
    # What comes later is the route, a straight line.
    end = round(rejoin + _AFTER) if np.isfinite(rejoin) else round(rules.t_max)
    if one.flight is not None:
        own = take(one.flight.own, slice(None, end * SUBSTEPS + 1))
        others = take(one.flight.intruders, slice(None, end + 1))
        axes.plot(own.x / _KM, own.y / _KM, color=BLUE, linewidth=1.4, label="aircraft")
        for k in np.flatnonzero(one.scene.encounter.mask[0]):
            label = "intruder" if k == 0 else None
            axes.plot(others.x[:, k] / _KM, others.y[:, k] / _KM, color=VERMILION, linestyle="--", label=label)
            axes.plot(others.x[0, k] / _KM, others.y[0, k] / _KM, "s", color=VERMILION, markersize=4)
    if one.made is not None and one.legs is not None and one.errors is not None:
        knots = one.made.plans.proposals.knots
        shown = knots.time[0] <= end
        place = VehicleState(*(field[0, shown] for field in knots[:4]))
        over = over_ground(place, one.scene.frame, knots.time[0, shown])
        axes.plot(over.x / _KM, over.y / _KM, "o", color="black", markersize=3, fillstyle="none", label="waypoints")
    axes.set_aspect("equal", adjustable="datalim")
    axes.tick_params(labelsize=7)
    axes.grid(color="#EBEBEB", linewidth=0.5)
    axes.legend(frameon=False, fontsize=7)


def _separation(axes: Any, one: Flown, rules: Rules) -> str:
    if one.flight is not None and one.flight.separation.size:
        apart = one.flight.separation
        axes.plot(np.arange(1, apart.size + 1), apart / _KM, color=BLUE, linewidth=1.0)
        axes.set_ylim(0.0, min(6.0, 1.05 * float(apart.max()) / _KM))
    axes.axhline(rules.separation / _KM, color=VERMILION, linewidth=0.8, linestyle="--")
    return "separation, km"


def _cross(axes: Any, one: Flown, _: Rules) -> str:
    if one.errors is not None:
        axes.plot(_clock(one), one.errors.cross_track, color=BLUE, linewidth=0.9)
    return "cross-track, m"


def _along(axes: Any, one: Flown, _: Rules) -> str:
    if one.errors is not None:
        axes.plot(_clock(one), one.errors.along_track, color=BLUE, linewidth=0.9)
    return "along-track, m"


def _late(axes: Any, one: Flown, _: Rules) -> str:
    if one.errors is not None and one.legs is not None:
        times = one.legs.time + one.legs.duration
        at = np.minimum(np.round(times / PERIOD).astype(int), one.errors.late.size - 1)
        axes.plot(_clock(one), one.errors.late, color=BLUE, linewidth=0.9)
        axes.plot(times, one.errors.late[at], "o", color="black", markersize=3, fillstyle="none")
    return "arrival, s late"


def _accumulated(axes: Any, one: Flown, _: Rules) -> str:
    if one.errors is not None:
        clock = _clock(one)
        for errors, color, name in (
            (np.abs(one.errors.cross_track), ORANGE, "across"),
            (one.errors.position, BLUE, "position"),
        ):
            axes.plot(clock, PERIOD * np.cumsum(errors), color=color, linewidth=1.0, label=name)
        axes.legend(frameon=False, fontsize=7)
    return "accumulated, m s"


def _clock(one: Flown) -> np.ndarray:
    assert one.errors is not None
    return PERIOD * np.arange(one.errors.late.size)
