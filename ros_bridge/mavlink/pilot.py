"""What the autopilot is told while a conflict lasts: to leave its mission, roll and airspeed of the
plan, and the way back to its mission.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from envs.backend import FLOATS
from envs.perception import carry_back
from ros_bridge.core.conversions import Published
from ros_bridge.core.fields import SECOND
from ros_bridge.core.motion import to_local
from ros_bridge.core.reports import Report
from ros_bridge.mavlink import messages, mission
from ros_bridge.mavlink.intake import Received
from ros_bridge.mavlink.judging import Judgement, Rejoin, ToFly, to_follow
from ros_bridge.mavlink.link import Link
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.steering import Air, Command, Follower, command, errors, guide, sense
from ros_bridge.mavlink.texts import Texts
from ros_bridge.mavlink.vehicle import Vehicle

_SPEED = 0.5  # s between two airspeeds
_BANK_MAX = math.radians(50.0)


class Steered(NamedTuple):
    """A period of the follower."""

    time: float  # s
    cross_track: float  # m
    along_track: float
    late: float  # s
    speed: float  # over the ground, m/s
    airspeed: float
    told: Command


class _Followed(NamedTuple):
    """A plan or backup that is flown."""

    what: ToFly
    follower: Follower


class Pilot:
    """Takes over from the mission, steers, and gives back.

    Attributes:
        steered: the last periods of the follower.
        steered_at: when it was steered last, s.
        left_at: item of the mission at which GUIDED has left it; None: it has not.
        replaced: whether somebody else has uploaded another mission since then.
    """

    def __init__(self, link: Link, texts: Texts, vehicle: Vehicle) -> None:
        self._link, self._texts, self._vehicle = link, texts, vehicle
        self.steered: deque[Steered] = deque(maxlen=20_000)
        self.steered_at = 0.0
        self.left_at: int | None = None
        self.replaced = False
        self._asked_for: int | None = None  # item at which we have asked AUTO to go on
        self._targets: set[tuple[int, int]] = set()  # that it has been sent to, 1e-7 degrees
        self._reached_ours = False  # whether one of them has been its target in GUIDED
        self._followed: _Followed | None = None
        self._air = Air()
        self._airspeed_at = 0.0  # when the last airspeed was sent, s

    def take_over(self, held: Published | None, own: Report | None) -> None:
        """Ask for GUIDED, with the last point of a plan as its target."""
        if held is None or own is None or own.altitude is None:
            return
        point = held.points[-1]
        target = messages.target(point.latitude, point.longitude, own.altitude)
        self._targets.add((target.latitude, target.longitude))
        self._link.reposition(target)

    def note_current(self, before: int, current: int, now: int) -> None:
        """Note, in GUIDED, at which item it has left the mission, and say which one somebody else
        sets meanwhile: the autopilot itself sets none.
        """
        if self.left_at is None:
            self.left_at = current
        elif current not in (before, self.left_at):
            what = f"item {current} set by others"
            self._texts.tell(what, f"{what}: AUTO goes on there", now, send=True)

    def is_diverted(self, target: tuple[int, int] | None) -> bool:
        """Return whether the autopilot has had our target in GUIDED, and now has another one."""
        ours = target in self._targets
        self._reached_ours = self._reached_ours or ours
        return self._reached_ours and not ours

    def steer(self, judgement: Judgement, received: Received, now: int) -> None:
        """Command roll and airspeed of what is to be flown."""
        wanted, report = to_follow(judgement), received.situation.own.last
        if wanted is None or report is None:
            return
        follower = self._follow(wanted, now)
        age = (now - report.time) / SECOND
        state = carry_back(to_local(wanted.frame, report), -age, FLOATS)
        clock = (now - wanted.began) / SECOND
        speeds = self._vehicle.airspeed_min, self._vehicle.airspeed_max
        airspeed = received.airspeed
        self._air = sense(self._air, state, report.wind, airspeed)
        told = command(follower, state, clock, self._air, speeds, _BANK_MAX)
        self.steered_at = seconds = now / SECOND
        off = errors(follower, state, clock)
        self.steered.append(Steered(seconds, *off, state.speed, airspeed or math.nan, told))
        with_speed = not 0.0 <= seconds - self._airspeed_at < _SPEED
        if with_speed:
            self._airspeed_at = seconds
        self._link.steer(told, now // 1_000_000, speed=with_speed)

    def give_back(self, current: int, rejoin: Rejoin | None, items: Sequence[Item]) -> None:
        """Ask for AUTO, at the item after the rejoin point unless somebody else has set one."""
        ours = self.left_at is None or current in (self.left_at, self._asked_for)
        if ours and not self.replaced and rejoin is not None and rejoin.point is not None:
            goes_on = mission.item_after_rejoin(rejoin.point, items)
            self._asked_for = min(goes_on, items[-1].number)  # beyond its end, at its last item
            self._link.set_current(self._asked_for)
        self._link.set_mode(messages.Mode.AUTO)

    def release(self) -> None:
        """Forget what was flown, after it has ended."""
        self.left_at = self._asked_for = None
        self.replaced = self._reached_ours = False
        self._targets.clear()

    def _follow(self, wanted: ToFly, now: int) -> Follower:
        """Return the follower of what is to be flown, a new one where that is another."""
        if self._followed is None or self._followed.what.key != wanted.key:
            follower = guide(wanted.own, wanted.waypoints, wanted.wind)
            self._followed = _Followed(wanted, follower)
            self._texts.log(f"flying {wanted.key[0]} {wanted.key[1]}", now)
        return self._followed.follower
