"""A stranger: takes the code of the pages, has modules in a folder of its own, and runs commands
there.
"""

import importlib
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from commands.registry import Registry

DOCS = Path(__file__).parents[1] / "docs"


def python_blocks(page: str) -> list[str]:
    """Return the Python code of a page below ``docs``, a text a block."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def block_with(page: str, text: str) -> str:
    """Return the first block of Python code of a page that holds a text."""
    return next(code for code in python_blocks(page) if text in code)


def names_of(code: str, module: str) -> dict[str, Any]:
    """Return the names that code defines as a module, which is not imported."""
    names: dict[str, Any] = {"__name__": module}
    exec(code, names)
    return names


def settle(
    folder: Path, monkeypatch: pytest.MonkeyPatch, registry: Registry[Any], **modules: str
) -> Path:
    """Make a folder with modules, code by name, the working directory of this process, which has
    imported nothing of them and knows nothing of the user's own. Names of modules begin with my_.
    """
    for name, code in modules.items():
        (folder / f"{name}.py").write_text(code, encoding="utf-8")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [str(folder), *(entry for entry in sys.path if entry)])
    importlib.invalidate_caches()
    for name in [name for name in sys.modules if name.startswith("my_")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(registry, "own", {})
    return folder


def run(folder: Path, *command: str, seconds: float = 1_200.0) -> subprocess.CompletedProcess[str]:
    """Run Python with some arguments in a folder."""
    return subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )


def python(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """Run Python with some arguments in a folder; it must succeed."""
    done = run(folder, *command)
    assert done.returncode == 0, done.stderr
    return done
