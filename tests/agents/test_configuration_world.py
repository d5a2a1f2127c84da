import math
from dataclasses import fields
from pathlib import Path

import pytest

from agents.config.load import ConfigError, Strict, dump, load
from agents.config.world import AircraftConfig, ScenarioConfig, VehicleConfig
from envs.aircraft import PAPER, new_aircraft
from envs.encounters import SCENARIOS, Scenario, scenario
from envs.kinematics import SURROGATE

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


class World(Strict):
    vehicle: VehicleConfig = VehicleConfig()


def test_the_c208_has_the_same_limits_as_vehicle_and_as_aircraft():
    vehicle = load(VehicleConfig, CONFIGS / "vehicle_c208.yaml")
    assert vehicle.limits() == load(AircraftConfig, CONFIGS / "aircraft" / "c208.yaml").limits()


def test_the_default_vehicle_is_the_surrogate():
    assert VehicleConfig().limits() == SURROGATE


def test_a_vehicle_is_found_beside_the_configuration_and_its_values_are_taken_over(tmp_path: Path):
    (tmp_path / "slow.yaml").write_text("speed_max_mps: 60\n")
    path = tmp_path / "config.yaml"
    path.write_text("vehicle: slow.yaml\n")
    config = load(World, path)
    assert config.vehicle.limits() == SURROGATE._replace(speed_max=60.0)
    assert "slow.yaml" not in dump(config)


def test_a_vehicle_is_found_in_the_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "slow.yaml").write_text("speed_max_mps: 60\n")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "config.yaml").write_text("")
    monkeypatch.chdir(tmp_path)
    config = load(World, Path("sub/config.yaml"), ["vehicle=slow.yaml"])
    assert config.vehicle.speed_max_mps == 60.0


@pytest.mark.parametrize(
    ("vehicle", "sentence"),
    [
        ("none.yaml", "--set: vehicle: none.yaml: there is no such file"),
        ("{speed_min_mps: 100}", "--set: vehicle.speed_min_mps is 100.0; expected less than speed_max_mps, 100.0"),
        (
            "{acceleration_min_mps2: 0.5}",
            "--set: vehicle.acceleration_min_mps2 is 0.5; expected a number at least -20 and below 0",
        ),
        (
            "{yaw_rate_max_deg_s: 1e-300}",
            "--set: vehicle.yaw_rate_max_deg_s is 1e-300; expected a number at least 0.01 and at most 57",
        ),
        (
            "{yaw_rate_max: 3}",
            "--set: vehicle.yaw_rate_max is unknown (its value is 3); did you mean vehicle.yaw_rate_max_deg_s?",
        ),
    ],
)
def test_a_bad_vehicle_is_refused(vehicle: str, sentence: str):
    with pytest.raises(ConfigError) as caught:
        load(World, overrides=[f"vehicle={vehicle}"])
    assert str(caught.value) == sentence


def test_a_bad_vehicle_file_is_named(tmp_path: Path):
    path = tmp_path / "fast.yaml"
    path.write_text("speed_max: 60\n")
    with pytest.raises(
        ConfigError, match=r"vehicle: .*fast\.yaml: speed_max is unknown .* did you mean speed_max_mps\?"
    ):
        load(World, overrides=[f"vehicle={path}"])


@pytest.mark.parametrize("name", SCENARIOS)
def test_an_unchanged_scenario_is_exactly_the_scenario(name: str):
    assert ScenarioConfig(name=name).scenario(PAPER) == scenario(name, PAPER)


def test_every_number_of_a_scenario_can_be_changed():
    degrees = {"course_difference": "_deg", "turn_rate": "_deg_s", "heading_change": "_deg"}
    numbers = {field.name + degrees.get(field.name, "") for field in fields(Scenario)} - {"name", "aircraft"}
    assert set(ScenarioConfig.model_fields) - {"name", "weight", "units"} == numbers


def test_changes_reach_the_scenario_in_radians():
    config = load(
        ScenarioConfig,
        overrides=[
            "course_difference_deg=[-54, 54]",
            "turn_rate_deg_s=2",
            "heading_change_deg=90",
            "conflicts_closer_than=1e9",
            "intruders=[2, 3]",
        ],
    )
    scenario = config.scenario(PAPER)
    assert scenario.course_difference == pytest.approx((-0.3 * math.pi, 0.3 * math.pi))
    assert scenario.turn_rate == pytest.approx(math.radians(2.0))
    assert scenario.heading_change == pytest.approx(math.pi / 2)
    assert scenario.conflicts_closer_than == 1e9
    assert scenario.intruders == (2, 3)


def test_a_scenario_that_contradicts_the_aircraft_is_refused():
    slow = AircraftConfig(speed_min_mps=18.0, speed_max_mps=36.0).aircraft()
    assert ScenarioConfig(own_speed=(18.0, 36.0)).scenario(slow).own_speed == (18.0, 36.0)
    for low, high in ((50.0, 100.0), (18.0, 36.1), (17.9, 36.0)):
        with pytest.raises(ConfigError, match=r"^own_speed is .* 18 to 36, the speeds of the aircraft"):
            ScenarioConfig(own_speed=(low, high)).scenario(slow)


def test_numbers_in_units_of_the_aircraft_are_scaled():
    small = AircraftConfig(speed_min_mps=18.0, speed_max_mps=36.0, separation_m=610.0).aircraft()
    made = load(
        ScenarioConfig,
        overrides=["units=aircraft", "radius=[0.5, 4]", "own_speed=[0.5, 1]", "velocity_std=0.1", "latency=[0, 2]"],
    ).scenario(small)
    assert made.radius == (305.0, 2440.0)
    assert made.own_speed == (18.0, 36.0)
    assert made.velocity_std == pytest.approx(3.6)
    assert made.latency == (0.0, 2.0 * small.dt)


def test_a_dump_holds_only_what_differs_from_the_scenario():
    assert (
        dump(ScenarioConfig(name="head_on", latency=(0.0, 1.0))) == "name: head_on\nweight: 1.0\nlatency: [0.0, 1.0]\n"
    )


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        (
            "name=circl",
            f"--set: name: 'circl' is unknown; expected one of {', '.join(SCENARIOS)}; did you mean circle?",
        ),
        ("weight=0", "--set: weight is 0; expected a number above 0"),
        (
            "own_speed=[100, 50]",
            "own_speed is [100, 50]; expected [low, high] within 50 to 100, the speeds of the aircraft",
        ),
        ("intruders=[0, 1]", "intruders is [0, 1]; expected [low, high] within 1 to 64, that an encounter can have"),
        ("latency=[0, 3]", "latency is [0, 3]; expected [low, high] within 0 to 2, two time steps of the aircraft"),
        ("latency=[0]", "--set: latency.1 is missing; expected a list of 2 values (a number each) or null"),
        ("turn_rate_deg_s=60", "--set: turn_rate_deg_s is 60; expected a number at least 0 and at most 57 or null"),
    ],
)
def test_a_bad_scenario_is_refused(override: str, sentence: str):
    with pytest.raises(ConfigError) as caught:
        load(ScenarioConfig, overrides=[override]).scenario(PAPER)
    assert str(caught.value) == sentence


def test_the_default_aircraft_and_its_file_are_the_papers():
    assert AircraftConfig().aircraft() == PAPER
    assert load(AircraftConfig, CONFIGS / "aircraft" / "paper.yaml").aircraft() == PAPER


@pytest.mark.parametrize("path", sorted((CONFIGS / "aircraft").glob("*.yaml")), ids=lambda path: path.stem)
def test_an_aircraft_file_states_its_limits_and_separation(path: Path):
    config = load(AircraftConfig, path)
    assert {*VehicleConfig.model_fields, "separation_m"} <= config.model_fields_set
    aircraft = config.aircraft()
    bank = math.atan(aircraft.limits.yaw_rate_max * aircraft.limits.speed_max / 9.81)
    assert bank < math.radians(40.0)


def test_what_an_aircraft_does_not_state_follows():
    limits = VehicleConfig(speed_min_mps=18.0, speed_max_mps=36.0).limits()
    config = AircraftConfig(speed_min_mps=18.0, speed_max_mps=36.0, separation_m=610.0, goal_radius_m=200.0)
    assert config.aircraft() == new_aircraft(limits, 610.0, goal_radius=200.0)


@pytest.mark.parametrize(
    "override", ["speed_min_mps=100", "goal_radius_m=2000", "separation_m=400", "t_max_s=10.5", "dt_s=30", "dt_s=0"]
)
def test_an_aircraft_that_contradicts_itself_is_refused(override: str):
    with pytest.raises(ConfigError, match="expected"):
        load(AircraftConfig, None, [override, "goal_radius_m=500"] if "separation" in override else [override])
