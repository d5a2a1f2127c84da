"""Steps are counted as they are flown, ours and those of the simulators that are installed."""

import json
from importlib.util import find_spec

import pytest

from benchmarks import simulators
from commands.command import InputError

SMALL = ("--environments", "2", "--steps", "3", "--repeats", "1")


@pytest.mark.slow
@pytest.mark.parametrize("name", simulators.SIMULATORS)
def test_a_simulator_is_measured_or_left_out(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    package = simulators.SIMULATORS[name].package
    simulators.main(["--only", name, *SMALL])
    printed = capsys.readouterr().out
    rates = json.loads(printed.splitlines()[-1])["rates"]
    if package and not find_spec(package):
        assert rates == [] and f"left out: {name}; to have them: pip install" in printed
        return
    (rate,) = rates
    assert rate["environments"] == 2 and rate["steps_per_s"] > 0.0
    _, bodies = simulators.SIMULATORS[name].prepare(2, 1)
    assert rate["bodies"] == bodies >= 1


def test_a_rate_is_that_of_all_environments_and_more_are_not_tried_where_it_takes_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = []

    def prepare(count: int, steps: int) -> tuple[simulators.Work, int]:
        tried.append(count)
        return lambda: None, 3

    slow = simulators.Simulator(None, "nothing", prepare)
    monkeypatch.setitem(simulators.SIMULATORS, "circle", slow)
    monkeypatch.setattr(simulators, "seconds", lambda work, repeats: [tried[-1] * 1.0] * repeats)
    (rate,) = simulators.measure(["circle"], [2, 8, 32], 10, 3)
    assert tried == [2, 8]  # 8 s are long
    assert rate == simulators.Rate("circle", "nothing", 2, 3, 10.0)


def test_an_unknown_name_is_one_sentence() -> None:
    with pytest.raises(InputError, match="--only has 'vmass'; expected some of circle, multi"):
        simulators.main(["--only", "vmass"])
