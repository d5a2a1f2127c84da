"""Where a policy fails: the map shows its commands and scores, failures are grouped without loss,
proofs hold.
"""

import csv
import json
import math
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import ConfigError
from agents.policy.inference import Policy
from commands.command import InputError, run_cli
from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from eval.failures.run import FAILURES, failures, group_failures, main, representatives
from eval.monte_carlo import run as monte_carlo
from eval.policy_map import local
from eval.policy_map import run as policy_map
from eval.policy_map.advisory import FixedStates, advise, name_of, relative_velocity, scores
from eval.policy_map.config import LocalConfig
from eval.policy_map.enclosure import Form
from eval.policy_map.proof import (
    COUNTEREXAMPLE,
    VERIFIED,
    Scenes,
    answers,
    box_of,
    decide,
    layers,
    turns_of,
)
from eval.report.run import main as report
from eval.sensitivity.run import main as sensitivity
from tests.eval.conftest import COUNT

SCENE = FixedStates(75.0, 90.0, math.radians(-90.0), math.radians(30.0), 8_000.0)
SMALL = ["--cells", "31", "--encounters", "4"]


class EvenHanded:
    """Turns away from the intruder's side, and brakes near by; ``bias`` is added to every turn."""

    def __init__(self, bias: float = 0.0) -> None:
        self.bias = bias

    def command(
        self, own: VehicleState, intruders: VehicleState, mask: Any, goal_x: Any, goal_y: Any
    ) -> np.ndarray:
        x, y = intruders.x[:, 0] - own.x, intruders.y[:, 0] - own.y
        to_the_left = y * np.cos(own.heading) - x * np.sin(own.heading)
        far = np.minimum(np.hypot(x, y) / 10_000.0, 2.0) - 1.0
        return np.stack([far, np.clip(self.bias - 1e-4 * to_the_left, -1.0, 1.0)], axis=-1)


POLICY: Any = EvenHanded()


def test_a_map_is_what_the_policy_commands_at_each_place():
    queries = []

    class Spy(EvenHanded):
        def command(
            self, own: Any, intruders: Any, mask: Any, goal_x: Any, goal_y: Any
        ) -> np.ndarray:
            queries.append((own, intruders, goal_x, goal_y))
            return super().command(own, intruders, mask, goal_x, goal_y)

    spy: Any = Spy()
    advisory = advise(spy, SCENE, 6_000.0, 5, PAPER)
    assert advisory.place == pytest.approx([-4_800.0, -2_400.0, 0.0, 2_400.0, 4_800.0])
    ((own, intruders, goal_x, goal_y),) = queries
    ahead_left = 4 * 5 + 1  # row 4: 4800 m ahead, column 1: 2400 m to the left
    assert (own.speed[ahead_left], intruders.speed[ahead_left, 0]) == (75.0, 90.0)
    assert (intruders.x[ahead_left, 0], intruders.y[ahead_left, 0]) == pytest.approx(
        (-2_400.0, 4_800.0)
    )
    # Angles count to the left: the goal stands there, and the intruder flies 90 degrees to the
    # right of the ownship.
    assert math.degrees(math.atan2(-goal_x[ahead_left], goal_y[ahead_left])) == pytest.approx(30.0)
    assert math.hypot(goal_x[ahead_left], goal_y[ahead_left]) == pytest.approx(8_000.0)
    assert math.degrees(
        intruders.heading[ahead_left, 0] - own.heading[ahead_left]
    ) == pytest.approx(-90.0)
    # It stands to the left, so that the turn goes to the right, which is negative.
    assert advisory.yaw_rate[4, 1] == pytest.approx(-0.24 * PAPER.limits.yaw_rate_max)
    assert advisory.acceleration[4, 1] == pytest.approx(0.5 * (math.hypot(2.4, 4.8) / 10.0 - 1.0))


def test_a_relative_heading_of_minus_90_comes_from_the_left():
    right, ahead = relative_velocity(SCENE)
    assert (right, ahead) == pytest.approx((90.0, -75.0))
    assert name_of(SCENE.relative_heading) == "crossing from the left"
    words = {180: "head-on", -170: "head-on", 0: "same course", 30: "converging from the right"}
    words |= {90: "crossing from the right", -150: "oncoming from the left"}
    assert {degrees: name_of(math.radians(degrees)) for degrees in words} == words


def test_chatter_by_hand():
    nan = math.nan
    steering = np.array(
        [[0.0, 1.0], [1.0, 1.0], [-1.0, nan]]
    )  # two flights; the second ends after two seconds
    throttle = np.array([[0.5, 0.0], [0.5, 0.4], [0.5, nan]])
    action = np.stack([throttle, steering], axis=-1)
    ended: Any = SimpleNamespace(reversals=np.array([1, 0]), outcome=np.array([1, 0]))
    chatter = scores(action, ended, PAPER)
    # Changes of 3, 6 and 0 deg/s; of 0, 0 and 0.2 m/s^2.
    assert chatter["yaw_rate_change_deg_s_per_s"] == pytest.approx(3.0)
    assert chatter["acceleration_change_m_s2_per_s"] == pytest.approx(0.2 / 3.0)
    assert chatter["mean_yaw_rate_deg_s"] == pytest.approx(3.0 * 4.0 / 5.0)
    assert chatter["reversals_per_flight"]["mean"] == 0.5
    assert (chatter["flights"], chatter["violation"], chatter["reached"], chatter["timeout"]) == (
        2,
        1,
        1,
        0,
    )


@pytest.mark.slow
def test_a_run_writes_its_files_and_repeats_itself(
    tmp_path: Path, policy_path: Path, policy: Policy, capsys: pytest.CaptureFixture[str]
):
    arguments = [
        "--policy",
        str(policy_path),
        "--relative-heading",
        "-90",
        "--relative-heading",
        "20",
        *SMALL,
    ]
    first, again = tmp_path / "one", tmp_path / "two"
    assert policy_map.main([*arguments, "--goal-distance", "3000", "--out", str(first)]) == 0
    assert policy_map.main(["--config", str(first / "config.yaml"), "--out", str(again)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("chatter, 4 circle flights: yaw rate")
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert names == {"config.yaml", "policy_map.json", "policy_map.png", "policy_map.svg"}
    for name in names:
        assert (first / name).read_bytes() == (again / name).read_bytes()
    written = json.loads((first / "policy_map.json").read_text(encoding="utf-8"))
    assert written["policy_sha256"] == policy.sha256
    assert written["relative_headings_deg"] == [-90.0, 20.0]
    assert written["settings"]["cells"] == 31
    assert written["chatter"]["flights"] == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["--relative-heading", "200"],
            "--relative-heading: 200 degrees; expected -180 to 180 degrees",
        ),
        (["--relative-heading", "nan"], "--relative-heading: nan degrees; expected"),
        (["--relative-heading", "0"] * 9, "--relative-heading: given 9 times; expected at most 8"),
        (["--own-speed", "40"], "--own-speed: 40 m/s; expected 50 to 100 m/s"),
        (["--intruder-speed", "-1"], "--intruder-speed: -1 m/s; expected 0 to 150 m/s"),
        (["--goal-distance", "30000"], "--goal-distance: 30000 m; expected 0 to 20000 m"),
        (["--extent", "500"], "--extent: 500 m; expected 1500 to 14000 m"),
        (["--cells", "3"], "--cells: '3'; expected a whole number, 11 to 1001"),
        (["--cells", "many"], "--cells: 'many'; expected a whole number"),
        (["--encounters", "0"], "--encounters: '0'; expected a whole number, 1 to 10000"),
        (["--policy-sha256", "0" * 64], "expected 000"),
        (["--policy", "none.safetensors"], "none.safetensors: no such policy file"),
    ],
)
def test_bad_input_ends_with_one_sentence(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: policy_map.main(["--out", str(out), *arguments]))
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_folder_with_something_in_it_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "kept").write_text("kept")
    with pytest.raises(SystemExit) as ended:
        run_cli(lambda: policy_map.main(["--out", str(tmp_path)]))
    assert ended.value.code == 2
    assert "expected a folder that is new or empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


# Failures of a run are grouped without loss, and the cases drawn are those of the run.


def tables(count: int, seed: int) -> dict[str, np.ndarray]:
    """Return made-up columns of a run, with the ends of all ranges among them."""
    rng = np.random.default_rng(seed)
    edges = np.array([0.0, 30.0, 60.0, 135.0, 180.0, 12.3])
    return {
        "outcome": rng.choice(np.array(["reached", "violation", "timeout"], dtype=object), count),
        "verdict": rng.choice(
            np.array(["resolvable", "unresolvable", "undecided"], dtype=object), count
        ),
        "relative_heading_deg": rng.choice(edges, count) * rng.choice([-1.0, 1.0], count),
        "distance_m": rng.choice([1_000.0, 1_500.0, 3_000.0, 25_000.0], count),
        "min_separation_m": rng.choice([0.0, 949.9, 950.0, 999.9, 1_200.0], count),
    }


@given(st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_every_failure_is_in_one_group(count: int, seed: int) -> None:
    table = tables(count, seed)
    groups = group_failures(table, 1_000.0)
    members = np.concatenate([group.members for group in groups]) if groups else np.array([], int)
    np.testing.assert_array_equal(np.sort(members), np.flatnonzero(failures(table)))
    assert [group.members.size for group in groups] == sorted(
        (group.members.size for group in groups), reverse=True
    )
    for group in groups:
        assert group.comparable >= group.members.size
        assert np.all(
            (table["outcome"][group.members] == "timeout") == (group.failure == FAILURES[2])
        )


@given(st.integers(1, 200), st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_cases_are_different_failures_of_the_groups(count: int, seed: int, most: int) -> None:
    table = tables(count, seed)
    chosen = representatives(group_failures(table, 1_000.0), most)
    assert len(set(chosen)) == len(chosen) <= most
    assert failures(table)[chosen].all()
    if most and failures(table).any():
        assert chosen


@pytest.mark.slow
def test_a_run_s_failures_are_listed_and_drawn(
    report_run: Path, policy_path: Path, tmp_path: Path
) -> None:
    out = tmp_path / "failed"
    assert (
        main(
            [
                "--run",
                str(report_run),
                "--policy",
                str(policy_path),
                "--cases",
                "4",
                "--out",
                str(out),
            ]
        )
        == 0
    )
    written = json.loads((out / "failures.json").read_text())
    summary = json.loads((report_run / "summary.json").read_text())
    resolved, resolvable = (summary["success_given_resolvable"][key] for key in ("count", "total"))
    assert written["encounters"] == COUNT
    assert written["failures"] == resolvable - resolved > 0
    with (out / "failures.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == written["failures"]
    assert {int(row["encounter"]) for row in rows} >= set(written["cases"])
    assert (out / "failures.png").stat().st_size > 10_000
    repeated = tmp_path / "repeated"
    assert main(["--config", str(out / "config.yaml"), "--out", str(repeated)]) == 0
    for path in out.iterdir():
        assert (repeated / path.name).read_bytes() == path.read_bytes()
    # The file of their starts is flown as they were.
    again = tmp_path / "again"
    flown = [
        "--mode",
        "policy",
        "--policy",
        str(policy_path),
        "--scenario",
        f"file:{out / 'encounters.csv'}",
    ]
    assert (
        monte_carlo.main([*flown, "--workers", "1", "--set", "figures=false", "--out", str(again)])
        == 0
    )
    counts = json.loads((again / "summary.json").read_text())["counts"]
    assert (counts["success"], counts["violation"] + counts["timeout"]) == (0, written["failures"])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [(["--cases", "500"], "--cases: '500'"), (["--cases", "-1"], "--cases: '-1'")],
)
def test_bad_input_is_a_sentence(
    arguments: list[str], problem: str, report_run: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=problem):
        main(["--run", str(report_run), "--out", str(tmp_path / "x"), *arguments])


def test_a_run_must_be_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="DIR: expected the folder of a finished run"):
        main(["--out", str(tmp_path / "x")])


@pytest.mark.parametrize("command", [main, sensitivity, report])
def test_every_command_takes_its_run_in_one_way(command: Any, tmp_path: Path) -> None:
    nowhere, out = str(tmp_path / "nowhere"), [] if command is report else ["--out", "x"]
    for named in ([nowhere], ["--run", nowhere]):
        with pytest.raises(InputError, match=r"nowhere.* (does not exist|holds no)"):
            command([*named, *out])
    for twice in ([nowhere, "--run", nowhere], ["--run", nowhere, nowhere]):
        with pytest.raises(ConfigError, match=r"argument (DIR|--run) stands twice"):
            command([*twice, *out])


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        main(["--run", str(tmp_path / "nowhere"), "--out", str(tmp_path / "x")])


# What is proven of the policy box by box holds for what it commands, and what is known to be wrong
# is found.

ERROR = np.full(4, 0.03)
SEARCH: dict[str, Any] = {"allowed": 0.1, "depth": 6, "seed": 0}


@cache
def policy() -> Policy:
    """The policy that ships, in double precision, so that no difference is one of rounding."""
    return Policy.load(dtype=np.float64)


@cache
def scenes(count: int = 12) -> Scenes:
    return local.draw(policy(), LocalConfig(boxes=count, seed=3))[0]


def move_scenes(shifts: np.ndarray, half: np.ndarray = ERROR) -> Scenes:
    return scenes()._replace(state=scenes().state + shifts * half)


def shifts(count: int) -> list[np.ndarray]:
    random = np.random.default_rng(5)
    drawn = random.uniform(-1.0, 1.0, (count, len(scenes().pace), 4))
    return [np.sign(shift) if number % 2 else shift for number, shift in enumerate(drawn)]


@pytest.mark.parametrize("part", [1.0, 0.2])
def test_bounds_hold_for_what_the_policy_commands_in_the_box(part: float):
    half = part * ERROR
    inputs, sign = box_of(policy(), scenes(), half)
    turn, _ = turns_of(layers(policy()), inputs)
    low, high = turn.ends
    is_bounded = np.isfinite(
        turn.width
    )  # of a relative speed near 0 nothing is known until the box is cut
    assert is_bounded.mean() > 0.8
    for shift in shifts(20):
        inner, sign_there = box_of(policy(), move_scenes(shift, half), 0.0 * half)
        comparable = (sign == sign_there) & is_bounded
        to_line = shift * np.stack([np.ones_like(sign), sign, np.ones_like(sign), sign], axis=-1)
        line = inputs.middle + (inputs.slopes * to_line[:, None]).sum(-1)
        assert (np.abs(inner.middle - line) <= inputs.remainder + inner.width + 1e-9)[
            comparable
        ].all()
        command = sign * answers(policy(), move_scenes(shift, half))
        assert (
            (np.clip(low, -1.0, 1.0) - 1e-6 <= command)
            & (command <= np.clip(high, -1.0, 1.0) + 1e-6)
        )[comparable].all()


def test_a_box_of_no_size_has_the_bounds_of_the_command():
    inputs, sign = box_of(policy(), scenes(), 0.0 * ERROR)
    turn, _ = turns_of(layers(policy()), inputs)
    assert turn.width.max() < 0.02
    np.testing.assert_allclose(
        sign * np.clip(turn.middle, -1.0, 1.0), answers(policy(), scenes()), atol=0.02
    )


def test_a_line_along_a_curve_encloses_it():
    x, inside = (
        Form(np.array([0.5]), np.array([[0.9, 0.0, 0.0, 0.0]]), np.array([0.05])),
        np.linspace(-1.0, 1.0, 41),
    )
    near = 0.5 + 0.9 * inside + 0.05 * inside[::-1]
    for form, curve in (
        (x * x, near * near),
        (Form.abs(x), np.abs(near)),
        (Form.clip(x, 0.0, 1.0), np.clip(near, 0.0, 1.0)),
        (Form.sqrt(x * x + 0.1), np.sqrt(near * near + 0.1)),
        ((x + 3.0) / (x + 2.0), (near + 3.0) / (near + 2.0)),
        (1.5 - x * (x + 1.0), 1.5 - near * (near + 1.0)),
    ):
        assert (
            np.abs(curve - form.middle - form.slopes[0, 0] * inside) <= form.remainder + 1e-12
        ).all()
        assert form.width.item() < 5.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_intruder_dead_ahead_is_a_known_counterexample(side: float):
    # An exactly symmetric policy turns to either side as the error says.
    scene = Scenes(np.array([0.75]), np.array([[8.0, 0.0]]), np.array([[3.0, 0.0, -0.9, 0.0]]))
    assert decide(policy(), scene, ERROR, np.array([side]), **SEARCH).tolist() == [COUNTEREXAMPLE]


def test_what_is_verified_has_no_counterexample_and_the_mirror_image_is_verified_too():
    side = -np.sign(answers(policy(), scenes()))
    verdicts = decide(policy(), scenes(), ERROR, side, **SEARCH)
    assert 0 < np.sum(verdicts == VERIFIED) < len(verdicts)
    for shift in shifts(100):
        assert (side * answers(policy(), move_scenes(shift)) <= SEARCH["allowed"])[
            verdicts == VERIFIED
        ].all()
    pace, goal, state = scenes()
    image = Scenes(pace, goal * [1.0, -1.0], state * [1.0, -1.0, 1.0, -1.0])
    assert np.array_equal(
        decide(policy(), image, ERROR, -side, **SEARCH) == VERIFIED, verdicts == VERIFIED
    )
    assert np.array_equal(local.passing_side(image), -local.passing_side(scenes()))


def test_drawn_scenes_lose_the_separation_in_time_and_lie_in_their_cells():
    config = LocalConfig(boxes=200, course=(30.0, 100.0), loss=(5.0, 10.0), seed=1)
    drawn, cell, names = local.draw(policy(), config)
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

    onnx_model = network_part(Policy.load())
    assert {node.op_type for node in onnx_model.graph.node} == {"Gemm", "Tanh", "Add"}
    inputs, sign = box_of(policy(), scenes(), 0.0 * ERROR)
    session = runtime.InferenceSession(
        onnx_model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    turn = session.run(None, {"inputs": inputs.middle.astype(np.float32)})[0][:, 1]
    np.testing.assert_allclose(
        sign * np.clip(turn, -1.0, 1.0), answers(policy(), scenes()), atol=0.02
    )


def test_the_command_writes_the_map_and_boxes_for_other_verifiers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("onnx")
    options = "--boxes 2 --depth 1 --course 135 180 --vnnlib 1 --out"
    arguments = [*options.split(), str(tmp_path / "out")]
    assert local.main(arguments) == 0
    written = json.loads((tmp_path / "out/local.json").read_text())
    assert written["policy_sha256"] == policy().sha256
    assert len(written["cells"]) == 5
    for name in local.QUESTIONS:
        assert sum(written[name][verdict]["count"] for verdict in local.ANSWERS) == 2
    assert "side: " in capsys.readouterr().out
    box = (tmp_path / "out/box_000.vnnlib").read_text()
    assert (box.count("declare-const X_"), box.count("assert")) == (53, 107)
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {
        ".json",
        ".onnx",
        ".png",
        ".svg",
        ".vnnlib",
        ".yaml",
    }
    config = str(tmp_path / "out/config.yaml")
    assert local.main(["--config", config, "--out", str(tmp_path / "again")]) == 0
    for path in (tmp_path / "out").iterdir():
        assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    "words", [["--course", "90", "10"], ["--loss", "0", "90"], ["--boxes", "0"]]
)
def test_bad_usage_is_refused_with_the_option(words: list[str]):
    with pytest.raises(ConfigError, match=words[0]):
        local.main(words)
