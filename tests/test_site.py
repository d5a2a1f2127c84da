"""The documentation site builds strictly without a network, refers to no other host, and leaves no page out."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
FOREIGN = re.compile(r"\s*(https?:)?//", re.IGNORECASE)

# Runs before mkdocs: a request for a connection or a name is refused, and the build with it.
OFFLINE = """
import socket, sys
def refuse(*_, **__): raise RuntimeError("the build asked for the network")
socket.socket.connect = socket.socket.connect_ex = socket.create_connection = socket.getaddrinfo = refuse
from mkdocs.__main__ import cli
cli(["build", "--strict", "--quiet", "--site-dir", sys.argv[1]])
"""


class Loads(HTMLParser):
    """What a browser would fetch for a page by itself, and where its links lead."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if tag == "a":
            self.links.append(given.get("href", ""))
        elif tag == "link" and given.get("rel") not in {"canonical", "next", "prev"}:
            self.loads.append(given.get("href", ""))
        else:
            self.loads += [given[name] for name in ("src", "srcset", "data", "poster") if name in given]
        self.loads += re.findall(r"url\(['\"]?([^'\")]+)", given.get("style", ""))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="mkdocs is not installed; to have it: make docs")
    pytest.importorskip("mkdocstrings_handlers.python", reason="mkdocstrings is not installed; to have it: make docs")
    pytest.importorskip("material", reason="the theme is not installed; to have it: make docs")
    folder = tmp_path_factory.mktemp("site")
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        [sys.executable, "-c", OFFLINE, str(folder)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def pages(site: Path) -> Iterator[tuple[Path, str]]:
    for page in sorted(site.rglob("*.html")):
        yield page, page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_no_page_loads_anything_from_another_host(site: Path) -> None:
    found = {
        f"{page.relative_to(site)}: {url}"
        for page, text in pages(site)
        for url in Loads(text).loads
        if FOREIGN.match(url)
    }
    styles = {
        f"{sheet.relative_to(site)}: {url}"
        for sheet in site.rglob("*.css")
        for url in re.findall(r"(?:url\(|@import)\s*['\"]?([^'\");]+)", sheet.read_text(encoding="utf-8"))
        if FOREIGN.match(url)
    }
    assert not found | styles


@pytest.mark.slow
def test_nothing_makes_the_theme_fetch_a_script_or_stars(site: Path) -> None:
    # The theme's own script fetches Mermaid for such blocks, and counts of stars for a repository's address.
    for page, text in pages(site):
        assert 'class="mermaid"' not in text, page
        assert 'data-md-component="source"' not in text, page


@pytest.mark.slow
def test_every_link_inside_the_site_leads_to_a_file(site: Path) -> None:
    dead = {
        f"{page.relative_to(site)}: {link}"
        for page, text in pages(site)
        if page.name != "404.html"  # its links are absolute: it stands for any address
        for link in Loads(text).links
        if link
        and not re.match(r"[a-z]+:|//|#", link)
        and not (page.parent / link.split("#")[0].split("?")[0]).exists()
    }
    assert not dead


@pytest.mark.slow
def test_docstrings_become_pages_whose_roles_are_links(site: Path) -> None:
    text = (site / "reference/code/agents/policy/features.html").read_text(encoding="utf-8")
    assert 'id="agents.policy.features.features"' in text
    assert 'href="#agents.policy.features.FEATURE_SETS"' in text
    # Modules whose imports are not installed everywhere have pages too: nothing is imported.
    assert 'id="ros_bridge.transport.qos.LATCHED"' in (site / "reference/code/ros_bridge/transport/qos.html").read_text(
        encoding="utf-8"
    )
    unread = [
        page.name for page, page_text in pages(site / "reference") if re.search(r":(func|class|data|mod):", page_text)
    ]
    assert not unread


def test_every_page_has_its_place() -> None:
    """Each Markdown file below docs/ stands in ``nav`` of mkdocs.yml, by itself or by its folder."""
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    named = set(re.findall(r": (\S+)$", nav, re.MULTILINE))
    folders = tuple(entry for entry in named if entry.endswith("/"))
    written = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}
    homeless = {page for page in written - named if not page.startswith(folders)}
    assert not homeless, f"add to nav in mkdocs.yml: {', '.join(sorted(homeless))}"
    gone = {entry for entry in named if entry.endswith(".md")} - written
    assert not gone, f"remove from nav in mkdocs.yml: {', '.join(sorted(gone))}"


def test_the_list_of_pages_names_every_page_of_the_four_kinds() -> None:
    listed = (DOCS / "README.md").read_text(encoding="utf-8")
    kinds = ("tutorial", "howto", "explanation", "reference")
    pages = [page.relative_to(DOCS).as_posix() for kind in kinds for page in sorted((DOCS / kind).glob("*.md"))]
    missing = [page for page in pages if f"({page})" not in listed]
    assert not missing, f"add to docs/README.md: {', '.join(missing)}"
    loose = [page.name for page in DOCS.glob("*.md") if page.name != "README.md"]
    assert not loose, f"each page belongs in one of {kinds}: {', '.join(loose)}"
