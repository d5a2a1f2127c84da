"""The house rules that `make lint` does not check: the flight path, registries, and
numbers of the paper.
"""

import ast
import io
import os
import re
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("rlcas_jax", "commands", "envs", "agents", "eval", "ros_bridge")
FLIGHT_LIBRARIES = {"numpy", "safetensors"}
COMPILER = "envs.compiled", "numba"  # only once somebody asks for compiled code
HEAVY_LIBRARIES = {
    "numba",
    "jax",
    "flax",
    "optax",
    "gymnasium",
    "matplotlib",
    "scipy",
    "pydantic",
    "pyproj",
}


def flight_path() -> list[str]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    return next(
        contract["source_modules"] for contract in contracts if contract["id"] == "flight-path"
    )


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )


def test_flight_path_imports_only_numpy_safetensors_and_itself():
    # What stands under TYPE_CHECKING is for the type checker and never imported.
    graph = grimp.build_graph(
        *PACKAGES,
        include_external_packages=True,
        exclude_type_checking_imports=True,
        cache_dir=None,
    )
    # Importing a module runs its package's __init__ too.
    rooms = flight_path()
    modules = [
        *(name for room in rooms for name in (room, *graph.find_descendants(room))),
        "commands",
        "envs",
        "agents",
        "agents.policy",
    ]
    allowed = {*modules, *FLIGHT_LIBRARIES, *sys.stdlib_module_names}
    strays = {
        f"{module} -> {imported}"
        for module in modules
        for imported in graph.find_modules_directly_imported_by(module)
        if imported not in allowed and (module, imported) != COMPILER
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


def test_no_module_imports_itself_through_others():
    # With what stands under TYPE_CHECKING: it makes two modules one, too.
    graph = grimp.build_graph(*PACKAGES, "benchmarks", cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as problem:
        pytest.fail(f"a circle of imports: {' <- '.join(problem.args[1])}")


UPPER = {"rlcas_jax", "eval", "ros_bridge", "benchmarks"}


@pytest.mark.parametrize("floor", ["commands", "envs", "agents"])
def test_tests_of_a_lower_floor_use_no_upper_one(floor: str):
    strays = {
        f"{path.relative_to(ROOT)} -> {name}"
        for path in [*(ROOT / "tests" / floor).rglob("*.py"), ROOT / "tests" / "support.py"]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for name in _imported(node)
        if UPPER & set(name.split(".")[:2])  # tests.eval, too
    }
    assert not strays, f"expected what stands on the tests' own floor: {sorted(strays)}"


def _imported(node: ast.AST) -> list[str]:
    """Return the names of the modules that a statement imports."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module] if isinstance(node, ast.ImportFrom) and node.module else []


def project_files() -> list[Path]:
    """Return the files of the checkout that git tracks or would track; without git, those outside
    ignored folders.
    """
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
    [re.escape(host) for host in REGISTRY_HOSTS]
    + [rf"(?<![\w.~-]){re.escape(path)}" for path in MACHINE_PATHS],
)
def test_no_file_names_a_registry_or_a_path_of_one_machine(pattern: str):
    expression = re.compile(pattern.encode())
    files = project_files()
    assert ROOT / "pyproject.toml" in files
    naming = [str(path.relative_to(ROOT)) for path in files if expression.search(path.read_bytes())]
    assert not naming, f"{naming} match {pattern}"


# No module below the command lines knows the paper's aircraft: its numbers follow from the aircraft
# handed down.

ROOMS = ("commands", "envs", "agents", "rlcas_jax", "eval", "ros_bridge")
NAMES = {"PAPER", "SURROGATE", "RULES", "INTRUDER_LIMITS", "CRITICAL_RADIUS"}
NUMBERS = {1_000.0, 1_500.0, 10_000.0, 500.0, 150.0}
JUSTIFIED = {
    "envs/aircraft.py": "defines the paper's aircraft",
    "envs/kinematics.py": "defines the paper's limits",
    "envs/outcome.py": "defines the paper's rules",
    "envs/gym/gymnasium_env.py": "the default of a registered environment",
    "envs/gym/gymnasium_vector.py": "the default of a registered environment",
    "envs/gym/rendering.py": "metres in a kilometre",
    "envs/observation.py": "ranks count in the paper's units, so that its choices stay",
    "envs/c208/validate.py": "altitudes of the Cessna",
    "envs/c208/vehicle.py": "of the Cessna's autopilot",
    "envs/formats/encounter_file.py": "ranges of a file's columns",
    "envs/formats/lincoln_file.py": "ranges of a file's columns",
    "envs/traffic/encounter_model.py": "ranges of a file's columns",
    "envs/traffic/track_units.py": "metres in a kilometre",
    "agents/config/world.py": "defaults of configurations",
    "agents/assurance/backup.py": "degrees of a turn",
    "agents/manoeuvres/escape_search.py": "degrees of a turn",
    "agents/planner/search/fallback.py": "degrees of a turn",
    "agents/policy/eight_network.py": "policy files of schema 1",
    "agents/policy/candidate_manoeuvres.py": "degrees of a turn",
    "agents/policy/features.py": "policy files of schema 1",
    "agents/policy/file.py": "policy files of schema 1",
    "agents/policy/schema.py": "policy files of schema 1",
    "rlcas_jax/config.py": "defaults of configurations",
    "rlcas_jax/gymnax_env.py": "the default of a registered environment",
    "eval/boundary/run.py": "default of a command line",
    "eval/policy_map/local.py": "range of an option",
    "eval/compare/resolvers.py": "aircraft of policies that name none",
    "eval/hifi/config.py": "ranges of configurations",
    "eval/hifi/figures.py": "metres in a kilometre",
    "eval/boundary/slices.py": "metres in a kilometre",
    "eval/sensitivity/sweep.py": "the help of a command line",
    "eval/plots/encounters.py": "metres in a kilometre",
    "eval/metrics/volumes.py": "volumes of standards",
    "agents/assurance/inputs.py": "bounds of what a message may hold",
    "agents/kernel/traffic.py": "seconds",
    "agents/planner/request/reports.py": "bounds of what a request may hold",
    "agents/planner/request/request.py": "bounds of what a request may hold",
    "ros_bridge/core/conversions.py": "bounds of what a message may hold",
    "ros_bridge/transport/parameters.py": "ranges and defaults of parameters",
    "ros_bridge/core/tracks.py": "of receivers",
    "ros_bridge/mavlink/options.py": "ranges of options",
    "ros_bridge/sim/world.py": "seconds of an encounter",
}
"""Modules that may name the paper's aircraft or its numbers, and why."""


def of_the_paper(text: str) -> Iterator[tuple[int, str]]:
    """Yield line and word of what a module says of the paper's aircraft; strings and
    comments may.
    """
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        number = (
            token.type == tokenize.NUMBER
            and "." in token.string
            and token.string.replace("_", "").isascii()
        )
        named = token.type == tokenize.NAME and token.string in NAMES
        if named or (number and float(token.string) in NUMBERS):
            yield token.start[0], token.string


@pytest.mark.parametrize("room", ROOMS)
def test_no_module_knows_the_papers_aircraft(room: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {word}"
        for path in sorted((ROOT / room).rglob("*.py"))
        if str(path.relative_to(ROOT)) not in JUSTIFIED
        for line, word in of_the_paper(path.read_text())
    ]
    assert not found, "take the number from the aircraft that is handed down"


def test_modules_with_a_reason_exist_and_need_it() -> None:
    for name in JUSTIFIED:
        assert any(of_the_paper((ROOT / name).read_text())), f"{name} needs no exception any more"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1_000.0 * y", 1),
        ("x = PAPER.dt", 1),
        ("# 1000.0 m\ny = 'RULES'", 0),
        ("x = 1000 + 1e3", 0),
    ],
)
def test_what_counts_as_a_number_of_the_paper(text: str, said: int) -> None:
    assert len(list(of_the_paper(text))) == said
