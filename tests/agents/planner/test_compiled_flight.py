"""Compiled, the fallback's manoeuvres of one request fly as they do by numpy."""

import math
from typing import cast

import numpy as np
import pytest

from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Traffic, Window
from agents.manoeuvres.escape_manoeuvre import Manoeuvre
from agents.manoeuvres.escape_search import COARSE, STAGES, concatenate, scale
from agents.manoeuvres.simulator import Effort
from agents.planner import Intruder, plan
from agents.planner.request.options import Narrowed, Options
from agents.planner.request.request import Request
from agents.planner.search import fallback_flight
from agents.planner.search.compiled_flight import FLY_ON
from agents.planner.search.fallback_flight import ManoeuvreFlights, fly_out
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.areas import Area, Circle, Keep, Polygon
from envs.frames import Air, Ground
from envs.kinematics import VehicleState
from envs.random_areas import random_areas
from envs.trees import Shared, take
from envs.waypoints import RoutePoint
from envs.wind import Wind

OPTIONS = cast("Options[Narrowed]", Options.for_aircraft(PAPER))
FAMILY = scale(concatenate(*STAGES[:2]), PAPER)
DELAYED = take(scale(STAGES[3], PAPER), slice(None, None, 7))
STAYING = scale(COARSE._replace(resume=COARSE.resume + 25.0), PAPER)
STAGE = FAMILY, Effort(-40.0, OPTIONS.smoothing, 12, 150.0)
LAST_STAGE = DELAYED, Effort(-40.0, OPTIONS.smoothing, 12)
REFINEMENT = STAYING, Effort(-np.inf, OPTIONS.smoothing, 10_000)
GOAL = np.zeros(1, dtype=int)

# Kept in, with a hole; shrinking; there for a while.
FENCE = Polygon(
    ((-20e3, -20e3), (60e3, -20e3), (60e3, 20e3), (-20e3, 20e3)),
    (((9e3, 900.0), (10e3, 900.0), (10e3, 2e3)),),
)
AREAS = (
    ActiveArea(0, Area(FENCE, Keep.IN, velocity=(3.0, -2.0), growth=-2.0), 0.0, 600.0),
    ActiveArea(1, Area(Circle(8e3, 300.0, 500.0), growth=3.0, clearance=100.0), 40.0, 130.0),
    ActiveArea(2, Area(Circle(0.0, 0.0, 19e3), Keep.IN, clearance=100.0), 0.0, 600.0),
)

pytestmark = pytest.mark.usefixtures("compiled_code")


def random_request(seed: int, intruders: int, kind: str) -> Request:
    """Return a request of one aircraft among others, known exactly or not, in a wind and among
    areas or not.
    """
    rng, shape = np.random.default_rng(seed), (1, intruders)
    wide = 6e3 if intruders < 10 else 15e3
    place = rng.uniform([[[-wide]], [[-wide]]], [[[wide + 8e3]], [[wide]]], (2, *shape))
    course, pace = rng.uniform(-math.pi, math.pi, shape), rng.uniform(40.0, 100.0, shape)
    traffic = Traffic.straight(VehicleState(place[0], place[1], course, pace))
    drift = areas = None
    if kind != "exact":
        uncertain = rng.random(shape) < 0.8
        begin = np.where(rng.random(shape) < 0.3, rng.uniform(-20.0, 150.0, shape), -np.inf)
        length = np.where(rng.random(shape) < 0.3, rng.uniform(0.0, 100.0, shape), np.inf)
        traffic = traffic._replace(
            mask=rng.random(shape) < 0.9,
            turn_rate=rng.uniform(-0.05, 0.05, shape) * (rng.random(shape) < 0.5),
            turn_time=rng.uniform(0.0, 100.0, shape),
            position_std=np.where(uncertain, 30.0, 0.0),
            velocity_std=np.where(uncertain, 1.0, 0.0),
            age=rng.uniform(0.0, 3.0, shape),
            separation=np.where(rng.random(shape) < 0.3, 600.0, np.nan),
            window=Window(begin, np.maximum(begin, 0.0) + length),
        )
        drift = rng.uniform(-9.0, 9.0, 1), rng.uniform(-9.0, 9.0, 1)
    heading, speed = rng.uniform(-0.5, 0.5, 1), rng.uniform(55.0, 95.0, 1)
    own: VehicleState[Air] = VehicleState(np.zeros(1), np.zeros(1), heading, speed)
    x = 12e3 + 5e3 * np.arange(9.0) + rng.uniform(-2e3, 2e3, 9)
    y = rng.uniform(-1e3, 1e3, 9)
    if kind == "areas":
        start = VehicleState(*(float(field[0]) for field in own))
        drawn = random_areas(3, seed, 3, start, (x[0], y[0]), PAPER)
        active = [ActiveArea(3 + n, area, 0.0, 600.0) for n, area in enumerate(drawn)]
        areas = Shared((*AREAS[: seed % 4], *active))
    return Request(own, traffic, x[None], y[None], np.array([9]), drift, areas)


def fly(request: Request, family: Manoeuvre, effort: Effort) -> ManoeuvreFlights:
    return fly_out(request, GOAL, np.zeros(family.turn.size, int), family, OPTIONS, effort)


def both_ways(
    request: Request, family: Manoeuvre, effort: Effort
) -> tuple[ManoeuvreFlights, ManoeuvreFlights]:
    """Return flights compiled and by numpy."""
    assert FLY_ON.ready
    with pytest.MonkeyPatch.context() as patch:
        # Compiled, the way back is set against all of a crowd.
        patch.setattr(fallback_flight, "_NEAREST", 1_000)
        fast = fly(request, family, effort)
        patch.setattr(FLY_ON, "_compiled", None)
        return fast, fly(request, family, effort)


@pytest.mark.parametrize("kind", ["exact", "uncertain", "areas"])
@pytest.mark.parametrize("intruders", [0, 4, 20, 100])
@pytest.mark.parametrize(
    ("family", "effort"), [STAGE, LAST_STAGE, REFINEMENT], ids=["stage", "last", "refinement"]
)
def test_manoeuvres_fly_and_end_as_by_numpy(
    kind: str, intruders: int, family: Manoeuvre, effort: Effort
) -> None:
    returned = 0
    for seed in range(6 if intruders < 100 else 3):
        fast, slow = both_ways(random_request(seed, intruders, kind), family, effort)
        returned += fast.rollout.direct.sum()
        np.testing.assert_array_equal(fast.rollout.direct, slow.rollout.direct)
        np.testing.assert_array_equal(fast.rollout.time, slow.rollout.time)
        np.testing.assert_array_equal(fast.rollout.turn_sign, slow.rollout.turn_sign)
        np.testing.assert_array_equal(fast.rollout.reversals, slow.rollout.reversals)
        np.testing.assert_allclose(fast.clearance, slow.clearance, atol=1e-6, rtol=0.0)
        np.testing.assert_allclose(fast.rollout.path, slow.rollout.path, atol=1e-6, rtol=0.0)
        for state in ("end", "plan_states"):
            pairs = zip(getattr(fast.rollout, state), getattr(slow.rollout, state), strict=True)
            for compiled_field, field in pairs:
                np.testing.assert_allclose(compiled_field, field, atol=1e-6, rtol=0.0)
    assert returned or intruders == 100


def test_of_a_crowd_all_intruders_are_looked_at() -> None:
    # By numpy the way back may count as clear although someone far away blocks it.
    for seed in range(4):
        request, (family, effort) = random_request(seed, 140, "uncertain"), REFINEMENT
        fast = fly(request, family, effort).rollout.time
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(FLY_ON, "_compiled", None)
            slow = fly(request, family, effort).rollout.time
        assert np.all(np.nan_to_num(fast, nan=np.inf) >= np.nan_to_num(slow, nan=np.inf))


def test_a_flight_ends_when_the_computation_does() -> None:
    (family, effort), answers = STAGE, iter([False, False, True])
    request = random_request(0, 100, "uncertain")
    flown = fly(request, family, effort._replace(ends=lambda: next(answers)))
    complete = fly(request, family, effort)
    ended = np.isfinite(flown.rollout.time)
    assert ended.sum() <= np.isfinite(complete.rollout.time).sum()
    np.testing.assert_array_equal(flown.rollout.time[ended], complete.rollout.time[ended])
    none = fly(request, family, effort._replace(ends=lambda: True))
    assert not none.rollout.direct.any()
    assert np.isnan(none.rollout.time).all()


@pytest.mark.parametrize("among_areas", [False, True])
def test_plans_are_the_same(among_areas: bool) -> None:
    policy = Policy.load()
    options = Options.for_aircraft(policy.aircraft, deadline_s=math.inf, exhaustive=False)
    for seed in range(4):
        request = random_request(seed, 12, "exact")
        own: VehicleState[Ground] = VehicleState(*(float(field[0]) for field in request.own))
        states = zip(*(field[0].tolist() for field in request.traffic.state), strict=True)
        intruders: list[Intruder[Ground]] = [
            Intruder(VehicleState(*state), position_std=30.0, velocity_std=1.0) for state in states
        ]
        points = zip(request.route_x[0].tolist(), request.route_y[0].tolist(), strict=True)
        route = [RoutePoint(number, x, y) for number, (x, y) in enumerate(points)]
        areas = (
            random_areas(5, seed, 3, own, (route[0].x, route[0].y), PAPER) if among_areas else ()
        )
        wind = Wind(5.0, -4.0)
        fast = plan(own, intruders, route, policy, options, wind=wind, areas=areas)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(FLY_ON, "_compiled", None)
            slow = plan(own, intruders, route, policy, options, wind=wind, areas=areas)
        assert fast.status == slow.status
        assert (fast.source, fast.goal_index) == (slow.source, slow.goal_index)
        for fast_point, slow_point in zip(fast.waypoints, slow.waypoints, strict=True):
            assert math.hypot(fast_point.x - slow_point.x, fast_point.y - slow_point.y) < 1e-3
