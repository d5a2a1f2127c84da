"""The folder of a command that makes one picture: a JSON file with its figures, and the picture as PNG and SVG."""

import json
from pathlib import Path
from typing import Any

from agents.config.figures import save_figure
from agents.config.load import ConfigError
from envs.edge.files import check_space, write_file

__all__ = ["create", "write", "write_found"]

_PICTURES = 2_000_000  # bytes of a few figures


def create(folder: Path, needed: int = _PICTURES) -> None:
    """Make a folder that is new, or take one that is empty.

    Args:
        folder: to be written.
        needed: bytes that its files take, generously.

    Raises:
        ConfigError: it holds something already, has too little room, or cannot be written.
    """
    check_space(folder, needed, "the files of this command")
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ConfigError(f"--out {folder}: holds something already, expected a folder that is new or empty")
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise ConfigError(f"--out {folder}: cannot be written: {problem.strerror}") from None


def write(folder: Path, name: str, found: dict[str, Any], figure: Any, dpi: int) -> None:
    """Write ``name.json``, ``name.png`` and ``name.svg``.

    Args:
        folder: where to.
        name: of the files.
        found: in JSON types.
        figure: matplotlib's.
        dpi: of the PNG, pixels per inch.
    """
    write_found(folder, name, found)
    save_figure(figure, folder / name, dpi)


def write_found(folder: Path, name: str, found: dict[str, Any]) -> None:
    """Write ``name.json`` alone: the figures, in JSON types."""
    write_file(folder / f"{name}.json", json.dumps(found, indent=2, allow_nan=False) + "\n")
