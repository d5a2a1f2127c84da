"""No module below the command lines knows the paper's aircraft: its numbers follow from the aircraft handed down."""

import io
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("envs", "agents", "rlcas_jax", "eval", "ros_bridge")
NAMES = {"PAPER", "SURROGATE", "RULES", "INTRUDER_LIMITS", "CRITICAL_RADIUS"}
NUMBERS = {1_000.0, 1_500.0, 10_000.0, 500.0, 150.0}

JUSTIFIED = {
    "envs/aircraft.py": "defines the paper's aircraft",
    "envs/gym/gymnasium_env.py": "the default of a registered environment",
    "envs/gym/gymnasium_vector.py": "the default of a registered environment",
    "envs/gym/rendering.py": "metres in a kilometre",
    "envs/observation.py": "ranks count in the paper's units, so that its choices stay",
    "envs/c208/vehicle.py": "of the Cessna's autopilot",
    "envs/formats/encounter_file.py": "ranges of a file's columns",
    "envs/formats/lincoln_file.py": "ranges of a file's columns",
    "envs/traffic/encounter_model.py": "ranges of a file's columns",
    "envs/traffic/track_units.py": "metres in a kilometre",
    "agents/config/world.py": "defaults of configurations",
    "agents/policy/file.py": "policy files of schema 1",
    "agents/policy/schema.py": "policy files of schema 1",
    "rlcas_jax/config.py": "defaults of configurations",
    "eval/config.py": "defaults of configurations",
    "eval/compare/setup.py": "default of a command line",
    "eval/hifi/conditions.py": "ranges of configurations",
    "eval/hifi/sheet.py": "metres in a kilometre",
    "eval/hifi/c208_figures.py": "figures of the Cessna beside the paper's surrogate",
    "eval/boundary/slices.py": "metres in a kilometre",
    "eval/plots/encounters.py": "metres in a kilometre",
    "eval/metrics/volumes.py": "volumes of standards",
    "agents/assurance/inputs.py": "bounds of what a message may hold",
    "agents/planner/request.py": "bounds of what a request may hold",
    "ros_bridge/core/adapters.py": "bounds of what a message may hold",
    "ros_bridge/core/conversions.py": "bounds of what a message may hold",
    "ros_bridge/transport/parameters.py": "ranges and defaults of parameters",
}
"""Modules that may name the paper's aircraft or its numbers, and why."""

LEFT = {
    "envs/kinematics.py",
    "envs/outcome.py",
    "agents/assurance/backup.py",
    "agents/manoeuvres/escape_search.py",
    "agents/planner/fallback.py",
    "agents/planner/separation.py",
    "agents/policy/escape_features.py",
    "agents/policy/escapes.py",
    "agents/policy/features.py",
    "agents/policy/inference.py",
    "eval/boundary/run.py",
    "eval/sensitivity/bins.py",
    "eval/sensitivity/sweep.py",
    "ros_bridge/core/tracks.py",
    "ros_bridge/sim/world.py",
}
"""Modules that still do without a reason; it only shrinks."""


def of_the_paper(text: str) -> Iterator[tuple[int, str]]:
    """Yield line and word of what a module says of the paper's aircraft; strings and comments may."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        number = token.type == tokenize.NUMBER and "." in token.string and token.string.replace("_", "").isascii()
        named = token.type == tokenize.NAME and token.string in NAMES
        if named or (number and float(token.string) in NUMBERS):
            yield token.start[0], token.string


@pytest.mark.parametrize("room", ROOMS)
def test_no_module_knows_the_papers_aircraft(room: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {word}"
        for path in sorted((ROOT / room).rglob("*.py"))
        if str(path.relative_to(ROOT)) not in JUSTIFIED.keys() | LEFT
        for line, word in of_the_paper(path.read_text())
    ]
    assert not found, "take the number from the aircraft that is handed down"


def test_modules_with_a_reason_exist_and_need_it() -> None:
    for name in JUSTIFIED:
        assert any(of_the_paper((ROOT / name).read_text())), f"{name} needs no exception any more"


@pytest.mark.parametrize(
    ("text", "said"),
    [("x = 1_000.0 * y", 1), ("x = PAPER.dt", 1), ("# 1000.0 m\ny = 'RULES'", 0), ("x = 1000 + 1e3", 0)],
)
def test_what_counts_as_a_number_of_the_paper(text: str, said: int) -> None:
    assert len(list(of_the_paper(text))) == said
