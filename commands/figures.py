"""Figures of matplotlib as files: PNG and SVG, each whole or not there, and the same again from the
same data.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from commands.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


OWN_COLOUR, INTRUDER_COLOUR, AREA_COLOUR = "#0072B2", "#D55E00", "#CC79A7"
_ROOM = 0.3, 50.0  # above and below the own altitudes: a share of their range, m at least
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
            formatter = axis.get_major_formatter()
            if isinstance(formatter, FuncFormatter):
                func = formatter.func
                formatter.func = lambda value, place, func=func: with_minus(func(value, place))


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


def draw_altitudes(
    axes: "Axes",
    time: "ArrayLike",
    own: "ArrayLike",
    others: "ArrayLike" = (),
    planned: "ArrayLike | None" = None,
) -> None:
    """Draw altitudes over time, as they stand below a map: the ownship's, solid, those of
    intruders, dashed, and those of the plan, dotted.

    Args:
        axes: of matplotlib.
        time: s, ``[T]``.
        own: the ownship's altitudes, m, ``[T]``.
        others: those of the intruders, m, ``[K, T]``; nan where they do not count. The own ones
            decide which altitudes are shown: intruders may come from far above.
        planned: those of the plan, m, ``[T]``; None: there is none.
    """
    time, own, others = (np.asarray(values, dtype=float) for values in (time, own, others))
    for altitudes in others:
        axes.plot(time, altitudes, color=INTRUDER_COLOUR, linewidth=1.2, linestyle="--")
    shown = own
    if planned is not None:
        shown = np.concatenate([own, np.asarray(planned, dtype=float)])
        axes.plot(time, planned, color="black", linewidth=0.8, linestyle=":")
    axes.plot(time, own, color=OWN_COLOUR, linewidth=1.5)
    lowest, highest = np.nanmin(shown), np.nanmax(shown)
    share, least = _ROOM
    room = max(share * (highest - lowest), least)
    axes.set_ylim(lowest - room, highest + room)
    axes.set_xlabel("time, s")
    axes.set_ylabel("altitude, m")
    axes.grid(color="#EBEBEB", linewidth=0.5)
    axes.set_axisbelow(True)
