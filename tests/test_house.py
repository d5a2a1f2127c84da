"""The house rules that tools can check: import directions, what the flight path loads, what files may name."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("rlcas_jax", "envs", "agents", "eval", "ros_bridge")
FLIGHT_LIBRARIES = {"numpy", "safetensors"}
HEAVY_LIBRARIES = {"jax", "flax", "optax", "gymnasium", "matplotlib", "scipy", "pydantic", "pyproj"}


def flight_path() -> list[str]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    return next(contract["source_modules"] for contract in contracts if contract["id"] == "flight-path")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False
    )


def test_import_contracts_are_kept():
    program = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(cache_dir=None))"
    result = run("-X", "utf8", "-c", program)
    assert result.returncode == 0, result.stdout + result.stderr


def test_flight_path_imports_only_numpy_safetensors_and_itself():
    graph = grimp.build_graph(*PACKAGES, include_external_packages=True, cache_dir=None)
    # Importing a module runs its package's __init__ too.
    rooms = flight_path()
    modules = [
        *(name for room in rooms for name in (room, *graph.find_descendants(room))),
        *("envs", "agents", "agents.policy"),
    ]
    allowed = {*modules, *FLIGHT_LIBRARIES, *sys.stdlib_module_names}
    strays = {
        f"{module} -> {imported}"
        for module in modules
        for imported in graph.find_modules_directly_imported_by(module)
        if imported not in allowed
    }
    assert not strays, f"the flight path imports what it must not: {sorted(strays)}"


def test_flight_path_loads_no_heavy_library_in_a_fresh_interpreter():
    program = (
        "import importlib, sys\n"
        f"for name in {[*flight_path(), 'envs.formats']!r}: importlib.import_module(name)\n"
        f"print(sorted({HEAVY_LIBRARIES!r} & set(sys.modules)))\n"
    )
    result = run("-c", program)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "[]"


def project_files() -> list[Path]:
    """Return the files of the checkout that git tracks or would track; without git, those outside ignored folders."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=True,
        ).stdout.split("\0")
        paths = [ROOT / name for name in listed if name]
    except (OSError, subprocess.CalledProcessError):
        paths = []
        for folder, folders, names in os.walk(ROOT):
            folders[:] = [
                name
                for name in folders
                if name not in {".git", ".venv", "runs", "build", "dist", "__pycache__"}
                and not name.endswith((".egg-info", "_cache"))
                and name != ".hypothesis"
            ]
            paths += [Path(folder) / name for name in names]
    return [path for path in paths if path.is_file()]


# Written in pieces, so that this file does not name them either.
REGISTRY_HOSTS = [
    "py" + "pi.org",
    "python" + "hosted.org",
    "download.py" + "torch.org",
    "registry.npm" + "js.org",
    "deb.deb" + "ian.org",
    "ana" + "conda.org",
]
MACHINE_PATHS = ["/wo" + "rk/", "/ro" + "ot/", "/opt/py" + "pi", "/Us" + "ers/", "/ho" + "me/"]


@pytest.mark.parametrize(
    "pattern",
    [re.escape(host) for host in REGISTRY_HOSTS] + [rf"(?<![\w.~-]){re.escape(path)}" for path in MACHINE_PATHS],
)
def test_no_file_names_a_registry_or_a_path_of_one_machine(pattern: str):
    expression = re.compile(pattern.encode())
    files = project_files()
    assert ROOT / "pyproject.toml" in files
    naming = [str(path.relative_to(ROOT)) for path in files if expression.search(path.read_bytes())]
    assert not naming, f"{naming} match {pattern}"


# A policy, an aircraft or a sample is a thing: no pronoun for persons in code, keys, messages and pages.


# In pieces, so that this file does not hold them either. An underscore ends a word, so that keys and names count.
_PIECES = (("w", "ho"), ("wh", "oever"), ("w", "hom"), ("h", "e"), ("h", "im"), ("hi", "s"), ("to", "ld"))
WORD = re.compile(rf"(?<![a-z])({'|'.join(map(''.join, _PIECES))})(?![a-z])", re.IGNORECASE)
READ = {".cfg", ".css", ".g", ".html", ".md", ".msg", ".py", ".sdf", ".srv", ".svg", ".toml", ".xml", ".yaml", ".yml"}


def texts() -> list[str]:
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("git does not list the files")
    return [name for name in listed.split("\0") if Path(name).suffix in READ and (ROOT / name).is_file()]


def test_no_thing_is_called_a_person() -> None:
    found = [
        f"{name}:{number}: {line.strip()}"
        for name in texts()
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1)
        if WORD.search(line)
    ]
    assert not found, "\n".join(found)
