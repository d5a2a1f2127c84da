"""Alert levels: how soon the required separation would be lost, with hysteresis.

One scheme for all that can lose it (docs/explanation/assurance.md): an intruder on the present
course, the rest of the plan that the monitor watches, and each band. The level follows from the
time to loss alone (:class:`Alerting`); what is shown changes only where M of the last N levels ask
for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from agents.assurance.bands import Bands, recovery
from envs.aircraft import Aircraft
from envs.arrays import Array, Bool, Float, Int


class Level(IntEnum):
    """Of an alert; the codes are those of the message ``TrafficAlert``."""

    NONE = 0
    PREVENTIVE = 1  # the separation is lost within the look-ahead
    CORRECTIVE = 2  # a manoeuvre is due
    WARNING = 3  # it is due at once


class Region(IntEnum):
    """Of a band: free, closed by the level of its loss, or the way out where nothing is free."""

    FREE = 0
    PREVENTIVE = 1
    CORRECTIVE = 2
    WARNING = 3
    RECOVERY = 4


class Times(NamedTuple):
    """Times to loss of separation, one for each level, s."""

    preventive: float
    corrective: float
    warning: float


@dataclass(frozen=True)
class Alerting:
    """When levels are reached and left; built by :meth:`for_aircraft`."""

    reached: Times
    """A level is reached where the separation is lost within its time."""
    left: Times
    """The level that is shown is left where it is not lost within this time; none is shorter."""
    hold: float
    """For how long after it was raised a level does not fall, s."""
    forget: float
    """Time between two updates, s, beyond which the levels before count no more."""
    m: int = 2
    """So many of the last ``n`` levels must be as high for a level to be shown."""
    n: int = 4

    @classmethod
    def for_aircraft(cls, aircraft: Aircraft) -> "Alerting":
        """Return the usual times, which scale with the aircraft; docs/explanation/assurance.md has
        their sources.
        """
        step = aircraft.dt
        return cls(
            reached=Times(120.0 * step, 55.0 * step, 25.0 * step),
            left=Times(120.0 * step, 75.0 * step, 55.0 * step),
            hold=4.0 * step,
            forget=5.0 * step,
        )

    @property
    def look_ahead(self) -> float:
        """Within which a loss counts at all, s."""
        return self.reached.preventive


class Alerts(NamedTuple):
    """What is shown about intruders ``[N, K]``, and why."""

    time: Array  # of the last update, s, [N]; -inf before the first
    level: Array  # shown, code of Level, int8, [N, K]
    raised: Array  # when it was raised last, s, [N, K]; -inf: never
    recent: Array  # levels of the last n updates, the latest last, int8, [N, K, n]; -1: none


def no_alerts(count: int, intruders: int, alerting: Alerting) -> Alerts:
    """Return that nothing has been looked at yet, ``[count]`` with room for so many intruders."""
    pairs = count, intruders
    return Alerts(
        np.full(count, -np.inf),
        np.zeros(pairs, dtype=np.int8),
        np.full(pairs, -np.inf),
        np.full((*pairs, alerting.n), -1, dtype=np.int8),
    )


def rearrange(alerts: Alerts, places: Sequence[int], alerting: Alerting) -> Alerts:
    """Return alerts with the intruders in other places: for each the place that it had; -1: it is
    new.
    """
    fresh = no_alerts(alerts.time.size, len(places), alerting)
    into = [place for place, old in enumerate(places) if old >= 0]
    old_places = [place for place in places if place >= 0]
    for field, before in zip(fresh[1:], alerts[1:], strict=True):
        field[:, into] = before[:, old_places]
    return fresh._replace(time=alerts.time)


def levels(loss: Float[Array, "..."], times: Times) -> Int[Array, "..."]:
    """Return the level of times to loss, s, of any shape; inf: none, nan: the highest."""
    return sum((~(np.asarray(loss) > limit)).astype(np.int8) for limit in times)


def update(
    alerts: Alerts,
    time: Float[Array, " N"],
    loss: Float[Array, "N K"],
    mask: Bool[Array, "N K"],
    alerting: Alerting,
) -> Alerts:
    """Return the alerts after one more look.

    A new intruder, and all of them after a gap or a step back in time, show their level at once.

    Args:
        time: now, s.
        loss: when the separation from each intruder would be lost, s from now.
        mask: which intruders exist, bool; one that does not is forgotten.
    """
    current = np.asarray(time, dtype=float)[:, None]
    since = current - alerts.time[:, None]
    afresh = (alerts.recent[..., -1] < 0) | ~((since > 0.0) & (since <= alerting.forget))
    shown = np.where(afresh, np.int8(Level.NONE), alerts.level)
    reached, left = levels(loss, alerting.reached), levels(loss, alerting.left)
    raw = np.maximum(reached, np.where(left >= shown, shown, 0)).astype(np.int8)

    start = np.where(np.arange(alerting.n) < alerting.m, raw[..., None], -1)
    recent = np.where(afresh[..., None], start, alerts.recent)
    recent = np.concatenate([recent[..., 1:], raw[..., None]], axis=-1).astype(np.int8)
    # The m-th highest of the last n.
    confirmed = np.maximum(np.sort(recent, axis=-1)[..., alerting.n - alerting.m], 0)
    raised = np.where(afresh, -np.inf, alerts.raised)
    held = (confirmed < shown) & (current - raised < alerting.hold)
    level = np.where(held, shown, confirmed)
    raised = np.where(level > shown, current, raised)
    return Alerts(
        current[:, 0],
        np.where(mask, level, 0).astype(np.int8),
        np.where(mask, raised, -np.inf),
        np.where(mask[..., None], recent, -1).astype(np.int8),
    )


def shown_losses(bands: Bands) -> Float[Array, "N B"]:
    """Return when what a display draws of each band is lost, s from now; inf: never.

    It draws a band as far as half-way to its neighbours, so that a band beside a conflict is no
    free one. Only where that would leave none, the manoeuvres to the targets alone count.
    """
    losses = np.where(bands.closed, bands.loss, bands.nearby)
    any_free = np.isinf(losses).any(axis=1, keepdims=True)
    return np.where(any_free, losses, bands.loss)


def regions(bands: Bands, alerting: Alerting, separation: float) -> Int[Array, "N B"]:
    """Return the regions of bands, codes of :class:`Region`, int8.

    Where no band of a row is free, the one that :func:`agents.assurance.bands.recovery` picks is
    its way out.
    """
    losses = shown_losses(bands)
    codes = levels(losses, alerting.reached).astype(np.int8)
    codes = np.where(np.isfinite(losses), np.maximum(codes, np.int8(Region.PREVENTIVE)), codes)
    way_out = recovery(bands, separation).index
    rows = np.flatnonzero(way_out >= 0)
    codes[rows, way_out[rows]] = np.int8(Region.RECOVERY)
    return codes
