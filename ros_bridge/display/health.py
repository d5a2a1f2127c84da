"""The state of health: a line for each input and each node."""

import math
from collections.abc import Iterator

from ros_bridge.core.fields import SECOND
from ros_bridge.core.tracks import Track
from ros_bridge.display.picture import HealthLine
from ros_bridge.display.scene import DisplayScene, Health

_NAMES = {
    "ownship": "ownship",
    "traffic": "traffic",
    "alerts": "alerts",
    "route": "route",
    "geo_reference": "geo-reference",
    "areas": "areas",
    "trajectory": "plan",
    "advisory": "advisory",
    "status": "monitor",
    "backup": "backup",
    "guidance": "bands",
    "diagnostics": "diagnostics",
    "receiver": "receiver",
}

_OK = Health(0, 0, "")
_SILENT = Health(0, 3, "silent")


def health_lines(scene: DisplayScene, now: int) -> list[HealthLine]:
    """Return the inputs that were ever heard, or must be, and the nodes."""
    return list(_lines(scene, now))


def _lines(scene: DisplayScene, now: int) -> Iterator[HealthLine]:
    fresh = scene.fresh
    latest = {"status": fresh.monitor, "guidance": fresh.guidance, "diagnostics": fresh.node}
    for short, called in _NAMES.items():
        heard, problem = scene.arrived.get(short), scene.problems.get(short)
        if problem is not None:
            yield _line(called, problem, problem.time, now)
        elif short == "ownship":
            yield _line(called, _own_health(scene.situation.own, now, fresh.own), heard, now)
        elif heard is not None:
            late = (now - heard) / SECOND > latest.get(short, math.inf)
            yield _line(called, _SILENT if late else _OK, heard, now)
    for name, problem in sorted(scene.problems.items()):
        if name not in _NAMES:
            yield _line(name, problem, problem.time, now)
    for name, state in sorted(scene.nodes.items()):
        late = (now - state.time) / SECOND > fresh.node
        yield _line(name, _SILENT if late else state, state.time, now)


def _own_health(own: Track, now: int, oldest: float) -> Health:
    if own.last is None:
        return Health(now, 2, "not heard yet")
    if own.fault is not None:
        return Health(now, 2, own.fault.message)
    return Health(now, 2, "silent") if own.age(now) > oldest else _OK


def _line(name: str, health: Health, heard: int | None, now: int) -> HealthLine:
    """Return a line about what was heard at a time, ns; None: never."""
    age = None if heard is None else round((now - heard) / SECOND, 1)
    return HealthLine(name, health.level, health.text, age)
