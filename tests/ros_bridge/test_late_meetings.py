# pyright: reportMissingImports=false, reportAttributeAccessIssue=false
"""A slow ownship with a last leg of 150 km, over DDS: an aircraft that its plan meets only in the
last minute is planned for, one that stays above it until every plan has ended is left out.
"""

import math
from collections.abc import Callable

import pytest

from tests.ros_bridge.graph import NODE, Client, Process, World, as_message, domain, route
from tests.ros_bridge.scenes import FRAME, point

# isort: split
from rlcas_msgs.msg import AircraftState, Waypoint
from rlcas_msgs.srv import GenerateTrajectory

from ros_bridge.core.conversions import trajectory
from ros_bridge.core.fields import Code

LEVEL, CLIMB = 2_000.0, -1.0  # m; m/s of the intruder
VERTICAL = 600.0  # m above the ownship, beyond which an aircraft is left out
INTRUDER = 100.0  # m/s
ALTITUDE = {
    "altitude_reference": AircraftState.ALTITUDE_WGS84,
    "valid": 0xC5 | AircraftState.VALID_ALTITUDE | AircraftState.VALID_VERTICAL_SPEED,
}
ROUTE = (-63_000.0, -58_000.0, 92_000.0)


def ask(client: Client, meanwhile: Callable[[], None], *about: str) -> GenerateTrajectory.Response:
    """Ask until there is a plan, SAFE or not, that says something of these aircraft."""
    request = GenerateTrajectory.Request(reason=GenerateTrajectory.Request.REASON_MANUAL)
    answers = []
    for _ in range(40):
        meanwhile()
        client.idle(0.1)
        response = client.call(GenerateTrajectory, f"{NODE}/generate_trajectory", request)
        named = {*response.trajectory.intruder_ids, *response.excluded_ids}
        if response.status in (Code.SAFE, Code.UNRESOLVED) and named >= {*about}:
            return response
        answers.append(f"{Code(response.status).name} {sorted(named)} {response.message}")
    pytest.fail(f"no answer about {about}: {answers[-1]}")


@pytest.mark.slow
def test_an_aircraft_met_at_the_end_of_a_long_plan_is_not_left_out():
    settings = ("ownship_max_age:=10.0", "intruder_max_age:=60.0", "request_max_age:=60.0")
    arguments = [part for setting in settings for part in ("-p", setting)]
    with domain() as number:
        process = Process("ros_bridge.runner", number, "--ros-args", *arguments)
        client = Client(number)
        try:
            _meet(client, World(client))
        finally:
            client.close()
            process.stop()


def _meet(client: Client, world: World) -> None:
    def ownship() -> None:
        world.ownship(-75_000.0, 0.0, 0.0, 49.0, altitude=LEVEL, **ALTITUDE)

    def with_intruder(name: str, x: float, above: float) -> None:
        ownship()
        more = {"altitude": LEVEL + above, "id": name, **ALTITUDE}
        world.intruder(x, 0.0, math.pi, INTRUDER, climb=CLIMB, **more)

    world.reference()
    at = FRAME.geodetic(list(ROUTE), [0.0] * len(ROUTE))
    places = zip(at.latitude.tolist(), at.longitude.tolist(), strict=True)
    filed = route(count=0)
    filed.waypoints = [as_message(Waypoint, point(7 + n, *place)) for n, place in enumerate(places)]
    world.route(filed)

    alone = ask(client, ownship)
    assert alone.status == Code.SAFE, alone.message
    assert list(alone.trajectory.intruder_ids) == [] and list(alone.excluded_ids) == []
    plan = trajectory(alone.trajectory)
    end = (plan.points[-1].time - plan.began) / 1e9
    assert end > 3_400.0

    # Head-on near the end of the last leg, and within 600 m of height only from then on.
    met = 0.85 * end  # a plan beside traffic may end earlier than one alone
    x = ROUTE[-1] - (end - met) * plan.points[-1].speed + INTRUDER * met
    late = ask(client, lambda: with_intruder("4b0001", x, VERTICAL - CLIMB * met), "4b0001")
    assert list(late.trajectory.intruder_ids) == ["4b0001"]
    assert list(late.excluded_ids) == []
    assert late.trajectory.min_separation >= 1_000.0 or late.status == Code.UNRESOLVED
    assert late.trajectory.time_of_min_separation > 0.8 * end

    # Above until every plan has ended: left out, and the answer says so.
    high = ask(client, lambda: with_intruder("4b0002", x, VERTICAL - CLIMB * 2.0 * end), "4b0002")
    assert list(high.trajectory.intruder_ids) == ["4b0001"]
    assert list(high.excluded_ids) == ["4b0002"]
