"""Encounters with areas and a wind of their own, areas of a file, and traffic that stands on the
ground in any wind.
"""

import json
import math
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from agents.config.load import ConfigError
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.areas import Area, AreaError, Circle
from envs.encounters import EncounterError, Sampler
from envs.formats.areas import write_areas
from envs.formats.local_frame import LocalFrame
from envs.scenarios import SAMPLERS, register, sample, scenario
from envs.scenarios.geometry import conflict_point
from envs.starts import check_encounter, encounters_of_seed
from envs.wind import Wind, over_ground
from eval.config import MonteCarloConfig
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns, conditions_of
from eval.flights.in_wind import stand
from eval.monte_carlo import run as monte_carlo
from eval.runner.options import named_evaluation

NUMBERS = np.arange(5)
WALL = Area(Circle(0.0, 3e3, 800.0), clearance=100.0, name="wall")


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SAMPLERS, "own", {})


def in_a_valley(chosen: Any, draws: Any, xp: Any) -> Any:
    """Encounters of the circle with a wall beside the way and a wind along it."""
    encounter, accepted = conflict_point(chosen, draws, xp)
    areas = np.empty(draws.shape[0], dtype=object)
    for n in range(len(areas)):
        x, y = (
            0.5 * (encounter.own.x[n] + encounter.goal_x[n]),
            0.5 * (encounter.own.y[n] + encounter.goal_y[n]),
        )
        areas[n] = (Area(Circle(float(x), float(y), 700.0), clearance=100.0),)
    zero = xp.zeros_like(encounter.goal_x)
    return encounter._replace(areas=areas, wind=Wind(zero + 8.0, zero - 3.0, zero)), accepted


def valley(mode: str = "plan", **more: Any) -> ReadyEvaluation:
    register("valley", Sampler(in_a_valley, shared=7, per_intruder=7))
    source = scenario("valley", PAPER, radius=(6e3, 8e3))
    return ReadyEvaluation(Evaluation(None, source, None, 3, PAPER, mode, **more), Policy.load())


def test_areas_and_wind_of_an_encounter_are_flown_as_they_are_stated() -> None:
    ready = valley()
    starts = encounters_of_seed(ready.evaluation.source, 3, 0, 5, heeds=ready.evaluation.heeds)
    conditioned = conditions_of(ready.evaluation, starts, NUMBERS, None)
    assert conditioned.wind is not None and conditioned.areas is not None
    assert set(conditioned.wind.east) == {8.0} and set(conditioned.wind.north) == {-3.0}
    assert [areas[0].shape.radius for areas in conditioned.areas] == [700.0] * 5
    # The goal is stated over the ground, where the areas are.
    assert (conditioned.starts.goal_x == starts.goal_x).all()
    assert len(conditions_of(valley(areas=2).evaluation, starts, NUMBERS, None).areas[0]) > 1  # pyright: ignore[reportOptionalSubscript]
    check_encounter(starts, PAPER, (5,))


@pytest.mark.slow
def test_safe_plans_keep_out_of_the_areas_of_their_encounter() -> None:
    table = columns(valley(), 0, 2)
    safe = table["plan_status"] == "safe"
    assert safe.any() and (table["min_area_clearance_m"][safe] >= -1e-6).all()
    assert set(table["wind_east_m_s"]) == {8.0}
    # In a wind nothing is proven: what nobody has solved is undecided.
    assert set(table["verdict"]) <= {"resolvable", "undecided"}


def test_who_does_not_heed_them_refuses_them() -> None:
    ready = valley("policy")
    source = ready.evaluation.source
    with pytest.raises(EncounterError, match=r"'valley' has a wind of its own; expected eval.mon"):
        encounters_of_seed(source, 3, 0, 2, heeds=ready.evaluation.heeds)
    with pytest.raises(EncounterError, match=r"areas of its own; expected eval\.monte_carlo"):
        encounters_of_seed(source, 3, 0, 2, heeds=("wind",))
    with pytest.raises(EncounterError, match="'valley' has a wind, areas or altitudes of its own"):
        scenario_of_valley = scenario("valley", PAPER)
        sample(scenario_of_valley, jnp.full((1, 4, scenario_of_valley.dimensions), 0.5), jnp)
    blowing = valley(wind_mps=(3.0, 4.0))
    starts = encounters_of_seed(source, 3, 0, 1, heeds=blowing.evaluation.heeds)
    with pytest.raises(EncounterError, match=r"wind_mps is \[3, 4\]; expected \[0, 0\]"):
        conditions_of(blowing.evaluation, starts, NUMBERS[:1], None)


def test_what_is_refused_leaves_no_folder(tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = ["--mode", "plan", "--scenario", "circle + reacting", "--encounters", "4"]
    with pytest.raises(EncounterError, match="intruders that answer the ownship"):
        monte_carlo.main([*arguments, "--workers", "1", "--out", str(out)])
    assert not out.exists()


def test_areas_that_are_none_are_refused() -> None:
    starts = encounters_of_seed(scenario("circle", PAPER), 3, 0, 2)
    for wrong in (np.array([1.0, 2.0]), np.array([(WALL,)], dtype=object)):
        with pytest.raises(EncounterError, match=r"areas: expected an object array \(2,\)"):
            check_encounter(starts._replace(areas=wrong), PAPER, (2,))


def test_traffic_that_stands_does_not_drift_in_the_wind() -> None:
    starts = encounters_of_seed(scenario("multi + standing", PAPER), 4, 0, 60)
    motionless = starts.mask & (starts.intruders.speed == 0.0)
    assert motionless.any() and not motionless.all()
    wind = Wind(np.full(60, 7.0), np.full(60, -11.0), np.zeros(60))
    carried = stand(starts, wind)
    wind_of_each = Wind(wind.east[:, None], wind.north[:, None])
    for seconds in (0.0, 100.0):
        vx = carried.intruders.speed * np.cos(carried.intruders.heading)
        vy = carried.intruders.speed * np.sin(carried.intruders.heading)
        flown = carried.intruders._replace(
            x=carried.intruders.x + seconds * vx, y=carried.intruders.y + seconds * vy
        )
        over_the_ground = over_ground(flown, wind_of_each, np.full((60, 1), seconds))
        assert np.abs(over_the_ground.x - starts.intruders.x)[motionless].max() < 1e-6
        assert np.abs(over_the_ground.y - starts.intruders.y)[motionless].max() < 1e-6
        assert np.abs(over_the_ground.speed)[motionless].max() < 1e-6
    moving = starts.mask & ~motionless
    assert (carried.intruders.speed == starts.intruders.speed)[moving].all()
    assert (carried.intent.heading_change[motionless] == 0.0).all()


def test_areas_of_a_file_are_those_of_every_encounter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "a wall.geojson", tmp_path / "run"
    far = Area(Circle(200e3, 0.0, 500.0), name="far")
    write_areas(file, [WALL, far], LocalFrame(47.0, 8.0))
    place = ["--latitude", "47", "--longitude", "8"]
    small = ["--encounters", "3", "--workers", "1", "--set", "figures=false", "--out", str(out)]
    assert monte_carlo.main(["--areas", str(file), *place, *small]) == 0
    assert "1 area lies more than 100 km" in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert "breach_rate" in summary
    config = MonteCarloConfig(areas_file=file, latitude=47.0, longitude=8.0)
    (area,) = named_evaluation(config)[0].file_areas
    assert (area.name, area.clearance) == ("wall", 100.0)
    assert math.isclose(area.shape.y, 3e3, abs_tol=1e-3)
    file.write_text(file.read_text() + " ")
    with pytest.raises(
        ConfigError, match=r"a wall\.geojson has SHA-256 .* expected .*areas_sha256"
    ):
        monte_carlo.main(["--config", str(out / "config.yaml"), "--out", str(tmp_path / "again")])


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        (["--areas", "none.geojson", "--latitude", "47"], ConfigError, "longitude is None"),
        (["--latitude", "47"], ConfigError, "latitude is 47.0; expected .* null without"),
        (["--areas", "x.geojson", "--latitude", "8", "--longitude", "47"], AreaError, "exchanged"),
        (
            [
                *[
                    "--areas",
                    "x.geojson",
                    "--latitude",
                    "47",
                    "--longitude",
                    "8",
                    "--scenario",
                    "tracks:x.daa",
                ]
            ],
            ConfigError,
            "areas_file is .*; expected null for tracks:",
        ),
    ],
)
def test_areas_that_cannot_be_flown_among_are_refused(
    arguments: list[str],
    error: Any,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_areas("x.geojson", [WALL], LocalFrame(47.0, 8.0))
    with pytest.raises(error, match=says):
        monte_carlo.main([*arguments, "--encounters", "2", "--out", "run"])
    assert not Path("run").exists()
