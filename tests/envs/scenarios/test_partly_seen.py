"""Coverage of reports: range, field of view and silence, in numpy and jax alike; nothing of it
changes the world itself.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.inference import Policy
from envs import surrogate, world
from envs.aircraft import PAPER
from envs.encounters import Encounter, EncounterError, Scenario
from envs.kinematics import VehicleState
from envs.outcome import RULES
from envs.perception import EVERYTHING, Coverage, report
from envs.scenarios import scenario
from envs.starts import EVERY_FIELD, cast, check_encounter, encounters_of_seed
from envs.surrogate import World
from envs.trees import map_leaves
from tests.support import pool_of

NAME = "circle + partly_seen"
WORLD = World(RULES, PAPER)


@pytest.fixture(scope="module")
def chosen() -> Scenario:
    return scenario(NAME, PAPER, intruders=(1, 4))


@pytest.fixture(scope="module")
def drawn(chosen: Scenario) -> Encounter:
    return encounters_of_seed(chosen, 3, 0, 300, heeds=EVERY_FIELD)


def test_what_is_far_abaft_or_silent_is_not_reported():
    own = VehicleState(*np.array([[0.0], [0.0], [math.pi / 2], [80.0]]))  # northwards
    north = np.array([5000.0, 5000.0, -2000.0, -2000.0])
    east = np.array([0.0, 4000.0, 0.0, 3000.0])
    intruders = VehicleState(east, north, 0.0 * east, 0.0 * east)
    coverage = Coverage(6000.0, math.radians(130.0), 10.0, 5.0)
    # Ahead; farther than the range; abaft; 124 degrees to the right.
    for time, is_seen in ((9.0, True), (10.0, False), (14.9, False), (15.0, True)):
        reported = report(own, intruders, coverage, time, np)
        assert reported.tolist() == [is_seen, False, False, is_seen]
    assert report(own, intruders, EVERYTHING, 0.0, np).all()


def known_over_time(start: Encounter, xp: Any, steps: int = 25) -> np.ndarray:
    state = world.begin(map_leaves(xp.asarray, start), xp)
    nothing = xp.zeros_like(start.goal_x)

    def advance(state: Any) -> Any:
        after = world.step(state, (nothing, nothing), WORLD, xp)[0]
        return after, world.known_intruders(state, PAPER, xp)

    step = jax.jit(advance) if xp is jnp else advance
    known = []
    for _ in range(steps):
        state, known_now = step(state)
        known.append(np.asarray(known_now))
    return np.array(known)


def test_numpy_and_jax_know_of_the_same(drawn: Encounter):
    single = cast(drawn, np.float32)
    ours, theirs = known_over_time(single, np), known_over_time(single, jnp)
    assert (ours == theirs).mean() > 0.999
    share = ours.sum() / (len(ours) * drawn.mask.sum())
    assert 0.2 < share < 0.95
    assert not ours[:, ~drawn.mask].any()


def test_coverage_changes_nothing_but_what_is_known(drawn: Encounter):
    nothing = np.zeros_like(drawn.goal_x)
    plain = drawn._replace(coverage=None)
    results = [
        world.step(world.begin(encounter, np), (nothing, nothing), WORLD, np)[1]
        for encounter in (drawn, plain)
    ]
    map_leaves(np.testing.assert_array_equal, *results)
    np.testing.assert_array_equal(known_over_time(plain, np)[0], drawn.mask)
    check_encounter(drawn, PAPER, drawn.goal_x.shape)


def test_what_is_not_known_changes_no_decision(drawn: Encounter):
    """The shipped policy decides alike wherever an intruder of which it knows nothing is."""
    state, policy = world.begin(drawn, np), Policy.load()
    mask = world.known_intruders(state, PAPER, np)
    perceived = world.perceive_intruders(state, None, PAPER.dt, np)
    moved = perceived._replace(x=np.where(mask, perceived.x, perceived.x + 777.0))
    action, moved_action = (
        policy.command(drawn.own, intruders, mask, drawn.goal_x, drawn.goal_y)
        for intruders in (perceived, moved)
    )
    assert (drawn.mask & ~mask).any()
    np.testing.assert_array_equal(action, moved_action)


def test_a_pool_covers_the_others_wholly(chosen: Scenario):
    pool = pool_of([scenario("circle", PAPER), chosen], [0.5, 0.5], 2, 200)
    assert pool.coverage is not None
    everything: Any = np.isinf(np.asarray(pool.coverage.reach)).all(axis=-1)
    assert everything.mean() == pytest.approx(0.5, abs=0.1)
    state = jax.jit(jax.vmap(surrogate.reset))(pool)
    first = map_leaves(lambda field: field[0], state)
    is_known = np.asarray(world.known_intruders(first, PAPER, jnp))
    np.testing.assert_array_equal(is_known[everything[0]], np.asarray(pool.mask)[0][everything[0]])


def test_who_would_know_of_all_is_refused(chosen: Scenario):
    with pytest.raises(EncounterError, match="not always reported; expected a training"):
        encounters_of_seed(chosen, 3, 0, 4)


def test_late_reports_of_what_turns_are_where_it_was_headed():
    """Dead-reckoned over their age: right for what flies straight, wrong where it has turned."""
    late = scenario("circle + turns + late", PAPER)
    start = encounters_of_seed(late, 3, 0, 200, heeds=EVERY_FIELD)
    assert start.sensor.latency.min() >= PAPER.dt
    state = world.begin(start, np, history_dt=PAPER.dt)
    nothing, noise = np.zeros_like(start.goal_x), np.zeros((4, *start.mask.shape))
    off, turned = [], []
    for _ in range(60):
        before = state.intruders.vehicle.heading
        state, _ = world.step(state, (nothing, nothing), WORLD, np)
        perceived = world.perceive_intruders(state, noise, PAPER.dt, np)
        now = state.intruders.vehicle
        off.append(np.hypot(perceived.x - now.x, perceived.y - now.y)[:, 0])
        turned.append(np.abs(now.heading - before)[:, 0] > 1e-3)
    lately = np.array(turned[2:]) | np.array(turned[1:-1])
    # What turns by less than 1e-3 rad a step at 100 m/s is 0.4 m off in two steps at most.
    assert np.array(off[2:])[~lately].max() < 0.4
    assert np.median(np.array(off[2:])[np.array(turned[2:])]) > 0.5
