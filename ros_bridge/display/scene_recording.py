"""A recording of scenes as an MCAP file like that of the graph, without ROS."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mcap_ros2._dynamic import serialize_dynamic

from ros_bridge.core.conversions import STATUS_BACKUP
from ros_bridge.core.tracks import UNKNOWN, Track
from ros_bridge.display import scene_messages as messages
from ros_bridge.display.scene import INPUTS, DisplayScene
from ros_bridge.transport.mcap_file import McapFile, RecordingError

__all__ = ["RecordingError", "SceneRecorder", "encoder"]

_RUNNER, _MONITOR = "rlcas_runner", "rlcas_monitor"


class SceneRecorder:
    """Writes what changes between scenes until it is closed; :class:`RecordingError` or OSError
    where it cannot.

    Args:
        path: of the file, which must not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self._file, self._scene = McapFile(path), DisplayScene()
        self._channels: dict[str, tuple[int, Callable[[Mapping[str, Any]], bytes]]] = {}
        for name, one in INPUTS.items():
            text = messages.definition(one.kind)
            channel = self._file.channel(f"/{name.lstrip('/')}", one.kind, text)
            self._channels[name] = channel, encoder(one.kind, text)
        self._file.flush()

    def feed(self, change: Callable[[DisplayScene], DisplayScene]) -> None:
        """Take over a change, as :meth:`ros_bridge.display.server.LiveSource.feed` does."""
        before, self._scene = self._scene, change(self._scene)
        self._write_changes(before, self._scene)

    def close(self) -> None:
        """Finish the file, or raise OSError."""
        self._file.close()

    def _write_changes(self, before: DisplayScene, scene: DisplayScene) -> None:
        now = scene.latest
        self._write("/clock", messages.clock(now), now)
        was, held = before.situation, scene.situation
        if held.origin.value is not None and held.origin.value != was.origin.value:
            fields = messages.geo_reference(held.origin.value)
            self._write(f"{_RUNNER}/input/geo_reference", fields, now)
        self._write_track("ownship", was.own, held.own, now)
        for name, track in held.traffic.items():
            self._write_track("traffic", was.traffic.get(name, UNKNOWN), track, now)
        stations = held.route.value or ()
        if len(stations) > 1 and stations != was.route.value:
            self._write(f"{_RUNNER}/input/route", messages.route(stations, now), now)
        if scene.areas is not None and (
            before.areas is None or scene.areas.report != before.areas.report
        ):
            fields = messages.areas(scene.areas.report.areas, now)
            self._write(f"{_RUNNER}/input/areas", fields, now)
        self._write_decisions(before, scene, now)

    def _write_decisions(self, before: DisplayScene, scene: DisplayScene, now: int) -> None:
        plan = f"{_RUNNER}/output/trajectory"
        if scene.plan is None and before.plan is not None:
            self._write(plan, messages.withdrawal(before.plan.revision + 1, now), now)
        elif scene.plan is not None and scene.plan != before.plan:
            self._write(plan, messages.plan(scene.plan), now)
        if scene.backup is not None and scene.backup != before.backup:
            fields = messages.plan(scene.backup, STATUS_BACKUP)
            self._write(f"{_MONITOR}/output/backup", fields, now)
        if scene.monitor is not None and scene.monitor != before.monitor:
            revision = 0 if scene.plan is None else scene.plan.revision
            fields = messages.status(scene.monitor, revision)
            self._write(f"{_MONITOR}/output/status", fields, now)
        if scene.guidance is not None and scene.guidance != before.guidance:
            fields = messages.guidance(scene.guidance)
            self._write(f"{_MONITOR}/output/guidance", fields, now)
        if scene.nodes != before.nodes:
            fields = messages.diagnostics(
                scene.nodes, scene.separation, scene.by_category, scene.fresh, now
            )
            self._write("/diagnostics", fields, now)

    def _write_track(self, name: str, before: Track, track: Track, now: int) -> None:
        """Write the newest report, and the place of one that could not be used."""
        topic = f"{_RUNNER}/input/{name}"
        if track.last is not None and track.last != before.last:
            self._write(topic, messages.aircraft(track.last), now)
        for one in track.sightings:
            if one not in before.sightings:
                self._write(topic, messages.aircraft(one.sighting), now)

    def _write(self, name: str, fields: Mapping[str, Any], now: int) -> None:
        channel, encode = self._channels[name]
        self._file.write(channel, encode(fields), now)


def encoder(kind: str, definition: str) -> Callable[[Mapping[str, Any]], bytes]:
    """Return what serializes a message of a kind; fields that it lacks are 0 or empty."""
    return serialize_dynamic(kind, definition)[kind]
