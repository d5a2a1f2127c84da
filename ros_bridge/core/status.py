"""What the monitor says of itself: numbers as the message ``AssuranceStatus`` has them."""

import math
from typing import Any, NamedTuple

from agents.assurance.single import Assessment, reasons
from agents.assurance.state import FlyMode, State
from agents.assurance.thresholds import BLIND
from ros_bridge.core.assurance import Supervision, fly_mode


class Status(NamedTuple):
    """The monitor's state, and how the plan is flown where that is measured."""

    state: State = State.IDLE
    fly: FlyMode = FlyMode.NOTHING
    causes: int = 0  # bits of Cause
    reasons: tuple[str, ...] = ("there is no plan to monitor",)
    measured: bool = False
    cross_track: float = 0.0  # m to the left of the plan
    along_track: float = 0.0  # m ahead of it
    time_error: float = 0.0  # s late
    accumulated: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the three, shares of the limits
    separation: float = -1.0  # of the rest of the plan, m; -1: no intruder
    time_to_loss: float = -1.0  # s; -1: none
    altitude_error: float = 0.0  # m above the plan
    # m that is allowed; -1: the plan is in the plane, or the altitude is unknown
    altitude_error_limit: float = -1.0

    def fields(self) -> dict[str, Any]:
        """Return the fields of an ``AssuranceStatus`` that hold this."""
        plain = {"state": int(self.state), "fly": int(self.fly), "reasons": list(self.reasons)}
        return self._asdict() | plain


def status(supervision: Supervision) -> Status:
    """Return what holds after the last assessment, and after the answer that it asked for."""
    if supervision.assessment is None:
        return Status()
    monitor, measured = supervision.monitor, supervision.assessment.measured
    limits = supervision.thresholds
    causes, mode = int(monitor.causes[0]), fly_mode(supervision)
    current = Status(
        State(int(monitor.state[0])),
        mode,
        causes,
        tuple(
            reason.message
            for reason in reasons(
                measured._replace(causes=monitor.causes), limits, supervision.names
            )
        ),
        mode is FlyMode.PLAN and not causes & int(BLIND),
    )
    if not current.measured:
        return current
    full = limits.sustained * limits.memory
    cross, along, late = (
        float(sum_ / (limit * full))
        for sum_, limit in zip(
            monitor.sums[0],
            (limits.cross_track, limits.along_track, limits.time_error),
            strict=True,
        )
    )
    return current._replace(
        cross_track=float(measured.cross_track[0]),
        along_track=float(measured.along_track[0]),
        time_error=float(measured.time_error[0]),
        accumulated=(cross, along, late),
        # A lower bound, which the own distance from the plan may bring below zero.
        separation=_or_none(float(measured.separation[0])),
        time_to_loss=_or_none(float(measured.loss[0])),
        **_altitude(supervision.assessment),
    )


def _altitude(assessment: Assessment) -> dict[str, float]:
    """Return the error of the altitude and what is allowed; nothing where it is not measured."""
    error, in_height = float(assessment.measured.altitude_error[0]), assessment.in_height
    if in_height is None or in_height.own is None or math.isnan(error):
        return {}
    limit = in_height.space.thresholds.options.vertical_margin + in_height.own.error
    return {"altitude_error": error, "altitude_error_limit": limit}


def _or_none(value: float) -> float:
    return max(value, 0.0) if math.isfinite(value) else -1.0
