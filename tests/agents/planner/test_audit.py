"""Waypoints that are published wrongly are found out, each fault under its name and at its place."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.planner import publish
from agents.planner.answer import WAYPOINTS, Kind, Status
from agents.planner.audit import audit
from agents.planner.planner import plan
from agents.planner.request import Options
from agents.policy.inference import Policy
from envs.kinematics import VehicleState
from envs.waypoints import RoutePoint, Waypoint

ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 300.0 * i) for i in range(6)]
OWN = VehicleState(0.0, 0.0, 0.0, 80.0)


def published() -> list[Waypoint]:
    """Return waypoints with nothing wrong."""
    fresh = [Waypoint(i, 1_600.0 * (i + 1), 0.0, 0.0, 80.0, 20.0 * (i + 1)) for i in range(WAYPOINTS - 1)]
    return [*fresh, Waypoint(105, ROUTE[5].x, ROUTE[5].y, 0.0, 80.0, 470.0)]


def test_nothing_is_wrong_with_what_is_right() -> None:
    assert audit(published(), ROUTE) == []
    beyond = replace(published()[-1], index=50, x=ROUTE[5].x + 5_000.0, y=ROUTE[5].y + 300.0)
    assert audit([*published()[:-1], beyond], ROUTE, extended=True) == []


@given(st.integers(0, WAYPOINTS - 2), st.integers(0, WAYPOINTS - 2))
def test_a_repeated_index_is_found(a: int, b: int) -> None:
    wrong = published()
    wrong[a] = replace(wrong[a], index=wrong[b].index)
    found = audit(wrong, ROUTE)
    if a == b:
        assert found == []
    else:
        assert [(one.kind, one.field) for one in found] == [
            (Kind.INDICES, f"waypoints[{number}]") for number in sorted((a, b))
        ]


@given(st.integers(0, WAYPOINTS - 2), st.integers(0, 5))
def test_an_index_of_the_route_is_found(number: int, which: int) -> None:
    wrong = published()
    wrong[number] = replace(wrong[number], index=ROUTE[which].index)
    assert (Kind.INDICES, f"waypoints[{number}]") in {(one.kind, one.field) for one in audit(wrong, ROUTE)}


@given(st.sampled_from(["x", "y"]), st.floats(0.01, 1e6), st.booleans())
def test_a_last_waypoint_beside_its_point_is_found(axis: str, off: float, extended: bool) -> None:
    wrong = published()
    wrong[-1] = replace(wrong[-1], **{axis: getattr(wrong[-1], axis) + off})
    (found,) = audit(wrong, ROUTE, extended=extended)
    assert found.kind is Kind.OFF_ROUTE
    assert found.field == f"waypoints[{WAYPOINTS - 1}]"


def test_a_last_waypoint_of_no_point_is_found() -> None:
    wrong = [*published()[:-1], replace(published()[-1], index=77)]
    assert [one.kind for one in audit(wrong, ROUTE)] == [Kind.OFF_ROUTE]
    # It stands at the route's end: there the extension begins.
    assert audit(wrong, ROUTE, extended=True) == []
    wrong[-1] = replace(wrong[-1], x=ROUTE[5].x - 5_000.0, y=ROUTE[5].y - 300.0)
    assert [one.kind for one in audit(wrong, ROUTE, extended=True)] == [Kind.OFF_ROUTE]


@given(
    st.sampled_from(["x", "y", "heading", "speed", "time"]), st.integers(0, 19), st.sampled_from([math.nan, math.inf])
)
def test_what_is_not_finite_is_found(field: str, number: int, value: float) -> None:
    wrong = published()
    wrong[number] = replace(wrong[number], **{field: value})
    assert (Kind.NOT_FINITE, f"waypoints[{number}]") in {(one.kind, one.field) for one in audit(wrong, ROUTE)}


@pytest.mark.parametrize("count", [0, 1, 19, 21])
def test_another_number_of_waypoints_is_found(count: int) -> None:
    wrong = (published()[:1] * 2 + published()[1:]) if count == 21 else published()[20 - count :]
    assert Kind.COUNT in {one.kind for one in audit(wrong, ROUTE)}


def test_a_plan_that_is_published_wrongly_is_not_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    policy, right = Policy.load(), publish._waypoints
    assert plan(OWN, [], ROUTE * 1, policy, Options(extend_route=True)).safe

    def twice(*values: object) -> tuple[Waypoint, ...]:
        points = right(*values)  # pyright: ignore[reportArgumentType]
        return (*points[:5], replace(points[5], index=points[4].index), *points[6:])

    monkeypatch.setattr(publish, "_waypoints", twice)
    answer = plan(OWN, [], ROUTE, policy, Options(extend_route=True))
    assert answer.status is Status.UNRESOLVED
    assert {one.kind for one in answer.reasons} == {Kind.INDICES}
