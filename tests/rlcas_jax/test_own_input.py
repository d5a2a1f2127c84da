"""An input of the network from a stranger's module: trained, written, refused without it, flown."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.config.load import ConfigError, load
from agents.learning.export import to_policy_file
from agents.learning.onnx import model
from agents.policy.file import PolicyFile, PolicyFileError, parse, serialise
from agents.policy.inference import Policy
from agents.policy.inputs import INPUTS, INTRUDER, OWNSHIP, Input, Number, register, resolve
from agents.policy.novelty import box_of, departures
from agents.policy.scene import random_scenes, unpack_rows
from agents.policy.schema import EXTENDED_SCHEMA, SetOf
from agents.policy.set_features import TABLE, set_inputs, table
from commands.command import InputError
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from rlcas_jax.config import TrainConfig
from rlcas_jax.training import train
from tests.agents.policies import FAMILY, random_policy
from tests.stranger import block_with, names_of, python, run, settle

MODULE = block_with("howto/own-policy.md", "def in_wake")
TINY = (
    "steps=64",
    "network={hidden: [8], encoder: [6], inputs: [my_inputs:wake]}",
    "environments=8",
    "rollout=4",
    "ppo={minibatch: 32, segment: 4}",
    "pool_rows=2",
    "evaluation={encounters: 4, final_encounters: 4}",
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working directory with the page's module, of which nothing has been imported."""
    return settle(tmp_path, monkeypatch, INPUTS, my_inputs=MODULE)


def wake() -> Input:
    """Return the input of the page."""
    return names_of(MODULE, "my_inputs")["wake"]


def _nearest(seen: Any, xp: Any) -> Any:
    away = xp.sqrt(seen.x**2 + seen.y**2 + 1e-6)
    least = xp.min(xp.where(seen.mask, away, 20.0), axis=-1)
    return xp.stack([1.0 / (1.0 + least), 0.1 * seen.goal_y / 20.0], axis=-1)


NEAREST = Input(
    "nearest",
    OWNSHIP,
    (Number("nearness of the nearest", "1", 0.0, 1.0), Number("goal aside", "20 D", -0.1, 0.1)),
    _nearest,
)


def content(*inputs: Input) -> PolicyFile:
    """Return a policy file of random weights with inputs."""
    of_set = SetOf((12,), 3, PAPER, FAMILY, inputs)
    return random_policy((16,), "set", of_set, spread=1.0, seed=4)


def scenes(count: int) -> tuple[VehicleState, VehicleState, np.ndarray, np.ndarray, np.ndarray]:
    drawn = encounters_of_seed(scenario("multi", PAPER, intruders=(1, 3)), 7, 0, count)
    seen = VehicleState(*(np.where(drawn.mask, field, 0.0) for field in drawn.intruders))
    return drawn.own, seen, drawn.mask, drawn.goal_x, drawn.goal_y


def test_the_module_of_the_page_is_short():
    assert len(MODULE.splitlines()) <= 40


@pytest.mark.slow
def test_sizes_contract_and_tensors_follow_from_the_table():
    made = content(wake(), NEAREST)
    assert made.metadata["schema"] == EXTENDED_SCHEMA
    assert [one["name"] for one in made.metadata["inputs"]] == ["wake", "nearest"]
    assert made.metadata["inputs"][0]["code"] == "my_inputs:wake"
    assert made.actor["each_0/kernel"].shape == (TABLE.intruder_size + 1, 12)
    assert made.actor["hidden_0/kernel"].shape == (TABLE.own_size + 2 + 12, 16)
    again = parse(serialise(made), "p")  # reading needs no code
    assert (again.sha256, again.metadata) == (made.sha256, made.metadata)


def test_policies_without_such_inputs_are_files_as_before():
    made = content()
    assert made.metadata["schema"]["version"] == 2
    assert "inputs" not in made.metadata


def test_a_file_is_refused_by_name_without_its_input():
    made = content(wake(), NEAREST)
    with pytest.raises(PolicyFileError, match=r"needs the input 'wake' \(my_inputs:wake\).*--ext"):
        Policy(made, inputs=[NEAREST])
    other = wake()._replace(numbers=(Number("in the wake", "D", -1.0, 1.0),))
    with pytest.raises(PolicyFileError, match=r"'wake' describes .*\(D, .* trained with .*\(1, "):
        Policy(made, inputs=[other, NEAREST])
    wrong = wake()._replace(compute=lambda scene, xp: -wake().compute(scene, xp))
    with pytest.raises(PolicyFileError, match="parity vector"):
        Policy(made, inputs=[wrong, NEAREST])
    register(wake())
    assert Policy(made, inputs=[NEAREST]).inputs.extra[0].name == "nearest"


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("inputs", [], "metadata.inputs has 0 inputs"),
        ("inputs", [3], r"metadata\.inputs\.0 is 3, expected an object"),
        ("of", "wind", r"metadata\.inputs\.0\.of is 'wind'"),
        ("numbers", [], r"metadata\.inputs\.0\.numbers is \[\]"),
        ("numbers", [{"name": "a"}], r"metadata\.inputs\.0\.numbers\.0 lacks"),
    ],
)
def test_a_damaged_contract_is_refused(field: str, value: Any, message: str):
    made = content(wake())
    entry = dict(made.metadata["inputs"][0])
    listed = value if field == "inputs" else [entry | {field: value}]
    broken = PolicyFile(
        made.actor, made.parity_observation, made.parity_action, {**made.metadata, "inputs": listed}
    )
    with pytest.raises(PolicyFileError, match=message):
        serialise(broken)


def test_one_aircraft_decides_as_a_batch_does_and_as_its_mirror_image():
    policy = Policy(content(wake(), NEAREST), np.float64, inputs=[wake(), NEAREST])
    own, others, mask, goal_x, goal_y = scenes(60)
    batch = policy.command(own, others, mask, goal_x, goal_y)
    image = policy.command(
        own._replace(y=-own.y, heading=-own.heading),
        others._replace(y=-others.y, heading=-others.heading),
        mask,
        goal_x,
        -goal_y,
    )
    np.testing.assert_allclose(image, batch * [1.0, -1.0], atol=1e-9)
    for row in range(60):
        one = VehicleState(*(float(field[row]) for field in own))
        each = [
            VehicleState(*(float(field[row, k]) for field in others))
            for k in np.flatnonzero(mask[row])
        ]
        alone = policy.command_one(one, each, float(goal_x[row]), float(goal_y[row]))
        np.testing.assert_allclose(alone, batch[row], atol=1e-5)
    nobody = policy.command(own, others, mask & False, goal_x, goal_y)
    first = VehicleState(*(float(field[0]) for field in own))
    alone = policy.command_one(first, [], float(goal_x[0]), float(goal_y[0]))
    np.testing.assert_allclose(alone, nobody[0], atol=1e-5)


def test_the_input_changes_what_the_policy_decides():
    """Else the tests above would pass with a table that is not used."""
    own, others, mask, goal_x, goal_y = scenes(20)
    made = content(wake())
    silent = dict(made.actor)
    silent["each_0/kernel"] = silent["each_0/kernel"].copy()
    silent["each_0/kernel"][TABLE.intruder_size] = 0.0
    weights = {"trunk": {}, "log_std": silent.pop("log_std")}
    for name, tensor in silent.items():
        layer, part = name.split("/")
        weights["trunk"].setdefault(layer, {})[part] = tensor
    without = to_policy_file({"params": weights}, made.metadata, [wake()])
    both = [
        Policy(one, inputs=[wake()]).command(own, others, mask, goal_x, goal_y)
        for one in (made, without)
    ]
    assert np.abs(both[0] - both[1]).max() > 1e-2


def test_novelty_names_an_input_outside_its_bounds():
    inputs = table([wake()])
    box = box_of("0" * 64, inputs)
    own, each = [0.0] * inputs.own_size, [[0.0] * inputs.intruder_size]
    own[8:12] = 0.0, -0.5, 0.5, 0.5
    assert departures(box, inputs, own, each) == []
    each[0][-1] = 1.5
    (said,) = departures(box, inputs, own, each)
    assert said.quantity == "novelty: in the wake (intruder 0)"
    assert said.text == "is 1.5; its bounds are -1 to 1"


def test_the_shipped_inputs_keep_the_bounds_of_their_table():
    seen = set_inputs(unpack_rows(random_scenes(5, FAMILY).astype(float)), np)
    for numbers, values in (
        (TABLE.own_numbers, seen.own),
        (TABLE.intruder_numbers, seen.traffic[seen.mask]),
    ):
        low, high = np.array([(one.low, one.high) for one in numbers]).T
        assert (values >= low).all()
        assert (values <= high).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"of": "wind"}, "of is 'wind'; expected 'ownship' or 'intruder'"),
        ({"numbers": ()}, "has no numbers"),
        ({"numbers": (Number("a", "1", 1.0, 1.0),)}, "bounds 1 to 1"),
        ({"numbers": (Number("a", "1", 0.0, 0.1),)}, "a is .* expected 0 to 0.1, its bounds"),
        ({"of": OWNSHIP}, r"computes \(128, 3, 1\).*expected \(128, 1\)"),
        ({"compute": lambda scene, xp: scene.x[..., None] * np.nan}, "is nan"),
        ({"compute": lambda scene, xp: scene.wind}, "fails with AttributeError"),
        ({"compute": lambda scene, xp: 1.0}, "computes float"),
    ],
)
def test_an_input_that_cannot_be_used_is_refused(changes: dict[str, Any], message: str):
    with pytest.raises(InputError, match=f"input 'wake'.*{message}"):
        register(wake()._replace(**changes))


@pytest.mark.parametrize(
    "compute",
    [
        lambda scene, xp: np.abs(np.sqrt(scene.x**2 + 1.0))[..., None] * 0.0,
        lambda scene, xp: scene.x[..., None] * (0.0 if scene.own_speed.sum() > 0.0 else 0.1),
    ],
)
def test_what_only_numpy_can_do_is_refused_before_anything_is_written(compute: Any, tmp_path: Path):
    register(wake()._replace(compute=compute))
    config = load(TrainConfig, None, ["network.inputs=[wake]"])
    line = compute.__code__.co_firstlineno
    says = rf"input 'wake': fails with Tracer.*; use xp.* \(.*test_own_input.py, line {line}\)"
    with pytest.raises(InputError, match=says) as raised:
        train(config, tmp_path / "run")
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "run").exists()


def test_names_that_lead_nowhere_are_refused():
    with pytest.raises(InputError, match="'wake' is unknown"):
        resolve(["wake"])
    with pytest.raises(InputError, match="no module 'no_such_module'"):
        resolve(["no_such_module:wake"])
    with pytest.raises(InputError, match="input 'math:pi' is of type float"):
        resolve(["math:pi"])
    with pytest.raises(InputError, match="'intruder' stands twice"):
        table([wake()._replace(name="intruder", of=INTRUDER)])


def test_a_registered_input_is_named_in_a_configuration():
    register(wake())
    config = load(TrainConfig, None, ["network.inputs=[wake]"])
    assert config.network.input_table().extra[0].name == "wake"
    missing = load(TrainConfig, None, ["network.inputs=[wind]"])
    with pytest.raises(
        ConfigError, match=r"network\.inputs: input 'wind' is unknown; expected one of wake, or mod"
    ):
        missing.network.input_table()
    with pytest.raises(ConfigError, match=r"expected set with network\.inputs"):
        load(TrainConfig, None, ["network.inputs=[wake]", "network.feature_set=mirror"])


@pytest.mark.slow
def test_onnx_has_the_input_too():
    pytest.importorskip("onnx")
    pytest.importorskip("jax2onnx")
    evaluator = pytest.importorskip("onnx.reference").ReferenceEvaluator
    from agents.learning.onnx import inputs_of

    made = content(wake(), NEAREST)
    (actions,) = evaluator(model(made, [wake(), NEAREST])).run(None, inputs_of(made))
    np.testing.assert_allclose(actions, made.parity_action, atol=1e-4)


@pytest.mark.slow
@pytest.mark.long
def test_a_stranger_trains_evaluates_and_exports_it(tmp_path: Path):
    sets = [part for text in TINY for part in ("--set", text)]
    python(tmp_path, "-m", "rlcas_jax.train", *sets, "--out", "run")
    policy = ("--policy", "run/policy.safetensors")
    flight = ("-m", "eval.monte_carlo", *policy, "--encounters", "50", "--set", "figures=false")

    refused = run(tmp_path, *flight, "--out", "refused")
    assert refused.returncode == 2
    assert "needs the input 'wake' (my_inputs:wake)" in refused.stderr
    assert "--extension my_inputs:wake" in refused.stderr
    assert "Traceback" not in refused.stderr

    extension = ("--extension", "my_inputs:wake")
    for name, more in {
        "one": ("--workers", "1"),
        "two": ("--workers", "2", "--set", "chunk=25"),
        "jax": ("--workers", "1", "--set", "backend=jax"),
    }.items():
        flown = run(tmp_path, *flight, *extension, *more, "--out", name)
        assert flown.returncode == 0, flown.stderr
    one, two = (pq.read_table(tmp_path / name / "encounters.parquet") for name in ("one", "two"))
    assert one.num_rows == 50
    assert repr(one.to_pydict()) == repr(two.to_pydict())  # nan is not equal to itself
    report = run(tmp_path, "-m", "eval.report", "one", "--tracks", "5", *extension)
    assert report.returncode == 0, report.stderr
    beside = ("--encounters", "10", "--baseline", "none", "--out", "beside")
    compared = run(tmp_path, "-m", "eval.compare", *policy, *extension, *beside)
    assert compared.returncode == 0, compared.stderr

    reading = (
        "import sys; from agents.policy.file import read; from agents.inference import Policy\n"
        "read('run/policy.safetensors')\n"
        "try: Policy.load('run/policy.safetensors')\n"
        "except ValueError: pass\n"
        "assert 'my_inputs' not in sys.modules\n"
        "from my_inputs import wake\n"
        "print(Policy.load('run/policy.safetensors', inputs=[wake]).inputs.extra[0].name)"
    )
    loaded = run(tmp_path, "-c", reading)
    assert (loaded.returncode, loaded.stdout) == (0, "wake\n"), loaded.stderr
