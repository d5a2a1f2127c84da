"""The fallback's manoeuvres fly as the core says, whatever flies with them and however many steps
are taken at once.
"""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.manoeuvres import simulator
from agents.manoeuvres.escape_manoeuvre import Counting, Flight, Manoeuvre, fly, takeoff
from agents.manoeuvres.escape_search import COARSE, STAGES, concatenate, scale
from agents.manoeuvres.simulator import Effort, fly_away
from agents.planner.request.encounters import request_of
from agents.planner.request.options import Options
from agents.planner.request.request import Request
from agents.planner.search.compiled_flight import FLY_ON
from agents.planner.search.fallback_flight import ManoeuvreFlights, fly_out, stride_of
from envs.aircraft import PAPER
from envs.kinematics import SURROGATE, VehicleState
from envs.outcome import RULES
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take

OPTIONS = Options.for_aircraft(PAPER)
STRIDE = stride_of(OPTIONS)

FAMILY = scale(concatenate(*STAGES[:2]), PAPER)
DELAYED = take(scale(STAGES[3], PAPER), slice(None, None, 5))
LIMITS = SURROGATE._replace(speed_max=99.6, acceleration_max=0.375)

turns = st.floats(-math.pi, math.pi)
throttles = st.floats(-1.0, 1.0)
delays = st.floats(0.0, 60.0)
manoeuvres = st.builds(
    Manoeuvre,
    turns,
    throttles,
    delays,
    turns,
    throttles,
    st.just(math.inf),
    st.just(0.0),
    throttles,
)


def requests(kind: str = "circle", count: int = 12) -> Request:
    return request_of(encounters_of_seed(scenario(kind, PAPER), 5, 0, count), PAPER)


def fly_family(
    request: Request,
    family: Manoeuvre,
    least: float,
    enough: int,
    options: Options | None = None,
    longest: float = 150.0,
) -> ManoeuvreFlights:
    """Fly a family for every request."""
    count, size = request.points.size, family.turn.size
    rows = np.repeat(np.arange(count), size)
    every = Manoeuvre(*(np.tile(field, count) for field in family))
    return fly_out(
        request,
        np.ones(count, int),
        rows,
        every,
        options or OPTIONS,
        Effort(least, OPTIONS.smoothing, enough, longest),
    )


def assert_same(first: Any, second: Any) -> None:
    """Check that nested tuples of arrays hold the same bits."""
    for value, expected in zip(first, second, strict=True):
        if isinstance(value, tuple):
            assert_same(value, expected)
        else:
            np.testing.assert_array_equal(value, expected)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(chosen=manoeuvres, heading=st.floats(-math.pi, 3.14), speed=st.floats(49.0, 101.0))
def test_steps_at_once_are_those_of_the_true_flight(
    chosen: Manoeuvre, heading: float, speed: float
) -> None:
    manoeuvre = Manoeuvre(*(np.array([float(field)]) for field in chosen))
    own = VehicleState(*(np.array([value]) for value in (100.0, -50.0, heading, speed)))
    nobody = VehicleState(*np.zeros((4, 1, 0)))
    nowhere = (np.full(1, 1e5), np.zeros(1))
    states, _ = fly_away(takeoff(own, manoeuvre), manoeuvre, 0, 20, STRIDE, LIMITS)
    flight, rules = takeoff(own, manoeuvre), RULES._replace(dt=STRIDE)
    for step in range(21):
        for field, value in zip(states, flight.own, strict=True):
            np.testing.assert_allclose(np.cos(field[step] - value), 1.0, atol=1e-12)
            np.testing.assert_allclose(np.sin(field[step] - value), 0.0, atol=1e-7)
        assert -math.pi <= states.heading[step, 0] < math.pi
        none = Counting(np.zeros((1, 0), dtype=bool), None)
        flight = fly(flight, manoeuvre, step * STRIDE, nowhere, nobody, none, rules, LIMITS)


def test_a_flight_does_not_depend_on_how_many_steps_are_taken_at_once() -> None:
    own = take(requests().own, np.zeros(DELAYED.turn.size, int))
    whole, end = fly_away(takeoff(own, DELAYED), DELAYED, 0, 24, STRIDE, LIMITS)
    flight: Flight = takeoff(own, DELAYED)
    for first, count in ((0, 1), (1, 6), (7, 2), (9, 15)):
        states, flight = fly_away(flight, DELAYED, first, count, STRIDE, LIMITS)
        assert_same(states, take(whole, slice(first, first + count + 1)))
    assert_same(flight, end)


@pytest.mark.parametrize("kind", ["circle", "multi"])
def test_manoeuvres_do_not_depend_on_the_others(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # To the last bit: a single request, too, is flown by numpy.
    monkeypatch.setattr(FLY_ON, "_compiled", None)
    request = requests(kind)
    together = fly_family(request, FAMILY, -40.0, 12)
    size = FAMILY.turn.size
    for number in range(0, 12, 3):
        alone = fly_family(take(request, [number]), FAMILY, -40.0, 12)
        rows = slice(number * size, (number + 1) * size)
        assert_same(alone.rollout, take(together.rollout, rows))
        np.testing.assert_array_equal(alone.clearance, together.clearance[rows])
    monkeypatch.setattr(simulator, "_AT_ONCE", 1)
    monkeypatch.setattr(simulator, "_PAIRS", 1)
    assert_same(fly_family(request, FAMILY, -40.0, 12), together)


@pytest.mark.parametrize("sigma", [0.0, 1.5])
def test_the_clearance_is_that_of_the_flight(sigma: float) -> None:
    request = requests("multi", 6)
    traffic = request.traffic._replace(velocity_std=np.where(request.traffic.mask, sigma, 0.0))
    request = request._replace(traffic=traffic)
    options = OPTIONS
    flown = fly_family(request, COARSE, -np.inf, 10_000, options)
    size, times = COARSE.turn.size, np.arange(0.0, 150.0, 0.25)
    assert np.isfinite(flown.rollout.time).any()
    for number in range(6):
        row, end = take(request, number), flown.rollout.time[number * size : (number + 1) * size]
        own = take(request.own, np.full(size, number))
        states, _ = fly_away(takeoff(own, COARSE), COARSE, 0, times.size, 0.25, options.manoeuvre)
        intruders, mask = row.traffic.state, row.traffic.mask
        east = (
            intruders.x[mask]
            + intruders.speed[mask] * np.cos(intruders.heading[mask]) * times[:, None]
        )
        north = (
            intruders.y[mask]
            + intruders.speed[mask] * np.sin(intruders.heading[mask]) * times[:, None]
        )
        apart = np.hypot(
            states.x[:-1, :, None] - east[:, None], states.y[:-1, :, None] - north[:, None]
        )
        clearance = np.min(
            apart - 1_000.0 - OPTIONS.requirement.margin - 2.0 * sigma * times[:, None, None],
            axis=-1,
        )
        under_way = times[:, None] <= np.where(np.isnan(end), 150.0, end)
        least = np.min(np.where(under_way, clearance, np.inf), axis=0)
        # A stride counts as if the uncertainty at its end held from its beginning.
        clearance = flown.clearance[number * size : (number + 1) * size]
        # Sampling at 0.25 s misses less than 1 m of a pass at 500 m or more.
        landed = (end > 0.0) & (least > -500.0)
        assert np.all(clearance[landed] <= least[landed] + 2.0)
        assert np.all(clearance[landed] >= least[landed] - 2.0 - 2.0 * sigma * STRIDE)


def test_manoeuvres_under_way_when_enough_have_returned_are_given_up() -> None:
    request = requests(count=4)
    size = FAMILY.turn.size
    everybody, only_enough = (
        fly_family(request, FAMILY, -40.0, 10_000).rollout,
        fly_family(request, FAMILY, -40.0, 5),
    )
    for number in range(4):
        rows = slice(number * size, (number + 1) * size)
        time, clearance = only_enough.rollout.time[rows], only_enough.clearance[rows]
        well = np.sort(time[np.isfinite(time) & (clearance >= 25.0)])
        assert well.size >= 5
        last = well[4]
        np.testing.assert_array_equal(
            time, np.where(everybody.time[rows] <= last, everybody.time[rows], np.nan)
        )


def test_knots_and_sums_are_those_of_the_flight() -> None:
    request = requests(count=2)
    flown = fly_family(request, COARSE, -40.0, 10_000).rollout
    own = take(request.own, np.repeat(np.arange(2), COARSE.turn.size))
    every = Manoeuvre(*(np.tile(field, 2) for field in COARSE))
    states, _ = fly_away(takeoff(own, every), every, 0, 31, STRIDE, OPTIONS.manoeuvre)
    long = np.flatnonzero(flown.time > 20.0)
    assert long.size
    for row in long:
        last = int(flown.time[row] / STRIDE)
        for plan_states, end, field in zip(flown.plan_states, flown.end, states, strict=True):
            np.testing.assert_array_equal(
                plan_states[row][: last // 4 + 1], field[: last + 1 : 4, row]
            )
            assert np.isnan(plan_states[row][last // 4 + 1 :]).all()
            assert end[row] == field[last, row]
        speed = states.speed[: last + 1, row]
        np.testing.assert_allclose(
            flown.path[row], STRIDE * (speed.sum() - 0.5 * (speed[0] + speed[-1]))
        )
        turn = every.turn_after[row]
        assert flown.turn_sign[row] == np.sign(turn)
        assert flown.reversals[row] == 0
