"""The independent checker accepts what keeps clear of areas and refuses what does not."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents import check
from agents.kernel.areas import ActiveArea, required_distances
from agents.planner.planner import plan
from agents.planner.publish.certificate import Evidence
from agents.planner.request.request import Altitude
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.waypoints import PlanStates, plan_states
from envs.wind import Wind
from tests.agents.kernel.test_areas import kept_by, random_area, sample, wrong
from tests.agents.planner.test_airspace import CROSSING, OPTIONS, OWN, POLICY, ROUTE, least

CORNERS = ((20e3, -6e3), (21e3, -6e3), (21e3, 4e3), (20e3, 2e3))


def is_accepted(data: Any) -> bool:
    """Return whether the checker accepts a certificate."""
    try:
        check.accept(data)
    except check.RefusedError:
        return False
    return True


@pytest.mark.parametrize(
    "area",
    [
        pytest.param(Area(Circle(14e3, 300.0, 2e3), clearance=150.0), marks=pytest.mark.slow),
        Area(Polygon(CORNERS), velocity=(-3.0, 1.0), growth=0.5),
        pytest.param(Area(Circle(20e3, 0.0, 28e3), Keep.IN, growth=-5.0), marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize(
    "wind", [pytest.param(None, marks=pytest.mark.slow), Wind(3.0, -8.0)], ids=["calm", "wind"]
)
def test_moved_areas_are_refused_exactly_where_samples_lose_the_clearance(
    area: Area, wind: Wind | None
) -> None:
    answer = plan(OWN, [CROSSING], ROUTE, POLICY, OPTIONS, wind=wind, areas=[area])
    assert answer.safe and answer.certificate is not None
    data = json.loads(answer.certificate)
    assert is_accepted(data)
    room = least(answer, area, wind=wind) - area.clearance
    rng, verdicts = np.random.default_rng(3), set[bool]()
    for more in (0.5 * room, room - 10.0, room + 40.0):
        changed = json.loads(answer.certificate)
        changed["areas"][0]["clearance"] = max(area.clearance + more, 0.0)
        excess = least(answer, replace(area, clearance=0.0), wind=wind)
        excess -= changed["areas"][0]["clearance"]
        if abs(excess) > 7.0:  # samples may miss the nearest place by so much
            accepted = is_accepted(changed)
            assert accepted == (excess > 0.0), more
            verdicts.add(accepted)
    for _ in range(4):
        dx, dy = rng.normal(0.0, 1_500.0, 2)
        shape: Any = (
            Circle(area.shape.x + dx, area.shape.y + dy, area.shape.radius)
            if isinstance(area.shape, Circle)
            else Polygon(tuple((x + dx, y + dy) for x, y in area.shape.outer))
        )
        moved = replace(area, shape=shape)
        changed = json.loads(answer.certificate)
        if isinstance(shape, Circle):
            changed["areas"][0]["circle"] = [shape.x, shape.y, shape.radius]
        else:
            changed["areas"][0]["rings"] = [[list(place) for place in shape.outer]]
        excess = least(answer, moved, wind=wind) - area.clearance
        if abs(excess) > 7.0:
            accepted = is_accepted(changed)
            assert accepted == (excess > 0.0)
            verdicts.add(accepted)
    assert verdicts == {True, False}


def beside(rng: np.random.Generator) -> Area:
    """Return an area on the way to the east or beside it, which grows or shrinks."""
    area, east = random_area(rng), float(rng.uniform(0.0, 30e3))
    if isinstance(area.shape, Circle):
        shape: Any = replace(area.shape, x=area.shape.x + east)
    else:
        outer, *holes = (tuple((x + east, y) for x, y in ring) for ring in area.shape.rings)
        shape = Polygon(outer, tuple(holes))
    begin = 0.0 if rng.random() < 0.7 else float(rng.uniform(0.0, 200.0))
    return replace(area, shape=shape, growth=float(rng.uniform(-15.0, 15.0)), valid_from=begin)


@pytest.mark.parametrize(
    "count", [14, pytest.param(200, marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_what_the_validator_keeps_is_accepted_and_what_is_accepted_is_kept(count: int) -> None:
    answer = plan(OWN, [CROSSING], ROUTE, POLICY, OPTIONS)
    states = PlanStates(*(np.asarray(field)[None] for field in plan_states(OWN, answer.waypoints)))
    margin = OPTIONS.requirement.margin
    request = OWN, [CROSSING], answer.waypoints, answer.excluded, None, OPTIONS, None
    rng, kinds = np.random.default_rng(count), set[tuple[bool, bool]]()
    for _ in range(count):
        area = beside(rng)
        active_area = ActiveArea(0, area, area.valid_from, float(states.time[0, -1]))
        lost = bool(wrong(kept_by(states, [active_area], margin))[0])
        accepted = is_accepted(json.loads(Evidence(*request, [area]).certificate()))
        assert accepted or lost
        need = required_distances(active_area, states.x[:, 0], states.y[:, 0], margin)
        short = sample(states, active_area)[1].min() - need[0] < -0.002
        assert not (accepted and short)
        kinds.add((accepted, least(answer, replace(area, growth=0.0)) < 0.0))
    assert kinds >= {(True, True), (False, True)}  # the first where an area has been


def test_heights_and_times_stand_in_the_certificate() -> None:
    low = Area(Circle(6e3, 0.0, 2e3), ceiling=Level(300.0, "msl"))
    late = Area(Circle(6e3, 0.0, 2e3), valid_from=250.0)
    high = Altitude(900.0, "msl", 0.0)
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, own_altitude=high, areas=[low, late])
    assert answer.safe and answer.certificate is not None
    data = json.loads(answer.certificate)
    assert is_accepted(data)
    for change in ({"levels": [200.0, 0.0, 200.0, 0.0]}, {"levels": None}):
        assert not is_accepted(data | change)
    data["areas"][1]["valid"] = [10.0, None]
    assert not is_accepted(data)


def test_a_climb_that_is_not_exact_widens_the_times() -> None:
    above = Area(Circle(6e3, 0.0, 2e3), floor=Level(1_000.0, "msl"))
    for error, clear in ((0.0, True), (8.0, False)):
        height = Altitude(500.0, "msl", 0.0, climb_error=error)
        answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, own_altitude=height, areas=[above])
        assert answer.safe
        assert (least(answer, above) < 0.0) == clear


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("keep", "off"),
        ("rings", [[[0.0, 0.0], [1.0, 1.0]]]),
        ("circle", [0.0, 0.0, 0.0]),
        ("clearance", -1.0),
        ("growth", math.nan),
        ("valid", [0.0]),
        ("velocity", [0.0]),
    ],
)
def test_what_is_no_area_is_refused(name: str, value: Any) -> None:
    area = Area(Polygon(CORNERS))
    answer = plan(OWN, [], ROUTE, POLICY, OPTIONS, areas=[area])
    assert answer.certificate is not None
    data = json.loads(answer.certificate)
    data["areas"][0][name] = value
    assert not is_accepted(data)
