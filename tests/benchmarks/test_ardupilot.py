"""The flights that are kept with the ArduPlane benchmark, and the traffic that it sends."""

import math
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from benchmarks.ardupilot import load, margin, reach, run
from benchmarks.ardupilot.chaser import Chaser
from benchmarks.ardupilot.encounters import encounter
from commands.command import ConfigError
from commands.json_text import parse_json
from ros_bridge.mavlink.flight import BEGIN, Encounter, Row, off_track, place_of
from ros_bridge.mavlink.sitl import Leg


@pytest.mark.parametrize(
    ("main", "given", "said"),
    [
        (run.main, ["--encounters", "-1"], "--encounters: '-1'; expected a whole number"),
        (run.main, ["--workers", "0"], "--workers: '0'; expected a whole number of at least 1"),
        (run.main, ["--speedup", "nan"], "--speedup: nan; expected 1 to 1000"),
        (run.main, ["--instance", "5001"], "--instance: '5001'; expected a whole number, 0 to"),
        (margin.main, ["--encounters", "0"], "--encounters: '0'; expected a whole number"),
        (reach.main, ["--modes", "-1"], "--modes: '-1'; expected a whole number of at least 0"),
        (load.main, ["--seconds", "0"], "--seconds: 0 s; expected 1 to 3600 s"),
    ],
)
def test_a_bad_option_is_refused_in_a_sentence(main: Any, given: list[str], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        main(given)


@pytest.mark.parametrize("name", ["flights.jsonl", "climbing.jsonl"])
def test_stored_flights_are_those_of_their_encounters_and_stand_once(name: str) -> None:
    first, *lines = Path(run.__file__).with_name(name).read_text("utf-8").splitlines()
    asked, rows = parse_json(first), [parse_json(line) for line in lines]
    assert rows
    assert len({(row["number"], row["method"]) for row in rows}) == len(rows)
    assert {row["method"] for row in rows} <= set(run.METHODS)
    for row in rows:
        one = encounter(asked["seed"], row["number"], climbing=asked.get("climbing", False))
        assert (row["aircraft"], row["fence"]) == (len(one.intruders), bool(one.fence))


def test_kept_flights_are_not_flown_again_and_new_ones_go_before() -> None:
    asked = {"seed": 0, "separation_m": 200.0}
    every = run.stored_flights(asked, [])
    left = run.stored_flights(asked, every[:3])
    assert left == every[3:]
    assert run.stored_flights(asked | {"seed": 1}, []) == []


def test_an_encounter_in_another_air_is_still_a_conflict_of_the_mission() -> None:
    for number in range(20):
        one = margin.in_air(encounter(0, number), margin.Air(5.0, 2.0))
        for intruder in one.intruders:
            if intruder.turn == 0.0:
                x, y, _ = place_of(intruder, intruder.cpa, one.cruise)
                away = math.hypot(BEGIN + one.cruise * intruder.cpa - x, y)
                assert away == pytest.approx(abs(intruder.miss))


def test_intruders_climb_or_descend_through_the_missions_height_where_they_are_to() -> None:
    for number in range(20):
        level, climbing = (encounter(0, number, climbing=climbs) for climbs in (False, True))
        assert climbing._replace(intruders=level.intruders) == level
        for one, same in zip(climbing.intruders, level.intruders, strict=True):
            assert one._replace(climb=0.0) == same
            assert 1.0 <= abs(one.climb) <= 5.0
            assert one.above(one.cpa) == same.above(0.0)
            assert one.above(one.cpa + 10.0) - one.above(one.cpa) == pytest.approx(10.0 * one.climb)


def test_what_is_on_the_missions_track_is_seen_from_above() -> None:
    one = Encounter(0, (), 0.0, 0.0)
    row = Row(0.0, 2_000.0, 20.0, 700.0, 22.0, 22.0, 15)
    assert off_track(one, row) == pytest.approx(20.0)
    assert off_track(one, row._replace(x=12_000.0)) == pytest.approx(math.hypot(3_000.0, 20.0))
    bent = one._replace(legs=(Leg(0.0, 0.0), Leg(1_000.0, 0.0), Leg(1_000.0, 1_000.0)))
    assert off_track(bent, row._replace(x=1_030.0, y=500.0)) == pytest.approx(30.0)


def test_the_margins_line_says_what_the_largest_of_its_flights_bounds() -> None:
    nan = math.nan
    distances = [(1.0, 4.0, nan), (3.0, 2.0, 5.0), (2.0, 3.0, 1.0)]
    row = margin.row_of("still", [margin.Distances(*one) for one in distances])
    assert (row["across_m_median"], row["across_m_max"]) == (2.0, 3.0)
    assert (row["along_m_median"], row["along_m_max"]) == (3.0, 4.0)
    # In the first flight all plans were in the plane.
    assert (row["above_m_median"], row["above_m_max"]) == (3.0, 5.0)
    # Three flights are all below a share s of all flights with probability s^3.
    assert row["share_below_max"] ** 3 == pytest.approx(0.05, abs=1e-3)


def test_aircraft_that_leave_are_reported_for_good() -> None:
    class Station:
        def __init__(self) -> None:
            self.sent: list[tuple[Any, ...]] = []

        def traffic(self, *values: Any) -> None:
            self.sent.append(values)

    chaser, station = Chaser(0), Station()
    chaser.add_crossing(Row(0.0, 0.0, 0.0, 620.0, 22.0, 22.0, 10), 0.0, 36.0)
    chaser.leave()
    for second in range(600):
        own = Row(float(second), 22.0 * second, 0.0, 620.0, 22.0, 22.0, 10)
        chaser.report(station, own)  # pyright: ignore[reportArgumentType]
    assert len(station.sent) == 600
    _, east, north, *_ = station.sent[-1]
    assert math.hypot(east - 22.0 * 599.0, north) > 6_000.0
