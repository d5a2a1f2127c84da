"""ArduPlane's own simulation (SITL): the real autopilot's program with a simulated airframe.

For the demonstration, the tests and the benchmarks. The program is no part of the project:
``RLCAS_SITL`` names the folder that holds ``arduplane`` and ``plane.parm``; without it the folder
``shared/sitl`` beside the repository is used where there is one.
"""

import os
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Self

from commands.command import InputError

HOME = (47.4, 8.5, 520.0)
"""Latitude, longitude, degrees, and height, m, of the simulated airfield."""

LAST_INSTANCE = 255
"""ArduPlane keeps the number in eight bits: of 256 it makes 0."""

_FIRST_PORT = 5_760
_BEGINS = 60.0  # s of real time for a start or an upload, on a loaded machine too
_BESIDE = Path(__file__).resolve().parents[3] / "shared" / "sitl"
_PATIENT = 15  # its niceness
_RELATIVE = 6  # MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_CRUISE = 100.0  # m above home


class SitlError(InputError):
    """A simulation that is not there, or that did not do what was asked of it."""


class Leg(NamedTuple):
    """A waypoint of a mission, m east and north of home and above it."""

    east: float
    north: float
    above: float = _CRUISE
    command: int = 16
    parameter: float = 0.0


class _Item(NamedTuple):
    """An item of a mission or a fence, as it is uploaded."""

    frame: int  # MAV_FRAME
    command: int  # MAV_CMD
    parameter: float  # the first
    latitude: float  # degrees
    longitude: float
    above: float  # m, above what the frame says


def folder() -> Path:
    """Return the folder of the program, or raise :class:`SitlError`."""
    named = os.environ.get("RLCAS_SITL", "")
    path = Path(named) if named else _BESIDE
    if not (path / "arduplane").is_file() or not (path / "plane.parm").is_file():
        raise SitlError(
            f"RLCAS_SITL is {named!r} and {path} holds no arduplane with plane.parm; expected the "
            "folder of ArduPlane's SITL (docs/howto/mavlink.md)"
        )
    return path


def place(
    east: float, north: float, home: tuple[float, float, float] = HOME
) -> tuple[float, float]:
    """Return latitude and longitude, degrees, m east and north of home."""
    from envs.formats.local_frame import LocalFrame

    at = LocalFrame(home[0], home[1]).geodetic(east, north)
    return float(at.latitude), float(at.longitude)


def _check_free(port: int) -> None:
    """Raise :class:`SitlError` where something listens at a port already."""
    try:
        socket.create_server(("", port)).close()
    except OSError as problem:
        raise SitlError(
            f"port {port} cannot be used: {os.strerror(problem.errno or 0)}; another simulation "
            "has it perhaps: expected another --instance"
        ) from None


class Sitl:
    """A running simulation with a connection of its own, as a ground station has it.

    Args:
        instance: which ports it uses: 5760 + 10 times this, and 2 and 3 above; 0 to 255.
        speedup: times real time.
        parameters: set before the start.
        home: latitude, longitude, degrees, and height, m, of its airfield.
    """

    def __init__(
        self,
        instance: int = 0,
        speedup: float = 10.0,
        parameters: Mapping[str, float] | None = None,
        home: tuple[float, float, float] = HOME,
    ) -> None:
        if not 0 <= instance <= LAST_INSTANCE:
            raise SitlError(f"the instance is {instance}; expected 0 to {LAST_INSTANCE}")
        self.port = _FIRST_PORT + 10 * instance
        program = folder()
        _check_free(self.port)
        self._folder = tempfile.TemporaryDirectory(prefix="rlcas-sitl-", ignore_cleanup_errors=True)
        work_folder = Path(self._folder.name)
        extra = work_folder / "extra.parm"
        extra.write_text("".join(f"{k} {v}\n" for k, v in (parameters or {}).items()))
        self.home = home
        self._log = (work_folder / "output").open("wb")
        # A group of its own: nothing that ends the test ends it half.
        self._process = subprocess.Popen(
            [
                str(program / "arduplane"),
                "-w",
                "--model=plane",
                f"--speedup={speedup:g}",
                f"--home={','.join(map(str, (*home, 90)))}",
                f"--defaults={program / 'plane.parm'},{extra}",
                f"--instance={instance}",
            ],
            cwd=work_folder,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        # Where the processor is busy it waits for whoever listens to it, and not they for it.
        os.setpriority(os.PRIO_PROCESS, self._process.pid, _PATIENT)
        try:
            self.station: Any = self._connect()
        except BaseException:
            self.close()
            raise

    @property
    def address(self) -> str:
        """Where another station connects."""
        return f"tcp:127.0.0.1:{self.port + 2}"

    @property
    def third_address(self) -> str:
        """Where one more station connects."""
        return f"tcp:127.0.0.1:{self.port + 3}"

    def __enter__(self) -> Self:
        """Return the running simulation."""
        return self

    def __exit__(self, *problem: object) -> None:
        """End it."""
        self.close()

    def close(self) -> None:
        """End the simulation and remove its folder."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        station = getattr(self, "station", None)
        if station is not None:
            station.close()
        self._log.close()
        self._folder.cleanup()

    def signal(self, number: int) -> None:
        """Send a signal to the simulation, such as to stop it and let it go on."""
        self._process.send_signal(number)

    @contextmanager
    def awake(self) -> Generator[None, None, None]:
        """Let the simulation, which stands still, go on meanwhile."""
        self.signal(signal.SIGCONT)
        try:
            yield
        finally:
            self.signal(signal.SIGSTOP)

    def _connect(self) -> Any:
        os.environ.setdefault("MAVLINK20", "1")
        from pymavlink import mavutil

        until = time.monotonic() + _BEGINS
        while time.monotonic() < until:
            if self._process.poll() is not None:
                raise SitlError(f"arduplane ended with exit code {self._process.returncode}")
            try:
                station = mavutil.mavlink_connection(
                    f"tcp:127.0.0.1:{self.port}", source_system=255, retries=1
                )
            except OSError:
                time.sleep(0.1)
                continue
            if station.wait_heartbeat(timeout=_BEGINS) is not None:
                return station
        raise SitlError(f"arduplane sent no heartbeat within {_BEGINS:g} s")

    # What a ground station does.

    def wait(self, kind: str, seconds: float = 20.0, **fields: Any) -> Any:
        """Return the next message of a kind, whose fields are such, or raise :class:`SitlError`
        after so many seconds of real time.
        """
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.beat()
            message = self.station.recv_match(type=kind, blocking=True, timeout=0.5)
            if message is not None and all(
                getattr(message, name) == value for name, value in fields.items()
            ):
                return message
        raise SitlError(f"no {kind} with {fields} came within {seconds:g} s")

    _beaten = 0.0

    def beat(self) -> None:
        """Send the ground station's heartbeat, at most every tenth of a second."""
        if time.monotonic() - self._beaten > 0.1:
            self._beaten = time.monotonic()
            self.station.mav.heartbeat_send(6, 8, 0, 0, 0)

    def set(self, name: str, value: float) -> None:
        """Set a parameter and wait for it."""
        for _ in range(5):
            self.station.mav.param_set_send(1, 1, name.encode(), value, 9)
            try:
                self.wait("PARAM_VALUE", 2.0, param_id=name)
            except SitlError:
                continue
            return
        raise SitlError(f"{name} could not be set")

    def rate(self, kind: int, interval_us: float) -> None:
        """Ask for a message by its number every so many microseconds."""
        self.command(511, kind, interval_us)

    def command(self, number: int, *values: float) -> None:
        """Send a COMMAND_LONG."""
        padded = [*values, *[0.0] * (7 - len(values))]
        self.station.mav.command_long_send(1, 1, number, 0, *padded)

    def mode(self, number: int) -> None:
        """Ask for a mode until the heartbeat has it."""
        for _ in range(20):
            self.command(176, 1.0, float(number))
            try:
                self.wait("HEARTBEAT", 1.0, custom_mode=number)
            except SitlError:
                continue
            return
        raise SitlError(f"mode {number} was not taken")

    def upload(self, legs: Sequence[Leg]) -> None:
        """Upload a mission; item 0 is home."""
        items = [_Item(0, 16, 0.0, *self.home)]
        items += [
            _Item(
                _RELATIVE,
                leg.command,
                leg.parameter,
                *place(leg.east, leg.north, self.home),
                leg.above,
            )
            for leg in legs
        ]
        self._upload(items, 0)

    def upload_fence(self, polygon: Sequence[tuple[float, float]], *, keep_in: bool) -> None:
        """Upload a fence of one polygon, m east and north of home."""
        command, corners = 5001 if keep_in else 5002, float(len(polygon))
        items = [_Item(0, command, corners, *place(*corner, self.home), 0.0) for corner in polygon]
        self._upload(items, 1)

    def _upload(self, items: Sequence[_Item], kind: int) -> None:
        """Answer the autopilot's questions for items of a MAV_MISSION_TYPE until it has all."""
        mav = self.station.mav
        mav.mission_count_send(1, 1, len(items), kind)
        until = time.monotonic() + _BEGINS
        while time.monotonic() < until:
            self.beat()
            message = self.station.recv_match(
                type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"],
                blocking=True,
                timeout=1.0,
            )
            if message is not None and message.get_type() != "MISSION_ACK":
                self._send_item(items[message.seq], message.seq, kind)
                continue
            if message is not None and message.type == 0:
                return
            if message is not None:
                # Right after its start there is no room for one yet. What is still on its way
                # belongs to the transfer that failed; an answer to it would end the next one, too.
                time.sleep(0.5)
                while self.station.recv_match(blocking=False) is not None:
                    pass
            mav.mission_count_send(1, 1, len(items), kind)
        raise SitlError("the mission was not taken")

    def _send_item(self, item: _Item, number: int, kind: int) -> None:
        self.station.mav.mission_item_int_send(
            target_system=1,
            target_component=1,
            seq=number,
            frame=item.frame,
            command=item.command,
            current=0,
            autocontinue=1,
            param1=item.parameter,
            param2=0.0,
            param3=0.0,
            param4=0.0,
            x=round(1e7 * item.latitude),
            y=round(1e7 * item.longitude),
            z=item.above,
            mission_type=kind,
        )

    def take_off(self) -> None:
        """Arm, fly the mission in AUTO, and wait until it has left its first item behind."""
        self.wait("GLOBAL_POSITION_INT")
        self.mode(10)
        for _ in range(60):
            self.command(400, 1.0, 2989.0)
            try:
                if self.wait("COMMAND_ACK", 1.0, command=400).result == 0:
                    break
            except SitlError:
                continue
            time.sleep(0.2)
        else:
            raise SitlError("the aircraft could not be armed")
        until = time.monotonic() + 60.0
        while time.monotonic() < until:
            if self.wait("MISSION_CURRENT").seq > 1:
                return
        raise SitlError("the aircraft has not taken off")

    def traffic(
        self,
        number: int,
        east: float,
        north: float,
        course: float,
        speed: float,
        above: float,
        climb: float = 0.0,
    ) -> None:
        """Send an ADSB_VEHICLE, as a receiver does.

        Args:
            number: its address.
            east: m of home; with ``north``.
            course: degrees clockwise from north.
            speed: m/s.
            above: m above mean sea level.
            climb: m/s.
        """
        latitude, longitude = place(east, north, self.home)
        self.station.mav.adsb_vehicle_send(
            ICAO_address=number,
            lat=round(1e7 * latitude),
            lon=round(1e7 * longitude),
            altitude_type=1,  # geometric
            altitude=round(1000 * above),
            heading=round(100 * (course % 360.0)),
            hor_velocity=round(100 * speed),
            ver_velocity=round(100 * climb),
            callsign=f"T{number}".encode(),
            emitter_type=14,  # unmanned
            tslc=0,
            flags=0x00FF & ~64,  # all that is told is valid; 64: simulated
            squawk=0,
        )
