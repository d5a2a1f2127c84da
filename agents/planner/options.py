"""How plans shall be: separation, limits, and how far the search goes."""

import math
from dataclasses import dataclass, field

from agents.manoeuvres.direct_to_goal import Task
from agents.planner.answer import RequestError
from agents.planner.fields import real, shown
from agents.planner.traffic import Requirement
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits

__all__ = ["MARGIN", "REJOIN_RESERVE", "Options", "aggressive_limits", "check", "comfort_limits", "task_of"]

MARGIN = 0.02
"""Largest distance of the follower from the curve that it flies on the true limits' kinematics, m, rounded up: the
default margin (measured: docs/explanation/planner.md)."""

REJOIN_RESERVE = 50.0
"""By how much deeper than ``goal_radius`` manoeuvres enter the goal's disc, m, so that the smoothed plan does too."""

_TURN_SHARE = 2.0 / 3.0  # of the turn rate, for turns along the route
_RANGES = (
    ("requirement.separation", 1.0, 50_000.0, "m"),
    ("requirement.margin", 0.0, 50_000.0, "m"),
    ("requirement.sigmas", 0.0, 10.0, "sigmas"),
    *(
        (f"{name}.{limit}", low, high, unit)
        for name in ("limits", "manoeuvre")
        for limit, low, high, unit in (
            ("speed_min", 10.0, 101.0, "m/s"),
            ("speed_max", 49.0, 500.0, "m/s"),
            ("acceleration_min", -20.0, 0.0, "m/s^2"),
            ("acceleration_max", 1e-3, 20.0, "m/s^2"),
            ("yaw_rate_max", 1e-4, 0.5, "rad/s"),
        )
    ),
    ("goal_radius", 100.0, 50_000.0, "m"),
    ("rejoin_by", 20.0, 340.0, "s"),
    ("vertical_filter", 0.0, 50_000.0, "m"),
    ("max_age", 0.0, 60.0, "s"),
    ("fallback_cost_threshold", 0.0, math.inf, "m"),
)
"""What options may be."""


def comfort_limits(limits: Limits) -> Limits:
    """Return limits that leave the legs a reserve, because smoothing between waypoints takes more than was flown.

    The gentlest curve to the same end as an acceleration (or turn) that stops inside the leg begins with up to 4/3
    of it. For turns and deceleration the true vehicle has that much more than the surrogate; for acceleration not.
    """
    return limits._replace(speed_max=limits.speed_max - 0.4, acceleration_max=0.75 * limits.acceleration_max)


@dataclass(frozen=True)
class Options:
    """How plans shall be."""

    requirement: Requirement = field(default_factory=lambda: Requirement(margin=MARGIN))
    limits: Limits = C208_PUBLISHED
    """That every leg must obey: the true vehicle's."""
    manoeuvre: Limits = field(default_factory=lambda: comfort_limits(SURROGATE))
    """That policy and fallback are flown with."""
    goal_radius: float = 500.0
    """Within which a point of the route counts as rejoined, m."""
    rejoin_by: float = 300.0
    """Latest time of that, s."""
    direct: bool = True
    """Whether policy and fallback hand over to the direct way to the goal as soon as that is clear."""
    goals: int = 3
    """Points of the route that are tried, the next one first."""
    extend_route: bool = False
    """Whether a route that ends before the plan may be extended in its last direction."""
    vertical_filter: float = 600.0
    """Predicted vertical separation beyond which an intruder is left out, m."""
    max_age: float = 5.0
    """Oldest report that is planned with, s."""
    fallback_cost_threshold: float = 1_500.0
    """Cost of a safe plan of the policy's, m, above which the fallback is searched too and the cheaper plan taken;
    0 offers it always, inf never."""
    exhaustive: bool = True
    """Whether the last, slow stages of the fallback are tried before giving up."""


def aggressive_limits(options: Options) -> Limits:
    """Return limits for a last attempt: the legs' own, less what smoothing takes; no longer the surrogate's."""
    legs, reserve = options.limits, 0.75
    return options.manoeuvre._replace(
        acceleration_min=min(reserve * legs.acceleration_min, options.manoeuvre.acceleration_min),
        acceleration_max=max(legs.acceleration_max, options.manoeuvre.acceleration_max),
        yaw_rate_max=max(reserve * legs.yaw_rate_max, options.manoeuvre.yaw_rate_max),
    )


def task_of(options: Options) -> Task:
    """Return what manoeuvres are flown for."""
    radius = options.goal_radius - REJOIN_RESERVE
    rate = _TURN_SHARE * options.manoeuvre.yaw_rate_max
    return Task(options.manoeuvre, radius, options.rejoin_by, rate, options.direct)


def check(options: Options) -> None:
    """Refuse options that could make an unsafe plan look safe, or none possible.

    Raises:
        RequestError: an option is of the wrong kind or out of range; it names it.
    """
    if not isinstance(options, Options):
        raise RequestError("options", f"is {type(options).__name__}, expected Options")
    for name, kind in (("requirement", Requirement), ("limits", Limits), ("manoeuvre", Limits)):
        if not isinstance(getattr(options, name), kind):
            raise RequestError(f"options.{name}", f"is {shown(getattr(options, name))}, expected {kind.__name__}")
    for name, low, high, unit in _RANGES:
        value = options
        for part in name.split("."):
            value = getattr(value, part)
        real(f"options.{name}", value, low, high, unit)
    for name in ("limits", "manoeuvre"):
        limits = getattr(options, name)
        if limits.speed_min >= limits.speed_max:
            what = f"is {limits.speed_min:g} m/s, expected less than speed_max, {limits.speed_max:g} m/s"
            raise RequestError(f"options.{name}.speed_min", what)
    for name in ("direct", "extend_route", "exhaustive"):
        if not isinstance(getattr(options, name), bool):
            raise RequestError(f"options.{name}", f"is {shown(getattr(options, name))}, expected True or False")
    if isinstance(options.goals, bool) or not isinstance(options.goals, int) or not 1 <= options.goals <= 100:
        raise RequestError("options.goals", f"is {shown(options.goals)}, expected an integer from 1 to 100")
