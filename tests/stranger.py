"""A stranger: takes the code of the pages, and runs commands in a folder of its own."""

import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"


def python_blocks(page: str) -> list[str]:
    """Return the Python code of a page below ``docs``, a text a block."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


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
