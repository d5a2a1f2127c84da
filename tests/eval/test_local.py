"""What is proven of the policy box by box holds for what it commands, and what is known to be wrong is found."""

import argparse
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.policy.inference import Policy
from envs.edge.command import ConfigError
from eval import local
from eval.policy_map.enclosure import Form
from eval.policy_map.proof import COUNTEREXAMPLE, VERIFIED, Scenes, answers, box_of, decide, layers, turns_of

ERROR = np.full(4, 0.03)
HOW: dict[str, Any] = {"allowed": 0.1, "depth": 6, "seed": 0}


@cache
def policy() -> Policy:
    """The policy that ships, in double precision, so that no difference is one of rounding."""
    return Policy.load(dtype=np.float64)


@cache
def scenes(count: int = 12) -> Scenes:
    return local.draw(policy(), argparse.Namespace(boxes=count, course=(0.0, 180.0), loss=(0.0, 30.0), seed=3))[0]


def moved(shifts: np.ndarray, half: np.ndarray = ERROR) -> Scenes:
    return scenes()._replace(state=scenes().state + shifts * half)


def shifts(count: int) -> list[np.ndarray]:
    random = np.random.default_rng(5)
    drawn = random.uniform(-1.0, 1.0, (count, len(scenes().pace), 4))
    return [np.sign(each) if number % 2 else each for number, each in enumerate(drawn)]


@pytest.mark.parametrize("part", [1.0, 0.2])
def test_bounds_hold_for_what_the_policy_commands_in_the_box(part: float):
    half = part * ERROR
    inputs, sign = box_of(policy(), scenes(), half)
    turn, _ = turns_of(layers(policy()), inputs)
    low, high = turn.ends
    known = np.isfinite(turn.width)  # of a relative speed near 0 nothing is known until the box is cut
    assert known.mean() > 0.8
    for each in shifts(20):
        inner, other = box_of(policy(), moved(each, half), 0.0 * half)
        same = (sign == other) & known
        to_line = each * np.stack([np.ones_like(sign), sign, np.ones_like(sign), sign], axis=-1)
        line = inputs.middle + (inputs.slopes * to_line[:, None]).sum(-1)
        assert (np.abs(inner.middle - line) <= inputs.rest + inner.width + 1e-9)[same].all()
        command = sign * answers(policy(), moved(each, half))
        assert ((np.clip(low, -1.0, 1.0) - 1e-6 <= command) & (command <= np.clip(high, -1.0, 1.0) + 1e-6))[same].all()


def test_a_box_of_no_size_has_the_bounds_of_the_command():
    inputs, sign = box_of(policy(), scenes(), 0.0 * ERROR)
    turn, _ = turns_of(layers(policy()), inputs)
    assert turn.width.max() < 0.02
    np.testing.assert_allclose(sign * np.clip(turn.middle, -1.0, 1.0), answers(policy(), scenes()), atol=0.02)


def test_a_line_along_a_curve_encloses_it():
    x, inside = Form(np.array([0.5]), np.array([[0.9, 0.0, 0.0, 0.0]]), np.array([0.05])), np.linspace(-1.0, 1.0, 41)
    near = 0.5 + 0.9 * inside + 0.05 * inside[::-1]
    for form, curve in (
        (x * x, near * near),
        (Form.abs(x), np.abs(near)),
        (Form.clip(x, 0.0, 1.0), np.clip(near, 0.0, 1.0)),
        (Form.sqrt(x * x + 0.1), np.sqrt(near * near + 0.1)),
        ((x + 3.0) / (x + 2.0), (near + 3.0) / (near + 2.0)),
        (1.5 - x * (x + 1.0), 1.5 - near * (near + 1.0)),
    ):
        assert (np.abs(curve - form.middle - form.slopes[0, 0] * inside) <= form.rest + 1e-12).all()
        assert form.width.item() < 5.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_intruder_dead_ahead_is_a_known_counterexample(side: float):
    # An exactly symmetric policy turns to either side as the error says.
    scene = Scenes(np.array([0.75]), np.array([[8.0, 0.0]]), np.array([[3.0, 0.0, -0.9, 0.0]]))
    assert decide(policy(), scene, ERROR, np.array([side]), **HOW).tolist() == [COUNTEREXAMPLE]


def test_what_is_verified_has_no_counterexample_and_the_mirror_image_is_verified_too():
    side = -np.sign(answers(policy(), scenes()))
    found = decide(policy(), scenes(), ERROR, side, **HOW)
    assert 0 < np.sum(found == VERIFIED) < len(found)
    for each in shifts(100):
        assert (side * answers(policy(), moved(each)) <= HOW["allowed"])[found == VERIFIED].all()
    pace, goal, state = scenes()
    image = Scenes(pace, goal * [1.0, -1.0], state * [1.0, -1.0, 1.0, -1.0])
    assert np.array_equal(decide(policy(), image, ERROR, -side, **HOW) == VERIFIED, found == VERIFIED)
    assert np.array_equal(local.passing(image), -local.passing(scenes()))


def test_drawn_scenes_lose_the_separation_in_time_and_lie_in_their_cells():
    options = argparse.Namespace(boxes=200, course=(30.0, 100.0), loss=(5.0, 10.0), seed=1)
    drawn, cell, names = local.draw(policy(), options)
    assert len(names) == 15
    x, y, vx, vy = drawn.state.T
    times = np.linspace(0.0, 1.0, 201)[:, None]  # 10 s is a unit of time
    away = np.hypot(x + (vx - drawn.pace) * times, y + vy * times)
    lost = times[(away < 1.0).argmax(axis=0), 0]
    assert ((lost >= 0.495) & (lost <= 1.01))[(away < 1.0).any(axis=0)].all()
    assert np.mean((away < 1.0).any(axis=0)) > 0.97
    low, high = np.array([name.split("/")[1].split(" to ") for name in names], float)[cell].T
    ratio = np.hypot(vx, vy) / drawn.pace
    assert ((low <= ratio + 1e-9) & (ratio <= high + 1e-9)).all()


def test_the_network_part_in_onnx_decides_as_the_policy():
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    from agents.learning.onnx import network_part

    made = network_part(Policy.load())
    assert {node.op_type for node in made.graph.node} == {"Gemm", "Tanh", "Add"}
    inputs, sign = box_of(policy(), scenes(), 0.0 * ERROR)
    session = runtime.InferenceSession(made.SerializeToString(), providers=["CPUExecutionProvider"])
    turn = session.run(None, {"inputs": inputs.middle.astype(np.float32)})[0][:, 1]
    np.testing.assert_allclose(sign * np.clip(turn, -1.0, 1.0), answers(policy(), scenes()), atol=0.02)


def test_the_command_writes_the_map_and_boxes_for_other_verifiers(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("onnx")
    options = "--boxes 2 --depth 1 --course 135 180 --vnnlib 1 --out"
    arguments = [*options.split(), str(tmp_path / "out")]
    assert local.main(arguments) == 0
    found = json.loads((tmp_path / "out/local.json").read_text())
    assert found["policy_sha256"] == policy().sha256
    assert len(found["cells"]) == 5
    for name in local.QUESTIONS:
        assert sum(found[name][verdict]["count"] for verdict in local.VERDICTS) == 2
    assert "side: " in capsys.readouterr().out
    box = (tmp_path / "out/box_000.vnnlib").read_text()
    assert (box.count("declare-const X_"), box.count("assert")) == (53, 107)
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".json", ".onnx", ".png", ".svg", ".vnnlib"}


@pytest.mark.parametrize("words", [["--course", "90", "10"], ["--loss", "0", "90"], ["--boxes", "0"]])
def test_bad_usage_is_refused_with_the_option(words: list[str]):
    with pytest.raises(ConfigError, match=words[0]):
        local.main(words)
