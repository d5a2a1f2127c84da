"""What figures say has room in them, however few panels they have and however long a path is."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from agents.resolvability.classify import Verdict
from envs.aircraft import PAPER
from eval.boundary.figure import boundary_figure
from eval.boundary.slices import Answers, Slice
from eval.compare.summary import draw
from eval.hifi.figures import _title as hifi_title
from eval.plots.style import scenario_title
from eval.rare.tail import tail_figure
from eval.sensitivity.figure import draw_details, overview

PATH = "data/of/somebody/with/a/long/path/to/many/encounters/of/a/year/recorded.json"
SHARE = {"value": 0.9, "low": 0.8, "high": 0.95, "count": 9, "total": 10}


def assert_inside(figure: Figure) -> None:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    width, height = canvas.get_width_height()
    box = figure.get_tightbbox(canvas.get_renderer()).transformed(figure.dpi_scale_trans)
    assert box.x0 >= -1.0 and box.y0 >= -1.0
    assert box.x1 <= width + 1.0 and box.y1 <= height + 1.0


@pytest.mark.parametrize("count", [1, 2, 5])
def test_an_overview_shows_its_title_and_legend(count: int) -> None:
    values = [
        {
            "value": value,
            "encounters": 40,
            "unresolvable_rate": {"value": 0.0},
            "success": {"policy": {"success_given_resolvable": SHARE, "success_rate": SHARE}},
        }
        for value in (0.0, 30.0)
    ]
    sweep = {"name": "position_std", "label": "noise of positions", "unit": "m", "values": values}
    where = scenario_title(f"tracks:{PATH}")
    title = f"sweeps: 40 encounters a value, scenario {where}, mode policy\nbars: 95 % intervals"
    assert_inside(overview([sweep] * count, title))


def test_a_comparison_names_a_file_without_its_folder() -> None:
    entry = {
        "name": "policy",
        "kind": "policy",
        "success_rate": SHARE,
        "timeout_rate": SHARE,
        "violation_rate": SHARE,
        "difference": None,
        "path_excess_mean": SHARE,
    }
    summary: dict[str, Any] = {"entries": [entry], "encounters": 40, "seed": 0, "confidence": 0.95}
    figure = draw(summary | {"scenario": f"tracks:{PATH}"})
    assert "scenario tracks:recorded.json, seed 0" in figure.get_suptitle()
    assert_inside(figure)


def test_a_comparison_s_names_of_axes_and_marks_have_room() -> None:
    zero = {"value": 0.0, "low": 0.0, "high": 0.0, "count": 0, "total": 10}
    entry = {
        "kind": "policy",
        "success_rate": SHARE,
        "timeout_rate": SHARE,
        "violation_rate": SHARE,
        "difference": None,
        "path_excess_mean": zero,
    }
    names = ("a policy of some length, assured", "none")
    entries = [entry | {"name": name} for name in names]
    figure = draw(
        {"entries": entries, "encounters": 40, "seed": 0, "confidence": 0.95, "scenario": "circle"}
    )
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    labels = [axes.xaxis.label.get_window_extent(canvas.get_renderer()) for axes in figure.axes]
    for left, right in pairwise(labels):
        assert left.x1 < right.x0
    # The mark at 0 is as wide as any other.
    cost = figure.axes[2]
    radius = 0.5 * cost.lines[-1].get_markersize() * figure.dpi / 72.0
    assert cost.transData.transform((0.0, 0.0))[0] - cost.bbox.x0 >= radius


def test_no_mark_of_a_sensitivity_vanishes() -> None:
    def point(low: float, value: float, encounters: int) -> dict[str, Any]:
        rate = SHARE | {"value": value, "low": low, "high": 1.0}
        success = {"policy": {"success_given_resolvable": rate, "success_rate": rate}}
        row = {"encounters": encounters, "unresolvable_rate": {"value": 0.0}, "success": success}
        return row | {"low": 0.0, "high": 1.0, "baseline_violation_rate": {"count": 1}}

    bins = [point(0.97, 0.98, 500), point(0.1, 0.4, 5)]
    figure = draw_details({"label": "noise", "unit": "m", "bins": bins}, "title")
    above = figure.axes[0]
    floor = above.get_ylim()[0]
    triangles = [line for line in above.lines if line.get_marker() == "v"]
    assert floor > 40.0
    assert [line.get_ydata()[0] for line in triangles] == [floor, floor]  # type: ignore[index]
    assert [text.get_text() for text in above.texts] == ["40", "40"]
    assert_inside(figure)


@pytest.mark.slow
def test_a_map_of_one_slice_has_room_for_its_title_and_legend() -> None:
    ahead, aside = np.arange(-4e3, 6e3, 100.0), np.arange(-4e3, 4e3, 100.0)
    grid = 0.5 * np.hypot(ahead[:, None] - 1_500.0, aside)
    x, y = np.broadcast_to(ahead[:, None], grid.shape).ravel(), np.tile(aside, len(ahead))
    value = grid.ravel()
    verdict = np.where(value < 1e3, Verdict.UNRESOLVABLE, Verdict.RESOLVABLE)
    cut = Slice("slice 1", 60.0, 90.0, -0.8)
    every = np.ones(value.size, bool)
    answers = Answers(cut, x, y, every, value, value, verdict, value, ahead, aside, grid)
    summary = {"disagreements": {}, "course_difference_deg": -45.0, "points": 100, "undecided": 0}
    for count in (1, 2, 3):
        figure = boundary_figure([(answers, summary)] * count, PAPER)
        assert_inside(figure)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        legend = figure.legends[0].get_window_extent(canvas.get_renderer())
        assert all(legend.y1 < axes.xaxis.label.get_window_extent().y0 for axes in figure.axes)


def test_a_flight_s_title_fits_its_panel() -> None:
    table = {
        "outcome": np.array(["violation"], object),
        "min_separation_m": np.array([1234.0]),
        "wind_m_s": np.array([12.0]),
    }
    # Four panels in a row, 2.4 inches each: some 30 letters.
    assert max(map(len, hifi_title(table, 0).splitlines())) <= 26


def test_the_fit_of_the_tail_stays_in_its_frame() -> None:
    fit = {"threshold_m": 80.0, "rate": 1e-6, "shape": -0.5}
    fit |= {"quantiles_m": [1.0, 60.0], "fitted_quantiles_m": [1.0, 62.0]}
    assert_inside(tail_figure({"tail": [fit], "rate": {"low": 1e-7, "high": 4e-6}}))


@pytest.mark.parametrize("name", ["circle", "my_scenarios:trail"])
def test_a_name_that_is_no_path_stays(name: str) -> None:
    assert scenario_title(name) == name
