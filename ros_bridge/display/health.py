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


def health_lines(scene: DisplayScene, moment: int) -> list[HealthLine]:
    """Return the inputs that were ever heard, or must be, and the nodes."""
    return list(_lines(scene, moment))


def _lines(scene: DisplayScene, moment: int) -> Iterator[HealthLine]:
    fresh = scene.fresh
    limits = {"status": fresh.monitor, "guidance": fresh.guidance, "diagnostics": fresh.node}
    for short, label in _NAMES.items():
        arrival, problem = scene.arrived.get(short), scene.problems.get(short)
        if problem is not None:
            yield _line(label, problem, problem.time, moment)
        elif short == "ownship":
            yield _line(label, _own_health(scene.situation.own, moment, fresh.own), arrival, moment)
        elif arrival is not None:
            late = (moment - arrival) / SECOND > limits.get(short, math.inf)
            yield _line(label, _SILENT if late else _OK, arrival, moment)
    for name, problem in sorted(scene.problems.items()):
        if name not in _NAMES:
            yield _line(name, problem, problem.time, moment)
    for name, state in sorted(scene.nodes.items()):
        late = (moment - state.time) / SECOND > fresh.node
        yield _line(name, _SILENT if late else state, state.time, moment)


def _own_health(own: Track, moment: int, oldest: float) -> Health:
    if own.last is None:
        return Health(moment, 2, "not heard yet")
    if own.fault is not None:
        return Health(moment, 2, own.fault.message)
    return Health(moment, 2, "silent") if own.age(moment) > oldest else _OK


def _line(name: str, health: Health, arrival: int | None, moment: int) -> HealthLine:
    """Return a line about what was heard at a time, ns; None: never."""
    age = None if arrival is None else round((moment - arrival) / SECOND, 1)
    return HealthLine(name, health.level, health.text, age)
