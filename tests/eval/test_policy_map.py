"""Where a policy fails: the map shows its commands and scores, and failures are grouped without loss."""

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import ConfigError
from agents.policy.inference import Policy
from envs.edge.command import run_cli
from envs.kinematics import SURROGATE, VehicleState
from envs.observation import observe
from envs.outcome import RULES
from eval.failures.groups import HOW, failures, grouped, representatives
from eval.failures.run import main
from eval.monte_carlo import run as monte_carlo
from eval.policy_map import run as policy_map
from eval.policy_map.advisory import Advisory, Scene, advise, name_of, relative_velocity, shares
from eval.policy_map.quality import (
    CONFLICT_RADIUS,
    FARTHEST,
    NEAREST,
    Recorded,
    around_conflicts,
    chatter,
    mirror_error,
    mirrored,
    record,
)
from tests.eval.conftest import COUNT

LIMITS = SURROGATE
SCENE = Scene(75.0, 90.0, math.radians(-90.0), math.radians(30.0), 8_000.0)
SMALL = ["--cells", "31", "--samples", "200", "--encounters", "4"]


def even_handed(observation: np.ndarray) -> np.ndarray:
    """Return actions that turn away from the intruder's side and brake near by."""
    return np.stack([observation[:, 5], -np.clip(3.0 * observation[:, 4], -1.0, 1.0)], axis=-1)


def test_a_map_is_what_the_policy_commands_at_each_place():
    seen = []

    def decider(observation: np.ndarray) -> np.ndarray:
        seen.append(observation)
        return even_handed(observation)

    advisory = advise(decider, SCENE, 6_000.0, 5, LIMITS)
    assert advisory.place == pytest.approx([-4_800.0, -2_400.0, 0.0, 2_400.0, 4_800.0])
    (observation,) = seen
    assert observation.dtype == np.float32
    ahead_left = 4 * 5 + 1  # row 4: 4800 m ahead, column 1: 2400 m to the left
    own_speed, own, speed, heading, bearing, distance, goal, goal_distance = observation[ahead_left]
    assert own_speed == 0.0
    assert (75.0 * (speed + 1.0), 10_000.0 * (goal_distance + 1.0)) == pytest.approx((90.0, 8_000.0))
    assert distance == pytest.approx(math.hypot(4_800.0, 2_400.0) / 10_000.0 - 1.0, abs=1e-6)
    # The contract counts to the left: the intruder stands there, the goal too, and it flies 90 degrees to the right.
    assert math.pi * bearing == pytest.approx(math.atan2(2_400.0, 4_800.0), abs=1e-6)
    assert math.degrees(math.pi * goal) == pytest.approx(30.0, abs=1e-4)
    assert math.degrees(math.pi * (heading - own)) == pytest.approx(-90.0, abs=1e-4)
    # It stands to the left, so that the turn goes to the right, which is negative.
    assert advisory.yaw_rate[4, 1] == pytest.approx(-3.0 * bearing * LIMITS.yaw_rate_max, rel=1e-6)
    assert advisory.acceleration[4, 1] == pytest.approx(-0.5 * abs(distance), rel=1e-6)


def test_a_relative_heading_of_minus_90_comes_from_the_left():
    right, ahead = relative_velocity(SCENE)
    assert (right, ahead) == pytest.approx((90.0, -75.0))
    assert name_of(SCENE.relative_heading) == "crossing from the left"
    words = {180: "head-on", -170: "head-on", 0: "same course", 30: "converging from the right"}
    words |= {90: "crossing from the right", -150: "oncoming from the left"}
    assert {degrees: name_of(math.radians(degrees)) for degrees in words} == words


def test_shares_leave_out_the_disc():
    place = np.array([-2_000.0, 0.0, 2_000.0])
    yaw_rate = np.full((3, 3), 0.05)
    yaw_rate[1, 1] = -0.05  # in the disc
    yaw_rate[0, 0], yaw_rate[0, 1] = -0.05, 0.001
    acceleration = np.full((3, 3), -0.3)
    found = shares(Advisory(SCENE, place, yaw_rate, acceleration), 1_000.0)
    assert found["relative_heading_deg"] == -90.0
    assert [found[f"{side}_share"] for side in ("left", "right", "straight")] == [6 / 8, 1 / 8, 1 / 8]
    assert [found[f"{kind}_share"] for kind in ("accelerate", "brake", "steady")] == [0.0, 1.0, 0.0]


def test_the_mirror_is_that_of_the_world():
    random = np.random.default_rng(2)

    def vehicle() -> VehicleState:
        x, y = random.uniform(-6_000.0, 6_000.0, (2, 200))
        return VehicleState(x, y, random.uniform(-math.pi, math.pi, 200), random.uniform(50.0, 100.0, 200))

    def reflected(state: VehicleState) -> VehicleState:
        return state._replace(y=-state.y, heading=-state.heading)

    own, intruder = vehicle(), vehicle()
    goal_x, goal_y = random.uniform(-6_000.0, 6_000.0, (2, 200))
    there = observe(reflected(own), reflected(intruder), goal_x, -goal_y, np)
    np.testing.assert_allclose(mirrored(observe(own, intruder, goal_x, goal_y, np)), there, atol=1e-7)


def test_an_even_handed_policy_has_no_mirror_error():
    found = mirror_error(even_handed, around_conflicts(500, 0), LIMITS)
    assert found["observations"] == 500
    assert found["yaw_rate_deg_s"] == found["acceleration_m_s2"] == {"mean": 0.0, "p95": 0.0, "max": 0.0}
    assert found["same_side_share"] == 0.0


def test_the_mirror_error_is_twice_a_bias_to_one_side():
    def biased(observation: np.ndarray) -> np.ndarray:
        # Half of the full turn to the left whatever comes, and more thrust for what comes from the left.
        return np.stack([0.1 * np.sign(observation[:, 4]), np.full(len(observation), 0.5)], axis=-1)

    found = mirror_error(biased, around_conflicts(500, 0), LIMITS)
    assert found["yaw_rate_deg_s"] == pytest.approx({"mean": 3.0, "p95": 3.0, "max": 3.0})
    assert found["acceleration_m_s2"] == pytest.approx({"mean": 0.1, "p95": 0.1, "max": 0.1})
    assert found["same_side_share"] == 1.0


def test_samples_lie_around_conflicts_and_fill_them():
    observation = around_conflicts(2_000, 3)
    assert observation.shape == (2_000, 8)
    assert np.abs(observation).max() <= 1.0
    distance = 10_000.0 * (observation[:, 5] + 1.0)
    assert NEAREST - 1.0 <= distance.min() < 1_500.0
    assert 9_000.0 < distance.max() <= FARTHEST + 1.0
    # The miss distance, by the sine of the angle between line of sight and relative velocity.
    course = math.pi * (observation[:, 3] - observation[:, 1])
    speed, own = 75.0 * (observation[:, 2] + 1.0), 75.0 + 25.0 * observation[:, 0]
    vx, vy = speed * np.cos(course) - own, speed * np.sin(course)
    x, y = distance * np.cos(math.pi * observation[:, 4]), distance * np.sin(math.pi * observation[:, 4])
    assert (x * vx + y * vy < 0.0).all()
    assert (np.abs(x * vy - y * vx) / np.hypot(vx, vy)).max() < CONFLICT_RADIUS + 1.0
    assert (around_conflicts(2_000, 3) == observation).all()


def test_chatter_by_hand():
    nan = math.nan
    steering = np.array([[0.0, 1.0], [1.0, 1.0], [-1.0, nan]])  # two flights; the second ends after two seconds
    throttle = np.array([[0.5, 0.0], [0.5, 0.4], [0.5, nan]])
    action = np.stack([throttle, steering], axis=-1)
    recorded = Recorded(np.zeros((3, 2, 8), np.float32), action, np.array([1, 0]), np.array([1, 0]))
    found = chatter(recorded, LIMITS)
    # Changes of 3, 6 and 0 deg/s; of 0, 0 and 0.2 m/s^2.
    assert found["yaw_rate_change_deg_s_per_s"] == pytest.approx(3.0)
    assert found["acceleration_change_m_s2_per_s"] == pytest.approx(0.2 / 3.0)
    assert found["mean_yaw_rate_deg_s"] == pytest.approx(3.0 * 4.0 / 5.0)
    assert found["reversals_per_flight"]["mean"] == 0.5
    assert (found["flights"], found["violation"], found["reached"], found["timeout"]) == (2, 1, 1, 0)


def test_flights_are_recorded_while_they_last(policy: Policy):
    recorded = record(policy.rowwise, 6, 1, LIMITS)
    lasting = np.isfinite(recorded.action[..., 0]).sum(axis=0)
    assert lasting.max() <= RULES.t_max
    assert len(recorded.seen) == lasting.sum()
    np.testing.assert_array_equal(policy.rowwise(recorded.seen[:50]), recorded.action[recorded_rows(recorded)][:50])


def recorded_rows(recorded: Recorded) -> np.ndarray:
    return np.isfinite(recorded.observation[..., 0])


def test_a_run_writes_its_files_and_repeats_itself(
    tmp_path: Path, policy_path: Path, policy: Policy, capsys: pytest.CaptureFixture[str]
):
    arguments = ["--policy", str(policy_path), "--relative-heading", "-90", "--relative-heading", "20", *SMALL]
    for name in ("one", "two"):
        assert policy_map.main([*arguments, "--goal-distance", "3000", "--out", str(tmp_path / name)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("mirror error, around conflicts (200 observations): yaw rate mean")
    assert said[2].startswith("chatter, 4 circle flights: yaw rate")
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert names == {"policy_map.json", "policy_map.png", "policy_map.svg"}
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    found = json.loads((tmp_path / "one" / "policy_map.json").read_text(encoding="utf-8"))
    assert found["policy_sha256"] == policy.sha256
    assert [drawn["relative_heading_deg"] for drawn in found["maps"]] == [-90.0, 20.0]
    assert found["settings"]["cells"] == 31
    assert found["chatter"]["flights"] == 4
    # The policy made by hand turns right of what is ahead.
    assert found["mirror_error"]["around conflicts"]["same_side_share"] > 0.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--relative-heading", "200"], "--relative-heading: 200 degrees; expected -180 to 180 degrees"),
        (["--relative-heading", "nan"], "--relative-heading: nan degrees; expected"),
        (["--relative-heading", "0"] * 9, "--relative-heading: given 9 times; expected at most 8"),
        (["--own-speed", "40"], "--own-speed: 40 m/s; expected 50 to 100 m/s"),
        (["--intruder-speed", "-1"], "--intruder-speed: -1 m/s; expected 0 to 150 m/s"),
        (["--goal-distance", "30000"], "--goal-distance: 30000 m; expected 0 to 20000 m"),
        (["--extent", "500"], "--extent: 500 m; expected 1500 to 14000 m"),
        (["--cells", "3"], "--cells: 3; expected 11 to 1001"),
        (["--cells", "many"], "invalid int value: 'many'"),
        (["--encounters", "0"], "--encounters: 0; expected 1 to 10000"),
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


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
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
        "verdict": rng.choice(np.array(["resolvable", "unresolvable", "undecided"], dtype=object), count),
        "relative_heading_deg": rng.choice(edges, count) * rng.choice([-1.0, 1.0], count),
        "distance_m": rng.choice([1_000.0, 1_500.0, 3_000.0, 25_000.0], count),
        "min_separation_m": rng.choice([0.0, 949.9, 950.0, 999.9, 1_200.0], count),
    }


@given(st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_every_failure_is_in_one_group(count: int, seed: int) -> None:
    table = tables(count, seed)
    groups = grouped(table, 1_000.0)
    members = np.concatenate([group.members for group in groups]) if groups else np.array([], int)
    np.testing.assert_array_equal(np.sort(members), np.flatnonzero(failures(table)))
    assert [group.members.size for group in groups] == sorted((group.members.size for group in groups), reverse=True)
    for group in groups:
        assert group.such >= group.members.size
        assert np.all((table["outcome"][group.members] == "timeout") == (group.how == HOW[2]))


@given(st.integers(1, 200), st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_cases_are_different_failures_of_the_groups(count: int, seed: int, wanted: int) -> None:
    table = tables(count, seed)
    chosen = representatives(grouped(table, 1_000.0), wanted)
    assert len(set(chosen)) == len(chosen) <= wanted
    assert failures(table)[chosen].all()
    if wanted and failures(table).any():
        assert chosen


def test_a_run_s_failures_are_listed_and_drawn(report_run: Path, policy_path: Path, tmp_path: Path) -> None:
    out = tmp_path / "failed"
    assert main(["--run", str(report_run), "--policy", str(policy_path), "--cases", "4", "--out", str(out)]) == 0
    found = json.loads((out / "failures.json").read_text())
    summary = json.loads((report_run / "summary.json").read_text())
    resolved, resolvable = (summary["success_given_resolvable"][key] for key in ("count", "total"))
    assert found["encounters"] == COUNT
    assert found["failures"] == resolvable - resolved > 0
    with (out / "failures.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == found["failures"]
    assert {int(row["encounter"]) for row in rows} >= set(found["cases"])
    assert (out / "failures.png").stat().st_size > 10_000
    # The file of their starts is flown as they were.
    again = tmp_path / "again"
    flown = ["--mode", "policy", "--policy", str(policy_path), "--scenario", f"file:{out / 'encounters.csv'}"]
    assert monte_carlo.main([*flown, "--workers", "1", "--set", "figures=false", "--out", str(again)]) == 0
    counts = json.loads((again / "summary.json").read_text())["counts"]
    assert (counts["success"], counts["violation"] + counts["timeout"]) == (0, found["failures"])


@pytest.mark.parametrize(
    ("arguments", "said"), [(["--cases", "500"], "--cases: '500'"), (["--cases", "-1"], "--cases: '-1'")]
)
def test_bad_input_is_a_sentence(arguments: list[str], said: str, report_run: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said):
        main(["--run", str(report_run), "--out", str(tmp_path / "x"), *arguments])


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not exist"):
        main(["--run", str(tmp_path / "nowhere"), "--out", str(tmp_path / "x")])
