"""The simulator as a node: what it publishes is what the other nodes read, and what cannot be flown is said."""

import importlib.util
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.ros_bridge.graph import MISSING
from tests.ros_bridge.inside import beside
from tests.ros_bridge.scenes import FRAME, NOW

pytest.importorskip("rclpy", reason=MISSING)

from agents.planner.request import Altitude
from envs.encounters import scenario
from envs.starts import numbered
from ros_bridge.core import conversions
from ros_bridge.core.tracks import Report
from ros_bridge.nodes.series import main
from ros_bridge.nodes.simulator import Simulator
from ros_bridge.nodes.simulator_messages import route_of
from ros_bridge.sim.flight_log import kept
from ros_bridge.sim.world import EncounterFlight
from ros_bridge.transport.messages import aircraft_message

SPEEDS = st.floats(-120.0, 120.0)
MAYBE = st.floats(0.1, 50.0) | st.just(0.0)
HEIGHTS = st.none() | st.builds(
    Altitude, st.floats(-500.0, 20_000.0), st.sampled_from(["wgs84", "msl", "pressure"]), st.floats(-50.0, 50.0)
)


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0), SPEEDS, SPEEDS, HEIGHTS, MAYBE, MAYBE, st.booleans())
def test_reports_come_back_from_their_messages_as_they_were(
    latitude, longitude, east, north, altitude, position_std, velocity_std, own
):
    more = {"wind": (0.0, 0.0), "true_airspeed": math.hypot(east, north)} if own else {}
    report = Report("n1", NOW, latitude, longitude, east, north, altitude, position_std, velocity_std, **more)
    assert conversions.aircraft(aircraft_message(report), "ownship") == report


def test_route_passes_the_goal_and_is_long_enough_for_every_plan():
    flight = EncounterFlight(numbered(scenario("circle"), 0, 3, 1))
    route = conversions.published_route(route_of(flight, FRAME))
    at = FRAME.place([one.latitude for one in route.points], [one.longitude for one in route.points])
    assert (float(at.x[0]), float(at.y[0])) == pytest.approx(flight.goal, abs=1e-3)
    # A plan at 100 m/s takes 400 s and goes no further.
    assert math.hypot(float(at.x[-1]) - flight.own.x, float(at.y[-1]) - flight.own.y) > 45_000.0
    assert len({one.index for one in route.points}) == len(route.points) == 10


@pytest.mark.skipif(importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed")
def test_encounter_that_cannot_be_flown_is_a_logged_failure():
    encounter = numbered(scenario("circle"), 0, 0, 1)
    fast = encounter._replace(own=encounter.own._replace(speed=encounter.own.speed * 0.0 + 300.0))
    with beside(Simulator, vehicle="c208") as (node, _):
        node.begin(fast, "too fast")
        assert not node.flying
        assert node.logs[0].failure.startswith("vehicle 'c208': the flight cannot begin")
        assert not kept(node.logs)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("vehicle:=glider", "vehicle is 'glider', expected one of kinematic, point_mass, c208"),
        ("scenario:=sideways", "scenario 'sideways' is unknown"),
        ("encounters:=0", "encounters is 0, expected 1 or more"),
        ("seed:=-1", "seed is -1; expected 0 <= seed"),
        ("traffic_dropout:=2.0", "traffic_dropout"),
    ],
)
def test_bad_parameters_end_with_one_line_and_code_2(given: str, says: str, capfd):
    assert main(["--ros-args", "-p", given]) == 2
    error = capfd.readouterr().err
    assert says in error and "Traceback" not in error and len(error.splitlines()) == 1
