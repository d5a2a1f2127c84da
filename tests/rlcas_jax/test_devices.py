"""The environments of a training: on several devices and in several processes as on one, and a
family of aircraft.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError, load
from envs.aircraft import Ratios, ratios
from envs.kinematics import Limits
from rlcas_jax import metrics
from rlcas_jax.cli import Processes, parse
from rlcas_jax.config import TrainConfig
from rlcas_jax.devices import compiler_options
from rlcas_jax.finish import set_of
from rlcas_jax.ownships import ownships
from rlcas_jax.starts import draw
from rlcas_jax.task import _check_split, build

# One minibatch and one epoch: nothing depends on the shuffle.
WHOLE = """\
name: whole
steps: 6144
network: {hidden: [16, 16], feature_set: mirror}
environments: 32
rollout: 32
ppo: {minibatch: 1024, segment: 8, epochs: 1}
world: {separation_spread: 0.08}
scenarios: [{name: circle}, {name: multi, intruders: [2, 3]}]
pool_rows: 4
evaluation: {every_steps: 2048, encounters: 64, final_encounters: 64}
checkpoint: {every_seconds: 0.0}
"""


@pytest.fixture(scope="module")
def config_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "whole.yaml"
    path.write_text(WHOLE)
    return path


def start(*arguments: object) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "rlcas_jax.train", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"XLA_FLAGS": ""},
    )


def output_of(process: "subprocess.Popen[str]", status: int = 0) -> str:
    output, _ = process.communicate(timeout=1_200)
    assert process.returncode == status, output
    return output


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def pair(*arguments: object) -> list["subprocess.Popen[str]"]:
    """Start two processes that train together."""
    address = f"127.0.0.1:{free_port()}"
    common = [*arguments, "--coordinator", address, "--processes", 2]
    return [start(*common, "--process", number) for number in range(2)]


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory, config_file: Path) -> Path:
    out = tmp_path_factory.mktemp("alone") / "run"
    output_of(start("--config", config_file, "--out", out))
    return out


def assert_same_curve(out: Path, expected: Path) -> None:
    """Compare all figures of two runs but those of the clock; sums over devices round
    differently.
    """
    curve, wanted = metrics.read(out), metrics.read(expected)
    assert curve.keys() == wanted.keys()
    assert len(curve["step"]) == 6
    for name in curve.keys() - {"wall_s", "steps_per_s"}:
        np.testing.assert_allclose(curve[name], wanted[name], rtol=2e-3, atol=2e-4, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("devices", [2, 4])
def test_virtual_devices_learn_what_one_learns(
    devices: int, tmp_path: Path, config_file: Path, alone: Path
) -> None:
    output_of(start("--config", config_file, "--out", tmp_path / "run", "--devices", devices))
    assert_same_curve(tmp_path / "run", alone)


@pytest.mark.slow
def test_two_processes_learn_what_one_learns_and_the_first_one_writes(
    tmp_path: Path, config_file: Path, alone: Path
) -> None:
    outputs = [
        output_of(process) for process in pair("--config", config_file, "--out", tmp_path / "run")
    ]
    assert_same_curve(tmp_path / "run", alone)
    assert "resolved, of all" in outputs[0]
    assert "resolved" not in outputs[1]
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == sorted(
        p.name for p in alone.iterdir()
    )


@pytest.mark.slow
def test_a_run_of_two_processes_is_stopped_by_either_and_goes_on_on_two_devices(
    tmp_path: Path, config_file: Path
) -> None:
    out = tmp_path / "run"
    processes = pair("--config", config_file, "--set", "steps=40960", "--out", out)
    deadline = time.monotonic() + 1_200
    while (
        time.monotonic() < deadline and len(metrics.read(out / metrics.FILE).get("update", ())) < 2
    ):
        time.sleep(0.02)
    processes[1].send_signal(signal.SIGINT)
    for process in processes:
        output_of(process, 130)
    stopped = json.loads((out / "summary.json").read_text())
    assert not stopped["finished"]
    output_of(start("--resume", out, "--devices", 2))
    assert json.loads((out / "summary.json").read_text())["finished"]
    np.testing.assert_array_equal(metrics.read(out)["update"], np.arange(1, 41))


@pytest.mark.parametrize(
    ("devices", "overrides", "message"),
    [
        (3, [], r"environments is 1024; expected a multiple of 3 devices"),
        (
            2,
            ["ppo.minibatch=16"],
            r"ppo\.minibatch is 16; expected a multiple of 2 devices times segment, 32",
        ),
    ],
)
def test_what_cannot_be_split_is_refused(devices: int, overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        _check_split(load(TrainConfig, None, overrides), devices)


@pytest.mark.slow
def test_a_platform_without_devices_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    environment = {**os.environ, "JAX_PLATFORMS": "rocm"}
    programs = (
        "import jax; from rlcas_jax.devices import connect; connect()",
        "from agents.inference import Policy; from eval.flights.compiled import Compiled; "
        "Compiled(Policy.load())",
        "from rlcas_jax.sweep.run import main; main(['--config', 'quick', '--space', 'sweep_quick', "
        f"'--trials', '1', '--out', {str(tmp_path / 'sweep')!r}])",
    )
    for code in programs:
        guarded = f"from commands.command import run_cli\ndef main(): exec({code!r})\nrun_cli(main)"
        done = subprocess.run(
            [sys.executable, "-c", guarded],
            cwd=Path(__file__).resolve().parents[2],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 2, done.stderr
        sentence = done.stderr.splitlines()[-1]
        assert sentence.startswith(
            "error: JAX_PLATFORMS is rocm, of which JAX finds no device; expected one that there "
            "is: cpu"
        )
        assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--devices", "0"], "--devices: '0'; expected a whole number of at least 1"),
        (["--processes", "2"], "--processes and --process need --coordinator"),
        (["--coordinator", "here"], "--coordinator is 'here'; expected HOST:PORT"),
        (
            ["--coordinator", "here:1", "--processes", "2"],
            "--process is None of --processes 2; expected both",
        ),
        (
            ["--coordinator", "here:1", "--processes", "2", "--process", "2"],
            "--process is 2 of --processes 2",
        ),
        (
            ["--config", "quick", "--coordinator", "here:1", "--processes", "2", "--process", "1"],
            "needs --out",
        ),
    ],
)
def test_what_is_said_of_processes_is_checked(arguments: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse(arguments)


def test_processes_are_read(tmp_path: Path) -> None:
    where = ["--config", "quick", "--out", str(tmp_path / "run")]
    assert parse(
        [*where, "--coordinator", "a:9", "--processes", "2", "--process", "1"]
    ).processes == Processes("a:9", 2, 1)
    assert parse([*where, "--coordinator", "auto"]).processes == Processes("auto", None, None)


# A family of aircraft in one training, and the network for any number of intruders that learns to
# fly them.

TINY = [
    "network={hidden: [8], feature_set: set, encoder: [6]}",
    "environments=32",
    "rollout=8",
    "ppo={minibatch: 64, segment: 4, epochs: 1}",
    "pool_rows=4",
    "steps=512",
    "scenarios=[{name: circle}, {name: circle, intruders: [2, 3]}]",
]
FAMILY = (
    "family={share: 0.5, speed_min: [0.4, 0.5], acceleration: [0.1, 0.2], turn_radius: [0.5, 1.0]}"
)


def tiny(*changes: str) -> TrainConfig:
    return load(TrainConfig, None, [*TINY, *changes])


def test_aircraft_lie_in_the_family_and_the_share_is_kept() -> None:
    config = tiny(FAMILY, "environments=2048", "ppo.minibatch=1024")
    flying = ownships(config)
    found = ratios(
        Limits(*(np.asarray(field, float) for field in flying.limits)), config.aircraft.separation_m
    )
    bounds = Ratios((0.4, 0.5), (-0.2, -0.1), (0.1, 0.2), (0.5, 1.0))
    for values, (low, high) in zip(found, bounds, strict=True):
        other = values[flying.of_family]
        assert low - 1e-6 <= other.min() < low + 0.1 * (high - low)
        assert high + 1e-6 >= other.max() > high - 0.1 * (high - low)
    assert 0.45 < flying.of_family.mean() < 0.55
    own = ratios(config.aircraft.limits(), config.aircraft.separation_m)
    np.testing.assert_allclose(
        [np.unique(values[~flying.of_family])[0] for values in found], own, rtol=1e-6
    )
    assert not ownships(tiny()).of_family.any()


def test_every_ownship_begins_at_a_speed_that_it_flies() -> None:
    config = tiny(FAMILY)
    limits = ownships(config).limits
    starts = jax.jit(lambda key: draw(key, config, config.training_scenarios(), 6))(
        jax.random.key(0)
    )
    assert np.all(starts.own.speed >= limits.speed_min - 1e-3)
    assert np.all(starts.own.speed <= limits.speed_max + 1e-3)
    assert starts.mask.shape == (6, 32, 3)


@pytest.mark.slow
def test_an_update_learns_from_sets() -> None:
    task = build(tiny(FAMILY))
    state = task.initial()
    before = jax.device_get(state.learner.actor)
    after, figures = task.update(state)
    assert bool(figures["finite"])
    moved = jax.tree.map(
        lambda a, b: float(jnp.abs(a - b).max()), before, jax.device_get(after.learner.actor)
    )
    assert moved["params"]["trunk"]["each_0"]["kernel"] > 0.0


def test_a_policy_file_says_which_aircraft_were_trained() -> None:
    assert set_of(tiny(FAMILY)).family["turn_radius"] == (0.5, pytest.approx(1.9098593))
    assert set_of(tiny(FAMILY)).intruders == 3
    assert set_of(tiny()).family["speed_min"] == (0.5, 0.5)


@pytest.mark.parametrize(
    "wrong", ["speed_min: [0.9, 0.1]", "turn_radius: [0.0, 1.0]", "traffic_speed: [0.5, 9.0]"]
)
def test_a_family_that_cannot_be_is_refused(wrong: str) -> None:
    with pytest.raises(ConfigError, match=wrong.split(":", maxsplit=1)[0]):
        tiny(f"family={{share: 0.5, {wrong}}}")


def test_a_gpu_compiles_with_the_options_that_the_user_has_not_set(monkeypatch: pytest.MonkeyPatch):
    assert compiler_options() is None  # on a CPU
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    monkeypatch.setenv("XLA_FLAGS", "--xla_gpu_autotune_level=4")
    options = compiler_options()
    assert options == {"xla_gpu_enable_triton_gemm": False}
    # The compiler knows them, whatever the device: an unknown name is an error.
    compiled = jax.jit(lambda x: x + 1.0, compiler_options=options)
    assert float(compiled(1.0)) == 2.0
