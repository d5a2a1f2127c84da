"""How soon the goal can be reached past an intruder, and who comes later than that."""

import jax
import jax.numpy as jnp
import numpy as np

from envs.encounters import sample, scenario
from envs.kinematics import SURROGATE, VehicleState, advance, commands
from envs.relative import bearing, distance, leg_separation
from rlcas_jax.homeward import arrival_of, late, soonest, ways

FAR = 1e5
HOME = 480.0
"""Distance at which a way is home, m."""

Scene = tuple[VehicleState, jax.Array, jax.Array, VehicleState]


def scenes(count: int, name: str = "same_course") -> Scene:
    """Return starts of a scenario, ``[count]``."""
    family = scenario(name, attempts=8)
    starts, accepted = sample(family, np.random.default_rng(3).random((8, 2 * count, family.dimensions)), np)
    rows = np.flatnonzero(accepted)[:count]
    own = VehicleState(*(jnp.asarray(field[rows], jnp.float32) for field in starts.own))
    other = VehicleState(*(jnp.asarray(field[rows, 0], jnp.float32) for field in starts.intruders))
    return own, jnp.asarray(starts.goal_x[rows], jnp.float32), jnp.asarray(starts.goal_y[rows], jnp.float32), other


def nobody(count: int) -> VehicleState:
    return VehicleState(*(jnp.full(count, value, jnp.float32) for value in (FAR, FAR, 0.0, 50.0)))


def homing(observation: jax.Array) -> jax.Array:
    """Return the actions of who turns to the goal at full throttle."""
    turn = jnp.clip(observation[:, 6] * (jnp.pi / SURROGATE.yaw_rate_max), -1.0, 1.0)
    return jnp.stack([jnp.ones_like(turn), turn], axis=-1)


def test_with_nobody_in_the_way_the_soonest_is_the_turn_to_the_goal_at_full_throttle_and_is_not_late() -> None:
    own, goal_x, goal_y, _ = scenes(50)
    arrival, begins = soonest(own, goal_x, goal_y, nobody(50), jnp.tile(jnp.array([1.0, 0.0]), (50, 1)))
    flown = arrival_of(homing, own, goal_x, goal_y, nobody(50), 300)
    # The policy is home 20 m earlier, and at a whole second.
    np.testing.assert_allclose(arrival, flown, atol=1.5)
    assert np.all(np.asarray(begins)[:, 0] == 1.0)
    # Who is slow is late, too.
    ahead = (np.abs(np.asarray(bearing(own, goal_x, goal_y, np))) < 0.1) & (np.asarray(own.speed) > 75.0)
    assert ahead.sum() > 10
    assert not np.asarray(late(arrival, distance(goal_x - own.x, goal_y - own.y, jnp)))[ahead].any()


def test_each_way_that_is_said_to_be_safe_arrives_then_and_keeps_the_separation() -> None:
    """Flown in steps of a fifth of a second, by who does in each what the definition of the way says."""
    count, dt = 150, 0.2
    own, goal_x, goal_y, other = scenes(count)
    found = np.asarray(ways(own, goal_x, goal_y, other).arrival)
    # Ways of whole whiles only: in between, what is kept is interpolated.
    whole = found.reshape(15, 15, count)[:, :8].reshape(-1, count)
    best = whole.argmin(axis=0)
    kind, span = np.divmod(best, 8)
    begin, end = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])[kind % 3].T
    until = np.array([0.0, 4.0, 8.0, 14.0, 22.0, 32.0, 46.0, 66.0])[span]
    aside = np.radians([0.0, 30.0, -30.0])
    own, other = (VehicleState(*(np.asarray(field, float) for field in craft)) for craft in (own, other))
    goal_x, goal_y = np.asarray(goal_x), np.asarray(goal_y)
    course = np.choose(kind // 3, [own.heading, own.heading, *(other.heading + angle for angle in aside)])
    start = distance(other.x - own.x, other.y - own.y, np)
    least, arrival = np.full(count, np.inf), np.full(count, np.inf)
    for step in range(1_300):
        homeward = bearing(own, goal_x, goal_y, np)
        apart = np.mod(course - own.heading + np.pi, 2.0 * np.pi) - np.pi
        early = step * dt < until
        angle = np.where(early & (kind >= 3), apart, homeward)
        action = np.where(early, begin, end), np.clip(angle / (dt * SURROGATE.yaw_rate_max), -1.0, 1.0)
        there = advance(own, *commands(action, SURROGATE, np), dt, SURROGATE, np)
        beyond = advance(other, 0.0, 0.0, dt, SURROGATE, np)
        flies = np.isinf(arrival)
        least = np.where(flies, np.minimum(least, leg_separation(own, there, other, beyond, dt, np)), least)
        own, other = there, beyond
        home = distance(goal_x - own.x, goal_y - own.y, np) <= HOME
        arrival = np.where(flies & home, (step + 1) * dt, arrival)
    said = whole[best, np.arange(count)]
    safe = np.isfinite(said)
    assert safe.mean() > 0.9
    np.testing.assert_allclose(arrival[safe], said[safe], atol=2.0)
    assert (least - np.clip(start - 0.5, 1_000.0, 1_015.0))[safe].min() > -15.0  # a piece is 2 s of a turn


def test_the_soonest_way_of_a_mirrored_scene_is_its_mirror_image() -> None:
    own, goal_x, goal_y, other = scenes(300)
    does = jnp.asarray(np.random.default_rng(4).uniform(-1.0, 1.0, (300, 2)), jnp.float32)
    arrival, begins = soonest(own, goal_x, goal_y, other, does)
    own, other = (craft._replace(y=-craft.y, heading=-craft.heading) for craft in (own, other))
    mirrored, likewise = soonest(own, goal_x, -goal_y, other, does * jnp.array([1.0, -1.0]))
    same = np.isclose(arrival, mirrored, atol=0.05)
    assert same.mean() > 0.98  # what is just safe may be just unsafe
    alike = np.isclose(begins, np.asarray(likewise) * [1.0, -1.0], atol=1e-3).all(axis=1)
    assert (same & alike).mean() > 0.97


def test_of_ways_that_are_as_soon_it_is_the_one_that_begins_as_the_policy_does() -> None:
    own = VehicleState(*(jnp.array([value] * 2, jnp.float32) for value in (0.0, 0.0, 0.0, 75.0)))
    goal = jnp.array([9_000.0] * 2), jnp.zeros(2)
    ahead = VehicleState(*(jnp.array([value] * 2, jnp.float32) for value in (2_000.0, 0.0, 0.0, 50.0)))
    _, begins = soonest(own, *goal, ahead, jnp.array([[1.0, 1.0], [1.0, -1.0]]))
    assert np.asarray(begins)[0, 1] > 0.0 > np.asarray(begins)[1, 1]


def test_who_begins_the_soonest_way_each_second_as_much_as_he_likes_to_fly_on_does_arrive() -> None:
    """To fly on for another while is never as good: who may put off the turn now may put it off for ever."""
    count = 200
    own, goal_x, goal_y, other = scenes(count)
    first, _ = soonest(own, goal_x, goal_y, other, jnp.zeros((count, 2)))
    asked = np.isfinite(np.asarray(first))
    assert asked.mean() > 0.9
    second = jax.jit(
        lambda own, other: soonest(own, goal_x, goal_y, other, jnp.zeros((count, 2)))[1]
    )  # who would rather do nothing
    arrival = np.full(count, np.inf)
    for time in range(240):
        begins = second(own, other)
        own = advance(own, *commands((begins[:, 0], begins[:, 1]), SURROGATE, jnp), 1.0, SURROGATE, jnp)
        other = advance(other, 0.0, 0.0, 1.0, SURROGATE, jnp)
        home = np.asarray(distance(goal_x - own.x, goal_y - own.y, jnp)) < 500.0
        arrival = np.where(np.isinf(arrival) & home, time + 1.0, arrival)
    assert (arrival[asked] - np.asarray(first)[asked]).max() < 60.0


def test_who_never_gets_there_has_no_arrival() -> None:
    own, goal_x, goal_y, other = scenes(5)
    never = arrival_of(lambda seen: jnp.tile(jnp.array([1.0, 1.0]), (len(seen), 1)), own, goal_x, goal_y, other, 120)
    assert np.isinf(np.asarray(never)).all()


def test_the_side_that_is_nearer_is_the_sooner_one() -> None:
    """Ahead flies a slow intruder, and one is aside of its line: to pass it there is never much later."""
    offset = jnp.array([-300.0, -150.0, 150.0, 300.0], jnp.float32)
    still = jnp.zeros_like(offset)
    own = VehicleState(still, offset, still, still + 75.0)
    for gap in np.arange(1_600.0, 2_600.0, 100.0):
        ahead = VehicleState(still + float(gap), still, still, still + 50.0)
        found = ways(own, still + 9_000.0, still, ahead)
        nearer, farther = (
            np.asarray(jnp.min(jnp.where(jnp.sign(found.turn) * side * offset > 0.0, found.arrival, jnp.inf), axis=0))
            for side in (1.0, -1.0)
        )
        assert np.isfinite(nearer).all()
        assert (nearer < farther + 0.5).all()
