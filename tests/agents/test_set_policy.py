"""The network for any number of intruders: invariances, backends, files, and the aircraft that it refuses."""

import math
from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.learning.export import SetOf, to_policy_file
from agents.learning.networks import Actor
from agents.policy import escapes
from agents.policy.domain import OutsideDomainError
from agents.policy.file import PolicyFileError, parse, serialise
from agents.policy.inference import Policy
from agents.policy.scene import scene
from agents.policy.set_features import set_inputs
from envs.aircraft import PAPER, Ratios, new_aircraft, ratios
from envs.kinematics import Limits, VehicleState, advance
from envs.observation import observe

HIDDEN, ENCODER, MOST = (48, 32), (24,), 4
FAMILY = Ratios((0.3, 0.8), (-0.5, -0.02), (0.02, 0.5), (0.2, 3.0))._asdict()
UAS = new_aircraft(Limits(18.0, 36.0, -0.5, 0.5, math.radians(10.0)), 610.0)


@cache
def content():
    actor = Actor(HIDDEN, "set", encoder=ENCODER)
    seen = set_inputs(scene(*(jax.tree.map(jnp.asarray, part) for part in states(2)), PAPER.limits, 1e3, jnp), jnp)
    shapes = jax.eval_shape(actor.init, jax.random.key(0), seen)
    rng = np.random.default_rng(3)
    weights = jax.tree.map(lambda leaf: rng.normal(0.0, 1.2 / np.sqrt(leaf.shape[0]), leaf.shape).astype("f4"), shapes)
    described = SetOf(ENCODER, MOST, PAPER, FAMILY)
    return to_policy_file(weights, HIDDEN, "set", PAPER.limits, {"seed": 0}, steps=0, of_set=described)


@cache
def policy(dtype="float32"):
    return Policy(content(), dtype)


def states(count, most=3, aircraft=PAPER):
    """Return own states, intruders, their mask and goals, alike for every aircraft of the same ratios."""
    rng, unit, fast = np.random.default_rng(5), aircraft.separation, aircraft.limits.speed_max
    shape = (count, most)
    own = VehicleState(*rng.uniform(-1, 1, (2, count)) * unit, rng.uniform(-3, 3, count), rng.uniform(0.5, 1, count))
    others = VehicleState(
        *rng.uniform(-8, 8, (2, *shape)) * unit, rng.uniform(-3, 3, shape), rng.uniform(0.5, 1, shape)
    )
    own, others = (each._replace(speed=each.speed * fast) for each in (own, others))
    return own, others, rng.random(shape) < 0.7, *rng.uniform(-9, 9, (2, count)) * unit


def rows(tree, index):
    return VehicleState(*(field[index] for field in tree))


def test_order_of_intruders_does_not_matter():
    own, others, present, *goal = states(100)
    order = [2, 0, 1]
    turned = VehicleState(*(field[:, order] for field in others))
    np.testing.assert_allclose(
        policy().command(own, turned, present[:, order], *goal),
        policy().command(own, others, present, *goal),
        atol=1e-6,
    )


def test_absent_intruders_change_nothing():
    own, others, present, *goal = states(100)
    rng = np.random.default_rng(0)
    moved = VehicleState(*(np.where(present, field, rng.uniform(-5, 5, present.shape)) for field in others))
    np.testing.assert_array_equal(
        policy().command(own, moved, present, *goal), policy().command(own, others, present, *goal)
    )


def test_mirrored_scene_gives_mirrored_action():
    own, others, present, goal_x, goal_y = states(200)
    mirror = [each._replace(y=-each.y, heading=-each.heading) for each in (own, others)]
    action = policy().command(own, others, present, goal_x, goal_y)
    np.testing.assert_allclose(policy().command(*mirror, present, goal_x, -goal_y), action * [1.0, -1.0], atol=1e-6)


def test_alike_aircraft_are_commanded_alike():
    large = new_aircraft(
        Limits(25.0, 50.0, *(0.5 * sign * 0.25 * 4.0 for sign in (-1.0, 1.0)), PAPER.limits.yaw_rate_max * 2.0), 250.0
    )
    assert ratios(large.limits, 250.0) == pytest.approx(ratios(PAPER.limits, 1000.0))
    np.testing.assert_allclose(
        policy().for_aircraft(large).command(*states(100, aircraft=large)), policy().command(*states(100)), atol=1e-4
    )


def test_one_row_has_the_same_bits_in_any_company():
    own, others, present, goal_x, goal_y = states(300)
    together = policy().command(own, others, present, goal_x, goal_y)
    for row in (0, 7, 299):
        index = slice(row, row + 1)
        alone = policy().command(rows(own, index), rows(others, index), present[index], goal_x[index], goal_y[index])
        np.testing.assert_array_equal(alone[0], together[row])
        seen = [rows(others, (row, k)) for k in np.flatnonzero(present[row])]
        one = policy().command_one(rows(own, row), seen, goal_x[row], goal_y[row])
        np.testing.assert_allclose(one, together[row], atol=1e-5)


def test_numpy_decides_as_jax_does():
    actor = Actor(HIDDEN, "set", encoder=ENCODER)
    trunk = {}
    for name, tensor in content().actor.items():
        if name != "log_std":
            trunk.setdefault(name.split("/")[0], {})[name.split("/")[1]] = tensor
    variables = {"params": {"trunk": trunk, "log_std": content().actor["log_std"]}}
    own, others, present, *goal = states(500)
    seen = set_inputs(scene(own, others, present, *goal, PAPER.limits, PAPER.separation, jnp), jnp)
    mean = np.clip(actor.apply(variables, seen)[0], -1.0, 1.0)
    difference = np.abs(policy("float64").command(own, others, present, *goal) - mean).max(axis=-1)
    assert np.quantile(difference, 0.99) < 2e-3


def test_nobody_around_is_a_scene_too():
    own, others, present, goal_x, goal_y = states(5)
    empty = policy().command(own, others, present & False, goal_x, goal_y)
    nowhere = VehicleState(*(np.zeros((5, 0)) for _ in range(4)))
    np.testing.assert_array_equal(policy().command(own, nowhere, np.zeros((5, 0), bool), goal_x, goal_y), empty)
    np.testing.assert_allclose(policy().command_one(rows(own, 0), [], goal_x[0], goal_y[0]), empty[0], atol=1e-5)


def test_paper_observation_of_one_intruder_is_its_scene():
    own, others, _, goal_x, goal_y = states(100, most=1)
    observation = observe(own, VehicleState(*(field[:, 0] for field in others)), goal_x, goal_y, PAPER, np)
    np.testing.assert_allclose(
        policy()(observation), policy().command(own, others, np.ones((100, 1), bool), goal_x, goal_y), atol=2e-3
    )


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"yaw_rate_max": math.radians(1.0)}, "turn_radius"),
        ({"acceleration_max": 5.0}, "acceleration_max"),
        ({"speed_min": 5.0}, "speed_min"),
    ],
)
def test_aircraft_outside_the_family_is_refused(changes, name):
    other = new_aircraft(UAS.limits._replace(**changes), UAS.separation)
    with pytest.raises(OutsideDomainError, match=f"outside_domain: {name} is "):
        policy().for_aircraft(other)
    assert policy().for_aircraft(other, outside="allow").aircraft == other
    assert policy().for_aircraft(UAS).limits == UAS.limits


def test_file_comes_back_whole_and_an_edit_is_refused():
    again = parse(serialise(content()), "p")
    assert again.metadata == content().metadata
    assert (again.aircraft, again.hidden, again.feature_set) == (PAPER, HIDDEN, "set")
    for path, value in (("intruders", 0), ("encoder", []), ("hidden", [3, 3])):
        document = content().metadata | {"architecture": content().metadata["architecture"] | {path: value}}
        with pytest.raises(PolicyFileError):
            serialise(replace(content(), metadata=document))
    wrong = content().metadata | {"family": content().metadata["family"] | {"speed_min": [0.9, 0.1]}}
    with pytest.raises(PolicyFileError, match=r"family\.speed_min"):
        serialise(replace(content(), metadata=wrong))


@pytest.mark.parametrize("number", [0, 5, 9, 15, 16, 17, 18])
@pytest.mark.parametrize("aircraft", [PAPER, UAS])
def test_kept_separation_is_that_of_the_manoeuvre_as_flown(number, aircraft):
    own, others, present, *goal = states(300, aircraft=aircraft)
    kept = escapes.kept(scene(own, others, present, *goal, aircraft.limits, aircraft.separation, np), np)[number]
    turn, throttle = escapes.TURNS[number], escapes.THROTTLES[number]
    limits, steps = aircraft.limits, 1000
    dt = escapes.HORIZON * aircraft.time_unit / steps
    rate = throttle * (limits.acceleration_max if throttle > 0 else -limits.acceleration_min)
    vx, vy = others.speed * np.cos(others.heading), others.speed * np.sin(others.heading)
    least = np.full(300, np.inf)
    for step in range(steps):
        left = abs(turn) - step * dt * limits.yaw_rate_max
        yaw_rate = math.copysign(min(limits.yaw_rate_max, max(left / dt, 0.0)), turn)
        own = advance(own, np.full(300, rate), np.full(300, yaw_rate), dt, limits, np)
        time = (step + 1) * dt
        away = np.hypot(others.x + vx * time - own.x[:, None], others.y + vy * time - own.y[:, None])
        least = np.minimum(least, np.where(present, away, np.inf).min(axis=-1))
    near = least < 1.5 * aircraft.separation
    assert near.sum() > 30
    assert np.abs(kept - least / aircraft.separation)[near].max() < 0.08
