"""A flight of :mod:`ros_bridge.mavlink.flight` as a picture: tracks, distance, altitude, speed."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from commands.figures import AREA_COLOUR, INTRUDER_COLOUR, OWN_COLOUR, draw_altitudes
from ros_bridge.mavlink.flight import (
    SEPARATION,
    Encounter,
    Intruder,
    Result,
    Row,
    apart,
    place_of,
)
from ros_bridge.mavlink.messages import Mode

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MODES = {Mode.AUTO: "0.5", Mode.GUIDED: OWN_COLOUR}
_MARKS = 20  # s between two marks on the tracks
_ROOM = 2.5 * SEPARATION  # m drawn about the ownship's track


def draw(encounter: Encounter, flight: Result, file: Path) -> None:
    """Draw the tracks from above, and distance, altitude and speed over time, into a file."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplot_mosaic(
        [["tracks"] * 3, ["distance", "altitude", "speed"]],
        figsize=(10.0, 6.5),
        height_ratios=(3, 2),
        layout="constrained",
    )
    _draw_tracks(axes["tracks"], encounter, flight)
    _draw_distances(axes["distance"], encounter, flight)
    _draw_altitudes(axes["altitude"], encounter, flight)
    _draw_speed(axes["speed"], flight)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _draw_tracks(axis: "Axes", encounter: Encounter, flight: Result) -> None:
    """Draw where all were until the mission is flown again, with the times, and the separation
    about each intruder where it was nearest.
    """
    rows = _until_back(flight)
    for mode, colour in _MODES.items():
        places_in_mode = [
            (row.x, row.y) if row.mode == mode else (math.nan, math.nan) for row in rows
        ]
        axis.plot(*zip(*places_in_mode, strict=True), lw=2, color=colour, label=mode.name)
    if encounter.fence:
        axis.fill(
            *zip(*encounter.fence, strict=True),
            color=AREA_COLOUR,
            alpha=0.35,
            fill=not encounter.keep_in,
            label="geofence",
        )
    axis.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    axis.set_xlim(rows[0].x - _ROOM, rows[-1].x + _ROOM)
    axis.set_ylim(min(row.y for row in rows) - _ROOM, max(row.y for row in rows) + _ROOM)
    marks = _marked(rows)
    _mark(axis, [(row.time, row.x, row.y) for row in marks], OWN_COLOUR)
    for number, intruder in enumerate(encounter.intruders):
        places = [place_of(intruder, row.time, encounter.cruise)[:2] for row in rows]
        label = "_" if number else "traffic"
        axis.plot(*zip(*places, strict=True), "--", lw=1, color=INTRUDER_COLOUR, label=label)
        intruder_marks = [
            (row.time, *place_of(intruder, row.time, encounter.cruise)[:2]) for row in marks
        ]
        _mark(axis, intruder_marks, INTRUDER_COLOUR)
        _draw_nearest(axis, intruder, encounter, flight)
    axis.legend(loc="upper right")


def _mark(axis: "Axes", places: Sequence[tuple[float, float, float]], colour: str) -> None:
    """Draw points with their times: s, m, m."""
    for time, x, y in places:
        axis.plot(x, y, "o", ms=4, color=colour)
        axis.annotate(
            f"{time:.0f} s",
            (x, y),
            (4, 4),
            textcoords="offset points",
            fontsize=8,
            color=colour,
            annotation_clip=True,
            clip_on=True,
        )


def _draw_nearest(axis: "Axes", intruder: Intruder, encounter: Encounter, flight: Result) -> None:
    """Draw the required separation about an intruder when it was nearest, and where it was seen
    from.
    """
    from matplotlib.patches import Circle

    nearest = min(flight.rows, key=lambda row: apart(row, intruder, encounter.cruise))
    x, y, _ = place_of(intruder, nearest.time, encounter.cruise)
    axis.add_patch(Circle((x, y), SEPARATION, fill=False, color=INTRUDER_COLOUR, ls=":"))
    axis.plot([nearest.x, x], [nearest.y, y], "-", lw=1, color="black")


def _draw_distances(axis: "Axes", encounter: Encounter, flight: Result) -> None:
    times = [row.time for row in flight.rows]
    for intruder in encounter.intruders:
        axis.plot(
            times,
            [apart(row, intruder, encounter.cruise) for row in flight.rows],
            color=INTRUDER_COLOUR,
        )
    axis.axhline(SEPARATION, color=INTRUDER_COLOUR, ls=":", label="to be kept")
    axis.set(xlabel="time, s", ylabel="distance over the ground, m", ylim=(0, None))
    axis.legend()


def _draw_altitudes(axis: "Axes", encounter: Encounter, flight: Result) -> None:
    times = [row.time for row in flight.rows]
    intruders = [[intruder.above(time) for time in times] for intruder in encounter.intruders]
    draw_altitudes(axis, times, [row.above for row in flight.rows], intruders)
    in_auto = [row.above if row.mode == Mode.AUTO else math.nan for row in flight.rows]
    axis.plot(times, in_auto, color=_MODES[Mode.AUTO])
    axis.set(ylabel="above mean sea level, m")


def _draw_speed(axis: "Axes", flight: Result) -> None:
    for mode, colour in _MODES.items():
        speeds = [row.speed if row.mode == mode else math.nan for row in flight.rows]
        axis.plot([row.time for row in flight.rows], speeds, color=colour, label=mode.name)
    axis.set(xlabel="time, s", ylabel="speed over the ground, m/s")
    axis.legend()


def _until_back(flight: Result) -> tuple[Row, ...]:
    """Return the rows until some time after the last in GUIDED; all where there is none."""
    last = max((row.time for row in flight.rows if row.mode == Mode.GUIDED), default=math.inf)
    return tuple(row for row in flight.rows if row.time <= last + _MARKS)


def _marked(rows: Sequence[Row]) -> list[Row]:
    """Return the first row of every so many seconds."""
    marked: dict[int, Row] = {}
    for row in rows:
        marked.setdefault(int(row.time) // _MARKS, row)
    return list(marked.values())
