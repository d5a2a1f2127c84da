"""A resolver in the units of those who approve: near mid-air collisions (NMAC) and losses of well
clear (LoWC) with and without it, alerts, and what it costs.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eval.metrics.alerting import ALERTING
from eval.metrics.volumes import VOLUMES
from eval.metrics.weighted import ratio, weighted_mean, weighted_rate
from eval.stats.intervals import number

_ASIDE = 0.1  # of the well-clear volume, beyond which a deviation is a manoeuvre


class Sample(NamedTuple):
    """How the figures of a sample are made."""

    well_clear: str  # name of the volume, of eval.metrics.volumes
    weights: np.ndarray | None  # of encounters, [N]; None: equal ones
    confidence: float
    resamples: int
    seed: int
    strata: np.ndarray | None = None  # numbers from 0, [N], of encounters drawn by strata

    def rate(
        self,
        counted: np.ndarray,
        possible: np.ndarray | None = None,
        of: np.ndarray | None = None,
    ) -> dict[str, Any]:
        """Return the share of encounters, bool ``[N]``, by weight, with its interval.

        Args:
            counted: which are counted.
            possible: which could be, by definition, bool ``[N]``; None: all.
            of: those of which it is a share, bool ``[N]``; None: all.
        """
        of = np.ones(counted.size, dtype=bool) if of is None else of
        strata = self.strata
        if strata is not None and possible is not None:
            strata = np.where(possible, strata, -1)
        how = (self.weights, self.confidence, self.resamples, self.seed, strata)
        return weighted_rate(counted, of, *how)

    def mean(self, values: np.ndarray) -> dict[str, float | None]:
        """Return the mean of the finite ones of values ``[N]``, by weight, with its interval."""
        return weighted_mean(values, self.weights, self.confidence, self.resamples, self.seed)


def standards(
    flown: Mapping[str, np.ndarray], bare: Mapping[str, np.ndarray], sample: Sample
) -> dict[str, Any]:
    """Return the figures of a resolver in JSON types, from its columns and those of the flights
    without one, ``[N]`` each, of the same encounters.

    Of NMAC and LoWC: the probability, ``rate``, of which a part stays ``unresolved`` and the rest
    is ``induced``; its ``ratio`` to the probability without a resolver, that one's ``rate``; and of
    the events without a resolver the share that ``stays``.
    A *nuisance* is a first alert that no loss of well clear follows within the look-ahead in the
    flight without a resolver; the time to loss at the first alert counts to that loss. A *needless*
    manoeuvre leaves the route, sideways or in altitude, by more than a tenth of the volume in an
    encounter that stays well clear without it.
    """
    volume, name = VOLUMES[sample.well_clear], f"lost_{sample.well_clear}"
    figures: dict[str, Any] = {}
    if flown is bare:  # nothing is missing of what makes the strata
        sample = sample._replace(strata=None)
    for key, column in (("nmac", "lost_nmac"), ("lowc", name)):
        ours, without = flown[column], bare[column]
        how = {"confidence": sample.confidence, "resamples": sample.resamples, "seed": sample.seed}
        how |= {"strata": sample.strata}
        estimate = ratio(ours, without, sample.weights, **how)
        if flown is bare:  # without a resolver, by definition
            estimate = replace(estimate, low=estimate.value, high=estimate.value)
        figures |= {
            f"{key}_rate": sample.rate(ours),
            f"{key}_ratio": {
                end: number(getattr(estimate, end)) for end in ("value", "low", "high")
            },
            f"{key}_stays": sample.rate(ours & without, of=without),
            f"{key}_unresolved": sample.rate(ours & without, without),
            f"{key}_induced": sample.rate(ours & ~without, ~without),
        }
        if flown is bare:  # induces nothing, by definition
            figures[f"{key}_induced"] |= {"low": 0.0, "high": 0.0}
    alert, loss = flown["alert_s"], bare["well_clear_loss_s"]
    alerted, due = np.isfinite(alert), loss - np.where(np.isfinite(alert), alert, 0.0)
    aside = flown["cross_track_m"] > _ASIDE * volume.horizontal
    aside |= flown["altitude_deviation_m"] > _ASIDE * volume.vertical
    return figures | {
        "alert_rate": sample.rate(alerted),
        "nuisance_rate": sample.rate(alerted & ~(due <= ALERTING.reached.corrective)),
        "time_to_loss_s": sample.mean(np.where(alerted & (due >= 0.0), due, np.inf)),
        "needless_rate": sample.rate(aside & ~bare[name], ~bare[name]),
        "reversals": sample.mean(flown["heading_reversals"].astype(float)),
        "path_excess": sample.mean(flown["path_excess"]),
        "cross_track_m": sample.mean(flown["cross_track_m"]),
        "altitude_deviation_m": sample.mean(flown["altitude_deviation_m"]),
    }
