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
import time
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents.inference import Policy
from benchmarks.measure import (
    deadline_option,
    percentiles_ms,
    processor_time,
    report,
    show,
)
from benchmarks.questions import Question
from benchmarks.ros.graph import (
    FRAME,
    ORIGIN,
    PATIENCE,
    advance,
    geodetic,
    own_domain,
    route_message,
    start,
)
from benchmarks.traffic import question
from commands.command import Parser, real, run_cli, whole
from envs.areas import Area
from envs.random_areas import random_areas
from ros_bridge.transport.children import stop

if TYPE_CHECKING:
    from rlcas_msgs.srv import GenerateTrajectory

_OWN_PERIOD, _NEAR_PERIOD, _FAR_PERIOD = 0.1, 0.5, 1.0  # s between reports
_WIND = (8.0, 6.0)  # m/s east and north
_WIND_STD = 1.0  # m/s
_SETTLE = 3.0  # s until every aircraft is known
_BETWEEN = 0.5  # s between requests
_POSITION_STD, _VELOCITY_STD = 15.0, 1.0  # m, m/s: good reports of ADS-B
_AREAS = 3
_MARKS = "median", "p90", "p99", "max"


class Sky(NamedTuple):
    """What is in the air at the beginning, and the route."""

    request: Question
    areas: tuple[Area, ...]

    @classmethod
    def draw(cls, seed: int, count: int, radius: float, policy: Policy) -> "Sky":
        """Return a sky with so many aircraft within a radius, m."""
        request = question(seed, count, radius, policy.aircraft)
        goal = request.route[0].x, request.route[0].y
        return cls(request, random_areas(seed, 0, _AREAS, request.own, goal, policy.aircraft))


class Answered(NamedTuple):
    """What one request for a plan gave."""

    request_to_plan: float
    """From the call to the answer, s."""
    computation: float
    """As the runner says, s."""
    status: str


class Measured(NamedTuple):
    """What was measured in one sky."""

    answers: list[Answered]
    cores: dict[str, float]
    """Shares of a core that runner and monitor had, by their names."""


class Caller:
    """Reports what a sky holds and asks the runner for plans.

    Args:
        sky: aircraft, route and areas.
        radius: of the sky, m; aircraft in the inner half report more often.
    """

    def __init__(self, sky: Sky, radius: float) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rlcas_msgs.msg import GeoReference
        from rlcas_msgs.srv import GenerateTrajectory

        from ros_bridge.transport import topics
        from ros_bridge.transport.messages import areas_message

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
        self._states = [sky.request.own, *sky.request.states]
        far = [math.hypot(state.x, state.y) > 0.5 * radius for state in sky.request.states]
        self._periods = [_OWN_PERIOD] + [_FAR_PERIOD if is_far else _NEAR_PERIOD for is_far in far]
        self._next = np.random.default_rng(0).uniform(0.0, self._periods)
        self._begin = time.time()
        points = sky.request.route
        route = route_message([point.x for point in points], [point.y for point in points])
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

    def ask(self) -> Answered:
        """Ask for a plan; report meanwhile."""
        began = time.perf_counter()
        future = self._plan.call_async(self._request)
        while not future.done():
            self._report()
            if time.perf_counter() - began > PATIENCE:
                raise SystemExit(f"the runner did not answer within {PATIENCE:g} s")
        took, answer = time.perf_counter() - began, future.result()
        assert answer is not None
        return Answered(took, answer.computation_time, _status(answer))

    def _report(self) -> None:
        """Publish what is due, and take in an answer."""
        from ros_bridge.core.reports import Report
        from ros_bridge.transport.messages import aircraft_message

        stamp = time.time()
        for n in np.flatnonzero(self._next <= stamp - self._begin).tolist():
            message = aircraft_message(
                Report(
                    "own" if n == 0 else f"{0x4B0000 + n:x}",
                    round(stamp * 1e9),
                    *geodetic(advance(self._states[n], stamp - self._begin)),
                    position_std=_POSITION_STD,
                    velocity_std=_VELOCITY_STD,
                    wind=_WIND if n == 0 else None,
                )
            )
            (self._others if n else self._own).publish(message)
            self._next[n] += self._periods[n]
        self._executor.spin_once(timeout_sec=0.002)


def measure(sky: Sky, radius: float, requests: int, deadline: float | None) -> Measured:
    """Ask so many times for a plan in one sky of a radius, m; with a deadline, ms, or the usual."""
    parameters = ["--ros-args", "-p", f"wind_std:={_WIND_STD}"]
    if deadline is not None:
        parameters += ["-p", f"deadline:={1e-3 * deadline}"]
    nodes = {
        "runner": start("ros_bridge.runner", *parameters),
        "monitor": start("ros_bridge.monitor"),
    }
    caller = Caller(sky, radius)
    answers = []
    try:
        caller.wait()
        began = time.monotonic()
        before = {name: processor_time(node.pid) for name, node in nodes.items()}
        for _ in range(requests):
            answers.append(caller.ask())
            caller.fly(_BETWEEN)
        lasted = time.monotonic() - began
        cores = {
            name: (processor_time(node.pid) - before[name]) / lasted for name, node in nodes.items()
        }
    finally:
        caller.close()
        stop(nodes.values())
    return Measured(answers, cores)


def _status(answer: "GenerateTrajectory.Response") -> str:
    """Return what an answer is, in words; a refusal with its sentence."""
    if answer.status == answer.STATUS_SAFE:
        return "safe"
    if answer.status == answer.STATUS_UNRESOLVED:
        return "unresolved"
    return f"{answer.field} {answer.message}"


def main() -> None:
    """Measure and print."""
    options = _parser().parse_args()
    radius, policy = 1e3 * options.radius, Policy.load()
    skies = list[Measured]()
    with own_domain():
        for number in range(options.skies):
            sky = Sky.draw(options.seed + number, options.aircraft, radius, policy)
            skies.append(measure(sky, radius, options.requests, options.deadline))
            print(f"sky {number + 1} of {options.skies}", flush=True)
    summary = {"benchmark": "ros_airspace", **vars(options), **figures(skies)}
    show(summary)
    report(summary, ("numpy", "ros-rclpy", "ros-rmw-fastrtps-cpp"))


def _parser() -> Parser:
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--skies", type=whole(1), default=10, help="skies, one after the other (default 10)")
    add("--requests", type=whole(1), default=20, help="requests in each sky (default 20)")
    add("--aircraft", type=whole(1), default=100, help="aircraft beside the ownship (default 100)")
    help_text = "radius of a sky, km (default 30)"
    add("--radius", type=real(1.0, 1_000.0, "km"), default=30.0, help=help_text)
    add("--seed", type=whole(0), default=0, help="seed of the first sky (default 0)")
    deadline_option(parser)
    return parser


def figures(skies: Sequence[Measured]) -> dict[str, Any]:
    """Return the figures of all skies together."""
    answers = [answer for sky in skies for answer in sky.answers]
    summary: dict[str, Any] = {
        **percentiles_ms("request_to_plan", [answer.request_to_plan for answer in answers], _MARKS),
        **percentiles_ms("computation", [answer.computation for answer in answers], _MARKS),
    }
    for name in ("runner", "monitor"):
        summary[f"{name}_core_percent"] = 100.0 * float(np.mean([sky.cores[name] for sky in skies]))
    return summary | {"answers": dict(Counter(answer.status for answer in answers))}


if __name__ == "__main__":
    run_cli(main)
