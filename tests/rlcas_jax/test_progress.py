import io
import math

import pytest

from agents.config.progress import duration
from rlcas_jax.progress import Reporter


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def row(step: int, score: float = 12.34, **more: float) -> dict[str, float]:
    return {"step": step, "steps_per_s": 31_234.5, "score": score, "success": 0.6123, **more}


def run(stream: io.StringIO, quiet: bool = False) -> str:
    clock = Clock()
    reporter = Reporter(quiet=quiet, stream=stream, clock=clock)
    reporter.start(total_steps=10_000)
    for second in range(1, 26):
        clock.now += 1.0
        reporter.update(row(200 * second, **({"eval_success": 0.95} if second == 12 else {})))
    reporter.note("stopped")
    reporter.stop()
    return stream.getvalue()


def test_elsewhere_there_is_a_plain_line_every_ten_seconds_and_a_last_one():
    assert run(io.StringIO()).splitlines() == [
        "2 000 of 10 000 steps, 31 234 steps/s, score +12.3, success 61.2 %, 40 s left",
        "4 000 of 10 000 steps, 31 234 steps/s, score +12.3, success 61.2 %, deterministic 95.0 %, 30 s left",
        "stopped",
        "5 000 of 10 000 steps, 31 234 steps/s, score +12.3, success 61.2 %, deterministic 95.0 %, 25 s left",
    ]


def test_on_a_terminal_two_live_lines_fit_into_80_columns(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    shown = run(Terminal())
    assert "\x1b[" in shown
    assert "50% 5 000 of 10 000 steps 25 s left" in shown
    assert "31 234 steps/s, score +12.3, success 61.2 %, deterministic 95.0 %" in shown
    assert "stopped" in shown
    assert shown.rstrip().endswith("\x1b[?25h"), "the cursor is shown again"


@pytest.mark.parametrize("stream", [io.StringIO(), Terminal()])
def test_quiet_is_silent(stream: io.StringIO):
    assert run(stream, quiet=True) == ""


def test_before_the_first_episode_ends_there_is_no_score():
    stream = io.StringIO()
    reporter = Reporter(stream=stream, clock=Clock())
    reporter.start(total_steps=100_000, step=50_000)
    reporter.update(row(60_000, score=math.nan))
    reporter.stop()
    assert stream.getvalue() == "60 000 of 100 000 steps, 31 234 steps/s, 1 s left\n"


def test_a_run_that_does_nothing_shows_nothing():
    stream = io.StringIO()
    reporter = Reporter(stream=stream)
    reporter.start(total_steps=10, step=10)
    reporter.stop()
    assert stream.getvalue() == ""


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.6, "1 min 0 s"), (200, "3 min 20 s"), (7500, "2 h 5 min"), (math.nan, "? s")],
)
def test_durations_in_words(seconds: float, text: str):
    assert duration(seconds) == text
