"""A name such as ``module:name`` gives the user's object, or one sentence that says why not."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from commands.command import InputError
from commands.extension import is_extension, load_extension


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a working directory of its own; what is imported from it is forgotten again."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_an_object_is_found_in_the_working_directory(folder: Path):
    (folder / "own_things.py").write_text("wave = 17\n")
    assert load_extension("own_things:wave", "a number") == 17


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("own_things", "expected module:name, a number of your own"),
        ("own_things:", "expected module:name"),
        ("own things:wave", "expected module:name"),
        ("absent_module:wave", "no module 'absent_module'"),
        ("own_things:absent", "own_things has no 'absent'; expected a number there"),
        (
            "broken_things:wave",
            r"importing broken_things fails with ZeroDivisionError: .* \(broken_things.py, line 1\)$",
        ),
        ("needy_things:wave", "no module 'absent_library'"),
    ],
)
def test_what_cannot_be_found_is_said_in_one_sentence(folder: Path, name: str, said: str):
    (folder / "own_things.py").write_text("wave = 17\n")
    (folder / "broken_things.py").write_text("1 / 0\n")
    (folder / "needy_things.py").write_text("import absent_library\n")
    with pytest.raises(InputError, match=said) as raised:
        load_extension(name, "a number")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "name", ["circle", "C:\\file.csv", "file:own encounters.csv", "lincoln:/a"]
)
def test_other_names_are_no_extensions(name: str):
    assert not is_extension(name)
