"""How soon a report's page is ready in a browser: ``python -m benchmarks.report_page
runs/circle/report.html``.

Ready is when the page has read its data, drawn the plots and listed the flights: the page notes the
time since its own start. The limit is what the browser needs to read as many bytes as JSON,
measured beside it in an empty page.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.measure import find_chromium, report
from commands.command import Parser, run_cli, whole

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_DESCRIPTION = (
    "Measure how soon a report's page is ready in Chromium, ms from the start of its loading."
)

_PARSED = (
    "text => { const begin = performance.now(); JSON.parse(text); return performance.now() "
    "- begin; }"
)


def main(argv: list[str] | None = None) -> None:
    """Measure and print the figures."""
    parser = Parser(prog="python -m benchmarks.report_page", description=_DESCRIPTION)
    parser.add_argument("page", type=Path, help="report.html, as eval.report writes it")
    parser.add_argument(
        "--repeats",
        type=whole(1),
        default=5,
        metavar="N",
        help="how often it is opened (default 5)",
    )
    options = parser.parse_args(argv)
    if not options.page.is_file():
        parser.error(f"{options.page}: no such file; python -m eval.report DIR writes one")
    browser = find_chromium()

    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        launched = driver.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        ready = [_ready_ms(launched, options.page) for _ in range(options.repeats)]
        text = json.dumps([0.125] * (options.page.stat().st_size // 7))
        parsed = launched.new_page().evaluate(_PARSED, text)
        launched.close()
    figures = {
        "megabytes": options.page.stat().st_size / 1e6,
        "ready_ms": sorted(ready),
        "as_many_bytes_of_json_ms": parsed,
    }
    report(figures, ("playwright",))


def _ready_ms(browser: "Browser", path: Path) -> int:
    """Open the page anew and return what it says of itself, ms."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(path.resolve().as_uri())
    page.wait_for_selector("html[data-ready]", timeout=60_000)
    ready = page.get_attribute("html", "data-ready")
    assert ready is not None
    page.close()
    return int(ready)


if __name__ == "__main__":
    run_cli(main)
