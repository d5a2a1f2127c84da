"""Policies that need no training, made of numbers put in by hand, and an evaluation of one with its
report.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from agents.policy import file as policy_file
from agents.policy.file import PolicyFile
from agents.policy.inference import Policy
from agents.policy.schema import new_metadata
from envs.aircraft import PAPER
from envs.formats import encounter_file
from envs.kinematics import SURROGATE
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from eval.monte_carlo import run as monte_carlo
from eval.report import run as report
from eval.runner import command

# Of the report: encounters, those with tracks, what is asked of it, and a name that would like to be
# markup.
COUNT, TRACKS = 24, 18
PAGE = ("--tracks", str(TRACKS), "--bands", "3")
HOSTILE = "</script><img src=x onerror=\"document.title='lost'\">{b}<b>&amp;\u202etfel ot thgir"

# Places in the feature set "mirror".
GOAL_SINE, AHEAD_DEPTH, HOMEWARD_DEPTH = 9, 17, 21


def make_by_hand() -> PolicyFile:
    """Return a policy that turns away from what is ahead and else to the goal: it solves many
    encounters, not all.
    """
    kernel = np.zeros((22, 64), np.float32)
    bias = np.zeros(64, np.float32)
    kernel[GOAL_SINE, 0] = 3.0
    kernel[AHEAD_DEPTH, 1], bias[1] = 6.0, -1.2
    kernel[HOMEWARD_DEPTH, 2], bias[2] = 6.0, -1.2
    second = np.zeros((64, 64), np.float32)
    # Turn to the goal, unless the way there is in conflict; turn away from a conflict ahead.
    second[[0, 1, 2], 0] = [1.5, -1.5, 0.0]
    second_bias = np.zeros(64, np.float32)
    second_bias[0] = -1.5
    second[[0, 2], 1] = [1.5, 1.5]
    second_bias[1] = 1.5
    head = np.zeros((64, 2), np.float32)
    head[0, 1], head[1, 1] = 1.0, 0.9
    actor = {
        "hidden_0/kernel": kernel,
        "hidden_0/bias": bias,
        "hidden_1/kernel": second,
        "hidden_1/bias": second_bias,
        "head/kernel": head,
        "head/bias": np.zeros(2, np.float32),
        "log_std": np.zeros(2, np.float32),
    }
    return complete(actor, (64, 64))


def complete(actor: dict[str, np.ndarray], hidden: tuple[int, ...]) -> PolicyFile:
    """Return the policy file of an actor, its parity vectors computed here in float64."""
    from agents.policy.eight_network import EightNetwork

    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (16, 8)).astype(np.float32)
    metadata = new_metadata(
        hidden, "mirror", SURROGATE, {}, steps=0, score=None, versions={}, notes="made by hand"
    )
    blank = PolicyFile(actor, observations, np.zeros((16, 2), np.float32), metadata)
    actions = np.clip(EightNetwork(blank, np.float64).of_parity(observations), -1.0, 1.0).astype(
        np.float32
    )
    return PolicyFile(actor, observations, actions, metadata)


@pytest.fixture(scope="session")
def policy_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the hand-made policy's file."""
    path = tmp_path_factory.mktemp("policies") / "policy.safetensors"
    policy_file.write(path, make_by_hand())
    return path


@pytest.fixture(scope="session")
def policy(policy_path: Path) -> Policy:
    """Return the hand-made policy, to be flown among several intruders, too."""
    return Policy.load(policy_path).for_aircraft(PAPER, outside="allow")


@pytest.fixture(autouse=True, scope="session")
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread, as the evaluation does; with more, rows would depend on their
    company.
    """
    with threadpool_limits(1):
        yield


@pytest.fixture(autouse=True, scope="session")
def one_worker() -> Iterator[None]:
    """Fly in this process where a test does not ask for workers: they take seconds to begin."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "cores", lambda: 1)
        yield


@pytest.fixture(scope="session")
def report_run(policy_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of an evaluation of the hand-made policy, which solves many encounters and
    not all.
    """
    place = tmp_path_factory.mktemp("report")
    file, out = place / "encounters.csv", place / "run"
    names = [f"{number} {HOSTILE}" for number in range(COUNT)]
    encounter_file.write(file, encounters_of_seed(scenario("circle", PAPER), 0, 0, COUNT), names)
    arguments = ["--policy", str(policy_path), "--scenario", f"file:{file}", "--workers", "1"]
    assert monte_carlo.main([*arguments, "--set", "figures=false", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="session")
def report_page(report_run: Path) -> Path:
    """Return the report of the evaluation, with tracks of most encounters."""
    assert report.main([str(report_run), *PAGE]) == 0
    return report_run / "report.html"
