"""A plan: what the planner answers, safe or not, and why."""

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import NamedTuple, Protocol

from envs.waypoints import Waypoint
from envs.wind import Wind

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
    VERTICAL = "vertical"  # a climb or a descent on the way along the route
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
    # the altitudes ask for more than the aircraft can do, or leave the floor or the ceiling
    CLIMB = "climb"
    SEPARATION = "separation"  # the plan comes closer to an intruder than required
    AREA = "area"  # the plan does not keep the clearance from an area
    NO_REJOIN = "no_rejoin"  # the route was not rejoined in time
    GOAL_BEHIND = "goal_behind"  # no point of the route lies ahead
    GOAL_TOO_FAR = "goal_too_far"  # no point of the route can be reached in time
    # the route ends before the plan does, and may not be extended
    ROUTE_TOO_SHORT = "route_too_short"
    DEADLINE = "deadline"  # the computation ended before everything was searched
    # an intruder is closer than the separation at the request already, or an area forbids the
    # place of the ownship
    START_IN_VIOLATION = "start_in_violation"


class Subject(Enum):
    """A part of a request; the value is what messages call it."""

    OWN = "own"
    OWN_ALTITUDE = "own_altitude"
    INTRUDERS = "intruders"
    ROUTE = "route"
    WIND = "wind"
    AREAS = "areas"
    OPTIONS = "options"


@dataclass(frozen=True, slots=True)
class Field:
    """What a refusal or an advisory is about, such as ``intruders[2].altitude.value``."""

    subject: Subject
    name: str = ""
    """Of the part of the subject, such as ``altitude.value``; empty: the whole of it."""
    number: int | None = None
    """Of the intruder, the area or the route's point; None: the subject is not one of several."""

    def part(self, name: str) -> "Field":
        """Return a part of this field."""
        # A request of a hundred aircraft names a thousand parts: not by replace.
        return Field(self.subject, f"{self.name}.{name}" if self.name else name, self.number)

    def within(self, subject: str) -> str:
        """Return the name of the field where its subject goes by another name."""
        return f"{subject}.{self.name}" if self.name else subject

    def __str__(self) -> str:
        """Return the name of the field in the request."""
        number = "" if self.number is None else f"[{self.number}]"
        return self.within(f"{self.subject.value}{number}")


class RequestError(ValueError):
    """A request that cannot be planned for; the message says what was expected of ``field``, such
    as ``own.speed``.
    """

    def __init__(self, field: Field | str, problem: str) -> None:
        super().__init__(f"{field} {problem}")
        self.field = str(field)
        self.problem = problem  # the sentence without its subject, the field
        self.about = field if isinstance(field, Field) else None  # None: no part of the request


class AdvisoryCode(IntEnum):
    """What an advisory is about."""

    POLICY_UNSAFE = 1  # the policy's own plan was not safe, and another is given
    OUTSIDE_DOMAIN = 2  # the policy was not trained for this
    ASSUMED = 3  # something is unknown, and the worst that is plausible was taken
    TIME_UNCERTAIN = 4  # when a report held is known to within some time only
    WIND_UNKNOWN = 5  # the wind is unknown: any within a stated size may blow
    POSSIBLE_COPY = 6  # an intruder may be a copy of the ownship
    PASSED_OVER = 7  # a point of the route lies in an area and is left out
    OWN_SEPARATION = 8  # an intruder is kept another separation from than the others
    SKIPPED = 9  # the plan does not fly over a point of the route


class Advisory(NamedTuple):
    """What the operator should know; it does not make a plan less safe."""

    code: AdvisoryCode
    field: Field | str
    """What it is about: a field of the request, or a name."""
    text: str
    """A sentence without its subject, the field."""

    @property
    def message(self) -> str:
        """The whole sentence."""
        return f"{self.code.name.lower()}: {self.field} {self.text}"


@dataclass(frozen=True, slots=True)
class Reason:
    """One thing that is wrong, with its first time and place where there is one."""

    kind: Kind
    field: str
    """What it is about: ``waypoints[3]``, ``intruders[0]``, ``areas[1]``, ``route``."""
    message: str
    time: float | None = None
    """s after the request."""
    x: float | None = None
    """East, m."""
    y: float | None = None
    """North, m."""

    @classmethod
    def of(cls, kind: Kind, field: str, text: str, *place: float) -> "Reason":
        """Return a reason whose message begins with the field; ``place`` is time, x and y, or
        nothing.
        """
        return cls(kind, field, f"{field} {text}", *place)


class Apart(Enum):
    """How an intruder stays out of the way."""

    VERTICALLY = "vertically"  # it stays above or below
    FAR = "far"  # both together cannot fly as far as they are apart


@dataclass(frozen=True, slots=True)
class Excluded:
    """An intruder that the plan takes no account of."""

    number: int  # its place in the request
    reason: str
    until: float  # until when it stays out of the way, s after the request
    apart: Apart = Apart.VERTICALLY


class Counts(NamedTuple):
    """When an intruder counts that is above or below at other times."""

    number: int  # its place in the request
    begin: float  # s after the request
    end: float  # inf: for good


class Flight(NamedTuple):
    """Which flight a certificate belongs to, as far as that is known."""

    policy: str | None  # SHA-256 of the policy
    time_ns: int | None  # of the request, ns since 1970
    latitude: float | None  # of the local frame's origin, degrees
    longitude: float | None


UNKNOWN_FLIGHT = Flight(None, None, None, None)


class Evidence(Protocol):
    """All that a certificate is made of."""

    def certificate(self, flight: Flight) -> bytes:
        """Return the certificate of the plan as it was made, as of a flight."""
        ...


@dataclass(frozen=True, slots=True)
class Plan:
    """The answer to a request."""

    status: Status
    """SAFE only if the validator found nothing wrong."""
    source: Source
    reasons: tuple[Reason, ...]
    """Why the plan is not safe; empty for a safe one."""
    min_separation: float
    """Smallest distance to any intruder while it counts, m, whatever separation each has; inf
    without intruders, nan without a trajectory.
    """
    time_of_min_separation: float
    """s after the request; nan where there is none."""
    goal_index: int | None
    """Index of the route's point at which the route is rejoined; None without a trajectory."""
    rejoin_time: float
    """When that is, s after the request; nan without a trajectory."""
    excluded: tuple[Excluded, ...]
    waypoints: tuple[Waypoint, ...]
    """As many as asked for, the last of them a point of the route; none where no trajectory could
    be made.
    """
    cost: float = float("nan")
    """Extra path, time and reversals as metres (:mod:`agents.planner.search.candidates`)."""
    advisories: tuple[Advisory, ...] = ()
    """What the operator should know, such as that the policy's own plan was not safe."""
    unsearched: tuple[str, ...] = ()
    """What the deadline left out or cut short: ``policy``, ``fallback``, ``refinement``, ``goal
    2``, ...
    """
    windows: tuple[Counts, ...] = ()
    """When those intruders count that do so for a while only: until then, and after, they are above
    or below by their vertical separation.
    """
    policy_sha256: str | None = None
    """Of the policy that was asked."""
    wind: Wind | None = None
    """That the legs between the waypoints are flown in (:mod:`envs.waypoints`); None: still air."""
    evidence: Evidence | None = field(default=None, repr=False, compare=False)
    """What a SAFE plan can be proven from anew; None of any other."""

    @property
    def safe(self) -> bool:
        """Whether it may be flown."""
        return self.status is Status.SAFE

    @property
    def certificate(self) -> bytes | None:
        """What ``python -m agents.check`` proves the plan from, made when it is asked for; None
        unless it is SAFE.
        """
        return self.certificate_with()

    def certificate_with(
        self, time_ns: int | None = None, origin: tuple[float, float] | None = None
    ) -> bytes | None:
        """Return the certificate with the time of the request, ns since 1970, and the place of the
        local frame's origin, degrees north and east; None unless the plan is SAFE.
        """
        if not self.safe or self.evidence is None:
            return None
        return self.evidence.certificate(
            Flight(self.policy_sha256, time_ns, *(origin or (None, None)))
        )
