"""The log of simulated encounters: a row each, and a table of all."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ros_bridge.sim.plan_flight import PlanFlight

NEVER_ASKED = "no alert"  # the first answer where no plan was requested


@dataclass
class FlightLog:
    """The record of one encounter."""

    name: str
    required: float  # separation that a plan called SAFE must keep, m
    first: str = NEVER_ASKED  # status of the first answer
    source: str = ""  # of the first SAFE plan
    safe_at: float | None = None  # when the first SAFE plan was taken up, s; None: there was none
    separation: float = float("inf")
    """Smallest distance to any intruder since then, m; since the start where there was none."""
    when: float = float("nan")  # of that, s
    height: float = float("inf")
    """Smallest distance above or below an intruder nearer over the ground than the separation, m;
    where that is the vertical separation, the intruder does not count."""
    error: float = 0.0  # largest distance from where the plan flown was at the time, m
    clear: float = float("inf")  # smallest distance from an area since then, m; negative: inside
    plans: int = 0  # SAFE plans that were published, the monitor's included
    flown: list[PlanFlight] = field(default_factory=list)  # SAFE plans that were taken up
    backup: float = 0.0  # on the backup, s
    latency: list[float] = field(default_factory=list)
    """From request to answer in the simulator's hands, s of real time."""
    duration: float = 0.0  # flown, s
    wall: float = 0.0  # taken, s of real time
    failure: str = ""  # why the flight did not go on; empty: it did
    maybe_resolvable: bool | None = None
    """False: no flight can keep the separation planned with, which is proven; None: not looked
    at."""

    @property
    def keeps_promise(self) -> bool:
        """Whether a plan called SAFE kept the separation and out of areas; true where none was
        called so.
        """
        if self.failure:
            return False
        return self.safe_at is None or (self.separation >= self.required and self.clear >= 0.0)


def keep_promises(logs: Iterable[FlightLog]) -> bool:
    """Return whether plans called SAFE were flown, and all kept the separation and out of areas."""
    logs = list(logs)
    any_flown = any(log.safe_at is not None for log in logs)
    return any_flown and all(log.keeps_promise for log in logs)


def table(logs: Sequence[FlightLog]) -> str:
    """Return one line an encounter and one for all."""
    cells = [_cells(log) for log in logs]
    rows = [tuple(cells[0]), *(tuple(row.values()) for row in cells)] if cells else []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
    lines += ["", *_safe_lines(logs), *_solved_lines(logs), *_time_lines(logs)]
    lines += [f"{log.name}: {log.failure}" for log in logs if log.failure]
    return "\n".join(lines)


def _safe_lines(logs: Sequence[FlightLog]) -> Iterator[str]:
    """Yield what the plans called SAFE kept."""
    safe = [log for log in logs if log.safe_at is not None]
    if not safe:
        yield f"none of {len(logs)} encounters had a plan called SAFE"
        return
    least = min(safe, key=lambda log: log.separation)
    below = [log.name for log in safe if log.failure or log.separation < log.required]
    yield (
        f"{len(safe)} of {len(logs)} encounters had a plan called SAFE; the closest of them: "
        f"{least.separation:.1f} m ({least.name}); below {least.required:g} m: "
        f"{', '.join(below) or 'none'}"
    )
    if math.isfinite(min(log.clear for log in safe)):
        entered = [log.name for log in safe if log.clear < 0.0]
        yield f"SAFE plans in an area: {', '.join(entered) or 'none'}"


def _solved_lines(logs: Sequence[FlightLog]) -> Iterator[str]:
    """Yield how many of the encounters not proven unresolvable were resolved."""
    solved = [log.safe_at is not None for log in logs if log.maybe_resolvable]
    if solved:
        yield (
            "called SAFE of those not proven unresolvable at the separation planned with: "
            f"{sum(solved)} of {len(solved)} ({100.0 * np.mean(solved):.1f} %)"
        )


def _time_lines(logs: Sequence[FlightLog]) -> Iterator[str]:
    """Yield what answers took, and how fast was flown."""
    latencies = [value for log in logs for value in log.latency]
    if latencies:
        marks = np.percentile(latencies, (50.0, 90.0, 99.0, 100.0)) * 1e3
        names = ("median", "90 %", "99 %", "max")
        percentiles = ", ".join(
            f"{name} {mark:.1f}" for name, mark in zip(names, marks, strict=True)
        )
        yield f"answers, end to end, ms: {percentiles} ({len(latencies)} requests)"
    seconds, wall = sum(log.duration for log in logs), sum(log.wall for log in logs)
    if wall > 0.0:
        yield f"{seconds:.0f} s flown in {wall:.0f} s: {seconds / wall:.1f} times real time"


def _cells(log: FlightLog) -> dict[str, str]:
    slowest = [1e3 * float(of(log.latency)) for of in (np.median, max)] if log.latency else []
    return {
        "encounter": log.name,
        "first answer": log.first,
        "source": log.source or "-",
        "closest, m": f"{log.separation:.1f}{'' if log.keeps_promise else ' !'}",
        "at, s": f"{log.when:.0f}",
        "above, m": f"{log.height:.0f}" if math.isfinite(log.height) else "-",
        "error, m": f"{log.error:.2f}" if log.safe_at is not None else "-",
        "off areas, m": f"{log.clear:.0f}" if math.isfinite(log.clear) else "-",
        "answers": str(len(log.latency)),
        "re-plans": str(max(log.plans - 1, 0)),
        "backup, s": f"{log.backup:.1f}",
        "answer med/max, ms": " / ".join(f"{value:.0f}" for value in slowest) or "-",
        "flown, s": f"{log.duration:.0f}",
        "wall, s": f"{log.wall:.1f}",
    }
