"""A recording of scenes as an MCAP file like that of the graph, without ROS."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mcap_ros2._dynamic import serialize_dynamic

from ros_bridge.core import message_fields
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
        for name, known_input in INPUTS.items():
            text = messages.definition(known_input.kind)
            channel = self._file.channel(f"/{name.lstrip('/')}", known_input.kind, text)
            self._channels[name] = channel, encoder(known_input.kind, text)
        self._file.flush()

    def feed(self, change: Callable[[DisplayScene], DisplayScene]) -> None:
        """Take over a change, as :meth:`ros_bridge.display.server.LiveSource.feed` does."""
        before, self._scene = self._scene, change(self._scene)
        self._write_changes(before, self._scene)

    def close(self) -> None:
        """Finish the file, or raise OSError."""
        self._file.close()

    def _write_changes(self, previous: DisplayScene, scene: DisplayScene) -> None:
        moment = scene.latest
        self._write("/clock", messages.clock(moment), moment)
        old, new = previous.situation, scene.situation
        if new.origin.value is not None and new.origin.value != old.origin.value:
            fields = message_fields.geo_reference(new.origin.value)
            self._write(f"{_RUNNER}/input/geo_reference", fields, moment)
        self._write_track("ownship", old.own, new.own, moment)
        for name, track in new.traffic.items():
            self._write_track("traffic", old.traffic.get(name, UNKNOWN), track, moment)
        stations = new.route.value or ()
        if len(stations) > 1 and stations != old.route.value:
            self._write(f"{_RUNNER}/input/route", message_fields.route(stations, moment), moment)
        if scene.areas is not None and (
            previous.areas is None or scene.areas.report != previous.areas.report
        ):
            fields = message_fields.areas(scene.areas.report.areas, moment)
            self._write(f"{_RUNNER}/input/areas", fields, moment)
        self._write_decisions(previous, scene, moment)

    def _write_decisions(self, previous: DisplayScene, scene: DisplayScene, moment: int) -> None:
        plan = f"{_RUNNER}/output/trajectory"
        if scene.plan is None and previous.plan is not None:
            self._write(plan, message_fields.withdrawal(previous.plan.revision + 1, moment), moment)
        elif scene.plan is not None and scene.plan != previous.plan:
            self._write(plan, message_fields.plan(scene.plan), moment)
        if scene.backup is not None and scene.backup != previous.backup:
            fields = message_fields.plan(scene.backup, STATUS_BACKUP)
            self._write(f"{_MONITOR}/output/backup", fields, moment)
        if scene.monitor is not None and scene.monitor != previous.monitor:
            revision = 0 if scene.plan is None else scene.plan.revision
            fields = messages.status(scene.monitor, revision)
            self._write(f"{_MONITOR}/output/status", fields, moment)
        if scene.guidance is not None and scene.guidance != previous.guidance:
            fields = messages.guidance(scene.guidance)
            self._write(f"{_MONITOR}/output/guidance", fields, moment)
        if scene.nodes != previous.nodes:
            fields = messages.diagnostics(
                scene.nodes, scene.separation, scene.by_category, scene.fresh, moment
            )
            self._write("/diagnostics", fields, moment)

    def _write_track(self, name: str, previous: Track, track: Track, moment: int) -> None:
        """Write the newest report, and the place of one that could not be used."""
        topic = f"{_RUNNER}/input/{name}"
        if track.last is not None and track.last != previous.last:
            self._write(topic, message_fields.aircraft(track.last), moment)
        for sighted in track.sightings:
            if sighted not in previous.sightings:
                self._write(topic, message_fields.aircraft(sighted.sighting), moment)

    def _write(self, name: str, fields: Mapping[str, Any], moment: int) -> None:
        channel, encode = self._channels[name]
        self._file.write(channel, encode(fields), moment)


def encoder(kind: str, definition: str) -> Callable[[Mapping[str, Any]], bytes]:
    """Return what serializes a message of a kind; fields that it lacks are 0 or empty."""
    return serialize_dynamic(kind, definition)[kind]
