"""The judge of both sides: it knows the mission and where all were, and nothing of who flew."""

import math
from typing import NamedTuple

import numpy as np
import shapely

from benchmarks.icarous.missions import Mission, outline
from envs.areas import Area, Keep
from envs.arrays import Array

TOLERANCE = 0.01
"""Share of the separation by which an intruder may be nearer before it is lost: control is sampled
on both sides.
"""

DEPTH = 1.0
"""How far beyond its edge a fence must be passed to be violated, m."""


class Track(NamedTuple):
    """Where all were; between two times they flew straight. Fields ``[T]``, of intruders ``[T,
    K]``.
    """

    time: Array  # s
    x: Array  # of the ownship, m east
    y: Array  # m north
    other_x: Array  # of the intruders
    other_y: Array


class MissionOutcome(NamedTuple):
    """What became of one flight, until it arrived or ended."""

    separation: float  # least distance to any intruder, m; inf without one
    lost: int  # intruders that were too near
    lost_at: float  # s, the first; nan: none
    breached: int  # fences that were violated
    breached_at: float  # s, the first; nan: none
    arrived: float  # s; nan: it did not
    path: float  # m
    excess: float  # of the path over the mission's length, share of that

    @property
    def solved(self) -> bool:
        """Whether it arrived and violated nothing."""
        return not self.lost and not self.breached and math.isfinite(self.arrived)


def judge(mission: Mission, track: Track, separation: float, radius: float) -> MissionOutcome:
    """Judge a flight.

    Args:
        mission: that was flown.
        track: in the mission's frame.
        separation: required, m.
        radius: within which the last waypoint is reached, m.
    """
    arrived, track = _cut_at_arrival(track, mission.waypoints[-1], radius)
    away = distances(track)
    near = away < (1.0 - TOLERANCE) * separation
    lost_at = track.time[:-1][near.any(axis=1)]
    breaches = [_breach(track, fence) for fence in mission.fences]
    breach_times = [when for when in breaches if math.isfinite(when)]
    path = float(np.hypot(np.diff(track.x), np.diff(track.y)).sum())
    # What is left within the radius counts as flown.
    whole = path + radius if math.isfinite(arrived) else path
    return MissionOutcome(
        separation=float(away.min(initial=math.inf)),
        lost=int(near.any(axis=0).sum()),
        lost_at=float(lost_at[0]) if lost_at.size else math.nan,
        breached=len(breach_times),
        breached_at=min(breach_times, default=math.nan),
        arrived=arrived,
        path=path,
        excess=whole / mission.length - 1.0,
    )


def distances(track: Track) -> np.ndarray:
    """Return the least distance to each intruder between each two times, m, ``[T - 1, K]``."""
    x, y = track.other_x - track.x[:, None], track.other_y - track.y[:, None]
    dx, dy = np.diff(x, axis=0), np.diff(y, axis=0)
    square = np.maximum(dx * dx + dy * dy, 1e-12)
    share = np.clip(-(x[:-1] * dx + y[:-1] * dy) / square, 0.0, 1.0)
    return np.hypot(x[:-1] + share * dx, y[:-1] + share * dy)


def _cut_at_arrival(track: Track, goal: tuple[float, float], radius: float) -> tuple[float, Track]:
    """Return when the goal's radius is entered, s (nan: never), and the flight until then."""
    x, y = (np.full((track.time.size, 1), place) for place in goal)
    still = track._replace(other_x=x, other_y=y)
    within = distances(still)[:, 0] <= radius
    if not within.any():
        return math.nan, track
    last = int(np.argmax(within)) + 2
    return float(track.time[last - 1]), Track(*(field[:last] for field in track))


def _breach(track: Track, fence: Area) -> float:
    """Return when a flight is first beyond a fence's edge, s; nan: never."""
    inner = outline(fence)
    kept_out = fence.keep is Keep.OUT
    edge = inner.buffer(-DEPTH if kept_out else DEPTH)
    ends = np.stack([track.x, track.y], axis=-1)
    pieces = shapely.linestrings(np.stack([ends[:-1], ends[1:]], axis=1))
    bad = shapely.intersects(edge, pieces) if kept_out else ~shapely.covers(edge, pieces)
    return float(track.time[:-1][bad][0]) if bad.any() else math.nan
