"""Encounters among random areas: plans keep out of them, and a flight that does not is counted."""

from typing import Any

import numpy as np
import pytest
import shapely

from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.areas import Area, Circle, Polygon
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.trees import take
from envs.wind import Wind
from eval.config import MonteCarloConfig
from eval.flights.among_areas import judge, outlines, with_breaches
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns, pick
from eval.flights.recorded import Recorded, fly_recorded
from eval.flights.simulate import ENDS, OUTCOMES
from eval.flights.trajectories import Trajectories
from eval.metrics.summary import headline, summarise
from eval.plots.flight_sheet import trajectory_sheet

COUNT = 6
SOURCE = scenario("circle", PAPER)


def pilot(
    mode: str = "plan", areas: int = 3, wind: tuple[float, float] = (0.0, 0.0)
) -> ReadyEvaluation:
    evaluation = Evaluation(None, SOURCE, None, 3, PAPER, mode, wind_mps=wind, areas=areas)
    return ReadyEvaluation(evaluation, Policy.load())


def dense_distance(flown: Recorded, row: int) -> float:
    """Return the smallest distance of a flight's recorded places from its areas, m, by shapely."""
    track, least = flown.track(row), np.inf
    for area in track.areas:
        for step, place in enumerate(track.own.T):
            (ring,) = outlines(area, step * PAPER.dt)
            shape = shapely.Polygon(ring)
            point = shapely.Point(place)
            away = shapely.distance(shape.exterior, point)
            least = min(least, -away if shape.contains(point) else away)
    return least


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "wind"),
    [
        ("plan", (0.0, 0.0)),
        ("plan", (10.0, 15.0)),
        ("assured", (5.0, 10.0)),
    ],
)
def test_safe_plans_keep_out_of_areas_over_the_ground(mode: str, wind: tuple[float, float]) -> None:
    flying = pilot(mode, wind=wind)
    table = columns(flying, 0, COUNT)
    safe = table["plan_status"] == "safe"
    assert safe.sum() >= COUNT - 2 and table["areas"].sum() >= COUNT
    assert (table["outcome"][safe] == "reached").sum() >= COUNT - 2
    if mode == "plan":
        clearances = table["min_area_clearance_m"][safe & (table["areas"] > 0)]
        assert clearances.min() > 0.0 and np.isnan(table["area_breach_s"][safe]).all()
    flown = fly_recorded(flying, [4, 1])
    for row, number in enumerate((4, 1)):
        assert ENDS[flown.flights.outcome[row]] == table["outcome"][number]
        clearance = max((area.clearance for area in flown.track(row).areas), default=0.0)
        distance = dense_distance(flown, row) - clearance
        # Circles are drawn as polygons, and places are those of whole steps.
        assert distance == pytest.approx(table["min_area_clearance_m"][number], abs=8.0)


def straight(*speeds: float) -> Trajectories[Air]:
    """Return straight flights to the east from the origin, of 100 s."""
    time = np.arange(101.0)[:, None]
    speed = np.broadcast_to(np.array(speeds), (101, len(speeds)))
    own: VehicleState[Air] = VehicleState(speed * time, 0.0 * speed, 0.0 * speed, speed)
    none: VehicleState[Air] = VehicleState(*np.zeros((4, 101, len(speeds), 0)))
    return Trajectories(own, none, np.zeros((100, len(speeds), 2)), np.full(speed[1:].shape, 2e3))


def test_a_breach_is_timed_and_ends_a_flight() -> None:
    areas = np.empty(3, dtype=object)
    wall = Polygon(((2_000.0, -500.0), (3_000.0, -500.0), (3_000.0, 500.0), (2_000.0, 500.0)))
    areas[:] = [
        (Area(wall, clearance=100.0),),
        (Area(Circle(4_000.0, 2_000.0, 500.0), velocity=(0.0, -20.0)),),
        (),
    ]
    judged = judge(straight(50.0, 50.0, 50.0), areas, None, 1.0)
    assert judged.breach[0] == pytest.approx((2_000.0 - 100.0) / 50.0, abs=0.01)
    assert judged.distance[0] == pytest.approx(-600.0, abs=1.0)  # in its middle
    # The disc has moved by 20 m/s when the aircraft passes.
    time = np.arange(0.0, 100.0, 0.01)
    away = np.hypot(4_000.0 - 50.0 * time, 2_000.0 - 20.0 * time) - 500.0
    assert judged.distance[1] == pytest.approx(away.min(), abs=0.5)
    assert judged.breach[1] == pytest.approx(time[np.argmax(away < 0.0)], abs=0.02)
    assert judged.distance[2] == np.inf and np.isnan(judged.breach[2])


def spike(depth: float) -> Polygon:
    """Return a triangle whose tip is so far, m, beyond the way of the flights to the east."""
    return Polygon(((2_000.5, -500.0), (2_004.5, -500.0), (2_002.5, depth)))


def test_a_breach_between_the_ends_of_arcs_is_one() -> None:
    areas = np.empty(2, dtype=object)
    areas[:] = [(Area(spike(50.0)),), (Area(spike(-0.5)),)]
    judged = judge(straight(50.0, 50.0), areas, None, 1.0)
    assert judged.breach[0] == pytest.approx(2_002.5 / 50.0, abs=0.04)
    assert -2.0 < judged.distance[0] < 0.0  # across the middle of it, between two places 5 m apart
    assert np.isnan(judged.breach[1])
    assert judged.distance[1] == pytest.approx(0.5, abs=0.01)


def test_an_area_counts_while_it_is_valid() -> None:
    valid = (30.0, 50.0), (-np.inf, 30.0), (35.015, 35.045), (200.0, 300.0)  # passed from 38 s on
    areas = np.empty(4, dtype=object)
    wall = Polygon(((1_900.0, -500.0), (3_000.0, -500.0), (3_000.0, 500.0), (1_900.0, 500.0)))
    areas[:] = [(Area(wall, valid_from=begin, valid_until=end),) for begin, end in valid]
    judged = judge(straight(50.0, 50.0, 50.0, 50.0), areas, None, 1.0)
    assert judged.breach[0] == pytest.approx(38.0, abs=0.01)
    assert np.isnan(judged.breach[1:]).all()
    assert judged.distance[1] == pytest.approx(400.0, abs=0.2)
    assert judged.distance[2] <= 1_900.0 - 50.0 * 35.045  # between two ends of arcs
    assert judged.distance[3] == np.inf


def test_a_flight_is_judged_in_its_wind() -> None:
    wind = Wind(np.array([10.0]), np.array([0.0]))
    areas = np.empty(1, dtype=object)
    wall = Polygon(((3_000.0, -500.0), (4_000.0, -500.0), (4_000.0, 500.0), (3_000.0, 500.0)))
    areas[0] = (Area(wall),)
    judged = judge(straight(50.0), areas, wind, 1.0)
    assert judged.breach[0] == pytest.approx(3_000.0 / 60.0, abs=0.01)


@pytest.mark.slow
def test_what_comes_first_is_the_outcome() -> None:
    flown = fly_recorded(pilot(areas=0), [0, 1, 2]).flights
    lost, late = OUTCOMES.index("violation"), np.array([50.0, 50.0, 50.0])
    flown = flown._replace(outcome=np.array([lost, lost, 0], np.int8), duration=late)
    areas = np.empty(3, dtype=object)
    areas[:] = [()] * 3
    among = judge(straight(50.0, 50.0, 50.0), areas, None, 1.0)
    among = among._replace(breach=np.array([20.0, 80.0, 30.0]))
    ended = with_breaches(flown, among, PAPER.rules())
    assert [ENDS[code] for code in ended.outcome] == ["breach", "violation", "breach"]
    assert ended.duration.tolist() == [20.0, 50.0, 30.0]
    assert (ended.score[[0, 2]] == PAPER.rules().reward_violation).all()


@pytest.mark.slow
def test_breaches_are_counted_and_drawn() -> None:
    flying = pilot()
    table = columns(flying, 0, 2)
    table["outcome"][0], table["plan_status"][0] = "breach", "safe"
    table["min_area_clearance_m"][0] = -25.0
    summary = summarise(table, 0.95, 100, 0)
    assert summary["breach_rate"]["count"] == summary["counts"]["breach"] == 1
    assert summary["safe_plans_in_areas"] == 1
    assert summary["min_area_clearance_m_quantiles"]["0"] == -25.0
    lines = {line.key: line for line in headline(summary, {})}
    assert lines["breach_rate"].counted.startswith("1 of 2")
    numbers = [0, 1]
    figure = trajectory_sheet(table, numbers, fly_recorded(flying, numbers), PAPER.rules())
    assert "geofence violation" in figure.axes[0].get_title()
    drawn = sum(len(axes.patches) for axes in figure.axes)
    assert drawn > 2 * 2  # goal and required separation, and areas beside them


def test_areas_follow_from_the_number_alone_and_are_none_where_none_are_asked_for() -> None:
    evaluation = pilot().evaluation
    starts = pick(evaluation, range(5))
    every = evaluation.areas_of(starts, np.arange(5))
    part = evaluation.areas_of(take(starts, np.array([3])), np.array([3]))
    assert every is not None and part is not None and part[0] == every[3]
    assert pilot(areas=0).evaluation.areas_of(starts, np.arange(5)) is None


@pytest.mark.parametrize("mode", ["policy", "plan"])
def test_areas_among_recorded_aircraft_are_refused(mode: Any) -> None:
    with pytest.raises(ValueError, match="areas is 2; expected 0 for tracks:"):
        MonteCarloConfig(mode=mode, areas=2, scenario=f"tracks:{__file__}")
