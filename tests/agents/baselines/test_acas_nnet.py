"""Networks in the .nnet format are read exactly or refused, and flown as logics."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from agents.baselines.acas_nnet import Network, NnetError, load_logic, read
from agents.baselines.baselines import Sight
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from tests.support import recorded

SMALL = """\
// a network made by hand
// with two comments
2,2,2,3,
2,3,2,
0,
-10.0,-1.0,
10.0,1.0,
1.0,0.5,7.0,
4.0,2.0,3.0,
1.0,0.0,
0.0,1.0,
-1.0,-1.0,
0.5,
0.0,
-0.25,
1.0,2.0,3.0,
-1.0,0.0,1.0,
0.1,
0.2,
"""


def written(tmp_path: Path, text: str, name: str = "small.nnet") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_network_by_hand(tmp_path: Path) -> None:
    network = read(written(tmp_path, SMALL))
    # (3, 0.5) becomes (0.5, 0): hidden (1, 0, 0), outputs (1.1, -0.8), times 3, plus 7.
    assert network(np.array([[3.0, 0.5]])) == pytest.approx(np.array([[10.3, 4.6]]))
    # Beyond the maxima the input is clipped.
    np.testing.assert_array_equal(network(np.array([[99.0, 9.0]])), network(np.array([[10.0, 1.0]])))


def test_byte_order_mark_comments_and_blank_lines_change_nothing(tmp_path: Path) -> None:
    lines = SMALL.splitlines()
    for number in range(len(lines) + 1):
        for more in ("", "  // between Zürich and Genève", " \t"):
            text = "\ufeff" + "\n".join([*lines[:number], more, *lines[number:]])
            network = read(written(tmp_path, text))
            assert network(np.array([[3.0, 0.5]])) == pytest.approx(np.array([[10.3, 4.6]]))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda lines: [], r"small.nnet: begins with \[\], expected 4 whole numbers"),
        (lambda lines: [*lines[:9], "1.0,x,", *lines[10:]], r"small.nnet: not a text of numbers \(.*'x'\)"),
        (lambda lines: [*lines[:9], "1.0,nan,", *lines[10:]], r"small.nnet: a number is not finite"),
        (lambda lines: [*lines[:3], "3,3,2,", *lines[4:]], r"sizes \[3, 3, 2\] do not fit 2 inputs"),
        (lambda lines: [*lines[:2], "2,2,2.5,3,", *lines[3:]], r"begins with .*2\.5.*, expected 4 whole numbers"),
        (lambda lines: [*lines[:2], "1000000000,2,2,3,", *lines[3:]], r"expected 1000000001 whole numbers"),
        (lambda lines: [*lines[:8], "4.0,0.0,3.0,", *lines[9:]], "ranges above 0"),
        (lambda lines: [*lines[:6], "10.0,-1.0,", *lines[7:]], r"maxima of the inputs above their minima"),
        (lambda lines: [*lines, "0.3,"], r"36 numbers, expected 35 for the sizes \[2, 3, 2\]"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path: Path, change, sentence: str) -> None:
    with pytest.raises(NnetError, match=sentence):
        read(written(tmp_path, "".join(f"{line}\n" for line in change(SMALL.splitlines()))))


def test_every_cut_of_a_file_is_refused(tmp_path: Path) -> None:
    lines = SMALL.splitlines()
    for count in range(len(lines)):
        with pytest.raises(NnetError, match="expected"):
            read(written(tmp_path, "\n".join(lines[:count])))


def test_what_is_no_text_or_no_file(tmp_path: Path) -> None:
    (tmp_path / "binary.nnet").write_bytes(b"\xff\xfe")
    with pytest.raises(NnetError, match="not a text of numbers"):
        read(tmp_path / "binary.nnet")
    with pytest.raises(NnetError, match="there is no such file"):
        read(tmp_path / "absent.nnet")
    os.mkfifo(tmp_path / "pipe.nnet")
    with pytest.raises(NnetError, match="not a regular file"):
        read(tmp_path / "pipe.nnet")
    with pytest.raises(NnetError, match="2 inputs and 2 outputs, expected 3 "):
        load_logic(written(tmp_path, SMALL), PAPER)


def test_inputs_are_checked(tmp_path: Path) -> None:
    network = read(written(tmp_path, SMALL))
    with pytest.raises(ValueError, match="not finite"):
        network(np.array([[math.nan, 0.0]]))
    with pytest.raises(ValueError, match=r"expected \[N, 2\]"):
        network(np.zeros((4, 3)))


def logic_file(path: Path, inputs: int, best: int, *, sign: float = 1.0) -> None:
    """Write a logic that always advises ``best``: the largest score, or with sign -1 the smallest."""
    ones = ",".join(["1.0"] * inputs) + ","
    scores = "".join(f"{sign * (output == best)},\n" for output in range(5))
    zeros = (",".join(["0.0"] * inputs) + ",\n") * 5
    ends = ",".join(["-1e9"] * inputs) + ",\n" + ",".join(["1e9"] * inputs) + ",\n"
    path.write_text(f"1,{inputs},5,5,\n{inputs},5,\n0,\n{ends}{'0.0,' * (inputs + 1)}\n{ones}1.0,\n{zeros}{scores}")


@pytest.mark.parametrize(
    ("inputs", "stem", "sign"), [(3, "pra{}_", 1.0), (5, "run2a_{}_1_", -1.0), (5, "v2a_{}_1_", -1.0)]
)
def test_the_network_of_the_previous_advisory_is_asked(tmp_path: Path, inputs: int, stem: str, sign: float) -> None:
    first = 0 if inputs == 3 else 1
    for previous in range(5):
        # After advisory p comes p + 1, so that every network differs from the others.
        logic_file(tmp_path / f"{stem.format(first + previous)}x.nnet", inputs, (previous + 1) % 5, sign=sign)
    logic = load_logic(tmp_path / f"{stem.format(first + 2)}x.nnet", PAPER)
    count = np.arange(5)
    own = VehicleState(*(np.zeros(5) for _ in range(3)), np.full(5, 60.0))
    other = VehicleState(*(np.full((5, 1), value) for value in (2_000.0, 0.0, math.pi, 60.0)))
    sight = Sight(own, other, np.ones((5, 1), bool), np.full(5, 9_000.0), np.zeros(5), 300.0)
    action, memory = logic.decide(sight, count.astype(np.int8))
    assert memory.tolist() == [1, 2, 3, 4, 0]
    # Weak left, weak right, strong left, strong right at 1.5 and 3 deg/s, then clear: straight on, not home.
    assert action[:, 1] == pytest.approx([0.5, -0.5, 1.0, -1.0, 0.0])
    assert not action[:, 0].any()


def test_a_missing_sibling_is_named(tmp_path: Path) -> None:
    logic_file(tmp_path / "pra0_x.nnet", 3, 0)
    with pytest.raises(NnetError, match=r"pra1_x\.nnet: there is no such file"):
        load_logic(tmp_path / "pra0_x.nnet", PAPER)


def test_the_published_networks_turn_away_and_mirror() -> None:
    path = recorded("horizontalcas/HCAS_rect_v6_pra0_tau00_25HU_3000.nnet")
    network: Network = read(path)
    assert len(network.weights) == 6
    assert [len(bias) for bias in network.biases] == [25] * 5 + [5]
    logic = load_logic(path, PAPER)
    assert len(logic.networks) == 5
    # An intruder far behind is no conflict; one head-on and near is.
    behind, ahead = [-40_000.0, 0.0, 0.0], [3_000.0, 0.0, math.pi]
    scores = network(np.array([behind, ahead]))
    assert scores[0].argmax() == 0
    assert scores[1].argmax() in (3, 4)
    # Left and right change places with the scene, in what is advised for most of them.
    rng = np.random.default_rng(0)
    scenes = rng.uniform([-10_000, -10_000, -3.0], [20_000, 10_000, 3.0], (500, 3))
    mirrored = scenes * [1.0, -1.0, -1.0]
    same = network(scenes).argmax(1) == np.array([0, 2, 1, 4, 3])[network(mirrored).argmax(1)]
    assert same.mean() > 0.85
