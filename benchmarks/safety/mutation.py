"""Certificates with one thing moved by less than would show in a picture."""

import json
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.safety.judgement import apart, controls, flights, offset
from envs.edge.json_text import parse_json
from envs.waypoints import ARCS

__all__ = ["approach", "mutate"]

_KINDS = ("own", "waypoint", "waypoint and legs", "waypoint and legs", "control", "limit")
_TRAFFIC_KINDS = ("intruder", "approach", "approach", "approach", "bound", "requirement")
_UNITS = (1.0, 1.0, 1e-3, 0.02, 0.01)  # of x, y, heading, speed, time for 1 m
_INTRUDER_UNITS = (*_UNITS, 1e-4, 0.1, 1.0, 0.02, 1.0)
_STEPS = 40  # of an arc, where the closest approach is looked for


def mutate(data: dict[str, Any], rng: np.random.Generator) -> tuple[dict[str, Any], str]:
    """Return a certificate with something moved by 1 mm to 30 m, or as much in other units, and
    what was moved.

    An ``approach`` shifts an intruder by more, so that it comes as close as the separation but for
    1 mm to 30 m.
    """
    data = parse_json(json.dumps(data))
    size = float(10.0 ** rng.uniform(-3.0, 1.5) * rng.choice([-1.0, 1.0]))  # m
    leg, part = int(rng.integers(len(data["waypoints"]))), int(rng.integers(5))
    kinds: list[str] = list(_KINDS)
    if data["intruders"]:
        kinds += _TRAFFIC_KINDS
    kinds += [name for name in ("excluded", "apart") if data[name]]
    kind = kinds[int(rng.integers(len(kinds)))]
    if kind == "own":
        data["own"][part % 4] += size * _UNITS[part % 4]
    elif kind.startswith("waypoint"):
        data["waypoints"][leg][part] += size * _UNITS[part]
        times = [0.0, *(row[4] for row in data["waypoints"])]
        if kind != "waypoint" and all(one < two for one, two in pairwise(times)):
            data["controls"] = controls([data])[0].tolist()
    elif kind == "control":
        data["controls"][leg][int(rng.integers(2 * ARCS))] += size * 1e-3
    elif kind == "limit":
        name = list(data["limits"])[part]
        data["limits"][name] -= (
            abs(size) * (0.02 if part < 2 else 1e-3) * (1.0 if part in (1, 3, 4) else -1.0)
        )
    elif kind == "intruder":
        row = data["intruders"][int(rng.integers(len(data["intruders"])))]
        field = int(rng.integers(10))
        row[field] += (abs(size) if field > 5 else size) * _INTRUDER_UNITS[field]
    elif kind == "approach":
        number = int(rng.integers(len(data["intruders"])))
        approach(data, number, data["intruders"][number][9] + size)
    elif kind == "bound":
        data["bounds"][int(rng.integers(len(data["bounds"])))] += abs(size)
    elif kind == "excluded":
        row = data["excluded"][int(rng.integers(len(data["excluded"])))]
        _level(data, row, row[5] + size)
    elif kind == "apart":
        row = data["apart"][int(rng.integers(len(data["apart"])))]
        # An end of the time, an altitude or the vertical separation.
        row[(1, 2, 3, 5, 8)[part]] += size * (0.1 if part < 2 else 1.0)
    else:
        data["requirement"][("margin", "sigmas")[part % 2]] += abs(size) * (1.0, 0.01)[part % 2]
    return parse_json(json.dumps(data)), kind  # as a file holds it, numbers of numpy are refused


def approach(data: dict[str, Any], number: int, distance: float) -> None:
    """Shift an intruder to come as close as that, m, and ask for nothing but the separation."""
    data["requirement"] |= {"margin": 0.0, "sigmas": 0.0}
    data["bounds"] = [0.001 * one[9] for one in data["intruders"]]
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
    now = height + rise * age - own
    then = now + (rise - climb) * data["waypoints"][-1][4]
    least = min(abs(now), abs(then))
    row[2] += (apart - least) * (1.0 if now > 0.0 else -1.0)
