"""Whether the velocities of a track make the way between its positions, over the whole of it.

A single row may be wrong in many ways, and the checks of rows allow for that. Here a whole track is
judged: knots written as metres a second, a heading as the track. Positions and the integral of the
velocities are compared over parts of :data:`_PART` seconds, in which the errors of positions do not
matter; what three quarters of the parts agree on is no error of single rows, and no manoeuvre.
"""

import math
from typing import NamedTuple

import numpy as np

from envs.traffic.track_units import FOOT, KNOT

_PART = 10.0  # s, at least
_FEWEST = 4
"""Parts, without which nothing is said. Of 576 flights of real ADS-B with so many none is refused
but one, whose positions stay while it moves."""
_SHORT = 30.0  # m; a shorter part tells more of errors than of the velocities
_FACTOR = 1.3
"""Between the two ways. Those of DAIDALUS's files differ by up to 1.09, and circling aircraft with
a fix every 29 s stay within it; units of speed are apart by 1.7 at least, but for km/h and ft/s."""
_ANGLE = math.radians(15.0)  # likewise
_STEADY = 1.1  # between the quartiles of a factor that is the same throughout
_QUARTERS = (0.25, 0.5, 0.75)
UNITS = {"m/s": 1.0, "kt": KNOT, "km/h": 1.0 / 3.6, "ft/s": FOOT}
"""Of speed, that files are written in, in m/s."""
_NEAR = 1.06  # factor between a unit and what is taken for it
_LONGEST_TURN = 0.5 * math.pi  # rad between two rows, beyond which the way is not known


class Mismatch(NamedTuple):
    """By how much velocities differ from the way between positions."""

    factor: float  # length of the way that they make, over the one flown
    angle: float  # to the right of the one flown, rad
    steady: bool  # whether factor and angle are the same throughout, as those of a wrong unit are

    @property
    def turned(self) -> bool:
        """Whether it is the direction that differs."""
        return 1.0 / _FACTOR <= self.factor <= _FACTOR


def mismatch(time: np.ndarray, ways: np.ndarray, velocities: np.ndarray) -> Mismatch | None:
    """Return by how much the velocities of a track differ from its positions throughout; None: they
    do not, or it is too short to tell.

    Args:
        time: of the rows, s, ``[T]``.
        ways: from each row to the next, east and north, m, complex ``[T - 1]``.
        velocities: east and north, m/s, complex ``[T]``.
    """
    flown, integrated = _parts(time, ways, velocities)
    if len(flown) < _FEWEST:
        return None
    factors = np.quantile(np.abs(integrated) / np.maximum(np.abs(flown), 1e-3), _QUARTERS)
    angles = np.quantile(np.angle(flown * np.conj(integrated)), _QUARTERS)
    longer, shorter = factors[0] > _FACTOR, factors[2] < 1.0 / _FACTOR
    right, left = angles[0] > _ANGLE, angles[2] < -_ANGLE
    if not (longer or shorter or right or left):
        return None
    steady = factors[2] <= _STEADY * factors[0] and angles[2] - angles[0] <= _ANGLE
    return Mismatch(float(factors[1]), float(angles[1]), bool(steady))


def _parts(
    time: np.ndarray, ways: np.ndarray, velocities: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the ways flown and the ways that velocities make in the parts of a track, m, complex
    ``[P]``.
    """
    turn = np.abs(np.angle(velocities[1:] * np.conj(velocities[:-1])))
    half = 0.5 * np.clip(turn, 1e-6, _LONGEST_TURN)
    # The chord of an arc is longer than the mean of the velocities at its ends.
    steps = 0.5 * np.diff(time) * (velocities[1:] + velocities[:-1]) * np.tan(half) / half
    ends = [0]
    for row, moment in enumerate(time):
        if moment - time[ends[-1]] >= _PART:
            ends.append(row)
    flown, integrated = np.diff(_sums(ways)[ends]), np.diff(_sums(steps)[ends])
    long = np.maximum(np.abs(flown), np.abs(integrated)) >= _SHORT
    return flown[long], integrated[long]


def _sums(steps: np.ndarray) -> np.ndarray:
    """Return what steps ``[T - 1]`` add up to from 0 on, ``[T]``."""
    return np.concatenate([[0.0], np.cumsum(steps)])


def describe(off: Mismatch, name: str, unit: float) -> str:
    """Return a sentence on velocities of an aircraft that are given in a unit, m/s."""
    if off.turned:
        side = "right" if off.angle > 0.0 else "left"
        return (
            f"velocities of {name!r} point {abs(math.degrees(off.angle)):.0f} deg to the {side} of "
            "the way between its positions: are they along its heading?"
        )
    likely = _likely_unit(unit / max(off.factor, 1e-9))
    question = "expected 1" if likely is None else f"are they in {likely}?"
    return (
        f"velocities of {name!r} make {off.factor:.2f} times the way between its positions: "
        f"{question}"
    )


def _likely_unit(value: float) -> str | None:
    """Return the unit of a value, m/s, or None."""
    distances = {unit: abs(math.log(value / factor)) for unit, factor in UNITS.items()}
    unit = min(distances, key=distances.__getitem__)
    return unit if distances[unit] <= math.log(_NEAR) else None


def of_positions(time: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Return velocities that the positions show, m/s, complex ``[T]``: between the rows half a part
    before and after, the next ones at least; arguments as of :func:`mismatch`.
    """
    rows, places = np.arange(len(time)), _sums(ways)
    before = np.searchsorted(time, time - 0.5 * _PART, side="right") - 1
    before = np.maximum(np.minimum(before, rows - 1), 0)
    after = np.searchsorted(time, time + 0.5 * _PART, side="left")
    after = np.minimum(np.maximum(after, rows + 1), len(rows) - 1)
    return (places[after] - places[before]) / (time[after] - time[before])
