"""The true aircraft flies its commands within its limits, the same every time, and says when it
cannot.
"""

import hashlib
import math

import gymnasium
import numpy as np
import pytest
from gymnasium import error
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st

from envs.c208.air_mass import air_commands, ground_commands
from envs.c208.conditions import CALM, Conditions
from envs.c208.facts import GRAVITY
from envs.c208.gymnasium_env import ENV_ID
from envs.c208.point_mass import PointMassVehicle
from envs.c208.vehicle import LOG_COLUMNS, C208Vehicle, FlightError, StartError
from envs.encounters import EncounterError
from envs.follower import PERIOD, Vehicle
from envs.gym.gymnasium_env import DeconflictionEnv
from envs.kinematics import SURROGATE, VehicleState, advance
from envs.outcome import RULES
from envs.wind import Wind, over_ground, through_air

EAST = VehicleState(0.0, 0.0, 0.0, 70.0)
COLUMN = {name: number for number, name in enumerate(LOG_COLUMNS)}


def fly_for(vehicle: Vehicle, acceleration: float, yaw_rate: float, seconds: float) -> None:
    for _ in range(round(seconds / PERIOD)):
        vehicle.step(acceleration, yaw_rate, PERIOD)


def both(state: VehicleState) -> list[Vehicle]:
    return [C208Vehicle(state), PointMassVehicle(state)]


def test_the_flight_begins_where_it_was_to() -> None:
    for wind in (CALM, Conditions(wind_east=-6.0, wind_north=7.0)):
        start = VehicleState(1234.5, -777.0, 2.1, 78.0)
        vehicle = C208Vehicle(start, conditions=wind)
        assert vehicle.state.x == pytest.approx(start.x, abs=1e-6)
        assert vehicle.state.y == pytest.approx(start.y, abs=1e-6)
        assert vehicle.state.heading == pytest.approx(start.heading, abs=1e-3)
        assert vehicle.state.speed == pytest.approx(start.speed, abs=0.05)
        assert vehicle.time == 0.0


def test_without_commands_it_flies_straight_and_level() -> None:
    for vehicle in both(EAST):
        fly_for(vehicle, 0.0, 0.0, 60.0)
        assert vehicle.state.x == pytest.approx(4200.0, abs=0.5)
        assert vehicle.state.y == pytest.approx(0.0, abs=0.05)
        assert vehicle.state.speed == pytest.approx(70.0, abs=0.01)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_bank_of_30_degrees_comes_soon_and_without_overshoot(side: float) -> None:
    for speed in (58.0, 75.0, 95.0):
        vehicle = C208Vehicle(EAST._replace(speed=speed))
        fly_for(vehicle, 0.0, side * GRAVITY * math.tan(math.radians(30.0)) / speed, 20.0)
        log = vehicle.log()
        # Positive turns are to the left, positive banks to the right.
        bank = -side * np.degrees(log[:, COLUMN["bank"]])
        assert log[np.argmax(bank >= 29.0), 0] < 2.5
        assert bank.max() < 32.0
        assert bank[-1] == pytest.approx(30.0, abs=0.5)
        assert np.abs(log[:, COLUMN["altitude"]] - 2500.0).max() < 5.0
        assert np.abs(log[:, COLUMN["speed"]] - speed).max() < 0.5


def test_left_and_right_are_alike() -> None:
    ends = []
    for side in (-1.0, 1.0):
        vehicle = C208Vehicle(EAST)
        fly_for(vehicle, 0.1, side * 0.04, 20.0)
        ends.append(vehicle.state)
    # The Earth's rotation is what is left between them.
    assert ends[0].x == pytest.approx(ends[1].x, abs=0.5)
    assert ends[0].y == pytest.approx(-ends[1].y, abs=0.5)
    assert ends[0].heading == pytest.approx(-ends[1].heading, abs=1e-3)


@pytest.mark.parametrize(("first", "last"), [(60.0, 80.0), (85.0, 60.0)])
def test_speed_follows_a_ramp(first: float, last: float) -> None:
    vehicle = C208Vehicle(EAST._replace(speed=first))
    rate, seconds = math.copysign(0.5, last - first), abs(last - first) / 0.5
    fly_for(vehicle, rate, 0.0, seconds)
    log = vehicle.log()
    off = log[:, COLUMN["speed"]] - first - rate * log[:, 0]
    assert np.sqrt(np.mean(off**2)) < 0.1


def test_the_frame_is_the_ground_that_is_covered() -> None:
    vehicle = C208Vehicle(
        EAST._replace(heading=0.8, speed=90.0),
        conditions=Conditions(wind_east=5.0, wind_north=-4.0),
    )
    fly_for(vehicle, 0.0, 0.004, 200.0)
    log = vehicle.log()
    heading = np.unwrap(log[:, COLUMN["heading"]])
    for name, course in (("x", np.cos(heading)), ("y", np.sin(heading))):
        rate = log[:, COLUMN["speed"]] * course
        covered = float(np.sum(0.5 * (rate[1:] + rate[:-1]) * np.diff(log[:, 0])))
        assert log[-1, COLUMN[name]] - log[0, COLUMN[name]] == pytest.approx(covered, abs=1.0)


def test_wind_carries_the_aircraft_and_not_its_commands() -> None:
    vehicle = C208Vehicle(EAST._replace(speed=75.0), conditions=Conditions(wind_east=10.0))
    assert vehicle.log()[0, COLUMN["airspeed"]] == pytest.approx(65.0, abs=0.2)
    fly_for(vehicle, 0.0, 0.03, math.pi / 2.0 / 0.03)
    # The turn over the ground is what was asked for.
    assert vehicle.state.speed == pytest.approx(75.0, abs=0.5)
    assert vehicle.state.heading == pytest.approx(math.pi / 2.0, abs=0.05)


def test_a_flight_is_the_same_to_the_last_bit() -> None:
    rough = Conditions(wind_east=3.0, turbulence="moderate", seed=5)

    def digest(vehicle: C208Vehicle) -> str:
        fly_for(vehicle, 0.1, 0.02, 20.0)
        return hashlib.sha256(vehicle.log().tobytes()).hexdigest()

    vehicle = C208Vehicle(EAST, conditions=rough)
    first = digest(vehicle)
    fly_for(vehicle, -0.2, -0.03, 5.0)
    vehicle.reset(EAST, rough)
    assert digest(vehicle) == first
    assert digest(C208Vehicle(EAST, conditions=rough)) == first
    assert digest(C208Vehicle(EAST, conditions=rough._replace(seed=6))) != first


def test_turbulence_is_as_strong_as_it_is_named() -> None:
    size = {}
    for name in ("none", "light", "moderate"):
        vehicle = C208Vehicle(
            EAST._replace(speed=80.0), conditions=Conditions(turbulence=name, seed=1)
        )
        fly_for(vehicle, 0.0, 0.0, 60.0)
        size[name] = float(np.std(vehicle.log()[:, COLUMN["alpha"]]))
    assert size["none"] < 1e-4
    assert 1e-3 < size["light"] < size["moderate"]


def test_it_cannot_be_made_to_stall() -> None:
    vehicle = C208Vehicle(
        EAST._replace(speed=60.0), conditions=Conditions(turbulence="moderate", seed=3)
    )
    fly_for(vehicle, -3.0, 0.2, 60.0)
    log = vehicle.log()
    assert log[:, COLUMN["airspeed"]].min() > 45.0
    assert np.degrees(np.abs(log[:, COLUMN["bank"]])).max() < 60.0
    # It holds on to its altitude as long as its speed allows.
    assert np.abs(log[:, COLUMN["altitude"]] - 2500.0).max() < 100.0


def test_what_cannot_begin_or_go_on_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StartError, match=r"cannot begin: no equilibrium .* 41\.00 m/s"):
        C208Vehicle(EAST._replace(speed=51.0), conditions=Conditions(wind_east=10.0))
    vehicle = C208Vehicle(EAST)
    vehicle.fdm.set("atmosphere/wind-down-fps", 200.0)
    with pytest.raises(FlightError, match=r"at [0-9.]+ s"):
        fly_for(vehicle, 0.0, 0.0, 200.0)


@pytest.mark.parametrize(
    ("state", "conditions", "named"),
    [
        (EAST._replace(x=math.nan), CALM, "state.x"),
        (EAST._replace(speed=np.array([70.0])), CALM, "state.speed"),
        (EAST, Conditions(wind_east=60.0), "wind"),
        (EAST, Conditions(wind_east=math.nan), "wind"),
        (EAST, Conditions(turbulence="severe"), "turbulence"),  # pyright: ignore[reportArgumentType]
        (EAST, Conditions(seed=-1), "seed"),
    ],
)
def test_a_beginning_that_is_none_is_refused(
    state: VehicleState, conditions: Conditions, named: str
) -> None:
    with pytest.raises(ValueError, match=f"{named} .*expected"):
        C208Vehicle(state, conditions=conditions)


def test_commands_that_are_none_are_refused() -> None:
    for vehicle in both(EAST):
        for command in ((math.nan, 0.0, 0.1), (0.0, math.inf, 0.1), (0.0, 0.0, 0.0)):
            with pytest.raises(ValueError, match="expected"):
                vehicle.step(*command)
    with pytest.raises(ValueError, match="multiple"):
        C208Vehicle(EAST).step(0.0, 0.0, 0.07)


def test_the_point_mass_flies_much_as_the_aircraft_does() -> None:
    ends = []
    for vehicle in both(EAST):
        for acceleration, yaw_rate in ((0.3, 0.04), (0.0, -0.05), (-0.4, 0.0)):
            fly_for(vehicle, acceleration, yaw_rate, 15.0)
        ends.append(vehicle.state)
    assert math.hypot(ends[0].x - ends[1].x, ends[0].y - ends[1].y) < 40.0
    assert ends[0].speed == pytest.approx(ends[1].speed, abs=1.0)


def test_the_point_mass_climbs_to_its_altitude_and_keeps_its_limits() -> None:
    vehicle = PointMassVehicle(EAST, altitude=2500.0, start_altitude=2400.0)
    fly_for(vehicle, 9.0, 9.0, 120.0)
    assert vehicle.altitude == pytest.approx(2500.0, abs=1.0)
    assert abs(math.degrees(vehicle.bank)) <= 45.0
    assert vehicle.airspeed < 110.0


# Over the ground and through the air are two views of one motion.


STATES = st.builds(
    VehicleState,
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.floats(-3.1, 3.1),
    st.floats(40.0, 110.0),
)
WINDS = st.tuples(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0)).map(lambda both: Wind(*both))
COMMANDS = st.tuples(st.floats(-0.8, 0.5), st.floats(-0.08, 0.08))


@given(STATES, WINDS, COMMANDS)
def test_commands_are_the_same_acceleration(
    state: VehicleState, wind: Wind, command: tuple[float, float]
) -> None:
    air = through_air(state, wind, 0.0)
    assert ground_commands(air, *air_commands(state, *command, wind), wind) == pytest.approx(
        command, abs=1e-9
    )
    # A moment later both views are still of one motion.
    free = SURROGATE._replace(speed_min=0.0, speed_max=1e3)
    later = advance(state, *command, 0.01, free, np)
    drifted = advance(air, *air_commands(state, *command, wind), 0.01, free, np)
    carried = over_ground(VehicleState(*(float(field) for field in drifted)), wind, 0.01)
    assert math.hypot(carried.x - later.x, carried.y - later.y) < 1e-4
    assert carried.speed == pytest.approx(float(later.speed), abs=2e-3)


# The true aircraft's environment keeps Gymnasium's contract and the surrogate's observation, action
# and reward.


STRAIGHT = np.zeros(2, np.float32)


def test_gymnasiums_checker_passes() -> None:
    check_env(gymnasium.make(ENV_ID).unwrapped, skip_render_check=True)


def test_it_is_the_surrogates_task_flown_with_the_aircrafts_lags() -> None:
    true, surrogate = gymnasium.make(ENV_ID), DeconflictionEnv()
    assert true.observation_space == surrogate.observation_space
    assert true.action_space == surrogate.action_space
    observation, _ = true.reset(seed=3)
    expected, _ = surrogate.reset(seed=3)
    np.testing.assert_allclose(observation, expected, atol=1e-6)
    for number in range(40):
        action = np.array([0.3, 0.8 * np.sin(number / 8.0)], np.float32)
        observation, reward, *_, info = true.step(action)
        expected, expected_reward, *_, expected_info = surrogate.step(action)
        assert reward == expected_reward
        # A roll's lag of most of a second at 3 deg/s is two degrees of heading at most.
        assert info["goal_distance"] == pytest.approx(expected_info["goal_distance"], abs=60.0)
        assert abs(info["altitude"] - 2500.0) < 5.0
    assert not np.allclose(observation, expected, atol=1e-6)


def test_episodes_repeat_and_end() -> None:
    def play() -> list[float]:
        env = gymnasium.make(
            ENV_ID,
            rules=RULES._replace(t_max=20.0),
            conditions=Conditions(wind_east=3.0, turbulence="light"),
        )
        env.reset(seed=1)
        rows, over = [], False
        while not over:
            observation, reward, terminated, truncated, info = env.step(STRAIGHT)
            rows += [*observation.tolist(), float(reward), info["airspeed"]]
            over = terminated or truncated
        with pytest.raises(error.ResetNeeded, match="has ended"):
            env.unwrapped.step(STRAIGHT)
        return rows

    assert play() == play()


def test_misuse_is_refused_in_a_sentence() -> None:
    env = gymnasium.make(ENV_ID, conditions=Conditions(wind_east=30.0)).unwrapped
    with pytest.raises(error.ResetNeeded, match="before reset"):
        env.step(STRAIGHT)
    with pytest.raises(EncounterError, match=r"cannot be flown by the aircraft: .*no equilibrium"):
        for seed in range(20):
            env.reset(seed=seed)
    calm = gymnasium.make(ENV_ID).unwrapped
    calm.reset(seed=0)
    with pytest.raises(error.InvalidAction, match="shape"):
        calm.step(np.zeros(3, np.float32))
