"""Frames and limits as types: what a type checker refuses, and that they are nothing at run time."""

import json
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from envs.kinematics import VehicleState

ROOT = Path(__file__).parent.parent
TYPING = ROOT / "tests" / "typing"


@pytest.mark.slow
def test_a_type_checker_refuses_exactly_the_wrong_exchanges(tmp_path: Path) -> None:
    pytest.importorskip("basedpyright")
    config = {"include": [str(TYPING)], "extraPaths": [str(ROOT)], "typeCheckingMode": "standard"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(config))
    command = ["-m", "basedpyright", "-p", str(tmp_path), "--outputjson"]
    command += ["--pythonpath", sys.executable]
    result = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False)
    found = {
        (Path(one["file"]).name, one["range"]["start"]["line"] + 1)
        for one in json.loads(result.stdout)["generalDiagnostics"]
    }
    wrong = {
        (path.name, number)
        for path in TYPING.glob("*.py")
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if line.endswith("# error")
    }
    assert len(wrong) > 20
    assert not wrong - found, f"nobody objects to {sorted(wrong - found)}"
    assert not found - wrong, f"somebody objects to {sorted(found - wrong)}"


def test_a_state_is_a_plain_tuple_at_run_time() -> None:
    state = VehicleState(1.0, 2.0, 3.0, 4.0)
    assert tuple(state) == (1.0, 2.0, 3.0, 4.0)
    assert not hasattr(state, "__dict__")
    assert pickle.loads(pickle.dumps(state)) == state
    jax = pytest.importorskip("jax")
    leaves, shape = jax.tree.flatten(state)
    assert leaves == [1.0, 2.0, 3.0, 4.0]
    assert type(jax.tree.unflatten(shape, leaves)) is VehicleState
