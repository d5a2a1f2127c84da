"""The training configuration: what is accepted, every key changes something, and the page that
lists them.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import jax
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from agents.config.keys import keys
from agents.config.load import ConfigError, dump, load, validate
from agents.config.pages import with_tables
from agents.policy.inference import Policy
from commands.yaml import write
from envs.aircraft import PAPER
from envs.outcome import RULES
from envs.scenarios import SCENARIOS, scenario
from rlcas_jax.algorithm import ppo_settings
from rlcas_jax.config import (
    NetworkConfig,
    PpoConfig,
    TrainConfig,
    configuration_of_run,
    upgrade,
)
from rlcas_jax.metrics import METRICS, WALL_CLOCK
from rlcas_jax.reference import main, tables
from rlcas_jax.task import build

ROOT = Path(__file__).resolve().parents[2]


def test_the_policy_that_ships_was_trained_by_the_recipe_that_ships():
    recipe = load(TrainConfig, ROOT / "configs" / "best.yaml")
    assert validate(TrainConfig, upgrade(Policy.load().metadata["training"]["config"])) == recipe


def test_own_speeds_that_the_aircraft_does_not_fly_are_refused():
    aircraft = "aircraft={speed_min_mps: 18, speed_max_mps: 36}"
    load(TrainConfig, None, [aircraft])
    with pytest.raises(ConfigError, match=r"scenarios.0.own_speed is \[50, 100\]; .* 18 to 36"):
        load(TrainConfig, None, [aircraft, "scenarios.0.own_speed=[50, 100]"])


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs" / "aircraft").glob("*.yaml")), ids=lambda path: path.stem
)
def test_quick_trains_any_aircraft_by_one_option(path: Path):
    config = load(TrainConfig, ROOT / "configs" / "quick.yaml", [f"aircraft={path}"])
    aircraft = config.aircraft.aircraft()
    near = config.training_scenarios()[2]
    assert near.radius == (0.5 * aircraft.separation, 4.0 * aircraft.separation)
    assert near.own_speed == (aircraft.limits.speed_min, aircraft.limits.speed_max)


def test_metres_are_refused_where_separations_are_expected():
    with pytest.raises(ConfigError, match=r"world.separation_spread is 80.* at most 10"):
        load(TrainConfig, None, ["world.separation_spread=80"])


def test_the_defaults_are_the_papers_task():
    config = TrainConfig()
    assert config.rules() == RULES
    assert config.aircraft.aircraft() == PAPER
    assert config.training_scenarios() == [scenario("circle", PAPER)]
    assert config.network.hidden == (256, 256)


def test_quick_is_valid_and_says_only_what_differs_from_the_defaults():
    quick = load(TrainConfig, ROOT / "configs" / "quick.yaml")
    assert (quick.name, quick.network.feature_set) == ("quick", "set")


def test_the_aircraft_is_resolved_into_the_dump(tmp_path: Path):
    config = load(TrainConfig, overrides=[f"aircraft={ROOT / 'configs' / 'aircraft' / 'uas.yaml'}"])
    assert config.aircraft.aircraft().separation == 610.0
    written = tmp_path / "config.yaml"
    written.write_text(dump(config))
    assert "uas" not in written.read_text()
    assert load(TrainConfig, written) == config


@given(
    st.sampled_from(list(SCENARIOS)),
    st.integers(0, 2**31 - 1),
    st.integers(1, 10**12),
    st.floats(1e-30, 1.0),
    st.sampled_from([(1024, 32, 2048, 16), (6, 10, 12, 2), (1, 2, 2, 1)]),
)
def test_a_dump_repeats_the_run(
    tmp_path_factory: pytest.TempPathFactory,
    chosen: str,
    seed: int,
    steps: int,
    rate: float,
    sizes: tuple[int, int, int, int],
):
    environments, rollout, minibatch, segment = sizes
    overrides = [
        f"scenarios.0.name={chosen}",
        f"seed={seed}",
        f"steps={steps}",
        f"learning_rate={rate}",
        f"environments={environments}",
        f"rollout={rollout}",
        f"ppo={{minibatch: {minibatch}, segment: {segment}}}",
        f"rewards.goal_distance={rate}",
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
            "--set: name is 'a/b'; expected a text of at most 64 letters, digits, dots, dashes "
            "and underscores",
        ),
        (
            "ppo.minibatch=5000",
            "ppo.minibatch is 5000; expected a divisor of environments times rollout, "
            "32768, such as 4096",
        ),
        ("ppo.segment=3", "ppo.segment is 3; expected a divisor of rollout, 32, such as 2"),
        ("rollout=8", "ppo.segment is 16; expected a divisor of rollout, 8, such as 8"),
        (
            "ppo.learning_rate=3e-4",
            "--set: ppo.learning_rate has moved; expected learning_rate (its value is 0.0003)",
        ),
        (
            "ppo={minibatch: 8}",
            "ppo.segment is 16; expected a divisor of ppo.minibatch, 8, such as 8",
        ),
        ("discount=1.5", "--set: discount is 1.5; expected a number above 0 and at most 1"),
        (
            "aircraft.t_max_s=0.5",
            "--set: aircraft: t_max is 0.5 s; expected a whole number of time steps of 1 s",
        ),
        (
            "network.feature_set=cpa",
            "--set: network.feature_set is 'cpa'; expected one of mirror, none, set",
        ),
        (
            "network.feature_set=miror",
            "--set: network.feature_set is 'miror'; expected one of mirror, none, set; did you "
            "mean mirror?",
        ),
    ],
)
def test_a_bad_value_is_refused_in_one_sentence(override: str, sentence: str):
    with pytest.raises(ConfigError) as caught:
        load(TrainConfig, overrides=[override])
    assert str(caught.value) == sentence


def test_feature_sets_are_those_of_the_network():
    assert set(get_args(NetworkConfig.model_fields["feature_set"].annotation)) == {
        "none",
        "mirror",
        "set",
    }


def test_sizes_of_an_update():
    config = TrainConfig(environments=6, rollout=10, ppo=PpoConfig(minibatch=12, segment=2))
    assert (config.samples, ppo_settings(config).minibatches) == (60, 5)


def test_sizes_of_ppo_do_not_bind_another_algorithm():
    sizes = ["algorithm=my_algorithm:Mine", "environments=3", "rollout=7"]
    assert load(TrainConfig, overrides=sizes).samples == 21


MOVED = {
    "seed": 5,
    "ppo": {"environments": 64, "rollout": 64, "epochs": 3, "discount": 0.9},
    "phases": [{"steps": 10_000, "ppo": {"learning_rate": 1e-3, "clip": 0.3}}],
}


def test_a_file_of_before_is_refused_with_the_new_name_of_its_key(tmp_path: Path):
    file = tmp_path / "old.yaml"
    for values, sentence in (
        (MOVED, "ppo.environments has moved; expected environments .* 2 more"),
        ({"phases": MOVED["phases"]}, "phases.0: ppo.learning_rate has moved; expected learning_"),
    ):
        file.write_text(write(values))
        with pytest.raises(ConfigError, match=f"^{file}: {sentence}"):
            load(TrainConfig, file)


def test_the_configuration_of_a_run_of_before_is_read(tmp_path: Path):
    file = tmp_path / "config.yaml"
    file.write_text(write(MOVED))
    config = configuration_of_run(file)
    (phase,) = config.phase_configs()
    assert (phase.environments, phase.discount, phase.learning_rate) == (64, 0.9, 1e-3)
    assert (phase.ppo.epochs, phase.ppo.clip) == (3, 0.3)
    assert configuration_of_run(dump(config)) == config


@pytest.mark.parametrize("text", ["ppo: 3", "phases: 3", "phases: [3]", "seed: [", "ppo: null"])
def test_a_damaged_configuration_of_a_run_is_refused_in_one_sentence(text: str, tmp_path: Path):
    file = tmp_path / "config.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=f"^{file}: .*expected"):
        configuration_of_run(file)


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
        # A scenario's numbers are taken over as a whole and tested with it; the aircraft's and the
        # table of rewards likewise.
        if not key.name.startswith(("scenarios[].", "aircraft.", "rewards."))
        and not re.search(rf"\.{key.name.rpartition('.')[2]}\b", program)
    ]
    assert not unused


# Every configuration key changes something: the compiled update, the start, or what a run leaves
# behind.

BASE = [
    "network.hidden=[4]",
    "environments=8",
    "rollout=8",
    "ppo.minibatch=32",
    "ppo.segment=4",
    "ppo.epochs=1",
    "pool_rows=2",
    "steps=640",
    "scenarios=[{name: circle, weight: 1.0}, {name: maneuvering, weight: 1.0}]",
]
CHANGED: dict[str, str] = {
    "steps": "1280",
    "network.hidden": "[5]",
    "network.feature_set": "none",
    "network.encoder": "[3]",
    "family.share": "0.5",
    "environments": "16",
    "rollout": "16",
    "ppo.epochs": "2",
    "ppo.minibatch": "16",
    "ppo.segment": "2",
    "learning_rate": "1e-3",
    "learning_rate_final": "1e-5",
    "discount": "0.9",
    "ppo.gae_lambda": "0.9",
    "ppo.clip": "0.1",
    "ppo.entropy": "0.1",
    "ppo.value": "0.3",
    "ppo.action_bound_coef": "0.1",
    "ppo.max_grad_norm": "0.3",
    "ppo.adam_epsilon": "1e-4",
    "ppo.normalize_advantage": "false",
    "reward_scale": "0.1",
    "aircraft.speed_min_mps": "40.0",
    "aircraft.speed_max_mps": "120.0",
    "aircraft.acceleration_min_mps2": "-1.0",
    "aircraft.acceleration_max_mps2": "1.0",
    "aircraft.yaw_rate_max_deg_s": "5.0",
    "aircraft.separation_m": "900.0",
    "aircraft.goal_radius_m": "400.0",
    "aircraft.dt_s": "0.5",
    "world.separation_spread": "0.1",
    "world.time_share": "0.8",
    "rewards.violation": "-50.0",
    "rewards.goal": "50.0",
    "rewards.timeout": "-5.0",
    "scenarios.0.name": "noisy",
    "scenarios.0.weight": "3.0",
    "scenarios.0.radius": "[2000, 3000]",
    "scenarios.0.own_speed": "[60, 70]",
    "scenarios.0.intruder_speed": "[60, 70]",
    "scenarios.0.course_difference_deg": "[-10, 10]",
    "scenarios.0.displacement": "100.0",
    "scenarios.0.min_initial_separation": "500.0",
    "scenarios.0.conflicts_closer_than": "900.0",
    "scenarios.0.intruders": "[2, 3]",
    "scenarios.0.turn_rate_deg_s": "1.0",
    "scenarios.0.heading_change_deg": "30.0",
    "scenarios.0.position_std": "10.0",
    "scenarios.0.velocity_std": "1.0",
    "scenarios.0.latency": "[0.5, 1.0]",
    "pool_rows": "4",
    "rewards.goal_distance": "50.0",
    "rewards.turn_rate": "-0.1",
    "rewards.heading_change": "-0.1",
    "rewards.path_excess": "-0.1",
}
CLIMBS = {
    "aircraft.climb_max_mps": "2.5",
    "aircraft.descent_max_mps": "3.0",
    "aircraft.vertical_acceleration_mps2": "0.5",
    "aircraft.vertical_separation_m": "137.2",
}
ELSEWHERE = {
    **dict.fromkeys(CLIMBS, "the aircraft of plans that climb; training is in the plane (below)"),
    "aircraft.traffic_speed_max_mps": (
        "what scenarios are refused, and observations of eight numbers"
    ),
    "phases": "the configuration of each phase (test_metrics)",
    **dict.fromkeys(
        ("family.speed_min", "family.acceleration", "family.turn_radius", "family.traffic_speed"),
        "the aircraft that are flown (test_devices)",
    ),
    "aircraft.vehicle": "the legs of plans (agents/planner/test_planner); training does not ask it",
    "algorithm": "what learns (test_own_algorithm)",
    "algorithm_settings": "how it learns (test_own_algorithm)",
    "network.inputs": "the policy file and what it decides (test_own_input)",
    "name": "the default name of the run's directory (test_cli)",
    "warm_start": "the networks that training begins with (test_checkpoint)",
    "seed": "the draws (test_loop: another seed is another run)",
    "evaluation.every_steps": "the metrics (test_loop)",
    "evaluation.encounters": "the metrics (test_loop)",
    "evaluation.final_encounters": "the summary (test_loop)",
    "evaluation.seed": "the encounters that are judged (below)",
    "aircraft.t_max_s": "the rules that are judged by (below)",
    "scenarios.0.units": "the scenario (test_configuration_world)",
    "checkpoint.every_seconds": "the checkpoints (test_loop)",
    "scenarios.0.attempts": "evaluation only: training fills a pool without attempts",
    **dict.fromkeys(
        ("scenarios.0.vertical_miss", "scenarios.0.vertical_rate"),
        "evaluation only: the modifier layered, which training refuses (eval/flights/test_in_space)",
    ),
}


def names(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Yield the dotted name of every leaf of a configuration model."""
    for name, field in model.model_fields.items():
        kind: Any = field.annotation
        if prefix == "" and name == "scenarios":
            kind = kind.__args__[0]
            name = "scenarios.0"  # noqa: PLW2901
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from names(kind, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}"


def programs(*overrides: str) -> Iterator[str]:
    """Yield the texts of the start and of the update that a configuration compiles to."""
    task = build(load(TrainConfig, None, [*BASE, *overrides]))
    state = jax.eval_shape(task.initial)
    yield jax.jit(task.initial).lower().as_text()
    yield jax.jit(task.update).lower(state).as_text()


@pytest.fixture(scope="module")
def base() -> tuple[str, ...]:
    return tuple(programs())


def test_no_key_is_forgotten_here() -> None:
    assert set(names(TrainConfig)) == set(CHANGED) | set(ELSEWHERE)


@pytest.mark.slow
def test_the_program_does_not_change_by_itself(base: tuple[str, ...]) -> None:
    assert tuple(programs()) == base


@pytest.mark.slow
def test_training_is_in_the_plane(base: tuple[str, ...]) -> None:
    assert tuple(programs(*(f"{key}={value}" for key, value in CLIMBS.items()))) == base


@pytest.mark.slow
@pytest.mark.parametrize("key", CHANGED)
def test_a_key_changes_the_program(key: str, base: tuple[str, ...]) -> None:
    """The update is made only where the start does not differ."""
    more = {
        "scenarios.0.intruders": "ppo.minibatch=16",
        "scenarios.0.heading_change_deg": "scenarios.0.turn_rate_deg_s=2.0",
    }.get(key)
    given, without = ([], base) if more is None else ([more], programs(more))
    changed = programs(f"{key}={CHANGED[key]}", *given)
    assert any(text != before for text, before in zip(changed, without, strict=True))


def test_the_time_limit_is_judged_by() -> None:
    assert build(load(TrainConfig, None, [*BASE, "aircraft.t_max_s=40.0"])).rules.t_max == 40.0


DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference"


@pytest.mark.parametrize("name", tables())
def test_the_pages_are_current(name: str):
    page = (DOCS / name).read_text(encoding="utf-8")
    assert with_tables(page, tables()[name]) == page, (
        "run `python -m rlcas_jax.reference docs/reference`"
    )


def test_every_key_and_every_metric_has_its_row():
    assert all(
        f"\n| `{key.name}` | " in tables()["configuration.md"][0] for key in keys(TrainConfig)
    )
    assert all(f"\n| `{name}` | " in tables()["metrics.md"][0] for name in METRICS)
    said = (DOCS / "metrics.md").read_text(encoding="utf-8")
    assert f"differ in {' and '.join(f'`{name}`' for name in WALL_CLOCK)} only" in said


def test_the_command_writes_the_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in tables():
        (tmp_path / name).write_text("before\n\n| a |\n|---|\n| b |\n\nafter\n", encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["reference", str(tmp_path)])
    main()
    for name, (table,) in tables().items():
        assert (tmp_path / name).read_text(encoding="utf-8") == f"before\n\n{table}\nafter\n"
