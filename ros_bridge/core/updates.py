"""What a message does to the situation: one pure function an input; a fault stays until a good
message follows.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from ros_bridge.core import conversions
from ros_bridge.core.areas import areas as read_areas
from ros_bridge.core.fields import (
    FieldError,
    Sighting,
    attempt,
    called,
    identifier,
    not_ahead,
    readable,
)
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Held, Situation
from ros_bridge.core.tracks import (
    UNKNOWN,
    Fault,
    Rules,
    Track,
    Verdict,
    follow,
    note_refused,
    take_in,
)

if TYPE_CHECKING:
    from rlcas_msgs.msg import (
        AircraftState,
        Areas,
        GeoReference,
        TrafficAlert,
        TrafficArray,
        Trajectory,
    )

_T = TypeVar("_T")

_OWN_ELSEWHERE = 2.0
"""For how long a report of another place counts of the ownship, s: its source has been replaced, or
another one was taken for it by mistake. Of traffic it counts as long as an aircraft that is silent.
"""


def ownship(situation: Situation, message: "AircraftState", now: int, rules: Rules) -> Situation:
    """Take in an AircraftState of the ownship; ``now`` in ns.

    With the first one of an id, its transmission, received as traffic before, goes.
    """
    own = _update_track(
        situation.own,
        attempt(lambda: conversions.aircraft(message, "ownship")),
        "ownship",
        now,
        replace(rules, elsewhere=_OWN_ELSEWHERE),
    )
    traffic, before, last = situation.traffic, situation.own.last, own.last
    if last is not None and (before is None or before.identifier != last.identifier):
        echo = traffic.get(last.identifier, UNKNOWN).last
        if echo is None or may_be_own(last, echo.sighting, rules):
            traffic = {name: track for name, track in traffic.items() if name != last.identifier}
    return replace(situation, own=own, traffic=traffic)


def traffic(situation: Situation, message: "AircraftState", now: int, rules: Rules) -> Situation:
    """Take in an AircraftState of an intruder; the own transmission, received again, is passed
    over.

    The own transmission is known by the ownship's id, at the ownship's place: another aircraft of
    that id counts. A copy under another id, as TIS-B makes them, is not recognised by its place and
    velocity: it counts as an intruder, and the task has a note of it.
    """
    name = readable(lambda: identifier("", message.id)) or called(message.id)
    field = f"intruder {name}"
    found, own = attempt(lambda: conversions.aircraft(message, field)), situation.own.last
    if own is not None and own.identifier == name and may_be_own(own, found.sighting, rules):
        return situation
    return replace(situation, traffic=follow(situation.traffic, name, found, now, rules))


def traffic_array(
    situation: Situation, message: "TrafficArray", now: int, rules: Rules
) -> Situation:
    """Take in a TrafficArray: each state as if it had come alone."""
    for state in message.states:
        situation = traffic(situation, state, now, rules)
    return situation


def alert(situation: Situation, message: "TrafficAlert", now: int, rules: Rules) -> Situation:
    """Take in a TrafficAlert; one that is older than the last is passed over."""

    def read() -> conversions.Alert:
        new = conversions.alert(message)
        not_ahead("alert.header.stamp", new.time, now, rules.future)
        return new

    held, before = _update_held(situation.alert, read, now), situation.alert.value
    late = held.value is not None and before is not None and held.value.time < before.time
    return situation if late else replace(situation, alert=held)


def route(situation: Situation, message: "Trajectory", now: int, rules: Rules) -> Situation:
    """Take in a Trajectory of status ROUTE."""
    return replace(
        situation,
        route=_update_held(situation.route, lambda: conversions.published_route(message), now),
    )


def geo_reference(
    situation: Situation, message: "GeoReference", now: int, rules: Rules
) -> Situation:
    """Take in a GeoReference."""
    return replace(
        situation,
        origin=_update_held(situation.origin, lambda: conversions.geo_reference(message), now),
    )


def areas(situation: Situation, message: "Areas", now: int, rules: Rules) -> Situation:
    """Take in an Areas message, which holds all areas that there are."""
    return replace(situation, areas=_update_held(situation.areas, lambda: read_areas(message), now))


def may_be_own(own: Report, seen: Sighting | None, rules: Rules) -> bool:
    """Return whether an aircraft of the ownship's id may be the ownship: where it is expected, or
    at no known place.
    """
    if seen is None or seen.time is None or seen.place is None:
        return True
    return own.off(seen.place, seen.time) <= rules.allowed_distance(seen.time - own.time)


def _update_held(before: Held[_T], read: Callable[[], _T], now: int) -> Held[_T]:
    found = attempt(read)
    if isinstance(found, FieldError):
        return before._replace(fault=Fault(Verdict.INVALID, found.field, found.problem, now))
    return Held(found)


def _update_track(
    before: Track, found: Report | FieldError, name: str, now: int, rules: Rules
) -> Track:
    if isinstance(found, FieldError):
        return note_refused(before, found, now, rules)
    return take_in(before, found, name, now, rules)
