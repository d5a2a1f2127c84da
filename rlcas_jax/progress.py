"""How a training run goes, for a person: two live lines on a terminal, now and then a plain line elsewhere."""

import math
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, TextIO

__all__ = ["Reporter", "duration"]

_SILENCE_S = 10.0
"""Least time between two plain lines."""


class Reporter:
    """Shows steps, steps a second, score, success and the time left.

    On a terminal rich draws two lines that stay in their place; a file or a pipe gets plain text without any control
    sequences, at most a line every ten seconds besides the last one.
    """

    def __init__(
        self, *, quiet: bool = False, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Prepare; nothing is shown before :meth:`start`.

        Args:
            quiet: show nothing at all.
            stream: where to; standard error by default.
            clock: seconds from any origin.
        """
        self._stream = sys.stderr if stream is None else stream
        self._quiet = quiet
        self._clock = clock
        self._live: Any = None
        self._total = 0
        self._row: Mapping[str, float] | None = None
        self._evaluated: float | None = None
        self._shown = 0.0
        self._origin: tuple[float, float] | None = None

    def start(self, total_steps: int, step: int = 0) -> None:
        """Begin.

        Args:
            total_steps: of the whole run.
            step: steps that are already done, where the run is a resumed one.
        """
        self._total, self._shown = total_steps, self._clock()
        self._row = self._evaluated = self._origin = None
        if not self._quiet and self._stream.isatty():
            from rich.console import Console
            from rich.live import Live

            screen = _screen(step, total_steps, "compiling", "")
            self._live = Live(screen, console=Console(file=self._stream), auto_refresh=False)
            self._live.start()

    def update(self, row: Mapping[str, float]) -> None:
        """Take the figures of an update (names as in :data:`rlcas_jax.metrics.METRICS`)."""
        self._row = row
        self._evaluated = row.get("eval_success", self._evaluated)
        now = self._clock()
        # The first update contains the compilation, so the time left is reckoned from its end.
        self._origin = self._origin or (row["step"], now)
        if self._live is not None:
            screen = _screen(row["step"], self._total, self._left(now), ", ".join(self._figures()))
            self._live.update(screen, refresh=True)
        elif not self._quiet and now - self._shown >= _SILENCE_S:
            self._print(now)

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
        elif not self._quiet and self._row is not None:
            self._print(self._clock())
        self._row = None

    def _print(self, now: float) -> None:
        assert self._row is not None
        self._shown = now
        shown = [_steps(self._row["step"], self._total), *self._figures(), self._left(now)]
        print(", ".join(shown), file=self._stream, flush=True)

    def _figures(self) -> list[str]:
        row = self._row
        assert row is not None
        shown = [f"{row['steps_per_s']:,.0f} steps/s".replace(",", " ")]
        # Before the first episode ends there is no score.
        if not math.isnan(row["score"]):
            shown += [f"score {row['score']:+.1f}", f"success {100.0 * row['success']:.1f} %"]
        if self._evaluated is not None:
            shown.append(f"deterministic {100.0 * self._evaluated:.1f} %")
        return shown

    def _left(self, now: float) -> str:
        row, origin = self._row, self._origin
        assert row is not None and origin is not None
        done = row["step"] - origin[0]
        rate = done / (now - origin[1]) if done > 0 and now > origin[1] else row["steps_per_s"]
        return f"{duration((self._total - row['step']) / rate)} left"


def duration(seconds: float) -> str:
    """Return a time in words: ``45 s``, ``3 min 20 s``, ``2 h 5 min``."""
    if math.isnan(seconds):
        return "? s"
    whole = max(0, round(seconds))
    minutes, rest = divmod(whole, 60)
    hours, minutes_rest = divmod(minutes, 60)
    return f"{hours} h {minutes_rest} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


def _steps(done: float, total: int) -> str:
    return f"{int(done):,} of {total:,} steps".replace(",", " ")


def _screen(done: float, total: int, left: str, figures: str) -> Any:
    """Return what a terminal shows; it fits into 80 columns."""
    from rich.console import Group
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    line = Table.grid(padding=(0, 1))
    line.add_row(ProgressBar(total=total, completed=done, width=20), f"{done / total:.0%}", _steps(done, total), left)
    return Group(line, Text(figures, no_wrap=True, overflow="ellipsis"))
