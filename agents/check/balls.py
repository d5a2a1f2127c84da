"""Safe arithmetic: complex numbers with a bound of their error, in whole numbers."""

import math

from .refusal import demand

BITS = 256  # of the fractions of a ball
UNIT = 1 << BITS  # units in a one


class Ball:
    """All complex numbers at most ``r`` from x + iy, in units of 2^-256.

    Of a ball of real numbers, whose y is 0, ``lo`` and ``hi`` are bounds.
    """

    def __init__(self, x: int, y: int, r: int) -> None:
        self.x = x
        self.y = y
        self.r = r

    @property
    def lo(self) -> int:
        """The least real part."""
        return self.x - self.r

    @property
    def hi(self) -> int:
        """The greatest real part."""
        return self.x + self.r

    def __add__(self, other: "Ball") -> "Ball":
        return Ball(self.x + other.x, self.y + other.y, self.r + other.r)

    def __sub__(self, other: "Ball") -> "Ball":
        return Ball(self.x - other.x, self.y - other.y, self.r + other.r)

    def __mul__(self, other: "Ball") -> "Ball":
        a, b, c, d = self.x, self.y, other.x, other.y
        error = (abs(a) + abs(b) + self.r) * other.r + (abs(c) + abs(d)) * self.r
        # Each of the three shifts rounds by less than a unit.
        return Ball((a * c - b * d) >> BITS, (a * d + b * c) >> BITS, (error >> BITS) + 3)

    def __truediv__(self, other: "Ball") -> "Ball":
        """Divide by a real number."""
        demand(other.lo > 0 or other.hi < 0, "the proof needs a division by zero")
        x = (self.x << BITS) // other.x
        y = (self.y << BITS) // other.x
        error = (self.r << BITS) + (abs(x) + abs(y) + 2) * other.r
        return Ball(x, y, error // (abs(other.x) - other.r) + 3)

    def conjugate(self) -> "Ball":
        """Return x - iy."""
        return Ball(self.x, -self.y, self.r)

    def magnitude(self) -> "Ball":
        """Return the magnitude, a real number."""
        return Ball(math.isqrt(self.x * self.x + self.y * self.y), 0, self.r + 1)

    def root(self) -> "Ball":
        """Return the square root of a real number; what is below 0 in it counts as 0."""
        least, most = (math.isqrt(max(end, 0) << BITS) for end in (self.lo, self.hi))
        return Ball((least + most) // 2, 0, (most - least) // 2 + 2)


def ball(x: float, y: float = 0.0) -> Ball:
    """Return the number x + iy: exact, but where it is too fine for 256 bits."""
    a, b = float(x).as_integer_ratio()
    c, d = float(y).as_integer_ratio()
    exact = max(b, d) <= UNIT
    return Ball((a << BITS) // b, (c << BITS) // d, 0 if exact else 2)


def real(units: int) -> Ball:
    """Return a real number of so many units of 2^-256, without an error."""
    return Ball(units, 0, 0)


def to_float(units: int) -> float:
    """Return a number of units of 2^-256 as a float."""
    return units / UNIT


ZERO = ball(0.0)
ONE = ball(1.0)
TWO = ball(2.0)
EIGHT = ball(8.0)
J = ball(0.0, 1.0)


def cis(angle: Ball) -> Ball:
    """Return cosine + i sine of a real angle, rad: the series of a small part of it, squared
    again.
    """
    halvings = (abs(angle.x) >> (BITS - 4)).bit_length()
    small = angle.x >> halvings
    sums = [0, 0, 0, 0]  # of the terms without i, with i, with -1, with -i
    term = UNIT
    n = 0
    while term not in (0, -1):  # a term is 2^-4 of the one before at most, and off by 3 at most
        sums[n % 4] += term
        n += 1
        term = (term * small >> BITS) // n
    total = Ball(sums[0] - sums[2], sums[1] - sums[3], 4 * n + 8)
    for _ in range(halvings):
        total *= total
    return Ball(total.x, total.y, total.r + angle.r)
