"""What is said of flights: a plan called SAFE that did not keep the separation is never passed over."""

import math

from ros_bridge.sim.flight_log import FlightLog, kept, table


def flown(**more) -> FlightLog:
    return FlightLog(
        **({"name": "x 0", "first": "SAFE", "safe_at": 1.2, "separation": 1_100.0, "duration": 90.0} | more)
    )


def test_safe_plans_must_keep_the_separation():
    assert kept([flown(), flown(separation=1_000.0)])
    assert not kept([flown(), flown(separation=999.9)])
    assert not kept([flown(separation=math.nan)])
    assert not kept([flown(failure="the attitude is lost")])
    # Nobody promised anything.
    assert kept([flown(first="UNRESOLVED", safe_at=None, separation=300.0)])


def test_the_table_names_what_went_wrong():
    text = table([flown(), flown(name="y 3", separation=900.04, latency=[0.01, 0.02], wall=9.0)])
    assert "2 of 2 encounters had a plan called SAFE; the closest of them: 900.0 m (y 3); below 1000 m: y 3" in text
    assert "900.0 !" in text and "1100.0 " in text
    assert "20.0 times real time" in text
    assert "answers, end to end, ms: median 15.0, 90 % 19.0, 99 % 19.9, max 20.0 (2 requests)" in text
    # Refusing is no success where the encounter could have been resolved.
    judged = [
        flown(resolvable=True),
        flown(resolvable=True, safe_at=None),
        flown(resolvable=False, safe_at=None),
        flown(),
    ]
    assert "of those that can be resolved at the separation planned with: 1 of 2 (50.0 %)" in table(judged)
    none = table([flown(safe_at=None, failure="runner and monitor have not answered")])
    assert "none of 1 encounters had a plan called SAFE" in none and "x 0: runner and monitor" in none
