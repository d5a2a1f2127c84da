"""A SAFE plan's certificate to edit, and what the checker says of it."""

import json
from typing import Any

import pytest

from agents import check
from agents.inference import Policy
from agents.planner import Intruder, plan
from agents.planner.request.request import Altitude
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint
from tests.agents.scenes import PATIENT

OWN = VehicleState(0.0, 0.0, 0.0, 80.0)
HEIGHT = Altitude(2_500.0, "msl", 0.0)
INTRUDERS = [
    Intruder(VehicleState(9_000.0, 100.0, 3.14, 80.0), age=0.4, altitude=HEIGHT),
    Intruder(VehicleState(5_000.0, 6_000.0, -2.0, 70.0), 1.0, 0.01, 60.0, 10.0, 1.0),
    Intruder(VehicleState(5_000.0, 600.0, -2.0, 70.0), 1.0, altitude=Altitude(5_500.0, "msl", 0.0)),
]
ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]


def certificate() -> dict[str, Any]:
    """Return the certificate of a plan among two intruders, a third being out of the way."""
    answer = plan(OWN, INTRUDERS, ROUTE, Policy.load(), PATIENT, own_altitude=HEIGHT)
    assert answer.safe and len(answer.excluded) == 1 and answer.certificate is not None
    return json.loads(answer.certificate)


def refusal(data: Any) -> str:
    """Return why a certificate is refused."""
    with pytest.raises(check.RefusedError) as caught:
        check.accept(data)
    return str(caught.value)


def is_accepted(data: Any) -> bool:
    """Return whether a certificate is accepted."""
    try:
        check.accept(data)
    except check.RefusedError:
        return False
    return True
