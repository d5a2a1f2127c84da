"""Bands are one truth with the planner: a band is closed if and only if the manoeuvre that it stands
for loses the required separation.
"""

import math
from typing import Any

import numpy as np
import pytest

from agents.assurance.alerts import Alerting, Region, regions
from agents.assurance.bands import Bands, heading_bands, recovery, speed_bands, stretches
from agents.assurance.inputs import no_areas
from agents.kernel.areas import ActiveArea
from agents.kernel.traffic import Requirement, Traffic, predict, requirement_of, uncertainty
from agents.planner.judge.validator import CHECKS, validate
from agents.planner.planner import plan_many
from agents.planner.request.encounters import request_of
from agents.planner.request.options import Options
from agents.policy.inference import Policy
from envs.aircraft import PAPER
from envs.angles import wrap
from envs.areas import Area, Circle
from envs.kinematics import C208_PUBLISHED, UNLIMITED, Limits, VehicleState, advance
from envs.scenarios import scenario
from envs.starts import encounters_of_seed
from envs.trees import column, map_leaves, take
from envs.waypoints import PlanStates, at, legs
from tests.support import mirror_state, random_states, vehicle

REQUIREMENT = Requirement(1_000.0, margin=0.02, sigmas=1.0)
LIMITS = C208_PUBLISHED
LOOK_AHEAD = 120.0
GOOD = 0.6  # m that a clearance may be off


def traffic_of(generator: np.random.Generator, count: int, *, noise: bool) -> Traffic:
    """Return three intruders a row, some that turn, some absent."""
    shape = count, 3
    state = random_states(generator, *shape, extent=6_000.0)
    rate = generator.choice([0.0, 0.03, -0.05], shape)
    spread = generator.random(shape)
    return Traffic(
        state,
        generator.random(shape) < 0.9,
        rate,
        np.where(rate == 0.0, 0.0, 15.0),
        30.0 * noise * spread,
        3.0 * noise * spread,
        1.0 * noise * spread,
    )


def straight_traffic(*others: tuple[float, float, float, float]) -> Traffic:
    states = np.array(others).T
    return Traffic.straight(VehicleState(*(field[None] for field in states)))


def manoeuvre(own: VehicleState, bands: Bands, number: int, kind: str) -> PlanStates:
    """Return the manoeuvre of one band of every row as plan states of legs with constant controls."""
    target, reached = bands.target[:, number], bands.reached[:, number]
    reached = np.minimum(np.maximum(reached, 1.0), LOOK_AHEAD - 1.0)  # no leg without length
    states, parts = [own], 8
    for _ in range(parts):
        turn, gain = wrap(target - own.heading, np) / parts, (target - own.speed) / parts
        step = reached / parts
        yaw_rate, acceleration = (turn / step, 0.0) if kind == "heading" else (0.0, gain / step)
        states.append(advance(states[-1], acceleration, yaw_rate + 0.0 * step, step, UNLIMITED, np))
    for _ in range(parts):
        hold = (LOOK_AHEAD - reached) / parts
        states.append(advance(states[-1], 0.0 * hold, 0.0 * hold, hold, UNLIMITED, np))
    times = [reached * share for share in np.linspace(0.0, 1.0, parts + 1)]
    times += [
        reached + (LOOK_AHEAD - reached) * share for share in np.linspace(0, 1, parts + 1)[1:]
    ]
    x, y, heading, speed = (np.stack(field, axis=1) for field in zip(*states, strict=True))
    return PlanStates(x, y, heading, speed, np.stack(times, axis=1))


@pytest.mark.parametrize("noise", [pytest.param(False, marks=pytest.mark.slow), True])
@pytest.mark.parametrize("kind", ["heading", "speed"])
def test_a_band_is_closed_where_the_validator_finds_its_manoeuvre_too_close(
    kind: str, noise: bool
) -> None:
    generator = np.random.default_rng(11)
    count = 60
    own = random_states(generator, count, extent=1_000.0)
    traffic = traffic_of(generator, count, noise=noise)
    compute = heading_bands if kind == "heading" else speed_bands
    bands = compute(own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD)
    # What is reached within a second is flown in one, so that every leg has a length.
    flyable = bands.reached >= 1.0 if kind == "heading" else bands.reached < LOOK_AHEAD - 1.0
    flyable &= bands.reached >= 1.0
    both = []
    for number in range(0, bands.target.shape[1], 9):
        findings = validate(manoeuvre(own, bands, number, kind), traffic, REQUIREMENT, LIMITS)
        rows = np.flatnonzero(flyable[:, number])
        assert findings.legal[rows].all()
        clearance, bound = bands.clearance[rows, number], findings.clearance[rows]
        assert (np.minimum(clearance, 190.0) >= np.minimum(bound, 190.0) - GOOD).all()
        lost = bound < 0.0  # where it is clear, the validator's bound is a coarse one
        np.testing.assert_allclose(clearance[lost], bound[lost], atol=GOOD)
        clear = rows[np.abs(clearance) > GOOD]
        closed = bands.closed[clear, number]
        assert (closed == findings.wrong[clear, CHECKS.index("separation")]).all()
        lost = clear[closed]
        # The validator names the leg's part in which the loss begins.
        first = findings.time[lost, CHECKS.index("separation")]
        assert np.abs(bands.loss[lost, number] - first).max(initial=0.0) < 1.1
        assert (bands.intruder[lost, number] >= 0).all()
        both += closed.tolist()
    assert 0.05 < np.mean(both) < 0.8 and len(both) > 150


def path_of(
    own: VehicleState, bands: Bands, number: int, time: Any, limits: Limits
) -> VehicleState:
    """Return where the manoeuvre of a heading band is at a time, or times ``[N]``."""
    turn = wrap(bands.target[:, number] - own.heading, np)
    turning = np.minimum(np.abs(turn) / limits.yaw_rate_max, time)
    rate, state = np.sign(turn) * limits.yaw_rate_max, own
    for _ in range(4):  # less than a radian each
        state = advance(state, 0.0 * rate, rate, 0.25 * turning, UNLIMITED, np)
    return advance(state, 0.0 * rate, 0.0 * rate, time - turning, UNLIMITED, np)


@pytest.mark.parametrize("name", ["maneuvering", pytest.param("multi", marks=pytest.mark.slow)])
def test_a_safe_plan_never_holds_a_closed_band(name: str) -> None:
    """Until a band's loss a SAFE plan must have left its manoeuvre by what is missing then.

    Both are at most d apart until a time, so that the band's clearance until then is at least the
    plan's less d.
    """
    encounters = encounters_of_seed(scenario(name, PAPER), 5, 0, 60)
    policy, options = Policy.load(), Options.for_aircraft(PAPER)
    request = request_of(encounters, PAPER)
    candidates = plan_many(request, policy, options).candidates
    safe = np.flatnonzero(candidates.safe)
    assert safe.size > 40
    own, traffic, plan_states = take((request.own, request.traffic, candidates.plan_states), safe)
    curves = legs(plan_states)
    telling = 0
    for look_ahead in (20.0, 40.0, 60.0, 80.0, 120.0):
        # The heading on which the plan is by then, and others.
        towards = at(curves, np.full(safe.size, 0.7 * look_ahead)).heading
        targets = wrap(towards[:, None] + np.radians([0.0, 3.0, -3.0, 30.0, -30.0]), np)
        bands = heading_bands(
            own, traffic, options.requirement, options.manoeuvre, look_ahead, targets
        )
        for number in range(targets.shape[1]):
            apart = np.zeros(safe.size)
            for time in np.linspace(0.0, look_ahead, 25)[1:]:
                planned = at(curves, np.full(safe.size, time))
                band = path_of(own, bands, number, time, options.manoeuvre)
                off = np.hypot(planned.x - band.x, planned.y - band.y)
                apart = np.maximum(apart, off)
            # Between those times they part by little more.
            apart = 1.05 * apart + 1.0
            clearance = bands.clearance[:, number]
            assert (clearance >= -apart).all()
            telling += int((clearance < 200.0 - apart).sum())
    assert telling >= 5  # bands that come near an intruder while the plan stays with them


def test_an_intruder_ahead_closes_the_way_to_it_and_the_loss_is_exact() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    traffic = straight_traffic((9_000.0, 0.0, math.pi, 70.0))
    requirement = Requirement(1_000.0)
    bands = heading_bands(own, traffic, requirement, LIMITS, LOOK_AHEAD, np.radians([-90.0, 0.0]))
    assert bands.closed.tolist() == [[False, True]]
    assert bands.loss[0, 1] == pytest.approx(8_000.0 / 150.0, abs=1e-3)
    assert bands.intruder.tolist() == [[-1, 0]]
    assert bands.clearance[0, 1] == pytest.approx(-1_000.0, abs=1e-3)
    # The range opens again 1000 m behind it.
    assert bands.opens[0, 1] == pytest.approx(10_000.0 / 150.0, abs=1e-3)


def test_flying_faster_passes_ahead_and_slower_behind() -> None:
    own = vehicle(0.0, 0.0, 0.0, 75.0)
    # It crosses the course 4.5 km ahead when the ownship is there.
    traffic = straight_traffic((4_500.0, -4_500.0, 0.5 * math.pi, 75.0))
    limits = Limits(30.0, 150.0, -2.0, 2.0, 0.05)
    bands = speed_bands(own, traffic, Requirement(1_000.0), limits, 100.0)
    kinds = [stretch.closed for stretch in stretches(bands, circle=False)]
    assert kinds == [False, True, False]


def test_what_cannot_be_reached_is_judged_by_the_way_towards_it() -> None:
    own = vehicle(0.0, 0.0, 0.0, 75.0)
    traffic = straight_traffic((9_000.0, 0.0, math.pi, 75.0))
    stiff = Limits(30.0, 150.0, 0.0, 0.0, 0.0)
    for compute, targets in ((speed_bands, [40.0, 75.0, 90.0]), (heading_bands, [-1.0, 0.0, 1.0])):
        bands = compute(own, traffic, Requirement(1_000.0), stiff, LOOK_AHEAD, np.array(targets))
        assert bands.reached.tolist() == [[LOOK_AHEAD, 0.0, LOOK_AHEAD]]
        # It flies straight on whatever it aims at.
        np.testing.assert_allclose(bands.clearance, -1_000.0, atol=0.1)
        np.testing.assert_allclose(bands.loss, 8_000.0 / 150.0, atol=4.1)


def test_where_nothing_is_free_the_recovery_does_not_fly_through() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    traffic = straight_traffic((700.0, 150.0, math.pi, 80.0))
    bands = heading_bands(own, traffic, Requirement(1_000.0), LIMITS, LOOK_AHEAD)
    assert bands.closed.all() and (bands.loss == 0.0).all()
    way_out = recovery(bands, 1_000.0)
    chosen = int(way_out.index[0])
    assert bands.target[0, chosen] < -0.2  # to the right, away from the intruder's track
    assert way_out.clearance[0] > bands.clearance.max() - 100.0
    assert 0.0 < way_out.opens[0] < 60.0
    alike = bands.clearance[0] >= bands.clearance.max() - 100.0
    assert way_out.opens[0] == bands.opens[0, alike].min()


def test_there_is_no_recovery_where_a_band_is_free() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    traffic = straight_traffic((9_000.0, 0.0, math.pi, 70.0))
    bands = heading_bands(own, traffic, Requirement(1_000.0), LIMITS, LOOK_AHEAD)
    assert recovery(bands, 1_000.0).index.tolist() == [-1]


def flown_clearance(
    own: VehicleState, traffic: Traffic, target: float, rate: float, look_ahead: float
) -> float:
    """Return the least clearance from straight exact intruders ``[1, K]`` on the way to a heading,
    m: flown in steps of a quarter of a second, by the shorter way round.
    """
    time = np.arange(0.0, look_ahead + 0.01, 0.25)
    x, y, heading, speed = (float(field[0]) for field in own)
    turn = math.remainder(target - heading, math.tau)
    turning = np.minimum(time, abs(turn) / rate)
    radius = math.copysign(speed / rate, turn)
    after = heading + math.copysign(rate, turn) * turning
    straight = speed * (time - turning)
    x = x + radius * (np.sin(after) - math.sin(heading)) + straight * np.cos(after)
    y = y - radius * (np.cos(after) - math.cos(heading)) + straight * np.sin(after)
    there = predict(map_leaves(lambda field: field.T, traffic), time)
    apart = np.hypot(there.x - x, there.y - y)
    return float((apart - requirement_of(traffic, own, REQUIREMENT)[0][:, None]).min())


def test_all_headings_of_a_free_stretch_are_free_and_closed_ones_hold_a_conflict() -> None:
    generator = np.random.default_rng(7)
    rate = LIMITS.yaw_rate_max
    opposite = told = 0
    for _ in range(12):
        own = random_states(generator, 1, extent=0.0)
        traffic = Traffic.straight(random_states(generator, 1, 2, extent=5_000.0))
        bands = heading_bands(own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD)
        parts = stretches(bands)
        assert parts[-1].high - parts[0].low == pytest.approx(math.tau)
        for part in parts:
            inside = np.linspace(part.low, part.high, 2 + int((part.high - part.low) / 0.02))[1:-1]
            # Beside the opposite heading, too, from both sides.
            behind = float(own.heading[0]) + math.pi + np.array([-1e-3, 1e-3])
            behind = part.low + (behind - part.low) % math.tau
            inside = [*inside, *behind[behind < part.high]]
            flown = [flown_clearance(own, traffic, heading, rate, LOOK_AHEAD) for heading in inside]
            if not part.closed:
                assert min(flown, default=0.0) > -0.1
                opposite += int((behind < part.high).sum())
            elif len(flown) > 4:  # more than can be left unproven
                assert min(flown) < 1.0
                told += 1
    assert opposite > 5 and told > 5


def test_a_conflict_between_two_headings_closes_what_is_between_them() -> None:
    own = vehicle(0.0, 0.0, 0.0, 75.0)
    # It stands 6 km away, a hundred metres wide, half-way between two of the headings.
    place = 6_000.0 * np.exp(1j * math.radians(52.5)) + 950.0j
    traffic = straight_traffic((place.real, place.imag, 0.0, 0.0))
    traffic = traffic._replace(separation=np.array([[100.0]]))
    bands = heading_bands(own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD)
    assert not bands.closed.any()
    narrow = [part for part in stretches(bands) if part.closed]
    assert len(narrow) == 1
    assert 0.02 < narrow[0].high - narrow[0].low < 0.05
    # The display draws bands half-way to their neighbours.
    shown = regions(bands, Alerting.for_aircraft(PAPER), 100.0)[0]
    assert 1 <= (shown != Region.FREE).sum() <= 2


@pytest.mark.parametrize("kind", ["heading", "speed"])
def test_a_free_stretch_amid_uncertain_and_turning_intruders_and_areas_is_free(kind: str) -> None:
    generator = np.random.default_rng(3)
    compute = heading_bands if kind == "heading" else speed_bands
    lake = Area(Circle(4_000.0, 1_000.0, 900.0), velocity=(-10.0, 5.0), clearance=100.0)
    areas = no_areas(1)
    areas[0] = (ActiveArea(0, lake, 0.0, 400.0),)
    lengths = 0.0
    for number in range(8):
        own = random_states(generator, 1, extent=0.0)
        traffic = traffic_of(generator, 1, noise=True)
        given = own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD
        amid = areas if number % 2 else None
        parts = stretches(compute(*given, None, amid), circle=kind == "heading")
        for part in parts:
            if part.closed:
                continue
            inside = np.linspace(part.low, part.high, 30)[1:-1]
            again = compute(*given, wrap(inside, np) if kind == "heading" else inside, amid)
            assert (again.clearance[0] > -GOOD).all()
            lengths += part.high - part.low
    assert lengths > 0.0


def test_nobody_closes_nothing() -> None:
    own = random_states(np.random.default_rng(1), 3)
    absent = traffic_of(np.random.default_rng(2), 3, noise=True)
    absent = absent._replace(mask=np.zeros_like(absent.mask))
    nobody = take(absent, (slice(None), slice(0, 0)))
    for traffic in (absent, nobody):
        for compute in (heading_bands, speed_bands):
            bands = compute(own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD)
            assert not bands.closed.any() and (bands.opens == 0.0).all()
            assert np.isinf(bands.clearance).all()
            assert len(stretches(bands)) == 1


def test_a_row_does_not_depend_on_the_others_nor_on_absent_intruders() -> None:
    generator = np.random.default_rng(8)
    own = random_states(generator, 12, extent=1_000.0)
    traffic = traffic_of(generator, 12, noise=True)
    straight = traffic._replace(
        turn_time=np.where(np.arange(12)[:, None] < 6, 0, traffic.turn_time)
    )
    together = heading_bands(own, straight, REQUIREMENT, LIMITS, LOOK_AHEAD)
    for row in range(12):
        part = slice(row, row + 1)
        alone = heading_bands(
            take(own, part), take(straight, part), REQUIREMENT, LIMITS, LOOK_AHEAD
        )
        away = np.abs(alone.clearance[0]) > GOOD
        assert (alone.closed[0] == together.closed[row])[away].all()
        np.testing.assert_allclose(
            np.minimum(alone.clearance[0], 190.0),
            np.minimum(together.clearance[row], 190.0),
            atol=GOOD,
        )


def test_left_and_right_are_alike() -> None:
    generator = np.random.default_rng(9)
    own, traffic = random_states(generator, 20), traffic_of(generator, 20, noise=True)
    targets = wrap(own.heading[:, None] + np.radians([-100.0, -40.0, 5.0, 70.0]), np)
    there = heading_bands(own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD, targets)
    other = traffic._replace(state=mirror_state(traffic.state), turn_rate=-traffic.turn_rate)
    here = heading_bands(mirror_state(own), other, REQUIREMENT, LIMITS, LOOK_AHEAD, -targets)
    np.testing.assert_allclose(here.clearance, there.clearance, atol=1e-6)
    np.testing.assert_allclose(here.loss, there.loss, atol=1e-6)


def test_a_start_inside_the_margin_must_keep_its_distance_only() -> None:
    own = vehicle(0.0, 0.0, 0.0, 80.0)
    traffic = straight_traffic((0.0, 1_005.0, 0.0, 80.0))  # abreast
    requirement = Requirement(1_000.0, margin=50.0)
    bands = heading_bands(own, traffic, requirement, LIMITS, LOOK_AHEAD, np.array([0.0, 0.3]))
    assert bands.closed.tolist() == [[False, True]]


def clearance_at(
    own: VehicleState, traffic: Traffic, bands: Bands, number: int, time: float
) -> Any:
    """Return the clearance of a heading band's manoeuvre at a time, m, ``[N]``."""
    there, here = (
        predict(column(traffic), np.full((1, 1, 1), time)),
        path_of(own, bands, number, time, LIMITS),
    )
    apart = np.hypot(there.x[:, 0] - here.x[:, None], there.y[:, 0] - here.y[:, None])
    grown = uncertainty(traffic, time) - uncertainty(traffic, 0.0)
    need = requirement_of(traffic, own, REQUIREMENT) + REQUIREMENT.sigmas * grown
    return np.where(traffic.mask, apart - need, np.inf).min(axis=1)


def test_a_way_that_opens_is_clear_from_then_on() -> None:
    generator = np.random.default_rng(21)
    own = random_states(generator, 40, extent=1_000.0)
    traffic = map_leaves(np.array, traffic_of(generator, 40, noise=False))
    bands = heading_bands(own, traffic, REQUIREMENT, LIMITS, LOOK_AHEAD)
    for number in range(0, 72, 9):
        opens = bands.opens[:, number]
        for time in (30.0, 60.0, 90.0, LOOK_AHEAD):
            clearance = clearance_at(own, traffic, bands, number, time)
            assert (clearance[opens < time - 1.0] > -GOOD).all()
    assert np.isfinite(bands.opens[bands.closed]).any()
