"""An actor becomes a policy file whose expected actions are flax's own, for one intruder and for
any number of them.
"""

import math
from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.learning.export import parity_observations, to_policy_file
from agents.learning.networks import Actor, Critic
from agents.policy import candidate_manoeuvres, inference
from agents.policy.candidate_manoeuvres import min_separation
from agents.policy.domain import OutsideDomainError, departures, excess
from agents.policy.file import PolicyFileError, parse, read, serialise, write
from agents.policy.inference import Policy
from agents.policy.scene import scene
from agents.policy.schema import ACTION, OBSERVATION, SetOf, new_metadata
from agents.policy.set_features import set_inputs
from envs.aircraft import PAPER, Ratios, Vertical, new_aircraft, ratios
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits, VehicleState, advance, commands
from envs.observation import criticality, decode, observe
from envs.trees import column
from tests.agents.policies import random_policy, random_weights

HIDDEN = (16, 8)


def make_actor(hidden=HIDDEN, feature_set="mirror", module=Actor):
    """Return parameters, free to be changed, of an actor."""
    return random_weights(module(hidden, feature_set), jnp.zeros((1, 8)))


def description(**changes):
    described = {
        "hidden": HIDDEN,
        "feature_set": "mirror",
        "limits": SURROGATE,
        "config": {"ppo": {"epochs": 4}, "widths": (1, 2)},
        "steps": 7,
    }
    return new_metadata(**described | changes)


@pytest.mark.parametrize(
    ("hidden", "feature_set"),
    [
        (HIDDEN, "mirror"),
        ((12,), "none"),
    ],
)
def test_written_policy_decides_as_flax(tmp_path, hidden, feature_set):
    variables = make_actor(hidden, feature_set)
    path = tmp_path / "p.safetensors"
    described = description(hidden=hidden, feature_set=feature_set, score=3)
    written = to_policy_file(jax.tree.map(jnp.asarray, variables), described)
    write(path, written)
    assert read(path).sha256 == written.sha256
    policy = Policy.load(path)
    observation = np.random.default_rng(0).uniform(-1, 1, (500, 8)).astype(np.float32)
    mean, log_std = jax.jit(Actor(hidden, feature_set).apply)(variables, observation)
    np.testing.assert_allclose(policy(observation), np.clip(mean, -1, 1), atol=2e-5)
    np.testing.assert_array_equal(written.actor["log_std"], log_std)


def test_metadata(tmp_path):
    path = tmp_path / "p.safetensors"
    write(
        path,
        to_policy_file(
            make_actor(), description(limits=C208_PUBLISHED, score=-1.5, notes="a note")
        ),
    )
    metadata = read(path).metadata
    assert read(path).limits == C208_PUBLISHED
    assert metadata["architecture"] == {
        "hidden": [16, 8],
        "activation": "tanh",
        "feature_set": "mirror",
        "output": "clip",
    }
    training = metadata["training"]
    assert (training["config"], training["steps"], training["score"]) == (
        {"ppo": {"epochs": 4}, "widths": [1, 2]},
        7,
        -1.5,
    )
    assert metadata["versions"]["jax"] == jax.__version__
    assert metadata["notes"] == "a note"


def test_parity_vectors():
    observation = parity_observations()
    assert observation.dtype == np.float32
    assert observation.shape == (64 + 16, 8)
    np.testing.assert_array_equal(observation, parity_observations())
    assert (observation.min(0) == -1.0).all()
    assert (observation.max(0) == 1.0).all()
    content = to_policy_file(make_actor(), description())
    np.testing.assert_array_equal(content.parity_observation, observation)
    mean, _ = jax.jit(Actor(HIDDEN, "mirror").apply)(make_actor(), observation)
    np.testing.assert_allclose(content.parity_action, np.clip(mean, -1, 1), atol=2e-5)
    # Clipped answers would hide a wrong network, and so would tiny ones.
    assert (np.abs(content.parity_action) < 1.0).mean() > 0.5
    assert content.parity_action.std() > 0.05


def test_equal_actors_give_equal_files(tmp_path):
    for name in ("a", "b"):
        write(tmp_path / name, to_policy_file(make_actor(), description()))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_double_precision_is_left_as_it_was():
    to_policy_file(make_actor(), description())
    assert jnp.zeros(1).dtype == jnp.float32


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["hidden_1", "log_std"])
def test_diverged_parameters_are_refused(bad, where):
    variables = make_actor()
    if where == "log_std":
        variables["params"]["log_std"][1] = bad
    else:
        variables["params"]["trunk"][where]["kernel"][2, 3] = bad
    with pytest.raises(PolicyFileError, match=rf"parameter {where}.* is not finite"):
        to_policy_file(variables, description())


@pytest.mark.parametrize(
    ("variables", "changes", "message"),
    [
        (lambda: make_actor(module=Critic), {}, "not those of agents.learning.networks.Actor"),
        (dict, {}, "not those of agents.learning.networks.Actor"),
        (lambda: make_actor()["params"], {}, "not those of agents.learning.networks.Actor"),
        (
            make_actor,
            {"hidden": (16, 9)},
            r"tensor actor/hidden_1/kernel has shape \[16, 8\], expected \[16, 9\]",
        ),
        (make_actor, {"hidden": (16,)}, "tensor 'actor/hidden_1/bias' is unexpected"),
        (make_actor, {"hidden": (16, 8, 4)}, "tensor 'actor/hidden_2/bias' is missing"),
        (make_actor, {"feature_set": "none"}, r"shape \[22, 16\], expected \[8, 16\]"),
        (make_actor, {"feature_set": "magic"}, "feature_set is 'magic'"),
        (make_actor, {"score": float("nan")}, "metadata cannot be written as JSON"),
        (make_actor, {"steps": -1}, "steps is -1"),
        (make_actor, {"config": {"a": np.zeros(2)}}, "metadata cannot be written as JSON"),
    ],
)
def test_what_cannot_be_exported(variables, changes, message):
    with pytest.raises(PolicyFileError, match=message):
        to_policy_file(variables(), description(**changes))


# The network for any number of intruders: invariances, backends, files, and the aircraft that it
# refuses.
LAYERS, ENCODER, MOST = (48, 32), (24,), 4
PLACES = ("x", "y", "vx", "vy")
FAMILY = Ratios((0.3, 0.8), (-0.5, -0.02), (0.02, 0.5), (0.2, 3.0))._asdict()
UAS = new_aircraft(Limits(18.0, 36.0, -0.5, 0.5, math.radians(10.0)), 610.0)


@cache
def content():
    return random_policy(LAYERS, "set", SetOf(ENCODER, MOST, PAPER, FAMILY), spread=1.2)


@cache
def policy(dtype="float32"):
    return Policy(content(), dtype)


def states(count, most=3, aircraft=PAPER):
    """Return own states, intruders, their mask and goals, alike for every aircraft of the same
    ratios.
    """
    rng, unit, fast = np.random.default_rng(5), aircraft.separation, aircraft.limits.speed_max
    shape = (count, most)
    own = VehicleState(
        *rng.uniform(-1, 1, (2, count)) * unit,
        rng.uniform(-3, 3, count),
        rng.uniform(0.5, 1, count),
    )
    intruders = VehicleState(
        *rng.uniform(-8, 8, (2, *shape)) * unit,
        rng.uniform(-3, 3, shape),
        rng.uniform(0.5, 1, shape),
    )
    own, intruders = (state._replace(speed=state.speed * fast) for state in (own, intruders))
    return own, intruders, rng.random(shape) < 0.7, *rng.uniform(-9, 9, (2, count)) * unit


def rows(tree, index):
    return VehicleState(*(field[index] for field in tree))


def test_order_of_intruders_does_not_matter():
    own, intruders, mask, *goal = states(100)
    order = [2, 0, 1]
    turned = VehicleState(*(field[:, order] for field in intruders))
    np.testing.assert_allclose(
        policy().command(own, turned, mask[:, order], *goal),
        policy().command(own, intruders, mask, *goal),
        atol=1e-6,
    )


def test_absent_intruders_change_nothing():
    own, intruders, mask, *goal = states(100)
    rng = np.random.default_rng(0)
    moved = VehicleState(
        *(np.where(mask, field, rng.uniform(-5, 5, mask.shape)) for field in intruders)
    )
    np.testing.assert_array_equal(
        policy().command(own, moved, mask, *goal), policy().command(own, intruders, mask, *goal)
    )


def test_mirrored_scene_gives_mirrored_action():
    own, intruders, mask, goal_x, goal_y = states(200)
    mirror = [state._replace(y=-state.y, heading=-state.heading) for state in (own, intruders)]
    action = policy().command(own, intruders, mask, goal_x, goal_y)
    np.testing.assert_allclose(
        policy().command(*mirror, mask, goal_x, -goal_y), action * [1.0, -1.0], atol=1e-6
    )


def test_alike_aircraft_are_commanded_alike():
    large = new_aircraft(
        Limits(
            25.0,
            50.0,
            *(0.5 * sign * 0.25 * 4.0 for sign in (-1.0, 1.0)),
            PAPER.limits.yaw_rate_max * 2.0,
        ),
        250.0,
    )
    assert ratios(large.limits, 250.0) == pytest.approx(ratios(PAPER.limits, 1000.0))
    np.testing.assert_allclose(
        policy().for_aircraft(large).command(*states(100, aircraft=large)),
        policy().command(*states(100)),
        atol=1e-4,
    )


def test_one_row_has_the_same_bits_in_any_company():
    own, intruders, mask, goal_x, goal_y = states(300)
    together = policy().command(own, intruders, mask, goal_x, goal_y)
    for row in (0, 7, 299):
        index = slice(row, row + 1)
        alone = policy().command(
            rows(own, index), rows(intruders, index), mask[index], goal_x[index], goal_y[index]
        )
        np.testing.assert_array_equal(alone[0], together[row])
        present = [rows(intruders, (row, k)) for k in np.flatnonzero(mask[row])]
        action = policy().command_one(rows(own, row), present, goal_x[row], goal_y[row])
        np.testing.assert_allclose(action, together[row], atol=1e-5)


def test_numpy_decides_as_jax_does():
    actor = Actor(LAYERS, "set", encoder=ENCODER)
    trunk = {}
    for name, tensor in content().actor.items():
        if name != "log_std":
            trunk.setdefault(name.split("/")[0], {})[name.split("/")[1]] = tensor
    variables = {"params": {"trunk": trunk, "log_std": content().actor["log_std"]}}
    own, intruders, mask, *goal = states(500)

    @jax.jit
    def decide(own, intruders, mask, goal):
        surroundings = scene(own, intruders, mask, *goal, PAPER.limits, PAPER.separation, jnp)
        return actor.apply(variables, set_inputs(surroundings, jnp))[0]

    mean = np.clip(decide(own, intruders, mask, goal), -1.0, 1.0)
    difference = np.abs(policy("float64").command(own, intruders, mask, *goal) - mean).max(axis=-1)
    assert np.quantile(difference, 0.99) < 2e-3


def own_shares(mask):
    """Return the usual separation over one between 0.3 and 3 times it of each intruder."""
    return np.exp(np.random.default_rng(8).uniform(-1.1, 1.2, mask.shape))


def test_intruders_of_the_usual_separation_need_no_share():
    own, intruders, mask, *goal = states(100)
    np.testing.assert_array_equal(
        policy().command(own, intruders, mask, *goal, np.ones(mask.shape)),
        policy().command(own, intruders, mask, *goal),
    )


@pytest.mark.slow
def test_own_separations_are_seen_alike_by_numpy_jax_and_plain_floats():
    own, intruders, mask, *goal = states(300)
    distance_scale = own_shares(mask)
    where = (PAPER.limits, PAPER.separation)
    surroundings = scene(own, intruders, mask, *goal, *where, np)._replace(
        distance_scale=distance_scale
    )
    ours = set_inputs(surroundings, np)
    theirs = jax.jit(partial(set_inputs, xp=jnp))(surroundings)
    for name in ("own", "traffic"):
        present = mask if name == "traffic" else slice(None)
        apart = np.abs(getattr(ours, name) - getattr(theirs, name))[present]
        assert np.quantile(apart, 0.999) < 2e-3
    together = policy("float64").command(own, intruders, mask, *goal, distance_scale)
    assert (np.abs(together - policy("float64").command(own, intruders, mask, *goal)) > 0.01).any()
    for row in range(50):
        present = np.flatnonzero(mask[row])
        alone = policy("float64").command_one(
            rows(own, row),
            [rows(intruders, (row, k)) for k in present],
            goal[0][row],
            goal[1][row],
            distance_scale[row, present].tolist(),
        )
        np.testing.assert_allclose(alone, together[row], atol=1e-5)


def test_own_separations_do_not_break_the_symmetries():
    own, intruders, mask, goal_x, goal_y = states(200)
    distance_scale, order = own_shares(mask), [2, 0, 1]
    action = policy().command(own, intruders, mask, goal_x, goal_y, distance_scale)
    turned = VehicleState(*(field[:, order] for field in intruders))
    np.testing.assert_allclose(
        policy().command(own, turned, mask[:, order], goal_x, goal_y, distance_scale[:, order]),
        action,
        atol=1e-6,
    )
    mirror = [state._replace(y=-state.y, heading=-state.heading) for state in (own, intruders)]
    np.testing.assert_allclose(
        policy().command(*mirror, mask, goal_x, -goal_y, distance_scale),
        action * [1.0, -1.0],
        atol=1e-6,
    )


def test_a_manoeuvre_keeps_the_least_of_what_it_keeps_from_each():
    own, intruders, mask, *goal = states(100)
    surroundings = scene(own, intruders, mask, *goal, PAPER.limits, PAPER.separation, np)
    distance_scale = own_shares(mask)
    distances = [
        min_separation(
            surroundings._replace(**{n: getattr(surroundings, n)[:, k : k + 1] for n in PLACES}), np
        )
        for k in range(mask.shape[1])
    ]
    expected = np.min(
        [distance * distance_scale[:, k] for k, distance in enumerate(distances)], axis=0
    )
    least = min_separation(surroundings._replace(distance_scale=distance_scale), np)
    np.testing.assert_allclose(least, expected, rtol=1e-12)


def test_nobody_around_is_a_scene_too():
    own, intruders, mask, goal_x, goal_y = states(5)
    empty = policy().command(own, intruders, mask & False, goal_x, goal_y)
    nowhere = VehicleState(*(np.zeros((5, 0)) for _ in range(4)))
    np.testing.assert_array_equal(
        policy().command(own, nowhere, np.zeros((5, 0), bool), goal_x, goal_y), empty
    )
    np.testing.assert_allclose(
        policy().command_one(rows(own, 0), [], goal_x[0], goal_y[0]), empty[0], atol=1e-5
    )


def test_paper_observation_of_one_intruder_is_its_scene():
    own, intruders, _, goal_x, goal_y = states(100, most=1)
    observation = observe(
        own, VehicleState(*(field[:, 0] for field in intruders)), goal_x, goal_y, PAPER, np
    )
    np.testing.assert_allclose(
        policy()(observation),
        policy().command(own, intruders, np.ones((100, 1), bool), goal_x, goal_y),
        atol=2e-3,
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
    outsider = new_aircraft(UAS.limits._replace(**changes), UAS.separation)
    with pytest.raises(OutsideDomainError, match=f"outside_domain: {name} is "):
        policy().for_aircraft(outsider)
    assert policy().for_aircraft(outsider, outside="allow").aircraft == outsider
    assert policy().for_aircraft(UAS).limits == UAS.limits


def test_traffic_outside_the_domain_is_said_by_quantity():
    allowed = policy().for_aircraft(UAS).domain
    fast = UAS.limits.speed_max
    inside = {"intruders": [1], "intruder_speed": [0.4 * fast, 1.3 * fast]}
    assert not departures(allowed, inside | {"latency": []})
    found_departures = departures(
        allowed, {"intruder_speed": [0.1 * fast, fast, 1.4 * fast], "intruders": [40]}
    )
    assert [departure.quantity for departure in found_departures] == ["intruder_speed", "intruders"]
    assert (
        f" {0.1 * fast:.4g} m/s; expected {0.4 * fast:.4g} to {1.3 * fast:.4g} m/s"
        in found_departures[0].text
    )
    assert excess((40.0, 130.0), np.array([30.0, 40.0, 131.2, 131.4])).tolist() == pytest.approx(
        [10.0, 0.0, 0.0, 1.4]
    )


def test_more_intruders_than_in_training_are_refused():
    own, intruders, mask, *goal = states(2, most=policy().most + 1)
    policy().command(
        own, intruders, mask & (np.arange(policy().most + 1) > 0), *goal
    )  # an absent one does not count
    with pytest.raises(
        OutsideDomainError,
        match=f"there are {policy().most + 1} intruders; expected {policy().most} at",
    ):
        policy().command(own, intruders, mask | True, *goal)
    crowd = [rows(intruders, (0, k)) for k in range(policy().most + 1)]
    with pytest.raises(OutsideDomainError, match="outside_domain"):
        policy().command_one(rows(own, 0), crowd, goal[0][0], goal[1][0])
    allowed = policy().for_aircraft(PAPER, outside="allow")
    action = allowed.command_one(rows(own, 0), crowd, goal[0][0], goal[1][0])
    np.testing.assert_allclose(
        action, allowed.command(own, intruders, mask | True, *goal)[0], atol=1e-5
    )
    # Allowed, it looks at as many as in training: the least urgent does not count.
    order = np.argsort(criticality(column(own), intruders, PAPER, np), axis=-1)[:, :-1]
    most_urgent = VehicleState(*(np.take_along_axis(field, order, axis=-1) for field in intruders))
    np.testing.assert_array_equal(
        policy().command(own, most_urgent, np.ones(order.shape, bool), *goal),
        allowed.command(own, intruders, mask | True, *goal),
    )


def test_file_comes_back_whole_and_an_edit_is_refused():
    again = parse(serialise(content()), "p")
    assert again.metadata == content().metadata
    assert (again.aircraft, again.hidden, again.feature_set) == (PAPER, LAYERS, "set")
    for path, value in (("intruders", 0), ("encoder", []), ("hidden", [3, 3])):
        document = content().metadata | {
            "architecture": content().metadata["architecture"] | {path: value}
        }
        with pytest.raises(PolicyFileError):
            serialise(replace(content(), metadata=document))
    wrong = content().metadata | {
        "family": content().metadata["family"] | {"speed_min": [0.9, 0.1]}
    }
    with pytest.raises(PolicyFileError, match=r"family\.speed_min"):
        serialise(replace(content(), metadata=wrong))


def test_climbs_are_no_part_of_a_policy():
    climbing = UAS._replace(vertical=Vertical(5.0, 5.0, 1.0, 76.2))
    files = []
    for aircraft in (UAS, climbing):
        described = SetOf(ENCODER, MOST, aircraft, FAMILY)
        metadata = new_metadata(LAYERS, "set", UAS.limits, {"seed": 0}, steps=0, of_set=described)
        files.append(serialise(replace(content(), metadata=metadata)))
    assert files[0] == files[1]
    assert parse(files[0], "p").aircraft == UAS

    flat, steep = (policy().for_aircraft(aircraft) for aircraft in (UAS, climbing))
    assert steep.aircraft == climbing and steep.domain == flat.domain
    scenes = states(100, aircraft=UAS)
    np.testing.assert_array_equal(steep.command(*scenes), flat.command(*scenes))


@pytest.mark.parametrize("number", [0, 5, 9, 15, 16, 17, 18])
@pytest.mark.parametrize("aircraft", [PAPER, UAS])
def test_kept_separation_is_that_of_the_manoeuvre_as_flown(number, aircraft):
    own, intruders, mask, *goal = states(300, aircraft=aircraft)
    expected = candidate_manoeuvres.min_separation(
        scene(own, intruders, mask, *goal, aircraft.limits, aircraft.separation, np), np
    )[number]
    turn, throttle = candidate_manoeuvres.TURNS[number], candidate_manoeuvres.THROTTLES[number]
    limits, steps = aircraft.limits, 1000
    dt = candidate_manoeuvres.HORIZON * aircraft.time_unit / steps
    rate = throttle * (limits.acceleration_max if throttle > 0 else -limits.acceleration_min)
    vx, vy = (
        intruders.speed * np.cos(intruders.heading),
        intruders.speed * np.sin(intruders.heading),
    )
    least = np.full(300, np.inf)
    for step in range(steps):
        remaining_turn = abs(turn) - step * dt * limits.yaw_rate_max
        yaw_rate = math.copysign(min(limits.yaw_rate_max, max(remaining_turn / dt, 0.0)), turn)
        own = advance(own, np.full(300, rate), np.full(300, yaw_rate), dt, limits, np)
        time = (step + 1) * dt
        away = np.hypot(
            intruders.x + vx * time - own.x[:, None], intruders.y + vy * time - own.y[:, None]
        )
        least = np.minimum(least, np.where(mask, away, np.inf).min(axis=-1))
    near = least < 1.5 * aircraft.separation
    assert near.sum() > 30
    assert np.abs(expected - least / aircraft.separation)[near].max() < 0.08


def test_the_contract_says_what_the_world_does():
    """The scaling that is written into files is that of ``envs.observation``."""
    middle, half = np.array(OBSERVATION["middle"]), np.array(OBSERVATION["half_range"])
    own, intruder = VehicleState(0.0, 0.0, 0.5, 80.0), VehicleState(3000.0, 4000.0, -1.5, 60.0)
    observation = observe(own, intruder, 0.0, -7000.0, PAPER, np)
    quantities = [80.0, 0.5, 60.0, -1.5, np.arctan2(4, 3) - 0.5, 5000.0, -np.pi / 2 - 0.5, 7000.0]
    np.testing.assert_allclose(observation * half + middle, quantities, atol=1e-6)
    geometry = decode(observation, PAPER, np)
    assert geometry.own_speed == pytest.approx(80.0)
    assert ACTION["names"] == ["acceleration", "yaw_rate"]
    assert commands((1.0, 1.0), SURROGATE, np) == (
        SURROGATE.acceleration_max,
        SURROGATE.yaw_rate_max,
    )


def test_shipped_policy_that_is_absent_is_said_so(monkeypatch):
    monkeypatch.setattr(inference, "_SHIPPED", "data/absent.safetensors")
    with pytest.raises(
        PolicyFileError, match=r"agents/data/absent\.safetensors: .*ships no policy"
    ):
        Policy.load()
