"""What is wrong leaves when its cause leaves, and runner and monitor judge one traffic alike."""

import math

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from agents.assurance.state import State
from ros_bridge.core import updates
from ros_bridge.core.assurance import activate, initial, step_monitor
from ros_bridge.core.fields import Code, Refusal
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import in_terms_of_messages, task
from tests.ros_bridge.scenes import (
    NOW,
    RULES,
    SECOND,
    SETTINGS,
    THRESHOLDS,
    aircraft,
    alert,
    publish,
    refusal,
    route_points,
    situation_after,
)
from tests.ros_bridge.test_assurance import publish_plan


def at(seconds: float) -> int:
    return NOW + round(seconds * SECOND)


def refused(situation: Situation, now: int) -> Code | None:
    try:
        task(situation, now, SETTINGS)
    except Refusal as refusal:
        return refusal.code
    return None


def test_an_alert_that_cannot_be_read_counts_as_long_as_others():
    situation = updates.alert(situation_after(), alert("a", level=9), NOW, RULES)

    def later(seconds: float) -> Code | None:
        own = aircraft(75.0 * seconds, 0.0, 0.0, 75.0, id="own", time=at(seconds))
        return refused(updates.ownship(situation, own, at(seconds), RULES), at(seconds))

    assert later(1.0) is Code.INVALID_ALERT
    assert later(SETTINGS.freshness.alert - 0.1) is Code.INVALID_ALERT
    assert later(SETTINGS.freshness.alert + 0.1) is None


def own_reports(situation: Situation, begin: float, end: float, *, y: float = 0.0, ahead=0.0):
    """Return the situation after the ownship's reports at 5 Hz, by a source of its name."""
    for tick in range(round(begin * 5.0), round(end * 5.0)):
        seconds_flown = tick / 5.0 + ahead
        own = aircraft(75.0 * seconds_flown, y, 0.0, 75.0, id="own", time=at(seconds_flown))
        situation = updates.ownship(situation, own, at(tick / 5.0), RULES)
    return situation


def twins(situation: Situation, begin: float, end: float) -> Situation:
    for tick in range(round(begin * 5.0), round(end * 5.0)):
        situation = own_reports(situation, tick / 5.0, (tick + 1) / 5.0)
        late = at(tick / 5.0 + 0.1)
        second_aircraft = aircraft(75.0 * tick / 5.0, 2_000.0, 0.0, 75.0, id="own", time=late)
        situation = updates.ownship(situation, second_aircraft, late, RULES)
    return situation


@pytest.mark.parametrize("side", [0.0, 2_000.0])
def test_ownship_with_one_source_again_is_usable_within_seconds(side: float):
    situation = twins(situation_after(), 0.2, 4.0)
    assert refused(situation, at(4.0)) is Code.INVALID_OWNSHIP
    # Whichever of the two goes on.
    assert refused(own_reports(situation, 4.0, 7.0, y=side), at(7.0)) is None


def test_ownship_of_two_sources_is_refused_however_long():
    situation = situation_after()
    for second in range(1, 40):
        situation = twins(situation, float(second), second + 1.0)
        if second > 2:
            assert refused(situation, at(second + 1.0)) is Code.INVALID_OWNSHIP


def test_ownship_whose_clock_is_right_again_is_usable_within_seconds():
    situation = own_reports(situation_after(), 0.2, 2.0)
    situation = own_reports(situation, 2.0, 4.0, ahead=100.0)
    assert refused(situation, at(4.0)) is Code.FUTURE_OWNSHIP
    assert refused(own_reports(situation, 4.0, 7.0), at(7.0)) is None


@pytest.mark.parametrize("apart", [30.0, 100.0])
@pytest.mark.parametrize("every", [0.2, 1.0])
def test_runner_and_monitor_agree_about_a_name_at_two_near_places(apart: float, every: float):
    situation, states = situation_after(), []
    supervision = None
    for count in range(round(20.0 / every)):
        seconds = count * every
        y = 6_000.0 + apart * (count % 2)
        message = aircraft(30_000.0 - 75.0 * seconds, y, math.pi, 75.0, time=at(seconds))
        situation = updates.traffic(situation, message, at(seconds), RULES)
        situation = own_reports(situation, seconds, seconds + 0.2)
        if supervision is None and seconds >= 3.0:
            plan = publish_plan(situation, seconds=seconds)
            supervision = activate(initial(THRESHOLDS), situation, plan)
        if supervision is not None:
            supervision = step_monitor(supervision, situation, at(seconds))
            states.append(State(int(supervision.monitor.state[0])))
    assert set(states) == {State.MONITORING}
    requested = task(situation, at(20.0 - every), SETTINGS)
    [intruder] = requested.intruders
    assert intruder.position_std == pytest.approx(0.5 * apart, rel=0.4)
    assert any("scatters" in note.text for note in requested.notes)


def test_a_name_that_cannot_be_used_stands_short_and_on_one_line_everywhere():
    for name in ("a\nb" * 20_000, "", "x" * 65_000, "\u202ex"):
        situation = situation_after(aircraft(9_000.0, 0.0, math.pi, 75.0, id=name))
        [(key, track)] = situation.traffic.items()
        assert track.fault is not None
        with pytest.raises(Refusal) as caught:
            task(situation, NOW, SETTINGS)
        for text in (key, track.fault.message, str(caught.value), caught.value.field):
            assert len(text) < 200
            assert text.isprintable()


def test_reasons_name_aircraft_and_not_numbers():
    names = ("4b1a2c", "a")
    text = "intruders[1] is 3 m away; intruders[0].x is off"
    assert in_terms_of_messages(text, names) == "intruder a is 3 m away; intruder 4b1a2c.x is off"


def test_a_route_is_as_long_as_it_can_be_read_in_time():
    longest, longer = (publish(route_points(count=count, spacing=50.0)) for count in (1000, 1001))
    assert refused(updates.route(situation_after(), longest, NOW, RULES), NOW) is None
    assert refusal(updates.route(situation_after(), longer, NOW, RULES)) == (
        Code.INVALID_ROUTE,
        "route.waypoints",
    )
