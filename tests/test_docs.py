"""The documentation: its code runs, what it names exists, pages are short, and the site builds
without a network.

The Python blocks of a page run one after the other in one interpreter. A text block that follows
one is its output. A block below ``<!-- not run: reason -->`` is compiled, and its imports of ours
are tried."""

import ast
import csv
import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, NamedTuple

import pytest

from agents.inference import Policy
from agents.planner import plan
from envs.aircraft import PAPER
from envs.formats import encounter_file
from envs.kinematics import VehicleState
from envs.scenarios import SHIPPED, scenario
from envs.scenarios.table import MODIFIERS, SCENARIOS
from envs.starts import encounters_of_seed
from envs.waypoints import RoutePoint
from tests.agents.scenes import PATIENT

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(<!-- not run: [^>]+ -->\s+)?```(python|text)\n(.*?)```", re.DOTALL)
OURS = ("commands", "envs", "agents", "rlcas_jax", "eval", "ros_bridge")
SLOW = (
    "docs/explanation/resolvability.md",
    "docs/howto/gymnasium.md",
    "docs/howto/own-aircraft.md",
    "docs/howto/own-algorithm.md",
    "docs/howto/own-policy.md",
)
LIBRARIES = {
    "docs/tutorial/first-report.md": ("gymnasium",),
    "docs/howto/gymnasium.md": ("gymnasium", "jax"),
    "docs/howto/own-algorithm.md": ("jax",),
    "docs/explanation/aircraft.md": ("jsbsim",),
}


class Block(NamedTuple):
    """A Python block of a page."""

    code: str
    runs: bool
    printed: str | None


def blocks(page: str) -> list[Block]:
    found: list[Block] = []
    for held, language, text in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
        if language == "python":
            found.append(Block(text, not held, None))
        elif found and found[-1].printed is None and found[-1].runs:
            found[-1] = found[-1]._replace(printed=text)
    return found


def pages(*, run: bool) -> list[str]:
    """Return the pages with code that is run, or not run."""
    everything = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    names = [path.relative_to(ROOT).as_posix() for path in everything]
    return [page for page in names if any(block.runs is run for block in blocks(page))]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=pytest.mark.slow) if page in SLOW else page
        for page in pages(run=True)
    ],
)
def test_the_code_of_a_page_runs_and_prints_what_it_says(page: str, tmp_path: Path) -> None:
    for library in LIBRARIES.get(page, ()):
        pytest.importorskip(library)
    runnable = [block for block in blocks(page) if block.runs]
    program = "\nprint('-- next --')\n".join(block.code for block in runnable)
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=1_200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    outputs = done.stdout.split("-- next --\n")
    for block, printed in zip(runnable, outputs, strict=True):
        assert block.printed is None or block.printed == printed


def text_blocks(page: str) -> list[str]:
    """Return the printed output on a page."""
    return re.findall(r"```text\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


def evaluate(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run an evaluation in a folder."""
    return subprocess.run(
        [sys.executable, "-m", "eval.monte_carlo", "--workers", "1", *options],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=1_200,
        check=False,
    )


@pytest.mark.slow
def test_the_refusal_on_the_page_of_encounters_is_the_one_that_is_printed(tmp_path: Path) -> None:
    encounters = encounters_of_seed(scenario("circle", PAPER), seed=0, first=0, count=1)
    encounter_file.write(tmp_path / "mine.csv", encounters)
    with (tmp_path / "mine.csv").open(encoding="utf-8", newline="") as file:
        row = next(csv.DictReader(file))
    with (tmp_path / "mine.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        writer.writeheader()
        writer.writerow(row | {"own_speed_m_s": "45"})
    done = evaluate(tmp_path, "--scenario", "file:mine.csv", "--out", "out")
    assert (done.returncode, done.stdout) == (2, "")
    said = done.stderr.replace(str(tmp_path), "/flights")
    assert [said] == text_blocks("docs/howto/own-encounters.md")


@pytest.mark.slow
def test_the_table_of_the_tutorial_has_the_rows_that_an_evaluation_prints(tmp_path: Path) -> None:
    """Its figures are those of a policy that the reader trains."""
    done = evaluate(tmp_path, "--encounters", "20", "--out", "out")
    assert done.returncode == 0, done.stderr
    printed = [line.strip("│ ") for line in done.stdout.splitlines()]
    first, heads, *rows, rest = text_blocks("docs/tutorial/first-report.md")[1].splitlines()
    assert rest.strip() == "..."
    assert printed[0].rstrip() == first.replace("10 000", "20")
    assert re.findall(r"\w[\w %]*\w", heads.replace("  ", "|")) == re.findall(
        r"\w[\w %]*\w", printed[2].strip("┃ ")
    )
    names = [re.split(r"\s+│", line)[0] for line in printed[4:]]
    wanted = [re.sub(r"\s+[\d.]+ %.*", "", row).strip() for row in rows]
    assert names[: len(wanted)] == wanted


def import_or_skip(name: str) -> ModuleType:
    """Import a module of ours, or skip the test where it needs a library that is not installed."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as problem:
        if problem.name is None or problem.name.split(".")[0] in OURS:
            raise
        pytest.skip(f"{problem.name} is not installed")


@pytest.mark.parametrize("page", pages(run=False))
def test_code_that_is_not_run_imports_names_that_exist(page: str) -> None:
    for block in blocks(page):
        for node in ast.walk(ast.parse(block.code)):
            if (
                isinstance(node, ast.ImportFrom)
                and node.module
                and node.module.split(".")[0] in OURS
            ):
                module = import_or_skip(node.module)
                for alias in node.names:
                    if not hasattr(module, alias.name):
                        import_or_skip(f"{node.module}.{alias.name}")


OLDER = re.compile("|".join(name for name in SHIPPED if ":" in name))
"""Names of scenarios that look like those of modules."""

NAME = re.compile(rf"`((?:{'|'.join(OURS)}|benchmarks)(?:\.\w+)+)")
COMMAND = re.compile(r"python -m ((?:\w+\.)*\w+)")
FILE = re.compile(
    r"`((?:agents|benchmarks|commands|configs|docs|envs|eval|rlcas_jax|ros_bridge|tests)/[\w./-]+\.\w+)`"
)
IN_FILE = re.compile(r"`([\w/]+\.py)` \(((?:`\w+`(?:, )?)+)\)")


def names_of(module: Path) -> set[str]:
    """Return the names that a module defines or imports at its top, and those of its classes."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    return found


def exists(name: str) -> bool:
    """Say whether a dotted name leads to a module of ours, or to a name in one."""
    path, rest = ROOT, name.split(".")
    while rest and (path / rest[0]).is_dir():
        path /= rest.pop(0)
    module = path / "__init__.py"
    if rest and (path / f"{rest[0]}.py").is_file():
        module = path / f"{rest.pop(0)}.py"
    return module.is_file() and (not rest or rest[0] in names_of(module))


def test_names_and_files_in_pages_exist() -> None:
    paths = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    gone: list[str] = []
    for path in paths:
        text, page = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
        names = NAME.findall(OLDER.sub("", text))
        gone += [f"{page}: {name}" for name in names if not exists(name)]
        gone += [
            f"{page}: python -m {name}"
            for name in COMMAND.findall(text)
            if name.split(".")[0] in (*OURS, "benchmarks")
            and not name.endswith(".NAME")
            and not exists(name)
        ]
        gone += [f"{page}: {name}" for name in FILE.findall(text) if not (ROOT / name).exists()]
        gone += [
            f"{page}: {name} in {file}"
            for file, names in IN_FILE.findall(text)
            for name in re.findall(r"`(\w+)`", names)
            if (ROOT / file).exists() and name not in names_of(ROOT / file)
        ]
    assert not gone, "\n".join(gone)


QUESTIONS = {
    "what is the reward of the shipped policy": ("configs/best.yaml", "envs/rewards.py"),
    "where to add a reward term": ("envs/rewards.py",),
    "where to add a scenario": (
        "envs/encounters.py",
        "envs/scenarios/table.py",
        "envs/scenarios/names.py",
    ),
    "where to add an input of the network": (
        "agents/policy/inputs.py",
        "agents/policy/set_features.py",
        "agents/policy/scene.py",
    ),
    "where to replace PPO": (
        "agents/learning/algorithm.py",
        "rlcas_jax/algorithm.py",
        "rlcas_jax/task.py",
    ),
    "how a request becomes waypoints": (
        "agents/planner/planner.py",
        "agents/planner/search/candidates.py",
        "agents/planner/publish/publish.py",
    ),
    "where SAFE is decided": (
        "agents/planner/publish/publish.py",
        "agents/planner/judge/validator.py",
        "agents/planner/judge/audit.py",
    ),
}
"""Questions that the table of architecture.md answers, and files that belong to the answer."""


@pytest.mark.parametrize(
    ("heading", "names"), [("Geometries", SCENARIOS), ("Modifiers", MODIFIERS)]
)
def test_the_page_of_scenarios_names_each_that_ships_once(
    heading: str, names: Iterable[str]
) -> None:
    page = (ROOT / "docs/howto/scenarios.md").read_text(encoding="utf-8")
    section = page.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    cells = re.findall(r"^\| (`.+?) \|", section, re.MULTILINE)
    assert sorted(re.findall(r"`(\w+)`", " ".join(cells))) == sorted(names)


@pytest.mark.parametrize(
    ("message", "definition"),
    [
        ("Trajectory", "msg/Trajectory.msg"),
        ("Waypoint", "msg/Waypoint.msg"),
        ("AircraftState", "msg/AircraftState.msg"),
        ("GenerateTrajectory", "srv/GenerateTrajectory.srv"),
    ],
)
def test_the_page_of_ros_names_the_fields_of_a_message_in_their_order(
    message: str, definition: str
) -> None:
    page = (ROOT / "docs/reference/ros.md").read_text(encoding="utf-8")
    rows = re.search(rf"^\| `{message}` \|.*\n\|---.*\n((?:\|.*\n)+)", page, re.MULTILINE)
    assert rows is not None
    named = [name for row in rows[1].splitlines() for name in re.findall(r"`(\w+)`", cell(row))]
    text = (ROOT / "ros_bridge/rlcas_msgs" / definition).read_text(encoding="utf-8")
    text = text.rpartition("\n---\n")[2]  # of a service its answer
    assert named == re.findall(r"^[\w/]+(?:\[\])? (\w+)$", text, re.MULTILINE)


@pytest.mark.parametrize(
    ("heading", "definition", "prefixes"),
    [
        ("`Trajectory`", "msg/Trajectory.msg", {"STATUS", "SOURCE"}),
        ("`Waypoint`", "msg/Waypoint.msg", {"ORIGIN", "VALID"}),
        ("`AircraftState`", "msg/AircraftState.msg", {"VALID"}),
        ("`altitude_reference`", "msg/AircraftState.msg", {"ALTITUDE"}),
    ],
)
def test_the_page_of_ros_has_all_codes_of_a_message(
    heading: str, definition: str, prefixes: set[str]
) -> None:
    page = (ROOT / "docs/reference/ros.md").read_text(encoding="utf-8")
    rows = re.search(rf"^\| {heading} \|.*\n\|---.*\n((?:\|.*\n)+)", page, re.MULTILINE)
    assert rows is not None
    text = (ROOT / "ros_bridge/rlcas_msgs" / definition).read_text(encoding="utf-8")
    codes = re.findall(r"^uint\d+ ([A-Z]+)_(\w+) = (\d+)$", text, re.MULTILINE)
    expected = [(name, code) for prefix, name, code in codes if prefix in prefixes]
    assert sorted(re.findall(r"\b([A-Z][A-Z0-9_]+) (\d+)\b", rows[1])) == sorted(expected)


def cell(row: str) -> str:
    """Return the first cell of a row of a table."""
    return row.split("|")[1]


def table_of_answers() -> dict[str, str]:
    """Return the questions of the table of architecture.md, with their answers."""
    page = (ROOT / "docs/explanation/architecture.md").read_text(encoding="utf-8")
    table = page.partition("## Where to find things")[2].partition("\n## ")[0]
    return dict(re.findall(r"^\| (.+?) \| (.+) \|$", table, re.MULTILINE)[1:])


def test_the_table_answers_each_question_with_at_most_three_files() -> None:
    answers = {question: set(FILE.findall(text)) for question, text in table_of_answers().items()}
    assert not {question: files for question, files in answers.items() if not 1 <= len(files) <= 3}
    for question, files in QUESTIONS.items():
        assert answers[question] >= set(files), question


@pytest.mark.parametrize("question", ["how a request becomes waypoints", "where SAFE is decided"])
def test_a_plan_is_made_by_the_functions_that_the_table_names(question: str) -> None:
    called: set[tuple[str, str]] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(str(ROOT)):
            called.add((Path(code.co_filename).relative_to(ROOT).as_posix(), code.co_name))

    policy, route = Policy.load(), [RoutePoint(n, 5_000.0 * n, 0.0) for n in range(2, 12)]
    sys.setprofile(note)
    try:
        plan(VehicleState(0.0, 0.0, 0.0, 75.0), [], route, policy, PATIENT)
    finally:
        sys.setprofile(None)
    named = IN_FILE.findall(table_of_answers()[question])
    pairs = {(file, name) for file, names in named for name in re.findall(r"`(\w+)`", names)}
    assert pairs
    assert pairs <= called


def test_safe_is_decided_where_the_table_says() -> None:
    deciding = set()
    for path in (ROOT / "agents").rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        asked = {
            id(one)
            for each in ast.walk(tree)
            if isinstance(each, ast.Compare)
            for one in ast.walk(each)
        }
        deciding |= {
            path.relative_to(ROOT).as_posix()
            for each in ast.walk(tree)
            if isinstance(each, ast.Attribute) and id(each) not in asked
            if ast.unparse(each) == "Status.SAFE"
        }
    # A receiver of waypoints repeats the word: only SAFE plans have any.
    assert deciding == {QUESTIONS["where SAFE is decided"][0], "agents/planner/recheck.py"}


CALL = re.compile(
    r"python -m ((?:agents|benchmarks|envs|eval|rlcas_jax|ros_bridge)[\w.]*)((?:\\\n|[^\n`#|])*)"
)


def calls() -> dict[str, set[str]]:
    """Return the options that the pages give to each program."""
    found: dict[str, set[str]] = {}
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for program, rest in CALL.findall(path.read_text(encoding="utf-8")):
            given = re.findall(r"(?<=\s)--[a-z][a-z-]*", rest.split("--ros-args")[0])
            if not program.endswith(".NAME"):
                found.setdefault(program, set()).update(given)
    return found


# Asks programs for their help one after the other, because importing what they share takes most of
# the time.
HELP = """
import contextlib, io, json, runpy, sys
answers = {}
for program in sys.argv[1:]:
    out, err = io.StringIO(), io.StringIO()
    sys.argv = [program, "--help"]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = runpy.run_module(program, run_name="__main__", alter_sys=True) and 0
        except SystemExit as end:
            status = end.code or 0
    answers[program] = status, out.getvalue(), err.getvalue()
print(json.dumps(answers))
"""


@pytest.mark.slow
def test_options_in_pages_are_options_of_the_program() -> None:
    wanted = calls()
    done = subprocess.run(
        [sys.executable, "-c", HELP, *wanted],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1_200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answers = json.loads(done.stdout.splitlines()[-1])
    helped = 0
    for program, (status, out, err) in answers.items():
        if status == 2 and "extra" in err:
            continue
        assert status == 0, (program, err)
        assert not {option for option in wanted[program] if option not in out}, program
        helped += 1
    assert helped > len(wanted) / 2


# The documentation site builds strictly without a network, refers to no other host, and leaves no
# page out.


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
            self.loads += [
                given[name] for name in ("src", "srcset", "data", "poster") if name in given
            ]
        self.loads += re.findall(r"url\(['\"]?([^'\")]+)", given.get("style", ""))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="mkdocs is not installed; to have it: make docs")
    pytest.importorskip(
        "mkdocstrings_handlers.python",
        reason="mkdocstrings is not installed; to have it: make docs",
    )
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


def html_pages(site: Path) -> Iterator[tuple[Path, str]]:
    for page in sorted(site.rglob("*.html")):
        yield page, page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_pages_that_are_opened_as_files_can_be_searched(site: Path, new_page: Callable[..., Any]):
    page, faults = new_page(), []
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.goto((site / "howto/train.html").as_uri())
    page.locator(".md-search__input").click()
    page.keyboard.type("certificate")
    page.locator(".md-search-result__link").first.click()
    page.wait_for_url("**h=certificate*")
    assert "certificate" in page.locator("h1").first.inner_text().lower()
    assert not faults


@pytest.mark.slow
def test_no_page_loads_anything_from_another_host(site: Path) -> None:
    found = {
        f"{page.relative_to(site)}: {url}"
        for page, text in html_pages(site)
        for url in Loads(text).loads
        if FOREIGN.match(url)
    }
    styles = {
        f"{sheet.relative_to(site)}: {url}"
        for sheet in site.rglob("*.css")
        for url in re.findall(
            r"(?:url\(|@import)\s*['\"]?([^'\");]+)", sheet.read_text(encoding="utf-8")
        )
        if FOREIGN.match(url)
    }
    assert not found | styles


@pytest.mark.slow
def test_nothing_makes_the_theme_fetch_a_script_or_stars(site: Path) -> None:
    # The theme's own script fetches Mermaid for such blocks, and counts of stars for a repository's
    # address.
    for page, text in html_pages(site):
        assert 'class="mermaid"' not in text, page
        assert 'data-md-component="source"' not in text, page


@pytest.mark.slow
def test_every_link_inside_the_site_leads_to_a_file(site: Path) -> None:
    dead = {
        f"{page.relative_to(site)}: {link}"
        for page, text in html_pages(site)
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
    fields = (site / "reference/code/agents/policy/set_features.html").read_text(encoding="utf-8")
    assert (
        "<p>[..., F]</p>"
        in fields.partition('<h3 id="agents.policy.set_features.SetInputs.own"')[2][:1_000]
    )
    # Modules whose imports are not installed everywhere have pages too: nothing is imported.
    assert 'id="ros_bridge.transport.qos.LATCHED"' in (
        site / "reference/code/ros_bridge/transport/qos.html"
    ).read_text(encoding="utf-8")
    unread = [
        page.name
        for page, page_text in html_pages(site / "reference")
        if re.search(r":(func|class|data|mod):", page_text)
    ]
    assert not unread


FIELDS = """
class Seen:
    x: float  # m
    y: tuple[
        float, ...
    ] = ()  # of each, m
    z: int = 0  # not this
    \"\"\"But this.\"\"\"
    bare: int
    held: list = []  # noqa: RUF012
    COUNT = 3  # no annotation

    def __init__(self):
        self.own: int = 0  # no field
"""


def test_comments_behind_fields_are_their_texts_on_the_site() -> None:
    griffe = pytest.importorskip("griffe", reason="griffe is not installed; to have it: make docs")
    pytest.importorskip("mkdocs", reason="mkdocs is not installed; to have it: make docs")
    extensions = griffe.load_extensions(DOCS / "site_hooks.py")
    with griffe.temporary_visited_module(FIELDS, extensions=extensions) as module:
        texts = {
            name: field.docstring and field.docstring.value
            for name, field in module["Seen"].attributes.items()
        }
    wanted = {"x": "m", "y": "of each, m", "z": "But this."}
    assert texts == dict.fromkeys(("x", "y", "z", "bare", "held", "COUNT", "own")) | wanted


def test_every_page_has_its_place() -> None:
    """Each Markdown file below docs/ stands in ``nav`` of mkdocs.yml, by itself or by its
    folder.
    """
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
    html_pages = [
        page.relative_to(DOCS).as_posix()
        for kind in kinds
        for page in sorted((DOCS / kind).glob("*.md"))
    ]
    missing = [page for page in html_pages if f"({page})" not in listed]
    assert not missing, f"add to docs/README.md: {', '.join(missing)}"
    loose = [page.name for page in DOCS.glob("*.md") if page.name != "README.md"]
    assert not loose, f"each page belongs in one of {kinds}: {', '.join(loose)}"
