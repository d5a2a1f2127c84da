"""Recorded tracks as encounters: the ownship begins where its track does and has a goal ahead, the others are replayed.

Tracks are taken in the horizontal plane: co-altitude is assumed. An intruder flies on straight where its track ends.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from envs.encounters import Encounter
from envs.intruder import INTRUDER_LIMITS, Intent
from envs.kinematics import SURROGATE, Limits, VehicleState
from envs.perception import Sensor
from envs.tracks import Track, TrackError, at_times

__all__ = ["AHEAD", "Replay", "replay"]

AHEAD = 220.0
"""Seconds of flight from the start to the goal, unless told otherwise."""


class Replay(NamedTuple):
    """Encounters of recorded intruders."""

    starts: Encounter
    """``[N]``."""
    recorded: VehicleState
    """The intruders at each step, ``[T + 1, N, K]``."""
    names: tuple[str, ...]
    left_out: tuple[str, ...]
    """Sentences on encounters that cannot be flown, and why."""


def replay(
    encounters: Sequence[tuple[str, Track, Sequence[Track]]],
    *,
    steps: int,
    dt: float = 1.0,
    ahead: float = AHEAD,
    limits: Limits = SURROGATE,
) -> Replay:
    """Return recorded encounters as the evaluation flies them.

    Args:
        encounters: name, the ownship's track and those of its intruders, each at least a second long.
        steps: time steps that a flight can take.
        dt: of a step, s.
        ahead: the goal lies so many seconds ahead on the ownship's first course, at its first speed.
        limits: of the ownship; encounters that begin outside its speeds are left out, with the reason.

    Raises:
        TrackError: none of the encounters can be flown.
    """
    kept, left_out = [], []
    for name, own, others in encounters:
        reason = _unfit(own, others, limits)
        if reason:
            left_out.append(f"{name}: {reason}")
        else:
            kept.append((name, own, others))
    if not kept:
        raise TrackError(f"no encounter can be flown; the first: {left_out[0] if left_out else 'there is none'}")
    most = max(len(others) for _, _, others in kept)
    count = len(kept)
    states = np.zeros((4, steps + 1, count, most))
    mask = np.zeros((count, most), bool)
    own = np.zeros((4, count))
    for i, (_, mine, others) in enumerate(kept):
        own[:, i] = [mine.x[0], mine.y[0], np.arctan2(mine.vy[0], mine.vx[0]), np.hypot(mine.vx[0], mine.vy[0])]
        for k in range(most):
            # An absent intruder repeats the first one, so that it is finite everywhere.
            states[:, :, i, k] = _states(others[k if k < len(others) else 0], mine.time[0], steps, dt)
        mask[i, : len(others)] = True
    start = VehicleState(*own)
    recorded = VehicleState(*states)
    reach = ahead * start.speed
    zeros, column = np.zeros((count, most)), np.zeros((count, 1))
    starts = Encounter(
        start,
        start.x + reach * np.cos(start.heading),
        start.y + reach * np.sin(start.heading),
        VehicleState(*(field[0] for field in recorded)),
        mask,
        Intent(zeros, zeros, zeros + np.radians(3.0)),
        Sensor(column, column, column),
    )
    return Replay(starts, recorded, tuple(name for name, _, _ in kept), tuple(left_out))


def _unfit(own: Track, others: Sequence[Track], limits: Limits) -> str:
    """Return why an encounter cannot be flown, nothing if it can."""
    speed = float(np.hypot(own.vx[0], own.vy[0]))
    if not limits.speed_min <= speed <= limits.speed_max:
        return (
            f"the ownship begins with {speed:.1f} m/s over the ground, expected {limits.speed_min:g} to "
            f"{limits.speed_max:g} m/s"
        )
    if not others:
        return "there is no intruder, expected at least one"
    for other in others:
        if not other.time[0] <= own.time[0] < other.time[-1]:
            return f"the track of {other.name!r} begins after the ownship's or ends before it"
        fastest = float(np.max(np.hypot(other.vx, other.vy)))
        if fastest > INTRUDER_LIMITS.speed_max:
            return f"{other.name!r} flies at {fastest:.1f} m/s, expected at most {INTRUDER_LIMITS.speed_max:g} m/s"
    return ""


def _states(track: Track, start: float, steps: int, dt: float) -> np.ndarray:
    """Return x, y, heading and speed at each step, ``[4, T + 1]``."""
    times = start + dt * np.arange(steps + 1)
    known = at_times(track, np.minimum(times, track.time[-1]))
    beyond = np.maximum(times - track.time[-1], 0.0)
    x, y = known.x + known.vx * beyond, known.y + known.vy * beyond
    return np.stack([x, y, np.arctan2(known.vy, known.vx), np.hypot(known.vx, known.vy)])
