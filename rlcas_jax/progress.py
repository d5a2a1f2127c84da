"""Progress of a training on the screen: steps, steps a second, score, success and the time left."""

import math
import time
from collections.abc import Callable, Mapping
from typing import TextIO

from agents.config.progress import Progress, spaced

_SILENCE_S = 10.0  # least time between two plain lines


class Reporter:
    """Shows the figures of a training's updates."""

    def __init__(
        self, *, quiet: bool = False, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Prepare what :class:`agents.config.progress.Progress` shows from :meth:`start` on; arguments as there."""
        self._quiet, self._stream, self._clock = quiet, stream, clock
        self._progress = self._prepared(1)
        self._evaluated: float | None = None

    def start(self, total_steps: int, step: int = 0) -> None:
        """Begin a run of so many steps, some of which are done already where it is a resumed one."""
        self._evaluated = None
        self._progress = self._prepared(total_steps).start(step, "compiling")

    def update(self, row: Mapping[str, float]) -> None:
        """Take the figures of an update (names as in :data:`rlcas_jax.metrics.METRICS`)."""
        if self._quiet:
            return
        self._evaluated = row.get("eval_success", self._evaluated)
        shown = [f"{spaced(round(row['steps_per_s']))} steps/s"]
        # Before the first episode ends there is no score.
        if not math.isnan(row["score"]):
            shown += [f"score {row['score']:+.1f}", f"success {100.0 * row['success']:.1f} %"]
        if self._evaluated is not None:
            shown.append(f"deterministic {100.0 * self._evaluated:.1f} %")
        self._progress.show(row["step"], ", ".join(shown), row["steps_per_s"])

    def note(self, text: str) -> None:
        """Say something between the figures."""
        self._progress.note(text)

    def stop(self) -> None:
        """End; the last figures stay to be seen."""
        self._progress.stop()

    def _prepared(self, total: int) -> Progress:
        return Progress(total, "steps", quiet=self._quiet, silence_s=_SILENCE_S, stream=self._stream, clock=self._clock)
