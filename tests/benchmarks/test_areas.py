"""What the benchmark of areas asks."""

from benchmarks.areas import questions
from envs.aircraft import PAPER


def test_the_benchmark_asks_for_one_to_three_areas_and_one_to_four_intruders() -> None:
    asked = questions(0, 24, PAPER)
    assert {len(one.areas) for one in asked} == {1, 2, 3}
    assert {len(one.request.intruders) for one in asked} == {1, 2, 3, 4}
