"""An extreme-value fit beside splitting: the smallest separations of plain sampling as a
generalised Pareto tail.

How far separations lie below a low threshold is distributed so (Pickands, Annals of Statistics 3
(1975) 119). A good fit stays as the threshold falls, and has its quantiles on the diagonal.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eval.plots.style import BLUE, ORANGE, VERMILION, tidy

_SHARES = (0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02)
_LEAST = 30  # separations of a fit
_QUANTILES = np.arange(0.025, 1.0, 0.05)


def fits(values: np.ndarray, level: float) -> list[dict[str, Any]]:
    """Return a fit for each share of ``values [N]`` that is enough for one, with the rate below
    ``level``, m.
    """
    from scipy.stats import genpareto

    fitted = []
    for share in _SHARES:
        threshold = float(np.quantile(values, share))
        below = threshold - values[values < threshold]
        if len(below) < _LEAST or not level < threshold < np.inf:
            continue
        shape, _, scale = map(float, genpareto.fit(below, floc=0.0))
        part = len(below) / len(values)
        fitted.append(
            {
                "name": f"{share:g}",
                "threshold_m": threshold,
                "below": len(below),
                "shape": shape,
                "scale_m": scale,
                "rate": part * float(genpareto.sf(threshold - level, shape, 0.0, scale)),
                "quantiles_m": np.quantile(below, _QUANTILES).tolist(),
                "fitted_quantiles_m": genpareto.ppf(_QUANTILES, shape, 0.0, scale).tolist(),
            }
        )
    return fitted


def tail_figure(estimate: Mapping[str, Any]) -> Figure:
    """Return the diagnostics of ``rare.json``'s content: rate and shape by threshold, and
    quantiles.
    """
    fitted, rate = estimate["tail"], estimate["rate"]
    figure = Figure((10.0, 3.8), layout="constrained")
    figure.suptitle("Extreme-value fit to the smallest separations, by its threshold", fontsize=11)
    rates, shapes, quantiles = figure.subplots(1, 3)
    place = [fit["threshold_m"] for fit in fitted]
    rates.plot(place, [fit["rate"] for fit in fitted], "o-", color=BLUE, label="fit")
    rates.axhspan(rate["low"], rate["high"], color=ORANGE, alpha=0.3, label="splitting")
    rates.set(xlabel="threshold, m", ylabel="losses an encounter")
    rates.set_title("must not depend on the threshold", fontsize=9)
    rates.legend(frameon=False)
    shapes.plot(place, [fit["shape"] for fit in fitted], "o-", color=BLUE)
    shapes.set(xlabel="threshold, m", ylabel="shape of the fit")
    shapes.set_title("must settle", fontsize=9)
    for fit in fitted:
        quantiles.plot(
            fit["fitted_quantiles_m"], fit["quantiles_m"], ".-", label=f"{fit['threshold_m']:.0f} m"
        )
    most = max((fit["quantiles_m"][-1] for fit in fitted), default=1.0)
    quantiles.plot([0.0, most], [0.0, most], color=VERMILION, linewidth=0.8)
    quantiles.set(xlabel="fitted, m below the threshold", ylabel="sampled, m below the threshold")
    quantiles.set_title("must follow the line", fontsize=9)
    quantiles.legend(title="threshold", frameon=False, fontsize=8)
    for axes in (rates, shapes, quantiles):
        tidy(axes, "both")
    return figure
