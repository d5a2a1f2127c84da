"""When the run-time monitor acts: thresholds and named causes. Derivations: docs/explanation/assurance.md."""

from dataclasses import dataclass, field
from enum import IntFlag

from agents.planner.options import MARGIN
from agents.planner.traffic import Requirement
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits

__all__ = ["BLIND", "LOST", "WANTING", "Cause", "Thresholds"]


class Cause(IntFlag):
    """Why the monitor is not content; several may hold at once."""

    OWN_MISSING = 1 << 0
    """The own state is not finite or out of range."""
    OWN_STALE = 1 << 1
    """The own state is too old."""
    OWN_OUT_OF_ORDER = 1 << 2
    """The own state is older than the one before, or from the future."""
    CLOCK = 1 << 3
    """The monitor's time did not increase, or is no number."""
    INTRUDER_MISSING = 1 << 4
    """An intruder's report is not finite or out of range; its last good one is dead-reckoned."""
    INTRUDER_STALE = 1 << 5
    """An intruder's last good report is too old to plan with, or there has been none."""
    INTRUDER_OUT_OF_ORDER = 1 << 6
    """An intruder's report is older than the one before, or from the future; the one before is dead-reckoned."""
    CROSS_TRACK = 1 << 7
    ALONG_TRACK = 1 << 8
    TIME_ERROR = 1 << 9
    ACCUMULATED = 1 << 10
    """Small errors against the plan have lasted."""
    INTRUDER_DEVIATION = 1 << 11
    """An intruder is not where, or does not fly as, the plan expected."""
    SEPARATION = 1 << 12
    """The rest of the plan comes too close to an intruder as it flies now."""
    PLAN_ENDING = 1 << 13
    """What is left of the plan is short."""
    NO_ANSWER = 1 << 14
    """The planner has not answered in time."""
    REFUSED = 1 << 15
    """The planner's last answer was no plan that may be flown."""
    BACKUP_UNSAFE = 1 << 16
    """The backup does not keep the required separation; it is the one of greatest clearance."""


BLIND = Cause.OWN_MISSING | Cause.OWN_STALE | Cause.OWN_OUT_OF_ORDER | Cause.CLOCK
"""Nothing can be said about the ownship: DENIED."""

LOST = Cause.INTRUDER_STALE
"""Nothing can be planned against an intruder: DENIED, or BACKUP."""

WANTING = (
    Cause.INTRUDER_MISSING
    | Cause.INTRUDER_OUT_OF_ORDER
    | Cause.CROSS_TRACK
    | Cause.ALONG_TRACK
    | Cause.TIME_ERROR
    | Cause.ACCUMULATED
    | Cause.INTRUDER_DEVIATION
    | Cause.SEPARATION
    | Cause.PLAN_ENDING
)
"""A new plan is wanted."""


@dataclass(frozen=True)
class Thresholds:
    """When the monitor acts."""

    requirement: Requirement = field(default_factory=lambda: Requirement(margin=MARGIN))
    """What plans are made with; the monitor holds them to it."""
    separation_band: float = 0.05
    """By how much the predicted separation may fall below what the plan was required to keep, m; never below the
    separation itself."""
    cross_track: float = 25.0
    """Largest distance from the path, m."""
    along_track: float = 50.0
    """Largest distance ahead of or behind the plan, m."""
    time_error: float = 1.0
    """Largest delay or lead at a place, s."""
    leave: float = 0.7
    """A cause ends when its error is below this share of its threshold."""
    memory: float = 30.0
    """Time constant of the leaky sums of errors, s."""
    sustained: float = 0.5
    """Share of a threshold that may last for ever."""
    intruder_position: float = 50.0
    """Largest deviation of an intruder from its prediction, m."""
    intruder_velocity: float = 5.0
    """Largest deviation of its velocity, m/s."""
    concern: float = 3000.0
    """Predicted separation beyond which an intruder's deviation asks for nothing, m."""
    turn_time: float = 15.0
    """For how long an intruder is expected to go on with the turn that its last two reports show, s."""
    turn_rate_min: float = 0.0044
    """Estimated turn rate below which it counts as straight, rad/s."""
    turn_rate_max: float = 0.105
    """Largest turn rate that is believed, rad/s."""
    replan_interval: float = 2.0
    """Least time between two requests for a plan, s."""
    answer_time: float = 3.0
    """In which the planner must answer, s."""
    urgent: float = 20.0
    """A loss of separation nearer than this, s, does not wait for an answer."""
    plan_ending: float = 60.0
    """Least rest of a plan, s."""
    own_age: float = 1.5
    """Oldest own state, s."""
    intruder_age: float = 5.0
    """Oldest report of an intruder that is planned with, s."""
    backup_gain: float = 10.0
    """By how much more clearance, m, an unsafe backup is exchanged for another."""
    limits: Limits = C208_PUBLISHED
    """That every leg must obey: the true vehicle's."""
    manoeuvre: Limits = SURROGATE
    """That backups are made with."""
