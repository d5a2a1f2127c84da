"""The array namespaces that the world is written over.

Every function of the core takes ``xp``: ``numpy`` (evaluation), ``jax.numpy`` (training), or
:data:`FLOATS` or :data:`EXACT_FLOATS` (plain Python floats, where one aircraft is advanced
thousands of times and array overhead would dominate).
"""

import math
import operator

from envs.arrays import ArrayModule


class FloatNamespace:
    """The part of the array namespace that the core uses, for plain floats and booleans.

    Both branches of ``where`` are evaluated before the choice, as with arrays, so callers guard
    denominators instead of relying on the condition.
    """

    pi = math.pi
    inf = math.inf
    sqrt = staticmethod(math.sqrt)
    exp = staticmethod(math.exp)
    log = staticmethod(math.log)
    floor = staticmethod(math.floor)
    copysign = staticmethod(math.copysign)
    abs = staticmethod(abs)
    minimum = staticmethod(min)
    maximum = staticmethod(max)
    logical_and = staticmethod(operator.and_)
    logical_or = staticmethod(operator.or_)
    logical_not = staticmethod(operator.not_)
    zeros_like = staticmethod(lambda _: 0.0)

    @staticmethod
    def row(count: int) -> list[float]:
        """Return so many zeros, a list that is written into; in compiled code an array."""
        return [0.0] * count

    @staticmethod
    def where(condition: bool, yes: float, no: float) -> float:
        """Return ``yes`` if ``condition`` holds, else ``no``."""
        return yes if condition else no

    @staticmethod
    def clip(value: float, low: float, high: float) -> float:
        """Return ``value`` limited to ``[low, high]``."""
        return low if value < low else high if value > high else value

    @staticmethod
    def stack(values: list[float], axis: int = -1) -> list[float]:
        """Return the values as a list, the float counterpart of a vector."""
        if axis != -1:
            raise ValueError(f"stack of floats has one axis, got axis {axis}")
        return list(values)


class ExactFloatNamespace(FloatNamespace):
    """The same, for which angles take the arrays' polynomials."""


FLOATS: ArrayModule = FloatNamespace()
"""Plain floats with the functions of ``math`` for angles: the fastest, off by up to 4e-8 rad, 1 mm
in 300 s.
"""

EXACT_FLOATS: ArrayModule = ExactFloatNamespace()
"""Plain floats with the arrays' own polynomials for angles: equal to numpy in double precision to
the last bit.
"""
