"""Figures of a run of flights: a sheet of some with every error, how near the aircraft came, and
how far it was off.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from threadpoolctl import threadpool_limits

from agents.policy.inference import Policy
from commands.figures import draw_altitudes, save_figure
from envs.follower import PERIOD
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.outcome import Rules
from envs.trees import take
from envs.wind import over_ground
from eval.flights.plan_flight import SUBSTEPS
from eval.flights.recorded import Track
from eval.hifi.errors import Errors
from eval.hifi.flight import Flight
from eval.hifi.flights import Campaign, FlightRecord, fly_one, prepare
from eval.hifi.rows import held_altitude
from eval.plots.encounters import separation_histogram
from eval.plots.flight_sheet import area_sample, draw, explain
from eval.plots.style import BLUE, GREEN, ORANGE, VERMILION, sample, tidy

_SHOWN = 4
_FEWEST = 1e-6  # per cent of flights, less than any run has
_NEAREST = 0.1  # m, where the axis of the errors begins
_KM = 1_000.0
_AFTER = 60.0  # the rejoining that the track is shown for, s
_ERRORS = {
    "path_definition_max_m": ("path definition", GREEN),
    "position_error_max_m": ("flight-technical", BLUE),
    "total_error_max_m": ("total, policy's part", ORANGE),
    "separation_loss_m": ("separation lost against the plan", VERMILION),
}
"""What the errors are called, and their colours, by the columns of their largest values."""
_WAYPOINT: dict[str, Any] = {
    "linestyle": "",
    "marker": "o",
    "color": "black",
    "markersize": 3,
    "fillstyle": "none",
}


def draw_all(folder: Path, table: Mapping[str, np.ndarray], campaign: Campaign) -> list[Path]:
    """Draw every figure of a run into its folder and return the paths."""
    numbers = choose_flights(table)
    with threadpool_limits(1):
        loaded = prepare(campaign._replace(viewer=None), Policy.load(campaign.policy))
        flights = [(_title(table, number), fly_one(*loaded, number)) for number in numbers]
    figures = {"flights": sheet(flights, campaign.aircraft.rules())}
    if np.isfinite(table["min_separation_m"]).any():
        figures["min_separation"] = separation_histogram(table, campaign.aircraft.separation)
    if np.isfinite(table["position_error_max_m"]).any():
        figures["errors"] = distributions(table)
    return [path for name, figure in figures.items() for path in save_figure(figure, folder / name)]


def _title(table: Mapping[str, np.ndarray], number: int) -> str:
    closest, speed = table["min_separation_m"][number], table["wind_m_s"][number]
    apart = [] if np.isnan(closest) else [f"{closest:.0f} m"]
    wind = [f"wind {speed:.0f} m/s"] if speed else []
    # Two lines: a panel is too narrow for all of it in one.
    return f"{number}: {table['outcome'][number]}\n{', '.join(apart + wind)}".strip()


def choose_flights(table: Mapping[str, np.ndarray]) -> list[int]:
    """Return the numbers of the flights for the sheet: those that did not reach their goal
    first.
    """
    # A refused flight has no track to show.
    order = np.lexsort((table["outcome"] == "reached", table["outcome"] == "refused"))
    return order[:_SHOWN].tolist()


def distributions(table: Mapping[str, np.ndarray]) -> Figure:
    """Return how far the aircraft was from its SAFE plans: for each distance the share of flights
    that were farther away.
    """
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.add_subplot()
    safe = table["plan_status"] == "safe"
    largest, fewest = _NEAREST, 50.0
    for name, (label, colour) in _ERRORS.items():
        values = table[name][safe]
        distances = np.sort(values[np.isfinite(values)])
        if distances.size:
            _draw_beyond(axes, distances, label, colour)
            fewest = min(fewest, 50.0 / distances.size)
            largest = max(largest, float(distances[-1]))
    axes.set_xscale("log")
    axes.set_xlim(_NEAREST, 1.2 * largest)
    axes.set_yscale("log")
    axes.set_ylim(fewest, 120.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("largest distance in a flight, m")
    axes.set_ylabel("flights beyond it, %")
    axes.legend(frameon=False, fontsize=8, loc="best")
    tidy(axes, "both")
    return figure


def _draw_beyond(axes: Axes, distances: np.ndarray, label: str, colour: str) -> None:
    """Draw for each of some distances, ascending, m, ``[M]``, how many of them are greater, %."""
    # A separation that was gained is no loss: on this axis it is at its left end.
    places = np.concatenate([[_NEAREST], np.maximum(distances, _NEAREST)])
    beyond = 100.0 * np.arange(distances.size, -1, -1) / distances.size
    beyond[-1] = _FEWEST  # below the axis, which has no zero
    axes.step(places, beyond, color=colour, label=label, where="post")


def sheet(flights: Sequence[tuple[str, FlightRecord]], rules: Rules) -> Figure:
    """Return a sheet with a column a flight, each with a title; the errors only where there are
    any.
    """
    rows = ["separation, km"]
    if any(record.scene.levels is not None for _, record in flights):
        rows.append("altitude, m")
    before = len(rows)  # the errors
    if any(record.errors is not None for _, record in flights):
        rows += ["cross-track, m", "along-track, m", "arrival, s late", "accumulated, m s"]
    count = len(flights)
    # Narrow panels: a page shows four of them side by side, with letters that can be read.
    figure = Figure(figsize=(max(2.4 * count, 4.8), 3.4 + 1.3 * len(rows)), layout="constrained")
    grid = figure.add_gridspec(1 + len(rows), count, height_ratios=[2.0, *([1.0] * len(rows))])
    for i, (title, record) in enumerate(flights):
        axes = figure.add_subplot(grid[0, i])
        axes.set_title(title, fontsize=9)
        _draw_flight(axes, record, rules)
        axes.set_xlabel("east, km", fontsize=8)
        axes.set_ylabel("north, km" if i == 0 else "", fontsize=8)
        for row, label in enumerate(rows, 1):
            below = figure.add_subplot(grid[row, i])
            if row == 1:
                _draw_separation(below, record, rules)
            elif row <= before:
                _draw_altitudes(below, record)
            elif record.errors is not None:
                _draw_error(below, row - before - 1, record.errors)
            below.set_ylabel(label if i == 0 else "", fontsize=8)
            below.tick_params(labelsize=7)
            below.grid(color="#EBEBEB", linewidth=0.5)
            below.set_xlabel("time, s" if row == len(rows) else "", fontsize=8)
    more = [sample("waypoints", **_WAYPOINT)] if len(rows) > before else []
    more += [area_sample()] if any(record.scene.areas for _, record in flights) else []
    own_separations = any(record.scene.distance_scale is not None for _, record in flights)
    explain(figure, rules, *more, own_separations=own_separations)
    return figure


def _draw_flight(axes: Axes, record: FlightRecord, rules: Rules) -> None:
    """Draw a flight from above, and the waypoints of its plan."""
    rejoin = (
        rules.t_max
        if record.initial is None
        else float(record.initial.plans.candidates.rejoin_time[0])
    )
    # What comes later is the route, a straight line.
    end = round(rejoin + _AFTER) if np.isfinite(rejoin) else round(rules.t_max)
    if record.flight is not None:
        draw(axes, _track_until(record, record.flight, end), rules)
    if record.initial is not None and record.legs is not None and record.errors is not None:
        plan_states = record.initial.plans.candidates.plan_states
        shown = plan_states.time[0] <= end
        place: VehicleState[Air] = VehicleState(*(field[0, shown] for field in plan_states[:4]))
        over = over_ground(place, record.scene.frame, plan_states.time[0, shown])
        axes.plot(over.x / _KM, over.y / _KM, **_WAYPOINT)


def _track_until(record: FlightRecord, flight: Flight, end: int) -> Track:
    """Return the track of a flight to its end, or until a time, s."""
    # The last second of an aircraft that was lost is not whole.
    seconds = min(end, flight.separation.size)
    own = take(flight.own, slice(None, seconds * SUBSTEPS + 1, SUBSTEPS))
    route, every, exist = (
        record.scene.route,
        record.scene.encounter.separation,
        record.scene.encounter.mask,
    )
    others = take(flight.intruders, (slice(None, end + 1), exist[0]))
    return Track(
        own=np.stack([own.x, own.y]),
        intruders=np.stack([others.x.T, others.y.T], axis=1),
        separation=flight.separation[:end],
        goal=(float(route.x[1]), float(route.y[1])),
        areas=record.scene.areas,
        required=None if every is None else every[exist],
    )


def _draw_separation(axes: Axes, record: FlightRecord, rules: Rules) -> None:
    if record.flight is not None and record.flight.separation.size:
        apart = record.flight.separation
        axes.plot(np.arange(1, apart.size + 1), apart / _KM, color=BLUE, linewidth=1.0)
        axes.set_ylim(0.0, min(6.0, 1.05 * float(apart.max()) / _KM))
    axes.axhline(rules.separation / _KM, color=VERMILION, linewidth=0.8, linestyle="--")


def _draw_altitudes(axes: Axes, record: FlightRecord) -> None:
    """Draw the altitudes of a flight, of plans and backups that it flew, and of the intruders."""
    flight, levels = record.flight, record.scene.levels
    if flight is None or levels is None:
        return
    clock = PERIOD * np.arange(flight.altitude.size)
    others = levels.altitudes(clock)[:, record.scene.encounter.mask[0]]
    draw_altitudes(
        axes, clock, flight.altitude, others.T, held_altitude(record, clock.size).altitude
    )


def _draw_error(axes: Axes, number: int, errors: Errors) -> None:
    """Draw an error over time: across the path, along it, in time, or (the fourth) accumulated."""
    clock = PERIOD * np.arange(errors.late.size)
    if number < 3:
        axes.plot(clock, errors[number], color=BLUE, linewidth=0.9)
        return
    for values, color, name in (
        (np.abs(errors.cross_track), ORANGE, "across"),
        (errors.position, BLUE, "position"),
    ):
        axes.plot(clock, PERIOD * np.cumsum(values), color=color, linewidth=1.0, label=name)
    axes.legend(frameon=False, fontsize=7)
