"""Whatever ``plan`` is given, it refuses by name, says why there is no plan, or returns one that
holds.
"""

import dataclasses
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.kernel.clearance import CLOSE
from agents.kernel.traffic import Requirement, Traffic
from agents.planner.answer import Plan, RequestError
from agents.planner.planner import plan
from agents.planner.request.request import Altitude, Intruder, Options, Request
from agents.policy.inference import Policy
from benchmarks.safety import published
from benchmarks.safety.resimulation import CHECKS, Route, displacement, resimulate
from envs.aircraft import PAPER
from envs.kinematics import C208_PUBLISHED, SURROGATE, Limits, VehicleState
from envs.trees import take
from envs.waypoints import RoutePoint

QUICK = Options.for_aircraft(PAPER, deadline_s=math.inf, exhaustive=False, goals=1)
POLICY = Policy.load()

GOOD: dict[str, Any] = {
    "own": VehicleState(0.0, 0.0, 0.0, 80.0),
    "intruders": [
        Intruder(
            VehicleState(9_000.0, 100.0, math.pi, 80.0),
            1.0,
            0.01,
            30.0,
            20.0,
            1.0,
            Altitude(2_100.0, "msl"),
        ),
        VehicleState(0.0, 30_000.0, 1.5, 60.0),
    ],
    "route": [RoutePoint(100 + i, 9_000.0 + 9_000.0 * i, 0.0) for i in range(6)],
    "options": QUICK,
    "own_altitude": Altitude(2_000.0, "msl", 1.0),
}

ODD = (
    math.nan,
    math.inf,
    -math.inf,
    -0.0,
    5e-324,
    1e300,
    -1e300,
    1e7,
    -1.0,
    0.0,
    1.0,
    60.0,
    101.0,
    1e-3,
    0.5,
    0,
    1,
    -1,
    2,
    99,
    2**31,
    2**63,
    -(10**30),
    10**5_000,
    True,
    False,
    None,
    "",
    "12",
    "nan",
    b"1",
    1j,
    Fraction(1, 3),
    object,
    (),
    [],
    {},
    [1.0],
    (1.0, 2.0, 3.0, 4.0),
    np.float32(2.0),
    np.float64("nan"),
    np.int64(3),
    np.bool_(True),
    np.array(1.0),
    np.ones(3),
    np.array([]),
    np.datetime64("2024-01-01"),
    np.str_("x"),
    np.longdouble("1e400"),
    GOOD["own"],
    GOOD["intruders"][0],
    GOOD["route"][0],
    QUICK,
    Requirement(1_000.0),
    SURROGATE,
    Altitude(1.0, "msl"),
)


def places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of everything in a request, inner nodes included."""
    if path:
        yield path
    if isinstance(node, dict):
        steps: Any = node
    elif hasattr(node, "_fields"):
        steps = node._fields
    elif dataclasses.is_dataclass(node):
        steps = [field.name for field in dataclasses.fields(node)]
    else:
        steps = range(len(node)) if isinstance(node, list) else ()
    for step in steps:
        yield from places(child(node, step), (*path, step))


def child(node: Any, step: Any) -> Any:
    return node[step] if isinstance(node, dict | list) else getattr(node, step)


def put(node: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Return a copy of a request with something else at a path."""
    if not path:
        return value
    step, *rest = path
    inner = put(child(node, step), tuple(rest), value)
    if isinstance(node, dict):
        return node | {step: inner}
    if isinstance(node, list):
        return [*node[:step], inner, *node[step + 1 :]]
    return (
        node._replace(**{step: inner})
        if hasattr(node, "_fields")
        else dataclasses.replace(node, **{step: inner})
    )


PLACES = tuple(places(GOOD))


def answer_of(request: dict[str, Any]) -> Plan | RequestError:
    """Ask, and check that the answer is one of the three that are allowed."""
    question = dict(request)
    try:
        answer = plan(
            question["own"],
            question["intruders"],
            question["route"],
            POLICY,
            question["options"],
            own_altitude=question["own_altitude"],
        )
    except RequestError as refusal:
        assert refusal.field
        assert str(refusal).startswith(f"{refusal.field} ")
        assert len(str(refusal)) < 300
        return refusal
    if answer.safe:
        assert answer.reasons == ()
        assert_confirmed(question, answer)
    else:
        assert answer.reasons
        assert all(reason.message for reason in answer.reasons)
    return answer


def assert_confirmed(question: dict[str, Any], answer: Plan) -> None:
    """Judge a SAFE plan by the independent re-simulation."""
    options = question["options"] or Options.for_aircraft(PAPER)
    reports = [one if isinstance(one, Intruder) else Intruder(one) for one in question["intruders"]]
    rows = [_at_request(one) for one in reports]
    columns = np.array(rows, dtype=float).reshape(len(rows), 10).T
    traffic = Traffic(VehicleState(*columns[:4]), np.ones(len(rows), dtype=bool), *columns[4:])
    x, y = (
        np.array([getattr(point, name) for point in question["route"]], dtype=float)
        for name in ("x", "y")
    )
    own = VehicleState(*(float(value) for value in question["own"]))
    truth = Request(VehicleState(*map(np.array, own)), traffic, x, y, np.array(len(x)))
    asked = published.Question(own, reports, question["route"], question["own_altitude"], truth)
    assert published.faults(asked, answer, options) == []
    plan_states, last, arrays = take(published.as_arrays(asked, answer, options), None)
    limits = options.limits
    limits = limits._replace(
        speed_max=max(limits.speed_max, own.speed) + 1e-6,
        speed_min=min(limits.speed_min, own.speed) - 1e-6,
    )
    route = Route(arrays.route_x, arrays.route_y, arrays.points, last)
    verdict = resimulate(plan_states, arrays.own, arrays.traffic, route, options, limits)
    assert {name for name, one in zip(CHECKS, verdict.wrong[:, 0], strict=True) if one} == set()


def _at_request(report: Intruder) -> tuple[float, ...]:
    """Return an intruder at the request from its report: state, turn and uncertainty."""
    x, y, heading, speed = report.state
    age, lasts = report.age, report.turn_time
    rate = report.turn_rate if lasts > 0.0 else 0.0
    moved = complex(displacement(heading, speed, rate, lasts, age))
    turned = heading + rate * min(age, lasts)
    left = max(lasts - age, 0.0)
    return (
        x + moved.real,
        y + moved.imag,
        turned,
        speed,
        rate,
        left,
        report.position_std,
        report.velocity_std,
        abs(age),
        math.nan if report.separation is None else report.separation,
    )


def test_the_request_that_is_spoiled_is_a_good_one() -> None:
    answer = answer_of(GOOD)
    assert isinstance(answer, Plan)
    assert answer.safe
    assert len(PLACES) > 60


@pytest.mark.parametrize("path", PLACES, ids=lambda path: ".".join(map(str, path)))
def test_nothing_odd_in_one_place_gets_through(path: tuple[Any, ...]) -> None:
    for value in (
        math.nan,
        math.inf,
        -math.inf,
        10**5_000,
        True,
        None,
        "12",
        (),
        np.ones(3),
        object(),
    ):
        answer_of(put(GOOD, path, value))


@settings(max_examples=60)
@given(st.lists(st.tuples(st.sampled_from(PLACES), st.sampled_from(ODD)), min_size=1, max_size=3))
def test_nothing_odd_in_some_places_gets_through(
    changes: list[tuple[tuple[Any, ...], Any]],
) -> None:
    request = GOOD
    # Longer paths first: what is inside of something odd cannot be reached.
    for path, value in sorted(changes, key=lambda change: -len(change[0])):
        request = put(request, path, value)
    answer_of(request)


angles = st.floats(-2.0 * math.pi, 2.0 * math.pi)
near = st.floats(-3_000.0, 3_000.0)
far = st.one_of(near, st.floats(-60_000.0, 60_000.0))
abeam = st.one_of(st.floats(1_500.0, 60_000.0), st.floats(-60_000.0, 60_000.0))
vehicles = st.builds(
    VehicleState,
    far,
    abeam,
    angles,
    st.one_of(st.sampled_from([0.0, 400.0]), st.floats(0.0, 400.0)),
)
reports = st.builds(
    Intruder,
    vehicles,
    st.floats(-0.5, 5.1),
    st.sampled_from([0.0, 0.0, 0.05, -0.5, 1e-9, 1e-12]),
    st.sampled_from([0.0, 1e-9, 20.0, 60.0, 1_000.0]),
    st.sampled_from([0.0, 0.0, 50.0, 10_000.0]),
    st.sampled_from([0.0, 0.0, 2.0, 100.0]),
    st.one_of(
        st.none(),
        st.builds(Altitude, st.floats(0.0, 4_000.0), st.sampled_from(["msl", "pressure"])),
    ),
    st.sampled_from([None, None, None, 1.0, 300.0, 1_500.0, 4_000.0]),
    st.sampled_from([None, None, 1.0, 150.0, 2_000.0]),
)
own_speeds = st.one_of(st.floats(49.0, 101.0), st.sampled_from([50.0, 100.0, 101.0]))
owns = st.builds(VehicleState, near, near, st.one_of(st.floats(-1.0, 1.0), angles), own_speeds)
points = st.builds(RoutePoint, st.integers(0, 40), far, far)


@st.composite
def ways(draw: st.DrawFn) -> list[RoutePoint]:
    """Return a route that leads somewhere: points at some distance, each leg with a course of its
    own.
    """
    x, y, route = draw(st.floats(0.0, 15_000.0)), draw(near), []
    bend = draw(st.sampled_from([0.0, 0.3, 3.0]))
    for index in draw(st.permutations(range(draw(st.integers(2, 14))))):
        route.append(RoutePoint(index, x, y))
        length, course = (
            draw(st.sampled_from([500.0, 3_000.0, 9_000.0, 20_000.0])),
            draw(st.floats(-bend, bend)),
        )
        x, y = x + length * math.cos(course), y + length * math.sin(course)
    return route


routes = st.one_of(
    ways(),
    ways(),
    st.lists(points, max_size=6),
    st.builds(
        lambda step, count, x: [RoutePoint(i, x + step * i, 0.0) for i in range(count)],
        st.floats(0.5, 20_000.0),
        st.integers(0, 20),
        st.floats(-20_000.0, 30_000.0),
    ),
)
asked = st.builds(
    lambda goal_radius, **more: Options.for_aircraft(
        PAPER._replace(goal_radius=goal_radius), **more
    ),
    requirement=st.builds(
        Requirement,
        st.sampled_from([1_000.0] * 8 + [1.0, 2_000.0, 50_000.0]),
        st.sampled_from([0.0, 0.1, 50.0]),
        st.sampled_from([0.0, 2.0, 10.0]),
    ),
    goal_radius=st.sampled_from([500.0, 500.0, 500.0, 100.0, 1_000.0, 50_000.0]),
    rejoin_by=st.sampled_from([300.0, 300.0, 20.0, 100.0, 340.0]),
    direct=st.booleans(),
    goals=st.sampled_from([1, 2, 100]),
    extend_route=st.booleans(),
    vertical_filter=st.sampled_from([0.0, 600.0]),
    fallback_cost_threshold=st.sampled_from([0.0, 1_500.0, math.inf]),
    exhaustive=st.just(False),
    deadline_s=st.just(math.inf),
)


@settings(max_examples=50)
@given(owns, st.lists(st.one_of(reports, vehicles), max_size=4), routes, asked, st.booleans())
def test_any_geometry_is_refused_unresolved_or_solved(
    own: VehicleState, intruders: list[Any], route: list[RoutePoint], options: Options, level: bool
) -> None:
    altitude = Altitude(2_000.0, "msl", -2.0) if level else None
    answer_of(
        {
            "own": own,
            "intruders": intruders,
            "route": route,
            "options": options,
            "own_altitude": altitude,
        }
    )


def vehicles_limits(usual: Limits) -> st.SearchStrategy[Limits]:
    """Return limits of which some are others than usual."""
    return st.builds(
        Limits,
        st.sampled_from([usual.speed_min, usual.speed_min, 0.0, 1.0, 50.0, 99.0, 101.0]),
        st.sampled_from([usual.speed_max, usual.speed_max, 49.0, 60.0, 100.0, 500.0]),
        st.sampled_from([usual.acceleration_min, -20.0, -0.5, -1e-9, -0.0]),
        st.sampled_from([usual.acceleration_max, 1e-3, 0.375, 20.0]),
        st.sampled_from([usual.yaw_rate_max, usual.yaw_rate_max, 1e-4, 0.05, 0.5]),
    )


@settings(max_examples=30)
@example(Limits(0.0, 49.0, -20.0, 1e-3, 1e-4), Limits(0.0, 49.0, -20.0, 0.375, 1e-4), True)
@given(vehicles_limits(C208_PUBLISHED), vehicles_limits(QUICK.manoeuvre), st.booleans())
def test_any_limits_are_refused_unresolved_or_kept(
    vehicle: Limits, manoeuvre: Limits, conflict: bool
) -> None:
    request = put(put(GOOD, ("options", "limits"), vehicle), ("options", "manoeuvre"), manoeuvre)
    answer_of(request if conflict else request | {"intruders": GOOD["intruders"][1:]})


@settings(max_examples=25)
@given(owns, st.floats(0.0, 1_000.0 - 2.0 * CLOSE), angles, vehicles)
def test_a_start_inside_the_separation_is_never_safe(
    own: VehicleState, away: float, bearing: float, vehicle: VehicleState
) -> None:
    close = vehicle._replace(x=own.x + away * math.cos(bearing), y=own.y + away * math.sin(bearing))
    answer = answer_of(GOOD | {"own": own, "intruders": [close]})
    assert isinstance(answer, RequestError) or not answer.safe
