"""What of a receiver's aircraft is traffic, whatever the format of its feed.

A receiver sees all that flies or taxies around it, also the ownship. What is no traffic is left out
and counted; of unusable messages name and place are kept.
"""

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from agents.planner.request.request import Altitude
from envs.traffic.track_units import FOOT
from ros_bridge.core.conversions import report
from ros_bridge.core.fields import SECOND, FieldError, Sighting, attempt, readable
from ros_bridge.core.ground import on_ground
from ros_bridge.core.reports import Report

__all__ = [
    "LATEST",
    "OWN_TRACES",
    "WITHOUT_POSITION",
    "Stream",
    "Target",
    "Traffic",
    "nameless",
    "remember",
]

_T = TypeVar("_T")

LATEST = 30.0
"""Delay, s, beyond which a receiver's stream is given up: either that much is queued, or its clock
has jumped.
"""

OWN_TRACES = frozenset(
    {"own echo", "copy of the ownship", "repeated position", "repeated document"}
)
"""Reasons to leave out what is no other aircraft, or nothing new of one."""

WITHOUT_POSITION = "without a position"
"""Why an aircraft is left out of which nobody knows where it is."""

_NAMELESS = "without an address"  # under which its place is told
_SAME_TIME = 6.0  # s, between reports of the ownship and of its copy
_NEW = SECOND * 3 // 20
"""A position is a new one when it is this much later, ns: times are rounded to 0.1 s."""

_MOST = 4096  # aircraft that are remembered
_MOST_OWN = 16  # names of the ownship that feeds have told

# Within these of the ownship, a track of TIS-B is a copy of it.
_COPY_DISTANCE = 600.0  # m
_COPY_VELOCITY = 15.0  # m/s
_COPY_HEIGHT = 500 * FOOT  # m

# Within these of where a feed has its ownship, an aircraft of that name is the ownship.
_OWN_DISTANCE = 1_000  # m
_OWN_SPEED = 100.0  # m/s

_OLDEST = 60.0  # s; receivers forget positions that are older
_OBSTACLES = (19, 20, 21)  # emitter categories C3 to C5; tethered balloons are C3


@dataclass(frozen=True)
class Target(ABC):
    """An aircraft as a message of a feed tells of it; what cannot be read raises
    :class:`FieldError` when it is asked for. A format says in its own class what it has.
    """

    name: str
    """Under which the aircraft goes; of an ICAO address the same in every feed."""
    heard: int
    """When its position held, ns; where its age is unknown, when it arrived."""
    aged: bool
    """Whether that age is known; if not, the aircraft cannot be planned with."""

    def is_grounded(self) -> bool:
        """Return whether the message has it on the ground."""
        return False

    def is_by_radar(self) -> bool:
        """Return whether the position is a radar's, which may be a copy of another aircraft."""
        return False

    def has_place(self) -> bool:
        """Return whether the message has a position, readable or not."""
        return True

    def time(self) -> int:
        """Return when the position held, ns."""
        if not self.aged:
            problem = "is unknown, expected the age of the position"
            raise FieldError(f"{self.field}.age", problem)
        return self.heard

    @abstractmethod
    def place(self) -> tuple[float, float]:
        """Return latitude and longitude, degrees."""

    @abstractmethod
    def speed(self) -> float | None:
        """Return the speed over the ground, m/s; None: unknown."""

    @abstractmethod
    def velocity(self) -> tuple[float, float]:
        """Return true east and north, m/s."""

    @abstractmethod
    def climb(self) -> float | None:
        """Return the vertical speed, m/s; None: unknown."""

    @abstractmethod
    def altitude(self, reference: str | None) -> Altitude | None:
        """Return the altitude of a reference if there is one of it, or else what there is; None:
        unknown.
        """

    def position_std(self) -> float | None:
        """Return one sigma of the position per axis, m; None: unknown."""
        return None

    def velocity_std(self) -> float | None:
        """Return one sigma of the velocity per axis, m/s; None: unknown."""
        return None

    def time_std(self) -> float:
        """Return one sigma of the time, s."""
        return 0.0

    def category(self) -> int:
        """Return the emitter category; 0: unknown."""
        return 0

    def callsign(self) -> str:
        """Return the callsign; "": unknown."""
        return ""

    @property
    def field(self) -> str:
        """What its fields' names begin with in messages."""
        return f"adsb {self.name}"


class Traffic:
    """Decides which of the aircraft received are traffic, and makes their reports.

    Attributes:
        own: the ownship as others know it, to be kept up to date; None: unknown.
        counts: of what was left out, by the reason.
        doubted: of what was taken although a field forbids it.

    Args:
        own_id: the ownship's address; "": unknown.
        shows_own: whether the ownship's reports are wanted too, as by a display.
        companion: of another feed with the same ownship: what one feed says of it, the other knows.
    """

    def __init__(
        self, own_id: str, *, shows_own: bool = False, companion: "Traffic | None" = None
    ) -> None:
        self.own: Report | None = None
        self.counts: Counter[str] = Counter()
        self.doubted: Counter[str] = Counter()
        self.own_id = own_id.strip().lower()
        self._shows_own = shows_own
        self._told_own: dict[str, Report | None] = {} if companion is None else companion._told_own
        self._reported: dict[str, int] = {}

    def begin_anew(self) -> None:
        """Forget when aircraft were reported, because the clock has stepped back."""
        self._reported.clear()
        self._told_own.clear()

    def is_own(self, name: str) -> bool:
        """Return whether a name is the ownship's, which a feed's own messages say where nobody
        else does.
        """
        return name == self.own_id if self.own_id else name in self._told_own

    def ownship(self, target: Target) -> Report | FieldError | None:
        """Take in what a feed says of its own aircraft, which is no traffic; return its report, or
        why it cannot be used, where that is wanted.
        """
        outcome = attempt(lambda: self._read(target))
        usable = outcome if isinstance(outcome, Report) and target.has_place() else None
        remember(self._told_own, target.name, usable, _MOST_OWN)
        is_ownship = self._shows_own and self.is_own(target.name) and target.has_place()
        return outcome if is_ownship and self._is_new(target) else None

    def report(self, target: Target) -> Report | None:
        """Return an aircraft's report, or raise :class:`FieldError`; None where it is no traffic,
        or repeated.
        """
        reason = self._reason_left_out(target)
        if reason:
            self.counts[reason] += 1
            return None
        try:
            usable = self._read(target)
        except FieldError as error:
            if not target.aged and error.sighting is not None:
                oldest = target.heard - int(_OLDEST * SECOND)
                error.sighting = error.sighting._replace(time=oldest)
            raise
        if target.is_by_radar() and self._is_copy(usable):
            self.counts["copy of the ownship"] += 1
            return None
        remember(self._reported, target.name, target.heard)
        return usable

    def _reason_left_out(self, target: Target) -> str:
        """Return why an aircraft is no traffic, as it is counted; "": it is."""
        if self._is_echo(target):
            return "own echo"
        if target.is_grounded():
            if self._on_ground(target):
                return "on the ground"
            self.doubted["said to be on the ground, but flies"] += 1
        if not target.has_place():
            return WITHOUT_POSITION
        return "" if self._is_new(target) else "repeated position"

    def _is_new(self, target: Target) -> bool:
        return target.heard >= self._reported.get(target.name, 0) + _NEW

    def _is_echo(self, target: Target) -> bool:
        """Return whether an aircraft is the ownship: by the name that the user, or whoever has its
        state, gives it; by the one that a feed gives it only where that feed has it too, or else
        whoever has its state.
        """
        if self._shows_own and target.name == self.own_id and target.name not in self._told_own:
            return False
        if target.name in (self.own_id, "" if self.own is None else self.own.identifier):
            return True
        if target.name not in self._told_own:
            return False
        own = self._told_own[target.name] or self.own
        position = attempt(target.place) if target.has_place() else None
        if own is None or position is None or isinstance(position, FieldError):
            return True  # nothing says that it is anybody else
        seconds = abs(target.heard - own.time) / SECOND
        if own.off(position, target.heard) <= _OWN_DISTANCE + _OWN_SPEED * seconds:
            return True
        self.doubted["of the ownship's address, but elsewhere"] += 1
        return False

    def _on_ground(self, target: Target) -> bool:
        """Return whether an aircraft is believed to be on the ground, as its message says; what
        cannot be read contradicts it.
        """
        try:
            if target.category() in _OBSTACLES:
                return False
            altitude = target.altitude(self._reference)
            value = None if altitude is None else altitude.value
            return on_ground(target.speed(), target.climb(), value, altitude, self.own)
        except FieldError:
            return False

    @property
    def _reference(self) -> str | None:
        """Of the ownship's altitude; None: unknown."""
        return (
            None if self.own is None or self.own.altitude is None else self.own.altitude.reference
        )

    def _read(self, target: Target) -> Report:
        return report(
            target.name,
            target.time,
            target.place,
            target.velocity,
            lambda: target.altitude(self._reference),
            position_std=target.position_std,
            velocity_std=target.velocity_std,
            time_std=target.time_std,
            category=target.category,
            callsign=target.callsign,
        )

    def _is_copy(self, candidate: Report) -> bool:
        """Return whether a report is about where the ownship is, as fast and known to be as
        high.
        """
        own = self.own
        if own is None or abs(candidate.time - own.time) > _SAME_TIME * SECOND:
            return False
        a, b = own.altitude, candidate.altitude
        if a is None or b is None or a.reference != b.reference:
            return False
        return (
            own.off(candidate.place, candidate.time) <= _COPY_DISTANCE
            and math.hypot(candidate.east - own.east, candidate.north - own.north) <= _COPY_VELOCITY
            and abs(a.value - b.value) <= _COPY_HEIGHT
        )


class Stream:
    """What readers of all formats have in common: the traffic, and how late a message is.

    A message is as late as it arrives later than the quickest one, whatever the receiver's clock or
    time zone shows.
    """

    def __init__(self, traffic: Traffic) -> None:
        self._traffic = traffic
        self.begin()

    def begin(self) -> None:
        """Forget the delays of an earlier connection."""
        self._least = math.inf

    def begin_anew(self) -> None:
        """Forget all that hangs on our clock, which has stepped back."""
        self.begin()
        self._traffic.begin_anew()

    def _time(self, sent: float, arrived: int) -> int:
        """Return when a message held, ns, that was sent at the receiver's time, s, and arrived at
        ours, ns.
        """
        self._least = min(self._least, arrived - sent * SECOND)
        late = arrived - sent * SECOND - self._least
        if late > LATEST * SECOND:
            raise TimeoutError(f"is {late / SECOND:.0f} s late, expected {LATEST:g} s at most")
        return arrived - int(late)

    def _reports(self, target: Target) -> Iterator[Report | FieldError]:
        outcome = attempt(lambda: self._traffic.report(target))
        if outcome is not None:
            yield outcome


def remember(store: dict[str, _T], name: str, value: _T, capacity: int = _MOST) -> _T:
    """Hold a value under a name, and return it; of too many those that were heard longest ago are
    dropped.
    """
    store.pop(name, None)
    store[name] = value
    if len(store) > capacity:
        del store[next(iter(store))]
    return value


def nameless(
    field: str, problem: str, time: int, place: Callable[[], tuple[float, float]]
) -> FieldError:
    """Return why an aircraft without an address cannot be used, with its place at a time, ns, if
    that can be read.
    """
    error, location = FieldError(field, problem), readable(place)
    error.sighting = None if location is None else Sighting(_NAMELESS, time, location)
    return error
