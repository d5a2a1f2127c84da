"""FlightGear as a viewer: JSBSim's own output moves its aircraft, multiplayer packets move the
intruders.

All is UDP: a FlightGear that is not there goes unnoticed. The ownship's packets (FGNetFDM of
FlightGear's net_fdm.hxx, version 24) go to the port named, the intruders' (T_MsgHdr and
T_PositionMsg of its mpmessages.hxx) to the next one.
"""

import math
import socket
import struct
import tempfile
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from commands.command import ConfigError
from envs.c208.fdm import STEP
from envs.formats.local_frame import geocentric
from envs.frames import Ground
from envs.kinematics import VehicleState

if TYPE_CHECKING:
    import jsbsim

_PACKET = struct.Struct(">6I8s96s5d15fI")
_HEADER = (
    0x46474653,  # "FGFS"
    0x00010001,  # protocol 1.1
    7,  # a position
    _PACKET.size,
    100,  # range, NM
    0,  # no port
)
_MODEL = b"Aircraft/Cessna208Caravan/Models/Cessna208-ai.xml"  # in AI/ of FlightGear's base package
_LAG = 0.1  # between two packets, s


class FlightGear(NamedTuple):
    """Where flights are shown."""

    host: str  # IPv4 address
    port: int  # of the ownship's packets
    paced: bool  # whether JSBSim is held to real time

    def attach(self, executive: "jsbsim.FGFDMExec") -> None:
        """Have JSBSim write its output to here, from :meth:`begin` on; its next initial conditions
        open the connection.
        """
        name = f'name="{self.host}" port="{self.port}" protocol="UDP"'
        with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
            file.write(f'<output type="FLIGHTGEAR" rate="{1.0 / STEP:g}" {name}/>')
            file.flush()
            executive.set_output_directive(file.name)
        executive.disable_output()

    def begin(self, executive: "jsbsim.FGFDMExec") -> Callable[[], bool]:
        """Show what JSBSim flies from now on; return what runs one of its steps, in real time where
        that is asked.
        """
        executive.enable_output()
        due = time.monotonic()

        def run() -> bool:
            nonlocal due
            clock = time.monotonic()
            due = max(due + STEP, clock)  # what was late is not caught up
            time.sleep(due - clock)
            return executive.run()

        return run if self.paced else executive.run

    def send(
        self,
        latitude: np.ndarray,
        longitude: np.ndarray,
        altitude: np.ndarray | float,
        intruders: VehicleState[Ground],
    ) -> None:
        """Show intruders ``[K]``, wings level: their places, rad, altitude, m, headings and
        speeds.
        """
        # Imported here, because few flights are shown.
        from scipy.spatial.transform import Rotation

        places = geocentric(latitude, longitude, altitude)
        # From the Earth's axes to those of a level aircraft, as angle times axis.
        angles = np.stack(
            (longitude, -0.5 * math.pi - latitude, 0.5 * math.pi - intruders.heading), axis=-1
        )
        turned = Rotation.from_euler("ZYZ", angles).as_rotvec()
        stamp = time.time()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            for number, (place, axis, speed) in enumerate(
                zip(places, turned, intruders.speed, strict=True)
            ):
                name = f"INTR{number + 1}".encode()
                no_motion = (0.0,) * 11  # sideways and down, turn rates, accelerations
                packet = _PACKET.pack(
                    *_HEADER, name, _MODEL, stamp, _LAG, *place, *axis, speed, *no_motion, 0
                )
                udp.sendto(packet, (self.host, self.port + 1))


def flightgear_at(address: str, *, paced: bool) -> FlightGear:
    """Return the FlightGear at ``HOST:PORT``; a ConfigError where that is no address or cannot be
    resolved.
    """
    host, _, port = address.rpartition(":")
    expected = "expected HOST:PORT with a port of 1 to 65534, such as localhost:5550"
    if not host or not port.isdecimal() or not 0 < int(port) < 65535:
        raise ConfigError(f"flightgear is {address!r}; {expected}")
    try:
        addresses = socket.getaddrinfo(host, int(port), socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError):
        raise ConfigError(
            f"flightgear is {address!r}: the host cannot be resolved; {expected}"
        ) from None
    return FlightGear(str(addresses[0][4][0]), int(port), paced)
