"""Statistics in JSON types, where what cannot be said is None, and in words."""

import math
from collections.abc import Mapping
from typing import Any, SupportsInt

import numpy as np

from eval.stats.intervals import Interval, clopper_pearson

__all__ = ["ends", "interval", "number", "percent", "quantiles", "share"]


def number(value: float) -> float | None:
    """Return the value, None for what JSON has no word for."""
    return float(value) if math.isfinite(value) else None


def share(count: SupportsInt, total: SupportsInt, confidence: float = 0.95) -> dict[str, Any]:
    """Return value, Clopper-Pearson interval, count and total of a rate; the value of nothing is None."""
    count, total = int(count), int(total)
    low, high = clopper_pearson(count, total, confidence)
    return {"value": count / total if total else None, "low": low, "high": high, "count": count, "total": total}


def interval(found: Interval) -> dict[str, float | None]:
    """Return value and ends of an interval."""
    return {key: number(value) for key, value in found._asdict().items()}


def ends(found: Interval, least: float = -math.inf) -> dict[str, float | None]:
    """Return the ends of an interval, the lower one at least ``least``."""
    if math.isnan(found.value):
        return {"low": None, "high": None}
    return {"low": max(found.low, least), "high": found.high}


def quantiles(values: np.ndarray, at: tuple[float, ...]) -> dict[str, float | None]:
    """Return quantiles of the finite ones of values ``[M]`` by their share, which is the key."""
    known = values[np.isfinite(values)]
    return {f"{q:g}": float(np.quantile(known, q)) if known.size else None for q in at}


def percent(rate: Mapping[str, Any] | None, form: str = "{} % [{}, {}]", unknown: str = "-") -> str:
    """Return value and ends of a :func:`share` in percent, in words."""
    if rate is None or rate["value"] is None:
        return unknown
    return form.format(*(f"{100.0 * rate[key]:.2f}" for key in ("value", "low", "high")))
