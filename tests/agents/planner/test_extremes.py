"""Requests at the ends of what is valid are answered: refused by name, UNRESOLVED with reasons, or
SAFE with a certificate that the checker accepts.
"""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.check import accept
from agents.planner import Options, RequestError, plan
from agents.planner.answer import Kind
from agents.policy.inference import Policy
from envs.aircraft import new_aircraft
from envs.areas import Area, Circle
from envs.kinematics import Limits, VehicleState
from envs.waypoints import RoutePoint
from envs.wind import Wind
from tests.agents.extremes import ANGLES, altitudes, areas, intruders, routes

POLICY = Policy.load()
USUAL = Options.for_aircraft(POLICY.aircraft, deadline_s=math.inf, exhaustive=False)


@st.composite
def requests(draw: Any) -> dict[str, Any]:
    """Draw all of a request."""
    limits = USUAL.aircraft.limits
    wind = draw(st.sampled_from([None, Wind(0.0, 0.0), Wind(10.0, -5.0, 1.0), Wind(-40.0, 0.0)]))
    return {
        "own": VehicleState(
            0.0,
            0.0,
            draw(ANGLES),
            draw(st.sampled_from([limits.speed_min, 70.0, limits.speed_max])),
        ),
        "intruders": draw(st.lists(intruders(), max_size=3)),
        "route": draw(routes()),
        "options": replace(
            USUAL,
            extend_route=draw(st.booleans()),
            direct=draw(st.booleans()),
            fallback_cost_threshold=draw(st.sampled_from([0.0, 1_500.0, math.inf])),
        ),
        "own_altitude": draw(altitudes()),
        "wind": wind,
        "areas": draw(st.lists(areas(), max_size=3)),
    }


@settings(max_examples=20, deadline=None)
@given(requests())
def test_requests_at_the_ends_of_what_is_valid_are_answered(request: dict[str, Any]) -> None:
    given_ = dict(request)
    own, traffic, route, options = (given_.pop(n) for n in ("own", "intruders", "route", "options"))
    try:
        answer = plan(own, traffic, route, POLICY, options, **given_)
    except RequestError as refusal:
        assert refusal.field
        return
    assert answer.safe == (not answer.reasons)
    states = [
        (point.x, point.y, point.heading, point.speed, point.time) for point in answer.waypoints
    ]
    assert np.isfinite(states).all()
    if answer.safe:
        accept(json.loads(answer.certificate or b""))


def test_plans_that_all_last_too_long_among_areas_are_said_to() -> None:
    # 890 km at 36 m/s at most.
    slow = POLICY.for_aircraft(new_aircraft(Limits(18.0, 36.0, -0.5, 0.5, 0.17), 610.0))
    quick = Options.for_aircraft(slow.aircraft, deadline_s=math.inf, exhaustive=False)
    own = VehicleState(0.0, 0.0, 0.0, 30.0)
    route = [RoutePoint(0, 8_000.0, 0.0), RoutePoint(1, 900_000.0, 0.0)]
    lake = Area(Circle(20_000.0, 8_000.0, 1_000.0))
    for lakes in ([], [lake]):
        answer = plan(own, [], route, slow, quick, areas=lakes)
        assert not answer.safe
        assert answer.reasons[0].kind is Kind.TIMES
