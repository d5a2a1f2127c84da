"""The display's page in a real browser: it draws what it is told, by day and night, and obeys the
keyboard.
"""

import io
import itertools
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("websockets", reason="websockets is not installed")

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

from playwright.sync_api import expect

from ros_bridge.display.recording import read
from ros_bridge.display.scene import take
from ros_bridge.display.server import LiveSource
from tests.ros_bridge.displays import (
    NOW,
    PREFIX,
    SECOND,
    Served,
    area,
    areas,
    climbing_plan,
    guidance,
    known_scene,
    level_aircraft,
    plan,
    serving,
    status,
    up_and_down,
)
from tests.ros_bridge.scenes import aircraft
from tests.ros_bridge.test_display import GUIDANCE, PLAN, STATUS, encounter

HOSTILE = "<img src=x onerror=alert(1)>"
AREAS = f"{PREFIX}areas"
SIZES = {
    "desk": (1280, 800),
    "tablet": (1024, 768),
    "phone": (390, 844),
    "phone on its side": (844, 390),
}


def alarming() -> LiveSource:
    """Return a live source with a warning, a plan, and an aircraft whose name is markup."""
    scene = known_scene(
        aircraft(6_000.0, 0.0, 3.1, 80.0, id=HOSTILE, valid=0xC5),
        aircraft(3_000.0, 4_000.0, 0.0, 80.0, id="late", time=NOW - 4_000_000_000),
    )
    bands = guidance(range(12, 26), region=3, intruder_ids=[HOSTILE])
    bands.intruder_level, bands.intruder_loss = [3], [12.0]
    for name, message in ((GUIDANCE, bands), (PLAN, plan()), (STATUS, status())):
        scene = take(scene, name, message, NOW)
    source = LiveSource(clock=lambda: NOW)
    source.scene = scene
    return source


class Page:
    def __init__(self, new_page: Any, url: str, size: str = "desk", scheme: str = "light") -> None:
        width, height = SIZES[size]
        self.page = new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        self.asked: list[str] = []
        self.wrong: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda problem: self.wrong.append(str(problem)))
        self.page.on("console", lambda message: self.wrong.append(message.text))
        self.page.goto(url)
        self.page.wait_for_selector("html[data-ready]")

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)

    def count_drawn(self) -> int:
        """Return how many pixels of the map are not empty, after the next picture was drawn."""
        self.page.evaluate(
            "new Promise((done) => document.addEventListener('drawn', done, { once: true })).then(() => 1)"
        )
        return self.page.evaluate(
            "(() => { const { width, height } = sky.canvas; const data = sky.canvas.getContext('2d')"
            ".getImageData(0, 0, width, height).data; let count = 0;"
            " for (let i = 3; i < data.length; i += 4) count += data[i] > 0; return count; })()"
        )


@pytest.fixture
def alarmed(new_page: Any) -> Iterator[tuple[Page, Served]]:
    with serving(alarming()) as server:
        page = Page(new_page, server.url)
        yield page, server
        assert page.wrong == []
        assert all(address.startswith((server.url, "data:")) for address in page.asked)
        page.page.close()


def test_alert_advice_and_health_are_said_in_words(alarmed: tuple[Page, Served]) -> None:
    page, _ = alarmed
    assert page.text("#order").startswith("Plan: turn left to track 030°")
    assert HOSTILE in page.text("#alerts") and "lost in 12 s" in page.text("#alerts")
    assert page.page.get_attribute("#advice", "data-level") == "3"
    assert "Revision 7" in page.text("#plan")
    page.page.click("summary >> nth=0")
    rows = page.page.locator("#table tr")
    page.page.wait_for_selector("#table tr")
    assert [rows.nth(n).locator("td").nth(0).inner_text() for n in range(2)] == ["late", HOSTILE]
    assert "coasting, 4 s" in rows.nth(0).inner_text()
    assert page.page.locator("#table img, #alerts img").count() == 0
    assert page.count_drawn() > 20_000


def test_the_keyboard_does_what_the_buttons_do(alarmed: tuple[Page, Served]) -> None:
    page, _ = alarmed
    before = page.text("#range")
    assert before == "5 NM"
    for key, selector, expected in (
        ("t", "#up", "North up"),
        ("+", "#range", "2 NM"),
        ("-", "#range", "5 NM"),
        ("u", "#range", "10 km"),
        ("s", "#sound", "Sound on"),
        ("s", "#sound", "Sound off"),
    ):
        page.page.keyboard.press(key)
        assert page.text(selector) == expected
    assert page.page.evaluate("document.documentElement.dataset.theme") == "day"
    page.page.keyboard.press("d")
    assert page.page.evaluate("document.documentElement.dataset.theme") == "night"
    reached = set()
    for _ in range(12):
        page.page.keyboard.press("Tab")
        reached.add(page.page.evaluate("document.activeElement.id"))
    assert {"up", "closer", "farther", "theme", "units", "sound"} <= reached


def test_track_up_turns_the_map_about_the_ownship(alarmed: tuple[Page, Served]) -> None:
    """The ownship flies east: what is ahead of it is up, and to the right with north up."""
    page, _ = alarmed
    where = "(() => { const at = view(state.picture, 800, 600), one = state.picture.traffic.find((t) => t.level); const [x, y] = at.place(one.x, one.y); return [x - at.centre[0], at.centre[1] - y]; })()"
    right, up = page.page.evaluate(where)
    assert abs(right) < 2.0 and up > 50.0
    page.page.keyboard.press("t")
    right, up = page.page.evaluate(where)
    assert right > 50.0 and abs(up) < 2.0


@pytest.mark.parametrize(("keep", "growth"), [(0, 10.0), (1, -10.0), (0, -10.0), (1, 10.0)])
def test_a_polygon_is_drawn_as_large_as_it_is_by_now(
    new_page: Any, keep: int, growth: float
) -> None:
    """What has become forbidden is tinted as well: 600 m on one side of the edges."""
    ring = [(1_000.0, -4_000.0), (4_000.0, -4_000.0), (4_000.0, -1_000.0), (1_000.0, -1_000.0)]
    storm = area(ring, keep=keep, growth=growth, velocity=SimpleNamespace(x=0.0, y=0.0, z=0.0))
    source = LiveSource(clock=lambda: NOW)
    source.scene = take(known_scene(), AREAS, areas(storm, time=NOW - 60 * SECOND), NOW)
    with serving(source) as server:
        page = Page(new_page, server.url)
        page.page.wait_for_function("state.picture")
        tinted = page.page.evaluate(
            """() => { draw(); const { width, height } = sky.canvas, ratio = width / sky.box.clientWidth;
            const { place } = view(state.picture, sky.box.clientWidth, sky.box.clientHeight);
            const [ring] = state.picture.areas[0].rings, east = Math.max(...ring.map(([x]) => x));
            const y = Math.min(...ring.map(([, y]) => y)) + 800;
            const { data } = sky.canvas.getContext("2d").getImageData(0, 0, width, height);
            return [-750, -300, 300, 750].map((off) => {
            const [u, v] = place(east + off, y).map((one) => Math.round(one * ratio));
            return data[4 * (v * width + u) + 3] > 0; }); }"""
        )
        keeps_out = keep == 0
        assert tinted == [keeps_out, keeps_out or growth < 0.0, keeps_out and growth > 0.0, False]
        assert page.wrong == []
        page.page.close()


def test_a_picture_that_stands_still_is_said_to_be_old(new_page: Any) -> None:
    """Beside the ownship, not across it; no input is said to be well any more."""
    with serving(alarming()) as server:
        page = Page(new_page, server.url)
        assert "✓" in page.text("#health")
        server.stop()
        page.page.wait_for_selector("#link:not([hidden])")
        assert "what is drawn is old" in page.text("#link")
        assert "✓" not in page.text("#health")
        ownship = page.page.evaluate(
            "view(state.picture, sky.box.clientWidth, sky.box.clientHeight).centre"
        )
        box = page.page.locator("#link").bounding_box()
        assert box is not None and box["y"] + box["height"] < ownship[1] - 30.0
        grey = "getComputedStyle(document.querySelector('#map > canvas')).filter"
        assert page.page.evaluate(grey) == "grayscale(1)"
        page.page.close()


def test_texts_on_the_map_do_not_overlap(new_page: Any) -> None:
    """Aircraft beside each other, an area among them, and a plan through them all."""
    source = alarming()
    scene = source.scene
    for number in range(12):
        near = aircraft(
            3_500.0 + 90.0 * number, 2_000.0 - 60.0 * number, 0.5, 80.0, id=f"n{number}"
        )
        scene = take(scene, f"{PREFIX}traffic", near, NOW)
    ring = [(3_000.0, 1_000.0), (5_000.0, 1_000.0), (5_000.0, 2_500.0)]
    source.scene = take(scene, AREAS, areas(area(ring)), NOW)
    with serving(source) as server:
        for size in SIZES:
            page = Page(new_page, server.url, size)
            page.count_drawn()
            boxes = page.page.evaluate("state.boxes")
            assert len(boxes) > 16
            # The first twelve are the numbers of the ring, the next two of traffic with an alert.
            for (ax, ay, aw, ah), (bx, by, bw, bh) in itertools.combinations(boxes[14:], 2):
                assert ax + aw <= bx or bx + bw <= ax or ay + ah <= by or by + bh <= ay
            page.page.close()


def climbing() -> LiveSource:
    """Return a live source of an ownship that climbs on its plan; one aircraft crosses the plan
    below it, one is of unknown altitude.
    """
    own = level_aircraft(0.0, 0.0, 0.0, 80.0, climb=2.5, id="own")
    scene = known_scene(
        level_aircraft(6_000.0, 0.0, 3.14, 80.0, height=480.0, id="below"),
        aircraft(4_000.0, 2_000.0, -1.57, 60.0, id="unknown"),
        own=own,
    )
    bands = guidance(range(12, 26), **up_and_down(range(3, 7)))
    for name, message in ((GUIDANCE, bands), (PLAN, climbing_plan()), (STATUS, status())):
        scene = take(scene, name, message, NOW)
    source = LiveSource(clock=lambda: NOW)
    source.scene = scene
    return source


LAYOUT = "(({ strip, column, stacked, radius, centre, left, low }, box) => ({ strip, column, stacked, radius, centre, low, width: box.clientWidth, height: box.clientHeight }))(view(state.picture, sky.box.clientWidth, sky.box.clientHeight), sky.box)"


@pytest.mark.parametrize("size", SIZES)
def test_climbs_have_tapes_and_a_profile_at_every_size(new_page: Any, size: str) -> None:
    with serving(climbing()) as server:
        page = Page(new_page, server.url, size)
        assert page.text("#order").startswith(
            "Plan: hold track 090°, climb to 1969 ft with 490 ft/min"
        )
        assert "Own altitude 1640 ft (msl), 490 ft/min." in page.text("#plan")
        page.count_drawn()
        layout = page.page.evaluate(LAYOUT)
        assert bool(layout["column"]) != layout["stacked"]
        # A phone on its side has no room for the profile.
        assert bool(layout["strip"]) == (size != "phone on its side")
        assert layout["radius"] > 0.2 * min(layout["width"], layout["height"])
        across, down = layout["centre"]
        assert across + layout["radius"] < layout["width"] - layout["column"]
        assert down + layout["radius"] < layout["height"] - layout["low"]
        met = page.page.evaluate(
            "metAlong(state.picture, Infinity).map(({ one, run }) => [one.id, run[0][0] - state.picture.time, run[0][1]])"
        )
        (side, time, altitude), (unknown, _, nothing) = met
        assert (side, unknown, nothing) == ("below", "unknown", None)
        assert time == pytest.approx(5_000.0 / 160.0, abs=4.0) and altitude == pytest.approx(480.0)
        page.page.keyboard.press("u")
        assert "climb to 600 m with 2.5 m/s" in page.text("#order")
        assert page.wrong == []
        page.page.close()


def test_an_aircraft_that_plans_in_the_plane_has_one_tape(alarmed: tuple[Page, Served]) -> None:
    layout = alarmed[0].page.evaluate(LAYOUT)
    assert (layout["strip"], layout["column"], layout["stacked"]) == (0, 0, False)


def test_a_turn_is_drawn_as_long_as_it_is_expected(alarmed: tuple[Page, Served]) -> None:
    """A quarter of a circle in 15 s, or a part of it, then straight; as small steps make it."""
    where = "after({ x: 0, y: 0, vx: 60, vy: 0, turn_deg: 6, turn_s: %g }, 40)"
    page = alarmed[0].page
    for lasts in (15.0, 5.0, 0.0):
        x, y, turned = 0.0, 0.0, 0.0
        for _ in range(4_000):
            x, y = x + 0.6 * np.cos(turned), y + 0.6 * np.sin(turned)
            turned = min(turned + np.radians(0.06), np.radians(6.0 * lasts))
        assert page.evaluate(where % lasts) == pytest.approx([x, y], abs=2.0)


@pytest.mark.parametrize("size", SIZES)
def test_the_ring_fills_what_the_screen_leaves(new_page: Any, size: str) -> None:
    with serving(alarming()) as server:
        page = Page(new_page, server.url, size)
        radius, width, height = page.page.evaluate(
            "((box) => [view(state.picture, box.clientWidth, box.clientHeight).radius, box.clientWidth, box.clientHeight])(sky.box)"
        )
        assert radius > 0.3 * min(width, height)
        page.page.close()


def test_who_flies_is_told_from_what_is_advice_and_from_what_follows(new_page: Any) -> None:
    source = alarming()
    source.scene = take(source.scene, STATUS, status(0, state=1), NOW)
    with serving(source) as server:
        page = Page(new_page, server.url)
        assert page.text("#order").startswith("Advice, not flown: turn left to track 030°")
        assert page.page.evaluate("getComputedStyle(get('order')).fontStyle") == "italic"
        page.page.close()


@pytest.mark.parametrize("size", SIZES)
def test_texts_have_contrast_and_fit_at_every_size(new_page: Any, size: str) -> None:
    contrast = """() => {
      const channel = (v) => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
      const light = (colour) => { const [r, g, b] = colour.match(/[0-9a-f]{2}/gi).map((h) => channel(parseInt(h, 16))); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
      const { colours } = state, ratio = (a, b) => { const [x, y] = [light(a), light(b)].sort((p, q) => q - p); return (x + 0.05) / (y + 0.05); };
      const names = ["ink", "soft", "own", "plan", "backup", "route", "area", "goal", "free", "preventive", "corrective", "warning", "recovery", "traffic", "bad"];
      return Object.fromEntries(names.map((name) => [name, Math.min(ratio(colours[name], colours.paper), ratio(colours[name], colours.panel))]));
    }"""
    with serving(alarming()) as server:
        for scheme in ("light", "dark"):
            page = Page(new_page, server.url, size, scheme)
            ratios = page.page.evaluate(contrast)
            assert ratios["ink"] >= 7.0 and ratios["soft"] >= 7.0
            assert {name: ratio for name, ratio in ratios.items() if ratio < 4.5} == {}
            width = page.page.evaluate("document.documentElement.scrollWidth")
            assert width <= SIZES[size][0]
            small = page.page.evaluate(
                "[...document.querySelectorAll('button')].filter((b) => b.offsetParent && (b.offsetWidth < 44 || b.offsetHeight < 44)).map((b) => b.id)"
            )
            assert small == []
            assert page.count_drawn() > 10_000
            assert page.wrong == []
            page.page.close()


EYES = "protanopia", "deuteranopia", "tritanopia", "achromatopsia"
COLOURS = [
    "own",
    "plan",
    "backup",
    "route",
    "area",
    "goal",
    "wind",
    "free",
    "preventive",
    "corrective",
    "warning",
    "recovery",
    "traffic",
    "ok",
    "bad",
]


def luminance(colour: Any) -> float:
    """Return the relative luminance of a colour, 0 to 255, as WCAG 2 defines it."""
    linear = [
        value / 12.92 if value <= 0.03928 else ((value + 0.055) / 1.055) ** 2.4
        for value in (component / 255.0 for component in colour)
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_colour_stands_out_for_every_eye(new_page: Any, scheme: str) -> None:
    """By the browser's own model of colour-vision deficiencies, against paper and panel."""
    names = [*COLOURS, "paper", "panel"]
    swatches = """(names) => { document.body.innerHTML = ""; document.body.style.display = "block";
      for (const name of names) { const one = document.createElement("div");
        one.style.cssText = `height: 20px; background: var(--${name})`; document.body.append(one); } }"""
    with serving(alarming()) as server:
        page = Page(new_page, server.url, "desk", scheme).page
        page.evaluate(swatches, names)
        session = page.context.new_cdp_session(page)
        for eye in EYES:
            session.send("Emulation.setEmulatedVisionDeficiency", {"type": eye})
            shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            light = {
                name: luminance(shot.getpixel((9, 20 * n + 9))) for n, name in enumerate(names)
            }
            for name in COLOURS:
                for under in ("paper", "panel"):
                    low, high = sorted((light[name], light[under]))
                    contrast = (high + 0.05) / (low + 0.05)
                    assert contrast >= 4.0, (eye, name, under, contrast)
        page.close()


SIGNS = """() => {
  const colours = Object.fromEntries(Object.keys(state.colours).map((name) => [name, "#000"]));
  colours.paper = "#fff";
  const canvas = document.createElement("canvas"), size = 64, half = size / 2;
  canvas.width = canvas.height = size;
  const pen = canvas.getContext("2d"), signs = {};
  for (const level of [0, 1, 2, 3]) for (const late of [false, true])
    signs[`mark ${level} ${late}`] = () => airmap.mark(pen, half, half, level, 8, "#000", "#fff", { late });
  for (const region of [0, 1, 2, 3, 4])
    signs[`ring ${region}`] = () => airmap.bands(pen, half, size, 30, 22, 0, Array.from({ length: 72 }, (_, n) => 5 * n), Array(72).fill(region), colours);
  for (const open of [false, true]) signs[`bug ${open}`] = () => airmap.bug(pen, half, size, 40, 0, 0, "#000", "#fff", open);
  return Object.fromEntries(Object.entries(signs).map(([name, draw]) => {
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, size, size);
    draw();
    return [name, Array.from(pen.getImageData(0, 0, size, size).data).filter((_, n) => n % 4 === 0)];
  }));
}"""


def test_signs_are_told_apart_without_their_colours(new_page: Any) -> None:
    """All in black: any two of a kind differ in a tenth of the pixels that either of them inks."""
    with serving(alarming()) as server:
        page = Page(new_page, server.url).page
        drawn = {name: np.array(pixels) < 128 for name, pixels in page.evaluate(SIGNS).items()}
        page.close()
    assert all(ink.sum() > 20 for ink in drawn.values())
    for (a, first), (b, second) in itertools.combinations(drawn.items(), 2):
        if a.split()[0] == b.split()[0]:
            assert (first ^ second).sum() > 0.1 * (first | second).sum(), (a, b)


def test_a_recording_is_played_stepped_and_sought(new_page: Any, tmp_path: Path) -> None:
    with serving(read(encounter(tmp_path))) as server:
        page = Page(new_page, server.url)
        clock = page.page.locator("#clock")
        assert page.page.is_visible("#seek")
        assert clock.inner_text() == "0 s" and page.text("#alerts") == "none"
        page.page.keyboard.press("ArrowRight")
        expect(clock).to_have_text("1 s")
        page.page.evaluate("get('seek').value = 40; get('seek').dispatchEvent(new Event('input'))")
        expect(page.page.locator("#alerts")).to_contain_text("corrective: intruder 1")
        assert page.page.evaluate("state.picture.at") == 40
        page.page.select_option("#pace", "16")
        page.page.click("#play")
        expect(clock).to_have_text("60 s", timeout=60_000.0)
        assert page.text("#play") == "Play"
        assert page.wrong == []
        page.page.close()
