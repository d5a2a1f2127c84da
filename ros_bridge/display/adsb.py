"""Receivers of traffic for a display, without ROS: their aircraft, one of which may be the
ownship.
"""

import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from ros_bridge.core.fields import FieldError
from ros_bridge.core.reports import Report
from ros_bridge.display.scene import DisplayScene, left_out_lines, note, take_report
from ros_bridge.display.server import LiveSource
from ros_bridge.transport.receivers import LiveReports

__all__ = ["Receiving"]

_LOOK = 0.5  # s between two looks at the connections
_DRAINED = 0.1  # s between two looks at what the receivers have sent


class Receiving:
    """Feeds a live source while it is entered.

    Args:
        live: that is fed.
        sources: checked ones (:func:`ros_bridge.transport.receivers.check_sources`).
        own: address of the ownship, hexadecimal; "": the one that a receiver says, if any.

    Raises:
        ValueError: a source's port of this machine cannot be listened at.
    """

    def __init__(self, live: LiveSource, sources: Sequence[str], own: str) -> None:
        self._live = live
        self._reports = LiveReports(sources, own, time.time_ns, shows_own=True)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._pass_on, name="display", daemon=True)

    def __enter__(self) -> "Receiving":
        """Begin to listen."""
        self._reports.start()
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        """Stop listening."""
        self._stopped.set()
        self._reports.stop()
        self._thread.join()

    def _pass_on(self) -> None:
        checked_at = time.monotonic()
        while not self._stopped.wait(_DRAINED):
            try:
                self._take()
            except Exception as error:  # of our own: what follows is read all the same
                text = f"failed for an error of the display: {error!r}"
                self._live.feed(partial(note, name="traffic", text=text, moment=time.time_ns()))
            if time.monotonic() - checked_at > _LOOK:
                checked_at = time.monotonic()
                counts = +self._reports.left_out, +self._reports.doubted
                self._live.feed(partial(_connect, problem=self._reports.take_problem()))
                self._live.feed(partial(_count, counts=counts))

    def _take(self) -> None:
        for report, arrived in self._reports.take():
            own = self._is_own(report)
            self._live.feed(partial(take_report, report=report, moment=arrived, own=own))

    def _is_own(self, report: Report | FieldError) -> bool:
        sighting = report.sighting
        return sighting is not None and self._reports.is_own(sighting.identifier)


def _count(scene: DisplayScene, counts: tuple[Counter[str], Counter[str]]) -> DisplayScene:
    """Return the scene with what was left out of the traffic so far."""
    lines = left_out_lines(*counts, max(time.time_ns(), scene.latest))
    return replace(scene, nodes={**scene.nodes, **lines})


def _connect(scene: DisplayScene, problem: str) -> DisplayScene:
    """Return the scene with the state of the connection, which is looked at now."""
    moment = max(time.time_ns(), scene.latest)
    if problem:
        return note(scene, "receiver", problem, moment)
    problems = {name: health for name, health in scene.problems.items() if name != "receiver"}
    return replace(scene, problems=problems, arrived={**scene.arrived, "receiver": moment})
