"""Tracks of intruders from noisy reports: fixed gains on position and velocity, begun anew when a
report contradicts.

An alpha-beta tracker (Brookner, Tracking and Kalman Filtering Made Easy, 1998) whose velocity is
corrected by the reported one, as ADS-B gives it: the estimate flies straight on between two
reports, and a share of what a report differs from it is taken over, all of it at first and then as
many parts as there were reports, down to the gains. An intruder that turns leaves the straight
line; once that shows beyond the noise, in one report or in the mean of several, the track begins
anew with the report. Without noise every report does, so that nothing is lost.
"""

from typing import Generic, NamedTuple

import numpy as np

from envs.angles import atan2
from envs.arrays import Array
from envs.frames import F
from envs.kinematics import VehicleState, velocity
from envs.trees import map_leaves

_POSITION_GAIN, _VELOCITY_GAIN = 0.3, 0.15
_DRIFT_GAIN = 0.3  # of the running mean of the velocity's deviations
# Sigmas of a report beyond which a deviation, or their running mean, is no noise; wrongly for one
# in a thousand.
_JUMP_POSITION, _JUMP_VELOCITY, _DRIFT = 4.8, 4.2, 1.9


class Tracks(NamedTuple, Generic[F]):
    """Estimates of intruders; fields ``[...]``."""

    state: VehicleState[F]
    count: Array  # reports since the track began
    drift_x: Array  # running mean of the velocity's deviations, m/s
    drift_y: Array
    position_variance: Array  # of the estimates, per axis, m^2, for aircraft on straight courses
    velocity_variance: Array  # m^2/s^2
    covariance: Array  # of the two, m^2/s

    @property
    def errors(self) -> dict[str, Array]:
        """Standard deviations of the estimates, per axis, as :func:`agents.assurance.inputs.inputs`
        takes them.
        """
        return {
            "position_std": np.sqrt(self.position_variance),
            "velocity_std": np.sqrt(self.velocity_variance),
        }


def begin(report: VehicleState[F], position_std: Array, velocity_std: Array) -> Tracks[F]:
    """Return tracks that know one report, ``[...]``; arguments as :func:`follow` has them."""
    zero = np.zeros(np.shape(report.x))
    return Tracks(
        report, zero + 1.0, zero, zero, zero + position_std**2, zero + velocity_std**2, zero
    )


def follow(
    tracks: Tracks[F] | None,
    report: VehicleState[F],
    position_std: Array,
    velocity_std: Array,
    dt: float,
) -> Tracks[F]:
    """Return the tracks (None: there are none) with reports ``dt`` seconds later, ``[...]``.

    The standard deviations are those of the reports, per axis, m and m/s.
    """
    if tracks is None:
        return begin(report, position_std, velocity_std)
    vx, vy = velocity(tracks.state, np)
    seen_vx, seen_vy = velocity(report, np)
    x, y = tracks.state.x + vx * dt, tracks.state.y + vy * dt
    off_x, off_y, off_vx, off_vy = report.x - x, report.y - y, seen_vx - vx, seen_vy - vy
    drift_x = tracks.drift_x + _DRIFT_GAIN * (off_vx - tracks.drift_x)
    drift_y = tracks.drift_y + _DRIFT_GAIN * (off_vy - tracks.drift_y)
    anew = np.hypot(off_x, off_y) > _JUMP_POSITION * position_std
    anew |= np.hypot(off_vx, off_vy) > _JUMP_VELOCITY * velocity_std
    anew |= np.hypot(drift_x, drift_y) > _DRIFT * velocity_std
    count = tracks.count + 1.0
    near, slow = np.maximum(_POSITION_GAIN, 1.0 / count), np.maximum(_VELOCITY_GAIN, 1.0 / count)
    vx, vy = vx + slow * off_vx, vy + slow * off_vy
    followed: VehicleState[F] = VehicleState(
        x + near * off_x, y + near * off_y, atan2(vy, vx, np), np.hypot(vx, vy)
    )
    # The errors of an estimate with any gains: what is kept of those predicted, and what is taken
    # over of the report's.
    far, fast = 1.0 - near, 1.0 - slow
    moved = tracks.position_variance + dt * (
        2.0 * tracks.covariance + dt * tracks.velocity_variance
    )
    place = far * far * moved + (near * position_std) ** 2
    motion = fast * fast * tracks.velocity_variance + (slow * velocity_std) ** 2
    both = far * fast * (tracks.covariance + dt * tracks.velocity_variance)
    kept = Tracks(followed, count, drift_x, drift_y, place, motion, both)
    if not np.any(anew):  # as nearly always; of hundreds of aircraft that is a fifth of the time
        return kept
    return map_leaves(
        lambda old, new: np.where(anew, new, old), kept, begin(report, position_std, velocity_std)
    )
