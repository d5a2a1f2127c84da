"""The aircraft is made of sourced facts alone; JSBSim flies as they say, as is published, and along
plans.
"""

import math
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.config.load import load
from agents.config.world import AircraftConfig, VehicleConfig
from envs import follower
from envs.c208 import validate
from envs.c208.conditions import Conditions, Loading
from envs.c208.facts import DATA, FACTS, POINTS, VARIANTS
from envs.c208.fdm import Fdm, FdmError
from envs.c208.guidance import LOOKAHEAD, Guide, follow
from envs.c208.guidance import Path as Track
from envs.c208.model import aircraft, engine, files, lift_curve
from envs.c208.point_mass import PointMassVehicle
from envs.c208.propulsion import idle_thrust, maximum_thrust, thrust
from envs.c208.trim import TrimError, level_table, load_stored, solve
from envs.c208.vehicle import C208Vehicle
from envs.follower import PERIOD, deviation
from envs.kinematics import SURROGATE, VehicleState, advance
from envs.waypoints import Legs, PlanStates, at, legs, repeat


def test_the_files_that_ship_are_what_the_facts_give() -> None:
    for path, text in files().items():
        assert path.read_text(encoding="utf-8") == text, "run python -m envs.c208.model"


def test_every_fact_and_point_names_its_source() -> None:
    assert all(fact.source and math.isfinite(fact.value) for fact in FACTS.values())
    assert all(point.source and point.use in ("fit", "check") for point in POINTS)
    fits = sum("fit:" in fact.source for fact in FACTS.values())
    # As many points to fit as facts fitted to them: none is free, none is fitted twice.
    assert fits == sum(point.use == "fit" for point in POINTS)
    assert sum(point.use == "check" for point in POINTS) >= 5


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=lambda variant: variant.name)
def test_the_text_is_xml_for_any_loading(variant) -> None:
    loading = Loading(6500.0, 0.38, 1.3, 0.92, 1.05, pod=True)
    for text in (aircraft(variant), aircraft(variant, loading), engine(variant)):
        ElementTree.fromstring(text)


@pytest.mark.parametrize(
    ("field", "number"),
    [
        ("weight", 3000.0),
        ("weight", math.nan),
        ("centre_of_gravity", 0.5),
        ("inertia_factor", 0.0),
        ("drag_factor", -1.0),
    ],
)
def test_a_loading_out_of_range_is_refused_by_name(field: str, number: float) -> None:
    with pytest.raises(ValueError, match=f"loading.{field} is .*expected"):
        Fdm("ex", Loading()._replace(**{field: number}))


def test_a_loading_reaches_jsbsim() -> None:
    fdm = Fdm("675", Loading(weight=7000.0, centre_of_gravity=0.35))
    solve(fdm, 70.0)
    assert fdm.get("inertia/weight-lbs") == pytest.approx(7000.0)
    assert fdm.get("inertia/cg-x-in") == pytest.approx(177.57 + 0.35 * 66.4, abs=1e-3)


def test_lift_is_continuous_with_one_maximum() -> None:
    alpha, lift = lift_curve()
    assert (np.diff(alpha) > 0.0).all()
    low, top = int(np.argmin(lift[:-1])), int(np.argmax(lift))
    assert (np.diff(lift[low : top + 1]) > 0.0).all() and (np.diff(lift[top:]) < 0.0).all()


@given(st.floats(1e4, 7e5), st.floats(0.0, 120.0), st.floats(0.5, 1.3))
def test_thrust_never_gives_more_power_than_the_shaft(
    power: float, speed: float, density: float
) -> None:
    force = float(thrust(power, speed, density))
    assert math.isfinite(force)
    assert force * speed < 0.80 * power
    assert force > float(thrust(power, speed + 5.0, density))


def test_jsbsim_gives_the_thrust_of_the_propulsion_model() -> None:
    fdm = Fdm()
    for speed, altitude in ((52.0, 2500.0), (83.0, 2500.0), (66.0, 500.0), (90.0, 5000.0)):
        for throttle, curve in ((0.0, idle_thrust), (1.0, maximum_thrust)):
            equilibrium = solve(fdm, speed, altitude, throttle=throttle)
            density = fdm.get("atmosphere/rho-slugs_ft3") * 515.378819
            expected = float(curve(fdm.variant, speed, density))
            # Linear interpolation between the tables' points.
            assert equilibrium.thrust == pytest.approx(expected, rel=0.015, abs=15.0)


def test_the_stored_equilibria_are_the_aircrafts() -> None:
    for name, equilibrium in level_table(Fdm()).items():
        np.testing.assert_allclose(
            load_stored()[name],
            equilibrium,
            rtol=1e-5,
            atol=1e-7,
            err_msg=f"{name}: python -m envs.c208.trim",
        )


def test_an_equilibrium_lasts_when_flown_open_loop() -> None:
    fdm = Fdm()
    equilibrium = solve(fdm, 70.0)
    for _ in range(600):
        fdm.exec.run()
    # Ten seconds in which nobody steers: the phugoid has nothing to start from.
    assert fdm.get("velocities/vt-fps") * 0.3048 == pytest.approx(70.0, abs=0.05)
    assert fdm.get("aero/alpha-rad") == pytest.approx(equilibrium.alpha, abs=2e-4)
    assert abs(fdm.get("velocities/h-dot-fps")) < 0.5


def test_no_equilibrium_below_the_stall_or_beyond_the_power() -> None:
    fdm = Fdm()
    for speed in (35.0, 118.0):
        with pytest.raises(TrimError, match=f"{speed:.2f} m/s"):
            solve(fdm, speed)
    assert solve(fdm, 70.0).speed == 70.0


def test_unknown_names_and_missing_files_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fdm = Fdm()
    with pytest.raises(FdmError, match="velocities/typo"):
        fdm.get("velocities/typo")
    with pytest.raises(FdmError, match="expected one of ex, 675"):
        Fdm("172")
    monkeypatch.setattr("envs.c208.fdm.DATA", tmp_path)
    with pytest.raises(FdmError, match="missing"):
        Fdm("ex")
    (tmp_path / "engine").mkdir()
    for file in (DATA / "engine").iterdir():
        (tmp_path / "engine" / file.name).write_text(file.read_text())
    with pytest.raises(FdmError, match="does not load"):
        Fdm("ex")


def test_jsbsim_says_nothing() -> None:
    program = "from envs.c208.fdm import Fdm; from envs.c208.trim import solve; solve(Fdm(), 70.0)"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert result.stdout == "" and result.stderr == ""


# The model keeps the tolerances to what is published, on points it was not fitted to, and says so
# when it does not.
ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.slow
def test_no_tolerance_is_missed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["validate"])
    assert validate.main() == 0
    printed = capsys.readouterr().out
    assert "MISSED" not in printed
    for point in POINTS:
        assert point.name in printed


@pytest.mark.slow
def test_a_missed_tolerance_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = POINTS[0]._replace(value=POINTS[0].value * 1.05)
    monkeypatch.setattr(validate, "POINTS", (wrong,))
    monkeypatch.setattr("sys.argv", ["validate"])
    assert validate.main() == 1
    assert "MISSED" in capsys.readouterr().out


def test_more_drag_is_slower_and_more_weight_stalls_faster() -> None:
    cruise = next(point for point in POINTS if point.quantity == "cruise" and not point.pod)
    stall = next(point for point in POINTS if point.quantity == "stall")
    assert validate.measure(cruise._replace(pod=True)) < validate.measure(cruise) - 5.0
    light = validate.measure(stall._replace(weight=7000.0))
    assert light == pytest.approx(
        validate.measure(stall) * math.sqrt(7000.0 / stall.weight), rel=0.01
    )


def test_the_envelope_shrinks_with_speed() -> None:
    rows = validate.envelope()
    assert rows[0][0] < 50.0 and rows[-1][0] >= 100.0
    assert all(low < -0.6 < 0.0 < high for _, low, high in rows)
    gains = [high for _, _, high in rows if _ >= 60.0]
    assert gains == sorted(gains, reverse=True)


def test_the_published_limits_can_be_had_all_at_once() -> None:
    limits = load(VehicleConfig, ROOT / "configs" / "vehicle_c208.yaml").limits()
    for speed in range(int(limits.speed_min), int(limits.speed_max) + 1):
        vehicle = PointMassVehicle(VehicleState(0.0, 0.0, 0.0, float(speed)))
        low, _ = vehicle.reach()
        vehicle.bank = math.atan(speed * limits.yaw_rate_max / 9.80665)
        _, high = vehicle.reach()
        assert low <= limits.acceleration_min and limits.acceleration_max <= high, (
            f"{speed} m/s: {low:.3f}, {high:.3f}"
        )
    stall = next(point for point in POINTS if point.quantity == "stall" and point.variant == "675")
    slowest = validate.measure(
        stall._replace(variant="ex", weight=8807.0, altitude=2500.0 / 0.3048)
    )
    assert limits.speed_min > 1.1 * slowest * validate.KNOT / math.sqrt(0.957 / 1.225)


CLIMBS = load(AircraftConfig, ROOT / "configs" / "aircraft" / "c208.yaml").aircraft()


@pytest.mark.parametrize("speed", [55.0, 75.0, 90.0])
@pytest.mark.parametrize("up", [True, False])
def test_the_published_climbs_are_held_in_the_sharpest_turn(speed: float, up: bool) -> None:
    vertical, turn = CLIMBS.vertical, CLIMBS.limits.yaw_rate_max
    assert vertical is not None
    climb = vertical.climb_max if up else -vertical.descent_max
    vehicle = C208Vehicle(VehicleState(0.0, 0.0, 0.0, speed))
    vehicle.step(0.0, turn, 10.0)
    climbs = []
    for _ in range(round(60.0 / PERIOD)):
        vehicle.autopilot.altitude += climb * PERIOD
        vehicle.step(0.5 * (speed - vehicle.state.speed), turn, PERIOD)
        assert vehicle.state.speed == pytest.approx(speed, abs=0.2)
        climbs.append(vehicle.measured.climb)
    np.testing.assert_allclose(climbs[len(climbs) // 2 :], climb, atol=0.05)


@pytest.mark.parametrize("altitude", [500.0, 2_500.0, 4_000.0])
def test_the_published_climbs_are_held_straight_on_over_altitudes(altitude: float) -> None:
    vertical, limits = CLIMBS.vertical, CLIMBS.limits
    assert vertical is not None
    for speed in np.linspace(limits.speed_min, limits.speed_max, 8):
        low, high = validate.climb_range(float(speed), altitude)
        assert low < -vertical.descent_max and vertical.climb_max < high


def test_the_autopilot_changes_a_climb_faster_than_is_published() -> None:
    assert CLIMBS.vertical is not None
    for speed in (55.0, 90.0):
        for rise in (7.0, -7.0):
            reached = validate.climb_acceleration(speed, rise, CLIMBS.limits.yaw_rate_max)
            assert reached > 2.0 * CLIMBS.vertical.acceleration


@pytest.mark.slow
@pytest.mark.parametrize("speed", [57.0, 88.0])
def test_a_profile_is_flown_closest_with_the_lookahead_of_the_climb(speed: float) -> None:
    assert CLIMBS.vertical is not None
    usual = validate.profile_error(speed)
    assert usual < 0.5
    for more in (-0.6, 0.6):
        gains = LOOKAHEAD._replace(climb=LOOKAHEAD.climb + more)
        assert validate.profile_error(speed, gains=gains) > usual
    # In the sharpest turn, which the aircraft enters at the same time.
    assert validate.profile_error(speed, CLIMBS.limits.yaw_rate_max) < 1.0


def test_a_turn_takes_climb() -> None:
    straight, turning = (validate.climb_range(75.0, yaw_rate=rate) for rate in (0.0, 0.087))
    assert turning[0] < straight[0] < 0.0 < turning[1] < straight[1]


# Published waypoints are flown by the true aircraft to metres and tenths of a second.


def history(seed: int, count: int = 5) -> tuple[VehicleState, Legs]:
    """Return a start and legs of 20 s through a random flight of the surrogate, held 10 s a
    command.
    """
    rng = np.random.default_rng(seed)
    state = VehicleState(0.0, 0.0, rng.uniform(-3.0, 3.0), rng.uniform(62.0, 85.0))
    limits = SURROGATE._replace(speed_min=58.0, speed_max=92.0)
    states = [state]
    for second in range(20 * count):
        if second % 10 == 0:
            acceleration, yaw_rate = (
                rng.uniform(-0.4, 0.4),
                rng.uniform(-1.0, 1.0) * math.radians(2.5),
            )
        state = advance(state, acceleration, yaw_rate, 1.0, limits, np)
        if second % 20 == 19:
            states.append(state)
    fields = (np.array(field, dtype=float) for field in zip(*states, strict=True))
    return states[0], legs(PlanStates(*fields, 20.0 * np.arange(count + 1)))


PLANS = [history(seed) for seed in range(3)]
PATHS = [Track(plan) for _, plan in PLANS]


@given(st.floats(-5.0, 130.0), st.integers(0, 2))
def test_a_path_is_the_legs(time: float, number: int) -> None:
    expected, place = at(PLANS[number][1], time), PATHS[number].at(time)
    np.testing.assert_allclose(place[:2], [float(expected.x), float(expected.y)], atol=1e-3)
    assert math.cos(place.heading - float(expected.heading)) == pytest.approx(1.0, abs=1e-9)
    assert place.speed == pytest.approx(float(expected.speed), abs=1e-9)


def errors(plan: Legs, states: list[VehicleState]) -> tuple[np.ndarray, np.ndarray]:
    clock = PERIOD * np.arange(1, len(states) + 1)
    flight = VehicleState(*(np.array(field) for field in zip(*states, strict=True)))
    off = deviation(repeat(plan, clock.size), flight, clock)
    return np.abs(off.cross_track), np.abs(off.time)


@pytest.mark.parametrize("number", range(3))
def test_plans_are_flown_in_calm_air(number: int) -> None:
    start, plan = PLANS[number]
    cross, late = errors(plan, follow(C208Vehicle(start), PATHS[number], 100.0)[0])
    assert np.percentile(cross, 95) < 5.0
    assert cross.max() < 10.0
    assert late.max() < 0.1


def test_plans_are_flown_in_wind_and_turbulence() -> None:
    start, plan = PLANS[0]
    rough = Conditions(wind_east=6.0, wind_north=-8.0, turbulence="moderate", seed=2)
    cross, _ = errors(plan, follow(C208Vehicle(start, conditions=rough), PATHS[0], 100.0)[0])
    assert np.percentile(cross, 95) < 10.0


def test_the_generic_follower_flies_it_too() -> None:
    start, plan = PLANS[1]
    vehicle, states = C208Vehicle(start), []
    for number in range(600):
        vehicle.step(*follower.guidance(plan, vehicle.state, number * PERIOD), PERIOD)
        states.append(vehicle.state)
    cross, late = errors(plan, states)
    assert np.percentile(cross, 95) < 5.0
    assert late.max() < 0.1


@given(st.floats(-80.0, 80.0), st.floats(-0.3, 0.3))
def test_errors_are_steered_against(left: float, heading: float) -> None:
    path = PATHS[2]
    place = path.at(50.0)
    aside = place._replace(
        x=place.x - left * math.sin(place.heading),
        y=place.y + left * math.cos(place.heading),
        heading=place.heading + heading,
    )
    _, straight = Guide(path).commands(place, 50.0)
    _, turn = Guide(path).commands(aside, 50.0)
    expected = -1.1 * heading - 0.30 * left / place.speed
    assert turn - straight == pytest.approx(expected, abs=0.02)


@given(st.floats(-40.0, 40.0))
def test_a_late_aircraft_flies_the_same_path(late: float) -> None:
    path = PATHS[2]
    place = path.at(50.0)
    guide = Guide(path, late=late)
    acceleration, turn = guide.commands(place, 50.0 + late)
    assert guide.late == pytest.approx(late, abs=1e-6)
    assert turn == pytest.approx(Guide(path).commands(place, 50.0)[1], abs=1e-9)
    if abs(late) > 5.0:
        assert acceleration * late > 0.0
