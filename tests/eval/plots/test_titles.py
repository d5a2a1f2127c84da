"""What figures say has room in them, however few panels they have and however long a path is."""

from typing import Any

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from eval.compare.summary import draw
from eval.plots.style import scenario_title
from eval.rare.tail import tail_figure
from eval.sensitivity.figure import overview

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
    one = {"name": "position_std", "label": "noise of positions", "unit": "m", "values": values}
    where = scenario_title(f"tracks:{PATH}")
    title = f"sweeps: 40 encounters a value, scenario {where}, mode policy\nbars: 95 % intervals"
    assert_inside(overview([one] * count, title))


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


def test_the_fit_of_the_tail_stays_in_its_frame() -> None:
    fit = {"threshold_m": 80.0, "rate": 1e-6, "shape": -0.5}
    fit |= {"quantiles_m": [1.0, 60.0], "fitted_quantiles_m": [1.0, 62.0]}
    assert_inside(tail_figure({"tail": [fit], "rate": {"low": 1e-7, "high": 4e-6}}))


@pytest.mark.parametrize("name", ["circle", "my_scenarios:trail"])
def test_a_name_that_is_no_path_stays(name: str) -> None:
    assert scenario_title(name) == name
