"""Pictures of an encounter, as arrays or in a window (:mod:`envs.gym.window`).

A drawing owns its figure and its artists, which move from frame to frame. Colours follow Okabe and
Ito, so that they differ for colour-blind eyes, and also differ in lightness and shape.
"""

from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

OWNSHIP = "#0072b2"
INTRUDER = "#e69f00"
GOAL = "#009e73"
VIOLATION = "#b3001b"
_INK, _FAINT, _GRID, _PAPER = "#22272e", "#6a737d", "#e4e8ec", "#ffffff"

_INCHES = 6.0
_AXES = (0.1, 0.072, 0.85, 0.85)  # left, bottom, width, height as parts of the figure
_MARGIN, _MARGIN_PART = 1.1, 0.05  # km, and part of the extent, for the discs of 1 km and the texts
_NEAR = 5_000.0
"""An intruder that has left the scene is kept in view while it is closer than this, m."""
_LEADER = 60.0  # s of flight that the line ahead of an aircraft stands for
# Outline of an aircraft seen from above, nose along +x, of unit length.
_NOSE_TO_TAIL = [
    (0.5, 0.0),
    (0.42, 0.08),
    (0.2, 0.1),
    (0.1, 0.5),
    (-0.08, 0.5),
    (-0.06, 0.1),
    (-0.28, 0.07),
]
_OUTLINE = np.array([*_NOSE_TO_TAIL, (-0.34, 0.24), (-0.48, 0.24), (-0.44, 0.0)])
_AIRCRAFT = np.concatenate([_OUTLINE, _OUTLINE[-2:0:-1] * (1.0, -1.0)])
_OUTCOMES = {
    "reached": ("goal reached", GOAL),
    "violation": ("separation lost", VIOLATION),
    "timeout": ("out of time", _INK),
}


class Picture(NamedTuple):
    """An encounter up to now, with T + 1 moments of K intruders; SI units and radians."""

    own: np.ndarray  # x, y (m), heading (rad), speed (m/s), [T + 1, 4]
    intruders: np.ndarray  # the same of each intruder, [T + 1, K, 4]
    separations: np.ndarray
    """Smallest distance to each during the step that ends at that moment, m, ``[T + 1, K]``."""
    goal: tuple[float, float]  # m
    goal_radius: float  # m
    required: float  # separation below which a trail turns red, m
    time: float  # s since the start
    outcome: str  # as in info
    title: str = ""


def view(scene: Picture) -> tuple[float, float, float]:
    """Return the west and south edge and the side of the square to be seen, km.

    It holds the starts, the goal, the ownship's path and what is near it, and only grows during an
    encounter.
    """
    near = np.hypot(*np.moveaxis(scene.intruders[..., :2] - scene.own[:, None, :2], -1, 0)) < _NEAR
    near[0] = True
    points = np.concatenate([scene.own[:, :2], scene.intruders[near][:, :2], [scene.goal]]) / 1000.0
    # Whole kilometres, so that the picture seldom jumps.
    margin = _MARGIN + _MARGIN_PART * float(np.max(np.ptp(points, axis=0)))
    low, high = np.floor(points.min(axis=0) - margin), np.ceil(points.max(axis=0) + margin)
    side = float(np.max(high - low))
    west, south = (low + high - side) / 2.0
    return float(west), float(south), side


class Drawing:
    """The artists of a picture of ``size`` pixels a side, on a canvas of their own or on a window's
    figure.
    """

    def __init__(self, size: int = 600, figure: Figure | None = None) -> None:
        if figure is None:
            figure = Figure()
            FigureCanvasAgg(figure)
        figure.set_size_inches(_INCHES, _INCHES)
        figure.set_dpi(size / _INCHES)
        figure.set_facecolor(_PAPER)
        self.figure = figure
        self._build()

    def frame(self, scene: Picture) -> np.ndarray:
        """Return the picture, uint8 ``[size, size, 3]``."""
        self.update(scene)
        canvas = cast(FigureCanvasAgg, self.figure.canvas)
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def update(self, scene: Picture) -> None:
        """Draw the scene onto the canvas."""
        self._place(scene)
        self._move(scene)
        self.figure.canvas.draw()

    def _build(self) -> None:
        self._build_axes()
        self._build_route()
        self._build_aircraft()
        self._build_header()

    def _build_axes(self) -> None:
        axes = self.figure.add_axes(_AXES)
        axes.set_aspect("equal")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(nbins=8, integer=True))
        axes.set_facecolor(_PAPER)
        axes.grid(color=_GRID, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(color=_GRID, labelcolor=_FAINT, labelsize=8)
        for spine in axes.spines.values():
            spine.set_color(_GRID)
        axes.set_xlabel("east, km", color=_FAINT, fontsize=8.5, labelpad=2)
        axes.set_ylabel("north, km", color=_FAINT, fontsize=8.5, labelpad=1)
        self._axes = axes

    def _build_route(self) -> None:
        axes = self._axes
        (self._route,) = axes.plot(
            [], [], color=_FAINT, linewidth=1.0, linestyle=(0, (4, 4)), zorder=1
        )
        self._goal = axes.add_patch(
            Circle((0.0, 0.0), 1.0, facecolor=GOAL + "38", edgecolor=GOAL, linewidth=1.6)
        )
        (self._goal_mark,) = axes.plot(
            [], [], marker="*", markersize=9, color=GOAL, linestyle="none"
        )
        (self._start,) = axes.plot(
            [], [], marker="o", markersize=6, color=OWNSHIP, markerfacecolor=_PAPER, zorder=3
        )
        small = {"fontsize": 8.5, "clip_on": True, "ha": "center", "va": "center"}
        self._goal_text = axes.text(0.0, 0.0, "goal", color="#00704f", **small)
        self._start_text = axes.text(0.0, 0.0, "start", color=_FAINT, **small)

    def _build_aircraft(self) -> None:
        self._discs = PatchCollection([], zorder=2, linewidths=1.2)
        self._link = LineCollection([], zorder=3, linewidths=1.2, linestyles=[(0, (2, 2))])
        self._trails = LineCollection([], zorder=4, linewidths=2.0, capstyle="round")
        self._leaders = LineCollection([], zorder=4, linewidths=1.0)
        self._red = LineCollection([], zorder=5, linewidths=4.0, colors=VIOLATION, capstyle="round")
        self._planes = PolyCollection([], zorder=6, edgecolors=_INK, linewidths=0.7)
        for collection in (
            self._discs,
            self._link,
            self._trails,
            self._leaders,
            self._red,
            self._planes,
        ):
            self._axes.add_collection(collection, autolim=False)
        self._labels: list[Text] = []

    def _build_header(self) -> None:
        def header(x: float, y: float, align: str, **style: Any) -> Text:
            return self.figure.text(x, y, "", ha=align, va="baseline", **style)

        left, right = _AXES[0], _AXES[0] + _AXES[2]
        self._title = header(left, 0.968, "left", color=_INK, fontsize=11, fontweight="bold")
        self._figures = header(left, 0.935, "left", color=_INK, fontsize=9)
        self._clock = header(right, 0.968, "right", color=_INK, fontsize=11, fontweight="bold")
        self._outcome = header(right, 0.935, "right", color=_FAINT, fontsize=9, fontweight="bold")

    def _place(self, scene: Picture) -> None:
        """Move what belongs to the route, and the edges of the picture."""
        west, south, side = view(scene)
        self._axes.set_xlim(west, west + side)
        self._axes.set_ylim(south, south + side)
        self._pixel = side / (600.0 * _AXES[2])  # km a pixel of a picture of 600 px
        start, goal = scene.own[0, :2] / 1000.0, np.asarray(scene.goal) / 1000.0
        self._route.set_data(*zip(start, goal, strict=True))
        self._start.set_data([start[0]], [start[1]])
        self._goal_mark.set_data([goal[0]], [goal[1]])
        radius = scene.goal_radius / 1000.0
        self._goal.set(center=goal, radius=radius)
        # Beyond the ends of the route, where no trail begins.
        along = (goal - start) / max(float(np.hypot(*(goal - start))), 1e-6)
        aside = 10.0 + 10.0 * abs(along[0])
        self._goal_text.set_position(tuple(goal + along * (radius + aside * self._pixel)))
        self._start_text.set_position(tuple(start - along * (aside + 14.0) * self._pixel))

    def _move(self, scene: Picture) -> None:
        """Move what belongs to the aircraft."""
        # The ownship leads: [T + 1, 1 + K, 4]; places in km, [1 + K, T + 1, 2].
        aircraft = np.concatenate([scene.own[:, None], scene.intruders], axis=1)
        paths = np.moveaxis(aircraft[..., :2], 0, 1) / 1000.0
        places, heading, speed = paths[:, -1], aircraft[-1, :, 2], aircraft[-1, :, 3]
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        colours = [OWNSHIP] + [INTRUDER] * scene.intruders.shape[1]
        nearest = int(np.argmin(scene.separations[-1]))
        close = scene.separations < scene.required

        self._move_discs(places, close[-1], nearest, scene.required / 1000.0)
        self._move_trails(paths, close, colours)
        ends = places + ahead * speed[:, None] * (_LEADER / 1000.0)
        self._leaders.set(segments=np.stack([places, ends], axis=1), colors=colours)
        self._move_planes(places, ahead, colours)
        self._name(places, ahead, nearest)
        self._write(scene, speed)

    def _move_discs(
        self, places: np.ndarray, close: np.ndarray, nearest: int, radius: float
    ) -> None:
        """Move the discs of the required separation, km, around intruders ``[K]``, and the line
        from the ownship to the nearest one; red are those that are too close.
        """
        self._discs.set_paths([Circle(tuple(at), radius) for at in places[1:]])
        edges = [VIOLATION if near else INTRUDER for near in close]
        self._discs.set(
            facecolors=[edge + "26" for edge in edges], edgecolors=[edge + "b0" for edge in edges]
        )
        self._link.set(
            segments=[places[[0, nearest + 1]]], colors=VIOLATION if close[nearest] else _FAINT
        )

    def _move_trails(self, paths: np.ndarray, close: np.ndarray, colours: list[str]) -> None:
        """Draw the paths so far, and in red the steps of both that were too close,
        ``[T + 1, K]``.
        """
        self._trails.set(segments=paths, colors=colours)
        close_of_all = np.concatenate([close.any(axis=1, keepdims=True), close], axis=1)
        steps = np.stack([paths[:, :-1], paths[:, 1:]], axis=2)
        self._red.set_segments(list(steps[close_of_all[1:].T]))

    def _move_planes(self, places: np.ndarray, ahead: np.ndarray, colours: list[str]) -> None:
        """Draw the aircraft where they are, nose ahead."""
        sizes = np.array([34.0] + [27.0] * (len(places) - 1)) * self._pixel
        turn = np.stack([ahead, np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)], axis=1)
        outlines = (
            np.einsum("pi,nij->npj", _AIRCRAFT, turn) * sizes[:, None, None] + places[:, None]
        )
        self._planes.set(verts=list(outlines), facecolors=colours)

    def _name(self, places: np.ndarray, ahead: np.ndarray, nearest: int) -> None:
        """Write the names of the aircraft beside them, on the side away from what is near."""
        while len(self._labels) < len(places):
            style = {
                "fontsize": 8.5,
                "fontweight": "bold",
                "ha": "center",
                "va": "center",
                "zorder": 7,
            }
            colour = "#8a5f00" if self._labels else OWNSHIP
            self._labels.append(self._axes.text(0.0, 0.0, "", clip_on=True, color=colour, **style))
        only = len(places) == 2
        for index, label in enumerate(self._labels):
            label.set_visible(index < len(places))
            if index < len(places):
                side = np.array([ahead[index, 1], -ahead[index, 0]])
                near = places[nearest + 1 if index == 0 else 0]
                side = np.copysign(side, side * np.sign(side @ (places[index] - near) + 1e-9))
                far = 20.0 + (26.0 if only and index else 12.0) * abs(side[0])
                label.set_position(tuple(places[index] + side * far * self._pixel))
                label.set_text("own" if index == 0 else "intruder" if only else str(index))

    def _write(self, scene: Picture, speed: np.ndarray) -> None:
        """Write the texts above the picture; speeds are m/s, the ownship's first."""
        smallest = float(scene.separations.min())
        self._title.set_text(scene.title)
        self._clock.set_text(f"{scene.time:.0f} s")
        self._figures.set_text(
            f"separation {scene.separations[-1].min() / 1000.0:.2f} km   "
            f"least {smallest / 1000.0:.2f} km   own speed {speed[0]:.0f} m/s"
        )
        text, colour = _OUTCOMES.get(scene.outcome, ("", _FAINT))
        self._outcome.set(text=text, color=colour)
