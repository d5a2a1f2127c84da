"""The comparison with DAIDALUS reads its answers, matches edges, and says where it is missing."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from agents.assurance.alerts import Alerting
from agents.assurance.bands import heading_bands
from agents.baselines.baselines import Observation
from agents.config.world import AircraftConfig
from agents.kernel.traffic import Requirement, Traffic
from benchmarks.daidalus.edges import Edge, matches, our_edges, their_edges
from benchmarks.daidalus.in_the_loop import VARIABLE as LOOP
from benchmarks.daidalus.in_the_loop import daidalus_f3442
from benchmarks.daidalus.program import (
    VARIABLE,
    Interval,
    configuration,
    read_answers,
    scenario_text,
)
from benchmarks.daidalus.run import HEADINGS, SETTING, VARIANTS, compare, fly_both, main
from benchmarks.daidalus.sides import flight_of
from benchmarks.daidalus.vertical import CHANGES, FOOT, compare_vertical, fine, our_bands
from commands.command import InputError
from envs.aircraft import PAPER
from envs.formats.track_files import read_daidalus
from envs.kinematics import C208_PUBLISHED, VehicleState
from envs.traffic.tracks import Track
from tests.support import vehicle

UAS = AircraftConfig.of_file(Path("uas")).aircraft()

ANSWER = """# File: scenario.xyz
Time: 3.0 [s]
Time to Corrective Volume with Other one: [12.500000 [s], 99.0 [s]]
Alert Level 3 with Other one
Alert Level 0 with Far
Horizontal Direction Bands:
  [0.0 [deg], 20.5 [deg]] NEAR
  [20.5 [deg], 300.0 [deg]] NONE
  [300.0 [deg], 360.0 [deg]] FAR
Horizontal Speed Bands:
  [5.0 [m/s], 40.0 [m/s]] NONE
  [40.0 [m/s], 360.0 [m/s]] MID
Vertical Speed Bands:
  [-10.0 [m/s], -2.5 [m/s]] NONE
  [-2.5 [m/s], 10.0 [m/s]] MID
Altitude Bands:
  [0.0 [m], 20000.0 [m]] MID
Time: 4.0 [s]
"""


def track(name: str, x: float, vx: float, vy: float, times: list[float]) -> Track:
    time = np.array(times)
    flat = np.zeros(time.size)
    return Track(name, time, x + vx * time, vy * time, flat, flat + vx, flat + vy, flat, {})


def test_answers_are_read() -> None:
    first, second = read_answers(ANSWER)
    assert first.time == 3.0 and second.time == 4.0 and second.headings == []
    assert first.loss == {"Other one": 12.5}
    assert first.level == {"Other one": 3, "Far": 0}
    assert first.headings[1] == Interval(20.5, 300.0, "NONE") and len(first.headings) == 3
    assert [part.region for part in first.speeds] == ["NONE", "MID"]
    assert [part.low for part in first.climbs] == [-10.0, -2.5]
    assert [part.high for part in first.altitudes] == [20_000.0]
    assert their_edges(first.headings, circle=True) == [Edge(20.5, True), Edge(300.0, False)]
    assert their_edges(first.speeds, circle=False) == [Edge(40.0, False)]


def test_an_edge_at_north_is_one() -> None:
    north = [Interval(0.0, 90.0, "NEAR"), Interval(90.0, 360.0, "NONE")]
    assert their_edges(north, circle=True) == [Edge(0.0, False), Edge(90.0, True)]


def test_our_edges_are_clockwise_from_north_and_agree_with_themselves() -> None:
    others = VehicleState(*(np.array([[value]]) for value in (0.0, 6_000.0, -0.5 * np.pi, 80.0)))
    # Northbound; the other one comes from ahead.
    bands = heading_bands(
        vehicle(0.0, 0.0, 0.5 * np.pi, 80.0),
        Traffic.straight(others),
        Requirement(1_000.0),
        C208_PUBLISHED,
        120.0,
    )
    found = our_edges(bands, 0, circle=True)
    opens = [edge.place for edge in found if edge.opens]
    closes = [edge.place for edge in found if not edge.opens]
    assert len(opens) == len(closes) == 1
    # Closed from west over north to east.
    assert 0.0 < opens[0] < 60.0 and 300.0 < closes[0] < 360.0
    assert opens[0] == pytest.approx(360.0 - closes[0], abs=1e-6)
    same = matches(found, found, bands, 0, HEADINGS)
    assert [match.name for match in same] == ["", ""] and same[0].away == 0.0
    moved = [replace_place(edge, edge.place + 4.0) for edge in found]
    assert all(match.name for match in matches(found, moved, bands, 0, HEADINGS))


def replace_place(edge: Edge, place: float) -> Edge:
    return edge._replace(place=place % 360.0)


def test_both_sides_are_given_the_same_numbers(tmp_path: Path) -> None:
    own = track("mine", 0.0, 60.0, 10.0, [0.0, 1.0, 2.0])
    other = track("Other", 9_000.0, -80.0, 0.0, [0.0, 2.0])
    (tmp_path / "scenario.xyz").write_text(scenario_text(own, [other]))
    read = read_daidalus(tmp_path / "scenario.xyz", max_gap=10.0)
    ownship, intruder = read.tracks
    np.testing.assert_allclose(ownship.x, own.x, atol=1e-6)
    np.testing.assert_allclose(ownship.vy, own.vy, atol=1e-6)
    np.testing.assert_allclose(intruder.vx, other.vx, atol=1e-6)
    flight = flight_of(own, [other])
    assert flight.traffic.mask.tolist() == [[True], [False], [True]]


def test_every_key_that_a_variant_changes_is_one_of_the_configuration_or_of_a_detector() -> None:
    alerting = Alerting.for_aircraft(PAPER)
    plain = configuration(SETTING, alerting, hysteresis=False, changes={})
    keys = {line.split(" = ")[0] for line in plain.splitlines()}
    flat = configuration(fine(SETTING), alerting, hysteresis=False, changes={})
    assert "det_1_H = 137.16" in flat and "det_1_H = 1000000.0" in plain
    for changes in VARIANTS.values():
        unknown = {key for key in changes if key not in keys and "_WCV_" not in key}
        assert not unknown
    assert "alerting_m = 0" in plain
    assert "alerting_m = 2" in configuration(SETTING, alerting, hysteresis=True, changes={})
    late = replace(alerting, m=3)
    assert "alerting_m = 3" in configuration(SETTING, late, hysteresis=True, changes={})


@pytest.mark.parametrize("given", [[], ["--program", "nowhere"]])
def test_a_missing_program_is_one_sentence(
    given: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(sys, "argv", ["daidalus", "--scenarios", str(tmp_path), *given])
    with pytest.raises(InputError, match=r"^.*DaidalusBatch.*nasa/daidalus.*$"):
        main()


@pytest.mark.skipif(
    VARIABLE not in os.environ, reason=f"DAIDALUS is not here; to have it: {VARIABLE}=PROGRAM"
)
def test_bands_of_a_crossing_agree(tmp_path: Path) -> None:
    own = track("mine", 0.0, 60.0, 0.0, [float(second) for second in range(5)])
    other = Track("Other", own.time, 4_000.0 + 0.0 * own.x, 4_000.0 - 60.0 * own.time,
                  0.0 * own.x, 0.0 * own.x, -60.0 + 0.0 * own.x, 0.0 * own.x, {})  # fmt: skip
    (tmp_path / "crossing.xyz").write_text(scenario_text(own, [other]))
    found = compare("crossing", fly_both(tmp_path / "crossing.xyz", Path(os.environ[VARIABLE]), {}))
    assert found.headings and all(not match.name for match in found.headings)
    assert found.loss_error.max() < 1e-3 and found.levels_same.all()


def head_on() -> tuple[Track, list[Track]]:
    """Return an ownship and an intruder that comes along its course at its altitude."""
    own = track("mine", 0.0, 60.0, 0.0, [0.0, 1.0, 2.0])._replace(altitude=np.full(3, 2_000.0))
    other = track("Other", 8_000.0, -60.0, 0.0, [0.0, 1.0, 2.0])
    return own, [other._replace(altitude=own.altitude)]


def test_vertical_bands_of_changed_scenarios_have_edges_at_the_height_of_the_cylinder() -> None:
    edges = []
    for change in CHANGES.values():
        climbs, altitudes = our_bands(flight_of(*change(head_on())), fine(SETTING))
        assert climbs.closed.any(axis=1).all() and not climbs.closed.all(axis=1).any()
        edges.append(our_edges(altitudes, 0, circle=False))
    level, higher, _, _ = edges
    assert [edge.opens for edge in level] == [False, True]
    places = [edge.place for edge in level]
    assert places == pytest.approx([2_000.0 - 450.0 * FOOT, 2_000.0 + 450.0 * FOOT], abs=0.2)
    # It cannot climb 1050 ft in time.
    assert [edge.place for edge in higher] == pytest.approx([2_000.0 + 150.0 * FOOT], abs=0.2)


@pytest.mark.skipif(
    VARIABLE not in os.environ, reason=f"DAIDALUS is not here; to have it: {VARIABLE}=PROGRAM"
)
@pytest.mark.parametrize("name", CHANGES)
def test_vertical_bands_of_a_crossing_agree(name: str) -> None:
    flights = CHANGES[name](head_on())
    for edges in compare_vertical(Path(os.environ[VARIABLE]), flights, fine(SETTING)):
        assert edges and all(not match.name for match in edges)


def observe_ahead(apart: float, above: float) -> Observation:
    """Return an encounter whose intruder is as far ahead, and above, m; the goal is ahead too."""
    own = VehicleState(*(np.array([value]) for value in (0.0, 0.0, 0.0, 30.0)))
    other = VehicleState(*(np.array([[value]]) for value in (apart, 0.0, np.pi, 50.0)))
    goal, level = np.array([8_000.0]), np.array([[above]])
    return Observation(
        own,
        other,
        np.ones((1, 1), bool),
        goal,
        0.0 * goal,
        UAS.t_max,
        above=level,
        climb=0.0 * level,
        number=np.array([7]),
    )


def test_a_missing_program_of_the_loop_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    for value in ("", "nowhere"):
        monkeypatch.setenv(LOOP, value)
        with pytest.raises(InputError, match=r"DAIDALUS_LOOP is .*; expected the path of DAIDALUS"):
            daidalus_f3442(UAS)


@pytest.mark.skipif(
    LOOP not in os.environ, reason=f"DAIDALUS is not here; to have it: {LOOP}=PROGRAM"
)
def test_it_turns_for_who_comes_near_alone() -> None:
    memory = np.zeros(1, np.int8)
    for apart, above, turns in ((2_500.0, 0.0, True), (2_500.0, 300.0, False), (9e3, 0.0, False)):
        action, _ = daidalus_f3442(UAS).decide(observe_ahead(apart, above), memory)
        assert (abs(action[0, 1]) > 0.1) == turns, (apart, above)
        assert action[0, 0] == 0.0
