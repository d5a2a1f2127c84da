"""Messages as plain objects, for what needs no ROS: those of ``rlcas_msgs``, and those of other
packages.
"""

import math
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from agents.assurance.thresholds import Thresholds
from agents.planner.request.request import Options
from envs.aircraft import PAPER
from envs.formats.local_frame import LocalFrame
from ros_bridge.core import updates
from ros_bridge.core.fields import Code, Refusal
from ros_bridge.core.motion import Turns
from ros_bridge.core.situation import Situation
from ros_bridge.core.tasks import Settings, task
from ros_bridge.core.tracks import Rules

__all__ = [
    "EXACT",
    "FRAME",
    "NOW",
    "OPTIONS",
    "RULES",
    "SECOND",
    "SETTINGS",
    "THRESHOLDS",
    "aircraft",
    "alert",
    "crossing",
    "definitions",
    "fields_of",
    "geo_reference",
    "message",
    "point",
    "publish",
    "refusal",
    "route_points",
    "situation_after",
    "stamp",
]

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND + 250_000_000
FRAME = LocalFrame(47.0, 8.0)
RULES = Rules()
OPTIONS = Options.for_aircraft(PAPER, deadline_s=math.inf)  # no clock decides what is found
THRESHOLDS = Thresholds.for_plans(OPTIONS)
SETTINGS = Settings(OPTIONS, Turns.of(THRESHOLDS))
EXACT = 0xC5  # bits of an AircraftState: position and velocity with their standard deviations
_NUMBERS = {
    **{f"{sign}int{bits}": int for sign in ("", "u") for bits in (8, 16, 32, 64)},
    "float32": lambda value: float(np.float32(value)),
    "float64": float,
    "bool": bool,
    "string": str,
}


def stamp(time: int) -> SimpleNamespace:
    return SimpleNamespace(sec=time // SECOND, nanosec=time % SECOND)


def aircraft(
    x: float,
    y: float,
    heading: float,
    speed: float,
    *,
    climb: float = 0.0,
    frame: LocalFrame = FRAME,
    **changes: Any,
) -> Any:
    """Return an AircraftState of a place and a velocity in the local frame, both exact, with its
    climb, m/s.
    """
    place = frame.geodetic(x, y)
    true = heading - float(place.convergence)
    fields = {
        "header": SimpleNamespace(stamp=stamp(changes.pop("time", NOW))),
        "id": "4b1a2c",
        "valid": EXACT,
        "latitude": float(place.latitude),
        "longitude": float(place.longitude),
        "altitude": 0.0,
        "altitude_reference": 0,
        "velocity": SimpleNamespace(x=speed * math.cos(true), y=speed * math.sin(true), z=climb),
        "true_airspeed": 0.0,
        "wind": SimpleNamespace(x=0.0, y=0.0, z=0.0),
        "position_std": 0.0,
        "velocity_std": 0.0,
        "category": 0,
        "callsign": "",
    }
    return SimpleNamespace(**(fields | changes))


def geo_reference(frame: LocalFrame = FRAME, **changes: Any) -> Any:
    fields = {
        "header": SimpleNamespace(stamp=stamp(NOW)),
        "latitude": frame.latitude,
        "longitude": frame.longitude,
        "geoid_undulation_valid": False,
        "geoid_undulation": 0.0,
    }
    return SimpleNamespace(**(fields | changes))


def alert(*ids: str, level: int = 2, time: int = NOW) -> Any:
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp(time)), level=level, intruder_ids=list(ids)
    )


def point(index: int, latitude: float, longitude: float, **changes: Any) -> Any:
    fields = {
        "index": index,
        "origin": 0,
        "valid": 0,
        "latitude": latitude,
        "longitude": longitude,
        "altitude": 0.0,
        "altitude_reference": 0,
        "track_deg": 0.0,
        "ground_speed": 0.0,
        "time_of_arrival": stamp(0),
    }
    return SimpleNamespace(**(fields | changes))


def route_points(
    *, frame: LocalFrame = FRAME, spacing: float = 5_000.0, count: int = 10, first: int = 7
) -> list[Any]:
    """Return a straight route eastwards through the origin's north, beginning ahead of it."""
    places = frame.geodetic([spacing * (number + 1) for number in range(count)], [0.0] * count)
    return [
        point(first + number, latitude, longitude)
        for number, (latitude, longitude) in enumerate(
            zip(places.latitude.tolist(), places.longitude.tolist(), strict=True)
        )
    ]


def publish(points: list[Any], status: int = 4) -> Any:
    return SimpleNamespace(status=status, waypoints=points)


def situation_after(
    *intruders,
    own=None,
    reference=None,
    points=None,
    alerts=(),
    frame: LocalFrame = FRAME,
    now: int = NOW,
) -> Situation:
    """Return what is known after messages of these intruders, a route, and an ownship that flies
    along it.
    """
    situation = updates.geo_reference(Situation(), reference or geo_reference(frame), now, RULES)
    situation = updates.route(situation, publish(points or route_points(frame=frame)), now, RULES)
    situation = updates.ownship(
        situation, own or aircraft(0.0, 0.0, 0.0, 75.0, id="own", frame=frame), now, RULES
    )
    for message in intruders:
        situation = updates.traffic(situation, message, now, RULES)
    for message in alerts:
        situation = updates.alert(situation, message, now, RULES)
    return situation


def refusal(
    situation: Situation, now: int = NOW, settings: Settings | None = None
) -> tuple[Code, str]:
    """Return the code and the field with which a request is refused."""
    with pytest.raises(Refusal) as caught:
        task(situation, now, settings or SETTINGS)
    return caught.value.code, caught.value.field


def crossing(**fields):
    """Return an intruder that crosses from the right and meets the ownship after 107 s."""
    return aircraft(8_000.0, -8_000.0, math.pi / 2.0, 75.0, **fields)


@cache
def definitions(package: str) -> dict[str, str]:
    """Return the definitions of another package's messages, as its files hold them, by
    their names.
    """
    parts = (
        Path(__file__)
        .with_name("other_packages.msg")
        .read_text(encoding="utf-8")
        .split(f"{'=' * 80}\nMSG: ")[1:]
    )
    named = (part.split("\n", 1) for part in parts)
    return {
        head.removeprefix(f"{package}/"): text
        for head, text in named
        if head.startswith(f"{package}/")
    }


def message(package: str, name: str, **fields: Any) -> Any:
    """Return a message of ``package/name``; fields that it does not have are refused."""
    return _kind(package, name)(**fields)


@cache
def fields_of(package: str, name: str) -> dict[str, str]:
    """Return the types of a message's fields by their names, packages written out."""
    result = {}
    for line in _lines(package, name):
        if "=" not in line:
            kind, field, *_ = line.split()
            result[field] = kind if kind in _NUMBERS or "/" in kind else f"{package}/{kind}"
    return result


def _lines(package: str, name: str) -> list[str]:
    text = definitions(package)[name]
    return [line for line in (raw.partition("#")[0].strip() for raw in text.splitlines()) if line]


@cache
def _kind(package: str, name: str) -> type:
    types = fields_of(package, name)
    constants = {}
    for line in _lines(package, name):
        declaration, equals, value = line.partition("=")
        if equals:
            kind, constant = declaration.split()
            constants[constant] = _NUMBERS[kind](value.strip())

    class Message:
        __slots__ = tuple(types)

        def __init__(self, **values: Any) -> None:
            for field, kind in types.items():
                empty = _NUMBERS[kind](0) if kind in _NUMBERS else message(*kind.split("/"))
                setattr(self, field, "" if kind == "string" else empty)
            for field, value in values.items():
                setattr(self, field, value)

        def __setattr__(self, field: str, value: Any) -> None:
            kind = types.get(field, "")
            object.__setattr__(self, field, _NUMBERS[kind](value) if kind in _NUMBERS else value)

    return type(name, (Message,), {"__slots__": (), **constants})
