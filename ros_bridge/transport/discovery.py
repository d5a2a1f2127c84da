"""Fast DDS discovery of a process that starts: ports of its own, and how it announces itself.

DDS gives a process the first free ports of its domain. One that is started again after a kill gets
those of the killed one, which the others treat as alive until its lease ends, after 20 s; Fast DDS
then takes seconds to connect them (docs/reference/ros.md, "Start and restart"). While some of the
first ports are held, the process gets others. Their number is drawn at random: process numbers
repeat in containers, and so does the clock where restarts are quick.

Other delays of Fast DDS are avoided by ``fastdds/profile.xml``, with the reasons.
"""

import os
import random
import socket
from collections.abc import Generator, MutableMapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

PROFILE = Path(__file__).parents[1] / "fastdds" / "profile.xml"
"""How Fast DDS takes part for a node of ours."""

CONFIGURED = (
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "ROS_DISCOVERY_SERVER",
)
"""Variables by which an integrator configures Fast DDS."""

_IN_DIRECTORY = (
    "DEFAULT_FASTDDS_PROFILES.xml",
    "DEFAULT_FASTRTPS_PROFILES.xml",
)  # read where a process starts

PORTS = 24
"""Among so many of the first ports one is drawn; discovery on one host looks at the first 32."""


def port(domain: int, number: int) -> int:
    """Return the port of discovery of the process with a number in a domain (RTPS 2.5, 9.6.2.3)."""
    return 7400 + 250 * domain + 10 + 2 * number


def configure_dds(
    environment: MutableMapping[str, str] = os.environ, directory: Path | None = None
) -> bool:
    """Have Fast DDS take part by our profile, unless the integrator has configured it; return
    whether.

    To be called before the process has a node. One of CONFIGURED in the environment, even empty, or
    a file of profiles in the directory where it starts (None: the present one) is the integrator's.
    Only Fast DDS takes notice.
    """
    folder = Path() if directory is None else directory
    if any(name in environment for name in CONFIGURED) or any(
        (folder / name).exists() for name in _IN_DIRECTORY
    ):
        return False
    environment["FASTDDS_DEFAULT_PROFILES_FILE"] = str(PROFILE)
    # On one host alone ROS chooses the transports itself, and the profile what comes by which of
    # them.
    environment["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"
    return True


@contextmanager
def reserve_ports(skipped: int | None = None) -> Generator[list[int]]:
    """Hold those of the domain's first ports (None: a number that is drawn) that are free, until
    the block ends.
    """
    name = os.environ.get("ROS_DOMAIN_ID", "0")
    domain = int(name) if name.isascii() and name.isdecimal() else 0  # ROS itself refuses others
    count = random.randrange(PORTS) if skipped is None else skipped
    with ExitStack() as sockets:
        ports = []
        # Ports in use are passed over, not replaced: another process that starts now must not get
        # ports further on.
        for port_number in (port(domain, number) for number in range(count)):
            endpoint = sockets.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            try:
                endpoint.bind(("", port_number))
            except (OSError, OverflowError):  # in use, or there is no such port
                continue
            ports.append(port_number)
        yield ports
