"""The two figures of a hyper-parameter search: its course, and the objective over each key."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.config.figures import save_figure
from rlcas_jax.figures import STYLE
from rlcas_jax.sweep.space import Choices, Parameter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rlcas_jax.sweep.report import Row

__all__ = ["sweep_figures"]

_BLUE, _ORANGE, _GREY = "#0072b2", "#d55e00", "#767676"  # apart for every kind of colour vision
_STYLE: dict[Any, Any] = STYLE | {"axes.axisbelow": True}
_LABELS = {"success": "resolved of the resolvable, %", "score": "mean sparse return"}


def sweep_figures(
    rows: Sequence["Row"],
    space: Sequence[Parameter],
    objective: str,
    importance: Mapping[str, float] | None,
    out: Path,
) -> list[Path]:
    """Draw ``history`` (objective by trial and the best so far) and ``slices`` (objective over each key).

    Args:
        rows: the trials by number.
        space: the keys.
        objective: success (drawn in per cent) or score.
        importance: of each key, shown with it; None where it is not known.
        out: directory of the files; made if it is not there.

    Returns:
        The files, PNG and SVG; none without a complete trial.
    """
    import matplotlib as mpl

    if all(row.value is None for row in rows):
        return []
    out.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(_STYLE):
        return [
            *save_figure(_history(rows, objective), out / "history"),
            *save_figure(_slices(rows, space, objective, importance), out / "slices"),
        ]


def _history(rows: Sequence["Row"], objective: str) -> "Figure":
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    done = [(row.trial, _scaled(row.value, objective)) for row in rows if row.value is not None]
    # A trial that was stopped early is shown by its last evaluation: all encounters, not the resolvable ones alone.
    cut = [(row.trial, _scaled(row.evaluations[-1], objective)) for row in rows if _cut(row)]
    axes.plot(*zip(*done, strict=True), "o", color=_BLUE, markersize=4.5, label="complete")
    if cut:
        axes.plot(*zip(*cut, strict=True), "x", color=_GREY, markersize=5.0, label="stopped early, last evaluation")
    best, steps = -math.inf, []
    for number, value in done:
        best = max(best, value)
        steps.append((number, best))
    steps.append((rows[-1].trial, best))
    axes.plot(*zip(*steps, strict=True), color=_ORANGE, linewidth=1.5, drawstyle="steps-post", label="best so far")
    axes.set(title="Course of the search", xlabel="trial", ylabel=_LABELS[objective])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="best")
    return figure


def _slices(
    rows: Sequence["Row"], space: Sequence[Parameter], objective: str, importance: Mapping[str, float] | None
) -> "Figure":
    from matplotlib.figure import Figure

    across = min(3, len(space))
    down = math.ceil(len(space) / across)
    figure = Figure(figsize=(max(3.4 * across, 4.5), 2.7 * down + 0.3), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, sharey=True).ravel()
    order = sorted(space, key=lambda parameter: -(importance or {}).get(parameter.key, 0.0))
    done = [row for row in rows if row.value is not None]
    for axes, parameter in zip(grid, order, strict=False):
        _slice(axes, done, parameter, objective)
        share = "" if importance is None else f", importance {importance.get(parameter.key, 0.0):.0%}"
        axes.set_title(f"{parameter.key}{share}", fontsize=9.0)
    for axes in grid[len(space) :]:
        axes.set_visible(False)
    figure.supylabel(_LABELS[objective], fontsize=9.0)
    return figure


def _slice(axes: "Axes", done: Sequence["Row"], parameter: Parameter, objective: str) -> None:
    from matplotlib.ticker import MaxNLocator

    values = [_scaled(row.value, objective) for row in done]
    best = max(range(len(values)), key=values.__getitem__)
    places: list[float]
    if isinstance(parameter, Choices):
        places = [float(parameter.texts.index(row.parameters[parameter.key])) for row in done]
        axes.set_xticks(range(len(parameter.texts)), [_short(text) for text in parameter.texts])
        axes.set_xlim(-0.5, len(parameter.texts) - 0.5)
    else:
        places = [float(row.parameters[parameter.key]) for row in done]
        if parameter.log:
            axes.set_xscale("log")
        elif parameter.whole:
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.plot(places, values, "o", color=_BLUE, markersize=4.0, alpha=0.7)
    axes.plot(places[best], values[best], "o", color=_ORANGE, markersize=6.0)


def _cut(row: "Row") -> bool:
    return row.value is None and bool(row.evaluations) and row.state != "unfinished"


def _scaled(value: float | None, objective: str) -> float:
    assert value is not None
    return 100.0 * value if objective == "success" else value


def _short(text: str) -> str:
    return text if len(text) <= 14 else f"{text[:13]}…"
