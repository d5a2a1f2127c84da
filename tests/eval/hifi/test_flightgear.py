"""What FlightGear is sent, read back from UDP sockets by the layouts of FlightGear's own headers."""

import math
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jsbsim", reason="JSBSim is not installed")

from scipy.spatial.transform import Rotation

from agents.config.load import load
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.c208.flightgear import FlightGear, flightgear_at
from envs.edge.command import ConfigError
from envs.encounters import scenario
from envs.formats.local_frame import geocentric
from envs.kinematics import C208_PUBLISHED
from envs.starts import numbered
from eval.hifi.config import HifiConfig
from eval.hifi.flights import flown, prepared
from eval.hifi.run import campaign_of, main
from ros_bridge.sim.world import EncounterFlight

OWN = struct.Struct(">I4x3d22f I40I I4f I12I IiI10f")
"""FGNetFDM of version 24 (src/Network/net_fdm.hxx): four engines and tanks, three wheels."""
OTHER = struct.Struct(">6I8s96s2d3d3f3f9fI")
"""T_MsgHdr and T_PositionMsg (src/MultiPlayer/mpmessages.hxx)."""

Ports = tuple[socket.socket, socket.socket]


@pytest.fixture
def ports() -> Iterator[Ports]:
    """Two sockets at ports that follow each other."""
    for port in range(42_000, 60_000, 2):
        with socket.socket(type=socket.SOCK_DGRAM) as first, socket.socket(type=socket.SOCK_DGRAM) as second:
            try:
                first.bind(("127.0.0.1", port))
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            yield first, second
            return


def viewer(ports: Ports, *, paced: bool) -> FlightGear:
    return flightgear_at(f"localhost:{ports[0].getsockname()[1]}", paced=paced)


def received(udp: socket.socket, layout: struct.Struct) -> list[tuple]:
    udp.setblocking(False)
    packets = []
    while True:
        try:
            packets.append(layout.unpack(udp.recv(2_000)))
        except BlockingIOError:
            return packets


def test_flightgear_is_sent_the_flight_in_real_time(policy_path: Path, ports: Ports) -> None:
    given = [f"policy={policy_path}", "mode=closed", "scenario=crossing_left"]
    campaign, _ = campaign_of(load(HifiConfig, None, given))
    campaign = campaign._replace(aircraft=campaign.aircraft._replace(t_max=2.0))
    shown = campaign._replace(viewer=viewer(ports, paced=True))
    began = time.monotonic()
    flight = flown(*prepared(shown, Policy.load(policy_path)), 0).flight
    assert time.monotonic() - began > 1.9
    assert flight is not None
    # It is the flight that nobody watches.
    unseen = flown(*prepared(campaign, Policy.load(policy_path)), 0).flight
    assert unseen is not None
    np.testing.assert_array_equal(flight.own, unseen.own)

    own = np.array(received(ports[0], OWN))[5::6]  # 60 a second, of which every sixth ends a period
    assert len(own) == 20 and (own[:, 0] == 24).all()
    longitude, latitude, altitude = own[:, 1:4].T
    np.testing.assert_allclose(altitude, flight.altitude[1:], atol=1e-6)
    places = geocentric(latitude, longitude, 2500.0)
    moved = np.hypot(*(np.diff(field[1:]) for field in flight.own[:2]))
    np.testing.assert_allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), moved, atol=1e-3)
    turned = np.remainder(own[:, 7] + flight.own.heading[1:] - math.pi / 2.0 + math.pi, 2.0 * math.pi) - math.pi
    np.testing.assert_allclose(turned, 0.0, atol=0.01)  # no wind: the nose is where the track leads

    others = received(ports[1], OTHER)
    assert len(others) == 20
    assert {(one[0], one[1], one[2], one[3]) for one in others} == {(0x46474653, 0x10001, 7, OTHER.size)}
    assert others[0][6].rstrip(b"\0") == b"INTR1"
    there = np.array([one[10:13] for one in others])
    for second, number in ((1, 9), (2, 19)):
        apart = math.hypot(*(flight.own[axis][10 * second] - flight.intruders[axis][second, 0] for axis in (0, 1)))
        assert np.linalg.norm(places[number] - there[number]) == pytest.approx(apart, abs=0.5)
    # Ahead along its nose goes the intruder, and its belly looks at the Earth.
    attitude, speed = Rotation.from_rotvec([one[13:16] for one in others]), others[0][16]
    ahead = attitude.apply([speed * 0.1, 0.0, 0.0])
    np.testing.assert_allclose(np.diff(there, axis=0), ahead[:-1], atol=2e-3)
    down = attitude.apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(down, -there / np.linalg.norm(there, axis=1)[:, None], atol=1e-3)


def test_flightgear_is_sent_what_the_ros_simulator_flies(ports: Ports) -> None:
    encounter = numbered(scenario("circle", PAPER), 0, 0, 1)
    flight = EncounterFlight(encounter, PAPER, C208_PUBLISHED, "c208", viewer(ports, paced=False))
    flight.step()
    assert len(received(ports[0], OWN)) == 6
    assert len(received(ports[1], OTHER)) == len(flight.names)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["localhost"], "flightgear is 'localhost'; expected HOST:PORT"),
        (["localhost:65535"], "flightgear is 'localhost:65535'; expected HOST:PORT"),
        (["no host:5550"], "whose host cannot be resolved"),
        (["localhost:5550", "--vehicle", "point_mass"], "vehicle is point_mass; expected c208_ex or c208"),
        (["localhost:5550", "--workers", "2"], "expected no --scheduler, and no --workers but 1"),
    ],
)
def test_what_cannot_be_shown_is_refused_before_the_flight(given: list[str], says: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        main(["--flights", "1", "--out", str(tmp_path / "run"), "--flightgear", *given])
    assert not (tmp_path / "run").exists()
