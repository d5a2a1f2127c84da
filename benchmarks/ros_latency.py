# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Latency of the runner on a real graph: ``python -m benchmarks.ros_latency [--calls 500]``.

The runner is a process of its own, the caller this one; DDS on loopback. Each call asks for the plan of another random
circle encounter, whose states are published before; in turns with it goes the floor, an empty service
(std_srvs/Trigger) of a third process on the same graph. ``end to end`` is from the call to the answer in the caller's
hands, ``computation`` what the runner says that it took, ``overhead`` the difference. Needs ``make ros``.
"""

import argparse
import contextlib
import math
import os
import socket
import subprocess
import sys
import time
from typing import Any

import numpy as np

from benchmarks.measure import report
from envs.encounters import scenario
from envs.kinematics import VehicleState
from envs.starts import numbered
from envs.trees import take
from eval.plan_flight import request_of
from ros_bridge.geodesy import LocalFrame

PATIENCE = 15.0  # s
NODE = "/rlcas_runner"
ORIGIN = (47.0, 8.0)
FRAME = LocalFrame(*ORIGIN)
SETTLE = 0.02  # s for what is published to arrive before the call


def empty_service() -> None:
    """Serve an empty service until told to stop."""
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
        from rclpy.executors import SingleThreadedExecutor
        from rlcas_msgs.msg import AircraftState, GeoReference
        from rlcas_msgs.srv import GenerateTrajectory
        from std_srvs.srv import Trigger

        from ros_bridge import qos

        rclpy.init()
        self.node = rclpy.create_node("caller")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.own = self.node.create_publisher(AircraftState, f"{NODE}/input/ownship", qos.SENSOR)
        self.traffic = self.node.create_publisher(AircraftState, f"{NODE}/input/traffic", qos.TRAFFIC)
        self.origin = self.node.create_publisher(GeoReference, f"{NODE}/input/geo_reference", qos.LATCHED)
        self.plan = self.node.create_client(GenerateTrajectory, f"{NODE}/generate_trajectory")
        self.empty = self.node.create_client(Trigger, "/empty/call")

    def wait(self) -> None:
        """Wait until all are there."""
        for client in (self.plan, self.empty):
            if not client.wait_for_service(PATIENCE):
                raise SystemExit(f"{client.srv_name} did not come up within {PATIENCE:g} s")
        end = time.monotonic() + PATIENCE
        every = (self.own, self.traffic, self.origin)
        while any(one.get_subscription_count() == 0 for one in every):
            if time.monotonic() > end:
                raise SystemExit(f"the runner did not subscribe within {PATIENCE:g} s")
            self.executor.spin_once(timeout_sec=0.02)

    def scene(self, own: VehicleState, other: VehicleState) -> None:
        """Publish where ownship and intruder are now."""
        from rlcas_msgs.msg import AircraftState, GeoReference

        self.origin.publish(GeoReference(latitude=ORIGIN[0], longitude=ORIGIN[1]))
        # Each scene is far from the one before; the second report of a place confirms that it is no outlier.
        for _ in range(2):
            now = self.node.get_clock().now().to_msg()
            for name, state, publisher in (("own", own, self.own), ("other", other, self.traffic)):
                at = FRAME.geodetic(state.x, state.y)
                true = state.heading - float(at.convergence)
                message = AircraftState(id=name, valid=5, latitude=float(at.latitude), longitude=float(at.longitude))
                message.header.stamp = now
                message.velocity.x, message.velocity.y = state.speed * math.cos(true), state.speed * math.sin(true)
                publisher.publish(message)
            time.sleep(0.5 * SETTLE)

    def call(self, client: Any, request: Any) -> tuple[float, Any]:
        """Return the time from call to answer, s, and the answer."""
        began = time.perf_counter()
        future = client.call_async(request)
        end = began + PATIENCE
        while not future.done():
            self.executor.spin_once(timeout_sec=1.0)
            if time.perf_counter() > end:
                raise SystemExit(f"{client.srv_name} did not answer within {PATIENCE:g} s")
        return time.perf_counter() - began, future.result()


def way(x: list[float], y: list[float]) -> list[Any]:
    """Return a route as waypoints."""
    from rlcas_msgs.msg import Waypoint

    at = FRAME.geodetic(x, y)
    places = zip(at.latitude.tolist(), at.longitude.tolist(), strict=True)
    return [Waypoint(index=n, latitude=latitude, longitude=longitude) for n, (latitude, longitude) in enumerate(places)]


def measured(caller: Caller, first: int, calls: int) -> dict[str, list[float]]:
    """Return end-to-end and computing times by kind of plan, and times of the empty service in turns, s."""
    from rlcas_msgs.msg import Trajectory
    from rlcas_msgs.srv import GenerateTrajectory
    from std_srvs.srv import Trigger

    request = request_of(numbered(scenario("circle"), 0, first, calls))
    kinds = {Trajectory.SOURCE_POLICY: "policy", Trajectory.SOURCE_FALLBACK: "fallback"}
    times: dict[str, list[float]] = {"empty": []}
    for number in range(calls):
        row = take(request, number)
        own = VehicleState(*(float(field) for field in row.own))
        other = VehicleState(*(float(field[0]) for field in row.traffic.state))
        caller.scene(own, other)
        floor, _ = caller.call(caller.empty, Trigger.Request())
        asked = GenerateTrajectory.Request(reason=3, route=way(row.route_x.tolist(), row.route_y.tolist()))
        took, answer = caller.call(caller.plan, asked)
        if answer.status not in (answer.STATUS_SAFE, answer.STATUS_UNRESOLVED):
            raise SystemExit(f"encounter {first + number}: status {answer.status}: {answer.message}")
        safe = answer.status == answer.STATUS_SAFE
        kind = kinds[answer.trajectory.source] if safe else "unresolved"
        times["empty"].append(floor)
        for name, value in (("end_to_end", took), ("computation", answer.computation_time)):
            times.setdefault(f"{kind}_{name}", []).append(value)
        times.setdefault("overhead", []).append(took - answer.computation_time)
    return times


def free_domain() -> int:
    """Return a domain id that no other run of this on the machine uses, kept until the process ends."""
    for number in range(200, 230):
        lock = socket.socket()
        try:
            lock.bind(("127.0.0.1", 23_000 + number))
        except OSError:
            lock.close()
            continue
        _LOCKS.append(lock)
        return number
    raise SystemExit("no domain is free")


_LOCKS: list[socket.socket] = []


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=500, help="calls of each kind (default 500)")
    parser.add_argument("--serve-empty", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve_empty:
        empty_service()
        return
    os.environ |= {"ROS_DOMAIN_ID": str(free_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    servers = [
        subprocess.Popen([sys.executable, "-m", "ros_bridge.runner"]),
        subprocess.Popen([sys.executable, "-m", "benchmarks.ros_latency", "--serve-empty"]),
    ]
    try:
        caller = Caller()
        caller.wait()
        measured(caller, options.calls, 20)
        times = measured(caller, 0, options.calls)
        figures: dict[str, Any] = {"benchmark": "ros_latency", "calls": options.calls}
        for kind, values in sorted(times.items()):
            figures[f"{kind}_count"] = len(values)
            for mark, share in (("median", 50.0), ("p90", 90.0), ("p99", 99.0), ("max", 100.0)):
                figures[f"{kind}_{mark}_ms"] = 1e3 * float(np.percentile(values, share))
    finally:
        for server in servers:
            server.terminate()
        for server in servers:
            server.wait(PATIENCE)
    for name, value in figures.items():
        print(f"{name:28} {value:.4g}" if isinstance(value, float) else f"{name:28} {value}")
    report(figures, ("numpy", "ros-rclpy", "ros-rmw-fastrtps-cpp"))


if __name__ == "__main__":
    main()
