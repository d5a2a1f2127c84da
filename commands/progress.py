"""Progress of a program: two live lines on a terminal, now and then a plain line elsewhere."""

import math
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Self, TextIO

if TYPE_CHECKING:
    from rich.console import Group
    from rich.live import Live


class Progress:
    """Shows what is done of a whole, some figures and the time left.

    On a terminal rich draws two lines that stay in their place; a file or a pipe gets plain text
    without any control sequences, at most a line every few seconds, and the last one.
    """

    def __init__(
        self,
        unit: str,
        *,
        quiet: bool = False,
        silence_s: float = 5.0,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare; nothing is shown before :meth:`start`.

        Args:
            unit: its name, plural.
            silence_s: least time between two plain lines, s.
        """
        self._unit, self._quiet, self._silence = unit, quiet, silence_s
        self._stream = sys.stderr if stream is None else stream
        self._clock = clock
        self._shown = clock()  # when the last plain line was shown, s
        self._total = 1
        self._live: Live | None = None
        self._origin: tuple[float, float] = (0.0, 0.0)  # what was done when the measuring began
        self._unsaid = ""

    def start(self, total: int, completed: float = 0, word: str = "") -> Self:
        """Begin a whole of so many units, some of them done where a run goes on, and measure the
        speed from here on.

        The word says what happens until the first figures come, such as ``compiling``.
        """
        self._total, self._shown = total, self._clock()
        self._origin = completed, self._shown
        if not self._quiet and self._stream.isatty():
            from rich.console import Console
            from rich.live import Live

            console = Console(file=self._stream)
            self._live = Live(
                self._screen(completed, word, ""), console=console, auto_refresh=False
            )
            self._live.start()
        return self

    def begin_measuring(self, completed: float, figures: str) -> None:
        """Begin to measure the speed anew: the time before, such as that of a compilation, says
        nothing of the time left. The figures are shown only where no others follow.
        """
        self._origin = completed, self._clock()
        self._unsaid = f"{self._completed(completed)}, {figures}"

    def leave_out(self, seconds: float) -> None:
        """Do not count some seconds since the measuring began, such as those of another
        compilation.
        """
        self._origin = self._origin[0], self._origin[1] + seconds

    def show(self, completed: float, figures: str) -> None:
        """Take how far it has come, with figures."""
        moment = self._clock()
        units, seconds = completed - self._origin[0], moment - self._origin[1]
        left = seconds / units * (self._total - completed) if min(units, seconds) > 0 else math.nan
        time_left = f"{duration(left)} left"
        if self._live is not None:
            self._live.update(self._screen(completed, time_left, figures), refresh=True)
        elif not self._quiet:
            self._unsaid = f"{self._completed(completed)}, {figures}, {time_left}"
            if moment - self._shown >= self._silence and completed < self._total:
                self.note(self._unsaid)
                self._shown, self._unsaid = moment, ""

    def note(self, text: str) -> None:
        """Say something between the figures."""
        if self._live is not None:
            self._live.console.print(text, markup=False, highlight=False)
        elif not self._quiet:
            print(text, file=self._stream, flush=True)

    def stop(self) -> None:
        """End; the last figures stay to be seen."""
        if self._live is not None:
            self._live.stop()
            self._live = None
        elif self._unsaid:
            self.note(self._unsaid)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self.stop()

    def _completed(self, completed: float) -> str:
        return f"{group_digits(int(completed))} of {group_digits(self._total)} {self._unit}"

    def _screen(self, completed: float, time_left: str, figures: str) -> "Group":
        """Return what a terminal shows; it fits into 80 columns."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        line = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=self._total, completed=completed, width=20)
        line.add_row(bar, f"{completed / self._total:.0%}", self._completed(completed), time_left)
        return Group(line, Text(figures, no_wrap=True, overflow="ellipsis"))


def duration(seconds: float) -> str:
    """Return a time in words: ``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    if math.isnan(seconds):
        return "? s"
    whole = max(0, round(seconds))
    hours, minutes, left_s = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes} min"
    if minutes:
        return f"{minutes} min {left_s} s"
    return f"{left_s} s"


def group_digits(value: int) -> str:
    """Return a whole number with a space between its thousands."""
    return f"{value:,}".replace(",", " ")
