"""Two aircraft of the same ratios fly the same encounters, scaled, whatever the separation and the speeds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.config.load import load
from agents.config.world import AircraftConfig
from envs import starts, world
from envs.aircraft import PAPER, Aircraft, new_aircraft, ratios
from envs.encounters import SCENARIOS, Encounter, EncounterError, scenario
from envs.gym import flight
from envs.kinematics import Limits, VehicleState
from envs.observation import observe_set, ranked
from envs.trees import take
from envs.world import World

COUNT, STEPS = 12, 310
FAMILIES = [
    *((name, {}) for name in SCENARIOS),
    ("multi", {"turn": True, "noisy": True}),
]


def twin(aircraft: Aircraft, length: float, speed: float) -> Aircraft:
    """Return the aircraft alike whose separation is ``length`` times as large and whose speeds are ``speed`` times."""
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


def drawn(aircraft: Aircraft, name: str, changes: dict[str, bool]) -> Encounter:
    more = {"turn_rate": aircraft.limits.yaw_rate_max} if "turn" in changes else {}
    if "noisy" in changes:
        noisy = scenario("noisy", aircraft)
        more |= {key: getattr(noisy, key) for key in ("position_std", "velocity_std", "latency")}
    return starts.numbered(scenario(name, aircraft, **more), 5, 0, COUNT)


def scaled(state: VehicleState, length: float, speed: float) -> np.ndarray:
    """Return x and y in ``length``, the heading's sine and cosine, and the speed in ``speed``."""
    return np.stack(
        [state.x / length, state.y / length, np.cos(state.heading), np.sin(state.heading), state.speed / speed]
    )


def flown(aircraft: Aircraft, encounters: Encounter) -> dict[str, np.ndarray]:
    """Fly encounters by actions that depend on what is seen; lengths in separations, speeds in ``speed_max``."""
    parameters = World(aircraft.rules(), aircraft)
    units = aircraft.separation, aircraft.limits.speed_max
    state = world.begin(encounters, np, history_dt=aircraft.dt)
    rng = np.random.default_rng(2)
    logged: dict[str, list[np.ndarray]] = {key: [] for key in ("own", "traffic", "seen", "set", "outcome", "apart")}
    for _ in range(STEPS):
        noise = rng.standard_normal((4, *encounters.mask.shape))
        seen = world.perceived(state, noise, aircraft.dt, np)
        observed = world.observe(state, seen, aircraft, np)
        rows = world.observe_set(state, seen, 3, aircraft, np)
        wander = np.sin(rng.uniform(0.0, 6.0, (2, COUNT)))
        action = wander[0], np.clip(0.5 * wander[1] + np.sin(np.pi * observed[:, 6]) - 0.3 * observed[:, 5], -1, 1)
        state, result = world.step(state, action, parameters, np)
        logged["own"].append(scaled(state.own, *units))
        logged["traffic"].append(scaled(state.intruders.vehicle, *units))
        logged["seen"].append(observed)
        logged["set"].append(np.concatenate([rows.own, rows.traffic.reshape(COUNT, -1), rows.mask], axis=-1))
        logged["outcome"].append(np.stack(result.outcome))
        logged["apart"].append(result.separation / aircraft.separation)
    return {key: np.stack(values) for key, values in logged.items()}


@pytest.mark.parametrize(("name", "changes"), FAMILIES, ids=lambda value: value if isinstance(value, str) else "")
def test_alike_aircraft_fly_alike(name: str, changes: dict[str, bool]) -> None:
    """From the draws to the outcome, through reports, observation and motion.

    Only the distance of an intruder's waypoint, some 10^7 m, does not scale: after a turn courses differ by 2e-4 rad.
    """
    small = twin(PAPER, 0.61, 0.36)
    assert ratios(small.limits, small.separation) == pytest.approx(ratios(PAPER.limits, PAPER.separation), rel=1e-12)
    one, other = (flown(aircraft, drawn(aircraft, name, changes)) for aircraft in (PAPER, small))
    turning = name == "maneuvering" or "turn" in changes
    for key in ("own", "traffic", "seen", "set", "apart"):
        tolerance = 0.01 if turning else 1e-8
        # A bearing beyond half a turn comes back on the other side, and a rank may change between two equals.
        close = np.abs(one[key] - other[key]) < tolerance
        assert close.mean() > (0.995 if key in ("seen", "set") else 1.0 - 1e-12), key
    assert np.mean(one["outcome"] == other["outcome"]) > 0.9999
    assert one["outcome"].any(axis=(0, 2)).all() or name != "circle"


@settings(max_examples=10)
@given(st.floats(0.3, 10.0), st.floats(0.3, 2.3), st.integers(0, 2**32))
def test_any_twin_draws_and_sees_alike(length: float, speed: float, seed: int) -> None:
    other = twin(PAPER, length, speed)
    for name in ("multi", "noisy", "same_course"):
        here, there = (starts.numbered(scenario(name, aircraft), seed, 0, 4) for aircraft in (PAPER, other))
        np.testing.assert_allclose(scaled(there.own, length, speed), scaled(here.own, 1.0, 1.0), rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(there.intent.onset / (length / speed), here.intent.onset, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(there.sensor.latency / (length / speed), here.sensor.latency, rtol=1e-12)
        sights = [
            observe_set(start.own, *ranked(start.own, start.intruders, start.mask, 5, aircraft, np),
                        start.goal_x, start.goal_y, aircraft, np)
            for start, aircraft in ((here, PAPER), (there, other))
        ]  # fmt: skip
        for mine, yours in zip(*sights, strict=True):
            np.testing.assert_allclose(yours, mine, atol=1e-9)


def test_one_encounter_in_plain_floats_is_the_batchs() -> None:
    aircraft = twin(PAPER, 9.26, 2.3)
    encounters = drawn(aircraft, "multi", {"turn": True, "noisy": True})
    batch = world.begin(encounters, np, history_dt=aircraft.dt)
    single = flight.begin(take(encounters, 0), aircraft.dt)
    rows = world.observe_set(batch, world.perceived(batch, None, aircraft.dt, np), 4, aircraft, np)
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
def test_a_scenario_that_contradicts_its_aircraft_is_refused(changes: dict[str, object], field: str) -> None:
    with pytest.raises(EncounterError, match=f"^{field} .*expected"):
        scenario("circle", PAPER, **changes)


def test_a_mask_of_another_shape_is_refused() -> None:
    start = starts.numbered(scenario("multi", PAPER), 0, 0, 3)
    with pytest.raises(ValueError, match=r"mask has shape \(3, 7\); expected \(3, 8\)"):
        observe_set(start.own, start.intruders, start.mask[:, :7], start.goal_x, start.goal_y, PAPER, np)


def test_an_aircraft_that_can_hover_begins_with_some_speed() -> None:
    multirotor = load(AircraftConfig, None, ["speed_min_mps=0", "speed_max_mps=20", "separation_m=150"]).aircraft()
    found = scenario("circle", multirotor)
    assert found.own_speed == (4.0, 20.0)
    assert np.isfinite(starts.numbered(found, 0, 0, 50).intruders.x).all()
