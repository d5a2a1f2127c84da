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
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

EVERY = 5  # steps of the simulation, 0.05 s each, between two samples


class Timed:
    """ICAROUS's core, whose steps are timed."""

    def __init__(self, core: Any) -> None:
        self._core, self.slowest = core, 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._core, name)

    def Run(self, moment: float) -> None:  # noqa: N802 - ICAROUS's name
        """Run one step."""
        began = time.process_time()
        self._core.Run(moment)
        self.slowest = max(self.slowest, time.process_time() - began)


def main(mission_file: str, output: str) -> None:
    """Fly the mission of a file."""
    with Path(mission_file).open(encoding="utf-8") as file:
        mission = json.load(file)
    # Its search for a path can go on for ever.
    resource.setrlimit(resource.RLIMIT_CPU, (mission["patience"], mission["patience"] + 5))
    helper = import_module("icutils.ichelper")
    home = mission["home"]
    sim = import_module("SimEnvironment").SimEnvironment(verbose=0)
    sim.AddWind([(mission["wind_from"], mission["wind_speed"])])
    sim.windFrom, sim.windSpeed = mission["wind_from"], mission["wind_speed"]
    for number, intruder in enumerate(mission["intruders"], 1):
        sim.AddTraffic(number, home, *intruder, 0.0, transmitter="GroundTruth")
    flown = _ownship(mission, helper, home)
    sim.AddIcarousInstance(flown, time_limit=mission["limit"])
    with Path(output).open("w", encoding="utf-8") as file:
        recorder = Recorder(flown, sim, mission, file)
        flown.Run, flown.CheckMissionComplete = recorder.run, recorder.is_complete
        sim.RunSimulation()
        print(json.dumps({"slowest": flown.core.slowest}), file=file)


def _ownship(mission: dict[str, Any], helper: Any, home: list[float]) -> Any:
    """Return ICAROUS with the mission, its fences and the aircraft's limits."""
    flown = import_module("Icarous").Icarous(
        home,
        simtype="UAM_VTOL",
        verbose=0,
        daaConfig=mission["parameters"],
        icConfig=mission["parameters"],
    )
    vehicle = flown.ownship
    vehicle.turnRate = mission["turn_rate"]
    vehicle.accel, vehicle.daccel = mission["acceleration"], -mission["acceleration"]
    points = [
        [*helper.gps_offset(home[0], home[1], x, y), mission["altitude"], mission["cruise"]]
        for x, y in mission["waypoints"]
    ]
    waypoints = helper.ConstructWaypointsFromList(
        [[*point, [0, 0, 0], [0, 0, 0]] for point in points]
    )
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
        for number, fence in enumerate(mission["fences"])
    ]
    flown.core.InputGeofence(fences)
    flown.core = Timed(flown.core)
    vehicle.InputCommand = _autopilot(vehicle.InputCommand, mission)
    return flown


def _autopilot(
    command: Callable[[float, float, float], Any], mission: dict[str, Any]
) -> Callable[[float, float, float], None]:
    """Return a function that takes ICAROUS's commands, which are over the ground.

    The vehicle takes commands as through the air. It is given those that fly ICAROUS's in the wind,
    within its speeds.
    """
    towards, wind = math.radians(mission["wind_from"] + 180.0), mission["wind_speed"]

    def fly(track: float, speed: float, climb: float) -> None:
        off = towards - math.radians(track)
        along, across = wind * math.cos(off), wind * math.sin(off)
        airspeed = math.hypot(speed - along, across)
        airspeed = min(max(airspeed, mission["speed_min"]), mission["speed_max"])
        heading = track - math.degrees(math.asin(across / airspeed))
        command(heading % 360.0, airspeed, climb)

    return fly


class Recorder:
    """Writes a sample every few steps of the simulation, and ends the flight where it arrives.

    Args:
        flown: ICAROUS's ownship, whose two methods of these names are called.
        sim: the simulation.
        asked: the mission.
        file: of the samples.
    """

    def __init__(self, flown: Any, sim: Any, mission: dict[str, Any], file: TextIO) -> None:
        self._flown, self._sim, self._file = flown, sim, file
        self._run, self._complete = flown.Run, flown.CheckMissionComplete
        self._goal, self._end = mission["waypoints"][-1], mission["end"]
        self._steps = 0

    def run(self) -> Any:
        """Run one step of the simulation."""
        result = self._run()
        if self._steps % EVERY == 0:
            places = [self._flown.ownship.pos, *(intruder.pos for intruder in self._sim.tfList)]
            row = [self._flown.currTime, *(float(value) for at in places for value in at[:2])]
            print(json.dumps(row), file=self._file, flush=True)
        self._steps += 1
        return result

    def is_complete(self) -> bool:
        """Return whether the flight has arrived or ICAROUS ends it."""
        x, y = (float(value) for value in self._flown.ownship.pos[:2])
        away = math.hypot(x - self._goal[0], y - self._goal[1])
        return away < self._end or self._complete()


if __name__ == "__main__":
    main(*sys.argv[1:])
