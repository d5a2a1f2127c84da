"""Certificates with one thing moved by less than would show in a picture."""

import json
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from benchmarks.safety.judgement import apart, controls, flights, offset
from commands.json_text import parse_json
from envs.waypoints import ARCS

__all__ = ["approach", "mutate"]

_UNITS = (1.0, 1.0, 1e-3, 0.02, 0.01)  # of x, y, heading, speed, time for 1 m
_INTRUDER_UNITS = (*_UNITS, 1e-4, 0.1, 1.0, 0.02, 1.0)
_SIGNED = 6  # fields of an intruder that may be moved either way; the others grow
_SPEEDS, _MAXIMA = (0, 1), (1, 3, 4)  # places among the limits
_TIMES = (1, 2)  # places in a row of ``apart``
_HEIGHTS = (3, 5, 8)  # likewise: the ownship's altitude, the other's, the vertical separation
_STEPS = 40  # of an arc, where the closest approach is looked for


class _Move(NamedTuple):
    """What is drawn for a change."""

    size: float
    """m, or as much in other units; of either sign."""
    leg: int
    part: int
    """0 to 4: which of the numbers of a kind is moved."""
    rng: np.random.Generator
    """For what else a kind draws."""

    def row(self, rows: list[Any]) -> Any:
        """Return any of some rows."""
        return rows[int(self.rng.integers(len(rows)))]


def mutate(data: dict[str, Any], rng: np.random.Generator) -> tuple[dict[str, Any], str]:
    """Return a certificate with something moved by 1 mm to 30 m, or as much in other units, and
    what was moved.

    An ``approach`` shifts an intruder by more, so that it comes as close as the separation but for
    1 mm to 30 m.
    """
    data = parse_json(json.dumps(data))
    size = float(10.0 ** rng.uniform(-3.0, 1.5) * rng.choice([-1.0, 1.0]))
    leg, part = int(rng.integers(len(data["waypoints"]))), int(rng.integers(5))
    kinds = [*_KINDS]
    if data["intruders"]:
        kinds += _TRAFFIC_KINDS
    kinds += [name for name in ("excluded", "apart") if data[name]]
    kind = kinds[int(rng.integers(len(kinds)))]
    _CHANGES[kind](data, _Move(size, leg, part, rng))
    return parse_json(json.dumps(data)), kind  # as a file holds it, numbers of numpy are refused


def _move_own(data: dict[str, Any], move: _Move) -> None:
    field = move.part % 4
    data["own"][field] += move.size * _UNITS[field]


def _move_waypoint(data: dict[str, Any], move: _Move) -> None:
    data["waypoints"][move.leg][move.part] += move.size * _UNITS[move.part]


def _move_waypoint_and_legs(data: dict[str, Any], move: _Move) -> None:
    """Move a waypoint, and fly legs to and from where it is then, if there are any."""
    _move_waypoint(data, move)
    times = [0.0, *(row[4] for row in data["waypoints"])]
    if all(earlier < later for earlier, later in pairwise(times)):
        data["controls"] = controls([data])[0].tolist()


def _move_control(data: dict[str, Any], move: _Move) -> None:
    data["controls"][move.leg][int(move.rng.integers(2 * ARCS))] += move.size * 1e-3


def _tighten_limit(data: dict[str, Any], move: _Move) -> None:
    name = list(data["limits"])[move.part]
    unit = 0.02 if move.part in _SPEEDS else 1e-3
    data["limits"][name] -= abs(move.size) * unit * (1.0 if move.part in _MAXIMA else -1.0)


def _move_intruder(data: dict[str, Any], move: _Move) -> None:
    row = move.row(data["intruders"])
    field = int(move.rng.integers(len(_INTRUDER_UNITS)))
    size = move.size if field < _SIGNED else abs(move.size)
    row[field] += size * _INTRUDER_UNITS[field]


def _bring_near(data: dict[str, Any], move: _Move) -> None:
    number = int(move.rng.integers(len(data["intruders"])))
    approach(data, number, data["intruders"][number][9] + move.size)


def _raise_bound(data: dict[str, Any], move: _Move) -> None:
    data["bounds"][int(move.rng.integers(len(data["bounds"])))] += abs(move.size)


def _raise_requirement(data: dict[str, Any], move: _Move) -> None:
    name, unit = (("margin", 1.0), ("sigmas", 0.01))[move.part % 2]
    data["requirement"][name] += abs(move.size) * unit


def _move_excluded(data: dict[str, Any], move: _Move) -> None:
    row = move.row(data["excluded"])
    _level(data, row, row[5] + move.size)


def _move_apart(data: dict[str, Any], move: _Move) -> None:
    """Move an end of the time, an altitude or the vertical separation."""
    place = (*_TIMES, *_HEIGHTS)[move.part]
    move.row(data["apart"])[place] += move.size * (0.1 if place in _TIMES else 1.0)


_CHANGES: dict[str, Callable[[dict[str, Any], _Move], None]] = {
    "own": _move_own,
    "waypoint": _move_waypoint,
    "waypoint and legs": _move_waypoint_and_legs,
    "control": _move_control,
    "limit": _tighten_limit,
    "intruder": _move_intruder,
    "approach": _bring_near,
    "bound": _raise_bound,
    "requirement": _raise_requirement,
    "excluded": _move_excluded,
    "apart": _move_apart,
}
# A kind that stands twice is drawn twice as often.
_KINDS = ("own", "waypoint", "waypoint and legs", "waypoint and legs", "control", "limit")
_TRAFFIC_KINDS = ("intruder", "approach", "approach", "approach", "bound", "requirement")


def approach(data: dict[str, Any], number: int, distance: float) -> None:
    """Shift an intruder to come as close as that, m, and ask for nothing but the separation."""
    data["requirement"] |= {"margin": 0.0, "sigmas": 0.0}
    data["bounds"] = [0.001 * intruder[9] for intruder in data["intruders"]]
    flight, row = flights([data]), data["intruders"][number]
    traffic = np.array(row)[:, None, None]
    arcs = np.arange(flight.begin.shape[1])[:, None]
    seconds = flight.length[0, arcs] * np.arange(_STEPS + 1) / _STEPS
    arc, step = np.unravel_index(np.argmin(apart(flight, traffic, 0, arcs, seconds)), seconds.shape)
    length = flight.length[0, arc]
    fine = np.clip(seconds[arc, step] + length / _STEPS * np.linspace(-1.0, 1.0, 1001), 0.0, length)
    when = fine[np.argmin(apart(flight, traffic[..., 0], 0, arc, fine))]
    away = offset(flight, np.array(row), 0, arc, when)
    shift = away / abs(away) * (distance - abs(away))
    row[0], row[1] = row[0] + shift.real, row[1] + shift.imag


def _level(data: dict[str, Any], row: list[float], apart: float) -> None:
    """Move an altitude so that the least vertical distance of the plan is that."""
    own, climb, height, rise, age, _ = row
    at_begin = height + rise * age - own
    at_end = at_begin + (rise - climb) * data["waypoints"][-1][4]
    least = min(abs(at_begin), abs(at_end))
    row[2] += (apart - least) * (1.0 if at_begin > 0.0 else -1.0)
