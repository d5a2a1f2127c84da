"""The sampling planner's flights are judged by what they are flown like, and not by itself."""

import importlib.util
import math
from typing import Any

import numpy as np
import pytest

from agents.planner import Options
from benchmarks import areas, sampling_planner
from benchmarks.areas import Planned, Sampled
from benchmarks.sampling_planner import Step, Task, fly, is_right
from commands.command import InputError
from envs.aircraft import PAPER
from envs.areas import Area, Circle
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint

OPTIONS = Options.for_aircraft(PAPER)
ROUTE = [RoutePoint(0, 10_000.0, 0.0), RoutePoint(1, 15_000.0, 0.0)]
TASK = Task(VehicleState(0.0, 0.0, 0.0, 80.0), [], ROUTE, [], OPTIONS)
STRAIGHT = [Step(0.0, 80.0, float(time)) for time in range(126)]
CROSSING = VehicleState(5_000.0, -5_000.0, 0.5 * math.pi, 80.0)


def test_a_flight_to_the_route_is_right() -> None:
    assert is_right(TASK, STRAIGHT)


@pytest.mark.parametrize(
    ("task", "steps"),
    [
        (TASK, STRAIGHT[:100]),  # it does not arrive
        (TASK._replace(intruders=[CROSSING]), STRAIGHT),
        (TASK._replace(areas=[Area(Circle(5_000.0, 1_050.0, 1_000.0), clearance=100.0)]), STRAIGHT),
        (TASK, [one._replace(speed=80.0 + 0.3 * one.time) for one in STRAIGHT[:106]]),
        (TASK, [Step(0.0, max(80.0 - 0.5 * n, 25.0), float(n)) for n in range(281)]),
        (TASK, [STRAIGHT[0], *(one._replace(speed=82.0) for one in STRAIGHT[1:])]),
        (TASK, [STRAIGHT[0], Step(0.1, 80.0, 1.0), *STRAIGHT[2:]]),
    ],
    ids=["short", "intruder", "area", "fast", "slow", "acceleration", "turn rate"],
)
def test_each_fault_of_a_flight_is_found(task: Task, steps: list[Step]) -> None:
    assert not is_right(task, steps)


def test_what_passes_behind_an_intruder_or_beside_an_area_is_right() -> None:
    beside = Area(Circle(5_000.0, 1_300.0, 1_000.0), clearance=100.0)
    behind = CROSSING._replace(y=-3_000.0)
    assert is_right(TASK._replace(areas=[beside], intruders=[behind]), STRAIGHT)


def test_a_circle_is_flown_as_one() -> None:
    rate, speed = 0.02, 90.0
    own = VehicleState(100.0, -50.0, 0.3, speed)
    turns = [math.remainder(0.3 + rate * n, math.tau) for n in range(200)]
    flown = fly(own, [Step(heading, speed, float(n)) for n, heading in enumerate(turns)])
    radius = speed / rate
    centre = complex(own.x, own.y) + 1j * radius * np.exp(0.3j)
    np.testing.assert_allclose(np.abs(flown.place - centre), radius, atol=1e-3)
    np.testing.assert_allclose(flown.turn_rate, rate, atol=1e-9)
    assert flown.time[-1] == pytest.approx(199.0)


def test_figures_count_what_any_planner_solves() -> None:
    found = [Planned(50.0, 0.01, frozenset()), Planned(math.inf, 0.05, frozenset({"area"}))] * 2
    tried = [
        Sampled(ours=True, ompl=True, right=True),
        Sampled(ours=False, ompl=True, right=True),
        Sampled(ours=False, ompl=True, right=False),
    ]
    alone = areas.figures(found, [50.0])
    assert alone["solved"] == 2
    assert alone["safe_of_solved_50_ms"] == 1.0
    both = areas.compare(found, tried, [50.0])
    assert both["ompl_wrong"] == 1
    assert both["safe_of_solved_by_any_50_ms"] == pytest.approx(2.0 / 3.0)


def test_where_ompl_is_missing_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    real: Any = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "ompl" else real(name)
    )
    with pytest.raises(InputError, match=r"OMPL is not installed.*pip install"):
        sampling_planner.require()


@pytest.mark.skipif(
    importlib.util.find_spec("ompl") is None,
    reason=f"OMPL is not installed; to have it: {sampling_planner.INSTALL}",
)
def test_ompl_finds_its_way_round_an_area_behind_an_intruder() -> None:
    task = TASK._replace(
        intruders=[CROSSING], areas=[Area(Circle(6_000.0, 0.0, 1_500.0), clearance=100.0)]
    )
    assert not is_right(task, STRAIGHT)
    steps = sampling_planner.solve(task, 60.0, seed=0)
    assert steps is not None
    assert is_right(task, steps)
