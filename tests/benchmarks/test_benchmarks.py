"""The benchmarks count what they say they count, and end with one JSON object."""

import json

import numpy as np
import pytest

from agents.config.load import ConfigError, load
from agents.policy import features
from benchmarks import gemm, measure, training
from benchmarks.learning import sb3 as sb3_task
from envs.gym.gymnasium_vector import DeconflictionVectorEnv
from rlcas_jax.config import TrainConfig
from tests.benchmarks.tiny import TINY

PAPER_NETWORKS = [[22, 256, 256, 2], [22, 256, 256, 1]]

needs_peers = pytest.mark.skipif(
    not sb3_task.available(), reason=f"the extra 'peers' is not installed; to have it: {sb3_task.INSTALL}"
)


def last_line(capsys: pytest.CaptureFixture[str]) -> dict:
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_flop_counts_against_sums_by_hand():
    assert gemm.weights(PAPER_NETWORKS) == 2 * (22 * 256 + 256 * 256) + 256 * 2 + 256
    assert gemm.flop_per_step(PAPER_NETWORKS, 4) == 2 * 143_104 * 13
    # No gradient flows into the two first layers' inputs: one product less for each, in every epoch.
    assert gemm.used_flop_per_step(PAPER_NETWORKS, 4) == 2 * 143_104 * 13 - 4 * 2 * (2 * 22 * 256)


def test_products_have_the_shapes_and_the_work_of_forward_and_backward_passes():
    work = gemm.products([3, 5, 2], 7)
    assert [product.flop for product in work] == [2 * 7 * 15, 2 * 7 * 15, 2 * 7 * 10, 2 * 7 * 10, 2 * 7 * 10]
    shapes = []
    for product in work:
        left, right = np.ones(product.left), np.ones(product.right)
        shapes.append(np.tensordot(left, right, (product.contract[0], product.contract[1])).shape)
    assert shapes == [(7, 5), (3, 5), (7, 2), (5, 2), (7, 5)]
    gemm.runner(work, 2)()
    assert gemm.flop(gemm.plain(4096, 256)) == 2 * 4096 * 256**2


def test_turns_alternate_after_one_that_is_not_counted():
    order = []
    times = training.in_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert order == ["a", "b"] * 3
    assert {name: len(values) for name, values in times.items()} == {"a": 2, "b": 2}


def test_spread_is_the_range_over_the_median():
    assert training.spread([9.0, 10.0, 12.0]) == pytest.approx(0.3)


def test_report_names_machine_and_versions(capsys: pytest.CaptureFixture[str]):
    measure.report({"rate_per_s": 1.0}, ("numpy",))
    printed = last_line(capsys)
    assert printed["rate_per_s"] == 1.0
    assert printed["machine"]["cores"] >= 1
    assert printed["versions"]["numpy"] == np.__version__


@pytest.mark.slow
def test_training_without_the_peer_ends_with_one_json_object(capsys: pytest.CaptureFixture[str]):
    sets = [argument for key in TINY for argument in ("--set", key)]
    training.main([*sets, "--repeats", "2", "--no-sb3"])
    figures = last_line(capsys)
    assert figures["sb3"] is None
    assert "ratio_to_sb3_best" not in figures
    assert figures["weights"] == 2 * (22 * 8 + 64) + 24
    assert figures["flop_per_step"] == 2 * figures["weights"] * 7
    assert figures["steps_per_s_best"] >= figures["steps_per_s_median"] > 0.0
    assert figures["gflop_per_s"] == pytest.approx(figures["flop_per_step"] * figures["steps_per_s_median"] / 1e9)
    assert {"jax", "python"} <= figures["versions"].keys()


def test_training_says_how_to_get_the_peer(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sb3_task, "available", lambda: False)
    monkeypatch.setattr(training, "measure", lambda config, extent: {"peer_cells": len(extent.batches)})
    training.main([])
    assert sb3_task.INSTALL in capsys.readouterr().out


def test_bad_repeats_are_refused():
    with pytest.raises(ConfigError, match="--repeats is 0"):
        training.main(["--repeats", "0"])


@needs_peers
@pytest.mark.parametrize("feature_set", ["cpa", "mirror"])
def test_peer_sees_the_inputs_of_our_networks_and_our_scaled_rewards(feature_set: str):
    config = load(TrainConfig, None, [*TINY, f"network.feature_set={feature_set}"])
    mine = DeconflictionVectorEnv(4, "circle", rules=config.world.rules(), limits=config.world.limits())
    theirs = sb3_task.environment(config, 4)

    def inputs(seen: np.ndarray) -> np.ndarray:
        return np.stack(features.features(list(seen.T), config.network.feature_set, np), axis=-1)

    seen = mine.reset(seed=config.seed)[0]
    np.testing.assert_allclose(theirs.reset(), inputs(seen), atol=1e-4)
    ended = 0
    for _ in range(310):
        actions = np.tile(np.float32([0.0, 0.3]), (4, 1))
        # What the peer turns to, our world turns to as the features saw the scene.
        hands = features.mirror_sign(list(seen.T), feature_set, np) * np.ones(4)
        seen, reward, terminated, truncated, _ = mine.step((actions * np.stack([np.ones(4), hands], -1)).astype("f4"))
        their_seen, their_reward, done, infos = theirs.step(actions)
        np.testing.assert_allclose(their_seen, inputs(seen), atol=1e-4)
        np.testing.assert_allclose(their_reward, config.ppo.reward_scale * reward)
        np.testing.assert_array_equal(done, terminated | truncated)
        assert infos == [{}] * 4
        ended += int(done.sum())
    assert ended > 0


@needs_peers
def test_peer_has_our_networks():
    config = load(TrainConfig, None, ["ppo.epochs=4"])
    model = sb3_task.algorithm(config, sb3_task.Cell(environments=4, steps=8, batch=16, epochs=4))
    kernels = sum(p.numel() for name, p in model.policy.named_parameters() if name.endswith("weight"))
    assert kernels == gemm.weights(training.networks(config))
    assert (model.gamma, model.gae_lambda, model.n_epochs) == (0.995, 0.95, 4)


@pytest.mark.slow
@needs_peers
def test_training_beside_the_peer_gives_both_ratios(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sb3_task, "DEFAULTS", sb3_task.Cell(environments=1, steps=64, batch=16, epochs=10))
    extent = training.Extent(repeats=1, batches=(64,), environments=(8,), samples=512, cell_s=0.0, finalists=1)
    figures = training.measure(load(TrainConfig, None, TINY), extent)
    peer = figures["sb3"]
    assert peer["best"]["batch"] == 64
    assert peer["default"]["epochs"] == 10
    assert peer["default_same_epochs"]["epochs"] == 2
    assert {entry["threads"] for entry in peer["grid"]} == {1, measure.machine()["cores"]}
    ours = figures["steps_per_s_median"]
    assert figures["ratio_to_sb3_best"] == pytest.approx(ours / peer["best"]["steps_per_s_median"])
    assert figures["ratio_to_sb3_default"] == pytest.approx(ours / peer["default"]["steps_per_s_median"])
    json.dumps(figures)
