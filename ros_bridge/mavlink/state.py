"""What the program keeps from one event to the next; never changed in place."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Concatenate, NamedTuple, ParamSpec

from agents.assurance.thresholds import Cause
from envs.formats.areas.geodetic import GeodeticArea
from ros_bridge.core.fields import SECOND
from ros_bridge.core.freshness import Freshness
from ros_bridge.mavlink.clocks import NO_TIME, Spent
from ros_bridge.mavlink.control import Control
from ros_bridge.mavlink.effects import Effect
from ros_bridge.mavlink.intake import Reading, Received
from ros_bridge.mavlink.judging import Judgement, Rules
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.pilot import Pilot
from ros_bridge.mavlink.refresh import Refresh
from ros_bridge.mavlink.vehicle import Vehicle
from ros_bridge.mavlink.view import View

LATE = 1.5
"""Between two judgements, which are due every quarter of a second, s of the autopilot's clock: more
means that the program does not keep up, and for :data:`RECOVERED` no plan is called safe.
"""

RECOVERED = 5.0
"""For how long it must have kept up after it has been late, s."""

_P = ParamSpec("_P")


@dataclass(frozen=True)
class Setup:
    """What stays the same throughout a flight."""

    rules: Rules  # how it is watched and planned
    vehicle: Vehicle
    reading: Reading
    system: int  # our number
    beat: float  # between two heartbeats of ours, s
    margin: float  # kept from areas, m
    deadline: float  # computation in which a plan must be found, s

    @property
    def fresh(self) -> Freshness:
        """How old what is known may be."""
        return self.rules.settings.freshness


class Leg(NamedTuple):
    """The leg that is flown."""

    item: int  # that it leads to
    began: tuple[float, float]  # latitude and longitude, degrees


@dataclass(frozen=True)
class Pace:
    """Whether the program keeps up; s on the autopilot's clock."""

    judged: float = 0.0  # when the last judgement began
    late: float = -math.inf  # when it was late last
    failing: float = math.inf  # since when judgements fail; infinite: they do not
    spent: Spent = NO_TIME  # when it was measured last

    def keeps_up(self, time: int) -> bool:
        """Return whether it has not been late for :data:`RECOVERED` at a time, ns."""
        return not 0.0 <= time / SECOND - self.late <= RECOVERED


@dataclass(frozen=True)
class TextRecord:
    """What was said, so that nothing is said too often."""

    at: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """When a kind of text was told last, s on the autopilot's clock."""
    once: frozenset[str] = frozenset()  # what is said only once
    causes: frozenset[Cause] = frozenset()  # why the monitor was not content
    fence: tuple[GeodeticArea, ...] = ()  # whose areas that do not count were told


@dataclass(frozen=True)
class State:
    """What is known, judged, flown and said."""

    judgement: Judgement
    items: tuple[Item, ...] = ()  # of the mission
    corners: tuple[Item, ...] = ()  # of the fence
    fly: bool = False  # whether a plan may be flown
    received: Received = field(default_factory=Received)
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    doubted: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Reports of a receiver beside the autopilot's own, as :class:`ros_bridge.mavlink.view.View`
    has them.
    """
    control: Control = field(default_factory=Control)
    pilot: Pilot = field(default_factory=Pilot)
    refresh: Refresh = field(default_factory=Refresh)
    pace: Pace = field(default_factory=Pace)
    texts: TextRecord = field(default_factory=TextRecord)
    leg: Leg | None = None
    entered_auto: float = -math.inf  # when AUTO was entered last, s on the autopilot's clock
    moved: bool = False  # whether a new place has come since the last tick
    beat_at: float = 0.0  # when our heartbeat was sent last, s of our clock
    rates_at: float = 0.0  # when the autopilot was asked for its messages last, s of our clock

    def is_safe(self, time: int) -> bool:
        """Return whether there is a plan that may be called safe at a time, ns."""
        return self.judgement.safe and self.pace.keeps_up(time)

    def without_plan(self, rules: Rules) -> "State":
        """Return the state without a plan, whose next one gets another revision."""
        revision = self.judgement.supervision.revision
        return replace(self, judgement=Judgement(replace(rules.begin(), revision=revision)))

    def view(self, time: int) -> View:
        """Return what is known at a time, ns."""
        left_out = Counter(self.received.left_out) + Counter(self.left_out)
        parts = (self.received, self.judgement, self.control, self.items)
        return View(time, *parts, left_out, self.doubted)


class Advance(NamedTuple):
    """The state after an event or a part of it, and what is to be done, in this order."""

    state: State
    effects: tuple[Effect, ...] = ()

    def then(
        self, part: Callable[Concatenate[State, _P], "Advance"], *args: _P.args, **named: _P.kwargs
    ) -> "Advance":
        """Return what comes of a part that goes on from this state."""
        after = part(self.state, *args, **named)
        return Advance(after.state, self.effects + after.effects)
