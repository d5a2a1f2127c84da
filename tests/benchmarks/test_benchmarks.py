"""The benchmarks count what they say they count; peers fly our training, and begin and are counted
as we are.
"""

import json
import math
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, dump, load
from agents.policy import features
from agents.policy.inference import Policy
from agents.policy.set_features import TABLE, SetInputs
from benchmarks import (
    areas,
    bluesky,
    deadline,
    gemm,
    measure,
    monte_carlo,
    traffic,
    training,
    training_parts,
)
from benchmarks.icarous import run as icarous
from benchmarks.learning import run as learning
from benchmarks.learning import sb3 as sb3_task
from benchmarks.learning import sides as learning_sides
from benchmarks.learning import training as learning_run
from benchmarks.learning.sides import TrainingFlight, check
from benchmarks.safety import certificates
from benchmarks.safety import run as safety
from envs import surrogate
from envs.gym.gymnasium_vector import DeconflictionVectorEnv
from rlcas_jax import task
from rlcas_jax.config import TrainConfig

TINY = (
    "network.hidden=[8, 8]",
    "network.feature_set=mirror",
    "environments=8",
    "rollout=16",
    "ppo.minibatch=32",
    "ppo.segment=4",
    "ppo.epochs=2",
    "pool_rows=2",
)
PAPER_NETWORKS = [[22, 256, 256, 2], [22, 256, 256, 1]]
needs_peers = pytest.mark.skipif(
    not sb3_task.available(),
    reason=f"the extra 'peers' is not installed; to have it: {sb3_task.INSTALL}",
)


def last_line(capsys: pytest.CaptureFixture[str]) -> dict:
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_flop_counts_against_sums_by_hand():
    assert gemm.weights(PAPER_NETWORKS) == 2 * (22 * 256 + 256 * 256) + 256 * 2 + 256
    assert gemm.flop_per_step(PAPER_NETWORKS, 4) == 2 * 143_104 * 13
    # No gradient flows into the two first layers' inputs: one product less for each, in every
    # epoch.
    assert gemm.used_flop_per_step(PAPER_NETWORKS, 4) == 2 * 143_104 * 13 - 4 * 2 * (2 * 22 * 256)


def test_products_have_the_shapes_and_the_work_of_forward_and_backward_passes():
    work = gemm.products([3, 5, 2], 7)
    assert [product.flop for product in work] == [
        2 * 7 * 15,
        2 * 7 * 15,
        2 * 7 * 10,
        2 * 7 * 10,
        2 * 7 * 10,
    ]
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


def test_layers_are_those_of_the_shipped_network():
    shapes = measure.layers(Policy.load())
    assert sum(inputs == TABLE.intruder_size for inputs, _ in shapes) == 1
    assert sum(outputs == 2 for _, outputs in shapes) == 1
    assert monte_carlo.flops([(3, 5), (5, 2)]) == 2 * (15 + 10)


@pytest.mark.slow
def test_deadlines_are_measured_once_and_lateness_is_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    monkeypatch.setattr(deadline, "PER_KIND", 1)
    monkeypatch.setattr(deadline, "DEADLINES_MS", (50.0, math.inf))
    monkeypatch.setattr("sys.argv", ["deadline", "--out", str(tmp_path), "--requests", "5"])
    deadline.main()
    found = last_line(capsys)
    assert found["answers_with_a_deadline"] == 5
    lateness = [found[kind]["slowest_ms"][0] - 50.0 for kind in deadline.KINDS]
    assert found["latest_after_its_deadline_ms"] == pytest.approx(max(0.0, *lateness))
    monkeypatch.setattr(deadline, "answers", None)  # what is there is not measured again
    stored = tmp_path / "block-00000.json"
    block = json.loads(stored.read_text())
    block["ms"]["noisy"][0][0] = 60.0
    stored.write_text(json.dumps(block))
    late = sum(rows[0][0] > 50.0 + deadline.LATE_MS for rows in block["ms"].values())
    deadline.main()
    again = last_line(capsys)
    assert again["1 intruder"] == found["1 intruder"]
    assert again["more_than_5_ms_late"] == late >= 1
    assert 0 <= again["late_when_asked_again"] <= late


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
    assert figures["gflop_per_s"] == pytest.approx(
        figures["flop_per_step"] * figures["steps_per_s_median"] / 1e9
    )
    assert {"jax", "python"} <= figures["versions"].keys()


def test_training_says_how_to_get_the_peer(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(sb3_task, "available", lambda: False)
    monkeypatch.setattr(
        training, "measure", lambda config, extent: {"peer_cells": len(extent.batches)}
    )
    training.main([])
    assert sb3_task.INSTALL in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.long
def test_parts_of_an_update_are_measured_beside_their_limit():
    config = load(TrainConfig, None, [*TINY, "network.feature_set=set", "network.encoder=[4]"])
    figures = training_parts.measure(config, 0.001)
    (phase,) = figures["phases"]
    costs = phase["us_per_step"]
    assert {"whole update", "inputs", "gradients", "limit: products"} <= set(costs)
    assert all(cost["wall"] > 0.0 for cost in costs.values())
    whole = costs["whole update"]
    assert figures["all_phases_wall_s"] == pytest.approx(config.steps * 1e-6 * whole["wall"])
    json.dumps(figures)


def test_parts_are_measured_of_ppo_on_sets_alone():
    with pytest.raises(ConfigError, match="trains by ppo on mirror; expected ppo on a set"):
        training_parts.main(["--config", "configs/paper.yaml"])


def test_bad_repeats_are_refused():
    with pytest.raises(ConfigError, match="--repeats: '0'; expected a whole number of at least 1"):
        training.main(["--repeats", "0"])


@pytest.mark.parametrize(
    ("main", "given", "said"),
    [
        (areas.main, ["--requests", "0"], "--requests: '0'; expected a whole number of at least 1"),
        (areas.main, ["--deadlines", "50", "nan"], "--deadlines: nan ms; expected 1 to 60000 ms"),
        (traffic.main, ["--seed", "-1"], "--seed: '-1'; expected a whole number of at least 0"),
        (traffic.main, ["--radius", "inf"], "--radius: inf km; expected 1 to 1000 km"),
        (traffic.main, ["--deadlines", "-5"], "--deadlines: -5 ms; expected 1 to 60000 ms"),
        (bluesky.main, ["--workers", "0"], "--workers: '0'; expected a whole number of at least 1"),
        (icarous.main, ["--missions", "-1"], "--missions: '-1'; expected a whole number"),
        (safety.main, ["--block", "50"], "--block: '50'; expected a whole number of at least 100"),
        (safety.main, ["--block", "150"], "--block is 150, expected a multiple of 100"),
        (certificates.main, ["--plans", "0"], "--plans: '0'; expected a whole number of at least"),
        (certificates.main, ["--seed", "-1"], "--seed: '-1'; expected a whole number of at least"),
        (training_parts.main, ["--seconds", "0"], "--seconds: 0 s; expected 0.001 to 3600 s"),
    ],
)
def test_bad_options_are_refused_in_a_sentence(main: Any, given: list[str], said: str):
    with pytest.raises(ConfigError, match=said):
        main(given)


@pytest.mark.slow
@needs_peers
@pytest.mark.parametrize("feature_set", ["none", "mirror"])
def test_peer_sees_the_inputs_of_our_networks_and_our_scaled_rewards(feature_set: str):
    config = load(TrainConfig, None, [*TINY, f"network.feature_set={feature_set}"])
    mine = DeconflictionVectorEnv(
        4, "circle", aircraft=config.aircraft.aircraft(), rules=config.rules()
    )
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
        seen, reward, terminated, truncated, _ = mine.step(
            (actions * np.stack([np.ones(4), hands], -1)).astype("f4")
        )
        their_seen, their_reward, done, infos = theirs.step(actions)
        np.testing.assert_allclose(their_seen, inputs(seen), atol=1e-4)
        np.testing.assert_allclose(their_reward, config.reward_scale * reward)
        np.testing.assert_array_equal(done, terminated | truncated)
        assert infos == [{}] * 4
        ended += int(done.sum())
    assert ended > 0


@pytest.mark.slow
@needs_peers
def test_peer_has_our_networks():
    config = load(TrainConfig, None, ["ppo.epochs=4", "network.feature_set=mirror"])
    model = sb3_task.algorithm(config, sb3_task.Cell(environments=4, steps=8, batch=16, epochs=4))
    kernels = sum(
        p.numel() for name, p in model.policy.named_parameters() if name.endswith("weight")
    )
    assert kernels == gemm.weights(training.networks(config))
    assert (model.gamma, model.gae_lambda, model.n_epochs) == (0.995, 0.95, 4)


@pytest.mark.slow
@needs_peers
def test_training_beside_the_peer_gives_both_ratios(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        sb3_task, "DEFAULTS", sb3_task.Cell(environments=1, steps=64, batch=16, epochs=10)
    )
    extent = training.Extent(
        repeats=1, batches=(64,), environments=(8,), samples=512, cell_s=0.0, finalists=1
    )
    figures = training.measure(load(TrainConfig, None, TINY), extent)
    peer = figures["sb3"]
    assert peer["best"]["batch"] == 64
    assert peer["default"]["epochs"] == 10
    assert peer["default_same_epochs"]["epochs"] == 2
    assert {entry["threads"] for entry in peer["grid"]} == {1, measure.machine()["cores"]}
    ours = figures["steps_per_s_median"]
    assert figures["ratio_to_sb3_best"] == pytest.approx(ours / peer["best"]["steps_per_s_median"])
    assert figures["ratio_to_sb3_default"] == pytest.approx(
        ours / peer["default"]["steps_per_s_median"]
    )
    json.dumps(figures)


SHAPED = (*TINY, "rewards.goal_distance=50", "aircraft.t_max_s=40")
peers = pytest.mark.parametrize(
    "peer",
    [
        pytest.param(
            name,
            marks=pytest.mark.skipif(
                not learning_sides.available(name),
                reason=f"{learning_sides.LEARNERS[name]} is not installed",
            ),
        )
        for name in ("sb3", "sbx")
    ],
)


def tiny(*more: str) -> TrainConfig:
    return load(TrainConfig, None, [*SHAPED, *more])


# Peers: the task and its score
@pytest.mark.slow
@pytest.mark.parametrize("feature_set", ["none", "mirror"])
def test_peers_fly_our_training_and_its_score_is_counted_as_ours(feature_set: str):
    config = tiny(
        f"network.feature_set={feature_set}",
        "world.separation_spread=0.05",
        "scenarios=[{name: circle, weight: 0.7}, {name: head_on, weight: 0.3}]",
        "rollout=96",
        "pool_rows=3",
    )
    flight = TrainingFlight(config)
    inputs = flight.reset()
    state, pool = jax.tree.map(jnp.array, flight._state), flight._pool
    world = surrogate.World(config.rules(), config.aircraft.aircraft())
    ours = task._training_environment(config, world, pool, config.training_scenarios())

    @jax.jit
    def network_inputs(state: surrogate.State) -> tuple[jax.Array, jax.Array]:
        seen = ours.observe(state, jax.random.key(0))
        assert isinstance(seen, SetInputs)
        return seen.own, seen.mirror_sign

    step, restart = jax.jit(ours.step), jax.jit(ours.restart)
    generator, statistics, action = np.random.default_rng(0), [], np.zeros((8, 2), np.float32)
    for index in range(95):
        state = restart(state, index)
        expected, hand = network_inputs(state)
        np.testing.assert_allclose(inputs, expected, atol=2e-5)
        action = generator.normal(size=(8, 2)).astype(np.float32)
        state, result = step(state, action * np.stack([np.ones(8, np.float32), hand], axis=-1))
        inputs, reward, done = flight.step(action)
        np.testing.assert_allclose(reward, result.reward, atol=1e-6)
        np.testing.assert_array_equal(done, result.terminated)
        statistics.append(result.statistics)
    stacked = jax.tree.map(lambda *rows: jnp.stack(rows), *statistics)
    figures = task._episodes(stacked, 95 * 8, None)
    returns, episodes = flight.take_episodes()
    assert episodes == figures["episodes"] > 8
    assert returns / episodes == pytest.approx(float(figures["score"]), rel=1e-5)
    assert flight.take_episodes() == (0.0, 0)
    before = np.asarray(flight._pool.own.x)
    np.testing.assert_array_equal(before, pool.own.x)  # drawn for a rollout, and for the next anew
    flight.step(action)
    assert not np.any(before == np.asarray(flight._pool.own.x))
    with pytest.raises(ValueError, match="not finite"):
        flight.step(np.full((8, 2), np.nan, np.float32))


def test_noisy_reports_are_refused():
    with pytest.raises(ConfigError, match=r"scenarios\.0: noisy has noisy or late reports"):
        check(tiny("scenarios=[{name: noisy}]"))


# Peers: the learners
@pytest.mark.slow
@peers
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_a_peer_begins_as_we_do_and_follows_our_schedule(
    peer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    config = tiny("steps=1280", "learning_rate_final=1e-4")
    theirs = learning_sides.side(peer, config)
    assert isinstance(theirs, learning_sides._Peer)
    before = theirs._weights.get()
    kernels = kernels_of(peer, before)
    assert sum(kernel.size for kernel in kernels) == gemm.weights(training.networks(config))
    for kernel in kernels:
        gain = {1: 1.0, 2: 0.01}.get(min(kernel.shape), math.sqrt(2.0))
        np.testing.assert_allclose(np.linalg.svd(kernel, compute_uv=False), gain, rtol=1e-4)
    theirs.start()
    for old, new in zip(kernels, kernels_of(peer, theirs._weights.get()), strict=True):
        np.testing.assert_array_equal(old, new)
    for rate in (7e-4, 6.4e-4, 5.8e-4):  # ten updates, the rate of each as at its beginning
        assert theirs.update().steps == 128
        assert rate_of(peer, theirs._model.policy) == pytest.approx(rate, rel=1e-6)
    assert theirs._model.num_timesteps == 3 * 128
    assert any(
        np.any(old != new)
        for old, new in zip(kernels, kernels_of(peer, theirs._weights.get()), strict=True)
    )
    assert not list(tmp_path.glob("SB3-*"))  # it keeps no log


def rate_of(peer: str, policy: Any) -> float:
    if peer == "sb3":
        return policy.optimizer.param_groups[0]["lr"]
    return float(policy.vf_state.opt_state[1].hyperparams["learning_rate"])


def kernels_of(peer: str, kept: Any) -> list[np.ndarray]:
    if peer == "sb3":
        return [np.array(value) for name, value in kept[0].items() if name.endswith("weight")]
    return [
        np.array(leaf) for state in kept for leaf in jax.tree.leaves(state.params) if leaf.ndim == 2
    ]


@pytest.mark.slow
@peers
@pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::RuntimeWarning"
)
def test_a_peer_that_diverges_says_so(peer: str, tmp_path: Path):
    config = tiny("learning_rate=1.0", "reward_scale=1e38", "steps=1280")
    learning_run.train(peer, config, 60.0, tmp_path / "run.jsonl", "run")
    log = learning_run.read(tmp_path / "run.jsonl")
    assert log is not None
    assert log.ended == "diverged"


@pytest.mark.slow
@peers
def test_a_peer_learns_in_a_process_of_its_own(peer: str, tmp_path: Path):
    config = tmp_path / "run.yaml"
    config.write_text(dump(tiny("steps=640")))
    learning._process(peer, config, 60.0, tmp_path / "run.jsonl", None)
    log = learning_run.read(tmp_path / "run.jsonl")
    assert log is not None
    assert log.ended == "steps"
    assert log.curve[-1].steps == 640
    assert log.curve[-1].episodes > 0
    assert log.startup_s > 0.0


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--steps", "0", "--steps: '0'; expected a whole number"),
        ("--seeds", "0", "--seeds: '0'; expected a whole number"),
        ("--trials", "-1", "--trials: '-1'; expected a whole number"),
        ("--budget", "nan", "--budget: nan s; expected 0.1 to 1e"),
        ("--trial-seconds", "0", "--trial-seconds: 0 s; expected 0.1 to 1e"),
        ("--trial-seeds", "0", "--trial-seeds: '0'; expected a whole number"),
        ("--trial-target", "nan", "--trial-target: nan; expected -100 to 100"),
        ("--learner", "theirs", "invalid choice: 'theirs'"),
    ],
)
def test_bad_options_are_refused(option: str, value: str, said: str):
    with pytest.raises(ConfigError, match=said):
        learning.main([option, value])


def test_a_peer_that_is_asked_for_and_absent_is_refused_with_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(learning, "available", lambda name: name == "ours")
    with pytest.raises(ConfigError, match=r"SBX is not installed; to have it: pip install"):
        learning.main(["--learner", "sbx"])
