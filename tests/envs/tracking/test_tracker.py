"""What is believed of reports: right ones pass, wrong ones are found, and what is said of the
errors holds.
"""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from envs.angles import wrap
from envs.backend import FLOATS
from envs.kinematics import VehicleState, velocity
from envs.tracking import tracker
from envs.tracking.agreement import ROUNDING
from envs.tracking.tracker import (
    Belief,
    Reports,
    Sightings,
    Tracks,
    begin,
    belief,
    extend,
    lasting,
    observe,
    repeats,
    restart,
    shift,
)
from envs.trees import map_leaves, take
from tests.envs.tracking.flights import (
    States,
    errors_of,
    fly,
    reported,
    state_of,
    take_in,
    track,
)
from tests.support import angle_between, headings, mirror_state, move_state

ADSB = 10.0, 1.0  # m and m/s, one sigma per axis
COARSE = 30.0, 3.0
UNKNOWN = 378.0, 1.23
STRAIGHT = [0.0] * 60
RATE = math.radians(3.0)
TURN = [0.0] * 20 + [RATE] * 30 + [0.0] * 20

reports = st.lists(
    st.tuples(
        *[st.floats(-1e4, 1e4)] * 2,
        headings,
        st.floats(0.0, 200.0),
        st.sampled_from([0.0, 1.0, 30.0]),
        st.sampled_from([0.0, 0.3, 3.0]),
        st.booleans(),
        st.floats(0.1, 40.0),
    ),
    min_size=1,
    max_size=20,
)


def run_floats(rows: list[tuple]) -> list[Belief]:
    """Return what is believed after each report of one aircraft, by plain floats."""
    tracks: Tracks | None = None
    beliefs = []
    for *state, far, fast, declares, dt in rows:
        report = Reports(VehicleState(*state), far, fast, declares)
        if tracks is None:
            tracks = begin(report, FLOATS)
        else:
            tracks, jumped = extend(tracks, report, dt, FLOATS)
            tracks = restart(tracks, FLOATS) if jumped else tracks
        beliefs.append(belief(tracks, FLOATS))
    return beliefs


def run_arrays(rows: list[tuple]) -> list[Belief]:
    """Return the same by arrays ``[1]``."""
    tracks: Tracks | None = None
    beliefs = []
    for *values, dt in rows:
        *state, far, fast, declares = (np.array([value]) for value in values)
        report = Reports(VehicleState(*state), far, fast, declares)
        tracks = begin(report) if tracks is None else take_in(tracks, report, dt)
        beliefs.append(belief(tracks))
    return beliefs


def assert_equal(believed: Belief, of_arrays: Belief, tolerance: float) -> None:
    """Check that what plain floats make equals what arrays make, in m, m/s and rad/s."""
    state, array_state = believed.state, take(of_arrays.state, 0)
    for value, array in zip(
        (state.x, state.y, state.speed, *believed[1:]),
        (array_state.x, array_state.y, array_state.speed, *of_arrays[1:]),
        strict=True,
    ):
        assert float(np.ravel(array)[0]) == pytest.approx(float(value), rel=1e-6, abs=tolerance)
    # The arc tangents differ by 4e-8.
    assert state.speed < 1e-3 or angle_between(state.heading, array_state.heading) < 1e-6


@given(
    st.lists(st.floats(-math.radians(6.0), math.radians(6.0)), min_size=1, max_size=30),
    st.sampled_from([(0.0, 0.0), (10.0, 1.0), (30.0, 3.0)]),
    st.sampled_from([(0.0, 0.0), (10.0, 1.0), (30.0, 3.0)]),
    st.booleans(),
    st.floats(0.2, 10.0),
)
def test_arrays_equal_floats_on_flights(
    rates: list[float],
    errors: tuple[float, float],
    declared: tuple[float, float],
    declares: bool,
    dt: float,
) -> None:
    rng = np.random.default_rng(6)
    received = [reported(state, rng, *errors) for state in fly(rates, dt=dt)]
    rows = [(*(float(field[0]) for field in state), *declared, declares, dt) for state in received]
    for believed, of_arrays in zip(run_floats(rows), run_arrays(rows), strict=True):
        assert_equal(believed, of_arrays, 1e-6)


@given(reports)
def test_arrays_equal_floats_whatever_is_reported(rows: list[tuple]) -> None:
    # Reports that jump by kilometres multiply what a sine is rounded by.
    for believed, of_arrays in zip(run_floats(rows), run_arrays(rows), strict=True):
        assert_equal(believed, of_arrays, 1e-4)


extremes = st.lists(
    st.tuples(
        *[st.sampled_from([0.0, 1e-9, 1.0, -1e7, 1e7]) | st.floats(-1e7, 1e7)] * 2,
        headings,
        st.sampled_from([0.0, 1e-12, 1e4]) | st.floats(0.0, 1e4),
        st.sampled_from([0.0, 1e-9, 1e5]) | st.floats(0.0, 1e5),
        st.sampled_from([0.0, 1e-9, 1e4]) | st.floats(0.0, 1e4),
        st.booleans(),
        st.sampled_from([1e-6, 1e-3, 1e6]) | st.floats(1e-6, 1e5),
    ),
    min_size=1,
    max_size=25,
)


@given(extremes)
def test_extreme_numbers_and_long_gaps_make_finite_ones(rows: list[tuple]) -> None:
    with np.errstate(all="raise", under="ignore"):
        of_arrays = run_arrays(rows)
    for believed in (*run_floats(rows), *of_arrays):
        for value in (*believed.state, believed.turn_rate, believed.turn_std, believed.bias):
            assert np.isfinite(value).all()
        for std in (believed.position_std, believed.velocity_std):
            assert (np.isfinite(std) | (np.equal(std, np.inf) & believed.doubtful)).all()
        assert np.all(believed.position_std >= 0.0) and np.all(believed.velocity_std >= 0.0)


def test_rows_do_not_know_of_each_other() -> None:
    states = fly(TURN, rows=7)
    rng = np.random.default_rng(2)
    received = [reported(state, rng, *COARSE) for state in states]

    def run(rows: slice) -> Tracks:
        declared = np.linspace(0.0, 30.0, 7)[rows], np.linspace(0.0, 3.0, 7)[rows]
        parts = [
            Reports(map_leaves(lambda field: field[rows], states_then), *declared)
            for states_then in received
        ]
        tracks = begin(parts[0])
        for part in parts[1:]:
            tracks = take_in(tracks, part, 1.0)
        return tracks

    together, alone = run(slice(None)), run(slice(3, 4))
    map_leaves(
        lambda several, single: np.testing.assert_allclose(several[3:4], single, rtol=1e-12),
        together,
        alone,
    )


def mirrored(believed: Belief) -> Belief:
    return believed._replace(
        state=mirror_state(believed.state), turn_rate=-np.asarray(believed.turn_rate)
    )


def moved(believed: Belief, angle: float, east: float, north: float) -> Belief:
    return believed._replace(state=move_state(believed.state, angle, east, north))


def assert_same(first: Belief, second: Belief) -> None:
    (vx, vy), (wx, wy) = velocity(first.state, np), velocity(second.state, np)
    for field, expected in zip(
        (first.state.x, first.state.y, vx, vy, *first[1:]),
        (second.state.x, second.state.y, wx, wy, *second[1:]),
        strict=True,
    ):
        np.testing.assert_allclose(field, expected, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("declared", [COARSE, (0.0, 0.0), ADSB])
@pytest.mark.parametrize("change", ["rotated", "shifted", "mirrored"])
def test_what_is_believed_turns_shifts_and_mirrors_with_the_reports(
    change: str, declared: tuple[float, float]
) -> None:
    apply: tuple[Callable, Callable] = {
        "rotated": (partial(move_state, angle=1.0), partial(moved, angle=1.0, east=0.0, north=0.0)),
        "shifted": (
            partial(move_state, angle=0.0, east=3e4, north=-7e4),
            partial(moved, angle=0.0, east=3e4, north=-7e4),
        ),
        "mirrored": (mirror_state, mirrored),
    }[change]
    states = fly(TURN, rows=20)
    plain = track(states, COARSE, declared)
    changed = track(states, COARSE, declared, change=apply[0])
    for believed, expected in zip(plain, changed, strict=True):
        assert_same(apply[1](believed), expected)


def test_the_time_of_day_does_not_matter() -> None:
    states = fly(TURN, rows=20)
    ends = []
    for began in (0.0, 86_400.0):
        rng, sightings = np.random.default_rng(1), None
        for second, state in enumerate(states):
            received = Reports(reported(state, rng, *COARSE), *COARSE)
            sightings = observe(sightings, received, began + second, np.ones(20, bool))
        assert sightings is not None
        ends.append(belief(sightings.tracks))
    assert_same(*ends)


def test_a_map_is_shifted_with_all_that_is_known() -> None:
    states, rng = fly(TURN, rows=20), np.random.default_rng(1)
    tracks = begin(Reports(reported(states[0], rng, *COARSE), *COARSE))
    for state in states[1:]:
        tracks = take_in(tracks, Reports(reported(state, rng, *COARSE), *COARSE), 1.0)
    shifted = belief(shift(tracks, np.float64(100.0), np.float64(-50.0)))
    assert_same(moved(belief(tracks), 0.0, -100.0, 50.0), shifted)


# Reports that are right.


@given(
    st.lists(
        st.tuples(st.floats(-math.radians(5.0), math.radians(5.0)), st.integers(1, 5)),
        min_size=1,
        max_size=8,
    ),
    st.booleans(),
    st.floats(0.2, 3.0),
)
def test_reports_without_errors_that_agree_pass_to_the_bit(
    legs: list[tuple[float, int]], known: bool, dt: float
) -> None:
    rates = [rate for rate, steps in legs for _ in range(steps)]
    states = fly(rates, rows=3, dt=dt)
    beliefs = track(states, (0.0, 0.0), (0.0, 0.0), known=known, dt=dt, change=lambda state: state)
    received = [reported(state, np.random.default_rng(0), 0.0, 0.0) for state in states]
    for state, believed in zip(received, beliefs, strict=True):
        for field, value in zip(state, believed.state, strict=True):
            np.testing.assert_array_equal(value, field)
        for value in (believed.position_std, believed.velocity_std):
            np.testing.assert_array_equal(value, 0.0)
        assert not believed.doubtful.any() and not believed.bias.any()
    for rate, believed in zip(rates, beliefs[1:], strict=True):
        if known:
            np.testing.assert_array_equal(believed.turn_std, 0.0)
            np.testing.assert_allclose(believed.turn_rate, rate, atol=1e-6)
        elif not any(rates):
            np.testing.assert_array_equal(believed.turn_rate, 0.0)


@pytest.mark.parametrize("errors", [(3.0, 0.15), (3.0, 1.0), ADSB])
@pytest.mark.parametrize("dt", [1.0, 5.0])
def test_what_reports_do_not_declare_is_no_turn(errors: tuple[float, float], dt: float) -> None:
    states = fly(STRAIGHT, rows=200, dt=dt)
    beliefs = track(states, errors, (0.0, 0.0), known=False, dt=dt)
    assert np.mean([estimate.turn_rate != 0.0 for estimate in beliefs]) < 0.005


def test_a_bias_that_is_not_significant_is_covered() -> None:
    states = fly(STRAIGHT, rows=500)
    for lack in (1.0, 2.0, 3.0, 5.0):

        def change(state: VehicleState, lack: float = lack) -> VehicleState:
            vx, vy = velocity(state, np)
            return state_of(state.x, state.y, vx + lack, vy)

        beliefs = track(states, ADSB, ADSB, change=change)
        late = [errors_of(*pair) for pair in zip(beliefs, states, strict=True)][20:]
        for covered in ("position_covered", "velocity_covered"):
            assert np.mean([getattr(error, covered) for error in late]) > 0.98


@pytest.mark.parametrize("errors", [COARSE, ADSB])
def test_right_reports_are_known_better_than_they_are(errors: tuple[float, float]) -> None:
    states = fly(STRAIGHT, rows=1_000)
    beliefs = track(states, errors, errors)
    last = [errors_of(*pair) for pair in zip(beliefs, states, strict=True)][20:]
    position = math.sqrt(np.mean([np.square(error.position) for error in last]))
    speed = math.sqrt(np.mean([np.square(error.velocity) for error in last]))
    assert position < 0.31 * math.sqrt(2.0) * errors[0]
    assert speed < 0.6 * math.sqrt(2.0) * errors[1]
    if errors == COARSE:
        assert position < 12.5 and speed < 0.95
    for error in last:
        assert error.position_covered.mean() > 0.97 and error.velocity_covered.mean() > 0.99


@pytest.mark.parametrize("errors", [COARSE, ADSB])
def test_a_turn_misleads_for_seconds_at_most(errors: tuple[float, float]) -> None:
    for rate in (0.5, 1.0, 3.0, 6.0):
        rates = [0.0] * 20 + [math.radians(rate)] * 30 + [0.0] * 20
        states = fly(rates, rows=500)
        beliefs = track(states, errors, errors)
        all_errors = [errors_of(*pair) for pair in zip(beliefs, states, strict=True)]
        raw = math.sqrt(2.0) * np.array(errors)
        for error in all_errors:
            assert math.sqrt(np.mean(error.position**2)) < 1.1 * raw[0]
            assert math.sqrt(np.mean(error.velocity**2)) < 1.6 * raw[1]


@pytest.mark.slow
def test_the_rate_of_a_turn_is_known_within_its_sigmas() -> None:
    for degrees in (1.0, 2.0, 3.0, 6.0):
        rate = math.radians(degrees)
        for errors in (COARSE, ADSB):
            believed = track(fly([0.0] * 20 + [rate] * 30, rows=2_000), errors, errors)[-1]
            turns = believed.turn_rate != 0.0
            assert turns.mean() > (0.6 if errors == COARSE and degrees < 2.0 else 0.97)
            off = (believed.turn_rate - rate)[turns] / believed.turn_std[turns]
            assert math.sqrt(np.mean(off**2)) < 1.2
            assert np.mean(np.abs(off) < 3.0) > 0.99


def test_straight_flight_rarely_turns() -> None:
    for errors in (COARSE, ADSB):
        beliefs = track(fly(STRAIGHT, rows=1_000), errors, errors)
        assert np.mean([estimate.turn_rate != 0.0 for estimate in beliefs]) < 0.01


# Consistency of both filters together (Bar-Shalom, Li and Kirubarajan 2001, section 5.4).


def model_flights(rows: int, seconds: int, seed: int) -> States:
    """Return flights that the tracker's own model moves: they begin and end turns at random, and
    its noise is that of the filters.
    """
    rng, steps = np.random.default_rng(seed), 10
    dt = 1.0 / steps
    start = fly([], rows, seed=seed)[0]
    place, v = np.array([start.x, start.y]), np.array(velocity(start, np))
    turns = rng.random(rows) < tracker.FIRST
    a = np.where(turns, tracker.ONSET * rng.normal(size=(2, rows)), 0.0)
    states = [state_of(*place, *v)]
    for _ in range(seconds):
        changes = rng.random(rows) < 1.0 - math.exp(
            -1.0 / tracker.STRAIGHT_LASTS - 1.0 / tracker.TURN_LASTS
        )
        turning = rng.random(rows) < tracker.TURNING
        begins, ends = changes & ~turns & turning, changes & turns & ~turning
        fresh = tracker.ONSET * rng.normal(size=(2, rows))
        turns = (turns | begins) & ~ends
        a = np.where(begins, fresh, np.where(turns, a, 0.0))
        rate = (v[0] * a[1] - v[1] * a[0]) / np.maximum(np.sum(v * v, axis=0), 1.0)
        rate = np.clip(rate, -tracker.FASTEST_TURN, tracker.FASTEST_TURN)
        for _ in range(steps):
            jerk, kick = math.sqrt(tracker.JERK * dt), math.sqrt(tracker.WANDER * dt)
            after = a - rate**2 * v * dt + jerk * rng.normal(size=(2, rows))
            after = np.where(turns, after, 0.0)
            place = place + v * dt + 0.5 * a * dt**2
            v = v + 0.5 * (a + after) * dt + np.where(turns, 0.0, kick) * rng.normal(size=(2, rows))
            a = after
        states.append(state_of(*place, *v))
    return states


def nees(states: States, errors: tuple[float, float]) -> np.ndarray:
    """Return the squared errors of what both filters together estimate, over their covariance,
    ``[T, N]``; of four degrees of freedom.
    """
    rng, values = np.random.default_rng(4), []
    tracks: Tracks | None = None
    for state in states:
        report = Reports(reported(state, rng, *errors), *map(np.float64, errors))
        tracks = begin(report) if tracks is None else take_in(tracks, report, 1.0)
        mixture = tracker.mix(tracks.straight, tracks.turning, tracks.turns)
        c, (vx, vy) = mixture.covariance, velocity(state, np)
        determinant = c.pp * c.vv - c.pv**2
        values.append(
            sum(
                (c.vv * p * p - 2.0 * c.pv * p * v + c.pp * v * v) / determinant
                for p, v in (
                    (mixture.x - state.x, mixture.vx - vx),
                    (mixture.y - state.y, mixture.vy - vy),
                )
            )
        )
    return np.array(values)


@pytest.mark.parametrize("errors", [COARSE, ADSB, (5.0, 0.5)])
def test_errors_are_as_large_as_said_where_the_motion_is_the_models(
    errors: tuple[float, float],
) -> None:
    runs = 50
    values = nees(model_flights(40 * runs, 80, 1), errors)
    # Two-sided: by what a run of 50 flights may have in the mean.
    low, high = chi2.ppf([0.025, 0.975], 4 * runs) / runs
    means = values.reshape(len(values), -1, runs).mean(axis=-1)
    assert values.mean() == pytest.approx(4.0, rel=0.04)
    assert low < values.mean(axis=1).min() and values.mean(axis=1).max() < high
    # A mixture has wider tails than one filter: 95 % of one would be inside.
    assert np.mean((low <= means) & (means <= high)) > 0.75


@pytest.mark.parametrize("errors", [COARSE, ADSB, (5.0, 0.5), (1.0, 0.1)])
@pytest.mark.parametrize("rates", [STRAIGHT, TURN], ids=["straight", "turn"])
def test_errors_are_not_above_what_is_said_elsewhere(
    rates: list[float], errors: tuple[float, float]
) -> None:
    runs = 50
    values = nees(fly(rates, rows=20 * runs), errors)
    high = chi2.ppf(0.975, 4 * runs) / runs
    assert values.mean() < high
    # Above for some seconds after a turn has begun or ended, which nobody can see yet.
    assert np.mean(values.mean(axis=1) > high) < 0.15


# Reports that are wrong.


def in_wind(state: VehicleState, speed: float = 10.0) -> VehicleState:
    """Return the airspeed for the ground speed, and the heading for the track."""
    rows = np.shape(state.x)[0]
    towards = np.linspace(0.0, 2.0 * math.pi, rows, endpoint=False)
    vx, vy = velocity(state, np)
    return state_of(state.x, state.y, vx - speed * np.cos(towards), vy - speed * np.sin(towards))


WRONG = {
    "track off by 25 deg": lambda state: state._replace(
        heading=wrap(state.heading + math.radians(25.0), np)
    ),
    "knots for m/s": lambda state: state._replace(speed=state.speed / 0.514444),
    "m/s for knots": lambda state: state._replace(speed=state.speed * 0.514444),
    "airspeed for ground speed": in_wind,
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_field_is_found_within_20_s(wrong: str) -> None:
    states = fly(STRAIGHT, rows=1_000)
    beliefs = track(states, ADSB, ADSB, change=WRONG[wrong])
    for second in (20, 30, 40, 50, 60):
        error = errors_of(beliefs[second], states[second])
        assert np.mean(beliefs[second].bias > 0.0) >= 0.99
        assert not beliefs[second].doubtful.any()
        assert error.velocity_covered.mean() >= 0.99
        assert np.mean(error.velocity < 5.0) >= 0.99
        assert error.position_covered.mean() > 0.95


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_field_is_covered_in_turns(wrong: str) -> None:
    states = fly([*TURN, *TURN], rows=500)
    beliefs = track(states, ADSB, ADSB, change=WRONG[wrong])
    all_errors = [errors_of(*pair) for pair in zip(beliefs, states, strict=True)][20:]
    assert np.mean([error.velocity_covered for error in all_errors]) > 0.95
    assert np.mean([error.position_covered for error in all_errors]) > 0.9


def test_a_field_that_is_right_again_is_believed_again() -> None:
    states = fly([0.0] * 90, rows=500)
    right = iter(range(len(states)))

    def until_30_s(state: VehicleState) -> VehicleState:
        return WRONG["knots for m/s"](state) if next(right) <= 30 else state

    beliefs = track(states, ADSB, ADSB, change=until_30_s)
    assert np.mean(beliefs[30].bias > 0.0) >= 0.99
    assert np.mean(beliefs[60].bias > 0.0) < 0.02
    for second in (50, 60, 90):
        assert errors_of(beliefs[second], states[second]).velocity_covered.mean() > 0.98


@pytest.mark.parametrize("declared", [(0.0, 0.0), ADSB])
def test_noise_that_nobody_declares_is_covered_after_20_s(declared: tuple[float, float]) -> None:
    states = fly(STRAIGHT, rows=1_000)
    beliefs = track(states, COARSE, declared)
    for second in (20, 30, 45, 60):
        error = errors_of(beliefs[second], states[second])
        assert error.velocity_covered.mean() > 0.98
        assert error.position_covered.mean() > 0.96
        assert math.sqrt(np.mean(error.velocity**2)) < 1.5


@pytest.mark.slow
@given(st.floats(0.0, 100.0), st.floats(0.0, 10.0), st.floats(0.0, 500.0), st.floats(0.0, 10.0))
def test_declared_errors_are_never_undercut_where_they_may_be_constant(
    position_std: float, velocity_std: float, far: float, fast: float
) -> None:
    states = fly(TURN[10:40], rows=5)
    for believed in track(states, (position_std, velocity_std), (far, fast), known=False):
        assert (believed.position_std >= far).all() and (believed.velocity_std >= fast).all()


def test_a_place_that_jitters_where_its_aircraft_flies_is_doubtful() -> None:
    states = fly([0.0] * 30, rows=200)
    start = states[0]
    rng = np.random.default_rng(8)

    def frozen(state: VehicleState) -> VehicleState:
        x, y = (place + 3.0 * rng.normal(size=200) for place in (start.x, start.y))
        return state._replace(x=x, y=y)

    for declared in (ADSB, (0.0, 0.0)):
        believed = track(states, (0.0, 0.1), declared, change=frozen)[20]
        assert believed.doubtful.all()
        # The place is more than a kilometre off by then: nothing finite that reports show covers it.
        assert (np.abs(believed.state.x - states[20].x) > 100.0).any()
        for std in (believed.position_std, believed.velocity_std):
            np.testing.assert_array_equal(std, np.inf)


# Sightings: reports that come now and then.


def sight(sightings: Sightings | None, state: VehicleState, time: float) -> Sightings:
    present = np.ones(np.shape(state.x), bool)
    return observe(sightings, Reports(state, *map(np.float64, ADSB)), time, present)


def test_a_position_that_is_held_is_as_old_as_it_is() -> None:
    states, sightings = fly(STRAIGHT, rows=20), None
    for second, state in enumerate(states):
        old_state = states[second // 3 * 3]
        sightings = sight(sightings, state._replace(x=old_state.x, y=old_state.y), float(second))
        np.testing.assert_array_equal(sightings.time, second // 3 * 3)
    assert sightings is not None
    assert not (belief(sightings.tracks).bias > 0.0).any()


@given(st.floats(0.0, 200.0), st.floats(0.1, 10.0))
def test_what_does_not_fly_repeats_nothing(speed: float, dt: float) -> None:
    state = VehicleState(1.0, 2.0, 0.5, speed)
    assert repeats(state, state, dt, FLOATS) == (speed * dt > ROUNDING[0])
    assert not repeats(state, state._replace(x=1.1), dt, FLOATS)


def test_an_aircraft_that_is_silent_for_long_is_new() -> None:
    states = fly([0.0] * 100, rows=5)
    sightings = None
    for second in (*range(40), *range(90, 100)):
        sightings = sight(sightings, states[second], float(second))
        if second == 90:
            np.testing.assert_array_equal(sightings.tracks.agreement.count, 1.0)
    assert sightings is not None
    np.testing.assert_array_equal(sightings.tracks.agreement.count, 10.0)


def test_what_is_not_there_stays_as_it_was() -> None:
    states, sightings = fly([0.0] * 20, rows=2), None
    for second, state in enumerate(states):
        present = np.array([True, second < 10])
        missing = VehicleState(*[np.full(2, np.nan)] * 4)
        received = Reports(map_leaves(partial(np.where, present), state, missing), *ADSB)
        sightings = observe(sightings, received, float(second), present)
    assert sightings is not None
    np.testing.assert_array_equal(sightings.time, [20.0, 9.0])
    np.testing.assert_array_equal(sightings.tracks.newest.state.x[1], states[9].x[1])


def test_a_jump_begins_anew() -> None:
    states = fly([0.0] * 30, rows=5)
    sightings = None
    for second, state in enumerate(states):
        far = state if second < 20 else state._replace(y=state.y + 3_000.0)
        sightings = sight(sightings, far, float(second))
    assert sightings is not None
    off = belief(sightings.tracks).state.y - states[-1].y - 3_000.0
    assert (np.abs(off) < 30.0).all()


def test_a_turn_goes_on_as_long_as_its_course_is_known() -> None:
    states = fly([0.0] * 20 + [RATE] * 20, rows=3)
    last = track(states, ADSB, ADSB)[-1]
    assert (last.turn_rate != 0.0).all() and (last.turn_std > 0.0).all()
    assert (lasting(last.turn_rate, last.turn_std, np.float64(2.0)) == 2.0).all()
    known = lasting(last.turn_rate, last.turn_std, np.float64(60.0))
    assert ((known > 0.0) & (known < 60.0)).all()
    assert np.degrees(last.turn_std * known) == pytest.approx(10.0, rel=0.01)
    assert lasting(RATE, 0.0, 15.0, FLOATS) == 15.0
    assert lasting(0.0, 0.1, 15.0, FLOATS) == 0.0
