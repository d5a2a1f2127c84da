"""Where tests find recorded encounters, which are not part of the project: RLCAS_DATA, or beside the checkout."""

import os
from pathlib import Path

import pytest

__all__ = ["case", "recorded"]


def recorded(name: str) -> Path:
    """Return the path of a file or folder of recorded data, or skip the test."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    path = Path(os.environ.get("RLCAS_DATA") or beside) / name
    if not path.exists():
        pytest.skip(f"{name} is not part of the project: set RLCAS_DATA to a folder that has it")
    return path


def case(name: str) -> Path:
    """Return the path of a synthetic case beside the recorded data, or skip the test."""
    path = recorded(".").parent / "cases" / name
    if not path.exists():
        pytest.skip(f"{name} is not part of the project: put it beside the folder of RLCAS_DATA")
    return path
