"""What the program knows as a scene, for the traffic display beside it and for its recording."""

import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Self

from agents.assurance.state import FlyMode, State
from commands.command import InputError, visible
from ros_bridge.core.areas import AreaReport
from ros_bridge.core.conversions import Station
from ros_bridge.core.guidance import blank
from ros_bridge.core.lookout import step_without_plan
from ros_bridge.core.situation import Held
from ros_bridge.core.status import Status
from ros_bridge.display.background import BackgroundServer, supervised_scene
from ros_bridge.display.scene import DisplayScene, Health, HeldAreas, MonitorStatus, left_out_lines
from ros_bridge.display.server import LiveSource
from ros_bridge.mavlink import mission
from ros_bridge.mavlink.control import Phase
from ros_bridge.mavlink.judging import Rules
from ros_bridge.mavlink.view import View

__all__ = ["BackgroundRecorder", "SceneAdapter", "show"]


class SceneAdapter:
    """Feeds a live source or a recorder with what the program knows.

    While the program flies, bands and alerts are its monitor's; before that they are those of a
    monitor without a plan.

    Args:
        rules: of the program.
        feed: takes in how a scene changes (:meth:`ros_bridge.display.server.LiveSource.feed`).
    """

    def __init__(
        self, rules: Rules, feed: Callable[[Callable[[DisplayScene], DisplayScene]], object]
    ) -> None:
        self._feed = feed
        self._freshness = {"rlcas_mavlink": rules.settings.freshness}
        self._begin = lambda: (rules.begin(), blank(rules.thresholds))
        self._looking, self._shown = self._begin()

    def __call__(self, view: View) -> None:
        """Take over what is known now."""
        self._feed(partial(self.after, view=view))

    def after(self, scene: DisplayScene, view: View) -> DisplayScene:
        """Return the scene of a view."""
        situation, time, judgement = view.received.situation, view.time, view.judgement
        if time < scene.latest:  # the autopilot has begun anew
            self._looking, self._shown = self._begin()
        flies = view.control.phase in (Phase.TAKING, Phase.GUIDING)
        if flies and judgement.supervision.assessment is not None:
            supervision = judgement.supervision
        else:
            supervision = self._looking = step_without_plan(self._looking, situation, time)
        filed = replace(situation, route=Held(_route(view)))
        scene, self._shown = supervised_scene(scene, filed, supervision, self._shown, time)
        if supervision is self._looking:
            plan = judgement.supervision.published_plan if judgement.safe or flies else None
            scene = replace(scene, plan=plan, monitor=_advice(view))
        arrived = {**scene.arrived, "route": time} if view.mission else scene.arrived
        fence, areas = situation.fixed_areas, scene.areas
        if fence != (() if areas is None else areas.report.areas):  # else they stay placed
            areas = HeldAreas(AreaReport(0, fence)) if fence else None
        return replace(
            scene, areas=areas, arrived=arrived, nodes=_nodes(view), freshness=self._freshness
        )


class BackgroundRecorder:
    """Records what a :class:`SceneAdapter` feeds it while it is entered, in a thread of its own,
    into an MCAP file.

    Where the file cannot be written any more, as on a full disk, or for an error of our own, that
    is said and nothing stops.

    Args:
        path: of the file, which must not exist yet.
        say: takes a sentence.
    """

    def __init__(self, path: Path, say: Callable[[str], None]) -> None:
        from ros_bridge.display.scene_recording import RecordingError, SceneRecorder

        try:
            self._recorder = SceneRecorder(path)
        except RecordingError as problem:
            raise InputError(f"--record {problem}") from problem
        self._path, self._say = path, say
        self._waiting: SimpleQueue[Callable[[DisplayScene], DisplayScene] | None] = SimpleQueue()
        self._works = True
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)

    def feed(self, change: Callable[[DisplayScene], DisplayScene]) -> None:
        """Take in a change; it does not wait."""
        if self._works:
            self._waiting.put(change)

    def __enter__(self) -> Self:
        """Begin to write."""
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        """Write what has been fed, and finish the file."""
        self._waiting.put(None)
        self._thread.join()

    def _run(self) -> None:
        try:
            with closing(self._recorder) as recorder:
                for change in iter(self._waiting.get, None):
                    recorder.feed(change)
        except OSError as problem:
            self._say(f"{self._path}: cannot be written: {problem.strerror}")
        except Exception as error:
            self._say(f"{self._path}: ends here, for an error of the program: {error!r}")
        finally:
            self._works = False


def show(
    address: str, name: str, rules: Rules, clock: Callable[[], int], say: Callable[[str], None]
) -> tuple[SceneAdapter, BackgroundServer]:
    """Return what feeds a display and the display, which serves at an address (HOST:PORT)."""
    host, port = host_and_port(address)
    source = LiveSource(clock)
    try:
        server = BackgroundServer(source, visible(name), say, host, port)
    except OSError as problem:
        raise InputError(f"--display {address} cannot be used: {problem.strerror}") from None
    return SceneAdapter(rules, source.feed), server


def host_and_port(address: str) -> tuple[str, int]:
    """Return host and port of HOST:PORT, or raise :class:`InputError`."""
    host, _, port = address.rpartition(":")
    if not (host and port.isascii() and port.isdecimal() and int(port) <= 65_535):
        raise InputError(f"--display {address}; expected HOST:PORT, such as 127.0.0.1:8642")
    return host.strip("[]"), int(port)


def _route(view: View) -> tuple[Station, ...]:
    """Return the rest of the mission, from where its first leg begins."""
    current = view.received.current
    remaining = mission.remaining_items(view.mission, current)
    came_from = mission.item_before(view.mission, current)
    items = remaining if came_from is None else (came_from, *remaining)
    offset = view.received.altitude_offset
    return tuple(
        Station(item.number, *item.place, mission.altitude_of(item, view.mission, offset))
        for item in items
    )


def _advice(view: View) -> MonitorStatus:
    """Return what the program says while it does not fly: a safe plan is advice, and nobody flies
    it.
    """
    judgement = view.judgement
    reasons = [judgement.problem] if judgement.problem else []
    conflict = judgement.conflict
    if conflict is not None:
        seconds = max(conflict.time, 0.0)
        reasons.append(f"{conflict.name}: on the mission it is too near in {seconds:.0f} s")
    if conflict is not None and judgement.plan is not None and not judgement.safe:
        reasons.append("no plan is safe")
    state = State.MONITORING if judgement.safe else State.IDLE
    return MonitorStatus(view.time, Status(state, FlyMode.NOTHING, reasons=tuple(reasons)))


def _nodes(view: View) -> dict[str, Health]:
    """Return the states of autopilot and program."""
    nodes = {"rlcas_mavlink": Health(view.time, 0, view.control.phase.value)}
    heartbeat = view.received.heartbeat
    if heartbeat is not None:
        armed = "armed" if heartbeat.armed else "disarmed"
        nodes["autopilot"] = Health(
            view.received.heartbeat_at, 0, f"{heartbeat.mode_name}, {armed}"
        )
    return nodes | left_out_lines(view.left_out, view.doubted, view.time)
