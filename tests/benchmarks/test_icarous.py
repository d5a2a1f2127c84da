"""The comparison with ICAROUS draws missions that can stand, judges both sides by geometry alone,
and says where ICAROUS is missing.
"""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from agents.policy.inference import Policy
from benchmarks.icarous import ours, peer
from benchmarks.icarous.judge import DEPTH, MissionOutcome, Track, distances, judge
from benchmarks.icarous.missions import (
    CRUISE,
    MOST_FENCES,
    MOST_INTRUDERS,
    STRONGEST,
    Mission,
    aircraft,
    mission,
    outline,
)
from benchmarks.icarous.run import complete, figures, main, table
from commands.command import InputError
from envs.areas import Area, Keep, Polygon
from envs.kinematics import VehicleState
from envs.wind import NO_WIND, Wind

AIRCRAFT = aircraft()
SEPARATION, RADIUS = AIRCRAFT.separation, AIRCRAFT.goal_radius
END = 4_000.0
BARE = Mission(0, ((0.0, 0.0), (END, 0.0)), NO_WIND, (), ())


def east(speed: float = 25.0, north: float = 0.0, step: float = 1.0, until: float = 200.0) -> Track:
    """Return a flight east, without intruders."""
    time = np.arange(0.0, until, step)
    none = np.zeros((time.size, 0))
    return Track(time, speed * time, np.full(time.size, north), none, none)


def square(x: float, y: float, half: float, keep: Keep = Keep.OUT) -> Area:
    ring = ((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half))
    return Area(Polygon(ring), keep=keep)


def outcome(fence: Area, track: Track) -> MissionOutcome:
    return judge(BARE._replace(fences=(fence,)), track, SEPARATION, RADIUS)


@given(
    st.tuples(*[st.floats(-2_000.0, 2_000.0)] * 2),
    st.floats(-math.pi, math.pi),
    st.floats(0.0, 50.0),
)
def test_the_least_distance_is_that_of_dense_samples(
    place: tuple[float, float], course: float, speed: float
) -> None:
    own = east(step=10.0)
    x = place[0] + speed * math.cos(course) * own.time
    y = place[1] + speed * math.sin(course) * own.time
    found = distances(own._replace(other_x=x[:, None], other_y=y[:, None]))
    dense = np.linspace(0.0, 1.0, 101)
    for n in range(own.time.size - 1):
        mixed = [(1.0 - dense) * f[n] + dense * f[n + 1] for f in (x - own.x, y - own.y)]
        away = np.hypot(*mixed)
        assert found[n, 0] <= away.min() + 1e-6
        assert found[n, 0] >= away.min() - 0.5 * 10.0 * (25.0 + speed) / 100.0


@given(st.floats(0.0, 2_000.0), st.floats(-1_000.0, 1_000.0))
def test_an_intruder_that_stands_is_lost_where_the_way_passes_too_near(
    ahead: float, aside: float
) -> None:
    own = east()
    other = np.full((own.time.size, 1), ahead), np.full((own.time.size, 1), aside)
    found = judge(BARE, own._replace(other_x=other[0], other_y=other[1]), SEPARATION, RADIUS)
    assert found.separation == pytest.approx(abs(aside), abs=1e-6)
    assert found.lost == (abs(aside) < 0.99 * SEPARATION)
    if found.lost:
        reach = math.sqrt((0.99 * SEPARATION) ** 2 - aside**2)
        assert found.lost_at == pytest.approx(max(ahead - reach, 0.0) / 25.0, abs=1.01)


@given(st.floats(-500.0, 500.0), st.floats(10.0, 400.0))
def test_a_fence_is_violated_where_the_way_crosses_it(aside: float, half: float) -> None:
    found = outcome(square(1_500.0, aside, half), east(step=20.0))
    inside = half - abs(aside)
    if abs(inside - DEPTH) > 0.01:
        assert found.breached == (inside > DEPTH)
    if found.breached:
        # The sample before the edge.
        assert (
            found.breached_at * 25.0 <= 1_500.0 - half + DEPTH <= (found.breached_at + 20.0) * 25.0
        )


@given(st.floats(0.0, 1_000.0), st.floats(100.0, 900.0))
def test_a_fence_to_be_kept_in_is_violated_where_the_way_leaves_it(
    north: float, half: float
) -> None:
    found = outcome(square(2_000.0, 0.0, 2_000.0 + half, Keep.IN), east(north=north, until=140.0))
    assert found.breached == 0
    shifted = outcome(square(2_000.0, 0.0, half, Keep.IN), east(north=north))
    assert shifted.breached == 1 and shifted.breached_at == 0.0


def test_what_comes_after_the_arrival_does_not_count() -> None:
    found = outcome(square(END + 500.0, 0.0, 300.0), east())
    assert found.solved and found.breached == 0
    assert found.arrived == pytest.approx((END - RADIUS) / 25.0, abs=1.0)
    assert found.path == pytest.approx(END - RADIUS, abs=26.0)
    assert found.excess == pytest.approx(0.0, abs=0.01)
    late = judge(BARE, east(until=100.0), SEPARATION, RADIUS)
    assert math.isnan(late.arrived) and not late.solved


def test_every_mission_can_stand() -> None:
    kinds: set[str] = set()
    for number in range(100):
        one = mission(5, number, SEPARATION)
        assert len(one.intruders) <= MOST_INTRUDERS and len(one.fences) <= MOST_FENCES
        assert one.wind.speed <= STRONGEST
        air = np.hypot(
            one.start.speed * np.cos(one.start.heading) - one.wind.east,
            one.start.speed * np.sin(one.start.heading) - one.wind.north,
        )
        assert air == pytest.approx(CRUISE)
        for other in one.intruders:
            assert math.hypot(other.x, other.y) >= 2.0 * SEPARATION
        for fence in one.fences:
            inner = outline(fence)
            kinds.add(fence.keep.value)
            for place in one.waypoints:
                inside = inner.contains(shapely.Point(place))
                assert inside == (fence.keep is Keep.IN)
                assert inner.boundary.distance(shapely.Point(place)) > fence.clearance
    assert kinds == {"in", "out"}


def test_a_mission_follows_from_seed_and_number() -> None:
    one = mission(3, 17, SEPARATION)
    assert one == mission(3, 17, SEPARATION)
    assert one != mission(4, 17, SEPARATION)._replace(number=17)


def test_intruders_of_both_sides_fly_the_same_ground() -> None:
    other = VehicleState(3_000.0, 500.0, 2.0, 30.0)
    one = BARE._replace(wind=Wind(6.0, -4.0), intruders=(other,))
    asked = peer.task(one, AIRCRAFT, "parameters.txt")
    reach, bearing, _, speed, heading = asked["intruders"][0]
    assert reach * math.sin(math.radians(bearing)) == pytest.approx(other.x)
    assert reach * math.cos(math.radians(bearing)) == pytest.approx(other.y)
    carried = asked["wind_from"] + 180.0
    east_ = [
        v * math.sin(math.radians(a)) for v, a in ((speed, heading), (one.wind.speed, carried))
    ]
    assert sum(east_) == pytest.approx(other.speed * math.cos(other.heading))


def test_parameters_replace_those_that_ship() -> None:
    shipped = "# a remark\nmin_hs = 0.2 [knot]\ndefault_det_1_WCV_TTHR = 5 [s]\nkept = 3\n"
    changes = peer.parameters(AIRCRAFT, peer.CHOSEN)
    lines = peer.configuration(shipped, changes).splitlines()
    assert "kept = 3" in lines and "min_hs = 18.0 [m/s]" in lines
    assert not any("WCV" in line or "#" in line for line in lines)


@pytest.mark.parametrize("named", [[], ["--icarous", "nowhere"]])
def test_a_missing_icarous_is_one_sentence(
    named: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(peer.VARIABLE, raising=False)
    sentence = r"^.*ICAROUS.*docs/reference/beside-others.md.*$"
    with pytest.raises(InputError, match=sentence):
        main(["--out", str(tmp_path), *named])


def row(number: int, side: str, *, solved: bool) -> dict[str, object]:
    given = dict.fromkeys(("lost", "breached", "intruders", "fences"), 0) | {"wind": 0.0}
    return given | {
        "number": number,
        "side": side,
        "arrived": 100.0 if solved else None,
        "excess": 0.1,
        "solved": solved,
        "promised": False,
        "slowest": 0.1,
        "ended": "",
    }


def test_only_missions_that_both_have_flown_count() -> None:
    rows = [row(0, "icarous", solved=False), row(0, "ours", solved=True)]
    rows += [row(1, "ours", solved=True), row(2, "icarous", solved=False)]
    rows += [row(2, "ours", solved=False)]
    sides = ("icarous", "ours")
    counted = complete(rows, sides)
    assert [one["number"] for one in counted] == [0, 0, 2, 2]
    by_kind = {(one["kind"], one["side"]): one for one in figures(counted, sides)}
    assert by_kind["all", "ours"]["solved"] == 1 and by_kind["all", "icarous"]["solved"] == 0
    assert by_kind["solved by any", "ours"]["missions"] == 1
    assert len(table(figures(counted, sides)).splitlines()) == 2 + len(by_kind)


def test_the_route_goes_over_the_waypoints_and_holds_at_the_last() -> None:
    one = mission(5, 3, SEPARATION)
    points = ours.route(one, 2.0 * SEPARATION, SEPARATION)
    places = [(point.x, point.y) for point in points]
    for waypoint in one.waypoints[1:]:
        assert min(math.dist(waypoint, place) for place in places) < 1e-6
    assert math.dist(places[-1], one.waypoints[-1]) < 1e-6
    assert max(math.dist(place, one.waypoints[-1]) for place in places[-6:]) <= 2.01 * SEPARATION


@pytest.mark.slow
def test_our_flights_stop_and_go_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for count in (1, 2):
        assert main(["--only", "ours", "--missions", str(count), "--out", str(tmp_path)]) == 0
        found = json.loads(capsys.readouterr().out.splitlines()[-1])
        assert found["missions"] == count
    lines = (tmp_path / "flights.jsonl").read_text().splitlines()
    assert [json.loads(line)["number"] for line in lines[1:]] == [0, 1]
    given = ours.rules(AIRCRAFT, Policy.load())
    flight = ours.fly(mission(0, 0, SEPARATION), given)
    judged = judge(mission(0, 0, SEPARATION), flight.track, SEPARATION, RADIUS)
    assert judged.solved and flight.promised.any()
    assert np.diff(flight.track.time).max() < 0.2


@pytest.mark.slow
@pytest.mark.skipif(
    peer.VARIABLE not in os.environ, reason=f"ICAROUS is not here; to have it: {peer.VARIABLE}=DIR"
)
def test_icarous_flies_a_mission_without_anything_in_its_way() -> None:
    flight = peer.fly(BARE, AIRCRAFT, peer.locate(None))
    judged = judge(BARE, flight.track, SEPARATION, RADIUS)
    assert judged.solved and judged.excess < 0.05 and not flight.ended
