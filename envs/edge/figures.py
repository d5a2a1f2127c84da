"""Figures of matplotlib as files: PNG and SVG, each whole or not there, and the same again from the
same data.
"""

from pathlib import Path
from typing import Any

from envs.edge.files import write_whole


def save_figure(figure: Any, path: Path, dpi: int = 150) -> list[Path]:
    """Write a figure of matplotlib as ``path.png`` and ``path.svg`` and return their paths; may
    raise an OSError.

    The PNG, and what the SVG holds as pixels, have ``dpi`` of them an inch.
    """
    import matplotlib as mpl

    files = [path.with_name(f"{path.name}.{kind}") for kind in ("png", "svg")]
    # Neither a date nor random names, so that the same run gives the same files.
    with mpl.rc_context({"svg.hashsalt": "rlcas"}):
        with write_whole(files[0]) as png:
            figure.savefig(png, format="png", dpi=dpi)
        figure.set_layout_engine(
            "none"
        )  # keep what has just been laid out: it takes half of the time
        with write_whole(files[1]) as svg:
            figure.savefig(svg, format="svg", dpi=dpi, metadata={"Date": None})
    return files
