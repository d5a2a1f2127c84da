# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""The runner in a full airspace, the monitor beside it: ``python -m benchmarks.ros.airspace``.

A hundred aircraft within 30 km report over DDS, those in the inner half twice a second, the others
once; wind of 10 m/s that is known within 1 m/s; three areas drawn at random. The ownship reports
ten times a second and flies along its route. Runner and monitor are processes of their own, the
caller another; each sky is a graph of its own, and is asked for plans again and again.
``request_to_plan`` is from the call to the answer in the caller's hands, ``computation`` what the
runner says that it took, ``core_percent`` the processor time of a process over the time that it is
asked in. Needs ``make ros``.
"""

import math
import os
import time
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from agents.inference import Policy
from benchmarks.measure import report
from benchmarks.ros.graph import (
    FRAME,
    ORIGIN,
    PATIENCE,
    ahead,
    geodetic,
    processor_time,
    start,
    way,
)
from benchmarks.traffic import Question, question
from envs.areas import Area
from envs.edge.command import Parser, run_cli
from envs.random_areas import random_areas
from ros_bridge.transport.children import free_domain, stop

_OWN_PERIOD, _NEAR_PERIOD, _FAR_PERIOD = 0.1, 0.5, 1.0  # s between reports
_WIND = (8.0, 6.0)  # m/s east and north
_WIND_STD = 1.0  # m/s
_SETTLE = 3.0  # s until every aircraft is known
_BETWEEN = 0.5  # s between requests
_POSITION_STD, _VELOCITY_STD = 15.0, 1.0  # m, m/s: good reports of ADS-B
_AREAS = 3


class Sky(NamedTuple):
    """What is in the air at the beginning, and the route."""

    asked: Question
    areas: tuple[Area, ...]

    @classmethod
    def draw(cls, seed: int, count: int, radius: float, policy: Policy) -> "Sky":
        """Return a sky with so many aircraft within a radius, m."""
        asked = question(seed, count, radius, policy.aircraft)
        goal = asked.route[0].x, asked.route[0].y
        return cls(asked, random_areas(seed, 0, _AREAS, asked.own, goal, policy.aircraft))


class Caller:
    """Reports what a sky holds and asks the runner for plans."""

    def __init__(self, sky: Sky, radius: float) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rlcas_msgs.msg import GeoReference
        from rlcas_msgs.srv import GenerateTrajectory

        from ros_bridge.transport import topics
        from ros_bridge.transport.area_messages import areas_message

        rclpy.init(args=[])
        self._rclpy = rclpy
        self._node = rclpy.create_node("airspace")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._own = self._node.create_publisher(*topics.OWNSHIP)
        self._others = self._node.create_publisher(*topics.TRAFFIC)
        self._origin = self._node.create_publisher(*topics.GEO_REFERENCE)
        self._areas = self._node.create_publisher(*topics.AREAS)
        self._plan = self._node.create_client(GenerateTrajectory, topics.SERVICE)
        self._origin.publish(GeoReference(latitude=ORIGIN[0], longitude=ORIGIN[1]))
        self._areas.publish(areas_message(sky.areas, time.time_ns(), FRAME, "map"))
        self._states = [sky.asked.own, *sky.asked.intruders]
        far = [math.hypot(one.x, one.y) > 0.5 * radius for one in sky.asked.intruders]
        self._periods = [_OWN_PERIOD] + [_FAR_PERIOD if one else _NEAR_PERIOD for one in far]
        self._next = np.random.default_rng(0).uniform(0.0, self._periods)
        self._begin = time.time()
        points = sky.asked.route
        route = way([point.x for point in points], [point.y for point in points])
        # As the monitor asks: within the deadline.
        self._request = GenerateTrajectory.Request(reason=2, route=route)

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        self._rclpy.try_shutdown()

    def wait(self) -> None:
        """Wait until the runner answers and hears the traffic."""
        end = time.monotonic() + PATIENCE
        while not (self._plan.service_is_ready() and self._others.get_subscription_count() > 1):
            if time.monotonic() > end:
                raise SystemExit(f"runner and monitor did not come up within {PATIENCE:g} s")
            self.fly(0.1)
        self.fly(_SETTLE)

    def fly(self, seconds: float) -> None:
        """Report for some seconds, each aircraft at its own times."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._report()

    def ask(self) -> tuple[float, Any]:
        """Return the time from the call to the answer, s, and the answer; report meanwhile."""
        began = time.perf_counter()
        future = self._plan.call_async(self._request)
        while not future.done():
            self._report()
            if time.perf_counter() - began > PATIENCE:
                raise SystemExit(f"the runner did not answer within {PATIENCE:g} s")
        return time.perf_counter() - began, future.result()

    def _report(self) -> None:
        """Publish what is due, and take in an answer."""
        from ros_bridge.core.reports import Report
        from ros_bridge.transport.messages import aircraft_message

        now = time.time()
        for n in np.flatnonzero(self._next <= now - self._begin).tolist():
            (latitude, longitude), east, north = geodetic(ahead(self._states[n], now - self._begin))
            message = aircraft_message(
                Report(
                    "own" if n == 0 else f"{0x4B0000 + n:x}",
                    round(now * 1e9),
                    latitude,
                    longitude,
                    east,
                    north,
                    position_std=_POSITION_STD,
                    velocity_std=_VELOCITY_STD,
                    wind=_WIND if n == 0 else None,
                )
            )
            (self._others if n else self._own).publish(message)
            self._next[n] += self._periods[n]
        self._executor.spin_once(timeout_sec=0.002)


def ask_in(sky: Sky, radius: float, requests: int) -> dict[str, list[Any]]:
    """Return times, s, statuses and the processes' shares of a core, asked in one sky."""
    wind = "--ros-args", "-p", f"wind_std:={_WIND_STD}"
    nodes = {
        "runner": start("ros_bridge.runner", *wind),
        "monitor": start("ros_bridge.monitor"),
    }
    caller = Caller(sky, radius)
    found: dict[str, list[Any]] = {"request_to_plan": [], "computation": [], "status": []}
    try:
        caller.wait()
        began = time.monotonic()
        before = {name: processor_time(node.pid) for name, node in nodes.items()}
        for _ in range(requests):
            took, answer = caller.ask()
            found["request_to_plan"].append(took)
            found["computation"].append(answer.computation_time)
            found["status"].append(_name(answer))
            caller.fly(_BETWEEN)
        lasted = time.monotonic() - began
        for name, node in nodes.items():
            found[name] = [(processor_time(node.pid) - before[name]) / lasted]
    finally:
        caller.close()
        stop(nodes.values())
    return found


def _name(answer: Any) -> str:
    """Return what an answer is, in words; a refusal with its sentence."""
    if answer.status == answer.STATUS_SAFE:
        return "safe"
    if answer.status == answer.STATUS_UNRESOLVED:
        return "unresolved"
    return f"{answer.field} {answer.message}"


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--skies", type=int, default=10, help="one after the other (default 10)")
    add("--requests", type=int, default=20, help="in each sky (default 20)")
    add("--aircraft", type=int, default=100, help="beside the ownship (default 100)")
    add("--radius", type=float, default=30.0, help="about the ownship, km (default 30)")
    add("--seed", type=int, default=0, help="of the first sky (default 0)")
    given = parser.parse_args()
    radius, policy = 1e3 * given.radius, Policy.load()
    every: dict[str, list[Any]] = {}
    with free_domain() as domain:
        os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        for number in range(given.skies):
            sky = Sky.draw(given.seed + number, given.aircraft, radius, policy)
            for name, values in ask_in(sky, radius, given.requests).items():
                every.setdefault(name, []).extend(values)
            print(f"sky {number + 1} of {given.skies}", flush=True)
    figures: dict[str, Any] = {"benchmark": "ros_airspace", **vars(given)}
    for name in ("request_to_plan", "computation"):
        for mark, share in (("median", 50.0), ("p90", 90.0), ("p99", 99.0), ("max", 100.0)):
            figures[f"{name}_{mark}_ms"] = 1e3 * float(np.percentile(every[name], share))
    for name in ("runner", "monitor"):
        figures[f"{name}_core_percent"] = 100.0 * float(np.mean(every[name]))
    figures["answers"] = dict(Counter(every["status"]))
    for name, value in figures.items():
        print(f"{name:28} {value:.4g}" if isinstance(value, float) else f"{name:28} {value}")
    report(figures, ("numpy", "ros-rclpy", "ros-rmw-fastrtps-cpp"))


if __name__ == "__main__":
    run_cli(main)
