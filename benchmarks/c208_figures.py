"""The true aircraft in pictures: ``python -m benchmarks.c208_figures --out DIR``.

``aircraft``: accelerations at idle and full power against speed, beside the surrogate's limits;
model against published points; the answer to a step of the bank. ``steps``: air speed and
acceleration after steps of the speed demanded, up and down, as in the paper's appendix.
``envelope``: the same limits over weights and altitudes.
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from commands.command import Parser, run_cli
from commands.figures import save_figure
from envs.c208.conditions import Conditions, Loading
from envs.c208.facts import GRAVITY, POINTS, value
from envs.c208.validate import envelope, measure
from envs.c208.vehicle import LOG_COLUMNS, C208Vehicle
from envs.follower import PERIOD
from envs.frames import Ground
from envs.kinematics import C208_PUBLISHED, SURROGATE, VehicleState
from eval.plots import save
from eval.plots.style import BLUE, GREEN, ORANGE, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Margins", "figure", "limits_figure", "main", "margins", "step", "steps_figure"]

_UP = ((55.0, 65.0), (60.0, 75.0), (70.0, 85.0), (80.0, 95.0))
_DOWN = ((95.0, 80.0), (85.0, 70.0), (75.0, 60.0), (65.0, 55.0))
_SECONDS = 60.0
_COLORS = (ORANGE, GREEN, BLUE, VERMILION)
_KNOT = 0.514444  # m/s


def figure() -> "Figure":
    """Return the three panels."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(9.0, 7.4), layout="constrained")
    places = picture.subplot_mosaic([["speeds", "step"], ["published", "published"]])
    _accelerations(places["speeds"])
    _step(places["step"])
    _deviations(places["published"])
    return picture


def _accelerations(axes: "Axes") -> None:
    for name, color, label in (("ex", BLUE, "EX, 867 shp"), ("675", ORANGE, "675 shp")):
        speed, low, high = np.array(envelope(name)).T
        axes.plot(speed, high, color=color, label=label)
        axes.plot(speed, low, color=color, linestyle="--")
    limits = SURROGATE
    slow, fast = limits.speed_min, limits.speed_max
    low, high = limits.acceleration_min, limits.acceleration_max
    axes.plot(
        [slow, fast, fast, slow, slow],
        [low, low, high, high, low],
        color="black",
        linewidth=1.0,
        label="surrogate's limits",
    )
    speed, _, most = np.array(envelope("ex")).T
    inside = (speed >= slow) & (speed <= fast)
    short = np.minimum(most, high)
    axes.fill_between(
        speed[inside],
        short[inside],
        high,
        color=VERMILION,
        alpha=0.35,
        label="not possible (EX)",
    )
    axes.set_xlabel("true airspeed, m/s")
    axes.set_ylabel("acceleration in level flight, m/s²")
    axes.set_title("full power (solid) and idle (dashed), 2500 m", fontsize=10)
    axes.set_ylim(None, 1.9)  # room for the legend above the curves
    axes.legend(frameon=False, fontsize=8, loc="upper right", ncols=2)


def _deviations(axes: "Axes") -> None:
    """Draw how far the model is from what is published, and how far it may be, %."""
    rows = [
        (point, 100.0 * (measure(point) / point.value - 1.0))
        for point in POINTS
        if point.quantity != "glide"
    ]
    for number, (point, off) in enumerate(rows):
        allowed = 100.0 * (
            point.tolerance / point.value if point.quantity == "stall" else point.tolerance
        )
        axes.barh(number, 2.0 * allowed, left=-allowed, color="#E5E5E5")
        axes.plot(off, number, "o", color=BLUE if point.use == "check" else ORANGE)
    names = [
        f"{point.quantity}: {point.name}" + (f", {point.altitude:.0f} ft" if point.altitude else "")
        for point, _ in rows
    ]
    axes.set_yticks(range(len(rows)), names, fontsize=8)
    axes.invert_yaxis()
    widest = 1.1 * max(abs(end) for end in axes.get_xlim())
    axes.set_xlim(-widest, widest)
    axes.axvline(0.0, color="black", linewidth=0.6)
    axes.set_xlabel("model minus published, %; grey: tolerance")
    axes.set_title("checks (blue) and fits (orange)", fontsize=11)


def _step(axes: "Axes") -> None:
    for speed, color in ((58.0, ORANGE), (75.0, BLUE), (95.0, VERMILION)):
        vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, speed))
        for _ in range(80):
            vehicle.step(0.0, GRAVITY * math.tan(math.radians(30.0)) / speed, 0.1)
        log = vehicle.log()
        bank = -np.degrees(log[:, LOG_COLUMNS.index("bank")])
        axes.plot(log[:, 0], bank, color=color, label=f"{speed:.0f} m/s")
    axes.set_xlabel("time, s")
    axes.set_ylabel("bank to the left, deg")
    axes.set_title("a turn demanded at 0 s", fontsize=11)
    axes.legend(frameon=False)


def steps_figure() -> "Figure":
    """Return the answers to steps of the speed demanded: acceleration above all that can be had,
    then hold.

    The demand is half of the speed's error a second. The surrogate's limits are drawn in.
    """
    from matplotlib.figure import Figure

    picture = Figure(figsize=(9.6, 6.6), layout="constrained")
    grid = picture.subplots(2, 2, sharex=True)
    for column, (steps, title) in enumerate(((_UP, "acceleration"), (_DOWN, "deceleration"))):
        for (first, last), color in zip(steps, _COLORS, strict=True):
            time, speed, gain = step(first, last)
            grid[0, column].plot(time, speed, color=color, label=f"{first:.0f} to {last:.0f} m/s")
            grid[0, column].axhline(last, color=color, linewidth=0.6, linestyle=":")
            grid[1, column].plot(time, gain, color=color)
        limit = SURROGATE.acceleration_max if column == 0 else SURROGATE.acceleration_min
        grid[1, column].axhline(
            limit, color="black", linestyle="--", linewidth=1.0, label="surrogate's limit"
        )
        grid[0, column].set_title(f"steps of the speed: {title}, 8807 lb, 2500 m", fontsize=9.5)
        grid[0, column].legend(frameon=False, fontsize=8)
        grid[1, column].legend(frameon=False, fontsize=8)
        grid[1, column].set_xlabel("time, s")
    for row, label in enumerate(("true airspeed, m/s", "acceleration, m/s²")):
        grid[row, 0].set_ylabel(label)
    return picture


def step(first: float, last: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (s), air speed (m/s) and acceleration (m/s^2) after a step of the speed demanded,
    ``[T]`` each.
    """
    vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, first))
    low, high = C208_PUBLISHED.acceleration_min, C208_PUBLISHED.acceleration_max
    for _ in range(round(_SECONDS / PERIOD)):
        # Twice what is published may be asked for: what comes is the aircraft's own limit.
        demand = 0.5 * (last - vehicle.state.speed)
        vehicle.step(min(max(demand, 2.0 * low), 2.0 * high), 0.0, PERIOD)
    log = vehicle.log()
    time, speed = log[:, LOG_COLUMNS.index("time")], log[:, LOG_COLUMNS.index("speed")]
    return time, log[:, LOG_COLUMNS.index("airspeed")], np.gradient(speed, time)


def limits_figure() -> "Figure":
    """Return where the surrogate's limits lie inside the aircraft's, over weights, altitudes and
    speeds.
    """
    from matplotlib.figure import Figure

    picture = Figure(figsize=(9.6, 3.8), layout="constrained")
    left, middle, right = picture.subplots(1, 3, sharey=True)
    altitudes = np.array([500.0, 1500.0, 2500.0, 3500.0, 4500.0, 5500.0])
    for weight, color in ((6500.0, GREEN), (7700.0, BLUE), (8807.0, VERMILION)):
        rows = [margins(weight, float(altitude)) for altitude in altitudes]
        slowest, fastest = [row.slowest for row in rows], [row.fastest for row in rows]
        left.plot(slowest, altitudes, color=color, label=f"{weight:.0f} lb")
        left.plot(fastest, altitudes, color=color, linestyle="--")
        middle.plot([row.fastest_accelerating for row in rows], altitudes, color=color)
        right.plot([row.deceleration for row in rows], altitudes, color=color)
    left.axvspan(SURROGATE.speed_min, SURROGATE.speed_max, color="#E5E5E5", label="surrogate")
    left.set_xlabel("true airspeed, m/s")
    left.set_title("1.08 times the stall (solid), VMO (dashed)", fontsize=9.5)
    middle.axvline(SURROGATE.speed_max, color="black", linestyle="--", linewidth=1.0)
    middle.set_xlabel("fastest with 0.5 m/s² to spare, m/s")
    right.axvline(-SURROGATE.acceleration_min, color="black", linestyle="--", linewidth=1.0)
    right.set_xlabel("least deceleration at idle, m/s²")
    middle.set_title("dashed: the surrogate's maximum", fontsize=9.5)
    right.set_title("at 50 to 100 m/s; dashed: the surrogate's", fontsize=9.5)
    left.set_ylabel("altitude, m")
    for axes in (left, middle, right):
        axes.grid(color="#EBEBEB", linewidth=0.5)
    left.legend(framealpha=1.0, edgecolor="white", fontsize=8)
    return picture


class Margins(NamedTuple):
    """What bounds the surrogate's limits; true airspeeds in m/s."""

    slowest: float
    fastest: float
    fastest_accelerating: float
    """At which 0.5 m/s^2 of acceleration are left; nan: at none."""
    deceleration: float
    """The least at idle between 50 and 100 m/s, m/s^2."""


def margins(weight: float, altitude: float) -> Margins:
    """Return what bounds the surrogate's limits at a weight (lb) and altitude (m) of the EX."""
    start: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 75.0)
    vehicle = C208Vehicle(start, "ex", Conditions(Loading(weight=weight)), altitude)
    slow = 1.08 * vehicle.autopilot.stall_speed(vehicle.measured)
    fast = value("speed_max_operating") * _KNOT * math.sqrt(1.225 / vehicle.measured.density)
    speeds, low, high = np.array(envelope("ex", Loading(weight=weight), altitude)).T
    # The acceleration falls with the speed: from the largest speed down it rises, as interp wants.
    accelerating = np.interp(
        SURROGATE.acceleration_max, high[::-1], speeds[::-1], left=math.nan, right=math.nan
    )
    within = (speeds >= SURROGATE.speed_min) & (speeds <= SURROGATE.speed_max)
    return Margins(slow, fast, float(accelerating), float(-low[within].max()))


def main() -> int:
    """Draw; return the exit code."""
    parser = Parser(prog="python -m benchmarks.c208_figures", description=__doc__)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("runs/c208"),
        help="folder of the pictures (default runs/c208)",
    )
    options = parser.parse_args()
    save.create(options.out)
    for name, draw in (("aircraft", figure), ("steps", steps_figure), ("envelope", limits_figure)):
        for path in save_figure(draw(), options.out / name):
            print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    run_cli("benchmarks.c208_figures:main")
