"""The figure of the comparison: score against environment steps and against wall time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from benchmarks.learning.curves import CONFIDENCE, Axis, Point, t_mean
from commands.figures import save_figure
from rlcas_jax.figures import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw"]


class _Look(NamedTuple):
    label: str
    color: str
    line: str


# Apart for every kind of colour vision, and by their lines where there is no colour.
_LOOKS = {
    "ours": _Look("this toolkit", "#0072b2", "-"),
    "sb3": _Look("Stable-Baselines3 PPO", "#d55e00", "--"),
    "sbx": _Look("SBX PPO", "#00795a", "-."),
}
_GREY = "#767676"
_PLACES = 200


def draw(
    curves: Mapping[str, Sequence[Sequence[Point]]], scores: Sequence[float], path: Path
) -> list[Path]:
    """Draw the learners' curves as PNG and SVG and return the files.

    Args:
        curves: of each learner's seeds.
        scores: that are marked.
        path: of the files, without suffix.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        _panel(left, curves, scores, "steps")
        _panel(right, curves, scores, "wall_s")
        left.set(
            title="For equal environment steps",
            xlabel="environment steps, millions",
            ylabel="training score",
        )
        right.set(title="For equal wall time", xlabel="wall time of training, s")
        seeds = max(len(runs) for runs in curves.values())
        note = (
            "one seed"
            if seeds == 1
            else f"mean and {CONFIDENCE:.0%} t interval of {seeds} seeds, each a thin line"
        )
        handles, labels = left.get_legend_handles_labels()
        figure.legend(
            handles,
            labels,
            loc="outside lower center",
            ncols=len(handles),
            title=note,
            title_fontsize=8.0,
        )
        return save_figure(figure, path)


def _panel(
    axes: "Axes",
    curves: Mapping[str, Sequence[Sequence[Point]]],
    scores: Sequence[float],
    along: Axis,
) -> None:
    end = 0.0
    for learner, runs in curves.items():
        seeds = [seed for seed in (_arrays(run, along) for run in runs) if len(seed.place)]
        if seeds:
            end = max(end, *(seed.place[-1] for seed in seeds))
            _draw_learner(axes, _LOOKS[learner], seeds)
    for score in scores:
        axes.axhline(score, color=_GREY, linewidth=1.0, linestyle=(0, (4, 3)))
        axes.annotate(
            f"+{score:.0f}",
            (1.0, score),  # right of the frame, where no curve is
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            ha="left",
            va="center",
            color=_GREY,
            fontsize=8.0,
        )
    axes.set(xlim=(0.0, 1.02 * end or 1.0), ylim=(-105.0, 105.0))


class _Seed(NamedTuple):
    """The curve of one seed, points with a score alone."""

    place: np.ndarray
    """Steps, in millions, or wall time, s."""
    score: np.ndarray


def _draw_learner(axes: "Axes", look: _Look, seeds: Sequence[_Seed]) -> None:
    """Draw the seeds, their mean as far as every seed goes, and its interval."""
    if len(seeds) > 1:
        for seed in seeds:
            axes.plot(*seed, color=look.color, linewidth=0.6, alpha=0.45)
    first, last = max(seed.place[0] for seed in seeds), min(seed.place[-1] for seed in seeds)
    places = np.linspace(first, last, _PLACES) if last > first else np.array([first])
    scores = np.array([np.interp(places, *seed) for seed in seeds])
    means = [t_mean(list(column)) for column in scores.T]
    axes.plot(
        places,
        [mean.value for mean in means],
        look.line,
        color=look.color,
        linewidth=1.8,
        marker="o" if len(places) == 1 else None,
        label=look.label,
    )
    if len(seeds) > 1:
        low, high = [mean.low for mean in means], [mean.high for mean in means]
        axes.fill_between(places, low, high, color=look.color, alpha=0.15, linewidth=0.0)


def _arrays(run: Sequence[Point], along: Axis) -> _Seed:
    scored = [point for point in run if np.isfinite(point.score)]
    places = np.array([getattr(point, along) for point in scored], float)
    scale = 1e-6 if along == "steps" else 1.0
    return _Seed(scale * places, np.array([point.score for point in scored]))
