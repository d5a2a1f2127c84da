"""A display beside a program with a loop of its own, such as the one that speaks MAVLink."""

import asyncio
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from agents.assurance.state import FlyMode
from ros_bridge.core import guidance
from ros_bridge.core.assurance import Supervision, backup
from ros_bridge.core.conversions import Published
from ros_bridge.core.situation import Situation
from ros_bridge.core.status import status
from ros_bridge.display.scene import DisplayScene, MonitorStatus
from ros_bridge.display.server import DisplayServer, LiveSource, Recording, bind_socket

__all__ = ["BackgroundServer", "supervised_scene"]


class BackgroundServer:
    """Serves a source from a thread while it is entered; OSError where the address is not free."""

    def __init__(
        self,
        source: LiveSource | Recording,
        name: str,
        say: Callable[[str], None],
        host: str = "127.0.0.1",
        port: int = 0,
    ) -> None:
        self.display = DisplayServer(source, name, say)
        self._listener: socket.socket = bind_socket(host, port)
        self.port = int(self._listener.getsockname()[1])
        self._begun = threading.Event()
        self._end: Callable[[], object] = self._begun.is_set
        self._thread = threading.Thread(target=self._run, name="display", daemon=True)

    def __enter__(self) -> "BackgroundServer":
        """Begin to serve."""
        self._thread.start()
        self._begun.wait()
        return self

    def __exit__(self, *problem: object) -> None:
        """Stop serving."""
        self.stop()

    def stop(self) -> None:
        """Stop serving; a second time changes nothing."""
        if self._thread.is_alive():
            self._end()
            self._thread.join()

    def _run(self) -> None:
        with self._listener, suppress(asyncio.CancelledError):
            asyncio.run(self._serve())

    async def _serve(self) -> None:
        task, loop = asyncio.current_task(), asyncio.get_running_loop()
        assert task is not None
        self._end = lambda: loop.call_soon_threadsafe(task.cancel)
        await self.display.serve(self._listener, self._begun.set)


def supervised_scene(
    scene: DisplayScene,
    situation: Situation,
    supervision: Supervision,
    alerts: guidance.Shown,
    moment: int,
) -> tuple[DisplayScene, guidance.Shown]:
    """Return the scene of a program that supervises a plan by the monitor's core, at a time, ns.

    Args:
        scene: before.
        situation: what the program has received.
        supervision: its monitor.
        alerts: those of the last time (:func:`ros_bridge.core.guidance.blank`: none).
        moment: the program's clock, ns.
    """
    limits = supervision.thresholds_in_air
    scene = replace(
        scene.at(moment),
        situation=situation,
        plan=supervision.published_plan,
        separation=limits.requirement.separation,
        by_category=supervision.categories.separations,
        arrived={**scene.arrived, **_arrivals(situation), "status": moment},
    )
    if supervision.assessment is None:
        return replace(scene, monitor=None), alerts
    monitor_status = status(supervision)
    backup_plan = _backup(supervision, situation, monitor_status.fly, scene)
    scene = replace(scene, monitor=MonitorStatus(moment, monitor_status), backup=backup_plan)
    alerts, bands = guidance.guidance(alerts, supervision, moment)
    if bands is None:
        return scene, alerts
    return replace(scene, guidance=bands), alerts


def _arrivals(situation: Situation) -> dict[str, int]:
    """Return when the ownship and other aircraft were last heard of, ns."""
    own = situation.own.last
    intruder_times = [
        track.last.time for track in situation.traffic.values() if track.last is not None
    ]
    arrivals = {} if own is None else {"ownship": own.time}
    return arrivals | ({"traffic": max(intruder_times)} if intruder_times else {})


def _backup(
    supervision: Supervision, situation: Situation, mode: FlyMode, scene: DisplayScene
) -> Published | None:
    if mode is not FlyMode.BACKUP:
        return None
    own = situation.own.last
    plan = backup(supervision, None if own is None else own.altitude)
    revision = 0 if scene.backup is None else scene.backup.revision
    return None if plan is None else plan._replace(revision=revision)
