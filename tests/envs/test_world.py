"""One update for all array namespaces: plain floats, numpy and recorded intruders."""

import numpy as np
import pytest

from envs import flight, starts, world
from envs.encounters import scenario
from envs.intruder import Recording, start, step
from envs.kinematics import SURROGATE, VehicleState
from envs.outcome import RULES
from envs.trees import take
from envs.world import World

COUNT, STEPS = 3, 120


@pytest.mark.parametrize("name", ["circle", "noisy", "multi"])
@pytest.mark.parametrize("dt", [1.0, 0.3])
def test_plain_floats_equal_numpy_to_the_last_bit(name: str, dt: float) -> None:
    parameters = World(RULES._replace(dt=dt), SURROGATE)
    encounters = starts.numbered(scenario(name), 4, 0, COUNT)
    batch = world.begin(encounters, np, late_reports=True)
    singles = [flight.begin(take(encounters, i)) for i in range(COUNT)]
    rng = np.random.default_rng(1)
    for _ in range(STEPS):
        action, noise = rng.uniform(-1.2, 1.2, (COUNT, 2)), rng.normal(size=(4, *encounters.mask.shape))
        seen = world.observe(batch, world.perceived(batch, noise, np), np).astype(np.float32)
        batch, result = world.step(batch, (action[:, 0], action[:, 1]), parameters, np)
        for i, mask in enumerate(encounters.mask):
            np.testing.assert_array_equal(flight.observe(singles[i], noise[:, i, mask]), seen[i])
            singles[i], one = flight.step(singles[i], tuple(action[i].tolist()), parameters)
            assert singles[i].own == tuple(field[i] for field in batch.own)
            assert one.outcome == tuple(field[i] for field in result.outcome)
            assert (one.reward, one.separation, one.goal_distance) == (
                result.reward[i],
                result.separation[i],
                result.goal_distance[i],
            )
            np.testing.assert_array_equal(one.separations, result.separations[i, mask])


def test_each_recorded_intruder_follows_its_own_clock() -> None:
    """Rows are read by each flight's own time, and after the last one the intruder flies straight on."""
    rows = np.arange(12.0).reshape(3, 1, 4)  # [N, K, T + 1]
    recording = Recording(rows, 10.0 * rows, 0.0 * rows, 0.0 * rows + 7.0)
    clock = np.array([0, 2, 3])
    began = start(VehicleState(*(field[np.arange(3), 0, clock][:, None] for field in recording)), np)
    after = step(began, recording, 1.0 * clock[:, None], 1.0, np).vehicle
    np.testing.assert_allclose(after.x[:, 0], [1.0, 7.0, 11.0 + 7.0])
    np.testing.assert_allclose(after.y[:, 0], [10.0, 70.0, 110.0])
