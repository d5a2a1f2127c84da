"""Relative geometry against brute force, and angles against libm, in every backend."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import load
from agents.config.world import AircraftConfig
from envs import starts, world
from envs.aircraft import PAPER, Aircraft, new_aircraft, ratios
from envs.angles import atan2, sincos, wrap
from envs.encounters import Encounter, EncounterError
from envs.gym import flight
from envs.kinematics import SURROGATE, Limits, VehicleState, advance
from envs.observation import observe_set, rank_urgent
from envs.relative import (
    bearing,
    distance,
    leg_separation,
    leg_separation_in_space,
    straight_cpa,
)
from envs.scenarios import SCENARIOS, scenario
from envs.trees import take
from envs.world import World
from tests.support import (
    ARRAY_BACKENDS,
    BACKENDS,
    Backend,
    angle_between,
    mirror_state,
    move_state,
    random_states,
    states,
    vehicle,
)

OTHER = Limits(0.0, 150.0, -0.5, 0.5, math.radians(3.0))
RATE = math.radians(3.0)


def meeting(
    generator: np.random.Generator, count: int, ranges: tuple[float, float]
) -> tuple[VehicleState, ...]:
    """Return pairs of aircraft some distance apart on any courses, a third of them flying almost
    side by side.
    """
    own = random_states(generator, count)
    direction, apart = (
        generator.uniform(-math.pi, math.pi, count),
        generator.uniform(*ranges, count),
    )
    intruder = random_states(generator, count)._replace(
        x=own.x + apart * np.cos(direction), y=own.y + apart * np.sin(direction)
    )
    together = generator.random(count) < 1 / 3
    heading = np.where(together, own.heading + generator.normal(0.0, 0.1, count), intruder.heading)
    speed = np.where(
        together,
        np.clip(own.speed + generator.normal(0.0, 2.0, count), 50.0, 100.0),
        intruder.speed,
    )
    return own, intruder._replace(
        heading=np.remainder(heading + math.pi, 2.0 * math.pi) - math.pi, speed=speed
    )


def brute_force(own, intruder, turns, acceleration, steps: int = 1_000):
    """Sample both real arcs every millisecond and return the smallest distance and the two final
    states.
    """
    smallest = np.full(own.x.shape, np.inf)
    for step in range(steps + 1):
        now = step / steps
        a = advance(own, acceleration, turns[0], now, SURROGATE, np)
        b = advance(intruder, 0.0 * acceleration, turns[1], now, OTHER, np)
        smallest = np.minimum(smallest, np.hypot(a.x - b.x, a.y - b.y))
    return smallest, a, b


@pytest.mark.parametrize(
    "ranges", [(900.0, 1_150.0), (100.0, 20_000.0)], ids=["at the separation", "anywhere"]
)
def test_leg_separation_is_that_of_the_real_arcs(ranges: tuple[float, float]) -> None:
    """Within the stated 0.05 m of both arcs sampled every millisecond, full deflections and any
    speeds included.
    """
    generator = np.random.default_rng(1)
    count = 4_000
    own, intruder = meeting(generator, count, ranges)
    own = own._replace(speed=np.where(generator.random(count) < 0.3, 99.75, own.speed))
    turns = [generator.choice([-1.0, 0.0, 1.0, 0.3], count) * RATE for _ in range(2)]
    acceleration = generator.choice([-0.5, 0.0, 0.5], count)
    expected, own_next, intruder_next = brute_force(own, intruder, turns, acceleration)
    separation = leg_separation(own, own_next, intruder, intruder_next, 1.0, np)
    np.testing.assert_allclose(separation, expected, rtol=0.0, atol=0.05)


def test_leg_separation_sees_a_pass_between_the_ends_of_a_step() -> None:
    """By hand: head-on with 200 m/s of closure, 100 m before to 100 m after, 30 m aside."""
    own, intruder = vehicle(0.0, 0.0, 0.0, 100.0), vehicle(100.0, 30.0, -math.pi, 100.0)
    own_next, intruder_next = vehicle(100.0, 0.0, 0.0, 100.0), vehicle(0.0, 30.0, -math.pi, 100.0)
    separation = leg_separation(own, own_next, intruder, intruder_next, 1.0, np)
    np.testing.assert_allclose(separation, 30.0, atol=1e-9)


def test_leg_separation_never_exceeds_either_end() -> None:
    generator = np.random.default_rng(2)
    own, intruder = meeting(generator, 10_000, (0.0, 3_000.0))
    own_next = advance(own, 0.5, RATE, 1.0, SURROGATE, np)
    intruder_next = advance(intruder, 0.0, -RATE, 1.0, OTHER, np)
    separation = leg_separation(own, own_next, intruder, intruder_next, 1.0, np)
    for a, b in ((own, intruder), (own_next, intruder_next)):
        assert np.all(separation <= np.hypot(a.x - b.x, a.y - b.y) + 1e-9)


@given(states(), states(), st.floats(-RATE, RATE), st.floats(-RATE, RATE))
def test_leg_separation_is_the_same_for_both_aircraft(
    own: VehicleState, other: VehicleState, turn: float, other_turn: float
) -> None:
    own_next = advance(own, 0.3, turn, 1.0, SURROGATE, np)
    other_next = advance(other, 0.0, other_turn, 1.0, OTHER, np)
    forth = leg_separation(own, own_next, other, other_next, 1.0, np)
    np.testing.assert_allclose(
        forth, leg_separation(other, other_next, own, own_next, 1.0, np), rtol=1e-12
    )


def test_leg_separation_in_single_precision() -> None:
    """Jax and numpy in float32 within 2 cm of float64 at up to 20 km, which is some units of
    float32 there.
    """
    generator = np.random.default_rng(4)
    own, intruder = meeting(generator, 2_000, (500.0, 15_000.0))
    own_next = advance(own, 0.5, RATE, 1.0, SURROGATE, np)
    intruder_next = advance(intruder, 0.0, -RATE, 1.0, OTHER, np)
    columns = (*own, *own_next, *intruder, *intruder_next)

    def separation(*fields, xp):
        vehicles = [VehicleState(*fields[4 * i : 4 * i + 4]) for i in range(4)]
        return (leg_separation(*vehicles, 1.0, xp),)

    for backend in BACKENDS:
        inputs = [backend.round_values(column) for column in columns]
        (expected,) = separation(*inputs, xp=np)
        (separations,) = backend.apply(
            lambda *fields, xp=backend.xp: separation(*fields, xp=xp), *inputs
        )
        tolerance = 2e-2 if backend.dtype is np.float32 else 1e-6
        np.testing.assert_allclose(
            separations, expected, rtol=0.0, atol=tolerance, err_msg=backend.name
        )


def test_straight_cpa_against_brute_force() -> None:
    generator = np.random.default_rng(5)
    own, intruder = random_states(generator, 200), random_states(generator, 200)
    times = np.linspace(0.0, 600.0, 60_001)[:, None]
    gap_x = (
        intruder.x
        + intruder.speed * np.cos(intruder.heading) * times
        - own.x
        - own.speed * np.cos(own.heading) * times
    )
    gap_y = (
        intruder.y
        + intruder.speed * np.sin(intruder.heading) * times
        - own.y
        - own.speed * np.sin(own.heading) * times
    )
    gaps = np.hypot(gap_x, gap_y)
    cpa = straight_cpa(own, intruder, np)
    within = cpa.time < 600.0
    np.testing.assert_allclose(cpa.distance[within], gaps.min(axis=0)[within], atol=0.1)
    relative_speed = np.hypot(gap_x[1] - gap_x[0], gap_y[1] - gap_y[0]) / 0.01
    clear = within & (relative_speed > 5.0)
    assert clear.sum() > 100
    np.testing.assert_allclose(cpa.time[clear], times[gaps.argmin(axis=0)[clear], 0], atol=0.02)


@given(states(), states())
def test_straight_cpa_is_the_same_for_both_aircraft(own: VehicleState, other: VehicleState) -> None:
    forth, back = straight_cpa(own, other, np), straight_cpa(other, own, np)
    np.testing.assert_allclose(forth, back, rtol=1e-9, atol=1e-9)


def test_straight_cpa_of_diverging_and_of_parallel_aircraft_is_now() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    diverging = straight_cpa(own, vehicle(-2_000.0, 0.0, -math.pi, 60.0), np)
    assert (diverging.time[0], diverging.distance[0]) == (0.0, 2_000.0)
    parallel = straight_cpa(own, vehicle(0.0, 3_000.0, 0.0, 80.0), np)
    assert parallel.distance[0] == pytest.approx(3_000.0)


def test_straight_cpa_by_hand() -> None:
    """Crossing at right angles at 100 m/s, from 1000 m and from 2000 m: they pass 707 m apart after
    15 s.
    """
    cpa = straight_cpa(
        vehicle(-1_000.0, 0.0, 0.0, 100.0), vehicle(0.0, 2_000.0, -0.5 * math.pi, 100.0), np
    )
    assert cpa.time[0] == pytest.approx(15.0)
    assert cpa.distance[0] == pytest.approx(1_000.0 / math.sqrt(2.0))


@pytest.mark.parametrize(
    ("heading", "x", "y", "expected"),
    [
        (0.0, 100.0, 0.0, 0.0),
        (0.0, 0.0, 100.0, 90.0),
        (0.0, 0.0, -100.0, -90.0),
        (90.0, -100.0, 0.0, 90.0),
        (170.0, -100.0, -1.0, 10.0 + math.degrees(math.atan2(1.0, 100.0))),
        (-170.0, -100.0, 1.0, -10.0 - math.degrees(math.atan2(1.0, 100.0))),
        (45.0, -100.0, -100.0, -180.0),
    ],
)
def test_bearing_by_hand(heading: float, x: float, y: float, expected: float) -> None:
    """Left positive, and through the wrap at 180 degrees."""
    degrees = math.degrees(
        bearing(vehicle(0.0, 0.0, math.radians(heading), 75.0), np.array([x]), np.array([y]), np)[0]
    )
    assert (degrees - expected + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-4)


@given(states(), states(), st.floats(-math.pi, math.pi), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_the_scene_may_be_moved_turned_and_mirrored(
    own: VehicleState, other: VehicleState, angle: float, east: float, north: float
) -> None:
    before = straight_cpa(own, other, np)
    after = straight_cpa(
        move_state(own, angle, east, north), move_state(other, angle, east, north), np
    )
    relative_speed = np.hypot(
        own.speed * np.cos(own.heading) - other.speed * np.cos(other.heading),
        own.speed * np.sin(own.heading) - other.speed * np.sin(other.heading),
    )
    if relative_speed > 1.0:
        np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(
        straight_cpa(mirror_state(own), mirror_state(other), np), before, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("backend", ARRAY_BACKENDS, ids=lambda backend: backend.name)
def test_distance(backend: Backend) -> None:
    (distances,) = backend.apply(
        lambda x, y: (distance(x, y, backend.xp),), [3.0, 0.0, -5e3], [4.0, 0.0, 12e3]
    )
    np.testing.assert_allclose(distances, [5.0, 0.0, 13e3], rtol=1e-6)


# Angles: accuracy of the polynomials against libm, and the range of wrapped angles, in every
# backend.

TURN = 2.0 * math.pi
each_backend = pytest.mark.parametrize("backend", BACKENDS, ids=lambda backend: backend.name)
each_array_backend = pytest.mark.parametrize(
    "backend", ARRAY_BACKENDS, ids=lambda backend: backend.name
)


def tolerance(backend: Backend) -> float:
    return 1e-6 if backend.dtype is np.float32 else 1e-7


def neighbours(dtype: type, *values: float, steps: int = 4) -> np.ndarray:
    """Return the values and the nearest representable numbers on both sides of each."""
    values_near = []
    for value in values:
        down = up = dtype(value)
        values_near.append(down)
        for _ in range(steps):
            down, up = np.nextafter(down, dtype(-np.inf)), np.nextafter(up, dtype(np.inf))
            values_near += [down, up]
    return np.array(values_near, np.float64)


@each_backend
def test_sincos_agrees_with_libm_over_its_whole_domain(backend: Backend) -> None:
    dense = np.linspace(
        -1.5 * math.pi, 1.5 * math.pi, 100_001 if backend.name != "floats" else 1_001
    )
    corners = neighbours(np.float64, 0.0, *(0.5 * math.pi * k for k in range(-2, 3)))
    angle = backend.round_values(np.concatenate([dense[1:-1], corners, [1e-30, -1e-30, 1e-8]]))
    sine, cosine = backend.apply(lambda a: sincos(a, backend.xp), angle)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=0.0, atol=tolerance(backend))
    np.testing.assert_allclose(cosine, np.cos(angle), rtol=0.0, atol=tolerance(backend))


@each_array_backend
def test_sine_of_small_angles_is_relatively_accurate(backend: Backend) -> None:
    angle = backend.round_values(np.geomspace(1e-20, 0.1, 200))
    sine, _ = backend.apply(lambda a: sincos(a, backend.xp), angle)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=tolerance(backend))


@each_backend
def test_atan2_agrees_with_libm_all_around_at_every_length(backend: Backend) -> None:
    count = 2_001 if backend.name != "floats" else 201
    angle, length = np.meshgrid(np.linspace(-math.pi, math.pi, count), [1e-3, 1.0, 567.0, 2e4, 1e7])
    y, x = (
        backend.round_values(length * np.sin(angle)).ravel(),
        backend.round_values(length * np.cos(angle)).ravel(),
    )
    (angles,) = backend.apply(lambda a, b: (atan2(a, b, backend.xp),), y, x)
    assert np.max(angle_between(angles, np.arctan2(y, x))) <= tolerance(backend)


@each_backend
def test_atan2_on_the_axes_and_diagonals(backend: Backend) -> None:
    y = np.array([0.0, 1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0])
    x = np.array([1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0, 1.0, 0.0])
    (angles,) = backend.apply(lambda a, b: (atan2(a, b, backend.xp),), y, x)
    np.testing.assert_allclose(
        angles, math.pi * np.array([0, 1, 2, 3, 4, -3, -2, -1, 0]) / 4, atol=tolerance(backend)
    )


@given(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_atan2_of_any_vector(y: float, x: float) -> None:
    for backend in ARRAY_BACKENDS[:2]:
        rounded_y, rounded_x = backend.round_values([y]), backend.round_values([x])
        (angle,) = backend.apply(
            lambda a, b, xp=backend.xp: (atan2(a, b, xp),), rounded_y, rounded_x
        )
        assert abs(angle[0]) <= math.pi + tolerance(backend)
        if math.hypot(x, y) > 1e-20:
            assert angle_between(angle, np.arctan2(rounded_y, rounded_x))[0] <= tolerance(backend)


@each_backend
def test_wrap_stays_in_the_half_open_range_at_its_edges(backend: Backend) -> None:
    """Also where rounding meets the ends: one unit inside and outside every odd multiple of pi."""
    edges = neighbours(backend.dtype, *(math.pi * k for k in range(-7, 8)), steps=8)
    (wrapped,) = backend.apply(lambda a: (wrap(a, backend.xp),), edges)
    low, high = backend.round_values([-math.pi, math.pi])
    assert np.all(wrapped >= low)
    assert np.all(wrapped < high)
    assert np.max(angle_between(wrapped, edges)) <= 4.0 * np.spacing(backend.dtype(22.0))


@given(st.floats(-20.0, 20.0))
def test_wrap_keeps_the_direction(angle: float) -> None:
    for backend in (BACKENDS[0], BACKENDS[1], BACKENDS[3]):
        exact = backend.round_values([angle])
        (wrapped,) = backend.apply(lambda a, xp=backend.xp: (wrap(a, xp),), exact)
        low, high = backend.round_values([-math.pi, math.pi])
        assert low <= wrapped[0] < high
        assert angle_between(wrapped, exact)[0] <= 4.0 * np.spacing(backend.dtype(20.0))


@each_backend
def test_wrap_leaves_wrapped_angles_alone(backend: Backend) -> None:
    angle = backend.round_values(np.linspace(-math.pi, math.pi, 501)[:-1])
    (wrapped,) = backend.apply(lambda a: (wrap(a, backend.xp),), angle)
    np.testing.assert_array_equal(wrapped, angle)


# Two aircraft of the same ratios fly the same encounters, scaled, whatever the separation and the
# speeds.


COUNT, STEPS = 12, 310
FAMILIES = [
    *(
        (name, {})
        if name in ("circle", "maneuvering")
        else pytest.param(name, {}, marks=pytest.mark.slow)
        for name in SCENARIOS
    ),
    ("multi", {"turn": True, "noisy": True}),
]


def twin(aircraft: Aircraft, length: float, speed: float) -> Aircraft:
    """Return the aircraft alike whose separation is ``length`` times as large and whose speeds are
    ``speed`` times.
    """
    limits, time = aircraft.limits, length / speed
    return new_aircraft(
        Limits(
            speed * limits.speed_min,
            speed * limits.speed_max,
            speed / time * limits.acceleration_min,
            speed / time * limits.acceleration_max,
            limits.yaw_rate_max / time,
        ),
        length * aircraft.separation,
        goal_radius=length * aircraft.goal_radius,
        traffic_speed_max=speed * aircraft.traffic_speed_max,
        dt=time * aircraft.dt,
        t_max=time * aircraft.t_max,
    )


def draw_encounters(aircraft: Aircraft, name: str, changes: dict[str, bool]) -> Encounter:
    more = {"turn_rate": aircraft.limits.yaw_rate_max} if "turn" in changes else {}
    if "noisy" in changes:
        noisy = scenario("noisy", aircraft)
        more |= {key: getattr(noisy, key) for key in ("position_std", "velocity_std", "latency")}
    return starts.encounters_of_seed(scenario(name, aircraft, **more), 5, 0, COUNT)


def scale_state(state: VehicleState, length: float, speed: float) -> np.ndarray:
    """Return x and y in ``length``, the heading's sine and cosine, and the speed in ``speed``."""
    return np.stack(
        [
            state.x / length,
            state.y / length,
            np.cos(state.heading),
            np.sin(state.heading),
            state.speed / speed,
        ]
    )


def fly_all(aircraft: Aircraft, encounters: Encounter) -> dict[str, np.ndarray]:
    """Fly encounters by actions that depend on what is seen; lengths in separations, speeds in
    ``speed_max``.
    """
    parameters = World(aircraft.rules(), aircraft)
    units = aircraft.separation, aircraft.limits.speed_max
    state = world.begin(encounters, np, history_dt=aircraft.dt)
    rng = np.random.default_rng(2)
    logged: dict[str, list[np.ndarray]] = {
        key: [] for key in ("own", "traffic", "seen", "set", "outcome", "apart")
    }
    for _ in range(STEPS):
        noise = rng.standard_normal((4, *encounters.mask.shape))
        observed = world.observe(state, aircraft, noise, xp=np)
        rows = world.observe_set(state, aircraft, noise, 3, xp=np)
        wander = np.sin(rng.uniform(0.0, 6.0, (2, COUNT)))
        action = (
            wander[0],
            np.clip(0.5 * wander[1] + np.sin(np.pi * observed[:, 6]) - 0.3 * observed[:, 5], -1, 1),
        )
        state, result = world.step(state, action, parameters, np)
        logged["own"].append(scale_state(state.own, *units))
        logged["traffic"].append(scale_state(state.intruders.vehicle, *units))
        logged["seen"].append(observed)
        logged["set"].append(
            np.concatenate([rows.own, rows.traffic.reshape(COUNT, -1), rows.mask], axis=-1)
        )
        logged["outcome"].append(np.stack(result.outcome))
        logged["apart"].append(result.separation / aircraft.separation)
    return {key: np.stack(values) for key, values in logged.items()}


@pytest.mark.parametrize(
    ("name", "changes"), FAMILIES, ids=lambda value: value if isinstance(value, str) else ""
)
def test_alike_aircraft_fly_alike(name: str, changes: dict[str, bool]) -> None:
    """From the draws to the outcome, through reports, observation and motion.

    Only the distance of an intruder's waypoint, some 10^7 m, does not scale: after a turn courses
    differ by 2e-4 rad."""
    small = twin(PAPER, 0.61, 0.36)
    assert ratios(small.limits, small.separation) == pytest.approx(
        ratios(PAPER.limits, PAPER.separation), rel=1e-12
    )
    original, scaled = (
        fly_all(aircraft, draw_encounters(aircraft, name, changes)) for aircraft in (PAPER, small)
    )
    turning = name == "maneuvering" or "turn" in changes
    for key in ("own", "traffic", "seen", "set", "apart"):
        tolerance = 0.01 if turning else 1e-8
        # A bearing beyond half a turn comes back on the other side, and a rank may change between
        # two equals.
        close = np.abs(original[key] - scaled[key]) < tolerance
        assert close.mean() > (0.995 if key in ("seen", "set") else 1.0 - 1e-12), key
    assert np.mean(original["outcome"] == scaled["outcome"]) > 0.9999
    assert original["outcome"].any(axis=(0, 2)).all() or name != "circle"


@settings(max_examples=10)
@given(st.floats(0.3, 10.0), st.floats(0.3, 2.3), st.integers(0, 2**32))
def test_any_twin_draws_and_sees_alike(length: float, speed: float, seed: int) -> None:
    scaled = twin(PAPER, length, speed)
    for name in ("multi", "noisy", "same_course"):
        original_start, scaled_start = (
            starts.encounters_of_seed(scenario(name, aircraft), seed, 0, 4)
            for aircraft in (PAPER, scaled)
        )
        np.testing.assert_allclose(
            scale_state(scaled_start.own, length, speed),
            scale_state(original_start.own, 1.0, 1.0),
            rtol=1e-9,
            atol=1e-6,
        )
        np.testing.assert_allclose(
            scaled_start.intent.onset / (length / speed),
            original_start.intent.onset,
            rtol=1e-7,
            atol=1e-7,
        )
        np.testing.assert_allclose(
            scaled_start.sensor.latency / (length / speed),
            original_start.sensor.latency,
            rtol=1e-12,
        )
        sights = [
            observe_set(start.own, *rank_urgent(start.own, start.intruders, start.mask, 5, aircraft, np),
                        start.goal_x, start.goal_y, aircraft, np)
            for start, aircraft in ((original_start, PAPER), (scaled_start, scaled))
        ]  # fmt: skip
        for mine, yours in zip(*sights, strict=True):
            np.testing.assert_allclose(yours, mine, atol=1e-9)


def test_one_encounter_in_plain_floats_is_the_batchs() -> None:
    aircraft = twin(PAPER, 9.26, 2.3)
    encounters = draw_encounters(aircraft, "multi", {"turn": True, "noisy": True})
    batch = world.begin(encounters, np, history_dt=aircraft.dt)
    single = flight.begin(take(encounters, 0), aircraft.dt)
    rows = world.observe_set(batch, aircraft, None, 4, xp=np)
    mine = flight.observe_set(single, 4, aircraft)
    for part, whole in zip(mine, rows, strict=True):
        np.testing.assert_allclose(part, whole[0], atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"own_speed": (20.0, 80.0)}, "own_speed"),
        ({"own_speed": (80.0, 60.0)}, "own_speed"),
        ({"intruder_speed": (0.0, 151.0)}, "intruder_speed"),
        ({"intruders": (0, 2)}, "intruders"),
        ({"intruders": (1, 65)}, "intruders"),
        ({"latency": (0.0, 2.5)}, "latency"),
        ({"radius": (10.0, 5_000.0)}, "radius"),
        ({"turn_rate": 1.1}, "turn_rate"),
        ({"position_std": -1.0}, "position_std"),
        ({"displacement": float("nan")}, "displacement"),
    ],
)
def test_a_scenario_that_contradicts_its_aircraft_is_refused(
    changes: dict[str, object], field: str
) -> None:
    with pytest.raises(EncounterError, match=f"^{field} .*expected"):
        scenario("circle", PAPER, **changes)


def test_a_mask_of_another_shape_is_refused() -> None:
    start = starts.encounters_of_seed(scenario("multi", PAPER), 0, 0, 3)
    with pytest.raises(ValueError, match=r"mask has shape \(3, 7\); expected \(3, 8\)"):
        observe_set(
            start.own, start.intruders, start.mask[:, :7], start.goal_x, start.goal_y, PAPER, np
        )


def test_an_aircraft_that_can_hover_begins_with_some_speed() -> None:
    multirotor = load(
        AircraftConfig, None, ["speed_min_mps=0", "speed_max_mps=20", "separation_m=150"]
    ).aircraft()
    circle = scenario("circle", multirotor)
    assert circle.own_speed == (4.0, 20.0)
    assert np.isfinite(starts.encounters_of_seed(circle, 0, 0, 50).intruders.x).all()


def two_in_a_step(count: int) -> list[tuple[VehicleState, VehicleState]]:
    """Return two aircraft that turn during a second, at its beginning and its end."""
    rng, pairs = np.random.default_rng(4), []
    for _ in range(2):
        x, y = rng.uniform(-300.0, 300.0, (2, count))
        before = VehicleState(x, y, rng.uniform(-3.0, 3.0, count), rng.uniform(30.0, 100.0, count))
        turn = rng.uniform(-0.05, 0.05, count)
        pairs.append((before, advance(before, 0.0 * turn, turn, 1.0, _FREE, np)))
    return pairs


_FREE = Limits(0.0, 1e3, -1e3, 1e3, 1e3)


def test_the_separation_in_space_against_dense_samples() -> None:
    (own, own_next), (intruder, intruder_next) = two_in_a_step(3_000)
    rng, flatness = np.random.default_rng(5), 7.3
    above = rng.uniform(-60.0, 60.0, 3_000)
    later = above + rng.uniform(-10.0, 10.0, 3_000)
    separation = leg_separation_in_space(
        (own, own_next), (intruder, intruder_next), (above, later), flatness, 1.0
    )
    least = np.full(3_000, np.inf)
    for share in np.linspace(0.0, 1.0, 501):
        own_place, intruder_place = (
            advance(before, 0.0 * above, wrap(after.heading - before.heading, np), share, _FREE, np)
            for before, after in ((own, own_next), (intruder, intruder_next))
        )
        height = flatness * np.abs(above + share * (later - above))
        least = np.minimum(
            least,
            np.maximum(
                distance(intruder_place.x - own_place.x, intruder_place.y - own_place.y, np), height
            ),
        )
    # Dense samples miss up to the way of half of one of them.
    assert (separation - least).max() < 0.05 and (separation - least).min() > -0.5


def test_the_separation_in_space_is_the_same_mirrored_and_that_of_the_plane_at_one_level() -> None:
    (own, own_next), (intruder, intruder_next) = two_in_a_step(1_000)
    states = (own, own_next), (intruder, intruder_next)
    plane = leg_separation(own, own_next, intruder, intruder_next, 1.0, np)
    nothing = np.zeros(1_000)
    np.testing.assert_array_equal(
        leg_separation_in_space(*states, (nothing, nothing), 7.0, 1.0), plane
    )
    above, later = np.random.default_rng(6).uniform(-80.0, 80.0, (2, 1_000))
    separation = leg_separation_in_space(*states, (above, later), 7.0, 1.0)
    mirrored = leg_separation_in_space(*states, (-above, -later), 7.0, 1.0)
    np.testing.assert_array_equal(separation, mirrored)
    assert (separation >= plane - 1e-6).all()  # both are searched for, by two ways
    high = leg_separation_in_space(*states, (nothing + 1e4, nothing + 1e4), 7.0, 1.0)
    np.testing.assert_allclose(high, 7e4)
