"""A policy, an aircraft or a sample is a thing: no pronoun for persons in code, keys, messages and pages."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
# In pieces, so that this file does not hold them either. An underscore ends a word, so that keys and names count.
_PIECES = (("w", "ho"), ("wh", "oever"), ("w", "hom"), ("h", "e"), ("h", "im"), ("hi", "s"), ("to", "ld"))
WORD = re.compile(rf"(?<![a-z])({'|'.join(map(''.join, _PIECES))})(?![a-z])", re.IGNORECASE)
READ = {".cfg", ".css", ".g", ".html", ".md", ".msg", ".py", ".sdf", ".srv", ".svg", ".toml", ".xml", ".yaml", ".yml"}


def texts() -> list[str]:
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("git does not list the files")
    return [name for name in listed.split("\0") if Path(name).suffix in READ and (ROOT / name).is_file()]


def test_no_thing_is_called_a_person() -> None:
    found = [
        f"{name}:{number}: {line.strip()}"
        for name in texts()
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1)
        if WORD.search(line)
    ]
    assert not found, "\n".join(found)
