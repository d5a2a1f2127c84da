"""Angles: accuracy of the polynomials against libm, and the range of wrapped angles, in every backend."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.angles import atan2, sincos, wrap
from tests.strategies import ARRAY_BACKENDS, BACKENDS, Backend, angle_between

TURN = 2.0 * math.pi
each_backend = pytest.mark.parametrize("backend", BACKENDS, ids=lambda backend: backend.name)
each_array_backend = pytest.mark.parametrize("backend", ARRAY_BACKENDS, ids=lambda backend: backend.name)


def tolerance(backend: Backend) -> float:
    return 1e-6 if backend.dtype is np.float32 else 1e-7


def neighbours(dtype: type, *values: float, steps: int = 4) -> np.ndarray:
    """Return the values and the nearest representable numbers on both sides of each."""
    found = []
    for value in values:
        down = up = dtype(value)
        found.append(down)
        for _ in range(steps):
            down, up = np.nextafter(down, dtype(-np.inf)), np.nextafter(up, dtype(np.inf))
            found += [down, up]
    return np.array(found, np.float64)


@each_backend
def test_sincos_agrees_with_libm_over_its_whole_domain(backend: Backend) -> None:
    dense = np.linspace(-1.5 * math.pi, 1.5 * math.pi, 100_001 if backend.name != "floats" else 1_001)
    corners = neighbours(np.float64, 0.0, *(0.5 * math.pi * k for k in range(-2, 3)))
    angle = backend.rounded(np.concatenate([dense[1:-1], corners, [1e-30, -1e-30, 1e-8]]))
    sine, cosine = backend.apply(lambda a: sincos(a, backend.xp), angle)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=0.0, atol=tolerance(backend))
    np.testing.assert_allclose(cosine, np.cos(angle), rtol=0.0, atol=tolerance(backend))


@each_array_backend
def test_sine_of_small_angles_is_relatively_accurate(backend: Backend) -> None:
    angle = backend.rounded(np.geomspace(1e-20, 0.1, 200))
    sine, _ = backend.apply(lambda a: sincos(a, backend.xp), angle)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=tolerance(backend))


@each_backend
def test_atan2_agrees_with_libm_all_around_at_every_length(backend: Backend) -> None:
    count = 2_001 if backend.name != "floats" else 201
    angle, length = np.meshgrid(np.linspace(-math.pi, math.pi, count), [1e-3, 1.0, 567.0, 2e4, 1e7])
    y, x = backend.rounded(length * np.sin(angle)).ravel(), backend.rounded(length * np.cos(angle)).ravel()
    (found,) = backend.apply(lambda a, b: (atan2(a, b, backend.xp),), y, x)
    assert np.max(angle_between(found, np.arctan2(y, x))) <= tolerance(backend)


@each_backend
def test_atan2_on_the_axes_and_diagonals(backend: Backend) -> None:
    y = np.array([0.0, 1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0])
    x = np.array([1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0, 1.0, 0.0])
    (found,) = backend.apply(lambda a, b: (atan2(a, b, backend.xp),), y, x)
    np.testing.assert_allclose(found, math.pi * np.array([0, 1, 2, 3, 4, -3, -2, -1, 0]) / 4, atol=tolerance(backend))


@given(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_atan2_of_any_vector(y: float, x: float) -> None:
    for backend in ARRAY_BACKENDS[:2]:
        rounded_y, rounded_x = backend.rounded([y]), backend.rounded([x])
        (found,) = backend.apply(lambda a, b, xp=backend.xp: (atan2(a, b, xp),), rounded_y, rounded_x)
        assert abs(found[0]) <= math.pi + tolerance(backend)
        if math.hypot(x, y) > 1e-20:
            assert angle_between(found, np.arctan2(rounded_y, rounded_x))[0] <= tolerance(backend)


@each_backend
def test_wrap_stays_in_the_half_open_range_at_its_edges(backend: Backend) -> None:
    """Also where rounding meets the ends: one unit inside and outside every odd multiple of pi."""
    edges = neighbours(backend.dtype, *(math.pi * k for k in range(-7, 8)), steps=8)
    (wrapped,) = backend.apply(lambda a: (wrap(a, backend.xp),), edges)
    low, high = backend.rounded([-math.pi, math.pi])
    assert np.all(wrapped >= low)
    assert np.all(wrapped < high)
    assert np.max(angle_between(wrapped, edges)) <= 4.0 * np.spacing(backend.dtype(22.0))


@given(st.floats(-20.0, 20.0))
def test_wrap_keeps_the_direction(angle: float) -> None:
    for backend in (BACKENDS[0], BACKENDS[1], BACKENDS[3]):
        exact = backend.rounded([angle])
        (wrapped,) = backend.apply(lambda a, xp=backend.xp: (wrap(a, xp),), exact)
        low, high = backend.rounded([-math.pi, math.pi])
        assert low <= wrapped[0] < high
        assert angle_between(wrapped, exact)[0] <= 4.0 * np.spacing(backend.dtype(20.0))


@each_backend
def test_wrap_leaves_wrapped_angles_alone(backend: Backend) -> None:
    angle = backend.rounded(np.linspace(-math.pi, math.pi, 501)[:-1])
    (wrapped,) = backend.apply(lambda a: (wrap(a, backend.xp),), angle)
    np.testing.assert_array_equal(wrapped, angle)
