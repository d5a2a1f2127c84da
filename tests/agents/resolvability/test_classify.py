"""Witnesses must fly, proofs must hold, and the two must never contradict each other."""

import math
from typing import Any

import numpy as np
import pytest

from agents.manoeuvres.escape_manoeuvre import Manoeuvre, steps
from agents.manoeuvres.escape_search import search
from agents.resolvability import reachable_set as survivors
from agents.resolvability.classify import Method, Verdict, classify, replay
from agents.resolvability.outer_polygon import beside, outside
from agents.resolvability.proof import STEP, STRIDE, Ahead, contained, look_ahead, split
from agents.resolvability.reachable_bound import (
    DELTA,
    DIRECTIONS,
    EPSILON,
    Funnel,
    farthest,
    narrowed,
    relaxed,
    root,
    support,
)
from agents.resolvability.reachable_set import Cells, States, last_time
from envs.encounters import Scenario, scenario
from envs.intruder import Intent
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits, VehicleState, advance
from envs.outcome import RULES
from envs.starts import numbered
from envs.trees import take
from tests.agents.resolvability.scenes import CLOSE, check_witness, duel, reflected

CROWDED = scenario("multi", intruders=(2, 4), radius=(1_500.0, 4_000.0), min_initial_separation=1_000.0)
"""A fifth of these starts are beyond help, most of them because the ways past one intruder lead into another."""

INTERVAL = STRIDE * STEP
"""Between test times, s."""


@pytest.mark.parametrize(
    ("family", "count"),
    [
        (scenario("circle"), 120),
        (CLOSE, 60),
        (scenario("maneuvering"), 60),
        pytest.param(scenario("multi"), 20, marks=pytest.mark.slow),
    ],
)
def test_witnesses_succeed_in_an_independent_simulation(family: Scenario, count: int):
    encounters = numbered(family, 3, 0, count)
    judged = classify(encounters, RULES, SURROGATE)
    found = np.flatnonzero(judged.method == Method.SEARCH)
    assert found.size > 0.5 * count
    hardest = found[np.argsort(judged.separation[found])[:5]]
    for number in np.unique([*hardest, *found[:5]]):
        encounter = take(encounters, number)
        flown = replay(encounter, take(judged.witness, number), RULES, SURROGATE)
        check_witness(encounter, flown)
        assert flown.time[-1] == judged.arrival[number]
        assert flown.separation.min() == pytest.approx(judged.separation[number], abs=1e-6)
        assert flown.separation.shape == (flown.time.size - 1,) == (flown.own.x.size - 1,)
        assert flown.intruders.x.shape == (flown.time.size, encounter.mask.size)


def test_nearly_every_circle_encounter_is_decided():
    judged = classify(numbered(scenario("circle"), 11, 0, 800), RULES, SURROGATE)
    assert np.mean(judged.verdict == Verdict.UNDECIDED) <= 0.005
    assert np.mean(judged.verdict == Verdict.RESOLVABLE) > 0.99


def test_head_on_is_lost_at_short_range_and_won_at_long_range():
    judged = classify(duel([900.0, 1_500.0, 2_500.0, 6_000.0, 12_000.0]), RULES, SURROGATE)
    lost, won = Verdict.UNRESOLVABLE, Verdict.RESOLVABLE
    assert judged.verdict.tolist() == [lost, lost, lost, won, won]
    assert judged.method.tolist()[:2] == [Method.START, Method.CONTAINMENT]
    # The discs touch when the range has closed to the separation, and no proof can be had before.
    assert judged.proof_time[1] >= 500.0 / 150.0
    assert judged.proof_time[0] == 0.0
    assert np.isnan(judged.proof_time[3:]).all()


def test_the_verdict_changes_once_as_the_range_opens():
    judged = classify(duel(np.arange(2_600.0, 4_400.0, 100.0)), RULES, SURROGATE)
    rank = np.array([1, 2, 0])[judged.verdict]
    assert (np.diff(rank) >= 0).all()
    assert rank[0] == 0
    assert rank[-1] == 2
    assert np.sum(rank == 1) <= 1


def test_a_goal_out_of_reach_is_unresolvable():
    encounters = duel([12_000.0, 12_000.0], course=0.0)
    rules = RULES._replace(t_max=120.0)
    near = encounters._replace(goal_x=np.array([15_000.0, 9_000.0]))
    judged = classify(near, rules, SURROGATE)
    assert judged.verdict.tolist() == [Verdict.UNRESOLVABLE, Verdict.RESOLVABLE]
    assert judged.method[0] == Method.GOAL
    assert judged.proof_time[0] == 120.0
    # Behind, it costs a turn about: out of reach although not too far for a straight flight.
    behind = near._replace(goal_x=np.array([-9_800.0, -5_000.0]))
    assert classify(behind, rules, SURROGATE).verdict.tolist() == [Verdict.UNRESOLVABLE, Verdict.RESOLVABLE]


def test_a_violation_beyond_the_goal_proves_nothing():
    # The collision course is deadly, but the goal comes first.
    encounter = duel([2_400.0])
    assert classify(encounter, RULES, SURROGATE).verdict[0] == Verdict.UNRESOLVABLE
    assert classify(encounter._replace(goal_x=np.array([1_000.0])), RULES, SURROGATE).verdict[0] == Verdict.RESOLVABLE


def test_a_goal_beside_the_ownship_lies_inside_its_turning_circle():
    encounters = duel([9_000.0] * 3, course=0.0)
    encounters = encounters._replace(goal_x=np.array([0.0, 500.0, -500.0]), goal_y=np.array([1_000.0, 900.0, -1_200.0]))
    judged = classify(encounters, RULES, SURROGATE)
    assert (judged.verdict == Verdict.RESOLVABLE).all()


@pytest.mark.slow
def test_no_proof_touches_a_solved_encounter():
    for family, count in ((CLOSE, 300), (scenario("maneuvering", radius=(1_500.0, 5_000.0)), 200), (CROWDED, 60)):
        encounters = numbered(family, 5, 0, count)
        ahead = look_ahead(encounters, RULES, SURROGATE)
        unproven = np.flatnonzero(np.isnan(contained(ahead, RULES, SURROGATE)))
        found = search(take(encounters, unproven), RULES, SURROGATE)
        solved = unproven[~np.isnan(found.arrival)]
        tight = solved[np.argsort(found.separation[~np.isnan(found.arrival)])[:6]]
        assert np.isnan(split(take(ahead, tight), RULES, SURROGATE, nodes=40)).all()


@pytest.mark.slow
def test_no_search_finds_a_way_out_of_what_is_proven():
    encounters = numbered(CLOSE, 6, 0, 2_000)
    ahead = look_ahead(encounters, RULES, SURROGATE)
    times = contained(ahead, RULES, SURROGATE)
    doomed = np.flatnonzero(times > 0.0)
    assert doomed.size > 100
    # Those proven last are the nearest to a way out.
    last = doomed[np.argsort(-times[doomed])[:24]]
    assert np.isnan(search(take(encounters, last), RULES, SURROGATE).arrival).all()


def test_a_proof_survives_what_makes_the_task_harder():
    encounters = numbered(CLOSE, 8, 0, 200)
    wider = Limits(45.0, 110.0, -0.6, 0.6, math.radians(3.5))
    assert C208_PUBLISHED.yaw_rate_max > wider.yaw_rate_max
    proven = ~np.isnan(contained(look_ahead(encounters, RULES, SURROGATE), RULES, SURROGATE))
    for rules, limits in ((RULES._replace(separation=900.0), SURROGATE), (RULES, wider)):
        easier = contained(look_ahead(encounters, rules, limits), rules, limits)
        assert proven[~np.isnan(easier)].all()
        assert np.isnan(easier).sum() > (~proven).sum()
    # An easier task never turns a witness into a proof.
    some = take(encounters, slice(0, 40))
    here = classify(some, RULES, SURROGATE).verdict
    for rules, limits in ((RULES._replace(separation=950.0), SURROGATE), (RULES, wider)):
        there = classify(some, rules, limits).verdict
        assert not np.any((here == Verdict.RESOLVABLE) & (there == Verdict.UNRESOLVABLE))


@pytest.mark.parametrize("family", [scenario("circle"), scenario("maneuvering"), CLOSE])
def test_verdicts_do_not_know_left_from_right(family: Scenario):
    encounters = numbered(family, 9, 0, 80)
    here = classify(encounters, RULES, SURROGATE)
    there = classify(reflected(encounters), RULES, SURROGATE)
    differ = here.verdict != there.verdict
    # The refinement draws at random: what it finds only on one side is undecided on the other, never disproven.
    assert np.all((np.minimum(here.verdict, there.verdict) == Verdict.UNDECIDED)[differ])
    assert differ.sum() <= 1


def test_verdicts_do_not_depend_on_the_batch():
    encounters = numbered(CLOSE, 10, 0, 60)
    whole = classify(encounters, RULES, SURROGATE)
    parts = [classify(take(encounters, slice(i, i + 20)), RULES, SURROGATE) for i in (0, 20, 40)]
    np.testing.assert_array_equal(whole.verdict, np.concatenate([part.verdict for part in parts]))
    np.testing.assert_array_equal(whole.arrival, np.concatenate([part.arrival for part in parts]))


def test_an_absent_intruder_does_not_count():
    encounters = duel([1_500.0])
    crowd = encounters._replace(
        intruders=VehicleState(*(np.tile(field, (1, 2)) for field in encounters.intruders)),
        mask=np.array([[True, False]]),
        intent=Intent(*(np.tile(field, (1, 2)) for field in encounters.intent)),
    )
    assert classify(crowd, RULES, SURROGATE).verdict[0] == Verdict.UNRESOLVABLE
    far = crowd._replace(intruders=crowd.intruders._replace(x=np.array([[30_000.0, 1_500.0]])))
    assert classify(far, RULES, SURROGATE).verdict[0] == Verdict.RESOLVABLE


def test_what_others_have_solved_is_resolvable_without_a_search():
    judged = classify(duel([900.0, 12_000.0]), RULES, SURROGATE, solved=np.array([False, True]))
    assert judged.verdict.tolist() == [Verdict.UNRESOLVABLE, Verdict.RESOLVABLE]
    assert judged.method.tolist() == [Method.START, Method.SOLVED_ELSEWHERE]
    assert judged.verdict.dtype == judged.method.dtype == np.int8
    assert np.isnan(judged.arrival[1])
    with pytest.raises(ValueError, match="no witness"):
        replay(take(duel([900.0]), 0), take(judged.witness, 0), RULES, SURROGATE)


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="leading axis"):
        classify(take(duel([900.0]), 0), RULES, SURROGATE)
    with pytest.raises(ValueError, match=r"bool \[1\]"):
        classify(duel([900.0]), RULES, SURROGATE, solved=np.array([True, False]))


def random_flights(
    count: int, seconds: float, tick: float = 1.0, start_speed: float | None = None
) -> tuple[np.ndarray, ...]:
    """Fly extremal commands, held for some seconds each; return x, y, turn and speed ``[T + 1, N]``, at every tick."""
    random = np.random.default_rng(1)
    speed = random.uniform(50.0, 100.0, count) if start_speed is None else np.full(count, start_speed)
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
    everything = root(speed[0], times, relaxed(SURROGATE))

    def check(funnel: Funnel, flights: Any, *, growing: bool = False) -> np.ndarray:
        """Assert that the flights obey the supports of their funnels; return how far inside they are."""
        bounds = support(funnel, DIRECTIONS, step, relaxed(SURROGATE), stride=20, growing=growing)
        along = np.cos(DIRECTIONS)[:, None, None] * x[1:, flights] + np.sin(DIRECTIONS)[:, None, None] * y[1:, flights]
        inside = bounds - along.transpose(2, 0, 1)
        assert inside.min() >= 0.0
        return inside

    loose, tight = (check(everything, np.arange(count), growing=growing) for growing in (False, True))
    assert (loose >= tight - 1e-9).all()
    # Without a bound there would be nothing to contain: straight flights and full turns come near.
    assert tight.min() < 0.5

    at = np.full(count, 14.0)
    nowhere = np.full(count, np.nan)
    for turn, split_speed in ((np.full(count, 0.2), nowhere), (nowhere, np.full(count, 72.0))):
        below, above = narrowed(everything, times, at, turn, split_speed, relaxed(SURROGATE))
        low = turned[14] <= turn if np.isnan(split_speed).all() else speed[14] <= split_speed
        check(take(below, low), np.flatnonzero(low))
        check(take(above, ~low), np.flatnonzero(~low))


def test_farthest_bounds_every_point_of_the_polygon():
    random = np.random.default_rng(2)
    for _ in range(50):
        points = random.normal(size=(5, 2)) * random.uniform(10.0, 500.0, 2) + random.normal(size=2) * 400.0
        supports = np.max(
            np.cos(DIRECTIONS)[:, None] * points[:, 0] + np.sin(DIRECTIONS)[:, None] * points[:, 1], axis=1
        )
        place = random.normal(size=(3, 2)) * 600.0
        bound = farthest(supports[None, :, None], place[None, :, 0, None], place[None, :, 1, None])[0, :, 0]
        exact = np.hypot(*(points[:, None] - place[None]).transpose(2, 0, 1)).max(axis=0)
        assert (bound >= exact - 1e-9).all()
        # Not looser than the circumscribed circle of the fan.
        assert (bound <= exact / math.cos(math.pi / DIRECTIONS.size) + 1e-9).all()


def flown_clear(ahead: Ahead, count: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Fly random commands in one encounter; return the flights ``[T, N]`` at the test times, and which are clear then.

    Clear is a flight that has been in no disc of the separation less delta at any test time so far.
    """
    tests = ahead.x.shape[2]
    flights = random_flights(count, INTERVAL * tests, INTERVAL, float(ahead.speed[0]))
    x, y, turned, speed = (field[1:] for field in flights)
    apart = np.hypot(x[:, None] - ahead.x[0].T[:, :, None], y[:, None] - ahead.y[0].T[:, :, None]).min(axis=1)
    return (x, y, turned, speed), np.logical_and.accumulate(apart > RULES.separation - DELTA, axis=0)


def test_gaps_between_intruders_that_close_are_proven_closed():
    # Searches through piecewise controls keep no more than 685 and 958 m.
    for number in (126, 204):
        ahead = look_ahead(numbered(scenario("multi", intruders=(2, 4)), 0, number, 1), RULES, SURROGATE)
        assert np.isnan(contained(ahead, RULES, SURROGATE)[0])
        proven = split(ahead, RULES, SURROGATE, nodes=0)[0]
        assert 10.0 < proven < 46.5
        clear = flown_clear(ahead, 4_000)[1]
        assert clear[0].all()
        assert not clear[round(proven / INTERVAL) - 1].any()


@pytest.mark.parametrize(
    "cells", [Cells(math.radians(30.0), 12.0, 1_000.0, 80, 900), Cells(math.radians(9.0), 5.0, 300.0, 17, 900)]
)
def test_flights_clear_of_all_intruders_are_among_the_survivors(cells: Cells, monkeypatch: pytest.MonkeyPatch):
    kept: list[States] = []

    def spy(states: States, cells: Cells, merged: Any = survivors.merged) -> States:
        kept.append(merged(states, cells))
        return kept[-1]

    monkeypatch.setattr(survivors, "merged", spy)
    checked = 0
    for number in range(6):
        ahead = look_ahead(numbered(CROWDED, 7, number, 1), RULES, SURROGATE)
        kept.clear()
        discs = (ahead.x[0], ahead.y[0], RULES.separation - DELTA)
        last_time(float(ahead.speed[0]), discs, (1e6, 0.0, 500.0), INTERVAL, cells, relaxed(SURROGATE))
        flights, clear = flown_clear(ahead, 500)
        for index, states in enumerate(kept):
            test = min((index + 1) * cells.tests, ahead.x.shape[2]) - 1
            x, y, turned, speed = (field[test, clear[test]] for field in flights)
            along = np.cos(DIRECTIONS)[:, None] * x + np.sin(DIRECTIONS)[:, None] * y
            within = np.all(states.supports[:, :, None] >= along, axis=1)
            bounds = ((turned, states.turn_low, states.turn_high), (speed, states.speed_low, states.speed_high))
            for value, low, high in bounds:
                within &= (value >= low[:, None] - 1e-9) & (value <= high[:, None] + 1e-9)
            assert within.any(axis=0).all()
            checked += x.size
    assert checked > 1_000


def test_survivors_that_reach_the_goal_before_the_disc_prove_nothing():
    cells = Cells(math.radians(30.0), 12.0, 1_000.0, 80, 3_000)
    ahead = look_ahead(duel([2_400.0]), RULES, SURROGATE)
    discs = (ahead.x[0], ahead.y[0], RULES.separation - DELTA)
    # The discs meet at 1 s before the ownship is at 700 m or so.
    for goal, ends in ((15_000.0, True), (2_000.0, True), (1_000.0, False)):
        time = last_time(75.0, discs, (goal, 0.0, RULES.goal_radius + DELTA), INTERVAL, cells, relaxed(SURROGATE))
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
        left, some = outside(supports, x, y, 500.0)
        spared = inside[np.hypot(inside[:, 0] - x, inside[:, 1] - y) > 500.0]
        assert (spared @ normal <= left).all()
        assert some[0] or not spared.size
        assert (left <= supports + 1e-5).all()
        shrunk_some += bool((left < supports - 1.0).any())

        part = beside(supports, 5, np.array([0.5 * (supports[0, 5] - supports[0, 21])]))
        spared = inside[inside @ normal[:, 5] <= 0.5 * (supports[0, 5] - supports[0, 21])]
        assert (spared @ normal <= part).all()
        assert part[0, 5] == pytest.approx(0.5 * (supports[0, 5] - supports[0, 21]), abs=1e-5)
    assert shrunk_some > 20
    # Two discs that neither contain it contain it together.
    disc = np.full((1, DIRECTIONS.size), 500.0)
    for radius, covered in ((600.0, True), (550.0, False)):
        rest, some = outside(disc, 250.0, 0.0, radius)
        assert some[0]
        assert outside(rest, -250.0, 0.0, radius)[1][0] != covered


def test_the_margins_of_a_proof_are_honoured():
    assert DELTA == 0.1
    assert EPSILON == 1e-4
    assert relaxed(SURROGATE).yaw_rate_max == pytest.approx(SURROGATE.yaw_rate_max * 1.0001)
    assert relaxed(SURROGATE).speed_min < SURROGATE.speed_min
    # Half the margin short of the separation and opening: a violation, but no proof.
    opening = duel([999.95], course=0.0, speed=50.0, intruder_speed=100.0)
    assert classify(opening, RULES, SURROGATE).verdict[0] == Verdict.UNDECIDED
    half_a_metre = duel([999.5], course=0.0, speed=50.0, intruder_speed=100.0)
    assert classify(half_a_metre, RULES, SURROGATE).verdict[0] == Verdict.UNRESOLVABLE
    assert classify(half_a_metre, RULES, SURROGATE, reserve=0.75).verdict[0] == Verdict.UNDECIDED
    assert steps(RULES) == 300
    assert len(Manoeuvre._fields) == 8
