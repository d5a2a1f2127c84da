"""Bands of vertical speed and altitude: by a dense simulation that flies every manoeuvre."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.assurance.alerts import Alerting, Region, regions
from agents.assurance.bands import Bands, losses_on_course, recovery, stretches
from agents.assurance.climbs import Met, times_met
from agents.assurance.inputs import no_areas
from agents.assurance.space import hold
from agents.assurance.vertical_bands import (
    Altitudes,
    Layers,
    altitude_bands,
    altitudes_of,
    layers,
    vertical_speed_bands,
)
from agents.assurance.vertical_manoeuvres import (
    Bound,
    Times,
    first_below,
    least_above,
    to_altitude,
    to_climb,
)
from agents.kernel.areas import ActiveArea, required_distances
from agents.kernel.levels import Altitude, Gap
from agents.kernel.traffic import Traffic, predict, requirement_of, uncertainty
from agents.planner.request.options import Maneuvers, Options
from agents.planner.request.reports import Intruder
from envs.aircraft import PAPER, Vertical
from envs.area_geometry import signed_distance
from envs.areas import Area, Circle, Keep, Level
from envs.arrays import Array
from envs.frames import Air
from envs.kinematics import VehicleState
from envs.trees import map_leaves
from tests.agents.assurance.test_bands import GOOD, traffic_of

VERTICAL = Vertical(6.0, 8.0, 0.5, 140.0)
AIRCRAFT = PAPER._replace(vertical=VERTICAL)
OPTIONS = Options.for_aircraft(AIRCRAFT, maneuvers=Maneuvers.BOTH)
LOOK_AHEAD = 120.0
STEP = 0.05  # s, of the simulation
TIMES = np.arange(0.0, LOOK_AHEAD + 0.5 * STEP, STEP)
KINDS = "vertical speed", "altitude"
EDGE = {
    kind: span / 80.0 / 64.0
    for kind, span in (("vertical speed", 14.0), ("altitude", 14.0 * LOOK_AHEAD))
}
"""How good an edge is, m/s and m."""
SMALL = 1.0  # m that both may change their distance by in a step of the simulation


OWN: VehicleState[Air] = VehicleState(*np.array([[0.0], [0.0], [0.0], [75.0]]))


class Scene(NamedTuple):
    """An ownship among intruders, all of them exactly known over the horizon."""

    own: VehicleState[Air]
    altitude: Altitude
    intruders: list[Intruder[Air]]

    def traffic(self) -> Traffic:
        """Return the intruders, ``[1, K]``."""
        states = np.array([intruder.state for intruder in self.intruders]).reshape(-1, 4)
        return Traffic.straight(VehicleState(*states.T[:, None]))

    def altitudes(self) -> Altitudes:
        """Return the altitudes, ``[1]`` and ``[1, K]``."""
        return altitudes_of(self.altitude, self.intruders, OPTIONS)

    def shut(self, *areas: Area, **limits: Level) -> Layers:
        """Return what is shut."""
        rows = no_areas(1)
        rows[0] = tuple(ActiveArea(n, area, 0.0, LOOK_AHEAD) for n, area in enumerate(areas))
        given = self.own, self.traffic(), OPTIONS.requirement, self.altitudes(), LOOK_AHEAD
        return layers(*given, rows, **limits)

    def bands(self, kind: str, shut: Layers, targets: Array = None) -> Bands:
        """Return the bands of a kind."""
        compute = vertical_speed_bands if kind == "vertical speed" else altitude_bands
        return compute(shut, self.altitudes(), VERTICAL, LOOK_AHEAD, targets)


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a scene in which intruders come near at random times and heights."""
    climb = float(rng.choice([0.0, rng.uniform(-9.0, 7.0)]))
    altitude = Altitude(2_000.0, "msl", climb, error=float(rng.choice([0.0, 10.0])))
    intruders = list[Intruder[Air]]()
    for _ in range(rng.integers(1, 4)):
        time, course = rng.uniform(10.0, 130.0), rng.uniform(-math.pi, math.pi)
        speed, beside = rng.uniform(40.0, 110.0), rng.uniform(-900.0, 900.0)
        state: VehicleState[Air] = VehicleState(
            75.0 * time - speed * time * math.cos(course) + beside,
            -speed * time * math.sin(course),
            course,
            speed,
        )
        rate = None if rng.random() < 0.1 else float(rng.choice([0.0, rng.uniform(-6.0, 6.0)]))
        there = Altitude(
            2_000.0 + rng.uniform(-500.0, 500.0) - (rate or 0.0) * time,
            "msl" if rng.random() < 0.95 else "wgs84",
            rate,
            error=float(rng.choice([0.0, 20.0])),
            climb_error=float(rng.choice([0.0, 0.3])),
        )
        intruders.append(
            Intruder(
                state,
                altitude=there,
                age=float(rng.choice([0.0, 2.0])),
                vertical_separation=None if rng.random() < 0.8 else 60.0,
            )
        )
    return Scene(OWN, altitude, intruders)


def climbs_to(target: np.ndarray, climb: float) -> np.ndarray:
    """Return the altitudes of flights to vertical speeds, m/s, above the first one, m, ``[T, B]``,
    in steps.
    """
    speed, height, rows = np.full(target.shape, climb), np.zeros(target.shape), []
    for _ in TIMES:
        rows.append(height)
        change = np.clip(
            target - speed, -VERTICAL.acceleration * STEP, VERTICAL.acceleration * STEP
        )
        height = height + (speed + 0.5 * change) * STEP
        speed = speed + change
    return np.array(rows)


def levels_off(rise: np.ndarray, climb: float) -> np.ndarray:
    """Return the same of flights to altitudes, m above the first one: they climb as fast as still
    lets them level off.
    """
    speed, height, rows = np.full(rise.shape, climb), np.zeros(rise.shape), []
    for _ in TIMES:
        rows.append(height)
        left = rise - height
        stops = np.sqrt(2.0 * VERTICAL.acceleration * np.abs(left))
        fastest = np.where(left > 0.0, VERTICAL.climb_max, VERTICAL.descent_max)
        due = np.sign(left) * np.minimum(fastest, stops)
        change = np.clip(due - speed, -VERTICAL.acceleration * STEP, VERTICAL.acceleration * STEP)
        height = height + (speed + 0.5 * change) * STEP
        speed = speed + change
    return np.array(rows)


def room(scene: Scene, kind: str, target: np.ndarray) -> np.ndarray:
    """Return by how much each flight keeps the vertical separation from each intruder at each time,
    m, ``[T, B, K]``; inf while the horizontal one is kept.
    """
    climb = scene.altitude.vertical_speed or 0.0
    own = (
        climbs_to(target, climb)
        if kind == "vertical speed"
        else levels_off(target - scene.altitude.value, climb)
    )
    margins = np.full((*own.shape, len(scene.intruders)), np.inf)
    margin, requirement = OPTIONS.vertical_margin, OPTIONS.requirement
    for k, intruder in enumerate(scene.intruders):
        other = intruder.altitude
        assert other is not None
        near = np.hypot(
            intruder.state.x
            + intruder.state.speed * math.cos(intruder.state.heading) * TIMES
            - 75.0 * TIMES,
            intruder.state.y + intruder.state.speed * math.sin(intruder.state.heading) * TIMES,
        )
        lost = near < requirement.separation + requirement.margin
        rate = other.vertical_speed or 0.0
        spread = OPTIONS.unknown_climb if other.vertical_speed is None else other.climb_error
        above = other.value + rate * (intruder.age + TIMES) - scene.altitude.value
        need = intruder.vertical(OPTIONS) + margin + scene.altitude.error + other.error
        need = need + spread * (intruder.age + TIMES)
        if other.reference != "msl":
            need = np.full(TIMES.shape, np.inf)
        away = np.abs(own - above[:, None]) - need[:, None]
        margins[..., k] = np.where(lost[:, None], away, np.inf)
    return margins


@pytest.mark.parametrize("kind", KINDS)
def test_a_band_is_closed_where_its_flight_meets_an_intruder(kind: str) -> None:
    rng = np.random.default_rng(4)
    both = []
    for _ in range(30):
        scene = random_scene(rng)
        bands = scene.bands(kind, scene.shut())
        chosen = slice(0, None, 8)
        margins = room(scene, kind, bands.target[0, chosen])
        least = margins.min(axis=(0, 2))
        sure = np.abs(least) > SMALL
        closed = bands.closed[0, chosen]
        assert (closed == (least < 0.0))[sure].all()
        free = ~closed & np.isfinite(least)
        np.testing.assert_allclose(bands.clearance[0, chosen][free], least[free], atol=SMALL)
        assert (bands.clearance[0, chosen][closed] <= least[closed] + SMALL).all()
        # From its loss until it opens it is lost, and neither before nor after.
        for number in np.flatnonzero(sure & closed):
            over_time = margins[:, number].min(axis=1)
            loss, opens = (field[0, chosen][number] for field in (bands.loss, bands.opens))
            assert over_time[loss - STEP > TIMES].min(initial=np.inf) > -SMALL
            assert over_time[np.abs(TIMES - loss) < 2.0 * STEP].min() < SMALL
            assert over_time[opens + STEP < TIMES].min(initial=np.inf) > -SMALL
            last = min(opens, LOOK_AHEAD)
            assert over_time[np.abs(TIMES - last) < 2.0 * STEP].min() < SMALL
        by = bands.intruder[0, chosen]
        assert (by[closed] >= 0).all() and (by[~closed] == -1).all()
        both += closed.tolist()
    assert 0.1 < np.mean(both) < 0.9


@pytest.mark.parametrize("kind", KINDS)
def test_a_free_stretch_is_free_and_ends_where_the_conflict_begins(kind: str) -> None:
    rng = np.random.default_rng(5)
    edges = 0
    for _ in range(12):
        scene = random_scene(rng)
        bands = scene.bands(kind, scene.shut())
        begin, end = bands.target[0, [0, -1]]
        for part in stretches(bands, circle=False):
            inside = np.linspace(part.low, part.high, 7)
            if not part.closed:
                assert room(scene, kind, inside).min() > -SMALL
                continue
            # Just inside the closed stretch it is lost, but for the simulation's steps.
            ends = np.array([part.low + EDGE[kind], part.high - EDGE[kind]])
            ends = ends[[part.low > begin, part.high < end]]
            margins = room(scene, kind, ends).min(axis=(0, 2), initial=np.inf)
            assert (margins < SMALL).all()
            edges += ends.size
    assert edges > 12


@given(
    st.floats(-12.0, 12.0),
    st.lists(st.floats(-900.0, 900.0), min_size=2, max_size=8),
    st.floats(0.2, 3.0),
)
def test_a_higher_target_is_never_lower_and_every_target_is_reached(
    climb: float, rises: list[float], acceleration: float
) -> None:
    ability = VERTICAL._replace(acceleration=acceleration)
    rise = np.sort(rises)
    until = 1_000.0
    for flight in (
        to_altitude(rise, np.array(climb), ability, until),
        to_climb(rise / 100.0, np.array(climb), acceleration, until),
    ):
        heights = np.array([altitudes_at(flight, time) for time in np.linspace(0.0, until, 300)])
        assert (np.diff(heights, axis=1) >= -1e-6).all()
    climbing = to_altitude(rise, np.array(climb), ability, until)
    assert climbing.altitude[:, -1] == pytest.approx(rise, abs=1e-6)
    assert climbing.climb[:, -1] == pytest.approx(0.0, abs=1e-9)
    # Not faster than it can, but for how it began.
    fastest = np.maximum([ability.descent_max, ability.climb_max], [-climb, climb])
    assert (climbing.climb >= -fastest[0] - 1e-9).all() and (
        climbing.climb <= fastest[1] + 1e-9
    ).all()


def altitudes_at(flight: Any, time: float) -> np.ndarray:
    """Return how high flights ``[B]`` are at a time, m."""
    nothing, then = Bound(np.zeros(1), np.zeros(1)), Times(*np.full((2, 1), time))
    return least_above(flight, nothing, then)


@given(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-200.0, 200.0), st.floats(-4.0, 4.0))
def test_when_a_flight_comes_down_to_a_bound_is_when_a_fine_search_says(
    climb: float, target: float, height: float, rate: float
) -> None:
    flight = to_climb(np.array([target]), np.array(climb), 0.5, 60.0)
    bound, times = Bound(np.array([height]), np.array([rate])), Times(*np.array([[5.0], [50.0]]))
    grid = np.linspace(5.0, 50.0, 901)
    above = np.array([altitudes_at(flight, time)[0] for time in grid]) - (height + rate * grid)
    time, least = float(first_below(flight, bound, times)[0]), least_above(flight, bound, times)[0]
    assert least == pytest.approx(above.min(), abs=0.01)
    if math.isinf(time):
        assert above.min() > -1e-6
    else:
        assert (above[grid < time - 1e-6] > -1e-6).all()
        assert least <= 1e-6
        exactly = altitudes_at(flight, time)[0] - (height + rate * time)
        assert exactly < 1e-6 and (time == 5.0 or exactly > -1e-6)


def head_on(above: float, climb: float = 0.0) -> Intruder[Air]:
    """Return an intruder that comes along the course, a minute away."""
    state: VehicleState[Air] = VehicleState(9_000.0, 0.0, math.pi, 75.0)
    return Intruder(state, altitude=Altitude(2_000.0 + above, "msl", climb))


SIMPLE = Scene(OWN, Altitude(2_000.0, "msl", 0.0), [head_on(0.0)])


def test_a_climb_over_an_intruder_is_as_steep_as_a_calculation_by_hand() -> None:
    bands = SIMPLE.bands("vertical speed", SIMPLE.shut())
    parts = stretches(bands, circle=False)
    assert [part.closed for part in parts] == [False, True, False]
    # Both lose the horizontal separation after so many seconds, and must be so far apart then.
    requirement = OPTIONS.requirement
    time = (9_000.0 - requirement.separation - requirement.margin) / 150.0
    need = VERTICAL.separation + OPTIONS.vertical_margin
    # With a climb c: c t - c^2 / (2 a) = need.
    a = VERTICAL.acceleration
    least = a * (time - math.sqrt(time * time - 2.0 * need / a))
    for edge, exact in ((parts[1].low, -least), (parts[1].high, least)):
        assert abs(edge - exact) <= EDGE["vertical speed"]
        assert abs(edge) >= least
    # Less than a foot a minute.
    assert EDGE["vertical speed"] < 0.00508
    altitudes = stretches(SIMPLE.bands("altitude", SIMPLE.shut()), circle=False)
    assert altitudes[1].low == pytest.approx(2_000.0 - need, abs=EDGE["altitude"])
    assert altitudes[1].high == pytest.approx(2_000.0 + need, abs=EDGE["altitude"])


def test_the_present_climb_is_closed_exactly_where_plans_count_the_intruder() -> None:
    rng = np.random.default_rng(6)
    closed = 0
    for _ in range(60):
        scene = random_scene(rng)
        met = times_met(scene.intruders, hold(scene.altitude, OPTIONS), OPTIONS)
        counted = Met(met, no_areas(1)).columns(scene.traffic())
        loss = losses_on_course(scene.own, counted, OPTIONS.requirement, LOOK_AHEAD).min()
        target = np.array([scene.altitude.vertical_speed])
        bands = scene.bands("vertical speed", scene.shut(), target)
        if math.isinf(loss):
            assert not bands.closed.any()
        else:
            # Plans look at parts of a leg, and count a part as soon as it begins.
            assert loss - 1e-6 <= bands.loss[0, 0] <= loss + 0.4
            closed += 1
    assert 10 < closed < 50


@pytest.mark.parametrize("kind", KINDS)
def test_who_is_at_an_unknown_altitude_counts_at_all_of_them(kind: str) -> None:
    for altitude in (None, Altitude(5_000.0, "wgs84", 0.0)):
        scene = SIMPLE._replace(intruders=[replace(head_on(0.0), altitude=altitude)])
        bands = scene.bands(kind, scene.shut())
        assert bands.closed.all() and (bands.clearance == -np.inf).all()
        assert np.ptp(bands.loss) == 0.0
        assert recovery(bands, VERTICAL.separation).index[0] == -1


@pytest.mark.parametrize("kind", KINDS)
def test_nobody_closes_nothing(kind: str) -> None:
    scene = SIMPLE._replace(intruders=[])
    bands = scene.bands(kind, scene.shut())
    assert not bands.closed.any() and np.isinf(bands.clearance).all()
    assert (bands.opens == 0.0).all() and np.isinf(bands.nearby).all()
    assert len(stretches(bands, circle=False)) == 1


def test_a_floor_and_a_ceiling_close_what_would_leave_them() -> None:
    scene = SIMPLE._replace(intruders=[])
    limits = {"floor": Level(1_700.0, "msl"), "ceiling": Level(2_400.0, "msl")}
    bands = scene.bands("altitude", scene.shut(**limits))
    free = [part for part in stretches(bands, circle=False) if not part.closed]
    assert len(free) == 1
    assert free[0].low == pytest.approx(1_700.0 + OPTIONS.vertical_margin, abs=EDGE["altitude"])
    assert free[0].high == pytest.approx(2_400.0 - OPTIONS.vertical_margin, abs=EDGE["altitude"])
    assert (bands.intruder == -1).all() and (bands.area == -1).all()
    # At its edge an ownship may stay.
    level = scene.bands(
        "vertical speed", scene.shut(floor=Level(1_999.0, "msl")), np.array([-0.1, 0.0])
    )
    assert level.closed.tolist() == [[True, False]]
    # An area that must not be left has both, too.
    inside = Area(Circle(0.0, 0.0, 30_000.0), Keep.IN, floor=limits["floor"])
    assert (
        scene.bands("altitude", scene.shut(inside)).closed
        == scene.bands("altitude", scene.shut(floor=limits["floor"])).closed
    ).all()


def test_a_limit_of_another_reference_lets_an_ownship_stay_and_no_more() -> None:
    scene, climbs = SIMPLE._replace(intruders=[]), np.array([-2.0, 0.0, 2.0])
    above_ground = Level(9_000.0, "ground")
    for limit, closed in (
        ("floor", [True, False, False]),
        ("ceiling", [False, False, True]),
    ):
        inside = Area(Circle(0.0, 0.0, 30_000.0), Keep.IN, **{limit: above_ground})
        for shut in (scene.shut(**{limit: above_ground}), scene.shut(inside)):
            assert scene.bands("vertical speed", shut, climbs).closed.tolist() == [closed]


@pytest.mark.parametrize("kind", KINDS)
def test_an_area_closes_what_flies_into_it_and_not_above_or_below(kind: str) -> None:
    rng = np.random.default_rng(7)
    both = []
    for _ in range(20):
        low = 2_000.0 + rng.uniform(-300.0, 200.0)
        high = low + rng.uniform(50.0, 300.0)
        area = Area(
            Circle(rng.uniform(0.0, 6_000.0), rng.uniform(-800.0, 800.0), 1_000.0),
            floor=Level(low, "msl") if rng.random() < 0.8 else None,
            ceiling=Level(high, "msl") if rng.random() < 0.8 else None,
            velocity=(rng.uniform(-10.0, 10.0), 0.0),
        )
        scene = SIMPLE._replace(intruders=[], altitude=Altitude(2_000.0, "msl", 2.0, error=5.0))
        bands = scene.bands(kind, scene.shut(area))
        target = bands.target[0, ::8]
        own = 2_000.0 + (
            climbs_to(target, 2.0)
            if kind == "vertical speed"
            else levels_off(target - 2_000.0, 2.0)
        )
        x = 75.0 * TIMES - area.velocity[0] * TIMES
        away = signed_distance(area, x, 0.0 * x)
        need = required_distances(
            ActiveArea(0, area, 1.0, LOOK_AHEAD),
            np.zeros(1),
            np.zeros(1),
            OPTIONS.requirement.margin,
        )
        inside = away < need
        error = 5.0 + OPTIONS.vertical_margin
        over = own - (high + error) if area.ceiling else np.full(own.shape, -np.inf)
        under = low - error - own if area.floor else np.full(own.shape, -np.inf)
        clear = np.maximum(over, under)[inside]
        least = clear.min(axis=0, initial=np.inf)
        sure = np.abs(least) > 15.0  # that may be flown within the half second of a loss
        assert (bands.closed[0, ::8] == (least < 0.0))[sure].all()
        assert ((bands.area == 0) == bands.closed).all()
        both += bands.closed[0].tolist()
    assert 0.05 < np.mean(both) < 0.95


def test_where_nothing_is_free_the_way_out_leads_away() -> None:
    for above, climbs in ((60.0, False), (-60.0, True)):
        state = VehicleState(900.0, 0.0, 0.0, 75.0)
        intruder = Intruder(state, altitude=Altitude(2_000.0 + above, "msl", 0.0))
        near = SIMPLE._replace(intruders=[intruder])
        bands = near.bands("vertical speed", near.shut())
        assert bands.closed.all() and (bands.loss == 0.0).all()
        out = recovery(bands, VERTICAL.separation)
        assert (bands.target[0, out.index[0]] > 0.0) == climbs
        assert out.clearance[0] < 0.0 and 0.0 < out.opens[0] < LOOK_AHEAD
        shown = regions(bands, Alerting.for_aircraft(AIRCRAFT), VERTICAL.separation)
        assert (shown == Region.RECOVERY).any()


def test_a_row_does_not_depend_on_the_others() -> None:
    rng = np.random.default_rng(8)
    scenes = [random_scene(rng) for _ in range(6)]
    scenes = [scene._replace(intruders=scene.intruders[:1]) for scene in scenes]
    own, traffic, altitudes = (
        join([part(scene) for scene in scenes])
        for part in (
            lambda s: s.own,
            Scene.traffic,
            lambda s: s.altitudes()._replace(reference=None),
        )
    )
    altitudes = altitudes._replace(reference="msl")
    shut = layers(own, traffic, OPTIONS.requirement, altitudes, LOOK_AHEAD)
    together = altitude_bands(shut, altitudes, VERTICAL, LOOK_AHEAD)
    for row, scene in enumerate(scenes):
        alone = scene.bands("altitude", scene.shut())
        for first, second in zip(alone, together, strict=True):
            np.testing.assert_array_equal(first[0], second[row])


def join(parts: Sequence[Any]) -> Any:
    """Return rows of nested tuples one below the other."""
    return map_leaves(lambda *fields: np.concatenate(fields), *parts)


def test_a_layer_counts_whenever_a_turning_or_uncertain_intruder_is_too_near() -> None:
    rng = np.random.default_rng(9)
    requirement = OPTIONS.requirement
    count, met = 80, 0
    own = map_leaves(lambda field: np.repeat(field, count), OWN)
    traffic = traffic_of(rng, count, noise=True)
    nothing = np.zeros(traffic.mask.shape)
    gap = Gap(nothing, nothing, nothing + 140.0, nothing)
    altitudes = Altitudes("msl", *np.zeros((3, count)), gap)
    shut = layers(own, traffic, requirement, altitudes, LOOK_AHEAD)
    begin, end = (field[:, :3] for field in shut.times)
    required = requirement_of(traffic, own, requirement)
    for time in np.arange(0.0, LOOK_AHEAD, 0.5):
        there = predict(traffic, time)
        away = np.hypot(there.x - own.x[:, None] - 75.0 * time, there.y - own.y[:, None])
        grown = uncertainty(traffic, time) - uncertainty(traffic, 0.0)
        lost = traffic.mask & (away < required + requirement.sigmas * grown - GOOD)
        assert ((begin <= time) & (time <= end))[lost].all()
        met += int(lost.sum())
    assert met > 200


def test_an_ownship_of_unknown_vertical_speed_has_no_bands() -> None:
    with pytest.raises(ValueError, match="vertical speed is None"):
        altitudes_of(Altitude(2_000.0, "msl"), [], OPTIONS)


def test_a_broken_altitude_counts_at_all_altitudes_or_is_refused() -> None:
    broken = Altitude(math.nan, "msl", 0.0)
    others = [Intruder(VehicleState(0.0, 0.0, 0.0, 75.0), altitude=broken)]
    assert altitudes_of(Altitude(2_000.0, "msl", 0.0), others, OPTIONS).gap.near == math.inf
    with pytest.raises(ValueError, match="is nan, expected"):
        altitudes_of(broken, [], OPTIONS)
