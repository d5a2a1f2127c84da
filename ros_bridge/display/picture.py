"""The picture: what the page draws, and nothing that it does not.

Places are metres east and north of the picture's origin on its map
(:mod:`envs.formats.local_frame`), directions degrees clockwise from true north, speeds m/s, times
s. Numbers are rounded to what the page shows, so that advice agrees with the numbers beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from agents.assurance.state import FlyMode, State
from envs.areas import Keep

Point = Sequence[float]
"""``[x, y]``, m; of a line ``[x, y, time]``."""


def tenths(value: float) -> float:
    """Return a number as the page shows it."""
    return round(float(value), 1)


class Velocity(NamedTuple):
    """A direction and a speed: through the air where the wind is known, else over the ground."""

    track_deg: float
    speed: float


class DrawnPlane(NamedTuple):
    """An aircraft."""

    id: str
    callsign: str  # "": unknown
    x: float
    y: float
    vx: float
    vy: float
    track_deg: float
    speed: float  # over the ground
    turn_deg: float = 0.0  # deg/s, positive to the left
    turn_s: float = 0.0  # for how long it is expected to turn on, s
    altitude: float | None = None  # m, now
    reference: str | None = None  # what it is above
    climb: float | None = None  # m/s
    age: float = 0.0  # of its report
    state: Literal["fresh", "coasting", "stale", "faulty"] = "fresh"
    fault: str = ""  # "": none
    accuracy: float | None = None  # two sigmas of the position now, m; None: unknown
    correction: str = ""  # what is not believed as it is reported; "": all is


class DrawnOwnship(NamedTuple):
    """The ownship."""

    plane: DrawnPlane
    air: Velocity


class Threat(NamedTuple):
    """What an alert says of an intruder or an area."""

    level: int  # 0: there is no alert
    loss: float | None  # until the separation is lost; None: it is not


NO_THREAT = Threat(0, None)


class DrawnIntruder(NamedTuple):
    """An aircraft of the traffic."""

    plane: DrawnPlane
    threat: Threat
    relative_altitude: float | None = None  # m above the ownship; None: not comparable
    separation: float | None = None  # that is kept from it, m; None: as from others
    proximate: bool = False  # near without an alert


class DrawnPoint(NamedTuple):
    """A waypoint of a drawn plan."""

    number: int
    x: float
    y: float
    remaining: float  # until it is reached
    track_deg: float | None = None  # over the ground, as the speed
    speed: float | None = None
    air: Velocity | None = None
    of_route: bool = False
    altitude: float | None = None  # m, as of the ownship's; None: the plan is in the plane


class DrawnPlan(NamedTuple):
    """A plan, backup or best known trajectory."""

    revision: int
    began: float  # time of the source's clock
    line: Sequence[Point]
    points: Sequence[DrawnPoint]
    # ``[time, altitude]``, s of the source's clock and m as of the ownship's, of the start and of
    # each waypoint; None: the plan is in the plane, or its altitudes cannot be compared
    profile: Sequence[Point] | None = None


class Disc(NamedTuple):
    """The shape of a round area, m."""

    x: float
    y: float
    radius: float


class Outline(NamedTuple):
    """The shape of any other area."""

    rings: Sequence[Sequence[Point]]


class DrawnArea(NamedTuple):
    """An area as it is now."""

    name: str
    keep: Keep
    valid: bool  # now
    clearance: float  # m
    shape: Disc | Outline
    growth: float = 0.0  # m/s
    grown: float = 0.0  # m to all sides, which the rings do not have yet
    floor: tuple[float, str] | None = None  # m, and what it is above
    ceiling: tuple[float, str] | None = None


class Tape(NamedTuple):
    """Bands of one kind."""

    target: Sequence[float]
    region: Sequence[int]  # codes of GuidanceBands
    area: Sequence[int] | None  # which of the areas closes each; -1: none; None: not told


class WayOut(NamedTuple):
    """The direction that recovers the separation first where no direction is free."""

    track_deg: float
    after: float | None  # None: not within the look-ahead
    shortfall: float  # m less than required until then


class DrawnBands(NamedTuple):
    """Guidance bands."""

    age: float
    look_ahead: float
    tracks: Tape
    speeds: Tape
    areas: Sequence[str]  # that close bands or lie ahead
    recovery: WayOut | None
    climbs: Tape | None = None  # vertical speeds; None: there are no bands of them
    altitudes: Tape | None = None  # as of the ownship's; None: none that can be compared


class DrawnMonitor(NamedTuple):
    """What the monitor says of the plan."""

    age: float
    state: State | None  # None: it is silent
    fly: FlyMode
    reasons: Sequence[str]
    remarks: Sequence[str]  # which ask for nothing
    measured: bool
    cross_track: float  # m to the left of the plan
    along_track: float  # m
    time_error: float  # late
    separation: float | None  # m
    time_to_loss: float | None
    altitude_error: float | None = None  # m above the plan; None: not measured


class DrawnAlert(NamedTuple):
    """An alert that is not 0."""

    id: str
    of: Literal["intruder", "area"]
    threat: Threat


class HealthLine(NamedTuple):
    """What is said of an input or a node."""

    name: str
    level: int  # as of DiagnosticStatus
    text: str
    age: float | None  # since it was heard; None: never


@dataclass(frozen=True, kw_only=True)
class Picture:
    """Everything at one time; every picture is whole: one that is lost changes nothing."""

    time: float  # of the source's clock
    separation: float | None  # that is kept from others, m
    monitor: DrawnMonitor | None = None
    health: Sequence[HealthLine] = ()
    origin: tuple[float, float] | None = None  # latitude and longitude; None: there is no map
    own: DrawnOwnship | None = None
    traffic: Sequence[DrawnIntruder] = ()
    wind: tuple[float, float] | None = None  # velocity of the air, east and north; None: unknown
    plan: DrawnPlan | None = None
    backup: DrawnPlan | None = None  # while it is to be flown
    unresolved: DrawnPlan | None = None  # the best known where no plan is safe
    route: Sequence[Point] = ()
    goal: Point | None = None  # of an evaluation, and its radius
    areas: Sequence[DrawnArea] = ()
    bands: DrawnBands | None = None
    alerts: Sequence[DrawnAlert] = ()  # the highest level first
