"""Areas are intruders to the policy: a disc is one that stands still, a polygon the discs about
it.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.kernel.areas import ActiveArea
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle, Keep, Polygon
from envs.kinematics import VehicleState
from eval.flights.static_obstacles import Standing, as_intruders, standing

UNIT = PAPER.separation


def what_is(*areas: Area) -> Standing:
    return standing([ActiveArea(n, area, 0.0, 100.0) for n, area in enumerate(areas)], UNIT, 0.0)


@st.composite
def polygons(draw: st.DrawFn) -> Polygon:
    """Return stars of any length and width, some of them very long."""
    count = draw(st.integers(3, 12))
    far = draw(st.lists(st.floats(0.3, 1.0), min_size=count, max_size=count))
    length, width = draw(st.floats(200.0, 20_000.0)), draw(st.floats(200.0, 3_000.0))
    angle = 2.0 * np.pi * np.arange(count) / count
    x, y = length * np.array(far) * np.cos(angle), width * np.array(far) * np.sin(angle)
    return Polygon(tuple(zip(x.tolist(), y.tolist(), strict=True)))


@settings(max_examples=50, deadline=None)
@given(polygons(), st.floats(0.0, 500.0))
def test_no_place_of_a_polygon_or_its_clearance_is_outside_of_its_discs(
    shape: Polygon, clearance: float
) -> None:
    discs = what_is(Area(shape, clearance=clearance))
    ring = np.array(shape.outer)
    distance_scale = np.linspace(0.0, 1.0, 50)[:, None, None]
    places = ((1.0 - distance_scale) * ring + distance_scale * np.roll(ring, -1, axis=0)).reshape(
        -1, 2
    )
    away = np.hypot(places[:, :1] - discs.x, places[:, 1:] - discs.y) - discs.separation
    assert np.all(away.min(axis=1) <= -clearance + 1e-3)


@settings(max_examples=50, deadline=None)
@given(polygons())
def test_discs_are_no_larger_than_needed_and_cut_where_they_would_be_large(shape: Polygon) -> None:
    discs = what_is(Area(shape))
    ring = np.array(shape.outer)
    across = max(math.dist(a, b) for a in ring for b in ring)
    assert 1 <= discs.x.size <= 16
    if discs.x.size == 1:  # Jung's bound of the smallest disc
        assert 0.5 * across - 1e-6 <= discs.separation[0] <= across / math.sqrt(3.0) + 1e-6
    else:
        assert discs.separation.max() < across and across > 2.0 * UNIT


@settings(max_examples=30, deadline=None)
@given(polygons())
def test_a_mirrored_polygon_has_mirrored_discs(shape: Polygon) -> None:
    mirrored = Polygon(tuple((x, -y) for x, y in shape.outer))
    discs, mirrored_discs = what_is(Area(shape)), what_is(Area(mirrored))
    for x, y, separation in zip(discs.x, discs.y, discs.separation, strict=True):
        off = np.hypot(mirrored_discs.x - x, mirrored_discs.y + y) + np.abs(
            mirrored_discs.separation - separation
        )
        assert off.min() < 1e-3


def test_a_disc_is_an_intruder_with_its_radius_and_clearance_as_separation() -> None:
    policy = Policy.load()
    area = Area(Circle(6_000.0, 500.0, 1_400.0), velocity=(-3.0, 4.0), clearance=100.0)
    intruders = as_intruders(what_is(area), 20.0, UNIT)
    centre = VehicleState(5_940.0, 580.0, math.atan2(4.0, -3.0), 5.0)
    own = VehicleState(0.0, 0.0, 0.1, 70.0)
    commanded = policy.command_one(own, [centre], 15_000.0, 0.0, [UNIT / 1_500.0])
    states = [VehicleState(*(float(field[0]) for field in intruders.state))]
    assert (
        policy.command_one(own, states, 15_000.0, 0.0, intruders.distance_scale.tolist())
        == commanded
    )
    assert policy.command_one(own, [], 15_000.0, 0.0) != commanded


@pytest.mark.parametrize("time", [0.0, 30.0, 99.0])
def test_what_an_area_grows_by_is_kept(time: float) -> None:
    area = Area(Circle(0.0, 0.0, 1_000.0), velocity=(5.0, 0.0), growth=3.0, clearance=50.0)
    intruders = as_intruders(what_is(area), time, UNIT)
    edge = float(intruders.state.x[0]) + UNIT / float(intruders.distance_scale[0])
    assert signed_distance(area, edge, 0.0, time) == pytest.approx(50.0)


def test_an_area_is_seen_while_it_counts_and_is_there() -> None:
    melts = Area(Circle(0.0, 0.0, 500.0), growth=-10.0)
    discs = what_is(Area(Circle(0.0, 0.0, 500.0)), melts)
    assert as_intruders(discs, 10.0, UNIT).mask.tolist() == [True, True]
    assert as_intruders(discs, 60.0, UNIT).mask.tolist() == [True, False]
    assert as_intruders(discs, 101.0, UNIT).mask.tolist() == [False, False]
    every = as_intruders(discs, np.array([[10.0], [60.0]]), UNIT)
    assert every.mask.tolist() == [[True, True], [True, False]]


def test_areas_to_be_kept_in_are_not_seen_and_small_ones_not_smaller_than_in_training() -> None:
    assert what_is(Area(Circle(0.0, 0.0, 9_000.0), keep=Keep.IN)).x.size == 0
    intruders = as_intruders(what_is(Area(Circle(0.0, 0.0, 1.0))), 0.0, UNIT)
    assert intruders.distance_scale.tolist() == [1.0 / 0.3]
