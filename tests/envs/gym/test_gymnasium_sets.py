"""Observations of several intruders in Gymnasium, of any aircraft: a Dict space that a peer's learner trains on."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from envs import starts
from envs.aircraft import PAPER, Aircraft, new_aircraft
from envs.encounters import EncounterError, scenario
from envs.gym.gymnasium_env import ENV_ID, DeconflictionEnv
from envs.gym.gymnasium_vector import DeconflictionVectorEnv
from envs.kinematics import Limits
from envs.observation import criticality

UAS = new_aircraft(Limits(18.0, 36.0, -0.5, 0.5, np.radians(10.0)), 610.0)
BOTH = pytest.mark.parametrize(
    "make", [DeconflictionEnv, lambda *of, **options: DeconflictionVectorEnv(2, *of, **options)]
)


@pytest.mark.parametrize(("aircraft", "intruders"), [(UAS, 1), (UAS, 4), (PAPER, 12)])
def test_the_environment_passes_gymnasiums_own_check(aircraft: Aircraft, intruders: int) -> None:
    env = gymnasium.make(f"envs.gym.gymnasium_env:{ENV_ID}", scenario="multi", aircraft=aircraft, intruders=intruders)
    check_env(env.unwrapped, skip_render_check=True)


def test_the_most_critical_come_first_and_absent_ones_last() -> None:
    env = DeconflictionEnv("multi", intruders=10)
    for number in range(6):
        seen, _ = env.reset(seed=3, options={"encounter": number})
        start = starts.numbered(scenario("multi", PAPER), 3, number, 1)
        rank = criticality(type(start.own)(*(field[:, None] for field in start.own)), start.intruders, PAPER, np)[0]
        order = np.argsort(rank[start.mask[0]])
        present = len(order)
        assert seen["mask"].tolist() == [1] * present + [0] * (10 - present)
        np.testing.assert_allclose(
            seen["traffic"][:present, 0], start.intruders.speed[0, order] / 75.0 - 1.0, atol=1e-6
        )
        assert not seen["traffic"][present:].any()
        few, _ = DeconflictionEnv("multi", intruders=2).reset(seed=3, options={"encounter": number})
        np.testing.assert_array_equal(few["traffic"], seen["traffic"][:2])
        one, _ = DeconflictionEnv("multi").reset(seed=3, options={"encounter": number})
        np.testing.assert_array_equal(one[[2, 3, 4, 5]], seen["traffic"][0])
        np.testing.assert_array_equal(one[[0, 1, 6, 7]], seen["own"])


def test_vector_and_single_environment_agree() -> None:
    how: dict[str, Any] = {"scenario": "multi", "aircraft": UAS, "intruders": 3}
    many, singles = DeconflictionVectorEnv(3, **how), [DeconflictionEnv(**how) for _ in range(3)]
    assert many.single_observation_space == singles[0].observation_space
    seen, _ = many.reset(seed=5)
    alone = [env.reset(seed=5, options={"encounter": i})[0] for i, env in enumerate(singles)]
    action = np.float32([0.3, -0.8])
    for _ in range(4):
        assert many.observation_space.contains(seen)
        for i, one in enumerate(alone):
            for key, value in one.items():
                np.testing.assert_allclose(seen[key][i], value, atol=5e-5)
        seen, _, ended, *_ = many.step(np.stack([action] * 3))
        alone = [env.step(action)[0] for env in singles]
        assert not ended.any()


def test_the_last_observation_of_an_encounter_is_a_dict() -> None:
    many = DeconflictionVectorEnv(2, intruders=2, rules=PAPER.rules()._replace(t_max=1.0))
    many.reset(seed=0)
    *_, truncated, infos = many.step(np.zeros((2, 2)))
    assert truncated.all()
    assert many.single_observation_space.contains(infos["final_obs"][0])


@BOTH
@pytest.mark.parametrize("intruders", [0, -1, 65, 1.5, True, "many"])
def test_a_number_of_intruders_that_cannot_be_seen_is_refused(make: Any, intruders: Any) -> None:
    with pytest.raises(EncounterError, match=r"^intruders is .*expected a whole number from 1 to 64"):
        make(intruders=intruders)


@BOTH
def test_the_scenario_of_another_aircraft_is_refused(make: Any) -> None:
    with pytest.raises(EncounterError, match="another aircraft"):
        make(scenario("circle", PAPER), aircraft=UAS)


@pytest.mark.slow
def test_stable_baselines_trains_its_policy_for_dicts_unchanged() -> None:
    peer = pytest.importorskip("stable_baselines3")
    env = gymnasium.make(f"envs.gym.gymnasium_env:{ENV_ID}", scenario="multi", aircraft=UAS, intruders=4)
    model = peer.PPO("MultiInputPolicy", env, n_steps=128, batch_size=64, n_epochs=2, seed=0, device="cpu")
    before = [parameter.detach().clone() for parameter in model.policy.parameters()]
    model.learn(256)
    assert any((old != new).any() for old, new in zip(before, model.policy.parameters(), strict=True))
    action, _ = model.predict(env.reset(seed=1)[0], deterministic=True)
    assert env.action_space.contains(action)
