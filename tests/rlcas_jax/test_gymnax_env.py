"""The surrogate under gymnax's interface: its contract, and the same states as the surrogate's own.

gymnax wants another version of Gymnasium than the rest of the tests. ``tests/test_package.py`` runs
this module in an environment of its own, together with the learner of docs/howto/gymnasium.md."""

from typing import Any

import pytest

pytest.importorskip("gymnax", reason="gymnax is not installed; to have it: pip install '.[gymnax]'")

import gymnax
import jax
import jax.numpy as jnp
import numpy as np
from gymnax.environments import spaces

from envs import surrogate
from envs.aircraft import PAPER, new_aircraft
from envs.encounters import EncounterError
from envs.kinematics import Limits
from envs.scenarios import scenario
from rlcas_jax.gymnax_env import ENV_ID, Deconfliction

UAS = new_aircraft(Limits(15.0, 30.0, -1.0, 1.0, 0.2), 300.0)
COUNT = 16


def keys(number: int) -> jax.Array:
    return jax.random.split(jax.random.key(number), COUNT)


def fly_steps(
    env: Deconfliction, params: Any, steps: int, action: tuple[float, float] = (0.0, 0.0)
) -> Any:
    """Return what each of so many steps of a batch yields, stacked over time."""

    def step(state: Any, key: jax.Array) -> Any:
        found = jax.vmap(env.step, (0, 0, None, None))(
            jax.random.split(key, COUNT), state, jnp.asarray(action), params
        )
        return found[1], found

    @jax.jit
    def whole() -> Any:
        _, state = jax.vmap(env.reset, (0, None))(keys(0), params)
        return jax.lax.scan(step, state, jax.random.split(jax.random.key(1), steps))[1]

    return whole()


def test_it_is_registered_with_its_spaces() -> None:
    env, params = gymnax.make(ENV_ID)
    assert (env.name, env.num_actions, params.max_steps_in_episode) == (ENV_ID, 2, 300)
    observation, state = jax.jit(env.reset)(jax.random.key(0), params)
    action = env.action_space(params).sample(jax.random.key(1))
    assert env.action_space(params).contains(action)
    after, _, reward, terminated, truncated, info = jax.jit(env.step)(
        jax.random.key(2), state, action, params
    )
    space = env.observation_space(params)
    for seen in (observation, after, info["final_observation"]):
        assert (seen.shape, seen.dtype) == (space.shape, np.float32)
        assert space.contains(seen)
    assert (reward.shape, terminated.dtype, truncated.dtype) == ((), bool, bool)


def test_several_intruders_are_seen_as_a_dict() -> None:
    env = Deconfliction("multi", UAS, intruders=4)
    observation, _ = jax.jit(env.reset)(jax.random.key(0))
    space = env.observation_space()
    assert isinstance(space, spaces.Dict)
    assert {name: part.shape for name, part in space.spaces.items()} == {
        name: part.shape for name, part in observation.items()
    }
    assert all(part.contains(observation[name]) for name, part in space.spaces.items())
    mask = observation["mask"].astype(bool)
    assert 1 <= mask.sum() <= 4
    assert not observation["traffic"][~mask].any()


@pytest.mark.parametrize("name", ["multi", "noisy"])
def test_an_encounter_is_flown_as_the_surrogate_flies_it(name: str) -> None:
    env = Deconfliction(name, UAS)
    params, late = env.default_params, name == "noisy"
    pool = jax.jit(lambda key: surrogate.redraw_pool(key, [env.scenario], [1.0], 1, COUNT))(
        jax.random.key(0)
    )
    starts = jax.tree.map(lambda field: field[0], pool)
    actions = jax.random.uniform(jax.random.key(1), (60, COUNT, 2), minval=-1.0, maxval=1.0)
    world = surrogate.World(UAS.rules(), UAS)

    def ours(state: Any, action: jax.Array) -> Any:
        step = jax.vmap(env.step_env, (0, 0, 0, None))
        _, state, reward, terminated, _ = step(keys(2), state, action, params)
        return state, (state.encounter, reward, terminated)

    def theirs(state: Any, action: jax.Array) -> Any:
        state, result = surrogate.step(state, (action[:, 0], action[:, 1]), world)
        return state, (state, result.reward, result.outcome.violation | result.outcome.reached)

    _, begun = jax.vmap(env.begin, (0, 0, None))(keys(2), starts, params)
    _, mine = jax.jit(lambda state: jax.lax.scan(ours, state, actions))(begun)
    begun = surrogate.reset(starts, history_dt=UAS.dt if late else None)
    _, wanted = jax.jit(lambda state: jax.lax.scan(theirs, state, actions))(begun)
    jax.tree.map(np.testing.assert_array_equal, mine, wanted)


def test_the_time_limit_truncates_and_violation_and_goal_terminate() -> None:
    env = Deconfliction(scenario("circle", UAS, radius=(900.0, 900.0)))
    params = env.default_params.replace(max_steps_in_episode=20)
    _, states, rewards, terminated, truncated, info = fly_steps(env, params, 60)
    np.testing.assert_array_equal(truncated & ~terminated, (rewards == -10.0))
    np.testing.assert_array_equal(terminated, (rewards == 100.0) | (rewards == -100.0))
    np.testing.assert_array_equal(info["violation"] | info["reached"], terminated)
    assert {-100.0, -10.0} <= set(np.unique(rewards).tolist())
    ended = terminated | truncated
    np.testing.assert_array_equal(states.time[ended], 0)  # the state is the next encounter's
    np.testing.assert_array_equal(states.encounter.steps, states.time)


def test_the_aircraft_may_differ_within_a_batch() -> None:
    env = Deconfliction("circle", UAS)
    params = env.default_params
    slower = jnp.linspace(12.0, 20.0, COUNT)
    limits = UAS.limits._replace(speed_max=slower, speed_min=0.5 * slower)
    many = params.replace(aircraft=UAS._replace(limits=limits))
    axes = jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) else None, many)
    _, state = jax.jit(jax.vmap(env.reset, (0, axes)))(keys(0), many)
    step = jax.jit(jax.vmap(env.step, (0, 0, None, axes)))
    for _ in range(40):
        _, state, *_ = step(keys(3), state, jnp.asarray((1.0, 0.0)), many)
        assert (state.encounter.own.speed <= slower + 1e-4).all()
    assert (jnp.abs(state.encounter.own.speed - slower) < 1e-4).sum() > COUNT // 2


def test_what_cannot_be_had_is_refused() -> None:
    with pytest.raises(EncounterError, match="another aircraft"):
        Deconfliction(scenario("circle", PAPER), UAS)
    with pytest.raises(EncounterError, match="intruders is 65"):
        Deconfliction(intruders=65)
    with pytest.raises(EncounterError, match="unknown"):
        Deconfliction("no_such")
