"""The picture: one mission as both sides flew it, and how near they came to the intruders."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.icarous.judge import Track, distances
from benchmarks.icarous.missions import Mission, outline
from envs.aircraft import Aircraft
from envs.areas import Keep
from eval.plots.style import BLUE, GREY, ORANGE, SKY, VERMILION, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"icarous": ORANGE, "ours": BLUE}
_NAMES = {"icarous": "ICAROUS", "ours": "ours"}


def drawing(mission: Mission, flights: Mapping[str, Track], aircraft: Aircraft) -> "Figure":
    """Return the figure of one mission."""
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(
        2, 1, figsize=(7.2, 8.6), height_ratios=(3, 1), layout="constrained"
    )
    _draw_mission(above, mission, max(float(track.time[-1]) for track in flights.values()))
    for side, track in flights.items():
        style: dict[str, Any] = {"color": _COLOURS[side], "label": _NAMES[side]}
        above.plot(track.x / 1e3, track.y / 1e3, linewidth=2.0, **style)
        away = distances(track)
        if away.shape[1]:
            below.plot(track.time[:-1], away.min(axis=1), **style)
    below.axhline(aircraft.separation, color="k", linestyle=":", label="to be kept")
    places = np.concatenate([np.stack([track.x, track.y]) for track in flights.values()], axis=1)
    low, high = places.min(axis=1) / 1e3 - 1.5, places.max(axis=1) / 1e3 + 1.5
    above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    above.set(xlabel="east, km", ylabel="north, km", title=f"mission {mission.number}")
    below.set(xlabel="time, s", ylabel="to the nearest intruder, m", ylim=(0.0, None))
    above.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    below.legend(frameon=False, loc="upper left", fontsize=8)
    tidy(above, "both")
    tidy(below)
    return figure


def _draw_mission(axes: "Axes", mission: Mission, end: float) -> None:
    """Draw fences, waypoints, and the intruders' flights until a time, s."""
    for fence in mission.fences:
        x, y = np.array(outline(fence).exterior.coords).T / 1e3
        keep_out = fence.keep is Keep.OUT
        axes.plot(x, y, color=VERMILION if keep_out else SKY, linewidth=1.5)
        if keep_out:
            axes.fill(x, y, color=VERMILION, alpha=0.3, linewidth=0.0)
    axes.plot(*np.array(mission.waypoints).T / 1e3, "k:", marker="o", label="mission")
    for number, intruder in enumerate(mission.intruders):
        length = intruder.speed * end
        x = np.array([intruder.x, intruder.x + length * np.cos(intruder.heading)]) / 1e3
        y = np.array([intruder.y, intruder.y + length * np.sin(intruder.heading)]) / 1e3
        axes.plot(x, y, color=GREY, linewidth=1.0, label=None if number else "intruders")
        axes.plot(x[:1], y[:1], "o", color=GREY, markersize=4.0)
