"""Balls hold what is computed exactly, and bounds of chords what is flown."""

import itertools
import math
import random
from fractions import Fraction

import numpy as np
import pytest

from agents.check.balls import BITS, UNIT, ZERO, Ball, ball, cis, to_float
from agents.check.certificate import PlanState, Wind
from agents.check.chord import chord_bound, edge_bound, farthest_from_edge, on_one_side
from agents.check.motion import displacement, through_air
from agents.check.refusal import RefusedError
from agents.check.tolerances import FINE

Exact = tuple[Fraction, Fraction]
SIDES = [(1, 0), (-1, 0), (0, 1), (0, -1), (Fraction(3, 5), Fraction(-4, 5))]


def points(of: Ball) -> list[Exact]:
    """Return the middle of a ball and places on its edge, in units."""
    middle = Fraction(of.x), Fraction(of.y)
    return [middle, *((middle[0] + of.r * u, middle[1] + of.r * v) for u, v in SIDES)]


def holds(of: Ball, exact: Exact) -> bool:
    """Return whether a ball holds a number, in units."""
    return (exact[0] - of.x) ** 2 + (exact[1] - of.y) ** 2 <= of.r**2


def some_ball(rng: random.Random, *, real: bool = False) -> Ball:
    """Return a ball of any size, often of no error, or of a real number."""
    x, y = (rng.choice([-1, 1]) * rng.getrandbits(rng.choice([3, 250, 256, 270])) for _ in range(2))
    r = rng.choice([0, 0, rng.getrandbits(4), rng.getrandbits(250), abs(x) // 3, 2 * abs(x)])
    return Ball(x, 0 if real or rng.random() < 0.3 else y, r)


def test_sums_products_and_quotients_hold_those_of_all_numbers_of_both_balls() -> None:
    rng = random.Random(1)
    for _ in range(400):
        first, second = some_ball(rng), some_ball(rng)
        for (a, b), (c, d) in itertools.product(points(first), points(second)):
            assert holds(first + second, (a + c, b + d))
            assert holds(first - second, (a - c, b - d))
            assert holds(first * second, ((a * c - b * d) / UNIT, (a * d + b * c) / UNIT))
        by = some_ball(rng, real=True)
        if by.lo <= 0 <= by.hi:
            with pytest.raises(RefusedError, match="division by zero"):
                first / by
            continue
        for (a, b), c in itertools.product(points(first), (by.lo, by.x, by.hi)):
            assert holds(first / by, (a * UNIT / c, b * UNIT / c))


def test_magnitudes_and_conjugates_hold_those_of_all_numbers() -> None:
    rng = random.Random(2)
    for _ in range(200):
        sample = some_ball(rng)
        size = sample.magnitude()
        for a, b in points(sample):
            square = a * a + b * b
            assert square <= Fraction(size.hi) ** 2
            assert size.lo <= 0 or Fraction(size.lo) ** 2 <= square
            assert holds(sample.conjugate(), (a, -b))
        assert (sample.lo, sample.hi) == (sample.x - sample.r, sample.x + sample.r)


@pytest.mark.parametrize("value", [0.0, 1.0, -0.1, 1e8, 1e-60, 1e-100, 5e-324])
def test_a_float_lies_in_its_ball(value: float) -> None:
    exact = Fraction(value) * UNIT
    assert holds(ball(value, -value), (exact, -exact))
    assert ball(value).r == 0 or abs(value) < 1e-50
    assert to_float(ball(0.3).x) == 0.3


@pytest.mark.parametrize("angle", [0.0, 0.037, 0.37, -0.9, 1.5])
def test_cosine_and_sine_hold_their_series(angle: float) -> None:
    wide = 1 << (BITS - 20)
    for units in (0, wide):
        argument = Ball(ball(angle).x, 0, units)
        for exact in (argument.lo, argument.x, argument.hi):
            a = Fraction(exact, UNIT)
            terms = [a**n / math.factorial(n) for n in range(80)]
            cosine = sum(term * (1, 0, -1, 0)[n % 4] for n, term in enumerate(terms))
            sine = sum(term * (0, 1, 0, -1)[n % 4] for n, term in enumerate(terms))
            assert holds(cis(argument), (cosine * UNIT, sine * UNIT))
    assert cis(ball(angle)).r < UNIT >> 200


def test_displacement_encloses_a_fine_integration() -> None:
    rng = np.random.default_rng(6)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    for straight in (False, True) * 10:
        psi, v, a, w, t = rng.uniform([-3.0, 40.0, -0.8, -0.1, 0.1], [3.0, 100.0, 0.8, 0.1, 40.0])
        w = 0.0 if straight else w
        s = 0.5 * t * (1.0 + nodes)
        far = np.sum(0.5 * t * weights * (v + a * s) * np.exp(1j * (psi + w * s)))
        course, turn = cis(ball(psi)), cis(ball(w) * ball(t))
        flown = displacement(course, turn, *map(ball, (v, a, w, t)))
        assert complex(to_float(flown.x), to_float(flown.y)) == pytest.approx(far, abs=1e-9)
        assert flown.r < UNIT >> 150


def test_states_through_the_air_fly_the_same_over_the_ground() -> None:
    wind, time = Wind(10.0, -5.0, 0.0), 7.0
    ground = PlanState(100.0, 50.0, 0.4, 80.0, time)
    state = through_air(ground, ball(time), wind).in_floats(time)
    assert (state.x + 10.0 * time, state.y - 5.0 * time) == pytest.approx((100.0, 50.0))
    east = state.speed * math.cos(state.heading) + 10.0
    north = state.speed * math.sin(state.heading) - 5.0
    assert (east, north) == pytest.approx((80.0 * math.cos(0.4), 80.0 * math.sin(0.4)))


def test_what_goes_with_the_air_has_any_course_and_hardly_a_speed() -> None:
    drifting = PlanState(0.0, 0.0, 0.0, 10.0 + 1e-6, 5.0)
    state = through_air(drifting, ball(5.0), Wind(10.0, 0.0, 0.0))
    assert to_float(state.position.x) == -50.0
    assert state.speed.lo <= 0 and state.speed.hi >= ball(1e-6).lo - (UNIT >> 45)
    # Whether it goes with the air must be certain.
    standing = PlanState(0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(RefusedError, match="hardly moves"):
        through_air(standing, ZERO, Wind(0.0, FINE, 0.0))


def test_a_chords_bound_holds_for_all_that_leaves_it_by_the_sagitta() -> None:
    rng = np.random.default_rng(2)
    shares = np.linspace(0.0, 1.0, 201)
    for _ in range(300):
        first, last = rng.normal(size=2) @ [1, 1j], rng.normal(size=2) @ [1, 1j]
        sagitta = 10.0 ** rng.uniform(-3.0, 0.5)
        bound = to_float(
            chord_bound(ball(first.real, first.imag), ball(last.real, last.imag), ball(sagitta).hi)
        )
        for side in np.exp(1j * np.linspace(0.0, math.tau, 16)):
            way = first + shares * (last - first) + 4.0 * sagitta * shares * (1.0 - shares) * side
            assert bound <= np.abs(way).min() + 1e-12


def test_a_chords_bound_is_attained_where_the_range_opens() -> None:
    for gap, sagitta in ((0.0, 0.1), (0.2, 0.1), (0.4, 0.1), (0.5, 0.1), (3.0, 1.0)):
        lost = max(4.0 * sagitta - gap, 0.0) ** 2 / (16.0 * sagitta)
        for ends in ((5.0, 5.0 + gap), (5.0 + gap, 5.0)):
            bound = chord_bound(*map(ball, ends), ball(sagitta).hi)
            assert to_float(bound) == pytest.approx(5.0 - lost, abs=1e-12)
    # From the line through both ends, and from how far one gets.
    assert to_float(chord_bound(ball(-9.0, 4.0), ball(9.0, 4.0), ball(0.5).hi)) == pytest.approx(
        3.5
    )
    assert to_float(chord_bound(ball(9.0, 0.0), ball(8.0, 0.1), ball(0.5).hi)) >= 7.5


def test_a_chords_bound_holds_for_all_of_its_ends_balls() -> None:
    wide = UNIT // 2
    first, last = Ball(ball(-10.0).x, UNIT, wide), Ball(ball(10.0).x, UNIT, wide)
    assert chord_bound(first, last, ball(1e-12).hi) <= wide


def segment_distance(p: complex, q: complex, a: complex, b: complex) -> float:
    """Return the distance between two segments, of places along both."""
    shares = np.linspace(0.0, 1.0, 401)
    first, second = p + shares * (q - p), a + shares * (b - a)
    return float(np.abs(first[:, None] - second).min())


def of(place: complex) -> Ball:
    return ball(place.real, place.imag)


def test_bounds_between_chords_and_edges_are_their_distances() -> None:
    rng = np.random.default_rng(3)
    crossing = 0
    for _ in range(150):
        p, q, a, b = (complex(*rng.normal(size=2)) for _ in range(4))
        bound, distance = to_float(edge_bound(*map(of, (p, q, a, b)))), segment_distance(p, q, a, b)
        if bound < 0.0:
            crossing += 1
            assert distance < 0.02
        else:
            assert bound == pytest.approx(distance, abs=0.02)
            assert bound <= distance + 1e-9
        far = segment_distance(p, p, a, b)
        assert to_float(farthest_from_edge(*map(of, (p, a, b)))) == pytest.approx(far, abs=1e-3)
    assert 10 < crossing < 100


def test_edges_on_one_line_are_bounded_by_what_lies_between() -> None:
    p, q, a, b = map(ball, (5.0, 2.0, 0.0, 1.0))
    assert to_float(edge_bound(p, q, a, b)) == pytest.approx(1.0, abs=1e-9)
    assert edge_bound(ball(0.5), q, a, b) < 0


def test_what_may_lie_on_a_line_is_on_no_side_of_it() -> None:
    a, b, above = ball(0.0), ball(1.0), ball(0.3, 0.5)
    assert on_one_side(a, b, above, ball(9.0, 0.1))
    assert not on_one_side(a, b, above, ball(0.5, -0.1))
    assert not on_one_side(a, b, above, Ball(UNIT // 2, UNIT // 10, UNIT // 5))
