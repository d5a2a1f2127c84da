"""Things by name: what ships stays, the user's own come in by hand alone, and a refusal of a name
lists the known ones.
"""

import math
from pathlib import Path

import pytest

from commands.command import InputError
from commands.registry import Registry


class NoNumberError(InputError):
    pass


def positive(name: str, number: float) -> None:
    if number <= 0.0:
        raise NoNumberError(f"number {name!r} is {number:g}; expected one above 0")


def make() -> Registry[float]:
    shipped = {"three": 3.0, "seven": 7.0}
    return Registry("number", "a number (a float)", float, NoNumberError, shipped, positive)


def test_what_ships_comes_first_and_what_is_registered_again_is_replaced():
    numbers = make()
    assert numbers.register("one", 1.0) == 1.0
    numbers.register("half", 0.5)
    numbers.register("one", 1.5)
    assert list(numbers) == ["three", "seven", "one", "half"]
    assert numbers.find("one") == 1.5
    assert list(make()) == ["three", "seven"]


@pytest.mark.parametrize(
    ("name", "thing", "says"),
    [
        ("seven", 8.0, "number 'seven' ships; expected another name"),
        ("eight", "8", "number 'eight' is of type str; expected a number (a float)"),
        ("less", -1.0, "number 'less' is -1; expected one above 0"),
    ],
)
def test_what_cannot_be_registered_is_refused_and_changes_nothing(
    name: str, thing: float, says: str
):
    numbers = make()
    with pytest.raises(NoNumberError) as refused:
        numbers.register(name, thing)
    assert str(refused.value) == says
    assert list(numbers) == ["three", "seven"]


def test_an_unknown_name_is_refused_with_the_known_ones_and_the_nearest():
    for look_up in (make().find, make().load, make().resolve):
        with pytest.raises(NoNumberError) as refused:
            look_up("sevn")
        assert str(refused.value) == (
            "number 'sevn' is unknown; expected one of three, seven, or module:name of your own; "
            "did you mean seven?"
        )
    empty: Registry[float] = Registry("number", "a number", float, NoNumberError)
    with pytest.raises(NoNumberError, match=r"is unknown; expected module:name of your own$"):
        empty.find("one")


def test_code_is_loaded_by_hand_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    numbers = make()
    with pytest.raises(NoNumberError, match="number 'math:pi' is unknown"):
        numbers.find("math:pi")
    assert numbers.load("math:pi") == math.pi
    assert "math:pi" not in numbers
    assert numbers.resolve("math:pi") == numbers.find("math:pi") == math.pi
    for name, says in (
        ("math:sin", "number 'math:sin' is of type builtin_function_or_method; expected a number"),
        ("math:absent", "math has no 'absent'; expected a number"),
        ("no_such_module:one", "no module 'no_such_module'"),
    ):
        with pytest.raises(NoNumberError, match=says):
            numbers.resolve(name)
