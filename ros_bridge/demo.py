# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""Runner, monitor and simulator together, faster than real time, without a ROS installation.

    python -m ros_bridge.demo [--aircraft uas] [--random 50] [--vehicle c208] [--record FILE]

Starts runner and monitor as processes of their own on a domain of their own, flies encounters with the simulator and
prints a table: the first answer, the smallest distance since the first SAFE plan was taken up, the largest distance
from the plans flown, the plans that the monitor requested, and what answers took.

Exit code: 0 if every plan called SAFE kept the separation and no flight failed, 1 if not, 2 for bad input.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from envs.aircraft import Aircraft
from envs.edge.command import Parser, run_cli
from ros_bridge.core.aircraft import aircraft_of, loaded
from ros_bridge.transport.children import free_domain, started, stopped

if TYPE_CHECKING:
    from ros_bridge.nodes.simulator import Simulator
    from ros_bridge.sim.flight_log import FlightLog

FOUR = ("crossing_left", "crossing_right", "head_on", "same_course")
"""The paper's scenarios."""

MARGINS = {"kinematic": 0.025, "point_mass": 0.05, "c208": 0.05}
"""Added to the separation for what each vehicle leaves of its plan, in separations (docs/howto/ros.md)."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the demonstration and return the exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    try:
        aircraft = aircraft_of(options.aircraft, options.policy)
        loaded(options.policy).for_aircraft(aircraft, outside=options.outside_domain)
        encounters = list(_encounters(options, aircraft))
        with free_domain() as domain:
            # Before ROS is loaded: no other graph is disturbed.
            os.environ |= {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
            return _run(options, aircraft, encounters)
    except (ValueError, RuntimeError) as error:
        print(f"{parser.prog}: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m ros_bridge.demo", description=__doc__)
    parser.add_argument(
        "--scenarios", default=",".join(FOUR), help=f"names with commas, or none (default {','.join(FOUR)})"
    )
    parser.add_argument("--each", type=int, default=1, help="encounters of each scenario (default 1)")
    parser.add_argument("--random", type=int, default=0, help="further encounters, of the scenario circle (default 0)")
    parser.add_argument("--seed", type=int, default=0, help="of the encounters (default 0)")
    parser.add_argument("--vehicle", default="kinematic", help="kinematic, point_mass or c208 (default kinematic)")
    parser.add_argument("--rate", type=float, default=40.0, help="times real time, at most (default 40)")
    parser.add_argument("--deciding-rate", type=float, default=1.0, help="the same while a plan is sought (default 1)")
    margins = ", ".join(f"{name} {margin:g}" for name, margin in MARGINS.items())
    parser.add_argument("--margin", type=float, help=f"m added to the separation (default, in separations: {margins})")
    parser.add_argument("--aircraft", default="", metavar="FILE", help="file, or a name: uas (default: the policy's)")
    parser.add_argument("--policy", default="", metavar="FILE", help="policy file (default: the one that ships)")
    parser.add_argument(
        "--outside-domain",
        default="refuse",
        choices=("refuse", "allow"),
        help="what becomes of an aircraft outside the policy's family (default refuse)",
    )
    parser.add_argument("--position-std", type=float, default=0.0, help="noise of traffic, m one sigma (default 0)")
    parser.add_argument("--velocity-std", type=float, default=0.0, help="noise of traffic, m/s one sigma (default 0)")
    parser.add_argument("--record", type=Path, metavar="FILE.mcap", help="record the graph (default: no recording)")
    parser.add_argument("--verbose", action="store_true", help="show what the nodes log")
    return parser


def _encounters(options: argparse.Namespace, aircraft: Aircraft) -> Iterator[tuple[str, Any, int]]:
    from envs.encounters import scenario
    from envs.starts import numbered
    from envs.trees import take
    from ros_bridge.sim.world import VEHICLES

    if options.vehicle not in VEHICLES:
        raise ValueError(f"--vehicle is {options.vehicle!r}, expected one of {', '.join(VEHICLES)}")
    for name, least in (("each", 1), ("random", 0), ("seed", 0)):
        if getattr(options, name) < least:
            raise ValueError(f"--{name} is {getattr(options, name)}, expected {least} or more")
    most = 5.0 * aircraft.separation
    if options.margin is not None and not 0.0 <= options.margin <= most:
        raise ValueError(f"--margin is {options.margin:g} m, expected 0 to {most:g} m")
    named = [name for name in options.scenarios.split(",") if name not in ("", "none")]
    wanted = [(name, options.each) for name in named] + [("circle", options.random)] * (options.random > 0)
    if not wanted:
        raise ValueError("--scenarios is none and --random 0, expected something to fly")
    for name, count in wanted:
        every = numbered(scenario(name, aircraft), options.seed, 0, count)
        for number in range(count):
            yield f"{name} {number}", take(every, [number]), number


def _simulator(options: argparse.Namespace, level: str) -> "Simulator":
    try:
        import rclpy
        import rlcas_msgs  # noqa: F401
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name} is not installed; to have it: make ros") from error
    from rclpy.exceptions import ParameterException

    from ros_bridge.nodes.simulator import Simulator

    settings = {
        **_shared(options),
        "vehicle": options.vehicle,
        "rate": float(options.rate),
        "deciding_rate": float(options.deciding_rate),
        "traffic_position_std": float(options.position_std),
        "traffic_velocity_std": float(options.velocity_std),
    }
    given = [part for name, value in settings.items() for part in ("-p", f"{name}:={value}")]
    rclpy.init(args=["--ros-args", "--log-level", level, *given])
    try:
        return Simulator()
    except ValueError:
        rclpy.try_shutdown()
        raise
    except ParameterException as error:
        rclpy.try_shutdown()
        raise ValueError(f"{error} (times real time: 0.1 to 1000; noise: 0 to 500 m, 0 to 50 m/s)") from error


def _shared(options: argparse.Namespace) -> dict[str, str]:
    given = {"aircraft": options.aircraft, "policy_file": options.policy}
    return {name: value for name, value in given.items() if value}


def _run(options: argparse.Namespace, aircraft: Aircraft, encounters: Sequence[tuple[str, Any, int]]) -> int:
    from ros_bridge.sim.flight_log import kept, table

    level = "info" if options.verbose else "fatal"
    simulator = _simulator(options, level)
    margin = MARGINS[options.vehicle] * aircraft.separation if options.margin is None else options.margin
    unrecorded = _flown(simulator, options, encounters, margin, level)
    if unrecorded:
        print(f"\npython -m ros_bridge.demo: error: {unrecorded}", file=sys.stderr)
    elif not simulator.logs:
        raise ValueError("nothing was flown to its end")
    if simulator.logs:
        _evaluate(simulator.logs, [one for _, one, _ in encounters], aircraft, margin)
        print(f"vehicle {options.vehicle}, margin {margin:g} m, seed {options.seed}, runner and monitor as processes\n")
        print(table(simulator.logs))
    if options.record is not None and options.record.exists():
        print(f"recorded: {options.record} ({options.record.stat().st_size / 1e6:.1f} MB)")
    return 0 if not unrecorded and kept(simulator.logs) and len(simulator.logs) == len(encounters) else 1


def _flown(
    simulator: "Simulator",
    options: argparse.Namespace,
    encounters: Sequence[tuple[str, Any, int]],
    margin: float,
    level: str,
) -> str:
    """Fly encounters; return why the recording could not be written, or ""."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    from ros_bridge.transport.recording import Recorder

    executor = SingleThreadedExecutor()
    executor.add_node(simulator)
    nodes: list[subprocess.Popen[bytes]] = []
    recorder, unrecorded = None, ""
    try:
        if options.record is not None:
            recorder = Recorder(simulator, options.record, lambda: simulator.now)
        given = _shared(options) | {"margin": str(float(margin))}
        nodes = [
            _start("runner", level, given | {"outside_domain": options.outside_domain}),
            _start("monitor", level, given),
        ]
        for name, encounter, number in encounters:
            simulator.begin(encounter, name, number)
            while simulator.flying:
                executor.spin_once(timeout_sec=0.1)
                _alive(nodes)
            print(".", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    except (KeyboardInterrupt, ExternalShutdownException):
        print("\ninterrupted; what was flown:", file=sys.stderr)
    except OSError as error:
        unrecorded = _unwritten(error)
    finally:
        # A second Ctrl-C must not break the cleaning up.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        stopped(nodes)
        executor.shutdown()
        simulator.destroy_node()
        rclpy.try_shutdown()
        signal.signal(signal.SIGINT, before)
    try:
        if recorder is not None:
            recorder.close()
    except OSError as error:
        unrecorded = _unwritten(error)
    return unrecorded


def _unwritten(error: OSError) -> str:
    if error.filename is None:
        raise error
    return f"{error.filename} cannot be written: {error.strerror}"


def _evaluate(logs: "Sequence[FlightLog]", encounters: Sequence[Any], aircraft: Aircraft, margin: float) -> None:
    """Note which encounters can be resolved at the separation that was planned with.

    What is not proven unresolvable counts as resolvable; where no plan was requested nothing is noted.
    """
    import numpy as np

    from agents.resolvability.classify import Verdict, classify
    from ros_bridge.sim.flight_log import NEVER_ASKED

    rules = aircraft.rules()._replace(separation=aircraft.separation + margin)
    for log, encounter in zip(logs, encounters, strict=False):
        if log.first == NEVER_ASKED:
            continue
        # The first second is the time to receive all and to answer: what is lost by then counts, too.
        verdict = classify(encounter, rules, aircraft.limits, solved=np.array([log.safe_at is not None])).verdict[0]
        log.resolvable = bool(verdict != Verdict.UNRESOLVABLE)


def _start(name: str, level: str, settings: dict[str, str]) -> "subprocess.Popen[bytes]":
    given = ["-p", "use_sim_time:=true"]
    given += [part for key, value in settings.items() for part in ("-p", f"{key}:={value}")]
    return started(f"ros_bridge.{name}", "--ros-args", "--log-level", level, *given)


def _alive(nodes: Sequence["subprocess.Popen[bytes]"]) -> None:
    for node in nodes:
        if node.poll() is not None:
            raise ValueError(f"runner or monitor ended with exit code {node.returncode} (--verbose shows why)")


if __name__ == "__main__":
    run_cli(main)
