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
    ReportCheck,
    Rules,
    follow,
    take_outcome,
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


def ownship(situation: Situation, message: "AircraftState", moment: int, rules: Rules) -> Situation:
    """Take in an AircraftState of the ownship; ``moment`` in ns.

    With the first one of an id, its transmission, received as traffic before, goes.
    """
    own = take_outcome(
        situation.own,
        attempt(lambda: conversions.aircraft(message, "ownship")),
        "ownship",
        moment,
        replace(rules, elsewhere=_OWN_ELSEWHERE),
    )
    traffic, previous, last = situation.traffic, situation.own.last, own.last
    if last is not None and (previous is None or previous.identifier != last.identifier):
        echo = traffic.get(last.identifier, UNKNOWN).last
        if echo is None or may_be_own(last, echo.sighting, rules):
            traffic = {name: track for name, track in traffic.items() if name != last.identifier}
    return replace(situation, own=own, traffic=traffic)


def traffic(situation: Situation, message: "AircraftState", moment: int, rules: Rules) -> Situation:
    """Take in an AircraftState of an intruder; the own transmission, received again, is passed
    over.

    The own transmission is known by the ownship's id, at the ownship's place: another aircraft of
    that id counts. A copy under another id, as TIS-B makes them, is not recognised by its place and
    velocity: it counts as an intruder, and the task has a note of it.
    """
    name = readable(lambda: identifier("", message.id)) or called(message.id)
    field = f"intruder {name}"
    outcome, own = attempt(lambda: conversions.aircraft(message, field)), situation.own.last
    if own is not None and own.identifier == name and may_be_own(own, outcome.sighting, rules):
        return situation
    return replace(situation, traffic=follow(situation.traffic, name, outcome, moment, rules))


def traffic_array(
    situation: Situation, message: "TrafficArray", moment: int, rules: Rules
) -> Situation:
    """Take in a TrafficArray: each state as if it had come alone."""
    for state in message.states:
        situation = traffic(situation, state, moment, rules)
    return situation


def alert(situation: Situation, message: "TrafficAlert", moment: int, rules: Rules) -> Situation:
    """Take in a TrafficAlert; one that is older than the last is passed over."""

    def read() -> conversions.Alert:
        new = conversions.alert(message)
        not_ahead("alert.header.stamp", new.time, moment, rules.future)
        return new

    newest, previous = _update_message(situation.alert, read, moment), situation.alert.value
    late = newest.value is not None and previous is not None and newest.value.time < previous.time
    return situation if late else replace(situation, alert=newest)


def route(situation: Situation, message: "Trajectory", moment: int, rules: Rules) -> Situation:
    """Take in a Trajectory of status ROUTE."""
    return replace(
        situation,
        route=_update_message(
            situation.route, lambda: conversions.published_route(message), moment
        ),
    )


def geo_reference(
    situation: Situation, message: "GeoReference", moment: int, rules: Rules
) -> Situation:
    """Take in a GeoReference."""
    return replace(
        situation,
        origin=_update_message(
            situation.origin, lambda: conversions.geo_reference(message), moment
        ),
    )


def areas(situation: Situation, message: "Areas", moment: int, rules: Rules) -> Situation:
    """Take in an Areas message, which holds all areas that there are."""
    return replace(
        situation, areas=_update_message(situation.areas, lambda: read_areas(message), moment)
    )


def may_be_own(own: Report, sighting: Sighting | None, rules: Rules) -> bool:
    """Return whether an aircraft of the ownship's id may be the ownship: where it is expected, or
    at no known place.
    """
    if sighting is None or sighting.time is None or sighting.place is None:
        return True
    return own.off(sighting.place, sighting.time) <= rules.allowed_distance(
        sighting.time - own.time
    )


def _update_message(previous: Held[_T], read: Callable[[], _T], moment: int) -> Held[_T]:
    outcome = attempt(read)
    if isinstance(outcome, FieldError):
        return previous._replace(
            fault=Fault(ReportCheck.INVALID, outcome.field, outcome.problem, moment)
        )
    return Held(outcome)
