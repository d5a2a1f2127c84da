"""Plans keep their contract, say why they are not safe, and do not depend on how they were asked
for.
"""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.check import accept
from agents.kernel.traffic import Requirement, Traffic, Window
from agents.planner.answer import (
    WAYPOINTS,
    AdvisoryCode,
    Apart,
    Kind,
    Plan,
    RequestError,
    Source,
    Status,
)
from agents.planner.planner import plan, plan_many
from agents.planner.recheck import recheck
from agents.planner.request.encounters import request_of
from agents.planner.request.pruning import least_distance
from agents.planner.request.reports import arrays_of_reports
from agents.planner.request.request import Altitude, Intruder, Options, Request
from agents.planner.search.goals import next_goals
from agents.planner.search.rollout import roll
from agents.policy.inference import Policy
from envs.aircraft import PAPER, new_aircraft, ratios
from envs.encounters import Encounter
from envs.formats.local_frame import LocalFrame
from envs.formats.local_frame import distance as geodesic
from envs.kinematics import C208_PUBLISHED, Limits, VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import map_leaves, take
from envs.waypoints import RoutePoint, at, legs, plan_states
from envs.wind import Wind
from tests.agents.scenes import PATIENT

OPTIONS = PATIENT

OWN = VehicleState(0.0, 0.0, 0.0, 80.0)
ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]
HEAD_ON = VehicleState(9_000.0, 100.0, math.pi, 80.0)
FAR = VehicleState(0.0, 30_000.0, math.pi / 2.0, 80.0)


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module")
def encounters() -> Encounter:
    return encounters_of_seed(scenario("circle", PAPER), 7, 0, 120)


def ask(request: Request, number: int) -> tuple[VehicleState, list[VehicleState], list[RoutePoint]]:
    """Return one request of many as :func:`plan` takes it."""
    row = take(request, number)
    own = VehicleState(*(float(field) for field in row.own))
    intruders = [
        VehicleState(*(float(field[k]) for field in row.traffic.state))
        for k in np.flatnonzero(row.traffic.mask)
    ]
    points = zip(row.route_x.tolist(), row.route_y.tolist(), strict=True)
    return own, intruders, [RoutePoint(10 + i, x, y) for i, (x, y) in enumerate(points)]


def assert_contract(answer: Plan, route: list[RoutePoint]) -> None:
    """Check what every plan with a trajectory promises."""
    route_indices = {point.index for point in route}
    assert len(answer.waypoints) == WAYPOINTS
    indices = [point.index for point in answer.waypoints]
    assert len(set(indices)) == WAYPOINTS
    assert not route_indices & set(indices[:-1])
    assert [point.time for point in answer.waypoints[:-1]] == [20.0 * i for i in range(1, 20)]
    last = answer.waypoints[-1]
    assert last.time > 380.0
    where = {point.index: point for point in route}[last.index]
    assert math.hypot(where.x - last.x, where.y - last.y) < 1e-6
    assert answer.goal_index in route_indices
    assert all(-math.pi <= point.heading < math.pi for point in answer.waypoints)


def test_a_conflict_is_resolved_by_a_plan_that_keeps_its_contract(policy: Policy) -> None:
    answer = plan(OWN, [HEAD_ON], ROUTE, policy, OPTIONS)
    assert answer.status is Status.SAFE
    assert answer.reasons == ()
    assert answer.source is Source.POLICY
    assert answer.min_separation >= 1_000.0
    assert answer.goal_index == 100
    assert_contract(answer, ROUTE)


def test_without_intruders_the_route_is_flown(policy: Policy) -> None:
    for intruders in ([], [FAR]):
        answer = plan(OWN, intruders, ROUTE, policy, OPTIONS)
        assert answer.safe
        assert max(abs(point.y) for point in answer.waypoints) < 1e-6
        assert_contract(answer, ROUTE)
    assert plan(OWN, [], ROUTE, policy, OPTIONS).min_separation == math.inf


def test_every_safe_plan_keeps_its_contract(policy: Policy, encounters: Encounter) -> None:
    request = request_of(encounters, PAPER)
    plans = plan_many(request, policy, OPTIONS)
    assert plans.candidates.safe.mean() > 0.98
    for number in range(40):
        own, intruders, route = ask(request, number)
        answer = plan(own, intruders, route, policy, OPTIONS)
        if answer.waypoints:
            assert_contract(answer, route)


@pytest.mark.parametrize("part", ["begin", "end"])
def test_a_time_of_counting_that_is_no_number_is_refused(
    policy: Policy, encounters: Encounter, part: str
) -> None:
    request = take(request_of(encounters, PAPER), slice(0, 1))
    always = np.full(request.traffic.mask.shape, math.inf)
    window = Window(-always, always)._replace(**{part: math.nan * always})
    traffic = request.traffic._replace(window=window)
    with pytest.raises(RequestError, match=rf"intruders.window.{part}.* is nan, expected a finite"):
        plan_many(request._replace(traffic=traffic), policy, OPTIONS)


def test_one_request_and_many_get_the_same_answer(policy: Policy, encounters: Encounter) -> None:
    request = request_of(encounters, PAPER)
    plans = plan_many(request, policy, OPTIONS)
    for number in range(0, 120, 4):
        answer, row = plan(*ask(request, number), policy, OPTIONS), take(plans, number)
        assert answer.safe == row.candidates.safe
        assert answer.source.value == ("none", "policy", "fallback")[int(row.source)]
        # A network evaluated row by row and in tiles rounds differently; in closed loop that grows
        # to some metres.
        assert answer.min_separation == pytest.approx(float(row.candidates.min_separation), abs=5.0)
        assert answer.rejoin_time == pytest.approx(float(row.candidates.rejoin_time), abs=1.0)


def test_plans_do_not_depend_on_the_batch(policy: Policy, encounters: Encounter) -> None:
    request = request_of(encounters, PAPER)
    all_plans, part_plans = (
        plan_many(request, policy, OPTIONS),
        plan_many(take(request, slice(50, 70)), policy, OPTIONS),
    )
    np.testing.assert_array_equal(part_plans.candidates.safe, all_plans.candidates.safe[50:70])
    np.testing.assert_array_equal(
        part_plans.candidates.min_separation, all_plans.candidates.min_separation[50:70]
    )
    np.testing.assert_array_equal(
        part_plans.candidates.plan_states.x, all_plans.candidates.plan_states.x[50:70]
    )


def test_the_two_rollouts_agree(policy: Policy) -> None:
    exact = Policy.load(dtype=np.float64)
    request = request_of(
        encounters_of_seed(scenario("multi", PAPER, intruders=(2, 4)), 3, 0, 5), PAPER
    )
    goal = np.ones(5, int)
    for direct in (True, False):
        options = replace(OPTIONS, direct=direct)
        batch = roll(request, goal, exact, options)
        for number in range(5):
            row = take(request, slice(number, number + 1))
            single = roll(row, goal[:1], exact, options, floats=True)
            # The arrays' arctangent is a polynomial, 4e-8 rad off; in closed loop that grows to
            # some metres.
            np.testing.assert_allclose(single.time[0], batch.time[number], atol=1.0)
            np.testing.assert_allclose(
                single.plan_states.x[0], batch.plan_states.x[number], atol=20.0
            )
            np.testing.assert_allclose(single.path[0], batch.path[number], atol=120.0)
            assert single.direct[0] == batch.direct[number]


def test_a_pure_rollout_flies_to_the_goal(policy: Policy) -> None:
    answer = plan(OWN, [HEAD_ON], ROUTE, policy, replace(OPTIONS, direct=False))
    assert answer.safe
    assert_contract(answer, ROUTE)


class Straight(Policy):
    """Flies straight on, whatever is ahead."""

    def command(
        self,
        own: VehicleState,
        intruders: Any,
        mask: Any,
        goal_x: Any,
        goal_y: Any,
        distance_scale: Any = None,
    ) -> np.ndarray:
        return np.zeros((*np.shape(own.x), 2))


def test_the_fallback_finds_a_plan_where_the_policy_has_none(encounters: Encounter) -> None:
    request = request_of(take(encounters, slice(0, 24)), PAPER)
    plans = plan_many(request, Straight.load(), replace(OPTIONS, exhaustive=False))
    assert not plans.policy_safe.any()  # straight on, each of these encounters is a conflict
    saved = plans.candidates.safe
    assert saved.mean() > 0.5
    assert np.all(plans.source[saved] == 2)


def test_uncertain_traffic_is_avoided_without_a_refinement(
    policy: Policy, encounters: Encounter
) -> None:
    request = request_of(take(encounters, slice(0, 24)), PAPER)
    shape = request.traffic.mask.shape
    traffic = request.traffic._replace(
        position_std=np.full(shape, 30.0), velocity_std=np.full(shape, 3.0)
    )
    plans = plan_many(
        request._replace(traffic=traffic), policy, replace(OPTIONS, exhaustive=False, goals=1)
    )
    assert plans.candidates.safe.mean() > 0.8


def test_a_costly_plan_is_compared_with_the_fallback(policy: Policy, encounters: Encounter) -> None:
    request = request_of(take(encounters, slice(0, 60)), PAPER)
    never, always = (
        plan_many(request, policy, replace(OPTIONS, fallback_cost_threshold=limit)).candidates
        for limit in (math.inf, 0.0)
    )
    safe_in_both = never.safe & always.safe
    assert np.all(always.cost[safe_in_both] <= never.cost[safe_in_both] + 1e-6)
    assert always.cost[safe_in_both].mean() < never.cost[safe_in_both].mean()


def test_what_cannot_be_avoided_is_unresolved_with_reasons(policy: Policy) -> None:
    answer = plan(OWN, [VehicleState(1_400.0, 0.0, math.pi, 80.0)], ROUTE, policy, OPTIONS)
    assert answer.status is Status.UNRESOLVED
    assert answer.min_separation < 1_000.0
    assert [reason.kind for reason in answer.reasons if reason.kind is not Kind.DEADLINE] == [
        Kind.SEPARATION
    ]
    reason = answer.reasons[0]
    assert reason.field == "intruders[0]"
    assert reason.time is not None
    assert 0.0 < reason.time < 20.0
    assert f"{answer.min_separation:.1f} m" in reason.message
    assert_contract(answer, ROUTE)


def test_a_start_in_violation_is_never_safe(policy: Policy) -> None:
    answer = plan(OWN, [VehicleState(-900.0, 0.0, math.pi, 80.0)], ROUTE, policy, OPTIONS)
    assert answer.status is Status.UNRESOLVED
    assert answer.reasons[0].kind is Kind.START_IN_VIOLATION
    on_top = plan(OWN, [OWN], ROUTE, policy, OPTIONS)
    assert on_top.reasons[0].kind is Kind.START_IN_VIOLATION


@pytest.mark.parametrize(
    ("own", "route", "kind"),
    [
        (OWN, [RoutePoint(0, -9_000.0, 0.0), RoutePoint(1, -4_000.0, 0.0)], Kind.GOAL_BEHIND),
        (OWN, [RoutePoint(0, 90_000.0, 0.0), RoutePoint(1, 95_000.0, 0.0)], Kind.GOAL_TOO_FAR),
        (OWN, [RoutePoint(0, 10_000.0, 0.0), RoutePoint(1, 15_000.0, 0.0)], Kind.ROUTE_TOO_SHORT),
    ],
)
def test_routes_that_lead_nowhere_are_named(
    policy: Policy, own: Any, route: list[RoutePoint], kind: Kind
) -> None:
    answer = plan(own, [HEAD_ON], route, policy, OPTIONS)
    assert answer.status is Status.UNRESOLVED
    assert answer.reasons[-1].kind is kind
    assert answer.waypoints == ()
    assert answer.source is Source.NONE


def test_a_short_route_is_extended_only_if_allowed(policy: Policy) -> None:
    route = [RoutePoint(0, 10_000.0, 0.0), RoutePoint(1, 15_000.0, 0.0)]
    answer = plan(OWN, [HEAD_ON], route, policy, replace(OPTIONS, extend_route=True))
    assert answer.safe
    last = answer.waypoints[-1]
    assert last.index not in (0, 1)
    assert last.y == pytest.approx(0.0, abs=1e-6)
    assert (last.x - 15_000.0) % 5_000.0 == pytest.approx(0.0, abs=1e-6)
    assert len({point.index for point in answer.waypoints}) == WAYPOINTS


def test_the_next_point_is_the_first_that_lies_ahead() -> None:
    def goals(x: float, y: float) -> list[int]:
        own = VehicleState(*(np.array([value]) for value in (x, y, 0.0, 80.0)))
        column = np.zeros((1, 0))
        nobody = Traffic.straight(VehicleState(column, column, column, column))
        points = np.array([[0.0, 5_000.0, 10_000.0, 15_000.0]])
        return next_goals(Request(own, nobody, points, points * 0.0, np.array([4])), OPTIONS)[
            0
        ].tolist()

    assert goals(-3_000.0, 0.0) == [0, 1, 2]
    assert goals(-300.0, 0.0) == [1, 2, 3]  # within the radius: it counts as reached
    assert goals(2_000.0, 900.0) == [1, 2, 3]
    assert goals(12_000.0, 0.0) == [3, -1, -1]
    assert goals(15_100.0, 0.0) == [-1, -1, -1]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"own": OWN._replace(x=math.nan)}, "own.x"),
        ({"own": OWN._replace(heading=math.inf)}, "own.heading"),
        ({"own": OWN._replace(speed=45.0)}, "own.speed"),
        ({"own": OWN._replace(speed=120.0)}, "own.speed"),
        ({"own": (0.0, 0.0, 0.0, 80.0)}, "own"),
        ({"others": [HEAD_ON._replace(y=math.nan)]}, "intruders[0].y"),
        ({"others": [FAR, HEAD_ON._replace(speed=-1.0)]}, "intruders[1].speed"),
        ({"others": [Intruder(FAR, age=60.0)]}, "intruders[0].age"),
        ({"others": [Intruder(FAR, age=math.nan)]}, "intruders[0].age"),
        ({"others": [Intruder(FAR, position_std=-1.0)]}, "intruders[0].position_std"),
        (
            {"others": [FAR, Intruder(FAR, turn_rate=-0.5, turn_time=65.0)]},
            "intruders[1].turn_time",
        ),
        ({"others": HEAD_ON}, "intruders"),
        ({"route": []}, "route"),
        ({"route": ROUTE[:1]}, "route"),
        ({"route": [*ROUTE, RoutePoint(100, 90_000.0, 0.0)]}, "route[9].index"),
        ({"route": [RoutePoint(-1, 0.0, 0.0), *ROUTE]}, "route[0].index"),
        ({"route": [*ROUTE, RoutePoint(5, math.inf, 0.0)]}, "route[9].x"),
        ({"route": [ROUTE[0], RoutePoint(5, ROUTE[0].x, ROUTE[0].y)]}, "route[1]"),
    ],
)
def test_bad_input_is_refused_by_name(policy: Policy, changes: dict[str, Any], field: str) -> None:
    with pytest.raises(RequestError) as refused:
        plan(
            changes.get("own", OWN),
            changes.get("others", [HEAD_ON]),
            changes.get("route", ROUTE),
            policy,
            OPTIONS,
        )
    assert refused.value.field == field
    assert str(refused.value).startswith(field + " ")
    assert "expected" in str(refused.value)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        (replace(OPTIONS, requirement=Requirement(math.nan)), "options.requirement.separation"),
        (
            replace(OPTIONS, requirement=Requirement(1_000.0, margin=-1e9)),
            "options.requirement.margin",
        ),
        (
            replace(OPTIONS, requirement=Requirement(1_000.0, sigmas=-2.0)),
            "options.requirement.sigmas",
        ),
        (
            replace(OPTIONS, limits=C208_PUBLISHED._replace(yaw_rate_max=math.nan)),
            "options.limits.yaw_rate_max",
        ),
        (replace(OPTIONS, max_age=math.nan), "options.max_age"),
        (replace(OPTIONS, waypoints=100, spacing=200), "options.spacing"),
        (replace(OPTIONS, goals=0), "options.goals"),
        (replace(OPTIONS, goals=1.5), "options.goals"),  # pyright: ignore[reportArgumentType]
        (replace(OPTIONS, rejoin_by=1e9), "options.rejoin_by"),
        (replace(OPTIONS, direct=None), "options.direct"),  # pyright: ignore[reportArgumentType]
    ],
)
def test_options_that_could_hide_a_danger_are_refused(
    policy: Policy, options: Options, field: str
) -> None:
    with pytest.raises(RequestError) as refused:
        plan(OWN, [HEAD_ON], ROUTE, policy, options)
    assert refused.value.field == field


def test_requests_in_plain_floats_are_planned_as_if_alone(
    policy: Policy, encounters: Encounter
) -> None:
    request, options = (
        request_of(take(encounters, slice(0, 3)), PAPER),
        replace(OPTIONS, exhaustive=False),
    )
    together = plan_many(request, policy, options, floats=True).candidates
    for row in range(3):
        alone = plan_many(
            take(request, slice(row, row + 1)), policy, options, floats=True
        ).candidates
        np.testing.assert_array_equal(
            np.stack(take(together.plan_states, [row])), np.stack(alone.plan_states)
        )


def test_more_intruders_than_the_policy_was_trained_with_are_planned_for_and_said(
    policy: Policy,
) -> None:
    crowd = [HEAD_ON._replace(y=20_000.0 + 100.0 * k) for k in range(policy.most + 1)]
    answer = plan(OWN, [*crowd, HEAD_ON], ROUTE, policy, OPTIONS)
    assert answer.safe and answer.source is not Source.NONE
    messages = [
        entry.message for entry in answer.advisories if entry.code is AdvisoryCode.OUTSIDE_DOMAIN
    ]
    assert any(
        f"intruders is {len(crowd) + 1}; expected 0 to {policy.most}" in entry for entry in messages
    )
    # The one in the way is avoided, however many others the policy could look at.
    assert 1_000.0 <= answer.min_separation < 3_000.0


def question(count: int) -> tuple[VehicleState, list[VehicleState], list[RoutePoint]]:
    """Return ownship, random intruders 2 to 30 km away, evenly over that ring, and the route."""
    rng = np.random.default_rng(2)
    away = np.sqrt(rng.uniform(2_000.0**2, 30_000.0**2, count))
    bearing, course = rng.uniform(-math.pi, math.pi, (2, count))
    speed = rng.uniform(50.0, 100.0, count)
    fields = away * np.cos(bearing), away * np.sin(bearing), course, speed
    intruders = [
        VehicleState(*values) for values in zip(*(field.tolist() for field in fields), strict=True)
    ]
    route = [RoutePoint(i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]
    return VehicleState(0.0, 0.0, 0.0, 80.0), intruders, route


def test_plan_among_a_hundred_is_the_same_however_they_are_numbered(policy: Policy) -> None:
    options = replace(OPTIONS, exhaustive=False)
    start, intruders, route = question(100)
    first = plan(start, intruders, route, policy, options)
    again = plan(start, intruders[::-1], route, policy, options)
    assert first.safe and again.waypoints == first.waypoints
    orders = stack_rows([intruders, intruders[::-1]])
    x, y = (np.array([[getattr(p, axis) for p in route]] * 2) for axis in "xy")
    own = VehicleState(*(np.full(2, value) for value in start))
    together = plan_many(
        Request(own, Traffic.straight(orders), x, y, np.full(2, len(route))), policy, options
    )
    places = np.stack(together.candidates.plan_states, axis=-1)[:, 1:]
    flown = [[p.x, p.y, p.heading, p.speed, p.time] for p in first.waypoints]
    np.testing.assert_array_equal(places[0], places[1])
    np.testing.assert_allclose(places[0], flown, atol=1.0)


def test_row_with_few_intruders_is_planned_as_alone_beside_a_crowd(policy: Policy) -> None:
    start, intruders, route = question(30)
    # One crosses the route behind the goal, where only a crowd's search looks.
    intruders[-1] = VehicleState(25_000.0, -25_000.0, 0.5 * math.pi, 80.0)
    x, y = (np.array([[getattr(p, axis) for p in route]] * 2) for axis in "xy")
    own, points = VehicleState(*(np.full(2, value) for value in start)), np.full(2, 9)
    traffic = Traffic.straight(stack_rows([intruders, intruders]))
    traffic.mask[0, :-2] = False
    request, options = Request(own, traffic, x, y, points), replace(OPTIONS, exhaustive=False)
    together = plan_many(request, policy, options)
    for row in range(2):
        single = take(request, [row])
        present = take(single.traffic, (slice(None), single.traffic.mask[0]))
        alone = plan_many(single._replace(traffic=present), policy, options)
        candidate, expected = take(together, [row]).candidates, alone.candidates
        map_leaves(np.testing.assert_array_equal, candidate.plan_states, expected.plan_states)
        assert candidate.findings.clearance == expected.findings.clearance
        # Intruders go by their numbers in the request.
        names = np.flatnonzero(single.traffic.mask[0])
        blamed = expected.findings.intruder[0]
        assert candidate.findings.intruder[0] == (names[blamed] if blamed >= 0 else -1)


def stack_rows(rows: list[list[VehicleState]]) -> VehicleState:
    """Return intruders of requests as arrays ``[N, K]``."""
    return VehicleState(*np.moveaxis(np.array(rows), -1, 0))


@pytest.mark.parametrize("turn_rate", [0.0, 0.05])
@pytest.mark.parametrize("velocity_std", [0.0, 2.0])
def test_intruder_that_cannot_come_near_is_left_out_and_only_then(
    policy: Policy, turn_rate: float, velocity_std: float
) -> None:
    points = np.array([[point.x, point.y] for point in ROUTE])
    end = float(OPTIONS.latest_end(OWN.speed, *points.T))
    uncertain = 2.0 * velocity_std * (end + 1.0)
    reach = PAPER.traffic_speed_max * (end + 1.0) + OPTIONS.limits.speed_max * end
    edge = reach + OPTIONS.requirement.separation + OPTIONS.requirement.margin + uncertain
    edge *= 1.0 + (edge / 6.3e6) ** 2 / 5.0  # a local frame may stretch distances
    for beyond, left_out in ((-5.0, False), (5.0, True)):
        far = VehicleState(edge + beyond, 0.0, math.pi, 80.0)
        intruder = Intruder(far, 1.0, turn_rate, 30.0, velocity_std=velocity_std)
        answer = plan(OWN, [intruder], ROUTE, policy, OPTIONS)
        assert answer.safe
        assert [exclusion.apart for exclusion in answer.excluded] == [Apart.FAR] * left_out
        # It is proven like any other.
        proven = accept(json.loads(answer.certificate or b""))
        assert len(proven.reports) == 1 and proven.bounds[0] > 0.0


@pytest.mark.parametrize("latitude", [0.0, 47.0, -72.0])
def test_least_distance_is_below_that_on_the_earth(latitude: float) -> None:
    """And close to it, at distances at which intruders are left out."""
    frame, rng = LocalFrame(latitude, 8.0), np.random.default_rng(1)
    for reach in (1e5, 3e5, 9e5):
        for own_x, own_y, x, y in rng.uniform(-0.7, 0.7, (50, 4)) * [4e4, 4e4, reach, reach]:
            places = [frame.geodetic(*at) for at in ((own_x, own_y), (x, y))]
            true = geodesic(*(float(part) for place in places for part in place[:2]))
            own, intruder = (VehicleState(*at, 0.0, 50.0) for at in ((own_x, own_y), (x, y)))
            assert 0.99 * true - 50.0 <= least_distance(own, intruder) <= true


ODD = {
    "bool": True,
    "text": "12",
    "bytes": b"1",
    "none": None,
    "huge": 10**5000,
    "complex": 1j,
    "array": np.ones(2),
}


@pytest.mark.parametrize("value", ODD.values(), ids=ODD)
def test_what_is_not_a_number_is_refused(policy: Policy, value: Any) -> None:
    with pytest.raises(RequestError) as refused:
        plan(OWN._replace(x=value), [HEAD_ON], ROUTE, policy, OPTIONS)
    assert refused.value.field == "own.x"
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("speed", [49.0, 49.5, 100.3, 101.0])
def test_a_speed_just_outside_the_envelope_is_planned_with(policy: Policy, speed: float) -> None:
    assert plan(OWN._replace(speed=speed), [HEAD_ON], ROUTE, policy, OPTIONS).safe
    assert plan(OWN._replace(speed=speed), [], ROUTE, policy, OPTIONS).safe


def test_a_plan_says_what_traffic_is_outside_the_domain(
    policy: Policy, encounters: Encounter
) -> None:
    own, intruders, route = ask(request_of(encounters, PAPER), 0)
    outside = AdvisoryCode.OUTSIDE_DOMAIN
    assert outside not in [
        advisory.code for advisory in plan(own, intruders, route, policy, OPTIONS).advisories
    ]
    intruders[0] = intruders[0]._replace(speed=5.0)
    departures = [
        advisory
        for advisory in plan(own, intruders, route, policy, OPTIONS).advisories
        if advisory.code is outside
    ]
    assert (departures[0].field, departures[0].text.split(";")[0]) == ("intruder_speed", "is 5 m/s")


@pytest.mark.parametrize(
    ("separation", "is_said"), [(299.0, False), (3_000.0, False), (200.0, True), (3_100.0, True)]
)
def test_a_plan_says_which_separations_are_outside_the_domain(
    policy: Policy, separation: float, is_said: bool
) -> None:
    answer = plan(OWN, [Intruder(HEAD_ON, separation=separation)], ROUTE, policy, OPTIONS)
    fields = [
        advisory.field
        for advisory in answer.advisories
        if advisory.code is AdvisoryCode.OUTSIDE_DOMAIN
    ]
    assert ("intruder_separation" in fields) == is_said


def test_the_vertical_filter_looks_to_the_end_of_the_plan(policy: Policy) -> None:
    # Clear for 500 s, but the last leg is 80 km long, and the other one comes down on its way.
    route = [RoutePoint(0, 0.0, 0.0), RoutePoint(1, 10_000.0, 0.0), RoutePoint(2, 90_000.0, 0.0)]
    own, late = VehicleState(0.0, 0.0, 0.0, 75.0), 1_100.0
    state = VehicleState(own.speed * late, -50.0 * late, math.pi / 2.0, 50.0)
    intruder = Intruder(state, altitude=Altitude(2_110.0, "msl", -1.0))
    answer = plan(
        own, [intruder], route, policy, OPTIONS, own_altitude=Altitude(1_000.0, "msl", 0.0)
    )
    assert answer.excluded == ()
    assert not answer.safe or answer.min_separation >= 1_000.0


def test_an_intruder_far_above_is_left_out_and_said_so(policy: Policy) -> None:
    def answer(level: Altitude | None, own: Altitude | None) -> Plan:
        return plan(
            OWN, [FAR, Intruder(HEAD_ON, altitude=level)], ROUTE, policy, OPTIONS, own_altitude=own
        )

    own_altitude = Altitude(2_500.0, "msl", 0.0)
    above = answer(Altitude(3_500.0, "msl", 0.0), own_altitude)
    assert [exclusion.number for exclusion in above.excluded] == [1]
    assert "msl" in above.excluded[0].reason
    assert max(abs(point.y) for point in above.waypoints) < 1e-6
    for level, own in (
        (None, own_altitude),
        (Altitude(3_500.0, "msl", 0.0), None),
        (Altitude(3_500.0, "wgs84", 0.0), own_altitude),
        (Altitude(3_000.0, "msl", 0.0), own_altitude),
        (Altitude(3_500.0, "msl"), own_altitude),
        (Altitude(3_500.0, "msl", 0.0), Altitude(2_500.0, "msl")),
        (Altitude(3_500.0, "msl", 0.0, error=500.0), own_altitude),
        (Altitude(3_500.0, "msl", vertical_speed=-10.0), own_altitude),
    ):
        counted = answer(level, own)
        assert counted.excluded == ()
        assert max(abs(point.y) for point in counted.waypoints) > 100.0
    # It is level only once both have passed each other.
    late = answer(Altitude(3_500.0, "msl", vertical_speed=-5.0), own_altitude)
    assert late.excluded == ()
    assert late.windows[0].begin == pytest.approx(80.0)
    assert max(abs(point.y) for point in late.waypoints) < 1e-6


def test_no_plan_outlasts_what_an_intruder_was_left_out_for(
    policy: Policy, monkeypatch: pytest.MonkeyPatch
) -> None:
    level = Altitude(2_500.0, "msl", 0.0)
    above = [Intruder(FAR, altitude=Altitude(3_500.0, "msl", 0.0))]
    good = plan(OWN, above, ROUTE, policy, OPTIONS, own_altitude=level)
    assert good.safe
    ends = Options.latest_end

    def too_early(
        options: Options, own_speed: Any, x: Any, y: Any, points: Any = None, wind: Any = 0.0
    ) -> Any:
        return 300.0 if points is None else ends(options, own_speed, x, y, points, wind)

    monkeypatch.setattr(Options, "latest_end", too_early)
    answer = plan(OWN, above, ROUTE, policy, OPTIONS, own_altitude=level)
    assert not answer.safe and answer.certificate is None
    assert [(finding.kind, finding.field) for finding in answer.reasons] == [
        (Kind.SEPARATION, "intruders[0]")
    ]
    late = recheck(
        good, 20.0, OWN._replace(x=OWN.x + 20.0 * OWN.speed), above, ROUTE, OPTIONS, level
    )
    assert not late.safe and "left out" in late.reasons[0].message


def test_a_late_report_is_dead_reckoned(policy: Policy) -> None:
    old = HEAD_ON._replace(x=HEAD_ON.x + 4.0 * HEAD_ON.speed)
    a, b = (
        plan(OWN, [HEAD_ON], ROUTE, policy, OPTIONS),
        plan(OWN, [Intruder(old, age=4.0)], ROUTE, policy, OPTIONS),
    )
    assert a.min_separation == pytest.approx(b.min_separation, abs=1.0)


def test_margin_and_uncertainty_are_kept(policy: Policy) -> None:
    wide = plan(
        OWN,
        [HEAD_ON],
        ROUTE,
        policy,
        replace(OPTIONS, requirement=Requirement(1_000.0, margin=300.0)),
    )
    assert wide.safe
    assert wide.min_separation >= 1_300.0
    vague = plan(
        OWN, [Intruder(HEAD_ON, position_std=50.0, velocity_std=2.0)], ROUTE, policy, OPTIONS
    )
    assert vague.safe
    time = vague.time_of_min_separation
    assert vague.min_separation >= 1_000.0 + 2.0 * math.hypot(50.0, 2.0 * time) - 1.0


def test_an_expected_turn_is_planned_for(policy: Policy) -> None:
    abeam = VehicleState(0.0, 4_000.0, 0.0, 80.0)
    straight = plan(OWN, [abeam], ROUTE, policy, OPTIONS)
    turning = plan(
        OWN, [Intruder(abeam, turn_rate=-math.radians(1.5), turn_time=60.0)], ROUTE, policy, OPTIONS
    )
    assert straight.safe
    assert turning.safe
    assert straight.min_separation == pytest.approx(4_000.0, abs=1.0)
    assert 1_000.0 <= turning.min_separation < 3_900.0


def test_starts_inside_the_margin_are_not_refused_by_it(policy: Policy) -> None:
    for distance in np.arange(1_000.0, 1_051.0, 5.0):
        behind = VehicleState(-distance, 0.0, math.pi, 80.0)
        answer = plan(
            OWN,
            [behind],
            ROUTE,
            policy,
            replace(OPTIONS, requirement=Requirement(1_000.0, margin=50.0)),
        )
        assert answer.safe, distance


def scale_request(request: Request, number: int, length: float, pace: float) -> tuple[Any, ...]:
    own, intruders, route = ask(request, number)

    def state(original: VehicleState) -> VehicleState:
        return VehicleState(
            length * original.x, length * original.y, original.heading, pace * original.speed
        )

    return (
        state(own),
        [state(original) for original in intruders],
        [replace(p, x=length * p.x, y=length * p.y) for p in route],
    )


class InOtherUnits:
    """The paper's policy, asked in the units of an aircraft of the same ratios."""

    decider = None  # it decides interpreted

    def __init__(self, policy: Policy, length: float, pace: float) -> None:
        self._policy, self._units, self.domain = policy, (length, length, 1.0, pace), policy.domain
        self.sha256, self.most = policy.sha256, policy.most

    def command_one(
        self,
        own: VehicleState,
        intruders: Any,
        goal_x: float,
        goal_y: float,
        distance_scale: Any = None,
    ) -> tuple[float, float]:
        own, *intruders_scaled = (
            VehicleState(*(v / u for v, u in zip(s, self._units, strict=True)))
            for s in (own, *intruders)
        )
        return self._policy.command_one(
            own, intruders_scaled, goal_x / self._units[0], goal_y / self._units[0], distance_scale
        )

    def departures(self, *scene: Any) -> list[str]:
        return []


@pytest.mark.parametrize(("length", "pace"), [(2.0, 1.0), (0.5, 1.0)])
def test_aircraft_of_the_same_ratios_get_the_same_plans_scaled(
    policy: Policy, length: float, pace: float
) -> None:
    # At other speeds legs differ a little: a receiver knows their curve from the waypoints alone
    # (envs.waypoints).
    unit = pace / length

    def in_units(limits: Limits) -> Limits:
        return Limits(
            pace * limits.speed_min,
            pace * limits.speed_max,
            pace * unit * limits.acceleration_min,
            pace * unit * limits.acceleration_max,
            unit * limits.yaw_rate_max,
        )

    scaled_aircraft = new_aircraft(
        in_units(PAPER.limits),
        length * PAPER.separation,
        dt=PAPER.dt / unit,
        vehicle=in_units(PAPER.vehicle_limits),
    )
    assert ratios(scaled_aircraft.limits, scaled_aircraft.separation) == pytest.approx(
        ratios(PAPER.limits, PAPER.separation)
    )
    mine, theirs = (
        replace(Options.for_aircraft(item, exhaustive=False), deadline_s=math.inf)
        for item in (PAPER, scaled_aircraft)
    )
    alike: Any = InOtherUnits(policy, length, pace)
    sources = set()
    for drawn in (scenario("circle", PAPER), scenario("multi", PAPER, intruders=(2, 4))):
        request = request_of(encounters_of_seed(drawn, 6, 0, 10), PAPER)
        for number in range(10):
            answer = plan(*ask(request, number), policy, mine)
            scaled = plan(*scale_request(request, number, length, pace), alike, theirs)
            assert (scaled.status, scaled.source, scaled.goal_index) == (
                answer.status,
                answer.source,
                answer.goal_index,
            )
            for item, two in zip(answer.waypoints, scaled.waypoints, strict=True):
                expected = (
                    length * item.x,
                    length * item.y,
                    item.heading,
                    pace * item.speed,
                    item.time / unit,
                )
                assert (two.x, two.y, two.heading, two.speed, two.time) == pytest.approx(
                    expected, rel=1e-6, abs=1e-3
                )
            sources.add(answer.source)
    assert sources >= {Source.POLICY, Source.FALLBACK}


def test_no_plan_outlasts_its_bound(policy: Policy) -> None:
    rng = np.random.default_rng(7)
    count, points = 60, 8
    spacing = 10.0 ** rng.uniform(2.5, 5.0, (count, points))
    course = np.cumsum(rng.uniform(-1.5, 1.5, (count, points)), axis=1)
    speed = rng.uniform(49.0, 100.0, count)
    zeros = np.zeros(count)
    own = VehicleState(zeros, zeros, course[:, 0], speed)
    route_x = np.cumsum(spacing * np.cos(course), axis=1)
    route_y = np.cumsum(spacing * np.sin(course), axis=1)
    reports, _ = arrays_of_reports([Intruder(VehicleState(30_000.0, 0.0, 3.0, 80.0))])
    traffic = map_leaves(lambda field: np.repeat(field, count, axis=0), reports)
    request = Request(own, traffic, route_x, route_y, np.full(count, points))
    for extend in (False, True):
        options = Options.for_aircraft(PAPER, exhaustive=False, extend_route=extend)
        ends = plan_many(request, policy, options).candidates.plan_states.time[:, -1]
        exists = np.isfinite(ends)
        assert exists.sum() > 20
        bound = options.latest_end(speed, route_x, route_y, request.points)
        assert np.all(ends[exists] <= bound[exists])


def test_a_slow_ownship_s_last_leg_is_inside_the_bound(policy: Policy) -> None:
    """The last leg of 150 km takes 3061 s at 49 m/s, below the lowest speed of manoeuvres."""
    own = VehicleState(0.0, 0.0, 0.0, 49.0)
    route = [
        RoutePoint(0, 12_000.0, 0.0),
        RoutePoint(1, 17_000.0, 0.0),
        RoutePoint(2, 167_000.0, 0.0),
    ]
    answer = plan(own, [], route, policy, replace(OPTIONS, fallback_cost_threshold=math.inf))
    x, y = np.array([(point.x, point.y) for point in route]).T
    assert answer.waypoints[-1].time <= OPTIONS.latest_end(49.0, x, y)


@pytest.mark.parametrize("wind", [None, Wind(8.0, -3.0)])
def test_a_point_of_the_route_that_is_skipped_is_said(wind: Wind | None) -> None:
    route = [RoutePoint(3 + number, 8_000.0 + 6_000.0 * number, 0.0) for number in range(9)]
    own = VehicleState(0.0, 0.0, 0.0, 80.0)

    def skipped(intruders: list[VehicleState]) -> list[str]:
        answer = plan(own, intruders, route, Policy.load(), OPTIONS, wind=wind)
        assert answer.safe
        texts = [entry.message for entry in answer.advisories if entry.code is AdvisoryCode.SKIPPED]
        # The same by sampling the curve that is flown.
        states = plan_states(own, answer.waypoints, wind=wind)
        curve = map_leaves(lambda field: field[None], legs(states))
        times = np.arange(0.0, answer.waypoints[-1].time, 0.25)
        flown = at(
            map_leaves(lambda field: np.repeat(field, times.size, axis=0), curve), times, wind
        )
        away = [float(np.hypot(flown.x - entry.x, flown.y - entry.y).min()) for entry in route]
        missed = [
            entry.index
            for entry, far in zip(route, away, strict=True)
            if far > PAPER.goal_radius and entry.x < answer.waypoints[-1].x
        ]
        assert [f"(waypoint {index})" for index in missed] == [
            text[text.index("(") : text.index(")") + 1] for text in texts
        ]
        return texts

    assert skipped([]) == []
    # It stands where the first point of the route is.
    (text,) = skipped([VehicleState(8_000.0, 0.0, 0.0, 0.0)])
    assert text.startswith("skipped: route[0] (waypoint 3) is skipped")


@pytest.mark.slow
@pytest.mark.parametrize("speed", [40.0, 70.0])
def test_of_the_points_of_a_leg_the_best_is_rejoined_and_no_corner_is_left_out(
    policy: Policy, speed: float
) -> None:
    leg = [RoutePoint(i, 6_000.0 + 1_000.0 * i, 0.0) for i in range(9)]
    corner = [RoutePoint(20 + i, leg[-1].x, 5_000.0 * i) for i in range(1, 9)]
    first = replace(OPTIONS, goals=12, exhaustive=False)
    best = replace(first, rejoin_on_leg=True)
    rng, gained = np.random.default_rng(3), 0
    for meeting_time, way in rng.uniform((50.0, -math.pi), (80.0, math.pi), (8, 2)):
        vx, vy = speed * math.cos(way), speed * math.sin(way)
        traffic = [VehicleState(meeting_time * (OWN.speed - vx), -vy * meeting_time, way, speed)]
        first_plan, best_plan = (
            plan(OWN, traffic, leg + corner, policy, entry) for entry in (first, best)
        )
        assert best_plan.safe or not first_plan.safe
        if not first_plan.safe:
            continue
        assert best_plan.goal_index is not None
        assert best_plan.goal_index <= leg[-1].index, "the corner is flown over"
        assert best_plan.cost <= first_plan.cost
        if first_plan.cost <= OPTIONS.fallback_cost_threshold:
            assert best_plan == first_plan, "what costs little is not weighed up"
        gained += best_plan.cost < first_plan.cost - 300.0
        # Points of other legs than that of the next point are not as welcome.
        bent = [leg[0], *(replace(point, x=leg[0].x) for point in corner)]
        around_corner = (plan(OWN, traffic, bent, policy, entry) for entry in (first, best))
        assert len({entry.goal_index for entry in around_corner}) == 1
    assert gained >= 2
