"""What became of each plan that was flown, against what SAFE assumes and promises.

SAFE promises the separation from every intruder that goes on as it was reported, to an ownship that
stays within the margin of its plan. It knows nothing of the time between the request and the
moment at which the plan is taken up: an ownship that flies straight on meanwhile is beside a plan
that turns at once, and turned away from it (docs/reference/ros.md, "Taking up a plan").
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

_LATE = 0.5  # s from the plan's start to its take-up, from which on a deviation may come of it
_SETTLED = 15.0  # s after the take-up within which the follower has come back to the plan
_STRAIGHT = 1.0  # m from a straight course, beyond which an intruder has turned or changed speed


class Promise(Enum):
    """Whether a plan's promise held; the value is what the table says."""

    KEPT = "kept"
    MARGIN = "margin exceeded"
    NOT_PROMISED = "lost, not promised"
    BROKEN = "BROKEN"


@dataclass
class PlanFlight:
    """One SAFE plan in flight; times are those of the encounter."""

    began: float  # at which the plan starts, s
    taken_up: float  # s
    off: float  # distance from the plan at the take-up, m
    turned: float  # heading against the plan's at the take-up, rad
    ended: float = math.nan  # s
    error: float = 0.0  # largest distance from the plan, m
    error_at: float = math.nan  # of that, s
    separation: float = math.inf  # smallest distance to any intruder, m
    separation_at: float = math.nan  # of that, s
    strayed: float = 0.0
    """Largest distance of an intruder from its straight course since the plan was taken up, m."""

    @property
    def late(self) -> float:
        """Time from the plan's start to its take-up, s."""
        return self.taken_up - self.began

    def promise(self, required: float, margin: float) -> Promise:
        """Return whether the promise held for a separation and a margin, m."""
        within = self.error <= margin
        # A separation that is no number is not kept.
        if self.separation >= required:
            return Promise.KEPT if within else Promise.MARGIN
        excused = not within or self.strayed > _STRAIGHT
        return Promise.NOT_PROMISED if excused else Promise.BROKEN

    def explanation(self, required: float, margin: float) -> str:
        """Return one sentence of what was exceeded and why; empty where the promise held."""
        promise = self.promise(required, margin)
        if promise is Promise.KEPT:
            return ""
        if promise is Promise.BROKEN:
            return (
                f"came within {self.separation:.1f} m of an intruder at {self.separation_at:.1f} "
                f"s, required {required:g} m, though the flight stayed within {margin:g} m of "
                "the plan and the intruders flew straight on: the promise of SAFE is broken"
            )
        reasons = []
        if self.error > margin:
            reasons.append(
                f"the flight was up to {self.error:.1f} m from the plan, margin {margin:g} m, "
                + self._cause()
            )
        if promise is Promise.NOT_PROMISED and self.strayed > _STRAIGHT:
            reasons.append(f"an intruder left its straight course by {self.strayed:.0f} m")
        if promise is Promise.MARGIN:
            return f"{reasons[0]}; the separation of {required:g} m was kept"
        return (
            f"came within {self.separation:.1f} m of an intruder, required {required:g} m, which "
            f"was not promised, because {' and '.join(reasons)}"
        )

    def _cause(self) -> str:
        if self.late >= _LATE and self.error_at - self.taken_up <= _SETTLED:
            return (
                f"because it was taken up {self.late:.1f} s after its start, {self.off:.1f} m "
                f"beside it and turned {math.degrees(abs(self.turned)):.0f} degrees away from it"
            )
        return "because the vehicle did not follow it more closely"


def plans_table(
    flights: Sequence[tuple[str, Sequence[PlanFlight]]], required: float, margin: float
) -> str:
    """Return one line a plan, and a sentence for each that went beyond what SAFE assumes.

    Args:
        flights: name of the encounter, and its plans in the order of their flight.
        required: separation, m.
        margin: by which the flight may be off its plan, m.
    """
    lines = [_HEAD]
    lines += [
        _cells(name, number, plan, required, margin)
        for name, plans in flights
        for number, plan in enumerate(plans, 1)
    ]
    if len(lines) == 1:
        return "no plan called SAFE was flown"
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = ["  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]
    return "\n".join([*texts, *_sentences(flights, required, margin)])


_HEAD = (
    "encounter",
    "plan",
    "taken up, s",
    "late, s",
    "off then, m",
    "furthest off, m",
    "margin, m",
    "closest, m",
    "required, m",
    "intruders off straight, m",
    "SAFE",
)


def _cells(
    name: str, number: int, plan: PlanFlight, required: float, margin: float
) -> tuple[str, ...]:
    return (
        name,
        str(number),
        f"{plan.taken_up:.1f}",
        f"{plan.late:.2f}",
        f"{plan.off:.2f}",
        f"{plan.error:.2f}",
        f"{margin:g}",
        f"{plan.separation:.1f}",
        f"{required:g}",
        f"{plan.strayed:.1f}",
        plan.promise(required, margin).value,
    )


def _sentences(
    flights: Sequence[tuple[str, Sequence[PlanFlight]]], required: float, margin: float
) -> Iterator[str]:
    for name, plans in flights:
        for number, plan in enumerate(plans, 1):
            explanation = plan.explanation(required, margin)
            if explanation:
                yield f"{name}, plan {number}: {explanation}"
