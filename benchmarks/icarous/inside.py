"""Flies one mission by ICAROUS: run by its own Python, in its own folder, with nothing of ours.

Reads a mission as JSON from a file and writes one line of JSON a sample to another: time, x and y
of the ownship and of each intruder, m in the frame of the simulation. The last line holds the
processor time of the slowest step of ICAROUS, s.
"""

import json
import math
import resource
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

EVERY = 5  # steps of the simulation, 0.05 s each, between two samples


class Timed:
    """ICAROUS's core, whose steps are timed."""

    def __init__(self, core: Any) -> None:
        self._core, self.slowest = core, 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._core, name)

    def Run(self, now: float) -> None:  # noqa: N802 - ICAROUS's name
        """Run one step."""
        began = time.process_time()
        self._core.Run(now)
        self.slowest = max(self.slowest, time.process_time() - began)


def main(given: str, output: str) -> None:
    """Fly the mission of a file."""
    with Path(given).open(encoding="utf-8") as file:
        asked = json.load(file)
    # Its search for a path can go on for ever.
    resource.setrlimit(resource.RLIMIT_CPU, (asked["patience"], asked["patience"] + 5))
    helper = import_module("icutils.ichelper")
    home = asked["home"]
    sim = import_module("SimEnvironment").SimEnvironment(verbose=0)
    sim.AddWind([(asked["wind_from"], asked["wind_speed"])])
    sim.windFrom, sim.windSpeed = asked["wind_from"], asked["wind_speed"]
    for number, one in enumerate(asked["intruders"], 1):
        sim.AddTraffic(number, home, *one, 0.0, transmitter="GroundTruth")
    flown = _ownship(asked, helper, home)
    sim.AddIcarousInstance(flown, time_limit=asked["limit"])
    with Path(output).open("w", encoding="utf-8") as file:
        _record(flown, sim, asked, file)
        sim.RunSimulation()
        print(json.dumps({"slowest": flown.core.slowest}), file=file)


def _ownship(asked: Any, helper: Any, home: Any) -> Any:
    flown = import_module("Icarous").Icarous(
        home,
        simtype="UAM_VTOL",
        verbose=0,
        daaConfig=asked["parameters"],
        icConfig=asked["parameters"],
    )
    vehicle = flown.ownship
    vehicle.turnRate = asked["turn_rate"]
    vehicle.accel, vehicle.daccel = asked["acceleration"], -asked["acceleration"]
    points = [
        [*helper.gps_offset(home[0], home[1], x, y), asked["altitude"], asked["cruise"]]
        for x, y in asked["waypoints"]
    ]
    waypoints = helper.ConstructWaypointsFromList([[*one, [0, 0, 0], [0, 0, 0]] for one in points])
    flown.InputFlightplan(waypoints, setInitialVelocity=True)
    vehicle.vel0[:] = vehicle.vel
    vehicle.pos[2] = vehicle.pos0[2]
    fences = [
        {
            "id": number,
            "type": fence["type"],
            "floor": -10.0,
            "roof": 10_000.0,
            "numV": len(fence["places"]),
            "vertices": [helper.gps_offset(home[0], home[1], x, y) for x, y in fence["places"]],
        }
        for number, fence in enumerate(asked["fences"])
    ]
    flown.core.InputGeofence(fences)
    flown.core = Timed(flown.core)
    vehicle.InputCommand = _autopilot(vehicle.InputCommand, asked)
    return flown


def _autopilot(command: Any, asked: Any) -> Any:
    """Return what takes ICAROUS's commands, which are over the ground, and gives the vehicle, which
    takes them as through the air, those that fly them in the wind within its speeds.
    """
    towards, blows = math.radians(asked["wind_from"] + 180.0), asked["wind_speed"]

    def fly(track: float, speed: float, climb: float) -> None:
        off = towards - math.radians(track)
        along, across = blows * math.cos(off), blows * math.sin(off)
        airspeed = math.hypot(speed - along, across)
        airspeed = min(max(airspeed, asked["speed_min"]), asked["speed_max"])
        heading = track - math.degrees(math.asin(across / airspeed))
        command(heading % 360.0, airspeed, climb)

    return fly


def _record(flown: Any, sim: Any, asked: Any, file: Any) -> None:
    """Write a sample every few steps, and end the flight where it arrives."""
    run, complete = flown.Run, flown.CheckMissionComplete
    goal, steps = asked["waypoints"][-1], [0]

    def record() -> Any:
        result = run()
        if steps[0] % EVERY == 0:
            places = [flown.ownship.pos, *(one.pos for one in sim.tfList)]
            row = [flown.currTime, *(float(value) for at in places for value in at[:2])]
            print(json.dumps(row), file=file, flush=True)
        steps[0] += 1
        return result

    def done() -> bool:
        x, y = (float(value) for value in flown.ownship.pos[:2])
        return math.hypot(x - goal[0], y - goal[1]) < asked["end"] or complete()

    flown.Run, flown.CheckMissionComplete = record, done


if __name__ == "__main__":
    main(*sys.argv[1:])
