"""Faults of real traffic over real DDS: a runner that must refuse, or leave out, and never call such a plan SAFE."""

import math
from collections.abc import Callable, Iterator

import pytest

from tests.ros_bridge.graph import MISSING, NODE, PATIENCE, Client, Process, World, domain

pytest.importorskip("rclpy", reason=MISSING)

from rlcas_msgs.srv import GenerateTrajectory

from ros_bridge.core.situation import Code

SERVICE = f"{NODE}/generate_trajectory"
_EVERY = 0.2  # s between reports


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    ages = ("intruder_max_age:=1.0", "request_max_age:=60.0", "forget_after:=5.0")
    with domain() as number:
        process = Process("ros_bridge.runner", number, "--ros-args", *(part for age in ages for part in ("-p", age)))
        client = Client(number)
        try:
            yield World(client)
        finally:
            client.close()
            process.stop()


def flown(world: World, seconds: float, reported: Callable[[int], None]) -> None:
    """Report for some seconds; ``reported`` is called with the number of the report."""
    for number in range(round(seconds / _EVERY)):
        reported(number)
        world.client.idle(_EVERY)


def asked(world: World) -> GenerateTrajectory.Response:
    return world.client.call(GenerateTrajectory, SERVICE, GenerateTrajectory.Request(reason=3))


def becomes(world: World, wanted: Code, reported: Callable[[int], None]) -> GenerateTrajectory.Response:
    """Report and ask until the answer is the wanted one."""
    for number in range(round(PATIENCE / _EVERY)):
        reported(number)
        world.client.idle(_EVERY)
        response = asked(world)
        if response.status == wanted:
            return response
    raise AssertionError(f"{Code(response.status).name} {response.message}, expected {wanted.name}")


def test_echo_of_the_ownship_before_its_first_state_is_no_intruder(world: World):
    world.reference()
    world.route()
    for _ in range(3):
        world.intruder(0.0, 0.0, 0.0, 75.0, id="4B1A2C  ")
        world.client.idle(0.1)
    response = becomes(world, Code.SAFE, lambda _: world.ownship(id="4b1a2c"))
    assert list(response.trajectory.intruder_ids) == []

    def both(_: int) -> None:
        world.ownship(id="4b1a2c")
        world.intruder(0.0, 0.0, 0.0, 75.0, id="4B1A2C")

    flown(world, 1.0, both)
    assert asked(world).status == Code.SAFE


def test_far_aircraft_without_velocity_or_reports_is_excluded_by_name(world: World):
    def far(number: int) -> None:
        world.ownship(id="4b1a2c")
        world.intruder(320_000.0, 0.0, math.pi, 75.0, id="novelo", valid=0x01)
        if number == 0:
            world.intruder(0.0, 330_000.0, math.pi, 75.0, id="silent")

    flown(world, 1.6, far)
    response = becomes(world, Code.SAFE, lambda _: far(1))
    assert list(response.trajectory.intruder_ids) == []
    left_out = dict(zip(response.excluded_ids, response.excluded_reasons, strict=True))
    assert set(left_out) == {"novelo", "silent"} and all("km away" in why for why in left_out.values())
    near = lambda _: (world.ownship(id="4b1a2c"), world.intruder(9_000.0, 0.0, math.pi, id="novelo", valid=0x01))  # noqa: E731
    assert becomes(world, Code.INVALID_INTRUDER, near).field == "intruder novelo.valid"


def test_frozen_ownship_is_refused_until_it_moves(world: World):
    becomes(world, Code.SAFE, lambda _: world.ownship(id="4b1a2c"))

    def frozen(number: int) -> None:
        world.ownship(x=0.3 * (number % 2), y=500.0, id="4b1a2c")

    flown(world, 4.0, frozen)
    for number in range(5):
        frozen(number)
        world.client.idle(_EVERY)
        response = asked(world)
        assert (response.status, response.field) == (Code.INVALID_OWNSHIP, "ownship.position")
    becomes(world, Code.SAFE, lambda _: world.ownship(y=500.0, id="4b1a2c"))


def test_two_aircraft_under_one_id_are_never_planned_with(world: World):
    def in_turns(number: int) -> None:
        world.ownship(y=500.0, id="4b1a2c")
        x, y = ((60_000.0, 0.0), (8_000.0, 500.0))[number % 2]
        world.intruder(x - 75.0 * _EVERY * number, y, math.pi, 75.0, id="shared")

    for number in range(15):
        in_turns(number)
        world.client.idle(_EVERY)
        response = asked(world)
        # One report of each is a jump, one more of the second shows two aircraft.
        if number:
            field = "intruder shared.id" if number > 2 else "intruder shared.position"
            assert (response.status, response.field) == (Code.INVALID_INTRUDER, field), number
