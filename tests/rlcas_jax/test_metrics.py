import json
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from rlcas_jax.metrics import FILE, METRICS, WALL_CLOCK, Writer, read


def row(update: int, **more: float) -> dict[str, float]:
    return {"step": 128.0 * update, "update": update, "score": -1.0 / update, "wall_s": 0.1 * update, **more}


def test_what_is_written_is_read_as_columns(tmp_path: Path):
    with Writer(tmp_path, tensorboard=False) as writer:
        writer.write(row(1, score=math.nan))
        writer.write(row(2, eval_success=0.5, loss=np.float32(0.1), entropy=jnp.float32(1.5), episodes=np.int64(3)))
    log = read(tmp_path)
    np.testing.assert_array_equal(log["update"], [1.0, 2.0])
    np.testing.assert_array_equal(log["score"], [math.nan, -0.5])
    np.testing.assert_array_equal(log["eval_success"], [math.nan, 0.5])
    np.testing.assert_array_equal(log["loss"], [math.nan, 0.1])
    assert all(values.dtype == np.float64 for values in log.values())
    first, second = (tmp_path / FILE).read_text().splitlines()
    assert first == '{"step": 128, "update": 1, "score": null, "wall_s": 0.1}'
    assert json.loads(second)["episodes"] == 3


@pytest.mark.parametrize("value", [0.1, 1e300, 1e-300, -2.5e-8, 123456.789])
def test_numbers_keep_their_precision(tmp_path: Path, value: float):
    with Writer(tmp_path, tensorboard=False) as writer:
        writer.write(row(1, loss=value))
        writer.write(row(2, loss=float(np.float32(value)) if value < 1e30 else value))
    doubled, single = read(tmp_path)["loss"]
    assert doubled == value
    assert np.float32(single) == np.float32(value) if value < 1e30 else single == value


def test_lines_are_there_at_once(tmp_path: Path):
    with Writer(tmp_path, tensorboard=False) as writer:
        writer.write(row(1))
        assert len(read(tmp_path)["step"]) == 1


def test_a_half_written_line_is_left_out(tmp_path: Path):
    path = tmp_path / FILE
    path.write_text('{"step": 1, "update": 1}\n{"step": 2, "upd')
    assert read(path)["step"].tolist() == [1.0]


def test_nothing_logged_reads_as_nothing(tmp_path: Path):
    assert read(tmp_path) == {}


@pytest.mark.parametrize("torn", ["", '{"step": 640, "upd'])
def test_a_resumed_run_leaves_the_file_of_an_uninterrupted_one(tmp_path: Path, torn: str):
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    whole.mkdir()
    parts.mkdir()
    with Writer(whole, tensorboard=False) as writer:
        for update in range(1, 7):
            writer.write(row(update))
    with Writer(parts, tensorboard=False) as writer:
        for update in range(1, 5):
            writer.write(row(update))
    with (parts / FILE).open("a") as file:
        file.write(torn)
    with Writer(parts, resume_update=3, tensorboard=False) as writer:
        for update in range(4, 7):
            writer.write(row(update))
    assert (parts / FILE).read_bytes() == (whole / FILE).read_bytes()


def test_a_new_run_begins_a_new_file(tmp_path: Path):
    for _ in range(2):
        with Writer(tmp_path, tensorboard=False) as writer:
            writer.write(row(1))
    assert len(read(tmp_path)["step"]) == 1


def test_a_metric_without_a_description_is_refused(tmp_path: Path):
    with Writer(tmp_path, tensorboard=False) as writer, pytest.raises(KeyError, match="metric 'magic' has no desc"):
        writer.write(row(1, magic=1.0))


def test_metrics_of_wall_clock_are_metrics():
    assert set(WALL_CLOCK) <= set(METRICS)


def test_tensorboard_gets_the_same_figures(tmp_path: Path):
    pytest.importorskip("tensorboardX")
    with Writer(tmp_path) as writer:
        writer.write(row(1, loss=0.5))
    with Writer(tmp_path, resume_update=1) as writer:
        writer.write(row(2, loss=math.nan))
    files = sorted((tmp_path / "tensorboard").iterdir())
    assert b"score" in b"".join(file.read_bytes() for file in files)
    assert len(read(tmp_path)["step"]) == 2


def test_without_tensorboard_nothing_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("rlcas_jax.metrics.find_spec", lambda name: None)
    with Writer(tmp_path) as writer:
        writer.write(row(1))
    assert [path.name for path in tmp_path.iterdir()] == [FILE]
