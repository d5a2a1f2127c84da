"""What the program asks of a processor: its share of a core among many aircraft, and the time from
a request to its plan.

    python -m benchmarks.ardupilot.load [--aircraft 30] [--seconds 60] [--encounters 10]

*Share*: ArduPlane's simulation and the program, a process of its own, run in real time; the
aircraft fly away from ours at the mission's height. The share is processor time over the
autopilot's time, first while the mission is free, then with one more aircraft that crosses its way
and is flown round.

*Plans*: encounters of :mod:`benchmarks.ardupilot.encounters` are flown by ours; each plan's time
from its request, by the clock and in processor time. Other work on the machine lengthens the first
and hardly the second. The last line is one JSON object.
"""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.ardupilot.chaser import Chaser
from benchmarks.ardupilot.encounters import encounter
from benchmarks.ardupilot.reach import Ground, flight, program_process, wait
from benchmarks.measure import processor_time, report
from commands.command import Parser, real, whole
from ros_bridge.mavlink.flight import fly
from ros_bridge.mavlink.messages import Mode

_NEAR, _FAR = 3_000.0, 12_000.0  # m from ours, within which the others begin
_SETTLED = 15.0  # s until everything has begun
_CROSSES = 60.0  # s until the one that crosses is there
_UNTIL = 110.0  # s of an encounter


def shares(aircraft: int, seconds: float, instance: int = 13) -> dict[str, float]:
    """Return the share of a core without and with a conflict, among so many aircraft, over so many
    seconds each.
    """
    draw = np.random.default_rng(0)
    with flight(instance, 1.0) as sitl:
        ground, chaser = Ground(sitl), Chaser(0)
        with program_process(sitl.address) as program:
            wait(ground, chaser, 1.0)
            for _ in range(aircraft):
                chaser.pass_aside(ground.row, float(draw.uniform(_NEAR, _FAR)))
            wait(ground, chaser, _SETTLED)
            free = _share(program.pid, ground, chaser, seconds)
            chaser.add_crossing(ground.row, ground.course, _CROSSES)
            if not wait(ground, chaser, _CROSSES, lambda: ground.mode == Mode.GUIDED):
                raise RuntimeError(f"the program does not take over: {ground.texts[-3:]}")
            flown = _share(program.pid, ground, chaser, 0.5 * seconds)
    return {"free": round(free, 3), "flown_round": round(flown, 3)}


def _share(pid: int, ground: Ground, chaser: Chaser, seconds: float) -> float:
    """Return a process's share of a core over so many seconds of the autopilot's time."""
    began, before = ground.row.time, processor_time(pid)
    wait(ground, chaser, seconds)
    return (processor_time(pid) - before) / (ground.row.time - began)


def plans(encounters: int, instance: int = 13) -> dict[str, Any]:
    """Return what plans took from their requests, ms."""
    flights = [
        fly(encounter(0, number), "ours_horizontal", instance=instance, speedup=40.0, until=_UNTIL)
        for number in range(encounters)
    ]
    took = 1e3 * np.array([plan for flight in flights for plan in flight.planned])
    times: dict[str, Any] = {"plans": len(took)}
    for name, column in zip(("clock", "processor"), took.T, strict=True):
        times |= {f"{name}_ms_median": round(float(np.median(column)), 1)}
        times |= {f"{name}_ms_p99": round(float(np.percentile(column, 99.0)), 1)}
    return times


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print."""
    parser = Parser(prog="python -m benchmarks.ardupilot.load", description=__doc__)
    add = parser.add_argument
    add("--aircraft", type=whole(0), default=30, help="aircraft in sight (default 30)")
    add(
        "--seconds",
        type=real(1.0, 3_600.0, "s"),
        default=60.0,
        help="time over which a share is taken, s (default 60)",
    )
    add(
        "--encounters",
        type=whole(0),
        default=10,
        help="encounters flown for the plans (default 10)",
    )
    options = parser.parse_args(arguments)
    figures = {"benchmark": "ardupilot.load", "aircraft": options.aircraft}
    if options.aircraft:
        figures["share_of_a_core"] = shares(options.aircraft, options.seconds)
    if options.encounters:
        figures["request_to_plan"] = plans(options.encounters)
    figures["load_average"] = round(os.getloadavg()[0], 1)
    report(figures, ("pymavlink",))
    return 0


if __name__ == "__main__":
    from commands.command import run_cli

    run_cli("benchmarks.ardupilot.load:main")
