"""The report in a real browser: it replays what is clicked, obeys the keyboard, and needs no
network.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands.command import visible
from eval.report.data import choose, page_data
from eval.report.folder import read_run
from eval.report.page import page
from tests.eval.conftest import HOSTILE, TRACKS

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")


class Opened:
    """A page with what it asked for and what went wrong in it."""

    def __init__(
        self, new_page: Any, path: Path, fragment: str = "", scheme: str = "light"
    ) -> None:
        self.page = new_page(viewport={"width": 1280, "height": 900}, color_scheme=scheme)
        self.asked: list[str] = []
        self.wrong: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda problem: self.wrong.append(str(problem)))
        self.page.on("console", lambda message: self.wrong.append(message.text))
        self.page.goto(path.as_uri() + fragment)
        self.page.wait_for_selector("html[data-ready]")

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)

    def chosen_number(self) -> int:
        return int(re.match(r"Encounter (\d+)", self.text("#chosen"))[1])

    def list_entries(self) -> list[str]:
        return self.page.eval_on_selector_all(
            "#list option", "options => options.map((o) => o.textContent)"
        )

    def paper(self) -> str:
        return self.page.evaluate("getComputedStyle(document.body).backgroundColor")


@pytest.fixture
def opened(new_page: Any, report_page: Path) -> Iterator[Opened]:
    opened_page = Opened(new_page, report_page)
    yield opened_page
    assert opened_page.wrong == []
    opened_page.page.close()


def read_data(path: Path) -> dict[str, Any]:
    return json.loads(
        re.search(r'id="data">(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)[1]
    )


def test_it_opens_on_a_flight_and_asks_for_nothing_but_itself(
    opened: Opened, report_page: Path
) -> None:
    assert len(opened.list_entries()) == len(read_data(report_page)["flights"]) == TRACKS
    assert opened.asked == [report_page.as_uri()]
    assert opened.page.eval_on_selector("#tracks canvas", "canvas => canvas.width > 100")


def test_a_click_on_a_point_of_either_plot_replays_that_encounter(opened: Opened) -> None:
    place = """(id) => {
        const chart = echarts.getInstanceByDom(document.getElementById(id));
        const series = chart.getOption().series.filter((s) => s.id.startsWith("kind"));
        const at = (s, value) => chart.convertToPixel({ seriesId: s.id }, value);
        const points = series.flatMap((s) => s.data.map((value) => ({ value, at: at(s, value) })));
        const alone = (p) => points.every((q) => p === q || Math.hypot(p.at[0] - q.at[0], p.at[1] - q.at[1]) > 15);
        const [x, y] = points.find(alone).at;
        return [x, y, points.find(alone).value[2]];
    }"""
    for name in ("plane", "polar"):
        opened.page.select_option("#order", "longest")
        x, y, row = opened.page.evaluate(place, name)
        opened.page.click(f"#{name}", position={"x": x, "y": y})
        assert (
            opened.chosen_number() == row
        )  # every encounter is a point here, so that the row is the number


def test_the_filter_leaves_only_what_is_ticked(opened: Opened) -> None:
    everything = opened.list_entries()
    opened.page.uncheck('input[name="kind"][value="0"]')
    failures = opened.list_entries()
    assert failures == [text for text in everything if "success" not in text]
    assert 0 < len(failures) < len(everything)
    opened.page.check('input[name="kind"][value="0"]')
    opened.page.check("#near")
    assert all(int(re.search(r"(\d+) m ·", text)[1]) <= 1_050 for text in opened.list_entries())


def test_it_opens_with_the_losses_and_ends_with_what_nobody_could_solve(
    opened: Opened, report_page: Path
) -> None:
    rank = ["loss of separation", "time-out", "success", "proven unresolvable"]
    kinds = [next(kind for kind in rank if f"· {kind} ·" in text) for text in opened.list_entries()]
    assert "loss of separation" in kinds and "success" in kinds
    assert kinds == sorted(kinds, key=rank.index)
    assert "· loss of separation ·" in opened.text("#chosen")


def test_goal_tracks_and_separation_differ_in_the_legend(opened: Opened) -> None:
    entries = opened.page.evaluate(
        """() => {
        const chart = echarts.getInstanceByDom(document.getElementById("tracks"));
        return chart.getOption().legend[0].data.map((one) => [one.name, one.icon ?? "line", one.itemStyle?.borderType ?? "solid"]);
        }"""
    )
    shapes = {name: (icon, border) for name, icon, border in entries}
    disc = next(name for name in shapes if "around the nearest" in name)
    assert shapes["intruder"] == shapes["ownship"] == ("line", "solid")
    assert len({shapes["goal"], shapes["intruder"], shapes[disc]}) == 3


def test_the_replay_shows_which_ways_are_free(opened: Opened, report_page: Path) -> None:
    runs = np.array(
        read_data(report_page)["flights"][str(opened.chosen_number())]["bands"]["tracks"]
    )
    rows = np.repeat(runs[::2], runs[1::2]).reshape(-1, 72)
    for time in (0, len(rows) - 1):
        opened.page.evaluate(
            "(time) => { const at = document.getElementById('time'); at.value = time;"
            " at.dispatchEvent(new Event('input')); }",
            time,
        )
        assert f"{np.sum(rows[time] == 0)} of 72 directions" in opened.text("#free")
    colours = opened.page.evaluate(
        "(() => { const canvas = document.querySelector('#bands canvas');"
        " const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;"
        " const seen = new Set(); for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255)"
        " seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]); return [...seen]; })()"
    )
    assert 0xA8002D in colours  # it is a loss of separation: warnings at the end


def test_the_keyboard_is_enough(opened: Opened) -> None:
    first = opened.chosen_number()
    opened.page.focus("#list")
    opened.page.keyboard.press("ArrowDown")
    assert opened.chosen_number() != first
    opened.page.focus("#time")
    opened.page.keyboard.press("Home")
    assert opened.text("#clock") == "0 s"
    start = opened.text("#moment")
    for _ in range(3):
        opened.page.keyboard.press("ArrowRight")
    assert opened.text("#clock") == "3 s"
    assert opened.text("#moment") != start
    opened.page.focus("#play")
    opened.page.keyboard.press("Enter")
    playwright.expect(opened.page.locator("#clock")).not_to_have_text("3 s")
    reached = {opened.page.evaluate("document.activeElement.id")}
    for _ in range(40):
        opened.page.keyboard.press("Tab")
        reached.add(opened.page.evaluate("document.activeElement.id"))
    assert {
        "theme",
        "near",
        "tracked",
        "order",
        "list",
        "previous",
        "next",
        "goto",
        "play",
        "time",
        "speed",
    } <= reached


def test_the_distance_shown_is_that_of_the_tracks(opened: Opened) -> None:
    separation = float(
        re.search(r"· (\d+) m ·", opened.text("#chosen").removeprefix("Encounter"))[1]
    )
    distance = float(re.search(r"distance (\d+) m", opened.text("#moment"))[1])
    # The replay begins at the second in which the closest approach was.
    assert abs(distance - separation) < 150.0


def test_an_encounter_without_tracks_says_how_to_get_them(
    opened: Opened, report_page: Path
) -> None:
    data = read_data(report_page)
    number = next(number for number in range(data["count"]) if str(number) not in data["flights"])
    opened.page.fill("#goto", str(number))
    opened.page.keyboard.press("Enter")
    assert opened.chosen_number() == number
    assert f"--show {number}" in opened.text("#note")
    assert opened.page.is_disabled("#play")
    opened.page.fill("#goto", "987654")
    opened.page.keyboard.press("Enter")
    assert "not on this page" in opened.text("#note")


def test_a_fragment_names_the_encounter(new_page: Any, report_page: Path) -> None:
    number = int(next(iter(read_data(report_page)["flights"])))
    opened = Opened(new_page, report_page, f"#{number}")
    assert opened.chosen_number() == number
    opened.page.close()


def test_names_from_the_data_stay_text(opened: Opened) -> None:
    assert f"\u2068{opened.chosen_number()} {visible(HOSTILE)}\u2069" in opened.text("#chosen")
    assert opened.page.title() != "lost"
    assert opened.page.eval_on_selector_all("main img, main b", "found => found.length") == 0


def test_the_browser_is_forbidden_every_connection(new_page: Any, report_page: Path) -> None:
    opened = Opened(new_page, report_page)
    script = """() => new Promise((done) => {
        addEventListener("securitypolicyviolation", (event) => done(event.violatedDirective));
        fetch("http://127.0.0.1:9/").catch(() => setTimeout(() => done("reached"), 500));
    })"""
    assert opened.page.evaluate(script) == "connect-src"
    opened.page.close()


def test_light_dark_and_paper(new_page: Any, report_page: Path) -> None:
    dark = Opened(new_page, report_page, scheme="dark")
    assert dark.paper() == "rgb(20, 23, 26)"
    dark.page.click("#theme")
    assert dark.paper() == "rgb(255, 255, 255)"
    dark.page.click("#theme")
    dark.page.emulate_media(media="print")
    dark.page.wait_for_selector("html[data-printing]")
    assert dark.paper() == "rgb(255, 255, 255)"
    assert not dark.page.is_visible("#filter")
    assert dark.page.is_visible("#tracks")
    assert dark.page.evaluate("document.querySelector('#tracks canvas').clientWidth") <= 690
    dark.page.emulate_media(media="screen")
    dark.page.wait_for_selector("html:not([data-printing])")
    assert dark.paper() == "rgb(20, 23, 26)"
    assert dark.wrong == []
    dark.page.close()


def test_ten_thousand_encounters_are_one_page_of_15_mb_that_lists_its_flights(
    new_page: Any, report_run: Path, report_page: Path, tmp_path: Path
) -> None:
    small, count = read_run(report_run), 10_000
    rows = np.arange(count) % len(small.kinds)
    table = {name: values[rows] for name, values in small.table.items()} | {
        "encounter": np.arange(count)
    }
    # As dense as a real run, so that the points must all be drawn.
    table["bearing_deg"] = np.random.default_rng(0).uniform(-180.0, 180.0, count)
    config = small.config.model_copy(update={"encounters": count})
    run = small._replace(table=table, kinds=small.kinds[rows], config=config)
    stored_flights = read_data(report_page)["flights"]
    flights = {
        number: stored_flights[str(rows[number])]
        for number in range(count)
        if str(rows[number]) in stored_flights
    }
    flights = dict(list(flights.items())[:1_000])
    large = tmp_path / "report.html"
    large.write_text(
        page(run, choose(run, 1_000), page_data(run, np.arange(count), flights), "a test"), "utf-8"
    )
    assert large.stat().st_size < 15_000_000
    opened = Opened(new_page, large)
    assert len(opened.list_entries()) == 1_000
    opened.page.close()
