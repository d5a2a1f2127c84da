"""The paper's four training figures, each beside the success rate, for one run or for several seeds
of it.

``python -m rlcas_jax.figures RUN [RUN ...] --out DIR`` draws those of finished or running trainings
again.
"""

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from commands.command import ConfigError, Parser, run_cli
from rlcas_jax.metrics import read

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_SCORE = 75.0  # average episode reward that the paper reports at the end of its training
_BLUE, _GREEN, _ORANGE, _GREY = (
    "#0072b2",
    "#00795a",
    "#d55e00",
    "#767676",
)  # apart for every kind of colour vision
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
}
_STEPS = "environment steps, millions"
_POINTS = 400  # most points of a curve; more would be a band


_OF_EPISODES = ("score", "success")  # means over the episodes that ended in an update

FIGURES = {
    "episode_reward": ("score", "Average episode reward", "sparse return"),
    "loss": ("loss", "Training loss", "weighted sum of its parts, no unit"),
    "entropy": ("entropy", "Entropy of the policy", "nats"),
    "neg_log_probability": ("neg_log_prob", "Negative log-probability of the actions", "nats"),
}
"""Metric, title and unit of the figures by the name of their file."""


def training_figures(runs: Sequence[Path], directory: Path) -> list[Path]:
    """Draw the figures of a training as PNG and SVG and return the files: one a metric that its
    algorithm logs, and ``training`` with all.

    Args:
        runs: directories (or metrics files) of the seeds of one configuration; of several, thin
            lines and a thick mean.
        directory: of the files; made if it is not there.

    Raises:
        ConfigError: no run has a metric yet.
    """
    import matplotlib as mpl

    from commands.figures import save_figure

    logs = [log for log in map(read, runs) if "step" in log]
    if not logs:
        raise ConfigError(f"no metrics to draw in {', '.join(map(str, runs))}")
    reference = PAPER_SCORE if all(map(_flies_as_the_paper, runs)) else None
    directory.mkdir(parents=True, exist_ok=True)
    drawn = [name for name, figure in FIGURES.items() if any(figure[0] in log for log in logs)]
    sheets = {name: [[name, "success"]] for name in drawn}
    pairs = [[left, right] for left, right in zip_longest(drawn[::2], drawn[1::2], fillvalue=".")]
    sheets["training"] = [*pairs, ["success", "success"]]
    with mpl.rc_context(STYLE):
        return [
            file
            for name, layout in sheets.items()
            for file in save_figure(_figure(logs, layout, reference), directory / name)
        ]


def _flies_as_the_paper(run: Path) -> bool:
    """Return whether a run's score compares with the paper's: it flies the paper's aircraft alone,
    for the paper's scores. Of a run without a configuration that is not known.
    """
    from rlcas_jax.config import TrainConfig, configuration_of_run

    file = (run if run.is_dir() else run.parent) / "config.yaml"
    if not file.is_file():
        return False
    paper = TrainConfig()  # its defaults are the paper's task
    return all(
        phase.rules() == paper.rules()
        and phase.aircraft.aircraft() == paper.aircraft.aircraft()
        and phase.family.share == 0.0
        for phase in configuration_of_run(file).phase_configs()
    )


def _figure(
    logs: Sequence[dict[str, np.ndarray]], layout: Any, reference: float | None
) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.4 if len(layout) == 1 else 9.0), layout="constrained")
    panels: Any = figure.subplot_mosaic(layout)
    for name, axes in panels.items():
        if name == "success":
            title, unit = "Success rate", "%"
            _lines(axes, logs, "success", _GREEN, "stochastic policy, while training")
            _draw_evaluations(axes, [log for log in logs if "eval_success" in log])
            axes.set(ylim=(0.0, 102.0))
        else:
            metric, title, unit = FIGURES[name]
            _lines(axes, logs, metric, _BLUE, None)
            if metric == "score" and reference is not None:
                style: Any = {"color": _GREY, "linewidth": 1.0, "linestyle": (0, (4, 3))}
                axes.axhline(reference, label=f"paper: {reference:+.0f}", **style)
        if axes.get_legend_handles_labels()[
            0
        ]:  # before the first episode ends there is nothing to show
            axes.legend(loc="lower right")
        last = max(log["step"][-1] for log in logs)
        axes.set(title=title, xlabel=_STEPS, xlim=(0.0, 1.02e-6 * last), ylabel=unit)
    return figure


def _draw_evaluations(axes: "Axes", logs: Sequence[dict[str, np.ndarray]]) -> None:
    style: Any = {"color": _ORANGE, "linewidth": 0.8, "marker": "o", "markersize": 4.0}
    style |= {"alpha": 1.0 if len(logs) == 1 else 0.6, "label": "deterministic policy, evaluations"}
    for log in logs:
        evaluated = np.isfinite(log["eval_success"])
        percent = 100.0 * log["eval_success"][evaluated]
        if percent.size == 1 and len(logs) == 1:
            # A dot alone is easily overlooked: say its value.
            style["label"] = f"deterministic policy, one evaluation: {percent[0]:.1f} %"
        axes.plot(1e-6 * log["step"][evaluated], percent, **style)
        style["label"] = None


def _lines(
    axes: "Axes", logs: Sequence[dict[str, np.ndarray]], metric: str, color: str, label: str | None
) -> None:
    curves = []
    for log in logs:
        values = log.get(metric, np.full_like(log["step"], np.nan)) * (
            100.0 if metric == "success" else 1.0
        )
        finite = np.isfinite(values)
        if finite.any():
            weights = log["episodes"] if metric in _OF_EPISODES else np.ones_like(values)
            curves.append(stretches(log["step"][finite] * 1e-6, values[finite], weights[finite]))
    if len(curves) > 1:
        for curve in curves:
            axes.plot(*curve, color=color, linewidth=0.7, alpha=0.4)
        # Seeds that were stopped early do not bend the mean: it ends with the shortest.
        common = curves[0][0]
        common = common[
            (common >= max(c[0][0] for c in curves)) & (common <= min(c[0][-1] for c in curves))
        ]
        mean = np.mean([np.interp(common, *curve) for curve in curves], axis=0)
        axes.plot(
            common,
            mean,
            color=color,
            linewidth=1.8,
            label=label and f"{label}: mean of {len(curves)} seeds",
        )
    elif curves:
        # A run of one update is a point, which a line would not show.
        marker = "o" if len(curves[0][0]) == 1 else None
        axes.plot(*curves[0], color=color, linewidth=1.5, marker=marker, label=label)


def stretches(
    steps: np.ndarray, values: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve of at most 400 points: the ends of stretches of equal length and the weighted
    means over them.

    Steps (ascending), values and weights (positive) are ``[N]``.
    """
    length = -(-len(steps) // _POINTS)
    if length <= 1:
        return steps, values
    first = np.arange(0, len(steps), length)
    means = np.add.reduceat(weights * values, first) / np.add.reduceat(weights, first)
    return steps[np.minimum(first + length, len(steps)) - 1], means


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the figures that the command line asks for; raises a ConfigError where a run has no
    metrics.
    """
    parser = Parser(
        prog="python -m rlcas_jax.figures", description="Draw the figures of trainings again."
    )
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="folders of the seeds of one configuration",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="where the figures go, PNG and SVG"
    )
    options = parser.parse_args(arguments)
    for run in options.runs:
        if not run.exists():
            raise ConfigError(f"{run}: there is no such folder; expected that of a training")
    try:
        files = training_figures(options.runs, options.out)
    except OSError as problem:
        raise ConfigError(str(problem)) from None
    print("\n".join(map(str, files)))


if __name__ == "__main__":
    run_cli("rlcas_jax.figures:main")
