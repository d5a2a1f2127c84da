"""A hundred thousand aircraft states, a third of them damaged: what is planned with is where the aircraft is."""

import math
import random

import pytest

pytest.importorskip("pyproj", reason="pyproj is not installed; to have it: make ros")

from ros_bridge.core import updates
from ros_bridge.core.refusals import Refusal
from ros_bridge.core.situation import Settings, Situation, placed, task
from ros_bridge.core.tracks import Rules
from tests.ros_bridge.scenes import FRAME, NOW, SECOND, aircraft, geo_reference, published, route_points, stamp

ROWS, TICKS, EVERY = 100_000, 40, 0.5
RULES, SETTINGS = Rules(), Settings()
STARTS = {"own": (0.0, 0.0, 0.0, 75.0), "4b0001": (9_000.0, 300.0, math.pi, 80.0), "4b0002": (60e3, 9e3, -1.6, 50.0)}


def truth(name: str, seconds: float) -> tuple[float, float, float, float]:
    x, y, heading, speed = STARTS[name]
    return x + speed * seconds * math.cos(heading), y + speed * seconds * math.sin(heading), heading, speed


def damaged(message, name: str, now: int, draw: random.Random) -> None:
    kind = draw.randrange(8)
    if kind == 0:
        setattr(message, draw.choice(["latitude", "longitude"]), draw.choice([math.nan, 1e300, -91.0, "x", None]))
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
        message.velocity.x, message.velocity.y = scale * message.velocity.x, scale * message.velocity.y
    else:
        message.position_std, message.valid = draw.choice([math.nan, -1.0, 1e9]), 0x45


@pytest.mark.slow
def test_damaged_states_never_move_what_is_planned_with():
    draw, rows, planned = random.Random(0), 0, 0
    start = updates.geo_reference(Situation(), geo_reference(), NOW)
    start = updates.route(start, published(route_points()), NOW)
    while rows < ROWS:
        situation = start
        for tick in range(TICKS):
            seconds, now = EVERY * tick, NOW + round(EVERY * tick * SECOND)
            for name in STARTS:
                message = aircraft(*truth(name, seconds), id=name, time=now)
                if tick > 3 and draw.random() < 0.33:
                    damaged(message, name, now, draw)
                take = updates.ownship if name == "own" else updates.traffic
                situation, rows = take(situation, message, now, RULES), rows + 1
            try:
                wanted = task(situation, now, SETTINGS)
            except Refusal:
                continue
            planned += 1
            # An intruder may bear the ownship's name, which is not looked at here.
            tracks = {one: situation.traffic[one] for one in wanted.identifiers} | {"own": situation.own}
            for name in tracks.keys() & STARTS.keys():
                track, last = tracks[name], tracks[name].last
                assert last is not None
                at, (x, y, *_) = placed(FRAME, last), truth(name, (last.time - NOW) / SECOND)
                allowed = RULES.jump_distance + RULES.jump_speed * max(track.age(now), EVERY)
                assert math.hypot(at.x - x, at.y - y) <= allowed, name
    assert planned > 0.2 * rows / len(STARTS)
