"""Encounters in space: at one level they are those of the plane, up and down are alike, and who is
far above is nobody.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from agents.baselines.baselines import Observation
from agents.config.world import AircraftConfig
from agents.planner.request.options import Maneuvers, Options
from agents.policy.inference import Policy
from commands.command import InputError
from envs.aircraft import Aircraft
from envs.altitudes import LEVEL, Altitudes, at_step, climb_at, steady
from envs.encounters import Encounter, EncounterError
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.perception import Coverage
from envs.scenarios import sample, scenario
from envs.scenarios.layered import RATE
from envs.starts import encounters_of_seed
from envs.traffic.encounter_model import read_model
from envs.traffic.model_traffic import ModelTraffic, encounters_with
from envs.trees import map_leaves
from eval.config import TrafficConfig
from eval.flights.chunks import Conditioned, Evaluation, ReadyEvaluation, columns
from eval.flights.in_space import at_one_level, reports
from eval.flights.plan_mode import plan_at_start
from eval.flights.recorded import fly_in_mode, fly_recorded
from eval.flights.reported import report_flights
from eval.flights.simulate import OUTCOMES, Flights, Unmitigated, fly
from eval.flights.sources import read_model_traffic
from eval.flights.trajectories import Trajectories, TrajectoryRecorder
from eval.monte_carlo import run as monte_carlo
from tests.envs.formats.test_track_files import ONE
from tests.envs.traffic.test_encounter_model import SMALL
from tests.support import recorded_path

UAS = AircraftConfig.of_file(Path("uas")).aircraft()
C208 = AircraftConfig.of_file(Path("c208")).aircraft()
assert UAS.vertical is not None
VERTICAL = UAS.vertical
COUNT = 3


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load().for_aircraft(UAS)


def layered(count: int = COUNT, seed: int = 3, aircraft: Aircraft = UAS) -> Encounter:
    source = scenario("circle + layered", aircraft)
    return encounters_of_seed(source, seed, 0, count, heeds=("altitudes",))


def fly_as(
    starts: Encounter,
    mode: str,
    policy: Policy,
    maneuvers: str = "horizontal",
    *,
    endless: bool = False,
) -> Flights:
    """Fly encounters in a mode."""
    options = Options.for_aircraft(UAS, maneuvers=Maneuvers(maneuvers), exhaustive=False)
    evaluation = Evaluation(None, scenario("circle", UAS), None, 3, UAS, mode, options)
    ready = ReadyEvaluation(evaluation, policy)
    conditioned = Conditioned(starts, None)
    return fly_in_mode(ready, conditioned, TrajectoryRecorder(starts), endless=endless)[1]


def assert_same(first: Flights, second: Flights) -> None:
    for name, value, expected in zip(Flights._fields, first, second, strict=True):
        np.testing.assert_array_equal(value, expected, err_msg=name)


@pytest.mark.parametrize(
    "mode",
    [
        "policy",
        pytest.param("plan", marks=pytest.mark.slow),
        pytest.param("assured", marks=pytest.mark.slow),
    ],
)
def test_at_one_level_flights_are_those_of_the_plane(mode: str, policy: Policy) -> None:
    starts = encounters_of_seed(scenario("multi", UAS), 5, 0, COUNT)
    plane, space = (
        fly_as(encounters, mode, policy) for encounters in (starts, at_one_level(starts))
    )
    assert_same(plane, space)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["plan", "assured"])
def test_up_and_down_are_alike(mode: str, policy: Policy) -> None:
    assert VERTICAL.climb_max == VERTICAL.descent_max
    starts = layered(2)
    altitudes = starts.altitudes
    assert altitudes is not None
    mirrored = 2.0 * LEVEL - altitudes.intruders
    below = starts._replace(altitudes=altitudes._replace(intruders=mirrored))
    upward, downward = (
        fly(encounters, Unmitigated(UAS), UAS, endless=True) for encounters in (starts, below)
    )
    np.testing.assert_allclose(upward.min_separation, downward.min_separation, rtol=1e-12)
    # Of a climb and a descent that cost the same a plan takes the climb: the flight may differ.
    upward, downward = (fly_as(encounters, mode, policy, "both") for encounters in (starts, below))
    np.testing.assert_array_equal(upward.outcome, downward.outcome)


@pytest.mark.slow
@pytest.mark.parametrize("maneuvers", ["horizontal", "both"])
def test_who_is_far_above_is_nobody(maneuvers: str, policy: Policy) -> None:
    starts = encounters_of_seed(scenario("circle", UAS), 5, 0, COUNT)
    height = np.full(starts.mask.shape, LEVEL + 5_000.0)
    rows = steady(height, np.zeros_like(height), UAS.dt)
    above = starts._replace(altitudes=Altitudes(np.full(COUNT, LEVEL), rows))
    alone = starts._replace(mask=np.zeros_like(starts.mask))
    far, none = (
        fly_as(encounters, "plan", policy, maneuvers) for encounters in (above, at_one_level(alone))
    )
    assert (far.outcome == OUTCOMES.index("reached")).all()
    np.testing.assert_allclose(far.path_length, none.path_length, atol=1e-9)
    assert far.min_separation.min() > 1_000.0 * UAS.separation / VERTICAL.separation


@pytest.mark.parametrize(
    ("early", "lost"), [(0.0, True), (40.0, False), (-40.0, False), (4.0, True)]
)
def test_a_loss_is_one_of_both_separations_at_once(early: float, lost: bool) -> None:
    # Head-on, and through the ownship's level so many seconds before they meet.
    speed, meeting, climb = 25.0, 100.0, -5.0
    own = VehicleState(*np.array([[0.0], [0.0], [0.0], [speed]]))
    intruders = VehicleState(*np.array([[[2.0 * speed * meeting]], [[0.0]], [[np.pi]], [[speed]]]))
    start = encounters_of_seed(scenario("circle", UAS), 0, 0, 1)
    height = np.array([[LEVEL - climb * (meeting - early)]])
    altitudes = Altitudes(np.array([LEVEL]), steady(height, np.full((1, 1), climb), UAS.dt))
    start = start._replace(
        own=own, goal_x=np.array([4_000.0]), goal_y=np.zeros(1), intruders=intruders
    )._replace(altitudes=altitudes, intent=map_leaves(np.zeros_like, start.intent))
    times = np.arange(0.0, 160.0, 0.001)
    apart = np.abs(2.0 * speed * (meeting - times))
    above = np.abs(height[0, 0] + climb * times - LEVEL)
    is_lost = (apart < UAS.separation) & (above < VERTICAL.separation)
    assert is_lost.any() == lost
    flight = fly(start, Unmitigated(UAS), UAS)
    assert (flight.outcome[0] == OUTCOMES.index("violation")) == lost
    if lost:
        assert times[is_lost][0] <= flight.duration[0] <= times[is_lost][0] + UAS.dt + 1e-6
    endless = fly(start, Unmitigated(UAS), UAS, endless=True)
    dense = np.maximum(apart, above * UAS.separation / VERTICAL.separation).min()
    assert endless.min_separation[0] == pytest.approx(dense, abs=0.05)


def test_altitudes_go_on_evenly_between_and_after_their_rows() -> None:
    rows = np.array([[[100.0, 110.0, 105.0]]])
    steps = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 4.0])
    altitudes = [float(at_step(rows, step)[0, 0]) for step in steps]
    assert altitudes == [100.0, 105.0, 110.0, 107.5, 105.0, 95.0]
    # A report knows the climb since the one before.
    climbs = [float(climb_at(rows, step, 2.0)[0, 0]) for step in (0.0, 1.0, 2.0, 3.0)]
    assert climbs == [5.0, 5.0, -2.5, -2.5]


def test_layers_are_as_they_are_said_and_change_nothing_else() -> None:
    source = scenario("multi + layered", UAS)
    drawn = encounters_of_seed(source, 3, 0, 300, heeds=("altitudes",))
    plain = encounters_of_seed(scenario("multi", UAS), 3, 0, 300)
    for name in ("own", "intruders", "goal_x", "mask"):
        map_leaves(np.testing.assert_array_equal, getattr(drawn, name), getattr(plain, name))
    altitudes, mask = drawn.altitudes, drawn.mask
    assert altitudes is not None and source.vertical_miss == 2.0 * VERTICAL.separation
    climb = ((altitudes.intruders[..., 1] - altitudes.intruders[..., 0]) / UAS.dt)[mask]
    level = np.abs(climb) < 1e-9
    assert 0.45 < level.mean() < 0.55
    assert np.abs(climb[~level]).min() >= RATE[0] - 1e-6
    assert np.abs(climb[~level]).max() <= RATE[1] + 1e-6
    assert 0.45 < (climb[~level] > 0.0).mean() < 0.55
    off = (altitudes.intruders[..., 0] - altitudes.own[:, None])[mask][level]
    assert np.abs(off).max() <= source.vertical_miss and abs(off.mean()) < 0.1 * off.std()


def test_a_training_has_no_altitudes() -> None:
    jnp = pytest.importorskip("jax.numpy")
    source = scenario("circle + layered", UAS)
    with pytest.raises(EncounterError, match="has a wind, areas or altitudes of its own"):
        sample(source, jnp.full((1, 2, source.dimensions), 0.4), jnp)


@pytest.mark.parametrize(
    "name", ["1200code_v2p1", "1200only_fwse_v1p2", "1200only_rotorcraft_v1p2"]
)
def test_a_model_s_traffic_in_space(name: str) -> None:
    model = read_model(recorded_path("encounter_models") / f"uncor_{name}.txt")
    plane = ModelTraffic(
        model,
        C208,
        own_speed=(60.0, 80.0),
        cpa_time=(30.0, 180.0),
        miss=1_000.0,
        min_initial_separation=1_000.0,
        ahead=220.0,
    )
    space = replace(plane, vertical_miss=200.0)
    # Whatever the altitudes, intruders and weights are those of the plane.
    (flat, weights), (high, space_weights) = (
        encounters_with(model_traffic, 2, 0, 8) for model_traffic in (plane, space)
    )
    np.testing.assert_array_equal(weights, space_weights)
    map_leaves(np.testing.assert_array_equal, flat.intruders, high.intruders)
    assert flat.altitudes is None and high.altitudes is not None
    edges = model.boundaries[model.place("L")]
    assert edges is not None
    assert (high.altitudes.own >= 0.3048 * edges[0]).all()
    assert (high.altitudes.own <= 0.3048 * edges[-1]).all()
    rows = high.altitudes.intruders
    assert rows.shape[-1] == 401 and np.abs(np.diff(rows)).max() <= 2_000.0 * 0.00508 + 1e-9
    # Within the vertical distance at the closest approach without a resolver.
    recorder = TrajectoryRecorder(high)
    fly(high, Unmitigated(C208), C208, recorder=recorder, endless=True)
    flown = recorder.stack()
    apart = np.hypot(
        flown.intruders.x - flown.own.x[..., None], flown.intruders.y - flown.own.y[..., None]
    )
    closest = np.nanargmin(apart[..., 0], axis=0)
    above = rows[np.arange(8), 0, closest] - high.altitudes.own
    assert np.abs(above).max() <= 200.0 + 10.2


def test_recorded_altitudes_are_flown_where_they_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "one.json"
    path.write_text(json.dumps([ONE]))
    keys = ("--aircraft", "c208", "--scenario", f"tracks:{path}", *QUICK)
    assert monte_carlo.main([*keys, "--out", str(tmp_path / "flat")]) == 0
    high = ("--set", "tracks.altitudes=true")
    assert monte_carlo.main([*keys, *high, "--out", str(tmp_path / "high")]) == 0
    flat, space = (
        pq.read_table(tmp_path / name / "encounters.parquet") for name in ("flat", "high")
    )
    assert "vertical_distance_m" not in flat.column_names
    apart = ONE["h_ft"][1] - ONE["h_ft"][0]
    assert space["vertical_distance_m"].to_pylist() == [pytest.approx(0.3048 * apart, abs=1e-6)]


QUICK = ("--set", "resamples=200", "--set", "figures=false", "--workers", "1")


@pytest.mark.slow
def test_a_run_in_space_by_the_command(tmp_path: Path) -> None:
    common = ("--aircraft", "uas", "--scenario", "circle + layered", "--mode", "assured")
    common = *common, "--encounters", "8", "--set", "planner.maneuvers=both", "--workers", "1"
    common = *common, "--set", "resamples=200"
    assert monte_carlo.main([*common, "--out", str(tmp_path / "one")]) == 0
    table = pq.read_table(tmp_path / "one/encounters.parquet").to_pydict()
    summary = json.loads((tmp_path / "one/summary.json").read_text())
    assert "unresolvable" not in table["verdict"]
    climbs, deviation = np.array(table["climbs"]), np.array(table["altitude_deviation_m"])
    assert ((climbs > 0) == (deviation > 1.0)).all() and climbs.any()
    assert summary["climbed_rate"]["count"] == np.count_nonzero(climbs)
    assert summary["aircraft"]["vertical"]["separation"] == VERTICAL.separation
    reached = np.array(table["outcome"]) == "reached"
    assert np.array(table["min_separation_m"])[reached].min() >= UAS.separation
    # The horizontal miss alone need not be one.
    assert np.array(table["horizontal_miss_m"]).min() < UAS.separation
    again = (*common, "--set", "figures=false", "--set", "chunk=3")
    assert monte_carlo.main([*again, "--out", str(tmp_path / "two")]) == 0
    files = [tmp_path / name / "encounters.parquet" for name in ("one", "two")]
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.slow
def test_a_flight_again_has_its_altitudes(policy: Policy) -> None:
    options = Options.for_aircraft(UAS, maneuvers=Maneuvers.BOTH, exhaustive=False)
    source = scenario("circle + layered", UAS)
    evaluation = Evaluation(None, source, None, 3, UAS, "plan", options)
    ready = ReadyEvaluation(evaluation, policy)
    table, again = columns(ready, 0, 2), fly_recorded(ready, [1, 0])
    np.testing.assert_array_equal(again.flights.min_separation, table["min_separation_m"][[1, 0]])
    track = again.track(0)
    assert track.altitudes is not None
    assert track.altitudes.own.shape == track.own.shape[1:]
    deviation = np.abs(track.altitudes.own - LEVEL).max()
    assert deviation == table["altitude_deviation_m"][1]


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (("aircraft=uas", "planner.maneuvers=both"), "expected horizontal in mode policy"),
        (("mode=plan", "planner.maneuvers=both"), "the aircraft states no limits of climb"),
        (("scenario=circle + layered",), "for an aircraft that states a vertical separation"),
        (
            ("aircraft=uas", "mode=plan", "planner.floor_m=10"),
            'expected maneuvers that are "vertical" or "both"',
        ),
        (
            ("aircraft=uas", "mode=plan", "planner.maneuvers=both", "planner.floor_m=1500"),
            "planner.floor_m is 1500 m; expected one that the ownship of encounter 0 begins within",
        ),
        (
            (
                "aircraft=uas",
                "mode=plan",
                "planner.maneuvers=both",
                "planner.floor_m=1500",
                "planner.ceiling_m=1200",
            ),
            "expected less than the ceiling",
        ),
        (("aircraft=uas", "mode=plan", "planner.maneuvers=both", "areas=2"), "expected none"),
        (
            ("aircraft=c208", "scenario=lincoln:model.txt", "changes.vertical_miss=100"),
            "has no 'L' with edges of its bins; expected vertical_miss null",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused(
    keys: tuple[str, ...], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("model.txt").write_text(SMALL)
    sets = [word for key in keys for word in ("--set", key)]
    with pytest.raises(InputError, match=sentence):
        monte_carlo.main([*sets, "--encounters", "2", "--out", str(tmp_path / "none")])
    assert not (tmp_path / "none").exists()


def hear(starts: Encounter, reach: float) -> Encounter:
    """Return encounters whose intruders are reported all round within a range, m."""
    ones = np.ones(starts.mask.shape)
    return starts._replace(coverage=Coverage(reach * ones, math.pi * ones, 0.0 * ones, 0.0 * ones))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["plan", "assured"])
def test_reports_of_all_change_no_plan_and_of_none_none_is_avoided(
    mode: str, policy: Policy
) -> None:
    starts = layered()
    assert_same(fly_as(hear(starts, 1e6), mode, policy), fly_as(starts, mode, policy))
    nobody = starts._replace(mask=np.zeros_like(starts.mask))
    unseen, alone = (
        fly_as(encounters, mode, policy, endless=True) for encounters in (hear(starts, 1.0), nobody)
    )
    np.testing.assert_array_equal(unseen.path_length, alone.path_length)
    assert (unseen.min_separation < alone.min_separation).all()


def test_traffic_of_a_model_has_the_sensors_that_are_stated(tmp_path: Path) -> None:
    path = tmp_path / "small.txt"
    path.write_text(SMALL)
    plain = read_model_traffic(path, TrafficConfig(), C208)
    stated = {"position_std": 12.0, "velocity_std": 1.2, "latency": 1.0}
    with_sensors = replace(plain, **stated, sensor_range=4_000.0, field_of_view=math.pi)
    (drawn, weights), (bare, bare_weights) = (
        encounters_with(model_traffic, 3, 0, 4) for model_traffic in (with_sensors, plain)
    )
    for name, value in stated.items():
        assert (getattr(drawn.sensor, name) == value).all()
    assert drawn.coverage is not None and bare.coverage is None
    assert (drawn.coverage.reach == 4_000.0).all()
    assert (drawn.coverage.half_angle == 0.5 * math.pi).all()
    assert not any(field.any() for field in bare.sensor)
    np.testing.assert_array_equal(weights, bare_weights)
    np.testing.assert_array_equal(drawn.intruders.x, bare.intruders.x)
    late = TrafficConfig(latency=2.0 * C208.dt + 0.5)
    sentence = rf"latency is {late.latency:g} s; expected at most two time steps"
    with pytest.raises(EncounterError, match=sentence):
        read_model_traffic(path, late, C208)


def with_altimeters(starts: Encounter, too_high: float) -> Encounter:
    """Return encounters whose intruders' altimeters all read too high, m, and say so."""
    assert starts.altitudes is not None
    off = np.full(starts.mask.shape, too_high)
    altitudes = starts.altitudes._replace(too_high=off, stated_error=np.abs(off))
    return starts._replace(altitudes=altitudes)


def test_resolvers_hear_what_altimeters_read_and_losses_are_judged_by_the_truth() -> None:
    starts, heard = layered(), list[np.ndarray]()

    class Listener(Unmitigated):
        def decide(
            self, observation: Observation, memory: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray]:
            assert observation.above is not None
            heard.append(observation.above)
            return super().decide(observation, memory)

    told = [
        fly(encounters, Listener(UAS), UAS, endless=True)
        for encounters in (starts, with_altimeters(starts, 40.0))
    ]
    right, high = heard[: len(heard) // 2], heard[len(heard) // 2 :]
    for true, read in zip(right, high, strict=True):
        np.testing.assert_allclose(read, true + 40.0, atol=1e-9)
    map_leaves(np.testing.assert_array_equal, *told)
    altitudes = with_altimeters(starts, 40.0).altitudes
    assert altitudes is not None and starts.altitudes is not None
    for read, true in zip(
        reports(altitudes, 2, UAS.dt), reports(starts.altitudes, 2, UAS.dt), strict=True
    ):
        for report, truth in zip(read, true, strict=True):
            assert report.altitude is not None and truth.altitude is not None
            assert report.altitude == replace(
                truth.altitude, value=pytest.approx(truth.altitude.value + 40.0), error=40.0
            )


def test_alerts_are_of_what_altimeters_read() -> None:
    starts = layered()
    flown = fly_recorded_straight(starts)
    reported = report_flights(with_altimeters(starts, -25.0), flown, None, UAS.dt)
    assert reported.altitudes is not None and flown.altitudes is not None
    lower = flown.altitudes.intruders - 25.0
    np.testing.assert_allclose(reported.altitudes.intruders, lower, atol=1e-9)
    np.testing.assert_array_equal(reported.altitudes.own, flown.altitudes.own)


def fly_recorded_straight(starts: Encounter) -> Trajectories[Air]:
    """Return the flights without a resolver."""
    recorder = TrajectoryRecorder(starts)
    fly(starts, Unmitigated(UAS), UAS, recorder=recorder, endless=True)
    return recorder.stack()


def test_plans_keep_away_by_what_altimeters_may_be_off(policy: Policy) -> None:
    # All at one level; they read 100 m below it, of which only one kind of report says that it may
    # be wrong.
    starts = at_one_level(encounters_of_seed(scenario("circle", UAS), 3, 0, COUNT))
    wrong = with_altimeters(starts, -100.0)
    assert wrong.altitudes is not None
    unsaid = wrong._replace(altitudes=wrong.altitudes._replace(stated_error=None))
    options = Options.for_aircraft(UAS, maneuvers=Maneuvers.VERTICAL)
    said, trusting = (
        plan_at_start(encounters, policy, UAS, options).candidates for encounters in (wrong, unsaid)
    )
    assert said.safe.all() and trusting.safe.all()
    # Trusted, they are far enough below the way straight on.
    assert (trusting.cost < said.cost).all()
    assert said.profile is not None and trusting.profile is not None
    for careful, level in zip(said.profile, trusting.profile, strict=True):
        assert np.ptp(level.altitude) == 0.0
        assert np.abs(careful.altitude - LEVEL).max() > VERTICAL.separation


def test_altimeters_of_a_model_s_traffic() -> None:
    path = recorded_path("encounter_models") / "uncor_1200code_v2p1.txt"
    how = TrafficConfig(vertical_miss=100.0, miss=900.0, min_initial_separation=0.0)
    plain = read_model_traffic(path, how, UAS)
    (drawn, weights), (bare, bare_weights) = (
        encounters_with(traffic, 3, 0, 60) for traffic in (replace(plain, altitude_std=20.0), plain)
    )
    altitudes, exact = drawn.altitudes, bare.altitudes
    assert altitudes is not None and exact is not None and exact.too_high is None
    assert altitudes.too_high is not None and altitudes.stated_error is not None
    np.testing.assert_array_equal(altitudes.intruders, exact.intruders)
    np.testing.assert_array_equal(weights, bare_weights)
    assert (altitudes.stated_error == 40.0).all()
    # Four standard errors of 60 draws.
    assert abs(altitudes.too_high.mean()) < 4.0 * 20.0 / math.sqrt(60.0)
    assert altitudes.too_high.std() == pytest.approx(20.0, rel=4.0 / math.sqrt(120.0))
    later, _ = encounters_with(replace(plain, altitude_std=20.0), 3, 50, 10)
    assert later.altitudes is not None
    np.testing.assert_array_equal(later.altitudes.too_high, altitudes.too_high[50:60])
    with pytest.raises(ValueError, match="altitude_std is 20 m without vertical_miss"):
        TrafficConfig(altitude_std=20.0)
