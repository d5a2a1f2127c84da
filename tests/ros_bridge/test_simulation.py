"""The simulated world: the truth that it keeps, and how plans are flown in it."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from agents.planner.planner import plan
from agents.policy.inference import Policy
from envs.encounters import scenario
from envs.kinematics import VehicleState
from envs.relative import straight_cpa
from envs.starts import numbered
from envs.waypoints import RoutePoint, knots, legs
from ros_bridge.sim.world import VEHICLES, EncounterFlight, SimulationError, vehicle

NEEDS_JSBSIM = pytest.mark.skipif(importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed")


def met(name: str = "crossing_left", number: int = 0):
    return numbered(scenario(name), 0, number, 1)


def test_straight_flights_come_as_close_as_their_cpa():
    encounter = met()
    flight = EncounterFlight(encounter)
    expected = straight_cpa(flight.own, encounter.intruders, np)
    while not flight.over():
        flight.step()
    assert flight.truth.separation == pytest.approx(float(expected.distance[0, 0]), abs=0.1)
    assert flight.truth.when == pytest.approx(float(expected.time[0, 0]), abs=0.2)
    assert flight.reached is not None and flight.time < 300.0


@pytest.mark.parametrize(
    ("kind", "bound"),
    [
        ("kinematic", 0.1),
        pytest.param("point_mass", 20.0, marks=NEEDS_JSBSIM),
        pytest.param("c208", 20.0, marks=NEEDS_JSBSIM),
    ],
)
def test_flown_plan_keeps_its_separation(kind: str, bound: float):
    encounter = met("head_on")
    flight = EncounterFlight(encounter, kind)
    own = flight.own
    east, north = (flight.goal[0] - own.x) / 10.0, (flight.goal[1] - own.y) / 10.0
    route = [RoutePoint(n, own.x + east * n, own.y + north * n) for n in range(10, 90, 10)]
    made = plan(own, list(flight.traffic.values()), route, Policy.load())
    assert made.safe
    flight.fly(legs(knots(own, made.waypoints)), 0.0, plan=True)
    while not flight.over() and flight.time < 300.0:
        flight.step()
    assert flight.truth.error < bound
    assert flight.truth.separation == pytest.approx(made.min_separation, abs=2.0 * bound)


def test_only_intruders_that_exist_fly():
    encounter = numbered(scenario("multi"), 0, 0, 1)
    flight = EncounterFlight(encounter)
    assert len(flight.traffic) == int(encounter.mask.sum()) < encounter.mask.size
    flight.step()
    moved = {name: state.x for name, state in flight.traffic.items()}
    assert list(moved) == list(flight.names)


def test_unknown_vehicle_is_refused():
    with pytest.raises(SimulationError, match=r"vehicle is 'glider', expected one of kinematic, point_mass, c208"):
        vehicle("glider", VehicleState(0.0, 0.0, 0.0, 70.0))


@NEEDS_JSBSIM
def test_a_vehicle_that_cannot_fly_so_is_refused():
    with pytest.raises(SimulationError, match="c208"):
        vehicle("c208", VehicleState(0.0, 0.0, 0.0, 300.0))


def test_jsbsim_is_loaded_for_vehicles_that_need_it():
    code = (
        "import sys; from envs.kinematics import VehicleState; from ros_bridge.sim.world import vehicle; "
        "vehicle('kinematic', VehicleState(0.0, 0.0, 0.0, 70.0)); "
        "print('jsbsim' in sys.modules, 'rclpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
    assert VEHICLES[0] == "kinematic"
