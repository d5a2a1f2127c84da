"""Encounter models: read as the form says, refused where malformed, sampled as their tables say, met as documented."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from envs import draws, intruder
from envs.aircraft import PAPER
from envs.encounters import EncounterError
from envs.kinematics import VehicleState
from envs.traffic.encounter_model import LAYER, EncounterModel, Variable, read_model
from envs.traffic.encounter_model_sampler import dimensions, fly_tracks, sample_model
from envs.traffic.model_traffic import ModelTraffic, Stratum, encounters_with
from envs.traffic.replay import off_arcs
from envs.traffic.track_units import KNOT
from envs.trees import map_leaves, take
from tests.support import recorded_path

SMALL = """\
# labels_initial
"G", "v", "\\dot v", "\\dot h", "\\dot \\psi"
# G_initial
0 1 0 0 0
0 0 1 0 0
0 0 0 1 1
0 0 0 0 0
0 0 0 0 0
# r_initial
2 2 3 2 3
# N_initial
30 70 10 90 60 40 1 8 1 2 6 2 5 5 6 4 5 5 1 2 7 3 3 4 2 8 0
# labels_transition
"G", "v", "\\dot v(t)", "\\dot h(t)", "\\dot \\psi(t)", "\\dot v(t+1)", "\\dot h(t+1)", "\\dot \\psi(t+1)"
# G_transition
0 0 0 0 0 0 0 0
0 0 0 0 0 0 0 0
0 0 0 0 0 1 0 0
0 0 0 0 0 0 1 0
0 0 0 0 0 0 0 1
0 0 0 0 0 0 1 0
0 0 0 0 0 0 0 0
0 0 0 0 0 0 0 0
# r_transition
2 2 3 2 3 3 2 3
# N_transition
9 1 0 1 98 1 0 1 9 9 1 2 8 5 5 1 9 3 7 0 0 8 2 0 1 98 1 0 0 0
# boundaries
*
100 150 200
-2 -0.5 0.5 2
-500 0 500
-6 -1 1 6
# resample_rates
0 0 0.2 0.1 0.3
"""

DRIFTING = """\
# labels_initial
"L", "\\dot h"
# G_initial
0 1
0 0
# r_initial
2 2
# N_initial
30 70 10 20 60 10
# labels_transition
"L", "\\dot h(t)", "\\dot h(t+1)"
# G_transition
0 0 0
0 0 1
0 0 0
# r_transition
2 2 2
# N_transition
9 1 2 8
# boundaries
0 1000 2000
-800 0 800
# resample_rates
0 0.1
"""  # balloons


def write_file(tmp_path: Path, text: str = SMALL) -> Path:
    path = tmp_path / "model.txt"
    path.write_text(text)
    return path


def assert_refused(tmp_path: Path, text: str, old: str, new: str, sentence: str) -> None:
    """Check that a file is refused once a part of it is another, with the file and a sentence."""
    assert old in text
    with pytest.raises(EncounterError, match=r"model\.txt") as refused:
        read_model(write_file(tmp_path, text.replace(old, new, 1)))
    assert sentence in str(refused.value)


def test_a_model_by_hand(tmp_path: Path) -> None:
    model = read_model(write_file(tmp_path))
    assert [variable.name for variable in model.initial] == [
        "G",
        "v",
        r"\dot v",
        r"\dot h",
        r"\dot \psi",
    ]
    assert [variable.parents for variable in model.initial] == [(), (0,), (1,), (2,), (2,)]
    assert model.initial[1].counts.tolist() == [[10, 90], [60, 40]]
    assert model.moving == (2, 3, 4)
    # The second depends on the first of the same second: place 5 is \dot v(t+1).
    assert [variable.parents for variable in model.transition] == [(2,), (3, 5), (4,)]
    assert model.transition[1].counts.shape == (6, 2)
    assert model.transition[2].counts.tolist() == [[8, 2, 0], [1, 98, 1], [0, 0, 0]]
    assert model.boundaries[0] is None
    assert model.rates.tolist() == [0.0, 0.0, 0.2, 0.1, 0.3]


def test_the_public_models_are_consistent() -> None:
    for path in sorted(recorded_path("encounter_models").glob("uncor_*.txt")):
        model = read_model(path)
        first, second = model.initial[:2]
        # A child's counts, summed over its bins, are the counts of its parents' bins: the columns are in order.
        np.testing.assert_array_equal(second.counts.sum(axis=1), first.counts[0])
        third = model.initial[2].counts.sum(axis=1).reshape(second.bins, first.bins)
        np.testing.assert_array_equal(third, second.counts.T)
        sums = {variable.counts.sum() for variable in model.transition}
        assert len(sums) == 1


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("# r_initial\n2 2 3 2 3\n", "", "no block r_initial, expected one"),
        (
            "# resample_rates\n0 0 0.2 0.1 0.3\n",
            "# resample_rates\n",
            "line 34: block resample_rates is empty",
        ),
        ("# G_initial", "# graph", "line 3: block 'graph', expected one of labels_initial"),
        ("# G_transition", "# G_initial", "block G_initial stands twice"),
        (
            '"v", "\\dot v",',
            '"speed", "\\dot v",',
            "line 2, block labels_initial: no variable 'v', expected one",
        ),
        ('"G", "v"', 'G, "v"', "line 2, block labels_initial: expected different names in quotes"),
        (
            "\\dot v(t+1)",
            "\\dot w(t+1)",
            "line 14, block labels_transition: '\\\\dot w(t+1)', expected a variable",
        ),
        ("2 2 3 2 3\n# N", "2 2 3 2\n# N", "line 10, block r_initial: 4 numbers, expected 5"),
        ("2 2 3 2 3\n# N", "2 2 0 2 3\n# N", "block r_initial: 0, expected whole numbers from 1"),
        (
            "2 2 3 2 3 3 2 3",
            "2 2 3 2 3 3 3 3",
            "block r_transition, variable '\\\\dot h(t+1)': 3 bins, expected 2",
        ),
        (
            "30 70 10",
            "30 10",
            "line 12, block N_initial: 26 numbers, expected 27 (a file that is cut off?)",
        ),
        ("30 70 10", "30 -70 10", "line 12, block N_initial: -70, expected numbers from 0"),
        ("30 70 10", "30 many 10", "line 12, block N_initial: 'many', expected numbers"),
        ("30 70 10", "30 nan 10", "line 12, block N_initial: nan, expected numbers from 0"),
        ("30 70 10", "0 0 10", "variable 'G': all counts are 0"),
        ("0 1 0 0 0\n0 0 1", "0 1 0 0 0\n1 0 1", "block G_initial: 'G' is its own ancestor"),
        ("0 1 0 0 0\n0 0 1", "0 1 0 0\n0 0 1", "line 4, block G_initial: 4 numbers, expected 5"),
        ("0 1 0 0 0\n0 0 1", "0 0 1", "block G_initial: 4 lines, expected 5"),
        (
            "-2 -0.5 0.5 2",
            "-2 0.5 0.5 2",
            "line 31, block boundaries, variable '\\\\dot v': expected edges that increase",
        ),
        ("-2 -0.5 0.5 2", "*", "variable '\\\\dot v': '*', expected edges"),
        ("100 150 200", "-100 150 200", "variable 'v': -100, expected numbers from 0 to 2000"),
        (
            "100 150 200",
            "100 150 1e300",
            "line 30, block boundaries, variable 'v': 1e+300, expected numbers from",
        ),
        (
            "-6 -1 1 6",
            "-600 -1 1 6",
            "variable '\\\\dot \\\\psi': -600, expected numbers from -180 to 180",
        ),
        ("30 70 10", "30 7_0 10", "line 12, block N_initial: '7_0', expected numbers"),
        (
            "0 0 0.2 0.1 0.3",
            "0 0 1.2 0.1 0.3",
            "line 35, block resample_rates: 1.2, expected numbers from 0 to 1",
        ),
    ],
)
def test_a_malformed_file_is_refused_by_line_and_block(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    assert_refused(tmp_path, SMALL, old, new, sentence)


@given(st.integers(0, len(SMALL) - 5))
def test_a_file_that_is_cut_off_is_refused(
    tmp_path_factory: pytest.TempPathFactory, length: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.txt"
    path.write_text(SMALL[:length])
    with pytest.raises(EncounterError, match=r"cut\.txt"):
        read_model(path)


def test_initial_variables_come_as_often_as_the_tables_say(tmp_path: Path) -> None:
    model = read_model(write_file(tmp_path))
    sampled = sample_model(model, draws.uniforms(3, 0, 20_000, (dimensions(model, 2),)), 2)
    chances = {}
    for place, variable in enumerate(model.initial):
        table = variable.counts / variable.counts.sum(axis=1, keepdims=True)
        parent = chances[variable.parents[0]] if variable.parents else np.ones(1)
        chances[place] = parent @ table
        counts = np.bincount(sampled.bins[:, place], minlength=variable.bins)
        # A true sampler fails this once in 10 000 seeds.
        possible = chances[place] > 0
        assert stats.chisquare(counts[possible], 20_000 * chances[place][possible]).pvalue > 1e-4
        assert (counts[~possible] == 0).all()


def test_a_public_model_s_joint_frequencies() -> None:
    model = read_model(recorded_path("encounter_models/uncor_1200code_v2p1.txt"))
    sampled = sample_model(model, draws.uniforms(5, 0, 20_000, (dimensions(model, 2),)), 2)
    # The counts of airspeed under class, area and layer are the joint counts of all four.
    variable = model.initial[3]
    expected = variable.counts.ravel() / variable.counts.sum() * 20_000
    g, a, layer, speed = sampled.bins[:, :4].T
    counts = np.bincount((g + 4 * a + 16 * layer) * variable.bins + speed, minlength=expected.size)
    common = expected >= 5.0
    rare = [expected[~common].sum()], [counts[~common].sum()]
    test_result = stats.chisquare(
        np.append(counts[common], rare[1]), np.append(expected[common], rare[0])
    )
    assert test_result.pvalue > 1e-4


def test_transitions_come_as_often_as_the_tables_say(tmp_path: Path) -> None:
    model = read_model(write_file(tmp_path))
    # Of what turns: -6..-1 deg/s, exactly 0, 1..6 deg/s.
    sampled = sample_model(model, draws.uniforms(4, 0, 4_000, (dimensions(model, 30),)), 30)
    turn = np.sign(-sampled.turn_rate).astype(int) + 1
    before, after = turn[:, :-1].ravel(), turn[:, 1:].ravel()
    table = model.transition[2].counts
    for bin_ in (0, 1):
        counts = np.bincount(after[before == bin_], minlength=3)
        expected = table[bin_] / table[bin_].sum() * counts.sum()
        assert stats.chisquare(counts[expected > 0], expected[expected > 0]).pvalue > 1e-4
        assert (counts[expected == 0] == 0).all()
    # What was never seen keeps its bin.
    assert (after[before == 2] == 2).all()


def test_values_change_as_the_rates_say_and_stay_in_their_bins(tmp_path: Path) -> None:
    model = read_model(write_file(tmp_path))
    sampled = sample_model(model, draws.uniforms(4, 0, 4_000, (dimensions(model, 30),)), 30)
    rate = sampled.turn_rate
    stays = (rate[:, 1:] < 0.0) & (rate[:, :-1] < 0.0)
    changed = (rate[:, 1:] != rate[:, :-1])[stays]
    assert changed.mean() == pytest.approx(0.3, abs=4.0 * math.sqrt(0.3 * 0.7 / changed.size))
    degrees = np.abs(np.degrees(rate[rate != 0.0]))
    assert degrees.min() >= 1.0
    assert degrees.max() <= 6.0
    assert (sampled.speed >= 100 * KNOT).all()
    assert (sampled.speed <= 200 * KNOT).all()
    # Uniform inside the bin.
    first = np.abs(np.degrees(sampled.turn_rate[:, 0]))
    assert stats.kstest((first[first > 0] - 1.0) / 5.0, "uniform").pvalue > 1e-4


def test_a_track_is_what_was_drawn(tmp_path: Path) -> None:
    model = read_model(write_file(tmp_path))
    sampled = sample_model(model, draws.uniforms(1, 0, 50, (dimensions(model, 60),)), 60)
    track = fly_tracks(model, sampled, 150.0)
    assert track.x.shape == (50, 61)
    assert (track.speed >= 100 * KNOT - 1e-9).all()
    assert (track.speed <= 150.0).all()
    turned = np.diff(np.unwrap(track.heading, axis=1), axis=1)
    np.testing.assert_allclose(turned, sampled.turn_rate, atol=1e-12)
    # A millisecond's Euler steps of the first second.
    x, y, heading, speed = 0.0, 0.0, 0.0, sampled.speed[0]
    for _ in range(1_000):
        x, y = x + 1e-3 * speed * math.cos(heading), y + 1e-3 * speed * math.sin(heading)
        heading += 1e-3 * sampled.turn_rate[0, 0]
        speed = min(max(speed + 1e-3 * sampled.acceleration[0, 0], 100 * KNOT), 150.0)
    assert (track.x[0, 1], track.y[0, 1]) == pytest.approx((x, y), abs=0.01)


def test_what_drifts_stands_still_in_the_air_and_climbs_and_descends(tmp_path: Path) -> None:
    model = read_model(write_file(tmp_path, DRIFTING))
    encounters, weights = encounters_with(family(model, vertical_miss=100.0), 5, 0, 200)
    recording = recording_of(encounters)
    for place in (recording.x, recording.y):
        np.testing.assert_array_equal(place, np.broadcast_to(place[..., :1], place.shape))
    np.testing.assert_array_equal(recording.speed, 0.0)
    # The plane's area per second and metre is that which the ownship sweeps.
    np.testing.assert_allclose(weights, encounters.own.speed)
    climb = np.diff(encounters.altitudes.intruders[:, 0]) / (0.3048 / 60.0)  # ft/min
    assert np.abs(climb).max() <= 800.0 + 1e-6
    assert {-1.0, 1.0} <= set(np.sign(climb).ravel())


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"\\dot h"', '"w"', "line 2, block labels_initial: no variable 'v', expected one"),
        ("-800 0 800", "*", "block boundaries, variable '\\\\dot h': '*', expected edges"),
        (
            '"L", "\\dot h"',
            '"L", "v"',
            "line 2, block labels_initial: no variable '\\\\dot v', expected one",
        ),
    ],
)
def test_a_malformed_file_of_what_drifts_is_refused(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    assert_refused(tmp_path, DRIFTING, old, new, sentence)


DURATION = 400
RANGES: dict[str, Any] = {"own_speed": (50.0, 100.0), "cpa_time": (30.0, 180.0)}
DISTANCES = {"miss": 1_000.0, "min_initial_separation": 1_000.0, "ahead": 220.0}


def family(model: EncounterModel, **changes: Any) -> ModelTraffic:
    return ModelTraffic(model, PAPER, **RANGES | DISTANCES | changes)


@pytest.fixture(scope="module")
def traffic(tmp_path_factory: pytest.TempPathFactory) -> ModelTraffic:
    return family(read_model(write_file(tmp_path_factory.mktemp("model"))))


def test_recordings_have_a_row_a_time_step_of_the_aircraft(traffic: ModelTraffic) -> None:
    usual, _ = encounters_with(traffic, 7, 0, 10)
    halved, _ = encounters_with(replace(traffic, aircraft=PAPER._replace(dt=0.5)), 7, 0, 10)
    for usual_field, halved_field in zip(usual.intent, halved.intent, strict=True):
        assert halved_field.shape[-1] == 2 * DURATION + 1
        np.testing.assert_allclose(np.cos(halved_field[..., ::2]), np.cos(usual_field), atol=1e-5)
    assert off_arcs(halved.intent, halved.mask, 0.5).max() < 0.75


def test_encounters_follow_from_seed_and_number_alone(traffic: ModelTraffic) -> None:
    encounters, weights = encounters_with(traffic, 7, 0, 40)
    part, part_weights = encounters_with(traffic, 7, 25, 6)
    np.testing.assert_array_equal(weights[25:31], part_weights)
    for a, b in zip(
        (*encounters.own, *recording_of(encounters)), (*part.own, *recording_of(part)), strict=True
    ):
        np.testing.assert_array_equal(a[25:31], b)
    of_other_seed, _ = encounters_with(traffic, 8, 25, 6)
    assert not np.array_equal(of_other_seed.own.speed, part.own.speed)


def test_every_encounter_meets_its_conditions(traffic: ModelTraffic) -> None:
    encounters, weights = encounters_with(traffic, 2, 0, 300)
    assert (weights > 0.0).all()
    recording = recording_of(encounters)
    assert off_arcs(recording, encounters.mask, 1.0).max() < 0.75
    start = np.hypot(
        recording.x[:, 0, 0] - encounters.own.x, recording.y[:, 0, 0] - encounters.own.y
    )
    assert start.min() >= 1_000.0
    # Without a resolver, on a fine grid: the closest approach is below the miss distance and inside the window.
    times = np.arange(0, 221)
    gap = np.hypot(
        recording.x[:, 0, :221]
        - (encounters.own.speed * np.cos(encounters.own.heading))[:, None] * times,
        recording.y[:, 0, :221]
        - (encounters.own.speed * np.sin(encounters.own.heading))[:, None] * times,
    )
    closest = gap.argmin(axis=1)
    assert (gap.min(axis=1) <= 1_000.0 + 150.0).all()
    assert (closest >= 29).all()
    assert (closest <= 181).all()
    # Rejecting what comes nearer elsewhere must not be usual, or the window would be distorted.
    assert stats.kstest((closest - 30.0) / 150.0, "uniform").statistic < 0.12


def recording_of(encounters: Any) -> Any:
    """Return the intruders' recording, which stands in the place of an intent."""
    return encounters.intent


def straight(speed_kt: float) -> EncounterModel:
    """Return a model of traffic that flies straight and level at one speed, nearly."""
    certain, zero = np.ones((1, 1)), np.array([-0.1, 0.1])
    names = ("v", r"\dot v", r"\dot \psi", LAYER)
    initial = tuple(Variable(name, 1, (), certain) for name in names)
    edges = (np.array([speed_kt, speed_kt + 1e-6]), zero, zero, np.array([1_000.0, 2_000.0]))
    moving = tuple(Variable(name, 1, (), certain) for name in names[1:3])
    return EncounterModel(initial, moving, (1, 2), edges, np.zeros(4))


def test_weights_make_the_traffic_even() -> None:
    """Against the definition: intruders thrown evenly over the plane, and kept where they meet the conditions."""
    knots, seed, size = 120.0, 11, 1_500
    traffic = family(straight(knots), own_speed=(60.0, 60.0), cpa_time=(60.0, 120.0))
    encounters, weights = encounters_with(traffic, seed, 0, size)
    relative = _relative_course(encounters.own.heading, encounters.intruders.heading[:, 0])

    rng = np.random.default_rng(seed)
    speed, count = knots * KNOT, 400_000
    x, y = rng.uniform(-17_000.0, 17_000.0, (2, count)) + np.array([[5_400.0], [0.0]])
    course = rng.uniform(-np.pi, np.pi, count)
    vx, vy = speed * np.cos(course) - 60.0, speed * np.sin(course)
    time = -(x * vx + y * vy) / (vx**2 + vy**2)
    miss = np.hypot(x + vx * time, y + vy * time)
    meets = (time >= 60.0) & (time <= 120.0) & (miss <= 1_000.0) & (np.hypot(x, y) >= 1_000.0)
    edges = np.linspace(0.0, np.pi, 7)
    expected = np.histogram(np.abs(course[meets]), edges)[0] / meets.sum()
    weighted = np.histogram(relative, edges, weights=weights)[0] / weights.sum()
    plain = np.histogram(relative, edges)[0] / size
    assert np.abs(weighted - expected).max() < 0.03
    # Without the weights it is another distribution: overtaken traffic would be met far too often.
    assert np.abs(plain - expected).max() > 0.06


def test_strata_come_as_often_as_asked_and_weights_undo_them() -> None:
    """Both distances are even by weight, where strata make near ones likelier than they are."""
    size, shares = 1_000, (0.3, 0.4)
    strata = Stratum(200.0, 30.0, shares[0]), Stratum(600.0, 30.0, shares[1])
    drawn_so = {"vertical_miss": 90.0, "min_initial_separation": 0.0, "strata": strata}
    traffic = family(straight(120.0), own_speed=(60.0, 60.0), **drawn_so)
    encounters, weights = encounters_with(traffic, 5, 0, size)
    later_part, _ = encounters_with(traffic, 5, 700, 3)
    map_leaves(np.testing.assert_array_equal, take(encounters, np.s_[700:703]), later_part)
    miss, above = closest_approach(encounters)
    inner = [(miss <= s.miss) & (above <= s.vertical_miss) for s in strata]
    outer = inner[1] & ~inner[0]
    for drawn, share in zip((inner[0], outer), shares, strict=True):
        assert drawn.mean() == pytest.approx(share, abs=5.0 * math.sqrt(0.25 / size))
    edges = [0, 200, 600, 1_000], [0, 30, 60, 90]
    cells, squares = (
        np.histogram2d(miss, above, edges, weights=part)[0] for part in (weights, weights**2)
    )
    even = np.outer([0.2, 0.4, 0.4], np.full(3, 1.0 / 3.0))
    assert (np.abs(cells - even * weights.sum()) < 4.0 * np.sqrt(squares)).all()
    # Without the weights they are far from it.
    assert inner[0].mean() > 3.0 * even[0, 0]


def closest_approach(encounters: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the horizontal and the vertical distance at the closest approach without a resolver,
    m, ``[N]``, from rows a second apart.
    """
    own, times = encounters.own, np.arange(200)
    x, y = (recording_of(encounters)[place][:, 0, :200] for place in (0, 1))
    x = x - (own.x[:, None] + (own.speed * np.cos(own.heading))[:, None] * times)
    y = y - (own.y[:, None] + (own.speed * np.sin(own.heading))[:, None] * times)
    near = np.hypot(x, y).argmin(axis=1)
    rows = np.arange(len(near))
    # On the chord through the row before and the row after.
    dx, dy = (np.gradient(field, axis=1)[rows, near] for field in (x, y))
    miss = np.abs(x[rows, near] * dy - y[rows, near] * dx) / np.hypot(dx, dy)
    above = encounters.altitudes.intruders[rows, 0, near] - encounters.altitudes.own
    return miss, np.abs(above)


def _relative_course(own: np.ndarray, heading: np.ndarray) -> np.ndarray:
    return np.abs(np.angle(np.exp(1j * (heading - own))))


def test_the_weight_is_the_area_that_the_closest_approach_sweeps(traffic: ModelTraffic) -> None:
    """By differences: shifting an intruder by a small vector moves time and miss of its closest approach."""
    encounters, weights = encounters_with(traffic, 3, 0, 14)
    recording = VehicleState(*(field[:, 0] for field in recording_of(encounters)))

    def approach(dx: float, dy: float) -> tuple[np.ndarray, np.ndarray]:
        times = np.linspace(25.0, 185.0, 40_001)
        moments, misses = [], []
        for i in range(14):
            row, speed = np.minimum(times.astype(int), DURATION - 1), encounters.own.speed[i]
            part, heading = times - row, encounters.own.heading[i]
            turn = np.angle(
                np.exp(1j * (recording.heading[i][row + 1] - recording.heading[i][row]))
            )
            mean = recording.heading[i][row] + 0.5 * turn * part
            gain = recording.speed[i][row + 1] - recording.speed[i][row]
            way = recording.speed[i][row] * part + 0.5 * gain * part**2
            way *= np.sinc(0.5 * turn * part / np.pi)
            x = recording.x[i][row] + way * np.cos(mean) + dx - speed * times * math.cos(heading)
            y = recording.y[i][row] + way * np.sin(mean) + dy - speed * times * math.sin(heading)
            k = int(np.argmin(np.hypot(x, y)))
            # A parabola through three points is finer than the grid.
            near = np.hypot(x[k - 1 : k + 2], y[k - 1 : k + 2]) ** 2
            shift = 0.5 * (near[0] - near[2]) / (near[0] - 2.0 * near[1] + near[2])
            moments.append(times[k] + shift * (times[1] - times[0]))
            side = (x[k + 1] - x[k - 1]) * y[k] - (y[k + 1] - y[k - 1]) * x[k]
            misses.append(math.copysign(math.hypot(x[k], y[k]), side))
        return np.array(moments), np.array(misses)

    h = 2.0
    east, north = [
        np.subtract(approach(*d), approach(-d[0], -d[1])) / (2 * h) for d in ((h, 0.0), (0.0, h))
    ]
    density = np.abs(east[0] * north[1] - north[0] * east[1])
    # Where a turn begins within the shift the rate jumps: most, not all.
    close = np.abs(1.0 / density / weights - 1.0) < 0.03
    assert close.mean() > 0.85


def test_a_recording_is_flown_row_by_row_and_straight_on_after_it(traffic: ModelTraffic) -> None:
    encounters, _ = encounters_with(traffic, 2, 0, 3)
    flying = intruder.start(encounters.intruders, np)
    for second in range(DURATION + 10):
        flying = intruder.step(flying, encounters.intent, second * 1.0, 1.0, np)
        if second + 1 <= DURATION:
            np.testing.assert_array_equal(
                flying.vehicle.x, recording_of(encounters).x[..., second + 1]
            )
    travelled = np.hypot(
        flying.vehicle.x - recording_of(encounters).x[..., -1],
        flying.vehicle.y - recording_of(encounters).y[..., -1],
    )
    np.testing.assert_allclose(travelled, 10.0 * recording_of(encounters).speed[..., -1])


def test_conditions_that_are_never_met_are_refused(traffic: ModelTraffic) -> None:
    with pytest.raises(
        EncounterError, match="encounter 4 of seed 0 does not meet the conditions in 3 attempts"
    ):
        encounters_with(replace(traffic, min_initial_separation=45_000.0, attempts=3), 0, 4, 1)
    with pytest.raises(EncounterError, match="seed is -1"):
        encounters_with(traffic, -1, 0, 1)
