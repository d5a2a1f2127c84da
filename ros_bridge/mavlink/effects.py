"""What is to be done: what :func:`ros_bridge.mavlink.advance.advance` asks for.

:mod:`ros_bridge.mavlink.program` carries it out, in the order in which it is asked for.
"""

from dataclasses import dataclass

from ros_bridge.core.conversions import Published
from ros_bridge.mavlink.clocks import Moment, Spent
from ros_bridge.mavlink.judging import Question
from ros_bridge.mavlink.messages import Target
from ros_bridge.mavlink.steering import Steered
from ros_bridge.mavlink.view import View

# What the autopilot is asked.


@dataclass(frozen=True)
class Beat:
    """Send our heartbeat."""


@dataclass(frozen=True)
class AskRates:
    """Ask the autopilot for its messages, at their rates."""


@dataclass(frozen=True)
class AskItem:
    """Ask for an item of the mission or fence, or for their count."""

    kind: int  # MAV_MISSION_TYPE
    number: int | None  # None: the count


@dataclass(frozen=True)
class Thank:
    """Acknowledge a mission or fence."""

    kind: int  # MAV_MISSION_TYPE


# What the autopilot is told to do.


@dataclass(frozen=True)
class Reposition:
    """Let it change to GUIDED and fly to a place."""

    target: Target


@dataclass(frozen=True)
class Steer:
    """Send the roll, and with ``speed`` the airspeed and the altitude, of a period of the
    follower.
    """

    steered: Steered
    boot_ms: int  # the autopilot's time
    speed: bool


@dataclass(frozen=True)
class SetMode:
    """Ask for a mode of ArduPlane."""

    mode: int


@dataclass(frozen=True)
class SetCurrent:
    """Let its mission go on at an item."""

    number: int


# What is said and written.


@dataclass(frozen=True)
class Say:
    """Send a text to the ground station."""

    text: str


@dataclass(frozen=True)
class Log:
    """Write a line on the output."""

    text: str
    time: int | None = None  # ns, that the line begins with; None: nothing


@dataclass(frozen=True)
class WritePlan:
    """Write a plan into the file of the plan, if there is to be one."""

    plan: Published


@dataclass(frozen=True)
class NotePlanned:
    """Keep what a plan took from its request."""

    took: Spent


@dataclass(frozen=True)
class Show:
    """Show what is known."""

    view: View


# What is to be worked out. Each is the last effect of its event, and the answer is another event.


@dataclass(frozen=True)
class Judge:
    """Begin a judgement with :class:`ros_bridge.mavlink.events.Look`, and end it with
    :class:`ros_bridge.mavlink.events.Judged`, whatever fails in between.
    """

    moment: Moment


Sent = Beat | AskRates | AskItem | Thank | Reposition | Steer | SetMode | SetCurrent | Say
"""What goes to the autopilot, or through it."""

Effect = Sent | Log | WritePlan | NotePlanned | Show | Judge | Question
