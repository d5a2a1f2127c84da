"""DAIDALUS as a resolver of ``eval.compare``: its bands and resolutions of the horizontal
direction, and a course to the goal where they are free.

``python -m eval.compare --baseline benchmarks.daidalus.in_the_loop:daidalus_f3442``. The program is
the user's: ``in_the_loop.cpp``, compiled beside https://github.com/nasa/daidalus (``make lib`` in
its folder ``C++``, then ``g++ -std=c++17 -O2 -Iinclude -o in_the_loop PATH/in_the_loop.cpp
lib/DAIDALUS2.a``) and named by ``DAIDALUS_LOOP``. It steers at once, once a time step, holds its
speed and level, and hears the same reports as every other resolver.
"""

import os
import subprocess
import weakref
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from agents.baselines.baselines import Observation, check_observation, course_to_goal, steer
from benchmarks.daidalus.program import track_of
from commands.command import InputError
from envs.aircraft import Aircraft
from envs.altitudes import LEVEL

VARIABLE = "DAIDALUS_LOOP"
"""Environment variable that names the program."""

_BUILD = "compile benchmarks/daidalus/in_the_loop.cpp as benchmarks/daidalus/in_the_loop.py says"


def locate() -> Path:
    """Return the program of the environment variable.

    Raises:
        InputError: it is not named, or is no program.
    """
    name = os.environ.get(VARIABLE, "")
    path = Path(name)
    if not name or not path.is_file() or not os.access(path, os.X_OK):
        problem = f"{VARIABLE} is {name!r}" if name else f"{VARIABLE} is not set"
        raise InputError(f"{problem}; expected the path of DAIDALUS in the loop: {_BUILD}")
    return path.resolve()


@dataclass
class Daidalus:
    """DAIDALUS with the volume of a standard, a resolver that turns."""

    aircraft: Aircraft
    volume: str
    program: Path = field(default_factory=locate)
    _running: "subprocess.Popen[str] | None" = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, object]:
        """Return what another process is sent: it starts a program of its own."""
        return {**self.__dict__, "_running": None}

    def decide(self, observation: Observation, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions ``[M, 2]`` and the memory, which is not used.

        Raises:
            InputError: the program ends or answers no course.
        """
        observation = check_observation(observation)
        course = np.radians(90.0 - self._tracks(_request(observation, self.aircraft)))
        steering = steer(observation.own, course, self.aircraft)
        return np.stack([np.zeros_like(steering), steering], axis=-1), memory

    def _tracks(self, request: list[str]) -> np.ndarray:
        """Return the tracks that the program answers, deg, a request's line each."""
        running = self._running or self._start()
        assert running.stdin is not None and running.stdout is not None
        try:
            running.stdin.write("\n".join([str(len(request)), *request, ""]))
            running.stdin.flush()
            return np.array([float(running.stdout.readline()) for _ in request])
        except (OSError, ValueError):
            raise InputError(
                f"{self.program}: ends with {running.poll()}, expected a course; {_BUILD}"
            ) from None

    def _start(self) -> "subprocess.Popen[str]":
        limits = self.aircraft.limits
        numbers = np.degrees(limits.yaw_rate_max), limits.speed_min, limits.speed_max
        command = [str(self.program), self.volume, *(f"{number:.9g}" for number in numbers)]
        self._running = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        weakref.finalize(self, _end, self._running)
        return self._running


def _end(running: "subprocess.Popen[str]") -> None:
    """End a program: it stops where nothing more is asked."""
    running.communicate()


def _request(observation: Observation, aircraft: Aircraft) -> list[str]:
    """Return what the program is asked, a line an encounter."""
    own, others = observation.own, observation.intruders
    above, climb = (
        np.zeros(others.x.shape) if values is None else values
        for values in (observation.above, observation.climb)
    )
    time = aircraft.t_max - observation.time_left
    goal = course_to_goal(observation, aircraft)
    lines = []
    for row, number in enumerate(np.asarray(observation.number)):
        there = np.flatnonzero(observation.mask[row])
        ownship = own.x[row], own.y[row], LEVEL, track_of(own.heading[row]), own.speed[row], 0.0
        numbers = [float(value) for value in (time, *ownship, track_of(goal[row]))]
        words = [str(int(number)), *(f"{value:.9g}" for value in numbers), str(there.size)]
        for place in there:
            at = (row, place)
            state = (
                *(others.x[at], others.y[at], LEVEL + above[at]),
                *(track_of(others.heading[at]), others.speed[at], climb[at]),
            )
            words += [f"{float(value):.9g}" for value in state]
        lines.append(" ".join(words))
    return lines


def daidalus_f3442(aircraft: Aircraft) -> Daidalus:
    """Return DAIDALUS with the well-clear volume of ASTM F3442."""
    return Daidalus(aircraft, "f3442")


def daidalus_do365(aircraft: Aircraft) -> Daidalus:
    """Return DAIDALUS with its configuration for DO-365B, Phase I."""
    return Daidalus(aircraft, "do365_en_route")


def daidalus_non_cooperative(aircraft: Aircraft) -> Daidalus:
    """Return DAIDALUS with its configuration for DO-365B, non-cooperative traffic."""
    return Daidalus(aircraft, "do365_non_cooperative")
