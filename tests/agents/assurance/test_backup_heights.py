"""Where no backup that levels off is safe one climbs or descends, as far as floor and ceiling allow,
and is flown as it is certified.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from agents.assurance import single
from agents.assurance.backup import Sense
from agents.assurance.backup_heights import backup_flight, backup_profile
from agents.assurance.single import Assessment, Watch
from agents.assurance.state import FlyMode
from agents.assurance.thresholds import Cause, Thresholds
from agents.kernel.levels import Altitude
from agents.planner.recheck import reconstruct
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.reports import Intruder
from envs.aircraft import PAPER, Vertical
from envs.areas import Area, Circle, Level
from envs.kinematics import VehicleState
from envs.profile import height_flown, on_profile, profile_of
from envs.trees import take
from envs.waypoints import Waypoint, at
from tests.agents.scenes import causes_of

SPEED, LEVEL = 75.0, 2_500.0  # m/s, m
VERTICAL = Vertical(climb_max=5.0, descent_max=4.0, acceleration=1.0, separation=137.0)
OPTIONS = Options.for_aircraft(
    PAPER._replace(vertical=VERTICAL), maneuvers=Maneuvers.BOTH, deadline_s=math.inf
)
START = Altitude(LEVEL, "msl", 0.0)
OWN = VehicleState(0.0, 0.0, 0.0, SPEED)


def ring(
    rng: np.random.Generator, distance: float, above: float = 0.0, climb: float = 0.0
) -> dict[str, Intruder]:
    """Return intruders that come from all sides and so far away, m, to where the ownship is."""
    turned = rng.uniform(0.0, 2.0 * math.pi)
    sides = turned + np.arange(14) * 2.0 * math.pi / 14.0
    return {
        str(n): Intruder(
            VehicleState(
                distance * math.cos(side),
                distance * math.sin(side),
                math.remainder(side + math.pi, 2.0 * math.pi),
                float(rng.uniform(60.0, 90.0)),
            ),
            altitude=Altitude(LEVEL + above, "msl", climb),
        )
        for n, side in enumerate(sides.tolist())
    }


def later(report: Intruder, time: float) -> Intruder:
    """Return the report of an intruder that has flown on for a time, s."""
    state, altitude = report.state, report.altitude
    x = state.x + state.speed * math.cos(state.heading) * time
    y = state.y + state.speed * math.sin(state.heading) * time
    if altitude is not None:
        climb = altitude.vertical_speed or 0.0
        altitude = replace(altitude, value=altitude.value + climb * time)
    return replace(report, state=state._replace(x=x, y=y), altitude=altitude)


class Flown(NamedTuple):
    """Where an ownship is that flies its backup."""

    state: VehicleState
    altitude: Altitude


class Flight:
    """A monitor without a plan, and an ownship that flies its backups exactly."""

    def __init__(
        self, others: dict[str, Intruder], options: Options = OPTIONS, own: Flown | None = None
    ) -> None:
        self.others, self.options = others, options
        self.own = own or Flown(OWN, START)
        no_plan = reconstruct(())
        self.watch: Watch = single.activate(
            single.begin(Thresholds.for_plans(options)),
            no_plan,
            self.own.state,
            others,
            0.0,
            own_altitude=self.own.altitude,
        )

    def step(self, time: float, **more: Any) -> Assessment:
        """Judge a second."""
        reports = {name: later(other, time) for name, other in self.others.items()}
        self.watch, assessment = single.step(
            self.watch,
            time,
            self.own.state,
            reports,
            **({"own_altitude": self.own.altitude} | more),
        )
        return assessment

    @property
    def sense(self) -> Sense:
        """What the present backup does up and down."""
        return Sense(int(self.watch.monitor.backup.sense[0]))

    def fly(self, seconds: np.ndarray) -> list[Flown]:
        """Return where the ownship is on the present backup after some seconds; it goes on from the
        last.
        """
        backup = self.watch.monitor.backup
        profile = backup_profile(self.sense, self.own.altitude, self.options)
        assert profile is not None
        curves = take(backup.legs, np.zeros(seconds.size, dtype=int))
        states = at(curves, seconds)
        heights = height_flown(profile, self.options.vertical.acceleration, seconds)
        flown = [
            Flown(
                VehicleState(*map(float, take(states, n))),
                replace(self.own.altitude, value=float(altitude), vertical_speed=float(climb)),
            )
            for n, (altitude, climb) in enumerate(zip(*heights, strict=True))
        ]
        self.own = flown[-1]
        return flown


def share_kept(flown: Flown, report: Intruder) -> float:
    """Return which share of a separation an ownship keeps from an intruder: of the greater one."""
    state, altitude = report.state, report.altitude
    assert altitude is not None
    away = math.hypot(state.x - flown.state.x, state.y - flown.state.y)
    above = abs(altitude.value - flown.altitude.value)
    return max(away / PAPER.separation, above / VERTICAL.separation)


@pytest.mark.parametrize(
    ("above", "sense"),
    [(60.0, Sense.DESCEND), pytest.param(-60.0, Sense.CLIMB, marks=pytest.mark.slow)],
)
def test_a_backup_that_climbs_or_descends_keeps_what_it_has_promised(
    above: float, sense: Sense
) -> None:
    for seed in range(2):
        flight, senses = Flight(ring(np.random.default_rng(seed), 6_500.0, above)), list[Sense]()
        for time in range(45):
            assessment = flight.step(float(time))
            assert assessment.fly is FlyMode.BACKUP
            assert not causes_of(assessment.measured) & Cause.BACKUP_UNSAFE, (seed, time)
            senses.append(flight.sense)
            for part, flown in enumerate(flight.fly(np.linspace(0.0, 1.0, 6))):
                moment = time + 0.2 * part
                shares = [
                    share_kept(flown, later(other, moment)) for other in flight.others.values()
                ]
                assert min(shares) >= 1.0 - 1e-6, (seed, moment)
        # It has passed all of them, and climbed or descended no farther than that takes.
        changed = senses.index(Sense.LEVEL_OFF)
        assert set(senses[:changed]) == {sense} and set(senses[changed:]) == {Sense.LEVEL_OFF}
        rise = abs(flight.own.altitude.value - LEVEL - above) - VERTICAL.separation
        assert 0.0 <= rise <= 30.0


def test_a_backup_levels_off_where_that_is_safe() -> None:
    head_on = Intruder(VehicleState(9_000.0, 0.0, math.pi, SPEED), altitude=START)
    flight = Flight({"0": head_on})
    assessment = flight.step(0.0)
    assert (
        not causes_of(assessment.measured) & Cause.BACKUP_UNSAFE and flight.sense is Sense.LEVEL_OFF
    )


def test_what_climbs_in_one_scene_descends_in_its_mirror_image() -> None:
    even = replace(OPTIONS, aircraft=PAPER._replace(vertical=VERTICAL._replace(descent_max=5.0)))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        above, climb = rng.uniform(-130.0, 130.0), rng.uniform(-2.0, 2.0)
        distance = rng.uniform(3_000.0, 6_000.0)
        senses, clearances = [], []
        for side in (1.0, -1.0):
            draws = np.random.default_rng(seed)
            flight = Flight(ring(draws, distance, side * above, side * climb), even)
            flight.step(0.0)
            senses.append(flight.sense)
            clearances.append(float(flight.watch.monitor.backup.clearance[0]))
        mirrored = {Sense.CLIMB: Sense.DESCEND, Sense.DESCEND: Sense.CLIMB}
        assert senses[1] is mirrored.get(senses[0], senses[0])
        assert clearances[0] == pytest.approx(clearances[1], abs=1e-6)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_backup_never_leaves_floor_and_ceiling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    options = replace(
        OPTIONS, floor=Level(LEVEL - 170.0, "msl"), ceiling=Level(LEVEL + 160.0, "msl")
    )
    flight = Flight(ring(rng, rng.uniform(2_500.0, 5_000.0), rng.uniform(-20.0, 20.0)), options)
    senses = set[Sense]()
    for time in range(60):
        flight.step(float(time))
        senses.add(flight.sense)
        for flown in flight.fly(np.linspace(0.0, 1.0, 6)):
            assert LEVEL - 170.0 <= flown.altitude.value <= LEVEL + 160.0
    assert senses & {Sense.CLIMB, Sense.DESCEND}


SLOW_CLIMBER = PAPER._replace(vertical=VERTICAL._replace(acceleration=0.3))


@pytest.mark.parametrize(("sense", "side"), [(Sense.CLIMB, 1.0), (Sense.DESCEND, -1.0)])
@pytest.mark.parametrize(
    ("own", "room", "changes"),
    [
        (None, None, {}),
        (replace(START, vertical_speed=None), None, {}),
        (START, Level(20.0, "msl"), {}),
        (START, Level(-20.0, "msl"), {}),
        (START, Level(900.0, "wgs84"), {}),
        # Its climb cannot change within the first leg.
        (START, None, {"aircraft": SLOW_CLIMBER, "vertical_margin": 50.0}),
    ],
)
def test_no_backup_climbs_or_descends_where_it_may_not(
    sense: Sense, side: float, own: Altitude | None, room: Level | None, changes: dict[str, Any]
) -> None:
    options = replace(OPTIONS, **changes)
    if room is not None:
        limit = Level(LEVEL + side * room.value, room.reference)
        options = replace(options, **{"ceiling" if side > 0.0 else "floor": limit})
    assert backup_profile(sense, own, options) is None
    assert backup_flight(sense, own, options) == ()
    levels_off = backup_profile(Sense.LEVEL_OFF, own, options)
    assert (levels_off is None) is (own is None or own.vertical_speed is None)
    flight = Flight(ring(np.random.default_rng(1), 6_500.0, -60.0 * side), options)
    flight.step(0.0, own_altitude=own)
    assert flight.sense is not sense


def test_a_climb_ends_where_the_altitude_is_lost() -> None:
    flight = Flight(ring(np.random.default_rng(1), 6_500.0, -60.0))
    flight.step(0.0)
    flight.fly(np.array([0.0, 1.0]))
    assert flight.sense is Sense.CLIMB
    assessment = flight.step(1.0, own_altitude=None)
    assert flight.sense is Sense.LEVEL_OFF
    assert causes_of(assessment.measured) & Cause.BACKUP_UNSAFE


def test_a_climb_ends_where_the_traffic_has_gone() -> None:
    flight = Flight(ring(np.random.default_rng(1), 6_500.0, -60.0))
    flight.step(0.0)
    flight.fly(np.array([0.0, 1.0]))
    gone, flight.others = tuple(flight.others), {}
    flight.step(1.0, gone=gone)
    assert flight.sense is Sense.LEVEL_OFF


def test_an_aircraft_that_may_not_climb_has_backups_in_the_plane_alone() -> None:
    flight = Flight(
        ring(np.random.default_rng(1), 6_500.0, -60.0),
        replace(OPTIONS, maneuvers=Maneuvers.HORIZONTAL),
    )
    assessment = flight.step(0.0)
    assert causes_of(assessment.measured) & Cause.BACKUP_UNSAFE and flight.sense is Sense.LEVEL_OFF


def test_one_too_fast_for_a_climb_within_its_airspeed_does_not_climb() -> None:
    others = ring(np.random.default_rng(1), 6_500.0, -60.0)
    limits = Thresholds.for_plans(OPTIONS).manoeuvre
    slow = math.sqrt(limits.speed_max**2 - VERTICAL.climb_max**2)
    for speed, climbs in ((slow - 0.01, True), (slow + 0.01, False)):
        flight = Flight(others, own=Flown(OWN._replace(speed=speed), START))
        flight.step(0.0)
        assert (flight.sense is Sense.CLIMB) is climbs
        airspeed = np.hypot(flight.watch.monitor.backup.plan_states.speed, VERTICAL.climb_max)
        assert not climbs or airspeed.max() <= limits.speed_max + 1e-9
        # One that climbs already goes on, and slows down.
        flight.own = Flown(OWN._replace(x=speed, speed=slow + 0.01), START)
        flight.step(1.0)
        assert (flight.sense is Sense.CLIMB) is climbs


def test_nothing_climbs_where_even_the_least_speed_is_too_fast_for_it() -> None:
    others = ring(np.random.default_rng(1), 6_500.0, -60.0)
    climber = VERTICAL._replace(climb_max=20.0, acceleration=5.0)
    fastest = math.sqrt(PAPER.limits.speed_max**2 - climber.climb_max**2)
    for least, climbs in ((fastest - 0.05, True), (fastest + 0.05, False)):
        limits = PAPER.limits._replace(speed_min=least)
        options = Options.for_aircraft(
            PAPER._replace(vertical=climber, limits=limits),
            maneuvers=Maneuvers.BOTH,
            deadline_s=math.inf,
        )
        # Slower than its decisions, as the vehicle may be.
        flight = Flight(others, options, Flown(OWN._replace(speed=fastest - 0.5), START))
        flight.step(0.0)
        assert (flight.sense is Sense.CLIMB) is climbs


def test_a_backup_does_not_climb_into_an_area_above() -> None:
    above = Area(Circle(0.0, 0.0, 30_000.0), floor=Level(LEVEL + 60.0, "msl"))
    below = Area(Circle(0.0, 0.0, 30_000.0), ceiling=Level(LEVEL - 60.0, "msl"))
    others = ring(np.random.default_rng(2), 6_500.0)
    for areas, expected in (((above,), Sense.DESCEND), ((below,), Sense.CLIMB)):
        flight = Flight(others)
        assessment = flight.step(0.0, areas=areas)
        assert flight.sense is expected
        assert not causes_of(assessment.measured) & Cause.BACKUP_IN_AREA
    flight = Flight(others)
    flight.step(0.0, areas=(above, below))
    assert flight.sense is Sense.LEVEL_OFF


@pytest.mark.parametrize("climb", [-4.9, -1.0, 0.0, 0.3, 4.0, 5.0])
@pytest.mark.parametrize("sense", [Sense.CLIMB, Sense.DESCEND])
def test_the_altitudes_of_its_plan_states_say_all_of_a_profile(sense: Sense, climb: float) -> None:
    options = replace(OPTIONS, ceiling=Level(LEVEL + 150.0, "msl"))
    own = replace(START, vertical_speed=climb)
    profile = backup_profile(sense, own, options)
    assert profile is not None
    flight = Flight({})
    flight.step(0.0)
    points = [
        Waypoint(n, *map(float, row))
        for n, row in enumerate(
            np.stack(take(flight.watch.monitor.backup.plan_states, 0), axis=-1)[1:]
        )
    ]
    rebuilt = profile_of(own.value, climb, on_profile(points, profile), VERTICAL.acceleration)
    assert rebuilt is not None
    times = np.linspace(0.0, points[-1].time, 500)
    np.testing.assert_allclose(rebuilt.at(times), profile.at(times), atol=1e-6)
