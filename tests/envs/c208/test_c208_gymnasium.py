"""The true aircraft's environment keeps Gymnasium's contract and the surrogate's observation, action and reward."""

import gymnasium
import numpy as np
import pytest
from gymnasium import error
from gymnasium.utils.env_checker import check_env

from envs.c208.conditions import Conditions
from envs.c208.gymnasium_env import ENV_ID
from envs.encounters import EncounterError
from envs.gym.gymnasium_env import DeconflictionEnv
from envs.outcome import RULES

STRAIGHT = np.zeros(2, np.float32)


def test_gymnasiums_checker_passes() -> None:
    check_env(gymnasium.make(ENV_ID).unwrapped, skip_render_check=True)


def test_it_is_the_surrogates_task_flown_with_the_aircrafts_lags() -> None:
    true, surrogate = gymnasium.make(ENV_ID), DeconflictionEnv()
    assert true.observation_space == surrogate.observation_space
    assert true.action_space == surrogate.action_space
    seen, _ = true.reset(seed=3)
    expected, _ = surrogate.reset(seed=3)
    np.testing.assert_allclose(seen, expected, atol=1e-6)
    for number in range(40):
        action = np.array([0.3, 0.8 * np.sin(number / 8.0)], np.float32)
        seen, reward, *_, info = true.step(action)
        expected, wanted, *_, other = surrogate.step(action)
        assert reward == wanted
        # A roll's lag of most of a second at 3 deg/s is two degrees of heading at most.
        assert info["goal_distance"] == pytest.approx(other["goal_distance"], abs=60.0)
        assert abs(info["altitude"] - 2500.0) < 5.0
    assert not np.allclose(seen, expected, atol=1e-6)


def test_episodes_repeat_and_end() -> None:
    def play() -> list[float]:
        env = gymnasium.make(
            ENV_ID, rules=RULES._replace(t_max=20.0), conditions=Conditions(wind_east=3.0, turbulence="light")
        )
        env.reset(seed=1)
        rows, over = [], False
        while not over:
            observation, reward, terminated, truncated, info = env.step(STRAIGHT)
            rows += [*observation.tolist(), float(reward), info["airspeed"]]
            over = terminated or truncated
        with pytest.raises(error.ResetNeeded, match="has ended"):
            env.unwrapped.step(STRAIGHT)
        return rows

    assert play() == play()


def test_misuse_is_refused_in_a_sentence() -> None:
    env = gymnasium.make(ENV_ID, conditions=Conditions(wind_east=30.0)).unwrapped
    with pytest.raises(error.ResetNeeded, match="before reset"):
        env.step(STRAIGHT)
    with pytest.raises(EncounterError, match=r"cannot be flown by the aircraft: .*no equilibrium"):
        for seed in range(20):
            env.reset(seed=seed)
    calm = gymnasium.make(ENV_ID).unwrapped
    calm.reset(seed=0)
    with pytest.raises(error.InvalidAction, match="shape"):
        calm.step(np.zeros(3, np.float32))
