"""When the run-time monitor acts: thresholds and named causes. Derivations: docs/explanation/assurance.md."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any

from agents.planner.options import Options, agility
from agents.planner.traffic import Requirement
from agents.policy.domain import traffic
from envs.kinematics import Limits, within


class Cause(IntFlag):
    """Why the monitor wants another plan or denies the present one; several may hold at once."""

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
    OUTSIDE_RANGE = 1 << 17
    """An intruder's speed, turn rate or declared noise is outside the operating domain: the policy was not trained for
    it. Plans are validated all the same."""
    IMPOSSIBLE_RATE = 1 << 18
    """An intruder's velocity has changed faster than any aircraft of the domain can."""
    CONTRADICTION = 1 << 19
    """The places of an intruder contradict its velocities."""


BLIND = Cause.OWN_MISSING | Cause.OWN_STALE | Cause.OWN_OUT_OF_ORDER | Cause.CLOCK
"""Nothing can be said about the ownship: DENIED."""

LOST = Cause.INTRUDER_STALE
"""Nothing can be planned against an intruder: DENIED, or BACKUP."""

DOUBTFUL = Cause.IMPOSSIBLE_RATE | Cause.CONTRADICTION
"""No plan against an intruder can be called safe: DENIED; plans are asked for and flown as the best there is."""

OUTSIDE = Cause.OUTSIDE_RANGE | DOUBTFUL
"""The intruders are outside the operating domain."""

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


_KEPT = 0.5
"""Share of the sigmas planned with that must be left before a new plan is asked for: what is believed of an intruder
wanders inside its uncertainty, and a plan that needs all of it would be void with every second report."""


@dataclass(frozen=True)
class Thresholds:
    """Limits beyond which the monitor acts; built by :meth:`for_plans`."""

    options: Options
    """What plans are made with; the monitor holds them to it."""
    manoeuvre: Limits
    """That backups are made with."""
    separation_band: float
    """By how much the predicted separation may fall below what the plan was required to keep, m; never below the
    separation itself."""
    resolution: float
    """By how much bounds of the separation may lie below the truth, m."""
    cross_track: float
    """Largest distance from the path, m."""
    along_track: float
    """Largest distance ahead of or behind the plan, m."""
    time_error: float
    """Largest delay or lead at a place, s."""
    memory: float
    """Time constant of the leaky sums of errors, s."""
    intruder_position: float
    """Largest deviation of an intruder from its prediction, m."""
    intruder_velocity: float
    """Largest deviation of its velocity, m/s."""
    concern: float
    """Predicted separation beyond which an intruder's deviation asks for nothing, m."""
    turn_time: float
    """For how long an intruder is expected to go on with the turn that its last two reports show, s."""
    turn_rate_min: float
    """Estimated turn rate below which it counts as straight, rad/s."""
    turn_rate_max: float
    """Largest turn rate that is accepted, rad/s."""
    replan_interval: float
    """Least time between two requests for a plan, s."""
    answer_time: float
    """In which the planner must answer, s."""
    urgent: float
    """A loss of separation nearer than this, s, does not wait for an answer."""
    plan_ending: float
    """Least rest of a plan, s."""
    own_age: float
    """Oldest own state, s."""
    intruder_age: float
    """Oldest report of an intruder that is planned with, s."""
    backup_gain: float
    """By how much more clearance, m, an unsafe backup is exchanged for another."""
    traffic: Mapping[str, tuple[float, float]]
    """Ranges of the intruders in the operating domain, SI."""
    leave: float = 0.7
    """A cause ends when its error is below this share of its threshold."""
    sustained: float = 0.5
    """Share of a threshold that may last for ever."""

    @classmethod
    def for_plans(cls, options: Options, **changes: Any) -> "Thresholds":
        """Return the usual thresholds, but for some changes, for plans with options; half of their sigmas count."""
        wanted, aircraft = options.requirement, options.aircraft
        options = replace(options, requirement=wanted._replace(sigmas=_KEPT * wanted.sigmas))
        far, step, limits = aircraft.separation, aircraft.dt, aircraft.limits
        usual: dict[str, Any] = {
            "manoeuvre": backup_limits(options),
            "separation_band": 5e-5 * far * agility(aircraft),
            "resolution": 6e-6 * far * agility(aircraft),
            "cross_track": 0.025 * far,
            "along_track": 0.05 * far,
            "time_error": step,
            "memory": 30.0 * step,
            "intruder_position": 0.05 * far,
            "intruder_velocity": 0.05 * limits.speed_max,
            "concern": 1.6 * far,
            "turn_time": 15.0 * step,
            "turn_rate_min": 0.0044 / step,
            "turn_rate_max": max(0.105 / step, 2.0 * limits.yaw_rate_max),
            "replan_interval": 2.0 * step,
            "answer_time": 3.0 * step,
            "urgent": 20.0 * step,
            "plan_ending": 60.0 * step,
            "own_age": 1.5 * step,
            "intruder_age": 5.0 * step,
            "backup_gain": 0.01 * far,
            "traffic": traffic(aircraft),
        }
        return cls(options, **(usual | changes))

    @property
    def requirement(self) -> Requirement:
        """Of the plans."""
        return self.options.requirement

    @property
    def limits(self) -> Limits:
        """That every leg must obey: the vehicle's own."""
        return self.options.limits


def backup_limits(options: Options) -> Limits:
    """Return what backups are made with: all that the vehicle can, at the speeds of decisions; each leg is constant."""
    both, slowest = within(options.aircraft.limits, options.limits), options.manoeuvre.speed_min
    return options.limits._replace(speed_min=max(both.speed_min, slowest), speed_max=both.speed_max)
