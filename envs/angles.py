"""Angles without library trigonometry: wrap, sine and cosine, and the four-quadrant arctangent.

libm's functions are called one element at a time by compiled array code and would dominate a
surrogate step, and each array library rounds them differently. These polynomials are plain
arithmetic, so that they vectorise and agree across backends. Coefficients are our own minimax fits
(largest error over the reduced range: sine 5e-14, arctangent 4e-8 rad). Plain floats take
``math``'s functions, which agree to 4e-8 rad.
"""

import math

from envs.arrays import Array, ArrayModule
from envs.backend import FLOATS
from envs.compiled import scalar, scalar_as

_TWO_PI = 2.0 * math.pi
_HALF_PI = 0.5 * math.pi
_SIN = (
    0.9999999999996247,
    -0.1666666666609837,
    0.008333333308421988,
    -0.00019841265025168897,
    2.7556840958839426e-06,
    -2.5026639336772455e-08,
    1.5365978169256675e-10,
)
_ATAN = (
    0.9999993356082285,
    -0.3332986084604498,
    0.19946566051358552,
    -0.13908630674073083,
    0.0964219876253181,
    -0.05591233288821821,
    0.021862955446050297,
    -0.0040545651819291675,
)
# Smallest denominator of the arctangent's quotient: far below any length in metres that matters,
# and a normal number in float32.
_TINY = 1e-30


@scalar
def wrap(angle: Array, xp: ArrayModule) -> Array:
    """Return the angle (rad, any shape) wrapped to [-pi, pi)."""
    wrapped = angle - _TWO_PI * xp.floor((angle + math.pi) * (1.0 / _TWO_PI))
    # Rounding can leave the ends of the range one unit outside it.
    wrapped = xp.where(wrapped >= math.pi, wrapped - _TWO_PI, wrapped)
    return xp.where(wrapped < -math.pi, -math.pi, wrapped)


def _library_sincos(angle: float, xp: ArrayModule) -> tuple[float, float]:
    return math.sin(angle), math.cos(angle)


def _polynomial_sincos(angle: Array, xp: ArrayModule) -> tuple[Array, Array]:
    size = xp.abs(angle)
    sine = xp.copysign(1.0, angle) * _odd(xp.minimum(size, math.pi - size), _SIN)
    # cos(a) = sin(pi/2 - a); beyond pi fold once more so that the polynomial stays in its range.
    folded = _HALF_PI - xp.where(size > math.pi, _TWO_PI - size, size)
    return sine, _odd(folded, _SIN)


@scalar_as(_library_sincos, _polynomial_sincos)
def sincos(angle: Array, xp: ArrayModule) -> tuple[Array, Array]:
    """Return sine and cosine of an angle in [-3/2 pi, 3/2 pi] (rad, any shape).

    Headings are wrapped, and half a step's turn on top of one stays far inside the range.
    """
    return (_library_sincos if xp is FLOATS else _polynomial_sincos)(angle, xp)


def _library_atan2(y: float, x: float, xp: ArrayModule) -> float:
    return math.atan2(y, x)


def _polynomial_atan2(y: Array, x: Array, xp: ArrayModule) -> Array:
    size_x, size_y = xp.abs(x), xp.abs(y)
    quotient = xp.minimum(size_x, size_y) / xp.maximum(xp.maximum(size_x, size_y), _TINY)
    angle = _odd(quotient, _ATAN)
    angle = xp.where(size_y > size_x, _HALF_PI - angle, angle)
    angle = xp.where(x < 0.0, math.pi - angle, angle)
    return xp.where(y < 0.0, -angle, angle)


@scalar_as(_library_atan2, _polynomial_atan2)
def atan2(y: Array, x: Array, xp: ArrayModule) -> Array:
    """Return the angle of the vector (x, y) in [-pi, pi] (rad, any shape); 0 for the null
    vector.
    """
    return (_library_atan2 if xp is FLOATS else _polynomial_atan2)(y, x, xp)


@scalar
def _odd(x: Array, coefficients: tuple[float, ...]) -> Array:
    """Evaluate x * (c0 + c1 x^2 + c2 x^4 + ...)."""
    square = x * x
    total = coefficients[-1]
    for number in range(len(coefficients) - 2, -1, -1):
        total = total * square + coefficients[number]
    return total * x
