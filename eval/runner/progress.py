"""How far an evaluation has come: a bar on a terminal, plain lines elsewhere; both on standard error."""

import sys
import time
from types import TracebackType
from typing import Any, Self

__all__ = ["Progress"]

_SILENCE_S = 5.0
"""Least time between two plain lines."""


class Progress:
    """A context in which finished encounters are counted."""

    def __init__(self, total: int, before: int) -> None:
        """Prepare.

        Args:
            total: encounters of the run.
            before: how many of them were stored already.
        """
        self._total, self._done, self._flown, self._reached = total, before, 0, 0
        self._begun = self._shown = time.perf_counter()
        self._bar: Any = None

    def __enter__(self) -> Self:
        if self._done:
            self.note(f"{_n(self._done)} of {_n(self._total)} encounters are stored already")
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (
                BarColumn(bar_width=30),
                TextColumn("{task.completed:,.0f}/{task.total:,.0f} encounters"),
                TextColumn("{task.fields[figures]}"),
                TimeRemainingColumn(),
            )
            self._bar = Bar(*columns, console=Console(stderr=True))
            self._bar.add_task("flying", total=self._total, completed=self._done, figures="")
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        elif self._flown:
            self._print()

    def advance(self, flown: int, reached: int) -> None:
        """Count encounters that were flown now, and how many of them reached their goal."""
        self._done, self._flown, self._reached = self._done + flown, self._flown + flown, self._reached + reached
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=self._done, figures=self._figures())
        elif time.perf_counter() - self._shown >= _SILENCE_S and self._done < self._total:
            self._print()

    def note(self, text: str) -> None:
        """Say something between the figures."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=sys.stderr, flush=True)

    def _print(self) -> None:
        self._shown = time.perf_counter()
        print(f"{_n(self._done)} of {_n(self._total)} encounters, {self._figures()}", file=sys.stderr, flush=True)

    def _figures(self) -> str:
        rate = self._flown / max(time.perf_counter() - self._begun, 1e-9)
        return f"{_n(round(rate))} encounters/s, success {100.0 * self._reached / self._flown:.1f} %"


def _n(value: int) -> str:
    return f"{value:,}".replace(",", " ")
