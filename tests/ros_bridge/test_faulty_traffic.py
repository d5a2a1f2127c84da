"""Traffic that is silent, faulty or damaged: it is refused or left out by name, and never hides
another aircraft.
"""

import math
import os
import random
from types import SimpleNamespace

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from ros_bridge.core import updates
from ros_bridge.core.fields import Code, Refusal
from ros_bridge.core.motion import to_local
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import task
from ros_bridge.core.tracks import Rules, Track, sharing
from tests.ros_bridge.scenes import (
    FRAME,
    NOW,
    SECOND,
    SETTINGS,
    aircraft,
    alert,
    crossing,
    geo_reference,
    publish,
    refusal,
    route_points,
    situation_after,
    stamp,
)

STALE = 8.0


def silent(*messages, seconds: float = STALE) -> tuple[Situation, int]:
    """Return what is known so long after the last report of traffic, with a fresh ownship at 1000
    m, in a wind that is known.
    """
    late = NOW + round(seconds * SECOND)
    high = {"valid": 0x2F, "altitude": 1_000.0, "altitude_reference": 1}
    own = aircraft(0.0, 0.0, 0.0, 75.0, id="own", time=late, **high)
    return updates.ownship(situation_after(*messages, own=own, now=NOW), own, late, RULES), late


def above(metres: float, **more):
    return crossing(
        **({"valid": 0x0F, "altitude": 1_000.0 + metres, "altitude_reference": 1} | more)
    )


@pytest.mark.parametrize(
    "message",
    [
        aircraft(320_000.0, 0.0, math.pi, 75.0),
        aircraft(320_000.0, 0.0, math.pi, 75.0, valid=0x01),
        above(10_000.0),
        above(10_000.0, valid=0x03),
        above(-950.0),
    ],
)
def test_silent_aircraft_out_of_reach_is_excluded_by_name(message):
    situation, late = silent(message)
    requested = task(situation, late, SETTINGS)
    assert requested.identifiers == () and [name for name, _ in requested.excluded] == ["4b1a2c"]
    assert requested.excluded[0][1]
    # An alert about it makes it count.
    alerted = updates.alert(situation, alert("4b1a2c", time=late), late, RULES)
    assert refusal(alerted, late)[0] in (Code.STALE_INTRUDER, Code.INVALID_INTRUDER)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (crossing(), Code.STALE_INTRUDER),
        (aircraft(60_000.0, 0.0, math.pi, 75.0), Code.STALE_INTRUDER),
        (aircraft(320_000.0, 0.0, math.pi, 75.0, valid=0x04), Code.INVALID_INTRUDER),
        (aircraft(60_000.0, 0.0, math.pi, 75.0, valid=0x01), Code.INVALID_INTRUDER),
        (above(700.0), Code.STALE_INTRUDER),
        (above(10_000.0, altitude_reference=3), Code.STALE_INTRUDER),
        # It may climb or descend by 10 m/s.
        (above(-950.0, valid=0x07), Code.STALE_INTRUDER),
        (above(6_000.0, valid=0x07), Code.STALE_INTRUDER),
        (
            above(10_000.0, valid=0x0F, velocity=SimpleNamespace(x=0.0, y=75.0, z=-40.0)),
            Code.STALE_INTRUDER,
        ),
    ],
)
def test_silent_aircraft_that_may_come_near_is_refused(message, code: Code):
    assert refusal(*silent(message))[0] is code


def test_far_reports_do_not_hide_a_near_aircraft_of_the_same_name():
    far, near = (aircraft(x, 0.0, math.pi, 75.0) for x in (320_000.0, 6_000.0))
    for first, second in ((far, near), (near, far)):
        assert refusal(*silent(first, second, seconds=1.0)) == (
            Code.INVALID_INTRUDER,
            "intruder 4b1a2c.position",
        )
    beyond = aircraft(400_000.0, 0.0, math.pi, 75.0)
    assert task(*silent(far, beyond, seconds=1.0), SETTINGS).identifiers == ()


def test_fault_of_an_aircraft_under_the_own_id_holds():
    situation, faulty = situation_after(), []
    for second in range(30):
        now = NOW + second * SECOND
        own = aircraft(75.0 * second, 0.0, 0.0, 75.0, id="own", time=now)
        frozen = aircraft(0.0, 0.0, 0.0, 75.0, id="own", time=now)
        situation = updates.traffic(updates.ownship(situation, own, now, RULES), frozen, now, RULES)
        faulty.append(not is_answered(situation, now))
    assert True in faulty and all(faulty[faulty.index(True) :])


def unusable(kind: str, second: int, x: float):
    """Return a report of an aircraft that flies westwards and lacks its velocity, or comes from
    ahead of the clock.
    """
    time = NOW + second * SECOND
    if kind == "no velocity":
        return aircraft(x - 75.0 * second, 0.0, math.pi, 75.0, time=time, valid=0x01)
    return aircraft(x - 75.0 * second, 0.0, math.pi, 75.0, time=time + 3 * SECOND)


@pytest.mark.parametrize("kind", ["no velocity", "future"])
@pytest.mark.parametrize("good", [True, False])
@pytest.mark.parametrize("pattern", ["fnfnfnfnfn", "fffnfffnfffnf", "nffnffnf"])
def test_usable_reports_do_not_hide_an_unusable_aircraft_of_the_same_name(
    kind: str, good: bool, pattern: str
):
    situation, refusals = situation_after(), []
    for second, letter in enumerate(pattern):
        now = NOW + second * SECOND
        if letter == "n":
            message = unusable(kind, second, 9_000.0)
        elif good:
            message = aircraft(60_000.0 - 75.0 * second, 0.0, math.pi, 75.0, time=now)
        else:
            message = unusable(kind, second, 320_000.0)
        own = aircraft(75.0 * second, 0.0, 0.0, 75.0, id="own", time=now)
        situation = updates.traffic(
            updates.ownship(situation, own, now, RULES), message, now, RULES
        )
        refusals += [] if is_answered(situation, now) else [second]
    # One report alone may be an outlier; from the second on there is another aircraft.
    since = [second for second, letter in enumerate(pattern) if letter == "n"][1]
    assert [second for second in refusals if second >= since] == list(range(since, len(pattern)))


def is_answered(situation: Situation, now: int) -> bool:
    try:
        task(situation, now, SETTINGS)
    except Refusal:
        return False
    return True


def test_unusable_report_at_the_same_place_is_no_second_aircraft():
    situation = situation_after(aircraft(9_000.0, 0.0, math.pi, 75.0))
    late = NOW + SECOND
    situation = updates.traffic(situation, unusable("no velocity", 1, 9_000.0), late, RULES)
    assert not is_answered(situation, late)
    late += SECOND
    good = aircraft(8_850.0, 0.0, math.pi, 75.0, time=late)
    situation = updates.ownship(
        situation, aircraft(150.0, 0.0, 0.0, 75.0, id="own", time=late), late, RULES
    )
    assert is_answered(updates.traffic(situation, good, late, RULES), late)


def test_an_aircraft_that_may_come_near_on_a_long_last_leg_is_never_left_out():
    """Without a velocity it may fly 400 m/s; the plan may last 23 minutes."""
    long = publish(route_points(spacing=45_000.0, count=2))
    near, late = silent(aircraft(320_000.0, 0.0, math.pi, 75.0, valid=0x01), seconds=1.0)
    with pytest.raises(Refusal) as refused:
        task(updates.route(near, long, late, RULES), late, SETTINGS)
    assert refused.value.code is Code.INVALID_INTRUDER
    far, late = silent(aircraft(720_000.0, 0.0, math.pi, 75.0, valid=0x01), seconds=1.0)
    requested = task(updates.route(far, long, late, RULES), late, SETTINGS)
    assert [name for name, _ in requested.excluded] == ["4b1a2c"]


def test_the_bound_of_a_plans_end_is_the_planners():
    """An ownship of 49 m/s may be on its last leg of 45 km until 23 minutes after the request."""
    long = publish(route_points(spacing=45_000.0, count=2))
    slow = aircraft(0.0, 0.0, 0.0, 49.0, id="own")
    head_on = aircraft(320_000.0, 0.0, math.pi, 149.0)
    situation = updates.route(situation_after(head_on, own=slow, now=NOW), long, NOW, RULES)
    requested = task(situation, NOW, SETTINGS)
    assert requested.excluded == () and len(requested.intruders) == 1


# Aircraft states, a third of them damaged: what is planned with is where the aircraft is.

ROWS = int(os.environ.get("FUZZ_ROWS", "20000"))
TICKS, EVERY = 40, 0.5
RULES = Rules()
STARTS = {
    "own": (0.0, 0.0, 0.0, 75.0),
    "4b0001": (9_000.0, 300.0, math.pi, 80.0),
    "4b0002": (60e3, 9e3, -1.6, 50.0),
}


def truth(name: str, seconds: float) -> tuple[float, float, float, float]:
    x, y, heading, speed = STARTS[name]
    return (
        x + speed * seconds * math.cos(heading),
        y + speed * seconds * math.sin(heading),
        heading,
        speed,
    )


def damage(message, name: str, now: int, draw: random.Random) -> None:
    kind = draw.randrange(8)
    if kind == 0:
        setattr(
            message,
            draw.choice(["latitude", "longitude"]),
            draw.choice([math.nan, 1e300, -91.0, "x", None]),
        )
    elif kind == 1:
        message.latitude += draw.choice([-1.0, 1.0]) * draw.uniform(0.05, 3.0)
    elif kind == 2:
        message.velocity.x, message.velocity.y = message.velocity.y, message.velocity.x
    elif kind == 3:
        message.header.stamp = stamp(now + draw.choice([-3, -40, 3, 100]) * SECOND)
    elif kind == 4:
        message.id = draw.choice([name.upper() + " ", "", "\n", "OWN ", f"x{draw.random()}"])
    elif kind == 5:
        message.valid = draw.choice([0, 1, 3, 4, 255, 65_535])
    elif kind == 6:
        scale = draw.choice([0.0, 1.94384, 57.29578, -1.0])
        message.velocity.x, message.velocity.y = (
            scale * message.velocity.x,
            scale * message.velocity.y,
        )
    else:
        message.position_std, message.valid = draw.choice([math.nan, -1.0, 1e9]), 0x45


def _near_truth(track: Track, name: str, now: int) -> bool:
    """Return whether the last report of a track is where the aircraft of a name was."""
    assert track.last is not None
    at, (x, y, *_) = to_local(FRAME, track.last), truth(name, (track.last.time - NOW) / SECOND)
    allowed = RULES.jump_distance + RULES.jump_speed * max(track.age(now), EVERY)
    return math.hypot(at.x - x, at.y - y) <= allowed


@pytest.mark.slow
def test_damaged_states_never_move_what_is_planned_with():
    draw, rows, planned = random.Random(0), 0, 0
    start = updates.geo_reference(Situation(), geo_reference(), NOW, RULES)
    start = updates.route(start, publish(route_points()), NOW, RULES)
    while rows < ROWS:
        situation = start
        for tick in range(TICKS):
            seconds, now = EVERY * tick, NOW + round(EVERY * tick * SECOND)
            for name in STARTS:
                message = aircraft(*truth(name, seconds), id=name, time=now)
                if tick > 3 and draw.random() < 0.33:
                    damage(message, name, now, draw)
                take = updates.ownship if name == "own" else updates.traffic
                situation, rows = take(situation, message, now, RULES), rows + 1
            try:
                requested = task(situation, now, SETTINGS)
            except Refusal:
                continue
            planned += 1
            # An intruder may bear the ownship's name, which is not looked at here.
            tracks = {
                identifier: situation.traffic[identifier] for identifier in requested.identifiers
            } | {"own": situation.own}
            for name in tracks.keys() & STARTS.keys():
                # Damaged places that agree with each other are another aircraft of that name.
                sharing_tracks = [tracks[identifier] for identifier in sharing(tracks, name)]
                assert any(_near_truth(track, name, now) for track in sharing_tracks), name
    assert planned > 0.2 * rows / len(STARTS)
