"""Figures of a search: its history, every key against success, and the importance of the keys."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState

from commands.figures import save_figure
from rlcas_jax.figures import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ENOUGH = 8  # complete trials from which on importances say something
_ACROSS = 3  # panels in a row
_BLUE, _ORANGE = "#0072b2", "#d55e00"
_LEAST_SPAN = 2.0  # points of success that an axis shows at least
_LONGEST = 12  # characters of a choice on an axis


def draw(study: Study, directory: Path) -> list[Path]:
    """Draw the figures of a study with a complete trial, and return the files, PNG and SVG.

    Args:
        directory: of the files; made if it is not there.
    """
    import matplotlib as mpl

    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    figures: dict[str, Callable[[], Figure]] = {
        "history": lambda: _history(study, complete),
        "slices": lambda: _slices(complete),
    }
    if len(complete) >= _ENOUGH:
        figures["importance"] = lambda: _importance(study)
    directory.mkdir(exist_ok=True)
    files = []
    with mpl.rc_context(STYLE):
        for name, figure in figures.items():
            files += save_figure(figure(), directory / name)
    return files


def _history(study: Study, complete: list[FrozenTrial]) -> "Figure":
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.subplots()
    values = [_percent(trial) for trial in complete]
    best = [max(values[: count + 1]) for count in range(len(values))]
    numbers = [trial.number for trial in complete]
    axes.step(numbers, best, where="post", color=_ORANGE, label="best so far")
    axes.plot(numbers, values, "o", color=_BLUE, markersize=4.5, label="complete")
    pruned = study.get_trials(deepcopy=False, states=(TrialState.PRUNED,))
    if pruned:
        # At the bottom: what a pruned trial reached cannot be compared with a whole one.
        places = [trial.number for trial in pruned]
        bottom = axes.get_xaxis_transform()
        mark: dict[str, Any] = {"color": "#767676", "markersize": 5.0, "clip_on": False}
        axes.plot(places, [0.0] * len(places), "x", transform=bottom, label="pruned", **mark)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(title="History of the search", xlabel="trial", ylabel="success of the resolvable, %")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _slices(complete: list[FrozenTrial]) -> "Figure":
    """Return a panel for each key, at most three in a row."""
    from matplotlib.figure import Figure

    keys = sorted({key for trial in complete for key in trial.params})
    across = min(_ACROSS, len(keys))
    down = math.ceil(len(keys) / across)
    figure = Figure(figsize=(max(4.0, 3.2 * across), 2.5 * down), layout="constrained")
    panels = figure.subplots(down, across, sharey=True, squeeze=False)
    for number, axes in enumerate(panels.flat):
        if number < len(keys):
            _slice(axes, keys[number], complete)
        else:
            axes.set_axis_off()
    for row in panels:
        row[0].set_ylabel("success, %")
    reached = [_percent(trial) for trial in complete]
    low, high = min(reached), max(reached)
    middle, half = 0.5 * (low + high), 0.55 * max(high - low, _LEAST_SPAN)
    panels[0, 0].set_ylim(max(middle - half, -1.0), min(middle + half, 101.0))
    return figure


def _slice(axes: "Axes", key: str, complete: list[FrozenTrial]) -> None:
    trials = [trial for trial in complete if key in trial.params]
    distribution = trials[0].distributions[key]
    values: list[Any] = [trial.params[key] for trial in trials]
    if isinstance(distribution, CategoricalDistribution):
        choices = list(distribution.choices)
        values = [choices.index(value) for value in values]
        axes.set_xticks(range(len(choices)), [_short(choice) for choice in choices])
        axes.set_xlim(-0.5, len(choices) - 0.5)
    elif isinstance(distribution, FloatDistribution | IntDistribution) and distribution.log:
        axes.set_xscale("log")
        _label_logarithm(axes, distribution.low, distribution.high)
    else:
        axes.locator_params(axis="x", nbins=5)
    axes.plot(values, [_percent(trial) for trial in trials], "o", color=_BLUE, markersize=4.5)
    axes.set_title(key, fontsize=9.0)


def _label_logarithm(axes: "Axes", low: float, high: float) -> None:
    """Label a logarithmic axis at its decades, between them too where there are few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    few = high / low < 100.0
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _importance(study: Study) -> "Figure":
    from matplotlib.figure import Figure

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the evaluator is experimental
        shares = get_param_importances(study, evaluator=PedAnovaImportanceEvaluator())
    keys = list(reversed(shares))  # the most important at the top
    figure = Figure(figsize=(7.0, 1.2 + 0.3 * len(keys)), layout="constrained")
    axes = figure.subplots()
    axes.barh(keys, [100.0 * shares[key] for key in keys], color=_BLUE)
    axes.grid(axis="y", visible=False)
    axes.set(title="Importance of the keys", xlabel="share of what decides on success, %")
    return figure


def _percent(trial: FrozenTrial) -> float:
    return 100.0 * (trial.value or 0.0)


def _short(choice: Any) -> str:
    text = str(choice)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
