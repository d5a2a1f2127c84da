"""Progress of a training on the screen: steps, steps a second, score, success and the time left."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Self, TextIO

from commands.progress import Progress, group_digits


class Reporter(Progress):
    """Shows the figures of a training's updates, elsewhere than on a terminal every ten seconds."""

    def __init__(
        self,
        *,
        name: str = "",
        quiet: bool = False,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Prepare; arguments as of :class:`commands.progress.Progress`.

        Args:
            name: of the training among others, such as ``trial 3``; leads the figures.
        """
        super().__init__("steps", quiet=quiet, silence_s=10.0, stream=stream, clock=clock)
        self._name = name
        self._evaluated: float | None = None
        self._compiled = False

    def start(self, total: int, completed: float = 0, word: str = "") -> Self:
        """Begin; the word, such as ``compiling``, is shown at once."""
        super().start(total, completed, word)
        if word and self._live is None:
            self.note(word)
        return self

    def update(self, row: Mapping[str, float]) -> None:
        """Take the figures of an update (names as in :data:`rlcas_jax.metrics.METRICS`).

        The first one is not shown unless it is the last: compiling took most of its time.
        """
        self._evaluated = row.get("eval_success", self._evaluated)
        shown = [self._name] if self._name else []
        shown.append(f"{group_digits(round(row['steps_per_s']))} steps/s")
        # Before the first episode ends there is no score.
        if not math.isnan(row["score"]):
            shown += [f"score {row['score']:+.1f}", f"success {100.0 * row['success']:.1f} %"]
        if self._evaluated is not None:
            shown.append(f"deterministic {100.0 * self._evaluated:.1f} %")
        if self._compiled:
            self.show(row["step"], ", ".join(shown))
        else:
            self._compiled = True
            self.begin_measuring(row["step"], ", ".join(shown))
