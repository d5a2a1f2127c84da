"""Latency and load of the traffic display on a real graph: ``python -m benchmarks.display``.

A hundred aircraft report twice a second over DDS, an ownship five times, to a display in a process
of its own; headless Chromium draws. A latency is that from a report's stamp, which is the moment of
its publication, to the end of the drawing of the first picture that has it. A picture is missed if
its number never reaches the page, and not drawn if another came before it was.

Afterwards the page takes as many pictures as a night has in a row, and its memory is compared.
"""

import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.measure import report
from benchmarks.ros.graph import processor_time
from envs.edge.command import Parser, run_cli
from ros_bridge.transport.children import FLAG, free_domain, stop

_SETTLE = 10.0  # s before figures count
_OWN, _OTHERS = 5.0, 2.0  # reports a second
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
    add("--seconds", type=float, default=60.0, help="that figures are taken over (default 60)")
    add("--aircraft", type=int, default=100, help="that report (default 100)")
    add("--night", type=int, default=20_000, help="pictures of the night (default 20000)")
    options = parser.parse_args(argv)
    browser = next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if browser is None:
        parser.error("no Chromium is installed (Debian's package: chromium)")
    with free_domain() as domain:
        os.environ |= {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        report(_measure(options, browser), ("playwright", "websockets"))


def _measure(options: Any, browser: str) -> dict[str, Any]:
    from playwright.sync_api import sync_playwright

    server = subprocess.Popen(
        [sys.executable, "-m", "ros_bridge.display", "--port", "0", FLAG],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert server.stdout is not None
    try:
        with sync_playwright() as driver, _Sky(options.aircraft) as sky:
            page = driver.chromium.launch(
                executable_path=browser, args=["--no-sandbox", "--enable-precise-memory-info"]
            ).new_page(viewport={"width": 1280, "height": 800})
            page.goto(server.stdout.readline().strip())
            sky.fly(_SETTLE, lambda: page.wait_for_timeout(1))
            page.evaluate("(range) => { state.range = range; show(); }", 5)
            page.evaluate(_PICTURES)
            began, before, load = time.monotonic(), processor_time(server.pid), os.getloadavg()[0]
            sky.fly(options.seconds, lambda: page.wait_for_timeout(1))
            busy = (processor_time(server.pid) - before) / (time.monotonic() - began)
            found = page.evaluate(
                "({ latency: measured.latency, numbers: measured.numbers, drawn: measured.drawn })"
            )
            text = page.evaluate("JSON.stringify(state.picture)")
            grown = _night(page, text, options.night) if options.night else None
    finally:
        stop([server])  # pyright: ignore[reportArgumentType]
        server.stdout.close()
    latency = 1e3 * np.array(found["latency"])
    numbers, drawn = found["numbers"], set(found["drawn"])
    return {
        "aircraft": options.aircraft,
        "reports_latency_ms": {
            "count": len(latency),
            "median": float(np.median(latency)),
            "p99": float(np.quantile(latency, 0.99)),
            "greatest": float(latency.max()),
        },
        "server_core_percent": 100.0 * busy,
        "pictures": len(numbers),
        "pictures_missed": numbers[-1] - numbers[0] + 1 - len(numbers),
        "pictures_not_drawn": len(set(numbers) - drawn),
        "seconds": options.seconds,
        "page_growth_mb": grown,
        "night_pictures": options.night,
        "load_average_before": load,
        "cores": os.cpu_count(),
    }


def _night(page: Any, text: str, count: int) -> float:
    """Return by how much the page's memory grows over many pictures, MB."""
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
        self._due = [(1.0 / _OWN, 0.0)] + [
            (1.0 / _OTHERS, n / count / _OTHERS) for n in range(count)
        ]
        self._next = np.array([begin for _, begin in self._due])
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
            now = time.time() - self._begin
            for n in np.flatnonzero(self._next <= now):
                (self._others if n else self._own).publish(self._message(int(n)))
                self._next[n] = max(self._next[n] + self._due[n][0], now)
            idle()

    def _message(self, number: int) -> Any:
        from ros_bridge.core.reports import Report
        from ros_bridge.transport.messages import aircraft_message

        now = time.time_ns()
        passed = now / 1e9 - self._begin
        # On circles of their own, so that nobody leaves; the ownship flies north.
        angle = 2.0 * math.pi * number * 0.618 + passed / (60.0 + number)
        radius = 0.02 + 0.003 * number
        speed = math.radians(radius) * 6.37e6 / (60.0 + number)
        latitude, longitude = (
            47.0 + radius * math.cos(angle),
            8.0 + 1.466 * radius * math.sin(angle),
        )
        east, north = speed * math.cos(angle), -speed * math.sin(angle)
        if number == 0:
            latitude, longitude, east, north = 47.0 + passed * 80.0 / 111_200.0, 8.0, 0.0, 80.0
        name = "own" if number == 0 else f"{0x4B0000 + number:x}"
        return aircraft_message(Report(name, now, latitude, longitude, east, north))


if __name__ == "__main__":
    run_cli(main)
