"""What a display knows at one moment: values, and one pure function for each input that changes
them.

Messages are read by their fields, checked as runner and monitor check them; nothing here imports
ROS. What cannot be used leaves what was known, and its sentence goes to the state of health.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from agents.assurance.state import FlyMode, State
from envs.formats.local_frame import LocalFrame
from ros_bridge.core import updates
from ros_bridge.core.areas import AreaReport, areas, to_local
from ros_bridge.core.categories import BY_CATEGORY, separations_of
from ros_bridge.core.conversions import (
    ALTITUDE_CODES,
    STATUS_BACKUP,
    STATUS_SAFE,
    STATUS_UNRESOLVED,
    STATUS_WITHDRAWN,
    Published,
    trajectory,
)
from ros_bridge.core.fields import SECOND, FieldError, attempt, integer, nanoseconds, number, stamp
from ros_bridge.core.freshness import USUAL_FRESHNESS, Freshness
from ros_bridge.core.guidance import Guidance, Row, VerticalRows
from ros_bridge.core.nearest import MOST, keep_nearest
from ros_bridge.core.reports import Report
from ros_bridge.core.situation import Situation
from ros_bridge.core.status import Status
from ros_bridge.core.tracks import Rules, follow, forget_silent, take_outcome

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray
    from rlcas_msgs.msg import Areas, AssuranceStatus, GuidanceBands, Trajectory
    from rosgraph_msgs.msg import Clock

_BACKWARD = SECOND // 2  # by how much the clock may step back before all is forgotten
_RULES = Rules()
_MOST = 1_024  # bands, reasons and intruders of a message
_FAR = 1e6  # m
_LONGEST = 1e9  # of a number that only has to be finite


class MonitorStatus(NamedTuple):
    """An AssuranceStatus message."""

    time: int  # ns
    status: Status


@dataclass(frozen=True, eq=False)
class HeldAreas:
    """An Areas message; two are the same only if they are one."""

    report: AreaReport


class Health(NamedTuple):
    """What a node, or this display of one of its inputs, says of itself."""

    time: int  # ns
    level: int  # 0 ok, 1 warning, 2 error, 3 stale, as of DiagnosticStatus
    text: str


@dataclass(frozen=True)
class DisplayScene:
    """Everything that was received."""

    situation: Situation = field(default_factory=Situation)
    plan: Published | None = None
    backup: Published | None = None
    unresolved: Published | None = None  # the newest advisory: the best known, not safe
    monitor: MonitorStatus | None = None
    guidance: Guidance | None = None
    areas: HeldAreas | None = None
    nodes: Mapping[str, Health] = field(default_factory=lambda: MappingProxyType({}))
    problems: Mapping[str, Health] = field(default_factory=lambda: MappingProxyType({}))
    """Why the newest message of an input cannot be used, by the last part of its topic's name."""
    arrived: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """When an input was last heard, ns, by the same."""
    separation: float | None = None  # that is kept from others, m, where it is known
    by_category: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    """What is kept from aircraft of an emitter category instead, m, by its number."""
    freshness: Mapping[str, Freshness] = field(default_factory=lambda: MappingProxyType({}))
    """For how long things count, by the node that says so."""
    latest: int = 0  # ns

    @property
    def fresh(self) -> Freshness:
        """For how long things count where they do for any node; where none says, what is usual."""
        limits = self.freshness.values()
        return reduce(Freshness.longest, limits) if limits else USUAL_FRESHNESS

    def at(self, moment: int) -> "DisplayScene":
        """Return what is known at a time, ns: a clock that steps back begins anew, and aircraft
        that are silent are forgotten.
        """
        if moment < self.latest - _BACKWARD:
            return DisplayScene(
                separation=self.separation,
                by_category=self.by_category,
                freshness=self.freshness,
                nodes=self.nodes,
                latest=moment,
            )
        traffic, silent = forget_silent(self.situation.traffic, moment, self.fresh.silence)
        situation = replace(self.situation, traffic=traffic) if silent else self.situation
        return replace(self, latest=max(moment, self.latest), situation=situation)


def _note_arrival(scene: DisplayScene, name: str, moment: int) -> DisplayScene:
    """Return the scene in which something of an input has just arrived."""
    if moment < scene.latest - _BACKWARD:
        scene = scene.at(moment)
    arrived = {**scene.arrived, name: moment}
    return replace(scene, latest=max(moment, scene.latest), arrived=arrived)


def take(scene: DisplayScene, name: str, message: Any, moment: int) -> DisplayScene:
    """Return the scene after a message of an input (:data:`INPUTS`) that arrives at a time, ns."""
    # Traffic is one input, by itself or in arrays.
    short = name.rpartition("/")[2].removesuffix("_array")
    scene = _note_arrival(scene, short, moment)
    try:
        outcome = attempt(lambda: INPUTS[name].change(scene, message, moment))
    except AttributeError as error:  # another version of the message
        outcome = FieldError(short, f"has no field {error.name}, expected {INPUTS[name].kind}")
    if isinstance(outcome, FieldError):
        return note(scene, short, str(outcome), moment)
    if short in outcome.problems:
        problems = {key: health for key, health in outcome.problems.items() if key != short}
        outcome = replace(outcome, problems=problems)
    return outcome


def take_report(
    scene: DisplayScene, report: Report | FieldError, moment: int, *, own: bool = False
) -> DisplayScene:
    """Return the scene after a report of a source that has no messages, such as a receiver.

    Args:
        scene: what was known.
        report: the report, or why it cannot be used.
        moment: when it arrived, ns.
        own: whether it is about the ownship.
    """
    name = "ownship" if own else "traffic"
    scene = _note_arrival(scene, name, moment)
    situation = scene.situation
    if isinstance(report, FieldError) and report.sighting is None:
        return note(scene, name, str(report), moment)
    sighting = report.sighting
    assert sighting is not None
    if not own:
        own_place = None if situation.own.last is None else situation.own.last.place
        traffic = follow(situation.traffic, sighting.identifier, report, moment, _RULES)
        traffic, dropped = keep_nearest(traffic, own_place)
        if dropped:
            scene = note(scene, "traffic", f"the nearest {MOST} aircraft alone are shown", moment)
        return replace(scene, situation=replace(situation, traffic=traffic))
    own_track = take_outcome(situation.own, report, "ownship", moment, _RULES)
    return replace(scene, situation=replace(situation, own=own_track))


def note(scene: DisplayScene, name: str, text: str, moment: int) -> DisplayScene:
    """Return the scene with a problem of an input."""
    return replace(scene, problems={**scene.problems, name: Health(moment, 2, text)})


def left_out_lines(
    left_out: Mapping[str, int], doubted: Mapping[str, int], moment: int
) -> dict[str, Health]:
    """Return lines of health on reports that were left out of the traffic, and on those that were
    taken although a field forbids it, by how often for which reason; ``moment`` in ns.
    """
    named = (("traffic left out", 0, left_out), ("traffic doubted", 1, doubted))
    return {
        name: Health(
            moment,
            level,
            ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items())),
        )
        for name, level, counts in named
        if any(counts.values())
    }


def _situation(
    update: Callable[..., Situation],
) -> Callable[[DisplayScene, Any, int], DisplayScene]:
    def change(scene: DisplayScene, message: Any, moment: int) -> DisplayScene:
        situation = update(scene.situation, message, moment, _RULES)
        for received in (situation.origin, situation.route, situation.alert):
            if received.fault is not None and received.fault.arrived == moment:
                raise FieldError(received.fault.field, received.fault.problem)
        return replace(scene, situation=situation)

    return change


def _plan(scene: DisplayScene, message: "Trajectory", moment: int) -> DisplayScene:
    if message.status == STATUS_WITHDRAWN:
        return replace(scene, plan=None)
    _expect("trajectory", message, STATUS_SAFE)
    return replace(scene, plan=_with_points(message, "trajectory"), unresolved=None)


def _advisory(scene: DisplayScene, message: "Trajectory", moment: int) -> DisplayScene:
    _expect("advisory", message, STATUS_UNRESOLVED)
    # The runner publishes the best known trajectory; without any there is nothing to draw.
    plan = _with_points(message, "advisory") if len(message.waypoints) else None
    return replace(scene, unresolved=plan)


def _backup(scene: DisplayScene, message: "Trajectory", moment: int) -> DisplayScene:
    _expect("backup", message, STATUS_BACKUP)
    return replace(scene, backup=_with_points(message, "backup"))


def _with_points(message: "Trajectory", name: str) -> Published:
    count = len(message.waypoints)
    if not 1 <= count <= _MOST:
        raise FieldError(f"{name}.waypoints", f"has {count} points, expected 1 to {_MOST}")
    return trajectory(message, name)


def _expect(name: str, message: "Trajectory", status: int) -> None:
    if message.status != status:
        raise FieldError(f"{name}.status", f"is {message.status}, expected {status}")


def _status(scene: DisplayScene, message: "AssuranceStatus", moment: int) -> DisplayScene:
    def real(name: str) -> float:
        return number(f"status.{name}", getattr(message, name), -_LONGEST, _LONGEST, "")

    time = stamp("status.header.stamp", message.header.stamp)
    status = Status(
        state=State(integer("status.state", message.state, 0, 4)),
        fly=FlyMode(integer("status.fly", message.fly, 0, 2)),
        causes=integer("status.causes", message.causes, 0, 2**32 - 1),
        reasons=tuple(str(reason) for reason in list(message.reasons)[:_MOST]),
        measured=bool(message.measured),
        cross_track=real("cross_track"),
        along_track=real("along_track"),
        time_error=real("time_error"),
        separation=real("separation"),
        time_to_loss=real("time_to_loss"),
    )
    if hasattr(message, "altitude_error"):  # a recording of an earlier version has none
        status = status._replace(
            altitude_error=real("altitude_error"),
            altitude_error_limit=real("altitude_error_limit"),
        )
    return replace(scene, monitor=MonitorStatus(time, status))


def _guidance(scene: DisplayScene, message: "GuidanceBands", moment: int) -> DisplayScene:
    levels, areas = _levels(message, "intruder"), _levels(message, "area")
    tracks, speeds = (
        _bands(message, target, kind, len(areas))
        for target, kind in (("track_deg", "track"), ("speed", "speed"))
    )
    guidance = Guidance(
        time=stamp("guidance.header.stamp", message.header.stamp),
        look_ahead=number("guidance.look_ahead", message.look_ahead, 0.0, _LONGEST, "s"),
        tracks=tracks,
        speeds=speeds,
        recovery=integer("guidance.recovery", message.recovery, -1, len(tracks.target) - 1),
        recovery_time=number("guidance.recovery_time", message.recovery_time, -1.0, _LONGEST, "s"),
        recovery_shortfall=number(
            "guidance.recovery_shortfall", message.recovery_shortfall, -_LONGEST, _LONGEST, "m"
        ),
        levels=levels,
        areas=areas,
        vertical=_vertical(message, len(areas)),
    )
    return replace(scene, guidance=guidance)


def _vertical(message: "GuidanceBands", areas: int) -> VerticalRows | None:
    """Return bands up and down, of so many areas; None where a message has none, as in recordings
    of earlier versions.
    """
    if not len(getattr(message, "vertical_speed", ())):
        return None
    speeds, altitudes = (
        _bands(message, kind, kind, areas, low=-_LONGEST) for kind in ("vertical_speed", "altitude")
    )
    code = integer("guidance.altitude_reference", message.altitude_reference, 0, 255)
    reference = ALTITUDE_CODES.get(code)
    if reference is None:
        problem = f"is {code}, expected one of {sorted(ALTITUDE_CODES)} beside bands of altitudes"
        raise FieldError("guidance.altitude_reference", problem)
    return VerticalRows(speeds, altitudes, reference)


def _levels(message: "GuidanceBands", kind: str) -> dict[str, tuple[int, float]]:
    """Return alert levels and times to loss, s or -1, by what is lost: an intruder or an area."""
    ids = list(getattr(message, f"{kind}_ids"))
    columns = [list(getattr(message, f"{kind}_{name}")) for name in ("level", "loss")]
    for name, column in zip(("level", "loss"), columns, strict=True):
        if len(column) != len(ids):
            problem = f"has {len(column)} values, expected {len(ids)} as {kind}_ids"
            raise FieldError(f"guidance.{kind}_{name}", problem)
    return {
        str(identity): (
            integer(f"guidance.{kind}_level", int(level), 0, 3),
            number(f"guidance.{kind}_loss", loss, -1.0, _LONGEST, "s"),
        )
        for identity, level, loss in zip(ids, *columns, strict=True)
    }


def _bands(message: "GuidanceBands", target: str, kind: str, areas: int, low: float = 0.0) -> Row:
    parts = ("region", "loss", "area")
    columns = [getattr(message, name) for name in (target, *(f"{kind}_{part}" for part in parts))]
    lengths = {len(column) for column in columns}
    if len(lengths) != 1 or max(lengths) > _MOST:
        problem = f"and its regions, losses and areas have {sorted(lengths)} values"
        raise FieldError(
            f"guidance.{target}", f"{problem}, expected as many of each, {_MOST} at most"
        )
    targets, regions, losses, by_areas = columns
    return Row(
        tuple(number(f"guidance.{target}", value, low, _LONGEST, "") for value in targets),
        tuple(integer(f"guidance.{kind}_region", int(region), 0, 4) for region in regions),
        tuple(number(f"guidance.{kind}_loss", loss, -1.0, _LONGEST, "s") for loss in losses),
        tuple(integer(f"guidance.{kind}_area", int(area), -1, areas - 1) for area in by_areas),
    )


def _areas(scene: DisplayScene, message: "Areas", moment: int) -> DisplayScene:
    report = areas(message)
    for area in report.areas:  # what no map can hold is refused now
        centre = area.centre or area.rings[0][0]
        to_local(AreaReport(report.time, (area,)), LocalFrame(*centre), report.time, _FAR)
    return replace(scene, areas=HeldAreas(report))


def _diagnostics(scene: DisplayScene, message: "DiagnosticArray", moment: int) -> DisplayScene:
    nodes, separation, by_category = dict(scene.nodes), scene.separation, scene.by_category
    freshness = dict(scene.freshness)
    for node in list(message.status)[:_MOST]:
        level = node.level[0] if isinstance(node.level, bytes) else int(node.level)
        nodes[str(node.name)] = Health(moment, min(level, 3), str(node.message))
        values = {pair.key: pair.value for pair in node.values}
        if "separation, m" in values:
            separation = number("separation", values["separation, m"], 0.0, _LONGEST, "m")
        if BY_CATEGORY in values:
            by_category = separations_of(BY_CATEGORY, values[BY_CATEGORY])
        node_freshness = Freshness.of_texts(values)
        if node_freshness is not None:
            freshness[str(node.name)] = node_freshness
    if len(nodes) > _MOST:  # names that are made up anew each time
        nodes, freshness = {}, {}
    return replace(
        scene, nodes=nodes, separation=separation, by_category=by_category, freshness=freshness
    )


def _clock(scene: DisplayScene, message: "Clock", moment: int) -> DisplayScene:
    return scene


class Input(NamedTuple):
    """An input of a display."""

    kind: str  # of its messages
    change: Callable[[DisplayScene, Any, int], DisplayScene]


_AIRCRAFT, _TRAJECTORY = "rlcas_msgs/msg/AircraftState", "rlcas_msgs/msg/Trajectory"

INPUTS: Mapping[str, Input] = {
    "/clock": Input("rosgraph_msgs/msg/Clock", _clock),
    "rlcas_runner/input/ownship": Input(_AIRCRAFT, _situation(updates.ownship)),
    "rlcas_runner/input/traffic": Input(_AIRCRAFT, _situation(updates.traffic)),
    "rlcas_runner/input/traffic_array": Input(
        "rlcas_msgs/msg/TrafficArray", _situation(updates.traffic_array)
    ),
    "rlcas_runner/input/alerts": Input("rlcas_msgs/msg/TrafficAlert", _situation(updates.alert)),
    "rlcas_runner/input/route": Input(_TRAJECTORY, _situation(updates.route)),
    "rlcas_runner/input/geo_reference": Input(
        "rlcas_msgs/msg/GeoReference", _situation(updates.geo_reference)
    ),
    "rlcas_runner/input/areas": Input("rlcas_msgs/msg/Areas", _areas),
    "rlcas_runner/output/trajectory": Input(_TRAJECTORY, _plan),
    "rlcas_runner/output/advisory": Input(_TRAJECTORY, _advisory),
    "rlcas_monitor/output/status": Input("rlcas_msgs/msg/AssuranceStatus", _status),
    "rlcas_monitor/output/backup": Input(_TRAJECTORY, _backup),
    "rlcas_monitor/output/guidance": Input("rlcas_msgs/msg/GuidanceBands", _guidance),
    "/diagnostics": Input("diagnostic_msgs/msg/DiagnosticArray", _diagnostics),
}
"""What takes in a message, by the name of its topic (docs/reference/ros.md)."""


def clock_of(message: "Clock") -> int:
    """Return the time that a message of ``/clock`` tells, ns."""
    return nanoseconds(message.clock)
