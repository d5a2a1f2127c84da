"""Runner, monitor and simulator together, faster than real time, without a ROS installation.

    python -m ros_bridge.demo [--aircraft uas] [--random 50] [--vehicle c208] [--record FILE]
    python -m ros_bridge.demo --display --rate 4            watch it in the browser

Starts runner and monitor as processes of their own on a domain of their own, flies encounters with
the simulator and prints a table: the first answer, the smallest distance since the first SAFE plan
was taken up, the largest distance from the plans flown, the plans that the monitor requested, and
what answers took. A second table judges every plan that was flown: whether the flight stayed
within the margin that SAFE assumes, and whether the separation that SAFE promises was kept.

Exit code: 0 if plans called SAFE were flown, every one kept the separation and out of areas and no
flight failed, 1 if not, 2 for bad input.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from agents.planner.request.options import Maneuvers
from commands.command import InputError, Parser, require, run_cli
from envs.aircraft import Aircraft
from envs.areas import Area
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.random_areas import MOST, random_areas
from envs.scenarios import expected, resolve, scenario
from ros_bridge.core.aircraft import aircraft_of, load_policy
from ros_bridge.transport.children import free_domain, start_node, stop

if TYPE_CHECKING:
    from envs.encounters import Encounter
    from ros_bridge.nodes.simulator import Simulator

FOUR = "crossing_left,crossing_right,head_on,same_course"
"""The paper's scenarios."""

MARGINS = {"kinematic": 0.025, "point_mass": 0.05, "c208": 0.05}
"""Added to the separation for what each vehicle leaves of its plan, in separations
(docs/howto/ros.md).
"""

_OPTIONS = (
    ("scenarios", FOUR, f"separated by commas, or none; {expected()}"),
    ("each", 1, "encounters of each scenario"),
    ("random", 0, "further encounters, of the scenario circle"),
    ("areas", 0, "random areas along the way of each, which must not be entered"),
    ("seed", 0, "of the encounters"),
    ("rate", 40.0, "times real time, at most"),
    ("deciding-rate", 1.0, "the same while a plan is sought"),
    ("position-std", 0.0, "noise of the traffic's positions, one sigma, m"),
    ("velocity-std", 0.0, "noise of the traffic's velocities, one sigma, m/s"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly the demonstration and return the exit code."""
    options = _parser().parse_args(arguments)
    if options.record is not None:
        require("--record", "mcap", "rosidl_adapter")
    if options.display:
        require("--display", "websockets")
    try:
        aircraft = aircraft_of(options.aircraft, options.policy)
        load_policy(options.policy).for_aircraft(aircraft, outside=options.outside_domain)
        planned = list(_encounters(options, aircraft))
        with free_domain() as domain:
            # Before ROS is loaded: no other graph is disturbed.
            os.environ |= {
                "ROS_DOMAIN_ID": str(domain),
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            }
            return _run(options, aircraft, planned)
    except (ValueError, RuntimeError) as error:
        raise InputError(str(error)) from error


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m ros_bridge.demo", description=__doc__)
    for name, default, meaning in _OPTIONS:
        parser.add_argument(
            f"--{name}", type=type(default), default=default, help=f"{meaning} (default {default})"
        )
    parser.add_argument(
        "--vehicle", default="kinematic", choices=MARGINS, help="of the ownship (default kinematic)"
    )
    margins = ", ".join(f"{name} {margin:g}" for name, margin in MARGINS.items())
    parser.add_argument(
        "--margin",
        type=float,
        help=f"m added to the separation (default, in separations: {margins})",
    )
    parser.add_argument(
        "--wind",
        type=float,
        nargs=2,
        metavar=("EAST", "NORTH"),
        default=(0.0, 0.0),
        help="that all fly in, m/s towards east and north (default 0 0)",
    )
    parser.add_argument(
        "--maneuvers",
        default="horizontal",
        choices=[choice.value for choice in Maneuvers],
        help="what plans may do; vertical needs an aircraft whose file says how it climbs, such "
        "as c208 (default horizontal)",
    )
    parser.add_argument(
        "--aircraft",
        default="",
        metavar="FILE",
        help="file, or a name: uas (default: the policy's)",
    )
    parser.add_argument(
        "--policy", default="", metavar="FILE", help="policy file (default: the one that ships)"
    )
    outside = "what becomes of an aircraft outside the policy's family (default refuse)"
    parser.add_argument(
        "--outside-domain", default="refuse", choices=("refuse", "allow"), help=outside
    )
    parser.add_argument(
        "--record", type=Path, metavar="FILE.mcap", help="record the graph (default: no recording)"
    )
    parser.add_argument(
        "--display",
        action="store_true",
        help="serve the traffic display meanwhile, at the address that it prints",
    )
    verbose_help = "show what the nodes log"
    parser.add_argument(
        "--verbose",
        dest="level",
        action="store_const",
        const="info",
        default="fatal",
        help=verbose_help,
    )
    return parser


class _Planned(NamedTuple):
    """An encounter that is to be flown."""

    name: str
    encounter: "Encounter"  # one
    number: int  # of its scenario


def _encounters(options: argparse.Namespace, aircraft: Aircraft) -> Iterator[_Planned]:
    """Yield what is to be flown, or raise ValueError for options that cannot be."""
    from envs.starts import encounters_of_seed
    from envs.trees import take

    _check_numbers(options, aircraft)
    named = [name.strip() for name in options.scenarios.split(",")]
    named = [name for name in named if name not in ("", "none")]
    groups = [(name, options.each) for name in named]
    if options.random:
        groups.append(("circle", options.random))
    if not groups:
        raise ValueError("--scenarios is none and --random 0, expected something to fly")
    for name, count in groups:
        resolve(name)
        batch = encounters_of_seed(scenario(name, aircraft), options.seed, 0, count)
        for number in range(count):
            yield _Planned(f"{name} {number}", take(batch, [number]), number)


def _check_numbers(options: argparse.Namespace, aircraft: Aircraft) -> None:
    for name, least in (("each", 1), ("random", 0), ("areas", 0), ("seed", 0)):
        if getattr(options, name) < least:
            raise ValueError(f"--{name} is {getattr(options, name)}, expected {least} or more")
    if options.areas > MOST:
        raise ValueError(f"--areas is {options.areas}, expected {MOST} at most")
    climbs = options.maneuvers != Maneuvers.HORIZONTAL.value
    if climbs and aircraft.vertical is None:
        problem = f"--maneuvers is {options.maneuvers}, expected horizontal"
        raise ValueError(f"{problem}: the aircraft states no limits of climb and descent")
    if climbs and options.vehicle != "kinematic":
        raise ValueError(f"--vehicle is {options.vehicle}, expected kinematic: no other climbs")
    largest = 5.0 * aircraft.separation
    if options.margin is not None and not 0.0 <= options.margin <= largest:
        raise ValueError(f"--margin is {options.margin:g} m, expected 0 to {largest:g} m")


def _run(options: argparse.Namespace, aircraft: Aircraft, planned: Sequence[_Planned]) -> int:
    """Fly, print the tables, and return the exit code."""
    from ros_bridge.sim.flight_log import keep_promises

    margin = options.margin
    if margin is None:
        margin = MARGINS[options.vehicle] * aircraft.separation
    simulator = _simulator(options)
    problem = _fly(simulator, planned, _nodes(options, margin), options)
    if simulator.logs:
        _print_tables(simulator, planned, options, margin)
    if problem is not None:
        raise problem
    if not simulator.logs:
        raise ValueError("nothing was flown to its end")
    if options.record is not None:
        print(f"recorded: {options.record} ({options.record.stat().st_size / 1e6:.1f} MB)")
    return 0 if keep_promises(simulator.logs) and len(simulator.logs) == len(planned) else 1


def _shared(options: argparse.Namespace) -> dict[str, str]:
    """Return the parameters of all nodes."""
    return {"aircraft": options.aircraft, "policy_file": options.policy}


def _nodes(options: argparse.Namespace, margin: float) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes that are processes of their own, by their kinds."""
    shared = _shared(options) | {"margin": float(margin), "use_sim_time": True}
    shared["maneuvers"] = options.maneuvers
    return {"runner": shared | {"outside_domain": options.outside_domain}, "monitor": shared}


def _simulator(options: argparse.Namespace) -> "Simulator":
    """Return the simulator in a new context of ROS, or raise ValueError."""
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.parameter import Parameter

    from ros_bridge.nodes.simulator import Simulator

    values = _shared(options) | {
        "vehicle": options.vehicle,
        "rate": options.rate,
        "deciding_rate": options.deciding_rate,
        "wind_east": options.wind[0],
        "wind_north": options.wind[1],
        "traffic_position_std": options.position_std,
        "traffic_velocity_std": options.velocity_std,
    }
    rclpy.init(args=["--ros-args", "--log-level", options.level])
    try:
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        return Simulator(parameter_overrides=overrides)
    except (ValueError, ParameterException) as error:
        rclpy.try_shutdown()
        raise ValueError(str(error)) from error


def _print_tables(
    simulator: "Simulator",
    planned: Sequence[_Planned],
    options: argparse.Namespace,
    margin: float,
) -> None:
    from ros_bridge.sim.flight_log import table
    from ros_bridge.sim.plan_flight import plans_table

    if not options.areas:  # nothing is known of what areas leave
        _evaluate(simulator, planned, margin)
    print(
        f"vehicle {options.vehicle}, margin {margin:g} m, seed {options.seed}, runner and "
        "monitor as processes\n"
    )
    print(table(simulator.logs))
    flights = [(log.name, log.flown) for log in simulator.logs]
    print("\nplans that were flown\n")
    print(plans_table(flights, simulator.logs[0].required, margin))


def _fly(
    simulator: "Simulator",
    planned: Sequence[_Planned],
    nodes: Mapping[str, Mapping[str, Any]],
    options: argparse.Namespace,
) -> OSError | None:
    """Fly encounters beside nodes of these parameters; return why a recording could not be
    written.
    """
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(simulator)
    processes: list[subprocess.Popen[bytes]] = []
    try:
        with _recording(simulator, options.record):
            for name, parameters in nodes.items():
                processes.append(_start(name, parameters, options.level))
            if options.display:
                processes.append(_start_display(options.level))
            for flight in planned:
                areas = _areas(options, flight, simulator.aircraft)
                simulator.begin(flight.encounter, flight.name, flight.number, areas)
                while simulator.flying:
                    executor.spin_once(timeout_sec=0.1)
                    _check_alive(processes)
                print(".", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
    except (KeyboardInterrupt, ExternalShutdownException):
        print("\ninterrupted; what was flown:", file=sys.stderr)
    except OSError as error:
        return error
    finally:
        # A second Ctrl-C must not break the cleaning up.
        handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
        stop(processes)
        executor.shutdown()
        simulator.destroy_node()
        rclpy.try_shutdown()
        signal.signal(signal.SIGINT, handler)
    return None


def _recording(simulator: "Simulator", file: Path | None) -> AbstractContextManager[object]:
    """Return what records the graph into a file while it is entered."""
    from ros_bridge.transport.recording import Recorder

    if file is None:
        return nullcontext()
    return closing(Recorder(simulator, file, lambda: simulator.now))


def _areas(
    options: argparse.Namespace, flight: _Planned, aircraft: Aircraft
) -> tuple[Area, ...] | None:
    """Return random areas along the way of an encounter; None where none are asked for."""
    if not options.areas:
        return None
    own: VehicleState[Air] = VehicleState(*(float(field[0]) for field in flight.encounter.own))
    goal = float(flight.encounter.goal_x[0]), float(flight.encounter.goal_y[0])
    return random_areas(options.seed, flight.number, options.areas, own, goal, aircraft)


def _start(name: str, parameters: Mapping[str, Any], level: str) -> "subprocess.Popen[bytes]":
    """Start a node with those of the parameters that are not empty."""
    arguments = [
        part
        for key, value in parameters.items()
        if value != ""
        for part in ("-p", f"{key}:={value}")
    ]
    return start_node(f"ros_bridge.{name}", "--ros-args", "--log-level", level, *arguments)


def _start_display(level: str) -> "subprocess.Popen[bytes]":
    clock = ("--ros-args", "-p", "use_sim_time:=true", "--log-level", level)
    return start_node("ros_bridge.display", "--port", "0", *clock)


def _check_alive(processes: "Sequence[subprocess.Popen[bytes]]") -> None:
    """Raise ValueError where one of the processes has ended."""
    exit_codes = [process.returncode for process in processes if process.poll() is not None]
    if exit_codes:
        raise ValueError(f"a node ended with exit code {exit_codes[0]} (--verbose shows why)")


def _evaluate(simulator: "Simulator", planned: Sequence[_Planned], margin: float) -> None:
    """Note which encounters are not proven unresolvable at the separation planned with."""
    import numpy as np

    from agents.resolvability.classify import Verdict, classify
    from ros_bridge.sim.flight_log import NEVER_ASKED

    aircraft = simulator.aircraft
    rules = aircraft.rules()._replace(separation=aircraft.separation + margin)
    for log, flight in zip(simulator.logs, planned, strict=False):
        if log.first != NEVER_ASKED:
            # The first second is the time to receive all and to answer: what is lost by then
            # counts, too.
            solved = np.array([log.safe_at is not None])
            label = classify(flight.encounter, rules, aircraft.limits, solved=solved).verdict[0]
            log.maybe_resolvable = bool(label != Verdict.UNRESOLVABLE)


if __name__ == "__main__":
    run_cli("ros_bridge.demo:main")
