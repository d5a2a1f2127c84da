"""When the run-time monitor acts: thresholds and named causes. Derivations:
docs/explanation/assurance.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Any, Generic, cast

from agents.kernel.traffic import Requirement
from agents.planner.request.options import L, Narrowed, Options, agility
from agents.planner.request.request import in_wind
from agents.policy.domain import traffic
from envs.kinematics import Limits, intersection
from envs.tracking.tracker import TURN_STEPS
from envs.wind import Wind


class Cause(IntFlag):
    """Why the monitor wants another plan or denies the present one; several may hold at once."""

    OWN_MISSING = 1 << 0
    OWN_STALE = 1 << 1
    OWN_OUT_OF_ORDER = 1 << 2
    CLOCK = 1 << 3
    INTRUDER_MISSING = 1 << 4
    INTRUDER_STALE = 1 << 5
    INTRUDER_OUT_OF_ORDER = 1 << 6
    CROSS_TRACK = 1 << 7
    ALONG_TRACK = 1 << 8
    TIME_ERROR = 1 << 9
    ACCUMULATED = 1 << 10
    INTRUDER_DEVIATION = 1 << 11
    SEPARATION = 1 << 12
    PLAN_ENDING = 1 << 13
    NO_ANSWER = 1 << 14
    REFUSED = 1 << 15
    BACKUP_UNSAFE = 1 << 16
    OUTSIDE_RANGE = 1 << 17
    AREA = 1 << 20
    BACKUP_IN_AREA = 1 << 21
    ALTITUDE_ERROR = 1 << 22


SAYS = {
    Cause.OWN_MISSING: ("own", "is missing, not finite or out of range"),
    Cause.OWN_STALE: ("own.age", "is more than {own_age:g} s"),
    Cause.OWN_OUT_OF_ORDER: ("own.age", "puts the state before the last one, or into the future"),
    Cause.CLOCK: ("time", "did not increase, or is no number"),
    Cause.INTRUDER_MISSING: (
        "intruders",
        "lack a report that is finite and in range; the last good one is used",
    ),
    Cause.INTRUDER_STALE: (
        "intruders",
        "have a last good report older than {intruder_age:g} s, or none",
    ),
    Cause.INTRUDER_OUT_OF_ORDER: (
        "intruders",
        "have a report from before the last one, or from the future",
    ),
    Cause.CROSS_TRACK: ("cross_track", "is {now.cross_track:.1f} m, allowed {cross_track:g} m"),
    Cause.ALONG_TRACK: ("along_track", "is {now.along_track:.1f} m, allowed {along_track:g} m"),
    Cause.TIME_ERROR: ("time_error", "is {now.time_error:.2f} s, allowed {time_error:g} s"),
    Cause.ACCUMULATED: ("sums", "of small errors against the plan have lasted too long"),
    Cause.INTRUDER_DEVIATION: (
        "intruders",
        "are {now.intruder_position:.0f} m and {now.intruder_velocity:.1f} m/s off their "
        "predictions",
    ),
    Cause.SEPARATION: (
        "separation",
        "of the rest of the plan is {now.separation:.1f} m as the intruders fly now",
    ),
    Cause.PLAN_ENDING: ("plan", "ends in less than {plan_ending:g} s"),
    Cause.NO_ANSWER: ("planner", "has not answered within {answer_time:g} s"),
    Cause.REFUSED: ("planner", "has found no plan that may be flown"),
    Cause.BACKUP_UNSAFE: (
        "backup",
        "does not keep the required separation; it is the one of greatest clearance",
    ),
    Cause.OUTSIDE_RANGE: (
        "intruders",
        "are outside_domain: speed, turn rate or declared noise is out of range; the policy was "
        "not trained for them",
    ),
    Cause.AREA: (
        "areas",
        "are not kept clear of by the rest of the plan: it comes {now.area_deficit:.0f} m nearer "
        "to {now.area} than it may",
    ),
    Cause.BACKUP_IN_AREA: (
        "backup",
        "enters {now.backup_area}, since none stays out of all areas; it is the one of least depth",
    ),
    Cause.ALTITUDE_ERROR: (
        "altitude_error",
        "is {now.altitude_error:.1f} m, allowed {options.vertical_margin:g} m beside what the "
        "altitude itself may be off",
    ),
}
"""What each cause says of what: fields of a decision are ``now``'s, others those of the thresholds.
"""

BLIND = Cause.OWN_MISSING | Cause.OWN_STALE | Cause.OWN_OUT_OF_ORDER | Cause.CLOCK
"""Nothing can be said about the ownship: DENIED."""

LOST = Cause.INTRUDER_STALE
"""Nothing can be planned against an intruder: DENIED, or BACKUP."""

OUTSIDE = Cause.OUTSIDE_RANGE
"""The intruders are outside the operating domain."""

WANTING = (
    Cause.INTRUDER_MISSING
    | Cause.INTRUDER_OUT_OF_ORDER
    | Cause.CROSS_TRACK
    | Cause.ALONG_TRACK
    | Cause.TIME_ERROR
    | Cause.ALTITUDE_ERROR
    | Cause.ACCUMULATED
    | Cause.INTRUDER_DEVIATION
    | Cause.SEPARATION
    | Cause.AREA
    | Cause.PLAN_ENDING
)
"""A new plan is wanted."""

UNSAFE = Cause.SEPARATION | Cause.AREA
"""The rest of the plan is not safe."""


OWN_AGE = 1.5
"""Oldest state of the ownship that is monitored, time steps."""

# Share of the sigmas planned with that must be left before a new plan is asked for: what is
# believed of an intruder wanders inside its uncertainty, and a plan that needs all of it would be
# void with every second report.
_KEPT = 0.5


@dataclass(frozen=True)
class Thresholds(Generic[L]):
    """Limits beyond which the monitor acts; built by :meth:`for_plans`."""

    options: Options[L]
    """What plans are made with; the monitor holds them to it."""
    manoeuvre: Limits
    """That backups are made with."""
    separation_band: float
    """By how much the predicted separation may fall below what the plan was required to keep, m;
    never below the separation itself."""
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
    """Predicted separation beyond which an intruder's deviation asks for nothing, m; for one with a
    separation of its own it differs by as much as that.
    """
    turn_time: float
    """For how long an intruder that turns is expected to go on with its turn, s."""
    turn_rate_min: float
    """Turn rate below which it counts as straight, rad/s."""
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
    wind_std: float = 0.0
    """One sigma of both components of the wind in whose air mass all this holds, m/s."""

    @classmethod
    def for_plans(cls, options: Options, **changes: Any) -> "Thresholds":
        """Return the usual thresholds, but for some changes, for plans with options; half of their
        sigmas count. What the margin of the plans covers is no reason for a new one.
        """
        requirement, aircraft = options.requirement, options.aircraft
        options = replace(
            options, requirement=requirement._replace(sigmas=_KEPT * requirement.sigmas)
        )
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
            "turn_time": TURN_STEPS * step,
            "turn_rate_min": 0.0044 / step,
            "turn_rate_max": max(0.105 / step, 2.0 * limits.yaw_rate_max),
            "replan_interval": 2.0 * step,
            "answer_time": 3.0 * step,
            "urgent": 20.0 * step,
            "plan_ending": 60.0 * step,
            "own_age": OWN_AGE * step,
            "intruder_age": options.max_age,
            "backup_gain": 0.01 * far,
            "traffic": traffic(aircraft),
        }
        margin = requirement.margin
        covered = {
            "cross_track": margin,
            "along_track": margin,
            "time_error": margin / limits.speed_min,
        }
        chosen = usual | changes
        chosen |= {name: max(chosen[name], least) for name, least in covered.items()}
        return Thresholds(options, **chosen)

    def in_wind(self: "Thresholds", wind: Wind) -> "Thresholds[Narrowed]":
        """Return these thresholds, of still air, in the air mass of a wind: plans and backups must
        keep the limits in every wind within its uncertainty, as the planner's do.

        Raises:
            RequestError: the wind is too uncertain for the aircraft.
        """
        if wind.std == 0.0:
            return cast("Thresholds[Narrowed]", self)
        requirement = self.requirement
        planned = requirement._replace(sigmas=requirement.sigmas / _KEPT)
        narrowed = in_wind(replace(self.options, requirement=planned), wind)
        options = replace(narrowed, requirement=requirement)
        narrow = cast("Thresholds[Narrowed]", self)
        return replace(
            narrow, options=options, manoeuvre=backup_limits(options), wind_std=float(wind.std)
        )

    @property
    def requirement(self) -> Requirement:
        """Of the plans."""
        return self.options.requirement

    @property
    def limits(self) -> Limits:
        """That every leg must obey: the vehicle's own, or what an uncertain wind leaves of them."""
        return self.options.limits


def backup_limits(options: Options[L]) -> Limits:
    """Return what backups are made with: all that the vehicle can, at the speeds of decisions; each
    leg is constant.
    """
    common = intersection(options.aircraft.limits, options.limits)
    slowest = options.manoeuvre.speed_min
    return options.limits._replace(
        speed_min=max(common.speed_min, slowest), speed_max=common.speed_max
    )
