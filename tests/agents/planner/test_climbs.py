"""Plans that climb and descend, flown again by a simulation of its own."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from agents.config.world import AircraftConfig
from agents.kernel.levels import Altitude
from agents.planner.answer import Kind, Plan, RequestError, Source
from agents.planner.judge.profile import profile_faults
from agents.planner.planner import plan
from agents.planner.recheck import recheck
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.reports import Intruder
from envs.aircraft import PAPER, Vertical
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.frames import Ground
from envs.kinematics import VehicleState
from envs.profile import profile_of
from envs.waypoints import RoutePoint, at, legs, plan_states, repeat
from envs.wind import Wind
from tests.agents.planner.test_separations import POLICY
from tests.envs.test_profile import add_up

VERTICAL = Vertical(5.0, 4.0, 1.0, 140.0)
AIRCRAFT = PAPER._replace(vertical=VERTICAL)
ROUTE = [RoutePoint(index, 5_000.0 * (index + 1), 0.0) for index in range(9)]
LEVEL = Altitude(2_000.0, "msl", 0.0)
UNKNOWN = 10.0  # m/s of climb where it is unknown


def options(maneuvers: Maneuvers = Maneuvers.BOTH, **changes: object) -> Options:
    """Return options without a deadline."""
    fields = {"extend_route": True, "deadline_s": math.inf, "maneuvers": maneuvers, **changes}
    return Options.for_aircraft(AIRCRAFT, **fields)


class Scene(NamedTuple):
    """A request that may climb."""

    own: VehicleState[Ground]
    altitude: Altitude
    intruders: list[Intruder[Ground]]
    wind: Wind | None

    def plan(self, plan_options: Options, areas: Sequence[Area] = ()) -> Plan:
        """Return its plan."""
        own, altitude, intruders, wind = self
        return plan(
            own,
            intruders,
            ROUTE,
            POLICY,
            plan_options,
            own_altitude=altitude,
            wind=wind,
            areas=areas,
        )


def head_on(altitude: Altitude | None = LEVEL, far: float = 9_000.0) -> Intruder[Ground]:
    """Return an intruder that comes along the route."""
    return Intruder(VehicleState(far, 0.0, math.pi, 70.0), altitude=altitude)


OWN: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, 75.0)
SIMPLE = Scene(OWN, LEVEL, [head_on()], None)


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a request among intruders at random levels and rates: exact and uncertain ones, of
    unknown climb, altitude or another reference.
    """
    intruders = list[Intruder[Ground]]()
    for _ in range(rng.integers(1, 5)):
        course, far = rng.uniform(-math.pi, math.pi), rng.uniform(3_000.0, 9_000.0)
        speed = rng.uniform(50.0, 110.0)
        # Towards where the ownship is by then.
        time = far / speed
        x = 75.0 * time - far * math.cos(course) + rng.uniform(-700.0, 700.0)
        y = -far * math.sin(course) + rng.uniform(-700.0, 700.0)
        climb = None if rng.random() < 0.1 else float(rng.choice([0.0, rng.uniform(-6.0, 6.0)]))
        height = LEVEL.value + rng.uniform(-400.0, 400.0) - (climb or 0.0) * time
        exact = rng.random() < 0.5
        altitude: Altitude | None = Altitude(
            height,
            "wgs84" if rng.random() < 0.05 else "msl",
            climb,
            0.0 if exact else 20.0,
            0.0 if exact else 0.3,
        )
        if rng.random() < 0.05:
            altitude = None
        intruders.append(
            Intruder(
                VehicleState(x, y, course, speed),
                age=0.0 if exact else 1.0,
                position_std=0.0 if exact else 20.0,
                velocity_std=0.0 if exact else 0.5,
                altitude=altitude,
            )
        )
    climb = float(rng.choice([0.0, rng.uniform(-3.0, 4.0)]))
    altitude = Altitude(LEVEL.value, "msl", climb, float(rng.choice([0.0, 15.0])))
    east, north = rng.uniform(-8.0, 8.0, 2).tolist()
    wind = Wind(east, north, 0.0) if rng.random() < 0.4 else None
    return Scene(OWN, altitude, intruders, wind)


def own_heights(answer: Plan, altitude: Altitude) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and the altitudes of the ownship that flies a plan, m."""
    assert altitude.vertical_speed is not None
    climb = altitude.vertical_speed
    profile = profile_of(altitude.value, climb, answer.waypoints, VERTICAL.acceleration)
    assert profile is not None
    return add_up(profile, VERTICAL.acceleration, answer.waypoints[-1].time)


def lost(answer: Plan, scene: Scene, planned_with: Options) -> list[int]:
    """Return which intruders come closer than both separations, wherever within their errors they
    are above and below, and the ownship within its own.
    """
    time, height = own_heights(answer, scene.altitude)
    curves = legs(plan_states(scene.own, answer.waypoints, wind=scene.wind))
    path = at(repeat(curves, time.size), time, scene.wind)
    bad = list[int]()
    for number, report in enumerate(scene.intruders):
        state, since = report.state, time + report.age
        x = state.x + state.speed * math.cos(state.heading) * since
        y = state.y + state.speed * math.sin(state.heading) * since
        spread = np.sqrt(report.position_std**2 + (report.velocity_std * since) ** 2)
        keeps = planned_with.requirement.separation + 2.0 * spread
        near = np.hypot(path.x - x, path.y - y) < keeps - 0.01
        altitude, own = report.altitude, scene.altitude
        if altitude is None or altitude.reference != own.reference:
            level = np.ones(time.size, dtype=bool)
        else:
            is_known = altitude.vertical_speed is not None
            rise = altitude.vertical_speed or 0.0
            widens = altitude.climb_error if is_known else UNKNOWN
            gap = np.abs(altitude.value + rise * since - height)
            unsure = own.error + altitude.error + widens * np.abs(since)
            level = gap - unsure < VERTICAL.separation
        if (near & level).any():
            bad.append(number)
    return bad


@pytest.mark.parametrize(
    "maneuvers", [pytest.param(Maneuvers.VERTICAL, marks=pytest.mark.slow), Maneuvers.BOTH]
)
def test_what_is_called_safe_keeps_one_of_both_separations(maneuvers: Maneuvers) -> None:
    rng, safe, climbs = np.random.default_rng(70), 0, 0
    climbing = options(maneuvers)
    for _ in range(24):
        scene = random_scene(rng)
        answer = scene.plan(climbing)
        if not answer.safe:
            assert answer.reasons
            continue
        assert lost(answer, scene, climbing) == []
        safe += 1
        climbs += answer.source is Source.VERTICAL
    assert safe > 8
    assert climbs > 4


def test_a_plan_that_does_not_climb_is_lost_by_the_same_simulation() -> None:
    climbing = options(Maneuvers.VERTICAL)
    answer = SIMPLE.plan(climbing)
    assert answer.safe
    flat = replace(
        answer,
        waypoints=tuple(
            replace(point, altitude=LEVEL.value, climb=0.0) for point in answer.waypoints
        ),
    )
    assert lost(flat, SIMPLE, climbing) == [0]


def test_in_the_plane_nothing_changes_with_what_an_aircraft_can_climb() -> None:
    rng = np.random.default_rng(71)
    plane = Options.for_aircraft(PAPER, extend_route=True, deadline_s=math.inf)
    for _ in range(10):
        scene = random_scene(rng)
        first, second = scene.plan(plane), scene.plan(options(Maneuvers.HORIZONTAL))
        assert first == second
        assert all(point.altitude is None for point in second.waypoints)


def test_a_climb_along_the_route_does_not_leave_it() -> None:
    answer = SIMPLE.plan(options(Maneuvers.VERTICAL))
    assert answer.safe
    assert answer.source is Source.VERTICAL
    assert max(abs(point.y) for point in answer.waypoints) < 1e-6
    heights = [point.altitude for point in answer.waypoints]
    assert max(abs(height - LEVEL.value) for height in heights if height is not None) > 140.0
    assert heights[-1] == pytest.approx(LEVEL.value)


def test_up_and_down_are_alike() -> None:
    alike = AIRCRAFT._replace(vertical=VERTICAL._replace(descent_max=VERTICAL.climb_max))
    climbing = Options.for_aircraft(
        alike, extend_route=True, deadline_s=math.inf, maneuvers=Maneuvers.VERTICAL
    )
    for rise, above in ((0.0, 60.0), (2.0, -150.0), (-3.0, 100.0)):
        plans = []
        for side in (1.0, -1.0):
            intruder_altitude = Altitude(LEVEL.value + side * above, "msl", side * rise)
            plans.append(Scene(OWN, LEVEL, [head_on(intruder_altitude)], None).plan(climbing))
        first, second = plans
        assert first.safe == second.safe
        assert first.cost == pytest.approx(second.cost, rel=1e-9)


def test_altitudes_count_from_nowhere() -> None:
    scene = random_scene(np.random.default_rng(72))
    shifted = scene._replace(
        altitude=replace(scene.altitude, value=scene.altitude.value + 1_000.0),
        intruders=[
            replace(report, altitude=replace(report.altitude, value=report.altitude.value + 1e3))
            if report.altitude is not None and report.altitude.reference == "msl"
            else report
            for report in scene.intruders
        ],
    )
    first, second = scene.plan(options()), shifted.plan(options())
    assert first.status == second.status
    for low, high in zip(first.waypoints, second.waypoints, strict=True):
        assert low.altitude is not None
        assert high.altitude is not None
        assert high.altitude - low.altitude == pytest.approx(1_000.0, abs=1e-6)
        assert (low.x, low.y) == pytest.approx((high.x, high.y), abs=1e-6)


def test_an_unknown_climb_is_the_worst_that_is_plausible() -> None:
    unknown = Scene(OWN, LEVEL, [head_on(Altitude(LEVEL.value, "msl", None))], None)
    assert not unknown.plan(options(Maneuvers.VERTICAL)).safe


@pytest.mark.parametrize("climb", [-4.5, 5.5])
def test_a_gust_that_is_faster_than_the_aircraft_climbs_ends_no_planning(climb: float) -> None:
    """The climb at the request changes from then on; one that the margin does not hold is told."""
    scene = SIMPLE._replace(altitude=replace(LEVEL, vertical_speed=climb))
    answer = scene.plan(options(vertical_margin=15.0))
    assert answer.safe
    _, heights = own_heights(answer, scene.altitude)
    assert np.abs(heights - LEVEL.value).max() > VERTICAL.separation
    with pytest.raises(RequestError, match="are left by"):
        scene.plan(options(vertical_margin=2.0))


def test_the_cheapest_of_both_is_taken() -> None:
    for height in (0.0, 130.0):
        scene = Scene(OWN, LEVEL, [head_on(Altitude(LEVEL.value + height, "msl", 0.0))], None)
        free, up = scene.plan(options()), scene.plan(options(Maneuvers.VERTICAL))
        assert free.safe
        assert free.cost <= up.cost + 1e-9
        dear = scene.plan(options(altitude_weight=1e6))
        assert dear.source is not Source.VERTICAL


def test_a_floor_and_a_ceiling_are_kept() -> None:
    both_ways = options(Maneuvers.VERTICAL)
    assert SIMPLE.plan(both_ways).safe
    for floor, ceiling, side in ((1_990.0, None, 1.0), (None, 2_010.0, -1.0)):
        bounded = options(
            Maneuvers.VERTICAL,
            floor=None if floor is None else Level(floor, "msl"),
            ceiling=None if ceiling is None else Level(ceiling, "msl"),
        )
        answer = SIMPLE.plan(bounded)
        assert answer.safe
        _, height = own_heights(answer, LEVEL)
        assert side * (height - LEVEL.value).min() > -0.01 or side < 0.0
        assert (side * (height - LEVEL.value)).max() > 140.0
    shut = options(Maneuvers.VERTICAL, floor=Level(1_950.0, "msl"), ceiling=Level(2_050.0, "msl"))
    assert not SIMPLE.plan(shut).safe


@pytest.mark.parametrize("limit", ["floor", "ceiling"])
def test_no_plan_climbs_to_a_limit_whose_height_nobody_knows(limit: str) -> None:
    corners = (-9e3, -2e4), (5e4, -2e4), (5e4, 2e4), (-9e3, 2e4)
    level, above_ground = (
        Area(Polygon(corners), Keep.IN, **{limit: Level(2_000.0, reference)})
        for reference in ("msl", "ground")
    )
    climbs = SIMPLE.plan(options())
    assert climbs.safe and any(point.altitude is not None for point in climbs.waypoints)
    answer = SIMPLE.plan(options(), [above_ground])
    assert answer.safe and all(point.altitude is None for point in answer.waypoints)
    assert any("does not climb or descend" in advisory.text for advisory in answer.advisories)
    assert [str(advisory.field) for advisory in answer.advisories if "ground" in advisory.text] == [
        f"areas[0].{limit}.reference"
    ]
    # Nor is one that does so flown where such an area has come meanwhile.
    own, altitude, intruders, wind = SIMPLE
    late = recheck(
        climbs, 0.5, own, intruders, ROUTE, options(), altitude, wind, areas=[above_ground]
    )
    assert not late.safe and "ground" in late.reasons[0].message
    # One of the ownship's reference is kept, and one to be kept out of counts at all heights.
    assert not any("climb or descend" in a.text for a in SIMPLE.plan(options(), [level]).advisories)


def test_areas_are_flown_over_and_kept_areas_bound_the_altitude() -> None:
    low = Area(Circle(6_000.0, 0.0, 2_000.0), ceiling=Level(2_040.0, "msl"))
    alone = Scene(OWN, LEVEL, [], None)
    answer = alone.plan(options(Maneuvers.VERTICAL), [low])
    assert answer.safe
    time, height = own_heights(answer, LEVEL)
    x = np.interp(
        time,
        [0.0, *(point.time for point in answer.waypoints)],
        [0.0, *(p.x for p in answer.waypoints)],
    )
    assert height[np.abs(x - 6_000.0) < 2_000.0].min() > 2_040.0
    corners = (-9e3, -2e4), (5e4, -2e4), (5e4, 2e4), (-9e3, 2e4)
    keep = Area(Polygon(corners), Keep.IN, ceiling=Level(2_050.0, "msl"))
    down = SIMPLE.plan(options(Maneuvers.VERTICAL), [keep])
    assert down.safe
    assert own_heights(down, LEVEL)[1].max() < 2_050.0


@pytest.mark.parametrize(
    ("changes", "altitude", "message"),
    [
        ({}, None, "own_altitude is None, expected an Altitude"),
        ({}, Altitude(2_000.0, "msl"), "own_altitude.vertical_speed is None"),
        (
            {"floor": Level(100.0, "wgs84")},
            LEVEL,
            "options.floor.reference is 'wgs84', expected the ownship's, 'msl'",
        ),
        (
            {"floor": Level(2_100.0, "msl")},
            LEVEL,
            "own_altitude.value is 2000 m, expected the floor, 2100 m, or more",
        ),
        (
            {"ceiling": Level(1_900.0, "msl")},
            LEVEL,
            "own_altitude.value is 2000 m, expected the ceiling, 1900 m, or less",
        ),
        (
            {"floor": Level(2_500.0, "msl"), "ceiling": Level(1_900.0, "msl")},
            LEVEL,
            "options.floor.value is 2500 m, expected less than the ceiling, 1900 m",
        ),
        ({"maneuvers": "both"}, LEVEL, "options.maneuvers is 'both', expected Maneuvers"),
        (
            {"maneuvers": Maneuvers.HORIZONTAL, "floor": Level(100.0, "msl")},
            LEVEL,
            "options.floor is given, expected maneuvers",
        ),
        ({"vertical_margin": math.nan}, LEVEL, "options.vertical_margin is nan"),
    ],
)
def test_what_cannot_be_planned_is_refused_by_a_sentence(
    changes: dict[str, object], altitude: Altitude | None, message: str
) -> None:
    with pytest.raises(RequestError) as refused:
        plan(OWN, [], ROUTE, POLICY, replace(options(), **changes), own_altitude=altitude)
    assert message in str(refused.value)


def test_an_aircraft_that_states_no_climb_plans_in_the_plane_only() -> None:
    plain = replace(options(), aircraft=PAPER)
    with pytest.raises(RequestError, match=r"options.maneuvers is \"both\", expected"):
        plan(OWN, [], ROUTE, POLICY, plain, own_altitude=LEVEL)


def test_a_route_gives_the_altitude_that_is_regained() -> None:
    route = [replace(point, altitude=2_200.0) for point in ROUTE]
    answer = plan(OWN, [], route, POLICY, options(), own_altitude=LEVEL)
    assert answer.safe
    assert answer.waypoints[-1].altitude == pytest.approx(2_200.0)


@pytest.mark.parametrize("above", [-150.0, 0.0, 150.0])
@pytest.mark.parametrize("share", [-1.0, 1.0])
def test_the_route_is_regained_from_the_steepest_climb_and_descent(
    above: float, share: float
) -> None:
    climb = share * (VERTICAL.climb_max if share > 0.0 else VERTICAL.descent_max)
    own = Altitude(LEVEL.value + above, "msl", climb)
    route = [replace(point, altitude=LEVEL.value) for point in ROUTE]
    answer = plan(OWN, [], route, POLICY, options(), own_altitude=own)
    assert answer.safe
    profile = profile_of(own.value, climb, answer.waypoints, VERTICAL.acceleration)
    assert profile is not None and not profile_faults(profile, own, options())
    assert profile.altitude[-1] == pytest.approx(LEVEL.value)


def test_a_plan_that_comes_late_is_checked_on_what_is_left_of_its_profile() -> None:
    climbing = options(Maneuvers.VERTICAL)
    answer = SIMPLE.plan(climbing)
    profile = profile_of(LEVEL.value, 0.0, answer.waypoints, VERTICAL.acceleration)
    assert profile is not None
    late = 8.0
    own: VehicleState[Ground] = VehicleState(75.0 * late, 0.0, 0.0, 75.0)
    intruder = head_on(far=9_000.0 - 70.0 * late)
    height = profile.at(np.array(late))
    above = Altitude(float(height), "msl", float(profile.climbs[1]))
    again = recheck(answer, late, own, [intruder], ROUTE, climbing, above)
    assert again.safe
    # It has not climbed: what is left asks for more than the aircraft can do, or than is safe.
    below = replace(LEVEL, vertical_speed=0.0)
    assert not recheck(answer, late, own, [intruder], ROUTE, climbing, below).safe


@pytest.mark.parametrize(("behind", "kind"), [(0.4, None), (0.6, Kind.SPEED)])
def test_a_late_plan_is_not_too_fast_on_the_climb_from_where_the_aircraft_is(
    behind: float, kind: Kind | None
) -> None:
    """To come in time from some metres behind, 99.96 m/s over the horizon suffice, which are more
    than 100 m/s with a climb of 2.5 m/s.
    """
    climbing, late, fast = options(Maneuvers.VERTICAL), 8.0, OWN._replace(speed=99.9)
    answer = plan(fast, [head_on(far=12_000.0)], ROUTE, POLICY, climbing, own_altitude=LEVEL)
    assert answer.safe
    profile = profile_of(LEVEL.value, 0.0, answer.waypoints, VERTICAL.acceleration)
    assert profile is not None and profile.climbs[1] == pytest.approx(2.5)
    altitude = Altitude(float(profile.at(np.array(late))), "msl", float(profile.climbs[1]))
    own = fast._replace(x=fast.speed * late - behind)
    intruder = head_on(far=12_000.0 - 70.0 * late)
    again = recheck(answer, late, own, [intruder], ROUTE, climbing, altitude)
    assert again.safe == (kind is None)
    assert [reason.kind for reason in again.reasons] == ([] if kind is None else [kind])


def test_who_stays_above_is_told() -> None:
    high = head_on(Altitude(LEVEL.value + 500.0, "msl", 0.0))
    answer = plan(OWN, [high, head_on()], ROUTE, POLICY, options(), own_altitude=LEVEL)
    assert [exclusion.number for exclusion in answer.excluded] == [0]
    assert {counts.number for counts in answer.windows} <= {1}


@pytest.mark.parametrize(
    ("speed", "state", "above", "rise"),
    [
        (74.0, VehicleState(521.0, 0.0, 0.02, 72.0), -162.0, 2.7),
        (78.0, VehicleState(421.0, 754.0, -0.39, 75.0), 160.0, -3.3),
        (73.0, VehicleState(1_344.0, 1_047.0, -1.62, 69.0), -125.0, 0.0),
    ],
    ids=[
        "it never ends on the way along the route",
        "it is put off",
        "it ends before a sharp turn",
    ],
)
def test_a_climb_and_a_turn_resolve_what_neither_does(
    speed: float, state: VehicleState[Ground], above: float, rise: float
) -> None:
    aircraft = AircraftConfig.of_file(Path("c208")).aircraft()
    policy = POLICY.for_aircraft(aircraft, outside="allow")
    own: VehicleState[Ground] = VehicleState(0.0, 0.0, 0.0, speed)
    route = [RoutePoint(index, 3_000.0 + 5_000.0 * index, 0.0) for index in range(10)]
    reports = [Intruder(state, altitude=Altitude(LEVEL.value + above, "msl", rise))]
    safe = dict[Maneuvers, bool]()
    for maneuvers in Maneuvers:
        climbing = Options.for_aircraft(
            aircraft,
            deadline_s=math.inf,
            maneuvers=maneuvers,
            vertical_filter=137.2,
        )
        safe[maneuvers] = plan(own, reports, route, policy, climbing, own_altitude=LEVEL).safe
    assert safe == {
        Maneuvers.HORIZONTAL: False,
        Maneuvers.VERTICAL: False,
        Maneuvers.BOTH: True,
    }
