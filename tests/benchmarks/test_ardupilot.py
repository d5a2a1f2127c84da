"""The flights that are kept with the ArduPlane benchmark, and the traffic that it sends."""

import math
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="the extra mavlink is not installed")

from benchmarks.ardupilot import run
from benchmarks.ardupilot.chaser import Chaser
from benchmarks.ardupilot.encounters import encounter
from envs.edge.json_text import parse_json
from ros_bridge.mavlink.flight import Row


def test_stored_flights_are_those_of_their_encounters_and_stand_once() -> None:
    first, *lines = Path(run.__file__).with_name("flights.jsonl").read_text("utf-8").splitlines()
    asked, rows = parse_json(first), [parse_json(line) for line in lines]
    assert len({(row["number"], row["method"]) for row in rows}) == len(rows)
    assert {row["method"] for row in rows} <= set(run.METHODS)
    for row in rows:
        one = encounter(asked["seed"], row["number"])
        assert (row["aircraft"], row["fence"]) == (len(one.intruders), bool(one.fence))


def test_kept_flights_are_not_flown_again_and_new_ones_go_before() -> None:
    asked = {"seed": 0, "separation_m": 200.0}
    every = run.stored_flights(asked, [])
    left = run.stored_flights(asked, every[:3])
    assert left == every[3:]
    assert run.stored_flights(asked | {"seed": 1}, []) == []


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
