"""Statistics in JSON types; what cannot be said is None."""

import math
from dataclasses import asdict
from typing import Any, SupportsInt

import numpy as np

from eval.stats.intervals import Interval, rate

__all__ = ["ends", "number", "quantiles", "share"]


def number(value: float) -> float | None:
    """Return the value, None for what JSON has no word for."""
    return float(value) if math.isfinite(value) else None


def share(count: SupportsInt, total: SupportsInt, confidence: float) -> dict[str, Any]:
    """Return value, interval, count and total of a rate; arguments as of :func:`eval.stats.intervals.rate`."""
    found = asdict(rate(int(count), int(total), confidence))
    return found | {"value": number(found["value"])}


def ends(interval: Interval, least: float = -math.inf) -> dict[str, float | None]:
    """Return the ends of an interval, the lower one at least ``least``."""
    if math.isnan(interval.value):
        return {"low": None, "high": None}
    return {"low": max(interval.low, least), "high": interval.high}


def quantiles(values: np.ndarray, at: tuple[float, ...]) -> dict[str, float | None]:
    """Return quantiles of the finite ones of values ``[M]`` by their share, which is the key."""
    known = values[np.isfinite(values)]
    return {f"{q:g}": float(np.quantile(known, q)) if known.size else None for q in at}
