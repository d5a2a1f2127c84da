"""What the page advises by a picture: what to fly until the next waypoint, what follows, and
whether it is flown or only advice.

Directions and speeds are in the frame of the picture, as every
:class:`~ros_bridge.display.picture.Velocity` of it.
"""

import itertools
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from agents.assurance.alerts import Region
from agents.assurance.state import FlyMode, State
from ros_bridge.display.picture import DrawnBands, DrawnPlan, Picture, Point, Velocity, WayOut

_HELD_COURSE = 2.0  # degrees; turns smaller than this are none
_HELD_SPEED = 1.5  # m/s; changes smaller than this are none
_HELD_CLIMB = 0.25  # m/s; climbs smaller than this are level flight, and changes of them are none


class Do(Enum):
    """What is advised; the values are the codes of the document."""

    NOTHING = "nothing"
    OWN_ROUTE = "own route"
    PLAN = "plan"
    BACKUP = "backup"
    ADVISED = "advised"  # a plan that nobody flies
    FREE = "free"  # the nearest free direction
    RECOVERY = "recovery"  # no direction is free


class Side(Enum):
    """To which side to turn."""

    LEFT = "left"
    RIGHT = "right"
    HOLD = "hold"


class Rise(NamedTuple):
    """A climb, a descent or level flight."""

    climb: float  # m/s; 0: level
    altitude: float | None  # at which it ends, or that is held, m; None: any


LEVEL = Rise(0.0, None)


class Change(NamedTuple):
    """A turn onto a direction, and a speed."""

    turn: Side
    velocity: Velocity
    rise: Rise | None = None  # None: altitudes are not planned


class NextChange(NamedTuple):
    """The first change after the next waypoint."""

    change: Change
    remaining: float  # until it begins, s


class Advice(NamedTuple):
    """What to do."""

    do: Do
    change: Change | None = None
    then: NextChange | None = None  # of a trajectory
    way_out: WayOut | None = None  # of a recovery


NOTHING = Advice(Do.NOTHING)


def advise(picture: Picture) -> Advice:
    """Return what to do by a picture."""
    if picture.own is None:
        return NOTHING
    own, monitor, bands = picture.own.air, picture.monitor, picture.bands
    silent = monitor is None or monitor.state is None
    if monitor is not None:
        plan, code = _plan_to_fly(picture, monitor.fly)
        if plan is not None:
            # A backup without altitudes of its own levels off where the ownship may climb.
            level = LEVEL if code is Do.BACKUP and bands is not None and bands.climbs else None
            return _follow(plan, own, code, level)
        if monitor.state is State.MONITORING and picture.plan is not None:
            return _follow(picture.plan, own, Do.ADVISED)
    if bands is not None and picture.alerts:
        return _by_bands(bands, own, picture.own.plane.climb)
    return NOTHING if silent else Advice(Do.OWN_ROUTE)


def _plan_to_fly(picture: Picture, mode: FlyMode) -> tuple[DrawnPlan | None, Do]:
    """Return the trajectory that is to be flown, and its code; None: there is none."""
    if mode is FlyMode.PLAN:
        return picture.plan, Do.PLAN
    if mode is FlyMode.BACKUP:
        return picture.backup, Do.BACKUP
    return None, Do.NOTHING


class _Leg(NamedTuple):
    """What is flown to a waypoint."""

    remaining: float  # until it is reached, s
    velocity: Velocity
    rise: Rise | None


def _follow(plan: DrawnPlan, own: Velocity, do: Do, level: Rise | None = None) -> Advice:
    """Return what a trajectory asks for until its next waypoint, and the first change after it;
    ``level`` is what one in the plane asks for in height.
    """
    rises = [level] * len(plan.points) if plan.profile is None else _rises(plan.profile)
    coming = [
        _Leg(point.remaining, point.air, rise)
        for point, rise in zip(plan.points, rises, strict=True)
        if point.remaining > 0.0 and point.air
    ]
    if not coming:
        return Advice(do, Change(Side.HOLD, own, level))
    first = coming[0]
    change = Change(_turn(own, first.velocity.track_deg), first.velocity, first.rise)
    return Advice(do, change, _first_change(coming))


def _rises(profile: Sequence[Point]) -> list[Rise]:
    """Return what a profile asks for to each waypoint: its climb, and the altitude at which the
    aircraft has climbed or descended.
    """
    rises = list[Rise]()
    for (begin, low), (end, high) in reversed([*itertools.pairwise(profile)]):
        climb = (high - low) / max(end - begin, 1e-6)
        climb = 0.0 if abs(climb) < _HELD_CLIMB else round(climb, 2)
        goes_on = bool(rises) and rises[-1].climb * climb > 0.0
        rises.append(Rise(climb, rises[-1].altitude if goes_on else high))
    return rises[::-1]


def _first_change(coming: Sequence[_Leg]) -> NextChange | None:
    """Return the first change between waypoints; None: all courses and climbs are the same."""
    for before, after in itertools.pairwise(coming):
        turn = _turn(before.velocity, after.velocity.track_deg)
        faster = abs(after.velocity.speed - before.velocity.speed) > _HELD_SPEED
        if turn is not Side.HOLD or faster or _climbs_otherwise(before.rise, after.rise):
            return NextChange(Change(turn, after.velocity, after.rise), before.remaining)
    return None


def _climbs_otherwise(before: Rise | None, after: Rise | None) -> bool:
    if before is None or after is None:
        return False
    return abs(after.climb - before.climb) > _HELD_CLIMB


def _by_bands(bands: DrawnBands, own: Velocity, climb: float | None) -> Advice:
    """Return the free direction that is nearest to the present one; where none is free the free
    vertical speed that is nearest, or else the way out. Bands are through the air.
    """
    out = bands.recovery
    if out is not None:
        rise = _free_climb(bands, climb)
        if rise is not None:
            return Advice(Do.FREE, Change(Side.HOLD, own, rise))
        return Advice(Do.RECOVERY, _onto(own, out.track_deg), way_out=out)
    rows = zip(bands.tracks.target, bands.tracks.region, strict=True)
    free = [target for target, region in rows if region == Region.FREE]
    if not free:
        return NOTHING
    nearest = min(free, key=lambda target: abs(_apart(own.track_deg, target)))
    return Advice(Do.FREE, _onto(own, nearest))


def _free_climb(bands: DrawnBands, climb: float | None) -> Rise | None:
    """Return the free vertical speed that is nearest to the present one; None: there is none."""
    if bands.climbs is None or climb is None:
        return None
    rows = zip(bands.climbs.target, bands.climbs.region, strict=True)
    free = [target for target, region in rows if region == Region.FREE]
    return Rise(min(free, key=lambda target: abs(target - climb)), None) if free else None


def _onto(own: Velocity, track: float) -> Change:
    """Return the turn onto a direction at the present speed."""
    return Change(_turn(own, track), Velocity(track, own.speed))


def _apart(track: float, target: float) -> float:
    """Return the turn from one track to another, degrees, positive to the right."""
    return (target - track + 180.0) % 360.0 - 180.0


def _turn(course: Velocity, track: float) -> Side:
    apart = _apart(course.track_deg, track)
    if abs(apart) <= _HELD_COURSE:
        return Side.HOLD
    return Side.RIGHT if apart > 0.0 else Side.LEFT
