import re
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.keys import keys
from agents.config.load import ConfigError, dump, load
from agents.policy.features import FEATURE_SETS
from envs.encounters import SCENARIOS
from envs.kinematics import C208_PUBLISHED, SURROGATE
from envs.outcome import RULES
from rlcas_jax.config import EvaluationConfig, NetworkConfig, PpoConfig, TrainConfig, WorldConfig

ROOT = Path(__file__).resolve().parents[2]


def test_own_speeds_that_the_vehicle_does_not_fly_are_refused():
    vehicle = "world.vehicle={speed_min_mps: 18, speed_max_mps: 36}"
    with pytest.raises(ConfigError, match=r"scenarios.0.own_speed is \[50, 100\] m/s"):
        load(TrainConfig, None, [vehicle])
    load(TrainConfig, None, [vehicle, "scenarios.0.own_speed=[18, 36]"])


def test_the_defaults_are_the_papers_task():
    config = TrainConfig()
    assert config.world.rules() == RULES
    assert config.world.limits() == SURROGATE
    assert [choice.scenario() for choice in config.scenarios] == [SCENARIOS["circle"]]
    assert config.network.hidden == (256, 256)


def test_quick_is_valid_and_says_only_what_differs_from_the_defaults():
    quick = load(TrainConfig, ROOT / "configs" / "quick.yaml")
    assert quick.name == "quick"
    assert quick.network.hidden == (256, 256)


def test_an_evaluation_judges_by_its_own_separation():
    world = WorldConfig(separation=1_050.0, t_max=200.0)
    assert EvaluationConfig().rules(world) == RULES._replace(t_max=200.0)


def test_the_vehicle_is_resolved_into_the_dump(tmp_path: Path):
    config = load(TrainConfig, overrides=[f"world.vehicle={ROOT / 'configs' / 'vehicle_c208_published.yaml'}"])
    assert config.world.limits() == C208_PUBLISHED
    written = tmp_path / "config.yaml"
    written.write_text(dump(config))
    assert "vehicle_c208" not in written.read_text()
    assert load(TrainConfig, written) == config


@given(
    st.sampled_from(list(SCENARIOS)),
    st.integers(0, 2**31 - 1),
    st.integers(1, 2**40),
    st.floats(1e-30, 1.0),
    st.sampled_from([(1024, 32, 2048, 16), (6, 10, 12, 2), (1, 2, 2, 1)]),
)
def test_a_dump_repeats_the_run(
    tmp_path_factory: pytest.TempPathFactory,
    scenario: str,
    seed: int,
    steps: int,
    rate: float,
    sizes: tuple[int, int, int, int],
):
    environments, rollout, minibatch, segment = sizes
    overrides = [
        f"scenarios.0.name={scenario}",
        f"seed={seed}",
        f"steps={steps}",
        f"ppo.learning_rate={rate}",
        f"ppo={{environments: {environments}, rollout: {rollout}, minibatch: {minibatch}, segment: {segment}}}",
        f"shaping.goal={rate}",
    ]
    config = load(TrainConfig, overrides=overrides)
    path = tmp_path_factory.getbasetemp() / "train.yaml"
    path.write_text(dump(config))
    assert load(TrainConfig, path) == config
    assert dump(load(TrainConfig, path)) == dump(config)


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("seed=-1", "--set: seed is -1; expected a whole number at least 0 and below 2147483648"),
        ("steps=0", "--set: steps is 0; expected a whole number at least 1 and at most 1e+12"),
        (
            "name=a/b",
            "--set: name is 'a/b'; expected a text of at most 64 letters, digits, dots, dashes and underscores",
        ),
        (
            "ppo.minibatch=5000",
            "--set: ppo.minibatch is 5000; expected a divisor of environments times rollout, 32768, such as 4096",
        ),
        ("ppo.segment=3", "--set: ppo.segment is 3; expected a divisor of rollout, 32, such as 2"),
        (
            "ppo={segment: 1, smoothness: [0.0, 1.0]}",
            "--set: ppo.segment is 1; expected 2 or more, as smoothness compares neighbouring steps of a segment",
        ),
        (
            "ppo={minibatch: 8}",
            "--set: ppo.segment is 16; expected a divisor of minibatch, 8, such as 8",
        ),
        ("ppo.discount=1.5", "--set: ppo.discount is 1.5; expected a number above 0 and at most 1"),
        (
            "world.t_max=0.5",
            "--set: world.t_max is 0.5; expected a number at least 1 and at most 3600 and a multiple of 1",
        ),
        (
            "network.feature_set=cap",
            "--set: network.feature_set is 'cap'; expected one of advised, cpa, foresight, mirror, none, pressed; "
            "did you mean cpa?",
        ),
    ],
)
def test_a_bad_value_is_refused_in_one_sentence(override: str, sentence: str):
    with pytest.raises(ConfigError) as caught:
        load(TrainConfig, overrides=[override])
    assert str(caught.value) == sentence


def test_feature_sets_are_those_of_the_network():
    assert set(get_args(NetworkConfig.model_fields["feature_set"].annotation)) == set(FEATURE_SETS)


def test_sizes_of_an_update():
    ppo = PpoConfig(environments=6, rollout=10, minibatch=12, segment=2)
    assert (ppo.samples, ppo.minibatches) == (60, 5)


def test_every_key_says_what_it_does():
    silent = [key.name for key in keys(TrainConfig) if len(key.text) < 10]
    assert not silent


def test_every_key_is_read_by_the_program():
    """Guards against keys that are accepted and then do nothing."""
    sources = [path for path in (ROOT / "rlcas_jax").glob("*.py") if path.name != "cli.py"]
    program = "\n".join(path.read_text() for path in sources)
    unused = [
        key.name
        for key in keys(TrainConfig)
        # A scenario's numbers are taken over as a whole and tested with it; the vehicle's likewise.
        if not key.name.startswith(("scenarios[].", "world."))
        and not re.search(rf"\.{key.name.rpartition('.')[2]}\b", program)
    ]
    assert not unused
