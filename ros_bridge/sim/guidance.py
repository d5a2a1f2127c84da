"""Which trajectory is to be flown, as an autopilot reads it from the runner and the monitor.

Nothing but a SAFE plan that the monitor names, or the monitor's backup, and nothing where the
monitor has fallen silent: nobody watches the plan any more. Where no monitor is to be asked the
newest SAFE plan until it is withdrawn. Messages are read by their fields; nothing here needs ROS.
"""

from typing import TYPE_CHECKING, NamedTuple

from agents.kernel.levels import Altitude
from envs.aircraft import Vertical
from envs.formats.local_frame import LocalFrame
from envs.frames import Air
from envs.profile import Profile, profile_of
from envs.waypoints import Legs, Waypoint, legs, plan_states
from envs.wind import NO_WIND, Wind
from ros_bridge.core.conversions import STATUS_SAFE, STATUS_WITHDRAWN, trajectory
from ros_bridge.core.fields import SECOND, FieldError, nanoseconds
from ros_bridge.core.freshness import USUAL_FRESHNESS
from ros_bridge.core.replies import to_frame, wind_of

if TYPE_CHECKING:
    from rlcas_msgs.msg import AssuranceStatus, Trajectory

FLY_PLAN, FLY_BACKUP = 1, 2
_REMEMBERED = 8  # plans; the monitor names one of the last two


class Guidance:
    """Selects among plans and backups what the monitor names, or without a monitor the
    newest plan; times are ns.
    """

    def __init__(self, *, monitored: bool = True, silence: float = USUAL_FRESHNESS.monitor) -> None:
        self._monitored, self._most = monitored, silence
        self._heard = 0
        self._plans: dict[bytes, Trajectory] = {}
        self._newest: Trajectory | None = None
        self.backup: Trajectory | None = None  # the monitor's last; None: there has been none
        self.status: AssuranceStatus | None = None  # likewise

    def add_plan(self, message: "Trajectory") -> bool:
        """Take in a trajectory of the runner's; return whether it is a SAFE plan."""
        if message.status == STATUS_WITHDRAWN:
            self._newest = None
        if message.status != STATUS_SAFE:
            return False
        self._plans[bytes(message.id.uuid)] = self._newest = message
        while len(self._plans) > _REMEMBERED:
            del self._plans[next(iter(self._plans))]
        return True

    def hear(self, status: "AssuranceStatus", moment: int) -> None:
        """Take in what the monitor says; one that is latched is as old as it says."""
        self.status, self._heard = status, min(moment, nanoseconds(status.header.stamp))

    @property
    def has_plan(self) -> bool:
        """Whether there is something that could be flown."""
        return self._newest is not None or self.backup is not None

    def problem(self, moment: int) -> str:
        """Return why nobody watches what is flown, a sentence; "": somebody does, or need not."""
        if not self._monitored:
            return ""
        if self.status is None:
            return "no monitor has been heard of"
        silence = (moment - self._heard) / SECOND
        return f"the monitor has been silent for {silence:.1f} s" if silence > self._most else ""

    def select(self, moment: int) -> "Trajectory | None":
        """Return the trajectory that is to be flown now; None: nothing, or what is named has not
        arrived yet.
        """
        if not self._monitored:
            return self._newest
        if self.problem(moment):
            return None
        if self.status is not None and self.status.fly == FLY_PLAN:
            return self._plans.get(bytes(self.status.trajectory_id.uuid))
        if self.status is not None and self.status.fly == FLY_BACKUP:
            return self.backup
        return None


class Flying(NamedTuple):
    """What is flown."""

    legs: Legs[Air]  # through the air, which lies over the ground when they begin
    began: int  # when that is, ns
    wind: Wind | None  # None: still air
    waypoints: tuple[Waypoint, ...] = ()
    # of the ownship when they begin, in whose reference the waypoints climb; None: in the plane
    altitude: Altitude | None = None

    def profile(self, vertical: Vertical | None) -> Profile | None:
        """Return the altitude that an aircraft flies, s after the beginning; None: in the plane.

        Raises:
            FieldError: it cannot climb, or not reach the first waypoint's altitude.
        """
        if self.altitude is None:
            return None
        if vertical is None:
            limitation = (
                "climb, expected a plan in the plane: the aircraft states no limits of climb"
            )
            raise FieldError("trajectory.waypoints", limitation)
        value, climb = self.altitude.value, self.altitude.climb(0.0)[0]
        try:
            return profile_of(value, climb, self.waypoints, vertical.acceleration)
        except ValueError as problem:
            raise FieldError("trajectory.waypoints[0].altitude", str(problem)) from None

    def legs_after(self, seconds: float) -> Legs[Air]:
        """Return the legs in the air mass that lay over the ground so long before they begin."""
        blows = self.wind or NO_WIND
        return self.legs._replace(
            x=self.legs.x - blows.east * seconds, y=self.legs.y - blows.north * seconds
        )


def curve(frame: LocalFrame, message: "Trajectory") -> Flying:
    """Return what a plan or a backup is in a local frame, or raise :class:`FieldError`."""
    plan = trajectory(message)
    if not plan.points:
        raise FieldError("trajectory.waypoints", "has 0 points, expected 1 or more")
    wind = wind_of(frame, plan)
    own, waypoints = to_frame(frame, plan)
    through_air = legs(plan_states(own, waypoints, wind=wind))
    altitude = plan.start.altitude if plan.climbs else None
    return Flying(through_air, plan.began, wind, waypoints, altitude)
