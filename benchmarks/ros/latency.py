"""Latency of the runner on a real graph: ``python -m benchmarks.ros.latency [--calls 1000]``.

Runner, translator and caller are processes of their own; DDS on loopback. All the time the caller
publishes a fix and a velocity at 100 Hz, which the translator passes on as the ownship's state at
100 Hz, and the intruder at 20 Hz. Each call asks for the plan of another random circle encounter,
which flies on until the next, before which the simulated clock steps back, so that the runner
forgets the one before; in turns with it goes the floor, an empty service (std_srvs/Trigger) of a
fourth process on the same graph. ``end to end`` is from the call to the answer in the caller's
hands, ``computation`` what the runner says that it took, ``overhead`` the difference. Beside them:
the time from the start of the runner's process until it says that it is active; the times from a
kill and start until it answers at all and until a plan is SAFE, with the inputs that its last
refusals missed; and its memory. Needs ``make ros``.
"""

import argparse
import contextlib
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents.planner.request.encounters import request_of
from agents.planner.request.request import Request
from benchmarks.measure import percentiles_ms, report, show
from benchmarks.ros.graph import (
    ORIGIN,
    PATIENCE,
    advance,
    cores_stolen,
    exact_report,
    geodetic,
    own_domain,
    resident_memory,
    route_message,
    scheduling,
    start,
)
from commands.command import Parser, run_cli, whole
from envs.aircraft import PAPER
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from ros_bridge.transport.children import stop

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time
    from rclpy.client import Client
    from rlcas_msgs.msg import Waypoint
    from rlcas_msgs.srv import GenerateTrajectory

NODE, TRANSLATOR = "/rlcas_runner", "/rlcas_translator"
OWN_RATE, TRAFFIC_RATE = 100.0, 20.0  # Hz
SETTLE = 3.5 / TRAFFIC_RATE  # s until a scene is known
RESTARTS = 30
# All is known exactly, the calm too: what is measured is the bridge, not what unknowns cost.
SETTINGS = ["-p", "use_sim_time:=true", "-p", "margin:=0.02", "-p", "unknown_wind_std:=0.0"]
RUNNER = ("ros_bridge.runner", "--ros-args", *SETTINGS)
BEGIN = 1_000_000.0  # s on the clock of the first scene
BACK = 5.0  # s by which each scene begins earlier than the one before
_MARKS = "median", "p90", "p99", "max"


class Scene(NamedTuple):
    """Two aircraft at the beginning of an encounter, and the route."""

    own: VehicleState[Ground]
    intruder: VehicleState[Ground]
    route: "list[Waypoint]"

    @classmethod
    def of_request(cls, request: Request) -> "Scene":
        """Return the scene of a request ``[]`` with one intruder."""
        return cls(
            VehicleState(*(float(field) for field in request.own)),
            VehicleState(*(float(field[0]) for field in request.traffic.state)),
            route_message(request.route_x.tolist(), request.route_y.tolist()),
        )


class Call(NamedTuple):
    """One request for a plan, and the call of the empty service before it; times in s."""

    kind: str
    """``policy``, ``fallback`` or ``unresolved``."""
    end_to_end: float
    computation: float
    """As the runner says."""
    empty: float


class Restart(NamedTuple):
    """One runner that was started after the one before it was killed; times in s from its start."""

    answered: float
    safe: float
    missed: str
    """What the last refusal missed; "nothing" without any."""


def empty_service() -> None:
    """Serve an empty service until it is stopped."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from std_srvs.srv import Trigger

    rclpy.init()
    node = rclpy.create_node("empty")
    node.create_service(Trigger, "~/call", lambda _, response: response)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


class Caller:
    """Publishes the scene and calls services."""

    def __init__(self) -> None:
        import rclpy
        from geometry_msgs.msg import TwistStamped
        from rclpy.executors import SingleThreadedExecutor
        from rlcas_msgs.msg import AircraftState, GeoReference
        from rlcas_msgs.srv import GenerateTrajectory
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import NavSatFix
        from std_srvs.srv import Trigger

        from ros_bridge.transport import qos

        rclpy.init()
        self.node = rclpy.create_node("caller")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.fix = self.node.create_publisher(NavSatFix, f"{TRANSLATOR}/input/fix", qos.SENSOR)
        self.velocity = self.node.create_publisher(
            TwistStamped, f"{TRANSLATOR}/input/velocity", qos.SENSOR
        )
        self.traffic = self.node.create_publisher(
            AircraftState, f"{NODE}/input/traffic", qos.TRAFFIC
        )
        self.origin = self.node.create_publisher(
            GeoReference, f"{NODE}/input/geo_reference", qos.LATCHED
        )
        self.plan = self.node.create_client(GenerateTrajectory, f"{NODE}/generate_trajectory")
        self.empty = self.node.create_client(Trigger, "/empty/call")

        self.clock = self.node.create_publisher(Clock, "/clock", qos.CLOCK)
        self.scene: Scene | None = None
        self.scenes, self.since = 0, 0.0
        self.node.create_timer(1.0 / OWN_RATE, self._publish_own)
        self.node.create_timer(1.0 / TRAFFIC_RATE, self._publish_traffic)

    def wait(self) -> None:
        """Wait until all are there."""
        for client in (self.plan, self.empty):
            if not client.wait_for_service(PATIENCE):
                raise SystemExit(f"{client.service_name} did not come up within {PATIENCE:g} s")
        every = (self.fix, self.velocity, self.traffic, self.origin)
        self.spin(
            lambda: all(publisher.get_subscription_count() > 0 for publisher in every),
            "runner and translator to subscribe",
        )

    def spin(self, until: Callable[[], bool], event: str) -> None:
        """Publish and listen until something holds."""
        end = time.monotonic() + PATIENCE
        while not until():
            if time.monotonic() > end:
                raise SystemExit(f"waited {PATIENCE:g} s for {event}")
            self.executor.spin_once(timeout_sec=0.02)

    def show(self, scene: Scene) -> None:
        """Publish another scene from now on, and wait until it is believed."""
        from rlcas_msgs.msg import GeoReference

        self.origin.publish(GeoReference(latitude=ORIGIN[0], longitude=ORIGIN[1]))
        self.scene, self.scenes, self.since = scene, self.scenes + 1, time.perf_counter()
        end = time.monotonic() + SETTLE
        self.spin(lambda: time.monotonic() > end, "the scene")

    def _times(self) -> "tuple[float, Time]":
        """Return the time since the scene began, s, and the simulated time."""
        from ros_bridge.transport.messages import time_message

        seconds = time.perf_counter() - self.since
        return seconds, time_message(round((BEGIN - BACK * self.scenes + seconds) * 1e9))

    def _publish_own(self) -> None:
        from geometry_msgs.msg import TwistStamped
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import NavSatFix, NavSatStatus

        if self.scene is None:
            return
        seconds, stamp = self._times()
        where = geodetic(advance(self.scene.own, seconds))
        self.clock.publish(Clock(clock=stamp))
        twist = TwistStamped()
        twist.header.stamp = stamp
        twist.twist.linear.x, twist.twist.linear.y = where.east, where.north
        self.velocity.publish(twist)
        fix = NavSatFix(
            status=NavSatStatus(status=0),
            latitude=where.latitude,
            longitude=where.longitude,
            altitude=2_500.0,
        )
        fix.header.stamp = stamp
        self.fix.publish(fix)

    def _publish_traffic(self) -> None:
        if self.scene is None:
            return
        seconds, stamp = self._times()
        self.traffic.publish(exact_report("other", advance(self.scene.intruder, seconds), stamp))

    def call(self, client: "Client[Any, Any]", request: Any) -> tuple[float, Any]:
        """Return the time from call to answer, s, and the answer."""
        began = time.perf_counter()
        future = client.call_async(request)
        end = began + PATIENCE
        while not future.done():
            self.executor.spin_once(timeout_sec=1.0)
            if time.perf_counter() > end:
                raise SystemExit(f"{client.service_name} did not answer within {PATIENCE:g} s")
        return time.perf_counter() - began, future.result()


def measure(caller: Caller, first: int, calls: int) -> list[Call]:
    """Ask for the plans of so many encounters from a number on, each after a call of the empty
    service.
    """
    from rlcas_msgs.msg import Trajectory
    from rlcas_msgs.srv import GenerateTrajectory
    from std_srvs.srv import Trigger

    request = request_of(encounters_of_seed(scenario("circle", PAPER), 0, first, calls), PAPER)
    kinds = {Trajectory.SOURCE_POLICY: "policy", Trajectory.SOURCE_FALLBACK: "fallback"}
    measured = []
    for number in range(calls):
        scene = Scene.of_request(take(request, number))
        caller.show(scene)
        empty, _ = caller.call(caller.empty, Trigger.Request())
        service_request = GenerateTrajectory.Request(reason=3, route=scene.route)
        took, answer = caller.call(caller.plan, service_request)
        if answer.status not in (answer.STATUS_SAFE, answer.STATUS_UNRESOLVED):
            raise SystemExit(
                f"encounter {first + number}: status {answer.status}: {answer.message}"
            )
        safe = answer.status == answer.STATUS_SAFE
        kind = kinds[answer.trajectory.source] if safe else "unresolved"
        measured.append(Call(kind, took, answer.computation_time, empty))
    return measured


def call_figures(calls: Sequence[Call]) -> dict[str, Any]:
    """Return how long calls took, by kind of plan."""
    times: dict[str, list[float]] = {
        "empty": [call.empty for call in calls],
        "overhead": [call.end_to_end - call.computation for call in calls],
    }
    for call in calls:
        times.setdefault(f"{call.kind}_end_to_end", []).append(call.end_to_end)
        times.setdefault(f"{call.kind}_computation", []).append(call.computation)
    summary: dict[str, Any] = {}
    for name, values in sorted(times.items()):
        summary[f"{name}_count"] = len(values)
        summary |= percentiles_ms(name, values, _MARKS)
    return summary


def restart(
    caller: Caller, runner: "subprocess.Popen[bytes]", scene: Scene
) -> "tuple[subprocess.Popen[bytes], Restart]":
    """Kill the runner and start another; return that, and when it first planned a scene."""
    caller.show(scene)
    runner.kill()
    runner.wait()
    began = time.perf_counter()
    runner = start(*RUNNER)
    return runner, _time_first_plan(caller, scene, began)


def _time_first_plan(caller: Caller, scene: Scene, began: float) -> Restart:
    """Ask every 20 ms until a plan is SAFE; ``began``: when the runner was started, s."""
    from rlcas_msgs.srv import GenerateTrajectory

    futures, answers, answered = [], [], None
    while not any(answer.status == answer.STATUS_SAFE for answer in answers):
        # Calls to the killed one are never answered: DDS does not know at once that it has ended.
        request = GenerateTrajectory.Request(reason=3, route=scene.route)
        futures.append(caller.plan.call_async(request))
        end = time.perf_counter() + 0.02
        while time.perf_counter() < end:
            caller.executor.spin_once(timeout_sec=0.005)
        answers = [future.result() for future in futures if future.result() is not None]
        if answers and answered is None:
            answered = time.perf_counter() - began
        if time.perf_counter() - began > PATIENCE:
            last = f"the last answer missed {_last_missed(answers)}" if answers else "no answer"
            raise SystemExit(f"no SAFE plan within {PATIENCE:g} s of the runner's start: {last}")
    safe = time.perf_counter() - began
    assert answered is not None
    for future in futures:
        caller.plan.remove_pending_request(future)
    return Restart(answered, safe, _last_missed(answers))


def _last_missed(answers: "Sequence[GenerateTrajectory.Response]") -> str:
    """Return the input that the last refused request missed."""
    return next((answer.field for answer in reversed(answers) if answer.field), "nothing")


def restart_figures(restarts: Sequence[Restart]) -> dict[str, Any]:
    """Return how long it took from a kill to an answer and to a SAFE plan."""
    summary: dict[str, Any] = {}
    answered, safe = [trial.answered for trial in restarts], [trial.safe for trial in restarts]
    for name, times in (("answer", answered), ("safe_plan", safe)):
        summary[f"killed_to_{name}_median_s"] = float(np.median(times))
        summary[f"killed_to_{name}_max_s"] = max(times)
    summary["last_missed_before_the_plan"] = dict(Counter(trial.missed for trial in restarts))
    return summary


class Start(NamedTuple):
    """How a runner's process came to be active; seconds."""

    wall: float
    """From its start until it says so."""
    worked: float
    """What it had of the cores, all threads; nan where the system does not tell."""
    waited: float
    """What its threads were ready and had no core for, summed."""
    stolen: float
    """What the machine's own host took from all cores meanwhile."""


def time_to_active() -> Start:
    """Start a runner, and end it as soon as it says that it is active."""
    stolen, began = cores_stolen(), time.perf_counter()
    command = [sys.executable, "-m", "ros_bridge.runner"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as runner:
        assert runner.stdout is not None
        for line in runner.stdout:
            if line.rstrip().endswith("active"):
                took = time.perf_counter() - began
                started = Start(took, *scheduling(runner), cores_stolen() - stolen)
                runner.terminate()
                return started
    raise SystemExit("the runner ended before it was active")


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument(
        "--calls", type=whole(1), default=1000, help="calls of each kind (default 1000)"
    )
    parser.add_argument("--serve-empty", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve_empty:
        empty_service()
        return
    with own_domain():
        figures = measure_graph(options.calls)
    show(figures)
    report(figures, ("numpy", "ros-rclpy", "ros-rmw-fastrtps-cpp"))


def measure_graph(calls: int) -> dict[str, Any]:
    """Return the figures of a graph that is started and stopped for them."""
    own = ("-p", "own_source:=nav_sat_fix", "-p", "own_id:=own")
    servers = [
        start(*RUNNER),
        start("ros_bridge.translator", "--ros-args", *own),
        start("benchmarks.ros.latency", "--serve-empty"),
    ]
    try:
        caller = Caller()
        caller.wait()
        measure(caller, calls, 20)  # warm
        figures: dict[str, Any] = {"benchmark": "ros_latency", "calls": calls}
        figures |= call_figures(measure(caller, 0, calls))
        figures["runner_resident_mib"] = resident_memory(servers[0])
        figures |= start_figures([time_to_active() for _ in range(RESTARTS)])
        scene, restarts = first_scene(), []
        for _ in range(RESTARTS):
            servers[0], timed = restart(caller, servers[0], scene)
            restarts.append(timed)
        figures |= restart_figures(restarts) | end(servers[0])
    finally:
        stop(servers)
    return figures


def first_scene() -> Scene:
    """Return the scene of the first encounter."""
    request = request_of(encounters_of_seed(scenario("circle", PAPER), 0, 0, 1), PAPER)
    return Scene.of_request(take(request, 0))


def start_figures(starts: Sequence[Start]) -> dict[str, Any]:
    """Return how long runners took to be active."""
    wall = sorted(launch.wall for launch in starts)
    return {
        "start_to_active_median_s": float(np.median(wall)),
        "start_to_active_max_s": max(wall),
        "starts_to_active_s": [round(seconds, 3) for seconds in wall],
        "slowest_start_s": max(starts)._asdict(),
    }


def end(runner: "subprocess.Popen[bytes]") -> dict[str, Any]:
    """Ask the runner to end, and return how it did."""
    began = time.perf_counter()
    runner.terminate()
    code = runner.wait(PATIENCE)
    return {"exit_code_of_sigterm": code, "sigterm_to_exit_s": time.perf_counter() - began}


if __name__ == "__main__":
    run_cli(main)
