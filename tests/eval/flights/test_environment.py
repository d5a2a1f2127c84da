"""The evaluation flies what the Gymnasium environment flies."""

import numpy as np
import pytest

from envs import scenarios, starts
from envs.aircraft import PAPER
from envs.gym.gymnasium_env import DeconflictionEnv
from eval.flights import simulate
from tests.eval.resolvers import OnObservations


@pytest.mark.parametrize("scenario", ["circle", "noisy", "multi"])
def test_the_environment_flies_what_the_evaluator_flies(scenario):
    count, seed = 12, 5

    def decide(observation: np.ndarray) -> np.ndarray:
        # Reacts to the intruder as seen, so that the noise has its part in it.
        return np.stack(
            [observation[:, 5], np.clip(3.0 * observation[:, 6] - 0.3 * observation[:, 4], -1, 1)],
            -1,
        )

    family = scenarios.scenario(scenario, PAPER)
    noise = (
        simulate.sensor_noise(seed, 0, count, family.intruders[1]) if scenario == "noisy" else None
    )
    drawn = starts.encounters_of_seed(family, seed, 0, count)
    flown = simulate.fly(drawn, OnObservations(decide), PAPER, noise=noise)
    env = DeconflictionEnv(scenario)
    for i in range(count):
        observed, info = env.reset(seed=seed if i == 0 else None)
        assert info["encounter"] == i
        over = False
        while not over:
            observed, _, terminated, truncated, info = env.step(decide(observed[None])[0])
            over = terminated or truncated
        assert info["time"] == flown.duration[i]
        assert info["outcome"] == simulate.OUTCOMES[flown.outcome[i]]
        # To the last bit: the same numbers in the same order.
        assert info["min_separation"] == flown.min_separation[i]
