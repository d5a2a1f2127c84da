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
from ros_bridge.display.picture import DrawnBands, DrawnPlan, Picture, Velocity, WayOut

_HELD_COURSE = 2.0  # degrees; turns smaller than this are none
_HELD_SPEED = 1.5  # m/s; changes smaller than this are none


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


class Change(NamedTuple):
    """A turn onto a direction, and a speed."""

    turn: Side
    velocity: Velocity


class NextChange(NamedTuple):
    """The first change after the next waypoint."""

    change: Change
    left: float  # until it begins, s


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
    own, monitor = picture.own.air, picture.monitor
    silent = monitor is None or monitor.state is None
    if monitor is not None:
        flown, code = _flown(picture, monitor.fly)
        if flown is not None:
            return _along(flown, own, code)
        if monitor.state is State.MONITORING and picture.plan is not None:
            return _along(picture.plan, own, Do.ADVISED)
    if picture.bands is not None and picture.alerts:
        return _by_bands(picture.bands, own)
    return NOTHING if silent else Advice(Do.OWN_ROUTE)


def _flown(picture: Picture, mode: FlyMode) -> tuple[DrawnPlan | None, Do]:
    """Return the trajectory that is to be flown, and its code; None: there is none."""
    if mode is FlyMode.PLAN:
        return picture.plan, Do.PLAN
    if mode is FlyMode.BACKUP:
        return picture.backup, Do.BACKUP
    return None, Do.NOTHING


def _along(plan: DrawnPlan, own: Velocity, do: Do) -> Advice:
    """Return what a trajectory asks for until its next waypoint, and the first change after it."""
    coming = [(point.left, point.air) for point in plan.points if point.left > 0.0 and point.air]
    if not coming:
        return Advice(do, Change(Side.HOLD, own))
    _, course = coming[0]
    return Advice(do, Change(_turn(own, course.track_deg), course), _first_change(coming))


def _first_change(coming: Sequence[tuple[float, Velocity]]) -> NextChange | None:
    """Return the first change between waypoints, by the time that is left and the course at each;
    None: all courses are the same.
    """
    for (left, before), (_, after) in itertools.pairwise(coming):
        turn = _turn(before, after.track_deg)
        if turn is not Side.HOLD or abs(after.speed - before.speed) > _HELD_SPEED:
            return NextChange(Change(turn, after), left)
    return None


def _by_bands(bands: DrawnBands, own: Velocity) -> Advice:
    """Return the free direction that is nearest to the present one, or the way out; bands are
    through the air.
    """
    out = bands.recovery
    if out is not None:
        return Advice(Do.RECOVERY, _onto(own, out.track_deg), way_out=out)
    rows = zip(bands.tracks.target, bands.tracks.region, strict=True)
    free = [target for target, region in rows if region == Region.FREE]
    if not free:
        return NOTHING
    nearest = min(free, key=lambda target: abs(_apart(own.track_deg, target)))
    return Advice(Do.FREE, _onto(own, nearest))


def _onto(own: Velocity, track: float) -> Change:
    """Return the turn onto a direction at the present speed."""
    return Change(_turn(own, track), Velocity(track, own.speed))


def _apart(track: float, other: float) -> float:
    """Return the turn from one track to another, degrees, positive to the right."""
    return (other - track + 180.0) % 360.0 - 180.0


def _turn(course: Velocity, track: float) -> Side:
    apart = _apart(course.track_deg, track)
    if abs(apart) <= _HELD_COURSE:
        return Side.HOLD
    return Side.RIGHT if apart > 0.0 else Side.LEFT
