"""Whether reported altitudes and vertical speeds can both be true, and which climb is believed.

Altitudes are compared with the integral of the reported vertical speeds, so that climbs that begin
and end play no part. A Kalman filter of two states, as in :mod:`envs.tracking.agreement`, finds
what grows between the two, such as of a vertical speed in other units, with the wrong sign, or of
0. An aircraft that reports no vertical speed is not followed: altitudes in steps of 100 ft show a
climb within 6 m/s (three sigmas), and one that begins only after seconds.
"""

from typing import NamedTuple

from envs.arrays import Array, ArrayModule

_STEP = 8.8  # m, one sigma of altitudes in steps of 100 ft
_PRIOR = 10.0  # m/s, one sigma: 2000 ft/min
_NOISE = 0.01  # m^2/s^3, white: what is lacked changes by 0.8 m/s within a minute
_ACCELERATION = 2.5  # m/s^2, a quarter of g: what may lie between two reports
_FEW = 3.0  # reports, of which nothing is said
# Chi-square of 1 degree of freedom: what is lacked counts where chance makes it in one of 600 000
# reports, and no longer where chance makes it in one of 20; it is another from now on where chance
# makes one in 1000.
_BEGINS, _ENDS, _ANEW = 23.0, 4.0, 11.0
_LEAST = 0.5  # m/s, 100 ft/min: what vertical speeds are rounded by
_SIGMAS = 3.0  # within which a climb that is taken from altitudes is


class Heights(NamedTuple):
    """What altitudes have shown so far; fields ``[...]``."""

    count: Array  # of reports
    altitude: Array  # of the newest, m
    climb: Array  # that it says, m/s
    offset: Array  # of the newest altitude from what the vertical speeds make, m
    lack: Array  # that the vertical speeds lack, m/s
    oo: Array  # variance of the offset, m^2
    ol: Array
    ll: Array  # m^2/s^2
    wrong: Array  # whether what they lack is significant, bool


class Climb(NamedTuple):
    """What is believed of a vertical speed; fields ``[...]``."""

    climb: Array  # m/s, positive upwards
    error: Array  # by which it may be off either way, m/s; 0: it is believed as it is reported


def begin(altitude: Array, climb: Array, error: Array, xp: ArrayModule) -> Heights:
    """Return what one report shows, ``[...]``.

    Args:
        altitude: m.
        climb: vertical speed, m/s.
        error: by which the altitude may be off either way, m.
        xp: the array module.
    """
    zero = 0.0 * (altitude + climb + error)
    oo, ll = zero + _variance(error, xp), zero + _PRIOR**2
    return Heights(zero + 1.0, altitude + zero, climb + zero, zero, zero, oo, zero, ll, zero > 1.0)


def _variance(error: Array, xp: ArrayModule) -> Array:
    """Return the variance of an altitude that is off by an error either way, m^2."""
    return xp.maximum(error * error * (1.0 / 3.0), _STEP * _STEP)


def extend(
    heights: Heights, altitude: Array, climb: Array, error: Array, dt: Array, xp: ArrayModule
) -> Heights:
    """Return what altitudes show with one more report, ``dt`` s after the one before, ``[...]``;
    the others as of :func:`begin`.
    """
    old, noise = heights, _variance(error, xp)
    bow = _ACCELERATION * dt * dt * (1.0 / 12.0)
    oo = old.oo + dt * (2.0 * old.ol + dt * old.ll) + _NOISE * dt**3 * (1.0 / 3.0) + bow * bow
    ol, ll = old.ol + dt * old.ll + _NOISE * dt * dt * 0.5, old.ll + _NOISE * dt
    flown = 0.5 * dt * (old.climb + climb) + old.lack * dt
    off = altitude - old.altitude - flown - old.offset
    restarts = xp.logical_and(off * off > _ANEW * (oo + noise), old.count > _FEW)
    oo = xp.where(restarts, noise + (_PRIOR * dt) ** 2, oo)
    ol, ll = xp.where(restarts, _PRIOR**2 * dt, ol), xp.where(restarts, _PRIOR**2, ll)
    near, fast = oo / (oo + noise), ol / (oo + noise)
    lack, ll = old.lack + fast * off, ll - fast * ol
    count = old.count + 1.0
    limit = xp.maximum(xp.where(old.wrong, _ENDS, _BEGINS) * ll, _LEAST**2)
    return Heights(
        count,
        altitude + 0.0 * near,
        climb + 0.0 * near,
        (near - 1.0) * off,
        lack,
        oo - near * oo,
        ol - near * ol,
        ll,
        xp.logical_and(count > _FEW, lack * lack > limit),
    )


def climb_of(heights: Heights, xp: ArrayModule) -> Climb:
    """Return what is believed of the vertical speeds, ``[...]``: what is reported, or where the
    altitudes contradict it, what they show.
    """
    return Climb(
        heights.climb + xp.where(heights.wrong, heights.lack, 0.0),
        xp.where(heights.wrong, _SIGMAS * xp.sqrt(heights.ll), 0.0),
    )
