"""Successive reports of one aircraft that follow from one another, and what is believed after them.

The estimate after each report is :mod:`envs.tracking` on the ellipsoid: a report itself, with
standard deviations of its own. Where reports declare no noise and agree with those before, it is
the report, to the bit. Where the velocity does not agree with the places it is taken from them, and
an advisory says so. Where they differ so much that neither can be believed, where a place stands
still under fresh stamps, and where a report does not follow from those before, nothing is planned
with that aircraft.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from agents.planner.request.request import Altitude
from envs.backend import FLOATS
from envs.formats.local_frame import displacement, fly_straight
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.tracking import heights
from envs.tracking.heights import Heights, climb_of
from envs.tracking.single import follow
from envs.tracking.tracker import Belief, Reports, Tracks, begin, belief, repeats
from ros_bridge.core.fields import SECOND
from ros_bridge.core.reports import EXACT, Report

# s, for which a place may stand still though its aircraft flies, and m, that it flies meanwhile.
_HOLD_TIME, _HOLD_DISTANCE = 3.0, 30.0
_GREATEST = 15.0  # m/s^2, by which no aircraft's velocity changes
_SIGMAS, _NOISE = 5.5, 1.0  # that excuse a greater change, of a noise that is this at least, m/s
_DIFFERS = 0.02  # share of the speed: a smaller correction of the velocity is not told
_CLIMB = 100.0  # m/s, that no vertical speed exceeds


class Ascent(NamedTuple):
    """Altitudes of one aircraft, all of one reference, up to the newest."""

    reference: str
    time: int  # of the newest, ns
    heights: Heights


@dataclass(frozen=True, slots=True)
class Course:
    """Reports of one aircraft up to the newest."""

    newest: Report
    newest_fix: Report  # the newest whose place is a new one
    tracks: Tracks[Ground]  # after it; its place is the origin of their map, east and north
    belief: Belief[Ground]  # as of it
    # what is believed, as a report; where it cannot be believed, the newest itself
    estimate: Report
    ascent: Ascent | None  # None: no altitude with a vertical speed is known
    contradiction: str = ""
    """Why the reports cannot be believed, as a sentence without its subject; empty: they can."""
    field: str = "position"  # that this lies in

    @property
    def corrections(self) -> tuple[tuple[str, str], ...]:
        """Fields that are not believed as they were reported, each with what is taken instead, a
        sentence without its subject.
        """
        reported, estimate = self.newest_fix, self.estimate
        sentences = []
        off = math.hypot(estimate.east - reported.east, estimate.north - reported.north)
        if self.belief.bias > 0.0 and off > _DIFFERS * max(reported.speed, estimate.speed):
            sentences.append(("velocity", _difference(reported, estimate)))
        newest, agreement = self.tracks.newest, self.tracks.agreement
        for field, unit, estimated, least in (
            ("position", "m", agreement.position_std, newest.position_std),
            ("velocity", "m/s", agreement.velocity_std, newest.velocity_std),
        ):
            if estimated > least:
                correction = (
                    f"scatters by {estimated:.2g} {unit} (one sigma), which its reports do not say"
                )
                sentences.append((field, correction))
        if self.ascent is not None and self.ascent.heights.wrong:
            faster = -self.ascent.heights.lack
            correction = f"differs from its altitudes by {faster:+.1f} m/s: taken from altitudes"
            sentences.append(("altitude.vertical_speed", correction))
        return tuple(sentences)


def _difference(reported: Report, estimate: Report) -> str:
    """Return by what a velocity differs from what the places make, as a sentence."""
    turn = math.atan2(estimate.east, estimate.north) - math.atan2(reported.east, reported.north)
    degrees = math.degrees(abs(math.remainder(turn, 2.0 * math.pi)))
    faster = reported.speed - estimate.speed
    parts = [f"{degrees:.0f} deg"] if degrees >= 1.0 else []
    parts += [f"{faster:+.0f} m/s"] if abs(faster) >= 1.0 else []
    return f"differs from its positions by {' and '.join(parts) or 'little'}: taken from positions"


def begin_course(report: Report) -> Course:
    """Return a course of one report."""
    tracks = begin(_reports(report, 0.0, 0.0), FLOATS)
    return _course(report, tracks, belief(tracks, FLOATS), _ascend(None, report))


def extend(course: Course, report: Report) -> Course:
    """Return a course with one more report, later than its newest."""
    fix, previous = course.newest_fix, course.tracks.newest.state
    seconds = (report.time - fix.time) / SECOND
    east, north = displacement(*fix.place, *report.place)
    reports = _reports(report, east, north)
    if repeats(previous, reports.state, seconds, FLOATS):
        return _hold_place(course, report, seconds)
    tracks, believed, jumped = follow(course.tracks, reports, seconds)
    extended = _course(report, tracks, believed, _ascend(course.ascent, report))
    off = math.hypot(report.east - fix.east, report.north - fix.north)
    noise = math.hypot(*(max(_NOISE, source.spread(EXACT)[1]) for source in (report, fix)))
    if jumped and off > _GREATEST * seconds + _SIGMAS * noise and not course.contradiction:
        contradiction = f"changed by {off:.0f} m/s in {seconds:.1f} s, which no aircraft does"
        return replace(extended, contradiction=f"outside_domain: {contradiction}", field="velocity")
    return extended


def _hold_place(course: Course, report: Report, seconds: float) -> Course:
    """Return a course after a report whose place is that of some seconds before."""
    course, distance_flown = replace(course, newest=report), report.speed * seconds
    if seconds < _HOLD_TIME or distance_flown < _HOLD_DISTANCE:
        return course
    contradiction = (
        f"has not moved for {seconds:.1f} s while the reported velocities make "
        f"{distance_flown:.0f} m"
    )
    return replace(course, contradiction=f"outside_domain: {contradiction}", field="position")


def _course(
    report: Report, tracks: Tracks[Ground], believed: Belief[Ground], ascent: Ascent | None
) -> Course:
    """Return a course after a report, at whose place the origin of the tracks' map is."""
    if not believed.doubtful:
        estimate = _climbing(_estimate(report, believed), ascent)
        return Course(report, report, tracks, believed, estimate, ascent)
    difference = f"differs from what the velocities make by {believed.bias:.0f} m/s"
    contradiction = f"outside_domain: {difference}; neither can be believed"
    return Course(report, report, tracks, believed, report, ascent, contradiction)


def _ascend(previous: Ascent | None, report: Report) -> Ascent | None:
    """Return what is known of altitudes after a report, later than those before; None where it says
    no altitude or no vertical speed.
    """
    altitude = report.altitude
    if altitude is None or altitude.vertical_speed is None:
        return None
    reported = altitude.value, altitude.vertical_speed, altitude.error
    if previous is None or previous.reference != altitude.reference:
        ascent_heights = heights.begin(*reported, FLOATS)
    else:
        seconds = (report.time - previous.time) / SECOND
        ascent_heights = heights.extend(previous.heights, *reported, seconds, FLOATS)
    return Ascent(altitude.reference, report.time, ascent_heights)


def _climbing(report: Report, ascent: Ascent | None) -> Report:
    """Return a report with the vertical speed that is believed."""
    altitude = report.altitude
    if altitude is None or ascent is None:
        return report
    believed = climb_of(ascent.heights, FLOATS)
    if believed.error == 0.0:
        return report
    if abs(believed.climb) > _CLIMB:  # nobody knows
        return replace(report, altitude=replace(altitude, vertical_speed=None))
    error = max(altitude.climb_error, believed.error)
    climbing = Altitude(altitude.value, altitude.reference, believed.climb, altitude.error, error)
    return replace(report, altitude=climbing)


def _estimate(report: Report, believed: Belief[Ground]) -> Report:
    """Return what is believed, in a map about a report, as a report."""
    x, y, heading, speed = believed.state
    reported = math.atan2(report.north, report.east), report.speed
    stds = believed.position_std, believed.velocity_std
    turn = {"turn_rate": believed.turn_rate, "turn_std": believed.turn_std}
    if (x, y, heading, speed) == (0.0, 0.0, *reported):
        return replace(report, **turn)
    latitude, longitude = fly_straight(*report.place, x, y, 1.0)
    return replace(
        report,
        latitude=latitude,
        longitude=longitude,
        east=speed * math.cos(heading),
        north=speed * math.sin(heading),
        position_std=None if report.position_std is None else stds[0],
        velocity_std=None if report.velocity_std is None else stds[1],
        time_std=0.0,  # it is part of the position's
        shown_std=stds,
        **turn,
    )


def _reports(report: Report, east: float, north: float) -> Reports[Ground]:
    """Return a report at a place of a map, m, with one sigma of what it declares."""
    state: VehicleState[Ground] = VehicleState(
        east, north, math.atan2(report.north, report.east), report.speed
    )
    declared = report.position_std is not None and report.velocity_std is not None
    position_std, velocity_std = map(float, report.spread(EXACT))  # as compiled code takes them
    return Reports(state, position_std, velocity_std, declared)
