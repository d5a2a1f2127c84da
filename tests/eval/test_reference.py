import sys
from pathlib import Path

import pytest

from agents.config.keys import keys
from agents.config.load import ConfigError
from eval.config import MonteCarloConfig
from eval.hifi.config import HifiConfig
from eval.reference import PAGE, main, page

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"


def test_the_page_is_current() -> None:
    assert (DOCS / PAGE).read_text(encoding="utf-8") == page(), "run `python -m eval.reference docs/reference`"


def test_every_key_has_its_row() -> None:
    text = page()
    assert all(f"\n| `{key.name}` | " in text for model in (MonteCarloConfig, HifiConfig) for key in keys(model))


def test_the_command_writes_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path)])
    main()
    assert (tmp_path / PAGE).read_text(encoding="utf-8") == page()
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path / "none")])
    with pytest.raises(ConfigError, match="there is no such directory"):
        main()
