"""A small evaluation to make reports of, with names of encounters that would like to be markup."""

from pathlib import Path

import pytest

from envs.encounters import SCENARIOS
from envs.formats import encounter_file
from envs.starts import numbered
from eval.monte_carlo import run as monte_carlo
from eval.report import run as report

__all__ = ["HOSTILE", "TRACKS", "report_page", "report_run"]

COUNT, TRACKS = 24, 18
HOSTILE = "</script><img src=x onerror=\"document.title='lost'\">{b}<b>&amp;\u202etfel ot thgir"


@pytest.fixture(scope="session")
def report_run(policy_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an evaluation of the hand-made policy, which solves many encounters and not all."""
    place = tmp_path_factory.mktemp("report")
    file, out = place / "encounters.csv", place / "run"
    names = [f"{number} {HOSTILE}" for number in range(COUNT)]
    encounter_file.write(file, numbered(SCENARIOS["circle"], 0, 0, COUNT), names)
    arguments = ["--policy", str(policy_path), "--scenario", f"file:{file}", "--workers", "1"]
    assert monte_carlo.main([*arguments, "--set", "figures=false", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="session")
def report_page(report_run: Path) -> Path:
    """Return the report of the evaluation, with tracks of most encounters."""
    assert report.main([str(report_run), "--tracks", str(TRACKS)]) == 0
    return report_run / "report.html"
