import sys
from pathlib import Path

import pytest

from agents.config.keys import keys
from agents.config.load import ConfigError
from rlcas_jax.config import TrainConfig
from rlcas_jax.metrics import METRICS
from rlcas_jax.reference import main, pages

DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"


@pytest.mark.parametrize("name", pages())
def test_the_pages_are_current(name: str):
    written = (DOCS / name).read_text(encoding="utf-8")
    assert written == pages()[name], "run `python -m rlcas_jax.reference docs/reference`"


def test_every_key_and_every_metric_has_its_row():
    assert all(f"\n| `{key.name}` | " in pages()["configuration.md"] for key in keys(TrainConfig))
    assert all(f"\n| `{name}` | " in pages()["metrics.md"] for name in METRICS)


def test_the_command_writes_the_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path)])
    main()
    assert {path.name for path in tmp_path.iterdir()} == set(pages())
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path / "none")])
    with pytest.raises(ConfigError, match="there is no such directory"):
        main()
