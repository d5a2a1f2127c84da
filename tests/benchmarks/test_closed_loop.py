"""Closed-loop properties of ACAS Xu: who flies them is of the policy's family, and what is called
proven is."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.policy.inference import Policy
from benchmarks import closed_loop
from benchmarks.closed_loop import STARTS, Start, aircraft_of, encounters_of, places, prove

POLICY = Policy.load()


@pytest.mark.parametrize("start", STARTS, ids=lambda start: start.name)
def test_each_start_is_flown_by_an_aircraft_of_the_family_within_its_limits(start: Start) -> None:
    aircraft = aircraft_of(start)
    POLICY.for_aircraft(aircraft)  # refuses others
    speed = start.own_speed * closed_loop.FOOT
    assert aircraft.limits.speed_min < speed < aircraft.limits.speed_max
    assert aircraft.separation >= 4000.0 * closed_loop.FOOT
    begun = encounters_of(start, np.zeros((1, 2)), aircraft)
    apart = math.hypot(*np.subtract(start.own[:2], start.intruder[:2]))
    assert begun.own.speed[0] == pytest.approx(speed)
    assert apart * closed_loop.FOOT > aircraft.separation


def test_on_straight_ways_the_intruders_of_the_properties_come_near() -> None:
    """They were stated as encounters; a course or a speed of another one would miss by miles."""
    nearest = []
    for start in STARTS[:10]:
        own, other = np.array(start.own), np.array(start.intruder)
        relative = other[:2] - own[:2]
        velocity = start.intruder_speed * np.array([np.cos(other[2]), np.sin(other[2])])
        velocity -= start.own_speed * np.array([np.cos(own[2]), np.sin(own[2])])
        time = max(-float(relative @ velocity) / float(velocity @ velocity), 0.0)
        nearest.append(float(np.hypot(*(relative + time * velocity))))
    assert max(nearest) < 5000.0


def test_the_places_are_in_the_box_with_its_corners() -> None:
    found = places(STARTS[0], 50, np.random.default_rng(0))
    half = 100.0 * closed_loop.FOOT
    assert found.shape == (55, 2)
    assert np.abs(found).max() == pytest.approx(half)
    np.testing.assert_allclose(np.abs(found[1:5]), half)
    assert places(STARTS[-1], 50, np.random.default_rng(0)).shape == (1, 2)


def test_a_start_that_cannot_be_resolved_is_not_called_proven() -> None:
    near = Start("near", (0.0, 0.0, 0.0), (5000.0, 0.0, math.pi), 500.0, 900.0, 30.0)
    aircraft = aircraft_of(near)
    proof = prove(near, POLICY.for_aircraft(aircraft), aircraft)
    assert proof.status == "UNRESOLVED"
    assert proof.certificate is None


@pytest.mark.slow
def test_a_property_is_proven_and_held_through_the_command(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert closed_loop.main(["--samples", "2", "--only", "property 9"]) == 0
    row: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"][0]
    assert row["plan"] == {"status": "SAFE", "certificate": True}
    for loop in ("policy", "assured"):
        assert (row[loop]["lost"], row[loop]["collisions"]) == (0, 0)


def test_a_folder_without_networks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(closed_loop.InputError, match=r"0 files \*run2a_1_1\*"):
        closed_loop.first_network(tmp_path)
