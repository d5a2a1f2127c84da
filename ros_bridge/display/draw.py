"""The picture of a scene at a time.

Aircraft are carried on from their last report, alerts and areas to the picture's time; nothing is
judged here.
"""

import math
from collections.abc import Mapping

from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Cause
from envs.formats.local_frame import LocalFrame
from ros_bridge.core.conversions import Published
from ros_bridge.core.fields import SECOND
from ros_bridge.core.guidance import Guidance, Row
from ros_bridge.core.status import Status
from ros_bridge.display.aircraft import draw_aircraft
from ros_bridge.display.health import health_lines
from ros_bridge.display.heights import Heights
from ros_bridge.display.picture import (
    NO_THREAT,
    DrawnAlert,
    DrawnBands,
    DrawnMonitor,
    DrawnPlan,
    Picture,
    Tape,
    Threat,
    WayOut,
    tenths,
)
from ros_bridge.display.scene import DisplayScene, MonitorStatus
from ros_bridge.display.shapes import draw_areas, draw_plan, draw_route

_REMARKS = Cause.OUTSIDE_RANGE  # causes that ask for nothing


def draw(scene: DisplayScene, moment: int, centre: tuple[float, float] | None = None) -> Picture:
    """Return the picture of a scene at a time, ns.

    Args:
        scene: what is known.
        moment: the time of the source's clock.
        centre: latitude and longitude, degrees, that the map is drawn about where the ownship is
            unknown; None: the first aircraft.
    """
    scene = scene.at(moment)
    frame = _map(scene, centre)
    if frame is None:
        return empty(scene, moment)
    guidance = _fresh_guidance(scene, moment)
    threats = _threats(scene, guidance, moment)
    own, traffic = draw_aircraft(scene, frame, threats, moment)
    report = scene.situation.own.last
    wind = None if report is None else report.wind
    heights = Heights.of(scene.situation)
    return Picture(
        time=_seconds(moment),
        separation=scene.separation,
        monitor=_monitor(scene, moment),
        health=health_lines(scene, moment),
        origin=(frame.latitude, frame.longitude),
        own=own,
        traffic=traffic,
        wind=None if wind is None else (tenths(wind[0]), tenths(wind[1])),
        plan=_plan(scene.plan, frame, wind, heights, moment),
        backup=_plan(_backup_to_fly(scene, moment), frame, wind, heights, moment),
        unresolved=_plan(scene.unresolved, frame, wind, heights, moment),
        route=draw_route(scene.situation.route.value, frame),
        areas=draw_areas(scene.areas, frame, moment),
        bands=None if guidance is None else _bands(guidance, heights, moment),
        alerts=_alerts(threats, _area_threats(guidance, moment)),
    )


def empty(scene: DisplayScene, moment: int) -> Picture:
    """Return a picture without a map."""
    return Picture(
        time=_seconds(moment),
        separation=scene.separation,
        monitor=_monitor(scene, moment),
        health=health_lines(scene, moment),
    )


def _seconds(moment: int) -> float:
    return round(moment / SECOND, 3)


def _map(scene: DisplayScene, centre: tuple[float, float] | None) -> LocalFrame | None:
    """Return the map: about the ownship's place, in steps, so that the origin seldom moves."""
    own = scene.situation.own.last
    if own is not None:
        # A grid of a fifth of a degree: everything that matters is within 60 km of its point.
        step = 0.2
        stretched = step / max(math.cos(math.radians(own.latitude)), 0.1)
        return LocalFrame(
            max(min(round(own.latitude / step) * step, 90.0), -90.0),
            math.remainder(round(own.longitude / stretched) * stretched, 360.0),
        )
    if centre is not None:
        return LocalFrame(*centre)
    for track in scene.situation.traffic.values():
        if track.last is not None:
            return LocalFrame(round(track.last.latitude), round(track.last.longitude))
    return None


def _plan(
    published: Published | None,
    frame: LocalFrame,
    wind: tuple[float, float] | None,
    heights: Heights,
    moment: int,
) -> DrawnPlan | None:
    return None if published is None else draw_plan(published, frame, wind, heights, moment)


def _fresh_guidance(scene: DisplayScene, moment: int) -> Guidance | None:
    """Return bands and alerts of the monitor while they hold."""
    guidance = scene.guidance
    if guidance is None or (moment - guidance.time) / SECOND > scene.fresh.guidance:
        return None
    return guidance


def _threats(scene: DisplayScene, guidance: Guidance | None, moment: int) -> dict[str, Threat]:
    """Return the alerts of intruders: of the monitor's bands and of other functions."""
    threats = {} if guidance is None else _count_down(guidance.levels, guidance, moment)
    alert = scene.situation.alert.value
    if alert is not None and (moment - alert.time) / SECOND <= scene.fresh.alert:
        for name in alert.identifiers:
            threat = threats.get(name, NO_THREAT)
            threats[name] = threat._replace(level=max(threat.level, alert.level))
    return threats


def _area_threats(guidance: Guidance | None, moment: int) -> dict[str, Threat]:
    """Return the alerts of areas, of the monitor's bands."""
    return {} if guidance is None else _count_down(guidance.areas, guidance, moment)


def _count_down(
    levels: Mapping[str, tuple[int, float]], guidance: Guidance, moment: int
) -> dict[str, Threat]:
    """Return alerts with the times to loss that are left."""
    since = (moment - guidance.time) / SECOND
    return {
        name: Threat(level, None if loss < 0.0 else tenths(max(loss - since, 0.0)))
        for name, (level, loss) in levels.items()
    }


def _alerts(intruders: Mapping[str, Threat], areas: Mapping[str, Threat]) -> list[DrawnAlert]:
    """Return alerts, the highest level first, and of a level intruders first."""
    every = [
        *(DrawnAlert(name, "intruder", threat) for name, threat in intruders.items()),
        *(DrawnAlert(name, "area", threat) for name, threat in areas.items()),
    ]
    return by_level(every)


def by_level(alerts: list[DrawnAlert]) -> list[DrawnAlert]:
    """Return the alerts that are not 0, the highest level first."""
    raised = [alert for alert in alerts if alert.threat.level > 0]
    return sorted(raised, key=lambda alert: -alert.threat.level)


def _bands(guidance: Guidance, heights: Heights, moment: int) -> DrawnBands:
    since = (moment - guidance.time) / SECOND
    tracks, vertical = guidance.tracks, guidance.vertical
    above = None if vertical is None else heights.offset(vertical.reference)
    return DrawnBands(
        age=round(since, 2),
        look_ahead=guidance.look_ahead,
        tracks=Tape(tracks.target, tracks.region, tracks.area),
        speeds=_tape(guidance.speeds, 1),
        areas=list(guidance.areas),
        recovery=_way_out(guidance, since),
        climbs=None if vertical is None else _tape(vertical.speeds, 2),
        altitudes=None
        if vertical is None or above is None
        else _tape(vertical.altitudes, 1, above),
    )


def _tape(bands: Row, digits: int, above: float = 0.0) -> Tape:
    """Return bands as they are drawn; ``above`` is added to their targets."""
    return Tape(
        [round(target + above, digits) for target in bands.target], bands.region, bands.area
    )


def _way_out(guidance: Guidance, since: float) -> WayOut | None:
    """Return the way out some seconds after bands were published; None: none is needed."""
    if guidance.recovery < 0:
        return None
    opens = guidance.recovery_time
    return WayOut(
        track_deg=guidance.tracks.target[guidance.recovery],
        after=None if opens < 0.0 else tenths(max(opens - since, 0.0)),
        shortfall=tenths(guidance.recovery_shortfall),
    )


def _backup_to_fly(scene: DisplayScene, moment: int) -> Published | None:
    """Return the backup while it is what is to be flown."""
    monitor = scene.monitor
    if monitor is None or _is_silent(monitor, scene, moment):
        return None
    return scene.backup if monitor.status.fly is FlyMode.BACKUP else None


def _is_silent(monitor: MonitorStatus, scene: DisplayScene, moment: int) -> bool:
    """Return whether what a monitor said holds no longer."""
    return (moment - monitor.time) / SECOND > scene.fresh.monitor


def _monitor(scene: DisplayScene, moment: int) -> DrawnMonitor | None:
    monitor = scene.monitor
    if monitor is None:
        return None
    silent = _is_silent(monitor, scene, moment)
    status = Status(reasons=("the monitor is silent",)) if silent else monitor.status
    reasons, remarks = _reasons(status)
    return DrawnMonitor(
        age=round((moment - monitor.time) / SECOND, 2),
        state=None if silent else status.state,
        fly=status.fly,
        reasons=reasons,
        remarks=remarks,
        measured=status.measured,
        cross_track=tenths(status.cross_track),
        along_track=tenths(status.along_track),
        time_error=round(status.time_error, 2),
        separation=_or_none(status.separation),
        time_to_loss=_or_none(status.time_to_loss),
        altitude_error=None if status.altitude_error_limit < 0.0 else tenths(status.altitude_error),
    )


def _or_none(value: float) -> float | None:
    """Return a value of which -1 says that there is none."""
    return tenths(value) if value >= 0.0 else None


def _reasons(status: Status) -> tuple[list[str], list[str]]:
    """Return why the monitor is in its state, and what else it remarks, which asks for nothing."""
    causes = [cause for cause in Cause if status.causes & cause]
    if len(causes) != len(status.reasons):
        return list(status.reasons), []
    pairs = list(zip(causes, status.reasons, strict=True))
    return (
        [reason for cause, reason in pairs if cause not in _REMARKS],
        [reason for cause, reason in pairs if cause in _REMARKS],
    )
