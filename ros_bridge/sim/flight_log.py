"""The log of simulated encounters: a row each, and a table of all."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

NEVER_ASKED = "no alert"
"""The first answer where no plan was requested."""

_HEAD = (
    "encounter",
    "first answer",
    "source",
    "closest, m",
    "at, s",
    "error, m",
    "answers",
    "re-plans",
    "backup, s",
    "answer med/max, ms",
    "flown, s",
    "wall, s",
)


@dataclass
class FlightLog:
    """The record of one encounter."""

    name: str
    required: float
    """Separation that a plan called SAFE must keep, m."""
    first: str = NEVER_ASKED
    """Status of the first answer."""
    source: str = ""
    """Of the first SAFE plan."""
    safe_at: float | None = None
    """When the first SAFE plan was taken up, s; None: there was none."""
    separation: float = float("inf")
    """Smallest distance to any intruder since then, m; since the start where there was none."""
    when: float = float("nan")
    """Of that, s."""
    error: float = 0.0
    """Largest distance from where the plan flown was at the time, m."""
    answers: dict[str, int] = field(default_factory=dict)
    """Of requests of the simulator, by status."""
    plans: int = 0
    """SAFE plans that were published, the monitor's included."""
    backup: float = 0.0
    """On the backup, s."""
    latency: list[float] = field(default_factory=list)
    """From request to answer in the simulator's hands, s of real time."""
    duration: float = 0.0
    """Flown, s."""
    wall: float = 0.0
    """Taken, s of real time."""
    failure: str = ""
    """Why the flight did not go on; empty: it did."""
    resolvable: bool | None = None
    """Whether the separation planned with can be kept at all; None: not looked at."""

    @property
    def kept(self) -> bool:
        """Whether a plan called SAFE kept the separation; true where none was called so."""
        return not self.failure and (self.safe_at is None or self.separation >= self.required)


def kept(logs: Iterable[FlightLog]) -> bool:
    """Return whether all plans called SAFE kept the separation."""
    return all(log.kept for log in logs)


def table(logs: Sequence[FlightLog]) -> str:
    """Return one line an encounter and one for all."""
    rows = [_HEAD, *(_row(log) for log in logs)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    safe = [log for log in logs if log.safe_at is not None]
    below = [log.name for log in safe if not log.kept]
    failed = [f"{log.name}: {log.failure}" for log in logs if log.failure]
    lines.append("")
    if safe:
        least = min(safe, key=lambda log: log.separation)
        lines.append(
            f"{len(safe)} of {len(logs)} encounters had a plan called SAFE; the closest of them: "
            f"{least.separation:.1f} m ({least.name}); below {least.required:g} m: {', '.join(below) or 'none'}"
        )
    else:
        lines.append(f"none of {len(logs)} encounters had a plan called SAFE")
    possible = [log for log in logs if log.resolvable]
    if possible:
        called = sum(log.safe_at is not None for log in possible)
        lines.append(
            f"called SAFE of those that can be resolved at the separation planned with: {called} of {len(possible)} "
            f"({100.0 * called / len(possible):.1f} %)"
        )
    every = [value for log in logs for value in log.latency]
    if every:
        marks = np.percentile(every, (50.0, 90.0, 99.0, 100.0)) * 1e3
        lines.append(
            "answers, end to end, ms: median {:.1f}, 90 % {:.1f}, 99 % {:.1f}, max {:.1f}".format(*marks)
            + f" ({len(every)} requests)"
        )
    flown, wall = sum(log.duration for log in logs), sum(log.wall for log in logs)
    if wall > 0.0:
        lines.append(f"{flown:.0f} s flown in {wall:.0f} s: {flown / wall:.1f} times real time")
    return "\n".join(lines + failed)


def _row(log: FlightLog) -> tuple[str, ...]:
    latency = "-"
    if log.latency:
        latency = f"{1e3 * float(np.median(log.latency)):.0f} / {1e3 * max(log.latency):.0f}"
    closest = f"{log.separation:.1f}{'' if log.kept else ' !'}"
    return (
        log.name,
        log.first,
        log.source or "-",
        closest,
        f"{log.when:.0f}",
        f"{log.error:.2f}" if log.safe_at is not None else "-",
        str(sum(log.answers.values())),
        str(max(log.plans - 1, 0)),
        f"{log.backup:.1f}",
        latency,
        f"{log.duration:.0f}",
        f"{log.wall:.1f}",
    )
