"""A plan that climbs is judged by its own altitude, a backup by that in which it levels off."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.assurance import single
from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_flight, backup_profile
from agents.assurance.climbs import Met, times_met
from agents.assurance.single import Assessment, Watch
from agents.assurance.space import hold
from agents.assurance.state import FlyMode, State
from agents.assurance.thresholds import Cause, Thresholds
from agents.kernel.levels import Altitude, Line, steady
from agents.kernel.traffic import Traffic
from agents.planner import plan
from agents.planner.answer import Plan
from agents.planner.recheck import reconstruct
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.reports import Intruder
from agents.policy.inference import Policy
from envs.aircraft import PAPER, Vertical
from envs.areas import Area, Circle, Keep, Level, Polygon
from envs.kinematics import VehicleState
from envs.profile import Profile, corner_error, first_corner, profile_of, rise_to_level
from envs.trees import take
from envs.waypoints import RoutePoint, Waypoint, at, legs, plan_states
from envs.wind import Wind

SPEED, LEVEL, TOP = 75.0, 2_500.0, 2_687.5  # m/s, m
VERTICAL = Vertical(climb_max=5.0, descent_max=5.0, acceleration=1.0, separation=137.0)
OPTIONS = Options.for_aircraft(
    PAPER._replace(vertical=VERTICAL), maneuvers=Maneuvers.BOTH, deadline_s=math.inf
)
THRESHOLDS = Thresholds.for_plans(OPTIONS)
MARGIN = OPTIONS.vertical_margin
OVER = [2_587.5, TOP, TOP, TOP, 2_593.75, *[LEVEL] * 15]
"""Altitudes of waypoints: up for 40 s, as high for 40 s, and down again."""
START = Altitude(LEVEL, "msl", 0.0)
ONCOMING = 8_000.0  # m ahead, met after 53 s
QUIET = Cause(0)


def eastward(heights: list[float], began: float = 0.0) -> Plan:
    """Return a plan east through some altitudes, from where the ownship is at a time, s."""
    climbs = [*(np.diff(heights) / 20.0).tolist(), 0.0]
    return reconstruct(
        tuple(
            Waypoint(n, SPEED * (began + 20.0 * n), 0.0, 0.0, SPEED, 20.0 * n, height, climb)
            for n, (height, climb) in enumerate(zip(heights, climbs, strict=True), start=1)
        )
    )


def rounded(profile: Profile, time: float, acceleration: float) -> tuple[float, float]:
    """Return altitude, m, and climb, m/s, of an aircraft that rounds the corners of a profile."""
    line = int(np.clip(np.searchsorted(profile.time, time, side="right") - 1, 0, None))
    line = min(line, profile.time.size - 2)
    altitude, climb = float(profile.at(np.array(time))), float(profile.climbs[line])
    for corner in profile.corners():
        half = first_corner(corner.change, acceleration)
        away = time - corner.time
        if abs(away) < half:
            up = math.copysign(acceleration, corner.change)
            altitude += 0.5 * up * (half - abs(away)) ** 2
            climb += up * (away + half) - (0.0 if away < 0.0 else corner.change)
    return altitude, climb


def oncoming(altitude: Altitude | None, ahead: float = ONCOMING, **more: Any) -> Intruder:
    """Return an intruder that flies west from so far ahead, m."""
    return Intruder(VehicleState(ahead, 0.0, math.pi, SPEED), altitude=altitude, **more)


def later(intruder: Intruder, time: float) -> Intruder:
    """Return a report of an intruder that has flown on straight for a time, s."""
    state, altitude = intruder.state, intruder.altitude
    x = state.x + state.speed * math.cos(state.heading) * time
    y = state.y + state.speed * math.sin(state.heading) * time
    if altitude is not None and altitude.vertical_speed is not None:
        altitude = replace(altitude, value=altitude.value + altitude.vertical_speed * time)
    return replace(intruder, state=state._replace(x=x, y=y), altitude=altitude)


class Flight:
    """A monitor of a plan east that climbs, and an ownship that flies it exactly."""

    def __init__(
        self,
        *others: Intruder,
        heights: list[float] | None = None,
        start: Altitude | None = START,
        thresholds: Thresholds = THRESHOLDS,
    ) -> None:
        self.others = {str(n): other for n, other in enumerate(others)}
        self.start = start
        plan = eastward(OVER if heights is None else heights)
        began = single.begin(thresholds)
        self.profile = None if start is None else profile_of(start.value, 0.0, plan.waypoints, 1.0)
        self.watch: Watch = single.activate(
            began, plan, self.own(0.0), self.others, 0.0, own_altitude=start
        )

    def own(self, time: float) -> VehicleState:
        return VehicleState(SPEED * time, 0.0, 0.0, SPEED)

    def altitude(self, time: float) -> Altitude:
        assert self.profile is not None and self.start is not None
        value, climb = rounded(self.profile, time, VERTICAL.acceleration)
        return replace(self.start, value=value, vertical_speed=climb)

    def step(self, time: float, *, areas: tuple[Area, ...] = (), **given: Any) -> Assessment:
        """Judge a second by exact reports, or by others that are given."""
        others = given.get("others", self.others)
        reports = {name: later(other, time) for name, other in others.items()}
        self.watch, verdict = single.step(
            self.watch,
            time,
            self.own(time),
            given.get("reports", reports),
            own_altitude=given["altitude"] if "altitude" in given else self.altitude(time),
            areas=areas,
        )
        return verdict


def causes_of(verdict: Assessment) -> Cause:
    return Cause(int(verdict.measured.causes[0]))


def test_a_climb_over_and_a_descent_behind_is_no_loss_and_asks_for_nothing() -> None:
    same = Altitude(LEVEL, "msl", 0.0)
    crossing = Intruder(VehicleState(4_000.0, 4_000.0, -0.5 * math.pi, SPEED), altitude=same)
    flight = Flight(oncoming(same), crossing)
    for time in np.arange(0.0, 330.0, 2.7).tolist():
        verdict = flight.step(time)
        assert verdict.state is State.MONITORING, (time, verdict.reasons)
        assert not causes_of(verdict) & ~Cause.BACKUP_UNSAFE
        assert abs(verdict.measured.altitude_error.item()) <= corner_error(5.0, 1.0) + 1e-9
    # Before it has climbed the oncoming one counts, and far behind again.
    times = times_met([oncoming(same)], rest_of(flight, 0.0), OPTIONS)
    assert np.count_nonzero(times.begin <= times.end) == 2


def test_what_the_planner_has_proven_asks_for_nothing() -> None:
    same, options = Altitude(LEVEL, "msl", 0.0), replace(OPTIONS, maneuvers=Maneuvers.VERTICAL)
    crossing = Intruder(VehicleState(4_000.0, 4_000.0, -0.5 * math.pi, SPEED), altitude=same)
    others = {"oncoming": oncoming(same), "crossing": crossing}
    route = [RoutePoint(n, 5_000.0 * (n + 1), 0.0) for n in range(10)]
    own = VehicleState(0.0, 0.0, 0.0, SPEED)
    answer = plan(own, list(others.values()), route, Policy.load(), options, own_altitude=START)
    assert answer.safe and len(answer.windows) == 4  # each counts before and after
    profile = profile_of(LEVEL, 0.0, answer.waypoints, VERTICAL.acceleration)
    assert profile is not None
    thresholds = Thresholds.for_plans(options)
    watch = single.activate(single.begin(thresholds), answer, own, others, 0.0, own_altitude=START)
    curves = legs(take(plan_states(own, answer.waypoints), None))
    for time in np.arange(1.0, 300.0, 7.0).tolist():
        here = take(at(curves, np.array([time])), 0)
        value, climb = rounded(profile, time, VERTICAL.acceleration)
        watch, verdict = single.step(
            watch,
            time,
            VehicleState(*map(float, here)),
            {name: later(other, time) for name, other in others.items()},
            own_altitude=replace(START, value=value, vertical_speed=climb),
        )
        assert verdict.state is State.MONITORING, (time, verdict.reasons)


def rest_of(flight: Flight, time: float) -> tuple[Line, ...]:
    climb = flight.watch.climb
    assert climb is not None
    return climb.flight(flight.altitude(time), time, OPTIONS)


def test_an_intruder_stands_once_for_each_of_its_times() -> None:
    flight = Flight()
    same, above = Altitude(LEVEL, "msl", 0.0), Altitude(LEVEL + 2_000.0, "msl", 0.0)
    reports = [oncoming(same), oncoming(above), oncoming(None)]
    window = times_met(reports, rest_of(flight, 0.0), OPTIONS)
    met = Met(window, np.empty(1, dtype=object))
    state = VehicleState(*(np.zeros((1, 3)) for _ in range(4)))
    columns = met.columns(Traffic.straight(state))
    assert columns.mask.tolist() == [[True, True, False, False, True, False]]
    assert met.repeat(np.array([[1.0, 2.0, 3.0]])).tolist() == [[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]]
    whole = met.all_times
    assert whole.begin[0, 0] <= 0.0 and whole.end[0, 0] == math.inf
    assert whole.begin[0, 1] > whole.end[0, 1]  # never


def test_a_plan_that_is_not_climbed_is_noticed_in_height_before_the_separation_is_lost() -> None:
    flight = Flight(oncoming(Altitude(LEVEL, "msl", 0.0)))
    noticed = math.nan
    for time in range(1, 30):
        verdict = flight.step(float(time), altitude=START)
        if causes_of(verdict) & Cause.ALTITUDE_ERROR:
            noticed = float(time)
            break
    # The plan is a margin above after 3.1 s, and the two are 1000 m apart after 46.7 s.
    assert noticed == 4.0
    assert verdict.state is State.REPLAN_REQUESTED and verdict.ask is not None
    assert verdict.ask.own_altitude == START
    (why,) = [why for why in verdict.reasons if why.cause is Cause.ALTITUDE_ERROR]
    assert why.message.startswith("altitude_error is -7.5 m, allowed 3.125 m")
    # Where it stays as far below, the pass above is none, and without an answer the backup is
    # flown while there is time to turn.
    while verdict.fly is not FlyMode.BACKUP:
        time += 1
        verdict = flight.step(float(time), altitude=START)
    assert causes_of(verdict) & Cause.BACKUP_UNSAFE == QUIET
    assert 2.0 * SPEED * time < ONCOMING - 1_000.0


@pytest.mark.parametrize("error", [0.0, 20.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_altitude_may_be_off_by_the_margin_and_what_is_not_known_of_it(
    error: float, side: float
) -> None:
    allowed = MARGIN + error
    flight = Flight(start=replace(START, error=error))
    for time, (share, there) in enumerate(
        [(0.98, False), (1.02, True), (0.72, True), (0.68, False), (0.98, False)]
    ):
        flown = flight.altitude(float(time))
        value = float(flight.profile.at(np.array(float(time)))) + side * share * allowed
        verdict = flight.step(float(time), altitude=replace(flown, value=value))
        assert bool(causes_of(verdict) & Cause.ALTITUDE_ERROR) is there
        assert verdict.measured.altitude_error.item() == pytest.approx(side * share * allowed)
        assert (verdict.state is State.MONITORING) is not there


def test_an_intruder_that_climbs_into_the_level_of_the_plan_is_a_loss() -> None:
    level = oncoming(Altitude(LEVEL, "msl", 0.0))
    flight = Flight(level)
    assert flight.step(1.0).state is State.MONITORING
    climbing = oncoming(Altitude(LEVEL, "msl", 3.0))
    verdict = flight.step(2.0, others={"0": climbing})
    assert causes_of(verdict) & Cause.SEPARATION and verdict.ask is not None
    assert int(verdict.measured.intruder_causes[0, 0]) & int(Cause.SEPARATION)
    assert verdict.ask.intruders[0].altitude == later(climbing, 2.0).altitude
    # One that goes on at its level is none, and neither is one that has always been far above.
    above = oncoming(Altitude(LEVEL + 400.0, "msl", 0.0))
    assert flight.step(3.0, others={"0": level, "1": above}).state is State.MONITORING
    descending = oncoming(Altitude(LEVEL + 400.0, "msl", -3.0))
    verdict = flight.step(4.0, others={"0": level, "1": descending})
    lost = verdict.measured.intruder_causes[0] & int(Cause.SEPARATION)
    assert lost.astype(bool).tolist() == [False, True]


def test_what_is_unknown_of_altitudes_counts_as_level() -> None:
    level = Altitude(LEVEL, "msl", 0.0)
    lost = Cause.SEPARATION
    for unknown in (None, replace(level, reference="wgs84")):
        flight = Flight(oncoming(level))
        verdict = flight.step(1.0, altitude=unknown)
        assert causes_of(verdict) & lost and not causes_of(verdict) & Cause.ALTITUDE_ERROR
        assert math.isnan(verdict.measured.altitude_error.item())
        assert flight.step(2.0).state is State.MONITORING
        verdict = flight.step(3.0, others={"0": oncoming(unknown)})
        assert causes_of(verdict) & lost
    # An unknown climb is the worst that is plausible: 10 m/s.
    flight = Flight(oncoming(level))
    verdict = flight.step(1.0, others={"0": oncoming(replace(level, vertical_speed=None))})
    assert causes_of(verdict) & lost


def test_the_altitude_of_an_intruder_that_is_missing_goes_on() -> None:
    flight = Flight(oncoming(Altitude(LEVEL, "msl", 0.0)))
    assert flight.step(1.0).state is State.MONITORING
    for time in (2.0, 3.0, 4.0):
        verdict = flight.step(time, reports={})
        assert causes_of(verdict) & ~Cause.NO_ANSWER == Cause.INTRUDER_MISSING
    # A report from before the last one says nothing, of the altitude neither.
    flight = Flight(oncoming(Altitude(LEVEL, "msl", 0.0)))
    assert flight.step(3.0).state is State.MONITORING
    climbing = oncoming(Altitude(LEVEL, "msl", 5.0))
    verdict = flight.step(4.0, reports={"0": replace(later(climbing, 1.0), age=3.0)})
    assert causes_of(verdict) == Cause.INTRUDER_OUT_OF_ORDER


@pytest.mark.parametrize(("rises", "taken_up"), [(0.0, True), (4.0, False)])
def test_an_answer_that_climbs_is_judged_by_its_own_altitudes(rises: float, taken_up: bool) -> None:
    asked, level = 5.0, oncoming(Altitude(LEVEL, "msl", 0.0), ahead=9_000.0)
    flight = Flight(level, heights=[LEVEL] * 20)
    verdict = flight.step(asked)
    assert causes_of(verdict) & Cause.SEPARATION and verdict.ask is not None
    # One second later the intruder climbs, or not.
    other = oncoming(Altitude(LEVEL, "msl", rises), ahead=9_000.0)
    flight.step(asked + 1.0, others={"0": other})
    plan = eastward(OVER, asked)
    flight.watch, flown = single.answer(flight.watch, verdict.ask.number, plan)
    assert flown is taken_up
    if not taken_up:
        assert int(flight.watch.monitor.causes[0]) & int(Cause.REFUSED)
        return
    profile = profile_of(LEVEL, 0.0, plan.waypoints, VERTICAL.acceleration)
    assert profile is not None
    flight.profile = profile.since(-asked)
    for time in (2.0, 20.0, 60.0, 100.0):
        assert flight.step(asked + time).state is State.MONITORING


@pytest.mark.parametrize(("below", "there"), [(-1.0, True), (0.9, True), (1.1, False)])
def test_a_pass_above_keeps_the_margin_too(below: float, there: bool) -> None:
    height = TOP - VERTICAL.separation - below * MARGIN
    flight = Flight(oncoming(Altitude(height, "msl", 0.0)))
    assert bool(causes_of(flight.step(45.0)) & Cause.SEPARATION) is there


@pytest.mark.parametrize(
    ("heights", "start", "thresholds"),
    [
        ([LEVEL + 200.0] * 20, START, THRESHOLDS),
        ([2_587.5, LEVEL, *[LEVEL] * 18], START, THRESHOLDS),
        (OVER, None, THRESHOLDS),
        (OVER, replace(START, vertical_speed=None), THRESHOLDS),
        (OVER, START, Thresholds.for_plans(Options.for_aircraft(OPTIONS.aircraft))),
        (OVER, START, Thresholds.for_plans(replace(OPTIONS, ceiling=Level(TOP, "msl")))),
        (OVER, START, Thresholds.for_plans(replace(OPTIONS, ceiling=Level(5e3, "wgs84")))),
    ],
)
def test_a_plan_whose_altitudes_cannot_be_flown_is_refused(
    heights: list[float], start: Altitude | None, thresholds: Thresholds
) -> None:
    plan = eastward(heights)
    own = VehicleState(0.0, 0.0, 0.0, SPEED)
    watch = single.activate(single.begin(thresholds), plan, own, {}, 0.0, own_altitude=start)
    assert bool(watch.monitor.on_backup[0]) and watch.climb is None
    watch, verdict = single.step(watch, 1.0, own._replace(x=SPEED), {}, own_altitude=start)
    assert verdict.fly is FlyMode.BACKUP and causes_of(verdict) & Cause.REFUSED


def test_the_rest_of_a_plan_may_pass_over_an_area() -> None:
    shape = Circle(4_500.0, 0.0, 300.0)
    low, high = (Area(shape, ceiling=Level(top, "msl")) for top in (TOP - 50.0, TOP))
    flight = Flight()
    for time in (0.0, 20.0, 40.0):
        assert flight.step(time, areas=(low,)).state is State.MONITORING
    assert causes_of(flight.step(41.0, areas=(high,))) & Cause.AREA
    # An ownship that is below its plan may stay so.
    below = replace(flight.altitude(42.0), value=TOP - 60.0)
    assert causes_of(flight.step(42.0, areas=(low,), altitude=below)) & Cause.AREA
    # An answer is judged among the areas as they are on its own profile.
    for area, taken_up in ((low, True), (high, False)):
        flight = Flight(heights=[LEVEL] * 20)
        verdict = flight.step(0.0, areas=(area,))
        assert causes_of(verdict) & Cause.AREA and verdict.ask is not None
        _, flown = single.answer(flight.watch, verdict.ask.number, eastward(OVER))
        assert flown is taken_up


def test_a_backup_levels_off() -> None:
    climbing = Altitude(LEVEL, "msl", 4.0)
    (before, after) = backup_flight(Sense.LEVEL_OFF, climbing, OPTIONS)
    assert (before.end, after.begin) == (2.0, 2.0)  # half of the time that it takes
    for line, value, climb in ((before, LEVEL, 4.0), (after, LEVEL + 8.0, 0.0)):
        at_end = line.altitude.value + (line.altitude.vertical_speed or 0.0) * 2.0
        assert at_end == pytest.approx(LEVEL + 8.0)
        assert line.altitude.value == pytest.approx(value)
        assert line.altitude.vertical_speed == pytest.approx(climb)
        assert line.altitude.error == MARGIN
    uncertain = backup_flight(Sense.LEVEL_OFF, replace(climbing, climb_error=1.0), OPTIONS)
    # 5 m/s take 12.5 m, 4 m/s 8 m.
    assert uncertain[1].altitude.error == pytest.approx(MARGIN + 4.5)
    assert backup_flight(Sense.LEVEL_OFF, None, OPTIONS) == ()
    unknown = replace(climbing, vertical_speed=None)
    assert backup_flight(Sense.LEVEL_OFF, unknown, OPTIONS) == steady(unknown)


@pytest.mark.parametrize(("above", "straight"), [(12.5 + 160.0, True), (12.5, False)])
def test_a_backup_is_certified_at_the_altitude_in_which_it_levels_off(
    above: float, straight: bool
) -> None:
    # Ahead and on both sides; to go on climbing would be to meet all of them.
    at = Altitude(LEVEL + above, "msl", 0.0)
    others = {
        str(heading): Intruder(VehicleState(5_000.0, y, heading, 110.0), altitude=at)
        for y, heading in ((0.0, math.pi), (5_000.0, -2.2), (-5_000.0, 2.2))
    }
    flight = Flight()
    flight.step(0.0, others=others, altitude=replace(START, vertical_speed=5.0))
    backup = flight.watch.monitor.backup
    assert bool(backup.safe[0] and abs(backup.course[0]) < 1e-9) is straight


@pytest.mark.parametrize("wind", [Wind(15.0, -8.0, 0.5), Wind(-20.0, 5.0)])
def test_an_answer_in_another_wind_passes_over_as_in_still_air(wind: Wind) -> None:
    area = Area(Circle(4_500.0, 0.0, 300.0), ceiling=Level(TOP - 50.0, "msl"))
    flight = Flight(oncoming(Altitude(LEVEL, "msl", 0.0), 9_000.0), heights=[LEVEL] * 20)
    verdict = flight.step(0.0, areas=(area,))
    assert causes_of(verdict) & Cause.AREA and verdict.ask is not None
    windy = replace(eastward(OVER), wind=wind)
    watch, flown = single.answer(flight.watch, verdict.ask.number, windy)
    assert flown and watch.air.wind == wind and watch.climb is not None
    flight.watch, flight.profile = watch, watch.climb.profile
    for time in (1.0, 2.0, 40.0):
        assert flight.step(time, areas=(area,)).state is State.MONITORING


@pytest.mark.parametrize("time", [math.nan, -5.0, 3.0, 1e300])
def test_a_clock_that_does_not_run_decides_nothing_of_a_climb(time: float) -> None:
    flight = Flight(oncoming(Altitude(LEVEL, "msl", 0.0)))
    assert flight.step(3.0).state is State.MONITORING
    reports = {name: later(other, 3.0) for name, other in flight.others.items()}
    flight.watch, verdict = single.step(
        flight.watch, time, flight.own(3.0), reports, own_altitude=flight.altitude(3.0)
    )
    assert causes_of(verdict) & Cause.CLOCK and verdict.state is State.DENIED
    assert flight.step(4.0).state is State.MONITORING


def test_a_plan_in_the_plane_has_no_altitude_to_be_held_to() -> None:
    flat = reconstruct(
        tuple(Waypoint(n, SPEED * 20.0 * n, 0.0, 0.0, SPEED, 20.0 * n) for n in range(1, 21))
    )
    own = VehicleState(0.0, 0.0, 0.0, SPEED)
    watch = single.activate(single.begin(THRESHOLDS), flat, own, {}, 0.0, own_altitude=START)
    assert watch.climb is None
    sinking = replace(START, value=LEVEL - 500.0)
    watch, verdict = single.step(watch, 0.0, own, {}, own_altitude=sinking)
    assert verdict.state is State.MONITORING
    assert math.isnan(verdict.measured.altitude_error.item())


def test_the_altitude_that_is_flown_is_the_plans_the_backups_or_goes_on() -> None:
    flight = Flight(oncoming(Altitude(LEVEL, "msl", 0.0)))
    on_plan = flight.step(50.0).in_height
    assert on_plan is not None and on_plan.own == flight.altitude(50.0)
    assert on_plan.flight == rest_of(flight, 50.0)
    # It has not levelled off where the plan does.
    high = replace(START, value=TOP + 60.0, vertical_speed=5.0, climb_error=1.0)
    passed = flight.step(51.0, altitude=high)
    assert passed.fly is FlyMode.PLAN and passed.in_height is not None
    assert causes_of(passed) & Cause.ALTITUDE_ERROR
    assert passed.in_height.flight == hold(high, OPTIONS)
    (line,) = passed.in_height.flight
    assert line.altitude == replace(high, error=MARGIN, climb_error=0.0)
    ended = flight.step(1_000.0, altitude=high)
    assert ended.fly is FlyMode.BACKUP and ended.in_height is not None
    assert ended.in_height.flight == backup_flight(Sense.LEVEL_OFF, high, OPTIONS)
    assert hold(None, OPTIONS) == ()
    in_plane = Thresholds.for_plans(Options.for_aircraft(PAPER, deadline_s=math.inf))
    _, verdict = single.step(single.begin(in_plane), 1.0, flight.own(1.0), {})
    assert verdict.in_height is None


def levels_at(flight: Flight) -> float:
    """Return the altitude at which the backup levels off, m."""
    assert flight.watch.monitor.backup.sense[0] == Sense.LEVEL_OFF
    climb = flight.watch.backup_climb
    assert climb is not None and climb.reference == START.reference
    return float(climb.profile.altitude[-1])


@pytest.mark.parametrize("share", [-1.1, -0.9, 0.9, 1.1])
def test_a_backup_goes_on_from_what_is_flown_which_no_gust_moves(share: float) -> None:
    flight, time = Flight(oncoming(Altitude(TOP, "msl", 0.0), 20_000.0)), 20.0
    planned = flight.altitude(time)
    assert planned.vertical_speed is not None and planned.vertical_speed > 2.0
    gust = replace(
        planned, value=planned.value + share * MARGIN, vertical_speed=-8.0, climb_error=2.0
    )
    verdict = flight.step(time, altitude=gust)
    assert verdict.in_height is not None
    space = verdict.in_height.space
    begin = replace(planned, climb_error=0.0) if abs(share) < 1.0 else gust
    assert begin.vertical_speed is not None
    expected = begin.value + rise_to_level(begin.vertical_speed, VERTICAL.acceleration)
    assert levels_at(flight) == pytest.approx(expected)
    meets, anew = (
        place.find_backups_met(own, Sense.LEVEL_OFF, np.array([0])).share
        for place, own in ((space, gust), (replace(space, flown=None), begin))
    )
    np.testing.assert_allclose(meets, anew)
    assert 0.0 < meets.min() < 1.0
    # One of another reference, or unknown, says nothing of the profile.
    other = replace(gust, reference="pressure")
    assert space.begin_backup(other) is other and space.begin_backup(None) is None


def test_a_backup_that_is_flown_keeps_its_altitude_in_gusts() -> None:
    flight = Flight()
    level = replace(START, value=TOP + 20.0)
    assert flight.step(1_000.0, altitude=level).fly is FlyMode.BACKUP
    for second, share in enumerate([0.9, 0.9, -0.9, 0.0], start=1_001):
        off = replace(level, value=level.value + share * MARGIN, vertical_speed=3.0 * share)
        assert flight.step(float(second), altitude=off).fly is FlyMode.BACKUP
        assert levels_at(flight) == pytest.approx(level.value)
    # Where the aircraft has left it, it begins anew.
    away = replace(level, value=level.value + 1.1 * MARGIN)
    flight.step(1_005.0, altitude=away)
    assert levels_at(flight) == pytest.approx(away.value)


def test_a_backup_climbs_no_farther_than_areas_that_must_not_be_left() -> None:
    corners = (-1e5, -1e5), (1e5, -1e5), (1e5, 1e5), (-1e5, 1e5)
    sides = {Sense.CLIMB: ("ceiling", LEVEL + 300.0), Sense.DESCEND: ("floor", LEVEL - 300.0)}
    for sense, (limit, value) in sides.items():
        for reference in ("msl", "ground"):
            area = Area(Polygon(corners), Keep.IN, **{limit: Level(value, reference)})
            verdict = Flight().step(0.0, areas=(area,))
            assert verdict.in_height is not None
            space = verdict.in_height.space
            possible = {
                kind: bool(space.find_backups_met(START, kind, np.array([0])).possible[0])
                for kind in Sense
            }
            assert possible.pop(sense) == (reference == "msl") and all(possible.values())
            profile = backup_profile(sense, START, space.options_from(START))
            free = backup_profile(sense, START, OPTIONS)
            assert free is not None and abs(free.altitude - LEVEL).max() > 300.0
            if reference == "msl":
                assert profile is not None and abs(profile.altitude - LEVEL).max() < 300.0 - MARGIN


BROKEN = [math.nan, math.inf, -math.inf, 1e30]
BROKEN_REPORTS = [
    *({"altitude": Altitude(value, "msl", 0.0)} for value in BROKEN),
    *({"altitude": Altitude(LEVEL, "msl", value)} for value in BROKEN),
    *({"altitude": Altitude(LEVEL, "msl", 0.0, value)} for value in [*BROKEN, -300.0]),
    *({"altitude": Altitude(LEVEL, "msl", 0.0, 0.0, value)} for value in [*BROKEN, -300.0]),
    *({"separation": value} for value in [*BROKEN, -1_000.0]),
    *({"vertical_separation": value} for value in [*BROKEN, -1_000.0]),
    *({"turn_rate": 0.05, "turn_time": value} for value in [math.nan, -1.0]),
]
IN_PLANE = Thresholds.for_plans(Options.for_aircraft(PAPER, deadline_s=math.inf))


@pytest.mark.parametrize("thresholds", [THRESHOLDS, IN_PLANE], ids=["climbs", "plane"])
def test_a_report_with_a_broken_altitude_or_separation_is_missing(thresholds: Thresholds) -> None:
    state, own = VehicleState(ONCOMING, 0.0, math.pi, SPEED), VehicleState(0.0, 0.0, 0.0, SPEED)
    good = Intruder(state, altitude=START)
    begun, _ = single.step(single.begin(thresholds), 0.0, own, {"a": good}, own_altitude=START)
    for fields in BROKEN_REPORTS:
        broken = {"a": Intruder(state, **fields), "b": good}
        _, verdict = single.step(begun, 1.0, own, broken, own_altitude=START)
        missing = verdict.measured.intruder_causes[0] & Cause.INTRUDER_MISSING != 0
        assert missing.tolist() == [True, False], fields
        assert verdict.measured.traffic.mask.all()
        window = verdict.measured.traffic.window
        assert window is None or ((window.begin <= 0.0).all() and (window.end > 0.0).all())


@pytest.mark.parametrize("value", BROKEN)
@pytest.mark.parametrize("field", ["value", "vertical_speed", "error", "climb_error"])
def test_a_broken_own_altitude_is_unknown(field: str, value: float) -> None:
    other = Intruder(
        VehicleState(ONCOMING, 0.0, math.pi, SPEED), altitude=Altitude(9_000.0, "msl", 0.0)
    )
    broken, own = replace(START, **{field: value}), VehicleState(0.0, 0.0, 0.0, SPEED)
    for thresholds in (THRESHOLDS, IN_PLANE):
        begun = single.begin(thresholds)
        for given in (None, broken):
            _, verdict = single.step(begun, 0.0, own, {"other": other}, own_altitude=given)
            window = verdict.measured.traffic.window
            assert window is not None and window.begin.item() == -math.inf
            assert window.end.item() == math.inf


def test_an_aircraft_that_is_reported_is_not_gone() -> None:
    own, others = VehicleState(0.0, 0.0, 0.0, SPEED), {"a": oncoming(START)}
    watch, _ = single.step(single.begin(THRESHOLDS), 0.0, own, others, own_altitude=START)
    both, verdict = single.step(watch, 1.0, own, others, own_altitude=START, gone=("a",))
    assert both.names == ("a",) and verdict.measured.traffic.mask.all()
    alone, _ = single.step(both, 2.0, own, {}, own_altitude=START, gone=("a",))
    assert alone.names == ()
