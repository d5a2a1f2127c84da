import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from agents.config.load import ConfigError
from rlcas_jax.figures import FIGURES, main, stretches, training_figures
from rlcas_jax.metrics import METRICS, Writer

ROOT = Path(__file__).resolve().parents[2]
NAMES = {f"{name}.{kind}" for name in [*FIGURES, "training"] for kind in ("png", "svg")}


def log(directory: Path, seed: int = 0, updates: int = 20) -> Path:
    directory.mkdir()
    random = np.random.default_rng(seed)
    with Writer(directory, tensorboard=False) as writer:
        for update in range(1, updates + 1):
            learned = 1.0 - np.exp(-update / 5.0)
            row = {
                "step": 131_072 * update,
                "update": update,
                "episodes": 0 if update == 1 else 300 + update,
                # No episode has ended yet in the first update.
                "score": np.nan if update == 1 else -60.0 + 140.0 * learned + random.normal(),
                "success": np.nan if update == 1 else 0.2 + 0.7 * learned,
                "loss": 0.1 - 0.09 * learned,
                "entropy": 1.8 - 0.1 * update,
                "neg_log_prob": 1.8 - 0.1 * update,
            }
            writer.write(row | ({"eval_success": 0.95 * learned} if update % 8 == 0 else {}))
    return directory


@pytest.mark.slow
def test_every_figure_is_drawn_and_the_same_metrics_give_the_same_picture(tmp_path: Path):
    run = log(tmp_path / "run")
    one, other = (training_figures([run], tmp_path / name) for name in ("one", "other"))
    assert {file.name for file in one} == NAMES
    assert {file.name for file in (tmp_path / "one").iterdir()} == NAMES
    for file in one:
        assert file.read_bytes().startswith(b"\x89PNG" if file.suffix == ".png" else b"<?xml")
    assert [file.read_bytes() for file in one] == [file.read_bytes() for file in other]


def test_seeds_of_different_length_go_into_one_figure(tmp_path: Path):
    runs = [log(tmp_path / str(seed), seed, updates) for seed, updates in enumerate((20, 12, 1))]
    assert len(training_figures([*runs, tmp_path / "not-begun"], tmp_path / "figures")) == len(NAMES)


def test_a_short_run_can_be_drawn(tmp_path: Path):
    training_figures([log(tmp_path / "run", updates=1)], tmp_path / "figures")


def test_the_command_draws_finished_runs_again(tmp_path: Path):
    main([str(log(tmp_path / "run")), "--out", str(tmp_path / "figures")])
    assert {file.name for file in (tmp_path / "figures").iterdir()} == NAMES
    with pytest.raises(ConfigError, match="absent: there is no such folder"):
        main([str(tmp_path / "absent"), "--out", str(tmp_path / "figures")])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="no metrics to draw"):
        main([str(tmp_path / "empty"), "--out", str(tmp_path / "figures")])


@pytest.mark.parametrize("count", [1, 399, 400, 401, 12_207])
def test_a_long_curve_is_drawn_by_means_that_keep_its_own(count: int):
    random = np.random.default_rng(count)
    steps, values, weights = np.arange(1.0, count + 1), random.normal(size=count), random.integers(1, 90, count)
    ends, means = stretches(steps, values, weights)
    assert len(ends) == len(means) <= 400
    assert ends[-1] == count
    shares = np.diff(np.concatenate([[0.0], np.cumsum(weights)[ends.astype(int) - 1]]))
    assert np.average(means, weights=shares) == pytest.approx(np.average(values, weights=weights))
    if count <= 400:
        np.testing.assert_array_equal(means, values)


def test_without_metrics_there_is_nothing_to_draw(tmp_path: Path):
    with pytest.raises(ValueError, match="no metrics to draw in"):
        training_figures([tmp_path], tmp_path / "figures")


def test_what_is_drawn_is_logged():
    assert {panel.metric for panel in FIGURES.values()} <= set(METRICS)


def test_matplotlib_is_loaded_only_to_draw():
    program = "import sys, rlcas_jax.figures; assert 'matplotlib' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0
