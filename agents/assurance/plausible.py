"""Whether reports of an aircraft can be true together: how its velocity changes, and its places
against velocities.

Where they cannot one of them is wrong, and nothing that is predicted from them holds.
"""

from typing import NamedTuple

import numpy as np

from agents.assurance.thresholds import Thresholds
from agents.planner.request.options import Narrowed
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import Limits, VehicleState, velocity
from envs.trees import map_leaves

SIGMAS = 5.5
"""Standard deviations of the declared noise that excuse a report: of thousands of noisy reports
none is refused.
"""

_GAP = 5.0  # time steps between two reports, beyond which they say nothing of each other
# time steps over which places are compared with velocities, and for which reports then must agree
_WINDOW = 20.0
_PLACE, _SHARE = (
    0.06,
    0.05,
)  # differences that are always allowed: in separations, and as a share of the way flown
_SPEED = 0.02  # change of velocity that is always allowed, in the ownship's greatest speed


class Tolerance(NamedTuple):
    """By how much places may differ from what velocities make of them."""

    least: Array  # m
    share: float  # of the way flown
    sigmas: float  # of the declared noise


class Drift(NamedTuple):
    """Where the comparison of each intruder began, and until when it is not believed; fields ``[N,
    K]``.
    """

    began: Array  # s; -inf before the first report
    x: Array  # place then, m
    y: Array
    position_std: Array  # of that report, m
    flown_x: Array  # integral of the reported velocities since, m
    flown_y: Array
    rate_until: Array  # s; -inf where its velocity has never changed faster than it can
    place_until: Array  # the same for places that contradict velocities


def unknown(shape: tuple[int, ...]) -> Drift:
    """Return what is known before the first report."""
    never, zeros = np.full(shape, -np.inf), np.zeros(shape)
    return Drift(never, zeros, zeros, zeros, zeros, zeros, never, never)


def difference(
    moved: tuple[Array, Array], flown: tuple[Array, Array], noise: Array, allows: Tolerance
) -> tuple[Array, Array]:
    """Return how far displacements are from the integrals of the velocities, and what is allowed,
    m, ``[...]``.

    The noise is one sigma of the difference, m.
    """
    way = np.maximum(np.hypot(*moved), np.hypot(*flown))
    off = np.hypot(moved[0] - flown[0], moved[1] - flown[1])
    return off, allows.least + allows.share * way + allows.sigmas * noise


def greatest_change(
    speed: Array, seconds: Array, noise: Array, turn_rate_max: float, limits: Limits
) -> Array:
    """Return by how much an aircraft's velocity may change, m/s; what changes more is impossible.

    Args:
        speed: the greater one, before or after, m/s.
        noise: one sigma per axis of the change, m/s.
        turn_rate_max: largest turn rate that is accepted, rad/s.
        limits: of the ownship: others accelerate alike.
    """
    fastest = turn_rate_max * speed
    fastest = fastest + max(limits.acceleration_max, -limits.acceleration_min)
    return _SPEED * limits.speed_max + fastest * seconds + SIGMAS * noise


def follow(
    drift: Drift,
    before: tuple[VehicleState[Air], Array, Array],
    report: tuple[VehicleState[Air], Array, Array],
    time: tuple[Array, Array],
    good: Array,
    thresholds: Thresholds[Narrowed],
) -> Drift:
    """Return the comparison with one more report of each intruder, ``[N, K]``.

    Args:
        before: the last good reports, with one sigma of their positions, m, and velocities, m/s;
            ``report`` likewise.
        time: of the reports before and of the new ones, s; -inf where there is none before.
        good: which of the new ones are finite, in range and in order, bool.
    """
    old, _, old_std = before
    aircraft = thresholds.options.aircraft
    dt, limits = aircraft.dt, aircraft.limits
    known = good & (time[1] - time[0] <= _GAP * dt)
    elapsed = np.where(known, time[1] - time[0], 0.0)
    new, position_std, velocity_std = map_leaves(lambda field: np.where(good, field, 0.0), report)
    (vx, vy), (to_vx, to_vy) = velocity(old, np), velocity(new, np)

    noise = np.hypot(old_std, velocity_std)
    speed = np.maximum(old.speed, new.speed)
    most = greatest_change(speed, elapsed, noise, thresholds.turn_rate_max, limits)
    sudden = known & ~(np.hypot(to_vx - vx, to_vy - vy) <= most)

    flown_x = drift.flown_x + 0.5 * (vx + to_vx) * elapsed
    flown_y = drift.flown_y + 0.5 * (vy + to_vy) * elapsed
    length = np.where(known, time[1] - drift.began, 0.0)
    noise = np.hypot(np.hypot(drift.position_std, position_std), velocity_std * length)
    allows = Tolerance(_PLACE * aircraft.separation, _SHARE, SIGMAS)
    off, allowed = difference((new.x - drift.x, new.y - drift.y), (flown_x, flown_y), noise, allows)
    apart = known & ~(off <= allowed)

    anew = good & (~known | apart | (length >= _WINDOW * dt))
    began, until = time[1], time[1] + _WINDOW * dt
    zero = np.zeros(elapsed.shape)
    start = Drift(began, new.x, new.y, position_std, zero, zero, until, until)
    going_on = drift._replace(
        flown_x=np.where(known, flown_x, drift.flown_x),
        flown_y=np.where(known, flown_y, drift.flown_y),
    )
    window = Drift(*(np.where(anew, a, b) for a, b in zip(start, going_on, strict=True)))
    return window._replace(
        rate_until=np.where(sudden, until, drift.rate_until),
        place_until=np.where(apart, until, drift.place_until),
    )
