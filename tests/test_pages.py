"""The code in the documentation runs, and prints what the pages say it prints.

The Python blocks of a page run one after the other in one interpreter. A text block that follows one is its output. A
block below ``<!-- not run: reason -->`` is compiled, and its imports of ours are tried.
"""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"(<!-- not run: [^>]+ -->\s+)?```(python|text)\n(.*?)```", re.DOTALL)
OURS = ("envs", "agents", "rlcas_jax", "eval", "ros_bridge")
SLOW = ("docs/explanation/resolvability.md",)
LIBRARIES = {
    "docs/tutorial/first-report.md": ("gymnasium",),
    "docs/howto/gymnasium.md": ("gymnasium", "jax", "PIL"),
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
    "page", [pytest.param(page, marks=pytest.mark.slow) if page in SLOW else page for page in pages(run=True)]
)
def test_the_code_of_a_page_runs_and_prints_what_it_says(page: str, tmp_path: Path) -> None:
    for library in LIBRARIES.get(page, ()):
        pytest.importorskip(library)
    runnable = [block for block in blocks(page) if block.runs]
    program = "\nprint('-- next --')\n".join(block.code for block in runnable)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    outputs = done.stdout.split("-- next --\n")
    for block, printed in zip(runnable, outputs, strict=True):
        assert block.printed is None or block.printed == printed


@pytest.mark.parametrize("page", pages(run=False))
def test_code_that_is_not_run_imports_names_that_exist(page: str) -> None:
    for block in blocks(page):
        for node in ast.walk(ast.parse(block.code)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in OURS:
                module = pytest.importorskip(node.module, exc_type=ImportError)
                for alias in node.names:
                    if not hasattr(module, alias.name):
                        importlib.import_module(f"{node.module}.{alias.name}")


def test_pages_are_short() -> None:
    texts = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md")
    }
    assert not [page for page, text in texts.items() if len(text.splitlines()) > 250]
    assert sum(len(text.split()) for text in texts.values()) <= 45_000
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 140


NAME = re.compile(rf"`((?:{'|'.join(OURS)}|benchmarks)(?:\.\w+)+)")
COMMAND = re.compile(r"python -m ((?:\w+\.)*\w+)")
FILE = re.compile(r"`((?:agents|benchmarks|configs|docs|envs|eval|rlcas_jax|ros_bridge|tests)/[\w./-]+\.\w+)`")

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
        gone += [f"{page}: {name}" for name in NAME.findall(text) if not exists(name)]
        gone += [
            f"{page}: python -m {name}"
            for name in COMMAND.findall(text)
            if name.split(".")[0] in (*OURS, "benchmarks") and not name.endswith(".NAME") and not exists(name)
        ]
        gone += [f"{page}: {name}" for name in FILE.findall(text) if not (ROOT / name).exists()]
        gone += [
            f"{page}: {name} in {file}"
            for file, names in IN_FILE.findall(text)
            for name in re.findall(r"`(\w+)`", names)
            if (ROOT / file).exists() and name not in names_of(ROOT / file)
        ]
    assert not gone, "\n".join(gone)


CALL = re.compile(r"python -m ((?:agents|benchmarks|envs|eval|rlcas_jax|ros_bridge)[\w.]*)((?:\\\n|[^\n`#|])*)")


def calls() -> dict[str, set[str]]:
    """Return the options that the pages give to each program."""
    found: dict[str, set[str]] = {}
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for program, rest in CALL.findall(path.read_text(encoding="utf-8")):
            given = re.findall(r"(?<=\s)--[a-z][a-z-]*", rest.split("--ros-args")[0])
            if not program.endswith(".NAME"):
                found.setdefault(program, set()).update(given)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("program", sorted(calls()))
def test_options_in_pages_are_options_of_the_program(program: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", program, "--help"], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode == 2 and "extra" in done.stderr:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    assert not {option for option in calls()[program] if option not in done.stdout}
