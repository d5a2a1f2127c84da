"""The observation contract: components by hand, symmetries, the way back, and the choice among
intruders.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.aircraft import PAPER
from envs.kinematics import VehicleState
from envs.observation import NAMES, SIZE, criticality, decode, most_critical, observe
from tests.support import (
    BACKENDS,
    Backend,
    mirror_state,
    move_state,
    random_states,
    stack_states,
    states,
    vehicle,
)

OWN_SPEED, OWN_HEADING, SPEED, HEADING, BEARING, DISTANCE, GOAL_BEARING, GOAL_DISTANCE = range(8)
ANGLES = [OWN_HEADING, HEADING, BEARING, GOAL_BEARING]
near = st.floats(-7_000.0, 7_000.0)


def see(own: VehicleState, intruder: VehicleState, x: float, y: float) -> np.ndarray:
    return observe(own, intruder, np.array([x]), np.array([y]), PAPER, np)[0]


def turns_apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return how far apart two angles are that are given as fractions of pi."""
    return np.abs(np.remainder(a - b + 1.0, 2.0) - 1.0)


def test_the_order_is_the_contract() -> None:
    assert SIZE == 8
    assert NAMES == (
        "own_speed",
        "own_heading",
        "intruder_speed",
        "intruder_heading",
        "bearing_to_intruder",
        "distance_to_intruder",
        "bearing_to_goal",
        "distance_to_goal",
    )


def test_a_scene_by_hand() -> None:
    """Own ship heads north at 75 m/s; a 60 m/s intruder 5 km to the east heads west; the goal is 15
    km behind.
    """
    own, intruder = (
        vehicle(1_000.0, 2_000.0, 0.5 * math.pi, 75.0),
        vehicle(6_000.0, 2_000.0, -math.pi, 60.0),
    )
    observation = see(own, intruder, 1_000.0, -13_000.0)
    np.testing.assert_allclose(
        observation[[OWN_SPEED, OWN_HEADING, SPEED]], [0.0, 0.5, -0.2], atol=1e-7
    )
    np.testing.assert_allclose(
        observation[[HEADING, BEARING, DISTANCE]], [-1.0, -0.5, -0.5], atol=1e-7
    )
    np.testing.assert_allclose(np.abs(observation[GOAL_BEARING]), 1.0, atol=1e-7)
    np.testing.assert_allclose(observation[GOAL_DISTANCE], 0.5, atol=1e-7)


@pytest.mark.parametrize(
    ("component", "own_speed", "intruder_speed", "metres", "expected"),
    [
        (OWN_SPEED, 50.0, 75.0, 5e3, -1.0),
        (OWN_SPEED, 100.0, 75.0, 5e3, 1.0),
        (OWN_SPEED, 87.5, 75.0, 5e3, 0.5),
        (OWN_SPEED, 30.0, 75.0, 5e3, -1.0),
        (SPEED, 75.0, 0.0, 5e3, -1.0),
        (SPEED, 75.0, 75.0, 5e3, 0.0),
        (SPEED, 75.0, 150.0, 5e3, 1.0),
        (SPEED, 75.0, 200.0, 5e3, 1.0),
        (DISTANCE, 75.0, 75.0, 0.0, -1.0),
        (DISTANCE, 75.0, 75.0, 1e3, -0.9),
        (DISTANCE, 75.0, 75.0, 10e3, 0.0),
        (DISTANCE, 75.0, 75.0, 20e3, 1.0),
        (DISTANCE, 75.0, 75.0, 35e3, 1.0),
        (GOAL_DISTANCE, 75.0, 75.0, 2.5e3, -0.75),
    ],
)
def test_scales_and_clipping(
    component: int, own_speed: float, intruder_speed: float, metres: float, expected: float
) -> None:
    observation = see(
        vehicle(0.0, 0.0, 0.0, own_speed), vehicle(metres, 0.0, 0.0, intruder_speed), metres, 0.0
    )
    assert observation[component] == pytest.approx(expected, abs=1e-12)


@given(states(), states(), near, near)
def test_every_component_lies_within_one(
    own: VehicleState, intruder: VehicleState, x: float, y: float
) -> None:
    components = observe(own, intruder, np.float64(x), np.float64(y), PAPER, np)
    assert components.shape == (8,)
    assert np.all(np.abs(components) <= 1.0)


@given(states(), states(), near, near, st.floats(-math.pi, math.pi), near, near)
def test_only_the_headings_notice_that_the_scene_was_moved_and_turned(
    own: VehicleState,
    intruder: VehicleState,
    x: float,
    y: float,
    angle: float,
    east: float,
    north: float,
) -> None:
    goal = VehicleState(np.float64(x), np.float64(y), own.heading, own.speed)
    moved = [move_state(vehicle, angle, east, north) for vehicle in (own, intruder, goal)]
    before = observe(own, intruder, goal.x, goal.y, PAPER, np)
    after = observe(moved[0], moved[1], moved[2].x, moved[2].y, PAPER, np)
    lengths = [OWN_SPEED, SPEED, DISTANCE, GOAL_DISTANCE]
    np.testing.assert_allclose(after[lengths], before[lengths], atol=1e-9)
    turned = np.where(np.isin(np.arange(8), [OWN_HEADING, HEADING]), angle / math.pi, 0.0)
    if min(before[DISTANCE], before[GOAL_DISTANCE]) > -0.9999:
        assert np.max(turns_apart(after[ANGLES], (before + turned)[ANGLES])) < 1e-6


@given(states(), states(), near, near)
def test_a_mirrored_scene_flips_the_sign_of_every_angle(
    own: VehicleState, intruder: VehicleState, x: float, y: float
) -> None:
    left = observe(own, intruder, np.float64(x), np.float64(y), PAPER, np)
    right = observe(
        mirror_state(own), mirror_state(intruder), np.float64(x), np.float64(-y), PAPER, np
    )
    sign = np.where(np.isin(np.arange(8), ANGLES), -1.0, 1.0)
    assert np.max(turns_apart((sign * left)[ANGLES], right[ANGLES])) < 1e-6
    np.testing.assert_allclose(np.delete(right, ANGLES), np.delete(left, ANGLES), atol=1e-9)


@given(states(), states(), near, near)
def test_decode_recovers_what_was_not_clipped(
    own: VehicleState, intruder: VehicleState, x: float, y: float
) -> None:
    """In the ownship's frame, against rotation matrices; 5 mm at 20 km is what the angles' 1e-7 rad
    allow.
    """
    goal_x, goal_y = own.x + x, own.y + y
    intruder = intruder._replace(x=own.x + 0.7 * intruder.x, y=own.y + 0.7 * intruder.y)
    components = observe(own, intruder, goal_x, goal_y, PAPER, np)
    decoded = decode(list(components), PAPER, np)
    ahead = np.array(
        [[np.cos(own.heading), np.sin(own.heading)], [-np.sin(own.heading), np.cos(own.heading)]]
    )
    course = np.array([np.cos(intruder.heading), np.sin(intruder.heading)])
    expected = [
        own.speed,
        *(ahead @ np.array([intruder.x - own.x, intruder.y - own.y])),
        *(ahead @ course * intruder.speed),
        *(ahead @ np.array([goal_x - own.x, goal_y - own.y])),
    ]
    np.testing.assert_allclose(decoded, expected, rtol=0.0, atol=5e-3)


def test_decode_takes_any_pair_of_courses() -> None:
    """Their difference runs from almost -2 pi to almost 2 pi; ends of the ranges included."""
    courses = np.concatenate([np.linspace(-1.0, 1.0, 41), [-0.999999, 0.999999]])
    own, intruder = (grid.ravel() for grid in np.meshgrid(courses, courses))
    zero = np.zeros_like(own)
    decoded = decode([zero, own, zero, intruder, zero, zero, zero, zero], PAPER, np)
    np.testing.assert_allclose(
        decoded.intruder_vx, 75.0 * np.cos(math.pi * (intruder - own)), atol=1e-6
    )
    np.testing.assert_allclose(
        decoded.intruder_vy, 75.0 * np.sin(math.pi * (intruder - own)), atol=1e-6
    )


@pytest.mark.parametrize("backend", BACKENDS, ids=lambda backend: backend.name)
def test_backends_observe_alike(backend: Backend) -> None:
    generator = np.random.default_rng(0)
    own, intruder = random_states(generator, 1_000), random_states(generator, 1_000)
    goal = generator.uniform(-1e4, 1e4, (2, 1_000))
    inputs = [backend.round_values(column) for column in (*own, *intruder, *goal)]
    expected = observe(
        VehicleState(*inputs[:4]), VehicleState(*inputs[4:8]), inputs[8], inputs[9], PAPER, np
    )

    def components(*fields):
        components_of = observe(
            VehicleState(*fields[:4]),
            VehicleState(*fields[4:8]),
            fields[8],
            fields[9],
            PAPER,
            backend.xp,
        )
        return (
            components_of
            if isinstance(components_of, list)
            else tuple(components_of[..., i] for i in range(SIZE))
        )

    observed = np.stack(backend.apply(components, *inputs), axis=-1)
    difference = np.abs(observed - expected)
    difference[:, ANGLES] = turns_apart(observed, expected)[:, ANGLES]
    # A bearing to what is near turns quickly with rounded positions: 1 mm of float32 at 100 m.
    far = (expected[:, DISTANCE] > -0.99) & (expected[:, GOAL_DISTANCE] > -0.99)
    assert np.max(difference[far]) < (1e-5 if backend.dtype is np.float32 else 1e-7)


# The most critical of several intruders.

CRUISE = vehicle(0.0, 0.0, 0.0, 100.0)
SOON = vehicle(4_000.0, 200.0, -math.pi, 100.0)
"""Head-on: inside 1500 m after (4000 - sqrt(1500^2 - 200^2)) / 200 = 12.6 s."""
LATER = vehicle(12_000.0, -500.0, -math.pi, 100.0)
"""Head-on: inside 1500 m after 52.9 s."""
NEARER_BUT_LEAVING = vehicle(-2_000.0, 0.0, -math.pi, 100.0)
"""The nearest of all, behind and flying away."""
PASSING_WIDE = vehicle(3_000.0, 1_600.0, -math.pi, 100.0)
"""Passes 1600 m abeam after 15 s: no conflict."""
PASSING_WIDER = vehicle(3_000.0, 5_000.0, -math.pi, 100.0)
INSIDE = vehicle(800.0, 0.0, 0.0, 90.0)
"""Nearer than the radius already, and closing down to nothing."""
INSIDE_BUT_LEAVING = vehicle(-900.0, 0.0, -math.pi, 90.0)
"""Nearer than the radius too, but it will come no closer."""


def choose_of(*intruders: VehicleState, mask: tuple[bool, ...] | None = None) -> int:
    group = stack_states(*intruders)
    mask = np.array([mask if mask is not None else (True,) * len(intruders)])
    chosen = most_critical(CRUISE, group, mask, PAPER, np)
    is_chosen = [
        all(np.array_equal(a, b) for a, b in zip(chosen, intruder, strict=True))
        for intruder in intruders
    ]
    assert sum(is_chosen) == 1
    return is_chosen.index(True)


def test_criticality_is_the_time_to_the_conflict() -> None:
    own = VehicleState(*(field[:, None] for field in CRUISE))
    criticalities = criticality(
        own, stack_states(SOON, LATER, INSIDE, INSIDE_BUT_LEAVING, PASSING_WIDE), PAPER, np
    )[0]
    soon = (4_000.0 - math.sqrt(1_500.0**2 - 200.0**2)) / 200.0
    later = (12_000.0 - math.sqrt(1_500.0**2 - 500.0**2)) / 200.0
    np.testing.assert_allclose(
        criticalities, [soon, later, -1_500.0, -600.0, 11_600.0], rtol=1e-6, atol=1e-3
    )


@pytest.mark.parametrize(
    ("intruders", "expected"),
    [
        ((SOON, LATER), 0),
        ((LATER, SOON), 1),
        ((NEARER_BUT_LEAVING, LATER), 1),
        ((PASSING_WIDE, LATER), 1),
        ((PASSING_WIDER, PASSING_WIDE), 1),
        ((SOON, INSIDE, LATER), 1),
        ((SOON, INSIDE_BUT_LEAVING, INSIDE), 2),
        ((PASSING_WIDE, NEARER_BUT_LEAVING, SOON, LATER), 2),
    ],
)
def test_the_conflict_that_comes_first_is_chosen(
    intruders: tuple[VehicleState, ...], expected: int
) -> None:
    assert choose_of(*intruders) == expected


def test_an_absent_intruder_is_never_chosen() -> None:
    assert choose_of(INSIDE, SOON, PASSING_WIDER, mask=(False, False, True)) == 2
    assert choose_of(INSIDE, SOON, LATER, mask=(False, True, True)) == 1


def crowd(count: int, most: int, seed: int) -> tuple[VehicleState, VehicleState, np.ndarray]:
    generator = np.random.default_rng(seed)
    mask = generator.random((count, most)) < 0.6
    mask[np.arange(count), generator.integers(0, most, count)] = True
    return random_states(generator, count), random_states(generator, count, most), mask


def test_of_many_a_present_one_of_the_least_criticality_is_chosen() -> None:
    """Against a plain loop."""
    own, intruders, mask = crowd(500, 5, seed=1)
    chosen = most_critical(own, intruders, mask, PAPER, np)
    rank = criticality(VehicleState(*(field[:, None] for field in own)), intruders, PAPER, np)
    for row in range(500):
        best = min(np.flatnonzero(mask[row]), key=lambda k, row=row: rank[row, k])
        assert chosen.x[row] == intruders.x[row, best]
        assert chosen.heading[row] == intruders.heading[row, best]


def test_the_order_of_the_intruders_does_not_matter() -> None:
    own, intruders, mask = crowd(500, 5, seed=2)
    order = np.random.default_rng(3).permutation(5)
    before = most_critical(own, intruders, mask, PAPER, np)
    after = most_critical(
        own, VehicleState(*(field[:, order] for field in intruders)), mask[:, order], PAPER, np
    )
    np.testing.assert_array_equal(np.stack(after), np.stack(before))


def test_a_single_intruder_takes_a_short_way_to_the_same_answer() -> None:
    own, intruders, _ = crowd(200, 1, seed=4)
    padded = VehicleState(
        *(np.concatenate([field, CRUISE.x + 0.0 * field], axis=-1) for field in intruders)
    )
    general = most_critical(own, padded, np.tile([True, False], (200, 1)), PAPER, np)
    short = most_critical(own, intruders, np.ones((200, 1), bool), PAPER, np)
    np.testing.assert_array_equal(np.stack(short), np.stack(general))
