"""The map of commands: turn rate and acceleration that a policy commands, over the intruder's
place.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import Normal, Stroke

from envs.aircraft import Aircraft
from eval.plots.style import BLUE, GREEN, ORANGE, VERMILION, arrow, legend, sample
from eval.policy_map.advisory import Advisory, name_of, relative_velocity

_KM = 1e-3
_WAY = 1.2  # arrows show what is flown in so many times of a separation at the greatest speed
_SLOW = 0.02  # relative speeds below this share of the greatest have no line of approach
# Okabe and Ito's colours at both ends; darkest at full deflection, white where nothing is
# commanded.
_TURN = LinearSegmentedColormap.from_list(
    "turn", ["#8A3B00", VERMILION, "#F7F7F7", BLUE, "#003A5C"]
)
_SPEED = LinearSegmentedColormap.from_list(
    "speed", ["#946200", ORANGE, "#F7F7F7", GREEN, "#00543E"]
)
# A white edge keeps what is drawn in black visible on dark cells.
_HALO = [Stroke(linewidth=3.0, foreground="white", alpha=0.9), Normal()]
_WIDE_HALO = [Stroke(linewidth=6.0, foreground="white"), Normal()]
_RING: dict[str, Any] = {"linestyle": "--", "linewidth": 1.2}
_EDGE: dict[str, Any] = {"linestyle": ":", "linewidth": 1.2}


def policy_map(advisories: Sequence[Advisory], aircraft: Aircraft, policy: str) -> Figure:
    """Return the figure: a row for each map, turn rate beside acceleration; full deflection is
    darkest.

    The maps, at least one, are of the same extent and differ in relative heading; the policy's name
    is for the title.
    """
    limits, scene, rows = aircraft.limits, advisories[0].scene, len(advisories)
    figure = Figure(figsize=(8.2, 3.7 * rows + 2.2), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    full = math.degrees(limits.yaw_rate_max)
    span = limits.acceleration_min, limits.acceleration_max
    commands = (
        _Command("turn rate, deg/s", _TURN, (-full, full), ("right", "left")),
        _Command("acceleration, m/s²", _SPEED, span, ("brake", "accelerate")),
    )
    for column, command in zip(axes.T, commands, strict=True):
        _draw_column(figure, column, advisories, aircraft, command)
    for (left, _), advisory in zip(axes, advisories, strict=True):
        heading = advisory.scene.relative_heading
        left.set_title(
            f"{name_of(heading)} ({math.degrees(heading):+.4g}°)", fontsize=11, loc="left"
        )
        left.set_ylabel("intruder ahead, km")
    for below in axes[-1]:
        below.set_xlabel("intruder to the right, km")
    figure.suptitle(
        f"Commands of {policy} for every place of the intruder\n"
        f"ownship at the origin, heading up, {scene.own_speed:g} m/s; intruder "
        f"{scene.intruder_speed:g} m/s; "
        f"goal at {_KM * scene.goal_distance:g} km, bearing "
        f"{math.degrees(scene.goal_bearing):+.0f}°\n"
        "in brackets: heading of the intruder minus own heading; angles count counter-clockwise",
        fontsize=11,
    )
    legend(figure, _handles(aircraft), 2, 10)
    return figure


class _Command(NamedTuple):
    """How one of the two commands is drawn."""

    label: str
    colours: LinearSegmentedColormap
    span: tuple[float, float]  # its least and greatest value
    ends: tuple[str, str]  # what these mean


def _draw_column(
    figure: Figure,
    panels: Sequence[Axes],
    advisories: Sequence[Advisory],
    aircraft: Aircraft,
    command: _Command,
) -> None:
    """Draw one of the two commands, a panel for each map, under the scale of its colours."""
    low, high = command.span
    norm = TwoSlopeNorm(0.0, low, high)
    for panel, advisory in zip(panels, advisories, strict=True):
        edge = _KM * advisory.extent
        turns = command.colours is _TURN
        panel.imshow(
            np.degrees(advisory.yaw_rate) if turns else advisory.acceleration,
            cmap=command.colours,
            norm=norm,
            extent=(-edge, edge, -edge, edge),
            origin="lower",
            interpolation="nearest",
        )
        _draw_geometry(panel, advisory, aircraft)
    bar = figure.colorbar(
        panels[0].images[0], ax=list(panels), location="top", aspect=26.0, pad=0.015
    )
    ticks = [low, 0.5 * low, 0.0, 0.5 * high, high]
    bar.set_ticks(ticks, labels=[f"{abs(tick):g}" for tick in ticks])
    least, greatest = command.ends
    bar.set_label(f"{least} \N{LEFTWARDS ARROW} {command.label} \N{RIGHTWARDS ARROW} {greatest}")


def _draw_geometry(axes: Axes, advisory: Advisory, aircraft: Aircraft) -> None:
    """Draw the aircraft, the required separation, the conflicts on straight courses and the
    goal.
    """
    edge, scene = _KM * advisory.extent, advisory.scene
    radius = _KM * aircraft.separation
    # Inside, the separation is lost already and the flight is over: the advice is shown faintly.
    axes.add_patch(Circle((0.0, 0.0), radius, facecolor="white", alpha=0.45, linewidth=0.0))
    axes.add_patch(
        Circle((0.0, 0.0), radius, fill=False, edgecolor="black", path_effects=_HALO, **_RING)
    )
    place = (-0.62 * edge, 0.62 * edge)
    east, north = relative_velocity(scene)
    speed = math.hypot(east, north)
    if speed > _SLOW * aircraft.limits.speed_max:
        origin = np.array([-east, -north]) / speed
        _draw_conflicts(axes, origin, radius, 3.0 * edge)
        x, y = 0.66 * edge / max(abs(origin)) * origin
        place = (x, y)
    _draw_aircraft(axes, (0.0, 0.0), 0.0, scene.own_speed, "own", aircraft)
    heading = scene.relative_heading
    _draw_aircraft(axes, place, heading, scene.intruder_speed, "intruder", aircraft)
    goal = np.array([-math.sin(scene.goal_bearing), math.cos(scene.goal_bearing)])
    tick = edge / max(abs(goal)) * np.stack([0.92 * goal, goal]).T
    axes.plot(
        *tick,
        color="black",
        linewidth=3.5,
        solid_capstyle="butt",
        path_effects=_WIDE_HALO,
        zorder=5.0,
    )
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal")


def _draw_conflicts(axes: Axes, origin: np.ndarray, radius: float, length: float) -> None:
    """Draw the edges, of some length, km, from between which straight courses lead into the circle;
    ``origin`` is where the intruder comes from, a unit vector.
    """
    for side in (-1.0, 1.0):
        foot = side * radius * np.array([-origin[1], origin[0]])
        ends = np.stack([foot, foot + length * origin])
        axes.plot(*ends.T, color="black", path_effects=_HALO, **_EDGE)


def _draw_aircraft(
    axes: Axes,
    place: tuple[float, float],
    heading: float,
    speed: float,
    name: str,
    aircraft: Aircraft,
) -> None:
    """Draw an aircraft at a place of the axes, km, by its heading, rad from up, and speed, m/s."""
    way = _KM * _WAY * aircraft.time_unit * speed
    direction = heading + math.pi / 2.0
    arrow(axes, place, direction, way, name, xytext=(6.0, -11.0), path_effects=_HALO)


def _handles(aircraft: Aircraft) -> list[Line2D]:
    tick: dict[str, Any] = {
        "marker": "|",
        "markersize": 10.0,
        "markeredgewidth": 3.5,
        "linestyle": "",
    }
    return [
        sample(f"{aircraft.separation:.0f} m around the ownship", color="black", **_RING),
        sample("between: conflict if both fly on straight", color="black", **_EDGE),
        sample(
            f"velocity: way in {_WAY * aircraft.time_unit:.0f} s",
            color="black",
            marker="o",
            linewidth=2.0,
        ),
        sample("towards the goal", color="black", **tick),
    ]
