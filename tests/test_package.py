"""The package that a user installs: commands, configurations that ship, and a wheel in a bare
environment.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import import_module
from pathlib import Path

import pytest

from agents.config.load import AIRCRAFT, VEHICLES, ConfigError, file_of, load
from agents.config.world import AircraftConfig
from eval.config import MonteCarloConfig
from rlcas_jax.config import TrainConfig

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
NAMES = {kind: sorted((ROOT / "configs").glob(kind)) for kind in ("*.yaml", AIRCRAFT, VEHICLES)}
COPIED = ("agents", "commands", "envs", "eval", "rlcas_jax", "ros_bridge", "configs")
FLIGHT_PATH = next(
    c for c in PROJECT["tool"]["importlinter"]["contracts"] if c["id"] == "flight-path"
)
PROGRAM = f"""
import importlib
from importlib.metadata import version
from agents.inference import Policy
for name in {FLIGHT_PATH["source_modules"]}: importlib.import_module(name)
print(version("rlcas-toolkit"), Policy.load().sha256)
"""


@pytest.mark.parametrize("kind", NAMES)
def test_each_configuration_is_found_by_its_name(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = kind.rpartition("/")[2].partition("*")[0]
    assert NAMES[kind]
    for file in NAMES[kind]:
        assert file_of(Path(file.stem.removeprefix(before)), kind).samefile(file)


def test_names_stand_for_files_in_options_and_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    uas = load(AircraftConfig, ROOT / "configs/aircraft/uas.yaml")
    assert load(TrainConfig, Path("quick"), ["aircraft=uas"]).aircraft == uas
    vehicles = (
        load(MonteCarloConfig, None, [f"planner.vehicle={name}"]).planner.vehicle
        for name in ("c208", ROOT / "configs/vehicle_c208.yaml")
    )
    assert len(set(map(repr, vehicles))) == 1


def test_a_file_of_the_user_goes_before_one_that_ships(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("quick").write_text("seed: 7\n")
    assert load(TrainConfig, Path("quick")).seed == 7
    Path("uas").mkdir()  # a folder is no configuration
    assert load(TrainConfig, None, ["aircraft=uas"]).aircraft.separation_m < 1000.0


@pytest.mark.parametrize(
    ("name", "kind", "close"), [("quik", "*.yaml", "quick"), ("kite", AIRCRAFT, "uas")]
)
def test_a_wrong_name_lists_the_names(name: str, kind: str, close: str) -> None:
    with pytest.raises(ConfigError, match=rf"'{name}' .* expected one of .*{close}"):
        file_of(Path(name), kind)


def test_every_console_command_leads_to_a_main_function() -> None:
    for name, target in PROJECT["project"]["scripts"].items():
        module, _, attribute = target.partition(":")
        command = getattr(import_module(module), attribute)
        if module == "commands.command":
            module, _, attribute = command.args[0].partition(":")
            assert attribute == "main"
            assert callable(import_module(module).main), name


def test_versions_agree() -> None:
    package = (ROOT / "package.xml").read_text()
    assert f"<version>{PROJECT['project']['version']}</version>" in package


def start(*command: str | Path, folder: Path) -> str:
    """Return what a command prints, run in a folder as from a user's own shell."""
    clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [*map(str, command)], cwd=folder, env=clean, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the wheel, built from a copy of the sources."""
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("built")
    for name in COPIED:
        shutil.copytree(
            ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in (
        "pyproject.toml",
        "setup.py",
        "setup.cfg",
        "package.xml",
        "LICENSE",
        "README.md",
        "resource",
    ):
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, source / name)
    build = (
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
        built,
        source,
    )
    start(sys.executable, *build, folder=source)
    return next(built.glob("*.whl"))


@pytest.mark.slow
def test_a_wheel_holds_every_data_file_of_the_packages(wheel: Path) -> None:
    held = zipfile.ZipFile(wheel).namelist()
    files = (
        path
        for name in PROJECT["tool"]["importlinter"]["root_packages"]
        for path in (ROOT / name).rglob("*.*")
    )
    data = [
        path.relative_to(ROOT).as_posix()
        for path in files
        if path.is_file() and "__pycache__" not in path.parts
    ]
    data += [f"agents/{path.relative_to(ROOT)}" for path in (ROOT / "configs").rglob("*.yaml")]
    assert not sorted(set(data) - set(held))


def install_wheel(python: str, wheel: Path, extras: str, folder: Path, *more: str) -> Path:
    """Return the scripts' folder of a new environment that holds the wheel, its dependencies as
    pinned, and more.
    """
    start(python, "-m", "venv", folder / "bare", folder=folder)
    pins = folder / "pins.txt"
    named = re.sub(r" \\\n(?: +--hash=.*\n?)+", "\n", (ROOT / "constraints/run.txt").read_text())
    pins.write_text(
        "\n".join(
            line for line in named.splitlines() if not (more and line.startswith("gymnasium=="))
        )
    )
    install = (
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-compile",
        "-c",
        pins,
        f"{wheel}{extras}",
        *more,
    )
    start(folder / "bare/bin/python", *install, folder=folder)
    return folder / "bare/bin"


@pytest.mark.slow
def test_an_installed_wheel_trains_and_evaluates_from_any_folder(
    wheel: Path, tmp_path: Path
) -> None:
    scripts = install_wheel(sys.executable, wheel, "[train,sweep]", tmp_path)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    version = f"rlcas-toolkit {PROJECT['project']['version']}"
    for name in PROJECT["project"]["scripts"]:
        assert f"usage: {name}" in start(scripts / name, "--help", folder=elsewhere)
    assert version in start(scripts / "rlcas-train", "--version", folder=elsewhere)
    few = (
        "--steps",
        "1",
        "--set",
        "evaluation.final_encounters=64",
        "--set",
        "aircraft=light",
        "--out",
        "trained",
    )
    start(scripts / "rlcas-train", "--config", "quick", *few, folder=elsewhere)
    few = (
        "--aircraft",
        "light",
        "--encounters",
        "64",
        "--set",
        "figures=false",
        "--workers",
        "1",
        "--out",
        "flown",
    )
    start(
        scripts / "rlcas-evaluate", "--policy", "trained/policy.safetensors", *few, folder=elsewhere
    )
    assert (elsewhere / "flown/summary.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_the_flight_path_runs_from_a_wheel_on_python(
    version: str, wheel: Path, tmp_path: Path
) -> None:
    python = shutil.which(f"python{version}")
    if (
        python is None
        or subprocess.run([python, "-c", ""], capture_output=True, check=False).returncode
    ):
        pytest.skip(f"there is no python{version} here")
    scripts = install_wheel(python, wheel, "", tmp_path)
    said = start(scripts / "python", "-W", "error", "-c", PROGRAM, folder=tmp_path).split()
    assert said[0] == PROJECT["project"]["version"]
    assert "certificate" in start(scripts / "rlcas-check", "--version", folder=tmp_path)


@pytest.mark.slow
@pytest.mark.long
def test_a_learner_of_others_trains_under_gymnax_as_the_page_says(
    wheel: Path, tmp_path: Path
) -> None:
    # gymnax wants an older Gymnasium than is pinned.
    scripts = install_wheel(sys.executable, wheel, "[gymnax]", tmp_path, "rejax==0.1.3", "pytest")
    bare = (
        "-m",
        "pytest",
        "-q",
        "-c",
        os.devnull,
        "--noconftest",
        "--import-mode=importlib",
        "-p",
        "no:cacheprovider",
    )
    assert "passed" in start(
        scripts / "python", *bare, ROOT / "tests/rlcas_jax/test_gymnax_env.py", folder=tmp_path
    )
    page = (ROOT / "docs/howto/gymnasium.md").read_text()
    (program,) = (
        block
        for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL)
        if "import gymnax" in block
    )
    before, _, after = map(
        float, start(scripts / "python", "-c", program, folder=tmp_path).strip("[] \n").split()
    )
    assert after > before + 10.0
