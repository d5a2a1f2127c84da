"""Figures are written whole or not at all, and the same again from the same data."""

import subprocess
import sys
from pathlib import Path

from matplotlib.figure import Figure

from agents.config.figures import save_figure

ROOT = Path(__file__).resolve().parents[2]


def drawn() -> Figure:
    figure = Figure(figsize=(3.0, 2.0), layout="constrained")
    figure.subplots().plot(range(2_000), [i % 7 for i in range(2_000)], "o")  # many marks: a large SVG
    return figure


def test_the_same_data_give_the_same_bytes(tmp_path: Path):
    first, second = (save_figure(drawn(), tmp_path / name) for name in ("a.b", "c"))
    assert [path.name for path in first] == ["a.b.png", "a.b.svg"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_a_full_disk_is_one_sentence_and_leaves_no_half_figure(tmp_path: Path):
    """A limit on the size of files stands for the disk: the PNG fits, the SVG does not."""
    program = f"""
import resource
from pathlib import Path
from agents.config.figures import save_figure
from envs.edge.command import run_cli
from tests.agents.test_figure_files import drawn

def main():
    figure, size = drawn(), len(Path({str(tmp_path / "whole.png")!r}).read_bytes())
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 100, size + 100))
    save_figure(figure, Path({str(tmp_path / "half")!r}))

run_cli(main)
"""
    whole = save_figure(drawn(), tmp_path / "whole")
    assert whole[1].stat().st_size > whole[0].stat().st_size + 100
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == (1, f"error: {tmp_path / 'half.svg'}: File too large\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["half.png", "whole.png", "whole.svg"]
