"""A graph with something wrong in it: clocks, namesakes, nodes that do not agree; the node goes on,
says so, and stops saying so.
"""

import math
import signal
import subprocess
import sys
import time
from typing import Any

import pytest

from tests.ros_bridge.graph import MISSING, NODE, ROOT, Client, World, running_beside

pytest.importorskip("rclpy", reason=MISSING)

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rlcas_msgs.msg import AircraftState, AssuranceStatus, TrafficArray, Trajectory
from rosgraph_msgs.msg import Clock

from ros_bridge.core import updates
from ros_bridge.core.fields import nanoseconds
from ros_bridge.nodes.monitor import Monitor
from ros_bridge.nodes.runner import Runner
from ros_bridge.transport import qos, topics
from ros_bridge.transport.messages import time_message
from ros_bridge.transport.settings import disagreements

TICK = 10**8  # ns, of a simulated clock
OK, ERROR = DiagnosticStatus.OK, DiagnosticStatus.ERROR


def begin(node: Any) -> None:
    node.trigger_configure()
    node.trigger_activate()


def state_of(client: Client, name: str, health: list[DiagnosticArray]) -> DiagnosticStatus:
    """Return what a node says of itself next."""
    health.clear()
    return client.spin(
        lambda: next(
            (message.status[0] for message in health if message.status[0].name == name), None
        )
    )


def test_a_clock_that_is_no_time_is_passed_over_and_a_standing_one_stops_no_diagnostics():
    with running_beside(Runner, use_sim_time=True, diagnostics_period=0.2) as (node, client):
        begin(node)
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        state = state_of(client, NODE, health)  # without any clock
        assert "clock stands at zero" in state.message
        for seconds, nanoseconds in ((100, 0), (-5, 0), (100, 4_000_000_000), (2**31 - 1, 0)):
            clock_time = Time(sec=seconds, nanosec=nanoseconds)
            client.say(Clock, "/clock", Clock(clock=clock_time), qos.CLOCK)
            client.idle(0.1)
        client.spin(lambda: node._now() == 100 * 10**9)
        client.say(Clock, "/clock", Clock(clock=Time(sec=101)), qos.CLOCK)
        client.spin(lambda: node._now() == 101 * 10**9)


class SlowMonitor(Monitor):
    def _judge(self, now: int) -> None:
        time.sleep(0.03)  # as among hundreds of aircraft
        super()._judge(now)


def test_a_simulated_clock_that_waits_for_the_monitor_goes_on_at_once():
    with running_beside(SlowMonitor, use_sim_time=True) as (node, client):
        begin(node)
        says = client.hear(AssuranceStatus, "/rlcas_monitor/output/status", qos.LATCHED)

        def tell(tick: int) -> int:
            clock = Clock(clock=time_message(tick * TICK))
            client.say(Clock, "/clock", clock, qos.CLOCK)
            return tick

        def behind(tick: int) -> float:
            # In ticks; negative: of the time before the clock stepped back.
            return tick - nanoseconds(says[-1].header.stamp) / TICK if says else math.inf

        # It steps back where an encounter of the simulator begins, and runs until this is noticed.
        for begins in (1_000, 500):
            tick = tell(begins)
            while not 0 <= behind(tick) <= 2:
                client.idle(0.05)
                tick = tell(tick + 1)
                assert tick < begins + 100
            for later in range(tick + 1, tick + 31):
                tell(later)
                client.spin(lambda later=later: 0 <= behind(later) <= 2)


def test_a_publisher_that_does_not_fit_is_forgotten_when_it_has_gone():
    with running_beside(Runner, diagnostics_period=0.2) as (node, client):
        begin(node)
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        poor = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        quiet = PublisherEventCallbacks(incompatible_qos=lambda _: None)
        publisher = client.node.create_publisher(
            Trajectory, f"{NODE}/input/route", poor, event_callbacks=quiet
        )
        client.spin(lambda: "a publisher offers less" in state_of(client, NODE, health).message)
        client.node.destroy_publisher(publisher)
        client.spin(lambda: state_of(client, NODE, health).level != ERROR)


def test_a_second_node_of_the_name_is_an_error_while_it_runs():
    with running_beside(Monitor, diagnostics_period=0.2) as (node, client):
        begin(node)
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        second_publisher = client.node.create_publisher(
            AssuranceStatus, topics.STATUS.name, topics.STATUS.quality
        )
        says = "/rlcas_monitor/output/status has 2 publishers, expected this node alone"
        client.spin(lambda: says in state_of(client, "/rlcas_monitor", health).message)
        client.node.destroy_publisher(second_publisher)
        client.spin(lambda: says not in state_of(client, "/rlcas_monitor", health).message)


def test_a_monitor_that_differs_from_the_runner_says_in_what():
    values = {"diagnostics_period": 0.2, "separation": 3000.0}
    with running_beside(Runner, **values) as (runner, client):
        monitor = Monitor(
            context=client.context,
            parameter_overrides=[
                Parameter("diagnostics_period", value=0.2),
                Parameter("separation", value=500.0),
                Parameter("goal_radius", value=100.0),
            ],
        )
        client.executor.add_node(monitor)
        try:
            begin(runner)
            begin(monitor)
            health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)

            def status_text() -> str:
                state = state_of(client, "/rlcas_monitor", health)
                return state.message if state.level == ERROR else ""

            client.spin(lambda: "separation is 500 here and 3000 there" in status_text())
            monitor.set_parameters([Parameter("goal_radius", value=200.0)])
            client.spin(lambda: "goal_radius is 200 here" in status_text())
        finally:
            client.executor.remove_node(monitor)
            monitor.destroy_node()


def test_diagnostics_of_thousands_of_aircraft_are_bounded():
    with running_beside(Runner, diagnostics_period=0.2) as (node, client):
        begin(node)
        health = client.hear(DiagnosticArray, "/diagnostics", qos.EVENTS)
        now = client.now()
        bad = [AircraftState(id=f"{number:06x}", valid=1) for number in range(4_000)]
        for state in bad:
            state.header.stamp = time_message(now)
        node._take_in(updates.traffic_array, TrafficArray(states=bad))
        state = client.spin(
            lambda: next(
                (message.status[0] for message in health if len(message.status[0].values) > 100),
                None,
            )
        )
        assert len(state.values) < 1_100
        values = {pair.key: pair.value for pair in state.values}
        assert values["intruders"] == values["reports of all: invalid"] == "4000"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_during_the_start_ends_it_in_order(number: signal.Signals):
    code = (
        "import os\nfrom ros_bridge.transport.starting import end_in_order_from_now_on as begin\n"
        f"begin()\nos.kill(os.getpid(), {int(number)})\nraise SystemExit(3)"
    )
    process = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, timeout=60)
    assert process.returncode == 0


def test_the_ownship_is_published_as_odometry_in_the_map():
    with running_beside(Runner) as (node, client):
        begin(node)
        world = World(client)
        odometry = client.hear(Odometry, f"{NODE}/output/odometry", qos.EVENTS)
        world.reference()
        heading = 0.3

        def reported() -> list[Odometry]:
            world.ownship(3_000.0, -400.0, heading, 75.0, position_std=5.0, valid=0x45)
            client.idle(0.1)
            return odometry

        message = client.spin(reported)[0]
    assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
    place, facing = message.pose.pose.position, message.pose.pose.orientation
    flown = math.hypot(place.x - 3_000.0, place.y + 400.0)
    assert place.x - 3_000.0 == pytest.approx(flown * math.cos(heading), abs=0.5)
    assert place.y + 400.0 == pytest.approx(flown * math.sin(heading), abs=0.5)
    assert 2.0 * math.atan2(facing.z, facing.w) == pytest.approx(heading, abs=1e-3)
    assert message.twist.twist.linear.x == pytest.approx(75.0, abs=1e-3)
    assert message.pose.covariance[0] == message.pose.covariance[7] == 25.0
    assert message.twist.covariance[0] == -1.0  # unknown


def test_disagreements_name_what_differs():
    assert disagreements("a=1 b=2 c=", "a=1 b=3 c= d=4") == [
        "b is 2 here and 3 there, expected one value"
    ]
    assert disagreements("a=1", "") == []  # of a node that does not say it
