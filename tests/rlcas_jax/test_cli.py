import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

from agents.config.keys import keys
from agents.config.load import ConfigError, load
from rlcas_jax.cli import Options, parse, write_configurations
from rlcas_jax.config import TrainConfig

ROOT = Path(__file__).resolve().parents[2]
MOMENT = datetime(2026, 1, 31, 12, 0, 0, tzinfo=UTC)


def written(options: Options) -> None:
    for job in options.jobs:
        job.directory.mkdir(parents=True, exist_ok=True)
    write_configurations(options)


def test_without_arguments_the_defaults_are_trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    options = parse([], now=MOMENT)
    assert options.directory == Path("runs/train-20260131T120000-0")
    (job,) = options.jobs
    assert (job.config, job.directory, job.resume) == (TrainConfig(), options.directory, False)
    assert not options.quiet
    assert not list(tmp_path.iterdir())


def test_arguments_reach_the_configuration(tmp_path: Path):
    file = tmp_path / "a.yaml"
    file.write_text("name: a\nsteps: 7\n")
    argv = ["--config", str(file), "--set", "seed=5", "--set", "ppo.clip=0.3", "--steps", "1e6", "--quiet"]
    options = parse([*argv, "--out", str(tmp_path / "out")])
    config = options.jobs[0].config
    assert (config.name, config.seed, config.ppo.clip, config.steps) == ("a", 5, 0.3, 1_000_000)
    assert options.quiet


def test_several_seeds_are_several_runs(tmp_path: Path):
    options = parse(["--set", "seed=4", "--seeds", "3", "--out", str(tmp_path / "out")])
    assert [job.config.seed for job in options.jobs] == [4, 5, 6]
    assert [job.directory.name for job in options.jobs] == ["seed-0", "seed-1", "seed-2"]
    written(options)
    assert load(TrainConfig, tmp_path / "out" / "seed-2" / "config.yaml").seed == 6


@pytest.mark.parametrize("seeds", [1, 11])
def test_a_resumed_run_is_the_prepared_one(tmp_path: Path, seeds: int):
    out = tmp_path / "out"
    fresh = parse(["--set", "ppo.clip=0.3", "--seeds", str(seeds), "--out", str(out)])
    written(fresh)
    checkpoints = fresh.jobs[0].directory / "checkpoints"
    checkpoints.mkdir()
    (checkpoints / "checkpoint-0000000003.safetensors").touch()
    resumed = parse(["--resume", str(out), "--quiet"])
    written(resumed)
    assert [job.config for job in resumed.jobs] == [job.config for job in fresh.jobs]
    assert [job.directory for job in resumed.jobs] == [job.directory for job in fresh.jobs]
    # What was not begun yet begins.
    assert [job.resume for job in resumed.jobs] == [True] + [False] * (seeds - 1)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--config", "none.yaml"], "none.yaml: there is no such file"),
        (["--set", "ppo.clipp=1"], "--set: ppo.clipp is unknown (its value is 1); did you mean ppo.clip?"),
        (["--steps", "1.5"], "--set: steps is 1.5; expected a whole number at least 1 and at most 1e+12"),
        (["--seeds", "0"], "--seeds is 0; expected 1 to 2147483648 (seeds are below 2147483648)"),
        (
            ["--set", "seed=2147483647", "--seeds", "2"],
            "--seeds is 2; expected 1 to 1 (seeds are below 2147483648)",
        ),
        (
            ["--seeds", "x"],
            "argument --seeds: invalid int value: 'x' (see python -m rlcas_jax.train --help)",
        ),
        (["--resume", "none"], "--resume none: there is no such directory"),
        (["--resume", "."], "--resume .: it holds no config.yaml, so it is no run"),
        (
            ["--resume", ".", "--steps", "3"],
            "--steps cannot change a run that is resumed; leave it out, or start a new run without --resume",
        ),
        (["--conf", "x"], "unrecognized arguments: --conf x (see python -m rlcas_jax.train --help)"),
    ],
)
def test_bad_arguments_are_refused_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], sentence: str
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError) as caught:
        parse(arguments)
    assert str(caught.value) == sentence


def test_a_directory_in_use_is_not_overwritten(tmp_path: Path):
    (tmp_path / "file").touch()
    for out in (tmp_path, tmp_path / "file"):
        with pytest.raises(ConfigError, match="exists and is not empty; name another, or go on with it by --resume"):
            parse(["--out", str(out)])
    (tmp_path / "empty").mkdir()
    assert parse(["--out", str(tmp_path / "empty")]).directory == tmp_path / "empty"


def test_a_key_that_the_phases_set_themselves_is_refused(tmp_path: Path):
    phases = "phases=[{steps: 100, ppo: {epochs: 1}}, {steps: 200}]"
    for given, key in (("steps=7", "steps"), ("ppo.epochs=2", "ppo.epochs")):
        with pytest.raises(ConfigError, match=rf"{key} is set by phase 0 itself; expected phases\.0\.{key}"):
            parse(["--set", phases, "--set", given, "--out", str(tmp_path / "out")])
    options = parse(["--set", phases, "--set", "phases.1.steps=7", "--out", str(tmp_path / "out")])
    assert [phase.steps for phase in options.jobs[0].config.in_phases()] == [100, 7]


def test_help_lists_every_key_and_loads_nothing_heavy():
    program = (
        "import sys\n"
        "from rlcas_jax.cli import parse\n"
        "try: parse(['--help'])\n"
        "except SystemExit as end: assert end.code == 0\n"
        "heavy = {'jax', 'flax', 'optax', 'matplotlib', 'rich', 'tensorboardX', 'scipy'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    for key in keys(TrainConfig):
        assert f"\n  {key.name}: " in result.stdout
    for option in ("--config", "--set", "--resume", "--out", "--seeds", "--steps", "--quiet"):
        assert option in result.stdout
