"""The folder of a command: made anew, then a JSON file with what was found, and pictures as PNG and
SVG.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.config.load import ConfigError
from envs.edge.figures import save_figure
from envs.edge.files import check_space, write_file
from eval.runner.outputs import check_unused


def create(folder: Path, needed: int = 2_000_000) -> None:
    """Make a folder that is new, or take one that is empty, with room for so many bytes; else
    ``ConfigError``.
    """
    check_space(folder, needed, "the files of this command")
    check_unused(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise ConfigError(f"--out {folder}: cannot be written: {problem.strerror}") from None


def write(
    folder: Path, name: str, found: Mapping[str, Any], figure: Any = None, dpi: int = 130
) -> None:
    """Write ``name.json`` and, of a matplotlib figure, ``name.png`` (pixels per inch) and
    ``name.svg``.
    """
    write_file(folder / f"{name}.json", json.dumps(found, indent=2, allow_nan=False) + "\n")
    if figure is not None:
        save_figure(figure, folder / name, dpi)
