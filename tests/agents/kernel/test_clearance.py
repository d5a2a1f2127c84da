"""What is flown, and how close it comes: a lower bound, sharp where it matters, whatever is flown."""

import numpy as np
import pytest

from agents.kernel.clearance import Clearance, clearance
from agents.kernel.separation import Separation, separation
from agents.kernel.traffic import Requirement, Traffic, growth, positions
from agents.kernel.trajectory import (
    FINE,
    Steering,
    Trajectory,
    cut,
    manoeuvres,
    pieces,
    rest_of,
    steered,
    straight,
    trajectory,
)
from envs.kinematics import VehicleState
from envs.trees import column, map_leaves, take
from envs.waypoints import at
from tests.agents.planner.test_validator import plans, traffic
from tests.support import random_states

REQUIRED, SAMPLES = 1_000.0, 4_001


def mission(seed: int, count: int) -> Trajectory:
    """Return missions of four minutes with corners, at another speed on each leg."""
    rng = np.random.default_rng(seed)
    lasts = rng.uniform(5.0, 60.0, (count, 6))
    lasts *= 240.0 / lasts.sum(axis=1, keepdims=True)
    way, course = lasts * rng.uniform(50.0, 100.0, (count, 6)), rng.uniform(-3.0, 3.0, (count, 6))
    corners = np.cumsum([lasts, way * np.cos(course), way * np.sin(course)], axis=-1)
    time, x, y = np.concatenate([np.zeros((3, count, 1)), corners], axis=-1)
    return straight(x, y, time)


def aircraft(count: int) -> VehicleState:
    """Return the same aircraft in each row."""
    return VehicleState(*(np.full(count, value) for value in (10.0, -5.0, 0.3, 75.0)))


def manoeuvre(seed: int, count: int) -> Trajectory:
    """Return turns and changes of speed of one aircraft, which are held then."""
    rng = np.random.default_rng(seed)
    turns = rng.random(count) < 0.7
    steering = Steering(
        np.where(turns, rng.choice([-0.05, 0.05], count), 0.0),
        np.where(turns, 0.0, rng.choice([-0.5, 0.5], count)),
        rng.uniform(0.0, 40.0, count),
    )
    return manoeuvres(aircraft(count), steering, 120.0)


FLOWN = {
    "plan": lambda seed, count: trajectory(plans(count, seed)),
    "mission": mission,
    "manoeuvre": manoeuvre,
}


def sampled(
    flown: Trajectory, intruders: Traffic, since: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and distances, m, ``[T, N, K]``, from a moment to the end of them all."""
    times = np.linspace(since, flown.end[0], SAMPLES)
    rows = np.broadcast_to(times[:, None], (SAMPLES, len(flown.end)))
    curves = map_leaves(lambda field: np.broadcast_to(field, (SAMPLES, *field.shape)), flown.legs)
    own = at(curves, rows)
    x, y = positions(map_leaves(lambda field: field[None], intruders), times[:, None, None])
    return times, np.hypot(x - own.x[..., None], y - own.y[..., None])


def kept(flown: Trajectory, intruders: Traffic, level: float = 0.0) -> Clearance:
    """Return what is kept of 1000 m."""
    required = np.full(intruders.mask.shape, REQUIRED)
    return clearance(flown, Separation(intruders, required, None, 2.0), level)


@pytest.mark.parametrize("kind", FLOWN)
@pytest.mark.parametrize("count", [3, 12])  # with few intruders no leg is left out
def test_the_bound_is_never_too_large_and_sharp_below_the_level(kind: str, count: int) -> None:
    flown = FLOWN[kind](2, 8)
    intruders = traffic(8, count, 3, turning=True)
    _, away = sampled(flown, intruders)
    bounds, least = kept(flown, intruders), away.min(axis=0) - REQUIRED
    present = intruders.mask
    assert np.isinf(bounds.margin[~present]).all()
    assert np.all(bounds.margin[present] <= least[present] + 1e-6)
    close = present & (least < -1.0) & (least > 100.0 - REQUIRED)  # samples are 10 m apart
    assert close.any()
    assert np.all(bounds.margin[close] >= least[close] - 0.15)
    np.testing.assert_array_equal(bounds.margin < 0.0, np.isfinite(bounds.loss))
    np.testing.assert_array_equal(np.isfinite(bounds.loss), bounds.leg >= 0)


def test_the_first_loss_is_where_it_is_lost_and_until_when_it_is_kept_again() -> None:
    flown, intruders = mission(5, 12), traffic(12, 4, 7)
    times, away = sampled(flown, intruders)
    bounds = kept(flown, intruders)
    below = (away < REQUIRED) & intruders.mask
    for n, k in np.argwhere(below.any(axis=0) & (bounds.until < flown.end[:, None])):
        first, last = times[np.flatnonzero(below[:, n, k])[[0, -1]]]
        assert bounds.loss[n, k] == pytest.approx(first, abs=0.3)
        assert bounds.until[n, k] == pytest.approx(last, abs=0.3)
        place = at(take(flown.legs, [n]), bounds.loss[n, k : k + 1])
        assert (bounds.x[n, k], bounds.y[n, k]) == pytest.approx((place.x[0], place.y[0]), abs=1e-6)
        began = flown.states.time[n, bounds.leg[n, k]]
        assert began - 1e-9 <= bounds.loss[n, k] <= flown.states.time[n, bounds.leg[n, k] + 1]


@pytest.mark.parametrize("kind", FLOWN)
def test_a_row_depends_on_no_other(kind: str) -> None:
    flown, intruders = FLOWN[kind](9, 6), traffic(6, 12, 8, turning=True)
    together = kept(flown, intruders)
    for n in range(6):
        alone = kept(take(flown, slice(n, n + 1)), take(intruders, slice(n, n + 1)))
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[n : n + 1], part)


def test_what_has_been_flown_does_not_count() -> None:
    flown, intruders = trajectory(plans(10, 4)), traffic(10, 3, 5)
    since = np.random.default_rng(1).uniform(1.0, 150.0, 10)
    x, y = positions(intruders, since[:, None])
    later = intruders._replace(state=intruders.state._replace(x=x, y=y))
    bounds = kept(flown.since(since), later, level=np.inf)
    for n in range(10):
        row = slice(n, n + 1)
        _, away = sampled(take(flown, row), take(intruders, row), since=float(since[n]))
        least = away.min(axis=0)[0] - REQUIRED
        mask = intruders.mask[n]
        assert np.all(bounds.margin[n][mask] <= least[mask] + 1e-6)
        assert bounds.margin[n][mask] == pytest.approx(least[mask], abs=0.3)


def test_over_the_ground_and_through_the_air_it_is_the_same() -> None:
    rng = np.random.default_rng(6)
    own = random_states(rng, 5, extent=3_000.0)
    x, y = rng.uniform(-4_000.0, 4_000.0, (2, 5, 6))
    time = np.broadcast_to(np.arange(6) * 30.0, (5, 6))
    intruders = traffic(5, 6, 7)
    east, north = 7.0, -4.0
    heading = np.arctan2(
        intruders.state.speed * np.sin(intruders.state.heading) - north,
        intruders.state.speed * np.cos(intruders.state.heading) - east,
    )
    speed = np.hypot(
        intruders.state.speed * np.sin(intruders.state.heading) - north,
        intruders.state.speed * np.cos(intruders.state.heading) - east,
    )
    in_air = intruders._replace(state=intruders.state._replace(heading=heading, speed=speed))
    start = own._replace(x=x[:, 0], y=y[:, 0])
    keep = Requirement(REQUIRED, 50.0)
    ground = clearance(straight(x, y, time), separation(intruders, start, keep))
    air = clearance(
        straight(x - east * time, y - north * time, time), separation(in_air, start, keep)
    )
    lost = np.isfinite(ground.loss)
    assert lost.any() and not lost.all()
    np.testing.assert_array_equal(np.isfinite(air.loss), lost)
    np.testing.assert_allclose(air.margin[lost], ground.margin[lost], atol=1e-6)
    np.testing.assert_allclose(air.loss[lost], ground.loss[lost], atol=1e-6)


def test_a_manoeuvre_is_flown_as_its_legs_say() -> None:
    steering = Steering(
        np.array([0.05, 0.0, 0.0]), np.array([0.0, -0.5, 0.0]), np.array([30.0, 20.0, 0.0])
    )
    own = aircraft(3)
    flown = manoeuvres(own, steering, 120.0)
    for time in np.linspace(0.0, 120.0, 41):
        as_manoeuvre, as_legs = (
            at(flown.legs, np.full(3, time)),
            steered(column(own), column(steering), np.full((3, 1), time)),
        )
        assert as_manoeuvre.x == pytest.approx(as_legs.x[:, 0], abs=1e-6)
        assert as_manoeuvre.y == pytest.approx(as_legs.y[:, 0], abs=1e-6)
        assert as_manoeuvre.speed == pytest.approx(as_legs.speed[:, 0])


def test_of_what_grows_the_least_margin_counts() -> None:
    """Straight flights of both, some of which begin too near."""
    flown, intruders = mission(11, 40), traffic(40, 3, 12)
    vague = {"position_std": 30.0, "velocity_std": 1.5}
    intruders = intruders._replace(
        **{name: np.full(intruders.mask.shape, std) for name, std in vague.items()}
    )
    times, away = sampled(flown, intruders)
    margins = away - REQUIRED - growth(intruders, times[:, None, None], 2.0)
    bounds, least, present = kept(flown, intruders), margins.min(axis=0), intruders.mask
    lost = present & (least < -1.0)
    assert np.count_nonzero(lost) > 10
    assert np.all(bounds.margin[present] <= least[present] + 1e-6)
    # Less by what grows in a part of a leg, and by samples that miss the nearest.
    assert np.all(bounds.margin[lost] >= least[lost] - 1.5)
    first = times[np.argmax(margins < 0.0, axis=0)]
    assert np.any(first[lost] == 0.0) and np.any(first[lost] > 0.0)
    assert bounds.loss[lost] == pytest.approx(first[lost], abs=1.0)  # grazing ones are early


def test_a_leg_stays_within_its_sagitta_of_uniform_motion() -> None:
    flown = trajectory(plans(20, 13))
    x, y, time = flown.states.x, flown.states.y, flown.states.time
    for share in np.linspace(0.0, 1.0, 101):
        for leg in range(10):
            place = at(flown.legs, time[:, leg] + share * (time[:, leg + 1] - time[:, leg]))
            straight_x = x[:, leg] + share * (x[:, leg + 1] - x[:, leg])
            straight_y = y[:, leg] + share * (y[:, leg + 1] - y[:, leg])
            off = np.hypot(place.x - straight_x, place.y - straight_y)
            assert np.all(off <= flown.sagitta[:, leg] + flown.error[:, leg] + 1e-6)


def test_what_a_leg_misses_and_what_leaves_it_is_its_error() -> None:
    flown = trajectory(plans(3, 14))
    missed = trajectory(flown.states, flown.legs._replace(miss=flown.legs.miss + 0.5))
    np.testing.assert_allclose(missed.error, flown.error + 0.5)
    rate, since = np.array([1.0, 2.0, 0.0]), np.array([0.0, 50.0, 10.0])
    wider = flown.widened(rate, since)
    lasts = np.maximum(flown.states.time - since[:, None], 0.0)
    np.testing.assert_allclose(wider.error, flown.error + rate[:, None] * lasts[:, 1:])
    np.testing.assert_allclose(wider.error_begin, flown.error + rate[:, None] * lasts[:, :-1])


def test_the_rest_of_an_arc_goes_on_as_the_arc() -> None:
    flown = trajectory(plans(10, 15))
    began = np.random.default_rng(2).uniform(0.3, 1.7, 10) + 40.0  # within the first arc of a leg
    row = np.arange(10)
    later = rest_of(pieces(flown.since(began), row, np.full(10, 2)))
    parts = cut(later, row, np.zeros(10, dtype=int))
    assert later.begin[:, 0] == pytest.approx(0.0)
    for p in range(FINE):
        place = at(flown.legs, began + parts.end[:, p])
        assert parts.x1[:, p] == pytest.approx(place.x, abs=1e-5)
        assert parts.y1[:, p] == pytest.approx(place.y, abs=1e-5)
