"""A place on the network that no process of late had, for one that starts.

DDS gives a process the first free ports of its domain. One that is started again after a kill so gets those of the dead
one, which the others hold for alive until its lease ends, after 20 s; Fast DDS then takes seconds to bring newcomer and
others together (docs/ros.md, "Timing"). While some of the first ports are held, the process gets others. Their number
is drawn: process numbers repeat in containers, and the clock where restarts are quick.
"""

import os
import random
import socket
from collections.abc import Generator
from contextlib import ExitStack, contextmanager

__all__ = ["PORTS", "apart", "port"]

PORTS = 24
"""Among so many of the first ports one is drawn; discovery on one host looks at the first 32."""


def port(domain: int, number: int) -> int:
    """Return the port of discovery of the process with a number in a domain (RTPS 2.5, 9.6.2.3)."""
    return 7400 + 250 * domain + 10 + 2 * number


@contextmanager
def apart(skipped: int | None = None) -> Generator[list[int]]:
    """Hold those of the first ports of the environment's domain that are free, and give them; free again afterwards.

    Args:
        skipped: how many are looked at; None: drawn.
    """
    name = os.environ.get("ROS_DOMAIN_ID", "0")
    domain = int(name) if name.isascii() and name.isdecimal() else 0  # ROS itself refuses others
    wanted = random.randrange(PORTS) if skipped is None else skipped
    with ExitStack() as held:
        ports = []
        # Those that others hold are passed over, not replaced: who starts at the same time must not be driven further.
        for there in (port(domain, number) for number in range(wanted)):
            if there > 65_535:
                break
            one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            try:
                one.bind(("", there))
            except OSError:
                one.close()
                continue
            held.enter_context(one)
            ports.append(there)
        yield ports
