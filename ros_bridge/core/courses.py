"""Successive reports that follow from one another, and whether the places they name agree with
their velocities.

A receiver that repeats an old position under fresh stamps, or names a velocity that is not the
aircraft's, is not seen from one report to the next: the allowance for a jump is much larger than
the way flown in between. Over some seconds it is: the displacement is compared with the integral of
the reported velocities.

The estimate after each report is :mod:`agents.assurance.tracker` on the ellipsoid: a report itself,
with standard deviations of its own. Where reports declare no noise, or begin anew, it is the
report, to the bit. So it is where the noise is unknown: nothing can be averaged then. Where places
scatter by much more than they declare, as those of two aircraft under one name a hundred metres
apart, the scatter counts as their noise.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from agents.assurance.plausible import Tolerance, difference
from agents.assurance.tracker import Tracks, begin, follow
from envs.formats.local_frame import displacement, fly_straight
from envs.frames import Ground
from envs.kinematics import VehicleState
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import EXACT, Report

_WINDOWS = (
    3.0,
    20.0,
)  # s, that displacements are compared over: fast aircraft are found in the first, slow in both
_SHORTEST = 2.0  # s, at least
_SIGMAS = 3.0
_ALLOWED = Tolerance(60.0, 0.4, _SIGMAS)
"""Rounded digits, stamps set on reception, positions held for a second; velocities in knots for m/s
differ by 0.49. Like the windows it describes receivers and the traffic's aircraft, so that nothing
of it follows from the ownship."""

_SCATTER_OF = 5  # reports
_SCATTER_BEYOND = 3.0  # times the declared noise, from where on it counts, and ...
_SCATTER_LEAST = 10.0  # m, besides

_TURN_BASELINE = (0.2, 5.0)  # s between two reports that a turn may be read from


class _Window(NamedTuple):
    """Where a comparison began, and the integral of the velocities since then, m."""

    start: Report
    reports: int = 1
    east: float = 0.0
    north: float = 0.0


class Turn(NamedTuple):
    """How the velocity changed between the newest and an earlier estimate."""

    rate: float = 0.0  # rad/s, positive to the left; 0 where noise could be all of it
    change: float = 0.0  # size of the change of the velocity, m/s
    seconds: float = 0.0  # between the two
    noise: float = 0.0  # one sigma per axis of the change that the reports declare, m/s


STRAIGHT = Turn()
"""Of too few reports, too."""


@dataclass(frozen=True, slots=True)
class Course:
    """Reports of one aircraft up to the newest."""

    newest: Report
    windows: tuple[_Window, ...]
    estimate: Report
    # what the tracker remembers; the estimate's place is the origin of its map, east and north
    tracks: Tracks[Ground]
    reference: Report  # an earlier estimate, far enough back to read a turn from
    contradiction: str = ""  # how the places contradict the velocities; empty: they do not
    turn: Turn = STRAIGHT
    residuals: tuple[float, ...] = ()
    """How far the last reports' places were from what the velocities make of those before, m."""

    scatter: float = 0.0
    """One sigma per axis of the places as measured, m; 0 where what they declare excuses it."""


def begin_course(report: Report) -> Course:
    """Return a course of one report."""
    return Course(report, (_Window(report),) * len(_WINDOWS), report, _first(report), report)


def extend(course: Course, report: Report) -> Course:
    """Return a course with one more report, later than its newest."""
    before, seconds = course.newest, (report.time - course.newest.time) / SECOND
    east, north = (
        0.5 * (before.east + report.east) * seconds,
        0.5 * (before.north + report.north) * seconds,
    )
    windows = [
        _Window(w.start, w.reports + 1, w.east + east, w.north + north) for w in course.windows
    ]
    contradiction = course.contradiction
    for number, (window, longest) in enumerate(zip(windows, _WINDOWS, strict=True)):
        # For two reports alone the allowance for a jump holds.
        length = (report.time - window.start.time) / SECOND
        if length < _SHORTEST or window.reports < 3:
            continue
        problem, agrees = _compare(window, report, length)
        if problem:
            contradiction, windows = problem, [_Window(report)] * len(windows)
            break
        if agrees or length >= _WINDOWS[-1]:
            contradiction = ""
        if length >= longest:
            windows[number] = _Window(report)
    residuals = _residuals(course, report, (east, north), seconds)
    scatter = _scatter(residuals, report)
    estimate, tracks = _improve(course, report, scatter)
    reference, turn = _measure_turn(course, estimate)
    return Course(
        report,
        tuple(windows),
        estimate,
        tracks,
        reference,
        contradiction,
        turn,
        residuals,
        scatter,
    )


def _scatter(residuals: tuple[float, ...], report: Report) -> float:
    """Return what the residuals of a course say of its newest report (:attr:`Course.scatter`)."""
    if not residuals or report.position_std is None:
        return 0.0
    # Two places differ, on two axes.
    measured = 0.5 * math.sqrt(sum(off**2 for off in residuals) / len(residuals))
    excused = _SCATTER_BEYOND * report.spread(EXACT)[0] + _SCATTER_LEAST
    return measured if measured > excused else 0.0


def _residuals(
    course: Course, report: Report, flown: tuple[float, float], seconds: float
) -> tuple[float, ...]:
    """Return the residuals after one more report; ``flown`` is what the velocities make, m."""
    if seconds > _TURN_BASELINE[1]:
        return ()  # a manoeuvre would count as scatter
    moved = displacement(*course.newest.place, *report.place)
    off = math.hypot(moved[0] - flown[0], moved[1] - flown[1])
    return (*course.residuals[1 - _SCATTER_OF :], off)


def _compare(window: _Window, report: Report, seconds: float) -> tuple[str, bool]:
    """Return how displacement and velocities contradict each other, or "", and whether they clearly
    agree.
    """
    start = window.start
    east, north = displacement(*start.place, *report.place)
    moved, flown = math.hypot(east, north), math.hypot(window.east, window.north)
    (before, _), (after, drift) = start.spread(EXACT), report.spread(EXACT)
    noise = math.hypot(before, after) + drift * seconds
    off, allowed = difference((east, north), (window.east, window.north), noise, _ALLOWED)
    if off <= allowed:
        # What the noise alone excuses is no agreement: a frozen position under a large declared
        # noise has it too.
        return "", bool(off <= _ALLOWED.share * max(moved, flown))
    what = (
        f"moved {moved:.0f} m in {seconds:.1f} s while the reported velocities make {flown:.0f} m"
    )
    return f"outside_domain: {what}; the two differ by {off:.0f} m, allowed {allowed:.0f} m", False


def _measure_turn(course: Course, report: Report) -> tuple[Report, Turn]:
    """Return the estimate to read the next turn from, and the turn now."""
    before = course.reference
    seconds = (report.time - before.time) / SECOND
    if seconds < _TURN_BASELINE[0]:
        return before, course.turn
    if seconds > _TURN_BASELINE[1]:
        return report, STRAIGHT
    angle = math.atan2(report.north, report.east) - math.atan2(before.north, before.east)
    rate = math.remainder(angle, 2.0 * math.pi) / seconds
    change = math.hypot(report.east - before.east, report.north - before.north)
    noise = math.hypot(report.spread(EXACT)[1], before.spread(EXACT)[1])
    significant = abs(rate) >= _SIGMAS * noise / (max(report.speed, 1.0) * seconds)
    return report, Turn(rate if significant else 0.0, change, seconds, noise)


def _first(report: Report) -> Tracks[Ground]:
    return begin(_state_at(0.0, 0.0, report), *report.spread(EXACT))


def _improve(course: Course, report: Report, scatter: float) -> tuple[Report, Tracks[Ground]]:
    """Return the estimate after one more report, later than those before, and what the tracker
    remembers then.
    """
    if scatter:
        # Its noise is no white one: nothing is averaged.
        report = replace(report, position_std=scatter)
        return report, _first(report)
    spread = report.spread(EXACT)
    if report.position_std is None or report.velocity_std is None or not any(spread):
        return report, _first(report)
    before = course.estimate
    x, y = displacement(*before.place, *report.place)
    seconds = (report.time - before.time) / SECOND
    tracks = follow(course.tracks, _state_at(x, y, report), *spread, seconds)
    if tracks.count == 1.0:
        return report, _first(report)
    x, y, heading, speed = map(float, tracks.state)
    latitude, longitude = fly_straight(*before.place, x, y, 1.0)
    estimate = replace(
        report,
        latitude=latitude,
        longitude=longitude,
        east=speed * math.cos(heading),
        north=speed * math.sin(heading),
        position_std=float(np.sqrt(tracks.position_variance)),
        velocity_std=float(np.sqrt(tracks.velocity_variance)),
        time_std=0.0,  # it is part of the position's
    )
    return estimate, tracks._replace(state=tracks.state._replace(x=0.0, y=0.0))


def _state_at(x: float, y: float, report: Report) -> VehicleState[Ground]:
    return VehicleState(x, y, math.atan2(report.north, report.east), report.speed)
