"""DAIDALUS's program ``DaidalusBatch``: what it is given and what it answers.

The program is the user's: built from https://github.com/nasa/daidalus (``make`` in its folder
``C++``), nothing of it is part of this toolkit.
"""

import os
import re
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.assurance.alerts import Alerting
from commands.command import InputError
from envs.traffic.tracks import Track

VARIABLE = "DAIDALUS_BATCH"
"""Environment variable that names the program."""

_BUILD = "build it by make in the folder C++ of https://github.com/nasa/daidalus"
HIGH = 1_000_000.0
"""Height of a cylinder that no altitude leaves, m."""

_HIGHEST = 20_000.0  # m, the highest altitude
_PATIENCE = 600.0  # s that a scenario may take


class Setting(NamedTuple):
    """What both sides are told."""

    separation: float  # radius of the cylinder, m
    look_ahead: float  # s
    turn_rate: float  # rad/s
    acceleration: float  # either way, m/s^2
    speed_min: float  # m/s
    speed_max: float  # m/s
    step_deg: float  # between headings
    step_speed: float  # m/s
    height: float  # of the cylinder above and below its middle, m
    vertical_acceleration: float  # either way, m/s^2
    climb: float  # greatest vertical speed, either way, m/s
    vertical_rate: float  # with which an altitude is climbed or descended to, m/s
    step_climb: float  # m/s, between vertical speeds
    step_altitude: float  # m


class Interval(NamedTuple):
    """A stretch of headings, deg clockwise from north, speeds or vertical speeds, m/s, or
    altitudes, m.
    """

    low: float
    high: float
    region: str  # NONE where it is free


class Second(NamedTuple):
    """What the program says at one time of a scenario."""

    time: float  # s
    headings: list[Interval]
    speeds: list[Interval]
    climbs: list[Interval]
    altitudes: list[Interval]
    loss: dict[str, float]  # by intruder: time until it is in the volume, s
    level: dict[str, int]  # of its alert


def locate(argument: str | None) -> Path:
    """Return the program, from an argument or the environment variable.

    Raises:
        InputError: it is not named, or is no program.
    """
    name = argument or os.environ.get(VARIABLE, "")
    if not name:
        raise InputError(
            f"DAIDALUS is missing: expected --program PATH of DaidalusBatch, or {VARIABLE} in the "
            f"environment; {_BUILD}"
        )
    path = Path(name)
    if not path.is_file() or not os.access(path, os.X_OK):
        raise InputError(f"{name}: no program, expected DaidalusBatch; {_BUILD}")
    return path.resolve()


def track_of(heading: np.ndarray | float) -> np.ndarray:
    """Return headings, rad, as tracks, deg clockwise from north in [0, 360), ``[...]``."""
    return np.asarray((90.0 - np.degrees(heading)) % 360.0)


def configuration(
    setting: Setting, alerting: Alerting, *, hysteresis: bool, changes: Mapping[str, str]
) -> str:
    """Return the program's configuration: a plain cylinder, no criteria.

    Level 1 is the conflict within the look-ahead, whose region closes bands. ``hysteresis``: that
    of the alerts, which in the program filters the bands too; ``changes``: other values of keys.
    """
    alerting = alerting if hysteresis else replace(alerting, m=0, n=0, hold=0.0, forget=0.0)
    values = _manoeuvres(setting) | _alerts(alerting)
    levels = zip(_REGIONS, alerting.reached, alerting.left, strict=True)
    for number, (region, reached, left) in enumerate(levels, start=1):
        values |= {
            f"Plain_alert_{number}_region": region,
            f"Plain_alert_{number}_alerting_time": f"{reached} [s]",
            f"Plain_alert_{number}_early_alerting_time": f"{left} [s]",
            # The program ends with a fault where levels share a detector.
            f"Plain_alert_{number}_detector": f"det_{number}",
            f"Plain_det_{number}_D": f"{setting.separation} [m]",
            f"Plain_det_{number}_H": f"{setting.height} [m]",
            f"Plain_load_core_detection_det_{number}": "gov.nasa.larcfm.ACCoRD.CDCylinder",
        }
    values |= changes
    return "".join(f"{key} = {value}\n" for key, value in values.items())


_REGIONS = "FAR", "MID", "NEAR"
"""Of the alert levels."""


def _manoeuvres(setting: Setting) -> dict[str, str]:
    """Return the keys of the bands: their ranges and steps, and how each is flown."""
    return {
        "lookahead_time": f"{setting.look_ahead} [s]",
        "left_hdir": "180.0 [deg]",
        "right_hdir": "180.0 [deg]",
        "min_airspeed": f"{setting.speed_min} [m/s]",
        "min_hs": f"{setting.speed_min} [m/s]",
        "max_hs": f"{setting.speed_max} [m/s]",
        "min_vs": f"{-setting.climb} [m/s]",
        "max_vs": f"{setting.climb} [m/s]",
        "min_alt": "0.0 [m]",
        "max_alt": f"{_HIGHEST} [m]",
        "step_hdir": f"{setting.step_deg} [deg]",
        "step_hs": f"{setting.step_speed} [m/s]",
        "step_vs": f"{setting.step_climb} [m/s]",
        "step_alt": f"{setting.step_altitude} [m]",
        "horizontal_accel": f"{setting.acceleration} [m/s^2]",
        "vertical_accel": f"{setting.vertical_acceleration} [m/s^2]",
        "turn_rate": f"{np.degrees(setting.turn_rate)} [deg/s]",
        "bank_angle": "0.0 [deg]",
        "vertical_rate": f"{setting.vertical_rate} [m/s]",
        "recovery_hdir": "false",
        "recovery_hs": "false",
        "recovery_vs": "false",
        "recovery_alt": "false",
        "ca_bands": "false",
    }


def _alerts(alerting: Alerting) -> dict[str, str]:
    """Return the keys of the alerts that are no level's."""
    return {
        "hysteresis_time": f"{alerting.forget} [s]",
        "persistence_time": f"{alerting.hold} [s]",
        "bands_persistence": "false",
        "alerting_m": str(alerting.m),
        "alerting_n": str(alerting.n),
        "conflict_crit": "false",
        "recovery_crit": "false",
        "ownship_centric_alerting": "true",
        "corrective_region": "FAR",
        "alerters": "Plain",
    }


def scenario_text(ownship: Track, others: list[Track]) -> str:
    """Return a scenario as the program reads it (``.xyz``): the same plane and numbers as ours."""
    lines = ["NAME sx sy sz trk gs vs time", "[none] [m] [m] [m] [deg] [m/s] [m/s] [s]"]
    for number, time in enumerate(ownship.time):
        lines.append(_row("ownship", ownship, number))
        for intruder in others:
            rows = np.flatnonzero(np.abs(intruder.time - time) < 1e-6)
            lines += [_row(intruder.name, intruder, int(place)) for place in rows]
    return "\n".join(lines) + "\n"


def _row(name: str, track: Track, number: int) -> str:
    east, north = float(track.vx[number]), float(track.vy[number])
    course = np.degrees(np.arctan2(east, north)) % 360.0
    values = [
        track.x[number],
        track.y[number],
        track.altitude[number],
        course,
        np.hypot(east, north),
        track.vertical_rate[number],
        track.time[number],
    ]
    return ", ".join([name, *(f"{float(value):.9f}" for value in values)])


def answers(
    program: Path,
    folder: Path,
    setting: Setting,
    alerting: Alerting,
    changes: Mapping[str, str],
) -> list[Second]:
    """Run the program on the scenario ``scenario.xyz`` of a folder and return what it says: bands
    without, alerts with hysteresis.
    """
    closed = _answers(
        program, folder, configuration(setting, alerting, hysteresis=False, changes=changes)
    )
    # The bands of this run are not looked at.
    coarse = setting._replace(step_deg=30.0, step_speed=0.2 * setting.speed_max)
    alerts = _answers(
        program, folder, configuration(coarse, alerting, hysteresis=True, changes=changes)
    )
    if [second.time for second in closed] != [second.time for second in alerts]:
        raise InputError(f"{program}: answers other times in two runs of one scenario")
    return [
        second._replace(loss=alert.loss, level=alert.level)
        for second, alert in zip(closed, alerts, strict=True)
    ]


def bands(program: Path, folder: Path, setting: Setting, alerting: Alerting) -> list[Second]:
    """Run the program on the scenario of a folder and return the bands alone."""
    return _answers(program, folder, configuration(setting, alerting, hysteresis=False, changes={}))


def _answers(program: Path, folder: Path, text: str) -> list[Second]:
    (folder / "plain.conf").write_text(text)
    command = [str(program), "--conf", "plain.conf", "--precision", "6"]
    command += ["--out", "answers.txt", "scenario.xyz"]
    try:
        process = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, timeout=_PATIENCE, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as problem:
        raise InputError(f"{program}: does not run: {problem}") from None
    if process.returncode or not (folder / "answers.txt").is_file():
        words = (process.stderr or process.stdout).strip().splitlines() or ["it says nothing"]
        raise InputError(f"{program}: ends with {process.returncode}: {words[-1]}")
    return read_answers((folder / "answers.txt").read_text())


_INTERVAL = re.compile(r"\s*[\[(]([-\d.]+) \[[^]]*\], ([-\d.]+) \[[^]]*\][])] (\w+)")
_KINDS = {
    "Horizontal Direction": "headings",
    "Horizontal Speed": "speeds",
    "Vertical Speed": "climbs",
    "Altitude": "altitudes",
}
"""Of bands: what the program calls them, and the field of a second."""
_LOSS = re.compile(r"Time to Corrective Volume with (.+?): [\[(]([-\d.]+) \[s\]")
_LEVEL = re.compile(r"Alert Level (-?\d+) with (.+)")


def read_answers(text: str) -> list[Second]:
    """Return what the program's output says, a time after the other."""
    seconds: list[Second] = []
    into: list[Interval] | None = None
    for line in text.splitlines():
        if line.startswith("Time: "):
            seconds.append(Second(float(line.split()[1]), [], [], [], [], {}, {}))
            continue
        if not seconds:
            continue
        second, interval = seconds[-1], _INTERVAL.fullmatch(line)
        kind = next((kind for kind in _KINDS if line.startswith(f"{kind} Bands:")), None)
        if kind is not None:
            into = getattr(second, _KINDS[kind])
        elif interval is not None:
            if into is not None:
                into.append(Interval(float(interval[1]), float(interval[2]), interval[3]))
        else:
            into = None
            _read_alert(line, second)
    return seconds


def _read_alert(line: str, second: Second) -> None:
    """Note what a line outside the bands says of an intruder, if anything."""
    loss, level = _LOSS.match(line), _LEVEL.fullmatch(line)
    if loss is not None:
        second.loss[loss[1]] = float(loss[2])
    if level is not None:
        second.level[level[2]] = int(level[1])
