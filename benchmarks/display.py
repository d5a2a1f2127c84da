"""Latency and load of the traffic display on a real graph: ``python -m benchmarks.display``.

A hundred aircraft report twice a second over DDS, an ownship five times, to a display in a process
of its own; headless Chromium draws. A latency is that from a report's stamp, which is the moment of
its publication, to the end of the drawing of the first picture that has it. A picture is missed if
its number never reaches the page, and not drawn if another came before it was.

Afterwards the page takes as many pictures as a night has in a row, and its memory is compared.
"""

import argparse
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np

from benchmarks.measure import find_chromium, processor_time, report
from benchmarks.ros.graph import own_domain
from commands.command import Parser, real, run_cli, whole
from ros_bridge.transport.children import FLAG, stop

if TYPE_CHECKING:
    from playwright.sync_api import Page
    from rlcas_msgs.msg import AircraftState

_SETTLE = 10.0  # s before figures count
_OWN, _OTHERS = 5.0, 2.0  # reports a second
_DEGREE = 111_200.0  # of latitude, m
_PICTURES = """() => {
  window.measured = { latency: [], numbers: [], drawn: [], seen: new Map() };
  const before = receive;
  receive = (text) => {
    measured.numbers.push(parseInt(text.slice(text.indexOf('"number":') + 9)));
    before(text);
  };
  document.addEventListener("drawn", ({ detail }) => {
    const now = Date.now() / 1000;
    measured.drawn.push(detail.number);
    for (const one of detail.traffic) {
      const held = Math.round((detail.time - one.age) * 1000);
      if (held < (measured.seen.get(one.id) ?? 0) + 50) continue; // the same one, rounded
      measured.seen.set(one.id, held);
      measured.latency.push(now - held / 1000);
    }
  });
}"""
_NIGHT = """async ([text, count]) => {
  const picture = JSON.parse(text);
  for (let n = 0; n < count; n++) {
    picture.time += 1;
    picture.number += 1;
    for (const one of picture.traffic) {
      one.x += 10 * Math.sin(n + one.y);
      one.age = (n % 60) / 10;
      one.level = (n + one.id.length) % 4;
    }
    receive(JSON.stringify(picture));
    draw();
    if (n % 200 === 0) await new Promise((done) => setTimeout(done, 0));
  }
}"""


def main(argv: list[str] | None = None) -> None:
    """Measure and print the figures."""
    parser = Parser(
        prog="python -m benchmarks.display",
        description="Measure latency and load of the traffic display, and the page's memory.",
    )
    add = parser.add_argument
    help_text = "time that is measured, s (default 60)"
    add("--seconds", type=real(1.0, 36_000.0, "s"), default=60.0, help=help_text)
    add("--aircraft", type=whole(1), default=100, help="aircraft that report (default 100)")
    add("--night", type=whole(0), default=20_000, help="pictures of the night (default 20000)")
    options = parser.parse_args(argv)
    browser = find_chromium()
    with own_domain():
        report(figures(options, _measure(options, browser)), ("playwright", "websockets"))


class _Pictures(TypedDict):
    """What the page has noted, as it sends it."""

    latency: list[float]
    """Of each report, s."""
    numbers: list[int]
    """Of the pictures that have come."""
    drawn: list[int]
    """Numbers of those that were drawn."""


class _Measured(NamedTuple):
    pictures: _Pictures
    server_share: float
    """Processor time of the server over the time that pictures were taken in."""
    growth_mb: float | None
    """Of the page over a night's pictures; None: there was no night."""
    load_before: float


def _measure(options: argparse.Namespace, browser: str) -> _Measured:
    from playwright.sync_api import sync_playwright

    with _server() as (server, address), sync_playwright() as driver, _Sky(options.aircraft) as sky:
        page = driver.chromium.launch(
            executable_path=browser, args=["--no-sandbox", "--enable-precise-memory-info"]
        ).new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        sky.fly(_SETTLE, lambda: page.wait_for_timeout(1))
        page.evaluate("(range) => { state.range = range; show(); }", 5)
        page.evaluate(_PICTURES)
        began, before, load = time.monotonic(), processor_time(server), os.getloadavg()[0]
        sky.fly(options.seconds, lambda: page.wait_for_timeout(1))
        share = (processor_time(server) - before) / (time.monotonic() - began)
        pictures = page.evaluate(
            "({ latency: measured.latency, numbers: measured.numbers, drawn: measured.drawn })"
        )
        text = page.evaluate("JSON.stringify(state.picture)")
        growth = _growth_over_night(page, text, options.night) if options.night else None
    return _Measured(pictures, share, growth, load)


@contextmanager
def _server() -> Generator[tuple[int, str]]:
    """Give the process of a display's server and its page's address."""
    server = subprocess.Popen(
        [sys.executable, "-m", "ros_bridge.display", "--port", "0", FLAG],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert server.stdout is not None
    try:
        yield server.pid, server.stdout.readline().strip()
    finally:
        stop([server])  # pyright: ignore[reportArgumentType]
        server.stdout.close()


def figures(options: argparse.Namespace, measured: _Measured) -> dict[str, Any]:
    """Return what is printed."""
    latency = 1e3 * np.array(measured.pictures["latency"])
    numbers, drawn = measured.pictures["numbers"], set(measured.pictures["drawn"])
    return {
        "aircraft": options.aircraft,
        "reports_latency_ms": {
            "count": len(latency),
            "median": float(np.median(latency)),
            "p99": float(np.quantile(latency, 0.99)),
            "greatest": float(latency.max()),
        },
        "server_core_percent": 100.0 * measured.server_share,
        "pictures": len(numbers),
        "pictures_missed": numbers[-1] - numbers[0] + 1 - len(numbers),
        "pictures_not_drawn": len(set(numbers) - drawn),
        "seconds": options.seconds,
        "page_growth_mb": measured.growth_mb,
        "night_pictures": options.night,
        "load_average_before": measured.load_before,
        "cores": os.cpu_count(),
    }


def _growth_over_night(page: "Page", text: str, count: int) -> float:
    """Return by how much the page's memory grows over many pictures like one, given as JSON, MB."""
    page.reload()  # without what was measured
    page.wait_for_selector("html[data-ready]")
    session = page.context.new_cdp_session(page)
    page.evaluate("socket.onclose = socket.onmessage = null; socket.close()")

    def heap_megabytes() -> float:
        session.send("HeapProfiler.collectGarbage")
        return page.evaluate("performance.memory.usedJSHeapSize") / 1e6

    page.set_default_timeout(3_600_000)
    page.evaluate(_NIGHT, [text, 500])
    before = heap_megabytes()
    page.evaluate(_NIGHT, [text, count])
    return heap_megabytes() - before


class _Sky:
    """Aircraft that report on the graph."""

    def __init__(self, count: int) -> None:
        import rclpy
        from rclpy.node import Node

        from ros_bridge.transport import topics

        rclpy.init(args=[])
        self._rclpy = rclpy
        self._node = Node("sky")
        self._own = self._node.create_publisher(*topics.OWNSHIP)
        self._others = self._node.create_publisher(*topics.TRAFFIC)
        # The ownship's, and those of the others, evenly spread; s.
        self._periods = [1.0 / _OWN] + [1.0 / _OTHERS] * count
        self._next = np.array([0.0] + [n / count / _OTHERS for n in range(count)])
        self._begin = time.time()

    def __enter__(self) -> "_Sky":
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        self._rclpy.try_shutdown()

    def fly(self, seconds: float, idle: Callable[[], None]) -> None:
        """Report for some seconds, each aircraft at its own times."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            passed = time.time() - self._begin
            for n in np.flatnonzero(self._next <= passed):
                (self._others if n else self._own).publish(self._message(int(n)))
                self._next[n] = max(self._next[n] + self._periods[n], passed)
            idle()

    def _message(self, number: int) -> "AircraftState":
        """Return the report of an aircraft now; 0: the ownship, which flies north."""
        from ros_bridge.core.reports import Report
        from ros_bridge.transport.messages import aircraft_message

        stamp = time.time_ns()
        passed = stamp / 1e9 - self._begin
        if number == 0:
            return aircraft_message(
                Report("own", stamp, 47.0 + passed * 80.0 / _DEGREE, 8.0, 0.0, 80.0)
            )
        # Each on a circle of its own, so that none leaves.
        angle = 2.0 * math.pi * number * 0.618 + passed / (60.0 + number)
        radius = 0.02 + 0.003 * number  # degrees
        speed = math.radians(radius) * 6.37e6 / (60.0 + number)
        latitude, longitude = (
            47.0 + radius * math.cos(angle),
            8.0 + 1.466 * radius * math.sin(angle),
        )
        east, north = speed * math.cos(angle), -speed * math.sin(angle)
        name = f"{0x4B0000 + number:x}"
        return aircraft_message(Report(name, stamp, latitude, longitude, east, north))


if __name__ == "__main__":
    run_cli(main)
