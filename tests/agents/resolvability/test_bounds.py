"""Bounds on what any flight can do: reachable sets contain every flight, and a causal oracle beats
no proof.
"""

import math
from typing import Any

import numpy as np
import pytest

from agents.manoeuvres.escape_manoeuvre import steps, tracks
from agents.resolvability import reachable_set as survivors
from agents.resolvability.causal_bound import Causal, causal
from agents.resolvability.classify import Replay
from agents.resolvability.outer_polygon import beside, outside
from agents.resolvability.proof import Ahead, containment_time, look_ahead, split
from agents.resolvability.reachable_bound import (
    DIRECTIONS,
    Funnel,
    delta,
    farthest,
    narrow,
    relax,
    root,
    support,
)
from agents.resolvability.reachable_set import Cells, States, last_time
from envs.aircraft import PAPER
from envs.encounters import Encounter
from envs.kinematics import SURROGATE, VehicleState, advance
from envs.outcome import RULES
from envs.scenarios import scenario
from envs.starts import encounters_of_seed, join
from envs.trees import take
from tests.agents.scenes import CLOSE, CROWDED, INTERVAL, check_witness, duel

DELTA = delta(RULES, SURROGATE)


def random_flights(
    count: int, seconds: float, tick: float = 1.0, start_speed: float | None = None
) -> tuple[np.ndarray, ...]:
    """Fly extremal commands, held for some seconds each; return x, y, turn and speed ``[T + 1,
    N]``, at every tick.
    """
    random = np.random.default_rng(1)
    speed = (
        random.uniform(50.0, 100.0, count) if start_speed is None else np.full(count, start_speed)
    )
    state = VehicleState(np.zeros(count), np.zeros(count), np.zeros(count), speed)
    turned = np.zeros(count)
    record = [(state.x, state.y, turned, state.speed)]
    hold = random.integers(1, round(12 / tick), count)
    command = np.zeros((2, count))
    for index in range(round(seconds / tick)):
        fresh = index % hold == 0
        command = np.where(fresh, random.integers(-1, 2, (2, count)), command)
        turn = command[1] * SURROGATE.yaw_rate_max
        state = advance(state, command[0] * SURROGATE.acceleration_max, turn, tick, SURROGATE, np)
        turned = turned + turn * tick
        record.append((state.x, state.y, turned, state.speed))
    return tuple(np.array(values) for values in zip(*record, strict=True))


def test_no_flight_leaves_the_outer_set_and_some_touch_it():
    count, seconds, step = 150, 40, 0.05
    x, y, turned, speed = random_flights(count, seconds)
    times = step * np.arange(round(seconds / step) + 1)
    everything = root(speed[0], times, relax(SURROGATE))

    def check(funnel: Funnel, flights: Any, *, growing: bool = False) -> np.ndarray:
        """Assert that the flights obey the supports of their funnels; return how far inside they
        are.
        """
        bounds = support(funnel, DIRECTIONS, step, relax(SURROGATE), stride=20, growing=growing)
        along = (
            np.cos(DIRECTIONS)[:, None, None] * x[1:, flights]
            + np.sin(DIRECTIONS)[:, None, None] * y[1:, flights]
        )
        inside = bounds - along.transpose(2, 0, 1)
        assert inside.min() >= 0.0
        return inside

    loose, tight = (
        check(everything, np.arange(count), growing=growing) for growing in (False, True)
    )
    assert (loose >= tight - 1e-9).all()
    # Without a bound there would be nothing to contain: straight flights and full turns come near.
    assert tight.min() < 0.5

    at = np.full(count, 14.0)
    nowhere = np.full(count, np.nan)
    for turn, split_speed in ((np.full(count, 0.2), nowhere), (nowhere, np.full(count, 72.0))):
        below, above = narrow(everything, times, at, turn, split_speed, relax(SURROGATE))
        low = turned[14] <= turn if np.isnan(split_speed).all() else speed[14] <= split_speed
        check(take(below, low), np.flatnonzero(low))
        check(take(above, ~low), np.flatnonzero(~low))


def test_farthest_bounds_every_point_of_the_polygon():
    random = np.random.default_rng(2)
    for _ in range(50):
        points = (
            random.normal(size=(5, 2)) * random.uniform(10.0, 500.0, 2)
            + random.normal(size=2) * 400.0
        )
        supports = np.max(
            np.cos(DIRECTIONS)[:, None] * points[:, 0] + np.sin(DIRECTIONS)[:, None] * points[:, 1],
            axis=1,
        )
        place = random.normal(size=(3, 2)) * 600.0
        bound = farthest(supports[None, :, None], place[None, :, 0, None], place[None, :, 1, None])[
            0, :, 0
        ]
        exact = np.hypot(*(points[:, None] - place[None]).transpose(2, 0, 1)).max(axis=0)
        assert (bound >= exact - 1e-9).all()
        # Not looser than the circumscribed circle of the fan.
        assert (bound <= exact / math.cos(math.pi / DIRECTIONS.size) + 1e-9).all()


def flown_clear(ahead: Ahead, count: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Fly random commands in one encounter; return the flights ``[T, N]`` at the test times, and
    which are clear then.

    Clear is a flight that has been in no disc of the separation less delta at any test time so far.
    """
    tests = ahead.x.shape[2]
    flights = random_flights(count, INTERVAL * tests, INTERVAL, float(ahead.speed[0]))
    x, y, turned, speed = (field[1:] for field in flights)
    apart = np.hypot(
        x[:, None] - ahead.x[0].T[:, :, None], y[:, None] - ahead.y[0].T[:, :, None]
    ).min(axis=1)
    return (x, y, turned, speed), np.logical_and.accumulate(
        apart > RULES.separation - DELTA, axis=0
    )


@pytest.mark.slow
def test_gaps_between_intruders_that_close_are_proven_closed():
    # Searches through piecewise controls keep no more than 685 and 958 m.
    for number in (126, 204):
        ahead = look_ahead(
            encounters_of_seed(scenario("multi", PAPER, intruders=(2, 4)), 0, number, 1),
            RULES,
            SURROGATE,
        )
        assert np.isnan(containment_time(ahead, RULES, SURROGATE)[0])
        proven = split(ahead, RULES, SURROGATE, nodes=0)[0]
        assert 10.0 < proven < 46.5
        clear = flown_clear(ahead, 4_000)[1]
        assert clear[0].all()
        assert not clear[round(proven / INTERVAL) - 1].any()


@pytest.mark.parametrize(
    "cells",
    [
        Cells(math.radians(30.0), 12.0, 1_000.0, 80, 900),
        Cells(math.radians(9.0), 5.0, 300.0, 17, 900),
    ],
)
def test_flights_clear_of_all_intruders_are_among_the_survivors(
    cells: Cells, monkeypatch: pytest.MonkeyPatch
):
    merged_states: list[States] = []

    def spy(states: States, cells: Cells, merged: Any = survivors.merge) -> States:
        merged_states.append(merged(states, cells))
        return merged_states[-1]

    monkeypatch.setattr(survivors, "merge", spy)
    checked = 0
    for number in range(6):
        ahead = look_ahead(encounters_of_seed(CROWDED, 7, number, 1), RULES, SURROGATE)
        merged_states.clear()
        discs = (ahead.x[0], ahead.y[0], np.full(ahead.x.shape[1], RULES.separation - DELTA))
        last_time(
            float(ahead.speed[0]), discs, (1e6, 0.0, 500.0), INTERVAL, cells, relax(SURROGATE)
        )
        flights, clear = flown_clear(ahead, 500)
        for index, states in enumerate(merged_states):
            test = min((index + 1) * cells.tests, ahead.x.shape[2]) - 1
            x, y, turned, speed = (field[test, clear[test]] for field in flights)
            along = np.cos(DIRECTIONS)[:, None] * x + np.sin(DIRECTIONS)[:, None] * y
            within = np.all(states.supports[:, :, None] >= along, axis=1)
            bounds = (
                (turned, states.turn_low, states.turn_high),
                (speed, states.speed_low, states.speed_high),
            )
            for value, low, high in bounds:
                within &= (value >= low[:, None] - 1e-9) & (value <= high[:, None] + 1e-9)
            assert within.any(axis=0).all()
            checked += x.size
    assert checked > 1_000


def test_survivors_that_reach_the_goal_before_the_disc_prove_nothing():
    cells = Cells(math.radians(30.0), 12.0, 1_000.0, 80, 3_000)
    ahead = look_ahead(duel([2_400.0]), RULES, SURROGATE)
    discs = (ahead.x[0], ahead.y[0], np.full(ahead.x.shape[1], RULES.separation - DELTA))
    # The discs meet at 1 s before the ownship is at 700 m or so.
    for goal, ends in ((15_000.0, True), (2_000.0, True), (1_000.0, False)):
        time = last_time(
            75.0, discs, (goal, 0.0, RULES.goal_radius + DELTA), INTERVAL, cells, relax(SURROGATE)
        )
        assert np.isfinite(time) == ends


def test_polygons_lose_what_a_disc_or_a_line_takes_and_no_more():
    random = np.random.default_rng(3)
    normal = np.stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)])
    shrunk_some = 0
    for _ in range(60):
        points = random.normal(size=(6, 2)) * random.uniform(50.0, 600.0, 2)
        supports = np.max(points @ normal, axis=0)[None]
        inside = random.uniform(-1_500.0, 1_500.0, (4_000, 2))
        inside = inside[np.all(inside @ normal <= supports, axis=1)]
        x, y = random.normal(size=2) * 500.0
        remaining, survives = outside(supports, x, y, 500.0)
        spared = inside[np.hypot(inside[:, 0] - x, inside[:, 1] - y) > 500.0]
        assert (spared @ normal <= remaining).all()
        assert survives[0] or not spared.size
        assert (remaining <= supports + 1e-5).all()
        shrunk_some += bool((remaining < supports - 1.0).any())

        part = beside(supports, 5, np.array([0.5 * (supports[0, 5] - supports[0, 21])]))
        spared = inside[inside @ normal[:, 5] <= 0.5 * (supports[0, 5] - supports[0, 21])]
        assert (spared @ normal <= part).all()
        assert part[0, 5] == pytest.approx(0.5 * (supports[0, 5] - supports[0, 21]), abs=1e-5)
    assert shrunk_some > 20
    # Two discs that neither contain it contain it together.
    disc = np.full((1, DIRECTIONS.size), 500.0)
    for radius, covered in ((600.0, True), (550.0, False)):
        second_remaining, survives = outside(disc, 250.0, 0.0, radius)
        assert survives[0]
        assert outside(second_remaining, -250.0, 0.0, radius)[1][0] != covered


# The oracle without foresight must fly what it claims, never beat a proof, and see nothing of the
# intents.

SHORT = (3_000.0, 3_200.0)
QUICK = RULES._replace(t_max=150.0)
"""Time enough for short encounters."""


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    straight = encounters_of_seed(
        scenario("circle", PAPER, radius=SHORT, conflicts_closer_than=1_000.0), 2, 0, 2
    )
    return join(straight, encounters_of_seed(scenario("maneuvering", PAPER, radius=SHORT), 2, 0, 2))


@pytest.fixture(scope="module")
def flown(encounters: Encounter) -> Causal:
    return causal(encounters, QUICK, SURROGATE)


def record_flight(encounter: Encounter, result: Causal, number: int) -> Replay:
    """Return one flight of the oracle against the true intruders, flown alone."""
    count = int(np.sum(~np.isnan(result.own.x[:, number])))
    traffic = VehicleState(*(field[:count] for field in tracks(encounter, steps(QUICK), QUICK)))
    own = VehicleState(*(field[:count, number] for field in result.own))
    return Replay(np.arange(count) * QUICK.dt, own, traffic, np.zeros(count - 1))


def test_what_it_solves_is_solved_in_an_independent_simulation(
    encounters: Encounter, flown: Causal
):
    assert flown.solved[:2].all()
    assert flown.solved.sum() >= 3
    for number in np.flatnonzero(flown.solved):
        encounter = take(encounters, number)
        alone = record_flight(encounter, flown, int(number))
        check_witness(encounter, alone)
        assert alone.time[-1] == flown.arrival[number]
        apart = np.hypot(
            alone.intruders.x[:, 0] - alone.own.x, alone.intruders.y[:, 0] - alone.own.y
        )
        assert apart.min() >= flown.separation[number] - 0.1 >= QUICK.separation - 0.1
        length = 0.5 * np.sum(alone.own.speed[1:] + alone.own.speed[:-1])
        assert flown.path[number] == pytest.approx(length)


@pytest.mark.slow
def test_it_never_solves_what_is_proven_unresolvable():
    encounters = encounters_of_seed(CLOSE, 6, 0, 300)
    proven = ~np.isnan(containment_time(look_ahead(encounters, QUICK, SURROGATE), QUICK, SURROGATE))
    assert proven.sum() > 20
    lost = causal(take(encounters, np.flatnonzero(proven)[:4]), QUICK, SURROGATE)
    assert (lost.outcome == 0).all()
    assert np.isnan(lost.arrival).all()
    assert (lost.separation < QUICK.separation).all()


@pytest.mark.slow
def test_it_does_not_see_an_intent_before_it_shows():
    encounter = duel([7_000.0], course=math.pi + 0.3)._replace(goal_x=np.array([7_000.0]))
    intent = encounter.intent._replace(onset=np.array([[20.0]]), heading_change=np.array([[-0.5]]))
    with_intent, without_intent = (
        causal(variant, QUICK._replace(t_max=100.0), SURROGATE)
        for variant in (encounter._replace(intent=intent), encounter)
    )
    # The turn begins at 20 s, shows at 21 s, and changes what is flown from then on.
    np.testing.assert_array_equal(with_intent.own.heading[:22], without_intent.own.heading[:22])
    np.testing.assert_array_equal(with_intent.own.x[:22], without_intent.own.x[:22])
    assert not np.array_equal(with_intent.own.x, without_intent.own.x, equal_nan=True)


@pytest.mark.slow
def test_it_depends_on_neither_batch_nor_order(encounters: Encounter, flown: Causal):
    order = np.array([2, 1])
    again = causal(take(encounters, order), QUICK, SURROGATE)
    np.testing.assert_array_equal(again.outcome, flown.outcome[order])
    np.testing.assert_array_equal(again.path, flown.path[order])


def test_it_wants_a_leading_axis(encounters: Encounter):
    with pytest.raises(ValueError, match="leading axis"):
        causal(take(encounters, 0), QUICK, SURROGATE)
