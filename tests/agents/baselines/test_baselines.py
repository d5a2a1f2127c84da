"""Baselines obey the action contract, treat left and right alike where they should, and go home
when it is clear.
"""

import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.baselines.acas_nnet import Network, NnetError, load_logic, read
from agents.baselines.baselines import (
    BASELINES,
    Observation,
    PotentialField,
    course_to_goal,
    may_return,
    steer,
)
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.kinematics import SURROGATE, VehicleState
from envs.relative import straight_cpa
from tests.support import recorded_path

NAMES = tuple(BASELINES)


def make_observation(own, intruders, goal=(15_000.0, 0.0), left=300.0) -> Observation:
    """Return the observation of one encounter from hand-made numbers (x, y, heading, speed)."""
    return Observation(
        VehicleState(*(np.array([float(value)]) for value in own)),
        VehicleState(
            *(np.array([[float(intruder[i]) for intruder in intruders]]) for i in range(4))
        ),
        np.ones((1, len(intruders)), bool),
        np.array([float(goal[0])]),
        np.array([float(goal[1])]),
        left,
    )


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "field", ["own.x", "own.speed", "intruders.heading", "goal_y", "time_left"]
)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_sight_that_is_not_finite_is_refused_by_name(name: str, field: str, value: float) -> None:
    observation, (part, *names) = (
        make_observation((0, 0, 0, 75), [(9_000, 0, math.pi, 75)]),
        field.split("."),
    )
    old = getattr(observation, part)
    spoiled = old._replace(**{names[0]: getattr(old, names[0]) + value}) if names else old + value
    with pytest.raises(ValueError, match=rf"^{field}.* is (nan|inf)"):
        decide(name, observation._replace(**{part: spoiled, "goal_x": observation.goal_x}))


@pytest.mark.parametrize("name", NAMES)
def test_an_absent_intruder_may_be_anything(name: str) -> None:
    observation = make_observation((0, 0, 0, 75), [(9_000, 0, math.pi, 75)])._replace(
        mask=np.zeros((1, 1), bool)
    )
    with np.errstate(invalid="ignore"):
        nobody = decide(
            name,
            observation._replace(
                intruders=VehicleState(*(np.full((1, 1), math.nan) for _ in range(4)))
            ),
        )
    np.testing.assert_array_equal(nobody, decide(name, observation))


def decide(name: str, observation: Observation) -> np.ndarray:
    baseline = BASELINES[name](PAPER)
    action, memory = baseline.decide(observation, np.zeros(len(observation.goal_x), np.int8))
    assert memory.shape == observation.goal_x.shape
    return action


def turn_observation(observation: Observation, angle: float) -> Observation:
    sine, cosine = math.sin(angle), math.cos(angle)

    def state(s: VehicleState) -> VehicleState:
        return VehicleState(
            s.x * cosine - s.y * sine,
            s.x * sine + s.y * cosine,
            wrap(s.heading + angle, np),
            s.speed,
        )

    x, y = (
        observation.goal_x * cosine - observation.goal_y * sine,
        observation.goal_x * sine + observation.goal_y * cosine,
    )
    return observation._replace(
        own=state(observation.own), intruders=state(observation.intruders), goal_x=x, goal_y=y
    )


def mirror_observation(observation: Observation) -> Observation:
    def state(s: VehicleState) -> VehicleState:
        return VehicleState(s.x, -s.y, wrap(-s.heading, np), s.speed)

    return observation._replace(
        own=state(observation.own),
        intruders=state(observation.intruders),
        goal_y=-observation.goal_y,
    )


def random_observations(count: int, intruders: int) -> Observation:
    rng = np.random.default_rng(4)

    def states(shape) -> VehicleState:
        return VehicleState(
            rng.uniform(-8_000, 8_000, shape),
            rng.uniform(-8_000, 8_000, shape),
            rng.uniform(-math.pi, math.pi, shape),
            rng.uniform(50, 100, shape),
        )

    goal = rng.uniform(-15_000, 15_000, (2, count))
    mask = rng.random((count, intruders)) < 0.7
    return Observation(states(count), states((count, intruders)), mask, goal[0], goal[1], 200.0)


@pytest.mark.parametrize("name", NAMES)
def test_actions_are_finite_within_the_contract_and_held_speeds_held(name: str) -> None:
    action = decide(name, random_observations(3_000, 3))
    assert action.shape == (3_000, 2)
    assert np.isfinite(action).all()
    assert np.abs(action).max() <= 1.0
    assert action[:, 0].any() == (name == "mvp_speed")


@pytest.mark.parametrize("name", NAMES)
def test_a_rotated_scene_gets_the_same_action(name: str) -> None:
    observation = random_observations(2_000, 3)
    np.testing.assert_allclose(
        decide(name, turn_observation(observation, 1.2)), decide(name, observation), atol=2e-5
    )


@pytest.mark.parametrize("name", ["none", "mvp", "mvp_speed"])
def test_a_mirrored_scene_gets_the_mirrored_action(name: str) -> None:
    # The rules of the air are one-sided on purpose.
    observation = random_observations(2_000, 1)
    ours, theirs = decide(name, observation), decide(name, mirror_observation(observation))
    # Neither side is nearer in a hit: there the choice is to the right.
    own = VehicleState(*(field[:, None] for field in observation.own))
    aside = straight_cpa(own, observation.intruders, np).distance[:, 0] > 10.1
    assert 0.95 < aside.mean() < 1.0
    np.testing.assert_allclose(theirs[aside], (ours * [1.0, -1.0])[aside], atol=2e-5)


@pytest.mark.parametrize("name", NAMES)
def test_the_order_and_the_absence_of_intruders_do_not_matter(name: str) -> None:
    observation = random_observations(1_000, 3)
    order = [2, 0, 1]
    reordered = observation._replace(
        intruders=VehicleState(*(field[:, order] for field in observation.intruders)),
        mask=observation.mask[:, order],
    )
    np.testing.assert_allclose(decide(name, reordered), decide(name, observation), atol=1e-9)
    moved = VehicleState(
        *(np.where(observation.mask, field, field[:, :1]) for field in observation.intruders)
    )
    np.testing.assert_allclose(
        decide(name, observation._replace(intruders=moved)), decide(name, observation), atol=1e-9
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_row_does_not_depend_on_its_company(name: str) -> None:
    observation = random_observations(50, 3)
    together = decide(name, observation)
    for i in range(0, 50, 7):
        alone = Observation(
            VehicleState(*(field[i : i + 1] for field in observation.own)),
            VehicleState(*(field[i : i + 1] for field in observation.intruders)),
            observation.mask[i : i + 1],
            observation.goal_x[i : i + 1],
            observation.goal_y[i : i + 1],
            observation.time_left,
        )
        np.testing.assert_array_equal(decide(name, alone)[0], together[i])


FAR = (90_000, 90_000, 0, 50)


@pytest.mark.parametrize("name", NAMES)
def test_without_conflict_everybody_goes_home(name: str) -> None:
    assert decide(name, make_observation((0, 0, 0, 80), [FAR]))[0] == pytest.approx([0.0, 0.0])
    assert decide(name, make_observation((0, 0, 0, 80), [FAR], (9_000, 9_000)))[0, 1] == 1.0
    assert decide(name, make_observation((0, 0, 0, 80), [FAR], (9_000, -9_000)))[0, 1] == -1.0


@pytest.mark.parametrize(
    ("intruder", "rules", "mvp"),
    [
        ((9_000, 0, math.pi, 80), -1.0, -1.0),  # head-on: to the right
        (
            (6_000, -6_000, math.pi / 2, 80),
            -1.0,
            -1.0,
        ),  # from the right, at the same time: behind it
        ((4_000, 0, 0.0, 50), -1.0, -1.0),  # overtaking
        (
            (6_000, 5_600, -math.pi / 2, 80),
            0.0,
            1.0,
        ),  # from the left it must yield; it crosses ahead: go behind it
        ((6_000, 6_400, -math.pi / 2, 80), 0.0, -1.0),  # it crosses behind: go on ahead of it
    ],
)
def test_sides_by_hand(intruder, rules: float, mvp: float) -> None:
    observation = make_observation((0, 0, 0, 80), [intruder])
    assert np.sign(decide("rules", observation)[0, 1]) == rules
    assert np.sign(decide("mvp", observation)[0, 1]) == mvp


def test_the_right_of_way_is_given_up_when_the_other_does_not_yield() -> None:
    near = make_observation((0, 0, 0, 80), [(3_500, 3_400, -math.pi / 2, 80)])
    assert decide("rules", near)[0, 1] == -1.0


def test_mvp_passes_on_the_side_that_is_nearer_already() -> None:
    # The intruder passes ahead from right to left by 300 m: it is let pass, to its right.
    ahead = make_observation((0, 0, 0, 80), [(6_000, -5_700, math.pi / 2, 80)])
    assert decide("mvp", ahead)[0, 1] < 0.0
    behind = make_observation((0, 0, 0, 80), [(6_000, -6_700, math.pi / 2, 80)])
    assert decide("mvp", behind)[0, 1] > 0.0


def test_mvp_s_new_velocity_touches_the_protected_zone() -> None:
    """The pushed velocity misses by the protected distance: the published construction, on a
    crossing from the left.
    """
    own, intruder = (0.0, 0.0, 0.0, 80.0), (7_000.0, 7_400.0, -math.pi / 2, 80.0)
    observation = make_observation(own, [intruder])
    field = PotentialField(PAPER, speed=True)
    from agents.baselines.baselines import _conflicts

    conflict = _conflicts(observation, observation.own.heading, 1_100.0, 300.0)
    push_x, push_y = field._push(observation, conflict, 1_100.0)
    vx, vy = 0.0 - (80.0 - push_x[0]), -80.0 + push_y[0]
    time = -(intruder[0] * vx + intruder[1] * vy) / (vx * vx + vy * vy)
    assert math.hypot(intruder[0] + vx * time, intruder[1] + vy * time) == pytest.approx(
        1_100.0, abs=1.0
    )


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), st.floats(50, 100))
def test_steering_turns_the_short_way_and_stops_at_the_course(
    heading: float, course: float, speed: float
) -> None:
    own = VehicleState(np.zeros(1), np.zeros(1), np.array([heading]), np.array([speed]))
    steering = steer(own, np.array([course]), PAPER)[0]
    error = wrap(np.array([course - heading]), np)[0]
    assert steering == pytest.approx(np.clip(0.5 * error / SURROGATE.yaw_rate_max, -1, 1))
    # One second of it never goes past the course.
    assert abs(steering * SURROGATE.yaw_rate_max) <= abs(error)


def test_a_goal_inside_the_turning_circle_is_flown_away_from_first() -> None:
    # At 100 m/s the circle has a radius of 1910 m; its middle is the worst place.
    inside = make_observation((0, 0, 0, 100), [FAR], (0.0, 1_900.0))
    assert course_to_goal(inside, PAPER)[0] == 0.0
    outside = make_observation((0, 0, 0, 100), [FAR], (0.0, 4_500.0))
    assert course_to_goal(outside, PAPER)[0] == pytest.approx(math.pi / 2)


def test_the_way_back_is_free_past_the_closest_point_and_not_before() -> None:
    before = make_observation((0, 0, 0, 80), [(6_000, 0, math.pi, 80)])
    after = make_observation((0, 0, 0, 80), [(-2_000, 0, math.pi, 80)])
    assert not may_return(before, PAPER, 1_000.0)[0]
    assert may_return(after, PAPER, 1_000.0)[0]


def test_mvp_with_speed_hurries_when_it_is_late() -> None:
    late = make_observation((0, 0, 0, 60), [FAR], (15_000, 0), left=180.0)
    assert decide("mvp_speed", late)[0, 0] == 1.0
    assert decide("mvp_speed", late._replace(time_left=290.0))[0, 0] == 0.0


# Networks in the .nnet format are read exactly or refused, and flown as logics.


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


def write_file(tmp_path: Path, text: str, name: str = "small.nnet") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_network_by_hand(tmp_path: Path) -> None:
    network = read(write_file(tmp_path, SMALL))
    # (3, 0.5) becomes (0.5, 0): hidden (1, 0, 0), outputs (1.1, -0.8), times 3, plus 7.
    assert network(np.array([[3.0, 0.5]])) == pytest.approx(np.array([[10.3, 4.6]]))
    # Beyond the maxima the input is clipped.
    np.testing.assert_array_equal(
        network(np.array([[99.0, 9.0]])), network(np.array([[10.0, 1.0]]))
    )


def test_byte_order_mark_comments_and_blank_lines_change_nothing(tmp_path: Path) -> None:
    lines = SMALL.splitlines()
    for number in range(len(lines) + 1):
        for more in ("", "  // between Zürich and Genève", " \t"):
            text = "\ufeff" + "\n".join([*lines[:number], more, *lines[number:]])
            network = read(write_file(tmp_path, text))
            assert network(np.array([[3.0, 0.5]])) == pytest.approx(np.array([[10.3, 4.6]]))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda lines: [], r"small.nnet: begins with \[\], expected 4 whole numbers"),
        (
            lambda lines: [*lines[:9], "1.0,x,", *lines[10:]],
            r"small.nnet: not a text of numbers \(.*'x'\)",
        ),
        (
            lambda lines: [*lines[:9], "1.0,nan,", *lines[10:]],
            r"small.nnet: a number is not finite",
        ),
        (
            lambda lines: [*lines[:3], "3,3,2,", *lines[4:]],
            r"sizes \[3, 3, 2\] do not fit 2 inputs",
        ),
        (
            lambda lines: [*lines[:2], "2,2,2.5,3,", *lines[3:]],
            r"begins with .*2\.5.*, expected 4 whole numbers",
        ),
        (
            lambda lines: [*lines[:2], "1000000000,2,2,3,", *lines[3:]],
            r"expected 1000000001 whole numbers",
        ),
        (lambda lines: [*lines[:8], "4.0,0.0,3.0,", *lines[9:]], "ranges above 0"),
        (
            lambda lines: [*lines[:6], "10.0,-1.0,", *lines[7:]],
            r"maxima of the inputs above their minima",
        ),
        (lambda lines: [*lines, "0.3,"], r"36 numbers, expected 35 for the sizes \[2, 3, 2\]"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path: Path, change, sentence: str) -> None:
    with pytest.raises(NnetError, match=sentence):
        read(write_file(tmp_path, "".join(f"{line}\n" for line in change(SMALL.splitlines()))))


def test_every_cut_of_a_file_is_refused(tmp_path: Path) -> None:
    lines = SMALL.splitlines()
    for count in range(len(lines)):
        with pytest.raises(NnetError, match="expected"):
            read(write_file(tmp_path, "\n".join(lines[:count])))


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
        load_logic(write_file(tmp_path, SMALL), PAPER)


def test_inputs_are_checked(tmp_path: Path) -> None:
    network = read(write_file(tmp_path, SMALL))
    with pytest.raises(ValueError, match="not finite"):
        network(np.array([[math.nan, 0.0]]))
    with pytest.raises(ValueError, match=r"expected \[N, 2\]"):
        network(np.zeros((4, 3)))


def logic_file(path: Path, inputs: int, best: int, *, sign: float = 1.0) -> None:
    """Write a logic that always advises ``best``: the largest score, or with sign -1 the
    smallest.
    """
    ones = ",".join(["1.0"] * inputs) + ","
    scores = "".join(f"{sign * (output == best)},\n" for output in range(5))
    zeros = (",".join(["0.0"] * inputs) + ",\n") * 5
    ends = ",".join(["-1e9"] * inputs) + ",\n" + ",".join(["1e9"] * inputs) + ",\n"
    path.write_text(
        f"1,{inputs},5,5,\n{inputs},5,\n0,\n{ends}{'0.0,' * (inputs + 1)}\n{ones}1.0,\n{zeros}{scores}"
    )


@pytest.mark.parametrize(
    ("inputs", "stem", "sign"),
    [(3, "pra{}_", 1.0), (5, "run2a_{}_1_", -1.0), (5, "v2a_{}_1_", -1.0)],
)
def test_the_network_of_the_previous_advisory_is_asked(
    tmp_path: Path, inputs: int, stem: str, sign: float
) -> None:
    first = 0 if inputs == 3 else 1
    for previous in range(5):
        # After advisory p comes p + 1, so that every network differs from the others.
        logic_file(
            tmp_path / f"{stem.format(first + previous)}x.nnet",
            inputs,
            (previous + 1) % 5,
            sign=sign,
        )
    logic = load_logic(tmp_path / f"{stem.format(first + 2)}x.nnet", PAPER)
    count = np.arange(5)
    own = VehicleState(*(np.zeros(5) for _ in range(3)), np.full(5, 60.0))
    intruder = VehicleState(*(np.full((5, 1), value) for value in (2_000.0, 0.0, math.pi, 60.0)))
    observation = Observation(
        own, intruder, np.ones((5, 1), bool), np.full(5, 9_000.0), np.zeros(5), 300.0
    )
    action, memory = logic.decide(observation, count.astype(np.int8))
    assert memory.tolist() == [1, 2, 3, 4, 0]
    # Weak left, weak right, strong left, strong right at 1.5 and 3 deg/s, then clear: straight on,
    # not home.
    assert action[:, 1] == pytest.approx([0.5, -0.5, 1.0, -1.0, 0.0])
    assert not action[:, 0].any()


def test_a_missing_sibling_is_named(tmp_path: Path) -> None:
    logic_file(tmp_path / "pra0_x.nnet", 3, 0)
    with pytest.raises(NnetError, match=r"pra1_x\.nnet: there is no such file"):
        load_logic(tmp_path / "pra0_x.nnet", PAPER)


def test_the_published_networks_turn_away_and_mirror() -> None:
    path = recorded_path("horizontalcas/HCAS_rect_v6_pra0_tau00_25HU_3000.nnet")
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
    is_mirrored = (
        network(scenes).argmax(1) == np.array([0, 2, 1, 4, 3])[network(mirrored).argmax(1)]
    )
    assert is_mirrored.mean() > 0.85
