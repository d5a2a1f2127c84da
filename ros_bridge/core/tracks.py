"""What is known of each aircraft: its last good report, what was wrong with a newer one, how old it is.

A report that repeats the last one or comes late is passed over. One from the future, one that contradicts another of
the same time and one that has jumped is a fault: until a good report follows nothing is planned with that aircraft.
A jump that a second report confirms was none: the aircraft is where the two agree.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType

from agents.assurance.thresholds import Thresholds
from agents.planner.request import Altitude
from ros_bridge.core.fields import SECOND
from ros_bridge.core.geodesy import carried, distance

__all__ = ["NOBODY", "Fault", "Report", "Rules", "Track", "Verdict", "forgotten", "refused", "taken"]

_BASELINE = (0.2, 5.0)  # s between two reports that a turn may be read from
_SIGNIFICANT = 3.0  # sigmas by which it must differ from straight flight
_THRESHOLDS = Thresholds()


@dataclass(frozen=True, slots=True)
class Report:
    """A state of an aircraft as reported, checked by :mod:`ros_bridge.core.conversions`."""

    identifier: str
    time: int
    """At which it held, ns."""
    latitude: float
    """Degrees, WGS-84."""
    longitude: float
    east: float
    """Velocity over the ground, true east, m/s."""
    north: float
    altitude: Altitude | None = None
    """None: unknown."""
    position_std: float = 0.0
    """One sigma per axis, m."""
    velocity_std: float = 0.0
    """m/s."""
    true_airspeed: float | None = None
    """m/s; None: unknown."""
    wind: tuple[float, float] | None = None
    """Velocity of the air, true east and north, m/s; None: unknown."""


class Verdict(Enum):
    """What became of a report."""

    TAKEN = "taken"
    DUPLICATE = "duplicate"
    """The last one again; passed over."""
    REORDERED = "reordered"
    """Older than the last one; passed over."""
    FUTURE = "future"
    """From further ahead of the clock than allowed; a fault."""
    CONFLICT = "conflict"
    """Another place or velocity at the time of the last one; a fault."""
    JUMP = "jump"
    """Not where the last one let it be expected; a fault unless the next report agrees with it."""
    INVALID = "invalid"
    """Not finite, out of range or inconsistent; a fault."""


FAULTS = frozenset({Verdict.FUTURE, Verdict.CONFLICT, Verdict.JUMP, Verdict.INVALID})


@dataclass(frozen=True, slots=True)
class Fault:
    """Why the newest report of an aircraft cannot be used."""

    verdict: Verdict
    field: str
    message: str
    """A sentence that begins with the field."""
    arrived: int
    """When, ns."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What reports must keep to; see :mod:`ros_bridge.transport.parameters`."""

    future: float = 0.5
    """By how much a stamp may lie ahead of the clock, s."""
    jump_distance: float = 500.0
    """Largest distance from where the aircraft was expected, m, ..."""
    jump_speed: float = 50.0
    """... which grows with the time between the reports, m/s."""
    same: float = 1.0
    """Two reports of the same time agree within this, m and m/s."""
    fresh_start: float = 30.0
    """After so long without a report, s, any place is believed."""


@dataclass(frozen=True, slots=True)
class Track:
    """One aircraft."""

    last: Report | None = None
    """The last good report."""
    doubted: Report | None = None
    """The one that jumped, until the next."""
    fault: Fault | None = None
    """None: the newest report was good."""
    reference: Report | None = None
    """An earlier good report, far enough back to read a turn from."""
    turn_rate: float = 0.0
    """That the last report and an earlier one show, rad/s, positive to the left; 0 where noise could be all of it."""
    counts: Mapping[Verdict, int] = field(default_factory=lambda: MappingProxyType({}))
    """Of all reports."""

    def age(self, now: int) -> float:
        """Return the age of the last good report, s; infinite without one."""
        return float("inf") if self.last is None else (now - self.last.time) / SECOND


NOBODY = Track()
"""Of an aircraft that has not been heard of."""


def taken(track: Track, report: Report, name: str, now: int, rules: Rules) -> tuple[Track, Verdict]:
    """Take in a report.

    Args:
        track: of the same aircraft.
        report: checked.
        name: of the aircraft in messages, such as ``ownship`` or ``intruder 4b1a2c``.
        now: on the node's clock, ns.
        rules: for reports.
    """
    verdict, why = _judged(track, report, now, rules)
    if verdict in FAULTS:
        doubted = report if verdict is Verdict.JUMP else None
        fault = Fault(verdict, f"{name}.{why[0]}", f"{name}.{why[0]} {why[1]}", now)
        return replace(track, doubted=doubted, fault=fault, counts=_counted(track, verdict)), verdict
    if verdict is Verdict.TAKEN:
        reference, rate = _turning(track, report)
        return Track(report, None, None, reference, rate, _counted(track, verdict)), verdict
    return replace(track, counts=_counted(track, verdict)), verdict


def refused(track: Track, field: str, message: str, now: int) -> Track:
    """Note that a report could not be read; ``message`` begins with ``field``."""
    fault = Fault(Verdict.INVALID, field, message, now)
    return replace(track, doubted=None, fault=fault, counts=_counted(track, Verdict.INVALID))


def forgotten(tracks: Mapping[str, Track], now: int, after: float) -> tuple[dict[str, Track], tuple[str, ...]]:
    """Return the tracks that are heard of, and the names of those that have been silent for ``after`` seconds."""
    silent = tuple(
        name
        for name, track in tracks.items()
        if track.age(now) > after and (track.fault is None or (now - track.fault.arrived) / SECOND > after)
    )
    return {name: track for name, track in tracks.items() if name not in silent}, silent


def _judged(track: Track, report: Report, now: int, rules: Rules) -> tuple[Verdict, tuple[str, str]]:
    """Return what a report is, and for a fault its field and the rest of the sentence."""
    ahead = (report.time - now) / SECOND
    if ahead > rules.future:
        return Verdict.FUTURE, (
            "header.stamp",
            f"is {ahead:.3f} s ahead of the clock, expected {rules.future:g} s at most",
        )
    last = track.last
    if last is None:
        return Verdict.TAKEN, ("", "")
    if report.time < last.time:
        return Verdict.REORDERED, ("", "")
    if report.time == last.time:
        apart = distance(last.latitude, last.longitude, report.latitude, report.longitude)
        faster = max(abs(last.east - report.east), abs(last.north - report.north))
        if apart <= rules.same and faster <= rules.same:
            return Verdict.DUPLICATE, ("", "")
        problem = f"belongs to two reports that differ by {apart:.1f} m and {faster:.1f} m/s, expected one"
        return Verdict.CONFLICT, ("header.stamp", problem)
    off = _off(last, report, rules)
    if off is None:
        return Verdict.TAKEN, ("", "")
    doubted = track.doubted
    if doubted is not None and report.time > doubted.time and _off(doubted, report, rules) is None:
        return Verdict.TAKEN, ("", "")
    problem = f"is {off[0]:.0f} m from where the last report lets it be expected, allowed {off[1]:.0f} m"
    return Verdict.JUMP, ("position", problem)


def _off(before: Report, after: Report, rules: Rules) -> tuple[float, float] | None:
    """Return by how much a report is not where an earlier one lets it be expected, and what is allowed; None: it is."""
    seconds = (after.time - before.time) / SECOND
    if seconds > rules.fresh_start:
        return None
    latitude, longitude = carried(before.latitude, before.longitude, before.east, before.north, seconds)
    off = distance(latitude, longitude, after.latitude, after.longitude)
    allowed = rules.jump_distance + rules.jump_speed * seconds
    return None if off <= allowed else (off, allowed)


def _turning(track: Track, report: Report) -> tuple[Report, float]:
    """Return the report to read the next turn from, and the turn rate now."""
    before = track.reference
    if before is None:
        return report, 0.0
    seconds = (report.time - before.time) / SECOND
    if seconds < _BASELINE[0]:
        return before, track.turn_rate
    if seconds > _BASELINE[1]:
        return report, 0.0
    turn = math.atan2(report.north, report.east) - math.atan2(before.north, before.east)
    rate = math.remainder(turn, 2.0 * math.pi) / seconds
    speed = max(math.hypot(report.east, report.north), 1.0)
    noise = math.hypot(report.velocity_std, before.velocity_std) / (speed * seconds)
    least = max(_THRESHOLDS.turn_rate_min, _SIGNIFICANT * noise)
    return report, rate if least <= abs(rate) <= _THRESHOLDS.turn_rate_max else 0.0


def _counted(track: Track, verdict: Verdict) -> Mapping[Verdict, int]:
    return MappingProxyType({**track.counts, verdict: track.counts.get(verdict, 0) + 1})
