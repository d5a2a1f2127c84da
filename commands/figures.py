"""Figures of matplotlib as files: PNG and SVG, each whole or not there, and the same again from the
same data.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from commands.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MINUS = re.compile(r"(?<![\w)\]])-(?=[\d.])")


def sign_alike(figure: "Figure") -> None:
    """Write the minus of numbers in titles, labels and legends as the ticks of an axis have it."""
    from matplotlib.text import Text
    from matplotlib.ticker import FuncFormatter

    def with_minus(text: str) -> str:
        return _MINUS.sub("\N{MINUS SIGN}", text)

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_text(with_minus(text.get_text()))
    for axes in figure.axes:  # ticks with texts of their own make these anew when they are drawn
        for axis in (axes.xaxis, axes.yaxis):
            made = axis.get_major_formatter()
            if isinstance(made, FuncFormatter):
                func = made.func
                made.func = lambda value, place, func=func: with_minus(func(value, place))


def save_figure(figure: "Figure", path: Path, dpi: int = 150) -> list[Path]:
    """Write a figure of matplotlib as ``path.png`` and ``path.svg`` and return their paths; may
    raise an OSError.

    The PNG, and what the SVG holds as pixels, have ``dpi`` of them an inch.
    """
    import matplotlib as mpl

    sign_alike(figure)
    files = [path.with_name(f"{path.name}.{kind}") for kind in ("png", "svg")]
    # Neither a date nor random names, so that the same run gives the same files.
    with mpl.rc_context({"svg.hashsalt": "rlcas"}):
        with write_whole(files[0]) as png:
            figure.savefig(png, format="png", dpi=dpi)
        # What has just been laid out stays: laying it out takes half of the time.
        figure.set_layout_engine("none")
        with write_whole(files[1]) as svg:
            figure.savefig(svg, format="svg", dpi=dpi, metadata={"Date": None})
    return files
