"""The tracker of one aircraft, in plain floats, compiled where numba is installed."""

from envs.backend import FLOATS
from envs.compiled import Arguments, Entry
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.tracking.tracker import Belief, Reports, Tracks, begin, belief, extend, restart, shift


def follow(
    tracks: Tracks[Ground], reports: Reports[Ground], dt: float
) -> tuple[Tracks[Ground], Belief[Ground], bool]:
    """Return the tracks with one more report, ``dt`` s after the one before, what is believed then,
    and whether the report did not follow from those before, so that the estimates began anew.

    The report's position is the origin of the new tracks' map.
    """
    return (FOLLOW if FOLLOW.ready else _follow)(tracks, reports, dt)


def _follow(
    tracks: Tracks[Ground], reports: Reports[Ground], dt: float
) -> tuple[Tracks[Ground], Belief[Ground], bool]:
    extended, jumped = extend(tracks, reports, dt, FLOATS)
    if jumped:
        extended = restart(extended, FLOATS)
    local = shift(extended, reports.state.x, reports.state.y)
    return local, belief(local, FLOATS), jumped


def _examples() -> list[Arguments]:
    reports: Reports[Ground] = Reports(VehicleState(0.0, 0.0, 0.0, 0.0), 0.0, 0.0, True)
    return [(begin(reports, FLOATS), reports, 1.0)]


FOLLOW = Entry(_follow, _examples)
"""Compiled :func:`follow`."""
