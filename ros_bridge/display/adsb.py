"""Live ADS-B for a display, without ROS: a receiver's traffic, one of which may be the ownship."""

import queue
import threading
import time
from collections import Counter
from dataclasses import replace
from functools import partial

from ros_bridge.core import adsb_live
from ros_bridge.core.fields import FieldError
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.reports import Report
from ros_bridge.display.scene import DisplayScene, left_out_lines, note, take_report
from ros_bridge.display.server import LiveSource
from ros_bridge.transport.adsb_receiver import Receiver

__all__ = ["Receiving"]

_LOOK = 0.5  # s between two looks at the connection


class Receiving:
    """Feeds a live source while it is entered.

    Args:
        live: that is fed.
        source: a checked one (:func:`ros_bridge.transport.adsb_receiver.check_source`).
        own: address of the ownship, hexadecimal; "": none of the aircraft is.
    """

    def __init__(self, live: LiveSource, source: str, own: str) -> None:
        self._live, self._own = live, own.strip().lower()
        self._receiver = Receiver(source, time.time_ns)
        kind = adsb_live.BaseStation if self._receiver.lines else adsb_live.AircraftJson
        self._traffic = adsb_live.Traffic("")
        self._reader = kind(self._traffic)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._pass_on, name="display", daemon=True)

    def __enter__(self) -> "Receiving":
        """Begin to listen."""
        self._receiver.start()
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        """Stop listening."""
        self._stopped.set()
        self._receiver.stop()
        self._receiver.join()
        self._thread.join()

    def _pass_on(self) -> None:
        heard = looked = time.monotonic()
        while not self._stopped.is_set():
            try:
                item = self._receiver.heard.get(timeout=_LOOK)
            except queue.Empty:
                item = ()
            if item is None:
                self._reader.begin()
            elif item:
                heard = time.monotonic()
                self._read(*item)
            if time.monotonic() - looked > _LOOK:
                looked = time.monotonic()
                silent = looked - heard
                quiet = (
                    f"has sent nothing for {silent:.0f} s"
                    if silent > USUAL_FRESHNESS.receiver
                    else ""
                )
                self._live.feed(partial(_connect, problem=self._receiver.problem or quiet))
                self._live.feed(
                    partial(_count, counts=(+self._traffic.counts, +self._traffic.doubted))
                )

    def _read(self, arrived: int, text: str) -> None:
        try:
            for found in self._reader.reports_of(text, arrived):
                self._live.feed(
                    partial(take_report, found=found, now=arrived, own=self._is_own(found))
                )
        except TimeoutError as late:
            self._receiver.restart()
            self._live.feed(partial(note, name="receiver", text=str(late), now=arrived))
        except Exception as error:  # of our own: what follows is read all the same
            text = f"failed for an error of the display: {error!r}"
            self._live.feed(partial(note, name="traffic", text=text, now=arrived))

    def _is_own(self, found: Report | FieldError) -> bool:
        seen = found.sighting
        return seen is not None and seen.identifier == self._own != ""


def _count(scene: DisplayScene, counts: tuple[Counter[str], Counter[str]]) -> DisplayScene:
    """Return the scene with what was left out of the traffic so far."""
    lines = left_out_lines(*counts, max(time.time_ns(), scene.latest))
    return replace(scene, nodes={**scene.nodes, **lines})


def _connect(scene: DisplayScene, problem: str) -> DisplayScene:
    """Return the scene with the state of the connection, which is looked at now."""
    now = max(time.time_ns(), scene.latest)
    if problem:
        return note(scene, "receiver", problem, now)
    left = {name: what for name, what in scene.problems.items() if name != "receiver"}
    return replace(scene, problems=left, arrived={**scene.arrived, "receiver": now})
