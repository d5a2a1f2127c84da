import math
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError, model_validator

from agents.config.keys import help_text, keys, markdown
from agents.config.load import ConfigError, Parser, Strict, dump, load
from agents.config.world import PAPER_AIRCRAFT, AircraftConfig, ScenarioConfig, VehicleConfig
from commands.command import run_cli
from commands.yaml import read, write
from envs.aircraft import PAPER, Vertical, new_aircraft
from envs.encounters import Scenario
from envs.kinematics import SURROGATE
from envs.scenarios import SAMPLERS, SCENARIOS, scenario


class Inner(Strict):
    rate: float = Field(default=7e-4, gt=0.0, le=1.0)
    """Rate, 1/s."""
    count: int = Field(default=4, ge=1)
    """Count."""
    kind: Literal["cpa", "none"] = "cpa"
    """Kind."""
    hidden: tuple[Annotated[int, Field(ge=1)], ...] = (256, 256)
    """Widths."""
    pair: tuple[float, float] | None = None
    """Range, m."""
    flag: bool = True
    """Flag."""

    @model_validator(mode="after")
    def _check(self) -> "Inner":
        if self.count == 13:
            raise ConfigError("count is 13; expected a lucky number")
        return self


class Item(Strict):
    name: str
    """Name."""
    weight: float = 1.0
    """Weight."""


class Outer(Strict):
    name: str = "x"
    """Name of it all."""
    path: Path | None = None
    """A file."""
    inner: Inner = Inner()
    items: tuple[Item, ...] = Field(default=(Item(name="circle"),), min_length=1)
    """Several."""


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("3e-4", 3e-4),
        ("3.e-4", 3e-4),
        (".5", 0.5),
        ("1", 1.0),
        ("1_0e-2", 0.1),
    ],
)
def test_numbers_that_yaml_1_1_reads_as_texts_are_numbers(written: str, value: float):
    assert load(Outer, overrides=[f"inner.rate={written}"]).inner.rate == value


@pytest.mark.parametrize("written", ["10000000", "10_000_000", "1e7", "1.0e+7", "10000000.0"])
def test_whole_numbers_may_be_written_as_people_write_them(written: str):
    count = load(Outer, overrides=[f"inner.count={written}"]).inner.count
    assert count == 10_000_000
    assert type(count) is int


def test_lists_become_tuples_with_converted_items():
    config = load(
        Outer, overrides=["inner.hidden=[1, 2e1]", "inner.pair=[1, 2.5]", "path=a/b.yaml"]
    )
    assert config.inner.hidden == (1, 20)
    assert config.inner.pair == (1.0, 2.5)
    assert config.path == Path("a/b.yaml")
    hash(config)


@pytest.mark.parametrize("name", ["1e7", "007", "no", "a: b", "", "2026-01-01"])
def test_a_text_is_taken_as_it_is_written(name: str):
    assert load(Outer, overrides=[f"name={name}"]).name == name


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("inner.rat=1", "--set: inner.rat is unknown (its value is 1); did you mean inner.rate?"),
        (
            "quux=1",
            "--set: quux is unknown (its value is 1); expected one of name, path, inner, items",
        ),
        (
            "quux.a=1",
            "--set: quux is unknown (its value is {a: 1}); expected one of name, path, inner, "
            "items",
        ),
        ("inner.rate=2", "--set: inner.rate is 2; expected a number above 0 and at most 1"),
        ("inner.rate=fast", "--set: inner.rate is 'fast'; expected a number above 0 and at most 1"),
        (
            "inner.rate='3e-4'",
            "--set: inner.rate is '3e-4'; expected a number above 0 and at most 1",
        ),
        ("inner.rate=true", "--set: inner.rate is true; expected a number above 0 and at most 1"),
        ("inner.rate=.nan", "--set: inner.rate is nan; expected a number above 0 and at most 1"),
        ("inner.rate=", "--set: inner.rate is null; expected a number above 0 and at most 1"),
        ("inner.count=1.5", "--set: inner.count is 1.5; expected a whole number at least 1"),
        ("inner.count=13", "--set: inner.count is 13; expected a lucky number"),
        (
            "inner.kind=cpo",
            "--set: inner.kind is 'cpo'; expected one of cpa, none; did you mean cpa?",
        ),
        ("inner.kind=7", "--set: inner.kind is 7; expected one of cpa, none"),
        ("inner.flag=yes", "--set: inner.flag is 'yes'; expected true or false"),
        (
            "inner.hidden=3",
            "--set: inner.hidden is 3; expected a list (a whole number at least 1 each)",
        ),
        (
            "inner.hidden=[0]",
            "--set: inner.hidden.0 is 0; expected inner.hidden to be a list (a whole number at "
            "least 1 each)",
        ),
        (
            "inner.pair=[1]",
            "--set: inner.pair.1 is missing; expected a list of 2 values (a number each) or null",
        ),
        ("inner=3", "--set: inner is 3; expected a group of keys"),
        ("inner.rate.x=3", "--set inner.rate.x=3: inner.rate is 0.0007 and has no key 'x'"),
        (
            "items=[]",
            "--set: items is []; expected a list (a group of keys each), at least 1 of them",
        ),
        ("items=[{weight: 1}]", "--set: items.0.name is missing; expected a text"),
        (
            "items.0.wight=1",
            "--set: items.0.wight is unknown (its value is 1); did you mean items.0.weight?",
        ),
        (
            "items.1.weight=2",
            "--set items.1.weight=2: '1' is no item of a list of 1; expected 0, 1, ...",
        ),
        ("items.x=2", "--set items.x=2: 'x' is no item of a list of 1; expected 0, 1, ..."),
        ("name", "--set name: expected KEY=VALUE, such as --set name=x"),
        ("inner..rate=1", "--set inner..rate=1: expected KEY=VALUE, such as --set name=x"),
        (
            "inner.rate={a: b: c",
            "--set inner.rate: '{a: b: c': line 1: not valid YAML (expected ',' or '}', but got "
            "':')",
        ),
    ],
)
def test_a_bad_override_is_refused_in_one_sentence(override: str, sentence: str):
    with pytest.raises(ConfigError) as caught:
        load(Outer, overrides=[override])
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("inner: {rate: 2}", "inner.rate is 2; expected a number above 0 and at most 1"),
        (
            "inner: {rate: 2, count: 0}",
            "inner.rate is 2; expected a number above 0 and at most 1 (and 1 more)",
        ),
        (
            "inner: {count: 0, cont: 1}",
            "inner.cont is unknown (its value is 1); did you mean inner.count? (and 1 more)",
        ),
        ("name: 7", "name is 7; expected a text"),
        ("- 1", "expected keys with values, got [1]"),
        ("name: a\nname: b", "line 2: key name stands twice"),
        ("1: a", "line 1: key 1 is no text"),
        ("a: [", "line 1: not valid YAML (expected the node content, but found '<stream end>')"),
        (
            "a: !!python/object:os.system x",
            "line 1: not valid YAML (could not determine a constructor for the tag",
        ),
    ],
)
def test_a_bad_file_is_refused_by_its_name(tmp_path: Path, content: str, sentence: str):
    path = tmp_path / "config.yaml"
    path.write_text(content)
    with pytest.raises(ConfigError) as caught:
        load(Outer, path)
    assert str(caught.value).startswith(f"{path}: {sentence}")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"none\.yaml: there is no such file"):
        load(Outer, tmp_path / "none.yaml")
    with pytest.raises(ConfigError, match="cannot be read"):
        load(Outer, tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"binary\.yaml: not a text in UTF-8"):
        load(Outer, tmp_path / "binary.yaml")
    (tmp_path / "control.yaml").write_bytes(b"name: \x07")
    with pytest.raises(ConfigError, match=r"control\.yaml: not valid YAML"):
        load(Outer, tmp_path / "control.yaml")


def test_an_empty_file_means_the_defaults(tmp_path: Path):
    path = tmp_path / "config.yaml"
    path.write_text("# nothing\n")
    assert load(Outer, path) == Outer()


def test_overrides_win_over_the_file_and_later_ones_over_earlier_ones(tmp_path: Path):
    path = tmp_path / "config.yaml"
    path.write_text("inner: {rate: 0.1, count: 2}\n")
    config = load(Outer, path, ["inner.rate=0.2", "inner.rate=0.3", "items.0.weight=2"])
    assert (config.inner.rate, config.inner.count) == (0.3, 2)
    assert config.items == (Item(name="circle", weight=2.0),)


def test_models_are_frozen():
    with pytest.raises(ValidationError):
        Outer().name = "y"  # pyright: ignore[reportAttributeAccessIssue]


numbers = st.floats(min_value=0.0, max_value=1.0, exclude_min=True)
printable = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20)
configs = st.builds(
    Outer,
    name=printable,
    path=st.none() | st.just(Path("a/b")),
    inner=st.builds(
        Inner,
        rate=numbers,
        count=st.integers(1, 2**62).filter(lambda n: n != 13),
        kind=st.sampled_from(["cpa", "none"]),
        hidden=st.lists(st.integers(1, 9), max_size=3).map(tuple),
        pair=st.none() | st.tuples(numbers, st.floats(allow_nan=False, allow_infinity=False)),
        flag=st.booleans(),
    ),
    items=st.lists(st.builds(Item, name=printable, weight=numbers), min_size=1, max_size=3).map(
        tuple
    ),
)


@given(configs)
def test_loading_a_dump_gives_the_same_configuration(
    tmp_path_factory: pytest.TempPathFactory, config: Outer
):
    path = tmp_path_factory.getbasetemp() / "dump.yaml"
    path.write_text(dump(config), encoding="utf-8")
    assert load(Outer, path) == config


@given(configs)
def test_overrides_can_say_every_configuration(config: Outer):
    values = config.model_dump()
    overrides = [f"name={config.name}", f"path={write(values['path'])}"]
    overrides += [f"inner.{key}={write(value)}" for key, value in values["inner"].items()]
    overrides += [f"items={write(values['items'])}"]
    assert load(Outer, overrides=overrides) == config


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | printable, st.lists
    )
)
def test_yaml_gives_back_what_was_written(value: object):
    assert read(write(value)) == value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: " + "[" * 2_000 + "]" * 2_000, "not valid YAML"),
        ("name: " + "{a: " * 2_000 + "}" * 2_000, "not valid YAML"),
        ("name: &a [1, *a]", r"c\.yaml: line 1: \*a is an alias; expected the value itself"),
        ("name: " + "x" * 2_000_000, "characters; expected at most"),
    ],
)
def test_a_file_that_expands_without_end_is_refused(tmp_path: Path, text: str, words: str):
    path = tmp_path / "c.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        load(Outer, path)


@pytest.mark.parametrize(
    "value", ['!!int ""', '!!float ""', "!!bool x", "!!timestamp x", "!!map [1]", "!!set [1]"]
)
def test_a_value_that_is_not_what_its_tag_says_is_refused(tmp_path: Path, value: str):
    path = tmp_path / "c.yaml"
    path.write_text(f"name: {value}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"c\.yaml: .*not valid YAML"):
        load(Outer, path)


def test_a_named_pipe_is_no_configuration(tmp_path: Path):
    os.mkfifo(tmp_path / "c.yaml")
    with pytest.raises(ConfigError, match="not a regular file"):
        load(Outer, tmp_path / "c.yaml")


def test_help_and_documentation_list_every_key_with_its_text():
    names = [key.name for key in keys(Outer)]
    assert names == [
        "name",
        "path",
        "inner.rate",
        "inner.count",
        "inner.kind",
        "inner.hidden",
        "inner.pair",
        "inner.flag",
        "items",
        "items[].name",
        "items[].weight",
    ]
    assert (
        "  inner.rate: a number above 0 and at most 1 (default: 0.0007)\n      Rate, 1/s.\n"
        in help_text(Outer)
    )
    assert "| `items[].name` | text | `required` | Name. |\n" in markdown(Outer)


@pytest.mark.parametrize(("status", "expected"), [(None, 0), (0, 0), (3, 3)])
def test_a_program_exits_with_its_status(status: int | None, expected: int):
    with pytest.raises(SystemExit) as caught:
        run_cli(lambda: status)
    assert caught.value.code == expected


def test_a_program_that_is_interrupted_exits_with_130(capsys: pytest.CaptureFixture[str]):
    def main() -> None:
        raise KeyboardInterrupt

    with pytest.raises(SystemExit) as caught:
        run_cli(main)
    assert caught.value.code == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_bad_arguments_are_one_sentence():
    parser = Parser(prog="prog")
    parser.add_argument("--seeds", type=int)
    with pytest.raises(ConfigError) as caught:
        parser.parse_args(["--seeds", "x"])
    assert str(caught.value) == "argument --seeds: invalid int value: 'x' (see prog --help)"
    with pytest.raises(ConfigError, match="unrecognized arguments: --see"):
        parser.parse_args(["--see", "1"])


def test_a_reader_that_stops_early_sees_no_traceback() -> None:
    program = "from commands.command import run_cli; run_cli(lambda: print('x' * 200_000))"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait() == 0


CONFIGS = Path(__file__).resolve().parents[2] / "configs"


SLOW = """speed_min_mps: 50
speed_max_mps: 60
acceleration_min_mps2: -0.5
acceleration_max_mps2: 0.5
yaw_rate_max_deg_s: 3
"""


class World(Strict):
    vehicle: VehicleConfig | None = None


def test_the_c208_has_the_same_limits_as_vehicle_and_as_aircraft():
    vehicle = load(VehicleConfig, CONFIGS / "vehicle_c208.yaml")
    assert vehicle.limits() == load(AircraftConfig, CONFIGS / "aircraft" / "c208.yaml").limits()


def test_a_vehicle_is_found_beside_the_configuration_and_its_values_are_taken_over(tmp_path: Path):
    (tmp_path / "slow.yaml").write_text(SLOW)
    path = tmp_path / "config.yaml"
    path.write_text("vehicle: slow.yaml\n")
    config = load(World, path)
    assert config.vehicle is not None
    assert config.vehicle.limits() == SURROGATE._replace(speed_max=60.0)
    assert "slow.yaml" not in dump(config)


def test_a_vehicle_is_found_in_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "slow.yaml").write_text(SLOW)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "config.yaml").write_text("")
    monkeypatch.chdir(tmp_path)
    config = load(World, Path("sub/config.yaml"), ["vehicle=slow.yaml"])
    assert config.vehicle is not None
    assert config.vehicle.speed_max_mps == 60.0


@pytest.mark.parametrize("name", VehicleConfig.STATED)
def test_no_limit_is_taken_from_another_aircraft(tmp_path: Path, name: str):
    """A limit that a vehicle's group or file, or an aircraft's file, leaves out is missing."""
    other_limits = "".join(
        line for line in SLOW.splitlines(keepends=True) if not line.startswith(name)
    )
    (file := tmp_path / "rest.yaml").write_text(other_limits)
    group = "{" + ", ".join(other_limits.splitlines()) + "}"
    (vehicle_file := tmp_path / "own.yaml").write_text(
        f"{SLOW}separation_m: 610\nvehicle: {group}\n"
    )
    (least := tmp_path / "least.yaml").write_text(f"{other_limits}separation_m: 610\n")
    for missing, load_without in (
        (f"vehicle.{name}", lambda: load(World, overrides=[f"vehicle={group}"])),
        (name, lambda: load(World, overrides=[f"vehicle={file}"])),
        (f"vehicle.{name}", lambda: AircraftConfig.of_file(vehicle_file)),
        (name, lambda: AircraftConfig.of_file(least)),
    ):
        with pytest.raises(ConfigError, match=rf"(^|[ .]){missing} is missing; expected"):
            load_without()


def test_an_aircraft_file_without_its_separation_is_refused(tmp_path: Path):
    (file := tmp_path / "slow.yaml").write_text(SLOW)
    with pytest.raises(ConfigError, match=r"slow\.yaml: separation_m is missing; expected"):
        AircraftConfig.of_file(file)


@pytest.mark.parametrize(
    ("vehicle", "sentence"),
    [
        ("none.yaml", "--set: vehicle: none.yaml: there is no such file"),
        (
            "{speed_min_mps: 100, speed_max_mps: 100, acceleration_min_mps2: -0.5, "
            "acceleration_max_mps2: 0.5, yaw_rate_max_deg_s: 3}",
            "--set: vehicle.speed_min_mps is 100.0; expected less than speed_max_mps, 100.0",
        ),
        (
            "{speed_min_mps: 50, speed_max_mps: 100, acceleration_min_mps2: 0.5, "
            "acceleration_max_mps2: 0.5, yaw_rate_max_deg_s: 3}",
            "--set: vehicle.acceleration_min_mps2 is 0.5; expected a number at least -20 and "
            "below 0",
        ),
        (
            "{speed_min_mps: 50, speed_max_mps: 100, acceleration_min_mps2: -0.5, "
            "acceleration_max_mps2: 0.5, yaw_rate_max_deg_s: 1e-300}",
            "--set: vehicle.yaw_rate_max_deg_s is 1e-300; expected a number at least 0.01 and at "
            "most 57",
        ),
        (
            "{speed_min_mps: 50, speed_max_mps: 100, acceleration_min_mps2: -0.5, "
            "acceleration_max_mps2: 0.5, yaw_rate_max: 3}",
            "--set: vehicle.yaw_rate_max is unknown (its value is 3); did you mean "
            "vehicle.yaw_rate_max_deg_s? (and 1 more)",
        ),
    ],
)
def test_a_bad_vehicle_is_refused(vehicle: str, sentence: str):
    with pytest.raises(ConfigError) as caught:
        load(World, overrides=[f"vehicle={vehicle}"])
    assert str(caught.value) == sentence


def test_a_bad_vehicle_file_is_named(tmp_path: Path):
    path = tmp_path / "fast.yaml"
    path.write_text(SLOW.replace("speed_max_mps", "speed_max"))
    with pytest.raises(
        ConfigError,
        match=r"vehicle: .*fast\.yaml: speed_max is unknown .* did you mean speed_max_mps\?",
    ):
        load(World, overrides=[f"vehicle={path}"])


@pytest.mark.parametrize("name", SCENARIOS)
def test_an_unchanged_scenario_is_exactly_the_scenario(name: str):
    assert ScenarioConfig(name=name).scenario(PAPER) == scenario(name, PAPER)


def test_every_number_of_a_scenario_can_be_changed():
    degrees = {"course_difference": "_deg", "turn_rate": "_deg_s", "heading_change": "_deg"}
    numbers = {field.name + degrees.get(field.name, "") for field in fields(Scenario)} - {
        "name",
        "sampler",
        "aircraft",
        "modifiers",
        "together",
    }
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
        with pytest.raises(
            ConfigError, match=r"^own_speed is .* 18 to 36, the speeds of the aircraft"
        ):
            ScenarioConfig(own_speed=(low, high)).scenario(slow)


def test_numbers_in_units_of_the_aircraft_are_scaled():
    small = AircraftConfig(speed_min_mps=18.0, speed_max_mps=36.0, separation_m=610.0).aircraft()
    scaled = load(
        ScenarioConfig,
        overrides=[
            "units=aircraft",
            "radius=[0.5, 4]",
            "own_speed=[0.5, 1]",
            "velocity_std=0.1",
            "latency=[0, 2]",
        ],
    ).scenario(small)
    assert scaled.radius == (305.0, 2440.0)
    assert scaled.own_speed == (18.0, 36.0)
    assert scaled.velocity_std == pytest.approx(3.6)
    assert scaled.latency == (0.0, 2.0 * small.dt)


def test_a_dump_holds_only_what_differs_from_the_scenario():
    assert (
        dump(ScenarioConfig(name="head_on", latency=(0.0, 1.0)))
        == "name: head_on\nweight: 1.0\nlatency: [0.0, 1.0]\n"
    )


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        (
            "name=circl",
            f"--set: name: 'circl' is unknown; expected one of {', '.join(SCENARIOS)}, or "
            "module:name of your own; did you mean circle?",
        ),
        ("weight=0", "--set: weight is 0; expected a number above 0"),
        (
            "own_speed=[100, 50]",
            "own_speed is [100, 50]; expected [low, high] within 50 to 100, the speeds of the "
            "aircraft",
        ),
        (
            "intruders=[0, 1]",
            "intruders is [0, 1]; expected [low, high] within 1 to 64, that an encounter can have",
        ),
        (
            "latency=[0, 3]",
            "latency is [0, 3]; expected [low, high] within 0 to 2, two time steps of the aircraft",
        ),
        (
            "latency=[0]",
            "--set: latency.1 is missing; expected a list of 2 values (a number each) or null",
        ),
        (
            "turn_rate_deg_s=60",
            "--set: turn_rate_deg_s is 60; expected a number at least 0 and at most 57 or null",
        ),
    ],
)
def test_a_bad_scenario_is_refused(override: str, sentence: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(SAMPLERS, "own", {})  # what earlier tests of this process registered
    with pytest.raises(ConfigError) as caught:
        load(ScenarioConfig, overrides=[override]).scenario(PAPER)
    assert str(caught.value) == sentence


def test_the_default_aircraft_and_its_file_are_the_papers():
    assert PAPER_AIRCRAFT.aircraft() == PAPER
    assert load(AircraftConfig, CONFIGS / "aircraft" / "paper.yaml").aircraft() == PAPER


@pytest.mark.parametrize(
    "path", sorted((CONFIGS / "aircraft").glob("*.yaml")), ids=lambda path: path.stem
)
def test_an_aircraft_file_states_its_limits_and_separation(path: Path):
    config = load(AircraftConfig, path)
    assert {*VehicleConfig.model_fields, "separation_m"} <= config.model_fields_set
    aircraft = config.aircraft()
    bank = math.atan(aircraft.limits.yaw_rate_max * aircraft.limits.speed_max / 9.81)
    assert bank < math.radians(40.0)
    assert (aircraft.vertical is None) == (path.stem == "paper")


def test_what_an_aircraft_does_not_state_follows():
    limits = SURROGATE._replace(speed_min=18.0, speed_max=36.0)
    config = AircraftConfig(
        speed_min_mps=18.0, speed_max_mps=36.0, separation_m=610.0, goal_radius_m=200.0
    )
    assert config.aircraft() == new_aircraft(limits, 610.0, goal_radius=200.0)


CLIMBS = {
    "climb_max_mps": 2.5,
    "descent_max_mps": 3.0,
    "vertical_acceleration_mps2": 0.5,
    "vertical_separation_m": 137.2,
}


def stated(numbers: Mapping[str, object]) -> list[str]:
    return [f"{key}={value}" for key, value in numbers.items()]


def test_an_aircraft_climbs_as_it_states():
    config = load(AircraftConfig, None, stated(CLIMBS))
    assert config.aircraft() == PAPER._replace(vehicle=None, vertical=Vertical(*CLIMBS.values()))
    assert AircraftConfig.model_validate(read(dump(config))) == config


def test_an_aircraft_in_the_plane_is_written_as_in_earlier_releases():
    """So that a run repeats, and a training gives the same policy file, to the last bit."""
    written = PAPER_AIRCRAFT.model_dump()
    assert not written.keys() & CLIMBS.keys()
    assert AircraftConfig.model_validate(written).aircraft() == PAPER
    assert load(AircraftConfig, CONFIGS / "aircraft" / "paper.yaml").aircraft().vertical is None


@pytest.mark.parametrize("name", CLIMBS)
def test_climbs_are_stated_whole_or_not_at_all(tmp_path: Path, name: str):
    incomplete = {key: value for key, value in CLIMBS.items() if key != name}
    names = ", ".join(CLIMBS)
    sentence = rf"{name} is missing; expected all of {names}, or none$"
    with pytest.raises(ConfigError, match=f"^{sentence}"):
        load(AircraftConfig, None, stated(incomplete))
    lines = "".join(f"{key}: {value}\n" for key, value in incomplete.items())
    (file := tmp_path / "mine.yaml").write_text(f"{SLOW}separation_m: 610\n{lines}")
    with pytest.raises(ConfigError, match=sentence):
        AircraftConfig.of_file(file)


@pytest.mark.parametrize("name", CLIMBS)
@pytest.mark.parametrize("value", ["0", ".nan", ".inf", "-2", "steep"])
def test_impossible_climbs_are_refused_by_their_key(name: str, value: str):
    with pytest.raises(ConfigError, match=rf"^--set: {name} is .*; expected a number at least"):
        load(AircraftConfig, None, stated({**CLIMBS, name: value}))


@pytest.mark.parametrize(
    "override",
    [
        "speed_min_mps=100",
        "goal_radius_m=2000",
        "separation_m=400",
        "t_max_s=10.5",
        "dt_s=30",
        "dt_s=0",
    ],
)
def test_an_aircraft_that_contradicts_itself_is_refused(override: str):
    with pytest.raises(ConfigError, match="expected"):
        load(
            AircraftConfig,
            None,
            [override, "goal_radius_m=500"] if "separation" in override else [override],
        )
