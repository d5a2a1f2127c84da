"""Separations, clearances and altitudes are kept to the tolerances of the theorem, in certificates
whose distances are known exactly: 40 s at 80 m/s towards the east, with 1020 m to be kept.
"""

import math
from typing import Any

import numpy as np
import pytest

from agents.check import Work, accept
from agents.check.altitude import side_of
from agents.check.area import in_air
from agents.check.balls import UNIT, ZERO, Ball, ball, to_float
from agents.check.certificate import Heights, Report, Wind
from agents.check.leg import fly
from agents.check.reading import read
from agents.check.refusal import RefusedError
from agents.check.separation import covered, track_of
from tests.agents.check.certificates import (
    accepted,
    area,
    box,
    edited,
    flight,
    intruder,
    refusal,
    straight,
    threshold,
    work_of,
)

ABEAM, END = 1_600.0, 3_200.0  # where the ownship is after 20 s and 40 s
FULL = 1_020.0  # what is to be kept from an intruder


def near(*row: float, **changes: Any) -> dict[str, Any]:
    """Return a certificate with one intruder, finely cut."""
    return straight(**{"intruders": [intruder(*row)], "parts": 1024} | changes)


# Separations.


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_separation_is_kept_to_a_millimetre_of_the_margin(side: float) -> None:
    assert accepted(near(ABEAM, side * (FULL - 0.000_9)))
    assert "intruder 0 may come too close before" in refusal(near(ABEAM, side * (FULL - 0.001_2)))
    assert refusal(near(ABEAM, side * (FULL - 0.001_8)))


def test_the_separation_itself_is_kept_to_three_micrometres() -> None:
    bare = {"requirement": {"separation": 1_000.0, "margin": 0.0, "sigmas": 0.0}}
    assert accepted(near(ABEAM, 1_000.0 - 2e-6, **bare))
    assert refusal(near(ABEAM, 1_000.0 - 1e-5, **bare))


def test_the_intruders_own_separation_is_kept() -> None:
    own = intruder(ABEAM, 800.0, separation=750.0)
    assert accepted(straight(intruders=[own]))
    assert refusal(straight(intruders=[[*own[:-1], 790.0]]))


def test_the_claimed_bound_is_kept() -> None:
    assert accepted(near(ABEAM, 1_500.0, bounds=[1_499.999]))
    assert "intruder 0" in refusal(near(ABEAM, 1_500.0, bounds=[1_500.001]))


@pytest.mark.parametrize("age", [5.0, -5.0])
def test_what_is_required_grows_with_the_uncertainty(age: float) -> None:
    def deviation(time: float) -> float:
        return math.hypot(10.0, 2.0 * (abs(age) + time))

    sigmas = {"requirement": {"separation": 1_000.0, "margin": 20.0, "sigmas": 2.0}}
    last, before = (FULL + 2.0 * deviation(time) for time in (40.0, 38.0))
    row = intruder(END, 0.0, age=age, position_std=10.0, velocity_std=2.0)
    for more, passes in ((-0.000_9, True), (-0.001_2, False), (before - last + 0.1, False)):
        row[1] = last + more
        # The distance is least at the end; in one part the requirement is that of its end.
        for parts in (1, 1024):
            assert accepted(straight(intruders=[row], parts=parts, **sigmas)) == passes


def test_a_plan_that_begins_inside_the_margin_keeps_its_distance() -> None:
    alongside = near(0.0, 1_010.0, 0.0, 80.0)
    assert accepted(alongside)
    assert refusal(edited(alongside, ("intruders", 0, 2), -1e-4))
    assert refusal(near(0.0, 990.0, 0.0, 80.0))
    # Its distance at the request says nothing after a time in which the intruder does not count.
    heights = [0.0, 0.0, 700.0, -1.0, 0.0, 600.0]
    levels = {"levels": [0.0, 0.0, 0.0, 0.0]}
    for times, passes in (
        ((0.0, 10.0), False),
        ((0.0, 0.0), True),
        ((20.0, 30.0), False),
        ((20.0, 39.9), False),
        ((20.0, 40.1), True),
    ):
        apart = [[0, *times, *heights]]
        assert accepted(alongside | levels | {"apart": apart}) == passes
    assert accepted(near(0.0, 1_021.0, 0.0, 80.0, apart=[[0, 0.0, 10.0, *heights]], **levels))


def above(*times: tuple[float, float], y: float = 500.0, **changes: Any) -> dict[str, Any]:
    """Return a certificate with an intruder abeam that stays above in some times."""
    heights = [0.0, 0.0, 700.0, 0.0, 0.0, 600.0]
    apart = [[0, *time, *heights] for time in times]
    return near(ABEAM, y, levels=[0.0] * 4, apart=apart, **changes)


def test_an_intruder_above_or_below_counts_in_all_other_times() -> None:
    # It is nearer than 1020 m from 8.886 s to 31.114 s.
    assert accepted(above((8.88, 31.12)))
    assert refusal(above((8.89, 31.12)))
    assert refusal(above((8.88, 31.11)))
    assert accepted(above((8.0, 20.0), (19.0, 32.0)))
    assert refusal(above((8.0, 18.0), (22.0, 32.0)))
    alongside = above((0.0, 41.0), intruders=[intruder(0.0, 500.0, 0.0, 80.0)])
    assert accepted(alongside) and accepted(alongside | {"bounds": [0.0]})


def test_an_intruder_without_a_bound_never_counts() -> None:
    for times in ((), ((0.0, 39.0),), ((1.0, 40.0),), ((0.0, 10.0), (20.0, 40.0))):
        assert "never does" in refusal(above(*times, y=5e4, bounds=[0.0]))
    assert accepted(above((20.0, 40.0), (0.0, 20.0), y=5e4, bounds=[0.0]))
    assert covered([(0.0, 9.0), (1.0, 2.0)], 9.0)


@pytest.mark.parametrize("crossing_time", [20.5, 21.5])
@pytest.mark.parametrize("parts", [1, 32])
def test_a_fast_crossing_is_seen_in_each_half_of_an_arc(crossing_time: float, parts: int) -> None:
    x, y = 80.0 * crossing_time, -300.0 * crossing_time
    assert "intruder 0" in refusal(near(x, y, 0.5 * math.pi, 300.0, parts=parts))
    assert accepted(near(x - 2_000.0, y - 2_000.0, 0.5 * math.pi, 300.0))


def test_head_on_intruders_are_not_left_out() -> None:
    assert refusal(near(END, 0.0))
    assert refusal(near(4_000.0, 0.0, math.pi, 80.0))
    assert refusal(near(9_000.0, 0.0, math.pi, 200.0))
    assert refusal(near(-3_000.0, 0.0, 0.0, 160.0))


@pytest.mark.parametrize(("parts", "passes"), [(1, False), (2, False), (4, True)])
def test_parts_are_cut_as_finely_as_the_certificate_says(parts: int, passes: bool) -> None:
    # Its arcs of 2 s at 0.4 m/s^2 leave their chords by 0.2 m.
    data = flight((0.0, 0.4), intruders=[intruder(800.0, FULL + 0.03)], parts=parts)
    assert accepted(data) == passes


def test_both_accelerations_bend_the_relative_motion() -> None:
    ours = flight((0.0, 0.4), parts=1)
    for more, passes in ((0.18, False), (0.21, True)):
        row = intruder(800.0, FULL + more)
        assert accepted(ours | {"intruders": [row], "bounds": [1.0]}) == passes
    # After 19 s it is abeam, as fast, and bends away: 4 m/s^2 on a circle of 1600 m.
    for more, passes in ((0.01, True), (-1.0, False)):
        turned, y = 0.05 * 19.0, FULL + more
        x = 80.0 * 19.0 - 1_600.0 * math.sin(turned)
        row = intruder(x, y + 1_600.0 * (1.0 - math.cos(turned)), -turned, 80.0, 0.0, 0.05, 40.0)
        assert accepted(straight(intruders=[row], parts=1)) == passes


def test_intruders_turn_then_fly_on() -> None:
    for age, lasts, rate in (
        (3.0, 20.0, 0.05),
        (3.0, 5.0, -0.1),
        (-5.0, 0.0, 0.1),
        (0.0, 9.0, 0.0),
    ):
        report = Report(10.0, 20.0, 0.5, 60.0, age, rate, lasts, 0.0, 0.0, 1.0)
        track = track_of(report, Wind(0.0, 0.0, 0.0))
        for time in (0.0, 1.0, 30.0):
            steps = 20_000
            seconds = (np.arange(steps) + 0.5) * (time + age) / steps
            turned = rate * np.minimum(seconds, lasts) * (lasts > 0.0)
            flown = 60.0 * (time + age) * np.mean(np.exp(1j * (0.5 + turned)))
            place = track.position_at(ball(time))
            assert complex(to_float(place.x), to_float(place.y)) == pytest.approx(
                10.0 + 20.0j + flown, abs=1e-4
            )
        turns = 60.0 * abs(rate) if lasts > max(age, 0.0) else 0.0
        assert to_float(track.acceleration().x) == pytest.approx(turns)


def test_a_turning_intruders_place_holds_for_all_times_of_a_ball() -> None:
    track = track_of(Report(0.0, 0.0, 0.5, 60.0, 0.0, 0.05, 20.0, 0.0, 0.0, 1.0), Wind(0, 0, 0))
    wide = Ball(ball(10.0).x, 0, UNIT)
    for time in (9.0, 10.0, 11.0):
        off = track.position_at(wide) - track.position_at(ball(time))
        assert off.magnitude().lo <= 0


def test_a_report_is_as_old_as_it_says_in_a_wind_too() -> None:
    wind = Wind(10.0, -5.0, 0.5)
    report = Report(100.0, 200.0, 0.0, 60.0, 4.0, 0.0, 0.0, 3.0, 1.0, 1.0)
    place = track_of(report, wind).position_at(ball(6.0))
    # After ten seconds at 60 m/s over the ground; the air has gone with the wind for six.
    assert to_float(place.x) == pytest.approx(100.0 + 600.0 - 60.0)
    assert to_float(place.y) == pytest.approx(200.0 + 30.0)
    for rate, lasts, expected in ((0.0, 0.0, 1.0), (-0.1, 10.0, 1.5), (0.1, 90.0, 2.0)):
        turning = track_of(report._replace(turn_rate=rate, turn_time=lasts), wind)
        assert to_float(turning.velocity_std.x) == pytest.approx(expected)
    deviation = track_of(report, wind).uncertainty(ball(4.0))
    assert to_float(deviation.x) == pytest.approx(5.0)


# Arcs that are left out (theorem left_out_soundly): the work tells which are looked at.


def bend_of(intruders_acceleration: float) -> float:
    """Return the sagitta of an arc of 2 s, m."""
    return 0.5 * intruders_acceleration


@pytest.mark.parametrize(("speed", "rate"), [(0.0, 0.0), (50.0, 0.0), (50.0, 0.05)])
def test_an_intruder_out_of_reach_is_left_out(speed: float, rate: float) -> None:
    # The first leg's speed grows to 88 m/s.
    legs = (0.0, 0.4), (0.0, 0.0)
    own = fly(read(flight(*legs)))
    steps = [2.0 * to_float(arc.top_speed.x) for arc in own.arcs]

    def data(x: float) -> dict[str, Any]:
        row = intruder(x, 0.0, 0.0, speed, turn_rate=rate, turn_time=99.0 * (rate > 0.0))
        return flight(*legs, intruders=[row], bounds=[1.0])

    def work(x: float) -> int:
        return work_of(data(x)) - 2 * 50 - 1

    reach = FULL - 0.001_002 + sum(steps) + 40.0 * speed + bend_of(speed * rate)
    own_bends = [0.2] * 10 + [1e-12] * 10
    whole = threshold(lambda x: work(x) == 0, reach + 0.1, reach + 900.0)
    joints = 20 * 0.001_001
    assert whole == pytest.approx(reach + joints + sum(own_bends), abs=2e-3)
    # The walk costs 20; it looks at the last arc if that is in reach.
    last = threshold(lambda x: work(x) <= 20, reach + 0.01, whole - 1e-3)
    assert last == pytest.approx(reach + joints - 0.001_001 + max(own_bends), abs=2e-3)


def test_work_is_bounded() -> None:
    far = straight(intruders=[intruder(1e6, 0.0)], levels=[0.0] * 4)
    assert work_of(far) == 2 * 50 + 1
    heights = [0.0, 0.0, 700.0, 0.0, 0.0, 600.0]
    assert work_of(far | {"excluded": [heights] * 3, "apart": [[0, 1.0, 2.0, *heights]]}) == 105
    accept(far, Work(101))
    with pytest.raises(RefusedError, match="takes more than 100 parts of arcs"):
        accept(far, Work(100))
    assert Work().remaining == 300_000


# Clearances: 120 m to be kept from an area.


def beside(shape: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Return a certificate with one area, finely cut."""
    return straight(**{"areas": [area(**shape)], "parts": 1024} | changes)


def circle(x: float, y: float, radius: float, **fields: Any) -> dict[str, Any]:
    return {"circle": [x, y, radius]} | fields


def polygon(*rings: list[list[float]], **fields: Any) -> dict[str, Any]:
    return {"rings": list(rings)} | fields


WINDS = [{}, {"wind": {"east": 10.0, "north": 5.0, "std": 0.0}}]


@pytest.mark.parametrize("wind", WINDS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_clearance_is_kept_to_a_millimetre_of_the_margin(
    side: float, wind: dict[str, Any]
) -> None:
    for less, passes in ((0.000_9, True), (0.001_2, False), (0.001_8, False)):
        y = 120.0 - less
        assert accepted(beside(circle(ABEAM, side * (500.0 + y), 500.0), **wind)) == passes
        low, high = sorted([side * y, side * 900.0])
        for ring in (box(1_000.0, low, 2_200.0, high), box(1_000.0, low, 2_200.0, high)[::-1]):
            assert accepted(beside(polygon(ring), **wind)) == passes
        corner = [[ABEAM, side * y], [ABEAM + 400.0, side * 900.0], [ABEAM - 300.0, side * 900.0]]
        assert accepted(beside(polygon(corner), **wind)) == passes
    assert "area 0 may not be kept clear of before" in refusal(beside(circle(ABEAM, 0.0, 500.0)))


def test_the_edge_itself_is_kept_to_three_micrometres() -> None:
    bare = {"requirement": {"separation": 1_000.0, "margin": 0.0, "sigmas": 0.0}}
    assert accepted(beside(circle(ABEAM, 500.0 - 2e-6, 500.0, clearance=0.0), **bare))
    assert refusal(beside(circle(ABEAM, 500.0 - 1e-5, 500.0, clearance=0.0), **bare))


def test_a_plan_keeps_inside_what_is_to_be_kept_in() -> None:
    for more, passes in ((-0.000_9, True), (-0.002, False), (-9.0, False)):
        assert accepted(beside(circle(1_000.0, 0.0, 2_320.0 + more, keep="in"))) == passes
        ring = box(-2_000.0, -2_000.0, END + 120.0 + more, 2_000.0)
        assert accepted(beside(polygon(ring, keep="in"))) == passes
    # Farthest at the beginning, where it counts first.
    for radius, passes in ((1_561.0, True), (1_559.0, False), (1_530.0, False)):
        shape = circle(3_000.0, 0.0, radius, keep="in", valid=[19.5, None])
        assert accepted(beside(shape, parts=1)) == (radius > 1_560.0 + 120.0)
        wider = circle(3_000.0, 0.0, radius + 120.0, keep="in", valid=[19.5, None])
        assert accepted(beside(wider, parts=1)) == passes


def test_what_is_no_part_of_a_polygon_is_free() -> None:
    outer, hole = box(-9e3, -9e3, 9e3, 9e3), box(-500.0, -500.0, 4e3, 500.0)
    assert accepted(beside(polygon(outer, hole)))
    assert refusal(beside(polygon(outer)))
    assert refusal(beside(polygon(outer, hole, keep="in")))
    assert accepted(beside(polygon(outer, keep="in")))
    assert refusal(beside(polygon(box(5e3, 5e3, 6e3, 6e3), keep="in")))
    bare = {"requirement": {"separation": 1_000.0, "margin": 0.0, "sigmas": 0.0}}
    assert refusal(beside(polygon(outer, clearance=0.0), **bare))
    assert refusal(beside(circle(0.0, 0.0, 9e3, clearance=0.0), **bare))
    slanted = [[-9e3, -8e3], [9e3, -9e3], [8e3, 9e3], [-8e3, 7e3]]
    assert refusal(beside(polygon(slanted))) and refusal(beside(polygon(slanted[::-1])))


def test_a_bend_is_added_to_the_distance_from_an_area() -> None:
    ours = flight((0.0, 0.4))
    shapes = (
        lambda y: circle(800.0, 500.0 + y, 500.0),
        lambda y: polygon(box(400.0, y, 1_200.0, y + 500.0)),
        lambda y: polygon([[800.0, y], [900.0, y + 500.0], [700.0, y + 500.0]]),
        lambda y: circle(840.0, 0.0, 840.0 + y, keep="in", valid=[19.0, None]),
    )
    for shape in shapes:
        for more, parts, passes in ((0.18, 1, False), (0.22, 1, True), (0.18, 4, True)):
            data = ours | {"areas": [area(**shape(120.0 + more))], "parts": parts}
            assert accepted(data) == passes


def test_a_bend_is_added_to_the_depth_in_what_a_shrinking_area_has_left() -> None:
    # In its last arc, from 18 s on, it may be 50 m/s * 18 s - 120 m deep.
    for more, passes in ((0.1, False), (0.3, True)):
        ring = box(1_680.0 - 780.0 + more, -9e3, 2e4, 9e3)
        shape = area(rings=[ring], growth=-50.0, valid=[19.0, None])
        assert accepted(flight((0.0, 0.4), areas=[shape], parts=1)) == passes


@pytest.mark.parametrize("parts", [1, 1024])
def test_areas_move_and_grow(parts: int) -> None:
    # It is 1000 m ahead of the ownship after 40 s.
    for velocity, start in ((-50.0, END + 3_000.0), (20.0, END + 200.0)):
        for more, passes in ((0.5, True), (-0.5, False)):
            shape = circle(start + more + 120.0, 0.0, 1_000.0, velocity=[velocity, 0.0])
            wall = polygon(
                box(start - 1_000.0 + more + 120.0, -9e3, 9e3, 9e3), velocity=[velocity, 0.0]
            )
            assert accepted(beside(shape, parts=parts)) == passes
            assert accepted(beside(wall, parts=parts)) == passes
    for growth, room in ((5.0, 200.0), (-5.0, -200.0)):
        for more, passes in ((0.5, True), (-0.5, False)):
            y = 120.0 + room + more
            left = circle(END, 500.0 + y, 500.0, growth=growth)
            inside = circle(0.0, 0.0, END + 120.0 + more - room, keep="in", growth=growth)
            if growth > 0.0:
                assert accepted(beside(left, parts=parts)) == passes
            if growth < 0.0 or parts > 1:
                assert accepted(beside(inside, parts=parts)) == passes


def test_a_plan_may_fly_over_what_a_shrinking_area_has_left() -> None:
    # At its end it is 500 m deep in what the areas were at the request.
    for growth, passes in ((-15.6, True), (-15.4, False)):
        assert accepted(beside(circle(END, 0.0, 500.0, growth=growth))) == passes
        ring = box(END - 500.0, -2e3, 9e3, 2e3)
        assert accepted(beside(polygon(ring, growth=growth))) == passes
    # In one part it keeps what is required at its beginning, when the area is larger.
    for y, passes in ((31.0, True), (22.0, False)):
        shape = circle(80.0 * 19.0, 500.0 + y, 500.0, growth=-5.0, valid=[18.5, 19.5])
        assert accepted(beside(shape, parts=1)) == passes


@pytest.mark.parametrize(
    ("valid", "passes"),
    [
        ([None, None], False),
        ([None, 19.5], True),
        ([None, 19.7], False),
        ([19.8, None], False),
        ([20.0, None], True),
        ([0.0, 5.0], True),
        ([30.0, 40.0], True),
    ],
)
def test_an_area_counts_while_it_is_valid(valid: list[float | None], passes: bool) -> None:
    """The ownship is in it from 19.6 s to 19.9 s."""
    bare = {"requirement": {"separation": 1_000.0, "margin": 0.0, "sigmas": 0.0}}
    shape = circle(80.0 * 19.75, 0.0, 12.0, clearance=0.0, valid=valid)
    assert accepted(beside(shape, **bare)) == passes
    if not passes:
        assert refusal(beside(shape, **bare | {"parts": 1}))


@pytest.mark.parametrize(
    ("heights", "levels", "passes"),
    [
        ([None, None], [0.0, 0.0, 900.0, 0.0], False),
        ([1_000.0, None], None, False),
        ([1_000.0, None], [0.0, 0.0, 900.0, 0.0], True),
        ([1_000.0, None], [0.0, 0.0, 1_001.0, 0.0], False),
        ([1_000.0, None], [0.0, 0.0, 900.0, 6.0], False),  # 18.65 s to 20.85 s
        ([1_000.0, None], [0.0, 0.0, 900.0, 4.7], True),
        ([1_000.0, None], [0.0, -9.0, 1_090.0, -4.5], False),
        ([1_000.0, None], [0.0, -9.0, 1_070.0, -4.5], True),
        ([None, 1_000.0], [1_100.0, 0.0, 1_200.0, 0.0], True),
        ([None, 1_000.0], [999.0, 0.0, 1_200.0, 0.0], False),
        ([None, 1_000.0], [1_100.0, -6.0, 1_200.0, 0.0], False),
        ([None, 1_000.0], [1_100.0, -4.7, 1_200.0, 0.0], True),
        ([None, 1_000.0], [910.0, 4.5, 1_200.0, 5.0], False),
        ([None, 1_000.0], [930.0, 4.5, 1_200.0, 5.0], True),
    ],
)
def test_an_area_counts_at_its_heights(
    heights: list[float | None], levels: list[float] | None, passes: bool
) -> None:
    """The ownship is nearer to it than 120 m from 17.2 s to 22.8 s at most, in one part of 40 s or
    many.
    """
    shape = circle(ABEAM - 16.0, 0.0, 5.0, clearance=40.0, heights=heights)
    assert accepted(beside(shape, levels=levels)) == passes
    if levels is not None:
        inside = circle(0.0, 0.0, 100.0, keep="in", heights=heights, valid=[5.0, None])
        assert refusal(beside(inside, levels=levels))


@pytest.mark.parametrize(
    ("heights", "levels"),
    [([1_000.0, None], [0.0, 0.0, 900.0, 5.2]), ([None, 1_000.0], [1_100.0, -5.2, 2e3, 0.0])],
)
def test_an_area_counts_that_is_reached_within_an_arc(
    heights: list[float | None], levels: list[float]
) -> None:
    """Its height is reached after 19.23 s; the ownship is too near from 19.19 s to 19.81 s."""
    shape = circle(80.0 * 19.5, 0.0, 5.0, clearance=0.0, heights=heights)
    assert refusal(beside(shape, levels=levels))


def test_a_plan_that_begins_inside_a_clearance_comes_no_nearer() -> None:
    def wall(y: float, **fields: Any) -> dict[str, Any]:
        return beside(polygon(box(-2e4, y, 2e4, 9e3), **fields))

    assert accepted(wall(50.0))
    for nearer, passes in ((0.010_5, True), (0.012_5, False), (0.018, False), (40.0, False)):
        assert accepted(wall(50.0, velocity=[0.0, -nearer / 40.0])) == passes
        away = beside(circle(0.0, 550.0, 500.0, velocity=[80.0, -nearer / 40.0]))
        assert accepted(away) == passes
    # Not if it does not count then.
    assert refusal(wall(50.0, valid=[10.0, None]))
    assert accepted(wall(130.0, valid=[10.0, None]))
    # A plan that begins in the area itself is as if at its edge.
    assert refusal(wall(-10.0))
    assert accepted(wall(-10.0, velocity=[0.0, 1e3])) is False


def test_arcs_from_which_an_area_is_out_of_reach_are_left_out_and_no_others() -> None:
    def ahead(x: float, **fields: Any) -> dict[str, Any]:
        return beside(polygon(box(x, -9e3, 4e4, 9e3), **fields), parts=1)

    assert refusal(ahead(END + 119.0)) and accepted(ahead(END + 121.0))
    assert refusal(ahead(END + 119.0 + 2_000.0, velocity=[-50.0, 0.0]))
    assert refusal(ahead(260.0, valid=[0.0, 1.99]))
    assert accepted(ahead(260.0, valid=[0.0, 1.0]) | {"parts": 32})
    # 50 m a second nearer: 4 edges cost 16 at first, and 16 for an arc that is looked at.
    last = threshold(lambda x: work_of(ahead(x)) == 100 + 16 + 20, END + 119.999, END + 200.0)
    assert last == pytest.approx(END + 120.0 - 0.001_002 + 19 * 0.001_001, abs=2e-3)


def test_the_distance_at_an_arcs_end_is_what_the_next_one_begins_with() -> None:
    # Walls 300 m beside it, and one ahead that it is too near to at 5.99 s.
    ring = [*([-9e3, 300.0], [560.0, 300.0], [560.0, -300.0], [-9e3, -300.0]), [-9e3, -9e3]]
    ring += [[9e3, -9e3], [9e3, 9e3], [-9e3, 9e3]]
    assert refusal(beside(polygon(ring, valid=[None, 5.99]), parts=1))
    assert accepted(beside(polygon(ring, valid=[None, 5.4])))


def test_signed_distances_are_those_of_the_shape() -> None:
    square = read(beside(polygon(box(0.0, 0.0, 10.0, 10.0))))
    for keep, sign in (("out", 1.0), ("in", -1.0)):
        shape = in_air(square.areas[0]._replace(keep=keep), square)
        for (x, y), distance in (
            ((5.0, 13.0), 3.0),
            ((13.0, 14.0), 5.0),
            ((5.0, 9.0), -1.0),
            ((4.0, 5.0), -4.0),
            ((5.0, 5.5), -4.5),
        ):
            stated = to_float(shape.signed_distance(ball(x, y)))
            assert stated == pytest.approx(sign * distance, abs=1e-9)
    assert shape.position_in_area(ball(3.0), ZERO).x == ball(3.0).x


# Altitudes.


def test_an_intruder_stays_on_a_side_from_beginning_to_end() -> None:
    level, tiny = Heights(1_000.0, 0.0, 1_600.001, 0.0, 0.0, 600.0), 1e-3
    for changes, begin, end, side in (
        ({}, 0.0, 40.0, 1),
        ({"other": 1_600.0 - tiny}, 0.0, 40.0, 0),
        ({"other": 400.0 - tiny}, 0.0, 40.0, -1),
        ({"other": 400.0 + tiny}, 0.0, 40.0, 0),
        ({"other": 1_640.0 + tiny, "other_climb": -1.0}, 0.0, 40.0, 1),
        ({"other": 1_640.0 + tiny, "other_climb": -1.1}, 0.0, 40.0, 0),
        ({"other": 1_560.0 + tiny, "other_climb": 1.0}, 40.0, 50.0, 1),
        ({"other": 1_560.0 + tiny, "other_climb": 1.0}, 39.0, 50.0, 0),
        ({"other": 440.0 - tiny, "other_climb": -1.0}, 40.0, 50.0, -1),
        ({"other": 440.0 - tiny, "other_climb": -1.0}, 39.0, 50.0, 0),
        ({"other": 360.0 - tiny, "own_climb": -1.0}, 0.0, 40.0, -1),
        ({"other": 360.0 - tiny, "own_climb": -1.0}, 0.0, 40.1, 0),
        # What has climbed since its report.
        ({"other": 1_590.0 + tiny, "other_climb": 1.0, "age": 10.0}, 0.0, 9.0, 1),
        ({"other": 1_590.0 + tiny, "other_climb": 1.0, "age": 9.0}, 0.0, 9.0, 0),
    ):
        assert side_of(level._replace(**changes), begin, end) == side, changes


def both_sides() -> dict[str, Any]:
    """Return a certificate with intruders left out above and below, and one that climbs from below
    to above.
    """
    return straight(
        intruders=[intruder(5e4, 0.0, age=2.0)],
        levels=[990.0, -1.0, 1_010.0, 1.0],
        excluded=[
            [1_010.0, 1.0, 1_700.0, 1.0, 0.0, 600.0],
            [990.0, -1.0, 200.0, -1.0, 0.0, 600.0],
        ],
        apart=[
            [0, 0.0, 2.0, 990.0, -1.0, 110.0, 40.0, 2.0, 600.0],
            [0, 38.0, 40.0, 1_010.0, 1.0, 100.0, 39.0, 2.0, 600.0],
        ],
    )


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("levels",), None, "another altitude of the ownship"),
        (("levels", 0), 989.0, "excluded has another altitude of the ownship"),
        (("excluded", 0, 0), 1_009.0, "excluded has another altitude of the ownship"),
        (("excluded", 0, 1), 0.9, "excluded has another altitude of the ownship"),
        (("excluded", 0, 3), -2.0, "does not stay above or below"),
        (("excluded", 0, 2), 1_000.0, "does not stay above or below"),
        (("excluded", 1, 3), 6.0, "does not stay above or below"),
        (("apart", 0, 3), 991.0, "apart has another altitude of the ownship"),
        (("apart", 0, 2), 60.0, "intruder 0 does not stay above or below from 0.00 s on"),
        (("apart", 1, 6), 20.0, "intruder 0 does not stay above or below from 38.00 s on"),
        (("apart", 0, 7), 3.0, "the age of intruder 0"),
        (("apart", 0, 5), 1.0e3, "does not stay above or below"),
        (("apart", 1, 8), 601.0, "more than one altitude"),
    ],
)
def test_altitudes_that_do_not_fit_are_refused(
    path: tuple[Any, ...], value: float | None, message: str
) -> None:
    assert accepted(both_sides())
    assert message in refusal(edited(both_sides(), path, value))


def test_an_intruder_below_and_above_has_one_altitude() -> None:
    assert accepted(both_sides())
    for field, change in ((5, 20.0), (6, 2.0)):
        data = both_sides()
        data["apart"][1][field] += change
        assert "more than one altitude" in refusal(data)
    twice = both_sides()
    twice["apart"].append([*twice["apart"][0]])
    assert accepted(twice)
    twice["apart"][2][5] -= 1.0
    assert "more than one altitude" in refusal(twice)
