"""How plans are made: for which aircraft, separation, limits and horizon, and how far the search
goes.
"""

import math
from dataclasses import dataclass
from enum import Enum
from operator import attrgetter
from typing import Any, Generic, Self

import numpy as np

from agents.kernel.clearance import LONGEST
from agents.kernel.traffic import Requirement
from agents.manoeuvres.direct_to_goal import EVERY, DirectTask
from agents.planner.answer import WAYPOINTS, RequestError
from agents.planner.request.fields import quote, real
from envs.aircraft import Aircraft, AircraftError, Vertical, new_aircraft
from envs.areas import Level
from envs.arrays import Array, Float, Int
from envs.kinematics import FASTEST, Limits, intersection
from envs.phantom import TypeVar
from envs.profile import corner_error

LOWEST, HIGHEST = -1e3, 3e4
"""Altitudes that are planned at, m."""

MAX_AGE = 5.0
"""Oldest report of an intruder that is planned with, time steps."""

# separations that the follower leaves the curve by, rounded up (docs/explanation/planner.md)
_MARGIN = 2e-5
_ORDINARY = 0.0524  # rad of turn in a time step, to which margins and resolutions were measured
_RESERVE = 0.75  # of turn rate and acceleration, for curves that take 4/3 of what was flown
_EXTENSION = 5.0  # between points beyond the end of a route, separations
_LEAST_LEG = 0.1  # least duration of the last leg, time steps
_TURN_SHARE = 2.0 / 3.0  # of the turn rate, for turns along the route


class Maneuvers(Enum):
    """What a plan may do beside its route."""

    HORIZONTAL = "horizontal"  # turn and change its speed; altitudes are not planned
    VERTICAL = "vertical"  # climb and descend, along the route
    BOTH = "both"


_KINDS: dict[str, type] = {
    "aircraft": Aircraft,
    "requirement": Requirement,
    "maneuvers": Maneuvers,
    **dict.fromkeys(("limits", "manoeuvre", "aircraft.limits", "aircraft.vehicle_limits"), Limits),
    **dict.fromkeys(("direct", "extend_route", "exhaustive", "rejoin_on_leg"), bool),
}
_LIMITS: dict[str, tuple[float, float, str]] = {
    "speed_min": (0.0, FASTEST.speed_max, "m/s"),
    "speed_max": (1e-3, 1.01 * FASTEST.speed_max, "m/s"),
    "acceleration_min": (2.0 * FASTEST.acceleration_min, 0.0, "m/s^2"),
    "acceleration_max": (1e-6, 2.0 * FASTEST.acceleration_max, "m/s^2"),
    "yaw_rate_max": (1e-5, 2.0 * FASTEST.yaw_rate_max, "rad/s"),
}


def agility(aircraft: Aircraft) -> float:
    """Return how much more than usual an aircraft turns in a time step; 1 or more: errors of curves
    grow with it.
    """
    return max(1.0, aircraft.limits.yaw_rate_max * aircraft.dt / _ORDINARY)


def default_vertical_margin(vertical: Vertical) -> float:
    """Return the vertical margin where none is given, m: what a change from level flight to the
    greatest climb or descent takes.
    """
    change = max(vertical.climb_max, vertical.descent_max)
    return corner_error(change, vertical.acceleration)


def default_margin(aircraft: Aircraft) -> float:
    """Return the margin for the follower where none is given, m."""
    return _MARGIN * aircraft.separation * agility(aircraft)


def comfort_limits(decisions: Limits, vehicle: Limits) -> Limits:
    """Return limits of manoeuvres that leave the legs a reserve: smoothing between waypoints takes
    more than was flown.

    The gentlest curve to the same end as an acceleration (or turn) that stops inside the leg begins
    with up to 4/3 of it. A twentieth of the greatest speed is always kept: what stands still cannot
    turn. Raises a ValueError where the limits of decisions and of the vehicle have no speeds in
    common.
    """
    common = intersection(decisions, vehicle)
    return Limits(
        max(common.speed_min, 0.05 * common.speed_max),
        common.speed_max - 0.004 * common.speed_max,
        max(common.acceleration_min, _RESERVE * vehicle.acceleration_min),
        min(common.acceleration_max, _RESERVE * vehicle.acceleration_max),
        min(common.yaw_rate_max, _RESERVE * vehicle.yaw_rate_max),
    )


def speed_range(limits: Limits) -> tuple[float, float]:
    """Return between which speeds an ownship is planned for, m/s: a flown plan swings a little
    about its limits.
    """
    swing = 0.01 * limits.speed_max
    return max(limits.speed_min - swing, swing), limits.speed_max + swing


class Stated:
    """Limits as they are given for the vehicle."""


class Narrowed:
    """What the uncertainty of the wind leaves of them; in still air, all."""


# Whose limits options have, for the type checker alone. `Options` alone are those given.
L = TypeVar("L", default=Stated)


@dataclass(frozen=True)
class Options(Generic[L]):
    """How plans are made; built by :meth:`for_aircraft`."""

    aircraft: Aircraft
    """Whose plans they are: its task, time step and scales."""
    requirement: Requirement
    limits: Limits
    """That every leg must obey: the vehicle's own."""
    manoeuvre: Limits
    """That policy and fallback are flown with."""
    rejoin_by: float
    """Latest time at which the route is rejoined, s."""
    max_age: float
    """Oldest report that is planned with, s."""
    fallback_cost_threshold: float
    """Cost of a safe plan of the policy's, m, above which the fallback is searched too and the
    cheaper plan taken; 0 offers it always, inf never."""
    waypoints: int = WAYPOINTS
    """Of a plan, the last of them a point of the route."""
    spacing: int = 20
    """Time steps from waypoint to waypoint; a multiple of 5."""
    direct: bool = True
    """Whether policy and fallback hand over to the direct route to the goal as soon as that is
    clear.
    """
    goals: int = 3
    """Points of the route that are tried, the next one first."""
    rejoin_on_leg: bool = False
    """Whether the points of a straight leg are as welcome as the next one: while a SAFE plan costs
    much, the others on its leg are tried too, and the best is taken, where the time beside the
    route and all turns count as well. Else the first point with a SAFE plan is rejoined at."""
    extend_route: bool = False
    """Whether a route that ends before the plan may be extended in its last direction."""
    vertical_filter: float = 600.0
    """Predicted vertical separation beyond which an intruder is left out, m; no number of the
    aircraft gives it.
    """
    unknown_climb: float = 10.0
    """Rate at which aircraft climb or descend at most whose vertical speed is unknown, m/s: 2000
    ft/min, which airliners hardly exceed but after take-off."""
    exhaustive: bool = True
    """Whether the last, slow stages of the fallback are tried before giving up."""
    deadline_s: float = 0.050
    """Computation after which :func:`agents.planner.plan` answers with the best plan so far, s;
    inf: never.
    """
    maneuvers: Maneuvers = Maneuvers.HORIZONTAL
    """What a plan may do; where it may climb, ``aircraft.vertical`` says how, and its vertical
    separation counts in the place of the vertical filter."""
    vertical_margin: float = 0.0
    """Added to the vertical separation for what the follower leaves of the plan's altitude, changes
    of climb included, m."""
    floor: Level | None = None
    """Least altitude of plans that may climb or descend, in the reference of the ownship's; None:
    any."""
    ceiling: Level | None = None
    """Greatest altitude of plans that may climb or descend, likewise."""
    altitude_weight: float = 1.0
    """Cost of a metre that is climbed or descended beside the route, in metres of path."""

    @classmethod
    def for_aircraft(
        cls, aircraft: Aircraft, vehicle: Limits | None = None, **changes: Any
    ) -> Self:
        """Return the usual options for an aircraft, but for some changes.

        The legs obey the vehicle; None: what the aircraft states of its vehicle. Raises a
        ValueError if the two have no speeds in common.
        """
        limits = aircraft.vehicle_limits if vehicle is None else vehicle
        usual: dict[str, Any] = {
            "requirement": Requirement(aircraft.separation, default_margin(aircraft)),
            "limits": limits,
            "max_age": MAX_AGE * aircraft.dt,
            "fallback_cost_threshold": 1.5 * aircraft.separation,
            **changes,
        }
        if aircraft.vertical is not None and "vertical_margin" not in usual:
            usual["vertical_margin"] = default_vertical_margin(aircraft.vertical)
        if "manoeuvre" not in usual:
            usual["manoeuvre"] = comfort_limits(aircraft.limits, limits)
        if "rejoin_by" not in usual:
            shape = cls(aircraft, **usual, rejoin_by=0.0)
            usual["rejoin_by"] = min(aircraft.t_max, shape.latest_rejoin)
        return cls(aircraft, **usual)

    @property
    def climbs(self) -> bool:
        """Whether plans may climb and descend."""
        return self.maneuvers is not Maneuvers.HORIZONTAL

    @property
    def vertical(self) -> Vertical:
        """What the aircraft of plans that climb can do up and down.

        Raises:
            RequestError: the aircraft states nothing of it.
        """
        if self.aircraft.vertical is None:
            problem = (
                f'is "{self.maneuvers.value}", expected "horizontal": the aircraft states no '
                "limits of climb and descent"
            )
            raise RequestError("options.maneuvers", problem)
        return self.aircraft.vertical

    @property
    def vertical_separation(self) -> float:
        """Beyond which an intruder without one of its own does not count, m."""
        return self.vertical.separation if self.climbs else self.vertical_filter

    @property
    def interval(self) -> float:
        """Time from waypoint to waypoint, s."""
        return self.spacing * self.aircraft.dt

    @property
    def last_free(self) -> float:
        """Time of the last waypoint that is not a point of the route, s."""
        return (self.waypoints - 1) * self.interval

    @property
    def latest_rejoin(self) -> float:
        """Greatest ``rejoin_by``, s: two waypoints before the last free one."""
        return self.last_free - 2.0 * self.interval

    @property
    def finished_by(self) -> float:
        """The last leg ends at the first point of the route that is reached at or after this, s."""
        return self.last_free + _LEAST_LEG * self.aircraft.dt

    @property
    def extension(self) -> float:
        """Distance between the points beyond the end of a route that may be extended, m."""
        return _EXTENSION * self.aircraft.separation

    def points_beyond(self, wind: float) -> int:
        """Return how many points beyond the end of its route a plan may fly over in some wind,
        m/s.
        """
        if not self.extend_route:
            return 0
        fastest = 1.5 * self.limits.speed_max + wind
        return math.ceil(self.last_free * fastest / self.extension)

    def latest_end(
        self,
        own_speed: Float[Array, "..."],
        x: Float[Array, "... R"],
        y: Float[Array, "... R"],
        points: Int[Array, "..."] | None = None,
        wind: Float[Array, "..."] = 0.0,
    ) -> Float[Array, "..."]:
        """Return a time that no plan outlasts, s after the request.

        The last leg begins before :attr:`finished_by`. It turns by half a circle at most and then
        goes straight for the route's longest leg, or what extends the route, at the lowest speed
        over the ground, which counts as a quarter of the lowest airspeed at least, and that as a
        hundredth of the greatest: an aircraft that hovers never arrives. A manoeuvre that would
        last longer is no plan (:mod:`agents.planner.search.completion`).

        Args:
            own_speed: of the ownship at the request, m/s; it may be below the limits, as
                far as :func:`speed_range` lets an ownship be planned for.
            x: of the route's points, m; with ``y``.
            points: how many of them there are; None: all.
            wind: its speed, m/s.
        """
        legs = np.hypot(x[..., 1:] - x[..., :-1], y[..., 1:] - y[..., :-1])
        if points is not None:
            legs = np.where(np.arange(1, x.shape[-1]) < np.asarray(points)[..., None], legs, 0.0)
        longest = np.maximum(legs.max(axis=-1), self.extension) + self.aircraft.goal_radius
        planned_for = np.maximum(own_speed, speed_range(self.aircraft.limits)[0])
        lowest = max(self.manoeuvre.speed_min, 0.01 * self.manoeuvre.speed_max)
        slowest = np.minimum(planned_for, lowest)
        slowest = np.maximum(slowest - wind, 0.25 * slowest)
        half_circle = (math.pi + 1.0) / task_of(self).turn_rate  # and a radius of straight flight
        half_circle = half_circle * (1.0 + wind / slowest)  # which the wind lengthens
        return self.finished_by + half_circle + longest / slowest

    @property
    def rejoin_reserve(self) -> float:
        """By how much deeper than the goal radius manoeuvres enter the goal's disc, m, so that
        smoothed plans do.
        """
        return min(0.05 * self.aircraft.separation, 0.5 * self.aircraft.goal_radius)

    @property
    def slack(self) -> float:
        """Distance beyond the required one that makes a way clear, m: the smoothing of the turn
        takes up to that.
        """
        return 0.03 * self.aircraft.separation

    @property
    def smoothing(self) -> float:
        """What legs may take from the flown clearance, m; less than that makes a manoeuvre
        uncertain.
        """
        return 0.025 * self.aircraft.separation


def aggressive_limits(options: Options[L]) -> Limits:
    """Return limits for a last attempt: the legs' own, less what smoothing takes; no longer those
    of decisions.
    """
    legs = options.limits
    return options.manoeuvre._replace(
        acceleration_min=min(_RESERVE * legs.acceleration_min, options.manoeuvre.acceleration_min),
        acceleration_max=max(legs.acceleration_max, options.manoeuvre.acceleration_max),
        yaw_rate_max=max(_RESERVE * legs.yaw_rate_max, options.manoeuvre.yaw_rate_max),
    )


def task_of(options: Options[L]) -> DirectTask:
    """Return what manoeuvres are flown for."""
    radius = options.aircraft.goal_radius - options.rejoin_reserve
    rate = _TURN_SHARE * options.manoeuvre.yaw_rate_max
    return DirectTask(options.manoeuvre, radius, options.rejoin_by, rate)


def plain_task(options: Options[L]) -> DirectTask:
    """Return what manoeuvres are flown for, in plain floats, as compiled code takes it."""
    task = task_of(options)
    return DirectTask(Limits(*map(float, task.limits)), *map(float, task[1:]))


def check(options: Options) -> None:
    """Refuse, by a RequestError that names it, an option that could make an unsafe plan look safe,
    or none possible.
    """
    if not isinstance(options, Options):
        raise RequestError("options", f"is {type(options).__name__}, expected Options")
    _check_kinds(options)
    _check_aircraft(options.aircraft)
    for name, low, high, step in (
        ("waypoints", 4, 400, 1),
        ("spacing", EVERY, 400, EVERY),
        ("goals", 1, 100, 1),
    ):
        _check_whole(f"options.{name}", getattr(options, name), low, high, step)
    if options.last_free > LONGEST:
        problem = f"makes plans of {options.last_free:g} s and more, expected {LONGEST:g} s at most"
        raise RequestError("options.spacing", problem)
    _check_numbers(options)
    _check_levels(options)
    for name, limits in (("limits", options.limits), ("manoeuvre", options.manoeuvre)):
        if limits.speed_min >= limits.speed_max:
            problem = (
                f"is {limits.speed_min:g} m/s, expected less than speed_max, "
                f"{limits.speed_max:g} m/s"
            )
            raise RequestError(f"options.{name}.speed_min", problem)
    circle = 2.0 * math.pi / options.manoeuvre.yaw_rate_max
    if circle > options.last_free:
        problem = (
            f"makes a full circle of {circle:.0f} s, expected at most the plan's "
            f"{options.last_free:.0f} s"
        )
        raise RequestError("options.manoeuvre.yaw_rate_max", problem)


def _check_levels(options: Options) -> None:
    """Refuse climbs without an aircraft that can, and a floor and a ceiling that contradict."""
    levels = {"floor": options.floor, "ceiling": options.ceiling}
    for name, level in levels.items():
        if level is None:
            continue
        if not isinstance(level, Level):
            problem = f"is {quote(level)}, expected a Level or None"
            raise RequestError(f"options.{name}", problem)
        real(f"options.{name}.value", level.value, LOWEST, HIGHEST, "m")
        if not options.climbs:
            problem = 'is given, expected maneuvers that are "vertical" or "both"'
            raise RequestError(f"options.{name}", f"{problem}: in the plane no altitude is planned")
    if options.climbs:
        _ = options.vertical  # refused where the aircraft has none
    floor, ceiling = levels.values()
    if floor is None or ceiling is None:
        return
    if floor.reference != ceiling.reference:
        problem = (
            f"is of {quote(floor.reference)}, expected the ceiling's {quote(ceiling.reference)}"
        )
        raise RequestError("options.floor.reference", problem)
    if not floor.value < ceiling.value:
        problem = f"is {floor.value:g} m, expected less than the ceiling, {ceiling.value:g} m"
        raise RequestError("options.floor.value", problem)


def _check_kinds(options: Options) -> None:
    """Refuse an option of another type."""
    for name, kind in _KINDS.items():
        value = attrgetter(name)(options)
        if not isinstance(value, kind):
            expected = "True or False" if kind is bool else kind.__name__
            raise RequestError(f"options.{name}", f"is {quote(value)}, expected {expected}")


def _check_aircraft(aircraft: Aircraft) -> None:
    """Refuse an aircraft that cannot be."""
    vertical: Any = aircraft.vertical
    if vertical is not None and not isinstance(vertical, Vertical):
        problem = f"is {quote(vertical)}, expected Vertical or None"
        raise RequestError("options.aircraft.vertical", problem)
    numbers = aircraft._asdict()
    for group in ("limits", "vehicle", "vertical"):
        of_group = numbers.pop(group)
        if of_group is not None:
            numbers |= {f"{group}.{name}": value for name, value in of_group._asdict().items()}
    for name, value in numbers.items():
        real(f"options.aircraft.{name}", value, -math.inf, math.inf, "")
    try:
        new_aircraft(**aircraft._asdict())
    except AircraftError as error:
        raise RequestError("options.aircraft", f"cannot be: {error}") from None


def _check_whole(name: str, value: Any, low: int, high: int, step: int) -> None:
    """Refuse a number that is not whole, not in [low, high] or no multiple of a step."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not whole or not low <= value <= high or value % step:
        expected = f"an integer from {low} to {high}"
        expected += f", a multiple of {step}" if step > 1 else ""
        raise RequestError(name, f"is {quote(value)}, expected {expected}")


def _check_numbers(options: Options) -> None:
    """Refuse a number that is out of range."""
    unit, dt = options.aircraft.separation, options.aircraft.dt
    ranges: list[tuple[str, float, float, str]] = [
        ("requirement.separation", 1.0, 1e6, "m"),
        ("requirement.margin", 0.0, 50.0 * unit, "m"),
        ("requirement.sigmas", 0.0, 10.0, "sigmas"),
        ("rejoin_by", options.interval, options.latest_rejoin, "s"),
        ("vertical_filter", 0.0, 50_000.0, "m"),
        ("unknown_climb", 0.0, 100.0, "m/s"),
        ("max_age", 0.0, 60.0 * dt, "s"),
        ("fallback_cost_threshold", 0.0, math.inf, "m"),
        ("deadline_s", 0.0, math.inf, "s"),
        ("vertical_margin", 0.0, 5_000.0, "m"),
        ("altitude_weight", 0.0, 1e6, ""),
    ]
    for of in ("limits", "manoeuvre"):
        ranges += [(f"{of}.{name}", *bounds) for name, bounds in _LIMITS.items()]
    for name, low, high, unit_of in ranges:
        real(f"options.{name}", attrgetter(name)(options), low, high, unit_of)
