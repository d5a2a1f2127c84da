"""The figures show what the table says, and are written whole or not at all."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from agents.policy.inference import Policy
from commands.figures import draw_altitudes, save_figure
from envs.aircraft import PAPER
from envs.outcome import RULES
from envs.profile import climbing
from envs.scenarios import scenario
from eval.flights.chunks import Evaluation, ReadyEvaluation, columns
from eval.flights.recorded import Track, fly_recorded
from eval.flights.simulate import OUTCOMES
from eval.plots.encounters import draw_all, initial_conditions, separation_histogram
from eval.plots.flight_sheet import PANELS, Panel, choose_encounters, draw, trajectory_sheet
from eval.plots.style import MARKERS, kinds_of
from tests.eval.plots.test_titles import assert_inside


def table_of(counts: dict[str, int]) -> dict[str, np.ndarray]:
    """Return a table with so many encounters of each kind."""
    kinds = np.random.default_rng(0).permutation(np.repeat(list(counts), list(counts.values())))
    words = {"success": "reached", "time-out": "timeout", "geofence violation": "breach"}
    outcome = np.array([words.get(kind, "violation") for kind in kinds], dtype=object)
    n = len(kinds)
    return {
        "encounter": np.arange(n),
        "outcome": outcome,
        "verdict": np.where(kinds == "proven unresolvable", "unresolvable", "undecided").astype(
            object
        ),
        "distance_m": np.linspace(1_000.0, 20_000.0, n),
        "bearing_deg": np.linspace(-180.0, 179.0, n),
        "relative_heading_deg": np.linspace(-180.0, 179.0, n),
        "min_separation_m": np.linspace(900.0, 5_000.0, n),
        "baseline_min_separation_m": np.linspace(800.0, 1_500.0, n),
    }


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        ({"success": 100}, {"success": 12}),
        ({"success": 3}, {"success": 3}),
        ({"loss of separation": 100}, {"loss of separation": 12}),
        ({"success": 100, "loss of separation": 2}, {"loss of separation": 2, "success": 10}),
        ({"success": 100, "loss of separation": 50}, {"loss of separation": 8, "success": 4}),
        ({"success": 1, "loss of separation": 50}, {"loss of separation": 11, "success": 1}),
        (
            {"success": 99, "loss of separation": 50, "time-out": 25, "proven unresolvable": 25},
            {"loss of separation": 4, "time-out": 2, "proven unresolvable": 2, "success": 4},
        ),
        # Those that nobody could resolve end after seconds: one or two tell what they are.
        (
            {"success": 99, "loss of separation": 2, "proven unresolvable": 9},
            {"loss of separation": 2, "proven unresolvable": 2, "success": 8},
        ),
        (
            {"success": 1, "loss of separation": 2, "proven unresolvable": 5},
            {"loss of separation": 2, "proven unresolvable": 5, "success": 1},
        ),
    ],
)
def test_sheet_shows_failures_first(counts: dict[str, int], expected: dict[str, int]) -> None:
    table = table_of(counts)
    numbers = choose_encounters(table)
    assert len(set(numbers)) == len(numbers) == min(PANELS, len(table["encounter"]))
    kinds = kinds_of(table)[numbers].tolist()
    assert kinds == [kind for kind, count in expected.items() for _ in range(count)]


@pytest.mark.parametrize(
    "kinds", [("success",), ("loss of separation",), ("success", "loss of separation", "time-out")]
)
def test_every_kind_is_in_the_legend_with_its_number(kinds: tuple[str, ...]) -> None:
    figure = initial_conditions(table_of({kind: 1_200 + i for i, kind in enumerate(kinds)}))
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert texts == {f"{kind} (1 20{i})" for i, kind in enumerate(kinds)}


def test_a_legend_that_counts_less_than_the_table_says_so() -> None:
    figure = initial_conditions(table_of({"loss of separation": 2, "proven unresolvable": 9}))
    texts = {text.get_text() for text in figure.legends[0].get_texts()}
    assert texts == {"loss of separation that could be resolved (2)", "proven unresolvable (9)"}


def test_a_legend_of_every_kind_has_room() -> None:
    assert_inside(initial_conditions(table_of(dict.fromkeys(MARKERS, 1_200))))


@pytest.mark.slow
def test_a_sheet_of_one_flight_is_one_panel_wide() -> None:
    steps = np.arange(11.0)
    own, intruders = np.stack([100.0 * steps, np.zeros(11)]), np.full((1, 2, 11), 2_000.0)
    panel = Panel("0: success", Track(own, intruders, np.full(10, 1_500.0), (1e3, 0.0)))
    for count, wide in ((1, 1), (3, 3), (9, 4)):
        flights = SimpleNamespace(track=lambda _: panel.track)
        figure = trajectory_sheet(table_of_flights(count), range(count), flights, RULES)  # type: ignore[arg-type]
        columns = {
            round(axes.get_subplotspec().get_topmost_subplotspec().colspan.start)
            for axes in figure.axes
        }  # type: ignore[union-attr]
        assert len(columns) == wide
        assert_inside(figure)


def table_of_flights(count: int) -> dict[str, np.ndarray]:
    return table_of({"success": count}) | {"duration_s": np.full(count, 90.0)}


def test_a_minus_is_one_sign(tmp_path: Path) -> None:
    figure = Figure(figsize=(3.0, 2.0))
    axes = figure.subplots()
    axes.set(title="own -0.5 m/s, 1-2 and [-3, 4], a-5", xlim=(-2.0, 2.0))
    axes.set_xticks([-1.0, 1.0], ["-1", "1"])
    save_figure(figure, tmp_path / "signs")
    assert axes.get_title() == "own \u22120.5 m/s, 1-2 and [\u22123, 4], a-5"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["\u22121", "1"]


def test_altitudes_are_drawn_about_the_own_ones(tmp_path: Path) -> None:
    time = np.arange(0.0, 120.0)
    profile = climbing(
        2_000.0, 0.0, [40.0, 80.0, 120.0], [2_150.0, 2_150.0, 2_000.0], acceleration=0.5
    )
    planned = profile.at(time)
    intruder_altitudes = np.stack([np.full(time.size, 2_010.0), 5_000.0 - 20.0 * time])
    intruder_altitudes[0, :30] = np.nan
    figure = Figure(figsize=(6.0, 2.5), layout="constrained")
    axes = figure.subplots()
    draw_altitudes(axes, time, planned + 3.0, intruder_altitudes, planned)
    save_figure(figure, tmp_path / "altitudes")
    lines = [np.asarray(line.get_ydata(), dtype=float) for line in axes.get_lines()]
    assert [len(line) for line in lines] == [time.size] * 4
    low, high = axes.get_ylim()
    assert 1_940.0 < low < 2_000.0
    assert 2_153.0 < high < 2_220.0
    flat = Figure().subplots()
    draw_altitudes(flat, time, np.full(time.size, 2_000.0))
    assert flat.get_ylim() == (1_950.0, 2_050.0)


def test_histogram_counts_every_flight_and_splits_at_the_requirement() -> None:
    table = table_of({"success": 500, "loss of separation": 20})
    axes = separation_histogram(table, 1_000.0).axes[0]
    bars = [patch for patch in axes.patches if hasattr(patch, "get_width")]
    assert sum(bar.get_height() for bar in bars) == 520
    below = sum(bar.get_height() for bar in bars if bar.get_x() + bar.get_width() <= 1.0 + 1e-9)
    assert below == (table["min_separation_m"] < 1_000.0).sum()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["multi", "noisy"])
def test_the_sheet_flies_what_the_table_says(name: str, policy: Policy, policy_path: Path) -> None:
    evaluation = Evaluation(policy_path, scenario(name, PAPER), None, 3, PAPER)
    pilot = ReadyEvaluation(evaluation, policy)
    table = columns(pilot, 0, 40)
    numbers = [39, 4, 17]
    flown = fly_recorded(pilot, numbers)
    paths = flown.trajectories
    assert len(flown.starts.goal_x) == 3
    for i, number in enumerate(numbers):
        steps = int(table["duration_s"][number])
        assert np.isfinite(paths.own.x[: steps + 1, i]).all()
        assert not np.isfinite(paths.own.x[steps + 1 :, i]).any()
        assert np.nanmin(paths.separation[:, i]) == table["min_separation_m"][number]
        assert table["outcome"][number] in OUTCOMES


def test_the_ring_is_what_is_required_of_the_intruder_that_is_nearest_in_it() -> None:
    steps = np.arange(11.0)
    own = np.stack([100.0 * steps, np.zeros(11)])
    beside = np.stack([100.0 * steps, np.full(11, 1_500.0)])
    heavy = np.stack([100.0 * steps, np.full(11, -2_500.0)])
    track = Track(own, np.stack([beside, heavy]), np.full(10, 1_500.0), (1e3, 0.0))
    for required, radius in ((None, 1.0), (np.array([500.0, 3_000.0]), 3.0)):
        figure = Figure()
        draw(figure.add_subplot(), track._replace(required=required), RULES)
        rings = [patch for patch in figure.axes[0].patches if not patch.get_fill()]
        assert [ring.get_radius() for ring in rings] == [radius]


@pytest.mark.slow
def test_figures_repeat_byte_for_byte(tmp_path: Path, policy: Policy, policy_path: Path) -> None:
    evaluation = Evaluation(policy_path, scenario("circle", PAPER), None, 3, PAPER)
    table = columns(ReadyEvaluation(evaluation, policy), 0, 4)
    paths = draw_all(tmp_path, table, evaluation)
    assert len(paths) == 6
    again = save_figure(separation_histogram(table, RULES.separation), tmp_path / "again")
    for path in again:
        assert path.read_bytes() == (tmp_path / f"min_separation{path.suffix}").read_bytes()


def test_kinds_put_the_proof_before_the_outcome() -> None:
    table = SimpleNamespace(
        outcome=np.array(["violation", "timeout"]), verdict=np.array(["unresolvable", "undecided"])
    )
    assert kinds_of(vars(table)).tolist() == ["proven unresolvable", "time-out"]


# Figures are written whole or not at all, and the same again from the same data.

ROOT = Path(__file__).resolve().parents[3]


def draw_figure() -> Figure:
    figure = Figure(figsize=(3.0, 2.0), layout="constrained")
    figure.subplots().plot(
        range(2_000), [i % 7 for i in range(2_000)], "o"
    )  # many marks: a large SVG
    return figure


def test_the_same_data_give_the_same_bytes(tmp_path: Path):
    first, second = (save_figure(draw_figure(), tmp_path / name) for name in ("a.b", "c"))
    assert [path.name for path in first] == ["a.b.png", "a.b.svg"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


@pytest.mark.slow
def test_a_full_disk_is_one_sentence_and_leaves_no_half_figure(tmp_path: Path):
    """A limit on the size of files stands for the disk: the PNG fits, the SVG does not."""
    program = f"""
import resource
from pathlib import Path
from commands.figures import save_figure
from commands.command import run_cli
from tests.eval.plots.test_figures import draw_figure

def main():
    figure, size = draw_figure(), len(Path({str(tmp_path / "whole.png")!r}).read_bytes())
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 100, size + 100))
    save_figure(figure, Path({str(tmp_path / "half")!r}))

run_cli(main)
"""
    paths = save_figure(draw_figure(), tmp_path / "whole")
    assert paths[1].stat().st_size > paths[0].stat().st_size + 100
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stderr) == (
        1,
        f"error: {tmp_path / 'half.svg'}: File too large\n",
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "half.png",
        "whole.png",
        "whole.svg",
    ]
