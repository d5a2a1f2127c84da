"""What the autopilot is told while a conflict lasts: to leave its mission, roll, airspeed and
altitude of the plan, and the way back to its mission.

Pure: a :class:`Pilot` follows from the one before.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from envs.backend import FLOATS
from envs.perception import carry_back
from ros_bridge.core.conversions import Published
from ros_bridge.core.fields import SECOND
from ros_bridge.core.motion import to_local
from ros_bridge.core.reports import Report
from ros_bridge.mavlink import messages, mission
from ros_bridge.mavlink.effects import Effect, Log, Reposition, SetCurrent, SetMode, Steer
from ros_bridge.mavlink.intake import Received
from ros_bridge.mavlink.judging import Judgement, LocalPlan, Rejoin, local_plan
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.steering import (
    Air,
    Follower,
    PlannedHeight,
    Steered,
    command,
    errors,
    guide,
    sense,
)
from ros_bridge.mavlink.vehicle import Vehicle

_SPEED = 0.5  # s between two airspeeds, and two altitudes
_HEARD = 4.0  # s within which the autopilot's target has an altitude that it was told
_SETTLED = 2.0  # s after the first altitude, from which on its target must have one of ours
_SAME_ALTITUDE = 1.0  # m
_BANK_MAX = math.radians(50.0)


class Followed(NamedTuple):
    """A plan or backup that is flown."""

    key: tuple[str, int]  # as of :class:`ros_bridge.mavlink.judging.LocalPlan`
    follower: Follower


@dataclass(frozen=True)
class Pilot:
    """How far it has come with taking over, steering and giving back; never changed in place."""

    steered_at: float = 0.0  # when it was steered last, s
    airspeed_at: float = 0.0  # when the last airspeed was sent, s
    left_at: int | None = None  # item at which GUIDED has left the mission; None: it has not
    asked_for: int | None = None  # item at which AUTO was asked to go on
    replaced: bool = False  # whether somebody else has uploaded another mission since it was left
    targets: frozenset[tuple[int, int]] = frozenset()  # that it was sent to, 1e-7 degrees
    altitudes: tuple[tuple[float, float], ...] = ()  # that it was told last, s and m
    reached_ours: bool = False  # whether one of them has been its target in GUIDED
    followed: Followed | None = None
    air: Air = field(default_factory=Air)


class Piloted(NamedTuple):
    """The pilot after a step, and what is to be done."""

    pilot: Pilot
    effects: tuple[Effect, ...] = ()


def take_over(
    pilot: Pilot, plan: Published | None, own: Report | None, offset: float = 0.0
) -> Piloted:
    """Ask for GUIDED, with the last point of a plan as its target, at the ownship's altitude;
    ``offset`` is what the autopilot adds to altitudes, ALT_OFFSET, m.
    """
    if plan is None or own is None or own.altitude is None:
        return Piloted(pilot)
    point = plan.points[-1]
    demanded = replace(own.altitude, value=own.altitude.value - offset)
    target = messages.target(point.latitude, point.longitude, demanded)
    targets = pilot.targets | {(target.latitude, target.longitude)}
    return Piloted(replace(pilot, targets=targets), (Reposition(target),))


def note_target(pilot: Pilot, target: tuple[int, int] | None) -> Pilot:
    """Note the autopilot's target in GUIDED."""
    return replace(pilot, reached_ours=pilot.reached_ours or target in pilot.targets)


def is_diverted(
    pilot: Pilot, target: tuple[int, int] | None, altitude: float | None, seconds: float
) -> bool:
    """Return whether the autopilot has had our target in GUIDED, and now has another one; or,
    while it is told altitudes, another altitude, m above mean sea level.
    """
    if pilot.reached_ours and target not in pilot.targets:
        return True
    demanded = pilot.altitudes
    if altitude is None or not demanded or seconds - demanded[0][0] < _SETTLED:
        return False
    heights = [height for _, height in demanded]
    return not min(heights) - _SAME_ALTITUDE <= altitude <= max(heights) + _SAME_ALTITUDE


def steer(
    pilot: Pilot, judgement: Judgement, received: Received, vehicle: Vehicle, time: int
) -> Piloted:
    """Command roll, airspeed and altitude of what is to be flown; ``time`` is the autopilot's,
    ns.
    """
    report = received.situation.own.last
    if report is None:
        return Piloted(pilot)
    plan = local_plan(judgement)
    if plan is None:
        return Piloted(pilot)
    follower, lines = _follow(pilot, plan, vehicle, time)
    age = (time - report.time) / SECOND
    state = carry_back(to_local(plan.frame, report), -age, FLOATS)
    clock, seconds = (time - plan.began) / SECOND, time / SECOND
    airspeed = received.airspeed
    air = sense(pilot.air, state, report.wind, airspeed)
    demand, follower = command(follower, state, clock, air, vehicle, _BANK_MAX)
    off = errors(follower, state, clock)
    above = _above(follower, report, age, clock)
    if demand.altitude is not None:
        demand = demand._replace(altitude=demand.altitude - received.altitude_offset)
    steered = Steered(seconds, *off, state.speed, airspeed or math.nan, demand, above)
    with_speed = not 0.0 <= seconds - pilot.airspeed_at < _SPEED
    steered_pilot = replace(
        pilot,
        steered_at=seconds,
        airspeed_at=seconds if with_speed else pilot.airspeed_at,
        altitudes=_told_last(pilot, demand.altitude, seconds) if with_speed else pilot.altitudes,
        followed=Followed(plan.key, follower),
        air=air,
    )
    return Piloted(steered_pilot, (*lines, Steer(steered, time // 1_000_000, with_speed)))


def _above(follower: Follower, report: Report, age: float, clock: float) -> float:
    """Return by how much the ownship, whose report is so old, s, is above its plan at a time of the
    plan's clock, s, m; nan: the plan is in the plane, or the altitude is unknown.
    """
    if follower.height is None or report.altitude is None:
        return math.nan
    height = report.altitude.value + report.altitude.climb(0.0)[0] * age
    return height - follower.height.at(clock).altitude


def _told_last(
    pilot: Pilot, altitude: float | None, seconds: float
) -> tuple[tuple[float, float], ...]:
    """Return the altitudes that the autopilot has been told last, with one of a moment; none where
    it is told none.
    """
    if altitude is None:
        return ()
    last = (entry for entry in pilot.altitudes if 0.0 <= seconds - entry[0] <= _HEARD)
    return (*last, (seconds, altitude))


def give_back(pilot: Pilot, current: int, rejoin: Rejoin | None, items: Sequence[Item]) -> Piloted:
    """Ask for AUTO, at the item after the rejoin point unless somebody else has set one."""
    to_auto = SetMode(messages.Mode.AUTO)
    ours = pilot.left_at is None or current in (pilot.left_at, pilot.asked_for)
    if not ours or pilot.replaced or rejoin is None or rejoin.point is None:
        return Piloted(pilot, (to_auto,))
    goes_on = mission.item_after_rejoin(rejoin.point, items)
    number = min(goes_on, items[-1].number)  # beyond its end, at its last item
    return Piloted(replace(pilot, asked_for=number), (SetCurrent(number), to_auto))


def release(pilot: Pilot) -> Pilot:
    """Forget what was flown, after it has ended."""
    return replace(
        pilot,
        left_at=None,
        asked_for=None,
        replaced=False,
        targets=frozenset[tuple[int, int]](),
        altitudes=(),
        reached_ours=False,
    )


def _follow(
    pilot: Pilot, plan: LocalPlan, vehicle: Vehicle, time: int
) -> tuple[Follower, tuple[Log, ...]]:
    """Return the follower of what is to be flown, a new one, which is logged, where that is
    another.
    """
    if pilot.followed is not None and pilot.followed.key == plan.key:
        return pilot.followed.follower, ()
    text, height = f"flying {plan.key[0]} {plan.key[1]}", None
    if plan.profile is not None and vehicle.aircraft.vertical is not None:
        height = PlannedHeight(plan.profile, vehicle.aircraft.vertical.acceleration)
        low, high = plan.profile.altitude.min(), plan.profile.altitude.max()
        text += f", {low:.0f} to {high:.0f} m above mean sea level"
    follower = guide(plan.own, plan.waypoints, plan.wind, height)
    return follower, (Log(text, time),)
