"""Random areas keep off start and goal, scale with the aircraft, and are drawn by position."""

import math

import numpy as np
import pytest

from envs.aircraft import PAPER, Aircraft
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle
from envs.kinematics import VehicleState
from envs.random_areas import MOST, random_areas

START, GOAL = VehicleState(-8_000.0, 1_000.0, 0.1, 75.0), (9_000.0, -2_000.0)


def draw_areas(number: int, count: int = MOST) -> tuple[Area, ...]:
    return random_areas(5, number, count, START, GOAL, PAPER)


def test_they_keep_off_start_and_goal_and_lie_about_the_way() -> None:
    kinds, moving, count = set[type](), 0, 0
    for number in range(60):
        areas = draw_areas(number)
        count += len(areas)
        for area in areas:
            kinds.add(type(area.shape))
            moving += area.velocity != (0.0, 0.0)
            for place in ((START.x, START.y), GOAL):
                away = float(signed_distance(area, *place))
                assert away >= area.clearance + 0.5 * PAPER.separation - 1e-6
            assert math.hypot(*area.velocity) <= 0.1 * PAPER.limits.speed_max
    assert len(kinds) == 2
    assert 0.8 * 60 * MOST < count <= 60 * MOST
    assert moving / count == pytest.approx(1.0 / 3.0, abs=0.08)


def test_more_areas_leave_those_before_as_they_are() -> None:
    for number in range(10):
        areas = draw_areas(number)
        assert draw_areas(number) == areas
        for count in range(MOST + 1):
            assert set(draw_areas(number, count)) <= set(areas)
    assert draw_areas(0) != draw_areas(1)
    assert draw_areas(3, 0) == ()
    with pytest.raises(ValueError, match="count is 9, expected 0 to 8"):
        draw_areas(0, 9)


def test_they_scale_with_the_aircraft() -> None:
    def scaled(aircraft: Aircraft) -> Aircraft:
        return aircraft._replace(separation=2.0 * aircraft.separation)

    twice = VehicleState(2.0 * START.x, 2.0 * START.y, START.heading, START.speed)
    goal = 2.0 * GOAL[0], 2.0 * GOAL[1]
    for number in range(10):
        large = random_areas(5, number, 4, twice, goal, scaled(PAPER))
        for area, large_area in zip(draw_areas(number, 4), large, strict=True):
            assert large_area.clearance == pytest.approx(2.0 * area.clearance)
            if isinstance(area.shape, Circle):
                assert isinstance(large_area.shape, Circle)
                assert large_area.shape.radius == pytest.approx(2.0 * area.shape.radius)
            else:
                assert not isinstance(large_area.shape, Circle)
                np.testing.assert_allclose(large_area.shape.outer, 2.0 * np.array(area.shape.outer))
