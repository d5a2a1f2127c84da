"""What is known of each aircraft: its last good report, what was wrong with a newer one, how old it
is.

A report that repeats the last one or comes late is passed over. One from the future, one that
contradicts another of the same time and one that has jumped is a fault: nothing is planned with
that aircraft. A doubtful report was an outlier when two good ones follow in a row; a jump that the
next report confirms was none. Where reports of both places go on arriving, one name stands for two
aircraft: of traffic each is followed by itself (:func:`follow`), of the ownship it is a fault until
one of them has fallen silent.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import NamedTuple

from envs.formats.local_frame import distance
from ros_bridge.core.courses import Course, begin_course, extend
from ros_bridge.core.fields import SECOND, FieldError, Sighting, not_ahead
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.reports import FASTEST, Report


class ReportCheck(Enum):
    """What a report was found to be when it was checked against those before."""

    TAKEN = "taken"
    DUPLICATE = "duplicate"  # the last one again; passed over
    REORDERED = "reordered"  # older than the last one; passed over
    FUTURE = "future"  # from further ahead of the clock than allowed; a fault
    CONFLICT = "conflict"  # another place or velocity at the time of the last one; a fault
    # not where the last one let it be expected; a fault unless the next report agrees with it
    JUMP = "jump"
    # the name is used at two places in turns; a fault as long as both are reported
    SHARED = "shared"
    # places do not agree with velocities, as where one is frozen; a fault
    CONTRADICTION = "contradiction"
    INVALID = "invalid"  # not finite, out of range or inconsistent; a fault


_OUTLIER = 2  # good reports in a row that show that a doubtful one was an outlier
_MOST_SIGHTED = 8  # places of unusable reports that are remembered of one name
_MOST_SHARING = 4  # aircraft under one name that are told apart
FAULTS = frozenset(ReportCheck) - {ReportCheck.TAKEN, ReportCheck.DUPLICATE, ReportCheck.REORDERED}


@dataclass(frozen=True, slots=True)
class Fault:
    """Why the newest message of an aircraft, or of another input, cannot be used."""

    check: ReportCheck
    field: str
    problem: str  # a sentence without its subject, the field
    arrived: int  # when, ns

    @property
    def message(self) -> str:
        """The whole sentence."""
        return f"{self.field} {self.problem}"


@dataclass(frozen=True, slots=True)
class Rules:
    """What reports must keep to; see :mod:`ros_bridge.transport.parameters`."""

    future: float = USUAL_FRESHNESS.future  # by how much a stamp may lie ahead of the clock, s
    jump_distance: float = 500.0  # largest distance from where the aircraft was expected, m, ...
    jump_speed: float = 50.0  # ... which grows with the time between the reports, m/s
    agreement: float = 1.0  # two reports of the same time agree within this, m and m/s
    fresh_start: float = 30.0  # after so long without a report, s, any place is accepted
    elsewhere: float = 30.0  # for how long a report of another place counts, s

    def allowed_distance(self, time: int) -> float:
        """Return how far from where it is expected an aircraft may be after or before a time, ns,
        m.
        """
        return self.jump_distance + self.jump_speed * abs(time / SECOND)


class Sighted(NamedTuple):
    """Where a name was reported by a message that cannot be used."""

    sighting: Sighting
    arrived: int  # when, ns
    again: bool = False  # whether another such report agreed with it
    since: int = 0  # good reports of another place since

    @property
    def time(self) -> int:
        """At which it held at the latest, ns."""
        return self.arrived if self.sighting.time is None else min(self.sighting.time, self.arrived)


@dataclass(frozen=True, slots=True)
class Track:
    """One aircraft."""

    last: Report | None = None  # the last good report
    estimate: Report | None = None  # the estimate after it (:mod:`ros_bridge.core.courses`)
    fault: Fault | None = None  # None: the newest report was good
    course: Course | None = None
    """The reports that the last good one follows from, those that contradict themselves included.
    """
    rival: Course | None = None  # reports of another place under the same name
    since: int = 0  # reports of the course since the rival's newest
    shared: bool = False  # whether the rival was confirmed after that: two aircraft
    divided: bool = False  # whether it is one of several aircraft that report the same name
    sightings: tuple[Sighted, ...] = ()
    """Of the reports that cannot be used and that no good report explains; the newest last."""
    check: ReportCheck = ReportCheck.TAKEN  # what became of the newest report
    arrived: int = 0  # when the newest message came, whatever became of it and time it tells, ns
    counts: Mapping[ReportCheck, int] = field(default_factory=lambda: MappingProxyType({}))
    """How many reports there were of each result."""

    @property
    def turn_rate(self) -> float:
        """Turn rate that the reports show, rad/s, positive to the left; 0 where noise could be all
        of it.
        """
        return 0.0 if self.estimate is None else self.estimate.turn_rate

    def age(self, moment: int) -> float:
        """Return the age of the last good report, s; infinite without one."""
        return float("inf") if self.last is None else (moment - self.last.time) / SECOND


UNKNOWN = Track()  # of an aircraft without any report


class _Comparison(NamedTuple):
    """What a report is beside an earlier one."""

    check: ReportCheck
    elsewhere: bool = False  # whether it is a fault for its place
    field: str = ""  # of a fault
    problem: str = ""  # of a fault, a sentence without its subject, the field


class _Arrival(NamedTuple):
    """Whose report is taken in, when, and what it must keep to."""

    name: str  # such as ``intruder 4b1a2c``
    moment: int  # ns
    rules: Rules


def take_in(track: Track, report: Report, name: str, moment: int, rules: Rules) -> Track:
    """Take in a report, checked, of an aircraft with a name such as ``intruder 4b1a2c``, at a
    moment, ns.
    """
    arrival, track = _Arrival(name, moment, rules), replace(track, arrived=moment)
    try:
        not_ahead(f"{name}.header.stamp", report.time, moment, rules.future)
    except FieldError as error:
        track = _add_sighting(track, report.sighting._replace(time=None), moment, rules)
        return _set_fault(track, ReportCheck.FUTURE, error.field, error.problem, moment)
    track = _forget_rival(track, report, rules)
    course = track.course
    if course is None:
        return _take_good(track, begin_course(report), arrival)
    comparison = _compare(course.newest, report, rules)
    if comparison.check is ReportCheck.TAKEN:
        track = replace(track, since=track.since + 1)
        return _take_good(track, _next(course, report, rules), arrival)
    if comparison.check not in FAULTS:
        return _count_check(track, comparison.check)
    if comparison.elsewhere:
        return _take_elsewhere(track, course, report, comparison, arrival)
    return _set_fault(
        track, comparison.check, f"{name}.{comparison.field}", comparison.problem, moment
    )


def _forget_rival(track: Track, report: Report, rules: Rules) -> Track:
    """Return the track without a rival that has long been silent at the time of a report."""
    if track.rival is None:
        return track
    silence = (report.time - track.rival.newest.time) / SECOND
    if silence <= rules.elsewhere:
        return track
    return replace(track, rival=None, since=0, shared=False)


def follow(
    tracks: Mapping[str, Track], name: str, outcome: Report | FieldError, moment: int, rules: Rules
) -> dict[str, Track]:
    """Return the tracks of traffic after a report under a name, or after why it cannot be used.

    Aircraft that share a name are told apart by their places: the second is called ``name#2``.
    """
    key = _holder(tracks, name, outcome.sighting, rules)
    previous = tracks.get(key, UNKNOWN)
    if isinstance(outcome, FieldError):
        return {**tracks, key: note_refused(previous, outcome, moment, rules)}
    track = take_in(previous, outcome, f"intruder {key}", moment, rules)
    free = [
        free_name
        for free_name in _shared_names(name)
        if free_name != key and free_name not in tracks
    ]
    if not track.shared or track.rival is None or not free:
        return {**tracks, key: track}
    rival = track.rival
    second = Track(rival.newest_fix, rival.estimate, course=rival, divided=True, arrived=moment)
    problem = rival.contradiction
    if problem:
        second = _set_fault(
            second, ReportCheck.CONTRADICTION, f"intruder {free[0]}.{rival.field}", problem, moment
        )
    alone = replace(track, rival=None, since=0, shared=False, divided=True)
    if track.fault is not None and track.fault.check is ReportCheck.SHARED:
        alone = replace(alone, fault=None)
    return {**tracks, key: alone, free[0]: second}


def sharing(tracks: Mapping[str, Track], name: str) -> tuple[str, ...]:
    """Return under which names the aircraft that report a name are followed."""
    return tuple(shared_name for shared_name in _shared_names(name) if shared_name in tracks)


def _shared_names(name: str) -> tuple[str, ...]:
    """Return what the aircraft that share a name are called, the first by it."""
    return name, *(f"{name}#{number}" for number in range(2, _MOST_SHARING + 1))


def _holder(tracks: Mapping[str, Track], name: str, reported: Sighting | None, rules: Rules) -> str:
    """Return the name of the aircraft, of those that share a name, that a report is about: the
    nearest to where it is expected, or else the first.
    """
    names = sharing(tracks, name)
    if (
        names in ((), (name,))
        or reported is None
        or reported.place is None
        or reported.time is None
    ):
        return name
    fits = []
    for candidate in names:
        course = tracks[candidate].course
        if course is None:
            continue
        off = course.newest.off(reported.place, reported.time)
        if off <= rules.allowed_distance(reported.time - course.newest.time):
            fits.append((off, candidate))
    return min(fits)[1] if fits else name


def note_refused(track: Track, error: FieldError, moment: int, rules: Rules) -> Track:
    """Note that a report could not be used."""
    track = replace(track, arrived=moment)
    track = track if error.sighting is None else _add_sighting(track, error.sighting, moment, rules)
    return _set_fault(track, ReportCheck.INVALID, error.field, error.problem, moment)


def take_outcome(
    track: Track, outcome: Report | FieldError, name: str, moment: int, rules: Rules
) -> Track:
    """Take in a report, or note why it could not be used; arguments as of :func:`take_in`."""
    if isinstance(outcome, FieldError):
        return note_refused(track, outcome, moment, rules)
    return take_in(track, outcome, name, moment, rules)


def forget_silent(
    tracks: Mapping[str, Track], moment: int, limit: float
) -> tuple[dict[str, Track], tuple[str, ...]]:
    """Return the tracks that are still reported, and the names of those of which no message has
    arrived for ``limit`` seconds. What still arrives is not silent, however old it says that it is.
    """
    silent = tuple(
        name for name, track in tracks.items() if (moment - track.arrived) / SECOND > limit
    )
    return {name: track for name, track in tracks.items() if name not in silent}, silent


def _add_sighting(track: Track, sighting: Sighting, moment: int, rules: Rules) -> Track:
    """Return the track with a sighting, which replaces those that may be of the same aircraft."""
    new, other_sightings = Sighted(sighting, moment), []
    for old in track.sightings:
        if (moment - old.arrived) / SECOND > rules.elsewhere:
            continue
        place, old_place = sighting.place, old.sighting.place
        if place is None or old_place is None:
            same_aircraft = place is old_place
        else:
            reach = rules.jump_distance + FASTEST * abs(new.time - old.time) / SECOND
            same_aircraft = distance(*place, *old_place) <= reach
        if same_aircraft:
            new = new._replace(again=True)
        else:
            other_sightings.append(old)
    return replace(track, sightings=(*other_sightings[1 - _MOST_SIGHTED :], new))


def _unexplained_sightings(
    track: Track, report: Report, moment: int, rules: Rules
) -> tuple[Sighted, ...]:
    """Return the sightings that were elsewhere than a good report says."""
    unexplained = []
    for sighted in track.sightings:
        place = sighted.sighting.place
        if place is None or (moment - sighted.arrived) / SECOND > rules.elsewhere:
            continue
        if report.off(place, sighted.time) > rules.allowed_distance(sighted.time - report.time):
            unexplained.append(sighted._replace(since=sighted.since + 1))
    return tuple(unexplained)


def _take_good(track: Track, course: Course, arrival: _Arrival) -> Track:
    """Return the track with a report that follows from those before it."""
    name, moment, rules = arrival
    sightings = _unexplained_sightings(track, course.newest, moment, rules)
    track = replace(track, course=course, sightings=sightings)
    if course.contradiction:
        problem = course.contradiction
        return _set_fault(
            track, ReportCheck.CONTRADICTION, f"{name}.{course.field}", problem, moment
        )
    track = replace(track, last=course.newest_fix, estimate=course.estimate)
    if track.shared and track.rival is not None:
        apart = distance(*course.newest.place, *track.rival.newest.place)
        problem = f"is the name of two aircraft {apart / 1e3:.1f} km apart, expected one"
        return _set_fault(track, ReportCheck.SHARED, f"{name}.id", problem, moment)
    # One good report after a doubtful one may be the first of two aircraft, in turns.
    doubtful = track.rival is not None and track.since < _OUTLIER
    # So may one after a report that cannot be used and comes from elsewhere; several of those are a
    # second aircraft.
    doubtful |= any(sighted.again or sighted.since < _OUTLIER for sighted in track.sightings)
    return _count_check(replace(track, fault=track.fault if doubtful else None), ReportCheck.TAKEN)


def _take_elsewhere(
    track: Track, course: Course, report: Report, comparison: _Comparison, arrival: _Arrival
) -> Track:
    """Return the track with a report of another place than its course's, of which a comparison
    says how it is a fault.
    """
    name, moment, rules = arrival
    rival = track.rival
    rival_check = ReportCheck.JUMP if rival is None else _compare(rival.newest, report, rules).check
    if rival is None or rival_check in FAULTS:
        if rival is not None:
            track = _add_sighting(track, rival.newest.sighting, moment, rules)
        track = replace(track, rival=begin_course(report), since=0, shared=False)
        return _set_fault(
            track, comparison.check, f"{name}.{comparison.field}", comparison.problem, moment
        )
    if rival_check is not ReportCheck.TAKEN:
        return _count_check(track, rival_check)
    rival = _next(rival, report, rules)
    silent = (report.time - course.newest.time) / SECOND > rules.elsewhere
    if not silent and (track.since or track.shared or comparison.check is ReportCheck.CONFLICT):
        return _take_good(replace(track, rival=rival, since=0, shared=True), course, arrival)
    # Nothing came from the old place since: the aircraft is here. If the old place is reported
    # again, there are two.
    alone = replace(track, rival=course, since=_OUTLIER, shared=False)
    return _take_good(alone, rival, arrival)


def _compare(newest: Report, report: Report, rules: Rules) -> _Comparison:
    first, second = (newest, report) if report.time >= newest.time else (report, newest)
    off, seconds = first.off(second.place, second.time), (second.time - first.time) / SECOND
    allowed = rules.allowed_distance(second.time - first.time)
    if off > allowed and seconds <= rules.fresh_start:
        check = ReportCheck.JUMP if seconds > 0.0 else ReportCheck.CONFLICT
        difference = (
            f"is {off:.0f} m from where another report lets it be expected, allowed {allowed:.0f} m"
        )
        return _Comparison(check, elsewhere=True, field="position", problem=difference)
    if report.time > newest.time:
        return _Comparison(ReportCheck.TAKEN)
    if report.time < newest.time:
        return _Comparison(ReportCheck.REORDERED)
    faster = max(abs(newest.east - report.east), abs(newest.north - report.north))
    if off <= rules.agreement and faster <= rules.agreement:
        return _Comparison(ReportCheck.DUPLICATE)
    difference = (
        f"belongs to two reports that differ by {off:.1f} m and {faster:.1f} m/s, expected one"
    )
    return _Comparison(ReportCheck.CONFLICT, field="header.stamp", problem=difference)


def _next(course: Course, report: Report, rules: Rules) -> Course:
    """Return the course with a later report; after a long silence a new one."""
    silence = (report.time - course.newest.time) / SECOND
    return begin_course(report) if silence > rules.fresh_start else extend(course, report)


def _set_fault(track: Track, check: ReportCheck, field: str, problem: str, moment: int) -> Track:
    """Return the track after a report that cannot be used."""
    return _count_check(replace(track, fault=Fault(check, field, problem, moment)), check)


def _count_check(track: Track, check: ReportCheck) -> Track:
    counts = {**track.counts, check: track.counts.get(check, 0) + 1}
    return replace(track, check=check, counts=MappingProxyType(counts))
