"""A plan: what the planner answers, safe or not, and why."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from envs.waypoints import Waypoint

WAYPOINTS = 20
"""Of a plan as the paper has it: 19, one every 20 time steps, and a point of the route."""


class Status(Enum):
    """Whether a plan may be flown."""

    SAFE = "safe"
    UNRESOLVED = "unresolved"


class Source(Enum):
    """What made the plan."""

    POLICY = "policy"
    FALLBACK = "fallback"
    NONE = "none"  # there is no trajectory at all


class Kind(Enum):
    """What is wrong with a plan or a request."""

    NOT_FINITE = "not_finite"  # a waypoint is not a number
    COUNT = "count"  # there are not as many waypoints as asked for
    TIMES = "times"  # times do not increase
    INDICES = "indices"  # indices are not unique, or one before the last is the route's
    OFF_ROUTE = "off_route"  # the last waypoint is not a point of the route
    LEG = "leg"  # no curve joins two waypoints
    SPEED = "speed"
    ACCELERATION = "acceleration"
    TURN_RATE = "turn_rate"
    SEPARATION = "separation"  # the plan comes closer to an intruder than required
    NO_REJOIN = "no_rejoin"  # the route was not rejoined in time
    GOAL_BEHIND = "goal_behind"  # no point of the route lies ahead
    GOAL_TOO_FAR = "goal_too_far"  # no point of the route can be reached in time
    ROUTE_TOO_SHORT = (
        "route_too_short"  # the route ends before the plan does, and may not be extended
    )
    DEADLINE = "deadline"  # the computation ended before everything was searched
    START_IN_VIOLATION = (
        "start_in_violation"  # an intruder is closer than the separation at the request already
    )


class RequestError(ValueError):
    """A request that cannot be planned for; the message says what was expected of ``field``, such
    as ``own.speed``.
    """

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"{field} {problem}")
        self.field = field


@dataclass(frozen=True, slots=True)
class Reason:
    """One thing that is wrong, with its first time and place where there is one."""

    kind: Kind
    field: str
    """What it is about: ``waypoints[3]``, ``intruders[0]``, ``route``."""
    message: str
    time: float | None = None
    """s after the request."""
    x: float | None = None
    """East, m."""
    y: float | None = None
    """North, m."""

    @classmethod
    def of(cls, kind: Kind, field: str, what: str, *place: float) -> "Reason":
        """Return a reason whose message begins with the field; ``place`` is time, x and y, or
        nothing.
        """
        return cls(kind, field, f"{field} {what}", *place)


@dataclass(frozen=True, slots=True)
class Excluded:
    """An intruder that the plan takes no account of."""

    number: int  # its place in the request
    reason: str
    until: float  # until when it stays out of the way, s after the request


class Flight(NamedTuple):
    """Which flight a certificate belongs to, as far as that is known."""

    policy: str | None  # SHA-256 of the policy
    time_ns: int | None  # of the request, ns since 1970
    latitude: float | None  # of the local frame's origin, degrees
    longitude: float | None


UNKNOWN_FLIGHT = Flight(None, None, None, None)


@dataclass(frozen=True, slots=True)
class Plan:
    """The answer to a request."""

    status: Status
    """SAFE only if the validator found nothing wrong."""
    source: Source
    reasons: tuple[Reason, ...]
    """Why the plan is not safe; empty for a safe one."""
    min_separation: float
    """Smallest distance to any intruder on the whole plan, m; inf without intruders, nan without a
    trajectory.
    """
    time_of_min_separation: float
    """s after the request; nan where there is none."""
    goal_index: int | None
    """Index of the route's point at which the route is rejoined."""
    rejoin_time: float
    """When that is, s after the request; nan without a trajectory."""
    excluded: tuple[Excluded, ...]
    waypoints: tuple[Waypoint, ...]
    """As many as asked for, the last of them a point of the route; none where no trajectory could
    be made.
    """
    cost: float = float("nan")
    """Extra path, time and reversals as metres (:mod:`agents.planner.fallback`)."""
    advisory: str | None = None
    """A remark for the operator, such as that the policy's own plan was not safe."""
    unsearched: tuple[str, ...] = ()
    """What the deadline left out or cut short: ``policy``, ``fallback``, ``refinement``, ``goal
    2``, ...
    """
    policy_sha256: str | None = None
    """Of the policy that was asked."""
    certify: Callable[[Flight], bytes] | None = field(default=None, repr=False, compare=False)
    """Makes the certificate of a SAFE plan as it was made from its request; None otherwise."""

    @property
    def safe(self) -> bool:
        """Whether it may be flown."""
        return self.status is Status.SAFE

    @property
    def certificate(self) -> bytes | None:
        """What ``python -m agents.check`` proves the plan from, made when it is asked for; None
        unless it is SAFE.
        """
        return self.certified()

    def certified(
        self, time_ns: int | None = None, origin: tuple[float, float] | None = None
    ) -> bytes | None:
        """Return the certificate with the time of the request, ns since 1970, and the place of the
        local frame's origin, degrees north and east; None unless the plan is SAFE.
        """
        if not self.safe or self.certify is None:
            return None
        return self.certify(Flight(self.policy_sha256, time_ns, *(origin or (None, None))))
