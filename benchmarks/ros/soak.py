"""An hour of traffic and 10000 requests: ``python -m benchmarks.ros.soak [--requests 10000]
[--hours 1]``.

Runner and monitor are processes of their own on simulated time. The ownship flies a circle of 20 km
(10 reports a second), twenty others cross the area on straight lines (a report a second each); one
that has crossed is replaced by another with a new name. Requests come evenly over the time; the
plans are published and watched by the monitor, whose own requests come on top, but never flown. The
last line is one JSON object; the exit code is 1 if a request got no answer, an answer was a fault
of the runner's, or memory or times of the answers grew from the first tenth (after it has warmed
up) to the last: by more than 5 MiB, or half. Needs ``make ros``.
"""

import argparse
import math
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchmarks.measure import report, show
from benchmarks.ros.graph import (
    ORIGIN,
    PATIENCE,
    advance,
    exact_report,
    own_domain,
    resident_memory,
    route_message,
    start,
)
from commands.command import Parser, real, run_cli, whole
from envs.angles import wrap
from envs.frames import Ground
from envs.kinematics import VehicleState

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray
    from rlcas_msgs.msg import AssuranceStatus

RUNNER, MONITOR = "/rlcas_runner", "/rlcas_monitor"
TICK = 0.1  # s
SPEED, RADIUS = 80.0, 20_000.0  # of the ownship, m/s; of its circle, m
OTHERS, REACH = 20, 30_000.0  # how many, and how far from the centre they appear and vanish, m
AHEAD = 5_000.0  # between the points of the route, m
GROWTH_MIB, GROWTH = 5.0, 1.5
BLOCKS = 10


class Sky:
    """The aircraft and their places; advanced tick by tick."""

    def __init__(self, seed: int) -> None:
        self._random, self.created = np.random.default_rng(seed), 0
        self.others: dict[str, VehicleState[Ground]] = {}
        for _ in range(OTHERS):
            name, state = self._new()
            # They begin anywhere on their way.
            self.others[name] = advance(
                state, float(self._random.uniform(0.0, REACH / state.speed))
            )

    def step(self) -> None:
        """Move the others by a tick; one that has left is replaced."""
        for name, state in list(self.others.items()):
            after = advance(state, TICK)
            if math.hypot(after.x, after.y) > 1.001 * REACH:
                del self.others[name]
                self.others.update([self._new()])
            else:
                self.others[name] = after

    def _new(self) -> tuple[str, VehicleState[Ground]]:
        self.created += 1
        bearing, offset = self._random.uniform(-math.pi, math.pi), self._random.uniform(-0.8, 0.8)
        course = float(wrap(np.asarray(bearing + math.pi + offset), np))
        speed = float(self._random.uniform(50.0, 100.0))
        return f"{self.created:06x}", VehicleState(
            REACH * math.cos(bearing), REACH * math.sin(bearing), course, speed
        )


def own_at(time: float) -> VehicleState[Ground]:
    """Return the ownship on its circle."""
    angle = time * SPEED / RADIUS
    heading = float(wrap(np.asarray(angle + 0.5 * math.pi), np))
    return VehicleState(RADIUS * math.cos(angle), RADIUS * math.sin(angle), heading, SPEED)


class World:
    """Publishes what there is, and asks."""

    def __init__(self, seed: int) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.executors import SingleThreadedExecutor
        from rlcas_msgs.msg import AircraftState, AssuranceStatus, GeoReference
        from rlcas_msgs.srv import GenerateTrajectory
        from rosgraph_msgs.msg import Clock

        from ros_bridge.transport import qos

        rclpy.init()
        self.node = rclpy.create_node("soak")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        make = self.node.create_publisher
        self.clock = make(Clock, "/clock", qos.CLOCK)
        self.own = make(AircraftState, f"{RUNNER}/input/ownship", qos.SENSOR)
        self.traffic = make(AircraftState, f"{RUNNER}/input/traffic", qos.TRAFFIC)
        self.origin = make(GeoReference, f"{RUNNER}/input/geo_reference", qos.LATCHED)
        self.client = self.node.create_client(GenerateTrajectory, f"{RUNNER}/generate_trajectory")
        self.judgements: Counter[int] = Counter()
        self.node.create_subscription(
            AssuranceStatus, f"{MONITOR}/output/status", self._on_status, qos.LATCHED
        )
        self.answered = 0
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_health, qos.EVENTS)
        self.sky = Sky(seed)
        self.time = 1.0
        """Simulated, s."""
        self.ticks = 0

    def _on_status(self, message: "AssuranceStatus") -> None:
        self.judgements[message.state] += 1

    def _on_health(self, message: "DiagnosticArray") -> None:
        for status in message.status:
            counts = [
                int(value.value) for value in status.values if value.key.startswith("answers ")
            ]
            if status.name.endswith("rlcas_runner"):
                self.answered = sum(counts)

    def wait(self) -> None:
        """Wait until runner and monitor listen."""
        end = time.monotonic() + PATIENCE
        every = (self.own, self.traffic, self.origin, self.clock)
        while not self.client.service_is_ready() or any(
            publisher.get_subscription_count() < 2 for publisher in every
        ):
            if time.monotonic() > end:
                raise SystemExit(f"runner and monitor did not come up within {PATIENCE:g} s")
            self.executor.spin_once(timeout_sec=0.02)
        from rlcas_msgs.msg import GeoReference

        self.origin.publish(GeoReference(latitude=ORIGIN[0], longitude=ORIGIN[1]))

    def tick(self) -> None:
        """Move everything on by a tick and publish it."""
        from builtin_interfaces.msg import Time
        from rosgraph_msgs.msg import Clock

        self.ticks += 1
        self.time += TICK
        self.sky.step()
        nanoseconds = round(self.time * 1e9)
        stamp = Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        self.clock.publish(Clock(clock=stamp))
        self.own.publish(exact_report("own", own_at(self.time), stamp))
        for number, (name, state) in enumerate(self.sky.others.items()):
            if (self.ticks + number) % 10 == 0:
                self.traffic.publish(exact_report(name, state, stamp))
        self.executor.spin_once(timeout_sec=0.0)

    def ask(self) -> tuple[float, int]:
        """Return how long the answer took, s, and its status; nan and -1 where there was none."""
        from rlcas_msgs.srv import GenerateTrajectory

        angle = (self.time * SPEED + AHEAD * np.arange(1, 10)) / RADIUS
        route = route_message((RADIUS * np.cos(angle)).tolist(), (RADIUS * np.sin(angle)).tolist())
        # As the monitor asks: without the slow stages of the search.
        began = time.perf_counter()
        future = self.client.call_async(GenerateTrajectory.Request(reason=2, route=route))
        while not future.done():
            self.executor.spin_once(timeout_sec=0.05)
            if time.perf_counter() - began > PATIENCE:
                self.client.remove_pending_request(future)
                return math.nan, -1
        answer = future.result()
        assert answer is not None
        return time.perf_counter() - began, answer.status


def main() -> int:
    """Measure and print."""
    parser = Parser(description=__doc__)
    add = parser.add_argument
    add("--requests", type=whole(100), default=10_000, help="requests to plan (default 10000)")
    help_text = "hours of simulated time (default 1)"
    add("--hours", type=real(0.02, 1_000.0, "h"), default=1.0, help=help_text)
    help_text = "simulated over real time, at most (default 10)"
    add("--rate", type=real(0.1, 1_000.0), default=10.0, help=help_text)
    add("--seed", type=whole(0), default=0, help="seed of the traffic (default 0)")
    options = parser.parse_args()
    with own_domain():
        summary = figures(measure(options))
    show(summary)
    report(summary, ("numpy", "ros-rclpy", "ros-rmw-fastrtps-cpp"))
    return 0 if summary["good"] else 1


class Flight(NamedTuple):
    """What the hours of flight gave."""

    took: list[float]  # of each request, s
    statuses: Counter[str]  # of the answers
    memory: list[list[float]]  # of runner and monitor from time to time, MiB
    simulated_s: float
    wall_s: float


class Soak(NamedTuple):
    """All that is judged."""

    flight: Flight
    answered: int  # as the runner counts
    judgements: int  # of the monitor
    aircraft: int  # that were there at some time
    alive: bool  # whether runner and monitor lived to the end
    exit_codes: list[int]


def fly(
    world: World, nodes: Sequence["subprocess.Popen[bytes]"], options: argparse.Namespace
) -> Flight:
    """Fly for the hours that are asked for, and ask evenly meanwhile."""
    ticks = round(options.hours * 3600.0 / TICK)
    due = np.linspace(50, ticks, options.requests, endpoint=False).astype(int).tolist()
    took, statuses, memory = [], Counter[str](), []
    began = time.perf_counter()
    for tick in range(ticks):
        world.tick()
        while len(took) < len(due) and due[len(took)] <= tick:
            seconds, status = world.ask()
            took.append(seconds)
            statuses[str(status)] += 1
        if tick % max(ticks // 200, 1) == 0:
            memory.append([resident_memory(node) for node in nodes])
        if tick % max(ticks // 20, 1) == 0:
            line = f"{100.0 * tick / ticks:.0f} %, {len(took)} requests"
            print(line, file=sys.stderr, flush=True)
        remaining = (tick + 1) * TICK / options.rate - (time.perf_counter() - began)
        if remaining > 0.0:
            world.executor.spin_once(timeout_sec=remaining)
    return Flight(took, statuses, memory, ticks * TICK, time.perf_counter() - began)


def measure(options: argparse.Namespace) -> Soak:
    """Start runner and monitor, fly and ask, and end them."""
    # An aircraft that has left the area is stale, and requests are refused, until it is forgotten.
    arguments = ["--ros-args", "--log-level", "fatal"]
    arguments += ["-p", "use_sim_time:=true", "-p", "forget_after:=8.0"]
    nodes = [start("ros_bridge.runner", *arguments), start("ros_bridge.monitor", *arguments)]
    try:
        world = World(options.seed)
        world.wait()
        flight = fly(world, nodes, options)
        for _ in range(30):  # until the runner has published its counts once more
            world.tick()
            time.sleep(0.01)
            world.executor.spin_once(timeout_sec=0.05)
        alive = all(node.poll() is None for node in nodes)
    finally:
        for node in nodes:
            node.terminate()
        codes = [node.wait(PATIENCE) for node in nodes]
    judgements = sum(world.judgements.values())
    return Soak(flight, world.answered, judgements, world.sky.created, alive, codes)


def figures(soak: Soak) -> dict[str, Any]:
    """Return the figures; ``good``: whether nothing grew or was lost."""
    flight = soak.flight
    times = np.array_split(np.array(flight.took), BLOCKS)
    memory = np.array_split(np.array(flight.memory), BLOCKS)
    # The first tenth warms up.
    first, last = memory[1].mean(axis=0), memory[-1].mean(axis=0)
    medians = [1e3 * float(np.median(block)) for block in times]
    lost = flight.statuses["-1"] + flight.statuses["255"]
    grown = float((last - first).max()) > GROWTH_MIB or medians[-1] > GROWTH * medians[0]
    answered = lost == 0 and soak.answered >= len(flight.took)
    return {
        "benchmark": "ros_soak",
        "requests": len(flight.took),
        "statuses": dict(flight.statuses),
        "answers_of_the_runner": soak.answered,
        "judgements": soak.judgements,
        "simulated_s": flight.simulated_s,
        "wall_s": flight.wall_s,
        "aircraft": soak.aircraft,
        "median_ms_first": medians[0],
        "median_ms_last": medians[-1],
        "p99_ms_first": 1e3 * float(np.quantile(times[0], 0.99)),
        "p99_ms_last": 1e3 * float(np.quantile(times[-1], 0.99)),
        "runner_mib_second": float(first[0]),
        "runner_mib_last": float(last[0]),
        "monitor_mib_second": float(first[1]),
        "monitor_mib_last": float(last[1]),
        "exit_codes": soak.exit_codes,
        "good": answered and not grown and soak.alive and soak.exit_codes == [0, 0],
    }


if __name__ == "__main__":
    run_cli(main)
