"""Plans that climb and descend are flown within their limits, and others are above or below them,
in certificates whose altitudes are known exactly: from 1000 m, 80 m/s towards the east.

Altitudes of :data:`UP`: the climb changes to 5 m/s at 2.5 s, to 0 at 20 s, and to -4 m/s at 40 s.
The ownship is within 15 m of them.
"""

import math
from typing import Any

import pytest

from agents.check.altitude import lines_between, own_lines
from agents.check.balls import ball, to_float
from agents.check.profile import first_change
from agents.check.reading import read
from agents.check.separation import joined
from tests.agents.check.certificates import (
    accepted,
    area,
    box,
    climbing,
    edited,
    flight,
    intruder,
    refusal,
    work_of,
)

UP = 1_087.5, 1_087.5, 1_007.5
DOWN = 912.5, 912.5, 992.5  # the same downwards
SPREAD = 15.0  # margin and error
LIMITS = {"acceleration_max": 0.5, "acceleration_min": -0.8, "yaw_rate_max": 0.08}


def test_lines_of_a_profile() -> None:
    lines = own_lines(read(climbing(*UP)))
    for time, low in (
        (0.0, 985.0),
        (2.0, 985.0),
        (10.0, 1_022.5),
        (30.0, 1_072.5),
        (55.0, 1_012.5),
    ):
        ((line, (begin, end)),) = lines_between(lines, ball(time), ball(time))
        assert to_float(begin.x) == to_float(end.x) == time
        assert to_float(line.nearest(-1, begin).x) == pytest.approx(low, abs=1e-9)
        assert to_float(line.nearest(1, begin).x) == pytest.approx(low + 30.0, abs=1e-9)
    times = [ends for _, ends in lines_between(lines, ball(-1.0), ball(99.0))]
    assert [to_float(end.x) for _, end in times] == pytest.approx([2.5, 20.0, 40.0, 99.0])
    assert to_float(times[0][0].x) == -1.0
    # The climb at the request goes on before the first corner.
    line = own_lines(read(climbing(*UP, profile={"climb": -1.0})))[0]
    assert to_float(line.low_climb.x) == -1.0 and 0.0 < to_float(line.end.x) < 20.0


@pytest.mark.parametrize("climb", [-3.0, 0.0, 2.0])
@pytest.mark.parametrize("rise", [-60.0, 0.0, 60.0])
def test_the_first_change_of_climb_reaches_the_first_altitude(rise: float, climb: float) -> None:
    change = to_float(first_change(ball(rise), ball(climb), ball(20.0), ball(0.8)).x)
    corner = 0.5 * abs(change) / 0.8
    assert climb * 20.0 + change * (20.0 - corner) == pytest.approx(rise, abs=1e-9)
    assert corner <= 10.0


def test_an_altitude_out_of_reach_is_refused() -> None:
    wide = {"climb_max": 99.0, "margin": 99.0}
    # 200 m take all of 20 s at 1 m/s^2.
    assert accepted(climbing(1_199.9, 1_590.9, profile=wide))
    assert "cannot be reached" in refusal(climbing(1_200.1, 1_600.0, profile=wide))
    assert "cannot be reached" in refusal(climbing(799.9, 400.0, profile=wide))


@pytest.mark.parametrize(
    ("altitudes", "field", "least", "message"),
    [
        (UP, "climb_max", 5.0, "faster than its limits"),
        (UP, "descent_max", 4.0, "faster than its limits"),
        (DOWN, "climb_max", 4.0, "faster than its limits"),
        (DOWN, "descent_max", 5.0, "faster than its limits"),
        (UP, "margin", 3.125, "by more than its margin"),
        (DOWN, "margin", 3.125, "by more than its margin"),
    ],
)
def test_climbs_keep_limits_and_margin(
    altitudes: tuple[float, ...], field: str, least: float, message: str
) -> None:
    assert accepted(climbing(*altitudes, profile={field: least - 1e-6}))
    assert message in refusal(climbing(*altitudes, profile={field: least - 5e-6}))


def test_the_climb_at_the_request_is_what_it_is() -> None:
    """As in a gust: it changes from then on."""
    fast = {"climb": -5.0, "descent_max": 4.9, "acceleration": 4.0}
    assert accepted(climbing(1_000.0, 1_000.0, profile=fast))
    # The line that it changes to regains in 20 s what is lost until the first corner.
    assert "faster than" in refusal(climbing(1_000.0, 1_000.0, profile=fast | {"climb_max": 0.1}))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("first", [0.0, 30.0])
def test_changes_of_climb_do_not_overlap(first: float, side: float) -> None:
    """Of two changes with 0.2 m/s^2, 20 s apart by 8 m/s together; the first, 2 m/s at 5 s, has
    ended after 10 s.
    """
    for more, passes in ((2e-7, True), (2e-6, False)):
        if first:
            climbs = [2.0 - side * (4.0 + more)]
        else:
            climbs = [5.0 * side, 5.0 * side - side * (3.0 + more)]
        altitudes = [1_000.0 + first]
        for climb in climbs:
            altitudes.append(altitudes[-1] + 20.0 * climb)
        limits = {"acceleration": 0.2, "margin": 20.0}
        if passes:
            assert accepted(climbing(*altitudes, profile=limits))
        else:
            assert "too near to each other" in refusal(climbing(*altitudes, profile=limits))


def test_a_waypoint_where_the_climb_stays_is_no_corner() -> None:
    """A change of 5 m/s with 0.1 m/s^2 takes from 25 s before its corner, at 40 s, to 25 s after
    it.
    """
    slow = {"acceleration": 0.1, "margin": 40.0}
    heights = 1_000.0, 1_000.0, 1_100.0, 1_200.0
    assert accepted(climbing(*heights, profile=slow))
    assert accepted(climbing(*heights[:3], 1_200.000_000_01, profile=slow))
    assert refusal(climbing(*heights[:3], 1_200.000_001, profile=slow))


@pytest.mark.parametrize(
    ("altitudes", "name", "side"), [(UP, "ceiling", 1.0), (DOWN, "floor", -1.0)]
)
def test_floor_and_ceiling_are_kept_with_margin_and_error(
    altitudes: tuple[float, ...], name: str, side: float
) -> None:
    farthest = 1_000.0 + side * (87.5 + SPREAD)
    for less, passes in ((1e-6, True), (5e-6, False), (10.0, False)):
        data = climbing(*altitudes, profile={name: farthest - side * less})
        assert accepted(data) if passes else f"does not keep its {name}" in refusal(data)
    assert refusal(climbing(*altitudes[:1], profile={name: farthest - side}))


@pytest.mark.parametrize(("name", "side"), [("ceiling", 1.0), ("floor", -1.0)])
def test_what_begins_near_a_floor_or_a_ceiling_does_not_go_farther(name: str, side: float) -> None:
    def towards(climb: float, *more: float, level: float = 5.0) -> dict[str, Any]:
        altitudes = [1_000.0 + side * height for height in more]
        profile = {name: 1_000.0 + side * level, "climb": side * climb}
        return climbing(*altitudes, profile=profile)

    assert accepted(towards(0.0, 0.0, 0.0)) and accepted(towards(0.0, 0.0, -50.0))
    assert accepted(towards(-1.0, -50.0, 0.0))
    assert refusal(towards(0.0, -20.0, 1.0))
    assert refusal(towards(1.0, 0.0, 0.0))  # it goes on with its climb at first
    assert accepted(towards(1.0, 0.0, 0.0, level=25.0))


def test_an_area_to_be_kept_in_has_the_levels_of_the_profile() -> None:
    def within(*heights: float | None, **profile: float) -> dict[str, Any]:
        shape = area(circle=[0.0, 0.0, 9e3], keep="in", heights=list(heights))
        return climbing(*UP, profile=profile, areas=[shape])

    assert accepted(within(None, None)) and accepted(within(900.0, None, floor=900.0))
    assert accepted(within(900.0, 1_200.0, floor=901.0, ceiling=1_199.0))
    for heights, profile in (
        ((900.0, None), {}),
        ((900.0, None), {"floor": 899.0}),
        ((None, 1_200.0), {}),
        ((None, 1_200.0), {"ceiling": 1_201.0, "floor": 900.0}),
    ):
        assert "area 0 is to be kept in" in refusal(within(*heights, **profile))
    # Not one to be kept out of.
    away = area(circle=[0.0, 9e3, 1e3], heights=[900.0, 1_200.0])
    assert accepted(climbing(*UP, areas=[away]))


def test_the_speed_along_the_profile_keeps_the_limit() -> None:
    most = math.hypot(80.0, 5.0)

    def fast(speed_max: float, *altitudes: float, **fields: Any) -> dict[str, Any]:
        limits = {"speed_min": 31.0, "speed_max": speed_max} | LIMITS
        return climbing(*(altitudes or UP), limits=limits, **fields)

    assert accepted(fast(most - 1e-6))
    assert "speed along profile" in refusal(fast(most - 5e-6))
    assert refusal(fast(80.1)) and refusal(fast(80.1, *DOWN))
    # What begins as fast may stay so.
    begun = {"profile": {"climb": 5.0}}
    assert accepted(fast(80.1, 1_100.0, 1_200.0, 1_300.0, **begun))
    assert refusal(fast(80.1, 1_100.0, 1_200.0, 1_302.0, **begun))
    # From 80 to 84 m/s in the first leg, which climbs with 5 m/s at first, and then with 2 m/s.
    slower = climbing(1_044.5, 1_084.5, **begun)
    for speed_max, passes in ((84.15, True), (84.14, False)):
        faster = flight((0.0, 0.2), (0.0, 0.0), limits=fast(speed_max)["limits"])
        data = faster | {name: slower[name] for name in ("levels", "profile")}
        assert accepted(data) == passes
    # The wind may be off by two sigmas of 0.1 m/s.
    wind = {"east": 0.0, "north": 0.0, "std": 0.1}
    twice = {"separation": 1_000.0, "margin": 20.0, "sigmas": 2.0}
    for more, passes in ((1e-5, True), (-1e-4, False)):
        assert accepted(fast(most + 0.2 + more, wind=wind, requirement=twice)) == passes


# Others above and below.

ABOVE = 2_000.0
TIMES = (0.0, 2.5), (2.5, 20.0), (20.0, 40.0), (40.0, 60.0)
HIGH = (1_000.0, 0.0), (987.5, 5.0), (1_087.5, 0.0), (1_247.5, -4.0)  # as of the request


def rows(*numbers: int, side: float = 1.0, other: float = ABOVE) -> list[list[float]]:
    """Return what an intruder is apart in, on some lines of :data:`UP`."""
    return [
        [0, *TIMES[n], HIGH[n][0] + side * SPREAD, HIGH[n][1], other, 0.0, 0.0, 600.0]
        for n in numbers
    ]


def passed(*numbers: int, **fields: Any) -> dict[str, Any]:
    """Return a certificate with an intruder that is too near from 8.89 s to 31.11 s."""
    apart = rows(*numbers, **fields)
    return climbing(*UP, intruders=[intruder(1_600.0, 500.0)], apart=apart, parts=1024)


def test_an_intruder_counts_in_no_line_on_which_it_is_above() -> None:
    assert accepted(passed(1, 2)) and accepted(passed(2, 1, 0, 3))
    assert refusal(passed(1)) and refusal(passed(2)) and refusal(passed())
    assert accepted(passed(1, 2, side=-1.0, other=300.0))
    never = {"bounds": [0.0]}
    assert accepted(passed(0, 1, 2, 3) | never)
    assert "never does" in refusal(passed(0, 1, 2) | never)
    # Rows that meet are one time: arcs of 2 s lie across the first corner.
    near = passed(0, 1) | {"intruders": [intruder(200.0, 1_005.0)], "parts": 1}
    assert accepted(near)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_intruder_is_apart_from_the_profile_itself(side: float) -> None:
    highest = 1_087.5 if side > 0 else 1_000.0
    lines = (1, 2) if side > 0 else (0, 1, 2)
    least = highest + side * (SPREAD + 600.0)

    def of(altitude: float, stated: float) -> str:
        data = passed(*lines, side=side, other=altitude)
        for row in data["apart"]:
            row[3] += stated
        return refusal(data)

    assert not of(least + side * 1e-9, 0.0)
    assert "does not stay" in of(least - side * 1e-9, 0.0)
    # The ownship is not as stated, by less than what is told apart.
    assert "does not stay" in of(least - side * 5e-7, -side * 1e-6)
    assert not of(least + side, -side * 1e-6) and not of(least + side, side * 1e-6)
    for stated in (-5e-6, 5e-6, 1.0, -1.0):
        assert "another altitude of the ownship" in of(least + 2.0 * side, stated)


@pytest.mark.parametrize(
    ("field", "value"),
    [(1, 2.4), (1, -1.0), (2, 20.1), (2, 41.0), (4, 5.001), (4, 0.0)],
)
def test_a_row_is_of_one_line(field: int, value: float) -> None:
    data = passed(1, 2)
    data["apart"][0][field] = value
    assert "apart has another altitude of the ownship" in refusal(data)


def test_a_row_whose_ends_alone_are_on_the_profile_is_refused() -> None:
    """From 1002.5 m at 0 s to as much at 61.25 s, with a hump between."""
    data = passed(1, 2)
    data["apart"] = [[0, 3.0, 57.5, 1_017.5, 0.0, ABOVE, 0.0, 0.0, 600.0]]
    assert "apart has another altitude of the ownship" in refusal(data)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("profile", "altitudes", 0), 1_087.6),
        (("profile", "altitudes", 1), 1_087.6),
        (("profile", "climb"), 0.1),
        (("profile", "acceleration"), 1.1),
        (("profile", "margin"), 5.1),
        (("profile", "margin"), 4.9),
        (("levels", 0), 989.9),
        (("levels", 2), 1_010.1),
        (("levels", 1), -0.1),
        (("profile",), None),
        (("levels",), None),
        (("apart", 0, 7), 1.0),
        (("apart", 1, 5), 2_001.0),
        (("apart", 1, 6), 0.1),
        (("apart", 1, 8), 601.0),
    ],
)
def test_what_contradicts_the_profile_is_refused(path: tuple[Any, ...], value: Any) -> None:
    assert refusal(edited(passed(1, 2), path, value))


def test_nobody_is_left_out_of_account_on_one_line_of_several() -> None:
    for heights in ([1_102.5, 0.0, ABOVE, 0.0, 0.0, 600.0], [1_002.5, 5.0, 9e3, 0.0, 0.0, 600.0]):
        assert "excluded has another altitude" in refusal(climbing(*UP, excluded=[heights]))
    level = [1_015.0, 0.0, ABOVE, 0.0, 0.0, 600.0]
    assert accepted(climbing(1_000.0, 1_000.0, excluded=[level]))


def test_each_line_of_a_row_is_work() -> None:
    """From the request on a straight profile has two lines, and one for each leg after the first."""
    level = [1_015.0, 0.0, ABOVE, 0.0, 0.0, 600.0]
    heights = [1_000.0] * 8
    without, *with_rows = (work_of(climbing(*heights, excluded=[level] * n)) for n in (0, 1, 3))
    assert [work - without for work in with_rows] == [9, 27]
    far, last = [intruder(9e4, 0.0)], work_of(climbing(*heights, intruders=[intruder(9e4, 0.0)]))
    for begin, end, lines in ((0.0, 161.0, 9), (30.0, 50.0, 2), (150.0, 161.0, 1)):
        row = [0, begin, end, *level]
        assert work_of(climbing(*heights, intruders=far, apart=[row])) == last + lines


def test_times_are_joined_where_they_meet() -> None:
    assert joined([(5.0, 6.0), (0.0, 2.0), (2.0, 3.0), (1.0, 2.5)]) == [(0.0, 3.0), (5.0, 6.0)]
    assert joined([(0.0, 9.0), (1.0, 2.0)]) == [(0.0, 9.0)]
    assert joined([(1.0, 1.0)]) == [] and joined([(1.0, 1.0), (1.0, 2.0)]) == [(1.0, 2.0)]


# Areas.


def over(heights: list[float | None], x: float, **fields: Any) -> dict[str, Any]:
    """Return a certificate with an area of 5 m radius on the way, 120 m to be kept."""
    altitudes, profile = fields.pop("altitudes", UP), fields.pop("profile", None)
    shape = area(circle=[x, 0.0, 5.0], heights=heights, clearance=0.0)
    bare = {"requirement": {"separation": 1_000.0, "margin": 20.0, "sigmas": 0.0}}
    return climbing(*altitudes, profile=profile, areas=[shape], **bare | {"parts": 1024} | fields)


@pytest.mark.parametrize(
    ("heights", "x", "passes"),
    [
        # From 10.688 s to 11.313 s it is at 1025.9 to 1059.1 m, from 35 s on at 1072.5 to 1102.5 m.
        ([1_059.2, None], 880.0, True),
        ([1_058.9, None], 880.0, False),
        ([None, 1_025.8], 880.0, True),
        ([None, 1_026.1], 880.0, False),
        ([1_102.6, None], 2_800.0, True),
        ([1_102.4, None], 2_800.0, False),
        ([None, 1_072.4], 2_800.0, True),
        ([None, 1_072.6], 2_800.0, False),
        ([900.0, 1_025.8], 880.0, True),
        ([1_059.2, 1_300.0], 880.0, True),
        ([None, None], 880.0, False),
    ],
)
def test_an_area_counts_at_the_heights_of_the_profile(
    heights: list[float | None], x: float, passes: bool
) -> None:
    assert accepted(over(heights, x)) == passes


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_area_counts_at_a_corner_within_an_arc(side: float) -> None:
    """The climb turns round at 2.5 s, 12.5 m above or below where it begins."""
    turn = {"climb": 5.0 * side, "acceleration": 2.0, "margin": 6.25}
    altitudes = 1_000.0 - 75.0 * side, 1_000.0 - 75.0 * side
    for beyond, passes in ((0.1, True), (-0.1, False)):
        level = 1_000.0 + side * (12.5 + 16.25 + beyond)
        heights = [level, None] if side > 0 else [None, level]
        fields = {"altitudes": altitudes, "profile": turn, "parts": 1}
        assert accepted(over(heights, 200.0, **fields)) == passes


def test_an_area_that_is_left_upwards_and_met_again_is_kept_clear_of_in_full() -> None:
    """It ends at 1040 m: the ownship is above it from 13.5 s to 48.1 s, or to the end."""
    wall = area(rings=[box(-2e4, 50.0, 2e4, 9e3)], heights=[None, 1_040.0])
    apart = area(rings=[box(-2e4, 121.0, 2e4, 9e3)], heights=[None, 1_040.0])
    assert accepted(climbing(*UP[:2], UP[1], areas=[wall]))
    assert refusal(climbing(*UP, areas=[wall]))
    assert accepted(climbing(*UP, areas=[apart]))
    assert accepted(climbing(*UP, areas=[wall | {"valid": [None, 47.0]}]))
    # Though it is far away where the ownship comes down to it.
    gap = [[2_000.0, 50.0], [2_000.0, 400.0], [4_300.0, 400.0], [4_300.0, 50.0]]
    ring = [[-2e4, 50.0], *gap, [2e4, 50.0], [2e4, 9e3], [-2e4, 9e3]]
    assert refusal(climbing(*UP, areas=[wall | {"rings": [ring]}]))
    assert accepted(climbing(*UP[:2], UP[1], areas=[wall | {"rings": [ring]}]))
    # It begins to count after 1.4 s, before the first corner.
    begun = {"climb": 5.0, "margin": 6.0}
    gap = [[-10.0, 50.0], [-10.0, 400.0], [500.0, 400.0], [500.0, 60.0]]
    ring = [[-2e4, 50.0], *gap, [2e4, 60.0], [2e4, 9e3], [-2e4, 9e3]]
    floor = area(rings=[ring], heights=[1_023.0, None])
    level = climbing(1_020.0, 1_020.0, profile=begun, areas=[floor])
    assert refusal(level)
    assert accepted(edited(level, ("areas", 0, "heights"), [1_015.0, None]))
    # As if the plan began elsewhere, if it does not count at the request.
    below = area(rings=[box(-2e4, 50.0, 2e4, 9e3)], heights=[1_040.0, None])
    assert refusal(climbing(*UP, areas=[below]))
    assert accepted(climbing(*UP, areas=[wall | {"heights": [None, None]}]))
