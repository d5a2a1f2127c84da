"""The attack finds nothing wrong with the planner, and everything that is made wrong on purpose."""

import copy
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from agents.check import RefusedError, accept
from agents.planner import plan
from agents.planner.answer import Excluded, Plan
from agents.planner.planner import plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.request import Altitude, Intruder, Options, Request
from agents.policy.inference import Policy
from benchmarks.safety import attack, certificates, judgement, mutation, published, sky
from benchmarks.safety import run as safety
from benchmarks.safety.adversary import draw_requests, scale, variants
from benchmarks.safety.attack import Batch, Tally, tasks
from benchmarks.safety.reflight import refly
from benchmarks.safety.resimulation import CHECKS, Route, fly, resimulate
from commands.command import ConfigError
from envs.aircraft import PAPER
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.kinematics import VehicleState
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import take
from envs.waypoints import PlanStates, RoutePoint, at, legs
from envs.wind import Wind
from tests.agents.scenes import PATIENT

OPTIONS = replace(PATIENT, exhaustive=False)
ROUTE = [RoutePoint(100 + i, 12_000.0 + 5_000.0 * i, 0.0) for i in range(9)]


class Plans(NamedTuple):
    """SAFE plans that come near their intruder; fields ``[N]``."""

    plan_states: PlanStates
    request: Request
    last: Any
    separation: Any


@pytest.fixture(scope="module")
def policy() -> Policy:
    return Policy.load()


@pytest.fixture(scope="module")
def plans(policy: Policy) -> Plans:
    request = request_of(encounters_of_seed(scenario("circle", PAPER), 11, 0, 40), PAPER)
    best = plan_many(request, policy, OPTIONS).candidates
    near = np.flatnonzero(best.safe & (best.min_separation < 1_060.0))[:6]
    assert near.size >= 3
    return take(Plans(best.plan_states, request, best.last, best.min_separation), near)


def failed_checks(plans: Plans) -> set[str]:
    """Return the checks that fail for all of the plans."""
    request = plans.request
    route = Route(request.route_x, request.route_y, request.points, plans.last)
    verdict = resimulate(
        plans.plan_states, request.own, request.traffic, route, OPTIONS, OPTIONS.limits
    )
    return {name for name, wrong in zip(CHECKS, verdict.wrong, strict=True) if wrong.all()}


def nearest(plans: Plans) -> tuple[Any, Any]:
    """Return which waypoint is nearest to the intruder, ``[N]``, and the unit vector to it there,
    complex.
    """
    state = plans.request.traffic.state
    other = (
        state.x + 1j * state.y + state.speed * np.exp(1j * state.heading) * plans.plan_states.time
    )
    away = other - plans.plan_states.x - 1j * plans.plan_states.y
    which = 1 + np.argmin(np.abs(away[:, 1:20]), axis=1)
    to = away[np.arange(len(which)), which]
    return which, to / np.abs(to)


def change_waypoints(plans: Plans, name: str, column: Any, change: Any) -> Plans:
    """Return plans with one field of one waypoint of each changed."""
    field = np.array(getattr(plans.plan_states, name))
    field[np.arange(len(field)), column] += change
    return plans._replace(plan_states=plans.plan_states._replace(**{name: field}))


def towards_the_intruder(plans: Plans) -> Plans:
    which, to = nearest(plans)
    # Waypoints are not where the plan comes closest: the more there is to spare, the further one
    # must be moved.
    far = 60.0 + 3.0 * (plans.separation - 1_000.0)
    return change_waypoints(
        change_waypoints(plans, "x", which, far * to.real), "y", which, far * to.imag
    )


def all_towards_the_intruder(plans: Plans) -> Plans:
    # From the direction at the closest approach, found on a grid of half a second.
    curves, other = legs(plans.plan_states), plans.request.traffic.state
    times = np.arange(0.0, 380.0, 0.5)
    own = at(curves, times[:, None])
    place = (own.x + 1j * own.y).T
    start = (other.x + 1j * other.y)[:, :1]
    away = start + (other.speed * np.exp(1j * other.heading))[:, :1] * times - place
    rows = np.arange(len(away))
    closest = away[rows, np.argmin(np.abs(away), axis=1)]
    shift = (plans.separation - 990.0) * closest / np.abs(closest)
    state = plans.request.traffic.state
    moved = state._replace(x=state.x - shift.real[:, None], y=state.y - shift.imag[:, None])
    return plans._replace(
        request=plans.request._replace(traffic=plans.request.traffic._replace(state=moved))
    )


def too_fast(plans: Plans) -> Plans:
    return change_waypoints(
        plans, "speed", 10, OPTIONS.limits.speed_max + 20.0 - plans.plan_states.speed[:, 10]
    )


def later(plans: Plans) -> Plans:
    return plans._replace(
        plan_states=plans.plan_states._replace(time=1.01 * plans.plan_states.time)
    )


def a_second_later(plans: Plans) -> Plans:
    return change_waypoints(plans, "time", 20, 1.0)


MUTATIONS: dict[str, tuple[Callable[[Plans], Plans], set[str]]] = {
    "the intruder moved": (all_towards_the_intruder, {"required", "separation"}),
    "times scaled": (later, {"times"}),
    "the last time": (a_second_later, set()),
    "times in disorder": (lambda plans: change_waypoints(plans, "time", 5, 30.0), {"not finite"}),
    "a speed beyond the limit": (too_fast, {"speed", "acceleration"}),
    "a reversed heading": (
        lambda plans: change_waypoints(plans, "heading", 10, 3.0),
        {"turn rate"},
    ),
    "a heading beyond pi": (
        lambda plans: change_waypoints(plans, "heading", 10, 2.0 * math.pi),
        {"heading"},
    ),
    "not a number": (lambda plans: change_waypoints(plans, "y", 7, math.nan), {"not finite"}),
    "infinite": (lambda plans: change_waypoints(plans, "speed", 19, math.inf), {"not finite"}),
    "another start": (lambda plans: change_waypoints(plans, "x", 0, 0.01), {"start"}),
    "another end": (lambda plans: change_waypoints(plans, "y", 20, 0.1), {"last"}),
    "an end that is not the route's": (
        lambda plans: plans._replace(last=plans.request.points),
        {"last"},
    ),
    "a waypoint out of reach": (lambda plans: change_waypoints(plans, "x", 4, 3_000.0), {"leg"}),
}


def test_untouched_plans_are_confirmed(plans: Plans) -> None:
    route = Route(plans.request.route_x, plans.request.route_y, plans.request.points, plans.last)
    request = plans.request
    verdict = resimulate(
        plans.plan_states, request.own, request.traffic, route, OPTIONS, OPTIONS.limits
    )
    assert not verdict.wrong.any()
    np.testing.assert_allclose(verdict.min_separation, plans.separation, atol=0.01)
    flight = refly(plans.plan_states, request, OPTIONS.requirement, OPTIONS.limits)
    assert not (flight.too_close | flight.astray).any()
    np.testing.assert_allclose(flight.separation, plans.separation, atol=0.11)


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_spoiled_plan_is_found(plans: Plans, name: str) -> None:
    spoil, expected = MUTATIONS[name]
    checks = failed_checks(spoil(plans))
    assert checks >= expected
    if not expected:
        route = Route(
            plans.request.route_x, plans.request.route_y, plans.request.points, plans.last
        )
        own, traffic = plans.request.own, plans.request.traffic
        verdict = resimulate(spoil(plans).plan_states, own, traffic, route, OPTIONS, OPTIONS.limits)
        assert verdict.wrong.any()


def test_a_waypoint_nearer_to_the_intruder_is_found(plans: Plans) -> None:
    spoiled = towards_the_intruder(plans)
    for number in range(len(plans.last)):
        assert failed_checks(take(spoiled, slice(number, number + 1)))


@pytest.mark.slow
def test_the_follower_finds_a_near_intruder_and_a_plan_that_starts_elsewhere(plans: Plans) -> None:
    moved = all_towards_the_intruder(plans)
    assert refly(
        moved.plan_states, moved.request, OPTIONS.requirement, OPTIONS.limits
    ).too_close.all()
    own = plans.request.own
    elsewhere = plans.request._replace(own=own._replace(x=own.x + 0.5))
    assert refly(plans.plan_states, elsewhere, OPTIONS.requirement, OPTIONS.limits).astray.all()


@pytest.mark.slow
def test_the_follower_judges_each_intruder_by_its_own_separation(plans: Plans) -> None:
    moved = all_towards_the_intruder(plans)  # to 990 m
    for own, wrong in ((600.0, False), (985.0, False), (1_000.0, True)):
        shape = moved.request.traffic.mask.shape
        traffic = moved.request.traffic._replace(separation=np.full(shape, own))
        request = moved.request._replace(traffic=traffic)
        flight = refly(moved.plan_states, request, OPTIONS.requirement, OPTIONS.limits)
        assert (flight.too_close == wrong).all()


@pytest.mark.slow
def test_the_follower_does_not_judge_beyond_the_plan(plans: Plans) -> None:
    # An intruder that stands where the plan would lead ten seconds after its last waypoint.
    curves, end = legs(plans.plan_states), plans.plan_states.time[:, -1]
    state = at(curves, end)
    ahead = 10.0 * state.speed
    other = plans.request.traffic.state
    x, y = state.x + ahead * np.cos(state.heading), state.y + ahead * np.sin(state.heading)
    away = 1_005.0 - ahead
    place = (x + away * np.cos(state.heading), y + away * np.sin(state.heading))
    standing = type(other)(place[0][:, None], place[1][:, None], other.heading, 0.0 * other.speed)
    request = plans.request._replace(traffic=plans.request.traffic._replace(state=standing))
    flight = refly(plans.plan_states, request, OPTIONS.requirement, OPTIONS.limits)
    assert not flight.too_close.any()
    assert np.all(flight.separation < 1_020.0)


def test_what_plan_publishes_is_judged_too(policy: Policy) -> None:
    requests = take(draw_requests(0, 0, 12), slice(0, 12))
    for row in range(12):
        asked = published.question(0, row, take(requests.request, row), 1_000.0)
        answer = asked.ask(policy, OPTIONS)
        if answer.safe and asked.intruders and not answer.excluded:
            break
    else:
        pytest.fail("none of the requests has a SAFE plan")
    assert published.faults(asked, answer, OPTIONS) == []

    def with_index(number: int, index: int) -> Any:
        points = list(answer.waypoints)
        points[number] = replace(points[number], index=index)
        return replace(answer, waypoints=tuple(points))

    assert published.faults(asked, with_index(3, answer.waypoints[4].index), OPTIONS) == ["indices"]
    assert published.faults(asked, with_index(3, asked.route[0].index), OPTIONS) == ["indices"]
    assert published.faults(asked, with_index(19, 10**6), OPTIONS) == ["last index"]
    assert published.faults(asked, replace(answer, waypoints=answer.waypoints[1:]), OPTIONS) == [
        "count"
    ]
    left_out = replace(answer, excluded=(Excluded(0, "is far above", 1e3),))
    level = asked._replace(altitude=Altitude(2_000.0, "msl", 0.0))

    def above(height: float, climb: float) -> list[Intruder]:
        return [
            replace(
                asked.intruders[0],
                altitude=Altitude(height, "msl", climb),
                vertical_separation=None,
            ),
            *asked.intruders[1:],
        ]

    assert published.faults(level._replace(intruders=above(3_000.0, 0.0)), left_out, OPTIONS) == []
    assert published.faults(level._replace(intruders=above(3_000.0, -2.0)), left_out, OPTIONS) == [
        "vertical"
    ]
    assert published.faults(level._replace(intruders=above(2_500.0, 0.0)), left_out, OPTIONS) == [
        "vertical"
    ]


STRAIGHT = PlanStates(
    np.array([-2e3, 0.0, 2e3]),
    np.zeros(3),
    np.zeros(3),
    np.full(3, 100.0),
    np.array([0.0, 20.0, 40.0]),
)
SHAPES = {
    "circle": (Circle(0.0, 1_500.0, 500.0), Keep.OUT, 1_000.0),
    "corner": (Polygon(((-3.0, 1e3), (-400.0, 2e3), (400.0, 2e3))), Keep.OUT, 1_000.0),
    "hole": (
        Polygon(
            ((-9e3, -9e3), (9e3, -9e3), (9e3, 9e3), (-9e3, 9e3)),
            (((-3e3, -1e3), (3e3, -800.0), (3e3, 2e3), (-3e3, 2e3)),),
        ),
        Keep.OUT,
        math.cos(math.atan(1.0 / 30.0)) * (900.0 - 2e3 / 30.0),
    ),
    "kept in": (Circle(0.0, 0.0, 5_000.0), Keep.IN, 3_000.0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_judge_of_areas_is_good_to_millimetres(name: str) -> None:
    shape, keep, away = SHAPES[name]
    options = replace(OPTIONS, requirement=OPTIONS.requirement._replace(margin=0.0))
    for blows in (0j, 12.0 - 5.0j):  # an area that moves with the air is the same as in still air
        wind = Wind(blows.real, blows.imag)
        for more, faults in ((-0.01, []), (0.01, ["area"])):
            velocity = (blows.real, blows.imag)
            area = Area(shape, keep, velocity, clearance=away + more, valid_from=0.01)
            around = sky.Sky(wind, (area,))
            assert sky.faults(around, fly(STRAIGHT), options, None) == faults
            # It grows by what the clearance lacks, or counts at another height or time only.
            grows = replace(area, clearance=away - 1.0, growth=-0.2 if keep is Keep.IN else 0.2)
            assert sky.faults(sky.Sky(wind, (grows,)), fly(STRAIGHT), options, None) == ["area"]
            late = replace(area, valid_from=40.1)
            assert sky.faults(sky.Sky(wind, (late,)), fly(STRAIGHT), options, None) == []
            high = replace(area, floor=Level(1e3, "msl"))
            below = sky.faults(
                sky.Sky(wind, (high,)), fly(STRAIGHT), options, Altitude(900.0, "msl", 0.0)
            )
            assert below == ([] if keep is Keep.OUT else faults)


def test_the_judge_of_other_winds_finds_what_is_not_narrowed() -> None:
    sigmas, limits = OPTIONS.requirement.sigmas, OPTIONS.limits
    wind = Wind(5.0, 0.0, 3.0 / sigmas)
    options = replace(OPTIONS, limits=limits._replace(speed_max=103.0))
    assert sky.faults(sky.Sky(wind, ()), fly(STRAIGHT), options, None) == []
    faster = STRAIGHT._replace(speed=np.array([100.0, 101.0, 101.0]))
    faster = faster._replace(x=np.array([-2e3, 10.0, 2_030.0]))
    assert sky.faults(sky.Sky(wind, ()), fly(faster), options, None) == ["speed in another wind"]
    turned = STRAIGHT._replace(heading=np.array([0.0, 1.6, 0.0]))
    rate = float(np.abs(legs(PlanStates(*(field[None] for field in turned))).yaw_rate).max())
    narrow = replace(options, limits=limits._replace(speed_max=200.0, yaw_rate_max=rate))
    assert "turn rate in another wind" in sky.faults(sky.Sky(wind, ()), fly(turned), narrow, None)


def test_plans_in_wind_and_among_areas_are_judged_in_the_air_mass(policy: Policy) -> None:
    requests, seen = draw_requests(53, 0, 40), 0
    for row in range(40):
        asked = published.question(53, row, take(requests.request, row), 1_000.0)
        if asked.sky.wind is None or not asked.sky.areas:
            continue
        answer = asked.ask(policy, OPTIONS)
        if not answer.safe:
            continue
        states, last, request = take(published.as_arrays(asked, answer, OPTIONS), None)
        route = Route(request.route_x, request.route_y, request.points, last)
        verdict = resimulate(states, request.own, request.traffic, route, OPTIONS, OPTIONS.limits)
        assert not verdict.wrong.any()
        flown = fly(take(states, 0))
        assert sky.faults(asked.sky, flown, OPTIONS, asked.altitude) == []
        # Somewhere else, or in another wind, the same waypoints are no plan.
        other = asked._replace(sky=sky.Sky(Wind(0.0, 30.0), ()))
        states, last, request = take(published.as_arrays(other, answer, OPTIONS), None)
        route = Route(request.route_x, request.route_y, request.points, last)
        verdict = resimulate(states, request.own, request.traffic, route, OPTIONS, OPTIONS.limits)
        assert verdict.wrong.any()
        seen += 1
        if seen == 3:
            break
    assert seen == 3


def test_moved_certificates_are_refused_where_the_judge_finds_them_wrong(policy: Policy) -> None:
    ahead = Area(Circle(12_000.0, -300.0, 1_500.0), clearance=50.0)
    around = sky.Sky(Wind(5.0, -3.0, 0.5), (ahead,))
    own = VehicleState(0.0, 0.0, 0.0, 80.0)
    answer = plan(own, [], ROUTE, policy, OPTIONS, wind=around.wind, areas=around.areas)
    assert answer.safe
    truth = take(draw_requests(0, 0, 1).request, 0)
    asked = published.Question(own, [], ROUTE, None, truth, around)
    flown, tally = fly(take(published.as_arrays(asked, answer, OPTIONS)[0], ())), Tally()
    for number in range(24):
        moved = sky.move(around, np.random.default_rng(number))
        assert attack._certificates(tally, asked, answer, flown, moved, OPTIONS) == []
    assert tally.counts["certificate moved and wrong"] > 3
    assert tally.counts["certificate moved and right"] > 3


def any_aircraft(number: int, policy: Policy) -> tuple[published.Question, Plan, Options]:
    """Return a request of seed 54 for any aircraft, its plan without a deadline, and options."""
    hundred = number // attack.HUNDRED * attack.HUNDRED
    aircraft = Batch(54, (hundred,), number, number + 1, True, "", True).aircraft
    drawn = draw_requests(54, number, 1)
    usual = list(variants(aircraft).values())[drawn.variant[0]]
    options = replace(usual, deadline_s=math.inf, exhaustive=False)
    request = take(scale(drawn.request, aircraft), 0)
    asked = published.question(54, number, request, aircraft.separation)
    answer = asked.ask(policy.for_aircraft(aircraft, outside="allow"), options)
    return asked, answer, options


@pytest.mark.parametrize("number", [2827, 3243, 4267, 4559, 4746, 5426])
def test_plans_over_what_an_area_has_left_are_certified(policy: Policy, number: int) -> None:
    asked, answer, options = any_aircraft(number, policy)
    assert answer.safe and answer.certificate is not None
    flown = fly(take(published.as_arrays(asked, answer, options)[0], ()))
    assert sky.faults(asked.sky, flown, options, asked.altitude) == []
    still = sky.Sky(asked.sky.wind, tuple(replace(one, growth=0.0) for one in asked.sky.areas))
    assert sky.faults(still, flown, options, asked.altitude) == ["area"]
    data = json.loads(answer.certificate)
    accept(data)
    for row in data["areas"]:
        row["growth"] = 0.0
    with pytest.raises(RefusedError, match="may not be kept clear of"):
        accept(data)


@pytest.mark.parametrize("deadline", [0.05, math.inf])
def test_a_plan_rejoins_at_a_point_of_its_route_not_where_that_was_extended(
    policy: Policy, deadline: float
) -> None:
    drawn = draw_requests(0, 6799, 1)
    options = list(variants(PAPER).values())[drawn.variant[0]]
    options = replace(options, deadline_s=deadline, exhaustive=False)
    asked = published.question(0, 6799, take(drawn.request, 0), PAPER.separation)
    answer = asked.ask(policy.for_aircraft(PAPER, outside="allow"), options)
    assert (answer.goal_index is None) == (not answer.waypoints)
    assert answer.goal_index in {None, *(point.index for point in asked.route)}
    assert published.faults(asked, answer, options) == []


def test_a_start_beyond_the_speed_limit_may_stay_there_and_no_faster(
    policy: Policy, plans: Plans
) -> None:
    fast = plans.request._replace(
        own=plans.request.own._replace(speed=np.full(len(plans.last), 100.5))
    )
    every = plan_many(fast, policy, OPTIONS).candidates
    solved = np.flatnonzero(every.safe)[:1]  # so fast, not all of these can be solved
    assert solved.size
    best, request, one = take(every, solved), take(fast, solved), take(plans, solved)
    drawn_ = take(draw_requests(0, 0, 1), slice(0, 1))._replace(request=request)
    tally = Tally()
    attack.judge(tally, 0, drawn_, best.plan_states, best.last, OPTIONS)
    assert tally.violations == []
    faster = change_waypoints(
        one._replace(plan_states=best.plan_states, request=request),
        "speed",
        1,
        100.7 - best.plan_states.speed[:, 1],
    )
    attack.judge(tally, 0, drawn_, faster.plan_states, best.last, OPTIONS)
    assert "speed" in {violation["check"] for violation in tally.violations}


def test_batches_follow_from_the_numbers_alone() -> None:
    whole = set(tasks(0, 0, 6_400, 0, 6_400))
    hundreds = sorted(hundred for batch in whole for hundred in batch.hundreds)
    assert hundreds == list(range(0, 6_400, 100))
    (one,) = tasks(0, 1_234, 1, 0, 6_400)
    assert one.hundreds in {batch.hundreds for batch in whole}
    assert 1_200 in one.hundreds
    for batch in whole:
        variants = {int(draw_requests(0, hundred, 1).variant[0]) for hundred in batch.hundreds}
        assert len(variants) == 1


@pytest.mark.slow
def test_parts_of_a_batch_add_up_to_it(policy: Policy, monkeypatch: pytest.MonkeyPatch) -> None:
    batch, sum_ = Batch(0, (0,), 0, 40, False), Tally()
    requests = draw_requests(0, 0, 100).request
    answer = plan_many(requests, policy.for_aircraft(PAPER, outside="allow"), OPTIONS)

    def known_answer(request: Request, *_: Any) -> Any:
        np.testing.assert_array_equal(request.own.x, requests.own.x)
        return answer

    monkeypatch.setattr(attack, "plan_many", known_answer)
    for first in (0, 20):
        sum_.add(attack.attack(batch._replace(first=first, end=first + 20), policy))
    whole = attack.attack(batch, policy).figures()
    assert sum_.figures() == whole
    assert whole["requests"] == 40


def last_line(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    return json.loads(capsys.readouterr().out.strip().splitlines()[-1])


@pytest.mark.slow
def test_a_small_attack_finds_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = [
        "--first",
        "30",
        "--requests",
        "150",
        "--single",
        "10",
        "--workers",
        "1",
        "--block",
        "100",
    ]
    assert safety.main([*arguments, "--out", str(tmp_path)]) == 0
    figures = last_line(capsys)
    assert figures["complete"]
    assert figures["requests"] == 150
    assert sum(figures["through_plan"].values()) == 10
    assert figures["safe"] > 60
    assert figures["violations"] == 0
    assert figures["smallest_clearance_m"] >= 0.0
    assert 0.5 < max(figures["largest_limit_use"].values()) <= 1.000001
    assert sum(asked for asked, _ in figures["families"].values()) == 150
    assert len((tmp_path / "batches.jsonl").read_text(encoding="utf-8").splitlines()) == 4


def test_violations_are_counted_written_and_lead_to_a_failure(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def wrong(batch: Batch, policy: Policy) -> Tally:
        tally = Tally()
        tally.blame("separation", batch.hundreds[0] + 7, separation=999.0)
        tally.requests["circle"] += 100
        return tally

    monkeypatch.setattr(safety, "attack", wrong)
    arguments = [
        "--requests",
        "300",
        "--single",
        "0",
        "--workers",
        "1",
        "--block",
        "100",
        "--out",
        str(tmp_path),
    ]
    assert safety.main(arguments) == 1
    assert last_line(capsys)["violations_by_check"] == {
        "separation": {"count": 3, "first": [7, 107, 207]}
    }
    file = tmp_path / "batches.jsonl"
    _, *lines = file.read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)[1]["violations"][0]["number"] for line in lines] == [7, 107, 207]

    # What is done counts again and is not attacked again; a line that an interruption cut off is.
    file.write_text(file.read_text(encoding="utf-8")[:-5], encoding="utf-8")
    calls: list[Batch] = []
    monkeypatch.setattr(
        safety, "attack", lambda batch, policy: calls.append(batch) or wrong(batch, policy)
    )
    assert safety.main(arguments) == 1
    assert [batch.hundreds for batch in calls] == [(200,)]
    assert last_line(capsys)["violations_by_check"] == {
        "separation": {"count": 3, "first": [7, 107, 207]}
    }
    assert safety.main(arguments) == 1
    assert last_line(capsys)["families"]["circle"] == [300, 0] and len(calls) == 1
    with pytest.raises(ConfigError, match="holds another attack"):
        safety.main([*arguments, "--seed", "1"])


def test_an_interrupted_attack_prints_what_was_done(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(batch: Batch, policy: Policy) -> Tally:
        if batch.hundreds[0] >= 200:
            raise KeyboardInterrupt
        tally = Tally()
        tally.requests["circle"] += 100
        return tally

    monkeypatch.setattr(safety, "attack", interrupt)
    assert (
        safety.main(["--requests", "900", "--single", "0", "--workers", "1", "--block", "100"]) == 0
    )
    figures = last_line(capsys)
    assert not figures["complete"]
    assert figures["requests"] == 200


def test_a_planner_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch, policy: Policy) -> None:
    def broken(*_: Any) -> Any:
        return np.log(np.array([-1.0]))

    monkeypatch.setattr(attack, "plan_many", broken)
    (violation,) = attack.attack(Batch(0, (100,), 117, 200, False), policy).violations
    assert violation["check"] == "exception"
    assert violation["number"] == 117
    assert "RuntimeWarning" in violation["what"]


@pytest.mark.slow
@pytest.mark.long
def test_a_longer_attack_by_two_processes_finds_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        safety.main(["--seed", "1", "--requests", "5000", "--single", "300", "--workers", "2"]) == 0
    )
    figures = last_line(capsys)
    assert figures["requests"] == 5_000
    assert figures["reflown"] > 50
    assert figures["violations"] == 0


@pytest.mark.slow
def test_the_judgement_is_exact_for_aircraft_that_turn_fast(policy: Policy) -> None:
    # Random aircraft of up to 30 deg/s; this plan turns by 0.26 rad in half a second.
    tally = attack.attack(Batch(7, (25_000,), 25_021, 25_022, False, any_aircraft=True), policy)
    assert tally.safe.total() == 1 and not tally.violations


# The attack on certificates: its judgement is good to micrometres, and a stopped run goes on.


@pytest.fixture(scope="module")
def data() -> dict[str, Any]:
    intruders = [
        Intruder(
            VehicleState(9_000.0, 100.0, 3.14, 80.0),
            age=0.4,
            turn_rate=0.01,
            turn_time=20.0,
            position_std=5.0,
            velocity_std=0.5,
            altitude=Altitude(2_500.0, "msl", 0.0),
        ),
        Intruder(VehicleState(5_000.0, 600.0, -2.0, 70.0), altitude=Altitude(5_500.0, "msl", 0.0)),
    ]
    own = VehicleState(0.0, 0.0, 0.0, 80.0)
    answer = plan(
        own, intruders, ROUTE, Policy.load(), PATIENT, own_altitude=Altitude(2_500.0, "msl", 0.0)
    )
    assert answer.certificate is not None
    return json.loads(answer.certificate)


@pytest.mark.parametrize(("nearer", "fault"), [(-1e-5, ""), (1e-5, "distance"), (5.0, "distance")])
def test_judgement_is_good_to_some_micrometres(
    data: dict[str, Any], nearer: float, fault: str
) -> None:
    edited = copy.deepcopy(data)
    mutation.approach(edited, 0, edited["requirement"]["separation"] - nearer)
    assert judgement.wrong([edited]) == [fault]


@pytest.mark.parametrize(
    ("path", "change", "fault"),
    [
        (("own", 0), 0.01, "joint"),
        (("waypoints", 5, 2), 1e-4, "course"),
        (("waypoints", 5, 4), 25.0, "times"),
        (("controls", 4, 3), 3e-6, "controls"),
        (("controls", 4, 13), 3e-6, "controls"),
        (("limits", "speed_max"), -30.0, "speed"),
        (("limits", "acceleration_max"), -0.6, "acceleration"),
        (("limits", "yaw_rate_max"), -0.08, "turn rate"),
        (("bounds", 0), 0.1, "distance"),
        (("intruders", 0, 7), -6.0, "negative"),
        (("excluded", 0, 2), -2_500.0, "excluded"),
    ],
)
def test_judgement_finds_each_fault(
    data: dict[str, Any], path: tuple[Any, ...], change: float, fault: str
) -> None:
    edited = copy.deepcopy(data)
    place = edited
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] += change
    found, good = judgement.wrong([edited, data])
    assert fault in found.split(", ")
    assert not good


@pytest.mark.parametrize("name", ["separation", "margin"])
def test_judgement_finds_a_requirement_above_the_distance(data: dict[str, Any], name: str) -> None:
    edited = copy.deepcopy(data)
    more = data["bounds"][0] - data["intruders"][0][9] + 1.0
    if name == "separation":
        edited["intruders"][0][9] += more
    else:
        edited["requirement"][name] += more
    assert judgement.wrong([edited]) == ["distance"]


def test_sampled_flight_is_the_legs(data: dict[str, Any]) -> None:
    flight = judgement.flights([data])
    nodes, weights = np.polynomial.legendre.leggauss(30)
    for arc in range(0, 200, 17):
        psi, v, w, a, h = (
            float(field[0, arc])
            for field in (
                flight.heading,
                flight.speed,
                flight.rate,
                flight.acceleration,
                flight.length,
            )
        )
        t = 0.5 * h * (1.0 + nodes)
        far = np.sum(0.5 * h * weights * (v + a * t) * np.exp(1j * (psi + w * t)))
        assert flight.at(0, arc, h) - flight.place[0, arc] == pytest.approx(far, abs=1e-9)


def test_command_counts_and_goes_on(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(certificates, "BLOCK", 8)

    def run(plans: int) -> dict[str, Any]:
        assert (
            certificates.main(["--plans", str(plans), "--workers", "1", "--out", str(tmp_path)])
            == 0
        )
        return json.loads(capsys.readouterr().out.splitlines()[-1])

    first = run(1)
    assert first["complete"] and not first["failures"]
    kinds = sum(count for name, count in first["counts"].items() if name.startswith("moved"))
    assert kinds == first["counts"]["certificates"] >= 1

    path = tmp_path / "blocks.jsonl"
    written = path.read_bytes()
    path.write_bytes(written + b'{"seed": 0, "block": 1, "cou')
    more = first["counts"]["certificates"] + 1
    second = run(more)
    assert second["counts"]["certificates"] >= more
    assert path.read_bytes().startswith(written)
    assert all(
        json.loads(line)["block"] == block
        for block, line in enumerate(path.read_text().splitlines())
    )
    assert run(more)["counts"] == second["counts"]


def test_what_the_checker_gets_wrong_is_a_failure(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(certificates, "BLOCK", 8)
    monkeypatch.setattr(certificates.check, "accept", lambda data: math.inf)
    assert certificates.main(["--plans", "1", "--workers", "1"]) == 1
    failures = json.loads(capsys.readouterr().out.splitlines()[-1])["failures"]
    assert any("is wrong and accepted" in problem for problem in failures)


def test_another_seed_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "blocks.jsonl").write_text(
        json.dumps({"seed": 3, "block": 0}) + "\n", encoding="utf-8"
    )
    with pytest.raises(certificates.InputError, match="--seed 3"):
        certificates.main(["--seed", "4", "--out", str(tmp_path)])
