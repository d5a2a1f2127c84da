"""The connection: everything that is received and sent, by pymavlink.

The clock is the autopilot's own, which begins at its start: a step of the date, here or there,
changes nothing. What is late on the link is known by the quickest message before.
"""

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from commands.command import InputError
from ros_bridge.core.fields import SECOND
from ros_bridge.mavlink import messages
from ros_bridge.mavlink.download import Download, accept
from ros_bridge.mavlink.mission import Item
from ros_bridge.mavlink.steering import Command
from ros_bridge.mavlink.udp import Listener

os.environ.setdefault("MAVLINK20", "1")  # before pymavlink: messages of both versions are read

COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
_DRIFT = 1e-4  # of two clocks, s per s: a message so much later is no later
_BACK = 5  # s by which a clock that steps back has begun anew; less is out of order
_MEASURED = 3.0  # s over which the clock's speed is measured
_PATIENCE = 5.0  # s for an answer
_TRIES = 5
_TEXT = 50  # characters of a STATUSTEXT
_RECONNECT = 0.2  # s between two attempts
RACING = 2.0
"""Times real time; a simulation that runs faster is warned of."""

MISSION, FENCE = 0, 1
"""MAV_MISSION_TYPE."""

_MAGIC_1 = 0xFE  # which messages of MAVLink 1 begin with
_NO_VALUE = float("nan")
RATES = {
    "HEARTBEAT": 5.0,
    "GLOBAL_POSITION_INT": 10.0,
    "VFR_HUD": 10.0,
    "WIND": 1.0,
    "SYSTEM_TIME": 1.0,
    "EKF_STATUS_REPORT": 5.0,
    "GPS_RAW_INT": 5.0,
    "MISSION_CURRENT": 2.0,
    "POSITION_TARGET_GLOBAL_INT": 2.0,
    "ADSB_VEHICLE": 10.0,
}
"""Of the messages that are asked for, 1/s."""

TRAFFIC = frozenset(
    {
        "ADSB_VEHICLE",
        "OPEN_DRONE_ID_BASIC_ID",
        "OPEN_DRONE_ID_LOCATION",
        "OPEN_DRONE_ID_MESSAGE_PACK",
    }
)
"""Messages of traffic, which receivers beside the autopilot send too."""


class LinkError(InputError):
    """A connection that cannot be opened, or an autopilot that does not answer as expected."""


class Clock:
    """The autopilot's clock, ns, as of the messages that arrive.

    Attributes:
        begun: how often it has begun, as it does where the autopilot begins anew.
        speed: how many times as fast as ours it ran of late.

    Args:
        simulated: whether its time is a simulation's, which may run faster: it then stands still
            between two messages.
    """

    def __init__(self, *, simulated: bool = False) -> None:
        self._simulated = simulated
        self._newest = 0
        self._offset: float | None = None  # ours less its, s, of the quickest message
        self._heard = 0.0
        self._from: tuple[int, float] | None = None  # its time, ns, and ours, s
        self.begun = 0
        self.speed = 1.0

    def hear(self, boot: int, arrived: float) -> bool:
        """Take in a time of its clock, ns, and of ours, s; return whether it has begun anew."""
        restarted = boot < self._newest - _BACK * SECOND
        offset = arrived - boot / SECOND
        if self._offset is None or restarted:
            self._offset = offset
            self.begun += 1
        else:
            self._offset = min(offset, self._offset + _DRIFT * (arrived - self._heard))
        self._newest = boot if restarted else max(boot, self._newest)
        self._heard = arrived
        self._measure_speed(boot, arrived, restarted)
        return restarted

    def _measure_speed(self, boot: int, arrived: float, restarted: bool) -> None:
        if self._from is None or restarted:
            self._from = boot, arrived
        elif arrived - self._from[1] >= _MEASURED:
            self.speed = (boot - self._from[0]) / SECOND / (arrived - self._from[1])
            self._from = boot, arrived

    @property
    def races(self) -> bool:
        """Whether a simulation runs so fast that what is computed takes much of its time."""
        return self._simulated and self.speed > RACING

    def now(self, ours: float) -> int:
        """Return its time at a time of ours, s; 0 before the first message."""
        if self._offset is None:
            return 0
        if self._simulated:
            return self._newest
        return max(self._newest, round((ours - self._offset) * SECOND))


class Link:
    """A connection to one autopilot.

    Args:
        address: as pymavlink takes it, such as ``udp:0.0.0.0:14550``, ``tcp:127.0.0.1:5760`` or
            ``/dev/ttyAMA0``.
        baud: of a serial port.
        system: our own number.
        simulated: as of :class:`Clock`.
    """

    def __init__(
        self, address: str, *, baud: int = 57_600, system: int = 1, simulated: bool = False
    ) -> None:
        from pymavlink import mavutil

        self.clock = Clock(simulated=simulated)
        self.heard = 0.0  # when a message of the autopilot arrived last, s of our clock
        self.bad = 0  # messages that could not be read
        self.foreign = 0  # messages under the autopilot's numbers that another sender has sent
        self._texts = 0  # number of the last long text
        self._mavlink: Any = mavutil.mavlink
        check_address(address)
        kind, _, location = address.partition(":")
        try:
            if kind in ("udp", "udpin"):
                host, _, port = location.rpartition(":")
                self._connection: Any = Listener(
                    (host, int(port)), mavutil.mavlink, system, COMPONENT
                )
            else:
                self._connection = mavutil.mavlink_connection(
                    address,
                    baud=baud,
                    source_system=system,
                    source_component=COMPONENT,
                    autoreconnect=True,
                    retries=1,
                )
        except (OSError, ValueError, IndexError) as error:
            reason = str(error) or type(error).__name__
            raise LinkError(f"--connect {address}: cannot be opened: {reason}") from None
        self.system = self.component = 0
        self._first_version = False  # whether the autopilot speaks MAVLink 1

    def find(self, patience: float) -> None:
        """Wait for the heartbeat of an autopilot of ArduPilot, and learn its numbers, or raise
        :class:`LinkError`.
        """
        until, mismatch = time.monotonic() + patience, ""
        while time.monotonic() < until:
            message = self._next(0.2)
            self.beat()
            if message is None or message.get_type() != "HEARTBEAT":
                continue
            if message.get_srcComponent() != 1 or message.type in (6, 18):
                continue
            if message.autopilot != self._mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA or message.type != 1:
                mismatch = (
                    f"a heartbeat of autopilot {message.autopilot}, type {message.type} came; "
                    "expected ArduPilot's (3) of a fixed wing (1)"
                )
                continue
            self.system, self.component = message.get_srcSystem(), message.get_srcComponent()
            self._note_autopilot(message)
            return
        raise LinkError(
            f"no autopilot was found within {patience:g} s: {mismatch or 'no heartbeat came'}"
        )

    def beat(self) -> None:
        """Send our own heartbeat, as a companion computer."""
        m = self._mavlink
        self._send(
            self._connection.mav.heartbeat_send,
            m.MAV_TYPE_ONBOARD_CONTROLLER,
            m.MAV_AUTOPILOT_INVALID,
            0,
            0,
            m.MAV_STATE_ACTIVE,
        )

    def receive(self, until: float) -> Iterator[tuple[Any, int]]:
        """Yield messages of the autopilot, and those of traffic of anybody (:data:`TRAFFIC`), with
        its time of arrival, ns, until a time of our clock, s.
        """
        while True:
            message = self._next(max(until - time.monotonic(), 0.0))
            if message is None:
                if time.monotonic() >= until:
                    return
                continue
            own = self._is_autopilot(message)
            if not own and message.get_type() not in TRAFFIC:
                continue  # other components of its system have states and clocks of their own
            arrived = time.monotonic()
            if own and message.get_type() in ("GLOBAL_POSITION_INT", "SYSTEM_TIME"):
                self.clock.hear(messages.boot_time(message), arrived)
            yield message, self.clock.now(arrived)

    # Questions.

    def ask_rates(self) -> None:
        """Ask for the messages that are read, at their rates."""
        for name, rate in RATES.items():
            number = getattr(self._mavlink, f"MAVLINK_MSG_ID_{name}")
            self.command(511, number, 1e6 / rate)

    def parameters(self) -> dict[str, float]:
        """Return the autopilot's parameters, or raise :class:`LinkError`."""
        values: dict[str, float] = {}
        missing: Any = None
        mav = self._connection.mav
        fruitless = 0  # tries in a row, of a link that loses some
        while fruitless < _TRIES:
            previous_count = len(values)
            if missing is None:
                self._send(mav.param_request_list_send, self.system, self.component)
            else:
                for number in sorted(missing)[:50]:
                    self._send(
                        mav.param_request_read_send, self.system, self.component, b"", number
                    )
            for message in self._answers("PARAM_VALUE"):
                value = float(message.param_value)
                if not math.isfinite(value):
                    raise LinkError(f"parameter {message.param_id} is {value}; expected a number")
                values[message.param_id] = value
                if missing is None:
                    missing = set(range(message.param_count))
                missing.discard(message.param_index)
                if not missing:
                    return values
            fruitless = fruitless + 1 if len(values) == previous_count else 0
        count = "any" if missing is None else f"{len(missing)}"
        raise LinkError(f"parameters: the autopilot has not sent {count} of them; expected all")

    def mission(self) -> tuple[Item, ...]:
        """Return the items of the mission, or raise :class:`LinkError`."""
        return self._download(MISSION)

    def fence(self) -> tuple[Item, ...]:
        """Return the items of the fence, or raise :class:`LinkError`."""
        if self._first_version:
            raise LinkError(
                "the fence: the autopilot's port speaks MAVLink 1, which has none; expected "
                "MAVLink 2 (SERIALn_PROTOCOL 2)"
            )
        return self._download(FENCE)

    def ask_item(self, kind: int, number: int | None) -> None:
        """Ask for an item of a mission or fence, or for their count, without waiting for it."""
        mav, to = self._connection.mav, (self.system, self.component)
        if number is None:
            self._send(mav.mission_request_list_send, *to, kind)
        else:
            self._send(mav.mission_request_int_send, *to, number, kind)

    def thank(self, kind: int) -> None:
        """Acknowledge a mission or fence that has come whole."""
        self._send(self._connection.mav.mission_ack_send, self.system, self.component, 0, kind)

    def _download(self, kind: int) -> tuple[Item, ...]:
        """Return the items of a mission or fence, waiting for them."""
        name = "the fence" if kind else "the mission"
        download, fruitless = Download(kind), 0
        while not download.complete:
            number = None if download.count is None else len(download.items)
            expected = "MISSION_COUNT" if number is None else "MISSION_ITEM_INT"
            if fruitless == _TRIES:
                raise LinkError(f"{name}: the autopilot has not answered; expected {expected}")
            self.ask_item(kind, number)
            before, fruitless = download, fruitless + 1
            for message in self._answers(expected):
                download = accept(before, message)
                if download is not before:
                    fruitless = 0
                    break
        self.thank(kind)
        return download.items

    def _answers(self, kind: str) -> Iterator[Any]:
        """Yield messages of a kind of the autopilot until none comes any more for a while."""
        until = time.monotonic() + _PATIENCE / _TRIES
        while time.monotonic() < until:
            message = self._next(0.1)
            self._beat_now_and_then()
            if message is None or message.get_type() != kind or not self._is_autopilot(message):
                continue
            until = time.monotonic() + _PATIENCE / _TRIES
            yield message

    _beaten = 0.0

    def _beat_now_and_then(self) -> None:
        if time.monotonic() - self._beaten > 0.5:
            self._beaten = time.monotonic()
            self.beat()

    # Orders.

    def command(self, number: int, *values: float) -> None:
        """Send a COMMAND_LONG."""
        padded = [*values, *[0.0] * (7 - len(values))]
        self._send(
            self._connection.mav.command_long_send, self.system, self.component, number, 0, *padded
        )

    def reposition(self, target: messages.Target) -> None:
        """Let the autopilot change to GUIDED and fly to a place, both with one command."""
        self._send(
            self._connection.mav.command_int_send,
            self.system,
            self.component,
            0,  # MAV_FRAME_GLOBAL: above mean sea level
            192,  # MAV_CMD_DO_REPOSITION
            0,
            0,
            -1.0,
            1.0,  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
            0.0,
            _NO_VALUE,
            target.latitude,
            target.longitude,
            target.altitude,
        )

    def steer(self, command: Command, boot_ms: int, *, speed: bool) -> None:
        """Send the roll, and with ``speed`` the airspeed and the altitude, where there is one."""
        self._send(
            self._connection.mav.set_attitude_target_send,
            boot_ms & 0xFFFFFFFF,
            self.system,
            self.component,
            _ROLL_ONLY,
            messages.roll_quaternion(command.roll),
            0.0,
            0.0,
            0.0,
            0.0,
        )
        if speed and command.altitude is not None:
            self._send(
                self._connection.mav.set_position_target_global_int_send,
                boot_ms & 0xFFFFFFFF,
                self.system,
                self.component,
                5,  # MAV_FRAME_GLOBAL_INT: above mean sea level
                _ALTITUDE_ONLY,
                0,
                0,
                command.altitude,
                *[0.0] * 8,
            )
        if speed:
            self._send(
                self._connection.mav.command_int_send,
                self.system,
                self.component,
                0,
                43_000,  # MAV_CMD_GUIDED_CHANGE_SPEED
                0,
                0,
                0.0,  # airspeed
                command.airspeed,
                0.0,
                0.0,
                0,
                0,
                0.0,
            )

    def set_mode(self, mode: int) -> None:
        """Ask for a mode of ArduPlane."""
        self.command(176, 1.0, float(mode))  # MAV_CMD_DO_SET_MODE

    def set_current(self, number: int) -> None:
        """Let the mission go on at an item."""
        self.command(224, float(number))  # MAV_CMD_DO_SET_MISSION_CURRENT

    def say(self, text: str, severity: int = 4) -> None:
        """Send a text: one STATUSTEXT, or as many as it needs, which a ground station joins by
        their number; a whole last one ends with an empty one.
        """
        data = text.encode("ascii", "replace")
        if len(data) <= _TEXT:
            self._send(self._connection.mav.statustext_send, severity, data)
            return
        self._texts = self._texts % 65_535 + 1
        for part, begin in enumerate(range(0, len(data) + 1, _TEXT)):
            chunk = data[begin : begin + _TEXT]
            self._send(self._connection.mav.statustext_send, severity, chunk, self._texts, part)

    def close(self) -> None:
        """Close the connection, unless it is lost."""
        if getattr(self._connection, "port", self) is not None:
            self._connection.close()

    def _next(self, seconds: float) -> Any:
        lost = getattr(self._connection, "port", self) is None
        if lost:
            time.sleep(min(seconds, _RECONNECT))
        try:
            wait = {"blocking": True, "timeout": seconds} if seconds > 0.0 else {}
            # pymavlink prints whatever it does about a connection that is lost.
            with redirect_stdout(StringIO()) if lost else nullcontext():
                message = self._connection.recv_match(**wait)
        except (OSError, TypeError, ConnectionError):
            # The other end is gone; whoever waits sees its silence.
            time.sleep(min(seconds, 0.05))
            return None
        if message is not None and message.get_type() == "BAD_DATA":
            self.bad += 1
            return None
        if message is not None and self._is_autopilot(message):
            return message if self._note_autopilot(message) else None
        return message

    def _is_autopilot(self, message: Any) -> bool:
        """Return whether a message is under the autopilot's numbers; another component of its
        system, such as a gimbal or a companion computer, is not the autopilot.
        """
        return (message.get_srcSystem(), message.get_srcComponent()) == (
            self.system,
            self.component,
        )

    def _note_autopilot(self, message: Any) -> bool:
        """Note a message under the autopilot's numbers, whose sender is answered; return whether it
        is the autopilot's, and not another sender's.
        """
        if isinstance(self._connection, Listener) and not self._connection.answer():
            self.foreign += 1
            return False
        self._first_version = message.get_msgbuf()[0] == _MAGIC_1
        self.heard = time.monotonic()
        return True

    def _send(self, send: Callable[..., Any], *values: Any) -> None:
        try:
            send(*values)
        except OSError:
            # A link that is down loses what is sent; the autopilot's own failsafe acts.
            return


_ROLL_ONLY = 0b11111110
"""Of SET_ATTITUDE_TARGET: everything but the roll is to be ignored. ArduPlane takes the roll of the
attitude by the bit of the roll rate; with the bit of the attitude it would hold the pitch too.
"""

_ALTITUDE_ONLY = 0b1111_1111_1111_1011
"""Of SET_POSITION_TARGET_GLOBAL_INT: everything but the altitude is to be ignored."""


def check_address(text: str) -> None:
    """Raise :class:`LinkError` where pymavlink cannot open an address of this form."""
    kind, _, location = text.partition(":")
    expected = "expected udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or a serial port"
    if kind in ("udp", "udpin", "udpout", "tcp"):
        host, _, port = location.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65_536:
            raise LinkError(f"--connect is {text!r}: {expected}")
    elif not Path(text).is_char_device():
        raise LinkError(f"--connect is {text!r}: {expected} that exists")
