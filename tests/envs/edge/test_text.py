"""Text from files on its way to a reader."""

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.edge.command import InputError, run_cli
from envs.edge.text import visible


@given(st.text())
def test_nothing_invisible_is_left_in_a_visible_text(text: str) -> None:
    shown = visible(text)
    assert not [each for each in shown if unicodedata.category(each) in {"Cc", "Cf"} and each != "\n"]
    assert visible(shown) == shown


def test_an_error_shows_a_reversing_character_as_its_code(capsys: pytest.CaptureFixture[str]) -> None:
    def main() -> int:
        raise InputError("encounter 'a\u202eb' is unknown")

    with pytest.raises(SystemExit):
        run_cli(main)
    assert capsys.readouterr().err == "error: encounter 'a\\u202eb' is unknown\n"
