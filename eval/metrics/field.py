"""Metrics of the field: risk ratios with weights and their parts, and what a flight cost."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from envs.encounters import Encounter
from envs.relative import distance
from eval.flights.simulate import Flights
from eval.flights.trajectories import Trajectories
from eval.metrics.volumes import Relative, Volume, lost
from eval.stats.intervals import clopper_pearson, percentiles, resampled_sums

__all__ = ["Cost", "Ratio", "costs", "losses", "ratio", "relative"]

_FEW_EVENTS = 10
"""Events without the resolver below which a ratio says little."""

_DOMINANT = 0.1
"""Share of the weighted events beyond which a single encounter decides the ratio."""


@dataclass(frozen=True)
class Ratio:
    """P(event with the resolver) / P(event without it), weighted; nan where nothing can be said."""

    value: float
    low: float
    high: float
    unresolved: float
    """The part of encounters that have the event without the resolver and still have it with."""
    induced: float
    """The part of encounters that have it only with the resolver."""
    events: int
    """Encounters with the event, with the resolver."""
    events_without: int
    total: int
    effective: float
    """Kish's effective sample size, (sum w)^2 / sum w^2."""
    warnings: tuple[str, ...]
    """Sentences on why the sample cannot carry the claim."""


def ratio(
    event: np.ndarray,
    event_without: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    confidence: float = 0.95,
    resamples: int = 2_000,
    seed: int = 0,
) -> Ratio:
    """Return the risk ratio of the same encounters with and without a resolver: NMAC, loss of well clear, any event.

    The interval is a paired percentile bootstrap over encounters. With no event at all a resample cannot show one: the
    upper end is then the Clopper-Pearson end of the rate at the effective sample size, over the rate without.

    Args:
        event: with the resolver, bool ``[N]``.
        event_without: the same encounters without it, bool ``[N]``.
        weights: importance weights ``[N]``, not negative; None for equal ones.
        confidence: of the interval.
        resamples: of the bootstrap.
        seed: of the bootstrap.

    Raises:
        ValueError: shapes or types do not fit, a weight is negative or not finite, or all are 0.
    """
    event, event_without = np.asarray(event), np.asarray(event_without)
    if event.ndim != 1 or event.shape != event_without.shape or event.dtype != bool or event_without.dtype != bool:
        raise ValueError(
            f"expected two bool arrays [N] of one length, got {event.dtype} {list(event.shape)} and "
            f"{event_without.dtype} {list(event_without.shape)}"
        )
    weight = _weights(weights, len(event))
    counts = int(event.sum()), int(event_without.sum()), len(event)
    effective = float(weight.sum() ** 2 / np.sum(weight**2))
    without = float(weight @ event_without)
    if without == 0.0:
        warning = ("there is no event without the resolver: the ratio is undefined",)
        return Ratio(math.nan, math.nan, math.nan, math.nan, math.nan, *counts, effective, warning)
    unresolved = float(weight @ (event & event_without)) / without
    induced = float(weight @ (event & ~event_without)) / without
    value = float(weight @ event) / without
    if counts[0] == 0:
        low, high = (
            0.0,
            clopper_pearson(0, max(math.floor(effective), 1), confidence)[1] * float(weight.sum()) / without,
        )
    else:
        sums = resampled_sums(np.stack([weight * event, weight * event_without], axis=-1), resamples, seed)
        known = sums[:, 1] > 0.0
        low, high = percentiles(sums[known, 0] / sums[known, 1], confidence)
    made = Ratio(value, low, high, unresolved, induced, *counts, effective, ())
    return replace(made, warnings=_warnings(made, weight, event, event_without))


def _weights(weights: np.ndarray | None, count: int) -> np.ndarray:
    if weights is None:
        if count == 0:
            raise ValueError("there is no encounter; expected at least one")
        return np.ones(count)
    weight = np.asarray(weights, np.float64)
    if weight.shape != (count,):
        raise ValueError(f"weights have shape {weight.shape}, expected ({count},)")
    if not (np.isfinite(weight).all() and (weight >= 0.0).all() and weight.sum() > 0.0):
        raise ValueError("weights must be finite and not negative, at least one of them positive")
    return weight


def _warnings(made: Ratio, weight: np.ndarray, event: np.ndarray, event_without: np.ndarray) -> tuple[str, ...]:
    found = []
    if made.events_without < _FEW_EVENTS:
        found.append(f"only {made.events_without} events without the resolver, expected at least {_FEW_EVENTS}")
    if made.high - made.low > made.value:
        found.append("the interval is wide: half of it exceeds half the ratio; use more encounters")
    for which, name in ((event, "with"), (event_without, "without")):
        largest, total = float(np.max(weight * which)), float(weight @ which)
        if total > 0.0 and largest > _DOMINANT * total and which.sum() >= 1.0 / _DOMINANT:
            found.append(f"one encounter carries {largest / total:.0%} of the weight of the events {name} the resolver")
    return tuple(found)


def relative(flown: Trajectories) -> Relative:
    """Return the intruders relative to the ownship, ``[T + 1, N, K]``, co-altitude; nan after an encounter's end."""
    own, other = flown.own, flown.intruders
    vx, vy = own.speed * np.cos(own.heading), own.speed * np.sin(own.heading)
    return Relative(
        other.x - own.x[..., None],
        other.y - own.y[..., None],
        other.speed * np.cos(other.heading) - vx[..., None],
        other.speed * np.sin(other.heading) - vy[..., None],
    )


def losses(volume: Volume, flown: Trajectories, mask: np.ndarray) -> np.ndarray:
    """Return whether each flight loses a volume to any intruder, bool ``[N]``; co-altitude.

    A cylinder is judged on the closest approach between the steps too, a volume with tau at the steps.

    Args:
        volume: to be kept.
        flown: trajectories.
        mask: which intruders exist, bool ``[N, K]``.
    """
    if volume.tau == 0.0:
        # Not nanmin, which warns of a flight that never began.
        return np.fmin.reduce(flown.separation, axis=0) < volume.horizontal
    # After the end of a flight every comparison is with nan, and false.
    with np.errstate(invalid="ignore"):
        return np.any(lost(volume, relative(flown)) & mask, axis=(0, 2))


class Cost(NamedTuple):
    """What flights cost beside the straight way; fields ``[N]``."""

    path_excess: np.ndarray
    """(Length flown + distance left to the goal) / straight distance - 1, at least 0."""
    time_excess_s: np.ndarray
    """Time flown, and what is left at the last speed, less the straight way's at the first speed, s."""
    cross_track_m: np.ndarray
    """Largest distance from the straight line from start to goal, m."""


def costs(starts: Encounter, flights: Flights, flown: Trajectories) -> Cost:
    """Return what flights ``[N]`` cost."""
    own = starts.own
    dx, dy = starts.goal_x - own.x, starts.goal_y - own.y
    route = np.maximum(distance(dx, dy, np), 1.0)  # a start on the goal has none
    path = np.maximum((flights.path_length + flights.goal_distance) / route - 1.0, 0.0)
    aside = np.abs((flown.own.x - own.x) * dy - (flown.own.y - own.y) * dx) / route
    last = np.nanmax(np.where(np.isfinite(flown.own.x), np.arange(len(flown.own.x))[:, None], -1), axis=0)
    final = np.maximum(flown.own.speed[last, np.arange(len(last))], 1e-3)
    time = flights.duration + flights.goal_distance / final - route / np.maximum(own.speed, 1e-3)
    return Cost(path, time, np.nanmax(aside, axis=0))
