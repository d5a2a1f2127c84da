"""What a certificate states."""

from typing import NamedTuple

FORMAT = "RLCAS plan certificate 4"
ARCS = 10  # of a leg


class Limits(NamedTuple):
    """Of every arc, m/s, m/s^2, rad/s."""

    speed_min: float
    speed_max: float
    acceleration_min: float
    acceleration_max: float
    yaw_rate_max: float


class Requirement(NamedTuple):
    """What is to be kept from the intruders."""

    separation: float  # from those without one of their own, m
    margin: float  # m
    sigmas: float  # of the uncertainty that adds to it


class Wind(NamedTuple):
    """Velocity of the air over the ground."""

    east: float  # m/s
    north: float
    std: float  # one sigma of both


class PlanState(NamedTuple):
    """The ownship at the request, or a waypoint."""

    x: float  # m
    y: float
    heading: float  # rad
    speed: float  # m/s
    time: float  # s after the request


class Report(NamedTuple):
    """An intruder as it was reported."""

    x: float  # m
    y: float
    heading: float  # rad
    speed: float  # m/s
    age: float  # of the report at the request, s
    turn_rate: float  # rad/s
    turn_time: float  # for which it turns after the report, s
    position_std: float  # m
    velocity_std: float  # m/s
    separation: float  # that is to be kept from it, m


class Heights(NamedTuple):
    """Of the ownship and of an intruder, as near to each other as they may be."""

    own: float  # m
    own_climb: float  # m/s
    other: float  # m
    other_climb: float  # m/s
    age: float  # of the other's report at the request, s
    vertical: float  # separation that is to be kept, m


class Apart(NamedTuple):
    """A time in which an intruder stays above or below."""

    number: int  # of the intruder
    begin: float  # s after the request
    end: float
    heights: Heights


class Area(NamedTuple):
    """What must not be entered, or not be left, as it is at the request over the ground."""

    keep: str  # "out" or "in"
    circle: list[float]  # x, y, radius, m; empty: a polygon
    rings: list[list[list[float]]]  # of x and y, m; the outer one first
    velocity: list[float]  # towards the east and the north, m/s
    growth: float  # to all sides, m/s
    clearance: float  # m
    valid: list[float | None]  # from and until when, s; null: always
    heights: list[float | None]  # floor and ceiling, m; null: none, or not comparable


class Levels(NamedTuple):
    """Between which the ownship is, by a time t after the request."""

    low: float  # m
    low_climb: float  # m/s
    high: float
    high_climb: float


class Profile(NamedTuple):
    """What a plan that climbs and descends is flown with; its altitude and climb at the request are
    the middle of the levels.
    """

    altitudes: list[float]  # of the waypoints, m
    climb: float  # at the request, m/s
    climb_max: float  # m/s
    descent_max: float  # m/s
    acceleration: float  # of changes of climb, m/s^2
    margin: float  # by which the ownship leaves the profile at most, corners included, m
    floor: float | None  # m; None: none
    ceiling: float | None


class Origin(NamedTuple):
    """Which flight the certificate belongs to, as far as its request said so."""

    policy: str | None  # SHA-256
    time_ns: int | None  # of the request, ns since 1970
    latitude: float | None  # of the frame's origin, degrees
    longitude: float | None


class Certificate(NamedTuple):
    """Everything that a certificate states, in its order."""

    request: Origin
    plan_states: list[PlanState]  # the ownship at the request, then the waypoints
    controls: list[list[float]]  # of each leg: ten turn rates, then ten accelerations
    reports: list[Report]
    excluded: list[Heights]
    apart: list[Apart]
    requirement: Requirement
    limits: Limits  # of the flight through the air
    wind: Wind
    areas: list[Area]
    levels: Levels | None  # of the ownship; None: unknown
    profile: Profile | None  # None: the plan is one in the plane
    parts: int  # into which an arc is cut at most
    bounds: list[float]  # of the distance from each intruder, m

    @property
    def end(self) -> float:
        """When the plan ends, s after the request."""
        return self.plan_states[-1].time
