"""Altitudes of encounters in space: the ownship's at the start, and the intruders' over time.

Encounters without them are in the plane: everybody is at one level all the time.
"""

from typing import NamedTuple

import numpy as np

from envs.arrays import Array, ArrayModule

REFERENCE = "encounter"
"""Name of the level that all altitudes of an encounter are measured from."""

LEVEL = 914.4
"""Altitude of the ownship where nothing else says one, m: 3000 ft."""


class Altitudes(NamedTuple):
    """Altitudes above :data:`REFERENCE`, m, numpy; of encounters ``[...]`` with K intruders."""

    own: Array  # of the ownship at the start, where it flies level, [...]
    intruders: Array
    """Of the intruders, ``[..., K, T + 1]``, T >= 1: rows are a time step apart. The altitude
    changes evenly between them, and after the last one as before it."""
    too_high: Array | None = None
    """By how much their altimeters read higher than the ownship's, all the time, m, ``[..., K]``;
    None: all read alike."""
    stated_error: Array | None = None
    """By how much reports of their altitudes say that these may be off either way, m,
    ``[..., K]``; None: nothing."""


def as_reported(altitudes: Altitudes) -> Altitudes:
    """Return altitudes of which the intruders' are what their altimeters read."""
    if altitudes.too_high is None:
        return altitudes
    read = altitudes.intruders + altitudes.too_high[..., None]
    return altitudes._replace(intruders=read, too_high=None)


def steady(altitude: Array, climb: Array, dt: float, xp: ArrayModule = np) -> Array:
    """Return altitudes ``[..., K, 2]`` of intruders that climb evenly from altitudes, m, with
    vertical speeds, m/s, ``[..., K]``; time steps of dt, s.
    """
    return xp.stack([altitude, altitude + climb * dt], axis=-1)


def at_step(rows: Array, step: Array) -> Array:
    """Return altitudes of intruders, m, ``[..., K]``, from their rows ``[..., K, T + 1]`` so many
    time steps after the start, whole or not, which broadcast to ``[..., K]``.
    """
    first_row = _row(rows, np.floor(step))
    altitude, next_altitude = (_take(rows, row) for row in (first_row, first_row + 1))
    return altitude + (next_altitude - altitude) * (np.asarray(step) - first_row)


def climb_at(rows: Array, step: Array, dt: float) -> Array:
    """Return vertical speeds of intruders as of reports after some time steps, ``[..., K]``, m/s:
    those since the step before, at the start those until the next one; time steps of dt, s.
    """
    before = _row(rows, np.ceil(step) - 1.0)
    return (_take(rows, before + 1) - _take(rows, before)) / dt


def _row(rows: Array, number: Array) -> Array:
    """Return numbers of rows that have one after them, int ``[..., K]``."""
    last = rows.shape[-1] - 2
    return np.broadcast_to(np.clip(number, 0, last).astype(int), rows.shape[:-1])


def _take(rows: Array, number: Array) -> Array:
    """Return the rows of some numbers, ``[..., K]``."""
    return np.take_along_axis(rows, number[..., None], axis=-1)[..., 0]
