"""What happens to the program: what :func:`ros_bridge.mavlink.advance.advance` takes in."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from ros_bridge.core.fields import FieldError
from ros_bridge.core.reports import Report
from ros_bridge.mavlink.clocks import Moment, Spent
from ros_bridge.mavlink.judging import Judgement, Question

if TYPE_CHECKING:
    from pymavlink.dialects.v20 import ardupilotmega as dialect


@dataclass(frozen=True)
class Listening:
    """The program is about to listen to the autopilot."""

    ours: float  # our clock, s
    silent: float  # for how long nothing of the autopilot's has come, s of our clock


@dataclass(frozen=True)
class Message:
    """A message of the autopilot, or through it, has come."""

    message: "dialect.MAVLink_message"
    time: int  # of the autopilot, ns


@dataclass(frozen=True)
class Restart:
    """The autopilot, and with it its clock, has begun anew."""

    time: int  # of the autopilot, ns


@dataclass(frozen=True)
class LiveReport:
    """A receiver beside the autopilot's own has brought a report, or why one cannot be used."""

    report: Report | FieldError
    time: int  # of the autopilot, ns


@dataclass(frozen=True)
class Tick:
    """The time has gone on, and everything that has come has been taken in."""

    moment: Moment


@dataclass(frozen=True)
class Look:
    """What lies ahead is to be judged; the answer to :class:`ros_bridge.mavlink.effects.Judge`."""

    moment: Moment
    problem: str = ""  # of the receiver beside the autopilot's own; "": none
    foreign: bool = False  # whether somebody else has sent under the autopilot's numbers
    left_out: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """How many reports of that receiver were not taken as traffic, by the reason."""
    doubted: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """How many were, although a field forbids it."""


@dataclass(frozen=True)
class Answer:
    """A question has been answered."""

    question: Question
    judgement: Judgement
    took: Spent


@dataclass(frozen=True)
class Judged:
    """A judgement has ended."""

    began: int  # ns, on the autopilot's clock
    moment: Moment  # when it ended
    failure: str = ""  # the error of our own that has ended it; "": none


@dataclass(frozen=True)
class ShowingFailed:
    """What only shows has failed for an error of our own."""

    text: str
    time: int  # of the autopilot, ns


Event = Listening | Message | Restart | LiveReport | Tick | Look | Answer | Judged | ShowingFailed
