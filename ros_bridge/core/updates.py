"""What a message does to the situation: one pure function an input; a fault stays until a good message follows."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from envs.formats.local_frame import carried, distance
from ros_bridge.core import conversions
from ros_bridge.core.fields import SECOND, FieldError, identifier, readable
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Situation
from ros_bridge.core.tracks import UNKNOWN, Fault, Rules, Track, Verdict, refused, taken


def ownship(situation: Situation, message: Any, now: int, rules: Rules) -> Situation:
    """Take in an AircraftState of the ownship; ``now`` in ns.

    With the first one of an id, its transmission, received as traffic before, goes.
    """
    own = _track(situation.own, lambda: conversions.aircraft(message, "ownship"), "ownship", now, rules)
    traffic, before = situation.traffic, situation.own.last
    new = own.last is not None and (before is None or before.identifier != own.last.identifier)
    echo = traffic.get(own.last.identifier) if own.last is not None and new else None
    if own.last is not None and echo is not None:
        last = echo.last
        if last is None or _near(own.last, (last.latitude, last.longitude), last.time, rules):
            traffic = {name: track for name, track in traffic.items() if name != own.last.identifier}
    return replace(situation, own=own, traffic=traffic)


def traffic(situation: Situation, message: Any, now: int, rules: Rules) -> Situation:
    """Take in an AircraftState of an intruder; the own transmission, received again, is passed over.

    The own transmission is known by the ownship's id, at the ownship's place: another aircraft of that id counts. A
    copy under another id, as TIS-B makes them, is not recognised by its place and velocity: it counts as an intruder,
    and the task has a note of it.
    """
    name = readable(lambda: identifier("", message.id)) or message.id
    own = situation.own.last
    if own is not None and own.identifier == name:
        _, time, place, _ = conversions.sighting(message, name)
        if time is None or place is None or _near(own, place, time, rules):
            return situation
    called = f"intruder {name}"
    before = situation.traffic.get(name, UNKNOWN)
    track = _track(before, lambda: conversions.aircraft(message, called), called, now, rules)
    return replace(situation, traffic={**situation.traffic, name: track})


def alert(situation: Situation, message: Any, now: int, rules: Rules) -> Situation:
    """Take in a TrafficAlert; one that is older than the last is passed over."""
    try:
        new = conversions.alert(message)
        ahead = (new.time - now) / SECOND
        if ahead > rules.future:
            field = "alert.header.stamp"
            raise FieldError(field, f"is {ahead:.3f} s ahead of the clock, expected {rules.future:g} s at most")
    except FieldError as error:
        return replace(situation, alert_fault=_fault(error, now))
    if situation.alert is not None and new.time < situation.alert.time:
        return situation
    return replace(situation, alert=new, alert_fault=None)


def route(situation: Situation, message: Any, now: int) -> Situation:
    """Take in a Trajectory of status ROUTE."""
    try:
        return replace(situation, route=conversions.published_route(message), route_fault=None)
    except FieldError as error:
        return replace(situation, route_fault=_fault(error, now))


def geo_reference(situation: Situation, message: Any, now: int) -> Situation:
    """Take in a GeoReference."""
    try:
        return replace(situation, origin=conversions.geo_reference(message), origin_fault=None)
    except FieldError as error:
        return replace(situation, origin_fault=_fault(error, now))


def reset(situation: Situation) -> Situation:
    """Return what holds after the clock has stepped back: route and geo-reference, for they have no age."""
    return replace(situation, own=UNKNOWN, traffic={}, alert=None, alert_fault=None)


def _near(own: Report, place: tuple[float, float], time: int, rules: Rules) -> bool:
    """Return whether a place is where the ownship is to be expected at a time, ns."""
    seconds = (time - own.time) / SECOND
    expected = carried(own.latitude, own.longitude, own.east, own.north, seconds)
    return distance(*expected, *place) <= rules.jump_distance + rules.jump_speed * abs(seconds)


def _track(before: Track, read: Callable[[], Report], name: str, now: int, rules: Rules) -> Track:
    try:
        report = read()
    except FieldError as error:
        return refused(before, error.field, str(error), now, rules, error.sighting)
    return taken(before, report, name, now, rules)[0]


def _fault(error: FieldError, now: int) -> Fault:
    return Fault(Verdict.INVALID, error.field, str(error), now)
